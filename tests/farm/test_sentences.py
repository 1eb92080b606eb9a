#!/usr/bin/env python3
"""What a verb that does nothing says: why, and what to do."""
from farm import Farm, Tests, wait_for
from jobs import expect

tests = Tests()
ENDLESS = ("--size", "64x64", "--spp", "1000000")


@tests.add
def nothing_to_do():
    """A name or filter whose jobs are in other states names them, instead of 'no job matches'"""
    with Farm() as farm:
        farm.start_coordinator()
        jobs = [farm.submit(farm.scene(), *ENDLESS, "--name", name) for name in ("walk", "walk-2", "walk-3", "run")]
        farm.cli("pause", "walk", "--yes", expect=0)
        result = farm.cli("pause", "walk", "--yes")
        expect(result.code == 5 and "job %d (walk) is paused" % jobs[0] in result.err, result)
        farm.cli("cancel", "walk-*", "--yes", expect=0)
        result = farm.cli("finish", "walk-*", "--yes")
        expect(result.code == 5 and "job %d (walk-2) is cancelled" % jobs[1] in result.err and
               "job %d (walk-3) is cancelled" % jobs[2] in result.err, result)
        for n in range(4):
            farm.cli("cancel", farm.submit(farm.scene(), *ENDLESS, "--name", "many-%d" % n), expect=0)
        result = farm.cli("pause", "many-*", "--yes")
        expect(result.code == 5 and "and 1 more" in result.err and "(many-0) is cancelled" in result.err, result)
        # A filter that no job fits, whatever its state.
        result = farm.cli("pause", "--state", "failed", "--yes")
        expect(result.code == 5 and "no job matches" in result.err, result)
        # Of those that match some can be: they are.
        result = farm.cli("resume", "*", "--yes", "--json", expect=0).json()
        expect([j["job"] for j in result["jobs"]] == [jobs[0]], result)


@tests.add
def extend_says_what_to_do():
    """extend in a state in which it does nothing says what to do instead"""
    with Farm() as farm:
        farm.start_coordinator()
        job = farm.submit(farm.scene(), *ENDLESS)
        farm.cli("cancel", job, expect=0)
        result = farm.cli("extend", job, "--spp", "1048576")
        expect(result.code == 5 and "'retry'" in result.err and "job %d is" % job in result.err, result)


@tests.add
def a_paused_job_keeps_its_progress():
    """pause and restart: the samples on disk count while no film is open, after a restart those of the last figures"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "100000")
        wait_for(lambda: farm.job(job)["samples_done"] > 64 * 48 * 64, "samples")
        wait_for(lambda: farm.cli("show", job, "--history", "--json", expect=0).json()["points"], "stored figures")
        farm.cli("pause", job, expect=0)
        closed = wait_for(lambda: (lambda i: i if i["preview_covered"] == 0 else None)(farm.job(job)), "the film to be closed")
        expect(closed["samples_done"] > 64 * 48 * 64, closed)
        farm.coordinator.kill()
        farm.restart_coordinator()
        again = farm.job(job)
        expect(0 < again["samples_done"] <= closed["samples_done"], "%s, then %s" % (closed, again))
        farm.cli("resume", job, expect=0)
        wait_for(lambda: farm.job(job)["samples_done"] > closed["samples_done"], "more")
        expect(farm.job(job)["samples_done"] < 64 * 48 * 100000, "counted once")


tests.run()
