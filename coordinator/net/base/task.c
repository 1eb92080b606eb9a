#include "coordinator/net/base/task.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "coordinator/net/server.h"

void *task_new(struct server *server, const struct task_kind *kind, struct error *err)
{
    struct task *task = mem_calloc(1, kind->size_bytes);

    if (!task) {
        error_no_memory(err, kind->what);
        return NULL;
    }
    task->request.data = task;
    task->server = server;
    task->kind = kind;
    return task;
}

void task_drop(struct task *task)
{
    if (task && task->kind->release)
        task->kind->release(task);
    mem_free(task);
}

static void on_run(uv_work_t *request)
{
    struct task *task = request->data;

    task->begun_ns = clock_monotonic_ns();
    task->kind->run(task);
    task->ended_ns = clock_monotonic_ns();
}

static void begin(struct task *task);

/* The next one that waits takes the place of one that wrote. */
static void writer_ended(struct task_line *line)
{
    struct task *next = line->first;

    line->writers--;
    if (!next)
        return;
    line->first = next->next;
    if (!line->first)
        line->last = NULL;
    begin(next);
}

static void on_end(uv_work_t *request, int code)
{
    struct task *task = request->data;

    (void)code; /* no task is ever cancelled */
    task->server->tasks--;
    if (task->kind->writes)
        writer_ended(&task->server->line);
    task->kind->end(task);
    task_drop(task);
}

static void begin(struct task *task)
{
    int code;

    task->server->line.writers += (uint32_t)task->kind->writes;
    code = uv_queue_work(&task->server->loop, &task->request, on_run, on_end);
    assert(code == 0); /* it fails only for a NULL function */
    (void)code;
}

/* To the pool, or into the line of those that write. */
static void hand_over(struct task *task)
{
    struct task_line *line = &task->server->line;

    if (!task->kind->writes || line->writers < TASK_WRITERS_MAX) {
        begin(task);
        return;
    }
    if (line->last)
        line->last->next = task;
    else
        line->first = task;
    line->last = task;
}

static void on_prepared(uv_handle_t *handle) { hand_over(handle->data); }

static void on_idle(uv_idle_t *handle)
{
    struct task *task = handle->data;

    if (!task->prepare(task))
        uv_close((uv_handle_t *)handle, on_prepared);
}

void task_start(struct task *task)
{
    task->server->tasks++;
    hand_over(task);
}

void task_prepare(struct task *task, int (*prepare)(struct task *task))
{
    task->server->tasks++;
    task->prepare = prepare;
    uv_idle_init(&task->server->loop, &task->preparing);
    task->preparing.data = task;
    uv_idle_start(&task->preparing, on_idle);
}

static void nothing(uv_work_t *request UNUSED) {}

/* libuv reads the variable when its threads start, and programs that we start later are not to have it. */
status task_threads(struct error *err)
{
    enum { STACK_BYTES = 8 << 20 };
    static const char name[] = "UV_THREADPOOL_SIZE";
    const char *given = getenv(name);
    const int wanted = given ? atoi(given) : TASK_THREADS;
    const unsigned count = wanted < 1 ? 1 : wanted < PARALLEL_THREADS_MAX ? (unsigned)wanted : PARALLEL_THREADS_MAX;
    const int error = parallel_try(count, STACK_BYTES);
    char number[16];
    uv_work_t request;
    uv_loop_t loop;

    if (error)
        return error_set(err, STATUS_ERR_NO_MEMORY,
                         "the %u threads for the disk's work cannot be started (%s): memory is short, or the number of threads "
                         "is limited (ulimit -u, TasksMax of a service)",
                         count, strerror(error));
    if (uv_loop_init(&loop) != 0)
        return error_no_memory(err, "an event loop");
    snprintf(number, sizeof number, "%d", TASK_THREADS);
    if ((given || setenv(name, number, 1) == 0) && uv_queue_work(&loop, &request, nothing, NULL) == 0)
        uv_run(&loop, UV_RUN_DEFAULT);
    if (!given)
        (void)unsetenv(name);
    (void)uv_loop_close(&loop);
    return STATUS_OK;
}
