/* OpenEXR pictures, through OpenEXRCore from memory.
 *
 * The data window counts: its pixels are the picture, wherever it lies in the display window (image_size.h tells where).
 * In a tiled file with several levels the finest is read. Channels in order of
 * preference: R, G and B outside layers (a missing one is 0); Y alone; R, G and B of a layer; the only channel of a part, which
 * is grey whatever its name. Small letters count as capitals where there are none. Alpha is the one beside them, and is
 * read only on request. A chromaticities attribute other than Rec. 709's is honoured.
 */
#include <string.h>
#include <strings.h>

#include "common/base/bytes.h"
#include "common/image/color.h"
#include "common/image/exr_context.h"
#include "common/image/half.h"
#include "common/image/image.h"

enum { LAYER_NAME_MAX = 256, PARTS_MAX = 1024 };

/* Which channels of the list make red, green and blue; -1 for none. */
struct selection {
    int rgb[3];
    int alpha;     /* -1: none, or not asked for */
    int luminance; /* Y is replicated: rgb[] are all Y */
    int chroma;    /* Y with RY and BY */
    int in_layer;
};

struct exr_reader {
    exr_context_t context;
    struct exr_stream stream;
    const char *name;
    const char *wanted; /* the one channel that is requested; NULL: the picture */
    int part;
    exr_storage_t storage;
    exr_compression_t compression;
    exr_attr_box2i_t window;
    const exr_attr_chlist_t *channels;
    struct selection selection;
    struct image *out;
};

static status fail(struct exr_reader *r, exr_result_t result, struct error *err)
{
    return exr_stream_error(&r->stream, result, r->name, err);
}

/* ---- which part, which channels ---------------------------------------------------------- */

static int find_channel(const exr_attr_chlist_t *list, const char *prefix, size_t prefix_length, const char *name)
{
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < list->num_channels; i++) {
            const char *have = list->entries[i].name.str;

            if (have && strncmp(have, prefix, prefix_length) == 0 &&
                (pass ? strcasecmp : strcmp)(have + prefix_length, name) == 0)
                return i;
        }
    return -1;
}

/* R, G and B of `prefix` ("" or "layer."); 1 when all are there. */
static int select_rgb(const exr_attr_chlist_t *list, const char *prefix, size_t prefix_length, struct selection *s)
{
    static const char *const names[3] = {"R", "G", "B"};
    int found = 0;

    for (int i = 0; i < 3; i++) {
        s->rgb[i] = find_channel(list, prefix, prefix_length, names[i]);
        found += s->rgb[i] >= 0;
    }
    s->alpha = find_channel(list, prefix, prefix_length, "A");
    return prefix_length == 0 ? found > 0 : found == 3;
}

/* The layer whose name says that it is the picture; otherwise the first. */
static int select_layer(const exr_attr_chlist_t *list, struct selection *s)
{
    static const char *const main_layers[] = {"Combined.", "beauty.", "Beauty.", "rgba.", "RGBA."};
    struct selection first = {{-1, -1, -1}, -1, 0, 0, 1};
    int found = 0;

    for (int i = 0; i < list->num_channels; i++) {
        const char *name = list->entries[i].name.str;
        const char *dot = name ? strrchr(name, '.') : NULL;
        size_t length;

        if (!dot || strcasecmp(dot, ".R") != 0)
            continue;
        length = (size_t)(dot - name) + 1;
        s->in_layer = 1;
        if (!select_rgb(list, name, length, s))
            continue;
        for (size_t k = 0; k < sizeof main_layers / sizeof *main_layers; k++) {
            size_t n = strlen(main_layers[k]);
            if (length >= n && memcmp(name + length - n, main_layers[k], n) == 0)
                return 1;
        }
        if (!found)
            first = *s;
        found = 1;
    }
    *s = first;
    return found;
}

static const char view_layer[] = "ViewLayer.";

