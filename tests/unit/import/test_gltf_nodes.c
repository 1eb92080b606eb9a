/* glTF: the hierarchy, instances, scenes, cameras and lights. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>

#include "common/math/elementary.h"
#include "common/scene/scene_effects.h"
#include "tests/support/gltf_maker.h"

static void assert_point(const struct import_result *r, uint32_t instance, struct vec3 in, float x, float y, float z)
{
    struct vec3 p = in_file(&r->scene, &r->scene.instances[instance].to_world, in);

    assert_floats(&p.x, (const float[]){x, y, z}, 3, 1e-5f);
}

static void test_hierarchy(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    /* The parent moves and turns a quarter about +Y; the child scales; the grandchild has a
     * matrix and mirrors. */
    maker_import(&m,
                 "\"scene\":0,\"scenes\":[{\"name\":\"tree\",\"nodes\":[0]}],\"nodes\":["
                 "{\"translation\":[10,0,0],\"rotation\":[0,0.7071067811865476,0,"
                 "0.7071067811865476],\"children\":[1]},"
                 "{\"scale\":[2,3,4],\"children\":[2],\"mesh\":0},"
                 "{\"name\":\"leaf\",\"matrix\":[-1,0,0,0,0,1,0,0,0,0,1,0,0,0,5,1],\"mesh\":0}]," ONE_TRIANGLE,
                 &r);
    assert_string_equal(r.scene.name, "tree");
    assert_int_equal(r.scene.mesh_count, 1);
    assert_int_equal(r.scene.instance_count, 2);
    assert_point(&r, 0, vec3_make(1, 1, 1), 14, 3, -2);
    assert_point(&r, 1, vec3_make(1, 1, 1), 34, 3, 2);
    assert_string_equal(r.scene.instances[1].name, "leaf");
    assert_string_equal(r.scene.instances[1].asset, ""); /* the topmost node has no name */
    /* The mirroring stays in the transform: the renderer flips the winding by its sign. */
    assert_true(transform_d_determinant(&r.scene.instances[1].to_world) < 0);
    assert_true(scene_effects_default(&r.scene, 0) & EFFECT_INSTANCING);
    import_result_release(&r);
}

/* What a part belongs to is the topmost node, which may have a mesh itself. */
static void test_assets(void **state)
{
    static const char *const wanted[] = {"", "car", "car", "", "car"};
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,3,4]}],\"nodes\":["
                 "{\"name\":\"car\",\"children\":[1],\"mesh\":0},{\"name\":\"axle\",\"children\":[2],\"mesh\":0},"
                 "{\"name\":\"wheel\",\"mesh\":0},{\"name\":\"tree\",\"mesh\":0},"
                 "{\"name\":\"car\",\"children\":[5]},{\"mesh\":0}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.instance_count, 5);
    for (uint32_t i = 0; i < 5; i++)
        assert_string_equal(r.scene.instances[i].asset, wanted[i]);
    import_result_release(&r);
}

static void test_same_mesh_twice(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    /* Two meshes of the file with the same data are one mesh of the scene. */
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},{\"mesh\":1}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]},"
                 "{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0}]}],"
                 "\"materials\":[{\"name\":\"other\"}]",
                 &r);
    assert_int_equal(r.scene.mesh_count, 1);
    assert_int_equal(r.scene.instance_count, 2);
    assert_int_equal(r.scene.material_count, 2);
    assert_string_equal(r.scene.materials[1].name, "other");
    import_result_release(&r);
}

static void test_node_faults(void **state)
{
    struct maker m = triangle_maker();

    (void)state;
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"children\":[1]},"
                 "{\"children\":[0]}]",
                 "nodes[0]|reached twice");
    m = triangle_maker();
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"children\":[2]},"
                 "{\"children\":[2]},{}]",
                 "nodes[2]|reached twice");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[7]}],\"nodes\":[{}]", "scenes[0]|nodes[0]");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"children\":[-1]}]", "nodes[0]|children[0]");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"scale\":[1,2]}]", "nodes[0]|scale|3 numbers");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":4}]", "nodes[0]|mesh is 4");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[3]", "nodes[0]|object");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{}]", "nothing to render");
    m = triangle_maker();
    maker_refuse(&m, "\"scene\":3,\"scenes\":[{}]", "scene is 3");
    m = triangle_maker();
    maker_refuse(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,"
                     "\"translation\":[1e30,0,0]}],"
                     ONE_TRIANGLE, "instances[0]|1e15");
}

