#include "client/follow/fetch.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/terminal/format.h"
#include "client/options/output.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

static status append_piece(struct buffer *data, size_t start, const Azulejo__Wire__OutputData *piece, struct error *err)
{
    if (piece->total_bytes > FETCH_BYTES_MAX || piece->offset != data->size - start ||
        piece->data.len > piece->total_bytes - piece->offset ||
        (piece->data.len == 0 && piece->total_bytes != piece->offset))
        return error_set(err, STATUS_ERR_PROTOCOL, "the coordinator sent an output's pieces out of order or too large");
    if (piece->offset == 0)
        buffer_reserve(data, piece->total_bytes);
    buffer_append(data, piece->data.data, piece->data.len);
    must_hold(data);
    return STATUS_OK;
}

/* `have`: NULL, or of the file that is there. *unchanged and *shows are set from the answer. */
static status fetch_answer(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind,
                           const struct digest *have, int *unchanged, Azulejo__Wire__OutputSettings *look,
                           struct preview_shows *shows, struct buffer *data, struct error *err)
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
    get.output = look;
    if (have)
        wire_digest_set(&get.have, have);
    *unchanged = 0;
    envelope.request = connection_request_id(c);
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_GET;
    envelope.output_get = &get;
    result = connection_send(c, &envelope, err);
    while (result == STATUS_OK && !*unchanged && (first || data->size - start < total)) {
        Azulejo__Wire__Envelope *answer = NULL;
        result = connection_receive(c, envelope.request, &answer, err);
        if (result != STATUS_OK)
            break;
        if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_DATA ||
            (!first && answer->output_data->total_bytes != total)) {
            result = error_set(err, STATUS_ERR_PROTOCOL, "an output was answered with something "
                                                         "else (message %d)",
                               (int)answer->body_case);
        } else if (have && first && answer->output_data->unchanged) {
            *unchanged = 1;
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

status fetch_output_unless(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind,
                           const struct digest *have, int *unchanged, struct buffer *data, struct error *err)
{
    struct preview_shows shows;

    return fetch_answer(c, job, frame, kind, have, unchanged, NULL, &shows, data, err);
}

status fetch_output(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind,
                    struct buffer *data, struct error *err)
{
    int unchanged;

    return fetch_output_unless(c, job, frame, kind, NULL, &unchanged, data, err);
}

status fetch_check_folder(const char *folder, struct error *err)
{
    struct buffer probe = BUFFER_INIT;
    status result = file_make_folder(folder, err);
    int fd;

    if (result != STATUS_OK)
        return result;
    buffer_printf(&probe, "%s/.azulejo-XXXXXX", folder);
    must_hold(&probe);
    fd = mkstemp((char *)probe.data);
    if (fd < 0) {
        result = error_set(err, STATUS_ERR_IO, "%s: nothing can be written there: %s (choose another place with -o)",
                           folder, strerror(errno));
    } else {
        close(fd);
        unlink((char *)probe.data);
    }
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
    buffer_release(&f->found);
    destination_release(&f->to);
    mem_free(f->followed);
}

static void append_row(json_t **rows, json_t *row)
{
    if (!*rows)
        *rows = json_array();
    json_array_append_new(*rows, row);
}

/* Is the file in the list already? */
static int is_listed(const json_t *files, const char *path)
{
    for (size_t i = 0; i < json_array_size(files); i++)
        if (strcmp(json_string_value(json_array_get(files, i)), path) == 0)
            return 1;
    return 0;
}

/* A file is where it belongs. */
static void note_file(struct job_fetch *f, const char *path, const char *what)
{
    f->fetched++;
    if (!f->json)
        printf("%s  %s\n", path, what);
    else if (!f->again || !is_listed(f->files, path))
        append_row(&f->files, json_text(path));
}

/* `note`: for people, after the size; NULL: none. */
static status write_file(struct job_fetch *f, const char *path, const struct buffer *data, const char *note,
                         struct error *err)
{
    char size[FORMAT_SIZE], what[256];
    status result = file_write_atomic(path, data->data, data->size, err);

    if (result == STATUS_OK && note)
        snprintf(what, sizeof what, "%s  %s", bytes_text(size, data->size), note);
    if (result == STATUS_OK)
        note_file(f, path, note ? what : bytes_text(size, data->size));
    return result;
}

/* "a preview: 2 of 64 samples a pixel; 37 % of the tiles have any, the others are filled from those around them" */
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

status job_fetch_preview(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, const char *path,
                         struct error *err)
{
    struct buffer data = BUFFER_INIT, note = BUFFER_INIT;
    struct preview_shows shows = {0};
    uint32_t spp = f->job->settings ? f->job->settings->spp : 0;
    int unchanged;
    status result =
        fetch_answer(f->connection, f->job->job, frame, kind, NULL, &unchanged, f->look, &shows, &data, err);

    describe_preview(&note, &shows, spp);
    THEN(result, write_file(f, path, &data, note.size ? buffer_text(&note) : NULL, err));
    if (result == STATUS_OK && f->json && shows.covered > 0)
        f->preview =
            json_pack("{s:I, s:o, s:o, s:I}", "frame", (json_int_t)frame, "covered", json_number(shows.covered),
                      "samples", json_number(shows.samples), "spp", (json_int_t)spp);
    buffer_release(&note);
    buffer_release(&data);
    return result;
}

/* "BASE.exr", or "BASE-0007.exr" where a job has several frames. NULL: out of memory. */
static char *path_of(const struct job_fetch *f, const char *base, uint32_t frame, Azulejo__Wire__OutputKind kind)
{
    struct buffer name = BUFFER_INIT;
    char *path;

    if (f->to.base) {
        destination_path(&f->to, frame, kind_extension(kind), &name);
        must_hold(&name);
        path = must(mem_strdup(buffer_text(&name)));
    } else {
        buffer_puts(&name, base);
        if (f->job->last_frame > f->job->first_frame)
            buffer_printf(&name, "-%04u", frame);
        buffer_printf(&name, ".%s", kind_extension(kind));
        must_hold(&name);
        path = must(file_join(f->to.folder, buffer_text(&name)));
    }
    buffer_release(&name);
    return path;
}

static status output_path(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, char **path,
                          struct error *err)
{
    status result = STATUS_OK;

    *path = NULL;
    if (!f->to.base && f->claim.base.size == 0)
        result = claim_take(&f->claim, f->to.folder, f->job, f->force, err);
    if (result == STATUS_OK)
        *path = path_of(f, buffer_text(&f->claim.base), frame, kind);
    return result;
}

/* The file as it may be there from before: its path and its digest. NULL: it is not. */
static char *present_file(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, struct digest *digest)
{
    const struct buffer *base = f->claim.base.size ? &f->claim.base : &f->found;
    uint64_t size;
    char *path;

    if (!f->sought && !f->to.base && f->force)
        claim_plain_name(f->job, &f->found);
    else if (!f->sought && !f->to.base && claim_find(f->to.folder, f->job, &f->found, NULL) != STATUS_OK)
        buffer_clear(&f->found); /* taking a claim reports it */
    f->sought = 1;
    if (!f->to.base && base->size == 0)
        return NULL;
    path = path_of(f, buffer_text(base), frame, kind);
    if (path && digest_of_file(digest, &size, path, NULL) == STATUS_OK)
        return path;
    mem_free(path);
    return NULL;
}

/* Does this failure concern only the requested file? */
static int is_of_the_file(status code)
{
    return code == STATUS_ERR_NOT_FOUND || code == STATUS_ERR_CORRUPT || code == STATUS_ERR_IO ||
           code == STATUS_ERR_INPUT || code == STATUS_ERR_LIMIT || code == STATUS_ERR_UNSUPPORTED ||
           code == STATUS_ERR_INTERNAL;
}

static void note_missing(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, const struct error *why)
{
    if (f->failed++ == 0)
        f->first = *why;
    if (f->json)
        append_row(&f->missing, json_pack("{s:I, s:s, s:o}", "frame", (json_int_t)frame, "file", kind_extension(kind),
                                          "error", json_text(why->text)));
    else
        fprintf(stderr, "%s\n", why->text);
}

/* Fetch one of a frame's files. `why` is set if the coordinator cannot send it. */
static status fetch_one(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, struct error *why,
                        struct error *err)
{
    struct buffer data = BUFFER_INIT;
    struct digest have;
    int unchanged;
    char *present = present_file(f, frame, kind, &have), *path = NULL;
    status result =
        fetch_output_unless(f->connection, f->job->job, frame, kind, present ? &have : NULL, &unchanged, &data, why);

    if (result == STATUS_OK && unchanged) {
        f->unchanged++;
        note_file(f, present, "unchanged");
    } else if (result == STATUS_OK) {
        result = output_path(f, frame, kind, &path, err);
        THEN(result, write_file(f, path, &data, NULL, err));
        claim_unlock(&f->claim);
    } else if (is_of_the_file(result)) {
        result = STATUS_OK;
    } else if (err) {
        *err = *why;
    }
    mem_free(path);
    mem_free(present);
    buffer_release(&data);
    return result;
}

int job_frame_listed(const Azulejo__Wire__JobInfo *job, const ProtobufCBinaryData *list, uint32_t frame)
{
    uint32_t i = frame - job->first_frame;

    return i / 8 < list->len && (list->data[i / 8] >> i % 8 & 1);
}

/* It is not rendered until the job is extended or tried again. */
static int is_resting(const Azulejo__Wire__JobInfo *job, uint32_t frame)
{
    return job_frame_listed(job, &job->resting, frame);
}

static const Azulejo__Wire__OutputKind kinds[FETCH_KINDS] = {
    AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR,
    AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG,
    AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG,
    AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON,
};

unsigned job_fetch_kinds(const struct job_fetch *f)
{
    unsigned formats = f->job->output ? output_message_formats(f->job->output) & f->to.formats : 0;

    return formats | (f->manifest ? FETCH_MANIFEST : 0);
}

status job_fetch_begin(struct job_fetch *f, size_t frames, struct error *err)
{
    uint64_t job = f->job->job;

    f->to.numbered = frames > 1;
    if (!f->to.base || job_fetch_kinds(f) & OUTPUT_FORMAT_ALL)
        return STATUS_OK;
    if (f->to.formats == OUTPUT_FORMAT_EXR)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " makes no EXR: that is decided when a job is submitted", job);
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "job %" PRIu64 " makes no %s: 'azulejo develop %" PRIu64 " --format %s' makes it", job,
                     f->to.formats == OUTPUT_FORMAT_PNG ? "PNG" : "JPEG", job,
                     f->to.formats == OUTPUT_FORMAT_PNG ? "png" : "jpg");
}

