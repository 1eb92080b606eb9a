/* The sampler: every prefix 2^k of every pair is a net, the rate is that of scrambled nets,
 * groups are independent, and the bits never change. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/math/elementary.h"
#include "common/scene/settings.h"
#include "tests/support/scene_builder.h"
#include "worker/render/base/sampler.h"
#include "worker/render/bsdf/warp.h"
#include "worker/render/light/emitters.h"
#include "worker/render/record.h"
#include "worker/render/render_scene.h"

enum { NET_LOG2_MAX = 10, NET_MAX = 1 << NET_LOG2_MAX };

typedef struct sample2 (*point_source)(const void *context, uint32_t index);

/* Of N = 2^log2_n points, does every elementary interval 1/nx by 1/ny with nx * ny = N hold
 * exactly one? */
static int is_net(point_source point, const void *context, int log2_n)
{
    uint32_t n = 1u << log2_n;

    for (int log2_nx = 0; log2_nx <= log2_n; log2_nx++) {
        uint32_t nx = 1u << log2_nx, ny = n >> log2_nx;
        uint8_t seen[NET_MAX] = {0};

        for (uint32_t i = 0; i < n; i++) {
            struct sample2 s = point(context, i);
            uint32_t cell;

            assert_true(s.u >= 0 && s.u < 1 && s.v >= 0 && s.v < 1);
            cell = (uint32_t)(s.v * (float)ny) * nx + (uint32_t)(s.u * (float)nx);
            if (seen[cell]++)
                return 0;
        }
    }
    return 1;
}

struct pixel_pair {
    uint64_t job_seed;
    uint32_t frame, x, y, group, pair;
};

static struct sample2 sampler_point(const void *context, uint32_t index)
{
    const struct pixel_pair *p = context;
    struct sampler s;

    sampler_start(&s, p->job_seed, p->frame, p->x, p->y, p->group, index);
    return sampler_get(&s, p->pair);
}

static void test_elementary_intervals(void **state)
{
    static const uint64_t seeds[] = {0, 1, 5, 6, 10, 15, 0xffffffffffffffffull};
    static const uint32_t pairs[] = {DIMENSION_PIXEL, DIMENSION_LENS, DIMENSION_TIME,
                                     DIMENSION_VERTEX + VERTEX_BSDF,
                                     DIMENSION_VERTEX + 37 * DIMENSIONS_PER_VERTEX + VERTEX_LOBE};

    (void)state;
    for (size_t seed = 0; seed < sizeof seeds / sizeof *seeds; seed++)
        for (size_t pair = 0; pair < sizeof pairs / sizeof *pairs; pair++)
            for (uint32_t pixel = 0; pixel < 6; pixel++)
                for (uint32_t group = 0; group < GROUPS; group++)
                    for (int log2_n = 2; log2_n <= NET_LOG2_MAX; log2_n++) {
                        struct pixel_pair p = {seeds[seed],   (uint32_t)seed, pixel * 31,
                                               pixel * pixel, group,          pairs[pair]};
                        assert_true(is_net(sampler_point, &p, log2_n));
                    }
}

static struct sample2 unscrambled_point(const void *context, uint32_t index)
{
    uint32_t p[2];

    (void)context;
    sobol_2d(index, p);
    return (struct sample2){unit_float(p[0]), unit_float(p[1])};
}

/* The trap: the index hashed from its least significant bit upwards. The mean stays right,
 * but a prefix is no longer an aligned block of the sequence. */
static struct sample2 wrong_shuffle_point(const void *context, uint32_t index)
{
    uint32_t seed = *(const uint32_t *)context, p[2];

    sobol_2d(owen_hash_reversed(index, seed), p);
    return (struct sample2){unit_float(owen_scramble(p[0], hash_u32(seed + 1))),
                            unit_float(owen_scramble(p[1], hash_u32(seed + 2)))};
}

static void test_elementary_intervals_test_itself(void **state)
{
    uint32_t seed = hash_u32(7);

    (void)state;
    for (int log2_n = 2; log2_n <= NET_LOG2_MAX; log2_n++)
        assert_true(is_net(unscrambled_point, NULL, log2_n));
    assert_false(is_net(wrong_shuffle_point, &seed, 6));
    assert_false(is_net(wrong_shuffle_point, &seed, 10));
}

