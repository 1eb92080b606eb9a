/* Punctual lights against closed forms, triangles on the sphere, and what emitters do with
 * scenes that have few lights or odd ones. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/math/elementary.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/light/environment/spherical.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

static void assert_near(double got, double want, double tolerance)
{
    if (!(fabs(got - want) <= tolerance))
        fail_msg("%.9g is not %.9g +- %.3g", got, want, tolerance);
}

/* An image of float texels. */
static struct texture_image *image_of(const float *rgb, uint32_t width, uint32_t height)
{
    struct texture_image *out;
    struct error err = {0};
    struct buffer bytes = BUFFER_INIT;
    struct exr_options options = {0};
    struct image image;

    assert_int_equal(image_init(&image, width, height, 3, &err), STATUS_OK);
    memcpy(image.pixels, rgb, (size_t)width * height * 3 * sizeof(float));
    assert_int_equal(exr_encode(&bytes, &image, &options, &err), STATUS_OK);
    assert_int_equal(texture_image_new(&out, bytes.data, bytes.size, "test", &err), STATUS_OK);
    image_release(&image);
    buffer_release(&bytes);
    return out;
}

static struct scene_light light_of(enum scene_light_kind kind)
{
    struct scene_light light;

    scene_light_default(&light);
    light.kind = kind;
    light.position[0] = 1;
    light.position[1] = 2;
    light.position[2] = 3;
    light.direction[0] = light.direction[1] = 0;
    light.direction[2] = -1;
    light.intensity[0] = light.intensity[1] = light.intensity[2] = 10;
    light.range = 0;
    light.to_world = (struct transform_d){{{1, 0, 0, 1}, {0, 1, 0, 2}, {0, 0, 1, 3}}};
    light.projection_yfov_rad = PI_F / 2;
    light.projection_aspect = 2;
    return light;
}

/* The light of a description, in place of the one before. */
static void make(struct punctual **p, const struct scene_light *light, const struct texture_image *image)
{
    mem_free(*p);
    *p = light_row((int)light->kind)->create(light, image);
    assert_non_null(*p);
}

/* Irradiance at a point two metres from the light in that direction. */
static struct vec3 shine(const struct punctual *p, struct vec3 towards)
{
    static light_sample_function *const samples[] = {
#define SAMPLE_OF(KIND, prefix, ...) [LIGHT_##KIND] = prefix##_sample,
        LIGHT_KINDS_LISTED(SAMPLE_OF)
#undef SAMPLE_OF
    };
    struct vec3 d = vec3_normalize(towards);
    struct light_context context = {.p = vec3_mad(vec3_make(1, 2, 3), d, 2)};
    struct light_sample out = {.pdf = 0.25f};

    if (!samples[p->kind](NULL, p, &context, 0, 0, &out))
        return vec3_splat(0);
    assert_near((double)out.distance, 2, 1e-6);
    assert_near((double)vec3_dot(out.direction, d), -1, 1e-6);
    assert_true(out.delta && out.pdf == 0.25f && !out.on_face);
    return out.radiance;
}

static void test_falloffs(void **state)
{
    struct scene_light light = light_of(LIGHT_SPOT);
    struct punctual *p = NULL;

    (void)state;
    light.inner_cone_rad = 0.3f;
    light.outer_cone_rad = 0.7f;
    for (int falloff = 0; falloff < FALLOFF_COUNT; falloff++) {
        light.falloff = (enum scene_falloff)falloff;
        make(&p, &light, NULL);
        for (int i = 0; i <= 40; i++) {
            double angle = i * 0.02, t;
            struct vec3 d = {(float)sin(angle), 0, -(float)cos(angle)};

            t = fmin(1, fmax(0, (cos(angle) - cos(0.7)) / (cos(0.3) - cos(0.7))));
            assert_near((double)shine(p, d).x,
                        2.5 * t * t * (falloff == FALLOFF_GLTF ? 1 : falloff == FALLOFF_FOURTH ? t * t : 3 - 2 * t), 1e-5);
        }
    }
    light.inner_cone_rad = light.outer_cone_rad; /* a hard edge */
    make(&p, &light, NULL);
    assert_near((double)shine(p, vec3_make(0.6f, 0, -1)).x, 2.5, 1e-6);
    assert_near((double)shine(p, vec3_make(1, 0, -1)).x, 0, 0);
    mem_free(p);
}

