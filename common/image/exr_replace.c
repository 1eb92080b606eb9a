/* Other values in a layer of a file that exr_encode wrote. */
#include <string.h>

#include "common/base/memory.h"
#include "common/image/exr_context.h"
#include "common/image/image.h"

/* An attribute of the file, with what it points to. */
struct kept {
    char *text;
    double point[3];
    float matrix[16];
    int32_t fraction[2];
};

struct replacing {
    exr_context_t context;
    struct exr_stream stream;
    const char *name;
    const char *const *layer; /* [3] the channels that are replaced */
    exr_attr_box2i_t window, display;
    uint32_t width, height;
    struct kept *kept; /* [attribute_count] */
    struct exr_attribute *attributes;
    size_t attribute_count;
    char *names[EXR_CHANNELS_MAX]; /* of the other channels */
    struct exr_channel channels[EXR_CHANNELS_MAX];
    float *planes[EXR_CHANNELS_MAX]; /* [height][width] */
    size_t channel_count;
    int half; /* the layer's */
};

static status fail(const struct replacing *r, exr_result_t result, struct error *err)
{
    return exr_stream_error(&r->stream, result, r->name, err);
}

static int layer_channel(const struct replacing *r, const char *name)
{
    for (int c = 0; c < 3; c++)
        if (strcmp(name, r->layer[c]) == 0)
            return c;
    return -1;
}

/* ---- what is kept ---------------------------------------------------------------------------- */

static status take_channels(struct replacing *r, struct error *err)
{
    const exr_attr_chlist_t *list = NULL;
    exr_result_t result = exr_get_channels(r->context, 0, &list);
    int found = 0;

    if (result != EXR_ERR_SUCCESS)
        return fail(r, result, err);
    for (int i = 0; i < list->num_channels; i++) {
        const char *name = list->entries[i].name.str;
        const int half = list->entries[i].pixel_type == EXR_PIXEL_HALF;
        const size_t at = r->channel_count;
        if (layer_channel(r, name) >= 0) {
            found++;
            r->half = half;
            continue;
        }
        if (at == EXR_CHANNELS_MAX)
            return error_set(err, STATUS_ERR_LIMIT, "%s: has more than %d channels", r->name, EXR_CHANNELS_MAX);
        r->names[at] = mem_strdup(name);
        r->planes[at] = mem_alloc_array((size_t)r->width * r->height, sizeof(float));
        NEED(r->names[at] && r->planes[at], err, r->name);
        r->channels[at] = (struct exr_channel){r->names[at], !half};
        r->channel_count++;
    }
    return found == 3 ? STATUS_OK : error_set(err, STATUS_ERR_NOT_FOUND, "%s: has no channel %s", r->name, r->layer[0]);
}

/* 0: exr_encode writes it by itself. */
static int take_attribute(struct kept *kept, const exr_attribute_t *from, struct exr_attribute *out)
{
    *out = (struct exr_attribute){.name = from->name};
    if (strcmp(from->name, "type") == 0 || strcmp(from->name, "name") == 0) /* of the part */
        return 0;
    switch (from->type) {
    case EXR_ATTR_STRING: out->text = kept->text = mem_strdup(from->string->str); return 1;
    case EXR_ATTR_V3D:
        memcpy(kept->point, (double[3]){from->v3d->x, from->v3d->y, from->v3d->z}, sizeof kept->point);
        out->point = kept->point;
        return 1;
    case EXR_ATTR_M44F:
        memcpy(kept->matrix, from->m44f->m, sizeof kept->matrix);
        out->matrix = kept->matrix;
        return 1;
    case EXR_ATTR_RATIONAL:
        kept->fraction[0] = from->rational->num;
        kept->fraction[1] = (int32_t)from->rational->denom;
        out->fraction = kept->fraction;
        return 1;
    case EXR_ATTR_DOUBLE: out->number = from->d; return 1;
    default: return 0;
    }
}

static status take_attributes(struct replacing *r, const char *prefix, const struct exr_attribute *more,
                              size_t more_count, struct error *err)
{
    int32_t count = 0;
    exr_result_t result = exr_get_attribute_count(r->context, 0, &count);

    if (result != EXR_ERR_SUCCESS)
        return fail(r, result, err);
    r->kept = mem_calloc((size_t)count + more_count, sizeof *r->kept);
    r->attributes = mem_calloc((size_t)count + more_count, sizeof *r->attributes);
    NEED(r->kept && r->attributes, err, r->name);
    for (int32_t i = 0; i < count; i++) {
        const exr_attribute_t *from = NULL;
        struct exr_attribute *to = &r->attributes[r->attribute_count];
        result = exr_get_attribute_by_index(r->context, 0, EXR_ATTR_LIST_FILE_ORDER, i, &from);
        if (result != EXR_ERR_SUCCESS)
            return fail(r, result, err);
        if (strncmp(from->name, prefix, strlen(prefix)) == 0 || !take_attribute(&r->kept[r->attribute_count], from, to))
            continue;
        to->name = mem_strdup(from->name);
        NEED(to->name && (from->type != EXR_ATTR_STRING || to->text), err, r->name);
        r->attribute_count++;
    }
    for (size_t i = 0; i < more_count; i++) {
        r->attributes[r->attribute_count] = more[i];
        r->attributes[r->attribute_count].name = mem_strdup(more[i].name);
        NEED(r->attributes[r->attribute_count].name, err, r->name);
        r->attribute_count++;
    }
    return STATUS_OK;
}

