/* Pictures that a pbrt scene names: read once, and converted to a format that workers read. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/pbrt/pbrt.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* ---- pictures ----------------------------------------------------------------------------- */

/* Recognise the format; *known is 0 if it is not read. */
static status recognise_image(struct pbrt *p, struct pbrt_image *image, const char *path,
                              int *known)
{
    enum image_format format;

    TRY(builder_rewrite_image(p->b, path, &image->bytes, known, p->err));
    format = image_format_of(image->bytes.data, image->bytes.size);
    image->is_float = format == IMAGE_EXR || format == IMAGE_HDR;
    return STATUS_OK;
}

status pbrt_image(struct pbrt *p, const char *name, const struct pbrt_place *at,
                  struct pbrt_image **out)
{
    struct pbrt_image *image = pbrt_name_find(&p->images, name);
    char *path = NULL;
    int known = 0;
    status result;

    *out = image;
    if (image)
        return STATUS_OK;
    TRY(pbrt_resolve(&p->reader, name, at, &path, p->err));
    image = ARENA_NEW(&p->arena, struct pbrt_image);
    if (!image) {
        mem_free(path);
        return error_no_memory(p->err, "a picture");
    }
    image->row = BUILDER_NO_ROW;
    image->at = *at;
    image->name = pbrt_keep(p, name);
    result = image->name ? input_files_read(p->b->files, path, PBRT_FILE_BYTES_MAX, &image->bytes,
                                           p->err)
                         : error_no_memory(p->err, "a picture");
    if (result == STATUS_OK)
        result = recognise_image(p, image, path, &known);
    mem_free(path);
    if (result == STATUS_OK && known)
        result = pbrt_name_set(p, &p->images, name, image);
    if (result != STATUS_OK || !known)
        buffer_release(&image->bytes);
    if (result != STATUS_OK)
        return result;
    *out = known ? image : NULL;
    if (!known)
        pbrt_warn(p, at, "picture form",
                  "the picture \"%.200s\" has a form that is not read (PNG, JPEG, EXR, HDR, TGA "
                  "and PFM are): left out",
                  name);
    return STATUS_OK;
}

static status decode_8(struct pbrt *p, struct pbrt_image *image, struct image *out)
{
    struct image8 raw = {0};
    status result = image_decode_8(&raw, image->bytes.data, image->bytes.size, image->name, p->err);

    if (result == STATUS_OK)
        result = image_init(out, raw.width, raw.height, raw.channels, p->err);
    if (result == STATUS_OK) {
        size_t count = (size_t)raw.width * raw.height * raw.channels;
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
    const struct import_result *result_so_far = p->b->out;
    struct buffer borrowed = image->bytes;
    status result;

    if (image->pixels.pixels)
        return STATUS_OK;
    if (image->row >= 0) { /* the builder has the bytes */
        const struct digest *digest = &p->b->images[image->row].blob.digest;
        for (size_t i = 0; i < result_so_far->blob_count; i++)
            if (digest_equal(&result_so_far->blobs[i].digest, digest)) {
                borrowed.data = result_so_far->blobs[i].data;
                borrowed.size = result_so_far->blobs[i].size_bytes;
            }
    }
    {
        struct buffer own = image->bytes;
        image->bytes = borrowed;
        result = image->is_float
                     ? image_decode_hdr(&image->pixels, image->bytes.data, image->bytes.size,
                                        image->name, &repairs, p->err)
                     : decode_8(p, image, &image->pixels);
        image->bytes = own;
    }
    if (result != STATUS_OK)
        return result;
    if (repairs.nan_pixels || repairs.infinite_pixels || repairs.negative_pixels)
        pbrt_warn(p, &image->at, "picture repairs",
                  "%s: %llu pixels are not numbers, %llu negative and %llu infinite: they count "
                  "as black, black and the brightest finite value",
                  image->name, (unsigned long long)repairs.nan_pixels,
                  (unsigned long long)repairs.negative_pixels,
                  (unsigned long long)repairs.infinite_pixels);
    image->width = image->pixels.width;
    image->height = image->pixels.height;
    image->channels = image->pixels.channels;
    p->image_bytes += (size_t)image->width * image->height * image->channels * sizeof(float);
    if (p->image_bytes > PBRT_IMAGES_BYTES_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &image->at,
                         "computed textures need more than %d MiB of pictures",
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
 * middle is +z, its corners -z. */
static void sphere_to_square(const double d[3], double *u, double *v)
{
    double x = fabs(d[0]), y = fabs(d[1]), z = fabs(d[2]);
    double r = sqrt(z < 1 ? 1 - z : 0);
    double phi = (double)det_atan2((float)y, (float)x) * (2 / PI_D); /* 0..1 */
    double b = phi * r, a = r - b;

    if (d[2] < 0) {
        double swap = a;
        a = 1 - b;
        b = 1 - swap;
    }
    *u = (copysign(a, d[0]) + 1) / 2;
    *v = (copysign(b, d[1]) + 1) / 2;
}

status pbrt_octahedral_to_latlong(const struct image *square, const double axes[3][3],
                                  struct image *out, struct error *err)
{
    enum { SUB = 4, HEIGHT_MIN = 16 }; /* rays along each side of a texel */
    uint32_t n = square->width, height = n > HEIGHT_MIN ? n : HEIGHT_MIN;
    size_t columns, rows;
    float *sines;

    TRY(image_init(out, 2 * height, height, 3, err));
    columns = (size_t)out->width * SUB;
    rows = (size_t)out->height * SUB;
    sines = mem_alloc_array(columns, 2 * sizeof *sines);
    if (!sines) {
        image_release(out);
        return error_no_memory(err, "an environment map");
    }
    for (size_t c = 0; c < columns; c++) /* u = 0.5 + atan2(z, x) / (2 pi) */
        det_sincos((float)(2 * PI_D * (((double)c + 0.5) / (double)columns - 0.5)),
                   &sines[2 * c], &sines[2 * c + 1]);
    for (size_t r = 0; r < rows; r++) {
        float sin_t, cos_t;
        det_sincos((float)(PI_D * ((double)r + 0.5) / (double)rows), &sin_t, &cos_t);
        for (size_t c = 0; c < columns; c++) {
            float *to = out->pixels + ((r / SUB) * out->width + c / SUB) * 3;
            const double m[3] = {(double)(sin_t * sines[2 * c + 1]), (double)cos_t,
                                 (double)(sin_t * sines[2 * c])};
            const float *from;
            double d[3], u, v;
            size_t x, y;
            for (int i = 0; i < 3; i++)
                d[i] = axes[i][0] * m[0] + axes[i][1] * m[1] + axes[i][2] * m[2];
            sphere_to_square(d, &u, &v);
            x = (size_t)(u * n);
            y = (size_t)(v * square->height);
            x = x < n ? x : n - 1;
            y = y < square->height ? y : square->height - 1;
            from = square->pixels + (y * n + x) * square->channels;
            for (unsigned i = 0; i < 3; i++)
                to[i] += from[square->channels >= 3 ? i : 0] / (SUB * SUB);
        }
    }
    mem_free(sines);
    return STATUS_OK;
}
