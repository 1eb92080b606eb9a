/* access: what the audit log says of tokens: who signed in, and from where wrong ones came. */
#ifndef AZULEJO_COORDINATOR_ACCESS_H
#define AZULEJO_COORDINATOR_ACCESS_H

#include "common/base/status.h"
#include "coordinator/store/store_web.h"

struct web;

/* `who` signed in with the token, or was refused for `why`; either may be NULL. */
void access_note(struct web *web, const char *who, const char *peer, const struct token_row *row,
                 const struct error *why);
/* A wrong token came from this address: into the audit log, unless it does so too often, which is 0. */
int access_note_failure(struct web *web, const char *peer);

#endif
