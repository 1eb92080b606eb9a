/* Work that a scene does not call for is not done: rays are counted, and what nobody should read
 * is put out of reach, so that reading it would be noticed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/render_scene.h"

enum { SIZE = 8, SPP = 16 };

/* A floor that fills the view of a camera over it. */
static struct scene_material *floor_init(struct scene_builder *b)
{
    struct scene_material *m;

    builder_init(b);
    m = builder_lambert(b, 0.5f);
    builder_place(b, builder_quad(b), builder_last_material(b), vec3_splat(100), vec3_make(0, 0, 0));
    builder_camera(b, vec3_make(0, 5, 0), vec3_splat(0), 0.5f);
    return m;
}

static struct scene_light *lamp_at(struct scene_builder *b, float height)
{
    struct scene_light *light = builder_light(b, LIGHT_POINT);

    light->position[1] = height;
    light->intensity[0] = light->intensity[1] = light->intensity[2] = 1;
    return light;
}

/* Rays a sample. With a depth of 1 every path has two: from the camera, and from the floor to
 * nowhere; what is more are shadow rays. */
static double rays_of(struct scene_builder *b, enum env_sampling sampling)
{
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    struct render_stats stats = {0};
    struct render_scene *scene;
    double mean[SIZE * SIZE * 3];

    settings.max_depth = 1;
    settings.env_sampling = sampling;
    scene = builder_build(b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    assert_int_equal(stats.work.samples, SIZE * SIZE * SPP);
    render_scene_free(scene);
    builder_release(b);
    return (double)stats.work.rays / (double)stats.work.samples;
}

static void test_shadow_rays(void **state)
{
    struct scene_builder b;
    struct scene_light *light;
    struct scene_material *m;

    (void)state;
    floor_init(&b); /* no light */
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) == 2);

    floor_init(&b);
    lamp_at(&b, 2);
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) == 3);

    floor_init(&b); /* it has no light to give */
    light = lamp_at(&b, 2);
    memset(light->intensity, 0, sizeof light->intensity);
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) == 2);

    floor_init(&b); /* it is behind the floor */
    lamp_at(&b, -2);
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) == 2);

    m = floor_init(&b); /* a mirror sees no point light */
    m->metallic = 1;
    m->roughness = 0;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = 1;
    lamp_at(&b, 2);
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) == 2);
}

/* Where directions are chosen by the surface alone there is nothing to weigh against it: no
 * shadow rays, no lights, no table of the map. */
static void test_one_strategy(void **state)
{
    float map[16 * 8 * 3];
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    struct render_scene *scene;
    struct scene_builder b;
    size_t bytes[2];

    (void)state;
    for (size_t i = 0; i < sizeof map / sizeof *map; i++)
        map[i] = (float)(i % 7);
    floor_init(&b);
    builder_environment_map(&b, map, 16, 8);
    assert_true(rays_of(&b, ENV_SAMPLING_BSDF) == 2);
    floor_init(&b);
    builder_environment_map(&b, map, 16, 8);
    assert_true(rays_of(&b, ENV_SAMPLING_IMPORTANCE) > 2.3);

    for (int k = 0; k < 2; k++) {
        floor_init(&b);
        builder_environment_map(&b, map, 16, 8);
        settings.env_sampling = k ? ENV_SAMPLING_BSDF : ENV_SAMPLING_IMPORTANCE;
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->emitters.count, k ? 0 : 1);
        assert_int_equal(scene->emitters.tree.node_count, 0);
        bytes[k] = environment_bytes(scene->environment);
        render_scene_free(scene);
        builder_release(&b);
    }
    assert_true(bytes[1] < bytes[0]);
}

/* A uniform environment has neither pixels nor a table. */
static void test_uniform_environment(void **state)
{
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    float map[3 * 16 * 8];
    struct render_scene *scene;
    struct scene_builder b;
    size_t bytes[2];

    (void)state;
    for (size_t i = 0; i < sizeof map / sizeof *map; i++)
        map[i] = 1 + (float)(i % 5);
    for (int k = 0; k < 2; k++) {
        floor_init(&b);
        if (k)
            builder_environment_constant(&b, vec3_splat(1));
        else
            builder_environment_map(&b, map, 16, 8);
        scene = builder_build(&b, &settings);
        bytes[k] = environment_bytes(scene->environment);
        render_scene_free(scene);
        builder_release(&b);
    }
    assert_true(bytes[1] + sizeof map <= bytes[0]);
}

/* Texture coordinates, tangents and colours that no material reads: if a vertex touched them, the
 * program would end here. */
