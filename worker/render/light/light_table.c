#include "worker/render/light/light_table.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/light/tree.h"

/* A weight counts as at least this share of the total; otherwise it would vanish in the sum. */
#define WEIGHT_MIN 0x1p-40

static double weight_in_table(double weight, double total)
{
    if (!(weight > 0))
        return 0;
    return SAFEGUARD(LIGHT_TABLE_FAINT) ? fmax(weight, WEIGHT_MIN * total) : weight;
}

status light_table_init(struct light_table *table, const double *weights, uint32_t count, struct error *err)
{
    double total = 0;

    memset(table, 0, sizeof *table);
    table->start = mem_alloc_array((size_t)count + 1, sizeof *table->start);
    NEED(table->start, err, "the table of lights");
    for (uint32_t i = 0; i < count; i++)
        total += weights[i];
    table->start[0] = 0;
    for (uint32_t i = 0; i < count; i++)
        table->start[i + 1] = table->start[i] + weight_in_table(weights[i], total);
    if (table->start[count] > 0)
        table->count = count;
    return STATUS_OK;
}

void light_table_release(struct light_table *table)
{
    mem_free(table->start);
    memset(table, 0, sizeof *table);
}

/* Lights first .. end - 1, at least one of which has weight. */
struct range {
    uint32_t first, end;
};

static uint32_t middle_of(const struct range *r) { return r->first + (r->end - r->first) / 2; }

static real left_odds(const struct light_table *table, const struct range *r)
{
    const double *start = table->start;
    double left = start[middle_of(r)] - start[r->first];
    double right = start[r->end] - start[middle_of(r)];
    real share = (real)(left / (left + right));

    if (!(left > 0))
        return 0;
    if (!(right > 0))
        return 1;
    return real_min(real_max(share, LIGHT_TABLE_ODDS_MIN), 1 - LIGHT_TABLE_ODDS_MIN);
}

int light_table_choose(const struct light_table *table, real *u, real *v, uint32_t *light, real *odds)
{
    struct range r = {0, table->count};
    real *number = u, *other = v;

    *odds = 1;
    if (table->count == 0)
        return 0;
    while (r.end - r.first > 1) {
        real left = left_odds(table, &r), *spent = number;
        int goes_left = *number < left;
        real size = goes_left ? left : 1 - left;

        *number = light_rescaled(*number, goes_left ? 0 : left, size);
        *odds *= size;
        if (goes_left)
            r.end = middle_of(&r);
        else
            r.first = middle_of(&r);
        number = other;
        other = spent;
    }
    *light = r.first;
    return 1;
}

real light_table_odds(const struct light_table *table, uint32_t light)
{
    struct range r = {0, table->count};
    real odds = 1;

    if (light >= table->count)
        return 0;
    while (r.end - r.first > 1) {
        real left = left_odds(table, &r);

        if (light < middle_of(&r)) {
            odds *= left;
            r.end = middle_of(&r);
        } else {
            odds *= 1 - left;
            r.first = middle_of(&r);
        }
        if (!(odds > 0))
            return (real)health_density(odds);
    }
    return odds;
}
