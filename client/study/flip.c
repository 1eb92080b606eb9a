#include "client/study/flip.h"

#include <math.h>

#include "common/base/memory.h"
#include "common/image/color.h"

enum { RADIUS_MAX = 32, PLANES = 3 };
#define PI 3.14159265358979323846
/* The white of D65, the XYZ of linear sRGB's (1, 1, 1). */
static const double white[3] = {0.950428545, 1, 1.088900371};
static const double to_xyz[3][3] = {
    {10135552 / 24577794.0, 8788810 / 24577794.0, 4435075 / 24577794.0},
    {2613072 / 12288897.0, 8788810 / 12288897.0, 887015 / 12288897.0},
    {1425312 / 73733382.0, 8788810 / 73733382.0, 70074185 / 73733382.0},
};
static const double from_xyz[3][3] = {{3.241003275, -1.537398934, -0.498615861},
                                      {-0.969224334, 1.875930071, 0.041554224},
                                      {0.055639423, -0.204011202, 1.057148933}};

/* What the paper calls a1, b1, a2, b2: two Gaussians each for brightness, red-green, blue-yellow. */
static const double sensitivity[PLANES][4] = {{1, 0.0047, 0, 1e-5}, {1, 0.0053, 0, 1e-5}, {34.1, 0.04, 13.5, 0.025}};
#define SENSITIVITY_WIDEST 0.04 /* the largest b */
#define FEATURE_WIDTH 0.082     /* degrees that an edge's or a point's detector spans */
#define COLOUR_POWER 0.7
#define COLOUR_LIMIT 0.4 /* of the largest difference, up to which COLOUR_SHARE of the range goes */
#define COLOUR_SHARE 0.95

struct kernel {
    int radius;
    double at[2 * RADIUS_MAX + 1];
};

/* One colour, or what stands for it. */
struct triple {
    double v[3];
};

static struct triple times(const double m[3][3], struct triple in)
{
    struct triple out;

    for (int r = 0; r < 3; r++)
        out.v[r] = m[r][0] * in.v[0] + m[r][1] * in.v[1] + m[r][2] * in.v[2];
    return out;
}

/* Opponent colours that are linear in light, so that they may be filtered. */
static struct triple opponent_of(struct triple linear)
{
    struct triple xyz = times(to_xyz, linear);
    double x = xyz.v[0] / white[0], y = xyz.v[1] / white[1], z = xyz.v[2] / white[2];

    return (struct triple){{116 * y - 16, 500 * (x - y), 200 * (y - z)}};
}

static struct triple linear_of(struct triple opponent)
{
    double y = (opponent.v[0] + 16) / 116, x = y + opponent.v[1] / 500, z = y - opponent.v[2] / 200;
    struct triple out = times(from_xyz, (struct triple){{x * white[0], y * white[1], z * white[2]}});

    for (int c = 0; c < 3; c++)
        out.v[c] = fmin(fmax(out.v[c], 0), 1);
    return out;
}

static double lab_curve(double t)
{
    const double delta = 6 / 29.0;

    return t > delta * delta * delta ? cbrt(t) : t / (3 * delta * delta) + 4 / 29.0;
}

/* L*a*b* in which colours count less the darker they are. */
static struct triple hunt_of(struct triple linear)
{
    struct triple xyz = times(to_xyz, linear);
    double x = lab_curve(xyz.v[0] / white[0]), y = lab_curve(xyz.v[1] / white[1]), z = lab_curve(xyz.v[2] / white[2]);
    double l = 116 * y - 16;

    return (struct triple){{l, 0.01 * l * 500 * (x - y), 0.01 * l * 200 * (y - z)}};
}

static double hyab(struct triple a, struct triple b)
{
    return fabs(a.v[0] - b.v[0]) + hypot(a.v[1] - b.v[1], a.v[2] - b.v[2]);
}

static double largest_colour_difference(void)
{
    return pow(hyab(hunt_of((struct triple){{0, 1, 0}}), hunt_of((struct triple){{0, 0, 1}})), COLOUR_POWER);
}

