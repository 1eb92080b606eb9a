/* Bodies: which meshes bound one volume, and what an import says of those that are open. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "tests/support/gltf_maker.h"

#define VOLUME(name, values)                                                                    \
    "{\"name\":\"" name "\",\"pbrMetallicRoughness\":{\"metallicFactor\":0},\"extensions\":{"   \
    "\"KHR_materials_transmission\":{\"transmissionFactor\":1},"                                \
    "\"KHR_materials_volume\":{\"thicknessFactor\":1" values "}}}"
#define TWO_VOLUMES                                                                             \
    "\"materials\":[" VOLUME("wall", "") "," VOLUME("lid", "") "]"
/* Mesh 0: the box's first 5 faces and the last one, of these materials. */
#define BOX_AND_LID(box, lid)                                                                   \
    "\"meshes\":[{\"name\":\"box\",\"primitives\":["                                            \
    "{\"attributes\":{\"POSITION\":0},\"indices\":2,\"material\":" #box "},"                    \
    "{\"attributes\":{\"POSITION\":0},\"indices\":3,\"material\":" #lid "}]}]"

/* The unit box as put_box has it, then its indices as two accessors: 5 faces and 1. */
static struct maker cut_box(void)
{
    static const uint16_t first[30] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5,
                                       0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2};
    static const uint16_t last[6] = {1, 3, 7, 1, 7, 5};
    struct maker m = {0};

    put_box(&m, 0);
    put_accessor(&m, put_view(&m, first, sizeof first, 0), "SCALAR", 5123, 30, "");
    put_accessor(&m, put_view(&m, last, sizeof last, 0), "SCALAR", 5123, 6, "");
    return m;
}

static void expect_bodies(const struct import_result *r, const int32_t *bodies, uint32_t count)
{
    assert_int_equal(r->scene.instance_count, count);
    for (uint32_t i = 0; i < count; i++)
        assert_int_equal(r->scene.instances[i].body, bodies[i]);
}

static void expect_sealed(const struct import_result *r, int sealed)
{
    for (uint32_t i = 0; i < r->scene.instance_count; i++)
        assert_int_equal(r->scene.instances[i].sealed, sealed);
}

static void quiet(const struct import_result *r)
{
    assert_false(warned(r, "not closed"));
    assert_false(warned(r, "wound inwards"));
    assert_false(warned(r, "differently"));
}

static void test_one_material(void **state)
{
    struct maker m = cut_box();
    struct import_result r;

    (void)state;
    maker_import(&m, ONE_NODE "," TWO_VOLUMES "," BOX_AND_LID(0, 0), &r);
    expect_bodies(&r, (const int32_t[]){-1, -1}, 2);
    expect_sealed(&r, 1);
    quiet(&r);
    import_result_release(&r);
}

static void test_two_materials(void **state)
{
    struct maker m = cut_box();
    struct import_result r;

    (void)state;
    maker_import(&m, ONE_NODE "," TWO_VOLUMES "," BOX_AND_LID(1, 0), &r);
    expect_bodies(&r, (const int32_t[]){-1, 0}, 2); /* materials are in the order of their use */
    expect_sealed(&r, 1);
    quiet(&r);
    import_result_release(&r);
}

static void test_different_fillings(void **state)
{
    struct maker m = cut_box();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 ONE_NODE ",\"materials\":[" VOLUME("wall", "") "," VOLUME(
                     "lid", ",\"attenuationDistance\":1,\"attenuationColor\":[0.5,1,1]") "]," BOX_AND_LID(0, 1),
                 &r);
    expect_bodies(&r, (const int32_t[]){-1, 0}, 2);
    assert_warned(&r, "'wall' and 'lid' close one volume together");
    import_result_release(&r);
}

/* A mirrored copy of one half closes the other: x from -1 to 0 is the box's mirror image. */
static void test_mirrored(void **state)
{
    struct import_result r;

    (void)state;
    for (int lid = 0; lid < 2; lid++) {
        struct maker m = {0};
        static const uint16_t tub[30] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5,
                                         0, 5, 4, 2, 6, 7, 2, 7, 3, 1, 3, 7, 1, 7, 5};
        put_box(&m, 0);
        put_accessor(&m, put_view(&m, tub, sizeof tub, 0), "SCALAR", 5123, 30, "");
        maker_import(&m,
                     lid ? "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
                           "{\"mesh\":0,\"scale\":[-1,1,1]}]," TWO_VOLUMES
                           ",\"meshes\":[{\"name\":\"tub\",\"primitives\":["
                           "{\"attributes\":{\"POSITION\":0},\"indices\":2,\"material\":0}]}]"
                         : ONE_NODE "," TWO_VOLUMES ",\"meshes\":[{\"name\":\"tub\",\"primitives\":["
                                    "{\"attributes\":{\"POSITION\":0},\"indices\":2,\"material\":0}]}]",
                     &r);
        if (lid)
            quiet(&r);
        else
            assert_warned(&r, "material 'wall': its volume is not closed: 'tub' has 4 open edges");
        expect_sealed(&r, lid);
        import_result_release(&r);
    }
}

