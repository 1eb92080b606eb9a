/* render_touch: the faces that coincide with another are those that a search of all pairs finds. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/base/exact.h"
#include "worker/render/base/sampler.h"
#include "worker/render/render_scene.h"
#include "worker/render/scene/render_touch.h"

enum { MESHES = 4, EACH = 150, TRIANGLES = MESHES * EACH };

/* Meshes 0 and 1 are glass, 2 is a thin wall, 3 is opaque. */
/* Coordinates are the scene's. */
static const struct accel_digits digits = {{0, 0, 0}, 0};

static int bounds(uint32_t instance) { return instance < 2; }

static int crossable(uint32_t instance) { return instance < 3; }

static void materials(struct scene_builder *b)
{
    for (uint32_t i = 0; i < MESHES; i++) {
        struct scene_material *m = builder_lambert(b, 1);
        m->transmission = crossable(i) ? 1 : 0;
        m->refractive = bounds(i);
        m->ior = 1.5f;
        m->roughness = 0;
    }
}

static struct render_scene *finish(struct scene_builder *b)
{
    struct render_settings settings = builder_settings(8, 8, 4);

    builder_camera(b, vec3_make(50, 40, 30), vec3_splat(0), 0.5f);
    return builder_build(b, &settings);
}

/* ---- random meshes ------------------------------------------------------------------------ */

/* Corners on a lattice, so that faces coincide exactly or not at all. */
struct kind {
    const char *name;
    uint32_t room[3];     /* lattice steps in which the triangles' first corners lie, */
    uint32_t size[3];     /* and those to the other corners, less one */
    uint32_t big_one_in;  /* so many triangles one is 64 times as large; 0: none */
    uint32_t flat_one_in; /* and one a line or a point */
    uint32_t least;       /* of the faces, so many are in contact at least */
};

static const struct kind kinds[] = {
    {"no contacts", {10000, 10000, 10000}, {9, 9, 9}, 0, 0, 0},
    {"few contacts", {120, 5, 120}, {4, 1, 4}, 0, 0, 1},
    {"many contacts", {8, 3, 8}, {4, 2, 4}, 0, 0, 20},
    {"big next to tiny", {64, 4, 64}, {2, 1, 2}, 40, 0, 50},
    {"one plane, sparse", {400, 1, 400}, {6, 1, 6}, 0, 0, 20},
    {"one plane, dense", {30, 1, 30}, {6, 1, 6}, 0, 0, 300},
    {"one plane, far apart sizes", {600, 1, 600}, {6, 1, 6}, 100, 0, 100},
    {"all at one place", {1, 1, 1}, {3, 3, 3}, 0, 0, 200},
    {"degenerate ones among them", {12, 3, 12}, {4, 2, 4}, 0, 3, 5},
    {"all degenerate", {12, 3, 12}, {4, 2, 4}, 0, 1, 0},
};

static uint32_t number(uint64_t *counter, uint32_t below) { return (uint32_t)(hash_u64(++*counter) >> 32) % below; }

static uint32_t random_mesh(struct scene_builder *b, const struct kind *kind, uint64_t *counter)
{
    float p[9 * EACH];
    uint32_t indices[3 * EACH];

    for (uint32_t t = 0; t < EACH; t++) {
        float *c = p + 9 * t;
        float scale = kind->big_one_in && number(counter, kind->big_one_in) == 0 ? 64 : 1;
        for (int k = 0; k < 9; k++) {
            uint32_t a = (uint32_t)k % 3;
            c[k] = k < 3 ? (float)number(counter, kind->room[a])
                         : c[a] + scale * ((float)number(counter, 2 * kind->size[a] - 1) - (float)(kind->size[a] - 1));
        }
        if (kind->flat_one_in && number(counter, kind->flat_one_in) == 0)
            memcpy(c + 6, c + 3 * number(counter, 2), 3 * sizeof *c);
        for (uint32_t k = 0; k < 3; k++)
            indices[3 * t + k] = 3 * t + k;
    }
    return builder_mesh(b, p, NULL, 3 * EACH, indices, EACH, 0);
}

