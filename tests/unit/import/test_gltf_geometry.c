/* glTF: accessors of every kind, primitive modes, and what becomes of triangles. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "tests/support/gltf_maker.h"

static void test_triangle(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;
    struct mesh_view v;

    (void)state;
    maker_import(&m, ONE_NODE "," ONE_TRIANGLE, &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_int_equal(r.triangles, 1);
    v = view_mesh(&r, 0);
    assert_int_equal(v.mesh->vertex_count, 3);
    assert_int_equal(v.mesh->arrays, 0); /* no normals: flat shading */
    assert_int_equal(v.mesh->closed, 0);
    assert_floats(v.positions, corner_positions, 9, 0);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(v.indices[i], i);
    assert_true(v.mesh->bounds_max[0] == 1 && v.mesh->bounds_min[2] == 0);
    /* The default material is white, rough metal (glTF 2.0, 5.19). */
    assert_true(r.scene.materials[0].metallic == 1 && r.scene.materials[0].roughness == 1);
    assert_warned(&r, "no camera");
    assert_warned(&r, "no light");
    assert_int_equal(r.scene.environment.constant, 1);
    import_result_release(&r);
}

static void test_digest_is_stable(void **state)
{
    struct import_result r[2];

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct maker m = triangle_maker();
        struct scene copy;
        struct digest digest;
        maker_import(&m, ONE_NODE "," ONE_TRIANGLE, &r[i]);
        assert_int_equal(digest_of(&digest, r[i].packed, r[i].packed_bytes), STATUS_OK);
        assert_true(digest_equal(&digest, &r[i].scene_digest));
        assert_int_equal(scene_unpack(&copy, r[i].packed, r[i].packed_bytes, NULL), STATUS_OK);
        scene_release(&copy);
    }
    assert_true(digest_equal(&r[0].scene_digest, &r[1].scene_digest));
    import_result_release(&r[0]);
    import_result_release(&r[1]);
}

static void test_attributes(void **state)
{
    static const float normals[9] = {0, 0, 2, 0, 0, 1, 0, 0, 0.5f};
    static const float uv0[6] = {0, 0, 1, 0, 0, 1};
    static const uint16_t uv1[6] = {0, 65535, 32768, 0, 65535, 65535};
    static const uint8_t colors[12] = {255, 0, 51, 0, 0, 255, 0, 0, 102, 204, 255, 0};
    static const float wanted_uv1[6] = {0, 1, 0.50000763f, 0, 1, 1};
    static const float wanted_colors[12] = {1, 0, 0.2f, 1, 0, 1, 0, 1, 0.4f, 0.8f, 1, 1};
    static const float unit[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    struct maker m = triangle_maker();
    struct import_result r;
    struct mesh_view v;

    (void)state;
    put_floats(&m, "VEC3", normals, 9, 3);
    put_floats(&m, "VEC2", uv0, 6, 3);
    put_accessor(&m, put_view(&m, uv1, sizeof uv1, 0), "VEC2", 5123, 3, ",\"normalized\":true");
    put_accessor(&m, put_view(&m, colors, sizeof colors, 4), "VEC3", 5121, 3, ",\"normalized\":true");
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{"
                          "\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_0\":2,\"TEXCOORD_1\":3,"
                          "\"COLOR_0\":4}}]}],"
                          "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{"
                          "\"index\":0},\"metallicRoughnessTexture\":{\"index\":0,\"texCoord\":1}"
                          "}}]," PNG_IMAGE,
                 &r);
    v = view_mesh(&r, 0);
    assert_int_equal(v.mesh->arrays, MESH_NORMALS | MESH_UV0 | MESH_UV1 | MESH_COLORS);
    assert_floats(v.normals, unit, 9, 0);
    assert_floats(v.uv0, uv0, 6, 0);
    assert_floats(v.uv1, wanted_uv1, 6, 1e-6f);
    assert_floats(v.colors, wanted_colors, 12, 1e-6f);
    assert_int_equal(r.scene.image_count, 1);
    assert_int_equal(r.scene.texture_count, 1);
    assert_int_equal(r.scene.materials[0].metallic_roughness_texture.uv_set, 1);
    import_result_release(&r);
}

/* Arrays that the material has no use for do not travel. */
static void test_unused_arrays(void **state)
{
    static const float uv[6] = {0, 0, 1, 0, 0, 1};
    static const float white[9] = {1, 1, 1, 1, 1, 1, 1, 1, 1};
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC2", uv, 6, 3);
    put_floats(&m, "VEC3", white, 9, 3);
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"TEXCOORD_0\":1,\"COLOR_0\":2}}]}]",
                 &r);
    assert_int_equal(r.scene.meshes[0].arrays, 0);
    import_result_release(&r);
}

