/* azulejo cancel: end jobs. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/steer.h"
#include "client/follow/cut_frame.h"
#include "client/follow/job_info.h"
#include "client/link/signals.h"
#include "client/follow/watch.h"
#include "common/system/clock.h"
#include "protocol/message.h"

/* How long to wait for the pictures. They are made even if the wait ends. */
enum { WAIT_LIMIT_MS = 30000 };

static status stop_wanted(void *user UNUSED, struct error *err)
{
    if (!signals_stop())
        return STATUS_OK;
    return error_set(err, STATUS_ERR_JOB_FAILED, "detached; the job is still being cancelled");
}

/* Wait until the job has ended, and replace *answer by a later one. */
static status await_end(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **answer, struct error *err)
{
    status result = signals_catch(err);

    if (result != STATUS_OK || job_state_ended(job_list_find((*answer)->job_list, job)->state))
        return result;
    message_free(*answer);
    *answer = NULL;
    connection_set_watch(c, stop_wanted, NULL);
    result = watch_job(c, job, 1, clock_monotonic_ns() + WAIT_LIMIT_MS * NS_PER_MS, answer, err);
    if (result == STATUS_ERR_TIMEOUT)
        result = job_query(c, job, answer, err);
    return result;
}

static void print(const Azulejo__Wire__JobInfo *info)
{
    char text[512];
    const char *why = message_text(text, sizeof text, info->state_text);

    if (info->state == AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED && why[0])
        printf("job %" PRIu64 ": %s", info->job, why); /* it begins with the state */
    else
        printf("job %" PRIu64 ": %s", info->job, job_state_word(info->state));
    if (!job_state_ended(info->state) && why[0])
        printf(": %s", why);
    printf("\n");
    for (size_t i = 0; i < info->n_cut_frames; i++)
        printf("  %s\n", cut_frame_text(text, info, info->cut_frames[i]));
    if (info->frames_done > 0)
        printf("  'azulejo fetch %" PRIu64 "' brings the pictures\n", info->job);
}

status cancel_command(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    return verb_run(command, await_end, print, argc, argv, exit_code, err);
}
