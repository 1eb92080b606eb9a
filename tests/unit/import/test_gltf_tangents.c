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
    static const char rest[] =
        ONE_NODE ",\"materials\":[{\"normalTexture\":{\"index\":0}}]," PNG_IMAGE
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
    /* Without a direction they are made anew. */
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tangents),
        cmocka_unit_test(test_tangents_transformed),
        cmocka_unit_test(test_tangents_flat),
        cmocka_unit_test(test_tangents_supplied),
    };

    return cmocka_run_group_tests_name("glTF tangents", tests, NULL, NULL);
}
