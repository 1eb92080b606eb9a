/* azulejo: the command line client. */
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/link/signals.h"
#include "client/options/help_groups.h"
#include "client/terminal/format.h"
#include "client/terminal/must.h"
#include "common/base/guess.h"
#include "common/system/file.h"
#include "common/system/log.h"

static const struct command *const commands[] = {
    &command_render, &command_estimate, &command_import, &command_effects, &command_accuracy,
    &command_debug_pixel,
    &command_submit, &command_list, &command_show, &command_watch, &command_fetch,
#define VERB(NAME, name, ...) &command_##name,
#define VARIANT(...)
    JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
    &command_log, &command_prune, &command_gc, &command_trace, &command_owners, &command_verify, &command_top,
    &command_workers, &command_distrust, &command_token, &command_key, &command_keygen, &command_completion,
    &command_tonemap, &command_compare,
};
enum { COMMAND_COUNT = sizeof commands / sizeof commands[0] };

static const char *const group_titles[COMMAND_GROUPS] = {
    [COMMAND_RENDER] = "on this machine, without a farm",
    [COMMAND_JOBS] = "jobs on a farm",
    [COMMAND_FARM] = "the farm itself",
    [COMMAND_PICTURES] = "pictures",
};

static const struct {
    int status;
    const char *meaning;
} exits[] = {
    {0, "success"}, {1, "internal error, or pictures that differ"}, {2, "bad usage"}, {3, "bad input or a limit exceeded"},
    {4, "no coordinator there"}, {5, "refused or not found"}, {6, "job failed or cancelled"}, {7, "timed out"},
    {8, "local input or output"}, {9, "some frames or files are missing, or a target was missed"}, {11, "not stored yet"},
    {12, "verify: tiles differ"}, {130, "interrupted"}, {141, "the output's reader closed it"},
};

static void print_help(void)
{
    printf("usage: azulejo COMMAND [ARGUMENT]...\n\n");
    options_print_words("Render pictures on a farm of machines, or on this one.", 0);
    for (int group = 0; group < COMMAND_GROUPS; group++) {
        printf("\n%s:\n", group_titles[group]);
        for (int i = 0; i < COMMAND_COUNT; i++)
            if (commands[i]->group == (enum command_group)group) {
                printf("  %-11s  ", commands[i]->name);
                options_print_words(commands[i]->summary, 15);
            }
    }
    putchar('\n');
    options_print_words("'azulejo COMMAND --help' describes a command, 'azulejo help COMMAND' all of its options, "
                        "'azulejo --version' shows the version.", 0);
    printf("\nexit status:\n");
    for (size_t i = 0; i < sizeof exits / sizeof *exits; i++) {
        printf("  %3d  ", exits[i].status);
        options_print_words(exits[i].meaning, 7);
    }
}

static int report_unknown(const char *what, const char *word)
{
    struct guess guess = {.word = word};
    char hint[GUESS_HINT_SIZE];

    for (int i = 0; i < COMMAND_COUNT; i++)
        guess_try(&guess, commands[i]->name);
    fprintf(stderr, "azulejo: unknown %s '%s'%s ('azulejo --help' lists the commands)\n", what, word, guess_hint(hint, &guess));
    return status_exit_code(STATUS_ERR_USAGE);
}

static const struct command *command_find(const char *name)
{
    for (int i = 0; i < COMMAND_COUNT; i++)
        if (strcmp(commands[i]->name, name) == 0)
            return commands[i];
    return NULL;
}

/* Has the reader of our standard output closed it, as head does? */
static int reader_is_gone(void)
{
    struct pollfd out = {.fd = STDOUT_FILENO, .events = POLLOUT};

    return poll(&out, 1, 0) == 1 && out.revents & POLLERR;
}

/* Flush standard output, and put a failure into `result` if that has none yet. 1: the reader closed
 * it, which is not an error. */
static int output_end(status *result, struct error *err)
{
    int failed = fflush(stdout) != 0 || ferror(stdout);

    if (failed && reader_is_gone())
        return 1;
    if (failed && *result == STATUS_OK)
        *result = error_set(err, STATUS_ERR_IO, "standard output cannot be written");
    return 0;
}

/* The end of what only prints words: its exit code. */
static int end_words(status *result, struct error *err)
{
    if (output_end(result, err))
        return 128 + SIGPIPE;
    if (*result != STATUS_OK)
        fprintf(stderr, "azulejo: %s\n", err->text);
    return status_exit_code(*result);
}

int main(int argc, char **argv)
{
    struct error err = {0};
    const struct command *command;
    char whole_help[] = "--help";
    int exit_code = 0;
    status result = STATUS_OK;

    file_hold_standard();
    must_begin();
    log_setup("azulejo", LOG_LEVEL_WARN);
    signal(SIGPIPE, SIG_IGN); /* a broken pipe is an error of write(), not our death */
    if (argc < 2) {
        print_help();
        return status_exit_code(STATUS_ERR_USAGE);
    }
    help_groups_use();
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 || (strcmp(argv[1], "help") == 0 && argc == 2)) {
        print_help();
        return end_words(&result, &err);
    }
    if (strcmp(argv[1], "help") == 0) {
        options_want_whole_help();
        argv[1] = argv[2];
        argv[2] = whole_help;
        argc = 3;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("azulejo %s\n", AZULEJO_VERSION);
        return end_words(&result, &err);
    }
    if (argv[1][0] == '-')
        return report_unknown("option", argv[1]);
    command_completion_of(commands, COMMAND_COUNT);
    command = command_find(argv[1]);
    if (!command)
        return report_unknown("command", argv[1]);
    result = command->run(command, argc - 1, argv + 1, &exit_code, &err);
    if (output_end(&result, &err))
        return 128 + SIGPIPE;
    text_disarm(err.text); /* it may name files as a scene or another machine calls them */
    if (signals_stop()) {
        if (err.text[0])
            fprintf(stderr, "azulejo: %s\n", err.text);
        return 128 + signals_stop();
    }
    if (result != STATUS_OK) {
        fprintf(stderr, "azulejo %s: %s", command->name, err.text);
        if (result == STATUS_ERR_USAGE && !strstr(err.text, "--help"))
            fprintf(stderr, " ('azulejo %s --help' shows more)", command->name);
        fputc('\n', stderr);
        return status_exit_code(result);
    }
    return exit_code;
}
