/* glTF: tangents, supplied and made. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"

static void test_tangents(void **state)
{
    struct maker m = {0};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    put_mirrored_quads(&m);
    maker_import(&m, ONE_NODE "," NORMAL_MAPPED(""), &r);
    v = view_mesh(&r, 0);
    /* The two shared vertices are split: the texture changes its hand there. */
    assert_int_equal(v.mesh->vertex_count, 8);
    assert_int_equal(v.mesh->arrays, MESH_NORMALS | MESH_TANGENTS | MESH_UV0);
    for (size_t i = 0; i < 12; i++) {
        const float *t = v.tangents + 4 * v.indices[i];
        int mirrored = i >= 6;
        /* The tangent shows where u grows; cross(normal, tangent) * w is up on the image. */
        assert_true(t[0] == (mirrored ? -1 : 1) && t[1] == 0 && t[2] == 0);
        assert_true(t[3] == (mirrored ? -1 : 1));
    }
    import_result_release(&r);
}

static void test_tangents_transformed(void **state)
{
    struct maker m = {0};
    struct import_result r;
    struct mesh_view v;
    float s, c;

    (void)state;
    /* Turn the coordinates: the tangent follows the turned u. */
    put_mirrored_quads(&m);
    maker_import(&m,
                 ONE_NODE "," NORMAL_MAPPED(",\"extensions\":{\"KHR_texture_transform\":{"
                                            "\"rotation\":0.5}}"),
                 &r);
    v = view_mesh(&r, 0);
    det_sincos(0.5f, &s, &c);
    /* u' = cos u + sin v; on the left quad u = x, v = 1 - y: the gradient is (cos, -sin), and
     * the tangent, along which v' stays, is (cos, -sin) for a rotation. */
    assert_true(fabsf(v.tangents[4 * v.indices[0]] - c) < 1e-5f);
    assert_true(fabsf(v.tangents[4 * v.indices[0] + 1] + s) < 1e-5f);
    assert_true(v.tangents[4 * v.indices[0] + 3] == 1);
    import_result_release(&r);
}

static void test_tangents_flat(void **state)
{
    static const float uv[6] = {0, 1, 1, 1, 0, 0};
    struct maker m = triangle_maker();
    struct import_result r;
    struct mesh_view v;

    (void)state;
    put_floats(&m, "VEC2", uv, 6, 3);
    maker_import(&m,
                 ONE_NODE ",\"materials\":[{\"normalTexture\":{\"index\":0}}]," PNG_IMAGE
                          ",\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{"
                          "\"POSITION\":0,\"TEXCOORD_0\":1}}]}]",
                 &r);
    v = view_mesh(&r, 0);
    assert_int_equal(v.mesh->arrays, MESH_TANGENTS | MESH_UV0);
    for (size_t i = 0; i < 3; i++)
        assert_floats(v.tangents + 4 * i, (const float[]){1, 0, 0, 1}, 4, 1e-6f);
    import_result_release(&r);
}

static void test_tangents_supplied(void **state)
{
    static const float normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    static const float uv[6] = {0, 1, 1, 1, 0, 0};
    static const float given[12] = {0, 2, 0, -1, 0, 1, 0, -1, 0, 1, 0, -1};
    static const float unit[12] = {0, 1, 0, -1, 0, 1, 0, -1, 0, 1, 0, -1};
    static const char rest[] = ONE_NODE ",\"materials\":[{\"normalTexture\":{\"index\":0}}]," PNG_IMAGE
                                        ",\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{\"POSITION\":0,"
                                        "\"NORMAL\":1,\"TEXCOORD_0\":2,\"TANGENT\":3}}]}]";
    static const float none[12] = {0};
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", normals, 9, 3);
    put_floats(&m, "VEC2", uv, 6, 3);
    put_floats(&m, "VEC4", given, 12, 3);
    maker_import(&m, rest, &r);
    assert_floats(view_mesh(&r, 0).tangents, unit, 12, 0);
    import_result_release(&r);
    /* Without a direction they are made again. */
    m = triangle_maker();
    put_floats(&m, "VEC3", normals, 9, 3);
    put_floats(&m, "VEC2", uv, 6, 3);
    put_floats(&m, "VEC4", none, 12, 3);
    maker_import(&m, rest, &r);
    assert_floats(view_mesh(&r, 0).tangents, (const float[]){1, 0, 0, 1}, 4, 1e-6f);
    assert_warned(&r, "tangent");
    import_result_release(&r);
    /* Without texture coordinates there is no normal map. */
    m = triangle_maker();
    put_floats(&m, "VEC3", normals, 9, 3);
    maker_import(&m,
                 ONE_NODE ",\"materials\":[{\"normalTexture\":{\"index\":0}}]," PNG_IMAGE
                          ",\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{"
                          "\"POSITION\":0,\"NORMAL\":1}}]}]",
                 &r);
    assert_int_equal(r.scene.meshes[0].arrays, MESH_NORMALS);
    assert_warned(&r, "no texture coordinates for it: rendered without");
    import_result_release(&r);
}

/* Import triangles with normals and texture coordinates of their own; all vertices of one
 * position, normal and coordinate are one to the tangents. */
static void import_corners(const float *positions, const float *normals, const float *uv, size_t vertices,
                           struct import_result *r)
{
    struct maker m = {0};

