/* pbrt: words, files, matrices, cameras, objects and motion. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <zlib.h>

#include "client/import/pbrt/read/pbrt_token.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"
#include "tests/support/starve.h"

/* ---- words and files ---------------------------------------------------------------------- */

static void test_words(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("# a comment \"with\" [words]\n" RIGHT_HANDED "WorldBegin#no blank needed\n" LAMP
               "Material\"diffuse\"\"rgb reflectance\"[.1 2e-1 +0.3]"
               "Shape \"trianglemesh\"\n\t\"integer indices\" [0 1 2]\r\n"
               "\"point3 P\" [ 0 0 0  1 0 0  0 1 0 ]\nWorldEnd\n",
               NULL, &r);
    assert_int_equal(r.scene.instance_count, 1);
    assert_floats(r.scene.materials[0].base_color, (const float[]){0.1f, 0.2f, 0.3f, 1}, 4, 1e-6f);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
}

static void test_errors_name_their_place(void **state)
{
    static const char *const bad[][2] = {
        {"WorldBegin\n\nFoo", "a.pbrt:3: |\"Foo\" is not a directive"},
        {"WorldBegin\nShape \"sphere\" \"float radius\" [1 x]", "a.pbrt:2: |radius|x"},
        {"WorldBegin\nShape \"sphere\" \"float radius\" [1 2", "a.pbrt:2: |no closing bracket"},
        {"WorldBegin\nShape \"sphere", "a.pbrt:2: |no closing quote"},
        {"WorldBegin\nShape \"sphere\" \"flat radius\" 1", "a.pbrt:2: |not a parameter"},
        {"WorldBegin Shape \"sphere\" \"point3 P\" [1 2]", "2 numbers|by 3"},
        {"Translate 1 2", "Translate takes 3 numbers"},
        {"Translate 1 2 nan", "Translate takes 3 numbers"},
        {"Scale 1 2 0x10", "Scale takes 3 numbers"},
        {"Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0]", "a.pbrt:1: |perspective"},
        {"LookAt 0 0 0 0 0 1 0 0 2", "a.pbrt:1: |parallel"},
        {"WorldBegin\nAttributeEnd", "a.pbrt:2: |there is nothing to end"},
        {"WorldBegin\nAttributeBegin\nTransformEnd", "a.pbrt:3: |AttributeBegin must be ended"},
        {"Shape \"sphere\"", "must come after WorldBegin"},
        {"WorldBegin WorldBegin", "twice"},
        {"WorldBegin Camera \"perspective\"", "before WorldBegin"},
        {"WorldBegin NamedMaterial \"x\" Shape \"sphere\"", "\"x\" is not known"},
        {"WorldBegin ObjectInstance \"x\"", "\"x\" is not known"},
        {"WorldBegin ObjectBegin \"x\" ObjectBegin \"y\"", "inside of another"},
        {"WorldBegin ObjectBegin \"x\" ObjectInstance \"x\"", "object definition"},
        {"Include \"other.pbrt\"", "a.pbrt:1: |read from a folder"},
        {"WorldBegin Shape \"plymesh\" \"string filename\" \"a.ply\"", "read from a folder"},
        {"Camera \"realistic\" WorldBegin", "a.pbrt:1: |\"realistic\" is not supported|perspective"},
        {"ColorSpace \"foo\"", "foo|rec2020"},
        {"ActiveTransform Sometimes", "StartTime"},
        {"TransformTimes 1 1", "later end"},
        {"WorldBegin Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] "
         "\"integer indices\" [0 1 3]", "indices|holds 3|3 vertices"},
        {"WorldBegin Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1e16 0] "
         "\"integer indices\" [0 1 2]", "P|1e+16"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        pbrt_refused(bad[i][0], bad[i][1]);
}

static void test_includes(void **state)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    char *folder = pbrt_folder_make();
    const char *loop = "Include \"loop.pbrt\"", *up = "Include \"../../../../../etc/passwd\"",
               *absolute = "Include \"/etc/passwd\"", *gone = "\nInclude \"gone.pbrt\"",
               *bad = "WorldBegin Include \"bad.pbrt\"";
    const char *part = "Material \"diffuse\" \"rgb reflectance\" [.25 .25 .25] " TRIANGLE;
    struct import_result r;
    struct error err = {0};

    (void)state;
    pbrt_folder_put(folder, "part.pbrt", part, strlen(part));
    pbrt_folder_put(folder, "loop.pbrt", loop, strlen(loop));
    pbrt_folder_put(folder, "bad.pbrt", "\n\nFoo", 5);
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Include \"part.pbrt\" " TRIANGLE, folder, &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_int_equal(r.scene.instances[0].material, r.scene.instances[1].material);
    import_result_release(&r);
    /* What an import does to the state stays in it. */
    pbrt_whole(RIGHT_HANDED "WorldBegin " LAMP "Import \"part.pbrt\" " TRIANGLE, folder, &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_true(r.scene.materials[r.scene.instances[0].material].base_color[0] == 0.25f);
    assert_true(r.scene.materials[r.scene.instances[1].material].base_color[0] == 0.5f);
    import_result_release(&r);
    assert_int_equal(import_scene_memory(loop, strlen(loop), "a.pbrt", folder, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "loop.pbrt:1: |includes itself");
    assert_int_equal(import_scene_memory(up, strlen(up), "a.pbrt", folder, &options, &r, &err),
                     STATUS_ERR_FORBIDDEN);
    assert_says(&err, "a.pbrt:1: |--allow-outside /etc");
    assert_int_equal(import_scene_memory(absolute, strlen(absolute), "a.pbrt", folder, &options,
                                         &r, &err),
                     STATUS_ERR_FORBIDDEN);
    assert_says(&err, "a.pbrt:1: |--allow-outside /etc");
    assert_int_equal(import_scene_memory(gone, strlen(gone), "a.pbrt", folder, &options, &r, &err),
                     STATUS_ERR_INPUT);
    assert_says(&err, "a.pbrt:2: |gone.pbrt|does not exist");
    assert_int_equal(import_scene_memory(bad, strlen(bad), "a.pbrt", folder, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "bad.pbrt:3: |Foo");
    pbrt_folder_remove(folder);
}

/* A file may end between a directive and its name, over and over, at the same depth. */
static void test_import_at_the_end_of_an_import(void **state)
{
    char *folder = pbrt_folder_make(), text[4096];
    const char *part = "Material \"diffuse\" \"rgb reflectance\" [.25 .25 .25] " TRIANGLE;
    struct import_result r;
    size_t length;

    (void)state;
    pbrt_folder_put(folder, "part.pbrt", part, strlen(part));
    pbrt_folder_put(folder, "tail.pbrt", "Import", 6);
    snprintf(text, sizeof text, "%s", RIGHT_HANDED "WorldBegin " LAMP "Import ");
    for (int i = 0; i < 2 * PBRT_INCLUDE_DEPTH_MAX; i++) {
        length = strlen(text);
        snprintf(text + length, sizeof text - length, "\"tail.pbrt\" ");
    }
    length = strlen(text);
    snprintf(text + length, sizeof text - length, "\"part.pbrt\" %s", TRIANGLE);
    pbrt_whole(text, folder, &r);
    assert_int_equal(r.scene.instance_count, 2);
    assert_true(r.scene.materials[r.scene.instances[0].material].base_color[0] == 0.25f);
    assert_true(r.scene.materials[r.scene.instances[1].material].base_color[0] == 0.5f);
    import_result_release(&r);
    pbrt_folder_remove(folder);
}

static size_t gzip(const char *text, uint8_t *out, size_t size)
{
    z_stream z = {0};

    assert_int_equal(deflateInit2(&z, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
    z.next_in = (Bytef *)(uintptr_t)text;
    z.avail_in = (uInt)strlen(text);
    z.next_out = out;
    z.avail_out = (uInt)size;
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    size -= z.avail_out;
    deflateEnd(&z);
    return size;
}

static void test_gzip(void **state)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result r;
    struct error err = {0};
    uint8_t packed[512];
    size_t size = gzip(RIGHT_HANDED "WorldBegin " LAMP TRIANGLE, packed, sizeof packed);

    (void)state;
    assert_int_equal(import_scene_memory(packed, size, "a.pbrt.gz", NULL, &options, &r, &err), STATUS_OK);
    assert_int_equal(r.scene.instance_count, 1);
    import_result_release(&r);
    assert_int_equal(import_scene_memory(packed, size - 9, "a.pbrt.gz", NULL, &options, &r, &err), STATUS_ERR_INPUT);
    assert_says(&err, "damaged gzip");
    import_result_release(&r);
}

static void test_unknown_parameters(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "\nShape \"sphere\" \"float radius\" 2\n\"float raduis\" 3", &r);
    pbrt_warned(&r, "a.pbrt:6: |shape \"sphere\"|\"float raduis\"");
    import_result_release(&r);
    pbrt_world(LAMP "Material \"diffuse\" \"float sigma\" 3 " TRIANGLE, &r);
    pbrt_warned(&r, "material \"diffuse\"|\"float sigma\"");
    import_result_release(&r);
    pbrt_world("LightSource \"point\" \"float I\" 3 " TRIANGLE, &r); /* of the wrong type */
    pbrt_warned(&r, "light \"point\"|\"float I\"");
    import_result_release(&r);
    pbrt_world(LAMP "Shape \"nurbs\" " TRIANGLE, &r);
    pbrt_warned(&r, "a.pbrt:|\"nurbs\" is not supported: left out");
    assert_int_equal(r.scene.instance_count, 1);
    import_result_release(&r);
}

/* ---- cameras ------------------------------------------------------------------------------ */

static void assert_camera(const struct import_result *r, const float right[3], const float up[3], const float back[3],
                          const float at[3])
{
    const struct transform_d *m = &r->scene.cameras[0].to_world;

    for (int i = 0; i < 3; i++) {
        assert_true(fabs(m->m[i][0] - (double)right[i]) < 1e-6);
        assert_true(fabs(m->m[i][1] - (double)up[i]) < 1e-6);
        assert_true(fabs(m->m[i][2] - (double)back[i]) < 1e-6);
        assert_true(fabs(m->m[i][3] + r->scene.origin[i] - (double)at[i]) < 1e-6);
    }
}

/* In pbrt's world the right of a camera at +z that looks at the origin is -x. We mirror z: what
 * stood at z stands at -z, and the camera sees the same picture. */
static void test_handedness(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\" WorldBegin " LAMP "Translate 1 2 3 " TRIANGLE, NULL,
               &r);
    assert_camera(&r, (const float[]){-1, 0, 0}, (const float[]){0, 1, 0}, (const float[]){0, 0, -1},
                  (const float[]){0, 0, -5});
    assert_matrix_in_file(&r.scene, &r.scene.instances[0].to_world,
                          (const double[]){1, 0, 0, 1, 0, 1, 0, 2, 0, 0, -1, -3}, 1e-12);
    import_result_release(&r);
    /* A mirrored camera matrix: the file's world is right-handed already. */
    pbrt_world(LAMP "Translate 1 2 3 " TRIANGLE, &r);
    assert_camera(&r, (const float[]){1, 0, 0}, (const float[]){0, 1, 0}, (const float[]){0, 0, 1},
                  (const float[]){0, 0, 5});
    assert_matrix_in_file(&r.scene, &r.scene.instances[0].to_world,
                          (const double[]){1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3}, 1e-12);
    import_result_release(&r);
    pbrt_whole("Transform [1 0 0 0  0 1 0 0  0 0 -1 0  0 -1 6.8 1] Camera \"perspective\" "
               "WorldBegin " LAMP TRIANGLE,
               NULL, &r);
    assert_camera(&r, (const float[]){1, 0, 0}, (const float[]){0, 1, 0}, (const float[]){0, 0, 1},
                  (const float[]){0, 1, 6.8f});
    import_result_release(&r);
}

#define DEGREES(x) ((float)((x) * PI_D / 180))

static void test_perspective(void **state)
{
    static const struct {
        const char *film, *camera;
        float yfov, aspect;
    } cases[] = {
        {"200 \"integer yresolution\" 100", "\"float fov\" 60", DEGREES(60), 2},
        /* fov is that of the shorter side: here the width. */
        {"100 \"integer yresolution\" 200", "\"float fov\" 90", 2 * 1.1071487f, 0.5f},
        {"100 \"integer yresolution\" 100", "\"float screenwindow\" [-2 2 -1 1]", DEGREES(90), 2},
        {"100 \"integer yresolution\" 100", "\"float frameaspectratio\" 3", DEGREES(90), 3},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct buffer text = BUFFER_INIT;
        struct import_result r;
        buffer_printf(&text,
                      "Film \"rgb\" \"integer xresolution\" %s Camera \"perspective\" %s "
                      "WorldBegin " LAMP TRIANGLE,
                      cases[i].film, cases[i].camera);
        pbrt_whole(buffer_text(&text), NULL, &r);
        assert_float_equal(r.scene.cameras[0].yfov_rad, cases[i].yfov, 1e-5f);
        assert_float_equal(r.scene.cameras[0].aspect, cases[i].aspect, 1e-5f);
        import_result_release(&r);
        buffer_release(&text);
    }
}

static void test_other_cameras(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("Scale .5 .5 .5 Camera \"orthographic\" \"float screenwindow\" [-2 2 -1 1] "
               "\"float lensradius\" .1 \"float focaldistance\" 4 WorldBegin " LAMP TRIANGLE,
               NULL, &r);
    assert_int_equal(r.scene.cameras[0].kind, CAMERA_ORTHOGRAPHIC);
    assert_float_equal(r.scene.cameras[0].xmag, 4, 1e-6f); /* a camera that is scaled by 2 */
    assert_float_equal(r.scene.cameras[0].ymag, 2, 1e-6f);
    assert_float_equal(r.scene.cameras[0].lens_radius, 0.2f, 1e-6f);
    assert_float_equal(r.scene.cameras[0].focus_distance, 8, 1e-6f);
    import_result_release(&r);
    /* The middle of pbrt's panorama is -x, the right of that -z, in a right-handed world. */
    pbrt_whole("Film \"rgb\" Camera \"spherical\" \"string mapping\" \"equirectangular\" WorldBegin " LAMP TRIANGLE, NULL, &r);
    assert_int_equal(r.scene.cameras[0].kind, CAMERA_PANORAMA);
    assert_camera(&r, (const float[]){0, 0, -1}, (const float[]){0, 1, 0}, (const float[]){1, 0, 0},
                  (const float[]){0, 0, 0});
    assert_true(r.scene.instances[0].to_world.m[2][2] == 1);
    assert_int_equal(r.warning_count, 0);
    import_result_release(&r);
    pbrt_whole("Camera \"spherical\" WorldBegin " LAMP TRIANGLE, NULL, &r);
    pbrt_warned(&r, "equalarea");
    import_result_release(&r);
}

static void test_hints(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_whole("Film \"rgb\" \"integer xresolution\" 640 \"integer yresolution\" 480 "
               "\"string filename\" \"a.exr\" \"float iso\" 400 \"float exposuretime\" .5 "
               "Sampler \"zsobol\" \"integer pixelsamples\" 64 Integrator \"volpath\" "
               "\"integer maxdepth\" 17 Option \"integer seed\" 3 Option \"bool forcediffuse\" true "
               "PixelFilter \"gaussian\" \"float xradius\" 2 " EYE "WorldBegin " LAMP TRIANGLE,
               NULL, &r);
    assert_int_equal(r.hints.width, 640);
    assert_int_equal(r.hints.height, 480);
    assert_int_equal(r.hints.spp, 64);
    assert_true(r.hints.has_max_depth && r.hints.max_depth == 17);
    assert_float_equal(r.scene.cameras[0].exposure_ev, 1, 1e-6f); /* twice the light */
    assert_true(r.hints.has_filter && r.hints.pixel_filter == PIXEL_FILTER_GAUSSIAN && r.hints.filter_width == 3);
    pbrt_warned(&r, "Option|forcediffuse");
    assert_false(pbrt_has_warned(&r, "seed"));
    import_result_release(&r);
}

/* The time of exposure is pbrt-v4's shutter (film.cpp); pbrt-v3's film has a scale. In stops. */
static void test_exposure(void **state)
{
    static const struct {
        const char *text;
        float stops;
    } cases[] = {
        {RIGHT_HANDED, 0},
        {RIGHT_HANDED "\"float shutteropen\" 1 \"float shutterclose\" 5 ", 2},
        {"Film \"rgb\" \"float iso\" 50 " EYE "\"float shutterclose\" .5 ", -2},
        {"Film \"rgb\" \"float exposuretime\" 2 " EYE "\"float shutterclose\" .5 ", 1},
        {"Film \"image\" \"float scale\" 8 " EYE "\"float shutterclose\" .5 ", 3},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_result r;
        char text[512];
        snprintf(text, sizeof text, "%s WorldBegin " LAMP TRIANGLE, cases[i].text);
        pbrt_whole(text, NULL, &r);
        if (fabsf(r.scene.cameras[0].exposure_ev - cases[i].stops) > 1e-5f)
            fail_msg("case %zu: %g", i, (double)r.scene.cameras[0].exposure_ev);
        assert_int_equal(r.warning_count, 0);
        import_result_release(&r);
    }
}

/* A filter's width by the radius, or by the deviation, which pbrt-v3 gives as 1 / (2 sigma^2); both programs' defaults. */
static void test_filters(void **state)
{
    static const struct {
        const char *text;
        enum pixel_filter filter;
        double width;
    } cases[] = {
        {"\"box\"", PIXEL_FILTER_BOX, 1},
        {"\"box\" \"float xradius\" 1 \"float yradius\" 1", PIXEL_FILTER_BOX, 2},
        {"\"triangle\"", PIXEL_FILTER_TRIANGLE, 4},
        {"\"triangle\" \"float xradius\" .75 \"float yradius\" .75", PIXEL_FILTER_TRIANGLE, 1.5},
        {"\"gaussian\"", PIXEL_FILTER_GAUSSIAN, 3},
        {"\"gaussian\" \"float sigma\" .25", PIXEL_FILTER_GAUSSIAN, 1.5},
        {"\"gaussian\" \"float alpha\" 2 \"float xradius\" 2 \"float yradius\" 2", PIXEL_FILTER_GAUSSIAN, 3},
        {"\"gaussian\" \"float alpha\" .5 \"float xradius\" 3 \"float yradius\" 3", PIXEL_FILTER_GAUSSIAN, 6},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_result r;
        char text[512];
        snprintf(text, sizeof text, "Film \"rgb\" PixelFilter %s " EYE "WorldBegin " LAMP TRIANGLE, cases[i].text);
        pbrt_whole(text, NULL, &r);
        if (!r.hints.has_filter || r.hints.pixel_filter != cases[i].filter || fabs((double)r.hints.filter_width - cases[i].width) > 1e-6)
            fail_msg("%s: %d, %g", cases[i].text, (int)r.hints.pixel_filter, (double)r.hints.filter_width);
        assert_int_equal(r.warning_count, 0);
        import_result_release(&r);
    }
    struct import_result none;
    pbrt_whole(EYE "WorldBegin " LAMP TRIANGLE, NULL, &none);
    assert_false(none.hints.has_filter);
    import_result_release(&none);
}

/* What would change pbrt's picture and is not done is named with its line; what is as pbrt has it
 * anyway is not. */
static void test_hints_not_taken(void **state)
{
    static const struct {
        const char *text, *words;
    } cases[] = {
        {"Integrator \"path\" \"bool regularize\" true", "regularize"},
        {"Integrator \"ambientocclusion\"", "integrator|ambientocclusion"},
        {"Integrator \"path\" \"integer maxdepth\" 5000", "5000|1024"},
        {"Film \"rgb\" \"float maxcomponentvalue\" 10", "maxcomponentvalue|10"},
        {"Film \"image\" \"float maxsampleluminance\" 10", "maxsampleluminance|no sample is clamped"},
        {"Film \"rgb\" \"float whitebalance\" 5000", "whitebalance|--white-balance"},
        {"Film \"rgb\" \"string sensor\" \"canon_eos_1d\"", "sensor|canon_eos_1d"},
        {"Film \"rgb\" \"float cropwindow\" [.5 .2 0 1]", "crop window"},
        {"Film \"rgb\" \"integer pixelbounds\" [2000 2005 0 1]", "crop window"},
        {"Film \"rgb\" \"integer xresolution\" 100000", "100000|65536"},
        {"Sampler \"halton\" \"integer pixelsamples\" 2000000", "2000000|1048576"},
        {"PixelFilter \"mitchell\"", "pixel filter|mitchell|blackman-harris"},
        {"PixelFilter \"blackman-harris\"", "pixel filter|blackman-harris"},
        {"PixelFilter \"box\" \"float xradius\" 1 \"float yradius\" 2", "yradius"},
        {"PixelFilter \"box\" \"float sigma\" 1", "pixel filter|sigma"},
        {"PixelFilter \"triangle\" \"float xradius\" 9", "18 pixels wide"},
        {"PixelFilter \"triangle\" \"float xradius\" 0", "0 pixels wide"},
        {"PixelFilter \"gaussian\" \"float sigma\" 1", "cut at 3|1.5 pixels"},
    };
    struct import_result r;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512], words[128];
        snprintf(text, sizeof text, "\n%s\n" EYE "WorldBegin " LAMP TRIANGLE, cases[i].text);
        snprintf(words, sizeof words, "a.pbrt:2: |%s", cases[i].words);
        pbrt_whole(text, NULL, &r);
        pbrt_warned(&r, words);
        import_result_release(&r);
    }
    pbrt_whole("Film \"rgb\" \"float maxcomponentvalue\" 1e38 \"float whitebalance\" 0 "
               "\"string sensor\" \"cie1931\" Integrator \"volpath\" \"bool regularize\" false " EYE
               "WorldBegin " LAMP TRIANGLE,
               NULL, &r);
    assert_int_equal(r.warning_count, 0);
    assert_int_equal(r.hints.max_depth, 5); /* pbrt's default */
    import_result_release(&r);
    pbrt_whole(EYE "WorldBegin " LAMP TRIANGLE, NULL, &r);
    pbrt_warned(&r, "a.pbrt:2: |no Film|pbrt-v4");
    assert_int_equal(r.warning_count, 1);
    import_result_release(&r);
    pbrt_world(LAMP TRIANGLE, &r);
    assert_int_equal(r.warning_count, 0);
    assert_true(r.hints.has_max_depth && r.hints.max_depth == 5); /* without an Integrator, too */
    import_result_release(&r);
}

/* The limits that a message names are those that hold. */
static void test_fov(void **state)
{
    struct import_result r;
    char text[256];
    const double good[] = {0.001, 179.9}, bad[] = {0.00099, 179.91, 180, 0, -10};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        snprintf(text, sizeof text, "Camera \"perspective\" \"float fov\" %g WorldBegin " LAMP TRIANGLE, good[i]);
        pbrt_whole(text, NULL, &r);
        import_result_release(&r);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(text, sizeof text, "Camera \"perspective\" \"float fov\" %g WorldBegin " LAMP TRIANGLE, bad[i]);
        pbrt_refused(text, "fov|0.001 to 179.9 degrees");
    }
}

