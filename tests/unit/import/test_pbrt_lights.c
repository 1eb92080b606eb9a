/* pbrt: lights, environments, area lights, media. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_spectrum.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"

static void assert_rgb(const float *got, float r, float g, float b)
{
    for (int i = 0; i < 3; i++) {
        const float wanted = i == 0 ? r : i == 1 ? g : b;
        assert_true(fabsf(got[i] - wanted) <= 2e-5f * fmaxf(1, fabsf(wanted)));
    }
}

/* ---- lights at a point -------------------------------------------------------------------- */

static void test_point_lights(void **state)
{
    const struct scene_light *l;
    struct import_result r;

    (void)state;
    pbrt_world("Translate 1 2 3 LightSource \"point\" \"rgb I\" [1 2 3] \"float scale\" 2 "
               "\"point3 from\" [1 0 0] "
               "LightSource \"point\" \"float power\" 100 "
               "LightSource \"spot\" \"rgb I\" [4 4 4] \"point3 from\" [0 0 0] "
               "\"point3 to\" [0 -1 0] \"float coneangle\" 40 \"float conedeltaangle\" 10 "
               "LightSource \"distant\" \"rgb L\" [1 1 2] \"point3 from\" [0 0 1] "
               "\"point3 to\" [0 0 0] \"float illuminance\" 3 " TRIANGLE,
               &r);
    assert_int_equal(r.scene.light_count, 4);
    l = r.scene.lights;
    assert_int_equal(l[0].kind, LIGHT_POINT);
    assert_rgb(l[0].intensity, 2, 4, 6);
    assert_in_file(&r.scene, l[0].position, (const double[]){2, 2, 3}, 0);
    assert_rgb(l[1].intensity, 7.9577472f, 7.9577472f, 7.9577472f); /* 100 / (4 pi) */
    assert_int_equal(l[2].kind, LIGHT_SPOT);
    assert_int_equal(l[2].falloff, FALLOFF_SMOOTHSTEP);
    assert_rgb(l[2].direction, 0, -1, 0);
    assert_float_equal(l[2].outer_cone_rad, 0.6981317f, 1e-6f);
    assert_float_equal(l[2].inner_cone_rad, 0.5235988f, 1e-6f);
    assert_int_equal(l[3].kind, LIGHT_DIRECTIONAL);
    assert_rgb(l[3].direction, 0, 0, -1);
    assert_rgb(l[3].intensity, 3, 3, 6);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    /* A spot of a power: the flux of the cones together. */
    pbrt_world("LightSource \"spot\" \"float power\" 50 \"float coneangle\" 60 "
               "\"float conedeltaangle\" 0 " TRIANGLE, &r);
    assert_float_equal(r.scene.lights[0].intensity[0], 50 / (2 * PI_F * 0.5f), 1e-3f);
    import_result_release(&r);
    pbrt_world("LightSource \"laser\" " LAMP TRIANGLE, &r);
    pbrt_warned(&r, "\"laser\" is not known");
    import_result_release(&r);
}

/* pbrt-v3 has other formulas by the same names. A white surface that faces its light of 3000 K and 1.5 has the radiance
 * 0.348, 0.169, 0.054 there (spectrum.cpp: Planck's curve over its peak); pbrt-v4's has the luminance 1.5 / pi. */
static void test_version3(void **state)
{
    static const float wanted[] = {0.348f, 0.169f, 0.054f};
    struct import_result r;

    (void)state;
    pbrt_whole("Film \"image\" Camera \"perspective\" WorldBegin "
               "LightSource \"spot\" \"rgb I\" [4 4 4] LightSource \"distant\" \"blackbody L\" [3000 1.5] "
               "LightSource \"distant\" \"blackbody L\" [2000 1] " TRIANGLE,
               NULL, &r);
    assert_int_equal(r.scene.lights[0].falloff, FALLOFF_FOURTH);
    for (int i = 0; i < 3; i++)
        assert_float_equal(r.scene.lights[1].intensity[i] / PI_F, wanted[i], 0.015f * wanted[0]);
    assert_true(spectrum_blackbody(2000, (double[3]){0}) < 0.06); /* pbrt-v4's light is 20 times as strong */
    import_result_release(&r);
    /* Its scale is a colour; a number of that name is unknown (FindOneSpectrum). */
    pbrt_whole("Film \"image\" Camera \"perspective\" WorldBegin LightSource \"point\" \"rgb I\" [4 4 4] \"rgb scale\" [2 1 0] "
               "LightSource \"point\" \"rgb I\" [4 4 4] \"float scale\" 2 " TRIANGLE, NULL, &r);
    assert_rgb(r.scene.lights[0].intensity, 8, 4, 0);
    assert_rgb(r.scene.lights[1].intensity, 4, 4, 4);
    pbrt_warned(&r, "light \"point\"|float scale\" is not known");
    import_result_release(&r);
}

