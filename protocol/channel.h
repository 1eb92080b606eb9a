/* channel: one encrypted, framed conversation over one libuv TCP stream.
 *
 * TLS 1.3 with an external PSK over OpenSSL memory BIOs; frames of a little-endian uint32 length and one Envelope.
 * Ownership: the owner holds the channel from channel_connect or channel_accept until on_close has run, which happens
 * exactly once and last; the channel is freed right after on_close returns. on_message's envelope lives until it
 * returns. A channel_send never calls back into the owner before it returns.
 *
 *   client: CONNECTING --tcp--> HANDSHAKE
 *           connect_next        on_connected
 *   server: ARRIVED --first TLS record whole--> READY --the owner's channel_handshake--> HANDSHAKE
 *           channel_accept                      channel_take_first
 *   HANDSHAKE --tls--> OPEN --channel_close--> CLOSING --> DEAD --> freed
 *                      handshake_step          close_gently finish
 *   Any state --channel_abort, reset, time-out--> DEAD; a refused handshake or a broken
 *   message goes through CLOSING, so that the peer learns why.
 *
 * A server's channel has CHANNEL_SILENT_MS for its first byte, CHANNEL_HANDSHAKE_MS from there to the complete first
 * record, no limit while it is READY, and CHANNEL_HANDSHAKE_MS again in HANDSHAKE. Until HANDSHAKE it takes about 3 KB
 * and no OpenSSL object. A connection that does not begin like TLS is closed without an answer.
 *
 * CLOSING flushes, ends TLS and TCP, and keeps reading (without delivering) until the peer has ended too or
 * CHANNEL_LINGER_MS has passed: closing a socket that holds unread bytes would reset the connection and destroy what
 * was just flushed.
 *
 * The first channel of a process sets SIGPIPE to be ignored, unless it is handled.
 *
 * TCP_NODELAY is set; one message is one write, except between channel_cork and channel_uncork. The owner checks
 * channel_is_full() and stops producing at CHANNEL_QUEUE_HIGH; on_drain reports that it fell below CHANNEL_QUEUE_LOW.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/key.h"

enum {
    PROTOCOL_VERSION = 5,
    PROTOCOL_PORT_DEFAULT = 7420,
    CHANNEL_FRAME_MAX = 4 << 20,      /* bytes of one Envelope; more ends the connection */
    CHANNEL_QUEUE_HIGH = 8 << 20,
    CHANNEL_QUEUE_LOW = 1 << 20,
    CHANNEL_QUEUE_MAX = 256 << 20,    /* a peer that does not read: more ends the connection */
    CHANNEL_FIRST_MAX = 4 << 10,      /* bytes read from a peer before its handshake */
    CHANNEL_SILENT_MS = 10000,        /* server: from TCP to the first byte */
    CHANNEL_HANDSHAKE_MS = 5000,      /* server: first byte to first record; then the handshake */
    CHANNEL_CONNECT_MS = 10000,       /* client: TCP, over all of a host's addresses */
    CHANNEL_PATIENCE_MS = 30000,      /* client: TLS, with the wait for the server's attention */
    CHANNEL_ADDRESS_MS = 3000,        /* one of several addresses of a host */
    CHANNEL_FLUSH_MS = 10000,         /* closing: the peer reads nothing for this long */
    CHANNEL_LINGER_MS = 2000,         /* closing: the peer's own end after ours */
    CHANNEL_ADDRESS_BYTES = 16,       /* IPv6; IPv4 as ::ffff:a.b.c.d */
    BLOB_PIECE_BYTES = 256 << 10,
    CHANNEL_CORK_BYTES = 256 << 10,   /* corked: so many go out at a time */
};

struct channel;

struct channel_callbacks {
    void (*on_open)(struct channel *c, void *user);
    void (*on_message)(struct channel *c, const Azulejo__Wire__Envelope *message, void *user);
    void (*on_drain)(struct channel *c, void *user);
    /* Exactly once. `why->code` is STATUS_OK after an orderly end by either side, ERR_UNREACHABLE
     * if an open connection was lost, ERR_PROTOCOL if the peer broke the rules, ERR_REFUSED or
     * ERR_TIMEOUT after a failed handshake. The text names the peer. */
    void (*on_close)(struct channel *c, const struct error *why, void *user);
};

