/* The kinds of shapes: a directive's parameters become a mesh. */
#include <math.h>
#include <string.h>

#include "client/import/builder/shapes.h"
#include "client/import/pbrt/read/pbrt_context.h"
#include "client/import/ply/ply.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* ---- arrays ------------------------------------------------------------------------------- */

static status copy_floats(struct pbrt *p, const struct pbrt_param *param, float limit, float **out)
{
    *out = must(mem_alloc_array(param->number_count, sizeof **out));
    for (size_t i = 0; i < param->number_count; i++) {
        if (!(fabs(param->numbers[i]) <= (double)limit))
            return pbrt_fail(p, STATUS_ERR_INPUT, &param->at, "\"%.40s\" holds %g: at most %g is taken", param->name,
                             param->numbers[i], (double)limit);
        (*out)[i] = (float)param->numbers[i];
    }
    return STATUS_OK;
}

/* The origin of a shape's positions: the file's origin, chosen by its first vertex, in the shape's
 * space. So shapes with the same matrix share it, and equal vertices stay equal. */
struct origin_choice {
    struct pbrt *p;
    const struct pbrt_directive *d;
};

static void choose_origin(void *user, const double first[3], double origin[3])
{
    const struct origin_choice *choice = user;
    struct pbrt *p = choice->p;
    const struct transform_d *ctm = &choice->d->ctm.at[0];
    double world[3], local[3], far = 0, near = 0;
    struct transform_d inverse;

    memset(origin, 0, 3 * sizeof *origin);
    if (!p->has_origin) {
        transform_d_point(ctm, first, world);
        mesh_origin_choose(world, p->origin);
        p->has_origin = 1;
    }
    if ((p->origin[0] == 0 && p->origin[1] == 0 && p->origin[2] == 0) || !transform_d_invert(ctm, &inverse))
        return;
    transform_d_point(&inverse, p->origin, local);
    for (int c = 0; c < 3; c++) {
        far = fmax(far, fabs(first[c]));
        near = fmax(near, fabs(first[c] - local[c]));
    }
    if (near < far) /* else the vertices are already near the shape's own origin */
        memcpy(origin, local, sizeof local);
}

/* How many of the shape's own units are a metre: a power of two. */
static double metre_of(const struct transform_d *ctm)
{
    double volume = fabs(transform_d_determinant(ctm));
    int exponent = 0;

    if (volume > 0 && volume < INFINITY)
        (void)frexp(volume, &exponent);
    return ldexp(1, -(exponent / 3));
}

/* "P" relative to its new origin. */
static status copy_positions(struct pbrt *p, const struct pbrt_directive *d, const struct pbrt_param *param,
                             float **out, double origin[3])
{
    struct origin_choice choice = {p, d};
    struct mesh_origin near;

    TRY(copy_floats(p, param, SCENE_COORDINATE_MAX, out));
    if (param->number_count >= 3)
        choose_origin(&choice, param->numbers, origin);
    mesh_origin_near(param->numbers, param->number_count / 3, origin, metre_of(&d->ctm.at[0]), &near);
    memcpy(origin, near.at, sizeof near.at);
    for (size_t i = 0; i < param->number_count; i++)
        (*out)[i] = mesh_place(&near, param->numbers[i], (int)(i % 3));
    return STATUS_OK;
}

static status copy_indices(struct pbrt *p, const struct pbrt_param *param, size_t vertex_count, uint32_t **out)
{
    *out = must(mem_alloc_array(param->number_count, sizeof **out));
    for (size_t i = 0; i < param->number_count; i++) {
        if (!(param->numbers[i] >= 0 && param->numbers[i] < (double)vertex_count))
            return pbrt_fail(p, STATUS_ERR_INPUT, &param->at, "\"%.40s\" holds %g: there are %zu vertices", param->name,
                             param->numbers[i], vertex_count);
        (*out)[i] = (uint32_t)param->numbers[i];
    }
    return STATUS_OK;
}

