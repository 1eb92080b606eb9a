/* allocate: integers that follow the statistics, grow with lambda, cost what they may; targets
 * against closed forms; and a toy whose picture is unbiased to the last bit of double, by summing
 * over all outcomes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "common/accuracy/allocate.h"
#include "common/accuracy/stop.h"
#include "common/accuracy/figures.h"
#include "common/film/tiles.h"

#define GOLDEN 0x75293efbu

enum { TILES_MAX = 64 };

struct frame {
    struct film_level tiles[TILES_MAX];
    uint32_t wanted[TILES_MAX];
    struct allocation_input in;
};

static void frame_init(struct frame *f, uint32_t width, uint32_t height, uint32_t level)
{
    memset(f, 0, sizeof *f);
    f->in = (struct allocation_input){width, height, level, f->tiles, NULL, f->wanted, NULL};
    assert_true(tile_count(width, height) <= TILES_MAX);
    for (uint32_t t = 0; t < tile_count(width, height); t++)
        f->wanted[t] = level_passes(level);
}

/* As film_level_measure() divides them. */
static void set_spreads(struct film_level *t, float codes, uint32_t pixels)
{
    uint32_t i = 0, above;

    if (codes < level_spread(0))
        return;
    while (i + 2 < LEVEL_SPREADS && codes >= level_spread(i + 1))
        i++;
    above = (uint32_t)lrintf((codes - level_spread(i)) / (level_spread(i + 1) - level_spread(i)) * LEVEL_SPREAD_ONE);
    t->spreads[i] = (uint16_t)((LEVEL_SPREAD_ONE - above) * pixels);
    t->spreads[i + 1] = (uint16_t)(above * pixels);
}

/* Every pixel of the tile is off by so many codes and by so much light, of radiance 1. */
static void set_tile(struct frame *f, uint32_t tile, double codes, double light, uint64_t rays_of_pixel)
{
    struct tile_rect r = tile_rect_of(f->in.width, f->in.height, tile);
    uint32_t pixels = r.width * r.height;
    struct film_level *t = &f->tiles[tile];

    memset(t, 0, sizeof *t);
    t->radiance = 3.0 * pixels;
    t->linear = 3 * light * light * pixels;
    t->display = (float)(codes * codes * pixels);
    t->channels = 3 * t->display;
    t->bins[level_bin((float)codes)] = (uint16_t)pixels;
    set_spreads(t, (float)codes, pixels);
    t->rays = rays_of_pixel * pixels;
}

