#include "coordinator/farm/merge.h"

#include <math.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/scheduler.h"

enum { SAMPLE_COUNTS_MAX = 1 << 20 }; /* rays or vertices of one sample */

/* ---- taking a result ------------------------------------------------------------------------ */

static void tell_others(void *user, uint32_t session, uint64_t lease)
{
    const struct farm *farm = user;

    farm->events.revoke(farm->events.user, session, lease, "another worker was faster");
}

static void report_conflict(struct farm *farm, const struct job_frame *frame, const struct delivery *result,
                            const struct farm_worker *worker)
{
    struct job *job = frame->job;
    struct unit_name u = result->unit.name;
    char first[DELIVERER_TEXT_MAX];

    farm->conflicts++;
    job->conflicts++;
    farm_deliverer_text(farm, film_deliverer(frame->film, u.tile, u.group, u.pass), first);
    log_error("job %llu, frame %u, tile %u, group %u, pass %u: session %u (%s, %s) sent a result that "
              "differs from the one merged before, which came from %s. One of the two machines computes wrong results: other workers decide which (an audit)",
              (unsigned long long)job->id, result->frame, u.tile, u.group, u.pass,
              worker->held.session, worker->name, worker->ray_tracer, first);
    farm->events.job_changed(farm->events.user, job);
}

static int is_amount(double x) { return (isfinite(x) && x >= 0) || !SAFEGUARD(FINITE_AMOUNT); }

/* The count is one that the unit can have, and the example one of its samples. */
static int health_fits(const struct job_frame *frame, const struct delivery *result, uint64_t samples,
                       enum health_kind kind)
{
    const struct render_settings *settings = &frame->job->settings;
    const struct health *h = &result->unit.work.health;
    const struct unit_name *u = &result->unit.name;
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, u->tile);
    struct health_place p;
    uint32_t begin, end;

    if (h->count[kind] == 0)
        return 1;
    switch (health_rows[kind].limit) {
    case HEALTH_LIMIT_SAMPLES:
        if (h->count[kind] > samples)
            return 0;
        break;
    case HEALTH_LIMIT_VALUES:
        if (h->count[kind] > result->unit.count)
            return 0;
        break;
    case HEALTH_LIMIT_STEPS:
        if (h->count[kind] > samples * SAMPLE_COUNTS_MAX)
            return 0;
        break;
    }
    pass_range(settings->spp, u->group, u->pass, &begin, &end);
    return health_place_of(h->first[kind], &p) && h->frame[kind] == 0 && p.pass == u->pass && p.tile == u->tile &&
           p.pixel < rect.width * rect.height && p.sample % GROUPS == u->group && p.sample / GROUPS >= begin &&
           p.sample / GROUPS < end;
}

enum { LIMIT_SAMPLES = 1, LIMIT_STEPS = SAMPLE_COUNTS_MAX };
static const struct {
    const char *name;
    uint64_t most; /* a sample */
} counters[] = {
#define COUNTER(name, limit, attribute) {#name, LIMIT_##limit},
    WORK_COUNTERS(COUNTER)};

/* Impossible counts would overflow the film's. */
static status check_work(const struct job_frame *frame, const struct delivery *result, struct error *err)
{
    const struct unit_work *w = &result->unit.work;
    uint64_t samples = job_frame_unit_samples(frame, result->unit.name);

    if (!is_amount(w->clamped_luminance) || !is_amount(w->kept_luminance))
        return error_set(err, STATUS_ERR_PROTOCOL, "tile %u, group %u, pass %u: a luminance of %g clamped and %g kept",
                         result->unit.tile, result->unit.group, result->unit.pass, w->clamped_luminance,
                         w->kept_luminance);
    if (!depth_light_is_valid(&w->depth))
        return error_set(err, STATUS_ERR_PROTOCOL,
                         "tile %u, group %u, pass %u: a sum of light by depth is negative or not finite",
                         result->unit.tile, result->unit.group, result->unit.pass);
    for (int k = 0; k < HEALTH_KINDS; k++)
        if (!health_fits(frame, result, samples, (enum health_kind)k))
            return error_set(err, STATUS_ERR_PROTOCOL,
                             "tile %u, group %u, pass %u: %llu times %s of %llu samples, first at %llu",
                             result->unit.tile, result->unit.group, result->unit.pass,
                             (unsigned long long)w->health.count[k], health_rows[k].name, (unsigned long long)samples,
                             (unsigned long long)w->health.first[k]);
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        if (w->count[i] > samples * counters[i].most || (i == WORK_samples && w->samples != samples))
            return error_set(err, STATUS_ERR_PROTOCOL, "a result with %llu %s for %llu samples",
                             (unsigned long long)w->count[i], counters[i].name, (unsigned long long)samples);
    return STATUS_OK;
}

