/* MTL: maps become textures. The scene keeps alpha with colour and roughness with metalness, MTL
 * has separate files: those are combined into new images, and height maps become normal maps,
 * whose slope takes black to white for HEIGHT_TEXELS texels times -bm. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/obj/obj.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"

static const float HEIGHT_TEXELS = 8;

/* ---- single files --------------------------------------------------------------------------- */

static status leave_out(struct obj *o, const struct obj_material *m, const struct obj_texture *map, status why)
{
    return builder_leave_out(o->b, o->files.texts[m->file], map->line, "texture", map->file, why);
}

/* The pixels, and the file itself in `bytes`. After a failure, which is a warning, *good is 0. */
static status decode_map(struct obj *o, const struct obj_material *m, const struct obj_texture *map,
                         struct buffer *bytes, struct image8 *image, int *good)
{
    enum image_format format = IMAGE_UNKNOWN;
    status result = obj_read_file(o, o->files.texts[m->file], map->file, IMPORT_FILE_BYTES_MAX, bytes, o->err);

    if (result == STATUS_OK) {
        TRY(builder_check_image(o->b, map->file, bytes->data, bytes->size));
        format = image_format_of(bytes->data, bytes->size);
        if (format == IMAGE_UNKNOWN) {
            result = error_set(o->err, STATUS_ERR_UNSUPPORTED,
                               "is not a PNG, JPEG, WebP, TGA, PFM, Radiance HDR or OpenEXR file: "
                               "convert it");
        } else if (image_format_is_float(format)) {
            struct image deep = {0};
            result = image_decode_float(&deep, bytes->data, bytes->size, map->file, NULL, o->err);
            image_release(&deep);
        } else {
            result = image_decode_8(image, bytes->data, bytes->size, map->file, o->err);
        }
    }
    *good = result == STATUS_OK;
    return *good ? STATUS_OK : leave_out(o, m, map, result);
}

/* One channel of a pixel, 0..1. */
static float channel(const struct image8 *image, uint32_t x, uint32_t y, uint32_t c)
{
    size_t at = ((size_t)y * image->width + x) * image->channels + c;

    if (image->bits == 16) {
        uint16_t deep;
        memcpy(&deep, image->pixels + 2 * at, sizeof deep);
        return (float)deep / 65535.0f;
    }
    return (float)image->pixels[at] / 255.0f;
}

static int has_alpha(const struct image8 *image) { return image->channels == 2 || image->channels == 4; }

/* The value of a map of single numbers: of the channel that -imfchan names, else the mean of the colours. */
static float level(const struct image8 *image, uint32_t x, uint32_t y, char which)
{
    const char *color = which ? strchr("rgb", which) : NULL;
    float rgb[3];

    if (which == 'm')
        return has_alpha(image) ? channel(image, x, y, image->channels - 1) : 1;
    if (image->channels <= 2)
        return channel(image, x, y, 0);
    for (uint32_t c = 0; c < 3; c++)
        rgb[c] = channel(image, x, y, c);
    if (which == 'l')
        return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
    return color ? rgb[color - "rgb"] : (rgb[0] + rgb[1] + rgb[2]) / 3;
}

/* Without any colour it is a height map, not a normal map. */
static int is_grey(const struct image8 *image)
{
    if (image->channels <= 2)
        return 1;
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            float r = channel(image, x, y, 0);
            float g = channel(image, x, y, 1);
            float b = channel(image, x, y, 2);
            if (fabsf(r - g) > 0.05f || fabsf(g - b) > 0.05f)
                return 0;
        }
    return 1;
}

/* ---- pictures that are kept ----------------------------------------------------------------- */

static struct obj_image *find_image(const struct obj *o, const char *key)
{
    for (size_t i = 0; i < o->image_count; i++)
        if (strcmp(o->images[i].key, key) == 0)
            return &o->images[i];
    return NULL;
}

