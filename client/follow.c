#include "client/follow.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/job_info.h"
#include "client/signals.h"
#include "client/watch.h"
#include "protocol/message.h"

static status stop_wanted(void *user, struct error *err)
{
    uint64_t job = *(const uint64_t *)user;

    if (!signals_stop())
        return STATUS_OK;
    return error_set(err, STATUS_ERR_JOB_FAILED,
                     "detached; job %" PRIu64 " goes on ('azulejo watch %" PRIu64
                     "' shows it again, 'azulejo cancel %" PRIu64 "' ends it)",
                     job, job, job);
}

static void print_ending(const Azulejo__Wire__JobInfo *info)
{
    char name[256];

    printf("job %" PRIu64 " (%s): %s\n", info->job, message_text(name, sizeof name, info->name),
           job_state_name(info->state));
    job_info_print_summary(stdout, info);
    if (info->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE)
        printf("  %-10s  'azulejo fetch %" PRIu64 "' brings the pictures\n", "outputs", info->job);
}

status follow_job(struct connection *c, uint64_t job, int quiet, int json, double limit_s,
                  struct error *err)
{
    Azulejo__Wire__Envelope *last = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result = signals_catch(err);

    if (result != STATUS_OK)
        return result;
    connection_set_watch(c, stop_wanted, &job);
    result = watch_job(c, job, quiet, limit_s, &last, err);
    if (result != STATUS_OK)
        return result;
    info = job_list_find(last->job_list, job);
    if (json)
        result = json_print(job_info_json(info), err);
    else if (!quiet)
        print_ending(info);
    if (result == STATUS_OK)
        result = job_info_verdict(info, err);
    message_free(last);
    return result;
}
