#include "coordinator/page/watching.h"

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/page/watch_parts.h"

status watching_new(struct watching **out, struct server *server, struct error *err)
{
    struct watching *all = mem_calloc(1, sizeof *all);

    *out = all;
    NEED(all, err, "the live picture");
    all->server = server;
    uv_timer_init(&server->loop, &all->timer);
    all->timer.data = all;
    return STATUS_OK;
}

/* ---- watchers -------------------------------------------------------------------------------- */

static void client_free(struct watcher *client)
{
    watch_end(client);
    if (client->next)
        client->next->previous = client->previous;
    *(client->previous ? &client->previous->next : &client->all->clients) = client->next;
    mem_free(client);
}

void watching_stop(struct watching *all)
{
    if (!all || all->is_stopped)
        return;
    all->is_stopped = 1;
    while (all->clients)
        client_free(all->clients);
    uv_close((uv_handle_t *)&all->timer, NULL);
}

void watching_free(struct watching *all)
{
    if (!all)
        return;
    while (all->clients)
        client_free(all->clients);
    mem_free(all->cache);
    mem_free(all);
}

static struct watcher *find(struct watching *all, const struct session *session)
{
    struct watcher *client = all->clients;

    while (client && client->session != session)
        client = client->next;
    return client;
}

static struct watcher *client_new(struct watching *all, struct session *session)
{
    struct watcher *client = mem_calloc(1, sizeof *client);

    if (!client)
        return NULL;
    *client = (struct watcher){.all = all, .session = session, .next = all->clients};
    if (all->clients)
        all->clients->previous = client;
    all->clients = client;
    return client;
}

void watching_session_gone(struct watching *all, const struct session *session)
{
    struct watcher *client = find(all, session);

    if (client)
        client_free(client);
}

static void take(struct watcher *client, uint64_t bytes)
{
    client->unread -= bytes < client->unread ? bytes : client->unread;
    if (client->watch.state != WATCH_NONE)
        watching_wake(client->all, client->watch.in_turn || client->watch.state == WATCH_STORED);
}

status watching_message(struct watching *all, struct session *session, const Azulejo__Wire__Envelope *message,
                        struct error *err)
{
    struct watcher *client = find(all, session);
    const Azulejo__Wire__TilesWatch *wanted;

    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES_TAKEN) {
        if (client)
            take(client, message->tiles_taken->bytes);
        return STATUS_OK;
    }
    wanted = message->tiles_watch;
    if (!client)
        client = client_new(all, session);
    NEED(client, err, "the live picture");
    watch_end(client);
    if (wanted->job)
        watch_begin(client, message->request, wanted->job, wanted->frame, wanted->layer);
    return STATUS_OK;
}

/* ---- the clock ------------------------------------------------------------------------------- */

/* What may be spent on tiles that clients saw before, for this much time. */
static int64_t share_of(const struct watching *all, uint64_t passed_ns)
{
    uint64_t threads = all->server->farm.workforce.proven_threads, most_ns = passed_ns / TILES_SHARE_CORE;
    uint64_t share_ns = threads < TILES_SHARE / TILES_SHARE_CORE ? passed_ns / TILES_SHARE * (threads + !threads) : most_ns;

    return (int64_t)(share_ns < most_ns ? share_ns : most_ns);
}

static void on_timer(uv_timer_t *timer)
{
    struct watching *all = timer->data;
    uint64_t begin_ns = clock_monotonic_ns();
    int begins_turn = begin_ns - all->turn_ns >= TILES_TURN_MS * NS_PER_MS, more = 1, any = 0;

    all->timer_runs = 0;
    if (begins_turn) {
        all->share_ns += share_of(all, begin_ns - all->turn_ns);
        if (all->share_ns > TILES_SHARE_MAX_NS)
            all->share_ns = TILES_SHARE_MAX_NS;
        all->turn_ns = begin_ns;
        for (struct watcher *c = all->clients; c; c = c->next)
            if (c->watch.state != WATCH_NONE)
                watch_follow(c, begin_ns);
    }
    while (more && clock_monotonic_ns() - begin_ns < TILES_TURN_NS) {
        more = 0;
        for (struct watcher *c = all->clients; c; c = c->next)
            if (c->watch.state != WATCH_NONE)
                more |= watch_slice(c, begin_ns, begins_turn);
        begins_turn = 0;
    }
    for (struct watcher *c = all->clients; c; c = c->next) {
        watch_flush(c);
        any |= c->watch.state != WATCH_NONE;
    }
    if (any)
        watching_wake(all, more);
}

void watching_wake(struct watching *all, int at_once)
{
    uint64_t now_ns = clock_monotonic_ns(), next_ns = all->turn_ns + TILES_TURN_MS * NS_PER_MS;
    uint64_t wait_ms = at_once || now_ns >= next_ns ? TILES_AGAIN_MS : (next_ns - now_ns) / NS_PER_MS + 1;
    int kind = at_once ? 2 : 1;

    if (all->is_stopped || all->timer_runs >= kind)
        return;
    all->timer_runs = kind;
    /* The loop's clock is that of its last turn. */
    uv_update_time(&all->server->loop);
    uv_timer_start(&all->timer, on_timer, wait_ms, 0);
}
