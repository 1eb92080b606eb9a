/* What a study says in numbers and sentences, how it is kept, and what the SVG writer promises. */
#include <locale.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/study/study_files.h"
#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"
#include "client/study/page/svg.h"
#include "common/base/memory.h"
#include "tests/support/starve.h"

/* Take the buffer's text, compare, and empty it. */
static void expect_text(struct buffer *text, const char *wanted)
{
    assert_true(buffer_ok(text));
    assert_string_equal(buffer_text(text), wanted);
    buffer_release(text);
}

static struct study_interval exactly(double value) { return (struct study_interval){value, value, value}; }

/* error = 94 * t^-.5: 94/255 after a core second, four times the time for half the error. */
static void make_study(struct study *s)
{
    study_init(s);
    study_text_set(&s->scene, "a <b> & \"c\" \xf0\x9f\x94\xa5");
    s->target_codes = 3;
    s->cores = 4;
    s->complete = 1;
    s->fit = (struct study_fit){{0.5, 0.45, 0.55}, 100, NAN, {9.4, 9.0, 9.4 * 9.4 / 9.0}};
    for (int i = 0; i < 5; i++) {
        struct study_point *p = study_add_point(&s->points);
        const double core_s = pow(10, i);
        p->core_s = core_s;
        p->wall_s = core_s / 4;
        p->codes = (struct study_interval){94 / sqrt(core_s), 90 / sqrt(core_s), 98 / sqrt(core_s)};
        p->reliable = 1;
        p->top_share = 0.04;
    }
}

static struct study_choice *make_choice(struct study *s, struct study_interval gain, double at,
                                        struct study_interval bias)
{
    struct study_question *q = study_add_question(s);
    struct study_choice *c = study_add_choice(q);

    study_text_set(&c->words, "Caustics off");
    c->gain = gain;
    c->gain_at = at;
    c->floor = bias;
    return c;
}

#define EXPECT_WORDS(call, wanted)       \
    do {                                 \
        struct buffer t_ = BUFFER_INIT;  \
        call;                            \
        expect_text(&t_, wanted);        \
    } while (0)

static void test_numbers(void **state)
{
    (void)state;
    EXPECT_WORDS(words_number(&t_, 3.21), "3.2");
    EXPECT_WORDS(words_number(&t_, 0.834), "0.83");
    EXPECT_WORDS(words_number(&t_, 9.96), "10");
    EXPECT_WORDS(words_number(&t_, 99.6), "100");
    EXPECT_WORDS(words_number(&t_, 1234), "1230");
    EXPECT_WORDS(words_number(&t_, 0), "0");
    EXPECT_WORDS(words_number(&t_, -0.5), "-0.50");
    EXPECT_WORDS(words_number(&t_, NAN), "?");
    EXPECT_WORDS(words_number(&t_, INFINITY), "?");
    EXPECT_WORDS(words_number(&t_, 3e20), "3.0e20");
    EXPECT_WORDS(words_exact(&t_, 3), "3");
    EXPECT_WORDS(words_exact(&t_, 2.5), "2.5");
    EXPECT_WORDS(words_time(&t_, 41), "41 s");
    EXPECT_WORDS(words_time(&t_, 120), "2.0 min");
    EXPECT_WORDS(words_time(&t_, 1500), "25 min");
    EXPECT_WORDS(words_time(&t_, 9000), "2.5 h");
    EXPECT_WORDS(words_core_time(&t_, 41), "41 core-seconds");
    EXPECT_WORDS(words_core_time(&t_, 720), "12 core-minutes");
    EXPECT_WORDS(words_core_time(&t_, 2880), "0.80 core-hours");
    EXPECT_WORDS(words_percent(&t_, 0.83), "83 %");
    EXPECT_WORDS(words_percent(&t_, 0.015), "1.5 %");
    EXPECT_WORDS(words_count(&t_, 4.2e9), "4.2 billion");
    EXPECT_WORDS(words_price(&t_, 0.005, "EUR"), "less than 0.01 EUR");
    EXPECT_WORDS(words_price(&t_, 1.5, "EUR"), "1.50 EUR");
    EXPECT_WORDS(words_codes(&t_, 11.2), "11/255");
}

