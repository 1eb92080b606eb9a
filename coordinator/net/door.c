#include "coordinator/net/door.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/schema/token_ceilings.h"
#include "coordinator/store/files/reserve.h"
#include "coordinator/net/server.h"
#include "protocol/message.h"

struct visitor {
    struct admission_place place; /* first: a place is cast to its visitor */
    struct visitor *next, *previous;
    struct door *door;
    struct channel *channel;
};

static void visitor_remove(struct visitor *visitor)
{
    struct door *door = visitor->door;

    admission_leave(&door->admission, &visitor->place);
    *(visitor->previous ? &visitor->previous->next : &door->visitors) = visitor->next;
    if (visitor->next)
        visitor->next->previous = visitor->previous;
    mem_free(visitor);
}

/* One line a minute for each address and kind of message. */
static void complain(struct door *door, const char *peer, status code, const char *text)
{
    char subject[LOG_LIMIT_SUBJECT_SIZE], more[80] = "";
    const char *port = strrchr(peer, ':');
    uint64_t left_out;

    snprintf(subject, sizeof subject, "%d %.*s", (int)code, port ? (int)(port - peer) : (int)strlen(peer), peer);
    if (!log_limit_pass(&door->complaints, subject, clock_monotonic_ns(), &left_out)) {
        log_debug("a connection ended before its greeting: %s", text);
        return;
    }
    if (left_out > 0)
        snprintf(more, sizeof more, " (and %llu like it since the last such line)", (unsigned long long)left_out);
    log_warn("a connection ended before its greeting: %s%s", text, more);
}

/* ---- handshakes ----------------------------------------------------------------------------- */

/* Runs once in each iteration of the loop. Failed handshakes free their slot at once, and dropped
 * connections their place, so without bounds a flood would keep the loop in one iteration. */
static void on_turn(uv_idle_t *turn)
{
    struct door *door = turn->data;
    const unsigned waiting = door->waiting_count;

    door->accepted = 0;
    door->waiting_count = 0;
    for (unsigned i = 0; i < waiting; i++)
        if (!uv_is_closing((uv_handle_t *)door->waiting[i]))
            door_connection(door, door->waiting[i], 0);
    for (int i = 0; i < DOOR_HANDSHAKES_PER_TURN; i++) {
        struct admission_place *place = admission_next(&door->admission);
        if (!place) {
            if (door->accepted == 0)
                uv_idle_stop(turn);
            return;
        }
        channel_handshake(((struct visitor *)place)->channel);
    }
}

static void wake(struct door *door)
{
    if ((door->admission.ready > 0 || door->accepted > 0) && !uv_is_closing((uv_handle_t *)&door->turn))
        uv_idle_start(&door->turn, on_turn);
}

static void on_ready(struct channel *channel UNUSED, void *user)
{
    struct visitor *visitor = user;

    admission_ready(&visitor->door->admission, &visitor->place);
    wake(visitor->door);
}

static void on_refused(struct channel *channel UNUSED, void *user)
{
    struct visitor *visitor = user;

    admission_refused(&visitor->door->admission, &visitor->place);
    wake(visitor->door);
}

/* ---- through, or gone ----------------------------------------------------------------------- */

/* The peer has a key, so it is sent the reason. */
static void turn_away(struct visitor *visitor, const struct error *why)
{
    complain(visitor->door, channel_peer(visitor->channel), why->code, why->text);
    admission_refused(&visitor->door->admission, &visitor->place);
    if (message_send_failure(visitor->channel, 0, why) != STATUS_OK)
        log_debug("%s could not be sent the reason", channel_peer(visitor->channel));
    channel_close(visitor->channel);
}

/* Sessions of workers and clients. */
static uint32_t people_count(const struct server *server) { return server->session_count - server->page_session_count; }

/* Are there as many sessions as there may be? The page's program has descriptors of its own. */
static status check_all(const struct server *server, const struct channel *channel, struct error *err)
{
    if (channel_role(channel) == FARM_ROLE_WEB ? server->page_session_count < server->descriptors.guests_max
                                               : people_count(server) < server->descriptors.sessions_max)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "the coordinator has %u sessions, and its file descriptors allow no more: raise its "
                     "hard limit (ulimit -Hn, LimitNOFILE=), or try again later",
                     server->session_count);
}

/* One address may not have all of them. They are counted only when there are enough of them; those of the page's program,
 * which has limits of its own, are not. */
static status check_address(const struct server *server, const struct channel *channel, struct error *err)
{
    uint32_t most = descriptors_of_address(server->descriptors.sessions_max, server->descriptors.address_max), count = 0;
    uint8_t address[CHANNEL_ADDRESS_BYTES], other[CHANNEL_ADDRESS_BYTES];

    if (people_count(server) < most)
        return STATUS_OK;
    channel_address(channel, address);
    for (const struct session *s = server->sessions; s; s = s->next) {
        if (!s->channel || s->of_page)
            continue;
        channel_address(s->channel, other);
        count += memcmp(address, other, sizeof other) == 0;
    }
    if (count < most)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "your address has %u sessions with the coordinator, and it takes no more from one address: end some, or "
                     "raise its limit (--connections-per-address, or its file descriptors)", count);
}

