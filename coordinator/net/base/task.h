/* task: work that waits for a disk or needs a processor, off the loop's thread.
 *
 * A kind of task is a struct that begins with `struct task`, and one const struct task_kind. `run`
 * works in libuv's thread pool, only on data that the task owns; then `end` and `release` run on
 * the loop's thread. A shutdown waits until no task is left (struct server, `tasks`).
 *
 * At most TASK_WRITERS_MAX of those that write to the store's disk run at once, and the others wait in their order: while it
 * hangs, there are threads for those that do not.
 */
#pragma once

#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"

struct server;
struct task;

enum { TASK_THREADS = 8, TASK_WRITERS_MAX = TASK_THREADS / 2 };

struct task_kind {
    const char *what;  /* for "out of memory" errors: "a picture" */
    size_t size_bytes; /* of the struct that begins with struct task */
    void (*run)(struct task *task);
    void (*end)(struct task *task);
    void (*release)(struct task *task); /* frees what the task owns; NULL: nothing */
    int writes;                         /* it waits for the store's disk */
};

struct task {
    uv_work_t request;
    uv_idle_t preparing;
    int (*prepare)(struct task *task);
    struct server *server;
    const struct task_kind *kind;
    status result;               /* of run, */
    uint64_t begun_ns, ended_ns; /* and when it was run */
    struct error error;
    struct task *next; /* that waits */
};

/* The tasks that wait for a thread, and those that write. Zeroed at first. */
struct task_line {
    struct task *first, *last;
    uint32_t writers;
};

/* Start as many threads as that, unless the environment says how many. Before any other thread is there. ERR_NO_MEMORY: one
 * cannot be started; libuv would end the process without a word. */
status task_threads(struct error *err) MUST_CHECK;
/* A zeroed task of that kind; NULL: ERR_NO_MEMORY in `err` (may be NULL). */
void *task_new(struct server *server, const struct task_kind *kind, struct error *err);
/* Hand it to the thread pool, which then owns it. It cannot fail. */
void task_start(struct task *task);
/* The same after `prepare` has returned 0. It is called on the loop's thread, once in each turn: it copies what belongs to that
 * thread, in steps that do not hold it up. */
void task_prepare(struct task *task, int (*prepare)(struct task *task));
/* Release a task that was not started; NULL is fine. */
void task_drop(struct task *task);
