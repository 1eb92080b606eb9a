/* Packed scenes from anywhere: no crash, and what is accepted packs to bytes that unpack to
 * the same bytes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/scene/move.h"
#include "common/scene/pose.h"
#include "common/scene/scene.h"
#include "common/scene/scene_effects.h"
#include "common/scene/track.h"

/* In a frame it is valid, too, but for instances that are hidden. */
static void take_frame(const struct scene *scene)
{
    struct render_settings settings;
    struct error err = {0};
    struct scene at;
    int hides = 0;

    render_settings_default(&settings);
    for (uint32_t i = 0; i < scene->track_count; i++)
        hides |= scene->tracks[i].target == TRACK_INSTANCE;
    if (scene_at_frame(&at, scene, &settings, 7, &err) == STATUS_OK && !hides && scene_validate(&at, &err) != STATUS_OK)
        abort();
    scene_copy_release(&at);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void pack(const struct scene *scene, struct buffer *out)
{
    if (scene_pack(scene, out, NULL) != STATUS_OK)
        abort();
}

/* Every node, camera and light in the middle of the animation: numbers, or an error. */
static void strike_pose(const struct scene *scene)
{
    struct scene_pose pose;
    struct render_settings settings;
    double open_s, close_s;
    struct error err = {0};

    render_settings_default(&settings);
    settings.shutter = 0.5f;
    scene_shutter(scene, &settings, 1, &open_s, &close_s);
    if (!(open_s <= close_s))
        abort();
    if (scene_pose_init(&pose, scene, scene_duration_s(scene) * 0.625, &err) != STATUS_OK) {
        if (!err.text[0])
            abort();
        return;
    }
    for (uint32_t i = 0; i < scene->node_count; i++) {
        struct transform t = transform_from_d(&pose.to_world[i]);
        if (!transform_is_finite(&t))
            abort();
    }
    for (uint32_t i = 0; i < scene->camera_count; i++) {
        struct scene_camera camera;
        pose_camera(&pose, scene, i, &camera);
        if (!transform_d_is_finite(&camera.to_world))
            abort();
    }
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct scene_light light;
        pose_light(&pose, scene, i, &light);
        if (!transform_d_is_finite(&light.to_world) || !isfinite(light.direction[0]))
            abort();
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        pose_instance(&pose, scene, i);
        scene_instance_deforms(scene, i);
    }
    scene_pose_release(&pose);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct buffer first = BUFFER_INIT, second = BUFFER_INIT;
    struct scene scene, again;
    struct error err = {0};
    float low[3], high[3];

    if (scene_unpack(&scene, data, size, &err) != STATUS_OK) {
        if (!err.text[0])
            abort();
        return 0;
    }
    take_frame(&scene);
    for (uint32_t camera = 0; camera < scene.camera_count && camera < 4; camera++)
        scene_effects_default(&scene, camera);
    scene_bounds(&scene, low, high);
    strike_pose(&scene);
    pack(&scene, &first);
    if (scene_unpack(&again, first.data, first.size, &err) != STATUS_OK)
        abort();
    pack(&again, &second);
    if (first.size != second.size || memcmp(first.data, second.data, first.size) != 0)
        abort();
    buffer_release(&first);
    buffer_release(&second);
    scene_release(&again);
    scene_release(&scene);
    return 0;
}
