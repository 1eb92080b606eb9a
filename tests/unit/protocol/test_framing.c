/* Framing: pieces of any size, limits, and nothing allocated for a length that lies. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "protocol/framing.h"

enum { LIMIT = 1000 };

static void put_frame(struct buffer *out, const void *data, uint32_t size)
{
    uint8_t header[FRAME_HEADER_BYTES];

    framing_header_write(header, size);
    buffer_append(out, header, sizeof header);
    buffer_append(out, data, size);
}

static void test_header_is_little_endian(void **state)
{
    uint8_t header[FRAME_HEADER_BYTES];
    const uint8_t expected[] = {0x04, 0x03, 0x02, 0x01};

    (void)state;
    framing_header_write(header, 0x01020304);
    assert_memory_equal(header, expected, sizeof header);
}

/* Three frames, cut in two at every byte, and then byte by byte. */
static void test_split_at_every_byte(void **state)
{
    static const char *const texts[] = {"a", "the second frame", "third"};
    struct buffer wire = BUFFER_INIT;

    (void)state;
    for (int i = 0; i < 3; i++)
        put_frame(&wire, texts[i], (uint32_t)strlen(texts[i]));
    for (size_t cut = 0; cut <= wire.size + 1; cut++) {
        struct framing_reader r;
        size_t at = 0;
        int seen = 0;
        framing_reader_init(&r, LIMIT);
        while (at < wire.size) {
            /* cut == size + 1: one byte at a time */
            size_t end = cut > wire.size ? at + 1 : at < cut ? cut : wire.size;
            const uint8_t *payload;
            size_t size;
            assert_int_equal(framing_reader_push(&r, wire.data + at, end - at, NULL), STATUS_OK);
            at = end;
            for (;;) {
                assert_int_equal(framing_reader_next(&r, &payload, &size, NULL), STATUS_OK);
                if (!payload)
                    break;
                assert_true(seen < 3);
                assert_int_equal(size, strlen(texts[seen]));
                assert_memory_equal(payload, texts[seen], size);
                seen++;
            }
        }
        assert_int_equal(seen, 3);
        assert_int_equal(framing_reader_waiting(&r), 0);
        framing_reader_release(&r);
    }
    buffer_release(&wire);
}

static status feed_length(struct framing_reader *r, uint32_t length, struct error *err)
{
    uint8_t header[FRAME_HEADER_BYTES];
    const uint8_t *payload;
    size_t size;

    framing_header_write(header, length);
    assert_int_equal(framing_reader_push(r, header, sizeof header, NULL), STATUS_OK);
    return framing_reader_next(r, &payload, &size, err);
}

static void test_lengths_out_of_range(void **state)
{
    const uint32_t bad[] = {0, LIMIT + 1, 0x7fffffff, 0x80000000, 0xffffffff};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct framing_reader r;
        struct error err = {0};
        const uint8_t *payload = (const uint8_t *)"";
        size_t size;
        framing_reader_init(&r, LIMIT);
        assert_int_equal(feed_length(&r, bad[i], &err), STATUS_ERR_PROTOCOL);
        assert_non_null(strstr(err.text, "1..1000"));
        assert_true(r.bytes.capacity < 4096);
        /* It stays refused. */
        assert_int_equal(framing_reader_next(&r, &payload, &size, NULL), STATUS_ERR_PROTOCOL);
        assert_null(payload);
        framing_reader_release(&r);
    }
}

static void test_largest_frame(void **state)
{
    struct framing_reader r;
    uint8_t data[LIMIT];
    const uint8_t *payload;
    size_t size;

    (void)state;
    memset(data, 0xab, sizeof data);
    framing_reader_init(&r, LIMIT);
    assert_int_equal(feed_length(&r, LIMIT, NULL), STATUS_OK);
    assert_int_equal(framing_reader_waiting(&r), FRAME_HEADER_BYTES);
    assert_int_equal(framing_reader_push(&r, data, sizeof data, NULL), STATUS_OK);
    assert_int_equal(framing_reader_next(&r, &payload, &size, NULL), STATUS_OK);
    assert_int_equal(size, LIMIT);
    assert_memory_equal(payload, data, LIMIT);
    framing_reader_release(&r);
}

static void test_out_of_memory(void **state)
{
    struct framing_reader r;
    uint8_t data[100] = {0};

    (void)state;
    framing_reader_init(&r, LIMIT);
    mem_fault_arm(0, 1);
    assert_int_equal(framing_reader_push(&r, data, sizeof data, NULL), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    framing_reader_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_header_is_little_endian), cmocka_unit_test(test_split_at_every_byte),
        cmocka_unit_test(test_lengths_out_of_range),    cmocka_unit_test(test_largest_frame),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests_name("frame", tests, NULL, NULL);
}
