#include <string.h>

#include "client/farm/owners.h"
#include "client/terminal/must.h"
#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/film/tiles.h"

enum {
    SIDE_WANTED = 512,           /* pixels of the longer side, unless a scale is chosen */
    EMPTY_GREY = 24,             /* of tiles that have no samples */
};
static const double line_share = 0.7;    /* of a tile's colour, along its upper and left edge */
static const double over_opacity = 0.45; /* of the tiles' colours over the frame's picture */

static uint32_t scale_for(const struct owners *o)
{
    uint32_t side = o->map->width > o->map->height ? o->map->width : o->map->height;

    return side >= SIDE_WANTED ? 1 : SIDE_WANTED / side;
}

static uint8_t picture_code(const struct image8 *picture, uint32_t x, uint32_t y, int channel)
{
    size_t at = ((size_t)y * picture->width + x) * picture->channels + (size_t)channel;
    uint16_t wide;

    if (picture->bits == 8)
        return picture->pixels[at];
    memcpy(&wide, picture->pixels + 2 * at, sizeof wide);
    return (uint8_t)(wide >> 8);
}

static void paint_tile(struct image8 *out, const struct owners *o, uint32_t tile, uint32_t scale,
                       const struct image8 *over)
{
    struct tile_rect rect = tile_rect_of(o->map->width, o->map->height, tile);
    uint32_t thread;
    const struct owners_worker *owner = owners_of_tile(o, tile, &thread);
    uint8_t color[3] = {EMPTY_GREY, EMPTY_GREY, EMPTY_GREY};

    if (owner)
        owners_thread_color(owner, thread, color);
    for (uint32_t y = rect.y * scale; y < (rect.y + rect.height) * scale; y++)
        for (uint32_t x = rect.x * scale; x < (rect.x + rect.width) * scale; x++) {
            int line = (x == rect.x * scale && x > 0) || (y == rect.y * scale && y > 0);
            uint8_t *pixel = out->pixels + ((size_t)y * out->width + x) * 3;
            for (int c = 0; c < 3; c++) {
                double value = color[c] * (line ? line_share : 1);
                if (over)
                    value = over_opacity * value + (1 - over_opacity) * picture_code(over, x / scale, y / scale, c);
                pixel[c] = (uint8_t)(value + 0.5);
            }
        }
}

status owners_picture(struct image8 *out, const struct owners *o, uint32_t scale, const struct image8 *over,
                      struct error *err)
{
    status result;

    if (over && (over->width != o->map->width || over->height != o->map->height || over->channels < 3))
        return error_set(err, STATUS_ERR_PROTOCOL, "the frame's picture has %u x %u pixels, but its tiles %u x %u",
                         over->width, over->height, o->map->width, o->map->height);
    if (scale == 0)
        scale = scale_for(o);
    if ((uint64_t)o->map->width * scale > IMAGE_SIDE_MAX || (uint64_t)o->map->height * scale > IMAGE_SIDE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "--scale %u: %u x %u pixels are more than %d a side", scale,
                         o->map->width, o->map->height, IMAGE_SIDE_MAX);
    result = image8_init(out, o->map->width * scale, o->map->height * scale, 3, 8, err);
    for (uint32_t i = 0; i < o->map->n_tiles && result == STATUS_OK; i++)
        paint_tile(out, o, i, scale, over);
    return result;
}

/* ---- files ----------------------------------------------------------------------------------- */

static int ends_in(const char *path, const char *extension)
{
    size_t length = strlen(path), tail = strlen(extension);

    return length > tail && strcmp(path + length - tail, extension) == 0;
}

int owners_path_is_json(const char *path) { return ends_in(path, ".json"); }

status owners_path_check(const char *path, struct error *err)
{
    if (strcmp(path, "-") == 0 || ends_in(path, ".png") || ends_in(path, ".json"))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE, "%s: must end in .png (the tiles' colours) or .json (the tiles)", path);
}

static status encode_picture(struct buffer *out, const struct owners *o, uint32_t scale, const struct image8 *over,
                             struct error *err)
{
    struct image8 image = {0};
    status result = owners_picture(&image, o, scale, over, err);

    if (result == STATUS_OK)
        result = png_encode_8(out, &image, 0, err);
    image8_release(&image);
    return result;
}

static void encode_json(struct buffer *out, const struct owners *o)
{
    json_t *json = owners_json(o);

    json_write(out, json);
    buffer_puts(out, "\n");
    must_hold(out);
    json_decref(json);
}

status owners_write(const struct owners *o, const char *path, uint32_t scale, const struct image8 *over,
                    struct error *err)
{
    struct buffer file = BUFFER_INIT;
    status result = STATUS_OK;

    if (owners_path_is_json(path))
        encode_json(&file, o);
    else
        result = encode_picture(&file, o, scale, over, err);
    if (result == STATUS_OK && strcmp(path, "-") == 0)
        fwrite(file.data, 1, file.size, stdout);
    else if (result == STATUS_OK)
        result = file_write_atomic(path, file.data, file.size, err);
    buffer_release(&file);
    return result;
}
