/* Meshes that are used many times, by matrices that make them a micrometre or a thousand kilometres
 * large, in one scene or each alone: they cast their shadows where they stand, keep the light out,
 * and are closed bodies of glass, as the same meshes do that are placed without a matrix.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/layers.h"
#include "tests/support/radiance.h"
#include "worker/render/render_scene.h"

enum { COMPARISONS = 36 };
/* A box's faces are cut into so many squares each way, and so many boxes stand elsewhere: together
 * they hold more triangles than are copied into the world. */
enum { CELLS = 14, SPARES = 30 };

/* The box from -1 to 1; every face by its own row of vertices, which agree to the bit. */
static uint32_t fine_box(struct scene_builder *b)
{
    enum { SIDE = CELLS + 1, VERTICES = 6 * SIDE * SIDE, TRIANGLES = 12 * CELLS * CELLS };
    static float p[3 * VERTICES];
    static uint32_t faces[3 * TRIANGLES];
    uint32_t n = 0;

    for (uint32_t f = 0; f < 6; f++) {
        uint32_t axis = f / 2, first = f * SIDE * SIDE;
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            float *v = p + 3 * (first + i);
            v[axis] = f & 1 ? 1 : -1;
            v[(axis + 1) % 3] = (float)(i % SIDE) * 2 / CELLS - 1;
            v[(axis + 2) % 3] = (float)(i / SIDE) * 2 / CELLS - 1;
        }
        for (uint32_t i = 0; i < CELLS * CELLS; i++) {
            uint32_t a = first + i / CELLS * SIDE + i % CELLS, d = a + SIDE;
            const uint32_t out[6] = {a, a + 1, d + 1, a, d + 1, d}, in[6] = {a, d + 1, a + 1, a, d, d + 1};
            memcpy(faces + n, f & 1 ? out : in, sizeof out);
            n += 6;
        }
    }
    return builder_mesh(b, p, NULL, VERTICES, faces, TRIANGLES, 1);
}

/* ---- how things are placed ---------------------------------------------------------------- */

enum company { ALONE, LIKE, UNLIKE, COMPANIES };
static const char *const company_names[] = {"copied", "with its like", "with unlike ones"};

struct arrangement {
    double scale;
    int turned;
    enum company company; /* ALONE: a single box is copied into the world; else it is an instance */
};

static const double turns[2][3][3] = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
    /* by 0.7 about y, then by 0.4 about x; columns are where the axes go */
    {{0.764842187284489, 0, 0.644217687237691},
     {0.250869682461848, 0.921060994002885, -0.297844087665487},
     {-0.593362958297706, 0.389418342308651, 0.704466305158264}}};

/* In boxes' half lengths. */
static void locate(const struct arrangement *set, const double local[3], double out[3])
{
    for (int r = 0; r < 3; r++) {
        out[r] = 0;
        for (int c = 0; c < 3; c++)
            out[r] += set->scale * turns[set->turned][r][c] * local[c];
    }
}

static struct vec3 place_of(const struct arrangement *set, double x, double y, double z)
{
    double out[3];

    locate(set, (double[3]){x, y, z}, out);
    return vec3_make((float)out[0], (float)out[1], (float)out[2]);
}

static void put(struct scene_builder *b, const struct arrangement *set, uint32_t mesh, uint32_t material, double x,
                double y, double z)
{
    struct scene_instance *instance = builder_place(b, mesh, material, vec3_splat(1), vec3_splat(0));
    double at[3];

    locate(set, (double[3]){x, y, z}, at);
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            instance->to_world.m[r][c] = set->scale * turns[set->turned][r][c];
        instance->to_world.m[r][3] = at[r];
    }
}

/* Instance 0 is the box, at (0, 1, 0). The others' shadows fall away from it; those that are smaller
 * by a million are inside of it, above its foot. */
