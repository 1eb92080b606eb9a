"""The light that --max-depth takes: the same share in every place that tells of a job, on any farm and after any
crash. Closed forms: statistics/test_depth_light.c."""
import json
import os
import re
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests
from jobs import AREA, LongJob, expect, wait_mid_frame
from page import Page

tests = Tests()
SMALL = ("--size", "48x40", "--spp", "16")
LONG = LongJob(1)
LINE = r"depth +light ended by depth: ([\d.]+) % of the picture \(--max-depth (\d+); (\d+) would leave ([\d.]+) %\)\n"


def percent(share, digits):
    return "%.0f" % (100 * share) if share >= 0.095 else "%.*g" % (digits, 100 * share)


def manifest_of(path):
    with open(path) as source:
        return json.load(source)["picture"]["ended_by_depth"]


def fetched(farm, number):
    """Header of the frame's picture, and what its manifest tells."""
    folder = farm.path("of-%d" % number)
    files = farm.cli("fetch", number, "-o", folder, "--manifest", "--json", expect=0).json()["files"]
    exr, manifest = ([os.path.join(farm.folder, f) for f in files if f.endswith(end)][0]
                     for end in (".exr", "effects.json"))
    return read_exr(exr), manifest_of(manifest)


@tests.add
def every_teller():
    """show, watch, JSON, header and manifest tell the same share, also from the store"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(AREA, *SMALL, "--max-depth", "2", "--name", "short")
        job = farm.wait_for_job(number)
        told = job["ended_by_depth"]
        # A picture of deeper paths says what it lacks.
        deep = farm.submit(AREA, *SMALL, "--name", "deep")
        farm.wait_for_job(deep)
        header, manifest = fetched(farm, number)
        lacks = 1 - header.check() / fetched(farm, deep)[0].check()
        expect(0.5 * lacks < told["share"] < 2 * lacks and lacks > 0.03, (told, lacks))
        expect(told["deeper"] in (4, 8, 16) and told["deeper_share"] <= 0.01, told)
        line = "light ended by depth: %s %% of the picture (--max-depth 2; %d would leave %s %%)\n" % (
            percent(told["share"], 2), told["deeper"], percent(told["deeper_share"], 1))
        for command in ("show", "watch"):
            out = farm.cli(command, number, expect=0).out
            expect(re.search(LINE, out) and line in out, (line, out))
        expect(header.number("azulejo:endedByDepth") == told["share"], header.attributes)
        expect(manifest == dict(told, max_depth=2), manifest)
        farm.coordinator.stop()
        farm.restart_coordinator()
        expect(farm.job(number)["ended_by_depth"] == told, farm.job(number))


@tests.add
def api():
    """the API's JobInfo has it"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker()
        number = farm.submit(AREA, *SMALL, "--max-depth", "2")
        told = farm.wait_for_job(number)["ended_by_depth"]
        mine = page.get("/api/v1/jobs/%d" % number).json()["jobs"][0]["ended_by_depth"]
        expect(mine == told, (mine, told))


@tests.add
def below_the_threshold():
    """a share of less than half a per cent is in JSON, header and manifest, and not in the summary"""
    with Farm() as farm:
        picture = farm.path("deep.exr")
        out = farm.cli("render", AREA, *SMALL, "--max-depth", "12", "--manifest", "-o", picture, expect=0).out
        expect("ended by depth" not in out, out)
        share = read_exr(picture).number("azulejo:endedByDepth")
        expect(0 < share < 0.005, share)
        told = manifest_of(farm.path("deep.effects.json"))
        expect(told == {"share": share, "max_depth": 12, "deeper": None, "deeper_share": None}, told)
        out = farm.cli("render", AREA, *SMALL, "--max-depth", "1", "-o", farm.path("short.exr"), expect=0).out
        expect(re.search(LINE, out), out)


@tests.add
def any_farm():
    """one worker, three, and a coordinator killed twice in mid-frame: the same share, to its last bit"""
    outcomes = []
    for workers, kills in ((1, ()), (3, ()), (2, (0.15, 0.45))):
        with Farm() as farm:
            farm.start_coordinator()
            for _ in range(workers):
                farm.start_worker()
            if LONG.spp is None:
                LONG.measure(farm)
            number = LONG.submit(farm, "--max-depth", "3", "--allocation", "adaptive")
            for share in kills:
                middle = wait_mid_frame(farm, number, share)
                expect(middle["ended_by_depth"]["share"] > 0, middle)
                farm.coordinator.kill()
                farm.restart_coordinator()
                farm.wait_for_workers(workers)
            farm.wait_for_job(number)
            header, manifest = fetched(farm, number)
            outcomes.append((farm.job(number)["ended_by_depth"], manifest,
                             header.attributes["azulejo:endedByDepth"], header.bits()))
            expect(outcomes[-1] == outcomes[0], "%d workers, killed at %s:\n%s\n%s" % (
                workers, kills, outcomes[-1][:3], outcomes[0][:3]))
            expect(outcomes[0][0]["share"] > 0.005, outcomes[0][0])


@tests.add
def frames():
    """a job tells the share of all its frames together, between theirs"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(AREA, *SMALL, "--max-depth", "2", "--frames", "3-5")
        told = farm.wait_for_job(number)["ended_by_depth"]
        shares = [read_exr(f).number("azulejo:endedByDepth") for f in farm.fetch(number) if f.endswith(".exr")]
        expect(len(shares) == 3 and min(shares) <= told["share"] <= max(shares), (told, shares))


if __name__ == "__main__":
    tests.run()
