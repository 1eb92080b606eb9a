/* Choices of algorithm that must not change what a picture converges to: sampler, light choice, Russian
 * roulette, environment sampling.
 *
 * Each scene is rendered FRAMES times by default and with each choice, with other seeds. Every BLOCK x
 * BLOCK block of the picture is compared by Welch's t-test. The family-wise significance is 0.01,
 * Sidak-corrected over all blocks of all comparisons. Clamping, which does change the picture, shows
 * that the comparison can fail. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"

enum {
    FRAMES = 40, SIDE = 12, BLOCK = 4, BLOCKS = (SIDE / BLOCK) * (SIDE / BLOCK), SPP = 32,
    SCENES = 7, CHOICES = 10,
    TESTS = SCENES * CHOICES * BLOCKS
};

/* ---- the scenes ---------------------------------------------------------------------------- */

static void sky(struct scene_builder *b)
{
    enum { W = 32, H = 16 };
    static float map[W * H * 3];

    for (int i = 0; i < W * H * 3; i++)
        map[i] = 0.3f + 0.1f * (float)(i % 7);
    for (int y = 2; y < 5; y++) /* a bright patch, and a black one */
        for (int i = 8 * 3; i < 12 * 3; i++)
            map[3 * W * y + i] = 12;
    memset(&map[(5 * W + 20) * 3], 0, 6 * 3 * sizeof *map);
    builder_environment_map(b, map, W, H);
}

static void emitting(struct scene_builder *b, uint32_t mesh, float radiance, struct vec3 scale, struct vec3 place)
{
    struct scene_material *m = builder_lambert(b, 0);

    m->emission[0] = m->emission[1] = m->emission[2] = radiance;
    builder_place(b, mesh, builder_last_material(b), scale, place);
}

/* Every kind of light over a floor with a ball. */
static void lamps(struct scene_builder *b)
{
    struct scene_light *light;
    uint32_t quad;

    builder_room(b, NULL);
    quad = builder_quad(b);
    emitting(b, quad, 40, vec3_make(0.1f, -1, 0.2f), vec3_make(-2, 2, 1));
    emitting(b, builder_sphere(b, 6, 0), 3, vec3_splat(0.3f), vec3_make(-1.5f, 0, 1));
    emitting(b, quad, 0.05f, vec3_make(2, 1, 2), vec3_make(0, -0.9f, -3));
    light = builder_light(b, LIGHT_POINT);
    light->position[0] = 2;
    light->position[1] = 0.5f;
    for (int c = 0; c < 3; c++)
        light->intensity[c] = 4;
    light = builder_light(b, LIGHT_DIRECTIONAL);
    for (int c = 0; c < 3; c++)
        light->intensity[c] = 0.5f;
    light = builder_light(b, LIGHT_DIRECTIONAL);
    for (int c = 0; c < 3; c++)
        light->intensity[c] = 0.02f;
    sky(b);
}

static void plain_sky(struct scene_builder *b)
{
    builder_room(b, NULL);
    sky(b);
}

static void glass_ball(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->base_color[0] = ball->base_color[1] = ball->base_color[2] = 1;
    ball->specular = ball->transmission = 1;
    ball->roughness = 0.5f;
    ball->refractive = 1;
}

/* Rough glass, and a mirror: directions that light sampling finds, and ones that it cannot. */
static void glass(struct scene_builder *b)
{
    struct scene_material *m;

    builder_room(b, glass_ball);
    m = builder_lambert(b, 0.9f);
    m->metallic = 1;
    m->roughness = 0;
    builder_place(b, builder_quad(b), builder_last_material(b), vec3_splat(1), vec3_make(-2, -0.5f, 0));
    sky(b);
}

static void fog(struct scene_builder *b)
{
    struct scene_medium *medium;

    builder_room(b, NULL);
    sky(b);
    medium = builder_medium(b);
    for (int c = 0; c < 3; c++) {
        medium->scattering[c] = 0.15f;
        medium->absorption[c] = 0.05f;
    }
    medium->g = 0.4f;
    b->scene.fog = 0;
}

