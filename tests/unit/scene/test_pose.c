/* Poses against closed forms: rotations, splines, hierarchies, skins, morphs. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/effects.h"
#include "common/scene/pose.h"
#include "tests/support/scene_sample.h"

enum { NODES = 4, CHANNELS = 6 };

/* A scene of a few nodes and channels; everything else is put in by the tests. */
struct stage {
    struct scene scene;
    struct scene_node nodes[NODES];
    struct scene_channel channels[CHANNELS];
    struct scene_mesh mesh;
    struct scene_material material;
    struct scene_instance instance;
    struct scene_camera camera;
    struct scene_light light;
    struct scene_skin skin;
    struct render_settings settings;
};

static void stage_set(struct stage *s)
{
    memset(s, 0, sizeof *s);
    scene_init(&s->scene);
    for (int i = 0; i < NODES; i++)
        scene_node_default(&s->nodes[i]);
    scene_material_default(&s->material);
    scene_instance_default(&s->instance);
    scene_camera_default(&s->camera);
    scene_light_default(&s->light);
    render_settings_default(&s->settings);
    s->mesh = (struct scene_mesh){.name = "", .vertex_count = 3, .triangle_count = 1};
    s->scene.nodes = s->nodes;
    s->scene.channels = s->channels;
    s->scene.meshes = &s->mesh;
    s->scene.materials = &s->material;
    s->scene.instances = &s->instance;
    s->scene.cameras = &s->camera;
    s->scene.lights = &s->light;
    s->scene.skins = &s->skin;
    s->scene.node_count = NODES;
    s->scene.mesh_count = s->scene.material_count = s->scene.instance_count = 1;
    s->scene.camera_count = s->scene.light_count = 1;
}

static void add_channel(struct stage *s, uint32_t node, enum scene_channel_path path, enum scene_interpolation how,
                        uint32_t keys, uint32_t components, float *times, float *values)
{
    assert_true(s->scene.channel_count < CHANNELS);
    s->channels[s->scene.channel_count++] = (struct scene_channel){node, path, how, keys, components, times, values};
}

static struct scene_pose pose_at(struct stage *s, double time_s)
{
    struct scene_pose pose = {0};
    struct error err = {0};

    scene_sample_blob(&s->mesh, 1);
    if (scene_validate(&s->scene, &err) != STATUS_OK || scene_pose_init(&pose, &s->scene, time_s, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return pose;
}

static void assert_near(double got, double expected, double bound)
{
    if (!(fabs(got - expected) <= bound))
        fail_msg("%.17g instead of %.17g", got, expected);
}

/* Where the node's transform takes a point. */
static void assert_maps(const struct transform_d *t, double x, double y, double z, double to_x, double to_y,
                        double to_z)
{
    const double expected[3] = {to_x, to_y, to_z};

    for (int r = 0; r < 3; r++)
        assert_near(t->m[r][0] * x + t->m[r][1] * y + t->m[r][2] * z + t->m[r][3], expected[r],
                    2e-7 * (1 + fabs(expected[r])));
}

static void translation_at(struct stage *s, double time_s, double x)
{
    struct scene_pose pose = pose_at(s, time_s);

    assert_near(pose.to_world[0].m[0][3], x, 1e-12);
    scene_pose_release(&pose);
}

static void test_steps_and_lines(void **state)
{
    float times[] = {1, 2, 4};
    float values[] = {10, 0, 0, 20, 0, 0, -20, 0, 0};
    struct stage s;

    (void)state;
    stage_set(&s);
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_LINEAR, 3, 3, times, values);
    translation_at(&s, -5, 10); /* the ends stand */
    translation_at(&s, 1, 10);
    translation_at(&s, 1.25, 12.5);
    translation_at(&s, 2, 20);
    translation_at(&s, 3, 0);
    translation_at(&s, 4, -20);
    translation_at(&s, 1e9, -20);
    s.channels[0].interpolation = INTERPOLATE_STEP;
    translation_at(&s, 0, 10);
    translation_at(&s, 1.999, 10);
    translation_at(&s, 2, 20);
    translation_at(&s, 3.999, 20);
    translation_at(&s, 4, -20);
    s.channels[0].key_count = 1;
    translation_at(&s, 0, 10);
    translation_at(&s, 7, 10);
    assert_near(scene_duration_s(&s.scene), 1, 0);
    s.channels[0].key_count = 3;
    assert_near(scene_duration_s(&s.scene), 4, 0);
    s.scene.channel_count = 0;
    assert_near(scene_duration_s(&s.scene), 0, 0);
}

/* A step at a frame's time is seen in that frame, also where the time is no float: some of those of 24 a second are
 * rounded up. */
static void test_steps_on_time(void **state)
{
    enum { FRAMES = 96 };
    float times[FRAMES], values[3 * FRAMES] = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    for (int i = 0; i < FRAMES; i++) {
        times[i] = (float)(i / 24.0);
        values[3 * i] = (float)i;
    }
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_STEP, FRAMES, 3, times, values);
    for (int i = 0; i < FRAMES; i++)
        translation_at(&s, i / 24.0, i);
}

