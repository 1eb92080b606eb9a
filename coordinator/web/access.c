#include "coordinator/web/access.h"

#include <inttypes.h>
#include <jansson.h>
#include <openssl/crypto.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/base/clock.h"
#include "common/base/json_quote.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/task.h"
#include "coordinator/store/audit.h"
#include "coordinator/web/call.h"
#include "coordinator/web/http.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/tokens.h"
#include "coordinator/web/web.h"

/* ---- the audit log ---------------------------------------------------------------------------- */

static void note(struct web *web, const char *who, const char *peer, const struct token_row *row,
                 const struct error *why)
{
    struct audit_actor actor = {.key = "token"};
    char name[JSON_QUOTE_SIZE(TOKEN_NAME_MAX)] = "", details[sizeof name + 64];

    snprintf(actor.who, sizeof actor.who, "%s", who);
    snprintf(actor.address, sizeof actor.address, "%s", peer);
    if (row) {
        json_quote(name, row->name, TOKEN_NAME_MAX);
        snprintf(details, sizeof details, "{\"token\": %" PRIu64 ", \"name\": %s}", row->number, name);
    }
    audit_note(&web->server->audit, &actor, "sign in", 0, row ? details : NULL, why);
}

int access_note_failure(struct web *web, const char *peer)
{
    struct error why;

    if (!web_tokens_note_failure(web->tokens, peer, clock_monotonic_ns()))
        return 0;
    (void)error_set(&why, STATUS_ERR_REFUSED, "a token that is none, or that has ended");
    note(web, "", peer, NULL, &why);
    return 1;
}

/* ---- signing in ------------------------------------------------------------------------------- */

static void answer_who(struct web_request *request, const char *headers)
{
    const struct web_caller *caller = &request->caller;
    char host[64] = "";
    json_t *root;
    char *text;
    struct error err = {0};

    (void)gethostname(host, sizeof host - 1);
    root = json_pack("{s:s, s:s, s:I, s:s, s:s, s:s}", "role", web_role_name(caller->role), "who", caller->who,
                     "token", (json_int_t)caller->token, "token_name", caller->token_name, "software", "azulejo " AZULEJO_VERSION, "farm", host);
    text = root ? json_dumps(root, JSON_COMPACT) : NULL;
    if (text) {
        web_answer(request, 200, "application/json", headers, text, strlen(text));
    } else {
        error_no_memory(&err, "an answer");
        web_fail(request, &err);
    }
    free(text);
    json_decref(root);
}

void web_session_get(struct web_request *request)
{
    answer_who(request, NULL);
}

/* The token of the body into out; 0: there is none, and this was answered. */
static int take_token(struct web_request *request, char out[TOKEN_TEXT_SIZE])
{
    json_error_t why;
    json_t *root = json_loadb((const char *)request->body.data, request->body.size, 0, &why);
    const char *token = root ? json_string_value(json_object_get(root, "token")) : NULL;
    int found = token && json_object_size(root) == 1;

    if (found)
        snprintf(out, TOKEN_TEXT_SIZE, "%s", strlen(token) < TOKEN_TEXT_SIZE ? token : "");
    else
        problem_answer(request, PROBLEM_INPUT, "the body must be {\"token\": \"azt_...\"}, and nothing else");
    json_decref(root);
    return found;
}

void web_session_post(struct web_request *request)
{
    struct web *web = request->web;
    char token[TOKEN_TEXT_SIZE] = "", cookie[COOKIE_SIZE], line[sizeof cookie + 160];
    int64_t life_s, now_s = clock_wall_s();

    if (!take_token(request, token))
        return;
    if (!web_tokens_find(web->tokens, token, now_s, &request->caller)) {
        if (access_note_failure(web, request->peer))
            problem_answer(request, PROBLEM_NO_TOKEN,
                           "this is no token, or one that has ended: the coordinator prints its own when it starts, "
                           "and 'azulejo token create' makes one");
        else
            problem_answer(request, PROBLEM_LIMIT,
                           "too many wrong tokens came from your address: try again in a minute");
        return;
    }
    web_tokens_cookie(web->tokens, request->caller.token, now_s, cookie, &life_s);
    snprintf(line, sizeof line,
             "set-cookie: " GUARD_COOKIE "=%s; Path=/; Max-Age=%" PRId64 "; HttpOnly; SameSite=Strict%s\r\n", cookie,
             life_s, web->guard.is_tls ? "; Secure" : "");
    note(web, request->caller.who, request->peer, web_token_row(web->tokens, request->caller.token), NULL);
    answer_who(request, line);
    OPENSSL_cleanse(token, sizeof token);
}

void web_session_delete(struct web_request *request)
{
    char line[160];

    snprintf(line, sizeof line, "set-cookie: " GUARD_COOKIE "=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict%s\r\n",
             request->web->guard.is_tls ? "; Secure" : "");
    web_answer(request, 204, "application/json", line, NULL, 0);
}

/* ---- in time ---------------------------------------------------------------------------------- */

/* That a token was used is stored by the pool: the loop does not wait for the disk over it. */
struct use_task {
    struct task task;
    uint64_t token;
    int64_t at;
};

static void use_run(struct task *task)
{
    const struct use_task *t = (struct use_task *)task;

    task->result = store_token_used(task->server->store, t->token, t->at, &task->error);
}

static void use_end(struct task *task)
{
    if (task->result != STATUS_OK)
        log_debug("%s", task->error.text); /* the next use is stored */
}

static const struct task_kind use_kind = {"the use of a token", sizeof(struct use_task), use_run, use_end, NULL};

static void store_uses(struct web *web)
{
    const struct token_row *row;

    while ((row = web_tokens_next_used(web->tokens))) {
        struct use_task *t = task_new(web->server, &use_kind, NULL);
        if (!t)
            return;
        t->token = row->number;
        t->at = row->used_at;
        task_start(&t->task);
    }
}

static void end_connections(struct web *web)
{
    struct web_access *access = &web->access;

    for (size_t i = 0; i < access->ended_count; i++) {
        if (web->http)
            http_end_token(web->http, access->ended[i].token, access->ended[i].cookies);
        web_calls_end_token(web->calls, access->ended[i].token);
    }
    access->ended_count = 0;
}

void access_ended(struct web *web, uint64_t token, int cookies)
{
    struct web_access *access = &web->access;

    /* So many at once: they were asked for one by one, and the earlier ones' answers are on their way. */
    if (access->ended_count == WEB_ENDED_MAX)
        end_connections(web);
    access->ended[access->ended_count].token = token;
    access->ended[access->ended_count++].cookies = cookies;
}

void access_tick(struct web *web, uint64_t now_ns)
{
    end_connections(web);
    if (now_ns - web->access.ticked_ns < NS_PER_SECOND)
        return;
    web->access.ticked_ns = now_ns;
    web_tokens_tick(web->tokens, clock_wall_s());
    if (web->server->state == SERVER_LISTENING)
        store_uses(web);
}
