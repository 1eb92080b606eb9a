/* keyring: which keys of names are good.
 *
 * A key of a name follows from the farm's key (protocol/key.h), so it needs no enrolment: a name that was never changed has one
 * good generation, 1. What is kept, here and in the store, is what a person changed:
 *
 *   good: 1 --rotate--> 2 is good, and 1 for a while --rotate--> 3, and 2 for a while
 *   any --revoke--> the next generation alone is good: every key that was made before is not
 *
 * and, for people, which names were used. A name without a key in use costs nothing: only who holds a key can be
 * noted. If a row of the store is damaged, it may be one of a name that was revoked: then no name is good that is not known.
 *
 * Nothing here waits for the disk: who changes a row has it written (store_key_put). */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store_keys.h"
#include "protocol/key_identity.h"

enum {
    KEYRING_NAMES_MAX = 20000,
    KEYRING_USED_S = 3600,       /* the store learns at most so often that a name's key is used */
    KEYRING_KEEP_MAX_S = 366 * 86400,
};

struct keyring {
    struct key_row *rows;
    size_t count, capacity;
    uint32_t damaged; /* rows of the store */
    int no_shared;    /* keys that all of a role share are refused, but the page's */
};

status keyring_open(struct keyring *ring, struct store *store, struct error *err) MUST_CHECK;
void keyring_release(struct keyring *ring);

/* May a connection have that key now? ERR_REFUSED says why not, and what to do. */
status keyring_check(const struct keyring *ring, const struct key_identity *id, int64_t now_s,
                     struct error *err) MUST_CHECK;
/* Has a worker used a key of that name? */
int keyring_is_worker(const struct keyring *ring, const char *name);
/* It is used. The row that is to be written, which the next call may move; NULL: nothing is. */
const struct key_row *keyring_used(struct keyring *ring, const struct key_identity *id, int64_t now_s);

/* All keys of the name that there are; begin its next generation, and keep the present one good for keep_s. *out is the
 * row that is to be written. ERR_INPUT: no name; ERR_LIMIT, ERR_NO_MEMORY. */
status keyring_revoke(struct keyring *ring, const char *name, const char *who, int64_t now_s, struct key_row *out,
                      struct error *err) MUST_CHECK;
status keyring_rotate(struct keyring *ring, const char *name, uint32_t keep_s, const char *who, int64_t now_s,
                      struct key_row *out, struct error *err) MUST_CHECK;

/* Has the time of an older generation run out between the two moments? Then connections are to be checked again. */
int keyring_ends(const struct keyring *ring, int64_t from_s, int64_t to_s);
