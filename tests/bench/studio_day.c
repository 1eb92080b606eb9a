/* studio_day: a day in a studio, simulated twice: first come, first served, and in the order of
 * coordinator/job/order.h. The coordinator's own logic runs under a simulated clock; workers are structs
 * whose results take as long as the job's cost says. Prints the table of docs/OPERATIONS.md.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/scheduler.h"
#include "tests/support/sim_farm.h"

enum {
    SIDE = 64, SPP = 16,         /* of each frame: 96 units */
    MACHINE_THREADS = 8,
    DAY_S = 24 * 3600,
    FIRST_S = 9 * 3600,          /* the day begins at 9:00 */
    WALL_S = 1000000,
    LEASE_S = 1800,
    HOURS_SIZE = 24,
};

static int64_t at(int hour, int minute) { return hour * 3600 + minute * 60; }

/* What people submit; times are of the day, above 24:00 of the next one. */
struct plan {
    const char *owner, *name;
    int hour, minute;
    uint32_t frames;
    double core_hours; /* all frames together */
    int32_t priority;
    int not_before;    /* hour; 0: at once */
    const char *after; /* a job's name; NULL: none */
};

static const struct plan day[] = {
    {"ben", "walk", 9, 10, 120, 240, 0, 0, NULL},
    {"ana", "light 1", 9, 30, 1, 0.3, 0, 0, NULL},
    {"ana", "light 2", 10, 15, 1, 0.3, 0, 0, NULL},
    {"cat", "plates", 10, 30, 20, 12, 0, 0, NULL},
    {"cat", "plates, graded", 10, 31, 20, 6, 0, 0, "plates"},
    {"ana", "light 3", 11, 0, 1, 0.3, 0, 0, NULL},
    {"ana", "turntable", 11, 45, 36, 9, 0, 0, NULL},
    {"ana", "light 4", 13, 45, 1, 0.3, 0, 0, NULL},
    {"ben", "run", 14, 0, 60, 90, 0, 0, NULL},
    {"ana", "light 5", 14, 30, 1, 0.3, 0, 0, NULL},
    {"cat", "trailer", 15, 0, 24, 20, 10, 0, NULL},
    {"ana", "light 6", 16, 0, 1, 0.3, 0, 0, NULL},
    {"cat", "titles", 16, 30, 30, 5, 0, 0, NULL},
    {"ana", "light 7", 17, 0, 1, 0.3, 0, 0, NULL},
    {"ben", "crowd", 17, 30, 90, 120, 0, 20, NULL},
    {"cat", "noon", 17, 45, 48, 40, 0, 0, NULL},
};
enum { JOBS = sizeof day / sizeof day[0] };

/* Which machines are there: 5 all day, 2 desktops at night; 2 of the 5 are away over noon. */
static int is_there(unsigned machine, int64_t now)
{
    if (machine >= 5)
        return now >= at(18, 30) && now < at(32, 0);
    if (machine >= 3)
        return now < at(12, 0) || now >= at(13, 0);
    return 1;
}
enum { MACHINES = 7 };

static int disk_is_full(int64_t now) { return now >= at(13, 0) && now < at(13, 30); }

struct running {
    struct sim_unit unit;
    uint64_t end_ns;
};

struct machine {
    struct running running[MACHINE_THREADS];
    unsigned count;
};

struct outcome {
    int64_t submitted, begun, done; /* seconds of the day; 0: not yet */
};

struct studio {
    struct sim *sim;
    int fair;
    struct job *jobs[JOBS];
    uint64_t cost_ns[JOBS + 1]; /* of a sample, by the job's number */
    struct outcome outcomes[JOBS];
    struct machine machines[MACHINES];
    double busy_s, there_s;
};

static int same(const struct sim_unit *a, const struct sim_unit *b)
{
    return a->job == b->job && a->frame == b->frame && a->name.tile == b->name.tile && a->name.group == b->name.group &&
           a->name.pass == b->name.pass && a->lease == b->lease;
}

static size_t find(const struct sim_worker *worker, const struct sim_unit *unit)
{
    for (size_t i = 0; i < worker->unit_count; i++)
        if (same(&worker->units[i], unit))
            return i;
    return SIZE_MAX;
}

/* Deliver what has ended; forget what was revoked. */
static void end_units(struct studio *s, unsigned m)
{
    struct sim_worker *worker = &s->sim->workers[m];
    struct machine *machine = &s->machines[m];

    for (unsigned i = machine->count; i-- > 0;) {
        size_t place = find(worker, &machine->running[i].unit);
        enum merge_outcome outcome;
        if (place != SIZE_MAX && machine->running[i].end_ns > s->sim->now_ns)
            continue;
        if (place != SIZE_MAX) {
            outcome = sim_send(s->sim, worker, place, s->cost_ns[machine->running[i].unit.job]);
            place = find(worker, &machine->running[i].unit);
            if (outcome != MERGE_PENDING && place != SIZE_MAX)
                sim_forget(worker, place);
        }
        machine->running[i] = machine->running[--machine->count];
    }
}

