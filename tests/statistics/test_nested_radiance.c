/* Volumes within volumes: which boundary is there, with which index, and what absorbs.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/layers.h"
#include "tests/support/radiance.h"
#include "tests/support/slabs.h"

enum { COMPARISONS = 80 };

static struct scene_material *glass(struct scene_builder *b, float ior, int priority)
{
    struct scene_material *m = slabs_glass(b, ior, INFINITY);

    m->priority = priority;
    return m;
}

/* Two slabs that overlap, -1..1 and 0..2: the one of the higher priority has the common part, as
 * if it had been carved out of the other. */
static void test_priority(void **state)
{
    (void)state;
    for (int upper_first = 0; upper_first < 2; upper_first++) {
        struct render_settings settings = slabs_settings();
        struct scene_material *lower, *upper;
        struct scene_builder b;
        double expected[3];
        uint32_t slab;
        builder_init(&b);
        lower = glass(&b, 1.8f, upper_first ? 1 : 2);
        upper = glass(&b, 1.33f, upper_first ? 2 : 1);
        slabs_dye(lower, 1);
        slabs_dye(upper, 3);
        slab = builder_slab(&b);
        builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_splat(0));
        builder_place(&b, slab, 1, vec3_make(9, 1, 9), vec3_make(0, 1, 0));
        slabs_look_down(&b, 5);
        LAYERS_SEEN(expected, {upper, upper_first ? 2 : 1}, {lower, upper_first ? 1 : 2});
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                            upper_first ? "the upper slab has it" : "the lower slab has it");
        settings.without = EFFECT_NESTED_DIELECTRIC;
        assert_true(radiance_differs(&b, &settings, expected[0]));
        builder_release(&b);
    }
}

/* A slab within a slab: three layers, whatever the priorities are if the inner one's is higher,
 * or equal: then the one that was entered last is there. */
static void test_inside(void **state)
{
    (void)state;
    for (int equal = 0; equal < 2; equal++) {
        struct render_settings settings = slabs_settings();
        struct scene_material *outer, *inner;
        struct scene_builder b;
        double expected[3];
        uint32_t slab;
        builder_init(&b);
        outer = glass(&b, 1.5f, 0);
        inner = glass(&b, 2, equal ? 0 : 5);
        slabs_dye(outer, 5);
        slabs_dye(inner, 1);
        slab = builder_slab(&b);
        builder_place(&b, slab, 0, vec3_make(9, 2, 9), vec3_splat(0));
        builder_place(&b, slab, 1, vec3_make(9, 0.5f, 9), vec3_splat(0));
        slabs_look_down(&b, 5);
        LAYERS_SEEN(expected, {outer, 1.5}, {inner, 1}, {outer, 1.5});
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                            equal ? "equal priorities" : "the inner slab's is higher");
        builder_release(&b);
    }
}

/* An inner slab of lower priority is not there at all. */
static void test_hidden(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *outer;
    struct scene_builder b;
    double expected[3];
    uint32_t slab;

    (void)state;
    builder_init(&b);
    outer = glass(&b, 1.5f, 1);
    slabs_dye(outer, 5);
    slabs_dye(glass(&b, 2, 0), 1);
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 2, 9), vec3_splat(0));
    builder_place(&b, slab, 1, vec3_make(9, 0.5f, 9), vec3_splat(0));
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {outer, 4});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "hidden slab");
    builder_release(&b);
}

/* The camera is in the outer slab, a third of the way down, and in the inner one. */
static void test_camera_inside(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    double expected[3];
    uint32_t slab;

    (void)state;
    builder_init(&b);
    m = glass(&b, 1.5f, 0);
    slabs_dye(m, 2);
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_splat(0));
    slabs_look_down(&b, 0.4f);
    for (int c = 0; c < 3; c++) {
        struct layers face = layers_interface(1.5, 1);
        double whole = exp(-2 * layers_per_metre(m, c));
        /* 1.4 m down to the face, then light of all the inner reflections; within the glass
         * light is crowded into less solid angle: radiance over n^2 is what stays. */
        expected[c] =
            1.5 * 1.5 * exp(-(double)1.4f * layers_per_metre(m, c)) * face.t * (1 / (1 - face.r_above * whole));
    }
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "camera in a slab");
    /* A second volume round about, of the same index and clear: it only moves the boundary. */
    glass(&b, 1.5f, -1);
    builder_place(&b, slab, 1, vec3_make(9, 4, 9), vec3_splat(0));
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "camera in two slabs");
    builder_release(&b);
}

