/* A worker that rests: worker/main.c, linked so that its calls of render_tile come here (Makefile). Farm tests have jobs
 * that are only there to be in work while something else is looked at; each would keep a core busy for as long. Of a job of
 * so many samples, after its first passes, this worker renders a quarter of the time. Other jobs it renders as any worker. */
#include <stdint.h>
#include <time.h>

#include "common/system/clock.h"
#include "worker/render/render.h"
#include "worker/render/render_scene.h"

enum { LONG_SPP = 50000, ENDLESS_SPP = 1000000, FIRST_PASSES = 2, RESTS_OF_LONG = 3, RESTS_OF_ENDLESS = 9, REST_MAX_NS = 200000000 };

size_t __real_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats);
size_t __wrap_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats);

size_t __wrap_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats)
{
    uint64_t began_ns = clock_thread_cpu_ns(), rest_ns;
    size_t count = __real_render_tile(scene, frame, tile, group, pass, sums, tail, stats);

    if (scene->settings.spp >= LONG_SPP && pass >= FIRST_PASSES) {
        rest_ns = (scene->settings.spp >= ENDLESS_SPP ? RESTS_OF_ENDLESS : RESTS_OF_LONG) * (clock_thread_cpu_ns() - began_ns);
        nanosleep(&(struct timespec){.tv_nsec = (long)(rest_ns < REST_MAX_NS ? rest_ns : REST_MAX_NS)}, NULL);
    }
    return count;
}
