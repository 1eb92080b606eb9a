/* pbrt-v4's names: used before they are defined, and defined once. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"
#include "tests/support/starve.h"

#define RED(name, value) "Texture \"" name "\" \"spectrum\" \"constant\" \"rgb value\" [" #value " 0 0] "
#define NUMBER(name, value) "Texture \"" name "\" \"float\" \"constant\" \"float value\" " #value " "
#define MATTE(name, texture) "MakeNamedMaterial \"" name "\" \"string type\" \"diffuse\" \"texture reflectance\" \"" texture "\" "
#define USE(name) "NamedMaterial \"" name "\" " TRIANGLE

static const struct scene_material *surface(const struct import_result *r, uint32_t instance)
{
    assert_true(instance < r->scene.instance_count);
    return &r->scene.materials[r->scene.instances[instance].material];
}

/* Where the point 0 of an instance lies. */
static void assert_origin(const struct import_result *r, uint32_t instance, float x, float y, float z)
{
    const struct vec3 got = in_file(&r->scene, &r->scene.instances[instance].to_world, (struct vec3){0, 0, 0});

    assert_float_equal(got.x, x, 1e-5f);
    assert_float_equal(got.y, y, 1e-5f);
    assert_float_equal(got.z, z, 1e-5f);
}

/* Each world's first surface is of this red and alpha, whatever is defined above it or below. */
static void test_used_before(void **state)
{
    static const struct {
        const char *world;
        float red, alpha;
    } cases[] = {
        {USE("A") MATTE("A", "t") RED("t", .8), 0.8f, 1},
        {MATTE("A", "t") USE("A") RED("t", .8), 0.8f, 1},
        {"Material \"diffuse\" \"texture reflectance\" \"t\" " TRIANGLE RED("t", .3), 0.3f, 1},
        /* A name is one of its kind: the number above is not the colour below. */
        {NUMBER("t", .5) "Material \"diffuse\" \"texture reflectance\" \"t\" " TRIANGLE RED("t", .3), 0.3f, 1},
        {RED("t", .3) "Attribute \"shape\" \"texture alpha\" \"t\" Material \"diffuse\" \"texture reflectance\" \"t\" " TRIANGLE
         NUMBER("t", .25), 0.3f, 0.25f},
        /* Textures of later textures: .5 * .5 * .8. */
        {"Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"float scale\" .5 "
         "Texture \"a\" \"spectrum\" \"scale\" \"texture tex\" \"t\" \"texture scale\" \"s\" " MATTE("A", "b") USE("A")
         NUMBER("s", .5) RED("t", .8), 0.2f, 1},
        /* The state that counts is that of the use. */
        {"AttributeBegin " USE("A") "AttributeEnd Material \"diffuse\" \"rgb reflectance\" [.1 0 0] " MATTE("A", "t") RED("t", .8),
         0.8f, 1},
        {"AttributeBegin " MATTE("A", "t") RED("t", .7) "AttributeEnd " USE("A"), 0.7f, 1},
    };
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct buffer text = BUFFER_INIT;
        buffer_printf(&text, LAMP "%s", cases[i].world);
        pbrt_world(buffer_text(&text), &r);
        buffer_release(&text);
        if (fabsf(surface(&r, 0)->base_color[0] - cases[i].red) > 1e-6f ||
            fabsf(surface(&r, 0)->base_color[3] - cases[i].alpha) > 1e-6f)
            fail_msg("case %zu: %g, alpha %g", i, (double)surface(&r, 0)->base_color[0],
                     (double)surface(&r, 0)->base_color[3]);
        import_result_release(&r);
    }
}