status job_fetch_some(struct job_fetch *f, uint32_t frame, unsigned mask, struct error *err)
{
    uint8_t *state = &f->followed[frame - f->job->first_frame];
    status result = STATUS_OK;

    for (unsigned i = 0; i < FETCH_KINDS && result == STATUS_OK; i++) {
        struct error why = {0};
        if (!(mask >> i & 1) || *state & (FETCH_GOT(i) | FETCH_TRIED(i)))
            continue;
        result = fetch_one(f, frame, kinds[i], &why, err);
        if (result == STATUS_OK)
            *state |= (uint8_t)(why.code == STATUS_OK ? FETCH_GOT(i) : FETCH_TRIED(i));
    }
    return result;
}

/* Every format of one frame. A frame without any file is not rendered yet, unless the job is done. */
static status fetch_frame(struct job_fetch *f, uint32_t frame, struct error *err)
{
    unsigned wanted = job_fetch_kinds(f);
    unsigned followed = f->followed ? f->followed[frame - f->job->first_frame] : 0;
    struct error why[FETCH_KINDS] = {0};
    int rendered = f->job->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE && !is_resting(f->job, frame);
    status result = STATUS_OK;

    for (unsigned i = 0; i < FETCH_KINDS && result == STATUS_OK; i++) {
        if (!(wanted >> i & 1))
            continue;
        if (!(followed & FETCH_GOT(i)))
            result = fetch_one(f, frame, kinds[i], &why[i], err);
        if (f->followed && result == STATUS_OK && why[i].code == STATUS_OK)
            f->followed[frame - f->job->first_frame] |= (uint8_t)FETCH_GOT(i);
        rendered |= why[i].code != STATUS_ERR_NOT_FOUND;
    }
    for (unsigned i = 0; i < FETCH_KINDS && rendered && result == STATUS_OK; i++)
        if (why[i].code != STATUS_OK)
            note_missing(f, frame, kinds[i], &why[i]);
    f->not_rendered += result == STATUS_OK && !rendered;
    return result;
}

