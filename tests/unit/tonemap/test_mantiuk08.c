/* The operator mantiuk08: curves of the reference implementation, its parts one by one, and
 * pictures that break naive ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/math/elementary.h"
#include "common/tonemap/mantiuk08/mantiuk08.h"
#include "common/tonemap/operators.h"
#include "common/tonemap/tonemap.h"
#include "tests/support/tonemap_pictures.h"

enum { SIDE = 256 };

static struct image grey_image(uint32_t width, uint32_t height, float value)
{
    struct image image;

    assert_int_equal(image_init(&image, width, height, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        image.pixels[i] = value;
    return image;
}

static void set_pixel(struct image *image, size_t index, double value)
{
    for (int c = 0; c < 3; c++)
        image->pixels[3 * index + (size_t)c] = (float)value;
}

/* The pictures of the notes, by their letters; F is flat. */
static struct image golden_image(char letter)
{
    struct image image = grey_image(SIDE, SIDE, 1.0f);
    double turn = 2.0 * PI_D;

    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            double l = 0.0;

            if (letter == 'A')
                l = -2.0 + 6.0 * x / 255.0 + 0.1 * sin(turn * y / 8.0);
            else if (letter == 'B')
                l = log10(x < SIDE / 2 ? 0.05 : 500.0) + 0.1 * sin(turn * y / 8.0) * sin(turn * x / 8.0);
            else if (letter == 'E')
                l = -1.5 + 1.5 * x / 255.0 + 0.05 * sin(turn * y / 16.0);
            set_pixel(&image, (size_t)y * SIDE + (size_t)x, pow(10.0, l));
        }
    return image;
}

static struct tonemap_settings settings_of(const char *parameter, const char *text)
{
    struct tonemap_settings s;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&s, "mantiuk08", &err), STATUS_OK);
    if (parameter)
        assert_int_equal(tonemap_settings_set_text(&s, parameter, text, &err), STATUS_OK);
    return s;
}

static struct tonemap_state measure(const struct image *image, const struct tonemap_settings *s, unsigned threads)
{
    struct tonemap_context context = {.threads = threads};
    struct tonemap_state state;
    struct error err = {0};

    assert_int_equal(tonemap_measure(&state, image, s, &context, &err), STATUS_OK);
    return state;
}

/* Every curve: it does not fall, and lies within the display's range. */
static void check_curve(const struct tonemap_state *state, int display)
{
    struct m08_display d;
    double low, high;

    m08_display_init(&d, display, NULL);
    low = log10(m08_display_light(&d, 0.0));
    high = log10(m08_display_light(&d, 1.0));
    for (int i = 0; i < M08_NODES; i++) {
        assert_true(state->values[i] >= low - 1e-9 && state->values[i] <= high + 1e-9);
        assert_true(i == 0 || state->values[i] >= state->values[i - 1]);
        assert_true(state->values[M08_NODES + i] >= 0.0 && state->values[M08_NODES + i] < 1e3);
    }
}

/* ---- the reference's curves ----------------------------------------------------------------- */

struct golden {
    char image;
    const char *parameter, *text;
    int display;
    double first_x; /* then in steps of 1 */
    int count;
    double y[6];
    double tolerance;
};

/* The notes' numbers, computed there by the reference implementation: met to their last digit.
 * But for picture B, whose halves lie 4 decades apart. Three pairs of its segments, that meet at
 * x = 0, 1.4 and 1.6, are crossed by no contrast that ends between the two, so that the optimum
 * determines their sum only. Ours is halved; the reference's split is arbitrary, and while it moves
 * from iteration to iteration the curve does not count as settled: it goes on to the limit. With
 * SETTLED at 1e-4 ours is within 1e-4 of it at all nodes but those three; as it is, within 0.012. */
