#include "client/follow/job_info.h"

#include <inttypes.h>
#include <string.h>

#include "client/follow/cut_frame.h"
#include "client/follow/figures_view.h"
#include "client/terminal/field.h"
#include "client/terminal/format.h"
#include "client/terminal/moment.h"
#include "client/options/output.h"
#include "common/system/clock.h"
#include "common/scene/settings.h"
#include "protocol/message.h"

const char *job_info_note(char out[JOB_NOTE_SIZE], const Azulejo__Wire__JobInfo *job)
{
    char when[FORMAT_SIZE], comment[JOB_NOTE_SIZE / 2];
    size_t used;

    if (job->waits_until)
        snprintf(out, JOB_NOTE_SIZE, "waits until %s", moment_text(when, job->waits_until, clock_wall_s()));
    else
        message_text(out, JOB_NOTE_SIZE, job->state_text);
    used = strlen(out);
    if (job->comment[0])
        snprintf(out + used, JOB_NOTE_SIZE - used, "%scomment: %s", used ? "; " : "",
                 message_text(comment, sizeof comment, job->comment));
    return out;
}

const Azulejo__Wire__JobInfo *job_list_find(const Azulejo__Wire__JobList *list, uint64_t job)
{
    for (size_t i = 0; i < list->n_jobs; i++)
        if (list->jobs[i]->job == job)
            return list->jobs[i];
    return NULL;
}

status job_ask(struct connection *c, Azulejo__Wire__Envelope *question, uint64_t job, Azulejo__Wire__Envelope **out,
               struct error *err)
{
    status result = connection_ask(c, question, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST, out, err);

    if (result == STATUS_OK && job && !job_list_find((*out)->job_list, job)) {
        message_free(*out);
        *out = NULL;
        result = error_set(err, STATUS_ERR_NOT_FOUND,
                           "there is no job %" PRIu64 " ('azulejo list' shows which there are)", job);
    }
    return result;
}

status job_query(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **out, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;

    query.job = job;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY;
    envelope.job_query = &query;
    return job_ask(c, &envelope, job, out, err);
}

status frame_choice_of_job(struct connection *c, uint64_t job, const struct frame_choice *choice,
                           struct frame_list *out, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result;

    *out = (struct frame_list){0};
    if (!choice->list && !choice->first_middle_last)
        return STATUS_OK;
    TRY(job_query(c, job, &answer, err));
    info = job_list_find(answer->job_list, job);
    result = frame_choice_of(choice, info->first_frame, info->last_frame, out, err);
    message_free(answer);
    return result;
}

/* ---- health ---------------------------------------------------------------------------------- */

/* What was counted; nothing is known of what went wrong where that does not fit. */
static struct unit_work job_work(const Azulejo__Wire__JobInfo *job)
{
    struct unit_work work;
    struct error unused;

    if (wire_work_get(&work, job->work, &unused) != STATUS_OK)
        memset(&work.health, 0, sizeof work.health);
    return work;
}

/* Where the job's pixels are in the whole picture. */
static struct tile_rect job_rect(const Azulejo__Wire__JobInfo *job)
{
    const Azulejo__Wire__RenderSettings *s = job->settings;

    return s ? (struct tile_rect){s->region_x, s->region_y, s->width, s->height} : (struct tile_rect){0, 0, 0, 0};
}

static void print_health(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    const struct unit_work work = job_work(job);
    char line[HEALTH_TEXT_SIZE];

    for (int k = 0; k < HEALTH_KINDS && job->settings; k++) {
        if (!health_is_told(&work.health, (enum health_kind)k, work.samples))
            continue;
        field_print(out, "health",
                    health_text(line, &work.health, (enum health_kind)k, job_rect(job), job->last_frame > job->first_frame));
        field_print(out, "", health_rows[k].remedy);
    }
}

