#include "web/web.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "web/api/call.h"
#include "web/base/certificate.h"
#include "web/base/control.h"
#include "web/http/http.h"
#include "web/uploads/import.h"
#include "web/api/live.h"
#include "web/api/routes.h"

/* ---- what the page is called ----------------------------------------------------------------- */

static const char *public_name(const struct web *web)
{
    return guard_public_name(&web->guard, web->options.host, web->options.name);
}

/* With TLS: have a certificate, and what people compare with what their browser shows. */
static status certify(struct web *web, struct error *err)
{
    int made = 0;
    status s = STATUS_OK;

    if (!web->guard.is_tls)
        return STATUS_OK;
    if (web->own_cert) {
        s = certificate_ensure(web->own_cert, web->own_key, public_name(web), &made, err);
        web->options.cert = web->own_cert;
        web->options.key = web->own_key;
    }
    THEN(s, certificate_fingerprint(web->options.cert, web->fingerprint, err));
    if (s == STATUS_OK && made)
        log_info("made a certificate for the page, %s", web->own_cert);
    return s;
}

/* ---- tokens that end --------------------------------------------------------------------------- */

static void end_connections(struct web *web)
{
    if (web->http)
        http_end_retired(web->http);
    web_calls_end_retired(web->calls);
    web->ended_ns = 0;
}

/* What begins from now on is of what the token is then: a renewed one has its number. */
static void on_token_ended(void *user, uint64_t token, int cookies)
{
    struct web *web = user;

    if (web->http)
        http_retire_token(web->http, token, cookies);
    web_calls_retire_token(web->calls, token);
    if (web->ended_ns == 0)
        web->ended_ns = clock_monotonic_ns();
}

/* ---- the page's own connection ----------------------------------------------------------------- */

static void connect_farm(struct web *web);

static void take_tokens(struct web *web, const Azulejo__Wire__PageTokens *tokens)
{
    Azulejo__Wire__PageTaken taken = AZULEJO__WIRE__PAGE_TAKEN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_TAKEN, page_taken, &taken);
    struct error err = {0};

    if (callers_set(&web->callers, tokens, on_token_ended, web, &err) != STATUS_OK) {
        link_abort(web->control, err.code, err.text);
        return;
    }
    taken.version = tokens->version;
    (void)web_tell(web, &envelope);
}

static void take_state(struct web *web, const Azulejo__Wire__PageState *state)
{
    web->state = (struct farm_state){.ending = state->ending, .uploads_max = state->uploads_max,
                                     .store_limit = state->store_limit};
    if (state->store_why[0])
        message_text(web->state.store_why, sizeof web->state.store_why, state->store_why);
}

static void on_message(void *user, const Azulejo__Wire__Envelope *message)
{
    struct web *web = user;

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_TOKENS:
        web->is_connected = 1;
        web->again_ms = 0;
        take_tokens(web, message->page_tokens);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_STATE: take_state(web, message->page_state); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_LISTEN: live_listens(web->live, message->page_listen->listens); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FARM_CHANGE: live_change(web->live, message->farm_change); break;
    default: break;
    }
}

static void on_again(uv_timer_t *timer) { connect_farm(timer->data); }

static void on_end(void *user, const struct error *why)
{
    struct web *web = user;

    web->control = NULL;
    if (web->is_connected && why->code == STATUS_OK)
        log_info("the coordinator has ended the connection: trying again");
    else if (why->code != STATUS_OK && (web->is_connected || strcmp(web->no_farm.text, why->text) != 0))
        log_warn("%s: %s: trying again",
                 web->is_connected ? "the connection to the coordinator ended" : "the coordinator cannot be reached", why->text);
    web->no_farm = *why;
    web->is_connected = 0;
    if (web->is_stopping)
        return;
    if (web->why.code != STATUS_OK) { /* PageBegin said so */
        web_stop(web);
        return;
    }
    live_farm_lost(web->live);
    web->again_ms = web->again_ms == 0                    ? WEB_AGAIN_MIN_MS
                    : 2 * web->again_ms < WEB_AGAIN_MAX_MS ? 2 * web->again_ms
                                                           : WEB_AGAIN_MAX_MS;
    uv_timer_start(&web->again, on_again, web->again_ms, 0);
}

