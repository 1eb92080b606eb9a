#include "common/scene/settings.h"

#include <stdio.h>
#include <string.h>

#include "common/scene/effects.h"
#include "common/scene/scene.h"

uint32_t isa_supported_mask(void)
{
#if defined(__x86_64__)
    uint32_t mask = 1u << ISA_SSE2;

    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        mask |= 1u << ISA_AVX2;
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl"))
        mask |= 1u << ISA_AVX512;
    return mask;
#else
    /* Embree on arm64 emulates both widths with NEON. */
    return 1u << ISA_SSE2 | 1u << ISA_AVX2;
#endif
}

static const uint8_t aov_channel_counts[AOV_COUNT] = {
#define AOV_CHANNELS(name, text, channels) channels,
    AOV_MAP(AOV_CHANNELS)
#undef AOV_CHANNELS
};

const char *aov_name(enum aov aov)
{
    const char *word = choice_word(CHOICE_AOV, (unsigned)aov);

    return word ? word : "unknown";
}

int aov_parse(const char *name) { return choice_find(CHOICE_AOV, name); }

uint32_t aov_channels(enum aov aov) { return (unsigned)aov < AOV_COUNT ? aov_channel_counts[aov] : 0; }

uint32_t aov_floats(uint32_t mask)
{
    uint32_t floats = 0;

    for (int i = 0; i < AOV_COUNT; i++)
        if (mask >> i & 1)
            floats += aov_channel_counts[i];
    return floats;
}

const char *settings_effects_text(uint64_t set, char out[SETTINGS_TEXT_SIZE])
{
    return setting_set_text(CHOICE_EFFECT, set, out);
}

const char *settings_aovs_text(uint32_t set, char out[SETTINGS_TEXT_SIZE])
{
    return setting_set_text(CHOICE_AOV, set, out);
}

int aov_is_point(enum aov aov)
{
    const uint32_t means =
        1u << AOV_NORMAL | 1u << AOV_ALBEDO | 1u << AOV_ALPHA | 1u << AOV_EMISSION | AOV_FEATURES | AOV_MATTES;

    return !(means >> aov & 1);
}

#define ROW(o, ...) SETTING_ROW(render_settings, __VA_ARGS__)
const struct setting render_settings_rows[SETTING_COUNT] = {RENDER_SETTINGS(ROW, ROW, )};

void render_settings_default(struct render_settings *s)
{
    memset(s, 0, sizeof *s);
    for (int i = 0; i < SETTING_COUNT; i++)
        setting_reset(&render_settings_rows[i], s);
}

const char *settings_choices_text(const struct render_settings *s, char out[SETTINGS_CHOICES_TEXT_SIZE])
{
    char value[SETTING_TEXT_SIZE];
    size_t used = 0;

    out[0] = 0;
    for (int i = 0; i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        if (row->shown == SETTING_SHOWN_LISTED && !setting_is_default(row, s) && used < SETTINGS_CHOICES_TEXT_SIZE)
            used += (size_t)snprintf(out + used, SETTINGS_CHOICES_TEXT_SIZE - used, "%s%s %s", used ? ", " : "",
                                     row->says ? row->says : row->option, setting_text(row, s, value));
    }
    return out;
}

int render_settings_equal(const struct render_settings *a, const struct render_settings *b)
{
    for (int i = 0; i < SETTING_COUNT; i++)
        if (!setting_equal(&render_settings_rows[i], a, b))
            return 0;
    return 1;
}

const char *settings_region_text(const struct render_settings *s, char out[SETTINGS_REGION_TEXT_SIZE])
{
    out[0] = 0;
    if (s->whole_width)
        snprintf(out, SETTINGS_REGION_TEXT_SIZE, "%u,%u,%u,%u of %ux%u", s->region_x, s->region_y, s->width, s->height,
                 s->whole_width, s->whole_height);
    return out;
}

/* A whole picture has no region at all, so that equal pictures have equal settings. */
static int region_is_inside(const struct render_settings *s)
{
    if (!s->whole_width && !s->whole_height)
        return s->region_x == 0 && s->region_y == 0;
    return s->whole_width <= SETTINGS_SIZE_MAX && s->whole_height <= SETTINGS_SIZE_MAX &&
           s->region_x < s->whole_width && s->width <= s->whole_width - s->region_x && s->region_y < s->whole_height &&
           s->height <= s->whole_height - s->region_y && (s->width < s->whole_width || s->height < s->whole_height);
}

status render_settings_validate(const struct render_settings *s, uint32_t camera_count, struct error *err)
{
    char names[SETTINGS_TEXT_SIZE];

    if (s->width < 1 || s->height < 1 || s->width > SETTINGS_SIZE_MAX || s->height > SETTINGS_SIZE_MAX ||
        (uint64_t)s->width * s->height > SETTINGS_PIXELS_MAX)
        return error_set(err, STATUS_ERR_INPUT, "size %ux%u: each side must be 1..%d and the whole at most %d pixels",
                         s->width, s->height, SETTINGS_SIZE_MAX, SETTINGS_PIXELS_MAX);
    if (!region_is_inside(s))
        return error_set(err, STATUS_ERR_INPUT,
                         "region of %ux%u pixels at %u,%u: is not inside a picture of %ux%u (each side at "
                         "most %d)",
                         s->width, s->height, s->region_x, s->region_y, s->whole_width, s->whole_height,
                         SETTINGS_SIZE_MAX);
    if (s->camera >= camera_count)
        return error_set(err, STATUS_ERR_INPUT, "camera %u: the scene has %u", s->camera, camera_count);
    if (s->bvh_quality == BVH_QUALITY_HIGH && !s->not_robust)
        return error_set(err, STATUS_ERR_INPUT,
                         "BVH quality high needs the robust flag off (--robust off): with it Embree "
                         "builds the same trees as for medium");
    if (s->clamp != 0 && !(s->clamp >= SETTINGS_CLAMP_MIN))
        return error_set(err, STATUS_ERR_INPUT, "clamp %g: must be 0 (off) or %g..%g of linear radiance",
                         (double)s->clamp, (double)SETTINGS_CLAMP_MIN, (double)SETTINGS_CLAMP_MAX);
    if (s->without & ~EFFECTS_SWITCHABLE)
        return error_set(err, STATUS_ERR_INPUT, "effects that are unknown or cannot be left out: %s",
                         settings_effects_text(s->without & ~EFFECTS_SWITCHABLE, names));
    for (int i = 0; i < SETTING_COUNT; i++)
        if (setting_check(&render_settings_rows[i], s, err) != STATUS_OK)
            return STATUS_ERR_INPUT;
    return STATUS_OK;
}
