/* depth_light: the light that ends by depth, as a share of the picture.
 *
 * --max-depth N ends a path at its vertex of depth N. What longer paths would have brought is estimated from
 * what the paths did before, with sums that cost nothing:
 *
 *   lost = (throughput at depth N) * (light gathered between the depths N/2 and N)
 *                                  / (throughput that ended between them)
 *
 * Light per throughput that ended is what a unit of throughput brings until nothing is left of it. That is exact
 * where it is the same beyond N as before: wherever radiance by depth is geometric (a closed room of one albedo),
 * and in every white furnace without absorption, whatever the scattering: each unit of throughput that ends
 * there has found the sky. Elsewhere it is an estimate (docs/NUMERICS.md, "Light ended by depth").
 *
 * The sums are part of a unit's result. Those of a film (film_work) are weighted so that each pixel counts alike.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* Sums over the samples, in luminance (Rec. 709); finite, not negative. A vertex has depth d after d scatterings. */
enum depth_sum {
    DEPTH_SEEN,      /* of what the samples added to the picture */
    DEPTH_QUARTER,   /* of the throughput at the vertex of depth N/4, rounded down; of 1 for a camera ray */
    DEPTH_HALF,      /* at N/2 */
    DEPTH_ENDED,     /* at N, where the paths were ended */
    DEPTH_GATHERED,  /* of what paths added to their samples after their vertex of depth N/2 */
    DEPTH_SUMS
};

struct depth_light {
    double sum[DEPTH_SUMS];
};

void depth_light_add(struct depth_light *sum, const struct depth_light *more);
void depth_light_subtract(struct depth_light *sum, const struct depth_light *less);
/* sum += weight * more */
void depth_light_add_weighted(struct depth_light *sum, const struct depth_light *more, double weight);
/* Is anything in the sums? There is nothing in those of frames that older releases rendered. */
int depth_light_is_known(const struct depth_light *light);
/* Are the sums finite and not negative? */
int depth_light_is_valid(const struct depth_light *light);

/* What is said of them. */
struct depth_report {
    double share;        /* of the light of a picture without a limit, 0..1, that the limit took */
    uint32_t deeper;     /* the least of 2N, 4N, ... up to SETTINGS_DEPTH_MAX that would take at most
                              DEPTH_SHARE_ENOUGH, or else that limit; 0: `share` is no more itself, or N is the limit */
    double deeper_share; /* what that would take */
};

/* Shares above this are reported in summaries, and what a depth may take to be recommended. */
#define DEPTH_SHARE_TOLD 0.005
#define DEPTH_SHARE_ENOUGH 0.01

/* Of `samples` samples with this --max-depth. */
struct depth_report depth_light_report(const struct depth_light *light, uint64_t samples, uint32_t max_depth);

enum { DEPTH_TEXT_SIZE = 160 };
/* "light ended by depth: 12 % of the picture (--max-depth 8; 32 would leave 1 %)". Returns `out`. */
const char *depth_report_text(char out[DEPTH_TEXT_SIZE], const struct depth_report *report, uint32_t max_depth);
