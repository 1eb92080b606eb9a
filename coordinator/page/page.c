#include "coordinator/page/page.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/page/feed.h"
#include "coordinator/page/token_end.h"
#include "coordinator/page/token_messages.h"
#include "coordinator/page/tokens.h"
#include "coordinator/page/watching.h"
#include "protocol/message.h"

/* ---- what the page's program is sent ----------------------------------------------------------- */

static struct session *follower(struct page *page)
{
    return page->follower ? session_find(page->server, page->follower) : NULL;
}

static void send_tokens(void *user, Azulejo__Wire__PageTokens *message)
{
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_TOKENS, page_tokens, message);

    session_send(user, &envelope);
}

uint64_t page_tell_tokens(struct page *page)
{
    struct session *session = follower(page);
    struct error err = {0};

    if (!session)
        return 0;
    if (web_tokens_tell(page->tokens, ++page->tokens_version, send_tokens, session, &err) == STATUS_OK)
        return page->tokens_version;
    log_warn("the page does not learn of its tokens: %s", err.text);
    session_end(session, &err); /* it comes again */
    return 0;
}

static struct page_state state_now(const struct page *page)
{
    const struct server *server = page->server;
    const struct collector *c = &server->collector;
    struct page_state now = {.ending = server->state != SERVER_LISTENING, .uploads_max = UINT64_MAX};
    struct error why = {0};

    if (farm_store_usable(&server->farm, &why) != STATUS_OK)
        snprintf(now.store_why, sizeof now.store_why, "%.255s", why.text);
    now.store_limit = room_limit_bytes(&c->policy.store, c->footprint.disk_bytes);
    if (now.store_limit > 0) {
        uint64_t total = footprint_total(&c->footprint);
        now.uploads_max = now.store_limit > total ? now.store_limit - total : 0;
    }
    return now;
}

static void tell_state(struct page *page, int always)
{
    Azulejo__Wire__PageState message = AZULEJO__WIRE__PAGE_STATE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_STATE, page_state, &message);
    struct page_state now = state_now(page), *sent = &page->sent;
    struct session *session = follower(page);

    if (!session || (!always && sent->ending == now.ending && sent->uploads_max == now.uploads_max &&
                     sent->store_limit == now.store_limit && strcmp(sent->store_why, now.store_why) == 0))
        return;
    *sent = now;
    message.ending = now.ending;
    message.store_why = now.store_why;
    message.uploads_max = now.uploads_max;
    message.store_limit = now.store_limit;
    session_send(session, &envelope);
}

/* ---- it begins --------------------------------------------------------------------------------- */

void page_link(const struct page *page, const char *token, char line[PAGE_LINK_MAX])
{
    line[0] = 0;
    if (page->server->page_address[0])
        snprintf(line, PAGE_LINK_MAX, "%s/#token=%s\n", page->server->page_address, token);
}

status page_link_write(const struct page *page, const char *line, struct error *err)
{
    char *path = file_join(page->options.store, "page.url");
    status s;

    NEED(path, err, "the page's address");
    s = file_write_private(path, line, strlen(line), err);
    mem_free(path);
    return s;
}

struct link_task {
    struct task task;
    struct page *page;
    int prints;
    char line[PAGE_LINK_MAX];
};

static void link_run(struct task *task)
{
    const struct link_task *t = (const struct link_task *)task;

    task->result = page_link_write(t->page, t->line, &task->error);
}

static void link_end(struct task *task)
{
    const struct link_task *t = (const struct link_task *)task;
    struct page *page = t->page;

    if (task->result != STATUS_OK)
        log_warn("the page's address, for other programs: %s", task->error.text);
    if (t->prints) {
        printf("page: %s", t->line);
        fflush(stdout);
    }
    page->link_writes = 0;
    if (page->link_stale)
        page_link_renew(page, 0);
}

static void link_release(struct task *task) { explicit_bzero(((struct link_task *)task)->line, PAGE_LINK_MAX); }

static const struct task_kind link_kind = {"the page's address", sizeof(struct link_task), link_run, link_end, link_release, 1};

void page_link_renew(struct page *page, int prints)
{
    struct error err = {0};
    struct link_task *t;

    page->link_stale = page->link_writes;
    page->link_prints |= prints;
    if (page->link_writes || !page->server->page_address[0])
        return;
    t = task_new(page->server, &link_kind, &err);
    if (!t) {
        log_warn("the page's address, for other programs: %s", err.text);
        return;
    }
    t->page = page;
    t->prints = page->link_prints;
    page->link_prints = 0;
    page_link(page, web_tokens_own(page->tokens), t->line);
    page->link_writes = 1;
    task_start(&t->task);
}

