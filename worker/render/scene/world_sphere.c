#include "worker/render/scene/world_sphere.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/base/exact.h"
#include "worker/render/base/sphere.h"
#include "worker/render/scene/world_place.h"
#include "worker/render/surface/surface_sphere.h"

/* Vertices must lie on the sphere, and the matrix scale all axes alike, to within this share. */
#define SHAPE_SHARE 1e-5
/* Bound of Embree's rounding of a ray's origin and of its boxes, as a share of the origin's largest
 * coordinate. */
#define MARGIN_SHARE 0x1p-20

/* Is the mesh a sphere as it claims, so that triangle_towards finds each of its triangles? */
static int is_sphere(const struct world_mesh *mesh, double radius)
{
    if (!surface_sphere_rows(mesh->triangle_count) || !(radius > 0))
        return 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        double middle[3] = {0, 0, 0}, weight[3];

        for (int k = 0; k < 3; k++) {
            const float *p = mesh->positions + 3 * (size_t)world_vertices(mesh, t)[k];
            double square = 0;
            for (int a = 0; a < 3; a++) {
                square += (double)p[a] * (double)p[a];
                middle[a] += (double)p[a] / 3;
            }
            if (!(fabs(sqrt(square) - radius) <= SHAPE_SHARE * radius))
                return 0;
        }
        if (surface_sphere_triangle(mesh, middle, weight) != t)
            return 0;
    }
    return 1;
}

/* Does its winding face the centre? */
static int winds_inwards(const struct world_mesh *mesh)
{
    const uint32_t *vertex = world_vertices(mesh, 0);
    double corner[3][3], n[3];

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corner[k][a] = (double)mesh->positions[3 * (size_t)vertex[k] + (size_t)a];
    exact_cross(corner[1], corner[2], n);
    return exact_dot(corner[0], n) < 0;
}

/* ---- which instances are spheres -------------------------------------------------------------- */

/* By how much the matrix scales all lengths; 0: not alike. */
static double uniform_scale(const struct transform_d *m)
{
    double product[3][3], square;

    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            product[i][k] = m->m[0][i] * m->m[0][k] + m->m[1][i] * m->m[1][k] +
                            m->m[2][i] * m->m[2][k];
    square = (product[0][0] + product[1][1] + product[2][2]) / 3;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (!(fabs(product[i][k] - (i == k ? square : 0)) <= SHAPE_SHARE * square))
                return 0;
    return sqrt(square);
}

/* Only a uniform emitter has the same radiance in all directions. */
static int shines_evenly(const struct world_material *material)
{
    return !(material->flags & MATERIAL_EMISSIVE) ||
           !(material->emission.image || material->clearcoat.image);
}

static int shades_by_place(const struct world_material *material, const struct world_mesh *mesh)
{
    return material->m.kind == MATERIAL_MIX || mesh->colors || material->base_color.image ||
           (material->flags & (MATERIAL_TEXTURED | MATERIAL_NORMAL_MAP | MATERIAL_LAYERED |
                               MATERIAL_NEEDS_FRAME));
}

/* Fills *out. 0: the instance is not a sphere. */
static int describe(const struct render_scene *w, const struct scene *scene, uint32_t index,
                    struct world_sphere *out)
{
    const struct scene_instance *description = &scene->instances[index];
    const struct world_instance *instance = &w->instances[index];
    const struct world_material *material = &w->materials[instance->material];
    const struct world_mesh *mesh = &w->meshes[instance->mesh];
    struct transform_d to_world = description->node < 0 ? description->to_world
                                                        : transform_to_d(&instance->to_world);
    double scale = uniform_scale(&to_world);

    if (!(scale > 0) || instance->motion_steps || instance->bounded ||
        (material->flags & MATERIAL_ALPHA) || !shines_evenly(material))
        return 0;
    for (int a = 0; a < 3; a++)
        out->shape.centre[a] = to_world.m[a][3];
    out->shape.radius = scale * (double)scene->meshes[instance->mesh].bounds_max[2];
    out->inward = winds_inwards(mesh);
    /* path_accept expects the winding of baked triangles in world space. */
    out->shape.inward = out->inward ^ (instance->world_positions && instance->flipped);
    out->located = shades_by_place(material, mesh);
    return 1;
}

/* Two spheres at one place, one of which lets light in, are crossed together as meshes are. */
static void drop_coincident(struct render_scene *w)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        const struct world_sphere *a = w->instances[i].sphere;
        unsigned flags = w->materials[w->instances[i].material].flags;

        if (!a || !(flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY)))
            continue;
        for (uint32_t k = 0; k < w->instance_count; k++) {
            const struct world_sphere *b = w->instances[k].sphere;
            if (k != i && b && sphere_same(&a->shape, &b->shape))
                w->instances[k].sphere = w->instances[i].sphere = NULL;
        }
    }
}

status world_spheres_find(struct render_scene *w, const struct scene *scene, struct error *err)
{
    uint8_t *known = mem_calloc(w->mesh_count, 1); /* 1: a sphere, 2: none */

    if (!known)
        return error_no_memory(err, "the spheres");
    for (uint32_t i = 0; i < w->instance_count; i++) {
        uint32_t mesh = w->instances[i].mesh;
        struct world_sphere sphere = {0}, *kept;

        if (!(scene->meshes[mesh].arrays & MESH_SPHERE))
            continue;
        if (!known[mesh])
            known[mesh] = is_sphere(&w->meshes[mesh],
                                    (double)scene->meshes[mesh].bounds_max[2]) ? 1 : 2;
        if (known[mesh] == 2 || !describe(w, scene, i, &sphere))
            continue;
        kept = mem_memdup(&sphere, sizeof sphere);
        if (!world_own(w, kept)) {
            mem_free(known);
            return error_no_memory(err, "the spheres");
        }
        w->instances[i].sphere = kept;
    }
    mem_free(known);
    drop_coincident(w);
    return STATUS_OK;
}

void world_sphere_give(const struct render_scene *w, const struct world_instance *instance,
                       struct accel_instance *out)
{
    struct vec3 c = w->bounds_centre;

    if (!instance->sphere)
        return;
    /* world_spheres_find made it for this scene alone. */
    ((struct world_sphere *)instance->sphere)->shape.margin =
        MARGIN_SHARE * (double)(fabsf(c.x) + fabsf(c.y) + fabsf(c.z) + w->fog_radius);
    out->sphere = &instance->sphere->shape;
    out->mesh = w->mesh_count;
    out->world_positions = NULL;
}
