/* chi_square: does a sampler of directions follow the density that it claims?
 *
 * The sphere is cut into cells; the histogram of many samples is compared with the
 * integral of the density over each cell (adaptive Gauss quadrature). What the sampler
 * refuses ("no sample", or a delta lobe) is one more cell, whose expectation is what the
 * density lacks of 1: so a density that integrates to the wrong total is found too.
 * Cells with few expected hits are pooled. Pearson's statistic then has a chi-square
 * distribution with (cells - 1) degrees of freedom.
 *
 * Cells are cos(theta) x phi around `axis`. For a narrow lobe point the axis at the lobe
 * and set `focus` above 1: with x = ((1 - cos theta) / 2)^(1 / focus) in [0,1] the cells
 * are equal in x, so that they shrink towards the axis (focus 1 is equal in cos theta;
 * focus 8 puts the first of ten cells within 0.01 degrees). A lobe that is narrower across
 * the plane of z and the axis than along it (by `squeeze` < 1) gets azimuth cells that crowd
 * towards that plane, like the sectors of an ellipse. With axis z, focus 1 and an even
 * number of cells the horizon is a cell border, which suits BSDFs.
 */
#pragma once

#include <stdint.h>

#include "common/math/vec.h"

struct chi_square_setup {
    /* Turn three random numbers in [0,1) into a unit direction; 0 for "none". */
    int (*sample)(void *user, const float u[3], struct vec3 *wi);
    /* Solid-angle density of that direction. */
    double (*pdf)(void *user, struct vec3 wi);
    void *user;
    int cos_cells, phi_cells; /* 0: 10 and 20 */
    uint64_t samples;         /* 0: 5000 for each cell */
    uint64_t seed;
    struct vec3 axis;    /* zero vector: z */
    double focus;        /* 0: 1 */
    double squeeze;      /* 0: 1 */
    double expected_min; /* cells below are pooled; 0: 5 */
    int aligned;         /* edges of the density follow the cells': what integrals are off there has one sign */
};

struct chi_square_result {
    double p_value; /* 0 where `reason` is not NULL */
    double statistic;
    int degrees;        /* of freedom */
    int pooled;         /* how many cells were pooled */
    double mass;        /* integral of the density */
    const char *reason; /* NULL, or a fault that needs no statistics (a static text) */
    /* [cos_cells * phi_cells + 1], the last is "none"; owned by the result */
    double *observed, *expected;
    int cos_cells, phi_cells;
};

/* Runs the test; 0 when out of memory. */
int chi_square_run(const struct chi_square_setup *setup, struct chi_square_result *out);
void chi_square_result_release(struct chi_square_result *r);

/* Verdict, the cells that deviate most, and both tables, to standard error. */
void chi_square_print(const struct chi_square_result *r, const char *name);

/* Run, and accept when p >= sidak_alpha(alpha, tests); prints the tables if not. */
int chi_square_accept(const struct chi_square_setup *setup, double alpha, unsigned tests, const char *name);
