/* From a file to radiance: what shapes, pictures and colours of every format look like in the end,
 * against closed forms.
 *
 * Shapes: a shape that shines with radiance 1 before an orthographic camera covers its projected
 * area, which is known; the picture's mean tells it. Nothing is random but the place within the
 * pixel, so tolerances are those of the tessellation and of that; seeds are fixed.
 * Pictures: each quadrant has a colour of its own, so that what is mirrored, swapped between
 * channels, or not decoded, is another picture. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
#include <webp/encode.h>

#include "common/base/buffer.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "tests/support/imported.h"
#include "tests/support/pbrt_text.h"

enum { SIDE = 64, VALUES = SIDE * SIDE * 3 };

static const float *look(struct import_result *import, uint32_t spp)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, spp);
    static float picture[VALUES];

    imported_render(import, &settings, 0, picture);
    return picture;
}

/* A camera that sees the square from -half to half of the plane z = 0 from the front. */
static void look_straight(struct import_result *import, float half)
{
    struct scene_camera *c = &import->scene.cameras[0];

    scene_camera_default(c);
    c->name = "straight";
    c->kind = CAMERA_ORTHOGRAPHIC;
    c->xmag = c->ymag = half;
    c->to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 10}}};
}

/* ---- pbrt's shapes -------------------------------------------------------------------------- */

/* In pbrt's left-handed world: x right, y up, z away. The picture is 4 wide and high. */
#define STUDIO                                                                               \
    "LookAt 0 0 -10  0 0 0  0 1 0\n"                                                         \
    "Camera \"orthographic\" \"float screenwindow\" [-2 2 -2 2]\n"                           \
    "Film \"rgb\" \"integer xresolution\" 64 \"integer yresolution\" 64\n"                   \
    "WorldBegin\nMaterial \"diffuse\" \"rgb reflectance\" [0 0 0]\n"                         \
    "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"bool twosided\" true\n"
#define PI 3.14159265358979323846

/* Loop's limit surface of an octahedron of radius 2 goes through its limit vertices at radius 1
 * (valence 4: beta = 3/32, limit mask 1/2 and 1/8 each, and the neighbours cancel out). */
#define OCTAHEDRON                                                                           \
    "\"point3 P\" [2 0 0  -2 0 0  0 2 0  0 -2 0  0 0 2  0 0 -2] \"integer indices\" "        \
    "[0 2 4  2 1 4  1 3 4  3 0 4  2 0 5  1 2 5  3 1 5  0 3 5]"

/* Tubes are prisms of six sides whose width is right on average over all turns about their axis. */
enum { TURNS = 6 };

static const struct {
    const char *shape;
    double area, tolerance; /* relative */
    const char *axis;       /* to be turned about; NULL: not at all */
} shapes[] = {
    {"Shape \"sphere\" \"float radius\" 1.5", PI * 2.25, 0.004, NULL},
    {"Rotate 90 1 0 0 Shape \"sphere\" \"float radius\" 1.5 \"float zmin\" 0", PI * 2.25 / 2, 0.004, NULL},
    {"Shape \"disk\" \"float radius\" 1.5", PI * 2.25, 0.004, NULL},
    {"Rotate 60 0 1 0 Shape \"disk\" \"float radius\" 1.5 \"float innerradius\" 0.5", PI, 0.004, NULL},
    {"Rotate 90 0 1 0 Shape \"cylinder\" \"float radius\" 0.5 \"float zmin\" -1.5 \"float zmax\" 1", 2.5, 0.004, NULL},
    /* Seen along z a bilinear patch is its four corners' trapezium, however bent. */
    {"Shape \"bilinearmesh\" \"point3 P\" [-1.5 -1 0  1.5 -1 1  -0.5 1 1  0.5 1 0]", 4, 0.004, NULL},
    {"Shape \"trianglemesh\" \"point3 P\" [-1 -1 0  1 -1 0  0 1 0] \"integer indices\" [0 1 2]", 2,
     0.004, NULL},
    {"Shape \"curve\" \"string type\" \"flat\" \"float width\" 0.4 "
     "\"point3 P\" [-1.5 0 0  -0.5 0 0  0.5 0 0  1.5 0 0]", 1.2, 0.01, "1 0 0"},
    {"Shape \"curve\" \"string type\" \"cylinder\" \"float width0\" 0.6 \"float width1\" 0.2 "
     "\"point3 P\" [0 -1.5 0  0 -0.5 0  0 0.5 0  0 1.5 0]", 1.2, 0.01, "0 1 0"},
    {"Shape \"curve\" \"string type\" \"ribbon\" \"float width\" 0.4 "
     "\"normal N\" [0 0 -1 0 0 -1] \"point3 P\" [-1.5 0 0  -0.5 0 0  0.5 0 0  1.5 0 0]", 1.2, 0.01,
     NULL},
    {"Shape \"plymesh\" \"string filename\" \"square.ply\"", 4, 0.004, NULL},
};

