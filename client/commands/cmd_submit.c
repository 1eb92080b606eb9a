/* azulejo submit: send a scene to a farm as a job. */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>

#include "client/commands/command.h"
#include "client/views/effects_auto.h"
#include "client/follow/fetch.h"
#include "client/follow/follow.h"
#include "client/link/signals.h"
#include "client/farm/job_choice.h"
#include "client/farm/submission.h"
#include "client/farm/trial.h"
#include "client/follow/video.h"
#include "common/base/memory.h"

/* The number of attempts to send one job: if it crashes the coordinator, that must not go on for ever. */
enum { ATTEMPTS_MAX = 5 };

static status print_submitted(const struct job_accepted *accepted, const struct import_result *scene, int json,
                              struct error *err)
{
    if (json)
        return json_print(json_pack("{s:I, s:I, s:o}", "job", (json_int_t)accepted->job, "estimate_spp",
                                    (json_int_t)accepted->estimate_spp, "inputs", import_inputs_json(scene)),
                          err);
    printf("%" PRIu64 "\n", accepted->job);
    return STATUS_OK;
}

static status choose_token(const char *token, struct job_request *request, struct error *err)
{
    uint8_t random[16];

    if (token && (!*token || strlen(token) > JOB_TOKEN_BYTES_MAX))
        return error_set(err, STATUS_ERR_USAGE, "--token: must have 1 to %d bytes", JOB_TOKEN_BYTES_MAX);
    if (token) {
        memcpy(request->token, token, strlen(token) + 1);
        return STATUS_OK;
    }
    if (getrandom(random, sizeof random, 0) != sizeof random)
        return error_set(err, STATUS_ERR_IO, "no random numbers: %s", strerror(errno));
    for (size_t i = 0; i < sizeof random; i++)
        snprintf(request->token + 2 * i, 3, "%02x", random[i]);
    return STATUS_OK;
}

/* Send the scene and the job, again when the connection is lost before the answer: the token makes it the same job. */
static status send_again(struct connection **c, const struct import_result *scene, const struct job_request *request,
                         const char *name, const struct follow *how, struct job_accepted *accepted, struct error *err)
{
    const struct reconnect again = {.where = how->where, .patience_s = how->reconnect_s,
                                    .quiet = how->quiet};
    unsigned formats = request->output.formats ? request->output.formats : OUTPUT_FORMAT_BOTH;
    status result;

    for (int attempt = 1;; attempt++) {
        result = submission_send(*c, scene, request, name, formats, how->quiet, accepted, err);
        if (result == STATUS_OK && accepted->estimate_spp > 0 && !how->quiet)
            fprintf(stderr, "goes on from its estimate, job %" PRIu64 ": %u samples a pixel are there\n", accepted->job,
                    accepted->estimate_spp);
        if (!reconnect_is_loss(result) || attempt == ATTEMPTS_MAX)
            return result;
        TRY(reconnect(c, &again, err));
    }
}

/* Until 0.2.0 -o was the job's name; a plain name still is. */
static status check_output(const char **out, const char **name, int follow, int quiet, struct error *err)
{
    if (!*out || follow)
        return STATUS_OK;
    if (*name || strchr(*out, '/') || output_format_of(*out))
        return error_set(err, STATUS_ERR_USAGE,
                         "-o %s: it says where files go, and a job's files come only with --follow, or "
                         "later with 'azulejo fetch JOB -o %s'",
                         *out, *out);
    if (!quiet)
        fprintf(stderr, "note: the job is named %s; --name %s says so, -o says where the files of --follow go\n", *out,
                *out);
    *name = *out;
    *out = NULL;
    return STATUS_OK;
}

/* Only measuring takes long: Ctrl-C then also ends the pilots on the farm. */
static status choose_effects(const struct effects_auto *effects, struct connection *c,
                             const struct import_result *scene, struct job_request *request, int quiet,
                             struct error *err)
{
    status result;

