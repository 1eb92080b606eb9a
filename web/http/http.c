#include "web/http/http.h"

#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "web/http/http_parts.h"

enum { NEVER_S = 300000000 };

_Static_assert(HTTP_PIECE_ROOM >= LWS_PRE, "the library's framing fits in front of a piece");

static int and_pause(struct http_connection *c, int result)
{
    if (result == 0 && (c->state == HTTP_ANSWERING || c->state == HTTP_IDLE))
        http_pause_reading(c);
    return result;
}

static int on_event(struct lws *wsi, enum lws_callback_reasons reason, void *user UNUSED, void *in, size_t size)
{
    struct http_connection *c = wsi ? lws_get_opaque_user_data(wsi) : NULL;

    if (!c)
        return 0; /* the context's own affairs */
    c->wsi = wsi;
    switch (reason) {
    case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE: return http_on_upgrade(c, in);
    case LWS_CALLBACK_HTTP: return and_pause(c, http_on_request(c));
    case LWS_CALLBACK_HTTP_BODY: return http_on_body(c, in, size);
    case LWS_CALLBACK_HTTP_BODY_COMPLETION: return http_on_body_end(c);
    case LWS_CALLBACK_HTTP_WRITEABLE: return and_pause(c, http_on_writable(c));
    case LWS_CALLBACK_RAW_RX: return http_on_no_request(c, in, size);
    case LWS_CALLBACK_CLOSED_HTTP: http_request_gone(c); return 0;
    case LWS_CALLBACK_ESTABLISHED: return http_socket_open(c);
    case LWS_CALLBACK_RECEIVE_PONG: http_socket_heard(c); return 0;
    case LWS_CALLBACK_RECEIVE: return http_socket_receive(c, in, size);
    case LWS_CALLBACK_SERVER_WRITEABLE: return http_socket_writable(c);
    case LWS_CALLBACK_CLOSED: http_socket_gone(c); return 0;
    case LWS_CALLBACK_WSI_DESTROY:
        lws_set_opaque_user_data(wsi, NULL);
        http_request_gone(c);
        http_socket_gone(c);
        http_connection_free(c);
        return 0;
    default: return 0;
    }
}

static void on_log(int level UNUSED, const char *line)
{
    log_debug("libwebsockets: %.*s", (int)strcspn(line, "\n"), line);
}

/* ---- begin and end --------------------------------------------------------------------------- */

static status make_context(struct http *http, struct error *err)
{
    static const struct lws_protocols protocols[] = {{"http", on_event, 0, HTTP_PIECE_MAX, 0, NULL, 0}, {0}};
    /* The library would end streams and long uploads that it takes for dead; we look ourselves. */
    static const lws_retry_bo_t liveness = {.secs_since_valid_ping = UINT16_MAX - 1, .secs_since_valid_hangup = UINT16_MAX};
    const struct web_options *options = &http->web->options;
    void *loops[1] = {http->web->loop};
    struct lws_context_creation_info info = {
        .port = CONTEXT_PORT_NO_LISTEN_SERVER,
        .protocols = protocols,
        .options = LWS_SERVER_OPTION_LIBUV | LWS_SERVER_OPTION_EXPLICIT_VHOSTS | LWS_SERVER_OPTION_VALIDATE_UTF8 |
                   LWS_SERVER_OPTION_NO_LWS_SYSTEM_STATES | LWS_SERVER_OPTION_FALLBACK_TO_APPLY_LISTEN_ACCEPT_CONFIG,
        .listen_accept_role = "raw-skt", /* of what begins with no method that the library knows: http_on_no_request */
        .listen_accept_protocol = "http",
        .foreign_loops = loops,
        .pcontext = &http->context,
        .server_string = "azulejo",
        .max_http_header_data = HTTP_HEADERS_MAX,
        .max_http_header_pool = (unsigned short)(http->connections_max + HTTP_ACCEPTS_PER_TURN),
        .fd_limit_per_thread = http->connections_max + 2 * HTTP_ACCEPTS_PER_TURN, /* some of its own */
        .pt_serv_buf_size = HTTP_PIECE_MAX,
        .keepalive_timeout = NEVER_S, /* a connection's deadline is ours alone */
        .timeout_secs = NEVER_S,
        .timeout_secs_ah_idle = NEVER_S,
        .uid = -1,
        .gid = -1,
        .retry_and_idle_policy = &liveness,
        .vhost_name = "azulejo",
        .alpn = "http/1.1",
    };

    for (size_t i = 0; i < GUARD_LINES; i++)
        http->lines[i] = (struct lws_protocol_vhost_options){.next = i + 1 < GUARD_LINES ? &http->lines[i + 1] : NULL,
                                                             .name = guard_lines[i].name,
                                                             .value = guard_lines[i].value};
    info.headers = http->lines;
    if (http->web->guard.is_tls) {
        info.options |= LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT;
        info.ssl_cert_filepath = options->cert;
        info.ssl_private_key_filepath = options->key;
    }
    lws_set_log_level(LLL_ERR | LLL_WARN, on_log);
    http->context = lws_create_context(&info);
    if (!http->context)
        return error_set(err, STATUS_ERR_INTERNAL,
                         "libwebsockets did not start: is its part for libuv there (libwebsockets-evlib-uv)?");
    http->vhost = lws_create_vhost(http->context, &info);
    if (!http->vhost)
        return error_set(err, STATUS_ERR_INPUT, "the page's certificate or key cannot be used: %s, %s",
                         options->cert ? options->cert : "none", options->key ? options->key : "none");
    return STATUS_OK;
}

