/* azulejo fetch: download a job's pictures. */
#include <stdio.h>

#include "client/commands/command.h"
#include "client/follow/cut_frame.h"
#include "client/follow/fetch.h"
#include "client/follow/job_info.h"
#include "client/options/output.h"
#include "client/farm/preview_look.h"
#include "client/link/signals.h"
#include "client/follow/video.h"
#include "client/farm/job_choice.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

static status preview_kind(const char *path, Azulejo__Wire__OutputKind *kind, struct error *err)
{
    switch (output_format_of(path)) {
    case OUTPUT_FORMAT_EXR: *kind = AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR; return STATUS_OK;
    case OUTPUT_FORMAT_PNG: *kind = AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG; return STATUS_OK;
    default:
        return error_set(err, STATUS_ERR_USAGE,
                         "--preview: %s must end in .png, for a tone mapped picture, or in .exr, for "
                         "linear light",
                         path);
    }
}

static status interrupted(void *user UNUSED, struct error *err)
{
    return signals_stop() ? error_set(err, STATUS_ERR_JOB_FAILED, "interrupted; no video is written") : STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_fetch f = {0};
    struct follow how = {.reconnect_s = RECONNECT_DEFAULT_S};
    const char *preview = NULL, *out = NULL;
    int follow = 0;
    char cut[CUT_FRAME_TEXT_SIZE];
    struct preview_look look = {0};
    struct option rows[TONEMAP_ROWS_MAX];
    struct frame_choice choice = {0};
    struct frame_list frames = {0};
    int done;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &out, "OUT",
         "where the files go: a folder, created if it is missing, or one picture's file (.exr, .png or .jpg) "
         "(default: this folder)", 0, 0, NULL},
        FRAME_CHOICE_ROWS(choice, 0, "fetch"),
        {"manifest", 0, OPTION_FLAG, &f.manifest, NULL,
         "also each frame's manifest, ." MANIFEST_EXTENSION ": which effects ran, who called for "
         "them, and where the time went",
         0, 0, NULL},
        JOB_FETCH_FORCE_ROW(f.force),
        {"preview", 0, OPTION_STRING, &preview, "FILE",
         "fetch instead the unfinished frame as it is, tone mapped (.png) or in linear light "
         "(.exr); says which share has samples, the rest is filled from its neighbours",
         0, 0, NULL},
        TONEMAP_OPTION_ROWS(look.tone),
        {"no-dither", 0, OPTION_FLAG, &look.no_dither, NULL, "with --preview: do not dither", 0, 0, NULL},
        VIDEO_OPTION_ROW(f.video),
        {"follow", 0, OPTION_FLAG, &follow, NULL,
         "until the job ends: fetch each frame when it is finished; ends with the status of the job's end", 0, 0, NULL},
        {"limit", 0, OPTION_REAL, &how.limit_s, "SECONDS",
         "with --follow: stop after this long, with exit status 7; the job continues (default: never)",
         0.01, 1e9, NULL},
        RECONNECT_OPTION_ROW(how.reconnect_s),
        {"json", 0, OPTION_FLAG, &f.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &how.quiet, NULL, "with --follow: no progress, and no line for each file", 0, 0,
         NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    Azulejo__Wire__Envelope *answer = NULL;
    Azulejo__Wire__OutputKind kind = AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG;
    uint64_t job;
    status result =
        command_parse(command, tonemap_options_table(&look.tone, table, rows), argc, argv, 1, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = job_word_check(rest.items[0], err);
    if (result == STATUS_OK && preview)
        result = preview_kind(preview, &kind, err);
    THEN(result, preview_look_check(&look, preview && kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG, err));
    if (result == STATUS_OK && preview && (follow || f.video))
        result = error_set(err, STATUS_ERR_USAGE,
                           "--%s is for finished frames, --preview for an unfinished one: leave out "
                           "either", follow ? "follow" : "video");
    if (result == STATUS_OK && f.video)
        result = video_check(f.video, err);
    if (result == STATUS_OK && !follow && (how.limit_s > 0 || how.quiet))
        result = error_set(err, STATUS_ERR_USAGE, "--limit and --quiet go with --follow");
    THEN(result, destination_of_job(&f.to, out, OUTPUT_FORMAT_ALL, err));
    if (result == STATUS_OK && !preview)
        result = fetch_check_folder(f.to.folder, err);
    THEN(result, frame_choice_check(&choice, err));
    if (result == STATUS_OK && f.video)
        result = signals_catch(err); /* so that ffmpeg's unfinished file goes */
    if (result == STATUS_OK && f.video)
        where.watch = interrupted;
    where.patience_s = follow ? &how.reconnect_s : NULL;
    where.quiet = &how.quiet;
    THEN(result, connection_open_waiting(&f.connection, &where, err));
    THEN(result, job_word_find(f.connection, rest.items[0], &job, err));
    if (result == STATUS_OK && follow) {
        struct connection *connection = f.connection;
        how.where = where;
        how.json = f.json;
        result = job_fetch_follow(&connection, job, &f, &choice, &how, err);
        f.connection = connection;
        f.json = 0; /* it is printed */
        goto done;
    }
    THEN(result, job_query(f.connection, job, &answer, err));
    if (result == STATUS_OK) {
        f.job = job_list_find(answer->job_list, job);
        result = frame_choice_of(&choice, f.job->first_frame, f.job->last_frame, &frames, err);
        if (result == STATUS_OK && preview)
            result = preview_look_output(&look, f.connection, f.job, &f.look, err);
        if (result == STATUS_OK && preview)
            result = job_fetch_preview(&f, frames.count ? frames.items[0] : f.job->preview_frame, kind, preview, err);
        else if (result == STATUS_OK)
            result = job_fetch_pictures(&f, &frames, err);
        for (size_t i = 0; result == STATUS_OK && !preview && i < f.job->n_cut_frames; i++)
            fprintf(stderr, "%s\n", cut_frame_text(cut, f.job, f.job->cut_frames[i]));
    }
    if (f.json && (result == STATUS_OK || result == STATUS_ERR_INCOMPLETE)) {
        status printed = json_print(job_fetch_json(&f), err);
        result = printed == STATUS_OK ? result : printed;
    }
done:
    frame_list_free(&frames);
    job_fetch_release(&f);
    preview_look_release(&look);
    message_free(answer);
    connection_close(f.connection);
    return result;
}

const struct command command_fetch = {
    .name = "fetch",
    .group = COMMAND_JOBS,
    .usage = "azulejo fetch JOB [OPTION]...",
    .summary = "download a job's pictures",
    .description =
        "Fetch the finished frames of a job: the EXR files and the tone mapped PNG and JPEG files, named after\n"
        "the job. Where the folder holds files of that name from another job, the name gets -jobN; nothing of\n"
        "another job is overwritten. A file that is there and whole is not sent again. With --follow it stays until\n"
        "the job ends. Exit status 9 when some frames or files are missing. --preview FILE.png is tone mapped as the job's\n"
        "pictures, or otherwise with --tonemap, --exposure and the like; the job stays as it is.",
    .run = run,
};
