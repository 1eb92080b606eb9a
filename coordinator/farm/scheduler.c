#include "coordinator/farm/scheduler.h"

#include <stdio.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/roster.h"
#include "coordinator/farm/waiting.h"

/* The amount that the worker may be lent now. */
struct budget {
    uint32_t units;
    double samples; /* the lease ends with the unit that reaches this */
};

static double samples_in(const struct farm_worker *worker, uint32_t milliseconds)
{
    return milliseconds * 1e6 * worker->credit.threads / worker->cost_ns;
}

/* The job's units that the worker holds: each keeps a core busy, as far as it has cores. */
static uint32_t units_of(const struct farm_worker *worker, const struct job *job)
{
    uint32_t units = 0;

    for (const struct lease *lease = worker->held.oldest; lease; lease = lease->holder_newer)
        units += lease->frame->job == job ? lease->open_count : 0;
    return units;
}

/* How many units the worker may get of a job that only so many cores may render: a worker that does not fit as a whole
 * holds none in reserve. 0: the cores are taken. */
static uint32_t units_within(const struct farm *farm, const struct job *job, const struct farm_worker *worker)
{
    uint32_t left = job->needs.max_cores, held;

    if (left == 0)
        return UINT32_MAX;
    for (uint32_t i = 0; i < farm->worker_count && job->leases > 0 && left > 0; i++) {
        const struct farm_worker *other = farm->workers[i];
        uint32_t cores = other == worker ? 0 : units_of(other, job);
        cores = cores < other->threads ? cores : other->threads;
        left -= cores < left ? cores : left;
    }
    if (worker->threads <= left)
        return UINT32_MAX;
    held = units_of(worker, job);
    return held < left ? left - held : 0;
}

/* 0: the worker holds enough. */
static int budget_for(struct farm *farm, const struct farm_worker *worker, const struct job_frame *frame, int early,
                      uint64_t now_ns, struct budget *budget)
{
    uint32_t threads = worker->credit.threads;
    uint64_t share;
    double held = (double)worker->held.samples;

    budget->units = worker->room < LEASE_UNITS_MAX ? worker->room : LEASE_UNITS_MAX;
    if (worker->cost_ns <= 0 || worker->cost_job != frame->job->id) {
        /* Nothing measured yet: two units for each thread, one of them in reserve. */
        if (worker->held.units >= 2 * threads)
            return 0;
        budget->samples = 0x1p63;
        share = threads;
    } else {
        if (held >= samples_in(worker, HELD_WORK_MS) && worker->held.units >= threads)
            return 0;
        budget->samples = samples_in(worker, film_covered(frame->film) ? LEASE_WORK_MS : LEASE_WORK_FIRST_MS);
        share = early ? threads : job_frame_unleased(frame) * threads / (2 * workforce_threads(farm, worker, now_ns));
    }
    if (share < 1)
        share = 1;
    if (share < budget->units)
        budget->units = (uint32_t)share;
    if (units_within(farm, frame->job, worker) < budget->units)
        budget->units = units_within(farm, frame->job, worker);
    return budget->units > 0;
}

/* The unit hangs there, and another worker may have it. */
static int is_barred(const struct farm *farm, const struct job_frame *frame, const struct farm_worker *worker,
                     struct unit_name name)
{
    const struct job *job = frame->job;
    char why[256];

    if (!hangs_has(&job->hangs, (struct hang_unit){.frame = frame->number, .tile = name.tile,
                                                   .group = name.group, .pass = name.pass},
                   worker->held.session))
        return 0;
    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (farm->workers[i] != worker && worker_takes_work(farm->workers[i]) &&
            farm_can_serve(job, farm->workers[i], why, sizeof why))
            return 1;
    return 0;
}

static uint32_t take_fresh(const struct farm *farm, struct job_frame *frame, const struct farm_worker *worker,
                           const struct budget *budget, int early, struct unit_name units[LEASE_UNITS_MAX])
{
    struct unit_name barred[HANG_UNITS_MAX];
    uint32_t count = 0, barred_count = 0;
    double samples = 0;

    while (count < budget->units && samples < budget->samples &&
           (early ? job_frame_take_early(frame, &units[count]) : job_frame_take(frame, &units[count]))) {
        if (frame->job->state == JOB_STATE_FINISHING && units[count].pass > 0) {
            job_frame_return(frame, units[count]); /* only the first pass is wanted now */
            break;
        }
        if (barred_count < HANG_UNITS_MAX && is_barred(farm, frame, worker, units[count])) {
            barred[barred_count++] = units[count];
            continue;
        }
        samples += (double)job_frame_unit_samples(frame, units[count]);
        count++;
    }
    while (barred_count > 0)
        job_frame_return(frame, barred[--barred_count]);
    return count;
}

