/* glTF: animations of nodes, and what follows them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"

/* Accessors 1 and up of the files below; 0 holds the triangle. */
enum { TIMES = 1, MOVES, TURNS, SAME, SPLINE };

static struct maker motion_maker(void)
{
    static const float times[3] = {0, 1, 4};
    static const float moves[9] = {0, 0, 0, 1, 2, 3, 4, 5, 6};
    static const int16_t turns[12] = {0, 0, 0, 32767, 0, 32767, 0, 0, 0, 0, 16384, 0};
    static const float same[9] = {7, 8, 9, 7, 8, 9, 7, 8, 9};
    static const float spline[27] = {0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 2, 2,
                                     2, 0, 0, 0, 0, 0, 0, 3, 3, 3, 0, 0, 0};
    struct maker m = triangle_maker();

    put_floats(&m, "SCALAR", times, 3, 3);
    put_floats(&m, "VEC3", moves, 9, 3);
    put_accessor(&m, put_view(&m, turns, sizeof turns, 0), "VEC4", 5122, 3, ",\"normalized\":true");
    put_floats(&m, "VEC3", same, 9, 3);
    put_floats(&m, "VEC3", spline, 27, 9);
    return m;
}

#define SAMPLER(output, how) "{\"input\":1,\"output\":" #output ",\"interpolation\":\"" how "\"}"
#define CHANNEL(sampler, node, path) \
    "{\"sampler\":" #sampler ",\"target\":{\"node\":" #node ",\"path\":\"" path "\"}}"
#define TWO_NODES "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"children\":[1],\"name\":\"up\"," \
                  "\"translation\":[1,0,0]},{\"mesh\":0,\"scale\":[2,2,2]}]"

static void test_channels(void **state)
{
    struct maker m = motion_maker();
    const struct scene_channel *c;
    struct import_result r;

    (void)state;
    maker_import(&m,
                 TWO_NODES ",\"animations\":[{\"name\":\"go\",\"samplers\":["
                 SAMPLER(3, "LINEAR") "," SAMPLER(2, "STEP") "," SAMPLER(5, "CUBICSPLINE")
                 "],\"channels\":[" CHANNEL(2, 1, "scale") "," CHANNEL(0, 0, "rotation") ","
                 CHANNEL(1, 0, "translation") "]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.node_count, 2);
    assert_int_equal(r.scene.nodes[0].parent, -1);
    assert_int_equal(r.scene.nodes[1].parent, 0);
    assert_doubles(r.scene.nodes[0].translation, (const double[]){1, 0, 0}, 3, 0);
    assert_doubles(r.scene.nodes[1].scale, (const double[]){2, 2, 2}, 3, 0);
    assert_doubles(r.scene.nodes[1].rotation, (const double[]){0, 0, 0, 1}, 4, 0);
    assert_int_equal(r.scene.instances[0].node, 1);
    assert_int_equal(r.scene.channel_count, 3); /* by node, then path */
    c = &r.scene.channels[0];
    assert_true(c->node == 0 && c->path == PATH_TRANSLATION && c->components == 3);
    assert_true(c->interpolation == INTERPOLATE_STEP && c->key_count == 3);
    assert_floats(c->times, (const float[]){0, 1, 4}, 3, 0);
    assert_floats(c->values, (const float[]){0, 0, 0, 1, 2, 3, 4, 5, 6}, 9, 0);
    c = &r.scene.channels[1];
    assert_true(c->node == 0 && c->path == PATH_ROTATION && c->components == 4);
    assert_int_equal(c->interpolation, INTERPOLATE_LINEAR);
    /* Shorts became numbers, and unit ones. */
    assert_floats(c->values, (const float[]){0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0}, 12, 0);
    c = &r.scene.channels[2];
    assert_true(c->node == 1 && c->path == PATH_SCALE && c->key_count == 3);
    assert_int_equal(c->interpolation, INTERPOLATE_CUBIC);
    assert_floats(c->values + 9 * 1 + 3, (const float[]){2, 2, 2}, 3, 0);
    assert_int_equal(r.animation_count, 1);
    assert_string_equal(r.animations[0].name, "go");
    assert_true(r.animations[0].taken && r.animations[0].duration_s == 4);
    import_result_release(&r);
}

/* Nodes exist only for what moves, and its parents. */
static void test_only_what_moves(void **state)
{
    struct maker m = motion_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,4]}],\"nodes\":[{\"children\":[1,3],\"matrix\":[1,0,0,"
                 "0,0,1,0,0,0,0,1,0,5,0,0,1]},{\"children\":[2]},{\"mesh\":0},{\"mesh\":0},"
                 "{\"children\":[5]},{}],\"animations\":[{\"samplers\":[" SAMPLER(2, "LINEAR")
                 "],\"channels\":[" CHANNEL(0, 1, "translation") "," CHANNEL(0, 4, "scale") ","
                 "{\"sampler\":0,\"target\":{\"path\":\"translation\"}}]}]," ONE_TRIANGLE,
                 &r);
    /* 0 (parent), 1 (moves), 2 (below it): not 3, which stands still, and not 4 and 5, on which
     * nothing hangs. */
    assert_int_equal(r.scene.node_count, 3);
    assert_int_equal(r.scene.nodes[0].has_matrix, 1);
    assert_true(r.scene.nodes[0].matrix.m[0][3] == 5);
    assert_int_equal(r.scene.channel_count, 1);
    assert_int_equal(r.scene.channels[0].node, 1);
    assert_int_equal(r.scene.instances[0].node, 2);
    assert_int_equal(r.scene.instances[1].node, -1);
    assert_true(r.scene.instances[1].to_world.m[0][3] + r.scene.origin[0] == 5);
    import_result_release(&r);
}

