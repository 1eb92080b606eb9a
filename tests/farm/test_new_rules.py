"""extend on a job that has not ended: its target, cap or limit changes while it waits, renders or is paused."""
import json
import os
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests, wait_for
from jobs import AREA, expect

tests = Tests()
SIZE = ["--size", "65x49", "--aov", "samples"]
STRICT, LAX = ["--target-error", "17/255"], ["--target-error", "24/255"]
NEVER = ["--target-error", "0.1/255"]
PIXELS = 65 * 49
# What only this job or this run knows.
OWN = {"azulejo:jobName", "azulejo:measured"}


def picture(farm, number, name, frame=1):
    result = farm.cli("fetch", number, "--frames", frame, "-o", farm.path(name), "--json", expect=0).json()
    path = os.path.join(farm.folder, [f for f in result["files"] if f.endswith(".exr")][0])
    return read_exr(path), path


def log(farm, number):
    return [json.loads(line) for line in farm.cli("log", number, "--json", expect=0).out.splitlines()]


def render(farm, *options):
    number = farm.submit(AREA, *SIZE, *options)
    farm.wait_for_job(number)
    return picture(farm, number, "at-once-%d" % number)[0]


def expect_equal(a, b, what):
    expect(a.values("samples.Y") == b.values("samples.Y"), "%s: other samples" % what)
    expect(a.bits() == b.bits(), "%s: other pixels" % what)
    differ = [n for n in set(a.attributes) | set(b.attributes)
              if n not in OWN and a.attributes.get(n) != b.attributes.get(n)]
    expect(not differ, "%s: other attributes: %s" % (what, differ))


def begun(farm, number, samples):
    wait_for(lambda: farm.job(number)["samples_done"] > PIXELS * samples, "samples")


@tests.add
def the_bits_are_those_of_the_new_rules():
    """new rules for a job that waits, renders, is paused, and whose coordinator is killed: as if submitted with them"""
    with Farm() as farm:
        farm.start_coordinator()
        waits = farm.submit(AREA, *SIZE, *STRICT)
        farm.cli("extend", waits, *LAX, expect=0)
        farm.start_worker()
        farm.wait_for_job(waits)
        lax = render(farm, *LAX)
        expect_equal(picture(farm, waits, "waits")[0], lax, "it waited")

        strict = render(farm, *STRICT)
        farm.start_worker()
        for how in ("runs", "is paused", "is killed", "loses a worker"):
            number = farm.submit(AREA, *SIZE, *NEVER)
            begun(farm, number, 4)
            if how == "is paused":
                farm.cli("pause", number, expect=0)
            farm.cli("extend", number, *STRICT, expect=0)
            if how == "is paused":
                expect(farm.job(number)["state"] == "paused", "it stays paused")
                farm.cli("resume", number, expect=0)
            if how == "is killed":
                farm.coordinator.kill()
                farm.restart_coordinator()
            if how == "loses a worker":
                farm.workers[0].kill()
            farm.wait_for_job(number)
            expect_equal(picture(farm, number, "n%d" % number)[0], strict, "it %s" % how)
        # From one number of samples to another, over a pass that the old cap cuts short, and to a target.
        number = farm.submit(AREA, *SIZE, "--spp", "29")
        farm.cli("extend", number, "--spp", "59", expect=0)
        farm.wait_for_job(number)
        expect_equal(picture(farm, number, "more")[0], render(farm, "--spp", "59"), "more samples")
        number = farm.submit(AREA, *SIZE, "--spp", "1000000")  # rests (resting.c)
        farm.cli("extend", number, *STRICT, expect=0)
        farm.wait_for_job(number)
        expect_equal(picture(farm, number, "target")[0], strict, "a target instead of a cap")
        # Without rounds the statistics of these levels were left out: they come from the results in the film's file.
        number = farm.submit(AREA, *SIZE, "--spp", "1000000")  # rests (resting.c)
        begun(farm, number, 9)
        farm.cli("extend", number, *STRICT, expect=0)
        farm.wait_for_job(number)
        expect_equal(picture(farm, number, "levels")[0], strict, "a target instead of a cap, later")


@tests.add
def a_laxer_target_ends_a_frame_that_meets_it():
    """the frame ends with the samples it has, and its schedule gives the same picture again; the log says who"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(AREA, *SIZE, *NEVER)
        begun(farm, number, 150)
        before = farm.job(number)["samples_done"]
        farm.cli("extend", number, *LAX, expect=0)
        farm.wait_for_job(number)
        info = farm.job(number)
        expect(before <= info["samples_done"] < before + PIXELS * 100, "%s, then %s" % (before, info["samples_done"]))
        expect([c["end"] for c in info["cut_frames"]] == ["target"], info["cut_frames"])
        first, path = picture(farm, number, "lax")
        expect("azulejo:schedule" in first.attributes, "more samples than the rules want: a schedule")
        again = render(farm, "--schedule-from", path)
        expect(again.bits() == first.bits(), "other pixels by its schedule")
        events = log(farm, number)
        changed = [e for e in events if "24/255" in e["text"]]
        expect(len(changed) == 1 and "@" in changed[0]["who"] and "0.1/255" in changed[0]["text"], events)


@tests.add
def closed_frames_go_on_if_they_fall_short():
    """an animation: a stricter target reopens frames that are done, a laxer one leaves them alone"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        for target, reopened in ((STRICT, True), (["--target-error", "40/255"], False)):
            number = farm.submit(AREA, *SIZE, "--frames", "1-5", *LAX)
            wait_for(lambda: farm.job(number)["frames_done"] >= 1, "a frame")
            farm.cli("pause", number, expect=0)
            wait_for(lambda: farm.job(number)["state"] == "paused", "the pause")
            old = picture(farm, number, "old%d" % number)[0]
            done = farm.job(number)["frames_done"]
            farm.cli("extend", number, *target, expect=0)
            expect((farm.job(number)["frames_done"] < done) == reopened, "reopened")
            farm.cli("resume", number, expect=0)
            farm.wait_for_job(number)
            new = picture(farm, number, "new%d" % number)[0]
            if reopened:
                for frame in (1, 5):
                    path = farm.submit(AREA, *SIZE, "--frames", frame, *target)
                    farm.wait_for_job(path)
                    expect_equal(picture(farm, number, "all%d-%d" % (number, frame), frame)[0],
                                 picture(farm, path, "one%d" % frame, frame)[0], "frame %d" % frame)
            else:
                expect(new.bits() == old.bits(), "a frame that is good enough keeps its picture")


@tests.add
def what_cannot_be_is_refused():
    """fewer samples than there are, single frames, a job that is being finished: refused in words; the same rules: nothing"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(AREA, *SIZE, "--frames", "1-3", "--spp", "100000")
        begun(farm, number, 20)
        refused = farm.cli("extend", number, "--spp", "4", expect=5)
        expect("give --spp" in refused.err and "'finish'" in refused.err, refused.err)
        refused = farm.cli("extend", number, "--spp", "200000", "--frames", "1", expect=5)
        expect("without --frames" in refused.err, refused.err)
        farm.cli("extend", number, "--spp", "100000", expect=0)
        texts = [e["text"] for e in log(farm, number)]
        expect(not [t for t in texts if "extended" in t], texts)
        farm.cli("cancel", number, expect=0)
        farm.wait_for_job(number, "cancelled")
        expect("'retry'" in farm.cli("extend", number, "--spp", "100", expect=5).err, "cancelled")


tests.run()