/* The fit's cost and error are each other's inverse, bounds included. */
static void test_fit(void **state)
{
    struct study s;
    struct study_interval cost, back;

    (void)state;
    make_study(&s);
    cost = study_cost_of(&s, 3);
    assert_float_equal(cost.value, 100 * pow(9.4 / 3, 2), 0.01);
    assert_true(cost.low < cost.value && cost.value < cost.high);
    back = study_codes_after(&s, cost.high);
    assert_float_equal(back.high, 3, 1e-6);
    back = study_codes_after(&s, cost.low);
    assert_float_equal(back.low, 3, 1e-6);
    assert_float_equal(study_codes_after(&s, 100).low, 9.0, 1e-9);
    s.clock_noise = 0.3; /* as wide as the machine's times are */
    assert_true(study_cost_of(&s, 3).high > 1.05 * cost.high && study_cost_of(&s, 3).low < cost.low / 1.05);
    s.clock_noise = NAN;
    s.fit.start_core_s = 20; /* of 100: what is left is spent on rays */
    assert_float_equal(study_cost_of(&s, 4.7).value, 20 + 80 * 4, 0.01);
    assert_float_equal(study_cost_of(&s, 18.8).value, 20 + 80 / 4.0, 0.01);
    assert_true(isnan(study_codes_after(&s, 19).value));
    s.fit.start_core_s = NAN;
    s.fit.exponent.low = -0.1; /* perhaps it never gets better */
    assert_true(isnan(study_cost_of(&s, 3).high));
    s.fit.exponent.value = NAN;
    assert_true(isnan(study_cost_of(&s, 3).value));
    study_release(&s);
}

static void test_headline(void **state)
{
    struct study s;
    struct study_point *last;

    (void)state;
    make_study(&s);
    EXPECT_WORDS(study_say_headline(&t_, &s),
                 "3/255 costs 16 core-minutes; every halving of the error costs 4.0 times as much.");
    EXPECT_WORDS(study_say_wall(&t_, &s), "That is 4.1 min (2.8 to 6.9 min) on this machine (4 cores).");
    EXPECT_WORDS((void)study_say_trust(&t_, &s),
                 "The error is reliable: the samples agree on it, and it is spread over many pixels (the worst "
                 "0.1 % of them hold 4 % of it).");
    last = &s.points.items[s.points.count - 1];
    last->top_share = 0.43;
    EXPECT_WORDS((void)study_say_trust(&t_, &s),
                 "The error is reliable: the samples agree on it; but 43 % of the squared error is in 0.1 % of the "
                 "pixels, of which an error of 95 % says nothing.");
    last->reliable = 0;
    study_text_set(&last->reason, "83 % here; likely cause: fog");
    EXPECT_WORDS((void)study_say_trust(&t_, &s), "The error may be understated: 83 % here; "
                                                 "likely cause: fog.");
    EXPECT_WORDS(study_say_headline(&t_, &s), "3/255 costs at least 16 core-minutes; every halving of "
                                              "the error costs 4.0 times as much.");
    s.fit.exponent.value = NAN;
    s.points.count = 1;
    EXPECT_WORDS(study_say_headline(&t_, &s),
                 "94/255 after 1.0 core-seconds. What a smaller error costs needs more points.");
    s.points.count = 0;
    EXPECT_WORDS(study_say_headline(&t_, &s), "Nothing has been measured yet.");
    s.points.count = 5; /* so that all are released */
    study_release(&s);
}

