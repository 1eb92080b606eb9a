/* choices: what is chosen by a word, and what is a set of words; each word once.
 *
 * CHOICE(PREFIX, NAME, number, word)
 *   PREFIX_NAME  the number in C: the wire's and the store's; never used again for another word
 *   word         what people type and read, and what JSON has
 *
 * The rows of a choice stand in the order in which people read them; number 0 is what a message without the field
 * means. Enums, options (CHOICE_WORDS), names and JSON (CHOICE_FIELDS) follow from these rows. Sets have one bit a row:
 * effects and output variables have tables of their own (common/scene), and are listed here as choices by name. */
#pragma once

#include <stdint.h>

/* Instruction sets that Embree can be pinned to, from the least to the most. */
#define ISAS(CHOICE)                                                                                                   \
    CHOICE(ISA, SSE2, 0, "sse2")                                                                                       \
    CHOICE(ISA, AVX2, 1, "avx2")                                                                                       \
    CHOICE(ISA, AVX512, 2, "avx512")

/* How light directions are chosen from the environment. The last two do without MIS: only light sampling finds the
 * environment, except along rays whose direction it cannot sample (the camera's, mirrors', smooth glass's). */
#define ENV_SAMPLINGS(CHOICE)                                                                                          \
    CHOICE(ENV_SAMPLING, IMPORTANCE, 0, "importance") /* by the map's luminance, MIS with the BSDF */                  \
    CHOICE(ENV_SAMPLING, UNIFORM, 1, "uniform")       /* uniform over the sphere, MIS with the BSDF */                 \
    CHOICE(ENV_SAMPLING, BSDF, 2, "bsdf")             /* no light sampling of the environment */                       \
    CHOICE(ENV_SAMPLING, IMPORTANCE_ONLY, 3, "importance-only")                                                        \
    CHOICE(ENV_SAMPLING, UNIFORM_ONLY, 4, "uniform-only")                                                              \
    CHOICE(ENV_SAMPLING, LEARNED, 5, "learned")       /* importance; in rooms, of what arrives there (sky_guide.h) */

#define SAMPLERS(CHOICE)                                                                                               \
    CHOICE(SAMPLER, SOBOL, 0, "sobol")             /* Owen-scrambled Sobol' points */                                  \
    CHOICE(SAMPLER, INDEPENDENT, 1, "independent") /* every sample draws its own numbers */

/* An emissive triangle is a light, and so is the environment. */
#define LIGHT_CHOICES(CHOICE)                                                                                          \
    CHOICE(LIGHT_CHOICE, LEARNED, 3, "learned") /* tree; where walls hide lights, by what arrives too (lamp_guide.h) */ \
    CHOICE(LIGHT_CHOICE, TREE, 0, "tree")       /* by what a light can contribute at the shaded point */               \
    CHOICE(LIGHT_CHOICE, POWER, 1, "power")     /* by its power alone */                                               \
    CHOICE(LIGHT_CHOICE, UNIFORM, 2, "uniform") /* all lights alike */

/* How surfaces look up their textures. */
#define TEXTURE_FILTERS(CHOICE)                                                                                        \
    CHOICE(TEXTURE_FILTER, CONE, 0, "cone")         /* the two MIP levels that match the ray's beam */                 \
    CHOICE(TEXTURE_FILTER, BILINEAR, 1, "bilinear") /* the finest level, interpolated */                               \
    CHOICE(TEXTURE_FILTER, NEAREST, 2, "nearest")   /* the finest level's nearest texel */

/* Embree's build quality. */
#define BVH_QUALITIES(CHOICE)                                                                                          \
    CHOICE(BVH_QUALITY, LOW, 1, "low") /* built faster */                                                              \
    CHOICE(BVH_QUALITY, MEDIUM, 0, "medium")                                                                           \
    CHOICE(BVH_QUALITY, HIGH, 2, "high") /* spatial splits; only with not_robust: robust trees do not support them */

/* Roulette and robust, whose fields say when they are off. */
#define SWITCHES(CHOICE)                                                                                               \
    CHOICE(SWITCH, ON, 0, "on")                                                                                        \
    CHOICE(SWITCH, OFF, 1, "off")

/* How the exposure is found automatically. */
#define TONEMAP_METERINGS(CHOICE)                                                                                      \
    CHOICE(TONEMAP_METERING, OFF, 0, "off")                                                                            \
    CHOICE(TONEMAP_METERING, KEY, 1, "key")               /* the log-mean luminance becomes 0.18 */                    \
    CHOICE(TONEMAP_METERING, PERCENTILE, 2, "percentile") /* a percentile of the luminance becomes 1 */

/* How a pixel weighs the samples around its centre: worker/render/camera/camera.h. */
#define PIXEL_FILTERS(CHOICE)                                                                                          \
    CHOICE(PIXEL_FILTER, BLACKMAN_HARRIS, 0, "blackman-harris")                                                        \
    CHOICE(PIXEL_FILTER, BOX, 1, "box")                                                                                \
    CHOICE(PIXEL_FILTER, TRIANGLE, 2, "triangle")                                                                      \
    CHOICE(PIXEL_FILTER, GAUSSIAN, 3, "gaussian")

/* How an EXR's channels are named: as most compositors want it, or as Blender writes files of several layers. */
#define EXR_NAMINGS(CHOICE)                                                                                            \
    CHOICE(EXR_NAMES, PLAIN, 0, "plain")                                                                               \
    CHOICE(EXR_NAMES, BLENDER, 1, "blender")