/* In the mirrored world lights are mirrored too. */
static void test_mirrored_light(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("Camera \"perspective\" WorldBegin LightSource \"distant\" \"point3 from\" [0 0 0] "
               "\"point3 to\" [1 0 1] LightSource \"point\" \"point3 from\" [1 2 3] " TRIANGLE,
               NULL, &r);
    assert_rgb(r.scene.lights[0].direction, 0.70710678f, 0, -0.70710678f);
    assert_in_file(&r.scene, r.scene.lights[1].position, (const double[]){1, 2, -3}, 0);
    import_result_release(&r);
}

/* Every spectrum of pbrt-v4 has luminance 1, an RGB keeps its own. */
static void test_light_spectra(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world("LightSource \"point\" \"blackbody I\" 6500 \"float scale\" 3 "
               "LightSource \"point\" \"spectrum I\" [380 7 780 7] "
               "LightSource \"point\" \"spectrum I\" \"stdillum-A\" " TRIANGLE, &r);
    for (int i = 0; i < 3; i++) {
        const float *c = r.scene.lights[i].intensity;
        float luminance = 0.2126729f * c[0] + 0.7151522f * c[1] + 0.0721750f * c[2];
        assert_float_equal(luminance, i == 0 ? 3 : 1, 1e-4f);
    }
    assert_true(r.scene.lights[2].intensity[0] > 2 * r.scene.lights[2].intensity[2]);
    import_result_release(&r);
    /* pbrt-v3's counts with its strength. */
    pbrt_whole("Film \"image\" Camera \"perspective\" WorldBegin "
               "LightSource \"point\" \"spectrum I\" [380 7 780 7] "
               "LightSource \"point\" \"rgb I\" [1 2 3] \"rgb scale\" [2 2 3] " TRIANGLE,
               NULL, &r);
    assert_float_equal(0.2126729f * r.scene.lights[0].intensity[0] + 0.7151522f * r.scene.lights[0].intensity[1] +
                           0.0721750f * r.scene.lights[0].intensity[2],
                       7, 1e-3f);
    assert_rgb(r.scene.lights[1].intensity, 2, 4, 9);
    import_result_release(&r);
}

/* ---- area lights -------------------------------------------------------------------------- */

#define SQUARE                                                                             \
    "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 1 1 0 0 1 0] "                       \
    "\"integer indices\" [0 1 2 0 2 3] "

