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

static void warn_of_texture(struct obj *o, const struct obj_material *m, const struct obj_texture *map, const char *why)
{
    char kind[300];

    snprintf(kind, sizeof kind, "texture %.200s", map->file);
    builder_warn_at(o->b, o->files.texts[m->file], map->line, kind,
                    "the texture \"%.200s\" cannot be used (%.250s): left out", map->file, why);
}

/* The pixels, and the file itself in `bytes`. After a failure, which is a warning, *good is 0. */
static status decode_map(struct obj *o, const struct obj_material *m, const struct obj_texture *map,
                         struct buffer *bytes, struct image8 *image, int *good)
{
    struct error inner = {0};
    enum image_format format;
    status result = obj_read_file(o, o->files.texts[m->file], map->file, IMPORT_FILE_BYTES_MAX, bytes, &inner);

    if (result == STATUS_OK) {
        TRY(builder_check_image(o->b, map->file, bytes->data, bytes->size));
        format = image_format_of(bytes->data, bytes->size);
        if (format == IMAGE_UNKNOWN) {
            result = error_set(&inner, STATUS_ERR_UNSUPPORTED,
                               "is not a PNG, JPEG, WebP, TGA, PFM, Radiance HDR or OpenEXR file: "
                               "convert it");
        } else if (image_format_is_float(format)) {
            struct image_repairs repairs = {0};
            struct image deep = {0};
            result = image_decode_float(&deep, bytes->data, bytes->size, map->file, &repairs, &inner);
            image_release(&deep);
        } else {
            result = image_decode_8(image, bytes->data, bytes->size, map->file, &inner);
        }
    }
    *good = result == STATUS_OK;
    if (result == STATUS_ERR_NO_MEMORY)
        return error_no_memory(o->err, "a texture");
    if (result == STATUS_ERR_FORBIDDEN) {
        o->b->error_is_placed = 1;
        return error_set(o->err, result, "%s:%u: %s", o->files.texts[m->file], map->line, inner.text);
    }
    if (result != STATUS_OK)
        warn_of_texture(o, m, map, inner.text);
    return STATUS_OK;
}

/* One channel of a pixel, 0..1. `image` may be of another size than width x height. */
static float channel(const struct image8 *image, uint32_t x, uint32_t y, uint32_t width, uint32_t height, uint32_t c)
{
    size_t sx = (size_t)x * image->width / width, sy = (size_t)y * image->height / height;
    size_t at = (sy * image->width + sx) * image->channels + c;

    if (image->bits == 16) {
        uint16_t deep;
        memcpy(&deep, image->pixels + 2 * at, sizeof deep);
        return (float)deep / 65535.0f;
    }
    return (float)image->pixels[at] / 255.0f;
}

static int has_alpha(const struct image8 *image) { return image->channels == 2 || image->channels == 4; }

/* The mean of the colours: the value of a map of single numbers. */
static float level(const struct image8 *image, uint32_t x, uint32_t y, uint32_t width, uint32_t height)
{
    if (image->channels <= 2)
        return channel(image, x, y, width, height, 0);
    return (channel(image, x, y, width, height, 0) + channel(image, x, y, width, height, 1) +
            channel(image, x, y, width, height, 2)) /
           3;
}