static void test_deep_hierarchy(void **state)
{
    struct buffer text = BUFFER_INIT;

    (void)state;
    for (int depth = 4096; depth <= 4097; depth++) {
        struct maker m = triangle_maker();
        struct import_result r;
        buffer_clear(&text);
        buffer_puts(&text, "\"scenes\":[{\"nodes\":[0]}]," ONE_TRIANGLE ",\"nodes\":[");
        for (int i = 0; i + 1 < depth; i++)
            buffer_printf(&text, "{\"children\":[%d]},", i + 1);
        buffer_puts(&text, "{\"mesh\":0}]");
        if (depth > 4096) {
            maker_refuse(&m, buffer_text(&text), "nodes[4096]|4096 levels");
        } else {
            maker_import(&m, buffer_text(&text), &r);
            import_result_release(&r);
        }
    }
    buffer_release(&text);
}

static void test_flattened_and_hidden(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2]}],\"nodes\":[{\"mesh\":0},"
                 "{\"mesh\":0,\"scale\":[1,0,1]},{\"extensions\":{\"KHR_node_visibility\":{"
                 "\"visible\":false}},\"mesh\":0}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_warned(&r, "flattens");
    import_result_release(&r);
}

static void test_instancing(void **state)
{
    static const float moves[6] = {1, 2, 3, 4, 5, 6};
    static const int16_t turns[8] = {0, 23170, 0, 23170, 0, 0, 0, 32767};
    static const float scales[6] = {2, 2, 2, 1, 1, 1};
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", moves, 6, 2);
    put_accessor(&m, put_view(&m, turns, sizeof turns, 0), "VEC4", 5122, 2, ",\"normalized\":true");
    put_floats(&m, "VEC3", scales, 6, 2);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"translation\":[0,0,100],"
                 "\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":1,"
                 "\"ROTATION\":2,\"SCALE\":3}}}}],"
                 "\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_int_equal(r.triangles_placed, 2);
    assert_point(&r, 0, vec3_make(1, 0, 0), 1, 2, 101);
    assert_point(&r, 1, vec3_make(1, 0, 0), 5, 5, 106);
    import_result_release(&r);
}

