#include "common/math/transform.h"

#include <math.h>

#include "common/base/safeguard.h"

struct transform_d transform_d_multiply(const struct transform_d *a, const struct transform_d *b)
{
    struct transform_d out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++) {
            out.m[r][c] = a->m[r][0] * b->m[0][c] + a->m[r][1] * b->m[1][c] + a->m[r][2] * b->m[2][c];
            if (c == 3)
                out.m[r][c] += a->m[r][3];
            if (!SAFEGUARD(POSE_DOUBLE))
                out.m[r][c] = (double)(float)out.m[r][c];
        }
    return out;
}

struct transform_d transform_d_from_columns(const double columns[16])
{
    struct transform_d out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = columns[4 * c + r];
    return out;
}

struct transform_d transform_d_from_trs(const double t[3], const double q[4], const double s[3])
{
    double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double x, y, z, w;
    struct transform_d out;

    if (!(norm > 0))
        x = y = z = 0, w = 1;
    else
        x = q[0] / norm, y = q[1] / norm, z = q[2] / norm, w = q[3] / norm;
    out.m[0][0] = (1 - 2 * (y * y + z * z)) * s[0];
    out.m[0][1] = 2 * (x * y - w * z) * s[1];
    out.m[0][2] = 2 * (x * z + w * y) * s[2];
    out.m[1][0] = 2 * (x * y + w * z) * s[0];
    out.m[1][1] = (1 - 2 * (x * x + z * z)) * s[1];
    out.m[1][2] = 2 * (y * z - w * x) * s[2];
    out.m[2][0] = 2 * (x * z - w * y) * s[0];
    out.m[2][1] = 2 * (y * z + w * x) * s[1];
    out.m[2][2] = (1 - 2 * (x * x + y * y)) * s[2];
    for (int r = 0; r < 3; r++)
        out.m[r][3] = t[r];
    return out;
}

double transform_d_determinant(const struct transform_d *a)
{
    return a->m[0][0] * (a->m[1][1] * a->m[2][2] - a->m[1][2] * a->m[2][1]) -
           a->m[0][1] * (a->m[1][0] * a->m[2][2] - a->m[1][2] * a->m[2][0]) +
           a->m[0][2] * (a->m[1][0] * a->m[2][1] - a->m[1][1] * a->m[2][0]);
}

int transform_d_invert(const struct transform_d *a, struct transform_d *out)
{
    double det = transform_d_determinant(a);
    const double(*m)[4] = a->m;

    *out = transform_d_identity();
    if (!isfinite(det) || det == 0 || !isfinite(1 / det))
        return 0;
    out->m[0][0] = (m[1][1] * m[2][2] - m[1][2] * m[2][1]) / det;
    out->m[0][1] = (m[0][2] * m[2][1] - m[0][1] * m[2][2]) / det;
    out->m[0][2] = (m[0][1] * m[1][2] - m[0][2] * m[1][1]) / det;
    out->m[1][0] = (m[1][2] * m[2][0] - m[1][0] * m[2][2]) / det;
    out->m[1][1] = (m[0][0] * m[2][2] - m[0][2] * m[2][0]) / det;
    out->m[1][2] = (m[0][2] * m[1][0] - m[0][0] * m[1][2]) / det;
    out->m[2][0] = (m[1][0] * m[2][1] - m[1][1] * m[2][0]) / det;
    out->m[2][1] = (m[0][1] * m[2][0] - m[0][0] * m[2][1]) / det;
    out->m[2][2] = (m[0][0] * m[1][1] - m[0][1] * m[1][0]) / det;
    for (int r = 0; r < 3; r++)
        out->m[r][3] = -(out->m[r][0] * m[0][3] + out->m[r][1] * m[1][3] + out->m[r][2] * m[2][3]);
    return 1;
}

static int make_unit(double v[3])
{
    double largest = 0, length;

    for (int i = 0; i < 3; i++)
        if (!(fabs(v[i]) <= largest))
            largest = fabs(v[i]);
    if (!(largest > 0) || !isfinite(largest))
        return 0;
    for (int i = 0; i < 3 && SAFEGUARD(POSE_TINY_SCALE); i++)
        v[i] /= largest; /* neither under- nor overflow in the squares */
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return 1;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

int transform_d_rigid(const struct transform_d *a, struct transform_d *out)
{
    double axis[3][3]; /* right, up, back */

    *out = transform_d_identity();
    for (int r = 0; r < 3; r++) {
        axis[1][r] = a->m[r][1];
        axis[2][r] = a->m[r][2];
    }
    if (!make_unit(axis[2]) || !make_unit(axis[1]))
        return 0;
    cross(axis[1], axis[2], axis[0]);
    if (!make_unit(axis[0]))
        return 0;
    cross(axis[2], axis[0], axis[1]);
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            out->m[r][c] = axis[c][r];
        out->m[r][3] = a->m[r][3];
    }
    return 1;
}

struct transform_stored transform_stored_from_d(const struct transform_d *a)
{
    struct transform_stored out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = (float)a->m[r][c];
    return out;
}

struct transform_d transform_stored_to_d(const struct transform_stored *a)
{
    struct transform_d out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = (double)a->m[r][c];
    return out;
}

void transform_d_point(const struct transform_d *a, const double p[3], double out[3])
{
    double moved[3];

    for (int r = 0; r < 3; r++)
        moved[r] = a->m[r][0] * p[0] + a->m[r][1] * p[1] + a->m[r][2] * p[2] + a->m[r][3];
    for (int r = 0; r < 3; r++)
        out[r] = moved[r];
}

int transform_stored_is_finite(const struct transform_stored *a)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            if (!isfinite(a->m[r][c]))
                return 0;
    return 1;
}

int transform_d_is_finite(const struct transform_d *a)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            if (!isfinite(a->m[r][c]))
                return 0;
    return 1;
}

void transform_points(const struct transform_d *a, const float *in, size_t count, float *out)
{
    for (size_t i = 0; i < 3 * count; i += 3) {
        double p[3] = {(double)in[i], (double)in[i + 1], (double)in[i + 2]};
        for (size_t k = 0; k < 3; k++) {
            const double *row = a->m[k];
            out[i + k] = (float)(row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]);
        }
    }
}
