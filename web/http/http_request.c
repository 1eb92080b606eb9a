/* Requests from the library's events: checked, given to their route's handler, and their bodies. */
#include "web/api/request.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "common/system/clock.h"
#include "protocol/message.h"
#include "web/base/access.h"
#include "common/schema/token_ceilings.h"
#include "web/http/http_parts.h"
#include "web/base/problem.h"

/* ---- who asks, and may they? ----------------------------------------------------------------- */

/* 0: its address has tried too many wrong tokens. A cookie that has expired is no attempt: the browser goes on
 * sending it, with each of the page's files. */
static int find_caller(struct http_connection *c, const struct http_head *head, struct web_caller *caller)
{
    struct callers *callers = &c->http->web->callers;
    char token[GUARD_TOKEN_MAX + 1];
    const char *authorization = http_head_text(head, head->authorization);
    int found = 1;

    *caller = (struct web_caller){0};
    if (authorization) {
        found = guard_bearer(authorization, token) && callers_find(callers, token, clock_wall_s(), caller);
        explicit_bzero(token, sizeof token);
    } else if (guard_cookie(http_head_text(head, head->cookie), c->http->web->guard.port, token)) {
        caller->by_cookie = callers_find_cookie(callers, token, clock_wall_s(), caller);
        explicit_bzero(token, sizeof token);
    }
    if (caller->token)
        access_note_use(c->http->web, caller->token);
    return found || access_note_failure(c->http->web, c->peer);
}

/* The token's other connections that do something: those that wait for their next request make place by themselves. */
static uint32_t busy_of_token(const struct http_connection *own)
{
    uint32_t count = 0;

    for (const struct http_connection *c = own->http->first; c; c = c->next)
        count += c != own && c->token == own->token && c->state != HTTP_IDLE && !c->is_ending && !c->is_dead;
    return count;
}

