#include "client/trial.h"

#include <string.h>

#include "client/cancel.h"
#include "client/fetch.h"
#include "client/job_info.h"
#include "client/signals.h"
#include "client/submission.h"
#include "client/watch.h"
#include "protocol/message.h"

static void take_figures(struct trial *out, const Azulejo__Wire__JobInfo *info, uint64_t pixels)
{
    const Azulejo__Wire__RenderStats *s = info->stats;

    out->wall_s = info->seconds_active;
    out->samples = (double)info->samples_done / (double)pixels;
    if (info->work) {
        const double light = info->work->clamped_luminance + info->work->kept_luminance;
        out->rays = (double)info->work->rays;
        out->clamped_share = light > 0 ? info->work->clamped_luminance / light : 0;
    }
    if (s) {
        out->core_s = (double)s->cpu_ns * 1e-9;
        out->trace_s = (double)s->trace_ns * 1e-9;
    }
}

/* The waiting was ended: nobody wants the job any more. What this cannot do is of no use to the user. */
static void give_up(struct connection *c, uint64_t job)
{
    Azulejo__Wire__Envelope *answer = NULL;
    struct error ignored = {0};

    connection_set_watch(c, NULL, NULL);
    if (cancel_job(c, job, 1, &answer, &ignored) == STATUS_OK)
        message_free(answer);
}

status trial_render(struct connection *c, const struct import_result *scene,
                    const struct job_request *request, const char *name, struct trial *out,
                    struct error *err)
{
    struct job_request mine = *request;
    struct buffer data = BUFFER_INIT;
    Azulejo__Wire__Envelope *last = NULL;
    struct image_repairs repairs = {0};
    struct job_accepted accepted = {0};
    uint64_t job = 0;
    status result;

    memset(out, 0, sizeof *out);
    mine.last_frame = mine.first_frame;
    mine.token[0] = 0;
    mine.settings.aovs = 0;
    mine.stop = (struct stop_rules){0}; /* trials of equal samples are compared */
    mine.schedule = (struct buffer)BUFFER_INIT;
    result = submission_send(c, scene, &mine, name, OUTPUT_FORMAT_EXR, 1, &accepted, err);
    job = accepted.job;
    if (result == STATUS_OK)
        result = watch_job(c, job, 1, 0, &last, err);
    if (result != STATUS_OK && job && signals_stop())
        give_up(c, job);
    if (result == STATUS_OK) {
        const Azulejo__Wire__JobInfo *info = job_list_find(last->job_list, job);
        result = job_info_verdict(info, err);
        if (result == STATUS_OK)
            take_figures(out, info, (uint64_t)mine.settings.width * mine.settings.height);
    }
    if (result == STATUS_OK)
        result = fetch_output(c, job, mine.first_frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR, &data, err);
    if (result == STATUS_OK)
        result = image_decode_hdr(&out->picture, data.data, data.size, name, &repairs, err);
    message_free(last);
    buffer_release(&data);
    return result;
}

void trial_release(struct trial *t)
{
    image_release(&t->picture);
    memset(t, 0, sizeof *t);
}

status trial_interrupted(void *user, struct error *err)
{
    (void)user;
    return signals_stop() ? error_set(err, STATUS_ERR_JOB_FAILED, "interrupted") : STATUS_OK;
}
