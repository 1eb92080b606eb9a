#include "coordinator/pictures/cryptomatte.h"

#include <stdio.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/base/json_quote.h"
#include "common/base/memory.h"
#include "common/scene/scene.h"

enum {
    THING_NAME_SIZE = SCENE_NAME_MAX + 1,
    ENTRY_BYTES_MIN = sizeof "\"\":\"00000000\"," - 1,
    LISTED_SLOTS = 1 << 18, /* a power of 2, well above what a manifest can list */
};
_Static_assert(CRYPTOMATTE_MANIFEST_MAX / ENTRY_BYTES_MIN < LISTED_SLOTS / 2, "the table of listed names has room");

/* ---- ids ------------------------------------------------------------------------------------ */

static uint32_t rotate(uint32_t x, int by) { return x << by | x >> (32 - by); }

static uint32_t mix(uint32_t block) { return rotate(block * 0xcc9e2d51u, 15) * 0x1b873593u; }

uint32_t cryptomatte_hash(const char *text)
{
    const size_t length = strlen(text);
    uint32_t hash = 0, rest = 0;
    size_t at = 0;

    for (; at + 4 <= length; at += 4)
        hash = rotate(hash ^ mix(bytes_get32((const uint8_t *)text + at)), 13) * 5 + 0xe6546b64u;
    for (size_t i = length; i > at; i--)
        rest = rest << 8 | (uint8_t)text[i - 1];
    hash ^= mix(rest) ^ (uint32_t)length;
    hash = (hash ^ hash >> 16) * 0x85ebca6bu;
    hash = (hash ^ hash >> 13) * 0xc2b2ae35u;
    return hash ^ hash >> 16;
}

uint32_t cryptomatte_id(const char *name)
{
    const uint32_t hash = cryptomatte_hash(name), exponent = hash >> 23 & 255;

    return exponent == 0 || exponent == 255 ? hash ^ 1u << 23 : hash;
}

static const char *name_or_number(const char *kind, uint32_t number, const char *name, char out[THING_NAME_SIZE])
{
    if (*name)
        return name;
    snprintf(out, THING_NAME_SIZE, "%s %u", kind, number);
    return out;
}

/* ---- the manifest --------------------------------------------------------------------------- */

/* Which names are listed: for each its id, by which it is found; 0: an empty slot (no id is 0). Of names with one id, which
 * a pixel cannot tell apart, the first is listed. */
static int list_once(uint32_t *listed, uint32_t id)
{
    uint32_t slot = id;

    for (;; slot++) {
        uint32_t *at = &listed[slot % LISTED_SLOTS];
        if (*at == id)
            return 0;
        if (*at == 0) {
            *at = id;
            return 1;
        }
    }
}

static void add_entry(struct buffer *manifest, const char *name, uint32_t id)
{
    char entry[JSON_QUOTE_SIZE(SCENE_NAME_MAX) + ENTRY_BYTES_MIN + 1];
    size_t size = 0;

    if (manifest->size > 1)
        entry[size++] = ',';
    size += json_quote(entry + size, name, SCENE_NAME_MAX);
    size += (size_t)snprintf(entry + size, sizeof entry - size, ":\"%08x\"", id);
    if (manifest->size + size + 1 <= CRYPTOMATTE_MANIFEST_MAX)
        buffer_append(manifest, entry, size);
}

status cryptomatte_init(struct cryptomatte *matte, const char *kind, uint32_t count,
                        const char *(*names)(const void *user, uint32_t thing), const void *user, struct error *err)
{
    uint32_t *listed = mem_calloc(LISTED_SLOTS, sizeof *listed);
    char fallback[THING_NAME_SIZE];

    *matte = (struct cryptomatte){.ids = mem_calloc(count ? count : 1, sizeof *matte->ids), .count = count, .kind = kind,
                                  .manifest = BUFFER_INIT};
    buffer_append(&matte->manifest, "{", 1);
    for (uint32_t i = 0; i < count && matte->ids && listed; i++) {
        const char *name = name_or_number(kind, i + 1, names(user, i), fallback);
        matte->ids[i] = cryptomatte_id(name);
        if (matte->manifest.size + ENTRY_BYTES_MIN + 1 < CRYPTOMATTE_MANIFEST_MAX && list_once(listed, matte->ids[i]))
            add_entry(&matte->manifest, name, matte->ids[i]);
    }
    buffer_append(&matte->manifest, "}", 1);
    if (matte->ids && listed && buffer_ok(&matte->manifest)) {
        mem_free(listed);
        return STATUS_OK;
    }
    mem_free(listed);
    cryptomatte_release(matte);
    return error_no_memory(err, "the names of what a picture shows");
}

void cryptomatte_release(struct cryptomatte *matte)
{
    mem_free(matte->ids);
    buffer_release(&matte->manifest);
    *matte = (struct cryptomatte){.manifest = BUFFER_INIT};
}

void cryptomatte_attribute(char out[CRYPTOMATTE_NAME_SIZE], const char *type, const char *field)
{
    /* The specification's key: as long as old readers of EXR allow. */
    snprintf(out, CRYPTOMATTE_NAME_SIZE, "cryptomatte/%07x/%s", cryptomatte_id(type) >> 4, field);
}

/* ---- ranks ---------------------------------------------------------------------------------- */

static uint32_t id_of(const struct cryptomatte *matte, uint32_t number)
{
    char name[THING_NAME_SIZE];

    if (number <= matte->count)
        return matte->ids[number - 1];
    return cryptomatte_id(name_or_number(matte->kind, number, "", name)); /* the scene could not be read */
}

struct rank {
    uint32_t id;
    double share;
};

void cryptomatte_rank(const struct cryptomatte *matte, const struct film_thing *things, uint32_t count,
                      float out[CRYPTOMATTE_CHANNELS])
{
    struct rank ranks[FILM_THINGS_MAX];
    uint32_t used = 0;

    for (uint32_t i = 0; i < count; i++) {
        const uint32_t id = id_of(matte, things[i].number);
        uint32_t at = 0;
        while (at < used && ranks[at].id != id)
            at++;
        if (at == used)
            ranks[used++] = (struct rank){id, 0};
        ranks[at].share += things[i].share;
    }
    for (uint32_t i = 1; i < used; i++) {
        const struct rank one = ranks[i];
        uint32_t at = i;
        for (; at > 0 &&
               (ranks[at - 1].share < one.share || (ranks[at - 1].share == one.share && ranks[at - 1].id > one.id));
             at--)
            ranks[at] = ranks[at - 1];
        ranks[at] = one;
    }
    memset(out, 0, CRYPTOMATTE_CHANNELS * sizeof *out);
    for (uint32_t i = 0; i < used && i < CRYPTOMATTE_RANKS; i++) {
        memcpy(&out[2 * i], &ranks[i].id, sizeof ranks[i].id);
        out[2 * i + 1] = (float)ranks[i].share;
    }
}
