#include "coordinator/job/queue.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

/* The diagram in queue.h. */
const struct job_edge job_edges[] = {
#define FROM_TO(from, to) {JOB_STATE_##from, JOB_STATE_##to}
    FROM_TO(QUEUED, RUNNING),       FROM_TO(QUEUED, PAUSED),        FROM_TO(QUEUED, PARKED),
    FROM_TO(QUEUED, FINISHING),     FROM_TO(QUEUED, CANCELLING),    FROM_TO(QUEUED, CANCELLED),
    FROM_TO(QUEUED, FAILED),
    FROM_TO(RUNNING, DONE),         FROM_TO(RUNNING, PAUSED),       FROM_TO(RUNNING, PARKED),
    FROM_TO(RUNNING, FINISHING),    FROM_TO(RUNNING, CANCELLING),   FROM_TO(RUNNING, CANCELLED),
    FROM_TO(RUNNING, FAILED),
    FROM_TO(PAUSED, QUEUED),        FROM_TO(PAUSED, FINISHING),     FROM_TO(PAUSED, CANCELLING),
    FROM_TO(PAUSED, CANCELLED),     FROM_TO(PAUSED, FAILED),
    FROM_TO(PARKED, QUEUED),        FROM_TO(PARKED, CANCELLING),    FROM_TO(PARKED, CANCELLED),
    FROM_TO(PARKED, FAILED),
    FROM_TO(FINISHING, DONE),       FROM_TO(FINISHING, PARKED),     FROM_TO(FINISHING, CANCELLING),
    FROM_TO(FINISHING, CANCELLED),  FROM_TO(FINISHING, FAILED),
    FROM_TO(CANCELLING, DONE),      FROM_TO(CANCELLING, CANCELLED), FROM_TO(CANCELLING, FAILED),
    FROM_TO(DONE, QUEUED),          FROM_TO(FAILED, QUEUED),        FROM_TO(CANCELLED, QUEUED),
#undef FROM_TO
};
const size_t job_edge_count = sizeof job_edges / sizeof job_edges[0];

void work_stats_add(struct work_stats *sum, const struct work_stats *more)
{
    sum->cpu_ns += more->cpu_ns;
    sum->trace_ns += more->trace_ns;
    sum->effects |= more->effects;
    for (int i = 0; i < STAGE_COUNT; i++)
        sum->stages[i] += more->stages[i];
    for (int i = 0; i < EFFECT_ACCOUNTS; i++)
        sum->accounts[i] += more->accounts[i];
}

void queue_init(struct queue *queue) { memset(queue, 0, sizeof *queue); }

void queue_release(struct queue *queue)
{
    for (size_t i = 0; i < queue->count; i++)
        job_free(queue->all[i]);
    mem_free(queue->all);
    mem_free(queue->active);
    candidates_release(&queue->candidates);
    queue_init(queue);
}

struct job *job_new(uint32_t first_frame, uint32_t last_frame)
{
    struct job *job = mem_calloc(1, sizeof *job);

    if (!job)
        return NULL;
    job->first_frame = job->begin_from = first_frame;
    job->last_frame = last_frame;
    job->frames_done = mem_calloc((size_t)job_frame_count(job) / 8 + 1, 1);
    job->frames_developed = mem_calloc((size_t)job_frame_count(job) / 8 + 1, 1);
    job->frames_resting = mem_calloc((size_t)job_frame_count(job) / 8 + 1, 1);
    if (!job->frames_done || !job->frames_developed || !job->frames_resting) {
        job_free(job);
        return NULL;
    }
    return job;
}

void job_free(struct job *job)
{
    if (!job)
        return;
    assert(!job->frames);
    mem_free(job->frames_done);
    mem_free(job->frames_developed);
    mem_free(job->frames_resting);
    mem_free(job->cuts);
    mem_free(job->closed);
    job_figures_release(&job->figures);
    buffer_release(&job->schedule);
    refusals_release(&job->refusals);
    mem_free(job);
}

