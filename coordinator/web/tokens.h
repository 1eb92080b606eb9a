/* tokens: who may do what with the page and its API.
 *
 *   made (its text is shown once) --used--> used --revoked, renewed or expired--> gone, with all that it opened
 *
 * A token is 256 random bits. The store keeps its SHA-256, so who reads the store cannot use it. Number
 * TOKEN_OWN is the coordinator's own, of role admin: its text is in STORE/web.token (0600) and in the page's
 * address that is printed at the start. It can be renewed, not revoked.
 *
 * A browser signs in with a token and gets a cookie, which is not the token: "NUMBER.EXPIRES.MAC". The MAC is
 * HMAC-SHA256 under the coordinator's own token over number, end and the token's hash. So a cookie
 * - survives a restart, without a list of sessions that could grow or be lost;
 * - ends with its token, with the renewal of the coordinator's own one (which signs everybody out), and by itself
 *   after COOKIE_LIFE_S: cookies do not know ports, so another service of the same host gets to see it;
 * - does not work as a token, and cannot be made from what the store keeps.
 *
 * Nothing here blocks but making, renewing and revoking, which wait for the disk as people's other verbs do.
 */
#ifndef AZULEJO_COORDINATOR_TOKENS_H
#define AZULEJO_COORDINATOR_TOKENS_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store_web.h"
#include "coordinator/web/request.h"

enum {
    TOKEN_OWN = 1,
    TOKENS_MAX = 1000,
    TOKEN_TEXT_SIZE = 4 + 64 + 1,   /* "azt_" and 64 hexadecimal digits */
    TOKEN_USED_S = 3600,            /* the store learns at most so often that a token is used */
    COOKIE_LIFE_S = 14 * 86400,
    COOKIE_SIZE = 20 + 1 + 20 + 1 + 64 + 1,
};

struct web_tokens;

/* What a token opened must end: it was revoked, renewed, or has expired. `cookies`: so must what any cookie
 * opened. */
typedef void web_token_ended(void *user, uint64_t token, int cookies);

/* Reads the store's tokens and STORE/web.token, which is made if it is missing. ERR_CORRUPT: that file does
 * not hold a token; ERR_IO, ERR_NO_MEMORY. */
status web_tokens_open(struct web_tokens **out, struct store *store, web_token_ended *ended, void *user,
                       struct error *err) MUST_CHECK;
void web_tokens_close(struct web_tokens *tokens); /* NULL is fine */
/* The text of the coordinator's own token. */
const char *web_tokens_own(const struct web_tokens *tokens);

/* 1, and *out: a token that is valid at now_s (seconds since 1970). 0, and *out has role NONE. */
int web_tokens_find(struct web_tokens *tokens, const char *text, int64_t now_s, struct web_caller *out);
/* The same of a cookie. */
int web_tokens_find_cookie(struct web_tokens *tokens, const char *cookie, int64_t now_s, struct web_caller *out);
/* The cookie of a token; *life_s: how long it is good for. "": there is no such token. */
void web_tokens_cookie(const struct web_tokens *tokens, uint64_t token, int64_t now_s, char out[COOKIE_SIZE],
                       int64_t *life_s);
/* Note that this address ("10.0.0.7:512") sent a wrong token. 0: it did too often. A valid token is never
 * refused for that: tokens cannot be guessed, and nobody may lock out others who share an address. */
int web_tokens_note_failure(struct web_tokens *tokens, const char *peer, uint64_t now_ns);

uint64_t web_tokens_failures(const struct web_tokens *tokens); /* wrong ones, since the start */

/* Give the row number, hash and time. `secret` is the token. ERR_LIMIT, ERR_INPUT (name, owner, role, end),
 * ERR_IO, ERR_NO_MEMORY. */
status web_token_create(struct web_tokens *tokens, struct token_row *row, int64_t now_s,
                        char secret[TOKEN_TEXT_SIZE], struct error *err) MUST_CHECK;
/* ERR_NOT_FOUND; ERR_REFUSED: the coordinator's own. */
status web_token_revoke(struct web_tokens *tokens, uint64_t token, struct error *err) MUST_CHECK;
/* ERR_NOT_FOUND; ERR_REFUSED: it has expired; ERR_IO, ERR_NO_MEMORY. */
status web_token_renew(struct web_tokens *tokens, uint64_t token, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                       struct error *err) MUST_CHECK;

/* The rows in ascending order, the coordinator's own first. */
const struct token_row *web_tokens_rows(const struct web_tokens *tokens, size_t *count);
const struct token_row *web_token_row(const struct web_tokens *tokens, uint64_t token); /* NULL: none */
/* Tokens that have expired by now end. Once a second is enough. */
void web_tokens_tick(struct web_tokens *tokens, int64_t now_s);
/* A token whose use the store should learn of (store_token_used), once; NULL: none. */
const struct token_row *web_tokens_next_used(struct web_tokens *tokens);

const char *web_role_name(enum web_role role); /* "view"; "none" */

#endif
