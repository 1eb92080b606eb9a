#include "tests/support/model_scenes.h"

#include <math.h>
#include <string.h>

#define V3(x, y, z) ((const double[3]){(x), (y), (z)})

static void set3(double out[3], double x, double y, double z)
{
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

static struct model_material *colored(struct model *m, const char *name, double r, double g, double b)
{
    struct model_material *out = model_material(m, name);

    set3(out->color, r, g, b);
    return out;
}

static struct model_material *shining(struct model *m, const char *name, double r, double g, double b)
{
    struct model_material *out = colored(m, name, 0, 0, 0);

    set3(out->emission, r, g, b);
    return out;
}

static void camera(struct model *m, const double eye[3], const double target[3], double yfov_rad)
{
    memcpy(m->eye, eye, sizeof m->eye);
    memcpy(m->target, target, sizeof m->target);
    m->yfov_rad = yfov_rad;
}

/* Floor, ceiling, back and both sides of a room of 4 x 3 x 4 m; each of its own. */
static void walls(struct model *m)
{
    colored(m, "floor", 0.6, 0.55, 0.5);
    model_quad(m, "floor", V3(-2, 0, 2), V3(4, 0, 0), V3(0, 0, -4), 1);
    colored(m, "white", 0.75, 0.75, 0.75);
    model_quad(m, "ceiling", V3(-2, 3, -2), V3(4, 0, 0), V3(0, 0, 4), 1);
    model_quad(m, "back", V3(-2, 0, -2), V3(4, 0, 0), V3(0, 3, 0), 1);
    colored(m, "red", 0.6, 0.1, 0.08);
    model_quad(m, "left", V3(-2, 0, 2), V3(0, 0, -4), V3(0, 3, 0), 1);
    colored(m, "green", 0.1, 0.5, 0.12);
    model_quad(m, "right", V3(2, 0, -2), V3(0, 0, 4), V3(0, 3, 0), 1);
}

/* ---- the room -------------------------------------------------------------------------------- */

/* A box of 1 m that stands askew on the floor; its corners are rounded to 2^-12 m. */
static void askew_box(struct model *m, const char *name, double x, double z, double height)
{
    static const uint32_t faces[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                         {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    static const double ring[4][2] = {{-0.5, 0.25}, {0.25, 0.5}, {0.5, -0.25}, {-0.25, -0.5}};
    double at[8][3];

    for (int i = 0; i < 8; i++)
        set3(at[i], x + ring[i % 4][0], i < 4 ? 0 : height, z + ring[i % 4][1]);
    model_quads(m, name, (const double(*)[3])at, 8, faces, 6);
}

static void room(struct model *m, int as_pbrt)
{
    struct model_material *mat;
    struct model_mesh *ball;

    model_init(m);
    walls(m);
    mat = colored(m, "plastic", 0.2, 0.3, 0.6);
    mat->glossy = !as_pbrt;
    mat->roughness = 0.4;
    askew_box(m, "box", -0.75, -0.75, 1.5);
    mat = colored(m, "metal", 0.9, 0.7, 0.4);
    mat->metallic = 1;
    mat->roughness = 0.5;
    ball = model_ball(m, "ball", V3(0.75, 0.625, 0.25), 0.625, 12);
    set3(ball->pivot, 0.75, 0.625, 0.25);
    ball->radius = as_pbrt ? 0.625 : 0;
    shining(m, "lamp", 8, 7, 6);
    model_quad(m, "lamp", V3(-0.5, 2.875, -0.5), V3(1, 0, 0), V3(0, 0, 1), 1);
    mat = shining(m, "strip", 3, 4, 5);
    mat->one_sided = !as_pbrt;
    model_quad(m, "strip", V3(-1.875, 1.5, 0.5), V3(0, 0, -0.5), V3(0, 0.75, 0), 1);
    shining(m, "bulb", 6, 4, 2);
    ball = model_ball(m, "bulb", V3(1.25, 2, -1), 0.1875, 8);
    set3(ball->pivot, 1.25, 2, -1);
    ball->radius = as_pbrt ? 0.1875 : 0;
    m->light_count = 2;
    set3(m->lights[0].at, 1.5, 2.5, 1);
    set3(m->lights[0].intensity, 2, 2, 2.5);
    set3(m->lights[1].at, -1, 2.5, 1.5);
    set3(m->lights[1].direction, 0.75, -2, -1.5);
    set3(m->lights[1].intensity, 12, 10, 9);
    m->lights[1].inner_rad = 0.2;
    m->lights[1].outer_rad = 0.4;
    set3(m->sky, 1, 1, 1);
    m->sky_map = "sky.hdr";
    camera(m, V3(0.25, 1.5, 5.5), V3(0, 1.25, 0), 0.7);
}

void model_room(struct model *m) { room(m, 0); }

void model_room_plain_sky(struct model *m)
{
    room(m, 0);
    m->sky_map = NULL;
}

void model_room_pbrt(struct model *m)
{
    room(m, 1);
    m->lens_radius = 0.03125;
    m->focus_distance = 5;
}

/* ---- glass ------------------------------------------------------------------------------------ */

enum { SIDES = 8 };
static const double octagon[SIDES][2] = {{1, 0},  {0.75, 0.75},   {0, 1},  {-0.75, 0.75},
                                         {-1, 0}, {-0.75, -0.75}, {0, -1}, {0.75, -0.75}};

static void ring(double (*at)[3], double radius, double y)
{
    for (int i = 0; i < SIDES; i++)
        set3(at[i], radius * octagon[i][0], y, radius * octagon[i][1]);
}

/* Quads between two rings of vertices, whose first are `a` (below, if the side looks out) and `b`. */
static uint32_t band(uint32_t (*quads)[4], uint32_t a, uint32_t b)
{
    for (uint32_t i = 0; i < SIDES; i++) {
        uint32_t next = (i + 1) % SIDES;
        memcpy(quads[i], (uint32_t[4]){a + i, b + i, b + next, a + next}, 16);
    }
    return SIDES;
}

/* Three quads fill an octagon that looks up, or down. */
static uint32_t lid(uint32_t (*quads)[4], uint32_t first, int up)
{
    static const uint32_t parts[3][4] = {{0, 1, 2, 3}, {0, 3, 4, 7}, {4, 5, 6, 7}};

    for (int q = 0; q < 3; q++)
        for (int k = 0; k < 4; k++)
            quads[q][k] = first + parts[q][up ? 3 - k : k];
    return 3;
}

static struct model_material *clear_body(struct model *m, const char *name, double ior, double r, double g, double b)
{
    struct model_material *out = colored(m, name, 1, 1, 1);

    out->ior = ior;
    out->roughness = 0;
    set3(out->attenuation_color, r, g, b);
    out->attenuation_distance = 1;
    return out;
}

void model_glass(struct model *m)
{
    double at[4 * SIDES][3];
    uint32_t quads[4 * SIDES][4], count;

    model_init(m);
    walls(m);
    shining(m, "lamp", 3, 3, 2.75);
    model_quad(m, "lamp", V3(-1.5, 2.875, -1.5), V3(3, 0, 0), V3(0, 0, 3), 1);

    clear_body(m, "glass", 1.5, 0.8, 0.95, 0.85);
    ring(at, 1, 0.125);
    ring(at + SIDES, 1, 2);
    ring(at + 2 * SIDES, 0.875, 2);
    ring(at + 3 * SIDES, 0.875, 0.375);
    count = band(quads, 0, SIDES);
    count += band(quads + count, SIDES, 2 * SIDES);
    count += band(quads + count, 2 * SIDES, 3 * SIDES);
    count += lid(quads + count, 0, 0);
    count += lid(quads + count, 3 * SIDES, 1);
    model_quads(m, "tumbler", (const double(*)[3])at, 4 * SIDES, (const uint32_t(*)[4])quads, count);

    clear_body(m, "water", 1.33, 0.5, 0.7, 0.9);
    ring(at, 0.875, 0.375);
    ring(at + SIDES, 0.875, 1.375);
    count = band(quads, 0, SIDES);
    count += lid(quads + count, 0, 0);
    count += lid(quads + count, SIDES, 1);
    model_quads(m, "water", (const double(*)[3])at, 2 * SIDES, (const uint32_t(*)[4])quads, count);

    clear_body(m, "ice", 1.31, 0.9, 0.8, 0.9);
    model_box(m, "ice", V3(-0.375, 0.75, -0.25), V3(0.25, 1.25, 0.375));
    set3(m->sky, 0.5, 0.55, 0.6);
    camera(m, V3(0.25, 2, 5.5), V3(0, 1.125, 0), 0.55);
}

/* ---- fog -------------------------------------------------------------------------------------- */

void model_fog(struct model *m)
{
    static const double smoke[27] = {0,   0.2, 0.1, 0.3, 0.6, 0.2, 0.1, 0.3, 0, 0.2, 0.5, 0.3, 0.6, 1,
                                     0.7, 0.3, 0.8, 0.2, 0,   0.1, 0.2, 0.2, 0.5, 0.3, 0,  0.4, 0.1};

    model_init(m);
    walls(m);
    colored(m, "front", 0.7, 0.7, 0.7);
    model_quad(m, "front", V3(2, 0, 2), V3(-4, 0, 0), V3(0, 3, 0), 1);
    shining(m, "lamp", 8, 7.5, 7);
    model_quad(m, "lamp", V3(-0.75, 2.875, -0.75), V3(1.5, 0, 0), V3(0, 0, 1.5), 1);
    m->medium_count = 3;
    m->fog = 0;
    m->media[0] = (struct model_medium){.absorption = {0.01, 0.01, 0.02}, .scattering = {0.1, 0.12, 0.15},
                                        .g = 0.5};
    m->media[1] = (struct model_medium){.absorption = {0.1, 0.5, 1}, .scattering = {400, 400, 300}};
    m->media[2] = (struct model_medium){.absorption = {1, 1, 1}, .scattering = {6, 6, 6}, .g = -0.25,
                                        .grid = 3, .density = smoke, .low = {0.25, 0.5, -0.75},
                                        .high = {1.5, 1.75, 0.5}};
    model_material(m, "milk")->medium = 1;
    model_box(m, "milk", V3(-1.25, 0, -1), V3(-0.25, 1.25, 0));
    model_material(m, "smoke")->medium = 2;
    model_box(m, "smoke", V3(0.25, 0.5, -0.75), V3(1.5, 1.75, 0.5));
    m->light_count = 1;
    set3(m->lights[0].at, 1.25, 2.5, 1);
    set3(m->lights[0].intensity, 3, 3, 3);
    camera(m, V3(0.25, 1.5, 1.875), V3(0, 1, -1), 1.1);
}

/* ---- textures --------------------------------------------------------------------------------- */

static void textures(struct model *m, int blended)
{
    struct model_material *mat;

    model_init(m);
    mat = colored(m, "tiles", 0.9, 0.9, 0.8);
    mat->color_image = "checker.png";
    model_quad(m, "ground", V3(-6, 0, 4), V3(12, 0, 0), V3(0, 0, -12), 24);
    mat = colored(m, "bumpy", 0.5, 0.4, 0.3);
    mat->glossy = 1;
    mat->roughness = 0.4;
    mat->normal_image = "bumps.png";
    model_quad(m, "wall", V3(-2.75, 0, -1), V3(2.5, 0, -1), V3(0, 2.5, 0), 0.125); /* one bump */
    mat = colored(m, "holes", 0.3, 0.6, 0.4);
    mat->color_image = "holes.png";
    mat->alpha_cutoff = 0.5;
    model_quad(m, "cut out", V3(0, 0, 0), V3(1.25, 0, 0.25), V3(0, 1.5, 0), 1);
    mat = colored(m, "veil", 0.7, 0.5, 0.6);
    mat->color_image = "holes.png";
    mat->alpha_cutoff = blended ? -1 : 0.25;
    mat->normal_image = "bumps.png";
    model_quad(m, "veil", V3(1.5, 0, -0.5), V3(1, 0, -0.5), V3(0, 1.5, 0), 2);
    shining(m, "lamp", 9, 8, 7);
    model_quad(m, "lamp", V3(-1.5, 4, -1), V3(3, 0, 0), V3(0, 0, 3), 1);
    set3(m->sky, 0.25, 0.35, 0.5);
    camera(m, V3(0.25, 1.25, 5), V3(0, 0.625, 0), 0.7);
}

void model_textures(struct model *m) { textures(m, 0); }

void model_veil(struct model *m) { textures(m, 1); }

/* ---- what moves ------------------------------------------------------------------------------- */

void model_animation(struct model *m)
{
    struct model_mesh *mesh;

    model_init(m);
    walls(m);
    shining(m, "lamp", 8, 7.5, 7);
    model_quad(m, "lamp", V3(-1, 2.875, -1), V3(2, 0, 0), V3(0, 0, 2), 1);
    colored(m, "box", 0.2, 0.4, 0.7);
    mesh = model_box(m, "box", V3(-1.5, 1.5, -0.75), V3(-0.75, 2.25, 0));
    set3(mesh->pivot, -1.125, 1.875, -0.375);
    mesh->motion = (struct model_motion){1, {0.75, -0.5, 0.25}, {0, 0.6, 0.8}, 1.5};
    colored(m, "ball", 0.7, 0.6, 0.2);
    mesh = model_ball(m, "ball", V3(1, 0.75, 0), 0.5, 10);
    set3(mesh->pivot, 1, 0.75, 0);
    mesh->motion.moves = 1;
    mesh->morph = arena_alloc(&m->arena, mesh->vertex_count, sizeof *mesh->morph);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        mesh->morph[i][1] = mesh->at[i][1] - 0.75;
    colored(m, "bar", 0.3, 0.6, 0.3);
    mesh = model_box(m, "bar", V3(-1.25, 0, 0.25), V3(-1, 1, 0.5));
    set3(mesh->pivot, -1.125, 0.25, 0.375);
    mesh->motion = (struct model_motion){1, {0, 0, 0}, {0, 0, 1}, -1};
    set3(mesh->tip, 0, 0.25, 0);
    mesh->bend = arena_alloc(&m->arena, mesh->vertex_count, sizeof *mesh->bend);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        mesh->bend[i] = mesh->at[i][1];
    set3(m->sky, 0.3, 0.35, 0.4);
    camera(m, V3(0.25, 1.5, 5.5), V3(0, 1.25, 0), 0.7);
    set3(m->camera_travel, 0.25, 0.125, -0.5);
}

/* ---- what all formats say --------------------------------------------------------------------- */

void model_plain(struct model *m)
{
    model_init(m);
    walls(m);
    colored(m, "tiles", 1, 1, 1)->color_image = "checker.png";
    model_quad(m, "picture", V3(-1.5, 0.75, -1.875), V3(3, 0, 0), V3(0, 1.5, 0), 1);
    colored(m, "box", 0.2, 0.3, 0.6);
    askew_box(m, "box", -0.75, -0.5, 1);
    shining(m, "lamp", 8, 7, 6);
    model_quad(m, "lamp", V3(-0.5, 2.875, -0.5), V3(1, 0, 0), V3(0, 0, 1), 1);
    set3(m->sky, 0.5, 0.6, 0.7);
    camera(m, V3(0.25, 1.5, 5.5), V3(0, 1.25, 0), 0.7);
}

void model_plain_glass(struct model *m)
{
    model_plain(m);
    clear_body(m, "glass", 1.5, 0.5, 0.8, 0.7);
    model_box(m, "block", V3(0.25, 0.125, 0), V3(1.25, 1.125, 0.75));
    m->light_count = 1;
    set3(m->lights[0].at, 1.5, 2.5, 1);
    set3(m->lights[0].intensity, 2, 2, 2.5);
}
