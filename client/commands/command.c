#include "client/commands/command.h"

#include <stdio.h>
#include <string.h>

#include "client/farm/job_choice.h"
#include "client/link/reconnect.h"
#include "common/base/guess.h"

status command_parse(const struct command *command, const struct option *table, int argc, char *const *argv,
                     size_t least, size_t most, struct positionals *rest, int *done, struct error *err)
{
    status result = options_parse(table, argc, argv, rest, done, err);

    if (result == STATUS_OK && *done) {
        options_print_help(command->usage, command->description, table);
        return STATUS_OK;
    }
    if (result == STATUS_OK && rest->count < least)
        result = error_set(err, STATUS_ERR_USAGE, "an argument is missing; usage: %s", command->usage);
    if (result == STATUS_OK && rest->count > most)
        result = error_set(err, STATUS_ERR_USAGE, "'%s' is one argument too many; usage: %s", rest->items[most], command->usage);
    return result;
}

status command_word_unknown(const char *word, const char *words, struct error *err)
{
    char list[128], hint[GUESS_HINT_SIZE], *rest = list, *each;
    struct guess guess = {.word = word};

    snprintf(list, sizeof list, "%s", words);
    while ((each = strtok_r(rest, ", ", &rest)))
        if (strcmp(each, "or") != 0)
            guess_try(&guess, each);
    return error_set(err, STATUS_ERR_USAGE, "'%s' is not %s%s", word, words, guess_hint(hint, &guess));
}

status command_open_job(const struct command *command, const struct option *table, int argc, char *const *argv,
                        const struct connection_options *where, uint64_t *job, struct connection **connection,
                        struct error *err)
{
    struct positionals rest;
    int done;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    *connection = NULL;
    if (result != STATUS_OK || done)
        return result;
    TRY(job_word_check(rest.items[0], err));
    TRY(connection_open_waiting(connection, where, err));
    result = job_word_find(*connection, rest.items[0], job, err);
    if (result != STATUS_OK) {
        connection_close(*connection);
        *connection = NULL;
    }
    return result;
}