/* Many keys: each is found, and what lies between any two. */
static void test_many_keys(void **state)
{
    static float times[1000], values[3000];
    struct stage s;

    (void)state;
    stage_set(&s);
    for (int i = 0; i < 1000; i++) {
        times[i] = 0.5f * (float)i;
        values[3 * i] = (float)(i * i);
    }
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_LINEAR, 1000, 3, times, values);
    for (int i = 0; i < 999; i++) {
        struct scene_pose pose;
        assert_int_equal(scene_pose_init(&pose, &s.scene, 0.5 * i + 0.125, NULL), STATUS_OK);
        assert_near(pose.to_world[0].m[0][3], 0.75 * i * i + 0.25 * (i + 1) * (i + 1), 1e-9);
        scene_pose_release(&pose);
    }
}

static void test_quarter_turn(void **state)
{
    const float h = 0.70710678f;
    float times[] = {0, 2};
    float values[] = {0, 0, 0, 1, 0, h, 0, h}; /* a quarter turn about +Y: +Z goes to +X */
    float third = 0.5f;
    struct scene_pose pose;
    struct stage s;

    (void)state;
    stage_set(&s);
    add_channel(&s, 0, PATH_ROTATION, INTERPOLATE_LINEAR, 2, 4, times, values);
    for (int part = 0; part <= 6; part++) {
        /* A steady turn, which a straight line between the quaternions would not give. */
        double angle = PI_D / 2 * part / 6;
        pose = pose_at(&s, 2.0 * part / 6);
        assert_maps(&pose.to_world[0], 0, 0, 1, sin(angle), 0, cos(angle));
        assert_maps(&pose.to_world[0], 0, 1, 0, 0, 1, 0);
        scene_pose_release(&pose);
    }
    /* The same end as -q: the short way all the same. */
    for (int i = 4; i < 8; i++)
        values[i] = -values[i];
    pose = pose_at(&s, 1);
    assert_maps(&pose.to_world[0], 0, 0, 1, sin(PI_D / 4), 0, cos(PI_D / 4));
    scene_pose_release(&pose);
    /* Keys that are not unit mean their unit quaternions. */
    for (int i = 4; i < 8; i++)
        values[i] *= -3 * third;
    pose = pose_at(&s, 1);
    assert_maps(&pose.to_world[0], 0, 0, 1, sin(PI_D / 4), 0, cos(PI_D / 4));
    scene_pose_release(&pose);
    s.channels[0].interpolation = INTERPOLATE_STEP;
    pose = pose_at(&s, 1);
    assert_maps(&pose.to_world[0], 0, 0, 1, 0, 0, 1);
    scene_pose_release(&pose);
}

/* Nearly equal, equal and opposite keys: a unit rotation always. */
static void test_slerp_ends(void **state)
{
    static const float angles[] = {0, 1e-12f, 1e-7f, 1e-4f, 0.01f, 1, 3.1415925f, 3.1415927f, 6.28f};
    float times[] = {0, 1};
    struct stage s;

    (void)state;
    for (size_t i = 0; i < sizeof angles / sizeof *angles; i++) {
        /* Turns by more than half are made the other way round. */
        double full = (double)angles[i] > PI_D ? (double)angles[i] - 2 * PI_D : (double)angles[i];
        float values[] = {0, 0, 0, 1, (float)sin((double)angles[i] / 2), 0, 0,
                          (float)cos((double)angles[i] / 2)};
        stage_set(&s);
        add_channel(&s, 0, PATH_ROTATION, INTERPOLATE_LINEAR, 2, 4, times, values);
        for (int part = 1; part < 4; part++) {
            struct scene_pose pose = pose_at(&s, 0.25 * part);
            double angle = 0.25 * part * full;
            if (fabs(fabs(full) - PI_D) > 1e-5) /* there both ways are as short */
                assert_maps(&pose.to_world[0], 0, 1, 0, 0, cos(angle), sin(angle));
            assert_near(transform_d_determinant(&pose.to_world[0]), 1, 1e-12);
            scene_pose_release(&pose);
        }
    }
}

