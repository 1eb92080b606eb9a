#include "common/scene/move.h"

#include <string.h>

static void move_matrix(struct transform_d *to_world, const double by[3])
{
    for (int r = 0; r < 3; r++)
        to_world->m[r][3] -= by[r];
}

static void move_light(struct scene_light *light, const double by[3])
{
    unsigned parts = scene_light_parts(light->kind);

    if (parts & LIGHT_HAS_FRAME)
        move_matrix(&light->to_world, by);
    for (int c = 0; c < 3 && parts & LIGHT_HAS_PLACE; c++)
        light->position[c] -= by[c];
}

void scene_move(struct scene *scene, const double by[3])
{
    for (uint32_t i = 0; i < scene->instance_count; i++)
        move_matrix(&scene->instances[i].to_world, by);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        move_matrix(&scene->cameras[i].to_world, by);
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (scene->media[i].has_grid)
            move_matrix(&scene->media[i].grid_to_world, by);
    for (uint32_t i = 0; i < scene->light_count; i++)
        move_light(&scene->lights[i], by);
    for (uint32_t i = 0; i < scene->environment.portal_count; i++)
        for (int c = 0; c < 3; c++)
            scene->environment.portals[i].corner[c] -= by[c];
    for (int c = 0; c < 3; c++)
        scene->origin[c] += by[c];
}

static void *copy_table(struct arena *arena, const void *table, size_t count, size_t row_bytes, int *failed)
{
    void *copy = arena_alloc(arena, count, row_bytes);

    if (!copy)
        *failed = 1;
    else if (count > 0)
        memcpy(copy, table, count * row_bytes);
    return copy;
}

status scene_copy_movable(struct scene *out, const struct scene *scene, struct error *err)
{
    int failed = 0;

    *out = *scene;
    arena_init(&out->arena);
#define COPY(table, count)                                                                                \
    out->table = copy_table(&out->arena, scene->table, scene->count, sizeof *scene->table, &failed)
    COPY(instances, instance_count);
    COPY(cameras, camera_count);
    COPY(media, medium_count);
    COPY(lights, light_count);
    COPY(environment.portals, environment.portal_count);
#undef COPY
    if (!failed)
        return STATUS_OK;
    scene_copy_release(out);
    return error_no_memory(err, "the scene's copy for a frame");
}

void scene_copy_release(struct scene *copy)
{
    arena_release(&copy->arena);
    memset(copy, 0, sizeof *copy);
}
