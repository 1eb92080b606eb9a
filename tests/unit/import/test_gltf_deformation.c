/* glTF: skins and morph targets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "tests/support/gltf_maker.h"

/* Accessor 1 JOINTS_0, 2 WEIGHTS_0, 3 two MAT4, 4 JOINTS_1, 5 WEIGHTS_1. */
static struct maker skin_maker(void)
{
    static const uint8_t joints[12] = {0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
    static const uint16_t weights[12] = {16384, 49151, 0, 0, 65535, 0, 0, 0, 0, 0, 0, 0};
    static const float binds[32] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -1, -2, -3, 1,
                                    2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 4,  5,  6,  1};
    static const uint16_t more_joints[12] = {2, 3, 4, 5, 0, 0, 0, 0, 0, 0, 0, 0};
    static const float more_weights[12] = {0.125f, 0.5f, 0.0625f, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    struct maker m = triangle_maker();

    put_accessor(&m, put_view(&m, joints, sizeof joints, 0), "VEC4", 5121, 3, "");
    put_accessor(&m, put_view(&m, weights, sizeof weights, 0), "VEC4", 5123, 3, ",\"normalized\":true");
    put_floats(&m, "MAT4", binds, 32, 2);
    put_accessor(&m, put_view(&m, more_joints, sizeof more_joints, 0), "VEC4", 5123, 3, "");
    put_floats(&m, "VEC4", more_weights, 12, 3);
    return m;
}

#define SKINNED_MESH(more) \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":1," \
    "\"WEIGHTS_0\":2" more "}}]}]"
#define SKELETON \
    "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0,\"skin\":0,\"translation\":[9,9,9]}," \
    "{\"children\":[2]},{\"translation\":[10,20,30],\"children\":[3]},{}]"

static void test_skin(void **state)
{
    struct maker m = skin_maker();
    const struct scene_skin *skin;
    struct import_result r;
    struct mesh_view v;

    (void)state;
    maker_import(&m, SKELETON ",\"skins\":[{\"joints\":[2,3],\"inverseBindMatrices\":3}]," SKINNED_MESH(""), &r);
    /* The joints and their parents, not the mesh's own node, whose transform does not count. */
    assert_int_equal(r.scene.node_count, 3);
    assert_int_equal(r.scene.skin_count, 1);
    skin = &r.scene.skins[0];
    assert_int_equal(skin->joint_count, 2);
    assert_int_equal(skin->joints[0], 1);
    assert_int_equal(skin->joints[1], 2);
    assert_floats(&skin->inverse_bind[0].m[0][0], (const float[]){1, 0, 0, -1, 0, 1, 0, -2, 0, 0, 1, -3}, 12, 0);
    assert_true(skin->inverse_bind[1].m[1][1] == 2 && skin->inverse_bind[1].m[2][3] == 6);
    assert_int_equal(r.scene.instances[0].skin, 0);
    assert_int_equal(r.scene.instances[0].node, -1);
    /* Where joint 0 has it. */
    assert_true(r.scene.instances[0].to_world.m[0][3] + r.scene.origin[0] == 9 &&
                r.scene.instances[0].to_world.m[2][3] + r.scene.origin[2] == 27);
    assert_int_equal(r.scene.meshes[0].arrays, MESH_SKIN);
    assert_int_equal(r.scene.meshes[0].closed, 0);
    v = view_mesh(&r, 0);
    /* Heaviest first; they add up to 1. */
    assert_floats(v.skin[0].weight, (const float[]){0.75f, 0.25f, 0, 0}, 4, 1e-4f);
    assert_int_equal(v.skin[0].joint[0], 1);
    assert_int_equal(v.skin[0].joint[1], 0);
    assert_floats(v.skin[1].weight, (const float[]){1, 0, 0, 0}, 4, 0);
    assert_int_equal(v.skin[1].joint[0], 1);
    assert_floats(v.skin[2].weight, (const float[]){1, 0, 0, 0}, 4, 0); /* loose */
    assert_int_equal(v.skin[2].joint[0], 0);
    assert_warned(&r, "no joint moves a vertex");
    import_result_release(&r);
    /* Without matrices they are identities; without a skin the joints are nothing. */
    m = skin_maker();
    maker_import(&m, SKELETON ",\"skins\":[{\"joints\":[2,3]}]," SKINNED_MESH(""), &r);
    assert_true(r.scene.skins[0].inverse_bind[1].m[1][1] == 1);
    import_result_release(&r);
    m = skin_maker();
    maker_import(&m, ONE_NODE "," SKINNED_MESH(""), &r);
    assert_int_equal(r.scene.meshes[0].arrays, 0);
    assert_int_equal(r.scene.node_count, 0);
    import_result_release(&r);
}

static void test_eight_joints(void **state)
{
    struct maker m = skin_maker();
    struct import_result r;
    struct mesh_view v;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{}],\"skins\":[{"
                 "\"joints\":[1,1,1,1,1,1]}]," SKINNED_MESH(",\"JOINTS_1\":4,\"WEIGHTS_1\":5"),
                 &r);
    v = view_mesh(&r, 0);
    /* 0.75 and 0.25 of joints 1 and 0; 0.125, 0.5, 0.0625 of 2, 3 and 4: the last goes, and
     * what is left adds up to 1.625. */
    assert_floats(v.skin[0].weight, (const float[]){0.75f / 1.625f, 0.5f / 1.625f, 0.25f / 1.625f, 0.125f / 1.625f}, 4,
                  1e-4f);
    assert_int_equal(v.skin[0].joint[0], 1);
    assert_int_equal(v.skin[0].joint[1], 3);
    assert_int_equal(v.skin[0].joint[2], 0);
    assert_int_equal(v.skin[0].joint[3], 2);
    assert_warned(&r, "the four heaviest");
    import_result_release(&r);
}

