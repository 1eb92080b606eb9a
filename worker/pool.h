/* pool: threads that run tasks off a queue.
 *
 *   IDLE --pool_push--> QUEUED --a thread--> RUNNING --> DONE --pool_take_done--> IDLE
 *                         \--pool_cancel--> IDLE
 *
 * A task is embedded in the object it works on and belongs to the pool between push and take_done
 * (or a successful cancel). Finished tasks accumulate until they are taken; a pool thread calls
 * `notify` at the first one. An owner that has just taken some looks again by itself, POOL_GATHER_MS later: until
 * then only tasks that cannot wait, or behind which none is queued, are notified of. Every thread runs with the processor's default floating-point state
 * (round to nearest, denormals kept): results must not depend on what a library has set.
 */
#pragma once

#include "common/base/status.h"

enum { POOL_THREADS_MAX = 4096, POOL_GATHER_MS = 20 };

enum pool_task_state { TASK_IDLE, TASK_QUEUED, TASK_RUNNING, TASK_DONE };

struct pool_task {
    void (*run)(struct pool_task *task); /* in a pool thread */
    struct pool_task *previous, *next;
    enum pool_task_state state; /* the pool's */
    int can_wait;               /* when done, POOL_GATHER_MS for others; `run` may change it */
};

struct pool;

status pool_new(struct pool **out, unsigned threads, void (*notify)(void *user), void *user,
                struct error *err) MUST_CHECK;
/* Forget what is queued, wait for running tasks, end the threads. Tasks are not freed. */
void pool_free(struct pool *pool);

/* Urgent tasks run before the others, the newest first; the others run in order of arrival. */
void pool_push(struct pool *pool, struct pool_task *task, int urgent);
/* Take back a task that no thread has started; 0 if one has. */
int pool_cancel(struct pool *pool, struct pool_task *task);
/* How many threads have nothing to do now. */
unsigned pool_idle(struct pool *pool);
/* The number of the calling thread in its pool, from 1; 0: it is in none. */
unsigned pool_thread(void);
/* The finished tasks in the order in which they finished, linked by `next`; the owner calls it again within
 * POOL_GATHER_MS. NULL: none; the next one is notified of. */
struct pool_task *pool_take_done(struct pool *pool);
