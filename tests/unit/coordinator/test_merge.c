/* Merging: acknowledged only when durable; random farms end with exactly the right films. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/steering/report.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/store/store.h"
#include "coordinator/film/store_film.h"
#include "tests/support/figure.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/sim_farm.h"

enum { WIDTH = 40, HEIGHT = 24, SPP = 100, FRAMES = 3 }; /* 6 tiles, edges on two sides, 8 passes of 2 groups */

static void acknowledged_when_durable(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct commit *commit;
    size_t late = 0;

    (void)state;
    sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    assert_int_equal(sim_grant(sim, worker, 36), 36);
    /* Pass 1 of tile 0 first: it waits for pass 0, and is not acknowledged although time passes. */
    while (worker->units[late].name.tile != 0 || worker->units[late].name.pass != 1)
        late++;
    assert_int_equal(sim_send(sim, worker, late, 100), MERGE_PENDING);
    assert_null(merge_commit_begin(&sim->farm, sim->now_ns));
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING); /* pass 0 of tile 0 */
    assert_int_equal(sim_send(sim, worker, 1, 100), MERGE_PENDING); /* of tile 1 */
    commit = merge_commit_begin(&sim->farm, sim->now_ns);
    assert_non_null(commit);
    assert_int_equal(commit->count, 2);
    merge_commit_run(commit);
    assert_int_equal(sim_send(sim, worker, 2, 100), MERGE_PENDING); /* while the disk works */
    assert_int_equal(sim->acks, 0);
    merge_commit_end(&sim->farm, commit, sim->now_ns);
    assert_int_equal(sim->acks, 3);
    sim_commit(sim);
    assert_int_equal(sim->acks, 4);
    sim_free(sim);
}

static void the_disk_sets_the_pace(void **state)
{
    (void)state;
    assert_int_equal(merge_delay_ns(0), COMMIT_DELAY_MIN_MS * NS_PER_MS);
    assert_int_equal(merge_delay_ns(60 * NS_PER_MS), COMMIT_DELAY_MIN_MS * NS_PER_MS);
    assert_int_equal(merge_delay_ns(70 * NS_PER_MS), COMMIT_DELAY_SYNCS * 70 * NS_PER_MS);
    assert_int_equal(merge_delay_ns(250 * NS_PER_MS), COMMIT_DELAY_MAX_MS * NS_PER_MS);
    assert_int_equal(merge_delay_ns(UINT64_MAX), COMMIT_DELAY_MAX_MS * NS_PER_MS);
}

/* A slow disk makes batches larger, but a complete frame waits for nobody. */
static void a_complete_frame_does_not_wait(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 4);
    uint64_t due_ns, since_ns;
    struct commit *commit;
    uint32_t tiles;

    (void)state;
    sim_submit(sim, 32, 16, 1, 1, 1, 0); /* two units */
    assert_int_equal(sim_grant(sim, worker, 4), 2);
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING);
    commit = merge_commit_begin(&sim->farm, sim->now_ns);
    commit->sync_ns = 100 * NS_PER_MS;
    merge_commit_end(&sim->farm, commit, sim->now_ns);
    since_ns = sim->now_ns += 10 * NS_PER_SECOND;
    assert_false(merge_is_dirty(&sim->farm, &due_ns, &tiles));
    job_frame_mark_dirty(sim->farm.queue.active[0]->frames, 0, since_ns);
    assert_true(merge_is_dirty(&sim->farm, &due_ns, &tiles));
    assert_int_equal(due_ns, since_ns + COMMIT_DELAY_SYNCS * 100 * NS_PER_MS);
    sim->farm.queue.active[0]->frames->begun_ns = since_ns - 200 * NS_PER_MS; /* it is young */
    assert_true(merge_is_dirty(&sim->farm, &due_ns, &tiles));
    assert_int_equal(due_ns, since_ns + 200 * NS_PER_MS / COMMIT_DELAY_AGES);
    assert_int_equal(sim_send(sim, worker, 1, 100), MERGE_PENDING); /* the last result */
    assert_true(merge_is_dirty(&sim->farm, &due_ns, &tiles));
    assert_true(due_ns <= sim->now_ns);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(sim->developed, 1);
    sim_free(sim);
}

static void a_repeated_result_is_kept_or_pending(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 8);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    struct sim_unit copy;

    (void)state;
    sim_grant(sim, worker, 8);
    copy = worker->units[0];
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING);
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING); /* again, not durable yet */
    sim_commit(sim);
    assert_int_equal(sim->acks, 2);
    worker->units[worker->unit_count++] = copy;
    assert_int_equal(sim_send(sim, worker, worker->unit_count - 1, 100), MERGE_KEPT);
    assert_int_equal(film_work(job->frames->film).samples, 16 * 16 * 2); /* counted once */
    assert_int_equal(job->conflicts, 0);
    sim_free(sim);
}