/* A channel whose keys are all the same is a place, not a motion. */
static void test_standing_still(void **state)
{
    struct maker m = motion_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 TWO_NODES ",\"animations\":[{\"samplers\":[" SAMPLER(4, "LINEAR") "],\"channels\":[" CHANNEL(
                     0, 0, "translation") "]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.node_count, 0);
    assert_int_equal(r.scene.channel_count, 0);
    assert_int_equal(r.scene.instances[0].node, -1);
    assert_true(r.scene.instances[0].to_world.m[0][3] + r.scene.origin[0] == 7 &&
                r.scene.instances[0].to_world.m[2][3] + r.scene.origin[2] == 9);
    import_result_release(&r);
}

/* Nor is one whose keys are the same a place, if a tangent at them is not 0: it swings between them. */
static void test_swinging_between_equal_keys(void **state)
{
    static const char rest[] = TWO_NODES ",\"animations\":[{\"samplers\":[" SAMPLER(
        6, "CUBICSPLINE") "],\"channels\":[" CHANNEL(0, 0, "translation") "]}]," ONE_TRIANGLE;

    (void)state;
    for (int at = -1; at < 27; at++) {
        float spline[27] = {0, 0, 0, 7, 8, 9, 0, 0, 0, 0, 0, 0, 7, 8, 9, 0, 0, 0, 0, 0, 0, 7, 8, 9, 0, 0, 0};
        struct maker m = motion_maker();
        struct import_result r;
        if (at / 3 % 3 == 1)
            continue; /* a key itself */
        if (at >= 0)
            spline[at] = 1;
        put_floats(&m, "VEC3", spline, 27, 9);
        maker_import(&m, rest, &r);
        if (at < 0) {
            assert_int_equal(r.scene.channel_count, 0);
            for (int c = 0; c < 3; c++)
                assert_true(r.scene.instances[0].to_world.m[c][3] + r.scene.origin[c] == 7 + c);
        }
        if (at >= 3 && at < 24) /* the outer tangents move nothing */
            assert_int_equal(r.scene.channel_count, 1);
        import_result_release(&r);
    }
}

