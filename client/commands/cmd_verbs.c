/* The commands of common/schema/verbs.h: each verb's help, and what those do that need no file of their own. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "common/base/memory.h"
#include "protocol/fields.h"
#include "protocol/message.h"

/* A verb's argument. */
struct argument {
    const struct job_verb *verb;      /* or the variant that was chosen */
    int64_t number;
    const char *text;
    struct frame_choice frames;
};

static status check(void *options, struct job_choice *choice, struct error *err)
{
    struct argument *argument = options;
    const struct job_verb *variant = job_verb_variant(argument->verb);

    if (argument->verb->takes == VERB_TAKES_NUMBER && argument->number > argument->verb->most)
        return error_set(err, STATUS_ERR_USAGE, "which %s? Give --%s %s", argument->verb->field, argument->verb->option,
                         argument->verb->placeholder);
    if (variant && (argument->frames.list || argument->frames.first_middle_last))
        argument->verb = variant;
    choice->verb = argument->verb;
    return frame_choice_check(&argument->frames, err);
}

static void set(const ProtobufCMessage *body, const struct argument *argument, const struct frame_list *frames)
{
    size_t *count;
    void *at = argument->verb->field ? message_field(body, argument->verb->field, &count) : NULL;

    switch (argument->verb->takes) {
    case VERB_TAKES_NUMBER: *(int32_t *)at = (int32_t)argument->number; break;
    case VERB_TAKES_TEXT: *(const char **)at = argument->text; break;
    case VERB_TAKES_FRAMES:
        *(uint32_t **)at = frames->items;
        *count = frames->count;
        break;
    default: break;
    }
}

static status ask(struct connection *c, uint64_t job, const void *options, Azulejo__Wire__Envelope **answer,
                  struct error *err)
{
    const struct argument *argument = options;
    Azulejo__Wire__Envelope question;
    struct frame_list frames;
    ProtobufCMessage *body;
    char field[32];
    status result = frame_choice_of_job(c, job, &argument->frames, &frames, err);

    if (result != STATUS_OK)
        return result;
    snprintf(field, sizeof field, "job_%s", argument->verb->path);
    body = message_new(&question, field);
    if (body) {
        *(uint64_t *)message_field(body, "job", NULL) = job;
        set(body, argument, &frames);
        result = job_ask(c, &question, job, answer, err);
    } else {
        result = error_no_memory(err, "a message");
    }
    mem_free(body);
    frame_list_free(&frames);
    return result;
}

static void print(const void *options)
{
    const struct argument *argument = options;

    if (argument->verb->takes == VERB_TAKES_NUMBER)
        printf("  %s %" PRId64 "\n", argument->verb->field, argument->number);
}

static status verb_command(const struct command *command, int argc, char *const *argv, int *exit_code,
                           struct error *err)
{
    const struct job_verb *verb = job_verb_find(command->name), *variant = job_verb_variant(verb);
    struct argument argument = {.verb = verb, .number = verb->most + 1};
    const struct steer_verb how = {.verb = verb, .check = check, .ask = ask, .print = print,
                                   .text = verb->takes == VERB_TAKES_TEXT ? &argument.text : NULL,
                                   .outcome = verb->removes ? verb->past : NULL};
    const struct option number[] = {{verb->option, 0, OPTION_INT, &argument.number, verb->placeholder, verb->help,
                                     (double)-verb->most, (double)verb->most, NULL}, {0}};
    const struct option frames[] = {FRAME_CHOICE_ROWS(argument.frames, 'f', "try"), {0}};

    return steer_run(command, &how, verb->takes == VERB_TAKES_NUMBER ? number : variant ? frames : NULL, &argument,
                     argc, argv, exit_code, err);
}

#define HELP(arguments, phrase, text) arguments, .summary = phrase, .description = text
#define VERB(NAME, word, ROLE, function, says, help, ...) \
    const struct command command_##word = {.name = #word, .group = COMMAND_JOBS, .run = function, .usage = "azulejo " #word " " help};
#define VARIANT(...)
JOB_VERBS(VERB, VARIANT)
