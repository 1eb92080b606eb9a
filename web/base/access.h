/* access: what the coordinator learns of those who ask: for its audit log, and that tokens are used. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct web;

/* A line of the audit log (coordinator/store/files/audit.h): `key` is how they proved who they are; `details` is a JSON
 * object, or NULL; `why` says why it was refused, or is NULL. */
void access_note(struct web *web, const char *verb, const char *who, const char *peer, const char *key, uint64_t job,
                 const char *details, const struct error *why);
/* `who` signed in with the token. */
void access_note_sign_in(struct web *web, const char *who, const char *peer, uint64_t token);
/* A wrong token came from this address: into the audit log, unless it does so too often, which is 0. */
int access_note_failure(struct web *web, const char *peer);
/* The token is used. */
void access_note_use(struct web *web, uint64_t token);
