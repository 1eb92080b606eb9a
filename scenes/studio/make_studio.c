/* make_studio: writes the textured spheres of this folder with their textures.
 *
 * Every pixel of a texture is a formula of its place, so that the files are the same each time.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/image/image.h"
#include "scenes/gltf_writer.h"

#define PI 3.14159265358979323846

enum { SEGMENTS = 64, RINGS = 32, TEXTURE_SIDE = 256 };

/* A unit sphere, +Y up; u runs around it eastwards seen from outside, v from the north pole
 * down. The tangent points along growing u; the bitangent along falling v (glTF: w = 1). */
static void build_sphere(struct shape *s)
{
    memset(s, 0, sizeof *s);
    s->has_normals = s->has_tangents = s->has_uvs = 1;
    for (int r = 0; r <= RINGS; r++)
        for (int k = 0; k <= SEGMENTS; k++) {
            /* The seam's two columns lie exactly on one another. */
            double theta = PI * r / RINGS, phi = 2 * PI * (k % SEGMENTS) / SEGMENTS;
            double n[3] = {sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi)};
            double t[4] = {cos(phi), 0, -sin(phi), 1};
            unsigned i;

            if (r == 0 || r == RINGS)
                n[0] = n[2] = 0;
            i = shape_add_vertex(s, n[0], n[1], n[2]);
            for (int c = 0; c < 3; c++)
                s->normals[i][c] = (float)n[c];
            for (int c = 0; c < 4; c++)
                s->tangents[i][c] = (float)t[c];
            s->uvs[i][0] = (float)k / SEGMENTS;
            s->uvs[i][1] = (float)r / RINGS;
        }
    for (unsigned r = 0; r < RINGS; r++)
        for (unsigned k = 0; k < SEGMENTS; k++) {
            unsigned a = r * (SEGMENTS + 1) + k, b = a + SEGMENTS + 1;

            if (r > 0) /* no empty triangles at the poles */
                shape_add_triangle(s, a, b, a + 1);
            if (r + 1 < RINGS)
                shape_add_triangle(s, a + 1, b, b + 1);
        }
}

/* A square of `side` metres around the origin facing up; the texture repeats `repeats` times. */
static void build_ground(struct shape *s, double side, double repeats)
{
    static const double signs[4][2] = {{-1, 1}, {1, 1}, {1, -1}, {-1, -1}};

    memset(s, 0, sizeof *s);
    s->has_normals = s->has_tangents = s->has_uvs = 1;
    for (int i = 0; i < 4; i++) {
        unsigned v = shape_add_vertex(s, signs[i][0] * side / 2, 0, signs[i][1] * side / 2);

        s->normals[v][1] = 1;
        s->tangents[v][0] = 1;
        s->tangents[v][3] = 1;
        s->uvs[v][0] = (float)((signs[i][0] + 1) / 2 * repeats);
        s->uvs[v][1] = (float)((signs[i][1] + 1) / 2 * repeats);
    }
    shape_add_triangle(s, 0, 1, 2);
    shape_add_triangle(s, 0, 2, 3);
}

/* A lamp facing down. */
static void build_lamp(struct shape *s, double side)
{
    const double h = side / 2;
    const double corners[4][3] = {{-h, 0, -h}, {h, 0, -h}, {h, 0, h}, {-h, 0, h}};

    memset(s, 0, sizeof *s);
    shape_add_quad(s, corners);
}

/* ---- textures ---------------------------------------------------------------------------- */

/* Two by two tiles of the ground, light and dark, with grout between them. */
static void paint_tiles(double x, double y, double code[3])
{
    int column = x >= 0.5, row = y >= 0.5;
    double u = fmod(2 * x, 1.0), v = fmod(2 * y, 1.0);
    int grout = u < 0.03 || u > 0.97 || v < 0.03 || v > 0.97;
    double shade = grout ? 70 : column ^ row ? 196 : 118;

    code[0] = shade;
    code[1] = grout ? shade : shade - 6;
    code[2] = grout ? shade : shade - 16;
}

/* A unit normal as a code, 0..255 for -1..1. */
static void encode_normal(double dx, double dy, double code[3])
{
    double length = sqrt(dx * dx + dy * dy + 1);

    code[0] = (-dx / length * 0.5 + 0.5) * 255;
    code[1] = (-dy / length * 0.5 + 0.5) * 255;
    code[2] = (1 / length * 0.5 + 0.5) * 255;
}

