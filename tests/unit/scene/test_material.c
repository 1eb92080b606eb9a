/* The table of material fields: it agrees with scene.proto, its ranges are enforced by messages
 * that say where and what, and every texture is read by the materials that it should be. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/scene/effects_material.h"
#include "common/scene/material.h"
#include "common/scene/scene.pb-c.h"
#include "tests/support/scene_sample.h"

/* ---- scene.proto ---------------------------------------------------------------------------- */

static const ProtobufCMessageDescriptor *message_of(enum material_message message)
{
    const ProtobufCMessageDescriptor *material = &azulejo__scene__material__descriptor;

    if (message == MESSAGE_MATERIAL)
        return material;
    return protobuf_c_message_descriptor_get_field(material, material_message_numbers[message])->descriptor;
}

/* A member of a group has the group's name before its own: clearcoat_ior is ior in clearcoat. What
 * has the group's name alone is its weight, or strength. */
static int name_fits(enum material_message message, const char *member, const char *wire)
{
    const ProtobufCMessageDescriptor *material = &azulejo__scene__material__descriptor;
    const char *group;
    size_t length;

    if (message == MESSAGE_MATERIAL)
        return strcmp(member, wire) == 0;
    group = protobuf_c_message_descriptor_get_field(material, material_message_numbers[message])->name;
    length = strlen(group);
    if (strncmp(member, group, length) != 0)
        return 0;
    if (member[length] == 0)
        return strcmp(wire, "weight") == 0 || strcmp(wire, "strength") == 0;
    return member[length] == '_' && strcmp(member + length + 1, wire) == 0;
}

static void assert_field(enum material_message message, uint32_t number, const char *name, ProtobufCType type,
                         int repeated)
{
    const ProtobufCFieldDescriptor *field = protobuf_c_message_descriptor_get_field(message_of(message), number);

    if (!field)
        fail_msg("%s: message %s has no field %u", name, message_of(message)->name, number);
    else if (!name_fits(message, name, field->name))
        fail_msg("%s: field %u of %s is %s", name, number, message_of(message)->name, field->name);
    else if (field->type != type || (field->label == PROTOBUF_C_LABEL_REPEATED) != repeated)
        fail_msg("%s: field %u of %s has another type", name, number, message_of(message)->name);
}

static void test_rows_are_in_the_proto(void **state)
{
    static const ProtobufCType types[] = {
        [TYPE_FLAG] = PROTOBUF_C_TYPE_BOOL,     [TYPE_NUMBER] = PROTOBUF_C_TYPE_FLOAT,
        [TYPE_RGB] = PROTOBUF_C_TYPE_FLOAT,     [TYPE_RGBA] = PROTOBUF_C_TYPE_FLOAT,
        [TYPE_INTEGER] = PROTOBUF_C_TYPE_SINT32, [TYPE_KIND] = PROTOBUF_C_TYPE_UINT32,
        [TYPE_ALPHA_MODE] = PROTOBUF_C_TYPE_UINT32, [TYPE_MEDIUM] = PROTOBUF_C_TYPE_UINT32,
        [TYPE_MATERIALS] = PROTOBUF_C_TYPE_UINT32};

    (void)state;
    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];
        int repeated = row->type == TYPE_RGB || row->type == TYPE_RGBA;

        if (row->type == TYPE_MATERIALS) {
            assert_field(row->message, row->number, "mix_first", types[row->type], 0);
            assert_field(row->message, row->number + 1, "mix_second", types[row->type], 0);
        } else {
            assert_field(row->message, row->number, row->name, types[row->type], repeated);
        }
    }
    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        const struct material_texture_row *row = &material_textures[i];

        assert_field(row->message, row->number, row->name, PROTOBUF_C_TYPE_MESSAGE, 0);
        assert_ptr_equal(protobuf_c_message_descriptor_get_field(message_of(row->message), row->number)->descriptor,
                         &azulejo__scene__texture_slot__descriptor);
    }
}

/* How many rows have this place on the wire? */
static int rows_at(enum material_message message, uint32_t number)
{
    int rows = 0;

    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];
        uint32_t last = row->number + (row->type == TYPE_MATERIALS);
        rows += row->message == message && number >= row->number && number <= last;
    }
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        rows += material_textures[i].message == message && material_textures[i].number == number;
    for (int i = 1; i < MATERIAL_MESSAGE_COUNT && message == MESSAGE_MATERIAL; i++)
        rows += material_message_numbers[i] == number;
    return rows;
}