static void put_boxes(struct scene_builder *b, const struct arrangement *set, uint32_t material)
{
    struct arrangement others = *set;
    uint32_t mesh = fine_box(b);

    if (set->company == UNLIKE)
        others.scale *= set->scale > 1 ? 1e-6 : 1e6;
    put(b, set, mesh, material, 0, 1, 0);
    for (int i = 0; set->company != ALONE && i < SPARES; i++)
        put(b, &others, mesh, material, 20 + 4 * i, set->scale > 1 ? 2 : 1, 0);
}

/* An instance is one, and a copy is one. */
static struct render_scene *build(struct scene_builder *b, const struct arrangement *set,
                                  const struct render_settings *settings)
{
    struct render_scene *scene = builder_build(b, settings);

    assert_int_equal(scene->instances[0].instance_positions != NULL, set->company == ALONE);
    return scene;
}

typedef void each_fn(const struct arrangement *set, const char *what);

static void each_setting(each_fn *check)
{
    static const double scales[] = {1, 1e-6, 1e6};

    for (size_t s = 0; s < sizeof scales / sizeof *scales; s++)
        for (int turned = 0; turned < 2; turned++)
            for (enum company company = ALONE; company < COMPANIES; company++) {
                const struct arrangement set = {scales[s], turned, company};
                char what[80];
                snprintf(what, sizeof what, "scale %g%s, %s", set.scale, turned ? ", turned" : "",
                         company_names[company]);
                check(&set, what);
            }
}

/* ---- contact shadows ---------------------------------------------------------------------- */

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT * 3, BLOCK = 4 };