/* Store an image under its key. `data` (NULL: unusable) is taken over, also on failure. */
static status keep_image(struct obj *o, const char *key, const char *name, uint8_t *data, size_t size, int grey,
                         struct obj_image **out)
{
    struct obj_image image = {.key = must(mem_strdup(key)), .row = BUILDER_NO_ROW, .is_grey = grey};
    uint32_t row;
    status result = STATUS_OK;

    MUST_GROW(o->images, o->image_capacity, o->image_count + 1);
    if (data) {
        result = builder_add_image(o->b, file_basename(name), data, size, &row);
        image.row = result == STATUS_OK ? (int64_t)row : BUILDER_NO_ROW;
    }
    if (result != STATUS_OK) {
        mem_free(image.key);
        return result;
    }
    *out = &o->images[o->image_count];
    o->images[o->image_count++] = image;
    return STATUS_OK;
}

/* The image of one file, unchanged. */
static status file_image(struct obj *o, const struct obj_material *m, const struct obj_texture *map,
                         struct obj_image **out)
{
    struct buffer bytes = BUFFER_INIT;
    struct image8 pixels = {0};
    int good, grey;
    status result;

    *out = find_image(o, map->file);
    if (*out)
        return STATUS_OK;
    result = decode_map(o, m, map, &bytes, &pixels, &good);
    if (result == STATUS_OK) {
        grey = good && pixels.pixels && is_grey(&pixels);
        if (!good)
            buffer_release(&bytes);
        result = keep_image(o, map->file, map->file, bytes.data, bytes.size, grey, out);
        bytes = (struct buffer)BUFFER_INIT; /* taken over */
    }
    image8_release(&pixels);
    buffer_release(&bytes);
    return result;
}

/* A map in an image that is made: at x = 0..1 of its width stands what the map has at times x + shift, from top left. */
struct placed {
    struct image8 image; /* may be without pixels */
    double times[2], shift[2];
    int clamp;
    char channel;
    uint32_t at[2]; /* the pixel that belongs to the one being made */
};

/* An image made of pixels that fill(bake) makes, where texture coordinates are as `frame` says. */
struct bake {
    struct placed a, b;
    struct obj_texture frame;
    float bump;
    void (*fill)(const struct bake *bake, uint8_t rgba[4]);
};

/* The shift of texture coordinates from the image's top left: v upwards, v' = s v + o, 1 - v' = s (1 - v) + 1 - s - o. */
static double shift_of(const struct obj_texture *map, int axis)
{
    return axis ? 1 - (double)map->scale[1] - (double)map->offset[1] : (double)map->offset[0];
}

/* How often an image repeats a map, at least once, so that another repeats a whole number of times, too; 0: more than
 * REPEATS_MAX. */
static double repeats(const struct obj_texture *map, const struct obj_texture *other, int axis)
{
    enum { REPEATS_MAX = 16 };

    for (double k = 1; map->scale[axis] != 0 && k <= REPEATS_MAX; k++) {
        double times = k * (double)other->scale[axis] / (double)map->scale[axis];
        if (fabs(times) >= 0.5 && fabs(times) <= REPEATS_MAX && fabs(times - round(times)) < 1e-4)
            return k;
    }
    return 0;
}

/* The frame of an image that holds both maps: its period is a period of both. Where none is, or only one of them repeats,
 * it holds for texture coordinates of 0 to 1, and a warning says so. */
