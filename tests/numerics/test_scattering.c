/* Hard cases of scattering: surfaces whose numbers floats can hardly hold, in furnaces of radiance 1
 * (a white surface then shows 1) and under lamps, against closed forms.
 *
 * Refraction's 1/eta^2 of radiance is taken out by eta_scale, which leaves power. Seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "tests/support/bsdf_maker.h"
#include "tests/support/figure.h"
#include "tests/support/statistics.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/bsdf/bsdf.h"

#define SIGNIFICANCE 1e-4
/* What the tables may err by. */
#define TABLE 0.005
/* One float rounding of each of a few factors. */
#define ROUNDING 1e-5

static struct vec3 direction(float mu)
{
    float sine = sqrtf((1 - mu) * (1 + mu));

    return (struct vec3){sine * 0.8f, sine * 0.6f, mu};
}

static struct bsdf_params plastic(float alpha, float ior)
{
    return (struct bsdf_params){.base_color = {1, 1, 1}, .alpha = alpha, .ior = ior, .specular = 1,
                                .specular_color = {1, 1, 1}};
}

static struct bsdf_params metal(float alpha)
{
    struct bsdf_params p = plastic(alpha, 1.5f);

    p.metallic = 1;
    return p;
}

static struct bsdf_params glass(float alpha, float ior, int inside)
{
    struct bsdf_params p = plastic(alpha, ior);

    p.transmission = 1;
    p.refractive = 1;
    p.inside = inside;
    return p;
}

/* What a furnace shows of a surface. */
struct furnace {
    struct running_stats most;      /* of the channels, the brightest */
    struct running_stats reflected; /* its green part above the surface */
    double largest;                 /* sample */
    double error;                   /* of `most`, in which no number counts as infinite */
};

static struct furnace furnace(const struct bsdf_params *p, struct vec3 wo, int samples)
{
    struct furnace out = {{0}, {0}, 0, 0};
    struct running_stats channel[3] = {{0}};
    struct test_random random = {11};
    struct bsdf b;
    int most = 0;

    bsdf_init(&b, p, wo);
    for (int i = 0; i < samples; i++) {
        float u = test_random_float(&random), v = test_random_float(&random), w = test_random_float(&random);
        struct vec3 weight = {0, 0, 0};
        struct bsdf_sample s;
        if (bsdf_sample(&b, wo, w, u, v, &s))
            weight = vec3_scale(s.weight, s.eta_scale);
        running_stats_add(&channel[0], (double)weight.x);
        running_stats_add(&channel[1], (double)weight.y);
        running_stats_add(&channel[2], (double)weight.z);
        running_stats_add(&out.reflected, s.wi.z > 0 ? (double)weight.y : 0);
        out.largest = fmax(out.largest, (double)vec3_max(weight));
    }
    for (int c = 1; c < 3; c++)
        most = channel[c].mean > channel[most].mean ? c : most;
    out.most = channel[most];
    out.error = running_stats_error(&out.most);
    return out;
}

static void expect_white(const char *what, const struct bsdf_params *p, float mu)
{
    figure_within(what, furnace(p, direction(mu), 2000).most.mean, 1 - ROUNDING, 1 + ROUNDING,
                  "closed form, tolerance 1e-5");
}

/* At most what comes in, by one of `tests` one-sided tests, and at least `least` of it. */
static void expect_no_gain(const char *what, const struct bsdf_params *p, struct vec3 wo, double least, unsigned tests)
{
    struct furnace f = furnace(p, wo, 60000);
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, tests));
    char level[96];

    snprintf(level, sizeof level, "significance %g over %u tests, tables to %g", SIGNIFICANCE, tests, TABLE);
    figure_within(what, f.most.mean, least - z * f.error, 1 + TABLE + z * f.error, level);
}

/* ---- narrow lobes -------------------------------------------------------------------------------- */

static void roughness_0_is_a_mirror(void **state)
{
    struct bsdf_params p = metal(0), q = metal(1e-25f), coated = plastic(0.3f, 1.5f), brushed = metal(0);

    (void)state;
    expect_white("furnace of a white mirror, alpha 0", &p, 0.5f);
    expect_white("furnace of a white mirror, alpha 1e-25", &q, 0.5f);
    coated.base_color = coated.specular_color = vec3_splat(0);
    coated.specular = 0;
    coated.clearcoat = 1;
    coated.clearcoat_ior = 1.5f;
    coated.clearcoat_normal = (struct vec3){0, 0, 1};
    figure_within("a coat of alpha 0 over black, from above", furnace(&coated, direction(1), 2000).most.mean,
                  0.04 - 1e-6, 0.04 + 1e-6, "closed form, tolerance 1e-6");
    brushed.alpha_stretched = 0.3f;
    expect_no_gain("furnace of white metal brushed by alphas .3 and 0", &brushed, direction(0.5f), 0.93, 1);
}

