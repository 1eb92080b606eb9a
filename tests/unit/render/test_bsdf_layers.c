/* What lies over and in a surface: coat, sheen, film, stretched highlights, conductors, light
 * through the base, indices relative to the surroundings. Golden values against formulas in
 * double, limits, reciprocity, agreement of the functions with each other, hostile input. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <complex.h>
#include <math.h>
#include <string.h>

#include "common/math/elementary.h"
#include "tests/support/bsdf_checks.h"
#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/dispersion.h"
#include "worker/render/bsdf/thin_film.h"
#include "worker/render/bsdf/fresnel.h"

static struct vec3 value(const struct bsdf_params *p, struct vec3 wo, struct vec3 wi)
{
    struct bsdf b;

    bsdf_init(&b, p, wo);
    return bsdf_eval(&b, wo, wi);
}

/* ---- golden values --------------------------------------------------------------------------- */

static double conductor_by_complex_numbers(double cos_i, double eta, double k)
{
    double complex n = eta + k * I;
    double complex cos_t = csqrt(1 - (1 - cos_i * cos_i) / (n * n));
    double complex s = (cos_i - n * cos_t) / (cos_i + n * cos_t);
    double complex p = (n * cos_i - cos_t) / (n * cos_i + cos_t);
    return 0.5 * (creal(s * conj(s)) + creal(p * conj(p)));
}

static void conductor_fresnel_matches_complex_arithmetic(void **state)
{
    /* Silver, gold (red, blue), copper, aluminium, chromium, a dielectric, extremes. */
    static const float INDICES[][2] = {{0.155f, 4.828f}, {0.143f, 3.983f}, {1.442f, 1.603f},
                                       {0.2f, 3.912f}, {1.657f, 9.224f}, {3.108f, 3.331f},
                                       {1.5f, 0}, {0.05f, 4}, {1e-4f, 1}, {1e4f, 0}, {1, 0},
                                       {0.5f, 0}, {2, 1e4f}, {1e4f, 1e4f}};

    (void)state;
    for (int i = 0; i < 14; i++)
        for (float c = 0; c <= 1; c += 0.0078125f) {
            float got = fresnel_conductor(c, INDICES[i][0], INDICES[i][1]);
            double want = conductor_by_complex_numbers((double)c, (double)INDICES[i][0], (double)INDICES[i][1]);
            /* libm's csqrt loses its digits too at eta = 1e-4 */
            if (fabs((double)got - want) > 3e-6)
                fail_msg("eta %g k %g cos %g: %.8f, should be %.8f", (double)INDICES[i][0], (double)INDICES[i][1],
                         (double)c, (double)got, want);
        }
    assert_true(fabs(conductor_by_complex_numbers(1, 0.155, 4.828) - 0.975) < 2e-3);
}

/* KHR_materials_iridescence's formulas as they stand, in double, with the upper interface's
 * exact Fresnel term. */
static void film_by_definition(double outside, double film, double nm, double cos_1, const double f0[3], double out[3])
{
    static const double VALUE[4] = {5.4856e-13, 4.4201e-13, 5.2481e-13, 9.7470e-14};
    static const double POSITION[4] = {1.6810e6, 1.7953e6, 2.2084e6, 2.2399e6};
    static const double VARIANCE[4] = {4.3278e9, 9.3046e9, 6.6121e9, 4.5282e9};
    static const double TO_RGB[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                        {-0.9692660, 1.8760108, 0.0415560},
                                        {0.0556434, -0.2040259, 1.0572252}};
    double t = fmin(1, nm / 30), sin2, cos_2, r12, shift[3], c0[3], c1[3], root[3];

    film = outside + (film - outside) * t * t * (3 - 2 * t);
    sin2 = (outside / film) * (outside / film) * (1 - cos_1 * cos_1);
    for (int i = 0; i < 3; i++)
        out[i] = 1;
    if (sin2 >= 1)
        return;
    cos_2 = sqrt(1 - sin2);
    {
        double n = film / outside, s = (cos_1 - n * cos_2) / (cos_1 + n * cos_2);
        double p = (n * cos_1 - cos_2) / (n * cos_1 + cos_2);
        r12 = 0.5 * (s * s + p * p);
    }
    for (int i = 0; i < 3; i++) {
        double base = outside * (1 + sqrt(f0[i])) / (1 - sqrt(f0[i]));
        double r1 = pow((base - film) / (base + film), 2);
        double r23 = r1 + (1 - r1) * pow(1 - cos_2, 5), rs;
        shift[i] = (film < outside ? 0 : M_PI) + (base < film ? M_PI : 0);
        rs = (1 - r12) * (1 - r12) * r23 / (1 - r12 * r23);
        root[i] = sqrt(r12 * r23);
        c0[i] = r12 + rs;
        c1[i] = rs - (1 - r12);
        out[i] = c0[i];
    }
    for (int m = 1; m <= 2; m++) {
        double phase = 2 * M_PI * m * 2 * film * nm * cos_2 * 1e-9, xyz[3];
        for (int i = 0; i < 3; i++)
            xyz[i] = VALUE[i] * sqrt(2 * M_PI * VARIANCE[i]) * cos(POSITION[i] * phase + m * shift[i]) *
                     exp(-phase * phase * VARIANCE[i]);
        xyz[0] += VALUE[3] * sqrt(2 * M_PI * VARIANCE[3]) * cos(POSITION[3] * phase + m * shift[0]) *
                  exp(-phase * phase * VARIANCE[3]);
        for (int i = 0; i < 3; i++) {
            double s = 0;
            for (int k = 0; k < 3; k++)
                s += TO_RGB[i][k] * xyz[k] / 1.0685e-7;
            c1[i] *= root[i];
            out[i] += c1[i] * 2 * s;
        }
    }
    for (int i = 0; i < 3; i++)
        out[i] = fmin(1, fmax(0, out[i]));
}