static void test_splines(void **state)
{
    float times[] = {1, 3};
    /* In-tangent, value, out-tangent of each key. */
    float values[] = {99, 0, 0, 2, 0, 0, 3, 0, 0, -1, 0, 0, 6, 0, 0, 99, 0, 0};
    struct scene_pose pose;
    struct stage s;

    (void)state;
    stage_set(&s);
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_CUBIC, 2, 3, times, values);
    /* By hand at u = 1/4, span 2 s: 27/32 2 + 2 9/64 3 + 5/32 6 + 2 (-3/64) (-1). */
    translation_at(&s, 1.5, 27.0 / 32 * 2 + 2 * 9.0 / 64 * 3 + 5.0 / 32 * 6 + 2 * 3.0 / 64);
    translation_at(&s, 1, 2);
    translation_at(&s, 3, 6);
    translation_at(&s, 0, 2);
    translation_at(&s, 4, 6);
    /* A rotation's spline is made unit: halfway between two keys without tangents it is their
     * mean direction, a turn by half. */
    {
        float turn[] = {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0,
                        0, 0, 0, 0, 0, 0, 0.70710678f, 0.70710678f, 0, 0, 0, 0};
        s.scene.channel_count = 0;
        add_channel(&s, 0, PATH_ROTATION, INTERPOLATE_CUBIC, 2, 4, times, turn);
        pose = pose_at(&s, 2);
        assert_maps(&pose.to_world[0], 1, 0, 0, sqrt(0.5), sqrt(0.5), 0);
        scene_pose_release(&pose);
        turn[18] = 0, turn[19] = -1; /* the spline goes through 0 */
        pose = pose_at(&s, 2);
        assert_maps(&pose.to_world[0], 1, 0, 0, 1, 0, 0);
        scene_pose_release(&pose);
    }
}