static void test_skin_faults(void **state)
{
    static const struct {
        const char *rest, *words;
    } cases[] = {
        {SKELETON ",\"skins\":[{\"joints\":[2]}]," SKINNED_MESH(""), "nodes[0]|joint 1|1 joints"},
        {SKELETON ",\"skins\":[{\"joints\":[]}]," SKINNED_MESH(""), "skins[0]|1 to 65536 joints"},
        {SKELETON ",\"skins\":[{\"joints\":[2,7]}]," SKINNED_MESH(""), "skins[0]|joints[1]"},
        {SKELETON ",\"skins\":[]," SKINNED_MESH(""), "nodes[0]|skin is 0"},
        {SKELETON ",\"skins\":[{\"joints\":[2,3],\"inverseBindMatrices\":0}]," SKINNED_MESH(""), "skins[0]|MAT4"},
        {SKELETON ",\"skins\":[{\"joints\":[2,3,3],\"inverseBindMatrices\":3}]," SKINNED_MESH(""),
         "skins[0]|each of the 3 joints"},
        {SKELETON ",\"skins\":[{\"joints\":[2,3]}]," SKINNED_MESH(",\"JOINTS_1\":4"), "JOINTS_1 and WEIGHTS_1"},
        /* A joint among its own descendants, outside of the scene. */
        {"\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{\"children\":[2]},"
         "{\"children\":[1]}],\"skins\":[{\"joints\":[1,2]}]," SKINNED_MESH(""),
         "own descendants"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = skin_maker();
        maker_refuse(&m, cases[i].rest, cases[i].words);
    }
}

/* ---- morph targets -------------------------------------------------------------------------- */

/* Accessor 1 offsets along x, 2 sparse offsets: vertex 2 along z; 3 times, 4 weights (two
 * targets, two keys), 5 weights that never change. */
static struct maker morph_maker(void)
{
    static const float along_x[9] = {1, 0, 0, 1, 0, 0, 1, 0, 0};
    static const uint16_t which[1] = {2};
    static const float where[3] = {0, 0, 4};
    static const float times[2] = {0, 3};
    static const float weights[4] = {0, 0, 1, 0.5f};
    static const float same[4] = {2, 0.25f, 2, 0.25f};
    struct maker m = triangle_maker();
    char sparse[256];
    int indices, values;

    put_floats(&m, "VEC3", along_x, 9, 3);
    indices = put_view(&m, which, sizeof which, 0);
    values = put_view(&m, where, sizeof where, 0);
    snprintf(sparse, sizeof sparse,
             ",\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":%d,\"componentType\":5123},"
             "\"values\":{\"bufferView\":%d}}",
             indices, values);
    put_accessor(&m, -1, "VEC3", 5126, 3, sparse);
    put_floats(&m, "SCALAR", times, 2, 2);
    put_floats(&m, "SCALAR", weights, 4, 4);
    put_floats(&m, "SCALAR", same, 4, 4);
    return m;
}

#define MORPHED(weights) \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[" \
    "{\"POSITION\":1},{\"POSITION\":2}]}]" weights "}]"
#define MORPH_ANIMATION(output) \
    "\"animations\":[{\"samplers\":[{\"input\":3,\"output\":" #output "}],\"channels\":[{" \
    "\"sampler\":0,\"target\":{\"node\":0,\"path\":\"weights\"}}]}]"

static void test_morph(void **state)
{
    struct maker m = morph_maker();
    const struct scene_channel *c;
    struct import_result r;
    struct mesh_view v;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0,\"weights\":[0.5,0.75]},"
                 "{\"mesh\":0}]," MORPH_ANIMATION(4) "," MORPHED(",\"weights\":[0,0.5]"),
                 &r);
    assert_int_equal(r.scene.node_count, 1);
    assert_int_equal(r.scene.nodes[0].weight_count, 2);
    assert_floats(r.scene.nodes[0].weights, (const float[]){0.5f, 0.75f}, 2, 0);
    c = &r.scene.channels[0];
    assert_true(c->path == PATH_WEIGHTS && c->components == 2 && c->key_count == 2);
    assert_floats(c->values, (const float[]){0, 0, 1, 0.5f}, 4, 0);
    /* Two uses of one mesh: one that changes, and one that stands still in the mesh's own
     * shape. */
    assert_int_equal(r.scene.mesh_count, 2);
    assert_int_equal(r.scene.instances[0].node, 0);
    assert_int_equal(r.scene.instances[1].node, -1);
    v = view_mesh(&r, r.scene.instances[0].mesh);
    assert_int_equal(v.mesh->morph_count, 2);
    assert_int_equal(v.mesh->closed, 0);
    assert_floats(v.positions, corner_positions, 9, 0);
    assert_int_equal(v.morph_floats, 9);
    assert_floats(v.morphs, (const float[]){1, 0, 0, 1, 0, 0, 1, 0, 0}, 9, 0);
    assert_floats(v.morphs + 9, (const float[]){0, 0, 0, 0, 0, 0, 0, 0, 4}, 9, 0);
    v = view_mesh(&r, r.scene.instances[1].mesh);
    assert_int_equal(v.mesh->morph_count, 0);
    assert_floats(v.positions, (const float[]){0, 0, 0, 1, 0, 0, 0, 1, 2}, 9, 0);
    import_result_release(&r);
}

