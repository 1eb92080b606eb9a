/* task: work that waits for a disk or needs a processor, off the loop's thread.
 *
 * A kind of task is a struct that begins with `struct task`, and one const struct task_kind. `run`
 * works in libuv's thread pool, only on data that the task owns; then `end` and `release` run on
 * the loop's thread. A shutdown waits until no task is left (struct server, `tasks`).
 */
#ifndef AZULEJO_COORDINATOR_TASK_H
#define AZULEJO_COORDINATOR_TASK_H

#include <uv.h>

#include "common/base/status.h"

struct server;
struct task;

struct task_kind {
    const char *what;      /* for "out of memory" errors: "a picture" */
    size_t size_bytes;     /* of the struct that begins with struct task */
    void (*run)(struct task *task);
    void (*end)(struct task *task);
    void (*release)(struct task *task); /* frees what the task owns; NULL: nothing */
};

struct task {
    uv_work_t request;
    struct server *server;
    const struct task_kind *kind;
    status result;         /* of run, */
    uint64_t begun_ns, ended_ns; /* and when it was run */
    struct error error;
};

/* A zeroed task of that kind; NULL: ERR_NO_MEMORY in `err` (may be NULL). */
void *task_new(struct server *server, const struct task_kind *kind, struct error *err);
/* Hand it to the thread pool, which then owns it. It cannot fail. */
void task_start(struct task *task);
/* Release a task that was not started; NULL is fine. */
void task_drop(struct task *task);

#endif
