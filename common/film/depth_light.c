#include "common/film/depth_light.h"

#include <math.h>
#include <stdio.h>

#include "common/math/elementary.h"
#include "common/scene/settings.h"

/* How fast throughput decreases per vertex is measured on (N/4, N/2] and (N/2, N]. From one to the other it slows down:
 * not at all where it is geometric, by 1/2 in a power law (the walk in a medium without end); what is outside of these
 * is noise. Behind N it is taken to slow down once more, and then to stay: what has bounds ends geometrically. */
#define SLOWING_MIN 0.5
#define SLOWING_MAX 1.0

enum { PERCENT_SIZE = 24 };

void depth_light_add_weighted(struct depth_light *sum, const struct depth_light *more, double weight)
{
    for (int i = 0; i < DEPTH_SUMS; i++)
        sum->sum[i] += weight * more->sum[i];
}

void depth_light_add(struct depth_light *sum, const struct depth_light *more)
{
    depth_light_add_weighted(sum, more, 1);
}

void depth_light_subtract(struct depth_light *sum, const struct depth_light *less)
{
    depth_light_add_weighted(sum, less, -1);
}

int depth_light_is_known(const struct depth_light *light)
{
    for (int i = 0; i < DEPTH_SUMS; i++)
        if (light->sum[i] > 0)
            return 1;
    return 0;
}

int depth_light_is_valid(const struct depth_light *light)
{
    for (int i = 0; i < DEPTH_SUMS; i++)
        if (!(light->sum[i] >= 0 && light->sum[i] < INFINITY))
            return 0;
    return 1;
}

/* The light that longer paths would have brought, in units of DEPTH_SEEN; INFINITY: paths do not end.
 *
 * One path more, which ended and brought the mean of the picture (with what it lacks), stands for what is known
 * before anything ended. With many samples it makes no difference. */
static double light_lost(const struct depth_light *light, double seen, double samples)
{
    const double ended = light->sum[DEPTH_ENDED];
    const double spent = fmax(light->sum[DEPTH_HALF] - ended, 0) + 1;
    const double left = 1 - ended / (samples * spent);
    const double brought = light->sum[DEPTH_GATHERED] + seen / samples;

    return left > 0 ? ended * brought / spent / left : INFINITY;
}

/* Decay per vertex of throughput that was `before` and is `after` that many vertices later, at least 0. */
static double decay_rate(double before, double after, uint32_t vertices)
{
    return vertices > 0 ? fmax(det_log_d((before + 1) / (after + 1)), 0) / vertices : 0;
}

/* Rounded: sums over frames depend in their last bits on which was done first. */
static double share_of(double part, double all) { return part < INFINITY ? round(part / all * 1e6) / 1e6 : 1; }

/* Double the depth until it takes little enough. */
static void look_deeper(struct depth_report *report, const struct depth_light *light, uint32_t max_depth)
{
    const uint32_t half = max_depth / 2, quarter = max_depth / 4;
    const double early = decay_rate(light->sum[DEPTH_QUARTER], light->sum[DEPTH_HALF], half - quarter);
    const double late = decay_rate(light->sum[DEPTH_HALF], light->sum[DEPTH_ENDED], max_depth - half);
    const double slowing = early > 0 ? fmin(fmax(late / early, SLOWING_MIN), SLOWING_MAX) : SLOWING_MAX;
    uint32_t depth = max_depth;

    do {
        const uint32_t twice = depth > 0 ? 2 * depth : 1;
        depth = twice < SETTINGS_DEPTH_MAX ? twice : SETTINGS_DEPTH_MAX;
        report->deeper = depth;
        report->deeper_share = share_of(report->share * det_exp_d(-late * slowing * (depth - max_depth)), 1);
    } while (report->deeper_share > DEPTH_SHARE_ENOUGH && depth < SETTINGS_DEPTH_MAX);
}

struct depth_report depth_light_report(const struct depth_light *light, uint64_t samples, uint32_t max_depth)
{
    /* The share of a black picture is that of one of little light. */
    const double seen = light->sum[DEPTH_SEEN] > 0 ? light->sum[DEPTH_SEEN] : 1;
    struct depth_report report = {0};
    double lost;

    if (samples == 0 || !(light->sum[DEPTH_ENDED] > 0))
        return report;
    lost = light_lost(light, seen, (double)samples);
    report.share = share_of(lost, lost + seen);
    if (report.share > DEPTH_SHARE_TOLD && max_depth < SETTINGS_DEPTH_MAX)
        look_deeper(&report, light, max_depth);
    return report;
}

/* "12", "1.2", "0.012": that many digits, and no exponent. */
static void percent_text(char out[PERCENT_SIZE], double share, int digits)
{
    const double percent = 100 * share;

    if (percent >= 9.5)
        snprintf(out, PERCENT_SIZE, "%.0f", percent);
    else
        snprintf(out, PERCENT_SIZE, "%.*g", digits, percent);
}

const char *depth_report_text(char out[DEPTH_TEXT_SIZE], const struct depth_report *report, uint32_t max_depth)
{
    char share[PERCENT_SIZE], deeper[PERCENT_SIZE];

    percent_text(share, report->share, 2);
    percent_text(deeper, report->deeper_share, 1);
    if (report->deeper)
        snprintf(out, DEPTH_TEXT_SIZE,
                 "light ended by depth: %s %% of the picture (--max-depth %u; %u would leave %s %%)", share, max_depth,
                 report->deeper, deeper);
    else
        snprintf(out, DEPTH_TEXT_SIZE, "light ended by depth: %s %% of the picture (--max-depth %u)", share, max_depth);
    return out;
}
