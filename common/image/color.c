#include "common/image/color.h"

#include <pthread.h>
#include <string.h>

#include "common/math/curve_table.h"
#include "common/math/elementary.h"
#include "common/math/lanes.h"

/* Where the curve's linear part ends. With the standard's rounded constants the power part begins
 * 2.6e-8 below the line's end; it is held there, so that the curve never decreases. */
static const float LINE_END = 0.0031308f, LINE_SLOPE = 12.92f;

float srgb_encode(float linear)
{
    if (!(linear > 0.0f)) /* NaN too */
        return 0.0f;
    if (linear >= 1.0f)
        return 1.0f;
    if (linear <= LINE_END)
        return LINE_SLOPE * linear;
    return fmaxf((float)fmin(1.055 * det_pow_d((double)linear, 1.0 / 2.4) - 0.055, 1.0), LINE_SLOPE * LINE_END);
}

float srgb_decode(float encoded)
{
    if (!(encoded > 0.0f))
        return 0.0f;
    if (encoded >= 1.0f)
        return 1.0f;
    if (encoded <= 0.04045f)
        return encoded / 12.92f;
    return (float)det_pow_d(((double)encoded + 0.055) / 1.055, 2.4);
}

/* The curve's power part, from 2^-9 on, which is below its start. */
enum { ENCODE_FIRST = -9 };
static float encode_pieces[-ENCODE_FIRST * CURVE_PIECES][4];
static struct curve_table encode_table;
static pthread_once_t encode_table_once = PTHREAD_ONCE_INIT;

static double srgb_power(double linear, const void *user)
{
    (void)user;
    return 1.055 * det_pow_d(linear, 1.0 / 2.4) - 0.055;
}

static void encode_table_build(void)
{
    curve_table_build(&encode_table, encode_pieces, ENCODE_FIRST, -ENCODE_FIRST, srgb_power, NULL);
}

/* curve_table_at() of each. */
static inline lanes table_at(const struct curve_table *table, lanes x)
{
    lanes piece[4], t, value, end;
    lane_masks bits, index;

    x = lanes_larger(x, lanes_of(table->low));
    x = lanes_smaller(x, lanes_of(table->high));
    bits = (lane_masks)x;
    index = (bits >> 16) - (int32_t)table->start;
    t = __builtin_convertvector(bits & 0xffff, lanes) * 0x1p-16f;
    for (int i = 0; i < 4; i++)
        memcpy(&piece[i], table->pieces[index[i]], sizeof piece[i]);
    lanes low01 = __builtin_shufflevector(piece[0], piece[1], 0, 4, 1, 5);
    lanes low23 = __builtin_shufflevector(piece[2], piece[3], 0, 4, 1, 5);
    lanes high01 = __builtin_shufflevector(piece[0], piece[1], 2, 6, 3, 7);
    lanes high23 = __builtin_shufflevector(piece[2], piece[3], 2, 6, 3, 7);
    lanes start = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
    lanes slope = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
    lanes bend = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
    end = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
    value = start + t * (slope + t * bend);
    value = lanes_larger(value, start);
    return lanes_smaller(value, end);
}

static inline lanes encode_four(lanes linear)
{
    lanes x = lanes_larger(linear, lanes_of(0)); /* NaN too */
    lanes power = table_at(&encode_table, x), corner = lanes_of(LINE_SLOPE * LINE_END);

    power = lanes_larger(power, corner);
    power = lanes_choose(x < 1.0f, power, lanes_of(1));
    return lanes_choose(x <= LINE_END, LINE_SLOPE * x, power);
}

void srgb_encode_row(float *values, size_t count)
{
    lanes four = {0};
    size_t i = 0;

    pthread_once(&encode_table_once, encode_table_build);
    for (; i + 4 <= count; i += 4) {
        memcpy(&four, values + i, sizeof four);
        four = encode_four(four);
        memcpy(values + i, &four, sizeof four);
    }
    if (i == count)
        return;
    memcpy(&four, values + i, (count - i) * sizeof *values);
    four = encode_four(four);
    memcpy(values + i, &four, (count - i) * sizeof *values);
}

static float decode_table[256];
static pthread_once_t decode_table_once = PTHREAD_ONCE_INIT;

static void decode_table_build(void)
{
    for (int i = 0; i < 256; i++)
        decode_table[i] = srgb_decode((float)i / 255.0f);
}

const float *srgb_decode_table(void)
{
    pthread_once(&decode_table_once, decode_table_build);
    return decode_table;
}

