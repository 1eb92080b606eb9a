/* channel_local: a channel without a socket, for a peer in the same process.
 *
 * Its owner uses it as any other (channel.h): it is open from the start, sends, asks what is queued, closes.
 * What the owner sends goes to the sink of the other side while channel_send runs; what the other side says
 * comes in through channel_local_message.
 *
 *   channel_local --> OPEN --channel_close, channel_abort, by either side--> DEAD --> on_close, on_closed, freed
 *
 * The peer is never silent: channel_last_heard_ns and channel_last_sent_ns are always now. All on the thread of
 * the loop.
 */
#ifndef AZULEJO_PROTOCOL_CHANNEL_LOCAL_H
#define AZULEJO_PROTOCOL_CHANNEL_LOCAL_H

#include "protocol/channel.h"

/* The other side. */
struct channel_sink {
    /* The owner sends this. The envelope is the owner's: it is gone when this returns, so it is written out or
     * copied now. Nothing of the channel but channel_close and channel_abort may be called. */
    void (*on_send)(void *user, const Azulejo__Wire__Envelope *message);
    /* Bytes that it was given and has not passed on yet: above CHANNEL_QUEUE_HIGH the owner stops producing. */
    size_t (*queued_bytes)(void *user);
    /* Once, and last: after the owner's on_close, before the channel is freed. Never from within channel_close. */
    void (*on_closed)(void *user, const struct error *why);
};

/* Open at once; on_open is not called. The sink must stay; `peer` is copied, for people ("the API, token 3").
 * ERR_NO_MEMORY. */
status channel_local(struct channel **out, uv_loop_t *loop, const struct channel_sink *sink, void *sink_user,
                     enum farm_role role, const char *peer, const struct channel_callbacks *callbacks, void *user,
                     struct error *err) MUST_CHECK;

/* The other side says something: the owner's on_message runs now. Nothing happens once the channel is closing. */
void channel_local_message(struct channel *c, const Azulejo__Wire__Envelope *message);

/* The sink has passed on some of what it was given: runs the owner's on_drain. */
void channel_local_drained(struct channel *c);

#endif
