/* Envelopes in and out: round trips, every limit, and hostile bytes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "protocol/message.h"

static struct render_settings example_settings(void)
{
    struct render_settings s;

    render_settings_default(&s);
    s.width = 333;
    s.height = 50;
    s.spp = 100;
    s.seed = 0xfedcba9876543210ull;
    s.env_rotate_deg = -12.5f;
    s.env_strength = 3;
    s.env_sampling = ENV_SAMPLING_BSDF;
    s.isa = ISA_SSE2;
    s.fps = 29.97f;
    s.shutter = 0.5f;
    s.lens_radius = 0.0125f;
    s.focus_distance = 3.5f;
    s.without = EFFECT_CAUSTICS | EFFECT_DISPERSION;
    s.aovs = 1u << AOV_DEPTH | 1u << AOV_ERROR;
    s.sampler = SAMPLER_INDEPENDENT;
    s.light_choice = LIGHT_CHOICE_UNIFORM;
    s.texture_filter = TEXTURE_FILTER_NEAREST;
    s.pixel_filter = PIXEL_FILTER_GAUSSIAN;
    s.filter_width = 4.5f;
    s.bvh_quality = BVH_QUALITY_HIGH;
    s.exr_names = EXR_NAMES_BLENDER;
    s.not_robust = 1;
    s.no_roulette = 1;
    s.clamp = 12.5f;
    s.whole_width = 400;
    s.whole_height = 60;
    s.region_x = 67;
    s.region_y = 9;
    return s;
}

static void test_settings_round_trip(void **state)
{
    struct render_settings in = example_settings(), out;
    Azulejo__Wire__RenderSettings wire;

    (void)state;
    wire_settings_set(&wire, &in);
    assert_int_equal(wire_settings_get(&out, &wire, 1, NULL), STATUS_OK);
    assert_int_equal(out.width, 333);
    assert_int_equal(out.height, 50);
    assert_int_equal(out.spp, 100);
    assert_int_equal(out.max_depth, in.max_depth);
    assert_true(out.seed == in.seed);
    assert_int_equal(out.camera, 0);
    assert_true(out.env_rotate_deg == in.env_rotate_deg && out.env_strength == in.env_strength);
    assert_int_equal(out.env_sampling, ENV_SAMPLING_BSDF);
    assert_int_equal(out.isa, ISA_SSE2);
    assert_true(render_settings_equal(&in, &out));
}

/* A region lies inside the whole picture, and is not all of it. */
static void test_settings_region(void **state)
{
    struct render_settings region = example_settings(); /* 333x50 at 67,9 */
    static const struct {
        uint32_t whole_width, whole_height, x, y;
        status expected;
    } rows[] = {
        {0, 0, 0, 0, STATUS_OK},          {0, 0, 1, 0, STATUS_ERR_INPUT},
        {334, 50, 1, 0, STATUS_OK},       {334, 50, 2, 0, STATUS_ERR_INPUT},
        {333, 51, 0, 1, STATUS_OK},       {333, 50, 0, 0, STATUS_ERR_INPUT},
        {400, 49, 0, 0, STATUS_ERR_INPUT}, {400, 0, 0, 0, STATUS_ERR_INPUT},
        {400, 60, UINT32_MAX, 0, STATUS_ERR_INPUT}, {400, 60, 0, UINT32_MAX - 8, STATUS_ERR_INPUT},
        {65536, 65536, 65203, 65486, STATUS_OK}, {65537, 60, 0, 0, STATUS_ERR_INPUT},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct render_settings in = example_settings(), out;
        Azulejo__Wire__RenderSettings wire;

        in.whole_width = rows[i].whole_width;
        in.whole_height = rows[i].whole_height;
        in.region_x = rows[i].x;
        in.region_y = rows[i].y;
        wire_settings_set(&wire, &in);
        assert_int_equal(wire_settings_get(&out, &wire, 1, NULL), rows[i].expected);
    }
    assert_true(settings_have_pixel(&region, 67, 9) && settings_have_pixel(&region, 399, 58));
    assert_false(settings_have_pixel(&region, 66, 9) || settings_have_pixel(&region, 67, 8));
    assert_false(settings_have_pixel(&region, 400, 9) || settings_have_pixel(&region, 67, 59));
}

