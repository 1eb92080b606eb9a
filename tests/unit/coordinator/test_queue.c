/* The queue: order of service, look-up, states. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/job/queue.h"
#include "coordinator/farm/rate.h"
#include "tests/support/sim_farm.h"

static struct job *add(struct queue *queue, uint64_t id, int32_t priority)
{
    struct job *job = sim_job(16, 16, 4, 1, 3, priority);

    job->id = id;
    assert_int_equal(queue_add(queue, job, NULL), STATUS_OK);
    return job;
}

static void priority_then_submission_decides(void **state)
{
    static const uint64_t expected[] = {4, 2, 5, 1, 6, 3};
    static const int32_t priorities[] = {0, 7, INT32_MIN, INT32_MAX, 7, 0};
    struct queue queue;

    (void)state;
    queue_init(&queue);
    for (size_t i = 0; i < 6; i++)
        add(&queue, i + 1, priorities[i]);
    assert_int_equal(queue.active_count, 6);
    for (size_t i = 0; i < 6; i++)
        assert_int_equal(queue.active[i]->id, expected[i]);
    for (uint64_t id = 1; id <= 6; id++)
        assert_int_equal(queue_find(&queue, id)->id, id);
    assert_null(queue_find(&queue, 0));
    assert_null(queue_find(&queue, 7));
    queue_release(&queue);
}

static void states_follow_the_diagram(void **state)
{
    struct queue queue;
    struct job *a, *b, *c;

    (void)state;
    queue_init(&queue);
    a = add(&queue, 1, 0);
    b = add(&queue, 2, 0);
    c = add(&queue, 3, 0);
    job_set_state(&queue, b, JOB_STATE_CANCELLED, "cancelled", 10, 99);
    assert_int_equal(queue.active_count, 2);
    assert_ptr_equal(queue.active[0], a);
    assert_ptr_equal(queue.active[1], c);
    assert_int_equal(b->finished_at, 99);
    job_set_state(&queue, a, JOB_STATE_RUNNING, NULL, 10, 99);
    assert_int_equal(queue.active_count, 2);
    a->active_since_ns = 1000;
    assert_true(job_active_seconds(a, 1000 + 3 * NS_PER_SECOND) == 3);
    job_set_state(&queue, a, JOB_STATE_DONE, NULL, 1000 + 2 * NS_PER_SECOND, 100);
    assert_true(job_active_seconds(a, 1000 + 9 * NS_PER_SECOND) == 2);
    job_set_state(&queue, c, JOB_STATE_FAILED, "no disk", 20, 101);
    assert_string_equal(c->state_text, "no disk");
    assert_int_equal(queue.active_count, 0);
    assert_int_equal(queue.count, 3);
    assert_ptr_equal(queue_find(&queue, 2), b);
    queue_release(&queue);
}

static void frames_done_are_counted_once(void **state)
{
    struct job *job = sim_job(10, 20, 30, 5, 20, 0);

    (void)state;
    assert_int_equal(job_frame_count(job), 16);
    assert_false(job_frame_is_done(job, 5));
    job_frame_set_done(job, 5);
    job_frame_set_done(job, 20);
    job_frame_set_done(job, 5);
    assert_true(job_frame_is_done(job, 5) && job_frame_is_done(job, 20));
    assert_false(job_frame_is_done(job, 6) || job_frame_is_done(job, 19));
    assert_int_equal(job->frames_done_count, 2);
    assert_int_equal(job->samples_done, 2 * 10 * 20 * 30);
    job_free(job);
}

static void memory_faults_leave_the_queue_whole(void **state)
{
    long successes = 0, failures;

    (void)state;
    do {
        struct queue queue;
        queue_init(&queue);
        mem_fault_arm(successes++, 1);
        for (uint64_t id = 1; id <= 40; id++) {
            struct job *job = job_new(1, 1);
            if (!job)
                job = job_new(1, 1);
            assert_non_null(job);
            job->id = id;
            if (queue_add(&queue, job, NULL) != STATUS_OK)
                assert_int_equal(queue_add(&queue, job, NULL), STATUS_OK);
        }
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_int_equal(queue.count, 40);
        assert_int_equal(queue.active_count, 40);
        queue_release(&queue);
    } while (failures > 0);
}

static void rates_cover_the_last_seconds(void **state)
{
    struct rate rate = {{0}, 0, 0};
    uint64_t now_ns = 100 * NS_PER_SECOND;

    (void)state;
    assert_true(rate_per_second(&rate, now_ns) == 0);
    for (int i = 0; i < 400; i++, now_ns += NS_PER_SECOND / 20)
        rate_add(&rate, 50, now_ns); /* 1000 a second for 20 s */
    assert_true(rate_per_second(&rate, now_ns) > 950 && rate_per_second(&rate, now_ns) < 1050);
    /* Silence lowers it, and ends it after the window. */
    assert_true(rate_per_second(&rate, now_ns + 5 * NS_PER_SECOND) < 700);
    assert_true(rate_per_second(&rate, now_ns + 11 * NS_PER_SECOND) == 0);
    /* After a silence it begins again: the old pace does not count. */
    now_ns += 60 * NS_PER_SECOND;
    for (int i = 0; i < 20; i++, now_ns += NS_PER_SECOND / 20)
        rate_add(&rate, 5, now_ns);
    assert_true(rate_per_second(&rate, now_ns) > 95 && rate_per_second(&rate, now_ns) < 106);
}

