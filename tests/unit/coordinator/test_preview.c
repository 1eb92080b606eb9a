/* When a kept preview is made again, and when it is sent. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/frame/preview.h"

#define COST_NS (200 * NS_PER_MS)
#define AT(seconds) ((uint64_t)((seconds) * 1e9))

static struct preview made(double covered, uint64_t samples, double at_s)
{
    struct preview p = {.covered = covered, .samples = samples, .made_ns = AT(at_s), .cost_ns = COST_NS};
    struct buffer bytes = BUFFER_INIT;

    buffer_puts(&bytes, "picture");
    p.file = preview_file_new(&bytes);
    assert_non_null(p.file);
    return p;
}

static struct preview_now now(double covered, uint64_t samples, double at_s)
{
    return (struct preview_now){.covered = covered, .samples = samples, .now_ns = AT(at_s)};
}

static int due(const struct preview *p, struct preview_now when) { return preview_is_due(p, &when); }

static int good(const struct preview *p, enum preview_kind kind, struct preview_now when)
{
    return preview_is_good(p, kind, &when);
}

static void none_is_made_that_nobody_asks_for(void **state)
{
    struct preview p = {0}, kept = made(1, 1000, 100);

    (void)state;
    assert_false(due(&p, now(0, 0, 1)));
    assert_false(due(&p, now(1, 90000, 100)));
    assert_false(good(&p, PREVIEW_PNG, now(0.07, 140, 1)));
    assert_false(due(&kept, now(1, 90000, 5000)));
    kept.asked_ns = AT(5000);
    assert_true(due(&kept, now(1, 90000, 5000)));
    kept.too_large = 1;
    assert_false(due(&kept, now(1, 90000, 5000)));
    preview_release(&kept);
}

static void watched_ones_follow_at_growing_intervals(void **state)
{
    struct preview p = made(1, 1000, 100);

    (void)state;
    p.asked_ns = AT(101);
    assert_false(due(&p, now(1, 1001, 104)));
    assert_true(due(&p, now(1, 1001, 105)));
    assert_false(due(&p, now(1, 1000, 120))); /* nothing new */
    assert_false(due(&p, now(1, 1001, 131))); /* not watched any more */
    p.covered = 0.1;
    p.asked_ns = AT(100.1);
    assert_true(due(&p, now(0.2, 2000, 100.2))); /* until it is covered, whenever the samples have doubled */
    assert_false(due(&p, now(0.19, 1999, 100.2)));
    preview_release(&p);
}

static void a_png_is_sent_at_once_but_not_of_another_film_or_look(void **state)
{
    struct preview p = made(1, 1000, 100);
    struct preview_now other = now(1, 1000, 101);

    (void)state;
    assert_true(good(&p, PREVIEW_PNG, now(1, 90000, 5000)));
    assert_false(good(&p, PREVIEW_PNG, now(1, 999, 101))); /* it began again */
    other.revision = 1;
    assert_false(good(&p, PREVIEW_PNG, other));
    p.asked_ns = AT(101);
    assert_false(due(&p, other)); /* not before it has rested */
    other.now_ns = AT(110);
    assert_true(due(&p, other));
    p.covered = 0.5;
    assert_true(good(&p, PREVIEW_PNG, now(0.9, 1999, 101)));
    assert_false(good(&p, PREVIEW_PNG, now(1, 2000, 101)));
    preview_release(&p);
}

static void one_is_kept_while_it_is_asked_for(void **state)
{
    struct preview p = made(1, 1000, 100);
    struct preview_now later = now(1, 90000, 120);

    (void)state;
    assert_true(good(&p, PREVIEW_EXR, now(1, 2000, 104)));
    assert_false(good(&p, PREVIEW_EXR, now(1, 2000, 106)));
    assert_true(good(&p, PREVIEW_EXR, now(1, 1000, 106))); /* the film is as it was */
    p.asked_ns = AT(100);
    assert_true(due(&p, later));
    preview_age(&p, AT(120));
    assert_true(p.file);
    preview_age(&p, AT(131));
    assert_true(!p.file);
    preview_release(&p);
}

/* What keeping a preview costs over a job of any length: at most 4 % of a processor. */
static void the_cost_is_bounded(void **state)
{
    struct preview p = {.asked_ns = AT(1)};
    double cost_s = 0, end_s = 1000;

    (void)state;
    for (double t = 1; t < end_s; t += 0.1) {
        struct preview_now when = now(1, (uint64_t)(t * 1e6), t);
        p.asked_ns = when.now_ns;
        if (!due(&p, when))
            continue;
        cost_s += COST_NS / 1e9;
        preview_release(&p);
        p = made(1, when.samples, t);
    }
    assert_true(cost_s / end_s <= 0.041);
    assert_true(cost_s > 1);
    preview_release(&p);
}

static void bytes_live_as_long_as_a_holder(void **state)
{
    struct preview p = made(1, 1000, 100);
    struct preview_file *sent = preview_file_hold(p.file);

    (void)state;
    preview_release(&p);
    assert_null(p.file);
    assert_string_equal(buffer_text(&sent->bytes), "picture");
    preview_file_drop(sent); /* the memory checkers see a leak, or a second release */
    preview_file_drop(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(none_is_made_that_nobody_asks_for),
        cmocka_unit_test(watched_ones_follow_at_growing_intervals),
        cmocka_unit_test(a_png_is_sent_at_once_but_not_of_another_film_or_look),
        cmocka_unit_test(one_is_kept_while_it_is_asked_for),
        cmocka_unit_test(the_cost_is_bounded),
        cmocka_unit_test(bytes_live_as_long_as_a_holder),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