/* Where `job` stands, or would stand, among the active ones. */
static size_t active_place(const struct queue *queue, const struct job *job)
{
    size_t low = 0, high = queue->active_count;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (job_is_before(queue->active[middle], job))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The caller has made sure that there is room. */
static void active_insert(struct queue *queue, struct job *job)
{
    size_t place = active_place(queue, job);

    memmove(queue->active + place + 1, queue->active + place, (queue->active_count - place) * sizeof *queue->active);
    queue->active[place] = job;
    queue->active_count++;
    queue->changes++;
    job->all_begun = 0;
    job->begin_from = job->first_frame;
    candidates_update(&queue->candidates, job, 1);
}

static void active_remove(struct queue *queue, struct job *job)
{
    size_t place = active_place(queue, job);

    assert(place < queue->active_count && queue->active[place] == job);
    candidates_remove(&queue->candidates, job);
    queue->active_count--;
    queue->changes++;
    memmove(queue->active + place, queue->active + place + 1, (queue->active_count - place) * sizeof *queue->active);
}

static status check_room(const struct queue *queue, struct error *err)
{
    if (queue->active_count < JOBS_ACTIVE_MAX)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT, "%d jobs are queued or running already; wait for some to end",
                     JOBS_ACTIVE_MAX);
}

status queue_add(struct queue *queue, struct job *job, struct error *err)
{
    size_t place = queue->count;

    if (queue->count >= JOBS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the coordinator keeps at most %d jobs", JOBS_MAX);
    if (!job_state_ended(job->state) && check_room(queue, err) != STATUS_OK)
        return STATUS_ERR_LIMIT;
    if (!MEM_GROW(queue->all, queue->capacity, queue->count + 1) ||
        !MEM_GROW(queue->active, queue->active_capacity, queue->active_count + 1) ||
        !candidates_reserve(&queue->candidates, queue->active_count + 1))
        return error_no_memory(err, "the queue");
    /* Ids are given in the store, perhaps by two threads: they arrive nearly in order. */
    for (; place > 0 && queue->all[place - 1]->id > job->id; place--)
        queue->all[place] = queue->all[place - 1];
    queue->all[place] = job;
    queue->count++;
    if (job_state_ended(job->state))
        return STATUS_OK;
    active_insert(queue, job);
    return STATUS_OK;
}

/* The place of the first job whose id is not smaller. */
static size_t all_place(const struct queue *queue, uint64_t id)
{
    size_t low = 0, high = queue->count;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (queue->all[middle]->id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

struct job *queue_find(const struct queue *queue, uint64_t id)
{
    size_t place = all_place(queue, id);

    return place < queue->count && queue->all[place]->id == id ? queue->all[place] : NULL;
}

void queue_remove(struct queue *queue, struct job *job)
{
    size_t place = all_place(queue, job->id);

    assert(job_state_ended(job->state) && queue->all[place] == job);
    queue->count--;
    memmove(queue->all + place, queue->all + place + 1, (queue->count - place) * sizeof *queue->all);
    job->removed = 1;
}

void queue_set_priority(struct queue *queue, struct job *job, int32_t priority)
{
    active_remove(queue, job);
    job->priority = priority;
    active_insert(queue, job);
}

void queue_frames_changed(struct queue *queue, struct job *job)
{
    job->all_begun = 0;
    candidates_update(&queue->candidates, job, !job->removed && !job_state_ended(job->state));
}

void queue_frame_closed(struct queue *queue, struct job *job, uint32_t frame)
{
    if (frame < job->begin_from)
        job->begin_from = frame;
    queue_frames_changed(queue, job);
}

void queue_all_begun(struct queue *queue, struct job *job)
{
    job->all_begun = 1;
    candidates_update(&queue->candidates, job, !job->removed && !job_state_ended(job->state));
}

struct job *queue_next(const struct queue *queue, unsigned lists, const struct job *after)
{
    return candidates_next(&queue->candidates, lists, after);
}

void queue_order_changed(struct queue *queue) { candidates_sort(&queue->candidates); }

static int change_is_allowed(enum job_state from, enum job_state to)
{
    for (size_t i = 0; i < job_edge_count; i++)
        if (job_edges[i].from == from && job_edges[i].to == to)
            return 1;
    return 0;
}

void job_set_state(struct queue *queue, struct job *job, enum job_state state, const char *text, uint64_t now_ns,
                   int64_t wall_s)
{
    assert(change_is_allowed(job->state, state) && !job_state_ended(job->state));
    queue->changes += job_state_is_open(job->state) != job_state_is_open(state);
    if (!job_state_is_open(state)) {
        if (job->active_since_ns)
            job->active_ns += now_ns - job->active_since_ns;
        job->active_since_ns = 0;
    }
    if (job_state_ended(state)) {
        active_remove(queue, job);
        job->finished_at = wall_s;
    }
    job->state = state;
    if (!job_state_ended(state))
        queue_frames_changed(queue, job);
    snprintf(job->state_text, sizeof job->state_text, "%s", text ? text : "");
}

void job_set_id(struct job *job, uint64_t id) { job->id = id; }

void job_set_submitted(struct job *job, int64_t wall_s) { job->submitted_at = wall_s; }

void job_fence(struct job *job, uint64_t epoch) { job->epoch_floor = epoch + 1; }

void job_set_rules(struct job *job, const struct stop_rules *rules, uint32_t spp)
{
    job->stop = *rules;
    job->settings.spp = spp;
}

void job_extend(struct job *job, const struct stop_rules *rules, uint32_t spp)
{
    job_set_rules(job, rules, spp);
    job->estimate = ESTIMATE_NONE;
    job->frames_resting_count = 0;
}

void job_continue(struct job *estimate, const struct job *submitted)
{
    job_extend(estimate, &submitted->stop, submitted->settings.spp);
    estimate->estimate = ESTIMATE_CONTINUED;
    estimate->output = submitted->output;
    estimate->priority = submitted->priority;
    estimate->needs = submitted->needs;
    estimate->submitted_at = submitted->submitted_at;
    memcpy(estimate->owner, submitted->owner, sizeof estimate->owner);
    memcpy(estimate->name, submitted->name, sizeof estimate->name);
    memcpy(estimate->token, submitted->token, sizeof estimate->token);
}

void job_mark(struct job *job, enum job_mark mark) { job->marks |= mark; }

void job_start_clock(struct job *job, uint64_t now_ns)
{
    if (!job->active_since_ns)
        job->active_since_ns = now_ns ? now_ns : 1;
}

void job_begun_before(struct job *job, uint32_t frame) { job->begin_from = frame; }

static int bit_is_set(const uint8_t *bits, uint32_t i) { return bits[i / 8] >> i % 8 & 1; }

static void bit_set(uint8_t *bits, uint32_t i) { bits[i / 8] |= (uint8_t)(1u << i % 8); }

/* Was it set? */
static int bit_clear(uint8_t *bits, uint32_t i)
{
    int was = bit_is_set(bits, i);

    bits[i / 8] &= (uint8_t) ~(1u << i % 8);
    return was;
}

uint32_t job_frame_count(const struct job *job) { return job->last_frame - job->first_frame + 1; }

int job_frame_is_done(const struct job *job, uint32_t frame)
{
    return bit_is_set(job->frames_done, frame - job->first_frame);
}

void job_frame_set_done(struct job *job, uint32_t frame)
{
    if (job_frame_is_done(job, frame))
        return;
    bit_set(job->frames_done, frame - job->first_frame);
    job_note_closed(job, frame, (struct closed_frame){0});
    job->frames_done_count++;
    job->samples_done += job_frame_samples(job);
}

status job_frame_set_cut(struct job *job, uint32_t frame, enum frame_end end, const struct film_coverage *coverage,
                         struct error *err)
{
    NEED(MEM_GROW(job->cuts, job->cut_capacity, job->cut_count + 1), err, "a frame that was cut short");
    job->cuts[job->cut_count++] = (struct cut_frame){frame, end, *coverage};
    job->samples_done -= job_frame_samples(job) - coverage->samples;
    return STATUS_OK;
}

int job_frame_is_cut(const struct job *job, uint32_t frame)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].frame == frame)
            return 1;
    return 0;
}