/* "P", "N", "uv" and "indices": common to shapes with vertices. */
struct vertex_arrays {
    double origin[3];
    float *positions, *normals, *uv;
    uint32_t *indices;
    size_t vertex_count, index_count;
};

static void arrays_release(struct vertex_arrays *a)
{
    mem_free(a->positions);
    mem_free(a->normals);
    mem_free(a->uv);
    mem_free(a->indices);
    memset(a, 0, sizeof *a);
}

static status read_arrays(struct pbrt *p, const struct pbrt_directive *d, unsigned corners, struct vertex_arrays *a)
{
    static const char *const uv_names[] = {"uv", "st"};
    const struct pbrt_param *positions = pbrt_param(d->params, "P", PBRT_TRIPLES),
                            *normals = pbrt_param(d->params, "N", PBRT_TRIPLES), *uv = NULL,
                            *indices = pbrt_param(d->params, "indices", PBRT_NUMBERS);

    if (!positions)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the shape has no \"point3 P\"");
    a->vertex_count = positions->number_count / 3;
    if (a->vertex_count > UINT32_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &positions->at, "the shape has too many vertices");
    for (int i = 0; i < 2 && !uv; i++) /* pbrt-v3 has them as floats too */
        uv = pbrt_param(d->params, uv_names[i], PBRT_PAIRS | PBRT_BIT(PBRT_FLOAT));
    if (normals && normals->number_count != positions->number_count) {
        pbrt_warn(p, &normals->at, "count of normals", "the shape has %zu normals for %zu vertices: left out",
                  normals->number_count / 3, a->vertex_count);
        normals = NULL;
    }
    if (uv && uv->number_count / 2 != a->vertex_count) {
        pbrt_warn(p, &uv->at, "count of texture coordinates",
                  "the shape has %zu texture coordinates for %zu vertices: left out", uv->number_count / 2,
                  a->vertex_count);
        uv = NULL;
    }
    TRY(copy_positions(p, d, positions, &a->positions, a->origin));
    if (normals)
        TRY(copy_floats(p, normals, 1e30f, &a->normals));
    if (uv)
        TRY(copy_floats(p, uv, 1e9f, &a->uv));
    if (indices) {
        if (indices->number_count % corners)
            return pbrt_fail(p, STATUS_ERR_INPUT, &indices->at, "the shape has %zu indices: they come by %u",
                             indices->number_count, corners);
        a->index_count = indices->number_count;
        return copy_indices(p, indices, a->vertex_count, &a->indices);
    }
    if (a->vertex_count != corners)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the shape has no \"integer indices\"");
    a->indices = must(mem_alloc_array(corners, sizeof *a->indices));
    for (unsigned i = 0; i < corners; i++)
        a->indices[i] = i;
    a->index_count = corners;
    return STATUS_OK;
}

/* ---- kinds of shapes ---------------------------------------------------------------------- */

static double phi_max(const struct pbrt_directive *d)
{
    double degrees = pbrt_float(d->params, "phimax", 360);

    return fmin(fmax(degrees, 0), 360) * PI_D / 180;
}

static status make_triangles(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    static const char *const unneeded[] = {"faceIndices", NULL};
    struct vertex_arrays a = {0};
    status result = read_arrays(p, d, 3, &a);

    pbrt_ignore(d->params, unneeded);
    if (pbrt_param(d->params, "S", ~0u))
        pbrt_warn(p, &d->at, "tangents", "a mesh's tangents (\"S\") are not read: the direction of its u is taken");
    if (result != STATUS_OK) {
        arrays_release(&a);
        return result;
    }
    memcpy(out->origin, a.origin, sizeof out->origin);
    out->positions = a.positions;
    out->normals = a.normals;
    out->uv[0] = a.uv;
    out->indices = a.indices;
    out->vertex_count = a.vertex_count;
    out->triangle_count = a.index_count / 3;
    return STATUS_OK;
}

