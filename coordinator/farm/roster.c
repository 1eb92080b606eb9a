#include "coordinator/farm/roster.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/worker_name.h"

_Static_assert((int)WORKER_LABEL_MAX == (int)WORKER_LABEL_BYTES_MAX, "the store keeps whole names");

/* ---- names ----------------------------------------------------------------------------------- */

static uint32_t bucket_of(const char *name)
{
    uint32_t hash = 2166136261u;

    for (; *name; name++)
        hash = (hash ^ (unsigned char)*name) * 16777619u;
    return hash % ROSTER_BUCKETS;
}

struct farm_worker *roster_find(const struct farm *farm, const char *name)
{
    struct farm_worker *worker = farm->roster.by_name[bucket_of(name)];

    while (worker && strcmp(worker->label, name) != 0)
        worker = worker->same_bucket;
    return worker;
}

static void take_name(struct farm *farm, struct farm_worker *worker, const char *name)
{
    struct farm_worker **bucket = &farm->roster.by_name[bucket_of(name)];

    snprintf(worker->label, sizeof worker->label, "%s", name);
    worker->same_bucket = *bucket;
    *bucket = worker;
    worker->is_named = 1;
}

void roster_leave(struct farm *farm, struct farm_worker *worker)
{
    struct farm_worker **at = &farm->roster.by_name[bucket_of(worker->label)];

    if (!worker->is_named)
        return;
    while (*at != worker)
        at = &(*at)->same_bucket;
    *at = worker->same_bucket;
    worker->is_named = 0;
    farm->roster.taken_to = 0;
}

/* A host's name as a name of a worker. */
static void name_of_host(char out[WORKER_NAME_BYTES_MAX + 1], const char *host)
{
    size_t length = 0;

    for (; *host && length < WORKER_NAME_BYTES_MAX - 6; host++) {
        int fits = isascii((unsigned char)*host) && (isalnum((unsigned char)*host) || strchr("._-", *host));
        out[length] = fits ? *host : '-';
        length += length > 0 || out[0] != '-';
    }
    out[length] = 0;
    if (!worker_name_is_valid(out))
        snprintf(out, WORKER_NAME_BYTES_MAX + 1, "worker");
}

/* Is it the key of others? Then who has no key of its own cannot be called so. */
static int is_proved_by_others(const struct farm *farm, const char *key, const char *label)
{
    return !key[0] && farm->roster.is_key && farm->roster.is_key(farm->roster.keys, label);
}

static void number_name(char out[WORKER_NAME_BYTES_MAX + 1], const char *base, int is_key, uint32_t number)
{
    if (number == 1)
        snprintf(out, WORKER_NAME_BYTES_MAX + 1, "%s", base);
    else if (is_key)
        snprintf(out, WORKER_NAME_BYTES_MAX + 1, "%u", number);
    else
        snprintf(out, WORKER_NAME_BYTES_MAX + 1, "%.57s-%u", base, number);
}

/* The first of HOST, HOST-2, ... that is free. Many workers of one host join at once: numbers that
 * were taken a moment ago are not looked at again. */
static void make_name(struct farm *farm, const struct worker_claim *claim, char out[WORKER_LABEL_MAX + 1])
{
    struct roster *roster = &farm->roster;
    char base[WORKER_NAME_BYTES_MAX + 1], name[sizeof base], first[WORKER_LABEL_MAX + 1];
    uint32_t number = 1;

    name_of_host(base, claim->host);
    worker_label_make(first, claim->key, base);
    if (roster->taken_to && strcmp(roster->taken_base, first) == 0)
        number = roster->taken_to + 1;
    for (;; number++) {
        number_name(name, base, strcmp(base, claim->key) == 0, number);
        worker_label_make(out, claim->key, name);
        if (!roster_find(farm, out) && !is_proved_by_others(farm, claim->key, out))
            break;
    }
    memcpy(roster->taken_base, first, sizeof first);
    roster->taken_to = number;
}

/* ---- marks ----------------------------------------------------------------------------------- */

static struct worker_mark *mark_find(struct roster *roster, const char *name)
{
    for (size_t i = 0; i < roster->mark_count; i++)
        if (strcmp(roster->marks[i].name, name) == 0)
            return &roster->marks[i];
    return NULL;
}

const struct worker_mark *roster_mark(const struct farm *farm, const char *name)
{
    return mark_find((struct roster *)&farm->roster, name);
}

