/* pbrt: materials, textures, spectra. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_spectrum.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"

static void assert_rgb(const float *got, float r, float g, float b)
{
    assert_floats(got, (const float[]){r, g, b}, 3, 1e-5f);
}

/* ---- materials ---------------------------------------------------------------------------- */

static void test_matte_kinds(void **state)
{
    static const struct {
        const char *directive;
        float color;
    } cases[] = {
        {"", 0.5f},
        {"Material \"diffuse\"", 0.5f},
        {"Material \"diffuse\" \"rgb reflectance\" [.2 .2 .2]", 0.2f},
        {"Material \"matte\" \"color Kd\" [.3 .3 .3]", 0.3f},
        {"Material \"diffuse\" \"spectrum reflectance\" [300 .4 900 .4]", 0.4f},
        {"MakeNamedMaterial \"m\" \"string type\" \"diffuse\" \"rgb reflectance\" [.1 .1 .1] "
         "NamedMaterial \"m\"", 0.1f},
        {"Attribute \"material\" \"rgb reflectance\" [.7 .7 .7] Material \"diffuse\"", 0.7f},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_result r;
        struct scene_material m = pbrt_material_of(cases[i].directive, &r);
        assert_int_equal(m.kind, MATERIAL_SURFACE);
        assert_rgb(m.base_color, cases[i].color, cases[i].color, cases[i].color);
        assert_true(m.metallic == 0 && m.specular == 0 && m.double_sided);
        assert_int_equal(r.warning_count, 0);
        import_result_release(&r);
    }
}

/* In pbrt-v3 a name means what it means where it is used, and only in its attribute block; in pbrt-v4 all files have one
 * of each. Each of the surfaces says which red it has. */
static void test_names_of_version3(void **state)
{
#define RED(value) "Texture \"t\" \"color\" \"constant\" \"rgb value\" [" #value " 0 0] "
#define NAMED(name) "MakeNamedMaterial \"" name "\" \"string type\" \"matte\" \"texture Kd\" \"t\" "
#define USE(name) "NamedMaterial \"" name "\" " TRIANGLE
    static const struct {
        const char *world;
        float red[3]; /* of the instances */
    } cases[] = {
        {RED(.1) NAMED("A") RED(.2) NAMED("B") RED(.3) USE("A") USE("B"), {0.1f, 0.2f}},
        {RED(.1) "Material \"matte\" \"texture Kd\" \"t\" " RED(.2) TRIANGLE, {0.1f}},
        {RED(.1) "AttributeBegin " RED(.2) NAMED("A") USE("A") "AttributeEnd " NAMED("A") USE("A"), {0.2f, 0.1f}},
        {RED(.1) NAMED("A") "AttributeBegin " RED(.2) NAMED("A") USE("A") "AttributeBegin " RED(.3) NAMED("A")
         "AttributeEnd " USE("A") "AttributeEnd " USE("A"), {0.2f, 0.2f, 0.1f}},
        {RED(.1) NAMED("A") "TransformBegin " RED(.2) NAMED("A") "TransformEnd " USE("A"), {0.2f}},
        {RED(.1) NAMED("A") "AttributeBegin " RED(.2) NAMED("A") "TransformBegin TransformEnd " USE("A") "AttributeEnd " USE("A"), {0.2f, 0.1f}},
    };
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[2048];
        snprintf(text, sizeof text, "Film \"image\" Camera \"perspective\" WorldBegin " LAMP "%s", cases[i].world);
        pbrt_whole(text, NULL, &r);
        for (size_t k = 0; k < 3 && cases[i].red[k] > 0; k++)
            if (fabsf(r.scene.materials[r.scene.instances[k].material].base_color[0] - cases[i].red[k]) > 1e-6f)
                fail_msg("case %zu: surface %zu", i, k);
        import_result_release(&r);
    }
    /* The parts of a mix, too. */
    pbrt_whole("Film \"image\" Camera \"perspective\" WorldBegin " LAMP RED(.1) NAMED("A") RED(.2)
                   NAMED("B") "MakeNamedMaterial \"M\" \"string type\" \"mix\" \"string namedmaterial1\" \"A\" "
                              "\"string namedmaterial2\" \"B\" " RED(.3) NAMED("A") NAMED("B") USE("M"),
               NULL, &r);
    for (int i = 0; i < 2; i++) {
        const struct scene_material *m = &r.scene.materials[r.scene.instances[0].material];
        assert_float_equal(r.scene.materials[m->mix_material[i]].base_color[0], i ? 0.2f : 0.1f, 1e-6f);
    }
    import_result_release(&r);
    /* What a block defined is unknown after it. */
    {
        struct error err = {0};
        const struct import_options options = IMPORT_OPTIONS_DEFAULT;
        const char *text = "Film \"image\" WorldBegin AttributeBegin " RED(.1) NAMED("A") "AttributeEnd " USE("A");
        assert_int_equal(import_scene_memory(text, strlen(text), "a.pbrt", NULL, &options, &r, &err), STATUS_ERR_INPUT);
        assert_says(&err, "\"A\" is not known");
    }
#undef RED
#undef NAMED
#undef USE
}

/* Oren and Nayar's A and B at 20 and 90 degrees: B / A is 0.29916 and 0.77670. */
static void test_matte_sigma(void **state)
{
    static const struct {
        const char *directive;
        float roughness;
    } cases[] = {
        {"Material \"matte\" \"float sigma\" 0", 0},
        {"Material \"matte\" \"float sigma\" 20", 0.29916f},
        {"Material \"matte\" \"float sigma\" 90", 0.77670f},
        {"Material \"matte\" \"float sigma\" 1000", 0.77670f},
        {"Material \"matte\" \"float sigma\" -5", 0},
        {"Texture \"s\" \"float\" \"constant\" \"float value\" 20 "
         "Material \"matte\" \"texture sigma\" \"s\"", 0.29916f},
    };
    struct import_result r;
    struct scene_material m;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        m = pbrt_material_of(cases[i].directive, &r);
        assert_float_equal(m.diffuse_roughness, cases[i].roughness, 2e-5f);
        assert_true(m.metallic == 0 && m.specular == 0 && m.diffuse_roughness_texture.texture < 0);
        assert_int_equal(r.warning_count, 0);
        import_result_release(&r);
    }
    m = pbrt_material_of("Texture \"s\" \"float\" \"checkerboard\" \"float tex1\" 20 "
                         "\"float tex2\" 0 Material \"matte\" \"texture sigma\" \"s\"", &r);
    assert_true(m.diffuse_roughness == 1 && m.diffuse_roughness_texture.texture >= 0);
    import_result_release(&r);
}

