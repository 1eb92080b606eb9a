/* Cut up: triangles into four, closed bodies into halves that touch. Deforming meshes, whose vectors are made unit, are left alone. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/transform.h"

/* A vertex: the floats of every array, one after the other. */
enum { ARRAYS = 6, CORNER_FLOATS = 18 };
static const uint8_t floats_of[ARRAYS] = {3, 3, 4, 2, 2, 4};
enum { HANDEDNESS = 9 };

struct corner {
    float at[CORNER_FLOATS];
};
struct triangle {
    struct corner corners[3];
};
/* Triangles with vertices of their own. */
struct soup {
    struct triangle *at;
    size_t count, capacity;
};

static void soup_add(struct soup *soup, struct corner a, struct corner b, struct corner c)
{
    if (!MEM_GROW(soup->at, soup->capacity, soup->count + 1))
        abort();
    soup->at[soup->count++] = (struct triangle){{a, b, c}};
}

static void array_starts(const struct scene_mesh *mesh, size_t starts[ARRAYS])
{
    struct scene_mesh_layout l;

    scene_mesh_layout(mesh, &l);
    memcpy(starts, (size_t[ARRAYS]){l.positions, l.normals, l.tangents, l.uv0, l.uv1, l.colors}, ARRAYS * sizeof *starts);
}

/* Between the blob's vertex and the corner. */
static void copy_corner(uint8_t *blob, const size_t starts[ARRAYS], uint32_t vertex, struct corner *corner, int store)
{
    float *at = corner->at;

    for (int a = 0; a < ARRAYS; at += floats_of[a++]) {
        const size_t size_bytes = floats_of[a] * sizeof *at;
        uint8_t *there = blob + starts[a] + vertex * size_bytes;
        if (starts[a] != SIZE_MAX)
            memcpy(store ? (void *)there : at, store ? (const void *)at : there, size_bytes);
    }
}

static void soup_read(const struct import_result *import, const struct scene_mesh *mesh, struct soup *soup)
{
    struct scene_mesh_layout layout;
    uint8_t *blob = (uint8_t *)(uintptr_t)transform_blob(import, mesh);
    size_t starts[ARRAYS];

    scene_mesh_layout(mesh, &layout);
    array_starts(mesh, starts);
    *soup = (struct soup){0};
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct corner corners[3] = {0};
        uint32_t v[3];
        memcpy(v, blob + layout.indices + 12 * (size_t)t, sizeof v);
        for (int k = 0; k < 3; k++)
            copy_corner(blob, starts, v[k], &corners[k], 0);
        soup_add(soup, corners[0], corners[1], corners[2]);
    }
}

/* A mesh of them, otherwise as `mesh`. Frees the soup. */
static uint32_t soup_mesh(struct import_result *import, struct scene_mesh mesh, struct soup *soup)
{
    struct scene_mesh_layout layout;
    size_t starts[ARRAYS];
    uint8_t *blob;

    mesh.triangle_count = (uint32_t)soup->count;
    mesh.vertex_count = 3 * mesh.triangle_count;
    scene_mesh_layout(&mesh, &layout);
    array_starts(&mesh, starts);
    blob = mem_calloc(1, layout.total_bytes);
    if (!blob)
        abort();
    for (uint32_t v = 0; v < mesh.vertex_count; v++) {
        copy_corner(blob, starts, v, &soup->at[v / 3].corners[v % 3], 1);
        memcpy(blob + layout.indices + 4 * (size_t)v, &v, 4);
    }
    mem_free(soup->at);
    return transform_add_mesh(import, mesh, blob);
}

/* A share of the way from a to b. A triangle's handedness is that of its first corner (surface_handedness()). */
static struct corner between(const struct corner *a, const struct corner *b, double share, float handedness)
{
    struct corner out;

    for (int i = 0; i < CORNER_FLOATS; i++)
        out.at[i] = (float)((1 - share) * (double)a->at[i] + share * (double)b->at[i]);
    out.at[HANDEDNESS] = handedness;
    return out;
}