/* ---- matrices, objects, motion ------------------------------------------------------------ */

static void assert_placed(const struct import_result *r, uint32_t instance, const float point[3], const float wanted[3])
{
    const struct vec3 got =
        in_file(&r->scene, &r->scene.instances[instance].to_world, (struct vec3){point[0], point[1], point[2]});

    assert_float_equal(got.x, wanted[0], 1e-5f);
    assert_float_equal(got.y, wanted[1], 1e-5f);
    assert_float_equal(got.z, wanted[2], 1e-5f);
}

static void test_matrices(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "AttributeBegin Translate 1 0 0 Rotate 90 0 0 1 Scale 2 1 1 " TRIANGLE
                    "CoordinateSystem \"here\" AttributeEnd\n"
                    "AttributeBegin Translate 9 9 9 Identity " TRIANGLE "AttributeEnd\n"
                    "TransformBegin CoordSysTransform \"here\" " TRIANGLE "TransformEnd\n"
                    "ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1] " TRIANGLE
                    "Rotate 60 1 1 1 Rotate 60 1 1 1 " TRIANGLE "CoordSysTransform \"camera\" " TRIANGLE,
               &r);
    assert_placed(&r, 0, (const float[]){1, 0, 0}, (const float[]){1, 2, 0});
    assert_placed(&r, 1, (const float[]){1, 0, 0}, (const float[]){1, 0, 0});
    assert_placed(&r, 2, (const float[]){0, 1, 0}, (const float[]){0, 0, 0});
    assert_placed(&r, 3, (const float[]){1, 0, 0}, (const float[]){6, 6, 7});
    /* A third of a turn about the diagonal takes x to y. */
    assert_placed(&r, 4, (const float[]){1, 0, 0}, (const float[]){5, 7, 7});
    assert_placed(&r, 5, (const float[]){0, 0, 5}, (const float[]){0, 0, 0});
    import_result_release(&r);
}

