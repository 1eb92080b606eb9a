/* pool: threads that run tasks off a queue.
 *
 *   IDLE --pool_push--> QUEUED --a thread--> RUNNING --> DONE --pool_take_done--> IDLE
 *                         \--pool_cancel--> IDLE
 *
 * A task is embedded in whatever it works on and belongs to the pool between push and
 * take_done (or a successful cancel). Finished tasks pile up until they are taken;
 * `notify` is called from a pool thread when the first one does. Every thread runs with the
 * processor's default floating-point state (round to nearest, denormals kept): results must
 * not depend on what some library set.
 */
#ifndef AZULEJO_WORKER_POOL_H
#define AZULEJO_WORKER_POOL_H

#include "common/base/status.h"

enum { POOL_THREADS_MAX = 4096 };

enum pool_task_state { TASK_IDLE, TASK_QUEUED, TASK_RUNNING, TASK_DONE };

struct pool_task {
    void (*run)(struct pool_task *task); /* in a pool thread */
    struct pool_task *previous, *next;
    enum pool_task_state state;          /* the pool's */
};

struct pool;

status pool_new(struct pool **out, unsigned threads, void (*notify)(void *user), void *user,
                struct error *err) MUST_CHECK;
/* Forget what is queued, wait for what runs, end the threads. Tasks are not freed. */
void pool_free(struct pool *pool);

/* Urgent tasks run before the others, the newest first; the others first come, first served. */
void pool_push(struct pool *pool, struct pool_task *task, int urgent);
/* Take a task back that no thread has begun; 0 if one has. */
int pool_cancel(struct pool *pool, struct pool_task *task);
/* The finished tasks in the order in which they finished, linked by `next`; NULL: none. */
struct pool_task *pool_take_done(struct pool *pool);

#endif
