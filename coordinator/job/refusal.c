#include "coordinator/job/refusal.h"

#include "common/base/memory.h"

void refusals_release(struct refusals *r)
{
    mem_free(r->items);
    *r = (struct refusals){0};
}

static struct refusal *find(const struct refusals *r, uint64_t machine)
{
    for (size_t i = 0; i < r->count; i++)
        if (r->items[i].machine == machine)
            return &r->items[i];
    return NULL;
}

const struct refusal *refusals_find(const struct refusals *r, uint64_t machine) { return find(r, machine); }

int refusals_bar(const struct refusals *r, uint64_t machine)
{
    const struct refusal *refusal = find(r, machine);

    return refusal && (refusal->damaged || refusal->waits);
}

status refusals_note(struct refusals *r, uint64_t machine, status why, const char *text, uint64_t now_ns)
{
    struct refusal *refusal = find(r, machine);

    if (!refusal) {
        if (!MEM_GROW(r->items, r->capacity, r->count + 1))
            return STATUS_ERR_NO_MEMORY;
        refusal = &r->items[r->count++];
        *refusal = (struct refusal){.machine = machine};
    }
    if (refusal->damaged)
        return STATUS_OK;
    refusal->damaged = status_is_scene(why);
    r->damaged += refusal->damaged != 0;
    refusal->waits = !refusal->damaged;
    (void)trouble_note_within(&refusal->shortage, text, SHORTAGE_LAST_MS, now_ns);
    return STATUS_OK;
}

void refusals_settle(struct refusals *r, uint64_t machine)
{
    struct refusal *refusal = r->count > 0 ? find(r, machine) : NULL;

    if (!refusal || refusal->damaged)
        return;
    *refusal = r->items[--r->count];
}

int refusals_due(struct refusals *r, uint64_t now_ns, uint64_t *next_ns)
{
    int due = 0;

    for (size_t i = 0; i < r->count; i++) {
        struct refusal *refusal = &r->items[i];
        if (!refusal->waits)
            continue;
        if (trouble_waits(&refusal->shortage, now_ns)) {
            *next_ns = refusal->shortage.next_ns < *next_ns ? refusal->shortage.next_ns : *next_ns;
            continue;
        }
        refusal->waits = 0;
        due = 1;
    }
    return due;
}

int refusals_hurry(struct refusals *r)
{
    int some = 0;

    for (size_t i = 0; i < r->count; i++) {
        some |= r->items[i].waits;
        r->items[i].waits = 0;
        r->items[i].shortage.tries = 0;
    }
    return some;
}

void refusals_clear(struct refusals *r) { r->count = r->damaged = 0; }
