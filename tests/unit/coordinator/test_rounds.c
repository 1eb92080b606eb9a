/* Rounds: decided by the other group alone, the same in any order and after a restart. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/frame/rounds.h"

enum { WIDTH = 48, HEIGHT = 32, TILES = 6 };

static const struct buffer no_schedule = BUFFER_INIT;

/* A unit that differs from others the more, the higher the tile's number; `twist` changes one group's
 * samples: 1: they are noisier; 2: less noisy. */
static void merge(struct film *film, uint32_t tile, uint32_t group, uint32_t pass, const int twist[GROUPS])
{
    static float sums[TILE_FLOATS_MAX];
    struct unit_result unit = {.tile = tile, .group = group, .pass = pass, .sums = sums};
    uint32_t begin, end, seed = tile * 7919 + pass * 104729 + group * 31 + (uint32_t)twist[group] * 77;
    enum film_merge_result result;

    unit.count = tile_floats(WIDTH, HEIGHT, tile, 0);
    pass_range(film_spp(film), group, pass, &begin, &end);
    for (size_t i = 0; i < unit.count; i++) {
        seed = seed * 1664525u + 1013904223u;
        sums[i] = (float)(end - begin) * 0.15f +
                  (float)(tile + 1) * 0.01f * ((float)(seed >> 8) / 0x1p23f - 1) *
                      (twist[group] == 1 ? 3.0f : twist[group] == 2 ? 0.4f : 1.0f);
    }
    unit.work.samples = unit.count / PIXEL_FLOATS * (end - begin);
    unit.work.rays = unit.work.samples * 3;
    assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
}

struct frame {
    struct film *film;
    struct rounds rounds;
    struct stop_rules rules;
};

static void begin(struct frame *f, uint32_t spp, const struct stop_rules *rules)
{
    f->film = film_new(WIDTH, HEIGHT, spp);
    assert_non_null(f->film);
    f->rules = *rules;
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(f->film, g, &(struct film_codes){film_codes_plain, NULL});
}

static void end(struct frame *f)
{
    rounds_release(&f->rounds);
    film_free(f->film);
}

/* Render what is wanted, tiles from either end, until it is over or `units` are rendered. */
static void render(struct frame *f, int backwards, const int twist[GROUPS], uint32_t units)
{
    int changed, more = 1;

    while (more && units > 0) {
        more = 0;
        for (uint32_t i = 0; i < TILES * GROUPS && units > 0; i++) {
            uint32_t at = backwards ? TILES * GROUPS - 1 - i : i, t = at / GROUPS, g = at % GROUPS;
            uint32_t pass = film_tile_seen(f->film, t, g);
            if (pass >= film_tile_wanted(f->film, t, g))
                continue;
            merge(f->film, t, g, pass, twist);
            assert_int_equal(rounds_step(&f->rounds, f->film, &f->rules, &changed, NULL), STATUS_OK);
            more = 1;
            units--;
        }
    }
}

static void run(struct frame *f, uint32_t spp, const struct stop_rules *rules, int backwards, const int twist[GROUPS])
{
    begin(f, spp, rules);
    assert_int_equal(rounds_init(&f->rounds, f->film, &f->rules, &no_schedule, NULL), STATUS_OK);
    render(f, backwards, twist, UINT32_MAX);
    assert_true(rounds_are_over(&f->rounds) && film_complete(f->film));
}

static const int plain[GROUPS] = {0, 0};
static const struct stop_rules target = {
    .adaptive = 1, .has_target = 1, .target = {ALLOCATION_RMSE, 0.4}};

static void assert_same(const struct frame *a, const struct frame *b)
{
    for (uint32_t t = 0; t < TILES; t++) {
        size_t size = film_tile_state_size(a->film, t);
        uint8_t *x = malloc(size), *y = malloc(size);
        assert_int_equal(film_tile_state_size(b->film, t), size);
        film_tile_save(a->film, t, x);
        film_tile_save(b->film, t, y);
        assert_memory_equal(x, y, size);
        free(x);
        free(y);
    }
}