/* KHR_lights_punctual's window: 1 - (distance / range)^4, nothing beyond; range 0 has none. */
static void test_range(void **state)
{
    static const float ranges[] = {0, 1.5f, 2, 2.2f, 3, 10};
    struct scene_light light = light_of(LIGHT_POINT);
    struct punctual *p = NULL;

    (void)state;
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        double q = 2 / (double)ranges[k];

        light.range = ranges[k];
        make(&p, &light, NULL);
        assert_near((double)shine(p, vec3_make(0.6f, 0, -1)).x, ranges[k] > 0 ? 2.5 * fmax(0, 1 - q * q * q * q) : 2.5,
                    1e-5);
    }
    mem_free(p);
}

static void test_projection(void **state)
{
    static const float slide[2 * 2 * 3] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1};
    struct texture_image *image = image_of(slide, 2, 2);
    struct scene_light light = light_of(LIGHT_PROJECTION);
    struct light_weight weight = {0};
    struct punctual *p = NULL;
    struct vec3 e;

    (void)state;
    make(&p, &light, image);
    /* Half a slide is 2 wide and 1 high one metre ahead; texel centres at its quarters. */
    e = shine(p, vec3_make(-1, 0.5f, -1));
    assert_near((double)e.x, 2.5, 1e-5);
    assert_near((double)e.y, 0, 1e-5);
    e = shine(p, vec3_make(1, 0.5f, -1));
    assert_near((double)e.y, 2.5, 1e-5);
    e = shine(p, vec3_make(-1, -0.5f, -1));
    assert_near((double)e.z, 2.5, 1e-5);
    assert_near((double)e.x, 0, 1e-5);
    e = shine(p, vec3_make(0, 0, -1));
    assert_near((double)e.x, 1.25, 1e-5);
    assert_true(vec3_is_black(shine(p, vec3_make(2.05f, 0, -1))));
    assert_true(vec3_is_black(shine(p, vec3_make(0, 1.02f, -1))));
    assert_true(vec3_is_black(shine(p, vec3_make(0, 0, 1))));
    assert_false(vec3_is_black(shine(p, vec3_make(1.95f, 0.98f, -1))));
    make(&p, &light, NULL); /* white */
    assert_near((double)shine(p, vec3_make(1.9f, 0, -1)).y, 2.5, 1e-5);
    /* Solid angle of a 4 x 2 rectangle at 1: 4 asin(2 / sqrt(5 * 2)). */
    projection_light_weigh(NULL, p, &weight);
    assert_near(weight.power, 10 * 4 * asin(2 / sqrt(10.0)), 1e-4);
    mem_free(p);
    texture_image_free(image);
}

/* Laid out as an environment, in the light's own axes, which are turned here. */
static void test_goniometric(void **state)
{
    static float profile[8 * 4 * 3];
    struct scene_light light = light_of(LIGHT_GONIOMETRIC);
    struct texture_image *image;
    struct punctual *p = NULL;

    (void)state;
    for (int i = 0; i < 32; i++) {
        profile[3 * i] = (float)(i % 8);     /* column */
        profile[3 * i + 1] = (float)(i / 8); /* row */
        profile[3 * i + 2] = 1;
    }
    image = image_of(profile, 8, 4);
    light.to_world = (struct transform_d){{{0, 0, 1, 1}, {0, 1, 0, 2}, {-1, 0, 0, 3}}};
    make(&p, &light, image);
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 8; column++) {
            double theta = PI_D * (row + 0.5) / 4, phi = 2 * PI_D * ((column + 0.5) / 8 - 0.5);
            struct vec3 local = {(float)(sin(theta) * cos(phi)), (float)cos(theta),
                                 (float)(sin(theta) * sin(phi))};
            struct vec3 e = shine(p, vec3_make(local.z, local.y, -local.x));

            assert_near((double)e.x, 2.5 * column, 1e-4);
            assert_near((double)e.y, 2.5 * row, 1e-4);
        }
    mem_free(p);
    texture_image_free(image);
}

/* Every kind of the scene's list is made by its row, without an image too, and can be weighed. Without
 * one a goniometric light is a point. */
static void test_rows(void **state)
{
    static const double power[LIGHT_KIND_COUNT] = {
        [LIGHT_POINT] = 10 * 4 * PI_D,
        [LIGHT_SPOT] = 10 * 2 * PI_D * (1 - 0.70710678),
        [LIGHT_DIRECTIONAL] = 10 * PI_D * 9,
        [LIGHT_GONIOMETRIC] = 10 * 4 * PI_D,
        [LIGHT_PROJECTION] = 10 * 4 * 0.68471920, /* asin(2 / sqrt(10)) */
    };
    const struct render_scene scene = {.bounds_radius = 3};
    struct punctual *p = NULL;

    (void)state;
    for (int kind = 0; kind < LIGHT_KIND_COUNT; kind++) {
        struct scene_light light = light_of((enum scene_light_kind)kind);
        struct light_weight weight = {0};
        struct vec3 e;

        light.inner_cone_rad = 0;
        light.outer_cone_rad = PI_F / 4;
        make(&p, &light, NULL);
        assert_int_equal(p->kind, kind == LIGHT_GONIOMETRIC ? LIGHT_POINT : kind);
        light_row((int)p->kind)->weigh(&scene, p, &weight);
        assert_near(weight.power, power[kind], 1e-4 * power[kind]);
        if (kind == LIGHT_DIRECTIONAL)
            continue; /* shine knows places alone */
        e = shine(p, vec3_make(0, 0, -1));
        assert_near((double)e.y, 2.5, 1e-5);
    }
    mem_free(p);
}