static void test_choice(void **state)
{
    static const char rest[] = TWO_NODES
        ",\"animations\":[{\"name\":\"walk\",\"samplers\":[" SAMPLER(2, "LINEAR") "],\"channels\":[" CHANNEL(0, 0, "translation") "]},{\"name\":\"run\",\"samplers\":[" SAMPLER(
            5, "CUBICSPLINE") "],\"channels\":[" CHANNEL(0, 0, "translation") "," CHANNEL(0, 1,
                                                                                          "scale") "]}]," ONE_TRIANGLE;
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct maker m = motion_maker();
    struct buffer file = BUFFER_INIT;
    struct import_result r;
    struct error err = {0};

    (void)state;
    maker_write(&m, rest, &file);
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.channel_count, 2); /* all; of two for one thing the first */
    assert_int_equal(r.scene.channels[0].interpolation, INTERPOLATE_LINEAR);
    assert_warned(&r, "animations[1].channels[0]: ");
    assert_warned(&r, "first is taken (--animation \"run\" takes this animation alone)");
    import_result_release(&r);
    options.animation = "run";
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.channel_count, 2);
    assert_int_equal(r.scene.channels[0].interpolation, INTERPOLATE_CUBIC);
    assert_int_equal(r.warning_count, 2); /* camera, light */
    assert_true(!r.animations[0].taken && r.animations[1].taken);
    import_result_release(&r);
    options.animation = "0";
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.channel_count, 1);
    import_result_release(&r);
    options.animation = "none";
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.node_count, 0);
    assert_int_equal(r.animation_count, 2);
    import_result_release(&r);
    options.animation = "swim";
    assert_int_equal(import_scene_memory(file.data, file.size, "a.gltf", NULL, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "no animation \"swim\"|has 2");
    buffer_release(&file);
    maker_release(&m);
}

/* Godot's RESET, a pose, comes before what moves, and would hold it still. Alone, or asked for, it is taken. */
static void test_pose(void **state)
{
    static const float first[1] = {0}, moved[3] = {7, 8, 9}, times[3] = {0, 1, 4};
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct maker m = motion_maker();
    struct buffer rest = BUFFER_INIT, file = BUFFER_INIT;
    struct import_result r;
    int at, to, lasts;

    (void)state;
    at = put_accessor(&m, put_view(&m, first, sizeof first, 0), "SCALAR", 5126, 1, ",\"min\":[0],\"max\":[0]");
    to = put_floats(&m, "VEC3", moved, 3, 1);
    lasts = put_accessor(&m, put_view(&m, times, sizeof times, 0), "SCALAR", 5126, 3, ",\"min\":[0],\"max\":[4]");
    buffer_printf(&rest,
                  TWO_NODES ",\"animations\":[{\"name\":\"RESET\",\"samplers\":[{\"input\":%d,\"output\":%d}],\"channels\":[" CHANNEL(
                      0, 0, "translation") "]},{\"name\":\"walk\",\"samplers\":[{\"input\":%d,\"output\":2}],\"channels\":[" CHANNEL(
                      0, 0, "translation") "]}]," ONE_TRIANGLE,
                  at, to, lasts);
    maker_write(&m, buffer_text(&rest), &file);
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.channel_count, 1);
    assert_true(!r.animations[0].taken && r.animations[1].taken && r.animations[1].duration_s == 4);
    assert_warned(&r, "animations[0] \"RESET\" is a pose without duration");
    import_result_release(&r);
    options.animation = "RESET";
    import_ok_with(file.data, file.size, "a.gltf", &options, &r);
    assert_int_equal(r.scene.channel_count, 0);
    assert_true(r.animations[0].taken && r.scene.instances[0].to_world.m[0][3] + r.scene.origin[0] == 7);
    import_result_release(&r);
    buffer_release(&rest);
    buffer_release(&file);
    maker_release(&m);
}

/* Three gaits of one animal, as in Khronos's Fox: the second and third move only what the first
 * moves already, and last as long as ever. */