/* How the owner of accepted channels decides the order of handshakes. */
struct channel_gate {
    /* READY: the owner calls channel_handshake, now or later. */
    void (*on_ready)(struct channel *c, void *user);
    /* The handshake failed; the channel is CLOSING. Not called if it is DEAD at once. */
    void (*on_refused)(struct channel *c, void *user);
};

/* Connect to host:port with the key of a role. Later failures are reported by on_close:
 * ERR_UNREACHABLE (no such host, refused, timeout), ERR_REFUSED (the key was not accepted). */
status channel_connect(struct channel **out, uv_loop_t *loop, const char *host, uint16_t port,
                       const struct farm_key *key, enum farm_role role, const struct channel_callbacks *callbacks,
                       void *user, struct error *err) MUST_CHECK;

/* Accept from a listening stream (in its connection callback). The key is not copied and must
 * outlive the handshake. Without a gate the handshake begins as soon as possible. The peer's role
 * is known when on_open runs (channel_role). ERR_NO_MEMORY: the connection was dropped. */
status channel_accept(struct channel **out, uv_stream_t *listener, const struct farm_key *key,
                      const struct channel_callbacks *callbacks, const struct channel_gate *gate, void *user,
                      struct error *err) MUST_CHECK;

/* Take a connection off the listener and drop it, if there is no memory for more: libuv accepts no other one before. */
void channel_reject(uv_stream_t *listener);

/* Begin the handshake of a READY channel; otherwise does nothing. May call back before it returns. */
void channel_handshake(struct channel *c);

/* Pack and queue. ERR_LIMIT: the message is larger than a frame may be, or the queue is over its maximum (the channel
 * then closes by itself). Before on_open and after channel_close: ERR_IO. */
status channel_send(struct channel *c, const Azulejo__Wire__Envelope *message) MUST_CHECK;

/* What is sent from here on goes out together: with channel_uncork, which the same callback calls, in full TLS records
 * and one write for each CHANNEL_CORK_BYTES. */
void channel_cork(struct channel *c);
void channel_uncork(struct channel *c);

/* Say goodbye: flush what is queued, end TLS, close; on_close follows with STATUS_OK. No
 * on_message follows. Closing twice is fine.
 * channel_abort does not flush and on_close gets `why`. Both may be called from callbacks. */
void channel_close(struct channel *c);
void channel_abort(struct channel *c, status code, const char *format, ...) __attribute__((format(printf, 3, 4)));

size_t channel_queued_bytes(const struct channel *c);
/* Is so much queued that the owner should stop producing until on_drain? */
int channel_is_full(const struct channel *c);
/* Twice as much as makes it full: the peer asks for more than it reads. on_drain follows. */
int channel_is_overfull(const struct channel *c);
/* From `bytes` on, instead of CHANNEL_QUEUE_HIGH; on_drain comes at an eighth of it. For channels of which there are many. */
void channel_set_high(struct channel *c, size_t bytes);
enum farm_role channel_role(const struct channel *c);
/* Whose key it was made with; of role NONE before on_open. */
const struct key_identity *channel_identity(const struct channel *c);
const char *channel_peer(const struct channel *c);       /* "127.0.0.1:40312" */
uint64_t channel_last_heard_ns(const struct channel *c); /* monotonic: last byte received */
uint64_t channel_last_sent_ns(const struct channel *c);
/* The peer's address, for comparing; zeros when it is not known. */
void channel_address(const struct channel *c, uint8_t out[CHANNEL_ADDRESS_BYTES]);
/* A new owner: its callbacks are called from now on. */
void channel_adopt(struct channel *c, const struct channel_callbacks *callbacks, void *user);

/* Deliver and read no more until asked to: what the peer sends waits here and in its and our sockets, and the peer is not
 * silent. */
void channel_pause(struct channel *c, int paused);
/* A turn of this thread's loop begins: until the next one, each of its channels reads at most so many bytes,
 * and leaves what else arrives in its socket. So peers that send without end cannot keep the loop from its
 * other work, nor from each other. (A limit for all together would starve those that the kernel names last.)
 * Call it once in each iteration; without any call there is no limit. 0 ends it. */
void channel_turn_begin(size_t bytes_each);
/* Tests: this limit instead of each of the four above, for what begins from now on; 0: as above. */
void channel_fault_handshake_ms(uint32_t limit_ms);