static void test_choices(void **state)
{
    struct study s;
    struct study_choice *c;

    (void)state;
    make_study(&s);
    c = make_choice(&s, (struct study_interval){2.1, 2.0, 2.2}, 10,
                    (struct study_interval){5, 4.7, 5.3});
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: 2.1 times less time to 10/255 (2.0 to "
                                               "2.2), never better than 5.0/255 (4.7 to 5.3).");
    c = make_choice(&s, (struct study_interval){1 / 1.9, 0.5, 1 / 1.8}, 3,
                    (struct study_interval){0.004, 0, 0.01});
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: 1.9 times the time to 3/255 (1.8 to "
                                               "2.0), the same picture to 0.01/255.");
    c = make_choice(&s, (struct study_interval){1, 0.98, 1.03}, 3,
                    (struct study_interval){0.02, 0, 0.1});
    study_text_set(&c->note, "half the bytes");
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: no clear difference in time (0.95 to 1.0 "
                                               "times), the same picture to 0.1/255; half the bytes.");
    assert_true(study_choice_weight(&s, c) == 0);
    /* A bias that may be none is not said to be one. */
    c = make_choice(&s, (struct study_interval){1.2, 1.1, 1.3}, 3,
                    (struct study_interval){0.9, 0, 1.8});
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: no clear difference in time (0.73 to 0.96 times), so few "
                                               "samples do not exclude a difference of up to 1.8/255.");
    c = make_choice(&s, exactly(NAN), NAN, exactly(NAN));
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: not measured yet.");
    assert_true(isnan(study_choice_weight(&s, c)));
    study_release(&s);
}

/* What a render with a target does is in the headline, once it certainly differs. */
static void test_headline_by_target(void **state)
{
    struct study s;
    struct study_choice *c;

    (void)state;
    make_study(&s);
    c = make_choice(&s, (struct study_interval){1.6, 1.5, 1.7}, 3, exactly(0));
    assert_null(study_by_target(&s));
    c->by_target = 1;
    EXPECT_WORDS(study_say_headline(&t_, &s),
                 "3/255 costs 10 core-minutes with adaptive sampling, as --target-error renders (16 core-minutes with "
                 "the same samples everywhere); every halving of the error costs 4.0 times as much.");
    assert_true(study_headline_cost(&s).low < study_target_cost(&s).low / 1.5);
    c->gain = (struct study_interval){1.2, 1.06, 1.36}; /* one way of thirty may seem as good by chance */
    assert_null(study_by_target(&s));
    assert_float_equal(study_headline_cost(&s).value, study_target_cost(&s).value, 1e-9);
    study_release(&s);
}

static void test_light_that_is_taken(void **state)
{
    struct study s;
    struct study_choice *c;

    (void)state;
    make_study(&s);
    c = make_choice(&s, (struct study_interval){1, 0.9, 1.1}, 3, (struct study_interval){0.004, 0, 0.01});
    c->taken = 0.52;
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: no clear difference in time (0.86 to 1.2 times), 95 of 100 "
                                               "pixels are the same to 0.01/255 and the others lose 52 % of the "
                                               "picture's light.");
    c->taken = 0.002;
    EXPECT_WORDS(study_say_choice(&t_, &s, c), "Caustics off: no clear difference in time (0.86 to 1.2 times), the same "
                                               "picture to 0.01/255; takes away 0.20 % of the light.");
    study_release(&s);
}

static void test_small_pictures(void **state)
{
    struct study s;
    struct buffer text = BUFFER_INIT;

    (void)state;
    make_study(&s);
    EXPECT_WORDS(study_say_small(&t_, &s), "");
    s.width = 161;
    s.height = 160;
    EXPECT_WORDS(study_say_small(&t_, &s), "");
    s.width = 32;
    s.height = 33;
    study_say_small(&text, &s);
    assert_non_null(strstr(buffer_text(&text), "A picture of 32x33 pixels has 6 tiles of 16x16. Below some 100 it cannot show"));
    buffer_release(&text);
    study_release(&s);
}

static void test_order(void **state)
{
    struct study s;
    size_t order[5];
    const double gains[5] = {1, 1.5, NAN, 1.0 / 31, 4};
    const size_t wanted[5] = {3, 4, 1, 0, 2};

    (void)state;
    make_study(&s);
    for (int i = 0; i < 5; i++)
        make_choice(&s, exactly(gains[i]), 3, i == 2 ? exactly(NAN) : exactly(0));
    study_order_questions(&s, order);
    assert_memory_equal(order, wanted, sizeof order);
    study_release(&s);
}

/* ---- kept as JSON ---------------------------------------------------------------------------- */

static void fill(struct study *s)
{
    static const uint8_t rgb[2 * 1 * 3] = {0, 1, 254, 255, 127, 128};
    struct study_region *region;
    struct study_crop *crop;

    make_study(s);
    make_choice(s, exactly(2), 3, exactly(NAN));
    region = study_add_region(s);
    crop = study_add_crop(region);
    crop->picture = (struct study_picture){2, 1, mem_memdup(rgb, sizeof rgb)};
    study_add_effect(s)->saved = exactly(0.1);
    study_add_worker(s)->cores = 2;
    study_add_bin(s)->count = 3;
    study_add_prediction(s)->core_s = (struct study_interval){2, 1, INFINITY};
}

