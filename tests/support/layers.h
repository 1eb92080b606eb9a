/* layers: closed forms for plane layers that are met head on, light of both directions added
 * without phase. */
#ifndef AZULEJO_TESTS_LAYERS_H
#define AZULEJO_TESTS_LAYERS_H

#include <math.h>

#include "common/scene/scene.h"

/* Reflectance and transmittance as seen from above, and reflectance from below. */
struct layers {
    double r_above, t, r_below;
};

static inline struct layers layers_stacked(struct layers a, struct layers b)
{
    double series = 1 / (1 - a.r_below * b.r_above);

    return (struct layers){a.r_above + a.t * a.t * b.r_above * series, a.t * b.t * series,
                           b.r_below + b.t * b.t * a.r_below * series};
}

/* Between two indices of refraction. */
static inline struct layers layers_interface(double above, double below)
{
    double r = pow((above - below) / (above + below), 2);

    return (struct layers){r, 1 - r, r};
}

static inline struct layers layers_absorber(double per_metre, double thickness)
{
    return (struct layers){0, exp(-per_metre * thickness), 0};
}

/* What a channel of a dyed volume absorbs, 1/metre. */
static inline double layers_per_metre(const struct scene_material *m, int channel)
{
    return m->attenuation_distance < INFINITY ? -log((double)m->attenuation_color[channel]) /
                                                    (double)m->attenuation_distance
                                              : 0;
}

/* What is seen from above under an even sky of radiance 1. */
static inline double layers_seen(struct layers s)
{
    return s.r_above + s.t;
}

#endif