/* Sums of radiance are negative only where samples were, which the result counts, or with dispersion, whose single
 * wavelengths have colours with negative parts. */
static status check_radiance(const struct job_frame *frame, const struct delivery *result, struct error *err)
{
    const struct render_settings *settings = &frame->job->settings;
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, result->unit.tile);
    size_t count = (size_t)rect.width * rect.height * PIXEL_FLOATS;

    if (result->unit.work.health.count[HEALTH_NEGATIVE_SAMPLES] > 0 || result->stats.effects & EFFECT_DISPERSION)
        return STATUS_OK;
    for (size_t i = 0; i < count && i < result->unit.count; i++)
        if (result->unit.sums[i] < 0)
            return error_set(err, STATUS_ERR_PROTOCOL,
                             "tile %u, group %u, pass %u: pixel %zu has a negative radiance, %g", result->unit.tile,
                             result->unit.group, result->unit.pass, i / PIXEL_FLOATS, (double)result->unit.sums[i]);
    return STATUS_OK;
}

/* The frame that the result is for; NULL with an outcome when it needs no merging. */
static struct job_frame *frame_of(struct farm *farm, const struct farm_worker *worker, const struct delivery *result,
                                  uint64_t now_ns, enum merge_outcome *outcome)
{
    struct job *job = queue_find(&farm->queue, result->job);
    struct job_frame *frame;

    *outcome = MERGE_UNWANTED;
    if (!job || result->epoch < job->epoch_floor || result->frame < job->first_frame || result->frame > job->last_frame)
        return NULL;
    if (job_frame_is_done(job, result->frame)) {
        if (!job_frame_is_cut(job, result->frame))
            *outcome = MERGE_KEPT;
        return NULL;
    }
    if (!job_state_is_open(job->state) || job_frame_is_resting(job, result->frame) || strcmp(job->ray_tracer, worker->ray_tracer) != 0)
        return NULL;
    frame = farm_frame_find(job, result->frame);
    if (!frame && job->state != JOB_STATE_FINISHING)
        frame = farm_frame_open(farm, job, result->frame, now_ns);
    if (!frame && (trouble_is(&farm->trouble) || trouble_is(&job->trouble)))
        *outcome = MERGE_DEFERRED;
    return frame;
}

/* A result of a lease that still runs: its holder alone can send it, of the units lent, and they took no longer than the lease is
 * old; one that has ended says nothing, as when its worker connected again. Its time counts in limits, prices and shares. */
static status check_lease(const struct farm *farm, const struct farm_worker *worker, struct delivery *result,
                          uint64_t now_ns, struct error *err)
{
    const struct lease *lease = lease_find(&farm->leases, result->lease, result->epoch);
    uint64_t age_ns = lease && now_ns > lease->granted_ns ? now_ns - lease->granted_ns : 0;
    uint64_t most_ns = age_ns + MERGE_CPU_SLACK_S * NS_PER_SECOND;

    if (lease && lease->holder != &worker->held)
        return error_set(err, STATUS_ERR_PROTOCOL, "a result of lease %llu, which another worker holds",
                         (unsigned long long)result->lease);
    if (lease && !lease_lent(lease, result->job, result->frame, result->unit.name))
        return error_set(err, STATUS_ERR_PROTOCOL, "tile %u, group %u, pass %u: not a unit of lease %llu",
                         result->unit.tile, result->unit.group, result->unit.pass, (unsigned long long)result->lease);
    if (lease && result->stats.cpu_ns > most_ns)
        return error_set(err, STATUS_ERR_PROTOCOL, "tile %u, group %u, pass %u: %.4g s of processor time under a lease that is %.3f s old",
                         result->unit.tile, result->unit.group, result->unit.pass, (double)result->stats.cpu_ns / 1e9,
                         (double)age_ns / 1e9);
    if (result->stats.cpu_ns > most_ns)
        result->stats.cpu_ns = most_ns;
    if (result->stats.trace_ns > result->stats.cpu_ns)
        result->stats.trace_ns = result->stats.cpu_ns;
    return STATUS_OK;
}

