/* The map coordinates of directions, and the sine and cosine of longitudes: how far off they are, at the poles and
 * at the seam, and that the bits are the same on every machine. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/support/statistics.h"
#include "worker/render/base/lat_long.h"

enum { DIRECTIONS = 2000000 };

/* Every magnitude of the distance from a pole, and of the distance from an axis. */
static struct vec3 direction(struct test_random *random, int i)
{
    double v[3];

    for (int k = 0; k < 3; k++) {
        v[k] = 2 * test_random_double(random) - 1;
        if (i % 4 == k)
            v[k] *= pow(10, -30 * test_random_double(random) * (i / 4 % 2));
    }
    if (i % 4 == 3 && i / 4 % 2) {
        v[0] *= 1e-6;
        v[2] *= 1e-6;
    }
    return vec3_make((real)v[0], (real)v[1], (real)v[2]);
}

static void test_of_directions(void **state)
{
    struct test_random random = {1};
    double worst_u = 0, worst_distance = 0;

    (void)state;
    for (int i = 0; i < DIRECTIONS; i++) {
        struct vec3 d = direction(&random, i);
        double radius = sqrt((double)d.x * (double)d.x + (double)d.z * (double)d.z), u, distance, off;
        struct lat_long at;

        if (!(d.x * d.x + d.z * d.z > REAL(1e-30)))
            continue;
        lat_long_of(d, &at);
        u = 0.5 + atan2((double)d.z, (double)d.x) / (2 * PI_D);
        distance = atan2(radius, fabs((double)d.y)) / PI_D;
        off = fabs((double)at.u - u);
        off = off < 0.5 ? off : 1 - off;
        worst_u = off > worst_u ? off : worst_u;
        off = fabs((double)at.distance / distance - 1);
        worst_distance = off > worst_distance ? off : worst_distance;
        assert_true(at.u >= 0 && at.u < 1 && at.distance >= 0 && at.distance <= 0.5f && at.south == (d.y < 0));
    }
    print_message("errors: u %.3g turns, distance %.3g of itself\n", worst_u, worst_distance);
    assert_true(worst_u < 6e-8 && worst_distance < 3e-7);
}

static void test_of_longitudes(void **state)
{
    double worst = 0, longest = 0;

    (void)state;
    for (int i = 0; i <= 1 << 20; i++) {
        double turns = i * 0x1p-20, off;
        real sine, cosine;

        lat_long_sincos((real)turns, &sine, &cosine);
        off = fmax(fabs((double)sine - sin(2 * PI_D * turns)), fabs((double)cosine - cos(2 * PI_D * turns)));
        worst = off > worst ? off : worst;
        off = fabs((double)sine * (double)sine + (double)cosine * (double)cosine - 1);
        longest = off > longest ? off : longest;
    }
    print_message("errors: %.3g, of the length squared %.3g\n", worst, longest);
    assert_true(worst < 9e-8 && longest < 2e-7);
}

static void test_ends(void **state)
{
    static const struct {
        struct vec3 d;
        real u, distance;
        int south;
    } cases[] = {
        {{1, 0, 0}, 0.5f, 0.5f, 0},   {{0, 0, 1}, 0.75f, 0.5f, 0},   {{0, 0, -1}, 0.25f, 0.5f, 0},
        {{-1, 0, 0.0f}, 0, 0.5f, 0},  {{-1, 0, -0.0f}, 0, 0.5f, 0},  {{0, 1, 0}, 0.5f, 0, 0},
        {{0, -1, 0}, 0.5f, 0, 1},     {{1, 1, 0}, 0.5f, 0.25f, 0},   {{1, -1, 0}, 0.5f, 0.25f, 1},
        {{1, 0, 1}, 0.625f, 0.5f, 0}, {{-1, 0, 1}, 0.875f, 0.5f, 0}, {{-1, 0, -1}, 0.125f, 0.5f, 0},
    };
    static const real quarters[5][2] = {{0, 1}, {1, 0}, {0, -1}, {-1, 0}, {0, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lat_long at;

        lat_long_of(cases[i].d, &at);
        assert_true(at.u == cases[i].u && at.distance == cases[i].distance && at.south == cases[i].south);
    }
    for (int i = 0; i < 5; i++) {
        real sine, cosine;

        lat_long_sincos((real)i * 0.25f, &sine, &cosine);
        assert_true(sine == quarters[i][0] && cosine == quarters[i][1]);
    }
}

/* A hash over results, written down. */
static void test_bits(void **state)
{
    struct test_random random = {2};
    uint64_t hash = 14695981039346656037ull;

    (void)state;
    for (int i = 0; i < 2000; i++) {
        struct lat_long at;
        real results[4];

        lat_long_of(direction(&random, i), &at);
        results[0] = at.u;
        results[1] = at.distance;
        lat_long_sincos(at.u, &results[2], &results[3]);
        for (int k = 0; k < 4; k++)
            hash = (hash ^ float_bits((float)results[k])) * 1099511628211ull;
    }
    assert_int_equal(hash, 0x56b76062c2e2ba7bull);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_of_directions),
        cmocka_unit_test(test_of_longitudes),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_bits),
    };

    return cmocka_run_group_tests_name("lat-long", tests, NULL, NULL);
}