static void test_hierarchy(void **state)
{
    const float h = 0.70710678f;
    float times[] = {0, 1}, turn[] = {0, 0, 0, 1, 0, 0, h, h}, grow[] = {1, 1, 1, 3, 3, 3};
    struct scene_pose pose;
    struct transform_d to_world;
    struct stage s;

    (void)state;
    stage_set(&s);
    s.nodes[0].translation[0] = 10;
    s.nodes[1].parent = 0;
    s.nodes[1].has_matrix = 1;
    s.nodes[1].matrix.m[0][3] = 1;
    s.nodes[2].parent = 1;
    s.instance.node = 2;
    add_channel(&s, 0, PATH_ROTATION, INTERPOLATE_LINEAR, 2, 4, times, turn);
    add_channel(&s, 2, PATH_SCALE, INTERPOLATE_LINEAR, 2, 3, times, grow);
    pose = pose_at(&s, 1);
    /* Grown threefold, pushed along X, turned X to Y about the root, pushed along X. */
    to_world = pose_instance(&pose, &s.scene, 0);
    assert_maps(&to_world, 1, 0, 0, 10, 4, 0);
    assert_maps(&to_world, 0, 1, 0, 7, 1, 0);
    assert_maps(&pose.to_world[1], 0, 0, 0, 10, 1, 0);
    assert_maps(&pose.to_world[3], 1, 2, 3, 1, 2, 3);
    scene_pose_release(&pose);
    assert_null(pose.to_world);
    /* What follows nothing stands where it stands. */
    s.instance.node = -1;
    s.instance.to_world.m[1][3] = 5;
    pose = pose_at(&s, 1);
    to_world = pose_instance(&pose, &s.scene, 0);
    assert_maps(&to_world, 1, 0, 0, 1, 5, 0);
    scene_pose_release(&pose);
    /* Nodes that multiply beyond all measure. */
    for (int i = 0; i < NODES; i++) {
        s.nodes[i].parent = i - 1;
        s.nodes[i].scale[0] = 1e10f;
    }
    s.nodes[1].has_matrix = 0;
    {
        struct error err = {0};
        assert_int_equal(scene_pose_init(&pose, &s.scene, 0, &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "nodes[1]"));
        assert_null(pose.storage);
    }
    mem_fault_arm(0, 1);
    assert_int_equal(scene_pose_init(&pose, &s.scene, 0, NULL), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
}

static void test_camera_and_light(void **state)
{
    struct scene_camera camera;
    struct scene_light light;
    struct scene_pose pose;
    struct stage s;
    double rows[3][3];

    (void)state;
    stage_set(&s);
    s.camera.node = s.light.node = 0;
    s.nodes[0].rotation[1] = 1, s.nodes[0].rotation[3] = 0; /* half a turn about Y */
    s.nodes[0].translation[2] = 7;
    s.nodes[0].scale[0] = 2, s.nodes[0].scale[1] = 3, s.nodes[0].scale[2] = 5;
    pose = pose_at(&s, 0);
    pose_camera(&pose, &s.scene, 0, &camera);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            rows[r][c] = (double)camera.to_world.m[r][c];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            assert_near(rows[r][c], r != c ? 0 : r == 1 ? 1 : -1, 1e-7);
    assert_near((double)camera.to_world.m[2][3], 7, 1e-6);
    pose_light(&pose, &s.scene, 0, &light);
    assert_near((double)light.position[2], 7, 1e-6);
    assert_near((double)light.direction[2], 1, 1e-7);
    scene_pose_release(&pose);
    /* Sheared and mirrored: a proper rotation with the viewing direction kept. */
    s.nodes[0].has_matrix = 1;
    s.nodes[0].matrix = (struct transform_d){{{-1, 1, 0, 0}, {0, 2, 3, 0}, {0, 0, 3, 0}}};
    pose = pose_at(&s, 0);
    pose_camera(&pose, &s.scene, 0, &camera);
    assert_near((double)camera.to_world.m[1][2], sqrt(0.5), 1e-6);
    assert_near((double)camera.to_world.m[2][2], sqrt(0.5), 1e-6);
    {
        struct scene_camera alone = camera;
        alone.node = -1;
        s.camera = alone;
        assert_int_equal(scene_validate(&s.scene, NULL), STATUS_OK); /* it is rigid */
    }
    scene_pose_release(&pose);
    /* Hidden by a scale of 0: what is there stays, but its place. */
    stage_set(&s);
    s.camera.node = s.light.node = 0;
    memset(s.nodes[0].scale, 0, sizeof s.nodes[0].scale);
    s.nodes[0].translation[0] = 4;
    pose = pose_at(&s, 0);
    pose_camera(&pose, &s.scene, 0, &camera);
    pose_light(&pose, &s.scene, 0, &light);
    assert_near((double)camera.to_world.m[0][0], 1, 0);
    assert_near((double)camera.to_world.m[0][3], 4, 0);
    assert_near((double)light.direction[2], -1, 0);
    assert_near((double)light.position[0], 4, 0);
    scene_pose_release(&pose);
}

/* A blob for the stage's mesh from arrays that lie one after the other. */
static uint8_t *blob_of(struct stage *s)
{
    struct scene_mesh_layout layout;
    uint8_t *blob;

    scene_mesh_layout(&s->mesh, &layout);
    blob = calloc(layout.total_bytes, 1);
    assert_non_null(blob);
    return blob;
}

static void put(uint8_t *blob, size_t array, size_t row, size_t floats, const float *values)
{
    memcpy(blob + array + row * floats * sizeof(float), values, floats * sizeof(float));
}

/* A bar along X of 5 cross sections with two bones: the second one, at x = 2, turns by a
 * quarter about Z, and the section in the middle belongs half to each. */
static void test_skin(void **state)
{
    enum { SECTIONS = 5 };
    const float h = 0.70710678f;
    float times[] = {0, 1}, turn[] = {0, 0, 0, 1, 0, 0, h, h};
    uint32_t joints[] = {0, 1};
    struct transform_stored bind[2] = {{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                {{{1, 0, 0, -2}, {0, 1, 0, 0}, {0, 0, 1, 0}}}};
    float positions[SECTIONS * 3], normals[SECTIONS * 3], tangents[SECTIONS * 4];
    const float up[3] = {0, 1, 0}, along[4] = {1, 0, 0, -1};
    struct scene_mesh_layout layout;
    struct scene_pose pose;
    struct error err = {0};
    struct stage s;
    uint8_t *blob;

    (void)state;
    stage_set(&s);
    s.mesh.vertex_count = SECTIONS;
    s.mesh.arrays = MESH_NORMALS | MESH_TANGENTS | MESH_SKIN;
    s.nodes[1].parent = 0;
    s.nodes[1].translation[0] = 2;
    s.skin = (struct scene_skin){2, joints, bind};
    s.scene.skin_count = 1;
    s.instance.skin = 0;
    s.instance.to_world.m[0][3] = 100; /* not used */
    add_channel(&s, 1, PATH_ROTATION, INTERPOLATE_LINEAR, 2, 4, times, turn);
    scene_mesh_layout(&s.mesh, &layout);
    blob = blob_of(&s);
    for (int i = 0; i < SECTIONS; i++) {
        struct mesh_influence influence = {{i < 2 ? 1 : i > 2 ? 0 : 0.5f, 0, 0, 0}, {0, 1, 0, 0}};
        const float at[3] = {(float)i, 0, 0};
        influence.weight[1] = 1 - influence.weight[0];
        put(blob, layout.positions, (size_t)i, 3, at);
        put(blob, layout.normals, (size_t)i, 3, up);
        put(blob, layout.tangents, (size_t)i, 4, along);
        memcpy(blob + layout.skin + (size_t)i * sizeof influence, &influence, sizeof influence);
    }
    assert_true(scene_instance_deforms(&s.scene, 0));
    pose = pose_at(&s, 1);
    {
        struct transform_d to_world = pose_instance(&pose, &s.scene, 0);
        assert_maps(&to_world, 1, 2, 3, 1, 2, 3);
    }
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, normals, tangents, &err), STATUS_OK);
    for (int i = 0; i < SECTIONS; i++) {
        /* Up to the joint it lies along X, behind it along Y. */
        assert_near((double)positions[3 * i], i < 2 ? i : 2, 1e-6);
        assert_near((double)positions[3 * i + 1], i < 2 ? 0 : i - 2, 1e-6);
        assert_near((double)normals[3 * i], i < 2 ? 0 : i > 2 ? -1 : -sqrt(0.5), 1e-6);
        assert_near((double)normals[3 * i + 1], i < 2 ? 1 : i > 2 ? 0 : sqrt(0.5), 1e-6);
        assert_near((double)tangents[4 * i], i < 2 ? 1 : i > 2 ? 0 : sqrt(0.5), 1e-6);
        assert_near((double)tangents[4 * i + 1], i < 2 ? 0 : i > 2 ? 1 : sqrt(0.5), 1e-6);
        assert_near((double)tangents[4 * i + 3], -1, 0);
    }
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, NULL, NULL, NULL, &err), STATUS_OK);
    scene_pose_release(&pose);

    /* A joint that mirrors and stretches: normals by the inverse transpose. */
    s.scene.channel_count = 0;
    s.nodes[0].has_matrix = 1;
    s.nodes[0].matrix = (struct transform_d){{{-1, 0, 0, 0}, {1, 1, 0, 0}, {0, 0, 1, 0}}};
    pose = pose_at(&s, 0);
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, normals, tangents, &err), STATUS_OK);
    assert_near((double)positions[3], -1, 1e-6);
    assert_near((double)positions[4], 1, 1e-6);
    assert_near((double)normals[3], sqrt(0.5), 1e-6); /* square to the tangent (-1, 1, 0) */
    assert_near((double)normals[4], sqrt(0.5), 1e-6);
    assert_near((double)tangents[7], 1, 0);
    /* Influences of a damaged blob. */
    {
        struct mesh_influence influence = {{1, 0, 0, 0}, {2, 9, 9, 9}};
        memcpy(blob + layout.skin + sizeof influence, &influence, sizeof influence);
        assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, NULL, NULL, &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "vertex 1 follows a joint"));
        influence.joint[0] = 0;
        influence.weight[0] = NAN;
        memcpy(blob + layout.skin + sizeof influence, &influence, sizeof influence);
        assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, NULL, NULL, &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "vertex 1 is moved beyond"));
    }
    mem_fault_arm(0, 1);
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, NULL, NULL, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    scene_pose_release(&pose);
    /* A mesh with joints that no skin moves stands in its bind pose. */
    s.instance.skin = -1;
    assert_false(scene_instance_deforms(&s.scene, 0));
    pose = pose_at(&s, 0);
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, normals, NULL, &err), STATUS_OK);
    assert_near((double)positions[9], 3, 0);
    assert_near((double)normals[10], 1, 0);
    scene_pose_release(&pose);
    free(blob);
}

