/* allocation: what giving samples to tiles saves, on recorded scenes (tests/accuracy/record.c).
 *
 *   allocation [--explore | --targets] FILE...
 *
 * For each recording, its first two seeds in turn: one seed decides, the other one judges, each with
 * a further seed that tells its errors (four in all). Printed
 * is the gain in CPU time over uniform samples to an equal error, at the end of each round: of the
 * rounds, and of the optimum, which knows from all of the deciding seed's samples what each tile
 * needs; for the RMS of the errors in codes and for the display error (95 % of the pixels). The two
 * have different optima. Balance: what unequal counts of the groups leave of the samples' worth.
 * Then how the errors that pictures report relate to the targets at which they were stopped.
 * --explore tries other rules, --targets prints these relations only. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/replay.h"

enum { LEVELS = 6, SCENES_MAX = 32 };

struct plan {
    uint32_t *passes[RECORD_GROUPS];
};

static void plan_init(struct plan *p, uint32_t tiles, uint32_t passes)
{
    for (int g = 0; g < RECORD_GROUPS; g++) {
        p->passes[g] = mem_alloc_array(tiles, sizeof *p->passes[g]);
        if (!p->passes[g])
            abort();
        for (uint32_t t = 0; t < tiles; t++)
            p->passes[g][t] = passes;
    }
}

static void plan_release(struct plan *p)
{
    for (int g = 0; g < RECORD_GROUPS; g++)
        mem_free(p->passes[g]);
}

struct judged {
    double cost, square, display;
};

static struct judged judge(const struct replay *by, const struct plan *p)
{
    struct replay_errors e = replay_errors(by, p->passes);

    return (struct judged){replay_cost(by, p->passes), e.square, e.display};
}

/* ---- uniform samples: cost as a function of the error -------------------------------------------- */

struct curve {
    uint32_t count;
    struct judged at[RECORD_PASSES_MAX];
};

static void uniform_curve(struct curve *c, const struct replay *by)
{
    c->count = by->passes;
    for (uint32_t i = 0; i < c->count; i++) {
        struct plan p;
        plan_init(&p, by->tiles, i + 1);
        c->at[i] = judge(by, &p);
        plan_release(&p);
    }
}

/* Cost at which uniform samples reach an error; beyond the ends by the nearest piece's slope. */
static double uniform_cost(const struct curve *c, double error, int display)
{
    uint32_t i = c->count - 1;
    double x0, x1, y0, y1;

    /* From the end: with few samples the display error of a dark picture may grow. */
#define ERROR_OF(j) log(display ? c->at[j].display : c->at[j].square)
    while (i > 1 && ERROR_OF(i - 1) < log(error))
        i--;
    x0 = ERROR_OF(i - 1), x1 = ERROR_OF(i);
#undef ERROR_OF
    y0 = log(c->at[i - 1].cost), y1 = log(c->at[i].cost);
    return exp(y0 + (log(error) - x0) * (y1 - y0) / (x1 - x0));
}

/* ---- the optimum --------------------------------------------------------------------------------- */

static uint32_t tile_of(const struct replay *r, size_t pixel)
{
    return (uint32_t)(pixel / r->width / TILE_SIZE * tiles_across(r->width) + pixel % r->width / TILE_SIZE);
}

static double cost_of(const struct replay *r, const struct plan *p) { return replay_cost(r, p->passes); }

/* Neyman with cost, nowhere less than `least` passes, both groups alike. */
static void neyman(const struct replay *decides, double cost, uint32_t least, struct plan *p)
{
    double *strength = mem_calloc(decides->tiles, sizeof *strength);
    double low = -40, high = 40;

    if (!strength)
        abort();
    for (size_t i = 0; i < (size_t)decides->width * decides->height; i++)
        for (int g = 0; g < RECORD_GROUPS; g++)
            for (size_t c = 3 * i; c < 3 * i + 3; c++) {
                double e = (double)decides->error[g][decides->passes][c];
                strength[tile_of(decides, i)] += e * e;
            }
    for (uint32_t t = 0; t < decides->tiles; t++)
        strength[t] = sqrt(strength[t] / decides->cpu_ns[t]);
    for (int i = 0; i < 50; i++) {
        double middle = (low + high) / 2;
        for (uint32_t t = 0; t < decides->tiles; t++) {
            uint32_t passes = least;
            while (passes < decides->passes &&
                   strength[t] * exp(middle) * 1e3 > sqrt((double)pass_samples(passes) * pass_samples(passes + 1)))
                passes++;
            p->passes[0][t] = p->passes[1][t] = passes;
        }
        if (cost_of(decides, p) > cost)
            high = middle;
        else
            low = middle;
    }
    mem_free(strength);
}