/* Two boxes that touch in a whole face are closed each by itself: two bodies. */
static void test_touching(void **state)
{
    struct maker m = cut_box();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
                 "{\"mesh\":1,\"translation\":[1,0,0]}]," TWO_VOLUMES
                 ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,"
                 "\"material\":0}]},{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                 "\"indices\":1,\"material\":1}]}]",
                 &r);
    expect_bodies(&r, (const int32_t[]){-1, -1}, 2);
    quiet(&r);
    import_result_release(&r);
}

/* Two that share an open edge and leave others open do not become one. */
static void test_open_together(void **state)
{
    struct maker m = {0};
    static const uint16_t two[12] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6};
    static const uint16_t one[6] = {0, 1, 5, 0, 5, 4};
    struct import_result r;

    (void)state;
    put_box(&m, 0);
    put_accessor(&m, put_view(&m, two, sizeof two, 0), "SCALAR", 5123, 12, "");
    put_accessor(&m, put_view(&m, one, sizeof one, 0), "SCALAR", 5123, 6, "");
    maker_import(&m, ONE_NODE "," TWO_VOLUMES "," BOX_AND_LID(0, 1), &r);
    expect_bodies(&r, (const int32_t[]){-1, -1}, 2);
    expect_sealed(&r, 0);
    assert_warned(&r, "material 'wall': its volume is not closed");
    assert_warned(&r, "material 'lid': its volume is not closed");
    import_result_release(&r);
}

static void test_inverted(void **state)
{
    struct maker m = {0};
    struct import_result r;

    (void)state;
    put_box(&m, 1);
    maker_import(&m,
                 ONE_NODE "," TWO_VOLUMES ",\"meshes\":[{\"name\":\"inside out\",\"primitives\":["
                          "{\"attributes\":{\"POSITION\":0},\"indices\":1,\"material\":0}]}]",
                 &r);
    assert_warned(&r, "material 'wall': 'inside out' is wound inwards");
    expect_sealed(&r, 0);
    import_result_release(&r);
}

/* What is no volume may be open. */
static void test_thin(void **state)
{
    struct maker m = cut_box();
    struct import_result r;

    (void)state;
    maker_import(&m, ONE_NODE ",\"materials\":[{\"name\":\"pane\",\"extensions\":{"
                              "\"KHR_materials_transmission\":{\"transmissionFactor\":1}}}]"
                              ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                              "\"indices\":3,\"material\":0}]}]", &r);
    quiet(&r);
    import_result_release(&r);
}

/* glTF says nothing of priorities: an extra does, and what is no number is somebody else's. */
static void test_priority(void **state)
{
    static const struct {
        const char *extras;
        int priority;
    } cases[] = {{"{\"dielectric_priority\":3}", 3}, {"{\"dielectric_priority\":-2.0}", -2},
                 {"{\"dielectric_priority\":1e9}", SCENE_PRIORITY_MAX},
                 {"{\"dielectric_priority\":\"high\"}", 0}, {"[1,2]", 0}};
    char rest[2048];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = cut_box();
        struct import_result r;
        snprintf(rest, sizeof rest,
                 ONE_NODE ",\"materials\":[{\"extras\":%s,\"extensions\":{"
                 "\"KHR_materials_transmission\":{\"transmissionFactor\":1},"
                 "\"KHR_materials_volume\":{\"thicknessFactor\":1}}}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                 "\"indices\":1,\"material\":0}]}]", cases[i].extras);
        maker_import(&m, rest, &r);
        assert_int_equal(r.scene.materials[0].priority, cases[i].priority);
        import_result_release(&r);
    }
}

static void test_no_memory(void **state)
{
    struct maker m = cut_box();

    (void)state;
    maker_starve(&m, ONE_NODE "," TWO_VOLUMES "," BOX_AND_LID(0, 1), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_material),  cmocka_unit_test(test_two_materials),
        cmocka_unit_test(test_different_fillings), cmocka_unit_test(test_mirrored),
        cmocka_unit_test(test_touching),      cmocka_unit_test(test_open_together),
        cmocka_unit_test(test_inverted),      cmocka_unit_test(test_thin),
        cmocka_unit_test(test_priority),      cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("bodies", tests, NULL, NULL);
}