/* sobol_2d against the definition: dimension 0 is van der Corput's radical inverse, and
 * dimension 1 has the direction numbers v_0 = 1/2, v_(k+1) = v_k ^ v_k / 2. */
static void test_sobol_definition(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 20000; k++) {
        uint32_t index = k < 10000 ? k : hash_u32(k), p[2], want[2] = {0, 0};
        uint32_t direction = 0x80000000u;

        for (int bit = 0; bit < 32; bit++, direction ^= direction >> 1)
            if (index >> bit & 1) {
                want[0] |= 0x80000000u >> bit;
                want[1] ^= direction;
            }
        sobol_2d(index, p);
        assert_int_equal(p[0], want[0]);
        assert_int_equal(p[1], want[1]);
    }
}

/* The inlined form with its folded bit reversals equals the textbook composition: shuffle
 * the index, take the point, scramble each dimension with its own seed. */
static void test_folded_equals_textbook(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 2000; k++) {
        uint64_t seed = hash_u64(k);
        uint64_t scrambles = hash_u64(seed + 0x9e3779b97f4a7c15ull);
        uint32_t shuffle = (uint32_t)(hash_u64(seed ^ 0xd1b54a32d192ed03ull) >> 32), p[2];
        struct sample2 s = sobol_owen_2d(k, seed);

        sobol_2d(owen_scramble(k, shuffle), p);
        assert_true(s.u == unit_float(owen_scramble(p[0], (uint32_t)scrambles)));
        assert_true(s.v == unit_float(owen_scramble(p[1], (uint32_t)(scrambles >> 32))));
    }
}

/* Owen's scramble permutes each digit depending on the higher digits only: two words that
 * agree in their k top bits and differ in the next do so afterwards. */
static void test_owen_scramble_is_nested(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 20000; k++) {
        uint32_t seed = hash_u32(k), a = hash_u32(k ^ 0x55555555u);
        uint32_t bit = hash_u32(k + 99) % 32;
        uint32_t b = a ^ (0x80000000u >> bit) ^ (bit < 31 ? hash_u32(k + 7) >> (bit + 1) : 0);
        uint32_t difference = owen_scramble(a, seed) ^ owen_scramble(b, seed);

        assert_int_equal(__builtin_clz(difference), bit);
    }
}

/* A smooth integrand with exact mean 1 and no symmetry that a net could exploit. */
static double smooth(struct sample2 s) { return (1.5 * s.u * s.u + 0.5) * (0.5 + 2.0 * s.v * s.v * s.v); }

static double smooth_rmse(uint32_t n, int repeats, int independent)
{
    double sum2 = 0;

    for (int r = 0; r < repeats; r++) {
        double sum = 0;

        for (uint32_t i = 0; i < n; i++) {
            struct sampler s;

            sampler_start(&s, 42, 0, (uint32_t)r, 17, 0, i);
            if (independent)
                sum += smooth((struct sample2){sampler_hash(&s, 1, 0), sampler_hash(&s, 1, 1)});
            else
                sum += smooth(sampler_get(&s, DIMENSION_LENS));
        }
        sum2 += (sum / n - 1) * (sum / n - 1);
    }
    return sqrt(sum2 / repeats);
}

static void test_convergence(void **state)
{
    double independent = smooth_rmse(1024, 300, 1), at_64 = smooth_rmse(64, 300, 0);
    double at_1024 = smooth_rmse(1024, 300, 0);

    (void)state;
    print_message("# smooth integrand: N=1024 independent %.2e, Sobol' %.2e; N=64 %.2e; slope %.2f\n", independent,
                  at_1024, at_64, log(at_1024 / at_64) / log(16));
    /* The integrand's standard deviation is 0.78: independent sampling must show it. */
    assert_true(independent > 0.020 && independent < 0.029);
    /* N^-3/2 up to a logarithm; a wrong shuffle would sit near `independent`. */
    assert_true(at_1024 < independent / 200);
    assert_true(log(at_1024 / at_64) / log(16) < -1.3);
}

/* The error of a group's mean over pixels: mean 0, and uncorrelated with the other
 * group's, with the neighbouring pixel's, and with another pair's. */