static void test_objects(void **state)
{
    struct import_result r;

    (void)state;
    pbrt_world(LAMP "ObjectBegin \"pair\" Translate 1 0 0 " TRIANGLE "Translate 1 0 0 " TRIANGLE "ObjectEnd\n"
                    "ObjectInstance \"pair\" Scale 2 2 2 ObjectInstance \"pair\"",
               &r);
    assert_int_equal(r.scene.instance_count, 4);
    assert_int_equal(r.scene.mesh_count, 1);
    assert_placed(&r, 0, (const float[]){0, 0, 0}, (const float[]){1, 0, 0});
    assert_placed(&r, 3, (const float[]){0, 0, 0}, (const float[]){4, 0, 0});
    for (uint32_t i = 0; i < 4; i++) { /* an instance is a part of its object, and a shape is the same in all of them */
        assert_string_equal(r.scene.instances[i].asset, "pair");
        assert_string_equal(r.scene.instances[i].name, i % 2 ? "trianglemesh 2" : "trianglemesh 1");
    }
    import_result_release(&r);
    pbrt_world("ObjectBegin \"o\" AreaLightSource \"diffuse\" " TRIANGLE "ObjectEnd "
               "ObjectInstance \"o\"", &r);
    pbrt_warned(&r, "area light in an object");
    assert_true(r.scene.materials[0].emission[0] == 0);
    import_result_release(&r);
}

