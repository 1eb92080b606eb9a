#include "web/api/api_files.h"

#include <stdio.h>
#include <string.h>

#include "common/base/digest.h"
#include "web/api/call.h"
#include "protocol/json/json_wire.h"
#include "web/base/problem.h"

enum { LOOK_MAX = 32 }; /* values of a query */

/* ---- the farm's answer -------------------------------------------------------------------------- */

static const char *type_of(const char *name)
{
    static const char *const types[][2] = {{".exr", "image/x-exr"}, {".png", "image/png"}, {".jpg", "image/jpeg"},
                                           {".json", "application/json"}};
    size_t length = strlen(name);

    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        size_t end = strlen(types[i][0]);
        if (length > end && strcmp(name + length - end, types[i][0]) == 0)
            return types[i][1];
    }
    return "application/octet-stream";
}

/* The file's name, of letters, digits, '.', '-' and '_'; the farm gives no other ones. */
static void put_disposition(struct buffer *headers, const char *name, const char *job)
{
    if (strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") == strlen(name))
        buffer_printf(headers, "content-disposition: inline; filename=\"job-%.20s-%.100s\"\r\n", job, name);
}

static void put_headers(const struct web_request *request, const Azulejo__Wire__OutputData *piece,
                        struct buffer *headers)
{
    char hex[DIGEST_HEX_SIZE];
    struct digest digest;

    put_disposition(headers, piece->file_name, request->parameters[0]);
    if (piece->digest.len == DIGEST_BYTES) {
        memcpy(digest.bytes, piece->digest.data, DIGEST_BYTES);
        digest_to_hex(&digest, hex);
        buffer_printf(headers, "etag: \"%s\"\r\ncache-control: no-cache\r\n", hex);
    }
    if (piece->preview_covered > 0)
        buffer_printf(headers, "azulejo-covered: %.4f\r\nazulejo-samples: %.3f\r\n", piece->preview_covered,
                      piece->preview_samples);
}

static void take_piece(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    const Azulejo__Wire__OutputData *piece = answer->output_data;
    struct buffer headers = BUFFER_INIT;

    if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_DATA) {
        web_call_done(request);
        problem_answer(request, PROBLEM_INTERNAL, "the farm gave another answer than expected");
        return;
    }
    if (piece->unchanged || piece->offset == 0)
        put_headers(request, piece, &headers);
    if (piece->unchanged) {
        web_call_done(request);
        web_answer(request, 304, NULL, buffer_text(&headers), NULL, 0);
        buffer_release(&headers);
        return;
    }
    if (piece->offset == 0)
        web_begin(request, 200, type_of(piece->file_name), buffer_text(&headers), piece->total_bytes);
    buffer_release(&headers);
    web_write(request, piece->data.data, piece->data.len);
    if (piece->offset + piece->data.len < piece->total_bytes)
        return;
    web_call_done(request);
    web_end(request);
}

/* ---- the request ---------------------------------------------------------------------------------- */

/* The SHA-256 of the file that the client has, from If-None-Match; zeros: it has none, and
 * the answer names the file's. */
static void client_has(const struct web_request *request, uint8_t out[DIGEST_BYTES])
{
    const char *text = web_header(request, "if-none-match");
    struct digest digest;
    char hex[DIGEST_HEX_SIZE];

    memset(out, 0, DIGEST_BYTES);
    if (!text || text[0] != '"' || strlen(text) != DIGEST_HEX_SIZE + 1)
        return;
    snprintf(hex, sizeof hex, "%s", text + 1);
    if (digest_from_hex(&digest, hex) == STATUS_OK)
        memcpy(out, digest.bytes, DIGEST_BYTES);
}

/* What the query wants a preview to show, which the message points at until it was sent. */
struct look {
    Azulejo__Wire__OutputGet__LookEntry entries[LOOK_MAX], *pointers[LOOK_MAX];
    char names[LOOK_MAX][64];
};

static void take_look(const struct web_request *request, Azulejo__Wire__OutputGet *get, struct look *look)
{
    const char *value;
    size_t n = 0;

    for (; n < LOOK_MAX && (value = web_query_at(request, n)); n++) {
        size_t length = strcspn(value, "=");
        snprintf(look->names[n], sizeof look->names[n], "%.*s", length < 64 ? (int)length : 63, value);
        azulejo__wire__output_get__look_entry__init(&look->entries[n]);
        look->entries[n].key = look->names[n];
        look->entries[n].value = (char *)value + length + (value[length] == '=');
        look->pointers[n] = &look->entries[n];
    }
    get->n_look = n;
    get->look = look->pointers;
    get->develop = 1;
}

void api_picture(struct web_request *request)
{
    uint8_t have[DIGEST_BYTES];
    Azulejo__Wire__Envelope envelope;
    Azulejo__Wire__OutputGet *get = NULL;
    static struct look look;
    struct error err = {0};
    ProtobufCMessage *body;

    if (web_call_message(request, &envelope, &body, &err) != STATUS_OK) {
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return;
    }
    get = envelope.output_get;
    if (get->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG) {
        take_look(request, get, &look);
    } else if (get->kind != AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR) {
        client_has(request, have);
        get->have = (ProtobufCBinaryData){DIGEST_BYTES, have};
    }
    if (web_call_send(request, &envelope, WEB_CALL_STREAM, take_piece, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
    get->n_look = 0; /* not the message's own */
    get->look = NULL;
    get->have = (ProtobufCBinaryData){0};
    json_wire_free(body);
}