/* Frames around one take part in its picture: it waits for those that come, and films stay until they are spent. */
static void pictures_wait_for_the_frames_around(void **state)
{
    struct queue queue;
    struct job *job = sim_job(16, 16, 4, 1, 6, 0);
    uint32_t frame, around[JOB_AROUND_MAX];

    (void)state;
    queue_init(&queue);
    job->id = 1;
    assert_int_equal(queue_add(&queue, job, NULL), STATUS_OK);
    job->output.tonemap.denoise_around = 1;
    job_frame_set_done(job, 1);
    assert_true(job_frame_to_develop(job, &frame)); /* it is not denoised */
    job->output.tonemap.denoise = DENOISING_ON;
    assert_false(job_frame_to_develop(job, &frame));
    job_frame_set_done(job, 3);
    assert_false(job_frame_to_develop(job, &frame));
    job_frame_set_done(job, 2);
    assert_true(job_frame_to_develop(job, &frame));
    assert_int_equal(frame, 1);
    assert_int_equal(job_frames_around(job, 1, around), 1);
    assert_int_equal(around[0], 2);
    job_frame_set_developed(job, 1);
    assert_true(job_frame_to_develop(job, &frame));
    assert_int_equal(frame, 2);
    assert_int_equal(job_frames_around(job, 2, around), 2);
    assert_true(around[0] == 1 && around[1] == 3);
    assert_false(job_film_is_spent(job, 1)); /* frame 2 needs it */
    job_frame_set_developed(job, 2);
    assert_true(job_film_is_spent(job, 1));
    assert_false(job_film_is_spent(job, 2)); /* frame 3 needs it */
    assert_false(job_frame_to_develop(job, &frame));
    job_frame_rest(job, 4); /* it will not come */
    assert_true(job_frame_to_develop(job, &frame));
    assert_int_equal(frame, 3);
    assert_int_equal(job_frames_around(job, 3, around), 1);
    job_frame_set_developed(job, 3);
    assert_true(job_film_is_spent(job, 2) && job_film_is_spent(job, 3));
    job_frame_set_done(job, 6);
    assert_false(job_frame_to_develop(job, &frame)); /* frame 5 comes */
    job_set_state(&queue, job, JOB_STATE_CANCELLED, "cancelled", 10, 99);
    assert_true(job_frame_to_develop(job, &frame));
    assert_int_equal(frame, 6);
    assert_int_equal(job_frames_around(job, 6, around), 0);
    assert_false(job_film_is_spent(job, 6));
    queue_release(&queue);
}

/* Reopen those frames of eight that are done, and give which then have no pictures, a bit a frame. */
static unsigned remade(uint32_t around, uint32_t temporal, const uint32_t *frames, size_t count)
{
    struct queue queue;
    struct job *job = sim_job(16, 16, 4, 1, 8, 0);
    struct job_reopening r;
    unsigned before = 0, after = 0;

    queue_init(&queue);
    job->id = 1;
    assert_int_equal(queue_add(&queue, job, NULL), STATUS_OK);
    job->output.tonemap.denoise = DENOISING_ON;
    job->output.tonemap.denoise_around = around;
    job->output.tonemap.temporal = temporal;
    for (uint32_t frame = 1; frame <= 8; frame++) {
        job_frame_set_done(job, frame);
        job_frame_set_developed(job, frame);
    }
    assert_int_equal(job_reopening_of(&r, job, frames, count, job->settings.spp, NULL), STATUS_OK);
    assert_int_equal(job_reopen_check(&queue, job, NULL), STATUS_OK);
    for (uint32_t frame = 1; frame <= 8; frame++)
        before |= (unsigned)job_reopening_remakes(&r, job, frame) << frame;
    job_reopen_frames(&queue, job, &r);
    for (uint32_t frame = 1; frame <= 8; frame++) {
        assert_int_equal(job_reopening_remakes(&r, job, frame), before >> frame & 1);
        after |= (unsigned)(job_frame_is_done(job, frame) && !job_frame_is_developed(job, frame)) << frame;
    }
    assert_int_equal(before, after);
    assert_int_equal(job->frames_done_count, 8 - count);
    assert_int_equal(job->frames_done_count - job->frames_developed_count, __builtin_popcount(after));
    job_reopening_release(&r);
    queue_release(&queue);
    return after;
}

