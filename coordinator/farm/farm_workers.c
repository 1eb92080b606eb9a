/* farm_workers: workers join and leave, and cannot render some jobs. */
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/farm.h"

status farm_worker_add(struct farm *farm, struct farm_worker *worker, struct error *err)
{
    if (farm->worker_count == WORKERS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d workers are connected already", WORKERS_MAX);
    credit_init(&worker->credit, worker->threads);
    farm->workers[farm->worker_count++] = worker;
    farm->pump_wanted = 1;
    return STATUS_OK;
}

void farm_deliverer_begin(struct farm *farm, struct farm_worker *worker)
{
    struct error err = {0};

    if (worker->deliverer.number)
        return;
    worker->deliverer.number = ++farm->last_deliverer;
    worker->deliverer.first_seen = farm->wall_s;
    /* A conflict is then reported with the number only. */
    if (farm->store &&
        store_deliverer_save_later(farm->store, &worker->deliverer, &err) != STATUS_OK)
        log_warn("%s", err.text);
}

void farm_deliverer_text(const struct farm *farm, uint32_t deliverer, char out[DELIVERER_TEXT_MAX])
{
    struct deliverer gone;

    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (worker->deliverer.number != deliverer)
            continue;
        snprintf(out, DELIVERER_TEXT_MAX, "session %u (%s)", worker->held.session, worker->name);
        return;
    }
    if (farm->store && store_deliverer_find(farm->store, deliverer, &gone, NULL) == STATUS_OK &&
        gone.number)
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has left (%s, process %u, %s)", gone.host,
                 gone.process, gone.software);
    else
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has left (number %u)", deliverer);
}

void farm_worker_remove(struct farm *farm, struct farm_worker *worker, int died, uint64_t now_ns)
{
    uint64_t lent_ns = 0;
    struct job *job = died ? closing_suspected(farm, worker, &lent_ns) : NULL;

    lease_end_all_of(&farm->leases, &worker->held);
    if (job)
        closing_note_death(farm, job, worker, lent_ns, now_ns);
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        if (farm->workers[i] == worker) {
            farm->workers[i] = farm->workers[--farm->worker_count];
            break;
        }
    }
    farm->pump_wanted = 1;
}

static int job_has_results(const struct job *job)
{
    if (job->frames_done_count > 0 || job->stats.cpu_ns > 0)
        return 1;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        if (frame->ack_count > 0 || film_samples(frame->film) > 0)
            return 1;
    return 0;
}

/* Does the job have results, or units with workers, that belong to its pinned kernel? */
static int job_is_begun(const struct job *job)
{
    return job->leases > 0 || job_has_results(job);
}

int farm_can_serve(const struct job *job, const struct farm_worker *worker, char *why,
                   size_t why_size)
{
    if (!(worker->isa_mask >> job->settings.isa & 1))
        snprintf(why, why_size,
                 "it does not offer %s, which job %llu is pinned to (its CPU has none, or its --isa "
                 "leaves it out)",
                 isa_name(job->settings.isa), (unsigned long long)job->id);
    else if (job->kernel[0] && strcmp(job->kernel, worker->kernel) != 0 && job_is_begun(job))
        snprintf(why, why_size,
                 "it traces rays with %s, but job %llu was begun with %s; mixing them would change "
                 "the picture's bits",
                 worker->kernel, (unsigned long long)job->id, job->kernel);
    else if (job_is_broken_for(job, worker->machine))
        snprintf(why, why_size, "its machine said that it cannot render job %llu",
                 (unsigned long long)job->id);
    else
        return needs_fit(&job->needs, job->id, worker->tags, worker->memory, why, why_size);
    return 0;
}

void farm_job_broken(struct farm *farm, struct job *job, struct farm_worker *worker,
                     const char *text, uint64_t now_ns)
{
    uint32_t able = 0, held = 0;
    status s = STATUS_OK;
    char why[256];

    for (struct lease *lease = farm->leases.oldest, *newer; lease; lease = newer) {
        newer = lease->newer;
        if (lease->holder != &worker->held || lease->frame->job != job)
            continue;
        lease_end(&farm->leases, lease);
        held++;
    }
    if (held == 0 || !job_state_is_open(job->state))
        return; /* a second report, one for a revoked lease, or a false one */
    farm->pump_wanted = 1;
    farm_note(farm, job, NULL, "%s cannot render it: %s", worker->name, text);
    if (!job_is_broken_for(job, worker->machine))
        s = job_set_broken_for(job, worker->machine);
    for (uint32_t i = 0; i < farm->worker_count; i++)
        able += (uint32_t)farm_can_serve(job, farm->workers[i], why, sizeof why);
    /* With a result, some machine can render it: machines that cannot are skipped. */
    if (s != STATUS_OK || able == 0 || job->broken_count >= JOB_BROKEN_MACHINES_MAX ||
        (job->broken_count >= JOB_BROKEN_MAX && !job_has_results(job)))
        farm_fail(farm, job, now_ns, "%zu machine%s cannot render it: %s", job->broken_count,
                  job->broken_count == 1 ? "" : "s", text);
}
