/* Hard cases of scene files, from the file to the picture: each notices the loss of one safeguard
 * (common/base/safeguard.h; docs/NUMERICS.md). Places far from the origin:
 * statistics/test_far_worlds.c; means of light in textures: statistics/test_texture_filter.c. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/imported.h"

enum { SIDE = 8, PIXELS = SIDE * SIDE };

static const double albedo = 0.8;

static double mean_of(const float *picture)
{
    double sum = 0;

    for (int i = 0; i < PIXELS; i++)
        sum += (double)picture[3 * i] / PIXELS;
    return sum;
}

/* The picture; samples that are not finite count as black. */
static void render(struct import_result *import, const struct render_settings *settings, float *picture)
{
    struct film *film = film_new(settings->width, settings->height, settings->spp);
    struct render_scene *scene = imported_build(import, settings, 0);
    struct render_stats stats = {0};

    assert_non_null(film);
    imported_render_film(scene, 0, film, &stats);
    film_develop(film, picture);
    render_scene_free(scene);
    film_free(film);
}

/* ---- spherical lamps ------------------------------------------------------------------------- */

/* The mean of a picture of a pbrt text that shows one value. */
static void pbrt_figure(const char *world, double expected, double tolerance, const char *what)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, 256);
    float picture[PIXELS * 3];
    struct import_result import;
    char text[1024];

    snprintf(text, sizeof text,
             "Scale -1 1 1 LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\" \"float fov\" 0.01 Film \"rgb\" WorldBegin "
             "Material \"diffuse\" \"rgb reflectance\" [0.8 0.8 0.8] %s",
             world);
    imported_text(text, "a.pbrt", NULL, &import);
    settings.max_depth = 1;
    render(&import, &settings, picture);
    figure_within(what, mean_of(picture), expected * (1 - tolerance), expected * (1 + tolerance),
                  "closed form, tolerance 0.5 %");
    import_result_release(&import);
}

#define WALL                                                                      \
    "Shape \"trianglemesh\" \"point3 P\" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] "            \
    "\"integer indices\" [0 1 2 0 2 3] "

/* A bulb of 5 mm 20 m before a wall: the sine of the angle at which it is seen is 2.5e-4. */
static void test_far_bulb(void **state)
{
    (void)state;
    pbrt_figure(WALL "AttributeBegin Translate 0 0 20 "
                     "AreaLightSource \"diffuse\" \"rgb L\" [1e8 1e8 1e8] "
                     "Shape \"sphere\" \"float radius\" 0.005 AttributeEnd",
                albedo * 1e8 * 0.005 * 0.005 / 400, 0.005, "radiance of a wall 20 m from a bulb of 5 mm");
}

static void test_inside_lamp(void **state)
{
    (void)state;
    pbrt_figure(WALL "AttributeBegin ReverseOrientation "
                     "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] "
                     "Shape \"sphere\" \"float radius\" 30 AttributeEnd",
                albedo, 0.005, "radiance of a wall inside a spherical lamp");
}

/* ---- textures --------------------------------------------------------------------------------- */

/* A texture of two texels whose u overflows to infinity all over a card: the light of its start. */
static void test_infinite_coordinate(void **state)
{
    static const float corners[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static const float uv[8] = {3e38f, 1, 3e38f, 1, 3e38f, 0, 3e38f, 0};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct render_settings settings = imported_settings(SIDE, SIDE, 4);
    struct maker m = {0};
    struct import_result import;
    float picture[PIXELS * 3];

    (void)state;
    put_floats(&m, "VEC3", corners, 12, 4);
    put_floats(&m, "VEC2", uv, 8, 4);
    put_accessor(&m, put_view(&m, indices, sizeof indices, 0), "SCALAR", 5123, 6, "");
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
                 "{\"camera\":0,\"translation\":[0,0,2]}],"
                 "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.2,\"znear\":1}}],"
                 "\"extensionsUsed\":[\"KHR_materials_unlit\"],"
                 "\"materials\":[{\"extensions\":{\"KHR_materials_unlit\":{}},"
                 "\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}}}]," PNG_IMAGE ","
                 "\"meshes\":[{\"primitives\":[{\"material\":0,\"indices\":2,\"attributes\":{"
                 "\"POSITION\":0,\"TEXCOORD_0\":1}}]}]",
                 &import);
    import.scene.materials[0].base_color_texture.uv_transform[0][0] = 10;
    render(&import, &settings, picture);
    /* The mean of both texels' red, 1 and 0: the image repeats, and 0 lies between them. */
    figure_within("red of a card whose texture coordinates are infinite", mean_of(picture), 0.499, 0.501,
                  "tolerance 1e-3");
    import_result_release(&import);
}

