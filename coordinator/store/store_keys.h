/* store_keys: the keys of names, as far as the coordinator knows of changes to them or saw them used. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/job/queue.h"
#include "protocol/key_identity.h"

struct store;

struct key_row {
    char name[KEY_NAME_MAX + 1];
    uint32_t oldest, generation; /* the good ones are `generation`, and those from `oldest` on until oldest_until */
    int64_t oldest_until;        /* seconds since 1970, UTC */
    uint32_t roles;              /* that were used: bits of enum web_role, bit 0 that of workers */
    int revoked;                 /* and no newer key was used yet */
    int64_t used_at, changed_at; /* seconds since 1970, UTC; 0: never */
    char changed_by[JOB_WHO_MAX + 1];
    uint64_t changes; /* of this row: an older one does not replace a newer one */
};

/* Write the row, on disk when it returns. ERR_IO, ERR_NO_MEMORY. [any thread] */
status store_key_put(struct store *store, const struct key_row *row, struct error *err) MUST_CHECK;
/* By name. *damaged: so many rows are not what was written, or are lost: they are not visited. */
status store_keys_load(struct store *store, status (*visit)(void *user, const struct key_row *row, struct error *err),
                       void *user, uint32_t *damaged, struct error *err) MUST_CHECK;
