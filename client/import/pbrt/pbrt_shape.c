/* Shapes: meshes with a material, placed once or as parts of an object. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/builder/shapes.h"
#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* ---- meshes ------------------------------------------------------------------------------- */

/* In pbrt a triangle's normals point to its front. */
static void wind_by_normals(struct mesh_source *mesh)
{
    for (size_t t = 0; mesh->normals && t < mesh->triangle_count; t++) {
        uint32_t *i = mesh->indices + 3 * t;
        double e[2][3], g[3], dot = 0;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 2; k++)
                e[k][c] = (double)mesh->positions[3 * (size_t)i[k + 1] + (size_t)c] -
                          (double)mesh->positions[3 * (size_t)i[0] + (size_t)c];
        for (int c = 0; c < 3; c++) {
            g[c] = e[0][(c + 1) % 3] * e[1][(c + 2) % 3] - e[0][(c + 2) % 3] * e[1][(c + 1) % 3];
            for (int k = 0; k < 3; k++)
                dot += g[c] * (double)mesh->normals[3 * (size_t)i[k] + (size_t)c];
        }
        if (dot < 0) {
            uint32_t swap = i[1];
            i[1] = i[2];
            i[2] = swap;
        }
    }
}

/* pbrt's default texture coordinates, in each triangle. */
static status give_uv(struct pbrt *p, struct mesh_source *mesh)
{
    static const float corner[3][2] = {{0, 0}, {1, 0}, {1, 1}};
    size_t count = mesh->triangle_count * 3;

    if (mesh->uv[0] || count == 0)
        return STATUS_OK;
    if (count > UINT32_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "a mesh has too many triangles");
    mesh_source_gather(mesh, mesh->indices, count);
    mesh->uv[0] = must(mem_alloc_array(count, 2 * sizeof *mesh->uv[0]));
    for (size_t i = 0; i < count; i++) {
        memcpy(mesh->uv[0] + 2 * i, corner[i % 3], sizeof corner[0]);
        mesh->indices[i] = (uint32_t)i;
    }
    return STATUS_OK;
}

static double world_area(const struct transform_d *m, const struct mesh_source *mesh)
{
    double sum = 0;

    for (size_t t = 0; t < mesh->triangle_count; t++) {
        double e[2][3], w[2][3], square = 0;
        for (int k = 0; k < 2; k++)
            for (size_t c = 0; c < 3; c++)
                e[k][c] = (double)mesh->positions[3 * (size_t)mesh->indices[3 * t + (size_t)k + 1] + c] -
                          (double)mesh->positions[3 * (size_t)mesh->indices[3 * t] + c];
        for (int k = 0; k < 2; k++)
            for (int r = 0; r < 3; r++)
                w[k][r] = m->m[r][0] * e[k][0] + m->m[r][1] * e[k][1] + m->m[r][2] * e[k][2];
        for (int c = 0; c < 3; c++) {
            double g = w[0][(c + 1) % 3] * w[1][(c + 2) % 3] - w[0][(c + 2) % 3] * w[1][(c + 1) % 3];
            square += g * g;
        }
        sum += sqrt(square) / 2;
    }
    return sum;
}

/* The same, of what the mesh stands in for. */
static double true_area(const struct transform_d *m, const struct mesh_source *mesh)
{
    const struct transform_d own = transform_d_identity();

    if (!mesh->stands_in)
        return world_area(m, mesh);
    return world_area(m, mesh) * mesh->true_area / world_area(&own, mesh);
}

static void copy_mesh(const struct mesh_source *from, struct mesh_source *to)
{
    *to = (struct mesh_source){.vertex_count = from->vertex_count,
                               .triangle_count = from->triangle_count,
                               .stands_in = from->stands_in,
                               .true_area = from->true_area};
    memcpy(to->origin, from->origin, sizeof to->origin);
    to->positions = must(mem_memdup(from->positions, from->vertex_count * 3 * sizeof(float)));
    to->indices = must(mem_memdup(from->indices, from->triangle_count * 3 * sizeof(uint32_t)));
    if (from->normals)
        to->normals = must(mem_memdup(from->normals, from->vertex_count * 3 * sizeof(float)));
    if (from->uv[0])
        to->uv[0] = must(mem_memdup(from->uv[0], from->vertex_count * 2 * sizeof(float)));
}

/* ---- placing ------------------------------------------------------------------------------ */

