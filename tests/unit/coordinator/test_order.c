/* The order in which jobs get work: priority, owners' recent use, submission, turns. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/job/order.h"
#include "coordinator/job/queue.h"

enum { HOUR_S = 3600 };

/* A queue in which all that is ready is rendered by a farm of `cores`, one second after another. */
struct world {
    struct queue queue;
    struct order order;
    uint64_t last_id;
    int64_t wall_s;
    double cores;
    uint64_t unready, unable; /* a job's number; 0: none */
};

static int is_ready(void *user, const struct job *job) { return job->id != ((struct world *)user)->unready; }

static int has_worker(void *user, const struct job *job) { return job->id != ((struct world *)user)->unable; }

static uint64_t now_ns(const struct world *w) { return (uint64_t)w->wall_s * NS_PER_SECOND; }

static void set_up(struct world *w)
{
    memset(w, 0, sizeof *w);
    queue_init(&w->queue);
    order_init(&w->order);
    w->wall_s = 1000;
    w->cores = 100;
}

static void tear_down(struct world *w)
{
    order_release(&w->order);
    queue_release(&w->queue);
}

static struct job *submit(struct world *w, const char *owner, int32_t priority)
{
    struct job *job = job_new(1, 1);

    assert_non_null(job);
    job->id = ++w->last_id;
    job->priority = priority;
    snprintf(job->owner, sizeof job->owner, "%s", owner);
    assert_int_equal(queue_add(&w->queue, job, NULL), STATUS_OK);
    return job;
}

static void end(struct world *w, struct job *job)
{
    if (job->state == JOB_STATE_QUEUED)
        job_set_state(&w->queue, job, JOB_STATE_RUNNING, NULL, now_ns(w), w->wall_s);
    job_set_state(&w->queue, job, JOB_STATE_DONE, NULL, now_ns(w), w->wall_s);
}

static void update(struct world *w)
{
    const struct order_questions ask = {is_ready, has_worker, w};

    if (order_update(&w->order, &w->queue, &ask, now_ns(w), w->wall_s))
        queue_order_changed(&w->queue);
}

/* The numbers of the jobs in their order, "4 2 1". */
static const char *order_text(struct world *w)
{
    static char text[256];
    size_t used = 0;

    update(w);
    text[0] = 0;
    for (size_t i = 0; i < w->order.count; i++) {
        assert_int_equal(w->order.jobs[i]->place.before, i);
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%llu", i ? " " : "",
                                 (unsigned long long)w->order.jobs[i]->id);
    }
    return text;
}

/* The first job gets the whole farm for a second. */
static struct job *render_a_second(struct world *w)
{
    struct job *job = NULL;

    update(w);
    if (w->order.count > 0) {
        job = w->order.jobs[0];
        order_served(job, now_ns(w));
        order_charge(&w->order, job, w->cores, w->wall_s);
    }
    w->wall_s++;
    return job;
}

static void priority_owner_submission(void **state)
{
    struct world w;

    (void)state;
    set_up(&w);
    submit(&w, "ana", 0);
    submit(&w, "ana", 5);
    submit(&w, "ben", 0);
    submit(&w, "cat", -1);
    assert_string_equal(order_text(&w), "2 1 3 4"); /* nobody used anything: the order of submission */
    order_charge(&w.order, w.queue.all[0], 50, w.wall_s);
    submit(&w, "cat", 0);
    assert_string_equal(order_text(&w), "2 3 5 1 4"); /* ana's waits, but for her urgent one */
    order_charge(&w.order, w.queue.all[2], 70, w.wall_s);
    assert_string_equal(order_text(&w), "2 3 5 1 4"); /* owners are compared once a round */
    w.wall_s += ORDER_ROUND_MS / 1000;
    assert_string_equal(order_text(&w), "2 5 1 3 4");
    queue_set_priority(&w.queue, w.queue.all[2], 1); /* a priority counts at once */
    assert_string_equal(order_text(&w), "2 3 5 1 4");
    w.unready = 5;
    w.order.stale = 1;
    assert_string_equal(order_text(&w), "2 3 1 4");
    assert_int_equal(w.queue.all[4]->place.ready, 0);
    end(&w, w.queue.all[1]);
    assert_string_equal(order_text(&w), "3 1 4");
    tear_down(&w);
}

