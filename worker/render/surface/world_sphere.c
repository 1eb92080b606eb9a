#include "worker/render/surface/world_sphere.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/base/sphere.h"
#include "worker/render/surface/world_motion.h"
#include "worker/render/scene/world_place.h"

/* The vertices lie on the sphere, and the matrix scales all axes alike, to this share. */
#define SHAPE_SHARE 1e-5
/* Of the largest coordinate of a ray's start: what Embree's rounding of it and of its boxes may
 * amount to. */
#define MARGIN_SHARE 0x1p-20

/* ---- the mesh's triangles --------------------------------------------------------------------- */

/* Rows of the grid that shape_sphere makes: twice as many columns, from the pole at -z on, two
 * triangles a cell but one at the poles. 0: that is not the count of one. */
static uint32_t grid_rows(uint32_t triangles)
{
    uint32_t rows = (uint32_t)(0.5 * (1 + sqrt(1 + (double)triangles)) + 0.5);

    return rows > 1 && (uint64_t)rows * (rows - 1) * 4 == triangles ? rows : 0;
}

/* The first of the cell's triangles; *count: 1 or 2. */
static uint32_t cell_triangle(uint32_t rows, uint32_t row, uint32_t column, uint32_t *count)
{
    uint32_t columns = 2 * rows;

    *count = row == 0 || row == rows - 1 ? 1 : 2;
    return row == 0 ? column : columns * (2 * row - 1) + *count * column;
}

/* The cell in this direction from the centre. */
static uint32_t cell_towards(uint32_t rows, const double p[3], uint32_t *count)
{
    float across = (float)sqrt(p[0] * p[0] + p[1] * p[1]);
    float up = det_atan2(across, -(float)p[2]) / PI_F;
    float round = det_atan2((float)p[1], (float)p[0]) / (2 * PI_F);
    uint32_t row = (uint32_t)(up * (float)rows), column;

    round += round < 0 ? 1.0f : 0.0f;
    column = (uint32_t)(round * (float)(2 * rows));
    return cell_triangle(rows, row < rows ? row : rows - 1,
                         column < 2 * rows ? column : 2 * rows - 1, count);
}

static double determinant(const double a[3], const double b[3], const double c[3])
{
    double n[3];

    exact_cross(b, c, n);
    return exact_dot(a, n);
}

/* Weights of the corners where the line from the centre meets the triangle; the least of them. */
static double weights_towards(const struct world_mesh *mesh, uint32_t triangle, const double p[3],
                              double weight[3])
{
    const uint32_t *vertex = world_vertices(mesh, triangle);
    double corner[3][3], sum;

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corner[k][a] = (double)mesh->positions[3 * (size_t)vertex[k] + (size_t)a];
    for (int k = 0; k < 3; k++)
        weight[k] = determinant(p, corner[(k + 1) % 3], corner[(k + 2) % 3]);
    sum = weight[0] + weight[1] + weight[2];
    for (int k = 0; k < 3; k++)
        weight[k] /= sum;
    return fmin(weight[0], fmin(weight[1], weight[2]));
}

/* The triangle that covers the direction from the centre, and the weights there. */
static uint32_t triangle_towards(const struct world_mesh *mesh, const double p[3],
                                 double weight[3])
{
    uint32_t count, first = cell_towards(grid_rows(mesh->triangle_count), p, &count);
    double other[3];

    if (count < 2)
        (void)weights_towards(mesh, first, p, weight);
    else if (weights_towards(mesh, first, p, weight) < weights_towards(mesh, first + 1, p, other)) {
        memcpy(weight, other, sizeof other);
        return first + 1;
    }
    return first;
}

/* Is the mesh what it says, so that triangle_towards finds each of its triangles? */
static int is_sphere(const struct world_mesh *mesh, double radius)
{
    if (!grid_rows(mesh->triangle_count) || !(radius > 0))
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
        if (triangle_towards(mesh, middle, weight) != t)
            return 0;
    }
    return 1;
}

/* Does its winding face the centre? */
static int winds_inwards(const struct world_mesh *mesh)
{
    const uint32_t *vertex = world_vertices(mesh, 0);
    double corner[3][3];

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corner[k][a] = (double)mesh->positions[3 * (size_t)vertex[k] + (size_t)a];
    return determinant(corner[0], corner[1], corner[2]) < 0;
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

/* Only an even lamp has one radiance that all directions share. */
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

/* Fills *out; 0: the instance is no sphere. */
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
    /* `accept` takes baked triangles for those of the world (path_accept). */
    out->shape.inward = out->inward ^ (instance->world_positions && instance->flipped);
    out->located = shades_by_place(material, mesh);
    return 1;
}

/* Two in one place of which one lets light in are crossed together, as meshes are. */
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
    /* Made by world_spheres_find for this scene alone. */
    ((struct world_sphere *)instance->sphere)->shape.margin =
        MARGIN_SHARE * (double)(fabsf(c.x) + fabsf(c.y) + fabsf(c.z) + w->fog_radius);
    out->sphere = &instance->sphere->shape;
    out->mesh = w->mesh_count;
    out->world_positions = NULL;
}

/* ---- hits ------------------------------------------------------------------------------------- */

uint32_t surface_locate(const struct render_scene *scene, struct surface *s)
{
    struct vec3 local = transform_point(&s->instance->to_object, s->p);
    double p[3] = {(double)local.x, (double)local.y, (double)local.z}, weight[3], sum = 0;
    double corner[3][3], n[3];
    uint32_t triangle = triangle_towards(s->mesh, p, weight);

    for (int k = 0; k < 3; k++) {
        weight[k] = fmax(weight[k], 0);
        sum += weight[k];
    }
    s->vertex = world_vertices(s->mesh, triangle);
    s->b1 = (float)(weight[1] / sum);
    s->b2 = (float)(weight[2] / sum);
    world_corners(scene, s->instance, s->vertex, s->time, corner);
    exact_normal(corner, n);
    s->area = (float)(0.5 * sqrt(exact_dot(n, n)));
    return triangle;
}

void surface_on_sphere(const struct render_scene *scene, const struct ray *ray,
                       const struct hit *hit, struct surface *s)
{
    const struct world_sphere *sphere = s->instance->sphere;
    const struct accel_sphere *shape = &sphere->shape;
    int inside = hit->triangle != 0;
    double o[3], d[3], p[3], n[3], length, sign;
    struct sphere_chord chord;

    exact_vec(ray->direction, d);
    exact_origin(ray, o);
    sphere_chord_find(shape, o, d, &chord);
    for (int a = 0; a < 3; a++)
        n[a] = chord.foot[a] + (inside ? chord.half : -chord.half) * d[a];
    length = sqrt(exact_dot(n, n));
    for (int a = 0; a < 3; a++) {
        n[a] /= length;
        p[a] = shape->centre[a] + shape->radius * n[a];
    }
    s->triangle = 0;
    s->vertex = world_vertices(s->mesh, 0);
    s->b1 = s->b2 = 1.0f / 3;
    s->t = (float)((p[0] - o[0]) * d[0] + (p[1] - o[1]) * d[1] + (p[2] - o[2]) * d[2]);
    s->p = exact_round(p, s->rest);
    s->area = 1;
    s->contacts = world_near_boundary(scene, s->p);
    s->inset = INFINITY; /* there are no edges */
    s->front = inside == sphere->inward;
    sign = inside ? -1 : 1;
    s->ng = vec3_make((float)(sign * n[0]), (float)(sign * n[1]), (float)(sign * n[2]));
    if (sphere->located)
        (void)surface_locate(scene, s);
}
