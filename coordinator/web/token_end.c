#include "coordinator/web/token_end.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "coordinator/net/server.h"
#include "coordinator/net/task.h"
#include "coordinator/web/call.h"
#include "coordinator/web/http.h"
#include "coordinator/web/tokens.h"
#include "coordinator/web/web.h"

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
    struct token_ends *ends = &web->token_ends;

    for (size_t i = 0; i < ends->ended_count; i++) {
        if (web->http)
            http_end_token(web->http, ends->ended[i].token, ends->ended[i].cookies);
        web_calls_end_token(web->calls, ends->ended[i].token);
    }
    ends->ended_count = 0;
}

void token_end(struct web *web, uint64_t token, int cookies)
{
    struct token_ends *ends = &web->token_ends;

    /* So many at once: they were asked for one by one, and the earlier ones' answers are on their way. */
    if (ends->ended_count == TOKEN_ENDS_MAX)
        end_connections(web);
    ends->ended[ends->ended_count].token = token;
    ends->ended[ends->ended_count++].cookies = cookies;
}

void token_end_tick(struct web *web, uint64_t now_ns)
{
    end_connections(web);
    if (now_ns - web->token_ends.ticked_ns < NS_PER_SECOND)
        return;
    web->token_ends.ticked_ns = now_ns;
    web_tokens_tick(web->tokens, clock_wall_s());
    if (web->server->state == SERVER_LISTENING)
        store_uses(web);
}
