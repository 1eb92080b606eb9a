"""While the store's disk hangs, nobody waits for it but those whose change is to be on it: the loop goes on, lists and
logs are answered, workers are heard; and nothing is answered as done before it is on disk."""
import errno
import os
import re
import sys
import threading
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import StalledDisk
from farm import PATIENCE, Farm, Tests, wait_for
from jobs import expect
from page import Page

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]
LONG = ["--size", "256x256", "--spp", "200000"]
HANG_S = 5.0
NOT_STORED = 11  # exit status: it is done, but not on disk yet
SOON_S = 2.0  # far below HANG_S, and far above what an answer takes


class Hanging:
    """`with Hanging(disk):` the disk hangs; it goes on at the end, or HANG_S after a loop that waits for it stopped."""

    def __init__(self, disk, text="/store/"):
        self.disk, self.text = disk, text

    def __enter__(self):
        self.timer = threading.Timer(HANG_S * PATIENCE, self.disk.go_on)
        self.disk.hang(self.text)
        self.timer.start()
        return self

    def __exit__(self, *_):
        self.timer.cancel()
        self.disk.go_on()


def soon(what, function):
    begun = time.monotonic()
    result = function()
    took = time.monotonic() - begun
    expect(took < SOON_S * PATIENCE, "%s took %.1f s" % (what, took))
    return result


def verb_waits(farm, disk, page, words, check):
    """The verb is answered when the disk goes on, not before; `check` and the page are answered meanwhile."""
    with Hanging(disk):
        verb = farm.start_cli(*words)
        wait_for(check, "%s to be in effect" % (words, ), HANG_S / 2)
        soon("healthz", lambda: page.get("/healthz", token=""))
        soon("list", lambda: farm.cli("list", expect=0))
        expect(verb.poll() is None, "%s was answered before it was on disk" % (words, ))
    out, err = verb.communicate(timeout=60 * PATIENCE)
    expect(verb.returncode == 0, (words, out, err))


@tests.add
def verbs_wait_alone():
    """a verb is answered when it is on disk; while that hangs, everybody else is served"""
    with Farm() as farm:
        disk = StalledDisk(farm)
        page = Page(farm.start_coordinator(env=disk.env))
        farm.start_worker()
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), *LONG)
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")

        def is_in(state):
            return lambda: farm.job(number)["state"] == state
        verb_waits(farm, disk, page, ["pause", number], is_in("paused"))
        verb_waits(farm, disk, page, ["priority", number, "--to", 3], lambda: farm.job(number)["priority"] == 3)
        with Hanging(disk):  # an event that is not on disk yet is in the log; the same verb again waits as well
            verbs = [farm.start_cli("resume", number)]
            wait_for(lambda: farm.job(number)["state"] in ("queued", "running"), "the job to go on", HANG_S / 2)
            for words in (["log", number], ["log", "--all"]):
                text = soon("log", lambda words=words: farm.cli(*words, expect=0)).out
                expect(text.count(": resumed\n") == 1 and text.count(": paused\n") == 1, text)
            verbs.append(farm.start_cli("priority", number, "--to", 3))
            soon("history", lambda: page.get("/api/v1/jobs/%d/frames/1/history" % number))
            soon("metrics", lambda: page.get("/metrics"))
            soon("show", lambda: farm.cli("show", number, expect=0))
            time.sleep(0.3)
            expect([v.poll() for v in verbs] == [None, None], "a verb was answered before it was on disk")
        for verb in verbs:
            verb.communicate(timeout=60 * PATIENCE)
            expect(verb.returncode == 0, verb.returncode)
        text = farm.cli("log", number, expect=0).out
        expect(text.count(": resumed\n") == 1 and text.count(": paused\n") == 1, text)
        verb_waits(farm, disk, page, ["cancel", number], is_in("cancelling"))
        expect("held up" not in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def a_kill_in_the_hang():
    """killed while the disk hangs, the coordinator has what it answered, and forgets what it had not"""
    with Farm() as farm:
        disk = StalledDisk(farm)
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        numbers = [farm.submit(farm.scene(), *LONG) for _ in range(2)]
        farm.cli("priority", numbers[0], "--to", 7, expect=0)
        farm.cli("pause", numbers[0], expect=0)
        with Hanging(disk):
            verb = farm.start_cli("pause", numbers[1])
            wait_for(lambda: farm.job(numbers[1])["state"] == "paused", "the pause", HANG_S / 2)
            expect(verb.poll() is None, "the pause was answered before it was on disk")
            farm.coordinator.kill()
        verb.communicate(timeout=60 * PATIENCE)
        expect(verb.returncode != 0, "a pause that is not on disk was answered as done")
        farm.restart_coordinator(env=disk.env)
        first, second = (farm.job(n) for n in numbers)
        expect(first["state"] == "paused" and first["priority"] == 7, first)
        expect(second["state"] != "paused", second)


@tests.add
def workers_are_heard():
    """workers join, deliver and leave while the disk hangs; those that left are listed when it goes on"""
    with Farm() as farm:
        disk = StalledDisk(farm)
        page = Page(farm.start_coordinator(env=disk.env))
        farm.start_worker("--name", "first")
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), *LONG)
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
        with Hanging(disk):
            second = farm.start_worker("--name", "second")
            wait_for(lambda: len(soon("workers", farm.list_workers)) == 2, "the second worker", HANG_S / 2)
            second.signal(9)
            wait_for(lambda: len(soon("workers", farm.list_workers)) == 1, "the second worker to go", HANG_S / 2)
            gone = farm.start_cli("workers", "--gone")
            for _ in range(20):
                soon("healthz", lambda: page.get("/healthz", token=""))
                time.sleep(0.03)
        out = gone.communicate(timeout=60 * PATIENCE)[0].decode()
        expect(gone.returncode == 0 and "second" in out, out)
        expect("held up" not in farm.coordinator.log_text(), farm.coordinator.log_text())
        before = farm.job(number)["samples_done"]
        wait_for(lambda: farm.job(number)["samples_done"] > before, "more samples")


