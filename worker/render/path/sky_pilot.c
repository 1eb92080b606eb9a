#include "worker/render/path/sky_pilot.h"

#include <stdatomic.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/path/kernel.h"
#include "worker/render/path/record_path.h"
#include "worker/render/render_scene.h"

/* A path for so many pixels of the whole picture, within bounds; of each at most so many vertices. */
enum { PIXELS_A_PATH = 32, PATHS_MIN = 256, PATHS_MAX = 8192, VERTICES_A_PATH = 6 };
/* Paths end at this depth: those of glass and clouds are long, and deep vertices matter little. */
enum { PILOT_DEPTH = 8 };
/* Where more of the paths' own shadow rays to the environment arrive, nothing is to be learned. */
#define ARRIVED_MAX 0.4
#define PILOT_SEED 0x736b795f70696c6full

/* A vertex that light was asked for at. */
struct pilot_vertex {
    struct surface s;
    struct interior in;
};

struct pilot_path {
    uint32_t traced, arrived; /* of all its vertices */
    uint32_t count;
    struct pilot_vertex vertices[VERTICES_A_PATH];
};

struct pilot {
    const struct render_scene *scene;
    uint32_t path_count;
    struct pilot_path *paths;
    struct sky_point *points;
    const struct pilot_vertex **vertices; /* [points] */
    _Atomic int failed;
};

static _Thread_local struct {
    struct pilot_path *path; /* NULL: no pilot runs */
    struct interior in;
} pilot_now;

void sky_pilot_vertex_begins(const struct path *path)
{
    if (pilot_now.path)
        pilot_now.in = path->interior;
}

void sky_pilot_vertex_ends(const struct path_vertex *v, const struct path_notes *notes)
{
    struct pilot_path *to = pilot_now.path;

    if (to && notes->traced && v->light.kind == LIGHT_ENVIRONMENT) {
        to->traced++;
        to->arrived += !vec3_is_black(notes->visible);
    }
    if (!to || to->count == VERTICES_A_PATH || v->met != PATH_MET_SURFACE || !notes->asked ||
        v->s.material->flags & MATERIAL_TWO_WAY)
        return;
    to->vertices[to->count++] = (struct pilot_vertex){v->s, pilot_now.in};
}

static void trace_paths(void *user, size_t begin, size_t end)
{
    struct pilot *pilot = user;
    const struct render_settings *settings = &pilot->scene->settings;
    struct render_stats *stats = mem_calloc(1, sizeof *stats);

    if (!stats)
        atomic_store(&pilot->failed, 1);
    for (size_t i = begin; i < end && stats; i++) {
        uint32_t at[2];

        sobol_2d((uint32_t)i, at);
        pilot_now.path = &pilot->paths[i];
        (void)kernel_recording.sample_render(pilot->scene, 0, (uint32_t)((uint64_t)at[0] * settings->width >> 32),
                                             (uint32_t)((uint64_t)at[1] * settings->height >> 32), 0, NULL, stats);
        pilot_now.path = NULL;
    }
    mem_free(stats);
}

static real arrives(void *user, uint32_t point, struct vec3 direction)
{
    const struct pilot *pilot = user;
    const struct pilot_vertex *v = pilot->vertices[point];
    struct sampler sampler = {0};

    /* Each ray draws for itself what is left to chance: the direction is its number. */
    sampler_start(&sampler, PILOT_SEED, 0, point, float_bits((float32)direction.x), 0, float_bits((float32)direction.z));
    return kernel_recording.arrives(pilot->scene, &sampler, &v->s, &v->in, direction);
}

static int is_open(const struct pilot *pilot)
{
    double traced = 0, arrived = 0;

    for (uint32_t i = 0; i < pilot->path_count; i++) {
        traced += pilot->paths[i].traced;
        arrived += pilot->paths[i].arrived;
    }
    return !(arrived <= ARRIVED_MAX * traced);
}

static status learn(struct pilot *pilot, struct render_scene *scene, struct error *err)
{
    struct sky_pilot found = {NULL, 0, arrives, pilot, scene->build_threads, scene->emitters.environment_odds};

    for (uint32_t i = 0; i < pilot->path_count; i++)
        for (uint32_t k = 0; k < pilot->paths[i].count; k++) {
            const struct pilot_vertex *v = &pilot->paths[i].vertices[k];

            pilot->vertices[found.count] = v;
            pilot->points[found.count++] = (struct sky_point){v->s.p, v->s.ng};
        }
    found.points = pilot->points;
    return sky_guide_init(&scene->emitters.environment.guide, &scene->emitters.environment, &found, err);
}

/* Rays through media with grids take too long for a pilot. */
static int has_clouds(const struct render_scene *scene)
{
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (scene->media[i] && medium_has_grid(scene->media[i]))
            return 1;
    return 0;
}

static uint32_t count_paths(const struct render_settings *settings)
{
    const uint64_t pixels = (uint64_t)settings_whole_width(settings) * settings_whole_height(settings);
    const uint64_t count = pixels / PIXELS_A_PATH;

    return count < PATHS_MIN ? PATHS_MIN : count > PATHS_MAX ? PATHS_MAX : (uint32_t)count;
}

/* Of the whole picture, whatever part of it is rendered. */
static void trace_picture(struct pilot *pilot, struct render_scene *scene)
{
    const struct render_settings settings = scene->settings;

    scene->settings.width = settings_whole_width(&settings);
    scene->settings.height = settings_whole_height(&settings);
    scene->settings.region_x = scene->settings.region_y = 0;
    scene->settings.seed = PILOT_SEED;
    scene->settings.max_depth = settings.max_depth < PILOT_DEPTH ? settings.max_depth : PILOT_DEPTH;
    parallel_for(scene->build_threads, pilot->path_count, 64, trace_paths, pilot);
    scene->settings = settings;
}

status sky_pilot_run(struct render_scene *scene, struct error *err)
{
    struct pilot pilot = {.scene = scene, .path_count = count_paths(&scene->settings)};
    const size_t vertices = (size_t)pilot.path_count * VERTICES_A_PATH;
    status s;

    if (scene->settings.env_sampling != ENV_SAMPLING_LEARNED || !scene->emitters.has_environment || scene->enclosed ||
        has_clouds(scene))
        return STATUS_OK;
    pilot.paths = mem_calloc(pilot.path_count, sizeof *pilot.paths);
    pilot.points = mem_alloc_array(vertices, sizeof *pilot.points);
    pilot.vertices = mem_alloc_array(vertices, sizeof *pilot.vertices);
    if (pilot.paths && pilot.points && pilot.vertices)
        trace_picture(&pilot, scene);
    else
        atomic_store(&pilot.failed, 1);
    s = atomic_load(&pilot.failed) ? error_no_memory(err, "the environment's guide")
        : is_open(&pilot)          ? STATUS_OK
                                   : learn(&pilot, scene, err);
    mem_free(pilot.paths);
    mem_free(pilot.points);
    mem_free(pilot.vertices);
    return s;
}