int job_frame_is_developed(const struct job *job, uint32_t frame)
{
    return bit_is_set(job->frames_developed, frame - job->first_frame);
}

void job_frame_set_developed(struct job *job, uint32_t frame)
{
    if (job_frame_is_developed(job, frame))
        return;
    bit_set(job->frames_developed, frame - job->first_frame);
    job->frames_developed_count++;
}

void job_frame_set_undeveloped(struct job *job, uint32_t frame)
{
    job->frames_developed_count -= (uint32_t)bit_clear(job->frames_developed, frame - job->first_frame);
}

void job_frame_rest(struct job *job, uint32_t frame)
{
    if (!job_frame_is_resting(job, frame))
        job->frames_resting_count++;
    bit_set(job->frames_resting, frame - job->first_frame);
}

void job_frame_wake(struct job *job, uint32_t frame)
{
    job->frames_resting_count -= (uint32_t)bit_clear(job->frames_resting, frame - job->first_frame);
}

int job_frame_is_resting(const struct job *job, uint32_t frame)
{
    return bit_is_set(job->frames_resting, frame - job->first_frame);
}

static void count_resting(struct job *job)
{
    job->frames_resting_count = 0;
    for (uint32_t i = 0; i < job_frame_count(job); i++)
        job->frames_resting_count += (uint32_t)bit_is_set(job->frames_resting, i);
}