static void choose_frame(struct obj *o, const struct obj_material *m, const struct obj_texture *a,
                         const struct obj_texture *b, struct obj_texture *frame)
{
    double k[2];

    *frame = a->file ? *a : *b;
    if (!a->file || !b->file || (memcmp(a->scale, b->scale, sizeof a->scale) == 0 &&
                                 memcmp(a->offset, b->offset, sizeof a->offset) == 0 && a->clamp == b->clamp))
        return;
    for (int axis = 0; axis < 2; axis++)
        k[axis] = a->clamp || b->clamp ? 0 : repeats(a, b, axis);
    for (int axis = 0; axis < 2; axis++) {
        double shift = k[0] > 0 && k[1] > 0 ? shift_of(a, axis) / k[axis] : 0;
        frame->scale[axis] = k[0] > 0 && k[1] > 0 ? (float)((double)a->scale[axis] / k[axis]) : 1;
        frame->offset[axis] = (float)(axis ? 1 - (double)frame->scale[1] - shift : shift);
    }
    frame->clamp = a->clamp && b->clamp;
    if (!(k[0] > 0 && k[1] > 0))
        builder_warn_at(o->b, o->files.texts[m->file], b->line, "maps that are combined",
                        "the options of \"%.100s\" and of \"%.100s\", which become one picture, hold together for texture "
                        "coordinates of 0 to 1 only",
                        a->file, b->file);
}

static void place(struct placed *out, const struct obj_texture *map, const struct obj_texture *frame)
{
    for (int axis = 0; axis < 2 && map->file; axis++) {
        out->times[axis] = frame->scale[axis] != 0 ? (double)map->scale[axis] / (double)frame->scale[axis] : 1;
        out->shift[axis] = shift_of(map, axis) - out->times[axis] * shift_of(frame, axis);
    }
    out->clamp = map->clamp;
    out->channel = map->channel;
}

/* The map's column or row at 0..1 of the image. */
static uint32_t index_at(const struct placed *map, int axis, double place)
{
    uint32_t size = axis ? map->image.height : map->image.width;
    double x = map->times[axis] * place + map->shift[axis];

    x = map->clamp ? fmin(fmax(x, 0), 1) : x - floor(x);
    return (uint32_t)fmin(x * size, fmax(size, 1) - 1);
}

static float color_of(const struct placed *map, uint32_t c)
{
    return channel(&map->image, map->at[0], map->at[1], map->image.channels <= 2 ? 0 : c);
}

static float level_of(const struct placed *map, char which) { return level(&map->image, map->at[0], map->at[1], which); }

/* Pixels of the image made: a pixel of each map becomes at least one. */
static uint32_t size_of(const struct bake *bake, int axis)
{
    enum { SIZE_MAX_PIXELS = 4096 };
    const struct placed *maps[2] = {&bake->a, &bake->b};
    double size = 1;

    for (int i = 0; i < 2; i++) {
        uint32_t own = axis ? maps[i]->image.height : maps[i]->image.width;
        size = fmax(size, fmax(own, fmin(ceil(own * fabs(maps[i]->times[axis]) - 1e-3), SIZE_MAX_PIXELS)));
    }
    return (uint32_t)size;
}

static uint8_t to_byte(float x) { return (uint8_t)(fminf(fmaxf(x, 0), 1) * 255 + 0.5f); }

static status bake_image(struct obj *o, struct bake *bake, const char *key, const char *name, struct obj_image **out)
{
    uint32_t width = size_of(bake, 0), height = size_of(bake, 1);
    uint32_t *columns = must(mem_alloc_array(width, 2 * sizeof *columns));
    struct image8 rgba = {0};
    struct buffer png = BUFFER_INIT;
    status result = image8_init(&rgba, width, height, 4, 8, o->err);

    for (uint32_t x = 0; x < width; x++) {
        columns[2 * x] = index_at(&bake->a, 0, (x + 0.5) / width);
        columns[2 * x + 1] = index_at(&bake->b, 0, (x + 0.5) / width);
    }
    for (uint32_t y = 0; y < height && result == STATUS_OK; y++) {
        bake->a.at[1] = index_at(&bake->a, 1, (y + 0.5) / height);
        bake->b.at[1] = index_at(&bake->b, 1, (y + 0.5) / height);
        for (uint32_t x = 0; x < width; x++) {
            bake->a.at[0] = columns[2 * x];
            bake->b.at[0] = columns[2 * x + 1];
            bake->fill(bake, rgba.pixels + 4 * ((size_t)y * width + x));
        }
    }
    mem_free(columns);
    if (result == STATUS_OK)
        result = png_encode_8(&png, &rgba, 1, o->err);
    image8_release(&rgba);
    if (result == STATUS_OK)
        return keep_image(o, key, name, png.data, png.size, 0, out);
    buffer_release(&png);
    return result;
}

