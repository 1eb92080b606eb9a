/* The internals of a channel, for channel*.c only. */
#pragma once

#include "common/base/buffer.h"
#include "protocol/channel.h"
#include "protocol/framing.h"
#include "protocol/tls.h"

enum { PEER_NAME_MAX = 320 };

/* In the order of the diagram in channel.h. A server has `tls` from HANDSHAKE on. */
enum channel_state { CONNECTING, ARRIVED, READY, HANDSHAKE, OPEN, CLOSING, DEAD };

struct channel {
    uv_loop_t *loop;
    uv_tcp_t tcp;
    uv_timer_t timer; /* first record, handshake, then flushing and lingering */
    uv_getaddrinfo_t resolve;
    uv_connect_t connect;
    uv_shutdown_t shutdown;
    int holds; /* handles and requests whose callbacks are still to come */
    struct addrinfo *addresses, *next_address;
    uint64_t connect_deadline_ns;

    enum channel_state state;
    uint32_t limit_ms;               /* what the running timer was set to, before OPEN */
    uint64_t limit_end_ms;           /* when it fires, by uv_now */
    const struct farm_key *key;      /* server, until HANDSHAKE: owned by the owner */
    const struct channel_gate *gate; /* server; NULL: none */
    struct buffer first;             /* server, until HANDSHAKE: the first record as received so far */
    struct tls *tls;
    struct framing_reader frames;
    struct buffer outgoing; /* packed by channel_send, not yet given to TLS */
    int is_corked;
    size_t queued_bytes, queue_high;
    uint64_t turn;     /* in which it read last, */
    size_t turn_bytes; /* and what it may still read in it */
    int was_high;      /* above queue_high since the last on_drain */
    int is_server, shutdown_done, peer_ended, is_paused;
    struct key_identity identity; /* that was proved */
    uint64_t last_heard_ns, last_sent_ns;
    struct error why;
    struct channel_callbacks callbacks;
    void *user;
    char peer[PEER_NAME_MAX];
};

/* NULL: out of memory. Nothing is registered with the loop before channel_start_handles, so until
 * then channel_free releases it. */
struct channel *channel_new(uv_loop_t *loop, const struct channel_callbacks *callbacks, void *user);
void channel_free(struct channel *c);
void channel_start_handles(struct channel *c);
void channel_hold_drop(struct channel *c);

/* The time that a peer has until the next step; a test's limit, if set, overrides it. */
void channel_limit(struct channel *c, uint32_t limit_ms);
uint32_t channel_limit_ms(uint32_t limit_ms);

void channel_read_start(struct channel *c);
/* For a connected socket and a TLS object: start the handshake. */
void channel_begin_handshake(struct channel *c);
void channel_end_now(struct channel *c, status code, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* channel_accept.c: bytes that arrived before the handshake. */
void channel_take_first(struct channel *c, const void *data, size_t size_bytes);
