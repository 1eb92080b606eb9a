/* Rough glass against light's random walk between its microfacets: after Heitz, Hanika, d'Eon and
 * Dachsbacher 2016 (Multiple-Scattering Microfacet BSDFs with the Smith Model), the walk that the
 * model of bsdf.h stands for. It is simulated here in double precision, with microfacets of
 * uniformly distributed heights. The model keeps the single scattering and gives the rest back as
 * one wide lobe; here is how far that is from the walk.
 *
 *   test_bsdf_walk           the tests, with fixed seeds
 *   test_bsdf_walk --print   the table of docs/NUMERICS.md: total variation distance from the walk
 *                            of single scattering alone, of the model, and of the other way to keep
 *                            energy and reciprocity: single scattering scaled by s(wo) s(wi), with
 *                            the s that makes every directional albedo 1
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/math/elementary.h"
#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"

struct vec {
    double x, y, z;
};

static struct vec along(struct vec a, double s, struct vec b)
{
    return (struct vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}
static double dot(struct vec a, struct vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static struct vec times(double s, struct vec a) { return (struct vec){s * a.x, s * a.y, s * a.z}; }
static struct vec unit(struct vec a) { return times(1 / sqrt(dot(a, a)), a); }

/* ---- the walk ---------------------------------------------------------------------------------- */

enum { ORDERS_MAX = 200 };

/* Smith's Lambda, of directions that go down too. */
static double lambda(double mu, double alpha)
{
    double root = sqrt(mu * mu + alpha * alpha * (1 - mu * mu));
    return 0.5 * (root / mu - 1); /* for mu < 0 this is -1 - Lambda(-mu) */
}

/* A visible normal, for directions from below as well (as ggx_sample_visible). */
static struct vec visible_normal(struct vec w, double alpha, struct test_random *r)
{
    struct vec s = unit((struct vec){alpha * w.x, alpha * w.y, w.z});
    double z = (1 - test_random_double(r)) * (1 + s.z) - s.z;
    double turn = 2 * M_PI * test_random_double(r);
    double sine = sqrt(fmax(0, 1 - z * z));

    return unit((struct vec){alpha * (sine * cos(turn) + s.x), alpha * (sine * sin(turn) + s.y), fmax(z + s.z, 1e-12)});
}

/* Where the ray that is at *height and goes along d meets the surface next; 0: nowhere. Heights
 * are 0..1, and so is the share of the microfacets that are lower. */
static int next_height(struct vec d, double alpha, double *height, struct test_random *r)
{
    double u = test_random_double(r), l;

    if (d.z > 0.99999)
        return 0;
    if (d.z < -0.99999)
        return *height *= u, 1;
    if (fabs(d.z) < 1e-5)
        return 1;
    l = lambda(d.z, alpha);
    if (l > 0 && u > 1 - pow(*height, l))
        return 0;
    *height = fmin(1, *height * pow(1 - u, -1 / l));
    return 1;
}

static double fresnel(double c, double eta) { return (double)fresnel_dielectric((float)c, (float)eta); }

/* Walk from wo until the light leaves the surface: 1, its direction and how often it met the
 * surface. eta as in struct bsdf. */
static int walk(struct vec wo, double alpha, double eta, struct test_random *r, struct vec *wi, int *orders)
{
    struct vec d = times(-1, wo);
    double height = 1, side = 1; /* -1: in the far medium, where all is upside down */

    for (*orders = 0; *orders < ORDERS_MAX; (*orders)++) {
        double n = side > 0 ? eta : 1 / eta, c, sin2;
        struct vec m, back;
        if (!next_height(times(side, d), alpha, &height, r))
            return *wi = d, 1;
        back = times(-1, d);
        m = times(side, visible_normal(times(side, back), alpha, r));
        c = fmax(dot(back, m), 1e-9);
        if (test_random_double(r) < fresnel(c, n)) {
            d = unit(along(d, 2 * c, m));
            continue;
        }
        sin2 = (1 - c * c) / (n * n);
        d = unit(along(times(1 / n, along(times(c, m), -1, back)), -sqrt(fmax(0, 1 - sin2)), m));
        side = -side;
        height = 1 - height;
    }
    return 0;
}

/* ---- the model ---------------------------------------------------------------------------------- */

static struct vec direction(double mu) { return (struct vec){sqrt(1 - mu * mu), 0, mu}; }

static struct bsdf_params glass(double alpha, double ior, int inside, int single)
{
    return (struct bsdf_params){.base_color = {1, 1, 1}, .alpha = (float)alpha, .ior = (float)ior,
                                .specular = 1, .specular_color = {1, 1, 1}, .transmission = 1,
                                .refractive = 1, .inside = inside, .single_scattering = single};
}

static struct vec3 narrowed(struct vec w) { return (struct vec3){(float)w.x, (float)w.y, (float)w.z}; }

