/* Bilinear patches. */
#include <math.h>
#include <string.h>

#include "client/import/builder/shapes_parts.h"

/* From a (k = 0) to b (k = n); the same bits from either end, so that neighbours fit. */
static double mix(double a, double b, uint32_t k, uint32_t n)
{
    return k == 0 ? a : k == n ? b : (a * (n - k) + b * k) / n;
}

/* Value `c` of a table of `width` at (i, j) / n of the patch. */
static double patch_value(const float *table, size_t width, const uint32_t corners[4], size_t c, uint32_t i, uint32_t j,
                          uint32_t n)
{
    double v[4];

    for (int k = 0; k < 4; k++)
        v[k] = (double)table[(size_t)corners[k] * width + c];
    return mix(mix(v[0], v[1], i, n), mix(v[2], v[3], i, n), j, n);
}

/* Does the value at p11 follow from the other three by an affine map? */
static int is_affine(const float *table, size_t width, const uint32_t corners[4])
{
    double size = 0, off = 0;

    for (size_t c = 0; c < width; c++) {
        double v[4];
        for (int k = 0; k < 4; k++)
            v[k] = (double)table[(size_t)corners[k] * width + c];
        size = fmax(size, fmax(fabs(v[1] - v[0]), fabs(v[2] - v[0])));
        off = fmax(off, fabs(v[0] - v[1] - v[2] + v[3]));
    }
    return off <= 1e-5 * size;
}

/* The normal of the surface itself; if it has none (a corner shared by two points), that of a point slightly inside. */
static void patch_normal(const struct shape_patches *patches, const uint32_t corners[4], double u, double v,
                         double out[3])
{
    for (int attempt = 0; attempt < 2; attempt++) {
        double du[3], dv[3];
        for (size_t c = 0; c < 3; c++) {
            double p[4];
            for (int k = 0; k < 4; k++)
                p[k] = (double)patches->positions[3 * (size_t)corners[k] + c];
            du[c] = (p[1] - p[0]) * (1 - v) + (p[3] - p[2]) * v;
            dv[c] = (p[2] - p[0]) * (1 - u) + (p[3] - p[1]) * u;
        }
        normalize3(du);
        normalize3(dv);
        cross3(du, dv, out);
        if (normalize3(out))
            return;
        u = fmin(fmax(u, 1e-3), 1 - 1e-3);
        v = fmin(fmax(v, 1e-3), 1 - 1e-3);
    }
}

static void add_patch(const struct shape_patches *patches, const uint32_t corners[4], uint32_t n,
                      struct mesh_source *out)
{
    size_t base = out->vertex_count;

    for (uint32_t j = 0; j <= n; j++)
        for (uint32_t i = 0; i <= n; i++) {
            double position[3], normal[3], uv[2] = {(double)i / n, (double)j / n};
            int given = 0;
            for (size_t c = 0; c < 3; c++)
                position[c] = patch_value(patches->positions, 3, corners, c, i, j, n);
            for (size_t c = 0; patches->normals && c < 3; c++)
                normal[c] = patch_value(patches->normals, 3, corners, c, i, j, n);
            given = patches->normals && normalize3(normal);
            if (!given)
                patch_normal(patches, corners, uv[0], uv[1], normal);
            for (size_t c = 0; patches->uv && c < 2; c++)
                uv[c] = patch_value(patches->uv, 2, corners, c, i, j, n);
            shape_add_vertex(out, position, normal, uv[0], uv[1]);
        }
    shape_add_grid(out, base, n, n, POLE_NONE);
}

static status bilinear(const struct shape_patches *patches, struct mesh_source *out, struct error *err)
{
    uint64_t n = patches->divisions, count = patches->patch_count;
    int affine = 1;

    if (n < 1 || n > SHAPE_SEGMENTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u divisions of a patch: 1 to %d are made", patches->divisions,
                         SHAPE_SEGMENTS_MAX);
    TRY(shape_check_numbers(patches->positions, 3 * patches->vertex_count, "coordinate", err));
    if (patches->normals)
        TRY(shape_check_numbers(patches->normals, 3 * patches->vertex_count, "normal component", err));
    if (patches->uv)
        TRY(shape_check_numbers(patches->uv, 2 * patches->vertex_count, "texture coordinate", err));
    for (size_t i = 0; i < 4 * patches->patch_count; i++)
        if (patches->corners[i] >= patches->vertex_count)
            return error_set(err, STATUS_ERR_INPUT, "index %zu is %u, but there are %zu vertices", i,
                             patches->corners[i], patches->vertex_count);
    for (size_t i = 0; affine && i < patches->patch_count; i++)
        affine = is_affine(patches->positions, 3, patches->corners + 4 * i) &&
                 (!patches->uv || is_affine(patches->uv, 2, patches->corners + 4 * i));
    n = affine ? 1 : n;
    if (count > SHAPE_TRIANGLES_MAX / (2 * n * n))
        return error_set(err, STATUS_ERR_LIMIT, "%llu patches in %llu divisions: more than %d triangles",
                         (unsigned long long)count, (unsigned long long)n, SHAPE_TRIANGLES_MAX);
    TRY(shape_reserve(out, count * (n + 1) * (n + 1), count * 2 * n * n, err));
    for (size_t i = 0; i < patches->patch_count; i++)
        add_patch(patches, patches->corners + 4 * i, (uint32_t)n, out);
    return STATUS_OK;
}

status shape_bilinear(const struct shape_patches *patches, struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(bilinear(patches, out, err), out);
}