static void test_coated_diffuse(void **state)
{
    struct import_result r;
    struct scene_material m =
        pbrt_material_of("Material \"coateddiffuse\" \"rgb reflectance\" [.1 .2 .3] \"float roughness\" .0625", &r);

    (void)state;
    assert_rgb(m.base_color, 0.1f, 0.2f, 0.3f);
    assert_true(m.ior == 1.5f && m.specular == 1 && m.metallic == 0);
    assert_float_equal(m.roughness, 0.5f, 1e-6f); /* alpha = sqrt(.0625) */
    /* Egan and Hilgeman: 0.5963 for an index of 1.5. */
    assert_float_equal(m.base_interreflection, 0.5963f, 2e-4f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"coateddiffuse\" \"float roughness\" .25 "
                         "\"bool remaproughness\" false \"float eta\" 1 \"rgb albedo\" [1 1 1] "
                         "\"float thickness\" 2 \"integer maxdepth\" 5", &r);
    assert_float_equal(m.roughness, 0.5f, 1e-6f); /* alpha itself */
    assert_true(m.base_interreflection == 0 && m.ior == 1);
    pbrt_warned(&r, "a.pbrt:|albedo");
    import_result_release(&r);
}

/* Reflectances at normal incidence: of the metals those that physicallybased.info lists (gold's
 * red lies outside of Rec. 709), of the clear oxides ((n - 1) / (n + 1))^2. */
static void test_named_metals(void **state)
{
    static const struct {
        const char *name;
        double rgb[3];
    } metals[] = {
        {"Ag", {0.97, 0.96, 0.92}},   {"Al", {0.91, 0.92, 0.92}},   {"Au", {1.00, 0.78, 0.35}},
        {"Cu", {0.95, 0.64, 0.54}},   {"CuZn", {0.91, 0.78, 0.42}}, {"MgO", {0.072, 0.073, 0.075}},
        {"TiO2", {0.23, 0.24, 0.27}},
    };

    (void)state;
    for (size_t i = 0; i < sizeof metals / sizeof *metals; i++) {
        char text[256];
        struct import_result r;
        struct scene_material m;
        snprintf(text, sizeof text,
                 "Material \"conductor\" \"spectrum eta\" \"metal-%s-eta\" \"spectrum k\" "
                 "\"metal-%s-k\"",
                 metals[i].name, metals[i].name);
        m = pbrt_material_of(text, &r);
        assert_int_equal(m.kind, MATERIAL_CONDUCTOR);
        assert_true(m.roughness == 0);
        for (int c = 0; c < 3; c++)
            assert_true(fabs(conductor_normal_reflectance((double)m.conductor_eta[c], (double)m.conductor_k[c]) -
                             metals[i].rgb[c]) < 0.01);
        import_result_release(&r);
    }
}

static void test_conductors(void **state)
{
    struct import_result r;
    struct scene_material m =
        pbrt_material_of("Material \"conductor\" \"rgb eta\" [.2 .9 1.1] \"rgb k\" [3.9 2.4 2.1]", &r);

    (void)state;
    assert_rgb(m.conductor_eta, 0.2f, 0.9f, 1.1f);
    assert_rgb(m.conductor_k, 3.9f, 2.4f, 2.1f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"conductor\" \"rgb reflectance\" [.25 .5 .75]", &r);
    for (int c = 0; c < 3; c++)
        assert_true(fabs(conductor_normal_reflectance((double)m.conductor_eta[c], (double)m.conductor_k[c]) -
                         0.25 * (c + 1)) < 1e-4);
    import_result_release(&r);
    /* Below a coat the metal is seen from the coat's index. */
    m = pbrt_material_of("Material \"coatedconductor\" \"rgb conductor.eta\" [1.5 3 .3] "
                         "\"rgb conductor.k\" [3 1.5 6] \"float interface.roughness\" .0001 "
                         "\"float conductor.roughness\" .0625", &r);
    assert_int_equal(m.kind, MATERIAL_CONDUCTOR);
    assert_rgb(m.conductor_eta, 1, 2, 0.2f);
    assert_rgb(m.conductor_k, 2, 1, 4);
    assert_true(m.clearcoat == 1 && m.clearcoat_ior == 1.5f);
    assert_float_equal(m.clearcoat_roughness, 0.1f, 1e-6f);
    assert_float_equal(m.base_interreflection, 0.04f, 1e-6f);
    assert_float_equal(m.roughness, 0.5f, 1e-6f);
    import_result_release(&r);
}

