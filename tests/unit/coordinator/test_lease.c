/* Leases: deadlines, fencing, returning, settling. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/frame/lease.h"
#include "coordinator/frame/spread.h"
#include "tests/support/sim_farm.h"

#define DURATION_NS (10 * NS_PER_SECOND)
#define T0 (100 * NS_PER_SECOND)

struct fixture {
    struct job *job;
    struct job_frame *frame;
    struct lease_table table;
    struct lease_holder a, b;
    uint32_t told_session;
    uint64_t told_lease;
};

static void set_up(struct fixture *f)
{
    memset(f, 0, sizeof *f);
    f->job = sim_job(64, 48, 12, 1, 1, 0); /* 12 tiles, 3 passes of 2 groups */
    f->frame = job_frame_new(f->job, 1, 64, 48, 12, 0, NULL);
    assert_non_null(f->frame);
    assert_int_equal(job_frame_begin(f->frame, NULL), STATUS_OK);
    lease_table_init(&f->table, 1000, DURATION_NS);
    f->a.session = 1;
    f->b.session = 2;
}

static void tear_down(struct fixture *f)
{
    lease_table_release(&f->table);
    assert_int_equal(f->a.units, 0);
    assert_int_equal(f->a.samples, 0);
    assert_int_equal(f->a.leases, 0);
    assert_int_equal(f->b.units, 0);
    assert_int_equal(f->job->leases, 0);
    job_frame_free(f->frame);
    job_free(f->job);
}

static struct lease *grant(struct fixture *f, struct lease_holder *holder, uint32_t count, uint64_t now_ns)
{
    struct unit_name units[64];

    for (uint32_t i = 0; i < count; i++)
        assert_true(job_frame_take(f->frame, &units[i]));
    return lease_grant(&f->table, f->frame, holder, units, count, now_ns);
}

static void on_other(void *user, uint32_t session, uint64_t lease)
{
    struct fixture *f = user;

    f->told_session = session;
    f->told_lease = lease;
}

static void units_are_granted_in_passes_and_once(void **state)
{
    struct fixture f;
    struct unit_name unit;
    uint32_t spread[12];

    (void)state;
    set_up(&f);
    spread_order(64, 48, spread);
    for (uint32_t i = 0; i < 72; i++) {
        assert_int_equal(job_frame_unleased(f.frame), 72 - i);
        assert_true(job_frame_take(f.frame, &unit));
        assert_int_equal(unit.pass, i / 24);
        assert_int_equal(unit.group, i / 12 % 2);
        assert_int_equal(unit.tile, i < 12 ? spread[i] : i % 12);
        assert_non_null(lease_grant(&f.table, f.frame, &f.a, &unit, 1, T0));
    }
    assert_false(job_frame_take(f.frame, &unit));
    assert_int_equal(f.a.units, 72);
    assert_int_equal(f.a.samples, 64 * 48 * 12);
    tear_down(&f);
}

static void epochs_grow_and_fence(void **state)
{
    struct fixture f;
    struct lease *first, *second;

    (void)state;
    set_up(&f);
    first = grant(&f, &f.a, 2, T0);
    second = grant(&f, &f.b, 2, T0);
    assert_true(first->epoch > 1000 && second->epoch > first->epoch);
    assert_ptr_equal(lease_find(&f.table, first->id, first->epoch), first);
    assert_null(lease_find(&f.table, first->id, second->epoch));
    assert_null(lease_find(&f.table, second->id + 1, second->epoch));
    assert_ptr_equal(lease_find(&f.table, second->id, 0), second);
    tear_down(&f);
}

static void a_lapsed_lease_returns_what_is_left(void **state)
{
    struct fixture f;
    struct lease *lease, *again;
    struct unit_name first;
    uint32_t spread[12];

    (void)state;
    set_up(&f);
    spread_order(64, 48, spread);
    lease = grant(&f, &f.a, 5, T0);
    first = lease->units[0];
    assert_null(lease_lapsed(&f.table, T0 + DURATION_NS - 1));
    lease_renew(&f.table, lease, T0 + 3);
    assert_null(lease_lapsed(&f.table, T0 + DURATION_NS));
    assert_ptr_equal(lease_lapsed(&f.table, T0 + 3 + DURATION_NS), lease);
    lease_settle_unit(&f.table, f.frame, lease->units[2], 1, on_other, &f);
    lease_end(&f.table, lease);
    assert_int_equal(f.frame->returned_count, 4);
    again = grant(&f, &f.b, 4, T0);
    for (uint32_t i = 0; i < 4; i++) /* returned ones come first, in order, without the settled one */
        assert_int_equal(again->units[i].tile, spread[i < 2 ? i : i + 1]);
    assert_int_equal(first.tile, spread[0]);
    tear_down(&f);
}

