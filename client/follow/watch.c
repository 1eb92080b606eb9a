#include "client/follow/watch.h"

#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "client/follow/figures_view.h"
#include "client/terminal/format.h"
#include "client/follow/job_info.h"
#include "client/terminal/progress.h"
#include "client/terminal/table.h"
#include "common/base/buffer.h"
#include "common/cli/terminal.h"
#include "common/system/clock.h"
#include "protocol/message.h"

enum { INTERVAL_TERMINAL_MS = 250, INTERVAL_PLAIN_MS = 1000 };

/* How long it has been in work, or else since it was submitted. */
static double elapsed_s(const Azulejo__Wire__JobInfo *job)
{
    int64_t now_s = clock_wall_s();

    if (job->seconds_active > 0)
        return job->seconds_active;
    return now_s > job->submitted_at ? (double)(now_s - job->submitted_at) : 0;
}

/* "shot-40  1:07  " */
static void describe_name(struct buffer *line, const Azulejo__Wire__JobInfo *job)
{
    char name[256], number[FORMAT_SIZE];

    buffer_printf(line, "%s  %s  ", message_text(name, sizeof name, job->name),
                  format_duration(number, elapsed_s(job)));
}

/* What a line that is too short leaves out, in this order. The reason stays: a person can do something about it. */
enum telling { TELL_ALL, TELL_NO_PLACE, TELL_NO_NAME, TELL_REASON };

static void describe_waiting(struct buffer *line, const Azulejo__Wire__JobInfo *job, int named, enum telling telling)
{
    char note[JOB_NOTE_SIZE];

    if (named && telling < TELL_NO_NAME)
        describe_name(line, job);
    if (telling < TELL_REASON || !job->state_text[0])
        buffer_puts(line, job_state_word(job->state));
    if (named && telling < TELL_NO_PLACE && job->queue_position > 0 && job->state == AZULEJO__WIRE__JOB_STATE__JOB_QUEUED)
        buffer_printf(line, ", number %u in the queue", job->queue_position);
    if (job->state_text[0])
        buffer_printf(line, "%s%s", telling < TELL_REASON ? ": " : "", job_info_note(note, job));
}

/* For a line of so many columns, besides the percentage. */
static void describe(struct buffer *line, const Azulejo__Wire__JobInfo *job, int named, size_t columns)
{
    char number[FORMAT_SIZE], note[JOB_NOTE_SIZE];
    uint32_t frames = job->last_frame - job->first_frame + 1;
    size_t used;

    if (job->state != AZULEJO__WIRE__JOB_STATE__JOB_RUNNING) {
        for (int telling = TELL_ALL; telling <= TELL_REASON; telling++) {
            buffer_clear(line);
            describe_waiting(line, job, named, (enum telling)telling);
            if (text_columns(buffer_text(line)) <= columns || !job->state_text[0])
                break;
        }
        return;
    }
    if (named)
        describe_name(line, job);
    if (frames > 1)
        buffer_printf(line, "%u/%u frames, ", job->frames_done, frames);
    used = line->size;
    figures_describe_line(line, job, columns > used ? columns - used : 0);
    if (!job->now || !job->now->figures)
        buffer_printf(line, "%s%s samples/s, %u worker%s", line->size > used ? "  " : "",
                      format_count(number, job->samples_per_second), job->workers, job->workers == 1 ? "" : "s");
    if (job->state_text[0])
        buffer_printf(line, " (%s)", job_info_note(note, job));
}

/* A line for each worker: "  gpu-1 (node-12, process 4711)   32 threads   1.2 M samples/s   96 units". */
static status describe_workers(struct connection *c, uint64_t job, struct buffer *lines, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    Azulejo__Wire__Envelope *answer = NULL;

    query.job = job;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    envelope.worker_query = &query;
    TRY(connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, err));
    for (size_t i = 0; i < answer->worker_list->n_workers; i++) {
        const Azulejo__Wire__WorkerInfo *w = answer->worker_list->workers[i];
        char name[128], host[128], number[FORMAT_SIZE];
        buffer_printf(lines, "  %s (%s, process %u)   %u thread%s   %s samples/s   %u units\n",
                      message_text(name, sizeof name, w->name), message_text(host, sizeof host, w->host), w->process,
                      w->threads, w->threads == 1 ? "" : "s", format_count(number, w->samples_per_second),
                      w->units_leased);
    }
    message_free(answer);
    return STATUS_OK;
}

static status draw(struct connection *c, struct progress *progress, const Azulejo__Wire__JobInfo *job,
                   const struct watch_how *how, struct error *err)
{
    struct buffer line = BUFFER_INIT, lines = BUFFER_INIT;
    status s = STATUS_OK;

    describe(&line, job, how->named,
             progress->terminal ? terminal_columns(STDERR_FILENO) - 1 - strlen("100% ") : SIZE_MAX);
    if (how->workers && !how->quiet && job->workers > 0)
        s = describe_workers(c, job->job, &lines, err);
    if (s == STATUS_OK)
        progress_draw_lines(progress, job->done_share, buffer_text(&line), buffer_text(&lines));
    buffer_release(&lines);
    buffer_release(&line);
    return s;
}

static status start_watching(struct connection *c, uint64_t job, int terminal, uint64_t *request, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobWatch watch = AZULEJO__WIRE__JOB_WATCH__INIT;

    *request = connection_request_id(c);
    watch.job = job;
    watch.interval_ms = terminal ? INTERVAL_TERMINAL_MS : INTERVAL_PLAIN_MS;
    envelope.request = *request;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_WATCH;
    envelope.job_watch = &watch;
    return connection_send(c, &envelope, err);
}

status watch_job(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns, Azulejo__Wire__Envelope **last,
                 struct error *err)
{
    struct watch_how how = {.quiet = quiet, .deadline_ns = deadline_ns};

    return watch_job_as(c, job, &how, last, err);
}

status watch_job_as(struct connection *c, uint64_t job, const struct watch_how *how, Azulejo__Wire__Envelope **last,
                    struct error *err)
{
    Azulejo__Wire__Envelope *message = NULL;
    const Azulejo__Wire__JobInfo *info;
    struct progress progress;
    uint64_t request;
    status result;

    *last = NULL;
    progress_init(&progress, how->quiet);
    result = start_watching(c, job, progress.terminal, &request, err);
    while (result == STATUS_OK) {
        result = connection_receive(c, request, &message, err);
        if (result != STATUS_OK)
            break;
        info =
            message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST ? job_list_find(message->job_list, job) : NULL;
        if (!info) {
            result = error_set(err, STATUS_ERR_NOT_FOUND, "the coordinator has no job %" PRIu64 " any more", job);
            break;
        }
        if (how->update) {
            progress_clear(&progress); /* it may print */
            result = how->update(how->update_user, c, info, err);
            if (result != STATUS_OK)
                break;
        }
        if (job_state_ended(info->state)) {
            *last = message;
            message = NULL;
            break;
        }
        result = draw(c, &progress, info, how, err);
        message_free(message);
        message = NULL;
        if (result == STATUS_OK && how->deadline_ns && clock_monotonic_ns() >= how->deadline_ns)
            result = error_set(err, STATUS_ERR_TIMEOUT, "job %" PRIu64 " has not ended in time", job);
    }
    progress_clear(&progress);
    message_free(message);
    return result;
}