static void test_morphs(void **state)
{
    float times[] = {0, 2}, weights[] = {0, 0, 1, 0.5f}, rest[] = {0, 0};
    const float corner[3] = {1, 1, 1}, up[3] = {0, 1, 0};
    const float first[3] = {2, 0, 0}, second[3] = {0, 4, 0}, turned[3] = {1, 0, 0};
    const float cancel[3] = {0, -2, 0};
    float positions[9], normals[9];
    struct scene_mesh_layout layout;
    struct scene_pose pose;
    struct error err = {0};
    struct stage s;
    uint8_t *blob;

    (void)state;
    stage_set(&s);
    s.mesh.arrays = MESH_NORMALS;
    s.mesh.morph_count = 2;
    s.nodes[3].weights = rest;
    s.nodes[3].weight_count = 2;
    s.instance.node = 3;
    scene_mesh_layout(&s.mesh, &layout);
    blob = blob_of(&s);
    for (size_t v = 0; v < 3; v++) {
        put(blob, layout.positions, v, 3, corner);
        put(blob, layout.normals, v, 3, up);
    }
    put(blob, layout.morphs, 1, 3, first);                        /* target 0, vertex 1 */
    put(blob, layout.morphs + 36, 1, 3, turned);                  /* its normal */
    put(blob, layout.morphs + layout.morph_stride, 2, 3, second); /* target 1, vertex 2 */
    put(blob, layout.morphs + layout.morph_stride + 36, 2, 3, cancel);
    assert_false(scene_instance_deforms(&s.scene, 0)); /* no weight, and none will come */
    rest[1] = 1;
    assert_true(scene_instance_deforms(&s.scene, 0));
    rest[1] = 0;
    add_channel(&s, 3, PATH_WEIGHTS, INTERPOLATE_LINEAR, 2, 2, times, weights);
    assert_true(scene_instance_deforms(&s.scene, 0));
    pose = pose_at(&s, 1);
    assert_near(pose.weights[3][0], 0.5, 1e-12);
    assert_near(pose.weights[3][1], 0.25, 1e-12);
    assert_null(pose.weights[0]);
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, normals, NULL, &err), STATUS_OK);
    assert_near((double)positions[0], 1, 0);
    assert_near((double)positions[3], 2, 1e-6);
    assert_near((double)positions[4], 1, 0);
    assert_near((double)positions[7], 2, 1e-6);
    assert_near((double)normals[1], 1, 1e-7);
    assert_near((double)normals[3], 0.5 / sqrt(1.25), 1e-6);
    assert_near((double)normals[4], 1 / sqrt(1.25), 1e-6);
    assert_near((double)normals[7], 1, 1e-6);
    scene_pose_release(&pose);
    /* A normal that vanishes stays what it was. */
    pose = pose_at(&s, 2);
    assert_int_equal(pose_deform(&pose, &s.scene, 0, blob, positions, normals, NULL, &err), STATUS_OK);
    assert_near((double)normals[7], 1, 0);
    assert_near((double)positions[7], 3, 1e-6);
    scene_pose_release(&pose);
    free(blob);
}

