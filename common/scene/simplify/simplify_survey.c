/* Examines images and the meshes' colours: everything that simplifying decodes, except the environment. */
#include <math.h>
#include <string.h>

#include "common/system/parallel.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "common/scene/simplify/simplify_parts.h"

static void survey_value(struct survey *s, int channel, float value)
{
    s->low[channel] = fminf(s->low[channel], value);
    s->high[channel] = fmaxf(s->high[channel], value);
}

static void survey_copy(struct survey *s, int from, int to)
{
    s->low[to] = s->low[from];
    s->high[to] = s->high[from];
}

/* One and two channels are grey; the last of two or four is alpha. */
static void survey_spread(struct survey *s, uint32_t channels)
{
    if (channels == 2)
        survey_copy(s, CHANNEL_GREEN, CHANNEL_ALPHA);
    if (channels % 2 == 1)
        s->low[CHANNEL_ALPHA] = s->high[CHANNEL_ALPHA] = s->floats ? 1 : s->code_max;
    if (channels < 3) {
        survey_copy(s, CHANNEL_RED, CHANNEL_GREEN);
        survey_copy(s, CHANNEL_RED, CHANNEL_BLUE);
    }
}

/* Numbers of values that every number of channels divides: a run's n-th value is always of channel
 * n % channels, and the compiler does many at once. */
enum { RUN = 48 };

#define RANGE(name, type)                                                                        \
    static void name(struct survey *s, const struct image8 *image)                               \
    {                                                                                            \
        const size_t count = (size_t)image->width * image->height * image->channels;             \
        const type *at = (const type *)(const void *)image->pixels;                              \
        type low[RUN], high[RUN];                                                                \
        size_t i = 0;                                                                            \
                                                                                                 \
        for (size_t k = 0; k < RUN; k++)                                                         \
            low[k] = high[k] = at[k % image->channels];                                          \
        for (; i + RUN <= count; i += RUN)                                                       \
            for (size_t k = 0; k < RUN; k++) {                                                   \
                low[k] = at[i + k] < low[k] ? at[i + k] : low[k];                                \
                high[k] = at[i + k] > high[k] ? at[i + k] : high[k];                             \
            }                                                                                    \
        for (size_t k = 0; i < count; i++, k++) {                                                \
            low[k] = at[i] < low[k] ? at[i] : low[k];                                            \
            high[k] = at[i] > high[k] ? at[i] : high[k];                                         \
        }                                                                                        \
        for (size_t k = 0; k < RUN; k++) {                                                       \
            size_t c = k % image->channels;                                                      \
            s->low[c] = k < image->channels ? (float)low[k] : fminf(s->low[c], (float)low[k]);   \
            s->high[c] = k < image->channels ? (float)high[k] : fmaxf(s->high[c], (float)high[k]); \
        }                                                                                        \
    }
RANGE(range_8, uint8_t)
RANGE(range_16, uint16_t)
#undef RANGE

static status survey_integers(struct survey *s, const uint8_t *data, size_t size_bytes, const char *name,
                              struct error *err)
{
    struct image8 image;
    TRY(image_decode_8(&image, data, size_bytes, name, err));
    s->code_max = image.bits == 8 ? 255 : 65535;
    if (image.bits == 8)
        range_8(s, &image);
    else
        range_16(s, &image);
    survey_spread(s, image.channels);
    image8_release(&image);
    return STATUS_OK;
}

static status survey_floats(struct survey *s, const uint8_t *data, size_t size_bytes, const char *name,
                            struct error *err)
{
    struct image image;
    status st = image_decode_float(&image, data, size_bytes, name, NULL, err);
    size_t count;

    if (st != STATUS_OK)
        return st;
    count = (size_t)image.width * image.height;
    s->floats = 1;
    for (int c = 0; c < (int)image.channels; c++) {
        s->low[c] = s->high[c] = image.pixels[c];
        for (size_t i = 1; i < count; i++)
            survey_value(s, c, image.pixels[i * image.channels + (size_t)c]);
    }
    survey_spread(s, image.channels);
    image_release(&image);
    return STATUS_OK;
}

static void survey_image(struct simplifier *w, uint32_t index)
{
    const struct scene_image *image = &w->scene->images[index];
    struct survey *s = &w->images[index];
    struct error *err = &s->fault;
    const uint8_t *data;
    size_t size_bytes;
    status st;

    if (s->done)
        return;
    s->done = 1;
    st = w->reader.get(w->reader.user, &image->blob.digest, &data, &size_bytes, err);
    if (st == STATUS_OK && image_format_is_float(image_format_of(data, size_bytes)))
        st = survey_floats(s, data, size_bytes, image->name, err);
    else if (st == STATUS_OK)
        st = survey_integers(s, data, size_bytes, image->name, err);
    s->fault.code = st;
}

