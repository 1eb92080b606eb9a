#include "coordinator/page/webhook_events.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/json_quote.h"
#include "common/base/memory.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_audit.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/page/page.h"
#include "protocol/message.h"

/* ---- events ------------------------------------------------------------------------------------- */

enum { TEXT_MAX = 512 };

static const char *event_of(enum job_state state)
{
    switch (state) {
    case JOB_STATE_DONE: return "job-done";
    case JOB_STATE_FAILED: return "job-failed";
    case JOB_STATE_PARKED: return "job-parked";
    default: return NULL;
    }
}

static void put_text(struct buffer *out, const char *name, const char *text)
{
    char quoted[JSON_QUOTE_SIZE(TEXT_MAX)];

    json_quote(quoted, text, TEXT_MAX);
    buffer_printf(out, "%s\"%s\": %s", out->size ? ", " : "", name, quoted);
}

static void send_event(struct page *page, const char *event, struct buffer *fields)
{
    if (buffer_ok(fields))
        webhooks_send(page->webhooks, event, buffer_text(fields));
    buffer_release(fields);
}

void webhook_job_state(struct page *page, const struct job *job)
{
    const char *event = event_of(job->state);
    char url[PAGE_URL_MAX + 64];
    struct buffer fields = BUFFER_INIT;

    if (!event)
        return;
    buffer_printf(&fields, "\"job\": %" PRIu64, job->id);
    put_text(&fields, "name", job->name);
    put_text(&fields, "owner", job->owner);
    put_text(&fields, "state", job_state_word(job->state));
    put_text(&fields, "text", job->state_text);
    buffer_printf(&fields, ", \"frames\": %u, \"frames_done\": %u, \"submitted_at\": %" PRId64 ", \"finished_at\": %" PRId64,
                  job_frame_count(job), job->frames_done_count, job->submitted_at, job->finished_at);
    if (page->server->page_address[0]) {
        snprintf(url, sizeof url, "%s/#/job/%" PRIu64, page->server->page_address, job->id);
        put_text(&fields, "url", url);
    }
    send_event(page, event, &fields);
}

void webhook_tick(struct page *page, uint64_t now_ns)
{
    const struct trouble *trouble = &page->server->farm.trouble;
    int is_long = trouble_is(trouble) && now_ns - trouble->since_ns > STORE_EVENT_S * NS_PER_SECOND;
    struct buffer fields = BUFFER_INIT;

    if (!page->store_was_sent == !is_long || (page->store_was_sent && trouble_is(trouble)))
        return;
    page->store_was_sent = is_long;
    put_text(&fields, "text", is_long ? trouble->text : "the store can be used again: jobs continue");
    send_event(page, is_long ? "store-unusable" : "store-usable", &fields);
}

/* ---- what people ask ------------------------------------------------------------------------------ */

struct answer {
    struct webhook_view views[WEBHOOKS_MAX];
    Azulejo__Wire__WebhookInfo infos[WEBHOOKS_MAX], *pointers[WEBHOOKS_MAX];
};

/* Of one, or of all if `only` is 0. */
static status send_list(struct webhooks *webhooks, struct session *session, uint64_t request, uint64_t only,
                        const char *secret, struct error *err)
{
    struct answer *a = mem_calloc(1, sizeof *a);
    Azulejo__Wire__WebhookList list = AZULEJO__WIRE__WEBHOOK_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(WEBHOOK_LIST, webhook_list, &list);
    size_t count;

    NEED(a, err, "a list of webhooks");
    count = webhooks_list(webhooks, a->views);
    for (size_t i = 0; i < count; i++) {
        struct webhook_view *view = &a->views[i];
        Azulejo__Wire__WebhookInfo *info = &a->infos[list.n_webhooks];
        if (only && view->row.number != only)
            continue;
        azulejo__wire__webhook_info__init(info);
        info->webhook = view->row.number;
        session_audit_hide_password(view->row.url);
        info->url = view->row.url;
        info->made_by = view->row.made_by;
        info->made_at = view->row.made_at;
        info->waiting = view->counts.waiting;
        info->sent = view->counts.sent;
        info->failed = view->counts.failed;
        info->given_up = view->counts.given_up;
        info->last_error = view->last_error;
        a->pointers[list.n_webhooks++] = info;
    }
    list.webhooks = a->pointers;
    list.secret = (char *)secret;
    session_reply(session, request, &envelope);
    mem_free(a);
    return STATUS_OK;
}

