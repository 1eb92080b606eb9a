/* Rays start where they are said to start: nothing near a surface is lost, nothing is met twice.
 *
 *   test_contact [RAYS]     leave exact cubes by so many rays instead of the suite's few
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/base/exact.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

static uint64_t cube_rays = 1500000;

/* Three perpendicular vectors of length 3. In whole numbers, so that what is built of them is plane
 * and square to the last bit. The identity times 3, and a base without any 0. */
static const float bases[2][3][3] = {{{3, 0, 0}, {0, 3, 0}, {0, 0, 3}},
                                     {{2, 1, 2}, {1, 2, -2}, {-2, 2, 1}}};

static struct vec3 in_base(int base, float x, float y, float z)
{
    const float(*b)[3] = bases[base];

    return vec3_make(x * b[0][0] + y * b[1][0] + z * b[2][0], x * b[0][1] + y * b[1][1] + z * b[2][1],
                     x * b[0][2] + y * b[1][2] + z * b[2][2]);
}

static void set(float out[3], struct vec3 v)
{
    out[0] = v.x;
    out[1] = v.y;
    out[2] = v.z;
}

static const uint32_t cube_indices[36] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                          2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};

/* A closed box; low and high in thirds of the base's vectors. */
static uint32_t box(struct scene_builder *b, int base, struct vec3 low, struct vec3 high, struct vec3 shift)
{
    float p[24];

    for (int k = 0; k < 8; k++)
        set(p + 3 * k,
            vec3_add(shift, in_base(base, k & 1 ? high.x : low.x, k & 2 ? high.y : low.y, k & 4 ? high.z : low.z)));
    return builder_mesh(b, p, NULL, 8, cube_indices, 12, 0);
}

static uint32_t ground(struct scene_builder *b, int base, float half)
{
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    float p[12];

    set(p, in_base(base, -half, 0, -half));
    set(p + 3, in_base(base, -half, 0, half));
    set(p + 6, in_base(base, half, 0, half));
    set(p + 9, in_base(base, half, 0, -half));
    return builder_mesh(b, p, NULL, 4, indices, 2, 0);
}

/* ---- contact shadows ---------------------------------------------------------------------- */

enum { COLUMNS = 12, ROWS = 8 };
#define THIRD 0x1p-8f /* a third of the box's half: the box is 2.3 cm wide and high */

/* A box that rests on the middle of a ground, in the sun at 45 degrees; the camera looks down on
 * the shadow's eight columns and on four that are lit. */
static void shadow_picture(int base, float half, double *mean)
{
    struct render_settings settings = builder_settings(COLUMNS, ROWS, 16);
    struct vec3 sun = in_base(base, 1, -1, 0), up = in_base(base, 0, 1, 0);
    struct vec3 middle = in_base(base, 2.5f * THIRD, 0, 0);
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_light *light;
    struct scene_builder b;

    settings.max_depth = 1;
    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, ground(&b, base, half), 0, vec3_splat(1), vec3_splat(0));
    builder_place(&b, box(&b, base, vec3_make(-THIRD, 0, -THIRD), vec3_make(THIRD, 2 * THIRD, THIRD), vec3_splat(0)), 0,
                  vec3_splat(1), vec3_splat(0));
    light = builder_light(&b, LIGHT_DIRECTIONAL);
    set(light->direction, vec3_normalize(sun));
    for (int c = 0; c < 3; c++)
        light->intensity[c] = (float)M_PI;
    builder_camera(&b, vec3_add(middle, vec3_scale(up, 1.0f / 3)), middle, 6 * THIRD);
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    render_scene_free(scene);
    builder_release(&b);
}

