/* The counters of what goes wrong, in a path tracer that goes wrong on purpose: worker/render/base/fault.h
 * makes one sample in FAULT_EVERY of water in a glass go wrong, in one way at a time. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define AZULEJO_FAULTS /* for the names */
#include "tests/support/figure.h"
#include "tests/support/imported.h"
#include "worker/render/base/fault.h"

enum { WIDTH = 40, HEIGHT = 36, SPP = 9 };

/* By number, as in FAULT_MAP, the counter that the fault moves. */
static const enum health_kind moved_by[] = {
    [FAULT_NAN_RADIANCE] = HEALTH_DROPPED_SAMPLES, [FAULT_NEGATIVE_RADIANCE] = HEALTH_NEGATIVE_SAMPLES,
    [FAULT_HUGE_RADIANCE] = HEALTH_CLAMPED_VALUES, [FAULT_NAN_AOV] = HEALTH_DROPPED_AOVS,
    [FAULT_NAN_DIRECTION] = HEALTH_BAD_DIRECTIONS, [FAULT_ZERO_DENSITY] = HEALTH_BAD_DENSITIES,
    [FAULT_NAN_THROUGHPUT] = HEALTH_BAD_THROUGHPUTS, [FAULT_NAN_BASIS] = HEALTH_BAD_BASES,
    [FAULT_LOST_BODY] = HEALTH_LOST_BODIES, [FAULT_CROWDED_PLACE] = HEALTH_CROWDED_PLACES,
    [FAULT_ENDLESS_PATH] = HEALTH_GUARDED_PATHS,
};
enum { FAULTS = sizeof moved_by / sizeof *moved_by - 1 };
_Static_assert((int)FAULTS == (int)HEALTH_KINDS, "each counter has a fault that moves it");

static struct import_result import;
static struct render_settings settings;
static struct render_scene *scene;

static void switch_on(int fault)
{
    char number[12];

    snprintf(number, sizeof number, "%d", fault);
    assert_int_equal(fault ? setenv("AZULEJO_FAULT", number, 1) : unsetenv("AZULEJO_FAULT"), 0);
}

/* Every unit, the last first: whatever is found does not follow from the order. Returns how many of
 * their sums, of radiance and of output variables, are not finite. */
static unsigned render(struct render_stats *stats)
{
    static float sums[TILE_FLOATS_MAX];
    unsigned bad = 0;
    size_t floats;

    memset(stats, 0, sizeof *stats);
    for (uint32_t g = GROUPS; g-- > 0;)
        for (uint32_t tile = tile_count(WIDTH, HEIGHT); tile-- > 0;)
            for (uint32_t pass = pass_count(SPP, g); pass-- > 0;) {
                floats = render_tile(scene, 1, tile, g, pass, sums, NULL, stats);
                for (size_t i = 0; i < floats; i++)
                    bad += !isfinite(sums[i]);
            }
    return bad;
}

static void render_soundly(struct render_stats *stats, const char *kind)
{
    unsigned bad = render(stats);
    char what[96];

    snprintf(what, sizeof what, "sums of units that are not finite, with a fault that moves %s", kind);
    figure_within(what, bad, 0, 0, "exact");
}

static int is_struck(uint32_t x, uint32_t y, uint32_t sample)
{
    fault_begin(x, y, sample);
    return fault_now != FAULT_NONE;
}

/* How many samples are struck, and the key of the first. */
static uint64_t struck(uint64_t *first)
{
    uint64_t count = 0;

    *first = 0;
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t tile = 0; tile < tile_count(WIDTH, HEIGHT); tile++)
            for (uint32_t pass = 0; pass < pass_count(SPP, g); pass++) {
                struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, tile);
                uint32_t begin, end;
                pass_range(SPP, g, pass, &begin, &end);
                for (uint32_t p = 0; p < rect.width * rect.height; p++)
                    for (uint32_t i = begin; i < end; i++) {
                        uint64_t key = health_key((struct health_place){pass, tile, p, i * GROUPS + g});
                        if (!is_struck(rect.x + p % rect.width, rect.y + p / rect.width, i * GROUPS + g))
                            continue;
                        count++;
                        *first = *first && *first < key ? *first : key;
                    }
            }
    return count;
}

static void nothing_goes_wrong_by_itself(void **state)
{
    struct render_stats stats;

    (void)state;
    switch_on(0);
    render_soundly(&stats, "nothing");
    assert_true(depth_light_is_valid(&stats.work.depth) && depth_light_is_known(&stats.work.depth));
    assert_false(health_is_ill(&stats.work.health));
    for (int k = 0; k < HEALTH_KINDS; k++)
        assert_int_equal(stats.work.health.first[k], 0);
}

