#include "client/study/data/study_words.h"

#include <math.h>
#include <string.h>

#include "common/accuracy/word.h"

#define DAY_S 86400.0
#define TOP_MUCH 0.1   /* of the squared error in 0.1 % of the pixels: that is not spread */
#define TAKEN_MUCH 0.01 /* of the light: that is not the same picture */

/* ---- numbers ------------------------------------------------------------------------------- */

/* `value` with this many decimals, made from integers: the locale has no effect. */
static void put_fixed(struct buffer *out, double value, int decimals)
{
    long long scale = 1, whole;

    for (int i = 0; i < decimals; i++)
        scale *= 10;
    whole = llround(fabs(value) * (double)scale);
    buffer_printf(out, "%s%lld", value < 0 && whole > 0 ? "-" : "", whole / scale);
    if (decimals > 0)
        buffer_printf(out, ".%0*lld", decimals, whole % scale);
}

/* The number of decimals for `digits` significant digits. */
static int decimals_for(double value, int digits)
{
    int exponent;

    if (!(fabs(value) > 0))
        return 0;
    exponent = (int)floor(log10(fabs(value)) + 1e-9);
    /* 9.96 becomes 10, not 10.0. */
    if (fabs(value) * pow(10, digits - 1 - exponent) >= pow(10, digits) - 0.5)
        exponent++;
    return (int)fmin(fmax(0, digits - 1 - exponent), 12);
}

void words_number(struct buffer *out, double value)
{
    if (!isfinite(value)) {
        buffer_puts(out, "?");
        return;
    }
    if (fabs(value) >= 1e15 || (value != 0 && fabs(value) < 1e-6)) {
        int exponent = (int)floor(log10(fabs(value)) + 1e-9);
        put_fixed(out, value / pow(10, exponent), 1);
        buffer_printf(out, "e%d", exponent);
        return;
    }
    if (fabs(value) >= 1000) {
        double step = pow(10, floor(log10(fabs(value)) + 1e-9) - 2);
        value = round(value / step) * step;
    }
    put_fixed(out, value, decimals_for(value, 2));
}

void words_exact(struct buffer *out, double value)
{
    int decimals = 0;

    if (!isfinite(value) || fabs(value) >= 1e6 || (value != 0 && fabs(value) < 1e-3)) {
        words_number(out, value);
        return;
    }
    while (decimals < 3 && fabs(value * pow(10, decimals) - round(value * pow(10, decimals))) > 1e-6)
        decimals++;
    put_fixed(out, value, decimals);
}

void words_count(struct buffer *out, double value)
{
    static const char *const names[] = {"", " thousand", " million", " billion", " trillion"};
    int step = 0;

    if (fabs(value) < 999.5 && value == floor(value)) {
        buffer_printf(out, "%.0f", value);
        return;
    }
    while (step < 4 && fabs(value) >= 999.5) {
        value /= 1000;
        step++;
    }
    words_number(out, value);
    buffer_puts(out, names[step]);
}

void words_codes(struct buffer *out, double codes)
{
    words_number(out, codes);
    buffer_puts(out, "/255");
}

void words_time(struct buffer *out, double seconds)
{
    static const struct {
        double below, unit;
        const char *name;
    } units[] = {{0.1, 1e-3, " ms"}, {90, 1, " s"}, {5400, 60, " min"}, {2 * DAY_S, 3600, " h"}, {INFINITY, DAY_S, " days"}};
    int i = 0;

    if (!isfinite(seconds)) {
        buffer_puts(out, "?");
        return;
    }
    while (seconds >= units[i].below)
        i++;
    words_number(out, seconds / units[i].unit);
    buffer_puts(out, units[i].name);
}

static double core_unit(double core_s, const char **name)
{
    if (core_s >= 1800) {
        *name = "core-hours";
        return 3600;
    }
    *name = core_s >= 100 ? "core-minutes" : "core-seconds";
    return core_s >= 100 ? 60 : 1;
}

void words_core_time(struct buffer *out, double core_s)
{
    const char *name;
    double unit = core_unit(core_s, &name);

    words_number(out, core_s / unit);
    buffer_printf(out, " %s", name);
}

void words_price(struct buffer *out, double price, const char *currency)
{
    if (price > 0 && price < 0.01)
        buffer_puts(out, "less than 0.01");
    else if (price < 100)
        put_fixed(out, price, 2);
    else
        words_number(out, price);
    if (currency)
        buffer_printf(out, " %s", currency);
}

void words_percent(struct buffer *out, double share)
{
    if (fabs(share) >= 0.01)
        words_exact(out, round(1000 * share) / 10);
    else
        words_number(out, 100 * share);
    buffer_puts(out, " %");
}

void words_range(struct buffer *out, const struct study_interval *v, double unit)
{
    if (!isfinite(v->low) || !isfinite(v->high))
        return;
    buffer_puts(out, " (");
    words_number(out, v->low / unit);
    buffer_puts(out, " to ");
    words_number(out, v->high / unit);
    buffer_puts(out, ")");
}