static status fill_slot(struct obj *o, const struct obj_image *image, const struct obj_texture *map,
                        struct scene_texture_slot *slot)
{
    struct scene_texture texture = {.wrap_u = map->clamp ? WRAP_CLAMP : WRAP_REPEAT,
                                    .wrap_v = map->clamp ? WRAP_CLAMP : WRAP_REPEAT};
    uint32_t row;

    if (image->row == BUILDER_NO_ROW)
        return STATUS_OK;
    texture.image = (uint32_t)image->row;
    TRY(builder_add_texture(o->b, &texture, &row));
    slot->texture = (int32_t)row;
    for (int axis = 0; axis < 2; axis++) {
        slot->uv_transform[axis][axis] = map->scale[axis];
        slot->uv_transform[axis][2] = (float)shift_of(map, axis);
    }
    return STATUS_OK;
}

static void say_placed(struct buffer *key, const struct placed *p, const char *file)
{
    buffer_printf(key, "\n%c %d %.9g %.9g %.9g %.9g %s", p->channel ? p->channel : '-', p->clamp, p->times[0],
                  p->times[1], p->shift[0], p->shift[1], file ? file : "");
}

/* Fill the slot with the image combined from the files of `a` and `b` (either may have none). */
static status baked_map(struct obj *o, const struct obj_material *m, const char *kind, const struct obj_texture *a,
                        const struct obj_texture *b, struct bake bake, struct scene_texture_slot *slot)
{
    struct buffer key = BUFFER_INIT, bytes = BUFFER_INIT;
    struct placed *placed[2] = {&bake.a, &bake.b};
    const struct obj_texture *maps[2] = {a, b};
    struct obj_image *image;
    int good;
    status result = STATUS_OK;

    choose_frame(o, m, a, b, &bake.frame);
    buffer_printf(&key, "%s %.9g", kind, (double)bake.bump);
    for (int i = 0; i < 2; i++) {
        place(placed[i], maps[i], &bake.frame);
        say_placed(&key, placed[i], maps[i]->file);
    }
    must_hold(&key);
    image = find_image(o, buffer_text(&key));
    if (image)
        goto done;
    for (int i = 0; i < 2 && result == STATUS_OK; i++)
        if (maps[i]->file) {
            result = decode_map(o, m, maps[i], &bytes, &placed[i]->image, &good);
            if (result == STATUS_OK && good && !placed[i]->image.pixels)
                result = leave_out(o, m, maps[i], error_set(o->err, STATUS_ERR_UNSUPPORTED,
                                   "a floating point image cannot be combined with another, nor be a height map"));
            buffer_release(&bytes);
        }
    if (result == STATUS_OK && (bake.a.image.pixels || bake.b.image.pixels))
        result = bake_image(o, &bake, buffer_text(&key), a->file ? a->file : b->file, &image);
    else if (result == STATUS_OK)
        result = keep_image(o, buffer_text(&key), "", NULL, 0, 0, &image);
done:
    THEN(result, fill_slot(o, image, &bake.frame, slot));
    image8_release(&bake.a.image);
    image8_release(&bake.b.image);
    buffer_release(&key);
    return result;
}

/* ---- what is put together ------------------------------------------------------------------- */

/* Colours of a, opacity of b: its alpha if it has one, else its level. */
static void fill_alpha(const struct bake *bake, uint8_t rgba[4])
{
    const struct placed *a = &bake->a, *b = &bake->b;

    for (uint32_t c = 0; c < 3; c++)
        rgba[c] = a->image.pixels ? to_byte(color_of(a, c)) : 255;
    rgba[3] = b->image.pixels ? to_byte(level_of(b, !b->channel && has_alpha(&b->image) ? 'm' : b->channel)) : 255;
}

