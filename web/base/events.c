#include "web/base/events.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"

void events_init(struct events *events, uint64_t epoch) { *events = (struct events){.epoch = epoch}; }

static struct event *at(const struct events *events, uint32_t i)
{
    return &events->ring[(events->first + i) % EVENTS_KEPT];
}

static void forget_first(struct events *events)
{
    struct event *e = at(events, 0);

    events->bytes -= e->size;
    mem_free(e->json);
    events->first = (events->first + 1) % EVENTS_KEPT;
    events->count--;
}

static void forget_all(struct events *events)
{
    while (events->count > 0)
        forget_first(events);
}

void events_release(struct events *events)
{
    forget_all(events);
    mem_free(events->ring);
    events->ring = NULL;
}

void events_skip(struct events *events)
{
    forget_all(events);
    events->last++;
}

void events_add(struct events *events, const char *name, const void *json, size_t size)
{
    char *copy = mem_memdup(json, size);

    if (!events->ring)
        events->ring = mem_calloc(EVENTS_KEPT, sizeof *events->ring);
    if (!copy || !events->ring) {
        mem_free(copy);
        events_skip(events);
        return;
    }
    while (events->count == EVENTS_KEPT || (events->count > 0 && events->bytes + size > EVENTS_BYTES))
        forget_first(events);
    *at(events, events->count++) = (struct event){++events->last, name, copy, size};
    events->bytes += size;
}

enum events_step events_next(const struct events *events, uint64_t *seq, const struct event **out)
{
    if (*seq == events->last)
        return EVENTS_NONE;
    if (*seq > events->last || *seq + events->count < events->last) {
        *seq = events->last;
        return EVENTS_RESET;
    }
    *out = at(events, events->count - (uint32_t)(events->last - *seq));
    *seq = (*out)->seq;
    return EVENTS_NEXT;
}

void events_id(const struct events *events, uint64_t seq, char out[EVENT_ID_SIZE])
{
    snprintf(out, EVENT_ID_SIZE, "%" PRIx64 "-%" PRIu64, events->epoch, seq);
}

int events_parse(const struct events *events, const char *id, uint64_t *seq)
{
    char again[EVENT_ID_SIZE];
    const char *dash = id ? strchr(id, '-') : NULL;

    *seq = dash ? strtoull(dash + 1, NULL, 10) : 0;
    events_id(events, *seq, again);
    return dash && strcmp(id, again) == 0 && *seq <= events->last;
}