/* ---- sentences ----------------------------------------------------------------------------- */

static int is_reliable(const struct study *s)
{
    const struct study_point *last = study_last_point(s);

    return !last || last->reliable;
}

static void say_unfitted(struct buffer *out, const struct study *s)
{
    const struct study_point *last = study_last_point(s);

    if (!last || !isfinite(last->codes.value) || !(last->core_s > 0)) {
        buffer_puts(out, "Nothing has been measured yet.");
        return;
    }
    words_codes(out, last->codes.value);
    buffer_puts(out, " after ");
    words_core_time(out, last->core_s);
    buffer_puts(out, ". What a smaller error costs needs more points.");
}

void study_say_headline(struct buffer *out, const struct study *s)
{
    const struct study_interval cost = study_headline_cost(s), usual = study_target_cost(s);

    if (!study_has_fit(s) || !(s->target_codes > 0) || !isfinite(cost.value)) {
        say_unfitted(out, s);
        return;
    }
    words_exact(out, s->target_codes);
    buffer_printf(out, "/255 costs %s", is_reliable(s) ? "" : "at least ");
    words_core_time(out, cost.value);
    if (study_by_target(s)) {
        buffer_puts(out, " with adaptive sampling, as --target-error renders (");
        words_core_time(out, usual.value);
        buffer_puts(out, " with the same samples everywhere)");
    }
    buffer_puts(out, "; every halving of the error costs ");
    words_number(out, pow(2, 1 / s->fit.exponent.value));
    buffer_puts(out, " times as much.");
}

void study_say_wall(struct buffer *out, const struct study *s)
{
    const struct study_interval cost = study_headline_cost(s);

    if (!isfinite(cost.value))
        return;
    buffer_puts(out, "That is ");
    words_time(out, cost.value / study_rate(s));
    if (isfinite(cost.low) && isfinite(cost.high)) {
        struct buffer low = BUFFER_INIT, high = BUFFER_INIT;
        const char *low_unit, *high_unit;

        words_time(&low, cost.low / study_rate(s));
        words_time(&high, cost.high / study_rate(s));
        low_unit = strchr(buffer_text(&low), ' ');
        high_unit = strchr(buffer_text(&high), ' ');
        /* "(7 to 12 min)", but "(50 s to 2 min)" */
        if (low_unit && high_unit && strcmp(low_unit, high_unit) == 0)
            buffer_printf(out, " (%.*s to %s)", (int)(low_unit - buffer_text(&low)), buffer_text(&low),
                          buffer_text(&high));
        else
            buffer_printf(out, " (%s to %s)", buffer_text(&low), buffer_text(&high));
        out->failed |= low.failed | high.failed;
        buffer_release(&high);
        buffer_release(&low);
    }
    buffer_puts(out, " on ");
    if (s->workers.count > 1)
        buffer_printf(out, "these %zu workers", s->workers.count);
    else
        buffer_puts(out, "this machine");
    if (s->cores >= 1) {
        buffer_puts(out, " (");
        words_exact(out, s->cores);
        buffer_printf(out, " core%s)", s->cores >= 2 ? "s" : "");
    }
    if (s->price_core_hour >= 0) {
        buffer_puts(out, " and costs ");
        words_price(out, cost.value / 3600 * s->price_core_hour, s->currency);
    }
    buffer_puts(out, ".");
}

void study_say_meaning(struct buffer *out, const struct study *s)
{
    const double codes = s->target_codes > 0 ? s->target_codes : 3;

    words_exact(out, codes);
    buffer_puts(out, "/255 means: 95 of 100 pixels show the right colour to within ");
    words_exact(out, codes);
    buffer_puts(out, " of the 255 steps of a screen's brightness."
                     " One or two steps are just visible; more shows as grain.");
}

const char *study_point_word(const struct study_point *point)
{
    return accuracy_word(&(struct accuracy_figures){.reliable = point->reliable});
}

int study_say_trust(struct buffer *out, const struct study *s)
{
    const struct study_point *last = study_last_point(s);

    if (!last) {
        buffer_puts(out, "No figures yet.");
        return 0;
    }
    if (!last->reliable) {
        buffer_puts(out, "The error may be understated");
        if (last->reason)
            buffer_printf(out, ": %s", last->reason);
        buffer_puts(out, ".");
        return 0;
    }
    buffer_puts(out, "The error is reliable: the samples agree on it");
    if (last->top_share > TOP_MUCH) {
        buffer_puts(out, "; but ");
        words_percent(out, last->top_share);
        buffer_puts(out, " of the squared error is in 0.1 % of the pixels, of which an error of 95 % says nothing");
    } else if (isfinite(last->top_share)) {
        buffer_puts(out, ", and it is spread over many pixels (the worst 0.1 % of them hold ");
        words_percent(out, last->top_share);
        buffer_puts(out, " of it)");
    }
    buffer_puts(out, ".");
    return 1;
}

