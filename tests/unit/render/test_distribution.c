/* The grid distribution: choices follow the weights, cells and rows of weight 0 are never
 * chosen whatever the numbers, and the fractions inside a cell fill it evenly. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/light/environment/distribution.h"
#include "worker/render/base/sampler.h"

static void make(struct distribution *d, uint32_t rows, uint32_t columns, const double *weights)
{
    struct error err = {0};

    if (distribution_init(d, rows, columns, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    for (uint32_t row = 0; row < rows; row++)
        distribution_set_row(d, row, weights + (size_t)row * columns);
    assert_true(distribution_finish(d));
}

static double odds(const struct distribution *d, uint32_t row, uint32_t column)
{
    return (double)distribution_row_odds(d, row) * distribution_width(d, row, column) / DISTRIBUTION_WHOLE;
}

static struct distribution_cell choose(const struct distribution *d, float u, float v)
{
    struct distribution_cell cell;

    distribution_choose(d, u, v, &cell);
    assert_true(cell.row < d->rows && cell.column < d->columns);
    assert_true(cell.row_fraction >= 0 && cell.row_fraction <= 1);
    assert_true(cell.column_fraction >= 0 && cell.column_fraction <= 1);
    assert_true(odds(d, cell.row, cell.column) > 0 && cell.width == distribution_width(d, cell.row, cell.column));
    return cell;
}

/* Random weights, two thirds of them 0, on grids around the block size; a regular grid of
 * numbers must reach each cell in proportion. */
static void test_proportions(void **state)
{
    enum { SIDE = 600 };
    static const uint32_t sizes[][2] = {{1, 1},  {1, 40}, {40, 1}, {3, 15},
                                        {3, 16}, {3, 17}, {5, 33}};
    static double weights[64 * 64], counts[64 * 64];

    (void)state;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        uint32_t rows = sizes[s][0], columns = sizes[s][1];
        double total = 0, row_sum[64] = {0};
        struct distribution d;

        memset(counts, 0, sizeof counts);
        for (uint32_t i = 0; i < rows * columns; i++) {
            weights[i] = i == 0 || hash_u32(i) % 3 == 0 ? 1 + hash_u32(i + 99) % 50 : 0;
            total += weights[i];
            row_sum[i / columns] += weights[i];
        }
        make(&d, rows, columns, weights);
        assert_true(fabs(d.total - total) < 1e-12 * total);
        for (int a = 0; a < SIDE; a++)
            for (int b = 0; b < SIDE; b++) {
                struct distribution_cell cell = choose(&d, ((float)a + 0.5f) / SIDE, ((float)b + 0.5f) / SIDE);
                counts[cell.row * columns + cell.column] += 1.0 / (SIDE * SIDE);
            }
        for (uint32_t i = 0; i < rows * columns; i++) {
            /* A cell's edges can gain or lose a line of the grid each. */
            double share = row_sum[i / columns] / total, want = weights[i] / total;
            double slack = share / DISTRIBUTION_WHOLE + 1.01 / SIDE * (share + want / fmax(share, 1e-9)) + 1.0 / SIDE / SIDE;

            /* Starts are rounded to a 65535th of the row, and rows to 2^-24; the odds are the rounded ones'. */
            assert_true(fabs(odds(&d, i / columns, i % columns) - want) <= share / DISTRIBUTION_WHOLE + 0x1p-24);
            if (weights[i] == 0)
                assert_true(counts[i] == 0 && odds(&d, i / columns, i % columns) == 0);
            else
                assert_true(fabs(counts[i] - want) <= slack);
        }
        distribution_release(&d);
    }
}

/* Empty rows and columns at both ends: the extreme numbers land inside. */
static void test_extreme_numbers(void **state)
{
    enum { ROWS = 9, COLUMNS = 70 };
    static const float extremes[] = {0.0f, 0x1p-149f, 0x1p-32f, 0x1p-24f, 0.5f, 0.99999f,
                                     ONE_MINUS_EPSILON};
    static double weights[ROWS * COLUMNS];
    struct distribution d;

    (void)state;
    for (int only = 0; only < ROWS * COLUMNS; only += 7) { /* one cell alone, anywhere */
        memset(weights, 0, sizeof weights);
        weights[only] = 1e-30;
        make(&d, ROWS, COLUMNS, weights);
        for (int a = 0; a < 7; a++)
            for (int b = 0; b < 7; b++) {
                struct distribution_cell cell = choose(&d, extremes[a], extremes[b]);

                assert_int_equal(cell.row * COLUMNS + cell.column, only);
                assert_true(fabs(cell.column_fraction - (double)extremes[a]) < 1e-7);
                assert_true(fabs(cell.row_fraction - (double)extremes[b]) < 1e-7);
            }
        distribution_release(&d);
    }
    /* A speck beside a giant: never a cell of weight 0. */
    memset(weights, 0, sizeof weights);
    weights[3 * COLUMNS + 30] = 1e-12;
    weights[3 * COLUMNS + 33] = 1e20;
    weights[3 * COLUMNS + 40] = 1e-12;
    weights[7 * COLUMNS + 1] = 1e-3;
    make(&d, ROWS, COLUMNS, weights);
    for (int a = 0; a < 7; a++)
        for (int b = 0; b < 7; b++) {
            struct distribution_cell cell = choose(&d, extremes[a], extremes[b]);

            assert_true(weights[cell.row * COLUMNS + cell.column] > 0);
        }
    distribution_release(&d);
}

/* Both choices are monotone, and a cell's fractions run from 0 to 1 through it. */
static void test_monotone(void **state)
{
    enum { COLUMNS = 50, STEPS = 20000 };
    double weights[COLUMNS], before = -1;
    struct distribution d;

    (void)state;
    for (int i = 0; i < COLUMNS; i++)
        weights[i] = hash_u32((uint32_t)i) % 10;
    make(&d, 1, COLUMNS, weights);
    for (int i = 0; i < STEPS; i++) {
        struct distribution_cell cell = choose(&d, (float)i / STEPS, 0.3f);
        double position = cell.column + (double)cell.column_fraction;

        assert_true(position > before);
        before = position;
    }
    distribution_release(&d);
}

static void test_all_zero(void **state)
{
    static const double weights[6] = {0};
    struct distribution d;
    struct error err = {0};

    (void)state;
    assert_int_equal(distribution_init(&d, 2, 3, &err), STATUS_OK);
    distribution_set_row(&d, 0, weights);
    distribution_set_row(&d, 1, weights);
    assert_false(distribution_finish(&d));
    distribution_release(&d);
    for (long n = 0; n < 4; n++) {
        mem_fault_arm(n, 1);
        assert_int_equal(distribution_init(&d, 2, 3, &err), STATUS_ERR_NO_MEMORY);
        mem_fault_arm(-1, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_proportions),
        cmocka_unit_test(test_extreme_numbers),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_all_zero),
    };

    return cmocka_run_group_tests_name("distribution", tests, NULL, NULL);
}
