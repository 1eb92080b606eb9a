/* scene_effects: which effects a scene needs.
 *
 * Walks what is reachable from the scene's instances, lights, cameras and environment and returns a
 * set. What is not in the set need not be simulated.
 */
#pragma once

#include "common/scene/effects.h"
#include "common/scene/scene.h"

struct render_settings;

/* How many causes of an effect are named after the first. */
enum { EFFECT_CAUSES_ALSO = 7 };

struct effect_caller {
    const char *kind; /* "material", "light", "camera", "environment", "medium", "mesh" ... */
    const char *name; /* may be "" */
    uint32_t index;   /* its row */
};

/* What needs an effect. */
struct effect_cause {
    const char *kind; /* of the first cause; NULL: nothing needs it */
    const char *name;
    uint32_t index;
    uint32_t count;                                /* number of causes */
    struct effect_caller also[EFFECT_CAUSES_ALSO]; /* the next ones; kind is NULL after the last */
};

/* What one frame of a validated scene needs, without what settings->without switches off. Instances count only through
 * what they use: an unused material or light does not count, a factor of 0 is absent whatever its texture, alpha that
 * is 1 everywhere is absent, closed opaque meshes seen from outside need no culling, motion while the shutter is closed
 * blurs nothing. If in doubt the effect is in the set.
 * causes[EFFECT_COUNT], filled if not NULL. */
uint64_t scene_effects(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                       struct effect_cause *causes);

/* The same for frame 0 with default settings and this camera. */
uint64_t scene_effects_default(const struct scene *scene, uint32_t camera);