/* The slope of a tile's rounded edge at `u` of 0..1; the edge falls towards the grout. */
static double edge_slope(double u)
{
    if (u < 0.06)
        return 0.9 * sin(PI * u / 0.06);
    if (u > 0.94)
        return -0.9 * sin(PI * (1 - u) / 0.06);
    return 0;
}

/* dy is the slope upwards in the texture: against the rows' order. */
static void paint_tile_normals(double x, double y, double code[3])
{
    encode_normal(edge_slope(fmod(2 * x, 1.0)), -edge_slope(fmod(2 * y, 1.0)), code);
}

/* Crossed waves: a hammered sphere. */
static void paint_wave_normals(double x, double y, double code[3])
{
    double kx = 2 * PI * 24, ky = 2 * PI * 12;

    encode_normal(0.45 * cos(kx * x) * sin(ky * y), -0.45 * sin(kx * x) * cos(ky * y), code);
}

static status write_texture(const char *folder, const char *name, void (*paint)(double, double, double[3]),
                            struct error *err)
{
    struct image image;
    struct buffer png = BUFFER_INIT;
    char *path = file_join(folder, name);
    status st = image_init(&image, TEXTURE_SIDE, TEXTURE_SIDE, 3, err);

    if (st == STATUS_OK && !path)
        st = error_no_memory(err, "a path");
    for (uint32_t y = 0; st == STATUS_OK && y < TEXTURE_SIDE; y++)
        for (uint32_t x = 0; x < TEXTURE_SIDE; x++) {
            double code[3];

            paint((x + 0.5) / TEXTURE_SIDE, (y + 0.5) / TEXTURE_SIDE, code);
            /* Whole codes, so that the encoder's dither changes nothing. */
            for (int c = 0; c < 3; c++)
                image.pixels[3 * (y * TEXTURE_SIDE + x) + (uint32_t)c] = (float)(floor(code[c] + 0.5) / 255);
        }
    if (st == STATUS_OK)
        st = png_encode(&png, &image, err);
    if (st == STATUS_OK)
        st = file_write_atomic(path, png.data, png.size, err);
    buffer_release(&png);
    image_release(&image);
    mem_free(path);
    return st;
}

/* ---- the scene --------------------------------------------------------------------------- */

#define PBR(base, metal, rough) \
    "\"pbrMetallicRoughness\": {\"baseColorFactor\": [" base ", 1], \"metallicFactor\": " metal \
    ", \"roughnessFactor\": " rough "}"

static const char ground_json[] =
    "{\"name\": \"tiles\", \"pbrMetallicRoughness\": {\"baseColorTexture\": {\"index\": 0}, "
    "\"metallicFactor\": 0, \"roughnessFactor\": 0.45}, \"normalTexture\": {\"index\": 1}, "
    "\"doubleSided\": true}";
static const char lamp_json[] = "{\"name\": \"lamp\", " PBR(
    "0, 0, 0", "0", "1") ", \"emissiveFactor\": [1, 0.95, 0.88], "
                         "\"extensions\": {\"KHR_materials_emissive_strength\": {\"emissiveStrength\": 12}}}";

static const struct {
    const char *name;
    const char *json;
    double x, z; /* metres; a sphere's radius is 1/2 */
} spheres[] = {
    {"rough metal", "{\"name\": \"rough metal\", " PBR("0.95, 0.64, 0.54", "1", "0.4") "}", -2.3, 0.1},
    {"smooth metal", "{\"name\": \"smooth metal\", " PBR("1, 0.78, 0.34", "1", "0.05") "}", -1.15, -0.4},
    {"plastic", "{\"name\": \"plastic\", " PBR("0.06, 0.24, 0.62", "0", "0.15") "}", 0.0, 0.25},
    {"glass",
     "{\"name\": \"glass\", " PBR("1, 1, 1", "0", "0") ", \"extensions\": "
     "{\"KHR_materials_transmission\": {\"transmissionFactor\": 1}, "
     "\"KHR_materials_ior\": {\"ior\": 1.5}, "
     "\"KHR_materials_volume\": {\"thicknessFactor\": 1, \"attenuationDistance\": 2, "
     "\"attenuationColor\": [0.85, 0.97, 0.9]}}}",
     1.15, -0.4},
    {"hammered",
     "{\"name\": \"hammered\", " PBR("0.7, 0.08, 0.06", "0", "0.25") ", \"normalTexture\": "
                                                                     "{\"index\": 2}}",
     2.3, 0.1},
};

