#include "coordinator/frame/lease.h"

#include <assert.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/job/queue.h"

void lease_table_init(struct lease_table *table, uint64_t epoch, uint64_t duration_ns)
{
    memset(table, 0, sizeof *table);
    table->epoch = epoch;
    table->duration_ns = duration_ns;
    table->lapse_ns = UINT64_MAX;
}

void lease_table_release(struct lease_table *table)
{
    while (table->oldest)
        lease_end(table, table->oldest);
}

static void lease_free(struct lease_table *table, struct lease *lease)
{
    struct lease **at = &table->buckets[lease->id % LEASE_BUCKETS];

    while (*at != lease)
        at = &(*at)->chain;
    *at = lease->chain;
    *(lease->older ? &lease->older->newer : &table->oldest) = lease->newer;
    *(lease->newer ? &lease->newer->older : &table->newest) = lease->older;
    *(lease->holder_older ? &lease->holder_older->holder_newer : &lease->holder->oldest) = lease->holder_newer;
    *(lease->holder_newer ? &lease->holder_newer->holder_older : &lease->holder->newest) = lease->holder_older;
    table->count--;
    lease->frame->job->leases--;
    lease->holder->leases--;
    mem_free(lease);
}

/* The lease has one unit less. */
static void lease_close_unit(struct lease *lease, struct unit_name name)
{
    lease->open_count--;
    lease->holder->units--;
    lease->holder->samples -= job_frame_unit_samples(lease->frame, name);
}

static int unit_is_held_by(const struct unit *unit, const struct lease *lease)
{
    for (uint32_t i = 0; unit && i < unit->holder_count; i++)
        if (unit->holders[i] == lease)
            return 1;
    return 0;
}

static void lease_lend_unit(struct lease *lease, struct unit_name name, uint64_t now_ns)
{
    const struct unit *unit = job_frame_unit_find(lease->frame, name);

    if (unit_is_held_by(unit, lease))
        return;
    if (job_frame_unit_lend(lease->frame, name, lease, now_ns) == STATUS_OK) {
        lease->units[lease->unit_count++] = name;
        lease->open_count++;
        lease->holder->units++;
        lease->holder->samples += job_frame_unit_samples(lease->frame, name);
    } else if (!unit) {
        job_frame_return(lease->frame, name);
    }
}

struct lease *lease_grant(struct lease_table *table, struct job_frame *frame, struct lease_holder *holder,
                          const struct unit_name *units, uint32_t count, uint64_t now_ns)
{
    struct lease *lease = NULL;
    struct lease **bucket;

    assert(count > 0 && count <= LEASE_UNITS_MAX);
    if (table->count < LEASES_MAX)
        lease = mem_calloc(1, sizeof *lease + count * sizeof *units);
    if (!lease) {
        for (uint32_t i = 0; i < count; i++)
            if (!job_frame_unit_find(frame, units[i]))
                job_frame_return(frame, units[i]);
        return NULL;
    }
    lease->holder = holder;
    lease->frame = frame;
    for (uint32_t i = 0; i < count; i++)
        lease_lend_unit(lease, units[i], now_ns);
    if (lease->unit_count == 0) {
        mem_free(lease);
        return NULL;
    }
    lease->id = ++table->last_id;
    lease->epoch = ++table->epoch;
    lease->granted_ns = now_ns;
    lease->deadline_ns = now_ns + table->duration_ns;
    holder->job = frame->job->id;
    if (lease->deadline_ns < table->lapse_ns)
        table->lapse_ns = lease->deadline_ns;
    bucket = &table->buckets[lease->id % LEASE_BUCKETS];
    lease->chain = *bucket;
    *bucket = lease;
    lease->older = table->newest;
    *(table->newest ? &table->newest->newer : &table->oldest) = lease;
    table->newest = lease;
    lease->holder_older = holder->newest;
    *(holder->newest ? &holder->newest->holder_newer : &holder->oldest) = lease;
    holder->newest = lease;
    table->count++;
    holder->leases++;
    frame->job->leases++;
    return lease;
}

struct lease *lease_find(const struct lease_table *table, uint64_t id, uint64_t epoch)
{
    struct lease *lease = table->buckets[id % LEASE_BUCKETS];

    while (lease && (lease->id != id || (epoch && lease->epoch != epoch)))
        lease = lease->chain;
    return lease;
}

int lease_lent(const struct lease *lease, uint64_t job, uint32_t frame, struct unit_name name)
{
    int lent = 0;

    for (uint32_t i = 0; i < lease->unit_count && !lent; i++)
        lent = lease->units[i].tile == name.tile && lease->units[i].group == name.group && lease->units[i].pass == name.pass;
    return lent && lease->frame->job->id == job && lease->frame->number == frame;
}

void lease_renew(const struct lease_table *table, struct lease *lease, uint64_t now_ns)
{
    lease->deadline_ns = now_ns + table->duration_ns;
}

void lease_end(struct lease_table *table, struct lease *lease)
{
    for (uint32_t i = 0; i < lease->unit_count; i++) {
        struct unit *unit = job_frame_unit_find(lease->frame, lease->units[i]);
        if (!unit_is_held_by(unit, lease))
            continue;
        lease_close_unit(lease, lease->units[i]);
        job_frame_unit_drop(lease->frame, unit, lease);
    }
    lease_free(table, lease);
}

void lease_end_all_of(struct lease_table *table, struct lease_holder *holder)
{
    while (holder->oldest)
        lease_end(table, holder->oldest);
}

void lease_return_unit(struct lease_table *table, struct lease *lease, struct unit_name name)
{
    struct unit *unit = job_frame_unit_find(lease->frame, name);

    if (!unit_is_held_by(unit, lease))
        return;
    lease_close_unit(lease, name);
    job_frame_unit_drop(lease->frame, unit, lease);
    if (lease->open_count == 0)
        lease_free(table, lease);
}

void lease_settle_unit(struct lease_table *table, struct job_frame *frame, struct unit_name name, uint32_t session,
                       void (*others)(void *user, uint32_t session, uint64_t lease), void *user)
{
    struct unit *unit = job_frame_unit_find(frame, name);

    if (!unit)
        return;
    for (uint32_t i = 0; i < unit->holder_count; i++) {
        struct lease *lease = unit->holders[i];
        lease_close_unit(lease, name);
        if (lease->open_count > 0)
            continue;
        if (lease->holder->session != session && others)
            others(user, lease->holder->session, lease->id);
        lease_free(table, lease);
    }
    job_frame_unit_settle(frame, unit);
}

struct lease *lease_lapsed(struct lease_table *table, uint64_t now_ns)
{
    if (now_ns < table->lapse_ns)
        return NULL;
    table->lapse_ns = UINT64_MAX;
    for (struct lease *lease = table->oldest; lease; lease = lease->newer) {
        if (lease->deadline_ns < table->lapse_ns)
            table->lapse_ns = lease->deadline_ns;
        if (lease->deadline_ns <= now_ns)
            return lease;
    }
    return NULL;
}
