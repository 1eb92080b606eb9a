#include "common/accuracy/allocate.h"

#include <assert.h>
#include <string.h>

#include "common/accuracy/quantile.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "common/math/elementary.h"

/* Fixed point of logarithms to base 2: steps of 1 % in samples. */
#define LOG_ONE 64
#define LN_2 0.69314718055994530942
/* The share of pixels that a display error refers to, and where it is searched (log2 of codes). */
#define QUANTILE 0.95
#define MIXED 0.5 /* see mixed_square */
#define LOG_CODES_BIN (-5.0) /* where bin 0 would begin if it were as wide as the others */
#define LOG_CODES_MIN (-24.0)
#define LOG_CODES_MAX 10.0
/* The strength of a tile without any error: below everything reachable. */
#define STRENGTH_NONE (-(1 << 24))

const struct allocation_rules allocation_rules = {
    .first_level = 2,
    .ratio_max = 8,
    .share_percent = 150,
    .limit = 1.4,
    .smoothing = 0.5,
    .exponent_min = 0.5,
    .exponent_max = 1,
    .caution = 0.3,
    .margin = 0.02,
};

/* ---- errors in bins ----------------------------------------------------------------------------- */

static double log2_of(double x) { return det_log_d(x) / LN_2; }

static double exp2_of(double x) { return det_exp_d(x * LN_2); }

/* log2(x) / 2 in fixed point. */
static int32_t log2_root(double x) { return (int32_t)floor(log2_of(x) * (LOG_ONE / 2) + 0.5); }

/* How much of bin `bin` lies below a place on the scale of bins. Within a bin errors are spread
 * evenly on the logarithmic scale; within bin 0, which begins at 0, linearly. */
static double part_below(uint32_t bin, double place)
{
    double part = bin > 0 ? place - bin : place >= 1 ? 1 : exp2_of((place - 1) / 2);

    return part < 0 ? 0 : part > 1 ? 1 : part;
}

/* The place of an error in codes on the scale of bins: bin i is i .. i + 1. */
static double place_of(double log2_codes) { return 2 * (log2_codes - LOG_CODES_BIN); }

/* The error in codes that QUANTILE of the pixels stay below, when the errors of counts[i][] are
 * multiplied by sqrt(factor[i]). */
static double quantile(uint64_t (*counts)[LEVEL_BINS], const double *factor, uint32_t rows)
{
    double all = 0, low = LOG_CODES_MIN, high = LOG_CODES_MAX;

    for (uint32_t i = 0; i < rows; i++)
        for (uint32_t b = 0; b < LEVEL_BINS; b++)
            all += (double)counts[i][b];
    for (int step = 0; step < 48; step++) {
        double middle = (low + high) / 2, below = 0;
        for (uint32_t i = 0; i < rows; i++) {
            double place = place_of(middle - 0.5 * log2_of(factor[i]));
            for (uint32_t b = 0; b < LEVEL_BINS; b++)
                if (counts[i][b] > 0)
                    below += (double)counts[i][b] * part_below(b, place);
        }
        if (below >= QUANTILE * all)
            high = middle;
        else
            low = middle;
    }
    return low == LOG_CODES_MIN ? 0 : exp2_of(high);
}

/* ---- a tile's strength ------------------------------------------------------------------------ */

static const struct allocation_rules *rules_of(const struct allocation_input *in)
{
    return in->rules ? in->rules : &allocation_rules;
}

static uint32_t pixels_of(const struct allocation_input *in, uint32_t tile)
{
    struct tile_rect r = tile_rect_of(in->width, in->height, tile);

    return r.width * r.height;
}

/* The display error of one group's picture. */
static double quantile_of(const struct allocation_input *in, const struct film_level *tiles)
{
    uint64_t counts[1][LEVEL_BINS] = {{0}};
    uint32_t count = tile_count(in->width, in->height);
    double unmoved = 1;

    for (uint32_t t = 0; t < count; t++)
        for (uint32_t b = 0; b < LEVEL_BINS; b++)
            counts[0][b] += tiles[t].bins[b];
    return quantile(counts, &unmoved, 1);
}

