/* glTF: files on disk, the environment map, the report; and, where AZULEJO_DATA names the
 * folder of test data, real and hostile ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/import/builder/uri.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/scratch.h"

static void write_file(const char *name, const void *data, size_t size, char *path, size_t room)
{
    struct error err = {0};

    snprintf(path, room, "%s/%s", folder, name);
    if (file_write_atomic(path, data, size, &err) != STATUS_OK)
        fail_msg("%s", err.text);
}

static void write_scene(const char *uri, char *path, size_t room)
{
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text,
                  "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":36,"
                  "\"uri\":\"%s\"}],"
                  "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"accessors\":[{"
                  "\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]," ONE_NODE "," ONE_TRIANGLE
                  "}",
                  uri);
    write_file("scene.gltf", text.data, text.size, path, room);
    buffer_release(&text);
}

static void test_external_files(void **state)
{
    static const char *const good[] = {"a b.bin", "a%20b.bin", "sub/../a%20b.bin", "%61%20b.bin",
                                       "./a b.bin", "h\xc3\xa9.bin", "100%.bin", "sub\\\\c.bin"};
    static const struct {
        const char *uri, *words;
    } bad[] = {
        {"missing.bin", "missing.bin|No such file"},
        {"/etc/passwd", "outside|--allow-outside /etc"},
        {"%2Fetc/passwd", "outside|--allow-outside /etc"},
        {"file:///etc/passwd", "scheme"},
        {"http://example.org/a.bin", "scheme"},
        {"C:\\\\a.bin", "scheme"},
        {"../../../../../etc/passwd", "outside|--allow-outside /etc"},
        {"..%2F..%2F..%2F..%2F..%2Fetc/passwd", "outside|--allow-outside /etc"},
        {"a%00.bin", "does not name a file"},
        {"", "does not name a file"},
        {"sub", "regular file"},
        {"short.bin", "holds 3 bytes"},
    };
    char path[256];
    struct import_result r;

    (void)state;
    snprintf(path, sizeof path, "%s/sub", folder);
    assert_int_equal(mkdir(path, 0700), 0);
    write_file("a b.bin", corner_positions, 36, path, sizeof path);
    write_file("h\xc3\xa9.bin", corner_positions, 36, path, sizeof path);
    write_file("100%.bin", corner_positions, 36, path, sizeof path);
    write_file("sub/c.bin", corner_positions, 36, path, sizeof path);
    write_file("short.bin", "abc", 3, path, sizeof path);
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        struct error err = {0};
        write_scene(good[i], path, sizeof path);
        if (import_scene(path, &defaults, &r, &err) != STATUS_OK)
            fail_msg("%s: %s", good[i], err.text);
        assert_int_equal(r.triangles, 1);
        assert_string_equal(r.source, path);
        import_result_release(&r);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct error err = {0};
        write_scene(bad[i].uri, path, sizeof path);
        assert_int_not_equal(import_scene(path, &defaults, &r, &err), STATUS_OK);
        assert_says(&err, "scene.gltf: buffers[0]");
        assert_says(&err, bad[i].words);
    }
}

/* As browsers read them, or more leniently. */
static void test_data_uris(void **state)
{
    static const char *const good[] = {
        "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        "DATA:application/octet-stream;BASE64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        " data:application/octet-stream; base64 ,AAAAAAAAAAAA AAAAAACAPwAAAAAA\\nAAAAAAAAAAAAgD8AAAAA ",
        "data:application/octet-stream;base64;charset=utf-8,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA",
        "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAA%41",
        "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAA%3D%3D",
        "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAA==",
        "data:,%00%00%00%00%00%00%00%00%00%00%00%00%00%00%80%3f%00%00%00%00%00%00%00%00%00%00%00%00%00%00%80%3f%00%00%00%00",
    };
    static const char *const bad[][2] = {
        {"data:;base64,AAAAAAAA*AAA", "invalid character at position 8"},
        {"data:;base64,AA==AAAA", "invalid character at position 4"},
        {"data:;base64,AAAAA", "base64 data is cut short"},
    };
    char path[256];
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        struct error err = {0};
        write_scene(good[i], path, sizeof path);
        if (import_scene(path, &defaults, &r, &err) != STATUS_OK)
            fail_msg("%s: %s", good[i], err.text);
        assert_int_equal(r.triangles, 1);
        assert_floats(view_mesh(&r, 0).positions, corner_positions, 9, 0);
        import_result_release(&r);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct error err = {0};
        write_scene(bad[i][0], path, sizeof path);
        assert_int_not_equal(import_scene(path, &defaults, &r, &err), STATUS_OK);
        assert_says(&err, bad[i][1]);
    }
}