static uint32_t next_random(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

static void random_frame(struct frame *f, uint32_t width, uint32_t height, uint32_t level)
{
    uint32_t state = 7 + level;

    frame_init(f, width, height, level);
    for (uint32_t t = 0; t < tile_count(width, height); t++)
        set_tile(f, t, exp2((double)(next_random(&state) % 1000) / 100 - 4), 0.1, 1 + next_random(&state) % 300);
}

static void run(struct allocation_round *round, const struct frame *f)
{
    struct error err;

    assert_int_equal(allocation_round(round, &f->in, &err), STATUS_OK);
}

/* ---- the schedule --------------------------------------------------------------------------------- */

static void test_schedule(void **state)
{
    static const uint32_t first[] = {0, 2, 4, 8, 16, 24, 32, 48, 64, 96, 128, 192, 256};
    (void)state;

    for (uint32_t p = 0; p < sizeof first / sizeof *first; p++)
        assert_int_equal(pass_samples(p), first[p]);
    assert_int_equal(pass_samples(22), 8192);
    assert_int_equal(pass_samples(23), 12288);
    assert_int_equal(pass_samples(PASSES_MAX), 1 << 19);
    for (uint32_t level = 0; level < 19; level++)
        assert_int_equal(pass_samples(level_passes(level)), 2u << level);
}

static void test_bins(void **state)
{
    (void)state;
    assert_int_equal(level_bin(0), 0);
    assert_int_equal(level_bin(0.044f), 0);
    assert_int_equal(level_bin(0.0443f), 1);
    assert_int_equal(level_bin(0.0625f), 2);
    assert_int_equal(level_bin(1), 10);
    assert_int_equal(level_bin(1.4143f), 11);
    assert_int_equal(level_bin(90), 22);
    assert_int_equal(level_bin(91), 23);
    assert_int_equal(level_bin(255), 23);
    assert_int_equal(level_bin(1e30f), 23);
    assert_int_equal(level_bin(NAN), 0);
}

/* ---- wanted numbers -------------------------------------------------------------------------------- */

static double extras_over_floor(const struct frame *f, const uint32_t *wanted, uint32_t tiles)
{
    double extras = 0, whole = 0;

    for (uint32_t t = 0; t < tiles; t++) {
        double floor_samples = pass_samples(level_passes(f->in.level));
        extras += (double)f->tiles[t].rays * (pass_samples(wanted[t]) - floor_samples);
        whole += (double)f->tiles[t].rays * floor_samples;
    }
    return extras / whole;
}

static void test_grows_with_lambda(void **state)
{
    (void)state;
    for (uint32_t level = 2; level < 12; level += 3) {
        struct frame f;
        struct allocation_round round;
        uint32_t last[TILES_MAX], now[TILES_MAX], tiles = 35, changed = 0;
        random_frame(&f, 100, 70, level);
        run(&round, &f);
        assert_true(round.full > 0);
        memcpy(last, f.wanted, sizeof last);
        for (uint32_t lambda = 0; lambda <= round.full; lambda++) {
            memcpy(now, f.wanted, sizeof now);
            allocation_wanted(&round, lambda, now);
            for (uint32_t t = 0; t < tiles; t++) {
                assert_true(now[t] >= last[t]);
                assert_true(pass_samples(now[t]) <= allocation_rules.ratio_max * (2u << level));
                changed += now[t] != last[t];
            }
            if (lambda == 0)
                assert_int_equal(changed, 0);
            memcpy(last, now, sizeof last);
        }
        assert_true(changed > tiles / 2);
        assert_true(extras_over_floor(&f, last, tiles) <= allocation_rules.share_percent / 100.0);
        assert_true(extras_over_floor(&f, last, tiles) > allocation_rules.share_percent / 100.0 * 0.8);
        allocation_round_release(&round);
    }
}

/* Four times the squared error is twice the samples, four times the cost half of them. */
static void test_neyman(void **state)
{
    struct frame f;
    struct allocation_round round;
    (void)state;

    frame_init(&f, 64, 64, 4);
    for (uint32_t t = 0; t < 16; t++) /* far apart, so that smoothing is silent */
        set_tile(&f, t, 1, 0.1, 64);
    set_tile(&f, 0, 4, 0.1, 64);
    set_tile(&f, 3, 4, 0.1, 256);
    set_tile(&f, 12, 2, 0.1, 64);
    run(&round, &f);
    assert_int_equal(round.strength[0] - round.strength[3], 64);
    assert_true(round.strength[0] > round.strength[12]);
    assert_in_range(round.strength[12] - round.strength[15], 63, 65);
    allocation_round_release(&round);
}

/* Among 1600 pixels of a small error, 16 huge ones do not take all samples: they count as `limit`
 * times what 95 % stay below. */
static void test_few_pixels_do_not_take_all(void **state)
{
    struct frame f;
    struct allocation_round round;
    (void)state;

    frame_init(&f, 64, 64, 4);
    for (uint32_t t = 0; t < 16; t++)
        set_tile(&f, t, 1, 0.1, 64);
    f.tiles[5].bins[10] -= 4;
    f.tiles[5].bins[23] += 4;
    f.tiles[5].display += 4 * 200 * 200;
    run(&round, &f);
    assert_in_range(round.strength[5] - round.strength[15], 0, 24);
    allocation_round_release(&round);
}

static void test_edge_tiles_count_by_the_pixel(void **state)
{
    struct frame f;
    struct allocation_round round;
    (void)state;

    frame_init(&f, 40, 19, 3);
    for (uint32_t t = 0; t < tile_count(40, 19); t++)
        set_tile(&f, t, 3, 0.1, 11);
    run(&round, &f);
    for (uint32_t t = 1; t < round.tiles; t++)
        assert_int_equal(round.strength[t], round.strength[0]);
    allocation_round_release(&round);
}

static void test_a_dark_tile_beside_a_noisy_one(void **state)
{
    struct frame f;
    struct allocation_round round;
    uint32_t wanted[TILES_MAX];
    (void)state;

    frame_init(&f, 128, 16, 3);
    for (uint32_t t = 0; t < 8; t++)
        set_tile(&f, t, 0, 0, 10);
    set_tile(&f, 0, 8, 0.1, 10);
    run(&round, &f);
    memcpy(wanted, f.wanted, sizeof wanted);
    allocation_wanted(&round, round.full, wanted);
    assert_true(wanted[0] > f.wanted[0]);
    assert_true(wanted[1] > f.wanted[1]);
    assert_int_equal(wanted[2], f.wanted[2]);
    allocation_round_release(&round);
}

static void test_no_error_no_extras(void **state)
{
    struct frame f;
    struct allocation_round round;
    struct allocation_target target = {ALLOCATION_DISPLAY, 1};
    uint32_t lambda;
    (void)state;

    frame_init(&f, 64, 64, 5);
    run(&round, &f);
    assert_int_equal(round.full, 0);
    assert_true(allocation_target(&round, &target, &lambda));
    assert_int_equal(lambda, 0);
    target = (struct allocation_target){ALLOCATION_RMSE, 0.001};
    assert_true(allocation_target(&round, &target, &lambda));
    target = (struct allocation_target){ALLOCATION_PSNR, 200};
    assert_true(allocation_target(&round, &target, &lambda));
    allocation_round_release(&round);
    for (uint32_t level = 0; level < allocation_rules.first_level; level++) {
        uint32_t wanted[TILES_MAX] = {0};
        random_frame(&f, 64, 64, level);
        run(&round, &f);
        assert_int_equal(round.full, 0);
        allocation_wanted(&round, 0, wanted);
        assert_memory_equal(wanted, f.wanted, sizeof wanted);
        allocation_round_release(&round);
    }
}

/* Errors, rays and light in other units are the same picture. */
static void test_units_do_not_matter(void **state)
{
    struct frame f, g;
    struct allocation_round a, b;
    (void)state;

    random_frame(&f, 100, 70, 4);
    g = f;
    g.in.tiles = g.tiles;
    g.in.wanted = g.wanted;
    for (uint32_t t = 0; t < TILES_MAX; t++) {
        g.tiles[t].rays *= 16;
        g.tiles[t].linear *= 1e8;
        g.tiles[t].radiance *= 1e4;
    }
    run(&a, &f);
    run(&b, &g);
    assert_int_equal(a.full, b.full);
    for (uint32_t lambda = 0; lambda <= a.full; lambda += 17) {
        uint32_t x[TILES_MAX] = {0}, y[TILES_MAX] = {0};
        allocation_wanted(&a, lambda, x);
        allocation_wanted(&b, lambda, y);
        assert_memory_equal(x, y, sizeof x);
        assert_true(fabs(allocation_predict(&a, ALLOCATION_RMSE, lambda) /
                         allocation_predict(&b, ALLOCATION_RMSE, lambda) - 1) < 1e-12);
    }
    allocation_round_release(&a);
    allocation_round_release(&b);
}

/* The integers of one frame, as they were when this was written: another machine, compiler or
 * change of arithmetic that alters them alters pictures. */
static void test_same_bits(void **state)
{
    struct frame f;
    struct allocation_round round;
    uint32_t wanted[TILES_MAX] = {0}, hash = 2166136261u;
    (void)state;

    random_frame(&f, 100, 70, 5);
    run(&round, &f);
    allocation_wanted(&round, round.full, wanted);
    for (uint32_t t = 0; t < round.tiles; t++)
        hash = (hash ^ wanted[t]) * 16777619u;
    hash = (hash ^ round.full) * 16777619u;
    assert_int_equal(hash, GOLDEN);
    allocation_round_release(&round);
}

/* ---- targets --------------------------------------------------------------------------------------- */

/* All pixels alike: two groups of n samples halve the group's squared error at the floor. */
static void test_prediction(void **state)
{
    struct frame f;
    struct allocation_round round;
    (void)state;

    frame_init(&f, 64, 64, 3);
    for (uint32_t t = 0; t < 16; t++)
        set_tile(&f, t, 4, 0.1, 64);
    run(&round, &f);
    assert_true(fabs(allocation_predict(&round, ALLOCATION_RMSE, 0) - 10 / sqrt(2)) < 1e-9);
    assert_true(fabs(allocation_predict(&round, ALLOCATION_PSNR, 0) - 20 * log10(255 / (4 / sqrt(2)))) < 1e-6);
    /* 95 % of normal errors are within 1.96 standard deviations. */
    assert_true(fabs(allocation_predict(&round, ALLOCATION_DISPLAY, 0) / (1.96 * 4 / sqrt(2)) - 1) < 0.01);
    f.wanted[0] = level_passes(5); /* what was wanted before counts, too */
    assert_true(allocation_predict(&round, ALLOCATION_RMSE, 0) < 10 / sqrt(2) - 0.1);
    allocation_round_release(&round);
}

/* A tile with more samples because it looked worse than its neighbours is not believed wholly. */
static void test_prediction_leans_on_the_neighbourhood(void **state)
{
    struct frame f;
    struct allocation_round round;
    double error;
    (void)state;

    frame_init(&f, 128, 16, 3);
    for (uint32_t t = 0; t < 8; t++)
        set_tile(&f, t, 1, 0, 64);
    set_tile(&f, 4, 1, 0.1, 64);
    f.wanted[4] = level_passes(5); /* four times the floor */
    run(&round, &f);
    error = allocation_predict(&round, ALLOCATION_RMSE, 0);
    /* Two thirds of its square (a half, and a sixth as its own share of the mean) at a quarter, a
     * third beside it. */
    assert_true(fabs(error * error - 100 * 0.5 * (2.0 / 3 * pow(0.25, 1 - allocation_rules.caution) + 1.0 / 3) / 8) <
                1e-9);
    allocation_round_release(&round);
}

/* The exponent is that of the last doubling, less some caution: squared errors that fell by 2^0.9 are expected
 * to fall by less further on. */
static void test_exponent_is_learnt(void **state)
{
    struct frame f, before;
    struct allocation_round round;
    double at_floor, later;
    (void)state;

    frame_init(&f, 64, 64, 3);
    frame_init(&before, 64, 64, 2);
    for (uint32_t t = 0; t < 16; t++) {
        set_tile(&f, t, 4, 0.1, 64);
        set_tile(&before, t, 4 * exp2(0.9 / 2), 0.1 * exp2(0.9 / 2), 64);
    }
    f.in.previous = before.tiles;
    run(&round, &f);
    at_floor = allocation_predict(&round, ALLOCATION_RMSE, 0);
    assert_true(fabs(at_floor - 10 / sqrt(2)) < 1e-9);
    for (uint32_t t = 0; t < 16; t++)
        f.wanted[t] = level_passes(4);
    later = allocation_predict(&round, ALLOCATION_RMSE, 0);
    assert_true(fabs(at_floor / later - exp2((0.9 - allocation_rules.caution) / 2)) < 1e-9);
    for (uint32_t t = 0; t < 16; t++) /* never faster than the rules allow */
        set_tile(&before, t, 4 * 4, 0.1 * 4, 64);
    at_floor = allocation_predict(&round, ALLOCATION_RMSE, 0);
    for (uint32_t t = 0; t < 16; t++)
        f.wanted[t] = level_passes(3);
    later = at_floor;
    at_floor = allocation_predict(&round, ALLOCATION_RMSE, 0);
    assert_true(fabs(at_floor / later - exp2((allocation_rules.exponent_max - allocation_rules.caution) / 2)) < 1e-9);
    assert_true(fabs(at_floor - 10 / sqrt(2) * sqrt(level_correction(1, 16))) < 1e-9); /* halves that hide a part */
    allocation_round_release(&round);
}

/* ---- what the picture then reports ------------------------------------------------------------------ */

enum { SIDE = 64, GROUP_SAMPLES = 64 };

/* Rare bright samples on a dim ground, as reflections of small lamps are. */
static void rare_light(double *sums, uint32_t samples, uint32_t *random)
{
    memset(sums, 0, (size_t)SIDE * SIDE * 3 * sizeof *sums);
    for (uint32_t i = 0; i < SIDE * SIDE; i++)
        for (uint32_t j = 0; j < samples; j++) {
            double light = next_random(random) % 100 < 3 ? 2.5 : 0.02;
            for (uint32_t c = 0; c < 3; c++)
                sums[i * 3 + c] += light;
        }
}

/* Level statistics of every tile, from two halves of the whole picture's samples. */
static void measure_picture(struct film_level *tiles, const double *first, const double *second, uint32_t samples)
{
    for (uint32_t t = 0; t < tile_count(SIDE, SIDE); t++) {
        struct tile_rect r = tile_rect_of(SIDE, SIDE, t);
        double sums[TILE_PIXELS_MAX * 3];
        float later[TILE_PIXELS_MAX * 3];
        for (uint32_t i = 0; i < r.width * r.height * 3; i++) {
            uint32_t at = ((r.y + i / 3 / r.width) * SIDE + r.x + i / 3 % r.width) * 3 + i % 3;
            sums[i] = first[at] + second[at];
            later[i] = (float)second[at];
        }
        tiles[t].rays = 1;
        film_level_measure(&tiles[t], sums, later, r.width, r.height, samples,
                           &(struct film_codes){film_codes_plain, NULL});
    }
}

static status plain_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                          struct error *err)
{
    (void)err;
    film_codes_plain(user, rgb, width * height, codes);
    return STATUS_OK;
}

