/* glTF: views in meshopt's form and primitives in Draco's. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "client/import/gltf/compressed/meshopt.h"
#include "common/base/memory.h"
#include "tests/support/draco_maker.h"
#include "tests/support/gltf_maker.h"

/* Encoded by libmeshoptimizer 0.18. */
static const uint8_t triangles[] = {225, 240, 16,  254, 255, 110, 255, 240, 12,  255, 2,  2, 2,   178, 19, 0,
                                    118, 135, 86,  103, 120, 169, 134, 101, 137, 104, 152, 1, 105, 0,   0};
static const uint16_t triangle_indices[18] = {0, 1, 2, 2, 1, 3, 4, 6, 5, 7, 8, 9, 2, 3, 10, 0, 0, 9};
static const uint8_t sequence[] = {209, 0, 4, 4, 4, 193, 139, 17, 5, 8, 7, 2, 0, 0, 0, 0};
static const uint32_t sequence_indices[9] = {0, 1, 2, 3, 70000, 70001, 5, 69999, 4};
static const uint8_t positions[] = {
    160, 0,   0,   7,   0,   0,   255, 128, 128, 64,  64,  64,  64,  32,  32,  32,  32,  32,  32,  32,  255, 0,
    0,   0,   32,  16,  16,  16,  5,   48,  128, 0,   0,   126, 128, 0,   0,   0,   0,   0,   5,   60,  243, 207,
    60,  255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 243, 0,   0,   0,   255, 255, 255, 5,   59,  239, 190,
    251, 124, 125, 124, 125, 124, 125, 124, 125, 124, 125, 239, 0,   0,   0,   124, 125, 124, 0,   4,   63,  0,
    0,   0,   255, 255, 255, 7,   0,   0,   0,   223, 224, 144, 144, 104, 120, 68,  76,  84,  60,  50,  54,  58,
    255, 0,   0,   0,   62,  32,  36,  36,  5,   56,  128, 128, 0,   131, 128, 0,   0,   0,   0,   0,   0,   0,
    0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,   0,
    0,   0,   0,   0,   0,   0};
static const uint8_t oct8[] = {160, 1, 60, 0, 0, 0, 108, 238, 1, 60, 0, 0, 0, 145, 181, 0, 1, 60, 0, 0, 0, 4, 254, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 127, 127};
static const uint8_t oct16[] = {160, 1, 60, 0, 0, 0, 218, 188, 1, 60, 0, 0, 0, 6, 17, 1, 60, 0, 0, 0, 220, 172, 1, 60, 0, 0, 0, 9, 20, 0, 0, 1, 52, 0, 0, 0, 4, 1, 44, 0, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 7, 255, 127};
static const uint8_t quaternions[] = {160, 1, 48, 0, 0, 0, 177, 1, 48, 0, 0, 0, 10, 1, 48, 0, 0, 0, 178, 1, 48, 0, 0, 0, 11, 1, 48, 0, 0, 0, 66, 1, 32, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 7};
static const uint8_t exponents[] = {160, 1, 48, 0, 0, 0, 11, 0, 0, 1, 48, 0, 0, 0, 17, 1, 48, 0, 0, 0, 61, 1, 48, 0, 0, 0, 206, 1, 32, 0, 0, 0, 1, 48, 0, 0, 0, 17, 0, 0, 0, 1, 48, 0, 0, 0, 17, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 254, 31, 209, 255, 254, 0, 0, 0, 254};
/* Version 1, by hand from the specification. Channel 0: two 16-bit deltas; channel 1: exclusive or, turned by 4. */
static const uint8_t version_1[] = {0xa1, 0xbb, 0xe4, 6, 3, 200, 1, 0, 2,  /* byte 4: 1 bit each */ 1, 1, 0, 5,
                                    /* byte 5: 2 bits each */ 1, 0x90, 0, 0, 0, /* byte 7 */ 0x10, 0, 0x20,
                                    /* tail */ 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 100, 0, 5, 0, 0x44, 0x33,
                                    0x22, 0x11, 1, 0x42};
static const uint8_t version_1_values[24] = {103, 0, 4, 0, 0x64, 0x33, 0x22, 0x40, 101, 0, 4, 0,
                                             0x74, 0x33, 0x22, 0x40, 201, 0, 5, 0, 0x74, 0x33, 0x22, 0x42};