uint8_t *job_resting_copy(const struct job *job)
{
    size_t bytes = job_frame_count(job) / 8 + 1;
    uint8_t *copy = mem_alloc(bytes);

    if (copy)
        memcpy(copy, job->frames_resting, bytes);
    return copy;
}

void job_resting_restore(struct job *job, const uint8_t *copy)
{
    memcpy(job->frames_resting, copy, job_frame_count(job) / 8 + 1);
    count_resting(job);
}

uint32_t job_frames_wanted(const struct job *job) { return job_frame_count(job) - job->frames_resting_count; }

static int is_early(const struct job *job) { return job->state == JOB_STATE_DONE && (job->marks & JOB_MARK_EARLY); }

int job_frame_is_left(const struct job *job, uint32_t frame)
{
    return job_frame_is_resting(job, frame) || (is_early(job) && !job_frame_is_done(job, frame));
}

uint32_t job_frames_left(const struct job *job)
{
    return is_early(job) ? job_frame_count(job) - job->frames_done_count : job->frames_resting_count;
}

/* Are the newest figures those of a frame that is not done? */
static int last_rests(const struct job *job)
{
    return job->figures.last.figures.known && !job_frame_is_done(job, job->first_frame + job->figures.last_frame);
}

void job_note_last(struct job *job, uint32_t frame, const struct history_point *point)
{
    uint32_t i = frame - job->first_frame;

    if (!point->figures.known || (last_rests(job) && job->figures.last_frame < i))
        return;
    job_figures_set_last(&job->figures, i, point);
}

void job_note_closed(struct job *job, uint32_t frame, struct closed_frame is)
{
    uint32_t i = frame - job->first_frame;
    struct closed_frame *was;

    if (is.samples == 0 && last_rests(job) && job->figures.last_frame == i)
        job_figures_set_last(&job->figures, 0, NULL); /* it is open, or begins again */
    if (!job->closed && is.samples > 0)               /* without memory the job only seems to have less */
        job->closed = mem_calloc(job_frame_count(job), sizeof *job->closed);
    if (!job->closed)
        return;
    was = &job->closed[i];
    job->closed_sum.samples += is.samples - was->samples;
    job->closed_sum.core_s += is.core_s - was->core_s;
    job->closed_sum.share += is.share - was->share;
    *was = is;
}

struct closed_frame job_closed_sum(const struct job *job)
{
    return job_state_ended(job->state) && job->state != JOB_STATE_FAILED ? (struct closed_frame){0} : job->closed_sum;
}

/* ---- a finished job goes on ------------------------------------------------------------------ */

static void choose_whole(struct job_reopening *r, const struct job *job, uint32_t new_spp)
{
    const struct render_settings *s = &job->settings;
    uint32_t tiles = tile_count(s->width, s->height);

    r->coverage = (struct film_coverage){.samples = job_frame_samples(job), .least = s->spp,
                                         .most = s->spp, .group_most = group_samples(s->spp, 0),
                                         .tiles = tiles};
    if (new_spp == s->spp)
        return;
    for (uint32_t i = 0; i < job_frame_count(job); i++)
        if (bit_is_set(job->frames_done, i) && !bit_is_set(r->chosen, i))
            bit_set(r->whole, i);
    for (size_t i = 0; i < job->cut_count; i++)
        bit_clear(r->whole, job->cuts[i].frame - job->first_frame);
}

/* The frame will have to be rendered before pictures can be made of it. */
static int is_missing(const struct job_reopening *r, const struct job *job, uint32_t i)
{
    return !bit_is_set(job->frames_done, i) || bit_is_set(r->chosen, i);
}

/* Done frames whose pictures are made of missing ones: of those before them that --temporal and --denoise-around ask for,
 * of those after them that --denoise-around does. */
