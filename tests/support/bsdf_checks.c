#include "tests/support/bsdf_checks.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

struct vec3 direction(float cosine, float azimuth)
{
    float sine = sqrtf(fmaxf(0, 1 - cosine * cosine));
    return (struct vec3){sine * cosf(azimuth), sine * sinf(azimuth), cosine};
}

struct vec3 random_direction(struct test_random *r, float z_min)
{
    float z = z_min + (1 - z_min) * test_random_float(r);
    return direction(z, 6.2831853f * test_random_float(r));
}

int is_near(float a, float b, float relative) { return fabsf(a - b) <= relative * fmaxf(fabsf(a), fabsf(b)) + 1e-12f; }

int is_near_vec(struct vec3 a, struct vec3 b, float relative)
{
    return is_near(a.x, b.x, relative) && is_near(a.y, b.y, relative) && is_near(a.z, b.z, relative);
}

void describe_and_fail(const struct bsdf_params *p, struct vec3 wo, struct vec3 wi, const char *what)
{
    fail_msg("%s: %s; wo (%g %g %g) wi (%g %g %g)", what, bsdf_maker_describe(p), (double)wo.x, (double)wo.y,
             (double)wo.z, (double)wi.x, (double)wi.y, (double)wi.z);
}

float hostile_float(struct test_random *r)
{
    static const float VALUES[] = {0, 1, -1, 0.5f, 1e-3f, 9.999e-4f, 1e-38f, 1e-45f, -0.0f, 2,
                                   1e30f, 3.4e38f, INFINITY, -INFINITY, NAN, 1.0000001f,
                                   0.9999999f, 1.5f, 1000, 1e-10f};
    uint64_t choice = test_random_u64(r) % 40;

    return choice < 20 ? VALUES[choice] : choice < 36 ? test_random_float(r) : 4 * test_random_float(r) - 2;
}

struct vec3 hostile_color(struct test_random *r)
{
    float x = hostile_float(r), y = hostile_float(r);
    return (struct vec3){x, y, hostile_float(r)};
}

static float hostile_unit(struct test_random *r)
{
    uint64_t choice = test_random_u64(r) % 16;
    return choice == 0 ? 0 : choice == 1 ? ONE_MINUS_EPSILON : choice == 2 ? 1e-30f : test_random_float(r);
}

static struct vec3 hostile_direction(struct test_random *r)
{
    static const float COSINES[] = {1, 1e-3f, 1e-7f, 1e-20f, 1e-44f, 0.99999994f, 0.7f, 0.01f};
    uint64_t choice = test_random_u64(r) % 16;

    return choice < 8 ? direction(COSINES[choice], 6.28f * test_random_float(r)) : random_direction(r, 0);
}

int check_agreement(const struct bsdf_params *p, struct test_random *r)
{
    struct vec3 wo = random_direction(r, 1e-3f), wi = random_direction(r, -1), f;
    float pdf, u = test_random_float(r), v = test_random_float(r);
    struct bsdf_sample s;
    struct bsdf b;

    bsdf_init(&b, p, wo);
    f = bsdf_eval_pdf(&b, wo, wi, &pdf);
    if (pdf != bsdf_pdf(&b, wo, wi) || vec3_length(vec3_sub(f, bsdf_eval(&b, wo, wi))) != 0)
        describe_and_fail(p, wo, wi, "eval_pdf differs from eval and pdf");
    if (vec3_max(f) > 0 && !(pdf > 0))
        describe_and_fail(p, wo, wi, "light where nothing is sampled");
    if (!bsdf_sample(&b, wo, test_random_float(r), u, v, &s))
        return 0;
    if (fabsf(vec3_length(s.wi) - 1) > 1e-5f)
        describe_and_fail(p, wo, s.wi, "not unit");
    if (((s.flags & BSDF_TRANSMISSION) != 0) != (s.wi.z < 0) || ((s.flags & BSDF_REFRACTION) && !p->refractive))
        describe_and_fail(p, wo, s.wi, "wrong flags");
    if (s.flags & BSDF_DELTA) {
        if (s.pdf != 0 || !b.has_delta)
            describe_and_fail(p, wo, s.wi, "delta lobe with a density");
        return 0;
    }
    if (!b.has_smooth || s.pdf != bsdf_pdf(&b, wo, s.wi))
        describe_and_fail(p, wo, s.wi, "sample's pdf is not pdf()");
    if (!is_near_vec(vec3_scale(s.weight, s.pdf), bsdf_eval(&b, wo, s.wi), 1e-5f))
        describe_and_fail(p, wo, s.wi, "weight is not eval / pdf");
    return 1;
}