/* The least squared error for a cost: each tile has the passes that are worth most at a common
 * price, by its own measured error after each pass. */
static void least_square(const struct replay *r, double cost, struct plan *p)
{
    double(*square)[RECORD_PASSES_MAX] = mem_calloc(r->tiles, sizeof *square);
    double low = -40, high = 40;

    if (!square)
        abort();
    for (int g = 0; g < RECORD_GROUPS; g++)
        for (uint32_t n = 1; n <= r->passes; n++)
            for (size_t i = 0; i < (size_t)r->width * r->height; i++)
                for (size_t c = 3 * i; c < 3 * i + 3; c++)
                    square[tile_of(r, i)][n] += (double)r->error[g][n][c] * (double)r->error[g][n][c];
    for (int i = 0; i < 50; i++) {
        double price = exp((low + high) / 2);
        for (uint32_t t = 0; t < r->tiles; t++) {
            uint32_t best = 1;
            for (uint32_t n = 2; n <= r->passes; n++)
                if (square[t][n] + price * r->cpu_ns[t] * pass_samples(n) <
                    square[t][best] + price * r->cpu_ns[t] * pass_samples(best))
                    best = n;
            p->passes[0][t] = p->passes[1][t] = best;
        }
        if (cost_of(r, p) > cost)
            low = (low + high) / 2;
        else
            high = (low + high) / 2;
    }
    mem_free(square);
}

/* within[t][p]: pixels of the tile whose error is at most `codes` after p passes. */
static void count_within(const struct replay *r, float codes, uint16_t (*within)[RECORD_PASSES_MAX])
{
    memset(within, 0, r->tiles * sizeof *within);
    for (uint32_t p = 1; p <= r->passes; p++)
        for (size_t i = 0; i < (size_t)r->width * r->height; i++) {
            int plus = 1, minus = 1;
            for (size_t c = 3 * i; c < 3 * i + 3; c++) {
                plus &= fabsf(r->error[0][p][c] + r->error[1][p][c]) <= 2 * codes;
                minus &= fabsf(r->error[0][p][c] - r->error[1][p][c]) <= 2 * codes;
            }
            within[tile_of(r, i)][p] += (uint16_t)(plus + minus);
        }
}

/* The most pixels within `codes` for a cost: each tile has the passes that are worth most at a
 * common price. Returns the share of pixels. */
static double most_within(const struct replay *r, double cost, float codes, struct plan *p)
{
    uint16_t(*within)[RECORD_PASSES_MAX] = mem_alloc_array(r->tiles, sizeof *within);
    double low = -60, high = 20, sum = 0;

    if (!within)
        abort();
    count_within(r, codes, within);
    for (int i = 0; i < 50; i++) {
        double price = exp((low + high) / 2);
        sum = 0;
        for (uint32_t t = 0; t < r->tiles; t++) {
            uint32_t best = 1;
            for (uint32_t n = 2; n <= r->passes; n++)
                if (within[t][n] - price * r->cpu_ns[t] * pass_samples(n) >
                    within[t][best] - price * r->cpu_ns[t] * pass_samples(best))
                    best = n;
            p->passes[0][t] = p->passes[1][t] = best;
            sum += within[t][best];
        }
        if (cost_of(r, p) > cost)
            low = (low + high) / 2;
        else
            high = (low + high) / 2;
    }
    mem_free(within);
    return sum / (2.0 * r->width * r->height);
}

/* The plan of least display error for a cost. */
static void quantile_optimum(const struct replay *decides, double cost, struct plan *p)
{
    double low = log(0.01), high = log(255.0);

    for (int i = 0; i < 12; i++) {
        double middle = (low + high) / 2;
        if (most_within(decides, cost, (float)exp(middle), p) >= 0.95)
            high = middle;
        else
            low = middle;
    }
}

/* ---- gains ----------------------------------------------------------------------------------------- */

struct gain {
    double square, display;
};