/* It listens and knows the tokens, and is to be found. */
static void publish(struct page *page)
{
    if (page->keeper)
        keeper_listens(page->keeper, page->port);
    if (!page->was_there && page->fingerprint[0])
        printf("page certificate: SHA-256 %s\n", page->fingerprint);
    log_info("the page is at %s", page->server->page_address);
    page_link_renew(page, !page->was_there);
    page->was_there = 1;
}

static void begin(struct page *page, struct session *session, const Azulejo__Wire__PageBegin *message)
{
    const Azulejo__Wire__Failure why = {.code = message->code, .text = message->why};
    struct session *other = follower(page);

    if (message->code) {
        (void)!message_failure_get(&why, &page->why);
        if (page->was_there || !page->keeper)
            log_warn("the page cannot listen: %s", page->why.text);
        session_end(session, NULL);
        return;
    }
    if (other && other != session) {
        log_info("the page's program has connected again as session %u", session->id);
        session_end(other, NULL);
    }
    message_text(page->server->page_address, sizeof page->server->page_address, message->address);
    message_text(page->fingerprint, sizeof page->fingerprint, message->fingerprint);
    page->port = (uint16_t)message->port;
    message_text(page->server->wall, sizeof page->server->wall, message->wall);
    message_text(page->server->wall_lacks, sizeof page->server->wall_lacks, message->wall_lacks);
    page->follower = session->id;
    page->is_published = 0;
    feed_listen(page->feed, 0);
    (void)page_tell_tokens(page);
    tell_state(page, 1);
}

/* ---- its other messages ------------------------------------------------------------------------ */

static void listen_(struct page *page, struct session *session, const Azulejo__Wire__Envelope *message)
{
    Azulejo__Wire__PageListen answer = AZULEJO__WIRE__PAGE_LISTEN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_LISTEN, page_listen, &answer);

    answer.listens = message->page_listen->listens;
    feed_listen(page->feed, answer.listens ? session->id : 0);
    session_reply(session, message->request, &envelope);
}

static void note(struct page *page, const Azulejo__Wire__PageNote *note)
{
    const Azulejo__Wire__Failure failure = {.code = note->code, .text = note->why};
    char verb[32], details[256];
    struct audit_actor actor = {0};
    struct error why = {0};

    if (!note->verb[0]) {
        web_tokens_used(page->tokens, note->token, clock_wall_s());
        return;
    }
    message_text(verb, sizeof verb, note->verb);
    message_text(details, sizeof details, note->details);
    message_text(actor.who, sizeof actor.who, note->who);
    message_text(actor.address, sizeof actor.address, note->address);
    message_text(actor.key, sizeof actor.key, note->key);
    if (note->code)
        (void)!message_failure_get(&failure, &why);
    audit_note(&page->server->audit, &actor, verb, note->job, details[0] ? details : NULL, note->code ? &why : NULL);
}

static status send_metrics(struct page *page, struct session *session, uint64_t request, uint64_t now_ns,
                           struct error *err)
{
    Azulejo__Wire__Metrics metrics = AZULEJO__WIRE__METRICS__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(METRICS, metrics, &metrics);
    struct buffer text = BUFFER_INIT;
    status s;

    metrics_write(page, now_ns, &text);
    s = buffer_ok(&text) ? STATUS_OK : error_no_memory(err, "the metrics");
    if (s == STATUS_OK) {
        metrics.text = (char *)buffer_text(&text);
        session_reply(session, request, &envelope);
    }
    buffer_release(&text);
    return s;
}

static status on_message(void *user, struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                         struct error *err)
{
    struct page *page = user;

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_BEGIN: begin(page, session, message->page_begin); return STATUS_OK;
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_LISTEN: listen_(page, session, message); return STATUS_OK;
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_NOTE: note(page, message->page_note); return STATUS_OK;
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_TAKEN:
        token_answers_send(page, message->page_taken->version, 0);
        if (session->id == page->follower && !page->is_published) {
            page->is_published = 1;
            publish(page);
        }
        return STATUS_OK;
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_WATCH:
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_TAKEN: return watching_message(page->watching, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_METRICS_GET: return send_metrics(page, session, message->request, now_ns, err);
    default: return token_message(page, session, message, err);
    }
}

/* A session of the page's program that acts for a token. */
static status greet(void *user, struct session *session, uint64_t token, struct error *err)
{
    const struct page *page = user;
    const struct token_row *row = web_token_row(page->tokens, token);

    if (!row || !web_token_is_valid(page->tokens, token, clock_wall_s()))
        return error_set(err, STATUS_ERR_REFUSED, "the token was revoked");
    session->may = (enum web_role)row->role;
    snprintf(session->who, sizeof session->who, "%s", row->owner);
    snprintf(session->peer, sizeof session->peer, "API, token %" PRIu64 ": %.30s", token, row->name);
    return STATUS_OK;
}

