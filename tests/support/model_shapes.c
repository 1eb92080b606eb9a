/* The parts of a model. */
#include "tests/support/model_parts.h"

#include <math.h>
#include <string.h>

void model_init(struct model *m)
{
    memset(m, 0, sizeof *m);
    arena_init(&m->arena);
    m->fog = -1;
    m->up[1] = 1;
    m->yfov_rad = 0.7;
}

void model_release(struct model *m) { arena_release(&m->arena); }

struct model_material *model_material(struct model *m, const char *name)
{
    struct model_material *out = &m->materials[m->material_count++];

    *out = (struct model_material){.name = name, .color = {0.75, 0.75, 0.75}, .roughness = 1,
                                   .medium = -1};
    return out;
}

/* ---- shapes -------------------------------------------------------------------------------- */

static struct model_mesh *new_mesh(struct model *m, const char *name, uint32_t vertices, uint32_t triangles)
{
    struct model_mesh *out = &m->meshes[m->mesh_count++];

    *out = (struct model_mesh){.name = name, .material = m->material_count - 1,
                               .vertex_count = vertices, .triangle_count = triangles};
    out->at = NEW(m, vertices, point);
    out->triangles = NEW(m, triangles, corners);
    return out;
}

static void set_quad(struct model_mesh *mesh, uint32_t quad, const uint32_t corner[4])
{
    memcpy(mesh->triangles[2 * quad], (corners){corner[0], corner[1], corner[2]}, sizeof(corners));
    memcpy(mesh->triangles[2 * quad + 1], (corners){corner[0], corner[2], corner[3]}, sizeof(corners));
}

struct model_mesh *model_quads(struct model *m, const char *name, const double (*at)[3], uint32_t vertex_count,
                               const uint32_t (*quads)[4], uint32_t count)
{
    struct model_mesh *out = new_mesh(m, name, vertex_count, 2 * count);

    memcpy(out->at, at, vertex_count * sizeof *at);
    for (uint32_t i = 0; i < count; i++)
        set_quad(out, i, quads[i]);
    out->quads = 1;
    return out;
}

struct model_mesh *model_quad(struct model *m, const char *name, const double a[3], const double u[3],
                              const double v[3], double tiles)
{
    static const double s[4] = {0, 1, 1, 0}, t[4] = {0, 0, 1, 1};
    static const uint32_t corner[4] = {0, 1, 2, 3};
    struct model_mesh *out = new_mesh(m, name, 4, 2);

    out->uv = NEW(m, 4, point2);
    for (int i = 0; i < 4; i++) {
        for (int c = 0; c < 3; c++)
            out->at[i][c] = a[c] + s[i] * u[c] + t[i] * v[c];
        out->uv[i][0] = tiles * s[i];
        out->uv[i][1] = tiles * t[i];
    }
    set_quad(out, 0, corner);
    out->quads = 1;
    return out;
}

struct model_mesh *model_box(struct model *m, const char *name, const double low[3], const double high[3])
{
    struct model_mesh *out = new_mesh(m, name, 24, 12);

    for (uint32_t f = 0; f < 6; f++) {
        uint32_t axis = f / 2, u = (axis + 1) % 3, v = (axis + 2) % 3, side = f & 1;
        for (uint32_t i = 0; i < 4; i++) {
            double *p = out->at[4 * f + i];
            p[axis] = side ? high[axis] : low[axis];
            p[u] = i == 1 || i == 2 ? high[u] : low[u];
            p[v] = i >= 2 ? high[v] : low[v];
        }
        set_quad(out, f, side ? (uint32_t[4]){4 * f, 4 * f + 1, 4 * f + 2, 4 * f + 3}
                              : (uint32_t[4]){4 * f, 4 * f + 3, 4 * f + 2, 4 * f + 1});
    }
    out->quads = 1;
    return out;
}

struct model_mesh *model_ball(struct model *m, const char *name, const double centre[3], double radius, int segments)
{
    uint32_t rows = (uint32_t)segments, columns = 2 * rows, t = 0;
    struct model_mesh *out = new_mesh(m, name, (rows + 1) * columns, 2 * (rows - 1) * columns);

    out->normal = NEW(m, out->vertex_count, point);
    for (uint32_t i = 0; i < out->vertex_count; i++) {
        double theta = M_PI * (i / columns) / rows, phi = 2 * M_PI * (i % columns) / columns;
        double across = i / columns == 0 || i / columns == rows ? 0 : sin(theta);
        const double n[3] = {across * cos(phi), cos(theta), across * sin(phi)};
        for (int c = 0; c < 3; c++) {
            out->normal[i][c] = n[c];
            out->at[i][c] = centre[c] + ldexp(rint(ldexp(radius * n[c], 12)), -12);
        }
    }
    for (uint32_t i = 0; i < rows * columns; i++) {
        uint32_t row = i / columns, next = i % columns == columns - 1 ? i + 1 - columns : i + 1;
        uint32_t below = i + columns, below_next = next + columns;
        if (row > 0)
            memcpy(out->triangles[t++], (corners){i, next, below_next}, sizeof(corners));
        if (row < rows - 1)
            memcpy(out->triangles[t++], (corners){i, below_next, below}, sizeof(corners));
    }
    return out;
}