static void test_what_is_animated(void **state)
{
    float times[] = {0, 1}, move[] = {0, 0, 0, 1, 0, 0};
    struct stage s;

    (void)state;
    stage_set(&s);
    s.nodes[1].parent = 0;
    s.instance.node = 1;
    assert_false(scene_is_animated(&s.scene, &s.settings));
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_LINEAR, 2, 3, times, move);
    assert_true(scene_is_animated(&s.scene, &s.settings)); /* by its parent */
    s.instance.node = 2;
    assert_false(scene_is_animated(&s.scene, &s.settings)); /* nothing follows what moves */
    s.camera.node = 0;
    assert_true(scene_is_animated(&s.scene, &s.settings));
    {
        struct scene_camera two[2] = {s.camera, s.camera};
        two[1].node = -1;
        s.scene.cameras = two;
        s.scene.camera_count = 2;
        s.settings.camera = 1; /* another camera's move is nothing to this one */
        assert_false(scene_is_animated(&s.scene, &s.settings));
        s.settings.camera = 0;
        s.scene.cameras = &s.camera;
        s.scene.camera_count = 1;
    }
    s.camera.node = -1;
    s.light.node = 1;
    assert_true(scene_is_animated(&s.scene, &s.settings));
    s.light.node = -1;
    s.instance.node = 1;
    move[3] = 0; /* a channel that says the same all the time */
    assert_false(scene_is_animated(&s.scene, &s.settings));
    {
        uint32_t joint = 1;
        struct transform_stored bind = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
        move[3] = 1;
        s.skin = (struct scene_skin){1, &joint, &bind};
        s.scene.skin_count = 1;
        s.mesh.arrays = MESH_SKIN;
        s.instance.node = -1;
        s.instance.skin = 0;
        assert_true(scene_is_animated(&s.scene, &s.settings));
        joint = 3;
        assert_false(scene_is_animated(&s.scene, &s.settings));
    }
}