/* Whole numbers up to 255 or 65535 that are not marked as normalized: read as if they were, with a warning. */
static void test_unmarked_colors(void **state)
{
    static const uint8_t bytes[12] = {255, 0, 51, 255, 0, 255, 0, 255, 102, 102, 102, 255};
    static const uint16_t words[12] = {65535, 0, 13107, 65535, 0, 65535, 0, 65535, 26214, 26214, 26214, 65535};
    static const float floats[12] = {255, 0, 51, 255, 0, 255, 0, 255, 102, 102, 102, 255};
    static const float wanted[12] = {1, 0, 0.2f, 1, 0, 1, 0, 1, 0.4f, 0.4f, 0.4f, 1};
    static const float bright[12] = {3, 0, 0, 1, 255, 0.5f, 0, 1, 0, 0, 1, 1};

    (void)state;
    for (int i = 0; i < 4; i++) {
        struct maker m = triangle_maker();
        struct import_result r;

        if (i == 0)
            put_accessor(&m, put_view(&m, bytes, sizeof bytes, 0), "VEC4", 5121, 3, "");
        else if (i == 1)
            put_accessor(&m, put_view(&m, words, sizeof words, 0), "VEC4", 5123, 3, "");
        else
            put_floats(&m, "VEC4", i == 2 ? floats : bright, 12, 3);
        maker_import(&m,
                     ONE_NODE ",\"meshes\":[{\"name\":\"shirt\",\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                              "\"COLOR_0\":1}}]}]",
                     &r);
        assert_int_equal(warned(&r, "of \"shirt\": COLOR_0 goes up to "), i < 3);
        if (i < 3)
            assert_floats(view_mesh(&r, 0).colors, wanted, 12, 1e-6f);
        else
            assert_true(view_mesh(&r, 0).colors[0] == 1 && view_mesh(&r, 0).colors[5] == 0.5f);
        import_result_release(&r);
    }
}

static void test_quantized(void **state)
{
    static const int16_t positions[12] = {0, 0, 0, 0, 32767, 0, 0, 0, 0, -32767, 16384, 0};
    static const int8_t normals[12] = {0, 0, 127, 0, 0, 0, 127, 0, 0, 0, -128, 0};
    static const float wanted[9] = {0, 0, 0, 1, 0, 0, 0, -1, 0.50001526f};
    static const float wanted_normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, -1};
    struct maker m = {0};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    put_accessor(&m, put_view(&m, positions, sizeof positions, 8), "VEC3", 5122, 3, ",\"normalized\":true");
    put_accessor(&m, put_view(&m, normals, sizeof normals, 4), "VEC3", 5120, 3, ",\"normalized\":true");
    maker_import(&m,
                 ONE_NODE ",\"extensionsUsed\":[\"KHR_mesh_quantization\"],"
                          "\"extensionsRequired\":[\"KHR_mesh_quantization\"],"
                          "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"NORMAL\":1}}]}]",
                 &r);
    v = view_mesh(&r, 0);
    assert_floats(v.positions, wanted, 9, 1e-6f);
    assert_floats(v.normals, wanted_normals, 9, 1e-6f);
    import_result_release(&r);
    /* Not normalized: plain numbers. */
    put_accessor(&m, put_view(&m, positions, sizeof positions, 8), "VEC3", 5122, 3, "");
    maker_import(&m, ONE_NODE "," ONE_TRIANGLE, &r);
    assert_true(view_mesh(&r, 0).positions[3] == 32767);
    import_result_release(&r);
}

