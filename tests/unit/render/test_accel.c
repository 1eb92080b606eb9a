/* Faces left by their names, faces that coincide, and float's proposals against a search in double. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/base/exact.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* A stack of squares over one another at these heights over y = 1; none is turned round unless
 * `reversed`. All squares but the first are cut along the other diagonal. */
struct stack {
    struct scene_builder b;
    struct render_scene *scene;
};

static void stack_init(struct stack *t, const float *heights, size_t count, unsigned reversed)
{
    static const uint32_t indices[2][6] = {{0, 1, 2, 0, 2, 3}, {1, 2, 3, 1, 3, 0}};
    struct render_settings settings = builder_settings(1, 1, 1);

    builder_init(&t->b);
    builder_lambert(&t->b, 0.5f);
    for (size_t i = 0; i < count; i++) {
        float y = 1 + heights[i];
        float p[12] = {-1, y, -1, -1, y, 1, 1, y, 1, 1, y, -1};
        uint32_t turned[6];
        for (int k = 0; k < 6; k++)
            turned[k] = indices[i > 0][reversed >> i & 1 ? 5 - k : k];
        builder_place(&t->b, builder_mesh(&t->b, p, NULL, 4, turned, 2, 0), 0, vec3_splat(1), vec3_splat(0));
    }
    builder_camera(&t->b, vec3_make(0, 5, 0), vec3_splat(0), 1);
    t->scene = builder_build(&t->b, &settings);
}

static void stack_release(struct stack *t)
{
    render_scene_free(t->scene);
    builder_release(&t->b);
}

/* Down on (x, z): what is met, and what coincides with it. */
static uint32_t look_down(const struct stack *t, float x, float z, struct surface *s, struct ray *ray,
                          struct contact *out, uint32_t capacity)
{
    struct hit hit;
    double place[3];

    *ray = (struct ray){.origin = {x - 0.5f, 2.5f, z}, .t_max = INFINITY};
    ray->direction = vec3_normalize(vec3_make(0.5f, -1.5f, 0));
    assert_true(accel_intersect(t->scene->accel, ray, NULL, &hit));
    surface_from_hit(t->scene, ray, &hit, s);
    exact_vec(s->p, place);
    for (int k = 0; k < 3; k++)
        place[k] += s->rest[k];
    return accel_coincident(t->scene->accel, ray, &hit, place, NULL, out, capacity);
}

#define ULP 0x1p-23f /* of floats from 1 to 2 */

static void test_coincident(void **state)
{
    /* 8 ulp are a gap; 7 are none. */
    static const float heights[] = {0, 0, -7 * ULP, -8 * ULP, -3 * ULP, -0.25f};
    struct contact found[8];
    struct surface s;
    struct stack t;
    struct ray ray;
    uint32_t count;

    (void)state;
    stack_init(&t, heights, sizeof heights / sizeof *heights, 1u << 2);
    count = look_down(&t, 0.3f, -0.1f, &s, &ray, found, 8);
    assert_int_equal(s.number, 0); /* of two at one distance the one of the lower name */
    assert_int_equal(count, 3);
    assert_int_equal(found[0].hit.instance, 1);
    assert_int_equal(found[1].hit.instance, 4);
    assert_int_equal(found[2].hit.instance, 2);
    assert_true(found[0].gap == 0);
    assert_true(fabs(found[1].gap - 3 * (double)ULP) < 1e-15);
    assert_true(fabs(found[2].gap - 7 * (double)ULP) < 1e-15);
    assert_true(found[0].facing && found[1].facing && !found[2].facing);
    for (uint32_t i = 0; i < count; i++)
        assert_int_equal(found[i].repeats, 0);
    /* What does not fit is counted; the nearest are kept. */
    count = look_down(&t, 0.3f, -0.1f, &s, &ray, found, 1);
    assert_int_equal(count, 3);
    assert_int_equal(found[0].hit.instance, 1);
    stack_release(&t);
}

/* On a diagonal two triangles of one square may be proposed: one of them is no face of its own. */
static void test_repeats(void **state)
{
    static const float heights[] = {0, -2 * ULP};
    struct contact found[8];
    struct surface s;
    struct stack t;
    struct ray ray;

    (void)state;
    stack_init(&t, heights, 2, 0);
    for (int i = -8; i <= 8; i++) {
        float at = (float)i / 10;
        for (int side = -1; side <= 1; side += 2) {
            uint32_t count = look_down(&t, at, (float)side * at, &s, &ray, found, 8), others = 0;
            for (uint32_t k = 0; k < count; k++)
                others += !found[k].repeats && found[k].hit.instance == 1;
            assert_int_equal(others, 1);
            for (uint32_t k = 0; k < count; k++)
                if (found[k].hit.instance == 0)
                    assert_true(found[k].repeats);
        }
    }
    stack_release(&t);
}

