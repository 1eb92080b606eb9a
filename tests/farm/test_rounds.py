"""Rounds, stop rules, extend and schedules: the same bits whatever renders, dies or starts again, and the bits
that the rules would have given at once."""
import os
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests, wait_for
from jobs import AREA, SLOW, expect

tests = Tests()
SIZE = ["--size", "49x33" if SLOW else "97x61", "--aov", "samples"]
TARGET = ["--target-error", "19/255"]
# What only this job or this run knows.
OWN = {"azulejo:jobName", "azulejo:measured"}


def farm_of(farm, workers):
    farm.start_coordinator()
    for _ in range(workers):
        farm.start_worker()
    farm.wait_for_workers(workers)


class Result:
    """A finished job's only picture."""

    def __init__(self, farm, number, name):
        self.info = farm.job(number)
        path = [f for f in farm.fetch(number, name) if f.endswith(".exr")][0]
        self.path = path
        self.picture = read_exr(path)
        self.bits = self.picture.bits()
        self.attributes = {n: v for n, v in self.picture.attributes.items() if n not in OWN}
        self.ends = [c["end"] for c in self.info["cut_frames"]]


def render(farm, *options, name="picture"):
    number = farm.submit(AREA, *SIZE, *options)
    farm.wait_for_job(number)
    return Result(farm, number, "%s-%s" % (name, number))


def expect_equal(a, b, what, but=()):
    differ = [n for n in set(a.attributes) | set(b.attributes)
              if n not in but and a.attributes.get(n) != b.attributes.get(n)]
    expect(a.picture.values("samples.Y") == b.picture.values("samples.Y"), "%s: other samples" % what)
    expect(a.bits == b.bits, "%s: other pixels" % what)
    expect(not differ, "%s: other attributes: %s" % (what, differ))


def reference(farm, *options):
    """The same scene, in this farm, without disturbance."""
    return render(farm, *options, name="at-once")


@tests.add
def a_target_gives_the_same_bits():
    """--target-error with 1, 2 and 3 workers, one of them killed: same pixels and attributes"""
    first = None
    for workers in (1, 2, 3):
        with Farm() as farm:
            farm_of(farm, workers)
            number = farm.submit(AREA, *SIZE, *TARGET)
            if workers == 3:
                wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
                farm.workers[0].kill()
            farm.wait_for_job(number)
            result = Result(farm, number, "target")
            counts = result.picture.values("samples.Y")
            expect(result.ends == ["target"], result.info["cut_frames"])
            expect(min(counts) >= 4 and len(set(counts)) > 1, "not adaptive: %s" % set(counts))
            expect(result.picture.number("azulejo:complete") == 1, "complete")
            expect("azulejo:schedule" not in result.attributes, "a schedule that nobody needs")
            first = first or result
            expect_equal(result, first, "%d workers" % workers)


@tests.add
def a_killed_coordinator_decides_the_same():
    """kill -9 of the coordinator at several moments of several rounds: same pixels and attributes"""
    with Farm() as farm:
        farm_of(farm, 2)
        whole = reference(farm, *TARGET)
        number = farm.submit(AREA, *SIZE, *TARGET)
        total = whole.info["samples_done"]
        for share in (0.02, 0.1, 0.3, 0.6):
            def far_enough():
                job = farm.job(number)
                return job["state"] == "done" or job["samples_done"] > share * total
            wait_for(far_enough, "%g of the samples" % share)
            farm.coordinator.kill()
            farm.restart_coordinator()
        farm.wait_for_job(number)
        expect_equal(Result(farm, number, "killed"), whole, "killed")


