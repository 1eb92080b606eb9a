#include "tests/support/scene_sample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void *checked(void *block)
{
    if (!block)
        abort();
    return block;
}

static struct scene_blob blob(uint8_t seed, uint64_t size_bytes)
{
    struct scene_blob b = {.size_bytes = size_bytes};

    memset(b.digest.bytes, seed, sizeof b.digest.bytes);
    b.digest.bytes[31] = (uint8_t)(seed * 7);
    return b;
}

void scene_sample_blob(struct scene_mesh *mesh, uint8_t seed)
{
    struct scene_mesh_layout layout;

    scene_mesh_layout(mesh, &layout);
    mesh->blob = blob(seed, layout.total_bytes);
}

static struct scene_texture_slot slot(int32_t texture)
{
    return (struct scene_texture_slot){texture, (uint32_t)texture % 2,
                                       {{0.5f, 0.25f, 3}, {-0.25f, 2, -1}}};
}

static void fill_materials(struct scene *s)
{
    s->material_count = 3;
    s->materials = checked(ARENA_ARRAY(&s->arena, struct scene_material, 3));
    for (int i = 0; i < 3; i++)
        scene_material_default(&s->materials[i]);
    s->materials[0] = (struct scene_material){
        .name = "glass \xc3\xa9",
        .double_sided = 1,
        .alpha_mode = ALPHA_MASK,
        .alpha_cutoff = 0.75f,
        .base_color = {0.1f, 0.2f, 0.3f, 0.9f},
        .base_color_texture = slot(0),
        .metallic = 0.25f,
        .roughness = 0.5f,
        .metallic_roughness_texture = slot(1),
        .normal_scale = -0.5f,
        .normal_texture = slot(0),
        .emission = {1, 20, 300},
        .emission_texture = slot(1),
        .ior = 1.33f,
        .specular = 0.5f,
        .specular_texture = slot(0),
        .specular_color = {1, 2, 0.5f},
        .specular_color_texture = slot(1),
        .transmission = 0.75f,
        .transmission_texture = slot(0),
        .refractive = 1,
        .attenuation_color = {0.5f, 0.6f, 0.7f},
        .attenuation_distance = 0.01f,
    };
    s->materials[1].unlit = 1;
    s->materials[2].ior = 0;
}

static void fill_meshes(struct scene *s)
{
    s->mesh_count = 2;
    s->meshes = checked(ARENA_ARRAY(&s->arena, struct scene_mesh, 2));
    s->meshes[0] = (struct scene_mesh){.name = "box",
                                       .vertex_count = 24,
                                       .triangle_count = 12,
                                       .arrays = MESH_ARRAYS_ALL,
                                       .bounds_min = {-1, -2, -3},
                                       .bounds_max = {1, 2, 3},
                                       .closed = 1};
    s->meshes[1] = (struct scene_mesh){
        .name = "", .vertex_count = 3, .triangle_count = 1, .bounds_max = {1, 1, 0}};
    scene_sample_blob(&s->meshes[0], 1);
    scene_sample_blob(&s->meshes[1], 2);
}

static void fill_lights(struct scene *s)
{
    s->light_count = 3;
    s->lights = checked(ARENA_ARRAY(&s->arena, struct scene_light, 3));
    for (int i = 0; i < 3; i++)
        s->lights[i] = (struct scene_light){.name = "lamp",
                                            .kind = (enum scene_light_kind)i,
                                            .position = {1, 2, 3},
                                            .direction = {0, 0.6f, -0.8f},
                                            .intensity = {10, 20, 30},
                                            .range = 5,
                                            .inner_cone_rad = 0.25f,
                                            .outer_cone_rad = 0.5f,
                                            .image = -1,
                                            .node = -1};
}

static void fill_cameras(struct scene *s)
{
    const struct transform view = {{{1, 0, 0, 4}, {0, 0.8f, -0.6f, 5}, {0, 0.6f, 0.8f, 6}}};

    s->camera_count = 2;
    s->cameras = checked(ARENA_ARRAY(&s->arena, struct scene_camera, 2));
    s->cameras[0] = (struct scene_camera){.name = "eye",
                                          .kind = CAMERA_PERSPECTIVE,
                                          .to_world = view,
                                          .yfov_rad = 0.75f,
                                          .aspect = 1.5f,
                                          .node = -1};
    s->cameras[1] = (struct scene_camera){.name = "plan",
                                          .kind = CAMERA_ORTHOGRAPHIC,
                                          .to_world = view,
                                          .xmag = 2,
                                          .ymag = 3,
                                          .node = -1};
}

void scene_sample(struct scene *s)
{
    scene_init(s);
    s->name = "sample";
    fill_meshes(s);
    s->image_count = 2;
    s->images = checked(ARENA_ARRAY(&s->arena, struct scene_image, 2));
    s->images[0] = (struct scene_image){"wood.png", blob(3, 1234)};
    s->images[1] = (struct scene_image){"again.png", blob(3, 1234)};
    s->texture_count = 2;
    s->textures = checked(ARENA_ARRAY(&s->arena, struct scene_texture, 2));
    s->textures[0] = (struct scene_texture){0, WRAP_CLAMP, WRAP_MIRROR, 1, ENCODING_BY_SLOT};
    s->textures[1] = (struct scene_texture){1, WRAP_REPEAT, WRAP_REPEAT, 0, ENCODING_BY_SLOT};
    fill_materials(s);
    s->instance_count = 3;
    s->instances = checked(ARENA_ARRAY(&s->arena, struct scene_instance, 3));
    for (uint32_t i = 0; i < 3; i++)
        s->instances[i] = (struct scene_instance){
            .name = "thing",
            .mesh = i % 2,
            .material = i,
            .node = -1,
            .skin = -1,
            .to_world = {{{2, 0, 0, (float)i}, {0, -3, 0, 1}, {0, 0, 4, 2}}}};
    fill_lights(s);
    fill_cameras(s);
    s->environment.present = 1;
    s->environment.image = (struct scene_image){"sky.exr", blob(9, 99)};
}
