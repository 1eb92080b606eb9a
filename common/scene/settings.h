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

/* Instruction sets that Embree can be pinned to, from the least to the most. */
enum isa { ISA_SSE2, ISA_AVX2, ISA_AVX512, ISA_COUNT };
const char *isa_name(enum isa isa);          /* "sse2", "avx2", "avx512" */
int isa_parse(const char *name);             /* -1: unknown */
uint32_t isa_supported_mask(void);           /* bit per enum isa that this CPU has */

enum env_sampling {
    ENV_SAMPLING_IMPORTANCE, /* by the map's luminance, MIS with the BSDF */
    ENV_SAMPLING_UNIFORM,    /* uniform over the sphere, MIS with the BSDF */
    ENV_SAMPLING_BSDF,       /* no light sampling of the environment */
    ENV_SAMPLING_COUNT
};
const char *env_sampling_name(enum env_sampling sampling); /* importance, uniform, bsdf */
int env_sampling_parse(const char *name);

struct render_settings {
    uint32_t width, height;     /* pixels */
    uint32_t spp;               /* samples a pixel, 1..SETTINGS_SPP_MAX */
    uint32_t max_depth;         /* path edges after the camera ray; 0: emission only */
    uint64_t seed;
    uint32_t camera;            /* index into the scene's cameras */
    float env_rotate_deg;       /* turns the environment about +Y, counter-clockwise seen from
                                   above */
    float env_strength;         /* multiplies the environment's radiance, >= 0 */
    enum env_sampling env_sampling;
    enum isa isa;
};

void render_settings_default(struct render_settings *s);

/* Check ranges; ERR_INPUT names the field and its range. camera_count bounds `camera`. */
status render_settings_validate(const struct render_settings *s, uint32_t camera_count,
                                struct error *err) MUST_CHECK;

#endif
