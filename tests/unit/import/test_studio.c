/* studio: what a file without light, or without camera and light, is given, and when it is not. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "client/import/import.h"
#include "common/image/image.h"
#include "tests/support/gltf_maker.h"

static const char cube[] = "v 2 3 -1\nv 4 3 -1\nv 4 5 -1\nv 2 5 -1\nv 2 3 1\nv 4 3 1\nv 4 5 1\nv 2 5 1\n"
                           "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
#define BOX "\"meshes\":[{\"primitives\":[{\"indices\":1,\"attributes\":{\"POSITION\":0}}]}]"
#define NODES(more) "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},{" more "}]"
#define CAMERA "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":0.1}}]"

static struct import_options options(const char *studio)
{
    struct import_options o = IMPORT_OPTIONS_OF_COMMANDS;

    assert_string_equal(o.studio, "on");
    o.studio = studio;
    return o;
}

static void import_box(const char *rest, const char *studio, struct import_result *out)
{
    struct maker m = {0};
    struct import_options o = options(studio);
    struct buffer file = BUFFER_INIT;

    put_box(&m, 0);
    maker_write(&m, rest, &file);
    import_ok_with(file.data, file.size, "box.gltf", &o, out);
    buffer_release(&file);
    maker_release(&m);
}

/* The map's lightest and darkest radiance. */
static void read_map(const struct import_result *r, float *least, float *most)
{
    const struct scene_environment *e = &r->scene.environment;
    struct image map;
    struct image_repairs repairs;
    struct error err = {0};
    const struct import_blob *blob = NULL;

    assert_true(e->present && !e->constant);
    for (size_t i = 0; i < r->blob_count; i++)
        if (digest_equal(&r->blobs[i].digest, &e->image.blob.digest))
            blob = &r->blobs[i];
    assert_non_null(blob);
    if (image_decode_hdr(&map, blob->data, blob->size_bytes, "studio", &repairs, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    *least = INFINITY;
    *most = 0;
    for (size_t i = 0; i < (size_t)map.width * map.height * map.channels; i++) {
        *least = fminf(*least, map.pixels[i]);
        *most = fmaxf(*most, map.pixels[i]);
    }
    image_release(&map);
}

static void test_neither(void **state)
{
    struct import_options on = options("on"), off = options("off");
    struct import_result with, without;
    const struct scene_instance *ground;
    const struct scene_mesh *plane;
    float least, most;
    double low;

    (void)state;
    import_ok_with(cube, sizeof cube - 1, "cube.obj", &on, &with);
    import_ok_with(cube, sizeof cube - 1, "cube.obj", &off, &without);
    /* One line says it. */
    assert_int_equal(with.warning_count, 1);
    assert_warned(&with, "neither camera nor light");
    assert_warned(&with, "--studio off");
    /* A light with shape: not even, and dark nowhere. */
    read_map(&with, &least, &most);
    assert_true(least > 0 && most > 10 * least);
    /* The ground lies below the cube and reaches far; the picture is framed as without it. */
    assert_int_equal(with.scene.instance_count, without.scene.instance_count + 1);
    ground = &with.scene.instances[with.scene.instance_count - 1];
    plane = &with.scene.meshes[ground->mesh];
    low = 3 - with.scene.origin[1];
    assert_true(plane->bounds_min[1] == 0 && plane->bounds_max[1] == 0);
    assert_true(ground->to_world.m[1][3] < low && ground->to_world.m[1][3] > low - 0.01);
    assert_true(ground->to_world.m[0][0] > 50);
    assert_memory_equal(&with.scene.cameras[0].to_world, &without.scene.cameras[0].to_world,
                        sizeof with.scene.cameras[0].to_world);
    /* Off: what it was. */
    assert_warned(&without, "no camera");
    assert_warned(&without, "even white");
    assert_true(without.scene.environment.constant);
    import_result_release(&with);
    import_result_release(&without);
}

static void test_same_bits(void **state)
{
    struct import_options on = options("on");
    struct import_result a, b;

    (void)state;
    import_ok_with(cube, sizeof cube - 1, "cube.obj", &on, &a);
    import_ok_with(cube, sizeof cube - 1, "cube.obj", &on, &b);
    assert_true(digest_equal(&a.scene_digest, &b.scene_digest));
    import_result_release(&a);
    import_result_release(&b);
}

/* The file's own camera looks where its maker wants: no ground gets into its way. */
static void test_camera_only(void **state)
{
    struct import_result r;
    float least, most;

    (void)state;
    import_box(NODES("\"camera\":0") "," BOX "," CAMERA, "on", &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_int_equal(r.warning_count, 1);
    assert_warned(&r, "soft studio light");
    read_map(&r, &least, &most);
    import_result_release(&r);
}

static void test_what_needs_none(void **state)
{
    static const char *const files[] = {
        /* a lamp, a lamp of no power, a surface that shines as a lamp, surfaces that are not lit */
        NODES("\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}") "," BOX
        ",\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\"}]}}",
        NODES("\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}") "," BOX
        ",\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\",\"intensity\":0}]}}",
        NODES("\"name\":\"n\"") ",\"materials\":[{\"emissiveFactor\":[1,1,1],\"extensions\":{"
        "\"KHR_materials_emissive_strength\":{\"emissiveStrength\":1.1}}}],\"meshes\":[{\"primitives\":[{"
        "\"material\":0,\"indices\":1,\"attributes\":{\"POSITION\":0}}]}]",
        NODES("\"name\":\"n\"") ",\"materials\":[{\"extensions\":{\"KHR_materials_unlit\":{}}}],\"meshes\":[{\"primitives\":[{"
        "\"material\":0,\"indices\":1,\"attributes\":{\"POSITION\":0}}]}]",
    };

    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        struct import_result r;
        import_box(files[i], "on", &r);
        assert_int_equal(r.scene.instance_count, 1);
        assert_false(r.scene.environment.present);
        assert_false(warned(&r, "studio"));
        assert_warned(&r, "no camera");
        import_result_release(&r);
    }
}

#define GLOWS ",\"materials\":[{\"emissiveFactor\":[0,0,1]}],\"meshes\":[{\"primitives\":[{" \
              "\"material\":0,\"indices\":1,\"attributes\":{\"POSITION\":0}}]}]"

/* A screen, or a lens of a headlight, does not light a model: its picture would be black but for them. */
static void test_what_only_glows(void **state)
{
    struct import_result r;
    float least, most;

    (void)state;
    import_box(NODES("\"name\":\"n\"") GLOWS, "on", &r);
    assert_int_equal(r.scene.instance_count, 2); /* and the ground */
    assert_int_equal(r.warning_count, 1);
    assert_warned(&r, "neither camera nor light but 1 surface that glows");
    assert_warned(&r, "--studio off: none");
    read_map(&r, &least, &most);
    import_result_release(&r);

    import_box(NODES("\"camera\":0") GLOWS "," CAMERA, "on", &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_int_equal(r.warning_count, 1);
    assert_warned(&r, "no light but 1 surface that glows: a soft studio light");
    import_result_release(&r);

    import_box(NODES("\"camera\":0") GLOWS "," CAMERA, "off", &r);
    assert_false(r.scene.environment.present);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);

    import_box(NODES("\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}") GLOWS
               ",\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\"}]}}", "on", &r);
    assert_false(r.scene.environment.present);
    assert_int_equal(r.scene.instance_count, 1);
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_neither),
        cmocka_unit_test(test_same_bits),
        cmocka_unit_test(test_camera_only),
        cmocka_unit_test(test_what_needs_none),
        cmocka_unit_test(test_what_only_glows),
    };

    return cmocka_run_group_tests_name("studio", tests, NULL, NULL);
}
