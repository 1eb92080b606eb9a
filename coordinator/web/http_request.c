/* Requests: made of the library's headers, checked, given to their route's handler, and answered. */
#include "coordinator/web/request.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
#include "coordinator/web/http_parts.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/access.h"
#include "coordinator/web/tokens.h"

const char *const http_kept_names[HTTP_KEPT_MAX] = {
    "if-none-match", "last-event-id", "content-type", "accept", "range", "user-agent", "content-length", "origin",
    "accept-encoding",
};
static const enum lws_token_indexes kept_tokens[HTTP_KEPT_MAX] = {
    WSI_TOKEN_HTTP_IF_NONE_MATCH, WSI_TOKEN_COUNT, WSI_TOKEN_HTTP_CONTENT_TYPE, WSI_TOKEN_HTTP_ACCEPT,
    WSI_TOKEN_HTTP_RANGE, WSI_TOKEN_HTTP_USER_AGENT, WSI_TOKEN_HTTP_CONTENT_LENGTH, WSI_TOKEN_ORIGIN,
    WSI_TOKEN_HTTP_ACCEPT_ENCODING,
};

/* ---- the library's headers ------------------------------------------------------------------- */

/* The header's value, added to `texts` with its 0; the place of it, or SIZE_MAX: none. Its bytes hold no 0. */
static size_t take_token(struct lws *wsi, struct buffer *texts, enum lws_token_indexes token)
{
    const int length = lws_hdr_total_length(wsi, token);
    const size_t at = texts->size;
    char *space;

    if (length <= 0 || !(space = (char *)buffer_append_space(texts, (size_t)length + 1)))
        return SIZE_MAX;
    space[0] = 0;
    if (lws_hdr_copy(wsi, space, length + 1, token) < 0)
        space[0] = 0;
    texts->size = at + strlen(space) + 1;
    return at;
}

static size_t take_custom(struct lws *wsi, struct buffer *texts, const char *name)
{
    const int length = lws_hdr_custom_length(wsi, name, (int)strlen(name));
    const size_t at = texts->size;
    char *space;

    if (length <= 0 || !(space = (char *)buffer_append_space(texts, (size_t)length + 1)))
        return SIZE_MAX;
    space[0] = 0;
    if (lws_hdr_custom_copy(wsi, space, length + 1, name, (int)strlen(name)) < 0)
        space[0] = 0;
    texts->size = at + strlen(space) + 1;
    return at;
}

/* What the checks need and nothing later does. */
struct head {
    struct buffer texts;
    size_t host, origin, site, mode, authorization, cookie, transfer, expect, version, connection, length;
};

static const char *head_text(const struct head *head, size_t at)
{
    return at == SIZE_MAX ? NULL : (const char *)head->texts.data + at;
}

static int read_head(struct lws *wsi, struct head *head)
{
    *head = (struct head){.texts = BUFFER_INIT};
    head->host = take_token(wsi, &head->texts, WSI_TOKEN_HOST);
    head->origin = take_token(wsi, &head->texts, WSI_TOKEN_ORIGIN);
    head->site = take_custom(wsi, &head->texts, "sec-fetch-site:");
    head->mode = take_custom(wsi, &head->texts, "sec-fetch-mode:");
    head->authorization = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_AUTHORIZATION);
    head->cookie = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_COOKIE);
    head->transfer = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_TRANSFER_ENCODING);
    head->expect = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_EXPECT);
    head->version = take_token(wsi, &head->texts, WSI_TOKEN_HTTP);
    head->connection = take_token(wsi, &head->texts, WSI_TOKEN_CONNECTION);
    head->length = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_CONTENT_LENGTH);
    return buffer_ok(&head->texts);
}

/* ---- a request's life ------------------------------------------------------------------------ */

static void request_release(struct http_request *request)
{
    if (request->running || !request->is_over)
        return;
    buffer_release(&request->base.body);
    buffer_release(&request->texts);
    mem_free(request);
}

/* From now on only the connection is left of it. */
static void request_over(struct http_connection *c)
{
    struct http_request *request = c->request;

    c->request = NULL;
    if (!request)
        return;
    request->base.connection = NULL;
    request->is_over = 1;
    request_release(request);
}

void http_request_gone(struct http_connection *c)
{
    struct http_request *request = c->request;

    if (!request)
        return;
    request->running++;
    if (request->base.on_gone)
        request->base.on_gone(&request->base);
    request->running--;
    if (c->request)
        request_over(c);
    else
        request_release(request);
}