static void test_groups_uncorrelated(void **state)
{
    enum { PIXELS = 4000, N = 16 };
    static const char *const names[] = {"other group", "next pixel", "next frame", "next pair",
                                        "next seed"};
    double sum[6] = {0}, square[6] = {0}, product[6] = {0};

    (void)state;
    for (uint32_t x = 0; x < PIXELS; x++) {
        double error[6];

        for (int which = 0; which < 6; which++) {
            double mean = 0;

            for (uint32_t i = 0; i < N; i++) {
                struct sampler s;

                sampler_start(&s, which == 5 ? 4 : 3, which == 3, 2 * x + (which == 2), 5, which == 1, i);
                mean += smooth(sampler_get(&s, DIMENSION_VERTEX + (which == 4)));
            }
            error[which] = mean / N - 1;
            sum[which] += error[which];
            square[which] += error[which] * error[which];
            product[which] += error[0] * error[which];
        }
    }
    for (int which = 0; which < 6; which++) {
        double deviation = sqrt(square[which] / PIXELS);

        /* Eleven two-sided z tests at 0.01 in all (Sidak): 3.32 standard errors. */
        assert_true(fabs(sum[which] / PIXELS) < 3.32 * deviation / sqrt(PIXELS));
        if (which > 0) {
            double r = product[which] / sqrt(square[0] * square[which]);

            print_message("# correlation with the %s: %+.4f\n", names[which - 1], r);
            assert_true(fabs(r) < 3.32 / sqrt(PIXELS));
        }
    }
}

/* Within one path, pairs are padded against each other: point i of one pair says nothing
 * about point i of another (their shuffles differ). */
static void test_pairs_uncorrelated(void **state)
{
    enum { N = 4096, PAIRS = 12 };

    (void)state;
    for (uint32_t a = 0; a < PAIRS; a++)
        for (uint32_t b = a + 1; b < PAIRS; b++) {
            double product = 0;

            for (uint32_t i = 0; i < N; i++) {
                struct sampler s;

                sampler_start(&s, 1, 0, 10, 10, 0, i);
                product += (sampler_get(&s, a).u - 0.5) * (sampler_get(&s, b).u - 0.5);
            }
            /* 66 two-sided z tests at 0.01 in all (Sidak): 3.79 standard errors of 1/12/sqrt N. */
            assert_true(fabs(product / N) < 3.79 / 12 / sqrt(N));
        }
}

/* Every decision of a path has a pair of its own, at every depth: the camera's come before the vertices', and
 * a vertex has as many as it uses. That paths take them so:
 * test_vertices_take_their_own. */
static void test_names_are_disjoint(void **state)
{
    static const uint32_t camera[] = {DIMENSION_PIXEL, DIMENSION_LENS, DIMENSION_TIME};
    static const uint32_t vertex[] = {VERTEX_LIGHT_POINT, VERTEX_MEDIUM, VERTEX_BSDF, VERTEX_LOBE};
    enum { DEPTHS = SETTINGS_DEPTH_MAX + 1, VERTEX_PAIRS = sizeof vertex / sizeof *vertex };
    static uint8_t taken[DIMENSION_VERTEX + DEPTHS * DIMENSIONS_PER_VERTEX];

    (void)state;
    for (size_t i = 0; i < sizeof camera / sizeof *camera; i++) {
        assert_true(camera[i] < DIMENSION_VERTEX && !taken[camera[i]]);
        taken[camera[i]] = 1;
    }
    assert_true((int)VERTEX_PAIRS <= (int)DIMENSIONS_PER_VERTEX);
    for (uint32_t depth = 0; depth < DEPTHS; depth++)
        for (size_t i = 0; i < VERTEX_PAIRS; i++) {
            uint32_t pair = DIMENSION_VERTEX + depth * DIMENSIONS_PER_VERTEX + vertex[i];
            assert_true(vertex[i] < DIMENSIONS_PER_VERTEX && !taken[pair]);
            taken[pair] = 1;
        }
}

static void test_consistent_out_of_order(void **state)
{
    enum { N = 64, PAIRS = 20 };
    static struct sample2 first[N][PAIRS];

    (void)state;
    for (uint32_t i = 0; i < N; i++) {
        struct sampler s;

        sampler_start(&s, 99, 2, 300, 200, 0, i);
        for (uint32_t pair = 0; pair < PAIRS; pair++)
            first[i][pair] = sampler_get(&s, pair);
    }
    for (uint32_t k = 0; k < N * PAIRS; k++) {
        uint32_t shuffled = k * 501 % (N * PAIRS); /* 501 is coprime to 1280 */
        uint32_t i = shuffled / PAIRS, pair = shuffled % PAIRS;
        struct sampler s;
        struct sample2 again;

        sampler_start(&s, 99, 2, 300, 200, 0, i);
        (void)sampler_hash(&s, k, k);
        again = sampler_get(&s, pair);
        assert_true(again.u == first[i][pair].u && again.v == first[i][pair].v);
    }
}