static void film_matches_its_definition(void **state)
{
    static const double F0[][3] = {{0.04, 0.04, 0.04}, {0.9, 0.6, 0.2}, {0, 0.02, 0.5}};

    (void)state;
    for (int k = 0; k < 3; k++)
        for (float nm = 1; nm < 1500; nm *= 1.21f)
            for (float n = 1.03f; n < 2.6f; n += 0.25f)
                for (float c = 0.02f; c <= 1; c += 0.07f)
                    for (int wet = 0; wet < 2; wet++) {
                        double want[3], outside = wet ? 1.33 : 1, t = fmin(1, (double)nm / 30);
                        float ior = (float)(1 + ((double)n / outside - 1) * t * t * (3 - 2 * t));
                        struct vec3 f0 = {(float)F0[k][0], (float)F0[k][1], (float)F0[k][2]}, got;
                        got = thin_film_reflectance(ior, 2 * ior * (float)outside * nm, c, f0);
                        film_by_definition(outside, (double)n, (double)nm, (double)c, F0[k], want);
                        if (fabs((double)got.x - want[0]) > 2e-4 || fabs((double)got.y - want[1]) > 2e-4 ||
                            fabs((double)got.z - want[2]) > 2e-4)
                            fail_msg("F0 %d, ior %g, %g nm, cos %g: %g %g %g, should be %g %g %g", k, (double)n,
                                     (double)nm, (double)c, (double)got.x, (double)got.y, (double)got.z, want[0],
                                     want[1], want[2]);
                    }
}

static void film_response_is_bounded(void **state)
{
    float most = 0;

    (void)state;
    for (float path = 0; path < 20000; path += 0.5f)
        for (int half = 0; half < 2; half++) {
            struct vec3 s = thin_film_response(path, vec3_splat((float)half));
            most = fmaxf(most, fmaxf(fabsf(s.x), fmaxf(fabsf(s.y), fabsf(s.z))));
        }
    if (!(most < FILM_RESPONSE_MAX && most > 1.1f))
        fail_msg("%g", (double)most);
}

/* A film without thickness, and one of its surroundings' index, is none, on every kind. */
static void no_film_is_no_film(void **state)
{
    struct test_random r = {5};

    (void)state;
    for (int i = 0; i < 20000; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0.01f), q;
        struct vec3 wo = random_direction(&r, 0.01f), wi = random_direction(&r, -1), f, g;
        p.ior_outside = 0;
        p.thin_slab = 0; /* its smooth form has another term */
        p.iridescence = 0;
        q = p;
        q.iridescence = 1;
        q.iridescence_ior = i & 1 ? 1.4f : 1;
        q.iridescence_thickness_nm = i & 1 ? 0 : 300;
        /* The layer below is scaled for the brightest film, which this has none of. */
        p.single_scattering = q.single_scattering = 1;
        if (p.metallic < 1 && !p.conductor && p.ior < 1.25f)
            continue; /* the film has no fading of F90 */
        f = value(&p, wo, wi);
        g = value(&q, wo, wi);
        if (vec3_length(vec3_sub(f, g)) > 2e-3f * vec3_length(f) + 1e-6f)
            describe_and_fail(&q, wo, wi, "a film that is none shows");
    }
}

/* Charlie's formulas in double. */
static void sheen_matches_its_definition(void **state)
{
    static const double ENDS[5][2] = {{21.5473, 25.3245}, {3.82987, 3.32435}, {0.19823, 0.16801},
                                      {-1.97760, -1.27393}, {-4.32054, -4.85967}};
    struct test_random r = {6};

    (void)state;
    for (int i = 0; i < 20000; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, 0.3f);
        double a = 0.1 + 0.9 * test_random_double(&r), c[5], lambda[2], t = (1 - a) * (1 - a);
        struct vec3 wo = random_direction(&r, 0.02f), wi = random_direction(&r, 0.02f), h, f;
        double mu[2] = {(double)wo.z, (double)wi.z}, want;
        p.base_color = (struct vec3){0, 0, 0};
        p.specular = 0;
        p.sheen_color = (struct vec3){1, 0.5f, 0};
        p.sheen_alpha = (float)a;
        for (int k = 0; k < 5; k++)
            c[k] = ENDS[k][0] + (ENDS[k][1] - ENDS[k][0]) * t;
#define CURVE(x) (c[0] / (1 + c[1] * pow(x, c[2])) + c[3] * (x) + c[4])
        for (int k = 0; k < 2; k++)
            lambda[k] = exp(mu[k] < 0.5 ? CURVE(mu[k]) : 2 * CURVE(0.5) - CURVE(1 - mu[k]));
        h = vec3_normalize(vec3_add(wo, wi));
        want = (2 + 1 / a) * pow(1 - (double)h.z * (double)h.z, 0.5 / a) / (2 * M_PI) /
               ((1 + lambda[0] + lambda[1]) * 4 * mu[0] * mu[1]);
        f = value(&p, wo, wi);
        if (fabs((double)f.x - want * mu[1]) > 2e-4 * want * mu[1] + 1e-7 || f.y != 0.5f * f.x)
            describe_and_fail(&p, wo, wi, "not Charlie's");
    }
}