static void test_scenes(void **state)
{
    static const char rest[] =
        "\"scene\":1,\"scenes\":[{\"nodes\":[0],\"name\":\"first\"},{\"nodes\":[1],\"name\":"
        "\"second\"}],\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"translation\":[7,0,0]}]," ONE_TRIANGLE;
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct maker m = triangle_maker();
    struct buffer file = BUFFER_INIT;
    struct import_result r;
    struct error err = {0};

    (void)state;
    maker_write(&m, rest, &file);
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_string_equal(r.scene.name, "second");
    assert_warned(&r, "2 scenes");
    import_result_release(&r);
    options.scene_index = 0;
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_string_equal(r.scene.name, "first");
    assert_false(warned(&r, "2 scenes"));
    import_result_release(&r);
    options.scene_index = 2;
    assert_int_equal(import_scene_memory(file.data, file.size, "a.gltf", NULL, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "no scene 2|has 2");
    buffer_release(&file);
    maker_release(&m);
    /* Without scenes all roots are shown. */
    m = triangle_maker();
    maker_import(&m, "\"nodes\":[{\"children\":[1]},{\"mesh\":0},{\"mesh\":0}]," ONE_TRIANGLE, &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_warned(&r, "no scenes");
    import_result_release(&r);
}

static void test_cameras(void **state)
{
    struct maker m = triangle_maker();
    const struct scene_camera *c;
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2,3]}],\"nodes\":[{\"mesh\":0},"
                 "{\"camera\":0,\"translation\":[1,2,3],\"scale\":[5,-5,5],\"rotation\":"
                 "[0,0.7071067811865476,0,0.7071067811865476]},{\"camera\":1,\"name\":\"node\"},"
                 "{\"camera\":0,\"name\":\"again\"}],"
                 "\"cameras\":[{\"name\":\"eye\",\"type\":\"perspective\",\"perspective\":{"
                 "\"yfov\":0.5,\"aspectRatio\":1.5,\"znear\":0.1}},{\"type\":\"orthographic\","
                 "\"orthographic\":{\"xmag\":2,\"ymag\":1,\"znear\":0,\"zfar\":9}}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.camera_count, 3);
    c = &r.scene.cameras[0];
    assert_string_equal(c->name, "eye");
    assert_true(c->yfov_rad == 0.5f && c->aspect == 1.5f);
    /* Turned a quarter about +Y it looks along -X; scale does not count, but a mirrored up
     * axis turns the picture round. */
    assert_matrix_in_file(&r.scene, &c->to_world, (const double[]){0, 0, 1, 1, 0, -1, 0, 2, 1, 0, 0, 3}, 1e-12);
    c = &r.scene.cameras[1];
    assert_int_equal(c->kind, CAMERA_ORTHOGRAPHIC);
    assert_string_equal(c->name, "node");
    assert_true(c->xmag == 2 && c->ymag == 1 && c->aspect == 2);
    assert_string_equal(r.scene.cameras[2].name, "again");
    assert_false(warned(&r, "no camera"));
    import_result_release(&r);

    m = triangle_maker();
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"camera\":0}],\"cameras\":[{\"type\":"
                 "\"perspective\",\"perspective\":{}}]",
                 "cameras[0]|yfov");
    m = triangle_maker(); /* the limits named are those that hold */
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"camera\":0}],\"cameras\":[{\"type\":"
                 "\"perspective\",\"perspective\":{\"yfov\":3.1416}}]",
                 "cameras[0]|yfov is 3.1416: must be 1e-05 to 3.1415 radians");
    m = triangle_maker();
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"camera\":0}],\"cameras\":[{\"type\":"
                 "\"fisheye\"}]",
                 "cameras[0]|fisheye");
}

/* The whole scene is in the framed picture, and fills a good part of it. */
static void test_framing(void **state)
{
    static const float scales[] = {1e-3f, 1, 1e4f};

    (void)state;
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        struct maker m = {0};
        struct import_result r;
        const struct scene_camera *c;
        char rest[512];
        double widest = 0, half;
        put_box(&m, 0);
        snprintf(rest, sizeof rest,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"scale\":[%g,%g,%g],"
                 "\"translation\":[%g,5,-7]}],\"meshes\":[{\"primitives\":[{\"attributes\":{"
                 "\"POSITION\":0},\"indices\":1}]}]",
                 (double)scales[i], (double)scales[i], (double)scales[i], 3 * (double)scales[i]);
        maker_import(&m, rest, &r);
        c = &r.scene.cameras[0];
        half = (double)det_tan(c->yfov_rad / 2);
        for (int corner = 0; corner < 8; corner++) {
            const struct transform_d *to_world = &r.scene.instances[0].to_world;
            double p[3] = {corner & 1, corner >> 1 & 1, corner >> 2}, at[3];
            transform_d_point(to_world, p, p);
            for (int axis = 0; axis < 3; axis++)
                at[axis] = (p[0] - c->to_world.m[0][3]) * c->to_world.m[0][axis] +
                           (p[1] - c->to_world.m[1][3]) * c->to_world.m[1][axis] +
                           (p[2] - c->to_world.m[2][3]) * c->to_world.m[2][axis];
            assert_true(at[2] < 0); /* before the camera, which looks along its -Z */
            widest = fmax(widest, fmax(fabs(at[0]), fabs(at[1])) / -at[2] / half);
        }
        assert_true(widest < 1);
        assert_true(widest > 0.7);
        /* From above. */
        assert_true(c->to_world.m[1][2] > 0.2);
        import_result_release(&r);
    }
}