static const struct scene_channel *channel_of(const struct import_result *r, enum scene_channel_path path)
{
    for (uint32_t i = 0; i < r->scene.channel_count; i++)
        if (r->scene.channels[i].path == path)
            return &r->scene.channels[i];
    return NULL;
}

/* What is said within a block ends with it: the scene is the one without. */
static void test_blocks_end(void **state)
{
    enum { OF_TRANSFORMS = 7 };
    static const char *const said[] = {
        "Translate 1 2 3 ", "Scale 2 3 4 ", "Rotate 30 1 2 3 ", "Identity ", "CoordSysTransform \"here\" ",
        "ActiveTransform StartTime ", "ActiveTransform EndTime ", /* here end those of OF_TRANSFORMS */
        "ReverseOrientation ", "Material \"conductor\" ", "NamedMaterial \"other\" ", "MediumInterface \"m\" \"\" ",
        "AreaLightSource \"diffuse\" \"rgb L\" [2 2 2] ", "ColorSpace \"rec2020\" ", "Attribute \"shape\" \"float alpha\" .5 ",
        "Attribute \"light\" \"float scale\" 3 ", "Attribute \"material\" \"float roughness\" .5 ",
    };
    static const struct {
        const char *begin, *end;
        size_t count;
    } blocks[] = {{"AttributeBegin ", "AttributeEnd ", sizeof said / sizeof *said}, {"TransformBegin ", "TransformEnd ", OF_TRANSFORMS}};
    static const char before[] =
        "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" MakeNamedMaterial \"other\" \"string type\" \"diffuse\" "
        "CoordinateSystem \"here\" Translate 0 1 0 Rotate 10 0 0 1 Material \"coateddiffuse\" \"rgb reflectance\" [.4 .2 .2] ";
    static const char after[] =
        TRIANGLE "Translate 5 0 0 " TRIANGLE "Shape \"sphere\" Material \"coateddiffuse\" \"rgb reflectance\" [.3 .5 .2] " TRIANGLE
                 "LightSource \"point\" \"rgb I\" [1 2 3] AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [2 1 1] " TRIANGLE "AttributeEnd ";
    struct import_result r;
    struct digest plain;
    char text[4096];

    (void)state;
    snprintf(text, sizeof text, "%s%s", before, after);
    pbrt_world(text, &r);
    plain = r.scene_digest;
    import_result_release(&r);
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++)
        for (size_t i = 0; i < blocks[b].count; i++) {
            snprintf(text, sizeof text, "%s%s%s%s%s", before, blocks[b].begin, said[i], blocks[b].end, after);
            pbrt_world(text, &r);
            if (!digest_equal(&plain, &r.scene_digest))
                fail_msg("%s%s%sleaves something", blocks[b].begin, said[i], blocks[b].end);
            import_result_release(&r);
            /* Without the block it matters. */
            snprintf(text, sizeof text, "%s%s%s", before, said[i], after);
            pbrt_world(text, &r);
            if (digest_equal(&plain, &r.scene_digest))
                fail_msg("%schanges nothing", said[i]);
            import_result_release(&r);
        }
}