/* 0 is the camera's own on the wire, but a pinhole in the settings. */
static void test_settings_lens(void **state)
{
    static const float given[] = {-1, -2, 0, 0.5f}, expected[] = {-1, -1, 0, 0.5f};
    struct render_settings in = example_settings(), out;
    Azulejo__Wire__RenderSettings wire;

    (void)state;
    for (int i = 0; i < 4; i++) {
        in.lens_radius = given[i];
        wire_settings_set(&wire, &in);
        assert_int_equal(wire_settings_get(&out, &wire, 1, NULL), STATUS_OK);
        assert_true(out.lens_radius == expected[i]);
    }
}

/* Settings that were stored before there was any motion, lens or AOV. */
static void test_settings_of_old(void **state)
{
    Azulejo__Wire__RenderSettings wire = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    struct render_settings out, defaults;

    (void)state;
    render_settings_default(&defaults);
    wire.width = wire.height = 8;
    wire.spp = 1;
    assert_int_equal(wire_settings_get(&out, &wire, 1, NULL), STATUS_OK);
    assert_true(out.fps == defaults.fps && out.shutter == defaults.shutter);
    assert_true(out.lens_radius == defaults.lens_radius);
    assert_true(out.focus_distance == defaults.focus_distance);
    assert_true(out.without == 0 && out.aovs == 0);
    assert_true(out.sampler == defaults.sampler && out.light_choice == LIGHT_CHOICE_TREE);
    assert_true(out.texture_filter == defaults.texture_filter && out.clamp == 0);
    assert_true(out.bvh_quality == defaults.bvh_quality && !out.not_robust && !out.no_roulette);
}

static void test_settings_out_of_range(void **state)
{
    struct render_settings in = example_settings(), out;
    Azulejo__Wire__RenderSettings wire;

#define REFUSED(field, value, cameras)                                                     \
    do {                                                                                   \
        wire_settings_set(&wire, &in);                                                     \
        wire.field = (value);                                                              \
        memset(&out, 0xff, sizeof out);                                                    \
        assert_int_equal(wire_settings_get(&out, &wire, (cameras), NULL), STATUS_ERR_INPUT); \
        assert_int_equal(out.width, 0);                                                    \
    } while (0)
    (void)state;
    REFUSED(width, 0, 1);
    REFUSED(width, SETTINGS_SIZE_MAX + 1, 1);
    REFUSED(height, 0xffffffff, 1);
    REFUSED(spp, 0, 1);
    REFUSED(spp, SETTINGS_SPP_MAX + 1, 1);
    REFUSED(max_depth, SETTINGS_DEPTH_MAX + 1, 1);
    REFUSED(camera, 1, 1);
    REFUSED(env_rotate_deg, NAN, 1);
    REFUSED(env_strength, INFINITY, 1);
    REFUSED(env_strength, -1, 1);
    REFUSED(env_sampling, ENV_SAMPLING_COUNT, 1);
    REFUSED(env_sampling, 0xffffffff, 1);
    REFUSED(isa, ISA_COUNT, 1);
    REFUSED(isa, 0x80000000, 1);
    REFUSED(fps, NAN, 1);
    REFUSED(fps, -24, 1);
    REFUSED(fps, 1e6f, 1);
    REFUSED(shutter, NAN, 1);
    REFUSED(shutter, -0.1f, 1);
    REFUSED(shutter, 1.1f, 1);
    REFUSED(lens_radius, NAN, 1);
    REFUSED(sampler, SAMPLER_COUNT, 1);
    REFUSED(sampler, 0xffffffff, 1);
    REFUSED(light_choice, LIGHT_CHOICE_COUNT, 1);
    REFUSED(texture_filter, TEXTURE_FILTER_COUNT, 1);
    REFUSED(pixel_filter, PIXEL_FILTER_COUNT, 1);
    REFUSED(filter_width, NAN, 1);
    REFUSED(filter_width, 17, 1);
    REFUSED(filter_width, -1, 1);
    REFUSED(bvh_quality, BVH_QUALITY_COUNT, 1);
    REFUSED(not_robust, 0, 1); /* the quality is high */
    REFUSED(clamp, NAN, 1);
    REFUSED(clamp, -1, 1);
    REFUSED(clamp, INFINITY, 1);
    REFUSED(lens_radius, -1, 1);
    REFUSED(lens_radius, INFINITY, 1);
    REFUSED(pinhole, 1, 1); /* and a lens radius */
    REFUSED(focus_distance, NAN, 1);
    REFUSED(focus_distance, -1, 1);
    REFUSED(focus_distance, INFINITY, 1);
    REFUSED(without, UINT64_MAX, 1);
    REFUSED(without, EFFECTS_ALL + 1, 1);
    REFUSED(aovs, 1u << AOV_COUNT, 1);
    REFUSED(aovs, UINT32_MAX, 1);
#undef REFUSED
    assert_int_equal(wire_settings_get(&out, NULL, 1, NULL), STATUS_ERR_INPUT);
    wire_settings_set(&wire, &in);
    wire.camera = 7;
    assert_int_equal(wire_settings_get(&out, &wire, UINT32_MAX, NULL), STATUS_OK);
}

