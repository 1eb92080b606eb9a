/* callers: who asks, by the tokens that the coordinator has sent (PageTokens).
 *
 * A browser signs in with a token and gets a cookie, which is not the token: "NUMBER.EXPIRES.MAC". The MAC is
 * HMAC-SHA256 under a key that follows from the coordinator's own token over number, end and the token's hash. So a cookie
 * - survives a restart, without a list of sessions that could grow or be lost;
 * - ends with its token, with the renewal of the coordinator's own one (which signs everybody out), and by itself
 *   after COOKIE_LIFE_S: cookies do not know ports, so another service of the same host gets to see it;
 * - does not work as a token, and cannot be made from what the store keeps.
 *
 * What the coordinator sends replaces all that was known. Until it has come no caller is known.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/token.h"
#include "web/api/request.h"
#include "web/base/token_failures.h"

enum {
    CALLER_TOLD_S = 600,            /* it is reported to the coordinator at most so often that a token is used */
    COOKIE_LIFE_S = 14 * 86400,
    COOKIE_SIZE = 20 + 1 + 20 + 1 + 64 + 1,
};

/* A token. */
struct caller_row {
    uint64_t number;
    enum web_role role;
    char name[WEB_TOKEN_NAME_MAX + 1], owner[WEB_WHO_MAX + 1];
    struct digest hash;
    int64_t expires_at, told_at; /* told_at: the coordinator learned that it is used */
    int is_over;                 /* its end was reported */
};

/* Zeroed. */
struct callers {
    struct caller_row *rows;
    size_t count, capacity;
    struct digest cookie_key;
    int is_known; /* the coordinator has sent them */
    struct token_failures failures;
    uint64_t failure_count;
};

/* What ends with a token that is no more what it was; `cookies`: so does what any cookie opened. */
typedef void caller_ended(void *user, uint64_t token, int cookies);

/* ERR_PROTOCOL, ERR_NO_MEMORY: what was known stays. */
status callers_set(struct callers *callers, const Azulejo__Wire__PageTokens *message, caller_ended *ended, void *user,
                   struct error *err) MUST_CHECK;
/* Tokens that have expired by now end. Once a second is enough. */
void callers_tick(struct callers *callers, int64_t now_s, caller_ended *ended, void *user);
void callers_release(struct callers *callers);

/* 1, and *out: a token that is valid at now_s (seconds since 1970). 0, and *out has role NONE. */
int callers_find(struct callers *callers, const char *text, int64_t now_s, struct web_caller *out);
/* The same of a cookie. */
int callers_find_cookie(struct callers *callers, const char *cookie, int64_t now_s, struct web_caller *out);
/* The cookie of a token; *life_s: how long it is good for. "": there is no such token. */
void callers_cookie(const struct callers *callers, uint64_t token, int64_t now_s, char out[COOKIE_SIZE],
                    int64_t *life_s);
/* Must its use be reported to the coordinator now? Once. */
int callers_must_tell(struct callers *callers, uint64_t token, int64_t now_s);
const char *callers_name(const struct callers *callers, uint64_t token); /* "": there is none */
/* Note that this address ("10.0.0.7:512") sent a wrong token. 0: it did too often. A valid token is never
 * refused for that: tokens cannot be guessed, and no caller may lock out others who share an address. */
int callers_note_failure(struct callers *callers, const char *peer, uint64_t now_ns);