static void test_contact_shadow(void **state)
{
    static const float halves[] = {1666, 5000, 166666}; /* 10, 30 and 1,000 km of ground */
    static double small[COLUMNS * ROWS * 3], large[COLUMNS * ROWS * 3];
    int wrong = 0;

    (void)state;
    for (int base = 0; base < 2; base++) {
        double darkest = 1, lightest = 0;
        shadow_picture(base, 0.25f, small);
        for (size_t i = 0; i < COLUMNS * ROWS; i++) {
            darkest = fmin(darkest, small[3 * i]);
            lightest = fmax(lightest, small[3 * i]);
        }
        assert_true(darkest == 0);
        assert_true(fabs(lightest - sqrt(0.5)) < 1e-5);
        for (size_t k = 0; k < sizeof halves / sizeof *halves; k++) {
            shadow_picture(base, halves[k], large);
            for (size_t i = 0; i < COLUMNS * ROWS; i++) {
                /* Without a turn the columns are the shadow's: 8, and the edge's pixels. */
                int inner = base == 0 && i / COLUMNS > 1 && i / COLUMNS < ROWS - 2;
                double expected = inner && i % COLUMNS > 1 && i % COLUMNS < 6 ? 0
                                  : inner && i % COLUMNS > 9 ? sqrt(0.5) : small[3 * i];
                if (fabs(large[3 * i] - expected) <= 0.03)
                    continue;
                if (wrong++ == 0)
                    printf("# base %d, ground %g: column %zu, row %zu is %.4f instead of %.4f\n", base,
                           (double)halves[k] * 6, i % COLUMNS, i / COLUMNS, large[3 * i], expected);
            }
        }
    }
    figure_within("wrong pixels of 576, shadows of a 2 cm box on up to 1,000 km of ground", wrong, 0, 0,
                  "closed form, tolerance 0.03");
}

/* ---- a fan of long triangles --------------------------------------------------------------- */

enum { SLIVERS = 64, FAN_RAYS = 200000 };

/* A disk of slivers as long as its radius, around the origin; up is +y. */
static uint32_t fan(struct scene_builder *b, float radius)
{
    float p[3 * (SLIVERS + 1)] = {0};
    uint32_t indices[3 * SLIVERS];

    for (uint32_t i = 0; i < SLIVERS; i++) {
        float sine, cosine;
        det_sincos(2 * PI_F * (float)i / SLIVERS, &sine, &cosine);
        set(p + 3 * (i + 1), vec3_make(radius * cosine, 0, -radius * sine));
        indices[3 * i] = 0;
        indices[3 * i + 1] = i + 1;
        indices[3 * i + 2] = (i + 1) % SLIVERS + 1;
    }
    return builder_mesh(b, p, NULL, SLIVERS + 1, indices, SLIVERS, 0);
}

/* How far inside the square of half a metre the ray crosses the height `y`, metres; below 0: outside of it. */
static float inside_square(const struct ray *ray, float y)
{
    const float t = y / ray->direction.y;

    return 0.5f - fmaxf(fabsf(ray->origin.x + t * ray->direction.x), fabsf(ray->origin.z + t * ray->direction.z));
}

static struct vec3 hemisphere(struct test_random *random, struct vec3 n);

/* A block 30 cm above a disk of 100 m: what rays from below it meet is known but for 3 cm at its rim. A start near the
 * edge of a sliver is moved inwards, and went 12 cm towards the sliver's middle: light came through the block. */
static void test_fan(void **state)
{
    struct render_settings settings = builder_settings(1, 1, 1);
    struct test_random random = {64};
    struct render_scene *scene;
    struct scene_builder b;
    uint64_t wrong = 0, met = 0;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, fan(&b, 100), 0, vec3_splat(1), vec3_splat(0));
    builder_place(&b, box(&b, 0, vec3_make(-0.5f / 3, 0.1f, -0.5f / 3), vec3_make(0.5f / 3, 0.2f, 0.5f / 3), vec3_splat(0)),
                  0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 2, 3), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    for (uint64_t i = 0; i < FAN_RAYS; i++) {
        const float x = test_random_float(&random) - 0.5f, z = test_random_float(&random) - 0.5f;
        struct ray ray = {.origin = vec3_make(x, 0.2f, z), .direction = vec3_make(0, -1, 0), .t_max = INFINITY};
        struct surface s;
        struct hit hit;
        float inside;
        int is_met;

        assert_true(accel_intersect(scene->accel, &ray, NULL, &hit));
        surface_from_hit(scene, &ray, &hit, &s);
        surface_leave(&s, hemisphere(&random, s.ng), &ray);
        inside = inside_square(&ray, 0.3f);
        if (fabsf(inside) < 0.03f)
            continue;
        is_met = i % 2 ? accel_intersect(scene->accel, &ray, NULL, &hit) : accel_occluded(scene->accel, &ray, NULL);
        met += (uint64_t)(inside > 0);
        if (is_met == (inside > 0) || wrong++ > 0)
            continue;
        printf("# from %g, %g at %g of the block's rim: %s\n", (double)x, (double)z, (double)inside,
               is_met ? "met" : "not met");
    }
    assert_true(met > FAN_RAYS / 4);
    render_scene_free(scene);
    builder_release(&b);
    figure_within("rays from a fan of 100 m that pass a block 30 cm above it, or meet it from beside", (double)wrong, 0,
                  0, "closed form, 3 cm at the rim left out");
}

