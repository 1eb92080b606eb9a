#include "coordinator/page/webhook.h"

#include <inttypes.h>
#include <openssl/rand.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/page/webhook_post.h"

enum { STORE_WAIT_S = 5 };

struct event {
    struct event *next;
    uint64_t id; /* in the store; 0: not there yet */
    int64_t at;
    uint64_t since_ns; /* in this run */
    char body[];
};

/* A place: the thread frees what it holds, others only mark it `gone`. */
struct hook {
    struct webhook_row row; /* number 0: the place is free */
    int gone;
    struct event *first, **end;
    uint64_t next_ns; /* no attempt before this */
    int64_t wait_s;   /* after the next failure */
    struct webhook_counts counts;
    char last_error[256];
    int full; /* and this was logged */
};

struct webhooks {
    struct store *store;
    pthread_t thread;
    pthread_mutex_t lock; /* of all that follows but `ending` */
    pthread_cond_t wake;
    struct hook hooks[WEBHOOKS_MAX];
    struct webhook_counts past; /* of webhooks that were removed */
    uint64_t store_next_ns;     /* the store failed: not before this */
    uint16_t own_ports[2];
    int trying; /* a test is on its way */
    int has_thread;
    atomic_int ending;
};

/* ---- events ------------------------------------------------------------------------------------- */

static struct event *event_new(uint64_t id, int64_t at, const char *body)
{
    size_t size = strlen(body) + 1;
    struct event *event = mem_alloc(sizeof *event + size);

    if (event) {
        *event = (struct event){.id = id, .at = at, .since_ns = clock_monotonic_ns()};
        memcpy(event->body, body, size);
    }
    return event;
}

static void add_event(struct hook *hook, struct event *event)
{
    *(hook->first ? hook->end : &hook->first) = event;
    hook->end = &event->next;
    hook->counts.waiting++;
}

/* Only by the thread, or when there is none. */
static void drop_first(struct hook *hook)
{
    struct event *event = hook->first;

    hook->first = event->next;
    hook->counts.waiting--;
    mem_free(event);
}

static void take_place(struct hook *hook, const struct webhook_row *row)
{
    *hook = (struct hook){.row = *row, .wait_s = WEBHOOK_WAIT_MIN_S};
}

static struct hook *find_hook(struct webhooks *webhooks, uint64_t number)
{
    for (int i = 0; i < WEBHOOKS_MAX; i++)
        if (number && webhooks->hooks[i].row.number == number && !webhooks->hooks[i].gone)
            return &webhooks->hooks[i];
    return NULL;
}

void webhooks_send(struct webhooks *webhooks, const char *event_name, const char *fields)
{
    int64_t at = clock_wall_s();
    char body[WEBHOOK_BODY_MAX];
    struct error err = {0};

    if (webhook_body(body, event_name, fields, &err) != STATUS_OK) {
        log_warn("no webhook gets the event %s: %s", event_name, err.text);
        return;
    }
    pthread_mutex_lock(&webhooks->lock);
    for (int i = 0; i < WEBHOOKS_MAX; i++) {
        struct hook *hook = &webhooks->hooks[i];
        struct event *event = NULL;
        if (!hook->row.number || hook->gone)
            continue;
        if (hook->counts.waiting < WEBHOOK_WAITING_MAX)
            event = event_new(0, at, body);
        if (event) {
            add_event(hook, event);
            continue;
        }
        hook->counts.given_up++;
        if (!hook->full)
            log_warn("webhook %" PRIu64 ": %d events wait for it; further ones are left out", hook->row.number,
                     WEBHOOK_WAITING_MAX);
        hook->full = 1;
    }
    pthread_cond_signal(&webhooks->wake);
    pthread_mutex_unlock(&webhooks->lock);
}

/* ---- the thread. The lock is held, but not while it waits for a disk or a server. -------------------- */

static void free_place(struct webhooks *webhooks, struct hook *hook)
{
    while (hook->first)
        drop_first(hook);
    webhooks->past.sent += hook->counts.sent;
    webhooks->past.failed += hook->counts.failed;
    webhooks->past.given_up += hook->counts.given_up;
    *hook = (struct hook){0};
}