/* Every pair of which one bounds a volume. */
static void find_all(const struct render_scene *scene, uint8_t touches[MESHES][EACH])
{
    static double corner[TRIANGLES][3][3];

    memset(touches, 0, MESHES * EACH);
    for (uint32_t i = 0; i < TRIANGLES; i++)
        triangle_exact_corners(scene, i / EACH, i % EACH, 0, corner[i]);
    for (uint32_t i = 0; i < TRIANGLES; i++)
        for (uint32_t k = 0; k < i; k++)
            if ((bounds(i / EACH) || bounds(k / EACH)) && touch_coincide(&scene->digits, corner[i], corner[k])) {
                touches[i / EACH][i % EACH] |= (uint8_t)crossable(i / EACH);
                touches[k / EACH][k % EACH] |= (uint8_t)crossable(k / EACH);
            }
}

static int is_marked(const struct render_scene *scene, uint32_t instance, uint32_t triangle)
{
    const uint8_t *touches = scene->instances[instance].touches;

    return touches && touches[triangle];
}

static void test_random(void **state)
{
    uint64_t counter = 0;

    (void)state;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        uint8_t expected[MESHES][EACH];
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t in_contact = 0;

        builder_init(&b);
        materials(&b);
        /* Mesh 1 is off the others' lattice by 4 floats, which is contact. */
        for (uint32_t k = 0; k < MESHES; k++)
            builder_place(&b, random_mesh(&b, &kinds[i], &counter), k, vec3_splat(0.25f),
                          vec3_make(-7, k == 1 ? 3 + 0x1p-17f : 3, 11));
        scene = finish(&b);
        find_all(scene, expected);
        for (uint32_t k = 0; k < TRIANGLES; k++) {
            if (is_marked(scene, k / EACH, k % EACH) != expected[k / EACH][k % EACH])
                fail_msg("%s: face %u of mesh %u is %smarked", kinds[i].name, k % EACH, k / EACH,
                         expected[k / EACH][k % EACH] ? "not " : "");
            in_contact += expected[k / EACH][k % EACH];
        }
        assert_true(in_contact >= kinds[i].least);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* ---- two faces ---------------------------------------------------------------------------- */

static void expect_pair(int expected, double y, const double b[3][3])
{
    const double a[3][3] = {{-1, 0, -1}, {0, 0, 1}, {1, 0, -1}};
    double c[3][3], d[3][3];

    for (int k = 0; k < 9; k++) {
        c[k / 3][k % 3] = a[k / 3][k % 3] + (k % 3 == 1 ? 1 : 0);
        d[k / 3][k % 3] = b[k / 3][k % 3] + (k % 3 == 1 ? 1 + y : 0);
    }
    assert_int_equal(touch_coincide(&digits, c, d), expected);
    assert_int_equal(touch_coincide(&digits, d, c), expected);
}

static void test_pairs(void **state)
{
    static const double same[3][3] = {{-1, 0, -1}, {0, 0, 1}, {1, 0, -1}};
    static const double within[3][3] = {{-0.1, 0, -0.1}, {0.1, 0, -0.1}, {0, 0, 0.1}};
    static const double around[3][3] = {{-9, 0, -9}, {9, 0, -9}, {0, 0, 99}};
    static const double edge[3][3] = {{-1, 0, -1}, {1, 0, -1}, {0, 0, -2}};
    static const double corner[3][3] = {{0, 0, 1}, {1, 0, 2}, {-1, 0, 2}};
    static const double upright[3][3] = {{-1, 0, -1}, {1, 0, -1}, {0, 1, -1}};
    static const double through[3][3] = {{-1, -1e-3, -1}, {0, 1e-3, 1}, {1, -1e-3, -1}};
    /* It passes the plane of the first face, but far from it. */
    static const double leaning[3][3] = {{-99, -0.395, -99}, {99, 0.595, -99}, {0, 0.1, 99}};
    static const double line[3][3] = {{-1, 0, -1}, {1, 0, 1}, {1, 0, 1}};
    const double ulp = 0x1p-23;

    (void)state;
    expect_pair(1, 0, same);
    expect_pair(1, ACCEL_COINCIDENT_ULPS * ulp, same);
    expect_pair(1, -ACCEL_COINCIDENT_ULPS * ulp, same);
    expect_pair(0, 5 * ACCEL_COINCIDENT_ULPS * ulp, same);
    expect_pair(1, 0, within);
    expect_pair(0, 5 * ACCEL_COINCIDENT_ULPS * ulp, within);
    expect_pair(1, 0, around);
    expect_pair(0, 0, edge);
    expect_pair(0, 0, corner);
    expect_pair(0, 0, upright);
    expect_pair(1, 0, through);
    expect_pair(0, 0, leaning);
    expect_pair(0, 0, line);
}

/* ---- near faces --------------------------------------------------------------------------- */

static double distance_squared(const double a[3], const double b[3])
{
    double d[3];

    exact_sub(a, b, d);
    return exact_dot(d, d);
}

static void point_at(const double a[3], const double b[3], double t, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + t * (b[k] - a[k]);
}

static double point_segment(const double p[3], const double a[3], const double b[3])
{
    double e[3], to[3], at[3], length;

    exact_sub(b, a, e);
    exact_sub(p, a, to);
    length = exact_dot(e, e);
    point_at(a, b, length > 0 ? fmin(fmax(exact_dot(e, to) / length, 0), 1) : 0, at);
    return distance_squared(p, at);
}

static double segments(const double a[3], const double b[3], const double c[3], const double d[3])
{
    double e[3], f[3], to[3], least, ee, ff, ef, det, s, t;

    least = fmin(fmin(point_segment(a, c, d), point_segment(b, c, d)),
                 fmin(point_segment(c, a, b), point_segment(d, a, b)));
    exact_sub(b, a, e);
    exact_sub(d, c, f);
    exact_sub(c, a, to);
    ee = exact_dot(e, e);
    ff = exact_dot(f, f);
    ef = exact_dot(e, f);
    det = ee * ff - ef * ef;
    if (!(det > 1e-12 * ee * ff))
        return least; /* parallel */
    s = (exact_dot(e, to) * ff - exact_dot(f, to) * ef) / det;
    t = (exact_dot(e, to) * ef - exact_dot(f, to) * ee) / det;
    if (s > 0 && s < 1 && t > 0 && t < 1) {
        double p[3], q[3];
        point_at(a, b, s, p);
        point_at(c, d, t, q);
        least = fmin(least, distance_squared(p, q));
    }
    return least;
}

/* From the plane at the foot of each end, or where the segment passes it, if that is in the triangle. */
static double segment_triangle(const double a[3], const double b[3], const double c[3][3])
{
    const double *ends[2] = {a, b};
    double n[3], to[3], height[2], least = INFINITY, n2;

    exact_normal(c, n);
    n2 = exact_dot(n, n);
    if (!(n2 > 0))
        return least;
    for (int k = 0; k < 2; k++) {
        exact_sub(ends[k], c[0], to);
        height[k] = exact_dot(n, to);
    }
    for (int k = 0; k < 3; k++) {
        int crosses = height[0] * height[1] < 0, inside = 1;
        double at[3];

        if (k == 2 && !crosses)
            break;
        if (k == 2)
            point_at(a, b, height[0] / (height[0] - height[1]), at);
        for (int i = 0; i < 3 && k < 2; i++)
            at[i] = ends[k][i] - height[k] / n2 * n[i];
        for (int i = 0; i < 3; i++) {
            double e[3], across[3];
            exact_sub(c[(i + 1) % 3], c[i], e);
            exact_cross(n, e, across);
            exact_sub(at, c[i], to);
            inside &= exact_dot(across, to) >= 0;
        }
        if (inside)
            least = fmin(least, k == 2 ? 0 : height[k] * height[k] / n2);
    }
    return least;
}

static double triangles(const double a[3][3], const double b[3][3])
{
    double least = INFINITY;

    for (int i = 0; i < 3; i++) {
        least = fmin(least, segment_triangle(a[i], a[(i + 1) % 3], b));
        least = fmin(least, segment_triangle(b[i], b[(i + 1) % 3], a));
        for (int k = 0; k < 3; k++)
            least = fmin(least, segments(a[i], a[(i + 1) % 3], b[k], b[(k + 1) % 3]));
    }
    return sqrt(least);
}

/* The triangle whose edges are `inset` farther inside; 0: there is none. */
static int inside_of(const double c[3][3], double inset, double out[3][3])
{
    double length[3], round, area2, n[3];

    for (int k = 0; k < 3; k++)
        length[k] = sqrt(distance_squared(c[(k + 1) % 3], c[(k + 2) % 3]));
    round = length[0] + length[1] + length[2];
    exact_normal(c, n);
    area2 = sqrt(exact_dot(n, n));
    for (int k = 0; k < 3; k++) /* barycentrics: `inset` over each height, and the rest at corner k */
        for (int a = 0; a < 3; a++) {
            double w[3] = {inset * length[0] / area2, inset * length[1] / area2, inset * length[2] / area2};
            w[k] += 1 - inset * round / area2;
            out[k][a] = w[0] * c[0][a] + w[1] * c[1][a] + w[2] * c[2][a];
        }
    return inset * round < area2;
}

static unsigned near_of(const struct render_scene *scene, uint32_t k)
{
    const uint8_t *near = scene->instances[k / EACH].near;

    return near ? near[k % EACH] : RENDER_NEAR_NONE;
}

/* What every pair of triangles, of which one bounds a volume, says by their true distance. */
static void check_near(const struct render_scene *scene, const char *name)
{
    static double corner[TRIANGLES][3][3], inner[TRIANGLES][3][3];
    static int has_inner[TRIANGLES];
    const double reach = (double)scene->near_reach;
    uint32_t all = 0, wrong = 0, none = 0;

    for (uint32_t i = 0; i < TRIANGLES; i++) {
        triangle_exact_corners(scene, i / EACH, i % EACH, 0, corner[i]);
        has_inner[i] = inside_of(corner[i], reach, inner[i]);
    }
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        double to_inner = INFINITY, to_edges = INFINITY;

        for (uint32_t k = 0; k < TRIANGLES; k++)
            if (k != i && (bounds(i / EACH) || bounds(k / EACH))) {
                to_edges = fmin(to_edges, triangles(corner[i], corner[k]));
                if (has_inner[i])
                    to_inner = fmin(to_inner, triangles(inner[i], corner[k]));
            }
        if ((to_inner < reach / 2 * (1 - 1e-6) && near_of(scene, i) != RENDER_NEAR_ALL) ||
            (to_edges < reach * (1 - 1e-6) && near_of(scene, i) == RENDER_NEAR_NONE))
            fail_msg("%s: face %u is marked %u, others are %g from it and %g from its inside, reach %g", name, i,
                     near_of(scene, i), to_edges, to_inner, reach);
        all += near_of(scene, i) == RENDER_NEAR_ALL;
        none += near_of(scene, i) == RENDER_NEAR_NONE;
        wrong += near_of(scene, i) == RENDER_NEAR_ALL && to_inner > reach / 2 * (1 + 1e-6);
    }
    if (!(all > 0 && wrong * 4 <= all && none + all < TRIANGLES))
        fail_msg("%s: %u faces are near others, %u of them are not, %u are alone", name, all, wrong, none);
}