static void shadow_picture(const struct arrangement *set, double mean[PIXELS])
{
    static const float corners[12] = {-9, 0, -9, -9, 0, 9, 9, 0, 9, 9, 0, -9};
    static const uint32_t faces[6] = {0, 1, 2, 0, 2, 3};
    struct render_settings settings = builder_settings(WIDTH, HEIGHT, 16);
    const struct arrangement one = {1, set->turned, ALONE};
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_light *light;
    struct scene_builder b;
    struct vec3 sun;

    settings.max_depth = 1;
    builder_init(&b);
    builder_lambert(&b, 1);
    put_boxes(&b, set, 0);
    put(&b, set, builder_mesh(&b, corners, NULL, 4, faces, 2, 0), 0, 0, 0, 0);
    sun = vec3_normalize(place_of(&one, 1, -1, 0));
    light = builder_light(&b, LIGHT_DIRECTIONAL);
    light->direction[0] = sun.x;
    light->direction[1] = sun.y;
    light->direction[2] = sun.z;
    light->intensity[0] = light->intensity[1] = light->intensity[2] = (float)M_PI;
    /* The box's foot is the left part of the picture, the shadow's end its right. */
    builder_camera(&b, place_of(set, 2, 5, 0.5), place_of(set, 2, 0, 0), 0.6f);
    scene = build(&b, set, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    render_scene_free(scene);
    builder_release(&b);
}

static double block_mean(const double *picture, int block)
{
    int columns = WIDTH / BLOCK, x = block % columns * BLOCK, y = block / columns * BLOCK;
    double sum = 0;

    for (int i = 0; i < BLOCK * BLOCK; i++)
        sum += picture[3 * ((y + i / BLOCK) * WIDTH + x + i % BLOCK)];
    return sum / (BLOCK * BLOCK);
}

/* What the box of 2 m shows that was copied into the world: the first that each_setting asks for. */
static double wanted_shadow[2][PIXELS];

static void check_shadow(const struct arrangement *set, const char *what)
{
    static double picture[PIXELS];

    shadow_picture(set, picture);
    if (set->scale == 1 && set->company == ALONE) {
        int dark = 0, lit = 0;
        memcpy(wanted_shadow[set->turned], picture, sizeof picture);
        for (int i = 0; i < PIXELS; i += 3) {
            dark += picture[i] == 0;
            lit += fabs(picture[i] - sqrt(0.5)) < 1e-5;
        }
        assert_true(dark > PIXELS / 30 && lit > PIXELS / 30);
        return;
    }
    for (int i = 0; i < PIXELS / 3 / (BLOCK * BLOCK); i++) {
        double wanted = block_mean(wanted_shadow[set->turned], i), seen = block_mean(picture, i);
        if (fabs(wanted - seen) > 0.01 || (wanted == 0 && seen != 0))
            fail_msg("%s: block %d is %.4f instead of %.4f", what, i, seen, wanted);
    }
}

static void test_contact_shadows(void **state)
{
    (void)state;
    each_setting(check_shadow);
}

/* ---- closed walls ------------------------------------------------------------------------- */

static void check_dark(const struct arrangement *set, const char *what)
{
    struct render_settings settings = builder_settings(WIDTH, HEIGHT, 16);
    static double mean[PIXELS];
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_builder b;

    settings.max_depth = 10;
    builder_init(&b);
    builder_lambert(&b, 0.8f);
    put_boxes(&b, set, 0);
    builder_environment_constant(&b, vec3_splat(1e6f));
    builder_camera(&b, place_of(set, -0.3, 1.2, 0.4), place_of(set, 0.8, 0.1, -1), 1.5f);
    scene = build(&b, set, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    for (int i = 0; i < PIXELS; i++)
        if (mean[i] != 0)
            fail_msg("%s: light inside, %g at number %d", what, mean[i], i);
    render_scene_free(scene);
    builder_release(&b);
}

static void test_closed_walls(void **state)
{
    (void)state;
    each_setting(check_dark);
}

/* ---- glass -------------------------------------------------------------------------------- */

static struct scene_material *glass(struct scene_builder *b, double distance)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->double_sided = 0;
    m->specular = m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = 1.5f;
    m->attenuation_distance = (float)distance;
    for (int c = 0; c < 3; c++)
        m->attenuation_color[c] = 0.5f;
    return m;
}

/* Of all channels, which are alike. */
static double mean_of(const double *picture, const struct render_settings *settings, const void *unused)
{
    size_t count = (size_t)settings->width * settings->height * 3;
    double sum = 0;

    (void)unused;
    for (size_t i = 0; i < count; i++)
        sum += picture[i];
    return sum / (double)count;
}

/* Head on through the middle of a cell, of a block that is dyed; and at a slant, in a furnace,
 * through one that is clear. */
static void check_glass(const struct arrangement *set, const char *what)
{
    for (int dyed = 0; dyed < 2; dyed++) {
        struct render_settings settings = builder_settings(4, 4, 16);
        struct scene_material *m;
        struct scene_builder b;
        struct layers s;
        settings.max_depth = 200;
        builder_init(&b);
        m = glass(&b, dyed ? 2 * set->scale : (double)INFINITY);
        s = layers_stacked(layers_interface(1, 1.5), layers_absorber(layers_per_metre(m, 0), 2 * set->scale));
        put_boxes(&b, set, 0);
        builder_environment_constant(&b, vec3_splat(1));
        if (dyed)
            builder_camera(&b, place_of(set, 0.3, 6, 0.1), place_of(set, 0.3, 1, 0.1), 0.002f);
        else
            builder_camera(&b, place_of(set, 2, 4, 4), place_of(set, 0, 1, 0), 0.5f);
        radiance_expect_value(&b, &settings, COMPARISONS, mean_of, NULL,
                              dyed ? layers_seen(layers_stacked(s, layers_interface(1.5, 1))) : 1, what);
        builder_release(&b);
    }
}

static void test_glass(void **state)
{
    (void)state;
    each_setting(check_glass);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_contact_shadows),
        cmocka_unit_test(test_closed_walls),
        cmocka_unit_test(test_glass),
    };

    return cmocka_run_group_tests_name("instances", tests, NULL, NULL);
}
