/* glTF: the units of lights, which depend on what wrote the file. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "tests/support/gltf_maker.h"

#define BLENDER "Khronos glTF Blender I/O v"
#define FOUR_PI 12.566370614359172

/* A point, a spot and a sun of intensity 683, seen by a camera. */
static void import_lights(const char *generator, const char *units, struct import_result *out)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text,
                  "{\"asset\":{\"version\":\"2.0\",\"generator\":\"%s\"},\"nodes\":[{\"camera\":0},"
                  "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},"
                  "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}},"
                  "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":2}}}],"
                  "\"scenes\":[{\"nodes\":[0,1,2,3]}],"
                  "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}],"
                  "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":["
                  "{\"type\":\"point\",\"intensity\":683},{\"type\":\"spot\",\"intensity\":683},"
                  "{\"type\":\"directional\",\"intensity\":683}]}}}",
                  generator);
    if (units)
        options.light_units = units;
    import_ok_with(text.data, text.size, "lights.gltf", &options, out);
    buffer_release(&text);
    assert_int_equal(out->scene.light_count, 3);
}

static void test_units(void **state)
{
    static const struct {
        const char *generator, *units;
        double spread, sun; /* W/sr and W/m^2 */
        const char *words;  /* of the warning; NULL: there is none */
    } cases[] = {
        {"another", NULL, 683, 683, NULL},
        {BLENDER "3.4.50", NULL, 1, 1, "683 lm/W"},
        {BLENDER "4.2.70", NULL, 1, 1, "683 lm/W"},
        {BLENDER "10.0.1", NULL, 1, 1, "683 lm/W"},
        {BLENDER "3.3.36", NULL, 683 / FOUR_PI, 683, "4 pi"},
        {BLENDER "1.6.16", NULL, 683 / FOUR_PI, 683, "4 pi"},
        {BLENDER "new", NULL, 683, 683, NULL}, /* no version */
        {BLENDER "3.4.50", "auto", 1, 1, "683 lm/W"},
        {BLENDER "3.4.50", "radiometric", 683, 683, NULL},
        {BLENDER "3.4.50", "watts", 683 / FOUR_PI, 683, NULL},
        {BLENDER "1.6.16", "photometric", 1, 1, NULL},
        {"another", "photometric", 1, 1, NULL},
        {"another", "watts", 683 / FOUR_PI, 683, NULL},
    };
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        import_lights(cases[i].generator, cases[i].units, &r);
        for (int light = 0; light < 2; light++)
            assert_true(fabs((double)r.scene.lights[light].intensity[0] - cases[i].spread) <= 1e-6 * cases[i].spread);
        assert_true(fabs((double)r.scene.lights[2].intensity[0] - cases[i].sun) <= 1e-6 * cases[i].sun);
        if (cases[i].words) {
            assert_warned(&r, cases[i].words);
            assert_warned(&r, "--light-units radiometric");
        } else {
            assert_false(warned(&r, "light"));
        }
        import_result_release(&r);
    }
}

/* A range that says nothing is none, and a light that cannot be does not shine: the rest of the file is read. */
static void test_odd_lights(void **state)
{
    static const char text[] =
        "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"camera\":0},{\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},"
        "{\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}},{\"extensions\":{\"KHR_lights_punctual\":{\"light\":2}}}],"
        "\"scenes\":[{\"nodes\":[0,1,2,3]}],\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}],"
        "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\",\"intensity\":5,\"range\":3.4028235e38},"
        "{\"type\":\"spot\",\"intensity\":7,\"range\":-2},{\"type\":\"directional\",\"intensity\":-3}]}}}";
    struct import_result r;

    (void)state;
    import_ok_with(text, sizeof text - 1, "lights.gltf", &defaults, &r);
    assert_true(r.scene.lights[0].intensity[0] == 5 && r.scene.lights[0].range == 0);
    assert_true(r.scene.lights[1].intensity[0] == 7 && r.scene.lights[1].range == 0);
    for (uint32_t i = 2; i < r.scene.light_count; i++)
        assert_true(r.scene.lights[i].intensity[0] == 0);
    assert_warned(&r, "lights[1]: the range -2 is not above 0: it has none");
    assert_warned(&r, "lights[2]: color times intensity must be 0 or more: it does not shine");
    assert_false(warned(&r, "lights[0]"));
    import_result_release(&r);
}

