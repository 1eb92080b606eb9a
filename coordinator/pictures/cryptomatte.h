/* cryptomatte: ids and metadata of Cryptomatte 1.2.0, by which compositors pick things by name
 * (github.com/Psyop/Cryptomatte, the specification).
 *
 * A layer has a table of its things' names; a thing's id is a hash of its name, so things of one name are one. What has no
 * name is called "object 12", by its number. Pure functions of the names.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

enum {
    CRYPTOMATTE_RANKS = 6,
    CRYPTOMATTE_CHANNELS = 2 * CRYPTOMATTE_RANKS, /* three layers of RGBA: id, share, id, share */
    CRYPTOMATTE_MANIFEST_MAX = 1 << 20,           /* bytes; names beyond that are not listed */
    CRYPTOMATTE_NAME_SIZE = 32,                   /* of an attribute's name */
};

/* MurmurHash3_x86_32 with seed 0. */
uint32_t cryptomatte_hash(const char *text);
/* The same, made the bits of a float that is a normal number. */
uint32_t cryptomatte_id(const char *name);

/* The things of one layer. */
struct cryptomatte {
    uint32_t *ids; /* [count], by number - 1 */
    uint32_t count;
    const char *kind;       /* "object": for what has no name */
    struct buffer manifest; /* JSON: {"name":"8 hexadecimal digits",...} */
};

/* `names` gives the name of thing 0 to count - 1, which may be empty. */
status cryptomatte_init(struct cryptomatte *matte, const char *kind, uint32_t count,
                        const char *(*names)(const void *user, uint32_t thing), const void *user,
                        struct error *err) MUST_CHECK;
void cryptomatte_release(struct cryptomatte *matte);
/* What a pixel shows, by falling share, ties by id; what has no rank is left out. Unused ones are 0. */
void cryptomatte_rank(const struct cryptomatte *matte, const struct film_thing *things, uint32_t count,
                      float out[CRYPTOMATTE_CHANNELS]);

/* The attribute "cryptomatte/KEY/FIELD" of the layers `type`. */
void cryptomatte_attribute(char out[CRYPTOMATTE_NAME_SIZE], const char *type, const char *field);