/* `lone`: the only channel of the part, which is grey; else any other choice. */
static int select_channels(const exr_attr_chlist_t *list, const char *wanted, int lone, struct selection *s)
{
    int y;

    *s = (struct selection){{-1, -1, -1}, -1, 0, 0, 0};
    if (wanted) {
        s->rgb[0] = find_channel(list, "", 0, wanted);
        if (s->rgb[0] < 0) /* as Blender names it */
            s->rgb[0] = find_channel(list, view_layer, sizeof view_layer - 1, wanted);
        s->rgb[1] = s->rgb[2] = s->rgb[0];
        s->luminance = s->in_layer = 1;
        return s->rgb[0] >= 0;
    }
    y = find_channel(list, "", 0, "Y");
    if (list->num_channels == 1 && y < 0) {
        s->rgb[0] = s->rgb[1] = s->rgb[2] = 0;
        s->luminance = 1;
        s->in_layer = !strchr("RGBA", list->entries[0].name.str[0]) || list->entries[0].name.str[1];
        return lone;
    }
    if (select_rgb(list, "", 0, s))
        return 1;
    if (y >= 0) {
        s->rgb[0] = s->rgb[1] = s->rgb[2] = y; /* alpha was searched above */
        s->luminance = 1;
        s->chroma = find_channel(list, "", 0, "RY") >= 0 && find_channel(list, "", 0, "BY") >= 0;
        return 1;
    }
    return select_layer(list, s);
}

/* The first part that is not deep and has usable channels. */
static status find_part(struct exr_reader *r, struct error *err)
{
    int count = 0, deep = 0;
    exr_result_t result = exr_get_count(r->context, &count);

    if (result != EXR_ERR_SUCCESS)
        return fail(r, result, err);
    if (count > PARTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s: %d parts are more than %d", r->name, count, (int)PARTS_MAX);
    for (int at = 0; at < 2 * count; at++) {
        const int part = at % count;

        result = exr_get_storage(r->context, part, &r->storage);
        if (result == EXR_ERR_SUCCESS &&
            (r->storage == EXR_STORAGE_DEEP_SCANLINE || r->storage == EXR_STORAGE_DEEP_TILED)) {
            deep = 1;
            continue;
        }
        if (result == EXR_ERR_SUCCESS)
            result = exr_get_channels(r->context, part, &r->channels);
        if (result == EXR_ERR_SUCCESS)
            result = exr_get_data_window(r->context, part, &r->window);
        if (result == EXR_ERR_SUCCESS)
            result = exr_get_compression(r->context, part, &r->compression);
        if (result != EXR_ERR_SUCCESS)
            return fail(r, result, err);
        r->part = part;
        if (select_channels(r->channels, r->wanted, at >= count, &r->selection))
            return STATUS_OK;
    }
    if (deep)
        return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: deep OpenEXR pictures are not supported; flatten it first",
                         r->name);
    if (r->wanted)
        return error_set(err, STATUS_ERR_NOT_FOUND, "%s: no part has a channel %s", r->name, r->wanted);
    return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: no part has channels R, G, B or Y, nor a layer with R, G, B",
                     r->name);
}

/* ---- sizes, before memory is taken -------------------------------------------------------- */

/* The maximum expansion of one byte of a file, from the codes' own limits: deflate 1032, PXR24 adds
 * a dropped byte in four, PIZ's Huffman runs 264 shorts in about ten bits, B44A a flat block of 32
 * bytes in 3; DWA deflates data that is already run-length coded. */
static double expansion_max(exr_compression_t compression)
{
    switch (compression) {
    case EXR_COMPRESSION_NONE: return 1;
    case EXR_COMPRESSION_RLE: return 128;
    case EXR_COMPRESSION_ZIPS:
    case EXR_COMPRESSION_ZIP: return 1100;
    case EXR_COMPRESSION_PIZ: return 600;
    case EXR_COMPRESSION_PXR24: return 1500;
    case EXR_COMPRESSION_B44:
    case EXR_COMPRESSION_B44A: return 16;
    default: return 100000;
    }
}