static void without_shares_it_is_the_order_of_submission(void **state)
{
    struct world w;

    (void)state;
    set_up(&w);
    w.order.rules = (struct order_rules){0, 0};
    submit(&w, "ana", 0);
    submit(&w, "ben", 0);
    order_charge(&w.order, w.queue.all[0], 1e6, w.wall_s);
    w.wall_s += HOUR_S * 100;
    assert_string_equal(order_text(&w), "1 2");
    tear_down(&w);
}

static void shares_decay(void **state)
{
    struct world w;
    struct owner_share *share;
    struct job *job;

    (void)state;
    set_up(&w);
    job = submit(&w, "ana", 0);
    order_charge(&w.order, job, 100, w.wall_s);
    share = order_share(&w.order, "ana");
    assert_float_equal(owner_share_at(share, HOUR_S, w.wall_s + HOUR_S), 50, 1e-9);
    assert_float_equal(owner_share_at(share, HOUR_S, w.wall_s + 3 * HOUR_S), 12.5, 1e-9);
    assert_float_equal(owner_share_at(share, HOUR_S, w.wall_s - 1000), 100, 1e-9);
    assert_float_equal(owner_share_at(share, 0, w.wall_s + HOUR_S), 100, 1e-9);
    w.order.rules.half_life_s = HOUR_S;
    order_charge(&w.order, job, 10, w.wall_s + 2 * HOUR_S);
    assert_float_equal(share->core_s, 35, 1e-9);
    order_charge(&w.order, job, 1, w.wall_s); /* the clock was set back */
    assert_float_equal(share->core_s, 36, 1e-9);
    snprintf(job->owner, sizeof job->owner, "ben"); /* an estimate that somebody else continued */
    order_charge(&w.order, job, 7, w.wall_s);
    assert_float_equal(order_share(&w.order, "ben")->core_s, 7, 1e-9);
    assert_int_equal(w.order.share_count, 2);
    tear_down(&w);
}

/* Two who always have work get the same, also if one has many more jobs. */
static void owners_share_evenly(void **state)
{
    struct world w;
    double used[2] = {0, 0};
    int changes = 0;
    struct job *last = NULL;

    (void)state;
    set_up(&w);
    for (int i = 0; i < 20; i++)
        submit(&w, "ana", 0);
    submit(&w, "ben", 0);
    for (int i = 0; i < 2 * HOUR_S; i++) {
        struct job *job = render_a_second(&w);
        used[strcmp(job->owner, "ben") == 0] += w.cores;
        changes += last && last != job;
        last = job;
    }
    assert_float_equal(used[0] / used[1], 1, 0.02);
    assert_in_range(changes, 100, 2 * HOUR_S * 1000 / ORDER_ROUND_MS); /* workers keep their scenes for a round */
    assert_true(last == w.queue.all[0] || last == w.queue.all[20]);    /* ana's others wait for her first */
    tear_down(&w);
}

/* New owners, who used nothing, come for ever: an old one still gets its turns. */
static void no_owner_waits_for_ever(void **state)
{
    struct world w;
    struct job *old, *current;
    char name[32];
    int64_t waited = 0, longest = 0, served = 0;
    int64_t turn = ORDER_LONGEST_WAIT_S / ORDER_TURN_PARTS;

    (void)state;
    set_up(&w);
    old = submit(&w, "old", 0);
    order_charge(&w.order, old, 1e9, w.wall_s);
    current = submit(&w, "new 0", 0);
    for (int i = 1; i < 40 * HOUR_S; i++) {
        struct job *job = render_a_second(&w);
        waited = job == old ? 0 : waited + 1;
        served += job == old;
        longest = waited > longest ? waited : longest;
        if (i % 20 == 0) { /* before the round ends */
            if (current)
                end(&w, current);
            snprintf(name, sizeof name, "new %d", i);
            current = submit(&w, name, 0);
        }
    }
    assert_in_range(longest, ORDER_LONGEST_WAIT_S - 60, ORDER_LONGEST_WAIT_S + 60);
    assert_in_range(served, 40 * HOUR_S * turn / (ORDER_LONGEST_WAIT_S + turn) * 9 / 10, 40 * HOUR_S / 5);

    /* Without turns it starves. */
    w.order.rules.longest_wait_s = 0;
    old->place.turn_end_ns = 0;
    for (int i = 1; i < 3 * HOUR_S; i++) {
        assert_ptr_not_equal(render_a_second(&w), old);
        if (i % 20 == 0) {
            end(&w, current);
            snprintf(name, sizeof name, "newer %d", i);
            current = submit(&w, name, 0);
        }
    }
    tear_down(&w);
}

