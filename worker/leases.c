#include "worker/leases.h"

#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "worker/profile.h"

struct lease {
    struct lease *next;
    struct scene_slot *slot;
    uint64_t id, epoch, job;
    uint32_t frame;
    int started;                    /* its units were given to the pool */
    atomic_uint left;               /* units that are neither rendered nor given back */
    struct work_unit *first, *last; /* of its units that are not rendered yet */
};

/* ---- in a pool thread ------------------------------------------------------------------ */

static void unit_render(struct pool_task *task)
{
    struct work_unit *unit = (struct work_unit *)task;
    const struct render_scene *scene = scene_slot_render(unit->lease->slot);
    uint64_t cpu_ns = clock_thread_cpu_ns(), begun_ns = clock_monotonic_ns();
    struct profile_counts before, after;
    struct unit_result *r = &unit->result;
    struct render_stats stats = {0};

    unit->thread = pool_thread();
    atomic_store(&unit->begun_ns, begun_ns);
    profile_counts(&before);
    r->count = render_tile(scene, unit->frame, r->tile, r->group, r->pass, unit->sums, &r->tail, &stats);
    r->sums = unit->sums;
    r->work = stats.work;
    unit->trace_ns = stats.trace_ns;
    profile_counts(&after);
    for (int i = 0; i < STAGE_COUNT; i++)
        unit->stages[i] = (uint32_t)(after.stages[i] - before.stages[i]);
    for (int i = 0; i < EFFECT_ACCOUNTS; i++)
        unit->accounts[i] = (uint32_t)(after.accounts[i] - before.accounts[i]);
    unit->effects = render_effects(scene);
    unit->cpu_ns = clock_thread_cpu_ns() - cpu_ns;
    unit->wall_ns = clock_monotonic_ns() - begun_ns;
    task->can_wait = atomic_fetch_sub(&unit->lease->left, 1) > 1; /* the coordinator may wait for a lease's last */
}

/* ---- units and leases ------------------------------------------------------------------ */

static void unit_unlink(struct work_unit *unit)
{
    struct lease *lease = unit->lease;

    if (unit->previous)
        unit->previous->next = unit->next;
    else
        lease->first = unit->next;
    if (unit->next)
        unit->next->previous = unit->previous;
    else
        lease->last = unit->previous;
    unit->previous = unit->next = NULL;
    unit->lease = NULL;
}

static void unit_append(struct lease *lease, struct work_unit *unit)
{
    unit->lease = lease;
    unit->next = NULL;
    unit->previous = lease->last;
    if (lease->last)
        lease->last->next = unit;
    else
        lease->first = unit;
    lease->last = unit;
}

static void lease_end_if_empty(struct leases *l, struct lease *lease)
{
    struct lease **at = &l->first;

    if (lease->first)
        return;
    while (*at != lease)
        at = &(*at)->next;
    *at = lease->next;
    l->lease_count--;
    scene_slot_release(lease->slot);
    mem_free(lease);
}

/* Is a thread rendering it (or just finished, before the loop knows)? */
static int unit_try_take(struct leases *l, struct work_unit *unit)
{
    return !unit->lease->started || pool_cancel(l->pool, &unit->task);
}

/* Free the lease's units that no thread has started; mark the others `dropped` if asked. */
static void lease_drop_unstarted(struct leases *l, struct lease *lease, int drop_running)
{
    struct work_unit *next;

    for (struct work_unit *unit = lease->first; unit; unit = next) {
        next = unit->next;
        if (unit_try_take(l, unit)) {
            atomic_fetch_sub(&lease->left, 1);
            unit_unlink(unit);
            mem_free(unit);
            l->held--;
        } else if (drop_running) {
            unit->dropped = 1;
        }
    }
    lease_end_if_empty(l, lease);
}

static void say_broken(struct channel *channel, uint64_t job, uint64_t lease, const struct error *why)
{
    Azulejo__Wire__JobBroken broken = AZULEJO__WIRE__JOB_BROKEN__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_BROKEN, job_broken, &broken);
    char text[MESSAGE_TEXT_MAX];

    log_error("job %llu, lease %llu: cannot be rendered: %s", (unsigned long long)job, (unsigned long long)lease,
              why->text);
    if (!channel)
        return;
    broken.job = job;
    broken.lease = lease;
    broken.code = why->code;
    broken.text = (char *)message_text(text, sizeof text, why->text);
    (void)!channel_send(channel, &e); /* fails only when the connection does */
}

