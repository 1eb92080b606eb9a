/* Opaque faces written twice, as exports often have them: what is seen is one of the two.
 *
 * Left alone are: faces that shine (their copy is a second lamp), those that light passes (glass, thin
 * walls, boundaries of media, blended and cut-out surfaces: two of them are not one), mixes, spheres, and
 * what moves or is deformed. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/statistics.h"
#include "tests/support/transform.h"

/* A moved copy's vertices are this share of the mesh's size away along each axis, at most. */
#define MOVED_SHARE 3e-8

/* How a mesh is copied. `moved`: each vertex a little, `shifted`: all together. `every`: this triangle of so
 * many, the first included. */
struct way {
    int in_mesh, moved, shifted, reversed, same_mesh;
    uint32_t every;
};

static const struct way exact_ways[] = {
    {.in_mesh = 1, .every = 1},
    {.same_mesh = 1, .every = 1},
    {.every = 1},
    {.reversed = 1, .every = 1},
    {.in_mesh = 1, .reversed = 1, .every = 1},
    {.in_mesh = 1, .every = 3},
    {.every = 3},
};
static const struct way near_ways[] = {
    {.in_mesh = 1, .moved = 1, .every = 1},
    {.shifted = 1, .every = 1},
    {.moved = 1, .every = 1},
    {.in_mesh = 1, .shifted = 1, .every = 1},
    {.moved = 1, .reversed = 1, .every = 1},
    {.in_mesh = 1, .moved = 1, .every = 3},
};

static int is_opaque(const struct scene_material *m)
{
    return (m->kind == MATERIAL_SURFACE || m->kind == MATERIAL_CONDUCTOR) && m->alpha_mode == ALPHA_OPAQUE &&
           scene_color_is(m->emission, 0) && !(m->transmission > 0) && !(m->diffuse_transmission > 0) &&
           !m->refractive && m->medium < 0 && m->medium_outside < 0;
}

static int is_still(const struct scene *scene, const struct scene_instance *instance)
{
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];

    return instance->node < 0 && instance->skin < 0 && mesh->morph_count == 0 &&
           !(mesh->arrays & (MESH_SKIN | MESH_STAND_INS));
}

/* Vertices at one place are moved alike: no crack opens. */
static void move(float p[3], double reach)
{
    struct test_random random = {0};
    uint32_t bits[3];

    memcpy(bits, p, sizeof bits);
    random.state = bits[0] + ((uint64_t)bits[1] << 20) + ((uint64_t)bits[2] << 40);
    for (int k = 0; k < 3; k++)
        p[k] = (float)((double)p[k] + reach * (2 * test_random_double(&random) - 1));
}

static void shift(float p[3], double reach)
{
    for (int k = 0; k < 3; k++)
        p[k] = (float)((double)p[k] + reach);
}

static double reach_of(const struct scene_mesh *mesh)
{
    double most = 0;

    for (int k = 0; k < 3; k++)
        most = fmax(most, (double)mesh->bounds_max[k] - (double)mesh->bounds_min[k]);
    return MOVED_SHARE * most;
}

/* The copy's vertices, from `count` of `size_bytes` each. */
static void copy_array(const struct scene_mesh *mesh, const struct way *way, size_t from,
                       const struct scene_mesh_layout *layout, size_t size_bytes, uint8_t *to)
{
    for (uint32_t i = 0; i < mesh->vertex_count; i++, to += size_bytes) {
        float v[3];
        memcpy(v, to, size_bytes < sizeof v ? size_bytes : sizeof v);
        if (from == layout->positions && way->moved)
            move(v, reach_of(mesh));
        if (from == layout->positions && way->shifted)
            shift(v, reach_of(mesh));
        for (int k = 0; k < 3 && from == layout->normals && way->reversed; k++)
            v[k] = -v[k];
        memcpy(to, v, size_bytes < sizeof v ? size_bytes : sizeof v);
    }
}