static struct gain gain_of(const struct curve *c, struct judged j)
{
    return (struct gain){uniform_cost(c, j.square, 0) / j.cost, uniform_cost(c, j.display, 1) / j.cost};
}

static double balance_of(const struct plan *p, uint32_t tiles)
{
    double sum = 0;

    for (uint32_t t = 0; t < tiles; t++) {
        double a = pass_samples(p->passes[0][t]), b = pass_samples(p->passes[1][t]);
        sum += 4 * a * b / ((a + b) * (a + b));
    }
    return sum / tiles;
}

struct outcome {
    struct gain rounds;
    double balance, cost;
};

static struct outcome try_rules(const struct replay seeds[2], const struct curve curves[2],
                                const struct allocation_rules *rules, uint32_t level)
{
    struct outcome out = {{1, 1}, 0, 0};

    for (int s = 0; s < 2; s++) {
        const struct replay *decides = &seeds[s], *judges = &seeds[1 - s];
        struct plan p;
        struct judged j;
        struct gain g;
        plan_init(&p, decides->tiles, 1);
        (void)replay_rounds(decides, rules, NULL, level, REPLAY_RIGHT, p.passes);
        j = judge(judges, &p);
        g = gain_of(&curves[1 - s], j);
        out.rounds.square *= sqrt(g.square);
        out.rounds.display *= sqrt(g.display);
        out.balance += balance_of(&p, decides->tiles) / 2;
        out.cost += j.cost / 2;
        plan_release(&p);
    }
    return out;
}

/* The best gains that can be had at a cost, each for its own figure: of Neyman's with every floor
 * for the squared error, and of those and the quantile's for the display error. */
static struct gain optimum(const struct replay seeds[2], const struct curve curves[2], double cost)
{
    struct gain best = {0, 0};

    for (uint32_t least = 1; least <= seeds[0].passes + 2; least++) {
        struct gain both = {1, 1};
        for (int s = 0; s < 2; s++) {
            struct plan p;
            struct gain g;
            plan_init(&p, seeds[s].tiles, 1);
            if (least <= seeds[0].passes)
                neyman(&seeds[s], cost, least, &p);
            else if (least == seeds[0].passes + 2)
                least_square(&seeds[s], cost, &p);
            else
                quantile_optimum(&seeds[s], cost, &p);
            g = gain_of(&curves[1 - s], judge(&seeds[1 - s], &p));
            both.square *= sqrt(g.square);
            both.display *= sqrt(g.display);
            plan_release(&p);
        }
        if (both.square > best.square)
            best.square = both.square;
        if (both.display > best.display)
            best.display = both.display;
    }
    return best;
}

/* ---- targets --------------------------------------------------------------------------------------- */

struct aims {
    uint32_t count, met;
    double sum, least, most; /* of logarithms: reported error over the target */
};

/* Stop at the errors that uniform samples have, and see what the picture then says of itself. */
static void aim(const struct replay *r, const struct curve *c, enum allocation_measure measure, double margin,
                struct aims *out)
{
    struct allocation_rules rules = allocation_rules;

    rules.margin = margin;
    for (uint32_t i = level_passes(2); i + 2 < c->count; i++) {
        struct allocation_target target = {measure, c->at[i].display};
        struct plan p;
        struct accuracy_figures f;
        double ratio;
        if (measure == ALLOCATION_PSNR)
            target.value = 10 * log10(255 * 255 / c->at[i].square);
        plan_init(&p, r->tiles, 1);
        if (replay_rounds(r, &rules, &target, 7, REPLAY_RIGHT, p.passes)) {
            replay_reported(r, p.passes, &f);
            ratio = measure == ALLOCATION_PSNR ? (target.value - f.psnr_db) * log(10) / 20
                                               : log(f.display_error / target.value);
            out->count++;
            out->met += ratio <= 0;
            out->sum += ratio;
            out->least = fmin(out->least, ratio);
            out->most = fmax(out->most, ratio);
        }
        plan_release(&p);
    }
}