/* The mark that holds for it: its own, or else the block of its key. */
static struct worker_mark *mark_for(struct roster *roster, const char *label)
{
    struct worker_mark *own = mark_find(roster, label);

    for (size_t i = 0; i < roster->mark_count && (!own || !own->blocked); i++)
        if (roster->marks[i].blocked && worker_label_is_of(label, roster->marks[i].name))
            return &roster->marks[i];
    return own;
}

static void mark_remove(struct roster *roster, struct worker_mark *mark)
{
    *mark = roster->marks[--roster->mark_count];
}

static status mark_add(void *user, const struct worker_mark *mark, struct error *err)
{
    struct roster *roster = user;
    struct worker_mark *found = mark_find(roster, mark->name);

    if (!found) {
        NEED(MEM_GROW(roster->marks, roster->mark_capacity, roster->mark_count + 1), err, "a worker's state");
        found = &roster->marks[roster->mark_count++];
    }
    *found = *mark;
    return STATUS_OK;
}

status roster_load(struct farm *farm, struct error *err)
{
    struct error why = {0};

    if (!farm->store)
        return STATUS_OK;
    if (store_workers_begin(farm->store, &why) != STATUS_OK) /* farm_store_check reports it */
        log_debug("%s", why.text);
    return store_worker_marks_load(farm->store, mark_add, &farm->roster, err);
}

void roster_release(struct farm *farm)
{
    mem_free(farm->roster.marks);
    farm->roster.marks = NULL;
    farm->roster.mark_count = farm->roster.mark_capacity = 0;
}

/* ---- joining --------------------------------------------------------------------------------- */

/* What people did to that name, if it was not to an earlier process. */
static void apply_mark(struct farm *farm, struct farm_worker *worker)
{
    struct worker_mark *mark = mark_for(&farm->roster, worker->label);
    struct error err = {0};

    if (!mark)
        return;
    if (mark->blocked || mark->instance == worker->instance) {
        worker->hold = mark->blocked ? WORKER_BLOCKED : WORKER_DRAINED;
        snprintf(worker->held_by, sizeof worker->held_by, "%s", mark->who);
        return;
    }
    /* It was drained, ended, and was started again. */
    if (farm->store && store_worker_unmark(farm->store, worker->label, &err) != STATUS_OK)
        log_warn("worker %s: %s", worker->label, err.text);
    mark_remove(&farm->roster, mark);
}

/* The same process connects again, before its old connection is known to be lost. */
static void replace(struct farm *farm, struct farm_worker *old)
{
    worker_save(farm, old, "it connected again");
    roster_leave(farm, old);
    old->is_replaced = 1;
    lease_end_all_of(&farm->leases, &old->held);
    farm_wake(farm);
}

/* What it would be called if its wish is granted; "": it has none, or one that its key does not prove. */
static void wished_name(const struct worker_claim *claim, char out[WORKER_LABEL_MAX + 1])
{
    const char *wish = claim->wish, *at = strchr(wish, '@');

    out[0] = 0;
    if (wish[0] && !at)
        worker_label_make(out, claim->key, wish);
    else if (at && claim->key[0] && worker_label_is_of(wish, claim->key))
        worker_label_make(out, claim->key, at + 1);
}

status roster_join(struct farm *farm, struct farm_worker *worker, const struct worker_claim *claim,
                   struct farm_worker **replaced, struct error *err)
{
    char name[WORKER_LABEL_MAX + 1], wish[WORKER_LABEL_MAX + 1];
    struct farm_worker *holder;
    int is_others;

    wished_name(claim, wish);
    holder = wish[0] ? roster_find(farm, wish) : NULL;
    is_others = is_proved_by_others(farm, claim->key, wish);
    *replaced = NULL;
    if (is_others && claim->chosen)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the name '%s' belongs to the workers with the key of that name; give this one that key, or another "
                         "--name", wish);
    if (holder && holder->instance == worker->instance)
        *replaced = holder;
    else if (holder && claim->chosen)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the name '%s' belongs to a worker that is connected already (%s, process %u); "
                         "give this one another --name, or wait until that one has left",
                         wish, holder->deliverer.host, holder->deliverer.process);
    if (*replaced)
        replace(farm, holder);
    if (wish[0] && !is_others && (!holder || *replaced))
        snprintf(name, sizeof name, "%s", wish);
    else
        make_name(farm, claim, name);
    take_name(farm, worker, name);
    apply_mark(farm, worker);
    return STATUS_OK;
}

