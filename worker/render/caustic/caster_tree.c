/* caster_tree: the faces of a caster, and the tree over them, whose nodes bound places and normals. */
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/caustic/casters_parts.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/render_motion.h"

/* KEPT_FACES: of a caster with more, faces are made when they are needed. */
enum { LEAF_FACES = 4, KEPT_FACES = 32768 };

/* ---- bounds ---------------------------------------------------------------------------------------- */

/* A cone around an axis, by its half angle; cosine below 0: not known. */
struct cone {
    double axis[3], cosine, sine;
};

static double sine_of(double cosine) { return cosine * cosine < 1 ? sqrt(1 - cosine * cosine) : 0; }

static void cone_of(const double (*normals)[3], size_t count, struct cone *out)
{
    double axis[3] = {0, 0, 0}, length;

    *out = (struct cone){{0, 0, 0}, -1, 0};
    for (size_t i = 0; i < count; i++) {
        length = caster_length(normals[i]);
        if (!(length > 0))
            return;
        for (int k = 0; k < 3; k++)
            axis[k] += normals[i][k] / length;
    }
    length = caster_length(axis);
    if (!(length > 0))
        return;
    out->cosine = 1;
    for (int k = 0; k < 3; k++)
        out->axis[k] = axis[k] / length;
    for (size_t i = 0; i < count; i++) {
        const double cosine = exact_dot(out->axis, normals[i]) / caster_length(normals[i]);

        if (cosine < out->cosine)
            out->cosine = cosine;
    }
    out->sine = sine_of(out->cosine);
}

/* Around two. `either`: a direction and its opposite are the same. */
static struct cone join_cones(const struct cone *a, const struct cone *b, int either)
{
    const double side = either && exact_dot(a->axis, b->axis) < 0 ? -1 : 1;
    struct cone out = {{0, 0, 0}, -1, 0};
    double axis[3], length, between, cosine;

    if (a->cosine < 0 || b->cosine < 0)
        return out;
    for (int k = 0; k < 3; k++)
        axis[k] = a->axis[k] + side * b->axis[k];
    length = caster_length(axis);
    if (!(length > 0))
        return out;
    for (int k = 0; k < 3; k++)
        out.axis[k] = axis[k] / length;
    /* The half angle plus that between the axes. */
    between = fabs(exact_dot(out.axis, a->axis));
    out.cosine = between * a->cosine - sine_of(between) * a->sine;
    between = fabs(exact_dot(out.axis, b->axis));
    cosine = between * b->cosine - sine_of(between) * b->sine;
    out.cosine = (cosine < out.cosine ? cosine : out.cosine) - 1e-12;
    out.sine = sine_of(out.cosine);
    return out;
}

static struct cone normals_in(const struct caster_bounds *b)
{
    return (struct cone){{b->axis[0], b->axis[1], b->axis[2]}, b->cosine, b->sine};
}

static void set_normals(struct caster_bounds *out, const struct cone *cone)
{
    memcpy(out->axis, cone->axis, sizeof out->axis);
    out->cosine = cone->cosine;
    out->sine = cone->sine;
}

void caster_bounds_of(const double (*corner)[3], const double (*normal)[3], struct caster_bounds *out)
{
    struct cone cone;
    double from[3];

    out->radius = 0;
    for (int k = 0; k < 3; k++)
        out->centre[k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3;
    for (int i = 0; i < 3; i++) {
        exact_sub(corner[i], out->centre, from);
        if (exact_dot(from, from) > out->radius * out->radius)
            out->radius = caster_length(from);
    }
    cone_of(normal, 3, &cone);
    set_normals(out, &cone);
}

static void join_spheres(const struct caster_bounds *a, const struct caster_bounds *b, struct caster_bounds *out)
{
    double way[3], apart;

    exact_sub(b->centre, a->centre, way);
    apart = caster_length(way);
    if (apart + b->radius <= a->radius || apart + a->radius <= b->radius) {
        const struct caster_bounds *larger = a->radius > b->radius ? a : b;

        memcpy(out->centre, larger->centre, sizeof out->centre);
        out->radius = larger->radius;
        return;
    }
    out->radius = (apart + a->radius + b->radius) / 2 * (1 + 1e-12);
    for (int k = 0; k < 3; k++)
        out->centre[k] = a->centre[k] + way[k] * ((out->radius - a->radius) / apart);
}

/* ---- the faces ------------------------------------------------------------------------------------- */

static int is_still(const struct render_instance *instance) { return !instance->motion_steps && !instance->shape; }

/* The shading normals of a triangle, as surface_shade has them before they are interpolated. */
static void normals_of(const struct render_scene *scene, const struct render_instance *instance, uint32_t triangle,
                       struct caster_face *face)
{
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];
    const float32 *normals = instance_normals(instance, mesh);
    const uint32_t *vertex = triangle_vertices(mesh, triangle);
    double own[3];

    exact_normal(face->corner, own);
    for (int i = 0; i < 3; i++) {
        memcpy(face->normal[i], own, sizeof own);
        if (normals) {
            const float32 *at = normals + 3 * (size_t)vertex[instance->flipped && i ? 3 - i : i];
            struct vec3 n = vec3_make(at[0], at[1], at[2]);

            if (!instance->skinned)
                n = transform_normal(&instance->to_object, n);
            exact_vec(n, face->normal[i]);
        }
    }
    if (exact_dot(face->normal[0], own) < 0 && exact_dot(face->normal[1], own) < 0 && exact_dot(face->normal[2], own) < 0)
        for (int i = 0; i < 9; i++)
            face->normal[i / 3][i % 3] = -face->normal[i / 3][i % 3];
}