static void test_the_proto_is_in_the_rows(void **state)
{
    (void)state;
    for (int k = 0; k < MATERIAL_MESSAGE_COUNT; k++)
        for (unsigned i = 0; i < message_of(k)->n_fields; i++) {
            const ProtobufCFieldDescriptor *field = &message_of(k)->fields[i];
            int rows = rows_at(k, field->id);

            if (k == MESSAGE_MATERIAL && strcmp(field->name, "name") == 0)
                continue;
            if (rows != 1)
                fail_msg("%s.%s has %d rows in the table", message_of(k)->name, field->name, rows);
        }
}

/* A scene that was packed before a field was there has 0 in its place, unless it is in a group. */
static void test_later_fields_default_to_nothing(void **state)
{
    enum { LAST_OF_VERSION_3 = 38 };

    (void)state;
    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];
        if (row->message == MESSAGE_MATERIAL && row->number > LAST_OF_VERSION_3 &&
            row->initial != (row->type == TYPE_MEDIUM ? -1 : 0))
            fail_msg("%s: a field of Material itself must default to 0: put it in a group", row->name);
    }
}

/* Something in range that is not the default, another for each element. */
static void set_other(struct scene_material *m, const struct material_value *row)
{
    for (int i = 0; i < row->count; i++) {
        float most = row->most < row->least + 1 ? row->most : row->least + 1;
        float number = row->least + (most - row->least) * (0.4f + 0.125f * (float)i);
        int32_t integer = row->type == TYPE_INTEGER ? -5 : 1 + i;

        if (material_is_float(row->type))
            memcpy((char *)m + row->offset + 4 * i, &number, 4);
        else
            memcpy((char *)m + row->offset + 4 * i, &integer, 4);
    }
    assert_false(material_value_is_default(m, row));
}

/* Alone and together with all others; what is not set keeps its default. */
static void check_row_round_trips(int value, int texture)
{
    struct buffer packed = BUFFER_INIT;
    struct scene scene, copy;
    struct scene_material *m;
    struct error err = {0};

    scene_sample(&scene);
    m = &scene.materials[1];
    scene_material_default(m);
    for (int i = 0; i < MATERIAL_VALUES; i++)
        if (value < 0 || i == value)
            set_other(m, &material_values[i]);
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (texture < 0 || i == texture)
            m->textures[i] = (struct scene_texture_slot){1, 1, {{(float)i, 2, 3}, {4, 5, 6}}};
    if (scene_pack(&scene, &packed, &err) != STATUS_OK ||
        scene_unpack(&copy, packed.data, packed.size, &err) != STATUS_OK)
        fail_msg("value %d, texture %d: %s", value, texture, err.text);
    for (int i = 0; i < MATERIAL_VALUES; i++)
        if (memcmp((char *)m + material_values[i].offset, (char *)&copy.materials[1] + material_values[i].offset,
                   4 * (size_t)material_values[i].count) != 0)
            fail_msg("value %d, texture %d: %s is another", value, texture, material_values[i].name);
    assert_memory_equal(m->textures, copy.materials[1].textures, sizeof m->textures);
    buffer_release(&packed);
    scene_release(&copy);
    scene_release(&scene);
}

static void test_every_row_round_trips(void **state)
{
    (void)state;
    check_row_round_trips(-1, -1);
    for (int i = 0; i < MATERIAL_VALUES; i++)
        check_row_round_trips(i, MATERIAL_TEXTURES);
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        check_row_round_trips(MATERIAL_VALUES, i);
}

/* ---- values --------------------------------------------------------------------------------- */