status http_start(struct http **out, struct web *web, struct error *err)
{
    const struct web_options *options = &web->options;
    struct http *http = mem_calloc(1, sizeof *http);
    status s;

    *out = NULL;
    NEED(http, err, "the page's server");
    http->web = web;
    http->connections_max = options->connections_max;
    http->address_max = options->address_max;
    s = http_listen(http, options->host, options->port, &web->guard.port, err);
    THEN(s, make_context(http, err));
    *out = http; /* its handles may be open: http_stop closes them */
    return s;
}

void http_stop(struct http *http)
{
    http->is_stopping = 1;
    http_listen_stop(http);
    for (struct http_connection *c = http->first, *next; c; c = next) {
        next = c->next;
        http_request_gone(c);
        http_socket_gone(c);
    }
    if (http->context)
        lws_context_destroy(http->context);
}

void http_free(struct http *http)
{
    if (!http)
        return;
    if (http->context)
        lws_context_destroy(http->context); /* its second half, once the loop has closed its handles */
    while (http->first)
        http_connection_free(http->first);
    mem_free(http);
}

void http_tick(struct http *http, uint64_t now_ns)
{
    for (struct http_connection *c = http->first, *next; c; c = next) {
        next = c->next;
        if (c->socket)
            http_socket_tick(c, now_ns);
        else if (c->wsi && !c->is_ending)
            (void)and_pause(c, 0);
        if (c->deadline_ns && now_ns >= c->deadline_ns)
            http_end_now(c);
        else if (c->was_refused)
            http_connection_free(c);
    }
}

struct http_counts http_counts(const struct http *http)
{
    struct http_counts counts = http->counts;

    counts.connections = http->connection_count;
    for (const struct http_connection *c = http->first; c; c = c->next)
        counts.sockets += c->socket != NULL;
    return counts;
}

static int was_begun_with(const struct http_connection *c, uint64_t token, int cookies)
{
    const struct web_caller *caller = c->request ? &c->request->base.caller : c->socket ? &c->caller : NULL;

    return caller && (caller->token == token || (cookies && caller->by_cookie));
}

void http_retire_token(struct http *http, uint64_t token, int cookies)
{
    for (struct http_connection *c = http->first; c; c = c->next)
        c->retires |= was_begun_with(c, token, cookies);
}

void http_end_retired(struct http *http)
{
    for (struct http_connection *c = http->first, *next; c; c = next) {
        next = c->next;
        if (c->retires && (c->request || c->socket))
            http_kill(c);
    }
}
