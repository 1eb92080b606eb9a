/* The same scene in another place, or with what is not seen: samples take other ways, and the picture differs by noise. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/transform.h"

/* ---- turned --------------------------------------------------------------------------------------- */

/* x to y, y to z, z to x: a third of a turn about the diagonal, exact. */
static void cycle(double v[3])
{
    const double last = v[2];

    v[2] = v[1];
    v[1] = v[0];
    v[0] = last;
}

static void cycle_float(float v[3])
{
    const float last = v[2];

    v[2] = v[1];
    v[1] = v[0];
    v[0] = last;
}

static void cycle_matrix(struct transform_d *t)
{
    for (int c = 0; c < 4; c++) {
        double column[3] = {t->m[0][c], t->m[1][c], t->m[2][c]};
        cycle(column);
        for (int r = 0; r < 3; r++)
            t->m[r][c] = column[r];
    }
}

uint32_t transform_turn(struct import_result *import)
{
    struct scene *scene = &import->scene;

    if (!transform_all_stands(scene))
        return 0;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        cycle_matrix(&scene->instances[i].to_world);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        cycle_matrix(&scene->cameras[i].to_world);
    for (uint32_t i = 0; i < scene->medium_count; i++)
        cycle_matrix(&scene->media[i].grid_to_world);
    for (uint32_t i = 0; i < scene->light_count; i++) {
        cycle_matrix(&scene->lights[i].to_world);
        cycle(scene->lights[i].position);
        cycle_float(scene->lights[i].direction);
    }
    for (uint32_t i = 0; i < scene->environment.portal_count; i++) {
        cycle(scene->environment.portals[i].corner);
        cycle_float(scene->environment.portals[i].edge1);
        cycle_float(scene->environment.portals[i].edge2);
    }
    for (int r = 0; r < 3; r++)
        cycle_float(scene->environment.to_map[r]);
    cycle(scene->origin);
    return 1;
}

/* ---- other first corners --------------------------------------------------------------------------- */

static uint32_t rolled_mesh(struct import_result *import, uint32_t number)
{
    const struct scene_mesh mesh = import->scene.meshes[number];
    struct scene_mesh_layout layout;
    uint8_t *blob;

    scene_mesh_layout(&mesh, &layout);
    blob = mem_alloc(layout.total_bytes);
    if (!blob)
        abort();
    memcpy(blob, transform_blob(import, &mesh), layout.total_bytes);
    for (uint32_t t = 0; t < mesh.triangle_count; t++) {
        uint8_t first[4], *corners = blob + layout.indices + 12 * (size_t)t;
        memcpy(first, corners, 4);
        memmove(corners, corners + 4, 8);
        memcpy(corners + 8, first, 4);
    }
    return transform_add_mesh(import, mesh, blob);
}

uint32_t transform_corners(struct import_result *import)
{
    const uint32_t meshes = import->scene.mesh_count;
    uint32_t *rolled = mem_calloc(meshes, sizeof *rolled), done = 0;

    if (!rolled)
        abort();
    for (uint32_t i = 0; i < import->scene.instance_count; i++) {
        uint32_t mesh = import->scene.instances[i].mesh;
        if (import->scene.meshes[mesh].arrays & MESH_STAND_INS)
            continue;
        if (!rolled[mesh])
            rolled[mesh] = rolled_mesh(import, mesh);
        import->scene.instances[i].mesh = rolled[mesh];
        done++;
    }
    mem_free(rolled);
    for (uint32_t i = 0; i < import->scene.environment.portal_count; i++) {
        struct scene_portal *p = &import->scene.environment.portals[i];
        for (int c = 0; c < 3; c++) {
            const float edge = p->edge1[c];
            p->corner[c] += (double)edge;
            p->edge1[c] = p->edge2[c];
            p->edge2[c] = -edge;
        }
    }
    return done;
}

/* ---- an empty box ----------------------------------------------------------------------------------- */

static void stretch(const double p[3], double low[3], double high[3])
{
    for (int c = 0; c < 3; c++) {
        low[c] = fmin(low[c], p[c]);
        high[c] = fmax(high[c], p[c]);
    }
}