void leases_init(struct leases *l, struct pool *pool, struct scene_cache *scenes, unsigned threads, uint32_t isa_mask)
{
    memset(l, 0, sizeof *l);
    l->pool = pool;
    l->scenes = scenes;
    l->threads = threads;
    l->isa_mask = isa_mask;
}

void leases_release(struct leases *l)
{
    while (l->first) {
        struct lease *lease = l->first;
        while (lease->first) {
            struct work_unit *unit = lease->first;
            unit_unlink(unit);
            mem_free(unit);
        }
        lease_end_if_empty(l, lease);
    }
}

/* ---- granted --------------------------------------------------------------------------- */

static void lease_start(struct leases *l, struct lease *lease)
{
    lease->started = 1;
    for (struct work_unit *unit = lease->first; unit; unit = unit->next)
        pool_push(l->pool, &unit->task, 0);
}

static status grant_check(const struct leases *l, const Azulejo__Wire__LeaseGrant *grant, struct error *err)
{
    if (grant->n_units == 0 || grant->n_units > MESSAGE_UNITS_MAX)
        return error_set(err, STATUS_ERR_PROTOCOL, "lease %llu of %zu units (1..%d are allowed)",
                         (unsigned long long)grant->lease, grant->n_units, MESSAGE_UNITS_MAX);
    if (l->lease_count >= LEASES_HELD_MAX)
        return error_set(err, STATUS_ERR_PROTOCOL, "more than %d leases at once", LEASES_HELD_MAX);
    for (const struct lease *lease = l->first; lease; lease = lease->next)
        if (lease->id == grant->lease && lease->epoch == grant->epoch)
            return error_set(err, STATUS_ERR_PROTOCOL, "lease %llu was granted twice",
                             (unsigned long long)grant->lease);
    return STATUS_OK;
}

static status units_make(struct lease *lease, const Azulejo__Wire__LeaseGrant *grant,
                         const struct render_settings *settings, struct error *err)
{
    for (size_t i = 0; i < grant->n_units; i++) {
        const Azulejo__Wire__WorkUnit *name = grant->units[i];
        struct work_unit *unit;
        TRY(wire_unit_check(name->tile, name->group, name->pass, settings, err));
        unit = mem_calloc(1, sizeof *unit +
                                 wire_sums_count(settings, name->tile, name->group, name->pass) * sizeof *unit->sums);
        NEED(unit, err, "work units");
        unit->task.run = unit_render;
        unit->lease_id = lease->id;
        unit->epoch = lease->epoch;
        unit->job = lease->job;
        unit->frame = lease->frame;
        unit->result.name = (struct unit_name){name->tile, name->group, name->pass};
        unit_append(lease, unit);
    }
    atomic_init(&lease->left, (unsigned)grant->n_units);
    return STATUS_OK;
}

status leases_grant(struct leases *l, const Azulejo__Wire__LeaseGrant *grant, struct channel *channel,
                    struct error *err)
{
    struct render_settings settings;
    struct digest scene;
    struct lease *lease = NULL;
    struct error why = {0};
    status s = grant_check(l, grant, err);