/* ---- limits ------------------------------------------------------------------------------------ */

static void absent_layers_change_nothing(void **state)
{
    struct test_random r = {7};

    (void)state;
    for (int i = 0; i < 40000; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0.02f), q;
        struct vec3 wo = random_direction(&r, 0.05f), wi = random_direction(&r, -1), f, g;
        const char *what = "";
        float tolerance = 1e-3f;
        p.clearcoat = p.iridescence = p.alpha_stretched = p.diffuse_transmission = 0;
        p.sheen_color = (struct vec3){0, 0, 0};
        p.base_interreflection = 0;
        q = p;
        switch (i % 6) {
        case 0:
            what = "clearcoat 1e-4";
            q.clearcoat = 1e-4f;
            q.clearcoat_alpha = 0.3f;
            q.clearcoat_ior = 1.5f;
            q.clearcoat_normal = (struct vec3){0, 0, 1};
            tolerance = 0.03f; /* the Lambert base under two layers: layering.h */
            break;
        case 1:
            what = "sheen 1e-4";
            q.sheen_color = (struct vec3){1e-4f, 1e-4f, 1e-4f};
            q.sheen_alpha = 0.5f;
            break;
        case 2:
            what = "iridescence 1e-4";
            q.iridescence = 1e-4f;
            q.iridescence_ior = 1.4f;
            q.iridescence_thickness_nm = 400;
            break;
        case 3:
            what = "anisotropy 1e-5";
            /* The stretched loss has a coarser table: looks_are_continuous compares that. */
            p.single_scattering = q.single_scattering = 1;
            q.alpha_stretched = p.alpha * 1.00001f;
            break;
        case 4:
            what = "diffuse transmission 1e-5";
            q.diffuse_transmission = 1e-5f;
            q.diffuse_transmission_color = (struct vec3){1, 1, 1};
            break;
        default:
            /* It brings the exact Fresnel term along, but where the index is out of its range. */
            what = "base interreflection 1e-5";
            p.ior = q.ior = i % 4 < 2 ? 1.15f : 3.5f;
            p.ior_outside = q.ior_outside = 1;
            q.base_interreflection = 1e-5f;
            break;
        }
        f = value(&p, wo, wi);
        g = value(&q, wo, wi);
        if (vec3_length(vec3_sub(f, g)) > tolerance * vec3_length(f) + 1e-4f)
            describe_and_fail(&q, wo, wi, what);
    }
}

static void index_of_the_surroundings_is_no_interface(void **state)
{
    struct test_random r = {8};

    (void)state;
    for (int i = 0; i < 4000; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, i & 1 ? 0.3f : 0);
        struct vec3 wo = random_direction(&r, 0.01f), wi = random_direction(&r, -1);
        struct bsdf_sample s;
        struct bsdf b;
        p.ior = p.ior_outside = 1 + 1.5f * test_random_float(&r);
        p.refractive = i / 2 & 1;
        p.inside = i / 4 & 1;
        p.transmission = 1;
        bsdf_init(&b, &p, wo);
        assert_true(b.eta == 1);
        assert_true(bsdf_sample(&b, wo, test_random_float(&r), 0.3f, 0.4f, &s));
        assert_true(s.wi.x == -wo.x && s.wi.z == -wo.z && is_near_vec(s.weight, p.base_color, 1e-6f));
        p.transmission = 0; /* and opaque, it is Lambert's */
        bsdf_init(&b, &p, wo);
        assert_true(b.kind == BSDF_KIND_LAMBERT);
        assert_true(bsdf_eval(&b, wo, wi).x == p.base_color.x * INV_PI_F * fmaxf(wi.z, 0));
    }
}

/* Glass in water bends by the relative index; a bubble of air in water reflects totally from
 * the water, never from its inside. */
static void relative_indices_obey_snell(void **state)
{
    static const struct { float ior, outside; } CASES[] = {{1.5f, 1.33f}, {1, 1.33f}, {1.33f, 2.4f}};

    (void)state;
    for (int k = 0; k < 3; k++)
        for (int inside = 0; inside < 2; inside++)
            for (float c = 0.04f; c <= 1; c += 0.04f) {
                struct bsdf_params p = bsdf_maker_plain(0, 0);
                struct vec3 wo = direction(c, 1);
                float eta = CASES[k].ior / CASES[k].outside, sine, reflected = 0;
                int transmitted = 0;
                struct bsdf b;
                enum { STEPS = 2000 };
                p.ior = CASES[k].ior;
                p.ior_outside = CASES[k].outside;
                p.transmission = 1;
                p.refractive = 1;
                p.inside = inside;
                eta = inside ? 1 / eta : eta;
                sine = sqrtf(1 - c * c) / eta;
                bsdf_init(&b, &p, wo);
                assert_true(is_near(b.eta, eta, 1e-6f));
                for (int i = 0; i < STEPS; i++) {
                    struct bsdf_sample s;
                    assert_true(bsdf_sample(&b, wo, ((float)i + 0.5f) / STEPS, 0.5f, 0.5f, &s));
                    reflected += s.wi.z > 0 ? s.weight.x / STEPS : 0;
                    if (s.wi.z > 0)
                        continue;
                    transmitted++;
                    assert_true(is_near(hypotf(s.wi.x, s.wi.y), sine, 1e-4f));
                    assert_true(is_near(s.eta_scale, eta * eta, 1e-5f));
                }
                assert_true((transmitted > 0) == (sine < 1));
                assert_true(fabsf(reflected - fresnel_dielectric(c, eta)) < 2.0f / STEPS);
            }
}