/* An event that is to be stored; NULL: none. */
static struct event *unstored(struct webhooks *webhooks, struct hook **of)
{
    for (int i = 0; i < WEBHOOKS_MAX; i++) {
        *of = &webhooks->hooks[i];
        for (struct event *event = (*of)->gone ? NULL : (*of)->first; event; event = event->next)
            if (!event->id)
                return event;
    }
    return NULL;
}

/* Bring what is new to the disk. */
static void store_events(struct webhooks *webhooks)
{
    struct hook *hook;
    struct event *event;
    status s = STATUS_OK;

    while (s == STATUS_OK && clock_monotonic_ns() >= webhooks->store_next_ns &&
           (event = unstored(webhooks, &hook))) {
        struct webhook_event row = {.webhook = hook->row.number, .at = event->at, .body = event->body};
        struct error err = {0};
        pthread_mutex_unlock(&webhooks->lock);
        s = store_webhook_event_add(webhooks->store, &row, &err);
        pthread_mutex_lock(&webhooks->lock);
        if (s == STATUS_OK)
            event->id = row.id;
        else if (s == STATUS_ERR_NOT_FOUND)
            hook->gone = 1;
        else
            webhooks->store_next_ns = clock_monotonic_ns() + STORE_WAIT_S * NS_PER_SECOND;
    }
}

/* The place's first event was sent or given up. */
static void end_first(struct webhooks *webhooks, struct hook *hook)
{
    uint64_t id = hook->first->id;
    struct error err = {0};

    if (id) {
        pthread_mutex_unlock(&webhooks->lock);
        if (store_webhook_event_remove(webhooks->store, id, &err) != STATUS_OK)
            log_debug("webhook: %s; after a restart it is sent again", err.text);
        pthread_mutex_lock(&webhooks->lock);
    }
    drop_first(hook);
}

static void note_attempt(struct webhooks *webhooks, struct hook *hook, status s, const struct error *why)
{
    uint64_t now_ns = clock_monotonic_ns();

    if (s == STATUS_OK) {
        hook->counts.sent++;
        hook->last_error[0] = 0;
        hook->wait_s = WEBHOOK_WAIT_MIN_S;
        hook->next_ns = 0;
        hook->full = 0;
        end_first(webhooks, hook);
        return;
    }
    hook->counts.failed++;
    if (!hook->last_error[0])
        log_warn("webhook %" PRIu64 ": %s; it is tried again", hook->row.number, why->text);
    snprintf(hook->last_error, sizeof hook->last_error, "%.255s", why->text);
    hook->next_ns = now_ns + (uint64_t)hook->wait_s * NS_PER_SECOND;
    hook->wait_s = 2 * hook->wait_s < WEBHOOK_WAIT_MAX_S ? 2 * hook->wait_s : WEBHOOK_WAIT_MAX_S;
    if (now_ns - hook->first->since_ns < WEBHOOK_AGE_S * NS_PER_SECOND)
        return;
    hook->counts.given_up++;
    log_warn("webhook %" PRIu64 ": an event was not taken for a day, and is given up: %s", hook->row.number, why->text);
    end_first(webhooks, hook);
}

static void send_first(struct webhooks *webhooks, struct hook *hook)
{
    struct webhook_post post = {.own_ports = {webhooks->own_ports[0], webhooks->own_ports[1]}, .ending = &webhooks->ending};
    struct webhook_row row = hook->row;
    const char *body = hook->first->body; /* only this thread frees it */
    struct error err = {0};
    status s;

    pthread_mutex_unlock(&webhooks->lock);
    s = webhook_post(&post, &row, body, &err);
    pthread_mutex_lock(&webhooks->lock);
    if (!atomic_load(&webhooks->ending))
        note_attempt(webhooks, hook, s, &err);
}

/* The place whose turn it is; NULL: none yet, and *when_ns is when. */
static struct hook *next_due(struct webhooks *webhooks, uint64_t now_ns, uint64_t *when_ns)
{
    struct hook *next = NULL;

    *when_ns = now_ns + 60 * NS_PER_SECOND;
    for (int i = 0; i < WEBHOOKS_MAX; i++) {
        struct hook *hook = &webhooks->hooks[i];
        if (hook->gone)
            free_place(webhooks, hook);
        if (hook->first && (!next || hook->next_ns < next->next_ns))
            next = hook;
    }
    if (next && next->next_ns > now_ns && next->next_ns < *when_ns)
        *when_ns = next->next_ns;
    if (webhooks->store_next_ns > now_ns && webhooks->store_next_ns < *when_ns)
        *when_ns = webhooks->store_next_ns;
    return next && next->next_ns <= now_ns ? next : NULL;
}