static void order_does_not_matter(void **state)
{
    struct frame a, b;

    (void)state;
    run(&a, SETTINGS_SPP_MAX, &target, 0, plain);
    run(&b, SETTINGS_SPP_MAX, &target, 1, plain);
    assert_int_equal(rounds_end(&a.rounds), FRAME_END_TARGET);
    assert_true(rounds_made(&a.rounds, a.film));
    assert_true(film_coverage(a.film).most > film_coverage(a.film).least); /* it is adaptive */
    assert_same(&a, &b);
    end(&a);
    end(&b);
}

/* Other samples of a group change what the other one gets, and never its own number. */
static void a_group_decides_about_the_other_alone(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 8 * GROUPS; k++) {
        uint32_t g = k % GROUPS;
        int twist[GROUPS] = {0, 0}, others = 0;
        struct stop_rules rules = target;
        struct frame a, b;
        twist[g] = 1 + (int)(k / GROUPS % 2);
        rules.target.value = 0.7 - 0.1 * (k / GROUPS / 2); /* met at different places of a round */
        run(&a, SETTINGS_SPP_MAX, &rules, 0, plain);
        run(&b, SETTINGS_SPP_MAX, &rules, 0, twist);
        for (uint32_t t = 0; t < TILES; t++) {
            assert_int_equal(film_tile_passes(a.film, t, g), film_tile_passes(b.film, t, g));
            others += film_tile_passes(a.film, t, 1 - g) != film_tile_passes(b.film, t, 1 - g);
        }
        assert_true(others > 0);
        end(&a);
        end(&b);
    }
}

/* A coordinator that starts again, at any moment, with what was on disk. */
static void a_restart_decides_the_same(void **state)
{
    static const int twists[2][GROUPS] = {{0, 0}, {0, 1}}; /* the second has one group watched for long */

    (void)state;
    for (int k = 0; k < 2; k++) {
        struct frame whole;
        run(&whole, SETTINGS_SPP_MAX, &target, 0, twists[k]);
        for (uint32_t units = 1; units < 400; units += 23) {
            struct frame first, again;
            begin(&first, SETTINGS_SPP_MAX, &target);
            assert_int_equal(rounds_init(&first.rounds, first.film, &first.rules, &no_schedule, NULL), STATUS_OK);
            render(&first, 0, twists[k], units);
            begin(&again, SETTINGS_SPP_MAX, &target);
            for (uint32_t t = 0; t < TILES; t++) {
                size_t size = film_tile_state_size(first.film, t);
                uint8_t *bytes = malloc(size);
                film_tile_save(first.film, t, bytes);
                assert_int_equal(film_tile_load(again.film, t, bytes, size, NULL), STATUS_OK);
                free(bytes);
            }
            assert_int_equal(rounds_init(&again.rounds, again.film, &again.rules, &no_schedule, NULL), STATUS_OK);
            {
                int changed;
                assert_int_equal(rounds_step(&again.rounds, again.film, &again.rules, &changed, NULL), STATUS_OK);
            }
            render(&again, 1, twists[k], UINT32_MAX);
            assert_true(rounds_are_over(&again.rounds));
            assert_same(&whole, &again);
            assert_true(rounds_made(&again.rounds, again.film));
            end(&first);
            end(&again);
        }
        end(&whole);
    }
}

static void the_cap_ends_rounds(void **state)
{
    struct stop_rules rules = target;
    struct frame f;

    (void)state;
    rules.target.value = 0.001;
    for (uint32_t spp = 1; spp < 70; spp += 3) {
        run(&f, spp, &rules, 0, plain);
        assert_int_equal(rounds_end(&f.rounds), FRAME_END_CAP);
        assert_int_equal(film_coverage(f.film).least, spp);
        end(&f);
    }
    /* At least so many, whatever the target. */
    rules.target.value = 1000;
    rules.spp_min = 45;
    run(&f, SETTINGS_SPP_MAX, &rules, 0, plain);
    assert_int_equal(rounds_end(&f.rounds), FRAME_END_TARGET);
    assert_int_equal(film_coverage(f.film).least, 48); /* whole passes */
    end(&f);
}