static void a_conflict_is_reported_and_the_first_kept(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 96);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    float sums[TILE_FLOATS_MAX];
    struct delivery result;
    struct merge_conflict conflict = {0};
    enum merge_outcome outcome;

    (void)state;
    assert_int_equal(sim_grant(sim, worker, 96), 96);
    result = sim_result(sim, &worker->units[0], sums);
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING);
    sums[0] = nextafterf(sums[0], 0);
    assert_int_equal(merge_result(&sim->farm, &worker->worker, &result, sim->now_ns, &outcome, &conflict, NULL), STATUS_OK);
    assert_true(conflict.found); /* others decide: who came first is known by its number and hash */
    assert_int_equal(conflict.deliverer, film_deliverer(job->frames->film, result.unit.tile, result.unit.group, result.unit.pass));
    assert_int_equal(conflict.hash, film_unit_hash(job->frames->film, result.unit.tile, result.unit.group, result.unit.pass));
    assert_true(conflict.deliverer != 0 && conflict.hash != 0);
    assert_int_equal(job->conflicts, 1);
    assert_int_equal(sim->farm.conflicts, 1);
    for (size_t i = 1; i < worker->unit_count; i++)
        sim_send(sim, worker, i, 100);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_int_equal(sim->wrong_frames, 0);
    sim_free(sim);
}

/* Counters that are too many for the unit, or whose example is missing or another unit's. */
static void check_health(struct sim *sim, struct sim_worker *worker, const struct sim_unit *unit, enum health_kind kind)
{
    static float sums[TILE_FLOATS_MAX];
    struct delivery result = sim_result(sim, unit, sums);
    struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, unit->name.tile);
    const uint32_t g = unit->name.group, pixels = rect.width * rect.height;
    const uint64_t samples = result.unit.work.samples, end = samples / pixels;
    uint32_t begin, stop;
    enum merge_outcome outcome;
    struct error err = {0};

    pass_range(SPP, g, unit->name.pass, &begin, &stop);
    const struct health_place here = {unit->name.pass, unit->name.tile, 0, begin * GROUPS + g};
    const uint64_t most = health_rows[kind].limit == HEALTH_LIMIT_SAMPLES  ? samples
                          : health_rows[kind].limit == HEALTH_LIMIT_VALUES ? result.unit.count
                                                                           : samples << 20;
    const struct health_place bad[] = {
        {here.pass + 1, here.tile, 0, here.sample},
        {here.pass, here.tile + 1, 0, here.sample},
        {here.pass, here.tile, pixels, here.sample},
        {here.pass, here.tile, 0, here.sample + 1},
        {here.pass, here.tile, 0, here.sample + GROUPS * (uint32_t)end},
    };
#define TAKE(n, key, in_frame)                                                                         \
    (result.unit.work.health.count[kind] = (n), result.unit.work.health.first[kind] = (key),                     \
     result.unit.work.health.frame[kind] = (in_frame),                                                      \
     merge_result(&sim->farm, &worker->worker, &result, sim->now_ns, &outcome, NULL, &err))
    assert_int_equal(TAKE(1, 0, 0), STATUS_ERR_PROTOCOL);
    assert_int_equal(TAKE(1, health_key(here), 1), STATUS_ERR_PROTOCOL);
    assert_int_equal(TAKE(most + 1, health_key(here), 0), STATUS_ERR_PROTOCOL);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (bad[i].pixel < TILE_PIXELS_MAX)
            assert_int_equal(TAKE(1, health_key(bad[i]), 0), STATUS_ERR_PROTOCOL);
    assert_int_equal(TAKE(most, health_key(here), 0), STATUS_OK);
#undef TAKE
}

static void hostile_health_is_refused(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 64);
    int smaller = 0;

    (void)state;
    sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    sim_grant(sim, worker, 64);
    assert_true(worker->unit_count > HEALTH_KINDS);
    for (size_t i = 0; i < worker->unit_count; i++) {
        struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, worker->units[i].name.tile);
        smaller |= rect.width * rect.height < TILE_PIXELS_MAX;
        check_health(sim, worker, &worker->units[i], (enum health_kind)(i % HEALTH_KINDS));
    }
    assert_true(smaller); /* a pixel beyond its end was tried */
    sim_free(sim);
}

static void hostile_results_are_refused(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 8);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    float sums[TILE_FLOATS_MAX + 2] = {0};
    struct delivery good, bad;
    enum merge_outcome outcome = MERGE_KEPT;
    struct error err = {0};

    (void)state;
    sim_grant(sim, worker, 8);
    good = sim_result(sim, &worker->units[0], sums);