static void test_near(void **state)
{
    static const int chosen[] = {1, 2, 3, 4, 8};
    uint64_t counter = 99;

    (void)state;
    for (size_t i = 0; i < sizeof chosen / sizeof *chosen; i++) {
        struct render_scene *scene;
        struct scene_builder b;

        builder_init(&b);
        materials(&b);
        for (uint32_t k = 0; k < MESHES; k++)
            builder_place(&b, random_mesh(&b, &kinds[chosen[i]], &counter), k, vec3_splat(0.25f),
                          vec3_make(-7, k == 1 ? 3 + 0x1p-17f : 3, 11));
        scene = finish(&b);
        assert_true(scene->near_known);
        check_near(scene, kinds[chosen[i]].name);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* ---- too many pairs ----------------------------------------------------------------------- */

/* Leaning sheets apart from one another, whose boxes all overlap: where there are too many pairs
 * to look at, every face may touch another; with a few sheets the search finds that none does. */
static void test_gives_up(void **state)
{
    enum { MOST = 3200 };
    static float p[9 * MOST];
    static uint32_t indices[3 * MOST];

    (void)state;
    for (uint32_t i = 0; i < MOST; i++) {
        const float corner[9] = {0, 0, 0, 1, 1, 0, 0, 0, 1};
        for (uint32_t k = 0; k < 9; k++)
            p[9 * i + k] = corner[k] + (k % 3 == 1 ? (float)i * 1e-5f : 0);
        for (uint32_t k = 0; k < 3; k++)
            indices[3 * i + k] = 3 * i + k;
    }
    for (uint32_t count = 200; count <= MOST; count += MOST - 200) {
        struct render_scene *scene;
        struct scene_builder b;
        builder_init(&b);
        materials(&b);
        builder_place(&b, builder_mesh(&b, p, NULL, 3 * count, indices, count, 0), 0, vec3_splat(1), vec3_splat(0));
        scene = finish(&b);
        for (uint32_t t = 0; t < count; t++)
            assert_int_equal(is_marked(scene, 0, t), count == MOST);
        assert_int_equal(scene->near_known, count < MOST);
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random),
        cmocka_unit_test(test_pairs),
        cmocka_unit_test(test_near),
        cmocka_unit_test(test_gives_up),
    };
    return cmocka_run_group_tests_name("render_touch", tests, NULL, NULL);
}