static uint32_t box_mesh(struct import_result *import)
{
    static const uint32_t faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                                          {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    struct scene_mesh mesh = {.name = "empty box", .vertex_count = 8, .triangle_count = 12, .closed = 1};
    struct scene_mesh_layout layout;
    uint8_t *blob;

    scene_mesh_layout(&mesh, &layout);
    blob = mem_calloc(1, layout.total_bytes);
    if (!blob)
        abort();
    for (uint32_t v = 0; v < 8; v++) {
        const float p[3] = {v & 1 ? 1 : 0, v & 2 ? 1 : 0, v & 4 ? 1 : 0};
        memcpy(blob + layout.positions + 12 * (size_t)v, p, sizeof p);
    }
    memcpy(blob + layout.indices, faces, sizeof faces);
    return transform_add_mesh(import, mesh, blob);
}

/* A box of that material around everything that stands, and the cameras. */
static void surround(struct import_result *import, struct scene_material material)
{
    const struct scene *scene = &import->scene;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    struct scene_instance box;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        double a[3], b[3];
        if (!scene_instance_bounds(scene, i, a, b))
            continue;
        stretch(a, low, high);
        stretch(b, low, high);
    }
    for (uint32_t i = 0; i < scene->camera_count; i++)
        stretch((double[]){scene->cameras[i].to_world.m[0][3], scene->cameras[i].to_world.m[1][3], scene->cameras[i].to_world.m[2][3]}, low, high);
    scene_instance_default(&box);
    box.name = "box around";
    box.mesh = box_mesh(import);
    box.material = transform_add_material(import, material);
    for (int c = 0; c < 3; c++) {
        const double beyond = (high[c] - low[c]) / 4 + 1e-3;
        box.to_world.m[c][0] = box.to_world.m[c][1] = box.to_world.m[c][2] = 0;
        box.to_world.m[c][c] = high[c] - low[c] + 2 * beyond;
        box.to_world.m[c][3] = low[c] - beyond;
    }
    transform_add_instance(import, box);
}

/* It bounds no medium, and rays to the sky and the sun cross it. Not with fog, which ends where the scene does. */
uint32_t transform_empty_box(struct import_result *import)
{
    struct scene_material interface;

    if (import->scene.fog >= 0 || !transform_all_stands(&import->scene) || import->scene.instance_count == 0)
        return 0;
    scene_material_default(&interface);
    interface.name = "nothing";
    interface.kind = MATERIAL_INTERFACE;
    surround(import, interface);
    return 1;
}

/* ---- something denser ------------------------------------------------------------------------------- */

/* Is it the same in something denser? Dispersion spreads n - 1, what is behind an interface has the index 1, and a face of a body
 * that is not closed, as a blended one is not, bends light only in the open (interior.h). */
static int may_be_denser(const struct scene_material *m)
{
    return !(m->dispersion > 0) && m->kind != MATERIAL_INTERFACE && !(m->alpha_mode != ALPHA_OPAQUE && m->refractive);
}

/* Twice is exact. */
static void denser(struct scene_material *m)
{
    m->ior *= 2;
    m->clearcoat_ior *= 2;
    m->iridescence_ior *= 2;
    m->iridescence_thickness_min_nm /= 2;
    m->iridescence_thickness_max_nm /= 2;
    for (int c = 0; c < 3; c++) {
        m->conductor_eta[c] *= 2;
        m->conductor_k[c] *= 2;
    }
}

uint32_t transform_denser(struct import_result *import)
{
    struct scene *scene = &import->scene;
    struct scene_material around;
    int refracts = 0;

    for (uint32_t i = 0; i < scene->material_count; i++) {
        refracts |= scene->materials[i].refractive;
        if (!may_be_denser(&scene->materials[i]))
            return 0;
    }
    /* Light of lamps without size comes through what is in air (docs/CAUSTICS.md). */
    if (!transform_all_stands(scene) || (refracts && scene->light_count > 0))
        return 0;
    for (uint32_t i = 0; i < scene->material_count; i++)
        denser(&scene->materials[i]);
    scene_material_default(&around);
    around.name = "what fills the room";
    around.metallic = around.roughness = 0;
    around.transmission = 1;
    around.refractive = 1;
    around.ior = 2;
    around.priority = -SCENE_PRIORITY_MAX;
    around.medium = scene->fog;
    surround(import, around);
    return 1;
}
