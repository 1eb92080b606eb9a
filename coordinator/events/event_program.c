#include "coordinator/events/event_program.h"

#include <inttypes.h>
#include <openssl/rand.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/system/log_limit.h"
#include "coordinator/events/event_run.h"
#include "coordinator/store/store_web.h"

enum { NAME_SIZE = 96, IDLE_S = 60 };

struct event {
    struct event *next;
    uint64_t id;       /* in the store */
    uint64_t since_ns; /* in this run of the coordinator */
    char json[];
};

struct event_program {
    struct store *store;
    const char *path;
    pthread_t thread;
    pthread_mutex_t lock; /* of all that follows but `ending` */
    pthread_cond_t wake;
    struct event *first, **end, *running; /* running: the first, and the thread has it */
    uint64_t last_id;
    uint64_t next_ns; /* no run before this */
    int64_t wait_s;   /* after the next run that asks for another */
    struct event_counts counts;
    char trouble[EVENT_HOW_SIZE];
    struct log_limit drops;
    int has_thread;
    atomic_int ending;
};

/* ---- the queue. The lock is held. --------------------------------------------------------------- */

/* What the log calls it: "job-done of job 12, delivery 8e2c61d1a40b7f93". */
static void name_event(const struct event *event, char out[NAME_SIZE])
{
    char kind[32] = "", delivery[17] = "";
    uint64_t job = 0;

    (void)sscanf(event->json, "{\"event\": \"%31[^\"]\", \"delivery\": \"%16[^\"]\", \"at\": %*d, \"job\": %" SCNu64,
                 kind, delivery, &job);
    if (job)
        snprintf(out, NAME_SIZE, "%s of job %" PRIu64 ", delivery %s", kind, job, delivery);
    else
        snprintf(out, NAME_SIZE, "%s, delivery %s", kind, delivery);
}

static void add_last(struct event_program *program, struct event *event)
{
    *(program->first ? program->end : &program->first) = event;
    program->end = &event->next;
    program->counts.waiting++;
}

/* Out of the queue and the store. */
static void end_event(struct event_program *program, struct event *event)
{
    struct event **at = &program->first;
    struct error err = {0};

    while (*at != event)
        at = &(*at)->next;
    *at = event->next;
    if (program->end == &event->next)
        program->end = at;
    program->counts.waiting--;
    if (store_waiting_event_remove(program->store, event->id, &err) != STATUS_OK)
        log_debug("an event: %s; after a restart it comes again", err.text);
    mem_free(event);
}

/* Drops the oldest event, but not the one that is being run. */
static void drop_oldest(struct event_program *program)
{
    struct event *oldest = program->first == program->running ? program->first->next : program->first;
    char name[NAME_SIZE];
    uint64_t more;

    name_event(oldest, name);
    if (log_limit_pass(&program->drops, "", clock_monotonic_ns(), &more))
        log_warn("%d events wait for %s: the oldest is dropped (%s), as %" PRIu64 " were before", EVENTS_WAITING_MAX,
                 program->path, name, more);
    program->counts.dropped++;
    end_event(program, oldest);
}

static struct event *event_new(uint64_t id, const char *json)
{
    size_t size = strlen(json) + 1;
    struct event *event = mem_alloc(sizeof *event + size);

    if (event) {
        *event = (struct event){.id = id, .since_ns = clock_monotonic_ns()};
        memcpy(event->json, json, size);
    }
    return event;
}