static const struct golden goldens[] = {
    {'A', NULL, NULL, M08_LCD, -1, 6, {.3470, .6857, 1.0742, 1.4801, 1.8827, 2.3014}, 1e-4},
    {'A', "display", "lcd_office", M08_LCD_OFFICE, -1, 6,
     {.5582, .7835, 1.0539, 1.3520, 1.6630, 2.0055}, 1e-4},
    {'A', "display", "lcd_bright", M08_LCD_BRIGHT, -1, 6,
     {.2127, .6925, 1.2086, 1.7141, 2.1957, 2.6840}, 1e-4},
    {'A', "display", "crt", M08_CRT, -1, 6, {.3579, .5620, .8483, 1.1746, 1.5213, 1.9052}, 1e-4},
    {'A', "contrast", "1.15", M08_LCD, -1, 5, {.3310, .6571, 1.0434, 1.4551, 1.8677}, 1e-4},
    {'A', "white", "100", M08_LCD, -1, 5, {.6020, 1.1668, 1.7171, 2.1885, 2.2215}, 1e-4},
    {'A', "adaptation", "auto", M08_LCD, 0, 5, {.0220, .3915, .9748, 1.6309, 2.2721}, 1e-4},
    {'A', "visual-model", "none", M08_LCD, -1, 5, {.4185, .7838, 1.1490, 1.5143, 1.8795}, 1e-4},
    {'B', NULL, NULL, M08_LCD, -1, 2, {.5798, 1.0779}, 0.035},
    {'B', NULL, NULL, M08_LCD, 1, 3, {1.4725, 1.7604, 2.3014}, 0.01},
    {'E', NULL, NULL, M08_LCD, -1, 2, {.9776, 2.1994}, 1e-4},
    {'E', "display", "lcd_bright", M08_LCD_BRIGHT, -2, 3, {.2044, 1.3115, 2.5846}, 1e-4},
    {'F', NULL, NULL, M08_LCD, -1, 3, {2.0507, 2.1761, 2.3014}, 1e-4},
};

static int node_of(double x) { return (int)lrint((x - M08_X_MIN) / M08_STEP); }

static void test_golden(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof goldens / sizeof *goldens; i++) {
        const struct golden *g = &goldens[i];
        struct image image = golden_image(g->image);
        struct tonemap_settings s = settings_of(g->parameter, g->text);
        struct tonemap_state curve = measure(&image, &s, 2);

        check_curve(&curve, g->display);
        for (int k = 0; k < g->count; k++) {
            double y = curve.values[node_of(g->first_x + k)];
            if (!(fabs(y - g->y[k]) <= g->tolerance))
                fail_msg("picture %c, %s %s, x = %g: %.4f instead of %.4f", g->image, g->parameter ? g->parameter : "",
                         g->text ? g->text : "", g->first_x + k, y, g->y[k]);
        }
        image_release(&image);
    }
}

/* Steps between two flat halves at 0 and x, as Debian's pfstools 2.1.0 maps them (lcd): from 2.2
 * decades on some contrasts lie beyond the bins, from 3 on the curve has gaps. */
static void test_golden_steps(void **state)
{
    static const struct {
        double step;
        struct { int node; double y; } points[5];
    } steps[] = {
        {1.0015, {{80, .8483}, {82, 1.1500}, {84, 1.4234}, {87, 1.8136}, {90, 2.1828}}},
        {2.0030, {{80, .1715}, {84, .7369}, {89, 1.1856}, {94, 1.6326}, {99, 2.0929}}},
        {2.4, {{80, .1557}, {86, .8596}, {91, 1.2024}, {98, 1.6409}, {103, 2.1084}}},
        {2.6033, {{81, .3034}, {87, .8804}, {92, 1.2126}, {100, 1.6812}, {105, 2.1101}}},
        {3.3, {{81, .2781}, {88, .8733}, {95, 1.1916}, {105, 1.6085}, {111, 2.0322}}},
        {3.5, {{81, .2876}, {89, .8847}, {96, 1.2054}, {106, 1.6252}, {113, 2.0411}}},
        {3.0045, {{82, .4154}, {88, .9235}, {94, 1.2033}, {101, 1.5648}, {109, 2.1174}}},
    };

    (void)state;
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        struct image image = grey_image(SIDE, SIDE, 1.0f);
        struct tonemap_settings s = settings_of(NULL, NULL);
        struct tonemap_state curve;

        for (size_t p = 0; p < SIDE * SIDE; p++)
            if (p % SIDE >= SIDE / 2)
                set_pixel(&image, p, pow(10.0, steps[i].step));
        curve = measure(&image, &s, 2);
        for (int k = 0; k < 5; k++) {
            double y = curve.values[steps[i].points[k].node];
            if (!(fabs(y - steps[i].points[k].y) <= 2e-3))
                fail_msg("step %g, node %d: %.4f instead of %.4f", steps[i].step, steps[i].points[k].node, y,
                         steps[i].points[k].y);
        }
        image_release(&image);
    }
}

