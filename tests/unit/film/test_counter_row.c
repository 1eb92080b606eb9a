/* A new work counter is a row of unit.h and a line of azulejo.proto. This program is compiled with one more than the others
 * have (COUNTER_ROW in the Makefile), and finds that everything which treats all counters alike knows it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/bytes.h"
#include "common/film/film.h"
#include "common/scene/manifest.h"
#include "coordinator/pictures/develop_parts.h"
#include "protocol/json/json_wire.h"
#include "protocol/message.h"

enum { SPP = 2, PASS = 0, COUNT = 77 };

static float sums[TILE_FLOATS_MAX];

static struct unit_result unit_with(uint64_t hazy)
{
    uint32_t begin, end;

    pass_range(SPP, 0, PASS, &begin, &end);
    return (struct unit_result){.sums = sums, .count = tile_floats(16, 16, 0, 0),
                                .work = {.samples = (uint64_t)256 * (end - begin), .hazy_rays = hazy, .kept_luminance = 5}};
}

static struct film *film_of(void)
{
    struct film *film = film_new(16, 16, SPP);

    assert_non_null(film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_want(film, 0, g, 1);
    return film;
}

static void test_sums(void **state)
{
    struct unit_work sum = unit_with(COUNT).work, more = unit_with(5).work;

    (void)state;
    unit_work_add(&sum, &more);
    assert_int_equal(sum.hazy_rays, COUNT + 5);
    unit_work_subtract(&sum, &more);
    assert_int_equal(sum.hazy_rays, COUNT);
}

/* Films of before compare the hashes that they have with those of now. */
static void test_hash(void **state)
{
    struct unit_result with = unit_with(COUNT), without = unit_with(0);

    (void)state;
    assert_int_equal(unit_hash(&with), unit_hash(&without));
}

static void test_state(void **state)
{
    struct film *film = film_of(), *back = film_of();
    struct unit_result unit = unit_with(COUNT);
    enum film_merge_result merged;
    struct error err = {0};
    uint8_t *bytes;
    size_t size;

    (void)state;
    assert_int_equal(film_merge(film, &unit, 1, &merged, &err), STATUS_OK);
    size = film_tile_state_size(film, 0);
    bytes = malloc(size);
    assert_non_null(bytes);
    film_tile_save(film, 0, bytes);
    assert_int_equal(film_tile_load(back, 0, bytes, size, &err), STATUS_OK);
    assert_int_equal(film_work(back).hazy_rays, COUNT);
    assert_true(film_work(back).kept_luminance == 5);
    free(bytes);
    film_free(film);
    film_free(back);
}

/* The unit of this program, and as one without the row wrote it. */
static void test_unit(void **state)
{
    enum { MASK_AT = 24, LAST_AT = 32 + 8 + 8 * (WORK_COUNTER_COUNT - 1) };
    struct unit_result unit = unit_with(COUNT);
    const struct film_fold fold = {.unit = &unit, .hash = unit_hash(&unit)};
    size_t size = film_unit_size(&fold);
    uint8_t *bytes = malloc(size);

    (void)state;
    assert_non_null(bytes);
    film_unit_save(&fold, bytes);
    for (int is_old = 0; is_old < 2; is_old++) {
        struct film *film = film_of();
        enum film_unit_load result;
        struct error err = {0};
        if (is_old) {
            bytes_put32(bytes + MASK_AT, bytes_get32(bytes + MASK_AT) - (1u << 24));
            memmove(bytes + LAST_AT, bytes + LAST_AT + 8, size - LAST_AT - 8);
            size -= 8;
        }
        assert_int_equal(film_unit_load(film, 0, bytes, size, &result, &err), STATUS_OK);
        assert_int_equal(result, FILM_UNIT_LOADED);
        assert_int_equal(film_work(film).hazy_rays, is_old ? 0 : COUNT);
        assert_true(film_work(film).kept_luminance == 5);
        film_free(film);
    }
    bytes_put32(bytes + MASK_AT, 9u << 24); /* of a later release */
    {
        struct film *film = film_of();
        enum film_unit_load result;
        assert_int_equal(film_unit_load(film, 0, bytes, size + 72, &result, NULL), STATUS_ERR_CORRUPT);
        film_free(film);
    }
    free(bytes);
}

static void test_wire_and_words(void **state)
{
    struct unit_work work = unit_with(COUNT).work, back;
    const struct manifest manifest = {.job_name = "", .scene_name = "", .scene_digest = "", .renderer = "", .work = &work};
    struct development d = {.output.tonemap.op = tonemap_find("linear"), .work = work};
    struct buffer text = BUFFER_INIT, exr = BUFFER_INIT;
    float grey[3] = {1, 1, 1};
    struct wire_work wire;
    struct error err = {0};

    (void)state;
    assert_int_equal(wire_work_get(&back, wire_work_set(&wire, &work), &err), STATUS_OK);
    assert_int_equal(back.hazy_rays, COUNT);
    json_wire_put(&text, &wire.message.base);
    assert_non_null(strstr(buffer_text(&text), "\"hazy_rays\":77"));
    buffer_clear(&text);
    manifest_write(&text, &manifest);
    assert_non_null(strstr(buffer_text(&text), "\"hazy_rays\": 77"));
    render_settings_default(&d.settings);
    d.image = (struct image){1, 1, 3, grey};
    assert_int_equal(develop_exr(&d, &exr, &err), STATUS_OK);
    assert_non_null(memmem(exr.data, exr.size, "azulejo:hazyRays", strlen("azulejo:hazyRays")));
    buffer_release(&exr);
    buffer_release(&text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sums), cmocka_unit_test(test_hash), cmocka_unit_test(test_state),
        cmocka_unit_test(test_unit), cmocka_unit_test(test_wire_and_words),
    };

    return cmocka_run_group_tests_name("one more work counter", tests, NULL, NULL);
}