static status make_json(char out[EVENT_JSON_MAX], const char *event, int64_t at, const char *fields, struct error *err)
{
    uint64_t delivery;
    int length;

    if (RAND_bytes((uint8_t *)&delivery, sizeof delivery) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL has no random numbers");
    length = snprintf(out, EVENT_JSON_MAX, "{\"event\": \"%s\", \"delivery\": \"%016" PRIx64 "\", \"at\": %" PRId64 ", %s}\n",
                      event, delivery, at, fields);
    return length < EVENT_JSON_MAX ? STATUS_OK
                                   : error_set(err, STATUS_ERR_LIMIT, "it has more than %d bytes", EVENT_JSON_MAX);
}

void event_program_send(struct event_program *program, const char *event_name, const char *fields)
{
    int64_t at = clock_wall_s();
    char json[EVENT_JSON_MAX];
    struct error err = {0};
    status s = make_json(json, event_name, at, fields, &err);
    struct event *event = NULL;

    pthread_mutex_lock(&program->lock);
    if (s == STATUS_OK)
        event = event_new(program->last_id + 1, json);
    if (s == STATUS_OK && !event)
        s = error_no_memory(&err, "an event");
    if (event) {
        program->last_id++;
        if (program->counts.waiting >= EVENTS_WAITING_MAX)
            drop_oldest(program);
        add_last(program, event);
        if (store_waiting_event_add(program->store, event->id, at, json, &err) != STATUS_OK)
            log_debug("an event: %s; it waits in memory alone", err.text);
        pthread_cond_signal(&program->wake);
    } else {
        program->counts.dropped++;
        log_warn("%s does not get the event %s: %s", program->path, event_name, err.text);
    }
    pthread_mutex_unlock(&program->lock);
}

/* ---- the thread. The lock is held, but not while the program runs. -------------------------------- */

static void note_again(struct event_program *program, struct event *event, const char *name, const char *how)
{
    uint64_t now_ns = clock_monotonic_ns();

    if (now_ns - event->since_ns >= EVENT_AGE_S * NS_PER_SECOND) {
        log_warn("%s, for %s: %s; it was not taken for a day, and is dropped", program->path, name, how);
        program->counts.dropped++;
        end_event(program, event);
        program->next_ns = 0;
        program->wait_s = EVENT_WAIT_MIN_S;
        return;
    }
    log_warn("%s, for %s: %s; it is run again in %" PRId64 " s", program->path, name, how, program->wait_s);
    program->counts.again++;
    program->next_ns = now_ns + (uint64_t)program->wait_s * NS_PER_SECOND;
    program->wait_s = 2 * program->wait_s < EVENT_WAIT_MAX_S ? 2 * program->wait_s : EVENT_WAIT_MAX_S;
}

static void note_run(struct event_program *program, struct event *event, enum event_fate fate, const char *how)
{
    char name[NAME_SIZE];

    name_event(event, name);
    if (fate == EVENT_FATE_TAKEN)
        program->trouble[0] = 0;
    else
        snprintf(program->trouble, sizeof program->trouble, "%s", how);
    if (fate == EVENT_FATE_AGAIN) {
        note_again(program, event, name, how);
        return;
    }
    program->next_ns = 0;
    program->wait_s = EVENT_WAIT_MIN_S;
    if (fate == EVENT_FATE_TAKEN) {
        log_info("%s, for %s: %s", program->path, name, how);
        program->counts.taken++;
    } else {
        log_warn("%s, for %s: %s; the event does not come again", program->path, name, how);
        program->counts.failed++;
    }
    end_event(program, event);
}

static void run_first(struct event_program *program)
{
    struct event *event = program->first;
    char how[EVENT_HOW_SIZE];
    enum event_fate fate;

    program->running = event;
    pthread_mutex_unlock(&program->lock);
    fate = event_run(program->path, event->json, &program->ending, how);
    pthread_mutex_lock(&program->lock);
    program->running = NULL;
    /* A program that was broken off says nothing of its event. */
    if (!atomic_load(&program->ending) || fate == EVENT_FATE_TAKEN)
        note_run(program, event, fate, how);
}

static void *run(void *user)
{
    struct event_program *program = user;

    pthread_mutex_lock(&program->lock);
    while (!atomic_load(&program->ending)) {
        uint64_t now_ns = clock_monotonic_ns(), when_ns = now_ns + IDLE_S * NS_PER_SECOND;
        struct timespec until;
        if (program->first && program->next_ns <= now_ns) {
            run_first(program);
            continue;
        }
        if (program->first && program->next_ns < when_ns)
            when_ns = program->next_ns;
        until = (struct timespec){(time_t)(when_ns / NS_PER_SECOND), (long)(when_ns % NS_PER_SECOND)};
        pthread_cond_timedwait(&program->wake, &program->lock, &until);
    }
    pthread_mutex_unlock(&program->lock);
    return NULL;
}

/* ---- begin and end ------------------------------------------------------------------------------ */

static status take_waiting(void *user, uint64_t id, const char *json, struct error *err)
{
    struct event_program *program = user;
    struct event *event = event_new(id, json);

    NEED(event, err, "the events that wait");
    add_last(program, event);
    program->last_id = id;
    return STATUS_OK;
}

status event_program_open(struct event_program **out, struct store *store, const char *path, struct error *err)
{
    struct event_program *program;
    pthread_condattr_t attributes;
    status s;

    *out = NULL;
    TRY(event_program_check(path, err));
    program = mem_calloc(1, sizeof *program);
    NEED(program, err, "the program of --on-event");
    program->store = store;
    program->path = path;
    program->wait_s = EVENT_WAIT_MIN_S;
    pthread_mutex_init(&program->lock, NULL);
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&program->wake, &attributes);
    pthread_condattr_destroy(&attributes);
    s = store_waiting_events_load(store, take_waiting, program, err);
    if (s == STATUS_OK && program->first)
        log_info("%" PRIu32 " events of before wait for %s", program->counts.waiting, path);
    if (s == STATUS_OK && pthread_create(&program->thread, NULL, run, program) != 0)
        s = error_set(err, STATUS_ERR_NO_MEMORY, "no thread for the program of --on-event");
    program->has_thread = s == STATUS_OK;
    if (s == STATUS_OK)
        *out = program;
    else
        event_program_close(program);
    return s;
}

void event_program_end(struct event_program *program)
{
    atomic_store(&program->ending, 1);
    pthread_mutex_lock(&program->lock);
    pthread_cond_signal(&program->wake);
    pthread_mutex_unlock(&program->lock);
}

void event_program_close(struct event_program *program)
{
    if (!program)
        return;
    event_program_end(program);
    if (program->has_thread)
        pthread_join(program->thread, NULL);
    for (struct event *event = program->first, *next; event; event = next) {
        next = event->next;
        mem_free(event);
    }
    pthread_cond_destroy(&program->wake);
    pthread_mutex_destroy(&program->lock);
    mem_free(program);
}

struct event_counts event_program_counts(struct event_program *program)
{
    struct event_counts counts;

    pthread_mutex_lock(&program->lock);
    counts = program->counts;
    pthread_mutex_unlock(&program->lock);
    return counts;
}

void event_program_trouble(struct event_program *program, char *out, size_t size)
{
    pthread_mutex_lock(&program->lock);
    snprintf(out, size, "%s", program->trouble);
    pthread_mutex_unlock(&program->lock);
}