#define REFUSED(change)                                                                       \
    do {                                                                                      \
        bad = good;                                                                           \
        change;                                                                               \
        assert_int_equal(merge_result(&sim->farm, &worker->worker, &bad, sim->now_ns, &outcome, \
                                      NULL, &err),                                            \
                         STATUS_ERR_PROTOCOL);                                                \
    } while (0)
    REFUSED(bad.epoch = sim->farm.leases.epoch + 1);
    REFUSED(bad.epoch = 0);
    REFUSED(bad.epoch = UINT64_MAX);
    REFUSED(bad.unit.tile = 6);
    REFUSED(bad.unit.tile = UINT32_MAX);
    REFUSED(bad.unit.group = GROUPS);
    REFUSED(bad.unit.group = UINT32_MAX);
    REFUSED(bad.unit.pass = 8);
    REFUSED(bad.unit.pass = UINT32_MAX);
    REFUSED(bad.unit.work.samples++);
    REFUSED(bad.unit.work.samples = 0);
    REFUSED(bad.unit.work.dropped_samples = bad.unit.work.samples + 1);
    REFUSED(bad.unit.work.vertices = (uint64_t)1 << 60);
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        REFUSED(bad.unit.work.count[i] = UINT64_MAX);
    REFUSED(bad.unit.work.clamped_values = UINT32_MAX);
    REFUSED(bad.unit.tail.count = TAIL_MAX + 1);
    REFUSED(bad.unit.tail = ((struct tail){1, {{NAN, 0, 0}}}));
    REFUSED(bad.unit.tail = ((struct tail){1, {{1, 256, 0}}}));
    REFUSED(bad.unit.tail = ((struct tail){2, {{1, 0, 0}, {2, 0, 0}}}));
    REFUSED(bad.unit.tail = ((struct tail){2, {{1, 1, 0}, {1, 0, 0}}}));
    REFUSED(bad.unit.count--);
    REFUSED(bad.unit.count++);
    REFUSED(bad.unit.count = 0);
    REFUSED(bad.unit.count = (size_t)1 << 38);
    REFUSED(bad.unit.work.clamped_samples = bad.unit.work.samples + 1);
    REFUSED(bad.unit.work.clamped_luminance = NAN);
    REFUSED(bad.unit.work.clamped_luminance = -1);
    REFUSED(bad.unit.work.kept_luminance = INFINITY);
    REFUSED(bad.stats.cpu_ns = UINT64_MAX);
    REFUSED(bad.stats.cpu_ns = MERGE_CPU_SLACK_S * NS_PER_SECOND + 1);
    for (int i = 0; i < DEPTH_SUMS; i++) {
        REFUSED(bad.unit.work.depth.sum[i] = -1);
        REFUSED(bad.unit.work.depth.sum[i] = NAN);
    }
    sums[10] = NAN;
    REFUSED((void)0);
#undef REFUSED
    assert_int_equal(film_work(job->frames->film).samples, 0);
    assert_null(merge_commit_begin(&sim->farm, sim->now_ns));
    sim_free(sim);
}

/* Only its holder sends results under a lease, of units that it lends; once it has ended, times alone are limited. */
static void a_lease_is_its_holders(void **state)
{
    struct sim *sim = sim_new(NULL, 2);
    struct sim_worker *holder = sim_connect(sim, 0, 8), *other = sim_connect(sim, 1, 8);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    float sums[TILE_FLOATS_MAX];
    struct delivery result, moved;
    enum merge_outcome outcome = MERGE_KEPT;
    struct error err = {0};

    (void)state;
    sim_grant(sim, holder, 2);
    sim_grant(sim, other, 2);
    result = sim_result(sim, &holder->units[0], sums);
    assert_int_equal(merge_result(&sim->farm, &other->worker, &result, sim->now_ns, &outcome, NULL, &err), STATUS_ERR_PROTOCOL);
    assert_int_equal(outcome, MERGE_IMPOSSIBLE);
    assert_non_null(strstr(err.text, "another worker holds"));
    moved = sim_result(sim, &other->units[0], sums);
    moved.lease = result.lease;
    moved.epoch = result.epoch;
    assert_int_equal(merge_result(&sim->farm, &holder->worker, &moved, sim->now_ns, &outcome, NULL, &err), STATUS_ERR_PROTOCOL);
    assert_int_equal(outcome, MERGE_IMPOSSIBLE);
    assert_non_null(strstr(err.text, "not a unit of lease"));
    assert_int_equal(film_work(job->frames->film).samples, 0);
    lease_end_all_of(&sim->farm.leases, &holder->worker.held);
    result = sim_result(sim, &holder->units[0], sums);
    result.stats.cpu_ns = UINT64_MAX;
    result.stats.trace_ns = UINT64_MAX;
    assert_int_equal(merge_result(&sim->farm, &holder->worker, &result, sim->now_ns, &outcome, NULL, &err), STATUS_OK);
    assert_int_equal(outcome, MERGE_PENDING);
    assert_int_equal(sim->farm.counts.cpu_ns, MERGE_CPU_SLACK_S * NS_PER_SECOND);
    assert_int_equal(job->stats.trace_ns, MERGE_CPU_SLACK_S * NS_PER_SECOND);
    sim_free(sim);
}