static void test_dielectrics(void **state)
{
    struct import_result r;
    struct scene_material m = pbrt_material_of("Material \"dielectric\" \"float eta\" 1.33", &r);

    (void)state;
    assert_true(m.transmission == 1 && m.refractive && m.ior == 1.33f && m.roughness == 0);
    assert_rgb(m.base_color, 1, 1, 1);
    assert_true(m.dispersion == 0);
    import_result_release(&r);
    m = pbrt_material_of("Material \"dielectric\" \"spectrum eta\" \"glass-BK7\"", &r);
    assert_float_equal(m.ior, 1.5168f, 1e-4f);
    assert_float_equal(m.dispersion, 20 / 64.17f, 1e-3f);
    import_result_release(&r);
    /* The same from a table: BK7's index at F, d and C. */
    m = pbrt_material_of("Material \"dielectric\" \"spectrum eta\" [486.13 1.52238 587.56 1.51680 "
                         "656.27 1.51432]", &r);
    assert_float_equal(m.ior, 1.5168f, 1e-5f);
    assert_float_equal(m.dispersion, 20 / 64.17f, 2e-3f);
    import_result_release(&r);
    /* Ice in water: below 1 is as good as above. */
    m = pbrt_material_of("Material \"dielectric\" \"float eta\" .763", &r);
    assert_true(m.ior == 0.763f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    m = pbrt_material_of("Material \"thindielectric\" \"float eta\" .8", &r);
    assert_true(m.ior == 1);
    pbrt_warned(&r, "index of refraction of 0.8");
    import_result_release(&r);
    m = pbrt_material_of("Material \"thindielectric\"", &r);
    assert_true(m.transmission == 1 && !m.refractive && m.thin_slab && m.ior == 1.5f);
    import_result_release(&r);
    /* u rougher than v: the direction is u, alpha along it .5, across .04. */
    m = pbrt_material_of("Material \"dielectric\" \"float uroughness\" .5 \"float vroughness\" .04 "
                         "\"bool remaproughness\" false", &r);
    assert_float_equal(m.roughness, 0.2f, 1e-6f);
    assert_float_equal(0.04f + (1 - 0.04f) * m.anisotropy * m.anisotropy, 0.5f, 1e-5f);
    assert_true(m.anisotropy_rotation_rad == 0);
    assert_true(r.scene.meshes[0].arrays & MESH_TANGENTS);
    import_result_release(&r);
    m = pbrt_material_of("Material \"dielectric\" \"float uroughness\" .04 \"float vroughness\" .5 "
                         "\"bool remaproughness\" false", &r);
    assert_float_equal(m.anisotropy_rotation_rad, 1.5707964f, 1e-6f);
    import_result_release(&r);
}

static void test_diffuse_transmission(void **state)
{
    struct import_result r;
    struct scene_material m = pbrt_material_of("Material \"diffusetransmission\" \"rgb reflectance\" [.3 .2 .1] "
                                               "\"rgb transmittance\" [.1 .05 .1]",
                                               &r);
    const float w = m.diffuse_transmission;

    (void)state;
    for (int c = 0; c < 3; c++) {
        const float reflected[3] = {0.3f, 0.2f, 0.1f}, through[3] = {0.1f, 0.05f, 0.1f};
        assert_float_equal((1 - w) * m.base_color[c], reflected[c], 1e-6f);
        assert_float_equal(w * m.diffuse_transmission_color[c], through[c], 1e-6f);
    }
    import_result_release(&r);
    m = pbrt_material_of("Material \"diffusetransmission\" \"rgb reflectance\" [.9 .9 .9] "
                         "\"rgb transmittance\" [.9 .9 .9]", &r);
    pbrt_warned(&r, "more light than falls on it");
    import_result_release(&r);
}

#define TWO "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" " \
            "MakeNamedMaterial \"b\" \"string type\" \"conductor\" "

static void test_mix(void **state)
{
    struct import_result r;
    struct scene_material m =
        pbrt_material_of(TWO "Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .25", &r);

    (void)state;
    assert_int_equal(m.kind, MATERIAL_MIX);
    assert_true(m.mix_amount == 0.25f); /* of the second */
    assert_int_equal(r.scene.materials[m.mix_material[0]].kind, MATERIAL_SURFACE);
    assert_int_equal(r.scene.materials[m.mix_material[1]].kind, MATERIAL_CONDUCTOR);
    import_result_release(&r);
    m = pbrt_material_of(TWO "Texture \"t\" \"float\" \"checkerboard\" \"float uscale\" 4 "
                             "\"float vscale\" 2 "
                             "Material \"mix\" \"string materials\" [\"a\" \"b\"] "
                             "\"texture amount\" \"t\"", &r);
    assert_true(m.mix_amount == 1 && m.mix_texture.texture == 0);
    assert_true(r.scene.textures[0].nearest);
    assert_floats(&m.mix_texture.uv_transform[0][0], (const float[]){2, 0, 0, 0, -1, 1}, 6, 0);
    assert_true(r.scene.meshes[0].arrays & MESH_UV0); /* pbrt's default ones */
    import_result_release(&r);
    /* pbrt-v3: the share of the first. */
    m = pbrt_material_of(TWO "Material \"mix\" \"string namedmaterial1\" \"a\" "
                             "\"string namedmaterial2\" \"b\" \"color amount\" [.25 .25 .25]", &r);
    assert_true(m.mix_amount == 0.75f);
    import_result_release(&r);
    pbrt_refused("WorldBegin MakeNamedMaterial \"a\" \"string type\" \"mix\" "
                 "\"string materials\" [\"b\" \"b\"] "
                 "MakeNamedMaterial \"b\" \"string type\" \"mix\" "
                 "\"string materials\" [\"a\" \"a\"] NamedMaterial \"a\" " TRIANGLE,
                 "mixed more than");
}

/* The amount is a colour in pbrt-v3, and the share of the first: 1 - (.2 + .4 + .9) / 3. */
static void test_mix_by_color(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "MakeNamedMaterial \"a\" \"string type\" \"matte\" Material \"mix\" \"string namedmaterial1\" \"a\" "
                    "\"string namedmaterial2\" \"a\" \"rgb amount\" [.2 .4 .9] " TRIANGLE, &r);
    assert_float_equal(r.scene.materials[r.scene.instances[0].material].mix_amount, 0.5f, 1e-6f);
    pbrt_warned(&r, "a.pbrt:4: |mix by a colour");
    import_result_release(&r);
    pbrt_world(LAMP "MakeNamedMaterial \"a\" \"string type\" \"matte\" Material \"mix\" \"string namedmaterial1\" \"a\" "
                    "\"string namedmaterial2\" \"a\" \"rgb amount\" [.2 .2 .2] " TRIANGLE, &r);
    assert_float_equal(r.scene.materials[r.scene.instances[0].material].mix_amount, 0.8f, 1e-6f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

static void test_version_3(void **state)
{
    struct import_result r;
    struct scene_material m = pbrt_material_of("Material \"plastic\" \"color Kd\" [.1 .1 .1] \"color Ks\" [.5 .25 .5] "
                                               "\"float roughness\" .1",
                                               &r);

    (void)state;
    assert_rgb(m.base_color, 0.1f, 0.1f, 0.1f);
    assert_true(m.specular == 0.5f && m.ior == 1.5f);
    assert_rgb(m.specular_color, 1, 0.5f, 1);
    /* RoughnessToAlpha(.1), by hand */
    assert_float_equal(m.roughness * m.roughness, 0.4618f, 1e-3f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"mirror\"", &r);
    assert_true(m.metallic == 1 && m.roughness == 0 && m.ior == 0);
    assert_rgb(m.base_color, 0.9f, 0.9f, 0.9f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"glass\" \"float index\" 1.3 \"rgb Kt\" [.5 .6 .7]", &r);
    assert_true(m.transmission == 1 && m.refractive && m.ior == 1.3f && m.roughness == 0);
    assert_rgb(m.base_color, 0.5f, 0.6f, 0.7f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"metal\"", &r);
    assert_int_equal(m.kind, MATERIAL_CONDUCTOR);
    assert_true(m.conductor_k[0] > m.conductor_k[2]); /* copper */
    import_result_release(&r);
    m = pbrt_material_of("Material \"substrate\" \"rgb Ks\" [.08 .04 .02]", &r);
    assert_rgb(m.specular_color, 2, 1, 0.5f); /* times 0.04 at normal incidence */
    import_result_release(&r);
    m = pbrt_material_of("Material \"uber\" \"rgb opacity\" [.25 .25 .25] \"rgb Kr\" [1 1 1]", &r);
    assert_int_equal(m.alpha_mode, ALPHA_BLEND);
    assert_true(m.base_color[3] == 0.25f);
    pbrt_warned(&r, "\"Kr\" of \"uber\"");
    import_result_release(&r);
    m = pbrt_material_of("Material \"disney\" \"color color\" [.2 .4 .6] \"float metallic\" .5 "
                         "\"float roughness\" .3 \"float clearcoat\" 1", &r);
    assert_true(m.metallic == 0.5f && m.roughness == 0.3f && m.clearcoat == 0.25f);
    import_result_release(&r);
}

/* pbrt-v3's remapping takes 0 as 0.001, an alpha of 0.04727 (microfacet.h); glass alone is smooth. */
static void test_version_3_smooth(void **state)
{
    struct import_result r;
    struct scene_material m = pbrt_material_of("Material \"metal\" \"float roughness\" 0", &r);

    (void)state;
    assert_float_equal(m.roughness, 0.21742f, 1e-4f);
    import_result_release(&r);
    m = pbrt_material_of("Material \"metal\" \"float roughness\" 0 \"bool remaproughness\" \"false\"", &r);
    assert_true(m.roughness == 0);
    import_result_release(&r);
    m = pbrt_material_of("Material \"glass\" \"float uroughness\" 0 \"float vroughness\" 0", &r);
    assert_true(m.roughness == 0);
    import_result_release(&r);
    m = pbrt_material_of("Material \"conductor\" \"float roughness\" 0", &r);
    assert_true(m.roughness == 0);
    import_result_release(&r);
}

/* Glass and substrate have two roughnesses only, and "eta" counts before "index" (glass.cpp, substrate.cpp). */
static void test_version_3_names(void **state)
{
    struct import_result r;
    struct scene_material m = pbrt_material_of("Material \"glass\" \"float roughness\" .5 \"float index\" 1.3 \"float eta\" 1.4", &r);

    (void)state;
    assert_true(m.roughness == 0 && m.ior == 1.4f);
    pbrt_warned(&r, "glass|roughness\" is not known");
    import_result_release(&r);
    m = pbrt_material_of("Material \"uber\" \"float index\" 1.3 \"float eta\" 1.4 \"float uroughness\" .25 "
                         "\"bool remaproughness\" \"false\"", &r);
    assert_true(m.ior == 1.4f && m.roughness == 0.5f && m.anisotropy == 0); /* vroughness is uroughness */
    import_result_release(&r);
    m = pbrt_material_of("Material \"substrate\" \"float uroughness\" .25 \"float vroughness\" .25 \"float roughness\" .9 "
                         "\"bool remaproughness\" \"false\"", &r);
    assert_float_equal(m.roughness, 0.5f, 1e-6f);
    pbrt_warned(&r, "substrate|roughness\" is not known");
    import_result_release(&r);
}

static void test_refused_kinds(void **state)
{
    static const char *const kinds[] = {"measured", "subsurface", "hair", "fourier", "odd"};

    (void)state;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        char text[128], words[128];
        struct import_result r;
        struct scene_material m;
        snprintf(text, sizeof text, "\nMaterial \"%s\" \"float anything\" 3", kinds[i]);
        snprintf(words, sizeof words, "a.pbrt:5: |\"%s\" is not supported|grey", kinds[i]);
        m = pbrt_material_of(text, &r);
        pbrt_warned(&r, words);
        assert_rgb(m.base_color, 0.5f, 0.5f, 0.5f);
        import_result_release(&r);
    }
}

static void test_alpha(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "Shape \"sphere\" \"float alpha\" .5 Shape \"sphere\" \"float alpha\" 1", &r);
    assert_int_equal(r.scene.materials[r.scene.instances[0].material].alpha_mode, ALPHA_BLEND);
    assert_true(r.scene.materials[r.scene.instances[0].material].base_color[3] == 0.5f);
    assert_int_equal(r.scene.materials[r.scene.instances[1].material].alpha_mode, ALPHA_OPAQUE);
    import_result_release(&r);
    /* A material that lets light through, of a shape that does, too: the product. */
    pbrt_world(LAMP "Material \"uber\" \"rgb opacity\" [.5 .5 .5] Shape \"sphere\" \"float alpha\" .25 Shape \"sphere\"", &r);
    assert_true(r.scene.materials[r.scene.instances[0].material].base_color[3] == 0.125f);
    assert_true(r.scene.materials[r.scene.instances[1].material].base_color[3] == 0.5f);
    import_result_release(&r);
}

