#include "worker/outbox.h"

#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

void outbox_release(struct outbox *o)
{
    while (o->first) {
        struct work_unit *unit = o->first;
        o->first = unit->next;
        mem_free(unit);
    }
    memset(o, 0, sizeof *o);
}

void outbox_add(struct outbox *o, struct work_unit *unit)
{
    unit->sent = 0;
    unit->next = NULL;
    unit->previous = o->last;
    if (o->last)
        o->last->next = unit;
    else
        o->first = unit;
    o->last = unit;
    if (!o->unsent)
        o->unsent = unit;
    o->count++;
}

static status send_result(struct channel *channel, struct work_unit *unit)
{
    Azulejo__Wire__TileResult result = AZULEJO__WIRE__TILE_RESULT__INIT;
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(TILE_RESULT, tile_result, &result);
    struct wire_work work;

    result.lease = unit->lease_id;
    result.epoch = unit->epoch;
    result.job = unit->job;
    result.frame = unit->frame;
    result.stats = &stats;
    wire_unit_set(&result, &work, &unit->result);
    stats.cpu_ns = unit->cpu_ns;
    stats.thread = unit->thread;
    stats.began_ns = atomic_load(&unit->begun_ns);
    stats.wall_ns = unit->wall_ns;
    stats.sent_ns = clock_monotonic_ns();
    stats.trace_ns = unit->trace_ns;
    stats.effects = unit->effects;
    stats.stages = unit->stages;
    stats.n_stages = STAGE_COUNT;
    stats.accounts = unit->accounts;
    for (size_t i = 0; i < EFFECT_ACCOUNTS; i++)
        if (unit->accounts[i] > 0)
            stats.n_accounts = i + 1;
    return channel_send(channel, &e);
}

void outbox_pump(struct outbox *o, struct channel *channel)
{
    if (!o->unsent)
        return;
    channel_cork(channel);
    while (o->unsent && channel_queued_bytes(channel) < CHANNEL_QUEUE_HIGH) {
        struct work_unit *unit = o->unsent;
        if (send_result(channel, unit) != STATUS_OK)
            break; /* the channel closes itself, or memory is short: try later */
        unit->sent = 1;
        o->unsent = unit->next;
    }
    channel_uncork(channel);
}

void outbox_reset(struct outbox *o)
{
    for (struct work_unit *unit = o->first; unit; unit = unit->next)
        unit->sent = 0;
    o->unsent = o->first;
}

static void outbox_remove(struct outbox *o, struct work_unit *unit)
{
    if (o->unsent == unit)
        o->unsent = unit->next;
    if (unit->previous)
        unit->previous->next = unit->next;
    else
        o->first = unit->next;
    if (unit->next)
        unit->next->previous = unit->previous;
    else
        o->last = unit->previous;
    o->count--;
    mem_free(unit);
}

void outbox_acknowledge(struct outbox *o, uint64_t job, uint32_t frame, struct unit_name name)
{
    struct work_unit *unit = o->first;

    /* Acknowledgements come roughly in the order of sending, so this searches few results. */
    while (unit && !(unit->job == job && unit->frame == frame && unit->result.tile == name.tile &&
                     unit->result.group == name.group && unit->result.pass == name.pass))
        unit = unit->next;
    if (unit)
        outbox_remove(o, unit);
}

void outbox_drop_lease(struct outbox *o, uint64_t lease_id)
{
    struct work_unit *next;

    for (struct work_unit *unit = o->first; unit; unit = next) {
        next = unit->next;
        if (unit->lease_id == lease_id)
            outbox_remove(o, unit);
    }
}