static void *run(void *user)
{
    struct webhooks *webhooks = user;
    uint64_t when_ns;

    pthread_mutex_lock(&webhooks->lock);
    while (!atomic_load(&webhooks->ending)) {
        struct hook *hook;
        store_events(webhooks);
        hook = next_due(webhooks, clock_monotonic_ns(), &when_ns);
        if (hook) {
            send_first(webhooks, hook);
        } else {
            struct timespec until = {(time_t)(when_ns / NS_PER_SECOND), (long)(when_ns % NS_PER_SECOND)};
            pthread_cond_timedwait(&webhooks->wake, &webhooks->lock, &until);
        }
    }
    store_events(webhooks);
    pthread_mutex_unlock(&webhooks->lock);
    return NULL;
}

/* ---- begin and end ------------------------------------------------------------------------------ */

static status take_webhook(void *user, const struct webhook_row *row, struct error *err)
{
    struct webhooks *webhooks = user;

    for (int i = 0; i < WEBHOOKS_MAX; i++)
        if (!webhooks->hooks[i].row.number) {
            take_place(&webhooks->hooks[i], row);
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_CORRUPT, "the store has more than %d webhooks", WEBHOOKS_MAX);
}

static status take_event(void *user, const struct webhook_event *stored, struct error *err)
{
    struct hook *hook = find_hook(user, stored->webhook);
    struct event *event = hook ? event_new(stored->id, stored->at, stored->body) : NULL;

    if (hook && !event)
        return error_no_memory(err, "what webhooks are to be sent");
    if (event)
        add_event(hook, event);
    return STATUS_OK;
}

/* The clock of the waits is the monotonic one. */
static void init_locks(struct webhooks *webhooks)
{
    pthread_condattr_t attributes;

    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&webhooks->wake, &attributes);
    pthread_condattr_destroy(&attributes);
    pthread_mutex_init(&webhooks->lock, NULL);
}

status webhooks_open(struct webhooks **out, struct store *store, struct error *err)
{
    struct webhooks *webhooks = mem_calloc(1, sizeof *webhooks);
    status s;

    *out = NULL;
    NEED(webhooks, err, "the webhooks");
    init_locks(webhooks);
    webhooks->store = store;
    s = store_webhooks_load(store, take_webhook, webhooks, err);
    THEN(s, store_webhook_events_load(store, take_event, webhooks, err));
    if (s == STATUS_OK) {
        webhooks->has_thread = pthread_create(&webhooks->thread, NULL, run, webhooks) == 0;
        if (!webhooks->has_thread)
            s = error_no_memory(err, "a thread for webhooks");
    }
    if (s == STATUS_OK)
        *out = webhooks;
    else
        webhooks_close(webhooks);
    return s;
}

void webhooks_close(struct webhooks *webhooks)
{
    if (!webhooks)
        return;
    atomic_store(&webhooks->ending, 1);
    pthread_mutex_lock(&webhooks->lock);
    pthread_cond_signal(&webhooks->wake);
    pthread_mutex_unlock(&webhooks->lock);
    if (webhooks->has_thread)
        pthread_join(webhooks->thread, NULL);
    for (int i = 0; i < WEBHOOKS_MAX; i++)
        free_place(webhooks, &webhooks->hooks[i]);
    pthread_cond_destroy(&webhooks->wake);
    pthread_mutex_destroy(&webhooks->lock);
    mem_free(webhooks);
}

void webhooks_set_own_ports(struct webhooks *webhooks, uint16_t page, uint16_t farm)
{
    pthread_mutex_lock(&webhooks->lock);
    webhooks->own_ports[0] = page;
    webhooks->own_ports[1] = farm;
    pthread_mutex_unlock(&webhooks->lock);
}

/* ---- what people do ------------------------------------------------------------------------------ */

static status no_such_webhook(uint64_t number, struct error *err)
{
    return error_set(err, STATUS_ERR_NOT_FOUND, "there is no webhook %" PRIu64 " ('azulejo webhook list' lists them)",
                     number);
}

