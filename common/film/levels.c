#include "common/film/levels.h"

#include <math.h>
#include <string.h>

#include "common/film/tiles.h"
#include "common/image/color.h"
#include "common/math/elementary.h"

/* What a doubling leaves of the variance where samples are independent; a stratified sequence leaves less. */
#define SHARE_MAX 0.5

/* The upper ends of an octave's quarters, but the last: the mantissa bits of 2^(1/4), 2^(1/2) and 2^(3/4). */
enum { QUARTER_1 = 0x1837f0, QUARTER_2 = 0x3504f3, QUARTER_3 = 0x5744fd, MANTISSA = 0x7fffff };
/* The exponent of 2^-5, the first bin's and the first spread's. */
enum { OCTAVE_FIRST = 127 - 5 };

static inline uint32_t bin_of(float codes)
{
    uint32_t bits = float_bits(codes), bin;

    if (!(codes >= 0x1p-5f)) /* NaN too */
        return 0;
    bin = 2 * ((bits >> 23) - OCTAVE_FIRST) + ((bits & MANTISSA) >= QUARTER_2);
    return bin < LEVEL_BINS ? bin : LEVEL_BINS - 1;
}

uint32_t level_bin(float codes) { return bin_of(codes); }

static inline float spread_at(uint32_t i)
{
    uint32_t quarter = i % 4;
    uint32_t mantissa = (quarter == 1 ? QUARTER_1 : 0) | (quarter == 2 ? QUARTER_2 : 0) | (quarter == 3 ? QUARTER_3 : 0);

    return float_from_bits((OCTAVE_FIRST + i / 4) << 23 | mantissa);
}

float level_spread(uint32_t i) { return spread_at(i); }

/* ---- one pixel's errors --------------------------------------------------------------------- */

static float largest_of(const float *three)
{
    float largest = 0;

    for (int c = 0; c < 3; c++)
        largest = three[c] > largest ? three[c] : largest;
    return largest;
}

static void measure_codes(struct film_level *out, const float *first, const float *second, uint32_t pixels)
{
    float squares[TILE_PIXELS_MAX * 3];
    double sum = 0;

    for (uint32_t i = 0; i < pixels * 3; i++) {
        float half = (first[i] - second[i]) / 2;
        squares[i] = half * half;
    }
    for (uint32_t i = 0; i < pixels; i++) {
        float squared = largest_of(squares + i * 3);
        sum += (double)squared;
        out->bins[bin_of(sqrtf(squared))]++;
    }
    out->display = (float)sum;
}

/* ---- what would be reported ----------------------------------------------------------------- */

enum { PADDED = TILE_SIZE + 2 }; /* a tile's line with a neighbour at both ends */

/* The squared errors of both sides: of each pixel half of the largest channel's, into squares[line + 1][column + 1]
 * with zeros around them; of all channels half of the sum, into out->channels. */
static void add_sides(struct film_level *out, const float *first, const float *second, const float *mean,
                      uint32_t width, uint32_t height, float squares[PADDED][PADDED])
{
    float one[TILE_PIXELS_MAX * 3], other[TILE_PIXELS_MAX * 3];
    double ones = 0, others = 0;

    for (uint32_t i = 0; i < width * height * 3; i++) {
        float a = first[i] - mean[i], b = second[i] - mean[i];
        one[i] = a * a;
        other[i] = b * b;
    }
    for (uint32_t i = 0; i < width * height * 3; i++) {
        ones += (double)one[i];
        others += (double)other[i];
    }
    out->channels = (float)((ones + others) / 2);
    memset(squares, 0, PADDED * sizeof *squares);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            uint32_t i = (y * width + x) * 3;
            squares[y + 1][x + 1] = largest_of(one + i) / 2 + largest_of(other + i) / 2;
        }
}

/* The mean of a pixel's square and those around it, in the order of lines. */
static void means_around(float squares[PADDED][PADDED], uint32_t width, uint32_t height, float *means)
{
    for (uint32_t y = 0; y < height; y++) {
        float lines = (float)(1 + (y > 0) + (y + 1 < height)), sums[TILE_SIZE] = {0};
        for (uint32_t v = y; v <= y + 2; v++)
            for (uint32_t u = 0; u <= 2; u++)
                for (uint32_t x = 0; x < TILE_SIZE; x++) /* a whole line, for vector units */
                    sums[x] += squares[v][x + u];
        for (uint32_t x = 0; x < width; x++)
            means[y * width + x] = sums[x] / (lines * (float)(1 + (x > 0) + (x + 1 < width)));
    }
}

