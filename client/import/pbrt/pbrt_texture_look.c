/* Evaluates a texture's expression at a point. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/pbrt_texture_parts.h"
#include "common/image/color.h"
#include "common/math/elementary.h"

#define DOT_RADIUS 0.35 /* of a field */

static double decode(const struct pbrt_texture *t, float encoded)
{
    if (t->image->is_float || t->gamma == 1)
        return (double)encoded;
    if (t->gamma == 0 && t->image->has_codes)
        return (double)srgb_decode_table()[(int)(encoded * 255 + 0.5f)];
    if (t->gamma == 0)
        return (double)srgb_decode(encoded);
    return (double)det_pow(encoded, (float)t->gamma);
}

/* Texel (x, y), row 0 at the top, as colour and as the number that pbrt takes from it. */
static void texel(const struct pbrt_texture *t, long x, long y, double out[4])
{
    const struct image *im = &t->image->pixels;
    long w = (long)im->width, h = (long)im->height;
    const float *from;

    memset(out, 0, 4 * sizeof *out);
    if (t->wrap == WRAP_BLACK && (x < 0 || y < 0 || x >= w || y >= h))
        return;
    if (t->wrap == WRAP_CLAMP) {
        x = x < 0 ? 0 : x >= w ? w - 1 : x;
        y = y < 0 ? 0 : y >= h ? h - 1 : y;
    } else {
        x = (x % w + w) % w;
        y = (y % h + h) % h;
    }
    from = im->pixels + ((size_t)y * im->width + (size_t)x) * im->channels;
    for (unsigned c = 0; c < 3; c++)
        out[c] = decode(t, from[im->channels >= 3 ? c : 0]);
    if (t->by_luminance && im->channels >= 3) { /* before it is decoded, as there */
        double luminance = 0.212671 * (double)from[0] + 0.715160 * (double)from[1] + 0.072169 * (double)from[2];
        out[3] = t->image->is_float || t->gamma == 1 ? luminance : (double)srgb_decode((float)luminance);
        return;
    }
    out[3] = im->channels < 3    ? out[0]
             : im->channels == 3 ? (out[0] + out[1] + out[2]) / 3
                                 : (double)from[3];
}

static void look_up_image(const struct pbrt_texture *t, double s, double up, double out[4])
{
    const struct image *im = &t->image->pixels;
    double x = s * im->width, y = (1 - up) * im->height;

    if (!(fabs(x) < 1e15) || !(fabs(y) < 1e15))
        x = y = 0;
    if (t->nearest) {
        texel(t, (long)floor(x), (long)floor(y), out);
    } else {
        double fx = floor(x - 0.5), fy = floor(y - 0.5), wx = x - 0.5 - fx, wy = y - 0.5 - fy;
        double corner[4];
        memset(out, 0, 4 * sizeof *out);
        for (int i = 0; i < 4; i++) {
            double weight = (i & 1 ? wx : 1 - wx) * (i & 2 ? wy : 1 - wy);
            if (weight == 0)
                continue;
            texel(t, (long)fx + (i & 1), (long)fy + (i >> 1), corner);
            for (int c = 0; c < 4; c++)
                out[c] += weight * corner[c];
        }
    }
    for (int c = 0; c < 4; c++) {
        out[c] *= t->scale;
        if (t->invert)
            out[c] = out[c] < 1 ? 1 - out[c] : 0;
    }
}

/* The dot of the field around a whole (s, t), if it has one. */
struct dot {
    double s, t, middle[2];
    int is_known, exists;
};

static struct dot dot_of(double s, double t)
{
    const double shift = 0.5 - DOT_RADIUS;
    struct dot dot = {.s = s, .t = t, .is_known = 1, .exists = pbrt_noise(s + 0.5, t + 0.5, 0.5) > 0};

    if (dot.exists) {
        dot.middle[0] = s + shift * pbrt_noise(s + 1.5, t + 2.8, 0.5);
        dot.middle[1] = t + shift * pbrt_noise(s + 4.5, t + 9.8, 0.5);
    }
    return dot;
}

static int is_in_dot(const double st[2])
{
    static _Thread_local struct dot recent[16]; /* neighbouring texels ask for one field */
    double s = floor(st[0] + 0.5), t = floor(st[1] + 0.5), ds, dt;
    struct dot *dot;

    if (!(fabs(s) < 1e15 && fabs(t) < 1e15))
        return 0;
    dot = &recent[((uint64_t)(int64_t)s + 5 * (uint64_t)(int64_t)t) % 16];
    if (!dot->is_known || dot->s != s || dot->t != t)
        *dot = dot_of(s, t);
    ds = st[0] - dot->middle[0];
    dt = st[1] - dot->middle[1];
    return dot->exists && ds * ds + dt * dt < DOT_RADIUS * DOT_RADIUS;
}

void pbrt_evaluate(const struct pbrt_texture *t, const double uv[2], double out[4])
{
    double a[4], b[4], m[4], st[2];

    for (int i = 0; i < 2; i++)
        st[i] = t->mapping[i][0] * uv[0] + t->mapping[i][1] * uv[1] + t->mapping[i][2];
    switch (t->op) {
    case TEXTURE_CONSTANT:
        memcpy(out, t->value, sizeof t->value);
        out[3] = (out[0] + out[1] + out[2]) / 3;
        break;
    case TEXTURE_IMAGE: look_up_image(t, st[0], st[1], out); break;
    case TEXTURE_SCALE:
        pbrt_evaluate(t->child[0], uv, a);
        pbrt_evaluate(t->child[1], uv, b);
        for (int i = 0; i < 4; i++)
            out[i] = a[i] * b[i];
        break;
    case TEXTURE_MIX:
        pbrt_evaluate(t->child[0], uv, a);
        pbrt_evaluate(t->child[1], uv, b);
        pbrt_evaluate(t->child[2], uv, m);
        for (int i = 0; i < 4; i++)
            out[i] = a[i] * (1 - m[3]) + b[i] * m[3];
        break;
    case TEXTURE_CHECKER: pbrt_evaluate(t->child[fmod(floor(st[0]) + floor(st[1]), 2) != 0], uv, out); break;
    case TEXTURE_MASK:
        pbrt_evaluate(t->child[0], uv, a);
        out[3] = a[3] != 0;
        break;
    case TEXTURE_DOTS: pbrt_evaluate(t->child[!is_in_dot(st)], uv, out); break;
    case TEXTURE_UV:
        for (int i = 0; i < 2; i++)
            out[i] = st[i] - floor(st[i]);
        out[2] = 0;
        out[3] = (out[0] + out[1]) / 3;
        break;
    case TEXTURE_BILERP:
        for (int i = 0; i < 3; i++)
            out[i] = (1 - st[0]) * ((1 - st[1]) * t->corner[0][i] + st[1] * t->corner[1][i]) +
                     st[0] * ((1 - st[1]) * t->corner[2][i] + st[1] * t->corner[3][i]);
        out[3] = (out[0] + out[1] + out[2]) / 3;
        break;
    case TEXTURE_DIRECTION_MIX: pbrt_evaluate(t->child[0], uv, out); break;
    }
    if (!t->is_color)
        out[0] = out[1] = out[2] = out[3];
}
