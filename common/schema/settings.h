/* settings: what a job is rendered with and needs, each setting once.
 *
 * From these rows follow struct render_settings (common/scene/settings.h), and parts of struct stop_rules
 * (common/accuracy/stop.h) and struct job_needs (job_needs.h), with their defaults, comparison and checks, both ways over
 * the wire, words in JSON, the options of submit, render and their kin with help and completion, the options of an upload,
 * the attributes and the command in a picture's header, and what `show` lists.
 *
 * SETTING(o, KIND, type, name, initial, least, most, SHOWN, attribute, option, placeholder, help, ...)
 *   KIND         NUMBER (float or double), WHOLE (unsigned), CHOICE (of choices.h), SWITCH (on|off; 1 in C is off), DURATION
 *                (milliseconds) or SET (names of choices.h, a bit each)
 *   type, name   its member, which has the name of its field of RenderSettings
 *   initial      the default; valid even outside least..most. A field that is absent reads as 0, or as this where 0 is
 *                not in the range of a NUMBER
 *   SHOWN        in the header and in `show`: ALWAYS; OWN_LINE, LISTED: where it is not the default. LISTED is `show`'s
 *                line of choices
 *   attribute    in the header, NULL: none
 *   option, placeholder, help  --option PLACEHOLDER
 * FIELD          the same without a row in the table of options: it is part of one that sets several, or depends on the
 *                scene
 *
 * OPTION(o, name, option, placeholder, help, ...): the same, where the option has a language of its own and the member
 * another type: code of its own does what follows from the other rows.
 *
 * The rest are members of struct setting. `o` is handed to each SETTING. A new setting needs a row, its line of
 * azulejo.proto, and the code that reads it: docs/EXTENDING.md. */
#pragma once

#include "common/schema/choices.h"
#include "common/schema/setting.h"