/* Of several owners that have waited too long, the one that has waited longest has the first turn. */
static void the_longest_wait_ends_first(void **state)
{
    struct job *waiting[3], *user, *first = NULL;
    static const char *const names[] = {"ana", "ben", "cat"};
    struct world w;
    int seconds;

    (void)state;
    set_up(&w);
    user = submit(&w, "dan", 0);
    for (int i = 0; i < 3; i++) {
        waiting[i] = submit(&w, names[i], 0);
        order_charge(&w.order, waiting[i], 1e9 * (1 + i), w.wall_s);
    }
    update(&w);
    w.wall_s += 5;
    order_served(waiting[0], now_ns(&w)); /* ben has waited longer than cat, and cat than ana */
    w.wall_s -= 3;
    order_served(waiting[2], now_ns(&w));
    w.wall_s += 3;
    for (seconds = 0; !first && seconds < 2 * ORDER_LONGEST_WAIT_S; seconds++) {
        struct job *job;

        /* All of them have waited too long when the next round begins. */
        w.wall_s += seconds == 0 ? ORDER_LONGEST_WAIT_S + 60 : 1;
        update(&w);
        job = w.order.jobs[0];
        order_served(job, now_ns(&w));
        if (job != user)
            first = job;
    }
    assert_ptr_equal(first, waiting[1]);
    tear_down(&w);
}

/* A job that no worker can render keeps its owner's next one from nothing. */
static void turns_are_for_jobs_that_can_use_them(void **state)
{
    struct world w;
    struct job *stuck, *next, *other;
    int turns = 0;

    (void)state;
    set_up(&w);
    stuck = submit(&w, "ana", 0);
    next = submit(&w, "ana", 0);
    other = submit(&w, "ben", 0);
    w.unable = stuck->id;
    order_charge(&w.order, stuck, 1e9, w.wall_s);
    order_charge(&w.order, other, 1, w.wall_s);
    for (int i = 0; i < 3 * HOUR_S; i++) {
        struct job *job;
        update(&w);
        job = w.order.jobs[0];
        order_served(job, now_ns(&w));
        w.wall_s++;
        assert_ptr_not_equal(job, stuck);
        turns += job == next;
    }
    assert_in_range(turns, 2 * ORDER_LONGEST_WAIT_S / ORDER_TURN_PARTS, HOUR_S);
    tear_down(&w);
}

static void a_job_that_goes_on_has_not_waited(void **state)
{
    const struct job_reopening all = {0};
    struct world w;
    struct job *old, *other;

    (void)state;
    set_up(&w);
    old = submit(&w, "ana", 0);
    other = submit(&w, "ben", 0);
    order_charge(&w.order, old, 1e9, w.wall_s);
    update(&w);
    end(&w, old);
    for (int i = 0; i < 3 * HOUR_S; i++)
        assert_ptr_equal(render_a_second(&w), other);
    job_reopen(&w.queue, old, &all);
    for (int i = 0; i < ORDER_LONGEST_WAIT_S / 2; i++)
        assert_ptr_equal(render_a_second(&w), other);
    tear_down(&w);
}

static uint64_t compared_at_ns;

static int in_order(const void *a, const void *b)
{
    const struct job *one = *(struct job *const *)a, *other = *(struct job *const *)b;
    int one_turn = one->place.turn_end_ns > compared_at_ns, other_turn = other->place.turn_end_ns > compared_at_ns;
    double one_rank = one->place.share->rank, other_rank = other->place.share->rank;

    if (one->priority != other->priority)
        return one->priority > other->priority ? -1 : 1;
    if (one_turn != other_turn)
        return other_turn - one_turn;
    if (one_rank != other_rank)
        return one_rank < other_rank ? -1 : 1;
    return one->id < other->id ? -1 : 1;
}