static int may_cut(const struct scene_mesh *mesh, const struct scene_instance *instance)
{
    return instance->skin < 0 && mesh->morph_count == 0 && !(mesh->arrays & (MESH_SKIN | MESH_STAND_INS));
}

/* ---- triangles -------------------------------------------------------------------------------------- */

static uint32_t quartered(struct import_result *import, uint32_t number)
{
    const struct scene_mesh mesh = import->scene.meshes[number];
    struct soup whole, parts = {0};

    soup_read(import, &mesh, &whole);
    for (size_t t = 0; t < whole.count; t++) {
        struct corner *c = whole.at[t].corners, m[3];
        for (int k = 0; k < 3; k++) {
            c[k].at[HANDEDNESS] = c[0].at[HANDEDNESS];
            m[k] = between(&c[k], &c[(k + 1) % 3], 0.5, c[0].at[HANDEDNESS]);
        }
        for (int k = 0; k < 3; k++)
            soup_add(&parts, c[k], m[k], m[(k + 2) % 3]);
        soup_add(&parts, m[0], m[1], m[2]);
    }
    mem_free(whole.at);
    return soup_mesh(import, mesh, &parts);
}

uint32_t transform_quarter_faces(struct import_result *import)
{
    const uint32_t meshes = import->scene.mesh_count;
    uint32_t *done = mem_calloc(meshes, sizeof *done), count = 0;

    if (!done)
        abort();
    for (uint32_t i = 0; i < import->scene.instance_count; i++) {
        const uint32_t mesh = import->scene.instances[i].mesh;
        if (!may_cut(&import->scene.meshes[mesh], &import->scene.instances[i]))
            continue;
        if (!done[mesh])
            done[mesh] = quartered(import, mesh);
        import->scene.instances[i].mesh = done[mesh];
        count++;
    }
    mem_free(done);
    return count;
}

/* ---- bodies ------------------------------------------------------------------------------------------ */

/* The plane axis = at. */
struct plane {
    int axis;
    float at;
};

/* Where an edge that passes the plane meets it: the same from both its triangles. */
static struct corner meet(const struct corner *a, const struct corner *b, struct plane plane)
{
    const int turned = memcmp(a->at, b->at, 3 * sizeof *a->at) > 0;
    const struct corner *from = turned ? b : a, *to = turned ? a : b;
    const double x = (double)from->at[plane.axis];
    struct corner out = between(from, to, ((double)plane.at - x) / ((double)to->at[plane.axis] - x), a->at[HANDEDNESS]);

    out.at[plane.axis] = plane.at;
    return out;
}

/* What of the triangle is on this side (-1, 1), and where the cut enters and leaves it. Returns whether it is cut. */
static int clip(const struct triangle *whole, struct plane plane, int side, struct soup *out, struct corner ends[2])
{
    struct corner kept[4];
    int count = 0, cuts = 0;

    for (int k = 0; k < 3; k++) {
        const struct corner *a = &whole->corners[k], *b = &whole->corners[(k + 1) % 3];
        const int a_is_in = (a->at[plane.axis] > plane.at) == (side > 0), b_is_in = (b->at[plane.axis] > plane.at) == (side > 0);
        if (a_is_in)
            kept[count++] = *a;
        if (a_is_in != b_is_in) {
            ends[a_is_in] = kept[count++] = meet(a, b, plane);
            cuts++;
        }
    }
    for (int k = 2; k < count; k++)
        soup_add(out, kept[0], kept[k - 1], kept[k]);
    return cuts > 0;
}

/* Twice the area of the cap's triangle as the plane's normal sees it. */
static double area(const struct corner *a, const struct corner *b, const struct corner *c, struct plane plane)
{
    const int x = (plane.axis + 1) % 3, y = (plane.axis + 2) % 3;

    return ((double)b->at[x] - (double)a->at[x]) * ((double)c->at[y] - (double)a->at[y]) -
           ((double)b->at[y] - (double)a->at[y]) * ((double)c->at[x] - (double)a->at[x]);
}

