#include "coordinator/web/api_files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/digest.h"
#include "coordinator/job/wire.h"
#include "coordinator/net/server.h"
#include "coordinator/web/call.h"
#include "coordinator/web/json_wire.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/routes.h"
#include "coordinator/web/web.h"

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

/* ---- a preview's settings ------------------------------------------------------------------------ */

static status take_number(const struct web_request *request, const char *name, double *out, struct error *err)
{
    const char *text = web_query(request, name);
    char *end;

    if (!text)
        return STATUS_OK;
    *out = strtod(text, &end);
    return end != text && !*end ? STATUS_OK
                                : error_set(err, STATUS_ERR_INPUT, "%s: '%.40s' is not a number", name, text);
}

/* param.NAME=VALUE: the operator's own. */
static status take_parameters(const struct web_request *request, struct tonemap_settings *t, struct error *err)
{
    const char *value;
    status s = STATUS_OK;

    for (size_t i = 0; s == STATUS_OK && (value = web_query_at(request, i)); i++) {
        char name[64];
        size_t length = strcspn(value, "=");
        if (strncmp(value, "param.", 6) != 0 || length - 6 >= sizeof name)
            continue;
        snprintf(name, sizeof name, "%.*s", (int)length - 6, value + 6);
        s = tonemap_settings_set_text(t, name, value[length] ? value + length + 1 : "", err);
    }
    return s;
}

/* The job's settings with what the query says instead. */
static status take_settings(const struct web_request *request, struct output_settings *output, struct error *err)
{
    struct tonemap_settings *t = &output->tonemap;
    const char *name = web_query(request, "tonemap"), *metering = web_query(request, "metering");
    const char *no_dither = web_query(request, "no_dither");
    status s = STATUS_OK;

    if (name) {
        struct tonemap_settings other;
        s = tonemap_settings_init(&other, name, err);
        if (s == STATUS_OK) {
            t->op = other.op;
            memcpy(t->values, other.values, sizeof t->values);
            t->has_file = t->has_file && t->op->file_load;
        }
    }
    if (s == STATUS_OK)
        s = take_parameters(request, t, err);
    if (s == STATUS_OK)
        s = take_number(request, "exposure", &t->exposure_ev, err);
    if (s == STATUS_OK)
        s = take_number(request, "metering_percentile", &t->metering_percentile, err);
    if (s == STATUS_OK)
        s = take_number(request, "white_kelvin", &t->white_kelvin, err);
    if (s == STATUS_OK && metering) {
        int m = tonemap_metering_parse(metering);
        if (m < 0)
            return error_set(err, STATUS_ERR_INPUT, "metering: '%.40s' is not known; it may be off, key, percentile",
                             metering);
        t->metering = (enum tonemap_metering)m;
    }
    if (s == STATUS_OK && no_dither)
        output->picture.plain = strcmp(no_dither, "0") != 0;
    return s == STATUS_OK ? tonemap_settings_validate(t, err) : s;
}

/* Does the farm have no file of the picture, although the frame is done? */
static int must_develop(const struct job *job, uint32_t frame)
{
    return job_frame_is_done(job, frame) && !(job->output.png && job_frame_is_developed(job, frame));
}

/* What a message's output settings point at, until it was sent. */
struct look {
    struct output_settings settings;
    struct wire_output wire;
};

/* A preview with settings of its own, or of a frame whose job makes no PNG. */
static status set_output(struct web_request *request, Azulejo__Wire__OutputGet *get, struct look *look,
                         struct error *err)
{
    const struct job *job = queue_find(&request->web->server->farm.queue, get->job);
    status s;

    if (!job || get->frame < job->first_frame || get->frame > job->last_frame ||
        (!web_query_at(request, 0) && !must_develop(job, get->frame)))
        return STATUS_OK;
    look->settings = job->output;
    s = take_settings(request, &look->settings, err);
    if (s == STATUS_OK) {
        wire_output_set(&look->wire, &look->settings);
        get->output = &look->wire.message;
    }
    return s;
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

void api_picture(struct web_request *request)
{
    uint8_t have[DIGEST_BYTES];
    Azulejo__Wire__Envelope envelope;
    Azulejo__Wire__OutputGet *get = NULL;
    static struct look look;
    struct error err = {0};
    ProtobufCMessage *body;
    status s = web_call_message(request, &envelope, &body, &err);

    if (s != STATUS_OK) {
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return;
    }
    get = envelope.output_get;
    if (get->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG) {
        s = set_output(request, get, &look, &err);
    } else if (get->kind != AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR) {
        client_has(request, have);
        get->have = (ProtobufCBinaryData){DIGEST_BYTES, have};
    }
    if (s != STATUS_OK)
        problem_answer(request, problem_of_farm(err.code), err.text);
    else if (web_call_send(request, &envelope, WEB_CALL_STREAM, take_piece, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
    get->output = NULL; /* not the message's own */
    get->have = (ProtobufCBinaryData){0};
    json_wire_free(body);
}