/* ---- cameras and skins ----------------------------------------------------------------------- */

/* A card that shines, and a camera that looks at it from below six nodes that scale by 1e-30 each. */
static void test_tiny_scale(void **state)
{
    static const float corners[9] = {-9, -9, 0, 9, -9, 0, 0, 9, 0};
    struct render_settings settings = imported_settings(SIDE, SIDE, 4);
    struct import_result import;
    char nodes[1024], *at = nodes;
    struct maker m = {0};
    float picture[PIXELS * 3];

    (void)state;
    put_floats(&m, "VEC3", corners, 9, 3);
    at += sprintf(at, "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0},"
                      "{\"translation\":[0,0,2],\"children\":[2]}");
    for (int i = 2; i < 8; i++)
        at += sprintf(at, ",{\"scale\":[1e-30,1e-30,1e-30],\"children\":[%d]}", i + 1);
    sprintf(at, ",{\"camera\":0}],"
                "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.2,\"znear\":1}}],"
                "\"materials\":[{\"emissiveFactor\":[0.5,0.5,0.5]}],"
                "\"meshes\":[{\"primitives\":[{\"material\":0,\"attributes\":{\"POSITION\":0}}]}]");
    maker_import(&m, nodes, &import);
    render(&import, &settings, picture);
    figure_within("radiance before a camera of scale 1e-180", mean_of(picture), 0.4999, 0.5001, "tolerance 2e-4");
    import_result_release(&import);
}

/* Weights that add up to a half: the card keeps its size, and fills the picture. */
static void test_half_weights(void **state)
{
    static const float corners[12] = {39.75f, -0.25f, 0, 40.25f, -0.25f, 0,
                                      40.25f, 0.25f,  0, 39.75f, 0.25f,  0};
    static const uint8_t joints[16] = {0};
    static const float weights[16] = {0.5f, 0, 0, 0, 0.5f, 0, 0, 0, 0.5f, 0, 0, 0, 0.5f, 0, 0, 0};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct render_settings settings = imported_settings(SIDE, SIDE, 4);
    struct import_result import;
    struct maker m = {0};
    float picture[PIXELS * 3];

    (void)state;
    put_floats(&m, "VEC3", corners, 12, 4);
    put_accessor(&m, put_view(&m, joints, sizeof joints, 0), "VEC4", 5121, 4, "");
    put_floats(&m, "VEC4", weights, 16, 4);
    put_accessor(&m, put_view(&m, indices, sizeof indices, 0), "SCALAR", 5123, 6, "");
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{},"
                 "{\"camera\":0,\"translation\":[40,0,2]}],\"skins\":[{\"joints\":[1]}],"
                 "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.2,\"znear\":1}}],"
                 "\"materials\":[{\"emissiveFactor\":[0.5,0.5,0.5]}],"
                 "\"meshes\":[{\"primitives\":[{\"material\":0,\"indices\":3,\"attributes\":{"
                 "\"POSITION\":0,\"JOINTS_0\":1,\"WEIGHTS_0\":2}}]}]",
                 &import);
    render(&import, &settings, picture);
    figure_within("radiance of a skin's card whose weights add up to a half", mean_of(picture), 0.4999, 0.5001,
                  "tolerance 2e-4");
    import_result_release(&import);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_far_bulb),            cmocka_unit_test(test_inside_lamp),
        cmocka_unit_test(test_infinite_coordinate), cmocka_unit_test(test_tiny_scale),
        cmocka_unit_test(test_half_weights),
    };

    return cmocka_run_group_tests_name("hard files", tests, NULL, NULL);
}
