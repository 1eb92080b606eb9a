#include "worker/render/path/caustic_pilot.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/base/sampler.h"
#include "worker/render/caustic/casters.h"
#include "worker/render/record.h"
#include "worker/render/render_scene.h"

enum { PATHS = 1024 };
#define PILOT_SEED 0x636175737469637full
/* From this share of the light on every vertex asks; at least so many do. Between them it is a power of two, which
 * seldom depends on how the same scene is written. */
#define SHARE_OF_ALL REAL(0.05)
#define SHARE_MIN REAL(0.00390625)
/* Below this share suns and lamps with area are left to the paths that meet them by chance: to ask would cost more than
 * it is worth. */
#define CHANCE_BELOW REAL(0.01)

struct pilot {
    struct render_scene *scene;
    real all[PATHS], cast[PATHS]; /* luminance that each path brought; of it by way of casters */
    _Atomic int failed;
};

static void sum_up(const struct sample_record *record, real *all, real *cast)
{
    *all = *cast = 0;
    for (uint32_t i = 0; i < record->count; i++)
        for (int from = 0; from < PATH_SOURCES; from++) {
            const real light = vec3_luminance(record->vertices[i].added[from]);

            *all += light;
            *cast += from == FROM_CASTER ? light : 0;
        }
}

static int compare(const void *a, const void *b)
{
    const real x = *(const real *)a, y = *(const real *)b;

    return (x > y) - (x < y);
}

/* The share in the mean pixel: of a path's light, where that is as bright as the median or brighter; in the dark, where
 * most paths are black by chance, of the median. */
static real mean_share(const struct pilot *pilot)
{
    real sorted[PATHS], sum = 0;
    int count = 0;

    for (int i = 0; i < PATHS; i++)
        if (pilot->all[i] > 0 && pilot->all[i] < INFINITY)
            sorted[count++] = pilot->all[i];
    if (count == 0)
        return 0;
    qsort(sorted, (size_t)count, sizeof *sorted, compare);
    for (int i = 0; i < PATHS; i++)
        if (pilot->all[i] < INFINITY)
            sum += pilot->cast[i] / real_max(pilot->all[i], sorted[count / 2]);
    return sum / PATHS;
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
        sum_up(record, &pilot->all[i], &pilot->cast[i]);
    }
    mem_free(record);
    mem_free(stats);
}

status caustic_pilot_run(struct render_scene *scene, struct error *err)
{
    const struct render_settings settings = scene->settings;
    struct pilot *pilot;
    real mean;
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
    mean = mean_share(pilot);
    if (mean < CHANCE_BELOW)
        scene->casters = casters_for_points(scene->casters);
    while (scene->caster_share > SHARE_MIN && scene->caster_share / 2 > mean / SHARE_OF_ALL)
        scene->caster_share /= 2;
    failed = atomic_load(&pilot->failed);
    mem_free(pilot);
    return failed ? error_no_memory(err, "what casts caustics") : STATUS_OK;
}