static void test_area_lights(void **state)
{
    const struct scene_material *m;
    struct import_result r;

    (void)state;
    /* Shines to its front alone: two surfaces, each there from one side. */
    pbrt_world("AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float scale\" 2 " SQUARE, &r);
    assert_int_equal(r.scene.instance_count, 2);
    m = &r.scene.materials[r.scene.instances[0].material];
    assert_rgb(m->emission, 2, 4, 6);
    assert_false(m->double_sided);
    m = &r.scene.materials[r.scene.instances[1].material];
    assert_rgb(m->emission, 0, 0, 0);
    assert_false(m->double_sided);
    for (int i = 0; i < 2; i++) {
        struct mesh_view v = view_mesh(&r, r.scene.instances[i].mesh);
        const float *a = v.positions + 3 * v.indices[0], *b = v.positions + 3 * v.indices[1],
                    *c = v.positions + 3 * v.indices[2];
        float z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert_true(i == 0 ? z > 0 : z < 0);
    }
    import_result_release(&r);
    pbrt_world("AreaLightSource \"diffuse\" \"bool twosided\" true " SQUARE, &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_true(r.scene.materials[0].double_sided);
    assert_rgb(r.scene.materials[0].emission, 1, 1, 1);
    import_result_release(&r);
    /* The inside of a closed light cannot be seen. */
    pbrt_world("AreaLightSource \"diffuse\" Shape \"sphere\" ReverseOrientation Shape \"sphere\"", &r);
    assert_int_equal(r.scene.instance_count, 3);
    import_result_release(&r);
    /* L = 2, 100 lm over 6 m^2 to one side: 2 * 100 / (6 pi). */
    pbrt_world("AreaLightSource \"diffuse\" \"rgb L\" [2 2 2] \"float power\" 100 Scale 2 3 1 " SQUARE, &r);
    assert_float_equal(r.scene.materials[0].emission[0], 10.610329f, 1e-4f);
    import_result_release(&r);
    pbrt_world("AttributeBegin AreaLightSource \"diffuse\" AttributeEnd " LAMP SQUARE, &r);
    assert_rgb(r.scene.materials[0].emission, 0, 0, 0);
    import_result_release(&r);
    pbrt_world(LAMP "Material \"interface\" AreaLightSource \"diffuse\" " SQUARE, &r);
    pbrt_warned(&r, "\"interface\"|does not shine");
    import_result_release(&r);
}

/* ---- environments ------------------------------------------------------------------------- */

static void test_constant_environment(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world("LightSource \"infinite\" \"rgb L\" [1 2 3] LightSource \"infinite\" "
               "\"rgb L\" [.5 .5 .5] \"float scale\" 2 " TRIANGLE, &r);
    assert_true(r.scene.environment.present && r.scene.environment.constant);
    assert_rgb(r.scene.environment.radiance, 2, 3, 4);
    import_result_release(&r);
    pbrt_world("LightSource \"infinite\" \"float illuminance\" 3.14159265 \"point3 portal\" "
               "[0 0 1  2 0 1  2 3 1  0 3 1] " TRIANGLE, &r);
    assert_rgb(r.scene.environment.radiance, 1, 1, 1);
    assert_int_equal(r.scene.environment.portal_count, 1);
    assert_in_file(&r.scene, r.scene.environment.portals[0].corner, (const double[]){0, 0, 1}, 0);
    assert_rgb(r.scene.environment.portals[0].edge1, 2, 0, 0);
    assert_rgb(r.scene.environment.portals[0].edge2, 0, 3, 0);
    import_result_release(&r);
}

/* Clarberg's map the other way: the direction of a point of the square, from the definition of
 * the square's eight triangles (z >= 0 within |x| + |y| <= 1). */
static void square_to_sphere(double u, double v, double d[3])
{
    double x = 2 * u - 1, y = 2 * v - 1, ax = fabs(x), ay = fabs(y), signed_distance = 1 - ax - ay;
    double r = 1 - fabs(signed_distance), phi, z;
    float s, c;

    phi = (r == 0 ? 1 : (ay - ax) / r + 1) * PI_D / 4;
    z = copysign(1 - r * r, signed_distance);
    det_sincos((float)phi, &s, &c);
    d[0] = copysign((double)c, x) * r * sqrt(2 - r * r);
    d[1] = copysign((double)s, y) * r * sqrt(2 - r * r);
    d[2] = z;
}

enum { MAP_SIDE = 64 };

/* A picture whose colour is its direction: (d + 1) / 2, and twice that in all (to tell scale). `latlong` 2: square, too. */
static void direction_map(struct image *map, int latlong)
{
    struct error err = {0};

    assert_int_equal(image_init(map, latlong == 1 ? 2 * MAP_SIDE : MAP_SIDE, MAP_SIDE, 3, &err), STATUS_OK);
    for (uint32_t y = 0; y < map->height; y++)
        for (uint32_t x = 0; x < map->width; x++) {
            double d[3], u = (x + 0.5) / map->width, v = (y + 0.5) / map->height;
            if (latlong) { /* pbrt-v3 */
                float sp, cp, st, ct;
                det_sincos((float)(2 * PI_D * u), &sp, &cp);
                det_sincos((float)(PI_D * v), &st, &ct);
                d[0] = (double)(st * cp), d[1] = (double)(st * sp), d[2] = (double)ct;
            } else {
                square_to_sphere(u, v, d);
            }
            for (size_t c = 0; c < 3; c++)
                map->pixels[((size_t)y * map->width + x) * 3 + c] = (float)((d[c] + 1) / 2);
        }
}

/* The environment of the result, in the direction `d` of the world. */
static void look_at_environment(const struct import_result *r, const struct image *map, const double d[3], float out[3])
{
    double m[3] = {0, 0, 0}, u, v;
    size_t x, y;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            m[i] += (double)r->scene.environment.to_map[i][j] * d[j];
    u = 0.5 + (double)det_atan2((float)m[2], (float)m[0]) / (2 * PI_D);
    v = (double)det_acos((float)m[1]) / PI_D;
    x = (size_t)(u * map->width) % map->width;
    y = (size_t)fmin(v * map->height, map->height - 1);
    memcpy(out, map->pixels + (y * map->width + x) * 3, 3 * sizeof *out);
}

static void check_map(int latlong, const char *before, const char *light, const double light_of_world[3][3])
{
    static const double directions[][3] = {{1, 0, 0},      {-1, 0, 0},      {0, 1, 0},
                                           {0, -1, 0},     {0, 0, 1},       {0, 0, -1},
                                           {0.6, 0.64, 0.48}, {-0.6, 0.48, -0.64}};
    const struct exr_options options = {0};
    struct image map = {0}, got = {0};
    struct buffer file = BUFFER_INIT, text = BUFFER_INIT;
    struct image_repairs repairs = {0};
    char *folder = pbrt_folder_make();
    float brightest = 0;
    struct import_result r;
    struct error err = {0};

    direction_map(&map, latlong);
    assert_int_equal(exr_encode(&file, &map, &options, &err), STATUS_OK);
    pbrt_folder_put(folder, "e.exr", file.data, file.size);
    buffer_printf(&text, "%s Camera \"perspective\" WorldBegin %s " TRIANGLE, before, light);
    pbrt_whole(buffer_text(&text), folder, &r);
    pbrt_folder_remove(folder);
    assert_true(r.scene.environment.present && !r.scene.environment.constant);
    assert_rgb(r.scene.environment.radiance, 2, 2, 2);
    for (size_t i = 0; i < r.blob_count; i++)
        if (digest_equal(&r.blobs[i].digest, &r.scene.environment.image.blob.digest))
            assert_int_equal(image_decode_hdr(&got, r.blobs[i].data, r.blobs[i].size_bytes, "e", &repairs, &err),
                             STATUS_OK);
    assert_int_equal(got.width, latlong == 2 ? got.height : 2 * got.height);
    for (size_t i = 0; i < (size_t)3 * got.width * got.height; i++)
        brightest = fmaxf(brightest, got.pixels[i]);
    assert_true(brightest > 0 && r.scene.environment.brightest == brightest);
    for (size_t k = 0; k < sizeof directions / sizeof *directions; k++) {
        float seen[3];
        look_at_environment(&r, &got, directions[k], seen);
        for (int i = 0; i < 3; i++) {
            double wanted = 0;
            for (int j = 0; j < 3; j++)
                wanted += light_of_world[i][j] * directions[k][j];
            /* A texel of the map is about 3 degrees. */
            assert_true(fabs((double)seen[i] - (wanted + 1) / 2) < 0.04);
        }
    }
    import_result_release(&r);
    image_release(&map);
    image_release(&got);
    buffer_release(&file);
    buffer_release(&text);
}

static void test_environment_maps(void **state)
{
    static const char light[] = "LightSource \"infinite\" \"string filename\" \"e.exr\" "
                                "\"float scale\" 2";
    static const char turned[] = "Rotate 90 1 0 0 LightSource \"infinite\" "
                                 "\"string filename\" \"e.exr\" \"float scale\" 2";
    static const char old[] = "LightSource \"infinite\" \"string mapname\" \"e.exr\" "
                              "\"rgb scale\" [2 2 2]";
    static const double same[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const double mirrored[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}};
    /* Rotate 90 about x takes the light's y to z: the world's z is the light's y. */
    static const double quarter[3][3] = {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};

    (void)state;
    check_map(0, "Scale -1 1 1", light, same);
    check_map(0, "", light, mirrored); /* our z is minus the file's */
    check_map(0, "Scale -1 1 1", turned, quarter);
    check_map(1, "Scale -1 1 1", old, same);
    check_map(1, "", old, mirrored);
    /* All of pbrt-v3's are of latitude and longitude. */
    check_map(2, "Film \"image\" Scale -1 1 1", old, same);
}

static void test_image_lights(void **state)
{
    const struct exr_options options = {0};
    char *folder = pbrt_folder_make();
    struct buffer file = BUFFER_INIT;
    struct image map = {0};
    const struct scene_light *l;
    struct import_result r;
    struct error err = {0};

    (void)state;
    direction_map(&map, 1);
    assert_int_equal(exr_encode(&file, &map, &options, &err), STATUS_OK);
    pbrt_folder_put(folder, "wide.exr", file.data, file.size);
    image_release(&map);
    buffer_clear(&file);
    direction_map(&map, 0);
    assert_int_equal(exr_encode(&file, &map, &options, &err), STATUS_OK);
    pbrt_folder_put(folder, "square.exr", file.data, file.size);
    pbrt_whole(RIGHT_HANDED "WorldBegin LightSource \"projection\" \"string filename\" \"wide.exr\" "
                            "\"float fov\" 60 LightSource \"goniometric\" \"rgb I\" [3 3 3] "
                            "\"string filename\" \"square.exr\" " TRIANGLE,
               folder, &r);
    l = &r.scene.lights[0];
    assert_int_equal(l->kind, LIGHT_PROJECTION);
    assert_float_equal(l->projection_yfov_rad, 1.0471976f, 1e-5f);
    assert_float_equal(l->projection_aspect, 2, 0);
    assert_rgb(l->direction, 0, 0, 1); /* along +z */
    assert_true(l->to_world.m[0][0] == 1 && l->to_world.m[1][1] == 1 && l->to_world.m[2][2] == -1);
    l = &r.scene.lights[1];
    assert_int_equal(l->kind, LIGHT_GONIOMETRIC);
    assert_rgb(l->intensity, 3, 3, 3);
    assert_true(l->image >= 0 && l->to_world.m[2][2] == 1);
    import_result_release(&r);
    /* pbrt-v3's picture has its top at -y (projection.cpp has no Scale(1, -1, 1)). */
    pbrt_whole("Film \"image\" " RIGHT_HANDED "WorldBegin LightSource \"projection\" \"string mapname\" \"wide.exr\" "
               "LightSource \"goniometric\" \"string mapname\" \"square.exr\" " TRIANGLE,
               folder, &r);
    pbrt_folder_remove(folder);
    l = &r.scene.lights[0];
    assert_rgb(l->direction, 0, 0, 1);
    assert_true(l->to_world.m[0][0] == 1 && l->to_world.m[1][1] == -1 && l->to_world.m[2][2] == -1);
    l = &r.scene.lights[1]; /* a square picture of latitude and longitude, as it is */
    assert_true(l->to_world.m[0][0] == -1 && l->to_world.m[2][2] == -1);
    import_result_release(&r);
    image_release(&map);
    buffer_release(&file);
}

/* ---- media -------------------------------------------------------------------------------- */

#define FOG "MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] " \
            "\"rgb sigma_s\" [4 5 6] \"float scale\" .5 \"float g\" .7 "

static void test_media(void **state)
{
    const struct scene_medium *m;
    struct import_result r;

    (void)state;
    pbrt_world(LAMP FOG "MediumInterface \"fog\" \"\" Material \"dielectric\" Shape \"sphere\" "
               "Material \"diffuse\" Shape \"sphere\" Material \"interface\" Shape \"sphere\"", &r);
    assert_int_equal(r.scene.medium_count, 1);
    m = &r.scene.media[0];
    assert_rgb(m->absorption, 0.5f, 1, 1.5f);
    assert_rgb(m->scattering, 2, 2.5f, 3);
    assert_true(m->g == 0.7f && !m->has_grid);
    assert_rgb(m->emission, 0, 0, 0);
    assert_int_equal(r.scene.materials[r.scene.instances[0].material].medium, 0);
    assert_int_equal(r.scene.materials[r.scene.instances[1].material].medium, -1);
    assert_int_equal(r.scene.materials[r.scene.instances[2].material].medium, 0);
    assert_int_equal(r.scene.materials[r.scene.instances[2].material].kind, MATERIAL_INTERFACE);
    assert_int_equal(r.scene.fog, -1);
    import_result_release(&r);
    pbrt_whole(FOG "MediumInterface \"\" \"fog\" Camera \"perspective\" WorldBegin " LAMP
               "Material \"dielectric\" Shape \"sphere\"", NULL, &r);
    assert_int_equal(r.scene.fog, 0);
    assert_int_equal(r.scene.materials[0].medium, -1);
    import_result_release(&r);
    /* One material inside of two media: two rows. */
    pbrt_world(LAMP FOG "Material \"dielectric\" Shape \"sphere\" MediumInterface \"fog\" \"\" "
               "Shape \"sphere\" Shape \"sphere\"", &r);
    assert_int_equal(r.scene.material_count, 2);
    assert_int_equal(r.scene.instances[1].material, r.scene.instances[2].material);
    import_result_release(&r);
    /* Both sides are kept where they differ; where not, nothing changes at the surface. */
    pbrt_world(LAMP FOG "MediumInterface \"\" \"fog\" Material \"interface\" " TRIANGLE, &r);
    assert_int_equal(r.scene.volume_rule, VOLUMES_BOUNDARIES);
    assert_int_equal(r.scene.materials[0].medium, -1);
    assert_int_equal(r.scene.materials[0].medium_outside, 0);
    import_result_release(&r);
    pbrt_world(LAMP FOG "MediumInterface \"fog\" \"fog\" Material \"interface\" " TRIANGLE, &r);
    assert_int_equal(r.scene.materials[0].medium, -1);
    assert_int_equal(r.scene.materials[0].medium_outside, -1);
    import_result_release(&r);
    pbrt_world(LAMP "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" "
               "\"string preset\" \"Ketchup\" \"rgb Le\" [2 2 2] \"float Lescale\" 3 "
               "MakeNamedMedium \"c\" \"string type\" \"cloud\" MediumInterface \"m\" \"c\" "
               "Material \"dielectric\" Shape \"sphere\" MediumInterface \"c\" \"x\" "
               "Shape \"sphere\"", &r);
    assert_rgb(r.scene.media[0].scattering, 0.18f, 0.07f, 0.03f);
    assert_rgb(r.scene.media[0].emission, 6 * 0.061f, 6 * 0.97f, 6 * 1.45f);
    pbrt_warned(&r, "\"cloud\" is not supported");
    import_result_release(&r);
}

/* A scene of a nanometre's size may be opaque; beyond what a scene may say, a warning. */
/* pbrt-v4's presets count before coefficients, pbrt-v3's after them; without either, milk and 1. */
static void test_media_of_both_versions(void **state)
{
#define BOTH "MakeNamedMedium \"p\" \"string type\" \"homogeneous\" \"string preset\" \"Ketchup\" \"rgb sigma_a\" [1 2 3] " \
             "MakeNamedMedium \"d\" \"string type\" \"homogeneous\" Material \"none\" " \
             "MediumInterface \"p\" \"\" Shape \"sphere\" MediumInterface \"d\" \"\" Shape \"sphere\""
    struct import_result r;

    (void)state;
    pbrt_world(LAMP BOTH, &r);
    assert_rgb(r.scene.media[0].absorption, 0.061f, 0.97f, 1.45f);
    assert_rgb(r.scene.media[0].scattering, 0.18f, 0.07f, 0.03f);
    assert_rgb(r.scene.media[1].absorption, 1, 1, 1);
    import_result_release(&r);
    pbrt_whole("Film \"image\" " RIGHT_HANDED "WorldBegin " LAMP BOTH, NULL, &r);
    assert_rgb(r.scene.media[0].absorption, 1, 2, 3);
    assert_rgb(r.scene.media[0].scattering, 0.18f, 0.07f, 0.03f);
    assert_rgb(r.scene.media[1].scattering, 2.55f, 3.21f, 3.77f);
    import_result_release(&r);
#undef BOTH
}

static void test_dense(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [0 0 0] "
               "\"rgb sigma_s\" [4e11 4e11 3e10] MediumInterface \"m\" \"\" "
               "Material \"interface\" Shape \"sphere\"", &r);
    assert_rgb(r.scene.media[0].scattering, 4e11f, 4e11f, 3e10f);
    assert_false(pbrt_has_warned(&r, "per metre"));
    import_result_release(&r);
    pbrt_world(LAMP "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [0 0 0] "
               "\"rgb sigma_s\" [1e13 1 1] MediumInterface \"m\" \"\" "
               "Material \"interface\" Shape \"sphere\"", &r);
    assert_rgb(r.scene.media[0].scattering, 1e12f, 1, 1);
    pbrt_warned(&r, "\"m\"|1e+13 per metre");
    import_result_release(&r);
}