/* A hit's place lies in its triangle to the last bits of double, not only to a float's. */
static void test_place(void **state)
{
    static const float p[9] = {1000.1f, 700.3f, -300.7f, 1002.9f, 699.2f, -298.4f,
                               999.3f, 702.8f, -297.1f};
    static const uint32_t indices[3] = {0, 1, 2};
    struct render_settings settings = builder_settings(1, 1, 1);
    struct test_random random = {41};
    struct render_scene *scene;
    struct scene_builder b;
    int hits = 0;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_mesh(&b, p, NULL, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 0, 0), vec3_make(0, 0, 1), 1);
    scene = builder_build(&b, &settings);
    for (int i = 0; i < 2000; i++) {
        struct ray ray = {.origin = {999 + 4 * test_random_float(&random),
                                     699 + 4 * test_random_float(&random), -280},
                          .direction = {0, 0, -1}, .t_max = INFINITY}, next;
        double corner[3][3], n[3], place[3], t;
        struct surface s;
        struct hit hit;

        if (!accel_intersect(scene->accel, &ray, NULL, &hit))
            continue;
        hits++;
        surface_from_hit(scene, &ray, &hit, &s);
        surface_leave(&s, vec3_neg(ray.direction), &next);
        triangle_exact_corners(scene, 0, 0, 0, corner);
        exact_normal(corner, n);
        exact_origin(&next, place);
        t = exact_crossing(corner, n, place, (const double[3]){0, 0, 1});
        assert_true(fabs(t) < 1e-11); /* a float's half unit here is 3e-5 */
    }
    assert_true(hits > 200);
    render_scene_free(scene);
    builder_release(&b);
}

/* A ray that leaves several faces meets none of them, and the next one, however close. */
static void test_leaving_several(void **state)
{
    static const float heights[] = {0, 0, -3 * ULP, -9 * ULP};
    struct contact found[8];
    struct surface s;
    struct stack t;
    struct hit hit;
    struct ray ray, on;

    (void)state;
    stack_init(&t, heights, 4, 0);
    for (int contacts = 0; contacts < 2; contacts++) {
        uint32_t count = look_down(&t, 0.31f, 0.12f, &s, &ray, found, 8);
        assert_int_equal(count, 2);
        surface_leave(&s, ray.direction, &on);
        on.contacts = 1;
        assert_true(accel_intersect(t.scene->accel, &on, NULL, &hit));
        assert_int_equal(hit.instance, 2); /* the first's twin lies in its plane: not met */
        for (uint32_t i = 0; i < count; i++)
            on.left[on.left_count++] = found[i].hit;
        assert_true(accel_intersect(t.scene->accel, &on, NULL, &hit));
        assert_int_equal(hit.instance, 3);
        surface_from_hit(t.scene, &on, &hit, &s);
        assert_true(fabsf(s.t * 0.9486833f - 9 * ULP) < ULP); /* metres along the ray */
        assert_true(accel_occluded(t.scene->accel, &on, NULL));
        on.direction = vec3_neg(on.direction);
        on.off = vec3_neg(on.off);
        assert_false(accel_intersect(t.scene->accel, &on, NULL, &hit));
        assert_false(accel_occluded(t.scene->accel, &on, NULL));
    }
    stack_release(&t);
}

/* Faces with a film of 8 ulp between them are met in their order, from afar and at any angle. */
static void test_films(void **state)
{
    static const float heights[] = {-8 * ULP, 0};
    struct test_random random = {31};
    int exchanged = 0;
    struct stack t;

    (void)state;
    stack_init(&t, heights, 2, 0);
    for (int i = 0; i < 4000; i++) {
        struct vec3 to = vec3_make(1.8f * test_random_float(&random) - 0.9f, 1,
                                   1.8f * test_random_float(&random) - 0.9f);
        struct ray ray = {.origin = {8 * test_random_float(&random) - 4,
                                     250 + 10 * test_random_float(&random),
                                     8 * test_random_float(&random) - 4},
                          .t_max = INFINITY};
        struct surface s;
        struct hit hit;

        ray.direction = vec3_normalize(vec3_sub(to, ray.origin));
        assert_true(accel_intersect(t.scene->accel, &ray, NULL, &hit));
        surface_from_hit(t.scene, &ray, &hit, &s);
        exchanged += accel_refine(t.scene->accel, &ray, NULL, (double)s.t, 1, &hit);
        assert_int_equal(hit.instance, 1);
    }
    assert_true(exchanged > 0); /* else this test shows nothing */
    stack_release(&t);
}