/* Fold the result into the frame's film. */
static status merge_into(struct job_frame *frame, const struct farm_worker *worker, const struct delivery *result,
                         enum film_merge_result *merged, struct error *err)
{
    struct unit_name u = result->unit.name;
    struct pending_ack ack = {result->lease, worker->held.session, u};
    size_t recorded = frame->journal.size;
    status s;

    s = check_work(frame, result, err);
    /* Reserve the acknowledgement first: once merged, a result must not be lost. */
    THEN(s, job_frame_await_ack(frame, ack, err));
    if (s != STATUS_OK)
        return s;
    frame->ack_count--;
    TRY(check_radiance(frame, result, err));
    s = film_merge(frame->film, &result->unit, worker->deliverer.number, merged, err);
    if (s == STATUS_OK && (*merged == FILM_MERGED || *merged == FILM_WAITING))
        film_note_cost(frame->film, u.tile, u.group, u.pass, result->times.thread, result->stats.cpu_ns);
    if (frame->journal.size > recorded)
        film_record_cost(&frame->journal, recorded, frame->film); /* those that waited for it have theirs */
    if (s == STATUS_ERR_INPUT) {
        s = STATUS_ERR_PROTOCOL;
        if (err)
            err->code = s;
    }
    return s;
}

/* The unit's time on its worker, and that of its merging, which ends now. */
static void trace_unit(struct farm *farm, const struct farm_worker *worker, const struct delivery *result, int repeated,
                       uint64_t now_ns)
{
    struct trace_event event = {.kind = TRACE_UNIT, .group = (uint8_t)result->unit.group,
                                .repeated = (uint8_t)repeated, .pass = (uint16_t)result->unit.pass,
                                .frame = result->frame, .tile = result->unit.tile,
                                .deliverer = worker->deliverer.number,
                                .cpu_ns = result->stats.cpu_ns, .then_begin_ns = now_ns,
                                .then_end_ns = clock_monotonic_ns()};

    trace_add_unit(&farm->trace, result->job, &event, &result->times);
}

static void count_result(struct farm_counts *counts, const struct delivery *result, uint64_t now_ns)
{
    counts->results++;
    counts->samples += result->unit.work.samples;
    counts->rays += result->unit.work.rays;
    counts->cpu_ns += result->stats.cpu_ns;
    for (int k = 0; k < HEALTH_KINDS; k++)
        counts->health[k] += result->unit.work.health.count[k];
    rate_add(&counts->result_rate, 1, now_ns);
    rate_add(&counts->sample_rate, result->unit.work.samples, now_ns);
}

status merge_result(struct farm *farm, struct farm_worker *worker, struct delivery *result, uint64_t now_ns,
                    enum merge_outcome *outcome, struct merge_conflict *conflict, struct error *err)
{
    struct unit_name name = result->unit.name;
    struct pending_ack ack = {result->lease, worker->held.session, name};
    enum film_merge_result merged;
    const struct unit *unit;
    struct job_frame *frame;
    struct lease *lease;
    uint64_t granted_ns = 0;
    status s;

    if (result->epoch > farm->leases.epoch || result->epoch == 0)
        return error_set(err, STATUS_ERR_PROTOCOL, "a result of lease %llu, epoch %llu, which was never granted",
                         (unsigned long long)result->lease, (unsigned long long)result->epoch);
    frame = frame_of(farm, worker, result, now_ns, outcome);
    if (!frame)
        return STATUS_OK;
    if (result->epoch == farm->leases.epoch && result->lease > farm->leases.last_id) {
        *outcome = MERGE_IMPOSSIBLE;
        return error_set(err, STATUS_ERR_PROTOCOL, "a result of lease %llu, which was never granted",
                         (unsigned long long)result->lease);
    }
    *outcome = MERGE_IMPOSSIBLE;
    if (!job_frame_has_unit(frame, name))
        return error_set(err, STATUS_ERR_PROTOCOL, "job %llu, frame %u, tile %u, group %u, pass %u: there is none",
                         (unsigned long long)result->job, result->frame, name.tile, name.group, name.pass);
    s = check_lease(farm, worker, result, now_ns, err);
    if (s != STATUS_OK) {
        error_prefix(err, "job %llu, frame %u", (unsigned long long)result->job, result->frame);
        return s;
    }
    if (frame->end != FRAME_END_NONE && !film_has(frame->film, name.tile, name.group, name.pass)) {
        *outcome = MERGE_UNWANTED;
        return STATUS_OK;
    }
    farm_deliverer_begin(farm, worker);
    s = merge_into(frame, worker, result, &merged, err);
    if (s != STATUS_OK && s != STATUS_ERR_PROTOCOL)
        *outcome = MERGE_PENDING;
    if (s == STATUS_ERR_PROTOCOL)
        error_prefix(err, "job %llu, frame %u", (unsigned long long)result->job, result->frame);
    if (s != STATUS_OK)
        return s;