/* ---- what people do -------------------------------------------------------------------------- */

static status clear_mark(struct farm *farm, struct worker_mark *mark, struct error *err)
{
    status s = farm->store ? store_worker_unmark(farm->store, mark->name, err) : STATUS_OK;

    if (s == STATUS_OK)
        mark_remove(&farm->roster, mark);
    return s;
}

/* Forget the oldest drain of a process that is not connected; 0: there is none. */
static int forget_a_drain(struct farm *farm, struct error *err)
{
    struct worker_mark *oldest = NULL;

    for (size_t i = 0; i < farm->roster.mark_count; i++) {
        struct worker_mark *mark = &farm->roster.marks[i];
        if (!mark->blocked && (!oldest || mark->at < oldest->at) && !roster_find(farm, mark->name))
            oldest = mark;
    }
    return oldest && clear_mark(farm, oldest, err) == STATUS_OK;
}

static status set_mark(struct farm *farm, const char *name, int blocked, uint64_t instance, const char *who,
                       struct error *err)
{
    struct worker_mark mark = {.blocked = blocked, .instance = instance, .at = farm->wall_s};
    status s = STATUS_OK;

    snprintf(mark.name, sizeof mark.name, "%s", name);
    snprintf(mark.who, sizeof mark.who, "%s", who);
    if (farm->roster.mark_count >= ROSTER_MARKS_MAX && !roster_mark(farm, name) && !forget_a_drain(farm, err))
        return error_set(err, STATUS_ERR_LIMIT, "%d names of workers are blocked or drained already", ROSTER_MARKS_MAX);
    if (!MEM_GROW(farm->roster.marks, farm->roster.mark_capacity, farm->roster.mark_count + 1))
        return error_no_memory(err, "a worker's state");
    if (farm->store)
        s = store_worker_mark(farm->store, &mark, err);
    return s == STATUS_OK ? mark_add(&farm->roster, &mark, err) : s;
}

/* Nothing but the log needs it: the words of what was done. */
static void tell(struct farm *farm, struct farm_worker *worker, const char *what, const char *who)
{
    char text[WORKER_LINE_SIZE];

    worker_line_add(farm, worker, "%s by %s", what, who);
    snprintf(text, sizeof text, "this worker is %s by %.120s", what, who);
    farm->events.notice(farm->events.user, worker->held.session, text);
}

static void hold(struct farm *farm, struct farm_worker *worker, enum worker_hold how, const char *who)
{
    worker->hold = how;
    snprintf(worker->held_by, sizeof worker->held_by, "%s", who);
    workforce_counts(farm, worker);
    farm_wake(farm);
}

static void revoke_all(struct farm *farm, struct farm_worker *worker)
{
    for (struct lease *lease = farm->leases.oldest, *newer; lease; lease = newer) {
        newer = lease->newer;
        if (lease->holder != &worker->held)
            continue;
        farm->events.revoke(farm->events.user, worker->held.session, lease->id, "the worker is blocked");
        lease_end(&farm->leases, lease);
    }
    farm_wake(farm);
}

static status drain(struct farm *farm, struct farm_worker *worker, const char *who, struct error *err)
{
    if (worker->hold == WORKER_DRAINED)
        return STATUS_OK;
    TRY(set_mark(farm, worker->label, 0, worker->instance, who, err));
    log_info("worker %s: drained by %s", worker->label, who);
    hold(farm, worker, WORKER_DRAINED, who);
    tell(farm, worker, "drained", who);
    return STATUS_OK;
}

/* The next connected worker of that name or key after `worker`, from NULL on. */
static struct farm_worker *next_of(const struct farm *farm, const struct farm_worker *worker, const char *name)
{
    uint32_t bucket = worker ? bucket_of(worker->label) : 0;
    struct farm_worker *next = worker ? worker->same_bucket : farm->roster.by_name[0];

    while (!next || !worker_label_is_of(next->label, name)) {
        if (next)
            next = next->same_bucket;
        else if (++bucket < ROSTER_BUCKETS)
            next = farm->roster.by_name[bucket];
        else
            return NULL;
    }
    return next;
}

