/* builder: images and the environment map. All are measured by their headers before anything is decoded. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/builder/builder.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/image/image_size.h"

/* ---- images ------------------------------------------------------------------------------- */

status builder_check_pixels(struct builder *b, const char *name, uint64_t width, uint64_t height)
{
    const uint64_t million = 1000000, limit = (uint64_t)b->options->image_megapixels * million;

    if (height == 0 || width <= limit / height)
        return STATUS_OK;
    return error_set(b->err, STATUS_ERR_LIMIT,
                     "%.200s: the image has %llu x %llu pixels, more than %llu million: make it "
                     "smaller, or raise the limit with --max-image %.0f",
                     name, (unsigned long long)width, (unsigned long long)height,
                     (unsigned long long)b->options->image_megapixels,
                     ceil((double)width * (double)height / (double)million));
}

status builder_check_image(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes)
{
    struct image_size size;

    if (!image_size_of(data, size_bytes, &size))
        return STATUS_OK;
    return builder_check_pixels(b, name, size.width, size.height);
}

/* Add an image's size to the total, and check the limit. */
static status count_image(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes)
{
    const double gib = 1024.0 * 1024 * 1024;
    struct image_size size;

    if (!image_size_of(data, size_bytes, &size))
        return STATUS_OK;
    b->images_bytes += (uint64_t)size.width * size.height * size.pixel_bytes;
    if (b->images_bytes <= b->options->images_bytes)
        return STATUS_OK;
    return error_set(b->err, STATUS_ERR_LIMIT,
                     "%.200s: with it the scene's images take %.1f GiB when decoded, more than "
                     "%.1f GiB: make them smaller, or raise the limit with --max-image-memory",
                     name, (double)b->images_bytes / gib, (double)b->options->images_bytes / gib);
}

/* Decoded once, to report its faults now and not on a worker. */
static status decode_once(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes,
                          struct image *out)
{
    struct image_repairs repairs = {0};
    char said[IMAGE_REPAIRS_TEXT];

    TRY(image_decode_hdr(out, data, size_bytes, name, &repairs, b->err));
    if (image_repairs_say(&repairs, said))
        builder_warn(b, "picture repairs", "%s: %s", name, said);
    return STATUS_OK;
}

status builder_check_picture(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes)
{
    struct image deep = {0};
    struct image8 flat = {0};
    status result;

    TRY(builder_check_image(b, name, data, size_bytes));
    if (!b->decodes_pictures)
        return STATUS_OK;
    if (image_format_is_float(image_format_of(data, size_bytes)))
        result = image_decode_float(&deep, data, size_bytes, name, NULL, b->err);
    else
        result = image_decode_8(&flat, data, size_bytes, name, b->err);
    image_release(&deep);
    image8_release(&flat);
    return result;
}

status builder_add_image(struct builder *b, const char *name, uint8_t *data, size_t size_bytes, uint32_t *row)
{
    struct scene_image image = {.name = builder_name(b, name)};
    struct image pixels = {0};
    size_t before = b->out->blob_count;
    status result = builder_check_image(b, image.name, data, size_bytes);

    if (result == STATUS_OK && image_format_of(data, size_bytes) == IMAGE_HDR)
        result = builder_damage(b, decode_once(b, image.name, data, size_bytes, &pixels));
    image_release(&pixels);
    if (result != STATUS_OK)
        mem_free(data);
    else
        result = builder_add_blob(b, data, size_bytes, &image.blob);
    if (result == STATUS_OK && b->out->blob_count > before)
        result = count_image(b, image.name, data, size_bytes);

    if (result != STATUS_OK)
        return result;
    return builder_add_image_row(b, &image, row);
}

status builder_leave_out(struct builder *b, const char *file, uint64_t line, const char *kind, const char *name, status why)
{
    char one[300];

    if (b->options->strict || (why != STATUS_ERR_INPUT && why != STATUS_ERR_UNSUPPORTED)) {
        if (line && why != STATUS_ERR_NO_MEMORY && !b->error_is_placed) {
            error_prefix(b->err, "%s:%llu", file, (unsigned long long)line);
            b->error_is_placed = 1;
        }
        return why;
    }
    snprintf(one, sizeof one, "%s %.200s", kind, name);
    builder_warn_at(b, file, line, one, "the %s \"%.200s\" cannot be used (%.250s): left out", kind, name, b->err->text);
    *b->err = (struct error){0};
    return STATUS_OK;
}

/* ---- the environment ---------------------------------------------------------------------- */

