/* Another model of the same scene. */
#include "tests/support/model_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "tests/support/statistics.h"

/* ---- other triangles ------------------------------------------------------------------------ */

static void *copied(struct model *m, const void *from, size_t count, size_t size_bytes)
{
    return from ? memcpy(need(arena_alloc(&m->arena, count, size_bytes)), from, count * size_bytes) : NULL;
}

static void copy_mesh(struct model *m, struct model_mesh *mesh)
{
    mesh->at = copied(m, mesh->at, mesh->vertex_count, sizeof *mesh->at);
    mesh->normal = copied(m, mesh->normal, mesh->vertex_count, sizeof *mesh->normal);
    mesh->uv = copied(m, mesh->uv, mesh->vertex_count, sizeof *mesh->uv);
    mesh->morph = copied(m, mesh->morph, mesh->vertex_count, sizeof *mesh->morph);
    mesh->bend = copied(m, mesh->bend, mesh->vertex_count, sizeof *mesh->bend);
    mesh->triangles = copied(m, mesh->triangles, mesh->triangle_count, sizeof *mesh->triangles);
}

/* abc, acd become abd, bcd. */
static void flip_quads(struct model_mesh *mesh)
{
    for (uint32_t i = 0; mesh->quads && i + 1 < mesh->triangle_count; i += 2) {
        uint32_t *first = mesh->triangles[i], *second = mesh->triangles[i + 1];
        const uint32_t a = first[0], b = first[1], c = first[2], d = second[2];
        memcpy(first, (corners){a, b, d}, sizeof(corners));
        memcpy(second, (corners){b, c, d}, sizeof(corners));
    }
}

/* New vertices: number i is the mean of from[i][0] and from[i][1]. */
static void remake_vertices(struct model *m, struct model_mesh *mesh, const uint32_t (*from)[2], uint32_t count)
{
    const struct model_mesh old = *mesh;

    mesh->vertex_count = count;
#define MEAN_OF(field, type, components)                                                       \
    if (old.field) {                                                                           \
        mesh->field = NEW(m, count, type);                                                     \
        for (uint32_t i = 0; i < count; i++)                                                   \
            for (int c = 0; c < (components); c++)                                             \
                mesh->field[i][c] =                                                            \
                    (old.field[from[i][0]][c] + old.field[from[i][1]][c]) / 2;                 \
    }
    MEAN_OF(at, point, 3)
    MEAN_OF(normal, point, 3)
    MEAN_OF(uv, point2, 2)
    MEAN_OF(morph, point, 3)
#undef MEAN_OF
    if (old.bend) {
        mesh->bend = NEW(m, count, double);
        for (uint32_t i = 0; i < count; i++)
            mesh->bend[i] = (old.bend[from[i][0]] + old.bend[from[i][1]]) / 2;
    }
    for (uint32_t i = 0; old.normal && i < count; i++) {
        double *n = mesh->normal[i], length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int c = 0; c < 3; c++)
            n[c] /= length;
    }
}

/* Three corners and three midpoints a triangle; edges' midpoints agree, since they are symmetric in
 * an edge's ends. */
static void split_four(struct model *m, struct model_mesh *mesh)
{
    static const uint8_t parts[4][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}};
    uint32_t count = mesh->triangle_count;
    uint32_t(*from)[2] = need(arena_alloc(&m->arena, 6 * (size_t)count, sizeof *from));
    corners *triangles = NEW(m, 4 * (size_t)count, corners);

    for (uint32_t t = 0; t < count; t++) {
        for (uint32_t k = 0; k < 3; k++) {
            from[6 * t + k][0] = from[6 * t + k][1] = mesh->triangles[t][k];
            from[6 * t + 3 + k][0] = mesh->triangles[t][k];
            from[6 * t + 3 + k][1] = mesh->triangles[t][(k + 1) % 3];
        }
        for (uint32_t i = 0; i < 12; i++)
            triangles[4 * t + i / 3][i % 3] = 6 * t + parts[i / 3][i % 3];
    }
    remake_vertices(m, mesh, (const uint32_t(*)[2])from, 6 * count);
    mesh->triangles = triangles;
    mesh->triangle_count = 4 * count;
    mesh->quads = 0;
}

static void turn_corners(struct model_mesh *mesh, struct test_random *random)
{
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        corners old;
        uint32_t by = (uint32_t)(test_random_u64(random) % 3);
        memcpy(old, mesh->triangles[t], sizeof old);
        for (uint32_t k = 0; k < 3; k++)
            mesh->triangles[t][k] = old[(k + by) % 3];
    }
}

/* A random order of `count` things; never the one they have. */
static uint32_t *shuffled(struct model *m, uint32_t count, struct test_random *random)
{
    uint32_t *order = NEW(m, count, uint32_t);

    for (uint32_t i = 0; i < count; i++)
        order[i] = i;
    for (uint32_t i = count - 1; i > 0 && count > 0; i--) {
        uint32_t j = (uint32_t)(test_random_u64(random) % i), swap = order[i];
        order[i] = order[j];
        order[j] = swap;
    }
    return order;
}