static void choose_remade(struct job_reopening *r, const struct job *job)
{
    const uint32_t count = job_frame_count(job), after = tonemap_around(&job->output.tonemap);
    const uint32_t temporal = job->output.tonemap.temporal, before = temporal > after + 1 ? temporal - 1 : after;
    uint32_t since = before + 1, until = after + 1; /* frames from the last missing one, to the next */

    for (uint32_t i = 0; i < count; i++) {
        since = is_missing(r, job, i) ? 0 : since <= before ? since + 1 : since;
        if (since > 0 && since <= before)
            bit_set(r->remade, i);
    }
    for (uint32_t i = count; i-- > 0;) {
        until = is_missing(r, job, i) ? 0 : until <= after ? until + 1 : until;
        if (until > 0 && until <= after)
            bit_set(r->remade, i);
    }
}

status job_reopening_of(struct job_reopening *r, const struct job *job, const uint32_t *frames, size_t count,
                        uint32_t new_spp, struct error *err)
{
    size_t bytes = job_frame_count(job) / 8 + 1;

    *r = (struct job_reopening){0};
    for (size_t i = 0; i < count; i++)
        if (frames[i] < job->first_frame || frames[i] > job->last_frame)
            return error_set(err, STATUS_ERR_INPUT, "job %llu has frames %u to %u, not %u", (unsigned long long)job->id,
                             job->first_frame, job->last_frame, frames[i]);
    r->chosen = mem_calloc(bytes, 1);
    r->whole = mem_calloc(bytes, 1);
    r->remade = mem_calloc(bytes, 1);
    if (!r->chosen || !r->whole || !r->remade) {
        job_reopening_release(r);
        return error_no_memory(err, "frames that go on");
    }
    for (size_t i = 0; i < count; i++)
        bit_set(r->chosen, frames[i] - job->first_frame);
    choose_whole(r, job, new_spp);
    choose_remade(r, job);
    return STATUS_OK;
}

status job_reopening_init(struct job_reopening *r, const struct job *job, const uint32_t *frames, size_t count,
                          uint32_t new_spp, struct error *err)
{
    *r = (struct job_reopening){0};
    return count == 0 ? STATUS_OK : job_reopening_of(r, job, frames, count, new_spp, err);
}

void job_reopening_release(struct job_reopening *r)
{
    mem_free(r->chosen);
    mem_free(r->whole);
    mem_free(r->remade);
    *r = (struct job_reopening){0};
}

int job_reopening_has(const struct job_reopening *r, const struct job *job, uint32_t frame)
{
    return !r->chosen || bit_is_set(r->chosen, frame - job->first_frame);
}

int job_reopening_is_whole(const struct job_reopening *r, const struct job *job, uint32_t frame)
{
    return r->whole && bit_is_set(r->whole, frame - job->first_frame);
}

int job_reopening_remakes(const struct job_reopening *r, const struct job *job, uint32_t frame)
{
    return r->remade && bit_is_set(r->remade, frame - job->first_frame);
}

status job_reopen_check(struct queue *queue, struct job *job, struct error *err)
{
    if (check_room(queue, err) != STATUS_OK)
        return STATUS_ERR_LIMIT;
    return MEM_GROW(queue->active, queue->active_capacity, queue->active_count + 1) &&
                   candidates_reserve(&queue->candidates, queue->active_count + 1) &&
                   MEM_GROW(job->cuts, job->cut_capacity, job_frame_count(job))
               ? STATUS_OK
               : error_no_memory(err, "the queue");
}

static void reopen_cuts(struct job *job, const struct job_reopening *r)
{
    size_t kept = 0;

    for (size_t i = 0; i < job->cut_count; i++)
        if (!job_reopening_has(r, job, job->cuts[i].frame))
            job->cuts[kept++] = job->cuts[i];
    job->cut_count = kept;
    for (uint32_t i = 0; r->whole && i < job_frame_count(job); i++)
        if (bit_is_set(r->whole, i))
            job->cuts[job->cut_count++] = (struct cut_frame){job->first_frame + i, FRAME_END_CAP, r->coverage};
}

static void reopen_frames(struct job *job, const struct job_reopening *r)
{
    for (uint32_t i = 0; i < job_frame_count(job); i++) {
        if (!job_reopening_has(r, job, job->first_frame + i))
            continue;
        job->frames_done_count -= (uint32_t)bit_clear(job->frames_done, i);
        job->frames_developed_count -= (uint32_t)bit_clear(job->frames_developed, i);
        bit_clear(job->frames_resting, i);
    }
    for (uint32_t i = 0; i < job_frame_count(job); i++)
        if (job_reopening_remakes(r, job, job->first_frame + i))
            job_frame_set_undeveloped(job, job->first_frame + i);
    count_resting(job);
    reopen_cuts(job, r);
    job->samples_done = job->frames_done_count * job_frame_samples(job);
    for (size_t i = 0; i < job->cut_count; i++)
        job->samples_done -= job_frame_samples(job) - job->cuts[i].coverage.samples;
    memset(&job->work, 0, sizeof job->work); /* the films or the store have it */
    job_figures_release(&job->figures);
}