@tests.add
def results_wait_for_their_data():
    """while only fdatasync of films hangs, or fails, no result is acknowledged: its worker sends it again after a kill"""
    units, samples = 32, 64 * 64 * 4  # 16 tiles, two groups
    with Farm() as farm:
        disk = StalledDisk(farm)
        farm.start_coordinator(env=disk.env)
        worker = farm.start_worker()
        farm.wait_for_workers(1)
        disk.hang("data /films/")
        number = farm.submit(farm.scene(), *SMALL)
        wait_for(lambda: farm.job(number)["samples_done"] == samples, "all samples")
        expect(farm.job(number)["state"] == "running", farm.job(number))
        farm.coordinator.kill()
        disk.go_on()
        farm.restart_coordinator(env=disk.env)
        wait_for(lambda: worker.log_text().count("joined as session") == 2, "the worker to come back")
        kept = re.findall(r"(\d+) results to send again", worker.log_text())[-1]
        expect(int(kept) == units, "%s of %d results were kept" % (kept, units))
        farm.wait_for_job(number)
        disk.fail(errno.EIO, "/films/", "data")
        number = farm.submit(farm.scene(), *SMALL)
        wait_for(lambda: os.strerror(errno.EIO) in farm.job(number)["state_text"], "the job to say why it waits")
        expect(farm.job(number)["state"] in ("queued", "running"), farm.job(number))
        disk.work()
        farm.wait_for_job(number)


@tests.add
def the_newest_state_is_stored():
    """a state noted while the one before it hangs is what a restart finds, also if the older one's write fails"""
    verbs = [(("priority", "--to", 3), ("priority", "--to", 7)), (("pause", ), ("resume", )), (("priority", "--to", 3), ("pause", )),
             (("pause", ), ("priority", "--to", 3)), (("pause", ), ("cancel", )), (("priority", "--to", 3), ("cancel", )),
             (("comment", "one"), ("comment", "two"))]
    with Farm() as farm:
        disk = StalledDisk(farm)
        farm.start_coordinator(env=disk.env)
        jobs = []

        def state(number):
            job = farm.job(number)
            return {key: job.get(key) for key in ("state", "priority", "comment")}
        numbers = [farm.submit(farm.scene(), *SMALL) for _ in verbs]
        for number, (first, second) in zip(numbers, verbs):
            states, clients = [state(number)], []
            disk.hang("/queue.sqlite")
            for verb in (first, second):
                clients.append(farm.start_cli(verb[0], number, *verb[1:]))
                wait_for(lambda: state(number) != states[-1], "%s to be in effect" % (verb, ))
                states.append(state(number))
            disk.fail(errno.EIO, "/queue.sqlite")
            disk.go_on()
            for verb, client in zip((first, second), clients):
                out, err = client.communicate(timeout=60 * PATIENCE)
                expect(client.returncode == NOT_STORED, (verb, out, err))
            disk.work()
            wait_for(lambda: farm.coordinator.log_text().count("the store can be used again") > len(jobs), "the store")
            expect("not stored" not in farm.job(number)["state_text"], farm.job(number))
            jobs.append((first, second, number, state(number)))
            expect(jobs[-1][3] == states[-1] or second[0] == "cancel", (first, second, states, jobs[-1]))
        farm.coordinator.kill()
        farm.restart_coordinator(env=disk.env)
        for first, second, number, wanted in jobs:
            expect(state(number) == wanted, (first, second, wanted, state(number)))



if __name__ == "__main__":
    tests.run()
