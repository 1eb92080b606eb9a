#include "worker/profile.h"

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>

#include "common/base/memory.h"
#include "worker/render/base/profile_scope.h"

enum { IDLE_PERIOD_NS = 20000000 };

/* A thread that is sampled. */
struct watched {
    struct watched *next;
    const struct profile_place *place;
    _Atomic uint64_t stages[STAGE_COUNT], accounts[EFFECT_ACCOUNTS];
};

static struct {
    pthread_mutex_t lock; /* guards `first` and the list */
    struct watched *first;
    atomic_int stop;
    long period_ns;
    int running;
    pthread_t thread;
} profile = {.lock = PTHREAD_MUTEX_INITIALIZER};

static _Thread_local struct watched *mine;

/* Sample every thread once; returns how many were rendering. */
static int look(void)
{
    int busy = 0;

    pthread_mutex_lock(&profile.lock);
    for (struct watched *w = profile.first; w; w = w->next) {
        unsigned stage = WATCHED_GET(w->place->stage);
        unsigned account = WATCHED_GET(w->place->account);
        if (stage == 0 || stage > STAGE_COUNT || account >= EFFECT_ACCOUNTS)
            continue;
        atomic_fetch_add_explicit(&w->stages[stage - 1], 1, memory_order_relaxed);
        atomic_fetch_add_explicit(&w->accounts[account], 1, memory_order_relaxed);
        busy++;
    }
    pthread_mutex_unlock(&profile.lock);
    return busy;
}

static void *watch_main(void *unused UNUSED)
{
    while (!atomic_load_explicit(&profile.stop, memory_order_relaxed)) {
        struct timespec pause = {0, look() ? profile.period_ns : IDLE_PERIOD_NS};
        clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, NULL);
    }
    return NULL;
}

status profile_start(long period_ns, struct error *err)
{
    sigset_t all, before;
    int code;

    atomic_store(&profile.stop, 0);
    profile.period_ns = period_ns;
    sigfillset(&all); /* signals go to the event loop's thread */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    code = pthread_create(&profile.thread, NULL, watch_main, NULL);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (code != 0)
        return error_set(err, STATUS_ERR_NO_MEMORY, "the profile's thread cannot be started: %s", strerror(code));
    profile.running = 1;
    return STATUS_OK;
}

void profile_stop(void)
{
    if (!profile.running)
        return;
    atomic_store(&profile.stop, 1);
    pthread_join(profile.thread, NULL);
    profile.running = 0;
}

void profile_join(void)
{
    struct watched *w = mem_calloc(1, sizeof *w);

    if (!w)
        return;
    w->place = &profile_place;
    pthread_mutex_lock(&profile.lock);
    w->next = profile.first;
    profile.first = w;
    pthread_mutex_unlock(&profile.lock);
    mine = w;
}

void profile_leave(void)
{
    if (!mine)
        return;
    pthread_mutex_lock(&profile.lock);
    for (struct watched **at = &profile.first; *at; at = &(*at)->next)
        if (*at == mine) {
            *at = mine->next;
            break;
        }
    pthread_mutex_unlock(&profile.lock);
    mem_free(mine);
    mine = NULL;
}

void profile_counts(struct profile_counts *out)
{
    memset(out, 0, sizeof *out);
    for (int i = 0; mine && i < STAGE_COUNT; i++)
        out->stages[i] = atomic_load_explicit(&mine->stages[i], memory_order_relaxed);
    for (int i = 0; mine && i < EFFECT_ACCOUNTS; i++)
        out->accounts[i] = atomic_load_explicit(&mine->accounts[i], memory_order_relaxed);
}
