/* light_table: lights chosen by fixed odds, the same at every vertex. The tree of lights (tree.h) is compared with it.
 *
 * The lights are halved in their given order until one is left. A half is taken with odds in proportion to its weight,
 * and the two numbers are used in turns, so that each keeps digits for the point on the light. A half with any weight
 * keeps at least LIGHT_TABLE_ODDS_MIN; otherwise a light of very small weight would use up all the digits.
 * Invariant: light_table_choose and light_table_odds compute a light's odds by the same operations in the same order.
 */
#pragma once

#include <stdint.h>

#include "common/math/real.h"
#include "common/base/status.h"

#define LIGHT_TABLE_ODDS_MIN 0x1p-10f

struct light_table {
    uint32_t count; /* 0: nothing to choose */
    double *start;  /* [count + 1] sums of the weights before each light */
};

/* weights[count]: finite, >= 0, with a finite sum; 0: never chosen. If all are 0 the table's count
 * is 0. ERR_NO_MEMORY. */
status light_table_init(struct light_table *table, const double *weights, uint32_t count, struct error *err) MUST_CHECK;
void light_table_release(struct light_table *table);

/* Choose a light; u and v, each in [0, 1), are returned rescaled. 0: there is none. */
int light_table_choose(const struct light_table *table, real *u, real *v, uint32_t *light, real *odds);
/* The odds with which light_table_choose chooses that light. */
real light_table_odds(const struct light_table *table, uint32_t light);
