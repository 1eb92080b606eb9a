#include "coordinator/page/feed.h"

#include <stddef.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/film/unit.h"
#include "coordinator/steering/report.h"
#include "coordinator/net/base/farm_info.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/workers_list.h"
#include "protocol/message.h"

enum {
    JOB_MS = 500,                /* a job's events are at least this far apart, */
    WORKERS_MS = 2000,           /* the workers', when one joined, left or was steered, */
    WORKERS_EACH_MS = 20,        /* and else so much later for each: their numbers always change */
    FARM_MS = 1000,              /* and the farm's */
    WAITING_EACH_TICK = 8,       /* active jobs whose reason to wait is looked at: it changes by what others do */
};

struct feed_job {
    uint64_t id, made_ns;
    uint64_t hash;    /* of what was sent last; 0: send it whatever it is */
    uint64_t samples; /* that it had then */
    int changed;
};

struct feed {
    struct server *server;
    uint32_t session;      /* that listens; 0: none */
    struct feed_job *jobs; /* ascending ids */
    size_t count, capacity;
    size_t turn; /* the active job whose waiting is looked at next */
    uint64_t samples_ns, workers_ns, farm_ns, workers_hash, farm_hash;
    int workers_changed;
    struct buffer packed;
    struct job_report report;
};

status feed_new(struct feed **out, struct server *server, struct error *err)
{
    *out = mem_calloc(1, sizeof **out);
    NEED(*out, err, "the farm's events");
    (*out)->server = server;
    return STATUS_OK;
}

void feed_free(struct feed *feed)
{
    if (!feed)
        return;
    mem_free(feed->jobs);
    buffer_release(&feed->packed);
    mem_free(feed);
}

void feed_listen(struct feed *feed, uint32_t session)
{
    feed->session = session;
    for (size_t i = 0; i < feed->count; i++)
        feed->jobs[i].hash = 0;
    feed->workers_hash = feed->farm_hash = 0;
    feed->workers_changed = 1;
}

static void tell(struct feed *feed, Azulejo__Wire__FarmChange *change)
{
    struct session *session = session_find(feed->server, feed->session);
    Azulejo__Wire__Envelope envelope = MESSAGE(FARM_CHANGE, farm_change, change);

    if (session)
        session_send(session, &envelope);
    else
        feed->session = 0;
}

static void tell_missed(struct feed *feed)
{
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;

    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_MISSED;
    change.missed = 1;
    tell(feed, &change);
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

void feed_job_changed(struct feed *feed, uint64_t job)
{
    struct feed_job *j = feed->session ? find(feed, job) : NULL;

    if (j)
        j->changed = 1;
    else if (feed->session)
        tell_missed(feed); /* no memory: listeners load everything again */
}

void feed_job_removed(struct feed *feed, uint64_t job)
{
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;
    size_t at = place_of(feed, job);

    if (at < feed->count && feed->jobs[at].id == job) {
        feed->count--;
        memmove(&feed->jobs[at], &feed->jobs[at + 1], (feed->count - at) * sizeof *feed->jobs);
    }
    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_JOB_REMOVED;
    change.job_removed = job;
    if (feed->session)
        tell(feed, &change);
}

void feed_workers_changed(struct feed *feed) { feed->workers_changed = 1; }

void feed_job_event(struct feed *feed, const struct job_event *event)
{
    Azulejo__Wire__JobEvent message = AZULEJO__WIRE__JOB_EVENT__INIT;
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;

    if (!feed->session)
        return;
    message.seq = event->seq;
    message.at = event->at;
    message.who = (char *)event->who;
    message.text = (char *)event->text;
    message.from_worker = event->from_worker;
    message.job = event->job;
    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_LINE;
    change.line = &message;
    tell(feed, &change);
}

/* Tell it if it says something new. */
static void tell_if_new(struct feed *feed, Azulejo__Wire__FarmChange *change, uint64_t *hash)
{
    struct buffer *packed = &feed->packed;
    uint8_t *space;
    uint64_t now;

    buffer_clear(packed);
    space = buffer_append_space(packed, azulejo__wire__farm_change__get_packed_size(change));
    if (!space) {
        buffer_release(packed);
        tell_missed(feed);
        return;
    }
    azulejo__wire__farm_change__pack(change, space);
    now = hash_bytes(packed->data, packed->size);
    if (now == *hash)
        return;
    *hash = now;
    if (change->change_case == AZULEJO__WIRE__FARM_CHANGE__CHANGE_JOB)
        change->job->told = ++feed->server->farm.told;
    tell(feed, change);
}

static void make_job(struct feed *feed, struct job *job, struct feed_job *j, uint64_t now_ns)
{
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;

    job_report_make(&feed->report, &feed->server->farm, job, now_ns);
    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_JOB;
    change.job = &feed->report.message;
    j->made_ns = now_ns;
    j->changed = 0;
    tell_if_new(feed, &change, &j->hash);
}

/* Jobs with frames in work change with every result, without a word. */
static void look_at_samples(struct feed *feed)
{
    const struct farm *farm = &feed->server->farm;
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
        j = find(feed, job->id);
        if (j && j->samples != samples) {
            j->samples = samples;
            j->changed = 1;
        }
    }
}