int roster_knows(const struct farm *farm, const char *name)
{
    int found = next_of(farm, NULL, name) != NULL;

    for (size_t i = 0; i < farm->roster.mark_count && !found; i++)
        found = worker_label_is_of(farm->roster.marks[i].name, name);
    return found;
}

static status block(struct farm *farm, const char *name, const char *who, struct error *err)
{
    const struct worker_mark *mark = roster_mark(farm, name);

    if (mark && mark->blocked)
        return STATUS_OK;
    TRY(set_mark(farm, name, 1, 0, who, err));
    log_info("worker %s: blocked by %s", name, who);
    for (struct farm_worker *w = next_of(farm, NULL, name); w; w = next_of(farm, w, name)) {
        hold(farm, w, WORKER_BLOCKED, who);
        revoke_all(farm, w);
        tell(farm, w, "blocked", who);
    }
    return STATUS_OK;
}

/* Those of the mark's name are free, unless another mark is theirs. */
static status lift(struct farm *farm, struct worker_mark *mark, const char *what, const char *who, struct error *err)
{
    char name[WORKER_LABEL_MAX + 1];

    snprintf(name, sizeof name, "%s", mark->name);
    TRY(clear_mark(farm, mark, err));
    log_info("worker %s: %s by %s", name, what, who);
    for (struct farm_worker *w = next_of(farm, NULL, name); w; w = next_of(farm, w, name)) {
        const struct worker_mark *left = mark_for(&farm->roster, w->label);
        if (w->hold == WORKER_FREE)
            continue;
        hold(farm, w, !left ? WORKER_FREE : left->blocked ? WORKER_BLOCKED : WORKER_DRAINED, left ? left->who : "");
        if (!left)
            tell(farm, w, what, who);
    }
    return STATUS_OK;
}

static status resume(struct farm *farm, struct farm_worker *worker, struct worker_mark *mark, const char *who,
                     struct error *err)
{
    if (mark && !mark->blocked)
        return lift(farm, mark, "resumed", who, err);
    if (worker && worker->mode == WORKER_MODE_PAUSED)
        return error_set(err, STATUS_ERR_REFUSED,
                         "worker %s paused itself (%s): that ends at its own machine (its hours, its load, or "
                         "SIGUSR2 to process %u)",
                         worker->label, worker->mode_reason, worker->deliverer.process);
    return STATUS_OK;
}

status roster_steer(struct farm *farm, const char *name, enum worker_verb verb, const char *who, struct error *err)
{
    struct worker_mark *mark = mark_for(&farm->roster, name);
    struct farm_worker *worker = roster_find(farm, name);

    if (!worker_label_is_valid(name))
        return error_set(err, STATUS_ERR_INPUT,
                         "'%.64s' is not a worker's name: these have 1 to %d letters, digits, '.', '_' and '-', after 'KEY@' "
                         "where the worker has a key of its own", name, WORKER_NAME_BYTES_MAX);
    if (verb == WORKER_VERB_BLOCK)
        return block(farm, name, who, err);
    if (!worker && !mark)
        return error_set(err, STATUS_ERR_NOT_FOUND, "no worker '%s' is connected, and the name is not blocked", name);
    if (verb == WORKER_VERB_UNBLOCK) {
        if (mark && !mark->blocked)
            return error_set(err, STATUS_ERR_REFUSED, "worker %s is drained, not blocked: 'resume' it", name);
        if (mark && strcmp(mark->name, name) != 0)
            return error_set(err, STATUS_ERR_REFUSED, "worker %s is blocked with all of its key: unblock '%s'", name, mark->name);
        return mark ? lift(farm, mark, "unblocked", who, err) : STATUS_OK;
    }
    if (mark && mark->blocked)
        return error_set(err, STATUS_ERR_REFUSED, "worker %s is blocked by %s and gets no work: unblocking '%s' ends that",
                         name, mark->who, mark->name);
    if (verb == WORKER_VERB_RESUME)
        return resume(farm, worker, mark, who, err);
    if (!worker)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "no worker '%s' is connected: 'block' keeps it from work when it comes", name);
    return drain(farm, worker, who, err);
}