/* The light of a round lamp, as wide as the lobe, that a mirror of this alpha shows where it reflects
 * the lamp's centre towards the viewer straight above: a sum over the lamp, in double, of the BSDF's
 * values, over the same sum of GGX's formula. */
static double lamp_in_mirror(const struct bsdf_params *p, struct vec3 normal, double alpha, double fresnel)
{
    enum { RINGS = 200, SPOKES = 24 };
    const struct vec3 wo = {0, 0, 1};
    double found = 0, right = 0, n[3] = {(double)normal.x, (double)normal.y, (double)normal.z};
    struct bsdf b;

    bsdf_init(&b, p, wo);
    for (int i = 0; i < RINGS * SPOKES; i++) {
        double angle = 2 * M_PI * (i % SPOKES) / SPOKES, radius = 2 * alpha * sqrt((i / SPOKES + 0.5) / RINGS);
        double center[3] = {2 * n[2] * n[0], 2 * n[2] * n[1], 2 * n[2] * n[2] - 1}, d[3], h[3], length, sine2, nh;
        double a2 = alpha * alpha, nwi, density, root_o, root_i;
        struct vec3 wi;
        d[0] = center[0] + radius * cos(angle);
        d[1] = center[1] + radius * sin(angle);
        d[2] = sqrt(1 - d[0] * d[0] - d[1] * d[1]);
        wi = (struct vec3){(float)d[0], (float)d[1], (float)d[2]};
        found += (double)bsdf_eval(&b, wo, wi).y / d[2];
        h[0] = d[0];
        h[1] = d[1];
        h[2] = d[2] + 1;
        length = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
        nh = (h[0] * n[0] + h[1] * n[1] + h[2] * n[2]) / length;
        sine2 = 0;
        for (int k = 0; k < 3; k++) {
            double cross = (n[(k + 1) % 3] * h[(k + 2) % 3] - n[(k + 2) % 3] * h[(k + 1) % 3]) / length;
            sine2 += cross * cross;
        }
        nwi = d[0] * n[0] + d[1] * n[1] + d[2] * n[2];
        root_o = sqrt(a2 + (1 - a2) * n[2] * n[2]);
        root_i = sqrt(a2 + (1 - a2) * nwi * nwi);
        density = a2 / M_PI / ((sine2 + a2 * nh * nh) * (sine2 + a2 * nh * nh));
        right += fresnel * density * 0.5 / (nwi * root_o + n[2] * root_i) * nwi / d[2];
    }
    return found / right;
}

static void narrow_highlights_have_their_shape(void **state)
{
    const struct vec3 up = {0, 0, 1}, tilted = vec3_normalize((struct vec3){0.2f, 0.1f, 1});
    struct bsdf_params p = metal(1.1e-3f), coated = plastic(0.3f, 1.5f);

    (void)state;
    p.single_scattering = 1;
    figure_within("a lamp in a mirror of alpha .0011, over its closed form", lamp_in_mirror(&p, up, 1.1e-3, 1), 0.999,
                  1.001, "closed form, tolerance 1e-3");
    coated.base_color = coated.specular_color = vec3_splat(0);
    coated.specular = 0;
    coated.clearcoat = 1;
    coated.clearcoat_ior = 1.5f;
    coated.clearcoat_alpha = 1.1e-3f;
    coated.clearcoat_normal = tilted;
    figure_within("a lamp in a tilted coat of alpha .0011, over its closed form",
                  lamp_in_mirror(&coated, tilted, 1.1e-3, 0.04), 0.98, 1.02, "closed form, tolerance 2e-2");
}

/* Microfacets lose light to each other towards the horizon, in a narrow band; what gives it back must
 * be found there. */
static void nearly_smooth_metal_has_no_bright_samples(void **state)
{
    struct bsdf_params p = metal(2e-3f);
    struct furnace f = furnace(&p, direction(2e-3f), 200000);

    (void)state;
    figure_within("largest of 200,000 samples of white metal, alpha .002", f.largest, 0, 20, "bound 20");
    figure_within("its furnace", f.most.mean, 1 - TABLE - 4 * f.error, 1 + TABLE + 4 * f.error,
                  "significance 1e-4, tables to 0.005");
}

/* ---- the ends of the random numbers ---------------------------------------------------------------- */

static void every_random_number_has_a_density(void **state)
{
    struct bsdf_params lambert = plastic(1, 1.5f);
    unsigned without_density = 0;
    struct bsdf_sample s;
    struct bsdf b;

    (void)state;
    lambert.specular = 0;
    bsdf_init(&b, &lambert, direction(0.5f));
    for (int i = 0; i < 1000; i++) {
        float v = (float)i / 1000;
        without_density += bsdf_sample(&b, direction(0.5f), 0.5f, 0, v, &s) && !(s.pdf > 0);
        without_density += bsdf_sample(&b, direction(0.5f), 0.5f, v, 0, &s) && !(s.pdf > 0);
    }
    figure_within("samples of a matt surface without a density, of 2,000 at the first random number", without_density,
                  0, 0, "exact");
}

