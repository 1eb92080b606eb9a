/* The same scene in other words. Doubling is exact, so the bits of its picture stay; with mirrors, corners have another order. */
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/transform.h"

static void times(float *v, int count, float factor)
{
    for (int i = 0; i < count; i++)
        v[i] *= factor;
}

static int is_blended(const struct scene_material *m) { return m->alpha_mode == ALPHA_BLEND; }

static int is_unlit(const struct scene_material *m) { return m->unlit != 0; }

static int any_material(const struct scene *scene, int (*is)(const struct scene_material *))
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (is(&scene->materials[i]))
            return 1;
    return 0;
}

/* ---- metres ----------------------------------------------------------------------------------- */

static void place_times(struct transform_d *t, double scale)
{
    for (int r = 0; r < 3; r++)
        t->m[r][3] *= scale;
}

static void matrix_times(struct transform_d *t, double scale)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            t->m[r][c] *= scale;
}

static void camera_times(struct scene_camera *camera, double scale)
{
    place_times(&camera->to_world, scale);
    camera->xmag *= (float)scale;
    camera->ymag *= (float)scale;
    camera->lens_radius *= (float)scale;
    camera->focus_distance *= (float)scale;
}

/* What a lamp without a surface gives goes with the square of lengths, the sun's light with none. */
static void light_times(struct scene_light *light, double scale)
{
    place_times(&light->to_world, scale);
    for (int c = 0; c < 3; c++)
        light->position[c] *= scale;
    light->range *= (float)scale;
    if (light->kind != LIGHT_DIRECTIONAL)
        times(light->intensity, 3, (float)(scale * scale));
}

static void medium_times(struct scene_medium *medium, double scale)
{
    times(medium->absorption, 3, (float)(1 / scale));
    times(medium->scattering, 3, (float)(1 / scale));
    times(medium->emission, 3, (float)(1 / scale));
    matrix_times(&medium->grid_to_world, scale);
}

uint32_t transform_scale(struct import_result *import)
{
    const double scale = 1024;
    struct scene *scene = &import->scene;

    /* What places a blended surface is in the hash that decides which rays pass it. */
    if (!transform_all_stands(scene) || any_material(scene, is_blended))
        return 0;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        matrix_times(&scene->instances[i].to_world, scale);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        camera_times(&scene->cameras[i], scale);
    for (uint32_t i = 0; i < scene->light_count; i++)
        light_times(&scene->lights[i], scale);
    for (uint32_t i = 0; i < scene->medium_count; i++)
        medium_times(&scene->media[i], scale);
    for (uint32_t i = 0; i < scene->material_count; i++)
        scene->materials[i].attenuation_distance *= (float)scale;
    for (uint32_t i = 0; i < scene->environment.portal_count; i++) {
        struct scene_portal *portal = &scene->environment.portals[i];
        for (int c = 0; c < 3; c++)
            portal->corner[c] *= scale;
        times(portal->edge1, 3, (float)scale);
        times(portal->edge2, 3, (float)scale);
    }
    for (int c = 0; c < 3; c++)
        scene->origin[c] *= scale;
    return 1;
}

/* ---- light ------------------------------------------------------------------------------------ */

uint32_t transform_light(struct import_result *import)
{
    struct scene *scene = &import->scene;

    if (any_material(scene, is_unlit)) /* its colour is seen, and gives no light */
        return 0;
    for (uint32_t i = 0; i < scene->light_count; i++)
        times(scene->lights[i].intensity, 3, TRANSFORM_LIGHT);
    for (uint32_t i = 0; i < scene->material_count; i++)
        times(scene->materials[i].emission, 3, TRANSFORM_LIGHT);
    for (uint32_t i = 0; i < scene->medium_count; i++)
        times(scene->media[i].emission, 3, TRANSFORM_LIGHT);
    times(scene->environment.radiance, 3, TRANSFORM_LIGHT);
    return 1;
}

uint32_t transform_black_light(struct import_result *import)
{
    struct scene_light black;

    scene_light_default(&black);
    black.name = "black";
    black.intensity[0] = black.intensity[1] = black.intensity[2] = 0;
    memcpy(black.position, import->scene.cameras[0].to_world.m[0], sizeof black.position);
    transform_add_light(import, black);
    return 1;
}

/* ---- mirrors ---------------------------------------------------------------------------------- */

/* A hash of the corners decides whether rays pass a blended triangle. */
static int may_mirror(const struct scene *scene, const struct scene_instance *instance)
{
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];

    return instance->node < 0 && instance->skin < 0 && mesh->morph_count == 0 &&
           !(mesh->arrays & (MESH_TANGENTS | MESH_SKIN | MESH_STAND_INS)) &&
           scene->materials[instance->material].alpha_mode == ALPHA_OPAQUE;
}

static void turn_x(uint8_t *vectors, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++, vectors += 12) {
        float x;
        memcpy(&x, vectors, sizeof x);
        x = -x;
        memcpy(vectors, &x, sizeof x);
    }
}

static uint32_t mirrored_mesh(struct import_result *import, uint32_t number)
{
    const struct scene_mesh mesh = import->scene.meshes[number];
    struct scene_mesh_layout layout;
    uint8_t *blob;

    scene_mesh_layout(&mesh, &layout);
    blob = mem_alloc(layout.total_bytes);
    if (!blob)
        abort();
    memcpy(blob, transform_blob(import, &mesh), layout.total_bytes);
    turn_x(blob + layout.positions, mesh.vertex_count);
    if (layout.normals != SIZE_MAX)
        turn_x(blob + layout.normals, mesh.vertex_count);
    for (uint32_t t = 0; t < mesh.triangle_count; t++) {
        uint8_t *corner = blob + layout.indices + 12 * (size_t)t + 4, other[4];
        memcpy(other, corner, sizeof other);
        memcpy(corner, corner + 4, sizeof other);
        memcpy(corner + 4, other, sizeof other);
    }
    return transform_add_mesh(import, mesh, blob);
}

/* A mirrored mesh, its triangles wound the other way, under a mirrored matrix, which turns fronts. */
uint32_t transform_mirror(struct import_result *import)
{
    uint32_t done = 0;

    for (uint32_t i = 0; i < import->scene.instance_count; i++) {
        struct scene_instance *instance = &import->scene.instances[i];
        if (!may_mirror(&import->scene, instance))
            continue;
        instance->mesh = mirrored_mesh(import, instance->mesh);
        for (int r = 0; r < 3; r++)
            instance->to_world.m[r][0] = -instance->to_world.m[r][0];
        done++;
    }
    return done;
}