/* ---- pixels ---------------------------------------------------------------------------------- */

/* Where the chunk's samples go, as floats: a half is one exactly. */
static void aim(struct replacing *r, exr_decode_pipeline_t *pipeline, int32_t y)
{
    size_t at = 0;

    for (int c = 0; c < pipeline->channel_count; c++) {
        exr_coding_channel_info_t *channel = &pipeline->channels[c];
        float *to = NULL;
        if (layer_channel(r, channel->channel_name) < 0)
            to = r->planes[at++] + (size_t)(y - r->window.min.y) * r->width;
        channel->decode_to_ptr = (uint8_t *)to;
        channel->user_pixel_stride = sizeof(float);
        channel->user_line_stride = (int32_t)(r->width * sizeof(float));
        channel->user_bytes_per_element = sizeof(float);
        channel->user_data_type = EXR_PIXEL_FLOAT;
    }
}

static status take_pixels(struct replacing *r, struct error *err)
{
    exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
    int32_t lines = 0, started = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(r->context, 0, &lines);

    for (int32_t y = r->window.min.y; result == EXR_ERR_SUCCESS && y <= r->window.max.y; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_read_scanline_chunk_info(r->context, 0, y, &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = started ? exr_decoding_update(r->context, 0, &chunk, &pipeline)
                             : exr_decoding_initialize(r->context, 0, &chunk, &pipeline);
        if (result != EXR_ERR_SUCCESS)
            break;
        aim(r, &pipeline, y);
        if (!started)
            result = exr_decoding_choose_default_routines(r->context, 0, &pipeline);
        started = 1;
        if (result == EXR_ERR_SUCCESS)
            result = exr_decoding_run(r->context, 0, &pipeline);
    }
    if (started)
        exr_decoding_destroy(r->context, &pipeline);
    return result == EXR_ERR_SUCCESS ? STATUS_OK : fail(r, result, err);
}

static status take_windows(struct replacing *r, const struct image *layer, struct error *err)
{
    exr_storage_t storage = EXR_STORAGE_TILED;
    exr_result_t result = exr_get_data_window(r->context, 0, &r->window);

    if (result == EXR_ERR_SUCCESS)
        result = exr_get_display_window(r->context, 0, &r->display);
    if (result == EXR_ERR_SUCCESS)
        result = exr_get_storage(r->context, 0, &storage);
    if (result != EXR_ERR_SUCCESS)
        return fail(r, result, err);
    r->width = layer->width;
    r->height = layer->height;
    if (storage != EXR_STORAGE_SCANLINE || (int64_t)r->window.max.x - r->window.min.x + 1 != r->width ||
        (int64_t)r->window.max.y - r->window.min.y + 1 != r->height || r->window.min.x < 0 || r->window.min.y < 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: is no picture of %ux%u pixels in scan lines", r->name, r->width, r->height);
    return STATUS_OK;
}

static void copy_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct replacing *r = user;
    const size_t count = (size_t)r->width * height;

    for (size_t c = 0; c < r->channel_count; c++)
        memcpy(planes + c * count, r->planes[c] + (size_t)y * r->width, count * sizeof *planes);
}

static void release(struct replacing *r)
{
    for (size_t i = 0; r->attributes && i < r->attribute_count; i++) {
        mem_free((char *)r->attributes[i].name);
        mem_free(r->kept[i].text);
    }
    mem_free(r->attributes);
    mem_free(r->kept);
    for (size_t c = 0; c < EXR_CHANNELS_MAX; c++) {
        mem_free(r->planes[c]);
        mem_free(r->names[c]);
    }
}

status exr_replace(struct buffer *out, const uint8_t *data, size_t size_bytes, const char *name,
                   const char *const channels[3], const struct image *layer, const char *prefix,
                   const struct exr_attribute *attributes, size_t attribute_count, struct error *err)
{
    struct replacing r = {.stream = {.data = data, .size_bytes = size_bytes}, .name = name, .layer = channels};
    exr_context_initializer_t init = exr_stream_initializer(&r.stream);
    exr_result_t result = exr_start_read(&r.context, name, &init);
    status s = result == EXR_ERR_SUCCESS ? take_windows(&r, layer, err) : fail(&r, result, err);

    THEN(s, take_channels(&r, err));
    THEN(s, take_attributes(&r, prefix, attributes, attribute_count, err));
    THEN(s, take_pixels(&r, err));
    if (r.stream.starved || r.stream.oversized)
        s = fail(&r, EXR_ERR_OUT_OF_MEMORY, err);
    exr_stream_finish(&r.context);
    if (s == STATUS_OK) {
        const struct exr_channels others = {.channels = r.channels, .count = r.channel_count, .lines = copy_lines, .user = &r};
        const struct exr_window window = {(uint32_t)r.display.max.x + 1, (uint32_t)r.display.max.y + 1, (uint32_t)r.window.min.x,
                                          (uint32_t)r.window.min.y};
        const int whole = window.width == r.width && window.height == r.height;
        const struct exr_options options = {.window = whole ? NULL : &window, .names = channels, .half = r.half,
                                            .attributes = r.attributes, .attribute_count = r.attribute_count, .more = &others};
        s = exr_encode(out, layer, &options, err);
    }
    release(&r);
    return s;
}