static void add_object(struct gltf_writer *w, const struct shape *shape, const char *name, const char *material,
                       double y)
{
    struct buffer primitive = BUFFER_INIT;
    unsigned mesh;

    gltf_writer_add_shape(w, shape, &primitive);
    mesh = gltf_writer_add_mesh(w, name, buffer_text(&primitive), gltf_writer_add_material(w, material));
    gltf_writer_add_node(w, name, mesh, 0, y, 0);
    if (!buffer_ok(&primitive))
        w->meshes.failed = 1;
    buffer_release(&primitive);
}

static void add_spheres(struct gltf_writer *w, struct shape *scratch)
{
    struct buffer primitive = BUFFER_INIT;

    build_sphere(scratch);
    for (unsigned i = 0; i < scratch->vertex_count; i++)
        for (int c = 0; c < 3; c++)
            scratch->positions[i][c] *= 0.5f;
    gltf_writer_add_shape(w, scratch, &primitive);
    for (size_t i = 0; i < sizeof spheres / sizeof *spheres; i++) {
        unsigned material = gltf_writer_add_material(w, spheres[i].json);

        gltf_writer_add_node(w, spheres[i].name,
                             gltf_writer_add_mesh(w, spheres[i].name, buffer_text(&primitive), material), spheres[i].x,
                             0.5, spheres[i].z);
    }
    if (!buffer_ok(&primitive))
        w->meshes.failed = 1;
    buffer_release(&primitive);
}

static status make_studio(const char *folder, struct shape *scratch, struct error *err)
{
    static const double eye[3] = {0, 2.1, 7.3}, target[3] = {0, 0.6, 0};
    struct gltf_writer w;
    status st;

    gltf_writer_init(&w);
    gltf_writer_use_extension(&w, "KHR_materials_emissive_strength");
    gltf_writer_use_extension(&w, "KHR_materials_transmission");
    gltf_writer_use_extension(&w, "KHR_materials_ior");
    gltf_writer_use_extension(&w, "KHR_materials_volume");
    gltf_writer_add_image(&w, "tiles.png");
    gltf_writer_add_image(&w, "tiles-normal.png");
    gltf_writer_add_image(&w, "waves-normal.png");
    build_ground(scratch, 12, 6);
    add_object(&w, scratch, "ground", ground_json, 0);
    build_lamp(scratch, 2.5);
    add_object(&w, scratch, "lamp", lamp_json, 4.5);
    add_spheres(&w, scratch);
    gltf_writer_add_camera(&w, 0.8, eye, target);
    st = write_texture(folder, "tiles.png", paint_tiles, err);
    if (st == STATUS_OK)
        st = write_texture(folder, "tiles-normal.png", paint_tile_normals, err);
    if (st == STATUS_OK)
        st = write_texture(folder, "waves-normal.png", paint_wave_normals, err);
    if (st == STATUS_OK)
        st = gltf_writer_save(&w, folder, "textured-spheres", "textured-spheres.bin", err);
    gltf_writer_release(&w);
    return st;
}

int main(int argc, char **argv)
{
    const char *folder = "scenes/studio";
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &folder, "FOLDER",
         "where the files go (default scenes/studio)", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};
    struct shape *scratch = NULL;
    int help = 0;
    status st = options_parse(table, argc, argv, &rest, &help, &err);

    if (st == STATUS_OK && help) {
        options_print_help("make_studio [options]", "Write textured-spheres.gltf with its buffer and textures.", table);
        return 0;
    }
    if (st == STATUS_OK && rest.count > 0)
        st = error_set(&err, STATUS_ERR_USAGE, "make_studio takes options only");
    if (st == STATUS_OK) {
        scratch = mem_calloc(1, sizeof *scratch);
        st = scratch ? make_studio(folder, scratch, &err) : error_no_memory(&err, "a shape");
    }
    mem_free(scratch);
    if (st != STATUS_OK)
        fprintf(stderr, "make_studio: %s\n", err.text);
    return status_exit_code(st);
}
