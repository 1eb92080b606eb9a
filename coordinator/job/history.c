#include "coordinator/job/history.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

uint32_t history_add(struct history *h, const struct history_point *point)
{
    uint32_t at = h->count;

    if (at > 0 && point->samples <= h->points[at - 1].samples)
        at--;
    else if (at > 1 && (double)h->points[at - 1].samples < HISTORY_RATIO * (double)h->points[at - 2].samples)
        at--;
    if (at == HISTORY_MAX)
        at--;
    h->points[at] = *point;
    h->count = at + 1;
    return at;
}

const struct history_point *history_last(const struct history *h)
{
    return h->count > 0 ? &h->points[h->count - 1] : NULL;
}

double history_slope(const struct history *h)
{
    const struct history_point *last = history_last(h);

    for (uint32_t i = h->count; i-- > 0;) {
        const struct history_point *p = &h->points[i];
        double grown = (double)last->samples / (double)p->samples, errors;
        if (grown < HISTORY_GROWN || !p->figures.known || !last->figures.known)
            continue;
        errors = last->figures.display_error / p->figures.display_error;
        return errors > 0 && isfinite(errors) ? det_log_d(errors) / det_log_d(grown) : (double)NAN;
    }
    return NAN;
}

static float display_of(const struct job_figures *job, uint32_t index)
{
    return job->errors[index][ALLOCATION_DISPLAY];
}

void job_figures_set_last(struct job_figures *job, uint32_t index, const struct history_point *point)
{
    job->last = point ? *point : (struct history_point){0};
    job->last_frame = index;
}

int job_figures_note(struct job_figures *job, uint32_t index, uint32_t count, const struct history_point *point)
{
    job->core_s += point->core_s;
    if (!point->figures.known)
        return 1;
    if (!job->errors) {
        job->errors = mem_alloc_array(count, sizeof *job->errors);
        if (!job->errors)
            return 0;
        for (uint32_t i = 0; i < count; i++)
            job->errors[i][ALLOCATION_DISPLAY] = NAN;
    }
    job->known += isnan(display_of(job, index));
    for (unsigned m = 0; m < ALLOCATION_MEASURES; m++)
        job->errors[index][m] = (float)target_point(&point->figures, 0, (enum allocation_measure)m).error;
    job_figures_set_last(job, index, point);
    return 1;
}

void job_figures_release(struct job_figures *job)
{
    mem_free(job->errors);
    memset(job, 0, sizeof *job);
}

double job_figures_worst(const struct job_figures *job, uint32_t count, uint32_t *index)
{
    double worst = NAN;

    for (uint32_t i = 0; job->errors && i < count; i++)
        if (!(display_of(job, i) <= worst) && !isnan(display_of(job, i))) {
            worst = (double)display_of(job, i);
            *index = i;
        }
    return worst;
}

double job_figures_flicker(const struct job_figures *job, uint32_t count, uint32_t *index)
{
    double worst = NAN;

    for (uint32_t i = 0; job->errors && i + 1 < count; i++) {
        double both = sqrt((double)display_of(job, i) * (double)display_of(job, i) +
                           (double)display_of(job, i + 1) * (double)display_of(job, i + 1));
        if (!(both <= worst) && !isnan(both)) {
            worst = both;
            *index = i;
        }
    }
    return worst;
}

double job_figures_mean(const struct job_figures *job, uint32_t count)
{
    double sum = 0;

    for (uint32_t i = 0; job->errors && i < count; i++)
        if (!isnan(display_of(job, i)))
            sum += (double)display_of(job, i) * (double)display_of(job, i);
    return job->known > 0 ? sqrt(sum / job->known) : NAN;
}

int job_figures_misses(const struct job_figures *job, uint32_t index, const struct allocation_target *target)
{
    return job->errors && !isnan(display_of(job, index)) &&
           (double)job->errors[index][target->measure] > TARGET_MISSED * target_error(target);
}

double job_figures_missed(const struct job_figures *job, uint32_t count, const struct allocation_target *target,
                          uint32_t *index)
{
    double worst = NAN;

    for (uint32_t i = 0; job->errors && i < count; i++)
        if (job_figures_misses(job, i, target) && !((double)job->errors[i][target->measure] <= worst)) {
            worst = (double)job->errors[i][target->measure];
            *index = i;
        }
    return worst;
}