/* Half of a body, closed by a fan. 0: from the middle of the cut not all of its outline is seen, and the fan would lie in folds. */
static int halve(const struct soup *whole, struct plane plane, int side, struct soup *out)
{
    struct corner middle = {0}, ends[2];
    struct soup outline = {0};
    double sum[3] = {0}, turn = 0;
    int is_star = 1;

    *out = (struct soup){0};
    for (size_t t = 0; t < whole->count; t++)
        if (clip(&whole->at[t], plane, side, out, ends))
            soup_add(&outline, ends[0], ends[1], ends[1]);
    for (size_t i = 0; i < outline.count; i++)
        for (int c = 0; c < 3; c++)
            sum[c] += (double)outline.at[i].corners[0].at[c] / (double)outline.count;
    for (int c = 0; c < 3; c++)
        middle.at[c] = (float)sum[c];
    middle.at[plane.axis] = plane.at;
    middle.at[3 + plane.axis] = (float)-side;
    middle.at[6 + (plane.axis + 1) % 3] = middle.at[HANDEDNESS] = 1;
    for (size_t i = 0; i < outline.count; i++) {
        struct corner edge[2] = {middle, middle};
        const double twice = -side * area(&middle, &outline.at[i].corners[0], &outline.at[i].corners[1], plane);
        for (int k = 0; k < 2; k++)
            memcpy(edge[k].at, outline.at[i].corners[k].at, 3 * sizeof(float));
        is_star &= twice > 0;
        turn += twice > 0;
        soup_add(out, middle, edge[0], edge[1]);
    }
    mem_free(outline.at);
    return is_star && turn > 2;
}

/* Across the longest side, where no vertex lies. */
static int choose_plane(const struct scene_mesh *mesh, const struct soup *whole, struct plane *out)
{
    float side[3];

    for (int c = 0; c < 3; c++)
        side[c] = mesh->bounds_max[c] - mesh->bounds_min[c];
    out->axis = side[1] > side[0];
    out->axis = side[2] > side[out->axis] ? 2 : out->axis;
    out->at = mesh->bounds_min[out->axis] + 0.43f * side[out->axis];
    for (size_t i = 0; i < 3 * whole->count; i++)
        if (fabsf(whole->at[i / 3].corners[i % 3].at[out->axis] - out->at) <= 1e-4f * side[out->axis])
            return 0;
    return side[out->axis] > 0;
}

/* Light passes it, no face of it shines, and its mesh alone encloses it. */
static int is_body(const struct scene *scene, const struct scene_instance *instance)
{
    const struct scene_material *m = &scene->materials[instance->material];

    return may_cut(&scene->meshes[instance->mesh], instance) && scene->meshes[instance->mesh].closed &&
           (m->kind == MATERIAL_INTERFACE || (m->kind == MATERIAL_SURFACE && m->refractive)) &&
           m->alpha_mode == ALPHA_OPAQUE && scene_color_is(m->emission, 0);
}

static int halve_instance(struct import_result *import, uint32_t number)
{
    const struct scene_mesh mesh = import->scene.meshes[import->scene.instances[number].mesh];
    struct soup whole, half[2] = {{0}};
    struct plane plane;
    int can;

    soup_read(import, &mesh, &whole);
    can = choose_plane(&mesh, &whole, &plane) && halve(&whole, plane, -1, &half[0]) && halve(&whole, plane, 1, &half[1]);
    mem_free(whole.at);
    if (can) {
        struct scene_instance other = import->scene.instances[number];
        import->scene.instances[number].mesh = soup_mesh(import, mesh, &half[0]);
        other.mesh = soup_mesh(import, mesh, &half[1]);
        transform_add_instance(import, other);
    } else {
        mem_free(half[0].at);
        mem_free(half[1].at);
    }
    return can;
}

/* Both halves are of one material, and so of one body (interior.h): where they touch is no boundary. */
uint32_t transform_halve_bodies(struct import_result *import)
{
    const uint32_t count = import->scene.instance_count;
    uint32_t done = 0;

    for (uint32_t i = 0; i < count; i++)
        if (is_body(&import->scene, &import->scene.instances[i]))
            done += (uint32_t)halve_instance(import, i);
    return done;
}
