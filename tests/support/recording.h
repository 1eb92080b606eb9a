/* recording: the units of a small picture, rendered in process and kept, for studies of accuracy.
 *
 * A unit is (seed, tile, group, pass).
 * A record file is a struct record_header, then for each unit a struct record_head, its sums
 * [pixels of the tile, row-major][RGB] and its tail; all in this machine's byte order.
 * The tail lists a unit's samples of largest luminance, descending. */
#pragma once

#include <stdint.h>

#include "common/film/tiles.h"
#include "worker/render/render.h"

enum { RECORD_GROUPS = 2, RECORD_TAIL_MAX = 16, RECORD_PASSES_MAX = 160 };
#define RECORD_MAGIC 0x32444345525a41ull /* "AZRECD2" */

struct record_header {
    uint64_t magic;
    uint32_t width, height, tiles, passes, seeds, spp; /* spp: samples of a pixel over both groups */
};

struct record_tail {
    float luminance;
    uint16_t pixel, spare; /* of the tile */
};

struct record_head {
    uint32_t seed, tile, group, pass;
    uint32_t begin, end; /* samples of the group */
    uint32_t pixels, tail_count;
    uint64_t rays, cpu_ns, dropped;
};

struct record_unit {
    struct record_head head;
    float sums[TILE_PIXELS_MAX * 3];
    struct record_tail tail[RECORD_TAIL_MAX];
    uint32_t subject[TILE_PIXELS_MAX]; /* not in files: of the samples, those that see the subject (unit.h) */
};

/* Samples [*begin, *end) of a group make pass `index`, were there no cap. */
void record_pass_range(uint32_t index, uint32_t *begin, uint32_t *end);

/* Render samples [begin, end) of a group; head.pass is left to the caller. */
void record_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t seed,
                   uint32_t frame, uint32_t tile, uint32_t group, uint32_t begin, uint32_t end,
                   struct record_unit *out);
