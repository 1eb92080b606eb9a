/* The time left of a frame whose tiles differ in cost: recorded costs of a few pictures, replayed by
 * workers under a simulated clock. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "coordinator/frame/eta.h"
#include "tests/support/eta_replay.h"

enum { WIDTH = 320, HEIGHT = 192, THREADS_MAX = 8 };

/* Cost of a sample, in units of 100 ns, of tile (x, y) of 20 x 12: sky above, and something dear below or in it. */
static double slope(double x, double y) { return y < 5 ? 100 : 100 + 3900 * (y - 4) / 7 * (0.6 + x / 50); }

static double sphere(double x, double y) { return hypot(x - 9.5, y - 6) < 4 ? 9600 : 100; }

static double trees(double x, double y) { return y < 6 ? 120 : 1900 + 1500 * sin(x * 1.7) * cos(y * 2.3); }

static double lake(double x, double y) { return (y < 4 ? 150 : y < 8 ? 800 : 2400) * (1 + x / 40); }

static double lamp(double x, double y) { return hypot(x - 3, y - 9) < 2 ? 6400 : y < 7 ? 100 : 700; }

/* A unit of such a frame, off by up to a tenth. */
struct map {
    double (*cost)(double x, double y);
    uint64_t random;
};

static uint64_t unit_cost(void *user, const struct eta_unit *unit)
{
    struct map *m = user;
    struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, unit->tile);

    m->random = m->random * 6364136223846793005ull + 1442695040888963407ull;
    return (uint64_t)(100 * (double)unit->samples * m->cost(rect.x / TILE_SIZE, rect.y / TILE_SIZE) *
                      (0.9 + 0.2 * ((double)(m->random >> 11) / 9007199254740992.0)));
}

static double replay(double (*cost)(double, double), uint32_t spp, uint32_t threads, double speed)
{
    struct map map = {cost, 0};
    struct eta_frame frame = {WIDTH, HEIGHT, spp, unit_cost, &map};

    return eta_replay(&frame, threads, speed);
}

static void time_left_is_right_on_uneven_frames(void **state)
{
    static const struct {
        const char *name;
        double (*cost)(double x, double y);
    } scenes[] = {{"slope", slope}, {"sphere", sphere}, {"trees", trees}, {"lake", lake},
                  {"lamp", lamp}};

    (void)state;
    for (size_t i = 0; i < sizeof scenes / sizeof scenes[0]; i++)
        for (uint32_t threads = 1; threads <= THREADS_MAX; threads *= 8) {
            double share = replay(scenes[i].cost, 64, threads, 1);
            if (!(share >= 0.8))
                fail_msg("%s, %u threads: within 20 %% for %.0f %% of the time", scenes[i].name, threads, 100 * share);
        }
}

static void speed_counts(void **state)
{
    (void)state;
    /* A thread that gets half of a processor, because others use it. */
    assert_true(replay(sphere, 64, 2, 0.5) >= 0.8);
}

/* Of a film from disk nothing is measured yet in this run: its rays tell the tiles apart. */
static void rays_stand_in_for_time(void **state)
{
    static float sums[TILE_FLOATS_MAX];
    struct film *film = film_new(32, 16, 8);
    enum film_merge_result merged;
    struct eta eta;
    double left;

    (void)state;
    film_want_all(film);
    for (uint32_t tile = 0; tile < 2; tile++) {
        struct unit_result unit = {.tile = tile, .sums = sums,
                                   .count = tile_floats(32, 16, tile, 0),
                                   .work = {.samples = 512, .rays = tile == 0 ? 512 : 9 * 512}};
        assert_int_equal(film_merge(film, &unit, 1, &merged, NULL), STATUS_OK);
    }
    eta_init(&eta, film);
    assert_true(eta_left_ns(&eta, film) < 0);
    eta_learn(&eta, 0, 512, 512 * 100); /* 100 ns a sample, which has one ray */
    left = eta_left_ns(&eta, film);
    /* Tile 0: 1,024 samples more at 100 ns; tile 1: 1,536 of nine rays each, by the frame's mean of 5. */
    assert_true(fabs(left - (1024 * 100.0 + 1536 * 9 * 100.0 / 5)) < 1);
    eta_release(&eta);
    film_free(film);
}

/* Sums that were asked for before are those of a frame that was never asked. */
static void sums_follow_the_frame(void **state)
{
    struct film *film = film_new(48, 32, 64);
    struct eta asked, silent;

    (void)state;
    eta_init(&asked, film);
    assert_true(eta_left_ns(&asked, film) < 0 && eta_whole_ns(&asked, film) < 0);
    for (uint32_t i = 0; i < 60; i++) {
        if (i % 3 == 0)
            film_want(film, i % 6, i / 6 % GROUPS, 2 + i / 12); /* no result comes */
        else
            eta_learn(&asked, i * 7 % 6, 512, 512 * (100 + 10 * i));
        eta_init(&silent, film);
        memcpy(silent.of, asked.of, asked.tiles * sizeof *silent.of);
        silent.results = asked.results;
        for (int again = 0; again < 2; again++) {
            assert_true(eta_left_ns(&asked, film) == eta_left_ns(&silent, film));
            assert_true(eta_whole_ns(&asked, film) == eta_whole_ns(&silent, film));
        }
        eta_release(&silent);
    }
    eta_release(&asked);
    film_free(film);
}

static void throughput_forgets(void **state)
{
    struct throughput t = {0};
    uint64_t now_ns = 0;

    (void)state;
    assert_true(throughput_of(&t) == 0);
    for (int i = 0; i < 100; i++)
        throughput_add(&t, NS_PER_SECOND, now_ns += NS_PER_SECOND);
    assert_true(fabs(throughput_of(&t) - 1) < 0.05);
    throughput_idle(&t, now_ns += 1000 * NS_PER_SECOND); /* nobody worked on it */
    for (int i = 0; i < 150; i++)
        throughput_add(&t, 4 * NS_PER_SECOND, now_ns += NS_PER_SECOND);
    assert_true(fabs(throughput_of(&t) - 4) < 0.1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(time_left_is_right_on_uneven_frames),
        cmocka_unit_test(speed_counts),
        cmocka_unit_test(rays_stand_in_for_time),
        cmocka_unit_test(sums_follow_the_frame), cmocka_unit_test(throughput_forgets),
    };
    return cmocka_run_group_tests_name("eta", tests, NULL, NULL);
}
