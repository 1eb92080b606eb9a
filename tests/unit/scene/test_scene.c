/* The scene description: layout, validation, wire form, blobs, bounds. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/scene/move.h"
#include "common/scene/scene.h"
#include "tests/support/scene_sample.h"

static void pack(const struct scene *scene, struct buffer *out)
{
    struct error err = {0};

    assert_int_equal(scene_pack(scene, out, &err), STATUS_OK);
}

static void test_layout(void **state)
{
    struct scene_mesh mesh = {.vertex_count = 5, .triangle_count = 2, .arrays = 0};
    struct scene_mesh_layout layout;

    (void)state;
    scene_mesh_layout(&mesh, &layout);
    assert_int_equal(layout.positions, 0);
    assert_true(layout.normals == SIZE_MAX && layout.colors == SIZE_MAX);
    assert_int_equal(layout.indices, 60);
    assert_int_equal(layout.total_bytes, 60 + 24 + 16);
    mesh.arrays = MESH_ARRAYS_ALL & ~(uint32_t)MESH_STAND_INS;
    scene_mesh_layout(&mesh, &layout);
    assert_int_equal(layout.normals, 60);
    assert_int_equal(layout.tangents, 120);
    assert_int_equal(layout.uv0, 200);
    assert_int_equal(layout.uv1, 240);
    assert_int_equal(layout.colors, 280);
    assert_int_equal(layout.skin, 360);
    assert_true(layout.morphs == SIZE_MAX);
    assert_int_equal(layout.indices, 480); /* 5 times 16 + 8 bytes of weights and joints */
    assert_int_equal(layout.total_bytes, 480 + 24 + 16);
    mesh.morph_count = 2;
    scene_mesh_layout(&mesh, &layout);
    assert_int_equal(layout.morphs, 480);
    assert_int_equal(layout.morph_stride, 2 * 60);
    assert_int_equal(layout.indices, 720);
    mesh.arrays &= ~(uint32_t)MESH_NORMALS;
    scene_mesh_layout(&mesh, &layout);
    assert_int_equal(layout.morphs, 420);
    assert_int_equal(layout.morph_stride, 60);
    assert_int_equal(layout.indices, 540);
}

static void assert_slot_equal(const struct scene_texture_slot *a, const struct scene_texture_slot *b)
{
    assert_int_equal(a->texture, b->texture);
    assert_int_equal(a->uv_set, b->uv_set);
    assert_memory_equal(a->uv_transform, b->uv_transform, sizeof a->uv_transform);
}

static void assert_layers_equal(const struct scene_material *x, const struct scene_material *y)
{
#define SAME(field) assert_memory_equal(&x->field, &y->field, sizeof x->field)
#define SAME_SLOT(field) assert_slot_equal(&x->field, &y->field)
    SAME(kind);
    SAME(anisotropy);
    SAME(anisotropy_rotation_rad);
    SAME_SLOT(anisotropy_texture);
    SAME(clearcoat);
    SAME_SLOT(clearcoat_texture);
    SAME(clearcoat_roughness);
    SAME_SLOT(clearcoat_roughness_texture);
    SAME(clearcoat_ior);
    SAME(clearcoat_normal_scale);
    SAME_SLOT(clearcoat_normal_texture);
    SAME(sheen_color);
    SAME_SLOT(sheen_color_texture);
    SAME(sheen_roughness);
    SAME_SLOT(sheen_roughness_texture);
    SAME(iridescence);
    SAME_SLOT(iridescence_texture);
    SAME(iridescence_ior);
    SAME(iridescence_thickness_min_nm);
    SAME(iridescence_thickness_max_nm);
    SAME_SLOT(iridescence_thickness_texture);
    SAME(diffuse_transmission);
    SAME_SLOT(diffuse_transmission_texture);
    SAME(diffuse_transmission_color);
    SAME_SLOT(diffuse_transmission_color_texture);
    SAME(dispersion);
    SAME(conductor_eta);
    SAME(conductor_k);
    SAME(base_interreflection);
    SAME(thin_slab);
    SAME(priority);
    SAME(medium);
    SAME(medium_outside);
    SAME(mix_material);
    SAME(mix_amount);
    SAME_SLOT(mix_texture);
#undef SAME_SLOT
}

static void assert_motion_equal(const struct scene *a, const struct scene *b)
{
    assert_int_equal(a->node_count, b->node_count);
    for (uint32_t i = 0; i < a->node_count; i++) {
        const struct scene_node *x = &a->nodes[i], *y = &b->nodes[i];
        SAME(parent);
        SAME(has_matrix);
        SAME(matrix);
        SAME(translation);
        SAME(rotation);
        SAME(scale);
        SAME(weight_count);
        assert_memory_equal(x->weights, y->weights, x->weight_count * sizeof(float));
    }
    assert_int_equal(a->channel_count, b->channel_count);
    for (uint32_t i = 0; i < a->channel_count; i++) {
        const struct scene_channel *x = &a->channels[i], *y = &b->channels[i];
        SAME(node);
        SAME(path);
        SAME(interpolation);
        SAME(key_count);
        SAME(components);
        assert_memory_equal(x->times, y->times, x->key_count * sizeof(float));
        assert_memory_equal(x->values, y->values, scene_channel_floats(x) * sizeof(float));
    }
    assert_int_equal(a->skin_count, b->skin_count);
    for (uint32_t i = 0; i < a->skin_count; i++) {
        const struct scene_skin *x = &a->skins[i], *y = &b->skins[i];
        SAME(joint_count);
        assert_memory_equal(x->joints, y->joints, x->joint_count * sizeof(uint32_t));
        assert_memory_equal(x->inverse_bind, y->inverse_bind, x->joint_count * sizeof *x->inverse_bind);
    }
}

static void assert_media_equal(const struct scene *a, const struct scene *b)
{
    assert_int_equal(a->medium_count, b->medium_count);
    for (uint32_t i = 0; i < a->medium_count; i++) {
        const struct scene_medium *x = &a->media[i], *y = &b->media[i];
        assert_string_equal(x->name, y->name);
        SAME(absorption);
        SAME(scattering);
        SAME(emission);
        SAME(g);
        SAME(has_grid);
        SAME(grid.digest);
        SAME(grid.size_bytes);
        SAME(grid_size);
        SAME(grid_to_world);
    }
    assert_int_equal(a->fog, b->fog);
    assert_memory_equal(a->origin, b->origin, sizeof a->origin);
    assert_int_equal(a->volume_rule, b->volume_rule);
}