static void test_defaults(void **state)
{
    struct scene_material m;

    (void)state;
    scene_material_default(&m);
    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];
        assert_true(material_value_is_default(&m, row));
        assert_true(row->initial >= row->least && row->initial <= row->most);
    }
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        assert_int_equal(m.textures[i].texture, -1);
    /* glTF's. */
    assert_true(m.alpha_cutoff == 0.5f && m.metallic == 1 && m.roughness == 1 && m.ior == 1.5f);
    assert_true(m.specular == 1 && m.normal_scale == 1 && m.clearcoat_normal_scale == 1);
    assert_true(m.clearcoat_ior == 1.5f && m.iridescence_ior == 1.3f);
    assert_true(m.iridescence_thickness_min_nm == 100 && m.iridescence_thickness_max_nm == 400);
    assert_true(m.medium == -1 && m.medium_outside == -1 && isinf(m.attenuation_distance));
    for (int i = 0; i < 3; i++)
        assert_true(m.base_color[i] == 1 && m.specular_color[i] == 1 && m.attenuation_color[i] == 1 &&
                    m.diffuse_transmission_color[i] == 1 && m.conductor_eta[i] == 1);
    assert_true(m.base_color[3] == 1);
    m.emission[1] = -0.0f;
    assert_true(material_value_is_default(&m, &material_values[MATERIAL_VALUE_emission]));
    m.emission[2] = 1;
    assert_false(material_value_is_default(&m, &material_values[MATERIAL_VALUE_emission]));
    assert_true(material_value_is_set(&m, &material_values[MATERIAL_VALUE_emission]));
}

static void assert_complaint(void (*spoil)(struct scene_material *m), const char *text)
{
    struct error err = {0};
    struct scene scene;

    scene_sample(&scene);
    scene.volume_rule = VOLUMES_NESTED;
    scene.materials[0].name = "lacquer";
    spoil(&scene.materials[0]);
    assert_int_equal(scene_validate(&scene, &err), STATUS_ERR_INPUT);
    assert_string_equal(err.text, text);
    scene_release(&scene);
}

static void rough(struct scene_material *m) { m->roughness = 1.5f; }

static void opaque(struct scene_material *m) { m->attenuation_distance = 0; }

static void reversed(struct scene_material *m) { m->conductor_eta[1] = 0; }

static void all_back(struct scene_material *m) { m->base_interreflection = 1; }

static void both_sides(struct scene_material *m) { m->double_sided = 2; }

static void thin(struct scene_material *m) { m->ior = 0.5f; }

static void test_complaints(void **state)
{
    (void)state;
    assert_complaint(rough, "the scene's materials[0].roughness is 1.5: must be 0 to 1 "
                            "(material \"lacquer\")");
    assert_complaint(opaque, "the scene's materials[0].attenuation_distance is 0: must be above 0 "
                             "(material \"lacquer\")");
    assert_complaint(reversed, "the scene's materials[0].conductor_eta is 0: must be above 0 and "
                               "at most 1e+06 (material \"lacquer\")");
    assert_complaint(all_back, "the scene's materials[0].base_interreflection is 1: must be 0 or "
                               "more and below 1 (material \"lacquer\")");
    assert_complaint(both_sides, "the scene's materials[0].double_sided must be 0 or 1 "
                                 "(material \"lacquer\")");
    assert_complaint(thin, "the scene's materials[0].ior is 0.5: must be 1 to 1e+06 "
                           "(material \"lacquer\")");
}

/* ---- textures ------------------------------------------------------------------------------- */

/* Every weight set, and a texture in every slot. */
static struct scene_material full_material(void)
{
    struct scene_material m;

    scene_material_default(&m);
    m.metallic = 0.5f;
    for (int i = 0; i < MATERIAL_VALUES; i++) { /* weights of layers and lobes */
        const struct material_value *row = &material_values[i];
        if (row->effect && row->type == TYPE_NUMBER && row->initial == 0)
            *(float *)((char *)&m + row->offset) = 1;
    }
    m.emission[0] = m.transmission = m.clearcoat_roughness = 1;
    m.sheen_color[1] = m.sheen_roughness = 1;
    m.mix_amount = 0.5f;
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        m.textures[i].texture = 0;
    return m;
}

static void assert_acting(const struct scene_material *m, const char *slots)
{
    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        char word[64];

        snprintf(word, sizeof word, " %s ", material_textures[i].name);
        *strstr(word, "_texture") = ' ';
        strcpy(strchr(word + 1, ' '), " ");
        if (material_has_texture(m, i) != (strstr(slots, word) != NULL))
            fail_msg("%s %s", material_textures[i].name, strstr(slots, word) ? "does not act" : "acts");
    }
}