static void test_grid(void **state)
{
    const struct scene_medium *m;
    struct import_result r;
    double corner[3];

    (void)state;
    pbrt_world(LAMP "Translate 10 0 0 MakeNamedMedium \"g\" \"string type\" \"uniformgrid\" "
               "\"integer nx\" 2 \"integer ny\" 1 \"integer nz\" 3 "
               "\"float density\" [1 2 3 4 5 6] \"point3 p0\" [-1 -1 -1] \"point3 p1\" [1 3 1] "
               "MediumInterface \"g\" \"\" Material \"interface\" Shape \"sphere\"", &r);
    m = &r.scene.media[0];
    assert_true(m->has_grid && m->grid_size[0] == 2 && m->grid_size[1] == 1 && m->grid_size[2] == 3);
    assert_rgb(m->absorption, 1, 1, 1);
    for (int i = 0; i < 3; i++) /* the cube's far corner */
        corner[i] =
            m->grid_to_world.m[i][0] + m->grid_to_world.m[i][1] + m->grid_to_world.m[i][2] + m->grid_to_world.m[i][3];
    assert_in_file(&r.scene, corner, (const double[]){11, 3, 1}, 1e-12);
    for (size_t i = 0; i < r.blob_count; i++)
        if (digest_equal(&r.blobs[i].digest, &m->grid.digest)) {
            assert_int_equal(r.blobs[i].size_bytes, 6 * sizeof(float));
            assert_memory_equal(r.blobs[i].data, ((const float[]){1, 2, 3, 4, 5, 6}), 24);
        }
    import_result_release(&r);
    pbrt_refused("WorldBegin MakeNamedMedium \"g\" \"string type\" \"uniformgrid\" "
                 "\"integer nx\" 2 \"float density\" [1] MediumInterface \"g\" \"\" "
                 "Material \"interface\" Shape \"sphere\"",
                 "a.pbrt:1: |density|nx ny nz = 2");
}

