/* One black card far off to one side. It hides a millionth of a steradian of the sky. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/move.h"
#include "tests/support/transform.h"

/* Of the scene's bounds, metres; 0: it has none, or fog fills them. */
static double size_of(const struct scene *scene, double middle[3])
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, size = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        double a[3], b[3];
        for (int c = 0; scene_instance_bounds(scene, i, a, b) && c < 3; c++) {
            low[c] = fmin(low[c], a[c]);
            high[c] = fmax(high[c], b[c]);
        }
    }
    for (int c = 0; c < 3; c++) {
        size = fmax(size, high[c] - low[c]);
        middle[c] = low[c] / 2 + high[c] / 2;
    }
    return scene->fog < 0 && size > 0 && size < 1e6 ? size : 0;
}

static uint32_t card_mesh(struct import_result *import)
{
    static const float corners[12] = {0, -0.5f, -0.5f, 0, -0.5f, 0.5f, 0, 0.5f, 0.5f, 0, 0.5f, -0.5f};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct scene_mesh mesh = {.name = "far card", .vertex_count = 4, .triangle_count = 2};
    struct scene_mesh_layout layout;
    uint8_t *blob;

    scene_mesh_layout(&mesh, &layout);
    blob = mem_calloc(1, layout.total_bytes);
    if (!blob)
        abort();
    memcpy(blob + layout.positions, corners, sizeof corners);
    memcpy(blob + layout.indices, indices, sizeof indices);
    return transform_add_mesh(import, mesh, blob);
}

/* The import would then put the origin half way to it. */
static uint32_t add_card(struct import_result *import, double sizes)
{
    struct scene_instance card;
    struct scene_material black;
    double middle[3], origin[3] = {0, 0, 0}, away = sizes * size_of(&import->scene, middle);

    if (!(away > 0))
        return 0;
    scene_material_default(&black);
    black.name = "black";
    black.double_sided = 1;
    black.metallic = black.specular = 0;
    black.base_color[0] = black.base_color[1] = black.base_color[2] = 0;
    scene_instance_default(&card);
    card.name = "far card";
    card.mesh = card_mesh(import);
    card.material = transform_add_material(import, black);
    for (int c = 0; c < 3; c++) {
        card.to_world.m[c][c] = away / 1000;
        card.to_world.m[c][3] = middle[c] + (c == 0 ? away : 0);
    }
    transform_add_instance(import, card);
    origin[0] = away / 2;
    scene_move(&import->scene, origin);
    return 1;
}

uint32_t transform_far_thing(struct import_result *import) { return add_card(import, 1e3); }

uint32_t transform_very_far_thing(struct import_result *import) { return add_card(import, 1e7); }