/* The sky through a window that is a portal. */
static void window(struct scene_builder *b)
{
    static struct scene_portal portal = {{-2, 0, -1}, {0, 2, 0}, {0, 0, 2}};

    builder_room(b, NULL);
    sky(b);
    b->scene.environment.portal_count = 1;
    b->scene.environment.portals = &portal;
}

/* The sky through a window that is none: the guide must find it. */
static void room(struct scene_builder *b)
{
    builder_windowed_room(b);
    sky(b);
}

static void window_done(struct scene_builder *b)
{
    b->scene.environment.portal_count = 0;
    b->scene.environment.portals = NULL;
}

static const struct {
    const char *name;
    void (*build)(struct scene_builder *b);
    void (*done)(struct scene_builder *b);
} scenes[SCENES] = {
    {"lamps", lamps, NULL}, {"sky", plain_sky, NULL},        {"glass", glass, NULL},
    {"fog", fog, NULL},     {"window", window, window_done}, {"room", room, NULL},
    {"rooms", builder_lamp_rooms, NULL},
};

/* ---- the choices --------------------------------------------------------------------------- */

static void independent(struct render_settings *s) { s->sampler = SAMPLER_INDEPENDENT; }
static void by_power(struct render_settings *s) { s->light_choice = LIGHT_CHOICE_POWER; }
static void by_tree(struct render_settings *s) { s->light_choice = LIGHT_CHOICE_TREE; }
static void alike(struct render_settings *s) { s->light_choice = LIGHT_CHOICE_UNIFORM; }
static void no_roulette(struct render_settings *s) { s->no_roulette = 1; }
static void map_only(struct render_settings *s) { s->env_sampling = ENV_SAMPLING_IMPORTANCE_ONLY; }
static void sphere(struct render_settings *s) { s->env_sampling = ENV_SAMPLING_UNIFORM; }
static void sphere_only(struct render_settings *s) { s->env_sampling = ENV_SAMPLING_UNIFORM_ONLY; }
static void by_map(struct render_settings *s) { s->env_sampling = ENV_SAMPLING_IMPORTANCE; }
static void surface_only(struct render_settings *s) { s->env_sampling = ENV_SAMPLING_BSDF; }

static const struct {
    const char *name;
    void (*set)(struct render_settings *s);
} choices[CHOICES] = {
    {"independent", independent},  {"power", by_power}, {"uniform lights", alike},     {"no roulette", no_roulette},
    {"importance-only", map_only}, {"uniform", sphere}, {"uniform-only", sphere_only}, {"bsdf", surface_only},
    {"importance", by_map},        {"tree", by_tree},
};

/* ---- comparing ----------------------------------------------------------------------------- */

struct pictures {
    struct running_stats block[BLOCKS];
    struct render_stats stats;
};

static void render_frames(struct scene_builder *b, const struct render_settings *settings, struct pictures *out)
{
    struct render_scene *scene = builder_build(b, settings);
    double mean[SIDE * SIDE * 3];

    memset(out, 0, sizeof *out);
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        double sum[BLOCKS] = {0};

        builder_render(scene, settings, frame, mean, NULL, &out->stats);
        for (int i = 0; i < SIDE * SIDE; i++)
            sum[i / SIDE / BLOCK * (SIDE / BLOCK) + i % SIDE / BLOCK] +=
                (mean[3 * i] + mean[3 * i + 1] + mean[3 * i + 2]) / (3 * BLOCK * BLOCK);
        for (int k = 0; k < BLOCKS; k++)
            running_stats_add(&out->block[k], sum[k]);
    }
    assert_int_equal(out->stats.work.dropped_samples, 0);
    render_scene_free(scene);
}