/* ---- interfaces ------------------------------------------------------------------------------------ */

static void glass_that_hardly_bends_is_clear(void **state)
{
    struct bsdf_params same = glass(0.3f, 1, 0), near = glass(0.3f, 1.0000002f, 0), rough = glass(0.5f, 1.01f, 0);
    struct furnace f;

    (void)state;
    expect_white("furnace of rough glass of ior 1", &same, 0.4f);
    expect_white("furnace of rough glass of ior 1 + 2e-7", &near, 0.4f);
    f = furnace(&rough, direction(0.02f), 60000);
    figure_within("furnace of rough glass of ior 1.01 along its surface", f.most.mean, 0.85, 1 + TABLE + 4 * f.error,
                  "bound .85; significance 1e-4, tables to 0.005");
}

static void what_glass_cannot_pass_it_reflects(void **state)
{
    struct bsdf_params smooth = glass(0, 1.5f, 1), dense = glass(0, 1e8f, 0);

    (void)state;
    expect_white("furnace of glass from inside, beyond the critical angle", &smooth, 0.3f);
    figure_within("share that an index of 1e8 reflects along its surface",
                  furnace(&dense, direction(0.01f), 20000).reflected.mean, 0.8, 1, "bound .8");
}

static void no_rim_without_an_interface(void **state)
{
    struct bsdf_params p = plastic(0, 1.0001f);

    (void)state;
    p.base_color = vec3_splat(0);
    figure_within("what black plastic of ior 1.0001 reflects along its surface",
                  furnace(&p, direction(0.05f), 2000).most.mean, 0, 1e-3, "bound .001");
}

/* ---- energy ---------------------------------------------------------------------------------------- */

static void colors_beyond_their_range_are_cut(void **state)
{
    struct bsdf_params p = metal(0), none = metal(0);

    (void)state;
    p.base_color = vec3_splat(1.5f);
    expect_white("furnace of a mirror of colour 1.5", &p, 0.5f);
    none.base_color.x = NAN;
    expect_white("furnace of a mirror whose red is no number", &none, 0.5f);
}

static void cloth_gains_nothing(void **state)
{
    static const float MU[] = {1e-6f, 1e-3f, 0.02f, 0.1f};
    enum { TESTS = 2 * 4 };

    (void)state;
    for (int i = 0; i < TESTS; i++) {
        struct bsdf_params p = plastic(0.5f, 1);
        char what[96];
        p.base_color = vec3_splat(0);
        p.specular = 0;
        p.sheen_color = vec3_splat(1);
        p.sheen_alpha = i / 4 ? 0.3f : 0.01f;
        snprintf(what, sizeof what, "furnace of white sheen, alpha %g, mu %g", (double)p.sheen_alpha,
                 (double)MU[i % 4]);
        expect_no_gain(what, &p, direction(MU[i % 4]), 0, TESTS);
    }
}

/* Film over white plastic of a high index: what lies below it may not get what the film reflects. */
static void films_gain_nothing(void **state)
{
    static const struct { float ior, film, nm, alpha, mu, weight, interreflection; int through; } CASES[] = {
        {2.5f, 1.32303f, 659.2f, 0.0045f, 0.3f, 1, 0, 1},  {2.5f, 1.47f, 239, 0, 0.3f, 1, 0, 0},
        {2.5f, 1.47f, 239, 0.087f, 0.1f, 1, 0.082f, 0},    {2.5f, 1.81f, 75, 0.4f, 0.1f, 1, 0, 0},
        {1.5f, 1.92f, 279, 0.02f, 0.3f, 0.63f, 0, 0},      {1.5f, 1.39f, 103, 0.08f, 0.02f, 1, 0, 0},
        {2.5f, 1.61f, 430, 0.0017f, 0.3f, 1, 0.5f, 0},     {1.05f, 2.2f, 273, 0, 0.1f, 0.54f, 0, 0},
    };
    enum { COUNT = sizeof CASES / sizeof *CASES };

    (void)state;
    for (int i = 0; i < COUNT; i++) {
        struct bsdf_params p = plastic(CASES[i].alpha, CASES[i].ior);
        char what[128];
        p.specular_color = i ? vec3_splat(1) : (struct vec3){2.5f, 0.8f, 0.6f};
        p.iridescence = CASES[i].weight;
        p.iridescence_ior = CASES[i].film;
        p.iridescence_thickness_nm = CASES[i].nm;
        p.base_interreflection = CASES[i].interreflection;
        p.diffuse_transmission = (float)CASES[i].through;
        p.diffuse_transmission_color = vec3_splat(1);
        snprintf(what, sizeof what, "furnace of a film of %g nm, ior %g over ior %g, mu %g", (double)CASES[i].nm,
                 (double)CASES[i].film, (double)CASES[i].ior, (double)CASES[i].mu);
        expect_no_gain(what, &p, direction(CASES[i].mu), 0.5, COUNT);
    }
}