/* A light whose cone, slide and range are drawn at random, and its bounds. */
static void make_random(struct punctual **p, enum scene_light_kind kind, struct test_random *random,
                        struct light_bounds *bounds)
{
    struct scene_light light = light_of(kind);
    struct light_weight weight = {0};

    light.outer_cone_rad = 0.05f + 1.5f * test_random_float(random);
    light.inner_cone_rad = light.outer_cone_rad * test_random_float(random);
    light.projection_yfov_rad = 0.05f + 2.5f * test_random_float(random);
    light.range = test_random_float(random) < 0.5f ? 0 : 1 + 3 * test_random_float(random);
    make(p, &light, NULL);
    light_row((int)(*p)->kind)->weigh(NULL, *p, &weight);
    *bounds = weight.bounds;
    bounds->intensity = 1;
}

/* No light shines where its bounds say that it cannot: there the tree would never choose it. */
static void test_bounds_hold(void **state)
{
    enum { LIGHTS = 60, PLACES = 200 };
    struct test_random random = {23};
    struct punctual *p = NULL;
    struct error err = {0};

    (void)state;
    for (int kind = 0; kind < LIGHT_KIND_COUNT; kind++) {
        int lit = 0, excluded = 0;

        if (kind == LIGHT_DIRECTIONAL)
            continue; /* the tree holds what has a place */
        for (int k = 0; k < LIGHTS; k++) {
            struct light_bounds bounds[2];
            struct light_tree tree;

            make_random(&p, LIGHT_POINT, &random, &bounds[1]);
            make_random(&p, (enum scene_light_kind)kind, &random, &bounds[0]);
            bounds[1].reach = INFINITY; /* the other one can always be chosen */
            assert_int_equal(light_tree_init(&tree, bounds, 2, &err), STATUS_OK);
            for (int i = 0; i < PLACES; i++) {
                struct vec3 d =
                    vec3_normalize(vec3_make(2 * test_random_float(&random) - 1, 2 * test_random_float(&random) - 1,
                                             2 * test_random_float(&random) - 1));
                float odds = light_tree_odds(&tree, NULL, vec3_mad(vec3_make(1, 2, 3), d, 2), vec3_splat(0), 0);
                int shines = !vec3_is_black(shine(p, d));

                assert_true(odds > 0 || !shines);
                lit += shines;
                excluded += !(odds > 0);
            }
            light_tree_release(&tree);
        }
        assert_true(lit > LIGHTS * PLACES / 100 && excluded > LIGHTS * PLACES / 100);
    }
    mem_free(p);
}

/* A light that another one outshines may be the only one in sight: it keeps a share. What keeps one is the same for all places,
 * so that the light which matters loses an eighth of its samples at most. */
static void test_outshone_lights(void **state)
{
    enum { LIGHTS = 1024, LEVELS_BELOW = 16 };
    static struct light_bounds bounds[LIGHTS];
    struct test_random random = {31};
    struct error err = {0};

    (void)state;
    for (uint32_t count = 2; count <= LIGHTS; count *= 8) {
        for (int k = 0; k < 50; k++) {
            uint32_t strong = (uint32_t)(test_random_float(&random) * (float)count) % count;
            struct light_tree tree;
            double sum = 0, odds;

            for (uint32_t i = 0; i < count; i++) {
                struct vec3 at = vec3_make(test_random_float(&random), test_random_float(&random), test_random_float(&random));
                bounds[i] = (struct light_bounds){.min = at, .max = at, .axis = {0, 0, 1}, .spread_rad = REAL_PI,
                                                  .emission_rad = REAL_PI / 2, .reach = INFINITY, .lamp = i,
                                                  .intensity = i == strong ? 1e9f : 1};
            }
            assert_int_equal(light_tree_init(&tree, bounds, count, &err), STATUS_OK);
            odds = (double)light_tree_odds(&tree, NULL, vec3_splat(0.5f), vec3_splat(0), strong);
            for (uint32_t i = 0; i < count; i++)
                sum += (double)light_tree_odds(&tree, NULL, vec3_splat(0.5f), vec3_splat(0), i);
            assert_true(odds >= 1 - 1.0 / 8 - LEVELS_BELOW * 0x1p-10 && fabs(sum - 1) < 1e-4);
            assert_true(count > 2 || odds <= 1 - 1.0 / 16);
            light_tree_release(&tree);
        }
    }
}

