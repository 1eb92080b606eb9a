/* azulejo gc: remove from the store what may go. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/farm/store_view.h"
#include "client/terminal/format.h"
#include "client/terminal/json.h"
#include "protocol/message.h"

static void print_collected(const Azulejo__Wire__StoreInfo *info)
{
    char bytes[FORMAT_SIZE], text[256];

    printf("removed  %" PRIu64 " blobs, %s\n", info->removed_blobs,
           bytes_text(bytes, info->removed_bytes));
    if (info->removed_jobs > 0)
        printf("         %" PRIu64 " jobs, by the coordinator's limits\n", info->removed_jobs);
    if (info->removed_films > 0)
        printf("         the films of %" PRIu64 " jobs, by the coordinator's limits\n",
               info->removed_films);
    if (info->waiting_blobs > 0)
        printf("kept     %" PRIu64
               " blobs, %s, that no job needs but a client named lately (--keep-blobs)\n",
               info->waiting_blobs, bytes_text(bytes, info->waiting_bytes));
    if (info->held[0])
        printf("held     %s\n", message_text(text, sizeof text, info->held));
    printf("free     %s of the disk\n", bytes_text(bytes, info->free));
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0, now = 0, done;
    const struct option table[] = {
        {"now", 0, OPTION_FLAG, &now, NULL, "also remove what was sent a moment ago and no job needs", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *c = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = connection_open(&c, &where, err);
    THEN(result, store_ask(c, 1, now, &answer, err));
    if (result == STATUS_OK && json)
        result = json_print(json_message(&answer->store_info->base), err);
    else if (result == STATUS_OK)
        print_collected(answer->store_info);
    message_free(answer);
    connection_close(c);
    return result;
}

const struct command command_gc = {
    .name = "gc",
    .group = COMMAND_FARM,
    .usage = "azulejo gc [OPTION]...",
    .summary = "remove from the coordinator's store what may go",
    .description = "Remove scenes and their files that no job needs, and what the coordinator's "
                   "own limits no longer allow. The\n"
                   "coordinator does the same by itself. Nothing that a job needs is removed. With --now, people who are\n"
                   "submitting through the page at that moment have to send the scene again.",
    .run = run,
};