static int is_degenerate(const struct caster_face *face)
{
    double normal[3];

    exact_normal(face->corner, normal);
    return !(exact_dot(normal, normal) > 0);
}

/* A mirrored instance's winding is reversed: let corners run as seen from the front. */
static void turn_round(struct caster_face *face)
{
    double kept[3];

    memcpy(kept, face->corner[1], sizeof kept);
    memcpy(face->corner[1], face->corner[2], sizeof kept);
    memcpy(face->corner[2], kept, sizeof kept);
}

void caster_face_finish(struct caster_face *face)
{
    double length, across[3];

    exact_sub(face->corner[1], face->corner[0], face->e1);
    exact_sub(face->corner[2], face->corner[0], face->e2);
    exact_sub(face->normal[1], face->normal[0], face->d1);
    exact_sub(face->normal[2], face->normal[0], face->d2);
    exact_cross(face->e1, face->e2, across);
    length = caster_length(across);
    for (int k = 0; k < 3; k++)
        face->own[k] = across[k] / length;
    exact_cross(face->e2, face->own, face->along_u);
    exact_cross(face->own, face->e1, face->along_v);
    for (int k = 0; k < 3; k++) {
        face->along_u[k] /= length;
        face->along_v[k] /= length;
    }
    face->longest = caster_length(face->e1) > caster_length(face->e2) ? caster_length(face->e1) : caster_length(face->e2);
    face->flat = 1;
    for (int i = 0; i < 3; i++) {
        exact_cross(face->normal[i], face->own, across);
        face->flat &= caster_length(across) <= 1e-6 * caster_length(face->normal[i]);
    }
    caster_bounds_of(face->corner, face->normal, &face->bounds);
}

int caster_face_of(const struct render_scene *scene, const struct caster_ref *ref, struct caster_face *face)
{
    triangle_exact_corners(scene, ref->instance, ref->triangle, 0, face->corner);
    if (is_degenerate(face))
        return 0;
    if (scene->instances[ref->instance].flipped)
        turn_round(face);
    normals_of(scene, &scene->instances[ref->instance], ref->triangle, face);
    caster_face_finish(face);
    return face->bounds.cosine > 0;
}

static void node_of_ref(const struct render_scene *scene, const struct caster_ref *ref, struct caster_node *out)
{
    struct caster_face face;

    (void)caster_face_of(scene, ref, &face);
    out->bounds = face.bounds;
    memcpy(out->front, face.own, sizeof out->front);
    out->front_cosine = 1;
    out->front_sine = 0;
}

static struct cone front_of(const struct caster_node *node)
{
    return (struct cone){{node->front[0], node->front[1], node->front[2]}, node->front_cosine, node->front_sine};
}

static void join_nodes(const struct caster_node *a, const struct caster_node *b, struct caster_node *out)
{
    const struct cone normals_a = normals_in(&a->bounds), normals_b = normals_in(&b->bounds);
    const struct cone front_a = front_of(a), front_b = front_of(b);
    struct cone cone = join_cones(&normals_a, &normals_b, 1);
    struct caster_bounds joined;

    join_spheres(&a->bounds, &b->bounds, &joined);
    set_normals(&joined, &cone);
    out->bounds = joined;
    cone = join_cones(&front_a, &front_b, 0);
    memcpy(out->front, cone.axis, sizeof out->front);
    out->front_cosine = cone.cosine;
    out->front_sine = cone.sine;
}