void roster_culprit(const struct farm *farm, const char *name, char out[WORKER_LABEL_MAX + 1])
{
    const struct farm_worker *worker = roster_find(farm, name);
    char key[WORKER_LABEL_MAX + 1];
    int shared = 0, liars = 1;

    snprintf(key, sizeof key, "%.*s", (int)worker_label_key(name), name);
    for (const struct farm_worker *w = next_of(farm, NULL, key); w; w = next_of(farm, w, key))
        shared |= w != worker && (!worker || w->machine != worker->machine);
    for (size_t i = 0; i < farm->roster.mark_count; i++)
        liars += farm->roster.marks[i].blocked && worker_label_is_of(farm->roster.marks[i].name, key);
    snprintf(out, WORKER_LABEL_MAX + 1, "%s", shared && liars < ROSTER_LIARS_OF_KEY ? name : key);
}

void roster_block_liar(struct farm *farm, struct farm_worker *worker, uint64_t job, const char *why)
{
    const struct job *of = queue_find(&farm->queue, job);
    char name[WORKER_LABEL_MAX + 1];
    struct error err = {0};

    roster_culprit(farm, worker->label, name);
    log_error("worker %s is blocked: it sent a result that cannot be: %s; check its machine's memory and processor, then "
              "'azulejo workers unblock %s'",
              worker->label, why, name);
    worker_line_add(farm, worker, "blocked: a result that cannot be: %s", why);
    if (of)
        farm_note(farm, of, NULL, "worker %s is blocked: it sent a result that cannot be: %s", worker->label, why);
    if (roster_steer(farm, name, WORKER_VERB_BLOCK, "the coordinator: an impossible result", &err) != STATUS_OK)
        log_error("worker %s cannot be blocked: %s", name, err.text);
}

/* ---- a worker -------------------------------------------------------------------------------- */

int worker_takes_work(const struct farm_worker *worker)
{
    return worker->hold == WORKER_FREE && worker->mode == WORKER_MODE_WORKING && !worker->is_replaced;
}

void worker_explain(const struct farm_worker *worker, char *out, size_t size)
{
    out[0] = 0;
    if (worker->hold != WORKER_FREE)
        snprintf(out, size, "%s by %s", worker->hold == WORKER_BLOCKED ? "blocked" : "drained", worker->held_by);
    else if (worker->mode != WORKER_MODE_WORKING)
        snprintf(out, size, "%s: %s", worker->mode == WORKER_MODE_PAUSED ? "paused" : "it ends", worker->mode_reason);
}

void worker_line_add(const struct farm *farm, struct farm_worker *worker, const char *format, ...)
{
    struct worker_line *line;
    va_list arguments;

    if (worker->line_count == WORKER_LINES_MAX)
        memmove(worker->lines, worker->lines + 1, --worker->line_count * sizeof *worker->lines);
    line = &worker->lines[worker->line_count++];
    line->at = farm->wall_s;
    va_start(arguments, format);
    vsnprintf(line->text, sizeof line->text, format, arguments);
    va_end(arguments);
    farm_workers_changed(farm);
}

void worker_save(struct farm *farm, struct farm_worker *worker, const char *why)
{
    struct worker_row *row;

    if (!farm->store || !worker->is_named)
        return;
    row = mem_calloc(1, sizeof *row);
    if (!row)
        return; /* the next save has what it did */
    snprintf(row->name, sizeof row->name, "%s", worker->label);
    snprintf(row->host, sizeof row->host, "%s", worker->deliverer.host);
    snprintf(row->address, sizeof row->address, "%s", worker->address);
    snprintf(row->software, sizeof row->software, "%s", worker->deliverer.software);
    snprintf(row->why, sizeof row->why, "%s", why ? why : "");
    row->instance = worker->instance;
    row->process = worker->deliverer.process;
    row->threads = worker->threads;
    row->joined_at = worker->joined_at;
    row->seen_at = farm->wall_s;
    row->left_at = why ? farm->wall_s : 0;
    row->connections = !worker->saved.stored;
    row->units = worker->units_done - worker->saved.units;
    row->samples = worker->samples_done - worker->saved.samples;
    row->cpu_ns = worker->cpu_ns - worker->saved.cpu_ns;
    row->line_count = worker->line_count;
    memcpy(row->lines, worker->lines, sizeof row->lines);
    store_worker_later(farm->store, row);
    worker->saved.stored = 1;
    worker->saved.units = worker->units_done;
    worker->saved.samples = worker->samples_done;
    worker->saved.cpu_ns = worker->cpu_ns;
    mem_free(row);
}