static void test_attributes_unread(void **state)
{
    static const float *const nowhere = (const float *)8;
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    struct render_stats stats = {0};
    double mean[SIZE * SIZE * 3];
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    for (int glossy = 0; glossy < 2; glossy++) {
        struct scene_material *m = floor_init(&b);
        m->specular = (float)glossy;
        m->roughness = 0.4f;
        builder_environment_constant(&b, vec3_splat(1));
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->effects & (EFFECT_TEXTURE | EFFECT_NORMAL_MAP), 0);
        scene->meshes[0].uv[0] = scene->meshes[0].uv[1] = scene->meshes[0].tangents = nowhere;
        scene->meshes[0].colors = nowhere;
        memset(&stats, 0, sizeof stats);
        builder_render(scene, &settings, 0, mean, NULL, &stats);
        assert_true(stats.work.vertices > 0 && stats.work.dropped_samples == 0);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* Textures whose factor is 0, or that --without takes away, are not even loaded. */
static void test_images_unread(void **state)
{
    static const float red[3 * 4] = {1, 0, 0, 1, 0, 0, 1, 0, 0, 0.5f, 0, 0};
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    struct render_scene_info info;
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    for (int k = 0; k < 3; k++) {
        struct scene_material *m = floor_init(&b);
        uint32_t texture = builder_texture(&b, red, 2, 2);
        m->sheen_color_texture.texture = k == 0 ? (int32_t)texture : -1; /* no sheen */
        m->base_color_texture.texture = k > 0 ? (int32_t)texture : -1;
        settings.without = k == 1 ? EFFECT_TEXTURE : 0;
        scene = builder_build(&b, &settings);
        render_scene_info(scene, &info);
        assert_int_equal(info.texture_bytes > 0, k == 2);
        assert_int_equal(scene->images[0] != NULL, k == 2);
        assert_int_equal((scene->effects & EFFECT_TEXTURE) != 0, k == 2);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* Rays to a closed opaque ball are not asked whether they may pass: its material may say so as
 * loudly as it will. The same ball seen from inside asks. */
static void test_filter_unasked(void **state)
{
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    struct render_stats stats;
    double mean[SIZE * SIZE * 3];

    (void)state;
    for (int inside = 0; inside < 2; inside++) {
        struct render_scene *scene;
        struct scene_builder b;
        builder_init(&b);
        builder_lambert(&b, 0.5f)->double_sided = 0;
        builder_place(&b, builder_sphere(&b, 16, 0), 0, vec3_splat(1), vec3_make(0, 0, 0));
        builder_camera(&b, vec3_make(0, 0, inside ? 0 : 5), vec3_make(0, 0, -1), 0.1f);
        scene = builder_build(&b, &settings);
        assert_int_equal((scene->effects & EFFECT_CULLING) != 0, inside);
        if (!inside) /* if it were asked now, the camera would see nothing at all */
            scene->materials[0].flags |= MATERIAL_ALPHA | MATERIAL_CULLED;
        scene->materials[0].m.alpha_mode = ALPHA_MASK;
        scene->materials[0].m.alpha_cutoff = 2;
        memset(&stats, 0, sizeof stats);
        builder_render(scene, &settings, 0, mean, NULL, &stats);
        assert_int_equal(stats.work.vertices > 0, !inside); /* from inside the faces are culled */
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* Nothing moves: no moments in the BVH, and rays carry none. */
static void test_no_motion(void **state)
{
    static const float times[2] = {0, 1}, places[6] = {0, 0, 0, 0, 1, 0};
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);

    (void)state;
    settings.fps = 1;
    for (int open = 0; open < 2; open++) {
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t node;
        floor_init(&b);
        node = builder_node(&b, -1, 0);
        builder_channel(&b, node, PATH_TRANSLATION, 2, times, places);
        b.scene.instances[0].node = (int32_t)node;
        settings.shutter = (float)open;
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->instances[0].motion_steps, open ? 2 : 0);
        assert_int_equal(scene->camera.shutter_open != 0, open);
        assert_int_equal((scene->effects & EFFECT_MOTION_BLUR) != 0, open);
        assert_string_equal(render_kernel_variant(scene), open ? "general" : "matte");
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shadow_rays),      cmocka_unit_test(test_one_strategy),
        cmocka_unit_test(test_uniform_environment), cmocka_unit_test(test_attributes_unread),
        cmocka_unit_test(test_images_unread),    cmocka_unit_test(test_filter_unasked),
        cmocka_unit_test(test_no_motion),
    };

    return cmocka_run_group_tests_name("unneeded", tests, NULL, NULL);
}
