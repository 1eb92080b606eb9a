#include "client/farm/watch.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/farm/figures_view.h"
#include "client/terminal/format.h"
#include "client/farm/job_info.h"
#include "client/terminal/progress.h"
#include "common/base/buffer.h"
#include "common/base/clock.h"
#include "protocol/message.h"

enum { INTERVAL_TERMINAL_MS = 250, INTERVAL_PLAIN_MS = 1000 };

static double fraction_of(const Azulejo__Wire__JobInfo *job)
{
    int ends_by_rule = job->stop && (job->stop->measure || job->stop->time_limit_ms ||
                                     job->stop->core_limit_ms);

    if (ends_by_rule) /* the number of samples needed is not known */
        return job->seconds_left >= 0 && job->seconds_active > 0
                   ? job->seconds_active / (job->seconds_active + job->seconds_left)
                   : 0;
    if (job->samples_total == 0)
        return 0;
    return (double)job->samples_done / (double)job->samples_total;
}

static void describe(struct buffer *line, const Azulejo__Wire__JobInfo *job)
{
    char number[FORMAT_SIZE], note[JOB_NOTE_SIZE];
    uint32_t frames = job->last_frame - job->first_frame + 1;
    size_t before;

    if (job->state != AZULEJO__WIRE__JOB_STATE__JOB_RUNNING) {
        buffer_puts(line, job_state_name(job->state));
        if (job->state_text[0])
            buffer_printf(line, ": %s", job_info_note(note, job));
        return;
    }
    if (frames > 1)
        buffer_printf(line, "%u/%u frames, ", job->frames_done, frames);
    if (job->seconds_left >= 0)
        buffer_printf(line, "%s left, ", format_duration(number, job->seconds_left));
    before = line->size;
    figures_describe_curve(line, job);
    if (line->size == before)
        buffer_printf(line, "%s samples/s, %u worker%s",
                      format_count(number, job->samples_per_second), job->workers,
                      job->workers == 1 ? "" : "s");
    if (job->state_text[0])
        buffer_printf(line, " (%s)", job->state_text);
}

static void draw(struct progress *progress, const Azulejo__Wire__JobInfo *job)
{
    struct buffer line = BUFFER_INIT;

    describe(&line, job);
    progress_draw(progress, fraction_of(job), buffer_text(&line));
    buffer_release(&line);
}

static status start_watching(struct connection *c, uint64_t job, int terminal, uint64_t *request,
                             struct error *err)
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

status watch_job(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns,
                 Azulejo__Wire__Envelope **last, struct error *err)
{
    Azulejo__Wire__Envelope *message = NULL;
    const Azulejo__Wire__JobInfo *info;
    struct progress progress;
    uint64_t request;
    status result;

    *last = NULL;
    progress_init(&progress, quiet);
    result = start_watching(c, job, progress.terminal, &request, err);
    while (result == STATUS_OK) {
        result = connection_receive(c, request, &message, err);
        if (result != STATUS_OK)
            break;
        info = message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST
                   ? job_list_find(message->job_list, job)
                   : NULL;
        if (!info) {
            result = error_set(err, STATUS_ERR_NOT_FOUND,
                               "the coordinator has no job %" PRIu64 " any more", job);
            break;
        }
        if (job_state_is_final(info->state)) {
            *last = message;
            message = NULL;
            break;
        }
        draw(&progress, info);
        message_free(message);
        message = NULL;
        if (deadline_ns && clock_monotonic_ns() >= deadline_ns)
            result = error_set(err, STATUS_ERR_TIMEOUT, "job %" PRIu64 " has not ended in time",
                               job);
    }
    progress_clear(&progress);
    message_free(message);
    return result;
}