/* Listen, the first time; say where, or why not. */
static void connect_farm(struct web *web)
{
    static const struct link_callbacks callbacks = {on_message, NULL, on_end};
    Azulejo__Wire__PageBegin begin = AZULEJO__WIRE__PAGE_BEGIN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_BEGIN, page_begin, &begin);
    struct error err = {0};

    begin.address = web->address;
    begin.port = web->guard.port;
    begin.fingerprint = web->fingerprint;
    begin.code = (uint32_t)web->why.code;
    begin.why = web->why.text;
    begin.wall = web->wall;
    begin.wall_lacks = web->wall_lacks;
    if (link_open(&web->control, &web->farm, 0, &callbacks, web, &err) == STATUS_OK) {
        (void)!link_send(web->control, &envelope, NULL);
        return;
    }
    log_warn("the coordinator: %s", err.text);
    uv_timer_start(&web->again, on_again, WEB_AGAIN_MAX_MS, 0);
}

/* ---- life ---------------------------------------------------------------------------------------- */

static void on_tick(uv_timer_t *timer)
{
    struct web *web = timer->data;
    uint64_t now_ns = clock_monotonic_ns();

    link_tick(&web->farm, now_ns);
    web_calls_tick(web->calls, now_ns);
    callers_tick(&web->callers, clock_wall_s(), on_token_ended, web);
    if (web->ended_ns && now_ns - web->ended_ns >= WEB_ENDS_MS * NS_PER_MS)
        end_connections(web);
    imports_tick(web->imports, now_ns);
    if (web->http)
        http_tick(web->http, now_ns);
    live_tick(web->live, now_ns);
}

static status listen_(struct web *web, struct error *err)
{
    const char *name;
    status s = certify(web, err);

    THEN(s, http_start(&web->http, web, err));
    if (s != STATUS_OK)
        return s;
    name = public_name(web);
    snprintf(web->address, sizeof web->address, strchr(name, ':') ? "%s://[%s]:%u" : "%s://%s:%u",
             web->guard.is_tls ? "https" : "http", name, web->guard.port);
    log_info("the page is at %s", web->address);
    return STATUS_OK;
}

static status make_parts(struct web *web, struct error *err)
{
    const struct web_options *o = &web->options;
    const int is_tls = o->cert || !guard_is_loopback(o->host);
    status s = guard_init(&web->guard, o->host, o->name, o->port, is_tls, err);

    if (s == STATUS_OK && is_tls && !o->cert) {
        web->own_cert = file_join(o->folder, "web-cert.pem");
        web->own_key = file_join(o->folder, "web-key.pem");
        if (!web->own_cert || !web->own_key)
            s = error_no_memory(err, "the page's certificate");
    }
    THEN(s, live_new(&web->live, web, err));
    THEN(s, web_calls_new(&web->calls, &web->farm, err));
    THEN(s, imports_new(&web->imports, web, err));
    return s;
}

status web_new(struct web **out, uv_loop_t *loop, const struct web_options *options, const struct link_peers *farm,
               struct error *err)
{
    struct web *web = mem_calloc(1, sizeof *web);
    status s;

    *out = NULL;
    NEED(web, err, "the page");
    web->options = *options;
    web->loop = loop;
    web->farm = *farm;
    web->farm.loop = loop;
    web->routing = &web_routing;
    s = make_parts(web, err);
    if (s != STATUS_OK) {
        web_free(web);
        return s;
    }
    uv_timer_init(loop, &web->tick);
    uv_timer_init(loop, &web->again);
    web->tick.data = web->again.data = web;
    (void)!listen_(web, &web->why); /* the coordinator is sent the reason */
    *out = web;
    return STATUS_OK;
}

status web_start(struct web *web, struct error *err)
{
    TRY(imports_begin(web->imports, err));
    connect_farm(web);
    uv_timer_start(&web->tick, on_tick, WEB_TICK_MS, WEB_TICK_MS);
    return STATUS_OK;
}

void web_stop(struct web *web)
{
    if (web->is_stopping)
        return;
    web->is_stopping = 1;
    imports_stop(web->imports);
    if (web->http)
        http_stop(web->http);
    link_close_all(&web->farm);
    uv_close((uv_handle_t *)&web->tick, NULL);
    uv_close((uv_handle_t *)&web->again, NULL);
}

void web_free(struct web *web)
{
    if (!web)
        return;
    http_free(web->http);
    live_free(web->live);
    imports_free(web->imports);
    web_calls_free(web->calls);
    callers_release(&web->callers);
    explicit_bzero(&web->farm.key, sizeof web->farm.key);
    mem_free(web->own_cert);
    mem_free(web->own_key);
    mem_free(web);
}