/* Samples that make their numbers together have the numbers that each has alone, whichever asks first, and samples
 * that share nothing with others do not take theirs. */
/* As on a processor for which a batch does not pay: each is as if it had been started alone. */
static void test_started_together(void **state)
{
    struct sampler together[SAMPLER_LANES], alone;

    (void)state;
    memset(together, 0x55, sizeof together);
    sampler_start(&together[0], 5, 1, 3, 4, 1, 40);
    sampler_start_batch(together, 40, SAMPLER_LANES, NULL);
    for (uint32_t k = 0; k < SAMPLER_LANES; k++)
        for (uint32_t pair = 0; pair < 2 * SAMPLER_BATCH_PAIRS; pair++) {
            struct sample2 got = sampler_get(&together[k], pair), want;

            sampler_start(&alone, 5, 1, 3, 4, 1, 40 + k);
            want = sampler_get(&alone, pair);
            assert_true(got.u == want.u && got.v == want.v);
        }
}

static void test_batches_change_no_bit(void **state)
{
    enum { PAIRS = 2 * SAMPLER_BATCH_PAIRS };

    (void)state;
    for (uint32_t k = 0; k < 400; k++) {
        const uint32_t count = 1 + k % SAMPLER_LANES, first = k < 200 ? k : hash_u32(k);
        struct sampler together[SAMPLER_LANES];
        struct sampler_batch batch;

        sampler_start(&together[0], 5, 1, k, 7 * k, k & 1, first);
        sampler_start_batch(together, first, count, &batch);
        for (uint32_t i = 0; i < PAIRS * count; i++) {
            const uint32_t lane = hash_u32(i + k) % count, pair = hash_u32(i ^ k << 8) % PAIRS;
            struct sample2 got = sampler_get(&together[lane], pair), want;
            struct sampler alone;

            sampler_start(&alone, 5, 1, k, 7 * k, k & 1, first + lane);
            want = sampler_get(&alone, pair);
            assert_true(got.u == want.u && got.v == want.v);
            assert_true(sampler_hash(&together[lane], i, pair) == sampler_hash(&alone, i, pair));
            sampler_isolate(&alone);
            want = sampler_get(&alone, pair);
            if (i + count >= PAIRS * count) /* the last ones: lanes are taken once each way */
                sampler_isolate(&together[lane]);
            got = sampler_get(&together[lane], pair);
            assert_true((got.u == want.u) == (together[lane].batch == NULL));
            if (!together[lane].batch)
                break;
        }
    }
}

static void test_unit_float(void **state)
{
    (void)state;
    assert_true(unit_float(0) == 0);
    assert_true(unit_float(0xffffffffu) == ONE_MINUS_EPSILON);
    assert_true(unit_float(0x80000000u) == 0.5f);
    assert_true(unit_float(0x7fffffffu) == 0x1.fffffep-2f);
    assert_true(unit_float(1) == 0x1p-32f);
    for (uint32_t k = 0; k < 100000; k++) {
        uint32_t x = hash_u32(k) >> hash_u32(k + 1) % 32;
        double exact = x * 0x1p-32, got = unit_float(x);

        assert_true(got <= exact && exact < (double)nextafterf((float)got, 2.0f));
    }
}

/* sampler_hash is uniform (chi-square, 64 cells, 0.1 % critical value 103.4) and its keys
 * matter. */
static void test_hash_uniform(void **state)
{
    enum { CELLS = 64, N = 64000 };
    uint32_t counts[CELLS] = {0};
    double chi2 = 0;
    struct sampler s;

    (void)state;
    for (uint32_t i = 0; i < N; i++) {
        sampler_start(&s, 5, 0, i % 40, i / 1600, 0, i / 40 % 40);
        counts[(int)(sampler_hash(&s, i % 7, i % 3) * CELLS)]++;
    }
    for (int c = 0; c < CELLS; c++)
        chi2 += pow(counts[c] - (double)N / CELLS, 2) / ((double)N / CELLS);
    assert_true(chi2 < 103.4);
    sampler_start(&s, 5, 0, 1, 1, 0, 0);
    assert_true(sampler_hash(&s, 1, 2) != sampler_hash(&s, 2, 1));
    assert_true(sampler_hash(&s, 1, 2) != sampler_hash(&s, 1, 3));
}