/* The number of pixels above SCENE_RADIANCE_MAX. The environment's largest value is at most that. */
static uint64_t look_at_map(const struct image *image, struct scene_environment *environment)
{
    float brightest = 0;
    uint64_t count = 0;

    environment->varies = 0;
    for (size_t i = 0; i < (size_t)image->width * image->height; i++) {
        const float *p = image->pixels + 3 * i, most = fmaxf(p[0], fmaxf(p[1], p[2]));
        count += most > SCENE_RADIANCE_MAX;
        brightest = fmaxf(brightest, most);
        environment->varies |= memcmp(p, image->pixels, 3 * sizeof *p) != 0;
    }
    environment->brightest = fminf(brightest, SCENE_RADIANCE_MAX);
    return count;
}

/* A map whose data window is a part of its display window is a part of the sky: it becomes a file of the whole, black
 * around it. */
static status make_whole(struct builder *b, const char *name, const struct image_size *part, struct image *map,
                         uint8_t **data, size_t *size_bytes)
{
    struct image whole;
    struct buffer file = BUFFER_INIT;
    status result;

    builder_warn(b, "environment window",
                 "%s: the map has %ux%u pixels of a picture of %ux%u, from column %u, row %u: the rest of the sky is black",
                 name, part->width, part->height, part->whole_width, part->whole_height, part->x, part->y);
    TRY(builder_check_pixels(b, name, part->whole_width, part->whole_height));
    TRY(image_init(&whole, part->whole_width, part->whole_height, 3, b->err));
    for (uint32_t y = 0; y < map->height; y++)
        memcpy(whole.pixels + 3 * ((size_t)(part->y + y) * whole.width + part->x),
               map->pixels + 3 * (size_t)y * map->width, 3 * sizeof *map->pixels * map->width);
    image_release(map);
    *map = whole;
    result = exr_encode(&file, map, &(struct exr_options){0}, b->err);
    if (result != STATUS_OK) {
        buffer_release(&file);
        return result;
    }
    mem_free(*data);
    *data = file.data;
    *size_bytes = file.size;
    return STATUS_OK;
}

static status check_environment(struct builder *b, const char *name, uint8_t **data, size_t *size_bytes)
{
    struct image image = {0};
    struct image_size size;
    uint64_t too_bright;
    status result;

    if (!image_format_is_float(image_format_of(*data, *size_bytes)))
        return error_set(b->err, STATUS_ERR_INPUT,
                         "%s: is not an environment map: give an OpenEXR (.exr) or Radiance "
                         "(.hdr) file in latitude-longitude form",
                         name);
    TRY(builder_check_image(b, name, *data, *size_bytes));
    TRY(decode_once(b, name, *data, *size_bytes, &image));
    result = image_size_of(*data, *size_bytes, &size) && size.whole_width && size.width == image.width &&
                     size.height == image.height
                 ? make_whole(b, name, &size, &image, data, size_bytes)
                 : STATUS_OK;
    if (result != STATUS_OK) {
        image_release(&image);
        return result;
    }
    too_bright = look_at_map(&image, &b->environment);
    if (too_bright)
        builder_warn(b, "environment radiance", "%s: the map has %llu pixels above %g: they count as that", name,
                     (unsigned long long)too_bright, (double)SCENE_RADIANCE_MAX);
    if (image.width != 2 * image.height)
        builder_warn(b, "environment shape",
                     "%s: the map is %ux%u: a latitude-longitude map is twice as wide as high, "
                     "this one will look stretched",
                     name, image.width, image.height);
    image_release(&image);
    return STATUS_OK;
}

status builder_set_environment_map(struct builder *b, const char *name, uint8_t *data, size_t size_bytes)
{
    status result = check_environment(b, name, &data, &size_bytes);

    if (result != STATUS_OK) {
        b->error_is_placed = 1;
        mem_free(data);
        return result;
    }
    b->environment.present = 1;
    b->environment.constant = 0;
    b->environment.image.name = builder_name(b, file_basename(name));
    return builder_add_blob(b, data, size_bytes, &b->environment.image.blob);
}

/* The user's map replaces the file's. */
status builder_read_environment(struct builder *b, const char *path)
{
    struct buffer bytes = BUFFER_INIT;
    status result = file_read(path, IMPORT_FILE_BYTES_MAX, &bytes, b->err);

    THEN(result, input_files_add(b->files, path, bytes.size, b->err));
    if (result != STATUS_OK) {
        b->error_is_placed = 1;
        buffer_release(&bytes);
        return result;
    }
    scene_environment_default(&b->environment);
    return builder_set_environment_map(b, path, bytes.data, bytes.size);
}
