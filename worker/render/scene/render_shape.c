#include "worker/render/scene/render_shape.h"

#include <math.h>

#include "common/base/memory.h"
#include "worker/render/scene/render_place.h"

/* The matrix scales all axes alike to this share. */
#define SCALE_SHARE 1e-5
/* Of the largest coordinate of a ray's start: what Embree's rounding of it and of its boxes may amount to. */
#define MARGIN_SHARE 0x1p-20f

/* By how much the matrix scales all lengths; 0: not alike. */
static double uniform_scale(const struct transform_d *m)
{
    double product[3][3], square;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            product[i][k] = m->m[0][i] * m->m[0][k] + m->m[1][i] * m->m[1][k] + m->m[2][i] * m->m[2][k];
    square = (product[0][0] + product[1][1] + product[2][2]) / 3;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (!(fabs(product[i][k] - (i == k ? square : 0)) <= SCALE_SHARE * square))
                return 0;
    return sqrt(square);
}

/* Only an even lamp has one radiance that all directions share. */
static int shines_evenly(const struct render_material *material)
{
    return !(material->flags & MATERIAL_EMISSIVE) || !(material->emission.image || material->clearcoat.image);
}

static int shades_by_place(const struct render_material *material, const struct render_mesh *mesh)
{
    return material->m.kind == MATERIAL_MIX || mesh->colors || material->base_color.image ||
           (material->flags & (MATERIAL_TEXTURED | MATERIAL_NORMAL_MAP | MATERIAL_LAYERED | MATERIAL_NEEDS_FRAME));
}

/* The kind that the mesh says it stands in for; SHAPE_TRIANGLE: none, or it does not fit. */
static enum shape_kind kind_of(const struct render_mesh *mesh, const struct scene_mesh *description)
{
    for (int kind = 0; kind < SHAPE_KIND_COUNT; kind++)
        if (description->arrays & shape_rows[kind].stands_in)
            return shape_rows[kind].fits(mesh, description) ? (enum shape_kind)kind : SHAPE_TRIANGLE;
    return SHAPE_TRIANGLE;
}

/* Gives the instance the shape, if it can have it. */
static status shape_instance(struct render_scene *w, const struct scene *scene, uint32_t index, enum shape_kind kind,
                             struct error *err)
{
    const struct scene_instance *description = &scene->instances[index];
    struct render_instance *instance = &w->instances[index];
    const struct render_material *material = &w->materials[instance->material];
    const struct render_mesh *mesh = &w->meshes[instance->mesh];
    struct transform_d to_world = description->node < 0 ? description->to_world : transform_to_d(&instance->to_world);
    double scale = uniform_scale(&to_world);
    struct shape *shape;

    if (!(scale > 0) || instance->motion_steps || instance->bounded || (material->flags & MATERIAL_ALPHA) ||
        !shines_evenly(material))
        return STATUS_OK;
    shape = shape_rows[kind].create(mesh, &scene->meshes[instance->mesh], &to_world, scale);
    NEED(render_scene_own(w, shape), err, "the shapes");
    shape->kind = kind;
    /* `accept` takes baked triangles for those of the world (path_accept). */
    shape->winding = shape->front ^ (uint32_t)(instance->instance_positions && instance->flipped);
    shape->located = shades_by_place(material, mesh);
    instance->shape = shape;
    return STATUS_OK;
}

/* Two in one place of which one lets light in are crossed together, as meshes are. */
static void drop_coincident(struct render_scene *w)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        const struct shape *shape = w->instances[i].shape;
        unsigned flags = w->materials[w->instances[i].material].flags;

        if (!shape || !(flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY)))
            continue;
        for (uint32_t k = 0; k < w->instance_count; k++) {
            const struct shape *other = w->instances[k].shape;
            if (k != i && other && shape_same(shape, other))
                w->instances[k].shape = w->instances[i].shape = NULL;
        }
    }
}

status shapes_find(struct render_scene *w, const struct scene *scene, struct error *err)
{
    uint8_t *known = mem_calloc(w->mesh_count, 1); /* of each mesh: its kind, and 1; 0: not known yet */
    status s = STATUS_OK;

    NEED(known, err, "the shapes");
    for (uint32_t i = 0; i < w->instance_count && s == STATUS_OK; i++) {
        uint32_t mesh = w->instances[i].mesh;

        if (!known[mesh])
            known[mesh] = (uint8_t)(1 + kind_of(&w->meshes[mesh], &scene->meshes[mesh]));
        if (known[mesh] > 1 + SHAPE_TRIANGLE)
            s = shape_instance(w, scene, i, (enum shape_kind)(known[mesh] - 1), err);
    }
    mem_free(known);
    drop_coincident(w);
    for (uint32_t i = 0; i < w->instance_count; i++)
        w->instances[i].encloses &= !w->instances[i].shape; /* no ray slips out of one face */
    return s;
}

void shape_give(const struct render_scene *w, const struct render_instance *instance, struct accel_instance *out)
{
    struct vec3 c = w->bounds_centre;

    if (!instance->shape)
        return;
    out->shape = instance->shape;
    out->shape_margin = MARGIN_SHARE * (real_abs(c.x) + real_abs(c.y) + real_abs(c.z) + w->fog_radius);
    out->mesh = w->mesh_count;
    out->instance_positions = NULL;
}