/* A ray that ends on a face is not blocked by it, nor by what lies behind; but by what lies right
 * before it. */
static void test_ending_on_a_face(void **state)
{
    static const float heights[] = {0, 2 * ULP, 1};
    struct stack t;

    (void)state;
    stack_init(&t, heights, 3, 0);
    for (int k = 0; k < 200; k++) {
        struct ray ray = {.origin = {0.1f, 1.75f, 0.2f}, .reaches = 1, .end_cosine = 1};
        struct vec3 to = vec3_make((float)(k % 20) / 10 - 0.95f, 1, (float)(k / 20) / 5 - 0.9f);
        struct surface s;
        struct hit hit;

        to = vec3_sub(to, ray.origin);
        ray.direction = vec3_normalize(to);
        ray.end_cosine = -ray.direction.y;
        ray.t_max = INFINITY;
        ray.reaches = 0;
        assert_true(accel_intersect(t.scene->accel, &ray, NULL, &hit));
        assert_int_equal(hit.instance, 1);
        surface_from_hit(t.scene, &ray, &hit, &s);
        ray.reaches = 1;
        ray.t_max = s.t;
        ray.end = hit;
        assert_false(accel_occluded(t.scene->accel, &ray, NULL));
        assert_false(accel_intersect(t.scene->accel, &ray, NULL, &hit));
        ray.end.instance = 0; /* 2 ulp behind; its triangles are the other way round */
        ray.end.triangle = to.x + ray.origin.x < to.z + ray.origin.z ? 0 : 1;
        assert_true(accel_occluded(t.scene->accel, &ray, NULL));
    }
    stack_release(&t);
}

/* ---- against a search in double ----------------------------------------------------------- */

/* The nearest triangle that is met well inside its edges; *sure is 0 where an edge is close. */
static int search(const struct render_scene *scene, const struct ray *ray, double *nearest, int *sure)
{
    double o[3], d[3];
    int met = 0;

    exact_origin(ray, o);
    exact_vec(ray->direction, d);
    *sure = 1;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        for (uint32_t k = 0; k < scene->meshes[scene->instances[i].mesh].triangle_count; k++) {
            double c[3][3], e1[3], e2[3], p[3], s[3], m[3], determinant, u, v, t;

            if (ray->left_count && ray->left[0].instance == i && ray->left[0].triangle == k)
                continue;
            triangle_exact_corners(scene, i, k, ray->time, c);
            exact_sub(c[1], c[0], e1);
            exact_sub(c[2], c[0], e2);
            exact_sub(o, c[0], s);
            exact_cross(d, e2, p);
            exact_cross(s, e1, m);
            determinant = exact_dot(e1, p);
            u = exact_dot(s, p) / determinant;
            v = exact_dot(d, m) / determinant;
            t = exact_dot(e2, m) / determinant;
            if (!(u >= -1e-4 && v >= -1e-4 && u + v <= 1 + 1e-4) || !(t > -1e-12))
                continue;
            if (u < 1e-4 || v < 1e-4 || u + v > 1 - 1e-4 || t < 1e-12)
                *sure = 0;
            if (!met || t < *nearest)
                *nearest = t;
            met = 1;
        }
    return met;
}

/* A tangle of triangles that cut through one another, some of them needles, with others a hair's
 * breadth over them. */
static void tangle(struct scene_builder *b, struct test_random *random, float needle)
{
    for (int k = 0; k < 24; k++) {
        static const uint32_t indices[3] = {0, 1, 2};
        float p[9];

        for (int i = 0; i < 9; i++)
            p[i] = 2 * test_random_float(random) - 1;
        if (k % 3 == 0)
            for (int i = 0; i < 3; i++)
                p[6 + i] = p[i] + needle * p[6 + i];
        builder_place(b, builder_mesh(b, p, NULL, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0));
        if (k % 4 == 1) {
            for (int i = 0; i < 9; i++)
                p[i] += (i % 3 == 1 ? 1e-6f : 0);
            builder_place(b, builder_mesh(b, p, NULL, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0));
        }
    }
}

/* ---- instances ---------------------------------------------------------------------------- */

/* A square, turned to stand aslant. */
static const float sheet[12] = {-1, 0, -1, 1, 0, -1, -1, 0, 1, 1, 0, 1};
static const uint32_t sheet_indices[6] = {0, 2, 1, 1, 2, 3};
static const struct transform aslant = {
    {{0.6f, 0.8f, 0, 0.3f}, {-0.8f, 0.6f, 0, 0.7f}, {0, 0, 1, 0.1f}}};