/* More contrast is given where there is room for it; an office's light takes the dark away. */
static void test_contrast_and_ambient(void **state)
{
    struct image low = grey_image(64, 64, 1.0f), wide = golden_image('A');
    struct tonemap_settings plain = settings_of(NULL, NULL), more = settings_of("contrast", "1.5"),
                            office = settings_of("display", "lcd_office");
    struct tonemap_state a, b;

    (void)state;
    for (size_t i = 0; i < 64 * 64; i++)
        set_pixel(&low, i, pow(10.0, 0.5 * (double)(i % 64) / 63.0 + 0.03 * (double)(i / 64 % 4)));
    a = measure(&low, &plain, 1);
    b = measure(&low, &more, 1);
    assert_true(b.values[node_of(0.5)] - b.values[node_of(0.0)] >
                1.2 * (a.values[node_of(0.5)] - a.values[node_of(0.0)]));
    assert_true(a.values[node_of(1.0)] > 2.30); /* anchored to the peak */
    a = measure(&wide, &plain, 1);
    b = measure(&wide, &office, 1);
    assert_true(b.values[M08_NODES - 1] - b.values[0] < a.values[M08_NODES - 1] - a.values[0]);
    image_release(&low);
    image_release(&wide);
}

/* ---- the visual model and the display ------------------------------------------------------- */

static void test_visual_model(void **state)
{
    (void)state;
    assert_true(m08_sensitivity(0.0, 100.0) == 0.0);
    /* By the formulas, computed apart from this code. */
    assert_true(fabs(m08_response(0.0, 100.0)) == 0.0);
    assert_true(m08_response(0.3, 100.0) == -m08_response(-0.3, 100.0));
    for (double f = 1.0; f < 16.0; f *= 2.0) {
        double before = 0.0;
        for (double l = -3.0; l <= 4.0; l += 0.25) { /* more light, better sight */
            double s = m08_sensitivity(f, pow(10.0, l));
            assert_true(isfinite(s) && s > before);
            before = s;
        }
    }
    /* A transducer rises. */
    for (double c = 0.01; c < 1.5; c += 0.01)
        assert_true(m08_response(c + 0.01, 60.0) > m08_response(c, 60.0));
    /* One threshold is about one just noticeable difference: W = 1 / S. */
    assert_true(fabs(m08_response(log10(1.0 + 1.0 / 50.0), 50.0) - 1.0) < 0.01);
}

static void test_display_inverts(void **state)
{
    static const double range[4][2] = {
        {.99099, 200.191}, {2.07324, 101.273}, {.53183, 500.032}, {1.38197, 80.382}};

    (void)state;
    for (int model = 0; model < 4; model++) {
        struct m08_display d;

        m08_display_init(&d, model, NULL);
        assert_true(fabs(m08_display_light(&d, 0.0) - range[model][0]) < 1e-5);
        assert_true(fabs(m08_display_light(&d, 1.0) - range[model][1]) < 1e-3);
        for (int i = 0; i <= 100; i++)
            assert_true(fabs(m08_display_code(&d, m08_display_light(&d, i / 100.0)) - i / 100.0) < 1e-9);
        assert_true(m08_display_code(&d, 0.0) == 0.0);
        assert_true(m08_display_code(&d, range[model][1] + 0.5) == 1.0);
        assert_true(m08_display_code(&d, 1e300) == 1.0);
    }
}

/* ---- display tables ------------------------------------------------------------------------- */

static status load(void **lut, const char *text, struct error *err)
{
    return m08_lut_load(lut, (const uint8_t *)text, strlen(text), "tv.csv", err);
}

static void test_lut(void **state)
{
    struct m08_display d;
    struct error err = {0};
    void *lut;

    (void)state;
    assert_int_equal(load(&lut, "# a television\r\n0,0.5\r\n\r\n 0.5 , 20\n1,1.8e2", &err), STATUS_OK);
    m08_display_init(&d, M08_LUT, lut);
    assert_true(fabs(m08_display_light(&d, 0.0) - 0.5) < 1e-9);
    assert_true(fabs(m08_display_light(&d, 0.25) - sqrt(0.5 * 20.0)) < 1e-9);
    assert_true(fabs(m08_display_light(&d, 1.0) - 180.0) < 1e-9);
    for (int i = 0; i <= 100; i++)
        assert_true(fabs(m08_display_code(&d, m08_display_light(&d, i / 100.0)) - i / 100.0) < 1e-9);
    assert_true(m08_display_code(&d, 0.0) == 0.0 && m08_display_code(&d, 0.1) == 0.0);
    assert_true(m08_display_code(&d, 1e9) == 1.0);
    m08_lut_free(lut);
}