status simplify_survey(struct simplifier *w, const struct scene_texture_slot *slot, const struct survey **out)
{
    uint32_t index = w->scene->textures[slot->texture].image;

    survey_image(w, index);
    *out = &w->images[index];
    if ((*out)->fault.code != STATUS_OK) {
        *w->err = (*out)->fault;
        w->report->image_failed = 1;
    }
    return (*out)->fault.code;
}

static void survey_wanted(void *user, size_t begin, size_t end)
{
    struct simplifier *w = user;

    for (size_t i = begin; i < end; i++)
        if (w->image_wanted[i])
            survey_image(w, (uint32_t)i);
}

void simplify_survey_ahead(struct simplifier *w)
{
    const struct scene *scene = w->scene;

    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int k = 0; k < MATERIAL_TEXTURES && w->material_reached[i]; k++) {
            const struct scene_material *m = &scene->materials[i];

            if (m->textures[k].texture >= 0 && (w->animated[i] || material_texture_acts(m, k)))
                w->image_wanted[scene->textures[m->textures[k].texture].image] = 1;
        }
    parallel_for(0, scene->image_count, 1, survey_wanted, w);
}

status simplify_survey_animated(struct simplifier *w, const struct scene_material *m)
{
    const struct survey *ignored;

    for (int k = 0; k < MATERIAL_TEXTURES; k++)
        if (m->textures[k].texture >= 0)
            TRY(simplify_survey(w, &m->textures[k], &ignored));
    return STATUS_OK;
}

int survey_is_constant(const struct survey *s, int channel) { return s->low[channel] == s->high[channel]; }

float survey_least(const struct survey *s, int channel, int srgb)
{
    float code = s->low[channel];

    if (s->floats)
        return code;
    if (!srgb || channel == CHANNEL_ALPHA)
        return code / s->code_max;
    return srgb_decode(code / s->code_max);
}

int survey_is_flat(const struct survey *s)
{
    const float max = s->floats ? 1 : s->code_max;

    for (int c = CHANNEL_RED; c <= CHANNEL_GREEN; c++)
        if (s->low[c] / max < 127.0f / 255.0f || s->high[c] / max > 128.0f / 255.0f)
            return 0;
    return s->low[CHANNEL_BLUE] / max >= 254.0f / 255.0f && s->high[CHANNEL_BLUE] / max <= 1.0f;
}

/* ---- alpha of vertices --------------------------------------------------------------------- */

/* Is any vertex's alpha other than 1? */
static status survey_mesh_alpha(struct simplifier *w, uint32_t index, int *below)
{
    const struct scene_mesh *mesh = &w->scene->meshes[index];
    struct scene_mesh_layout layout;
    const uint8_t *data;
    size_t size_bytes;
    status st;

    *below = w->mesh_alpha[index] == 2;
    if (w->mesh_alpha[index] || !(mesh->arrays & MESH_COLORS))
        return STATUS_OK;
    st = w->reader.get(w->reader.user, &mesh->blob.digest, &data, &size_bytes, w->err);
    if (st != STATUS_OK)
        return st;
    scene_mesh_layout(mesh, &layout);
    if (size_bytes != layout.total_bytes)
        return error_set(w->err, STATUS_ERR_INPUT, "mesh %s: its blob has %zu bytes instead of %zu", mesh->name,
                         size_bytes, layout.total_bytes);
    for (uint32_t i = 0; i < mesh->vertex_count && !*below; i++) {
        float alpha;

        memcpy(&alpha, data + layout.colors + 16 * (size_t)i + 12, sizeof alpha);
        *below = alpha != 1.0f;
    }
    w->mesh_alpha[index] = *below ? 2 : 1;
    return STATUS_OK;
}

status simplify_survey_colors(struct simplifier *w)
{
    const struct scene *scene = w->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        int below = 0;
        const struct scene_material *m = &scene->materials[instance->material];

        if (m->kind != MATERIAL_MIX && m->alpha_mode == ALPHA_OPAQUE)
            continue;
        TRY(survey_mesh_alpha(w, instance->mesh, &below));
        if (below)
            w->alpha_colors[instance->material] = 1;
    }
    for (uint32_t i = scene->material_count; i-- > 0;)
        if (w->alpha_colors[i] && scene->materials[i].kind == MATERIAL_MIX)
            for (int k = 0; k < 2; k++)
                w->alpha_colors[scene->materials[i].mix_material[k]] = 1;
    return STATUS_OK;
}