/* Green: roughness, of a; blue: metal, of b. */
static void fill_metal(const struct bake *bake, uint8_t rgba[4])
{
    const struct placed *a = &bake->a, *b = &bake->b;

    rgba[0] = rgba[3] = 255;
    rgba[1] = a->image.pixels ? to_byte(level_of(a, a->channel)) : 255;
    rgba[2] = b->image.pixels ? to_byte(level_of(b, b->channel)) : 255;
}

/* The normal of height map a, by central differences that wrap around the edges. */
static void fill_normal(const struct bake *bake, uint8_t rgba[4])
{
    const struct image8 *a = &bake->a.image;
    const char which = bake->a.channel;
    uint32_t x = bake->a.at[0], y = bake->a.at[1];
    uint32_t left = x ? x - 1 : a->width - 1, right = x + 1 < a->width ? x + 1 : 0;
    uint32_t above = y ? y - 1 : a->height - 1, below = y + 1 < a->height ? y + 1 : 0;
    float steep = 0.5f * HEIGHT_TEXELS * bake->bump;
    float du = steep * (level(a, right, y, which) - level(a, left, y, which));
    float dv = steep * (level(a, x, above, which) - level(a, x, below, which));
    float length = sqrtf(du * du + dv * dv + 1);

    rgba[0] = to_byte(0.5f - 0.5f * du / length);
    rgba[1] = to_byte(0.5f - 0.5f * dv / length);
    rgba[2] = to_byte(0.5f + 0.5f / length);
    rgba[3] = 255;
}

/* ---- slots ---------------------------------------------------------------------------------- */

static status plain_map(struct obj *o, const struct obj_material *in, enum obj_map map, struct scene_texture_slot *slot)
{
    struct obj_image *image;

    if (!in->maps[map].file)
        return STATUS_OK;
    TRY(file_image(o, in, &in->maps[map], &image));
    return fill_slot(o, image, &in->maps[map], slot);
}

static status color_map(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    const struct obj_texture *kd = &in->maps[OBJ_MAP_KD], *d = &in->maps[OBJ_MAP_D];

    /* A picture that is both, such as a PNG with alpha, is used unchanged with its own alpha. */
    if (out->alpha_mode == ALPHA_OPAQUE || !d->file)
        return plain_map(o, in, OBJ_MAP_KD, &out->base_color_texture);
    return baked_map(o, in, "alpha", kd, d, (struct bake){.fill = fill_alpha}, &out->base_color_texture);
}

static status metal_maps(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    const struct obj_texture *pr = &in->maps[OBJ_MAP_PR], *pm = &in->maps[OBJ_MAP_PM];

    if (!pr->file && !pm->file)
        return STATUS_OK;
    return baked_map(o, in, "metal", pr, pm, (struct bake){.fill = fill_metal}, &out->metallic_roughness_texture);
}

static status normal_map(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    const struct obj_texture none = {0}, *map = &in->maps[OBJ_MAP_NORMAL];
    struct obj_image *image;

    if (!map->file)
        map = &in->maps[OBJ_MAP_BUMP];
    if (!map->file)
        return STATUS_OK;
    TRY(file_image(o, in, map, &image));
    if (map == &in->maps[OBJ_MAP_BUMP] && (image->is_grey || map->channel))
        return baked_map(o, in, "height", map, &none, (struct bake){.fill = fill_normal, .bump = map->bump}, &out->normal_texture);
    out->normal_scale = map->bump;
    return fill_slot(o, image, map, &out->normal_texture);
}

status obj_textures(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    TRY(color_map(o, in, out));
    TRY(plain_map(o, in, OBJ_MAP_KE, &out->emission_texture));
    if (in->maps[OBJ_MAP_KE].file && out->emission_texture.texture < 0)
        memset(out->emission, 0, sizeof out->emission); /* it may say which small part glows */
    if (out->specular > 0)
        TRY(plain_map(o, in, OBJ_MAP_KS, &out->specular_color_texture));
    TRY(metal_maps(o, in, out));
    return normal_map(o, in, out);
}