/* ---- rays that leave ---------------------------------------------------------------------- */

/* Mostly near an edge or a corner. */
static void weights(struct test_random *random, float *b1, float *b2)
{
    float u = test_random_float(random), v = test_random_float(random);

    switch (test_random_u64(random) % 4) {
    case 0: u *= 1e-3f; break;
    case 1:
        u *= 1e-6f * v;
        v *= 1e-6f;
        break;
    case 2: u *= 1e-7f; break;
    }
    *b1 = 1 - sqrtf(u);
    *b2 = v * sqrtf(u);
}

static struct vec3 hemisphere(struct test_random *random, struct vec3 n)
{
    struct basis frame = basis_from_normal(n);
    float u = test_random_float(random), sine, cosine;

    if (test_random_u64(random) % 4 == 0)
        u = 1 - u * 1e-5f; /* grazing */
    det_sincos(2 * PI_F * test_random_float(random), &sine, &cosine);
    return vec3_normalize(basis_to_world(&frame, vec3_make(sqrtf(u) * cosine, sqrtf(u) * sine, sqrtf(1 - u))));
}

/* A ray from `from` to a random point of a random triangle of instance 0, and what it meets. */
static int aim(const struct render_scene *scene, struct test_random *random, struct vec3 from, float time,
               struct surface *s)
{
    uint32_t count = scene->meshes[scene->instances[0].mesh].triangle_count;
    struct ray ray = {.origin = from, .t_max = INFINITY, .time = time};
    struct vec3 corner[3], to;
    struct hit hit;
    float b1, b2;

    triangle_of_instance(scene, &scene->instances[0], (uint32_t)(test_random_u64(random) % count), time, corner);
    weights(random, &b1, &b2);
    to = vec3_add(vec3_scale(corner[0], 1 - b1 - b2), vec3_add(vec3_scale(corner[1], b1), vec3_scale(corner[2], b2)));
    ray.direction = vec3_normalize(vec3_sub(to, from));
    if (!accel_intersect(scene->accel, &ray, NULL, &hit))
        return 0;
    surface_from_hit(scene, &ray, &hit, s);
    return 1;
}

/* A direction that a rounding error or a few separate from the face's plane, on its outer side. */
static struct vec3 along(struct test_random *random, struct vec3 n)
{
    struct vec3 d = hemisphere(random, n);

    d = vec3_normalize(vec3_mad(d, n, -vec3_dot(d, n)));
    return vec3_normalize(vec3_mad(d, n, exp2f(-24.5f - test_random_float(random))));
}

/* By the face's exact normal: the rounded one calls some tangents outward that go inwards. */
static int goes_outwards(const struct render_scene *scene, const struct surface *s, const struct ray *ray)
{
    double corner[3][3], n[3], direction[3];

    triangle_exact_corners(scene, 0, s->triangle, 0, corner);
    exact_normal(corner, n);
    exact_vec(ray->direction, direction);
    return vec3_dot(ray->direction, s->ng) > 0 && exact_dot(n, direction) > 0;
}

