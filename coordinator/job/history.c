#include "coordinator/job/history.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"

uint32_t history_add(struct history *h, const struct history_point *point)
{
    uint32_t at = h->count;

    if (at > 0 && point->samples <= h->points[at - 1].samples)
        at--;
    else if (at > 1 &&
             (double)h->points[at - 1].samples <
                 HISTORY_RATIO * (double)h->points[at - 2].samples)
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

int job_figures_note(struct job_figures *job, uint32_t index, uint32_t count,
                     const struct history_point *point)
{
    job->core_s += point->core_s;
    if (!point->figures.known)
        return 1;
    if (!job->display) {
        job->display = mem_alloc_array(count, sizeof *job->display);
        if (!job->display)
            return 0;
        for (uint32_t i = 0; i < count; i++)
            job->display[i] = NAN;
    }
    job->known += isnan(job->display[index]);
    job->display[index] = (float)point->figures.display_error;
    job->last = *point;
    job->last_frame = index;
    return 1;
}

void job_figures_release(struct job_figures *job)
{
    mem_free(job->display);
    memset(job, 0, sizeof *job);
}

double job_figures_worst(const struct job_figures *job, uint32_t count, uint32_t *index)
{
    double worst = NAN;

    for (uint32_t i = 0; job->display && i < count; i++)
        if (!(job->display[i] <= worst) && !isnan(job->display[i])) {
            worst = (double)job->display[i];
            *index = i;
        }
    return worst;
}

double job_figures_flicker(const struct job_figures *job, uint32_t count, uint32_t *index)
{
    double worst = NAN;

    for (uint32_t i = 0; job->display && i + 1 < count; i++) {
        double both = sqrt((double)job->display[i] * (double)job->display[i] +
                           (double)job->display[i + 1] * (double)job->display[i + 1]);
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

    for (uint32_t i = 0; job->display && i < count; i++)
        if (!isnan(job->display[i]))
            sum += (double)job->display[i] * (double)job->display[i];
    return job->known > 0 ? sqrt(sum / job->known) : NAN;
}