void study_say_small(struct buffer *out, const struct study *s)
{
    if (!(study_tiles(s) >= 1) || !study_is_small(s))
        return;
    buffer_puts(out, "A picture of ");
    words_exact(out, s->width);
    buffer_puts(out, "x");
    words_exact(out, s->height);
    buffer_printf(out, " pixels has %.0f tile%s of 16x16. ", study_tiles(s), study_tiles(s) > 1 ? "s" : "");
    buffer_puts(out, "Below some 100 it cannot show what adaptive sampling gains on a larger one, which has more tiles to "
                     "choose from, and what starts and ends a picture is much of its time.");
}

/* Whether the usual way's error is reliable with as many samples as the choice has. */
static int usual_is_reliable(const struct study *s, const struct study_point *mine)
{
    for (size_t i = 0; i < s->points.count; i++)
        if (s->points.items[i].samples >= mine->samples)
            return s->points.items[i].reliable;
    return is_reliable(s);
}

/* If one of the two errors may be understated, the factor between their times is a bound. */
static const char *gain_bound(const struct study *s, const struct study_choice *c)
{
    const struct study_point *mine = c->points.count ? &c->points.items[c->points.count - 1] : NULL;
    const int usual = !mine || usual_is_reliable(s, mine);

    if (c->missed)
        return c->gain.value < 1 ? "at least " : "at most ";
    if (!mine || usual == mine->reliable)
        return "";
    return (c->gain.value < 1) == usual ? "at least " : "at most ";
}

static void say_gain(struct buffer *out, const struct study *s, const struct study_choice *c)
{
    const struct study_interval sure = study_sure_gain(c);
    struct study_interval shown = c->gain;

    if (!study_time_differs(c)) {
        buffer_puts(out, "no clear difference in time");
        if (isfinite(sure.low) && isfinite(sure.high)) {
            buffer_puts(out, " (");
            words_number(out, 1 / sure.high);
            buffer_puts(out, " to ");
            words_number(out, 1 / sure.low);
            buffer_puts(out, " times)");
        }
        return;
    }
    if (c->gain.value < 1)
        shown = (struct study_interval){1 / c->gain.value, 1 / c->gain.high, 1 / c->gain.low};
    buffer_puts(out, gain_bound(s, c));
    words_number(out, shown.value);
    buffer_puts(out, c->gain.value < 1 ? " times the time" : " times less time");
    if (c->gain_at > 0) {
        buffer_puts(out, " to ");
        words_exact(out, c->gain_at);
        buffer_puts(out, "/255");
    }
    words_range(out, &shown, 1);
}

static int is_open(const struct study *s, const struct study_choice *c)
{
    return !study_bias_counts(s, c) && c->floor.high > fmax(s->target_codes / 4, c->floor.value);
}

/* Is it the same picture but for a few pixels, which held much of its light? */
static int loses_light(const struct study *s, const struct study_choice *c)
{
    return c->taken > TAKEN_MUCH && isfinite(c->floor.value) && !c->unbiased && !study_bias_counts(s, c) && !is_open(s, c);
}

static void say_floor(struct buffer *out, const struct study *s, const struct study_choice *c)
{
    if (c->unbiased) {
        buffer_puts(out, "the same picture but for its noise");
        return;
    }
    if (is_open(s, c)) {
        buffer_puts(out, "so few samples do not exclude a difference of up to ");
        words_codes(out, c->floor.high);
        return;
    }
    if (!study_bias_counts(s, c)) {
        buffer_puts(out, loses_light(s, c) ? "95 of 100 pixels are the same to " : "the same picture to ");
        words_exact(out, fmax(0.01, round(100 * fmax(c->floor.value, isfinite(c->floor.high) ? c->floor.high : 0)) / 100));
        buffer_puts(out, "/255");
        if (loses_light(s, c)) {
            buffer_puts(out, " and the others lose ");
            words_percent(out, c->taken);
            buffer_puts(out, " of the picture's light");
        }
        return;
    }
    buffer_puts(out, "never better than ");
    words_codes(out, c->floor.value);
    words_range(out, &c->floor, 1);
}

void study_say_choice(struct buffer *out, const struct study *s, const struct study_choice *c)
{
    const char *before = ": ";

    buffer_puts(out, c->words ? c->words : c->name ? c->name : "(unnamed)");
    if (isfinite(c->gain.value) && c->gain.value > 0) {
        buffer_puts(out, before);
        say_gain(out, s, c);
        before = ", ";
    }
    if (isfinite(c->floor.value)) {
        buffer_puts(out, before);
        say_floor(out, s, c);
        before = ", ";
    }
    if (*before == ':')
        buffer_puts(out, ": not measured yet");
    if (c->taken > 0 && !loses_light(s, c)) {
        buffer_puts(out, "; takes away ");
        words_percent(out, c->taken);
        buffer_puts(out, " of the light");
    }
    if (c->note)
        buffer_printf(out, "; %s", c->note);
    buffer_puts(out, ".");
}
