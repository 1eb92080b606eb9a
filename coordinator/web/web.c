#include "coordinator/web/web.h"

#include <stdio.h>
#include <string.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/web/certificate.h"
#include "coordinator/web/call.h"
#include "coordinator/web/http.h"
#include "coordinator/web/token_messages.h"
#include "coordinator/web/live.h"
#include "coordinator/web/routes.h"
#include "coordinator/web/import.h"
#include "coordinator/web/tokens.h"
#include "coordinator/web/webhook_events.h"

/* ---- what the page is called ----------------------------------------------------------------- */

static const char *public_name(const struct web *web)
{
    return guard_public_name(&web->guard, web->options.host, web->options.name);
}

/* With TLS: have a certificate, and show what people compare with what their browser shows. */
static status certify(struct web *web, struct error *err)
{
    char fingerprint[FINGERPRINT_SIZE];
    int made = 0;
    status s = STATUS_OK;

    if (!web->guard.is_tls)
        return STATUS_OK;
    if (web->own_cert) {
        s = certificate_ensure(web->own_cert, web->own_key, public_name(web), &made, err);
        web->options.cert = web->own_cert;
        web->options.key = web->own_key;
    }
    if (s == STATUS_OK)
        s = certificate_fingerprint(web->options.cert, fingerprint, err);
    if (s != STATUS_OK)
        return s;
    if (made)
        log_info("made a certificate for the page, %s", web->own_cert);
    printf("page certificate: SHA-256 %s\n", fingerprint);
    return STATUS_OK;
}

/* STORE/page.url: the address with the token. */
static status write_url(const struct web *web, int prints, struct error *err)
{
    char url[WEB_URL_MAX + 160], *path = file_join(web->options.store, "page.url");
    status s;

    if (!path)
        return error_no_memory(err, "the page's address");
    snprintf(url, sizeof url, "%s/#token=%s\n", web->address, web_tokens_own(web->tokens));
    s = file_write_private(path, url, strlen(url), err);
    mem_free(path);
    if (prints) {
        printf("page: %s", url);
        fflush(stdout);
    }
    explicit_bzero(url, sizeof url);
    return s;
}

static void publish(struct web *web)
{
    const char *name = public_name(web);
    struct error err = {0};

    snprintf(web->address, sizeof web->address, strchr(name, ':') ? "%s://[%s]:%u" : "%s://%s:%u",
             web->guard.is_tls ? "https" : "http", name, web->guard.port);
    log_info("the page is at %s", web->address);
    webhooks_set_own_ports(web->webhooks, web->guard.port, web->server->port);
    if (write_url(web, 1, &err) != STATUS_OK)
        log_warn("the page's address, for other programs: %s", err.text);
}

/* ---- the guest ------------------------------------------------------------------------------- */

static void on_token_ended(void *user, uint64_t token, int cookies)
{
    struct web *web = user;
    struct error err = {0};

    token_end(web, token, cookies);
    if (token == TOKEN_OWN && web->http && write_url(web, 0, &err) != STATUS_OK)
        log_warn("the page's address with its new token: %s", err.text);
}

static status message(void *user, struct session *session, const Azulejo__Wire__Envelope *asked, uint64_t now_ns,
                      struct error *err)
{
    struct web *web = user;

    (void)now_ns;
    switch (asked->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_ADD:
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_REMOVE:
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_TEST:
        return webhook_message(web->webhooks, session, asked, err);
    default:
        return token_message(web->tokens, session, asked, err);
    }
}

static status start_parts(struct web *web, struct server *server, struct error *err)
{
    status s = web_tokens_open(&web->tokens, server->store, on_token_ended, web, err);

    if (s == STATUS_OK)
        s = certify(web, err);
    if (s == STATUS_OK)
        s = web_calls_new(&web->calls, server, err);
    if (s == STATUS_OK)
        s = imports_open(&web->imports, server, web->options.client, err);
    if (s == STATUS_OK)
        s = webhooks_open(&web->webhooks, server->store, err);
    if (s == STATUS_OK)
        s = live_new(&web->live, server, err);
    return s;
}

