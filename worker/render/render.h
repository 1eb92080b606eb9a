/* render: the path tracer as a library without I/O.
 *
 * render_scene_new turns a scene description and its blobs into a render_scene; render_tile renders one work unit of
 * it. A render_scene is immutable: any number of threads may render from it at once, each with its own scratch memory.
 * The result of render_tile is a pure function of the scene, the settings, the frame, the tile, the group and the pass.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/film/unit.h"
#include "common/math/real.h"
#include "common/scene/scene.h"
#include "common/scene/settings.h"

/* Where the renderer finds a blob's bytes. They must stay valid and unchanged until the
 * render_scene is freed (mesh buffers are used in place). Called from one thread. */
struct blob_source {
    status (*get)(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes, struct error *err);
    void *user;
};

struct render_scene;

struct render_stats {
    struct unit_work work; /* its health's examples without their frame */
    uint64_t trace_ns;     /* inside Embree; 0 unless measured (render_measure_trace) */
};

struct render_scene_info {
    uint64_t triangles, instances;
    uint64_t texture_bytes, mesh_bytes, bvh_bytes;
    uint64_t build_ns;
};

/* Prepare the scene for `frame`; the result can render every frame if nothing moves (scene_is_animated). ERR_INPUT:
 * blobs that are damaged or do not fit, with a message; ERR_UNSUPPORTED: this CPU lacks the settings' instruction set;
 * ERR_NO_MEMORY. `scene` may be released afterwards. */
status render_scene_new(struct render_scene **out, const struct scene *scene, const struct render_settings *settings,
                        uint32_t frame, struct blob_source blobs, struct error *err) MUST_CHECK;
void render_scene_free(struct render_scene *scene);

/* Start the threads that build scenes, before the first one: later calls do nothing. Without it, a lack of memory or of threads
 * may end the process. Not from two threads at once. ERR_NO_MEMORY: it may be tried again. */
status render_start_builders(struct error *err) MUST_CHECK;

/* How many threads the calling thread's next render_scene_new may use, itself included; 1 at first. The
 * scene is the same for any number. */
void render_build_threads(unsigned threads);

/* Refuse scenes that need more than `bytes`, with ERR_NO_MEMORY. 0, the default: more than the
 * machine has free when the scene is built. */
void render_memory_limit(uint64_t bytes);

void render_scene_info(const struct render_scene *scene, struct render_scene_info *info);

/* Render pass `pass` of group `group` of tile `tile` of frame `frame` into `sums`:
 * [pixels of the tile, row-major][3] float32 sums of radiance (not means), then for each AOV of the unit (unit_aovs),
 * in the enum's order, [pixels][its channels]: sums for means, the value of sample 0 for point-sampled ones. *tail gets
 * the largest contributions to it; NULL: not wanted. Returns how many floats were written, tile_floats(...) <=
 * TILE_FLOATS_MAX. Adds to *stats. */
size_t render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group, uint32_t pass,
                   float32 *sums, struct tail *tail, struct render_stats *stats);

/* Run the general kernel instead of the smallest that covers the scene: for the benchmarks, and for
 * the tests that both give the same bits. */
void render_force_general(int on);

/* Leave the coordinates of scenes that are built from now on where the import put them, whatever the camera
 * sees: for tests that shoot rays of their own, or that need the errors of a place far off. */
void render_keep_origin(int on);

/* The kernel that renders the scene, "textured", and how many effects it holds. */
const char *render_kernel_variant(const struct render_scene *scene);

/* The effects (common/scene/effects.h) that the scene's frame needs, found while loading. */
uint64_t render_effects(const struct render_scene *scene);

/* Time every Embree call from now on (costs a few percent); for the benchmarks. */
void render_measure_trace(int on);

/* What decides a result's bits besides the scene and the settings: the release of this renderer and
 * of Embree, "azulejo 0.2.0 embree 3.13.5 x86_64", in the double build followed by " double". Part of the handshake; pinned per job. */
const char *render_ray_tracer_name(void);

/* What the renderer computes in: "float", or "double" if it was built with DOUBLE=1. */
const char *render_precision(void);