/* What to tick in the exporter, where it is Blender's. */
static void test_missing(void **state)
{
    struct maker m = triangle_maker();
    struct buffer file = BUFFER_INIT, text = BUFFER_INIT;
    const char *asset;
    struct import_result r;

    (void)state;
    maker_write(&m, ONE_NODE "," ONE_TRIANGLE, &file);
    import_ok_with(file.data, file.size, "a.gltf", &defaults, &r);
    assert_false(warned(&r, "Blender"));
    import_result_release(&r);
    asset = strstr(buffer_text(&file), "\"version\"");
    assert_non_null(asset);
    buffer_append(&text, file.data, (size_t)(asset - buffer_text(&file)));
    buffer_printf(&text, "\"generator\":\"" BLENDER "4.0.44\",%s", asset);
    import_ok_with(text.data, text.size, "a.gltf", &defaults, &r);
    assert_warned(&r, "Include > Cameras");
    assert_warned(&r, "Include > Punctual Lights");
    assert_false(warned(&r, "683"));
    import_result_release(&r);
    buffer_release(&text);
    buffer_release(&file);
    maker_release(&m);
}

/* EXT_lights_ies: an even profile of 100 cd, in a view and as text, on two nodes each. */
static void test_luminaires(void **state)
{
    static const char profile[] = "TILT=NONE\n1 1 1 2 1 1 1 0 0 0 1 1 1 0 180 0 100 100";
#define PROFILE_TEXT "VElMVD1OT05FCjEgMSAxIDIgMSAxIDEgMCAwIDAgMSAxIDEgMCAxODAgMCAxMDAgMTAw"
#define LUMINAIRE(light, more) "{\"name\":\"lamp\",\"extensions\":{\"EXT_lights_ies\":{\"light\":" #light more "}}}"
    static const char rest[] =
        "\"nodes\":[{\"camera\":0}," LUMINAIRE(0, ",\"multiplier\":3,\"color\":[1,0.5,2]") "," LUMINAIRE(0, "") ","
        LUMINAIRE(1, "") "," LUMINAIRE(1, ",\"multiplier\":0") "],\"scenes\":[{\"nodes\":[0,1,2,3,4]}],"
        "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1}}],\"extensionsRequired\":[\"EXT_lights_ies\"],"
        "\"extensions\":{\"EXT_lights_ies\":{\"lights\":[{\"bufferView\":0,\"mimeType\":\"application/x-ies-lm-63\"},"
        "{\"uri\":\"data:application/x-ies-lm-63;base64," PROFILE_TEXT "\",\"name\":\"even\"}]}}";
    static const float wanted[4][3] = {{300, 150, 300}, {100, 100, 100}, {100, 100, 100}, {0, 0, 0}};
    struct maker m = {0};
    struct import_result r;

    (void)state;
    put_view(&m, profile, sizeof profile - 1, 0);
    maker_import(&m, rest, &r);
    assert_int_equal(r.scene.light_count, 4);
    assert_int_equal(r.warning_count, 1); /* that there are no triangles */
    for (int i = 0; i < 4; i++) {
        assert_int_equal(r.scene.lights[i].kind, LIGHT_GONIOMETRIC);
        assert_floats(r.scene.lights[i].intensity, wanted[i], 3, 0);
        assert_string_equal(r.scene.lights[i].name, "lamp");
    }
    assert_int_equal(r.scene.lights[0].image, r.scene.lights[1].image);
    assert_int_equal(r.scene.lights[2].image, r.scene.lights[3].image);
    assert_string_equal(r.scene.images[r.scene.lights[2].image].name, "even");
    import_result_release(&r);

    m = (struct maker){0};
    put_view(&m, profile, sizeof profile - 1, 0);
    maker_starve(&m, rest, 0);
    m = (struct maker){0};
    maker_refuse(&m, "\"nodes\":[" LUMINAIRE(2, "") "],\"extensions\":{\"EXT_lights_ies\":{\"lights\":[]}}", "EXT_lights_ies|light is 2");
    m = (struct maker){0};
    maker_refuse(&m, "\"nodes\":[" LUMINAIRE(0, "") "],\"extensions\":{\"EXT_lights_ies\":{\"lights\":[{}]}}",
                 "EXT_lights_ies.lights[0]|neither");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_units),
        cmocka_unit_test(test_odd_lights),
        cmocka_unit_test(test_missing),
        cmocka_unit_test(test_luminaires),
    };

    return cmocka_run_group_tests_name("glTF lights", tests, NULL, NULL);
}
