#include "common/scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"

void scene_init(struct scene *scene)
{
    memset(scene, 0, sizeof *scene);
    arena_init(&scene->arena);
    scene->name = "";
    scene->fog = -1;
    scene_environment_default(&scene->environment);
}

void scene_release(struct scene *scene)
{
    arena_release(&scene->arena);
    scene_init(scene);
}

void scene_instance_default(struct scene_instance *instance)
{
    memset(instance, 0, sizeof *instance);
    instance->name = instance->asset = "";
    instance->to_world = transform_d_identity();
    instance->node = instance->skin = instance->body = -1;
}

void scene_light_default(struct scene_light *light)
{
    memset(light, 0, sizeof *light);
    light->name = "";
    light->direction[2] = -1;
    light->outer_cone_rad = 0.78539816f;
    light->image = light->node = -1;
    light->to_world = transform_d_identity();
    light->projection_yfov_rad = 0.78539816f;
    light->projection_aspect = 1;
}

void scene_camera_default(struct scene_camera *camera)
{
    memset(camera, 0, sizeof *camera);
    camera->name = "";
    camera->to_world = transform_d_identity();
    camera->yfov_rad = 0.78539816f;
    camera->xmag = camera->ymag = 1;
    camera->node = -1;
}

void scene_environment_default(struct scene_environment *environment)
{
    memset(environment, 0, sizeof *environment);
    environment->image.name = "";
    for (int i = 0; i < 3; i++)
        environment->radiance[i] = environment->to_map[i][i] = 1;
}

void scene_node_default(struct scene_node *node)
{
    memset(node, 0, sizeof *node);
    node->parent = -1;
    node->matrix = transform_d_identity();
    node->rotation[3] = 1;
    for (int i = 0; i < 3; i++)
        node->scale[i] = 1;
}

void scene_medium_default(struct scene_medium *medium)
{
    memset(medium, 0, sizeof *medium);
    medium->name = "";
    medium->grid_to_world = transform_d_identity();
}

void scene_mesh_layout(const struct scene_mesh *mesh, struct scene_mesh_layout *out)
{
    size_t at = 0;
    size_t vertices = mesh->vertex_count;

    /* At most 2^32 vertices of 88 bytes and of 2^32 morph targets of 24 (2^32 * 2^32 * 24 wraps, so
     * the size of a mesh with too many of them is meaningless: check_mesh limits their count
     * first), and 2^32 triangles of 12: no overflow in 64 bits. */
    _Static_assert(sizeof(size_t) == 8, "mesh blobs need a 64-bit size_t");
#define LAYOUT_ARRAY(field, present, floats)                                \
    out->field = (present) ? at : SIZE_MAX;                                 \
    if (present)                                                            \
        at += vertices * (floats) * sizeof(float);
    LAYOUT_ARRAY(positions, 1, 3)
    LAYOUT_ARRAY(normals, mesh->arrays & MESH_NORMALS, 3)
    LAYOUT_ARRAY(tangents, mesh->arrays & MESH_TANGENTS, 4)
    LAYOUT_ARRAY(uv0, mesh->arrays & MESH_UV0, 2)
    LAYOUT_ARRAY(uv1, mesh->arrays & MESH_UV1, 2)
    LAYOUT_ARRAY(colors, mesh->arrays & MESH_COLORS, 4)
    LAYOUT_ARRAY(skin, mesh->arrays & MESH_SKIN, sizeof(struct mesh_influence) / sizeof(float))
    out->morph_stride = vertices * (mesh->arrays & MESH_NORMALS ? 6 : 3) * sizeof(float);
    LAYOUT_ARRAY(morphs, mesh->morph_count > 0, (size_t)mesh->morph_count * (mesh->arrays & MESH_NORMALS ? 6 : 3))
#undef LAYOUT_ARRAY
    out->indices = at;
    at += (size_t)mesh->triangle_count * 3 * sizeof(uint32_t);
    out->total_bytes = at + SCENE_MESH_PADDING_BYTES;
}

static int blob_compare(const void *a, const void *b)
{
    const struct scene_blob *x = a, *y = b;

    return memcmp(x->digest.bytes, y->digest.bytes, DIGEST_BYTES);
}

status scene_blobs(const struct scene *scene, struct scene_blob **out, size_t *count, struct error *err)
{
    int has_map = scene->environment.present && !scene->environment.constant;
    size_t total = (size_t)scene->mesh_count + scene->image_count + scene->medium_count + (has_map ? 1 : 0);
    size_t kept = 0, at = 0;
    struct scene_blob *list;

    *out = NULL;
    *count = 0;
    list = mem_alloc_array(total, sizeof *list);
    NEED(list, err, "the scene's list of blobs");
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        list[at++] = scene->meshes[i].blob;
    for (uint32_t i = 0; i < scene->image_count; i++)
        list[at++] = scene->images[i].blob;
    if (has_map)
        list[at++] = scene->environment.image.blob;
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (scene->media[i].has_grid)
            list[at++] = scene->media[i].grid;
    total = at;
    qsort(list, total, sizeof *list, blob_compare);
    for (size_t i = 0; i < total; i++) {
        if (kept && digest_equal(&list[kept - 1].digest, &list[i].digest)) {
            if (list[kept - 1].size_bytes != list[i].size_bytes) {
                mem_free(list);
                return error_set(err, STATUS_ERR_INPUT, "two blobs of the scene have one digest but different sizes");
            }
            continue;
        }
        list[kept++] = list[i];
    }
    *out = list;
    *count = kept;
    return STATUS_OK;
}

int scene_instance_bounds(const struct scene *scene, uint32_t instance, double bounds_min[3], double bounds_max[3])
{
    const struct scene_instance *it = &scene->instances[instance];
    const struct scene_mesh *mesh = &scene->meshes[it->mesh];

    for (int axis = 0; axis < 3; axis++) {
        bounds_min[axis] = bounds_max[axis] = it->to_world.m[axis][3];
        for (int c = 0; c < 3; c++) {
            double a = it->to_world.m[axis][c] * (double)mesh->bounds_min[c];
            double b = it->to_world.m[axis][c] * (double)mesh->bounds_max[c];
            bounds_min[axis] += a < b ? a : b;
            bounds_max[axis] += a < b ? b : a;
        }
        if (!isfinite(bounds_min[axis]) || !isfinite(bounds_max[axis]))
            return 0;
    }
    return 1;
}

int scene_bounds(const struct scene *scene, float bounds_min[3], float bounds_max[3])
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    int found = 0;

    for (int axis = 0; axis < 3; axis++)
        bounds_min[axis] = bounds_max[axis] = 0;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        double box_min[3], box_max[3];
        if (!scene_instance_bounds(scene, i, box_min, box_max))
            continue;
        found = 1;
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = fmin(low[axis], box_min[axis]);
            high[axis] = fmax(high[axis], box_max[axis]);
        }
    }
    if (!found)
        return 0;
    for (int axis = 0; axis < 3; axis++) {
        bounds_min[axis] = (float)low[axis];
        bounds_max[axis] = (float)high[axis];
        if (!isfinite(bounds_min[axis]) || !isfinite(bounds_max[axis]))
            return 0;
    }
    return 1;
}