static status make_ply(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    const char *name = pbrt_string(d->params, "filename", NULL);
    static const char *const detail[] = {"displacement.uvscale", "edgelength", NULL};
    struct origin_choice choice = {p, d};
    const struct ply_origin origin = {choose_origin, &choice, 1};
    struct buffer bytes = BUFFER_INIT;
    struct ply_report report = {0};
    status result;

    if (!name)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the shape names no \"string filename\"");
    if (pbrt_param(d->params, "displacement", ~0u))
        pbrt_warn(p, &d->at, "displaced mesh", "displacement of a mesh is not supported: the mesh is not displaced");
    pbrt_ignore(d->params, detail);
    result = pbrt_read_file(&p->reader, name, &d->at, &bytes, p->err);
    if (result == STATUS_OK) {
        result = ply_read(bytes.data, bytes.size, &origin, out, &report, p->err);
        if (result != STATUS_OK && result != STATUS_ERR_NO_MEMORY)
            error_prefix(p->err, "%s:%u: %.200s", d->at.file, d->at.line, name);
    }
    buffer_release(&bytes);
    if (result != STATUS_OK)
        return result;
    if (report.faces_invalid)
        pbrt_warn(p, &d->at, "faces of a PLY file",
                  "%.200s: %zu faces were dropped: they have fewer than 3 corners or a corner that "
                  "is not a vertex",
                  name, report.faces_invalid);
    /* pbrt materials do not use a file's colours. */
    mem_free(out->colors);
    out->colors = NULL;
    return STATUS_OK;
}

