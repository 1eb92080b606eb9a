/* The matrices of directives. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "common/math/elementary.h"

struct transform_d pbrt_to_world(const struct pbrt *p, const struct transform_d *ctm)
{
    struct transform_d out = *ctm;

    for (int c = 0; c < 4 && p->mirrored; c++)
        out.m[2][c] = -out.m[2][c];
    return out;
}

int pbrt_is_moving(const struct pbrt_matrices *m) { return memcmp(&m->at[0], &m->at[1], sizeof m->at[0]) != 0; }

/* Multiples of 90 degrees are exact. */
static void sincos_degrees(double angle, double *sine, double *cosine)
{
    static const double quarter[4] = {0, 1, 0, -1};
    double length;
    float s, c;

    angle = fmod(angle, 360);
    if (angle < 0)
        angle += 360;
    if (fmod(angle, 90) == 0) {
        int q = (int)(angle / 90) & 3;
        *sine = quarter[q];
        *cosine = quarter[(q + 1) & 3];
        return;
    }
    det_sincos((float)(angle * PI_D / 180), &s, &c);
    length = sqrt((double)s * (double)s + (double)c * (double)c);
    *sine = (double)s / length; /* exactly a rotation, if not quite the angle */
    *cosine = (double)c / length;
}

int pbrt_unit(double v[3])
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    if (!(length > 1e-150) || !isfinite(length))
        return 0;
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return 1;
}

/* Rodrigues' formula. */
int pbrt_rotation(double angle, const double given[3], struct transform_d *out)
{
    double a[3] = {given[0], given[1], given[2]}, s, c;

    *out = transform_d_identity();
    if (!pbrt_unit(a))
        return 0;
    sincos_degrees(angle, &s, &c);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 - i - j;
            out->m[i][j] = a[i] * a[j] * (1 - c) + (i == j ? c : 0);
            if (i != j)
                out->m[i][j] += ((j - i + 3) % 3 == 1 ? -1 : 1) * a[k] * s;
        }
    return 1;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

int pbrt_look_at(const double n[9], struct transform_d *out)
{
    struct transform_d back = transform_d_identity();
    double forward[3], right[3], up[3] = {n[6], n[7], n[8]}, top[3];

    for (int i = 0; i < 3; i++)
        forward[i] = n[3 + i] - n[i];
    if (!pbrt_unit(forward) || !pbrt_unit(up))
        return 0;
    cross(up, forward, right);
    if (!pbrt_unit(right))
        return 0;
    cross(forward, right, top);
    for (int i = 0; i < 3; i++) {
        back.m[i][0] = right[i];
        back.m[i][1] = top[i];
        back.m[i][2] = forward[i];
        back.m[i][3] = n[i];
    }
    return transform_d_invert(&back, out);
}
