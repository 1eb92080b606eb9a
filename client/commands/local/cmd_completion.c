/* azulejo completion: a shell's completion of the command line. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/link/child.h"
#include "client/follow/job_info.h"
#include "common/cli/completion.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/tonemap/tonemap.h"
#include "protocol/message.h"

/* A person waits for it at a key stroke. */
#define ASK_TIMEOUT_S 0.7

static const struct command *const *all_commands;
static size_t all_count;

void command_completion_of(const struct command *const *commands, size_t count)
{
    all_commands = commands;
    all_count = count;
}

/* ---- the script ----------------------------------------------------------------------------- */

static struct buffer words;

static void add_word(const char *text)
{
    buffer_puts(&words, words.size > 0 ? " " : "");
    for (; *text; text++)
        buffer_printf(&words, "%c", *text == ' ' ? '-' : *text);
}

/* Words that no table of options has. */
static const char *words_of(const char *argument)
{
    size_t count;

    buffer_clear(&words);
    if (strcmp(argument, "STATE,...") == 0) {
        for (int s = 0; s < JOB_STATE_COUNT; s++)
            add_word(job_state_word(s));
    } else if (strcmp(argument, "OPERATOR") == 0) {
        const struct tonemap_operator *const *operators = tonemap_operators(&count);
        for (size_t i = 0; i < count; i++)
            add_word(operators[i]->name);
    } else if (strcmp(argument, "EFFECT,...") == 0) {
        for (int e = 0; e < EFFECT_COUNT; e++)
            add_word(effect_name((enum effect_bit)e));
    } else if (strcmp(argument, "NAME,...") == 0) {
        for (int a = 0; a < AOV_COUNT; a++)
            add_word(aov_name((enum aov)a));
    } else if (strcmp(argument, "FORMAT,...") == 0) {
        buffer_puts(&words, "exr png jpg");
    } else {
        return NULL;
    }
    return buffer_text(&words);
}

struct collection {
    struct completion completion;
    const struct command *command;
    status result;
    struct error *err;
};

static void take_table(void *user, const char *usage, const struct option *table)
{
    struct collection *c = user;

    if (c->result == STATUS_OK)
        c->result =
            completion_add(&c->completion, c->command->name, c->command->summary, usage, table, words_of, c->err);
}

/* Each command is asked for help; its table is taken instead. */
static status print_script(const char *shell, struct error *err)
{
    struct collection c = {.err = err};
    struct buffer text = BUFFER_INIT;

    completion_init(&c.completion, "azulejo");
    buffer_init(&words);
    options_take_help(take_table, &c);
    for (size_t i = 0; i < all_count && c.result == STATUS_OK; i++) {
        char help[] = "--help", *const argv[] = {(char *)all_commands[i]->name, help, NULL};
        int exit_code = 0;

        c.command = all_commands[i];
        if (c.result == STATUS_OK)
            c.result = c.command->run(c.command, 2, argv, &exit_code, err);
    }
    options_take_help(NULL, NULL);
    if (c.result == STATUS_OK)
        c.result = completion_write(&c.completion, shell, &text, err);
    if (c.result == STATUS_OK)
        fwrite(text.data, 1, text.size, stdout);
    buffer_release(&text);
    buffer_release(&words);
    completion_release(&c.completion);
    return c.result;
}

/* Another program knows its own options. */
static status print_other(const char *program, const char *shell, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    if (strcmp(program, "azulejo-coordinator") != 0 && strcmp(program, "azulejo-web") != 0 &&
        strcmp(program, "azulejo-worker") != 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "'%s' is not one of azulejo, azulejo-coordinator, azulejo-web, azulejo-worker", program);
    s = child_find_program(program, &path, err);
    if (s == STATUS_OK && fflush(stdout) == 0) {
        execl(buffer_text(&path), program, "--completion", shell, (char *)NULL);
        s = error_set(err, STATUS_ERR_IO, "%s cannot be run", buffer_text(&path));
    }
    buffer_release(&path);
    return s;
}

/* ---- the jobs ------------------------------------------------------------------------------- */