/* One sample's power. */
static double sample(const struct bsdf *b, struct vec3 wo, struct test_random *r, struct vec *wi)
{
    float u = test_random_float(r), v = test_random_float(r), w = test_random_float(r);
    struct bsdf_sample s;

    if (!bsdf_sample(b, wo, w, u, v, &s))
        return 0;
    *wi = unit((struct vec){(double)s.wi.x, (double)s.wi.y, (double)s.wi.z});
    return (double)(s.weight.y * s.eta_scale);
}

/* ---- scaling ------------------------------------------------------------------------------------ */

/* s(mu) of both sides, the first wo's, linear in c = sqrt(mu (1 + alpha) / (mu + alpha)). */
enum { COLUMNS = 24 };
struct scaling {
    double alpha, s[2 * COLUMNS];
};

static double column_of(double mu, double alpha)
{
    return sqrt(fmin(1, mu * (1 + alpha) / (mu + alpha))) * (COLUMNS - 1);
}

static double scaling_at(const struct scaling *t, int side, double mu)
{
    double x = column_of(mu, t->alpha);
    int k = x < COLUMNS - 2 ? (int)x : COLUMNS - 2;
    const double *s = t->s + side * COLUMNS + k;

    return s[0] + (s[1] - s[0]) * (x - k);
}

/* s = 1 / (what single scattering sends, weighted by s), by the symmetric iteration of Sinkhorn
 * and Knopp 1967. */
static void scaling_find(struct scaling *t, double alpha, double ior)
{
    static double kernel[2 * COLUMNS][2 * COLUMNS];
    struct test_random r = {99};
    enum { SAMPLES = 40000, STEPS = 400 };

    memset(kernel, 0, sizeof kernel);
    t->alpha = alpha;
    for (int i = 0; i < 2 * COLUMNS; i++) {
        double x = (double)(i % COLUMNS) / (COLUMNS - 1), mu = alpha * x * x / (1 + alpha - x * x);
        struct bsdf_params p = glass(alpha, ior, i / COLUMNS, 1);
        struct vec3 wo = narrowed(direction(fmin(1, fmax(1e-4, mu))));
        struct bsdf b;
        bsdf_init(&b, &p, wo);
        for (int k = 0; k < SAMPLES; k++) {
            struct vec wi;
            double w = sample(&b, wo, &r, &wi), column;
            int j, far;
            if (!(w > 0))
                continue;
            column = column_of(fabs(wi.z), alpha);
            j = column < COLUMNS - 2 ? (int)column : COLUMNS - 2;
            far = (wi.z < 0) ^ (i / COLUMNS);
            kernel[i][far * COLUMNS + j] += w / SAMPLES * (1 - (column - j));
            kernel[i][far * COLUMNS + j + 1] += w / SAMPLES * (column - j);
        }
        t->s[i] = 1;
    }
    for (int k = 0; k < STEPS; k++) {
        double next[2 * COLUMNS];
        for (int i = 0; i < 2 * COLUMNS; i++) {
            double sum = 0;
            for (int j = 0; j < 2 * COLUMNS; j++)
                sum += kernel[i][j] * t->s[j];
            next[i] = sqrt(t->s[i] / sum);
        }
        memcpy(t->s, next, sizeof next);
    }
}

/* ---- where the light goes ------------------------------------------------------------------------ */

enum { COSINES = 12, TURNS = 8, CELLS = 2 * COSINES * TURNS };

static int cell_of(struct vec w)
{
    int z = (int)fmin(COSINES - 1, fabs(w.z) * COSINES);
    int turn = (int)fmin(TURNS - 1, atan2(fabs(w.y), w.x) / M_PI * TURNS);
    return ((w.z < 0) * COSINES + z) * TURNS + turn;
}

struct spread {
    double cell[CELLS], all, through;
};

static void spread_add(struct spread *s, struct vec w, double power)
{
    s->cell[cell_of(w)] += power;
    s->all += power;
    s->through += w.z < 0 ? power : 0;
}

static double distance(const struct spread *a, const struct spread *b)
{
    double sum = 0;
    for (int i = 0; i < CELLS; i++)
        sum += 0.5 * fabs(a->cell[i] - b->cell[i]);
    return sum;
}

static struct spread spread_of_walk(double mu, double alpha, double ior, int inside, int samples, uint64_t seed,
                                    double *reflected_once)
{
    struct test_random r = {seed};
    struct spread s = {0};
    struct vec w;
    int orders;

    *reflected_once = 0;
    for (int i = 0; i < samples; i++)
        if (walk(direction(mu), alpha, inside ? 1 / ior : ior, &r, &w, &orders)) {
            spread_add(&s, w, 1.0 / samples);
            *reflected_once += orders == 1 && w.z > 0 ? 1.0 / samples : 0;
        }
    return s;
}