static void call(struct http_request *request, void (*handler)(struct web_request *))
{
    request->running++;
    handler(&request->base);
    request->running--;
    request_release(request);
}

static void give_body(struct http_connection *c, const uint8_t *data, size_t size)
{
    struct http_request *request = c->request;

    request->running++;
    request->base.on_body(&request->base, data, size);
    request->running--;
    request_release(request);
}

static struct http_request *request_new(struct http_connection *c)
{
    struct http_request *request = mem_calloc(1, sizeof *request);

    if (!request)
        return NULL;
    request->base = (struct web_request){.web = c->http->web, .peer = c->peer, .path = "", .connection = c};
    c->request = request;
    c->state = HTTP_ANSWERING;
    c->begun = c->ended = c->is_chunked = c->no_body = c->is_head = c->is_old = c->close_after = c->lingers = 0;
    c->body_left = c->discarded = 0;
    c->body_paused = 0;
    http_deadline(c, 0);
    return request;
}

/* The texts move while they grow: first their places, then pointers. 0: out of memory, or a 0 in the path. */
static int take_texts(struct http_connection *c, struct http_request *request, const char *uri, size_t uri_size,
                      char **path)
{
    size_t kept[HTTP_KEPT_MAX], query[HTTP_QUERY_MAX], queries = 0;
    struct buffer *texts = &request->texts;
    const char *base;

    buffer_append(texts, uri, uri_size);
    buffer_append(texts, "", 1); /* the route's finder cuts this one */
    buffer_append(texts, uri, uri_size);
    buffer_append(texts, "", 1);
    for (size_t i = 0; i < HTTP_KEPT_MAX; i++) {
        char name[32];
        snprintf(name, sizeof name, "%s:", http_kept_names[i]);
        kept[i] = kept_tokens[i] == WSI_TOKEN_COUNT ? take_custom(c->wsi, texts, name)
                                                    : take_token(c->wsi, texts, kept_tokens[i]);
    }
    for (int i = 0; i < HTTP_QUERY_MAX; i++) {
        const int length = lws_hdr_fragment_length(c->wsi, WSI_TOKEN_HTTP_URI_ARGS, i);
        const size_t at = texts->size;
        char *space = length > 0 ? (char *)buffer_append_space(texts, (size_t)length + 1) : NULL;
        if (!space)
            break;
        space[0] = 0;
        if (lws_hdr_copy_fragment(c->wsi, space, length + 1, WSI_TOKEN_HTTP_URI_ARGS, i) < 0)
            space[0] = 0;
        texts->size = at + strlen(space) + 1;
        query[queries++] = at;
    }
    if (!buffer_ok(texts) || memchr(uri, 0, uri_size))
        return 0;
    base = (const char *)texts->data;
    *path = (char *)texts->data;
    request->base.path = base + uri_size + 1;
    for (size_t i = 0; i < HTTP_KEPT_MAX; i++)
        request->kept[i] = kept[i] == SIZE_MAX ? NULL : base + kept[i];
    for (size_t i = 0; i < queries; i++)
        request->query[i] = base + query[i];
    return 1;
}

/* ---- who asks, and may they? ----------------------------------------------------------------- */

/* 0: its address has tried too many wrong tokens. A cookie that has expired is no attempt: the browser goes on
 * sending it, with each of the page's files. */
static int find_caller(struct http_connection *c, const struct head *head, struct web_caller *caller)
{
    struct web_tokens *tokens = c->http->web->tokens;
    char token[GUARD_TOKEN_MAX + 1];
    const char *authorization = head_text(head, head->authorization);
    int found = 1;

    *caller = (struct web_caller){0};
    if (authorization) {
        found = guard_bearer(authorization, token) && web_tokens_find(tokens, token, clock_wall_s(), caller);
        explicit_bzero(token, sizeof token);
    } else if (guard_cookie(head_text(head, head->cookie), c->http->web->guard.port, token)) {
        caller->by_cookie = web_tokens_find_cookie(tokens, token, clock_wall_s(), caller);
        explicit_bzero(token, sizeof token);
    }
    return found || access_note_failure(c->http->web, c->peer);
}

