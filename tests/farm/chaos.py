"""Everything at once: rounds of random disasters on a real farm, and what must come of them: every job done, every pixel the
undisturbed one's.

    python3 tests/farm/chaos.py [--rounds N] [--seconds S] [--seed N]     (make chaos)

In a round a job is rendered while a handful of these happen, at random moments: kills, orderly ends and stops of the
coordinator, of workers and of the page's program; verbs, also just before a kill; a disk that fails with one of several
errors, or is full; a proxy in front of the workers that delays, cuts and corrupts; a worker that lies, one that has little memory,
one that crashes; a client that asks without end and reads no answer; power cuts, where an ext4 can be mounted on a loop
device. Prints a line for each round, and at the end: rounds, lost jobs, other pictures, other pixels. The seed of a
round is printed: `--seed N --rounds 1` repeats its choices, though not the machine's timing."""
import argparse
import errno
import os
import random
import resource
import select
import signal
import socket
import subprocess
import subprocess
import sys
import threading
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import OddDisk, PowerDisk
from exr import read_exr
from farm import BUILD, Failure, Farm, Program, wait_for
from odd import OddPeer

JOB = ["--size", "128x96", "--spp", "48", "--frames", "1-2"]
LIAR = os.path.join(BUILD, "tests", "farm", "liar")
LITTLE_MEMORY = 400 << 20
ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EMFILE, errno.EDQUOT)


class Proxy:
    """TCP to the farm's coordinator; `fault` is None, or what is done to its connections."""

    def __init__(self, farm, dice):
        self.farm, self.dice, self.fault = farm, dice, None
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        self.ended = False
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while not self.ended:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.carry, args=(near,), daemon=True).start()

    def carry(self, near):
        try:
            host, port = self.farm.address.rsplit(":", 1)
            far = socket.create_connection((host, int(port)), timeout=5)
            far.settimeout(None)
        except OSError:
            near.close()
            return
        try:
            while not self.ended:
                for one in select.select([near, far], [], [], 0.5)[0]:
                    data = one.recv(65536)
                    if not data:
                        return
                    fault = self.fault
                    if fault == "delay":
                        time.sleep(self.dice.random() * 0.2)
                    elif fault == "cut" and self.dice.random() < 0.05:
                        data = data[:self.dice.randrange(len(data))]
                        (far if one is near else near).sendall(data)
                        return
                    elif fault == "corrupt" and self.dice.random() < 0.05:
                        at = self.dice.randrange(len(data))
                        data = data[:at] + bytes([data[at] ^ 1 << self.dice.randrange(8)]) + data[at + 1:]
                    elif fault == "fragments":
                        for at in range(0, min(len(data), 400), 7):
                            (far if one is near else near).sendall(data[at:at + 7])
                        data = data[400 + (7 - 400 % 7) % 7:]
                    (far if one is near else near).sendall(data)
        except OSError:
            pass
        finally:
            near.close()
            far.close()

    def end(self):
        self.ended = True
        self.listener.close()