    lease = lease_find(&farm->leases, result->lease, result->epoch);
    if (lease && lease->holder == &worker->held)
        lease_renew(&farm->leases, lease, now_ns);
    unit = job_frame_unit_find(frame, name);
    if (unit && unit->holder_count == 1)
        granted_ns = unit->granted_ns;
    if (merged == FILM_CONFLICT) {
        report_conflict(farm, frame, result, worker);
        if (conflict)
            *conflict = (struct merge_conflict){1, film_deliverer(frame->film, name.tile, name.group, name.pass),
                                                film_unit_hash(frame->film, name.tile, name.group, name.pass)};
    }
    if (merged == FILM_MERGED || merged == FILM_WAITING) {
        lease_settle_unit(&farm->leases, frame, name, worker->held.session, tell_others, farm);
        count_result(&farm->counts, result, now_ns);
        work_stats_add(&frame->job->stats, &result->stats);
        work_stats_add(&frame->stats, &result->stats);
        rate_add(&frame->job->rate, result->unit.work.samples, now_ns);
        hangs_settle(&frame->job->hangs, (struct hang_unit){.frame = frame->number, .tile = name.tile,
                                                            .group = name.group, .pass = name.pass});
        figures_learn(frame, name.tile, result->unit.work.samples, result->stats.cpu_ns, now_ns);
        scheduler_learn(farm, worker, frame->job, result->unit.work.samples, result->stats.cpu_ns, granted_ns, now_ns);
        workforce_due(farm, worker);
        if (farm->workforce.hungry > 0 && job_frame_unleased(frame) > 0)
            farm_wake(farm);
    } else {
        farm->counts.repeats++;
    }
    trace_unit(farm, worker, result, merged != FILM_MERGED && merged != FILM_WAITING, now_ns);
    if (merged == FILM_MERGED && !job_frame_is_watched(frame, name))
        job_frame_mark_dirty(frame, name.tile, now_ns);
    if (merged == FILM_MERGED && name.pass == 0)
        freeze_step(farm, frame, now_ns);
    if (job_frame_is_settled(frame, name)) {
        *outcome = MERGE_KEPT;
    } else {
        *outcome = MERGE_PENDING;
        frame->acks[frame->ack_count++] = ack;
    }
    if (merged == FILM_MERGED)
        farm_frame_decide(farm, frame, now_ns);
    if (frame->state == FRAME_RENDERING)
        farm_frame_advance(farm, frame, now_ns);
    return STATUS_OK;
}

/* ---- onto the disk -------------------------------------------------------------------------- */

/* Only jobs with open frames have something to write. */
static struct job *next_in_work(const struct farm *farm, const struct job *after)
{
    return queue_next(&farm->queue, CANDIDATES_BIT(CANDIDATES_WORKING), after);
}

uint64_t merge_delay_ns(uint64_t sync_ns)
{
    uint64_t least = COMMIT_DELAY_MIN_MS * NS_PER_MS, most = COMMIT_DELAY_MAX_MS * NS_PER_MS;

    if (sync_ns > most / COMMIT_DELAY_SYNCS)
        return most;
    return COMMIT_DELAY_SYNCS * sync_ns < least ? least : COMMIT_DELAY_SYNCS * sync_ns;
}

/* When a frame's dirty tiles are due. A young frame waits a quarter of its age at most: what a crash makes
 * workers send again is a small part of it. */
static uint64_t frame_due_ns(const struct job_frame *f, uint64_t delay_ns)
{
    uint64_t share_ns = f->dirty_since_ns > f->begun_ns ? (f->dirty_since_ns - f->begun_ns) / COMMIT_DELAY_AGES : 0;

    if (f->state == FRAME_COMPLETE || f->leaving)
        return f->dirty_since_ns;
    if (share_ns < COMMIT_DELAY_YOUNG_MS * NS_PER_MS)
        share_ns = COMMIT_DELAY_YOUNG_MS * NS_PER_MS;
    return f->dirty_since_ns + (delay_ns < share_ns ? delay_ns : share_ns);
}

