/* Hard cases of nodes and skins, as pictures or counts: each notices the loss of one
 * safeguard (common/base/safeguard.h; docs/NUMERICS.md). Places far from the origin:
 * statistics/test_far_worlds.c.
 *
 * Nothing here is random but the pixels' filter. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"

enum { SIDE = 8, PIXELS = SIDE * SIDE };

static const float plane_corners[12] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
static const float plane_normals[12] = {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0};
static const uint32_t plane_indices[6] = {0, 1, 2, 0, 2, 3};

static double mean_red(struct scene_builder *b, const struct render_settings *settings, uint32_t frame)
{
    static double picture[PIXELS * 3];
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct error err = {0};
    double sum = 0;

    if (render_scene_new(&scene, &b->scene, settings, frame, builder_source(b), &err))
        fail_msg("%s", err.text);
    builder_render(scene, settings, frame, picture, NULL, &stats);
    for (int i = 0; i < PIXELS; i++)
        sum += picture[3 * i] / PIXELS;
    render_scene_free(scene);
    return sum;
}

/* A card that has been turned by 60 degrees when two equal keys hold it. */
static void test_equal_keys(void **state)
{
    static const float times[3] = {0, 1, 2};
    static const float turned[12] = {0, 0, 0, 1, 0.5f, 0, 0, 0.8660254f, 0.5f, 0, 0, 0.8660254f};
    struct render_settings settings = builder_settings(SIDE, SIDE, 4);
    struct scene_light *sun;
    struct scene_builder b;
    uint32_t node;

    (void)state;
    settings.fps = 2;
    settings.max_depth = 1;
    builder_init(&b);
    node = builder_node(&b, -1, 0);
    builder_channel(&b, node, PATH_ROTATION, 3, times, turned);
    builder_lambert(&b, 1);
    builder_place(&b, builder_quad(&b), 0, vec3_splat(1), vec3_splat(0))->node = (int32_t)node;
    builder_camera(&b, vec3_make(0, 3, 0), vec3_splat(0), 0.1f);
    sun = builder_light(&b, LIGHT_DIRECTIONAL);
    sun->intensity[0] = (float)M_PI;
    figure_within("radiance of a card at a key of its rotation", mean_red(&b, &settings, 2), 0.4999,
                  0.5001, "tolerance 2e-4");
    figure_within("radiance of a card between two equal keys of its rotation",
                  mean_red(&b, &settings, 3), 0.4999, 0.5001, "tolerance 2e-4");
    builder_release(&b);
}

/* A skin's card, turned by 60 degrees, whose joint is pressed flat along the card's normal; the light
 * comes along the turned normal. */
static void test_pressed_flat(void **state)
{
    static const struct mesh_influence whole[4] = {{{1}, {0}}, {{1}, {0}}, {{1}, {0}}, {{1}, {0}}};
    const double turn = M_PI / 3;
    struct render_settings settings = builder_settings(SIDE, SIDE, 4);
    struct scene_light *sun;
    struct scene_builder b;
    uint32_t mesh, joint;

    (void)state;
    settings.max_depth = 1;
    builder_init(&b);
    joint = builder_node(&b, -1, 0);
    b.scene.nodes[joint].rotation[0] = sin(turn / 2);
    b.scene.nodes[joint].rotation[3] = cos(turn / 2);
    b.scene.nodes[joint].scale[1] = 0;
    mesh = builder_mesh_deforming_smooth(&b, plane_corners, plane_normals, 4, plane_indices, 2, whole, NULL, NULL, 0);
    builder_lambert(&b, 1);
    builder_place(&b, mesh, 0, vec3_splat(1), vec3_splat(0))->skin = builder_skin(&b, &joint, 1);
    builder_camera(&b, vec3_make(0, (float)cos(turn) * 3, (float)sin(turn) * 3), vec3_splat(0), 0.01f);
    sun = builder_light(&b, LIGHT_DIRECTIONAL);
    sun->direction[1] = -(float)cos(turn);
    sun->direction[2] = -(float)sin(turn);
    sun->intensity[0] = (float)M_PI;
    figure_within("radiance of a skin that is pressed flat", mean_red(&b, &settings, 0), 0.999, 1.001,
                  "tolerance 1e-3");
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_equal_keys),
        cmocka_unit_test(test_pressed_flat),
    };

    return cmocka_run_group_tests_name("hard poses", tests, NULL, NULL);
}
