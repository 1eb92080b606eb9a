#include "tests/support/tonemap_pictures.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "common/base/memory.h"

struct tonemap_settings tonemap_preset(const char *name)
{
    struct tonemap_settings s;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&s, name, &err), STATUS_OK);
    return s;
}

void tonemap_preset_set(struct tonemap_settings *s, const char *parameter, double value)
{
    struct error err = {0};

    assert_int_equal(tonemap_settings_set(s, parameter, value, &err), STATUS_OK);
}

struct image picture_grey(uint32_t width, uint32_t height, float value)
{
    struct image image;

    assert_int_equal(image_init(&image, width, height, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        image.pixels[i] = value;
    return image;
}

void picture_put(struct image *image, size_t x, size_t y, float value)
{
    for (size_t c = 0; c < 3; c++)
        image->pixels[(y * image->width + x) * 3 + c] = value;
}

struct image picture_stripes(const float *greys, size_t count)
{
    struct image image = picture_grey((uint32_t)count * PICTURE_STRIPE, 1, NAN);

    for (size_t x = 0; x < image.width; x++)
        if (x % PICTURE_STRIPE < 9)
            picture_put(&image, x, 0, greys[x / PICTURE_STRIPE]);
    return image;
}

/* NAN: not finite. */
static double luminance_at(const struct image *in, size_t x, size_t y)
{
    const float *p = in->pixels + (y * in->width + x) * 3;

    if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
        return (double)NAN;
    return 0.212656 * fmax((double)p[0], 0) + 0.715158 * fmax((double)p[1], 0) + 0.072186 * fmax((double)p[2], 0);
}

/* The mean of the 9x9 pixels around (x, y), of those of `values` that are a number; of their logarithms: of those that have
 * one. */
static double mean_around(const struct image *in, const double *values, size_t x, size_t y, int logs)
{
    double sum = 0, count = 0;

    for (size_t v = y < 4 ? 0 : y - 4; v <= y + 4 && v < in->height; v++)
        for (size_t u = x < 4 ? 0 : x - 4; u <= x + 4 && u < in->width; u++) {
            const double value = values[v * in->width + u];

            if (isnan(value) || (logs && value == 0))
                continue;
            sum += logs ? log(value) : value;
            count++;
        }
    return sum / count;
}

double picture_log_mean(const struct image *in)
{
    const size_t count = (size_t)in->width * in->height;
    double *values = mem_alloc_array(count, sizeof *values), *limited = mem_alloc_array(count, sizeof *limited);
    double sum = 0, lit = 0;

    assert_non_null(values);
    assert_non_null(limited);
    for (size_t i = 0; i < count; i++)
        values[i] = limited[i] = luminance_at(in, i % in->width, i / in->width);
    for (size_t i = 0; i < count; i++)
        if (values[i] > 0)
            limited[i] = fmin(values[i], 64 * exp(mean_around(in, values, i % in->width, i / in->width, 1)));
    for (size_t i = 0; i < count; i++)
        if (values[i] > 0) {
            sum += log(mean_around(in, limited, i % in->width, i / in->width, 0));
            lit++;
        }
    mem_free(values);
    mem_free(limited);
    return exp(sum / lit);
}

struct image picture_light_threads(const struct image *in, const struct tonemap_settings *s, unsigned threads)
{
    struct tonemap_context context = {.threads = threads, .linear = 1};
    struct image out;
    struct error err = {0};

    assert_int_equal(tonemap_apply(&out, in, s, &context, &err), STATUS_OK);
    for (size_t i = 0; i < (size_t)out.width * out.height * 3; i++)
        assert_true(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f); /* false for NaN */
    return out;
}

struct image picture_light(const struct image *in, const struct tonemap_settings *s)
{
    return picture_light_threads(in, s, 1);
}

float picture_at(const struct image *image, size_t x, size_t y) { return image->pixels[(y * image->width + x) * 3]; }

struct image picture_hard(uint32_t width, uint32_t height)
{
    struct image image = picture_grey(width, height, 0.0f);
    uint32_t random = 12345;

    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++) {
            double level = x > width / 3 ? 1.0 : 0.01;

            level *= (y > height / 2) == (x > width / 2) ? 30.0 : 0.5;
            level *= 0.2 + (double)x / width;
            for (size_t c = 0; c < 3; c++) {
                random = random * 1664525u + 1013904223u;
                image.pixels[(y * width + x) * 3 + c] =
                    (float)(level * (0.8 + 0.4 * (double)(random >> 8) / (1 << 24)));
            }
        }
    picture_put(&image, width / 2, height / 3, 0.0f);
    return image;
}

void picture_threads_agree(struct image *in, const struct tonemap_settings *s)
{
    struct image a = picture_light_threads(in, s, 1), b = picture_light_threads(in, s, 3);

    assert_memory_equal(a.pixels, b.pixels, (size_t)a.width * a.height * 3 * sizeof *a.pixels);
    image_release(in);
    image_release(&a);
    image_release(&b);
}

int picture_out_of_memory(struct image *in, const struct tonemap_settings *s)
{
    enum { MOST = 1000 };
    struct tonemap_context context = {.threads = 1};
    struct image out;

    for (int failures = 0; failures < MOST; failures++) {
        struct error err = {0};
        status st;

        mem_fault_arm(failures, 1);
        st = tonemap_apply(&out, in, s, &context, &err);
        mem_fault_arm(-1, 0);
        if (st == STATUS_OK) {
            image_release(&out);
            image_release(in);
            return failures;
        }
        assert_int_equal(st, STATUS_ERR_NO_MEMORY);
    }
    fail_msg("out of memory with %d allocations", (int)MOST);
    return MOST;
}