/* Pinned: pictures of one version must be those of the next. It prints what it found. */
static void test_golden(void **state)
{
    static const uint32_t want[4][2] = {{0x3ed79be5, 0x3dfaebbc},
                                        {0x3c914677, 0x3cee9d26},
                                        {0x3f74d8cc, 0x3de85d65},
                                        {0x3de72a24, 0x3f3bbeb2}};
    uint64_t fingerprint = 14695981039346656037ull;
    uint32_t got[4][2];

    (void)state;
    for (uint32_t i = 0; i < 4; i++) {
        struct sampler s;
        struct sample2 p;

        sampler_start(&s, 0x0123456789abcdefull, 3, 640 + i, 360, 0, 5 + i);
        p = sampler_get(&s, DIMENSION_VERTEX + i);
        got[i][0] = float_bits(p.u);
        got[i][1] = float_bits(p.v);
        print_message("# {0x%08x, 0x%08x}\n", got[i][0], got[i][1]);
    }
    for (uint32_t i = 0; i < 10000; i++) {
        struct sampler s;
        struct sample2 p;
        uint32_t words[3];

        sampler_start(&s, i / 7, i % 5, i % 101, i % 57, 0, i);
        p = sampler_get(&s, i % 60);
        words[0] = float_bits(p.u);
        words[1] = float_bits(p.v);
        words[2] = float_bits(sampler_hash(&s, i % 11, i % 13));
        for (int w = 0; w < 3; w++)
            fingerprint = (fingerprint ^ words[w]) * 1099511628211ull;
    }
    print_message("# 0x%016llxull\n", (unsigned long long)fingerprint);
    assert_memory_equal(got, want, sizeof got);
    assert_true(fingerprint == 0x8f5aa22874d32c42ull);
}

/* Isolated samples: uniform, independent of one another and of their other pairs, and still a function of
 * their names. */
static void test_isolated(void **state)
{
    enum { CELLS = 16, PIXELS = 64, SAMPLES = 256, COUNT = PIXELS * SAMPLES };
    static double u[COUNT], other[COUNT];
    double cells[CELLS * CELLS] = {0}, chi_square = 0, lag = 0, across = 0, between = 0, spread = 0;
    int at = 0;

    (void)state;
    for (uint32_t x = 0; x < PIXELS; x++) {
        double mean = 0;

        for (uint32_t i = 0; i < SAMPLES; i++, at++) {
            struct sample2 first, second;
            struct sampler s, again;

            sampler_start(&s, 7, 3, x, 5, 0, i);
            sampler_isolate(&s);
            sampler_start(&again, 7, 3, x, 5, 0, i);
            sampler_isolate(&again);
            first = sampler_get(&s, DIMENSION_PIXEL);
            second = sampler_get(&s, DIMENSION_VERTEX + VERTEX_BSDF);
            assert_true(first.u == sampler_get(&again, DIMENSION_PIXEL).u);
            cells[(int)(first.v * CELLS) * CELLS + (int)(first.u * CELLS)]++;
            u[at] = (double)first.u - 0.5;
            other[at] = (double)second.u - 0.5;
            across += u[at] * ((double)first.v - 0.5) * 12 / COUNT;
            between += u[at] * other[at] * 12 / COUNT;
            mean += u[at] / SAMPLES;
            if (i > 0)
                lag += u[at] * u[at - 1] * 12 / COUNT;
        }
        spread += mean * mean * 12 * SAMPLES / PIXELS;
    }
    for (int k = 0; k < CELLS * CELLS; k++) {
        double expected = (double)COUNT / (CELLS * CELLS);
        chi_square += (cells[k] - expected) * (cells[k] - expected) / expected;
    }
    /* 255 degrees of freedom: mean 255, deviation 22.6; of a net it would be near 0. */
    assert_true(fabs(chi_square - 255) < 4 * 22.6);
    assert_true(fabs(lag) < 4 / sqrt(COUNT) && fabs(across) < 4 / sqrt(COUNT));
    assert_true(fabs(between) < 4 / sqrt(COUNT));
    /* The means of pixels spread as those of independent numbers, 1 +- sqrt(2 / PIXELS). */
    assert_true(fabs(spread - 1) < 4 * sqrt(2.0 / PIXELS));
}

