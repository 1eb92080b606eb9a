"""The same job gives the same bits: whatever the workers and threads, whichever worker comes late, stops,
dies or drains on the way, and also when the coordinator itself is killed and started again."""
import atexit
import os
import re
import shutil
import signal
import sys
import tempfile

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import PATIENCE, Farm, Tests, wait_for
from jobs import (AREA, MIRROR, SLOW, SPHERES, LongJob, Outcome, expect, expect_same, make_sky,
                  wait_mid_frame, wait_slowly, worker_of)

tests = Tests()
KEPT = tempfile.mkdtemp(prefix="azulejo-kept-")
atexit.register(shutil.rmtree, KEPT, ignore_errors=True)

# Workers, threads of each. The first is what all others must equal.
SHAPES = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (3, 2)]
SIZE = "49x33" if SLOW else "97x61"  # neither is a multiple of the tile's 16 pixels
ATTEMPTS = 8  # a short job may be over before the last worker has done anything


def render(farm, workers, scene, options, name):
    """Render until a job came out in which every worker had its part; all jobs must agree."""
    first = None
    for attempt in range(ATTEMPTS):
        before = {w["process"]: w["units_done"] for w in farm.list_workers()}
        number = farm.submit(scene, *options)
        farm.wait_for_job(number)
        outcome = Outcome(farm, number, "%s-%d" % (name, attempt))
        if first:
            expect_same(farm, outcome, first, "%s, again" % name)
        first = first or outcome
        after = {w["process"]: w["units_done"] for w in farm.list_workers()}
        if len(after) == workers and all(after[p] > before[p] for p in after):
            return outcome
    expect(False, "%d jobs, and never did all of %d workers take part" % (ATTEMPTS, workers))


def every_shape(name, scene, options, with_sky=False):
    reference = None
    for workers, threads in SHAPES:
        with Farm() as farm:
            what = "%s with %d workers of %d threads" % (name, workers, threads)
            full = list(options) + (["--env", make_sky(farm)] if with_sky else [])
            farm.start_coordinator()
            for _ in range(workers):
                farm.start_worker(threads=threads)
            farm.wait_for_workers(workers)
            outcome = render(farm, workers, scene, full, "%d-%d" % (workers, threads))
            if reference:
                expect_same(farm, outcome, reference, what)
                continue
            reference = outcome.keep("%s/%s" % (KEPT, name))
            expect(all(m > 0.001 for m in reference.means), "a black picture: %s" % reference.means)
            # This test can fail: another seed is another picture.
            other_job = farm.submit(scene, *full, "--seed", "1")
            farm.wait_for_job(other_job)
            other = Outcome(farm, other_job, "other")
            expect(other.bits != reference.bits and other.pngs != reference.pngs, "equal: " + what)
            for mine, theirs in zip(other.exrs, reference.exrs):
                expect(farm.cli("compare", mine, theirs).code == 1, "compare does not see it")


@tests.add
def cornell_with_mirrors():
    """mirrors under a sky, 13 samples a pixel: one picture from six shapes of farm"""
    every_shape("mirror", MIRROR, ["--size", SIZE, "--spp", "13"], with_sky=True)


@tests.add
def cornell_with_a_lamp():
    """a lamp, two frames of 13 samples a pixel: the same two from six shapes of farm"""
    every_shape("area", AREA, ["--size", SIZE, "--spp", "13", "--frames", "4-5"])


@tests.add
def textured_spheres():
    """textures, normal maps and rough metal, 24 samples a pixel: one picture from six shapes"""
    every_shape("spheres", SPHERES, ["--size", SIZE, "--spp", "24", "--half"])


# ---- a job that is disturbed in the middle -------------------------------------------------

LONG = LongJob(3.0 if not SLOW else 4.0, "65x49" if SLOW else "193x121")


def begin(farm, workers=1, coordinator=()):
    """A coordinator and workers of one thread each; the undisturbed job, made by the first test."""
    farm.start_coordinator(*coordinator)
    for _ in range(workers):
        farm.start_worker()
    farm.wait_for_workers(workers)
    if LONG.reference is None:
        LONG.measure(farm)
        print("# the long job has %d samples a pixel" % LONG.spp, flush=True)
        number = LONG.submit(farm)
        farm.wait_for_job(number, limit_s=LONG.seconds * 20)
        LONG.reference = Outcome(farm, number, "reference").keep(KEPT + "/long")
        expect(LONG.reference.means[0] > 0.01, "a black picture")


