#include "coordinator/page/token_messages.h"

#include <inttypes.h>
#include <openssl/crypto.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/page/page.h"
#include "coordinator/page/tokens.h"
#include "protocol/message.h"

_Static_assert((int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_VIEW == (int)WEB_ROLE_VIEW &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_SUBMIT == (int)WEB_ROLE_SUBMIT &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_OPERATE == (int)WEB_ROLE_OPERATE &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_ADMIN == (int)WEB_ROLE_ADMIN,
               "roles have the same numbers on the wire");

/* Points at the row. */
static void fill_info(Azulejo__Wire__TokenInfo *info, const struct token_row *row)
{
    azulejo__wire__token_info__init(info);
    info->token = row->number;
    info->name = (char *)row->name;
    info->role = (Azulejo__Wire__TokenRole)row->role;
    info->owner = (char *)row->owner;
    info->made_by = (char *)row->made_by;
    info->made_at = row->made_at;
    info->used_at = row->used_at;
    info->expires_at = row->expires_at;
}

static status send_list(struct web_tokens *tokens, struct session *session, uint64_t request, struct error *err)
{
    size_t count;
    const struct token_row *rows = web_tokens_rows(tokens, &count);
    Azulejo__Wire__TokenInfo *infos = mem_alloc_array(count, sizeof *infos);
    Azulejo__Wire__TokenInfo **pointers = mem_alloc_array(count, sizeof(Azulejo__Wire__TokenInfo *));
    Azulejo__Wire__TokenList list = AZULEJO__WIRE__TOKEN_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TOKEN_LIST, token_list, &list);
    status s = infos && pointers ? STATUS_OK : error_no_memory(err, "a list of tokens");

    for (size_t i = 0; s == STATUS_OK && i < count; i++) {
        fill_info(&infos[i], &rows[i]);
        pointers[i] = &infos[i];
    }
    if (s == STATUS_OK) {
        list.n_tokens = count;
        list.tokens = pointers;
        session_reply(session, request, &envelope);
    }
    mem_free(pointers);
    mem_free(infos);
    return s;
}

static void send_made(struct session *session, uint64_t request, const struct token_row *row, char *secret)
{
    Azulejo__Wire__TokenInfo info;
    Azulejo__Wire__TokenMade made = AZULEJO__WIRE__TOKEN_MADE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TOKEN_MADE, token_made, &made);

    fill_info(&info, row);
    made.info = &info;
    made.secret = secret;
    session_reply(session, request, &envelope);
}

/* ---- answers that wait until the page knows -------------------------------------------------- */

struct token_answer {
    struct token_answer *next;
    uint32_t session;
    uint64_t request, version, due_ns;
    uint64_t token; /* that was made; 0: the list is wanted */
    char secret[TOKEN_TEXT_SIZE];
};

static void send_answer(struct page *page, struct token_answer *answer)
{
    struct session *session = session_find(page->server, answer->session);
    const struct token_row *row = answer->token ? web_token_row(page->tokens, answer->token) : NULL;
    struct error err = {0};

    if (session && row)
        send_made(session, answer->request, row, answer->secret);
    else if (session && send_list(page->tokens, session, answer->request, &err) != STATUS_OK)
        session_fail(session, answer->request, &err);
    OPENSSL_cleanse(answer->secret, sizeof answer->secret);
    mem_free(answer);
}

void token_answers_send(struct page *page, uint64_t version, uint64_t now_ns)
{
    if (version != UINT64_MAX && version > page->tokens_taken)
        page->tokens_taken = version;
    while (page->answers && (page->answers->version <= version || now_ns >= page->answers->due_ns)) {
        struct token_answer *answer = page->answers;
        page->answers = answer->next;
        send_answer(page, answer);
    }
}

void token_answers_drop(struct page *page)
{
    while (page->answers) {
        struct token_answer *answer = page->answers;
        page->answers = answer->next;
        OPENSSL_cleanse(answer->secret, sizeof answer->secret);
        mem_free(answer);
    }
}

/* It is on disk: answer when the page knows. */
static status answer_known(struct session *session, uint64_t request, const struct held_subject *subject,
                           uint64_t now_ns, struct error *err)
{
    struct page *page = session->server->guest.user;
    struct token_answer *answer = mem_calloc(1, sizeof *answer), **end = &page->answers;

    NEED(answer, err, "an answer");
    answer->session = session->id;
    answer->request = request;
    answer->token = subject->number;
    memcpy(answer->secret, subject->text, sizeof answer->secret - 1);
    answer->due_ns = now_ns + TOKEN_ANSWER_MS * NS_PER_MS;
    answer->version = subject->version;
    while (*end)
        end = &(*end)->next;
    *end = answer;
    if (answer->version <= page->tokens_taken) /* or 0: there is no page */
        token_answers_send(page, answer->version, 0);
    return STATUS_OK;
}

