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
    return (struct scene_texture_slot){texture, (uint32_t)texture % 2, {{0.5f, 0.25f, 3}, {-0.25f, 2, -1}}};
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
        .anisotropy = 0.5f,
        .anisotropy_rotation_rad = -1.25f,
        .anisotropy_texture = slot(0),
        .clearcoat = 0.75f,
        .clearcoat_texture = slot(1),
        .clearcoat_roughness = 0.125f,
        .clearcoat_roughness_texture = slot(0),
        .clearcoat_ior = 1.6f,
        .clearcoat_normal_scale = 0.5f,
        .clearcoat_normal_texture = slot(1),
        .sheen_color = {0.25f, 0.5f, 0.75f},
        .sheen_color_texture = slot(0),
        .sheen_roughness = 0.375f,
        .sheen_roughness_texture = slot(1),
        .iridescence = 0.625f,
        .iridescence_texture = slot(0),
        .iridescence_ior = 1.75f,
        .iridescence_thickness_min_nm = 300,
        .iridescence_thickness_max_nm = 200,
        .iridescence_thickness_texture = slot(1),
        .diffuse_transmission = 0.875f,
        .diffuse_transmission_texture = slot(0),
        .diffuse_transmission_color = {0.125f, 0.25f, 0.5f},
        .diffuse_transmission_color_texture = slot(1),
        .dispersion = 0.36f,
        .conductor_eta = {0.2f, 0.9f, 1.1f},
        .conductor_k = {3.9f, 2.4f, 2.2f},
        .base_interreflection = 0.5f,
        .thin_slab = 1,
        .priority = -7,
        .medium = 1,
        .medium_outside = 0,
        .mix_amount = 0.25f,
        .mix_texture = slot(1),
    };
    /* What is not listed has no texture. */
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (s->materials[0].textures[i].uv_transform[0][0] == 0)
            s->materials[0].textures[i] = s->materials[1].textures[i];
    s->materials[1].unlit = 1;
    s->materials[1].kind = MATERIAL_CONDUCTOR;
    s->materials[2].ior = 0;
    s->materials[2].kind = MATERIAL_MIX;
    s->materials[2].mix_material[0] = 1;
    s->materials[2].mix_material[1] = 0;
}