/* The share of the light that --clamp took away is told in the summary: one infinity would make it NaN. */
static void an_infinite_amount_is_refused(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 8);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    float sums[TILE_FLOATS_MAX];
    struct unit_work work;
    struct delivery bad;
    enum merge_outcome outcome;

    (void)state;
    sim_grant(sim, worker, 8);
    bad = sim_result(sim, &worker->units[0], sums);
    bad.unit.work.clamped_samples = 1;
    bad.unit.work.clamped_luminance = INFINITY;
    (void)!merge_result(&sim->farm, &worker->worker, &bad, sim->now_ns, &outcome, NULL, NULL);
    sim_send(sim, worker, 1, 100);
    work = film_work(job->frames->film);
    figure_within("share of the light that was clamped, after a result of infinity", unit_work_clamped_share(&work), 0,
                  1, "a share");
    sim_free(sim);
}

static void unwanted_results_are_sent_away(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 8);
    struct job *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0), *later;
    float sums[TILE_FLOATS_MAX];
    struct delivery result;
    enum merge_outcome outcome;

    (void)state;
    sim_grant(sim, worker, 8);
    result = sim_result(sim, &worker->units[0], sums);
#define OUTCOME_OF(r)                                                                        \
    (assert_int_equal(                                                                       \
         merge_result(&sim->farm, &worker->worker, &(r), sim->now_ns, &outcome, NULL, NULL), STATUS_OK), \
     outcome)
    result.job = 77;
    assert_int_equal(OUTCOME_OF(result), MERGE_UNWANTED);
    result.job = job->id;
    result.frame = 2;
    assert_int_equal(OUTCOME_OF(result), MERGE_UNWANTED);
    result.frame = 1;
    /* An epoch from before the job: another store's, or another time's. */
    later = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    result.job = later->id;
    assert_int_equal(OUTCOME_OF(result), MERGE_UNWANTED);
    result.job = job->id;
    /* A worker with another ray tracer never got units of this job. */
    snprintf(worker->worker.ray_tracer, sizeof worker->worker.ray_tracer, "tracer 2");
    assert_int_equal(OUTCOME_OF(result), MERGE_UNWANTED);
    snprintf(worker->worker.ray_tracer, sizeof worker->worker.ray_tracer, "tracer 1");
    /* A lease that has ended does not make a result bad. */
    lease_end_all_of(&sim->farm.leases, &worker->worker.held);
    assert_int_equal(OUTCOME_OF(result), MERGE_PENDING);
    farm_cancel(&sim->farm, job, 1, sim->now_ns);
    assert_int_equal(OUTCOME_OF(result), MERGE_UNWANTED);
#undef OUTCOME_OF
    sim_free(sim);
}

/* Random events: results in any order, repeated, late; workers that die with unsent or
 * unacknowledged results and come back; returned units; lapsed leases; commits that overlap with
 * results. With a store, the coordinator itself is killed now and then. */
static struct sim *random_farm(uint64_t seed, const char *folder, size_t *crashes)
{
    struct store *store = folder ? sim_store(folder) : NULL;
    struct sim *sim = sim_new(store, seed);
    struct commit *commit = NULL;
    uint64_t id;