/* 0..1, in which large differences count less. */
static double redistribute(double difference, double most)
{
    double power = pow(difference, COLOUR_POWER), limit = COLOUR_LIMIT * most;

    return power < limit ? power * COLOUR_SHARE / limit
                         : COLOUR_SHARE + (power - limit) / (most - limit) * (1 - COLOUR_SHARE);
}

/* ---- filters ----------------------------------------------------------------------------------- */

static void gaussian(struct kernel *k, int radius, double two_variances)
{
    double sum = 0;

    k->radius = radius;
    for (int i = -radius; i <= radius; i++)
        sum += k->at[i + radius] = exp(-i * i / two_variances);
    for (int i = 0; i <= 2 * radius; i++)
        k->at[i] /= sum;
}

/* The first or second derivative of a Gaussian, its parts above and below 0 each of sum 1. */
static void derivative(struct kernel *k, int radius, double deviation, int order)
{
    double above = 0, below = 0;

    k->radius = radius;
    for (int i = -radius; i <= radius; i++) {
        double x = i / deviation, value = (order == 1 ? -x : x * x - 1) * exp(-x * x / 2);
        k->at[i + radius] = value;
        above += fmax(value, 0);
        below -= fmin(value, 0);
    }
    for (int i = 0; i <= 2 * radius; i++)
        k->at[i] /= k->at[i] > 0 ? above : below;
}

static int held(int at, int size) { return at < 0 ? 0 : at >= size ? size - 1 : at; }

/* out = in, filtered along each line by `across` and then along each column by `down`. */
static void filter(float *out, float *between, const float *in, int width, int height, const struct kernel *across,
                   const struct kernel *down)
{
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            double sum = 0;
            for (int i = -across->radius; i <= across->radius; i++)
                sum += across->at[i + across->radius] * (double)in[(size_t)y * (size_t)width + (size_t)held(x + i, width)];
            between[(size_t)y * (size_t)width + (size_t)x] = (float)sum;
        }
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            double sum = 0;
            for (int i = -down->radius; i <= down->radius; i++)
                sum += down->at[i + down->radius] * (double)between[(size_t)held(y + i, height) * (size_t)width + (size_t)x];
            out[(size_t)y * (size_t)width + (size_t)x] = (float)sum;
        }
}

/* ---- one picture ------------------------------------------------------------------------------- */

struct seen {
    float *opponent[PLANES], *filtered[PLANES]; /* [pixels] */
    float *edges, *points;                      /* [pixels]: how strong they are */
};

static void seen_release(struct seen *s)
{
    for (int c = 0; c < PLANES; c++) {
        mem_free(s->opponent[c]);
        mem_free(s->filtered[c]);
    }
    mem_free(s->edges);
    mem_free(s->points);
}

static int seen_allocate(struct seen *s, size_t pixels)
{
    int ok = 1;

    for (int c = 0; c < PLANES; c++) {
        ok &= (s->opponent[c] = mem_alloc_array(pixels, sizeof(float))) != NULL;
        ok &= (s->filtered[c] = mem_calloc(pixels, sizeof(float))) != NULL;
    }
    s->edges = mem_alloc_array(pixels, sizeof(float));
    s->points = mem_alloc_array(pixels, sizeof(float));
    return ok && s->edges && s->points;
}

