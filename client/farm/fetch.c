#include "client/farm/fetch.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/terminal/format.h"
#include "client/farm/output.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

static status append_piece(struct buffer *data, size_t start, const Azulejo__Wire__OutputData *piece,
                           struct error *err)
{
    if (piece->total_bytes > FETCH_BYTES_MAX || piece->offset != data->size - start ||
        piece->data.len > piece->total_bytes - piece->offset ||
        (piece->data.len == 0 && piece->total_bytes != piece->offset))
        return error_set(err, STATUS_ERR_PROTOCOL,
                         "the coordinator sent an output's pieces out of order or too large");
    if (piece->offset == 0)
        buffer_reserve(data, piece->total_bytes);
    buffer_append(data, piece->data.data, piece->data.len);
    return buffer_ok(data) ? STATUS_OK : error_no_memory(err, "an output");
}

static status fetch_shown(struct connection *c, uint64_t job, uint32_t frame,
                          Azulejo__Wire__OutputKind kind, struct buffer *data,
                          struct preview_shows *shows, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__OutputGet get = AZULEJO__WIRE__OUTPUT_GET__INIT;
    size_t start = data->size;
    uint64_t total = 0;
    int first = 1;
    status result;

    get.job = job;
    get.frame = frame;
    get.kind = kind;
    envelope.request = connection_request_id(c);
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_GET;
    envelope.output_get = &get;
    result = connection_send(c, &envelope, err);
    while (result == STATUS_OK && (first || data->size - start < total)) {
        Azulejo__Wire__Envelope *answer = NULL;
        result = connection_receive(c, envelope.request, &answer, err);
        if (result != STATUS_OK)
            break;
        if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_DATA ||
            (!first && answer->output_data->total_bytes != total)) {
            result = error_set(err, STATUS_ERR_PROTOCOL, "an output was answered with something "
                                                         "else (message %d)",
                               (int)answer->body_case);
        } else {
            total = answer->output_data->total_bytes;
            *shows = (struct preview_shows){answer->output_data->preview_covered,
                                            answer->output_data->preview_samples};
            result = append_piece(data, start, answer->output_data, err);
        }
        first = 0;
        message_free(answer);
    }
    return result;
}

status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err)
{
    struct preview_shows shows;

    return fetch_shown(c, job, frame, kind, data, &shows, err);
}

status fetch_check_folder(const char *folder, struct error *err)
{
    struct buffer probe = BUFFER_INIT;
    status result = file_make_folder(folder, err);
    int fd;

    if (result != STATUS_OK)
        return result;
    buffer_printf(&probe, "%s/.azulejo-XXXXXX", folder);
    if (!buffer_ok(&probe)) {
        result = error_no_memory(err, "a path");
        goto done;
    }
    fd = mkstemp((char *)probe.data);
    if (fd < 0) {
        result = error_set(err, STATUS_ERR_IO,
                           "%s: nothing can be written there: %s (choose another place with -o)",
                           folder, strerror(errno));
        goto done;
    }
    close(fd);
    unlink((char *)probe.data);
done:
    buffer_release(&probe);
    return result;
}

static const char *kind_extension(Azulejo__Wire__OutputKind kind)
{
    switch (kind) {
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR: return "exr";
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG: return "jpg";
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON: return MANIFEST_EXTENSION;
    default: return "png";
    }
}

void job_fetch_release(struct job_fetch *f)
{
    json_decref(f->files);
    json_decref(f->missing);
    json_decref(f->preview);
    claim_release(&f->claim);
}

static void append_row(json_t **rows, json_t *row)
{
    if (!*rows)
        *rows = json_array();
    json_array_append_new(*rows, row);
}

/* `note`: for people, after the size; NULL: none. */
static status write_file(struct job_fetch *f, const char *path, const struct buffer *data,
                         const char *note, struct error *err)
{
    char size[FORMAT_SIZE];
    status result = file_write_atomic(path, data->data, data->size, err);

    if (result != STATUS_OK)
        return result;
    f->fetched++;
    if (f->json)
        append_row(&f->files, json_text(path));
    else
        printf("%s  %s%s%s\n", path, format_bytes(size, data->size), note ? "  " : "", note ? note : "");
    return STATUS_OK;
}

