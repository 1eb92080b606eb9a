/* azulejo prune: remove old jobs, or only their films. */
#include <time.h>

#include "client/commands/steer.h"
#include "client/follow/job_info.h"
#include "client/farm/verb.h"
#include "common/base/duration.h"
#include "protocol/message.h"

struct prune_options {
    const char *older_than;
    int films;
};

static status check(void *options, struct job_choice *choice, struct error *err)
{
    const struct prune_options *o = options;
    int64_t age_s;
    status result;

    if (!o->older_than)
        return STATUS_OK;
    result = duration_parse("--older-than", o->older_than, &age_s, err);
    if (result == STATUS_OK)
        choice->ended_before = (int64_t)time(NULL) - age_s + 1;
    return result;
}

static status ask_remove(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobRemove body = AZULEJO__WIRE__JOB_REMOVE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_REMOVE, job_remove, &body);

    body.job = job;
    body.unless_read = 1;
    return job_ask(c, &question, job, answer, err);
}

/* Of a job that has ended, discarding removes the kept films. */
static status ask_films(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobState state;

    TRY(job_query(c, job, answer, err));
    state = job_list_find((*answer)->job_list, job)->state;
    message_free(*answer);
    *answer = NULL;
    if (!job_state_ended(state)) /* it would be cancelled */
        return error_set(err, STATUS_ERR_REFUSED, "job %llu is %s: only films of jobs that have ended are removed",
                         (unsigned long long)job, job_state_word(state));
    return verb_ask(c, job, VERB_DISCARD, NULL, answer, err);
}

static status ask(struct connection *c, uint64_t job, const void *options, Azulejo__Wire__Envelope **answer,
                  struct error *err)
{
    return (((const struct prune_options *)options)->films ? ask_films : ask_remove)(c, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    static const struct steer_verb verb = {.verb = &job_verbs[VERB_REMOVE], .word = "prune", .past = "pruned",
                                           .check = check, .ask = ask, .outcome = "pruned"};
    struct prune_options options = {0};
    const struct option own[] = {
        {"older-than", 0, OPTION_STRING, &options.older_than, "TIME",
         "only jobs that ended so long ago, as in 12h or 30d (without a JOB: all of them)", 0, 0,
         NULL},
        {"films", 0, OPTION_FLAG, &options.films, NULL,
         "remove only the films: the pictures stay, but extend and retry cannot go on from them", 0,
         0, NULL},
        {0},
    };

    return steer_run(command, &verb, own, &options, argc, argv, exit_code, err);
}

const struct command command_prune = {
    .name = "prune",
    .group = COMMAND_JOBS,
    .usage = "azulejo prune [JOB]... [OPTION]...",
    .summary = "remove old jobs that have ended, or their films",
    .description = "Remove jobs that have ended from the coordinator, as 'remove' does, by their "
                   "age. A job whose pictures somebody\n"
                   "fetches just now stays.",
    .run = run,
};
