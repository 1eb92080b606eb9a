/* kernel: the variants of the path tracer, and which one renders a scene.
 *
 * The same files (Makefile: KERNEL_SRC) are compiled once for each of several sets of effects. A
 * scene is rendered by the first row of the table whose set covers what it needs. The last row
 * covers everything. The choice never changes a bit of the result (tests/unit/render/test_kernels.c).
 */
#pragma once

#include "worker/render/accel/accel.h"
#include "worker/render/render.h"

typedef size_t tile_render_function(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                                    uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats);

/* Sample `number` of a pixel: what it adds to the pixel's sum. *radiance, if given, is that before guards. */
typedef struct vec3 sample_render_function(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y,
                                           uint32_t number, struct vec3 *radiance, struct render_stats *stats);

/* What of the light of a sample (above the surface) arrives at a point, 0..1: one draw, with the sampler's numbers, where
 * it is left to chance. `in`: the volumes in front of the surface. */
struct sampler;
struct surface;
struct interior;
struct light_sample;
typedef real arrives_function(const struct render_scene *scene, const struct sampler *sampler, const struct surface *s,
                              const struct interior *in, const struct light_sample *light);

struct kernel {
    const char *name;
    uint64_t effects;
    tile_render_function *tile_render;
    accel_accept *accept;
    /* Only of the one that records paths; else NULL. */
    sample_render_function *sample_render;
    arrives_function *arrives;
};

/* The smallest kernel that covers these effects. */
const struct kernel *kernel_for(uint64_t effects);
/* Row `index` of the table, smallest kernel first; NULL past the end. */
const struct kernel *kernel_at(size_t index);

/* Set by render_measure_trace. */
extern int kernel_measures_trace;

/* The general kernel that records paths (record.h), which is not in the table. */
extern const struct kernel kernel_recording;

/* tile.c */
tile_render_function tile_render;
sample_render_function sample_render;
/* path.c */
arrives_function path_arrives;