static void test_digest_lengths(void **state)
{
    struct digest d, out;
    ProtobufCBinaryData wire;

    (void)state;
    memset(&d, 7, sizeof d);
    wire_digest_set(&wire, &d);
    assert_int_equal(wire_digest_get(&out, &wire, "scene", NULL), STATUS_OK);
    assert_true(digest_equal(&d, &out));
    for (size_t length = 0; length < 100; length++) {
        uint8_t bytes[100] = {0};
        struct error err = {0};
        wire.data = bytes;
        wire.len = length;
        assert_int_equal(wire_digest_get(&out, &wire, "scene", &err),
                         length == DIGEST_BYTES ? STATUS_OK : STATUS_ERR_PROTOCOL);
        if (length != DIGEST_BYTES)
            assert_non_null(strstr(err.text, "scene"));
    }
}

static void test_units(void **state)
{
    struct render_settings s = example_settings(); /* 21 x 4 tiles; 100 spp are 8 passes of a group */

    (void)state;
    assert_int_equal(wire_unit_check(83, 1, 7, &s, NULL), STATUS_OK);
    assert_int_equal(wire_unit_check(84, 0, 0, &s, NULL), STATUS_ERR_PROTOCOL);
    assert_int_equal(wire_unit_check(0, 0, 8, &s, NULL), STATUS_ERR_PROTOCOL);
    assert_int_equal(wire_unit_check(0, GROUPS, 0, &s, NULL), STATUS_ERR_PROTOCOL);
    assert_int_equal(wire_unit_check(UINT32_MAX, UINT32_MAX, UINT32_MAX, &s, NULL), STATUS_ERR_PROTOCOL);
    s.spp = 1; /* the second group has none */
    assert_int_equal(wire_unit_check(0, 0, 0, &s, NULL), STATUS_OK);
    assert_int_equal(wire_unit_check(0, 1, 0, &s, NULL), STATUS_ERR_PROTOCOL);
    s.aovs = 0;
    assert_int_equal(wire_sums_count(&s, 0, 0, 0), 256 * 3);
    assert_int_equal(wire_sums_count(&s, 20, 1, 0), 13 * 16 * 3); /* right edge: 333 = 20 * 16 + 13 */
    assert_int_equal(wire_sums_count(&s, 83, 0, 1), 13 * 2 * 3);  /* corner: 50 = 3 * 16 + 2 */
    /* 1 and 3 floats more, the first in one unit only; samples and error are not sent. */
    s.aovs = 1u << AOV_DEPTH | 1u << AOV_NORMAL | 1u << AOV_SAMPLES | 1u << AOV_ERROR;
    assert_int_equal(wire_sums_count(&s, 83, 0, 0), 13 * 2 * (3 + 4));
    assert_int_equal(wire_sums_count(&s, 83, 1, 0), 13 * 2 * (3 + 3));
    assert_int_equal(wire_sums_count(&s, 83, 0, 1), 13 * 2 * (3 + 3));
    s.aovs = (1u << AOV_COUNT) - 1;
    assert_int_equal(wire_sums_count(&s, 0, 0, 0), TILE_FLOATS_MAX);
}

