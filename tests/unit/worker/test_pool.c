/* The thread pool: order, cancelling, the floating-point state, and its end. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "worker/pool.h"

struct job {
    struct pool_task task;
    int number;
    float in, out;
};

/* What a pool notifies, to wait on. */
struct bell {
    pthread_mutex_t lock;
    pthread_cond_t rung;
    unsigned rings;
};

static void ring(void *user)
{
    struct bell *bell = user;

    pthread_mutex_lock(&bell->lock);
    bell->rings++;
    pthread_cond_signal(&bell->rung);
    pthread_mutex_unlock(&bell->lock);
}

static void wait_for_ring(struct bell *bell, unsigned seen)
{
    pthread_mutex_lock(&bell->lock);
    while (bell->rings == seen)
        pthread_cond_wait(&bell->rung, &bell->lock);
    pthread_mutex_unlock(&bell->lock);
}

#define BELL_INIT {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER, 0}

/* A gate that keeps a thread busy for as long as the test likes. */
static pthread_mutex_t gate_lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t gate_moved = PTHREAD_COND_INITIALIZER;
static int gate_entered, gate_open;
static atomic_int order;

static void run_gate(struct pool_task *task)
{
    (void)task;
    pthread_mutex_lock(&gate_lock);
    gate_entered++;
    pthread_cond_broadcast(&gate_moved);
    while (!gate_open)
        pthread_cond_wait(&gate_moved, &gate_lock);
    pthread_mutex_unlock(&gate_lock);
}

static void gate_reset(void)
{
    gate_entered = gate_open = 0;
    atomic_store(&order, 0);
}

static void gate_await(int entered)
{
    pthread_mutex_lock(&gate_lock);
    while (gate_entered < entered)
        pthread_cond_wait(&gate_moved, &gate_lock);
    pthread_mutex_unlock(&gate_lock);
}

static void gate_let_go(void)
{
    pthread_mutex_lock(&gate_lock);
    gate_open = 1;
    pthread_cond_broadcast(&gate_moved);
    pthread_mutex_unlock(&gate_lock);
}

static void run_number(struct pool_task *task) { ((struct job *)task)->number = atomic_fetch_add(&order, 1); }

/* Take what is done until `count` tasks were; they are counted once each. */
static void take(struct pool *pool, struct bell *bell, unsigned count)
{
    while (count > 0) {
        unsigned seen;
        struct pool_task *done, *next;
        pthread_mutex_lock(&bell->lock);
        seen = bell->rings;
        pthread_mutex_unlock(&bell->lock);
        done = pool_take_done(pool);
        if (!done) {
            wait_for_ring(bell, seen);
            continue;
        }
        for (; done; done = next) {
            next = done->next;
            assert_int_equal(done->state, TASK_IDLE);
            assert_true(count > 0);
            count--;
        }
    }
}

static void test_order_and_urgency(void **state)
{
    struct bell bell = BELL_INIT;
    struct pool_task gate = {.run = run_gate};
    struct job jobs[6];
    struct pool *pool;
    const int expected[6] = {2, 3, 4, 5, 1, 0}; /* 4 and 5 were urgent, the later one first */

    (void)state;
    gate_reset();
    assert_int_equal(pool_new(&pool, 1, ring, &bell, NULL), STATUS_OK);
    pool_push(pool, &gate, 0);
    gate_await(1);
    for (int i = 0; i < 6; i++) {
        jobs[i] = (struct job){.task = {.run = run_number}, .number = -1};
        pool_push(pool, &jobs[i].task, i >= 4);
    }
    gate_let_go();
    take(pool, &bell, 7);
    for (int i = 0; i < 6; i++)
        assert_int_equal(jobs[i].number, expected[i]);
    assert_null(pool_take_done(pool));
    pool_free(pool);
}

static void test_cancel(void **state)
{
    struct bell bell = BELL_INIT;
    struct pool_task gate = {.run = run_gate};
    struct job jobs[5];
    struct pool *pool;

    (void)state;
    gate_reset();
    assert_int_equal(pool_new(&pool, 1, ring, &bell, NULL), STATUS_OK);
    pool_push(pool, &gate, 0);
    gate_await(1);
    for (int i = 0; i < 5; i++) {
        jobs[i] = (struct job){.task = {.run = run_number}, .number = -1};
        pool_push(pool, &jobs[i].task, 0);
    }
    assert_int_equal(pool_cancel(pool, &gate), 0); /* a thread is at it */
    assert_int_equal(pool_cancel(pool, &jobs[0].task), 1);
    assert_int_equal(pool_cancel(pool, &jobs[0].task), 0); /* not twice */
    assert_int_equal(pool_cancel(pool, &jobs[2].task), 1);
    assert_int_equal(pool_cancel(pool, &jobs[4].task), 1);
    pool_push(pool, &jobs[4].task, 0); /* and again */
    gate_let_go();
    take(pool, &bell, 4);
    assert_int_equal(jobs[0].number, -1);
    assert_int_equal(jobs[1].number, 0);
    assert_int_equal(jobs[2].number, -1);
    assert_int_equal(jobs[3].number, 1);
    assert_int_equal(jobs[4].number, 2);
    assert_int_equal(pool_cancel(pool, &jobs[1].task), 0);
    pool_free(pool);
}

