#include "client/study/against.h"

#include <math.h>

#include "client/study/flip.h"

#define RELATIVE_FLOOR 0.01

static double relative_mse(const struct image *a, const struct image *reference)
{
    const size_t count = (size_t)a->width * a->height * 3;
    double sum = 0;

    for (size_t i = 0; i < count; i++) {
        const double b = (double)reference->pixels[i], d = (double)a->pixels[i] - b;
        sum += d * d / (b * b + RELATIVE_FLOOR);
    }
    return sum / (double)count;
}

static struct study_interval both(double a, double b)
{
    return (struct study_interval){(a + b) / 2, fmin(a, b), fmax(a, b)};
}

status against_reference(struct study_interval *relmse, struct study_interval *flip, const struct shown *shown,
                         const struct image *reference, const struct image *a, const struct image *b, struct error *err)
{
    const struct image *const pictures[2] = {a, b};
    struct image right = {0};
    double flips[2] = {0, 0};
    status result;

    if (reference->width != a->width || reference->height != a->height || reference->channels != 3)
        return error_set(err, STATUS_ERR_INPUT,
                         "the reference has %ux%u pixels, and the study's pictures have %ux%u; give --size %ux%u",
                         reference->width, reference->height, a->width, a->height, reference->width, reference->height);
    result = shown_codes(shown, &right, reference, err);
    for (int i = 0; i < 2 && result == STATUS_OK; i++) {
        struct image codes = {0};
        result = shown_codes(shown, &codes, pictures[i], err);
        THEN(result, flip_mean(&flips[i], &right, &codes, err));
        image_release(&codes);
    }
    image_release(&right);
    *relmse = both(relative_mse(a, reference), relative_mse(b, reference));
    *flip = both(flips[0], flips[1]);
    return result;
}