/* The connection options among the words of an unfinished command line. */
static void find_options(struct connection_options *where, const struct positionals *line)
{
    const struct {
        const char *name, *letter;
        const char **value;
    } options[] = {{"--coordinator", "-c", &where->coordinator}, {"--key", "-k", &where->key_path}};

    for (size_t i = 0; i < line->count; i++)
        for (size_t k = 0; k < 2; k++) {
            const char *word = line->items[i];
            size_t length = strlen(options[k].name);

            if ((strcmp(word, options[k].name) == 0 || strcmp(word, options[k].letter) == 0) && i + 1 < line->count)
                *options[k].value = line->items[i + 1];
            else if (strncmp(word, options[k].name, length) == 0 && word[length] == '=')
                *options[k].value = word + length + 1;
            else if (strncmp(word, options[k].letter, 2) == 0 && word[2])
                *options[k].value = word + 2;
        }
}

/* Can it be typed, and mean this job's name? */
static int is_plain_name(const char *name)
{
    char clean[512];

    return name[0] && name[0] != '-' && name[strspn(name, "0123456789")] &&
           strcmp(message_text(clean, sizeof clean, name), name) == 0;
}

static void print_jobs(const Azulejo__Wire__JobList *list)
{
    char name[512];

    for (size_t i = list->n_jobs; i-- > 0;)
        printf("%" PRIu64 "\t%s, %s\n", list->jobs[i]->job, message_text(name, sizeof name, list->jobs[i]->name),
               job_state_word(list->jobs[i]->state));
    for (size_t i = list->n_jobs; i-- > 0;) {
        int repeated = 0;

        for (size_t k = list->n_jobs - 1; k > i && !repeated; k--)
            repeated = strcmp(list->jobs[k]->name, list->jobs[i]->name) == 0;
        if (!repeated && is_plain_name(list->jobs[i]->name))
            printf("%s\tjob %" PRIu64 ", %s\n", list->jobs[i]->name, list->jobs[i]->job,
                   job_state_word(list->jobs[i]->state));
    }
}

/* Whatever goes wrong is silence. */
static void offer_jobs(const struct positionals *line)
{
    struct connection_options where = {.timeout_s = ASK_TIMEOUT_S};
    struct connection *c = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    struct error err = {0};

    find_options(&where, line);
    if (connection_open(&c, &where, &err) == STATUS_OK && job_query(c, 0, &answer, &err) == STATUS_OK)
        print_jobs(answer->job_list);
    message_free(answer);
    connection_close(c);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    int jobs = 0, done;
    const struct option table[] = {
        {"jobs", 0, OPTION_FLAG, &jobs, NULL,
         "print the newest jobs of the coordinator that the words of a command line mean, for the scripts", 0, 0,
         NULL},
        {0},
    };
    struct positionals rest;
    const char *shell;
    status result = command_parse(command, table, argc, argv, 0, OPTIONS_POSITIONAL_MAX, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (jobs) {
        offer_jobs(&rest);
        return STATUS_OK;
    }
    shell = rest.count > 0 ? rest.items[0] : "";
    if (rest.count < 1 || rest.count > 2)
        return error_set(err, STATUS_ERR_USAGE, "usage: %s", command->usage);
    if (strcmp(shell, "bash") != 0 && strcmp(shell, "zsh") != 0 && strcmp(shell, "fish") != 0)
        return error_set(err, STATUS_ERR_USAGE, "'%s' is not one of bash, zsh, fish", shell);
    return rest.count == 2 && strcmp(rest.items[1], "azulejo") != 0 ? print_other(rest.items[1], shell, err)
                                                                    : print_script(shell, err);
}

const struct command command_completion = {
    .name = "completion",
    .group = COMMAND_FARM,
    .usage = "azulejo completion bash|zsh|fish [PROGRAM]",
    .summary = "print a script that completes command lines in a shell",
    .description =
        "Print a script for the shell that completes commands, options, their values, files, and jobs, of which\n"
        "it asks the coordinator. PROGRAM is azulejo (the default), azulejo-coordinator, azulejo-web or azulejo-worker.\n"
        "'make install' installs the scripts; for one shell: source <(azulejo completion bash)",
    .run = run,
};
