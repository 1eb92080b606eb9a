/* layers: closed forms for plane layers that are met head on, light of both directions added
 * without phase. */
#pragma once

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
    return m->attenuation_distance < INFINITY
               ? -log((double)m->attenuation_color[channel]) / (double)m->attenuation_distance
               : 0;
}

/* What is seen from above under an even sky of radiance 1. */
static inline double layers_seen(struct layers s) { return s.r_above + s.t; }

/* A part of a stack that is all of one material; NULL: air. */
struct sheet {
    const struct scene_material *material;
    double thickness; /* metres */
};

/* What is seen of sheets that lie in air, from the uppermost on, in each channel. */
static inline void layers_seen_rgb(double out[3], const struct sheet *sheets, size_t count)
{
    for (int c = 0; c < 3; c++) {
        struct layers s = {0, 1, 0};
        double above = 1;
        for (size_t i = 0; i < count; i++) {
            const struct scene_material *m = sheets[i].material;
            double index = m ? (double)m->ior : 1;
            s = layers_stacked(s, layers_interface(above, index));
            if (m)
                s = layers_stacked(s, layers_absorber(layers_per_metre(m, c), sheets[i].thickness));
            above = index;
        }
        out[c] = layers_seen(layers_stacked(s, layers_interface(above, 1)));
    }
}
#define LAYERS_SEEN(out, ...) \
    layers_seen_rgb(out, (const struct sheet[]){__VA_ARGS__}, \
                    sizeof (const struct sheet[]){__VA_ARGS__} / sizeof(struct sheet))