/* What a waiting job waits for follows from what other jobs and workers do: look at some, in turn. */
static void look_at_waiting(struct feed *feed, uint64_t now_ns)
{
    const struct queue *queue = &feed->server->farm.queue;

    for (int i = 0; i < WAITING_EACH_TICK && queue->active_count > 0; i++) {
        struct job *job = queue->active[feed->turn++ % queue->active_count];
        struct feed_job *j = job->leases == 0 ? find(feed, job->id) : NULL;
        if (j && now_ns - j->made_ns >= JOB_MS * NS_PER_MS)
            make_job(feed, job, j, now_ns);
    }
}

static void make_jobs(struct feed *feed, uint64_t now_ns)
{
    for (size_t i = 0; i < feed->count; i++) {
        struct feed_job *j = &feed->jobs[i];
        struct job *job;
        if (!j->changed || (j->made_ns && now_ns - j->made_ns < JOB_MS * NS_PER_MS))
            continue;
        job = queue_find(&feed->server->farm.queue, j->id);
        if (job)
            make_job(feed, job, j, now_ns);
        else
            j->changed = 0;
    }
}

static void tell_workers(void *user, Azulejo__Wire__WorkerList *list)
{
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;
    struct feed *feed = user;

    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_WORKERS;
    change.workers = list;
    tell_if_new(feed, &change, &feed->workers_hash);
}

static void make_workers(struct feed *feed, uint64_t now_ns)
{
    uint64_t rest_ms = WORKERS_MS + (feed->workers_changed ? 0 : WORKERS_EACH_MS * feed->server->farm.worker_count);
    struct error err = {0};

    if (now_ns - feed->workers_ns < rest_ms * NS_PER_MS)
        return;
    feed->workers_ns = now_ns;
    feed->workers_changed = 0;
    if (workers_list(feed->server, "", 0, 0, tell_workers, feed, now_ns, &err) != STATUS_OK)
        tell_missed(feed);
}

static void make_farm(struct feed *feed, uint64_t now_ns)
{
    Azulejo__Wire__FarmChange change = AZULEJO__WIRE__FARM_CHANGE__INIT;
    struct farm_info info;

    if (now_ns - feed->farm_ns < FARM_MS * NS_PER_MS)
        return;
    feed->farm_ns = now_ns;
    farm_info_make(&info, feed->server, now_ns);
    change.change_case = AZULEJO__WIRE__FARM_CHANGE__CHANGE_FARM;
    change.farm = &info.message;
    tell_if_new(feed, &change, &feed->farm_hash);
}

void feed_tick(struct feed *feed, uint64_t now_ns)
{
    if (!feed->session)
        return;
    if (now_ns - feed->samples_ns >= JOB_MS * NS_PER_MS) {
        feed->samples_ns = now_ns;
        look_at_samples(feed);
    }
    make_jobs(feed, now_ns);
    look_at_waiting(feed, now_ns);
    make_workers(feed, now_ns);
    make_farm(feed, now_ns);
}