static void assert_environment_equal(const struct scene_environment *x, const struct scene_environment *y)
{
    SAME(present);
    SAME(constant);
    if (x->present) {
        assert_string_equal(x->image.name, y->image.name);
        SAME(image.blob.digest);
        SAME(image.blob.size_bytes);
        SAME(radiance);
        SAME(brightest);
        SAME(to_map);
    }
    assert_int_equal(x->portal_count, y->portal_count);
    assert_memory_equal(x->portals, y->portals, x->portal_count * sizeof *x->portals);
}

/* Field by field: what packs must come out as it went in. */
static void assert_scene_equal(const struct scene *a, const struct scene *b)
{
    assert_string_equal(a->name, b->name);
    assert_int_equal(a->mesh_count, b->mesh_count);
    for (uint32_t i = 0; i < a->mesh_count; i++) {
        const struct scene_mesh *x = &a->meshes[i], *y = &b->meshes[i];
        assert_string_equal(x->name, y->name);
        assert_true(digest_equal(&x->blob.digest, &y->blob.digest));
        assert_int_equal(x->blob.size_bytes, y->blob.size_bytes);
        assert_int_equal(x->vertex_count, y->vertex_count);
        assert_int_equal(x->triangle_count, y->triangle_count);
        assert_int_equal(x->arrays, y->arrays);
        assert_memory_equal(x->bounds_min, y->bounds_min, sizeof x->bounds_min);
        assert_memory_equal(x->bounds_max, y->bounds_max, sizeof x->bounds_max);
        assert_int_equal(x->closed, y->closed);
        SAME(morph_count);
    }
    assert_int_equal(a->image_count, b->image_count);
    for (uint32_t i = 0; i < a->image_count; i++) {
        assert_string_equal(a->images[i].name, b->images[i].name);
        assert_true(digest_equal(&a->images[i].blob.digest, &b->images[i].blob.digest));
        assert_int_equal(a->images[i].blob.size_bytes, b->images[i].blob.size_bytes);
    }
    assert_int_equal(a->texture_count, b->texture_count);
    assert_memory_equal(a->textures, b->textures, a->texture_count * sizeof *a->textures);
    assert_int_equal(a->material_count, b->material_count);
    for (uint32_t i = 0; i < a->material_count; i++) {
        const struct scene_material *x = &a->materials[i], *y = &b->materials[i];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->unlit, y->unlit);
        assert_int_equal(x->double_sided, y->double_sided);
        assert_int_equal(x->alpha_mode, y->alpha_mode);
        assert_true(x->alpha_cutoff == y->alpha_cutoff);
        assert_memory_equal(x->base_color, y->base_color, sizeof x->base_color);
        assert_slot_equal(&x->base_color_texture, &y->base_color_texture);
        assert_true(x->metallic == y->metallic && x->roughness == y->roughness);
        assert_slot_equal(&x->metallic_roughness_texture, &y->metallic_roughness_texture);
        assert_true(x->normal_scale == y->normal_scale);
        assert_slot_equal(&x->normal_texture, &y->normal_texture);
        assert_memory_equal(x->emission, y->emission, sizeof x->emission);
        assert_slot_equal(&x->emission_texture, &y->emission_texture);
        assert_true(x->ior == y->ior && x->specular == y->specular);
        assert_slot_equal(&x->specular_texture, &y->specular_texture);
        assert_memory_equal(x->specular_color, y->specular_color, sizeof x->specular_color);
        assert_slot_equal(&x->specular_color_texture, &y->specular_color_texture);
        assert_true(x->transmission == y->transmission);
        assert_slot_equal(&x->transmission_texture, &y->transmission_texture);
        assert_int_equal(x->refractive, y->refractive);
        assert_memory_equal(x->attenuation_color, y->attenuation_color, sizeof x->attenuation_color);
        assert_true(x->attenuation_distance == y->attenuation_distance);
        assert_layers_equal(x, y);
    }
    assert_int_equal(a->instance_count, b->instance_count);
    for (uint32_t i = 0; i < a->instance_count; i++) {
        assert_string_equal(a->instances[i].name, b->instances[i].name);
        assert_string_equal(a->instances[i].asset, b->instances[i].asset);
        assert_int_equal(a->instances[i].mesh, b->instances[i].mesh);
        assert_int_equal(a->instances[i].material, b->instances[i].material);
        assert_memory_equal(&a->instances[i].to_world, &b->instances[i].to_world, sizeof a->instances[i].to_world);
        assert_int_equal(a->instances[i].node, b->instances[i].node);
        assert_int_equal(a->instances[i].skin, b->instances[i].skin);
        assert_int_equal(a->instances[i].body, b->instances[i].body);
        assert_int_equal(a->instances[i].sealed, b->instances[i].sealed);
    }
    assert_int_equal(a->light_count, b->light_count);
    for (uint32_t i = 0; i < a->light_count; i++) {
        const struct scene_light *x = &a->lights[i], *y = &b->lights[i];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->kind, y->kind);
        assert_memory_equal(x->position, y->position, sizeof x->position);
        assert_memory_equal(x->direction, y->direction, sizeof x->direction);
        assert_memory_equal(x->intensity, y->intensity, sizeof x->intensity);
        assert_true(x->range == y->range && x->inner_cone_rad == y->inner_cone_rad &&
                    x->outer_cone_rad == y->outer_cone_rad);
        SAME(falloff);
        SAME(image);
        SAME(to_world);
        SAME(projection_yfov_rad);
        SAME(projection_aspect);
        SAME(node);
    }
    assert_int_equal(a->camera_count, b->camera_count);
    for (uint32_t i = 0; i < a->camera_count; i++) {
        const struct scene_camera *x = &a->cameras[i], *y = &b->cameras[i];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->kind, y->kind);
        assert_memory_equal(&x->to_world, &y->to_world, sizeof x->to_world);
        assert_true(x->yfov_rad == y->yfov_rad && x->xmag == y->xmag && x->ymag == y->ymag && x->aspect == y->aspect);
        SAME(lens_radius);
        SAME(focus_distance);
        SAME(blades);
        SAME(blade_rotation_rad);
        SAME(shutter_open_s);
        SAME(shutter_close_s);
        SAME(exposure_ev);
        SAME(node);
    }
    assert_environment_equal(&a->environment, &b->environment);
    assert_motion_equal(a, b);
    assert_media_equal(a, b);
}
#undef SAME

static void check_round_trip(struct scene *scene)
{
    struct buffer first = BUFFER_INIT, second = BUFFER_INIT;
    struct scene copy;
    struct error err = {0};

    pack(scene, &first);
    assert_int_equal(scene_unpack(&copy, first.data, first.size, &err), STATUS_OK);
    assert_scene_equal(scene, &copy);
    pack(&copy, &second);
    assert_int_equal(first.size, second.size);
    assert_memory_equal(first.data, second.data, first.size);
    scene_release(&copy);
    buffer_release(&second);
    buffer_release(&first);
}

