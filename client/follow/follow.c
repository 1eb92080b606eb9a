#include "client/follow/follow.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/follow/job_info.h"
#include "client/link/signals.h"
#include "common/system/clock.h"
#include "protocol/message.h"

static status stop_wanted(void *user, struct error *err)
{
    uint64_t job = *(const uint64_t *)user;

    if (!signals_stop())
        return STATUS_OK;
    return error_set(err, STATUS_ERR_JOB_FAILED,
                     "detached; job %" PRIu64 " continues ('azulejo watch %" PRIu64
                     "' shows it again, 'azulejo cancel %" PRIu64 "' ends it)",
                     job, job, job);
}

static void print_ending(const Azulejo__Wire__JobInfo *info)
{
    char name[256];

    printf("job %" PRIu64 " (%s): %s\n", info->job, message_text(name, sizeof name, info->name),
           job_state_word(info->state));
    job_info_print_summary(stdout, info);
    if (info->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE)
        printf("  %-10s  'azulejo fetch %" PRIu64 "' brings the pictures\n", "outputs", info->job);
}

/* Watch until the job has ended, over as many connections as needed. */
static status watch_through(struct connection **c, uint64_t job, const struct follow *how,
                            Azulejo__Wire__Envelope **last, struct error *err)
{
    uint64_t limit_ns = (uint64_t)(how->limit_s * 1e9);
    struct reconnect again = {.where = how->where, .patience_s = how->reconnect_s,
                              .deadline_ns = limit_ns ? clock_monotonic_ns() + limit_ns : 0,
                              .quiet = how->quiet};
    struct watch_how watch = {.quiet = how->quiet, .named = 1, .workers = how->workers,
                              .deadline_ns = again.deadline_ns,
                              .update = how->update, .update_user = how->update_user};
    status result;

    again.where.watch = stop_wanted;
    again.where.watch_user = &job;
    connection_set_watch(*c, stop_wanted, &job);
    do {
        result = watch_job_as(*c, job, &watch, last, err);
        if (result == STATUS_OK || !reconnect_is_loss(result))
            break;
        if (!again.deadline_ns || clock_monotonic_ns() < again.deadline_ns)
            result = reconnect(c, &again, err);
    } while (result == STATUS_OK);
    if (*c)
        connection_set_watch(*c, NULL, NULL); /* `job` is ours */
    if (result == STATUS_ERR_TIMEOUT && again.deadline_ns && clock_monotonic_ns() >= again.deadline_ns)
        result =
            error_set(err, result, "job %" PRIu64 " has not ended within %g seconds; it continues", job, how->limit_s);
    return result;
}

status follow_wait(struct connection **c, uint64_t job, const struct follow *how, Azulejo__Wire__Envelope **last,
                   struct error *err)
{
    status result = signals_catch(err);

    *last = NULL;
    return result == STATUS_OK ? watch_through(c, job, how, last, err) : result;
}

status follow_job(struct connection **c, uint64_t job, const struct follow *how, struct error *err)
{
    Azulejo__Wire__Envelope *last = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result = follow_wait(c, job, how, &last, err);

    if (result != STATUS_OK)
        return result;
    info = job_list_find(last->job_list, job);
    if (how->json)
        result = json_print(json_message(&info->base), err);
    else if (!how->quiet)
        print_ending(info);
    THEN(result, job_info_verdict(info, err));
    THEN(result, job_info_missed(info, err));
    message_free(last);
    return result;
}
