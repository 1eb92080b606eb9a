/* settings: how a job is to be rendered; part of the name of every work unit's result.
 *
 * Two jobs with equal scene digests and equal settings give equal bits.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/schema/settings.h"

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

uint32_t isa_supported_mask(void); /* bit per enum isa that this CPU has */

enum {
    MATTE_SLOTS = 6,                    /* things that a pixel of a group keeps apart */
    MATTE_FLOATS = 1 + 2 * MATTE_SLOTS, /* the lost samples, then pairs (common/film/matte.h) */
};

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
                                   without what is seen behind everything */       \
    X(DENOISING, "denoising", 1)     /* metres along the path to its first rough hit; a feature, mean; \
                                   with the next two (aovs_with_implied) */                         \
    X(DENOISING_ALBEDO, "denoising-albedo", 3) /* reflectance of the first rough hit, times that of the \
                                   smooth surfaces before it; a feature, mean */                    \
    X(DENOISING_NORMAL, "denoising-normal", 3) /* its shading normal; a feature, mean */            \
    X(EMISSION, "emission", 3)  /* radiance of emitters and surroundings that is met before a rough hit; mean */ \
    X(VARIANCE, "variance", 0)  /* the error's square; made by the coordinator */ \
    X(CRYPTOMATTE, "cryptomatte", 0) /* a word for the next two (aovs_with_implied): no job has it */ \
    X(CRYPTO_OBJECT, "crypto-object", MATTE_FLOATS)     /* how many samples met which object (common/film/matte.h) */ \
    X(CRYPTO_MATERIAL, "crypto-material", MATTE_FLOATS) /* the same of materials */ \
    X(CRYPTO_ASSET, "crypto-asset", 0) /* the objects' counts by scene_instance.asset, by the coordinator; with the objects */

enum aov {
#define AOV_ENUM(name, text, channels) AOV_##name,
    AOV_MAP(AOV_ENUM)
#undef AOV_ENUM
        AOV_COUNT
};
enum { AOV_FLOATS_MAX = 27 + 2 * MATTE_FLOATS /* of one pixel, all that workers send */ };
const char *aov_name(enum aov aov);
int aov_parse(const char *name); /* -1: unknown */
/* Floats that a worker sends for one pixel; `mask` has bit 1 << enum aov. */
uint32_t aov_floats(uint32_t mask);
/* Does only sample 0 count (pass 0 alone carries it)? */
int aov_is_point(enum aov aov);
uint32_t aov_channels(enum aov aov); /* that workers send */
/* What a denoiser is guided by: only a group's first samples count (FEATURE_SAMPLES in common/film/tiles.h). */
#define AOV_FEATURES (1u << AOV_DENOISING | 1u << AOV_DENOISING_ALBEDO | 1u << AOV_DENOISING_NORMAL)
/* What it needs besides the picture. */
#define AOV_FOR_DENOISING (1u << AOV_DENOISING_ALBEDO | 1u << AOV_DENOISING_NORMAL | 1u << AOV_EMISSION)
/* Counts of things, which are not added as numbers are. */
#define AOV_MATTES (1u << AOV_CRYPTO_OBJECT | 1u << AOV_CRYPTO_MATERIAL)
/* The mask, with what goes with those in it. */
static inline uint32_t aovs_with_implied(uint32_t aovs)
{
    if (aovs >> AOV_CRYPTOMATTE & 1)
        aovs = (aovs & ~(1u << AOV_CRYPTOMATTE)) | AOV_MATTES;
    if (aovs >> AOV_CRYPTO_ASSET & 1)
        aovs |= 1u << AOV_CRYPTO_OBJECT;
    return aovs >> AOV_DENOISING & 1 ? aovs | AOV_FEATURES : aovs;
}

#define SETTING_MEMBER(o, KIND, type, name, ...) type name;
struct render_settings {
    RENDER_SETTINGS(SETTING_MEMBER, SETTING_MEMBER, )
};
#undef SETTING_MEMBER

enum setting_name {
#define SETTING_NAME(o, KIND, type, name, ...) SETTING_##name,
    RENDER_SETTINGS(SETTING_NAME, SETTING_NAME, )
#undef SETTING_NAME
    SETTING_COUNT
};
extern const struct setting render_settings_rows[SETTING_COUNT];

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
    return x >= s->region_x && x - s->region_x < s->width && y >= s->region_y && y - s->region_y < s->height;
}
/* "13,9,37,22 of 70x50"; "" for a whole picture. The attribute of an EXR that has it. */
#define SETTINGS_REGION_ATTRIBUTE "azulejo:region"
enum { SETTINGS_REGION_TEXT_SIZE = 80 };
const char *settings_region_text(const struct render_settings *s, char out[SETTINGS_REGION_TEXT_SIZE]);

void render_settings_default(struct render_settings *s);
/* The LISTED rows other than the defaults, "sampler independent, roulette off"; "": none. */
enum { SETTINGS_CHOICES_TEXT_SIZE = 256 };
const char *settings_choices_text(const struct render_settings *s, char out[SETTINGS_CHOICES_TEXT_SIZE]);
/* Every field, by value. */
int render_settings_equal(const struct render_settings *a, const struct render_settings *b);

/* Names of a set as the command line takes them: "caustics,normal-map". */
enum { SETTINGS_TEXT_SIZE = SETTING_TEXT_SIZE };
const char *settings_effects_text(uint64_t set, char out[SETTINGS_TEXT_SIZE]);
const char *settings_aovs_text(uint32_t set, char out[SETTINGS_TEXT_SIZE]);

/* Check ranges; ERR_INPUT names the field and its range. camera_count bounds `camera`. */
status render_settings_validate(const struct render_settings *s, uint32_t camera_count, struct error *err) MUST_CHECK;
