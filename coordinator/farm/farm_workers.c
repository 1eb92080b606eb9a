/* farm_workers: workers join and leave, and cannot render some jobs. */
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/farm.h"
#include "coordinator/farm/roster.h"

void farm_workers_changed(const struct farm *farm)
{
    if (farm->events.workers_changed)
        farm->events.workers_changed(farm->events.user);
}

status farm_worker_add(struct farm *farm, struct farm_worker *worker, struct error *err)
{
    if (farm->worker_count == WORKERS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d workers are connected already", WORKERS_MAX);
    credit_init(&worker->credit, worker->threads);
    worker->place.index = farm->worker_count;
    farm->workers[farm->worker_count++] = worker;
    workforce_due(farm, worker);
    farm_workers_changed(farm);
    return STATUS_OK;
}

struct farm_worker *farm_worker_of(const struct lease *lease)
{
    _Static_assert(offsetof(struct farm_worker, held) == 0, "a lease's holder is its worker");
    return (struct farm_worker *)lease->holder;
}

void farm_deliverer_begin(struct farm *farm, struct farm_worker *worker)
{
    struct error err = {0};

    if (worker->deliverer.number)
        return;
    worker->deliverer.number = ++farm->last_deliverer;
    worker->deliverer.first_seen = farm->wall_s;
    snprintf(worker->deliverer.label, sizeof worker->deliverer.label, "%s", worker->label);
    /* A conflict is then reported with the number only. */
    if (farm->store && store_deliverer_save_later(farm->store, &worker->deliverer, &err) != STATUS_OK)
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
    if (farm->store && store_deliverer_find(farm->store, deliverer, &gone, NULL) == STATUS_OK && gone.number)
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has left (%s, process %u, %s)", gone.host, gone.process,
                 gone.software);
    else
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has left (number %u)", deliverer);
}

void farm_worker_remove(struct farm *farm, struct farm_worker *worker, int died, uint64_t now_ns)
{
    uint64_t lent_ns = 0;
    struct job *job = died ? closing_suspected(farm, worker, &lent_ns) : NULL;

    farm->counts.workers_died += died != 0;
    lease_end_all_of(&farm->leases, &worker->held);
    roster_leave(farm, worker);
    if (job)
        closing_note_death(farm, job, worker, lent_ns, now_ns);
    workforce_leave(farm, worker);
    farm->workers[worker->place.index] = farm->workers[--farm->worker_count];
    farm->workers[worker->place.index]->place.index = worker->place.index;
    farm_wake(farm);
    farm_workers_changed(farm);
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

/* Does the job have results, or units with workers, that belong to its pinned ray tracer? */
static int job_is_begun(const struct job *job) { return job->leases > 0 || job_has_results(job); }

static void explain_refusal(const struct job *job, const struct refusal *refusal, char *why, size_t why_size)
{
    if (refusal->damaged)
        snprintf(why, why_size, "its machine said that it cannot render job %llu", (unsigned long long)job->id);
    else
        snprintf(why, why_size, "its machine lacks something for job %llu, and is tried again: %.180s",
                 (unsigned long long)job->id, refusal->shortage.text);
}

int farm_can_serve(const struct job *job, const struct farm_worker *worker, char *why, size_t why_size)
{
    if (!(worker->isa_mask >> job->settings.isa & 1))
        snprintf(why, why_size,
                 "it does not offer %s, which job %llu is pinned to (its CPU has none, or its --isa "
                 "leaves it out)",
                 isa_name(job->settings.isa), (unsigned long long)job->id);
    else if (job->ray_tracer[0] && strcmp(job->ray_tracer, worker->ray_tracer) != 0 && job_is_begun(job))
        snprintf(why, why_size,
                 "it traces rays with %s, but job %llu was begun with %s; mixing them would change "
                 "the picture's bits",
                 worker->ray_tracer, (unsigned long long)job->id, job->ray_tracer);
    else if (refusals_bar(&job->refusals, worker->machine))
        explain_refusal(job, refusals_find(&job->refusals, worker->machine), why, why_size);
    else
        return needs_fit(&job->needs, job->id, worker->tags, worker->memory, why, why_size);
    return 0;
}

/* Machines of connected workers that may yet render the job: a shortage passes. */
static uint32_t machines_able(const struct farm *farm, const struct job *job)
{
    uint32_t able = 0;
    char why[256];

    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct refusal *refusal = refusals_find(&job->refusals, farm->workers[i]->machine);
        able += (refusal && refusal->waits) || farm_can_serve(job, farm->workers[i], why, sizeof why);
    }
    return able;
}