/* Welch's t-test: two-sided. */
static double welch(const struct running_stats *a, const struct running_stats *b)
{
    double va = running_stats_variance(a) / (double)a->count;
    double vb = running_stats_variance(b) / (double)b->count;
    double degrees = (va + vb) * (va + vb) / (va * va / (double)(a->count - 1) + vb * vb / (double)(b->count - 1));

    if (fabs(a->mean - b->mean) <= 2e-5 * fabs(b->mean))
        return 1;
    return 2 * student_cdf(-fabs(a->mean - b->mean) / sqrt(va + vb), degrees);
}

static double least_p(const struct pictures *a, const struct pictures *b)
{
    double least = 1;

    for (int k = 0; k < BLOCKS; k++)
        least = fmin(least, welch(&a->block[k], &b->block[k]));
    return least;
}

static double variance(const struct pictures *p)
{
    double sum = 0;

    for (int k = 0; k < BLOCKS; k++)
        sum += running_stats_variance(&p->block[k]);
    return sum;
}

static struct render_settings settings_of(uint64_t seed)
{
    struct render_settings s = builder_settings(SIDE, SIDE, SPP);

    s.max_depth = 6;
    s.seed = seed;
    return s;
}

/* Each choice does something: more noise of the same picture, or more rays. */
static void expect_effect(double noise[SCENES][CHOICES], double rays[SCENES][CHOICES])
{
    assert_true(noise[1][0] > 1.5); /* independent numbers, under a sky */
    assert_true(noise[0][2] > 4);   /* many lamps, all alike */
    assert_true(noise[0][1] > 1.02 && noise[0][1] < noise[0][2]);
    assert_true(rays[3][3] > 1.1); /* without roulette, in fog */
    for (int i = 1; i < 6; i++) {
        assert_true(noise[i][4] > 1.2);                   /* MIS saves noise, */
        assert_true(noise[i][6] > 1.2 * noise[i][5]);     /* with uniform directions, too */
        assert_true(i == 5 || noise[i][6] > noise[i][4]); /* the map's brightest part does not shine into the room */
    }
    assert_true(noise[5][8] > 2.5); /* the guide, in a room */
}

static void test_unbiased(void **state)
{
    double noise[SCENES][CHOICES], rays[SCENES][CHOICES];

    (void)state;
    for (int i = 0; i < SCENES; i++) {
        struct render_settings settings = settings_of(1);
        struct pictures plain, other;
        struct scene_builder b;

        scenes[i].build(&b);
        render_frames(&b, &settings, &plain);
        for (int k = 0; k < CHOICES; k++) {
            double p;

            settings = settings_of((uint64_t)(100 + k));
            choices[k].set(&settings);
            render_frames(&b, &settings, &other);
            p = least_p(&other, &plain);
            noise[i][k] = variance(&other) / variance(&plain);
            rays[i][k] = (double)other.stats.work.rays / (double)plain.stats.work.rays;
            print_message("# %s, %s: least p %.2g, variance %.3g times, rays %.3g times\n", scenes[i].name,
                          choices[k].name, p, noise[i][k], rays[i][k]);
            if (p < sidak_alpha(0.01, TESTS))
                fail_msg("%s, %s: another picture (p = %.2g)", scenes[i].name, choices[k].name, p);
        }
        if (scenes[i].done)
            scenes[i].done(&b);
        builder_release(&b);
    }
    expect_effect(noise, rays);
}

/* A picture that lost light is recognised. */
static void test_clamping_shows(void **state)
{
    struct render_settings settings = settings_of(1);
    struct pictures plain, other;
    struct scene_builder b;

    (void)state;
    lamps(&b);
    render_frames(&b, &settings, &plain);
    settings = settings_of(2);
    settings.clamp = 0.5f;
    render_frames(&b, &settings, &other);
    assert_true(least_p(&other, &plain) < sidak_alpha(0.01, TESTS));
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_unbiased),
        cmocka_unit_test(test_clamping_shows),
    };

    return cmocka_run_group_tests_name("choices", tests, NULL, NULL);
}