/* A RenderRequest names one unit, or samples that one pixel has; a path is of one sample. */
static void test_piece_check(void **state)
{
    struct render_settings s = example_settings();
    Azulejo__Wire__RenderRequest request = AZULEJO__WIRE__RENDER_REQUEST__INIT;
    Azulejo__Wire__PixelSamples pixel = AZULEJO__WIRE__PIXEL_SAMPLES__INIT;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;

    (void)state;
    s.width = 36;
    s.height = 20;
    s.whole_width = s.whole_height = s.region_x = s.region_y = 0;
    s.spp = PIXEL_SAMPLES_MAX + 1;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_PROTOCOL);
    request.unit = &unit;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_OK);
    unit.group = GROUPS;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_PROTOCOL);
    unit.group = 0;
    request.pixel = &pixel;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_PROTOCOL);
    request.unit = NULL;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_LIMIT);
    pixel.count = PIXEL_SAMPLES_MAX;
    pixel.first = 1;
    pixel.x = 35;
    pixel.y = 19;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_OK);
    pixel.first = 2;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_INPUT);
    pixel.first = UINT32_MAX;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_INPUT);
    pixel.first = 0;
    pixel.path = 1;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_LIMIT);
    pixel.count = 1;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_OK);
    pixel.x = 36;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_INPUT);
    pixel.x = 35;
    pixel.y = 20;
    assert_int_equal(wire_piece_check(&request, &s, NULL), STATUS_ERR_INPUT);
}

static void test_results(void **state)
{
    const float in[2] = {1, 0.5f};
    const uint8_t floats[] = {0, 0, 0x80, 0x3f, 0, 0, 0, 0x3f}, entry[] = {0, 0, 0x80, 0x3f, 7, 1, 0, 0};
    struct unit_work work = {.clamped_luminance = 8.5, .kept_luminance = 9, .depth = {{1, 2, 3, 0, 1e300}}};
    struct wire_work message;
    struct unit_work back;
    const float *out;
    size_t floats_count;
    ProtobufCBinaryData wire;
    struct tail tail = {.count = 0}, got;

    (void)state;
    wire_sums_set(&wire, in, 2);
    assert_int_equal(wire.len, sizeof floats);
    assert_memory_equal(wire.data, floats, sizeof floats);
    assert_int_equal(wire_sums_get(&out, &floats_count, &wire, NULL), STATUS_OK);
    assert_true(floats_count == 2 && memcmp(out, in, sizeof in) == 0);
    wire.len -= 1;
    assert_int_equal(wire_sums_get(&out, &floats_count, &wire, NULL), STATUS_ERR_PROTOCOL);
    wire.len = (TILE_FLOATS_MAX + 1) * sizeof *in;
    assert_int_equal(wire_sums_get(&out, &floats_count, &wire, NULL), STATUS_ERR_PROTOCOL);
    wire_tail_set(&wire, &tail);
    assert_int_equal(wire.len, 0);
    tail_add(&tail, 1, 263);
    wire_tail_set(&wire, &tail);
    assert_int_equal(wire.len, WIRE_TAIL_ENTRY_BYTES);
    assert_memory_equal(wire.data, entry, sizeof entry);
    for (uint32_t i = 0; i < 20; i++)
        tail_add(&tail, 2 + (float)i, i);
    wire_tail_set(&wire, &tail);
    assert_int_equal(wire.len, TAIL_MAX * WIRE_TAIL_ENTRY_BYTES);
    assert_int_equal(wire_tail_get(&got, &wire, NULL), STATUS_OK);
    assert_int_equal(got.count, TAIL_MAX);
    assert_memory_equal(got.entries, tail.entries, sizeof tail.entries);
    wire.len -= 1;
    assert_int_equal(wire_tail_get(&got, &wire, NULL), STATUS_ERR_PROTOCOL);
    assert_int_equal(got.count, 0);
    wire.len = (TAIL_MAX + 1) * WIRE_TAIL_ENTRY_BYTES;
    assert_int_equal(wire_tail_get(&got, &wire, NULL), STATUS_ERR_PROTOCOL);
    for (uint64_t i = 0; i < WORK_COUNTER_COUNT; i++)
        work.count[i] = (i + 1) << 40;
    assert_int_equal(wire_work_get(&back, wire_work_set(&message, &work), NULL), STATUS_OK);
    assert_memory_equal(&back, &work, sizeof work);
    for (size_t count = 1; count < DEPTH_SUMS; count++) {
        message.message.n_depth = count;
        assert_int_equal(wire_work_get(&back, &message.message, NULL), STATUS_ERR_PROTOCOL);
    }
    message.message.n_depth = 0; /* of an older store's frame */
    assert_int_equal(wire_work_get(&back, &message.message, NULL), STATUS_OK);
    assert_false(depth_light_is_known(&back.depth));
    assert_int_equal(wire_work_get(&back, NULL, NULL), STATUS_OK);
    assert_int_equal(back.samples, 0);
    assert_int_equal(wire_work_set(&message, &back)->n_depth, 0);
}