/* Divide each pixel between its two places: a whole count at the nearest would be off by up to 9 %. */
static void count_spreads(uint16_t *spreads, const float *variances, uint32_t pixels)
{
    enum { NONE = LEVEL_SPREADS }; /* too small */
    uint32_t low_at[TILE_PIXELS_MAX], above[TILE_PIXELS_MAX];
    uint16_t counts[LEVEL_SPREADS + 2] = {0};

    for (uint32_t k = 0; k < pixels; k++) {
        float deviation = sqrtf(variances[k]), low, high, share;
        uint32_t bits = float_bits(deviation), mantissa = bits & MANTISSA;
        uint32_t i = ((bits >> 23) - OCTAVE_FIRST) * 4 + (mantissa >= QUARTER_1) + (mantissa >= QUARTER_2) +
                     (mantissa >= QUARTER_3);
        i = i < LEVEL_SPREADS - 2 ? i : LEVEL_SPREADS - 2;
        low = spread_at(i);
        high = spread_at(i + 1);
        share = deviation < high ? (deviation - low) / (high - low) : 1;
        above[k] = (uint32_t)(int32_t)(share * LEVEL_SPREAD_ONE + 0.5f);
        low_at[k] = deviation >= spread_at(0) ? i : NONE;
    }
    for (uint32_t k = 0; k < pixels; k++) {
        counts[low_at[k]] = (uint16_t)(counts[low_at[k]] + LEVEL_SPREAD_ONE - above[k]);
        counts[low_at[k] + 1] = (uint16_t)(counts[low_at[k] + 1] + above[k]);
    }
    memcpy(spreads, counts, LEVEL_SPREADS * sizeof *spreads);
}

/* `first` and `second`: the codes of the halves, that is of the mean plus and minus half of their difference. */
static void measure_spreads(struct film_level *out, const float *first, const float *second, const float *mean,
                            uint32_t width, uint32_t height)
{
    float squares[PADDED][PADDED], means[TILE_PIXELS_MAX];

    add_sides(out, first, second, mean, width, height, squares);
    means_around(squares, width, height, means);
    count_spreads(out->spreads, means, width * height);
}

void film_level_measure(struct film_level *out, const double *sums, const float *second, uint32_t width,
                        uint32_t height, uint32_t samples, const struct film_codes *codes)
{
    enum { FIRST, SECOND, MEAN, PICTURES };
    float linear[PICTURES][TILE_PIXELS_MAX * 3], shown[PICTURES][TILE_PIXELS_MAX * 3];
    uint32_t pixels = width * height;
    uint64_t rays = out->rays, subject = out->subject;
    double radiance = 0, squares = 0, means[TILE_PIXELS_MAX * 3], half[TILE_PIXELS_MAX * 3];

    for (uint32_t i = 0; i < pixels * 3; i++) {
        means[i] = sums[i] / samples;
        radiance += means[i];
    }
    for (uint32_t i = 0; second && i < pixels * 3; i++) {
        double b = (double)second[i] / (samples / 2.0);
        half[i] = means[i] - b; /* half of A - B */
        linear[FIRST][i] = (float)(2 * means[i] - b);
        linear[SECOND][i] = (float)b;
        linear[MEAN][i] = (float)means[i];
    }
    for (uint32_t i = 0; second && i < pixels * 3; i++)
        squares += half[i] * half[i];
    memset(out, 0, sizeof *out);
    out->rays = rays;
    out->subject = subject;
    out->radiance = radiance;
    out->linear = squares;
    if (!second || !codes->codes)
        return;
    for (int p = 0; p < PICTURES; p++)
        codes->codes(codes->user, linear[p], pixels, shown[p]);
    measure_codes(out, shown[FIRST], shown[SECOND], pixels);
    measure_spreads(out, shown[FIRST], shown[SECOND], shown[MEAN], width, height);
    out->has_codes = 1;
}

double level_correction(double now, double before)
{
    double share = before > 0 && now < SHARE_MAX * before ? now / before : SHARE_MAX;

    share = (share + SHARE_MAX) / 2; /* it grows: the ratio is that of the doubling before */
    return share / (1 - share);
}

void film_codes_plain(void *user UNUSED, const float *rgb, uint32_t count, float *codes)
{
    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] = rgb[i] > 0 ? rgb[i] < 1 ? rgb[i] : 1 : 0;
    srgb_encode_row(codes, (size_t)count * 3);
    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] *= 255;
}