/* A place that is free, or that the thread is about to free: then it waits for that. */
static struct hook *free_hook(struct webhooks *webhooks)
{
    for (int i = 0; i < WEBHOOKS_MAX; i++)
        if (!webhooks->hooks[i].row.number)
            return &webhooks->hooks[i];
    return NULL;
}

status webhook_add(struct webhooks *webhooks, struct webhook_row *row, struct error *err)
{
    status s = webhook_check_url(row->url, err);
    struct hook *hook;

    if (s == STATUS_OK && RAND_bytes(row->secret, sizeof row->secret) != 1)
        s = error_set(err, STATUS_ERR_INTERNAL, "OpenSSL has no random numbers for a secret");
    if (s != STATUS_OK)
        return s;
    row->made_at = clock_wall_s();
    pthread_mutex_lock(&webhooks->lock);
    hook = free_hook(webhooks);
    if (!hook)
        s = error_set(err, STATUS_ERR_LIMIT, "there are %d webhooks already; remove one first", WEBHOOKS_MAX);
    THEN(s, store_webhook_add(webhooks->store, row, err));
    if (s == STATUS_OK)
        take_place(hook, row);
    pthread_mutex_unlock(&webhooks->lock);
    return s;
}

status webhook_remove(struct webhooks *webhooks, uint64_t number, struct error *err)
{
    struct hook *hook;
    status s;

    pthread_mutex_lock(&webhooks->lock);
    hook = find_hook(webhooks, number);
    s = hook ? store_webhook_remove(webhooks->store, number, err) : no_such_webhook(number, err);
    if (s == STATUS_OK)
        hook->gone = 1;
    pthread_cond_signal(&webhooks->wake);
    pthread_mutex_unlock(&webhooks->lock);
    return s;
}

size_t webhooks_list(struct webhooks *webhooks, struct webhook_view out[WEBHOOKS_MAX])
{
    size_t count = 0;

    pthread_mutex_lock(&webhooks->lock);
    for (uint64_t after = 0;;) {
        const struct hook *next = NULL;
        for (int i = 0; i < WEBHOOKS_MAX; i++) {
            const struct hook *hook = &webhooks->hooks[i];
            if (!hook->gone && hook->row.number > after && (!next || hook->row.number < next->row.number))
                next = hook;
        }
        if (!next)
            break;
        after = next->row.number;
        out[count] = (struct webhook_view){.row = next->row, .counts = next->counts};
        memcpy(out[count++].last_error, next->last_error, sizeof next->last_error);
    }
    pthread_mutex_unlock(&webhooks->lock);
    return count;
}

struct webhook_counts webhooks_counts(struct webhooks *webhooks)
{
    struct webhook_counts sum;

    pthread_mutex_lock(&webhooks->lock);
    sum = webhooks->past;
    for (int i = 0; i < WEBHOOKS_MAX; i++) {
        sum.sent += webhooks->hooks[i].counts.sent;
        sum.failed += webhooks->hooks[i].counts.failed;
        sum.given_up += webhooks->hooks[i].counts.given_up;
        sum.waiting += webhooks->hooks[i].counts.waiting;
    }
    pthread_mutex_unlock(&webhooks->lock);
    return sum;
}

status webhooks_try_begin(struct webhooks *webhooks, struct error *err)
{
    if (webhooks->trying)
        return error_set(err, STATUS_ERR_LIMIT, "another webhook is being tested; try again when that has ended");
    webhooks->trying = 1;
    return STATUS_OK;
}

void webhooks_try_ended(struct webhooks *webhooks) { webhooks->trying = 0; }

status webhook_try(struct webhooks *webhooks, uint64_t number, struct error *err)
{
    struct webhook_post post = {.ending = &webhooks->ending};
    struct webhook_row row = {0};
    struct hook *hook;
    char body[WEBHOOK_BODY_MAX];
    status s;

    pthread_mutex_lock(&webhooks->lock);
    hook = find_hook(webhooks, number);
    if (hook)
        row = hook->row;
    memcpy(post.own_ports, webhooks->own_ports, sizeof post.own_ports);
    pthread_mutex_unlock(&webhooks->lock);
    if (!row.number)
        return no_such_webhook(number, err);
    s = webhook_body(body, "test", "\"text\": \"this is a test\"", err);
    return s == STATUS_OK ? webhook_post(&post, &row, body, err) : s;
}