/* ---- textures ----------------------------------------------------------------------------- */

static const uint8_t *image_blob(const struct import_result *r, uint32_t texture, size_t *size)
{
    const struct digest *d = &r->scene.images[r->scene.textures[texture].image].blob.digest;

    for (size_t i = 0; i < r->blob_count; i++)
        if (digest_equal(&r->blobs[i].digest, d)) {
            *size = r->blobs[i].size_bytes;
            return r->blobs[i].data;
        }
    fail_msg("the picture is missing");
    return NULL;
}

/* Texel of a computed PNG as 0..1. */
static float texel_of(const struct import_result *r, uint32_t texture, uint32_t x, uint32_t y, uint32_t channel)
{
    struct image8 image;
    struct error err = {0};
    size_t size = 0, at;
    const uint8_t *data = image_blob(r, texture, &size);
    uint16_t wide;
    float value;

    if (image_decode_8(&image, data, size, "texture", &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_true(x < image.width && y < image.height && channel < image.channels);
    at = ((size_t)y * image.width + x) * image.channels + channel;
    if (image.bits == 16) {
        memcpy(&wide, image.pixels + 2 * at, sizeof wide);
        value = (float)wide / 65535;
    } else {
        value = (float)image.pixels[at] / 255;
    }
    image8_release(&image);
    return value;
}

/* A TGA of 2x2: red and green at the top, blue and white below; stored from the bottom. */
static const uint8_t four_colors[18 + 12] = {
    0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0,
    255, 0, 0, 255, 255, 255, 0, 0, 255, 0, 255, 0};

static struct scene_material material_with_image(const char *text, struct import_result *r)
{
    char *folder = pbrt_folder_make();
    struct buffer all = BUFFER_INIT;

    pbrt_folder_put(folder, "t.tga", four_colors, sizeof four_colors);
    buffer_printf(&all, RIGHT_HANDED "WorldBegin\n" LAMP "%s\n" TRIANGLE, text);
    pbrt_whole(buffer_text(&all), folder, r);
    buffer_release(&all);
    pbrt_folder_remove(folder);
    return r->scene.materials[r->scene.instances[0].material];
}

#define IMAGE "\"imagemap\" \"string filename\" \"t.tga\" "

static void test_image_texture(void **state)
{
    struct import_result r;
    struct scene_material m = material_with_image(
        "Texture \"t\" \"spectrum\" " IMAGE "\"float uscale\" 3 \"float vscale\" 2 "
        "\"float udelta\" .25 \"float vdelta\" .5 \"string wrap\" \"clamp\" "
        "\"string filter\" \"point\" \"float scale\" .5 "
        "Material \"diffuse\" \"texture reflectance\" \"t\"", &r);
    const struct scene_texture *t = &r.scene.textures[0];

    (void)state;
    assert_rgb(m.base_color, 0.5f, 0.5f, 0.5f);
    assert_int_equal(m.base_color_texture.texture, 0);
    /* v downwards: 1 - (2 v + .5) */
    assert_floats(&m.base_color_texture.uv_transform[0][0], (const float[]){3, 0, 0.25f, 0, -2, 0.5f}, 6, 1e-6f);
    assert_true(t->nearest && t->wrap_u == WRAP_CLAMP && t->wrap_v == WRAP_CLAMP);
    assert_int_equal(t->encoding, ENCODING_SRGB);
    assert_true(texel_of(&r, 0, 0, 0, 0) == 1 && texel_of(&r, 0, 0, 0, 1) == 0); /* red */
    assert_true(texel_of(&r, 0, 1, 0, 1) == 1 && texel_of(&r, 0, 1, 0, 0) == 0); /* green */
    assert_true(texel_of(&r, 0, 0, 1, 2) == 1 && texel_of(&r, 0, 0, 1, 0) == 0); /* blue */
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    m = material_with_image("Texture \"t\" \"spectrum\" " IMAGE "\"string encoding\" \"linear\" "
                            "Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"t\" "
                            "\"float scale\" .25 Texture \"u\" \"spectrum\" \"scale\" "
                            "\"texture tex\" \"s\" \"float scale\" .5 "
                            "Material \"diffuse\" \"texture reflectance\" \"u\"", &r);
    assert_rgb(m.base_color, 0.125f, 0.125f, 0.125f); /* folded into the factor */
    assert_int_equal(r.scene.textures[0].encoding, ENCODING_LINEAR);
    import_result_release(&r);
}

static void test_computed_textures(void **state)
{
    struct import_result r;
    struct scene_material m = material_with_image(
        "Texture \"t\" \"spectrum\" " IMAGE "\"string filter\" \"point\" \"bool invert\" true "
        "Material \"diffuse\" \"texture reflectance\" \"t\"", &r);

    (void)state;
    assert_true(texel_of(&r, 0, 0, 0, 0) == 0 && texel_of(&r, 0, 0, 0, 1) == 1); /* cyan */
    assert_true(texel_of(&r, 0, 1, 1, 0) == 0);                                  /* black for white */
    assert_floats(&m.base_color_texture.uv_transform[0][0], (const float[]){1, 0, 0, 0, -1, 1}, 6, 0);
    import_result_release(&r);
    /* A mix of a picture and a colour: half of each, in linear light. */
    m = material_with_image("Texture \"t\" \"spectrum\" " IMAGE "\"string filter\" \"point\" "
                            "Texture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"t\" \"rgb tex2\" [0 0 0] "
                            "\"float amount\" .5 Material \"diffuse\" \"texture reflectance\" \"m\"",
                            &r);
    assert_rgb(m.base_color, 1, 1, 1);
    assert_float_equal(texel_of(&r, 0, 0, 0, 0), 0.7353569f, 1e-4f); /* sRGB of 0.5 */
    import_result_release(&r);
    m = material_with_image("Texture \"c\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [1 0 0] \"rgb tex2\" [0 0 1] "
                            "Material \"diffuse\" \"texture reflectance\" \"c\"",
                            &r);
    /* The field around (0, 0) is tex1: the bottom left of the picture. */
    assert_true(texel_of(&r, 0, 0, 1, 0) == 1 && texel_of(&r, 0, 0, 0, 2) == 1);
    assert_true(texel_of(&r, 0, 1, 0, 0) == 1 && texel_of(&r, 0, 1, 1, 2) == 1);
    assert_floats(&m.base_color_texture.uv_transform[0][0], (const float[]){0.5f, 0, 0, 0, -0.5f, 1}, 6, 0);
    import_result_release(&r);
    m = material_with_image("Texture \"c\" \"float\" \"mix\" \"float tex1\" .2 \"float tex2\" .6 \"float amount\" .5 "
                            "Material \"dielectric\" \"texture roughness\" \"c\" \"bool remaproughness\" false",
                            &r);
    assert_float_equal(m.roughness, 0.6324555f, 1e-6f); /* constants fold: sqrt(.4) */
    assert_int_equal(r.scene.texture_count, 0);
    import_result_release(&r);
}

/* Red is the fraction of s, green that of t: the picture is one period of both. */
static void test_uv_texture(void **state)
{
    struct import_result r;
    struct scene_material m = material_with_image("Texture \"u\" \"color\" \"uv\" \"float uscale\" 2 \"float vdelta\" .5 "
                                                  "Material \"matte\" \"texture Kd\" \"u\"", &r);

    (void)state;
    assert_floats(&m.base_color_texture.uv_transform[0][0], (const float[]){2, 0, 0, 0, -1, 0.5f}, 6, 0);
    for (uint32_t i = 1; i < 256; i += 100) {
        const float fraction = ((float)i + 0.5f) / 256;
        assert_float_equal(srgb_decode(texel_of(&r, 0, i, 3, 0)), fraction, 1e-4f);
        assert_float_equal(srgb_decode(texel_of(&r, 0, 3, 255 - i, 1)), fraction, 1e-4f);
        assert_true(texel_of(&r, 0, i, i, 2) == 0);
    }
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

/* Four fields along s, three along t. The noise of the field around (1, 2) is 0.375, its dot lies at (1.1132, 2.0119) with a radius of
 * 0.35; around (1, 1) it is -0.25, around (1, 0) 0: no dots. */
static void test_dots_texture(void **state)
{
    static const struct {
        double s, t;
        int inside;
    } places[] = {{1.1, 2, 1}, {1.45, 2, 1}, {1.48, 2, 0}, {0.78, 2, 1}, {0.74, 2, 0}, {1.1, 2.35, 1}, {1.1, 2.38, 0}, {1.1, 1.67, 1},
                  {1.1, 1.64, 0}, {1, 1, 0}, {1, 0.1, 0}, {0, 0.9, 1}};
    struct import_result r;
    struct scene_material m =
        material_with_image("Texture \"d\" \"spectrum\" \"dots\" \"rgb inside\" [1 0 0] \"rgb outside\" [0 0 1] "
                            "\"float uscale\" 4 \"float vscale\" 3 Material \"diffuse\" \"texture reflectance\" \"d\"", &r);

    (void)state;
    assert_floats(&m.base_color_texture.uv_transform[0][0], (const float[]){1, 0, 0, 0, -1, 1}, 6, 0);
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        uint32_t x = (uint32_t)(places[i].s / 4 * 256), y = (uint32_t)((3 - places[i].t) / 3 * 256);
        if (texel_of(&r, 0, x, y, 0) != (float)places[i].inside || texel_of(&r, 0, x, y, 2) != (float)!places[i].inside)
            fail_msg("(%g, %g) is not %s a dot", places[i].s, places[i].t, places[i].inside ? "in" : "outside of");
    }
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    /* A column of fields: those around (0, 1), (0, 2), (0, 3), (0, 11) ... have dots, by a program of nested interpolations. */
    (void)material_with_image("Texture \"d\" \"spectrum\" \"dots\" \"float uscale\" .1 \"float vscale\" 32 "
                              "Material \"diffuse\" \"texture reflectance\" \"d\"", &r);
    for (uint32_t t = 1; t < 32; t++)
        assert_true(texel_of(&r, 0, 128, (32 - t) * 64, 0) == (float)(2165098510u >> t & 1));
    import_result_release(&r);
    /* Dots of dots are as costly as they are. */
    {
        struct buffer text = BUFFER_INIT;
        buffer_puts(&text, "WorldBegin Texture \"0\" \"float\" \"dots\" ");
        for (int i = 1; i < 12; i++)
            buffer_printf(&text, "Texture \"%d\" \"float\" \"dots\" \"texture inside\" \"%d\" ", i, i - 1);
        pbrt_refused(buffer_text(&text), "built of one another");
        buffer_release(&text);
    }
    /* As a mask, and many of them: a field has at least some texels. */
    m = material_with_image("Texture \"d\" \"float\" \"dots\" \"float uscale\" 40 \"float vscale\" 1 "
                            "Material \"coateddiffuse\" \"texture roughness\" \"d\" \"bool remaproughness\" false", &r);
    assert_true(m.metallic_roughness_texture.texture == 0 && texel_of(&r, 0, 2047, 255, 1) >= 0);
    import_result_release(&r);
}

static void test_roughness_texture(void **state)
{
    struct import_result r;
    struct scene_material m = material_with_image(
        "Texture \"t\" \"float\" " IMAGE "\"string filter\" \"point\" \"string encoding\" "
        "\"linear\" Material \"coateddiffuse\" \"texture roughness\" \"t\"", &r);

    (void)state;
    assert_true(m.roughness == 1 && m.metallic_roughness_texture.texture == 0);
    assert_int_equal(r.scene.textures[0].encoding, ENCODING_LINEAR);
    /* The mean of red, a third; alpha its root, roughness the root of that. */
    assert_float_equal(texel_of(&r, 0, 0, 0, 1), 0.7598357f, 1e-4f);
    assert_true(texel_of(&r, 0, 1, 1, 1) == 1);
    import_result_release(&r);
}

static void test_alpha_texture(void **state)
{
    char *folder = pbrt_folder_make();
    struct import_result r;
    const struct scene_material *m;

    (void)state;
    pbrt_folder_put(folder, "t.tga", four_colors, sizeof four_colors);
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Texture \"a\" \"float\" " IMAGE "\"string filter\" \"point\" "
                            "\"string encoding\" \"linear\" "
                            "Material \"diffuse\" \"rgb reflectance\" [.1 .2 .3] "
                            "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0] "
                            "\"texture alpha\" \"a\"",
               folder, &r);
    pbrt_folder_remove(folder);
    m = &r.scene.materials[r.scene.instances[0].material];
    assert_int_equal(m->alpha_mode, ALPHA_BLEND);
    assert_rgb(m->base_color, 0.1f, 0.2f, 0.3f);
    assert_float_equal(texel_of(&r, 0, 0, 0, 3), 1.0f / 3, 1e-4f);
    assert_true(texel_of(&r, 0, 1, 1, 3) == 1 && texel_of(&r, 0, 0, 0, 0) == 1);
    import_result_release(&r);
    /* The material's opacity is a factor. */
    folder = pbrt_folder_make();
    pbrt_folder_put(folder, "t.tga", four_colors, sizeof four_colors);
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Texture \"a\" \"float\" " IMAGE "\"string filter\" \"point\" "
                            "\"string encoding\" \"linear\" "
                            "Material \"uber\" \"rgb Kd\" [.1 .2 .3] \"rgb opacity\" [.5 .5 .5] "
                            "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0] "
                            "\"texture alpha\" \"a\"",
               folder, &r);
    pbrt_folder_remove(folder);
    assert_float_equal(texel_of(&r, 0, 0, 0, 3), 0.5f / 3, 1.0f / 255);
    assert_float_equal(texel_of(&r, 0, 1, 1, 3), 0.5f, 1.0f / 255);
    import_result_release(&r);
}