/* All indices twice as large, a film half as thick: only ratios count, and doubling is exact, so the bits stay. A film
 * fades below FILM_FADE_NM, a length of its own. */
static void only_ratios_of_indices_count(void **state)
{
    struct test_random r = {12};
    int films = 0, walls = 0;

    (void)state;
    for (int i = 0; i < 60000; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0), q;
        struct vec3 wo = random_direction(&r, 0.01f), wi = random_direction(&r, -1), f, g;
        struct bsdf_sample s = {0}, t = {0};
        float w = test_random_float(&r), u = test_random_float(&r), v = test_random_float(&r);
        struct bsdf a, b;
        if (p.iridescence > 0)
            p.iridescence_thickness_nm += 2 * FILM_FADE_NM;
        p.eta = vec3_add(p.eta, vec3_splat(1e-3f)); /* away from its limit */
        if (!(p.ior_outside > 1))
            p.ior_outside = 1;
        q = p;
        q.ior *= 2;
        q.ior_outside *= 2;
        q.eta = vec3_scale(p.eta, 2);
        q.k = vec3_scale(p.k, 2);
        q.clearcoat_ior *= 2;
        q.iridescence_ior *= 2;
        q.iridescence_thickness_nm /= 2;
        bsdf_init(&a, &p, wo);
        bsdf_init(&b, &q, wo);
        f = bsdf_eval(&a, wo, wi);
        g = bsdf_eval(&b, wo, wi);
        if (memcmp(&f, &g, sizeof f) != 0 || bsdf_sample(&a, wo, w, u, v, &s) != bsdf_sample(&b, wo, w, u, v, &t) ||
            memcmp(&s.wi, &t.wi, sizeof s.wi) != 0 || memcmp(&s.weight, &t.weight, sizeof s.weight) != 0)
            describe_and_fail(&p, wo, wi, "twice the indices");
        films += p.iridescence > 0 && vec3_max(f) > 0;
        walls += p.transmission > 0 && !p.refractive && vec3_max(f) > 0;
    }
    assert_true(films > 5000 && walls > 5000);
}

/* A wall without thickness of one index in another reflects and blurs as the other in the one. */
static void a_wall_in_glass_is_a_wall_of_glass(void **state)
{
    struct test_random r = {13};
    int through = 0;

    (void)state;
    for (int i = 0; i < 40000; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, 0.05f + 0.95f * test_random_float(&r)), q;
        struct vec3 wo = random_direction(&r, 0.01f), wi = random_direction(&r, -1), f, g;
        p.transmission = 1;
        p.thin_slab = i & 1;
        p.alpha_stretched = i & 2 ? p.alpha + (1 - p.alpha) * test_random_float(&r) : 0;
        p.ior = 1 + test_random_float(&r);
        p.ior_outside = 1 + test_random_float(&r);
        q = p;
        q.ior = p.ior_outside;
        q.ior_outside = p.ior;
        f = value(&p, wo, wi);
        g = value(&q, wo, wi);
        if (!is_near_vec(f, g, 2e-3f))
            describe_and_fail(&p, wo, wi, "a wall and its surroundings exchanged");
        through += wi.z < 0 && vec3_max(f) > 1e-3f;
    }
    assert_true(through > 10000);
}

static void a_slab_counts_all_its_reflections(void **state)
{
    (void)state;
    for (float c = 0.1f; c <= 1; c += 0.1f) {
        struct bsdf_params p = bsdf_maker_plain(0, 0);
        struct vec3 wo = direction(c, 0.3f), sum[2] = {{0, 0, 0}, {0, 0, 0}};
        float r = fresnel_dielectric(c, 1.5f), expected = 2 * r / (1 + r);
        struct bsdf b;
        enum { STEPS = 4000 };
        p.base_color = (struct vec3){1, 1, 1};
        p.transmission = 1;
        p.thin_slab = 1;
        bsdf_init(&b, &p, wo);
        for (int i = 0; i < STEPS; i++) {
            struct bsdf_sample s;
            assert_true(bsdf_sample(&b, wo, ((float)i + 0.5f) / STEPS, 0.5f, 0.5f, &s));
            sum[s.wi.z < 0] = vec3_add(sum[s.wi.z < 0], vec3_scale(s.weight, 1.0f / STEPS));
        }
        assert_true(fabsf(sum[0].x - expected) < 1e-3f);
        assert_true(fabsf(sum[1].x - (1 - expected)) < 1e-3f);
    }
}