/* A ball of water in a shell of an index like water's has no boundary: it is one ball. Without
 * the rule the inner boundary would bend light as if air were around it. */
static void test_no_interface(void **state)
{
    enum { W = 64, H = 32 };
    static float sky[H * W * 3];
    struct render_settings settings = builder_settings(8, 8, 64);
    double mean[2];

    (void)state;
    for (int i = 0; i < W * H; i++)
        sky[3 * i] = sky[3 * i + 1] = sky[3 * i + 2] = (float)(1 + sin(2 * M_PI * (i % W) / W));
    settings.max_depth = 40;
    for (int nested = 0; nested < 2; nested++) {
        struct render_settings own = settings;
        struct running_stats s[3];
        struct scene_builder b;
        uint32_t ball;
        builder_init(&b);
        glass(&b, 1.33f, 0);
        glass(&b, 1.33f, 1);
        ball = builder_sphere(&b, 32, 1);
        builder_place(&b, ball, 0, vec3_splat(1), vec3_splat(0));
        if (nested)
            builder_place(&b, ball, 1, vec3_splat(0.8f), vec3_splat(0));
        builder_environment_map(&b, sky, W, H);
        builder_camera(&b, vec3_make(0.5f, 0, 4), vec3_make(0.5f, 0, 0), 0.1f);
        if (!nested)
            own.spp *= 16; /* this is the expectation: its own error must hardly count */
        radiance_measure(&b, &own, s);
        mean[nested] = s[0].mean;
        if (nested) {
            radiance_expect(&b, &own, COMPARISONS, mean[0], "water in water");
            own.without = EFFECT_NESTED_DIELECTRIC;
            assert_true(radiance_differs(&b, &own, mean[0]));
        }
        builder_release(&b);
    }
}

/* All of it, rough too, in a furnace. */
static void test_furnace(void **state)
{
    (void)state;
    for (int rough = 0; rough < 2; rough++) {
        struct render_settings settings = builder_settings(8, 8, 128);
        struct scene_builder b;
        uint32_t ball;
        settings.max_depth = 512;
        builder_init(&b);
        glass(&b, 1.5f, 0)->roughness = rough ? 0.3f : 0;
        glass(&b, 1.33f, 1)->roughness = rough ? 0.2f : 0;
        ball = builder_sphere(&b, 24, 1);
        builder_place(&b, ball, 0, vec3_splat(1), vec3_splat(0));
        builder_place(&b, ball, 1, vec3_splat(0.7f), vec3_make(0.5f, 0, 0)); /* sticks out */
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.3f);
        if (rough) { /* shading normals of rough glass may lose a little at the rim */
            struct running_stats s[3];
            radiance_measure(&b, &settings, s);
            assert_true(fabs(s[0].mean - 1) < 0.01);
        } else {
            radiance_expect(&b, &settings, COMPARISONS, 1, "nested glass");
        }
        builder_release(&b);
    }
}

/* A floor with a checker of squares of 7 cm, of which a pixel sees several. */
static uint32_t checkered_floor(struct scene_builder *b)
{
    static const float positions[] = {-9, 0, -9, -9, 0, 9, 9, 0, 9, 9, 0, -9}, uv[] = {0, 0, 0, 8, 8, 8, 8, 0};
    static const uint32_t indices[] = {0, 1, 2, 0, 2, 3};
    static float checker[64 * 64 * 3];

    for (int i = 0; i < 64 * 64 * 3; i++)
        checker[i] = i / 3 % 64 / 2 % 2 == i / 3 / 64 / 2 % 2 ? 0.9f : 0.1f;
    builder_lambert(b, 1)->base_color_texture.texture = (int32_t)builder_texture(b, checker, 64, 64);
    return builder_mesh_mapped(b, &(struct builder_mapped){.positions = positions, .uv0 = uv, .vertex_count = 4,
                                                          .indices = indices, .triangle_count = 2});
}

/* Everything just behind the lamp: a shadow ray that has lost count of its length behind an interface meets it. The
 * camera's rays cross the interfaces, too. */