static void version3_with_image(const char *text, struct import_result *r)
{
    char *folder = pbrt_folder_make();
    struct buffer all = BUFFER_INIT;

    pbrt_folder_put(folder, "t.tga", four_colors, sizeof four_colors);
    buffer_printf(&all, "Film \"image\" " RIGHT_HANDED "WorldBegin " LAMP "%s", text);
    pbrt_whole(buffer_text(&all), folder, r);
    buffer_release(&all);
    pbrt_folder_remove(folder);
}

/* pbrt-v3's number of a colour is its luminance before it is decoded (imagemap.h): red is 0.212671, 0.037191 in linear light, green
 * 0.715160 and 0.470; alpha their roots. */
static void test_numbers_of_version3(void **state)
{
    struct import_result r;

    (void)state;
    version3_with_image("Texture \"t\" \"float\" " IMAGE "Material \"plastic\" \"texture roughness\" \"t\" "
                        "\"bool remaproughness\" \"false\" " TRIANGLE, &r);
    assert_float_equal(texel_of(&r, 0, 0, 0, 1), 0.19285f, 1e-4f);
    import_result_release(&r);
    version3_with_image("Texture \"t\" \"float\" " IMAGE "\"bool gamma\" \"false\" Material \"plastic\" \"texture roughness\" \"t\" "
                        "\"bool remaproughness\" \"false\" " TRIANGLE, &r);
    assert_float_equal(texel_of(&r, 0, 0, 0, 1), 0.46116f, 1e-4f);
    import_result_release(&r);
}