static void test_durations(void **state)
{
    static const double last[3] = {3.4166667461395264, 0.7083333134651184, 1.1583333015441895};
    struct maker m = motion_maker();
    struct buffer rest = BUFFER_INIT;
    struct import_result r;

    (void)state;
    buffer_puts(&rest, TWO_NODES ",\"animations\":[");
    for (int i = 0; i < 3; i++) {
        const float times[3] = {0, 0.5f * (float)last[i], (float)last[i]};
        char more[64];
        int input;
        snprintf(more, sizeof more, ",\"min\":[0],\"max\":[%.17g]", last[i]);
        input = put_accessor(&m, put_view(&m, times, sizeof times, 0), "SCALAR", 5126, 3, more);
        buffer_printf(&rest,
                      "%s{\"samplers\":[{\"input\":%d,\"output\":2}],\"channels\":[" CHANNEL(0, 0, "translation") "]}",
                      i ? "," : "", input);
    }
    buffer_puts(&rest, "]," ONE_TRIANGLE);
    maker_import(&m, buffer_text(&rest), &r);
    assert_int_equal(r.scene.channel_count, 1);
    for (int i = 0; i < 3; i++)
        assert_true(r.animations[i].duration_s == last[i]);
    import_result_release(&r);
    buffer_release(&rest);
}

static void test_pointers(void **state)
{
    struct maker m = motion_maker();
    struct import_result r;

    (void)state;
#define POINTER(text) "{\"sampler\":0,\"target\":{\"path\":\"pointer\",\"extensions\":{" \
                      "\"KHR_animation_pointer\":{\"pointer\":\"" text "\"}}}}"
    maker_import(&m,
                 TWO_NODES ",\"extensionsRequired\":[\"KHR_animation_pointer\"],"
                 "\"animations\":[{\"samplers\":[" SAMPLER(2, "LINEAR") "],\"channels\":["
                 POINTER("/nodes/1/translation") "," POINTER("/materials/0/alphaCutoff") ","
                 POINTER("/nodes/2/scale") "," POINTER("/nodes/0/translation/1") ","
                 POINTER("/nodes//scale") "]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.channel_count, 1);
    assert_int_equal(r.scene.channels[0].path, PATH_TRANSLATION);
    assert_int_equal(r.scene.instances[0].node, (int)r.scene.channels[0].node);
    assert_warned(&r, "animates \"/materials/#/alphaCutoff\" of row 0, which the file does not have");
    assert_warned(&r, "animates \"/nodes/2/scale\", which stands still");
    assert_warned(&r, "2 more");
    import_result_release(&r);
}

static void test_followers(void **state)
{
    static const float places[6] = {1, 2, 3, 4, 5, 6};
    struct maker m = motion_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", places, 6, 2);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"children\":[1,2,3]},{\"camera\":0},"
                 "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},{\"mesh\":0,"
                 "\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":6}}}}"
                 "],\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\"}]}},"
                 "\"animations\":[{\"samplers\":[" SAMPLER(2, "LINEAR") "],\"channels\":[" CHANNEL(
                     0, 0, "translation") "]}]," ONE_TRIANGLE,
                 &r);
    /* 0, the camera's, the light's, the mesh's and one for each instance */
    assert_int_equal(r.scene.node_count, 6);
    assert_int_equal(r.scene.nodes[r.scene.cameras[0].node].parent, 0);
    assert_int_equal(r.scene.nodes[r.scene.lights[0].node].parent, 0);
    assert_int_not_equal(r.scene.cameras[0].node, r.scene.lights[0].node);
    assert_int_equal(r.scene.instance_count, 2);
    for (int i = 0; i < 2; i++) {
        const struct scene_node *node = &r.scene.nodes[r.scene.instances[i].node];
        assert_true(node->has_matrix && node->matrix.m[0][3] == places[3 * i]);
        assert_int_equal(r.scene.nodes[node->parent].parent, 0);
    }
    import_result_release(&r);
}