/* The alphabet for URLs: all four digits that differ, in every place. */
static void test_url_base64(void **state)
{
    struct buffer usual = BUFFER_INIT, other = BUFFER_INIT;
    struct error err = {0};

    (void)state;
    assert_int_equal(uri_decode_data("data:;base64,+/+//+/+AAA+/w==", 100, &usual, &err), STATUS_OK);
    assert_int_equal(uri_decode_data("data:;base64,-_-__-_-AAA-_w", 100, &other, &err), STATUS_OK);
    assert_int_equal(usual.size, 10);
    assert_int_equal(other.size, 10);
    assert_memory_equal(usual.data, other.data, 10);
    assert_memory_equal(usual.data, "\xfb\xff\xbf\xff\xef\xfe\0\0\x3e\xff", 10);
    buffer_release(&usual);
    buffer_release(&other);
}

static void test_environment(void **state)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct image image = {0};
    struct buffer exr = BUFFER_INIT;
    struct exr_options how = {0};
    struct error err = {0};
    struct import_result r;
    char path[256], scene[256];
    int seen = 0;

    (void)state;
    write_scene("data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA", scene, sizeof scene);
    assert_int_equal(image_init(&image, 4, 2, 3, &err), STATUS_OK);
    image.pixels[0] = -1;
    image.pixels[3] = 1;
    assert_int_equal(exr_encode(&exr, &image, &how, &err), STATUS_OK);
    write_file("sky.exr", exr.data, exr.size, path, sizeof path);
    options.env_path = path;
    if (import_scene(scene, &options, &r, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_true(r.scene.environment.present && !r.scene.environment.constant);
    assert_string_equal(r.scene.environment.image.name, "sky.exr");
    assert_int_equal(r.scene.environment.image.blob.size_bytes, exr.size);
    assert_true(r.scene.environment.brightest == 1);
    assert_int_equal(r.blob_count, 2);
    assert_warned(&r, "1 negative");
    assert_false(warned(&r, "no light"));
    import_result_release(&r);
    /* A part of a larger sky is placed in it. */
    buffer_clear(&exr);
    for (size_t i = 0; i < 3 * 4 * 2; i++)
        image.pixels[i] = 1 + (float)i;
    how.window = &(const struct exr_window){16, 8, 5, 3};
    assert_int_equal(exr_encode(&exr, &image, &how, &err), STATUS_OK);
    write_file("part.exr", exr.data, exr.size, path, sizeof path);
    assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_OK);
    assert_warned(&r, "4x2 pixels of a picture of 16x8, from column 5, row 3");
    assert_false(warned(&r, "twice as wide"));
    assert_true(r.scene.environment.brightest == 3 * 4 * 2);
    for (size_t i = 0; i < r.blob_count; i++) {
        struct image_repairs repairs = {0};
        struct image whole;
        if (!digest_equal(&r.blobs[i].digest, &r.scene.environment.image.blob.digest))
            continue;
        assert_int_equal(image_decode_hdr(&whole, r.blobs[i].data, r.blobs[i].size_bytes, "whole", &repairs, &err), STATUS_OK);
        assert_true(whole.width == 16 && whole.height == 8);
        for (uint32_t y = 0; y < 8; y++)
            for (uint32_t x = 0; x < 16; x++)
                for (uint32_t c = 0; c < 3; c++)
                    assert_true(whole.pixels[3 * (16 * y + x) + c] ==
                                (x >= 5 && x < 9 && y >= 3 && y < 5 ? image.pixels[3 * (4 * (y - 3) + x - 5) + c] : 0));
        image_release(&whole);
        seen++;
    }
    assert_int_equal(seen, 1);
    import_result_release(&r);
    /* Each channel counts, and none above what counts at all. */
    for (size_t i = 0; i < 3; i++) {
        how.window = NULL;
        image.pixels[9 + i] = i == 1 ? 2e30f : 100 + (float)i;
        buffer_clear(&exr);
        assert_int_equal(exr_encode(&exr, &image, &how, &err), STATUS_OK);
        write_file("part.exr", exr.data, exr.size, path, sizeof path);
        assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_OK);
        assert_true(r.scene.environment.brightest == (i == 1 ? SCENE_RADIANCE_MAX : 100 + (float)i));
        assert_true(r.scene.environment.varies);
        import_result_release(&r);
        image.pixels[9 + i] = 0;
    }
    /* One of one colour is a colour. */
    for (int other = 1; other >= 0; other--) {
        for (size_t i = 0; i < 3 * 4 * 2; i++)
            image.pixels[i] = 1 + (float)(i % 3) + (float)(other && i == 23);
        buffer_clear(&exr);
        assert_int_equal(exr_encode(&exr, &image, &how, &err), STATUS_OK);
        write_file("part.exr", exr.data, exr.size, path, sizeof path);
        assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_OK);
        assert_int_equal(r.scene.environment.constant, !other);
        assert_true(other ? r.scene.environment.varies : r.scene.environment.radiance[1] == 2);
        import_result_release(&r);
    }
    how.window = &(const struct exr_window){60000, 60000, 5, 3};
    buffer_clear(&exr);
    assert_int_equal(exr_encode(&exr, &image, &how, &err), STATUS_OK);
    write_file("part.exr", exr.data, exr.size, path, sizeof path);
    assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_ERR_LIMIT);
    assert_says(&err, "part.exr|--max-image");
    write_file("sky.png", "\x89PNG\r\n\x1a\n", 8, path, sizeof path);
    assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "sky.png|OpenEXR");
    write_file("cut.exr", exr.data, exr.size / 2, path, sizeof path);
    assert_int_not_equal(import_scene(scene, &options, &r, &err), STATUS_OK);
    assert_says(&err, "cut.exr");
    options.env_path = "/nonexistent.exr";
    assert_int_equal(import_scene(scene, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "/nonexistent.exr");
    image_release(&image);
    buffer_release(&exr);
}