static void test_lut_errors(void **state)
{
    static const struct {
        const char *text, *line;
    } bad[] = {
        {"", "line 0"},                 {"\n\n", "line 2"},
        {"0,1\n", "line 1"},            {"0,1\n0.9,2\n", "line 2"},
        {"0.1,1\n1,2\n", "line 1"},     {"0,1\n0.5,3\n0.5,4\n1,5\n", "line 3"},
        {"0,1\n0.5,0.5\n1,2\n", "line 2"}, {"0,0\n1,2\n", "line 1"},
        {"0,-1\n1,2\n", "line 1"},      {"0,1\n1.5,2\n", "line 2"},
        {"0,1\n1\n", "line 2"},         {"0,1\n1,2,3\n", "line 2"},
        {"0,1\n1,nan\n", "line 2"},     {"0,1\n1,inf\n", "line 2"},
        {"0,1\n1,0x10\n", "line 2"},    {"0,1\n1,1e999\n", "line 2"},
        {"0;1\n1;2\n", "line 1"},       {"code,light\n0,1\n1,2\n", "line 1"},
        {"0,1\n1,--2\n", "line 2"},     {"0,1\n,\n", "line 2"},
    };
    struct error err = {0};
    char *many = malloc(200000);
    void *lut;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (load(&lut, bad[i].text, &err) != STATUS_ERR_INPUT)
            fail_msg("accepted: %s", bad[i].text);
        assert_null(lut);
        assert_non_null(strstr(err.text, "tv.csv"));
        if (!strstr(err.text, bad[i].line))
            fail_msg("%s: not %s in %s", bad[i].text, bad[i].line, err.text);
        assert_non_null(strstr(err.text, "code,luminance"));
    }
    assert_int_equal(m08_lut_load(&lut, (const uint8_t *)"0,1\n1\0,2\n", 9, "tv.csv", &err), STATUS_ERR_INPUT);
    assert_non_null(many);
    memset(many, '1', 500);
    many[500] = 0;
    assert_int_equal(load(&lut, many, &err), STATUS_ERR_INPUT); /* one endless line */
    many[0] = 0;
    for (int i = 0, at = 0; i <= 4097; i++)
        at += sprintf(many + at, "%.17g,%d\n", i / 4097.0, i + 1);
    assert_int_equal(load(&lut, many, &err), STATUS_ERR_LIMIT);
    assert_non_null(strstr(err.text, "line 4097"));
    free(many);
}

/* A table of the lcd gives what the lcd gives; a table without display=lut, or the reverse, is an
 * error, for a black picture too. */
static void test_lut_in_use(void **state)
{
    struct image in = golden_image('A'), black = grey_image(3, 3, 0.0f), plain, table, out;
    struct tonemap_settings lcd = settings_of(NULL, NULL), lut = settings_of("display", "lut");
    struct m08_display d;
    char text[60000];
    struct tonemap_context context = {.file_data = (const uint8_t *)text};
    struct error err = {0};
    int at = 0;

    (void)state;
    m08_display_init(&d, M08_LCD, NULL);
    for (int i = 0; i <= 1024; i++)
        at += sprintf(text + at, "%.9g,%.15g\n", i / 1024.0, m08_display_light(&d, i / 1024.0));
    assert_int_equal(tonemap_apply(&plain, &in, &lcd, NULL, &err), STATUS_OK);
    assert_int_equal(tonemap_apply(&out, &in, &lut, NULL, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "lut"));
    assert_int_equal(tonemap_apply(&out, &black, &lut, NULL, &err), STATUS_ERR_INPUT);
    context.file_size = (size_t)at;
    lcd.has_file = lut.has_file = 1;
    strcpy(lut.file_name, "lcd.csv");
    assert_int_equal(tonemap_apply(&out, &in, &lcd, &context, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "lut"));
    assert_int_equal(tonemap_apply(&out, &black, &lcd, &context, &err), STATUS_ERR_INPUT);
    assert_int_equal(tonemap_apply(&table, &in, &lut, &context, &err), STATUS_OK);
    for (size_t i = 0; i < (size_t)SIDE * SIDE * 3; i++)
        assert_true(fabsf(plain.pixels[i] - table.pixels[i]) < 2e-3f);
    image_release(&plain);
    image_release(&table);
    image_release(&in);
    image_release(&black);
}