static void each_fault_moves_its_counter(void **state)
{
    (void)state;
    for (int fault = 1; fault <= FAULTS; fault++) {
        enum health_kind kind = moved_by[fault];
        struct render_stats stats, again;
        struct health_place place;
        struct tile_rect rect;
        uint64_t first, hits;
        switch_on(fault);
        hits = struck(&first);
        render_soundly(&stats, health_rows[kind].name);
        assert_true(depth_light_is_valid(&stats.work.depth)); /* whatever a sample carries */
        if (kind == HEALTH_BAD_DENSITIES)
            figure_within("samples dropped where a light has the density 0", (double)stats.work.dropped_samples, 0, 0,
                          "exact");
        if (stats.work.health.count[kind] == 0)
            fail_msg("fault %d does not move %s", fault, health_rows[kind].name);
        assert_true(hits > 0 && stats.work.health.first[kind] >= first);
        assert_true(health_place_of(stats.work.health.first[kind], &place));
        rect = tile_rect_of(WIDTH, HEIGHT, place.tile);
        if (fault == FAULT_NAN_RADIANCE || fault == FAULT_NEGATIVE_RADIANCE) {
            assert_int_equal(stats.work.health.count[kind], hits);
            assert_int_equal(stats.work.health.first[kind], first);
        }
        if (fault != FAULT_HUGE_RADIANCE) /* a sum's example is its pass */
            assert_true(is_struck(rect.x + place.pixel % rect.width, rect.y + place.pixel / rect.width, place.sample));
        (void)render(&again);
        assert_memory_equal(&stats, &again, sizeof stats);
    }
    switch_on(0);
}

/* A sample that is dropped is black, and only that: the others keep their bits. */
static void dropped_samples_are_black(void **state)
{
    static float well[TILE_FLOATS_MAX], ill[TILE_FLOATS_MAX];
    struct render_settings few = imported_settings(WIDTH, HEIGHT, GROUPS); /* one sample a group */
    struct render_scene *one = imported_build(&import, &few, 1);
    struct render_stats stats = {0};
    uint32_t black = 0;
    float most[2] = {0};

    (void)state;
    switch_on(0);
    render_tile(one, 1, 0, 0, 0, well, NULL, &stats);
    switch_on(FAULT_NAN_RADIANCE);
    render_tile(one, 1, 0, 0, 0, ill, NULL, &stats);
    for (size_t i = 0; i < TILE_PIXELS_MAX * 3; i++) {
        most[0] = fmaxf(most[0], well[i]);
        most[1] = fmaxf(most[1], ill[i]);
    }
    figure_within("brightest pixel where one sample in 37 is no number", (double)most[1], 0, (double)most[0],
                  "the same picture without a fault");
    for (uint32_t p = 0; p < TILE_PIXELS_MAX; p++) {
        int hit = is_struck(p % TILE_SIZE, p / TILE_SIZE, 0);
        black += (uint32_t)hit;
        for (size_t c = p * 3; c < p * 3 + 3; c++)
            assert_true(ill[c] == (hit ? 0 : well[c]));
    }
    assert_int_equal(stats.work.dropped_samples, black);
    assert_true(black > 5);
    render_scene_free(one);
    switch_on(0);
}

/* A normal that is no number counts as 0. */
static void variables_that_are_no_number_are_left_out(void **state)
{
    static float sums[TILE_FLOATS_MAX];
    struct render_stats stats = {0};
    float most = 0;
    size_t floats;

    (void)state;
    switch_on(FAULT_NAN_AOV);
    floats = render_tile(scene, 1, 0, 0, 0, sums, NULL, &stats);
    assert_true(floats > TILE_PIXELS_MAX * PIXEL_FLOATS);
    for (size_t i = TILE_PIXELS_MAX * PIXEL_FLOATS; i < floats; i++)
        most = fmaxf(most, fabsf(sums[i]));
    figure_within("longest sum of two normals where one in 37 is no number", (double)most, 0, 2.0001,
                  "two of length 1");
    switch_on(0);
}

/* In the pass of samples 256 to 384 of a group some pixels have two samples of FLT_MAX. */
static void sums_beyond_floats_are_cut(void **state)
{
    static float sums[TILE_FLOATS_MAX];
    struct render_settings many = imported_settings(16, 16, 1024);
    struct render_scene *bright = imported_build(&import, &many, 1);
    struct render_stats stats = {0};
    uint32_t pass = 0, begin = 0, end = 0;
    unsigned bad = 0;
    size_t floats;

    (void)state;
    while (end - begin < 128)
        pass_range(many.spp, 0, pass++, &begin, &end);
    switch_on(FAULT_HUGE_RADIANCE);
    floats = render_tile(bright, 1, 0, 0, pass - 1, sums, NULL, &stats);
    for (size_t i = 0; i < floats; i++)
        bad += !isfinite(sums[i]);
    figure_within("infinite sums where one sample in 37 is the largest float", bad, 0, 0, "exact");
    assert_true(stats.work.clamped_values > 0);
    render_scene_free(bright);
    switch_on(0);
}

static int set_up(void **state)
{
    (void)state;
    imported_file("scenes/liquids/water-contact.gltf", &import);
    settings = imported_settings(WIDTH, HEIGHT, SPP);
    settings.aovs = 1u << AOV_NORMAL;
    scene = imported_build(&import, &settings, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    render_scene_free(scene);
    import_result_release(&import);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_goes_wrong_by_itself),
        cmocka_unit_test(each_fault_moves_its_counter),
        cmocka_unit_test(dropped_samples_are_black),
        cmocka_unit_test(variables_that_are_no_number_are_left_out),
        cmocka_unit_test(sums_beyond_floats_are_cut),
    };
    return cmocka_run_group_tests_name("health of samples", tests, set_up, tear_down);
}