/* What one group predicts of both groups' picture is what that picture reports, or a little worse. */
static void test_prediction_is_what_is_reported(void **state)
{
    static double sums[GROUPS][4][SIDE * SIDE * 3]; /* of quarters */
    static float means[GROUPS][SIDE * SIDE * 3];
    struct accuracy_picture picture = {.width = SIDE, .height = SIDE};
    struct accuracy_figures reported;
    struct frame f, before;
    struct allocation_round round;
    struct error err;
    uint32_t random = 3;
    double display, psnr;
    (void)state;

    frame_init(&f, SIDE, SIDE, 5);
    frame_init(&before, SIDE, SIDE, 4);
    for (int g = 0; g < GROUPS; g++)
        for (int i = 0; i < 4; i++)
            rare_light(sums[g][i], GROUP_SAMPLES / 4, &random);
    measure_picture(before.tiles, sums[0][0], sums[0][1], GROUP_SAMPLES / 2);
    for (int g = 0; g < GROUPS; g++) {
        for (int i = 0; i < SIDE * SIDE * 3; i++) {
            sums[g][0][i] += sums[g][1][i];
            sums[g][2][i] += sums[g][3][i];
            means[g][i] = (float)((sums[g][0][i] + sums[g][2][i]) / GROUP_SAMPLES);
        }
        picture.groups[g] = means[g];
    }
    measure_picture(f.tiles, sums[0][0], sums[0][2], GROUP_SAMPLES);
    f.in.previous = before.tiles;
    run(&round, &f);
    display = allocation_predict(&round, ALLOCATION_DISPLAY, 0);
    psnr = allocation_predict(&round, ALLOCATION_PSNR, 0);
    assert_int_equal(accuracy_figures_of(&reported, &picture, &(struct accuracy_transform){.apply = plain_codes, .user = NULL}, NULL,
                                         NULL, &err), STATUS_OK);
    if (!(display > reported.display_error && display < 1.2 * reported.display_error &&
          psnr < reported.psnr_db && psnr > reported.psnr_db - 1))
        fail_msg("predicted %.2f codes and %.2f dB, reported %.2f and %.2f", display, psnr,
                 reported.display_error, reported.psnr_db);
    allocation_round_release(&round);
}

