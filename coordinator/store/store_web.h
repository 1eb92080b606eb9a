/* store_web: what the page and its API keep in the store, tokens, of which it has the SHA-256 only; and the events that
 * wait for the program of --on-event.
 *
 * What people change of tokens is stored soon (store_when_saved); the other functions are on disk when they return, where
 * nothing else is said. ERR_IO, ERR_NO_MEMORY: nothing changed.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "coordinator/job/queue.h"

struct store;

enum {
    TOKEN_NAME_MAX = 63,         /* bytes */
    TOKEN_FIRST = 2,             /* the first number of a stored token: 1 is the coordinator's own (tokens.h) */
};

struct token_row {
    uint64_t number; /* never reused */
    char name[TOKEN_NAME_MAX + 1];
    uint32_t role;               /* enum web_role */
    char owner[JOB_WHO_MAX + 1]; /* of the jobs submitted with it: user@host */
    char made_by[JOB_WHO_MAX + 1];
    struct digest hash;                   /* of its text */
    int64_t made_at, used_at, expires_at; /* seconds since 1970, UTC; 0: not used, never */
};

/* Gives the row its number. */
status store_token_add(struct store *store, struct token_row *row, struct error *err) MUST_CHECK;
/* The token gets another text. */
status store_token_renew(struct store *store, uint64_t number, const struct digest *hash, int64_t made_at,
                         struct error *err) MUST_CHECK;
status store_token_remove(struct store *store, uint64_t number, struct error *err) MUST_CHECK;
/* [any thread] */
status store_token_used(struct store *store, uint64_t number, int64_t at, struct error *err) MUST_CHECK;
status store_tokens_load(struct store *store,
                         status (*visit)(void *user, const struct token_row *row, struct error *err), void *user,
                         struct error *err) MUST_CHECK;

/* An event that waits for the program of --on-event; the caller numbers them, ascending. Both are noted: on disk soon.
 * [any thread] */
status store_waiting_event_add(struct store *store, uint64_t id, int64_t at, const char *json, struct error *err) MUST_CHECK;
status store_waiting_event_remove(struct store *store, uint64_t id, struct error *err) MUST_CHECK;
/* Ascending id. */
status store_waiting_events_load(struct store *store,
                                 status (*visit)(void *user, uint64_t id, const char *json, struct error *err),
                                 void *user, struct error *err) MUST_CHECK;
