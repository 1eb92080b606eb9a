/* run_ways: the other ways of rendering that a study tries, and which of them a scene calls for. */
#pragma once

#include "client/study/run.h"
#include "common/scene/effects.h"

enum knob {
    KNOB_ALLOCATION, KNOB_SAMPLER, KNOB_ENVIRONMENT, KNOB_LIGHTS, KNOB_DEPTH, KNOB_ROULETTE, KNOB_CLAMP,
    KNOB_HALF, KNOB_ROBUST, KNOB_BVH, KNOB_FILTER, KNOB_ISA, KNOB_PRECISION, KNOB_EFFECT, KNOB_COUNT
};

struct way {
    enum knob knob;
    int value;
    const char *name, *words;
};

enum { WAYS = 38, PLAN_MAX = WAYS + EFFECT_COUNT };

/* What is to be measured; the requests are copies that own nothing. */
struct plan {
    struct way ways[PLAN_MAX];
    struct job_request requests[PLAN_MAX];
    size_t count;
};

/* The question that a knob answers: "Sampler". */
const char *way_title(enum knob knob);
/* Does its picture have the usual one's expectation by construction, so that they differ only in
 * noise? Clamping does not: it removes an amount that depends on the noise. */
int way_is_unbiased(const struct way *way, const struct render_settings *usual);
/* All ways that apply to the scene and the settings, including the usual ones. */
void plan_make(struct plan *plan, const struct study_run *run);
void plan_drop(struct plan *plan, enum knob knob);
int plan_is_usual(const struct study_run *run, const struct plan *plan, size_t i);
