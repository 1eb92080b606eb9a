/* glTF: how a file stores an attribute changes nothing: each attribute of a mesh, as each type of numbers that holds its values, packed,
 * among others, behind an offset, and as the places where it differs from another or from nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "tests/support/gltf_maker.h"

enum { VERTICES = 4, ATTRIBUTES = 10, MORE_SIZE = 300 };
enum type { BYTE = 5120, UBYTE = 5121, SHORT = 5122, USHORT = 5123, FLOAT = 5126, PLAIN = 1 << 16 };

/* Values that all of the types hold exactly. */
static const struct attribute {
    const char *type;
    int components;
    enum type types[4]; /* the first is how it is stored where it is not looked at */
    float values[VERTICES][4];
} attributes[ATTRIBUTES] = {
    /* POSITION, NORMAL, TANGENT, TEXCOORD_0, TEXCOORD_1, COLOR_0, JOINTS_0, WEIGHTS_0, a target's POSITION and NORMAL */
    {"VEC3", 3, {FLOAT, BYTE, SHORT}, {{-1, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 1, 1}}},
    {"VEC3", 3, {FLOAT, BYTE, SHORT}, {{0, 0, 1}, {0, 1, 0}, {0, 0, -1}, {0, -1, 0}}},
    {"VEC4", 4, {FLOAT, BYTE, SHORT}, {{1, 0, 0, 1}, {-1, 0, 0, 1}, {1, 0, 0, -1}, {-1, 0, 0, -1}}},
    {"VEC2", 2, {FLOAT, UBYTE, USHORT}, {{0, 1}, {1, 1}, {1, 0}, {0, 0}}},
    {"VEC2", 2, {FLOAT, UBYTE, USHORT}, {{1, 0}, {1, 1}, {0, 1}, {0, 0}}},
    {"VEC4", 4, {FLOAT, UBYTE, USHORT}, {{1, 0, 0, 1}, {0, 1, 0, 0}, {0, 0, 1, 1}, {1, 1, 0, 0}}},
    {"VEC4", 4, {USHORT | PLAIN, UBYTE | PLAIN}, {{0, 1, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {1, 1, 0, 0}}},
    {"VEC4", 4, {FLOAT, UBYTE, USHORT}, {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 1, 0, 0}, {1, 0, 0, 0}}},
    {"VEC3", 3, {FLOAT, BYTE, SHORT}, {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}, {0, 0, 0}}},
    {"VEC3", 3, {FLOAT, BYTE, SHORT}, {{1, 0, 0}, {0, 0, 0}, {0, 1, 0}, {0, 0, -1}}},
};

static size_t size_of(enum type type)
{
    const int base = type & ~PLAIN;

    return base == FLOAT ? 4 : base == SHORT || base == USHORT ? 2 : 1;
}

static void put_number(uint8_t *to, enum type type, float value)
{
    const int base = type & ~PLAIN;
    const float most = type & PLAIN ? 1 : base == BYTE ? 127 : base == UBYTE ? 255 : base == SHORT ? 32767 : 65535;
    const int32_t number = (int32_t)(value * most);

    if (base == FLOAT)
        memcpy(to, &value, sizeof value);
    else
        memcpy(to, &number, size_of(type)); /* little-endian */
}

static size_t row_size(const struct attribute *a, enum type type) { return (size_t)a->components * size_of(type); }

static void put_row(uint8_t *to, const struct attribute *a, enum type type, int vertex)
{
    for (int c = 0; c < a->components; c++)
        put_number(to + (size_t)c * size_of(type), type, a->values[vertex][c]);
}

enum layout { PACKED, AMONG_OTHERS, OVER_ANOTHER, OVER_NOTHING, LAYOUTS = OVER_NOTHING + 3 }; /* by three types of indices */

/* The accessor's bytes and what its JSON says more. */
static void put_attribute(struct maker *m, const struct attribute *a, enum type type, enum layout layout)
{
    const size_t row = row_size(a, type), stride = layout == AMONG_OTHERS ? row + 8 - row % 4 : (row + 3) / 4 * 4;
    const size_t ahead = layout == AMONG_OTHERS ? 4 : 0;
    const int index_type = layout == OVER_NOTHING + 1 ? 5123 : layout == OVER_NOTHING + 2 ? 5125 : 5121;
    const size_t index_size = index_type == 5121 ? 1 : index_type == 5123 ? 2 : 4;
    uint8_t bytes[VERTICES * 32], indices[VERTICES * 4], values[VERTICES * 16];
    char more[MORE_SIZE];
    int used = 0, count = 0;

    memset(bytes, 0x55, sizeof bytes);
    for (int v = 0; v < VERTICES; v++)
        put_row(bytes + ahead + (size_t)v * stride, a, type, layout == OVER_ANOTHER ? 0 : v);
    for (int v = layout == OVER_ANOTHER ? 1 : 0; v < VERTICES; v++) {
        const uint32_t number = (uint32_t)v;
        put_row(values + (size_t)count * row, a, type, v);
        memcpy(indices + (size_t)count++ * index_size, &number, index_size);
    }
    more[0] = 0;
    if (!(type & PLAIN) && type != FLOAT)
        used += snprintf(more, sizeof more, ",\"normalized\":true");
    if (ahead)
        used += snprintf(more + used, sizeof more - (size_t)used, ",\"byteOffset\":%zu", ahead);
    if (layout >= OVER_ANOTHER) {
        const int at = put_view(m, indices, (size_t)count * index_size, 0), from = put_view(m, values, (size_t)count * row, 0);
        (void)snprintf(more + used, sizeof more - (size_t)used,
                       ",\"sparse\":{\"count\":%d,\"indices\":{\"bufferView\":%d,\"componentType\":%d},\"values\":{\"bufferView\":%d}}", count, at,
                       index_type, from);
    }
    put_accessor(m, layout >= OVER_NOTHING ? -1 : put_view(m, bytes, ahead + VERTICES * stride, stride == row ? 0 : (int)stride), a->type, (int)type & ~PLAIN, VERTICES, more);
}