/* What is shown of a picture's noise. */
#define DENOISINGS(CHOICE)                                                                                             \
    CHOICE(DENOISING, OFF, 0, "off")                                                                                   \
    CHOICE(DENOISING, ON, 1, "on")                                                                                     \
    CHOICE(DENOISING, FAST, 2, "fast") /* several times faster, and less good */

/* What a target error is of: enum allocation_measure (common/accuracy/allocate.h) follows 0, no target. */
#define STOP_MEASURES(CHOICE)                                                                                          \
    CHOICE(STOP_MEASURE, NONE, 0, "none")                                                                              \
    CHOICE(STOP_MEASURE, DISPLAY, 1, "display") /* 95 % of the pixels are within so many codes of 255 */               \
    CHOICE(STOP_MEASURE, PSNR, 2, "psnr")       /* dB */                                                               \
    CHOICE(STOP_MEASURE, RMSE, 3, "rmse")       /* per cent of the frame's mean */

/* A set: why an estimated error may be understated. */
#define ACCURACY_REASONS(CHOICE)                                                                                       \
    CHOICE(ACCURACY, UNSEEN, 0, "unseen")     /* one path not met yet would outweigh all of the error */               \
    CHOICE(ACCURACY, DISAGREE, 1, "disagree") /* the groups' own figures differ by more than chance allows */          \
    CHOICE(ACCURACY, TOP, 2, "top")           /* few pixels hold most of the squared error */                          \
    CHOICE(ACCURACY, TAIL, 3, "tail")         /* the largest contributions fall off too slowly for a mean */           \
    CHOICE(ACCURACY, SPARSE, 4, "sparse")     /* many noisy pixels were lit in one group, or in none */

/* CHOICE(PREFIX, enum, noun, rows) */
#define CHOICES(CHOICE)                                                                                                \
    CHOICE(ISA, isa, isa, ISAS)                                                                                        \
    CHOICE(ENV_SAMPLING, env_sampling, env_sampling, ENV_SAMPLINGS)                                                    \
    CHOICE(SAMPLER, sampler_kind, sampler, SAMPLERS)                                                                   \
    CHOICE(LIGHT_CHOICE, light_choice, light_choice, LIGHT_CHOICES)                                                    \
    CHOICE(TEXTURE_FILTER, texture_filter, texture_filter, TEXTURE_FILTERS)                                            \
    CHOICE(BVH_QUALITY, bvh_quality, bvh_quality, BVH_QUALITIES)                                                       \
    CHOICE(PIXEL_FILTER, pixel_filter, pixel_filter, PIXEL_FILTERS)                                                    \
    CHOICE(EXR_NAMES, exr_names, exr_names, EXR_NAMINGS)                                                               \
    CHOICE(TONEMAP_METERING, tonemap_metering, tonemap_metering, TONEMAP_METERINGS)                                    \
    CHOICE(DENOISING, denoising, denoising, DENOISINGS)                                                                \
    CHOICE(STOP_MEASURE, stop_measure, stop_measure, STOP_MEASURES)

/* Fields of messages that are numbers on the wire and words in JSON, besides those of settings.h: FIELD(message, field,
 * choice); SET has bits. */
#define CHOICE_FIELDS(FIELD, SET)                                                                                      \
    SET(render_stats, effects, EFFECT)                                                                                 \
    SET(job_info, error_effects, EFFECT)                                                                               \
    SET(worker_info, isa_mask, ISA)                                                                                    \
    SET(figures, reasons, ACCURACY)                                                                                    \
    FIELD(stop_rules, measure, STOP_MEASURE)                                                                           \
    FIELD(cost_curve, measure, STOP_MEASURE)                                                                           \
    FIELD(health, kind, HEALTH)

/* The option table's list: "cone|bilinear|nearest". */
#define CHOICE_WORDS(ROWS) (&(ROWS(CHOICE_WORD_OF))[1])
#define CHOICE_WORD_OF(PREFIX, NAME, number, word) "|" word

#define CHOICE_ENUM_OF(PREFIX, NAME, number, word) PREFIX##_##NAME = number,
#define CHOICE_ONE(...) +1
/* NOUN_name(): the word of a number, "unknown" without one. NOUN_parse(): the number of a word, -1 without one. */
#define CHOICE_DECLARE(PREFIX, type, noun, ROWS)                                                                       \
    enum type { ROWS(CHOICE_ENUM_OF) PREFIX##_COUNT = 0 ROWS(CHOICE_ONE) };                                            \
    const char *noun##_name(enum type choice);                                                                         \
    int noun##_parse(const char *word);
CHOICES(CHOICE_DECLARE)
#undef CHOICE_DECLARE

/* All of them, with those that have tables of their own. */
enum choice_name {
#define CHOICE_NAME(PREFIX, ...) CHOICE_##PREFIX,
    CHOICES(CHOICE_NAME)
#undef CHOICE_NAME
    CHOICE_ACCURACY, /* ACCURACY_REASONS */
    CHOICE_EFFECT,   /* EFFECT_MAP */
    CHOICE_AOV,      /* AOV_MAP */
    CHOICE_STAGE,    /* STAGE_MAP */
    CHOICE_HEALTH,   /* HEALTH_MAP */
    CHOICE_COUNT
};

/* Blanks in it are '-' where people type it and in JSON. NULL: the number, or a set's bit, is none. */
const char *choice_word(enum choice_name choice, uint64_t number);
/* The number; -1: there is no such word. '-' stands for a blank, too. */
int choice_find(enum choice_name choice, const char *word);
