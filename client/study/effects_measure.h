/* effects_measure: what each effect of a scene costs, and the bias of leaving it out.
 *
 * In each of four rounds the frame is rendered with all effects and once without each, with the round's own seed:
 * pictures of one round share their random numbers and most of their noise, those of two rounds share none. The even
 * rounds are one side of the pairs of study/pair.h, the odd ones the other. Pilots of several lengths stand side by
 * side; only pilots of equal length are compared.
 */
#pragma once

#include "client/study/pair.h"
#include "client/farm/trial.h"
#include "common/scene/effects.h"

enum {
    EFFECTS_ROUNDS = 4,
    EFFECTS_PILOT_ROWS = 160,
    EFFECTS_PILOT_SPP = 32,
    EFFECTS_LENGTHS_MAX = 4, /* of pilots, each with a whole picture of its own */
    EFFECTS_TRIALS_MAX = EFFECT_COUNT + EFFECTS_LENGTHS_MAX + 1, /* each effect, wholes, several together */
};

struct effects_trial {
    uint64_t without; /* left out, beside what the request leaves out; 0: the whole */
    uint32_t spp;     /* samples of a pixel in each round */
    double core_s[EFFECTS_ROUNDS];
    struct image side[2]; /* means of the even and of the odd rounds */
    unsigned rounds;
    double saved[EFFECTS_ROUNDS * (EFFECTS_LENGTHS_MAX - 1)]; /* shares of the time, by the rounds of shorter pilots */
    unsigned saved_count;
};

struct effects_price {
    struct study_interval saved; /* share of a sample's time; t over the rounds of all lengths */
    double noise;                /* the error in codes at equal samples, over the whole picture's */
    struct pair_bias bias;
};

/* Zero-initialise. */
struct effects_measure {
    struct connection *connection;
    const struct import_result *scene;
    const struct job_request *request; /* small already: effects_measure_shrink */
    int quiet;
    struct effects_trial trials[EFFECTS_TRIALS_MAX];
    size_t count;
    double core_s;      /* of all trials */
    struct shown shown; /* by the longest whole */
};

/* A pilot's size and samples, where the user gave none. */
void effects_measure_shrink(struct render_settings *s, int size_given, int spp_given);

/* The whole and each effect of `set` that can be switched off, round by round. After an interruption the error is
 * returned; complete pairs of rounds are kept (effects_measure_rounds). */
status effects_measure_run(struct effects_measure *m, uint64_t set, struct error *err) MUST_CHECK;
/* Measure these effects again, each alone, in pilots of this many samples; their former trials are removed. */
status effects_measure_again(struct effects_measure *m, uint64_t bits, uint32_t spp, struct error *err) MUST_CHECK;
/* Without all of `without` at once, in pilots of a length that a whole picture has: the trial's
 * number. The trial of a former set of several effects is removed. */
status effects_measure_together(struct effects_measure *m, uint64_t without, uint32_t spp, size_t *trial,
                                struct error *err) MUST_CHECK;
/* Rounds that every trial has: 0, 2 or 4. */
unsigned effects_measure_rounds(const struct effects_measure *m);
/* The trial of an effect; 0: there is none. */
size_t effects_measure_find(const struct effects_measure *m, int bit);
status effects_measure_price(const struct effects_measure *m, size_t trial, struct effects_price *out,
                             struct error *err) MUST_CHECK;
/* Share of the time to a given error that leaving out saves: a sample's time, times the extra
 * samples that the noise needs. */
struct study_interval effects_price_gain(const struct effects_price *price);
/* Samples of a pixel that the whole picture takes to this error in codes, by the longest pilots. */
double effects_measure_samples_to(const struct effects_measure *m, double codes);
/* Core-seconds of one sample of a whole pilot's pixel. */
double effects_measure_sample_s(const struct effects_measure *m);
void effects_measure_release(struct effects_measure *m);
