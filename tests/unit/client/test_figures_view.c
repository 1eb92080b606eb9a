/* The line that people read: one milestone, and an interval only where it says something. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/follow/figures_view.h"

struct told {
    Azulejo__Wire__JobInfo job;
    Azulejo__Wire__HistoryPoint now;
    Azulejo__Wire__Figures figures;
    Azulejo__Wire__Forecast round, end, *forecasts[2];
};

/* 7.2 codes after 30 s; 5 codes in 40 s, 3 codes in 400 s. */
static void told_init(struct told *t)
{
    t->job = (Azulejo__Wire__JobInfo)AZULEJO__WIRE__JOB_INFO__INIT;
    t->now = (Azulejo__Wire__HistoryPoint)AZULEJO__WIRE__HISTORY_POINT__INIT;
    t->figures = (Azulejo__Wire__Figures)AZULEJO__WIRE__FIGURES__INIT;
    t->round = t->end = (Azulejo__Wire__Forecast)AZULEJO__WIRE__FORECAST__INIT;
    t->figures.display = 7.2;
    t->figures.reliable = 1;
    t->now.figures = &t->figures;
    t->job.now = &t->now;
    t->job.seconds_active = 30;
    t->job.seconds_left = -1;
    t->job.error_slope = NAN;
    t->round.display = 3;
    t->round.seconds = t->round.seconds_low = t->round.seconds_high = 400;
    t->end.display = 5;
    t->end.at_end = 1;
    t->end.seconds = t->end.seconds_low = t->end.seconds_high = 40;
    t->forecasts[0] = &t->round;
    t->forecasts[1] = &t->end;
    t->job.forecasts = t->forecasts;
    t->job.n_forecasts = 2;
}

static void expect_line(const struct told *t, const char *expected)
{
    struct buffer line = BUFFER_INIT;

    figures_describe_line(&line, &t->job, SIZE_MAX);
    assert_string_equal(buffer_text(&line), expected);
    buffer_release(&line);
}

static void the_end_is_the_milestone(void **state)
{
    struct told t;

    (void)state;
    told_init(&t);
    expect_line(&t, "7.2/255 now -> 5/255 at 1:10");
    t.figures.reliable = 0;
    expect_line(&t, "7.2/255? now -> 5/255 at 1:10");
    t.end.seconds = -1; /* no worker has it */
    expect_line(&t, "7.2/255? now");
    t.job.n_forecasts = 1; /* the end is not known, and a round number is no promise */
    expect_line(&t, "7.2/255? now");
    t.job.now = NULL;
    expect_line(&t, "");
}

/* What comes only after the end is a price, and no promise. */
static void the_curve_says_what_does_not_come(void **state)
{
    struct buffer line = BUFFER_INIT;
    struct told t;

    (void)state;
    told_init(&t);
    t.now.wall_seconds = 30;
    t.job.workers = 1;
    figures_describe_curve(&line, &t.job);
    assert_string_equal(buffer_text(&line),
                        "now 7.2/255 after 30 s; 3/255 would take 7 min; 5/255 at the end, in 40 s on this worker");
    buffer_clear(&line);
    t.round.display = 6;
    figures_describe_curve(&line, &t.job);
    assert_string_equal(buffer_text(&line),
                        "now 7.2/255 after 30 s; 6/255 in 7 min; 5/255 at the end, in 40 s on this worker");
    buffer_release(&line);
}

static void an_interval_is_narrower_than_ten(void **state)
{
    struct told t;

    (void)state;
    told_init(&t);
    t.end.seconds_low = 20;
    t.end.seconds_high = 100;
    expect_line(&t, "7.2/255 now -> 5/255 at 1:10 (50 s to 2:10)");
    t.end.seconds_high = 27096;
    expect_line(&t, "7.2/255 now -> 5/255 (too early to say when)");
    t.end.seconds_low = 0;
    t.end.seconds_high = 93;
    expect_line(&t, "7.2/255 now -> 5/255 (too early to say when)");
}

/* The interval goes first, then "now", then the time left: of 80 columns as of 40 nothing is cut. */
static void the_line_fits_a_terminal(void **state)
{
    static const struct {
        size_t columns;
        const char *expected;
    } cases[] = {{74, "36 s left  7.2/255? now -> 5/255 at 1:10 (50 s to 2:10)"},
                 {54, "36 s left  7.2/255? now -> 5/255 at 1:10"},
                 {39, "36 s left  7.2/255? -> 5/255 at 1:10"},
                 {35, "7.2/255? -> 5/255 at 1:10"},
                 {24, "7.2/255?"}};
    struct told t;

    (void)state;
    told_init(&t);
    t.figures.reliable = 0;
    t.job.seconds_left = 36;
    t.end.seconds_low = 20;
    t.end.seconds_high = 100;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct buffer line = BUFFER_INIT;
        figures_describe_line(&line, &t.job, cases[i].columns);
        assert_string_equal(buffer_text(&line), cases[i].expected);
        buffer_release(&line);
    }
}

/* The error falls, stands or rises, where the terminal has arrows. */
static void the_trend_is_an_arrow(void **state)
{
    struct told t;

    (void)state;
    told_init(&t);
    setenv("LC_ALL", "C.UTF-8", 1);
    t.job.error_slope = -0.5;
    expect_line(&t, "7.2/255\xe2\x86\x98 now -> 5/255 at 1:10");
    t.job.error_slope = 0.02;
    expect_line(&t, "7.2/255\xe2\x86\x92 now -> 5/255 at 1:10");
    t.job.error_slope = 0.3;
    expect_line(&t, "7.2/255\xe2\x86\x97 now -> 5/255 at 1:10");
    t.job.error_slope = NAN;
    expect_line(&t, "7.2/255 now -> 5/255 at 1:10");
    t.job.error_slope = -0.5;
    setenv("LC_ALL", "C", 1);
    expect_line(&t, "7.2/255 now -> 5/255 at 1:10");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_end_is_the_milestone),
                                       cmocka_unit_test(the_curve_says_what_does_not_come),
                                       cmocka_unit_test(an_interval_is_narrower_than_ten),
                                       cmocka_unit_test(the_line_fits_a_terminal),
                                       cmocka_unit_test(the_trend_is_an_arrow)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