static void test_interleaved(void **state)
{
    float rows[3][6];
    char more[64];
    struct maker m = {0};
    struct import_result r;
    struct mesh_view v;
    int view;

    (void)state;
    for (int i = 0; i < 3; i++) {
        memcpy(rows[i], corner_positions + 3 * i, 12);
        rows[i][3] = 0, rows[i][4] = 1, rows[i][5] = 0;
    }
    view = put_view(&m, rows, sizeof rows, 24);
    put_accessor(&m, view, "VEC3", 5126, 3, "");
    snprintf(more, sizeof more, ",\"byteOffset\":12");
    put_accessor(&m, view, "VEC3", 5126, 3, more);
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"NORMAL\":1}}]}]",
                 &r);
    v = view_mesh(&r, 0);
    assert_floats(v.positions, corner_positions, 9, 0);
    assert_true(v.normals[1] == 1 && v.normals[4] == 1 && v.normals[8] == 0);
    import_result_release(&r);
}

static void test_sparse(void **state)
{
    static const uint8_t where[2] = {1, 2};
    static const float values[6] = {1, 0, 0, 0, 1, 0};
    struct maker m = {0};
    struct import_result r;

    (void)state;
    put_view(&m, where, sizeof where, 0);
    put_view(&m, values, sizeof values, 0);
    /* No bufferView: the rest is zeros. */
    put_accessor(&m, -1, "VEC3", 5126, 3,
                 ",\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":0,\"componentType\":5121},"
                 "\"values\":{\"bufferView\":1}}");
    maker_import(&m, ONE_NODE "," ONE_TRIANGLE, &r);
    assert_floats(view_mesh(&r, 0).positions, corner_positions, 9, 0);
    import_result_release(&r);

    put_view(&m, (const uint8_t[]){1, 3}, 2, 0);
    put_view(&m, values, sizeof values, 0);
    put_accessor(&m, -1, "VEC3", 5126, 3,
                 ",\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":0,\"componentType\":5121},"
                 "\"values\":{\"bufferView\":1}}");
    maker_refuse(&m, ONE_NODE "," ONE_TRIANGLE, "accessors[0]|index 3");
}

/* Indices of each type, and the three ways to list triangles. */
static void test_modes(void **state)
{
    /* A strip of four triangles over a row of points. */
    static const float row[18] = {0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 2, 0, 0, 2, 1, 0};
    static const uint8_t bytes[6] = {0, 1, 2, 3, 4, 5};
    static const uint16_t shorts[6] = {0, 1, 2, 3, 4, 5};
    static const uint32_t words[6] = {0, 1, 2, 3, 4, 5};
    static const uint32_t strip[12] = {0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4};
    static const uint32_t fan[12] = {1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5, 0};
    static const uint32_t list[6] = {0, 1, 2, 3, 4, 5};

    (void)state;
    for (int type = 0; type < 4; type++)
        for (int mode = 4; mode <= 6; mode++) {
            const uint32_t *wanted = mode == 4 ? list : mode == 5 ? strip : fan;
            size_t corners = mode == 4 ? 6 : 12, kept = 0;
            struct maker m = {0};
            struct import_result r;
            struct mesh_view v;
            char text[256], indices[32] = "";
            put_floats(&m, "VEC3", row, 18, 6);
            if (type == 0)
                put_accessor(&m, put_view(&m, bytes, sizeof bytes, 0), "SCALAR", 5121, 6, "");
            if (type == 1)
                put_accessor(&m, put_view(&m, shorts, sizeof shorts, 0), "SCALAR", 5123, 6, "");
            if (type == 2)
                put_accessor(&m, put_view(&m, words, sizeof words, 0), "SCALAR", 5125, 6, "");
            if (type < 3) /* 3: without indices */
                snprintf(indices, sizeof indices, ",\"indices\":1");
            snprintf(text, sizeof text,
                     ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                              "\"mode\":%d%s}]}]",
                     mode, indices);
            maker_import(&m, text, &r);
            v = view_mesh(&r, 0);
            /* Fan triangles whose corners lie on one line are dropped. */
            for (size_t t = 0; t < corners; t += 3) {
                const float *a = row + 3 * wanted[t], *b = row + 3 * wanted[t + 1];
                const float *c = row + 3 * wanted[t + 2];
                float area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                if (area == 0)
                    continue;
                for (size_t i = 0; i < 3; i++)
                    assert_floats(v.positions + 3 * v.indices[3 * kept + i], row + 3 * wanted[t + i], 3, 0);
                kept++;
            }
            assert_int_equal(v.mesh->triangle_count, kept);
            import_result_release(&r);
        }
}