def finish(farm, number, what, counts=True):
    farm.wait_for_job(number, limit_s=LONG.seconds * 20)
    expect_same(farm, Outcome(farm, number, "end-%d" % number), LONG.reference, what, counts)


@tests.add
def processors_of_the_coordinator():
    """a frame's files are the same, and its kept film goes on to the same, however many processors make them"""
    first = []
    for prefix in (["taskset", "-c", str(min(os.sched_getaffinity(0)))], []):
        with Farm() as farm:
            farm.start_coordinator(prefix=prefix)
            farm.start_worker()
            number = farm.submit(AREA, "--size", "300x300", "--spp", "2", "--half", "--aov", "depth,albedo,error")
            farm.wait_for_job(number)
            outcomes = [Outcome(farm, number, "made")]
            farm.cli("extend", number, "--spp", "4", expect=0)
            farm.wait_for_job(number)
            outcomes.append(Outcome(farm, number, "extended"))
            for mine, name in zip(outcomes, ("processors", "extended")):
                if prefix:
                    first.append(mine.keep(os.path.join(KEPT, name)))
                else:
                    expect_same(farm, mine, first.pop(0), name)


@tests.add
def late_workers():
    """workers that join in mid-frame have their part, and the bits are the same"""
    with Farm() as farm:
        begin(farm)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        first = farm.workers[0]
        first.signal(signal.SIGSTOP)  # the job may not end before they are there
        late = [farm.start_worker(threads=t) for t in (1, 2)]
        wait_for(lambda: all((worker_of(farm, w) or {"units_done": 0})["units_done"] for w in late), "their part")
        first.signal(signal.SIGCONT)
        finish(farm, number, "late workers")
        for worker in late:
            expect(worker_of(farm, worker)["units_done"] > 0, "a late worker did nothing")


@tests.add
def killed_worker():
    """a worker that is killed in mid-frame loses no unit; another takes its place"""
    with Farm() as farm:
        begin(farm, 2)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        victim = farm.workers[0]
        wait_for(lambda: worker_of(farm, victim)["units_leased"] > 0, "the victim to have work")
        victim.kill()
        substitute = farm.start_worker()
        finish(farm, number, "a killed worker")
        expect(worker_of(farm, victim) is None, "the dead worker is still listed")
        expect(worker_of(farm, substitute)["units_done"] > 0, "the substitute did nothing")


@tests.add
def killed_again_and_again():
    """every worker of a farm is killed in turn, and the bits are the same"""
    with Farm() as farm:
        begin(farm, 2)
        number = LONG.submit(farm)
        for share in (0.1, 0.25, 0.4, 0.55):
            wait_mid_frame(farm, number, share)
            for worker in [w for w in farm.workers if w.alive()]:
                worker.kill()
            for _ in range(2):
                farm.start_worker()
        finish(farm, number, "workers killed in turn")


@tests.add
def stopped_worker():
    """a worker that stands still for longer than its lease delays nobody; its late results change nothing"""
    with Farm() as farm:
        begin(farm, 2, ("--lease-seconds", "1"))
        number = LONG.submit(farm)
        sleeper, awake = farm.workers

        def mid_frame():
            job, worker = farm.job(number), worker_of(farm, sleeper)
            return worker if job["samples_done"] >= 0.1 * job["samples_total"] and worker["units_leased"] else None
        # No worker runs between a look and what is done about it: a busy machine would let the job end there.
        both = (sleeper, awake)
        before = wait_slowly(farm, mid_frame, "the sleeper to have work in mid-frame", keep_stopped=both)
        awake.signal(signal.SIGCONT)
        wait_slowly(farm, lambda: worker_of(farm, sleeper)["units_leased"] == 0, "its leases to lapse")
        # What lapsed is the first that the other gets: let it do all of that.
        goal = worker_of(farm, awake)["units_done"] + before["units_leased"] + 16
        wait_slowly(farm, lambda: worker_of(farm, awake)["units_done"] >= goal or
                    farm.job(number)["state"] == "done", "the other to do the sleeper's work", keep_stopped=both)
        job = farm.job(number)
        expect(job["state"] == "running", "the job is over before the sleeper wakes: %s" % job)
        for worker in both:
            worker.signal(signal.SIGCONT)
        done = worker_of(farm, sleeper)["units_done"]
        wait_for(lambda: farm.job(number)["state"] == "done" or
                 worker_of(farm, sleeper)["units_done"] > done, "the sleeper to work again")
        finish(farm, number, "a stopped worker")
        log = farm.coordinator.log_text()
        expect(re.search(r"lease \d+ of session \d+ lapsed", log), "no lease lapsed")
        after = worker_of(farm, sleeper)
        expect(after and after["session"] == before["session"], "the sleeper had to join again")
        expect(sleeper.alive(), "the sleeper ended")