/* Rays that leave an exact cube outwards never meet it: how many do. `flat`: all of them along its faces. */
static uint64_t leave_cube(int base, int exponent, float shift, int flat, uint64_t rays)
{
    struct render_settings settings = builder_settings(1, 1, 1);
    float third = ldexpf(1, exponent);
    struct vec3 at = vec3_make(shift, -0.5f * shift, 0.25f * shift);
    struct test_random random = {(uint64_t)exponent + 99};
    struct render_scene *scene;
    struct scene_builder b;
    uint64_t left = 0, met = 0;

    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, box(&b, base, vec3_splat(-third), vec3_splat(third), at), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_add(at, vec3_make(0, 0, 9)), at, 1);
    scene = builder_build(&b, &settings);
    for (uint64_t i = 0; i < rays; i++) {
        struct vec3 away = vec3_make(test_random_float(&random) - 0.5f, test_random_float(&random) - 0.5f,
                                     test_random_float(&random) - 0.5f);
        struct surface s;
        struct ray ray;
        struct hit hit;

        if (!aim(scene, &random, vec3_mad(at, away, 40 * third), 0, &s) || !s.front)
            continue;
        surface_leave(&s, flat ? along(&random, s.ng) : hemisphere(&random, s.ng), &ray);
        if (!goes_outwards(scene, &s, &ray))
            continue;
        left++;
        ray.contacts = flat || i % 2;
        if (!(i % 4 < 2 ? accel_intersect(scene->accel, &ray, NULL, &hit) : accel_occluded(scene->accel, &ray, NULL)))
            continue;
        if (met++ == 0)
            printf("# base %d, third 2^%d at %g: a ray met the cube that it left at triangle %u, "
                   "weights %g and %g, cosine %g\n", base, exponent, (double)shift, s.triangle,
                   (double)s.b1, (double)s.b2, (double)vec3_dot(ray.direction, s.ng));
    }
    assert_true(left > rays / 8);
    render_scene_free(scene);
    builder_release(&b);
    return met;
}

static void test_leaving_cubes(void **state)
{
    static const struct { int exponent; float shift; } cases[] = {
        {0, 0}, {-20, 0}, {20, 0}, {0, 1024}, {-10, 1}, {-6, 4096}, {10, 1048576}, {-3, 65536}};
    enum { CASES = sizeof cases / sizeof *cases };
    uint64_t met = 0;

    (void)state;
    for (int base = 0; base < 2; base++)
        for (size_t k = 0; k < CASES; k++)
            met += leave_cube(base, cases[k].exponent, cases[k].shift, 0, cube_rays / (2 * CASES));
    /* Embree's t can be any number there. */
    for (int exponent = 0; exponent <= 20; exponent += 20)
        met += leave_cube(1, exponent, 0, 1, 2 * cube_rays);
    figure_within("rays that meet the cube which they leave outwards", (double)met, 0, 0, "exact");
}

/* ---- rays that start on an edge ----------------------------------------------------------- */

/* Two faces of the cube that meet at an edge and do not lie in one plane; the edge's ends are
 * corners of both. 0: they do not. */
static int share_edge(double a[3][3], double b[3][3], double ends[2][3])
{
    double n[3], m[3], across[3];
    int count = 0;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (memcmp(a[i], b[k], sizeof a[i]) == 0 && count < 2)
                memcpy(ends[count++], a[i], sizeof a[i]);
    exact_normal(a, n);
    exact_normal(b, m);
    exact_cross(n, m, across);
    return count == 2 && exact_dot(across, across) > 0;
}

/* Unit, and into the cube. */
static void inwards(double corner[3][3], const double middle[3], double out[3])
{
    double to_middle[3], length;

    exact_normal(corner, out);
    exact_sub(middle, corner[0], to_middle);
    length = sqrt(exact_dot(out, out));
    if (exact_dot(out, to_middle) < 0)
        length = -length;
    for (int a = 0; a < 3; a++)
        out[a] /= length;
}