static struct spread spread_of_model(double mu, double alpha, double ior, int inside, int single,
                                     const struct scaling *scaling, int samples, uint64_t seed)
{
    struct bsdf_params p = glass(alpha, ior, inside, single);
    struct test_random r = {seed};
    struct spread s = {0};
    struct vec3 wo = narrowed(direction(mu));
    struct bsdf b;
    struct vec w;

    bsdf_init(&b, &p, wo);
    for (int i = 0; i < samples; i++) {
        double power = sample(&b, wo, &r, &w);
        if (power > 0 && scaling)
            power *= scaling_at(scaling, inside, mu) * scaling_at(scaling, inside ^ (w.z < 0), fabs(w.z));
        if (power > 0)
            spread_add(&s, w, power / samples);
    }
    return s;
}

/* ---- the tests ------------------------------------------------------------------------------------ */

/* The walk is the model's: what it reflects at the first microfacet and lets go is Smith's
 * height-correlated single scattering; and none of its light is lost. */
static void the_walk_begins_with_single_scattering(void **state)
{
    static const double ALPHAS[] = {0.16, 0.4, 1}, MU[] = {0.2, 0.5, 0.9};
    enum { SAMPLES = 40000, TESTS = 3 * 3 * 2 };
    double z = normal_quantile(1 - sidak_alpha(0.01, TESTS) / 2);

    (void)state;
    for (int i = 0; i < TESTS; i++) {
        double alpha = ALPHAS[i % 3], mu = MU[i / 3 % 3], once, reflected, error;
        struct spread w = spread_of_walk(mu, alpha, 1.5, i / 9, SAMPLES, 10 + (uint64_t)i, &once);
        struct spread m = spread_of_model(mu, alpha, 1.5, i / 9, 1, NULL, SAMPLES, (uint64_t)i);
        reflected = m.all - m.through;
        error = z * sqrt(2 * fmax(once, 0.01) / SAMPLES);
        if (fabs(once - reflected) > error || fabs(w.all - 1) > 1e-3)
            fail_msg("alpha %g mu %g inside %d: %.4f, single scattering %.4f; all %.4f", alpha, mu, i / 9, once,
                     reflected, w.all);
    }
}

/* The hemisphere's mean of what goes elsewhere than the walk sends it, and of the share that goes
 * through. */
static double mean_distance(double alpha, double ior, int single, const struct scaling *scaling, int samples,
                            double *through)
{
    enum { STEPS = 6 };
    double sum = 0, weight = 0, once;

    *through = 0;
    for (int i = 0; i < 2 * STEPS; i++) {
        double mu = (i / 2 + 0.5) / STEPS;
        struct spread w = spread_of_walk(mu, alpha, ior, i & 1, samples, 1 + (uint64_t)i, &once);
        struct spread m = spread_of_model(mu, alpha, ior, i & 1, single, scaling, samples, 50 + (uint64_t)i);
        sum += mu * distance(&w, &m);
        *through += mu * fabs(w.through - m.through);
        weight += mu;
    }
    *through /= weight;
    return sum / weight;
}

static const double GRID_ALPHA[] = {0.09, 0.16, 0.36, 0.64, 1};
static const double GRID_IOR[] = {1.05, 1.125, 1.33, 1.5, 2, 3};
enum { GRID_ALPHAS = 5, GRID_IORS = 6 };

/* What `--print` said, and a little for the noise of fewer samples. */
static void light_goes_where_the_walk_goes(void **state)
{
    static const struct { double alpha, ior, distance, through; } EXPECT[] = {
        {0.09, 1.5, 0.024, 0.006}, {0.16, 1.33, 0.037, 0.006}, {0.16, 1.5, 0.036, 0.006},
        {0.16, 2, 0.036, 0.006},   {0.36, 1.125, 0.095, 0.022}, {0.36, 1.5, 0.065, 0.010},
        {0.36, 2, 0.050, 0.008},   {0.64, 1.5, 0.112, 0.028},  {1, 2, 0.125, 0.037},
    };

    (void)state;
    for (size_t i = 0; i < sizeof EXPECT / sizeof *EXPECT; i++) {
        double through, far;
        far = mean_distance(EXPECT[i].alpha, EXPECT[i].ior, 0, NULL, 25000, &through);
        if (far > EXPECT[i].distance || through > EXPECT[i].through)
            fail_msg("alpha %g ior %g: %.4f goes elsewhere, %.4f through", EXPECT[i].alpha, EXPECT[i].ior, far,
                     through);
    }
}

/* By how much a ball turns light, in steps of 20 degrees. */
enum { ANGLES = 9, CROSSINGS_MAX = 60 };

