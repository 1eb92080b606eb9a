/* glTF: broken files get an error that names the place; nothing leaks when memory is short. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/gltf_maker.h"

static void test_extension_errors(void **state)
{
    struct maker m = {0};
    struct import_result r;

    (void)state;
    maker_refuse(&m, "\"extensionsRequired\":[\"ACME_magic\"]", "ACME_magic|not supported");
    maker_refuse(&m, "\"extensionsRequired\":[\"KHR_texture_basisu\"]", "KHR_texture_basisu|convert");
    maker_refuse(&m, "\"extensionsRequired\":[7]", "extensionsRequired[0]");
    m = triangle_maker();
    maker_import(&m, "\"extensionsUsed\":[\"ACME_magic\",\"KHR_xmp\",\"EXT_mesh_features\",\"ACME_more\"]," ONE_NODE "," ONE_TRIANGLE, &r);
    assert_warned(&r, "ACME_magic");
    assert_warned(&r, "ACME_more");
    assert_false(warned(&r, "KHR_xmp"));
    assert_false(warned(&r, "EXT_mesh_features"));
    import_result_release(&r);
    m = triangle_maker();
    maker_import(&m,
                 "\"extensionsRequired\":[\"KHR_mesh_quantization\",\"KHR_texture_transform\","
                 "\"KHR_materials_clearcoat\",\"KHR_materials_anisotropy\","
                 "\"KHR_materials_sheen\",\"KHR_materials_iridescence\","
                 "\"KHR_materials_dispersion\",\"KHR_materials_diffuse_transmission\","
                 "\"KHR_materials_diffuse_roughness\","
                 "\"KHR_materials_variants\",\"KHR_materials_pbrSpecularGlossiness\","
                 "\"KHR_lights_punctual\",\"EXT_mesh_gpu_instancing\",\"EXT_texture_webp\","
                 "\"KHR_draco_mesh_compression\",\"EXT_meshopt_compression\",\"KHR_meshopt_compression\","
                 "\"KHR_animation_pointer\",\"KHR_node_visibility\"]," ONE_NODE "," ONE_TRIANGLE,
                 &r);
    import_result_release(&r);
}

static void test_buffer_errors(void **state)
{
    static const struct {
        const char *tables, *words;
    } cases[] = {
        {"\"buffers\":[{\"byteLength\":36}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]",
         "buffers[0]|no binary chunk"},
        {"\"buffers\":[{\"byteLength\":99,\"uri\":\"data:,abc\"}],\"bufferViews\":[{\"buffer\":0,"
         "\"byteLength\":36}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,"
         "\"type\":\"VEC3\"}]",
         "buffers[0]|holds 3 bytes|99"},
        {"\"buffers\":[{\"byteLength\":3,\"uri\":\"data:,abc\"}],\"bufferViews\":[{\"buffer\":0,"
         "\"byteOffset\":1,\"byteLength\":3}],\"accessors\":[{\"bufferView\":0,\"componentType\":"
         "5121,\"count\":1,\"type\":\"VEC3\"}]",
         "bufferViews[0]|1 to 4"},
        {"\"buffers\":[{\"byteLength\":3,\"uri\":\"data:,abc\"}],\"bufferViews\":[{\"buffer\":0,"
         "\"byteLength\":3}],\"accessors\":[{\"bufferView\":0,\"componentType\":5121,\"count\":2,"
         "\"type\":\"VEC3\"}]",
         "accessors[0]|do not fit"},
        {"\"buffers\":[{\"byteLength\":3,\"uri\":\"data:,abc\"}],\"bufferViews\":[{\"buffer\":0,"
         "\"byteLength\":3}],\"accessors\":[{\"bufferView\":0,\"componentType\":5121,\"count\":"
         "4294967294,\"type\":\"VEC3\"}]",
         "accessors[0]|do not fit"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":4000000000,\"type\":\"VEC3\"}]",
         "accessors[0]|without a bufferView"},
        {"\"accessors\":[{\"componentType\":5124,\"count\":3,\"type\":\"VEC3\"}]", "accessors[0]|5124"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":0,\"type\":\"VEC3\"}]", "accessors[0]|count"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC5\"}]", "accessors[0]|VEC5"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"}]",
         "meshes[0].primitives[0].attributes|POSITION"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":-3,\"type\":\"VEC3\"}]", "accessors[0]|count"},
        {"\"accessors\":[{\"componentType\":5126,\"count\":3.5,\"type\":\"VEC3\"}]", "accessors[0]|count"},
        {"\"accessors\":{}", "accessors must be an array"},
        {"\"buffers\":[{\"byteLength\":3,\"uri\":\"http://host/a.bin\"}],\"bufferViews\":[{"
         "\"buffer\":0,\"byteLength\":3}],\"accessors\":[{\"bufferView\":0,\"componentType\":5121,"
         "\"count\":1,\"type\":\"VEC3\"}]",
         "buffers[0]"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = {0};
        char rest[1024];
        snprintf(rest, sizeof rest, ONE_NODE "," ONE_TRIANGLE ",%s", cases[i].tables);
        maker_refuse(&m, rest, cases[i].words);
    }
}

static void test_geometry_errors(void **state)
{
    const float infinite[9] = {0, 0, 0, 1, 0, INFINITY, 0, 1, 0};
    static const float far_away[9] = {0, 0, 0, 1, 0, 0, 0, 2e15f, 0};
    static const uint8_t wrong[3] = {0, 1, 3};
    static const char indexed[] = ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                                           "\"POSITION\":0},\"indices\":1}]}]";
    struct maker m = {0};

    (void)state;
    put_floats(&m, "VEC3", infinite, 9, 3);
    maker_refuse(&m, ONE_NODE "," ONE_TRIANGLE, "accessors[0]|element 1|finite");
    memset(&m, 0, sizeof m);
    put_floats(&m, "VEC3", far_away, 9, 3);
    maker_refuse(&m, ONE_NODE "," ONE_TRIANGLE, "meshes[0].primitives[0].attributes|1e15");
    m = triangle_maker();
    put_accessor(&m, put_view(&m, wrong, sizeof wrong, 0), "SCALAR", 5121, 3, "");
    maker_refuse(&m, indexed, "meshes[0].primitives[0]|index 2 is 3");
    m = triangle_maker();
    put_accessor(&m, put_view(&m, wrong, sizeof wrong, 0), "SCALAR", 5120, 3, "");
    maker_refuse(&m, indexed, "accessors[1]|5121");
    m = triangle_maker();
    put_floats(&m, "VEC3", corner_positions, 6, 2);
    maker_refuse(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"NORMAL\":1}}]}]",
                 "NORMAL has 2|POSITION has 3");
    m = triangle_maker();
    maker_refuse(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"mode\":7}]}]",
                 "mode 7");
    m = triangle_maker();
    maker_refuse(&m, ONE_NODE ",\"meshes\":[{\"primitives\":[]}]", "meshes[0]|no primitives");
    m = triangle_maker();
    maker_refuse(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"material\":0}]}]",
                 "material is 0|has 0");
    m = triangle_maker();
    maker_refuse(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
                          "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36,\"byteStride\":8}]",
                 "accessors[0]|byteStride is 8");
}

static void test_file_errors(void **state)
{
    struct import_result r;
    struct error err = {0};

    (void)state;
    refuse_text("", "is empty");
    refuse_text("{", "not JSON|line 1");
    refuse_text("[]", "asset");
    refuse_text("{\"asset\":{}}", "version");
    refuse_text("{\"asset\":{\"version\":\"1.0\"}}", "1.0|2.0 is read");
    refuse_text("{\"asset\":{\"version\":\"2.0\",\"minVersion\":\"2.1\"}}", "2.1");
    refuse_text("{\"asset\":{\"version\":\"2.0\"}}", "nothing to render");
    assert_int_equal(import_scene_memory("solid a\n", 8, "a.stl", NULL, &defaults, &r, &err), STATUS_ERR_UNSUPPORTED);
    assert_says(&err, "a.stl|glTF 2.0|.glb");
    assert_int_equal(import_scene("/nonexistent/a.gltf", &defaults, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "/nonexistent/a.gltf");
    /* Nested beyond reason: an error, no stack overflow. */
    {
        struct buffer deep = BUFFER_INIT;
        buffer_puts(&deep, "{\"asset\":");
        for (int i = 0; i < 100000; i++)
            buffer_puts(&deep, "[");
        refuse_text(buffer_text(&deep), "not JSON|depth");
        buffer_release(&deep);
    }
}