static void test_target_is_met_at_the_smallest_lambda(void **state)
{
    static const struct allocation_target targets[] = {
        {ALLOCATION_DISPLAY, 0}, {ALLOCATION_PSNR, 0}, {ALLOCATION_RMSE, 0}};
    struct frame f;
    struct allocation_round round;
    (void)state;

    random_frame(&f, 100, 70, 4);
    run(&round, &f);
    for (int i = 0; i < 3; i++) {
        struct allocation_target target = targets[i];
        double first = allocation_predict(&round, target.measure, 0);
        double last = allocation_predict(&round, target.measure, round.full);
        double room = allocation_rules.margin;
        uint32_t lambda;
        int better = target.measure == ALLOCATION_PSNR ? last > first : last < first;
        assert_true(better);
        for (uint32_t l = 1; l <= round.full; l++) {
            double before = allocation_predict(&round, target.measure, l - 1);
            double after = allocation_predict(&round, target.measure, l);
            assert_true(target.measure == ALLOCATION_PSNR ? after >= before : after <= before);
        }
        target.value = target.measure == ALLOCATION_PSNR ? (first + last) / 2 + 20 * log10(1 - room)
                                                         : (first + last) / 2 / (1 - room);
        assert_true(allocation_target(&round, &target, &lambda));
        assert_in_range(lambda, 1, round.full);
        { /* one less would not do */
            double aim =
                target.measure == ALLOCATION_PSNR ? target.value - 20 * log10(1 - room) : target.value * (1 - room);
            double here = allocation_predict(&round, target.measure, lambda);
            double before = allocation_predict(&round, target.measure, lambda - 1);
            assert_true(target.measure == ALLOCATION_PSNR ? here >= aim - 1e-9 : here <= aim + 1e-9);
            assert_true(target.measure == ALLOCATION_PSNR ? before < aim : before > aim);
        }
        target.value = target.measure == ALLOCATION_PSNR ? last + 1 : last * 0.9;
        assert_false(allocation_target(&round, &target, &lambda));
        assert_int_equal(lambda, round.full);
        target.value = target.measure == ALLOCATION_PSNR ? first - 1 : first * 1.1;
        assert_true(allocation_target(&round, &target, &lambda));
        assert_int_equal(lambda, 0);
    }
    allocation_round_release(&round);
}