/* Weights that never change are a shape, also when an animation says them. */
static void test_morph_baked(void **state)
{
    struct maker m = morph_maker();
    struct import_result r;

    (void)state;
    maker_import(&m, ONE_NODE "," MORPH_ANIMATION(5) "," MORPHED(""), &r);
    assert_int_equal(r.scene.node_count, 0);
    assert_int_equal(r.scene.meshes[0].morph_count, 0);
    assert_floats(view_mesh(&r, 0).positions, (const float[]){2, 0, 0, 3, 0, 0, 2, 1, 1}, 9, 0);
    import_result_release(&r);
    /* Two nodes in one shape share it; each other weight makes another. */
    m = morph_maker();
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2,3]}],\"nodes\":[{\"mesh\":0},{\"mesh\":0,\"weights\":"
                 "[0,0]},{\"mesh\":0,\"weights\":[1]},{\"mesh\":0,\"weights\":[0,1]}]," MORPHED(""),
                 &r);
    assert_int_equal(r.scene.instances[0].mesh, r.scene.instances[1].mesh);
    assert_int_not_equal(r.scene.instances[0].mesh, r.scene.instances[2].mesh);
    assert_floats(view_mesh(&r, r.scene.instances[2].mesh).positions, (const float[]){1, 0, 0, 2, 0, 0, 1, 1, 0}, 9, 0);
    assert_floats(view_mesh(&r, r.scene.instances[3].mesh).positions, (const float[]){0, 0, 0, 1, 0, 0, 0, 1, 4}, 9, 0);
    import_result_release(&r);
}

