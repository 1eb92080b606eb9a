/* token_end: what ends with a token, and that a token is used. */
#ifndef AZULEJO_COORDINATOR_TOKEN_END_H
#define AZULEJO_COORDINATOR_TOKEN_END_H

#include <stddef.h>
#include <stdint.h>

struct web;

enum { TOKEN_ENDS_MAX = 64 };

/* Tokens whose connections are to end. Zeroed. */
struct token_ends {
    uint64_t ticked_ns;
    struct {
        uint64_t token;
        int cookies;
    } ended[TOKEN_ENDS_MAX];
    size_t ended_count;
};

/* A token has ended (web_token_ended): what was begun with it ends at the next tick, not now: its own request may be
 * the one that ends it. New requests are refused already. */
void token_end(struct web *web, uint64_t token, int cookies);

/* What was begun with tokens that have ended ends; once a second tokens expire, and the store learns which were used.
 * At each tick of the server. */
void token_end_tick(struct web *web, uint64_t now_ns);

#endif