/* "a preview: 2 of 64 samples a pixel; 37 % of the tiles have any, the others are filled from those
 * around them" */
static void describe_preview(struct buffer *out, const struct preview_shows *shows, uint32_t spp)
{
    if (!(shows->covered > 0))
        return; /* an older coordinator */
    buffer_printf(out, "a preview: %.3g of %u samples a pixel", shows->samples, spp);
    if (shows->covered < 1)
        /* Never rounded up to 100 %. */
        buffer_printf(out, "; %g %% of the tiles have any, the others are filled from those around them",
                      shows->covered < 0.1 ? floor(shows->covered * 1000) / 10 : floor(shows->covered * 100));
}

status job_fetch_preview(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                         const char *path, struct error *err)
{
    struct buffer data = BUFFER_INIT, note = BUFFER_INIT;
    struct preview_shows shows = {0};
    uint32_t spp = f->job->settings ? f->job->settings->spp : 0;
    status result = fetch_shown(f->connection, f->job->job, frame, kind, &data, &shows, err);

    describe_preview(&note, &shows, spp);
    if (result == STATUS_OK)
        result = write_file(f, path, &data, note.size ? buffer_text(&note) : NULL, err);
    if (result == STATUS_OK && f->json && shows.covered > 0)
        f->preview = json_pack("{s:I, s:o, s:o, s:I}", "frame", (json_int_t)frame, "covered",
                               json_number(shows.covered), "samples", json_number(shows.samples),
                               "spp", (json_int_t)spp);
    buffer_release(&note);
    buffer_release(&data);
    return result;
}

/* "BASE.exr", or "BASE-0007.exr" where a job has several frames. */
static status output_path(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                          char **path, struct error *err)
{
    struct buffer name = BUFFER_INIT;
    status result = STATUS_OK;

    *path = NULL;
    if (f->claim.base.size == 0)
        result = claim_take(&f->claim, f->folder, f->job, f->force, err);
    if (result != STATUS_OK)
        return result;
    buffer_puts(&name, buffer_text(&f->claim.base));
    if (f->job->last_frame > f->job->first_frame)
        buffer_printf(&name, "-%04u", frame);
    buffer_printf(&name, ".%s", kind_extension(kind));
    *path = buffer_ok(&name) ? file_join(f->folder, buffer_text(&name)) : NULL;
    buffer_release(&name);
    return *path ? STATUS_OK : error_no_memory(err, "a path");
}

/* Does this failure concern only the requested file? */
static int is_of_the_file(status code)
{
    return code == STATUS_ERR_NOT_FOUND || code == STATUS_ERR_CORRUPT || code == STATUS_ERR_IO ||
           code == STATUS_ERR_INPUT || code == STATUS_ERR_LIMIT ||
           code == STATUS_ERR_UNSUPPORTED || code == STATUS_ERR_INTERNAL;
}

static void note_missing(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                         const struct error *why)
{
    if (f->failed++ == 0)
        f->first = *why;
    if (f->json)
        append_row(&f->missing, json_pack("{s:I, s:s, s:o}", "frame", (json_int_t)frame, "file",
                                          kind_extension(kind), "error", json_text(why->text)));
    else
        fprintf(stderr, "%s\n", why->text);
}

/* Fetch one of a frame's files. `why` is set if the coordinator cannot send it. */
static status fetch_one(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                        struct error *why, struct error *err)
{
    struct buffer data = BUFFER_INIT;
    char *path = NULL;
    status result = fetch_output(f->connection, f->job->job, frame, kind, &data, why);

    if (result == STATUS_OK) {
        result = output_path(f, frame, kind, &path, err);
        if (result == STATUS_OK)
            result = write_file(f, path, &data, NULL, err);
        claim_unlock(&f->claim);
    } else if (is_of_the_file(result)) {
        result = STATUS_OK;
    } else if (err) {
        *err = *why;
    }
    mem_free(path);
    buffer_release(&data);
    return result;
}