static void print_aims(const char *name, const struct replay seeds[2], const struct curve curves[2])
{
    static const char *const names[] = {"display", "psnr"};
    const double margins[] = {0, allocation_rules.margin};

    for (int m = 0; m < 2; m++)
        for (int k = 0; k < 2; k++) {
            struct aims a = {0, 0, 0, INFINITY, -INFINITY};
            for (int s = 0; s < 2; s++)
                aim(&seeds[s], &curves[s], m == 0 ? ALLOCATION_DISPLAY : ALLOCATION_PSNR, margins[k], &a);
            if (a.count > 0)
                printf("target %-14s %-8s margin %.2f: reported over target %.3f (%.3f to %.3f), met %u of %u\n", name,
                       names[m], margins[k], exp(a.sum / a.count), exp(a.least), exp(a.most), a.met, a.count);
        }
}

struct variant {
    const char *name;
    struct allocation_rules rules;
};

static uint32_t make_variants(struct variant *v, int explore)
{
    static const uint32_t shares[] = {50, 100, 200, 300};
    static const double limits[] = {0.5, 1, 2, 4, 1e9}, smoothings[] = {0, 0.25, 0.75, 1};
    static char names[64][32];
    uint32_t n = 0;

#define VARIANT(change, ...) \
    (snprintf(names[n], sizeof names[n], __VA_ARGS__), v[n] = (struct variant){names[n], allocation_rules}, \
     v[n].rules.change, n++)
    VARIANT(ratio_max = allocation_rules.ratio_max, "in use");
    if (!explore)
        return n;
    for (int i = 0; i < 3; i++)
        VARIANT(ratio_max = 2u << (i + i / 2), "ratio %u", 2u << (i + i / 2));
    for (int i = 0; i < 4; i++)
        VARIANT(share_percent = shares[i], "share %u", shares[i]);
    for (int i = 0; i < 4; i++)
        VARIANT(smoothing = smoothings[i], "smoothing %.2f", smoothings[i]);
    for (int i = 0; i < 5; i++)
        VARIANT(limit = limits[i], "limit %.1f", limits[i]);
    VARIANT(first_level = 3, "first level 3");
#undef VARIANT
    return n;
}

int main(int argc, char **argv)
{
    int explore = argc > 1 && strcmp(argv[1], "--explore") == 0;
    int targets = argc > 1 && strcmp(argv[1], "--targets") == 0;
    struct variant variants[64];
    uint32_t count = make_variants(variants, explore);
    double logs[64][4] = {{0}}, worst[64][2];
    int cells = 0;

    for (uint32_t v = 0; v < count; v++)
        worst[v][0] = worst[v][1] = INFINITY;
    printf("scene level | rules | RMS: gain, optimum | display error: gain, optimum | balance\n");
    for (int i = 1 + explore + targets; i < argc; i++) {
        struct replay seeds[2];
        struct curve curves[2];
        const char *name = strrchr(argv[i], '/') ? strrchr(argv[i], '/') + 1 : argv[i];
        for (uint32_t s = 0; s < 2; s++) {
            replay_read(&seeds[s], argv[i], s + 1, REPLAY_ERRORS);
            uniform_curve(&curves[s], &seeds[s]);
        }
        print_aims(name, seeds, curves);
        for (uint32_t level = 2; !targets && level_passes(level + 2) <= seeds[0].passes; level++) {
            struct gain best = {0, 0};
            cells++;
            for (uint32_t v = 0; v < count; v++) {
                struct outcome o = try_rules(seeds, curves, &variants[v].rules, level);
                if (v == 0)
                    best = optimum(seeds, curves, o.cost);
                printf("%-14s %u | %-14s | %.3f %.3f | %.3f %.3f | %.3f\n", name, level, variants[v].name,
                       o.rounds.square, best.square, o.rounds.display, best.display, o.balance);
                logs[v][0] += log(o.rounds.square);
                logs[v][1] += log(best.square);
                logs[v][2] += log(o.rounds.display);
                logs[v][3] += log(best.display);
                worst[v][0] = fmin(worst[v][0], o.rounds.square);
                worst[v][1] = fmin(worst[v][1], o.rounds.display);
            }
        }
        fflush(stdout);
        for (int s = 0; s < 2; s++)
            replay_release(&seeds[s]);
    }
    for (uint32_t v = 0; v < count && cells > 0; v++)
        printf("geometric mean   | %-14s | %.3f %.3f | %.3f %.3f | worst %.3f %.3f\n", variants[v].name,
               exp(logs[v][0] / cells), exp(logs[v][1] / cells), exp(logs[v][2] / cells), exp(logs[v][3] / cells),
               worst[v][0], worst[v][1]);
    return 0;
}