class Round:
    def __init__(self, farm, seed, power=None):
        self.farm, self.dice, self.power = farm, random.Random(seed), power
        if power:
            farm.store = power.folder
        self.disk = OddDisk(farm)
        self.proxy = None
        self.done = []
        self.fails, self.cuts = False, 0

    def coordinator(self):
        if self.farm.coordinator is None:
            self.farm.start_coordinator(env=self.disk.env)
        else:
            self.farm.restart_coordinator(env=self.disk.env)

    def worker(self, through_proxy, **how):
        address = self.farm.address
        if through_proxy:
            self.farm.address = self.proxy.address
        try:
            worker = self.farm.start_worker("--name", "w%d" % len(self.farm.workers), **how)
        finally:
            self.farm.address = address
        return worker

    def alive(self):
        return [w for w in self.farm.workers if w.alive()]

    # ---- disasters: each leaves the farm so that it can go on

    def coordinator_killed(self):
        self.farm.coordinator.kill()
        self.disk_works()  # it must start
        self.coordinator()

    def power_cut(self):
        """Of the coordinator's machine. What was answered before is still so."""
        self.disk_works()
        self.cuts += 1
        noted = self.farm.cli("comment", self.number, "before cut %d" % self.cuts).code == 0
        time.sleep(self.dice.random() * 0.2)
        self.power.cut()
        self.farm.coordinator.kill()
        self.power.on()
        self.coordinator()
        if noted and "before cut %d" % self.cuts not in self.farm.cli("log", self.number, expect=0).out:
            raise Failure("a comment that was answered is lost after a power cut")

    def coordinator_ended(self):
        self.disk_works()
        self.farm.coordinator.stop(40)
        self.coordinator()

    def coordinator_stopped(self):
        self.farm.coordinator.signal(signal.SIGSTOP)
        time.sleep(self.dice.random() * 2)
        self.farm.coordinator.signal(signal.SIGCONT)

    def worker_killed(self):
        for worker in self.alive()[:1]:
            worker.kill()
        self.worker(self.dice.random() < 0.5)

    def worker_stopped(self):
        for worker in self.alive()[:1]:
            worker.signal(signal.SIGSTOP)
            time.sleep(self.dice.random() * 2)
            worker.signal(signal.SIGCONT)

    def page_killed(self):
        children = "/proc/%d/task/%d/children" % (self.farm.coordinator.pid, self.farm.coordinator.pid)
        for pid in open(children).read().split():
            with open("/proc/%s/cmdline" % pid) as line:
                if "azulejo-web" in line.read():
                    os.kill(int(pid), signal.SIGKILL)

    def disk_fails(self):
        self.disk.fail(self.dice.choice(ERRORS), self.dice.choice(("/store/", "/queue.sqlite", "/films/", "/outputs/")),
                       self.dice.choice(("write", "open", "sync")))
        self.fails = True
        time.sleep(self.dice.random())
        self.disk_works()

    def disk_works(self):
        if self.fails:
            self.disk.work()
        self.fails = False

    def network_fails(self):
        self.proxy.fault = self.dice.choice(("delay", "cut", "corrupt", "fragments"))
        time.sleep(self.dice.random() * 2)
        self.proxy.fault = None

    def liar(self):
        farm = self.farm
        name = "liar%d" % len(farm.programs)
        farm.programs.append(Program(name, [LIAR, "--coordinator", farm.address, "--key", farm.key, "--threads", "1", "--name",
                                            name, "--cache", farm.path("cache-" + name)], farm.path(name + ".log"),
                                     env=dict(os.environ, LIAR_SHARE="100")))
        # Two others have to agree about what it did.
        while len(self.alive()) < 3:
            self.worker(False)

    def poor_worker(self):
        worker = self.worker(False)
        resource.prlimit(worker.pid, resource.RLIMIT_AS, (LITTLE_MEMORY, LITTLE_MEMORY))

    def greedy_client(self):
        key = self.farm.path("greedy.key")
        if not os.path.exists(key):
            self.farm.cli("key", "new", "greedy", "--role", "view", "--key", self.farm.key, "-o", key, expect=0, connect=False)
        try:
            peers = [OddPeer(self.farm, role="client", key=key) for _ in range(3)]
            for peer in peers:
                peer.say("deaf")
                peer.say("times 20000 query 0")
        except (Failure, OSError):
            pass  # there is no coordinator at the moment

    def verb(self):
        verbs = self.dice.choice((("pause", "resume"), ("cancel", "retry"), ("finish", "retry"), ("comment",), ("priority",)))
        killed = self.dice.random() < 0.3
        for verb in verbs:
            more = {"comment": ("note",), "priority": ("--to", str(self.dice.randrange(9)))}.get(verb, ())
            client = self.farm.start_cli(verb, self.number, *more, "--timeout", "5")
            if killed:
                time.sleep(self.dice.random() * 0.05)
                self.coordinator_killed()
                killed = False
            client.communicate(timeout=60)

    def kinds(self):
        always = (self.coordinator_killed, self.coordinator_ended, self.coordinator_stopped, self.worker_killed, self.worker_killed,
                  self.worker_stopped, self.page_killed, self.disk_fails, self.disk_fails, self.network_fails, self.network_fails,
                  self.verb, self.verb, self.verb, self.poor_worker, self.liar,
                  self.greedy_client)
        return always + (self.power_cut, self.power_cut) * (self.power is not None)

    def run(self, events, kinds=None):
        farm = self.farm
        self.coordinator()
        self.proxy = Proxy(farm, self.dice)
        self.worker(True)
        self.worker(False)
        self.number = farm.submit(farm.scene(), *JOB)
        for _ in range(events):
            time.sleep(self.dice.random() * 0.4)
            kind = self.dice.choice(kinds or self.kinds())
            self.done.append(kind.__name__)
            kind()
        self.disk_works()
        self.proxy.fault = None
        if not any(w.alive() for w in farm.workers[:2]):
            self.worker(False)
        self.finish()

    def look(self):
        """The job is done with all of its samples. A person puts back what a person stopped."""
        job = self.farm.job(self.number)
        if job["state"] in ("paused", "parked"):
            self.farm.cli("resume", self.number)
        elif job["state"] in ("cancelled", "failed") or (job["state"] == "done" and job["finished_early"]):
            if job["state"] == "failed":
                raise Failure("it failed: %s" % job["state_text"])
            self.farm.cli("retry", self.number)
        return job["state"] == "done" and not job["finished_early"] and job["frames_done"] == 2

    def finish(self):
        wait_for(self.look, "the job to be done", 120)

    def pictures(self, name):
        return [read_exr(f).bits() for f in sorted(self.farm.fetch(self.number, name)) if f.endswith(".exr")]

    def end(self):
        if self.proxy:
            self.proxy.end()