static uint64_t overdue_limit_ns(const struct job *job)
{
    uint64_t limit_ns = OVERDUE_FACTOR * job->turnaround_ns;

    if (job->turnaround_ns == 0)
        return OVERDUE_UNKNOWN_MS * NS_PER_MS;
    return limit_ns < OVERDUE_LEAST_MS * NS_PER_MS ? OVERDUE_LEAST_MS * NS_PER_MS : limit_ns;
}

/* The unproven worker's lease that holds the unit longest; NULL: none. */
static struct lease *unproven_holder(const struct unit *unit, uint64_t now_ns)
{
    struct lease *found = NULL;

    for (uint32_t i = 0; i < unit->holder_count; i++) {
        struct lease *lease = unit->holders[i];
        const struct farm_worker *worker = farm_worker_of(lease);
        if (!credit_is_proven(&worker->credit, now_ns) && (!found || lease->id < found->id))
            found = lease;
    }
    return found;
}

/* Is there a place for the worker among the unit's holders, if necessary after one has lost its place? */
static int make_place(struct farm *farm, const struct unit *unit, const struct farm_worker *worker, uint64_t now_ns)
{
    uint32_t places = credit_is_proven(&worker->credit, now_ns) ? UNIT_HOLDERS_MAX : UNIT_HOLDERS_UNPROVEN_MAX;
    struct lease *lease;
    struct farm_worker *loser;

    for (uint32_t i = 0; i < unit->holder_count; i++)
        if (unit->holders[i]->holder == &worker->held)
            return 0;
    if (unit->holder_count < places)
        return 1;
    lease = unproven_holder(unit, now_ns);
    if (!lease)
        return 0;
    loser = farm_worker_of(lease);
    credit_lapsed(&loser->credit, lease->granted_ns, now_ns);
    workforce_counts(farm, loser);
    lease_return_unit(&farm->leases, lease, unit->name);
    return 1;
}

static uint32_t take_overdue(struct farm *farm, const struct job_frame *frame, const struct farm_worker *worker,
                             uint64_t now_ns, struct unit_name units[LEASE_UNITS_MAX])
{
    uint64_t limit_ns = overdue_limit_ns(frame->job);
    uint32_t count = 0, most = units_within(farm, frame->job, worker);

    if (credit_is_stuck(&worker->credit, worker->held.units, limit_ns, now_ns))
        return 0;
    for (const struct unit *unit = frame->oldest;
         unit && count < worker->credit.threads && count < worker->room && count < most && count < LEASE_UNITS_MAX &&
         now_ns - unit->granted_ns >= limit_ns;
         unit = unit->newer)
        if (!is_barred(farm, frame, worker, unit->name) && make_place(farm, unit, worker, now_ns))
            units[count++] = unit->name;
    return count;
}

static struct lease *grant(struct farm *farm, struct job_frame *frame, struct farm_worker *worker,
                           const struct unit_name *units, uint32_t count, uint64_t now_ns)
{
    uint32_t held = worker->held.units;
    struct lease *lease;

    if (frame->job->leases == 0) /* what passed without work says nothing of its speed */
        throughput_idle(&frame->job->throughput, now_ns);
    lease = lease_grant(&farm->leases, frame, &worker->held, units, count, now_ns);

    if (!lease)
        return NULL;
    credit_lent(&worker->credit, held, now_ns);
    suspicion_lent(&frame->job->suspicion, worker->held.session);
    worker->room -= lease->unit_count;
    worker->note[0] = 0;
    order_served(frame->job, now_ns);
    if (!frame->begun_ns)
        frame->begun_ns = now_ns ? now_ns : 1;
    farm_job_started(farm, frame->job, worker, now_ns);
    return lease;
}

/* Is another worker already probing the suspected job? */
static int is_probed_by_another(const struct farm *farm, const struct job *job, const struct farm_worker *worker)
{
    uint32_t probe = job->suspicion.probe;

    if (job->suspicion.deaths == 0 || probe == 0 || probe == worker->held.session)
        return 0;
    for (const struct lease *lease = farm->leases.oldest; lease; lease = lease->newer)
        if (lease->frame->job == job && lease->holder->session == probe)
            return 1;
    return 0;
}

/* Tell a worker, once for each job, why it gets no units of it. */
static int may_serve(struct farm *farm, const struct job *job, struct farm_worker *worker)
{
    char why[sizeof worker->note];

    if (!job_state_is_open(job->state) || is_probed_by_another(farm, job, worker) ||
        units_within(farm, job, worker) == 0)
        return 0;
    if (farm_can_serve(job, worker, why, sizeof why))
        return 1;
    snprintf(worker->note, sizeof worker->note, "%s", why);
    if (job->id > worker->noticed_job && needs_fit(&job->needs, job->id, worker->tags, worker->memory, NULL, 0)) {
        char text[sizeof why + 64];
        worker->noticed_job = job->id;
        snprintf(text, sizeof text, "this worker gets no work of job %llu: %s", (unsigned long long)job->id, why);
        farm->events.notice(farm->events.user, worker->held.session, text);
    }
    return 0;
}