static status make_sphere(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    double r = pbrt_float(d->params, "radius", 1);
    double low = pbrt_float(d->params, "zmin", -r), high = pbrt_float(d->params, "zmax", r);

    return shape_sphere(r, fmin(low, high), fmax(low, high), phi_max(d), SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_disk(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    return shape_disk(pbrt_float(d->params, "height", 0), pbrt_float(d->params, "radius", 1),
                      pbrt_float(d->params, "innerradius", 0), phi_max(d), SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_cylinder(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    double low = pbrt_float(d->params, "zmin", -1), high = pbrt_float(d->params, "zmax", 1);

    return shape_cylinder(pbrt_float(d->params, "radius", 1), fmin(low, high), fmax(low, high), phi_max(d),
                          SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_paraboloid(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    double low = pbrt_float(d->params, "zmin", 0), high = pbrt_float(d->params, "zmax", 1);

    return shape_paraboloid(pbrt_float(d->params, "radius", 1), fmin(low, high), fmax(low, high), phi_max(d),
                            SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_cone(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    const double rim[3] = {pbrt_float(d->params, "radius", 1), 0, 0};
    const double top[3] = {0, 0, pbrt_float(d->params, "height", 1)};

    return shape_turned_line(rim, top, phi_max(d), SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_hyperboloid(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    double a[3] = {0, 0, 0}, b[3] = {1, 1, 1};

    (void)pbrt_triple(d->params, "p1", a);
    (void)pbrt_triple(d->params, "p2", b);
    return shape_turned_line(a, b, phi_max(d), SHAPE_SEGMENTS_DEFAULT, out, p->err);
}

static status make_patches(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    enum { DIVISIONS = 16 };
    struct vertex_arrays a = {0};
    status result = read_arrays(p, d, 4, &a);

    (void)pbrt_param(d->params, "faceIndices", ~0u);
    if (pbrt_param(d->params, "emissionfilename", ~0u))
        pbrt_warn(p, &d->at, "emission of a patch", "\"emissionfilename\" is not supported: the patch shines evenly");
    if (result == STATUS_OK) {
        const struct shape_patches patches = {.positions = a.positions,
                                              .normals = a.normals,
                                              .uv = a.uv,
                                              .vertex_count = a.vertex_count,
                                              .corners = a.indices,
                                              .patch_count = a.index_count / 4,
                                              .divisions = DIVISIONS};
        result = shape_bilinear(&patches, out, p->err);
        memcpy(out->origin, a.origin, sizeof out->origin);
    }
    arrays_release(&a);
    return result;
}

static status make_loop(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    long levels = pbrt_integer(d->params, "levels", pbrt_integer(d->params, "nlevels", 3));
    struct vertex_arrays a = {0};
    status result = read_arrays(p, d, 3, &a);

    (void)pbrt_string(d->params, "scheme", NULL);
    if (result == STATUS_OK && (levels < 0 || levels > SHAPE_LOOP_LEVELS_MAX))
        result = pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "a subdivision surface of %ld levels is not supported: 0 to %d",
                           levels, SHAPE_LOOP_LEVELS_MAX);
    if (result == STATUS_OK) {
        const struct shape_control control = {.positions = a.positions,
                                              .uv = a.uv,
                                              .vertex_count = a.vertex_count,
                                              .indices = a.indices,
                                              .triangle_count = a.index_count / 3};
        result = shape_loop(&control, (uint32_t)levels, out, p->err);
        memcpy(out->origin, a.origin, sizeof out->origin);
    }
    arrays_release(&a);
    return result;
}

static status make_curve(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out)
{
    enum { PIECES = 8, SIDES = 6 };
    static const char *const kinds[] = {"flat", "cylinder", "ribbon"};
    const char *basis = pbrt_string(d->params, "basis", "bezier"), *kind = pbrt_string(d->params, "type", "flat");
    const struct pbrt_param *points = pbrt_param(d->params, "P", PBRT_TRIPLES),
                            *normals = pbrt_param(d->params, "N", PBRT_TRIPLES);
    double width = pbrt_float(d->params, "width", 1);
    struct shape_curve curve = {.degree = (uint32_t)pbrt_integer(d->params, "degree", 3)};
    float *position = NULL, *facing = NULL;
    double origin[3] = {0, 0, 0};
    status result;

    (void)pbrt_param(d->params, "splitdepth", ~0u);
    if (!points)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the curve has no \"point3 P\"");
    curve.basis = strcmp(basis, "bspline") == 0 ? CURVE_BSPLINE : CURVE_BEZIER;
    for (int i = 0; i < 3; i++)
        if (strcmp(kind, kinds[i]) == 0)
            curve.kind = (enum shape_curve_kind)i;
    curve.width_start = (float)pbrt_float(d->params, "width0", width);
    curve.width_end = (float)pbrt_float(d->params, "width1", width);
    result = copy_positions(p, d, points, &position, origin);
    if (result == STATUS_OK && normals && curve.kind == CURVE_RIBBON)
        result = copy_floats(p, normals, 1e30f, &facing);
    curve.points = position;
    curve.point_count = points->number_count / 3;
    if (result == STATUS_OK && curve.kind == CURVE_RIBBON &&
        (!facing || normals->number_count / 3 != shape_curve_segments(&curve) + 1))
        result = pbrt_fail(p, STATUS_ERR_INPUT, &d->at,
                           "a ribbon needs as many \"normal N\" as it has segments, and one more");
    curve.normals = facing;
    THEN(result, shape_curves(&curve, 1, PIECES, SIDES, out, p->err));
    memcpy(out->origin, origin, sizeof out->origin);
    mem_free(position);
    mem_free(facing);
    return result;
}

static const struct {
    const char *kind;
    status (*make)(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out);
} kinds[] = {
    {"trianglemesh", make_triangles}, {"plymesh", make_ply},      {"sphere", make_sphere},
    {"disk", make_disk},              {"cylinder", make_cylinder}, {"bilinearmesh", make_patches},
    {"loopsubdiv", make_loop},        {"curve", make_curve},      {"cone", make_cone},
    {"paraboloid", make_paraboloid},  {"hyperboloid", make_hyperboloid},
};

pbrt_shape_make *pbrt_shape_kind(const char *kind)
{
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (strcmp(kind, kinds[i].kind) == 0)
            return kinds[i].make;
    return NULL;
}