/* A mix whose parts follow, one of them again a mix. */
static void test_mix_before(void **state)
{
    const struct scene_material *m, *inner;
    struct import_result r;

    (void)state;
    pbrt_world(LAMP USE("M")
               "MakeNamedMaterial \"M\" \"string type\" \"mix\" \"string materials\" [\"N\" \"A\"] \"texture amount\" \"f\" "
               "MakeNamedMaterial \"N\" \"string type\" \"mix\" \"string materials\" [\"A\" \"B\"] "
               MATTE("A", "t") "MakeNamedMaterial \"B\" \"string type\" \"diffuse\" \"rgb reflectance\" [.1 0 0] "
               RED("t", .8) NUMBER("f", .25), &r);
    m = surface(&r, 0);
    assert_int_equal(m->kind, MATERIAL_MIX);
    assert_float_equal(m->mix_amount, 0.25f, 1e-6f);
    assert_float_equal(r.scene.materials[m->mix_material[1]].base_color[0], 0.8f, 1e-6f);
    inner = &r.scene.materials[m->mix_material[0]];
    assert_int_equal(inner->kind, MATERIAL_MIX);
    assert_float_equal(r.scene.materials[inner->mix_material[0]].base_color[0], 0.8f, 1e-6f);
    assert_float_equal(r.scene.materials[inner->mix_material[1]].base_color[0], 0.1f, 1e-6f);
    import_result_release(&r);
    /* Its parts are known, their texture is not. */
    pbrt_world(LAMP MATTE("A", "t") "Material \"mix\" \"string materials\" [\"A\" \"A\"] " TRIANGLE RED("t", .8), &r);
    assert_float_equal(r.scene.materials[surface(&r, 0)->mix_material[0]].base_color[0], 0.8f, 1e-6f);
    import_result_release(&r);
}

/* What waits keeps its place, its light, its sides and its medium. */
static void test_state_of_use(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world("AttributeBegin Translate 1 2 3 AreaLightSource \"diffuse\" \"rgb L\" [5 6 7] \"bool twosided\" true " USE("A")
               "AttributeEnd " MATTE("A", "t") RED("t", .8), &r);
    assert_true(surface(&r, 0)->emission[0] == 5 && surface(&r, 0)->emission[2] == 7);
    assert_origin(&r, 0, 1, 2, 3);
    import_result_release(&r);
    pbrt_world(LAMP "AttributeBegin MediumInterface \"fog\" \"\" Material \"interface\" Shape \"sphere\" AttributeEnd "
               "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_s\" [2 2 2] \"rgb sigma_a\" [0 0 0]", &r);
    assert_int_equal(r.scene.medium_count, 1);
    assert_true(surface(&r, 0)->medium == 0 && surface(&r, 0)->medium_outside < 0);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

/* Objects are placed with all of their shapes, and may be defined later, too. */
static void test_objects_before(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "ObjectBegin \"o\" " TRIANGLE USE("A") "ObjectEnd Translate 7 0 0 ObjectInstance \"o\" "
               "ObjectInstance \"later\" Identity ObjectBegin \"later\" Translate 0 1 0 " USE("A") "ObjectEnd "
               MATTE("A", "t") RED("t", .8), &r);
    assert_int_equal(r.scene.instance_count, 3);
    assert_float_equal(surface(&r, 1)->base_color[0], 0.8f, 1e-6f);
    for (uint32_t i = 0; i < 3; i++)
        assert_origin(&r, i, 7, i == 2, 0);
    import_result_release(&r);
}