/* ---- the quadratic programme ---------------------------------------------------------------- */

static uint32_t random_state;

static double random_unit(void)
{
    random_state = random_state * 1664525u + 1013904223u;
    return (double)(random_state >> 8) / 16777216.0;
}

/* H = A'A of random rows, which may be fewer than the unknowns. */
static void random_programme(struct m08_programme *p, size_t count, size_t rows)
{
    memset(p, 0, sizeof *p);
    p->count = count;
    p->limit = 0.1 + 3.0 * random_unit();
    for (size_t r = 0; r < rows; r++) {
        double row[M08_SEGMENTS], weight = pow(10.0, 4.0 * random_unit());
        double target = 2.0 * random_unit() - 0.3;
        size_t first = (size_t)(random_unit() * (double)count);
        size_t last = first + 1 + (size_t)(random_unit() * 7.0);

        for (size_t i = 0; i < count; i++)
            row[i] = i >= first && i < last ? 0.2 + random_unit() : 0.0;
        for (size_t i = 0; i < count; i++) {
            p->f[i] -= weight * row[i] * target;
            for (size_t j = 0; j <= i; j++)
                p->h[i][j] += weight * row[i] * row[j];
        }
    }
}

static double gradient(const struct m08_programme *p, size_t i)
{
    double sum = p->f[i];

    for (size_t j = 0; j < p->count; j++)
        sum += (j <= i ? p->h[i][j] : p->h[j][i]) * p->d[j];
    return sum;
}

static double value_of(const struct m08_programme *p)
{
    double sum = 0.0;

    for (size_t i = 0; i < p->count; i++)
        sum += 0.5 * p->d[i] * (gradient(p, i) + p->f[i]);
    return sum;
}

/* The conditions of Karush, Kuhn and Tucker, by a multiplier found from the largest rise. The
 * solver leaves h and f scaled; the programme it was given is scaled alike. */
static void check_optimal(const struct m08_programme *p)
{
    double sum = 0.0, w = 0.0;

    for (size_t i = 0; i < p->count; i++) {
        assert_true(p->d[i] >= 0.0);
        sum += p->d[i];
    }
    assert_true(sum <= p->limit + 1e-8);
    if (sum > p->limit - 1e-3) /* the limit may press: by the mean over what is not at 0 */
        for (size_t i = 0; i < p->count; i++)
            w -= p->d[i] * gradient(p, i) / sum;
    assert_true(w >= -1e-5);
    for (size_t i = 0; i < p->count; i++) {
        double g = gradient(p, i) + w;

        assert_true(g >= -1e-5);
        assert_true(fabs(g * p->d[i]) < 1e-5);
    }
}

static void test_programme_is_optimal(void **state)
{
    struct m08_programme *p = calloc(1, sizeof *p);

    (void)state;
    assert_non_null(p);
    random_state = 8;
    for (int i = 0; i < 2000; i++) {
        size_t count = 1 + (size_t)(random_unit() * 40.0);

        if (i % 50 == 0)
            count = M08_SEGMENTS;
        random_programme(p, count, 1 + (size_t)(random_unit() * 2.0 * (double)count));
        assert_true(m08_programme_solve(p) < 40);
        check_optimal(p);
    }
    free(p);
}

/* Two and three unknowns against a search of the whole simplex. */
static void test_programme_brute_force(void **state)
{
    struct m08_programme *p = calloc(1, sizeof *p), *trial = calloc(1, sizeof *trial);

    (void)state;
    assert_true(p && trial);
    random_state = 80;
    for (int i = 0; i < 40; i++) {
        enum { STEPS = 60 };
        double best;

        random_programme(p, 2 + (size_t)(i % 2), 4);
        m08_programme_solve(p);
        best = value_of(p);
        memcpy(trial, p, sizeof *p);
        for (int a = 0; a <= STEPS; a++)
            for (int b = 0; a + b <= STEPS; b++)
                for (int c = 0; a + b + c <= (p->count == 3 ? STEPS : a + b); c++) {
                    trial->d[0] = p->limit * a / STEPS;
                    trial->d[1] = p->limit * b / STEPS;
                    trial->d[2] = p->limit * c / STEPS;
                    assert_true(value_of(trial) >= best - 1e-7);
                }
    }
    free(p);
    free(trial);
}