/* pbrt-v3's alpha is a mask, of meshes alone: 0 is nothing, all else opaque. */
static void test_alpha_of_version3(void **state)
{
    struct import_result r;
    const struct scene_material *m;

    (void)state;
    version3_with_image("Texture \"t\" \"float\" " IMAGE "\"string filter\" \"point\" Texture \"a\" \"float\" \"checkerboard\" \"texture tex1\" \"t\" "
                        "\"float uscale\" 2 \"float vscale\" 2 "
                        TRIANGLE "\"texture alpha\" \"a\" " TRIANGLE "\"float alpha\" .25 " TRIANGLE "\"float alpha\" 0 "
                        TRIANGLE "\"texture alpha\" \"a\" Shape \"sphere\" \"float alpha\" .25", &r);
    m = &r.scene.materials[r.scene.instances[0].material];
    assert_int_equal(m->alpha_mode, ALPHA_BLEND);
    /* The lower left field is blue, of luminance 0.07; that beside it 0. */
    assert_true(texel_of(&r, 0, 0, 1, 3) == 1 && texel_of(&r, 0, 1, 1, 3) == 0);
    assert_int_equal(r.scene.materials[r.scene.instances[1].material].alpha_mode, ALPHA_OPAQUE);
    assert_true(r.scene.materials[r.scene.instances[2].material].base_color[3] == 0);
    assert_int_equal(r.scene.instances[3].material, r.scene.instances[0].material);
    assert_int_equal(r.scene.materials[r.scene.instances[4].material].alpha_mode, ALPHA_OPAQUE);
    pbrt_warned(&r, "shape \"sphere\"|alpha\" is not known");
    import_result_release(&r);
}

