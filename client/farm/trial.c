#include "client/farm/trial.h"

#include <string.h>

#include "client/follow/fetch.h"
#include "client/follow/figures_view.h"
#include "client/follow/job_info.h"
#include "client/link/signals.h"
#include "client/farm/submission.h"
#include "client/follow/watch.h"
#include "client/farm/verb.h"
#include "common/system/clock.h"
#include "protocol/message.h"

enum { FIRST_LOOK_S = 5 };

static void take_figures(struct trial *out, const Azulejo__Wire__JobInfo *info, uint64_t pixels)
{
    const Azulejo__Wire__RenderStats *s = info->stats;

    out->wall_s = info->seconds_active;
    out->samples = (double)info->samples_done / (double)pixels;
    out->figures = figures_get(info->now ? info->now->figures : NULL);
    out->effects = info->error_effects;
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

/* The wait was ended: the job is no longer needed. A failure here does not concern the user. */
static void give_up(struct connection *c, uint64_t job)
{
    Azulejo__Wire__Envelope *answer = NULL;
    struct error ignored = {0};

    connection_set_watch(c, NULL, NULL);
    if (verb_ask(c, job, VERB_DISCARD, NULL, &answer, &ignored) == STATUS_OK)
        message_free(answer);
}

static status has_workers(struct connection *c, int *out, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT, *answer = NULL;
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    status result;

    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    question.worker_query = &query;
    result = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, err);
    if (result == STATUS_OK)
        *out = answer->worker_list->n_workers > 0;
    message_free(answer);
    return result;
}

/* Wait until the job has ended, checking for workers at growing intervals. */
static status wait_for(struct connection *c, uint64_t job, const struct trial_waiting *waiting,
                       Azulejo__Wire__Envelope **last, struct error *err)
{
    uint64_t patience_ns = (uint64_t)FIRST_LOOK_S * NS_PER_SECOND;

    for (;;) {
        status result = watch_job(c, job, 1, waiting ? clock_monotonic_ns() + patience_ns : 0, last, err);
        int some = 1;
        if (result != STATUS_ERR_TIMEOUT || !waiting)
            return result;
        TRY(has_workers(c, &some, err));
        if (!some)
            waiting->no_worker(waiting->user);
        patience_ns *= 2;
    }
}

status trial_render(struct connection *c, const struct import_result *scene, const struct job_request *request,
                    const char *name, const struct trial_waiting *waiting, struct trial *out, struct error *err)
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
    mine.frames = (struct frame_list){0};
    mine.settings.aovs = mine.stop.adaptive ? 1u << AOV_SAMPLES : 0;
    mine.schedule = (struct buffer)BUFFER_INIT;
    result = submission_send(c, scene, &mine, name, OUTPUT_FORMAT_EXR, 1, &accepted, err);
    job = accepted.job;
    THEN(result, wait_for(c, job, waiting, &last, err));
    if (result != STATUS_OK && job && signals_stop())
        give_up(c, job);
    if (result == STATUS_OK) {
        const Azulejo__Wire__JobInfo *info = job_list_find(last->job_list, job);
        result = job_info_verdict(info, err);
        if (result == STATUS_OK)
            take_figures(out, info, (uint64_t)mine.settings.width * mine.settings.height);
    }
    THEN(result, fetch_output(c, job, mine.first_frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR, &data, err));
    THEN(result, image_decode_hdr(&out->picture, data.data, data.size, name, &repairs, err));
    if (result == STATUS_OK && mine.settings.aovs)
        result = exr_decode_channel(&out->sampling, data.data, data.size, name, "samples.Y", err);
    message_free(last);
    buffer_release(&data);
    return result;
}

void trial_release(struct trial *t)
{
    image_release(&t->sampling);
    image_release(&t->picture);
    memset(t, 0, sizeof *t);
}

status trial_interrupted(void *user UNUSED, struct error *err)
{
    return signals_stop() ? error_set(err, STATUS_ERR_JOB_FAILED, "interrupted") : STATUS_OK;
}
