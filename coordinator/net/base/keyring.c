#include "coordinator/net/base/keyring.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

/* ---- rows ------------------------------------------------------------------------------------- */

static struct key_row *find(const struct keyring *ring, const char *name)
{
    for (size_t i = 0; i < ring->count; i++)
        if (strcmp(ring->rows[i].name, name) == 0)
            return &ring->rows[i];
    return NULL;
}

static status add(struct keyring *ring, const struct key_row *row, struct error *err)
{
    if (ring->count >= KEYRING_NAMES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "keys of %d names are known already", KEYRING_NAMES_MAX);
    if (!MEM_GROW(ring->rows, ring->capacity, ring->count + 1))
        return error_no_memory(err, "the keys of a name");
    ring->rows[ring->count++] = *row;
    return STATUS_OK;
}

/* A name of which nothing is known yet. */
static struct key_row unknown(const char *name)
{
    struct key_row row = {.oldest = 1, .generation = 1};

    snprintf(row.name, sizeof row.name, "%s", name);
    return row;
}

static status take_row(void *user, const struct key_row *row, struct error *err)
{
    if (!key_name_is_valid(row->name) || row->oldest < 1 || row->oldest > row->generation ||
        row->generation > KEY_GENERATION_MAX)
        return error_set(err, STATUS_ERR_CORRUPT, "the keys of a name in the store are damaged");
    return add(user, row, err);
}

status keyring_open(struct keyring *ring, struct store *store, struct error *err)
{
    return store_keys_load(store, take_row, ring, &ring->damaged, err);
}

void keyring_release(struct keyring *ring)
{
    mem_free(ring->rows);
    ring->rows = NULL;
    ring->count = ring->capacity = 0;
}

/* ---- what is good ------------------------------------------------------------------------------ */

status keyring_check(const struct keyring *ring, const struct key_identity *id, int64_t now_s, struct error *err)
{
    const struct key_row *known = id->name[0] ? find(ring, id->name) : NULL;
    const struct key_row row = known ? *known : unknown(id->name);
    char words[KEY_WORDS_SIZE];

    (void)key_identity_words(id, words);
    if (!id->name[0]) {
        if (!ring->no_shared || id->role == FARM_ROLE_WEB)
            return STATUS_OK;
        return error_set(err, STATUS_ERR_REFUSED,
                         "the %s is everybody's, and this farm takes keys of names only: ask for one of your own ('azulejo key "
                         "new NAME' makes it)", words);
    }
    if (!known && ring->damaged > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "the %s is not known to the coordinator, which cannot read all that was revoked: 'azulejo-coordinator "
                         "--check --repair' mends its store", words);
    if (id->generation == row.generation ||
        (id->generation >= row.oldest && id->generation < row.generation && now_s < row.oldest_until))
        return STATUS_OK;
    if (id->generation > row.generation)
        return error_set(err, STATUS_ERR_REFUSED,
                         "the %s is not good yet: 'azulejo key rotate %s' begins its generation", words, id->name);
    return error_set(err, STATUS_ERR_REFUSED, "the %s was %s: generation %u is good now ('azulejo key new' makes it)",
                     words, id->generation < row.oldest ? "revoked" : "replaced", row.generation);
}

static uint32_t role_bit(const struct key_identity *id) { return 1u << id->may; }

int keyring_is_worker(const struct keyring *ring, const char *name)
{
    const struct key_row *row = find(ring, name);

    return row && row->roles & 1u << WEB_ROLE_NONE;
}

const struct key_row *keyring_used(struct keyring *ring, const struct key_identity *id, int64_t now_s)
{
    struct key_row *row = find(ring, id->name), made;
    int revives;

    if (!id->name[0])
        return NULL;
    if (!row) {
        made = unknown(id->name);
        if (add(ring, &made, NULL) != STATUS_OK)
            return NULL; /* it is good all the same */
        row = &ring->rows[ring->count - 1];
    }
    revives = row->revoked && id->generation == row->generation;
    if (!revives && row->roles & role_bit(id) && now_s - row->used_at < KEYRING_USED_S && now_s >= row->used_at)
        return NULL;
    row->roles |= role_bit(id);
    row->revoked = row->revoked && !revives;
    row->used_at = now_s;
    row->changes++;
    return row;
}

int keyring_ends(const struct keyring *ring, int64_t from_s, int64_t to_s)
{
    for (size_t i = 0; i < ring->count; i++)
        if (ring->rows[i].oldest_until > from_s && ring->rows[i].oldest_until <= to_s)
            return 1;
    return 0;
}

/* ---- changes ----------------------------------------------------------------------------------- */

/* The row of a name whose generation is to grow. */
static status begin_change(struct keyring *ring, const char *name, const char *who, int64_t now_s, struct key_row **out,
                           struct error *err)
{
    struct key_row made;

    if (!key_name_is_valid(name))
        return error_set(err, STATUS_ERR_INPUT, "a key's name has 1 to %d letters, digits, '.', '_', '-' and '@'",
                         KEY_NAME_MAX);
    *out = find(ring, name);
    if (*out && (*out)->generation >= KEY_GENERATION_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s has had %d generations of keys: choose another name", name,
                         KEY_GENERATION_MAX);
    if (!*out) {
        made = unknown(name);
        TRY(add(ring, &made, err));
        *out = &ring->rows[ring->count - 1];
    }
    (*out)->changes++;
    (*out)->changed_at = now_s;
    snprintf((*out)->changed_by, sizeof(*out)->changed_by, "%s", who);
    return STATUS_OK;
}

status keyring_revoke(struct keyring *ring, const char *name, const char *who, int64_t now_s, struct key_row *out,
                      struct error *err)
{
    struct key_row *row;

    TRY(begin_change(ring, name, who, now_s, &row, err));
    row->oldest = ++row->generation;
    row->oldest_until = 0;
    row->revoked = 1;
    *out = *row;
    return STATUS_OK;
}

status keyring_rotate(struct keyring *ring, const char *name, uint32_t keep_s, const char *who, int64_t now_s,
                      struct key_row *out, struct error *err)
{
    struct key_row *row;

    if (keep_s > KEYRING_KEEP_MAX_S)
        return error_set(err, STATUS_ERR_INPUT, "a replaced key stays good for at most %d days", KEYRING_KEEP_MAX_S / 86400);
    TRY(begin_change(ring, name, who, now_s, &row, err));
    row->oldest = row->generation++;
    row->oldest_until = now_s + keep_s;
    *out = *row;
    return STATUS_OK;
}
