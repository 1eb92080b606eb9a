#include "worker/pool.h"

#include <pthread.h>
#include <signal.h>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

#include "common/base/memory.h"
#include "worker/profile.h"

struct task_list {
    struct pool_task *first, *last;
};

struct pool {
    pthread_mutex_t lock;
    pthread_cond_t work;
    struct task_list queue, done;
    int stop;
    int gathers; /* the owner looks again soon */
    void (*notify)(void *user);
    void *user;
    unsigned thread_count, threads_begun, threads_idle;
    pthread_t threads[];
};

static _Thread_local unsigned thread_number;

unsigned pool_thread(void) { return thread_number; }

unsigned pool_idle(struct pool *pool)
{
    unsigned idle;

    pthread_mutex_lock(&pool->lock);
    idle = pool->threads_idle;
    pthread_mutex_unlock(&pool->lock);
    return idle;
}

static void list_append(struct task_list *list, struct pool_task *task)
{
    task->next = NULL;
    task->previous = list->last;
    if (list->last)
        list->last->next = task;
    else
        list->first = task;
    list->last = task;
}

static void list_prepend(struct task_list *list, struct pool_task *task)
{
    task->previous = NULL;
    task->next = list->first;
    if (list->first)
        list->first->previous = task;
    else
        list->last = task;
    list->first = task;
}

static void list_remove(struct task_list *list, struct pool_task *task)
{
    if (task->previous)
        task->previous->next = task->next;
    else
        list->first = task->next;
    if (task->next)
        task->next->previous = task->previous;
    else
        list->last = task->previous;
    task->previous = task->next = NULL;
}

/* All exceptions masked, round to nearest, neither flush-to-zero nor denormals-are-zero. */
static void reset_float_state(void)
{
#if defined(__x86_64__)
    _mm_setcsr(0x1f80);
#elif defined(__aarch64__)
    unsigned long fpcr = 0;
    __asm__ volatile("msr fpcr, %0" : : "r"(fpcr));
#endif
}

static void *thread_main(void *argument)
{
    struct pool *pool = argument;

    reset_float_state();
    profile_join();
    pthread_mutex_lock(&pool->lock);
    thread_number = ++pool->threads_begun;
    for (;;) {
        struct pool_task *task = pool->queue.first;
        int tell;
        if (pool->stop)
            break;
        if (!task) {
            pool->threads_idle++;
            pthread_cond_wait(&pool->work, &pool->lock);
            pool->threads_idle--;
            continue;
        }
        list_remove(&pool->queue, task);
        task->state = TASK_RUNNING;
        pthread_mutex_unlock(&pool->lock);
        task->run(task);
        pthread_mutex_lock(&pool->lock);
        task->state = TASK_DONE;
        tell = pool->gathers ? !task->can_wait || !pool->queue.first : !pool->done.first;
        list_append(&pool->done, task);
        if (tell)
            pool->notify(pool->user);
    }
    pthread_mutex_unlock(&pool->lock);
    profile_leave();
    return NULL;
}

status pool_new(struct pool **out, unsigned threads, void (*notify)(void *user), void *user, struct error *err)
{
    struct pool *pool;
    sigset_t all, before;

    *out = NULL;
    if (threads < 1 || threads > POOL_THREADS_MAX)
        return error_set(err, STATUS_ERR_USAGE, "%u threads: must be 1..%d", threads, POOL_THREADS_MAX);
    pool = mem_calloc(1, sizeof *pool + threads * sizeof *pool->threads);
    NEED(pool, err, "the thread pool");
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->work, NULL);
    pool->notify = notify;
    pool->user = user;
    /* Signals go to the event loop's thread. */
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    while (pool->thread_count < threads &&
           pthread_create(&pool->threads[pool->thread_count], NULL, thread_main, pool) == 0)
        pool->thread_count++;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (pool->thread_count < threads) {
        unsigned started = pool->thread_count;
        pool_free(pool);
        return error_set(err, STATUS_ERR_NO_MEMORY, "only %u of %u threads can be started (lower --threads)", started,
                         threads);
    }
    *out = pool;
    return STATUS_OK;
}

void pool_free(struct pool *pool)
{
    if (!pool)
        return;
    pthread_mutex_lock(&pool->lock);
    pool->stop = 1;
    pthread_cond_broadcast(&pool->work);
    pthread_mutex_unlock(&pool->lock);
    for (unsigned i = 0; i < pool->thread_count; i++)
        pthread_join(pool->threads[i], NULL);
    pthread_cond_destroy(&pool->work);
    pthread_mutex_destroy(&pool->lock);
    mem_free(pool);
}

void pool_push(struct pool *pool, struct pool_task *task, int urgent)
{
    pthread_mutex_lock(&pool->lock);
    task->state = TASK_QUEUED;
    if (urgent)
        list_prepend(&pool->queue, task);
    else
        list_append(&pool->queue, task);
    pthread_cond_signal(&pool->work);
    pthread_mutex_unlock(&pool->lock);
}

int pool_cancel(struct pool *pool, struct pool_task *task)
{
    int cancelled;

    pthread_mutex_lock(&pool->lock);
    cancelled = task->state == TASK_QUEUED;
    if (cancelled) {
        list_remove(&pool->queue, task);
        task->state = TASK_IDLE;
    }
    pthread_mutex_unlock(&pool->lock);
    return cancelled;
}

struct pool_task *pool_take_done(struct pool *pool)
{
    struct pool_task *first;

    pthread_mutex_lock(&pool->lock);
    first = pool->done.first;
    pool->done.first = pool->done.last = NULL;
    pool->gathers = first != NULL;
    for (struct pool_task *t = first; t; t = t->next)
        t->state = TASK_IDLE;
    pthread_mutex_unlock(&pool->lock);
    return first;
}
