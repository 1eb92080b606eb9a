/* kernel: the variants of the path tracer, and which one renders a scene.
 *
 * One source (camera.c, surface*.c, bsdf/, path*.c, tile.c) is compiled several times with
 * different sets of effects (kernels/). A scene is rendered by the first row of the table whose set
 * covers what the scene needs. The last row covers everything. The choice never changes a bit of
 * the result (tests/unit/render/test_kernels.c).
 */
#ifndef AZULEJO_RENDER_KERNEL_H
#define AZULEJO_RENDER_KERNEL_H

#include "worker/render/accel/accel.h"
#include "worker/render/render.h"

typedef size_t tile_render_function(const struct render_scene *scene, uint32_t frame,
                                    uint32_t tile, uint32_t group, uint32_t pass, float32 *sums,
                                    struct tail *tail, struct render_stats *stats);

/* Sample `number` of a pixel: what it adds to the pixel's sum. *radiance, if given, is that before guards. */
typedef struct vec3 sample_render_function(const struct render_scene *scene, uint32_t frame,
                                           uint32_t x, uint32_t y, uint32_t number,
                                           struct vec3 *radiance, struct render_stats *stats);

struct kernel {
    const char *name;
    uint64_t effects;
    tile_render_function *tile_render;
    accel_accept *accept;
};

/* The smallest kernel that covers these effects. */
const struct kernel *kernel_for(uint64_t effects);
/* Row `index` of the table, smallest kernel first; NULL past the end. */
const struct kernel *kernel_at(size_t index);

/* Set by render_measure_trace. */
extern int kernel_measures_trace;

/* tile.c and what it includes, compiled on its own: it covers every effect, like the general
 * kernel. */
tile_render_function tile_render;

/* The general kernel with hooks (kernels/recording.c), which is not in the table. */
extern const struct kernel kernel_recording;
sample_render_function sample_render_recording;

#endif
