#include "client/commands/steer.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/follow/job_info.h"
#include "protocol/message.h"

static void print_one(const struct steer_verb *verb, const Azulejo__Wire__JobInfo *info, const void *options)
{
    char text[JOB_NOTE_SIZE];

    printf("job %" PRIu64 ": %s", info->job, verb->outcome ? verb->outcome : job_state_word(info->state));
    if (!verb->outcome && !job_state_ended(info->state) && info->state_text[0])
        printf(": %s", job_info_note(text, info));
    printf("\n");
    if (verb->print)
        verb->print(options);
}

/* What happened to each job. */
struct outcomes {
    int several;
    json_t *jobs, *failed;
    status first;     /* failure */
    struct error why; /* of it */
    size_t done;
    int not_stored; /* of some the coordinator's disk does not have it yet */
};

static status one(struct connection *c, const struct steer_verb *verb, uint64_t job, const void *options, int json,
                  struct outcomes *out)
{
    Azulejo__Wire__Envelope *answer = NULL;
    struct error why = {0};
    status result = verb->ask(c, job, options, &answer, &why);

    if (result == STATUS_OK && verb->settle && !out->several)
        result = verb->settle(c, job, &answer, &why);
    if (result == STATUS_OK) {
        const Azulejo__Wire__JobInfo *info = job_list_find(answer->job_list, job);
        out->done++;
        out->not_stored |= info->not_stored;
        if (json)
            json_array_append_new(out->jobs, json_message(&info->base));
        else if (verb->show && !out->several)
            verb->show(info);
        else
            print_one(verb, info, options);
        message_free(answer);
        return STATUS_OK;
    }
    message_free(answer);
    if (out->first == STATUS_OK) {
        out->first = result;
        out->why = why;
    }
    json_array_append_new(out->failed, json_pack("{s:I, s:o}", "job", (json_int_t)job, "error", json_text(why.text)));
    return result;
}

/* Is the failure about this job only? */
static int is_of_the_job(status code)
{
    return code == STATUS_ERR_REFUSED || code == STATUS_ERR_NOT_FOUND || code == STATUS_ERR_INPUT ||
           code == STATUS_ERR_USAGE;
}

static status all(struct connection *c, const struct steer_verb *verb, const struct chosen_jobs *jobs,
                  const void *options, int json, struct outcomes *out, struct error *err)
{
    for (size_t i = 0; i < jobs->count; i++) {
        size_t failed = json_array_size(out->failed);
        status result = one(c, verb, jobs->items[i].job, options, json, out);

        if (json_array_size(out->failed) > failed && jobs->several && is_of_the_job(result)) {
            if (!json)
                fprintf(stderr, "%s\n",
                        json_string_value(json_object_get(json_array_get(out->failed, failed), "error")));
        } else if (result != STATUS_OK) {
            return error_set(err, result, "%s", out->why.text);
        }
    }
    return STATUS_OK;
}

static status report(const struct chosen_jobs *jobs, struct outcomes *out, struct error *err)
{
    if (!jobs->several)
        return json_print(json_incref(json_array_get(out->jobs, 0)), err);
    return json_print(json_pack("{s:O, s:O}", "jobs", out->jobs, "failed", out->failed), err);
}

static status steer_jobs(const struct steer_verb *verb, const struct job_choice *choice, const struct positionals *rest,
                         const struct connection_options *where, const void *options, int json, int *exit_code,
                         struct error *err)
{
    struct outcomes out = {.jobs = json_array(), .failed = json_array()};
    struct chosen_jobs jobs = {0};
    struct connection *c = NULL;
    int go_on = 0;
    status result = connection_open(&c, where, err);

    THEN(result, job_choice_find(c, choice, rest, &jobs, err));
    THEN(result, job_choice_confirm(choice, &jobs, verb->word                ? verb->word
                                                    : verb->verb->imperative ? verb->verb->imperative
                                                                             : verb->verb->name, &go_on, err));
    if (result == STATUS_OK && !go_on)
        fprintf(stderr, "nothing was changed\n");
    out.several = jobs.several;
    if (result == STATUS_OK && go_on)
        result = all(c, verb, &jobs, options, json, &out, err);
    if (result == STATUS_OK && json && go_on)
        result = report(&jobs, &out, err);
    if (result == STATUS_OK && out.first != STATUS_OK) {
        fprintf(stderr, "%zu of %zu jobs: not done\n", json_array_size(out.failed), jobs.count);
        *exit_code = status_exit_code(out.first);
    } else if (result == STATUS_OK && out.not_stored) {
        fprintf(stderr, "done, but not stored yet: the coordinator cannot write to its disk, and a restart now would lose it\n");
        *exit_code = status_exit_code(STATUS_ERR_NOT_STORED);
    }
    json_decref(out.jobs);
    json_decref(out.failed);
    chosen_jobs_release(&jobs);
    connection_close(c);
    return result;
}

status steer_run(const struct command *command, const struct steer_verb *verb, const struct option *own, void *options,
                 int argc, char *const *argv, int *exit_code, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {.verb = verb->verb};
    int json = 0, done;
    char yes_help[64];
    const struct option common[] = {
        JOB_CHOICE_ROWS(choice, yes_help),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct option table[STEER_OWN_MAX + sizeof common / sizeof *common];
    size_t own_count = 0;
    struct positionals rest;
    status result;

    snprintf(yes_help, sizeof yes_help, JOB_CHOICE_YES_HELP("%s"), verb->past ? verb->past : verb->verb->past);
    for (; own && own[own_count].name; own_count++) {
        assert(own_count < STEER_OWN_MAX);
        table[own_count] = own[own_count];
    }
    memcpy(table + own_count, common, sizeof common);
    result = command_parse(command, table, argc, argv, verb->text != NULL, OPTIONS_POSITIONAL_MAX, &rest, &done, err);
    if (result != STATUS_OK || done)
        return result;
    if (verb->text)
        *verb->text = rest.items[--rest.count];
    if (verb->check)
        result = verb->check(options, &choice, err);
    THEN(result, job_choice_check(&choice, &rest, err));
    THEN(result, steer_jobs(verb, &choice, &rest, &where, options, json, exit_code, err));
    return result;
}