/* Does the camera see the file's point, in a square picture? */
static int sees(const struct scene *scene, const double point[3])
{
    const struct scene_camera *c = &scene->cameras[0];
    double at[3], half = (double)det_tan(c->yfov_rad / 2);

    for (int axis = 0; axis < 3; axis++) {
        at[axis] = 0;
        for (int r = 0; r < 3; r++)
            at[axis] += (point[r] - scene->origin[r] - c->to_world.m[r][3]) * c->to_world.m[r][axis];
    }
    return at[2] < 0 && fmax(fabs(at[0]), fabs(at[1])) < -at[2] * half;
}

/* What follows a node stands where it is at time 0; a camera that we choose sees the whole
 * way. */
static void test_at_time_0(void **state)
{
    static const float far_away[6] = {20, 30, 40, -20, -30, -40};
    static const double places[2][3] = {{20, 30, 40}, {-20, -30, -40}};
    struct maker m = motion_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "SCALAR", (const float[]){2, 3}, 2, 2);
    put_floats(&m, "VEC3", far_away, 6, 2);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"translation\":[1,1,1],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}}],"
                 "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\"}]}},"
                 "\"animations\":[{\"samplers\":[{\"input\":6,\"output\":7}],\"channels\":[" CHANNEL(
                     0, 0, "translation") "]}]," ONE_TRIANGLE,
                 &r);
    /* Before the first key its value stands. */
    assert_in_file(&r.scene, r.scene.lights[0].position, places[0], 0);
    assert_true(r.scene.instances[0].to_world.m[2][3] + r.scene.origin[2] == 40);
    assert_int_equal(r.scene.cameras[0].node, -1);
    assert_true(sees(&r.scene, places[0]) && sees(&r.scene, places[1]));
    import_result_release(&r);
    /* The same with a camera of the file's on the node. */
    m = motion_maker();
    put_floats(&m, "SCALAR", (const float[]){2, 3}, 2, 2);
    put_floats(&m, "VEC3", far_away, 6, 2);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"camera\":0,\"scale\":"
                 "[2,2,2]}],\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}"
                 "],\"animations\":[{\"samplers\":[{\"input\":6,\"output\":7}],\"channels\":[" CHANNEL(
                     0, 0, "translation") "]}]," ONE_TRIANGLE,
                 &r);
    assert_matrix_in_file(&r.scene, &r.scene.cameras[0].to_world,
                          (const double[]){1, 0, 0, 20, 0, 1, 0, 30, 0, 0, 1, 40}, 1e-6);
    import_result_release(&r);
}

static void test_mending(void **state)
{
    static const float times[4] = {0, 1, 1, 2};
    static const float moves[12] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
    static const float turns[16] = {0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 3, 0, 1, 0, 0, 0};
    float spline[36]; /* each number another: its key, then tangent, value, tangent, then axis */
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    for (int i = 0; i < 36; i++)
        spline[i] = (float)(1 + i);
    put_floats(&m, "SCALAR", times, 4, 4);
    put_floats(&m, "VEC3", moves, 12, 4);
    put_floats(&m, "VEC4", turns, 16, 4);
    put_floats(&m, "VEC3", spline, 36, 12);
    maker_import(&m,
                 TWO_NODES ",\"animations\":[{\"samplers\":[" SAMPLER(2, "LINEAR") ","
                 SAMPLER(3, "LINEAR") "," SAMPLER(4, "CUBICSPLINE") "],\"channels\":[" CHANNEL(0, 1, "translation") ","
                 CHANNEL(1, 1, "rotation") "," CHANNEL(2, 1, "scale") "," CHANNEL(1, 1, "mood") "]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.channel_count, 3);
    assert_int_equal(r.scene.channels[0].key_count, 3);
    assert_floats(r.scene.channels[0].times, (const float[]){0, 1, 2}, 3, 0);
    assert_floats(r.scene.channels[0].values, (const float[]){0, 0, 0, 2, 2, 2, 3, 3, 3}, 9, 0);
    assert_floats(r.scene.channels[1].values, (const float[]){0, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 0}, 12, 0);
    assert_int_equal(r.scene.channels[2].key_count, 3);
    for (int i = 0; i < 27; i++)
        assert_true(r.scene.channels[2].values[i] == spline[i < 9 ? i : i + 9]);
    assert_warned(&r, "several keys at one time");
    assert_warned(&r, "is no rotation");
    assert_warned(&r, "animates the mood");
    import_result_release(&r);
    /* A node with a matrix cannot be animated. */
    m = motion_maker();
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,"
                 "0,0,1,0,0,0,0,1]}],\"animations\":[{\"samplers\":[" SAMPLER(2, "LINEAR") "],\"channels\":[" CHANNEL(
                     0, 0, "translation") "," CHANNEL(0, 0, "weights") "]}]," ONE_TRIANGLE,
                 &r);
    assert_int_equal(r.scene.node_count, 0);
    assert_warned(&r, "which has a matrix");
    assert_warned(&r, "has no morph targets");
    import_result_release(&r);
}