int merge_is_dirty(const struct farm *farm, uint64_t *due_ns, uint32_t *tiles)
{
    const uint64_t delay_ns = merge_delay_ns(farm->sync_ns);

    *due_ns = UINT64_MAX;
    *tiles = 0;
    if (trouble_is(&farm->trouble))
        return 0;
    for (const struct job *job = next_in_work(farm, NULL); job; job = next_in_work(farm, job)) {
        for (const struct job_frame *f = job->frames; f; f = f->next) {
            uint64_t frame_ns = trouble_is(&f->trouble) ? f->trouble.next_ns : frame_due_ns(f, delay_ns);
            if (f->dirty_count == 0)
                continue;
            if (!trouble_is(&f->trouble))
                *tiles += f->dirty_count;
            if (frame_ns < *due_ns)
                *due_ns = frame_ns;
        }
    }
    return *due_ns != UINT64_MAX;
}

static void commit_free(struct commit *commit)
{
    if (!commit)
        return;
    for (uint32_t i = 0; i < commit->part_count; i++) {
        buffer_release(&commit->parts[i].film.units);
        buffer_release(&commit->parts[i].film.states);
    }
    mem_free(commit->items);
    mem_free(commit->parts);
    mem_free(commit);
}

/* The states that the film's file asks for. Without memory for one, it asks again. */
static void take_stale(struct commit_part *part)
{
    struct job_frame *frame = part->frame;

    part->film.stale = frame->stale;
    for (uint32_t i = 0; i < part->film.stale.count; i++)
        if (film_tile_samples(frame->film, part->film.stale.first + i) > 0 &&
            !film_record_state(&part->film.states, frame->film, part->film.stale.first + i))
            part->film.stale.count = i;
}

/* Take what is dirty of a frame: its journal, and the states of up to `room` tiles of which the journal has not all. The
 * rest stays dirty. */
static void commit_take(struct commit *commit, struct job_frame *frame, uint32_t *room)
{
    struct commit_part *part = &commit->parts[commit->part_count];
    uint32_t left = 0;

    *part = (struct commit_part){.frame = frame, .first = commit->count, .film.units = frame->journal};
    buffer_init(&frame->journal);
    for (uint32_t i = 0; i < frame->dirty_count; i++) {
        uint32_t tile = frame->dirty[i];
        struct commit_item *item = &commit->items[commit->count];
        if (frame->dirty_mark[tile] & FRAME_TILE_WHOLE &&
            (*room == 0 || !film_record_state(&part->film.states, frame->film, tile))) {
            frame->dirty[left++] = tile;
            continue;
        }
        *room -= frame->dirty_mark[tile] & FRAME_TILE_WHOLE ? 1 : 0;
        frame->dirty_mark[tile] = 0;
        *item = (struct commit_item){.frame = frame, .tile = tile};
        for (uint32_t g = 0; g < GROUPS; g++)
            item->passes[g] = film_tile_passes(frame->film, tile, g);
        commit->count++;
        part->count++;
    }
    frame->dirty_count = left;
    take_stale(part);
    commit->part_count++;
    frame->in_flight++;
}

static int takes_part(const struct job_frame *frame, uint64_t now_ns)
{
    return frame->dirty_count > 0 && !trouble_waits(&frame->trouble, now_ns);
}

struct commit *merge_commit_begin(struct farm *farm, uint64_t now_ns)
{
    struct commit *commit;
    uint32_t count = 0, parts = 0, room = COMMIT_STATES_MAX;

    if (trouble_is(&farm->trouble) && now_ns != UINT64_MAX)
        return NULL;
    for (const struct job *job = next_in_work(farm, NULL); job; job = next_in_work(farm, job)) {
        for (const struct job_frame *f = job->frames; f; f = f->next) {
            parts += (uint32_t)takes_part(f, now_ns);
            count += takes_part(f, now_ns) ? f->dirty_count : 0;
        }
    }
    if (count == 0)
        return NULL;
    commit = mem_calloc(1, sizeof *commit);
    if (!commit)
        return NULL;
    commit->store = farm->store;
    commit->items = mem_alloc_array(count, sizeof *commit->items);
    commit->parts = mem_calloc(parts, sizeof *commit->parts);
    if (!commit->items || !commit->parts) {
        commit_free(commit);
        return NULL;
    }
    for (const struct job *job = next_in_work(farm, NULL); job; job = next_in_work(farm, job))
        for (struct job_frame *f = job->frames; f; f = f->next)
            if (takes_part(f, now_ns))
                commit_take(commit, f, &room);
    return commit;
}