#define RENDER_SETTINGS(FIELD, SETTING, o)                                                                             \
    FIELD(o, WHOLE, uint32_t, width, 1280, 1, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                     \
    FIELD(o, WHOLE, uint32_t, height, 720, 1, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                     \
    /* Not 0: the picture is a region of a whole one of this size, and its upper left pixel is (region_x,              \
     * region_y) of that. Everything but the camera knows only the region. */                                          \
    FIELD(o, WHOLE, uint32_t, whole_width, 0, 1, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                  \
    FIELD(o, WHOLE, uint32_t, whole_height, 0, 1, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                 \
    FIELD(o, WHOLE, uint32_t, region_x, 0, 0, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                     \
    FIELD(o, WHOLE, uint32_t, region_y, 0, 0, SETTINGS_SIZE_MAX, OWN_LINE, NULL, NULL, NULL, NULL)                     \
    FIELD(o, WHOLE, uint32_t, spp, SETTINGS_SPP_DEFAULT, 1, SETTINGS_SPP_MAX, ALWAYS, "azulejo:spp", NULL, NULL, NULL, \
          .says = "samples a pixel")                                                                                   \
    /* path edges after the camera ray; 0: emission only */                                                            \
    SETTING(o, WHOLE, uint32_t, max_depth, SETTINGS_DEPTH_DEFAULT, 0, SETTINGS_DEPTH_MAX, ALWAYS,                      \
            "azulejo:maxDepth", "max-depth", "N",                                                                      \
            "path edges after the camera's ray; 0 shows emitters only (default: the file's own, or 12)")               \
    SETTING(o, WHOLE, uint64_t, seed, 0, 0, UINT64_MAX, ALWAYS, "azulejo:seed", "seed", "N",                           \
            "another seed gives different noise, the same seed the same bits (default 0)")                             \
    /* index into the scene's */                                                                                       \
    FIELD(o, WHOLE, uint32_t, camera, 0, 0, UINT32_MAX, ALWAYS, "azulejo:camera", "camera", NULL, NULL)                \
    /* turns the environment about +Y, counter-clockwise seen from above */                                            \
    SETTING(o, NUMBER, float, env_rotate_deg, 0, -36000, 36000, ALWAYS, "azulejo:envRotateDeg", "env-rotate", "DEG",   \
            "turn the environment about +Y, counter-clockwise seen from above (default 0)")                            \
    SETTING(o, NUMBER, float, env_strength, 1, 0, 1e6, ALWAYS, "azulejo:envStrength", "env-strength", "X",             \
            "multiply the environment's radiance (default 1)")                                                         \
    SETTING(o, CHOICE, enum env_sampling, env_sampling, ENV_SAMPLING_LEARNED, 0, 0, ALWAYS,                            \
            "azulejo:envSampling", "env-sampling", "HOW",                                                              \
            "how light directions are chosen from the environment (default learned)",                                  \
            CHOICE_OF(ENV_SAMPLING, ENV_SAMPLINGS))                                                                    \
    SETTING(o, CHOICE, enum isa, isa, ISA_AVX2, 0, 0, ALWAYS, "azulejo:isa", "isa", "NAME",                            \
            "instruction set for the ray tracing of every worker (default avx2)", CHOICE_OF(ISA, ISAS))                \
    /* frame f is at f / fps seconds */                                                                                \
    SETTING(o, NUMBER, float, fps, 24, 0.001, 100000, ALWAYS, "azulejo:fps", "fps", "N",                               \
            "frames a second: frame F shows the scene at F/N seconds (default 24)")                                    \
    /* from the frame's time on; 0: the camera's own, or no motion blur */                                             \
    SETTING(o, NUMBER, float, shutter, 0, 0, 1, OWN_LINE, "azulejo:shutter", "shutter", "FRACTION",                    \
            "share of a frame's time that the shutter is open, 0 to 1: what moves is blurred (default 0: as long as"   \
            " the camera says)")                                                                                       \
    /* metres; negative: the camera's own, 0: pinhole */                                                               \
    SETTING(o, NUMBER, float, lens_radius, -1, 0, SCENE_FOCUS_MAX, OWN_LINE, "azulejo:lensRadius", "lens", "METRES",   \
            "radius of the aperture, which blurs what is out of focus; 0 is a pinhole (default: the camera's own)")    \
    SETTING(o, NUMBER, float, focus_distance, 0, 1e-12, SCENE_FOCUS_MAX, OWN_LINE, "azulejo:focusDistance", "focus",   \
            "METRES",                                                                                                  \
            "distance of what is sharp (default: the camera's own)")                                                   \
    SETTING(o, SET, uint64_t, without, 0, 0, 0, OWN_LINE, "azulejo:without", "without", "EFFECT,...",                  \
            "leave these effects out, as in caustics,dispersion; a wrong name lists all", .choice = CHOICE_EFFECT)     \
    SETTING(o, SET, uint32_t, aovs, 0, 0, 0, OWN_LINE, NULL, "aov", "NAME,...",                                        \
            "add these output variables to the EXR, as in depth,normal; a wrong name lists all",                       \
            .choice = CHOICE_AOV)                                                                                      \
    SETTING(o, CHOICE, enum exr_names, exr_names, EXR_NAMES_PLAIN, 0, 0, LISTED, "azulejo:exrNames", "exr-names",      \
            "HOW",                                                                                                     \
            "names of the EXR's channels: R, N.X, albedo.R, or as in Blender's files of several layers (default plain)",\
            CHOICE_OF(EXR_NAMES, EXR_NAMINGS), .says = "EXR names")                                                    \
    SETTING(o, CHOICE, enum sampler_kind, sampler, SAMPLER_SOBOL, 0, 0, LISTED, "azulejo:sampler", "sampler", "NAME",  \
            "random numbers: scrambled Sobol' points, or independent ones (default sobol)",                            \
            CHOICE_OF(SAMPLER, SAMPLERS))                                                                              \
    SETTING(o, CHOICE, enum light_choice, light_choice, LIGHT_CHOICE_LEARNED, 0, 0, LISTED, "azulejo:lightChoice",        \
            "light-choice", "HOW",                                                                                     \
            "choose lights by their effect at the point (learned: and by what walls hide), by their power, or uniformly (default learned)",                 \
            CHOICE_OF(LIGHT_CHOICE, LIGHT_CHOICES), .says = "light choice")                                            \
    SETTING(o, SWITCH, int, no_roulette, 0, 0, 1, LISTED, "azulejo:roulette", "roulette", "HOW",                       \
            "end paths that carry little light at random; off: only at --max-depth (default on)",                      \
            .words = CHOICE_WORDS(SWITCHES))                                                                           \
    /* linear radiance, before exposure: a sample whose largest channel is larger is scaled down to it */              \
    SETTING(o, NUMBER, float, clamp, 0, 0, SETTINGS_CLAMP_MAX, LISTED, "azulejo:clamp", "clamp", "X",                  \
            "scale samples of more linear radiance (before exposure) down to X, against fireflies; removes light, "    \
            "and reports how much (default 0: off)")                                                                   \
    SETTING(o, CHOICE, enum texture_filter, texture_filter, TEXTURE_FILTER_CONE, 0, 0, LISTED,                         \
            "azulejo:textureFilter", "texture-filter", "HOW",                                                          \
            "filter textures by the width of the ray's cone, or use only their finest level, interpolated or by its"   \
            " nearest texel (default cone)", CHOICE_OF(TEXTURE_FILTER, TEXTURE_FILTERS), .says = "texture filter")     \
    SETTING(o, CHOICE, enum pixel_filter, pixel_filter, PIXEL_FILTER_BLACKMAN_HARRIS, 0, 0, LISTED,                    \
            "azulejo:pixelFilter", "pixel-filter", "NAME",                                                             \
            "how a pixel weighs the samples around its centre (default blackman-harris)",                              \
            CHOICE_OF(PIXEL_FILTER, PIXEL_FILTERS), .says = "pixel filter")                                            \
    /* pixels, of both sides together; 0: the filter's own */                                                          \
    SETTING(o, NUMBER, float, filter_width, 0, 0.01, 16, LISTED, "azulejo:filterWidth", "filter-width", "PIXELS",      \
            "the pixel filter's width (default: 3, of triangle 2, of box 1)",                                         \
            .says = "filter width")                                                                                    \
    SETTING(o, CHOICE, enum bvh_quality, bvh_quality, BVH_QUALITY_MEDIUM, 0, 0, LISTED, "azulejo:bvhQuality",          \
            "bvh-quality", "HOW",                                                                                      \
            "quality of Embree's trees; high needs --robust off (default medium)",                                     \
            CHOICE_OF(BVH_QUALITY, BVH_QUALITIES), .says = "BVH quality")                                              \
    /* the checks that keep Embree's rays from slipping between triangles */                                           \
    SETTING(o, SWITCH, int, not_robust, 0, 0, 1, LISTED, "azulejo:robust", "robust", "HOW",                            \
            "stop rays from slipping between triangles; off is faster but may leak (default on)",                      \
            .words = CHOICE_WORDS(SWITCHES))

/* When a frame has enough samples, besides the cap (spp): struct stop_rules, and fields of StopRules. */
#define STOP_RULES(OPTION, SETTING, o)                                                                                 \
    OPTION(o, target, "target-error", "ERROR",                                                                         \
           "render until the picture's error is this small: 2/255 (95 % of the pixels are within this many display codes), "\
           "1% (of the frame's mean) or 45dB (PSNR)")                                                                  \
    /* since the frame's first lease; 0: none */                                                                       \
    SETTING(o, DURATION, uint64_t, time_limit_ms, 0, 1, STOP_LIMIT_MS_MAX, OWN_LINE, NULL, "time-limit", "TIME",       \
            "end each frame this long after its first lease, as in 90s, 10m, 2h")                                      \
    /* CPU time of all its results; 0: none */                                                                         \
    SETTING(o, DURATION, uint64_t, core_limit_ms, 0, 1, STOP_LIMIT_MS_MAX, OWN_LINE, NULL, "core-limit", "TIME",       \
            "end each frame when all cores together have spent this long on it, as in 90s, 10m, 2h")                   \
    /* with those of before an extension; 0: none */                                                                   \
    SETTING(o, WHOLE, uint64_t, max_rays, 0, 1, STOP_RAYS_MAX, OWN_LINE, NULL, "max-rays", "N",                        \
            "end each frame when N rays were traced for it in all, as in 2e9")                                         \
    OPTION(o, adaptive, "allocation", "HOW",                                                                           \
           "which tiles get samples: those where they help most, or all the same (default: uniform with --spp alone, else "\
           "adaptive)", .words = "adaptive|uniform")                                                                   \
    /* no rule except a clock's ends the frame earlier; 0: none */                                                     \
    SETTING(o, WHOLE, uint32_t, spp_min, 0, 1, SETTINGS_SPP_MAX, OWN_LINE, NULL, "min-spp", "N",                       \
            "samples a pixel before --target-error may end a frame, at least (default 16)")

/* What its pictures look like, besides the operator and its parameters: struct tonemap_settings
 * (common/tonemap/tonemap.h), fields of OutputSettings, and words of a preview's query. */
#define LOOK_SETTINGS(SETTING, o)                                                                                      \
    /* 2^ev multiplies the picture, on top of the metering */                                                          \
    SETTING(o, NUMBER, double, exposure_ev, 0, -100, 100, OWN_LINE, NULL, "exposure", "EV",                            \
            "stops of exposure before tone mapping, on top of the camera's own and of --auto-exposure: each doubles"   \
            " (default 0)")                                                                                            \
    SETTING(o, CHOICE, enum tonemap_metering, metering, TONEMAP_METERING_OFF, 0, 0, OWN_LINE, NULL, "auto-exposure",   \
            "HOW",                                                                                                     \
            "find the exposure: the log-mean luminance becomes 0.18, or a percentile becomes 1 (default off)",         \
            CHOICE_OF(TONEMAP_METERING, TONEMAP_METERINGS))                                                            \
    SETTING(o, NUMBER, double, metering_percentile, 99, 1e-6, 100, OWN_LINE, NULL, "percentile", "P",                  \
            "the percentile for --auto-exposure percentile (default 99); without that, the operator's parameter of"    \
            " this name")                                                                                              \
    /* colour temperature of the light that should look white; 0: unchanged */                                         \
    SETTING(o, NUMBER, double, white_kelvin, 0, 1667, 25000, OWN_LINE, NULL, "white-balance", "KELVIN",                \
            "make light of this colour temperature white (default: do not change colours)")                            \
    /* the states of so many frames, the last of them this one, are averaged; 0 and 1: only its own */                 \
    SETTING(o, WHOLE, uint32_t, temporal, 0, 1, 240, OWN_LINE, NULL, "temporal", "N",                                  \
            "average the operator's measurements over the last N frames, so that an animation does not flicker"        \
            " (default 1: each frame by itself)")                                                                      \
    /* the EXR keeps the raw picture and has this one as a layer */                                                    \
    SETTING(o, CHOICE, enum denoising, denoise, DENOISING_OFF, 0, 0, OWN_LINE, NULL, "denoise", "HOW",                 \
            "show the picture without its noise, as well as its samples allow, or faster and less well (default off)", \
            CHOICE_OF(DENOISING, DENOISINGS))                                                                          \
    /* so many before and so many after; 0: each by itself */                                                          \
    SETTING(o, WHOLE, uint32_t, denoise_around, 0, 0, 2, OWN_LINE, NULL, "denoise-around", "N",                        \
            "N frames before and N after each take part in --denoise, so that an animation flickers less"              \
            " (default 0: each frame by itself)")

/* When a job is lent to workers, and to which: struct job_needs, and fields of JobSubmit and JobInfo. */
#define JOB_NEEDS(OPTION, SETTING, o)                                                                                  \
    OPTION(o, after, "after", "JOB[,JOB]...", "wait until these jobs are done; 'azulejo start' ends the wait")         \
    OPTION(o, not_before, "not-before", "TIME",                                                                        \
           "wait until then: 20:00, '2026-03-01 20:00', 2026-03-01T20:00:00Z, or 2h from now")                         \
    OPTION(o, require, "require", "TAG[,TAG]...", "only workers with all of these tags render it")                     \
    OPTION(o, memory, "memory", "SIZE",                                                                                \
           "only machines with this much memory render it, as in 12G; 0: any (default: an estimate from the scene's "  \
           "files and triangles)")                                                                                     \
    SETTING(o, WHOLE, uint32_t, max_cores, 0, 1, 1000000, LISTED, NULL, "max-cores", "N",                            \
            "at most N cores of the farm render it at a time (default: all that there are)")