static const char square_ply[] =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n4 0 1 2 3\n";

static double mean_of(const float *picture)
{
    double sum = 0;

    for (int i = 0; i < VALUES; i++)
        sum += (double)picture[i];
    return sum / VALUES;
}

static double area_of(const char *shape, const char *folder, const char *axis, int turn)
{
    struct import_result import;
    char text[1024];
    double area;

    snprintf(text, sizeof text, STUDIO "Rotate %d %s %s", turn * 60 / TURNS, axis ? axis : "0 0 1", shape);
    imported_text(text, "shape.pbrt", folder, &import);
    area = mean_of(look(&import, 16)) * 16;
    import_result_release(&import);
    return area;
}

static void test_shapes(void **state)
{
    char *folder = pbrt_folder_make();

    (void)state;
    pbrt_folder_put(folder, "square.ply", square_ply, sizeof square_ply - 1);
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        int turns = shapes[i].axis ? TURNS : 1;
        double area = 0;
        for (int turn = 0; turn < turns; turn++)
            area += area_of(shapes[i].shape, folder, shapes[i].axis, turn) / turns;
        if (fabs(area / shapes[i].area - 1) > shapes[i].tolerance)
            fail_msg("%s: area %.4f instead of %.4f", shapes[i].shape, area, shapes[i].area);
    }
    pbrt_folder_remove(folder);
}

static float at(const float *picture, double x, double y)
{
    int column = (int)((x + 2) / 4 * SIDE), row = (int)((2 - y) / 4 * SIDE);

    return picture[3 * (row * SIDE + column)];
}

static void test_loop_subdivision(void **state)
{
    struct import_result import;
    const float *picture;
    double area;

    (void)state;
    imported_text(STUDIO "Shape \"loopsubdiv\" \"integer levels\" 4 " OCTAHEDRON, "loop.pbrt", NULL, &import);
    picture = look(&import, 16);
    import_result_release(&import);
    area = mean_of(picture) * 16;
    assert_true(area > 2 && area < PI); /* convex, within the sphere through its vertices */
    assert_float_equal(at(picture, 0, 0.9), 1, 1e-6);
    assert_float_equal(at(picture, -0.9, 0), 1, 1e-6);
    assert_float_equal(at(picture, 0, -1.13), 0, 1e-6);
    assert_float_equal(at(picture, 1.13, 0), 0, 1e-6);
}

/* Where things are: a square to the right and up, half the size, is there and nowhere else. */
static void test_places(void **state)
{
    static const char *const placed[] = {
        "Translate 1 1 0 Scale 0.5 0.5 1 Shape \"plymesh\" \"string filename\" \"square.ply\"",
        "CoordSysTransform \"camera\" Translate 1 1 10 Scale 0.5 0.5 1 "
        "Shape \"plymesh\" \"string filename\" \"square.ply\"",
        "Transform [0.5 0 0 0  0 0.5 0 0  0 0 1 0  1 1 0 1] "
        "Shape \"plymesh\" \"string filename\" \"square.ply\"",
        "Translate 0 1 0 Rotate -90 0 0 1 Translate 0 1 0 Scale 0.5 0.5 1 "
        "Shape \"plymesh\" \"string filename\" \"square.ply\"",
    };
    char *folder = pbrt_folder_make();

    (void)state;
    pbrt_folder_put(folder, "square.ply", square_ply, sizeof square_ply - 1);
    for (size_t i = 0; i < sizeof placed / sizeof *placed; i++) {
        struct import_result import;
        const float *picture;
        char text[1024];
        snprintf(text, sizeof text, STUDIO "%s", placed[i]);
        imported_text(text, "place.pbrt", folder, &import);
        picture = look(&import, 16);
        import_result_release(&import);
        if (fabs(mean_of(picture) * 16 - 1) > 0.01 || at(picture, 1, 1) < 0.999f)
            fail_msg("%s: area %.3f, %.3f in its middle", placed[i], mean_of(picture) * 16, (double)at(picture, 1, 1));
    }
    pbrt_folder_remove(folder);
}

