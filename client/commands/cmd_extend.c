/* azulejo extend: other rules about when frames have enough samples. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/follow/follow.h"
#include "client/follow/job_info.h"
#include "client/farm/job_choice.h"
#include "client/options/stop_options.h"
#include "protocol/message.h"

static status extend(struct connection *c, uint64_t job, uint32_t spp, const struct stop_rules *rules,
                     const struct frame_list *frames, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobExtend body = AZULEJO__WIRE__JOB_EXTEND__INIT;
    Azulejo__Wire__StopRules stop;
    Azulejo__Wire__Envelope *answer = NULL;
    status result;

    wire_stop_set(&stop, rules);
    body.job = job;
    body.spp = spp;
    body.stop = &stop;
    body.frames = frames->items;
    body.n_frames = frames->count;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_EXTEND;
    envelope.job_extend = &body;
    result = job_ask(c, &envelope, job, &answer, err);
    message_free(answer);
    return result;
}

static status check(const struct stop_options *options, struct stop_rules *rules, uint32_t *spp, struct error *err)
{
    status result = stop_options_check(options, rules, spp, err);

    if (result == STATUS_OK && *spp == 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "say when the pictures are good enough: --spp N, --target-error E, "
                         "--time-limit T, --core-limit T or --max-rays N");
    return result;
}

status extend_command(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct stop_options options = {0};
    struct frame_list frames = {0};
    struct frame_choice choice = {0};
    struct follow how = {.reconnect_s = RECONNECT_DEFAULT_S};
    int watch = 0, done;
    const struct option table[] = {
        STOP_SPP_ROW(options, "no limit"),
        STOP_OPTION(options, target) STOP_OPTION(options, time_limit_ms) STOP_OPTION(options, core_limit_ms) STOP_OPTION(options, max_rays)
        FRAME_CHOICE_ROWS(choice, 'f', "continue"),
        {"watch", 'w', OPTION_FLAG, &watch, NULL, "follow the job until it ends", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &how.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &how.quiet, NULL, "no progress and no warnings", 0, 0, NULL},
        RECONNECT_OPTION_ROW(how.reconnect_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    struct stop_rules rules;
    uint64_t job;
    uint32_t spp;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = job_word_check(rest.items[0], err);
    THEN(result, check(&options, &rules, &spp, err));
    THEN(result, frame_choice_check(&choice, err));
    where.patience_s = watch ? &how.reconnect_s : NULL;
    where.quiet = &how.quiet;
    THEN(result, connection_open_waiting(&connection, &where, err));
    THEN(result, job_word_find(connection, rest.items[0], &job, err));
    THEN(result, frame_choice_of_job(connection, job, &choice, &frames, err));
    THEN(result, extend(connection, job, spp, &rules, &frames, err));
    how.where = where;
    if (result == STATUS_OK && watch)
        result = follow_job(&connection, job, &how, err);
    else if (result == STATUS_OK && how.json)
        result = json_print(json_pack("{s:I}", "job", (json_int_t)job), err);
    else if (result == STATUS_OK)
        printf("job %" PRIu64 ": has the new rules\n", job);
    connection_close(connection);
    frame_list_free(&frames);
    return result;
}
