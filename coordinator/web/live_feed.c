/* Events: made when something changed, at most so often, and only what differs from the one before. */
#include <string.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
#include "common/film/unit.h"
#include "coordinator/web/api_farm.h"
#include "coordinator/web/json_wire.h"
#include "coordinator/web/live_parts.h"

enum {
    JOB_MS = 500,                /* a job's events are at least this far apart, */
    WORKERS_MS = 2000,           /* the workers', when one joined, left or was steered, */
    WORKERS_EACH_MS = 20,        /* and else so much later for each: their numbers always change */
    FARM_MS = 1000,              /* and the farm's */
    WAITING_EACH_TICK = 8,       /* active jobs whose reason to wait is looked at: it changes by what others do */
};

void feed_release(struct feed *feed)
{
    mem_free(feed->jobs);
    buffer_release(&feed->json);
}

void feed_begin(struct feed *feed)
{
    for (size_t i = 0; i < feed->count; i++)
        feed->jobs[i].hash = 0;
    feed->workers_hash = feed->farm_hash = 0;
    feed->workers_changed = 1;
}

/* The place of the job, or where it would be. */
static size_t place_of(const struct feed *feed, uint64_t id)
{
    size_t low = 0, high = feed->count;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (feed->jobs[middle].id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static struct feed_job *find(struct feed *feed, uint64_t id)
{
    size_t at = place_of(feed, id);

    if (at < feed->count && feed->jobs[at].id == id)
        return &feed->jobs[at];
    if (!MEM_GROW(feed->jobs, feed->capacity, feed->count + 1))
        return NULL;
    memmove(&feed->jobs[at + 1], &feed->jobs[at], (feed->count - at) * sizeof *feed->jobs);
    feed->jobs[at] = (struct feed_job){.id = id};
    feed->count++;
    return &feed->jobs[at];
}

void feed_job_changed(struct live *live, uint64_t job)
{
    struct feed_job *j = find(&live->feed, job);

    if (j)
        j->changed = 1;
    else
        events_skip(&live->events); /* no memory: listeners load everything again */
}

void feed_job_removed(struct live *live, uint64_t job)
{
    struct feed *feed = &live->feed;
    size_t at = place_of(feed, job);

    if (at < feed->count && feed->jobs[at].id == job) {
        feed->count--;
        memmove(&feed->jobs[at], &feed->jobs[at + 1], (feed->count - at) * sizeof *feed->jobs);
    }
    buffer_clear(&feed->json);
    buffer_puts(&feed->json, "{\"job\":");
    json_put_u64(&feed->json, job);
    buffer_puts(&feed->json, "}");
    if (buffer_ok(&feed->json))
        events_add(&live->events, "job-removed", feed->json.data, feed->json.size);
    else
        events_skip(&live->events);
}

void feed_job_event(struct live *live, const struct job_event *event)
{
    Azulejo__Wire__JobEvent message = AZULEJO__WIRE__JOB_EVENT__INIT;
    struct buffer *json = &live->feed.json;

    message.seq = event->seq;
    message.at = event->at;
    message.who = (char *)event->who;
    message.text = (char *)event->text;
    message.from_worker = event->from_worker;
    message.job = event->job;
    buffer_clear(json);
    json_wire_put(json, &message.base);
    if (buffer_ok(json))
        events_add(&live->events, "log", json->data, json->size);
    else
        events_skip(&live->events);
}

/* Make the event if it says something new. */
static void add_if_new(struct live *live, const char *name, uint64_t *hash)
{
    struct buffer *json = &live->feed.json;
    uint64_t now;

    if (!buffer_ok(json)) {
        buffer_release(json);
        events_skip(&live->events);
        return;
    }
    now = hash_bytes(json->data, json->size);
    if (now == *hash)
        return;
    *hash = now;
    events_add(&live->events, name, json->data, json->size);
}

static void make_job(struct live *live, struct job *job, struct feed_job *j, uint64_t now_ns)
{
    struct feed *feed = &live->feed;

    job_report_make(&feed->report, &live->server->farm, job, now_ns);
    buffer_clear(&feed->json);
    json_wire_put(&feed->json, &feed->report.message.base);
    j->made_ns = now_ns;
    j->changed = 0;
    add_if_new(live, "job", &j->hash);
}

/* Jobs with frames in work change with every result, without a word. */
static void look_at_samples(struct live *live)
{
    const struct farm *farm = &live->server->farm;
    uint32_t left = farm->open_frames;

    for (size_t i = 0; i < farm->queue.active_count && left > 0; i++) {
        const struct job *job = farm->queue.active[i];
        uint64_t samples = job->samples_done;
        struct feed_job *j;
        if (!job->frames)
            continue;
        for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
            samples += film_samples(frame->film);
            left -= left > 0;
        }
        j = find(&live->feed, job->id);
        if (j && j->samples != samples) {
            j->samples = samples;
            j->changed = 1;
        }
    }
}

/* What a waiting job waits for follows from what other jobs and workers do: look at some, in turn. */
static void look_at_waiting(struct live *live, uint64_t now_ns)
{
    const struct queue *queue = &live->server->farm.queue;
    struct feed *feed = &live->feed;

    for (int i = 0; i < WAITING_EACH_TICK && queue->active_count > 0; i++) {
        struct job *job = queue->active[feed->turn++ % queue->active_count];
        struct feed_job *j = job->leases == 0 ? find(feed, job->id) : NULL;
        if (j && now_ns - j->made_ns >= JOB_MS * NS_PER_MS)
            make_job(live, job, j, now_ns);
    }
}

static void make_jobs(struct live *live, uint64_t now_ns)
{
    struct feed *feed = &live->feed;

    for (size_t i = 0; i < feed->count; i++) {
        struct feed_job *j = &feed->jobs[i];
        struct job *job;
        if (!j->changed || (j->made_ns && now_ns - j->made_ns < JOB_MS * NS_PER_MS))
            continue;
        job = queue_find(&live->server->farm.queue, j->id);
        if (job)
            make_job(live, job, j, now_ns);
        else
            j->changed = 0;
    }
}

/* The same for GET /workers. */
static void make_workers(struct live *live, uint64_t now_ns)
{
    struct feed *feed = &live->feed;
    uint64_t rest_ms = WORKERS_MS + (feed->workers_changed ? 0 : WORKERS_EACH_MS * live->server->farm.worker_count);
    struct error err = {0};

    if (now_ns - feed->workers_ns < rest_ms * NS_PER_MS)
        return;
    feed->workers_ns = now_ns;
    feed->workers_changed = 0;
    buffer_clear(&feed->json);
    if (api_workers_json(live->server, &feed->json, &err) == STATUS_OK)
        add_if_new(live, "workers", &feed->workers_hash);
}

static void make_farm(struct live *live, uint64_t now_ns)
{
    struct feed *feed = &live->feed;
    struct error err = {0};

    if (now_ns - feed->farm_ns < FARM_MS * NS_PER_MS)
        return;
    feed->farm_ns = now_ns;
    buffer_clear(&feed->json);
    if (api_farm_json(live->server, &feed->json, &err) == STATUS_OK)
        add_if_new(live, "farm", &feed->farm_hash);
}

void feed_tick(struct live *live, uint64_t now_ns)
{
    struct feed *feed = &live->feed;

    if (now_ns - feed->samples_ns >= JOB_MS * NS_PER_MS) {
        feed->samples_ns = now_ns;
        look_at_samples(live);
    }
    make_jobs(live, now_ns);
    look_at_waiting(live, now_ns);
    make_workers(live, now_ns);
    make_farm(live, now_ns);
}