static void test_normal_map(void **state)
{
    struct import_result r;
    struct scene_material m =
        material_with_image("Material \"diffuse\" \"string normalmap\" \"t.tga\" \"texture displacement\" \"x\"", &r);

    (void)state;
    assert_int_equal(m.normal_texture.texture, 0);
    assert_int_equal(r.scene.textures[0].encoding, ENCODING_LINEAR);
    assert_true(r.scene.meshes[0].arrays & MESH_TANGENTS);
    pbrt_warned(&r, "displacement");
    import_result_release(&r);
}

static void test_texture_faults(void **state)
{
    char *folder = pbrt_folder_make();
    struct import_result r;

    (void)state;
    pbrt_folder_put(folder, "t.xyz", "nothing that anybody knows", 26);
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Texture \"t\" \"spectrum\" \"imagemap\" "
               "\"string filename\" \"t.xyz\" Texture \"w\" \"float\" \"wrinkled\" "
               "\"integer octaves\" 3 Texture \"p\" \"spectrum\" \"imagemap\" "
               "\"string filename\" \"t.xyz\" \"string mapping\" \"planar\" \"vector3 v1\" [1 0 0] "
               "Material \"diffuse\" \"texture reflectance\" \"t\" " TRIANGLE, folder, &r);
    pbrt_warned(&r, "a.pbrt:|t.xyz|not read");
    pbrt_warned(&r, "\"wrinkled\" is not supported");
    pbrt_warned(&r, "\"planar\" is not supported");
    import_result_release(&r);
    pbrt_folder_remove(folder);
    pbrt_refused("WorldBegin Material \"diffuse\" \"texture reflectance\" \"gone\" " TRIANGLE,
                 "a.pbrt:1: |\"gone\" is not known");
    /* A bomb of textures of textures. */
    {
        struct buffer text = BUFFER_INIT;
        buffer_puts(&text, "WorldBegin Texture \"0\" \"float\" \"checkerboard\" ");
        for (int i = 1; i < 40; i++)
            buffer_printf(&text, "Texture \"%d\" \"float\" \"mix\" \"texture tex1\" \"%d\" "
                                 "\"texture tex2\" \"%d\" ", i, i - 1, i - 1);
        pbrt_refused(buffer_text(&text), "built of one another");
        buffer_release(&text);
    }
}