static void light_through_the_base_is_lambert(void **state)
{
    struct bsdf_params p = bsdf_maker_plain(0, 0.5f);
    struct test_random r = {9};

    (void)state;
    p.specular = 0;
    p.diffuse_transmission = 0.25f;
    p.diffuse_transmission_color = (struct vec3){0.1f, 0.9f, 0.4f};
    for (int i = 0; i < 10000; i++) {
        struct vec3 wo = random_direction(&r, 0.01f), wi = random_direction(&r, -1), f;
        f = value(&p, wo, wi);
        assert_true(is_near(f.y, (wi.z > 0 ? 0.75f * p.base_color.y : 0.25f * 0.9f) * INV_PI_F * fabsf(wi.z), 1e-5f));
    }
}

static void interreflection_darkens_the_base(void **state)
{
    struct bsdf_params p = bsdf_maker_plain(0, 0.5f);
    struct vec3 wo = {0.6f, 0, 0.8f}, wi = {0, 0.6f, 0.8f}, f;

    (void)state;
    p.specular = 0;
    p.base_interreflection = 0.6f;
    f = value(&p, wo, wi);
    assert_true(is_near(f.y, 0.5f * 0.4f / (1 - 0.6f * 0.5f) * INV_PI_F * 0.8f, 1e-5f));
    p.base_color = (struct vec3){1, 1, 1};
    f = value(&p, wo, wi);
    assert_true(is_near(f.y, INV_PI_F * 0.8f, 1e-5f)); /* white stays white */
    p.conductor = 1;                                   /* and what a conductor reflects likewise */
    p.alpha = 0;
    p.eta = p.k = vec3_splat(1);
    {
        float plain = fresnel_conductor(0.8f, 1, 1);
        struct bsdf_sample s;
        struct bsdf b;
        bsdf_init(&b, &p, wo);
        assert_true(bsdf_sample(&b, wo, 0.5f, 0.5f, 0.5f, &s));
        assert_true(is_near(s.weight.y, plain * 0.4f / (1 - 0.6f * plain), 1e-5f));
    }
}

/* Coat: its smooth form is a mirror about its own normal with glTF's weight, what is below is
 * dimmed by it. */
static void a_smooth_coat_is_a_mirror_over_the_base(void **state)
{
    struct bsdf_params p = bsdf_maker_plain(1, 0.4f);
    struct vec3 n = vec3_normalize((struct vec3){0.2f, -0.1f, 1});

    (void)state;
    p.clearcoat = 0.5f;
    p.clearcoat_ior = 1.5f;
    p.clearcoat_normal = n;
    for (float c = 0.3f; c <= 1; c += 0.1f) {
        struct vec3 wo = direction(c, 2), wi = direction(0.9f, 1), expected;
        float cosine = vec3_dot(wo, n), f = 0.04f + 0.96f * powf(1 - cosine, 5), sum = 0, below;
        struct bsdf_params bare = p;
        struct bsdf b;
        enum { STEPS = 20000 };
        bsdf_init(&b, &p, wo);
        assert_true(b.has_delta && b.has_smooth);
        expected = vec3_sub(vec3_scale(n, 2 * cosine), wo);
        if (expected.z < 0.01f)
            continue; /* the mirror direction dives under the surface */
        for (int i = 0; i < STEPS; i++) {
            struct bsdf_sample s;
            if (!bsdf_sample(&b, wo, ((float)i + 0.5f) / STEPS, 0.3f, 0.6f, &s) || !(s.flags & BSDF_DELTA))
                continue;
            assert_true(vec3_length(vec3_sub(s.wi, expected)) < 1e-5f);
            sum += s.weight.x / STEPS;
        }
        if (!is_near(sum, 0.5f * f, 2e-2f))
            fail_msg("cos %g: %g, should be %g", (double)c, (double)sum, (double)(0.5f * f));
        bare.clearcoat = 0;
        below = 1 - 0.5f * fmaxf(f, 0.04f + 0.96f * powf(1 - vec3_dot(wi, n), 5));
        assert_true(is_near_vec(bsdf_eval(&b, wo, wi), vec3_scale(value(&bare, wo, wi), below), 1e-4f));
    }
}

/* Stretched: GGX's definition, with the slopes scaled apart. */
static void stretched_ggx_matches_its_definition(void **state)
{
    struct test_random r = {10};

    (void)state;
    for (int i = 0; i < 20000; i++) {
        struct bsdf_params p = bsdf_maker_plain(1, 0.05f + 0.9f * test_random_float(&r));
        struct vec3 wo = random_direction(&r, 0.05f), wi = random_direction(&r, 0.05f), h;
        double ax, ay, d, g, want, lambda[2];
        p.alpha_stretched = p.alpha + (1 - p.alpha) * test_random_float(&r);
        p.base_color = (struct vec3){1, 1, 1};
        p.single_scattering = 1;
        ax = (double)p.alpha_stretched;
        ay = (double)p.alpha;
        h = vec3_normalize(vec3_add(wo, wi));
        d = pow((double)h.x / ax, 2) + pow((double)h.y / ay, 2) + pow((double)h.z, 2);
        d = 1 / (M_PI * ax * ay * d * d);
        for (int k = 0; k < 2; k++) {
            const struct vec3 *w = k ? &wi : &wo;
            double tan2 = (pow(ax * (double)w->x, 2) + pow(ay * (double)w->y, 2)) / pow((double)w->z, 2);
            lambda[k] = 0.5 * (sqrt(1 + tan2) - 1);
        }
        g = 1 / (1 + lambda[0] + lambda[1]);
        want = d * g / (4 * (double)wo.z);
        if (!is_near(value(&p, wo, wi).x, (float)want, 2e-4f))
            describe_and_fail(&p, wo, wi, "not GGX");
    }
}