static unsigned check_guard(struct http_connection *c, const struct head *head, const char *path, int changes,
                            int is_socket, struct web_caller *caller, struct error *why)
{
    struct guard_headers_of asked = {.host = head_text(head, head->host),
                                     .origin = head_text(head, head->origin),
                                     .fetch_site = head_text(head, head->site),
                                     .fetch_mode = head_text(head, head->mode),
                                     .changes = changes,
                                     .is_socket = is_socket,
                                     .is_api = strncmp(path, "/api/", 5) == 0};
    unsigned refused = guard_check(&c->http->web->guard, &asked, why);

    if (refused)
        return refused; /* before any look at its token */
    if (!find_caller(c, head, caller)) {
        (void)error_set(why, STATUS_ERR_LIMIT, "too many wrong tokens came from your address: try again in a minute");
        return 429;
    }
    asked.by_cookie = caller->by_cookie;
    return guard_check(&c->http->web->guard, &asked, why);
}

/* 0, or the HTTP status of a refusal. */
static unsigned check_role(const struct web_route *route, const struct web_caller *caller, struct error *why)
{
    enum web_role least = route->own_jobs_suffice && route->role > WEB_ROLE_SUBMIT ? WEB_ROLE_SUBMIT : route->role;

    if (caller->role >= least)
        return 0;
    if (caller->role == WEB_ROLE_NONE) {
        (void)error_set(why, STATUS_ERR_REFUSED,
                        "this needs a valid token: 'azulejo token create' makes one, and the coordinator prints its "
                        "own when it starts");
        return 401;
    }
    (void)error_set(why, STATUS_ERR_REFUSED, "this needs a token of the role %s; yours has the role %s",
                    web_role_name(least), web_role_name(caller->role));
    return 403;
}

/* ---- from headers to the handler ------------------------------------------------------------- */

static void refuse(struct http_connection *c, unsigned status_code, const struct error *why, const char *headers)
{
    struct web_request *request = &c->request->base;
    struct buffer body = BUFFER_INIT;
    enum problem problem = problem_of_http(status_code);

    problem_put(&body, problem, why->text, request->path);
    web_answer(request, problem_kinds[problem].http_status, PROBLEM_CONTENT_TYPE, headers, body.data, body.size);
    buffer_release(&body);
}

static void refuse_method(struct http_connection *c, unsigned allowed)
{
    static const char *const names[WEB_METHODS] = {"GET, HEAD", "POST", "PUT", "PATCH", "DELETE"};
    char line[64] = "allow: ";
    struct error why;

    for (int i = 0; i < WEB_METHODS; i++)
        if (allowed & 1u << i)
            snprintf(line + strlen(line), sizeof line - strlen(line), "%s%s", strlen(line) > 7 ? ", " : "", names[i]);
    (void)error_set(&why, STATUS_ERR_UNSUPPORTED, "this path does not know that method; it knows %s", line + 7);
    snprintf(line + strlen(line), sizeof line - strlen(line), "\r\n");
    refuse(c, 405, &why, line);
}

static int run_handler(struct http_connection *c)
{
    call(c->request, c->http->web->routing->run);
    return 0;
}

/* A body's size. 0: what it says is no size; then *out is 0. */
static int parse_length(const char *text, uint64_t *out)
{
    char *end;

    *out = 0;
    if (!text)
        return 1;
    errno = 0;
    *out = strtoull(text, &end, 10);
    if (isdigit((unsigned char)text[0]) && !*end && errno == 0)
        return 1;
    *out = 0;
    return 0;
}

/* HEAD is a GET. WEB_METHODS: none that any path knows. */
static enum web_method method_of(int token)
{
    switch (token) {
    case LWSHUMETH_GET:
    case LWSHUMETH_HEAD: return WEB_GET;
    case LWSHUMETH_POST: return WEB_POST;
    case LWSHUMETH_PUT: return WEB_PUT;
    case LWSHUMETH_PATCH: return WEB_PATCH;
    case LWSHUMETH_DELETE: return WEB_DELETE;
    default: return WEB_METHODS;
    }
}

static void begin_body(struct http_connection *c, const struct head *head)
{
    static const char go_on[] = "HTTP/1.1 100 Continue\r\n\r\n";
    const char *expect = head_text(head, head->expect);
    uint8_t line[LWS_PRE + sizeof go_on];

    c->state = HTTP_BODY;
    http_deadline(c, c->request->base.route->streams_body ? HTTP_STALL_MS : HTTP_BODY_MS);
    if (!expect || strcasecmp(expect, "100-continue") != 0)
        return;
    memcpy(line + LWS_PRE, go_on, sizeof go_on);
    lws_write(c->wsi, line + LWS_PRE, sizeof go_on - 1, LWS_WRITE_HTTP_HEADERS);
}

