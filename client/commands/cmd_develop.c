/* azulejo develop: tone map a job's pictures again, without rendering. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/follow/fetch.h"
#include "client/follow/figures_view.h"
#include "client/follow/job_info.h"
#include "client/options/output.h"
#include "client/farm/job_choice.h"
#include "client/terminal/progress.h"
#include "client/link/signals.h"
#include "client/farm/upload.h"
#include "protocol/message.h"

enum { POLL_MS = 100 };

struct develop {
    struct connection *connection;
    uint64_t job;
    struct output_options options;
    struct output_request request;
    uint32_t revision;             /* of ours */
    Azulejo__Wire__Envelope *last; /* the latest JobList */
};

static const Azulejo__Wire__JobInfo *job_of(const struct develop *d)
{
    return job_list_find(d->last->job_list, d->job);
}

static status look(struct develop *d, struct error *err)
{
    message_free(d->last);
    d->last = NULL;
    return job_query(d->connection, d->job, &d->last, err);
}

/* Options about the files default to the job's; everything else is new. */
static status choose_formats(struct develop *d, unsigned *formats, struct error *err)
{
    static const Azulejo__Wire__OutputSettings none = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    const Azulejo__Wire__OutputSettings *now = job_of(d)->output ? job_of(d)->output : &none;
    struct output_request *request = &d->request;
    unsigned there = output_message_formats(now);

    *formats = request->formats ? request->formats : there;
    if (*formats & OUTPUT_FORMAT_EXR && !(there & OUTPUT_FORMAT_EXR))
        return error_set(err, STATUS_ERR_USAGE,
                         "--format: job %" PRIu64
                         " has no EXR, and developing cannot add one: that is decided when a job is submitted",
                         d->job);
    if (!(*formats & ~(unsigned)OUTPUT_FORMAT_EXR))
        return error_set(err, STATUS_ERR_USAGE,
                         "nothing to develop: job %" PRIu64 " makes no PNG and no JPEG; ask for "
                         "them with --format png or --format png,jpg",
                         d->job);
    *formats |= there & OUTPUT_FORMAT_EXR;
    request->half = now->exr_half;
    if (!request->png_bits)
        request->png_bits = now->png_bits;
    if (!request->jpeg_quality)
        request->jpeg_quality = now->jpeg_quality;
    request->camera_ev = now->camera_ev;
    request->tonemap.exposure_ev += now->camera_ev;
    return STATUS_OK;
}

static status send_file(struct develop *d, struct error *err)
{
    const struct output_request *request = &d->request;
    struct upload_item item = {request->tonemap.file, request->tonemap_file.data,
                               request->tonemap_file.size};
    struct upload_progress sent;

    if (!request->tonemap.has_file)
        return STATUS_OK;
    return upload_blobs(d->connection, &item, 1, NULL, NULL, &sent, err);
}

static status send_develop(struct develop *d, unsigned formats, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobDevelop body = AZULEJO__WIRE__JOB_DEVELOP__INIT;
    struct wire_output output;
    status result;

    output_message_set(&output, &d->request, formats);
    body.job = d->job;
    body.output = &output.message;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_DEVELOP;
    envelope.job_develop = &body;
    message_free(d->last);
    d->last = NULL;
    result = job_ask(d->connection, &envelope, d->job, &d->last, err);
    if (result == STATUS_OK)
        d->revision = job_of(d)->revision;
    return result;
}

/* Is the farm still making our pictures? */
static status check(const struct develop *d, int *done, struct error *err)
{
    const Azulejo__Wire__JobInfo *info = job_of(d);
    char why[512];

    *done = 0;
    if (signals_stop())
        return error_set(err, STATUS_ERR_JOB_FAILED, "detached; the pictures of job %" PRIu64 " are still being made",
                         d->job);
    if (info->revision != d->revision)
        return error_set(err, STATUS_ERR_JOB_FAILED,
                         "job %" PRIu64 " is now being developed in another way, which was "
                         "requested after ours ('azulejo show %" PRIu64 "' shows it)",
                         d->job, d->job);
    if (info->develop_error[0])
        return error_set(err, STATUS_ERR_JOB_FAILED, "the pictures of job %" PRIu64 " cannot be made: %s", d->job,
                         message_text(why, sizeof why, info->develop_error));
    *done = info->frames_developed >= info->frames_done;
    return STATUS_OK;
}

static status await_pictures(struct develop *d, int quiet, struct error *err)
{
    struct progress progress;
    int done;
    status result = check(d, &done, err);

    progress_init(&progress, quiet);
    while (result == STATUS_OK && !done) {
        const Azulejo__Wire__JobInfo *info = job_of(d);
        struct pollfd wake = {.fd = signals_fd(), .events = POLLIN};
        char text[96];

        snprintf(text, sizeof text, "developing, %u of %u frame%s", info->frames_developed, info->frames_done,
                 info->frames_done == 1 ? "" : "s");
        progress_draw(&progress, (double)info->frames_developed / (double)info->frames_done, text);
        (void)poll(&wake, 1, POLL_MS); /* a signal or a timeout: check again either way */
        result = look(d, err);
        THEN(result, check(d, &done, err));
    }
    progress_clear(&progress);
    return result;
}