/* Two texts that say one scene: the same to the bit. */
static void assert_same_scene(const char *folder, const char *one, const char *other)
{
    struct buffer packed[2] = {BUFFER_INIT, BUFFER_INIT};
    struct error err = {0};

    for (int k = 0; k < 2; k++) {
        struct import_result r;
        pbrt_whole(k ? other : one, folder, &r);
        assert_int_equal(scene_pack(&r.scene, &packed[k], &err), STATUS_OK);
        import_result_release(&r);
    }
    if (packed[0].size != packed[1].size || memcmp(packed[0].data, packed[1].data, packed[0].size) != 0)
        fail_msg("two scenes: %s and %s", one, other);
    buffer_release(&packed[0]);
    buffer_release(&packed[1]);
}

/* One statement that makes several shapes shine says what one for each says, whatever their sizes. */
static void test_one_lamp_of_many_shapes(void **state)
{
    static const char *const lamps[] = {
        "AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] ",
        "AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float power\" 100 ",
        "AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float power\" 100 \"bool twosided\" true ",
        "AreaLightSource \"diffuse\" \"blackbody L\" 3000 \"float scale\" 2 ",
    };
    static const char *const shapes[] = {SQUARE, "Scale 2 3 1 ", SQUARE, "Material \"conductor\" ", SQUARE "\"float alpha\" .5 ",
                                         "Shape \"sphere\" ", "Shape \"sphere\" \"float radius\" 2 ", "ReverseOrientation ", SQUARE};

    (void)state;
    for (size_t i = 0; i < sizeof lamps / sizeof *lamps; i++) {
        char one[3000], other[3000];
        struct import_result r[2];
        int used = snprintf(one, sizeof one, RIGHT_HANDED "WorldBegin %s", lamps[i]), more = snprintf(other, sizeof other, RIGHT_HANDED "WorldBegin ");
        for (size_t k = 0; k < sizeof shapes / sizeof *shapes; k++) {
            const int shines = strncmp(shapes[k], "Shape", 5) == 0;
            used += snprintf(one + used, sizeof one - (size_t)used, "%s", shapes[k]);
            more += snprintf(other + more, sizeof other - (size_t)more, "%s%s%s%s", shines ? "AttributeBegin " : "",
                             shines ? lamps[i] : "", shapes[k], shines ? "AttributeEnd " : "");
        }
        pbrt_whole(one, NULL, &r[0]);
        pbrt_whole(other, NULL, &r[1]);
        assert_int_equal(r[0].scene.instance_count, r[1].scene.instance_count);
        for (uint32_t k = 0; k < r[0].scene.instance_count; k++) {
            struct scene_material a = r[0].scene.materials[r[0].scene.instances[k].material];
            struct scene_material b = r[1].scene.materials[r[1].scene.instances[k].material];
            a.name = b.name = "";
            if (memcmp(&a, &b, sizeof a) != 0)
                fail_msg("shape %u of %s", k, lamps[i]);
        }
        import_result_release(&r[0]);
        import_result_release(&r[1]);
    }
}