static status check_sizes(struct exr_reader *r, uint32_t *width, uint32_t *height, struct error *err)
{
    int64_t w = (int64_t)r->window.max.x - r->window.min.x + 1;
    int64_t h = (int64_t)r->window.max.y - r->window.min.y + 1;
    double raw_bytes = 0.0;
    int32_t chunks = 0;
    exr_result_t result;

    *width = *height = 0;
    if (w < 1 || h < 1)
        return error_set(err, STATUS_ERR_INPUT, "%s: the data window is empty", r->name);
    if (w > IMAGE_SIDE_MAX || h > IMAGE_SIDE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s: %lld x %lld pixels: no side may be longer than %d", r->name,
                         (long long)w, (long long)h, (int)IMAGE_SIDE_MAX);
    result = exr_get_chunk_count(r->context, r->part, &chunks);
    if (result != EXR_ERR_SUCCESS)
        return fail(r, result, err);
    for (int i = 0; i < r->channels->num_channels; i++) {
        const exr_attr_chlist_entry_t *c = &r->channels->entries[i];

        if (c->x_sampling < 1 || c->y_sampling < 1)
            return error_set(err, STATUS_ERR_INPUT, "%s: a channel's sampling is not positive", r->name);
        raw_bytes +=
            (double)(w / c->x_sampling) * (double)(h / c->y_sampling) * (c->pixel_type == EXR_PIXEL_HALF ? 2 : 4);
    }
    /* A chunk takes 8 bytes in the offset table and as many before its data, at least. */
    if (chunks < 1 || r->stream.size_bytes / 16 < (size_t)chunks ||
        raw_bytes / expansion_max(r->compression) > (double)r->stream.size_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: %zu bytes cannot hold the %lld x %lld pixels that the header claims; "
                         "the file is damaged or cut short",
                         r->name, r->stream.size_bytes, (long long)w, (long long)h);
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return STATUS_OK;
}

/* ---- pixels ------------------------------------------------------------------------------ */

static float read_sample(const uint8_t *p, int type)
{
    switch (type) {
    case EXR_PIXEL_HALF: return half_to_float(bytes_get16(p));
    case EXR_PIXEL_FLOAT: return bytes_get_float(p);
    default: return (float)bytes_get32(p); /* by value, as OpenEXR converts */
    }
}

/* A pixel (x, y) of the picture from column `x` of one line of channel `channel`. */
static void store_line(struct exr_reader *r, int channel, int type, const uint8_t *line, int64_t x0, int64_t y,
                       int32_t width)
{
    int size = type == EXR_PIXEL_HALF ? 2 : 4;

    for (uint32_t c = 0; c < 4; c++) {
        uint32_t step = r->out->channels;
        float *row;

        if ((c < 3 ? r->selection.rgb[c] : r->selection.alpha) != channel)
            continue;
        row = r->out->pixels + step * ((size_t)y * r->out->width + (size_t)x0) + c;
        for (int32_t x = 0; x < width; x++)
            row[step * (size_t)x] = read_sample(line + (size_t)x * (size_t)size, type);
    }
}

/* Our own unpacking step of the pipeline: a decoded chunk is, line by line, the samples of
 * every channel that has some on that line, little-endian. */
static exr_result_t unpack_chunk(exr_decode_pipeline_t *pipeline)
{
    struct exr_reader *r = pipeline->decoding_user_data;
    const uint8_t *p = pipeline->unpacked_buffer;
    uint64_t left = pipeline->chunk.unpacked_size;
    int64_t x0 = 0, y0;

    if (r->storage == EXR_STORAGE_TILED) {
        uint32_t tile_width = 0, tile_height = 0;
        exr_result_t result =
            exr_get_tile_descriptor(pipeline->context, r->part, &tile_width, &tile_height, NULL, NULL);
        if (result != EXR_ERR_SUCCESS)
            return result;
        x0 = (int64_t)pipeline->chunk.start_x * tile_width;
        y0 = (int64_t)pipeline->chunk.start_y * tile_height;
    } else {
        y0 = (int64_t)pipeline->chunk.start_y - r->window.min.y;
    }
    if (!p || x0 < 0 || y0 < 0 || x0 + pipeline->chunk.width > (int64_t)r->out->width ||
        y0 + pipeline->chunk.height > (int64_t)r->out->height)
        return EXR_ERR_CORRUPT_CHUNK;
    for (int32_t line = 0; line < pipeline->chunk.height; line++) {
        int64_t absolute_y = y0 + line + r->window.min.y;

        for (int c = 0; c < pipeline->channel_count; c++) {
            const exr_coding_channel_info_t *channel = &pipeline->channels[c];
            uint64_t bytes = (uint64_t)channel->width * (uint64_t)channel->bytes_per_element;

            if (channel->y_samples > 1 && absolute_y % channel->y_samples != 0)
                continue;
            if (bytes > left)
                return EXR_ERR_CORRUPT_CHUNK;
            /* The requested channels are not subsampled (check_channels). */
            if (channel->x_samples == 1 && channel->y_samples == 1)
                store_line(r, c, channel->data_type, p, x0, y0 + line, pipeline->chunk.width);
            p += bytes;
            left -= bytes;
        }
    }
    return EXR_ERR_SUCCESS;
}

