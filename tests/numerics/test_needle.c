/* Very sharp needles of glass: a ray that goes through one meets its two faces, the one that it
 * enters by first (docs/NUMERICS.md).
 *
 *   test_needle [RAYS]     so many for each case instead of the suite's few
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/path/crossing.h"
#include "worker/render/base/exact.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

static uint64_t rays_wanted = 8000;
/* With more, each case is printed. */
#define RAYS_LONG 100000

/* So near to its outline, in units of 2^-24 of the distance and of the ray's origin, a needle may be
 * missed. */
#define RIM 1.0
/* From outside a ray may slip through at a vertex and meet the far face from behind: fewer than one
 * in so many of rays of which a quarter are aimed at vertices, and another quarter within 1e-6. */
#define SLIPS 500

struct needle {
    struct scene_builder builder;
    struct render_scene *scene;
    double corner[4][3], middle[3], size;
    struct test_random random;
};

/* The faces that meet at an edge make an angle of some two degrees; corner i is the one that face i
 * does not have. */
static const float corners[12] = {0, 0, 0, 1, 0.01f, 0, 0.02f, 1, 0.03f, 0.3f, 0.31f, 0.04f};
static const uint32_t faces[12] = {1, 2, 3, 2, 0, 3, 0, 1, 3, 0, 2, 1};

