/* token_messages: what clients and the API ask about tokens. A client's key may do all of it: it may do everything
 * else, too. Of tokens only an admin's may (routes.c). */
#ifndef AZULEJO_COORDINATOR_TOKEN_MESSAGES_H
#define AZULEJO_COORDINATOR_TOKEN_MESSAGES_H

#include "coordinator/net/session_messages.h"
#include "coordinator/web/tokens.h"

/* Answer the message, which is one about tokens. */
status token_message(struct web_tokens *tokens, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err) MUST_CHECK;

#endif
