"""Samples that go wrong are counted by kind, each with its first example: the same for any farm and after
any crash, in every place that tells of a job. The workers here go wrong on purpose (worker/render/base/fault.h)."""
import os
import re
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import farm as programs
from exr import read_exr
from farm import BUILD, Farm, Tests
from jobs import LongJob, expect, wait_mid_frame

tests = Tests()
FAULTY = os.path.join(BUILD, "faults", "bin")
SOUND = programs.BIN
NAN_RADIANCE, NAN_BASIS = 1, 8  # rows of FAULT_MAP
SMALL = ("--size", "40x24", "--spp", "6")
LONG = LongJob(1)


def strikes(x, y, sample):
    """As fault_begin()."""
    return (x + 3 * y + 5 * sample) % 37 == 4


def struck(width, height, spp):
    """How many samples are struck."""
    return sum(strikes(x, y, i) for x in range(width) for y in range(height) for i in range(spp))


def env(fault):
    return {"AZULEJO_FAULT": str(fault)}


class Faulty:
    """A farm whose workers are the faulty ones."""

    def __init__(self):
        self.farm = Farm()

    def __enter__(self):
        programs.BIN = FAULTY
        return self.farm.__enter__()

    def __exit__(self, *how):
        try:
            return self.farm.__exit__(*how)
        finally:
            programs.BIN = SOUND


LINE = (r"health +(\d+) samples were not finite and count as black; first: "
        r"pass (\d+), tile (\d+), pixel (\d+),(\d+), sample (\d+)\n")


@tests.add
def every_teller():
    """render, show, watch, JSON and the header tell the same counter, its first example and what to do"""
    with Faulty() as farm:
        scene, picture = farm.scene(), farm.path("ill.exr")
        shown = farm.cli("render", scene, *SMALL, "-o", picture, env=env(NAN_RADIANCE), expect=0).out
        told = re.search(LINE, shown)
        expect(told, shown)
        count, at_pass, tile, x, y, sample = map(int, told.groups())
        expect(count == struck(40, 24, 6), "%d of %d" % (count, struck(40, 24, 6)))
        expect(strikes(x, y, sample) and tile == y // 16 * 3 + x // 16 == 0 and at_pass == 0, told[0])
        # Tile 0 in its rows' order, then sample by sample; a group's first pass has two samples.
        first = min(((v, u, i) for v in range(16) for u in range(16) for i in range(4) if strikes(u, v, i)))
        expect((y, x, sample) == first, (told[0], first))
        header = read_exr(picture)
        expect(header.number("azulejo:droppedSamples") == count, "header")
        expect(header.attributes["azulejo:droppedSamplesFirst"].decode() ==
               "pass %d, tile %d, pixel %d,%d, sample %d" % (at_pass, tile, x, y, sample), "header")
        expect(header.number("azulejo:badBases") == 0 and "azulejo:badBasesFirst" not in header.attributes,
               header.attributes)
        header.check()  # dropped, not passed on
        farm.start_coordinator()
        farm.start_worker(env=env(NAN_RADIANCE))
        number = farm.submit(scene, *SMALL)
        farm.wait_for_job(number)
        for command in ("show", "watch"):
            out = farm.cli(command, number, expect=0).out
            expect(told[0] in out and "look for extreme lights" in out, out)
        job = farm.job(number)
        mine, = job["work"]["health"]
        expect((mine["kind"], mine["count"], mine["frame"]) == ("dropped_samples", count, job["first_frame"]), mine)
        key = mine["first"] - 1  # of one tile's width
        expect((key >> 50, key >> 29 & (1 << 21) - 1, key & (1 << 21) - 1) == (at_pass, tile, sample), mine)
        expect("samples were not finite" in farm.workers[0].log_text(), "the worker's log")
        # After a restart it is told from the store.
        farm.coordinator.stop()
        farm.restart_coordinator()
        expect(farm.job(number)["work"]["health"] == job["work"]["health"], farm.job(number))


@tests.add
def frames():
    """of several frames, the first example names the first frame, whichever was done first"""
    with Faulty() as farm:
        out = farm.cli("render", farm.scene(), *SMALL, "--frames", "3-5", "-o", farm.path("f.exr"),
                       env=env(NAN_BASIS), expect=0).out
        told = re.search(r"health +(\d+) shading bases had axes that were not of length 1, and their paths ended; first: frame 3, "
                         r"pass 0, tile \d+, pixel (\d+),(\d+), sample (\d+)\n", out)
        expect(told and strikes(*map(int, told.groups()[1:])), out)
        counts = [read_exr(farm.path("f-%04d.exr" % i)).number("azulejo:badBases") for i in (3, 4, 5)]
        expect(sum(counts) == int(told[1]) > 0 and min(counts) > 0, (counts, told[0]))


@tests.add
def any_farm():
    """one worker, three, and a coordinator killed twice in mid-frame: the same counters and examples"""
    outcomes = []
    for workers, kills in ((1, ()), (3, ()), (2, (0.15, 0.45))):
        with Faulty() as farm:
            farm.start_coordinator()
            for _ in range(workers):
                farm.start_worker(env=env(NAN_BASIS))
            if LONG.spp is None:
                LONG.measure(farm)
            number = LONG.submit(farm)
            for share in kills:
                middle = wait_mid_frame(farm, number, share)
                expect(middle["work"]["health"][0]["kind"] == "bad_bases" and middle["work"]["health"][0]["frame"] == 1, middle)
                farm.coordinator.kill()
                farm.restart_coordinator()
                farm.wait_for_workers(workers)
            farm.wait_for_job(number)
            job = farm.job(number)
            expect(job["work"]["health"] and job["conflicts"] == 0, job)
            header = read_exr([f for f in farm.fetch(number) if f.endswith(".exr")][0])
            outcomes.append((job["work"]["health"], header.bits(),
                             {name: value for name, value in header.attributes.items()
                              if name != "azulejo:measured"}))
            expect(outcomes[-1] == outcomes[0], "%d workers, killed at %s:\n%s\n%s" % (
                workers, kills, outcomes[-1][0], outcomes[0][0]))


@tests.add
def sound_programs():
    """the programs that are installed know nothing of faults, and a sound picture says nothing of health"""
    for name in ("azulejo", "azulejo-coordinator", "azulejo-worker"):
        with open(os.path.join(SOUND, name), "rb") as program:
            expect(b"AZULEJO_FAULT" not in program.read(), name)
    with open(os.path.join(FAULTY, "azulejo-worker"), "rb") as program:
        expect(b"AZULEJO_FAULT" in program.read(), "the faulty worker is none")
    with Farm() as farm:
        picture = farm.path("well.exr")
        out = farm.cli("render", farm.scene(), *SMALL, "-o", picture, env=env(NAN_RADIANCE), expect=0).out
        expect("health" not in out and "not finite" not in out, out)
        header = read_exr(picture)
        expect(header.number("azulejo:droppedSamples") == header.number("azulejo:clampedValues") == 0, "header")


if __name__ == "__main__":
    tests.run()