/* ---- the toy ------------------------------------------------------------------------------------------
 *
 * One tile of three is a caustic: what a replicate's samples of one pass add up to is all or
 * nothing, with mean 1 a sample. Its neighbours are known. Each group has TOY_PASSES passes of two
 * replicates, so 2^(2 TOY_PASSES) outcomes, and all pairs of them are summed with their weights:
 * the mean of the picture is exact, there is no luck in it. */

enum { TOY_PASSES = 5, TOY_BITS = 2 * TOY_PASSES, TOY_OUTCOMES = 1 << TOY_BITS, TOY_LAST_LEVEL = 2 };
#define TOY_LIGHT 0.2 /* probability that a replicate's share of a pass finds the light */

static const struct allocation_rules toy_rules = {
    .first_level = 1, .ratio_max = 4, .share_percent = 100, .limit = 1e9, .smoothing = 0.25,
    .exponent_min = 1, .exponent_max = 1};

/* Bit 2p + r: did replicate r find the light in pass p? */
static double toy_sum(uint32_t outcome, uint32_t replicate, uint32_t passes)
{
    double sum = 0;

    for (uint32_t p = 0; p < passes; p++)
        if (outcome >> (2 * p + replicate) & 1)
            sum += (pass_samples(p + 1) - pass_samples(p)) / 2 / TOY_LIGHT;
    return sum;
}