int check_reciprocity(const struct bsdf_params *p, struct test_random *r, int sampled, float reflection_error,
                      float refraction_error)
{
    struct vec3 wo = random_direction(r, 0.02f), wi = random_direction(r, -1), turned, f, g;
    struct bsdf_params back = *p;
    float side, scale = 1;
    struct bsdf b, c;

    bsdf_init(&b, p, wo);
    if (sampled) {
        struct bsdf_sample s;
        if (!bsdf_sample(&b, wo, test_random_float(r), test_random_float(r), test_random_float(r), &s) ||
            (s.flags & BSDF_DELTA))
            return WAY_NONE;
        wi = s.wi;
    }
    if (fabsf(wi.z) < 0.02f)
        return WAY_NONE;
    side = wi.z > 0 ? 1 : -1;
    turned = (struct vec3){wi.x, wi.y, wi.z * side};
    if (side < 0) {
        back = bsdf_maker_other_side(p);
        scale = p->refractive ? b.eta * b.eta : 1;
    }
    bsdf_init(&c, &back, turned);
    f = vec3_scale(bsdf_eval(&b, wo, wi), scale / fabsf(wi.z));
    g = vec3_scale(bsdf_eval(&c, turned, (struct vec3){wo.x, wo.y, wo.z * side}), 1 / wo.z);
    /* Tails of refraction have only the last digits of 1 - F. */
    if (vec3_max(f) < 1e-3f && vec3_max(g) < 1e-3f)
        return WAY_NONE;
    if (!is_near_vec(f, g, side < 0 && p->refractive ? refraction_error : reflection_error))
        describe_and_fail(p, wo, wi, "not reciprocal");
    return side > 0 ? WAY_REFLECTED : p->refractive ? WAY_REFRACTED : WAY_THROUGH;
}

int check_harmless(const struct bsdf_params *p, struct test_random *r, float weight_max)
{
    struct vec3 wo = hostile_direction(r), wi = hostile_direction(r), f;
    struct bsdf_sample s;
    struct bsdf b;
    float pdf, chosen = 0;

    if (test_random_u64(r) & 1)
        wi.z = -wi.z;
    if (test_random_u64(r) % 8 == 0)
        wi = (struct vec3){-wo.x, -wo.y, test_random_u64(r) & 1 ? wo.z : -wo.z};
    bsdf_init(&b, p, wo);
    f = bsdf_eval_pdf(&b, wo, wi, &pdf);
    if (!vec3_is_finite(f) || vec3_min(f) < 0 || !(pdf >= 0 && pdf < INFINITY))
        describe_and_fail(p, wo, wi, "eval_pdf is not a finite, positive number");
    for (int k = 0; b.kind == BSDF_KIND_LOBES && k < BSDF_LOBES; k++) {
        if (!(b.lobe_pdf[k] >= 0 && b.lobe_pdf[k] <= 1) || (b.lobe_pdf[k] > 0) != (b.lobes >> k & 1))
            describe_and_fail(p, wo, wi, "selection probabilities");
        chosen += b.lobe_pdf[k];
    }
    if (b.kind == BSDF_KIND_LOBES && fabsf(chosen - 1) > 1e-5f)
        describe_and_fail(p, wo, wi, "selection probabilities do not add up to 1");
    if (!bsdf_sample(&b, wo, hostile_unit(r), hostile_unit(r), hostile_unit(r), &s))
        return 0;
    if (!vec3_is_finite(s.weight) || vec3_min(s.weight) < 0 || !(s.pdf >= 0) || !(s.pdf < INFINITY) ||
        !vec3_is_finite(s.wi) || !(s.eta_scale > 0 && s.eta_scale < INFINITY) || fabsf(vec3_length(s.wi) - 1) > 1e-3f ||
        s.wi.z == 0)
        describe_and_fail(p, wo, s.wi, "sample is not a finite, positive number");
    /* Light through the base does not scale by n^2, refraction does: then no bound holds. */
    if (vec3_max(s.weight) * (p->diffuse_transmission > 0 ? 1 : s.eta_scale) > weight_max &&
        !(p->diffuse_transmission > 0 && p->refractive))
        describe_and_fail(p, wo, s.wi, "a weight far above what the lobes' shares allow");
    if (!(s.flags & BSDF_DELTA) && !(s.pdf > 0))
        describe_and_fail(p, wo, s.wi, "sample without density");
    return 1;
}

