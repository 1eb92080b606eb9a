/* settings: how a job is to be rendered; part of the name of every work unit's result.
 *
 * Two jobs with equal scene digests and equal settings give equal bits.
 */
#ifndef AZULEJO_SCENE_SETTINGS_H
#define AZULEJO_SCENE_SETTINGS_H

#include <stdint.h>

#include "common/base/status.h"

enum {
    SETTINGS_SIZE_MAX = 65536,     /* pixels a side */
    SETTINGS_PIXELS_MAX = 1 << 28, /* pixels a frame */
    SETTINGS_SPP_MAX = 1 << 20,
    SETTINGS_DEPTH_MAX = 1024,
    SETTINGS_FRAMES_MAX = 100000,
    SETTINGS_SPP_DEFAULT = 256,
    SETTINGS_DEPTH_DEFAULT = 12,
};

#define SETTINGS_CLAMP_MIN 1e-20f /* radiance */
#define SETTINGS_CLAMP_MAX 1e30f

/* Instruction sets that Embree can be pinned to, from the least to the most. */
enum isa { ISA_SSE2, ISA_AVX2, ISA_AVX512, ISA_COUNT };
const char *isa_name(enum isa isa);          /* "sse2", "avx2", "avx512" */
int isa_parse(const char *name);             /* -1: unknown */
uint32_t isa_supported_mask(void);           /* bit per enum isa that this CPU has */

/* Choices of algorithm. The first of each is the default. Each has NAME_name(), its name on the
 * command line ("unknown" for an invalid value), and NAME_parse(), -1 for an unknown name. */
enum env_sampling {
    ENV_SAMPLING_IMPORTANCE, /* "importance": by the map's luminance, MIS with the BSDF */
    ENV_SAMPLING_UNIFORM,    /* "uniform": uniform over the sphere, MIS with the BSDF */
    ENV_SAMPLING_BSDF,       /* "bsdf": no light sampling of the environment */
    /* "importance-only", "uniform-only": no MIS. Only light sampling finds the environment, except
     * along rays whose direction it cannot sample (the camera's, mirrors', smooth glass's). */
    ENV_SAMPLING_IMPORTANCE_ONLY,
    ENV_SAMPLING_UNIFORM_ONLY,
    ENV_SAMPLING_COUNT
};
/* "sobol": Owen-scrambled Sobol' points; "independent": every sample draws its own numbers. */
enum sampler_kind { SAMPLER_SOBOL, SAMPLER_INDEPENDENT, SAMPLER_COUNT };
/* "tree": by what a light can contribute at the shaded point; "power": by its power alone;
 * "uniform": all lights alike (an emissive triangle is a light, and so is the environment). */
enum light_choice { LIGHT_CHOICE_TREE, LIGHT_CHOICE_POWER, LIGHT_CHOICE_UNIFORM, LIGHT_CHOICE_COUNT };
/* How surfaces look up their textures. "cone": the two MIP levels that match the ray's beam;
 * "bilinear": the finest level, interpolated; "nearest": the finest level's nearest texel. */
enum texture_filter {
    TEXTURE_FILTER_CONE,
    TEXTURE_FILTER_BILINEAR,
    TEXTURE_FILTER_NEAREST,
    TEXTURE_FILTER_COUNT
};
/* Embree's build quality: "medium", "low" (built faster), "high" (spatial splits; only with
 * not_robust: Embree's robust trees do not support them). */
enum bvh_quality { BVH_QUALITY_MEDIUM, BVH_QUALITY_LOW, BVH_QUALITY_HIGH, BVH_QUALITY_COUNT };

#define SETTINGS_CHOICE_MAP(X)                                                             \
    X(env_sampling, env_sampling)                                                          \
    X(sampler_kind, sampler)                                                               \
    X(light_choice, light_choice)                                                          \
    X(texture_filter, texture_filter)                                                      \
    X(bvh_quality, bvh_quality)
#define SETTINGS_CHOICE_DECLARE(type, noun)                                                \
    const char *noun##_name(enum type choice);                                             \
    int noun##_parse(const char *name);
SETTINGS_CHOICE_MAP(SETTINGS_CHOICE_DECLARE)
#undef SETTINGS_CHOICE_DECLARE

/* Arbitrary output variables: what a frame holds besides its radiance, only on request.
 * X(name, text, channels sent by workers). Point-sampled ones are those of sample 0. */
#define AOV_MAP(X)                                                                         \
    X(DEPTH, "depth", 1)        /* metres along the ray's axis; point; 0: nothing hit */   \
    X(NORMAL, "normal", 3)      /* world shading normal, towards the camera; mean */       \
    X(ALBEDO, "albedo", 3)      /* reflectance, delta paths not followed; mean */          \
    X(POSITION, "position", 3)  /* world, metres; point */                                 \
    X(UV, "uv", 2)              /* first set; point */                                     \
    X(OBJECT_ID, "object-id", 1)     /* instance + 1; point; 0: nothing hit */             \
    X(MATERIAL_ID, "material-id", 1) /* material + 1; point */                             \
    X(MOTION, "motion", 2)      /* pixels from shutter opening to closing, x right, y down; point */ \
    X(SAMPLES, "samples", 0)    /* samples a pixel; made by the coordinator */             \
    X(ERROR, "error", 0)        /* standard error of the mean, RGB; made by the coordinator */ \
    X(ALPHA, "alpha", 1)        /* 1 less what a camera ray lets through; mean. The picture is then \
                                   without what is seen behind everything */

