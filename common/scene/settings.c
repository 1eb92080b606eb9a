#include "common/scene/settings.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/scene/effects.h"
#include "common/scene/scene.h"

static const char *const isa_names[ISA_COUNT] = {"sse2", "avx2", "avx512"};
static const char *const env_sampling_names[ENV_SAMPLING_COUNT] = {
    "importance", "uniform", "bsdf", "importance-only", "uniform-only"};
static const char *const sampler_names[SAMPLER_COUNT] = {"sobol", "independent"};
static const char *const light_choice_names[LIGHT_CHOICE_COUNT] = {"tree", "power", "uniform"};
static const char *const texture_filter_names[TEXTURE_FILTER_COUNT] = {"cone", "bilinear", "nearest"};
static const char *const bvh_quality_names[BVH_QUALITY_COUNT] = {"medium", "low", "high"};

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

#define COUNT_OF(names) ((int)(sizeof(names) / sizeof *(names)))
#define CHOICE_DEFINE(type, noun)                                                           \
    const char *noun##_name(enum type choice)                                               \
    {                                                                                       \
        return (unsigned)choice < (unsigned)COUNT_OF(noun##_names) ? noun##_names[choice]   \
                                                                   : "unknown";             \
    }                                                                                       \
                                                                                            \
    int noun##_parse(const char *name)                                                      \
    {                                                                                       \
        return name_find(noun##_names, COUNT_OF(noun##_names), name);                       \
    }
SETTINGS_CHOICE_MAP(CHOICE_DEFINE)

static const char *const aov_names[AOV_COUNT] = {
#define AOV_NAME(name, text, channels) text,
    AOV_MAP(AOV_NAME)
#undef AOV_NAME
};
static const uint8_t aov_channel_counts[AOV_COUNT] = {
#define AOV_CHANNELS(name, text, channels) channels,
    AOV_MAP(AOV_CHANNELS)
#undef AOV_CHANNELS
};

const char *aov_name(enum aov aov)
{
    return (unsigned)aov < AOV_COUNT ? aov_names[aov] : "unknown";
}

int aov_parse(const char *name)
{
    return name_find(aov_names, AOV_COUNT, name);
}

uint32_t aov_channels(enum aov aov)
{
    return (unsigned)aov < AOV_COUNT ? aov_channel_counts[aov] : 0;
}

uint32_t aov_floats(uint32_t mask)
{
    uint32_t floats = 0;

    for (int i = 0; i < AOV_COUNT; i++)
        if (mask >> i & 1)
            floats += aov_channel_counts[i];
    return floats;
}

/* The names of the bits of a set, with '-' for blanks and ',' between. */
static const char *set_text(uint64_t set, const char *(*name_of)(int bit), char *out)
{
    size_t used = 0;

    for (int bit = 0; bit < 64; bit++) {
        const char *name = set >> bit & 1 ? name_of(bit) : "";
        if (used && *name && used < SETTINGS_TEXT_SIZE - 1)
            out[used++] = ',';
        for (; *name && used < SETTINGS_TEXT_SIZE - 1; name++)
            out[used++] = *name == ' ' ? '-' : *name;
    }
    out[used] = 0;
    return out;
}

static const char *effect_of_bit(int bit)
{
    return effect_name((enum effect_bit)bit);
}

static const char *aov_of_bit(int bit)
{
    return aov_name((enum aov)bit);
}

const char *settings_effects_text(uint64_t set, char out[SETTINGS_TEXT_SIZE])
{
    return set_text(set, effect_of_bit, out);
}

const char *settings_aovs_text(uint32_t set, char out[SETTINGS_TEXT_SIZE])
{
    return set_text(set, aov_of_bit, out);
}

int aov_is_point(enum aov aov)
{
    return aov != AOV_NORMAL && aov != AOV_ALBEDO && aov != AOV_ALPHA;
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
    s->fps = 24;
    s->lens_radius = -1;
}

const char *settings_choices_text(const struct render_settings *s,
                                  char out[SETTINGS_CHOICES_TEXT_SIZE])
{
    char clamp[32] = "";
    const struct {
        const char *name, *value; /* NULL: the default */
    } rows[] = {
        {"sampler", s->sampler ? sampler_name(s->sampler) : NULL},
        {"light choice", s->light_choice ? light_choice_name(s->light_choice) : NULL},
        {"roulette", s->no_roulette ? "off" : NULL},
        {"clamp", s->clamp > 0 ? clamp : NULL},
        {"texture filter", s->texture_filter ? texture_filter_name(s->texture_filter) : NULL},
        {"BVH quality", s->bvh_quality ? bvh_quality_name(s->bvh_quality) : NULL},
        {"robust", s->not_robust ? "off" : NULL},
    };
    size_t used = 0;

    snprintf(clamp, sizeof clamp, "%g", (double)s->clamp);
    out[0] = 0;
    for (int i = 0; i < COUNT_OF(rows); i++)
        if (rows[i].value && used < SETTINGS_CHOICES_TEXT_SIZE)
            used += (size_t)snprintf(out + used, SETTINGS_CHOICES_TEXT_SIZE - used, "%s%s %s",
                                     used ? ", " : "", rows[i].name, rows[i].value);
    return out;
}

int render_settings_equal(const struct render_settings *a, const struct render_settings *b)
{
    return a->width == b->width && a->height == b->height &&
           a->whole_width == b->whole_width && a->whole_height == b->whole_height &&
           a->region_x == b->region_x && a->region_y == b->region_y && a->spp == b->spp &&
           a->max_depth == b->max_depth && a->seed == b->seed && a->camera == b->camera &&
           a->env_rotate_deg == b->env_rotate_deg && a->env_strength == b->env_strength &&
           a->env_sampling == b->env_sampling && a->isa == b->isa && a->fps == b->fps &&
           a->shutter == b->shutter && a->lens_radius == b->lens_radius &&
           a->focus_distance == b->focus_distance && a->without == b->without &&
           a->aovs == b->aovs && a->sampler == b->sampler &&
           a->light_choice == b->light_choice && a->texture_filter == b->texture_filter &&
           a->bvh_quality == b->bvh_quality && a->not_robust == b->not_robust &&
           a->no_roulette == b->no_roulette && a->clamp == b->clamp;
}

const char *settings_region_text(const struct render_settings *s,
                                 char out[SETTINGS_REGION_TEXT_SIZE])
{
    out[0] = 0;
    if (s->whole_width)
        snprintf(out, SETTINGS_REGION_TEXT_SIZE, "%u,%u,%u,%u of %ux%u", s->region_x, s->region_y,
                 s->width, s->height, s->whole_width, s->whole_height);
    return out;
}

/* A whole picture has no region at all, so that equal pictures have equal settings. */
static int region_is_inside(const struct render_settings *s)
{
    if (!s->whole_width && !s->whole_height)
        return s->region_x == 0 && s->region_y == 0;
    return s->whole_width <= SETTINGS_SIZE_MAX && s->whole_height <= SETTINGS_SIZE_MAX &&
           s->region_x < s->whole_width && s->width <= s->whole_width - s->region_x &&
           s->region_y < s->whole_height && s->height <= s->whole_height - s->region_y &&
           (s->width < s->whole_width || s->height < s->whole_height);
}

status render_settings_validate(const struct render_settings *s, uint32_t camera_count,
                                struct error *err)
{
    char names[SETTINGS_TEXT_SIZE];

    if (s->width < 1 || s->height < 1 || s->width > SETTINGS_SIZE_MAX ||
        s->height > SETTINGS_SIZE_MAX || (uint64_t)s->width * s->height > SETTINGS_PIXELS_MAX)
        return error_set(err, STATUS_ERR_INPUT,
                         "size %ux%u: each side must be 1..%d and the whole at most %d pixels",
                         s->width, s->height, SETTINGS_SIZE_MAX, SETTINGS_PIXELS_MAX);
    if (!region_is_inside(s))
        return error_set(err, STATUS_ERR_INPUT,
                         "region of %ux%u pixels at %u,%u: is not inside a picture of %ux%u (each side at "
                         "most %d)",
                         s->width, s->height, s->region_x, s->region_y, s->whole_width,
                         s->whole_height, SETTINGS_SIZE_MAX);
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
    if ((unsigned)s->sampler >= SAMPLER_COUNT || (unsigned)s->light_choice >= LIGHT_CHOICE_COUNT ||
        (unsigned)s->texture_filter >= TEXTURE_FILTER_COUNT ||
        (unsigned)s->bvh_quality >= BVH_QUALITY_COUNT)
        return error_set(err, STATUS_ERR_INPUT,
                         "unknown sampler %u, light choice %u, texture filter %u or BVH quality %u",
                         (unsigned)s->sampler, (unsigned)s->light_choice,
                         (unsigned)s->texture_filter, (unsigned)s->bvh_quality);
    if (s->bvh_quality == BVH_QUALITY_HIGH && !s->not_robust)
        return error_set(err, STATUS_ERR_INPUT,
                         "BVH quality high needs the robust flag off (--robust off): with it Embree "
                         "builds the same trees as for medium");
    if (!(s->clamp == 0 || (s->clamp >= SETTINGS_CLAMP_MIN && s->clamp <= SETTINGS_CLAMP_MAX)))
        return error_set(err, STATUS_ERR_INPUT, "clamp %g: must be 0 (off) or %g..%g of linear radiance",
                         (double)s->clamp, (double)SETTINGS_CLAMP_MIN, (double)SETTINGS_CLAMP_MAX);
    if (!(s->fps >= 1e-3f && s->fps <= 1e5f))
        return error_set(err, STATUS_ERR_INPUT, "%g frames a second: must be 0.001..100000",
                         (double)s->fps);
    if (!(s->shutter >= 0 && s->shutter <= 1))
        return error_set(err, STATUS_ERR_INPUT, "shutter %g: must be 0..1 of a frame's time",
                         (double)s->shutter);
    if (!(s->lens_radius <= SCENE_FOCUS_MAX) ||
        !(s->focus_distance >= 0 && s->focus_distance <= SCENE_FOCUS_MAX))
        return error_set(err, STATUS_ERR_INPUT,
                         "lens radius %g, focus distance %g: must be at most %g metres, the distance not "
                         "negative",
                         (double)s->lens_radius, (double)s->focus_distance, (double)SCENE_FOCUS_MAX);
    if (s->without & ~EFFECTS_SWITCHABLE)
        return error_set(err, STATUS_ERR_INPUT,
                         "effects that are unknown or cannot be left out: %s",
                         settings_effects_text(s->without & ~EFFECTS_SWITCHABLE, names));
    if (s->aovs >> AOV_COUNT)
        return error_set(err, STATUS_ERR_INPUT, "unknown output variables (AOVs)");
    return STATUS_OK;
}