static const uint8_t color[] = {0xa1, 0xff, 200, 40, 19, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                                0,    0,    0,   0,  0,  0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
static const uint8_t color_values[4] = {130, 90, 90, 255};

static const struct {
    const uint8_t *stream;
    size_t size, count, stride;
    enum meshopt_mode mode;
    enum meshopt_filter filter;
} streams[] = {
    {triangles, sizeof triangles, 18, 2, MESHOPT_TRIANGLES, MESHOPT_NONE},
    {sequence, sizeof sequence, 9, 4, MESHOPT_INDICES, MESHOPT_NONE},
    {positions, sizeof positions, 20, 12, MESHOPT_ATTRIBUTES, MESHOPT_NONE},
    {oct8, sizeof oct8, 3, 4, MESHOPT_ATTRIBUTES, MESHOPT_OCTAHEDRAL},
    {oct16, sizeof oct16, 3, 8, MESHOPT_ATTRIBUTES, MESHOPT_OCTAHEDRAL},
    {quaternions, sizeof quaternions, 2, 8, MESHOPT_ATTRIBUTES, MESHOPT_QUATERNION},
    {exponents, sizeof exponents, 2, 12, MESHOPT_ATTRIBUTES, MESHOPT_EXPONENTIAL},
    {version_1, sizeof version_1, 3, 8, MESHOPT_ATTRIBUTES, MESHOPT_NONE},
    {color, sizeof color, 1, 4, MESHOPT_ATTRIBUTES, MESHOPT_COLOR},
};

static void decode(size_t which, void *out)
{
    assert_null(meshopt_check(streams[which].mode, streams[which].filter, streams[which].count, streams[which].stride,
                              streams[which].size));
    assert_null(meshopt_decode(streams[which].mode, streams[which].filter, streams[which].count, streams[which].stride,
                               streams[which].stream, streams[which].size, out));
}

static void make_positions(float out[20][3])
{
    for (int i = 0; i < 20; i++) {
        out[i][0] = (float)i * 0.5f;
        out[i][1] = (float)(i % 3) * 0.25f;
        out[i][2] = (float)-(i * i) * 0.125f;
    }
}

static void assert_shorts(const int16_t *got, const int16_t *wanted, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (got[i] - wanted[i] > 1 || wanted[i] - got[i] > 1)
            fail_msg("%zu: %d, not %d", i, got[i], wanted[i]);
}

static void test_streams(void **state)
{
    static const int8_t wanted8[12] = {0, 0, 127, 127, 76, -102, 0, -127, -60, 76, -82, 0};
    static const int16_t wanted16[12] = {0, 0, 32767, 32767, 19653, -26219, 0, -32767, -15721, 19658, -20979, 0};
    static const int16_t wanted_turns[8] = {0, 0, 0, 32767, 16378, -16378, 3271, 22945};
    static const float wanted_floats[6] = {1.5f, -3000.25f, 0, 0, 7, 0};
    uint8_t bytes[240];
    int16_t shorts[18];
    uint32_t words[9];
    float floats[60], wanted[20][3];

    (void)state;
    decode(0, shorts);
    assert_memory_equal(shorts, triangle_indices, sizeof triangle_indices);
    decode(1, words);
    assert_memory_equal(words, sequence_indices, sizeof sequence_indices);
    decode(2, floats);
    make_positions(wanted);
    assert_memory_equal(floats, wanted, sizeof wanted);
    decode(3, bytes);
    for (int i = 0; i < 12; i++)
        assert_true((int8_t)bytes[i] - wanted8[i] <= 1 && wanted8[i] - (int8_t)bytes[i] <= 1);
    decode(4, shorts);
    assert_shorts(shorts, wanted16, 12);
    decode(5, shorts);
    assert_shorts(shorts, wanted_turns, 8);
    decode(6, floats);
    assert_memory_equal(floats, wanted_floats, sizeof wanted_floats);
    decode(7, bytes);
    assert_memory_equal(bytes, version_1_values, sizeof version_1_values);
    decode(8, bytes);
    assert_memory_equal(bytes, color_values, sizeof color_values);
}

/* Every stream that is cut or longer is refused; every changed byte is decoded or refused, inside its room. */
static void test_damaged_streams(void **state)
{
    (void)state;
    for (size_t s = 0; s < sizeof streams / sizeof *streams; s++) {
        size_t size = streams[s].size, room = streams[s].count * streams[s].stride;
        uint8_t *out = mem_alloc(room);
        for (size_t cut = 0; cut <= size + 1; cut++) {
            uint8_t *copy = mem_calloc(cut ? cut : 1, 1);
            memcpy(copy, streams[s].stream, cut < size ? cut : size);
            if (cut != size && !meshopt_check(streams[s].mode, streams[s].filter, streams[s].count, streams[s].stride, cut) &&
                !meshopt_decode(streams[s].mode, streams[s].filter, streams[s].count, streams[s].stride, copy, cut, out))
                fail_msg("stream %zu of %zu bytes is accepted with %zu", s, size, cut);
            mem_free(copy);
        }
        for (size_t at = 0; at < size; at++)
            for (int value = 0; value < 256; value++) {
                uint8_t *copy = mem_memdup(streams[s].stream, size);
                copy[at] = (uint8_t)value;
                (void)!meshopt_decode(streams[s].mode, streams[s].filter, streams[s].count, streams[s].stride, copy,
                                      size, out);
                mem_free(copy);
            }
        mem_free(out);
    }
}

#define INDEXED(more) ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1" more "}]}]"

/* A view whose bytes are in the stream `which` of `more` JSON. */
static int put_compressed(struct maker *m, size_t which, const char *extension, size_t length, size_t size)
{
    put_view(m, streams[which].stream, size, 0);
    buffer_printf(&m->views,
                  ",{\"buffer\":0,\"byteLength\":%zu,\"extensions\":{\"%s\":{\"buffer\":0,\"byteOffset\":%zu,"
                  "\"byteLength\":%zu,\"byteStride\":%zu,\"count\":%zu,\"mode\":\"%s\",\"filter\":\"%s\"}}}",
                  length, extension, m->bytes.size - size, size, streams[which].stride, streams[which].count,
                  meshopt_mode_names[streams[which].mode], meshopt_filter_names[streams[which].filter]);
    return m->view_count++;
}

static void test_views(void **state)
{
    static const char *const names[] = {"EXT_meshopt_compression", "KHR_meshopt_compression"};
    struct import_result plain, compressed;
    float places[20][3];
    struct maker m = {0};

    (void)state;
    make_positions(places);
    put_floats(&m, "VEC3", &places[0][0], 60, 20);
    put_accessor(&m, put_view(&m, triangle_indices, sizeof triangle_indices, 0), "SCALAR", 5123, 18, "");
    maker_import(&m, INDEXED(""), &plain);
    for (int i = 0; i < 2; i++) {
        char rest[512];
        memset(&m, 0, sizeof m);
        put_accessor(&m, put_compressed(&m, 2, names[i], 240, sizeof positions), "VEC3", 5126, 20, "");
        put_accessor(&m, put_compressed(&m, 0, names[i], 36, sizeof triangles), "SCALAR", 5123, 18, "");
        snprintf(rest, sizeof rest, "\"extensionsRequired\":[\"%s\"]," INDEXED(""), names[i]);
        maker_import(&m, rest, &compressed);
        assert_true(digest_equal(&plain.scene_digest, &compressed.scene_digest));
        import_result_release(&compressed);
    }
    import_result_release(&plain);
    memset(&m, 0, sizeof m);
    put_accessor(&m, put_compressed(&m, 2, names[0], 240, sizeof positions - 1), "VEC3", 5126, 20, "");
    maker_refuse(&m, ONE_NODE "," ONE_TRIANGLE, "bufferViews[1].EXT_meshopt_compression|stream");
    memset(&m, 0, sizeof m);
    put_accessor(&m, put_compressed(&m, 2, names[1], 236, sizeof positions), "VEC3", 5126, 19, "");
    maker_refuse(&m, ONE_NODE "," ONE_TRIANGLE, "bufferViews[1].KHR_meshopt_compression|byteLength of the view, 236");
}

static void test_limits(void **state)
{
    (void)state;
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_NONE, SIZE_MAX, 256, 1 << 20));
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_NONE, 1, 6, 100));
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_NONE, 1, 260, 1000));
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_QUATERNION, 1, 4, 1000));
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_COLOR, 1, 16, 1000));
    assert_non_null(meshopt_check(MESHOPT_TRIANGLES, MESHOPT_NONE, 4, 4, 1000));
    assert_non_null(meshopt_check(MESHOPT_INDICES, MESHOPT_NONE, 1001, 4, 1000));
    assert_non_null(meshopt_check(MESHOPT_INDICES, MESHOPT_COLOR, 1, 4, 1000));
    assert_non_null(meshopt_check(MESHOPT_INDICES, MESHOPT_NONE, 1, 3, 1000));
    assert_non_null(meshopt_check(MESHOPT_ATTRIBUTES, MESHOPT_NONE, 0, 4, 1000));
}

