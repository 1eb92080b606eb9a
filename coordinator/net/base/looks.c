#include "coordinator/net/base/looks.h"

#include <stdio.h>

#include "coordinator/pictures/develop.h"
#include "coordinator/frame/frame.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session.h"
#include "coordinator/net/base/previews.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"

struct look_task {
    struct task task;
    uint32_t session;
    uint64_t request, holder;
    uint32_t frame;
    struct development *development;
    struct job_frame *taken_of; /* while its film is copied */
    struct buffer png;
    struct transfer_preview shows;
};

static void look_run(struct task *task)
{
    struct look_task *look = (struct look_task *)task;

    task->result = develop_encode(look->development, task->server->store, NULL, &look->png, &task->error);
}

static int look_prepare(struct task *task)
{
    struct look_task *look = (struct look_task *)task;
    int more = development_take(look->development);

    if (!more)
        farm_frame_unpin(&task->server->farm, look->taken_of);
    return more;
}

static void look_end(struct task *task)
{
    struct look_task *look = (struct look_task *)task;
    struct session *session = session_find(task->server, look->session);
    struct preview_file *file = NULL;
    char name[64];

    previews_ended(task->server, look->holder);
    if (!session || session->state != SESSION_OPEN)
        return;
    if (task->result == STATUS_OK && !(file = preview_file_new(&look->png)))
        task->result = error_no_memory(&task->error, "a preview");
    snprintf(name, sizeof name, "frame-%04u-preview.png", look->frame);
    if (task->result == STATUS_OK)
        task->result = transfer_bytes(&session->transfers, look->request, file, name, &look->shows, &task->error);
    preview_file_drop(file);
    if (task->result != STATUS_OK)
        session_fail(session, look->request, &task->error);
    transfers_pump(&session->transfers, session->channel);
}

static void look_release(struct task *task)
{
    struct look_task *look = (struct look_task *)task;

    development_free(look->development);
    buffer_release(&look->png);
}

static const struct task_kind look_kind = {"a preview", sizeof(struct look_task), look_run, look_end, look_release, 0};

/* Of a frame in work: what its film has. */
static struct transfer_preview film_shows(const struct film *film)
{
    double pixels = (double)film_width(film) * film_height(film);

    return (struct transfer_preview){film_covered_share(film), (double)film_samples(film) / pixels};
}

status looks_ask(struct session *session, uint64_t request, const struct job *job, uint32_t number,
                 struct job_frame *frame, const struct output_settings *output, const struct transfer_preview *shows,
                 struct error *err)
{
    struct server *server = session->server;
    struct look_task *look;
    status s;

    if (server->previews >= PREVIEWS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d previews are being made; try again in a second", PREVIEWS_MAX);
    look = task_new(server, &look_kind, err);
    if (!look)
        return STATUS_ERR_NO_MEMORY;
    s = holders_preview_begin(&server->holders, session->holder, session->may, err);
    if (s != STATUS_OK) {
        task_drop(&look->task);
        return s;
    }
    s = frame ? development_new_preview(&look->development, frame, output, err)
              : development_new_stored(&look->development, job, number, err);
    if (s != STATUS_OK) {
        holders_preview_end(&server->holders, session->holder);
        task_drop(&look->task);
        return s;
    }
    look->holder = session->holder;
    if (!frame)
        development_look(look->development, output);
    look->session = session->id;
    look->request = request;
    look->frame = number;
    look->shows = frame ? film_shows(frame->film) : *shows;
    server->previews++;
    look->taken_of = frame;
    if (frame) {
        farm_frame_pin(frame);
        task_prepare(&look->task, look_prepare);
    } else {
        task_start(&look->task);
    }
    return STATUS_OK;
}
