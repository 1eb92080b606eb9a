/* moments: how noisy the direct light of a diffuse surface is, from directions that were tried. */
#pragma once

#include "common/math/elementary.h"
#include "common/math/vec.h"

/* A direction that was tried. */
struct light_trial {
    real density; /* with which it was chosen */
    real light;   /* luminance times cosine / pi of what arrives */
    real cosine;  /* 0: scattering cannot find the light */
};

/* By multiple importance sampling, one sample by light sampling and one by the cosine: means and second moments of the
 * two. */
struct light_moments {
    double light, light2, scattered, scattered2;
};

static inline double light_moments_mean(const struct light_moments *m) { return m->light + m->scattered; }

static inline double light_moments_variance(const struct light_moments *m)
{
    return m->light2 - m->light * m->light + m->scattered2 - m->scattered * m->scattered;
}

/* One of `count` trials, if light sampling has density q there. */
static inline void light_moments_add(struct light_moments *m, const struct light_trial *t, double q, double count)
{
    const double p = (double)t->cosine / PI_D, sum = q * q + p * p, f = (double)t->light;
    const double share = 1 / ((double)t->density * count);

    m->light += f * q * q / sum * share;
    m->light2 += f * f * q * q * q / (sum * sum) * share;
    m->scattered += f * p * p / sum * share;
    m->scattered2 += f * f * p * p * p / (sum * sum) * share;
}
