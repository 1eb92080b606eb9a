#include "coordinator/page/token_end.h"

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/task.h"
#include "coordinator/page/page.h"
#include "coordinator/page/tokens.h"

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

static const struct task_kind use_kind = {"the use of a token", sizeof(struct use_task), use_run, use_end, NULL, 1};

static void store_uses(struct page *page)
{
    const struct token_row *row;

    while ((row = web_tokens_next_used(page->tokens))) {
        struct use_task *t = task_new(page->server, &use_kind, NULL);
        if (!t)
            return;
        t->token = row->number;
        t->at = row->used_at;
        task_start(&t->task);
    }
}

void token_end_tick(struct page *page, uint64_t now_ns)
{
    if (now_ns - page->tokens_ticked_ns < NS_PER_SECOND)
        return;
    page->tokens_ticked_ns = now_ns;
    web_tokens_tick(page->tokens, clock_wall_s());
    if (page->server->state == SERVER_LISTENING)
        store_uses(page);
}