/* ---- pictures, by way of OBJ and MTL -------------------------------------------------------- */

enum { IMAGE = 16 };

/* Upper left, upper right, lower left, lower right. */
static const int quadrants[4][3] = {{230, 60, 20}, {40, 200, 90}, {15, 70, 240}, {120, 120, 10}};

static int code_at(int x, int y, int c) { return quadrants[2 * (y >= IMAGE / 2) + (x >= IMAGE / 2)][c]; }

enum format { PNG8, PNG16, JPEG, WEBP, EXR, HDR, FORMATS };

static const struct {
    const char *file;
    int linear;       /* holds radiance, LINEAR_SCALE times its codes */
    double tolerance; /* relative */
} formats[FORMATS] = {
    [PNG8] = {"p.png", 0, 1e-4},  [PNG16] = {"p16.png", 0, 1e-3}, [JPEG] = {"p.jpg", 0, 0.1},
    [WEBP] = {"p.webp", 0, 1e-4}, [EXR] = {"p.exr", 1, 1e-3},     [HDR] = {"p.hdr", 1, 0.02},
};
#define LINEAR_SCALE 0.05f

static void put_webp(const char *folder, const char *file)
{
    uint8_t codes[IMAGE * IMAGE * 3], *data = NULL;
    size_t size;

    for (int i = 0; i < IMAGE * IMAGE * 3; i++)
        codes[i] = (uint8_t)code_at(i / 3 % IMAGE, i / 3 / IMAGE, i % 3);
    size = WebPEncodeLosslessRGB(codes, IMAGE, IMAGE, IMAGE * 3, &data);
    assert_true(size > 0);
    pbrt_folder_put(folder, file, data, size);
    WebPFree(data);
}

/* Radiance's shared exponent, without run lengths. */
static void put_hdr(const char *folder, const char *file, const float *pixels)
{
    struct buffer out = BUFFER_INIT;

    buffer_printf(&out, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n", IMAGE, IMAGE);
    for (int i = 0; i < IMAGE * IMAGE; i++) {
        float top = fmaxf(pixels[3 * i], fmaxf(pixels[3 * i + 1], pixels[3 * i + 2]));
        uint8_t rgbe[4];
        int exponent;
        frexpf(top, &exponent);
        for (int c = 0; c < 3; c++)
            rgbe[c] = (uint8_t)(ldexpf(pixels[3 * i + c], 8 - exponent));
        rgbe[3] = (uint8_t)(exponent + 128);
        buffer_append(&out, rgbe, 4);
    }
    assert_true(buffer_ok(&out));
    pbrt_folder_put(folder, file, out.data, out.size);
    buffer_release(&out);
}

static void put_picture(const char *folder, enum format format)
{
    float pixels[IMAGE * IMAGE * 3];
    struct image image = {IMAGE, IMAGE, 3, pixels};
    struct picture_options how = {.plain = 1, .quality = 98, .bits = format == PNG16 ? 16 : 8};
    struct exr_options exr = {0};
    struct buffer out = BUFFER_INIT;
    struct error err = {0};
    status st = STATUS_OK;

    for (int i = 0; i < IMAGE * IMAGE * 3; i++)
        pixels[i] =
            (float)code_at(i / 3 % IMAGE, i / 3 / IMAGE, i % 3) * (formats[format].linear ? LINEAR_SCALE : 1.0f / 255);
    switch (format) {
    case PNG8:
    case PNG16: st = png_encode_as(&out, &image, &how, &err); break;
    case JPEG: st = jpeg_encode(&out, &image, &how, &err); break;
    case EXR: st = exr_encode(&out, &image, &exr, &err); break;
    case WEBP: put_webp(folder, formats[format].file); return;
    default: put_hdr(folder, formats[format].file, pixels); return;
    }
    assert_int_equal(st, STATUS_OK);
    pbrt_folder_put(folder, formats[format].file, out.data, out.size);
    buffer_release(&out);
}

/* v runs upwards in OBJ. */
static const char square_obj[] = "mtllib m.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
                                 "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nusemtl m\n"
                                 "f 1/1/1 2/2/1 3/3/1 4/4/1\n";

static void expect_quadrants(const float *picture, const char *what, int linear, double scale, double tolerance)
{
    for (int q = 0; q < 4; q++)
        for (int c = 0; c < 3; c++) {
            int x = SIDE / 4 + q % 2 * SIDE / 2, y = SIDE / 4 + q / 2 * SIDE / 2;
            double wanted =
                linear ? (double)LINEAR_SCALE * quadrants[q][c] : (double)srgb_decode((float)quadrants[q][c] / 255);
            double got = (double)picture[3 * (y * SIDE + x) + c];
            wanted *= scale;
            if (fabs(got / wanted - 1) > tolerance)
                fail_msg("%s: quadrant %d, channel %d: %.5f instead of %.5f", what, q, c, got, wanted);
        }
}

static void test_pictures(void **state)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    char *folder = pbrt_folder_make();
    struct error err = {0};

    (void)state;
    for (enum format format = 0; format < FORMATS; format++) {
        struct import_result import;
        char mtl[128];
        int size = snprintf(mtl, sizeof mtl, "newmtl m\nKd 0 0 0\nKe 2 2 2\nmap_Ke %s\n", formats[format].file);
        put_picture(folder, format);
        pbrt_folder_put(folder, "m.mtl", mtl, (size_t)size);
        assert_int_equal(import_scene_memory(square_obj, sizeof square_obj - 1, "square.obj",
                                             folder, &options, &import, &err), STATUS_OK);
        look_straight(&import, 1);
        expect_quadrants(look(&import, 4), formats[format].file, formats[format].linear, 2, formats[format].tolerance);
        import_result_release(&import);
    }
    pbrt_folder_remove(folder);
}