    if (seed % 4 != 0) /* with a display that is measured while results come */
        sim->tonemap = seed % 4 == 1 ? "reinhard02" : seed % 4 == 2 ? "normalize" : "mantiuk08";
    id = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, FRAMES, 0)->id;
    for (size_t step = 0; step < 200000; step++) {
        unsigned w = sim_random(sim, 4);
        struct sim_worker *worker = &sim->workers[w];
        struct job *job = queue_find(&sim->farm.queue, id);
        assert_non_null(job);
        if (job_state_ended(job->state))
            break;
        sim->now_ns += sim_random(sim, 50) * NS_PER_MS;
        if (!worker->connected) {
            if (sim_random(sim, 4) == 0) {
                sim_connect(sim, w, 1 + sim_random(sim, 8));
                for (size_t i = worker->unit_count; i-- > 0;) /* what was not acknowledged */
                    if (i < worker->unit_count && worker->units[i].sent &&
                        sim_send(sim, worker, i, 1000) != MERGE_PENDING)
                        sim_forget(worker, i);
            }
            continue;
        }
        switch (sim_random(sim, 24)) {
        case 0: /* dies; what it had not sent is gone */
            sim_disconnect(sim, w);
            for (size_t i = worker->unit_count; i-- > 0;)
                if (!worker->units[i].sent || sim_random(sim, 2))
                    sim_forget(worker, i);
            break;
        case 1: { /* gives some back */
            for (size_t i = worker->unit_count; i-- > 0;) {
                struct lease *lease;
                if (worker->units[i].sent || sim_random(sim, 2))
                    continue;
                lease = lease_find(&sim->farm.leases, worker->units[i].lease, 0);
                if (lease)
                    lease_return_unit(&sim->farm.leases, lease, worker->units[i].name);
                sim_forget(worker, i);
            }
            break;
        }
        case 2:
            sim->now_ns += sim_random(sim, 12) * NS_PER_SECOND;
            farm_tick(&sim->farm, sim->now_ns);
            break;
        case 3:
        case 4:
            if (!commit) {
                commit = merge_commit_begin(&sim->farm, sim->now_ns);
                break;
            }
            merge_commit_run(commit);
            merge_commit_end(&sim->farm, commit, sim->now_ns);
            commit = NULL;
            break;
        case 5:
            sim_develop(sim);
            if (sim_random(sim, 2))
                sim_freeze(sim);
            break;
        case 6:
            if (!store || sim_random(sim, 6))
                break;
            /* kill -9 of the coordinator: a commit in flight may or may not have been written. */
            if (commit) {
                if (sim_random(sim, 2))
                    merge_commit_run(commit);
                merge_commit_abandon(&sim->farm, commit);
                commit = NULL;
            }
            sim_release(sim);
            store_close(store);
            store = sim_store(folder);
            sim_init(sim, store, seed * 1000 + step);
            (*crashes)++;
            break;
        case 7:
        case 8:
        case 9: sim_grant(sim, worker, 1 + sim_random(sim, 12)); break;
        default:
            if (worker->unit_count > 0) {
                size_t i = sim_random(sim, (uint32_t)worker->unit_count);
                if (sim_send(sim, worker, i, 1000) != MERGE_PENDING)
                    sim_forget(worker, i);
            }
            break;
        }
    }
    if (commit) {
        merge_commit_run(commit);
        merge_commit_end(&sim->farm, commit, sim->now_ns);
    }
    return sim;
}

static void random_farms_end_right(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 300; seed++) {
        struct sim *sim = random_farm(seed, NULL, NULL);
        const struct job *job = queue_find(&sim->farm.queue, 1);
        if (job->state != JOB_STATE_DONE)
            fail_msg("seed %u: the job is %s", (unsigned)seed, job_state_word(job->state));
        assert_int_equal(sim->wrong_frames, 0);
        assert_int_equal(sim->developed, FRAMES);
        /* Every unit was merged exactly once. */
        assert_int_equal(job->work.samples, (uint64_t)WIDTH * HEIGHT * SPP * FRAMES);
        assert_int_equal(job->conflicts, 0);
        assert_int_equal(sim->farm.leases.count, 0);
        sim_free(sim);
    }
}

static void random_crashes_lose_nothing(void **state)
{
    size_t crashes = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 25; seed++) {
        char folder[SCRATCH_PATH];
        struct sim *sim;
        struct store *store;
        const struct job *job;
        scratch_folder(folder);
        sim = random_farm(seed, folder, &crashes);
        job = queue_find(&sim->farm.queue, 1);
        if (job->state != JOB_STATE_DONE)
            fail_msg("seed %u: the job is %s", (unsigned)seed, job_state_word(job->state));
        assert_int_equal(sim->wrong_frames, 0);
        assert_int_equal(job->frames_done_count, FRAMES);
        assert_int_equal(job->conflicts, 0);
        store = sim->store;
        sim_free(sim);
        store_close(store);
        file_remove_tree(folder);
    }
    assert_true(crashes > 25);
}

/* Which of the worker's units comes first in the order of granting. */
static size_t earliest(const struct sim_worker *worker)
{
    size_t best = 0;

    for (size_t i = 1; i < worker->unit_count; i++) {
        struct unit_name a = worker->units[i].name, b = worker->units[best].name;
        if (a.pass < b.pass || (a.pass == b.pass && (a.group < b.group || (a.group == b.group && a.tile < b.tile))))
            best = i;
    }
    return best;
}