/* Something has changed: tell the page, and answer when it is on disk, and the page knows. */
static status answer_later(struct page *page, struct session *session, uint64_t request, uint64_t token,
                           const char *secret, struct error *err)
{
    struct held_subject subject = {.number = token, .version = page_tell_tokens(page), .is_plain = 1};
    status s;

    snprintf(subject.text, sizeof subject.text, "%s", secret);
    s = session_hold(session, request, answer_known, &subject, err);
    OPENSSL_cleanse(&subject, sizeof subject);
    return s;
}

/* ---- the coordinator's own, whose files are written by the thread pool ------------------------ */

struct own_task {
    struct task task;
    uint32_t session;
    uint64_t request;
    char secret[TOKEN_TEXT_SIZE], link[PAGE_LINK_MAX]; /* link: of STORE/page.url; "": the page has no address yet */
};

static void own_run(struct task *task)
{
    const struct page *page = task->server->guest.user;
    const struct own_task *t = (const struct own_task *)task;
    struct error err = {0};

    task->result = web_token_own_write(page->tokens, t->secret, &task->error);
    if (task->result == STATUS_OK && t->link[0] && page_link_write(page, t->link, &err) != STATUS_OK)
        log_warn("the page's address with its new token: %s", err.text);
}

static void own_end(struct task *task)
{
    struct own_task *t = (struct own_task *)task;
    struct page *page = task->server->guest.user;
    struct session *session = session_find(task->server, t->session);

    page->is_renewing = 0;
    THEN(task->result, web_token_own_renewed(page->tokens, t->secret, clock_wall_s(), &task->error));
    if (task->result == STATUS_OK)
        page_link_renew(page, 0); /* it may have been written meanwhile, with the old one */
    if (session && task->result == STATUS_OK)
        task->result = answer_later(page, session, t->request, TOKEN_OWN, t->secret, &task->error);
    else if (task->result == STATUS_OK)
        (void)page_tell_tokens(page);
    if (session && task->result != STATUS_OK)
        session_fail(session, t->request, &task->error);
}

static void own_release(struct task *task)
{
    struct own_task *t = (struct own_task *)task;

    OPENSSL_cleanse(t->secret, sizeof t->secret);
    OPENSSL_cleanse(t->link, sizeof t->link);
}

static const struct task_kind own_kind = {"the page's token", sizeof(struct own_task), own_run, own_end, own_release, 1};

static status renew_own(struct page *page, struct session *session, uint64_t request, struct error *err)
{
    struct own_task *t;
    status s;

    if (page->is_renewing)
        return error_set(err, STATUS_ERR_LIMIT, "the coordinator's own token is being renewed at this moment");
    t = task_new(session->server, &own_kind, err);
    s = t ? token_text_make(t->secret, err) : STATUS_ERR_NO_MEMORY;
    if (s != STATUS_OK) {
        task_drop(t ? &t->task : NULL);
        return s;
    }
    t->session = session->id;
    t->request = request;
    page_link(page, t->secret, t->link);
    page->is_renewing = 1;
    task_start(&t->task);
    return STATUS_OK;
}

/* ---- the messages ------------------------------------------------------------------------------ */

/* A text as it is, or an error: nothing of it is left out silently. */
static status take_text(char *out, size_t size, const char *text, const char *what, struct error *err)
{
    if (strlen(text) >= size)
        return error_set(err, STATUS_ERR_INPUT, "a token's %s has at most %zu bytes", what, size - 1);
    memcpy(out, text, strlen(text) + 1);
    return STATUS_OK;
}

static status create(struct page *page, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err)
{
    const Azulejo__Wire__TokenCreate *wanted = message->token_create;
    struct token_row row = {.role = wanted->role, .expires_at = wanted->expires_at};
    const char *name = wanted->name[0] ? wanted->name : web_role_name((enum web_role)wanted->role);
    char secret[TOKEN_TEXT_SIZE] = "";
    status s = take_text(row.name, sizeof row.name, name, "name", err);

    THEN(s, take_text(row.owner, sizeof row.owner, wanted->owner[0] ? wanted->owner : session->who, "owner", err));
    snprintf(row.made_by, sizeof row.made_by, "%s", session->who);
    THEN(s, web_token_create(page->tokens, &row, clock_wall_s(), secret, err));
    THEN(s, answer_later(page, session, message->request, row.number, secret, err));
    OPENSSL_cleanse(secret, sizeof secret);
    return s;
}

static status renew(struct page *page, struct session *session, const Azulejo__Wire__Envelope *message,
                    struct error *err)
{
    uint64_t token = message->token_renew->token;
    char secret[TOKEN_TEXT_SIZE] = "";
    status s;

    if (token == TOKEN_OWN)
        return renew_own(page, session, message->request, err);
    s = web_token_renew(page->tokens, token, clock_wall_s(), secret, err);

    THEN(s, answer_later(page, session, message->request, token, secret, err));
    OPENSSL_cleanse(secret, sizeof secret);
    return s;
}

status token_message(struct page *page, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err)
{
    status s;

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_CREATE: return create(page, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_RENEW: return renew(page, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_REVOKE:
        s = web_token_revoke(page->tokens, message->token_revoke->token, err);
        return s == STATUS_OK ? answer_later(page, session, message->request, 0, "", err) : s;
    default: return send_list(page->tokens, session, message->request, err);
    }
}