static void test_morph_normals(void **state)
{
    static const float normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    struct maker m = morph_maker();
    struct import_result r;
    struct mesh_view v;

    (void)state;
    put_floats(&m, "VEC3", normals, 9, 3);
    maker_import(&m,
                 ONE_NODE "," MORPH_ANIMATION(4) ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                 "\"POSITION\":0,\"NORMAL\":6},\"targets\":[{\"POSITION\":1,\"NORMAL\":1},"
                 "{\"TANGENT\":1}]}]}]",
                 &r);
    v = view_mesh(&r, 0);
    assert_int_equal(v.morph_floats, 18);
    assert_floats(v.morphs + 9, (const float[]){1, 0, 0, 1, 0, 0, 1, 0, 0}, 9, 0);
    for (int i = 18; i < 36; i++) /* neither positions nor normals: the second does nothing */
        assert_true(v.morphs[i] == 0);
    import_result_release(&r);
    /* Of a shape that does not change they are the shape's, too. */
    m = morph_maker();
    put_floats(&m, "VEC3", normals, 9, 3);
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"weights\":[0.75],\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":6},"
                          "\"targets\":[{\"POSITION\":2,\"NORMAL\":1}]}]}]", &r);
    v = view_mesh(&r, 0);
    assert_floats(v.positions, (const float[]){0, 0, 0, 1, 0, 0, 0, 1, 3}, 9, 0);
    assert_floats(v.normals, (const float[]){0.6f, 0, 0.8f, 0.6f, 0, 0.8f, 0.6f, 0, 0.8f}, 9, 1e-6f);
    import_result_release(&r);
}

/* One mesh at three places: with joints, without, and in another shape. */
static void test_uses_of_a_mesh(void **state)
{
    struct maker m = skin_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", (const float[]){0, 0, 1, 0, 0, 1, 0, 0, 1}, 9, 3);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2,3,4]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{\"mesh\":0},{\"mesh\":0,\"weights\":[1]},"
                 "{\"mesh\":0,\"skin\":0,\"weights\":[1]},{}],\"skins\":[{\"joints\":[4,4]}],\"meshes\":[{\"primitives\":[{\"attributes\":{"
                 "\"POSITION\":0,\"JOINTS_0\":1,\"WEIGHTS_0\":2},\"targets\":[{\"POSITION\":6}]}]}]", &r);
    assert_int_equal(r.scene.instance_count, 4);
    for (uint32_t i = 0; i < 4; i++) {
        const int is_skinned = i % 3 == 0;
        const struct mesh_view v = view_mesh(&r, r.scene.instances[i].mesh);
        assert_int_equal(v.mesh->arrays & MESH_SKIN, is_skinned ? MESH_SKIN : 0);
        assert_int_equal(r.scene.instances[i].skin, is_skinned ? 0 : -1);
        assert_true(v.positions[2] == (i < 2 ? 0 : 1));
    }
    import_result_release(&r);
}