/* ---- dispersion --------------------------------------------------------------------------------- */

static void dispersion_has_the_abbe_number(void **state)
{
    (void)state;
    for (float dispersion = 0.2f; dispersion < 3; dispersion += 0.4f) {
        float n = 1.6f, abbe;
        assert_true(is_near(dispersion_ior(n, dispersion, 587.56f), n, 1e-4f));
        abbe = (n - 1) / (dispersion_ior(n, dispersion, 486.13f) - dispersion_ior(n, dispersion, 656.27f));
        assert_true(is_near(abbe, 20 / dispersion, 5e-3f));
        for (float nm = 380; nm < 720; nm += 10)
            assert_true(dispersion_ior(n, dispersion, nm) > dispersion_ior(n, dispersion, nm + 10));
    }
    assert_true(dispersion_ior(1.5f, 0, 400) == 1.5f && dispersion_ior(0, 2, 400) == 0);
    assert_true(dispersion_ior(1.0f, 2, 400) == 1 && dispersion_ior(1.01f, 1e30f, 700) == 1);
    assert_true(isfinite(dispersion_ior(2, INFINITY, 400)) && dispersion_ior(2, NAN, 400) == 2);
}

static void wavelengths_add_up_to_white(void **state)
{
    double sum[3] = {0, 0, 0};
    float last = 0;
    struct vec3 w;
    enum { STEPS = 200000 };

    (void)state;
    for (int i = 0; i < STEPS; i++) {
        float nm = wavelength_sample(((float)i + 0.5f) / STEPS, &w);
        assert_true(nm >= DISPERSION_NM_MIN && nm <= DISPERSION_NM_MAX && nm >= last);
        assert_true(vec3_is_finite(w) && vec3_max(w) < 8 && vec3_min(w) > -3);
        last = nm;
        sum[0] += (double)w.x / STEPS;
        sum[1] += (double)w.y / STEPS;
        sum[2] += (double)w.z / STEPS;
    }
    for (int i = 0; i < 3; i++)
        if (fabs(sum[i] - 1) > 1e-5)
            fail_msg("component %d: %.7f", i, sum[i]);
    assert_true(wavelength_sample(0, &w) < 380.1f && wavelength_sample(ONE_MINUS_EPSILON, &w) > 719.9f);
    for (float u = 0; u < 1; u += 0.001f) { /* blue is blue, green green, red red */
        float nm = wavelength_sample(u, &w);
        if (nm > 440 && nm < 470)
            assert_true(w.z > w.x && w.z > w.y);
        if (nm > 520 && nm < 550)
            assert_true(w.y > w.x && w.y > w.z);
        if (nm > 620 && nm < 700)
            if (!(w.x > w.y && w.x > w.z))
                fail_msg("%g nm: %g %g %g", (double)nm, (double)w.x, (double)w.y, (double)w.z);
    }
}

/* ---- agreement ----------------------------------------------------------------------------------- */

static void functions_agree_with_each_other(void **state)
{
    struct test_random r = {2};
    int checked = 0;

    (void)state;
    for (int i = 0; i < 200000; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0);
        checked += check_agreement(&p, &r);
    }
    assert_true(checked > 80000);
}

/* How far the two ways may differ in float: refraction's half vector has the fewest digits. */
#define REFLECTION_ERROR 2e-3f
#define REFRACTION_ERROR 0.03f

static void scattering_is_reciprocal(void **state)
{
    struct test_random r = {3};
    int counts[WAY_NONE + 1] = {0};

    (void)state;
    for (int i = 0; i < 300000; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0.05f);
        /* Refraction scales radiance by n^2, light through the base does not. */
        if (p.refractive && p.diffuse_transmission > 0 && !p.conductor)
            p.transmission = 0;
        /* With a normal of its own a coat is reciprocal in its own frame only, like any normal map: below. */
        p.clearcoat_normal = (struct vec3){0, 0, 1};
        counts[check_reciprocity(&p, &r, i & 1, REFLECTION_ERROR, REFRACTION_ERROR)]++;
    }
    assert_true(counts[WAY_REFLECTED] > 10000 && counts[WAY_THROUGH] > 5000 && counts[WAY_REFRACTED] > 2000);
}

/* Each kind by itself, over a grid of alphas and directions: f(wo, wi) = f(wi, wo), and across a
 * refracting interface n^2 f. No layering here is an exception: what lies below a coat or a sheen
 * is scaled by the lesser share that it leaves along the two directions. */
