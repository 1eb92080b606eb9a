/* Who may stay and whose handshake comes next, with crowds that are simulated. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "coordinator/net/admission.h"

enum { PLACES = 100, CROWD = 5000 };

static struct admission a;
static struct admission_place crowd[CROWD];

static int set_up(void **state)
{
    (void)state;
    admission_init(&a, PLACES);
    memset(crowd, 0, sizeof crowd);
    return 0;
}

/* 10.x.y.z for an IPv4 address number. */
static void address_of(uint32_t number, uint8_t bytes[ADMISSION_ADDRESS_BYTES])
{
    memset(bytes, 0, ADMISSION_ADDRESS_BYTES);
    bytes[10] = bytes[11] = 0xff;
    bytes[12] = 10;
    bytes[13] = (uint8_t)(number >> 16);
    bytes[14] = (uint8_t)(number >> 8);
    bytes[15] = (uint8_t)number;
}

/* The place that went; NULL: none. */
static struct admission_place *enter(uint32_t index, uint32_t address)
{
    uint8_t bytes[ADMISSION_ADDRESS_BYTES];
    struct admission_place *out = NULL;

    address_of(address, bytes);
    assert_int_equal(admission_enter(&a, &crowd[index], bytes, &out, NULL), STATUS_OK);
    assert_true(a.places <= PLACES);
    if (out)
        assert_int_equal(out->stage, ADMISSION_OUTSIDE);
    return out;
}

static void enter_ready(uint32_t index, uint32_t address)
{
    assert_null(enter(index, address));
    admission_ready(&a, &crowd[index]);
}

static int tear_down(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < CROWD; i++)
        admission_leave(&a, &crowd[i]);
    assert_int_equal(a.places, 0);
    assert_int_equal(a.shaking, 0);
    assert_int_equal(a.ready, 0);
    assert_null(a.first);
    for (uint32_t i = 0; i < ADMISSION_BUCKETS; i++)
        assert_null(a.buckets[i]);
    return 0;
}

static void test_no_handshake_before_the_record(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 10; i++)
        assert_null(enter(i, 1));
    assert_null(admission_next(&a));
    admission_ready(&a, &crowd[7]);
    admission_ready(&a, &crowd[7]);
    assert_ptr_equal(admission_next(&a), &crowd[7]);
    assert_null(admission_next(&a));
}

static void test_first_come_first_served(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 10; i++)
        assert_null(enter(i, 1));
    for (uint32_t i = 0; i < 10; i++)
        admission_ready(&a, &crowd[9 - i]);
    for (uint32_t i = 0; i < 10; i++)
        assert_ptr_equal(admission_next(&a), &crowd[9 - i]);
}

/* An address holds at most half of the handshakes, so another finds some free at once. */
static void test_half_of_the_handshakes(void **state)
{
    uint32_t begun = 0;

    (void)state;
    for (uint32_t i = 0; i < 80; i++)
        enter_ready(i, 1);
    while (admission_next(&a))
        begun++;
    assert_int_equal(begun, ADMISSION_ADDRESS_HANDSHAKES_MAX);
    enter_ready(80, 2);
    assert_ptr_equal(admission_next(&a), &crowd[80]);
    /* One that ends makes way for the next, in order. */
    admission_leave(&a, &crowd[3]);
    assert_ptr_equal(admission_next(&a), &crowd[ADMISSION_ADDRESS_HANDSHAKES_MAX]);
    admission_refused(&a, &crowd[4]);
    assert_ptr_equal(admission_next(&a), &crowd[ADMISSION_ADDRESS_HANDSHAKES_MAX + 1]);
    assert_null(admission_next(&a));
}

static void test_all_handshakes(void **state)
{
    uint32_t begun = 0;

    (void)state;
    for (uint32_t i = 0; i < 100; i++)
        enter_ready(i, i % 10);
    while (admission_next(&a))
        begun++;
    assert_int_equal(begun, ADMISSION_HANDSHAKES_MAX);
    assert_int_equal(a.shaking, ADMISSION_HANDSHAKES_MAX);
}

/* One address with a long line does not hold up another's first. */
static void test_addresses_take_turns(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 50; i++)
        enter_ready(i, 1);
    enter_ready(50, 2);
    enter_ready(51, 2);
    enter_ready(52, 3);
    assert_ptr_equal(admission_next(&a), &crowd[0]);
    assert_ptr_equal(admission_next(&a), &crowd[50]);
    assert_ptr_equal(admission_next(&a), &crowd[52]);
    assert_ptr_equal(admission_next(&a), &crowd[1]);
    assert_ptr_equal(admission_next(&a), &crowd[51]);
    assert_ptr_equal(admission_next(&a), &crowd[2]);
}

/* All 5,000 of one machine get in: when nobody else waits, it may have every place. */
static void test_one_machine_alone(void **state)
{
    uint32_t next = 0, through = 0;

    (void)state;
    while (through < CROWD) {
        struct admission_place *place;
        while (next < CROWD && a.places < PLACES)
            enter_ready(next++, 1);
        place = admission_next(&a);
        assert_non_null(place);
        admission_leave(&a, place);
        through++;
    }
}

