/* Pictures that a pbrt scene names: read once. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* ---- pictures ----------------------------------------------------------------------------- */

static status read_image(struct pbrt *p, const char *name, struct pbrt_image *image)
{
    enum image_format format;
    char *path = NULL;
    status result = pbrt_resolve(&p->reader, name, &path, p->err);

    THEN(result, input_files_read(p->b->files, path, PBRT_FILE_BYTES_MAX, &image->bytes, p->err));
    mem_free(path);
    if (result != STATUS_OK)
        return result;
    format = image_format_of(image->bytes.data, image->bytes.size);
    image->is_float = image_format_is_float(format);
    if (format == IMAGE_UNKNOWN)
        return error_set(p->err, STATUS_ERR_UNSUPPORTED,
                         "it has a form that is not read: PNG, JPEG, WebP, EXR, HDR, TGA and PFM are");
    return builder_check_picture(p->b, name, image->bytes.data, image->bytes.size);
}

status pbrt_image(struct pbrt *p, const char *name, const struct pbrt_place *at, struct pbrt_image **out)
{
    struct pbrt_image *image = pbrt_name_find(&p->images, name);
    status result;

    *out = image;
    if (image)
        return STATUS_OK;
    image = must(ARENA_NEW(&p->arena, struct pbrt_image));
    image->row = BUILDER_NO_ROW;
    image->at = *at;
    image->name = pbrt_keep(p, name);
    result = read_image(p, name, image);
    if (result != STATUS_OK) {
        buffer_release(&image->bytes);
        return builder_leave_out(p->b, at->file, at->line, "texture", name, result);
    }
    pbrt_name_set(p, &p->images, name, image);
    *out = image;
    return STATUS_OK;
}

static status decode_8(struct pbrt *p, struct pbrt_image *image, struct image *out)
{
    struct image8 raw = {0};
    status result = image_decode_8(&raw, image->bytes.data, image->bytes.size, image->name, p->err);

    THEN(result, image_init(out, raw.width, raw.height, raw.channels, p->err));
    if (result == STATUS_OK) {
        size_t count = (size_t)raw.width * raw.height * raw.channels;
        image->has_codes = raw.bits == 8;
        for (size_t i = 0; i < count; i++) {
            uint16_t wide;
            memcpy(&wide, raw.pixels + (raw.bits == 16 ? 2 * i : 0), sizeof wide);
            out->pixels[i] = raw.bits == 16 ? (float)wide / 65535 : (float)raw.pixels[i] / 255;
        }
    }
    image8_release(&raw);
    return result;
}

status pbrt_image_decode(struct pbrt *p, struct pbrt_image *image)
{
    struct image_repairs repairs = {0};
    struct buffer borrowed = image->bytes;
    char said[IMAGE_REPAIRS_TEXT];
    status result;

    if (image->pixels.pixels)
        return STATUS_OK;
    if (image->row >= 0) { /* the builder has the bytes */
        const struct import_blob *blob = builder_blob(p->b, &p->b->images[image->row].blob);
        borrowed.data = blob->data;
        borrowed.size = blob->size_bytes;
    }
    {
        struct buffer own = image->bytes;
        image->bytes = borrowed;
        result = image->is_float ? image_decode_hdr(&image->pixels, image->bytes.data, image->bytes.size, image->name,
                                                    &repairs, p->err)
                                 : decode_8(p, image, &image->pixels);
        image->bytes = own;
    }
    if (builder_damage(p->b, result) != STATUS_OK)
        return result;
    if (image_repairs_say(&repairs, said))
        pbrt_warn(p, &image->at, "picture repairs", "%s: %s", image->name, said);
    image->width = image->pixels.width;
    image->height = image->pixels.height;
    image->channels = image->pixels.channels;
    p->image_bytes += (size_t)image->width * image->height * image->channels * sizeof(float);
    if (p->image_bytes > PBRT_IMAGES_BYTES_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &image->at, "computed textures need more than %d MiB of pictures",
                         PBRT_IMAGES_BYTES_MAX >> 20);
    return STATUS_OK;
}

status pbrt_image_row(struct pbrt *p, struct pbrt_image *image, uint32_t *row)
{
    uint8_t *data = image->bytes.data;
    size_t size = image->bytes.size;

    if (image->row < 0) {
        image->bytes = (struct buffer)BUFFER_INIT; /* the builder takes them over */
        TRY(builder_add_image(p->b, file_basename(image->name), data, size, row));
        image->row = *row;
    }
    *row = (uint32_t)image->row;
    return STATUS_OK;
}

void pbrt_image_forget(struct pbrt_image *image)
{
    buffer_release(&image->bytes);
    image_release(&image->pixels);
}

void pbrt_images_trim(struct pbrt *p)
{
    if (p->image_bytes <= PBRT_IMAGES_BYTES_KEPT)
        return;
    for (size_t i = 0; i < p->images.size; i++)
        if (p->images.entries[i].value)
            image_release(&((struct pbrt_image *)p->images.entries[i].value)->pixels);
    p->image_bytes = 0;
}

/* ---- maps of directions ------------------------------------------------------------------- */

/* Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD": the unit square's
 * middle is +z, its corners -z. What depends on the direction's longitude alone. */
struct square_column {
    double phi;  /* from the x axis to the y axis, 0..1, in a quadrant */
    double x, y; /* signs */
};

status pbrt_octahedral_to_latlong(const struct image *square, double y_sign, struct image *out, struct error *err)
{
    enum { SUB = 4, HEIGHT_MIN = 16 }; /* rays along each side of a texel */
    uint32_t n = square->width, height = n > HEIGHT_MIN ? n : HEIGHT_MIN;
    size_t columns, rows;
    struct square_column *column;

    TRY(image_init(out, 2 * height, height, 3, err));
    columns = (size_t)out->width * SUB;
    rows = (size_t)out->height * SUB;
    column = must(mem_alloc_array(columns, sizeof *column));
    for (size_t c = 0; c < columns; c++) { /* u = 0.5 + atan2(z, x) / (2 pi) */
        float sine, cosine;
        det_sincos((float)(2 * PI_D * (((double)c + 0.5) / (double)columns - 0.5)), &sine, &cosine);
        column[c].phi = (double)det_atan2(fabsf(sine), fabsf(cosine)) * (2 / PI_D);
        column[c].x = cosine < 0 ? -1 : 1;
        column[c].y = (sine < 0 ? -1 : 1) * y_sign;
    }
    for (size_t r = 0; r < rows; r++) {
        float sin_t, cos_t;
        double radius;
        det_sincos((float)(PI_D * ((double)r + 0.5) / (double)rows), &sin_t, &cos_t);
        radius = sqrt(fmax(1 - fabs((double)cos_t), 0));
        for (size_t c = 0; c < columns; c++) {
            float *to = out->pixels + ((r / SUB) * out->width + c / SUB) * 3;
            double b = column[c].phi * radius, a = radius - b;
            const float *from;
            size_t x, y;
            if (cos_t < 0) {
                double swap = a;
                a = 1 - b;
                b = 1 - swap;
            }
            x = (size_t)((column[c].x * a + 1) / 2 * n);
            y = (size_t)((column[c].y * b + 1) / 2 * square->height);
            x = x < n ? x : n - 1;
            y = y < square->height ? y : square->height - 1;
            from = square->pixels + (y * n + x) * square->channels;
            for (unsigned i = 0; i < 3; i++)
                to[i] += from[square->channels >= 3 ? i : 0] / (SUB * SUB);
        }
    }
    mem_free(column);
    return STATUS_OK;
}
