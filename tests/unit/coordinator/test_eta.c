/* The time left of a frame whose tiles differ in cost: recorded costs of a few pictures, replayed by
 * workers under a simulated clock. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/clock.h"
#include "coordinator/eta.h"

enum { WIDTH = 320, HEIGHT = 192, THREADS_MAX = 8 };

/* Cost of a sample, in units of 100 ns, of tile (x, y) of 20 x 12: sky above, and something dear below or in it. */
static double slope(double x, double y)
{
    return y < 5 ? 100 : 100 + 3900 * (y - 4) / 7 * (0.6 + x / 50);
}

static double sphere(double x, double y)
{
    return hypot(x - 9.5, y - 6) < 4 ? 9600 : 100;
}

static double trees(double x, double y)
{
    return y < 6 ? 120 : 1900 + 1500 * sin(x * 1.7) * cos(y * 2.3);
}

static double lake(double x, double y)
{
    return (y < 4 ? 150 : y < 8 ? 800 : 2400) * (1 + x / 40);
}

static double lamp(double x, double y)
{
    return hypot(x - 3, y - 9) < 2 ? 6400 : y < 7 ? 100 : 700;
}

struct worker {
    double free_s;
    uint32_t tile, group, pass;
    uint64_t cpu_ns, samples;
    int busy;
};

struct replay {
    struct film *film;
    struct eta eta;
    struct throughput throughput;
    struct worker workers[THREADS_MAX];
    uint32_t threads, next, units;
    double now_s, speed;
    uint64_t random;
    float sums[TILE_FLOATS_MAX];
};

static double random_number(struct replay *r)
{
    r->random = r->random * 6364136223846793005ull + 1442695040888963407ull;
    return (double)(r->random >> 11) / 9007199254740992.0;
}

/* The next unit in the order in which a frame grants them; 0: none is left. */
static int take_unit(struct replay *r, struct worker *w, double (*cost)(double, double))
{
    uint32_t tiles = film_tile_count(r->film), begin, end;
    struct tile_rect rect;

    do {
        if (r->next >= r->units)
            return 0;
        w->tile = r->next % tiles;
        w->group = r->next / tiles % GROUPS;
        w->pass = r->next / tiles / GROUPS;
        r->next++;
    } while (w->pass >= film_pass_count(r->film, w->group));
    rect = tile_rect_of(WIDTH, HEIGHT, w->tile);
    pass_range(film_spp(r->film), w->group, w->pass, &begin, &end);
    w->samples = (uint64_t)rect.width * rect.height * (end - begin);
    w->cpu_ns = (uint64_t)(100 * (double)w->samples * cost(rect.x / TILE_SIZE, rect.y / TILE_SIZE) *
                           (0.9 + 0.2 * random_number(r)));
    w->free_s = r->now_s + (double)w->cpu_ns / 1e9 / r->speed;
    w->busy = 1;
    return 1;
}

/* The earliest worker hands in its result; 0: none is busy. */
static int deliver(struct replay *r)
{
    struct worker *first = NULL;
    enum film_merge_result merged;
    struct unit_result unit;

    for (uint32_t i = 0; i < r->threads; i++)
        if (r->workers[i].busy && (!first || r->workers[i].free_s < first->free_s))
            first = &r->workers[i];
    if (!first)
        return 0;
    r->now_s = first->free_s;
    first->busy = 0;
    unit = (struct unit_result){.tile = first->tile, .group = first->group, .pass = first->pass,
                                .sums = r->sums,
                                .count = tile_floats(WIDTH, HEIGHT, first->tile, 0),
                                .work = {.samples = first->samples, .rays = first->samples}};
    assert_int_equal(film_merge(r->film, &unit, 1, &merged, NULL), STATUS_OK);
    eta_learn(&r->eta, first->tile, first->samples, first->cpu_ns);
    throughput_add(&r->throughput, first->cpu_ns, (uint64_t)(r->now_s * 1e9));
    return 1;
}

enum { GUESSES_MAX = 1 << 18 };
static double guesses[GUESSES_MAX][2]; /* time, seconds left */

/* The share of the time after the first tenth in which the guess was within 20 % of the truth. */
static double share_right(size_t count, double end_s)
{
    double right = 0, all = 0;

    for (size_t i = 0; i + 1 < count; i++) {
        double dt = guesses[i + 1][0] - guesses[i][0], truth = end_s - guesses[i][0];
        if (guesses[i][0] < 0.1 * end_s)
            continue;
        all += dt;
        if (fabs(guesses[i][1] - truth) <= 0.2 * truth)
            right += dt;
    }
    return right / all;
}

static double replay(double (*cost)(double, double), uint32_t spp, uint32_t threads, double speed)
{
    static struct replay r;
    size_t count = 0;
    double share;

    memset(&r, 0, sizeof r);
    r.film = film_new(WIDTH, HEIGHT, spp);
    assert_non_null(r.film);
    film_want_all(r.film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(r.film, g, NULL);
    eta_init(&r.eta, r.film);
    r.threads = threads;
    r.speed = speed;
    r.units = film_tile_count(r.film) * GROUPS * film_pass_count(r.film, 0);
    r.now_s = 1000;
    assert_true(eta_left_ns(&r.eta, r.film) < 0);
    do {
        for (uint32_t i = 0; i < threads; i++)
            if (!r.workers[i].busy)
                (void)take_unit(&r, &r.workers[i], cost);
        guesses[count][0] = r.now_s - 1000;
        guesses[count][1] = throughput_of(&r.throughput) > 0
                                ? eta_left_ns(&r.eta, r.film) / 1e9 / throughput_of(&r.throughput)
                                : -1;
        count += count + 1 < GUESSES_MAX;
    } while (deliver(&r));
    assert_true(film_complete(r.film));
    assert_true(eta_left_ns(&r.eta, r.film) == 0);
    share = share_right(count, r.now_s - 1000);
    eta_release(&r.eta);
    film_free(r.film);
    return share;
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
                fail_msg("%s, %u threads: within 20 %% for %.0f %% of the time", scenes[i].name,
                         threads, 100 * share);
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
        cmocka_unit_test(throughput_forgets),
    };
    return cmocka_run_group_tests_name("eta", tests, NULL, NULL);
}