/* A farm whose page was not asked for goes on without it: tokens can be made, but nobody is served. */
static status start(void *user, struct server *server, struct error *err)
{
    struct web *web = user;
    struct error why = {0};
    status s;

    web->server = server;
    s = start_parts(web, server, err);
    if (s != STATUS_OK) {
        live_stop(web->live);
        return status_is_environment(s) && !web->options.was_asked_for ? STATUS_ERR_UNREACHABLE : s;
    }
    s = http_start(&web->http, web, &why);
    if (s == STATUS_OK) {
        publish(web);
        return STATUS_OK;
    }
    if (web->http)
        http_stop(web->http);
    if (s == STATUS_ERR_UNREACHABLE && !web->options.was_asked_for) {
        log_warn("no page: %s", why.text);
        return STATUS_OK;
    }
    live_stop(web->live);
    return error_set(err, s == STATUS_ERR_UNREACHABLE ? STATUS_ERR_IO : s, "%s", why.text);
}

static void job_changed(void *user, const struct job *job)
{
    const struct web *web = user;

    if (web->live)
        live_job_changed(web->live, job);
}

static void job_removed(void *user, uint64_t job)
{
    const struct web *web = user;

    if (web->live)
        live_job_removed(web->live, job);
}

static void job_state(void *user, const struct job *job)
{
    webhook_job_state(user, job);
}

static void workers_changed(void *user)
{
    const struct web *web = user;

    if (web->live)
        live_workers_changed(web->live);
}

static void job_event(void *user, const struct job_event *event)
{
    const struct web *web = user;

    if (web->live)
        live_job_event(web->live, event);
}

static void tick(void *user, uint64_t now_ns)
{
    struct web *web = user;

    web_calls_tick(web->calls, now_ns);
    token_end_tick(web, now_ns);
    imports_tick(web->imports, now_ns);
    metrics_tick(&web->metrics, now_ns);
    webhook_tick(web, now_ns);
    if (web->http)
        http_tick(web->http, now_ns);
    if (web->live)
        live_tick(web->live, now_ns);
}

static void stop(void *user)
{
    struct web *web = user;

    imports_stop(web->imports);
    if (web->http)
        http_stop(web->http);
    live_stop(web->live);
    web->server = NULL;
}

struct server_guest web_guest(struct web *web)
{
    return (struct server_guest){.start = start, .job_changed = job_changed, .job_removed = job_removed, .job_state = job_state,
                                 .workers_changed = workers_changed, .job_event = job_event, .tick = tick,
                                 .message = message, .stop = stop, .user = web};
}

status web_new(struct web **out, const struct web_options *options, struct error *err)
{
    struct web *web = mem_calloc(1, sizeof *web);
    const int is_tls = options->cert || !guard_is_loopback(options->host);
    status s;

    *out = web;
    if (!web)
        return error_no_memory(err, "the page");
    web->options = *options;
    web->routing = &web_routing;
    s = guard_init(&web->guard, options->host, options->name, options->port, is_tls, err);
    if (s == STATUS_OK && is_tls && !options->cert) {
        web->own_cert = file_join(options->store, "web-cert.pem");
        web->own_key = file_join(options->store, "web-key.pem");
        if (!web->own_cert || !web->own_key)
            s = error_no_memory(err, "the page's certificate");
    }
    return s;
}

void web_free(struct web *web)
{
    if (!web)
        return;
    http_free(web->http);
    live_free(web->live);
    imports_free(web->imports);
    web_calls_free(web->calls);
    webhooks_close(web->webhooks);
    web_tokens_close(web->tokens);
    mem_free(web->own_cert);
    mem_free(web->own_key);
    mem_free(web);
}
