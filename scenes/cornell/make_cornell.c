/* make_cornell: writes the Cornell boxes of this folder.
 *
 * The room is the measured one (Cornell University Program of Computer Graphics, "The Cornell
 * Box", data of 1998), one of its millimetres as a centimetre: a room of 5.5 m. It is turned
 * half round and centred, so that the camera looks along -Z and the open front is at +Z.
 * Red is on the left.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/cli/options.h"
#include "scenes/gltf_writer.h"

#define WALL \
    "\"doubleSided\": true, \"extensions\": {\"KHR_materials_specular\": " \
    "{\"specularFactor\": 0}}"
#define LAMBERT(name, color) \
    "{\"name\": \"" name "\", \"pbrMetallicRoughness\": {\"baseColorFactor\": [" color ", 1], " \
    "\"metallicFactor\": 0, \"roughnessFactor\": 1}, " WALL "}"

/* The measured spectra of the paints as linear Rec. 709, as they are commonly given. */
static const char white_json[] = LAMBERT("white", "0.725, 0.71, 0.68");
static const char red_json[] = LAMBERT("red", "0.63, 0.065, 0.05");
static const char green_json[] = LAMBERT("green", "0.14, 0.45, 0.091");
static const char mirror_json[] =
    "{\"name\": \"mirror\", \"pbrMetallicRoughness\": {\"baseColorFactor\": [0.95, 0.95, 0.95, 1], "
    "\"metallicFactor\": 1, \"roughnessFactor\": 0}}";
/* 17, 12, 4: the usual radiance of the lamp. It shines downwards only. */
static const char lamp_json[] = "{\"name\": \"lamp\", \"pbrMetallicRoughness\": {\"baseColorFactor\": [0, 0, 0, 1], "
                                "\"metallicFactor\": 0, \"roughnessFactor\": 1}, "
                                "\"emissiveFactor\": [1, 0.705882353, 0.235294118], "
                                "\"extensions\": {\"KHR_materials_emissive_strength\": {\"emissiveStrength\": 17}, "
                                "\"KHR_materials_specular\": {\"specularFactor\": 0}}}";

enum { CENTRE_X = 278 };
#define CEILING 548.8
#define DEPTH 559.2
#define CENTRE_Z (DEPTH / 2)

/* The measured frame to ours. */
static void place(const double measured[3], double out[3])
{
    out[0] = (CENTRE_X - measured[0]) * 0.01;
    out[1] = measured[1] * 0.01;
    out[2] = (CENTRE_Z - measured[2]) * 0.01;
}

static void add_quad(struct shape *shape, const double measured[4][3])
{
    double corners[4][3];

    for (int i = 0; i < 4; i++)
        place(measured[i], corners[i]);
    shape_add_quad(shape, corners);
}

static void build_floor(struct shape *s)
{
    static const double q[4][3] = {{552.8, 0, 0}, {0, 0, 0}, {0, 0, DEPTH}, {549.6, 0, DEPTH}};
    add_quad(s, q);
}

static void build_back(struct shape *s)
{
    static const double q[4][3] = {
        {549.6, 0, DEPTH}, {0, 0, DEPTH}, {0, CEILING, DEPTH}, {556, CEILING, DEPTH}};
    add_quad(s, q);
}

static void build_right(struct shape *s)
{
    static const double q[4][3] = {{0, 0, DEPTH}, {0, 0, 0}, {0, CEILING, 0}, {0, CEILING, DEPTH}};
    add_quad(s, q);
}

static void build_left(struct shape *s)
{
    static const double q[4][3] = {
        {552.8, 0, 0}, {549.6, 0, DEPTH}, {556, CEILING, DEPTH}, {556, CEILING, 0}};
    add_quad(s, q);
}

/* A ceiling with a hole from (x0, z0) to (x1, z1): four trapezia that share their corners. */
static void build_ceiling(struct shape *s, double x0, double x1, double z0, double z1)
{
    const double outer[4][2] = {{556, 0}, {556, DEPTH}, {0, DEPTH}, {0, 0}};
    const double inner[4][2] = {{x1, z0}, {x1, z1}, {x0, z1}, {x0, z0}};

    for (int i = 0; i < 4; i++) {
        int k = (i + 1) % 4;
        const double q[4][3] = {{outer[i][0], CEILING, outer[i][1]},
                                {outer[k][0], CEILING, outer[k][1]},
                                {inner[k][0], CEILING, inner[k][1]},
                                {inner[i][0], CEILING, inner[i][1]}};
        add_quad(s, q);
    }
}