static double toy_mean(uint32_t outcome, uint32_t passes)
{
    return (toy_sum(outcome, 0, passes) + toy_sum(outcome, 1, passes)) / pass_samples(passes);
}

static double toy_weight(uint32_t outcome)
{
    int found = __builtin_popcount(outcome);

    return pow(TOY_LIGHT, found) * pow(1 - TOY_LIGHT, TOY_BITS - found);
}

/* What a round decides from a group's first `passes` passes, as if they had been the floor's:
 * passes of the tile, and whether the target is met. */
static uint32_t toy_round(uint32_t outcome, uint32_t level, uint32_t passes, uint32_t wanted, double target_codes,
                          int *ended)
{
    struct frame f;
    struct allocation_round round;
    struct allocation_target target = {ALLOCATION_PSNR, 20 * log10(255 / target_codes)};
    double error = fabs(toy_sum(outcome, 0, passes) - toy_sum(outcome, 1, passes)) / pass_samples(passes);
    uint32_t lambda;

    frame_init(&f, 48, 16, level);
    f.in.rules = &toy_rules;
    f.wanted[1] = wanted;
    set_tile(&f, 0, 16 / sqrt(2u << level), 0.1, 10);
    set_tile(&f, 1, 20 * error * sqrt((double)pass_samples(passes) / (2u << level)), error, 10);
    set_tile(&f, 2, 16 / sqrt(2u << level), 0.1, 10);
    run(&round, &f);
    lambda = round.full;
    *ended = target_codes > 0 && allocation_target(&round, &target, &lambda);
    allocation_wanted(&round, lambda, f.wanted);
    allocation_round_release(&round);
    return f.wanted[1] < TOY_PASSES ? f.wanted[1] : TOY_PASSES;
}