@tests.add
def what_clamping_took_survives_a_kill():
    """--clamp, kill -9 of the coordinator: the same clampedSamples and clampedShare in the header and in show"""
    with Farm() as farm:
        farm_of(farm, 2)
        options = ["--spp", "160", "--clamp", "0.2"]
        whole = reference(farm, *options)
        expect(whole.picture.number("azulejo:clampedSamples") > 0, "nothing is clamped")
        number = farm.submit(AREA, *SIZE, *options)
        wait_for(lambda: farm.job(number)["samples_done"] > 0.3 * whole.info["samples_done"], "samples")
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_job(number)
        killed = Result(farm, number, "killed")
        expect_equal(killed, whole, "killed")
        counts = ("clamped_samples", "clamped_luminance", "kept_luminance", "rays", "leaked_rays", "health")
        told = [{name: info["work"][name] for name in counts} for info in (killed.info, whole.info)]
        expect(told[0] == told[1], told)
        farm.coordinator.kill()
        farm.restart_coordinator()
        again = farm.job(number)["work"]
        expect({name: again[name] for name in counts} == told[0], (again, told[0]))


@tests.add
def limits_end_frames():
    """time and core limits: every tile has samples, the job is done, the words say what ended it"""
    with Farm() as farm:
        farm_of(farm, 1)
        for option, end, words in (("--time-limit", "time", "ended by the time limit after"),
                                   ("--core-limit", "cores", "ended by the core limit after")):
            number = farm.submit(AREA, *SIZE, option, "1s")
            farm.wait_for_job(number)
            result = Result(farm, number, end)
            expect(result.ends == [end], result.info["cut_frames"])
            expect(min(result.picture.values("samples.Y")) >= 1, "a tile without samples")
            expect(words in farm.cli("show", number, expect=0).out, "show")


@tests.add
def rays_are_limited():
    """--max-rays: a frame has that many and few more; extend goes on to a larger number over a restart; by its schedule the same bits"""
    with Farm() as farm:
        farm_of(farm, 2)
        number = farm.submit(AREA, *SIZE, "--max-rays", "3e5")
        farm.wait_for_job(number)
        for limit in (300000, 900000):
            result = Result(farm, number, "rays-%d" % limit)
            expect(result.ends == ["rays"], result.info["cut_frames"])
            # What workers have in hand when the limit is met is finished: on a busy machine that is a lot beside so few.
            expect(limit <= result.info["work"]["rays"] < 3 * limit, (limit, result.info["work"]["rays"]))
            expect(int(result.info["stop"]["max_rays"]) == limit, result.info["stop"])
            expect("ended by the limit of rays after" in farm.cli("show", number, expect=0).out, "show")
            again = render(farm, "--schedule-from", result.path)
            expect(again.info["by_schedule"] and not result.info["by_schedule"], "by_schedule")
            expect(again.bits == result.bits and again.ends == ["schedule"], "other pixels by its schedule: %s" % again.ends)
            if limit == 300000:
                for few in ("2e5", "3e5"):
                    refused = farm.cli("extend", number, "--max-rays", few)
                    expect(refused.code == 5 and "was rendered to 300000 rays a frame" in refused.err, refused)
                farm.cli("extend", number, "--max-rays", "9e5", expect=0)
                farm.coordinator.kill()
                farm.restart_coordinator()
                farm.wait_for_job(number)


@tests.add
def an_extended_job_is_as_at_once():
    """extend: spp to spp over a short pass, target to smaller target, spp to target, time limit to spp"""
    with Farm() as farm:
        farm_of(farm, 2)
        cases = [(["--spp", "11"], ["--spp", "29"], ["--spp", "29"]),
                 (["--target-error", "32/255"], TARGET, TARGET),
                 (["--spp", "13"], TARGET, ["--min-spp", "13"] + TARGET),
                 (["--time-limit", "1s"], ["--spp", "more"], ["--spp", "more"]),
                 (["--target-error", "32/255"], ["--spp", "72"], ["--spp", "72"])]
        for before, more, at_once in cases:
            number = farm.submit(AREA, *SIZE, *before)
            farm.wait_for_job(number)
            old = Result(farm, number, "before")
            if "more" in more:  # than the machine had in that time
                cap = str(40 + int(1.6 * max(old.picture.values("samples.Y"))))
                more, at_once = ["--spp", cap], ["--spp", cap]
            farm.cli("extend", number, *more, expect=0)
            farm.wait_for_job(number)
            new = Result(farm, number, "after-%s" % number)
            expect(sum(new.picture.values("samples.Y")) > sum(old.picture.values("samples.Y")), "nothing more")
            expect_equal(new, reference(farm, *at_once), "%s, then %s" % (before, more))
        # A coordinator that is killed in the middle of it goes on.
        number = farm.submit(AREA, *SIZE, "--spp", "11")
        farm.wait_for_job(number)
        farm.cli("extend", number, "--spp", "72", expect=0)
        wait_for(lambda: farm.job(number)["samples_done"] > 97 * 61 * 20, "samples")
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_job(number)
        expect_equal(Result(farm, number, "killed"), reference(farm, "--spp", "72"), "killed while extended")


