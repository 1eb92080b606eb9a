/* Each row of the table of lobes by itself: its samples follow its density (chi-square), and their
 * weights have the mean that its values have over the sphere (furnace), which is not more than 1.
 * The lobe is singled out of a prepared BSDF, so no other lobe can hide its fault. A new lobe needs
 * a material here, or this does not compile. Fixed seeds, family-wise level 0.01 (Sidak). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "tests/support/bsdf_checks.h"
#include "tests/support/chi_square.h"
#include "tests/support/statistics.h"

#define SIGNIFICANCE 0.01
/* What the tables of albedos may err by. */
#define TABLE 0.005

static const float ALPHAS[] = {0.12f, 0.6f}, COSINES[] = {0.05f, 0.4f, 1};
enum {
    COUNT_ALPHAS = sizeof ALPHAS / sizeof *ALPHAS,
    COUNT_COSINES = sizeof COSINES / sizeof *COSINES,
    CASES = BSDF_LOBES * COUNT_ALPHAS * COUNT_COSINES,
    SIDES = 2,
    SAMPLES = 30000,
    FURNACE = 100000,
};

static const char *const NAMES[] = {
#define NAME(name, ...) #name,
    BSDF_LOBE_MAP(NAME)
#undef NAME
};

/* A white surface that has the lobe, and a density for it. */
static struct bsdf_params material_with(enum bsdf_lobe lobe, float alpha)
{
    struct bsdf_params p = bsdf_maker_plain(0, alpha);

    p.base_color = (struct vec3){1, 1, 1};
    switch (lobe) {
    case BSDF_LOBE_DIFFUSE: /* with what plastic's microfacets return */ break;
    case BSDF_LOBE_REFLECTION:
        p.conductor = 1;
        p.eta = (struct vec3){0.2f, 0.9f, 1.3f};
        p.k = (struct vec3){4, 2.4f, 1.9f};
        break;
    case BSDF_LOBE_INTERFACE:
        p.transmission = 1;
        p.refractive = 1;
        break;
    case BSDF_LOBE_THIN_WALL: p.transmission = 1; break;
    case BSDF_LOBE_DIFFUSE_TRANSMISSION:
        p.diffuse_transmission = 0.7f;
        p.diffuse_transmission_color = (struct vec3){1, 1, 1};
        break;
    case BSDF_LOBE_COAT:
        p.clearcoat = 1;
        p.clearcoat_alpha = alpha;
        p.clearcoat_ior = 1.8f;
        p.clearcoat_normal = vec3_normalize((struct vec3){0.2f, 0.1f, 1});
        break;
    case BSDF_LOBE_SHEEN:
        p.sheen_color = (struct vec3){1, 1, 1};
        p.sheen_alpha = alpha;
        break;
    case BSDF_LOBES: fail();
    }
    return p;
}

struct subject {
    struct bsdf_subject at;
    enum bsdf_lobe lobe;
    float alpha;
};

/* Case i of CASES, its lobe singled out. */
static struct subject subject_make(int i)
{
    struct subject s = {.lobe = (enum bsdf_lobe)(i / (COUNT_ALPHAS * COUNT_COSINES)),
                        .alpha = ALPHAS[i / COUNT_COSINES % COUNT_ALPHAS]};
    struct bsdf_params p = material_with(s.lobe, s.alpha);
    float z = COSINES[i % COUNT_COSINES], sine = sqrtf(1 - z * z);

    s.at.wo = (struct vec3){sine * 0.6f, sine * -0.8f, z};
    bsdf_init(&s.at.bsdf, &p, s.at.wo);
    if (!(s.at.bsdf.smooth_lobes >> s.lobe & 1) || !(s.at.bsdf.lobe_pdf[s.lobe] > 0))
        fail_msg("%s: absent at alpha %g, cos %g", NAMES[s.lobe], (double)s.alpha, (double)z);
    s.at.bsdf.lobes = s.at.bsdf.smooth_lobes = 1u << s.lobe;
    if (s.lobe == BSDF_LOBE_INTERFACE) /* whose reflection that row evaluates */
        s.at.bsdf.smooth_lobes |= 1u << BSDF_LOBE_REFLECTION;
    for (int k = 0; k < BSDF_LOBES; k++)
        s.at.bsdf.lobe_pdf[k] = k == (int)s.lobe;
    return s;
}

static void samples_follow_each_density(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++)
        for (int side = 1; side >= -1; side -= 2) {
            struct subject s = subject_make(i);
            struct chi_square_setup setup = {.sample = bsdf_subject_sample, .pdf = bsdf_subject_pdf, .user = &s.at,
                                             .samples = SAMPLES, .seed = (uint64_t)i + 1};
            s.at.side = (float)side;
            if (!chi_square_accept(&setup, SIGNIFICANCE, CASES * SIDES, NAMES[s.lobe]))
                fail_msg("%s, alpha %g, cos %g, side %d: samples do not follow the density "
                         "(tables above)", NAMES[s.lobe], (double)s.alpha, (double)s.at.wo.z, side);
        }
}

/* Mean colour of what is sampled, and of what is evaluated in uniform directions. */
static void furnace(const struct subject *s, uint64_t seed, struct running_stats *sampled,
                    struct running_stats *evaluated, struct running_stats *power)
{
    struct test_random r = {seed};

    for (int i = 0; i < FURNACE; i++) {
        float u = test_random_float(&r), v = test_random_float(&r), w = test_random_float(&r);
        float z = 2 * test_random_float(&r) - 1, turn = 6.2831853f * test_random_float(&r);
        float sine = sqrtf(1 - z * z);
        struct vec3 wi = {sine * cosf(turn), sine * sinf(turn), z}, f;
        struct bsdf_sample out = {.eta_scale = 1};
        if (!bsdf_sample(&s->at.bsdf, s->at.wo, w, u, v, &out))
            out.weight = (struct vec3){0, 0, 0};
        f = vec3_scale(bsdf_eval(&s->at.bsdf, s->at.wo, wi), 4 * PI_F);
        running_stats_add(sampled, (double)vec3_average(out.weight));
        running_stats_add(power, (double)(vec3_max(out.weight) * out.eta_scale));
        running_stats_add(evaluated, (double)vec3_average(f));
    }
}

static void each_lobe_keeps_its_energy(void **state)
{
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, CASES * 3) / 2);

    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct subject s = subject_make(i);
        struct running_stats sampled = {0}, evaluated = {0}, power = {0};
        double error;
        furnace(&s, (uint64_t)i + 1, &sampled, &evaluated, &power);
        error = hypot(running_stats_error(&sampled), running_stats_error(&evaluated));
        if (fabs(sampled.mean - evaluated.mean) > z * error)
            fail_msg("%s, alpha %g, cos %g: %.5f is sampled, %.5f evaluated (+- %.5f)", NAMES[s.lobe], (double)s.alpha,
                     (double)s.at.wo.z, sampled.mean, evaluated.mean, error);
        if (power.mean > 1 + TABLE + z * running_stats_error(&power))
            fail_msg("%s, alpha %g, cos %g: sends out %.5f", NAMES[s.lobe], (double)s.alpha, (double)s.at.wo.z,
                     power.mean);
        if (!(power.mean > z * running_stats_error(&power)))
            fail_msg("%s, alpha %g, cos %g: sends out nothing", NAMES[s.lobe], (double)s.alpha, (double)s.at.wo.z);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(samples_follow_each_density),
        cmocka_unit_test(each_lobe_keeps_its_energy),
    };
    return cmocka_run_group_tests_name("bsdf_lobes", tests, NULL, NULL);
}
