/* The scene description: layout, validation, wire form, blobs, bounds. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
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
    mesh.arrays = MESH_ARRAYS_ALL;
    scene_mesh_layout(&mesh, &layout);
    assert_int_equal(layout.normals, 60);
    assert_int_equal(layout.tangents, 120);
    assert_int_equal(layout.uv0, 200);
    assert_int_equal(layout.uv1, 240);
    assert_int_equal(layout.colors, 280);
    assert_int_equal(layout.indices, 360);
    assert_int_equal(layout.total_bytes, 360 + 24 + 16);
}

static void assert_slot_equal(const struct scene_texture_slot *a,
                              const struct scene_texture_slot *b)
{
    assert_int_equal(a->texture, b->texture);
    assert_int_equal(a->uv_set, b->uv_set);
    assert_memory_equal(a->uv_transform, b->uv_transform, sizeof a->uv_transform);
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
        assert_memory_equal(x->attenuation_color, y->attenuation_color,
                            sizeof x->attenuation_color);
        assert_true(x->attenuation_distance == y->attenuation_distance);
    }
    assert_int_equal(a->instance_count, b->instance_count);
    for (uint32_t i = 0; i < a->instance_count; i++) {
        assert_string_equal(a->instances[i].name, b->instances[i].name);
        assert_int_equal(a->instances[i].mesh, b->instances[i].mesh);
        assert_int_equal(a->instances[i].material, b->instances[i].material);
        assert_memory_equal(&a->instances[i].to_world, &b->instances[i].to_world,
                            sizeof a->instances[i].to_world);
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
    }
    assert_int_equal(a->camera_count, b->camera_count);
    for (uint32_t i = 0; i < a->camera_count; i++) {
        const struct scene_camera *x = &a->cameras[i], *y = &b->cameras[i];
        assert_string_equal(x->name, y->name);
        assert_int_equal(x->kind, y->kind);
        assert_memory_equal(&x->to_world, &y->to_world, sizeof x->to_world);
        assert_true(x->yfov_rad == y->yfov_rad && x->xmag == y->xmag && x->ymag == y->ymag &&
                    x->aspect == y->aspect);
    }
    assert_int_equal(a->environment.present, b->environment.present);
    assert_int_equal(a->environment.constant, b->environment.constant);
    if (a->environment.present && !a->environment.constant) {
        assert_string_equal(a->environment.image.name, b->environment.image.name);
        assert_true(digest_equal(&a->environment.image.blob.digest,
                                 &b->environment.image.blob.digest));
        assert_int_equal(a->environment.image.blob.size_bytes,
                         b->environment.image.blob.size_bytes);
    }
    assert_memory_equal(a->environment.radiance, b->environment.radiance,
                        sizeof a->environment.radiance);
}

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
    scene.environment = (struct scene_environment){
        .present = 1, .constant = 1, .radiance = {0.5f, 0, 7}};
    check_round_trip(&scene);
    scene.environment.present = scene.environment.constant = 0;
    memset(scene.environment.radiance, 0, sizeof scene.environment.radiance);
    check_round_trip(&scene);
    scene.mesh_count = scene.image_count = scene.texture_count = scene.material_count =
        scene.instance_count = scene.light_count = 0;
    check_round_trip(&scene);
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
    REFUSE("meshes[0]", s.meshes[0].arrays = 32);
    REFUSE("meshes[0]", s.meshes[0].arrays = MESH_UV0);
    for (int i = 0; i < 3; i++) {
        REFUSE_NUMBER("meshes[0].bounds_min", meshes[0].bounds_min[i]);
        REFUSE_NUMBER("meshes[0].bounds_max", meshes[0].bounds_max[i]);
        REFUSE("meshes[0].bounds_min", s.meshes[0].bounds_min[i] = 100);
        REFUSE("meshes[0].bounds_max", s.meshes[0].bounds_max[i] = 2e15f);
    }
    REFUSE("meshes[0].closed", s.meshes[0].closed = 2);
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
    REFUSE("textures[0].wrap_v", s.textures[0].wrap_v = (enum scene_wrap)-1);
    REFUSE("textures[0].nearest", s.textures[0].nearest = -1);
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
    REFUSE("materials[0].ior", s.materials[0].ior = 0.5f);
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

static void test_refuses_instances(void **state)
{
    (void)state;
    REFUSE("instances", s.instance_count = SCENE_INSTANCES_MAX + 1u);
    REFUSE("instances[2].mesh", s.instances[2].mesh = 2);
    REFUSE("instances[2].material", s.instances[2].material = 3);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            REFUSE_NUMBER("instances[1].to_world", instances[1].to_world.m[r][c]);
    REFUSE("instances[1].to_world", s.instances[1].to_world.m[1][1] = 0);
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
    refuse_bytes("\x08\x02", 2, "version 2");
    refuse_bytes("\x12\x00", 2, "version 0");
    refuse_bytes("\x08\x01", 2, "no camera");
    refuse_bytes("\x08\x01\x08\x01", 4, "twice");
    refuse_bytes("\x08\x01\x5a\x00", 4, "does not know");   /* field 11 */
    refuse_bytes("\x08\x01\x10\x00", 4, "does not know");   /* field 2 as a number */
    refuse_bytes("\x08\x01\x1a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", 13, "ends within");
    refuse_bytes("\x08\x01\x1a\xff\xff\xff\xff\xff\xff\xff\xff\xff\x7f", 13, "ends within");
    refuse_bytes("\x08\x01\x3a\x00", 4, "instances[0] is too short");
    refuse_bytes("\x08\x01\x12\x03" "a\0b", 7, "NUL");
    /* Empty textures cost two bytes each: they are counted before memory is taken. */
    buffer_append(&many, "\x08\x01", 2);
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
    assert_int_equal(count, 4); /* two meshes, one image used twice, the environment */
    for (size_t i = 1; i < count; i++)
        assert_true(memcmp(&list[i - 1].digest, &list[i].digest, DIGEST_BYTES) < 0);
    mem_free(list);
    scene.environment.constant = 1;
    assert_int_equal(scene_blobs(&scene, &list, &count, &err), STATUS_OK);
    assert_int_equal(count, 3);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_layout),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_refuses_meshes),
        cmocka_unit_test(test_refuses_pictures),
        cmocka_unit_test(test_refuses_materials),
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