/* ---- a square in glTF ----------------------------------------------------------------------- */

/* A square from -1 to 1. The first set of coordinates runs as pictures do, the second one from right
 * to left. */
static const struct {
    float positions[4][3], uv0[4][2], uv1[4][2];
    uint16_t indices[6];
    float colors[4][4];
} square_bin = {.positions = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}},
                .uv0 = {{0, 1}, {1, 1}, {1, 0}, {0, 0}},
                .uv1 = {{1, 1}, {0, 1}, {0, 0}, {1, 0}},
                .indices = {0, 1, 2, 0, 2, 3},
                .colors = {{1, 0.5f, 0.25f, 0.25f}, {1, 0.5f, 0.25f, 0.25f},
                           {1, 0.5f, 0.25f, 0.25f}, {1, 0.5f, 0.25f, 0.25f}}};

#define SQUARE_GLTF                                                                               \
    "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"KHR_materials_unlit\","                 \
    "\"KHR_texture_transform\"],\"scenes\":[{\"nodes\":[0,1]}],"                                  \
    "\"nodes\":[{\"mesh\":0},{\"camera\":0,\"translation\":[0,0,10]}],"                           \
    "\"cameras\":[{\"type\":\"orthographic\",\"orthographic\":"                                   \
    "{\"xmag\":1,\"ymag\":1,\"znear\":1,\"zfar\":100}}],"                                         \
    "\"meshes\":[{\"primitives\":[{\"material\":0,\"indices\":3,"                                 \
    "\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1,\"TEXCOORD_1\":2%s}}]}],"                    \
    "\"buffers\":[{\"uri\":\"square.bin\",\"byteLength\":188}],\"bufferViews\":["                 \
    "{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,\"byteLength\":32},"        \
    "{\"buffer\":0,\"byteOffset\":80,\"byteLength\":32},"                                         \
    "{\"buffer\":0,\"byteOffset\":112,\"byteLength\":12},"                                        \
    "{\"buffer\":0,\"byteOffset\":124,\"byteLength\":64}],\"accessors\":["                        \
    "{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\","                     \
    "\"min\":[-1,-1,0],\"max\":[1,1,0]},"                                                         \
    "{\"bufferView\":1,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"},"                    \
    "{\"bufferView\":2,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"},"                    \
    "{\"bufferView\":3,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"},"                  \
    "{\"bufferView\":4,\"componentType\":5126,\"count\":4,\"type\":\"VEC4\"}],"                   \
    "\"images\":[{\"uri\":\"p.png\"}],\"textures\":[{\"source\":0}],"                             \
    "\"materials\":[{%s}]}"
_Static_assert(sizeof square_bin == 188, "as the text says");

/* With this material, and these attributes beside the usual ones. */
static void import_square(const char *material, const char *attributes, const char *folder,
                          struct import_result *import)
{
    char text[4096];

    snprintf(text, sizeof text, SQUARE_GLTF, attributes, material);
    imported_text(text, "square.gltf", folder, import);
}

/* For each, the quadrant of the picture that is seen in each quadrant, in the order of
 * `quadrants`. Turned: by the extension's u' = c u + s v, v' = -s u + c v. */
static const struct {
    const char *info;
    int shown[4];
} coordinates[] = {
    {"", {0, 1, 2, 3}},
    {",\"texCoord\":1", {1, 0, 3, 2}},
    {",\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":1}}", {1, 0, 3, 2}},
    {",\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0,0.5]}}", {2, 3, 0, 1}},
    {",\"extensions\":{\"KHR_texture_transform\":{\"scale\":[-1,1]}}", {1, 0, 3, 2}},
    {",\"extensions\":{\"KHR_texture_transform\":{\"rotation\":1.5707963}}", {2, 0, 3, 1}},
    /* Scaled first, then turned, then moved: (u, v) to (v, 0.5 - u / 2). */
    {",\"extensions\":{\"KHR_texture_transform\":{\"rotation\":1.5707963,\"scale\":[0.5,1],"
     "\"offset\":[0,0.5]}}", {0, 0, 1, 1}},
};