enum { FACTOR_TEXT = 1000 };

/* A lamp whose values, scale and flux (power or illuminance; 0: not said) are multiplied by these. */
static void write_lamp(char out[FACTOR_TEXT], int version3, const char *lamp, const char *name, const char *flux,
                       int values, int scale, int times_flux)
{
    int used = snprintf(out, FACTOR_TEXT, "%sWorldBegin %s \"rgb %s\" [%d %d %d] ",
                        version3 ? "Film \"image\" " EYE : RIGHT_HANDED, lamp, name, values, 2 * values, 3 * values);

    if (scale > 1)
        used += snprintf(out + used, FACTOR_TEXT - (size_t)used,
                         version3 ? "\"rgb scale\" [%d %d %d] " : "\"float scale\" %d ", scale, scale, scale);
    if (times_flux)
        used += snprintf(out + used, FACTOR_TEXT - (size_t)used, "\"float %s\" %d ", flux, times_flux);
    snprintf(out + used, FACTOR_TEXT - (size_t)used, SQUARE);
}

/* A factor of 4 says what four times its values say, whatever carries it, in both versions. */
static void test_factors_of_lamps(void **state)
{
#define WITH_PICTURE " \"string filename\" \"e.exr\""
    static const struct { const char *lamp, *name, *flux; } lamps[] = {
        {"LightSource \"point\"", "I", "power"},
        {"LightSource \"spot\"", "I", "power"},
        {"LightSource \"goniometric\"" WITH_PICTURE, "I", "power"},
        {"LightSource \"projection\"" WITH_PICTURE, "I", "power"},
        {"LightSource \"distant\"", "L", "illuminance"},
        {"LightSource \"infinite\"", "L", "illuminance"},
        {"LightSource \"infinite\"" WITH_PICTURE, "L", "illuminance"},
        {"AreaLightSource \"diffuse\"", "L", "power"},
        {"AreaLightSource \"diffuse\"" WITH_PICTURE, "L", "power"},
    };
#undef WITH_PICTURE
    char *folder = pbrt_folder_make(), one[FACTOR_TEXT], other[FACTOR_TEXT];
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image map;

    (void)state;
    direction_map(&map, 0);
    assert_int_equal(exr_encode(&file, &map, &(struct exr_options){0}, &err), STATUS_OK);
    pbrt_folder_put(folder, "e.exr", file.data, file.size);
    for (size_t i = 0; i < sizeof lamps / sizeof *lamps; i++)
        for (int v3 = 0; v3 < 2; v3++) {
            const char *lamp = lamps[i].lamp, *name = lamps[i].name, *flux = lamps[i].flux;
            write_lamp(one, v3, lamp, name, flux, 4, 1, 0);
            write_lamp(other, v3, lamp, name, flux, 1, 4, 0);
            assert_same_scene(folder, one, other);
            if (v3) /* there is no flux */
                continue;
            write_lamp(one, v3, lamp, name, flux, 1, 1, 4);
            write_lamp(other, v3, lamp, name, flux, 1, 4, 1);
            assert_same_scene(folder, one, other);
            write_lamp(other, v3, lamp, name, flux, 4, 1, 1);
            assert_same_scene(folder, one, other);
        }
    image_release(&map);
    buffer_release(&file);
    pbrt_folder_remove(folder);
}

