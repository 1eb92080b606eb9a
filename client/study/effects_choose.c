#include "client/study/effects_choose.h"

#include <math.h>
#include <string.h>

const uint32_t choose_lengths[CHOOSE_LENGTHS] = {8, 32, 128, 512};

static double upper_end(const struct effects_price *price) { return pair_bias_worse(&price->bias).high; }

static double lower_end(const struct effects_price *price)
{
    return fmax(price->bias.rms_codes.low, price->bias.codes.low);
}

enum verdict { GOES, STAYS, OPEN };

static enum verdict judge(const struct effects_candidate *c, double most)
{
    const struct study_interval gain = effects_price_gain(&c->price);

    if (!(lower_end(&c->price) < most))
        return STAYS;
    if (c->length == 0) /* too short to tell a hundredth of the time */
        return OPEN;
    if (!(gain.value >= CHOOSE_LEAST_SAVED))
        return STAYS;
    return upper_end(&c->price) < most && gain.low > 0 ? GOES : OPEN;
}

static double worth(const struct effects_candidate *c)
{
    return effects_price_gain(&c->price).value / fmax(0.02, upper_end(&c->price));
}

static void insert_by_worth(struct effects_candidate *all, size_t *count, const struct effects_candidate *c)
{
    size_t at;

    for (at = (*count)++; at > 0 && worth(c) > worth(&all[at - 1]); at--)
        all[at] = all[at - 1];
    all[at] = *c;
}

/* Sort the measured effects: those to leave out, and the open ones. */
static status take_prices(struct effects_choice *out, const struct effects_pilots *p, uint64_t bits, int length,
                          double most, struct error *err)
{
    out->open_count = 0;
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        struct effects_candidate c = {.bit = bit, .length = length};
        enum verdict verdict;
        if (!(bits >> bit & 1))
            continue;
        if (p->price(p->user, bit, &c.price, err) != STATUS_OK)
            return STATUS_ERR_NO_MEMORY;
        verdict = judge(&c, most);
        if (verdict == GOES)
            insert_by_worth(out->all, &out->count, &c);
        else if (verdict == OPEN)
            insert_by_worth(out->open, &out->open_count, &c);
    }
    return STATUS_OK;
}

/* The open effects for which pilots of that length pay, within the remaining budget. */
static uint64_t affordable(const struct effects_choice *out, const struct effects_pilots *p, int length,
                           double *spent_s)
{
    const double render_s = p->render_s(p->user);
    uint64_t bits = 0;
    unsigned effects = 0;
    double cost_s = 0;

    for (size_t i = 0; i < out->open_count; i++) {
        const double saves_s = effects_price_gain(&out->open[i].price).value * render_s;
        const double with_s = p->cost_s(p->user, effects + 1, length);
        if ((length >= CHOOSE_SURE && with_s - cost_s > saves_s) || *spent_s + with_s > CHOOSE_BUDGET_SHARE * render_s)
            continue;
        bits |= (uint64_t)1 << out->open[i].bit;
        effects++;
        cost_s = with_s;
    }
    *spent_s += cost_s;
    return bits;
}

/* Of the effects those that the shortest pilots can measure within the budget: nothing is known of any yet. */
static uint64_t affordable_first(struct effects_choice *out, const struct effects_pilots *p, uint64_t set, double *spent_s)
{
    const double budget_s = CHOOSE_BUDGET_SHARE * p->render_s(p->user);
    unsigned effects = 0;

    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set >> bit & 1) {
            if (p->cost_s(p->user, effects + 1, 0) > budget_s)
                out->unmeasured |= (uint64_t)1 << bit;
            else
                effects++;
        }
    *spent_s = effects ? p->cost_s(p->user, effects, 0) : 0;
    return set & ~out->unmeasured;
}

/* Longer and longer pilots for the open effects; effects for which they do not pay are set aside. */
static status measure_alone(struct effects_choice *out, const struct effects_pilots *p, uint64_t set, double most,
                            double *spent_s, struct error *err)
{
    struct effects_candidate put_by[EFFECT_COUNT];
    size_t put_by_count = 0;
    status result = STATUS_OK;

    set = affordable_first(out, p, set, spent_s);
    for (int length = 0; length < CHOOSE_LENGTHS && set && result == STATUS_OK; length++) {
        result = p->alone(p->user, set, length, err);
        THEN(result, take_prices(out, p, set, length, most, err));
        set = length + 1 < CHOOSE_LENGTHS ? affordable(out, p, length + 1, spent_s) : 0;
        for (size_t i = 0; i < out->open_count; i++)
            if (!(set >> out->open[i].bit & 1))
                insert_by_worth(put_by, &put_by_count, &out->open[i]);
    }
    memcpy(out->open, put_by, put_by_count * sizeof *put_by);
    out->open_count = put_by_count;
    return result;
}

/* Effects that are hidden one by one may be visible together, and may save nothing together: only
 * measuring shows that. */
static status measure_together(struct effects_choice *out, const struct effects_pilots *p, double most, double spent_s,
                               struct error *err)
{
    const double budget_s = CHOOSE_BUDGET_SHARE * p->render_s(p->user);
    status result = STATUS_OK;

    for (; out->count > 0 && result == STATUS_OK; out->count--) {
        int length = 0;
        out->set = 0;
        for (size_t i = 0; i < out->count; i++) {
            out->set |= (uint64_t)1 << out->all[i].bit;
            length = out->all[i].length > length ? out->all[i].length : length;
        }
        out->together = out->all[0].price;
        if (out->count == 1)
            return STATUS_OK;
        spent_s += p->cost_s(p->user, 0, length);
        if (spent_s > budget_s) { /* the best bargain alone needs no measuring */
            for (size_t i = 1; i < out->count; i++)
                insert_by_worth(out->open, &out->open_count, &out->all[i]);
            out->count = 2;
            continue;
        }
        result = p->together(p->user, out->set, length, &out->together, err);
        if (result == STATUS_OK && upper_end(&out->together) < most && effects_price_gain(&out->together).value > 0)
            return STATUS_OK;
    }
    out->set = 0;
    return result;
}

status effects_choose(struct effects_choice *out, const struct effects_pilots *pilots, uint64_t set, double most,
                      struct error *err)
{
    double spent_s = 0;
    status result;

    memset(out, 0, sizeof *out);
    result = measure_alone(out, pilots, set, most, &spent_s, err);
    return result == STATUS_OK ? measure_together(out, pilots, most, spent_s, err) : result;
}
