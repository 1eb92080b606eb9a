#include "coordinator/net/looks.h"

#include <stdio.h>

#include "coordinator/farm/develop.h"
#include "coordinator/job/frame.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session.h"
#include "coordinator/net/session_table.h"
#include "coordinator/net/task.h"

struct look_task {
    struct task task;
    uint32_t session;
    uint64_t request;
    uint32_t frame;
    struct development *development;
    struct buffer png;
    struct transfer_preview shows;
};

static void look_run(struct task *task)
{
    struct look_task *look = (struct look_task *)task;

    task->result = develop_encode(look->development, task->server->store, NULL, &look->png, &task->error);
}

static void look_end(struct task *task)
{
    struct look_task *look = (struct look_task *)task;
    struct session *session = session_find(task->server, look->session);
    struct preview_file *file = NULL;
    char name[64];

    task->server->previews--;
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

static const struct task_kind look_kind = {"a preview", sizeof(struct look_task), look_run, look_end, look_release};

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
    s = frame ? development_new_preview(&look->development, frame, err)
              : development_new_stored(&look->development, job, number, err);
    if (s != STATUS_OK) {
        task_drop(&look->task);
        return s;
    }
    development_look(look->development, output);
    look->session = session->id;
    look->request = request;
    look->frame = number;
    look->shows = frame ? film_shows(frame->film) : *shows;
    server->previews++;
    task_start(&look->task);
    return STATUS_OK;
}