/* The mesh with attribute `which` so stored; `all`: and each other one in the same way, if it can be. */
static struct digest mesh_of(int which, int type, enum layout layout, int all)
{
    static const char rest[] =
        "\"extensionsUsed\":[\"KHR_mesh_quantization\"],\"extensionsRequired\":[\"KHR_mesh_quantization\"],"
        "\"scenes\":[{\"nodes\":[0,1]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{}],\"skins\":[{\"joints\":[1,1]}],"
        "\"animations\":[{\"samplers\":[{\"input\":10,\"output\":11}],\"channels\":[{\"sampler\":0,\"target\":{\"node\":0,\"path\":\"weights\"}}]}],"
        "\"materials\":[{\"normalTexture\":{\"index\":0},\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0},"
        "\"metallicRoughnessTexture\":{\"index\":0,\"texCoord\":1}}}]," PNG_IMAGE ",\"meshes\":[{\"primitives\":[{\"material\":0,\"mode\":6,\"attributes\":{"
        "\"POSITION\":0,\"NORMAL\":1,\"TANGENT\":2,\"TEXCOORD_0\":3,\"TEXCOORD_1\":4,\"COLOR_0\":5,\"JOINTS_0\":6,\"WEIGHTS_0\":7},"
        "\"targets\":[{\"POSITION\":8,\"NORMAL\":9}]}]}]";
    struct maker m = {0};
    struct import_result r;
    struct digest digest;

    for (int a = 0; a < ATTRIBUTES; a++) {
        const int taken = a == which || all, other = taken && attributes[a].types[type] ? type : 0;
        put_attribute(&m, &attributes[a], attributes[a].types[other], taken ? layout : PACKED);
    }
    put_floats(&m, "SCALAR", (const float[]){0, 1}, 2, 2);
    put_floats(&m, "SCALAR", (const float[]){0, 1}, 2, 2);
    maker_import(&m, rest, &r);
    assert_int_equal(r.scene.mesh_count, 1);
    assert_int_equal(r.scene.meshes[0].arrays,
                     MESH_NORMALS | MESH_TANGENTS | MESH_UV0 | MESH_UV1 | MESH_COLORS | MESH_SKIN);
    assert_int_equal(r.scene.meshes[0].morph_count, 1);
    digest = r.scene.meshes[0].blob.digest;
    import_result_release(&r);
    return digest;
}

static void test_storages(void **state)
{
    const struct digest plain = mesh_of(0, 0, PACKED, 0);
    int files = 0;

    (void)state;
    for (int all = 0; all < 2; all++)
        for (int which = 0; which < (all ? 1 : ATTRIBUTES); which++)
            for (int type = 0; attributes[which].types[type]; type++)
                for (int layout = 0; layout < LAYOUTS; layout++, files++) {
                    const struct digest got = mesh_of(which, type, (enum layout)layout, all);
                    if (memcmp(&got, &plain, sizeof got) != 0)
                        fail_msg("another mesh: attribute %d (all: %d), type %d, layout %d", which, all, (int)attributes[which].types[type] & ~PLAIN, layout);
                }
    assert_true(files > 180);
}

/* What the digest is of: each value of each attribute. */
static void test_values_count(void **state)
{
    struct maker m = {0};
    struct import_result r;
    struct mesh_view v;

    (void)state;
    for (int a = 0; a < 2; a++)
        put_attribute(&m, &attributes[a], FLOAT, OVER_ANOTHER);
    maker_import(&m, ONE_NODE ",\"meshes\":[{\"primitives\":[{\"mode\":6,\"attributes\":{\"POSITION\":0,\"NORMAL\":1}}]}]", &r);
    v = view_mesh(&r, 0);
    for (int i = 0; i < VERTICES; i++) {
        assert_floats(v.positions + 3 * i, attributes[0].values[i], 3, 0);
        assert_floats(v.normals + 3 * i, attributes[1].values[i], 3, 0);
    }
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_storages),
        cmocka_unit_test(test_values_count),
    };

    return cmocka_run_group_tests_name("glTF: how attributes are stored", tests, NULL, NULL);
}
