#include "tests/support/sim_states.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "coordinator/farm/closing.h"
#include "tests/support/steering.h"

struct sim_worker *sim_stored_connect(struct sim_stored *f, uint32_t threads)
{
    return sim_connect(f->sim, f->workers++, threads);
}

void sim_stored_tick(struct sim_stored *f)
{
    f->sim->now_ns += NS_PER_SECOND;
    sim_freeze(f->sim);
    sim_commit(f->sim);
    farm_tick(&f->sim->farm, f->sim->now_ns);
}

struct job *sim_stored_job(struct sim_stored *f) { return f->sim->farm.queue.all[0]; }

struct job *sim_job_running(struct sim_stored *f)
{
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    struct sim_worker *worker = sim_stored_connect(f, 4);

    assert_true(sim_grant(f->sim, worker, 8) == 8);
    for (size_t i = 0; i < 2; i++)
        assert_int_equal(sim_send(f->sim, worker, i, 100), MERGE_PENDING);
    sim_commit(f->sim);
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_false(film_covered(job->frames->film));
    return job;
}

void sim_job_park(struct sim_stored *f, struct job *job)
{
    struct sim_worker *victim = sim_stored_connect(f, 1);

    for (uint64_t i = 1; i < SUSPICION_DEATHS; i++)
        suspicion_add(&job->suspicion, i, f->sim->now_ns, f->sim->now_ns);
    closing_note_death(&f->sim->farm, job, &victim->worker, f->sim->now_ns, f->sim->now_ns);
}

void sim_stored_render(struct sim_stored *f)
{
    struct sim_worker *worker = sim_stored_connect(f, 16);

    for (int i = 0; i < 20; i++) {
        while (sim_grant(f->sim, worker, 64) > 0)
            for (size_t k = 0; k < worker->unit_count; k++)
                if (!worker->units[k].sent)
                    (void)sim_send(f->sim, worker, k, 100);
        sim_stored_tick(f);
        sim_develop(f->sim);
        while (sim_make_picture(f->sim))
            ;
    }
    sim_disconnect(f->sim, f->workers - 1);
}

struct job *sim_job_in(struct sim_stored *f, enum job_state state)
{
    struct sim *sim = f->sim;
    struct job *job = sim_job_running(f);

    switch (state) {
    case JOB_STATE_QUEUED: /* one that has begun */
        assert_int_equal(do_verb(&sim->farm, job, VERB_PAUSE, "ana@desk", sim->now_ns, NULL), STATUS_OK);
        sim_stored_tick(f);
        assert_int_equal(do_verb(&sim->farm, job, VERB_RESUME, "ana@desk", sim->now_ns, NULL), STATUS_OK);
        break;
    case JOB_STATE_PAUSED:
        assert_int_equal(do_verb(&sim->farm, job, VERB_PAUSE, "ana@desk", sim->now_ns, NULL), STATUS_OK);
        break;
    case JOB_STATE_PARKED: sim_job_park(f, job); break;
    case JOB_STATE_FINISHING:
        assert_int_equal(do_verb(&sim->farm, job, VERB_FINISH, "ana@desk", sim->now_ns, NULL), STATUS_OK);
        break;
    case JOB_STATE_CANCELLING: farm_cancel(&sim->farm, job, 0, sim->now_ns); break;
    case JOB_STATE_CANCELLED: farm_cancel(&sim->farm, job, 1, sim->now_ns); break;
    case JOB_STATE_FAILED: farm_fail(&sim->farm, job, sim->now_ns, "a broken scene"); break;
    case JOB_STATE_DONE: sim_stored_render(f); break;
    default: break;
    }
    assert_int_equal(job->state, state);
    return job;
}
