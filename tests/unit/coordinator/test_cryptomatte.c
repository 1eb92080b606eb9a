/* Ids, keys, the manifest and ranks, against the specification's examples and by hand. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/pictures/cryptomatte.h"

static float float_of(uint32_t bits)
{
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Examples of the specification, and of MurmurHash3's lengths modulo 4. */
static void hashes_are_murmurs(void **state)
{
    (void)state;
    assert_int_equal(cryptomatte_hash("torus"), 4053562365u);
    assert_float_equal(float_of(cryptomatte_id("torus")) / -1.54943624832e+30f, 1, 1e-6);
    assert_int_equal(cryptomatte_hash("\xd1\x80\xd0\xb0\xd0\xb2\xd0\xbd\xd0\xb8\xd0\xbd\xd0\xb0"), 2518896926u);
    assert_int_equal(cryptomatte_hash(""), 0);
    assert_int_equal(cryptomatte_hash("test"), 0xba6bd213u);
    assert_int_equal(cryptomatte_hash("Hello, world!"), 0xc0363e43u);
    assert_int_equal(cryptomatte_hash("The quick brown fox jumps over the lazy dog"), 0x2e4ff723u);
}

/* No id is 0, infinite, not a number or so small that a processor may flush it to 0. */
static void ids_are_normal_numbers(void **state)
{
    char name[16];
    int flipped = 0;

    (void)state;
    for (int i = 0; i < 20000; i++) {
        snprintf(name, sizeof name, "%d", i);
        assert_true(isnormal(float_of(cryptomatte_id(name))));
        if (cryptomatte_id(name) != cryptomatte_hash(name)) {
            assert_int_equal(cryptomatte_id(name) ^ cryptomatte_hash(name), 1u << 23);
            assert_false(isnormal(float_of(cryptomatte_hash(name))));
            flipped++;
        }
    }
    assert_in_range(flipped, 50, 500); /* 2 of 256 */
    assert_int_equal(cryptomatte_id(""), 1u << 23);
}

static void keys_are_as_specified(void **state)
{
    char name[CRYPTOMATTE_NAME_SIZE];

    (void)state;
    cryptomatte_attribute(name, "CryptoObject", "conversion");
    assert_string_equal(name, "cryptomatte/3ae39a5/conversion");
    cryptomatte_attribute(name, "CryptoMaterial", "name");
    assert_string_equal(name, "cryptomatte/be359d6/name");
    cryptomatte_attribute(name, "CryptoAsset", "name");
    assert_string_equal(name, "cryptomatte/f42029d/name");
}

static const char *name_of(const void *names, uint32_t thing) { return ((const char *const *)names)[thing]; }

static void things_of_one_name_are_one(void **state)
{
    static const char *const names[] = {"ball", "", "ball", "a \"b\"\\"};
    const struct film_thing things[] = {{1, 0.25}, {2, 0.125}, {3, 0.25}, {4, 0.375}};
    struct cryptomatte matte;
    float out[CRYPTOMATTE_CHANNELS];
    char wanted[200];

    (void)state;
    assert_int_equal(cryptomatte_init(&matte, "object", 4, name_of, names, NULL), STATUS_OK);
    snprintf(wanted, sizeof wanted, "{\"ball\":\"%08x\",\"object 2\":\"%08x\",\"a \\\"b\\\"\\\\\":\"%08x\"}",
             cryptomatte_id("ball"), cryptomatte_id("object 2"), cryptomatte_id("a \"b\"\\"));
    assert_string_equal(buffer_text(&matte.manifest), wanted);
    cryptomatte_rank(&matte, things, 4, out);
    assert_true(out[0] == float_of(cryptomatte_id("ball")) && out[1] == 0.5f);
    assert_true(out[2] == float_of(cryptomatte_id("a \"b\"\\")) && out[3] == 0.375f);
    assert_true(out[4] == float_of(cryptomatte_id("object 2")) && out[5] == 0.125f);
    for (int i = 6; i < CRYPTOMATTE_CHANNELS; i++)
        assert_true(out[i] == 0);
    cryptomatte_release(&matte);
}

/* Equal shares are ranked by id, whatever the numbers; what is beyond the ranks is left out; a scene that cannot be read
 * leaves numbers. */
static void ranks_are_in_order(void **state)
{
    struct film_thing things[10];
    struct cryptomatte matte;
    float out[CRYPTOMATTE_CHANNELS];
    char name[16];

    (void)state;
    assert_int_equal(cryptomatte_init(&matte, "material", 0, NULL, NULL, NULL), STATUS_OK);
    assert_string_equal(buffer_text(&matte.manifest), "{}");
    for (uint32_t i = 0; i < 10; i++)
        things[i] = (struct film_thing){i + 1, i == 7 ? 0.2 : 0.0625};
    cryptomatte_rank(&matte, things, 10, out);
    assert_true(out[1] == 0.2f);
    snprintf(name, sizeof name, "material %d", 8);
    assert_true(out[0] == float_of(cryptomatte_id(name)));
    for (int i = 2; i < CRYPTOMATTE_RANKS; i++) {
        uint32_t before, id;
        memcpy(&before, &out[2 * i - 2], sizeof before);
        memcpy(&id, &out[2 * i], sizeof id);
        assert_true(before < id && out[2 * i + 1] == 0.0625f);
    }
    cryptomatte_release(&matte);
}

static const char *long_name(const void *text, uint32_t thing)
{
    snprintf((char *)(uintptr_t)text, 256, "%0200u", thing);
    return text;
}

static void manifests_have_a_limit(void **state)
{
    enum { COUNT = 10000 };
    char name[256] = "";
    struct cryptomatte matte;
    const char *text;

    (void)state;
    assert_int_equal(cryptomatte_init(&matte, "object", COUNT, long_name, name, NULL), STATUS_OK);
    text = buffer_text(&matte.manifest);
    assert_in_range(strlen(text), CRYPTOMATTE_MANIFEST_MAX - 300, CRYPTOMATTE_MANIFEST_MAX);
    assert_int_equal(text[strlen(text) - 1], '}');
    assert_int_equal(text[strlen(text) - 2], '"');
    assert_int_equal(matte.ids[COUNT - 1], cryptomatte_id(long_name(name, COUNT - 1))); /* which is not listed */
    cryptomatte_release(&matte);
}

static void memory_faults_are_told(void **state)
{
    static const char *const names[] = {"a"};
    long at = 0, failures;

    (void)state;
    do {
        struct cryptomatte matte;
        struct error err = {0};
        status s;
        mem_fault_arm(at++, 1);
        s = cryptomatte_init(&matte, "object", 1, name_of, names, &err);
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_int_equal(s, failures ? STATUS_ERR_NO_MEMORY : STATUS_OK);
        cryptomatte_release(&matte);
    } while (failures > 0);
    assert_true(at > 3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hashes_are_murmurs),        cmocka_unit_test(ids_are_normal_numbers),
        cmocka_unit_test(keys_are_as_specified),     cmocka_unit_test(things_of_one_name_are_one),
        cmocka_unit_test(ranks_are_in_order),        cmocka_unit_test(manifests_have_a_limit),
        cmocka_unit_test(memory_faults_are_told),
    };
    return cmocka_run_group_tests_name("cryptomatte", tests, NULL, NULL);
}
