#include "client/views/compare.h"

#include <math.h>
#include <string.h>

#include "common/image/color.h"

#define RELATIVE_MSE_FLOOR 0.01

struct sums {
    double square, relative_square, encoded_square;
    double a[3], b[3];
};

static void compare_pixel(const float *a, const float *b, struct comparison *out, struct sums *sums, uint64_t index,
                          uint32_t width)
{
    if (memcmp(a, b, 3 * sizeof *a) != 0)
        out->differing_pixels++;
    for (int c = 0; c < 3; c++) {
        double va = (double)a[c], vb = (double)b[c];
        double difference = fabs(va - vb);
        double larger = fmax(fabs(va), fabs(vb));
        double encoded = (double)srgb_encode(a[c]) - (double)srgb_encode(b[c]);

        sums->a[c] += va;
        sums->b[c] += vb;
        sums->square += difference * difference;
        sums->relative_square += difference * difference / (vb * vb + RELATIVE_MSE_FLOOR);
        sums->encoded_square += encoded * encoded;
        if (difference > out->max_absolute) {
            out->max_absolute = difference;
            out->worst_x = (uint32_t)(index % width);
            out->worst_y = (uint32_t)(index / width);
        }
        if (larger > 0 && difference / larger > out->max_relative)
            out->max_relative = difference / larger;
    }
}

void image_compare(const struct image *a, const struct image *b, struct comparison *out)
{
    struct sums sums = {0};
    double values;

    memset(out, 0, sizeof *out);
    if (a->width != b->width || a->height != b->height || a->channels != 3 || b->channels != 3)
        return;
    out->same_size = 1;
    out->pixels = (uint64_t)a->width * a->height;
    for (uint64_t i = 0; i < out->pixels; i++)
        compare_pixel(a->pixels + 3 * i, b->pixels + 3 * i, out, &sums, i, a->width);
    out->identical = out->differing_pixels == 0;
    values = 3.0 * (double)out->pixels;
    out->mse = sums.square / values;
    out->relative_mse = sums.relative_square / values;
    for (int c = 0; c < 3; c++)
        out->mean_relative[c] = sums.b[c] != 0 ? (sums.a[c] - sums.b[c]) / sums.b[c] : sums.a[c] == 0 ? 0 : NAN;
    out->psnr_db = sums.encoded_square > 0 ? -10 * log10(sums.encoded_square / values) : INFINITY;
}