static void every_kind_is_reciprocal(void **state)
{
    static const float ALPHAS[] = {1e-3f, 0.05f, 0.2f, 0.6f, 1}, MU[] = {0.05f, 0.2f, 0.5f, 0.9f};
    enum { TURNS = 8, PAIRS = 4 * 4 * TURNS * 2 };

    (void)state;
    for (int k = 0; k < BSDF_MAKER_KINDS; k++) {
        int above = 0, below = 0;
        for (int i = 0; i < 5 * PAIRS; i++) {
            struct bsdf_params p = bsdf_maker_kind(k, ALPHAS[i / PAIRS]), back = p;
            float side = i / TURNS / 16 % 2 ? -1 : 1, turn = 0.3f + 0.7853982f * (float)(i % TURNS);
            struct vec3 wo = direction(MU[i / TURNS % 4], 0.4f);
            struct vec3 wi = direction(MU[i / TURNS / 4 % 4], turn), f, g;
            struct bsdf b;
            float scale = 1;
            bsdf_init(&b, &p, wo);
            if (side < 0) {
                back = bsdf_maker_other_side(&p);
                scale = p.refractive ? b.eta * b.eta : 1;
            }
            f = vec3_scale(bsdf_eval(&b, wo, (struct vec3){wi.x, wi.y, wi.z * side}),
                           scale / wi.z);
            g = vec3_scale(value(&back, wi, (struct vec3){wo.x, wo.y, wo.z * side}), 1 / wo.z);
            if (vec3_max(f) < 1e-3f && vec3_max(g) < 1e-3f)
                continue;
            if (!is_near_vec(f, g, side < 0 && p.refractive ? REFRACTION_ERROR : REFLECTION_ERROR))
                fail_msg("%s, alpha %g, %s: %g %g %g and %g %g %g", bsdf_maker_kind_name(k), (double)ALPHAS[i / PAIRS],
                         side > 0 ? "above" : "below", (double)f.x, (double)f.y, (double)f.z, (double)g.x, (double)g.y,
                         (double)g.z);
            *(side > 0 ? &above : &below) += 1;
        }
        struct bsdf_params p = bsdf_maker_kind(k, 0.5f);
        if (above < 50 || (below < 20) == (p.transmission > 0 || p.diffuse_transmission > 0))
            fail_msg("%s: %d pairs above, %d below", bsdf_maker_kind_name(k), above, below);
    }
}

/* f |n.wi| over its own cosine is what is symmetric for a coat with a normal of its own; what
 * lies below it stays symmetric in the base's frame. */
static void a_tilted_coat_is_reciprocal_in_its_frame(void **state)
{
    struct test_random r = {31};

    (void)state;
    for (int i = 0; i < 50000; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, 0.2f), bare;
        struct vec3 wo = random_direction(&r, 0.05f), wi = random_direction(&r, 0.05f), n, f, g;
        p.base_color = (struct vec3){0, 0, 0};
        p.specular = 0;
        p.clearcoat = 0.7f;
        p.clearcoat_alpha = 0.1f + 0.9f * test_random_float(&r);
        p.clearcoat_ior = 1.5f;
        n = p.clearcoat_normal = vec3_normalize((struct vec3){0.3f, -0.2f, 1});
        if (vec3_dot(n, wo) < 0.02f || vec3_dot(n, wi) < 0.02f)
            continue;
        f = vec3_scale(value(&p, wo, wi), 1 / vec3_dot(n, wi));
        g = vec3_scale(value(&p, wi, wo), 1 / vec3_dot(n, wo));
        if (!is_near(f.x, g.x, 1e-3f) && f.x > 1e-4f)
            describe_and_fail(&p, wo, wi, "coat not reciprocal");
        p.base_color = (struct vec3){1, 1, 1};
        bare = p;
        bare.base_color = (struct vec3){0, 0, 0};
        f = vec3_scale(vec3_sub(value(&p, wo, wi), value(&bare, wo, wi)), 1 / wi.z);
        g = vec3_scale(vec3_sub(value(&p, wi, wo), value(&bare, wi, wo)), 1 / wo.z);
        if (fabsf(f.x - g.x) > 1e-4f)
            describe_and_fail(&p, wo, wi, "base under the coat not reciprocal");
    }
}

/* ---- hostile input ------------------------------------------------------------------------------ */

static struct bsdf_params hostile_params(struct test_random *r)
{
    struct bsdf_params p = {.base_color = hostile_color(r), .metallic = hostile_float(r),
                            .alpha = hostile_float(r), .ior = hostile_float(r),
                            .specular = hostile_float(r), .specular_color = hostile_color(r),
                            .transmission = hostile_float(r)};
    unsigned what = (unsigned)test_random_u64(r);

    p.refractive = what & 1;
    p.inside = what >> 1 & 1;
    p.single_scattering = what >> 2 & 1;
    p.thin_slab = what >> 3 & 1;
    if (what & 16)
        p.ior_outside = hostile_float(r);
    if (what & 32)
        p.alpha_stretched = hostile_float(r);
    if ((what & 192) == 192) {
        p.conductor = 1;
        p.eta = hostile_color(r);
        p.k = hostile_color(r);
    }
    if (what & 256) {
        p.clearcoat = hostile_float(r);
        p.clearcoat_alpha = hostile_float(r);
        p.clearcoat_ior = hostile_float(r);
        p.clearcoat_normal = what & 512 ? hostile_color(r) : random_direction(r, -1);
    }
    if (what & 1024) {
        p.sheen_color = hostile_color(r);
        p.sheen_alpha = hostile_float(r);
    }
    if (what & 2048) {
        p.iridescence = hostile_float(r);
        p.iridescence_ior = hostile_float(r);
        p.iridescence_thickness_nm = what & 4096 ? hostile_float(r) : 1000 * test_random_float(r);
    }
    if (what & 8192) {
        p.diffuse_transmission = hostile_float(r);
        p.diffuse_transmission_color = hostile_color(r);
    }
    if ((what >> 14 & 3) == 0)
        p.base_interreflection = hostile_float(r);
#define HOSTILE(effect, member)          \
    if (test_random_u64(r) % 8 == 0) \
        member = hostile_float(r);
#define OF_PARAMS(name) p.name
    BSDF_FACTOR_MAP(HOSTILE, OF_PARAMS)
#undef OF_PARAMS
#undef HOSTILE
    return p;
}