static void print_outcome(const Azulejo__Wire__JobInfo *info, int waited)
{
    uint32_t frames = info->last_frame - info->first_frame + 1;

    if (!waited || info->frames_done == 0)
        printf("job %" PRIu64 ": the pictures will be made with %s\n", info->job,
               info->output ? info->output->tonemap : "?");
    else
        printf("job %" PRIu64 ": %u frame%s developed with %s%s\n", info->job, info->frames_developed,
               info->frames_developed == 1 ? "" : "s", info->output ? info->output->tonemap : "?",
               info->frames_done < frames ? "; later ones will be, too" : "");
    if (info->output && info->output->denoise[0] && strcmp(info->output->denoise, denoising_name(DENOISING_OFF)) != 0) {
        struct buffer errors = BUFFER_INIT;
        if (info->now && info->now->figures && info->now->denoised)
            figures_describe_both(&errors, info->now);
        if (errors.size && buffer_ok(&errors))
            printf("  error: %s\n", buffer_text(&errors));
        if (info->settings && (info->settings->aovs & AOV_FOR_DENOISING) != AOV_FOR_DENOISING)
            printf("  denoised by colours alone: the job was submitted without --denoise\n");
        buffer_release(&errors);
    }
}

static status report(const struct develop *d, const struct job_fetch *fetch, int json, int quiet, int waited,
                     struct error *err)
{
    json_t *out;

    if (!json) {
        if (!quiet)
            print_outcome(job_of(d), waited);
        return STATUS_OK;
    }
    out = json_pack("{s:o}", "job", json_message(&job_of(d)->base));
    if (fetch->to.folder)
        json_object_update_new(out, job_fetch_json(fetch));
    return json_print(out, err);
}

static status develop(struct develop *d, struct job_fetch *fetch, int wait, int json, int quiet, struct error *err)
{
    const struct frame_list all = {0};
    unsigned formats;
    status result = look(d, err), fetched = STATUS_OK;

    THEN(result, choose_formats(d, &formats, err));
    THEN(result, send_file(d, err));
    THEN(result, send_develop(d, formats, err));
    if (result == STATUS_OK && wait)
        result = await_pictures(d, quiet || json, err);
    if (result != STATUS_OK)
        return result;
    if (fetch->to.folder && job_of(d)->frames_done > 0) {
        fetch->connection = d->connection;
        fetch->job = job_of(d);
        fetch->json = json || quiet;
        fetched = job_fetch_pictures(fetch, &all, err);
    }
    if (fetched == STATUS_OK || fetched == STATUS_ERR_INCOMPLETE)
        result = report(d, fetch, json, quiet || fetch->to.folder, wait, err);
    return result == STATUS_OK ? fetched : result;
}

status develop_command(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct develop d = {0};
    struct job_fetch fetch = {.finished_only = 1};
    const char *out = NULL;
    int no_wait = 0, json = 0, quiet = 0, done;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &out, "OUT",
         "fetch the new pictures: a folder for them, created if it is missing, or one picture's file (.png or .jpg)",
         0, 0, NULL},
        JOB_FETCH_FORCE_ROW(fetch.force),
        {"operator", 0, OPTION_STRING, &d.options.tone.tonemap, "OPERATOR", "the same as --tonemap",
         0, 0, NULL},
        OUTPUT_OPTION_ROWS(d.options),
        {"no-wait", 0, OPTION_FLAG, &no_wait, NULL, "do not wait until the pictures are made", 0, 0,
         NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &quiet, NULL, "no progress and no report", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command, tonemap_options_table(&d.options.tone, table, rows), argc, argv, 1, 1, &rest,
                                  &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (no_wait && out)
        return error_set(err, STATUS_ERR_USAGE,
                         "--no-wait: pictures that are not made yet cannot be fetched; leave out "
                         "either it or --output");
    result = job_word_check(rest.items[0], err);
    THEN(result, output_options_check(&d.options, &d.request, err));
    THEN(result, tonemap_key_check(&d.request.tonemap, where.key_path, err));
    if (result == STATUS_OK && out)
        result = destination_of_job(&fetch.to, out, OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG, err);
    if (result == STATUS_OK && out)
        result = fetch_check_folder(fetch.to.folder, err);
    THEN(result, connection_open(&d.connection, &where, err));
    THEN(result, job_word_find(d.connection, rest.items[0], &d.job, err));
    THEN(result, signals_catch(err));
    THEN(result, develop(&d, &fetch, !no_wait, json, quiet, err));
    job_fetch_release(&fetch);
    message_free(d.last);
    connection_close(d.connection);
    output_request_release(&d.request);
    return result;
}
