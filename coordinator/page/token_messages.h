/* token_messages: what clients and the API ask about tokens. An admin's key or token may (common/schema/requests.h).
 *
 * A change is answered when the page's program knows of it, or after TOKEN_ANSWER_MS: a token that was made works, and
 * one that was revoked does not.
 */
#pragma once

#include "coordinator/net/session/session_messages.h"

enum { TOKEN_ANSWER_MS = 2000 };

struct page;

/* Answer the message, which is one about tokens. */
status token_message(struct page *page, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err) MUST_CHECK;
/* Send the answers whose changes the page knows, up to this version of the tokens, and those that are late. */
void token_answers_send(struct page *page, uint64_t version, uint64_t now_ns);
void token_answers_drop(struct page *page);