/* From a place on the edge, up from one face: towards the other, along it, or away from it. */
static int leave_edge(const struct render_scene *scene, uint32_t from, uint32_t other, double ends[2][3],
                      const double up[3], const double aside[3], int part)
{
    int wrong = 0;

    for (int lean = -1; lean <= 1; lean++)
        for (int slant = -1; slant <= 1; slant++) {
            struct ray ray = {.t_max = INFINITY, .left_count = 1, .left = {{0, from}}};
            double place[3], way[3], corner[3][3], n[3];
            int met, on_other;
            struct hit hit;

            for (int a = 0; a < 3; a++) {
                place[a] = ends[0][a] + part / 8.0 * (ends[1][a] - ends[0][a]);
                way[a] = up[a] + 0.5 * lean * aside[a] + 0.25 * slant * (ends[1][a] - ends[0][a]) / 16;
            }
            ray.origin = exact_round(place, ray.rest);
            ray.direction = vec3_normalize(vec3_make((float)way[0], (float)way[1], (float)way[2]));
            ray.off = vec3_make((float)up[0], (float)up[1], (float)up[2]);
            ray.contacts = part & 1;
            met = accel_intersect(scene->accel, &ray, NULL, &hit);
            if (!met) {
                wrong++;
                continue;
            }
            triangle_exact_corners(scene, hit.instance, hit.triangle, 0, corner);
            exact_normal(corner, n);
            exact_sub(place, corner[0], way);
            on_other = exact_dot(n, way) == 0;
            if (hit.instance != 0 || on_other != (lean < 0)) {
                if (wrong++ == 0)
                    printf("# from %u on the edge to %u, lean %d, slant %d: met %u of %u\n", from, other, lean, slant,
                           hit.triangle, hit.instance);
                continue;
            }
            if (lean == 0)
                continue; /* it would end in the other face's plane */
            ray.t_max = 1;
            wrong += accel_occluded(scene->accel, &ray, NULL) != (lean < 0);
        }
    return wrong;
}

/* The box from -half to half around `at`. */
static void put_cube(struct scene_builder *b, const double at[3], float half, int inverted)
{
    uint32_t wound[36];
    float p[24];

    for (int i = 0; i < 24; i++)
        p[i] = (float)at[i % 3] + ((i / 3) >> (i % 3) & 1 ? half : -half);
    for (int i = 0; i < 36; i++)
        wound[i] = cube_indices[inverted ? 35 - i : i];
    builder_place(b, builder_mesh(b, p, NULL, 8, wound, 12, 0), 0, vec3_splat(1), vec3_splat(0));
}

static int leave_edges(const double middle[3], int inverted)
{
    struct render_settings settings = builder_settings(1, 1, 1);
    struct vec3 at = vec3_make((float)middle[0], (float)middle[1], (float)middle[2]);
    struct render_scene *scene;
    struct scene_builder b;
    int edges = 0, wrong = 0;

    builder_init(&b);
    builder_lambert(&b, 1);
    put_cube(&b, middle, 6, inverted);
    put_cube(&b, middle, 24, inverted);
    builder_camera(&b, vec3_add(at, vec3_make(0, 0, 1)), at, 1);
    scene = builder_build(&b, &settings);
    for (uint32_t from = 0; from < 12; from++)
        for (uint32_t other = 0; other < 12; other++) {
            double a[3][3], d[3][3], ends[2][3], up[3], aside[3];
            triangle_exact_corners(scene, 0, from, 0, a);
            triangle_exact_corners(scene, 0, other, 0, d);
            if (!share_edge(a, d, ends))
                continue;
            inwards(a, middle, up);
            inwards(d, middle, aside);
            for (int part = 1; part < 8; part++)
                wrong += leave_edge(scene, from, other, ends, up, aside, part);
            edges++;
        }
    assert_int_equal(edges, 24);
    render_scene_free(scene);
    builder_release(&b);
    return wrong;
}

/* Inside of a cube of 12 m whose edges are exact, and which stands in another: a ray that starts on
 * one meets the other face there if it goes behind it, and only then. Whichever way the faces are
 * wound, and also where Embree's error is as large as the cube's faces. */
static void test_leaving_edges(void **state)
{
    static const double places[][3] = {{0, 0, 0}, {4096, -512, 1024}, {1048576, 131072, -65536}};
    int wrong = 0;

    (void)state;
    for (size_t i = 0; i < sizeof places / sizeof *places; i++)
        for (int inverted = 0; inverted < 2; inverted++)
            wrong += leave_edges(places[i], inverted);
    figure_within("of 9,072 rays from a cube's edges, those that meet the wrong face", wrong, 0, 0, "exact");
}

/* A box stands on a ground, the edges of its foot not the ground's own: from a place exactly below
 * its wall a ray that goes away from the box does not meet that wall. (Into the box it passes the
 * wall's lower edge, and may miss it.) */