/* What is made of several frames is made again with each of them. */
static void pictures_follow_the_frames_around(void **state)
{
    (void)state;
    assert_int_equal(remade(0, 1, (uint32_t[]){4}, 1), 0);
    assert_int_equal(remade(1, 1, (uint32_t[]){4}, 1), 1u << 3 | 1u << 5);
    assert_int_equal(remade(2, 1, (uint32_t[]){1, 8}, 2), 1u << 2 | 1u << 3 | 1u << 6 | 1u << 7);
    assert_int_equal(remade(0, 3, (uint32_t[]){4}, 1), 1u << 5 | 1u << 6);
    assert_int_equal(remade(1, 2, (uint32_t[]){4, 5}, 2), 1u << 3 | 1u << 6);
    assert_int_equal(remade(2, 4, (uint32_t[]){3}, 1), 1u << 1 | 1u << 2 | 1u << 4 | 1u << 5 | 1u << 6);
}

/* The same as its definition says it, whatever frames are missing. */
static void remade_as_defined(void **state)
{
    enum { FRAMES = 19 };
    uint32_t x = 1;

    (void)state;
    for (int round = 0; round < 400; round++) {
        struct job *job = sim_job(16, 16, 4, 5, 4 + FRAMES, 0);
        struct job_reopening r;
        uint32_t chosen[FRAMES], count = 0, around = (uint32_t)round % 3, temporal = (uint32_t)round / 3 % 7;

        job->output.tonemap.denoise = DENOISING_ON;
        job->output.tonemap.denoise_around = around;
        job->output.tonemap.temporal = temporal;
        for (uint32_t frame = 5; frame <= 4 + FRAMES; frame++) {
            x = x * 1664525u + 1013904223u;
            if (x >> 28 == 0)
                chosen[count++] = frame;
            if (x >> 28 != 1)
                job_frame_set_done(job, frame);
        }
        assert_int_equal(job_reopening_of(&r, job, chosen, count, job->settings.spp, NULL), STATUS_OK);
        for (uint32_t frame = 5; frame <= 4 + FRAMES; frame++) {
            int remakes = 0;
            for (uint32_t at = 5; at <= 4 + FRAMES; at++)
                if (!job_frame_is_done(job, at) || job_reopening_has(&r, job, at))
                    remakes |= (at < frame && (frame - at <= around || frame - at < temporal)) ||
                               (at > frame && at - frame <= around);
            remakes &= job_frame_is_done(job, frame) && !job_reopening_has(&r, job, frame);
            assert_int_equal(job_reopening_remakes(&r, job, frame), remakes);
        }
        job_reopening_release(&r);
        job_free(job);
    }
}

/* The first and the last frame that there can be. */
static void frames_around_end_at_the_ends(void **state)
{
    struct job *first = sim_job(16, 16, 4, 0, 2, 0), *last = sim_job(16, 16, 4, UINT32_MAX - 1, UINT32_MAX, 0);
    uint32_t frame, around[JOB_AROUND_MAX];

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct job *job = i ? last : first;
        job->output.tonemap.denoise = DENOISING_FAST;
        job->output.tonemap.denoise_around = 2;
        for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
            assert_false(job_frame_to_develop(job, &frame));
            job_frame_set_done(job, (uint32_t)at);
        }
        for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
            assert_true(job_frame_to_develop(job, &frame));
            assert_int_equal(frame, at);
            assert_int_equal(job_frames_around(job, frame, around), job->last_frame - job->first_frame);
            job_frame_set_developed(job, frame);
        }
        assert_true(job_film_is_spent(job, job->first_frame) && job_film_is_spent(job, job->last_frame));
        job_free(job);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(priority_then_submission_decides),
        cmocka_unit_test(states_follow_the_diagram),
        cmocka_unit_test(frames_done_are_counted_once),
        cmocka_unit_test(memory_faults_leave_the_queue_whole),
        cmocka_unit_test(rates_cover_the_last_seconds),
        cmocka_unit_test(pictures_wait_for_the_frames_around),
        cmocka_unit_test(remade_as_defined), cmocka_unit_test(frames_around_end_at_the_ends),
        cmocka_unit_test(pictures_follow_the_frames_around),
    };
    return cmocka_run_group_tests_name("queue", tests, NULL, NULL);
}
