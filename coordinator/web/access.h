/* access: signing in to the page, and what tokens mean to the rest of this room: what the audit log says of them, and
 * what ends with them. */
#ifndef AZULEJO_COORDINATOR_ACCESS_H
#define AZULEJO_COORDINATOR_ACCESS_H

#include "coordinator/web/request.h"

/* POST /api/v1/session {"token": TEXT}: a cookie for a token. DELETE: no cookie any more. GET: who asks. */
void web_session_post(struct web_request *request);
void web_session_delete(struct web_request *request);
void web_session_get(struct web_request *request);

/* A wrong token came from this address: into the audit log, unless it does so too often, which is 0. */
int access_note_failure(struct web *web, const char *peer);

/* A token has ended (web_token_ended): what was begun with it ends at the next tick, not now: its own request may be
 * the one that ends it. New requests are refused already. */
void access_ended(struct web *web, uint64_t token, int cookies);

/* What was begun with tokens that have ended ends; once a second tokens expire, and the store learns which were used.
 * At each tick of the server. */
void access_tick(struct web *web, uint64_t now_ns);

#endif