static void fill_meshes(struct scene *s)
{
    s->mesh_count = 2;
    s->meshes = checked(ARENA_ARRAY(&s->arena, struct scene_mesh, 2));
    s->meshes[0] = (struct scene_mesh){.name = "box",
                                       .vertex_count = 24,
                                       .triangle_count = 12,
                                       .arrays = MESH_ARRAYS_ALL & ~(uint32_t)MESH_STAND_INS,
                                       .morph_count = 2,
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
    const struct transform_d turned = {{{0, 0, 1, 1}, {0, -1, 0, 2}, {1, 0, 0, 3}}};

    s->light_count = 5;
    s->lights = checked(ARENA_ARRAY(&s->arena, struct scene_light, 5));
    for (int i = 0; i < 5; i++)
        s->lights[i] = (struct scene_light){.name = "lamp",
                                            .kind = (enum scene_light_kind)i,
                                            .position = {1, 2, 3},
                                            .direction = {0, 0.6f, -0.8f},
                                            .intensity = {10, 20, 30},
                                            .range = 5,
                                            .inner_cone_rad = 0.25f,
                                            .outer_cone_rad = 0.5f,
                                            .falloff = FALLOFF_SMOOTHSTEP,
                                            .image = i % 2,
                                            .to_world = turned,
                                            .projection_yfov_rad = 1.25f,
                                            .projection_aspect = 1.5f,
                                            .node = i % 3};
}

static void fill_cameras(struct scene *s)
{
    const struct transform_d view = {{{1, 0, 0, 4}, {0, 0.8, -0.6, 5}, {0, 0.6, 0.8, 6}}};

    s->camera_count = 2;
    s->cameras = checked(ARENA_ARRAY(&s->arena, struct scene_camera, 2));
    s->cameras[0] = (struct scene_camera){.name = "eye",
                                          .kind = CAMERA_PERSPECTIVE,
                                          .to_world = view,
                                          .yfov_rad = 0.75f,
                                          .aspect = 1.5f,
                                          .lens_radius = 0.01f,
                                          .focus_distance = 2.5f,
                                          .blades = 6,
                                          .blade_rotation_rad = 0.5f,
                                          .shutter_open_s = -0.25f,
                                          .shutter_close_s = 0.5f,
                                          .exposure_ev = -1.5f,
                                          .node = 2};
    s->cameras[1] = (struct scene_camera){.name = "plan",
                                          .kind = CAMERA_ORTHOGRAPHIC,
                                          .to_world = view,
                                          .xmag = 2,
                                          .ymag = 3,
                                          .node = -1};
}

static float *numbers(struct scene *s, size_t count)
{
    float *out = checked(ARENA_ARRAY(&s->arena, float, count));

    for (size_t i = 0; i < count; i++)
        out[i] = 0.5f + 0.25f * (float)i;
    return out;
}

static void fill_nodes(struct scene *s)
{
    s->node_count = 3;
    s->nodes = checked(ARENA_ARRAY(&s->arena, struct scene_node, 3));
    for (int i = 0; i < 3; i++)
        scene_node_default(&s->nodes[i]);
    s->nodes[0].has_matrix = 1;
    s->nodes[0].matrix = (struct transform_d){{{1, 2, 0, 3}, {0, 1, 0, 4}, {0, 0, -1, 5}}};
    s->nodes[1] = (struct scene_node){.parent = 0,
                                      .translation = {1, 2, 3},
                                      .rotation = {0.5f, -0.5f, 0.5f, 0.5f},
                                      .scale = {2, 2, 0.5f},
                                      .matrix = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                      .weights = numbers(s, 2),
                                      .weight_count = 2};
    s->nodes[2].parent = 1;
}

static struct scene_channel channel(struct scene *s, uint32_t node, enum scene_channel_path path,
                                    enum scene_interpolation interpolation, uint32_t components)
{
    struct scene_channel c = {.node = node,
                              .path = path,
                              .interpolation = interpolation,
                              .key_count = 3,
                              .components = components};

    c.times = numbers(s, c.key_count);
    c.values = numbers(s, scene_channel_floats(&c));
    return c;
}

static void fill_motion(struct scene *s)
{
    fill_nodes(s);
    s->channel_count = 5;
    s->channels = checked(ARENA_ARRAY(&s->arena, struct scene_channel, 5));
    s->channels[0] = channel(s, 1, PATH_TRANSLATION, INTERPOLATE_STEP, 3);
    s->channels[1] = channel(s, 1, PATH_ROTATION, INTERPOLATE_CUBIC, 4);
    s->channels[2] = channel(s, 1, PATH_SCALE, INTERPOLATE_LINEAR, 3);
    s->channels[3] = channel(s, 1, PATH_WEIGHTS, INTERPOLATE_CUBIC, 2);
    s->channels[4] = channel(s, 2, PATH_ROTATION, INTERPOLATE_LINEAR, 4);
    s->skin_count = 1;
    s->skins = checked(ARENA_NEW(&s->arena, struct scene_skin));
    s->skins[0].joint_count = 2;
    s->skins[0].joints = checked(ARENA_ARRAY(&s->arena, uint32_t, 2));
    s->skins[0].joints[0] = 2;
    s->skins[0].joints[1] = 1;
    s->skins[0].inverse_bind = checked(ARENA_ARRAY(&s->arena, struct transform_stored, 2));
    memcpy(s->skins[0].inverse_bind, numbers(s, 24), sizeof(float) * 24);
}

static void fill_media(struct scene *s)
{
    s->medium_count = 2;
    s->media = checked(ARENA_ARRAY(&s->arena, struct scene_medium, 2));
    scene_medium_default(&s->media[0]);
    s->media[0].scattering[1] = 0.5f;
    s->media[1] = (struct scene_medium){
        .name = "smoke",
        .absorption = {1, 2, 3},
        .scattering = {4, 5, 6},
        .emission = {7, 8, 9},
        .g = -0.5f,
        .has_grid = 1,
        .grid = blob(11, 3 * 4 * 5 * sizeof(float)),
        .grid_size = {3, 4, 5},
        .grid_to_world = {{{2, 0, 0, 1}, {0, 0, 3, 1}, {0, 4, 0, 1}}},
    };
    s->fog = 0;
    s->volume_rule = VOLUMES_BOUNDARIES;
}

static void fill_environment(struct scene *s)
{
    static const float to_map[3][3] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
    struct scene_environment *env = &s->environment;

    env->present = 1;
    env->image = (struct scene_image){"sky.exr", blob(9, 99)};
    env->radiance[1] = 2;
    memcpy(env->to_map, to_map, sizeof to_map);
    env->portal_count = 2;
    env->portals = checked(ARENA_ARRAY(&s->arena, struct scene_portal, 2));
    env->portals[0] = (struct scene_portal){{1, 2, 3}, {1, 0, 0}, {0, 0, 2}};
    env->portals[1] = (struct scene_portal){{3, 2, 1}, {0, 1, 0}, {1, 1, 1}};
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
    s->textures[0] = (struct scene_texture){0, WRAP_CLAMP, WRAP_MIRROR, 1, ENCODING_SRGB};
    s->textures[1] = (struct scene_texture){1, WRAP_REPEAT, WRAP_BLACK, 0, ENCODING_BY_SLOT};
    fill_materials(s);
    fill_motion(s);
    fill_media(s);
    s->instance_count = 3;
    s->instances = checked(ARENA_ARRAY(&s->arena, struct scene_instance, 3));
    for (uint32_t i = 0; i < 3; i++)
        s->instances[i] = (struct scene_instance){
            .name = "thing",
            .asset = "",
            .mesh = i % 2,
            .material = i,
            .node = (int32_t)i - 1,
            .skin = i == 2 ? 0 : -1,
            .body = i == 1 ? 1 : -1,
            .sealed = i == 1,
            .to_world = {{{2, 0, 0, (float)i}, {0, -3, 0, 1}, {0, 0, 4, 2}}}};
    s->origin[0] = 500000.125;
    s->origin[2] = -3;
    fill_lights(s);
    fill_cameras(s);
    fill_environment(s);
}