    put_floats(&m, "VEC3", positions, 3 * vertices, vertices);
    put_floats(&m, "VEC3", normals, 3 * vertices, vertices);
    put_floats(&m, "VEC2", uv, 2 * vertices, vertices);
    maker_import(&m,
                 ONE_NODE ",\"materials\":[{\"normalTexture\":{\"index\":0}}]," PNG_IMAGE
                          ",\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{"
                          "\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_0\":2}}]}]",
                 r);
}

static const float *tangent_of(const struct mesh_view *v, size_t corner)
{
    return v->tangents + 4 * v->indices[corner];
}

static const float up[27] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0,
                             1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};

/* The mean at a shared vertex is weighted with the angles there: 90 and 45 degrees. */
static void test_tangents_weighted(void **state)
{
    /* Around (0, 0): a quarter whose u grows along +x, and an eighth whose u grows along +y. */
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, -1, 1, 0};
    /* u = x, v = -y; then at the edge x = 0 the same u and v, and u + 1 at (-1, 1). */
    static const float uv[12] = {0, 0, 1, 0, 0, -1, 0, 0, 0, -1, -1, 0};
    struct import_result r;
    struct mesh_view v;
    float first[2], second[2] = {0.5f, 0.5f}, sum[2], length;

    (void)state;
    import_corners(positions, up, uv, 6, &r);
    v = view_mesh(&r, 0);
    /* The second triangle: edges (0, 1) -> (0, -1) and (-1, 1) -> (-1, 0). u does not change
     * along y, so (-1, 0) must give -1: its u grows along +x; its v falls by 1 along +y, and
     * along x it is -1 (v(-1, 1) = 0 = -1 * 1 - 1 * -1). The direction where v stays and u
     * grows is (1, -1) / sqrt 2. */
    first[0] = 1, first[1] = 0;
    second[0] = 0.70710678f, second[1] = -0.70710678f;
    for (int c = 0; c < 2; c++)
        sum[c] = 2 * first[c] + second[c];
    length = sqrtf(sum[0] * sum[0] + sum[1] * sum[1]);
    assert_floats(tangent_of(&v, 0), (const float[]){sum[0] / length, sum[1] / length, 0, 1}, 4, 1e-5f);
    assert_memory_equal(tangent_of(&v, 0), tangent_of(&v, 3), 16);
    /* Where only one of them is, it alone counts. */
    assert_floats(tangent_of(&v, 1), (const float[]){1, 0, 0, 1}, 4, 1e-6f);
    assert_floats(tangent_of(&v, 5), (const float[]){second[0], second[1], 0, 1}, 4, 1e-6f);
    import_result_release(&r);
}

/* Two triangles that touch in one vertex only are two groups. */
static void test_tangents_touching(void **state)
{
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, -1, 0};
    static const float uv[12] = {0, 0, 1, 0, 0, -1, 0, 0, 0, -1, -1, 0};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    import_corners(positions, up, uv, 6, &r);
    v = view_mesh(&r, 0);
    assert_floats(tangent_of(&v, 0), (const float[]){1, 0, 0, 1}, 4, 1e-6f);
    assert_floats(tangent_of(&v, 3), (const float[]){0, 1, 0, 1}, 4, 1e-6f);
    assert_int_equal(v.mesh->vertex_count, 6);
    import_result_release(&r);
}

/* A triangle without area in the texture takes the tangent and hand of the group that reaches
 * it, and does not bend it. */
static void test_tangents_flat_texture(void **state)
{
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const float uv[12] = {0, 0, -1, 0, 0, -1, -1, 0, -1, 0, 0, -1};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    import_corners(positions, up, uv, 6, &r);
    v = view_mesh(&r, 0);
    /* Mirrored: u falls along x. */
    for (size_t c = 0; c < 6; c++)
        if (c != 4)
            assert_floats(tangent_of(&v, c), (const float[]){-1, 0, 0, -1}, 4, 1e-6f);
    /* Its third corner no group reaches: any direction in the plane, but the same hand. */
    assert_true(tangent_of(&v, 4)[2] == 0 && tangent_of(&v, 4)[3] == -1);
    import_result_release(&r);
}

/* Of three triangles at one edge two are neighbours. */
static void test_tangents_three_at_an_edge(void **state)
{
    static const float positions[27] = {0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 1, 0, 0, 0,
                                        0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0};
    static const float uv[18] = {0, 0, 0, -1, -1, 0, 0, -1, 0, 0, 1, 0, 0, -1, 0, 0, 1, 0};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    import_corners(positions, up, uv, 9, &r);
    v = view_mesh(&r, 0);
    for (size_t c = 0; c < 6; c++)
        assert_floats(tangent_of(&v, c), (const float[]){1, 0, 0, 1}, 4, 1e-6f);
    for (size_t c = 6; c < 9; c++) /* u = x, v = x - y: alone */
        assert_floats(tangent_of(&v, c), (const float[]){0.70710678f, 0.70710678f, 0, 1}, 4, 1e-6f);
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tangents),
        cmocka_unit_test(test_tangents_transformed),
        cmocka_unit_test(test_tangents_flat),
        cmocka_unit_test(test_tangents_supplied),
        cmocka_unit_test(test_tangents_weighted),
        cmocka_unit_test(test_tangents_touching),
        cmocka_unit_test(test_tangents_flat_texture),
        cmocka_unit_test(test_tangents_three_at_an_edge),
    };

    return cmocka_run_group_tests_name("glTF tangents", tests, NULL, NULL);
}