static int is_running(const struct machine *machine, const struct sim_unit *unit)
{
    for (unsigned i = 0; i < machine->count; i++)
        if (same(&machine->running[i].unit, unit))
            return 1;
    return 0;
}

/* The unit that was lent first and has not begun. */
static const struct sim_unit *next_unit(const struct sim_worker *worker, const struct machine *machine)
{
    const struct sim_unit *next = NULL;

    for (size_t i = 0; i < worker->unit_count; i++) {
        const struct sim_unit *unit = &worker->units[i];
        if (!unit->sent && (!next || unit->lease < next->lease) && !is_running(machine, unit))
            next = unit;
    }
    return next;
}

static void begin_units(struct studio *s, unsigned m)
{
    struct sim_worker *worker = &s->sim->workers[m];
    struct machine *machine = &s->machines[m];
    const struct sim_unit *unit;
    uint32_t waiting = 0, begin, end;

    for (size_t i = 0; i < worker->unit_count; i++)
        waiting += !worker->units[i].sent;
    if (waiting < 2 * MACHINE_THREADS)
        sim_grant(s->sim, worker, 2 * MACHINE_THREADS - waiting);
    while (machine->count < MACHINE_THREADS && (unit = next_unit(worker, machine))) {
        double seconds;
        pass_range(SPP, unit->name.group, unit->name.pass, &begin, &end);
        seconds = 256.0 * (end - begin) * (double)s->cost_ns[unit->job] * 1e-9;
        machine->running[machine->count++] = (struct running){*unit, s->sim->now_ns + (uint64_t)(seconds * 1e9)};
    }
    s->busy_s += machine->count;
    s->there_s += MACHINE_THREADS;
}

static void submit(struct studio *s, size_t i, int64_t now)
{
    const struct plan *plan = &day[i];
    struct job *job = sim_job(SIDE, SIDE, SPP, 1, plan->frames, plan->priority);

    snprintf(job->owner, sizeof job->owner, "%s@studio", plan->owner);
    snprintf(job->name, sizeof job->name, "%s", plan->name);
    if (tonemap_settings_init(&job->output.tonemap, "linear", NULL) != STATUS_OK)
        abort();
    for (size_t k = 0; s->fair && plan->after && k < i; k++)
        if (strcmp(day[k].name, plan->after) == 0)
            job->needs.after[job->needs.after_count++] = s->jobs[k]->id;
    if (s->fair && plan->not_before)
        job->needs.not_before = WALL_S + at(plan->not_before, 0);
    if (farm_submit(&s->sim->farm, job, NULL) != STATUS_OK)
        abort();
    s->jobs[i] = job;
    s->cost_ns[job->id] = (uint64_t)(plan->core_hours * 3600 * 1e9 / ((double)plan->frames * SIDE * SIDE * SPP));
    s->outcomes[i].submitted = now;
}

static void note_outcomes(struct studio *s, int64_t now)
{
    for (size_t i = 0; i < JOBS; i++) {
        if (!s->jobs[i])
            continue;
        if (!s->outcomes[i].begun && s->jobs[i]->state != JOB_STATE_QUEUED)
            s->outcomes[i].begun = now;
        if (!s->outcomes[i].done && s->jobs[i]->state == JOB_STATE_DONE)
            s->outcomes[i].done = now;
    }
}

static void come_and_go(struct studio *s, int64_t now)
{
    struct sim *sim = s->sim;

    for (unsigned m = 0; m < MACHINES; m++) {
        if (is_there(m, now) && !sim->workers[m].connected)
            sim_connect(sim, m, MACHINE_THREADS);
        if (is_there(m, now) || !sim->workers[m].connected)
            continue;
        sim_disconnect(sim, m);
        sim->workers[m].unit_count = 0;
        s->machines[m].count = 0;
    }
    if (disk_is_full(now) && !trouble_is(&sim->farm.trouble))
        trouble_note(&sim->farm.trouble, "No space left on device", sim->now_ns);
    if (!disk_is_full(now) && trouble_is(&sim->farm.trouble)) {
        uint64_t lasted_ns;
        trouble_end(&sim->farm.trouble, sim->now_ns, &lasted_ns);
    }
}

