/* The commands of common/schema/verbs.h: each verb's help, and what those do that need no file of their own. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/steer.h"
#include "client/follow/job_info.h"
#include "client/farm/verb.h"

struct options {
    const struct job_verb *verb; /* or the variant that was chosen */
    struct verb_argument argument;
    struct frame_choice frames;
    int flag;
};

static status check(void *options, struct job_choice *choice, struct error *err)
{
    struct options *o = options;

    if (o->verb->takes == VERB_TAKES_NUMBER && o->argument.number > o->verb->most)
        return error_set(err, STATUS_ERR_USAGE, "which %s? Give --%s %s", o->verb->field, o->verb->option,
                         o->verb->placeholder);
    if (o->frames.list || o->frames.first_middle_last || o->flag)
        o->verb = job_verb_variant(o->verb);
    choice->verb = o->verb;
    return frame_choice_check(&o->frames, err);
}

static status ask(struct connection *c, uint64_t job, const void *options, Azulejo__Wire__Envelope **answer,
                  struct error *err)
{
    const struct options *o = options;
    struct verb_argument argument = o->argument;
    status result = frame_choice_of_job(c, job, &o->frames, &argument.frames, err);

    THEN(result, verb_ask(c, job, (enum job_verb_name)(o->verb - job_verbs), &argument, answer, err));
    frame_list_free(&argument.frames);
    return result;
}

static void print(const void *options)
{
    const struct options *o = options;

    if (o->verb->takes == VERB_TAKES_NUMBER)
        printf("  %s %" PRId64 "\n", o->verb->field, o->argument.number);
}

status verb_run(const struct command *command, steer_settle *settle, void (*show)(const Azulejo__Wire__JobInfo *info),
                int argc, char *const *argv, int *exit_code, struct error *err)
{
    const struct job_verb *verb = job_verb_find(command->name), *variant = job_verb_variant(verb);
    struct options o = {.verb = verb, .argument.number = verb->most + 1};
    const struct steer_verb how = {.verb = verb, .check = check, .ask = ask, .print = print, .settle = settle, .show = show,
                                   .text = verb->takes == VERB_TAKES_TEXT ? &o.argument.text : NULL,
                                   .outcome = verb->removes ? verb->past : NULL};
    const struct option number[] = {{verb->option, 0, OPTION_INT, &o.argument.number, verb->placeholder, verb->help,
                                     (double)-verb->most, (double)verb->most, NULL}, {0}};
    const struct option flag[] = {{variant ? variant->field : NULL, 0, OPTION_FLAG, &o.flag, NULL,
                                   variant ? variant->help : NULL, 0, 0, NULL}, {0}};
    const struct option frames[] = {FRAME_CHOICE_ROWS(o.frames, 'f', "try"), {0}};
    const struct option *own = verb->takes == VERB_TAKES_NUMBER                 ? number
                               : variant && variant->takes == VERB_TAKES_FRAMES ? frames
                                                                                : flag;

    return steer_run(command, &how, own, &o, argc, argv, exit_code, err);
}

static status verb_command(const struct command *command, int argc, char *const *argv, int *exit_code,
                           struct error *err)
{
    return verb_run(command, NULL, NULL, argc, argv, exit_code, err);
}

#define HELP(arguments, phrase, text) arguments, .summary = phrase, .description = text
#define VERB(NAME, word, ROLE, function, says, help, ...) \
    const struct command command_##word = {.name = #word, .group = COMMAND_JOBS, .run = function, .usage = "azulejo " #word " " help};
#define VARIANT(...)
JOB_VERBS(VERB, VARIANT)
