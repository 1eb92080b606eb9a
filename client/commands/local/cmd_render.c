/* azulejo render: render on this machine, with a farm that lives as long as the command. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/follow/cut_frame.h"
#include "client/follow/destination.h"
#include "client/views/effects_auto.h"
#include "client/follow/fetch.h"
#include "client/follow/job_info.h"
#include "client/follow/tev.h"
#include "client/link/local.h"
#include "client/link/signals.h"
#include "client/farm/submission.h"
#include "client/follow/video.h"
#include "client/follow/watch.h"
#include "client/farm/verb.h"
#include "client/terminal/must.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

/* After an interruption: the time allowed for one picture. */
enum { CUT_PATIENCE_MS = 60000 };

struct render {
    const char *scene_path;
    struct job_options options;
    struct effects_auto effects;
    struct local_options local;
    int json, quiet, manifest;
    struct job_request request;
    struct import_result scene;
    struct destination destination;
    unsigned formats; /* that the job makes */
    char *name;
    struct local_farm *farm;
    struct connection *connection;
    uint64_t job;
    Azulejo__Wire__Envelope *last; /* the job's last JobList */
    int cut;                       /* interrupted: only existing pictures are fetched */
    json_t *files;
    const char *tev_address; /* --tev; NULL: none */
    struct tev *tev;
    const char *video_path; /* --video; NULL: none */
    struct video *video;
};

static status fetch_file(struct render *r, uint32_t frame, Azulejo__Wire__OutputKind kind, const char *extension,
                         struct error *err)
{
    struct buffer data = BUFFER_INIT, path = BUFFER_INIT;
    status result = fetch_output(r->connection, r->job, frame, kind, &data, err);

    destination_path(&r->destination, frame, extension, &path);
    must_hold(&path);
    THEN(result, file_write_atomic(buffer_text(&path), data.data, data.size, err));
    if (result == STATUS_OK)
        json_array_append_new(r->files, json_text(buffer_text(&path)));
    buffer_release(&path);
    buffer_release(&data);
    return result;
}

/* The video's next picture: PNG, or JPEG where there is no PNG. */
static status video_frame(struct render *r, uint32_t frame, struct error *err)
{
    int png = r->formats & OUTPUT_FORMAT_PNG ? 1 : 0;
    struct buffer data = BUFFER_INIT;
    status result = fetch_output(r->connection, r->job, frame,
                                 png ? AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG : AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG,
                                 &data, err);

    if (result == STATUS_OK && !r->video)
        result = video_begin(&r->video, r->video_path, (double)r->request.settings.fps,
                             png ? OUTPUT_FORMAT_PNG : OUTPUT_FORMAT_JPEG, err);
    THEN(result, video_add(r->video, r->connection, &data, err));
    buffer_release(&data);
    return result;
}

static status fetch_frame(struct render *r, uint32_t frame, struct error *err)
{
    status result = STATUS_OK;

    if (r->destination.formats & OUTPUT_FORMAT_EXR)
        result = fetch_file(r, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR, "exr", err);
    if (result == STATUS_OK && (r->destination.formats & OUTPUT_FORMAT_PNG))
        result = fetch_file(r, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG, "png", err);
    if (result == STATUS_OK && (r->destination.formats & OUTPUT_FORMAT_JPEG))
        result = fetch_file(r, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG, "jpg", err);
    if (result == STATUS_OK && r->manifest)
        result = fetch_file(r, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON, MANIFEST_EXTENSION, err);
    if (result == STATUS_OK && r->video_path)
        result = video_frame(r, frame, err);
    return result;
}

static status fetch_pictures(struct render *r, struct error *err)
{
    status result = STATUS_OK;

    const struct frame_list *only = &r->request.frames;
    size_t count = only->count ? only->count : (size_t)(r->request.last_frame - r->request.first_frame) + 1;

    for (size_t i = 0; i < count && result == STATUS_OK; i++) {
        result = fetch_frame(r, only->count ? only->items[i] : r->request.first_frame + (uint32_t)i, err);
        if (r->cut && result == STATUS_ERR_NOT_FOUND)
            result = STATUS_OK; /* it had no sample yet */
    }
    if (result == STATUS_OK && r->video)
        result = video_end(r->video, r->connection, err);
    if (result == STATUS_OK && r->video)
        json_array_append_new(r->files, json_text(r->video_path));
    video_free(r->video);
    r->video = NULL;
    return result;
}

/* The pictures cannot be written to their destination, and the local farm is about to delete them:
 * put them into a temporary folder, and add its name to the error. */
static void rescue_pictures(struct render *r, struct error *err)
{
    const char *parent = getenv("TMPDIR");
    struct buffer folder = BUFFER_INIT;
    struct error again = {0};
    size_t used = strlen(err->text);
    char *wanted = r->destination.folder;

    buffer_printf(&folder, "%s/azulejo-kept-XXXXXX", parent && *parent ? parent : "/tmp");
    if (buffer_ok(&folder) && mkdtemp((char *)folder.data)) {
        const char *how_many = "the";
        r->destination.folder = (char *)folder.data;
        r->video_path = NULL; /* it can be made of them */
        if (fetch_pictures(r, &again) != STATUS_OK)
            how_many = rmdir(r->destination.folder) == 0 ? NULL : "some of the";
        if (how_many)
            snprintf(err->text + used, sizeof err->text - used, "; %s pictures are kept in %s", how_many,
                     r->destination.folder);
        r->destination.folder = wanted;
    }
    buffer_release(&folder);
}