/* Nor may one name's key, whether its programs say Hello or not. */
static status check_key(const struct server *server, const struct channel *channel, struct error *err)
{
    const struct key_identity *id = channel_identity(channel);
    const uint64_t key = holder_of_key(id->name);
    uint32_t most = server->descriptors.sessions_max / 2, count = 0;

    if (id->role != FARM_ROLE_WORKER && token_ceiling_of(id->may).connections < most)
        most = token_ceiling_of(id->may).connections;
    if (!key || people_count(server) < most)
        return STATUS_OK;
    for (const struct session *s = server->sessions; s; s = s->next)
        count += s->key == key && s->role == id->role && s->state != SESSION_ENDING;
    if (count < most)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT, "the key of %s has %u connections, as many as its role may have: end some of its programs",
                     id->name, count);
}

static void on_open(struct channel *channel, void *user)
{
    struct visitor *visitor = user;
    struct door *door = visitor->door;
    struct error err = {0};
    status s = STATUS_OK;

    if (channel_role(channel) != FARM_ROLE_WEB) {
        s = check_address(door->server, channel, &err);
        THEN(s, check_key(door->server, channel, &err));
    }
    THEN(s, check_all(door->server, channel, &err));
    if (s != STATUS_OK) {
        turn_away(visitor, &err);
    } else if (session_begin(door->server, channel, &err) != STATUS_OK) {
        channel_abort(channel, err.code, "%s", err.text);
    } else {
        visitor_remove(visitor);
    }
    wake(door);
}

static void on_close(struct channel *channel, const struct error *why, void *user)
{
    struct visitor *visitor = user;
    struct door *door = visitor->door;

    /* Probes and port scanners connect and close; that is not an error. */
    if (why->code == STATUS_ERR_UNREACHABLE)
        log_debug("a connection ended before its greeting: %s", why->text);
    else if (why->code != STATUS_OK)
        complain(door, channel_peer(channel), why->code, why->text);
    visitor_remove(visitor);
    wake(door);
}

/* ---- arriving ------------------------------------------------------------------------------- */

static void enter(struct door *door, struct visitor *visitor)
{
    uint8_t address[CHANNEL_ADDRESS_BYTES];
    struct admission_place *out;
    struct error err = {0};

    /* The plan counts connections. If other files took its descriptors, or the limit was lowered, a
     * newcomer takes another connection's place. */
    door->admission.places_max = reserve_is_short()
                                     ? (door->admission.places > 1 ? door->admission.places : 1)
                                     : descriptors_strangers(&door->server->descriptors, door->server->session_count);
    channel_address(visitor->channel, address);
    if (admission_enter(&door->admission, &visitor->place, address, &out, &err) != STATUS_OK)
        channel_abort(visitor->channel, err.code, "%s", err.text);
    else if (out)
        channel_abort(((struct visitor *)out)->channel, STATUS_ERR_LIMIT,
                      "it makes room: %u connections wait to prove a key", door->admission.places);
}

void door_connection(struct door *door, uv_stream_t *listener, int uv_error)
{
    static const struct channel_callbacks callbacks = {on_open, NULL, NULL, on_close};
    static const struct channel_gate gate = {on_ready, on_refused};
    struct visitor *visitor;
    struct error err = {0};
    status s;

    if (uv_error < 0) {
        complain(door, "", STATUS_ERR_IO, uv_strerror(uv_error));
        return;
    }
    if (door->accepted == DOOR_ACCEPTS_PER_TURN) {
        door->waiting[door->waiting_count++] = listener; /* libuv accepts no other of it before this one is taken */
        return;
    }
    door->accepted++;
    wake(door);
    visitor = mem_calloc(1, sizeof *visitor);
    if (!visitor) {
        channel_reject(listener);
        s = error_no_memory(&err, "a connection");
    } else {
        visitor->door = door;
        s = channel_accept(&visitor->channel, listener, door->server->key, &callbacks, &gate, visitor, &err);
    }
    if (s != STATUS_OK) {
        mem_free(visitor);
        complain(door, "", s, err.text);
        return;
    }
    visitor->next = door->visitors;
    if (door->visitors)
        door->visitors->previous = visitor;
    door->visitors = visitor;
    enter(door, visitor);
}

/* ---- life ----------------------------------------------------------------------------------- */

void door_init(struct door *door, struct server *server)
{
    door->server = server;
    admission_init(&door->admission, STRANGERS_MIN);
    uv_idle_init(&server->loop, &door->turn);
    door->turn.data = door;
}

void door_close(struct door *door)
{
    for (struct visitor *v = door->visitors; v; v = v->next)
        channel_abort(v->channel, STATUS_OK, "the coordinator ends");
    uv_close((uv_handle_t *)&door->turn, NULL);
}