    if (!(effects->target_codes > 0))
        return STATUS_OK;
    result = signals_catch(err);
    connection_set_watch(c, trial_interrupted, NULL);
    return result == STATUS_OK ? effects_auto_apply(effects, c, scene, request, quiet, err) : result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_options options = JOB_OPTIONS_INIT;
    struct effects_auto effects = {0};
    struct needs_options needs = {0};
    const char *name = NULL;
    const char *owner = NULL;
    const char *token = NULL;
    struct follow how = {.reconnect_s = RECONNECT_DEFAULT_S};
    const char *out = NULL;
    int watch = 0, follow = 0, force = 0, done;
    struct job_fetch fetch = {0};
    const struct option table[] = {
        JOB_OPTION_ROWS(options),
        JOB_ENDS_ROW(options),
        NEEDS_OPTION_ROWS(needs)
        EFFECTS_AUTO_ROWS(effects),
        {"name", 0, OPTION_STRING, &name, "NAME",
         "the job's name, from which its output files get theirs (default: the scene file's)", 0, 0,
         NULL},
        {"output", 'o', OPTION_STRING, &out, "OUT",
         "with --follow, where the files go: a folder, created if it is missing, or one picture's file "
         "(.exr, .png or .jpg) (default: this folder)", 0, 0, NULL},
        {"follow", 0, OPTION_FLAG, &follow, NULL,
         "until the job ends: fetch each frame when it is finished, as 'azulejo fetch --follow' does", 0, 0, NULL},
        VIDEO_OPTION_ROW(fetch.video),
        {"token", 0, OPTION_STRING, &token, "TEXT",
         "a name for this submission, up to 64 bytes: submitting again with it creates no second "
         "job, but prints the first one's number (default: a random one)",
         0, 0, NULL},
        {"owner", 0, OPTION_STRING, &owner, "USER@HOST",
         "submit it on behalf of somebody else, whose share of the farm it then uses (default: you)", 0, 0, NULL},
        {"force", 0, OPTION_FLAG, &force, NULL,
         "submit it also if it seems not to fit the coordinator's disk: it then waits whenever the disk is full", 0, 0,
         NULL},
        {"watch", 'w', OPTION_FLAG, &watch, NULL, "follow the job until it ends", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &how.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &how.quiet, NULL, "no progress and no warnings", 0, 0, NULL},
        RECONNECT_OPTION_ROW(how.reconnect_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    struct job_request request = {0};
    struct import_result scene = {0};
    struct connection *connection = NULL;
    char *default_name = NULL;
    struct job_accepted accepted = {0};
    const struct frame_choice every = {0};
    status result = command_parse(command, tonemap_options_table(&options.output.tone, table, rows), argc, argv, 1, 1,
                                  &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = check_output(&out, &name, follow, how.quiet, err);
    if (result == STATUS_OK && fetch.video && !follow)
        result = error_set(err, STATUS_ERR_USAGE, "--video: the pictures come with --follow, or later with "
                                                  "'azulejo fetch JOB --video %s'", fetch.video);
    if (result == STATUS_OK && fetch.video)
        result = video_check(fetch.video, err);
    if (result == STATUS_OK && follow)
        result = destination_of_job(&fetch.to, out, OUTPUT_FORMAT_ALL, err);
    if (result == STATUS_OK && follow)
        result = fetch_check_folder(fetch.to.folder, err);
    THEN(result, job_options_check(&options, &request, err));
    request.force = force;
    request.owner = owner;
    THEN(result, effects_auto_check(&effects, options.stop.said[STOP_target].text, err));
    THEN(result, needs_options_check(&needs, &request.needs, err));
    THEN(result, job_needs_find(NULL, needs.said[NEED_after].text, &request.needs, err));
    THEN(result, choose_token(token, &request, err));
    THEN(result, tonemap_key_check(&request.output.tonemap, where.key_path, err));
    default_name = submission_name(rest.items[0]);
    THEN(result, submission_prepare(rest.items[0], &options, how.quiet, &request, &scene, err));
    where.patience_s = watch || follow ? &how.reconnect_s : NULL;
    where.quiet = &how.quiet;
    THEN(result, connection_open_waiting(&connection, &where, err));
    THEN(result, job_needs_find(connection, needs.said[NEED_after].text, &request.needs, err));
    how.where = where;
    THEN(result, choose_effects(&effects, connection, &scene, &request, how.quiet, err));
    THEN(result, send_again(&connection, &scene, &request, name ? name : default_name, &how, &accepted, err));
    if (result == STATUS_OK && (watch || follow)) {
        if (!how.quiet)
            fprintf(stderr, "job %" PRIu64 "\n", accepted.job);
        result = follow ? job_fetch_follow(&connection, accepted.job, &fetch, &every, &how, err)
                        : follow_job(&connection, accepted.job, &how, err);
    } else if (result == STATUS_OK) {
        result = print_submitted(&accepted, &scene, how.json, err);
    }
    job_fetch_release(&fetch);
    connection_close(connection);
    import_result_release(&scene);
    job_request_release(&request);
    mem_free(default_name);
    return result;
}

const struct command command_submit = {
    .name = "submit",
    .group = COMMAND_JOBS,
    .usage = "azulejo submit SCENE [OPTION]...",
    .summary = "send a scene to the farm as a job",
    .description = "Read a scene (glTF 2.0, pbrt, OBJ or PLY), send the coordinator what it lacks of it, queue a job, and print the\n"
                   "job's number. An estimate of the same job on that farm becomes the job, and its samples count.",
    .run = run,
};
