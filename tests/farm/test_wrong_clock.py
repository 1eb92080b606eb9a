"""A clock that is wrong for a moment removes nothing and ends nothing for good."""
import mmap
import os
import struct

from farm import Farm, Skip, Tests, wait_for, preloaded
from jobs import expect
from keeping import SMALL, exists, gc, pictures

tests = Tests()
ODD_CLOCK = preloaded("odd_clock.so")
DAY = 86400


class Clock:
    """The wall clock of a farm's coordinator, wrong by as many seconds as it is told (odd_clock.c)."""

    def __init__(self, farm, wrong_s=0):
        if not os.path.exists(ODD_CLOCK):
            raise Skip("odd_clock.so is not built")
        if os.environ.get("ODD_CLOCK"):
            raise Skip("all have an odd clock already")
        path = farm.path("clock")
        with open(path, "wb") as out:
            out.write(struct.pack("=q", wrong_s))
        with open(path, "r+b") as file:
            self.shared = mmap.mmap(file.fileno(), 8)
        self.env = {"LD_PRELOAD": ODD_CLOCK, "ODD_CLOCK": path}

    def set(self, wrong_s):
        self.shared[:] = struct.pack("=q", wrong_s)


def say(farm, words):
    wait_for(lambda: words in farm.coordinator.log_text(), "the log to say '%s'" % words)


def with_an_old_job(farm):
    """A job that is done, and its coordinator stopped."""
    farm.start_coordinator()
    worker = farm.start_worker()
    number = farm.submit(farm.scene(), *SMALL)
    farm.wait_for_job(number)
    worker.stop()
    farm.coordinator.stop()
    return number


@tests.add
def ahead_at_the_start():
    """60 days ahead at the start: --keep 30d announces what would go; the clock is set right, and the job stays"""
    with Farm() as farm:
        number = with_an_old_job(farm)
        clock = Clock(farm, 60 * DAY)
        farm.restart_coordinator("--keep", "30d", env=clock.env)
        say(farm, "1 job would go by age (--keep): the clock says")
        clock.set(0)
        say(farm, "the clock jumped back by 60 days")
        kept = farm.cli("gc", expect=0)
        expect(exists(farm, number) and pictures(farm, number), kept)
        farm.coordinator.stop()
        farm.restart_coordinator("--keep", "30d", "--age-wait", "0s")
        gc(farm)
        expect(exists(farm, number), "it is minutes old")


@tests.add
def ahead_in_between():
    """A jump of 60 days: the log says so, no round removes, and gc says what it keeps and why"""
    with Farm() as farm:
        number = with_an_old_job(farm)
        clock = Clock(farm)
        farm.restart_coordinator("--keep", "30d", env=clock.env)
        gc(farm)
        clock.set(60 * DAY)
        say(farm, "the clock jumped ahead by 60 days")
        result = farm.cli("gc", expect=0)
        expect("nothing is removed by age for 1h" in result.out + result.err, result)
        expect(exists(farm, number), "it was removed")


@tests.add
def behind():
    """A clock that shows a moment before the newest job removes nothing, whoever asks"""
    with Farm() as farm:
        number = with_an_old_job(farm)
        clock = Clock(farm, 60 * DAY)
        farm.restart_coordinator(env=clock.env)
        later = farm.submit(farm.scene(), *SMALL)
        farm.cli("cancel", later, expect=0)
        farm.wait_for_job(later, "cancelled")
        farm.coordinator.stop()
        clock.set(40 * DAY)
        farm.restart_coordinator("--keep", "30d", "--age-wait", "0s", env=clock.env)
        result = farm.cli("gc", expect=0)
        expect("but the store knows of" in result.out + result.err, result)
        expect(exists(farm, number) and exists(farm, later), "jobs were removed")


@tests.add
def in_time():
    """After --age-wait what is old goes by itself; gc after a start does not wait; blobs likewise"""
    with Farm() as farm:
        first = with_an_old_job(farm)
        clock = Clock(farm, 60 * DAY)
        farm.restart_coordinator("--keep", "30d", env=clock.env)
        say(farm, "1 job would go by age")
        gc(farm)
        wait_for(lambda: not exists(farm, first), "gc to remove the first job")
        farm.coordinator.stop()
        clock.set(0)
        second = with_an_old_job(farm)
        clock.set(60 * DAY)
        farm.restart_coordinator("--keep", "30d", "--age-wait", "3s", env=clock.env)
        wait_for(lambda: not exists(farm, second), "the second job to go by itself")
        expect("1 job would go by age" in farm.coordinator.log_text(), farm.coordinator.log_text())


if __name__ == "__main__":
    tests.run()