static void test_leaving_contacts(void **state)
{
    static const float ground_corners[12] = {-100, 0, -300, -100, 0, 300, 900, 0, 300, 900, 0, -300};
    static const uint32_t ground_indices[6] = {0, 1, 2, 0, 2, 3};
    int met = 0;

    (void)state;
    for (int inverted = 0; inverted < 2; inverted++) {
        struct render_settings settings = builder_settings(1, 1, 1);
        struct render_scene *scene;
        struct scene_builder b;

        builder_init(&b);
        builder_lambert(&b, 1);
        builder_place(&b, builder_mesh(&b, ground_corners, NULL, 4, ground_indices, 2, 0), 0, vec3_splat(1),
                      vec3_splat(0));
        put_cube(&b, (double[3]){0, 6, 0}, 6, inverted);
        builder_camera(&b, vec3_make(0, 20, 0), vec3_splat(0), 1);
        scene = builder_build(&b, &settings);
        for (int i = 0; i < 200; i++) {
            float across = 0.01f * (float)(1 + i % 40);
            float z = (float)(i / 40 - 2) + 0.375f;
            struct ray ray = {.origin = {6, 0, z}, .t_max = 3, .left_count = 1, .left = {{0, 1}},
                              .contacts = 1,
                              .direction = vec3_normalize(vec3_make(across, 0.2f, 0.1f)),
                              .off = {0, 1, 0}, .inset = 10};
            met += accel_occluded(scene->accel, &ray, NULL);
        }
        render_scene_free(scene);
        builder_release(&b);
    }
    figure_within("of 400 rays away from a box's foot, those that meet its wall", met, 0, 0, "exact");
}

/* ---- rays that must not escape ------------------------------------------------------------ */

/* A closed room: of the rays that leave a wall inwards, mostly near an edge, the share that escapes,
 * or meets a wall from its other side. */
static double escaping(const float *corners, uint32_t count, const uint32_t *indices, uint32_t triangles, float scale,
                       float shift)
{
    struct render_settings settings = builder_settings(1, 1, 1);
    struct vec3 at = vec3_make(shift, -0.3f * shift, 0.7f * shift), middle = {0, 0, 0};
    struct test_random random = {17};
    struct render_scene *scene;
    struct scene_builder b;
    int left = 0, escaped = 0;
    float p[3 * 64];

    for (uint32_t i = 0; i < 3 * count; i++)
        p[i] = corners[i] * scale + (i % 3 == 0 ? at.x : i % 3 == 1 ? at.y : at.z);
    for (uint32_t i = 0; i < count; i++)
        middle = vec3_mad(middle, vec3_make(p[3 * i], p[3 * i + 1], p[3 * i + 2]), 1.0f / (float)count);
    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, builder_mesh(&b, p, NULL, count, indices, triangles, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, middle, vec3_add(middle, vec3_make(0, 0, 1)), 1);
    scene = builder_build(&b, &settings);
    for (int i = 0; i < 40000; i++) {
        struct surface s;
        struct ray ray;
        struct hit hit;
        int front;

        if (!aim(scene, &random, middle, 0, &s))
            continue; /* aimed at a vertex */
        front = s.front;
        for (int bounce = 0; bounce < 3; bounce++) {
            surface_leave(&s, hemisphere(&random, s.ng), &ray);
            if (vec3_dot(ray.direction, s.ng) <= 0)
                break;
            left++;
            if (i % 2)
                ray.contacts = 1;
            if (!accel_intersect(scene->accel, &ray, NULL, &hit) || !accel_occluded(scene->accel, &ray, NULL)) {
                escaped++;
                break;
            }
            surface_from_hit(scene, &ray, &hit, &s);
            if (s.front != front) { /* met from outside */
                escaped++;
                break;
            }
        }
    }
    assert_true(left > 50000);
    render_scene_free(scene);
    builder_release(&b);
    return (double)escaped / left;
}

