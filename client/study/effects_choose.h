/* effects_choose: decides which effects to leave out, from pilots. Renders nothing itself.
 *
 * The rule: an effect is left out if the upper end of its bias's 95 % interval is below `most` and it certainly saves a
 * hundredth or more of the time to the target; several together if that holds for them measured together. Biases add in
 * one scene and cancel in another, so nothing is concluded from their sum.
 *
 * Pilots grow, 8, 32, 128, 512 samples, for effects that are not decided yet. The first length only excludes effects
 * that certainly change too much. All of them together stay below a stated share of the expected render; those from
 * CHOOSE_SURE on must also be expected to save more than they take.
 */
#pragma once

#include "client/study/effects_measure.h"

enum {
    CHOOSE_LENGTHS = EFFECTS_LENGTHS_MAX,
    CHOOSE_SURE = 2, /* from this length on what an effect saves is known well enough */
};
#define CHOOSE_LEAST_SAVED 0.01  /* of the time to the target */
#define CHOOSE_BUDGET_SHARE 0.1  /* of the expected render: all pilots together */

/* The source of prices: pilots, or a test. */
struct effects_pilots {
    void *user;
    /* Measure these effects, each alone, with pilots of lengths[length] samples. */
    status (*alone)(void *user, uint64_t bits, int length, struct error *err);
    /* The last measurement of one effect. */
    status (*price)(void *user, int bit, struct effects_price *out, struct error *err);
    status (*together)(void *user, uint64_t set, int length, struct effects_price *out, struct error *err);
    /* Core-seconds that `alone` takes for this many effects, the whole picture among them. */
    double (*cost_s)(void *user, unsigned effects, int length);
    /* Core-seconds of the render, as far as is known. */
    double (*render_s)(void *user);
};

extern const uint32_t choose_lengths[CHOOSE_LENGTHS]; /* samples of a pixel in a round */

struct effects_candidate {
    int bit, length;
    struct effects_price price;
};

struct effects_choice {
    struct effects_candidate all[EFFECT_COUNT]; /* what is left out, bargains first */
    size_t count;
    uint64_t set;                                /* the same, as bits */
    struct effects_price together;               /* of the set */
    struct effects_candidate open[EFFECT_COUNT]; /* kept because longer pilots would not pay */
    size_t open_count;
    uint64_t unmeasured; /* kept because not even the shortest pilots would be within the share of the render */
};

/* `set`: effects that may go; `most`: codes that their bias may reach. */
status effects_choose(struct effects_choice *out, const struct effects_pilots *pilots, uint64_t set, double most,
                      struct error *err) MUST_CHECK;