@tests.add
def what_cannot_be_extended_is_refused():
    """extend of a done job: fewer samples, a looser target, films that are gone"""
    with Farm() as farm:
        farm.start_coordinator()
        running = farm.submit(AREA, *SIZE, "--spp", "16")
        farm.start_worker()
        farm.wait_for_job(running)
        expect("give --spp 16 or more" in farm.cli("extend", running, "--spp", "8", expect=5).err, "fewer")
        expect("larger --spp" in farm.cli("extend", running, "--spp", "16", expect=5).err, "the same")
        expect("say when the pictures" in farm.cli("extend", running, expect=2).err, "nothing")
        target = farm.submit(AREA, *SIZE, "--target-error", "24/255")
        farm.wait_for_job(target)
        for other in ("30/255", "24/255"):
            expect("smaller error" in farm.cli("extend", target, "--target-error", other, expect=5).err, other)
        expect("up to" in farm.cli("extend", target, "--spp", "4", expect=5).err, "fewer than the target took")
        kept = os.path.join(farm.store, "films", str(running))
        expect(os.listdir(kept) == ["frame-0001.kept"], os.listdir(kept))
        farm.cli("cancel", "--discard", running, expect=0)
        expect("its film was not kept" in farm.cli("extend", running, "--spp", "32", expect=5).err, "no films")


@tests.add
def a_schedule_gives_the_picture_again():
    """--schedule-from: what a limit or a cancel ended, again, by another number of workers; errors name the file"""
    with Farm() as farm:
        farm_of(farm, 1)
        limited = farm.submit(AREA, *SIZE, "--time-limit", "1s")
        farm.wait_for_job(limited)
        cut = farm.submit(AREA, *SIZE, "--spp", "100000")
        wait_for(lambda: farm.job(cut)["samples_done"] > 97 * 61 * 20, "samples")
        farm.cli("cancel", cut, expect=0)
        farm.wait_for_job(cut, "cancelled")
        farm.start_worker()
        farm.wait_for_workers(2)
        for number in (limited, cut):
            first = Result(farm, number, "first-%s" % number)
            expect("azulejo:schedule" in first.attributes, "no schedule")
            again = render(farm, "--schedule-from", first.path)
            expect(again.picture.values("samples.Y") == first.picture.values("samples.Y"), "other samples")
            expect(again.bits == first.bits, "other pixels")
            expect(again.attributes["azulejo:schedule"] == first.attributes["azulejo:schedule"], "schedule")
            local = farm.path("local-%s.exr" % number)
            farm.cli("render", AREA, *SIZE, "--schedule-from", first.path, "-o", local, expect=0)
            expect(read_exr(local).bits() == first.bits, "other pixels, locally")
        bad = farm.cli("submit", AREA, "--size", "32x32", "--schedule-from", first.path, expect=2)
        expect(first.path in bad.err and "pixels" in bad.err, bad.err)
        expect("leave out" in farm.cli("submit", AREA, *SIZE, "--spp", "4", "--schedule-from", first.path,
                                       expect=2).err, "with --spp")
        plain = render(farm, "--spp", "4")
        expect("azulejo:schedule" not in plain.attributes, "a schedule that nobody needs")
        bad = farm.cli("submit", AREA, *SIZE, "--schedule-from", plain.path, expect=3)
        expect(plain.path in bad.err and "has no schedule" in bad.err, bad.err)


tests.run()