static void sheet_corners(const void *scene, uint32_t instance, uint32_t triangle, float time, double corner[3][3])
{
    (void)scene;
    (void)instance;
    (void)time;
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++) {
            const float *p = sheet + 3 * (size_t)sheet_indices[3 * triangle + (uint32_t)k];
            const float *row = aslant.m[a];
            corner[k][a] = (double)row[0] * (double)p[0] + (double)row[1] * (double)p[1] +
                           (double)row[2] * (double)p[2] + (double)row[3];
        }
}

/* Rays that start in mid-air nanometres off the sheet and go away from it at small angles do not
 * meet it: it lies behind them by less than float's error, and the normal by which that is judged is
 * the world's. */
static void test_instance(void **state)
{
    const struct accel_mesh mesh = {sheet, sheet_indices, 4, 2};
    const struct accel_instance instance = {.mesh = 0, .to_world = aslant};
    const struct accel_input input = {.meshes = &mesh, .instances = &instance, .mesh_count = 1,
                                      .instance_count = 1, .isa = ISA_AVX2,
                                      .corners = sheet_corners};
    struct test_random random = {41};
    struct accel *accel;
    struct error err;

    (void)state;
    if (!(isa_supported_mask() >> ISA_AVX2 & 1))
        skip();
    assert_int_equal(accel_new(&accel, &input, &err), STATUS_OK);
    for (int i = 0; i < 200000; i++) {
        float u = 0.1f + 0.4f * test_random_float(&random), v = 0.1f + 0.4f * test_random_float(&random);
        struct ray ray = {.t_max = INFINITY};
        float rise = 2e-6f + 1e-5f * test_random_float(&random);
        double corner[3][3], place[3], n[3];
        struct hit hit;

        sheet_corners(NULL, 0, 0, 0, corner);
        for (int a = 0; a < 3; a++)
            place[a] =
                corner[0][a] + (double)u * (corner[1][a] - corner[0][a]) + (double)v * (corner[2][a] - corner[0][a]);
        exact_normal(corner, n);
        for (int a = 0; a < 3; a++)
            place[a] += 1e-9 * n[a];
        ray.origin = exact_round(place, ray.rest);
        u = test_random_float(&random) - 0.5f;
        ray.direction = vec3_normalize(
            vec3_make(0.6f * u + 0.8f * rise, 0.6f * rise - 0.8f * u, test_random_float(&random) - 0.5f));
        if (accel_intersect(accel, &ray, NULL, &hit))
            fail_msg("ray %d meets triangle %u behind it", i, hit.triangle);
    }
    accel_free(accel);
}

/* Sheets of squares, every triangle five times in one place: the tree alone decides which of the five a
 * ray meets. */
enum { TIE_SIDE = 120, TIE_COPIES = 5, TIE_TRIANGLES = TIE_SIDE * TIE_SIDE * TIE_COPIES };

static void tie_accel(struct accel **accel, enum bvh_quality quality, unsigned threads, int shared,
                      const float *positions, const uint32_t *indices)
{
    const struct accel_mesh mesh = {positions, indices, 3 * TIE_TRIANGLES, TIE_TRIANGLES};
    const struct accel_instance instance = {.instance_positions = shared ? NULL : positions,
                                            .to_world = {.m = {{1}, {0, 1}, {0, 0, 1}}}};
    const struct accel_input input = {.meshes = &mesh, .instances = &instance, .mesh_count = 1,
                                      .instance_count = 1, .isa = ISA_AVX2, .quality = quality,
                                      .threads = threads};
    struct error err;

    assert_int_equal(accel_new(accel, &input, &err), STATUS_OK);
}

