#include "tests/support/denoise_toys.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"

static float *picture_of(const struct toy *toy)
{
    float *picture = mem_calloc((size_t)toy->width * toy->height * 3, sizeof(float));

    if (!picture)
        abort();
    return picture;
}

/* Left, stripes of growing frequency; right, a slope with a square; a disc in the middle. */
static void pixel_of(const struct toy *toy, uint32_t x, uint32_t y, float *truth, float *albedo, float *normal)
{
    const double u = (x + 0.5) / 96, v = (y + 0.5) / 96, du = fmod(u, 1) - 0.5, dv = fmod(v, 1) - 0.5;
    const double tint[3] = {1, 0.8, 0.6};
    double light = 0.3 + 0.4 * fmod(v, 1), paint = 0.8;

    (void)toy;
    normal[2] = 1;
    if (fmod(u, 1) < 0.4)
        paint = 0.5 + 0.3 * sin(2 * 3.14159265358979 * (4 + 12 * fmod(v, 1)) * fmod(u, 1) * 2);
    else if (du > 0.25 && dv > 0.2)
        paint = 0.15;
    if (du * du + dv * dv < 0.03) {
        paint = 0.6;
        normal[0] = (float)(du / 0.18);
        normal[1] = (float)(dv / 0.18);
        normal[2] = (float)sqrt(fmax(0, 1 - (du * du + dv * dv) / 0.0324));
        light = 0.2 + 0.8 * (double)normal[2] * (double)normal[2];
    }
    if (fabs(du - dv * 0.3 + 0.1) < 0.02) /* a shadow that features do not know */
        light *= 0.3;
    for (int c = 0; c < 3; c++) {
        albedo[c] = (float)(paint * tint[c]);
        truth[c] = (float)(light * paint * tint[c]);
    }
}

void toy_make(struct toy *toy, uint32_t width, uint32_t height, int features)
{
    *toy = (struct toy){.width = width, .height = height};
    toy->truth = picture_of(toy);
    toy->albedo = picture_of(toy);
    toy->normal = picture_of(toy);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const size_t p = ((size_t)y * width + x) * 3;
            pixel_of(toy, x, y, toy->truth + p, toy->albedo + p, toy->normal + p);
        }
    if (features)
        return;
    mem_free(toy->albedo);
    mem_free(toy->normal);
    toy->albedo = toy->normal = NULL;
}

void toy_release(struct toy *toy)
{
    mem_free(toy->truth);
    mem_free(toy->albedo);
    mem_free(toy->normal);
    memset(toy, 0, sizeof *toy);
}

static uint64_t next(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15ull);

    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
}

static double uniform(uint64_t *state) { return ((double)(next(state) >> 11) + 0.5) * 0x1p-53; }

static double sample_of(enum toy_noise noise, uint64_t *state)
{
    const double chance = noise == TOY_SPIKY_TENTH ? 0.1 : 0.01;
    double light = -log(uniform(state));

    if (noise == TOY_EXPONENTIAL)
        return light;
    return light * (uniform(state) < chance ? 0.5 / chance : 0.5 / (1 - chance));
}

void toy_sample(struct toy_groups *groups, const struct toy *toy, enum toy_noise noise, uint32_t samples, uint64_t seed)
{
    memset(groups, 0, sizeof *groups);
    groups->input.width = toy->width;
    groups->input.height = toy->height;
    for (int g = 0; g < 2; g++) {
        uint64_t state = seed * 2 + (uint64_t)g;
        groups->groups[g] = picture_of(toy);
        groups->input.groups[g] = groups->groups[g];
        groups->input.albedo[g] = toy->albedo;
        groups->input.normal[g] = toy->normal;
        state = next(&state);
        for (size_t p = 0; p < (size_t)toy->width * toy->height; p++) {
            double sum = 0; /* all channels alike, as most of a path tracer's noise */
            for (uint32_t i = 0; i < samples; i++)
                sum += sample_of(noise, &state) / samples;
            for (size_t c = 0; c < 3; c++)
                groups->groups[g][p * 3 + c] = toy->truth[p * 3 + c] * (float)sum;
        }
    }
}

void toy_groups_release(struct toy_groups *groups)
{
    mem_free(groups->groups[0]);
    mem_free(groups->groups[1]);
    memset(groups, 0, sizeof *groups);
}

double toy_error(const struct toy *toy, const float *picture)
{
    const size_t values = (size_t)toy->width * toy->height * 3;
    double sum = 0;

    for (size_t i = 0; i < values; i++)
        sum += ((double)picture[i] - (double)toy->truth[i]) * ((double)picture[i] - (double)toy->truth[i]);
    return sum / (double)values;
}