    THEN(s, wire_digest_get(&scene, &grant->scene, "lease", err));
    if (s != STATUS_OK)
        return s;
    s = wire_settings_get(&settings, grant->settings, UINT32_MAX, &why);
    if (s == STATUS_OK && !(l->isa_mask >> settings.isa & 1))
        s = error_set(&why, STATUS_ERR_UNSUPPORTED, "it needs %s, which this worker does not offer",
                      isa_name(settings.isa));
    if (s == STATUS_OK) {
        lease = mem_calloc(1, sizeof *lease);
        if (!lease)
            s = error_no_memory(&why, "a lease");
    }
    if (s == STATUS_OK) {
        lease->id = grant->lease;
        lease->epoch = grant->epoch;
        lease->job = grant->job;
        lease->frame = grant->frame;
        s = units_make(lease, grant, &settings, &why);
    }
    THEN(s, scene_cache_acquire(l->scenes, &scene, &settings, grant->frame, &lease->slot, &why));
    if (s != STATUS_OK) {
        while (lease && lease->first) {
            struct work_unit *unit = lease->first;
            unit_unlink(unit);
            mem_free(unit);
        }
        mem_free(lease);
        if (s == STATUS_ERR_PROTOCOL)
            return error_set(err, s, "lease %llu: %s", (unsigned long long)grant->lease, why.text);
        why.code = s;
        say_broken(channel, grant->job, grant->lease, &why);
        return STATUS_OK;
    }
    lease->next = l->first;
    l->first = lease;
    l->lease_count++;
    l->held += grant->n_units;
    log_debug("job %llu, frame %u: lease %llu of %zu units", (unsigned long long)lease->job, lease->frame,
              (unsigned long long)lease->id, grant->n_units);
    if (scene_slot_state(lease->slot) == SCENE_READY)
        lease_start(l, lease);
    return STATUS_OK;
}

/* Its slot is READY or BROKEN. If it turned out to show another moment of a moving scene, switch to
 * another slot. 0: there will be none for the lease. */
static int lease_settle(struct lease *lease, const struct scene_slot *slot, struct error *why)
{
    if (scene_slot_state(slot) != SCENE_READY) {
        *why = *scene_slot_error(slot);
        return 0;
    }
    return scene_slot_shows(slot, lease->frame) || scene_slot_change(&lease->slot, lease->frame, why) == STATUS_OK;
}

void leases_scene_settled(struct leases *l, struct scene_slot *slot, struct channel *channel)
{
    struct lease *next;

    for (struct lease *lease = l->first; lease; lease = next) {
        next = lease->next;
        struct error why = {0};
        if (lease->slot != slot)
            continue;
        if (!lease_settle(lease, slot, &why)) {
            say_broken(channel, lease->job, lease->id, &why);
            lease_drop_unstarted(l, lease, 0); /* none was started: this ends the lease */
        } else if (scene_slot_state(lease->slot) == SCENE_READY) {
            lease_start(l, lease);
        }
    }
}

/* ---- done ------------------------------------------------------------------------------ */

static void warn_of_health(const struct work_unit *unit)
{
    const struct health *health = &unit->result.work.health;

    for (int k = 0; k < HEALTH_KINDS; k++)
        if (health->count[k])
            log_warn("job %llu, frame %u, tile %u, group %u, pass %u: %llu %s", (unsigned long long)unit->job,
                     unit->frame, unit->result.tile, unit->result.group, unit->result.pass,
                     (unsigned long long)health->count[k], health->count[k] == 1 ? health_rows[k].one : health_rows[k].many);
}

struct work_unit *leases_unit_done(struct leases *l, struct pool_task *task)
{
    struct work_unit *unit = (struct work_unit *)task;
    struct lease *lease = unit->lease;

    l->held--;
    l->units_done++;
    l->samples_done += unit->result.work.samples;
    l->unit_ns = l->unit_ns ? (l->unit_ns * 15 + unit->wall_ns) / 16 : unit->wall_ns;
    warn_of_health(unit);
    unit_unlink(unit);
    lease_end_if_empty(l, lease);
    if (!unit->dropped)
        return unit;
    mem_free(unit);
    return NULL;
}

/* ---- returned -------------------------------------------------------------------------- */

void leases_revoke(struct leases *l, const Azulejo__Wire__LeaseRevoke *revoke)
{
    char reason[MESSAGE_TEXT_MAX];

    for (struct lease *lease = l->first; lease; lease = lease->next) {
        if (lease->id != revoke->lease)
            continue;
        log_info("job %llu, frame %u: lease %llu is revoked: %s", (unsigned long long)lease->job, lease->frame,
                 (unsigned long long)lease->id, message_text(reason, sizeof reason, revoke->reason));
        lease_drop_unstarted(l, lease, 1);
        return;
    }
    /* Its last unit was rendered in the meantime: nothing to do. */
}

void leases_forget_unstarted(struct leases *l)
{
    struct lease *next;

    for (struct lease *lease = l->first; lease; lease = next) {
        next = lease->next;
        lease_drop_unstarted(l, lease, 0);
    }
}