static void hostile_parameters_do_no_harm(void **state)
{
    struct test_random r = {4};
    int sampled = 0;

    (void)state;
    for (int i = 0; i < 1000000; i++) {
        struct bsdf_params p = hostile_params(&r);
        sampled += check_harmless(&p, &r, 400);
    }
    assert_true(sampled > 200000);
}

/* ---- continuity ---------------------------------------------------------------------------------- */

static void looks_are_continuous(void **state)
{
    struct bsdf_params p, q;

    (void)state;
    p = bsdf_maker_plain(0, 0.3f);
    p.clearcoat = 1;
    p.clearcoat_ior = 1.5f;
    p.clearcoat_normal = vec3_normalize((struct vec3){0.1f, 0.1f, 1});
    p.clearcoat_alpha = 9e-4f;
    q = p;
    q.clearcoat_alpha = 1.1e-3f;
    assert_same_look(&p, &q, 0.3f, 0.012, "smooth and nearly smooth coat");
    q.clearcoat_ior = 1;
    p.clearcoat = 0;
    q.clearcoat_normal = (struct vec3){0, 0, 1};
    assert_same_look(&p, &q, 0.3f, 0.012, "coat of ior 1 and none");

    p = bsdf_maker_plain(1, 9e-4f);
    p.conductor = 1;
    p.eta = (struct vec3){0.2f, 0.9f, 1.3f};
    p.k = (struct vec3){4, 2.4f, 1.9f};
    q = p;
    q.alpha = 1.1e-3f;
    assert_same_look(&p, &q, 0.3f, 0.012, "smooth and nearly smooth conductor");
    q.alpha_stretched = 1.2e-3f;
    q.alpha = 0;
    assert_same_look(&p, &q, 0.3f, 0.012, "smooth and nearly smooth stretched");
    p.alpha = 0.2f;
    q = p;
    q.alpha_stretched = 0.2001f;
    assert_same_look(&p, &q, 0.3f, 0.012, "stretched and nearly not");
    p.alpha = q.alpha = 0.9999f;
    q.alpha_stretched = 1;
    assert_same_look(&p, &q, 0.3f, 0.012, "roughness 1 knows no stretching");

    /* A conductor without absorption reflects like the interface of a dielectric. */
    for (int rough = 0; rough < 2; rough++) {
        p = bsdf_maker_plain(0, rough ? 0.3f : 0);
        p.base_color = (struct vec3){1, 1, 1};
        p.transmission = 1;
        p.refractive = 1;
        p.single_scattering = 1;
        q = p;
        q.conductor = 1;
        q.eta = vec3_splat(1.5f);
        for (float c = 0.1f; c <= 1; c += 0.3f) {
            double a = shares_of(&p, direction(c, 1)).reflected;
            double b = shares_of(&q, direction(c, 1)).reflected;
            assert_true(fabs(a - b) < 5e-3);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(conductor_fresnel_matches_complex_arithmetic),
        cmocka_unit_test(film_matches_its_definition),
        cmocka_unit_test(film_response_is_bounded),
        cmocka_unit_test(no_film_is_no_film),
        cmocka_unit_test(sheen_matches_its_definition),
        cmocka_unit_test(absent_layers_change_nothing),
        cmocka_unit_test(index_of_the_surroundings_is_no_interface),
        cmocka_unit_test(relative_indices_obey_snell),
        cmocka_unit_test(only_ratios_of_indices_count),
        cmocka_unit_test(a_wall_in_glass_is_a_wall_of_glass),
        cmocka_unit_test(a_slab_counts_all_its_reflections),
        cmocka_unit_test(light_through_the_base_is_lambert),
        cmocka_unit_test(interreflection_darkens_the_base),
        cmocka_unit_test(a_smooth_coat_is_a_mirror_over_the_base),
        cmocka_unit_test(stretched_ggx_matches_its_definition),
        cmocka_unit_test(dispersion_has_the_abbe_number),
        cmocka_unit_test(wavelengths_add_up_to_white),
        cmocka_unit_test(functions_agree_with_each_other),
        cmocka_unit_test(scattering_is_reciprocal),
        cmocka_unit_test(every_kind_is_reciprocal),
        cmocka_unit_test(a_tilted_coat_is_reciprocal_in_its_frame),
        cmocka_unit_test(looks_are_continuous),
        cmocka_unit_test(hostile_parameters_do_no_harm),
    };
    return cmocka_run_group_tests_name("bsdf_layers", tests, NULL, NULL);
}