/* `early`: units that may never be wanted. */
static struct lease *grant_fresh(struct farm *farm, struct job_frame *frame, struct farm_worker *worker, int early,
                                 uint64_t now_ns, int *full)
{
    static struct unit_name units[LEASE_UNITS_MAX];
    struct budget budget;
    uint32_t count;

    if (frame->end != FRAME_END_NONE || !farm_may_lease(farm, frame) ||
        (early && frame->job->state == JOB_STATE_FINISHING))
        return NULL;
    if (!budget_for(farm, worker, frame, early, now_ns, &budget)) {
        *full = 1;
        return NULL;
    }
    count = take_fresh(farm, frame, worker, &budget, early, units);
    return count ? grant(farm, frame, worker, units, count, now_ns) : NULL;
}

static struct lease *grant_overdue(struct farm *farm, struct job_frame *frame, struct farm_worker *worker,
                                   uint64_t now_ns)
{
    static struct unit_name units[LEASE_UNITS_MAX];
    uint32_t count;

    if (frame->end != FRAME_END_NONE || !farm_may_lease(farm, frame))
        return NULL;
    count = take_overdue(farm, frame, worker, now_ns, units);
    if (count == 0)
        return NULL;
    log_info("job %llu, frame %u: %u overdue work units go to session %u as well", (unsigned long long)frame->job->id,
             frame->number, count, worker->held.session);
    return grant(farm, frame, worker, units, count, now_ns);
}

/* Of the job's open frames. */
static struct lease *grant_of_job(struct farm *farm, const struct job *job, struct farm_worker *worker, int early,
                                  uint64_t now_ns, int *full)
{
    struct lease *lease = NULL;

    for (struct job_frame *frame = job->frames; frame && !lease && !*full; frame = frame->next)
        lease = grant_fresh(farm, frame, worker, early, now_ns, full);
    return lease;
}

/* The next ready job after `after` (NULL: the first) in one of the lists; those that are not ready come last. */
static struct job *next_ready(const struct farm *farm, unsigned lists, const struct job *after)
{
    struct job *job = queue_next(&farm->queue, lists, after);

    return job && job->place.ready ? job : NULL;
}

/* The lanes of waiting jobs that the worker may be able to serve. It hears of each of the others once
 * why it gets none of the first job. */
static unsigned lanes_of(struct farm *farm, struct farm_worker *worker)
{
    unsigned lanes = 0;

    for (unsigned lane = CANDIDATES_LANES; lane < CANDIDATES_LISTS; lane++) {
        const struct job *job = next_ready(farm, CANDIDATES_BIT(lane), NULL);
        if (job && worker->isa_mask >> job->settings.isa & 1)
            lanes |= CANDIDATES_BIT(lane);
        else if (job && (job->id > worker->noticed_job || !worker->note[0]))
            (void)may_serve(farm, job, worker);
    }
    return lanes;
}

/* Is it known that no frame of these lanes can be begun by anybody? */
static int is_barren(const struct farm *farm, unsigned lanes)
{
    return (lanes & ~farm->barren.lanes) == 0 && farm->barren.changes == farm->queue.candidates.changes &&
           farm->barren.open_bytes == farm->open_bytes;
}

/* The lists whose jobs the worker is asked for: those with open frames, and if a frame can be begun, those
 * that wait. */
static unsigned lists_of(struct farm *farm, struct farm_worker *worker)
{
    unsigned lanes = farm_may_begin(farm) ? lanes_of(farm, worker) : 0;

    return CANDIDATES_BIT(CANDIDATES_WORKING) | (is_barren(farm, lanes) ? 0 : lanes);
}

/* No frame can be begun: perhaps one of a later job leaves memory for the first job that has none open. */
static void ask_for_room(struct farm *farm, struct farm_worker *worker, uint64_t now_ns)
{
    struct job *job = farm->leaving ? NULL : next_ready(farm, CANDIDATES_ALL_LANES, NULL);

    while (job && (job->frames || !may_serve(farm, job, worker)))
        job = next_ready(farm, CANDIDATES_ALL_LANES, job);
    if (job)
        (void)farm_frame_open_next(farm, job, now_ns);
}

/* A unit that is wanted: of the first job that has one for the worker. */
static struct lease *grant_wanted(struct farm *farm, struct farm_worker *worker, uint64_t now_ns, int *full)
{
    unsigned lists = lists_of(farm, worker);
    uint64_t changes = farm->queue.candidates.changes, bytes = farm->open_bytes;
    int refused = 0; /* some waiting job is not for this worker, or not now */

