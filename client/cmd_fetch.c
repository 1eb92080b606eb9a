/* azulejo fetch: bring a job's pictures here. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/command.h"
#include "client/fetch.h"
#include "client/format.h"
#include "client/job_info.h"
#include "client/parse.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

struct fetching {
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    const char *folder;
    int manifest;    /* these too */
    json_t *files;   /* NULL: print a line for each */
    size_t fetched, not_ready;
};

/* "NAME.exr", or "NAME-0007.exr" where a job has several frames, from the job's name made
 * safe: no folders, nothing hidden. Jobs fetched into one folder so keep apart. */
static void output_name(const struct fetching *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                        struct buffer *name)
{
    const Azulejo__Wire__JobInfo *job = f->job;
    const char *extension = kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR            ? "exr"
                            : kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON ? MANIFEST_EXTENSION
                                                                                      : "png";
    char safe[256];
    char *begin = safe;

    message_text(safe, sizeof safe, job->name);
    for (char *c = safe; *c; c++)
        if (*c == '/')
            *c = '_';
    while (*begin == '.')
        begin++;
    if (*begin)
        buffer_puts(name, begin);
    else
        buffer_printf(name, "job-%" PRIu64, job->job);
    if (job->last_frame > job->first_frame)
        buffer_printf(name, "-%04u", frame);
    buffer_printf(name, ".%s", extension);
}

static status fetch_to(struct fetching *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                       const char *path, struct error *err)
{
    struct buffer data = BUFFER_INIT, name = BUFFER_INIT;
    char size[FORMAT_SIZE];
    char *joined = NULL;
    status result = fetch_output(f->connection, f->job->job, frame, kind, &data, err);

    if (result == STATUS_OK && !path) {
        output_name(f, frame, kind, &name);
        joined = buffer_ok(&name) ? file_join(f->folder, buffer_text(&name)) : NULL;
        path = joined;
        if (!path)
            result = error_no_memory(err, "a path");
    }
    if (result == STATUS_OK)
        result = file_write_atomic(path, data.data, data.size, err);
    if (result == STATUS_OK) {
        f->fetched++;
        if (f->files)
            json_array_append_new(f->files, json_text(path));
        else
            printf("%s  %s\n", path, format_bytes(size, data.size));
    }
    mem_free(joined);
    buffer_release(&name);
    buffer_release(&data);
    return result;
}

/* Every format of one frame. A frame that is not rendered yet is counted, not an error, as
 * long as the job still runs. */
static status fetch_frame(struct fetching *f, uint32_t frame, int must_be_there, struct error *err)
{
    const Azulejo__Wire__OutputSettings *output = f->job->output;
    status result = STATUS_OK;

    for (size_t i = 0; output && i < output->n_formats && result == STATUS_OK; i++) {
        Azulejo__Wire__OutputKind kind = strcmp(output->formats[i], "png") == 0
                                             ? AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG
                                             : AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR;
        result = fetch_to(f, frame, kind, NULL, err);
        if (result == STATUS_ERR_NOT_FOUND && !must_be_there) {
            f->not_ready++;
            return STATUS_OK;
        }
    }
    if (result == STATUS_OK && f->manifest)
        result = fetch_to(f, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON, NULL, err);
    return result;
}

static status fetch_all(struct fetching *f, int64_t only_frame, struct error *err)
{
    const Azulejo__Wire__JobInfo *job = f->job;
    status result = STATUS_OK;

    if (only_frame >= 0) {
        if (only_frame < job->first_frame || only_frame > job->last_frame)
            return error_set(err, STATUS_ERR_USAGE, "--frame: the job's frames are %u-%u",
                             job->first_frame, job->last_frame);
        return fetch_frame(f, (uint32_t)only_frame, 1, err);
    }
    for (uint64_t frame = job->first_frame; frame <= job->last_frame && result == STATUS_OK; frame++)
        result = fetch_frame(f, (uint32_t)frame,
                             job->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE, err);
    if (result != STATUS_OK)
        return result;
    if (f->not_ready)
        fprintf(stderr, "%zu frame%s not rendered%s\n", f->not_ready,
                f->not_ready == 1 ? " is" : "s are", job_state_is_final(job->state) ? "" : " yet");
    if (f->fetched == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " has no finished frame (--preview FILE.png shows the one "
                         "in work)",
                         job->job);
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct fetching f = {.folder = "."};
    const char *preview = NULL;
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
            result = fetch_to(&f, frame >= 0 ? (uint32_t)frame : f.job->preview_frame,
                              AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG, preview, err);
        else
            result = fetch_all(&f, frame, err);
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
    .description = "Fetch the finished frames of a job: the EXR files and the tone mapped PNG files.",
    .run = run,
};