/* An owner that looks again by itself is told only of tasks that cannot wait, and of the last. */
static void test_gathering(void **state)
{
    struct bell bell = BELL_INIT;
    struct pool_task gate = {.run = run_gate, .can_wait = 1};
    struct job jobs[8];
    struct pool *pool;

    (void)state;
    gate_reset();
    for (int i = 0; i < 8; i++)
        jobs[i] = (struct job){.task = {.run = run_number, .can_wait = i != 4}};
    assert_int_equal(pool_new(&pool, 1, ring, &bell, NULL), STATUS_OK);
    pool_push(pool, &jobs[0].task, 0);
    take(pool, &bell, 1);
    assert_int_equal(bell.rings, 1); /* it was the first */
    pool_push(pool, &gate, 0);
    gate_await(1);
    for (int i = 1; i < 7; i++)
        pool_push(pool, &jobs[i].task, 0);
    gate_let_go();
    wait_for_ring(&bell, 1); /* 4 */
    wait_for_ring(&bell, 2); /* 6: nothing is behind it */
    take(pool, &bell, 7);
    assert_int_equal(bell.rings, 3);
    assert_null(pool_take_done(pool)); /* it does not look again */
    pool_push(pool, &jobs[7].task, 0);
    take(pool, &bell, 1);
    assert_int_equal(bell.rings, 4);
    pool_free(pool);
}

static void test_many_tasks_on_many_threads(void **state)
{
    enum { COUNT = 20000 };
    struct bell bell = BELL_INIT;
    struct job *jobs = calloc(COUNT, sizeof *jobs);
    uint8_t *seen = calloc(COUNT, 1);
    struct pool *pool;

    (void)state;
    assert_true(jobs && seen);
    gate_reset();
    assert_int_equal(pool_new(&pool, 8, ring, &bell, NULL), STATUS_OK);
    for (int i = 0; i < COUNT; i++) {
        jobs[i].task.run = run_number;
        pool_push(pool, &jobs[i].task, i % 3 == 0);
    }
    take(pool, &bell, COUNT);
    for (int i = 0; i < COUNT; i++) {
        assert_in_range(jobs[i].number, 0, COUNT - 1);
        assert_int_equal(seen[jobs[i].number]++, 0);
    }
    pool_free(pool);
    free(seen);
    free(jobs);
}

static void *open_gate(void *unused)
{
    gate_let_go();
    return unused;
}

/* Freed while threads are at work: it waits for them. */
static void test_free_while_busy(void **state)
{
    struct bell bell = BELL_INIT;
    struct pool_task gates[2] = {{.run = run_gate}, {.run = run_gate}};
    pthread_t opener;
    struct pool *pool;

    (void)state;
    gate_reset();
    assert_int_equal(pool_new(&pool, 2, ring, &bell, NULL), STATUS_OK);
    pool_push(pool, &gates[0], 0);
    pool_push(pool, &gates[1], 0);
    gate_await(2);
    assert_int_equal(pthread_create(&opener, NULL, open_gate, NULL), 0);
    pool_free(pool);
    pthread_join(opener, NULL);
    assert_int_equal(gates[0].state, TASK_DONE);
    assert_int_equal(gates[1].state, TASK_DONE);
    pool_free(NULL);
}

static void run_halve(struct pool_task *task)
{
    struct job *job = (struct job *)task;
    volatile float x = job->in;

    job->out = x * 0.5f;
}

/* Denormals survive in the threads even if the thread that made them flushes its own. */
static void test_denormals_are_kept(void **state)
{
    struct bell bell = BELL_INIT;
    struct job job = {.task = {.run = run_halve}, .in = 1e-38f};
    struct pool *pool;

    (void)state;
#if defined(__x86_64__)
    unsigned before = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(before | 0x8040); /* FTZ and DAZ */
#endif
    assert_int_equal(pool_new(&pool, 1, ring, &bell, NULL), STATUS_OK);
#if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(before);
#endif
    pool_push(pool, &job.task, 0);
    take(pool, &bell, 1);
    assert_true(job.out > 0);
    pool_free(pool);
}

static void test_bad_counts_and_no_memory(void **state)
{
    struct bell bell = BELL_INIT;
    struct pool *pool;

    (void)state;
    assert_int_equal(pool_new(&pool, 0, ring, &bell, NULL), STATUS_ERR_USAGE);
    assert_int_equal(pool_new(&pool, POOL_THREADS_MAX + 1, ring, &bell, NULL), STATUS_ERR_USAGE);
    mem_fault_arm(0, 1);
    assert_int_equal(pool_new(&pool, 2, ring, &bell, NULL), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_null(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order_and_urgency),
        cmocka_unit_test(test_cancel),
        cmocka_unit_test(test_gathering),
        cmocka_unit_test(test_many_tasks_on_many_threads),
        cmocka_unit_test(test_free_while_busy),
        cmocka_unit_test(test_denormals_are_kept),
        cmocka_unit_test(test_bad_counts_and_no_memory),
    };
    return cmocka_run_group_tests_name("pool", tests, NULL, NULL);
}
