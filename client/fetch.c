#include "client/fetch.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/format.h"
#include "client/output.h"
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

status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err)
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
            result = append_piece(data, start, answer->output_data, err);
        }
        first = 0;
        message_free(answer);
    }
    return result;
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

/* "NAME.exr", or "NAME-0007.exr" where a job has several frames, from the job's name made
 * safe: no folders, nothing hidden. Jobs fetched into one folder so keep apart. */
static void output_name(const struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
                        struct buffer *name)
{
    const Azulejo__Wire__JobInfo *job = f->job;
    const char *extension = kind_extension(kind);
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

status job_fetch_file(struct job_fetch *f, uint32_t frame, Azulejo__Wire__OutputKind kind,
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
static status fetch_frame(struct job_fetch *f, uint32_t frame, int must_be_there, struct error *err)
{
    static const Azulejo__Wire__OutputKind kinds[OUTPUT_FORMAT_COUNT] = {
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR,
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG,
        AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG,
    };
    unsigned formats = f->job->output ? output_message_formats(f->job->output) & f->formats : 0;
    status result = STATUS_OK;

    for (int i = 0; i < OUTPUT_FORMAT_COUNT && result == STATUS_OK; i++) {
        if (!(formats >> i & 1))
            continue;
        result = job_fetch_file(f, frame, kinds[i], NULL, err);
        if (result == STATUS_ERR_NOT_FOUND && !must_be_there) {
            f->not_ready++;
            return STATUS_OK;
        }
    }
    if (result == STATUS_OK && f->manifest)
        result = job_fetch_file(f, frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON, NULL,
                                err);
    return result;
}

status job_fetch_pictures(struct job_fetch *f, int64_t only_frame, struct error *err)
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