/* The largest squared error that a pixel of each bin adds to its tile's. */
static void limited_squares(const struct allocation_input *in, double *square)
{
    double most = rules_of(in)->limit * quantile_of(in, in->tiles);

    for (uint32_t b = 0; b < LEVEL_BINS; b++) {
        double codes = exp2_of(((double)b + 0.5) / 2 + LOG_CODES_BIN);
        square[b] = codes < most ? codes * codes : most * most;
    }
}

static double limited_error(const struct film_level *tile, const double *square)
{
    double sum = 0;

    for (uint32_t b = 0; b < LEVEL_BINS; b++)
        sum += tile->bins[b] * square[b];
    return sum < (double)tile->display ? sum : (double)tile->display;
}

/* Squared display error of a pixel of the tile: its own, or a share of its neighbourhood's if that
 * is larger. Where few samples have found light yet, the neighbours may have found it. */
static double smoothed_error(const struct allocation_input *in, const double *square, uint32_t tile)
{
    uint32_t across = tiles_across(in->width), down = tiles_across(in->height);
    uint32_t x0 = tile % across, y0 = tile / across;
    double own = limited_error(&in->tiles[tile], square) / pixels_of(in, tile);
    double sum = 0, pixels = 0;

    for (uint32_t y = y0 > 0 ? y0 - 1 : 0; y <= y0 + 1 && y < down; y++)
        for (uint32_t x = x0 > 0 ? x0 - 1 : 0; x <= x0 + 1 && x < across; x++) {
            sum += limited_error(&in->tiles[y * across + x], square);
            pixels += pixels_of(in, y * across + x);
        }
    sum = rules_of(in)->smoothing * (sum / pixels);
    return sum > own ? sum : own;
}

/* log2 of sqrt(squared error / cost), to which the tile's number of samples is proportional. */
static int32_t strength_of(const struct allocation_input *in, const double *square, uint32_t tile)
{
    double error = smoothed_error(in, square, tile);
    double rays = (double)in->tiles[tile].rays / pixels_of(in, tile);

    if (!(error > 0))
        return STRENGTH_NONE;
    return log2_root(error / (rays > 1 ? rays : 1));
}

/* ---- wanted passes ---------------------------------------------------------------------------- */

static uint32_t passes_max(const struct allocation_round *round)
{
    uint32_t level = round->in->level, ratio = rules_of(round->in)->ratio_max;
    uint32_t passes = level_passes(level);

    while (passes < PASSES_MAX && pass_samples(passes + 1) <= (uint64_t)ratio * (2u << level))
        passes++;
    return passes;
}

/* Passes of a tile from this round alone, ignoring what was wanted before. */
static uint32_t passes_at(const struct allocation_round *round, uint32_t tile, uint32_t lambda, uint32_t most)
{
    int32_t log_samples = round->strength[tile] + round->offset + (int32_t)lambda;
    uint32_t passes = level_passes(round->in->level);

    while (passes < most && log_samples >= round->steps[passes])
        passes++;
    return passes;
}

static uint32_t wanted_at(const struct allocation_round *round, uint32_t tile, uint32_t lambda, uint32_t most)
{
    uint32_t passes = passes_at(round, tile, lambda, most);

    return passes > round->in->wanted[tile] ? passes : round->in->wanted[tile];
}

void allocation_wanted(const struct allocation_round *round, uint32_t lambda, uint32_t *wanted)
{
    uint32_t most = passes_max(round);

    assert(lambda <= round->full);
    for (uint32_t t = 0; t < round->tiles; t++) {
        uint32_t passes = wanted_at(round, t, lambda, most);
        if (passes > wanted[t])
            wanted[t] = passes;
    }
}

/* Do the samples beyond the floor cost at most their share? In rays times samples, exactly. */
static int extras_fit(const struct allocation_round *round, uint32_t lambda)
{
    const struct allocation_input *in = round->in;
    uint32_t most = passes_max(round), floor_samples = 2u << in->level;
    unsigned __int128 extras = 0, budget = 0;

    for (uint32_t t = 0; t < round->tiles; t++) {
        uint32_t samples = pass_samples(passes_at(round, t, lambda, most));
        uint64_t rays = in->tiles[t].rays > 0 ? in->tiles[t].rays : 1;
        extras += (unsigned __int128)rays * (samples - floor_samples);
        budget += (unsigned __int128)rays * floor_samples;
    }
    return extras * 100 <= budget * rules_of(in)->share_percent;
}