static void needle_init(struct needle *n, float scale, float shift, enum isa isa)
{
    struct scene_builder *b = &n->builder;
    struct render_settings settings = builder_settings(1, 1, 1);
    const float at[3] = {shift, -0.3f * shift, 0.7f * shift};
    struct scene_material *glass;
    float p[12];

    *n = (struct needle){.size = (double)scale, .random = {17}};
    for (int i = 0; i < 12; i++) {
        p[i] = corners[i] * scale + at[i % 3];
        n->corner[i / 3][i % 3] = (double)p[i];
        n->middle[i % 3] += (double)p[i] / 4;
    }
    settings.isa = isa;
    builder_init(b);
    glass = builder_lambert(b, 1);
    glass->specular = glass->transmission = 1;
    glass->roughness = 0;
    glass->refractive = 1;
    glass->ior = 1.5f;
    builder_place(b, builder_mesh(b, p, NULL, 4, faces, 4, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(at[0], at[1], at[2] + 5 * scale), vec3_make(at[0], at[1], at[2]), 1);
    n->scene = builder_build(b, &settings);
}

static void needle_release(struct needle *n)
{
    render_scene_free(n->scene);
    builder_release(&n->builder);
}

static double number(struct needle *n) { return (double)test_random_float(&n->random); }

/* A vertex, or a place close to one or to an edge, and by 1e-8 to 0.3 of the way to the middle. */
static void any_target(struct needle *n, int kind, double out[3])
{
    static const double far[4] = {0, 1e-6, 1e-3, 1};
    int from = (int)(4 * number(n)), to = (from + 1 + (int)(3 * number(n))) % 4;
    double along = far[kind] * number(n), inwards = kind ? pow(10, -0.5 - 7 * number(n)) : 0;

    for (int k = 0; k < 3; k++) {
        out[k] = n->corner[from][k] + along * (n->corner[to][k] - n->corner[from][k]);
        out[k] += inwards * (n->middle[k] - out[k]);
    }
}

static void any_origin(struct needle *n, int inside, double out[3])
{
    double share[4], sum = 0;

    for (int i = 0; i < 4; i++)
        sum += share[i] = -log(number(n) + 1e-9);
    for (int k = 0; k < 3; k++) {
        out[k] = inside ? 0 : n->middle[k] + 4 * n->size * (number(n) - 0.5);
        for (int i = 0; i < 4 && inside; i++)
            out[k] += share[i] / sum * n->corner[i][k];
    }
}

/* Where the line is in the needle, in metres, by double; 0: nowhere before its origin or behind.
 * `towards`: it enters by these faces. */
static int pierces(const struct needle *n, const double origin[3], const double direction[3], double *enters,
                   double *leaves, int towards[4])
{
    *enters = -INFINITY;
    *leaves = INFINITY;
    for (int face = 0; face < 4; face++) {
        double corner[3][3], normal[3], t;

        for (int i = 0; i < 9; i++)
            corner[i / 3][i % 3] = n->corner[faces[3 * face + i / 3]][i % 3];
        exact_normal(corner, normal);
        t = exact_crossing(corner, normal, origin, direction);
        towards[face] = exact_dot(normal, direction) < 0;
        if (towards[face])
            *enters = fmax(*enters, t);
        else
            *leaves = fmin(*leaves, t);
    }
    return *enters < *leaves;
}

/* How far from the needle's outline the line passes, in metres. */
static double to_outline(const struct needle *n, const double origin[3], const double direction[3],
                         const int towards[4])
{
    double least = INFINITY;

    for (int i = 0; i < 4; i++)
        for (int k = i + 1; k < 4; k++) {
            double edge[3], from[3], apart[3], along, by, part;
            int others = 0;

            for (int face = 0; face < 4; face++)
                others += face != i && face != k && towards[face];
            if (others != 1)
                continue; /* both of its faces are seen, or neither */
            exact_sub(n->corner[k], n->corner[i], edge);
            exact_sub(n->corner[i], origin, from);
            along = exact_dot(edge, direction);
            by = exact_dot(from, direction);
            for (int a = 0; a < 3; a++) { /* as seen along the line */
                edge[a] -= along * direction[a];
                from[a] -= by * direction[a];
            }
            part = fmin(fmax(-exact_dot(from, edge) / exact_dot(edge, edge), 0), 1);
            for (int a = 0; a < 3; a++)
                apart[a] = from[a] + part * edge[a];
            least = fmin(least, sqrt(exact_dot(apart, apart)));
        }
    return least;
}

/* The next face on the ray's way, as a path finds it. */
static int meet(const struct render_scene *scene, const struct ray *ray, int inside, struct surface *s)
{
    struct hit hit;

    if (!accel_intersect(scene->accel, ray, NULL, &hit) &&
        !(inside && accel_intersect_enclosed(scene->accel, ray, NULL, &hit)))
        return 0;
    crossing_first(scene, ray, NULL, &hit, s);
    return 1;
}

struct count {
    uint64_t rays, near; /* that go through; less than 16 rims from the outline */
    uint64_t missed;     /* nothing met, or nothing after the first face */
    uint64_t swapped;    /* the face met first by which the ray leaves */
};

static void shoot(struct needle *n, int inside, int kind, struct count *count)
{
    double target[3], origin[3], direction[3], enters, leaves, length, depth;
    struct ray ray = {.t_max = INFINITY};
    struct surface s;
    int towards[4];

    any_target(n, kind, target);
    any_origin(n, inside, origin);
    ray.origin = exact_round(origin, ray.rest);
    exact_sub(target, origin, direction);
    length = sqrt(exact_dot(direction, direction));
    ray.direction =
        vec3_make((float)(direction[0] / length), (float)(direction[1] / length), (float)(direction[2] / length));
    exact_vec(ray.direction, direction);
    if (!pierces(n, origin, direction, &enters, &leaves, towards) || (inside ? enters > -1e-9 * n->size : enters < 0))
        return;
    depth = to_outline(n, origin, direction, towards) / (leaves + exact_largest(origin)) * 0x1p24;
    if (depth < RIM)
        return;
    count->rays++;
    count->near += depth < 16 * RIM;
    if (!meet(n->scene, &ray, inside, &s)) {
        count->missed++;
    } else if (s.front == inside) {
        count->swapped++;
    } else if (!inside) {
        surface_leave(&s, ray.direction, &ray);
        count->missed += !meet(n->scene, &ray, 1, &s) || s.front;
    }
}

static const struct { float scale, shift; } cases[] = {
    {1, 0}, {3, 0.1f}, {1e-3f, 0}, {1e3f, 0}, {2.5f, 100}};

static void check(int inside)
{
    double missed = 0, swapped = 0;

    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        for (int isa = 0; isa < ISA_COUNT; isa++) {
            struct count count = {0};
            struct needle n;

            if (!(isa_supported_mask() >> isa & 1))
                continue;
            needle_init(&n, cases[k].scale, cases[k].shift, (enum isa)isa);
            for (uint64_t i = 0; i < rays_wanted; i++)
                shoot(&n, inside, (int)(i % 4), &count);
            needle_release(&n);
            if (rays_wanted >= RAYS_LONG)
                printf("# %s, scale %g at %g, from %s: %llu rays, %llu missed, %llu swapped\n", isa_name((enum isa)isa),
                       (double)cases[k].scale, (double)cases[k].shift, inside ? "inside" : "outside",
                       (unsigned long long)count.rays, (unsigned long long)count.missed,
                       (unsigned long long)count.swapped);
            assert_true(count.rays > rays_wanted / 2 && (inside || count.near > 0));
            missed += (double)count.missed;
            swapped = fmax(swapped, (double)count.swapped / (double)count.rays);
        }
    figure_within(inside ? "rays that miss the far face of a needle of glass, from inside"
                         : "rays that miss a needle of glass",
                  missed, 0, 0, "exact");
    figure_within(inside ? "share of rays from inside that meet a needle's face from outside"
                         : "share of rays that meet a needle's far face first",
                  swapped, 0, inside ? 0 : 1.0 / SLIPS, "bound");
}

static void test_from_outside(void **state)
{
    (void)state;
    check(0);
}

static void test_from_inside(void **state)
{
    (void)state;
    check(1);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_from_outside),
        cmocka_unit_test(test_from_inside),
    };

    if (argc > 1)
        rays_wanted = (uint64_t)strtod(argv[1], NULL);
    render_keep_origin(1); /* rays and places here are in the scenes' own coordinates */
    return cmocka_run_group_tests_name("needle", tests, NULL, NULL);
}