static void lease_return(struct leases *l, struct lease *lease, struct channel *channel, const char *reason)
{
    Azulejo__Wire__LeaseReturn give = AZULEJO__WIRE__LEASE_RETURN__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_RETURN, lease_return, &give);
    Azulejo__Wire__WorkUnit names[MESSAGE_UNITS_MAX], *pointers[MESSAGE_UNITS_MAX];
    struct work_unit *next;
    size_t count = 0;

    for (struct work_unit *unit = lease->first; unit; unit = next) {
        next = unit->next;
        if (!unit_try_take(l, unit))
            continue;
        azulejo__wire__work_unit__init(&names[count]);
        names[count].tile = unit->result.tile;
        names[count].group = unit->result.group;
        names[count].pass = unit->result.pass;
        pointers[count] = &names[count];
        count++;
        atomic_fetch_sub(&lease->left, 1);
        unit_unlink(unit);
        mem_free(unit);
        l->held--;
    }
    if (count > 0) {
        give.lease = lease->id;
        give.units = pointers;
        give.n_units = count;
        give.reason = (char *)reason;
        (void)!channel_send(channel, &e); /* if it fails the connection ends: returned as well */
    }
    lease_end_if_empty(l, lease);
}

void leases_return_unstarted(struct leases *l, struct channel *channel, const char *reason)
{
    struct lease *next;

    for (struct lease *lease = l->first; lease; lease = next) {
        next = lease->next;
        lease_return(l, lease, channel, reason);
    }
}

/* Keep the longest ones, in order. */
static void running_add(struct running_unit *out, size_t max, size_t *count, const struct running_unit *unit)
{
    size_t at = *count;

    while (at > 0 && out[at - 1].running_ns < unit->running_ns)
        at--;
    if (at == max)
        return;
    *count += *count < max;
    memmove(out + at + 1, out + at, (*count - at - 1) * sizeof *out);
    out[at] = *unit;
}

uint32_t leases_running(const struct leases *l, uint64_t now_ns, uint64_t least_ns, struct running_unit *out,
                        size_t max, size_t *count)
{
    uint32_t busy = 0;

    *count = 0;
    for (const struct lease *lease = l->first; lease; lease = lease->next) {
        for (const struct work_unit *unit = lease->first; unit; unit = unit->next) {
            uint64_t begun_ns = atomic_load(&unit->begun_ns);
            struct running_unit found = {.job = unit->job, .frame = unit->frame, .name = unit->result.name};
            if (begun_ns == 0)
                continue;
            busy += busy < l->threads;
            found.running_ns = now_ns > begun_ns ? now_ns - begun_ns : 0;
            if (found.running_ns >= least_ns)
                running_add(out, max, count, &found);
        }
    }
    return busy;
}

void leases_learn_trip(struct leases *l, uint64_t trip_ns)
{
    if (trip_ns > UNITS_HOLD_MAX_MS * NS_PER_MS)
        trip_ns = UNITS_HOLD_MAX_MS * NS_PER_MS; /* there was no work */
    l->trip_ns = (l->trip_ns * 3 + trip_ns) / 4;
}

/* Work to hold for each thread. */
static uint64_t hold_ns(const struct leases *l)
{
    uint64_t ns = l->trip_ns * UNITS_HOLD_TRIPS;

    if (ns > UNITS_HOLD_MAX_MS * NS_PER_MS)
        return UNITS_HOLD_MAX_MS * NS_PER_MS;
    return ns > UNITS_HOLD_MS * NS_PER_MS ? ns : UNITS_HOLD_MS * NS_PER_MS;
}

uint32_t leases_room(const struct leases *l)
{
    uint64_t each = UNITS_PER_THREAD_MIN, high;

    if (l->unit_ns)
        each = hold_ns(l) / l->unit_ns + 1;
    if (each < UNITS_PER_THREAD_MIN)
        each = UNITS_PER_THREAD_MIN;
    if (each > UNITS_PER_THREAD_MAX)
        each = UNITS_PER_THREAD_MAX;
    high = each * l->threads;
    if (high > MESSAGE_UNITS_MAX * 4ull)
        high = MESSAGE_UNITS_MAX * 4ull;
    return l->held > high / 2 ? 0 : (uint32_t)(high - l->held);
}
