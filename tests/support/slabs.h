/* slabs: what tests of volumes share: smooth glass, dyed or clear, seen head on (layers.h has the
 * closed forms). */
#pragma once

#include <math.h>

#include "tests/support/scene_builder.h"

/* After `distance` metres the glass's colour is left of white light; INFINITY: it is clear. */
static inline void slabs_dye(struct scene_material *m, float distance)
{
    static const float color[3] = {0.8f, 0.5f, 0.2f};

    m->attenuation_distance = distance;
    for (int c = 0; c < 3; c++)
        m->attenuation_color[c] = color[c];
}

static inline struct scene_material *slabs_glass(struct scene_builder *b, float ior, float distance)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->double_sided = 0;
    m->specular = m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = ior;
    slabs_dye(m, distance);
    return m;
}

/* Straight down from this height. */
static inline void slabs_camera(struct scene_builder *b, float height)
{
    builder_camera(b, vec3_make(0.3f, height, 0.1f), vec3_make(0.3f, -9, 0.1f), 0.002f);
}

/* The same under an even sky of radiance 1. */
static inline void slabs_look_down(struct scene_builder *b, float height)
{
    builder_environment_constant(b, vec3_splat(1));
    slabs_camera(b, height);
}

static inline struct render_settings slabs_settings(void)
{
    struct render_settings s = builder_settings(8, 8, 64);

    s.max_depth = 100;
    return s;
}