static void test_round_trip(void **state)
{
    struct buffer first = BUFFER_INIT, second = BUFFER_INIT;
    struct error err = {0};
    struct study s, back;

    (void)state;
    fill(&s);
    study_init(&back);
    assert_int_equal(study_write(&first, &s, &err), STATUS_OK);
    assert_int_equal(study_read(&back, buffer_text(&first), first.size, "a", &err), STATUS_OK);
    assert_int_equal(study_write(&second, &back, &err), STATUS_OK);
    assert_string_equal(buffer_text(&first), buffer_text(&second));
    assert_string_equal(back.scene, s.scene);
    assert_memory_equal(back.regions.items[0].crops.items[0].picture.rgb, s.regions.items[0].crops.items[0].picture.rgb,
                        6);
    assert_true(back.points.items[3].codes.low == s.points.items[3].codes.low);
    buffer_release(&second);
    buffer_release(&first);
    study_release(&back);
    study_release(&s);
}

static void expect_refused(const char *json, const char *words)
{
    struct error err = {0};
    struct study s;

    study_init(&s);
    assert_int_equal(study_read(&s, json, strlen(json), "f.json", &err), STATUS_ERR_INPUT);
    if (!strstr(err.text, words) || !strstr(err.text, "f.json"))
        fail_msg("'%s' does not say '%s'", err.text, words);
    study_release(&s);
}

static void test_bad_files(void **state)
{
    (void)state;
    expect_refused("{", "line 1");
    expect_refused("[]", "azulejo_study");
    expect_refused("{\"azulejo_study\":2}", "azulejo_study");
    expect_refused("{\"azulejo_study\":1,\"scene\":3}", "scene is not a text");
    expect_refused("{\"azulejo_study\":1,\"points\":[{},{\"codes\":[1,2]}]}",
                   "points[1].codes is not [value, low, high]");
    expect_refused("{\"azulejo_study\":1,\"points\":[{\"codes\":[1,3,2]}]}", "points[0].codes");
    expect_refused("{\"azulejo_study\":1,\"questions\":[{\"choices\":[{\"points\":7}]}]}",
                   "questions[0].choices[0].points is not a list");
    expect_refused("{\"azulejo_study\":1,\"regions\":[{\"crops\":[{\"picture\":\"@@@@\"}]}]}",
                   "regions[0].crops[0].picture is not a PNG");
    expect_refused("{\"azulejo_study\":1,\"regions\":[{\"crops\":[{\"picture\":\"aGFs\"}]}]}", "PNG");
    expect_refused("{\"azulejo_study\":1,\"tile_error\":{\"columns\":2,\"rows\":2,\"values\":[1]}}", "tile_error");
}

static status read_and_show(void *user)
{
    const struct buffer *json = user;
    struct buffer page = BUFFER_INIT;
    struct error err = {0};
    struct study back;
    status result;

    study_init(&back);
    result = study_read(&back, buffer_text(json), json->size, "a", &err);
    THEN(result, study_page(&page, &back, &err));
    buffer_release(&page);
    study_release(&back);
    return result;
}

static void test_out_of_memory(void **state)
{
    struct buffer json = BUFFER_INIT;
    struct error err = {0};
    struct study s;

    (void)state;
    fill(&s);
    assert_int_equal(study_write(&json, &s, &err), STATUS_OK);
    assert_true(starve_each(read_and_show, &json, 0) > 100);
    buffer_release(&json);
    study_release(&s);
}

/* ---- SVG --------------------------------------------------------------------------------------- */