/* What was acknowledged is in the film after a crash. */
static void acknowledged_results_survive(void **state)
{
    char folder[SCRATCH_PATH];
    struct store *store;
    struct sim *sim;
    struct sim_worker *worker;
    const struct job *job;
    char text[DELIVERER_TEXT_MAX];
    uint32_t number;
    size_t durable;

    (void)state;
    scratch_folder(folder);
    store = sim_store(folder);
    sim = sim_new(store, 1);
    sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    worker = sim_connect(sim, 0, 36);
    sim_grant(sim, worker, 36);
    for (size_t i = 0; i < 11; i++) {
        sim_send(sim, worker, earliest(worker), 100);
        sim_commit(sim);
    }
    durable = sim->acks;
    assert_int_equal(durable, 11);
    sim_send(sim, worker, earliest(worker), 100); /* merged, not written */
    sim_release(sim);
    store_close(store);
    store = sim_store(folder);
    sim_init(sim, store, 2);
    job = queue_find(&sim->farm.queue, 1);
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_string_equal(job->ray_tracer, "tracer 1");
    assert_non_null(job->frames);
    for (uint32_t t = 0; t < 6; t++) {
        assert_int_equal(film_tile_passes(job->frames->film, t, 0), 1);
        assert_int_equal(film_tile_passes(job->frames->film, t, 1), t < 5);
    }
    /* And it is known who delivered it: no other worker has that number. */
    number = film_deliverer(job->frames->film, 0, 0, 0);
    farm_deliverer_text(&sim->farm, number, text);
    assert_non_null(strstr(text, "node-0"));
    worker = sim_connect(sim, 1, 36);
    sim_grant(sim, worker, 36);
    sim_send(sim, worker, 0, 100);
    assert_true(number != 0 && worker->worker.deliverer.number != number);
    farm_deliverer_text(&sim->farm, number, text);
    assert_non_null(strstr(text, "node-0"));
    sim_free(sim);
    store_close(store);
    file_remove_tree(folder);
}

/* Let the worker render and deliver until the job is done. */
static void finish(struct sim *sim, struct sim_worker *worker, const struct job *job)
{
    while (job->state != JOB_STATE_DONE) {
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
        farm_tick(&sim->farm, sim->now_ns);
        sim_grant(sim, worker, 36);
        for (size_t i = worker->unit_count; i-- > 0;)
            sim_send(sim, worker, i, 100);
        worker->unit_count = 0;
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(sim->wrong_frames, 0);
}

/* A film that cannot be written is tried again, for days; nothing is acknowledged meanwhile and
 * nothing is lost. */
static void a_full_disk_keeps_the_film(void **state)
{
    char folder[SCRATCH_PATH];
    struct store *store;
    struct sim *sim;
    struct sim_worker *worker;
    struct job *job;
    uint64_t wait_ms = TROUBLE_FIRST_MS;

    (void)state;
    scratch_folder(folder);
    store = sim_store(folder);
    sim = sim_new(store, 1);
    job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    worker = sim_connect(sim, 0, 36);
    sim_grant(sim, worker, 3);
    sim_send(sim, worker, 0, 100);
    sim_send(sim, worker, 1, 100);
    film_file_fault(0);
    for (int tries = 0; tries < 40; tries++) {
        const struct trouble *trouble = &job->frames->trouble;
        sim_commit(sim);
        assert_int_equal(sim->acks, 0);
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        assert_non_null(strstr(trouble->text, "No space left on device"));
        assert_int_equal(trouble->next_ns, sim->now_ns + wait_ms * NS_PER_MS);
        wait_ms = wait_ms * 2 < TROUBLE_LAST_MS ? wait_ms * 2 : TROUBLE_LAST_MS;
        sim->now_ns = trouble->next_ns - 1;
        assert_null(merge_commit_begin(&sim->farm, sim->now_ns));
        sim->now_ns += tries == 30 ? 3 * 24 * 3600 * NS_PER_SECOND : 1;
    }
    film_file_fault(-1);
    sim_commit(sim);
    assert_int_equal(sim->acks, 2);
    assert_false(trouble_is(&job->frames->trouble));
    worker->unit_count = 0;
    sim_disconnect(sim, 0);
    finish(sim, sim_connect(sim, 0, 36), job);
    sim_free(sim);
    store_close(store);
    file_remove_tree(folder);
}

/* One frame that cannot be written does not keep the other's results from the disk: here one whose film
 * is larger than the process may write. */
static void a_failed_film_leaves_the_others_alone(void **state)
{
    char folder[SCRATCH_PATH];
    struct store *store;
    struct sim *sim;
    struct sim_worker *worker;
    struct job *large, *small;
    struct rlimit old, little;

    (void)state;
    scratch_folder(folder);
    store = sim_store(folder);
    sim = sim_new(store, 1);
    large = sim_submit(sim, 320, 144, 1, 1, 1, 0); /* 180 tiles: 600 KB */
    small = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    worker = sim_connect(sim, 0, 200);
    assert_int_equal(sim_grant(sim, worker, 200), 181);
    for (size_t i = 0; i < 181; i++)
        sim_send(sim, worker, i, 100);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    little = old;
    little.rlim_cur = 400 << 10; /* more than the database needs */
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &little), 0);
    sim_commit(sim);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(sim->acks, 1);
    assert_non_null(strstr(large->frames->trouble.text, "File too large"));
    assert_false(trouble_is(&small->frames->trouble) || trouble_is(&sim->farm.trouble));
    sim_develop(sim);
    assert_int_equal(small->state, JOB_STATE_DONE);
    worker->unit_count = 0;
    finish(sim, worker, large);
    sim_free(sim);
    store_close(store);
    file_remove_tree(folder);
}