def reference():
    with Farm() as farm:
        undisturbed = Round(farm, 0)
        undisturbed.run(0)
        undisturbed.end()
        return undisturbed.pictures("reference")


def other_pixels(mine, other):
    """Bytes of a pixel lie apart: an estimate from below, of the bytes that differ."""
    return sum(sum(a != b for a, b in zip(x, y)) + abs(len(x) - len(y)) for x, y in zip(mine, other))


def one_round(seed, events, right, only=None):
    """0 or 1 lost jobs, 0 or 1 other pictures, bytes that differ, and the disasters; `only`: of this one."""
    with PowerDisk() as power, Farm() as farm:
        r = Round(farm, seed, power)
        if not power:
            print("# no power cuts: they need " + PowerDisk.NEEDS)
        try:
            r.run(events, [getattr(r, only)] if only else None)
            mine = r.pictures("mine")
            if mine != right and "liar" in r.done:  # found out after the end: what it did is rendered again
                wait_for(lambda: r.look() and r.pictures("later") == right, "the liar's work to be replaced", 60)
                mine = right
            return 0, int(mine != right), 0 if mine == right else max(1, other_pixels(mine, right)), r.done
        except (Failure, OSError, ValueError, subprocess.SubprocessError) as failure:
            print("# seed %d: %s: %s" % (seed, ", ".join(r.done), failure))
            if farm.coordinator:  # the last one that was started
                print("# coordinator: %s" % farm.coordinator.process.poll())
                print("# " + "\n# ".join(farm.coordinator.log_text().splitlines()[-8:]))
            job = farm.cli("list", "--json") if farm.coordinator and farm.coordinator.alive() else None
            print("# " + (job.out[:600] if job else "no coordinator"))
            return 1, 0, 0, r.done
        finally:
            r.end()


def run(rounds, seconds, seed, events=5):
    """Rounds, lost jobs, other pictures, other bytes."""
    right = reference()
    end = time.monotonic() + seconds if seconds else None
    sums = [0, 0, 0, 0]
    while sums[0] < rounds and not (end and time.monotonic() > end):
        began = time.monotonic()
        lost, other, pixels, done = one_round(seed + sums[0], events, right)
        print("# round %d, seed %d, %.1f s: %s%s" % (sums[0] + 1, seed + sums[0], time.monotonic() - began, ", ".join(done),
                                                     "  LOST" if lost else "  OTHER PIXELS" if other else ""), flush=True)
        sums = [sums[0] + 1, sums[1] + lost, sums[2] + other, sums[3] + pixels]
    return sums


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--rounds", type=int, default=500)
    options.add_argument("--seconds", type=float, default=0, help="begin no round after this long")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--events", type=int, default=5, help="disasters in a round")
    given = options.parse_args()
    sums = run(given.rounds, given.seconds, given.seed, given.events)
    print("%d rounds, %d lost jobs, %d other pictures, %d other bytes" % tuple(sums))
    sys.exit(1 if sums[1] or sums[2] else 0)


if __name__ == "__main__":
    main()