static void build_lamp(struct shape *s, double x0, double x1, double z0, double z1)
{
    const double q[4][3] = {
        {x1, CEILING, z0}, {x1, CEILING, z1}, {x0, CEILING, z1}, {x0, CEILING, z0}};
    add_quad(s, q);
}

/* A closed block over the four corners of its top, counter-clockwise from above. */
static void build_block(struct shape *s, const double top[4][2], double height)
{
    double upper[4][3], lower[4][3];

    for (int i = 0; i < 4; i++) {
        const double u[3] = {top[i][0], height, top[i][1]}, l[3] = {top[i][0], 0, top[i][1]};
        memcpy(upper[i], u, sizeof u);
        memcpy(lower[i], l, sizeof l);
    }
    add_quad(s, upper);
    {
        double bottom[4][3];
        for (int i = 0; i < 4; i++)
            memcpy(bottom[i], lower[3 - i], sizeof bottom[i]);
        add_quad(s, bottom);
    }
    for (int i = 0; i < 4; i++) {
        int k = (i + 1) % 4;
        double side[4][3];
        memcpy(side[0], upper[k], sizeof side[0]);
        memcpy(side[1], upper[i], sizeof side[1]);
        memcpy(side[2], lower[i], sizeof side[2]);
        memcpy(side[3], lower[k], sizeof side[3]);
        add_quad(s, side);
    }
}

/* Do all triangles face away from (sign 1) or towards (sign -1) a point? */
static int faces(const struct shape *s, const double point[3], double sign)
{
    for (unsigned t = 0; t < s->triangle_count; t++) {
        const float *a = s->positions[s->triangles[t][0]];
        const float *b = s->positions[s->triangles[t][1]];
        const float *c = s->positions[s->triangles[t][2]];
        double u[3], v[3], outward = 0;

        for (int i = 0; i < 3; i++) {
            u[i] = (double)b[i] - (double)a[i];
            v[i] = (double)c[i] - (double)a[i];
        }
        outward += (u[1] * v[2] - u[2] * v[1]) * ((double)a[0] - point[0]);
        outward += (u[2] * v[0] - u[0] * v[2]) * ((double)a[1] - point[1]);
        outward += (u[0] * v[1] - u[1] * v[0]) * ((double)a[2] - point[2]);
        if (!(outward * sign > 0))
            return 0;
    }
    return 1;
}

/* One shape, one mesh, one node. `inside`: a point that the faces must turn from or to. */
static status add_object(struct gltf_writer *w, const struct shape *s, const char *name, unsigned material,
                         const double inside[3], double sign, struct error *err)
{
    struct buffer primitive = BUFFER_INIT;
    status st = STATUS_OK;

    if (!faces(s, inside, sign))
        return error_set(err, STATUS_ERR_INTERNAL, "%s is wound the wrong way", name);
    gltf_writer_add_shape(w, s, &primitive);
    if (buffer_ok(&primitive))
        gltf_writer_add_node(w, name, gltf_writer_add_mesh(w, name, buffer_text(&primitive), material), 0, 0, 0);
    else
        st = error_no_memory(err, name);
    buffer_release(&primitive);
    return st;
}

struct box {
    struct gltf_writer writer;
    struct shape *shape; /* scratch: too large for a stack */
    struct error *err;
    status st;
};

static struct shape *fresh(struct box *b)
{
    memset(b->shape, 0, sizeof *b->shape);
    return b->shape;
}

static void add_room_part(struct box *b, const char *name, unsigned material)
{
    static const double middle[3] = {0, CEILING / 200, 0};

    if (b->st == STATUS_OK)
        b->st = add_object(&b->writer, b->shape, name, material, middle, -1.0, b->err);
}

static void add_block(struct box *b, const char *name, unsigned material, const double top[4][2], double height)
{
    double measured[3] = {0, height / 2, 0}, middle[3];

    for (int i = 0; i < 4; i++) {
        measured[0] += top[i][0] / 4;
        measured[2] += top[i][1] / 4;
    }
    place(measured, middle);
    build_block(fresh(b), top, height);
    if (b->st == STATUS_OK)
        b->st = add_object(&b->writer, b->shape, name, material, middle, 1.0, b->err);
}

/* The three boxes: the classical one under its lamp; two with mirror blocks under a skylight, of which the
 * last is made to be looked at: an eye at a person's height, blocks that reach over the horizon. */
