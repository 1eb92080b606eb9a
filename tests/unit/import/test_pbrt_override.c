/* pbrt-v3: a shape's own values for parameters of its material. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"

#define RED(name, value) "Texture \"" name "\" \"color\" \"constant\" \"rgb value\" [" #value " 0 0] "

static void version3(const char *world, struct import_result *r)
{
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text, "Film \"image\" " RIGHT_HANDED "WorldBegin\n" LAMP "%s", world);
    pbrt_whole(buffer_text(&text), NULL, r);
    buffer_release(&text);
}

static const struct scene_material *surface(const struct import_result *r, uint32_t instance)
{
    assert_true(instance < r->scene.instance_count);
    return &r->scene.materials[r->scene.instances[instance].material];
}

/* Textures, colours and numbers, for this one shape. */
static void test_own_values(void **state)
{
    struct import_result r;

    (void)state;
    version3(RED("t", .8) "Material \"matte\" \"rgb Kd\" [.1 0 0] " TRIANGLE "\"texture Kd\" \"t\"\n" TRIANGLE
             TRIANGLE "\"rgb Kd\" [.3 0 0] " RED("t", .6) "Material \"matte\" \"texture Kd\" \"t\" " TRIANGLE "\"color Kd\" [.4 0 0]\n"
             "Shape \"sphere\" \"float radius\" 2 \"texture Kd\" \"t\"", &r);
    assert_float_equal(surface(&r, 0)->base_color[0], 0.8f, 1e-6f);
    assert_float_equal(surface(&r, 1)->base_color[0], 0.1f, 1e-6f);
    assert_float_equal(surface(&r, 2)->base_color[0], 0.3f, 1e-6f);
    assert_float_equal(surface(&r, 3)->base_color[0], 0.4f, 1e-6f);
    assert_float_equal(surface(&r, 4)->base_color[0], 0.6f, 1e-6f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    /* A number over a texture, in a material with a name; the rest of it stays. */
    version3("Texture \"r\" \"float\" \"checkerboard\" MakeNamedMaterial \"A\" \"string type\" \"plastic\" \"texture roughness\" \"r\" "
             "\"bool remaproughness\" \"false\" \"rgb Kd\" [.2 0 0] NamedMaterial \"A\" " TRIANGLE "\"float roughness\" .25\n", &r);
    assert_float_equal(surface(&r, 0)->roughness, 0.5f, 1e-6f); /* the square root of alpha */
    assert_true(surface(&r, 0)->metallic_roughness_texture.texture < 0);
    assert_float_equal(surface(&r, 0)->base_color[0], 0.2f, 1e-6f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

/* A mix has its own share; its parts stay as they are. In pbrt-v3 it is that of the first. */
static void test_mix(void **state)
{
    const struct scene_material *m;
    struct import_result r;

    (void)state;
    version3("MakeNamedMaterial \"A\" \"string type\" \"matte\" \"rgb Kd\" [.1 0 0] "
             "MakeNamedMaterial \"B\" \"string type\" \"matte\" \"rgb Kd\" [.2 0 0] "
             "Material \"mix\" \"string namedmaterial1\" \"A\" \"string namedmaterial2\" \"B\" "
             "MakeNamedMaterial \"A\" \"string type\" \"matte\" \"rgb Kd\" [.9 0 0] "
             TRIANGLE "\"rgb amount\" [.25 .25 .25] \"rgb Kd\" [.7 0 0]", &r);
    m = surface(&r, 0);
    assert_float_equal(m->mix_amount, 0.75f, 1e-6f);
    assert_float_equal(r.scene.materials[m->mix_material[0]].base_color[0], 0.1f, 1e-6f);
    assert_float_equal(r.scene.materials[m->mix_material[1]].base_color[0], 0.2f, 1e-6f);
    pbrt_warned(&r, "shape \"trianglemesh\"|Kd\" is not known");
    import_result_release(&r);
}

/* Equal values share a material; a name that means something else does not. */
static void test_shared(void **state)
{
    struct import_result r;

    (void)state;
    version3(RED("t", .8) "Material \"matte\" " TRIANGLE "\"texture Kd\" \"t\"\n" TRIANGLE "\"texture Kd\" \"t\"\n" RED("t", .6)
             TRIANGLE "\"texture Kd\" \"t\"\n" "Shape \"sphere\" \"float radius\" 1 \"texture Kd\" \"t\"\n"
             "Shape \"sphere\" \"float radius\" 2 \"texture Kd\" \"t\"\n"
             "Material \"matte\" \"float sigma\" 20 " TRIANGLE "\"texture Kd\" \"t\"\n", &r);
    assert_int_equal(r.scene.instances[0].material, r.scene.instances[1].material);
    assert_float_equal(surface(&r, 1)->base_color[0], 0.8f, 1e-6f);
    assert_float_equal(surface(&r, 2)->base_color[0], 0.6f, 1e-6f);
    assert_int_equal(r.scene.instances[3].material, r.scene.instances[4].material);
    assert_true(surface(&r, 4)->diffuse_roughness == 0 && surface(&r, 5)->diffuse_roughness > 0.2f);
    import_result_release(&r);
}

/* A parameter that is not read is named once, as the shape's or as the material's. */
static void test_unknown(void **state)
{
    struct import_result r;

    (void)state;
    version3("Material \"matte\" \"float odd\" 1 \"rgb Kd\" [.2 0 0] " TRIANGLE "\"float even\" 1 \"rgb Kd\" [.3 0 0]\n"
             TRIANGLE "\"float even\" 1\n" TRIANGLE, &r);
    assert_float_equal(surface(&r, 0)->base_color[0], 0.3f, 1e-6f);
    assert_float_equal(surface(&r, 1)->base_color[0], 0.2f, 1e-6f);
    assert_int_equal(r.scene.instances[1].material, r.scene.instances[2].material);
    pbrt_warned(&r, "a.pbrt:5: |shape \"trianglemesh\"|even\" is not known");
    pbrt_warned(&r, "a.pbrt:4: |material \"matte\"|odd\" is not known");
    assert_int_equal(r.warning_count, 2);
    import_result_release(&r);
    /* pbrt-v4 has no such thing. */
    pbrt_world(LAMP "Material \"diffuse\" \"rgb reflectance\" [.1 0 0] " TRIANGLE "\"rgb reflectance\" [.3 0 0]", &r);
    assert_float_equal(surface(&r, 0)->base_color[0], 0.1f, 1e-6f);
    pbrt_warned(&r, "shape \"trianglemesh\"|reflectance\" is not known");
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_own_values),
        cmocka_unit_test(test_mix),
        cmocka_unit_test(test_shared),
        cmocka_unit_test(test_unknown),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
