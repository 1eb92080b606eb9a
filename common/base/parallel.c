#include "common/base/parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

struct loop {
    void (*body)(void *user, size_t begin, size_t end);
    void *user;
    size_t count, grain;
    atomic_size_t next;
};

unsigned parallel_processors(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;

    if (count < 1)
        count = 1;
    return count < PARALLEL_THREADS_MAX ? (unsigned)count : (unsigned)PARALLEL_THREADS_MAX;
}

static void *run_loop(void *arg)
{
    struct loop *loop = arg;

    for (;;) {
        size_t begin = atomic_fetch_add_explicit(&loop->next, loop->grain, memory_order_relaxed);
        size_t left;

        if (begin >= loop->count)
            return NULL;
        left = loop->count - begin;
        loop->body(loop->user, begin, begin + (left < loop->grain ? left : loop->grain));
    }
}

void parallel_for(unsigned threads, size_t count, size_t grain,
                  void (*body)(void *user, size_t begin, size_t end), void *user)
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
    while (started + 1 < threads &&
           pthread_create(&others[started], NULL, run_loop, &loop) == 0)
        started++;
    run_loop(&loop);
    for (unsigned i = 0; i < started; i++)
        pthread_join(others[i], NULL);
}
