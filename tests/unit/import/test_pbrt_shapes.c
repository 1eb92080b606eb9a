/* pbrt: shapes and their fronts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"

/* The z of triangle 0's area vector. */
static float front(const struct import_result *r)
{
    struct mesh_view v = view_mesh(r, 0);
    const float *a = v.positions + 3 * v.indices[0], *b = v.positions + 3 * v.indices[1],
                *c = v.positions + 3 * v.indices[2];

    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

#define CORNERS "\"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2] "

static void test_fronts(void **state)
{
    static const struct {
        const char *text;
        float front, normal; /* 0: none */
    } cases[] = {
        {"Shape \"trianglemesh\" " CORNERS, 1, 0},
        {"ReverseOrientation Shape \"trianglemesh\" " CORNERS, -1, 0},
        {"ReverseOrientation ReverseOrientation Shape \"trianglemesh\" " CORNERS, 1, 0},
        /* Normals decide. */
        {"Shape \"trianglemesh\" " CORNERS "\"normal N\" [0 0 -1 0 0 -1 0 0 -1]", -1, -1},
        {"ReverseOrientation Shape \"trianglemesh\" " CORNERS "\"normal N\" [0 0 -1 0 0 -1 0 0 -1]", 1, 1},
        /* A mirroring matrix is the renderer's business. */
        {"Scale -1 1 1 Shape \"trianglemesh\" " CORNERS, 1, 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        struct import_result r;
        struct mesh_view v;
        snprintf(text, sizeof text, LAMP "%s", cases[i].text);
        pbrt_world(text, &r);
        v = view_mesh(&r, 0);
        assert_true(front(&r) == cases[i].front);
        assert_true((v.normals != NULL) == (cases[i].normal != 0));
        if (v.normals)
            assert_true(v.normals[2] == cases[i].normal);
        import_result_release(&r);
    }
}

/* pbrt-v3's triangles turn to their normals, whatever is reversed (triangle.cpp); other shapes are. */
static void test_fronts_of_version3(void **state)
{
    static const struct {
        const char *shape;
        float front;
    } cases[] = {
        {"Shape \"trianglemesh\" " CORNERS, -1},
        {"Shape \"trianglemesh\" " CORNERS "\"normal N\" [0 0 1 0 0 1 0 0 1]", 1},
        {"Shape \"trianglemesh\" " CORNERS "\"normal N\" [0 0 -1 0 0 -1 0 0 -1]", -1},
        {"Shape \"disk\" \"float innerradius\" .5", -1},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        struct import_result r;
        snprintf(text, sizeof text, "Film \"image\" " RIGHT_HANDED "WorldBegin " LAMP "ReverseOrientation %s", cases[i].shape);
        pbrt_whole(text, NULL, &r);
        if (!(front(&r) * cases[i].front > 0))
            fail_msg("case %zu", i);
        import_result_release(&r);
    }
}

static void test_triangle_mesh(void **state)
{
    struct import_result r;
    struct mesh_view v;

    (void)state;
    pbrt_world(LAMP "Shape \"trianglemesh\" \"point P\" [0 0 0 1 0 0 0 1 0 1 1 0] "
               "\"float st\" [0 0 1 0 0 1 1 1] \"integer indices\" [0 1 2 1 3 2] "
               "\"vector S\" [1 0 0 1 0 0 1 0 0 1 0 0]", &r); /* pbrt-v3's words */
    v = view_mesh(&r, 0);
    assert_int_equal(v.mesh->triangle_count, 2);
    assert_floats(v.uv0, (const float[]){0, 0, 1, 0, 0, 1, 1, 1}, 8, 0);
    assert_int_equal(r.warning_count, 1);
    pbrt_warned(&r, "a mesh's tangents (\"S\") are not read");
    import_result_release(&r);
    pbrt_world(LAMP "Shape \"trianglemesh\" " CORNERS "\"point2 uv\" [0 0] \"normal N\" [0 0 1]", &r);
    pbrt_warned(&r, "1 normals for 3 vertices");
    pbrt_warned(&r, "1 texture coordinates for 3 vertices");
    import_result_release(&r);
}

static void test_quadrics(void **state)
{
    static const struct {
        const char *shape;
        float low[3], high[3];
        int closed;
    } cases[] = {
        {"\"sphere\" \"float radius\" 2", {-2, -2, -2}, {2, 2, 2}, 1},
        {"\"sphere\" \"float zmin\" 0", {-1, -1, 0}, {1, 1, 1}, 0},
        {"\"sphere\" \"float phimax\" 180", {-1, 0, -1}, {1, 1, 1}, 0},
        {"\"disk\" \"float radius\" 3 \"float height\" 1", {-3, -3, 1}, {3, 3, 1}, 0},
        {"\"cylinder\" \"float radius\" .5 \"float zmin\" -2 \"float zmax\" 4", {-0.5f, -0.5f, -2}, {0.5f, 0.5f, 4}, 0},
        {"\"cone\" \"float radius\" 2 \"float height\" 3", {-2, -2, 0}, {2, 2, 3}, 0},
        {"\"paraboloid\" \"float radius\" 2 \"float zmin\" 1 \"float zmax\" 4", {-2, -2, 1}, {2, 2, 4}, 0},
        {"\"hyperboloid\" \"point p1\" [3 0 -1] \"point p2\" [0 4 1] \"float phimax\" 360", {-4, -4, -1}, {4, 4, 1}, 0},
        {"\"hyperboloid\"", {-1.41421f, -1.41421f, 0}, {1.41421f, 1.41421f, 1}, 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        struct import_result r;
        snprintf(text, sizeof text, LAMP "Shape %s", cases[i].shape);
        pbrt_world(text, &r);
        assert_floats(r.scene.meshes[0].bounds_min, cases[i].low, 3, 1e-3f);
        assert_floats(r.scene.meshes[0].bounds_max, cases[i].high, 3, 1e-3f);
        assert_int_equal(r.scene.meshes[0].closed, cases[i].closed);
        assert_int_equal(r.warning_count, 0);
        import_result_release(&r);
    }
}

static void test_other_surfaces(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]", &r);
    assert_int_equal(r.scene.meshes[0].triangle_count, 2); /* flat */
    assert_true(front(&r) > 0);
    import_result_release(&r);
    pbrt_world(LAMP "Shape \"loopsubdiv\" \"integer levels\" 2 \"point3 P\" "
               "[0 0 0 1 0 0 0 1 0 0 0 1] \"integer indices\" [0 2 1 0 1 3 1 2 3 2 0 3]", &r);
    assert_int_equal(r.scene.meshes[0].triangle_count, 4 * 16);
    assert_true(r.scene.meshes[0].closed);
    import_result_release(&r);
    pbrt_world(LAMP "Shape \"curve\" \"point3 P\" [0 0 0 0 1 0 0 2 0 0 3 0] \"float width\" .1", &r);
    assert_true(r.scene.meshes[0].triangle_count > 0);
    assert_float_equal(r.scene.meshes[0].bounds_max[1], 3, 0.1f);
    import_result_release(&r);
    pbrt_world(LAMP "Attribute \"shape\" \"float radius\" 4 Shape \"sphere\"", &r);
    assert_float_equal(r.scene.meshes[0].bounds_max[2], 4, 1e-5f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

static void test_ply(void **state)
{
    static const char ply[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                              "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
                              "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    const char *bad = "WorldBegin\nShape \"plymesh\" \"string filename\" \"b.ply\"";
    char *folder = pbrt_folder_make();
    struct import_result r;
    struct error err = {0};

    (void)state;
    pbrt_folder_put(folder, "a.ply", ply, sizeof ply - 1);
    pbrt_folder_put(folder, "b.ply", ply, 60);
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Shape \"plymesh\" \"string filename\" [\"a.ply\"]", folder, &r);
    assert_int_equal(r.scene.meshes[0].triangle_count, 1);
    assert_string_equal(r.scene.instances[0].name, "a");
    assert_string_equal(r.scene.instances[0].asset, "");
    import_result_release(&r);
    assert_int_not_equal(import_scene_memory(bad, strlen(bad), "a.pbrt", folder, &options, &r, &err), STATUS_OK);
    assert_says(&err, "a.pbrt:2: |b.ply");
    pbrt_folder_remove(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fronts),
        cmocka_unit_test(test_fronts_of_version3),
        cmocka_unit_test(test_triangle_mesh),
        cmocka_unit_test(test_quadrics),
        cmocka_unit_test(test_other_surfaces),
        cmocka_unit_test(test_ply),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