struct design {
    const char *name;
    int mirrors;
    double short_height, tall_height; /* measured units, as all here */
    double skylight[4];               /* x0, x1, z0, z1 of the hole, or of the lamp in it */
    double eye_height, target_height, yfov_rad;
};

#define MEASURED_YFOV (2 * atan(0.0125 / 0.035)) /* 35 mm focal length behind a film of 25 mm */

static void add_camera(struct box *b, const struct design *d)
{
    const double measured_eye[3] = {278, d->eye_height, -800};
    const double measured_target[3] = {278, d->target_height, 0};
    double eye[3], target[3];

    place(measured_eye, eye);
    place(measured_target, target);
    gltf_writer_add_camera(&b->writer, d->yfov_rad, eye, target);
}

static status make_box(const char *folder, const struct design *d, struct shape *scratch, struct error *err)
{
    static const double small_top[4][2] = {{130, 65}, {82, 225}, {240, 272}, {290, 114}};
    static const double tall_top[4][2] = {{423, 247}, {265, 296}, {314, 456}, {472, 406}};
    struct box b = {.shape = scratch, .err = err, .st = STATUS_OK};
    unsigned white, red, green, block;
    const double *hole = d->skylight;

    gltf_writer_init(&b.writer);
    gltf_writer_use_extension(&b.writer, "KHR_materials_specular");
    if (!d->mirrors)
        gltf_writer_use_extension(&b.writer, "KHR_materials_emissive_strength");
    white = gltf_writer_add_material(&b.writer, white_json);
    red = gltf_writer_add_material(&b.writer, red_json);
    green = gltf_writer_add_material(&b.writer, green_json);
    block = d->mirrors ? gltf_writer_add_material(&b.writer, mirror_json) : white;
    build_floor(fresh(&b));
    add_room_part(&b, "floor", white);
    build_back(fresh(&b));
    add_room_part(&b, "back wall", white);
    build_left(fresh(&b));
    add_room_part(&b, "left wall", red);
    build_right(fresh(&b));
    add_room_part(&b, "right wall", green);
    build_ceiling(fresh(&b), hole[0], hole[1], hole[2], hole[3]);
    if (d->mirrors) {
        add_room_part(&b, "ceiling with a skylight", white);
    } else { /* the lamp fills its hole: no two faces lie on one another */
        add_room_part(&b, "ceiling", white);
        build_lamp(fresh(&b), hole[0], hole[1], hole[2], hole[3]);
        add_room_part(&b, "lamp", gltf_writer_add_material(&b.writer, lamp_json));
    }
    add_block(&b, "short block", block, small_top, d->short_height);
    add_block(&b, "tall block", block, tall_top, d->tall_height);
    add_camera(&b, d);
    if (b.st == STATUS_OK)
        b.st = gltf_writer_save(&b.writer, folder, d->name, NULL, err);
    gltf_writer_release(&b.writer);
    return b.st;
}

int main(int argc, char **argv)
{
    const char *folder = "scenes/cornell";
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &folder, "FOLDER",
         "where the files go (default scenes/cornell)", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};
    struct shape *scratch = NULL;
    const struct design designs[] = {
        {"cornell-mirror", 1, 165, 330, {148, 408, 149.6, 409.6}, 273, 273, MEASURED_YFOV},
        {"cornell-area", 0, 165, 330, {213, 343, 227, 332}, 273, 273, MEASURED_YFOV},
        {"cornell-field", 1, 205, 370, {100, 456, 70, 310}, 160, 228, 0.78},
    };
    int help = 0;
    status st = options_parse(table, argc, argv, &rest, &help, &err);

    if (st == STATUS_OK && help) {
        options_print_help("make_cornell [options]", "Write the boxes of this folder.", table);
        return 0;
    }
    if (st == STATUS_OK && rest.count > 0)
        st = error_set(&err, STATUS_ERR_USAGE, "make_cornell takes options only");
    if (st == STATUS_OK) {
        scratch = mem_calloc(1, sizeof *scratch);
        st = scratch ? STATUS_OK : error_no_memory(&err, "a shape");
    }
    for (size_t i = 0; st == STATUS_OK && i < sizeof designs / sizeof *designs; i++)
        st = make_box(folder, &designs[i], scratch, &err);
    mem_free(scratch);
    if (st != STATUS_OK)
        fprintf(stderr, "make_cornell: %s\n", err.text);
    return status_exit_code(st);
}
