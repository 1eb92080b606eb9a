/* record: one sample rendered again, with all that its path did.
 *
 * render_sample gives the bits that render_tile adds to the film for the sample: the same pixel loop's
 * arithmetic, compiled once more with the sink of path/path_sink.h writing down each vertex. The kernels that
 * render pictures write nothing down. Light is added in the order of the vertices and, at a vertex, in the order
 * of enum path_source: summed in float in that order it is the path's radiance, bit for bit.
 */
#pragma once

#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/render.h"

enum {
    RECORD_VERTICES_MAX = 1536, /* kept; a path has at most SETTINGS_DEPTH_MAX + 1 and the boundaries it passed */
    RECORD_BODIES_MAX = 16,     /* at least INTERIOR_MAX (record_path.h) */
};

/* X(NAME, text): what becomes of a path at a vertex: why it goes no further. */
#define PATH_END_MAP(X)                                                            \
    X(GOES_ON, "")                                                                 \
    X(ESCAPED, "it left the scene")                                                \
    X(DEPTH, "it reached the job's depth")                                         \
    X(UNLIT, "it met an unlit surface, which scatters nothing")                    \
    X(BEHIND, "it met the surface from behind its shading normal")                 \
    X(ABSORBED, "it was absorbed: no direction was sampled")                       \
    X(SIDE, "shading and geometric normal disagree about the sampled direction's side") \
    X(ROULETTE, "Russian roulette")                                                \
    X(BLACK, "it carries nothing any more")                                        \
    X(MEDIUM_DEPTH, "it reached the job's depth in a medium")                      \
    X(BOUNDARIES, "it passed more index-matched boundaries than a sound scene has")

enum path_end {
#define PATH_END_ENUM(NAME, text) PATH_##NAME,
    PATH_END_MAP(PATH_END_ENUM)
#undef PATH_END_ENUM
    PATH_ENDS
};
const char *path_end_text(enum path_end end); /* static */

/* X(NAME, text): what the path met. */
#define PATH_MET_MAP(X)     \
    X(SURFACE, "surface")   \
    X(MEDIUM, "medium")     \
    X(BOUNDARY, "boundary") \
    X(ESCAPE, "escape")
enum path_met {
#define PATH_MET_ENUM(NAME, text) PATH_MET_##NAME,
    PATH_MET_MAP(PATH_MET_ENUM)
#undef PATH_MET_ENUM
};
const char *path_met_text(enum path_met met); /* static */

/* Where light that a path brings comes from. */
enum path_source {
    FROM_MEDIUM, /* that lies before the vertex, and glows */
    FROM_PATH,   /* what the path's own ray met: a surface that shines, the environment */
    FROM_LIGHT,  /* next-event estimation */
    FROM_CASTER, /* lamps without size, by way of a smooth surface (caustic/casters.h) */
    PATH_SOURCES
};

/* Next-event estimation at a vertex. */
struct record_light {
    int asked, found; /* it took place; a light that shines here was chosen */
    const char *kind; /* "POINT", ..., "TRIANGLE", "SPHERE", "ENVIRONMENT" (LIGHT_KINDS); "": none */
    int32_t number;   /* among the emitters' punctual lights (record_scene_light); -1: none */
    int32_t instance; /* that shines; -1: none */
    uint32_t triangle;
    struct vec3 direction, radiance;
    real distance;       /* metres; INFINITY: at infinity */
    real pdf;            /* of light sampling, odds of the choice included; 1/sr, or the odds alone */
    int delta;           /* only light sampling finds it: no weight */
    real scatter_pdf;    /* the density with which scattering finds that direction */
    struct vec3 scatter; /* what the vertex scatters of it */
    real weight;         /* of multiple importance sampling */
    int traced;          /* a shadow ray was traced */
    struct vec3 visible; /* 0: something is in between */
};

struct record_vertex {
    enum path_met met;
    uint32_t depth;                   /* scattering vertices before it */
    struct vec3 p, ng, ns;            /* metres, world; unit, black where there is none */
    real t;                           /* metres from the last vertex, or boundary; INFINITY: escaped */
    int front;                        /* met from the side of counter-clockwise winding */
    int32_t instance, mesh, material; /* -1: none */
    uint32_t triangle;
    int32_t medium;             /* that the ray came through, or was scattered in; -1: none */
    uint32_t body_count;        /* that it was in when it arrived */
    struct { uint32_t material; int owed; } bodies[RECORD_BODIES_MAX];
    struct vec3 throughput;     /* with which it arrived */
    struct vec3 added[PATH_SOURCES];
    real met_pdf;    /* with which light sampling would have found what the ray met */
    real met_weight; /* of multiple importance sampling */
    struct record_light light;
    int scattered;         /* a direction was sampled */
    const char *lobe;      /* that sampled it, "DIFFUSE" (BSDF_LOBE_MAP), "PHASE"; "": none */
    struct vec3 direction; /* unit, world */
    struct vec3 weight;    /* of the sampled direction: f cos / density */
    real pdf;              /* 1/sr; 0: a mirror's */
    int delta;
    real survival; /* Russian roulette's probability; 1: it did not play */
};

struct sample_record {
    struct vec3 radiance; /* along the path; not finite where something is wrong */
    enum path_end end;
    uint32_t count;
    int truncated; /* vertices are missing at the end */
    struct record_vertex vertices[RECORD_VERTICES_MAX];
};

/* The index in scene->lights of record_light.number; scene->light_count: it is no light of the scene's. */
uint32_t record_scene_light(const struct scene *scene, uint32_t number);

/* Render sample `number` (sample i of group g is number 2 i + g) of a pixel of `frame` again. added[3]: what
 * render_tile adds to its sum: the radiance, scaled down if the job clamps, 0 if the sample is dropped.
 * `record` may be NULL. Adds to *stats, with a unit's examples of health. */
void render_sample(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y, uint32_t number,
                   float32 added[3], struct sample_record *record, struct render_stats *stats);