/* Every counter by itself and all at once, with the example's ends; counters that cannot be. */
static void health_survives_the_wire(void **state)
{
    const struct health_place last = {PASSES_MAX - 1, (1u << HEALTH_TILE_BITS) - 1,
                                      TILE_PIXELS_MAX - 1, SETTINGS_SPP_MAX - 1};
    struct unit_work work = {.samples = 1}, back;
    struct wire_work wire;
    Azulejo__Wire__Work *message;

    (void)state;
    for (int k = 0; k < HEALTH_KINDS; k++) {
        struct unit_work one = {.samples = 1};
        one.health.count[k] = work.health.count[k] = UINT64_MAX - (uint64_t)k;
        one.health.first[k] = work.health.first[k] = health_key(k % 2 ? last : (struct health_place){0});
        one.health.frame[k] = work.health.frame[k] = (uint32_t)k;
        message = wire_work_set(&wire, &one);
        assert_int_equal(message->n_health, 1);
        assert_int_equal(wire_work_get(&back, message, NULL), STATUS_OK);
        assert_memory_equal(&back, &one, sizeof one);
    }
    message = wire_work_set(&wire, &work);
    assert_int_equal(wire_work_get(&back, message, NULL), STATUS_OK);
    assert_memory_equal(&back, &work, sizeof work);
#define REFUSED(change)                                                             \
    do {                                                                            \
        message = wire_work_set(&wire, &work);                                      \
        change;                                                                     \
        assert_int_equal(wire_work_get(&back, message, NULL), STATUS_ERR_PROTOCOL); \
    } while (0)
    REFUSED(wire.health[0].count = 0);
    REFUSED(wire.health[HEALTH_KINDS - 1].kind = HEALTH_KINDS);
    REFUSED(wire.health[1].kind = 0); /* twice */
    REFUSED(wire.health[1].first = UINT64_MAX);
    REFUSED(wire.health[1].first = health_key((struct health_place){.pass = PASSES_MAX}));
#undef REFUSED
}

static void check_piece(const uint8_t *raw, size_t size, int compresses)
{
    struct buffer scratch = BUFFER_INIT;
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    struct digest digest = {{1}};
    struct blob_piece piece;
    uint8_t *back = malloc(size + 1);

    assert_non_null(back);
    wire_digest_set(&put.digest, &digest);
    put.total_bytes = size;
    put.raw_bytes = (uint32_t)size;
    assert_int_equal(blob_piece_pack(raw, size, &scratch, &put.data, &put.zstd, NULL), STATUS_OK);
    assert_int_equal(put.zstd, compresses);
    assert_true(compresses ? put.data.len < size : put.data.len == size);
    assert_int_equal(blob_piece_of_put(&piece, &put, NULL), STATUS_OK);
    assert_int_equal(blob_piece_unpack(&piece, back, NULL), STATUS_OK);
    assert_memory_equal(back, raw, size);
    /* Every damage of a compressed piece is seen, or yields bytes of the same length, which
     * the blob's digest then refuses; never more than raw_bytes are written. */
    if (compresses) {
        struct buffer bent = BUFFER_INIT;
        for (size_t at = 0; at < put.data.len && at < 64; at++) {
            buffer_clear(&bent);
            buffer_append(&bent, put.data.data, put.data.len);
            bent.data[at] ^= 0x55;
            piece.data.data = bent.data;
            back[size] = 0xee;
            (void)!blob_piece_unpack(&piece, back, NULL);
            assert_int_equal(back[size], 0xee);
        }
        piece.data = put.data;
        piece.raw_bytes--; /* longer than it says */
        assert_int_equal(blob_piece_unpack(&piece, back, NULL), STATUS_ERR_PROTOCOL);
        piece.raw_bytes += 2; /* shorter than it says */
        {
            uint8_t *more = malloc(piece.raw_bytes);
            assert_non_null(more);
            assert_int_equal(blob_piece_unpack(&piece, more, NULL), STATUS_ERR_PROTOCOL);
            free(more);
        }
        buffer_release(&bent);
    }
    free(back);
    buffer_release(&scratch);
}