static void start(struct http_connection *c, const struct head *head, enum web_method method, char *path)
{
    struct web_request *request = &c->request->base;
    unsigned allowed = 0, refused;
    struct error why = {0};

    request->method = method;
    refused = check_guard(c, head, request->path, method != WEB_GET, 0, &request->caller, &why);
    if (refused) {
        refuse(c, refused, &why, NULL);
        return;
    }
    /* The library waits for a body that nobody announced. */
    c->close_after |= head->length == SIZE_MAX && method != WEB_GET && method != WEB_DELETE;
    if (head->transfer != SIZE_MAX || !parse_length(head_text(head, head->length), &c->body_left)) {
        (void)error_set(&why, STATUS_ERR_INPUT, "a body needs its size in Content-Length");
        c->close_after = c->lingers = 1;
        refuse(c, 400, &why, NULL);
        return;
    }
    request->route = web_route_find(c->http->web->routing, method, path, request->parameters, &allowed);
    if (!request->route) {
        (void)error_set(&why, STATUS_ERR_NOT_FOUND, "there is nothing here");
        if (allowed)
            refuse_method(c, allowed);
        else
            refuse(c, 404, &why, NULL);
        return;
    }
    refused = check_role(request->route, &request->caller, &why);
    if (refused == 0 && request->route->open) {
        (void)error_set(&why, STATUS_ERR_INPUT, "this is a WebSocket: ask for the upgrade");
        refuse(c, 400, &why, NULL);
        return;
    }
    if (refused == 0 && !request->route->streams_body && c->body_left > WEB_BODY_MAX) {
        (void)error_set(&why, STATUS_ERR_LIMIT, "the body has %" PRIu64 " bytes; at most %d are taken here",
                        c->body_left, WEB_BODY_MAX);
        refused = 413;
    }
    if (refused) {
        refuse(c, refused, &why, refused == 401 ? "www-authenticate: Bearer realm=\"azulejo\"\r\n" : NULL);
        return;
    }
    if (c->body_left > 0)
        begin_body(c, head);
    if (c->body_left == 0 || request->route->streams_body)
        run_handler(c);
    if (c->body_left == 0 && c->state == HTTP_ANSWERING && c->request && c->request->base.on_body)
        give_body(c, NULL, 0);
}

int http_on_request(struct http_connection *c)
{
    struct http_request *request;
    struct head head;
    char *uri = NULL, *path = NULL;
    int size = 0, token = lws_http_get_uri_and_method(c->wsi, &uri, &size);
    enum web_method method = method_of(token);
    const char *connection, *version;

    http_request_gone(c); /* none: the last one was answered */
    request = request_new(c);
    if (!request || token < 0)
        return -1;
    if (!read_head(c->wsi, &head))
        return buffer_release(&head.texts), -1;
    c->is_head = token == LWSHUMETH_HEAD;
    version = head_text(&head, head.version);
    connection = head_text(&head, head.connection);
    c->is_old = version && strcmp(version, "HTTP/1.0") == 0;
    c->close_after = c->is_old || (connection && strcasecmp(connection, "close") == 0);
    if (take_texts(c, request, uri, (size_t)size, &path))
        start(c, &head, method, path);
    else
        c->is_dead = 1;
    explicit_bzero(head.texts.data, head.texts.size);
    buffer_release(&head.texts);
    return c->is_dead ? -1 : 0;
}

/* ---- bodies ---------------------------------------------------------------------------------- */

int http_on_body(struct http_connection *c, const uint8_t *data, size_t size)
{
    struct http_request *request = c->request;

    if (c->is_dead)
        return -1;
    if (!request || c->state != HTTP_BODY || size > c->body_left) {
        /* Answered before it came: the connection ends with that. */
        c->discarded += size;
        return c->discarded > HTTP_LINGER_BYTES ? -1 : 0;
    }
    c->body_left -= size;
    if (request->base.route->streams_body) {
        http_deadline(c, HTTP_STALL_MS);
        if (request->base.on_body && size > 0)
            give_body(c, data, size);
    } else {
        buffer_append(&request->base.body, data, size);
        if (!buffer_ok(&request->base.body))
            return -1;
    }
    return 0;
}

int http_on_body_end(struct http_connection *c)
{
    struct http_request *request = c->request;

    if (!request || c->state != HTTP_BODY || c->body_left > 0)
        return c->is_dead ? -1 : 0;
    c->state = HTTP_ANSWERING;
    http_deadline(c, 0);
    if (!request->base.route->streams_body)
        return run_handler(c);
    if (request->base.on_body)
        give_body(c, NULL, 0);
    return 0;
}