static status fetch_or_rescue(struct render *r, struct error *err)
{
    status result = fetch_pictures(r, err);

    if (result == STATUS_ERR_IO)
        rescue_pictures(r, err);
    return result;
}

/* The error after an interruption: which frames were cut short, and what was written. */
static status explain_cut(const struct render *r, struct error *err)
{
    const Azulejo__Wire__JobInfo *info = job_list_find(r->last->job_list, r->job);
    struct buffer text = BUFFER_INIT;
    char cut[CUT_FRAME_TEXT_SIZE];

    for (size_t i = 0; i < info->n_cut_frames; i++)
        buffer_printf(&text, "; %s", cut_frame_text(cut, info, info->cut_frames[i]));
    if (json_array_size(r->files) == 0)
        buffer_puts(&text, "; no frame has a sample yet, and nothing is written");
    for (size_t i = 0; i < json_array_size(r->files); i++)
        buffer_printf(&text, "%s%s", i ? ", " : "; written: ", json_string_value(json_array_get(r->files, i)));
    error_set(err, STATUS_ERR_JOB_FAILED, "interrupted%s", buffer_ok(&text) ? buffer_text(&text) : "");
    buffer_release(&text);
    return STATUS_ERR_JOB_FAILED;
}

static uint64_t pictures_made(const struct render *r)
{
    const Azulejo__Wire__JobInfo *info = job_list_find(r->last->job_list, r->job);

    return (uint64_t)info->frames_done + info->frames_developed;
}

/* Wait for the pictures, but not for a disk that stays full. */
static status await_cut(struct render *r, struct error *err)
{
    uint64_t made = 0;

    for (;;) {
        status result = watch_job(r->connection, r->job, r->quiet, clock_monotonic_ns() + CUT_PATIENCE_MS * NS_PER_MS,
                                  &r->last, err);
        if (result != STATUS_ERR_TIMEOUT)
            return result;
        TRY(job_query(r->connection, r->job, &r->last, err));
        if (pictures_made(r) == made)
            return error_set(err, STATUS_ERR_IO, "interrupted; no picture came in %d s, and what is "
                             "rendered is given up: %s", CUT_PATIENCE_MS / 1000,
                             job_list_find(r->last->job_list, r->job)->state_text);
        made = pictures_made(r);
        message_free(r->last);
        r->last = NULL;
    }
}

/* The first Ctrl-C ends the job with the samples that it has. The next one ends the command. */
static status cut_short(struct render *r, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result;

    local_farm_tolerate(r->farm);
    if (!r->quiet)
        fprintf(stderr, "interrupted: writing what is rendered; press Ctrl-C again to stop at once\n");
    result = verb_ask(r->connection, r->job, VERB_CANCEL, NULL, &answer, err);
    message_free(answer);
    THEN(result, await_cut(r, err));
    r->cut = 1;
    r->video_path = NULL; /* it would wait for ffmpeg */
    THEN(result, fetch_or_rescue(r, err));
    return result == STATUS_OK ? explain_cut(r, err) : result;
}

static status render_on_farm(struct render *r, struct error *err)
{
    const struct watch_how watch = {.quiet = r->quiet, .update = r->tev ? tev_update : NULL, .update_user = r->tev};
    struct job_accepted accepted = {0};
    status result;

    TRY(connection_open(&r->connection, local_farm_address(r->farm), err));
    connection_set_watch(r->connection, local_farm_check, r->farm);
    result = local_farm_check(r->farm, err); /* signals from before the connection watched */
    THEN(result, effects_auto_apply(&r->effects, r->connection, &r->scene, &r->request, r->quiet, err));
    THEN(result, submission_send(r->connection, &r->scene, &r->request, r->name, r->formats, r->quiet, &accepted, err));
    r->job = accepted.job;
    THEN(result, watch_job_as(r->connection, r->job, &watch, &r->last, err));
    if (result != STATUS_OK && r->job && signals_stop_count() == 1)
        return cut_short(r, err);
    THEN(result, job_info_verdict(job_list_find(r->last->job_list, r->job), err));
    THEN(result, fetch_or_rescue(r, err));
    return result;
}

static status report(struct render *r, struct error *err)
{
    const Azulejo__Wire__JobInfo *info = job_list_find(r->last->job_list, r->job);

    if (r->json)
        return json_print(json_pack("{s:o, s:O, s:o}", "job", json_message(&info->base), "files", r->files, "inputs",
                                    import_inputs_json(&r->scene)),
                          err);
    if (r->quiet)
        return STATUS_OK;
    job_info_print_summary(stdout, info);
    for (size_t i = 0; i < json_array_size(r->files); i++)
        printf("  %-10s  %s\n", "wrote", json_string_value(json_array_get(r->files, i)));
    return STATUS_OK;
}