static void test_blob_pieces(void **state)
{
    uint8_t *raw = malloc(BLOB_PIECE_BYTES);
    uint32_t random = 1;

    (void)state;
    assert_non_null(raw);
    memset(raw, 0, BLOB_PIECE_BYTES);
    check_piece(raw, BLOB_PIECE_BYTES, 1);
    check_piece(raw, 1000, 1);
    check_piece(raw, 1, 0);
    check_piece(raw, 0, 0);
    for (size_t i = 0; i < BLOB_PIECE_BYTES; i++) {
        random = random * 1664525 + 1013904223;
        raw[i] = (uint8_t)(random >> 24);
    }
    check_piece(raw, BLOB_PIECE_BYTES, 0);
    free(raw);
}

static void test_pieces_that_do_not_fit(void **state)
{
    static const struct {
        uint64_t total, offset;
        uint32_t raw;
        size_t sent;
        int zstd;
    } bad[] = {
        {10, 5, 6, 6, 0},           /* over the end */
        {10, 11, 0, 0, 0},          /* begins after the end */
        {10, UINT64_MAX, 1, 1, 0},  /* wraps around */
        {10, 0, 0, 0, 0},           /* goes nowhere */
        {UINT64_MAX, 0, 10, 10, 0}, /* too large a blob */
        {1 << 30, 0, BLOB_PIECE_BYTES + 1, BLOB_PIECE_BYTES + 1, 0},
        {10, 0, 10, 9, 0},       /* not as many as it says */
        {10, 0, 10, 1 << 20, 1}, /* "compressed" to a megabyte */
    };
    static uint8_t bytes[1 << 20];
    struct digest digest = {{1}};
    struct blob_piece piece;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        Azulejo__Wire__BlobData data = AZULEJO__WIRE__BLOB_DATA__INIT;
        wire_digest_set(&data.digest, &digest);
        data.total_bytes = bad[i].total;
        data.offset = bad[i].offset;
        data.raw_bytes = bad[i].raw;
        data.zstd = bad[i].zstd;
        data.data.data = bytes;
        data.data.len = bad[i].sent;
        assert_int_equal(blob_piece_of_data(&piece, &data, NULL), STATUS_ERR_PROTOCOL);
        assert_int_equal(piece.raw_bytes, 0);
    }
    assert_int_equal(blob_piece_size(100, 40), 60);
    assert_int_equal(blob_piece_size(1ull << 40, 0), BLOB_PIECE_BYTES);
}

static void test_text_is_cleaned(void **state)
{
    char out[16];

    (void)state;
    assert_string_equal(message_text(out, sizeof out, "plain"), "plain");
    assert_string_equal(message_text(out, sizeof out, "a\x1b[31m\nb\x7f"), "a?[31m?b?");
    assert_string_equal(message_text(out, sizeof out, "caf\xc3\xa9 \xff\xc3"), "caf\xc3\xa9 ??");
    assert_string_equal(message_text(out, sizeof out, "\xc2\x9b\xe2\x82\xac"), "?\xe2\x82\xac");
    assert_string_equal(message_text(out, sizeof out, "\xed\xa0\x80"), "???"); /* a surrogate */
    assert_string_equal(message_text(out, sizeof out, "0123456789abcdefg"), "0123456789abcde");
    assert_string_equal(message_text(out, sizeof out, "a\xe2\x80\xae" "b\xe2\x81\xa9"), "a?b?"); /* text turned around */
    assert_string_equal(message_text(out, sizeof out, "\xe2\x80\xa6\xe2\x80\x8b"), "\xe2\x80\xa6\xe2\x80\x8b");
    /* No half character at the end. */
    assert_string_equal(message_text(out, 4, "ab\xc3\xa9"), "ab");
    assert_string_equal(message_text(out, 5, "ab\xc3\xa9"), "ab\xc3\xa9");
}

