#include "tests/support/transform.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"

const struct transform_row transforms[] = {
    {.name = "faces twice", .apply = transform_copy_faces},
    {.name = "faces nearly twice", .apply = transform_near_faces},
    {.name = "a far thing", .apply = transform_far_thing, .part = 1},
    {.name = "a very far thing", .apply = transform_very_far_thing},
    {.name = "in other words", .apply = transform_in_other_words, .bits = 1, .factor = TRANSFORM_LIGHT},
    {.name = "1024 times as large", .apply = transform_scale, .bits = 1, .part = 1},
    {.name = "more light", .apply = transform_light, .bits = 1, .factor = TRANSFORM_LIGHT, .part = 1},
    {.name = "a black light", .apply = transform_black_light, .bits = 1, .part = 1},
    {.name = "elsewhere", .apply = transform_elsewhere},
    {.name = "turned", .apply = transform_turn, .part = 1},
    {.name = "mirrored instances", .apply = transform_mirror, .part = 1},
    {.name = "other first corners", .apply = transform_corners, .part = 1},
    {.name = "in an empty box", .apply = transform_empty_box, .part = 1},
    {.name = "lamps in halves", .apply = transform_halve_lamps, .part = 1},
    {.name = "each triangle as four", .apply = transform_quarter_faces, .part = 1},
    {.name = "bodies in halves", .apply = transform_halve_bodies, .part = 1},
    {.name = "lamps in another order", .apply = transform_reorder_lamps, .part = 1},
    {.name = "tables in another order", .apply = transform_reorder_tables, .bits = 1, .part = 1},
    {.name = "bodies in another order", .apply = transform_reorder_bodies, .part = 1},
    {.name = "nodes in another order", .apply = transform_reorder_nodes, .bits = 1, .moves = 1},
    {.name = "more keys", .apply = transform_more_keys, .moves = 1},
    {.name = "mixed with itself", .apply = transform_mix_with_itself, .bits = 1, .part = 1},
};
const size_t transform_count = sizeof transforms / sizeof *transforms;

static _Noreturn void give_up(const char *why)
{
    fprintf(stderr, "transform: %s\n", why);
    abort();
}

const uint8_t *transform_blob(const struct import_result *import, const struct scene_mesh *mesh)
{
    for (size_t i = 0; i < import->blob_count; i++)
        if (digest_equal(&import->blobs[i].digest, &mesh->blob.digest))
            return import->blobs[i].data;
    give_up("a mesh without its blob");
}

static void set_bounds(struct scene_mesh *mesh, const uint8_t *positions)
{
    for (int k = 0; k < 3; k++) {
        mesh->bounds_min[k] = INFINITY;
        mesh->bounds_max[k] = -INFINITY;
    }
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        float p[3];
        memcpy(p, positions + 12 * (size_t)i, sizeof p);
        for (int k = 0; k < 3; k++) {
            mesh->bounds_min[k] = fminf(mesh->bounds_min[k], p[k]);
            mesh->bounds_max[k] = fmaxf(mesh->bounds_max[k], p[k]);
        }
    }
}

static void add_blob(struct import_result *import, const struct scene_blob *name, uint8_t *data)
{
    size_t capacity = import->blob_count;

    if (!MEM_GROW(import->blobs, capacity, import->blob_count + 1))
        give_up("out of memory");
    import->blobs[import->blob_count++] = (struct import_blob){name->digest, data, (size_t)name->size_bytes};
}

/* A table of the arena with one row more, the last of them empty. */
static void *grown(struct import_result *import, const void *table, size_t count, size_t size_bytes)
{
    void *more = arena_alloc(&import->scene.arena, count + 1, size_bytes);

    if (!more)
        give_up("out of memory");
    if (count > 0)
        memcpy(more, table, count * size_bytes);
    return more;
}

uint32_t transform_add_mesh(struct import_result *import, struct scene_mesh mesh, uint8_t *blob)
{
    struct scene *scene = &import->scene;
    struct scene_mesh_layout layout;

    scene_mesh_layout(&mesh, &layout);
    set_bounds(&mesh, blob + layout.positions);
    mesh.blob.size_bytes = layout.total_bytes;
    if (digest_of(&mesh.blob.digest, blob, layout.total_bytes) != STATUS_OK)
        give_up("no digest");
    add_blob(import, &mesh.blob, blob);
    scene->meshes = grown(import, scene->meshes, scene->mesh_count, sizeof *scene->meshes);
    scene->meshes[scene->mesh_count] = mesh;
    return scene->mesh_count++;
}

void transform_add_instance(struct import_result *import, struct scene_instance instance)
{
    struct scene *scene = &import->scene;

    scene->instances = grown(import, scene->instances, scene->instance_count, sizeof *scene->instances);
    scene->instances[scene->instance_count++] = instance;
}

void transform_add_light(struct import_result *import, struct scene_light light)
{
    struct scene *scene = &import->scene;

    scene->lights = grown(import, scene->lights, scene->light_count, sizeof *scene->lights);
    scene->lights[scene->light_count++] = light;
}

uint32_t transform_add_material(struct import_result *import, struct scene_material material)
{
    struct scene *scene = &import->scene;

    scene->materials = grown(import, scene->materials, scene->material_count, sizeof *scene->materials);
    scene->materials[scene->material_count] = material;
    return scene->material_count++;
}

int transform_all_stands(const struct scene *scene)
{
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].node >= 0 || scene->instances[i].skin >= 0)
            return 0;
    for (uint32_t i = 0; i < scene->camera_count; i++)
        if (scene->cameras[i].node >= 0)
            return 0;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->lights[i].node >= 0)
            return 0;
    return 1;
}

/* A part that changes nothing in a scene leaves the others; only what the factor is of must be there. */
uint32_t transform_in_other_words(struct import_result *import)
{
    if (transform_light(import) == 0)
        return 0;
    return transform_scale(import) + transform_black_light(import) + transform_mix_with_itself(import) +
           transform_reorder_tables(import);
}

uint32_t transform_elsewhere(struct import_result *import)
{
    return transform_halve_bodies(import) + transform_quarter_faces(import) + transform_mirror(import) +
           transform_corners(import) + transform_empty_box(import) + transform_turn(import) +
           transform_reorder_bodies(import) + transform_reorder_lamps(import);
}