enum toy_fault { TOY_RIGHT, TOY_OWN, TOY_ALL_SAMPLES, TOY_ENDED_GROWS, TOY_BY_COUNTS };

/* Decisions are functions of few bits: each is taken once. */
struct toy {
    double target_codes;
    struct toy_decision {
        uint8_t known, passes, ended;
    } decisions[TOY_LAST_LEVEL + 1][TOY_PASSES + 1][TOY_PASSES + 1][TOY_OUTCOMES];
};

static uint32_t toy_decide(struct toy *toy, uint32_t level, uint32_t passes, uint32_t wanted, uint32_t outcome,
                           int *ended)
{
    struct toy_decision *d;

    outcome &= (1u << 2 * passes) - 1;
    d = &toy->decisions[level][passes][wanted][outcome];
    if (!d->known) {
        d->passes = (uint8_t)toy_round(outcome, level, passes, wanted, toy->target_codes, ended);
        d->ended = (uint8_t)*ended;
        d->known = 1;
    }
    *ended = d->ended;
    return d->passes;
}

static double toy_picture(struct toy *toy, enum toy_fault fault, const uint32_t outcome[2])
{
    uint32_t n[2] = {0, 0}, next[2];
    int ended[2] = {0, 0};

    for (uint32_t level = 1; level <= TOY_LAST_LEVEL && !(ended[0] && ended[1]); level++) {
        uint32_t floor_passes = level_passes(level);
        for (int g = 0; g < 2; g++)
            if (n[g] < floor_passes && (!ended[g] || fault == TOY_ENDED_GROWS))
                n[g] = floor_passes;
        for (int g = 0; g < 2; g++) {
            int by = fault == TOY_OWN ? g : 1 - g;
            next[g] = n[g];
            if (!ended[g])
                next[g] =
                    toy_decide(toy, level, fault == TOY_ALL_SAMPLES && n[by] > floor_passes ? n[by] : floor_passes,
                               n[g], outcome[by], &ended[g]);
        }
        n[0] = next[0];
        n[1] = next[1];
    }
    if (fault == TOY_BY_COUNTS) {
        double a = pass_samples(n[0]), b = pass_samples(n[1]);
        return (a * toy_mean(outcome[0], n[0]) + b * toy_mean(outcome[1], n[1])) / (a + b);
    }
    return toy_mean(outcome[0], n[0]) / 2 + toy_mean(outcome[1], n[1]) / 2;
}