/* Keys that are all the same: each number of each tangent between them moves the thing, and where it is said not to move
 * it is at one place at all times. */
static void test_tangents_alone(void **state)
{
    enum { KEYS = 3, COMPONENTS = 3 };
    float times[] = {0, 1, 2};

    (void)state;
    for (int at = -1; at < KEYS * 3 * COMPONENTS; at++) {
        float values[KEYS * 3 * COMPONENTS] = {0};
        int outer = at < COMPONENTS || at >= (KEYS * 3 - 1) * COMPONENTS, moves = 0;
        struct stage s;
        if (at / COMPONENTS % 3 == 1 && at >= 0)
            continue; /* a key itself */
        stage_set(&s);
        s.instance.node = 0;
        for (int k = 0; k < KEYS; k++)
            values[(k * 3 + 1) * COMPONENTS] = 4;
        if (at >= 0)
            values[at] = 1;
        add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_CUBIC, KEYS, COMPONENTS, times, values);
        for (double t = -0.5; t < 2.6; t += 0.25) {
            struct scene_pose pose = pose_at(&s, t);
            for (int c = 0; c < 3; c++)
                moves |= pose.to_world[0].m[c][3] != (c == 0 ? 4 : 0);
            scene_pose_release(&pose);
        }
        assert_int_equal(moves, !outer);
        assert_true(scene_is_animated(&s.scene, &s.settings) >= moves);
        assert_false(at < 0 && scene_is_animated(&s.scene, &s.settings));
    }
}

static void assert_shutter(const struct stage *s, uint32_t frame, double open_s, double close_s)
{
    double open, close;

    scene_shutter(&s->scene, &s->settings, frame, &open, &close);
    assert_near(open, open_s, 1e-12);
    assert_near(close, close_s, 1e-12);
}

static void test_shutter(void **state)
{
    float times[] = {0, 1}, move[] = {0, 0, 0, 1, 0, 0};
    struct stage s;

    (void)state;
    stage_set(&s);
    s.settings.fps = 20;
    s.settings.shutter = 0.5f;
    assert_shutter(&s, 10, 0.5, 0.5); /* nothing moves */
    s.instance.node = 0;
    add_channel(&s, 0, PATH_TRANSLATION, INTERPOLATE_LINEAR, 2, 3, times, move);
    assert_shutter(&s, 0, 0, 0.025);
    assert_shutter(&s, 10, 0.5, 0.525);
    s.camera.shutter_open_s = -0.25f;
    s.camera.shutter_close_s = 0.75f;
    assert_shutter(&s, 10, 0.5, 0.525); /* the job's goes before the camera's */
    s.settings.shutter = 0;
    assert_shutter(&s, 10, 0.25, 1.25);
    s.settings.without = EFFECT_MOTION_BLUR;
    assert_shutter(&s, 10, 0.5, 0.5);
    s.settings.without = 0;
    s.camera.shutter_open_s = s.camera.shutter_close_s;
    assert_shutter(&s, 10, 0.5, 0.5);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_steps_and_lines),
        cmocka_unit_test(test_steps_on_time), cmocka_unit_test(test_many_keys),
        cmocka_unit_test(test_quarter_turn),    cmocka_unit_test(test_slerp_ends),
        cmocka_unit_test(test_splines),         cmocka_unit_test(test_hierarchy),
        cmocka_unit_test(test_camera_and_light), cmocka_unit_test(test_skin),
        cmocka_unit_test(test_morphs),          cmocka_unit_test(test_what_is_animated),
        cmocka_unit_test(test_tangents_alone),
        cmocka_unit_test(test_shutter),
    };

    return cmocka_run_group_tests_name("pose", tests, NULL, NULL);
}
