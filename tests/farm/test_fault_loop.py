"""The Nth call of each kind fails, once, in the worker or in the coordinator, while a job is submitted, fetched by the
worker, built, rendered, merged, developed and fetched; while it is extended; while it is developed again; while the
coordinator is started again: no job fails, all give the same bits. `make test` tries a seeded choice, `make fault-loop`
(FAULT_LOOP=all) N = 1, 2, 3, ... until no call is left (larger ones further apart); FAULT_KINDS and FAULT_WHILE choose."""
import mmap
import os
import random
import shutil
import signal
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
# By the whole loop: no memory for OpenSSL's data; no thread for libuv. What it found in the store, test_store has.
FOUND = {"coordinator": [("alloc", 23, "submit"), ("alloc", 24, "submit"), ("thread", 1, "restart")], "worker": []}
DENSE, FURTHER = 30, 1.3  # every N up to this; from then on the next is so much larger
WHILE = ["submit", "extend", "develop", "restart"]
TASK_THREADS = 8  # of coordinator/net/base/task.h
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
        self.bits = {}  # by whether it is extended, and seed

    def revive(self):
        """What ended is started again, as a service manager would."""
        if not self.farm.coordinator.alive():
            self.deaths["coordinator"] += 1
            print("# the coordinator ended with %d in round %s" % (self.farm.coordinator.process.returncode, self.last))
            self.start()
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

    def start(self):
        """A start that fails says why, and the next one, without a fault, does not fail."""
        try:
            self.farm.restart_coordinator("--no-web", env=self.calls["coordinator"].env)
        except Failure:
            code, said = self.farm.coordinator.process.returncode, self.farm.coordinator.log_text()
            # libuv ends the process where a thread cannot be started, although as many were there a moment before.
            is_libuv = self.last[1] == "thread" and self.last[2] > TASK_THREADS and code == -signal.SIGABRT
            expect(is_libuv or (code not in (None, 0) and code > 0 and said), "%s: the start ended with %s: %s" % (self.last, code, said))
            self.farm.restart_coordinator("--no-web", env=self.calls["coordinator"].env)

    def restart(self):
        self.farm.coordinator.signal(signal.SIGTERM)
        self.farm.coordinator.wait(60)
        self.start()

    def wait_done(self, job):
        """The job is done, and its pictures are made."""
        end = time.monotonic() + 60
        while True:
            self.revive()
            shown = self.insist("show", job, "--json").json()
            expect(shown["state"] not in ("failed", "cancelled", "parked"),
                   "%s: job %s: %s" % (self.last, shown["state"], shown["state_text"]))
            if shown["state"] == "done" and shown["frames_developed"] == 1:
                return
            expect(time.monotonic() < end, "%s: job waits: %s" % (self.last, shown["state_text"]))

    def submit(self, seed):
        """A submission that was accepted without an answer is submitted again: another job, as good as the first."""
        return self.insist("submit", SPHERES, "--json", "--size", "48x32", "--spp", "4", "--seed", seed).json()["job"]

    def extend(self, job):
        """An extension that was accepted without an answer would be refused when it is asked for again."""
        for _ in range(20):
            if self.farm.cli("extend", job, "--spp", "8").code == 0 or self.insist("show", job, "--json").json()["settings"]["spp"] == 8:
                return
            self.revive()
            time.sleep(0.1)
        raise Failure("%s: the job cannot be extended" % (self.last, ))

    def take(self, job):
        """Fetch the job's picture, and remove the job."""
        self.wait_done(job)
        folder = self.farm.path("fetched")
        shutil.rmtree(folder, ignore_errors=True)
        files = self.insist("fetch", job, "-o", folder, "--json").json()["files"]
        bits = read_exr(os.path.join(self.farm.folder, next(f for f in files if f.endswith(".exr")))).bits()
        return bits, lambda: self.insist("remove", job, "--yes")

    def render(self, who, kind, number, doing):
        """How many calls there were, whether one failed, and the pictures: of the job, and of another that follows a restart."""
        self.forget()
        self.rounds += 1
        seed = self.rounds % SEEDS
        calls = self.calls.get(who)
        self.last = (who, kind, number, doing)
        if calls and doing == "submit":
            calls.arm(kind, number)
        job = self.submit(seed)
        self.wait_done(job)
        if calls and doing != "submit":
            calls.arm(kind, number)
        taken = []
        if doing == "extend":
            self.extend(job)
        elif doing == "develop":
            self.insist("develop", job, "--tonemap", "gamma")
        elif doing == "restart":
            self.restart()
            taken.append(self.take(self.submit((seed + 1) % SEEDS)))
        taken.insert(0, self.take(job))
        count, failed = calls.disarm() if calls else (0, 0)
        for _, remove in taken:
            remove()
        return count, failed, [bits for bits, _ in taken]

    def right(self, doing, seed):
        """What no fault has touched."""
        key = doing == "extend", seed
        while key not in self.bits:
            bits = self.render(None, None, 0, "extend" if key[0] else "submit")[2][0]
            self.bits[key[0], self.rounds % SEEDS] = bits
        return self.bits[key]

    def fail(self, who, kind, number, doing):
        """1: there was such a call."""
        count, failed, bits = self.render(who, kind, number, doing)
        seed, last = self.rounds % SEEDS, self.last
        right = [self.right(doing, seed)] + ([self.right(doing, (seed + 1) % SEEDS)] if doing == "restart" else [])
        expect(bits == right, "%s, of %d calls: other bits" % (last, count))
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
        asked = lambda name, all: os.environ.get(name, " ".join(all)).split() if everything else ()
        for doing in asked("FAULT_WHILE", WHILE):
            for kind in asked("FAULT_KINDS", KINDS):
                rounds = 0
                for number in numbers():
                    rounds += 1
                    if not loop.fail(who, kind, number, doing):
                        break
                print("# %s, %s, %s: %d rounds, the last with no call %d; ended %d times so far" % (
                    doing, who, kind, rounds, number, loop.deaths[who]), flush=True)
        for kind, number, doing in () if everything else FOUND[who]:
            loop.fail(who, kind, number, doing)
        for _ in range(0 if everything else CHOSEN):
            kind, doing = chance.choice(KINDS), chance.choice(WHILE)
            loop.fail(who, kind, int(2 ** chance.uniform(0, 5)), doing)
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