status pbrt_instance(struct pbrt *p, const struct pbrt_part *part)
{
    struct transform_d world = pbrt_to_world(p, &part->ctm.at[0]), inverse;
    struct scene_instance instance;

    if (!transform_d_invert(&world, &inverse)) {
        pbrt_warn(p, &part->at, "singular matrix", "the shape's matrix cannot be inverted: the shape is left out");
        return STATUS_OK;
    }
    scene_instance_default(&instance);
    instance.name = part->name;
    instance.asset = part->asset;
    instance.mesh = part->mesh;
    instance.material = part->material;
    instance.to_world = world;
    TRY(pbrt_node(p, &part->ctm, &part->at, &instance.node));
    return builder_add_instance(p->b, &instance);
}

static status place(struct pbrt *p, const struct pbrt_part *part)
{
    struct pbrt_object *o = p->object;

    if (!o)
        return pbrt_instance(p, part);
    if (o->count >= PBRT_OBJECT_SHAPES_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &part->at, "an object has more than %d shapes", PBRT_OBJECT_SHAPES_MAX);
    MUST_GROW(o->parts, o->capacity, o->count + 1);
    o->parts[o->count++] = *part;
    return STATUS_OK;
}

status pbrt_object_place(struct pbrt *p, const char *name, const struct pbrt_place *at)
{
    const struct pbrt_object *object = pbrt_name_find(&p->objects, name);

    if (!object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the object \"%.80s\" is not known", name);
    for (size_t i = 0; i < object->count; i++) {
        struct pbrt_part part = object->parts[i];
        for (int k = 0; k < 2; k++)
            part.ctm.at[k] = transform_d_multiply(&p->now.ctm.at[k], &part.ctm.at[k]);
        part.at = *at;
        part.asset = object->name;
        TRY(pbrt_instance(p, &part));
    }
    return STATUS_OK;
}

/* ---- surfaces ----------------------------------------------------------------------------- */

/* pbrt-v3 has an alpha on meshes alone, and it is a mask. */
static status read_alpha(struct pbrt *p, const struct pbrt_directive *d, const struct pbrt_texture **out)
{
    if (p->version3 && strcmp(d->kind, "trianglemesh") != 0 && strcmp(d->kind, "plymesh") != 0)
        return STATUS_OK;
    TRY(pbrt_float_texture(p, d->params, "alpha", out));
    if (*out && p->version3)
        *out = pbrt_mask(p, *out);
    if (*out && (*out)->op == TEXTURE_CONSTANT && (*out)->value[0] >= 1)
        *out = NULL;
    if (pbrt_param(d->params, "shadowalpha", ~0u))
        pbrt_warn(p, &d->at, "shadow alpha", "\"shadowalpha\" is not supported: \"alpha\" counts for shadows too");
    return STATUS_OK;
}

/* In pbrt-v3 the front of a mesh of triangles is where its normals point, if it has any: its ReverseOrientation does nothing to them. */
static int is_reversed(const struct pbrt *p, const struct pbrt_directive *d, const struct mesh_source *mesh)
{
    const int of_triangles =
        strcmp(d->kind, "trianglemesh") == 0 || strcmp(d->kind, "plymesh") == 0 || strcmp(d->kind, "loopsubdiv") == 0;

    return p->now.reversed && !(p->version3 && of_triangles && mesh->normals);
}

/* The media behind and before the surface; none if they are the same. */
static status read_media(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_surface *s)
{
    if (strcmp(p->now.inside, p->now.outside) == 0)
        return STATUS_OK;
    TRY(pbrt_medium_row(p, p->now.inside, &d->at, &s->medium));
    return pbrt_medium_row(p, p->now.outside, &d->at, &s->medium_outside);
}

static void tangents_of(const struct pbrt_surface *s, struct mesh_tangents *out)
{
    /* The tangents of u and -v, which all our slots use. */
    *out = (struct mesh_tangents){.wanted = pbrt_material_wants_tangents(s->material),
                                  .uv_transform = {{1, 0, 0}, {0, -1, 1}}};
}

static status add_part(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_surface *s, struct mesh_source *mesh,
                       int64_t *mesh_row)
{
    struct pbrt_part part = {.name = s->name, .asset = "", .ctm = d->ctm, .at = d->at};
    struct mesh_tangents tangents;

    for (int k = 0; k < 2; k++) {
        double at[3];
        transform_d_point(&d->ctm.at[k], mesh->origin, at);
        for (int c = 0; c < 3; c++)
            part.ctm.at[k].m[c][3] = at[c];
    }
    tangents_of(s, &tangents);
    TRY(mesh_finish(p->b, mesh, builder_name(p->b, d->kind), &tangents, mesh_row));
    if (*mesh_row < 0)
        return STATUS_OK;
    part.mesh = (uint32_t)*mesh_row;
    TRY(pbrt_material_row(p, s, &part.material));
    return place(p, &part);
}

