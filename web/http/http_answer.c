/* Answers: whole ones and streams, into the connection's queue and from there to the kernel. */
#include "web/api/request.h"

#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "web/http/http_parts.h"

static const char *reason_phrase(unsigned code)
{
    static const struct { unsigned code; const char *words; } phrases[] = {
        {200, "OK"}, {201, "Created"}, {202, "Accepted"}, {204, "No Content"}, {304, "Not Modified"},
        {400, "Bad Request"}, {401, "Unauthorized"}, {403, "Forbidden"}, {404, "Not Found"},
        {405, "Method Not Allowed"}, {409, "Conflict"}, {411, "Length Required"}, {412, "Precondition Failed"},
        {413, "Content Too Large"}, {415, "Unsupported Media Type"}, {421, "Misdirected Request"},
        {422, "Unprocessable Content"}, {426, "Upgrade Required"}, {429, "Too Many Requests"},
        {500, "Internal Server Error"}, {501, "Not Implemented"}, {503, "Service Unavailable"},
    };

    for (size_t i = 0; i < sizeof phrases / sizeof *phrases; i++)
        if (phrases[i].code == code)
            return phrases[i].words;
    return "Status";
}

static void put_head(struct http_connection *c, unsigned code, const char *type, const char *headers, uint64_t length)
{
    struct buffer head = BUFFER_INIT;
    char date[40] = "";
    time_t now = time(NULL);
    struct tm parts;

    if (gmtime_r(&now, &parts))
        strftime(date, sizeof date, "%a, %d %b %Y %H:%M:%S GMT", &parts);
    buffer_printf(&head, "HTTP/1.1 %u %s\r\ndate: %s\r\n", code, reason_phrase(code), date);
    for (size_t i = 0; i < GUARD_LINES; i++)
        buffer_printf(&head, "%s %s\r\n", guard_lines[i].name, guard_lines[i].value);
    if (!headers || !strstr(headers, "cache-control:"))
        buffer_puts(&head, "cache-control: no-store\r\n");
    if (type)
        buffer_printf(&head, "content-type: %s\r\n", type);
    if (headers)
        buffer_puts(&head, headers);
    if (c->is_chunked)
        buffer_puts(&head, "transfer-encoding: chunked\r\n");
    else if (length != UINT64_MAX && code != 204 && code != 304)
        buffer_printf(&head, "content-length: %" PRIu64 "\r\n", length);
    if (c->close_after)
        buffer_puts(&head, "connection: close\r\n");
    buffer_puts(&head, "\r\n");
    if (buffer_ok(&head))
        http_queue_add(&c->out, HTTP_PIECE_STREAM, head.data, head.size);
    else
        c->out.failed = 1;
    buffer_release(&head);
}

static void begin(struct web_request *request, unsigned code, const char *type, const char *headers, uint64_t length)
{
    struct http_connection *c = request->connection;

    if (!c || c->begun)
        return;
    c->begun = 1;
    http_resume_reading(c);
    if (c->body_left > 0)
        c->close_after = c->lingers = 1; /* what is left of it is not wanted */
    c->no_body = c->is_head || code == 204 || code == 304;
    c->length_left = 0;
    if (length == UINT64_MAX && !c->no_body) {
        c->is_chunked = !c->is_old;
        c->close_after |= c->is_old;
    } else if (!c->no_body) {
        c->length_left = length;
    }
    c->http->counts.answers[code / 100 < 6 ? code / 100 : 5]++;
    put_head(c, code, type, headers, length);
    if (c->out.bytes > 0 || c->out.failed)
        lws_callback_on_writable(c->wsi);
    http_deadline(c, HTTP_STALL_MS);
}

void web_begin(struct web_request *request, unsigned http_status, const char *content_type, const char *headers,
               uint64_t length)
{
    begin(request, http_status, content_type, headers, length ? length : UINT64_MAX);
}

void web_write(struct web_request *request, const void *data, size_t size)
{
    struct http_connection *c = request->connection;
    char line[24];

    if (!c || !c->begun || c->no_body || size == 0)
        return;
    http_resume_reading(c);
    if (c->out.bytes == 0)
        http_deadline(c, HTTP_STALL_MS);
    if (!c->is_chunked && !c->is_old && size > c->length_left)
        size = (size_t)c->length_left; /* the next answer begins there */
    c->length_left -= c->length_left < size ? c->length_left : size;
    if (c->is_chunked) {
        snprintf(line, sizeof line, "%zx\r\n", size);
        http_queue_add(&c->out, HTTP_PIECE_STREAM, line, strlen(line));
    }
    http_queue_add(&c->out, HTTP_PIECE_STREAM, data, size);
    if (c->is_chunked)
        http_queue_add(&c->out, HTTP_PIECE_STREAM, "\r\n", 2);
    lws_callback_on_writable(c->wsi);
}