static void test_lights(void **state)
{
    struct maker m = triangle_maker();
    const struct scene_light *l;
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2,3]}],\"nodes\":[{\"mesh\":0},"
                 "{\"translation\":[1,2,3],\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},"
                 "{\"rotation\":[-0.7071067811865476,0,0,0.7071067811865476],\"scale\":[9,9,9],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}},"
                 "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":2}}}],"
                 "\"extensionsUsed\":[\"KHR_lights_punctual\"],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":["
                 "{\"type\":\"point\",\"color\":[1,0.5,0.25],\"intensity\":4,\"range\":10},"
                 "{\"type\":\"spot\",\"spot\":{\"innerConeAngle\":0.25,\"outerConeAngle\":0.5}},"
                 "{\"type\":\"directional\",\"name\":\"sun\",\"intensity\":3}]}}," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.light_count, 3);
    l = &r.scene.lights[0];
    assert_int_equal(l->kind, LIGHT_POINT);
    assert_floats(l->intensity, (const float[]){4, 2, 1}, 3, 0);
    assert_in_file(&r.scene, l->position, (const double[]){1, 2, 3}, 0);
    assert_true(l->range == 10);
    l = &r.scene.lights[1];
    /* Turned to shine down; the scale neither dims nor widens. */
    assert_floats(l->direction, (const float[]){0, -1, 0}, 3, 1e-6f);
    assert_floats(l->intensity, (const float[]){1, 1, 1}, 3, 0);
    assert_true(l->inner_cone_rad == 0.25f && l->outer_cone_rad == 0.5f);
    assert_int_equal(l->falloff, FALLOFF_GLTF);
    l = &r.scene.lights[2];
    assert_string_equal(l->name, "sun");
    assert_floats(l->direction, (const float[]){0, 0, -1}, 3, 0);
    assert_false(r.scene.environment.present);
    assert_true(scene_effects_default(&r.scene, 0) & EFFECT_PUNCTUAL_LIGHT);
    import_result_release(&r);

    m = triangle_maker();
    maker_refuse(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"extensions\":{"
                 "\"KHR_lights_punctual\":{\"light\":0}}}],\"extensions\":{\"KHR_lights_punctual\":"
                 "{\"lights\":[{\"type\":\"point\",\"intensity\":1e38}]}}," ONE_TRIANGLE,
                 "lights[0]|intensity must be at most");
}

/* The extra "falloff" of a spot; what is no such word is ignored, as extras may contain anything. */
static void test_spot_falloff(void **state)
{
    static const struct {
        const char *extras;
        enum scene_falloff falloff;
    } rows[] = {{"{\"falloff\":\"smoothstep\"}", FALLOFF_SMOOTHSTEP},
                {"{\"falloff\":\"other\"}", FALLOFF_GLTF},
                {"{\"falloff\":7}", FALLOFF_GLTF},
                {"[1]", FALLOFF_GLTF}};

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct maker m = triangle_maker();
        struct import_result r;
        char text[2048];

        snprintf(text, sizeof text,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
                 "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}}],"
                 "\"extensionsUsed\":[\"KHR_lights_punctual\"],\"extensions\":{\"KHR_lights_punctual\":{\"lights\":["
                 "{\"type\":\"spot\",\"spot\":{},\"extras\":%s}]}}," ONE_TRIANGLE,
                 rows[i].extras);
        maker_import(&m, text, &r);
        assert_int_equal(r.scene.light_count, 1);
        assert_int_equal(r.scene.lights[0].falloff, rows[i].falloff);
        import_result_release(&r);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_hierarchy),
        cmocka_unit_test(test_assets),
        cmocka_unit_test(test_same_mesh_twice),
        cmocka_unit_test(test_node_faults),
        cmocka_unit_test(test_deep_hierarchy),
        cmocka_unit_test(test_flattened_and_hidden),
        cmocka_unit_test(test_instancing),
        cmocka_unit_test(test_scenes),
        cmocka_unit_test(test_cameras),
        cmocka_unit_test(test_framing),
        cmocka_unit_test(test_lights),
        cmocka_unit_test(test_spot_falloff),
    };

    return cmocka_run_group_tests_name("glTF nodes", tests, NULL, NULL);
}