static void lamp_before_a_card(struct scene_builder *b, int kind, int interfaces, float view)
{
    const uint32_t quad = (builder_init(b), builder_quad(b));
    struct scene_material *m;

    builder_place(b, checkered_floor(b), 0, vec3_splat(1), vec3_splat(0));
    builder_lambert(b, 0);
    builder_place(b, quad, 1, vec3_splat(2), vec3_make(0, 2.01f, 0));
    m = builder_lambert(b, 0);
    m->kind = MATERIAL_INTERFACE;
    for (int i = 0; i < interfaces; i++)
        builder_place(b, quad, 2, vec3_splat(9), vec3_make(0, 0.6f + 0.4f * (float)i, 0));
    if (kind < LIGHT_KIND_COUNT) {
        struct scene_light *l = builder_light(b, (enum scene_light_kind)kind);
        l->position[1] = 2;
        l->outer_cone_rad = 1.2f;
        l->projection_yfov_rad = l->projection_aspect = 1;
        l->intensity[0] = l->intensity[1] = l->intensity[2] = 10;
        l->to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 0, 1, 2}, {0, -1, 0, 0}}};
    } else {
        m = builder_lambert(b, 0);
        m->emission[0] = m->emission[1] = m->emission[2] = 250;
        builder_place(b, quad, 3, vec3_splat(0.1f), vec3_make(0, 2, 0));
    }
    builder_camera(b, vec3_make(0, 1.9f, 5), vec3_make(0, 0, 0), view);
}

enum { PICTURE_SIDE = 16, PICTURE_FLOATS = PICTURE_SIDE * PICTURE_SIDE * 3 };

static void render_picture(struct scene_builder *b, uint32_t depth, double *picture)
{
    struct render_settings settings = builder_settings(PICTURE_SIDE, PICTURE_SIDE, 16);
    struct render_scene *scene;
    struct render_stats stats = {0};

    settings.max_depth = depth ? depth : settings.max_depth;
    /* Beside bodies, rays past a lamp's edge are decided in double: one of 100,000 differs, and with it a region's guide. */
    settings.light_choice = LIGHT_CHOICE_TREE;
    scene = builder_build(b, &settings);
    builder_render(scene, &settings, 0, picture, NULL, &stats);
    render_scene_free(scene);
}

/* Light passes interfaces as if they were not there: pixel by pixel with the same random numbers, for every kind of lamp. */
static void test_empty_interfaces(void **state)
{
    static double without[PICTURE_FLOATS], with[PICTURE_FLOATS];

    (void)state;
    for (int kind = 0; kind <= LIGHT_KIND_COUNT; kind++)
        for (int rule = 0; rule < VOLUME_RULE_COUNT; rule++)
            for (int interfaces = 0; interfaces <= 3; interfaces++) {
                struct scene_builder b;
                double most = 0, sum = 0;
                if (kind == LIGHT_DIRECTIONAL)
                    continue; /* nothing is behind it */
                lamp_before_a_card(&b, kind, interfaces, 0.3f);
                b.scene.volume_rule = (enum scene_volume_rule)rule;
                render_picture(&b, 0, interfaces ? with : without);
                builder_release(&b);
                for (int i = 0; i < PICTURE_FLOATS; i++) {
                    sum += without[i];
                    most = fmax(most, interfaces ? fabs(with[i] - without[i]) / without[i] : 0);
                }
                if (!(sum / PICTURE_FLOATS > 0.1) || most > 1e-4)
                    fail_msg("light %d, %d interfaces, rule %d: off by %g of a mean of %g", kind, interfaces, rule, most, sum / PICTURE_FLOATS);
            }
}

/* In something dyed, light fades from the lamp to the card and from there to the camera: for every kind of lamp, straight
 * and through interfaces. */
static void test_lamps_in_dye(void **state)
{
    static double clear[PICTURE_FLOATS], dyed[PICTURE_FLOATS];
    const double way = 2 + sqrt(1.9 * 1.9 + 25);

    (void)state;
    for (int kind = 0; kind <= LIGHT_KIND_COUNT; kind++)
        for (int interfaces = 0; interfaces <= 2; interfaces += 2) {
            struct scene_material *m;
            double sums[2][3] = {{0}};
            if (kind == LIGHT_DIRECTIONAL)
                continue; /* it shines from outside */
            for (int dye = 0; dye < 2; dye++) {
                struct scene_builder b;
                double *picture = dye ? dyed : clear;
                lamp_before_a_card(&b, kind, interfaces, 0.005f);
                builder_place(&b, builder_sphere(&b, 12, 1), builder_last_material(&b) + 1, vec3_splat(9), vec3_splat(0));
                m = glass(&b, 1.5f, 1); /* more than the interfaces' */
                if (dye)
                    slabs_dye(m, 1);
                render_picture(&b, 1, picture);
                for (int i = 0; i < PICTURE_FLOATS; i++)
                    sums[dye][i % 3] += picture[i];
                for (int c = 0; c < 3 && dye; c++) {
                    double is = sums[1][c] / sums[0][c], right = exp(-way * layers_per_metre(m, c));
                    if (!(sums[0][c] > 0) || fabs(is / right - 1) > 0.01)
                        fail_msg("light %d, %d interfaces: %g of it is left, not %g", kind, interfaces, is, right);
                }
                builder_release(&b);
            }
        }
}

