#include "worker/render/path/light_pilot.h"

#include <stdatomic.h>
#include <stddef.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/path/kernel.h"
#include "worker/render/path/record_path.h"
#include "worker/render/render_scene.h"

/* A path for so many pixels of the whole picture, within bounds; of each at most so many vertices. */
enum { PIXELS_A_PATH = 32, PATHS_MIN = 256, PATHS_MAX = 8192, VERTICES_A_PATH = 6 };
/* Paths end at this depth: those of glass and clouds are long, and deep vertices matter little. */
enum { PILOT_DEPTH = 8 };
/* Where more of the paths' own shadow rays to the environment, or to lamps, arrive, nothing is to be learned. */
#define SKY_ARRIVED_MAX 0.4
#define LAMPS_ARRIVED_MAX 0.9
#define PILOT_SEED 0x736b795f70696c6full

/* A vertex that light was asked for at. */
struct pilot_vertex {
    struct surface s;
    struct interior in;
};

/* Shadow rays. */
struct pilot_rays {
    uint32_t traced, arrived;
};

struct pilot_path {
    struct pilot_rays sky, lamps; /* of all its vertices */
    uint32_t count;
    struct pilot_vertex vertices[VERTICES_A_PATH];
};

struct pilot {
    const struct render_scene *scene;
    uint32_t path_count;
    struct pilot_path *paths;
    struct pilot_point *points;
    const struct pilot_vertex **vertices; /* [points] */
    _Atomic int failed;
};

static _Thread_local struct {
    struct pilot_path *path; /* NULL: no pilot runs */
    struct interior in;
} pilot_now;

void light_pilot_vertex_begins(const struct path *path)
{
    if (pilot_now.path)
        pilot_now.in = path->interior;
}

void light_pilot_vertex_ends(const struct path_vertex *v, const struct path_notes *notes)
{
    struct pilot_path *to = pilot_now.path;

    if (to && notes->traced && v->light.kind != LIGHT_DIRECTIONAL) {
        struct pilot_rays *rays = v->light.kind == LIGHT_ENVIRONMENT ? &to->sky : &to->lamps;

        rays->traced++;
        rays->arrived += !vec3_is_black(notes->visible);
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

/* Each ray draws for itself what is left to chance: the direction is its number. */
static real arrives(const struct pilot *pilot, uint32_t point, const struct light_sample *light)
{
    const struct pilot_vertex *v = pilot->vertices[point];
    struct sampler sampler = {0};

    sampler_start(&sampler, PILOT_SEED, 0, point, float_bits((float32)light->direction.x), 0,
                  float_bits((float32)light->direction.z));
    return kernel_recording.arrives(pilot->scene, &sampler, &v->s, &v->in, light);
}

static real sky_arrives(void *user, uint32_t point, struct vec3 direction)
{
    const struct light_sample light = light_of_sky(direction);

    return arrives(user, point, &light);
}

static int lamp_choose(void *user, uint32_t point, real u, real v, struct lamp_trial *out)
{
    const struct pilot *pilot = user;
    const struct emitters *e = &pilot->scene->emitters;
    const struct surface *s = &pilot->vertices[point]->s;
    const real ior = interior_ior(pilot->scene, &pilot->vertices[point]->in);
    const struct light_context context = {.p = s->p, .n = s->ng, .time = s->time, .ior = ior, .ior_beyond = ior};
    struct light_sample light = {0};
    real cosine;

    if (!light_tree_choose(&e->tree, NULL, s->p, s->ng, &u, &v, &out->item, &out->odds) ||
        !emitters_sample_item(pilot->scene, out->item, &context, out->odds * e->local_odds, u, v, &light))
        return 0;
    cosine = vec3_dot(light.direction, s->ng);
    if (!(cosine > 0) || !(light.pdf > 0))
        return 0;
    out->trial = (struct light_trial){light.pdf, vec3_luminance(light_radiance(&light)) * cosine * REAL_INV_PI,
                                      light.delta ? 0 : cosine};
    out->arrives = arrives(pilot, point, &light);
    return 1;
}

/* Of the member `rays_at` of every path: does more than `most` of its rays arrive? */
static int is_open(const struct pilot *pilot, size_t rays_at, double most)
{
    double traced = 0, arrived = 0;

    for (uint32_t i = 0; i < pilot->path_count; i++) {
        const struct pilot_rays *rays = (const void *)((const char *)&pilot->paths[i] + rays_at);

        traced += rays->traced;
        arrived += rays->arrived;
    }
    return !(arrived <= most * traced);
}

static uint32_t list_points(struct pilot *pilot)
{
    uint32_t count = 0;

    for (uint32_t i = 0; i < pilot->path_count; i++)
        for (uint32_t k = 0; k < pilot->paths[i].count; k++) {
            const struct pilot_vertex *v = &pilot->paths[i].vertices[k];

            pilot->vertices[count] = v;
            pilot->points[count++] = (struct pilot_point){v->s.p, v->s.ng};
        }
    return count;
}

static status learn(struct pilot *pilot, struct render_scene *scene, int sky, int lamps, struct error *err)
{
    struct emitters *e = &scene->emitters;
    const struct sky_pilot of_sky = {pilot->points, list_points(pilot), sky_arrives, pilot, scene->build_threads,
                                     e->environment_odds};
    const struct lamp_pilot of_lamps = {pilot->points, of_sky.count, lamp_choose, pilot, scene->build_threads};

    if (sky && !is_open(pilot, offsetof(struct pilot_path, sky), SKY_ARRIVED_MAX))
        TRY(sky_guide_init(&e->environment.guide, &e->environment, &of_sky, err));
    if (lamps && !is_open(pilot, offsetof(struct pilot_path, lamps), LAMPS_ARRIVED_MAX))
        TRY(lamp_guide_init(&e->guide, &e->tree, &of_lamps, err));
    return STATUS_OK;
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

status light_pilot_run(struct render_scene *scene, struct error *err)
{
    struct pilot pilot = {.scene = scene, .path_count = count_paths(&scene->settings)};
    const struct emitters *e = &scene->emitters;
    const size_t vertices = (size_t)pilot.path_count * VERTICES_A_PATH;
    const int sky = scene->settings.env_sampling == ENV_SAMPLING_LEARNED && e->has_environment && !scene->enclosed;
    const int lamps = scene->settings.light_choice == LIGHT_CHOICE_LEARNED && e->tree.node_count > 1;
    status s;

    if ((!sky && !lamps) || has_clouds(scene))
        return STATUS_OK;
    pilot.paths = mem_calloc(pilot.path_count, sizeof *pilot.paths);
    pilot.points = mem_alloc_array(vertices, sizeof *pilot.points);
    pilot.vertices = mem_alloc_array(vertices, sizeof *pilot.vertices);
    if (pilot.paths && pilot.points && pilot.vertices)
        trace_picture(&pilot, scene);
    else
        atomic_store(&pilot.failed, 1);
    s = atomic_load(&pilot.failed) ? error_no_memory(err, "the lights' guides") : learn(&pilot, scene, sky, lamps, err);
    mem_free(pilot.paths);
    mem_free(pilot.points);
    mem_free(pilot.vertices);
    return s;
}