/* ---- tokens that end --------------------------------------------------------------------------- */

static void end_sessions(struct page *page)
{
    struct error why = {0};

    error_set(&why, STATUS_ERR_REFUSED, "the token was revoked");
    page->sessions_end = 0;
    for (struct session *s = page->server->sessions, *next; s; s = next) {
        next = s->next;
        if (!s->token_ended)
            continue;
        if (s->held == 0)
            session_end(s, &why);
        else
            page->sessions_end = 1; /* it gets an answer first: a token may end itself */
    }
}

/* Not now: the session that asked for it gets its answer first. Sessions that begin from now on are of what the token is
 * then: a renewed one has its number. */
static void on_token_ended(void *user, uint64_t token, int cookies)
{
    struct page *page = user;

    (void)cookies; /* their key follows from the token */
    for (struct session *s = page->server->sessions; s; s = s->next)
        s->token_ended |= s->token == token;
    page->sessions_end = 1;
}

/* ---- the guest --------------------------------------------------------------------------------- */

static status start(void *user, struct server *server, struct error *err)
{
    struct page *page = user;
    status s;

    page->server = server;
    s = web_tokens_open(&page->tokens, server->store, on_token_ended, page, err);
    THEN(s, feed_new(&page->feed, server, err));
    THEN(s, watching_new(&page->watching, server, err));
    if (s == STATUS_OK && !page->options.is_apart)
        s = keeper_new(&page->keeper, server, &page->options, err);
    if (s == STATUS_OK)
        return STATUS_OK;
    watching_stop(page->watching);
    return status_is_environment(s) && !page->options.was_asked_for ? STATUS_ERR_UNREACHABLE : s;
}

static int is_settled(void *user, status *result, struct error *err)
{
    struct page *page = user;

    *result = STATUS_OK;
    if (!page->keeper || page->is_published)
        return !page->link_writes;
    if (page->why.code == STATUS_OK && !keeper_gave_up(page->keeper, &page->why))
        return 0;
    if (page->options.was_asked_for) {
        *result = error_set(err, page->why.code == STATUS_ERR_UNREACHABLE ? STATUS_ERR_IO : page->why.code, "%s",
                            page->why.text);
    } else {
        log_warn("no page: %s", page->why.text);
        keeper_stop(page->keeper);
    }
    return 1;
}

static void job_changed(void *user, const struct job *job) { feed_job_changed(((struct page *)user)->feed, job->id); }

static void job_removed(void *user, uint64_t job) { feed_job_removed(((struct page *)user)->feed, job); }

static void workers_changed(void *user) { feed_workers_changed(((struct page *)user)->feed); }

static void job_event(void *user, const struct job_event *event) { feed_job_event(((struct page *)user)->feed, event); }

static void session_gone(void *user, const struct session *session)
{
    struct page *page = user;

    watching_session_gone(page->watching, session);
    if (session->id != page->follower)
        return;
    if (session->silent && page->keeper)
        keeper_hung(page->keeper);
    page->follower = 0;
    feed_listen(page->feed, 0);
    token_answers_send(page, UINT64_MAX, 0);
}

static void tick(void *user, uint64_t now_ns)
{
    struct page *page = user;

    token_end_tick(page, now_ns);
    token_answers_send(page, 0, now_ns);
    if (page->sessions_end && !page->answers)
        end_sessions(page);
    tell_state(page, 0);
    metrics_tick(&page->metrics, now_ns);
    feed_tick(page->feed, now_ns);
}

static void stop(void *user)
{
    struct page *page = user;

    if (page->keeper)
        keeper_stop(page->keeper);
    watching_stop(page->watching);
}

struct server_guest page_guest(struct page *page)
{
    return (struct server_guest){.start = start, .is_settled = is_settled, .job_changed = job_changed,
                                 .job_removed = job_removed, .workers_changed = workers_changed,
                                 .job_event = job_event, .tick = tick, .message = on_message, .greet = greet,
                                 .session_gone = session_gone, .stop = stop, .user = page};
}

status page_new(struct page **out, const struct page_options *options, struct error *err)
{
    *out = mem_calloc(1, sizeof **out);
    NEED(*out, err, "the page");
    (*out)->options = *options;
    return STATUS_OK;
}

void page_free(struct page *page)
{
    if (!page)
        return;
    keeper_free(page->keeper);
    watching_free(page->watching);
    feed_free(page->feed);
    token_answers_drop(page);
    web_tokens_close(page->tokens);
    mem_free(page);
}