/* The pictures are there; whether they are what was asked for is the exit status. */
static status finish(struct render *r, struct error *err)
{
    TRY(report(r, err));
    return job_info_missed(job_list_find(r->last->job_list, r->job), err);
}

/* A video is made of PNG pictures if no JPEG is asked for. */
static status check_video(struct render *r, uint32_t frames, struct error *err)
{
    r->formats = r->destination.formats;
    if (!r->video_path)
        return STATUS_OK;
    if (frames == 1)
        return error_set(err, STATUS_ERR_USAGE, "--video: of one frame? Give --frames, as in 0-47");
    if (!(r->formats & (OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG)))
        r->formats |= OUTPUT_FORMAT_PNG;
    return video_check(r->video_path, err);
}

/* Check everything that can be wrong on our side before a program is started. */
static status prepare(struct render *r, const char *out, struct error *err)
{
    uint32_t frames;
    status result = job_options_check(&r->options, &r->request, err);

    THEN(result, effects_auto_check(&r->effects, r->options.stop.said[STOP_target].text, err));
    if (result != STATUS_OK)
        return result;
    frames = r->request.last_frame - r->request.first_frame + 1;
    r->name = submission_name(r->scene_path);
    r->files = json_array();
    TRY(destination_init(&r->destination, out, r->request.output.formats, r->name, frames, err));
    TRY(check_video(r, frames, err));
    TRY(submission_prepare(r->scene_path, &r->options, r->quiet, &r->request, &r->scene, err));
    TRY(fetch_check_folder(r->destination.folder, err));
    return signals_catch(err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct render r = {.options = JOB_OPTIONS_INIT};
    const char *out = NULL;
    int64_t workers = 1, threads = 0;
    struct error again = {0};
    int done;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &out, "OUT",
         "where the files go: a folder, one picture's file (.exr, .png or .jpg), or the files' path "
         "without extension (default: the scene's name, in this folder)",
         0, 0, NULL},
        JOB_OPTION_ROWS(r.options),
        JOB_ENDS_ROW(r.options),
        EFFECTS_AUTO_ROWS(r.effects),
        {"workers", 'w', OPTION_INT, &workers, "N", "worker processes (default 1)", 1,
         LOCAL_WORKERS_MAX, NULL},
        {"threads", 'j', OPTION_INT, &threads, "N",
         "threads of each worker (default: the processors, divided among the workers)", 1, 1024,
         NULL},
        {"manifest", 0, OPTION_FLAG, &r.manifest, NULL,
         "also write each frame's manifest, ." MANIFEST_EXTENSION ": which effects ran, who called "
         "for them, and where the time went",
         0, 0, NULL},
        VIDEO_OPTION_ROW(r.video_path),
        TEV_OPTION_ROW(r.tev_address),
        {"json", 0, OPTION_FLAG, &r.json, NULL, "print JSON at the end", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &r.quiet, NULL, "no progress, no warnings, no summary", 0, 0,
         NULL},
        {"verbose", 'v', OPTION_FLAG, &r.local.verbose, NULL,
         "show the logs of the coordinator and the workers", 0, 0, NULL},
        {"web", 0, OPTION_FLAG, &r.local.web, NULL,
         "with a page that shows the picture becoming right, at the address that is printed", 0, 0, NULL},
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command, tonemap_options_table(&r.options.output.tone, table, rows), argc, argv, 1, 1,
                                  &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    r.scene_path = rest.items[0];
    r.local.workers = (unsigned)workers;
    r.local.threads = (unsigned)threads;
    if (r.tev_address)
        result = tev_new(&r.tev, r.tev_address, r.quiet, err);
    THEN(result, prepare(&r, out, err));
    THEN(result, local_farm_start(&r.farm, &r.local, err));
    if (result == STATUS_OK) {
        result = render_on_farm(&r, err);
        if (result != STATUS_OK)
            result = local_farm_explain(r.farm, result, err);
    }
    connection_close(r.connection);
    local_farm_stop(r.farm);
    if (result == STATUS_OK)
        result = finish(&r, err);
    else if (r.cut && r.last && report(&r, &again) != STATUS_OK)
        fprintf(stderr, "azulejo: %s\n", again.text);
    message_free(r.last);
    tev_free(r.tev);
    json_decref(r.files);
    destination_release(&r.destination);
    import_result_release(&r.scene);
    job_request_release(&r.request);
    mem_free(r.name);
    return result;
}

const struct command command_render = {
    .name = "render",
    .group = COMMAND_RENDER,
    .usage = "azulejo render SCENE [OPTION]...",
    .summary = "render a scene on this machine",
    .description =
        "Render a scene (glTF 2.0, pbrt, OBJ or PLY) with a coordinator and workers of its own, which live\n"
        "as long as the command. Writes an EXR file with the linear radiance and a tone mapped PNG. Ctrl-C\n"
        "writes them with the samples that there are, and says how many; a second Ctrl-C stops at once.\n"
        "Exit status 9 when the pictures miss --target-error by more than a tenth.",
    .run = run,
};
