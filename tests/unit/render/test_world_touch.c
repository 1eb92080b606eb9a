/* world_touch: the faces that coincide with another are those that a search of all pairs finds. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/base/sampler.h"
#include "worker/render/world.h"
#include "worker/render/scene/world_touch.h"

enum { MESHES = 4, EACH = 150, TRIANGLES = MESHES * EACH };

/* Meshes 0 and 1 are glass, 2 is a thin wall, 3 is opaque. */
/* Coordinates are the scene's. */
static const struct accel_digits digits = {{0, 0, 0}, 0};

static int bounds(uint32_t instance)
{
    return instance < 2;
}

static int crossable(uint32_t instance)
{
    return instance < 3;
}

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
    uint32_t room[3];    /* lattice steps in which the triangles' first corners lie, */
    uint32_t size[3];    /* and those to the other corners, less one */
    uint32_t big_one_in; /* so many triangles one is 64 times as large; 0: none */
    uint32_t flat_one_in; /* and one a line or a point */
    uint32_t least;      /* of the faces, so many are in contact at least */
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

static uint32_t number(uint64_t *counter, uint32_t below)
{
    return (uint32_t)(hash_u64(++*counter) >> 32) % below;
}

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
                         : c[a] + scale * ((float)number(counter, 2 * kind->size[a] - 1) -
                                           (float)(kind->size[a] - 1));
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
        world_exact_corners(scene, i / EACH, i % EACH, 0, corner[i]);
    for (uint32_t i = 0; i < TRIANGLES; i++)
        for (uint32_t k = 0; k < i; k++)
            if ((bounds(i / EACH) || bounds(k / EACH)) &&
                touch_coincide(&scene->digits, corner[i], corner[k])) {
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
        builder_place(&b, builder_mesh(&b, p, NULL, 3 * count, indices, count, 0), 0,
                      vec3_splat(1), vec3_splat(0));
        scene = finish(&b);
        for (uint32_t t = 0; t < count; t++)
            assert_int_equal(is_marked(scene, 0, t), count == MOST);
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random),
        cmocka_unit_test(test_pairs),
        cmocka_unit_test(test_gives_up),
    };
    return cmocka_run_group_tests_name("world_touch", tests, NULL, NULL);
}