void job_reopen_frames(struct queue *queue, struct job *job, const struct job_reopening *r)
{
    assert(!job_state_ended(job->state));
    reopen_frames(job, r);
    job->begin_from = job->first_frame;
    queue_frames_changed(queue, job);
}

void job_reopen(struct queue *queue, struct job *job, const struct job_reopening *r)
{
    assert(change_is_allowed(job->state, JOB_STATE_QUEUED) && job_state_ended(job->state));
    reopen_frames(job, r);
    job->finished_at = 0;
    job->marks = 0;
    job->state = JOB_STATE_QUEUED;
    job->state_text[0] = 0;
    memset(&job->place, 0, sizeof job->place); /* it has not waited yet */
    active_insert(queue, job);
}

void job_revise(struct job *job, const struct output_settings *output)
{
    job->output = *output;
    job->revision++;
    job->frames_developed_count = 0;
    memset(job->frames_developed, 0, job_frame_count(job) / 8 + 1);
    memset(&job->pictures, 0, sizeof job->pictures);
}

uint32_t job_window_begin(const struct job *job, uint32_t frame)
{
    uint32_t before = job->output.tonemap.temporal > 1 ? job->output.tonemap.temporal - 1 : 0;

    return frame - job->first_frame < before ? job->first_frame : frame - before;
}

/* The frame will be done if nothing happens. */
static int is_to_come(const struct job *job, uint32_t frame)
{
    const int closes = job->state == JOB_STATE_CANCELLING || job->state == JOB_STATE_FINISHING;

    return !job_frame_is_done(job, frame) && !job_frame_is_resting(job, frame) && !job_state_ended(job->state) &&
           (!closes || job->frames);
}

/* Those around the frame that its picture is made of, too, are done, as far as they will be. */
static int around_is_there(const struct job *job, uint32_t frame)
{
    const uint64_t around = tonemap_around(&job->output.tonemap);
    uint64_t at = frame - job->first_frame < around ? job->first_frame : frame - around;

    for (; around > 0 && at <= frame + around && at <= job->last_frame; at++)
        if (is_to_come(job, (uint32_t)at))
            return 0;
    return 1;
}

uint32_t job_frames_around(const struct job *job, uint32_t frame, uint32_t out[JOB_AROUND_MAX])
{
    const int64_t around = tonemap_around(&job->output.tonemap);
    uint32_t count = 0;

    for (int64_t d = -around; d <= around; d++) {
        const int64_t at = (int64_t)frame + d;
        if (d != 0 && at >= job->first_frame && at <= job->last_frame && job_frame_is_done(job, (uint32_t)at))
            out[count++] = (uint32_t)at;
    }
    return count;
}

int job_film_is_spent(const struct job *job, uint32_t frame)
{
    const int64_t around = tonemap_around(&job->output.tonemap);

    for (int64_t at = (int64_t)frame - around; at <= (int64_t)frame + around; at++)
        if (at >= job->first_frame && at <= job->last_frame &&
            (is_to_come(job, (uint32_t)at) ||
             (job_frame_is_done(job, (uint32_t)at) && !job_frame_is_developed(job, (uint32_t)at))))
            return 0;
    return 1;
}

int job_frame_to_develop(const struct job *job, uint32_t *frame)
{
    uint32_t run = 0; /* frames before this one that are done, one after another */

    if (job->frames_developed_count == job->frames_done_count)
        return 0;
    for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
        *frame = (uint32_t)at;
        run = job_frame_is_done(job, *frame) ? run + 1 : 0;
        if (run > *frame - job_window_begin(job, *frame) && !job_frame_is_developed(job, *frame) &&
            around_is_there(job, *frame))
            return 1;
    }
    return 0;
}

uint64_t job_frame_samples(const struct job *job)
{
    return (uint64_t)job->settings.width * job->settings.height * job->settings.spp;
}

double job_active_seconds(const struct job *job, uint64_t now_ns)
{
    uint64_t ns = job->active_ns;

    if (job->active_since_ns && now_ns > job->active_since_ns)
        ns += now_ns - job->active_since_ns;
    return (double)ns / 1e9;
}