static int second(struct studio *s, int64_t now)
{
    struct sim *sim = s->sim;

    sim->now_ns += NS_PER_SECOND;
    sim->farm.wall_s = WALL_S + now;
    come_and_go(s, now);
    for (size_t i = 0; i < JOBS; i++)
        if (!s->jobs[i] && now >= at(day[i].hour, day[i].minute))
            submit(s, i, now);
    for (unsigned m = 0; m < MACHINES; m++)
        if (sim->workers[m].connected)
            end_units(s, m);
    sim_freeze(sim);
    sim_commit(sim);
    sim_develop(sim);
    farm_tick(&sim->farm, sim->now_ns);
    for (unsigned m = 0; m < MACHINES; m++)
        if (sim->workers[m].connected)
            begin_units(s, m);
    note_outcomes(s, now);
    return s->jobs[JOBS - 1] && sim->farm.queue.active_count == 0;
}

static void run(struct studio *s, int fair)
{
    memset(s, 0, sizeof *s);
    s->fair = fair;
    s->sim = sim_new(NULL, 1);
    s->sim->farm.leases.duration_ns = (uint64_t)LEASE_S * NS_PER_SECOND;
    if (!fair)
        s->sim->farm.order.rules = (struct order_rules){0, 0};
    for (int64_t now = FIRST_S; !second(s, now); now++)
        if (now > FIRST_S + 2 * DAY_S) {
            fprintf(stderr, "studio_day: not all jobs ended within two days\n");
            exit(1);
        }
    if (s->sim->wrong_frames > 0) {
        fprintf(stderr, "studio_day: %zu pictures are wrong\n", s->sim->wrong_frames);
        exit(1);
    }
}

/* "1:07" in hours and minutes. */
static const char *hours(char out[HOURS_SIZE], int64_t seconds)
{
    int64_t minutes = (seconds + 30) / 60;

    snprintf(out, HOURS_SIZE, "%lld:%02lld", (long long)(minutes / 60), (long long)(minutes % 60));
    return out;
}

static void print_owner(const struct studio *before, const struct studio *after, const char *owner)
{
    const struct studio *both[2] = {before, after};
    char mean[2][HOURS_SIZE], longest[2][HOURS_SIZE], done[2][HOURS_SIZE];

    for (int k = 0; k < 2; k++) {
        int64_t sum = 0, most = 0, done_sum = 0, count = 0;
        for (size_t i = 0; i < JOBS; i++) {
            const struct outcome *o = &both[k]->outcomes[i];
            int64_t wait = o->begun - o->submitted;
            if (strcmp(day[i].owner, owner) != 0 || day[i].not_before || day[i].after)
                continue;
            sum += wait;
            done_sum += o->done - o->submitted;
            most = wait > most ? wait : most;
            count++;
        }
        hours(mean[k], sum / count);
        hours(longest[k], most);
        hours(done[k], done_sum / count);
    }
    printf("| %s | %s | %s | %s | %s | %s | %s |\n", owner, mean[0], mean[1], longest[0], longest[1], done[0], done[1]);
}

int main(void)
{
    static struct studio before, after;
    char a[HOURS_SIZE], b[HOURS_SIZE], c[HOURS_SIZE], d[HOURS_SIZE], when[HOURS_SIZE];

    log_setup("studio_day", LOG_LEVEL_ERROR);
    run(&before, 0);
    run(&after, 1);
    printf("| owner | job | submitted | frames, core-hours | waits: before | now | done after: before | now |\n"
           "|---|---|---|---|---:|---:|---:|---:|\n");
    for (size_t i = 0; i < JOBS; i++) {
        const struct outcome *o = &before.outcomes[i], *n = &after.outcomes[i];
        char extra[64] = "";
        if (day[i].priority)
            snprintf(extra, sizeof extra, ", priority %d", day[i].priority);
        if (day[i].not_before)
            snprintf(extra, sizeof extra, ", not before %d:00", day[i].not_before);
        if (day[i].after)
            snprintf(extra, sizeof extra, ", after *%s*", day[i].after);
        printf("| %s | %s%s | %s | %u, %g | %s | %s | %s | %s |\n", day[i].owner, day[i].name, extra,
               hours(when, o->submitted), day[i].frames, day[i].core_hours, hours(a, o->begun - o->submitted),
               hours(b, n->begun - n->submitted), hours(c, o->done - o->submitted), hours(d, n->done - n->submitted));
    }
    printf("\n| owner | mean wait: before | now | longest wait: before | now | mean until done: before | now |\n"
           "|---|---:|---:|---:|---:|---:|---:|\n");
    print_owner(&before, &after, "ana");
    print_owner(&before, &after, "ben");
    print_owner(&before, &after, "cat");
    printf("\nThreads were busy for %.1f %% of the time before, %.1f %% now.\n", 100 * before.busy_s / before.there_s,
           100 * after.busy_s / after.there_s);
    sim_free(before.sim);
    sim_free(after.sim);
    return 0;
}
