#include "web/base/link.h"

#include <string.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

struct link_peer {
    struct link_peer *next;
    struct link_peers *all;
    struct channel *channel;
    const struct link_callbacks *callbacks;
    void *user;
    uint64_t token;
    int is_open, is_ending, is_paused;
    uint64_t heartbeat_ns, silence_ns;
    struct buffer kept; /* messages for when it is open: a length of 4 bytes, then the message */
    struct error why;   /* the coordinator's last word */
};

/* ---- the greeting ------------------------------------------------------------------------------ */

static void on_open(struct channel *channel, void *user)
{
    const struct link_peer *peer = user;
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(HELLO, hello, &hello);
    char host[256] = "";

    (void)gethostname(host, sizeof host - 1);
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = AZULEJO__WIRE__ROLE__ROLE_WEB;
    hello.software = (char *)"azulejo " AZULEJO_VERSION;
    hello.host = host;
    hello.process = (uint32_t)getpid();
    hello.token = peer->token;
    if (channel_send(channel, &envelope) != STATUS_OK)
        channel_abort(channel, STATUS_ERR_IO, "no greeting was sent");
}

static void send_kept(struct link_peer *peer)
{
    for (size_t at = 0; at < peer->kept.size && !peer->is_ending;) {
        uint32_t size;
        Azulejo__Wire__Envelope *message;
        memcpy(&size, peer->kept.data + at, sizeof size);
        at += sizeof size;
        message = azulejo__wire__envelope__unpack(NULL, size, peer->kept.data + at);
        at += size;
        if (!message || channel_send(peer->channel, message) != STATUS_OK)
            link_abort(peer, STATUS_ERR_NO_MEMORY, "out of memory for a message");
        if (message)
            azulejo__wire__envelope__free_unpacked(message, NULL);
    }
    buffer_release(&peer->kept);
}

static void take_welcome(struct link_peer *peer, const Azulejo__Wire__Welcome *welcome)
{
    struct error err = {0};

    if (welcome_check(welcome, &err) != STATUS_OK) {
        link_abort(peer, err.code, err.text);
        return;
    }
    peer->heartbeat_ns = welcome->heartbeat_ms / 2 * NS_PER_MS; /* twice as often, so that a delay does no harm */
    peer->silence_ns = welcome->silence_limit_ms * NS_PER_MS;
    peer->is_open = 1;
    send_kept(peer);
    if (!peer->is_ending && peer->callbacks->on_drain)
        peer->callbacks->on_drain(peer->user);
}

/* ---- the channel ------------------------------------------------------------------------------- */

static void on_message(struct channel *channel UNUSED, const Azulejo__Wire__Envelope *message, void *user)
{
    struct link_peer *peer = user;

    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_WELCOME)
        take_welcome(peer, message->welcome);
    else if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE && !message->request)
        (void)!message_failure_get(message->failure, &peer->why);
    else if (message->body_case != AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT && !peer->is_ending)
        peer->callbacks->on_message(peer->user, message);
}

static void on_drain(struct channel *channel UNUSED, void *user)
{
    const struct link_peer *peer = user;

    if (peer->callbacks->on_drain)
        peer->callbacks->on_drain(peer->user);
}

static void on_close(struct channel *channel UNUSED, const struct error *why, void *user)
{
    struct link_peer *peer = user, **at = &peer->all->first;

    peer->is_ending = 1;
    while (*at != peer)
        at = &(*at)->next;
    *at = peer->next;
    peer->callbacks->on_end(peer->user, peer->why.code != STATUS_OK ? &peer->why : why);
    buffer_release(&peer->kept);
    mem_free(peer);
}

status link_open(struct link_peer **out, struct link_peers *all, uint64_t token, const struct link_callbacks *callbacks,
                 void *user, struct error *err)
{
    static const struct channel_callbacks own = {on_open, on_message, on_drain, on_close};
    struct link_peer *peer = mem_calloc(1, sizeof *peer);
    status s;

    *out = NULL;
    NEED(peer, err, "a connection");
    peer->all = all;
    peer->callbacks = callbacks;
    peer->user = user;
    peer->token = token;
    buffer_init(&peer->kept);
    s = channel_connect(&peer->channel, all->loop, all->host, all->port, &all->key, FARM_ROLE_WEB, &own, peer, err);
    if (s != STATUS_OK) {
        mem_free(peer);
        return s;
    }
    channel_set_high(peer->channel, LINK_QUEUE_BYTES);
    peer->next = all->first;
    all->first = peer;
    *out = peer;
    return STATUS_OK;
}

/* ---- what its owner does ------------------------------------------------------------------------ */

static status keep(struct link_peer *peer, const Azulejo__Wire__Envelope *message, struct error *err)
{
    uint32_t size = (uint32_t)azulejo__wire__envelope__get_packed_size(message);
    uint8_t *space;

    if (peer->kept.size + size > LINK_KEPT_BYTES)
        return error_set(err, STATUS_ERR_LIMIT, "the coordinator has not answered yet; try again in a moment");
    buffer_append(&peer->kept, &size, sizeof size);
    space = buffer_append_space(&peer->kept, size);
    NEED(space, err, "a message");
    azulejo__wire__envelope__pack(message, space);
    return STATUS_OK;
}

status link_send(struct link_peer *peer, const Azulejo__Wire__Envelope *message, struct error *err)
{
    status s;

    if (peer->is_ending)
        return error_set(err, STATUS_ERR_IO, "the connection to the coordinator is ending; try again in a moment");
    if (!peer->is_open)
        return keep(peer, message, err);
    s = channel_send(peer->channel, message);
    return s == STATUS_OK ? s : error_set(err, s, "the message cannot be sent: %s", status_text(s));
}

int link_is_full(const struct link_peer *peer)
{
    return !peer->is_ending && (peer->is_open ? channel_is_full(peer->channel) : peer->kept.size > 0);
}

void link_pause(struct link_peer *peer, int paused)
{
    if (peer->is_ending || !peer->is_open)
        return;
    peer->is_paused = paused;
    channel_pause(peer->channel, paused);
}

void link_close(struct link_peer *peer)
{
    if (peer->is_ending)
        return;
    peer->is_ending = 1;
    channel_close(peer->channel);
}

void link_abort(struct link_peer *peer, status code, const char *text)
{
    if (peer->is_ending)
        return;
    peer->is_ending = 1;
    channel_abort(peer->channel, code, "%s", text);
}

void link_tick(struct link_peers *all, uint64_t now_ns)
{
    for (struct link_peer *p = all->first, *next; p; p = next) {
        next = p->next;
        if (!p->is_open || p->is_ending)
            continue;
        if (now_ns > channel_last_heard_ns(p->channel) + p->silence_ns)
            link_abort(p, STATUS_ERR_TIMEOUT, "the coordinator is silent");
        else if (now_ns > channel_last_sent_ns(p->channel) + p->heartbeat_ns &&
                 message_send_heartbeat(p->channel) != STATUS_OK)
            link_abort(p, STATUS_ERR_IO, "the coordinator takes nothing");
    }
}

void link_close_all(struct link_peers *all)
{
    for (struct link_peer *p = all->first, *next; p; p = next) {
        next = p->next;
        link_abort(p, STATUS_OK, "");
    }
}