static void test_points_and_lines(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}},"
                          "{\"attributes\":{\"POSITION\":0},\"mode\":0},"
                          "{\"attributes\":{\"POSITION\":0},\"mode\":1},"
                          "{\"attributes\":{\"POSITION\":0},\"mode\":3}]}]",
                 &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_warned(&r, "meshes[0].primitives[1]: is made of points");
    assert_warned(&r, "lines, which are not rendered (and 1 more of this kind)");
    import_result_release(&r);
}

static void test_degenerate(void **state)
{
    static const float positions[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0, 9, 9, 9};
    static const uint16_t indices[12] = {0, 1, 2, 0, 1, 3, 2, 2, 1, 4, 4, 4};
    struct maker m = {0};
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", positions, 15, 5);
    put_accessor(&m, put_view(&m, indices, sizeof indices, 0), "SCALAR", 5123, 12, "");
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"indices\":1}]}]",
                 &r);
    assert_int_equal(r.degenerate_triangles, 3);
    assert_int_equal(r.scene.meshes[0].triangle_count, 1);
    /* What nothing uses any more is gone, from the bounds too. */
    assert_int_equal(r.scene.meshes[0].vertex_count, 3);
    assert_true(r.scene.meshes[0].bounds_max[0] == 1);
    assert_warned(&r, "3 triangles without area");
    import_result_release(&r);
}

/* Positions far smaller than floats can square still have an area. */
static void test_tiny(void **state)
{
    float positions[9];
    struct maker m = {0};
    struct import_result r;

    (void)state;
    for (int i = 0; i < 9; i++)
        positions[i] = corner_positions[i] * 1e-18f;
    put_floats(&m, "VEC3", positions, 9, 3);
    maker_import(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"scale\":[1e18,1e18,1e18]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.triangles, 1);
    import_result_release(&r);
}

static void test_closed(void **state)
{
    static const char rest[] = ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                                        "\"POSITION\":0},\"indices\":1}]}]";
    static const char open[] = ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                                        "\"POSITION\":0},\"indices\":2}]}]";

    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        struct maker m = {0};
        struct import_result r;
        put_box(&m, kind == 1);
        if (kind == 2) /* all but the last two triangles */
            put_accessor(&m, 1, "SCALAR", 5123, 30, "");
        maker_import(&m, kind == 2 ? open : rest, &r);
        assert_int_equal(r.scene.meshes[0].closed, kind == 0);
        assert_int_equal(warned(&r, "all its faces look inwards"), kind == 1);
        import_result_release(&r);
    }
    { /* of a double-sided material it looks as it should */
        struct maker m = {0};
        struct import_result r;
        put_box(&m, 1);
        maker_import(&m,
                     ONE_NODE ",\"materials\":[{\"doubleSided\":true}],\"meshes\":[{\"primitives\":[{\"material\":0,"
                              "\"attributes\":{\"POSITION\":0},\"indices\":1}]}]",
                     &r);
        assert_false(warned(&r, "inwards"));
        assert_int_equal(r.scene.meshes[0].closed, 0);
        import_result_release(&r);
    }
}

static void test_bad_normals(void **state)
{
    const float normals[9] = {0, 0, 0, NAN, 0, 1, 0, 0, 1};
    static const float wanted[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", normals, 9, 3);
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"NORMAL\":1}}]}]",
                 &r);
    assert_floats(view_mesh(&r, 0).normals, wanted, 9, 0);
    assert_warned(&r, "2 normals have no direction");
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_triangle),
        cmocka_unit_test(test_digest_is_stable),
        cmocka_unit_test(test_attributes),
        cmocka_unit_test(test_unused_arrays),
        cmocka_unit_test(test_unmarked_colors),
        cmocka_unit_test(test_quantized),
        cmocka_unit_test(test_interleaved),
        cmocka_unit_test(test_sparse),
        cmocka_unit_test(test_modes),
        cmocka_unit_test(test_points_and_lines),
        cmocka_unit_test(test_degenerate),
        cmocka_unit_test(test_tiny),
        cmocka_unit_test(test_closed),
        cmocka_unit_test(test_bad_normals),
    };

    return cmocka_run_group_tests_name("glTF geometry", tests, NULL, NULL);
}
