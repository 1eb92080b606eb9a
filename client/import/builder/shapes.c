#include "client/import/builder/shapes_parts.h"

#include <math.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"

void mesh_source_reverse(struct mesh_source *mesh)
{
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        uint32_t swap = mesh->indices[3 * t + 1];
        mesh->indices[3 * t + 1] = mesh->indices[3 * t + 2];
        mesh->indices[3 * t + 2] = swap;
    }
    for (size_t i = 0; mesh->normals && i < 3 * mesh->vertex_count; i++)
        mesh->normals[i] = -mesh->normals[i] + 0.0f;
}

int shape_is_coordinate(double x) { return fabs(x) <= (double)SCENE_COORDINATE_MAX; }

status shape_check_numbers(const float *values, size_t count, const char *what, struct error *err)
{
    for (size_t i = 0; i < count; i++)
        if (!shape_is_coordinate((double)values[i]))
            return error_set(err, STATUS_ERR_INPUT, "%s %zu is %g: only finite numbers up to 1e15 are taken", what, i,
                             (double)values[i]);
    return STATUS_OK;
}

status shape_reserve(struct mesh_source *mesh, uint64_t vertices, uint64_t triangles, struct error *err)
{
    if (triangles > SHAPE_TRIANGLES_MAX || vertices > UINT32_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the shape would have %llu triangles: at most %d are made",
                         (unsigned long long)triangles, SHAPE_TRIANGLES_MAX);
    mesh->positions = must(mem_alloc_array((size_t)vertices, 3 * sizeof *mesh->positions));
    mesh->normals = must(mem_alloc_array((size_t)vertices, 3 * sizeof *mesh->normals));
    mesh->uv[0] = must(mem_alloc_array((size_t)vertices, 2 * sizeof *mesh->uv[0]));
    mesh->indices = must(mem_alloc_array((size_t)triangles, 3 * sizeof *mesh->indices));
    return STATUS_OK;
}

void shape_add_vertex(struct mesh_source *mesh, const double position[3], const double normal[3], double u, double v)
{
    size_t at = mesh->vertex_count++;

    for (size_t c = 0; c < 3; c++) {
        /* + 0.0f: no negative zero, so that equal positions have equal bits. */
        mesh->positions[3 * at + c] = (float)position[c] + 0.0f;
        mesh->normals[3 * at + c] = (float)normal[c] + 0.0f;
    }
    mesh->uv[0][2 * at] = (float)u;
    mesh->uv[0][2 * at + 1] = (float)v;
}

void shape_add_triangle(struct mesh_source *mesh, size_t a, size_t b, size_t c)
{
    uint32_t *to = mesh->indices + 3 * mesh->triangle_count++;

    to[0] = (uint32_t)a;
    to[1] = (uint32_t)b;
    to[2] = (uint32_t)c;
}

void shape_add_grid(struct mesh_source *mesh, size_t base, size_t columns, size_t rows, int poles)
{
    for (size_t j = 0; j < rows; j++)
        for (size_t i = 0; i < columns; i++) {
            size_t a = base + j * (columns + 1) + i, b = a + 1;
            size_t d = a + columns + 1, c = d + 1;
            if (j > 0 || !(poles & POLE_FIRST))
                shape_add_triangle(mesh, a, b, c);
            if (j + 1 < rows || !(poles & POLE_LAST))
                shape_add_triangle(mesh, a, c, d);
        }
}

double dot3(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross3(const double a[3], const double b[3], double out[3])
{
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];

    out[2] = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
}

int normalize3(double a[3])
{
    double most = fmax(fabs(a[0]), fmax(fabs(a[1]), fabs(a[2])));
    double length;

    if (!(most > 1e-150 && most < 1e150)) {
        a[0] = a[1] = a[2] = 0;
        return 0;
    }
    length = sqrt(dot3(a, a));
    for (int c = 0; c < 3; c++)
        a[c] /= length;
    return 1;
}
status shape_finish(status result, struct mesh_source *out)
{
    if (result != STATUS_OK)
        mesh_source_release(out);
    return result;
}
