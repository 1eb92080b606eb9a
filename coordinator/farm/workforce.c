#include "coordinator/farm/workforce.h"

#include "coordinator/farm/farm.h"
#include "coordinator/farm/roster.h"

void workforce_due(struct farm *farm, struct farm_worker *worker)
{
    struct workforce *all = &farm->workforce;
    struct workforce_place *p = &worker->place;

    if (p->is_due)
        return;
    p->is_due = 1;
    p->due_next = NULL;
    p->due_previous = all->due_last;
    *(all->due_last ? &all->due_last->place.due_next : &all->due_first) = worker;
    all->due_last = worker;
}

static void due_remove(struct workforce *all, struct farm_worker *worker)
{
    struct workforce_place *p = &worker->place;

    if (!p->is_due)
        return;
    p->is_due = 0;
    *(p->due_previous ? &p->due_previous->place.due_next : &all->due_first) = p->due_next;
    *(p->due_next ? &p->due_next->place.due_previous : &all->due_last) = p->due_previous;
}

struct farm_worker *workforce_next_due(struct farm *farm)
{
    struct farm_worker *worker = farm->workforce.due_first;

    if (worker)
        due_remove(&farm->workforce, worker);
    return worker;
}

void workforce_set_hungry(struct farm *farm, struct farm_worker *worker, int hungry)
{
    farm->workforce.hungry += (uint32_t)(hungry != 0);
    farm->workforce.hungry -= worker->place.is_hungry;
    worker->place.is_hungry = hungry != 0;
}

static void proven_remove(struct workforce *all, struct farm_worker *worker)
{
    struct workforce_place *p = &worker->place;

    if (p->counted_threads == 0)
        return;
    all->proven_threads -= p->counted_threads;
    p->counted_threads = 0;
    *(p->older ? &p->older->place.newer : &all->proven_oldest) = p->newer;
    *(p->newer ? &p->newer->place.older : &all->proven_newest) = p->older;
}

static void proven_append(struct workforce *all, struct farm_worker *worker)
{
    struct workforce_place *p = &worker->place;

    p->counted_threads = worker->credit.threads; /* at least 1 */
    all->proven_threads += p->counted_threads;
    p->newer = NULL;
    p->older = all->proven_newest;
    *(all->proven_newest ? &all->proven_newest->place.newer : &all->proven_oldest) = worker;
    all->proven_newest = worker;
}

void workforce_counts(struct farm *farm, struct farm_worker *worker)
{
    struct workforce *all = &farm->workforce;
    struct workforce_place *p = &worker->place;

    if (!worker_takes_work(worker))
        proven_remove(all, worker);
    if (worker->credit.delivered_ns == 0 || !worker_takes_work(worker))
        return;
    if (all->proven_newest == worker ||
        (p->counted_threads > 0 && p->newer &&
         p->newer->credit.delivered_ns >= worker->credit.delivered_ns)) {
        all->proven_threads += worker->credit.threads; /* its place is right */
        all->proven_threads -= p->counted_threads;
        p->counted_threads = worker->credit.threads;
        return;
    }
    if (all->proven_newest && all->proven_newest->credit.delivered_ns > worker->credit.delivered_ns)
        return; /* it left the list by age, and delivered nothing since */
    proven_remove(all, worker);
    proven_append(all, worker);
}

uint64_t workforce_threads(struct farm *farm, const struct farm_worker *worker, uint64_t now_ns)
{
    struct workforce *all = &farm->workforce;

    while (all->proven_oldest && !credit_is_proven(&all->proven_oldest->credit, now_ns))
        proven_remove(all, all->proven_oldest);
    return all->proven_threads + (worker->place.counted_threads ? 0 : worker->credit.threads);
}

void workforce_leave(struct farm *farm, struct farm_worker *worker)
{
    workforce_set_hungry(farm, worker, 0);
    due_remove(&farm->workforce, worker);
    proven_remove(&farm->workforce, worker);
}
