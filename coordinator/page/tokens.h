/* tokens: who may do what with the page and its API.
 *
 *   made (its text is shown once) --used--> used --revoked, renewed or expired--> gone, with all that it opened
 *
 * A token is 256 random bits. The store keeps its SHA-256, so who reads the store cannot use it. Number
 * TOKEN_OWN is the coordinator's own, of role admin: its text is in STORE/web.token (0600) and in the page's
 * address that is printed at the start. It can be renewed, not revoked.
 *
 * The page's program gets the hashes and a key that signs browsers' cookies (web/base/callers.h), and no text.
 *
 * Nothing here waits for a disk but web_token_own_write. What is made, renewed or revoked counts at once, and is stored
 * soon: its answer waits for that.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store_web.h"
#include "common/schema/token_roles.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/token.h"

enum {
    TOKEN_OWN = 1,
    TOKENS_MAX = 1000,
    TOKEN_USED_S = 3600,            /* the store learns at most so often that a token is used */
};

struct web_tokens;

/* What a token opened must end: it was revoked, renewed, or has expired. `cookies`: so must what any cookie opened. */
typedef void web_token_ended(void *user, uint64_t token, int cookies);

/* Reads the store's tokens and STORE/web.token, which is made if it is missing. ERR_CORRUPT: that file does
 * not hold a token; ERR_IO, ERR_NO_MEMORY. */
status web_tokens_open(struct web_tokens **out, struct store *store, web_token_ended *ended, void *user,
                       struct error *err) MUST_CHECK;
void web_tokens_close(struct web_tokens *tokens); /* NULL is fine */
/* The text of the coordinator's own token. */
const char *web_tokens_own(const struct web_tokens *tokens);

/* What the page's program needs to know who asks, while `use` runs. ERR_NO_MEMORY, ERR_INTERNAL. */
typedef void web_tokens_use(void *user, Azulejo__Wire__PageTokens *message);
status web_tokens_tell(const struct web_tokens *tokens, uint64_t version, web_tokens_use *use, void *user,
                       struct error *err) MUST_CHECK;
/* It was used. */
void web_tokens_used(struct web_tokens *tokens, uint64_t token, int64_t now_s);
int web_token_is_valid(const struct web_tokens *tokens, uint64_t token, int64_t now_s);

/* Give the row number, hash and time. `secret` is the token. ERR_LIMIT, ERR_INPUT (name, owner, role, end),
 * ERR_IO, ERR_NO_MEMORY. */
status web_token_create(struct web_tokens *tokens, struct token_row *row, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                        struct error *err) MUST_CHECK;
/* ERR_NOT_FOUND; ERR_REFUSED: the coordinator's own. */
status web_token_revoke(struct web_tokens *tokens, uint64_t token, struct error *err) MUST_CHECK;
/* Of any but the coordinator's own. ERR_NOT_FOUND; ERR_REFUSED: it has expired; ERR_IO, ERR_NO_MEMORY. */
status web_token_renew(struct web_tokens *tokens, uint64_t token, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                       struct error *err) MUST_CHECK;

/* The coordinator's own: write `secret` to its file [any thread]; when that is done it counts. ERR_IO, ERR_NO_MEMORY. */
status web_token_own_write(const struct web_tokens *tokens, const char *secret, struct error *err) MUST_CHECK;
status web_token_own_renewed(struct web_tokens *tokens, const char *secret, int64_t now_s, struct error *err) MUST_CHECK;

/* The rows in ascending order, the coordinator's own first. */
const struct token_row *web_tokens_rows(const struct web_tokens *tokens, size_t *count);
const struct token_row *web_token_row(const struct web_tokens *tokens, uint64_t token); /* NULL: none */
/* Tokens that have expired by now end. Once a second is enough. */
void web_tokens_tick(struct web_tokens *tokens, int64_t now_s);
/* A token whose use the store should learn of (store_token_used), once; NULL: none. */
const struct token_row *web_tokens_next_used(struct web_tokens *tokens);