static void test_oldest_silent_makes_room(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLACES; i++)
        assert_null(enter(i, i % 5));
    admission_ready(&a, &crowd[0]);
    assert_ptr_equal(enter(100, 9), &crowd[1]); /* of an address with the most places */
    assert_ptr_equal(enter(101, 9), &crowd[2]);
}

/* A refused one that lingers is as good as silent. */
static void test_refused_makes_room(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLACES; i++)
        enter_ready(i, i % 5);
    assert_ptr_equal(admission_next(&a), &crowd[0]);
    admission_refused(&a, &crowd[0]);
    assert_ptr_equal(enter(100, 9), &crowd[0]);
    assert_ptr_equal(enter(101, 9), &crowd[100]); /* all others are ready, none has the half */
}

/* A crowd of one address takes all places; another's newcomer finds one, and keeps it. */
static void test_half_of_the_places(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < PLACES; i++)
        enter_ready(i, 1);
    assert_ptr_equal(enter(100, 2), &crowd[99]); /* the newest that is ready */
    for (uint32_t i = 101; i < 1000; i++)        /* the crowd comes again and again */
        assert_ptr_equal(enter(i, 1), &crowd[i]);
    assert_int_equal(crowd[100].stage, ADMISSION_SILENT);
    admission_ready(&a, &crowd[100]);
    assert_ptr_equal(admission_next(&a), &crowd[0]);
    assert_ptr_equal(admission_next(&a), &crowd[100]);
}

/* Silent ones that come faster than they are dropped push out their own kind. */
static void test_flood_of_silence(void **state)
{
    (void)state;
    assert_null(enter(0, 2));
    for (uint32_t i = 1; i < CROWD; i++) {
        struct admission_place *out = enter(i, 1);
        assert_ptr_equal(out, i < PLACES ? NULL : &crowd[i - PLACES + 1]);
    }
    assert_int_equal(crowd[0].stage, ADMISSION_SILENT);
}

static void test_handshakes_keep_their_places(void **state)
{
    (void)state;
    admission_init(&a, 10);
    for (uint32_t i = 0; i < 10; i++)
        enter_ready(i, 1);
    while (admission_next(&a))
        ;
    assert_ptr_equal(enter(10, 2), &crowd[10]);
    for (uint32_t i = 0; i < 10; i++)
        assert_int_equal(crowd[i].stage, ADMISSION_SHAKING);
}

/* An IPv6 network of 64 bits is one address; IPv4 addresses are all their own. */
static void test_addresses(void **state)
{
    uint8_t six[ADMISSION_ADDRESS_BYTES] = {0x20, 0x01, 0x0d, 0xb8, 0, 0, 0, 1};
    struct admission_place *out;

    (void)state;
    for (uint32_t i = 0; i < 4; i++) {
        six[15] = (uint8_t)i;
        assert_int_equal(admission_enter(&a, &crowd[i], six, &out, NULL), STATUS_OK);
    }
    assert_ptr_equal(crowd[0].address, crowd[3].address);
    six[7] = 2;
    assert_int_equal(admission_enter(&a, &crowd[4], six, &out, NULL), STATUS_OK);
    assert_ptr_not_equal(crowd[0].address, crowd[4].address);
    assert_null(enter(5, 1));
    assert_null(enter(6, 2));
    assert_ptr_not_equal(crowd[5].address, crowd[6].address);
}

/* Fewer places than before: newcomers go or push out others, until it fits. */
static void test_fewer_places(void **state)
{
    uint8_t bytes[ADMISSION_ADDRESS_BYTES];
    struct admission_place *out;

    (void)state;
    for (uint32_t i = 0; i < 50; i++)
        assert_null(enter(i, 1));
    a.places_max = 20;
    address_of(2, bytes);
    assert_int_equal(admission_enter(&a, &crowd[50], bytes, &out, NULL), STATUS_OK);
    assert_ptr_equal(out, &crowd[0]);
    assert_int_equal(a.places, 50);
}

static void test_out_of_memory(void **state)
{
    uint8_t bytes[ADMISSION_ADDRESS_BYTES];
    struct admission_place *out;

    (void)state;
    address_of(1, bytes);
    mem_fault_arm(0, 1);
    assert_int_equal(admission_enter(&a, &crowd[0], bytes, &out, NULL), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_int_equal(crowd[0].stage, ADMISSION_OUTSIDE);
    assert_int_equal(a.places, 0);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_no_handshake_before_the_record),
        TEST(test_first_come_first_served),
        TEST(test_half_of_the_handshakes),
        TEST(test_all_handshakes),
        TEST(test_addresses_take_turns),
        TEST(test_one_machine_alone),
        TEST(test_oldest_silent_makes_room),
        TEST(test_refused_makes_room),
        TEST(test_half_of_the_places),
        TEST(test_flood_of_silence),
        TEST(test_handshakes_keep_their_places),
        TEST(test_addresses),
        TEST(test_fewer_places),
        TEST(test_out_of_memory),
    };
    return cmocka_run_group_tests_name("admission", tests, NULL, NULL);
}