static void write_medium(char out[FACTOR_TEXT], int way, const char *values)
{
    snprintf(out, FACTOR_TEXT, "%sWorldBegin MakeNamedMedium \"m\" \"string type\" %s %s MediumInterface \"m\" \"\" %s Shape \"sphere\" " LAMP,
             way & 1 ? "Film \"image\" " EYE : RIGHT_HANDED,
             !(way & 2) ? "\"homogeneous\""
             : way & 1  ? "\"heterogeneous\" \"integer nx\" 2 \"float density\" [1 3]"
                        : "\"uniformgrid\" \"integer nx\" 2 \"float density\" [1 3]",
             values, way & 1 ? "Material \"none\"" : "Material \"interface\"");
}

/* Of a medium `scale` multiplies its coefficients, and so what it emits; Lescale the radiance alone. */
static void test_factors_of_media(void **state)
{
    static const struct { const char *factors, *values; } rows[] = {
        {"\"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [4 5 6] \"float scale\" 4", "\"rgb sigma_a\" [4 8 12] \"rgb sigma_s\" [16 20 24]"},
        {"\"rgb sigma_a\" [1 2 3] \"rgb Le\" [.5 1 2] \"float scale\" 4", "\"rgb sigma_a\" [4 8 12] \"rgb sigma_s\" [4 4 4] \"rgb Le\" [.5 1 2]"},
        {"\"rgb sigma_a\" [1 2 3] \"rgb Le\" [.5 1 2] \"float Lescale\" 4", "\"rgb sigma_a\" [1 2 3] \"rgb Le\" [2 4 8]"},
        {"\"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [4 5 6] \"rgb Le\" [.5 1 2] \"float scale\" .25 \"float Lescale\" 4",
         "\"rgb sigma_a\" [.25 .5 .75] \"rgb sigma_s\" [1 1.25 1.5] \"rgb Le\" [2 4 8]"},
    };
    char one[FACTOR_TEXT], other[FACTOR_TEXT];

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        for (int way = 0; way < 4; way++) {
            if (i == 1 && way & 1)
                continue; /* pbrt-v3's sigma_s is not 1 where it is not said */
            write_medium(one, way, rows[i].factors);
            write_medium(other, way, rows[i].values);
            assert_same_scene(NULL, one, other);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point_lights),
        cmocka_unit_test(test_version3),
        cmocka_unit_test(test_mirrored_light),
        cmocka_unit_test(test_light_spectra),
        cmocka_unit_test(test_area_lights),
        cmocka_unit_test(test_constant_environment),
        cmocka_unit_test(test_environment_maps),
        cmocka_unit_test(test_image_lights),
        cmocka_unit_test(test_media),
        cmocka_unit_test(test_media_of_both_versions),
        cmocka_unit_test(test_dense), cmocka_unit_test(test_grid), cmocka_unit_test(test_one_lamp_of_many_shapes),
        cmocka_unit_test(test_factors_of_lamps),
        cmocka_unit_test(test_factors_of_media),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