static void test_faults(void **state)
{
    static const struct {
        const char *animation, *words;
    } cases[] = {
        {"[7]", "animations[0]|object"},
        {"[{\"channels\":[7]}]", "animations[0].channels[0]|object"},
        {"[{\"channels\":[{\"target\":{\"node\":0,\"path\":\"scale\"}}]}]", "names no sampler"},
        {"[{\"channels\":[" CHANNEL(0, 0, "scale") "]}]", "sampler is 0"},
        {"[{\"samplers\":[{}],\"channels\":[" CHANNEL(0, 9, "scale") "]}]", "target|node is 9"},
        {"[{\"samplers\":[{}],\"channels\":[" CHANNEL(0, 0, "scale") "]}]", "animations[0].samplers[0]: has no input"},
        {"[{\"samplers\":[{\"input\":1}],\"channels\":[" CHANNEL(0, 0, "scale") "]}]", "has no output"},
        {"[{\"samplers\":[" SAMPLER(2, "BEZIER") "],\"channels\":[" CHANNEL(0, 0, "scale") "]}]", "BEZIER|CUBICSPLINE"},
        {"[{\"samplers\":[{\"input\":2,\"output\":2}],\"channels\":[" CHANNEL(0, 0, "scale") "]}]",
         "input must be SCALAR"},
        {"[{\"samplers\":[" SAMPLER(2, "CUBICSPLINE") "],\"channels\":[" CHANNEL(0, 0, "scale") "]}]",
         "9 elements of 3 components for 3 keys of a scale"},
        {"[{\"samplers\":[" SAMPLER(2, "LINEAR") "],\"channels\":[" CHANNEL(0, 0, "rotation") "]}]",
         "3 elements of 4 components"},
        {"[{\"samplers\":[{\"input\":6,\"output\":2}],\"channels\":[" CHANNEL(0, 0, "scale") "]}]",
         "times of its keys must rise|key 2 is at 0.5"},
        {"[{\"samplers\":[{\"input\":7,\"output\":2}],\"channels\":[" CHANNEL(0, 0, "scale") "]}]",
         "accessors[7]|finite"},
    };
    static const float falling[3] = {0, 1, 0.5f};
    const float wild[3] = {0, 1, NAN};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = motion_maker();
        char rest[1024];
        put_floats(&m, "SCALAR", falling, 3, 3);
        put_floats(&m, "SCALAR", wild, 3, 3);
        snprintf(rest, sizeof rest, TWO_NODES ",\"animations\":%s," ONE_TRIANGLE, cases[i].animation);
        maker_refuse(&m, rest, cases[i].words);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_channels),
        cmocka_unit_test(test_only_what_moves),
        cmocka_unit_test(test_standing_still),
        cmocka_unit_test(test_swinging_between_equal_keys),
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_pose),
        cmocka_unit_test(test_durations),
        cmocka_unit_test(test_pointers),
        cmocka_unit_test(test_followers),
        cmocka_unit_test(test_at_time_0),
        cmocka_unit_test(test_mending),
        cmocka_unit_test(test_faults),
    };

    return cmocka_run_group_tests_name("glTF animation", tests, NULL, NULL);
}