static uint8_t *write_vertices(const struct scene_mesh *mesh, const struct way *way, const uint8_t *blob, int own,
                               uint8_t *to)
{
    struct scene_mesh_layout l;
    size_t starts[6], end;

    scene_mesh_layout(mesh, &l);
    memcpy(starts, (size_t[6]){l.positions, l.normals, l.tangents, l.uv0, l.uv1, l.colors}, sizeof starts);
    for (int a = 0; a < 6; a++) {
        if (starts[a] == SIZE_MAX)
            continue;
        end = l.indices;
        for (int b = a + 1; b < 6; b++)
            if (starts[b] < end)
                end = starts[b];
        for (int copy = !way->in_mesh; copy <= own; copy++) {
            memcpy(to, blob + starts[a], end - starts[a]);
            if (copy)
                copy_array(mesh, way, starts[a], &l, (end - starts[a]) / mesh->vertex_count, to);
            to += end - starts[a];
        }
    }
    return to;
}

/* The copy's triangles begin with another corner, so that its mesh is another. */
static void write_triangles(const struct scene_mesh *mesh, const struct way *way, const uint8_t *blob,
                            uint32_t first_vertex, uint8_t *to)
{
    struct scene_mesh_layout l;

    scene_mesh_layout(mesh, &l);
    if (way->in_mesh) {
        memcpy(to, blob + l.indices, 12 * (size_t)mesh->triangle_count);
        to += 12 * (size_t)mesh->triangle_count;
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t += way->every, to += 12) {
        uint32_t v[3], out[3];
        memcpy(v, blob + l.indices + 12 * (size_t)t, sizeof v);
        for (int k = 0; k < 3; k++)
            out[k] = first_vertex + v[way->reversed ? (4 - k) % 3 : (k + 1) % 3];
        memcpy(to, out, sizeof out);
    }
}

static uint32_t copy_mesh(struct import_result *import, uint32_t number, const struct way *way)
{
    const struct scene_mesh mesh = import->scene.meshes[number];
    const uint8_t *blob = transform_blob(import, &mesh);
    const int own = !way->in_mesh || way->moved || way->shifted || way->reversed;
    struct scene_mesh out = mesh;
    struct scene_mesh_layout layout;
    uint8_t *data;

    out.vertex_count = mesh.vertex_count * (uint32_t)(way->in_mesh && own ? 2 : 1);
    out.triangle_count = (mesh.triangle_count + way->every - 1) / way->every + (way->in_mesh ? mesh.triangle_count : 0);
    out.closed = mesh.closed && !way->in_mesh && !way->reversed && way->every == 1;
    scene_mesh_layout(&out, &layout);
    data = mem_calloc(1, layout.total_bytes);
    if (!data)
        abort();
    write_vertices(&mesh, way, blob, own, data);
    write_triangles(&mesh, way, blob, out.vertex_count - mesh.vertex_count, data + layout.indices);
    return transform_add_mesh(import, out, data);
}

/* A face that is seen from one side only has no back that might be another's front; tangents would have to
 * be turned, too. */
static int may_reverse(const struct scene *scene, const struct scene_instance *instance)
{
    return scene->materials[instance->material].double_sided && !(scene->meshes[instance->mesh].arrays & MESH_TANGENTS);
}

static void double_instance(struct import_result *import, uint32_t number, const struct way *chosen)
{
    struct scene_instance copy = import->scene.instances[number];
    struct way way = *chosen;

    way.reversed &= may_reverse(&import->scene, &copy);
    if (!way.same_mesh)
        copy.mesh = copy_mesh(import, copy.mesh, &way);
    if (way.in_mesh)
        import->scene.instances[number] = copy;
    else
        transform_add_instance(import, copy);
}

/* Neighbours are copied in different ways. */
static uint32_t double_all(struct import_result *import, const struct way *ways, uint32_t way_count)
{
    const uint32_t count = import->scene.instance_count;
    uint32_t done = 0;

    for (uint32_t i = 0; i < count; i++) {
        const struct scene_instance *instance = &import->scene.instances[i];
        if (is_opaque(&import->scene.materials[instance->material]) && is_still(&import->scene, instance))
            double_instance(import, i, &ways[done++ % way_count]);
    }
    return done;
}

uint32_t transform_copy_faces(struct import_result *import)
{
    return double_all(import, exact_ways, sizeof exact_ways / sizeof *exact_ways);
}

uint32_t transform_near_faces(struct import_result *import)
{
    return double_all(import, near_ways, sizeof near_ways / sizeof *near_ways);
}