void farm_job_broken(struct farm *farm, struct job *job, struct farm_worker *worker, status code, const char *text,
                     uint64_t now_ns)
{
    const struct refusal *before = refusals_find(&job->refusals, worker->machine);
    uint32_t held = 0;

    for (struct lease *lease = worker->held.oldest, *newer; lease; lease = newer) {
        newer = lease->holder_newer;
        if (lease->frame->job != job)
            continue;
        lease_end(&farm->leases, lease);
        held++;
    }
    if (held == 0 || !job_state_is_open(job->state))
        return; /* a second report, one for a revoked lease, or a false one */
    farm_wake(farm);
    farm->order.stale = 1;
    farm->shortage_ns = 0; /* look when the next one is due */
    if (!before || status_is_scene(code))
        farm_note(farm, job, NULL, "%s cannot render it%s: %s", worker->name,
                  status_is_scene(code) ? "" : " at present, and is tried again", text);
    if (refusals_note(&job->refusals, worker->machine, code, text, now_ns) != STATUS_OK)
        log_warn("job %llu (%s): no memory to note that %s cannot render it", (unsigned long long)job->id, job->name,
                 worker->name);
    farm->events.job_changed(farm->events.user, job);
    /* With a result, some machine can render it: machines that cannot are skipped. */
    if (job->refusals.damaged > 0 &&
        (machines_able(farm, job) == 0 || job->refusals.damaged >= JOB_BROKEN_MACHINES_MAX ||
         (job->refusals.damaged >= JOB_BROKEN_MAX && !job_has_results(job))))
        farm_fail(farm, job, now_ns, "%zu machine%s cannot render it: %s", job->refusals.damaged,
                  job->refusals.damaged == 1 ? "" : "s", text);
}

/* Ask machines again that were short of something: those whose turn it is, or all. */
static void ask_again(struct farm *farm, int all, uint64_t now_ns)
{
    farm->shortage_ns = UINT64_MAX;
    for (size_t i = 0; i < farm->queue.active_count; i++) {
        struct refusals *refusals = &farm->queue.active[i]->refusals;
        int some = all && refusals_hurry(refusals);
        some |= refusals_due(refusals, now_ns, &farm->shortage_ns);
        if (some)
            farm_wake(farm);
        farm->order.stale |= some;
    }
}

void farm_shortages_hurry(struct farm *farm, uint64_t now_ns) { ask_again(farm, 1, now_ns); }

void farm_workers_tick(struct farm *farm, uint64_t now_ns)
{
    if (now_ns >= farm->shortage_ns)
        ask_again(farm, 0, now_ns);
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        struct farm_worker *worker = farm->workers[i];
        if (worker->saved_ns && now_ns - worker->saved_ns < WORKER_SAVE_MS * NS_PER_MS)
            continue;
        if (!worker->saved.stored || worker->units_done != worker->saved.units)
            worker_save(farm, worker, NULL);
        worker->saved_ns = now_ns ? now_ns : 1;
    }
}

/* ---- units that hang ------------------------------------------------------------------------- */

/* Take the unit away from the worker, if it still holds it. */
static void take_back(struct farm *farm, const struct job_frame *frame, struct unit_name name,
                      const struct farm_worker *worker)
{
    const struct unit *unit = job_frame_unit_find(frame, name);

    for (uint32_t i = 0; unit && i < unit->holder_count; i++) {
        struct lease *lease = unit->holders[i];
        if (lease->holder != &worker->held)
            continue;
        lease_return_unit(&farm->leases, lease, name);
        farm_wake(farm);
        return;
    }
}

/* Is it the unit that the worker's note is about? Its thread is lost, also when others have rendered it. */
static int is_noted(const struct farm_worker *worker, uint64_t job, uint32_t frame, struct unit_name name)
{
    return worker->hang_note[0] && worker->hang_job == job && worker->hang_frame == frame &&
           worker->hang_unit.tile == name.tile && worker->hang_unit.group == name.group &&
           worker->hang_unit.pass == name.pass;
}

static void note_hang(struct farm *farm, struct job *job, struct job_frame *frame, struct unit_name name,
                      struct farm_worker *worker, uint64_t now_ns)
{
    const struct hang_unit *unit = hangs_note(
        &job->hangs,
        (struct hang_unit){.frame = frame->number, .tile = name.tile, .group = name.group, .pass = name.pass},
        worker->held.session);

    if (!unit)
        return;
    log_warn("worker %s: %s", worker->label, worker->hang_note);
    worker_line_add(farm, worker, "%s", worker->hang_note);
    farm_note(farm, job, NULL, "worker %s: %s", worker->label, worker->hang_note);
    take_back(farm, frame, name, worker);
    if (unit->session_count == HANG_SESSIONS_MAX && job_state_is_open(job->state))
        closing_note_hang(farm, job, unit, now_ns);
}

int farm_worker_renders_long(struct farm *farm, struct farm_worker *worker, uint64_t id, uint32_t number,
                             struct unit_name name, uint64_t running_ns, uint64_t now_ns)
{
    struct job *job = queue_find(&farm->queue, id);
    struct job_frame *frame = job ? farm_frame_find(job, number) : NULL;
    uint64_t samples, limit_ns;

    if (!frame || frame->state != FRAME_RENDERING || !job_frame_has_unit(frame, name) ||
        film_has(frame->film, name.tile, name.group, name.pass))
        return is_noted(worker, id, number, name);
    samples = job_frame_unit_samples(frame, name);
    limit_ns = hangs_limit_ns(&job->hangs, samples, farm->hang_ns);
    if (limit_ns == 0 || running_ns <= limit_ns)
        return 0;
    snprintf(worker->hang_note, sizeof worker->hang_note,
             "a thread has been rendering a unit of job %llu (frame %u, tile %u, group %u, pass %u) for %.0f s, and the "
             "slowest of its size took %.2g s: another worker gets it as well",
             (unsigned long long)job->id, number, name.tile, name.group, name.pass,
             (double)running_ns / 1e9, job->hangs.sample_ns_max * (double)samples / 1e9);
    worker->hang_job = id;
    worker->hang_frame = number;
    worker->hang_unit = name;
    note_hang(farm, job, frame, name, worker, now_ns);
    return 1;
}