static void shuffle_triangles(struct model *m, struct model_mesh *mesh, struct test_random *random)
{
    const uint32_t *order = shuffled(m, mesh->triangle_count, random);
    corners *triangles = NEW(m, mesh->triangle_count, corners);

    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        memcpy(triangles[t], mesh->triangles[order[t]], sizeof(corners));
    mesh->triangles = triangles;
    mesh->quads = 0;
}

static void shuffle_vertices(struct model *m, struct model_mesh *mesh, struct test_random *random)
{
    const uint32_t *order = shuffled(m, mesh->vertex_count, random);
    uint32_t *where = NEW(m, mesh->vertex_count, uint32_t);
    uint32_t(*from)[2] = need(arena_alloc(&m->arena, mesh->vertex_count, sizeof *from));

    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        from[i][0] = from[i][1] = order[i];
        where[order[i]] = i;
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int k = 0; k < 3; k++)
            mesh->triangles[t][k] = where[mesh->triangles[t][k]];
    remake_vertices(m, mesh, (const uint32_t(*)[2])from, mesh->vertex_count);
}

static void unindex(struct model *m, struct model_mesh *mesh)
{
    uint32_t count = 3 * mesh->triangle_count;
    uint32_t(*from)[2] = need(arena_alloc(&m->arena, count, sizeof *from));

    for (uint32_t i = 0; i < count; i++) {
        from[i][0] = from[i][1] = mesh->triangles[i / 3][i % 3];
        mesh->triangles[i / 3][i % 3] = i;
    }
    remake_vertices(m, mesh, (const uint32_t(*)[2])from, count);
}

static void cut_into_pieces(struct model *m)
{
    enum { PIECES = 3 };
    uint32_t whole = m->mesh_count;
    struct model_mesh *old = copied(m, m->meshes, whole, sizeof *old);

    m->mesh_count = 0;
    for (uint32_t i = 0; i < whole; i++)
        for (uint32_t p = 0, pieces = old[i].radius > 0 ? 1 : PIECES; p < pieces; p++) {
            uint32_t first = old[i].triangle_count * p / pieces;
            uint32_t end = old[i].triangle_count * (p + 1) / pieces;
            struct model_mesh *piece = &m->meshes[m->mesh_count];
            if (first == end)
                continue;
            need(m->mesh_count < MODEL_MESHES_MAX ? piece : NULL);
            *piece = old[i];
            piece->triangles += first;
            piece->triangle_count = end - first;
            m->mesh_count++;
        }
}

static void give_own_materials(struct model *m)
{
    struct model_material old[MODEL_MATERIALS_MAX];

    memcpy(old, m->materials, sizeof old);
    need(m->mesh_count <= MODEL_MATERIALS_MAX ? m : NULL);
    for (uint32_t i = 0; i < m->mesh_count; i++) {
        m->materials[i] = old[m->meshes[i].material];
        m->meshes[i].material = i;
    }
    m->material_count = m->mesh_count;
}

/* ---- another place -------------------------------------------------------------------------- */

static void turn(const struct model_way *way, const double v[3], double out[3])
{
    double result[3];

    for (int r = 0; r < 3; r++)
        result[r] = way->turn[r][0] * v[0] + way->turn[r][1] * v[1] + way->turn[r][2] * v[2];
    memcpy(out, result, sizeof result);
}

static void stretch(const struct model_way *way, const double v[3], double out[3])
{
    turn(way, v, out);
    for (int c = 0; c < 3; c++)
        out[c] *= way->scale;
}

void model_place(const struct model_way *way, const double p[3], double out[3])
{
    stretch(way, p, out);
    for (int c = 0; c < 3; c++)
        out[c] += way->shift[c];
}

static int mirrors(const struct model_way *way)
{
    const double(*a)[3] = way->turn;

    return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
               a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]) <
           0;
}

static void place_mesh(const struct model_way *way, struct model_mesh *mesh)
{
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        model_place(way, mesh->at[i], mesh->at[i]);
        if (mesh->normal)
            turn(way, mesh->normal[i], mesh->normal[i]);
        if (mesh->morph)
            stretch(way, mesh->morph[i], mesh->morph[i]);
    }
    mesh->radius *= way->scale;
    model_place(way, mesh->pivot, mesh->pivot);
    stretch(way, mesh->tip, mesh->tip);
    stretch(way, mesh->motion.travel, mesh->motion.travel);
    turn(way, mesh->motion.axis, mesh->motion.axis);
    if (!mirrors(way))
        return;
    mesh->motion.turn_rad = -mesh->motion.turn_rad;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        uint32_t swap = mesh->triangles[t][1];
        mesh->triangles[t][1] = mesh->triangles[t][2];
        mesh->triangles[t][2] = swap;
    }
}