static void test_round_trip(void **state)
{
    struct scene scene;

    (void)state;
    scene_sample(&scene);
    check_round_trip(&scene);
    scene.instances[1].asset = "set";
    scene.environment.brightest = 3;
    check_round_trip(&scene);
    scene_environment_default(&scene.environment);
    scene.environment.present = scene.environment.constant = 1;
    scene.environment.radiance[0] = 0;
    scene.environment.image.name = "";
    check_round_trip(&scene);
    scene.environment.present = scene.environment.constant = 0;
    check_round_trip(&scene);
    scene.mesh_count = scene.image_count = scene.texture_count = scene.material_count = scene.instance_count =
        scene.light_count = scene.node_count = scene.channel_count = scene.skin_count = scene.medium_count = 0;
    scene.fog = scene.cameras[0].node = -1;
    check_round_trip(&scene);
    scene_release(&scene);
}

/* The sample as the first release with this version of the wire form packed it: scenes that are
 * stored somewhere still load, and the same scene keeps its digest. */
static void test_packed_earlier(void **state)
{
    struct buffer stored = BUFFER_INIT, packed = BUFFER_INIT;
    FILE *file = fopen("tests/unit/scene/scene-version-3.hex", "r");
    struct scene scene, copy;
    struct error err = {0};
    unsigned byte;

    (void)state;
    assert_non_null(file);
    while (fscanf(file, "%2x", &byte) == 1)
        buffer_append(&stored, &(uint8_t){(uint8_t)byte}, 1);
    fclose(file);
    assert_true(buffer_ok(&stored) && stored.size > 4000);
    scene_sample(&scene);
    if (scene_unpack(&copy, stored.data, stored.size, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_scene_equal(&scene, &copy);
    pack(&scene, &packed);
    assert_int_equal(packed.size, stored.size);
    assert_memory_equal(packed.data, stored.data, stored.size);
    scene_release(&scene);
    scene_release(&copy);
    buffer_release(&packed);
    buffer_release(&stored);
}

/* What is not called for takes no bytes, whatever its value. */
static void test_defaults_take_no_bytes(void **state)
{
    struct buffer plain = BUFFER_INIT, same = BUFFER_INIT, more = BUFFER_INIT;
    struct scene_material material;
    struct scene_light light;
    struct scene_camera camera;
    struct scene scene;

    (void)state;
    scene_init(&scene);
    scene_material_default(&material);
    scene_light_default(&light);
    scene_camera_default(&camera);
    scene.materials = &material;
    scene.lights = &light;
    scene.cameras = &camera;
    scene.material_count = scene.light_count = scene.camera_count = 1;
    pack(&scene, &plain);
    assert_true(plain.size < 320);
    material.clearcoat_texture.uv_set = 1; /* of a slot without a texture: means nothing */
    material.anisotropy = -0.0f;           /* is 0 */
    light.to_world.m[0][1] = -0.0f;
    pack(&scene, &same);
    assert_int_equal(plain.size, same.size);
    assert_memory_equal(plain.data, same.data, plain.size);
    material.clearcoat = 0.5f;
    pack(&scene, &more);
    assert_true(more.size > plain.size);
    buffer_release(&plain);
    buffer_release(&same);
    buffer_release(&more);
    scene_release(&scene);
}

/* A copy of the sample with one field spoiled must be refused, and the message must name
 * the table. */
#define REFUSE(table_name, statement)                                                \
    do {                                                                             \
        struct scene s;                                                              \
        struct error err = {0};                                                      \
        struct buffer out = BUFFER_INIT;                                             \
        scene_sample(&s);                                                            \
        statement;                                                                   \
        if (scene_validate(&s, &err) == STATUS_OK)                                   \
            fail_msg("accepted: %s", #statement);                                    \
        if (!strstr(err.text, table_name))                                           \
            fail_msg("%s: \"%s\" does not name %s", #statement, err.text, table_name); \
        assert_true(err.code == STATUS_ERR_INPUT || err.code == STATUS_ERR_LIMIT);   \
        assert_int_not_equal(scene_pack(&s, &out, NULL), STATUS_OK);                 \
        buffer_release(&out);                                                        \
        scene_release(&s);                                                           \
    } while (0)

#define REFUSE_NUMBER(table_name, field)          \
    do {                                          \
        REFUSE(table_name, s.field = NAN);        \
        REFUSE(table_name, s.field = INFINITY);   \
        REFUSE(table_name, s.field = -INFINITY);  \
    } while (0)

static void test_refuses_meshes(void **state)
{
    (void)state;
    REFUSE("meshes", s.mesh_count = SCENE_MESHES_MAX + 1u);
    REFUSE("meshes[0].name", s.meshes[0].name = NULL);
    REFUSE("meshes[1].blob", s.meshes[1].blob.size_bytes++);
    REFUSE("meshes[1].blob", s.meshes[1].blob.size_bytes = 0);
    REFUSE("meshes[0]", s.meshes[0].blob.size_bytes = UINT64_MAX);
    REFUSE("meshes[0]", s.meshes[0].vertex_count = 2);
    REFUSE("meshes[0]", s.meshes[0].vertex_count = UINT32_MAX);
    REFUSE("meshes[0]", s.meshes[0].vertex_count++);
    REFUSE("meshes[0]", s.meshes[0].triangle_count = 0);
    REFUSE("meshes[0]", s.meshes[0].triangle_count = UINT32_MAX);
    REFUSE("meshes[0]", s.meshes[0].arrays = 128);
    REFUSE("meshes[0]", s.meshes[0].arrays = MESH_UV0);
    for (int i = 0; i < 3; i++) {
        REFUSE_NUMBER("meshes[0].bounds_min", meshes[0].bounds_min[i]);
        REFUSE_NUMBER("meshes[0].bounds_max", meshes[0].bounds_max[i]);
        REFUSE("meshes[0].bounds_min", s.meshes[0].bounds_min[i] = 100);
        REFUSE("meshes[0].bounds_max", s.meshes[0].bounds_max[i] = 2e15f);
    }
    REFUSE("meshes[0].closed", s.meshes[0].closed = 2);
    REFUSE("meshes[0].morph_count", s.meshes[0].morph_count = SCENE_MORPHS_MAX + 1u);
    REFUSE("meshes[0].blob", s.meshes[0].morph_count++);
}

static void test_refuses_pictures(void **state)
{
    (void)state;
    REFUSE("images", s.image_count = SCENE_IMAGES_MAX + 1u);
    REFUSE("textures", s.texture_count = SCENE_TEXTURES_MAX + 1u);
    REFUSE("images[1].blob", s.images[1].blob.size_bytes = 0);
    REFUSE("images[0].name", s.images[0].name = "a\x1b[2J");
    REFUSE("images[0].name", s.images[0].name = "\xff");
    REFUSE("images[0].name", s.images[0].name = "\xc0\xaf");
    REFUSE("images[0].name", s.images[0].name = "\xed\xa0\x80");
    REFUSE("images[0].name", s.images[0].name = "\xc2\x9b");
    REFUSE("images[0].name", s.images[0].name = "\xe2\x82");
    REFUSE("textures[1].image", s.textures[1].image = 2);
    REFUSE("textures[0].wrap_u", s.textures[0].wrap_u = WRAP_COUNT);
    REFUSE("textures[0].wrap_v", s.textures[0].wrap_v = (enum scene_wrap) - 1);
    REFUSE("textures[0].nearest", s.textures[0].nearest = -1);
    REFUSE("textures[0].encoding", s.textures[0].encoding = ENCODING_COUNT);
}

static void test_refuses_materials(void **state)
{
    static const size_t slots[] = {
        offsetof(struct scene_material, base_color_texture),
        offsetof(struct scene_material, metallic_roughness_texture),
        offsetof(struct scene_material, normal_texture),
        offsetof(struct scene_material, emission_texture),
        offsetof(struct scene_material, specular_texture),
        offsetof(struct scene_material, specular_color_texture),
        offsetof(struct scene_material, transmission_texture),
        offsetof(struct scene_material, anisotropy_texture),
        offsetof(struct scene_material, clearcoat_texture),
        offsetof(struct scene_material, clearcoat_roughness_texture),
        offsetof(struct scene_material, clearcoat_normal_texture),
        offsetof(struct scene_material, sheen_color_texture),
        offsetof(struct scene_material, sheen_roughness_texture),
        offsetof(struct scene_material, iridescence_texture),
        offsetof(struct scene_material, iridescence_thickness_texture),
        offsetof(struct scene_material, diffuse_transmission_texture),
        offsetof(struct scene_material, diffuse_transmission_color_texture),
        offsetof(struct scene_material, mix_texture),
    };

    (void)state;
    REFUSE("materials", s.material_count = SCENE_MATERIALS_MAX + 1u);
    REFUSE("materials[0].unlit", s.materials[0].unlit = 3);
    REFUSE("materials[0].double_sided", s.materials[0].double_sided = -1);
    REFUSE("materials[0].refractive", s.materials[0].refractive = 2);
    REFUSE("materials[0].alpha_mode", s.materials[0].alpha_mode = ALPHA_COUNT);
    REFUSE_NUMBER("materials[0].alpha_cutoff", materials[0].alpha_cutoff);
    REFUSE("materials[0].alpha_cutoff", s.materials[0].alpha_cutoff = -0.1f);
    for (int i = 0; i < 4; i++) {
        REFUSE_NUMBER("materials[0].base_color", materials[0].base_color[i]);
        REFUSE("materials[0].base_color", s.materials[0].base_color[i] = 1.01f);
        REFUSE("materials[0].base_color", s.materials[0].base_color[i] = -0.01f);
    }
    REFUSE_NUMBER("materials[0].metallic", materials[0].metallic);
    REFUSE("materials[0].metallic", s.materials[0].metallic = 1.5f);
    REFUSE_NUMBER("materials[0].roughness", materials[0].roughness);
    REFUSE("materials[0].roughness", s.materials[0].roughness = -1);
    REFUSE_NUMBER("materials[0].normal_scale", materials[0].normal_scale);
    REFUSE_NUMBER("materials[0].ior", materials[0].ior);
    /* Below 1 only where it is that of what is around. */
    REFUSE("materials[0].ior", (s.volume_rule = VOLUMES_NESTED, s.materials[0].ior = 0.76f));
    REFUSE("materials[0].ior", s.materials[0].ior = 1e-4f);
    REFUSE("materials[0].ior", s.materials[0].ior = -1);
    REFUSE_NUMBER("materials[0].specular", materials[0].specular);
    REFUSE("materials[0].specular", s.materials[0].specular = 2);
    REFUSE_NUMBER("materials[0].transmission", materials[0].transmission);
    REFUSE("materials[0].transmission", s.materials[0].transmission = -2);
    for (int i = 0; i < 3; i++) {
        REFUSE_NUMBER("materials[0].emission", materials[0].emission[i]);
        REFUSE("materials[0].emission", s.materials[0].emission[i] = -1);
        REFUSE_NUMBER("materials[0].specular_color", materials[0].specular_color[i]);
        REFUSE("materials[0].specular_color", s.materials[0].specular_color[i] = -1);
        REFUSE_NUMBER("materials[0].attenuation_color", materials[0].attenuation_color[i]);
        REFUSE("materials[0].attenuation_color", s.materials[0].attenuation_color[i] = 1.1f);
    }
    REFUSE("materials[0].attenuation_distance", s.materials[0].attenuation_distance = 0);
    REFUSE("materials[0].attenuation_distance", s.materials[0].attenuation_distance = -1);
    REFUSE("materials[0].attenuation_distance", s.materials[0].attenuation_distance = NAN);
    for (size_t i = 0; i < sizeof slots / sizeof *slots; i++) {
#define SLOT ((struct scene_texture_slot *)((char *)&s.materials[0] + slots[i]))
        REFUSE("materials[0]", SLOT->texture = 2);
        REFUSE("materials[0]", SLOT->texture = -2);
        REFUSE("materials[0]", SLOT->texture = INT32_MIN);
        REFUSE("materials[0]", SLOT->uv_set = 2);
        REFUSE("materials[0]", SLOT->uv_transform[1][2] = NAN);
        REFUSE("materials[0]", SLOT->uv_transform[0][0] = INFINITY);
#undef SLOT
    }
}

/* Every number of a layer or kind, its range, and something outside. */
static void test_refuses_layers(void **state)
{
    (void)state;
#define OUTSIDE(field, low, high)                                     \
    do {                                                              \
        REFUSE_NUMBER("materials[0]." #field, materials[0].field);    \
        REFUSE("materials[0]." #field, s.materials[0].field = (low)); \
        REFUSE("materials[0]." #field, s.materials[0].field = (high)); \
    } while (0)
#define OUTSIDE_RGB(field, low, high)                                          \
    for (int i = 0; i < 3; i++) {                                              \
        REFUSE("materials[0]." #field, s.materials[0].field[i] = NAN);         \
        REFUSE("materials[0]." #field, s.materials[0].field[i] = (low));       \
        REFUSE("materials[0]." #field, s.materials[0].field[i] = (high));      \
    }
    OUTSIDE(anisotropy, -0.1f, 1.1f);
    OUTSIDE(anisotropy_rotation_rad, -1e6f, 1e6f);
    OUTSIDE(clearcoat, -0.1f, 1.1f);
    OUTSIDE(clearcoat_roughness, -0.1f, 1.1f);
    OUTSIDE(clearcoat_ior, 0.9f, 1e7f);
    OUTSIDE(clearcoat_normal_scale, -1e7f, 1e7f);
    OUTSIDE_RGB(sheen_color, -0.1f, 1.1f)
    OUTSIDE(sheen_roughness, -0.1f, 1.1f);
    OUTSIDE(iridescence, -0.1f, 1.1f);
    OUTSIDE(iridescence_ior, 0, 1e7f);
    OUTSIDE(iridescence_thickness_min_nm, -1, 1e10f);
    OUTSIDE(iridescence_thickness_max_nm, -1, 1e10f);
    OUTSIDE(diffuse_transmission, -0.1f, 1.1f);
    OUTSIDE_RGB(diffuse_transmission_color, -0.1f, 1.1f)
    OUTSIDE(dispersion, -0.1f, 1e7f);
    OUTSIDE_RGB(conductor_eta, 0, 1e7f)
    OUTSIDE_RGB(conductor_k, -0.1f, 1e7f)
    OUTSIDE(base_interreflection, -0.1f, 1);
    OUTSIDE(mix_amount, -0.1f, 1.1f);
#undef OUTSIDE_RGB
#undef OUTSIDE
    REFUSE("materials[0].kind", s.materials[0].kind = MATERIAL_KIND_COUNT);
    REFUSE("materials[0].thin_slab", s.materials[0].thin_slab = 2);
    REFUSE("materials[0].priority", s.materials[0].priority = SCENE_PRIORITY_MAX + 1);
    REFUSE("materials[0].priority", s.materials[0].priority = INT32_MIN);
    REFUSE("materials[0].medium", s.materials[0].medium = 2);
    REFUSE("materials[0].medium", s.materials[0].medium = -2);
    REFUSE("materials[0].medium_outside", s.materials[0].medium_outside = 2);
    REFUSE("materials[0].mix_material", s.materials[0].kind = MATERIAL_MIX);
    REFUSE("materials[2].mix_material", s.materials[2].mix_material[0] = 2);
    REFUSE("materials[2].mix_material", s.materials[2].mix_material[1] = UINT32_MAX);
}

static void test_refuses_motion(void **state)
{
    (void)state;
    REFUSE("nodes", s.node_count = SCENE_NODES_MAX + 1u);
    REFUSE("nodes[1].parent", s.nodes[1].parent = 1);
    REFUSE("nodes[1].parent", s.nodes[1].parent = 2);
    REFUSE("nodes[0].parent", s.nodes[0].parent = -2);
    REFUSE("nodes[0].has_matrix", s.nodes[0].has_matrix = 2);
    REFUSE_NUMBER("nodes[0].matrix", nodes[0].matrix.m[2][3]);
    REFUSE_NUMBER("nodes[1].translation", nodes[1].translation[1]);
    REFUSE_NUMBER("nodes[1].rotation", nodes[1].rotation[3]);
    REFUSE("nodes[1].rotation", memset(s.nodes[1].rotation, 0, sizeof s.nodes[1].rotation));
    REFUSE_NUMBER("nodes[1].scale", nodes[1].scale[2]);
    REFUSE("nodes[1].weight_count", s.nodes[1].weight_count = SCENE_MORPHS_MAX + 1u);
    REFUSE_NUMBER("nodes[1].weights", nodes[1].weights[1]);

    REFUSE("channels", s.channel_count = SCENE_CHANNELS_MAX + 1u);
    REFUSE("channels[4].node", s.channels[4].node = 3);
    REFUSE("channels[4].node", s.channels[4].node = 0);
    REFUSE("channels[1].node", s.channels[1].path = PATH_TRANSLATION);
    REFUSE("channels[0].path", s.channels[0].path = PATH_COUNT);
    REFUSE("channels[0].path", s.channels[0].node = 0);
    REFUSE("channels[0].interpolation", s.channels[0].interpolation = INTERPOLATE_COUNT);
    REFUSE("channels[0].components", s.channels[0].components = 4);
    REFUSE("channels[1].components", s.channels[1].components = 3);
    REFUSE("channels[3].components", s.channels[3].components = 1);
    REFUSE("channels[3].components", s.nodes[1].weight_count = 1);
    REFUSE("channels[3].components", s.nodes[1].weight_count = s.channels[3].components = 0);
    REFUSE("channels[0].key_count", s.channels[0].key_count = 0);
    REFUSE("channels[0].key_count", s.channels[0].key_count = SCENE_KEYS_MAX + 1u);
    REFUSE_NUMBER("channels[0].times", channels[0].times[0]);
    REFUSE("channels[0].times", s.channels[0].times[1] = s.channels[0].times[0]);
    REFUSE("channels[0].times", s.channels[0].times[2] = 0);
    REFUSE_NUMBER("channels[0].values", channels[0].values[8]);
    REFUSE_NUMBER("channels[1].values", channels[1].values[35]);
    REFUSE("channels[1].values", memset(s.channels[1].values + 16, 0, 16)); /* key 1's value */
    REFUSE("channels[4].values", memset(s.channels[4].values + 8, 0, 16));
    REFUSE("channels[3].values", s.channels[3].values[0] = 1e7f);

    REFUSE("skins", s.skin_count = SCENE_SKINS_MAX + 1u);
    REFUSE("skins[0].joint_count", s.skins[0].joint_count = 0);
    REFUSE("skins[0].joint_count", s.skins[0].joint_count = SCENE_JOINTS_MAX + 1u);
    REFUSE("skins[0].joints", s.skins[0].joints[1] = 3);
    REFUSE_NUMBER("skins[0].inverse_bind", skins[0].inverse_bind[1].m[0][3]);

    REFUSE("instances[2].node", s.instances[2].node = 3);
    REFUSE("instances[2].node", s.instances[2].node = -2);
    REFUSE("instances[2].skin", s.instances[2].skin = 1);
    REFUSE("instances[1].skin", s.instances[1].skin = 0); /* its mesh has no joints */
    REFUSE("instances[2].node", (s.nodes[1].weight_count = 1, s.channel_count = 0));
    REFUSE("lights[1].node", s.lights[1].node = 3);
    REFUSE("cameras[0].node", s.cameras[0].node = -3);
}

/* A thing that is hidden by a scale of 0 at first is no mistake. */
static void test_hidden_at_first(void **state)
{
    struct error err = {0};
    struct scene s;

    (void)state;
    scene_sample(&s);
    memset(&s.instances[1].to_world, 0, sizeof s.instances[1].to_world);
    assert_int_equal(scene_validate(&s, &err), STATUS_OK);
    s.instances[1].node = -1;
    assert_int_equal(scene_validate(&s, &err), STATUS_ERR_INPUT);
    scene_release(&s);
}

static void test_refuses_media(void **state)
{
    (void)state;
    REFUSE("media", s.medium_count = SCENE_MEDIA_MAX + 1u);
    for (int i = 0; i < 3; i++) {
        REFUSE_NUMBER("media[0].absorption", media[0].absorption[i]);
        REFUSE("media[0].absorption", s.media[0].absorption[i] = -1);
        REFUSE_NUMBER("media[0].scattering", media[0].scattering[i]);
        REFUSE("media[0].scattering", s.media[0].scattering[i] = -1);
        REFUSE_NUMBER("media[0].emission", media[0].emission[i]);
        REFUSE("media[0].emission", s.media[0].emission[i] = -1);
        REFUSE("media[1].grid_size", s.media[1].grid_size[i] = 0);
        REFUSE("media[1].grid_size", s.media[1].grid_size[i] = SCENE_GRID_SIDE_MAX + 1u);
        REFUSE("media[1].grid ", s.media[1].grid_size[i]++);
    }
    REFUSE_NUMBER("media[0].g", media[0].g);
    REFUSE("media[0].g", s.media[0].g = 1);
    REFUSE("media[0].g", s.media[0].g = -1);
    REFUSE("media[0].has_grid", s.media[0].has_grid = 2);
    REFUSE("media[1].name", s.media[1].name = NULL);
    REFUSE("media[1].blob", s.media[1].grid.size_bytes = 0);
    REFUSE_NUMBER("media[1].grid_to_world", media[1].grid_to_world.m[0][0]);
    REFUSE("media[1].grid_to_world", s.media[1].grid_to_world.m[0][0] = 0);
    REFUSE("fog", s.fog = 2);
    REFUSE("fog", s.fog = -2);
    REFUSE("volume_rule", s.volume_rule = VOLUME_RULE_COUNT);
}

static void test_refuses_instances(void **state)
{
    (void)state;
    REFUSE("instances", s.instance_count = SCENE_INSTANCES_MAX + 1u);
    REFUSE("instances[2].mesh", s.instances[2].mesh = 2);
    REFUSE("instances[2].material", s.instances[2].material = 3);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            REFUSE_NUMBER("instances[1].to_world", instances[1].to_world.m[r][c]);
    REFUSE("instances[0].to_world", s.instances[0].to_world.m[1][1] = 0);
    REFUSE("instances[1].to_world", s.instances[1].to_world.m[0][0] = 3e15f);
    REFUSE("instances[1].to_world", s.instances[1].to_world.m[0][3] = 3e15f);
}

static void test_refuses_lights(void **state)
{
    (void)state;
    REFUSE("lights", s.light_count = SCENE_LIGHTS_MAX + 1u);
    REFUSE("lights[0].kind", s.lights[0].kind = LIGHT_KIND_COUNT);
    for (int i = 0; i < 3; i++) {
        REFUSE_NUMBER("lights[0].position", lights[0].position[i]);
        REFUSE_NUMBER("lights[0].direction", lights[0].direction[i]);
        REFUSE_NUMBER("lights[0].intensity", lights[0].intensity[i]);
        REFUSE("lights[0].intensity", s.lights[0].intensity[i] = -1);
    }
    REFUSE("lights[2].direction", s.lights[2].direction[1] = 0);
    REFUSE_NUMBER("lights[0].range", lights[0].range);
    REFUSE("lights[0].range", s.lights[0].range = -1);
    REFUSE_NUMBER("lights[1].inner_cone_rad", lights[1].inner_cone_rad);
    REFUSE_NUMBER("lights[1].outer_cone_rad", lights[1].outer_cone_rad);
    REFUSE("lights[1].inner_cone_rad", s.lights[1].inner_cone_rad = 0.5f);
    REFUSE("lights[1].outer_cone_rad", s.lights[1].outer_cone_rad = 2);
    REFUSE("lights[1].falloff", s.lights[1].falloff = FALLOFF_COUNT);
    REFUSE("lights[3].image", s.lights[3].image = 2);
    REFUSE("lights[3].image", s.lights[3].image = -2);
    REFUSE_NUMBER("lights[3].to_world", lights[3].to_world.m[1][1]);
    REFUSE("lights[3].to_world", s.lights[3].to_world.m[1][1] = 1.1f);
    REFUSE_NUMBER("lights[4].projection_yfov_rad", lights[4].projection_yfov_rad);
    REFUSE("lights[4].projection_yfov_rad", s.lights[4].projection_yfov_rad = 0);
    REFUSE("lights[4].projection_yfov_rad", s.lights[4].projection_yfov_rad = 3.15f);
    REFUSE_NUMBER("lights[4].projection_aspect", lights[4].projection_aspect);
    REFUSE("lights[4].projection_aspect", s.lights[4].projection_aspect = 0);
}

static void test_refuses_cameras(void **state)
{
    (void)state;
    REFUSE("camera", s.camera_count = 0);
    REFUSE("cameras", s.camera_count = SCENE_CAMERAS_MAX + 1u);
    REFUSE("cameras[0].kind", s.cameras[0].kind = CAMERA_KIND_COUNT);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            REFUSE_NUMBER("cameras[0].to_world", cameras[0].to_world.m[r][c]);
    REFUSE("cameras[0].to_world", s.cameras[0].to_world.m[0][0] = 1.1f);
    REFUSE("cameras[0].to_world", s.cameras[0].to_world.m[0][0] = -1);
    REFUSE("cameras[0].to_world", s.cameras[0].to_world.m[0][1] = 0.1f);
    REFUSE_NUMBER("cameras[0].yfov_rad", cameras[0].yfov_rad);
    REFUSE("cameras[0].yfov_rad", s.cameras[0].yfov_rad = 0);
    REFUSE("cameras[0].yfov_rad", s.cameras[0].yfov_rad = 3.15f);
    REFUSE("cameras[1].xmag", s.cameras[1].xmag = 0);
    REFUSE_NUMBER("cameras[1].xmag", cameras[1].xmag);
    REFUSE("cameras[1].ymag", s.cameras[1].ymag = -1);
    REFUSE_NUMBER("cameras[1].ymag", cameras[1].ymag);
    REFUSE_NUMBER("cameras[0].aspect", cameras[0].aspect);
    REFUSE("cameras[0].aspect", s.cameras[0].aspect = -1);
    REFUSE_NUMBER("cameras[0].lens_radius", cameras[0].lens_radius);
    REFUSE("cameras[0].lens_radius", s.cameras[0].lens_radius = -1);
    REFUSE_NUMBER("cameras[0].focus_distance", cameras[0].focus_distance);
    REFUSE("cameras[0].focus_distance", s.cameras[0].focus_distance = 0);
    REFUSE("cameras[0].blades", s.cameras[0].blades = SCENE_BLADES_MAX + 1u);
    REFUSE_NUMBER("cameras[0].blade_rotation_rad", cameras[0].blade_rotation_rad);
    REFUSE_NUMBER("cameras[0].shutter_open_s", cameras[0].shutter_open_s);
    REFUSE_NUMBER("cameras[0].shutter_close_s", cameras[0].shutter_close_s);
    REFUSE("cameras[0].shutter_close_s", s.cameras[0].shutter_open_s = 0.75f);
    REFUSE_NUMBER("cameras[0].exposure_ev", cameras[0].exposure_ev);
}

static void test_refuses_environment(void **state)
{
    static char long_name[SCENE_NAME_MAX + 2];

    (void)state;
    memset(long_name, 'a', sizeof long_name - 1);
    REFUSE("environment", s.environment.present = 2);
    REFUSE("environment", s.environment.constant = 2);
    REFUSE("environment", s.environment.image.blob.size_bytes = 0);
    REFUSE("environment", s.environment.image.name = long_name);
    REFUSE("environment", (s.environment.constant = 1, s.environment.radiance[1] = -1));
    REFUSE("environment", (s.environment.constant = 1, s.environment.radiance[2] = NAN));
    REFUSE("environment", s.environment.radiance[0] = -1);
    REFUSE("environment[0].brightest", s.environment.brightest = -1);
    REFUSE("environment[0].brightest", s.environment.brightest = 2e30f);
    REFUSE("environment[0].brightest", s.environment.brightest = NAN);
    REFUSE("environment[0].to_map", s.environment.to_map[0][2] = NAN);
    REFUSE("environment[0].to_map", s.environment.to_map[0][2] = 1.1f);
    REFUSE("environment[0].to_map", s.environment.to_map[0][2] = -1); /* mirrors */
    REFUSE("portals", s.environment.portal_count = SCENE_PORTALS_MAX + 1u);
    REFUSE_NUMBER("portals[1].corner", environment.portals[1].corner[0]);
    REFUSE_NUMBER("portals[1].edge1", environment.portals[1].edge1[0]);
    REFUSE_NUMBER("portals[1].edge2", environment.portals[1].edge2[0]);
    REFUSE("portals[0].edge1", s.environment.portals[0].edge1[0] = 0);
    REFUSE("portals[0].edge1", (s.environment.portals[0].edge2[0] = 5, s.environment.portals[0].edge2[2] = 0));
    REFUSE("name", s.name = long_name);
}

static void test_truncations(void **state)
{
    struct buffer packed = BUFFER_INIT;
    struct scene scene, copy;

    (void)state;
    scene_sample(&scene);
    pack(&scene, &packed);
    for (size_t size = 0; size < packed.size; size++) {
        struct error err = {0};
        /* Exactly as large as claimed: a sanitizer sees a read past the end. */
        uint8_t *cut = mem_memdup(packed.data, size);
        status result = scene_unpack(&copy, cut, size, &err);
        /* A cut between two elements is a shorter scene; where nothing refers to what is
         * missing it is a valid one. Everything else must be told. */
        if (result == STATUS_OK) {
            struct buffer again = BUFFER_INIT;
            pack(&copy, &again);
            assert_int_equal(again.size, size);
            buffer_release(&again);
        } else {
            assert_int_equal(err.code, result);
            assert_true(err.text[0] != 0);
            assert_int_equal(copy.mesh_count, 0);
            assert_null(copy.meshes);
        }
        scene_release(&copy);
        mem_free(cut);
    }
    buffer_release(&packed);
    scene_release(&scene);
}

/* Every byte changed in every bit: never a crash, and what is accepted is valid. */
static void test_bit_flips(void **state)
{
    struct buffer packed = BUFFER_INIT;
    struct scene scene, copy;
    size_t refused = 0;

    (void)state;
    scene_sample(&scene);
    pack(&scene, &packed);
    for (size_t i = 0; i < packed.size * 8; i++) {
        packed.data[i / 8] ^= (uint8_t)(1 << i % 8);
        if (scene_unpack(&copy, packed.data, packed.size, NULL) == STATUS_OK)
            assert_int_equal(scene_validate(&copy, NULL), STATUS_OK);
        else
            refused++;
        scene_release(&copy);
        packed.data[i / 8] ^= (uint8_t)(1 << i % 8);
    }
    assert_true(refused > packed.size); /* of 8 flips a byte: structure is checked */
    buffer_release(&packed);
    scene_release(&scene);
}

static void refuse_bytes(const void *bytes, size_t size, const char *words)
{
    struct error err = {0};
    struct scene copy;

    assert_int_not_equal(scene_unpack(&copy, bytes, size, &err), STATUS_OK);
    if (!strstr(err.text, words))
        fail_msg("\"%s\" does not say \"%s\"", err.text, words);
}

static void test_hostile_bytes(void **state)
{
    struct buffer many = BUFFER_INIT;

    (void)state;
    refuse_bytes("", 0, "empty");
    refuse_bytes("\x08\x04", 2, "version 4");
    refuse_bytes("\x12\x00", 2, "version 0");
    refuse_bytes("\x08\x03", 2, "no camera");
    refuse_bytes("\x08\x03\x08\x03", 4, "twice");
    refuse_bytes("\x08\x03\xa2\x01\x00", 5, "does not know"); /* field 20 */
    refuse_bytes("\x08\x03\x10\x00", 4, "does not know");     /* field 2 as a number */
    refuse_bytes("\x08\x03\x1a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", 13, "ends within");
    refuse_bytes("\x08\x03\x1a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x7f", 13, "ends within");
    refuse_bytes("\x08\x03\x3a\x00", 4, "instances[0] is too short");
    refuse_bytes("\x08\x03\x12\x03" "a\0b", 7, "NUL");
    refuse_bytes("\x08\x03\x80\x01\x01\x80\x01\x01", 8, "twice");       /* fog */
    refuse_bytes("\x08\x03\x80\x01\xff\xff\xff\xff\xff\x01", 10, "fog"); /* 2^40 */
    refuse_bytes("\x08\x03\x90\x01\x02", 5, "rule for volumes");
    refuse_bytes("\x08\x03\x5a\x00", 4, "nodes[0] is too short");
    refuse_bytes("\x08\x03\x62\x00", 4, "channels[0] is too short");
    refuse_bytes("\x08\x03\x6a\x00", 4, "skins[0] is too short");
    /* A material whose clearcoat has a field 15. */
    buffer_append(&many, "\x08\x03\x32\x43\x0a\x3c", 6);
    for (int i = 0; i < 60; i++)
        buffer_append(&many, "a", 1); /* its name */
    buffer_append(&many, "\xda\x01\x02\x78\x01", 5);
    refuse_bytes(many.data, many.size, "a material's clearcoat has an unknown field");
    buffer_clear(&many);
    /* A channel in a hundred pieces: protobuf-c would need many times its size. */
    buffer_append(&many, "\x08\x03\x62\xc8\x01", 5);
    for (int i = 0; i < 100; i++)
        buffer_append(&many, "\x08\x00", 2);
    refuse_bytes(many.data, many.size, "channels[0] cannot be decoded");
    buffer_clear(&many);
    /* An instance of 4097 bytes. */
    buffer_append(&many, "\x08\x03\x3a\x81\x20", 5);
    buffer_append_space(&many, 4097);
    refuse_bytes(many.data, many.size, "instances[0] takes 4097 bytes: at most 4096");
    buffer_clear(&many);
    /* Empty textures cost two bytes each: they are counted before memory is taken. */
    buffer_append(&many, "\x08\x03", 2);
    for (int i = 0; i <= SCENE_TEXTURES_MAX; i++)
        buffer_append(&many, "\x2a\x00", 2);
    refuse_bytes(many.data, many.size, "more than 65536 textures");
    buffer_release(&many);
}

static void test_no_memory(void **state)
{
    struct buffer packed = BUFFER_INIT;
    struct scene scene, copy;
    long fails = 0;

    (void)state;
    scene_sample(&scene);
    pack(&scene, &packed);
    for (long n = 0;; n++) {
        struct error err = {0};
        status result;
        mem_fault_arm(n, 1);
        result = scene_unpack(&copy, packed.data, packed.size, &err);
        fails = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (fails == 0) {
            assert_int_equal(result, STATUS_OK);
            scene_release(&copy);
            assert_true(n > 20); /* the loop went through real allocations */
            break;
        }
        if (result != STATUS_ERR_NO_MEMORY)
            fail_msg("allocation %ld: %s", n, err.text);
        assert_null(copy.meshes);
    }
    for (long n = 0;; n++) {
        struct buffer out = BUFFER_INIT;
        struct error err = {0};
        status result;
        mem_fault_arm(n, 1);
        result = scene_pack(&scene, &out, &err);
        fails = mem_fault_count();
        mem_fault_arm(-1, 0);
        buffer_release(&out);
        if (fails == 0) {
            assert_int_equal(result, STATUS_OK);
            assert_true(n > 0);
            break;
        }
        assert_int_equal(result, STATUS_ERR_NO_MEMORY);
    }
    buffer_release(&packed);
    scene_release(&scene);
}

static void test_blobs(void **state)
{
    struct scene_blob *list;
    struct scene scene;
    struct error err = {0};
    size_t count;

    (void)state;
    scene_sample(&scene);
    assert_int_equal(scene_blobs(&scene, &list, &count, &err), STATUS_OK);
    assert_int_equal(count, 5); /* two meshes, one image used twice, the environment, a grid */
    for (size_t i = 1; i < count; i++)
        assert_true(memcmp(&list[i - 1].digest, &list[i].digest, DIGEST_BYTES) < 0);
    mem_free(list);
    scene.environment.constant = 1;
    assert_int_equal(scene_blobs(&scene, &list, &count, &err), STATUS_OK);
    assert_int_equal(count, 4);
    mem_free(list);
    scene.images[1].blob.size_bytes++;
    assert_int_equal(scene_blobs(&scene, &list, &count, &err), STATUS_ERR_INPUT);
    assert_null(list);
    mem_fault_arm(0, 1);
    assert_int_equal(scene_blobs(&scene, &list, &count, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    scene_release(&scene);
}

static void test_bounds(void **state)
{
    struct scene scene;
    float low[3], high[3];

    (void)state;
    scene_sample(&scene);
    /* Instances 0 and 2 hold the box -1..1, -2..2, -3..3; 1 the triangle 0..1, 0..1, 0; all
     * scaled by (2, -3, 4) and moved by (i, 1, 2). */
    assert_true(scene_bounds(&scene, low, high));
    assert_true(low[0] == -2 && high[0] == 4);
    assert_true(low[1] == -5 && high[1] == 7);
    assert_true(low[2] == -10 && high[2] == 14);
    scene.instance_count = 0;
    assert_false(scene_bounds(&scene, low, high));
    scene_release(&scene);
}

/* With another origin every place is as far from it as before, whatever has it. */
static void test_move(void **state)
{
    static const double by[3] = {1, -2, 4};
    struct scene_instance instance;
    struct scene_camera camera;
    struct scene_light lights[2];
    struct scene_medium medium;
    struct scene_portal portal = {.corner = {0, 0, 0}};
    struct scene scene;

    (void)state;
    scene_init(&scene);
    scene_instance_default(&instance);
    scene_camera_default(&camera);
    scene_medium_default(&medium);
    medium.has_grid = 1;
    for (int i = 0; i < 2; i++)
        scene_light_default(&lights[i]);
    lights[0].kind = LIGHT_POINT;
    lights[1].kind = LIGHT_PROJECTION;
    scene.instances = &instance;
    scene.cameras = &camera;
    scene.lights = lights;
    scene.media = &medium;
    scene.environment.portals = &portal;
    scene.instance_count = scene.camera_count = scene.medium_count = scene.environment.portal_count = 1;
    scene.light_count = 2;
    scene_move(&scene, by);
    for (int c = 0; c < 3; c++) {
        assert_true(scene.origin[c] == by[c]);
        assert_true(instance.to_world.m[c][3] == -by[c] && camera.to_world.m[c][3] == -by[c]);
        assert_true(medium.grid_to_world.m[c][3] == -by[c] && portal.corner[c] == -by[c]);
        assert_true(lights[0].position[c] == -by[c] && lights[1].to_world.m[c][3] == -by[c]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_move),
        cmocka_unit_test(test_layout),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_packed_earlier),
        cmocka_unit_test(test_defaults_take_no_bytes),
        cmocka_unit_test(test_refuses_meshes),
        cmocka_unit_test(test_refuses_pictures),
        cmocka_unit_test(test_refuses_materials),
        cmocka_unit_test(test_refuses_layers),
        cmocka_unit_test(test_refuses_motion),
        cmocka_unit_test(test_hidden_at_first),
        cmocka_unit_test(test_refuses_media),
        cmocka_unit_test(test_refuses_instances),
        cmocka_unit_test(test_refuses_lights),
        cmocka_unit_test(test_refuses_cameras),
        cmocka_unit_test(test_refuses_environment),
        cmocka_unit_test(test_truncations),
        cmocka_unit_test(test_bit_flips),
        cmocka_unit_test(test_hostile_bytes),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_blobs),
        cmocka_unit_test(test_bounds),
    };

    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