#define METAL " base_color normal emission anisotropy clearcoat clearcoat_roughness clearcoat_normal "
#define LIT METAL "metallic_roughness "
#define SURFACE_LAYERS "sheen_color sheen_roughness iridescence iridescence_thickness "
#define SURFACE LIT SURFACE_LAYERS
#define DIELECTRIC SURFACE                                                                         \
    "specular specular_color transmission diffuse_roughness diffuse_transmission "                 \
    "diffuse_transmission_color "

static void test_who_reads_what(void **state)
{
    struct scene_material m = full_material();

    (void)state;
    assert_acting(&m, DIELECTRIC);
    m.metallic = 1; /* the texture makes it less */
    assert_acting(&m, DIELECTRIC);
    m.metallic_roughness_texture.texture = -1;
    assert_acting(&m, METAL SURFACE_LAYERS);
    m = full_material();
    m.unlit = 1;
    assert_acting(&m, " base_color ");
    m.unlit = 0;
    m.kind = MATERIAL_CONDUCTOR;
    assert_acting(&m, LIT);
    m.kind = MATERIAL_INTERFACE;
    assert_acting(&m, "");
    m.kind = MATERIAL_MIX;
    assert_acting(&m, " base_color mix ");
}

/* A texture acts if its own factor is not 0, and what it needs is there. */
static void test_weights(void **state)
{
    struct scene_material m = full_material();

    (void)state;
    m.clearcoat = m.specular = m.iridescence = m.diffuse_transmission = 0;
    m.sheen_color[1] = m.diffuse_roughness = 0;
    assert_acting(&m, " base_color metallic_roughness normal emission anisotropy transmission ");
    m = full_material();
    memset(m.base_color, 0, 3 * sizeof(float));
    m.metallic = m.roughness = m.normal_scale = m.emission[0] = m.transmission = 0;
    m.clearcoat_roughness = m.clearcoat_normal_scale = m.sheen_roughness = m.anisotropy = 0;
    m.diffuse_roughness = 0;
    m.iridescence_thickness_min_nm = m.iridescence_thickness_max_nm;
    memset(m.specular_color, 0, sizeof m.specular_color);
    memset(m.diffuse_transmission_color, 0, sizeof m.diffuse_transmission_color);
    assert_acting(&m, " specular clearcoat sheen_color iridescence diffuse_transmission ");
    m.alpha_mode = ALPHA_BLEND; /* black, but its shape is the texture's */
    assert_true(material_has_texture(&m, MATERIAL_TEXTURE_base_color));
    m.base_color[3] = 0;
    assert_false(material_has_texture(&m, MATERIAL_TEXTURE_base_color));
    m = full_material();
    m.kind = MATERIAL_CONDUCTOR; /* it reads no metallic */
    m.roughness = 0;
    assert_false(material_has_texture(&m, MATERIAL_TEXTURE_metallic_roughness));
}

/* Leaving an effect out restores the default of what calls for it, and of nothing else. */
static void test_reduce(void **state)
{
    (void)state;
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        struct scene_material full = full_material(), m;

        full.attenuation_distance = 1;
        full.alpha_mode = ALPHA_BLEND;
        full.medium = full.medium_outside = 0;
        m = full;
        scene_material_reduce(&m, (uint64_t)1 << bit);
        for (int i = 0; i < MATERIAL_VALUES; i++) {
            const struct material_value *row = &material_values[i];
            if (row->effect >> bit & 1)
                assert_true(material_value_is_default(&m, row) && !material_value_is_default(&full, row));
            else
                assert_memory_equal((char *)&m + row->offset, (char *)&full + row->offset, 4 * (size_t)row->count);
        }
        for (int i = 0; i < MATERIAL_TEXTURES; i++)
            assert_int_equal(m.textures[i].texture,
                             bit == EFFECT_BIT_TEXTURE ||
                                     (bit == EFFECT_BIT_NORMAL_MAP &&
                                      (i == MATERIAL_TEXTURE_normal || i == MATERIAL_TEXTURE_clearcoat_normal))
                                 ? -1
                                 : 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rows_are_in_the_proto),
        cmocka_unit_test(test_the_proto_is_in_the_rows),
        cmocka_unit_test(test_later_fields_default_to_nothing),
        cmocka_unit_test(test_every_row_round_trips),
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_complaints),
        cmocka_unit_test(test_who_reads_what),
        cmocka_unit_test(test_weights),
        cmocka_unit_test(test_reduce),
    };

    return cmocka_run_group_tests_name("material fields", tests, NULL, NULL);
}
