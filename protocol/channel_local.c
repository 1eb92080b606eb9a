#include "protocol/channel_local.h"

#include <stdio.h>

#include "common/base/memory.h"
#include "protocol/channel_parts.h"

status channel_local(struct channel **out, uv_loop_t *loop, const struct channel_sink *sink, void *sink_user,
                     enum farm_role role, const char *peer, const struct channel_callbacks *callbacks, void *user,
                     struct error *err)
{
    struct channel *c = channel_new(loop, callbacks, user);

    *out = c;
    if (!c)
        return error_no_memory(err, "a channel");
    c->sink = sink;
    c->sink_user = sink_user;
    c->role = role;
    c->is_server = 1;
    snprintf(c->peer, sizeof c->peer, "%s", peer);
    /* Its close callback makes on_close come later, as that of a socket does. */
    uv_timer_init(loop, &c->timer);
    c->timer.data = c;
    c->holds = 1;
    c->state = OPEN;
    return STATUS_OK;
}

void channel_local_message(struct channel *c, const Azulejo__Wire__Envelope *message)
{
    if (c->state == OPEN)
        c->callbacks.on_message(c, message, c->user);
}

void channel_local_drained(struct channel *c)
{
    if (c->state == OPEN && c->callbacks.on_drain)
        c->callbacks.on_drain(c, c->user);
}
