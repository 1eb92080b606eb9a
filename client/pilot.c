#include "client/pilot.h"

#include "client/fetch.h"
#include "client/job_info.h"
#include "client/submission.h"
#include "client/watch.h"
#include "protocol/message.h"

static status run_trial(struct connection *c, const struct import_result *scene,
                        const struct job_request *request, struct pilot_trial *trial, int first,
                        struct error *err)
{
    struct job_request mine = *request;
    struct buffer data = BUFFER_INIT;
    Azulejo__Wire__Envelope *last = NULL;
    const Azulejo__Wire__JobInfo *info;
    struct image_repairs repairs = {0};
    uint64_t job = 0;
    status result;

    mine.settings.without |= trial->without;
    result = submission_send(c, scene, &mine, "pilot", OUTPUT_FORMAT_EXR, 1, &job, err);
    if (result == STATUS_OK)
        result = watch_job(c, job, 1, 0, &last, err);
    if (result == STATUS_OK) {
        info = job_list_find(last->job_list, job);
        result = job_info_verdict(info, err);
        if (result == STATUS_OK && info->stats) {
            double cpu_s = (double)info->stats->cpu_ns * 1e-9;
            if (first || cpu_s < trial->cpu_s)
                trial->cpu_s = cpu_s;
        }
    }
    if (result == STATUS_OK && first)
        result = fetch_output(c, job, mine.first_frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR,
                              &data, err);
    if (result == STATUS_OK && first)
        result = image_decode_hdr(&trial->picture, data.data, data.size, "pilot", &repairs, err);
    message_free(last);
    buffer_release(&data);
    return result;
}

status pilot_run(struct connection *c, const struct import_result *scene,
                 const struct job_request *request, struct pilot_trial *trials, size_t count,
                 unsigned runs, struct error *err)
{
    status result = STATUS_OK;

    for (unsigned run = 0; run < runs; run++)
        for (size_t i = 0; i < count && result == STATUS_OK; i++)
            result = run_trial(c, scene, request, &trials[i], run == 0, err);
    return result;
}