/* The largest lambda whose extras fit the round's budget. */
static uint32_t full_lambda(const struct allocation_round *round, uint32_t range)
{
    uint32_t fits = 0, beyond = range + 1;

    while (beyond - fits > 1) {
        uint32_t middle = fits + (beyond - fits) / 2;
        if (extras_fit(round, middle))
            fits = middle;
        else
            beyond = middle;
    }
    return fits;
}

static void find_strengths(struct allocation_round *round, int32_t *weakest, int32_t *strongest)
{
    double square[LEVEL_BINS];

    *weakest = INT32_MAX;
    *strongest = STRENGTH_NONE;
    limited_squares(round->in, square);
    for (uint32_t t = 0; t < round->tiles; t++) {
        int32_t s = round->strength[t] = strength_of(round->in, square, t);
        if (s > *strongest)
            *strongest = s;
        if (s != STRENGTH_NONE && s < *weakest)
            *weakest = s;
    }
}

status allocation_round(struct allocation_round *out, const struct allocation_input *in, struct error *err)
{
    int32_t weakest, strongest;
    uint32_t first = level_passes(in->level), most;

    memset(out, 0, sizeof *out);
    out->in = in;
    out->tiles = tile_count(in->width, in->height);
    out->strength = mem_alloc_array(out->tiles, sizeof *out->strength);
    if (!out->strength)
        return error_set(err, STATUS_ERR_NO_MEMORY, "out of memory for the sample counts of %u tiles", out->tiles);
    for (uint32_t p = 1; p < PASSES_MAX; p++) /* the geometric mean of two boundaries */
        out->steps[p] = log2_root((double)pass_samples(p) * pass_samples(p + 1));
    find_strengths(out, &weakest, &strongest);
    most = passes_max(out);
    if (strongest == STRENGTH_NONE || most == first)
        return STATUS_OK;
    out->offset = out->steps[first] - strongest - 1; /* at lambda 0 no tile goes beyond the floor */
    if (in->level < rules_of(in)->first_level)
        return STATUS_OK;
    out->full = full_lambda(out, (uint32_t)(out->steps[most - 1] - weakest - out->offset));
    return STATUS_OK;
}

void allocation_round_release(struct allocation_round *round)
{
    mem_free(round->strength);
    memset(round, 0, sizeof *round);
}

/* ---- prediction ------------------------------------------------------------------------------- */

/* Pixels by the standard deviation of their error, from a group's levels: those of counts[i][] are
 * multiplied by sqrt(factor[i]). */
static void add_spreads(struct spreads *out, uint64_t (*counts)[LEVEL_SPREADS], const double *factor, uint32_t rows)
{
    for (uint32_t i = 0; i < rows; i++)
        for (uint32_t b = 0; b < LEVEL_SPREADS; b++)
            if (counts[i][b] > 0)
                spreads_add(out, level_spread(b) * (float)sqrt(factor[i]), counts[i][b]);
}

/* In LEVEL_SPREAD_ONE of a pixel: what sees the subject of the tile, at `level`. */
static uint64_t tile_subject(const struct allocation_input *in, const struct film_level *tiles, uint32_t level,
                             uint32_t tile)
{
    double samples = pixels_of(in, tile) * level_samples(level);

    return (uint64_t)((double)tiles[tile].subject / samples * pixels_of(in, tile) * LEVEL_SPREAD_ONE + 0.5);
}

static uint64_t frame_subject(const struct allocation_input *in, const struct film_level *tiles, uint32_t level)
{
    uint64_t sum = 0;

    for (uint32_t t = 0; t < tile_count(in->width, in->height); t++)
        sum += tile_subject(in, tiles, level, t);
    return sum;
}

/* Add the tile's pixels that see the subject, the noisiest first, as a picture's figures do. `all`: the frame is nothing
 * but background. */