static void the_last_unit_settled_ends_every_holder(void **state)
{
    struct fixture f;
    struct lease *slow, *fast;
    struct unit_name unit;
    uint64_t slow_id;

    (void)state;
    set_up(&f);
    slow = grant(&f, &f.a, 1, T0);
    unit = slow->units[0];
    slow_id = slow->id;
    fast = lease_grant(&f.table, f.frame, &f.b, &unit, 1, T0 + 5);
    assert_non_null(fast);
    assert_int_equal(job_frame_unit_find(f.frame, unit)->holder_count, 2);
    assert_int_equal(f.frame->outstanding_count, 1);
    lease_settle_unit(&f.table, f.frame, unit, 2, on_other, &f);
    assert_int_equal(f.told_session, 1);
    assert_int_equal(f.told_lease, slow_id);
    assert_int_equal(f.table.count, 0);
    assert_int_equal(f.frame->outstanding_count, 0);
    lease_settle_unit(&f.table, f.frame, unit, 2, on_other, &f); /* again: nothing to do */
    tear_down(&f);
}

static void one_of_two_holders_may_go(void **state)
{
    struct fixture f;
    struct lease *slow, *fast;
    struct unit_name unit;

    (void)state;
    set_up(&f);
    slow = grant(&f, &f.a, 3, T0);
    unit = slow->units[1];
    fast = lease_grant(&f.table, f.frame, &f.b, &unit, 1, T0);
    lease_end(&f.table, fast);
    assert_int_equal(f.frame->returned_count, 0); /* the other still has it */
    lease_return_unit(&f.table, slow, unit);
    assert_int_equal(f.frame->returned_count, 1);
    lease_return_unit(&f.table, slow, unit); /* it does not hold it any more */
    assert_int_equal(f.frame->returned_count, 1);
    assert_int_equal(slow->open_count, 2);
    lease_return_unit(&f.table, slow, slow->units[0]);
    lease_return_unit(&f.table, slow, slow->units[2]);
    assert_int_equal(f.table.count, 0);
    tear_down(&f);
}

static void a_dead_worker_leaves_nothing_behind(void **state)
{
    struct fixture f;
    struct unit_name unit;
    uint32_t seen = 0;

    (void)state;
    set_up(&f);
    grant(&f, &f.a, 10, T0);
    grant(&f, &f.b, 10, T0);
    grant(&f, &f.a, 10, T0);
    lease_end_all_of(&f.table, &f.a);
    assert_int_equal(f.a.units, 0);
    assert_int_equal(f.b.units, 10);
    assert_int_equal(f.table.count, 1);
    while (job_frame_take(f.frame, &unit)) {
        assert_non_null(lease_grant(&f.table, f.frame, &f.a, &unit, 1, T0));
        seen++;
    }
    assert_int_equal(seen, 62);
    tear_down(&f);
}

/* Whatever allocation fails, every unit can still be granted. */
static void memory_faults_lose_no_unit(void **state)
{
    long successes = 0, failures;

    (void)state;
    do {
        struct fixture f;
        struct unit_name units[4];
        uint32_t rounds = 0;
        set_up(&f);
        mem_fault_arm(successes++, 2);
        while (f.frame->outstanding_count < 72 && rounds++ < 200) {
            uint32_t count = 0;
            struct lease *lease;
            while (count < 4 && job_frame_take(f.frame, &units[count]))
                count++;
            if (count == 0)
                break;
            lease = lease_grant(&f.table, f.frame, &f.a, units, count, T0);
            if (lease && rounds % 3 == 0)
                lease_end(&f.table, lease);
        }
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_int_equal(f.frame->outstanding_count, 72);
        tear_down(&f);
    } while (failures > 0);
    assert_true(successes > 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(units_are_granted_in_passes_and_once),
        cmocka_unit_test(epochs_grow_and_fence),
        cmocka_unit_test(a_lapsed_lease_returns_what_is_left),
        cmocka_unit_test(the_last_unit_settled_ends_every_holder),
        cmocka_unit_test(one_of_two_holders_may_go),
        cmocka_unit_test(a_dead_worker_leaves_nothing_behind),
        cmocka_unit_test(memory_faults_lose_no_unit),
    };
    return cmocka_run_group_tests_name("lease", tests, NULL, NULL);
}