/* What joints move may change its shape meanwhile: the node says how far. */
static void test_morph_of_a_skin(void **state)
{
    struct maker m = skin_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", (const float[]){0, 0, 1, 0, 0, 1, 0, 0, 1}, 9, 3);
    put_floats(&m, "SCALAR", (const float[]){0, 3}, 2, 2);
    put_floats(&m, "SCALAR", (const float[]){0, 1}, 2, 2);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{}],\"skins\":[{\"joints\":[1,1]}],"
                 "\"animations\":[{\"samplers\":[{\"input\":7,\"output\":8}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,"
                 "\"path\":\"weights\"}}]}],\"meshes\":[{\"primitives\":[{\"attributes\":{"
                 "\"POSITION\":0,\"JOINTS_0\":1,\"WEIGHTS_0\":2},\"targets\":[{\"POSITION\":6}]}]}]", &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_int_equal(r.scene.instances[0].skin, 0);
    assert_int_equal(view_mesh(&r, r.scene.instances[0].mesh).mesh->morph_count, 1);
    assert_in_range(r.scene.instances[0].node, 0, r.scene.node_count - 1);
    assert_int_equal(r.scene.nodes[r.scene.instances[0].node].weight_count, 1);
    assert_int_equal(r.scene.channels[0].node, r.scene.instances[0].node);
    import_result_release(&r);
}

/* A triangle that only opens when it is morphed stays. */
static void test_morph_opens(void **state)
{
    static const float line[9] = {0, 0, 0, 1, 0, 0, 2, 0, 0};
    struct maker m = morph_maker();
    struct import_result r;

    (void)state;
    put_floats(&m, "VEC3", line, 9, 3);
    maker_import(&m,
                 ONE_NODE "," MORPH_ANIMATION(4) ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                                                 "\"POSITION\":6},\"targets\":[{\"POSITION\":1},{\"POSITION\":2}]}]}]",
                 &r);
    assert_int_equal(r.triangles, 1);
    assert_int_equal(r.degenerate_triangles, 0);
    import_result_release(&r);
}

static void test_morph_faults(void **state)
{
    static const struct {
        const char *rest, *words;
    } cases[] = {
        {ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[7]"
                  "}]}]",
         "meshes[0].primitives[0].targets[0]|object"},
        {ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[{"
                  "\"POSITION\":3}]}]}]",
         "targets[0]: POSITION must have 3"},
        {ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"targets\":[{}]"
                  "},{\"attributes\":{\"POSITION\":0}}]}]",
         "primitives[1]|0 morph targets"},
        {"\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"weights\":[1,2,3]}]," MORPHED(""),
         "nodes[0]|3 weights|2 morph targets"},
        {ONE_NODE "," MORPH_ANIMATION(3) "," MORPHED(""), "4 elements of 1 components"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = morph_maker();
        maker_refuse(&m, cases[i].rest, cases[i].words);
    }
}

static void test_no_memory(void **state)
{
    struct maker m = skin_maker();

    (void)state;
    put_floats(&m, "SCALAR", (const float[]){0, 1}, 2, 2);
    put_floats(&m, "SCALAR", (const float[]){0.5f, 1}, 2, 2);
    put_floats(&m, "VEC3", (const float[]){0, 0, 0, 1, 1, 1}, 6, 2);
    maker_starve(&m,
                 SKELETON ",\"skins\":[{\"joints\":[2,3],\"inverseBindMatrices\":3}],\"meshes\":[{"
                          "\"primitives\":[{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":1,"
                          "\"WEIGHTS_0\":2},\"targets\":[{"
                          "\"POSITION\":0}]}]}],\"animations\":[{\"name\":\"a\",\"samplers\":["
                          "{\"input\":6,\"output\":7},{\"input\":6,\"output\":8}],\"channels\":["
                          "{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"weights\"}},"
                          "{\"sampler\":1,\"target\":{\"node\":2,\"path\":\"translation\"}}]}]",
                 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_skin),
        cmocka_unit_test(test_eight_joints),
        cmocka_unit_test(test_skin_faults),
        cmocka_unit_test(test_morph),
        cmocka_unit_test(test_morph_baked),
        cmocka_unit_test(test_morph_normals),
        cmocka_unit_test(test_uses_of_a_mesh),
        cmocka_unit_test(test_morph_of_a_skin),
        cmocka_unit_test(test_morph_opens),
        cmocka_unit_test(test_morph_faults),
        cmocka_unit_test(test_no_memory),
    };

    return cmocka_run_group_tests_name("glTF deformation", tests, NULL, NULL);
}