static void test_motion(void **state)
{
    const struct scene_channel *c;
    struct import_result r;

    (void)state;
    pbrt_whole("TransformTimes 0 2 Scale -1 1 1 Camera \"perspective\" \"float shutteropen\" .5 "
               "\"float shutterclose\" 1.5 WorldBegin " LAMP
               "Translate 1 0 0 ActiveTransform EndTime Translate 2 0 0 Rotate 90 0 0 1 "
               "Scale 3 3 3 ActiveTransform All " TRIANGLE TRIANGLE,
               NULL, &r);
    assert_int_equal(r.scene.node_count, 2); /* a place, and what moves there: both follow it */
    assert_int_equal(r.scene.instances[0].node, 1);
    assert_int_equal(r.scene.instances[1].node, 1);
    assert_doubles(r.scene.nodes[0].translation, (const double[]){1, 0, 0}, 3, 0);
    assert_placed(&r, 0, (const float[]){0, 0, 0}, (const float[]){1, 0, 0});
    c = channel_of(&r, PATH_TRANSLATION);
    assert_non_null(c);
    assert_floats(c->times, (const float[]){0, 2}, 2, 0);
    assert_floats(c->values, (const float[]){0, 0, 0, 2, 0, 0}, 6, 1e-6f);
    c = channel_of(&r, PATH_ROTATION);
    assert_non_null(c);
    assert_floats(c->values, (const float[]){0, 0, 0, 1, 0, 0, 0.70710678f, 0.70710678f}, 8, 1e-6f);
    c = channel_of(&r, PATH_SCALE);
    assert_non_null(c);
    assert_floats(c->values, (const float[]){1, 1, 1, 3, 3, 3}, 6, 1e-6f);
    assert_true(r.scene.cameras[0].shutter_open_s == 0.5f && r.scene.cameras[0].shutter_close_s == 1.5f);
    import_result_release(&r);
    /* Nothing moves: the shutter does not matter. */
    pbrt_world(LAMP TRIANGLE, &r);
    assert_true(r.scene.cameras[0].shutter_close_s == r.scene.cameras[0].shutter_open_s);
    import_result_release(&r);
}

