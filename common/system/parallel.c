#include "common/system/parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

#include "common/system/clock.h"

struct loop {
    void (*body)(void *user, size_t begin, size_t end);
    void *user;
    size_t count, grain;
    atomic_size_t next;
    _Atomic uint64_t others_ns; /* processor time of those that help */
};

static _Thread_local uint64_t helped_ns;

uint64_t parallel_cpu_ns(void) { return clock_thread_cpu_ns() + helped_ns; }

unsigned parallel_processors(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;

    if (count < 1)
        count = 1;
    return count < PARALLEL_THREADS_MAX ? (unsigned)count : (unsigned)PARALLEL_THREADS_MAX;
}

static void run_loop(struct loop *loop)
{
    for (;;) {
        size_t begin = atomic_fetch_add_explicit(&loop->next, loop->grain, memory_order_relaxed);
        size_t left;

        if (begin >= loop->count)
            return;
        left = loop->count - begin;
        loop->body(loop->user, begin, begin + (left < loop->grain ? left : loop->grain));
    }
}

static void *help(void *arg)
{
    struct loop *loop = arg;

    run_loop(loop);
    atomic_fetch_add(&loop->others_ns, parallel_cpu_ns());
    return NULL;
}

void parallel_for(unsigned threads, size_t count, size_t grain, void (*body)(void *user, size_t begin, size_t end),
                  void *user)
{
    struct loop loop = {.body = body, .user = user, .count = count, .grain = grain ? grain : 1};
    pthread_t others[PARALLEL_THREADS_MAX];
    unsigned started = 0;
    size_t pieces = count / loop.grain + (count % loop.grain != 0);

    if (threads == 0)
        threads = parallel_processors();
    if (threads > PARALLEL_THREADS_MAX)
        threads = PARALLEL_THREADS_MAX;
    if (threads > pieces)
        threads = (unsigned)pieces;
    while (started + 1 < threads && pthread_create(&others[started], NULL, help, &loop) == 0)
        started++;
    run_loop(&loop);
    for (unsigned i = 0; i < started; i++)
        pthread_join(others[i], NULL);
    helped_ns += atomic_load(&loop.others_ns);
}

static void *wait_for(void *gate)
{
    pthread_mutex_lock(gate);
    pthread_mutex_unlock(gate);
    return NULL;
}

int parallel_try(unsigned threads, size_t stack_bytes)
{
    pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
    pthread_t started[PARALLEL_THREADS_MAX];
    pthread_attr_t attributes;
    unsigned count = 0;
    int error = pthread_attr_init(&attributes);

    if (error)
        return error;
    error = pthread_attr_setstacksize(&attributes, stack_bytes);
    pthread_mutex_lock(&gate);
    while (error == 0 && count < threads) {
        error = pthread_create(&started[count], &attributes, wait_for, &gate);
        count += error == 0;
    }
    pthread_mutex_unlock(&gate);
    while (count > 0)
        pthread_join(started[--count], NULL);
    pthread_attr_destroy(&attributes);
    return error;
}
