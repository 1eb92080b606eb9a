#include "tests/support/radiance.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/figure.h"

/* Where nothing is random but the rounding of float, rounding is what is left. */
#define ROUNDING 2e-5

typedef void frame_fn(const double *picture, void *user);

/* Returns how many samples were dropped. */
static uint64_t each_frame(struct scene_builder *b, const struct render_settings *settings, frame_fn *take, void *user)
{
    struct render_scene *scene = builder_build(b, settings);
    struct render_stats stats = {0};
    double *picture = test_malloc((size_t)settings->width * settings->height * 3 * sizeof *picture);

    for (uint32_t frame = 0; frame < RADIANCE_FRAMES; frame++) {
        builder_render(scene, settings, frame, picture, NULL, &stats);
        take(picture, user);
    }
    test_free(picture);
    render_scene_free(scene);
    return stats.work.dropped_samples;
}

struct channel_means {
    size_t pixels;
    struct running_stats *out;
};

static void take_means(const double *picture, void *user)
{
    const struct channel_means *m = user;

    for (size_t c = 0; c < 3; c++) {
        double sum = 0;
        for (size_t i = 0; i < m->pixels; i++)
            sum += picture[3 * i + c];
        running_stats_add(&m->out[c], sum / (double)m->pixels);
    }
}

static uint64_t measure_channels(struct scene_builder *b, const struct render_settings *settings,
                                 struct running_stats out[3])
{
    struct channel_means m = {(size_t)settings->width * settings->height, out};

    for (int c = 0; c < 3; c++)
        out[c] = (struct running_stats){0};
    return each_frame(b, settings, take_means, &m);
}

void radiance_measure(struct scene_builder *b, const struct render_settings *settings, struct running_stats out[3])
{
    assert_int_equal(measure_channels(b, settings, out), 0);
}

void radiance_figure(struct scene_builder *b, const struct render_settings *settings, unsigned comparisons, int channel,
                     double expected, const char *what)
{
    struct running_stats s[3];
    double level = sidak_alpha(RADIANCE_SIGNIFICANCE, comparisons), within;
    char words[96];

    (void)measure_channels(b, settings, s);
    within = student_quantile(1 - level / 2, RADIANCE_FRAMES - 1) * running_stats_error(&s[channel]) +
             ROUNDING * fabs(expected);
    snprintf(words, sizeof words, "closed form, significance %g over %u tests", RADIANCE_SIGNIFICANCE, comparisons);
    figure_within(what, s[channel].mean, expected - within, expected + within, words);
}

static void judge(const struct running_stats *s, unsigned comparisons, double expected, const char *what,
                  const char *part)
{
    double alpha = sidak_alpha(RADIANCE_SIGNIFICANCE, comparisons);
    double p = mean_test_p_value(s, expected);
    double slack =
        fmax(ROUNDING * fabs(expected), running_stats_error(s) * student_quantile(1 - alpha / 2, (double)s->count - 1));

    printf("# figure %s%s = %.6g in [%.6g, %.6g], significance %g over %u tests\n", what, part, s->mean,
           expected - slack, expected + slack, RADIANCE_SIGNIFICANCE, comparisons);
    fflush(stdout);
    if (fabs(s->mean - expected) <= ROUNDING * fabs(expected))
        return;
    if (p < alpha)
        fail_msg("%s%s: mean %.7g +- %.2g, expected %.7g (p = %.2g)", what, part, s->mean, running_stats_error(s),
                 expected, p);
}

static const char *const channel_names[] = {", red", ", green", ", blue"};

void radiance_expect_rgb(struct scene_builder *b, const struct render_settings *settings, unsigned channels,
                         const double expected[3], const char *what)
{
    struct running_stats s[3];

    radiance_measure(b, settings, s);
    for (int c = 0; c < 3; c++)
        judge(&s[c], channels, expected[c], what, channel_names[c]);
}

void radiance_expect_same_at(struct scene_builder *a, const struct render_settings *at_a, struct scene_builder *b,
                             const struct render_settings *at_b, unsigned channels, const char *what)
{
    struct running_stats first[3], second[3];

    radiance_measure(a, at_a, first);
    radiance_measure(b, at_b, second);
    for (int c = 0; c < 3; c++) {
        second[c].sum_squares += first[c].sum_squares; /* the variance of the difference of both means */
        judge(&second[c], channels, first[c].mean, what, channel_names[c]);
    }
}

void radiance_expect_same(struct scene_builder *a, struct scene_builder *b, const struct render_settings *settings,
                          unsigned channels, const char *what)
{
    radiance_expect_same_at(a, settings, b, settings, channels, what);
}

void radiance_expect(struct scene_builder *b, const struct render_settings *settings, unsigned channels,
                     double expected, const char *what)
{
    const double rgb[3] = {expected, expected, expected};

    radiance_expect_rgb(b, settings, channels, rgb, what);
}

struct value_means {
    const struct render_settings *settings;
    radiance_measure_fn *measure;
    const void *user;
    struct running_stats out;
};

static void take_value(const double *picture, void *user)
{
    struct value_means *m = user;

    running_stats_add(&m->out, m->measure(picture, m->settings, m->user));
}

void radiance_expect_value(struct scene_builder *b, const struct render_settings *settings, unsigned comparisons,
                           radiance_measure_fn *measure, const void *user, double expected, const char *what)
{
    struct value_means m = {settings, measure, user, {0}};

    assert_int_equal(each_frame(b, settings, take_value, &m), 0);
    judge(&m.out, comparisons, expected, what, "");
}

int radiance_differs(struct scene_builder *b, const struct render_settings *settings, double expected)
{
    struct running_stats s[3];
    int differs = 0;

    radiance_measure(b, settings, s);
    for (int c = 0; c < 3; c++)
        differs |= fabs(s[c].mean - expected) > 1e-3 * fabs(expected) && mean_test_p_value(&s[c], expected) < 1e-6;
    return differs;
}