static void test_failure_codes(void **state)
{
    Azulejo__Wire__Failure f = AZULEJO__WIRE__FAILURE__INIT;
    struct error err;

    (void)state;
    f.code = STATUS_ERR_NOT_FOUND;
    f.text = (char *)"no\nsuch blob";
    assert_int_equal(message_failure_get(&f, &err), STATUS_ERR_NOT_FOUND);
    assert_string_equal(err.text, "no?such blob");
    f.text = (char *)"";
    assert_int_equal(message_failure_get(&f, &err), STATUS_ERR_NOT_FOUND);
    assert_string_equal(err.text, status_text(STATUS_ERR_NOT_FOUND));
    f.code = STATUS_OK;
    assert_int_equal(message_failure_get(&f, &err), STATUS_ERR_PROTOCOL);
    f.code = 0xffffffff;
    assert_int_equal(message_failure_get(&f, &err), STATUS_ERR_PROTOCOL);
}

static void test_hello_and_welcome(void **state)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Welcome welcome = AZULEJO__WIRE__WELCOME__INIT;

    (void)state;
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = AZULEJO__WIRE__ROLE__ROLE_WORKER;
    assert_int_equal(hello_check(&hello, FARM_ROLE_WORKER, NULL), STATUS_OK);
    assert_int_equal(hello_check(&hello, FARM_ROLE_CLIENT, NULL), STATUS_ERR_REFUSED);
    hello.protocol_version++;
    assert_int_equal(hello_check(&hello, FARM_ROLE_WORKER, NULL), STATUS_ERR_UNSUPPORTED);
    welcome.protocol_version = PROTOCOL_VERSION;
    welcome.heartbeat_ms = 2000;
    welcome.silence_limit_ms = 10000;
    assert_int_equal(welcome_check(&welcome, NULL), STATUS_OK);
    welcome.silence_limit_ms = 1999;
    assert_int_equal(welcome_check(&welcome, NULL), STATUS_ERR_PROTOCOL);
    welcome.heartbeat_ms = 0;
    assert_int_equal(welcome_check(&welcome, NULL), STATUS_ERR_PROTOCOL);
    welcome.heartbeat_ms = welcome.silence_limit_ms = UINT32_MAX;
    assert_int_equal(welcome_check(&welcome, NULL), STATUS_ERR_PROTOCOL);
    welcome.protocol_version = 0;
    assert_int_equal(welcome_check(&welcome, NULL), STATUS_ERR_UNSUPPORTED);
}

/* A grant of many empty units is 2 bytes a unit on the wire and some 50 in memory. */
static void test_unpacking_has_a_budget(void **state)
{
    enum { UNITS = 1900000 };
    uint8_t *wire = malloc(16 + 2 * UNITS);
    size_t inner = 2 * (size_t)UNITS, at = 0;
    Azulejo__Wire__Envelope *e;
    struct error err = {0};

    (void)state;
    assert_non_null(wire);
    wire[at++] = 0xaa; /* field 21, length-delimited */
    wire[at++] = 0x01;
    for (size_t rest = inner;; rest >>= 7) {
        wire[at++] = (uint8_t)(rest & 0x7f) | (rest > 0x7f ? 0x80 : 0);
        if (rest <= 0x7f)
            break;
    }
    for (size_t i = 0; i < UNITS; i++) {
        wire[at++] = 0x42; /* field 8, length-delimited, empty */
        wire[at++] = 0;
    }
    assert_true(at < CHANNEL_FRAME_MAX);
    assert_int_equal(message_unpack(&e, wire, at, &err), STATUS_ERR_LIMIT);
    assert_null(e);
    free(wire);
}