static void films_of_extreme_bases_and_thicknesses(void **state)
{
    struct bsdf_params white = metal(0), thick = metal(0);
    const struct vec3 f0 = {0.2f, 0.2f, 0.2f};
    double r12, r23, n, base, both;
    struct furnace f;

    (void)state;
    white.iridescence = 1;
    white.iridescence_ior = 1.4f;
    white.iridescence_thickness_nm = 300;
    f = furnace(&white, direction(0.7f), 2000);
    figure_within("furnace of white metal under a film", f.most.mean, 0.99, 1, "bound .99");
    /* Incoherent: all reflections between the two faces add up. */
    base = (1 + sqrt(0.2)) / (1 - sqrt(0.2));
    n = (base - 1.4) / (base + 1.4);
    r23 = n * n;
    r12 = (0.4 / 2.4) * (0.4 / 2.4);
    both = r12 + (1 - r12) * (1 - r12) * r23 / (1 - r12 * r23);
    thick.base_color = f0;
    thick.iridescence = 1;
    thick.iridescence_ior = 1.4f;
    thick.iridescence_thickness_nm = 40000;
    f = furnace(&thick, (struct vec3){0, 0, 1}, 2000);
    figure_within("metal of colour .2 under a film of 40 micrometres, from above", f.most.mean, both - 1e-5,
                  both + 1e-5, "closed form, tolerance 1e-5");
}

static void tables_give_back_no_more_than_was_lost(void **state)
{
    struct bsdf_params matt = glass(1, 1.005f, 1), rough = glass(0.4f, 1.005f, 1);

    (void)state;
    expect_no_gain("furnace of glass of ior 1.005, alpha 1, from inside", &matt, direction(0.004f), 0, 2);
    expect_no_gain("furnace of glass of ior 1.005, alpha .4, from inside", &rough, direction(0.035f), 0, 2);
}

/* A lobe without a number is left out and counted; the others stay. */
static void a_lobe_that_is_no_number_leaves_the_others(void **state)
{
    const struct vec3 wo = {0.6f, 0, 0.8f}, wi = {-0.6f, 0, 0.8f};
    struct bsdf_params p = plastic(0.3f, 1.5f), wall = plastic(0.3f, 1.5f);
    const struct vec3 through = {-0.6f, 0, -0.8f};
    uint64_t count[HEALTH_KINDS] = {0};
    struct bsdf b;

    (void)state;
    health_scope = (struct health_scope){count, 0};
    bsdf_init(&b, &p, wo);
    b.base.root_o = NAN;
    figure_within("a matt base below a highlight that is no number", (double)bsdf_eval(&b, wo, wi).y, 0.2, 0.3,
                  "closed form .8 (1 - R) / pi, within a fifth");
    wall.transmission = 0.5f;
    wall.diffuse_transmission = 1;
    wall.diffuse_transmission_color = vec3_splat(1);
    bsdf_init(&b, &wall, wo);
    b.thin_wall.spread.root_o = NAN;
    figure_within("light through a matt wall beside a blur that is no number", (double)bsdf_eval(&b, wo, through).y,
                  0.1, 0.15, "closed form .4 (1 - R) / pi, within a fifth");
    figure_within("densities of theirs that are counted", (double)count[HEALTH_BAD_DENSITIES], 2, 2, "exact");
    health_scope.count = NULL;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(roughness_0_is_a_mirror),
        cmocka_unit_test(narrow_highlights_have_their_shape),
        cmocka_unit_test(nearly_smooth_metal_has_no_bright_samples),
        cmocka_unit_test(every_random_number_has_a_density),
        cmocka_unit_test(glass_that_hardly_bends_is_clear),
        cmocka_unit_test(what_glass_cannot_pass_it_reflects),
        cmocka_unit_test(no_rim_without_an_interface),
        cmocka_unit_test(colors_beyond_their_range_are_cut),
        cmocka_unit_test(cloth_gains_nothing),
        cmocka_unit_test(films_gain_nothing),
        cmocka_unit_test(films_of_extreme_bases_and_thicknesses),
        cmocka_unit_test(tables_give_back_no_more_than_was_lost),
        cmocka_unit_test(a_lobe_that_is_no_number_leaves_the_others),
    };
    return cmocka_run_group_tests_name("hard cases of scattering", tests, NULL, NULL);
}