static void test_coordinates(void **state)
{
    char *folder = pbrt_folder_make();

    (void)state;
    put_picture(folder, PNG8);
    pbrt_folder_put(folder, "square.bin", &square_bin, sizeof square_bin);
    for (size_t i = 0; i < sizeof coordinates / sizeof *coordinates; i++) {
        struct import_result import;
        const float *picture;
        char material[1024];
        snprintf(material, sizeof material,
                 "\"extensions\":{\"KHR_materials_unlit\":{}},"
                 "\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0%s}}",
                 coordinates[i].info);
        import_square(material, "", folder, &import);
        picture = look(&import, 4);
        import_result_release(&import);
        for (int q = 0; q < 4; q++)
            for (int c = 0; c < 3; c++) {
                int x = SIDE / 4 + q % 2 * SIDE / 2, y = SIDE / 4 + q / 2 * SIDE / 2;
                float wanted = srgb_decode((float)quadrants[coordinates[i].shown[q]][c] / 255);
                float got = picture[3 * (y * SIDE + x) + c];
                if (fabsf(got - wanted) > 1e-4f)
                    fail_msg("%s: quadrant %d, channel %d: %.5f instead of %.5f", coordinates[i].info, q, c,
                             (double)got, (double)wanted);
            }
    }
    pbrt_folder_remove(folder);
}

enum { MARGIN = 2 }; /* where the pixels' filter sees more than the square */

static void expect_mean(struct import_result *import, const char *what, const double wanted[3], double tolerance)
{
    const float *picture = look(import, 64);

    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int y = MARGIN; y < SIDE - MARGIN; y++)
            for (int x = MARGIN; x < SIDE - MARGIN; x++)
                sum += (double)picture[3 * (y * SIDE + x) + c] / pow(SIDE - 2 * MARGIN, 2);
        if (fabs(sum / wanted[c] - 1) > tolerance)
            fail_msg("%s, channel %d: %.5f instead of %.5f", what, c, sum, wanted[c]);
    }
    import_result_release(import);
}