static void a_full_disk_is_waited_for(void **state)
{
    struct error why = {STATUS_ERR_IO, "no space left"};
    struct job_report *report = malloc(sizeof *report);
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 1, 0);

    (void)state;
    assert_non_null(report);
    assert_int_equal(sim_grant(sim, worker, 1), 1);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    for (int tries = 0; tries < 40; tries++) {
        const struct trouble *trouble = &job->frames->trouble;
        /* No memory is waited for, too. */
        why.code = tries % 2 ? STATUS_ERR_NO_MEMORY : STATUS_ERR_IO;
        assert_int_equal(sim->developing_count, 1);
        sim->developing_count = 0;
        farm_frame_developed(&sim->farm, sim->developing[0], 0, why.code, &why, sim->now_ns);
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        job_report_make(report, &sim->farm, job, sim->now_ns);
        assert_non_null(strstr(report->state_text, "frame 1"));
        assert_non_null(strstr(report->state_text, "no space left"));
        sim->now_ns = trouble->next_ns - 1;
        farm_tick(&sim->farm, sim->now_ns);
        assert_int_equal(sim->developing_count, 0);
        sim->now_ns += tries == 30 ? 3 * 24 * 3600 * NS_PER_SECOND : 1;
        farm_tick(&sim->farm, sim->now_ns);
    }
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    sim_free(sim);
    free(report);
}

/* What no waiting changes ends the job at once. */
static void a_failed_development_fails_the_job(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 2, 0);
    struct error why = {STATUS_ERR_LIMIT, "too large a picture"};

    (void)state;
    assert_int_equal(sim_grant(sim, worker, 1), 1);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    assert_int_equal(sim->developing_count, 1);
    sim->developing_count = 0;
    farm_frame_developed(&sim->farm, sim->developing[0], 0, STATUS_ERR_LIMIT, &why, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_FAILED);
    assert_non_null(strstr(job->state_text, "frame 1"));
    assert_non_null(strstr(job->state_text, "too large a picture"));
    sim_free(sim);
}

/* A job that ends while its commit and its development are under way is freed after both. */
static void ends_wait_for_what_is_in_flight(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 32, 16, 1, 1, 1, 0);
    struct commit *commit;

    (void)state;
    assert_int_equal(sim_grant(sim, worker, 2), 2);
    sim_send(sim, worker, 0, 100);
    commit = merge_commit_begin(&sim->farm, sim->now_ns);
    farm_cancel(&sim->farm, job, 1, sim->now_ns);
    merge_commit_run(commit);
    merge_commit_end(&sim->farm, commit, sim->now_ns);
    assert_int_equal(sim->acks, 0);
    assert_int_equal(sim->farm.open_frames, 0);
    worker->unit_count = 0;

    job = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    assert_int_equal(sim_grant(sim, worker, 1), 1);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    assert_int_equal(sim->developing_count, 1);
    farm_cancel(&sim->farm, job, 1, sim->now_ns);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
    sim_free(sim);
}

/* Pictures that wait for the frames before them keep the job from ending; those of a job that is
 * done are made again one at a time. */
static void pictures_follow_the_settings(void **state)
{
    struct sim *sim = sim_new(NULL, 8);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 2, 0);
    struct output_settings output = job->output;
    struct error err = {0};

    (void)state;
    job->output.tonemap.temporal = 2;
    while (job->frames_done_count < 2) {
        sim_grant(sim, worker, 4);
        sim_send(sim, worker, 0, 100);
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_int_equal(job->frames_developed_count, 0);
    assert_true(sim_make_picture(sim));
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_true(sim_make_picture(sim));
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_false(sim_make_picture(sim));

    assert_int_equal(farm_develop(&sim->farm, job, &output, &err), STATUS_OK);
    assert_int_equal(job->revision, 1);
    assert_int_equal(job->state, JOB_STATE_DONE);
    farm_tick(&sim->farm, sim->now_ns);
    assert_ptr_equal(sim->picture_job, job);
    /* Changed again while one is made: that one does not count. */
    assert_int_equal(farm_develop(&sim->farm, job, &output, &err), STATUS_OK);
    sim->picture_job = NULL;
    farm_pictures_made(&sim->farm, job, sim->picture_frame, 1, STATUS_OK, &err, sim->now_ns);
    assert_int_equal(job->frames_developed_count, 0);
    assert_true(sim_make_picture(sim) && sim_make_picture(sim));
    assert_int_equal(job->frames_developed_count, 2);
    assert_false(sim_make_picture(sim));
    sim_free(sim);
}