static void add_seen(uint64_t counts[LEVEL_SPREADS], const struct allocation_input *in, const struct film_level *tiles,
                     uint32_t level, uint32_t tile, int all)
{
    uint64_t left = all ? UINT64_MAX : tile_subject(in, tiles, level, tile);

    for (uint32_t b = LEVEL_SPREADS; b > 0 && left > 0; b--) {
        uint64_t more = tiles[tile].spreads[b - 1];
        more = more < left ? more : left;
        counts[b - 1] += more;
        left -= more;
    }
}

/* The display error as in a picture's figures. The tiles list only pixels that have one; `subject` counts all that see
 * it, 0: none does, so all count. */
static double display_error(struct spreads *spreads, const struct allocation_input *in, uint64_t subject)
{
    uint64_t pixels = subject ? subject : (uint64_t)in->width * in->height * LEVEL_SPREAD_ONE;

    spreads->count = spreads->count > pixels ? spreads->count : pixels;
    return spreads_quantile(spreads, DISPLAY_BEYOND);
}

/* The squared error of a level by a measure, up to a factor. */
static double level_square(const struct allocation_input *in, const struct film_level *tiles, uint32_t level,
                           enum allocation_measure measure, struct spreads *spreads)
{
    double sum = 0, unmoved = 1;

    if (measure == ALLOCATION_DISPLAY) {
        uint64_t counts[1][LEVEL_SPREADS] = {{0}}, subject = frame_subject(in, tiles, level);
        for (uint32_t t = 0; t < tile_count(in->width, in->height); t++)
            add_seen(counts[0], in, tiles, level, t, subject == 0);
        memset(spreads, 0, sizeof *spreads);
        add_spreads(spreads, counts, &unmoved, 1);
        sum = display_error(spreads, in, subject);
        return sum * sum;
    }
    for (uint32_t t = 0; t < tile_count(in->width, in->height); t++)
        sum += measure == ALLOCATION_RMSE ? tiles[t].linear : (double)tiles[t].channels;
    return sum;
}

/* The squared error falls as 1 / n^exponent: faster than 1 / n for soft light, slower for rare
 * light. The last doubling gives the exponent: `now` and `before` are the squares of its levels. */
static double exponent_of(const struct allocation_input *in, double now, double before)
{
    const struct allocation_rules *rules = rules_of(in);
    double exponent = 1;

    if (in->previous && now > 0)
        exponent = before > 0 ? log2_of(before / now) : rules->exponent_min;
    return exponent < rules->exponent_min   ? rules->exponent_min
           : exponent > rules->exponent_max ? rules->exponent_max
                                            : exponent;
}

static double cautious_exponent(const struct allocation_input *in, double exponent)
{
    const struct allocation_rules *rules = rules_of(in);

    exponent -= rules->caution;
    return exponent < rules->exponent_min ? rules->exponent_min : exponent;
}

/* Squared error of the combined picture over what one group says at the level, for each number of
 * passes of both. That is corrected for the correlation of halves (common/film/levels.h) in linear
 * radiance only: in codes it is too small as often as too large. In linear radiance two groups halve it. In codes that would be too little: where
 * a sample is rare and bright, the light that it adds hides some of its own error. There two groups
 * count as what they are, twice the samples. */
static void shrinkage(const struct allocation_round *round, enum allocation_measure measure, double *factor,
                      struct spreads *spreads)
{
    const struct allocation_input *in = round->in;
    double floor_samples = (double)(2u << in->level);
    double now = level_square(in, in->tiles, in->level, measure, spreads);
    double before = in->previous ? level_square(in, in->previous, in->level - 1, measure, spreads) : 0;
    double exponent = exponent_of(in, now, before);
    double joined = measure == ALLOCATION_RMSE ? 0.5 : det_pow_d(0.5, exponent);
    double own = measure == ALLOCATION_RMSE ? level_correction(now, before) : 1;
    double further = cautious_exponent(in, exponent);

    factor[0] = 1;
    for (uint32_t p = 1; p <= PASSES_MAX; p++)
        factor[p] = own * joined * det_pow_d(floor_samples / pass_samples(p), further);
}