/* A quarter of the square is there, in the vertices' colours. */
static void test_vertex_colors(void **state)
{
    static const char *const modes[2] = {"OPAQUE", "BLEND"};
    char *folder = pbrt_folder_make();

    (void)state;
    put_picture(folder, PNG8);
    pbrt_folder_put(folder, "square.bin", &square_bin, sizeof square_bin);
    for (int blend = 0; blend < 2; blend++) {
        double share = blend ? 0.25 : 1;
        struct import_result import;
        char material[256];
        snprintf(material, sizeof material, "\"alphaMode\":\"%s\",\"extensions\":{\"KHR_materials_unlit\":{}}",
                 modes[blend]);
        import_square(material, ",\"COLOR_0\":4", folder, &import);
        expect_mean(&import, modes[blend], (const double[]){share, share * 0.5, share * 0.25}, 0.02);
    }
    pbrt_folder_remove(folder);
}

/* A lamp under a varnish of weight w, seen straight on: it keeps 0.04 w to itself. */
static void test_coated_lamp(void **state)
{
    static const double weights[] = {0, 0.5, 1};
    char *folder = pbrt_folder_make();

    (void)state;
    put_picture(folder, PNG8);
    pbrt_folder_put(folder, "square.bin", &square_bin, sizeof square_bin);
    for (size_t i = 0; i < sizeof weights / sizeof *weights; i++) {
        double radiance = 2 * (1 - 0.04 * weights[i]);
        struct import_result import;
        char material[512];
        snprintf(material, sizeof material,
                 "\"emissiveFactor\":[1,0.5,0.25],\"pbrMetallicRoughness\":{\"baseColorFactor\":"
                 "[0,0,0,1]},\"extensions\":{\"KHR_materials_emissive_strength\":{"
                 "\"emissiveStrength\":2},\"KHR_materials_clearcoat\":{\"clearcoatFactor\":%g}}",
                 weights[i]);
        import_square(material, "", folder, &import);
        expect_mean(&import, "coated lamp", (const double[]){radiance, radiance / 2, radiance / 4}, 1e-3);
    }
    pbrt_folder_remove(folder);
}

/* The same picture as a matt surface's reflectance under a white sky: radiance is reflectance. */
static void test_reflectance(void **state)
{
    static const char mtl[] = "newmtl m\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd p.png\n";
    char *folder = pbrt_folder_make();
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result import;
    struct error err = {0};

    (void)state;
    put_picture(folder, PNG8);
    pbrt_folder_put(folder, "m.mtl", mtl, sizeof mtl - 1);
    assert_int_equal(import_scene_memory(square_obj, sizeof square_obj - 1, "square.obj", folder,
                                         &options, &import, &err), STATUS_OK);
    look_straight(&import, 1);
    import.scene.environment.present = import.scene.environment.constant = 1;
    for (int c = 0; c < 3; c++)
        import.scene.environment.radiance[c] = 1;
    expect_quadrants(look(&import, 256), "map_Kd", 0, 1, 0.02);
    import_result_release(&import);
    pbrt_folder_remove(folder);
}

/* PLY's vertex colours are sRGB codes; seen without any shading. */
static void test_ply_colors(void **state)
{
    static const char ply[] = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                              "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                              "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                              "-1 -1 0 240 120 30\n1 -1 0 240 120 30\n1 1 0 240 120 30\n-1 1 0 240 120 30\n"
                              "4 0 1 2 3\n";
    const int codes[3] = {240, 120, 30};
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result import;
    struct error err = {0};
    const float *picture;

    (void)state;
    assert_int_equal(import_scene_memory(ply, sizeof ply - 1, "square.ply", NULL, &options, &import, &err), STATUS_OK);
    look_straight(&import, 2);
    import.scene.materials[0].unlit = 1;
    import.scene.environment.present = 0; /* a file without a light is given one */
    picture = look(&import, 4);
    for (int c = 0; c < 3; c++)
        assert_float_equal(picture[3 * (SIDE / 2 * SIDE + SIDE / 2) + c], srgb_decode((float)codes[c] / 255), 1e-5f);
    assert_true(picture[3 * (2 * SIDE + 2)] == 0); /* off the square */
    import_result_release(&import);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_loop_subdivision),
        cmocka_unit_test(test_places),
        cmocka_unit_test(test_pictures),
        cmocka_unit_test(test_coordinates),
        cmocka_unit_test(test_vertex_colors),
        cmocka_unit_test(test_coated_lamp),
        cmocka_unit_test(test_reflectance),
        cmocka_unit_test(test_ply_colors),
    };
    return cmocka_run_group_tests_name("from files to radiance", tests, NULL, NULL);
}
