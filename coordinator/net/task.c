#include "coordinator/net/task.h"

#include <assert.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
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

static void on_end(uv_work_t *request, int code)
{
    struct task *task = request->data;

    (void)code; /* no task is ever cancelled */
    task->server->tasks--;
    task->kind->end(task);
    task_drop(task);
}

void task_start(struct task *task)
{
    int code = uv_queue_work(&task->server->loop, &task->request, on_run, on_end);

    assert(code == 0); /* it fails only for a NULL function */
    (void)code;
    task->server->tasks++;
}