/* ---- Draco -------------------------------------------------------------------------------- */

static const float corners[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
static const uint8_t corner_joints[8][4] = {{1}, {0}, {1}, {0}, {1}, {0}, {1}, {0}};
static const uint16_t box[36] = {0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4,
                                 1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7};

#define DRACO(ids)                                                                                                     \
    ",\"extensions\":{\"KHR_draco_mesh_compression\":{\"bufferView\":0,\"attributes\":{" ids "}}}"

static struct maker draco_maker(int sequential, size_t drop, size_t points, size_t indices)
{
    uint8_t bytes[4096];
    size_t size = draco_make(corners, corner_joints, 8, box, 12, sequential, bytes, sizeof bytes);
    struct maker m = {0};

    assert_true(size > drop);
    put_view(&m, bytes, size - drop, 0);
    put_accessor(&m, -1, "VEC3", 5126, points, "");
    put_accessor(&m, -1, "SCALAR", 5123, indices, "");
    put_accessor(&m, -1, "VEC4", 5121, points, "");
    return m;
}

static void test_draco(void **state)
{
    struct import_result plain, compressed;
    struct maker m = {0};

    (void)state;
    put_floats(&m, "VEC3", &corners[0][0], 24, 8);
    put_accessor(&m, put_view(&m, box, sizeof box, 0), "SCALAR", 5123, 36, "");
    maker_import(&m, INDEXED(""), &plain);
    m = draco_maker(1, 0, 8, 36);
    maker_import(&m, "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]," INDEXED(DRACO("\"POSITION\":0")),
                 &compressed);
    assert_true(digest_equal(&plain.scene_digest, &compressed.scene_digest));
    import_result_release(&compressed);
    /* The other way of coding orders points and triangles as it likes. */
    m = draco_maker(0, 0, 8, 36);
    maker_import(&m, INDEXED(DRACO("\"POSITION\":0")), &compressed);
    assert_int_equal(compressed.triangles, 12);
    assert_int_equal(compressed.scene.meshes[0].vertex_count, 8);
    assert_int_equal(compressed.scene.meshes[0].closed, plain.scene.meshes[0].closed);
    assert_memory_equal(&compressed.scene.meshes[0].bounds_min, &plain.scene.meshes[0].bounds_min,
                        sizeof plain.scene.meshes[0].bounds_min);
    import_result_release(&compressed);
    import_result_release(&plain);
}

static void test_draco_joints(void **state)
{
    struct import_result r;
    struct mesh_view v;
    struct maker m = draco_maker(1, 0, 8, 36);
    static const float weights[32] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0,
                                      1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};

    (void)state;
    put_floats(&m, "VEC4", weights, 32, 8);
    maker_import(&m,
                 "\"scenes\":[{\"nodes\":[0,1,2]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{},{}],\"skins\":[{\"joints\":[1,2]}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"JOINTS_0\":2,\"WEIGHTS_0\":3},"
                 "\"indices\":1" DRACO("\"POSITION\":0,\"JOINTS_0\":1") "}]}]",
                 &r);
    v = view_mesh(&r, 0);
    for (int i = 0; i < 8; i++)
        assert_int_equal(v.skin[i].joint[0], corner_joints[i][0]);
    import_result_release(&r);
}