/* Without any colour it is a height map, not a normal map. */
static int is_grey(const struct image8 *image)
{
    if (image->channels <= 2)
        return 1;
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            float r = channel(image, x, y, image->width, image->height, 0);
            float g = channel(image, x, y, image->width, image->height, 1);
            float b = channel(image, x, y, image->width, image->height, 2);
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

/* Add an image made of pixels that fill(x, y) makes. */
struct bake {
    const struct image8 *a, *b; /* either may be without pixels */
    float bump;
    void (*fill)(const struct bake *bake, uint32_t x, uint32_t y, uint32_t width, uint32_t height, uint8_t rgba[4]);
};

static uint8_t to_byte(float x) { return (uint8_t)(fminf(fmaxf(x, 0), 1) * 255 + 0.5f); }

static status bake_image(struct obj *o, const struct bake *bake, const char *key, const char *name,
                         struct obj_image **out)
{
    uint32_t width = bake->a->width > bake->b->width ? bake->a->width : bake->b->width;
    uint32_t height = bake->a->height > bake->b->height ? bake->a->height : bake->b->height;
    struct image8 rgba = {0};
    struct buffer png = BUFFER_INIT;
    status result = image8_init(&rgba, width, height, 4, 8, o->err);

    for (uint32_t y = 0; y < height && result == STATUS_OK; y++)
        for (uint32_t x = 0; x < width; x++)
            bake->fill(bake, x, y, width, height, rgba.pixels + 4 * ((size_t)y * width + x));
    if (result == STATUS_OK)
        result = png_encode_8(&png, &rgba, 1, o->err);
    image8_release(&rgba);
    if (result == STATUS_OK)
        return keep_image(o, key, name, png.data, png.size, 0, out);
    buffer_release(&png);
    return result;
}

/* The image combined from the files of `a` and `b` (either may have none). */
static status baked_image(struct obj *o, const struct obj_material *m, const char *kind, const struct obj_texture *a,
                          const struct obj_texture *b, struct bake bake, struct obj_image **out)
{
    struct buffer key = BUFFER_INIT, bytes = BUFFER_INIT;
    struct image8 pixels[2] = {{0}, {0}};
    const struct obj_texture *maps[2] = {a, b};
    int good;
    status result = STATUS_OK;

    buffer_printf(&key, "%s %.9g\n%s\n%s", kind, (double)bake.bump, a->file ? a->file : "", b->file ? b->file : "");
    must_hold(&key);
    *out = find_image(o, buffer_text(&key));
    if (*out)
        goto done;
    for (int i = 0; i < 2 && result == STATUS_OK; i++)
        if (maps[i]->file) {
            result = decode_map(o, m, maps[i], &bytes, &pixels[i], &good);
            if (result == STATUS_OK && good && !pixels[i].pixels)
                warn_of_texture(o, m, maps[i],
                                "a floating point image cannot be combined with another, nor be a height map");
            buffer_release(&bytes);
        }
    bake.a = &pixels[0];
    bake.b = &pixels[1];
    if (result == STATUS_OK && (pixels[0].pixels || pixels[1].pixels))
        result = bake_image(o, &bake, buffer_text(&key), a->file ? a->file : b->file, out);
    else if (result == STATUS_OK)
        result = keep_image(o, buffer_text(&key), "", NULL, 0, 0, out);
done:
    image8_release(&pixels[0]);
    image8_release(&pixels[1]);
    buffer_release(&key);
    return result;
}

/* ---- what is put together ------------------------------------------------------------------- */

/* Colours of a, opacity of b: its alpha if it has one, else its level. */
static void fill_alpha(const struct bake *bake, uint32_t x, uint32_t y, uint32_t width, uint32_t height,
                       uint8_t rgba[4])
{
    const struct image8 *a = bake->a, *b = bake->b;

    for (uint32_t c = 0; c < 3; c++)
        rgba[c] = a->pixels ? to_byte(channel(a, x, y, width, height, a->channels <= 2 ? 0 : c)) : 255;
    rgba[3] = !b->pixels     ? 255
              : has_alpha(b) ? to_byte(channel(b, x, y, width, height, b->channels - 1))
                             : to_byte(level(b, x, y, width, height));
}

/* Green: roughness, of a; blue: metal, of b. */
static void fill_metal(const struct bake *bake, uint32_t x, uint32_t y, uint32_t width, uint32_t height,
                       uint8_t rgba[4])
{
    rgba[0] = rgba[3] = 255;
    rgba[1] = bake->a->pixels ? to_byte(level(bake->a, x, y, width, height)) : 255;
    rgba[2] = bake->b->pixels ? to_byte(level(bake->b, x, y, width, height)) : 255;
}

/* The normal of height map a, by central differences that wrap around the edges. */
static void fill_normal(const struct bake *bake, uint32_t x, uint32_t y, uint32_t width, uint32_t height,
                        uint8_t rgba[4])
{
    uint32_t left = x ? x - 1 : width - 1, right = x + 1 < width ? x + 1 : 0;
    uint32_t above = y ? y - 1 : height - 1, below = y + 1 < height ? y + 1 : 0;
    float steep = 0.5f * HEIGHT_TEXELS * bake->bump;
    float du = steep * (level(bake->a, right, y, width, height) - level(bake->a, left, y, width, height));
    float dv = steep * (level(bake->a, x, above, width, height) - level(bake->a, x, below, width, height));
    float length = sqrtf(du * du + dv * dv + 1);

    rgba[0] = to_byte(0.5f - 0.5f * du / length);
    rgba[1] = to_byte(0.5f - 0.5f * dv / length);
    rgba[2] = to_byte(0.5f + 0.5f / length);
    rgba[3] = 255;
}

/* ---- slots ---------------------------------------------------------------------------------- */

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
    /* v upwards, v' = s v + o, seen from the image's top: 1 - v' = s (1 - v) + 1 - s - o. */
    slot->uv_transform[0][0] = map->scale[0];
    slot->uv_transform[0][2] = map->offset[0];
    slot->uv_transform[1][1] = map->scale[1];
    slot->uv_transform[1][2] = 1 - map->scale[1] - map->offset[1];
    return STATUS_OK;
}

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
    struct obj_image *image;

    /* A picture that is both, such as a PNG with alpha, is used unchanged with its own alpha. */
    if (out->alpha_mode == ALPHA_OPAQUE || !d->file)
        return plain_map(o, in, OBJ_MAP_KD, &out->base_color_texture);
    TRY(baked_image(o, in, "alpha", kd, d, (struct bake){.fill = fill_alpha}, &image));
    return fill_slot(o, image, kd->file ? kd : d, &out->base_color_texture);
}

static status metal_maps(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    const struct obj_texture *pr = &in->maps[OBJ_MAP_PR], *pm = &in->maps[OBJ_MAP_PM];
    struct obj_image *image;

    if (!pr->file && !pm->file)
        return STATUS_OK;
    TRY(baked_image(o, in, "metal", pr, pm, (struct bake){.fill = fill_metal}, &image));
    return fill_slot(o, image, pr->file ? pr : pm, &out->metallic_roughness_texture);
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
    if (map == &in->maps[OBJ_MAP_BUMP] && image->is_grey) {
        TRY(baked_image(o, in, "height", map, &none, (struct bake){.fill = fill_normal, .bump = map->bump}, &image));
    } else {
        out->normal_scale = map->bump;
    }
    return fill_slot(o, image, map, &out->normal_texture);
}

status obj_textures(struct obj *o, const struct obj_material *in, struct scene_material *out)
{
    TRY(color_map(o, in, out));
    TRY(plain_map(o, in, OBJ_MAP_KE, &out->emission_texture));
    if (out->specular > 0)
        TRY(plain_map(o, in, OBJ_MAP_KS, &out->specular_color_texture));
    TRY(metal_maps(o, in, out));
    return normal_map(o, in, out);
}