@tests.add
def stopped_for_good():
    """a worker that never wakes up does not hold up the frame's end"""
    with Farm() as farm:
        begin(farm, 2)  # leases of 60 s: overdue work must go to the other long before
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        sleeper = farm.workers[0]
        wait_for(lambda: worker_of(farm, sleeper)["units_leased"] > 0, "the sleeper to have work")
        sleeper.signal(signal.SIGSTOP)
        finish(farm, number, "a worker that was stopped for good")
        sleeper.signal(signal.SIGCONT)
        # It finds that nobody wants its results, and is there for the next job.
        again = LONG.submit(farm)
        finish(farm, again, "the job after that")
        expect(sleeper.alive(), "the sleeper ended")


@tests.add
def drained_worker():
    """SIGTERM in mid-frame: the worker finishes what is in work, gives back the rest, and exits with 0"""
    with Farm() as farm:
        begin(farm, 2)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        for worker, number_of_signal in zip(list(farm.workers), (signal.SIGTERM, signal.SIGINT)):
            wait_for(lambda: worker_of(farm, worker)["units_leased"] > 0, "work")
            worker.signal(number_of_signal)
            code = worker.wait(60)
            expect(code == 0, "exit status %d:\n%s" % (code, worker.log_text()))
            expect("returning the rest" in worker.log_text(), worker.log_text())
        expect(farm.job(number)["state"] == "running", "nothing was left to do")
        farm.start_worker()
        finish(farm, number, "drained workers")


@tests.add
def killed_coordinator():
    """the coordinator is killed twice in mid-frame: workers return by themselves, the frame goes on, same bits"""
    with Farm() as farm:
        begin(farm, 2)
        number = LONG.submit(farm)
        for share in (0.15, 0.45):
            done = wait_mid_frame(farm, number, share)["samples_done"]
            farm.coordinator.kill()
            farm.restart_coordinator()
            # What was on disk is there again; at most the last moments are lost.
            resumed = farm.job(number)["samples_done"]
            expect(resumed > done / 2, "%d of %d samples are left" % (resumed, done))
            expect("continues at" in farm.coordinator.log_text(), farm.coordinator.log_text())
            farm.wait_for_workers(2)
        finish(farm, number, "a killed coordinator", counts=False)  # counters are saved now and then
        expect(all(w.alive() for w in farm.workers), "a worker ended")


@tests.add
def restarted_coordinator():
    """SIGTERM ends the coordinator with 0, and nothing that a frame held is lost"""
    with Farm() as farm:
        begin(farm, 2)
        number = LONG.submit(farm)
        done = wait_mid_frame(farm, number)["samples_done"]
        code = farm.coordinator.stop()
        expect(code == 0, "exit status %d:\n%s" % (code, farm.coordinator.log_text()))
        farm.restart_coordinator()
        expect(farm.job(number)["samples_done"] >= done, "samples were lost")
        # Passes that came early wait in memory and are rendered again, so more may be counted.
        finish(farm, number, "a restarted coordinator", counts=False)
        counted = farm.job(number)["work"]["samples"]
        expect(counted >= LONG.reference.job["work"]["samples"], "counters were lost: %d" % counted)
        expect(all(w.alive() for w in farm.workers), "a worker ended")


@tests.add
def everything_at_once():
    """a worker killed, one stopped, one late, the coordinator killed: the same bits"""
    with Farm() as farm:
        begin(farm, 3, ("--lease-seconds", "1"))
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        first, second, third = farm.workers
        second.signal(signal.SIGSTOP)
        first.kill()
        farm.coordinator.kill()
        farm.restart_coordinator("--lease-seconds", "1")
        farm.start_worker(threads=2)
        wait_mid_frame(farm, number, 0.4)
        second.signal(signal.SIGCONT)
        finish(farm, number, "everything at once", counts=False)
        wait_for(lambda: worker_of(farm, second), "the sleeper to return", 60 * PATIENCE)


if __name__ == "__main__":
    tests.run()