/* The mirrored world's motion: the node with its scale must be what pbrt_to_world gives. */
static void test_mirrored_motion(void **state)
{
    struct import_result r;
    const struct scene_node *n;
    struct transform_d pose;
    double wanted[12];

    (void)state;
    pbrt_whole("Camera \"perspective\" WorldBegin " LAMP
               "Translate 1 2 3 Rotate 40 1 2 3 Scale 2 2 2 ActiveTransform EndTime "
               "Translate 1 0 0 " TRIANGLE,
               NULL, &r);
    assert_int_equal(r.scene.node_count, 2);
    n = r.scene.nodes;
    pose = transform_d_from_trs(n[0].translation, n[1].rotation, n[1].scale);
    memcpy(wanted, pose.m, sizeof wanted);
    assert_matrix_in_file(&r.scene, &r.scene.instances[0].to_world, wanted, 1e-12);
    assert_true(transform_d_determinant(&pose) < 0);
    import_result_release(&r);
}

static void test_camera_motion(void **state)
{
    const struct scene_channel *c;
    struct import_result r;

    (void)state;
    pbrt_whole("Scale -1 1 1 ActiveTransform EndTime Translate 0 0 -2 ActiveTransform All "
               "Camera \"perspective\" WorldBegin " LAMP TRIANGLE, NULL, &r);
    assert_int_equal(r.scene.cameras[0].node, 1);
    assert_null(channel_of(&r, PATH_ROTATION));
    c = channel_of(&r, PATH_TRANSLATION);
    assert_non_null(c);
    assert_floats(c->values, (const float[]){0, 0, 0, 0, 0, 2}, 6, 1e-6f);
    assert_true(r.scene.cameras[0].shutter_close_s == 1);
    import_result_release(&r);
}

