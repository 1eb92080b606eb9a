/* The lamps' guide: lights are chosen with the odds that it claims (chi-square, family-wise level 0.01, Sidak), it
 * chooses those whose light arrives, none of the others is lost, and it holds only where the pilot has been and where it
 * helps. The pilot is made up here: a wall hides the lights beyond it. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/chi_square.h"
#include "tests/support/statistics.h"
#include "worker/render/light/lamp_guide.h"

enum { POINTS = 800, SIDE = 20, LIGHTS_MAX = 600, SAMPLES = 60000 };

/* Points on a square of the floor, 4 m wide around the origin; lights above it. */
struct made_up {
    struct pilot_point points[POINTS];
    struct light_bounds lights[LIGHTS_MAX];
    uint32_t count;
    int has_wall; /* at x = 0, from the floor to the lights */
    struct light_tree tree;
    struct lamp_guide guide;
};

static const struct vec3 up = {0, 1, 0};

static real place_of(const struct made_up *m, uint32_t item) { return m->lights[item].min.x; }

static int choose(void *user, uint32_t point, real u, real v, struct lamp_trial *out)
{
    const struct made_up *m = user;
    const struct pilot_point *at = &m->points[point];
    struct vec3 to;
    real squared;

    assert_true(u >= 0 && u < 1 && v >= 0 && v < 1);
    if (!light_tree_choose(&m->tree, NULL, at->p, at->n, &u, &v, &out->item, &out->odds))
        return 0;
    to = vec3_sub(m->lights[out->item].min, at->p);
    squared = vec3_length_squared(to);
    out->trial = (struct light_trial){out->odds,
                                      m->lights[out->item].intensity * vec3_dot(to, at->n) / (squared * real_sqrt(squared)), 0};
    out->arrives = !m->has_wall || (place_of(m, out->item) < 0) == (at->p.x < 0) ? 1 : 0;
    return 1;
}

static void make(struct made_up *m, uint32_t count, int has_wall)
{
    struct test_random random = {41};
    struct lamp_pilot pilot = {m->points, POINTS, choose, m, 3};
    struct error err = {0};

    memset(m, 0, sizeof *m);
    m->count = count;
    m->has_wall = has_wall;
    for (int i = 0; i < POINTS; i++)
        m->points[i] = (struct pilot_point){
            vec3_make((real)(i % SIDE) / SIDE * 4 - 2, 0, (real)(i / SIDE) / (POINTS / SIDE) * 4 - 2), up};
    for (uint32_t i = 0; i < count; i++) {
        struct vec3 p = vec3_make(4 * test_random_float(&random) - 2, 2 + test_random_float(&random),
                                  4 * test_random_float(&random) - 2);

        m->lights[i] = (struct light_bounds){p, p, vec3_make(0, -1, 0), REAL_PI, 0, INFINITY,
                                             0.2f + test_random_float(&random), 0, 0, 0};
    }
    assert_int_equal(light_tree_init(&m->tree, m->lights, count, &err), STATUS_OK);
    assert_int_equal(lamp_guide_init(&m->guide, &m->tree, &pilot, &err), STATUS_OK);
}

static void unmake(struct made_up *m)
{
    lamp_guide_release(&m->guide);
    light_tree_release(&m->tree);
}

static const float32 *seen_at(const struct made_up *m, struct vec3 p, struct vec3 n)
{
    const struct light_context context = {.p = p, .n = n};

    return lamp_guide_seen(&m->guide, &context);
}