static void test_escape(void **state)
{
    (void)state;
    EXPECT_WORDS(svg_escape(&t_, "a<b>&\"c' \xf0\x9f\x94\xa5"), "a&lt;b&gt;&amp;&quot;c&#39; \xf0\x9f\x94\xa5");
    EXPECT_WORDS(svg_escape(&t_, "x\x1b\x7f\xff\xc2\x85y"), "x\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbdy");
    EXPECT_WORDS(svg_escape(&t_, "\xed\xa0\x80"), "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd"); /* a surrogate */
    EXPECT_WORDS(svg_escape(&t_, NULL), "");
    EXPECT_WORDS(svg_text(&t_, 1, 2, SVG_END, "c", "<script>"),
                 "<text x=\"1\" y=\"2\" text-anchor=\"end\" class=\"c\">&lt;script&gt;</text>\n");
}

/* A locale with a decimal comma, where the machine has one, changes nothing. */
static void test_coordinates(void **state)
{
    static const char wanted[] = "<line x1=\"0.5\" y1=\"-1.25\" x2=\"3\" y2=\"0.07\" class=\"c\"/>\n";

    (void)state;
    EXPECT_WORDS(svg_line(&t_, 0.5, -1.25, 3, 0.07, "c"), wanted);
    if (setlocale(LC_ALL, "de_DE.UTF-8") || setlocale(LC_ALL, "fr_FR.UTF-8")) {
        EXPECT_WORDS(svg_line(&t_, 0.5, -1.25, 3, 0.07, "c"), wanted);
        EXPECT_WORDS(words_number(&t_, 3.2), "3.2");
        setlocale(LC_ALL, "C");
    }
    EXPECT_WORDS(svg_line(&t_, NAN, 0, 1, 1, "c"), "");
    EXPECT_WORDS(svg_circle(&t_, INFINITY, 0, 1, "c"), "");
}

static void test_axis(void **state)
{
    const struct svg_axis axis = {1, 100, 0, 200};

    (void)state;
    assert_float_equal(svg_axis_at(&axis, 10), 100, 1e-9);
    assert_float_equal(svg_axis_value(&axis, 50), sqrt(10), 1e-9);
    assert_true(isnan(svg_axis_at(&axis, 0)));
    assert_true(isnan(svg_axis_at(&axis, -1)));
}

static void test_spread(void **state)
{
    double heights[4] = {50, 51, 52, 99}, top[3] = {5, 6, 7};

    (void)state;
    svg_spread(heights, 4, 14, 0, 100);
    for (int i = 1; i < 4; i++)
        assert_true(heights[i] - heights[i - 1] >= 14 - 1e-9);
    assert_true(heights[0] >= 0 && heights[3] <= 100);
    svg_spread(top, 3, 14, 4, 100);
    for (int i = 0; i < 3; i++)
        assert_float_equal(top[i], 5 + 14 * i, 1e-9);
}

static void test_labels_keep_apart(void **state)
{
    struct svg_taken taken = {.bounds = {0, 0, 400, 300}};
    struct buffer out = BUFFER_INIT;
    int written = 0;

    (void)state;
    for (int i = 0; i < 8; i++)
        written += svg_label(&out, &taken, 200, 150, 0, 12, "c", "some words");
    assert_in_range(written, 3, 8);
    assert_int_equal(taken.count, (size_t)written);
    for (size_t i = 0; i < taken.count; i++)
        for (size_t k = 0; k < i; k++) {
            const struct svg_box *a = &taken.boxes[i], *b = &taken.boxes[k];
            assert_false(a->x0 < b->x1 && b->x0 < a->x1 && a->y0 < b->y1 && b->y0 < a->y1);
        }
    /* At the right edge it goes to the left. */
    assert_true(svg_label(&out, &taken, 398, 20, 0, 12, "c", "edge"));
    assert_true(taken.boxes[taken.count - 1].x1 <= 400);
    buffer_release(&out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers),       cmocka_unit_test(test_fit),
        cmocka_unit_test(test_headline),      cmocka_unit_test(test_choices),
        cmocka_unit_test(test_headline_by_target),
        cmocka_unit_test(test_light_that_is_taken),
        cmocka_unit_test(test_small_pictures),
        cmocka_unit_test(test_order),         cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_bad_files),     cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_escape),        cmocka_unit_test(test_coordinates),
        cmocka_unit_test(test_axis),          cmocka_unit_test(test_spread),
        cmocka_unit_test(test_labels_keep_apart),
    };

    return cmocka_run_group_tests_name("client/study", tests, NULL, NULL);
}
