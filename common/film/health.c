#include "common/film/health.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/film/tiles.h"

#define HEALTH_ROW(NAME, name_, attribute_, limit_, one_, many_, remedy_)                          \
    {.name = #name_, .attribute = attribute_, .attribute_first = attribute_ "First", .one = one_, \
     .many = many_, .remedy = remedy_, .limit = HEALTH_LIMIT_##limit_},
const struct health_row health_rows[HEALTH_KINDS] = {HEALTH_MAP(HEALTH_ROW)};

_Static_assert(PASSES_MAX < 1 << HEALTH_PASS_BITS, "a key holds every pass");
_Static_assert(TILE_PIXELS_MAX <= 1 << HEALTH_PIXEL_BITS, "a key holds every pixel of a tile");
_Static_assert(SETTINGS_SPP_MAX <= 1 << HEALTH_SAMPLE_BITS, "a key holds every sample");
/* Tiles at the rims are smaller than TILE_PIXELS_MAX: at most one more along each side. */
_Static_assert(SETTINGS_PIXELS_MAX / TILE_PIXELS_MAX + 2 * SETTINGS_SIZE_MAX / TILE_SIZE + 1 <= 1 << HEALTH_TILE_BITS,
               "a key holds every tile");

uint64_t health_key(struct health_place p)
{
    uint64_t key = p.pass;

    key = key << HEALTH_TILE_BITS | p.tile;
    key = key << HEALTH_PIXEL_BITS | p.pixel;
    return (key << HEALTH_SAMPLE_BITS | p.sample) + 1;
}

static uint32_t key_take(uint64_t *key, int bits)
{
    uint32_t part = (uint32_t)(*key & ((1u << bits) - 1));

    *key >>= bits;
    return part;
}

int health_place_of(uint64_t key, struct health_place *out)
{
    if (key-- == 0)
        return 0;
    out->sample = key_take(&key, HEALTH_SAMPLE_BITS);
    out->pixel = key_take(&key, HEALTH_PIXEL_BITS);
    out->tile = key_take(&key, HEALTH_TILE_BITS);
    out->pass = (uint32_t)key;
    return key < PASSES_MAX;
}

void health_example(struct health *health, enum health_kind kind, uint32_t frame, uint64_t key)
{
    uint64_t have = health->first[kind];

    if (key == 0 || (have != 0 && (frame > health->frame[kind] || (frame == health->frame[kind] && key >= have))))
        return;
    health->first[kind] = key;
    health->frame[kind] = frame;
}

void health_add(struct health *sum, const struct health *more)
{
    for (int k = 0; k < HEALTH_KINDS; k++) {
        sum->count[k] += more->count[k];
        health_example(sum, (enum health_kind)k, more->frame[k], more->first[k]);
    }
}

void health_subtract(struct health *sum, const struct health *less)
{
    for (int k = 0; k < HEALTH_KINDS; k++)
        sum->count[k] -= less->count[k];
}

void health_of_frame(struct health *health, uint32_t frame)
{
    for (int k = 0; k < HEALTH_KINDS; k++)
        health->frame[k] = health->first[k] ? frame : 0;
}

int health_is_ill(const struct health *health)
{
    uint64_t any = 0;

    for (int k = 0; k < HEALTH_KINDS; k++)
        any |= health->count[k];
    return any != 0;
}

const char *health_first_text(char out[HEALTH_TEXT_SIZE], uint64_t key, struct tile_rect picture)
{
    struct health_place p;
    struct tile_rect rect;

    out[0] = 0;
    if (!health_place_of(key, &p) || p.tile >= tile_count(picture.width, picture.height))
        return out;
    rect = tile_rect_of(picture.width, picture.height, p.tile);
    snprintf(out, HEALTH_TEXT_SIZE, "pass %u, tile %u, pixel %u,%u, sample %u", p.pass, p.tile,
             picture.x + rect.x + p.pixel % rect.width, picture.y + rect.y + p.pixel / rect.width, p.sample);
    return out;
}

int health_is_told(const struct health *health, enum health_kind kind, uint64_t samples)
{
    return health->count[kind] > 0 && (double)health->count[kind] >= HEALTH_SHARE_TOLD * (double)samples;
}

const char *health_text(char out[HEALTH_TEXT_SIZE], const struct health *health, enum health_kind kind,
                        struct tile_rect picture, int with_frame)
{
    const struct health_row *row = &health_rows[kind];
    char first[HEALTH_TEXT_SIZE], frame[24] = "";

    health_first_text(first, health->first[kind], picture);
    if (with_frame)
        snprintf(frame, sizeof frame, "frame %u, ", health->frame[kind]);
    snprintf(out, HEALTH_TEXT_SIZE, "%" PRIu64 " %s%s%s%.96s", health->count[kind],
             health->count[kind] == 1 ? row->one : row->many, first[0] ? "; first: " : "", first[0] ? frame : "",
             first);
    return out;
}