/* Solid angles: an octant, a known tiny one, and areas of parts add up; samples are uniform:
 * the share that falls into one half is that half's share of the solid angle. */
static void test_spherical_triangles(void **state)
{
    struct test_random random = {12};
    struct spherical_triangle t, half;
    struct vec3 o = {0, 0, 0}, d = {0, 0, 0};

    (void)state;
    spherical_triangle_init(&t, o, vec3_make(3, 0, 0), vec3_make(0, 2, 0), vec3_make(0, 0, 1));
    assert_near((double)t.solid_angle, PI_D / 2, 1e-6);
    spherical_triangle_init(&t, o, vec3_make(0, 0, 1000), vec3_make(1e-3f, 0, 1000), vec3_make(0, 2e-3f, 1000));
    assert_near((double)t.solid_angle, 1e-12, 1e-18);
    spherical_triangle_init(&t, o, vec3_make(0, 0, 0), vec3_make(1, 0, 0), vec3_make(0, 1, 0));
    assert_true(t.solid_angle == 0);
    for (int k = 0; k < 24; k++) {
        enum { DRAWS = 20000 };
        float size = k % 4 == 0 ? 1e-3f : 1;
        struct vec3 c[3], middle, normal;
        double share;
        int inside = 0;

        for (int i = 0; i < 3; i++)
            c[i] = vec3_make(size * (4 * test_random_float(&random) - 2), size * (4 * test_random_float(&random) - 2),
                             0.3f + size * test_random_float(&random));
        middle = vec3_lerp(c[1], c[2], 0.4f);
        spherical_triangle_init(&t, o, c[0], c[1], c[2]);
        spherical_triangle_init(&half, o, c[0], c[1], middle);
        share = (double)half.solid_angle / (double)t.solid_angle;
        normal = vec3_cross(c[0], middle);
        if (vec3_dot(normal, c[1]) < 0)
            normal = vec3_neg(normal);
        for (int i = 0; i < DRAWS; i++) {
            assert_true(spherical_triangle_sample(&t, test_random_float(&random), test_random_float(&random), &d));
            assert_near((double)vec3_length(d), 1, 1e-6);
            for (int e = 0; e < 3; e++) { /* within the three planes */
                struct vec3 plane = vec3_normalize(vec3_cross(c[e], c[(e + 1) % 3]));
                float side = vec3_dot(plane, vec3_normalize(c[(e + 2) % 3]));

                assert_true(vec3_dot(plane, d) * (side < 0 ? -1 : 1) > -1e-6f);
            }
            inside += vec3_dot(normal, d) > 0;
        }
        assert_near((double)inside / DRAWS, share, 4.5 * sqrt(share * (1 - share) / DRAWS) + 1e-4);
    }
}

/* A lamp of two triangles is one choice: no walk, odds by area. */
static void test_one_lamp_is_one_leaf(void **state)
{
    struct render_settings settings = builder_settings(4, 4, 1);
    struct light_context query = {.p = {0.3f, 0, 0.2f}, .n = {0, 1, 0}};
    struct render_scene *scene;
    struct scene_builder b;
    struct scene_material *m;

    (void)state;
    builder_init(&b);
    m = builder_lambert(&b, 0);
    m->emission[0] = 1;
    builder_place(&b, builder_quad(&b), 0, vec3_make(1, -1, 1), vec3_make(0, 2, 0));
    builder_camera(&b, vec3_make(0, 0, 3), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->emitters.tree.node_count, 1);
    assert_near((double)emitters_face_pdf(scene, &query, 0, 4, 0.5f, 2), 0.5 * 4 / 1, 1e-6);
    render_scene_free(scene);

    /* A black point light beside it changes nothing. */
    builder_light(&b, LIGHT_POINT)->intensity[0] = 0;
    b.scene.lights[0].intensity[1] = b.scene.lights[0].intensity[2] = 0;
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->emitters.tree.node_count, 1);
    render_scene_free(scene);
    builder_release(&b);
}

