/* events: what changed on the farm, numbered, for all that listen: each event's JSON is made once.
 *
 *   made --> kept: the newest EVENTS_KEPT, in at most EVENTS_BYTES --> forgotten
 *
 * A listener is only the number of the last event that it got: a slow one is not waited for and has no queue
 * of its own. When what it would get next is forgotten it must load everything again (`reset`), and goes on from
 * the newest event. Numbers also grow by what was left out without listeners (events_skip), so a listener
 * that comes back always learns that it missed something.
 *
 * An id is EPOCH-SEQ; the epoch is this run's: after a restart every old id is too old.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum {
    EVENTS_KEPT = 4096,
    EVENTS_BYTES = 16 << 20,     /* of their JSON; the newest is kept in any case */
    EVENT_ID_SIZE = 40,
};

struct event {
    uint64_t seq;
    const char *name; /* a literal */
    char *json;
    size_t size;
};

struct events {
    uint64_t epoch, last; /* last: number of the newest event, made or left out; 0: none */
    struct event *ring;   /* [EVENTS_KEPT]; NULL: nothing was made yet */
    uint32_t first, count;
    size_t bytes;
};

enum events_step { EVENTS_NONE, EVENTS_NEXT, EVENTS_RESET };

/* Zero-initialises; the epoch is random enough not to be an earlier run's. */
void events_init(struct events *events, uint64_t epoch);
void events_release(struct events *events);
/* Copies the JSON. Without memory it counts as left out. */
void events_add(struct events *events, const char *name, const void *json, size_t size);
/* Something changed of which no event is made: all that is kept is forgotten. */
void events_skip(struct events *events);

/* What follows *seq: nothing; *out, which lives until the next event is made, or a reset, and then *seq is that
 * event or the newest one. */
enum events_step events_next(const struct events *events, uint64_t *seq, const struct event **out);

void events_id(const struct events *events, uint64_t seq, char out[EVENT_ID_SIZE]);
/* The number of an id that a listener knows. 0: it is not of this run, or not given: it gets a reset. */
int events_parse(const struct events *events, const char *id, uint64_t *seq);
