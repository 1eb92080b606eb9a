#include "common/image/image.h"

#include <string.h>

#include "common/base/memory.h"

#define GIB 1073741824.0

/* Sides and the whole against their limits; *bytes is the size of the pixels. */
static status check_size(uint32_t width, uint32_t height, uint32_t channels, size_t value_bytes, size_t *bytes,
                         struct error *err)
{
    size_t total;

    *bytes = 0;
    if (channels < 1 || channels > 4)
        return error_set(err, STATUS_ERR_INTERNAL, "an image of %u channels", (unsigned)channels);
    if (width == 0 || height == 0)
        return error_set(err, STATUS_ERR_INPUT, "the picture is empty (%u x %u pixels)", (unsigned)width,
                         (unsigned)height);
    if (width > IMAGE_SIDE_MAX || height > IMAGE_SIDE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u x %u pixels: no side may be longer than %d; make it smaller",
                         (unsigned)width, (unsigned)height, (int)IMAGE_SIDE_MAX);
    /* No side above 2^17: far from overflow. */
    total = (size_t)width * height * channels * value_bytes;
    if (total > IMAGE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%u x %u pixels: it needs %.1f GiB of memory, more than the limit of %.1f "
                         "GiB; make the picture smaller",
                         (unsigned)width, (unsigned)height, (double)total / GIB, (double)IMAGE_BYTES_MAX / GIB);
    *bytes = total;
    return STATUS_OK;
}

static status no_memory_for(uint32_t width, uint32_t height, size_t bytes, struct error *err)
{
    int large = (double)bytes >= GIB;

    return error_set(err, STATUS_ERR_NO_MEMORY,
                     "out of memory: its %u x %u pixels need %.1f %s; make the picture smaller", (unsigned)width,
                     (unsigned)height, (double)bytes / (large ? GIB : 1048576.0), large ? "GiB" : "MiB");
}

status image_init(struct image *image, uint32_t width, uint32_t height, uint32_t channels, struct error *err)
{
    size_t bytes;

    memset(image, 0, sizeof *image);
    TRY(check_size(width, height, channels, sizeof(float), &bytes, err));
    image->pixels = mem_calloc(bytes / sizeof(float), sizeof(float));
    if (!image->pixels)
        return no_memory_for(width, height, bytes, err);
    mem_advise_large_pages(image->pixels, bytes);
    image->width = width;
    image->height = height;
    image->channels = channels;
    return STATUS_OK;
}

void image_release(struct image *image)
{
    mem_free(image->pixels);
    memset(image, 0, sizeof *image);
}

/* Each of `count` values is the mean of `terms` values that are `step` floats apart. */
static void means_of(float *to, const float *from, size_t count, size_t step, size_t terms)
{
    enum { AT_ONCE = 64 };

    for (size_t i = 0; i < count; i += AT_ONCE) {
        double sums[AT_ONCE] = {0};
        size_t here = count - i < AT_ONCE ? count - i : AT_ONCE;
        for (size_t k = 0; k < terms; k++)
            for (size_t c = 0; c < here; c++)
                sums[c] += (double)from[i + k * step + c];
        for (size_t c = 0; c < here; c++)
            to[i + c] = (float)(sums[c] / (double)terms);
    }
}

/* Along a dimension of `count` parts, each of `size` floats: the means over the parts up to `radius` away. */
static void smooth_parts(float *to, const float *from, size_t count, size_t size, size_t radius)
{
    for (size_t i = 0; i < count;) {
        size_t first = i > radius ? i - radius : 0, last = radius < count - i ? i + radius : count - 1;
        size_t alike = i >= radius && count - i > radius ? count - radius - i : 1; /* with as many around them */
        means_of(to + i * size, from + first * size, alike * size, size, last - first + 1);
        i += alike;
    }
}

status image_smooth(struct image *image, uint32_t radius, struct error *err)
{
    size_t line = (size_t)image->width * image->channels;
    float *rows = mem_alloc_array(line * image->height, sizeof *rows);

    if (!rows)
        return error_no_memory(err, "a smoothed picture");
    for (size_t y = 0; y < image->height; y++)
        smooth_parts(rows + y * line, image->pixels + y * line, image->width, image->channels, radius);
    smooth_parts(image->pixels, rows, image->height, line, radius);
    mem_free(rows);
    return STATUS_OK;
}

status image8_init(struct image8 *image, uint32_t width, uint32_t height, uint32_t channels, uint32_t bits,
                   struct error *err)
{
    size_t bytes;

    memset(image, 0, sizeof *image);
    TRY(check_size(width, height, channels, bits / 8, &bytes, err));
    image->pixels = mem_calloc(bytes, 1);
    if (!image->pixels)
        return no_memory_for(width, height, bytes, err);
    mem_advise_large_pages(image->pixels, bytes);
    image->width = width;
    image->height = height;
    image->channels = channels;
    image->bits = bits;
    return STATUS_OK;
}

void image8_release(struct image8 *image)
{
    mem_free(image->pixels);
    memset(image, 0, sizeof *image);
}