enum aov {
#define AOV_ENUM(name, text, channels) AOV_##name,
    AOV_MAP(AOV_ENUM)
#undef AOV_ENUM
        AOV_COUNT
};
enum { AOV_FLOATS_MAX = 17 /* of one pixel, all that workers send */ };
const char *aov_name(enum aov aov);
int aov_parse(const char *name);                 /* -1: unknown */
/* Floats that a worker sends for one pixel; `mask` has bit 1 << enum aov. */
uint32_t aov_floats(uint32_t mask);
/* Does only sample 0 count (pass 0 alone carries it)? */
int aov_is_point(enum aov aov);
uint32_t aov_channels(enum aov aov);             /* that workers send */

struct render_settings {
    uint32_t width, height;     /* pixels */
    /* Not 0: the picture is a region of a whole one of this size, and its upper left pixel is
     * (region_x, region_y) of that. Everything but the camera knows only the region. */
    uint32_t whole_width, whole_height, region_x, region_y;
    uint32_t spp;               /* samples a pixel, 1..SETTINGS_SPP_MAX */
    uint32_t max_depth;         /* path edges after the camera ray; 0: emission only */
    uint64_t seed;
    uint32_t camera;            /* index into the scene's cameras */
    float env_rotate_deg;       /* turns the environment about +Y, counter-clockwise seen from
                                   above */
    float env_strength;         /* multiplies the environment's radiance, >= 0 */
    enum env_sampling env_sampling;
    enum isa isa;
    float fps;                  /* frames a second: frame f is at f / fps seconds */
    float shutter;              /* share of a frame's time that the shutter is open, 0..1, starting
                                   at the frame's time; 0: the camera's own, or no motion blur */
    float lens_radius;          /* metres; negative: the camera's own, 0: pinhole */
    float focus_distance;       /* metres; 0: the camera's own */
    uint64_t without;           /* effects to leave out (common/scene/effects.h) */
    uint32_t aovs;              /* bits 1 << enum aov */
    enum sampler_kind sampler;
    enum light_choice light_choice;
    enum texture_filter texture_filter;
    enum bvh_quality bvh_quality;
    int not_robust;             /* 1: without the checks that keep Embree's rays from slipping
                                   between triangles */
    int no_roulette;            /* 1: paths end at max_depth only */
    float clamp;                /* linear radiance, before exposure: a sample whose largest channel
                                   is larger is scaled down to it; 0: off */
};

static inline uint32_t settings_whole_width(const struct render_settings *s)
{
    return s->whole_width ? s->whole_width : s->width;
}
static inline uint32_t settings_whole_height(const struct render_settings *s)
{
    return s->whole_height ? s->whole_height : s->height;
}
/* Is pixel (x, y) of the whole picture rendered? */
static inline int settings_have_pixel(const struct render_settings *s, uint32_t x, uint32_t y)
{
    return x >= s->region_x && x - s->region_x < s->width && y >= s->region_y &&
           y - s->region_y < s->height;
}
/* "13,9,37,22 of 70x50"; "" for a whole picture. The attribute of an EXR that has it. */
#define SETTINGS_REGION_ATTRIBUTE "azulejo:region"
enum { SETTINGS_REGION_TEXT_SIZE = 80 };
const char *settings_region_text(const struct render_settings *s,
                                 char out[SETTINGS_REGION_TEXT_SIZE]);

void render_settings_default(struct render_settings *s);
/* Choices of algorithm other than the defaults, "sampler independent, roulette off"; "": none. */
enum { SETTINGS_CHOICES_TEXT_SIZE = 256 };
const char *settings_choices_text(const struct render_settings *s,
                                  char out[SETTINGS_CHOICES_TEXT_SIZE]);
/* Every field, by value. */
int render_settings_equal(const struct render_settings *a, const struct render_settings *b);

/* Names of a set as the command line takes them: "caustics,normal-map". */
enum { SETTINGS_TEXT_SIZE = 1024 /* holds any set */ };
const char *settings_effects_text(uint64_t set, char out[SETTINGS_TEXT_SIZE]);
const char *settings_aovs_text(uint32_t set, char out[SETTINGS_TEXT_SIZE]);

/* Check ranges; ERR_INPUT names the field and its range. camera_count bounds `camera`. */
status render_settings_validate(const struct render_settings *s, uint32_t camera_count,
                                struct error *err) MUST_CHECK;

#endif