/* Compare what was fetched with what was wanted. */
static status verdict(const struct job_fetch *f, uint64_t frames, struct error *err)
{
    char frames_text[80] = "", files_text[80] = "";
    const char *which = frames <= f->job->last_frame - f->job->first_frame ? " of this number" : "";

    if (f->fetched == 0 && f->failed > 0)
        return error_set(err, f->first.code, "%s", f->first.text);
    if (f->fetched == 0 && job_state_ended(f->job->state))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " is %s and has no picture%s", f->job->job,
                         job_state_word(f->job->state), which);
    if (f->fetched == 0 && (f->job->state == AZULEJO__WIRE__JOB_STATE__JOB_PAUSED ||
                            f->job->state == AZULEJO__WIRE__JOB_STATE__JOB_PARKED))
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " is %s and has no finished frame%s ('azulejo resume %" PRIu64
                         "' continues it)",
                         f->job->job, job_state_word(f->job->state), which, f->job->job);
    if (f->fetched == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " has no finished frame%s (--preview FILE.png shows the "
                         "one in work)",
                         f->job->job, which);
    if (f->not_rendered)
        snprintf(frames_text, sizeof frames_text, "%zu of %" PRIu64 " frames %s not rendered%s", f->not_rendered,
                 frames, f->not_rendered == 1 ? "is" : "are", job_state_ended(f->job->state) ? "" : " yet");
    if (f->failed)
        snprintf(files_text, sizeof files_text, "%zu file%s could not be fetched", f->failed,
                 f->failed == 1 ? "" : "s");
    if (f->failed == 0 && (f->not_rendered == 0 || f->finished_only)) {
        if (f->not_rendered)
            fprintf(stderr, "%s\n", frames_text);
        return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_INCOMPLETE, "job %" PRIu64 ": %s%s%s; the rest is here", f->job->job, frames_text,
                     f->not_rendered && f->failed ? ", " : "", files_text);
}