/* In pbrt-v3 an instance is of the object that had the name where it stands. */
static void test_objects_of_version3(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("Film \"image\" " RIGHT_HANDED "WorldBegin " LAMP "ObjectBegin \"o\" Translate 1 0 0 " TRIANGLE "ObjectEnd "
               "ObjectInstance \"o\" ObjectBegin \"o\" Translate 2 0 0 " TRIANGLE "ObjectEnd ObjectInstance \"o\"", NULL, &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_origin(&r, 0, 1, 0, 0);
    assert_origin(&r, 1, 2, 0, 0);
    import_result_release(&r);
}

static void test_defined_twice(void **state)
{
    static const char *const bad[][2] = {
        {RED("t", .1) "\n" RED("t", .2), "a.pbrt:3: |spectrum texture \"t\"|first in a.pbrt:2:"},
        {NUMBER("t", .1) "\n\n" NUMBER("t", .2), "a.pbrt:4: |float texture \"t\"|first in a.pbrt:2:"},
        {RED("t", .1) MATTE("A", "t") "AttributeBegin\n" MATTE("A", "t"), "a.pbrt:3: |material \"A\"|first in a.pbrt:2:"},
        {USE("A") MATTE("A", "t") "\n" MATTE("A", "t"), "a.pbrt:4: |material \"A\"|first in a.pbrt:3:"},
        {"MakeNamedMedium \"m\" \"string type\" \"homogeneous\"\nMakeNamedMedium \"m\" \"string type\" \"homogeneous\"",
         "a.pbrt:3: |medium \"m\"|first in a.pbrt:2:"},
        {"ObjectBegin \"o\" ObjectEnd\nObjectBegin \"o\" ObjectEnd", "a.pbrt:3: |object \"o\"|first in a.pbrt:2:"},
        /* Never defined: at the use. */
        {"\n" USE("A"), "a.pbrt:3: |material \"A\" is not known"},
        {"\n" MATTE("A", "gone") "\n" USE("A"), "a.pbrt:3: |\"gone\" is not known"},
        {"ObjectInstance \"gone\"", "a.pbrt:2: |\"gone\" is not known"},
        /* In a circle. */
        {"\nTexture \"a\" \"float\" \"scale\" \"texture tex\" \"b\" Texture \"b\" \"float\" \"scale\" \"texture tex\" \"a\"",
         "a.pbrt:3: |\"b\" is not known"},
        {USE("M") "MakeNamedMaterial \"M\" \"string type\" \"mix\" \"string materials\" [\"N\" \"N\"] "
         "MakeNamedMaterial \"N\" \"string type\" \"mix\" \"string materials\" [\"M\" \"M\"] ", "a.pbrt:3: |mixed more than 16 deep"},
    };
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct buffer text = BUFFER_INIT;
        buffer_printf(&text, "WorldBegin\n" "%s", bad[i][0]);
        pbrt_refused(buffer_text(&text), bad[i][1]);
        buffer_release(&text);
    }
    /* One of each kind, and a name that nothing uses. */
    pbrt_world(LAMP RED("t", .1) NUMBER("t", .1) MATTE("t", "t") USE("t") "NamedMaterial \"none\" ", &r);
    assert_float_equal(surface(&r, 0)->base_color[0], 0.1f, 1e-6f);
    import_result_release(&r);
}

/* Long chains that stand upside down end soon, whatever they are built of. */
static void test_long_chain(void **state)
{
    struct buffer text = BUFFER_INIT;

    (void)state;
    buffer_puts(&text, "WorldBegin ");
    for (int i = 20000; i > 0; i--)
        buffer_printf(&text, "Texture \"%d\" \"float\" \"scale\" \"texture tex\" \"%d\" ", i, i - 1);
    buffer_puts(&text, NUMBER("0", 1));
    pbrt_refused(buffer_text(&text), "use later ones more than 32 deep");
    buffer_release(&text);
}

static status read_upside_down(void *user)
{
    static const char text[] = RIGHT_HANDED
        "WorldBegin " LAMP "ObjectInstance \"o\" Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"t\" " USE("A")
            MATTE("A", "b") RED("t", .8) "ObjectBegin \"o\" " USE("B") "ObjectEnd " MATTE("B", "t");

    (void)user;
    return pbrt_read_only(text);
}

static void test_out_of_memory(void **state)
{
    (void)state;
    assert_true(starve_each(read_upside_down, NULL, 3) > 50);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_used_before),   cmocka_unit_test(test_mix_before),    cmocka_unit_test(test_state_of_use),
        cmocka_unit_test(test_objects_before), cmocka_unit_test(test_defined_twice), cmocka_unit_test(test_long_chain),
        cmocka_unit_test(test_objects_of_version3),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