/* What the eye resolves of each plane. */
static void resolve(struct seen *s, float *work[2], int width, int height)
{
    const size_t pixels = (size_t)width * (size_t)height;
    const int radius = (int)ceil(3 * sqrt(SENSITIVITY_WIDEST / (2 * PI * PI)) * FLIP_PIXELS_PER_DEGREE);

    for (int c = 0; c < PLANES; c++) {
        double weight[2], whole = 0;
        for (int g = 0; g < 2; g++) { /* a Gaussian's sum over the square, before it is normalised */
            const double a = sensitivity[c][2 * g], b = sensitivity[c][2 * g + 1];
            double sum = 0;
            for (int i = -radius; i <= radius; i++)
                sum += exp(-PI * PI * i * i / (b * FLIP_PIXELS_PER_DEGREE * FLIP_PIXELS_PER_DEGREE));
            weight[g] = a * sqrt(PI / b) * sum * sum;
            whole += weight[g];
        }
        for (int g = 0; g < 2; g++) {
            struct kernel k;
            if (!(weight[g] > 0))
                continue;
            gaussian(&k, radius,
                     sensitivity[c][2 * g + 1] * FLIP_PIXELS_PER_DEGREE * FLIP_PIXELS_PER_DEGREE / (PI * PI));
            filter(work[0], work[1], s->opponent[c], width, height, &k, &k);
            for (size_t i = 0; i < pixels; i++)
                s->filtered[c][i] += (float)(weight[g] / whole) * work[0][i];
        }
    }
}

/* How strong the edges (order 1) or points (order 2) of the brightness are. */
static void detect(float *out, const float *bright, float *work[2], int width, int height, int order)
{
    const double deviation = FEATURE_WIDTH / 2 * FLIP_PIXELS_PER_DEGREE;
    const int radius = (int)ceil(3 * deviation);
    const size_t pixels = (size_t)width * (size_t)height;
    struct kernel change, smooth;

    derivative(&change, radius, deviation, order);
    gaussian(&smooth, radius, 2 * deviation * deviation);
    filter(out, work[1], bright, width, height, &change, &smooth);
    filter(work[0], work[1], bright, width, height, &smooth, &change);
    for (size_t i = 0; i < pixels; i++)
        out[i] = hypotf(out[i], work[0][i]) / 116; /* brightness is 116 times its share of white */
}

static void look(struct seen *s, const struct image *codes, float *work[2])
{
    const int width = (int)codes->width, height = (int)codes->height;

    for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
        struct triple linear, opponent;
        for (size_t c = 0; c < 3; c++)
            linear.v[c] = (double)srgb_decode(fminf(fmaxf(codes->pixels[3 * i + c] / 255, 0), 1));
        opponent = opponent_of(linear);
        for (int c = 0; c < PLANES; c++)
            s->opponent[c][i] = (float)opponent.v[c];
    }
    resolve(s, work, width, height);
    detect(s->edges, s->opponent[0], work, width, height, 1);
    detect(s->points, s->opponent[0], work, width, height, 2);
}

static double difference_at(const struct seen *a, const struct seen *b, size_t i, double most)
{
    struct triple x, y;
    double colour, feature;

    for (int c = 0; c < PLANES; c++) {
        x.v[c] = (double)a->filtered[c][i];
        y.v[c] = (double)b->filtered[c][i];
    }
    colour = redistribute(hyab(hunt_of(linear_of(x)), hunt_of(linear_of(y))), most);
    feature = fmax(fabs((double)a->edges[i] - (double)b->edges[i]), fabs((double)a->points[i] - (double)b->points[i]));
    return pow(colour, 1 - sqrt(feature / M_SQRT2));
}

status flip_mean(double *out, const struct image *reference, const struct image *test, struct error *err)
{
    const size_t pixels = (size_t)reference->width * reference->height;
    const double most = largest_colour_difference();
    float *work[2] = {mem_alloc_array(pixels, sizeof(float)), mem_alloc_array(pixels, sizeof(float))};
    struct seen a = {0}, b = {0};
    status result = STATUS_OK;

    *out = 0;
    if (!seen_allocate(&a, pixels) || !seen_allocate(&b, pixels) || !work[0] || !work[1])
        result = error_no_memory(err, "the comparison with the reference");
    if (result == STATUS_OK) {
        look(&a, reference, work);
        look(&b, test, work);
        for (size_t i = 0; i < pixels; i++)
            *out += difference_at(&a, &b, i, most) / (double)pixels;
    }
    seen_release(&a);
    seen_release(&b);
    mem_free(work[0]);
    mem_free(work[1]);
    return result;
}
