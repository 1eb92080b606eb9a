/* allocate: how many samples each tile of a frame gets, and when there are enough.
 *
 * A picture is made of two groups of samples. What one group gets is decided by the *other* group's samples, and only
 * by those of its uniform floor, whose number depends on nothing. So a group's counts are independent of its own
 * samples, and the combined picture, mean(g0)/2 + mean(g1)/2, is unbiased (docs/ALLOCATION.md has the proof and the
 * measured gains).
 *
 * How a frame uses it, once for each group g, with h the other group:
 *
 *   for level k = 0, 1, 2, ...:
 *       wanted[t] = max(wanted[t], level_passes(k))    for every tile t: the round's floor
 *       wait for the floor of group h
 *       in.tiles, in.previous = h's statistics of levels k and k - 1; in.wanted = wanted
 *       allocation_round(&round, &in)
 *       if there is a target and allocation_target(&round, &target, &lambda) says yes:
 *           allocation_wanted(&round, lambda, wanted); group g has ended
 *       else:
 *           allocation_wanted(&round, round.full, wanted)
 *
 * When g has ended and h has not, h still needs g's statistics of the next levels. Then g's floor is still rendered,
 * but *for the statistics only*: its samples beyond `wanted` must not enter the picture, because g's own samples made h
 * continue. Frames of many tiles usually end in the same round; small ones often do not.
 *
 * Nothing here depends on a cap of the samples; the caller cuts `wanted` at the cap's passes and ends there. Wanted
 * numbers grow with lambda and with the rounds, and rounds depend neither on cap nor on target, so a stopped frame can
 * continue to the same bits.
 *
 * Pure functions: the same integers on every machine (common/math/elementary, fixed order).
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/film/levels.h"
#include "common/film/tiles.h"

/* How the samples beyond the floor are distributed. `allocation_rules` are the ones in use; others
 * are for experiments (`make accuracy-allocation`). */
struct allocation_rules {
    uint32_t first_level;              /* the first with samples beyond the floor */
    uint32_t ratio_max;                /* samples of a tile relative to the floor, at most */
    uint32_t share_percent;            /* cost of the samples beyond the floor, in per cent of the floor's */
    double limit;                      /* upper limit of a pixel's error, as a multiple of the error that
                              * 95 % of the pixels stay below: few pixels do not get all samples */
    double smoothing;                  /* a tile counts at least this share of its 3x3 tiles' mean error */
    double exponent_min, exponent_max; /* of 1/n in the predicted squared error, as estimated from
                                        * the last two levels */
    double caution;                    /* subtracted from that exponent beyond the floor, where it may fall */
    double margin;                     /* the prediction must be below the target by this share */
};
extern const struct allocation_rules allocation_rules;

/* What decides a round of group g. Every number is of the other group. */
struct allocation_input {
    uint32_t width, height; /* pixels of the frame */
    uint32_t level;
    const struct film_level *tiles;    /* [tile_count(width, height)], row-major */
    const struct film_level *previous; /* [tiles], of the level before; NULL at levels 0 and 1 */
    /* Group g's wanted passes before the round's extras, at least the level's floor. */
    const uint32_t *wanted;
    const struct allocation_rules *rules; /* NULL: allocation_rules */
};

/* The outcome: wanted passes as a function of an integer lambda, 0 .. full. */
struct allocation_round {
    const struct allocation_input *in; /* must stay as it is */
    uint32_t tiles;
    uint32_t full;                 /* the lambda of the whole round; 0: no extras, only the floor */
    int32_t offset;                /* strength + offset + lambda is log2 of samples, in fixed point */
    int32_t *strength;             /* [tiles], owned */
    int32_t steps[PASSES_MAX + 1]; /* where a tile moves on to the next pass */
};

/* ERR_NO_MEMORY. `out` is then zero; release it in any case. */
status allocation_round(struct allocation_round *out, const struct allocation_input *in, struct error *err) MUST_CHECK;
void allocation_round_release(struct allocation_round *round);

/* Raise wanted[tiles] to what lambda <= round->full needs. May be in->wanted itself only if the
 * round is not used again. */
void allocation_wanted(const struct allocation_round *round, uint32_t lambda, uint32_t *wanted);

enum allocation_measure {
    ALLOCATION_DISPLAY, /* 95 % of the pixels are within this many codes of 255 */
    ALLOCATION_PSNR,    /* dB */
    ALLOCATION_RMSE,    /* per cent of the frame's mean */
};
enum { ALLOCATION_MEASURES = ALLOCATION_RMSE + 1 };
struct allocation_target {
    enum allocation_measure measure;
    double value;
};

/* The error of the combined picture if the round ends at lambda, in the measure's unit. It never
 * increases with lambda. A black or noiseless frame has error 0 (PSNR: infinity). */
double allocation_predict(const struct allocation_round *round, enum allocation_measure measure, uint32_t lambda);

/* Is the target met in this round? If so, *lambda is the smallest at which the prediction meets it
 * (margin included), otherwise round->full. Never at level 0, which has no errors. */
int allocation_target(const struct allocation_round *round, const struct allocation_target *target, uint32_t *lambda);
