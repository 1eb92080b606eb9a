/* pbrt's coats against a brute-force walk: light that enters a rough dielectric
 * interface, is thrown to and fro between it and a Lambert base, and leaves;
 * every microfacet by Fresnel's equations, masking and shadowing by Smith's.
 * What is sent out is compared, for base colours of every darkness, at a
 * family-wise level of 0.01, Sidak-corrected, beyond what tables may err by.
 *
 * The walk loses what meets a second microfacet, as pbrt's does; our layers
 * give it back. They are compared where little is lost: nearly smooth coats
 * with any base, and coats of every roughness over black with single
 * scattering. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"

#define SIGNIFICANCE 0.01
/* Tables, and a base that is scaled by mean reflectances. */
#define TABLE 0.003

enum { WALKS = 60000, SAMPLES = 60000, BOUNCES = 64, COUNT_BASES = 5, COUNT_COSINES = 5 };
static const double BASES[COUNT_BASES] = {0, 0.05, 0.3, 0.7, 1};
static const double COSINES[COUNT_COSINES] = {0.1, 0.25, 0.5, 0.8, 1};

struct direction {
    double x, y, z;
};

static double dot(struct direction a, struct direction b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static double fresnel(double cosine, double eta)
{
    double sine2 = (1 - cosine * cosine) / (eta * eta), inner, s, p;

    if (sine2 >= 1)
        return 1;
    inner = sqrt(1 - sine2);
    s = (cosine - eta * inner) / (cosine + eta * inner);
    p = (eta * cosine - inner) / (eta * cosine + inner);
    return 0.5 * (s * s + p * p);
}

static double smith(double z, double alpha)
{
    return z < 1 ? 0.5 * (sqrt(1 + alpha * alpha * (1 - z * z) / (z * z)) - 1) : 0;
}

/* A normal of GGX as seen along w: a point of the spherical cap that the
 * stretched hemisphere shows (Dupuy and Benyoub 2023). */
static struct direction visible_normal(struct direction w, double alpha, struct test_random *r)
{
    struct direction v = {alpha * w.x, alpha * w.y, w.z}, h;
    double length = sqrt(dot(v, v)), z, sine, phi = 2 * M_PI * test_random_double(r);

    z = (1 - test_random_double(r)) * (1 + v.z / length) - v.z / length;
    sine = sqrt(fmax(0, 1 - z * z));
    h = (struct direction){alpha * (sine * cos(phi) + v.x / length),
                           alpha * (sine * sin(phi) + v.y / length), z + v.z / length};
    length = sqrt(dot(h, h));
    return (struct direction){h.x / length, h.y / length, h.z / length};
}

enum fate { LOST, REFLECTED, REFRACTED };

/* One meeting with the interface, from above in the frame of w; *weight is
 * scaled by what masking leaves. */
static enum fate meet(struct direction w, double alpha, double eta, double *weight, struct test_random *r)
{
    struct direction h = {0, 0, 1};
    double cosine, z;
    int reflects;

    if (alpha > 0)
        h = visible_normal(w, alpha, r);
    cosine = fmin(1, dot(w, h));
    if (cosine <= 0)
        return LOST;
    reflects = test_random_double(r) < fresnel(cosine, eta);
    if (reflects)
        z = 2 * cosine * h.z - w.z;
    else
        z = w.z / eta - (cosine / eta - sqrt(1 - (1 - cosine * cosine) / (eta * eta))) * h.z;
    if (z <= 0)
        return LOST;
    if (alpha > 0)
        *weight *= (1 + smith(w.z, alpha)) / (1 + smith(w.z, alpha) + smith(fmin(1, z), alpha));
    return reflects ? REFLECTED : REFRACTED;
}

/* One walk that comes along a direction of cosine mu; how often it meets the
 * base before it leaves, or -1. */
static int walk(double mu, double alpha, double eta, double *weight, struct test_random *r)
{
    struct direction w = {sqrt(1 - mu * mu), 0, mu};
    enum fate fate = meet(w, alpha, eta, weight, r);

    if (fate != REFRACTED)
        return fate == REFLECTED ? 0 : -1;
    for (int bounces = 1; bounces < BOUNCES; bounces++) {
        double u = test_random_double(r), phi = 2 * M_PI * test_random_double(r);
        w = (struct direction){sqrt(u) * cos(phi), sqrt(u) * sin(phi), sqrt(1 - u)};
        fate = meet(w, alpha, 1 / eta, weight, r);
        if (fate != REFLECTED)
            return fate == REFRACTED ? bounces : -1;
    }
    return -1;
}

/* What walks send out, for every base at once. */
static void walk_albedos(double mu, double alpha, double eta, uint64_t seed, struct running_stats out[COUNT_BASES])
{
    struct test_random r = {seed};

    memset(out, 0, COUNT_BASES * sizeof *out);
    for (int i = 0; i < WALKS; i++) {
        double weight = 1;
        int bounces = walk(mu, alpha, eta, &weight, &r);
        for (int k = 0; k < COUNT_BASES; k++)
            running_stats_add(&out[k], bounces < 0 ? 0 : weight * pow(BASES[k], bounces));
    }
}

/* Diffuse light from inside that a smooth interface throws back. */
static double inner_reflectance(double eta)
{
    double outside = 0;
    enum { STEPS = 2000 };

    for (int i = 0; i < STEPS; i++) {
        double c = (i + 0.5) / STEPS;
        outside += 2 * c * fresnel(c, eta) / STEPS;
    }
    return 1 - (1 - outside) / (eta * eta);
}

static struct running_stats our_albedo(double base, double mu, double alpha, double eta, int single, uint64_t seed)
{
    struct bsdf_params p = {
        .alpha = (float)alpha, .ior = (float)eta, .specular = 1, .single_scattering = single};
    struct vec3 wo = {(float)sqrt(1 - mu * mu), 0, (float)mu};
    struct test_random r = {seed};
    struct running_stats sum = {0};
    struct bsdf b;

    p.base_color = vec3_splat((float)base);
    p.specular_color = vec3_splat(1);
    p.base_interreflection = (float)inner_reflectance(eta);
    bsdf_init(&b, &p, wo);
    for (int i = 0; i < SAMPLES; i++) {
        float u = test_random_float(&r), v = test_random_float(&r), w = test_random_float(&r);
        struct bsdf_sample s;
        running_stats_add(&sum, bsdf_sample(&b, wo, w, u, v, &s) ? (double)s.weight.x : 0);
    }
    return sum;
}

static void compare(const double *alphas, int alpha_count, int base_count, int single)
{
    static const double IORS[] = {1.25, 1.5, 2.2};
    double z =
        normal_quantile(1 - 0.5 * sidak_alpha(SIGNIFICANCE, (unsigned)(3 * alpha_count * COUNT_COSINES * base_count)));
    uint64_t seed = 1;

    for (int n = 0; n < 3; n++)
        for (int a = 0; a < alpha_count; a++)
            for (int c = 0; c < COUNT_COSINES; c++) {
                struct running_stats walked[COUNT_BASES];
                walk_albedos(COSINES[c], alphas[a], IORS[n], ++seed, walked);
                for (int k = 0; k < base_count; k++) {
                    struct running_stats ours = our_albedo(BASES[k], COSINES[c], alphas[a], IORS[n], single, ++seed);
                    double error = hypot(running_stats_error(&ours), running_stats_error(&walked[k]));
                    if (fabs(ours.mean - walked[k].mean) > TABLE + z * error)
                        fail_msg("ior %g alpha %g cos %g base %g: %.5f, the walk %.5f +- %.5f", IORS[n], alphas[a],
                                 COSINES[c], BASES[k], ours.mean, walked[k].mean, error);
                }
            }
}

static void nearly_smooth_coats_are_the_walks(void **state)
{
    static const double ALPHAS[] = {0, 2e-3, 0.01};

    (void)state;
    compare(ALPHAS, 3, COUNT_BASES, 0);
}

static void rough_coats_over_black_are_the_walks(void **state)
{
    static const double ALPHAS[] = {0.03, 0.1, 0.25, 0.5, 1};

    (void)state;
    compare(ALPHAS, 5, 1, 1);
}

/* What the walk loses comes back: white stays white. */
static void rough_coats_over_white_keep_all(void **state)
{
    static const double ALPHAS[] = {0.03, 0.1, 0.25, 0.5, 1}, IORS[] = {1.25, 1.5, 2.2};
    double z = normal_quantile(1 - 0.5 * sidak_alpha(SIGNIFICANCE, 5 * 3 * COUNT_COSINES));

    (void)state;
    for (int a = 0; a < 5; a++)
        for (int n = 0; n < 3; n++)
            for (int c = 0; c < COUNT_COSINES; c++) {
                struct running_stats ours =
                    our_albedo(1, COSINES[c], ALPHAS[a], IORS[n], 0, (uint64_t)(a * 100 + n * 10 + c));
                if (fabs(ours.mean - 1) > 0.006 + z * running_stats_error(&ours))
                    fail_msg("ior %g alpha %g cos %g: %.5f", IORS[n], ALPHAS[a], COSINES[c], ours.mean);
            }
}

/* A smooth coat over a smooth metal: F + (1 - F)^2 C / (1 - F C), the sum over all reflections
 * between the two, with C the metal's reflectance for the angle inside the coat. */
static void smooth_coats_over_metals_are_the_series(void **state)
{
    static const double IORS[] = {1.25, 1.5, 2.2};
    static const float METALS[][2] = {{0.143f, 3.98f}, {1.44f, 1.6f}, {1.66f, 9.22f}};
    enum { STEPS = 20000 };

    (void)state;
    for (int n = 0; n < 3; n++)
        for (int m = 0; m < 3; m++)
            for (int c = 0; c < COUNT_COSINES; c++) {
                double eta = IORS[n], mu = COSINES[c], f = fresnel(mu, eta), metal, sum = 0;
                struct bsdf_params p = {
                    .metallic = 1, .ior = 1.5f, .specular = 1, .conductor = 1, .clearcoat = 1};
                struct vec3 wo = {(float)sqrt(1 - mu * mu), 0, (float)mu};
                struct bsdf b;
                p.base_color = p.specular_color = vec3_splat(1);
                p.eta = vec3_splat(METALS[m][0] / (float)eta);
                p.k = vec3_splat(METALS[m][1] / (float)eta);
                p.clearcoat_ior = (float)eta;
                p.clearcoat_normal = vec3_make(0, 0, 1);
                p.base_interreflection = (float)fresnel(1, eta);
                bsdf_init(&b, &p, wo);
                for (int i = 0; i < STEPS; i++) {
                    struct bsdf_sample s;
                    if (bsdf_sample(&b, wo, ((float)i + 0.5f) / STEPS, 0.5f, 0.5f, &s))
                        sum += (double)s.weight.y / STEPS;
                }
                metal = (double)fresnel_conductor((float)sqrt(1 - (1 - mu * mu) / (eta * eta)), p.eta.y, p.k.y);
                metal = f + (1 - f) * (1 - f) * metal / (1 - f * metal);
                if (fabs(sum - metal) > 1e-3)
                    fail_msg("ior %g metal %d cos %g: %.5f, should be %.5f", eta, m, mu, sum, metal);
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nearly_smooth_coats_are_the_walks),
        cmocka_unit_test(rough_coats_over_black_are_the_walks),
        cmocka_unit_test(rough_coats_over_white_keep_all),
        cmocka_unit_test(smooth_coats_over_metals_are_the_series),
    };

    return cmocka_run_group_tests_name("coat_walk", tests, NULL, NULL);
}