/* A one-sided light becomes two surfaces, each visible only from its own side; a closed one needs no back. */
static status add_light(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_surface *s,
                        struct mesh_source *mesh)
{
    struct mesh_source back;
    int64_t row;
    status result;

    if (s->light->two_sided || s->material->base.kind == MATERIAL_INTERFACE || s->material->base.refractive)
        return add_part(p, d, s, mesh, &row);
    s->one_sided = 1;
    copy_mesh(mesh, &back);
    result = add_part(p, d, s, mesh, &row);
    if (result == STATUS_OK && row >= 0 && p->b->meshes[row].closed <= 0) {
        s->light = NULL;
        mesh_source_reverse(&back);
        result = add_part(p, d, s, &back, &row);
    }
    mesh_source_release(&back);
    return result;
}

/* Shapes have no names: that of its file, or its kind and number. */
static const char *shape_name(struct pbrt *p, const struct pbrt_directive *d)
{
    const char *file = strcmp(d->kind, "plymesh") == 0 ? pbrt_string(d->params, "filename", NULL) : NULL;
    const char *folder = file ? strrchr(file, '/') : NULL, *end;
    char name[SCENE_NAME_MAX + 1];

    file = folder ? folder + 1 : file;
    end = file ? strstr(file, ".ply") : NULL;
    if (file)
        snprintf(name, sizeof name, "%.*s", (int)(end ? end - file : SCENE_NAME_MAX), file);
    else
        snprintf(name, sizeof name, "%.60s %u", d->kind, ++p->shape_count);
    return builder_name(p->b, name);
}

static status add_shape(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *mesh)
{
    struct pbrt_surface s = {.name = shape_name(p, d),
                             .material = p->now.material,
                             .light = p->now.area_light,
                             .medium = BUILDER_NO_ROW,
                             .medium_outside = BUILDER_NO_ROW};
    struct transform_d world = pbrt_to_world(p, &d->ctm.at[0]);
    int64_t row;

    TRY(read_alpha(p, d, &s.alpha));
    TRY(pbrt_override(p, d->params, &s.material));
    TRY(pbrt_material_resolve(p, s.material, 0));
    if (s.light)
        TRY(pbrt_area_light_resolve(p, s.light));
    if (s.light && p->object) {
        pbrt_warn(p, &d->at, "light in an object",
                  "an area light in an object definition is not supported (nor by pbrt): it does "
                  "not shine");
        s.light = NULL;
    }
    if (s.light && pbrt_is_moving(&d->ctm) && s.light->power > 0)
        pbrt_warn(p, &d->at, "power of a moving light", "a moving light's area is taken at the start of its motion");
    if (s.light && s.alpha && s.alpha->op == TEXTURE_CONSTANT && s.alpha->value[0] <= 0)
        pbrt_warn(p, &d->at, "invisible light",
                  "a light of \"alpha\" 0, which cannot be seen itself, is not supported: it does "
                  "not shine");
    wind_by_normals(mesh);
    if (is_reversed(p, d, mesh))
        mesh_source_reverse(mesh);
    TRY(read_media(p, d, &s));
    if (pbrt_material_uses_uv(s.material) || (s.alpha && s.alpha->op != TEXTURE_CONSTANT) ||
        (s.light && s.light->image))
        TRY(give_uv(p, mesh));
    s.area = s.light ? true_area(&world, mesh) : 0;
    return s.light ? add_light(p, d, &s, mesh) : add_part(p, d, &s, mesh, &row);
}

status pbrt_shape(struct pbrt *p, const struct pbrt_directive *d)
{
    struct mesh_source mesh = {0};
    pbrt_shape_make *make = pbrt_shape_kind(d->kind);
    status result;
    char what[96];

    snprintf(what, sizeof what, "shape \"%.60s\"", d->kind);
    if (!make) {
        pbrt_warn(p, &d->at, what, "the shape \"%.60s\" is not supported: left out", d->kind);
        return STATUS_OK;
    }
    result = make(p, d, &mesh);
    THEN(result, add_shape(p, d, &mesh));
    mesh_source_release(&mesh);
    if (result == STATUS_OK)
        pbrt_params_report(d->params, p->b, what);
    return result;
}
