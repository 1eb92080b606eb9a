/* tiles: the geometry of a frame, and how its samples are divided into groups and passes.
 *
 * A pixel's samples belong to two groups, which are rendered, merged and counted separately. What is decided about one
 * group's samples is a function of the other's alone, so no decision biases the mean. Sample j of a group is point j of
 * the group's own, independently scrambled sequence. A work unit is (tile, group, pass) of a frame; a pass is a range
 * of sample numbers of its group.
 *
 * All of it is a pure function of the job's settings; every program computes the same. The boundaries of passes depend
 * on nothing: `spp`, the cap on a pixel's samples, only cuts the last pass of a group *short*.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/scene/settings.h"

enum {
    TILE_SIZE = 16,
    TILE_PIXELS_MAX = TILE_SIZE * TILE_SIZE,
    GROUPS = 2,
    PASS_LENGTH_MAX = 4096, /* samples a pixel in one pass */
    PASSES_MAX = 148,    /* of a group, at SETTINGS_SPP_MAX */
    LEVELS_MAX = 19,     /* at SETTINGS_SPP_MAX */
    TAIL_MAX = 16,       /* largest contributions that are kept per unit */
    PIXEL_FLOATS = 3,    /* of a pixel: a sum of radiance */
    FEATURE_PASSES = 4,  /* of a group, in which it has AOV_FEATURES: they have little noise */
    FEATURE_SAMPLES = 16,
    TILE_FLOATS_MAX = TILE_PIXELS_MAX * (PIXEL_FLOATS + AOV_FLOATS_MAX),
};

struct tile_rect {
    uint32_t x, y, width, height; /* pixels */
};

/* Where the pixels of a job are in the whole picture. */
static inline struct tile_rect settings_rect(const struct render_settings *s)
{
    return (struct tile_rect){s->region_x, s->region_y, s->width, s->height};
}

static inline uint32_t tiles_across(uint32_t pixels) { return (pixels + TILE_SIZE - 1) / TILE_SIZE; }
uint32_t tile_count(uint32_t width, uint32_t height);

/* Tile `index` (row-major, < tile_count) of a frame. */
struct tile_rect tile_rect_of(uint32_t width, uint32_t height, uint32_t index);

/* The AOVs of the job's mask that are in a unit's result: point-sampled ones are those of sample 0
 * of group 0, in pass 0 of that group only; features are in FEATURE_PASSES of each group. */
uint32_t unit_aovs(uint32_t aovs, uint32_t group, uint32_t pass);

/* Floats in a result of tile `index`: [pixel, row-major][RGB], then for each AOV of the mask (of the unit: unit_aovs), in the order of enum aov, [pixel][its channels]. */
size_t tile_floats(uint32_t width, uint32_t height, uint32_t index, uint32_t aovs);
/* Where the values of `aov`, which is in the mask, begin. `pixels` is that of the tile. */
size_t tile_aov_offset(uint32_t pixels, uint32_t aovs, enum aov aov);

/* ---- passes ---------------------------------------------------------------------------------- */

/* How many of `spp` samples a pixel belong to the group. */
static inline uint32_t group_samples(uint32_t spp, uint32_t group) { return (spp + 1 - group) / GROUPS; }

/* Where pass `index` of a group would end without a cap, in samples of the group: 2, 4, 8, 16, 24,
 * 32, 48, 64, 96, 128, ..., 6144, 8192, 12288, and so on by PASS_LENGTH_MAX. index < PASSES_MAX. */
uint32_t pass_boundary(uint32_t index);

/* Samples of a group after this many whole passes. */
static inline uint32_t pass_samples(uint32_t passes) { return passes ? pass_boundary(passes - 1) : 0; }

/* The number of passes for the group's share of `spp` samples; 0: it has none. */
uint32_t pass_count(uint32_t spp, uint32_t group);

/* Pass `index` renders samples [*begin, *end) of the group in each pixel; index < pass_count(). */
void pass_range(uint32_t spp, uint32_t group, uint32_t index, uint32_t *begin, uint32_t *end);

/* Does the cap cut the pass? Only a group's last one can be short. */
int pass_is_short(uint32_t spp, uint32_t group, uint32_t index);

/* ---- levels: the numbers of samples at which statistics are taken --------------------------- */

/* Samples of a group at level k: 2, 4, 8, ...; k < LEVELS_MAX. */
static inline uint32_t level_samples(uint32_t level) { return 2u << level; }
/* How many passes of a group make up level k. */
uint32_t level_passes(uint32_t level);
/* How many levels a group's first `passes` whole passes have reached. */
uint32_t level_count(uint32_t passes);
/* The level that is reached with the group's first `passes` whole passes; -1: none. */
int level_at(uint32_t passes);