/* No equation at all, and one that no rise can meet. */
static void test_programme_edges(void **state)
{
    struct m08_programme *p = calloc(1, sizeof *p);

    (void)state;
    assert_non_null(p);
    p->count = 3;
    p->limit = 2.0;
    m08_programme_solve(p);
    check_optimal(p);
    memset(p, 0, sizeof *p);
    p->count = 1;
    p->limit = 2.0;
    p->h[0][0] = 1.0;
    p->f[0] = -100.0;
    m08_programme_solve(p);
    assert_true(fabs(p->d[0] - 2.0) < 1e-8);
    memset(p, 0, sizeof *p);
    p->count = 1;
    p->limit = 2.0;
    p->h[0][0] = 1.0;
    p->f[0] = 5.0;
    m08_programme_solve(p);
    assert_true(p->d[0] < 1e-8);
    free(p);
}

/* ---- pictures ------------------------------------------------------------------------------- */

static struct image apply_with(const struct image *in, const struct tonemap_settings *s, unsigned threads)
{
    struct tonemap_context context = {.threads = threads};
    struct image out;
    struct error err = {0};

    assert_int_equal(tonemap_apply(&out, in, s, &context, &err), STATUS_OK);
    for (size_t i = 0; i < (size_t)out.width * out.height * 3; i++)
        assert_true(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f); /* false for NaN */
    return out;
}

static struct image colourful_image(uint32_t width, uint32_t height)
{
    struct image image = grey_image(width, height, 0.0f);

    random_state = 5;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        image.pixels[i] = (float)pow(10.0, 5.0 * random_unit() - 3.0);
    return image;
}

static int same_pixels(const struct image *a, const struct image *b)
{
    return memcmp(a->pixels, b->pixels, (size_t)a->width * a->height * a->channels * sizeof *a->pixels) == 0;
}

static void test_threads(void **state)
{
    static const uint32_t sizes[][2] = {{333, 211}, {1, 300}, {300, 1}, {17, 9}};
    static const char *const details[] = {"1", "2.5"};

    (void)state;
    for (int i = 0; i < 8; i++) {
        struct image in = colourful_image(sizes[i / 2][0], sizes[i / 2][1]), one, three;
        struct tonemap_settings s = settings_of("detail", details[i % 2]);
        struct tonemap_state a = measure(&in, &s, 1), b = measure(&in, &s, 3);

        assert_memory_equal(a.values, b.values, sizeof a.values);
        one = apply_with(&in, &s, 1);
        three = apply_with(&in, &s, 3);
        assert_true(same_pixels(&one, &three));
        image_release(&in);
        image_release(&one);
        image_release(&three);
    }
}

/* At 1 detail is not there; elsewhere it is, and what is flat stays what it was. */
static void test_detail(void **state)
{
    struct image in = colourful_image(96, 64), flat = grey_image(80, 60, 0.3f), a, b;
    struct tonemap_settings one = settings_of("detail", "1"), more = settings_of("detail", "2"),
                            preset = settings_of(NULL, NULL);

    (void)state;
    a = apply_with(&in, &one, 2);
    b = apply_with(&in, &preset, 2);
    assert_true(same_pixels(&a, &b));
    image_release(&b);
    b = apply_with(&in, &more, 2);
    assert_false(same_pixels(&a, &b));
    image_release(&a);
    image_release(&b);
    a = apply_with(&flat, &one, 2);
    b = apply_with(&flat, &more, 2);
    for (size_t i = 0; i < 80 * 60 * 3; i++)
        assert_true(fabsf(a.pixels[i] - b.pixels[i]) < 1e-5f);
    image_release(&a);
    image_release(&b);
    image_release(&in);
    image_release(&flat);
}