static void test_closed_rooms(void **state)
{
    /* Its faces meet at two degrees; a millimetre from an edge the room is 30 micrometres high. */
    static const float needle[12] = {0, 0, 0, 1, 0.01f, 0, 0.02f, 1, 0.03f, 0.3f, 0.31f, 0.04f};
    static const uint32_t needle_indices[12] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
    static const float cube[24] = {-1, -1, -1, 1, -1, -1, -1, 1, -1, 1, 1, -1,
                                   -1, -1, 1,  1, -1, 1,  -1, 1, 1,  1, 1, 1};
    static const struct { float scale, shift; } cases[] = {
        {1, 0}, {3, 0.1f}, {1e-3f, 0}, {1e3f, 0}, {2.5f, 100}, {2.5f, 1000}};
    double from_cubes = 0, from_needles = 0;

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        float scale = cases[k].scale, shift = cases[k].shift;
        double cubes = escaping(cube, 8, cube_indices, 12, scale, shift);
        double needles = escaping(needle, 4, needle_indices, 4, scale, shift);
        if (cubes > 0 || needles > 1e-3)
            printf("# scale %g at %g: of the rays %g escaped the cube, %g the needle\n", (double)scale, (double)shift,
                   cubes, needles);
        from_cubes = fmax(from_cubes, cubes);
        from_needles = fmax(from_needles, needles);
    }
    figure_within("share of the rays that escape a needle's edges", from_needles, 0, 1e-3, "bound");
    figure_within("share of the rays that escape a cube", from_cubes, 0, 0, "exact");
}

/* ---- moving instances --------------------------------------------------------------------- */

/* An exact cube that moves and turns while the shutter is open, at every scale: rays leave it at
 * its place of the moment. */
static void test_moving_cubes(void **state)
{
    static const float times[2] = {0, 1};
    static const float turn[8] = {0, 0, 0, 1, 0, 0.2f, 0, 0.9797959f};

    (void)state;
    for (int e = -6; e <= 6; e += 2) {
        struct render_settings settings = builder_settings(1, 1, 1);
        float scale = (float)pow(10, e), path[6] = {0, 0, 0, 2 * scale, scale, -scale};
        struct test_random random = {(uint64_t)e + 50};
        struct render_scene *scene;
        struct scene_builder b;
        int left = 0;

        settings.fps = 1;
        settings.shutter = 1;
        builder_init(&b);
        builder_lambert(&b, 1);
        builder_place(&b, box(&b, 1, vec3_splat(-1), vec3_splat(1), vec3_splat(0)), 0, vec3_splat(1), vec3_splat(0))
            ->node = 0;
        builder_node(&b, -1, 0);
        b.scene.nodes[0].scale[0] = b.scene.nodes[0].scale[1] = b.scene.nodes[0].scale[2] = scale;
        builder_channel(&b, 0, PATH_TRANSLATION, 2, times, path);
        builder_channel(&b, 0, PATH_ROTATION, 2, times, turn);
        builder_camera(&b, vec3_make(0, 0, 9 * scale), vec3_splat(0), 1);
        scene = builder_build(&b, &settings);
        assert_true(scene->instances[0].motion_steps > 0);
        for (int i = 0; i < 40000; i++) {
            struct vec3 away = vec3_make(test_random_float(&random) - 0.5f, test_random_float(&random) - 0.5f,
                                         test_random_float(&random) - 0.5f);
            float time = test_random_float(&random);
            struct surface s;
            struct ray ray;
            struct hit hit;

            if (!aim(scene, &random, vec3_scale(away, 40 * scale), time, &s) || !s.front)
                continue;
            surface_leave(&s, hemisphere(&random, s.ng), &ray);
            if (vec3_dot(ray.direction, s.ng) <= 0)
                continue;
            left++;
            if (i % 2)
                ray.contacts = 1;
            if (accel_intersect(scene->accel, &ray, NULL, &hit))
                fail_msg("scale 1e%d at time %g: a ray met the cube that it left", e, (double)time);
        }
        assert_true(left > 10000);
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_contact_shadow),
        cmocka_unit_test(test_fan),
        cmocka_unit_test(test_leaving_cubes),
        cmocka_unit_test(test_leaving_edges),
        cmocka_unit_test(test_leaving_contacts),
        cmocka_unit_test(test_closed_rooms),
        cmocka_unit_test(test_moving_cubes),
    };
    const struct CMUnitTest many[] = {cmocka_unit_test(test_leaving_cubes)};

    render_keep_origin(1); /* rays and places here are in the scenes' own coordinates */
    if (argc > 1) {
        cube_rays = strtoull(argv[1], NULL, 10);
        return cmocka_run_group_tests_name("contact", many, NULL, NULL);
    }
    return cmocka_run_group_tests_name("contact", tests, NULL, NULL);
}