static void test_threads(void **state)
{
    float *positions = malloc((9 * (size_t)TIE_TRIANGLES + 4) * sizeof *positions);
    uint32_t *indices = malloc(3 * (size_t)TIE_TRIANGLES * sizeof *indices);

    (void)state;
    if (!(isa_supported_mask() >> ISA_AVX2 & 1))
        skip();
    for (size_t t = 0; t < TIE_TRIANGLES; t++) {
        const size_t place = t / TIE_COPIES * 7919 % (TIE_SIDE * TIE_SIDE);
        const float x = (float)(place % TIE_SIDE), y = (float)(place / TIE_SIDE);
        const float corner[9] = {x, y, 0, x + 1.3f, y, 0, x, y + 1.3f, 0};
        memcpy(positions + 9 * t, corner, sizeof corner);
        for (uint32_t k = 0; k < 3; k++)
            indices[3 * t + k] = (uint32_t)(3 * t) + k;
    }
    for (int quality = 0; quality < BVH_QUALITY_COUNT; quality++)
        for (int shared = 0; shared < 2; shared++) {
            struct test_random random = {7};
            struct accel *one, *many;
            uint64_t copies = 0;

            tie_accel(&one, quality, 1, shared, positions, indices);
            tie_accel(&many, quality, 16, shared, positions, indices);
            for (int i = 0; i < 20000; i++) {
                struct ray ray = {.origin = {TIE_SIDE * test_random_float(&random),
                                             TIE_SIDE * test_random_float(&random), 3},
                                  .direction = {0, 0, -1}, .t_max = INFINITY};
                struct hit a = {0}, b = {0};

                assert_int_equal(accel_intersect(one, &ray, NULL, &a), accel_intersect(many, &ray, NULL, &b));
                assert_int_equal(a.triangle, b.triangle);
                copies |= (uint64_t)1 << a.triangle % TIE_COPIES;
            }
            assert_true(copies & (copies - 1)); /* or nothing would have been compared */
            accel_free(many);
            accel_free(one);
        }
    free(indices);
    free(positions);
}

static void test_against_search(void **state)
{
    static const float needles[] = {1, 1e-3f, 1e-6f};
    struct test_random random = {23};

    (void)state;
    for (size_t n = 0; n < sizeof needles / sizeof *needles; n++) {
        struct render_settings settings = builder_settings(1, 1, 1);
        struct render_scene *scene;
        struct scene_builder b;
        int compared = 0, near = 0, without = 0;

        builder_init(&b);
        builder_lambert(&b, 0.5f);
        tangle(&b, &random, needles[n]);
        builder_camera(&b, vec3_make(0, 0, 5), vec3_splat(0), 1);
        scene = builder_build(&b, &settings);
        for (int i = 0; i < 40000; i++) {
            struct ray ray = {.origin = {3 * test_random_float(&random) - 1.5f,
                                         3 * test_random_float(&random) - 1.5f, 2},
                              .t_max = INFINITY};
            struct vec3 direction;
            struct surface s;
            struct hit hit;
            double expected = 0;
            int met, sure, found;

            direction = vec3_make(test_random_float(&random) - 0.5f, test_random_float(&random) - 0.5f, -1);
            ray.direction = vec3_normalize(direction);
            if (!accel_intersect(scene->accel, &ray, NULL, &hit))
                continue;
            surface_from_hit(scene, &ray, &hit, &s);
            direction = vec3_make(test_random_float(&random) - 0.5f, test_random_float(&random) - 0.5f,
                                  test_random_float(&random) - 0.5f);
            surface_leave(&s, vec3_normalize(direction), &ray);
            ray.contacts = 1;
            ray.came_t = 0; /* a face that the first ray has passed counts (test_pairs has the rule) */
            met = search(scene, &ray, &expected, &sure);
            if (!sure || fabsf(vec3_dot(ray.off, ray.direction)) < 1e-6f)
                continue;
            compared++;
            near += met && expected < 1e-5;
            found = accel_intersect(scene->accel, &ray, NULL, &hit);
            assert_int_equal(found, met);
            assert_int_equal(accel_occluded(scene->accel, &ray, NULL), met);
            if (n == 0 && (!met || expected > 1e-3) && fabsf(vec3_dot(ray.off, ray.direction)) > 1e-2f) {
                without++;
                ray.contacts = 0; /* it starts up to an error of float off the face */
                assert_int_equal(accel_intersect(scene->accel, &ray, NULL, &hit), met);
                assert_int_equal(accel_occluded(scene->accel, &ray, NULL), met);
            }
            if (!met)
                continue;
            surface_from_hit(scene, &ray, &hit, &s);
            if (fabs((double)s.t - expected) > 1e-6 * expected + 1e-13)
                fail_msg("needles %g, ray %d: met at %.9g instead of %.9g", (double)needles[n], i, (double)s.t,
                         expected);
        }
        assert_true(compared > 5000);
        assert_true(near > 300);
        assert_true(n > 0 || without > 5000);

        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coincident),
        cmocka_unit_test(test_repeats),
        cmocka_unit_test(test_place),
        cmocka_unit_test(test_leaving_several),
        cmocka_unit_test(test_films),
        cmocka_unit_test(test_ending_on_a_face),
        cmocka_unit_test(test_against_search),
        cmocka_unit_test(test_instance),
        cmocka_unit_test(test_threads),
    };
    return cmocka_run_group_tests_name("accel", tests, NULL, NULL);
}