status job_fetch_pictures(struct job_fetch *f, const struct frame_list *only, struct error *err)
{
    const Azulejo__Wire__JobInfo *job = f->job;
    uint64_t count = only->count ? only->count : (uint64_t)job->last_frame - job->first_frame + 1;
    uint64_t wanted = 0;
    status result = job_fetch_begin(f, count, err);

    for (uint64_t i = 0; i < count && result == STATUS_OK; i++) {
        uint32_t frame = only->count ? only->items[i] : job->first_frame + (uint32_t)i;
        if (only->count == 0 && is_resting(job, frame))
            continue;
        wanted++;
        result = fetch_frame(f, frame, err);
    }
    THEN(result, verdict(f, wanted, err));
    if (f->video && (result == STATUS_OK || result == STATUS_ERR_INCOMPLETE)) {
        status filmed = job_fetch_video(f, only, result == STATUS_OK ? err : NULL);
        result = result == STATUS_OK ? filmed : result;
    }
    return result;
}

status job_fetch_picture(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind, struct buffer *data,
                         struct error *err)
{
    const struct buffer *base = f->claim.base.size ? &f->claim.base : &f->found;
    unsigned format = kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG ? OUTPUT_FORMAT_PNG : OUTPUT_FORMAT_JPEG;
    char *path = f->to.base || base->size ? path_of(f, buffer_text(base), frame, kind) : NULL;
    int brought = path && job_fetch_kinds(f) & format && file_read(path, FETCH_BYTES_MAX, data, NULL) == STATUS_OK;

    mem_free(path);
    return brought ? STATUS_OK : fetch_output(f->connection, f->job->job, frame, kind, data, err);
}

json_t *job_fetch_json(const struct job_fetch *f)
{
    json_t *out = json_pack("{s:o, s:I, s:o}", "files", f->files ? json_incref(f->files) : json_array(), "unchanged",
                            (json_int_t)f->unchanged, "missing", f->missing ? json_incref(f->missing) : json_array());

    if (f->video)
        json_object_set_new(out, "video", json_text(f->video));
    if (f->preview)
        json_object_set(out, "preview", f->preview);
    return out;
}