/* Shares stay, also where the sums do not fit into the wire's numbers; zeros at the end are left out. */
static void a_report_says_where_the_time_went(void **state)
{
    struct job_report *report = malloc(sizeof *report);
    struct sim *sim = sim_new(NULL, 9);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 1, 0);

    (void)state;
    assert_non_null(report);
    job_report_make(report, &sim->farm, job, sim->now_ns);
    assert_int_equal(report->message.stats->n_accounts, 0);
    job->stats.accounts[0] = 30;
    job->stats.accounts[5] = 10;
    job->stats.effects = 16;
    job_report_make(report, &sim->farm, job, sim->now_ns);
    assert_int_equal(report->message.stats->n_accounts, 6);
    assert_int_equal(report->message.stats->accounts[0], 30);
    assert_int_equal(report->message.stats->accounts[5], 10);
    assert_int_equal(report->message.stats->effects, 16);
    job->stats.accounts[0] = 3ull << 40;
    job->stats.accounts[5] = 1ull << 40;
    job_report_make(report, &sim->farm, job, sim->now_ns);
    assert_int_equal(report->message.stats->accounts[0] / report->message.stats->accounts[5], 3);
    assert_true(report->message.stats->accounts[0] > 1u << 30);
    sim_free(sim);
    free(report);
}

/* A picture that the environment keeps from being made again is waited for, also after the job's end. */
static void a_picture_is_waited_for(void **state)
{
    struct job_report *report = malloc(sizeof *report);
    struct sim *sim = sim_new(NULL, 9);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    struct error err = {0}, why = {STATUS_ERR_IO, "frame-0001.exr: no descriptors"};
    struct output_settings output = job->output;

    (void)state;
    assert_non_null(report);
    sim_grant(sim, worker, 4);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(farm_develop(&sim->farm, job, &output, &err), STATUS_OK);
    farm_tick(&sim->farm, sim->now_ns);
    for (int day = 0; day < 3; day++) {
        assert_non_null(sim->picture_job);
        sim->picture_job = NULL;
        farm_pictures_made(&sim->farm, job, 1, 1, why.code, &why, sim->now_ns);
        job_report_make(report, &sim->farm, job, sim->now_ns);
        assert_non_null(strstr(report->state_text, "no descriptors; trying again"));
        assert_string_equal(report->message.develop_error, ""); /* that is for good */
        farm_tick(&sim->farm, sim->now_ns);
        assert_null(sim->picture_job);
        sim->now_ns += 24 * 3600 * NS_PER_SECOND;
        farm_tick(&sim->farm, sim->now_ns);
    }
    assert_true(sim_make_picture(sim));
    job_report_make(report, &sim->farm, job, sim->now_ns);
    assert_string_equal(report->state_text, "");
    assert_int_equal(job->frames_developed_count, 1);
    sim_free(sim);
    free(report);
}

/* A stored picture that cannot be read is reported, and the job stays done. */
static void a_lost_picture_is_told(void **state)
{
    struct sim *sim = sim_new(NULL, 9);
    struct sim_worker *worker = sim_connect(sim, 0, 36);
    struct job *job = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    struct error err = {0}, why = {STATUS_ERR_INPUT, "frame-0001.exr: gone"};
    struct output_settings output = job->output;

    (void)state;
    sim_grant(sim, worker, 4);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_int_equal(farm_develop(&sim->farm, job, &output, &err), STATUS_OK);
    farm_tick(&sim->farm, sim->now_ns);
    assert_non_null(sim->picture_job);
    sim->picture_job = NULL;
    farm_pictures_made(&sim->farm, job, 1, 1, STATUS_ERR_INPUT, &why, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_non_null(strstr(job->pictures.text, "frame 1: frame-0001.exr: gone"));
    farm_tick(&sim->farm, sim->now_ns);
    assert_null(sim->picture_job);
    sim_free(sim);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(acknowledged_when_durable),
        cmocka_unit_test(the_disk_sets_the_pace),
        cmocka_unit_test(a_complete_frame_does_not_wait),
        cmocka_unit_test(a_repeated_result_is_kept_or_pending),
        cmocka_unit_test(a_conflict_is_reported_and_the_first_kept),
        cmocka_unit_test(hostile_results_are_refused),
        cmocka_unit_test(a_lease_is_its_holders),
        cmocka_unit_test(hostile_health_is_refused),
        cmocka_unit_test(an_infinite_amount_is_refused),
        cmocka_unit_test(unwanted_results_are_sent_away),
        cmocka_unit_test(random_farms_end_right),
        cmocka_unit_test(random_crashes_lose_nothing),
        cmocka_unit_test(acknowledged_results_survive),
        cmocka_unit_test(a_full_disk_keeps_the_film),
        cmocka_unit_test(a_failed_film_leaves_the_others_alone),
        cmocka_unit_test(a_full_disk_is_waited_for),
        cmocka_unit_test(a_failed_development_fails_the_job),
        cmocka_unit_test(ends_wait_for_what_is_in_flight),
        cmocka_unit_test(pictures_follow_the_settings),
        cmocka_unit_test(a_report_says_where_the_time_went),
        cmocka_unit_test(a_picture_is_waited_for),
        cmocka_unit_test(a_lost_picture_is_told),
    };
    return cmocka_run_group_tests_name("merge", tests, NULL, NULL);
}