/* Each tile's spreads moved by its factor. */
static double predict_display(const struct allocation_round *round, uint32_t lambda, const double *factor,
                              struct spreads *spreads)
{
    const struct allocation_input *in = round->in;
    uint64_t counts[PASSES_MAX + 1][LEVEL_SPREADS] = {{0}}, subject = frame_subject(in, in->tiles, in->level);
    uint32_t most = passes_max(round);

    for (uint32_t t = 0; t < round->tiles; t++)
        add_seen(counts[wanted_at(round, t, lambda, most)], in, in->tiles, in->level, t, subject == 0);
    memset(spreads, 0, sizeof *spreads);
    add_spreads(spreads, counts, factor, PASSES_MAX + 1);
    return display_error(spreads, in, subject);
}

/* The squared errors of the tiles, in part replaced by the mean of their 3x3 tiles. A tile whose
 * error was overestimated by chance has got more samples for it, one whose error was underestimated
 * fewer; without the mean, the predicted sum would be too small. */
static double mixed_square(const struct allocation_input *in, uint32_t tile, int linear)
{
    uint32_t across = tiles_across(in->width), down = tiles_across(in->height);
    uint32_t x0 = tile % across, y0 = tile / across;
    double own = 0, sum = 0, pixels = 0;

    for (uint32_t y = y0 > 0 ? y0 - 1 : 0; y <= y0 + 1 && y < down; y++)
        for (uint32_t x = x0 > 0 ? x0 - 1 : 0; x <= x0 + 1 && x < across; x++) {
            const struct film_level *t = &in->tiles[y * across + x];
            double square = linear ? t->linear : (double)t->channels;
            if (x == x0 && y == y0)
                own = square;
            sum += square;
            pixels += pixels_of(in, y * across + x);
        }
    return (1 - MIXED) * own + MIXED * sum / pixels * pixels_of(in, tile);
}

static double predict_square(const struct allocation_round *round, uint32_t lambda, const double *factor, int linear)
{
    uint32_t most = passes_max(round);
    double sum = 0;

    for (uint32_t t = 0; t < round->tiles; t++)
        sum += factor[wanted_at(round, t, lambda, most)] * mixed_square(round->in, t, linear);
    return sum;
}

double allocation_predict(const struct allocation_round *round, enum allocation_measure measure, uint32_t lambda)
{
    double pixels = (double)round->in->width * round->in->height;
    double factor[PASSES_MAX + 1], radiance = 0, square;
    struct spreads spreads;

    shrinkage(round, measure, factor, &spreads);
    switch (measure) {
    case ALLOCATION_DISPLAY: return predict_display(round, lambda, factor, &spreads);
    case ALLOCATION_PSNR:
        square = predict_square(round, lambda, factor, 0) / (3 * pixels);
        return square > 0 ? 4.34294481903251827651 * det_log_d(255.0 * 255.0 / square) : INFINITY;
    case ALLOCATION_RMSE: break;
    }
    for (uint32_t t = 0; t < round->tiles; t++)
        radiance += round->in->tiles[t].radiance;
    square = predict_square(round, lambda, factor, 1) / (3 * pixels);
    if (!(square > 0))
        return 0;
    return radiance > 0 ? 100 * sqrt(square) / (radiance / (3 * pixels)) : INFINITY;
}

static int meets(const struct allocation_round *round, const struct allocation_target *target, uint32_t lambda)
{
    double error = allocation_predict(round, target->measure, lambda);
    double room = 1 - rules_of(round->in)->margin;

    if (target->measure == ALLOCATION_PSNR)
        return error >= target->value - 8.68588963806503655302 * det_log_d(room);
    return error <= target->value * room;
}

int allocation_target(const struct allocation_round *round, const struct allocation_target *target, uint32_t *lambda)
{
    uint32_t low = 0, high = round->full;

    *lambda = round->full;
    if (round->in->level == 0 || !meets(round, target, round->full))
        return 0;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (meets(round, target, middle))
            high = middle;
        else
            low = middle + 1;
    }
    *lambda = low;
    return 1;
}