/* A faint ripple on a slope grows nearly by the factor, and beside an edge of 2 decades there is no halo. */
static void test_detail_gain_and_halo(void **state)
{
    struct image ripple = grey_image(128, 64, 0.0f), edge = grey_image(128, 64, 1.0f), a, b;
    struct tonemap_settings one = settings_of("detail", "1"), twice = settings_of("detail", "2");
    struct m08_display d;
    double plain = 0.0, grown = 0.0;

    (void)state;
    m08_display_init(&d, M08_LCD, NULL);
    for (size_t i = 0; i < 128 * 64; i++) {
        set_pixel(&ripple, i, pow(10.0, (double)(i % 128) / 256.0 + (i % 2 ? 0.01 : -0.01)));
        if (i % 128 >= 64)
            set_pixel(&edge, i, 100.0);
    }
    a = apply_with(&ripple, &one, 1);
    b = apply_with(&ripple, &twice, 1);
    for (size_t i = 32 * 128 + 20; i < 32 * 128 + 108; i++) { /* second differences */
        const float *p = a.pixels + 3 * i, *q = b.pixels + 3 * i;
        plain += fabs(log10(m08_display_light(&d, (double)p[0])) - 0.5 * log10(m08_display_light(&d, (double)p[-3])) -
                      0.5 * log10(m08_display_light(&d, (double)p[3])));
        grown += fabs(log10(m08_display_light(&d, (double)q[0])) - 0.5 * log10(m08_display_light(&d, (double)q[-3])) -
                      0.5 * log10(m08_display_light(&d, (double)q[3])));
    }
    assert_true(grown > 1.5 * plain && grown < 2.1 * plain);
    image_release(&a);
    image_release(&b);
    a = apply_with(&edge, &one, 1);
    b = apply_with(&edge, &twice, 1);
    for (size_t i = 0; i < 128 * 64; i++)
        assert_true(fabsf(a.pixels[3 * i] - b.pixels[3 * i]) < 0.025f); /* 6 of 255 */
    image_release(&a);
    image_release(&b);
    image_release(&ripple);
    image_release(&edge);
}

/* A grey ramp rises with every set of parameters. */
static void test_monotone(void **state)
{
    static const char *const sets[][2] = {
        {NULL, NULL}, {"display", "lcd_office"}, {"display", "lcd_bright"}, {"display", "crt"},
        {"contrast", "0"}, {"contrast", "10"}, {"white", "1"}, {"white", "1e8"}, {"white", "1e-7"},
        {"adaptation", "auto"}, {"visual-model", "none"}, {"ppd", "1"}, {"ppd", "240"},
        {"saturation", "0"}, {"saturation", "2"}};

    (void)state;
    for (size_t k = 0; k < sizeof sets / sizeof *sets; k++) {
        struct tonemap_settings s = settings_of(sets[k][0], sets[k][1]);
        struct image in = grey_image(1601, 2, 0.0f), out;

        for (size_t i = 0; i < 1601 * 2; i++)
            set_pixel(&in, i, pow(10.0, (double)(i % 1601) / 100.0 - 8.0));
        out = apply_with(&in, &s, 2);
        for (size_t x = 1; x < 1601; x++)
            assert_true(out.pixels[3 * x] >= out.pixels[3 * x - 3]);
        image_release(&in);
        image_release(&out);
    }
}

/* One pixel, or none, of another kind than all others; also in lines one pixel wide. */
static void test_hard_inputs(void **state)
{
    static const float hard[] = {0.0f, -1.0f, NAN, INFINITY, 1e30f, FLT_MAX, 1e-40f, 1e-45f, 1.0f};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 40}, {40, 1}, {2, 2}, {33, 21}};
    static const char *const details[] = {"1", "3"};

    (void)state;
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++)
            for (int k = 0; k < 10; k++) {
                struct image in = grey_image(sizes[k / 2][0], sizes[k / 2][1], hard[a]), out;
                struct tonemap_settings s = settings_of("detail", details[k % 2]);

                in.pixels[1] = hard[b]; /* green alone */
                out = apply_with(&in, &s, 1);
                if (!(hard[a] > 0.0f) && !(hard[b] > 0.0f))
                    assert_true(out.pixels[0] == 0.0f && out.pixels[1] == 0.0f);
                image_release(&in);
                image_release(&out);
            }
}