void web_pause_body(struct web_request *request, int paused)
{
    struct http_connection *c = request->connection;

    if (!c || c->state != HTTP_BODY || c->body_paused == paused)
        return;
    c->body_paused = paused;
    http_deadline(c, paused ? 0 : HTTP_STALL_MS);
    lws_rx_flow_control(c->wsi, !paused);
}

/* ---- answers --------------------------------------------------------------------------------- */

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
    if (c->body_left > 0)
        c->close_after = c->lingers = 1; /* what is left of it is not wanted */
    c->no_body = c->is_head || code == 204 || code == 304;
    if (length == UINT64_MAX && !c->no_body) {
        c->is_chunked = !c->is_old;
        c->close_after |= c->is_old;
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
    if (c->out.bytes == 0)
        http_deadline(c, HTTP_STALL_MS);
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
    c->ended = 1;
    http_deadline(c, HTTP_STALL_MS);
    lws_callback_on_writable(c->wsi);
    request_over(c);
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
        http_deadline(c, out->bytes > 0 || c->ended ? HTTP_STALL_MS : 0);
    }
    if (c->request && c->request->base.on_writable && c->begun && out->bytes < WEB_QUEUE_HIGH / 2)
        call(c->request, c->request->base.on_writable);
    if (out->bytes > 0 || (c->ended && lws_partial_buffered(c->wsi))) {
        lws_callback_on_writable(c->wsi);
        return 0;
    }
    if (!c->ended)
        return out->failed ? -1 : 0;
    c->ended = 0;
    if (c->lingers) {
        /* Closed now, the client would be told of its broken connection rather than of the answer. */
        c->state = HTTP_LINGER;
        http_deadline(c, HTTP_LINGER_MS);
        return 0;
    }
    c->state = HTTP_IDLE;
    http_deadline(c, HTTP_IDLE_MS);
    return c->close_after || lws_http_transaction_completed(c->wsi) ? -1 : 0;
}

/* ---- what handlers ask ----------------------------------------------------------------------- */

const char *web_query(const struct web_request *base, const char *name)
{
    const struct http_request *request = (const struct http_request *)base;
    const size_t size = strlen(name);

    for (size_t i = 0; i < HTTP_QUERY_MAX && request->query[i]; i++)
        if (strncmp(request->query[i], name, size) == 0 && (request->query[i][size] == '=' || !request->query[i][size]))
            return request->query[i] + size + (request->query[i][size] == '=');
    return NULL;
}

const char *web_query_at(const struct web_request *base, size_t index)
{
    const struct http_request *request = (const struct http_request *)base;

    return index < HTTP_QUERY_MAX ? request->query[index] : NULL;
}

const char *web_header(const struct web_request *base, const char *name)
{
    const struct http_request *request = (const struct http_request *)base;

    for (size_t i = 0; i < HTTP_KEPT_MAX; i++)
        if (strcmp(name, http_kept_names[i]) == 0)
            return request->kept[i];
    return NULL;
}

/* ---- upgrades -------------------------------------------------------------------------------- */

int http_on_upgrade(struct http_connection *c, const char *to)
{
    const struct web_route *route = NULL;
    struct error why = {0};
    struct head head;
    char *uri = NULL, *path = NULL;
    int size = 0, token = lws_http_get_uri_and_method(c->wsi, &uri, &size);
    unsigned refused = 0, allowed = 0;
    struct http_request *request;

    http_request_gone(c);
    request = request_new(c);
    if (!request || token != LWSHUMETH_GET || strcasecmp(to, "websocket") != 0)
        return -1;
    if (!read_head(c->wsi, &head))
        return buffer_release(&head.texts), -1;
    if (take_texts(c, request, uri, (size_t)size, &path)) {
        refused = check_guard(c, &head, request->base.path, 0, 1, &c->caller, &why);
        if (!refused)
            route = web_route_find(c->http->web->routing, WEB_GET, path, request->base.parameters, &allowed);
        if (!refused && (!route || !route->open)) {
            (void)error_set(&why, STATUS_ERR_NOT_FOUND, "there is no WebSocket here");
            refused = 404;
        }
        if (!refused)
            refused = check_role(route, &c->caller, &why);
    } else {
        c->is_dead = 1;
    }
    explicit_bzero(head.texts.data, head.texts.size);
    buffer_release(&head.texts);
    if (c->is_dead)
        return -1;
    if (refused) {
        c->close_after = 1;
        refuse(c, refused, &why, NULL);
        while (c->out.bytes > 0 && http_on_writable(c) == 0)
            ;
        return -1;
    }
    c->route = route;
    request_over(c);
    return 0;
}