static void test_report(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;
    char *text = NULL, hex[DIGEST_HEX_SIZE];
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    json_t *json;

    (void)state;
    maker_import(&m, ONE_NODE "," ONE_TRIANGLE ",\"materials\":[{\"name\":\"unused\"}]", &r);
    import_report_print(&r, out);
    fclose(out);
    digest_to_hex(&r.scene_digest, hex);
    assert_non_null(strstr(text, "test.gltf"));
    assert_non_null(strstr(text, hex));
    assert_non_null(strstr(text, "framed"));
    assert_null(strstr(text, "caustics")); /* effects that are not called for are not listed */
    assert_non_null(strstr(text, "warning: the file has no camera"));
    assert_null(strstr(text, "unused"));
    free(text);
    json = import_report_json(&r);
    assert_non_null(json);
    assert_string_equal(json_string_value(json_object_get(json, "digest")), hex);
    assert_int_equal(json_integer_value(json_object_get(json, "triangles")), 1);
    assert_int_equal(json_array_size(json_object_get(json, "materials")), 1);
    assert_int_equal(json_array_size(json_object_get(json, "cameras")), 1);
    assert_int_equal(json_array_size(json_object_get(json, "effects")), 4);
    assert_null(json_object_get(json, "effects_left_out"));
    assert_int_equal(json_array_size(json_object_get(json, "warnings")), r.warning_count);
    json_decref(json);
    import_result_release(&r);
}

/* Call `visit` for every file below `path`. */
static void walk_files(const char *path, void (*visit)(const char *file))
{
    DIR *open = opendir(path);
    struct dirent *entry;

    if (!open) {
        visit(path);
        return;
    }
    while ((entry = readdir(open))) {
        char *inner;
        if (entry->d_name[0] == '.')
            continue;
        inner = file_join(path, entry->d_name);
        walk_files(inner, visit);
        mem_free(inner);
    }
    closedir(open);
}

static size_t visited;

static void visit_model(const char *path)
{
    struct import_result r;
    struct error err = {0};
    status result;

    if (strcmp(file_extension(path), "gltf") != 0 && strcmp(file_extension(path), "glb") != 0)
        return;
    visited++;
    result = import_scene(path, &defaults, &r, &err);
    if (strstr(path, "/unsupported-")) {
        assert_int_equal(result, STATUS_ERR_UNSUPPORTED);
        assert_says(&err, "compression");
        return;
    }
    if (result != STATUS_OK)
        fail_msg("%s", err.text);
    for (uint32_t i = 0; i < r.scene.mesh_count; i++)
        view_mesh(&r, i);
    import_result_release(&r);
}