size_t web_queued(const struct web_request *request)
{
    const struct http_connection *c = request->connection;

    return c ? c->out.bytes : 0;
}

void web_end(struct web_request *request)
{
    struct http_connection *c = request->connection;

    if (!c)
        return;
    if (c->is_chunked)
        http_queue_add(&c->out, HTTP_PIECE_STREAM, "0\r\n\r\n", 5);
    c->close_after |= c->length_left > 0; /* the client sees that something is missing */
    c->ended = 1;
    http_resume_reading(c);
    http_deadline(c, HTTP_STALL_MS);
    lws_callback_on_writable(c->wsi);
    http_request_over(c);
}

void web_answer(struct web_request *request, unsigned http_status, const char *content_type, const char *headers,
                const void *data, size_t size)
{
    begin(request, http_status, content_type, headers, size);
    web_write(request, data, size);
    web_end(request);
}

int http_on_writable(struct http_connection *c)
{
    struct http_queue *out = &c->out;
    enum http_piece_kind kind;
    size_t size;
    int start_of, end_of;
    uint8_t *data;

    if (c->is_dead || out->failed)
        return -1;
    data = http_queue_next(out, HTTP_PIECE_MAX, &size, &kind, &start_of, &end_of);
    if (data) {
        if (lws_write(c->wsi, data, size, LWS_WRITE_HTTP) < 0)
            return -1;
        http_queue_taken(out, size);
        lws_validity_confirmed(c->wsi);
        http_deadline(c, out->bytes > 0 || c->ended ? HTTP_STALL_MS : 0);
    }
    if (c->request && c->request->base.on_writable && c->begun && out->bytes < WEB_QUEUE_HIGH / 2)
        http_request_call(c->request, c->request->base.on_writable);
    if (out->bytes > 0 || (c->ended && lws_partial_buffered(c->wsi))) {
        lws_callback_on_writable(c->wsi);
        return 0;
    }
    if (!c->ended)
        return out->failed ? -1 : 0;
    c->ended = 0;
    if (c->lingers) {
        /* Closed now, the client would learn of its broken connection rather than of the answer. */
        c->state = HTTP_LINGER;
        http_deadline(c, HTTP_LINGER_MS);
        return 0;
    }
    c->state = HTTP_IDLE;
    http_deadline(c, HTTP_IDLE_MS);
    return c->close_after || lws_http_transaction_completed(c->wsi) ? -1 : 0;
}

/* While an answer is under way, or the last one has not left the kernel, the library reads nothing, and is called again
 * and again, a processor full of calls, for what its client says meanwhile: more requests, anything else, or that it
 * says no more. While nothing can be written, such a connection is not read. */
void http_pause_reading(struct http_connection *c)
{
    const int has_output = c->state == HTTP_IDLE || c->out.bytes > 0 || lws_partial_buffered(c->wsi);
    struct pollfd now = {.fd = lws_get_socket_fd(c->wsi), .events = POLLIN | POLLOUT | POLLRDHUP};

    if (c->is_dead || poll(&now, 1, 0) <= 0)
        return;
    if ((now.revents & (POLLERR | POLLHUP)) ||
        ((now.revents & POLLRDHUP) && c->begun && c->is_chunked && !c->ended && !has_output)) {
        http_kill(c); /* its client is gone: end the stream */
    } else if (c->reading_paused) {
        if (has_output && (now.revents & POLLOUT))
            http_resume_reading(c);
    } else if ((now.revents & (POLLIN | POLLRDHUP)) && !(has_output && (now.revents & POLLOUT))) {
        c->reading_paused = 1;
        lws_rx_flow_control(c->wsi, 0);
    }
}

/* While a connection is not read, the library does not write to it either. */
void http_resume_reading(struct http_connection *c)
{
    if (!c->reading_paused)
        return;
    c->reading_paused = 0;
    lws_rx_flow_control(c->wsi, 1);
}

void web_pause_body(struct web_request *request, int paused)
{
    struct http_connection *c = request->connection;

    if (!c || c->state != HTTP_BODY || c->reading_paused == paused)
        return;
    c->reading_paused = paused;
    http_deadline(c, paused ? 0 : HTTP_STALL_MS);
    lws_rx_flow_control(c->wsi, !paused);
}
