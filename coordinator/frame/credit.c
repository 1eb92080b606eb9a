#include "coordinator/frame/credit.h"

#include <string.h>

#include "common/system/clock.h"

void credit_init(struct credit *credit, uint32_t claimed)
{
    memset(credit, 0, sizeof *credit);
    credit->claimed = claimed;
    credit->threads = claimed < CREDIT_THREADS_FIRST ? claimed : CREDIT_THREADS_FIRST;
}

static void period_begin(struct credit *credit, uint64_t now_ns)
{
    credit->period_ns = now_ns;
    credit->busy_ns = 0;
    credit->starved = 0;
}

void credit_lent(struct credit *credit, uint32_t held_units, uint64_t now_ns)
{
    if (held_units > 0)
        return;
    credit->progress_ns = now_ns;
    period_begin(credit, now_ns);
}

/* The new trust: CREDIT_GROWTH times the busy threads of the period, but at least half of the old
 * trust, so that one slow period costs no more than a lapse. */
static void period_end(struct credit *credit, uint64_t now_ns)
{
    double busy = (double)credit->busy_ns / (double)(now_ns - credit->period_ns);
    double shown = CREDIT_GROWTH * busy;
    uint32_t threads = shown < credit->claimed ? (uint32_t)shown : credit->claimed;

    if (threads < credit->threads / 2)
        threads = credit->threads / 2;
    if (threads < 1)
        threads = 1;
    if (threads > credit->threads || !credit->starved)
        credit->threads = threads;
    period_begin(credit, now_ns);
}

void credit_delivered(struct credit *credit, uint32_t held_units, uint64_t cpu_ns, uint64_t now_ns)
{
    credit->delivered_ns = credit->progress_ns = now_ns;
    credit->busy_ns += cpu_ns;
    credit->starved |= held_units < credit->threads;
    if (now_ns - credit->period_ns >= CREDIT_PERIOD_MS * NS_PER_MS)
        period_end(credit, now_ns);
}

void credit_lapsed(struct credit *credit, uint64_t granted_ns, uint64_t now_ns)
{
    if (granted_ns < credit->halved_ns)
        return;
    credit->halved_ns = now_ns;
    if (credit->threads > 1)
        credit->threads /= 2;
}

int credit_is_proven(const struct credit *credit, uint64_t now_ns)
{
    return credit->delivered_ns > 0 && now_ns - credit->delivered_ns < CREDIT_PROVEN_MS * NS_PER_MS;
}

int credit_is_stuck(const struct credit *credit, uint32_t held_units, uint64_t limit_ns, uint64_t now_ns)
{
    return (held_units > 0 && now_ns - credit->progress_ns >= limit_ns) || credit->halved_ns > credit->delivered_ns;
}