static struct toy toy;

static double toy_expectation(enum toy_fault fault, double target_codes)
{
    static double weight[TOY_OUTCOMES];
    double sum = 0;

    memset(&toy, 0, sizeof toy);
    toy.target_codes = target_codes;
    for (uint32_t i = 0; i < TOY_OUTCOMES; i++)
        weight[i] = toy_weight(i);
    for (uint32_t i = 0; i < TOY_OUTCOMES; i++) {
        double row = 0;
        for (uint32_t j = 0; j < TOY_OUTCOMES; j++)
            row += weight[j] * toy_picture(&toy, fault, (const uint32_t[2]){i, j});
        sum += weight[i] * row;
    }
    return sum;
}

static void test_toy(void **state)
{
    static const double none = 0, target = 9;
    (void)state;

    assert_true(fabs(toy_expectation(TOY_RIGHT, none) - 1) < 1e-12);
    assert_true(fabs(toy_expectation(TOY_RIGHT, target) - 1) < 1e-12);
    /* Each of the ways to go wrong shows, so the sum above can fail. */
    assert_true(toy_expectation(TOY_OWN, none) < 0.9);
    assert_true(toy_expectation(TOY_OWN, target) < 0.9);
    assert_true(toy_expectation(TOY_ALL_SAMPLES, none) < 0.999);
    assert_true(toy_expectation(TOY_ENDED_GROWS, target) < 0.99);
    assert_true(toy_expectation(TOY_BY_COUNTS, none) < 0.95);
    assert_true(toy_expectation(TOY_BY_COUNTS, target) < 0.95);
}

/* The stricter of two targets: a smaller error, or more dB; those of two measures have no order. */
static void targets_have_an_order(void **state)
{
    static const struct allocation_target strict[] = {{ALLOCATION_DISPLAY, 2}, {ALLOCATION_PSNR, 45}, {ALLOCATION_RMSE, 0.5}};
    static const struct allocation_target loose[] = {{ALLOCATION_DISPLAY, 3}, {ALLOCATION_PSNR, 40}, {ALLOCATION_RMSE, 1}};

    (void)state;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            assert_int_equal(stop_target_is_stricter(&strict[i], &loose[k]), i == k);
            assert_false(stop_target_is_stricter(&loose[i], &strict[k]));
            assert_false(stop_target_is_stricter(&strict[i], &strict[k]));
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(targets_have_an_order),
        cmocka_unit_test(test_schedule),
        cmocka_unit_test(test_bins),
        cmocka_unit_test(test_grows_with_lambda),
        cmocka_unit_test(test_neyman),
        cmocka_unit_test(test_few_pixels_do_not_take_all),
        cmocka_unit_test(test_edge_tiles_count_by_the_pixel),
        cmocka_unit_test(test_a_dark_tile_beside_a_noisy_one),
        cmocka_unit_test(test_no_error_no_extras),
        cmocka_unit_test(test_units_do_not_matter),
        cmocka_unit_test(test_same_bits),
        cmocka_unit_test(test_prediction),
        cmocka_unit_test(test_prediction_leans_on_the_neighbourhood),
        cmocka_unit_test(test_exponent_is_learnt),
        cmocka_unit_test(test_prediction_is_what_is_reported),
        cmocka_unit_test(test_target_is_met_at_the_smallest_lambda),
        cmocka_unit_test(test_toy),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
