#include "common/scene/settings.h"

#include <math.h>
#include <string.h>

static const char *const isa_names[ISA_COUNT] = {"sse2", "avx2", "avx512"};
static const char *const env_sampling_names[ENV_SAMPLING_COUNT] = {"importance", "uniform", "bsdf"};

static int name_find(const char *const *names, int count, const char *name)
{
    for (int i = 0; i < count; i++)
        if (strcmp(names[i], name) == 0)
            return i;
    return -1;
}

const char *isa_name(enum isa isa)
{
    return (unsigned)isa < ISA_COUNT ? isa_names[isa] : "unknown";
}

int isa_parse(const char *name)
{
    return name_find(isa_names, ISA_COUNT, name);
}

uint32_t isa_supported_mask(void)
{
#if defined(__x86_64__)
    uint32_t mask = 1u << ISA_SSE2;

    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        mask |= 1u << ISA_AVX2;
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl"))
        mask |= 1u << ISA_AVX512;
    return mask;
#else
    /* Embree on arm64 emulates both widths with NEON. */
    return 1u << ISA_SSE2 | 1u << ISA_AVX2;
#endif
}

const char *env_sampling_name(enum env_sampling sampling)
{
    return (unsigned)sampling < ENV_SAMPLING_COUNT ? env_sampling_names[sampling] : "unknown";
}

int env_sampling_parse(const char *name)
{
    return name_find(env_sampling_names, ENV_SAMPLING_COUNT, name);
}

void render_settings_default(struct render_settings *s)
{
    memset(s, 0, sizeof *s);
    s->width = 1280;
    s->height = 720;
    s->spp = SETTINGS_SPP_DEFAULT;
    s->max_depth = SETTINGS_DEPTH_DEFAULT;
    s->env_strength = 1;
    s->env_sampling = ENV_SAMPLING_IMPORTANCE;
    s->isa = ISA_AVX2;
}

status render_settings_validate(const struct render_settings *s, uint32_t camera_count,
                                struct error *err)
{
    if (s->width < 1 || s->height < 1 || s->width > SETTINGS_SIZE_MAX ||
        s->height > SETTINGS_SIZE_MAX || (uint64_t)s->width * s->height > SETTINGS_PIXELS_MAX)
        return error_set(err, STATUS_ERR_INPUT,
                         "size %ux%u: each side must be 1..%d and the whole at most %d pixels",
                         s->width, s->height, SETTINGS_SIZE_MAX, SETTINGS_PIXELS_MAX);
    if (s->spp < 1 || s->spp > SETTINGS_SPP_MAX)
        return error_set(err, STATUS_ERR_INPUT, "%u samples a pixel: must be 1..%d", s->spp,
                         SETTINGS_SPP_MAX);
    if (s->max_depth > SETTINGS_DEPTH_MAX)
        return error_set(err, STATUS_ERR_INPUT, "maximum depth %u: must be 0..%d", s->max_depth,
                         SETTINGS_DEPTH_MAX);
    if (s->camera >= camera_count)
        return error_set(err, STATUS_ERR_INPUT, "camera %u: the scene has %u", s->camera,
                         camera_count);
    if (!isfinite(s->env_rotate_deg) || fabsf(s->env_rotate_deg) > 36000)
        return error_set(err, STATUS_ERR_INPUT,
                         "environment rotation must be -36000..36000 degrees");
    if (!isfinite(s->env_strength) || s->env_strength < 0)
        return error_set(err, STATUS_ERR_INPUT, "environment strength must be finite and >= 0");
    if ((unsigned)s->env_sampling >= ENV_SAMPLING_COUNT || (unsigned)s->isa >= ISA_COUNT)
        return error_set(err, STATUS_ERR_INPUT, "unknown environment sampling or instruction set");
    return STATUS_OK;
}