    for (struct job *job = next_ready(farm, lists, NULL); job;
         job = next_ready(farm, lists, job)) {
        struct lease *lease = NULL;
        struct job_frame *frame;

        if (!may_serve(farm, job, worker)) {
            refused |= (job->candidate_lists & lists & CANDIDATES_ALL_LANES) != 0;
            continue;
        }
        lease = grant_of_job(farm, job, worker, 0, now_ns, full);
        /* A frame with a time limit has the farm to itself. */
        if (!lease && !*full && stop_has_limit(&job->stop))
            lease = grant_of_job(farm, job, worker, 1, now_ns, full);
        while (!lease && !*full && (frame = farm_frame_open_next(farm, job, now_ns)))
            lease = grant_fresh(farm, frame, worker, 0, now_ns, full);
        if (lease || *full)
            return lease;
        if (!farm_may_begin(farm))
            lists = CANDIDATES_BIT(CANDIDATES_WORKING);
    }
    if (!farm_may_begin(farm))
        ask_for_room(farm, worker, now_ns);
    lists &= CANDIDATES_ALL_LANES;
    if (lists && !refused) {
        farm->barren.lanes = lists;
        farm->barren.changes = changes;
        farm->barren.open_bytes = bytes;
    }
    return NULL;
}

static struct lease *grant_early(struct farm *farm, struct farm_worker *worker, uint64_t now_ns, int *full)
{
    const unsigned working = CANDIDATES_BIT(CANDIDATES_WORKING);
    struct lease *lease = NULL;

    for (struct job *job = next_ready(farm, working, NULL); job && !lease && !*full;
         job = next_ready(farm, working, job))
        if (may_serve(farm, job, worker))
            lease = grant_of_job(farm, job, worker, 1, now_ns, full);
    return lease;
}

static struct lease *grant_again(struct farm *farm, struct farm_worker *worker, uint64_t now_ns)
{
    const unsigned working = CANDIDATES_BIT(CANDIDATES_WORKING);
    struct lease *lease = NULL;

    for (struct job *job = next_ready(farm, working, NULL); job && !lease;
         job = next_ready(farm, working, job)) {
        if (!may_serve(farm, job, worker))
            continue;
        for (struct job_frame *frame = job->frames; frame && !lease; frame = frame->next)
            lease = grant_overdue(farm, frame, worker, now_ns);
    }
    return lease;
}

struct lease *scheduler_grant(struct farm *farm, struct farm_worker *worker, uint64_t now_ns)
{
    struct lease *lease = NULL;
    int full = 0, takes = worker->room > 0 && worker_takes_work(worker);

    if (takes) {
        (void)waiting_order(farm, now_ns); /* the lists follow it */
        lease = grant_wanted(farm, worker, now_ns, &full);
        if (!lease && !full)
            lease = grant_early(farm, worker, now_ns, &full);
        if (!lease && !full && worker->held.units < worker->credit.threads)
            lease = grant_again(farm, worker, now_ns);
    }
    workforce_set_hungry(farm, worker, takes && !lease && !full);
    return lease;
}

void scheduler_learn(struct farm *farm, struct farm_worker *worker, struct job *job, uint64_t samples, uint64_t cpu_ns,
                     uint64_t granted_ns, uint64_t now_ns)
{
    double cost = 0;

    rate_add(&worker->rate, samples, now_ns);
    worker->units_done++;
    worker->cpu_ns += cpu_ns;
    hangs_learn(&job->hangs, samples, cpu_ns);
    worker->delivered_job = job->id;
    if (job->suspicion.deaths > 0)
        farm_wake(farm); /* others may have its units again */
    suspicion_clear(&job->suspicion);
    refusals_settle(&job->refusals, worker->machine);
    worker->samples_done += samples;
    if (samples > 0 && cpu_ns > 0) {
        cost = (double)cpu_ns / (double)samples;
        /* The worker claims it: limit it to what a CPU can do. */
        cost = cost < 1 ? 1 : cost > 1e9 ? 1e9 : cost;
        if (worker->cost_job != job->id || worker->cost_ns <= 0)
            worker->cost_ns = cost;
        else
            worker->cost_ns += (cost - worker->cost_ns) / 8;
        worker->cost_job = job->id;
    }
    order_charge(&farm->order, job, cost * (double)samples / 1e9, farm->wall_s);
    credit_delivered(&worker->credit, worker->held.units, (uint64_t)(cost * (double)samples), now_ns);
    workforce_counts(farm, worker);
    if (granted_ns && now_ns > granted_ns) {
        uint64_t turnaround = now_ns - granted_ns;
        job->turnaround_ns =
            job->turnaround_ns ? job->turnaround_ns - job->turnaround_ns / 16 + turnaround / 16 : turnaround;
    }
}
