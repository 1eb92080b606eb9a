#include "client/fetch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/base/file.h"
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