/* What no matrix of a file scales: light's power, coefficients per metre, the lens. */
static void rescale(struct model *m, double scale)
{
    for (uint32_t i = 0; i < m->light_count; i++)
        for (int c = 0; c < 3; c++)
            m->lights[i].intensity[c] *= scale * scale;
    for (uint32_t i = 0; i < m->material_count; i++)
        m->materials[i].attenuation_distance *= scale;
    for (uint32_t i = 0; i < m->medium_count; i++)
        for (int c = 0; c < 3; c++) {
            m->media[i].absorption[c] /= scale;
            m->media[i].scattering[c] /= scale;
        }
    m->lens_radius *= scale;
    m->focus_distance *= scale;
}

static void place_all(const struct model_way *way, struct model *m)
{
    for (uint32_t i = 0; i < m->mesh_count; i++)
        place_mesh(way, &m->meshes[i]);
    for (uint32_t i = 0; i < m->light_count; i++) {
        model_place(way, m->lights[i].at, m->lights[i].at);
        turn(way, m->lights[i].direction, m->lights[i].direction);
    }
    model_place(way, m->eye, m->eye);
    model_place(way, m->target, m->target);
    turn(way, m->up, m->up);
    stretch(way, m->camera_travel, m->camera_travel);
}

/* ---- other names, another order ------------------------------------------------------------- */

static void rename_all(struct model *m, struct test_random *random)
{
    uint32_t names = m->mesh_count + m->material_count;

    for (uint32_t i = 0; i < names; i++) {
        char name[32];
        snprintf(name, sizeof name, "%c%llx", 'a' + (int)(i % 26), (unsigned long long)test_random_u64(random));
        if (i < m->mesh_count)
            m->meshes[i].name = need(arena_strdup(&m->arena, name));
        else
            m->materials[i - m->mesh_count].name = need(arena_strdup(&m->arena, name));
    }
}

static int shines(const struct model *m, const struct model_mesh *mesh)
{
    return m->materials[mesh->material].emission[0] > 0;
}

/* Put the meshes that shine into the order that they had in `old`. */
static void restore_lamps(struct model *m, const struct model_mesh *old)
{
    uint32_t next = 0;

    for (uint32_t i = 0; i < m->mesh_count; i++) {
        if (!shines(m, &m->meshes[i]))
            continue;
        while (!shines(m, &old[next]))
            next++;
        m->meshes[i] = old[next++];
    }
}

static void reorder_materials(struct model *m, struct test_random *random)
{
    const struct model_material *old = copied(m, m->materials, m->material_count, sizeof *old);
    const uint32_t *order = shuffled(m, m->material_count, random);
    uint32_t *where = NEW(m, m->material_count, uint32_t);

    for (uint32_t i = 0; i < m->material_count; i++) {
        m->materials[i] = old[order[i]];
        where[order[i]] = i;
    }
    for (uint32_t i = 0; i < m->mesh_count; i++)
        m->meshes[i].material = where[m->meshes[i].material];
}

static void reorder_all(struct model *m, int lights_too, struct test_random *random)
{
    const struct model_mesh *old;
    const struct model_light *lights = copied(m, m->lights, MODEL_LIGHTS_MAX, sizeof *lights);
    const uint32_t *order;

    reorder_materials(m, random);
    old = copied(m, m->meshes, m->mesh_count, sizeof *old);
    order = shuffled(m, m->mesh_count, random);
    for (uint32_t i = 0; i < m->mesh_count; i++)
        m->meshes[i] = old[order[i]];
    if (!lights_too) {
        restore_lamps(m, old);
        return;
    }
    for (uint32_t i = 0; i < m->light_count; i++)
        m->lights[i] = lights[m->light_count - 1 - i];
}

void model_vary(const struct model *m, const struct model_way *way, struct model *out)
{
    struct test_random random = {7};

    *out = *m;
    arena_init(&out->arena);
    for (uint32_t i = 0; i < out->mesh_count; i++) {
        struct model_mesh *mesh = &out->meshes[i];
        copy_mesh(out, mesh);
        if (way->flags & WAY_FLIP_QUADS)
            flip_quads(mesh);
        if (way->flags & WAY_SPLIT_FOUR)
            split_four(out, mesh);
        if (way->flags & WAY_TURN_CORNERS)
            turn_corners(mesh, &random);
        if (way->flags & WAY_SHUFFLE_TRIANGLES)
            shuffle_triangles(out, mesh, &random);
        if (way->flags & WAY_SHUFFLE_VERTICES)
            shuffle_vertices(out, mesh, &random);
        if (way->flags & WAY_UNINDEXED)
            unindex(out, mesh);
    }
    rescale(out, way->scale);
    if (!(way->flags & WAY_IN_MATRIX))
        place_all(way, out);
    if (way->flags & WAY_PIECES)
        cut_into_pieces(out);
    if (way->flags & WAY_OWN_MATERIALS)
        give_own_materials(out);
    if (way->flags & WAY_RENAMED)
        rename_all(out, &random);
    if (way->flags & WAY_REORDERED)
        reorder_all(out, (way->flags & WAY_LIGHTS_TOO) != 0, &random);
}