/* Decode one chunk; the first call sets the pipeline up. */
static exr_result_t decode_chunk(struct exr_reader *r, exr_decode_pipeline_t *pipeline, const exr_chunk_info_t *chunk,
                                 int *started)
{
    exr_result_t result;

    if (*started) {
        result = exr_decoding_update(r->context, r->part, chunk, pipeline);
    } else {
        result = exr_decoding_initialize(r->context, r->part, chunk, pipeline);
        *started = result == EXR_ERR_SUCCESS;
        if (result == EXR_ERR_SUCCESS)
            result = exr_decoding_choose_default_routines(r->context, r->part, pipeline);
        pipeline->decoding_user_data = r;
        pipeline->unpack_and_convert_fn = unpack_chunk;
        if (r->compression == EXR_COMPRESSION_B44 || r->compression == EXR_COMPRESSION_B44A)
            pipeline->decompress_fn = exr_b44_decompress;
    }
    if (result != EXR_ERR_SUCCESS)
        return result;
    return exr_decoding_run(r->context, r->part, pipeline);
}

static exr_result_t decode_scan_lines(struct exr_reader *r, exr_decode_pipeline_t *pipeline, int *started)
{
    int32_t lines = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(r->context, r->part, &lines);

    if (result == EXR_ERR_SUCCESS && lines < 1)
        return EXR_ERR_FILE_BAD_HEADER;
    for (int64_t y = r->window.min.y; result == EXR_ERR_SUCCESS && y <= r->window.max.y;
         y += lines) {
        exr_chunk_info_t chunk;

        result = exr_read_scanline_chunk_info(r->context, r->part, (int)y, &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = decode_chunk(r, pipeline, &chunk, started);
    }
    return result;
}

static exr_result_t decode_tiles(struct exr_reader *r, exr_decode_pipeline_t *pipeline, int *started)
{
    int32_t tile_width = 0, tile_height = 0;
    exr_result_t result = exr_get_tile_sizes(r->context, r->part, 0, 0, &tile_width, &tile_height);

    if (result == EXR_ERR_SUCCESS && (tile_width < 1 || tile_height < 1))
        return EXR_ERR_FILE_BAD_HEADER;
    for (int64_t y = 0; result == EXR_ERR_SUCCESS && y * tile_height < r->out->height; y++)
        for (int64_t x = 0; result == EXR_ERR_SUCCESS && x * tile_width < r->out->width; x++) {
            exr_chunk_info_t chunk;

            result = exr_read_tile_chunk_info(r->context, r->part, (int)x, (int)y, 0, 0, &chunk);
            if (result == EXR_ERR_SUCCESS)
                result = decode_chunk(r, pipeline, &chunk, started);
        }
    return result;
}

static status decode_pixels(struct exr_reader *r, struct error *err)
{
    exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
    exr_result_t result;
    int started = 0;

    if (r->storage == EXR_STORAGE_TILED)
        result = decode_tiles(r, &pipeline, &started);
    else
        result = decode_scan_lines(r, &pipeline, &started);
    if (started)
        exr_decoding_destroy(r->context, &pipeline);
    return result == EXR_ERR_SUCCESS ? STATUS_OK : fail(r, result, err);
}

/* ---- colour ------------------------------------------------------------------------------ */

static status convert_color(struct exr_reader *r, struct error *err)
{
    exr_attr_chromaticities_t c;
    struct color_primaries from;
    double m[3][3];
    size_t count = (size_t)r->out->width * r->out->height;

    if (exr_attr_get_chromaticities(r->context, r->part, "chromaticities", &c) != EXR_ERR_SUCCESS)
        return STATUS_OK; /* Rec. 709 is the format's default */
    from = (struct color_primaries){{(double)c.red_x, (double)c.red_y},
                                    {(double)c.green_x, (double)c.green_y},
                                    {(double)c.blue_x, (double)c.blue_y},
                                    {(double)c.white_x, (double)c.white_y}};
    if (color_primaries_equal(&from, &color_rec709) || (r->selection.luminance && !r->selection.chroma))
        return STATUS_OK;
    if (!color_to_rec709(&from, m))
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: the chromaticities attribute makes no colour space; "
                         "remove or correct it",
                         r->name);
    for (size_t i = 0; i < count; i++) {
        float *p = r->out->pixels + r->out->channels * i;
        const double rgb[3] = {(double)p[0], (double)p[1], (double)p[2]};

        for (int k = 0; k < 3; k++)
            p[k] = (float)(m[k][0] * rgb[0] + m[k][1] * rgb[1] + m[k][2] * rgb[2]);
    }
    return STATUS_OK;
}

