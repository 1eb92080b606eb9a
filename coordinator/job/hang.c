#include "coordinator/job/hang.h"

#include <stddef.h>

#define SAMPLE_NS_LIMIT 1e9 /* the worker claims it */

static struct hang_unit *find(struct hangs *hangs, const struct hang_unit *unit)
{
    for (uint32_t i = 0; i < hangs->count; i++) {
        struct hang_unit *u = &hangs->units[i];
        if (u->frame == unit->frame && u->tile == unit->tile && u->group == unit->group && u->pass == unit->pass)
            return u;
    }
    return NULL;
}

static int is_at(const struct hang_unit *unit, uint32_t session)
{
    for (uint32_t i = 0; i < unit->session_count; i++)
        if (unit->sessions[i] == session)
            return 1;
    return 0;
}

void hangs_learn(struct hangs *hangs, uint64_t samples, uint64_t cpu_ns)
{
    double ns = samples ? (double)cpu_ns / (double)samples : 0;

    if (ns > SAMPLE_NS_LIMIT)
        ns = SAMPLE_NS_LIMIT;
    if (ns > hangs->sample_ns_max)
        hangs->sample_ns_max = ns;
}

uint64_t hangs_limit_ns(const struct hangs *hangs, uint64_t samples, uint64_t least_ns)
{
    double limit = HANG_FACTOR * hangs->sample_ns_max * (double)samples;

    if (hangs->sample_ns_max <= 0)
        return 0;
    return least_ns + (limit < 1e18 ? (uint64_t)limit : (uint64_t)1e18);
}

const struct hang_unit *hangs_note(struct hangs *hangs, struct hang_unit unit, uint32_t session)
{
    struct hang_unit *found = find(hangs, &unit);

    if (!found) {
        if (hangs->count == HANG_UNITS_MAX)
            return NULL;
        found = &hangs->units[hangs->count++];
        *found = unit;
        found->session_count = 0;
    }
    if (is_at(found, session) || found->session_count == HANG_SESSIONS_MAX)
        return NULL;
    found->sessions[found->session_count++] = session;
    return found;
}

int hangs_has(const struct hangs *hangs, struct hang_unit unit, uint32_t session)
{
    const struct hang_unit *found = hangs->count ? find((struct hangs *)hangs, &unit) : NULL;

    return found && is_at(found, session);
}

void hangs_settle(struct hangs *hangs, struct hang_unit unit)
{
    struct hang_unit *found = hangs->count ? find(hangs, &unit) : NULL;

    if (found)
        *found = hangs->units[--hangs->count];
}

void hangs_clear(struct hangs *hangs) { hangs->count = 0; }