static void test_follows_its_odds(void **state)
{
    static const uint32_t counts[] = {2, 3, 40, LIGHTS_MAX};
    static const struct vec3 places[] = {{-1.5f, 0, 0.3f}, {-0.2f, 0, 1.2f}, {0.7f, 0, -1.1f}};
    enum { TESTS = 4 * 3 };
    static double hits[LIGHTS_MAX];
    static struct made_up m;
    struct test_random random = {9};

    (void)state;
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
        make(&m, counts[c], 1);
        for (size_t k = 0; k < sizeof places / sizeof *places; k++) {
            const float32 *seen = seen_at(&m, places[k], up);
            double sum = 0, statistic = 0, pooled = 0, pooled_hits = 0;
            int cells = 0;

            if (counts[c] > 3)
                assert_non_null(seen);
            memset(hits, 0, sizeof hits);
            for (int i = 0; i < SAMPLES; i++) {
                real u = test_random_float(&random), v = test_random_float(&random), odds;
                uint32_t item;

                assert_true(light_tree_choose(&m.tree, seen, places[k], up, &u, &v, &item, &odds));
                assert_true(odds > 0 && odds == light_tree_odds(&m.tree, seen, places[k], up, item));
                hits[item]++;
            }
            for (uint32_t i = 0; i < counts[c]; i++) {
                double odds = (double)light_tree_odds(&m.tree, seen, places[k], up, i), expected = odds * SAMPLES;

                assert_true(odds > 0); /* whatever it believes */
                sum += odds;
                if (expected < 10) {
                    pooled += expected;
                    pooled_hits += hits[i];
                    continue;
                }
                statistic += (hits[i] - expected) * (hits[i] - expected) / expected;
                cells++;
            }
            if (pooled > 10) {
                statistic += (pooled_hits - pooled) * (pooled_hits - pooled) / pooled;
                cells++;
            }
            assert_true(fabs(sum - 1) < 1e-4);
            assert_true(cells < 2 || chi_square_p_value(statistic, cells - 1) > sidak_alpha(0.01, TESTS));
        }
        unmake(&m);
    }
}

/* The odds of what is behind the wall. */
static double hidden_odds(const struct made_up *m, const float32 *seen, struct vec3 p)
{
    double sum = 0;

    for (uint32_t i = 0; i < m->count; i++)
        if ((place_of(m, i) < 0) != (p.x < 0))
            sum += (double)light_tree_odds(&m->tree, seen, p, up, i);
    return sum;
}

static void test_chooses_what_arrives(void **state)
{
    static const struct vec3 places[] = {{-0.3f, 0, 0.3f}, {-0.4f, 0, -1.2f}, {0.3f, 0, 0.2f}, {0.6f, 0, 1.4f}};
    static struct made_up m;

    (void)state;
    make(&m, 200, 1);
    for (size_t k = 0; k < sizeof places / sizeof *places; k++) {
        double tree = hidden_odds(&m, NULL, places[k]), learned = hidden_odds(&m, seen_at(&m, places[k], up), places[k]);

        print_message("# behind the wall: %.3f of the choices, by the guide %.3f\n", tree, learned);
        assert_true(tree > 0.2 && learned < 0.4 * tree);
    }
    unmake(&m);
}

static void test_only_where_it_helps(void **state)
{
    static struct made_up m;
    const struct vec3 middle = {-0.7f, 0, 0.2f};

    (void)state;
    make(&m, 200, 1);
    assert_non_null(seen_at(&m, middle, up));
    assert_null(seen_at(&m, middle, vec3_make(0, -1, 0)));
    assert_null(seen_at(&m, middle, vec3_make(0, 0, 0))); /* in a medium */
    assert_null(seen_at(&m, vec3_make(-0.7f, 3, 0.2f), up));
    assert_null(seen_at(&m, vec3_make(90, 0, 0.2f), up));
    assert_null(seen_at(&m, vec3_make(-0.7f, -3, 0.2f), up));
    assert_null(seen_at(&m, vec3_make(-0.7f, 0, -90), up));
    for (size_t i = 0; i < (size_t)m.guide.at.count * m.guide.known_count; i++)
        assert_true(m.guide.seen[i] >= 0.099f && m.guide.seen[i] <= 1);
    unmake(&m);
    make(&m, 200, 0); /* all arrives */
    assert_int_equal(m.guide.at.count, 0);
    unmake(&m);
    make(&m, 1, 1); /* nothing is chosen */
    assert_int_equal(m.guide.at.count, 0);
    unmake(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_follows_its_odds),
        cmocka_unit_test(test_chooses_what_arrives),
        cmocka_unit_test(test_only_where_it_helps),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