/* ---- the whole --------------------------------------------------------------------------- */

/* Is this one for OpenEXR's older API? ERR_UNSUPPORTED if that could not read it either. */
static status check_channels(const struct exr_reader *r, int *older, struct error *err)
{
    int dwa = r->compression == EXR_COMPRESSION_DWAA || r->compression == EXR_COMPRESSION_DWAB;

    *older = dwa || r->selection.chroma;
    if (*older && (r->part != 0 || r->selection.in_layer))
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: DWAA, DWAB and chroma pictures are only read from the first part and "
                         "outside layers; save it again with ZIP compression",
                         r->name);
    for (int i = 0; i < 4 && !*older; i++) {
        int channel = i < 3 ? r->selection.rgb[i] : r->selection.alpha;
        const exr_attr_chlist_entry_t *c;

        if (channel < 0)
            continue;
        c = &r->channels->entries[channel];
        if (c->x_sampling != 1 || c->y_sampling != 1)
            return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: channel %s is subsampled; save it with full resolution",
                             r->name, c->name.str);
    }
    return STATUS_OK;
}

/* The older API shows old memory where a damaged chunk decodes to too little. So first let OpenEXRCore, which detects
 * that, decode everything and discard the result. It cannot do so for DWA. */
static status check_chunks(struct exr_reader *r, uint32_t width, uint32_t height, struct error *err)
{
    struct image nowhere = {.width = width, .height = height, .channels = 3};
    struct selection wanted = r->selection;
    struct image *out = r->out;
    status st;

    if (r->compression == EXR_COMPRESSION_DWAA || r->compression == EXR_COMPRESSION_DWAB)
        return STATUS_OK;
    r->out = &nowhere; // cppcheck-suppress autoVariables -- put back below
    r->selection = (struct selection){{-1, -1, -1}, -1, 0, 0, 0};
    st = decode_pixels(r, err);
    r->out = out;
    r->selection = wanted;
    return st;
}

static status check_environment(struct exr_reader *r, struct error *err)
{
    exr_envmap_t kind;

    if (exr_attr_get_envmap(r->context, r->part, "envmap", &kind) == EXR_ERR_SUCCESS && kind == EXR_ENVMAP_CUBE)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: this is a cube map; convert it to latitude-longitude "
                         "(exrenvmap -latlong)",
                         r->name);
    return STATUS_OK;
}

static status decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, const char *wanted,
                     int alpha, struct error *err)
{
    struct exr_reader r = {.stream = {.data = data, .size_bytes = size_bytes}, .name = name,
                           .wanted = wanted, .out = out};
    exr_context_initializer_t init = exr_stream_initializer(&r.stream);
    uint32_t width, height, channels;
    exr_result_t result;
    int older = 0;
    status st;

    memset(out, 0, sizeof *out);
    result = exr_start_read(&r.context, name, &init);
    st = result == EXR_ERR_SUCCESS ? find_part(&r, err) : fail(&r, result, err);
    THEN(st, check_environment(&r, err));
    if (!alpha)
        r.selection.alpha = -1;
    channels = r.selection.alpha >= 0 ? 4 : 3;
    THEN(st, check_channels(&r, &older, err));
    THEN(st, check_sizes(&r, &width, &height, err));
    if (st == STATUS_OK && older)
        st = check_chunks(&r, width, height, err);
    if (st == STATUS_OK && older) {
        st = exr_decode_rgba(out, data, size_bytes, name, width, height, channels, err);
    } else if (st == STATUS_OK) {
        st = image_init(out, width, height, channels, err);
        if (st != STATUS_OK)
            error_prefix(err, "%s", name);
        else
            st = decode_pixels(&r, err);
    }
    THEN(st, convert_color(&r, err));
    if (r.stream.starved || r.stream.oversized)
        st = fail(&r, EXR_ERR_OUT_OF_MEMORY, err);
    exr_stream_finish(&r.context);
    if (st != STATUS_OK)
        image_release(out);
    return st;
}

status exr_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    return decode(out, data, size_bytes, name, NULL, 0, err);
}

status exr_decode_alpha(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    return decode(out, data, size_bytes, name, NULL, 1, err);
}

status exr_decode_channel(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                          const char *channel, struct error *err)
{
    return decode(out, data, size_bytes, name, channel, 0, err);
}