static void append_word(struct buffer *out, uint32_t value) { buffer_append(out, &value, sizeof value); }

static void make_glb(struct buffer *out, char padding)
{
    static const char json[] =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":36}],\"bufferViews\":[{"
        "\"buffer\":0,\"byteLength\":36}],\"accessors\":[{\"bufferView\":0,\"componentType\":5126,"
        "\"count\":3,\"type\":\"VEC3\"}]," ONE_NODE "," ONE_TRIANGLE "}";
    size_t length = (sizeof json - 1 + 3) / 4 * 4;

    append_word(out, 0x46546c67);
    append_word(out, 2);
    append_word(out, (uint32_t)(12 + 8 + length + 8 + 36));
    append_word(out, (uint32_t)length);
    append_word(out, 0x4e4f534a);
    buffer_append(out, json, sizeof json - 1);
    while (out->size % 4)
        buffer_append(out, &padding, 1);
    append_word(out, 36);
    append_word(out, 0x004e4942);
    buffer_append(out, corner_positions, sizeof corner_positions);
}

static void test_glb(void **state)
{
    struct buffer glb = BUFFER_INIT;
    struct import_result r;
    struct error err = {0};

    (void)state;
    make_glb(&glb, 0); /* as some programs pad it */
    import_ok_with(glb.data, glb.size, "a.glb", &defaults, &r);
    import_result_release(&r);
    buffer_release(&glb);
    make_glb(&glb, ' ');
    assert_true(memchr(glb.data + 20, ' ', glb.size - 20) != NULL);
    import_ok_with(glb.data, glb.size, "no-extension", &defaults, &r);
    assert_floats(view_mesh(&r, 0).positions, corner_positions, 9, 0);
    import_result_release(&r);
    for (size_t size = 1; size < glb.size; size++) {
        uint8_t *cut = mem_memdup(glb.data, size);
        assert_int_not_equal(import_scene_memory(cut, size, "a.glb", NULL, &defaults, &r, &err), STATUS_OK);
        mem_free(cut);
    }
    glb.data[4] = 1;
    assert_int_equal(import_scene_memory(glb.data, glb.size, "a.glb", NULL, &defaults, &r, &err),
                     STATUS_ERR_UNSUPPORTED);
    assert_says(&err, "version 1");
    buffer_release(&glb);
}

static void test_no_memory(void **state)
{
    struct maker m = {0};

    (void)state;
    put_mirrored_quads(&m);
    /* The effects analysis does without its table when it must. */
    maker_starve(&m,
                 ONE_NODE "," NORMAL_MAPPED("") ",\"cameras\":[{\"name\":\"c\",\"type\":"
                                                "\"perspective\",\"perspective\":{\"yfov\":1}}],"
                                                "\"animations\":[{}],\"skins\":[]",
                 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_extension_errors),
        cmocka_unit_test(test_buffer_errors),
        cmocka_unit_test(test_geometry_errors),
        cmocka_unit_test(test_file_errors),
        cmocka_unit_test(test_glb),
        cmocka_unit_test(test_no_memory),
    };

    return cmocka_run_group_tests_name("glTF errors", tests, NULL, NULL);
}
