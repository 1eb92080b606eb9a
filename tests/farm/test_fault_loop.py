"""The Nth call of each kind fails, once, in the worker or in the coordinator, while a job is submitted, fetched by the
worker, built, rendered, merged, developed and fetched: no job fails, all give the same bits. `make test` tries a seeded
choice, `make fault-loop` (FAULT_LOOP=all) N = 1, 2, 3, ... until no call is left (larger ones further apart)."""
import mmap
import os
import random
import shutil
import struct
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Failure, Farm, Skip, Tests, preloaded
from jobs import SLOW, SPHERES, expect

tests = Tests()
ODD_CALLS = preloaded("odd_calls.so")
KINDS = ["own", "alloc", "mmap", "thread", "open", "write", "sync", "name", "sql"]  # as in odd_calls.c, from 1
SEED, CHOSEN = 28, 10
FOUND = {"coordinator": [("alloc", 23), ("alloc", 24)], "worker": []}  # by the whole loop: no memory for OpenSSL's data
DENSE, FURTHER = 30, 1.3  # every N up to this; from then on the next is so much larger
SEEDS = 5  # more than the scenes that a worker keeps ready: each job's is built


class Calls:
    """One program's calls: what fails next, and how many there were."""

    def __init__(self, farm, name):
        path = farm.path(name + ".calls")
        with open(path, "wb") as out:
            out.write(bytes(4096))
        self.env = {"LD_PRELOAD": ODD_CALLS, "ODD_CALLS": path}
        with open(path, "r+b") as both:
            self.map = mmap.mmap(both.fileno(), 4096)

    def arm(self, kind, number):
        self.map[:32] = struct.pack("<4q", 0, number, 0, 0)
        self.map[:8] = struct.pack("<q", KINDS.index(kind) + 1)

    def disarm(self):
        """How many calls there were since it was armed, and whether one failed."""
        self.map[:8] = bytes(8)
        return struct.unpack("<4q", self.map[:32])[2:]


class Loop:
    """A farm of one worker whose calls fail; every job begins with nothing in store or cache."""

    def __init__(self, farm):
        if not os.path.exists(ODD_CALLS):
            raise Skip("odd_calls.so is not built")
        if SLOW:
            raise Skip("a sanitizer has its own malloc")
        self.farm = farm
        self.calls = {name: Calls(farm, name) for name in ("coordinator", "worker")}
        self.deaths = {"coordinator": 0, "worker": 0}
        farm.start_coordinator("--no-web", env=self.calls["coordinator"].env)
        self.worker = farm.start_worker(env=self.calls["worker"].env)
        farm.wait_for_workers(1)
        self.rounds = 0
        self.bits = [self.render(None, None, 0)[2] for _ in range(SEEDS)]

    def revive(self):
        """What ended is started again, as a service manager would."""
        if not self.farm.coordinator.alive():
            self.deaths["coordinator"] += 1
            print("# the coordinator ended with %d in round %s" % (self.farm.coordinator.process.returncode, self.last))
            self.farm.restart_coordinator("--no-web", env=self.calls["coordinator"].env)
        if not self.worker.alive():
            self.deaths["worker"] += 1
            self.worker = self.farm.start_worker(env=self.calls["worker"].env)

    def forget(self):
        """No cache and no blob is left of the job before, which has ended."""
        for folder in (self.farm.path("cache-%d" % len(self.farm.workers)), os.path.join(self.farm.store, "blobs")):
            for name in os.listdir(folder) if os.path.exists(folder) else ():
                if len(name) == 2:
                    shutil.rmtree(os.path.join(folder, name), ignore_errors=True)

    def insist(self, *args):
        """The command's result; it is given again while a fault or a restart refuses it."""
        for _ in range(20):
            result = self.farm.cli(*args)
            if result.code == 0:
                return result
            self.revive()
            time.sleep(0.1)
        raise Failure(str(result))

    def render(self, who, kind, number):
        self.forget()
        self.rounds += 1
        calls = self.calls.get(who)
        self.last = (who, kind, number)
        if calls:
            calls.arm(kind, number)
        # A submission that was accepted without an answer is submitted again: another job, as good as the first.
        job = self.insist("submit", SPHERES, "--json", "--size", "48x32", "--spp", "4",
                          "--seed", self.rounds % SEEDS).json()["job"]
        end = time.monotonic() + 60
        while True:
            self.revive()
            shown = self.insist("show", job, "--json").json()
            expect(shown["state"] not in ("failed", "cancelled", "parked"),
                   "%s, %s call %d: job %s: %s" % (who, kind, number, shown["state"], shown["state_text"]))
            if shown["state"] == "done" and shown["frames_developed"] == 1:
                break
            expect(time.monotonic() < end, "%s, %s call %d: job waits: %s" % (who, kind, number, shown["state_text"]))
        folder = self.farm.path("fetched")
        shutil.rmtree(folder, ignore_errors=True)
        files = self.insist("fetch", job, "-o", folder, "--json").json()["files"]
        count, failed = calls.disarm() if calls else (0, 0)
        self.insist("remove", job, "--yes")
        bits = read_exr(os.path.join(self.farm.folder, next(f for f in files if f.endswith(".exr")))).bits()
        return count, failed, bits

    def fail(self, who, kind, number):
        """1: there was such a call."""
        count, failed, bits = self.render(who, kind, number)
        expect(bits == self.bits[(self.rounds - 1) % SEEDS], "%s, %s call %d of %d: other bits" % (who, kind, number, count))
        return failed


def numbers():
    number = 1
    while True:
        yield number
        number = number + 1 if number < DENSE else int(number * FURTHER)


def tried(who):
    with Farm() as farm:
        loop = Loop(farm)
        everything = os.environ.get("FAULT_LOOP") == "all"
        chance = random.Random(SEED)
        for kind in os.environ.get("FAULT_KINDS", " ".join(KINDS)).split() if everything else ():
            rounds = 0
            for number in numbers():
                rounds += 1
                if not loop.fail(who, kind, number):
                    break
            print("# %s, %s: %d rounds, the last with no call %d; ended %d times so far" % (
                who, kind, rounds, number, loop.deaths[who]), flush=True)
        for kind, number in () if everything else FOUND[who]:
            loop.fail(who, kind, number)
        for _ in range(0 if everything else CHOSEN):
            kind = chance.choice(KINDS)
            loop.fail(who, kind, int(2 ** chance.uniform(0, 5)))
        expect(loop.deaths["coordinator"] == 0, "the coordinator ended %d times" % loop.deaths["coordinator"])


@tests.add
def worker_calls():
    """whichever call of a worker fails, the job is done with the same bits"""
    tried("worker")


@tests.add
def coordinator_calls():
    """whichever call of the coordinator fails, it goes on and the job is done with the same bits"""
    tried("coordinator")


if __name__ == "__main__":
    tests.run()