/* XYZ of the primaries, scaled so that RGB (1,1,1) is the white with Y = 1. */
static int rgb_to_xyz(const struct color_primaries *p, double m[3][3])
{
    const double xs[3] = {p->red[0], p->green[0], p->blue[0]};
    const double ys[3] = {p->red[1], p->green[1], p->blue[1]};
    double inverse[3][3], white[3];

    for (int i = 0; i < 3; i++) {
        m[0][i] = xs[i];
        m[1][i] = ys[i];
        m[2][i] = 1.0 - xs[i] - ys[i];
    }
    if (!(p->white[1] > 1e-6) || !color_matrix_invert(m, inverse))
        return 0;
    white[0] = p->white[0] / p->white[1];
    white[1] = 1.0;
    white[2] = (1.0 - p->white[0] - p->white[1]) / p->white[1];
    for (int i = 0; i < 3; i++) {
        double scale = inverse[i][0] * white[0] + inverse[i][1] * white[1] + inverse[i][2] * white[2];

        for (int row = 0; row < 3; row++)
            m[row][i] *= scale;
    }
    return 1;
}

static void multiply(const double a[3][3], const double b[3][3], double out[3][3])
{
    double product[3][3];

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            product[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i][j] = product[i][j];
}

int color_matrix_invert(const double m[3][3], double out[3][3])
{
    double inverse[3][3], determinant = 0.0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int r = (j + 1) % 3, s = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = m[r][c] * m[s][d] - m[r][d] * m[s][c]; /* the cofactor, transposed */
        }
    for (int j = 0; j < 3; j++)
        determinant += m[0][j] * inverse[j][0];
    if (!(fabs(determinant) > 1e-9) || !isfinite(determinant))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i][j] = inverse[i][j] / determinant;
    return 1;
}

const struct color_primaries color_rec709 = {
    {0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}, {0.3127, 0.3290}};
const struct color_primaries color_xyz = {
    {1.0, 0.0}, {0.0, 1.0}, {0.0, 0.0}, {1.0 / 3.0, 1.0 / 3.0}};

int color_primaries_equal(const struct color_primaries *a, const struct color_primaries *b)
{
    double worst = 0.0;

    for (int i = 0; i < 2; i++) {
        worst = fmax(worst, fabs(a->red[i] - b->red[i]));
        worst = fmax(worst, fabs(a->green[i] - b->green[i]));
        worst = fmax(worst, fabs(a->blue[i] - b->blue[i]));
        worst = fmax(worst, fabs(a->white[i] - b->white[i]));
    }
    return worst < 1e-3;
}

/* Bradford's cone responses (Lam 1985), the usual matrix for chromatic adaptation. */
static const double bradford[3][3] = {{0.8951, 0.2664, -0.1614},
                                      {-0.7502, 1.7135, 0.0367},
                                      {0.0389, -0.0685, 1.0296}};

static int adapt_white(const double from[2], const double to[2], double out[3][3])
{
    const double from_xyz[3] = {from[0] / from[1], 1.0, (1.0 - from[0] - from[1]) / from[1]};
    const double to_xyz[3] = {to[0] / to[1], 1.0, (1.0 - to[0] - to[1]) / to[1]};
    double inverse[3][3], scaled[3][3];

    if (!color_matrix_invert(bradford, inverse))
        return 0;
    for (int i = 0; i < 3; i++) {
        double a = 0.0, b = 0.0;
        for (int j = 0; j < 3; j++) {
            a += bradford[i][j] * from_xyz[j];
            b += bradford[i][j] * to_xyz[j];
        }
        if (!(fabs(a) > 1e-6))
            return 0;
        for (int j = 0; j < 3; j++)
            scaled[i][j] = bradford[i][j] * (b / a);
    }
    multiply(inverse, scaled, out);
    return 1;
}

int color_white_to_d65(const double white[2], double out[3][3])
{
    double to_xyz[3][3], from_xyz[3][3];

    if (!(white[1] > 1e-6) || !rgb_to_xyz(&color_rec709, to_xyz) || !color_matrix_invert(to_xyz, from_xyz) ||
        !adapt_white(white, color_rec709.white, out))
        return 0;
    multiply(out, to_xyz, out);
    multiply(from_xyz, out, out);
    return 1;
}

int color_to_rec709(const struct color_primaries *from, double out[3][3])
{
    double source[3][3], target[3][3], adaptation[3][3];

    if (!rgb_to_xyz(from, source) || !rgb_to_xyz(&color_rec709, target) || !color_matrix_invert(target, target))
        return 0;
    /* XYZ itself is a coordinate system, not a device: its white says nothing about the intended
     * viewing light of the scene. */
    if (!color_primaries_equal(from, &color_xyz)) {
        if (!adapt_white(from->white, color_rec709.white, adaptation))
            return 0;
        multiply(adaptation, source, source);
    }
    multiply(target, source, out);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (!isfinite(out[i][j]))
                return 0;
    return 1;
}
