/* azulejo submit: send a scene to a farm as a job. */
#include <inttypes.h>
#include <stdio.h>

#include "client/command.h"
#include "client/follow.h"
#include "client/job_info.h"
#include "client/submission.h"
#include "common/base/memory.h"

static status print_submitted(uint64_t job, const struct import_result *scene, int json,
                              struct error *err)
{
    if (json)
        return json_print(json_pack("{s:I, s:o}", "job", (json_int_t)job, "inputs",
                                    import_inputs_json(scene)),
                          err);
    printf("%" PRIu64 "\n", job);
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_options options = JOB_OPTIONS_INIT;
    const char *name = NULL;
    int json = 0, quiet = 0, watch = 0, done;
    const struct option table[] = {
        JOB_OPTION_ROWS(options),
        {"name", 'o', OPTION_STRING, &name, "NAME",
         "the job's name, from which its output files get theirs (default: the scene file's)", 0, 0,
         NULL},
        {"watch", 'w', OPTION_FLAG, &watch, NULL, "follow the job until it ends", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &quiet, NULL, "no progress and no warnings", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    struct job_request request = {0};
    struct import_result scene = {0};
    struct connection *connection = NULL;
    char *default_name = NULL;
    uint64_t job;
    status result = command_parse(command, tonemap_options_table(&options.output.tone, table, rows),
                                  argc, argv, 1, 1, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    result = job_options_check(&options, &request, err);
    if (result == STATUS_OK)
        result = tonemap_key_check(&request.output.tonemap, where.key_path, err);
    default_name = submission_name(rest.items[0]);
    if (result == STATUS_OK && !default_name)
        result = error_no_memory(err, "a name");
    if (result == STATUS_OK)
        result = submission_prepare(rest.items[0], &options, quiet, &request, &scene, err);
    if (result == STATUS_OK)
        result = connection_open(&connection, &where, err);
    if (result == STATUS_OK)
        result = submission_send(connection, &scene, &request, name ? name : default_name,
                                 request.output.formats ? request.output.formats
                                                        : OUTPUT_FORMAT_BOTH,
                                 quiet, &job, err);
    if (result == STATUS_OK && watch) {
        if (!quiet)
            fprintf(stderr, "job %" PRIu64 "\n", job);
        result = follow_job(connection, job, quiet, json, 0, err);
    } else if (result == STATUS_OK) {
        result = print_submitted(job, &scene, json, err);
    }
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
                   "job's number.",
    .run = run,
};
