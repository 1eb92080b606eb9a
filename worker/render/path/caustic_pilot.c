#include "worker/render/path/caustic_pilot.h"

#include <stdatomic.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/base/sampler.h"
#include "worker/render/record.h"
#include "worker/render/render_scene.h"

enum { PATHS = 1024 };
#define PILOT_SEED 0x636175737469637full
/* From this share of the light on every vertex asks; at least so many do. Between them it is a power of two, which
 * seldom depends on how the same scene is written. */
#define SHARE_OF_ALL REAL(0.05)
#define SHARE_MIN REAL(0.015625)

struct pilot {
    struct render_scene *scene;
    real shares[PATHS]; /* of the path's light, by way of casters */
    _Atomic int failed;
};

static real share_of(const struct sample_record *record)
{
    real cast = 0, all = 0;

    for (uint32_t i = 0; i < record->count; i++)
        for (int from = 0; from < PATH_SOURCES; from++) {
            const real light = vec3_luminance(record->vertices[i].added[from]);

            all += light;
            cast += from == FROM_CASTER ? light : 0;
        }
    return cast > 0 && all < INFINITY ? cast / all : 0;
}

static void trace_paths(void *user, size_t begin, size_t end)
{
    struct pilot *pilot = user;
    const struct render_settings *settings = &pilot->scene->settings;
    struct sample_record *record = mem_alloc(sizeof *record);
    struct render_stats *stats = mem_calloc(1, sizeof *stats);

    if (!record || !stats)
        atomic_store(&pilot->failed, 1);
    for (size_t i = begin; i < end && record && stats; i++) {
        float32 added[3];
        uint32_t at[2];

        sobol_2d((uint32_t)i, at);
        render_sample(pilot->scene, 0, (uint32_t)((uint64_t)at[0] * settings->width >> 32),
                      (uint32_t)((uint64_t)at[1] * settings->height >> 32), 0, added, record, stats);
        pilot->shares[i] = share_of(record);
    }
    mem_free(record);
    mem_free(stats);
}

status caustic_pilot_run(struct render_scene *scene, struct error *err)
{
    const struct render_settings settings = scene->settings;
    struct pilot *pilot;
    real mean = 0;
    int failed;

    scene->caster_share = 1;
    if (!scene->casters)
        return STATUS_OK;
    pilot = mem_calloc(1, sizeof *pilot);
    NEED(pilot, err, "what casts caustics");
    pilot->scene = scene;
    /* Of the whole picture, whatever part of it is rendered. */
    scene->settings.width = settings_whole_width(&settings);
    scene->settings.height = settings_whole_height(&settings);
    scene->settings.region_x = scene->settings.region_y = 0;
    scene->settings.seed = PILOT_SEED;
    parallel_for(scene->build_threads, PATHS, 64, trace_paths, pilot);
    scene->settings = settings;
    for (int i = 0; i < PATHS; i++)
        mean += pilot->shares[i] / PATHS;
    while (scene->caster_share > SHARE_MIN && scene->caster_share / 2 > mean / SHARE_OF_ALL)
        scene->caster_share /= 2;
    failed = atomic_load(&pilot->failed);
    mem_free(pilot);
    return failed ? error_no_memory(err, "what casts caustics") : STATUS_OK;
}