static unsigned check_guard(struct http_connection *c, const struct http_head *head, const char *path, int changes,
                            int is_socket, struct web_caller *caller, struct error *why)
{
    struct guard_headers_of asked = {.host = http_head_text(head, head->host),
                                     .origin = http_head_text(head, head->origin),
                                     .fetch_site = http_head_text(head, head->site),
                                     .fetch_mode = http_head_text(head, head->mode),
                                     .changes = changes,
                                     .is_socket = is_socket,
                                     .is_api = strncmp(path, "/api/", 5) == 0};
    unsigned refused = guard_check(&c->http->web->guard, &asked, why);

    if (refused)
        return refused; /* before any look at its token */
    if (!c->http->web->callers.is_known) {
        (void)error_set(why, STATUS_ERR_IO, "the coordinator has not answered yet; try again in a moment");
        return 503;
    }
    if (!find_caller(c, head, caller)) {
        (void)error_set(why, STATUS_ERR_LIMIT, "too many wrong tokens came from your address: try again in a minute");
        return 429;
    }
    c->token = caller->token;
    if (caller->token && busy_of_token(c) >= token_ceiling_of(caller->role).connections) {
        c->close_after = 1;
        (void)error_set(why, STATUS_ERR_LIMIT, "this token has %u connections in use, as many as its role may have: close some, "
                        "or wait for their answers", token_ceiling_of(caller->role).connections);
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
    http_request_call(c->request, c->http->web->routing->run);
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

static void begin_body(struct http_connection *c, const struct http_head *head)
{
    static const char go_on[] = "HTTP/1.1 100 Continue\r\n\r\n";
    const char *expect = http_head_text(head, head->expect);
    uint8_t line[LWS_PRE + sizeof go_on];

    c->state = HTTP_BODY;
    http_deadline(c, c->request->base.route->streams_body ? HTTP_STALL_MS : HTTP_BODY_MS);
    if (!expect || strcasecmp(expect, "100-continue") != 0)
        return;
    memcpy(line + LWS_PRE, go_on, sizeof go_on);
    lws_write(c->wsi, line + LWS_PRE, sizeof go_on - 1, LWS_WRITE_HTTP_HEADERS);
}

static void start(struct http_connection *c, const struct http_head *head, enum web_method method, char *path)
{
    struct web_request *request = &c->request->base;
    unsigned allowed = 0, refused;
    struct error why = {0};
    uint64_t most;

    request->method = method;
    refused = check_guard(c, head, request->path, method != WEB_GET, 0, &request->caller, &why);
    if (refused) {
        refuse(c, refused, &why, NULL);
        return;
    }
    /* The library waits for a body that was not announced. */
    c->close_after |= head->length == SIZE_MAX && method != WEB_GET && method != WEB_DELETE;
    if (head->transfer != SIZE_MAX || !parse_length(http_head_text(head, head->length), &c->body_left)) {
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
        (void)error_set(&why, STATUS_ERR_UNSUPPORTED, "this is a WebSocket: ask for the upgrade");
        refuse(c, 426, &why, "upgrade: websocket\r\n");
        return;
    }
    most = request->route->streams_body ? BLOB_BYTES_MAX : WEB_BODY_MAX;
    if (refused == 0 && c->body_left > most) {
        (void)error_set(&why, STATUS_ERR_LIMIT, "the body has %" PRIu64 " bytes; at most %" PRIu64 " are taken here",
                        c->body_left, most);
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
        http_give_body(c, NULL, 0);
}

int http_on_request(struct http_connection *c)
{
    struct http_request *request;
    struct http_head head;
    char *uri = NULL, *path = NULL;
    int size = 0, token = lws_http_get_uri_and_method(c->wsi, &uri, &size);
    enum web_method method = method_of(token);
    const char *connection, *version;

    http_request_gone(c); /* none: the last one was answered */
    request = http_request_new(c);
    if (!request || token < 0)
        return -1;
    if (!http_head_read(c->wsi, &head))
        return buffer_release(&head.texts), -1;
    c->is_head = token == LWSHUMETH_HEAD;
    version = http_head_text(&head, head.version);
    connection = http_head_text(&head, head.connection);
    c->is_old = version && strcmp(version, "HTTP/1.0") == 0;
    c->close_after = c->is_old || (connection && strcasecmp(connection, "close") == 0);
    if (http_take_texts(c, request, uri, (size_t)size, &path))
        start(c, &head, method, path);
    else
        c->is_dead = 1;
    buffer_wipe(&head.texts);
    return c->is_dead ? -1 : 0;
}

/* A method that the library does not know, or no HTTP at all. It has left HTTP then, so the answer is written here. */
int http_on_no_request(struct http_connection *c, const char *data, size_t size)
{
    size_t word = 0;
    struct buffer body = BUFFER_INIT, text = BUFFER_INIT;
    int is_method;

    while (word < size && (isupper((unsigned char)data[word]) || data[word] == '-'))
        word++;
    is_method = word > 0 && word < size && data[word] == ' ';
    problem_put(&body, is_method ? PROBLEM_UNSUPPORTED : PROBLEM_INPUT,
                is_method ? "there is no such method here" : "this is no request of HTTP/1.1", "");
    (void)buffer_append_space(&text, LWS_PRE);
    buffer_printf(&text, "HTTP/1.1 %s\r\n", is_method ? "501 Not Implemented" : "400 Bad Request");
    for (size_t i = 0; i < GUARD_LINES; i++)
        buffer_printf(&text, "%s %s\r\n", guard_lines[i].name, guard_lines[i].value);
    buffer_printf(&text, "cache-control: no-store\r\ncontent-type: " PROBLEM_CONTENT_TYPE "\r\ncontent-length: %zu\r\n"
                         "connection: close\r\n\r\n", body.size);
    buffer_append(&text, body.data, body.size);
    c->http->counts.answers[is_method ? 5 : 4]++;
    if (buffer_ok(&text) && buffer_ok(&body))
        lws_write(c->wsi, text.data + LWS_PRE, text.size - LWS_PRE, LWS_WRITE_RAW);
    buffer_release(&text);
    buffer_release(&body);
    return -1;
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
            http_give_body(c, data, size);
    } else {
        buffer_append(&request->base.body, data, size);
        if (!buffer_ok(&request->base.body))
            return -1;
    }
    return 0;
}

/* The client has sent more behind a body without waiting for the answer. The library calls for the body's end again and
 * again then, a processor full of calls, and comes to nothing else. The answer is this connection's last one. */
static int end_pipeline(struct http_connection *c)
{
    c->close_after = 1;
    if (!c->begun && c->request) {
        if (!c->reading_paused)
            lws_rx_flow_control(c->wsi, 0);
        c->reading_paused = 1; /* the answer's begin resumes it */
        return c->is_dead ? -1 : 0;
    }
    while (c->out.bytes > 0 && !lws_send_pipe_choked(c->wsi) && http_on_writable(c) == 0)
        ;
    return -1;
}

int http_on_body_end(struct http_connection *c)
{
    struct http_request *request = c->request;

    if (c->body_over)
        return end_pipeline(c);
    c->body_over = 1;
    if (!request || c->state != HTTP_BODY || c->body_left > 0)
        return c->is_dead ? -1 : 0;
    c->state = HTTP_ANSWERING;
    http_deadline(c, 0);
    http_resume_reading(c);
    if (!request->base.route->streams_body)
        return run_handler(c);
    if (request->base.on_body)
        http_give_body(c, NULL, 0);
    return 0;
}

/* ---- upgrades -------------------------------------------------------------------------------- */

int http_on_upgrade(struct http_connection *c, const char *to)
{
    const struct web_route *route = NULL;
    struct error why = {0};
    struct http_head head;
    char *uri = NULL, *path = NULL;
    int size = 0, token = lws_http_get_uri_and_method(c->wsi, &uri, &size);
    unsigned refused = 0, allowed = 0;
    struct http_request *request;

    http_request_gone(c);
    request = http_request_new(c);
    if (!request || token != LWSHUMETH_GET || strcasecmp(to, "websocket") != 0)
        return -1;
    if (!http_head_read(c->wsi, &head))
        return buffer_release(&head.texts), -1;
    if (http_take_texts(c, request, uri, (size_t)size, &path)) {
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
    buffer_wipe(&head.texts);
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
    http_request_over(c);
    return 0;
}