static struct vec from_frame(struct vec n, struct vec w, int back)
{
    struct vec x = unit(fabs(n.z) < 0.9 ? (struct vec){-n.y, n.x, 0} : (struct vec){0, -n.z, n.y});
    struct vec y = {n.y * x.z - n.z * x.y, n.z * x.x - n.x * x.z, n.x * x.y - n.y * x.x};

    if (back)
        return (struct vec){dot(x, w), dot(y, w), dot(n, w)};
    return along(along(times(w.x, x), w.y, y), w.z, n);
}

static void ball(double alpha, double ior, int by_walk, int rays, double turned[ANGLES])
{
    struct test_random r = {7};

    memset(turned, 0, ANGLES * sizeof *turned);
    for (int i = 0; i < rays; i++) {
        double radius = sqrt((i + test_random_double(&r)) / rays), power = 1;
        struct vec at = {radius, 0, -sqrt(1 - radius * radius)}, d = {0, 0, 1};
        int inside = 0;
        for (int k = 0; k < CROSSINGS_MAX && power > 0; k++) {
            struct vec n = times(inside ? -1 : 1, at), wo = from_frame(n, times(-1, d), 1), wi;
            int orders;
            if (!(wo.z > 1e-6))
                break;
            if (by_walk) {
                power *= walk(wo, alpha, inside ? 1 / ior : ior, &r, &wi, &orders);
            } else {
                struct bsdf_params p = glass(alpha, ior, inside, 0);
                struct bsdf b;
                bsdf_init(&b, &p, narrowed(wo));
                power *= sample(&b, narrowed(wo), &r, &wi);
            }
            if (!(power > 0))
                break;
            d = unit(from_frame(n, wi, 0));
            inside ^= wi.z < 0;
            if (!inside) {
                int a = (int)(acos(fmax(-1, fmin(1, d.z))) / M_PI * ANGLES);
                turned[a < ANGLES ? a : ANGLES - 1] += power / rays;
                break;
            }
            at = unit(along(at, -2 * dot(at, d), d));
        }
    }
}

static void a_ball_turns_light_as_the_walk_does(void **state)
{
    static const double ALPHAS[] = {0.16, 0.36};
    enum { RAYS = 200000 };

    (void)state;
    for (int i = 0; i < 2; i++) {
        double w[ANGLES], m[ANGLES], all = 0, apart = 0;
        ball(ALPHAS[i], 1.5, 1, RAYS, w);
        ball(ALPHAS[i], 1.5, 0, RAYS, m);
        for (int a = 0; a < ANGLES; a++) {
            all += m[a];
            apart += 0.5 * fabs(m[a] - w[a]);
        }
        if (!(all > 0.985 && all < 1.005 && apart < 0.02))
            fail_msg("alpha %g: %.4f leaves the ball, %.4f elsewhere than the walk's", ALPHAS[i], all, apart);
    }
}

static void print_table(void)
{
    printf("alpha ior   elsewhere than the walk: single, model, scaled; through, model's; s most\n");
    for (int i = 0; i < GRID_ALPHAS * GRID_IORS; i++) {
        double alpha = GRID_ALPHA[i / GRID_IORS], ior = GRID_IOR[i % GRID_IORS], most = 0;
        double through, scaled_through, single, model, scaled;
        struct scaling t;
        enum { SAMPLES = 100000 };
        scaling_find(&t, alpha, ior);
        for (int k = 0; k < 2 * COLUMNS; k++)
            most = fmax(most, t.s[k]);
        single = mean_distance(alpha, ior, 1, NULL, SAMPLES, &scaled_through);
        scaled = mean_distance(alpha, ior, 1, &t, SAMPLES, &scaled_through);
        model = mean_distance(alpha, ior, 0, NULL, SAMPLES, &through);
        printf("%.2f %5.3f  %.3f  %.3f  %.3f   %.3f   %.1f\n", alpha, ior, single, model, scaled,
               through, most);
        fflush(stdout);
    }
    for (int i = 1; i < 3; i++) {
        double w[ANGLES], m[ANGLES];
        ball(GRID_ALPHA[i], 1.5, 1, 1000000, w);
        ball(GRID_ALPHA[i], 1.5, 0, 1000000, m);
        printf("ball, alpha %.2f:", GRID_ALPHA[i]);
        for (int a = 0; a < ANGLES; a++)
            printf(" %.4f (%+.1f %%)", w[a], 100 * (m[a] / w[a] - 1));
        printf("\n");
    }
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_walk_begins_with_single_scattering),
        cmocka_unit_test(light_goes_where_the_walk_goes),
        cmocka_unit_test(a_ball_turns_light_as_the_walk_does),
    };

    if (argc > 1 && strcmp(argv[1], "--print") == 0) {
        print_table();
        return 0;
    }
    return cmocka_run_group_tests_name("bsdf_walk", tests, NULL, NULL);
}
