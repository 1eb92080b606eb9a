"""Frames are named in one language: submit, fetch and extend take the same lists."""
import os
import re

from farm import Farm, Tests
from jobs import expect

tests = Tests()
SMALL = ("--size", "32x32", "--spp", "4")


def frames_of(files):
    return sorted(set(int(re.search(r"(\d+)\.exr$", f).group(1)) for f in files
                      if f.endswith(".exr")))


@tests.add
def lists():
    """A job of a list of frames renders these, fetch brings these, extend renders the others"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--frames", "7,1-5x2")
        job = farm.wait_for_job(number)
        expect((job["first_frame"], job["last_frame"], job["frames_done"], job["frames_resting"]) ==
               (1, 7, 4, 3), job)
        expect(frames_of(farm.fetch(number)) == [1, 3, 5, 7], "all of the list")
        two = farm.cli("fetch", number, "-o", "two", "--frames", "3-5x2", "--json", expect=0).json()
        expect(frames_of(two["files"]) == [3, 5], two)
        ends = farm.cli("fetch", number, "-o", "ends", "--first-middle-last", "--json").json()
        expect(frames_of(ends["files"]) == [1, 7], ends)  # 4 is not rendered
        result = farm.cli("fetch", number, "-o", "none", "--frames", "2")
        expect(result.code == 5 and "no picture" in result.err, result)
        result = farm.cli("extend", number, "--spp", "8", "--frames", "3")
        expect(result.code == 5 and "without --frames" in result.err, result)
        result = farm.cli("extend", number, "--spp", "8", "--frames", "8")
        expect(result.code == 2 and "1 to 7" in result.err, result)
        farm.cli("extend", number, "--spp", "4", "--watch", expect=0)
        expect(frames_of(farm.fetch(number, "whole")) == list(range(1, 8)), "the others too")


@tests.add
def ends():
    """--first-middle-last of a range; a command that needs a range says so"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-9", "--first-middle-last")
        farm.wait_for_job(number)
        expect(frames_of(farm.fetch(number)) == [1, 5, 9], "first, middle, last")
        result = farm.cli("submit", farm.scene(), "--first-middle-last")
        expect(result.code == 2 and "--frames" in result.err, result)
        result = farm.cli("estimate", farm.scene(), "--frames", "1,3")
        expect(result.code == 2 and "one range" in result.err, result)
        farm.cli("render", farm.scene(), *SMALL, "--frames", "2,4", "-o", "local/", expect=0,
                 connect=False)
        expect(frames_of(os.listdir(farm.path("local"))) == [2, 4], os.listdir(farm.path("local")))


tests.run()