static void visit_hostile(const char *path)
{
    struct import_result r;
    struct error err = {0};

    visited++;
    if (import_scene(path, &defaults, &r, &err) != STATUS_OK) {
        assert_true(err.text[0] != 0);
        return;
    }
    assert_int_equal(scene_validate(&r.scene, &err), STATUS_OK);
    import_result_release(&r);
}

static const char *data_folder(void) { return getenv("AZULEJO_DATA"); }

static void test_models(void **state)
{
    char path[512];

    (void)state;
    snprintf(path, sizeof path, "%s/gltf", data_folder());
    visited = 0;
    walk_files(path, visit_model);
    assert_true(visited > 0);
}

static void test_hostile_files(void **state)
{
    static const char *const folders[] = {"gltf-validator", "gltf-tinygltf", "gltf-assimp",
                                          "gltf-fastgltf", "json", "mesh-trimesh"};
    char path[512];

    (void)state;
    visited = 0;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        snprintf(path, sizeof path, "%s/fuzz/%s", data_folder(), folders[i]);
        walk_files(path, visit_hostile);
    }
    assert_true(visited > 0);
}

/* Made tangents against those that an exporter wrote: the same model with its TANGENT
 * attributes removed must come out nearly the same, and never with the other hand. */
static void test_real_tangents(void **state)
{
    static const char *const models[] = {"FlightHelmet", "LightsPunctualLamp"};

    (void)state;
    for (size_t i = 0; i < sizeof models / sizeof *models; i++) {
        char path[1024], base[512];
        struct import_result given, made;
        struct error err = {0};
        json_error_t json_err;
        json_t *root, *mesh, *primitive;
        size_t a, b, corners = 0, off = 0, hands = 0;
        char *text;

        snprintf(base, sizeof base, "%s/gltf/%s", data_folder(), models[i]);
        snprintf(path, sizeof path, "%s/%s.gltf", base, models[i]);
        root = json_load_file(path, 0, &json_err);
        assert_non_null(root);
        json_array_foreach(json_object_get(root, "meshes"), a, mesh)
            json_array_foreach(json_object_get(mesh, "primitives"), b, primitive)
                json_object_del(json_object_get(primitive, "attributes"), "TANGENT");
        text = json_dumps(root, 0);
        json_decref(root);
        if (import_scene(path, &defaults, &given, &err) != STATUS_OK ||
            import_scene_memory(text, strlen(text), "a.gltf", base, &defaults, &made, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        free(text);
        for (uint32_t n = 0; n < given.scene.instance_count; n++) {
            struct mesh_view x = view_mesh(&given, given.scene.instances[n].mesh);
            struct mesh_view y = view_mesh(&made, made.scene.instances[n].mesh);
            if (!x.tangents)
                continue;
            for (size_t c = 0; c < 3 * (size_t)x.mesh->triangle_count; c++) {
                const float *t = x.tangents + 4 * x.indices[c], *u = y.tangents + 4 * y.indices[c];
                corners++;
                off += t[0] * u[0] + t[1] * u[1] + t[2] * u[2] < 0.98f;
                hands += t[3] != u[3];
            }
        }
        assert_true(corners > 10000);
        assert_true(off * 50 < corners);     /* 2 % */
        assert_true(hands * 1000 < corners); /* 0.1 %: welded differently */
        import_result_release(&given);
        import_result_release(&made);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_external_files),
        cmocka_unit_test(test_data_uris),
        cmocka_unit_test(test_url_base64),
        cmocka_unit_test(test_environment),
        cmocka_unit_test(test_report),
        /* The last three need the test data. */
        cmocka_unit_test(test_models),
        cmocka_unit_test(test_hostile_files),
        cmocka_unit_test(test_real_tangents),
    };
    size_t count = sizeof tests / sizeof *tests - (getenv("AZULEJO_DATA") ? 0 : 3);

    return _cmocka_run_group_tests("glTF files", tests, count, folder_set_up, folder_tear_down);
}