/* Where the light goes, in green, by an additive recurrence over the three numbers. */
struct shares shares_of(const struct bsdf_params *p, struct vec3 wo)
{
    struct shares out = {0, 0, {0, 0, 0}};
    struct bsdf b;
    enum { STEPS = 60000 };

    bsdf_init(&b, p, wo);
    for (int i = 0; i < STEPS; i++) {
        double u = 0.5 + i * 0.8191725133961645, v = 0.5 + i * 0.6710436067037893, w = 0.5 + i * 0.5497004779019703;
        struct bsdf_sample s;
        if (!bsdf_sample(&b, wo, fminf((float)(u - floor(u)), ONE_MINUS_EPSILON),
                         fminf((float)(v - floor(v)), ONE_MINUS_EPSILON),
                         fminf((float)(w - floor(w)), ONE_MINUS_EPSILON), &s))
            continue;
        s.weight.y *= s.eta_scale; /* radiance to power */
        out.towards = vec3_mad(out.towards, s.wi, s.weight.y / STEPS);
        *(s.wi.z > 0 ? &out.reflected : &out.transmitted) += s.weight.y / STEPS;
    }
    return out;
}

void assert_same_look(const struct bsdf_params *p, const struct bsdf_params *q, float step, double tolerance,
                      const char *what)
{
    for (float c = 0.1f; c <= 1; c += step) {
        struct vec3 wo = direction(c, 0.7f);
        struct shares a = shares_of(p, wo), b = shares_of(q, wo);
        if (fabs(a.reflected - b.reflected) > tolerance || fabs(a.transmitted - b.transmitted) > tolerance ||
            (double)vec3_length(vec3_sub(a.towards, b.towards)) > tolerance)
            fail_msg("%s at cos %g (alpha %g, ior %g, inside %d): reflected %.4f and %.4f, "
                     "transmitted %.4f and %.4f, directions differ by %.4f",
                     what, (double)c, (double)p->alpha, (double)p->ior, p->inside, a.reflected, b.reflected,
                     a.transmitted, b.transmitted, (double)vec3_length(vec3_sub(a.towards, b.towards)));
    }
}

int bsdf_subject_sample(void *subject, const float u[3], struct vec3 *wi)
{
    const struct bsdf_subject *s = subject;
    struct bsdf_sample out;

    if (!bsdf_sample(&s->bsdf, s->wo, u[0], u[1], u[2], &out) || (out.flags & BSDF_DELTA))
        return 0;
    *wi = out.wi;
    return out.wi.z * s->side > 0;
}

double bsdf_subject_pdf(void *subject, struct vec3 wi)
{
    const struct bsdf_subject *s = subject;
    return wi.z * s->side > 0 ? (double)bsdf_pdf(&s->bsdf, s->wo, wi) : 0;
}

static const struct running_stats *largest_of(const struct running_stats component[3])
{
    const struct running_stats *largest = component;

    for (int i = 1; i < 3; i++)
        largest = component[i].mean > largest->mean ? &component[i] : largest;
    return largest;
}

struct running_stats bsdf_albedo(const struct bsdf_params *p, struct vec3 wo, int samples, uint64_t seed)
{
    return bsdf_albedo_within(p, wo, samples, seed, INFINITY, -INFINITY);
}

struct running_stats bsdf_albedo_within(const struct bsdf_params *p, struct vec3 wo, int samples, uint64_t seed,
                                        double least, double most)
{
    static const struct { int part; double errors; } STOPS[] = {{16, 2.5}, {8, 2}, {4, 1}};
    struct running_stats component[3] = {{0}};
    struct test_random random = {seed};
    struct bsdf b;
    int stop = 0;

    bsdf_init(&b, p, wo);
    while (stop < 3 && samples / STOPS[stop].part < 500)
        stop++;
    for (int i = 0; i < samples; i++) {
        float u = test_random_float(&random), v = test_random_float(&random);
        float w = test_random_float(&random);
        struct bsdf_sample s;
        struct vec3 weight = {0, 0, 0};
        if (bsdf_sample(&b, wo, w, u, v, &s))
            weight = vec3_scale(s.weight, s.eta_scale);
        running_stats_add(&component[0], (double)weight.x);
        running_stats_add(&component[1], (double)weight.y);
        running_stats_add(&component[2], (double)weight.z);
        if (stop < 3 && i + 1 == samples / STOPS[stop].part) {
            const struct running_stats *largest = largest_of(component);
            double error = STOPS[stop++].errors * running_stats_error(largest);
            if (largest->mean + error < most && largest->mean - error > least)
                break;
        }
    }
    return *largest_of(component);
}