/* ---- the paths ----------------------------------------------------------------------------------- */

static void assert_close(struct vec3 a, struct vec3 b) { assert_true(vec3_length(vec3_sub(a, b)) <= 1e-5f); }

/* The vertex of this depth takes its pairs and no others: its direction, the point on the lamp and whether the
 * path goes on are what these make of them. */
static void check_numbers(const struct render_scene *scene, const struct sampler *sampler,
                          const struct record_vertex *v, int ended)
{
    uint32_t first = DIMENSION_VERTEX + v->depth * DIMENSIONS_PER_VERTEX;
    struct sample2 u = sampler_get(sampler, first + VERTEX_BSDF);
    struct sample2 light = sampler_get(sampler, first + VERTEX_LIGHT_POINT);
    struct light_context context = {.p = v->p, .n = v->ng};
    struct basis basis = basis_from_normal(v->ns);
    struct light_sample sample;

    if (v->light.found) {
        assert_true(emitters_sample(scene, &context, light.u, light.v, &sample));
        assert_close(v->light.direction, sample.direction);
    }
    if (!v->scattered)
        return;
    assert_string_equal(v->lobe, "DIFFUSE");
    assert_close(v->direction, basis_to_world(&basis, cosine_hemisphere(u.u, u.v)));
    if (v->survival < 1)
        assert_int_equal(sampler_get(sampler, first + VERTEX_LOBE).v < v->survival, !ended);
}

/* Diffuse walls around a lamp: of a path of many vertices, each has random numbers of its own. Shared ones
 * would correlate its decisions, which makes pictures too dark or too bright. */
static void test_vertices_take_their_own(void **state)
{
    struct render_settings settings = builder_settings(4, 4, 64);
    static struct sample_record record;
    uint32_t lights = 0, deepest = 0, ended = 0;
    struct render_stats stats = {0};
    struct scene_builder b;
    struct render_scene *scene;

    (void)state;
    settings.max_depth = 12;
    builder_init(&b);
    builder_lambert(&b, 0.8f);
    builder_place(&b, builder_sphere(&b, 24, 0), 0, vec3_splat(4), vec3_splat(0));
    builder_lambert(&b, 0)->emission[0] = 5;
    builder_place(&b, builder_quad(&b), 1, vec3_splat(0.5f), vec3_make(0, 1, 0));
    builder_camera(&b, vec3_make(0, -1, 3), vec3_splat(0), 0.7f);
    scene = builder_build(&b, &settings);
    for (uint32_t n = 0; n < 16 * 64; n++) {
        uint32_t x = n % 4, y = n / 4 % 4, number = n / 16;
        struct sampler sampler;
        float added[3];

        render_sample(scene, 1, x, y, number, added, &record, &stats);
        sampler_start(&sampler, settings.seed, 1, x, y, number % GROUPS, number / GROUPS);
        for (uint32_t i = 0; i < record.count; i++) {
            const struct record_vertex *v = &record.vertices[i];
            int last = i + 1 == record.count && record.end == PATH_ROULETTE;

            check_numbers(scene, &sampler, v, last);
            lights += v->light.found;
            ended += last;
            deepest = v->depth > deepest ? v->depth : deepest;
        }
    }
    assert_true(lights > 100 && ended > 100 && deepest >= 10);
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_isolated),
        cmocka_unit_test(test_elementary_intervals),
        cmocka_unit_test(test_elementary_intervals_test_itself),
        cmocka_unit_test(test_sobol_definition),
        cmocka_unit_test(test_folded_equals_textbook),
        cmocka_unit_test(test_owen_scramble_is_nested),
        cmocka_unit_test(test_convergence),
        cmocka_unit_test(test_groups_uncorrelated),
        cmocka_unit_test(test_pairs_uncorrelated),
        cmocka_unit_test(test_names_are_disjoint),
        cmocka_unit_test(test_vertices_take_their_own),
        cmocka_unit_test(test_consistent_out_of_order),
        cmocka_unit_test(test_batches_change_no_bit),
        cmocka_unit_test(test_started_together),
        cmocka_unit_test(test_unit_float),
        cmocka_unit_test(test_hash_uniform),
        cmocka_unit_test(test_golden),
    };

    return cmocka_run_group_tests_name("sampler", tests, NULL, NULL);
}