static void test_unpack_damaged(void **state)
{
    Azulejo__Wire__LeaseGrant grant = AZULEJO__WIRE__LEASE_GRANT__INIT;
    Azulejo__Wire__Envelope in = MESSAGE(LEASE_GRANT, lease_grant, &grant), *out;
    Azulejo__Wire__RenderSettings settings;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
    Azulejo__Wire__WorkUnit *units[3] = {&unit, &unit, &unit};
    struct render_settings s = example_settings();
    uint8_t wire[512], cut[512];
    size_t size;

    (void)state;
    wire_settings_set(&settings, &s);
    grant.settings = &settings;
    grant.units = units;
    grant.n_units = 3;
    unit.tile = 300;
    in.request = 5;
    size = azulejo__wire__envelope__pack(&in, wire);
    assert_true(size < sizeof wire);
    assert_int_equal(message_unpack(&out, wire, size, NULL), STATUS_OK);
    assert_string_equal(message_name(out), "lease_grant");
    assert_int_equal(out->request, 5);
    assert_int_equal(out->lease_grant->n_units, 3);
    message_free(out);
    /* Cut short and bent at every byte: an error or another message, never a crash. */
    for (size_t at = 0; at < size; at++) {
        if (message_unpack(&out, wire, at, NULL) == STATUS_OK)
            message_free(out);
        for (int bit = 0; bit < 8; bit++) {
            memcpy(cut, wire, size);
            cut[at] ^= (uint8_t)(1 << bit);
            if (message_unpack(&out, cut, size, NULL) == STATUS_OK)
                message_free(out);
        }
    }
    /* Out of memory at each allocation in turn. */
    for (long n = 0;; n++) {
        status result;
        long failed;
        mem_fault_arm(n, 1);
        result = message_unpack(&out, wire, size, NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (result == STATUS_OK) {
            message_free(out);
            assert_int_equal(failed, 0);
            assert_true(n > 5);
            break;
        }
        assert_int_equal(result, STATUS_ERR_NO_MEMORY);
    }
    /* A later version's message: known to be unknown. */
    const uint8_t unknown[] = {0x08, 0x01, 0xfa, 0x3f, 0x00};
    assert_int_equal(message_unpack(&out, unknown, sizeof unknown, NULL), STATUS_OK);
    assert_string_equal(message_name(out), "none");
    message_free(out);
}

/* An audit compares it with that of a TileResult's bytes. */
static void test_unit_digest(void **state)
{
    const float sums[] = {1, 2.5f, -0.0f, 3e38f};
    struct unit_result unit = {.tile = 3, .group = 1, .pass = 2, .sums = sums, .count = 4};
    uint8_t bytes[1024];
    ProtobufCBinaryData tail;
    struct digest got, expected;
    struct wire_work wire;
    size_t size = sizeof sums;

    (void)state;
    tail_add(&unit.tail, 7, 11);
    tail_add(&unit.tail, 9, 12);
    unit.work.samples = 512;
    unit.work.rays = 77;
    unit.work.health.count[HEALTH_LOST_BODIES] = 2;
    unit.work.health.first[HEALTH_LOST_BODIES] = health_key((struct health_place){1, 2, 3, 4});
    memcpy(bytes, sums, size);
    wire_tail_set(&tail, &unit.tail);
    assert_int_equal(tail.len, 2 * WIRE_TAIL_ENTRY_BYTES);
    memcpy(bytes + size, tail.data, tail.len);
    size += tail.len;
    size += azulejo__wire__work__pack(wire_work_set(&wire, &unit.work), bytes + size);
    assert_int_equal(digest_of(&expected, bytes, size), STATUS_OK);
    assert_int_equal(wire_unit_digest(&got, &unit, NULL), STATUS_OK);
    assert_true(digest_equal(&got, &expected));
    unit.work.health.count[HEALTH_LOST_BODIES]++;
    assert_int_equal(wire_unit_digest(&got, &unit, NULL), STATUS_OK);
    assert_false(digest_equal(&got, &expected));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_settings_round_trip),
        cmocka_unit_test(test_settings_lens),
        cmocka_unit_test(test_settings_region),
        cmocka_unit_test(test_settings_of_old),
        cmocka_unit_test(test_settings_out_of_range),
        cmocka_unit_test(test_digest_lengths),
        cmocka_unit_test(test_units),
        cmocka_unit_test(test_piece_check),
        cmocka_unit_test(test_results),
        cmocka_unit_test(health_survives_the_wire),
        cmocka_unit_test(test_blob_pieces),
        cmocka_unit_test(test_pieces_that_do_not_fit),
        cmocka_unit_test(test_text_is_cleaned),
        cmocka_unit_test(test_failure_codes),
        cmocka_unit_test(test_hello_and_welcome),
        cmocka_unit_test(test_unpacking_has_a_budget),
        cmocka_unit_test(test_unpack_damaged),
        cmocka_unit_test(test_unit_digest),
    };
    return cmocka_run_group_tests_name("message", tests, NULL, NULL);
}