static void test_damaged_draco(void **state)
{
    struct maker m = draco_maker(1, 0, 9, 36);

    (void)state;
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")),
                 "meshes[0].primitives[0].KHR_draco_mesh_compression|other triangles or points");
    m = draco_maker(0, 0, 8, 33);
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")), "other triangles or points");
    m = draco_maker(0, 0, 8, 999999999);
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")), "333333333 triangles of 8 points|at most");
    m = draco_maker(0, 0, 8, 36);
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":7")), "POSITION: its Draco stream has no such attribute");
    m = draco_maker(0, 0, 8, 36);
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":1")), "POSITION: its Draco stream has another number of components");
    m = draco_maker(0, 0, 8, 36);
    maker_refuse(&m, INDEXED(",\"mode\":5" DRACO("\"POSITION\":0")), "mode must be 4");
    m = draco_maker(0, 0, 8, 36);
    maker_refuse(&m, INDEXED(DRACO("\"NORMAL\":0")), "attributes.NORMAL");
    m = draco_maker(0, 0, 8, 36);
    m.bytes.data[8] ^= 1; /* the method */
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")), "KHR_draco_mesh_compression");
    m = draco_maker(0, 0, 8, 36);
    m.bytes.data[10] |= 0x80;
    maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")), "metadata, which is not read");
    for (size_t drop = 1; drop < 40; drop++) {
        m = draco_maker(0, drop, 8, 36);
        maker_refuse(&m, INDEXED(DRACO("\"POSITION\":0")), "meshes[0].primitives[0].KHR_draco_mesh_compression");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_streams),         cmocka_unit_test(test_damaged_streams),
        cmocka_unit_test(test_views),           cmocka_unit_test(test_limits),
        cmocka_unit_test(test_draco),           cmocka_unit_test(test_draco_joints),
        cmocka_unit_test(test_damaged_draco),
    };

    return cmocka_run_group_tests_name("glTF compression", tests, NULL, NULL);
}