/* ---- the tree -------------------------------------------------------------------------------------- */

struct sorting {
    const struct render_scene *scene;
    struct caster_ref *refs;
    struct caster_node *nodes;
    uint32_t node_count;
};

/* The axis along which the faces' middles are spread most. */
static int widest_axis(const struct caster_ref *refs, uint32_t count)
{
    double widest = -1;
    int axis = 0;

    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;

        for (uint32_t i = 0; i < count; i++) {
            const double middle = (double)refs[i].middle[k];

            low = middle < low ? middle : low;
            high = middle > high ? middle : high;
        }
        if (high - low > widest) {
            widest = high - low;
            axis = k;
        }
    }
    return axis;
}

/* Move the faces so that the `half` lowest along the axis come first (Hoare's selection). */
static void split_at(struct caster_ref *refs, uint32_t count, uint32_t half, int axis)
{
    uint32_t low = 0, high = count - 1;

    while (low < high) {
        const float32 pivot = refs[low + (high - low) / 2].middle[axis];
        uint32_t i = low, j = high;

        for (;;) {
            struct caster_ref kept;

            while (refs[i].middle[axis] < pivot)
                i++;
            while (refs[j].middle[axis] > pivot)
                j--;
            if (i < j) {
                kept = refs[i];
                refs[i] = refs[j];
                refs[j] = kept;
            }
            if (i >= j)
                break;
            i++;
            j--;
        }
        if (half <= j)
            high = j;
        else
            low = j + 1;
    }
}

static uint32_t build_node(struct sorting *sorting, uint32_t first, uint32_t count)
{
    const uint32_t number = sorting->node_count++;
    struct caster_node *node = &sorting->nodes[number];
    uint32_t other;

    if (count <= LEAF_FACES) {
        node_of_ref(sorting->scene, &sorting->refs[first], node);
        for (uint32_t i = 1; i < count; i++) {
            struct caster_node one;

            node_of_ref(sorting->scene, &sorting->refs[first + i], &one);
            join_nodes(node, &one, node);
        }
        node->first = first;
        node->count = count;
        return number;
    }
    split_at(sorting->refs + first, count, count / 2, widest_axis(sorting->refs + first, count));
    (void)build_node(sorting, first, count / 2);
    other = build_node(sorting, first + count / 2, count - count / 2);
    node->first = other;
    node->count = 0;
    join_nodes(&sorting->nodes[number + 1], &sorting->nodes[other], node);
    return number;
}

status caster_build(struct caster *caster, const struct render_scene *scene, uint32_t material, struct error *err)
{
    struct sorting sorting;
    size_t count = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].material == material && is_still(&scene->instances[i]))
            count += scene->meshes[scene->instances[i].mesh].triangle_count;
    if (count == 0)
        return STATUS_OK;
    caster->refs = mem_alloc_array(count, sizeof *caster->refs);
    caster->nodes = mem_alloc_array(count, sizeof *caster->nodes); /* a leaf has two faces or more, or is alone */
    if (!caster->refs || !caster->nodes)
        return error_no_memory(err, "what casts caustics");
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct render_instance *instance = &scene->instances[i];

        if (instance->material != material || !is_still(instance))
            continue;
        for (uint32_t t = 0; t < scene->meshes[instance->mesh].triangle_count; t++) {
            struct caster_ref *ref = &caster->refs[caster->face_count];
            struct caster_face face;

            *ref = (struct caster_ref){i, t, {0, 0, 0}};
            if (!caster_face_of(scene, ref, &face))
                continue;
            for (int k = 0; k < 3; k++)
                ref->middle[k] = (float32)(face.corner[0][k] + face.corner[1][k] + face.corner[2][k]);
            caster->face_count++;
        }
    }
    if (caster->face_count == 0)
        return STATUS_OK;
    sorting = (struct sorting){scene, caster->refs, caster->nodes, 0};
    (void)build_node(&sorting, 0, caster->face_count);
    caster->node_count = sorting.node_count;
    if (caster->face_count > KEPT_FACES)
        return STATUS_OK;
    caster->faces = mem_alloc_array(caster->face_count, sizeof *caster->faces);
    if (!caster->faces)
        return error_no_memory(err, "what casts caustics");
    for (uint32_t i = 0; i < caster->face_count; i++)
        (void)caster_face_of(scene, &caster->refs[i], &caster->faces[i]);
    return STATUS_OK;
}