/* Random histories: the order is what sorting by the rules gives. */
static void as_sorted(void **state)
{
    static struct job *expected[2000];
    uint32_t random = 1;
    char name[16];
    struct world w;

    (void)state;
    set_up(&w);
    for (int step = 0; step < 2000; step++) {
        random = random * 1664525 + 1013904223;
        uint32_t r = random >> 8;
        if (r % 3 > 0 || w.queue.active_count == 0) {
            snprintf(name, sizeof name, "owner %u", r / 3 % 7);
            submit(&w, name, (int32_t)(r / 21 % 3));
        } else if (r % 6 == 0) {
            end(&w, w.queue.active[r / 6 % w.queue.active_count]);
        } else {
            order_charge(&w.order, w.queue.active[r / 6 % w.queue.active_count], r % 5, w.wall_s);
        }
        w.wall_s += r % 100;
        w.unready = r % 97;
        w.order.stale = 1; /* a turn may have ended within the round */
        if (r % 11 == 0)
            queue_set_priority(&w.queue, w.queue.active[r / 11 % w.queue.active_count], (int32_t)(r % 3));
        if (w.order.count > 0 && r % 2)
            order_served(w.queue.active[0], now_ns(&w));
        update(&w);
        compared_at_ns = now_ns(&w);
        memcpy(expected, w.order.jobs, w.order.count * sizeof expected[0]);
        qsort(expected, w.order.count, sizeof expected[0], in_order);
        for (size_t i = 0; i < w.order.count; i++) {
            assert_ptr_equal(w.order.jobs[i], expected[i]);
            assert_int_equal(expected[i]->place.before, i);
        }
    }
    tear_down(&w);
}

/* An owner waits in each priority for itself: who renders something urgent may starve below. */
static void each_priority_has_its_turns(void **state)
{
    struct world w;
    struct job *urgent, *low, *other;
    int turns = 0;

    (void)state;
    set_up(&w);
    urgent = submit(&w, "ana", 1);
    low = submit(&w, "ana", 0);
    other = submit(&w, "ben", 0);
    for (int i = 0; i < 3 * HOUR_S; i++) {
        update(&w);
        assert_ptr_equal(w.order.jobs[0], urgent); /* it leaves most of the farm to the others */
        order_served(urgent, now_ns(&w));
        order_charge(&w.order, urgent, 60, w.wall_s);
        order_served(w.order.jobs[1], now_ns(&w));
        order_charge(&w.order, w.order.jobs[1], 40, w.wall_s);
        turns += w.order.jobs[1] == low;
        assert_true(w.order.jobs[1] == low || w.order.jobs[1] == other);
        w.wall_s++;
    }
    assert_in_range(turns, 2 * ORDER_LONGEST_WAIT_S / ORDER_TURN_PARTS, HOUR_S);
    tear_down(&w);
}

/* Several who starve take turns, the one who waited longest first. */
static void one_turn_at_a_time(void **state)
{
    struct world w;
    struct job *olds[3];
    int served[3] = {0, 0, 0};
    char name[32];

    (void)state;
    set_up(&w);
    for (int k = 0; k < 3; k++) {
        snprintf(name, sizeof name, "old %d", k);
        olds[k] = submit(&w, name, 0);
        order_charge(&w.order, olds[k], 1e9, w.wall_s);
    }
    submit(&w, "new", 0);
    for (int i = 0; i < 5 * HOUR_S; i++) {
        struct job *job = render_a_second(&w);
        int turns = 0;
        order_share(&w.order, "new")->core_s = 0;
        for (int k = 0; k < 3; k++) {
            turns += olds[k]->place.turn_end_ns > now_ns(&w);
            served[k] += job == olds[k];
        }
        assert_in_range(turns, 0, 1);
    }
    for (int k = 0; k < 3; k++)
        assert_in_range(served[k], 3 * ORDER_LONGEST_WAIT_S / ORDER_TURN_PARTS, HOUR_S);
    tear_down(&w);
}

/* Turns are within a priority: a lower one waits as long as there is work above it. */
static void a_turn_does_not_pass_a_priority(void **state)
{
    struct world w;
    struct job *low, *high;

    (void)state;
    set_up(&w);
    low = submit(&w, "ana", 0);
    high = submit(&w, "ben", 1);
    for (int i = 0; i < 3 * HOUR_S; i++)
        assert_ptr_equal(render_a_second(&w), high);
    end(&w, high);
    assert_ptr_equal(render_a_second(&w), low);
    tear_down(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(priority_owner_submission),
        cmocka_unit_test(without_shares_it_is_the_order_of_submission),
        cmocka_unit_test(shares_decay),
        cmocka_unit_test(owners_share_evenly),
        cmocka_unit_test(no_owner_waits_for_ever),
        cmocka_unit_test(the_longest_wait_ends_first),
        cmocka_unit_test(turns_are_for_jobs_that_can_use_them),
        cmocka_unit_test(a_turn_does_not_pass_a_priority),
        cmocka_unit_test(a_job_that_goes_on_has_not_waited),
        cmocka_unit_test(as_sorted),
        cmocka_unit_test(each_priority_has_its_turns),
        cmocka_unit_test(one_turn_at_a_time),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
