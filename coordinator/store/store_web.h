/* store_web: what the page and its API keep in the store: tokens, webhooks, and what webhooks have not been
 * sent yet; and the events that wait for the program of --on-event. A token is stored as its SHA-256 only; a webhook's secret signs, so it is stored as it is.
 *
 * What people change of tokens and webhooks is stored soon (store_when_saved); the other functions are on disk when they
 * return. ERR_IO, ERR_NO_MEMORY: nothing changed.
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
    WEBHOOK_URL_MAX = 1000,
    WEBHOOK_SECRET_BYTES = 32,
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

struct webhook_row {
    uint64_t number; /* never reused */
    char url[WEBHOOK_URL_MAX + 1];
    uint8_t secret[WEBHOOK_SECRET_BYTES];
    char made_by[JOB_WHO_MAX + 1];
    int64_t made_at; /* seconds since 1970, UTC */
};

/* Gives the row its number. */
status store_webhook_add(struct store *store, struct webhook_row *row, struct error *err) MUST_CHECK;
/* With what it was not sent yet. */
status store_webhook_remove(struct store *store, uint64_t number, struct error *err) MUST_CHECK;
status store_webhooks_load(struct store *store,
                           status (*visit)(void *user, const struct webhook_row *row, struct error *err), void *user,
                           struct error *err) MUST_CHECK;

/* What a webhook is to be sent. `id` is never reused; the receiver knows by it what it got twice. */
struct webhook_event {
    uint64_t id, webhook;
    int64_t at; /* seconds since 1970, UTC */
    const char *body;
};
/* Gives the event its id. ERR_NOT_FOUND: the webhook is gone. [any thread] */
status store_webhook_event_add(struct store *store, struct webhook_event *event, struct error *err) MUST_CHECK;
/* [any thread] */
status store_webhook_event_remove(struct store *store, uint64_t id, struct error *err) MUST_CHECK;
/* Ascending id. */
status store_webhook_events_load(struct store *store,
                                 status (*visit)(void *user, const struct webhook_event *event, struct error *err),
                                 void *user, struct error *err) MUST_CHECK;

/* An event that waits for the program of --on-event; the caller numbers them, ascending. Both are noted: on disk soon.
 * [any thread] */
status store_waiting_event_add(struct store *store, uint64_t id, int64_t at, const char *json, struct error *err) MUST_CHECK;
status store_waiting_event_remove(struct store *store, uint64_t id, struct error *err) MUST_CHECK;
/* Ascending id. */
status store_waiting_events_load(struct store *store,
                                 status (*visit)(void *user, uint64_t id, const char *json, struct error *err),
                                 void *user, struct error *err) MUST_CHECK;