static void part_run(struct commit *commit, struct commit_part *part)
{
    struct film_file *file = part->frame->file;

    if (!file)
        return;
    part->begun_ns = clock_monotonic_ns();
    part->result = film_file_commit(file, &part->film, &part->error);
    part->ended_ns = clock_monotonic_ns();
    part->written_ns = part->film.written_ns ? part->film.written_ns : part->ended_ns;
    if (part->ended_ns - part->written_ns > commit->sync_ns)
        commit->sync_ns = part->ended_ns - part->written_ns;
}

void merge_commit_run(struct commit *commit)
{
    /* The ray tracer that a job is pinned to is on disk before any of its results. */
    if (commit->store)
        commit->result = store_await_saves(commit->store, &commit->error);
    for (uint32_t i = 0; i < commit->part_count; i++) {
        struct commit_part *part = &commit->parts[i];
        part->result = commit->result;
        part->error = commit->error;
    }
    if (commit->result != STATUS_OK)
        return;
    for (uint32_t i = 0; i < commit->part_count; i++) {
        struct commit_part *part = &commit->parts[i];
        part_run(commit, part);
        if (part->result == STATUS_OK || commit->result != STATUS_OK)
            continue;
        commit->result = part->result;
        commit->error = part->error;
    }
}

static void item_is_durable(const struct commit_item *item)
{
    memcpy(item->frame->durable[item->tile], item->passes, sizeof item->passes);
}

static void mark_whole(struct job_frame *frame, uint32_t tile, uint64_t now_ns)
{
    frame->dirty_mark[tile] |= FRAME_TILE_WHOLE;
    job_frame_mark_dirty(frame, tile, now_ns);
}

/* The frame's tiles did not reach the disk: they are dirty again, as a whole, so that no journal has to be kept. Meanwhile each
 * worker keeps its unacknowledged results. */
static void part_failed(struct farm *farm, const struct commit *commit, const struct commit_part *part, uint64_t now_ns)
{
    for (uint32_t i = part->first; i < part->first + part->count; i++)
        mark_whole(part->frame, commit->items[i].tile, now_ns);
    farm_trouble(farm, part->frame->job, part->frame->number, &part->frame->trouble, "cannot be written", &part->error,
                 now_ns);
}

static void part_end(struct farm *farm, const struct commit *commit, const struct commit_part *part, uint64_t now_ns)
{
    struct job_frame *frame = part->frame;

    if (frame->closing)
        return;
    if (part->result != STATUS_OK) {
        part_failed(farm, commit, part, now_ns);
        return;
    }
    for (uint32_t i = part->first; i < part->first + part->count; i++)
        item_is_durable(&commit->items[i]);
    frame->stale = part->film.stale;
    farm_trouble_over(farm, frame->job, &frame->trouble, now_ns);
    farm_frame_send_acks(farm, frame);
    farm_frame_advance(farm, frame, now_ns);
}

static void trace_part(struct farm *farm, const struct commit_part *part)
{
    struct trace_event event = {.kind = TRACE_COMMIT, .frame = part->frame->number, .tile = part->count,
                                .begin_ns = part->begun_ns, .end_ns = part->written_ns,
                                .then_begin_ns = part->written_ns, .then_end_ns = part->ended_ns};

    if (part->begun_ns)
        trace_add(&farm->trace, part->frame->job->id, &event);
}

static void count_syncs(struct farm_counts *counts, const struct commit *commit)
{
    for (uint32_t i = 0; i < commit->part_count; i++) {
        const struct commit_part *part = &commit->parts[i];
        if (part->result != STATUS_OK)
            counts->sync_failures++;
        else if (part->ended_ns)
            histogram_add(&counts->syncs, part->ended_ns - part->written_ns);
    }
}

void merge_commit_end(struct farm *farm, struct commit *commit, uint64_t now_ns)
{
    farm->sync_ns = commit->sync_ns;
    count_syncs(&farm->counts, commit);
    for (uint32_t i = 0; i < commit->part_count; i++) {
        trace_part(farm, &commit->parts[i]);
        part_end(farm, commit, &commit->parts[i], now_ns);
        farm_frame_unpin(farm, commit->parts[i].frame);
    }
    commit_free(commit);
}

void merge_commit_abandon(struct farm *farm, struct commit *commit)
{
    for (uint32_t i = 0; i < commit->part_count; i++)
        farm_frame_unpin(farm, commit->parts[i].frame);
    commit_free(commit);
}