/* Does each tile of both have as many samples? */
static int has_as_many(const struct film *a, const struct film *b)
{
    for (uint32_t t = 0; t < TILES; t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            if (film_group_samples(a, t, g) != film_group_samples(b, t, g))
                return 0;
    return 1;
}

/* A cap just below, at and above what a target needs, with every number between: the target has ended the frame where it
 * has what it has without a cap, and the cap where it has less. */
static void what_a_cap_cuts_has_not_met_its_target(void **state)
{
    int ends[FRAME_END_COUNT] = {0};

    (void)state;
    for (int k = 0; k < 6; k++) {
        const int twist[GROUPS] = {0, k % 3};
        struct stop_rules rules = target;
        struct frame whole;
        rules.adaptive = k < 3;
        rules.target.value = 0.9;
        run(&whole, SETTINGS_SPP_MAX, &rules, 0, twist);
        assert_int_equal(rounds_end(&whole.rounds), FRAME_END_TARGET);
        for (uint32_t spp = 2; spp < film_coverage(whole.film).most + 3; spp++) {
            struct frame f;
            enum frame_end found;
            run(&f, spp, &rules, 0, twist);
            found = rounds_end(&f.rounds);
            if (found != (has_as_many(f.film, whole.film) ? FRAME_END_TARGET : FRAME_END_CAP))
                fail_msg("%u of %u samples, case %d: %s", spp, film_coverage(whole.film).most, k, frame_end_text(found));
            ends[found]++;
            end(&f);
        }
        end(&whole);
    }
    assert_true(ends[FRAME_END_TARGET] > 5 && ends[FRAME_END_CAP] > 100);
}

static void uniform_rounds_give_all_tiles_the_same(void **state)
{
    struct stop_rules rules = target;
    struct frame f;

    (void)state;
    rules.adaptive = 0;
    run(&f, SETTINGS_SPP_MAX, &rules, 0, plain);
    assert_int_equal(film_coverage(f.film).least, film_coverage(f.film).most);
    end(&f);
}

/* A film without statistics of its first levels gets rules with rounds: nothing is decided at these levels, the same in
 * any order and after a restart, and the rules alone do not tell its samples. */
static void levels_that_were_left_out_decide_nothing(void **state)
{
    static const struct stop_rules none = {0};

    (void)state;
    for (int backwards = 0; backwards < 2; backwards++) {
        struct frame first, again, other;
        int changed;
        begin(&first, SETTINGS_SPP_MAX, &none);
        film_measure_from(first.film, rounds_measure_from(&none, &no_schedule, SETTINGS_SPP_MAX));
        assert_int_equal(rounds_init(&first.rounds, first.film, &first.rules, &no_schedule, NULL), STATUS_OK);
        render(&first, 0, plain, TILES * GROUPS * 5 - 3); /* level 3 everywhere, level 4 nowhere */
        assert_true(film_level_is_skipped(first.film, 0, 3) && !film_level_is_skipped(first.film, 0, 4));
        begin(&again, SETTINGS_SPP_MAX, &target);
        begin(&other, SETTINGS_SPP_MAX, &target);
        for (uint32_t t = 0; t < TILES; t++) {
            size_t size = film_tile_state_size(first.film, t);
            uint8_t *bytes = malloc(size);
            film_tile_save(first.film, t, bytes);
            assert_int_equal(film_tile_load(again.film, t, bytes, size, NULL), STATUS_OK);
            assert_int_equal(film_tile_load(other.film, t, bytes, size, NULL), STATUS_OK);
            free(bytes);
        }
        assert_int_equal(rounds_init(&again.rounds, again.film, &again.rules, &no_schedule, NULL), STATUS_OK);
        assert_int_equal(rounds_init(&other.rounds, other.film, &other.rules, &no_schedule, NULL), STATUS_OK);
        for (int k = 0; k < 2; k++) {
            struct frame *f = k ? &other : &again;
            assert_int_equal(rounds_step(&f->rounds, f->film, &f->rules, &changed, NULL), STATUS_OK);
            render(f, k ? !backwards : backwards, plain, UINT32_MAX);
            assert_int_equal(rounds_end(&f->rounds), FRAME_END_TARGET);
            assert_true(film_complete(f->film) && !rounds_made(&f->rounds, f->film));
            for (uint32_t t = 0; t < TILES; t++)
                for (uint32_t g = 0; g < GROUPS; g++)
                    assert_true(film_group_samples(f->film, t, g) >= level_samples(4));
        }
        assert_same(&again, &other);
        end(&first);
        end(&again);
        end(&other);
    }
}

/* Where a job without rounds is extended, rounds begin with the last level that it has, and its statistics are there. */
static void an_extension_finds_its_levels(void **state)
{
    static const struct stop_rules none = {0};

    (void)state;
    for (uint32_t spp = 2; spp < 300; spp += 7) {
        struct stop_rules rules = target;
        struct frame given, whole;
        int changed;
        rules.spp_min = spp;
        begin(&given, spp, &none);
        film_measure_from(given.film, rounds_measure_from(&none, &no_schedule, spp));
        assert_int_equal(rounds_init(&given.rounds, given.film, &none, &no_schedule, NULL), STATUS_OK);
        render(&given, 0, plain, UINT32_MAX);
        run(&whole, SETTINGS_SPP_MAX, &rules, 0, plain);
        {
            struct frame more;
            begin(&more, SETTINGS_SPP_MAX, &rules);
            for (uint32_t t = 0; t < TILES; t++) {
                size_t size = film_tile_state_size(given.film, t);
                uint8_t *bytes = malloc(size);
                film_tile_save(given.film, t, bytes);
                assert_int_equal(film_tile_load(more.film, t, bytes, size, NULL), STATUS_OK);
                free(bytes);
            }
            assert_int_equal(rounds_init(&more.rounds, more.film, &rules, &no_schedule, NULL), STATUS_OK);
            assert_int_equal(rounds_step(&more.rounds, more.film, &rules, &changed, NULL), STATUS_OK);
            render(&more, 0, plain, UINT32_MAX);
            assert_true(rounds_are_over(&more.rounds) && rounds_made(&more.rounds, more.film));
            for (uint32_t t = 0; t < TILES; t++)
                for (uint32_t g = 0; g < GROUPS; g++)
                    assert_int_equal(film_tile_passes(more.film, t, g), film_tile_passes(whole.film, t, g));
            end(&more);
        }
        end(&given);
        end(&whole);
    }
}

static void a_schedule_is_followed(void **state)
{
    static const uint8_t passes[TILES * GROUPS] = {1, 2, 3, 0, 0, 1, 4, 4, 2, 1, 5, 1};
    struct buffer schedule = BUFFER_INIT;
    struct frame f;

    (void)state;
    buffer_append(&schedule, passes, sizeof passes);
    begin(&f, 1000, &(struct stop_rules){0});
    assert_int_equal(rounds_init(&f.rounds, f.film, &f.rules, &schedule, NULL), STATUS_OK);
    render(&f, 0, plain, UINT32_MAX);
    assert_true(film_complete(f.film));
    assert_int_equal(rounds_end(&f.rounds), FRAME_END_SCHEDULE);
    for (uint32_t t = 0; t < TILES; t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            assert_int_equal(film_tile_passes(f.film, t, g), passes[t * GROUPS + g]);
    end(&f);
    buffer_release(&schedule);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(order_does_not_matter),
        cmocka_unit_test(levels_that_were_left_out_decide_nothing),
        cmocka_unit_test(an_extension_finds_its_levels),
        cmocka_unit_test(a_group_decides_about_the_other_alone),
        cmocka_unit_test(a_restart_decides_the_same),
        cmocka_unit_test(the_cap_ends_rounds),
        cmocka_unit_test(what_a_cap_cuts_has_not_met_its_target),
        cmocka_unit_test(uniform_rounds_give_all_tiles_the_same),
        cmocka_unit_test(a_schedule_is_followed),
    };
    return cmocka_run_group_tests_name("rounds", tests, NULL, NULL);
}