/* What longer paths would have brought, where it can be seen. */
static void print_depth(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    struct depth_report report = {0};
    char line[DEPTH_TEXT_SIZE];

    if (job->ended_by_depth)
        report = (struct depth_report){job->ended_by_depth->share, job->ended_by_depth->deeper,
                                       job->ended_by_depth->deeper_share};
    if (report.share > DEPTH_SHARE_TOLD && job->settings)
        field_print(out, "depth", depth_report_text(line, &report, job->settings->max_depth));
}

void job_info_print_summary(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    char a[FORMAT_SIZE], b[FORMAT_SIZE], c[FORMAT_SIZE];
    char line[512];
    uint32_t frames = job->last_frame - job->first_frame + 1;

    snprintf(line, sizeof line, "%u of %u", job->frames_done, frames);
    field_print(out, "frames", line);
    if (job->seconds_active > 0)
        snprintf(line, sizeof line, "%s in %s, %s/s", format_count(a, (double)job->samples_done),
                 format_duration(b, job->seconds_active),
                 format_count(c, (double)job->samples_done / job->seconds_active));
    else
        snprintf(line, sizeof line, "%s", format_count(a, (double)job->samples_done));
    field_print_phrases(out, "samples", line);
    if (job->stats && job->work && job->work->rays) {
        snprintf(line, sizeof line, "%s, %.1f a sample, %s of processor time", format_count(a, (double)job->work->rays),
                 (double)job->work->rays / (double)(job->work->samples ? job->work->samples : 1),
                 format_duration(b, (double)job->stats->cpu_ns * 1e-9));
        field_print_phrases(out, "rays", line);
    }
    for (size_t i = 0; i < job->n_cut_frames; i++)
        field_print_phrases(out, cut_frame_is_cancelled(job->cut_frames[i]) ? "cut short" : "ended",
                            cut_frame_text(line, job, job->cut_frames[i]));
    figures_print(out, job);
    print_health(out, job);
    print_depth(out, job);
    if (job->work && job->settings && job->settings->clamp > 0) {
        const struct unit_work work = job_work(job);
        snprintf(line, sizeof line,
                 "%" PRIu64 " samples were above %g and are scaled down to it: the picture lacks %.3g %% "
                 "of its light",
                 work.clamped_samples, (double)job->settings->clamp, 100 * unit_work_clamped_share(&work));
        field_print(out, "clamped", line);
    }
    if (job->develop_error[0])
        field_print(out, "pictures", job->develop_error);
    else if (job->output && output_message_formats(job->output) & ~(unsigned)OUTPUT_FORMAT_EXR &&
             job->frames_developed < job->frames_done) {
        snprintf(line, sizeof line, "of %u of %u finished frames are made", job->frames_developed, job->frames_done);
        field_print(out, "pictures", line);
    }
    if (job->conflicts) {
        snprintf(line, sizeof line,
                 "%" PRIu64 " results differed from ones already merged: a worker computes wrong results "
                 "(see the coordinator's log)",
                 job->conflicts);
        field_print(out, "conflicts", line);
    }
}

status job_info_verdict(const Azulejo__Wire__JobInfo *job, struct error *err)
{
    char why[512];

    if (job->state != AZULEJO__WIRE__JOB_STATE__JOB_FAILED && job->state != AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED)
        return STATUS_OK;
    message_text(why, sizeof why, job->state_text);
    if (strcmp(why, job_state_word(job->state)) == 0)
        why[0] = 0; /* "was cancelled: cancelled" */
    return error_set(err, STATUS_ERR_JOB_FAILED, "job %" PRIu64 " %s%s%s", job->job,
                     job->state == AZULEJO__WIRE__JOB_STATE__JOB_FAILED ? "failed" : "was cancelled",
                     why[0] ? ": " : "", why);
}

status job_info_missed(const Azulejo__Wire__JobInfo *job, struct error *err)
{
    char why[512];

    if (job->missed == 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_INCOMPLETE, "job %" PRIu64 ": %s", job->job,
                     message_text(why, sizeof why, job->state_text));
}