/* Whichever allocation fails: an error, nothing kept. */
static status read_every_directive(void *user)
{
    static const char text[] =
        RIGHT_HANDED "WorldBegin LightSource \"infinite\" \"blackbody L\" 5000 AttributeBegin "
                     "Texture \"c\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [1 0 0] "
                     "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"texture reflectance\" \"c\" "
                     "MakeNamedMaterial \"b\" \"string type\" \"dielectric\" \"float odd\" 1 "
                     "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [\"a\" \"b\"] "
                     "MakeNamedMedium \"f\" \"string type\" \"uniformgrid\" \"float density\" 1 "
                     "MediumInterface \"f\" \"\" NamedMaterial \"m\" " TRIANGLE "AttributeEnd "
                     "ObjectBegin \"o\" " TRIANGLE "ObjectEnd ActiveTransform EndTime Translate 1 0 0 "
                     "ObjectInstance \"o\" AreaLightSource \"diffuse\" " TRIANGLE;

    (void)user;
    return pbrt_read_only(text);
}

static void test_out_of_memory(void **state)
{
    (void)state;
    assert_true(starve_each(read_every_directive, NULL, 3) > 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_words),
        cmocka_unit_test(test_errors_name_their_place),
        cmocka_unit_test(test_includes),
        cmocka_unit_test(test_import_at_the_end_of_an_import),
        cmocka_unit_test(test_gzip),
        cmocka_unit_test(test_unknown_parameters),
        cmocka_unit_test(test_handedness),
        cmocka_unit_test(test_perspective),
        cmocka_unit_test(test_other_cameras),
        cmocka_unit_test(test_hints),
        cmocka_unit_test(test_filters),
        cmocka_unit_test(test_exposure),
        cmocka_unit_test(test_hints_not_taken),
        cmocka_unit_test(test_fov),
        cmocka_unit_test(test_matrices),
        cmocka_unit_test(test_blocks_end),
        cmocka_unit_test(test_objects),
        cmocka_unit_test(test_motion),
        cmocka_unit_test(test_mirrored_motion),
        cmocka_unit_test(test_camera_motion),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
