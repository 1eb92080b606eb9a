#include "coordinator/job/candidates.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/job/queue.h"

void candidates_release(struct candidates *c)
{
    for (size_t i = 0; i < CANDIDATES_LISTS; i++)
        mem_free(c->lists[i].jobs);
    memset(c, 0, sizeof *c);
}

int candidates_reserve(struct candidates *c, size_t jobs)
{
    for (size_t i = 0; i < CANDIDATES_LISTS; i++)
        if (!MEM_GROW(c->lists[i].jobs, c->lists[i].capacity, jobs))
            return 0;
    return 1;
}

int job_is_before(const struct job *a, const struct job *b)
{
    return a->priority != b->priority ? a->priority > b->priority : a->id < b->id;
}

/* Is `a` served before `b`? */
static int is_first(const struct job *a, const struct job *b)
{
    if (a->place.ready != b->place.ready)
        return a->place.ready;
    if (a->place.ready && a->place.before != b->place.before)
        return a->place.before < b->place.before;
    return job_is_before(a, b);
}

enum candidate_list candidates_lane(const struct job *job)
{
    unsigned isa = (unsigned)job->settings.isa < ISA_COUNT ? job->settings.isa : 0;

    return CANDIDATES_LANES + 2 * isa + (job->ray_tracer[0] != 0);
}

int candidates_belongs(const struct job *job, enum candidate_list list)
{
    switch (list) {
    case CANDIDATES_WORKING: return job->frames != NULL;
    case CANDIDATES_CLOSING: return job->state == JOB_STATE_FINISHING || job->state == JOB_STATE_CANCELLING;
    case CANDIDATES_TROUBLED: return trouble_is(&job->trouble);
    default:
        return list == candidates_lane(job) && !job->all_begun &&
               (job->state == JOB_STATE_QUEUED || job->state == JOB_STATE_RUNNING);
    }
}

/* The place of the first job of the list that is not before `job`. */
static size_t place_of(const struct job_list *list, const struct job *job)
{
    size_t low = 0, high = list->count;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (is_first(list->jobs[middle], job))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void list_insert(struct job_list *list, struct job *job)
{
    size_t place = place_of(list, job);

    assert(list->count < list->capacity);
    memmove(list->jobs + place + 1, list->jobs + place, (list->count - place) * sizeof *list->jobs);
    list->jobs[place] = job;
    list->count++;
}

static void list_remove(struct job_list *list, const struct job *job)
{
    size_t place = place_of(list, job);

    assert(place < list->count && list->jobs[place] == job);
    list->count--;
    memmove(list->jobs + place, list->jobs + place + 1, (list->count - place) * sizeof *list->jobs);
}

static void set_lists(struct candidates *c, struct job *job, unsigned lists)
{
    unsigned changed = job->candidate_lists ^ lists;

    c->changes++;
    for (unsigned i = 0; changed >> i; i++) {
        if (!(changed >> i & 1))
            continue;
        if (lists >> i & 1)
            list_insert(&c->lists[i], job);
        else
            list_remove(&c->lists[i], job);
    }
    job->candidate_lists = lists;
}

void candidates_update(struct candidates *c, struct job *job, int active)
{
    unsigned lists = 0;

    for (unsigned i = 0; active && i < CANDIDATES_LISTS; i++)
        lists |= (unsigned)candidates_belongs(job, i) << i;
    set_lists(c, job, lists);
}

static int compare(const void *a, const void *b)
{
    const struct job *one = *(struct job *const *)a, *other = *(struct job *const *)b;

    return is_first(other, one) - is_first(one, other);
}

void candidates_sort(struct candidates *c)
{
    c->changes++;
    for (size_t i = 0; i < CANDIDATES_LISTS; i++)
        if (c->lists[i].count > 1)
            qsort(c->lists[i].jobs, c->lists[i].count, sizeof *c->lists[i].jobs, compare);
}

void candidates_remove(struct candidates *c, struct job *job) { set_lists(c, job, 0); }

struct job *candidates_next(const struct candidates *c, unsigned lists, const struct job *after)
{
    struct job *next = NULL;

    for (unsigned i = 0; lists >> i; i++) {
        const struct job_list *list = &c->lists[i];
        size_t place;
        if (!(lists >> i & 1) || list->count == 0)
            continue;
        place = after ? place_of(list, after) : 0;
        if (place < list->count && list->jobs[place] == after)
            place++;
        if (place < list->count && (!next || is_first(list->jobs[place], next)))
            next = list->jobs[place];
    }
    return next;
}
