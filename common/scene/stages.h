/* stages: the parts of a render whose share of the time is reported (manifest.h).
 *
 * A worker samples in which of them its threads are, about a hundred times a second
 * (worker/render/base/profile_scope.h); the counts travel with the results and are summed for each frame.
 */
#pragma once

/* X(name, text). The order is the wire's (RenderStats.stages): only add at the end. */
#define STAGE_MAP(X)                                                            \
    X(REST, "rest")         /* sampling numbers, sums, the way from tile to tile */ \
    X(CAMERA, "camera")     /* rays through lens and shutter */                 \
    X(TRACE, "trace")       /* Embree: nearest hits and shadow rays */          \
    X(SURFACE, "surface")   /* geometry of hits, textures, alpha, material mixes */ \
    X(SCATTER, "scatter")   /* BSDFs: set up, evaluated, sampled */             \
    X(LIGHT, "light")       /* choosing lights, what they send, environment */  \
    X(MEDIUM, "medium")     /* fog and other media, absorption */

enum stage {
#define STAGE_ENUM(name, text) STAGE_##name,
    STAGE_MAP(STAGE_ENUM)
#undef STAGE_ENUM
        STAGE_COUNT
};

#define STAGE_NAME_CASE(name, text) \
    case STAGE_##name:              \
        return text;
static inline const char *stage_name(enum stage stage)
{
    switch (stage) {
        STAGE_MAP(STAGE_NAME_CASE)
    case STAGE_COUNT: break;
    }
    return "unknown";
}
#undef STAGE_NAME_CASE