static void test_black_and_firefly(void **state)
{
    struct tonemap_settings s = settings_of(NULL, NULL);
    struct image in = golden_image('E'), plain = apply_with(&in, &s, 2), out;
    size_t pixels = (size_t)SIDE * SIDE;

    (void)state;
    set_pixel(&in, 1000, 1e30);
    out = apply_with(&in, &s, 2);
    for (size_t i = 0; i < pixels; i++)
        if (i != 1000)
            assert_true(fabsf(out.pixels[3 * i] - plain.pixels[3 * i]) < 0.1f);
    assert_true(out.pixels[3000] == 1.0f);
    image_release(&out);
    for (size_t i = 0; i < pixels / 2; i++)
        set_pixel(&in, i, 0.0);
    out = apply_with(&in, &s, 2);
    assert_true(out.pixels[0] == 0.0f && out.pixels[pixels / 2 * 3 - 1] == 0.0f);
    assert_true(out.pixels[3 * pixels - 3] > 0.8f);
    image_release(&out);
    memset(in.pixels, 0, pixels * 3 * sizeof *in.pixels);
    in.pixels[3 * 500 + 2] = 7.0f; /* one blue pixel */
    out = apply_with(&in, &s, 2);
    assert_true(out.pixels[3 * 500 + 2] > 0.5f && out.pixels[3 * 501 + 2] == 0.0f);
    image_release(&out);
    image_release(&in);
    image_release(&plain);
}

static void test_saturation(void **state)
{
    struct tonemap_settings grey = settings_of("saturation", "0"), plain = settings_of(NULL, NULL),
                            more = settings_of("saturation", "1.6");
    struct image in = golden_image('A'), a, b, c;

    (void)state;
    for (size_t i = 0; i < (size_t)SIDE * SIDE; i++)
        in.pixels[3 * i] *= 1.6f;
    a = apply_with(&in, &grey, 2);
    b = apply_with(&in, &plain, 2);
    c = apply_with(&in, &more, 2);
    for (size_t i = 130 * SIDE + 60; i < 130 * SIDE + 200; i++) {
        assert_true(fabsf(a.pixels[3 * i] - a.pixels[3 * i + 2]) < 1e-5f);
        assert_true(b.pixels[3 * i] > b.pixels[3 * i + 1] * 1.02f);
        assert_true(c.pixels[3 * i] - c.pixels[3 * i + 1] > b.pixels[3 * i] - b.pixels[3 * i + 1]);
    }
    image_release(&a);
    image_release(&b);
    image_release(&c);
    image_release(&in);
}

/* A mean of two frames' curves is a curve. */
static void test_mean_state(void **state)
{
    struct image in[2] = {golden_image('A'), golden_image('E')}, out;
    struct tonemap_settings s = settings_of(NULL, NULL);
    struct tonemap_state a = measure(&in[0], &s, 1), b = measure(&in[1], &s, 1), mean;
    const struct tonemap_state *both[2] = {&a, &b};
    struct tonemap_context context = {.state = &mean};
    struct error err = {0};

    (void)state;
    tonemap_state_mean(&mean, both, 2, &s);
    check_curve(&mean, M08_LCD);
    assert_int_equal(tonemap_apply(&out, &in[1], &s, &context, &err), STATUS_OK);
    assert_true(out.pixels[3 * SIDE - 3] > out.pixels[0]);
    image_release(&out);
    image_release(&in[0]);
    image_release(&in[1]);
}

/* Out of memory anywhere: an error, and nothing is lost. */
static void test_no_memory(void **state)
{
    struct image in = colourful_image(20, 20);
    struct tonemap_settings s = settings_of("detail", "2");
    int failures = picture_out_of_memory(&in, &s);

    (void)state;
    assert_true(failures > 8 && failures < 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_golden),
        cmocka_unit_test(test_golden_steps),
        cmocka_unit_test(test_contrast_and_ambient),
        cmocka_unit_test(test_visual_model),
        cmocka_unit_test(test_display_inverts),
        cmocka_unit_test(test_lut),
        cmocka_unit_test(test_lut_errors),
        cmocka_unit_test(test_lut_in_use),
        cmocka_unit_test(test_programme_is_optimal),
        cmocka_unit_test(test_programme_brute_force),
        cmocka_unit_test(test_programme_edges),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_detail),
        cmocka_unit_test(test_detail_gain_and_halo),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_black_and_firefly),
        cmocka_unit_test(test_saturation),
        cmocka_unit_test(test_mean_state),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("mantiuk08", tests, NULL, NULL);
}