/* ---- spectra ------------------------------------------------------------------------------ */

static void test_spectra(void **state)
{
    static const double table[] = {380, 0.25, 780, 0.25};
    const struct spectrum flat = {table, 2, 1};
    double rgb[3], luminance;

    (void)state;
    spectrum_reflectance(&flat, rgb);
    for (int i = 0; i < 3; i++)
        assert_true(fabs(rgb[i] - 0.25) < 1e-12);
    assert_true(fabs(spectrum_luminance(&flat) - 0.25) < 1e-12);
    /* CIE illuminant A is a black body of 2856 K: x = 0.4476, y = 0.4074. */
    spectrum_blackbody(2856, rgb);
    luminance = 0.2126729 * rgb[0] + 0.7151522 * rgb[1] + 0.0721750 * rgb[2];
    assert_true(fabs(luminance - 1) < 1e-9);
    {
        double wanted[3];
        chromaticity_to_rgb(0.44758, 0.40745, wanted);
        for (int i = 0; i < 3; i++)
            assert_true(fabs(rgb[i] - wanted[i]) < 0.01);
    }
    /* Planck's law over its largest value, weighed by CIE y: a visible third at 3000 K, nearly all in the middle at 5600 K. */
    assert_true(fabs(spectrum_blackbody(3000, rgb) - 0.4164) < 0.001);
    assert_true(fabs(spectrum_blackbody(5600, rgb) - 0.974) < 0.002);
    spectrum_blackbody(1, rgb); /* clamped, finite */
    assert_true(rgb[0] > 0 && isfinite(rgb[0]));
    assert_true(spectrum_named_light("stdillum-D65", rgb));
    for (int i = 0; i < 3; i++)
        assert_true(fabs(rgb[i] - 1) < 2e-3);
    assert_false(spectrum_named_light("stdillum-X", rgb));
    assert_null(spectrum_named("metal-Unobtainium-eta"));
}

static void test_spectrum_file(void **state)
{
    char *folder = pbrt_folder_make();
    struct import_result r;
    const char *spd = "# reflectance\n400 0.5\n700 0.5\n", *bad = "700 1 400 1";
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    const char *text = "WorldBegin Material \"diffuse\" \"spectrum reflectance\" \"b.spd\" " TRIANGLE;
    struct error err = {0};

    (void)state;
    pbrt_folder_put(folder, "a.spd", spd, strlen(spd));
    pbrt_folder_put(folder, "b.spd", bad, strlen(bad));
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Material \"diffuse\" \"spectrum reflectance\" \"a.spd\" " TRIANGLE,
               folder, &r);
    assert_rgb(r.scene.materials[0].base_color, 0.5f, 0.5f, 0.5f);
    import_result_release(&r);
    assert_int_equal(import_scene_memory(text, strlen(text), "a.pbrt", folder, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "a.pbrt:1: |must ascend");
    pbrt_folder_remove(folder);
}

static void test_color_spaces(void **state)
{
    struct import_result r;
    struct scene_material m =
        pbrt_material_of("ColorSpace \"rec2020\" Material \"diffuse\" \"rgb reflectance\" [.5 .5 .5]", &r);

    (void)state;
    assert_rgb(m.base_color, 0.5f, 0.5f, 0.5f); /* the same white */
    import_result_release(&r);
    m = pbrt_material_of("ColorSpace \"rec2020\" Material \"diffuse\" "
                         "\"rgb reflectance\" [.4 .2 .2] ColorSpace \"srgb\"", &r);
    assert_true(m.base_color[0] > 0.45f && m.base_color[1] < 0.2f); /* wider primaries */
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_matte_kinds),
        cmocka_unit_test(test_names_of_version3),
        cmocka_unit_test(test_matte_sigma),
        cmocka_unit_test(test_coated_diffuse),
        cmocka_unit_test(test_named_metals),
        cmocka_unit_test(test_conductors),
        cmocka_unit_test(test_dielectrics),
        cmocka_unit_test(test_diffuse_transmission),
        cmocka_unit_test(test_mix),
        cmocka_unit_test(test_mix_by_color),
        cmocka_unit_test(test_version_3),
        cmocka_unit_test(test_version_3_smooth),
        cmocka_unit_test(test_version_3_names),
        cmocka_unit_test(test_refused_kinds),
        cmocka_unit_test(test_alpha),
        cmocka_unit_test(test_image_texture),
        cmocka_unit_test(test_computed_textures),
        cmocka_unit_test(test_uv_texture),
        cmocka_unit_test(test_dots_texture),
        cmocka_unit_test(test_roughness_texture),
        cmocka_unit_test(test_alpha_texture),
        cmocka_unit_test(test_numbers_of_version3),
        cmocka_unit_test(test_alpha_of_version3),
        cmocka_unit_test(test_normal_map),
        cmocka_unit_test(test_texture_faults),
        cmocka_unit_test(test_spectra),
        cmocka_unit_test(test_spectrum_file),
        cmocka_unit_test(test_color_spaces),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