/* A ray that meets a lamp's face knows which of the lights that is; of what is no lamp it knows none. */
static void test_which_face(void **state)
{
    struct render_settings settings = builder_settings(4, 4, 1);
    struct render_scene *scene;
    struct scene_builder b;
    uint32_t quad;

    (void)state;
    builder_init(&b);
    quad = builder_quad(&b);
    for (int i = 0; i < 4; i++) { /* the second is dark */
        struct scene_material *m = builder_lambert(&b, 0);

        m->emission[0] = i == 1 ? 0 : 1;
        m->double_sided = 1;
        builder_place(&b, quad, builder_last_material(&b), vec3_splat(1), vec3_make(4 * (float)i, 0, 0));
    }
    builder_camera(&b, vec3_make(0, 5, 3), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->emitters.face_count, 6);
    for (uint32_t i = 0; i < 8; i++) {
        struct ray ray = {.t_max = INFINITY};
        struct vec3 corner[3], middle;
        struct surface s;
        struct hit hit;
        uint32_t face;

        triangle_of_instance(scene, &scene->instances[i / 2], i % 2, 0, corner);
        middle = vec3_scale(vec3_add(corner[0], vec3_add(corner[1], corner[2])), 1.0f / 3);
        ray.direction = vec3_normalize(vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0])));
        ray.origin = vec3_mad(middle, ray.direction, -1);
        assert_true(accel_intersect(scene->accel, &ray, NULL, &hit));
        surface_from_hit(scene, &ray, &hit, &s);
        face = emitters_face_at(scene, &s);
        if (i / 2 == 1) {
            assert_true(face == EMITTERS_NO_FACE);
            continue;
        }
        assert_true(face < 6);
        assert_int_equal(scene->emitters.faces[face].instance, hit.instance);
        assert_int_equal(scene->emitters.faces[face].triangle, hit.triangle);
        s.material = &scene->materials[1]; /* a part of a mix */
        assert_true(emitters_face_at(scene, &s) == EMITTERS_NO_FACE);
    }
    render_scene_free(scene);
    builder_release(&b);
}

/* Where the emissive texture is black there is no light to choose, and none to be met. */
static void test_dark_triangles(void **state)
{
    enum { SIDE = 8 };
    struct render_settings settings = builder_settings(4, 4, 1);
    struct light_context query = {.p = {0, 0, 0}};
    float rgb[SIDE * SIDE * 3] = {0};
    struct render_scene *scene;
    struct scene_builder b;
    struct scene_material *m;
    uint32_t quad, texture;

    (void)state;
    for (int y = 0; y < SIDE; y++) /* light in the left column alone */
        rgb[y * SIDE * 3] = 1;
    builder_init(&b);
    quad = builder_quad(&b);
    texture = builder_texture(&b, rgb, SIDE, SIDE);
    for (int right = 0; right < 2; right++) {
        m = builder_lambert(&b, 0);
        m->emission[0] = m->emission[1] = m->emission[2] = 1;
        m->double_sided = 1;
        m->emission_texture.texture = (int32_t)texture;
        m->emission_texture.uv_transform[0][0] = 0.4f;
        m->emission_texture.uv_transform[0][1] = 0;
        m->emission_texture.uv_transform[0][2] = right ? 0.45f : 0;
        m->emission_texture.uv_transform[1][0] = 0;
        m->emission_texture.uv_transform[1][1] = 1;
        m->emission_texture.uv_transform[1][2] = 0;
        builder_place(&b, quad, builder_last_material(&b), vec3_splat(1), vec3_make(right ? 2 : -2, 2, 0));
    }
    builder_camera(&b, vec3_make(0, 0, 3), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->emitters.face_count, 4);
    for (uint32_t i = 0; i < 4; i++) {
        float pdf = emitters_face_pdf(scene, &query, i, 4, 0.5f, 2);

        assert_int_equal(emitters_is_dark(&scene->emitters, i), i >= 2);
        assert_true(i < 2 ? pdf > 0 : pdf == 0);
    }
    for (int i = 0; i < 1000; i++) {
        struct light_sample light;
        float u = ((float)i + 0.5f) / 1000, v = (float)(i * 377 % 1000) / 1000;

        if (emitters_sample(scene, &query, u, v, &light))
            assert_true(light.direction.x < 0);
    }
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_falloffs),
        cmocka_unit_test(test_range),
        cmocka_unit_test(test_projection),
        cmocka_unit_test(test_goniometric),
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_bounds_hold),
        cmocka_unit_test(test_outshone_lights),
        cmocka_unit_test(test_spherical_triangles),
        cmocka_unit_test(test_one_lamp_is_one_leaf),
        cmocka_unit_test(test_dark_triangles),
        cmocka_unit_test(test_which_face),
    };

    return cmocka_run_group_tests_name("emitters", tests, NULL, NULL);
}