/* It is not rendered until the job is extended or tried again. */
static int is_resting(const Azulejo__Wire__JobInfo *job, uint32_t frame)
{
    uint32_t i = frame - job->first_frame;

    return i / 8 < job->resting.len && (job->resting.data[i / 8] >> i % 8 & 1);
}

/* Every format of one frame. A frame without any file is not rendered yet, unless the job is
 * done. */
static status fetch_frame(struct job_fetch *f, uint32_t frame, struct error *err)
{
    static const Azulejo__Wire__OutputKind kinds[] = {
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR,
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG,
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG,
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON,
    };
    enum { KINDS = sizeof kinds / sizeof *kinds };
    unsigned wanted = f->job->output ? output_message_formats(f->job->output) & f->formats : 0;
    struct error why[KINDS] = {0};
    int rendered = f->job->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE && !is_resting(f->job, frame);
    status result = STATUS_OK;

    if (f->manifest)
        wanted |= 1u << OUTPUT_FORMAT_COUNT;
    for (int i = 0; i < KINDS && result == STATUS_OK; i++) {
        if (!(wanted >> i & 1))
            continue;
        result = fetch_one(f, frame, kinds[i], &why[i], err);
        rendered |= why[i].code != STATUS_ERR_NOT_FOUND;
    }
    for (int i = 0; i < KINDS && rendered && result == STATUS_OK; i++)
        if (why[i].code != STATUS_OK)
            note_missing(f, frame, kinds[i], &why[i]);
    f->not_rendered += result == STATUS_OK && !rendered;
    return result;
}

/* Compare what was fetched with what was wanted. */
static status verdict(const struct job_fetch *f, uint64_t frames, struct error *err)
{
    char frames_text[80] = "", files_text[80] = "";
    const char *which =
        frames <= f->job->last_frame - f->job->first_frame ? " of this number" : "";

    if (f->fetched == 0 && f->failed > 0)
        return error_set(err, f->first.code, "%s", f->first.text);
    if (f->fetched == 0 && job_state_is_final(f->job->state))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " is %s and has no picture%s",
                         f->job->job, job_state_name(f->job->state), which);
    if (f->fetched == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " has no finished frame%s (--preview FILE.png shows the "
                         "one in work)",
                         f->job->job, which);
    if (f->not_rendered)
        snprintf(frames_text, sizeof frames_text, "%zu of %" PRIu64 " frames %s not rendered%s",
                 f->not_rendered, frames, f->not_rendered == 1 ? "is" : "are",
                 job_state_is_final(f->job->state) ? "" : " yet");
    if (f->failed)
        snprintf(files_text, sizeof files_text, "%zu file%s could not be fetched", f->failed,
                 f->failed == 1 ? "" : "s");
    if (f->failed == 0 && (f->not_rendered == 0 || f->finished_only)) {
        if (f->not_rendered)
            fprintf(stderr, "%s\n", frames_text);
        return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_INCOMPLETE, "job %" PRIu64 ": %s%s%s; the rest is here",
                     f->job->job, frames_text, f->not_rendered && f->failed ? ", " : "",
                     files_text);
}

status job_fetch_pictures(struct job_fetch *f, const struct frame_list *only, struct error *err)
{
    const Azulejo__Wire__JobInfo *job = f->job;
    uint64_t count = only->count ? only->count : (uint64_t)job->last_frame - job->first_frame + 1;
    uint64_t wanted = 0;
    status result = STATUS_OK;

    for (uint64_t i = 0; i < count && result == STATUS_OK; i++) {
        uint32_t frame = only->count ? only->items[i] : job->first_frame + (uint32_t)i;
        if (only->count == 0 && is_resting(job, frame))
            continue;
        wanted++;
        result = fetch_frame(f, frame, err);
    }
    return result == STATUS_OK ? verdict(f, wanted, err) : result;
}

json_t *job_fetch_json(const struct job_fetch *f)
{
    json_t *json = json_pack("{s:o, s:o}", "files", f->files ? json_incref(f->files) : json_array(),
                             "missing", f->missing ? json_incref(f->missing) : json_array());

    if (f->preview)
        json_object_set(json, "preview", f->preview);
    return json;
}