/* ---- all indices times k ------------------------------------------------------------------------ */

enum { DRESS_GLASS, DRESS_ROUGH_GLASS, DRESS_FILM, DRESS_FILM_ON_GLASS, DRESS_COAT, DRESS_WALL, DRESS_SLAB, DRESS_CONDUCTOR, DRESS_COATED_LAMP, DRESSES };

/* A ball whose indices are k times those of everyday, and its film thinner by as much. */
static void dress(struct scene_material *m, int how, float k)
{
    m->ior = 1.5f * k;
    m->roughness = how == DRESS_GLASS ? 0 : 0.5f;
    m->specular = 1;
    m->double_sided = how == DRESS_WALL || how == DRESS_SLAB;
    m->transmission = how != DRESS_FILM && how != DRESS_COAT && how != DRESS_CONDUCTOR && how != DRESS_COATED_LAMP;
    m->refractive = how == DRESS_GLASS || how == DRESS_ROUGH_GLASS || how == DRESS_FILM_ON_GLASS;
    m->thin_slab = how == DRESS_SLAB;
    if (m->refractive)
        slabs_dye(m, 1);
    if (how == DRESS_FILM || how == DRESS_FILM_ON_GLASS) {
        m->iridescence = 1;
        m->iridescence_ior = 1.3f * k;
        m->iridescence_thickness_min_nm = m->iridescence_thickness_max_nm = 400 / k;
    }
    if (how == DRESS_COATED_LAMP)
        m->emission[0] = m->emission[1] = m->emission[2] = 1;
    if (how == DRESS_COAT || how == DRESS_COATED_LAMP) {
        m->clearcoat = 1;
        m->clearcoat_ior = 1.6f * k;
        m->clearcoat_roughness = 0.3f;
    }
    if (how == DRESS_CONDUCTOR) {
        m->kind = MATERIAL_CONDUCTOR;
        for (int c = 0; c < 3; c++) {
            m->conductor_eta[c] = (0.3f + 0.3f * (float)c) * k;
            m->conductor_k[c] = (3 - (float)c) * k;
        }
    }
}

/* A round room with a lamp and a ball in it; at k > 1 something of that index fills it, and reaches beyond its walls. */
static void room_filled(struct scene_builder *b, int how, float k)
{
    uint32_t ball;
    struct scene_material *m;

    builder_init(b);
    ball = builder_sphere(b, 12, 1);
    builder_lambert(b, 0.5f);
    builder_place(b, ball, 0, vec3_splat(4), vec3_splat(0));
    m = builder_lambert(b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = 20;
    builder_place(b, ball, 1, vec3_splat(0.4f), vec3_make(1, 2, 1));
    dress(builder_lambert(b, 0.7f), how, k);
    builder_place(b, ball, 2, vec3_splat(1), vec3_splat(0));
    if (k > 1) {
        m = slabs_glass(b, k, INFINITY);
        m->priority = -1;
        builder_place(b, ball, builder_last_material(b), vec3_splat(9), vec3_splat(0));
    }
    builder_camera(b, vec3_make(0, 0.5f, 3), vec3_splat(0), 0.8f);
}

/* Only ratios count: in something of index 2, with all indices doubled, the room looks the same, to the bit. */
static void test_all_indices_doubled(void **state)
{
    static double once[PICTURE_FLOATS], doubled[PICTURE_FLOATS];

    (void)state;
    for (int how = 0; how < DRESSES; how++) {
        struct scene_builder b;
        int apart = 0;
        room_filled(&b, how, 1);
        render_picture(&b, 0, once);
        builder_release(&b);
        room_filled(&b, how, 2);
        render_picture(&b, 0, doubled);
        builder_release(&b);
        for (int i = 0; i < PICTURE_FLOATS; i++)
            apart += once[i] != doubled[i];
        if (apart > 0 || !(once[0] > 0))
            fail_msg("dress %d: %d of %d values are others", how, apart, PICTURE_FLOATS);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_priority),      cmocka_unit_test(test_inside),
        cmocka_unit_test(test_hidden),        cmocka_unit_test(test_camera_inside),
        cmocka_unit_test(test_no_interface),  cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_empty_interfaces), cmocka_unit_test(test_lamps_in_dye),
        cmocka_unit_test(test_all_indices_doubled),
    };
    return cmocka_run_group_tests_name("nested radiance", tests, NULL, NULL);
}
