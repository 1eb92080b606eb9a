/* azulejo fetch: bring a job's pictures here. */
#include <stdio.h>

#include "client/command.h"
#include "client/cut_frame.h"
#include "client/fetch.h"
#include "client/job_info.h"
#include "client/output.h"
#include "client/parse.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_fetch f = {.folder = ".", .formats = OUTPUT_FORMAT_ALL};
    const char *preview = NULL;
    char cut[CUT_FRAME_TEXT_SIZE];
    int64_t frame = -1;
    int json = 0, done;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &f.folder, "FOLDER",
         "where the files go; made if it is missing (default: here)", 0, 0, NULL},
        {"frame", 0, OPTION_INT, &frame, "N", "only this frame (default: all)", 0, INT32_MAX, NULL},
        {"manifest", 0, OPTION_FLAG, &f.manifest, NULL,
         "also each frame's manifest, ." MANIFEST_EXTENSION ": which effects ran, who called for "
         "them, and where the time went",
         0, 0, NULL},
        {"preview", 0, OPTION_STRING, &preview, "FILE.png",
         "instead: the frame in work as it stands, tone mapped", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    Azulejo__Wire__Envelope *answer = NULL;
    uint64_t job;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    result = parse_job(rest.items[0], &job, err);
    if (result == STATUS_OK && !preview)
        result = fetch_check_folder(f.folder, err);
    if (result == STATUS_OK)
        result = connection_open(&f.connection, &where, err);
    if (result == STATUS_OK)
        result = job_query(f.connection, job, &answer, err);
    if (result == STATUS_OK) {
        f.job = job_list_find(answer->job_list, job);
        if (json)
            f.files = json_array();
        if (preview)
            result = job_fetch_file(&f, frame >= 0 ? (uint32_t)frame : f.job->preview_frame,
                                    AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG, preview, err);
        else
            result = job_fetch_pictures(&f, frame, err);
        for (size_t i = 0; result == STATUS_OK && !preview && i < f.job->n_cut_frames; i++)
            fprintf(stderr, "%s\n", cut_frame_text(cut, f.job, f.job->cut_frames[i]));
    }
    if (result == STATUS_OK && json)
        result = json_print(json_pack("{s:O}", "files", f.files), err);
    json_decref(f.files);
    message_free(answer);
    connection_close(f.connection);
    return result;
}

const struct command command_fetch = {
    .name = "fetch",
    .group = COMMAND_JOBS,
    .usage = "azulejo fetch JOB [OPTION]...",
    .summary = "bring a job's pictures here",
    .description = "Fetch the finished frames of a job: the EXR files and the tone mapped PNG and JPEG files.",
    .run = run,
};
