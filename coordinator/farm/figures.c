#include "coordinator/farm/figures.h"

#include <assert.h>
#include <math.h>

#include "common/system/clock.h"
#include "common/system/log.h"

void figures_open(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};

    eta_init(&frame->eta, frame->film);
    /* Without it, only the error's curve starts over. */
    if (farm->store && film_samples(frame->film) > 0 &&
        store_history_load(farm->store, frame->job->id, frame->number, &frame->history, &err) != STATUS_OK)
        log_warn("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number, err.text);
    figures_spend(frame, now_ns);
    frame->measure_tile_ns = (double)FIGURES_PIXEL_NS * TILE_SIZE * TILE_SIZE;
}

void figures_learn(struct job_frame *frame, uint32_t tile, uint64_t samples, uint64_t cpu_ns, uint64_t now_ns)
{
    eta_learn(&frame->eta, tile, samples, cpu_ns);
    throughput_add(&frame->job->throughput, cpu_ns, now_ns);
}

void figures_spend(struct job_frame *frame, uint64_t now_ns)
{
    frame->spent.core_s = (double)job_frame_cpu_ns(frame) / 1e9;
    frame->spent.wall_s = (double)job_frame_active_ns(frame, now_ns) / 1e9;
    frame->spent.samples = film_samples(frame->film);
    frame->spent.rays = film_rays(frame->film);
}

/* How many tiles the processor time of this run pays for. */
static double affordable_tiles(const struct job_frame *frame)
{
    double spent_ns = (double)frame->stats.cpu_ns, cost_ns = (double)frame->measure_cost_ns;
    double tiles = fmax(spent_ns / FIGURES_COST_SHARE - cost_ns, 0) / frame->measure_tile_ns;

    if (history_last(&frame->history) && frame->evidence.known)
        return tiles;
    if (tiles >= film_tile_count(frame->film))
        return tiles;
    return fmin(fmax(spent_ns / FIGURES_FIRST_SHARE - cost_ns, 0) / frame->measure_tile_ns, FIGURES_FIRST_TILES);
}

static int is_old(const struct job_frame *frame, const struct history_point *last)
{
    return frame->spent.wall_s - last->wall_s >= fmax(FIGURES_AGE_S, FIGURES_AGE_SHARE * frame->spent.wall_s);
}

/* Are figures due, and of how many tiles? */
static int is_due(struct job_frame *frame)
{
    const struct history_point *last = history_last(&frame->history);
    double tiles = affordable_tiles(frame), grown = last ? (double)frame->spent.samples / (double)last->samples : INFINITY;

    if (!film_has_groups(frame->film) || !(grown > 1))
        return 0;
    if (tiles >= film_tile_count(frame->film)) {
        frame->measure_tiles = 0;
        return grown >= FIGURES_GROWTH || is_old(frame, last);
    }
    if (tiles < FIGURES_LEAST_TILES || tonemap_reach(&frame->job->output.tonemap) == TONEMAP_REACH_PICTURE)
        return 0;
    tiles = fmax(tiles / 2, FIGURES_LEAST_TILES);
    frame->measure_tiles = tiles < FIGURES_SAMPLE_TILES ? (uint32_t)tiles : FIGURES_SAMPLE_TILES;
    return !last || is_old(frame, last);
}

void figures_tick(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    figures_spend(frame, now_ns);
    if (!farm->events.measure || frame->measuring || frame->closing || frame->state != FRAME_RENDERING ||
        now_ns < frame->measure_next_ns || !is_due(frame))
        return;
    if (farm->events.measure(farm->events.user, frame) == STATUS_OK) {
        frame->measuring = 1;
        frame->job->measurements++;
    } else {
        frame->measure_next_ns = now_ns + 10 * FIGURES_INTERVAL_MS * NS_PER_MS;
    }
}

static void frame_measured(struct farm *farm, struct job_frame *frame, const struct figures_result *result,
                           uint64_t now_ns)
{
    uint32_t tiles = frame->measure_tiles > 0 ? frame->measure_tiles : film_tile_count(frame->film);

    frame->measuring = 0;
    frame->measure_next_ns = now_ns + FIGURES_INTERVAL_MS * NS_PER_MS;
    frame->measure_cost_ns += result->cost_ns;
    if (frame->evidence.known) /* the first one reads the scene, too */
        frame->measure_tile_ns = (double)(result->cost_ns + 1) / tiles;
    frame->evidence = result->evidence;
    if (result->point) {
        history_add(&frame->history, result->point);
        farm->events.job_changed(farm->events.user, frame->job);
    }
    farm_frame_advance(farm, frame, now_ns); /* it waits for its place in the history */
}

void figures_measured(struct farm *farm, struct job *job, uint32_t number, const struct figures_result *result,
                      uint64_t now_ns)
{
    struct job_frame *frame = farm_frame_find(job, number);

    assert(job->measurements > 0);
    job->measurements--;
    if (job->removed)
        farm_job_dispose(farm, job);
    else if (frame && frame->measuring)
        frame_measured(farm, frame, result, now_ns);
}

void figures_denoised(struct job *job, uint32_t frame, const struct accuracy_figures *figures)
{
    if (figures && job->figures.last.figures.known && job->figures.last_frame == frame - job->first_frame)
        job->figures.last.denoised = *figures;
}

void figures_finished(struct farm *farm UNUSED, struct job *job, uint32_t frame, const struct history_point *point)
{
    if (point && !job_figures_note(&job->figures, frame - job->first_frame, job_frame_count(job), point))
        log_warn("job %llu, frame %u: out of memory: its figures are only in the store", (unsigned long long)job->id,
                 frame);
}