/* `text`: the secret of a new one. */
static status answer_stored(struct session *session, uint64_t request, const struct held_subject *subject,
                            uint64_t now_ns UNUSED, struct error *err)
{
    const struct page *page = session->server->guest.user;

    return send_list(page->webhooks, session, request, subject->number, subject->text, err);
}

static status add(struct webhooks *webhooks, struct session *session, const Azulejo__Wire__Envelope *message,
                  struct error *err)
{
    const char *url = message->webhook_add->url;
    struct webhook_row row = {0};
    struct held_subject subject = {.is_plain = 1};
    struct digest bytes;
    status s;

    if (strlen(url) > WEBHOOK_URL_MAX)
        return error_set(err, STATUS_ERR_INPUT, "a webhook's address has at most %d bytes", WEBHOOK_URL_MAX);
    memcpy(row.url, url, strlen(url) + 1);
    snprintf(row.made_by, sizeof row.made_by, "%s", session->who);
    TRY(webhook_add(webhooks, &row, err));
    memcpy(bytes.bytes, row.secret, sizeof bytes.bytes);
    digest_to_hex(&bytes, subject.text);
    subject.number = row.number;
    s = session_hold(session, message->request, answer_stored, &subject, err);
    explicit_bzero(&subject, sizeof subject);
    return s;
}

/* A test waits for a foreign server. */
struct try_task {
    struct task task;
    struct webhooks *webhooks;
    uint32_t session;
    uint64_t request, webhook;
};

static void try_run(struct task *task)
{
    const struct try_task *t = (struct try_task *)task;

    task->result = webhook_try(t->webhooks, t->webhook, &task->error);
}

static void try_end(struct task *task)
{
    const struct try_task *t = (struct try_task *)task;
    struct session *session = session_find(task->server, t->session);

    webhooks_try_ended(t->webhooks);
    if (!session || session->state != SESSION_OPEN)
        return;
    if (task->result == STATUS_OK)
        task->result = send_list(t->webhooks, session, t->request, t->webhook, "", &task->error);
    if (task->result != STATUS_OK) {
        error_prefix(&task->error, "webhook %" PRIu64, t->webhook);
        session_fail(session, t->request, &task->error);
    }
}

static const struct task_kind try_kind = {"a webhook's test", sizeof(struct try_task), try_run, try_end, NULL, 0};

static status try(struct webhooks *webhooks, struct session *session, const Azulejo__Wire__Envelope *message,
                  struct error *err)
{
    struct try_task *t = task_new(session->server, &try_kind, err);
    status s = t ? webhooks_try_begin(webhooks, err) : STATUS_ERR_NO_MEMORY;

    if (s != STATUS_OK) {
        task_drop(t ? &t->task : NULL);
        return s;
    }
    t->webhooks = webhooks;
    t->session = session->id;
    t->request = message->request;
    t->webhook = message->webhook_test->webhook;
    task_start(&t->task);
    return STATUS_OK;
}

status webhook_message(struct webhooks *webhooks, struct session *session, const Azulejo__Wire__Envelope *message,
                       struct error *err)
{
    const struct held_subject all = {.is_plain = 1};

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_ADD: return add(webhooks, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_TEST: return try(webhooks, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_REMOVE:
        TRY(webhook_remove(webhooks, message->webhook_remove->webhook, err));
        return session_hold(session, message->request, answer_stored, &all, err);
    default: return send_list(webhooks, session, message->request, 0, "", err);
    }
}
