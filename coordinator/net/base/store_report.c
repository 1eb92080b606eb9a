#include "coordinator/net/base/store_report.h"

#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/events/event_program.h"
#include "coordinator/net/server.h"
#include "protocol/message.h"

/* A job, or with others of it an owner. */
struct row {
    const struct job *job;
    uint64_t jobs, films, pictures;
};

static uint64_t row_bytes(const struct row *row) { return row->films + row->pictures; }

static int compare_bytes(const void *a, const void *b)
{
    const struct row *left = a, *right = b;

    if (row_bytes(left) != row_bytes(right))
        return row_bytes(left) > row_bytes(right) ? -1 : 1;
    return (left->job->id > right->job->id) - (left->job->id < right->job->id);
}

static int compare_owners(const void *a, const void *b)
{
    return strcmp(((const struct row *)a)->job->owner, ((const struct row *)b)->job->owner);
}

/* Of the jobs that there are. */
static size_t make_rows(const struct server *server, struct row *rows)
{
    const struct queue *queue = &server->farm.queue;
    size_t count = 0;

    for (size_t i = 0; i < queue->count; i++) {
        const struct job_footprint *room = footprint_find(&server->collector.footprint, queue->all[i]->id);
        rows[count++] = (struct row){queue->all[i], 1, room ? room->films : 0, room ? room->pictures : 0};
    }
    return count;
}

/* One row for each owner, in the same place. */
static size_t join_owners(struct row *rows, size_t count)
{
    size_t kept = 0;

    if (count > 0)
        qsort(rows, count, sizeof *rows, compare_owners);
    for (size_t i = 0; i < count; i++) {
        if (kept > 0 && compare_owners(&rows[kept - 1], &rows[i]) == 0) {
            rows[kept - 1].jobs++;
            rows[kept - 1].films += rows[i].films;
            rows[kept - 1].pictures += rows[i].pictures;
        } else {
            rows[kept++] = rows[i];
        }
    }
    return kept;
}

struct report {
    Azulejo__Wire__StoreInfo info;
    Azulejo__Wire__StoreJob jobs[STORE_ROWS_MAX], *job_pointers[STORE_ROWS_MAX];
    Azulejo__Wire__StoreOwner owners[STORE_ROWS_MAX], *owner_pointers[STORE_ROWS_MAX];
    char trouble[256];
};

static void fill_jobs(struct report *r, struct row *rows, size_t count)
{
    if (count > 0)
        qsort(rows, count, sizeof *rows, compare_bytes);
    for (size_t i = 0; i < count && i < STORE_ROWS_MAX; i++) {
        azulejo__wire__store_job__init(&r->jobs[i]);
        r->jobs[i].job = rows[i].job->id;
        r->jobs[i].name = (char *)rows[i].job->name;
        r->jobs[i].owner = (char *)rows[i].job->owner;
        r->jobs[i].state = (Azulejo__Wire__JobState)rows[i].job->state;
        r->jobs[i].films = rows[i].films;
        r->jobs[i].pictures = rows[i].pictures;
        r->job_pointers[i] = &r->jobs[i];
    }
    r->info.n_jobs = count < STORE_ROWS_MAX ? count : STORE_ROWS_MAX;
    r->info.jobs = r->job_pointers;
    r->info.more_jobs = count - r->info.n_jobs;
}

static void fill_owners(struct report *r, struct row *rows, size_t count)
{
    if (count > 0)
        qsort(rows, count, sizeof *rows, compare_bytes);
    for (size_t i = 0; i < count && i < STORE_ROWS_MAX; i++) {
        azulejo__wire__store_owner__init(&r->owners[i]);
        r->owners[i].owner = (char *)rows[i].job->owner;
        r->owners[i].jobs = rows[i].jobs;
        r->owners[i].films = rows[i].films;
        r->owners[i].pictures = rows[i].pictures;
        r->owner_pointers[i] = &r->owners[i];
    }
    r->info.n_owners = count < STORE_ROWS_MAX ? count : STORE_ROWS_MAX;
    r->info.owners = r->owner_pointers;
}

static void fill_sums(Azulejo__Wire__StoreInfo *info, const struct collector *c)
{
    const struct footprint *f = &c->footprint;

    info->disk = f->disk_bytes;
    info->free = f->free_bytes;
    info->films = f->films;
    info->pictures = f->pictures;
    info->blobs = f->blobs;
    info->database = f->database;
    info->reserve = f->reserve;
    info->other = f->other;
    info->trash = f->trash;
    info->store_limit = room_limit_bytes(&c->policy.store, f->disk_bytes);
    info->owner_limit = c->policy.owner_limit;
    info->keep_s = c->policy.keep_s;
    info->keep_failed_s = c->policy.keep_failed_s;
    info->removed_jobs = c->removed_jobs;
    info->removed_films = c->removed_films;
    info->removed_blobs = c->removed_blobs;
    info->removed_bytes = c->removed_bytes;
    info->waiting_blobs = c->waiting_blobs;
    info->waiting_bytes = c->waiting_bytes;
    info->held = (char *)c->held;
}

static void fill_safety(Azulejo__Wire__StoreInfo *info, struct server *server)
{
    info->wall = server->wall;
    info->wall_lacks = server->wall_lacks;
    info->scrub_files = server->scrubber.files;
    info->scrub_faults = server->scrubber.faults;
    info->scrubbed_at = server->scrubber.done_s;
    info->scrub_last = server->scrubber.last;
}

static void fill_events(struct report *r, const struct session *session)
{
    const struct server *server = session->server;
    struct event_counts counts;

    if (!server->events)
        return;
    counts = event_program_counts(server->events);
    if (session->may >= WEB_ROLE_ADMIN) /* it has the program's own words */
        event_program_trouble(server->events, r->trouble, sizeof r->trouble);
    r->info.on_event = (char *)server->on_event;
    r->info.events_taken = counts.taken;
    r->info.events_failed = counts.failed;
    r->info.events_dropped = counts.dropped;
    r->info.events_waiting = counts.waiting;
    r->info.events_trouble = r->trouble;
}

void store_report_send(struct session *session, uint64_t request)
{
    struct server *server = session->server;
    struct report *r = mem_calloc(1, sizeof *r);
    struct row *rows = mem_calloc(server->farm.queue.count + 1, sizeof *rows);
    struct error err = {0};
    size_t count;

    if (r && rows) {
        Azulejo__Wire__Envelope envelope = MESSAGE(STORE_INFO, store_info, &r->info);
        azulejo__wire__store_info__init(&r->info);
        count = make_rows(server, rows);
        fill_jobs(r, rows, count);
        fill_owners(r, rows, join_owners(rows, count));
        fill_sums(&r->info, &server->collector);
        fill_safety(&r->info, server);
        fill_events(r, session);
        session_reply(session, request, &envelope);
    } else {
        error_no_memory(&err, "what takes the store's room");
        session_fail(session, request, &err);
    }
    mem_free(rows);
    mem_free(r);
}
