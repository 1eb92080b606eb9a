"""What a coordinator removes by itself and by prune and gc; that nothing needed goes, at any step of a job's
life and through kill -9; what takes the room; jobs that do not fit."""
import json
import os
import signal
import socket
import subprocess
import threading
import time

from disk import SmallDisk, fill_up
from farm import Farm, Skip, Tests, wait_for
from jobs import Outcome, expect, expect_same
from keeping import (COLLECT_ALL, ENDLESS, LONG, SMALL, begun, blobs, exists, films, gc, log_of, pictures,
                     scene_with_textures, total, trash)

tests = Tests()


@tests.add
def life():
    """Collecting at every step of a job's life removes nothing that it needs: the same bits"""
    with Farm() as farm:
        farm.start_coordinator(*COLLECT_ALL)
        scene, other = farm.scene(), farm.scene("other.gltf", light=7.0)
        reference = farm.submit(scene, *LONG)
        worker = farm.start_worker()
        farm.wait_for_job(reference)
        outcome = Outcome(farm, reference, "reference")
        farm.cli("remove", reference, expect=0)
        wait_for(lambda: gc(farm) and not blobs(farm), "the blobs of a removed job to go")

        number = farm.submit(scene, *LONG)  # queued or running
        gc(farm)
        begun(farm, number)
        worker.signal(signal.SIGSTOP)  # the job is not over before it is cancelled
        before = blobs(farm)
        expect(gc(farm)["removed_blobs"] == 0 and blobs(farm) == before, "running")
        farm.cli("pause", number, expect=0)
        gc(farm)
        expect(blobs(farm) == before and films(farm, number), "paused")
        farm.cli("resume", number, expect=0)
        farm.cli("cancel", number, expect=0)
        worker.signal(signal.SIGCONT)
        gc(farm)
        farm.wait_for_job(number, "cancelled")
        gc(farm)
        farm.cli("retry", number, expect=0)
        gc(farm)
        farm.wait_for_job(number)
        gc(farm)
        expect_same(farm, Outcome(farm, number, "collected"), outcome, "collected at every step", counts=False)
        farm.cli("develop", number, "--tonemap", "aces", expect=0)
        gc(farm)
        farm.cli("extend", number, "--spp", "192", expect=0)
        gc(farm)
        begun(farm, number)
        gc(farm)
        farm.wait_for_job(number)
        expect(len(films(farm, number)) == 2, films(farm, number))
        extended = Outcome(farm, number, "extended")
        second = farm.submit(other, *SMALL)  # its blobs do not hold the first one's
        farm.cli("remove", number, expect=0)
        gc(farm)
        farm.wait_for_job(second)
        expect(extended.bits, "extended")


class Tap:
    """A proxy in front of the coordinator that can stop passing on what the client sends."""

    def __init__(self, farm):
        self.farm, self.budget, self.down_budget = farm, None, None
        self.lock = threading.Condition()
        self.listener = socket.socket()
        self.listener.bind(("127.0.0.1", 0))
        self.listener.listen(8)
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        self.passed = self.down_passed = 0
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            host, port = self.farm.address.rsplit(":", 1)
            far = socket.create_connection((host, int(port)))
            threading.Thread(target=self.up, args=(near, far), daemon=True).start()
            threading.Thread(target=self.down, args=(far, near), daemon=True).start()

    def up(self, source, sink):
        try:
            while True:
                data = source.recv(512)
                if not data:
                    sink.shutdown(socket.SHUT_WR)
                    return
                with self.lock:
                    while self.budget is not None and self.passed >= self.budget:
                        self.lock.wait(0.05)
                    self.passed += len(data)
                sink.sendall(data)
        except OSError:
            pass

    def down(self, source, sink):
        try:
            while True:
                data = source.recv(16384)
                while self.down_budget is not None and self.down_passed >= self.down_budget:
                    time.sleep(0.01)  # how often it looks
                self.down_passed += len(data)
                if not data:
                    sink.shutdown(socket.SHUT_WR)
                    return
                sink.sendall(data)
        except OSError:
            pass

    def allow(self, budget):
        with self.lock:
            self.budget = budget
            self.lock.notify_all()

    def stuck(self):
        with self.lock:
            return self.budget is not None and self.passed >= self.budget


def collected_at(farm, tap, scene, stop, sends, all_blobs):
    """Submit, and collect when so many bytes were sent; False: there are fewer. The job is rendered."""
    if sends:
        gc(farm)
        expect(not blobs(farm), "no job needs any blob")
    tap.passed = 0
    tap.allow(stop)
    client = subprocess.Popen(farm.cli_argv("submit", scene, "--json", *SMALL, connect=False) +
                              ["--coordinator", tap.address, "--key", farm.key], cwd=farm.folder,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_for(lambda: tap.stuck() or client.poll() is not None, "the client to be held up")
    held = client.poll() is None
    if held:
        gc(farm)
    tap.allow(None)
    out, err = client.communicate(timeout=60)
    expect(client.returncode == 0, (stop, out, err))
    gc(farm)
    number = json.loads(out)["job"]
    expect(blobs(farm) >= all_blobs, "the blobs of job %d" % number)
    farm.wait_for_job(number)
    farm.cli("remove", number, expect=0)
    return held


@tests.add
def upload():
    """Collecting at any moment between a submission's first question and its job leaves its blobs"""
    with Farm() as farm:
        farm.start_coordinator(*COLLECT_ALL)
        scene = scene_with_textures(farm, 24)
        first = farm.submit(scene, *SMALL)
        all_blobs = blobs(farm)
        expect(len(all_blobs) > 24, all_blobs)
        farm.start_worker()
        farm.wait_for_job(first)
        farm.cli("remove", first, expect=0)
        tap = Tap(farm)
        # At first every blob is sent; then the client is told that all of them are there.
        for sends, first_stop, step in ((True, 2000, 30000), (False, 700, 250)):
            stops = 0
            while collected_at(farm, tap, scene, first_stop + stops * step, sends, all_blobs):
                stops += 1
            expect(stops >= 4, "it was held up %d times" % stops)


@tests.add
def fetched():
    """A job whose pictures are being fetched stays until that is over; prune says so"""
    with Farm() as farm:
        farm.start_coordinator("--keep", "0s", *COLLECT_ALL)
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "900x700", "--frames", "1-2", "--spp", "1")
        farm.wait_for_job(number)
        tap = Tap(farm)
        tap.down_budget = 300000  # in the middle of the first picture
        client = subprocess.Popen(farm.cli_argv("fetch", number, "-o", "slow", connect=False) +
                                  ["--coordinator", tap.address, "--key", farm.key], cwd=farm.folder,
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        wait_for(lambda: tap.down_passed >= tap.down_budget, "the fetch to be held up")
        gc(farm)
        expect(exists(farm, number) and len(pictures(farm, number)) >= 4, "it stays while it is fetched")
        result = farm.cli("prune", number)
        expect(result.code == 5 and "fetches" in result.err, result)
        tap.down_budget = None
        _, err = client.communicate(timeout=60)
        expect(client.returncode == 0 and len(os.listdir(farm.path("slow"))) >= 4, err)
        wait_for(lambda: gc(farm) and not exists(farm, number) and not pictures(farm, number), "it and its pictures to go then")


@tests.add
def ages():
    """--keep and --keep-failed remove jobs by themselves, at a restart, too, and say why"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        done = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(done)
        cancelled = farm.submit(farm.scene(), *ENDLESS)
        begun(farm, cancelled)
        farm.cli("cancel", cancelled, expect=0)
        farm.wait_for_job(cancelled, "cancelled")
        active = farm.submit(farm.scene(), *ENDLESS)
        begun(farm, active)
        gc(farm)
        expect(exists(farm, done) and exists(farm, cancelled), "without a policy everything stays")
        farm.coordinator.kill()
        farm.restart_coordinator("--keep-failed", "0s")
        wait_for(lambda: not exists(farm, cancelled), "the cancelled job to go")
        expect(exists(farm, done) and exists(farm, active), "the others stay")
        wait_for(lambda: not films(farm, cancelled) and not pictures(farm, cancelled), "its files to go")
        expect("--keep-failed" in farm.coordinator.log_text(), farm.coordinator.log_text())
        farm.coordinator.stop()
        farm.restart_coordinator("--keep", "0s")
        wait_for(lambda: not exists(farm, done), "the finished job to go")
        expect(exists(farm, active), "an active job stays")
        farm.cli("cancel", active, "--discard", expect=0)
        gc(farm)
        wait_for(lambda: not exists(farm, active), "it to go, too")


@tests.add
def limits():
    """Above --store-limit and --owner-limit films go before pictures, the oldest first; active jobs stay"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        jobs = []
        for _ in range(3):
            jobs.append(farm.submit(farm.scene(), "--size", "800x500", "--spp", "4"))
            farm.wait_for_job(jobs[-1])
        room = farm.cli("show", "--farm", "--json", expect=0).json()
        by_job = {row["job"]: row for row in room["jobs"]}
        film = by_job[jobs[0]]["films"]
        expect(film > 0 and all(by_job[j]["pictures"] > 0 for j in jobs), room)
        farm.coordinator.stop()
        farm.restart_coordinator("--store-limit", str(total(room) - film // 2))
        wait_for(lambda: not films(farm, jobs[0]), "the oldest job's films to go")
        gc(farm)
        expect(films(farm, jobs[1]) and films(farm, jobs[2]), "the other films stay")
        expect(all(exists(farm, j) and pictures(farm, j) for j in jobs), "all pictures stay")
        expect("--store-limit" in log_of(farm, jobs[0]), log_of(farm, jobs[0]))
        result = farm.cli("extend", jobs[0], "--spp", "32")
        expect(result.code == 5 and "film" in result.err, result)
        farm.coordinator.stop()
        # Less than the pictures take: all films, then the oldest job.
        owner = room["owners"][0]
        farm.restart_coordinator("--owner-limit", str(owner["pictures"] - 1))
        wait_for(lambda: not exists(farm, jobs[0]), "the oldest job to go")
        gc(farm)
        expect(not films(farm, jobs[1]) and not films(farm, jobs[2]), "no films are left")
        expect(exists(farm, jobs[1]) and exists(farm, jobs[2]), "the newer jobs stay")
        expect("--owner-limit" in farm.coordinator.log_text(), "the log says why")
        farm.coordinator.stop()
        farm.restart_coordinator()
        active = farm.submit(farm.scene(), "--size", "64x64", "--spp", "1000000")
        begun(farm, active)
        farm.coordinator.kill()
        farm.restart_coordinator("--store-limit", "1")
        wait_for(lambda: not exists(farm, jobs[2]), "all that has ended to go")
        gc(farm)
        begun(farm, active)
        expect(films(farm, active), "a film in work stays")
        farm.cli("cancel", active, "--discard", expect=0)
        farm.coordinator.stop()
        farm.restart_coordinator()
        extended = farm.submit(farm.scene(), "--size", "128x80", "--spp", "4", "--frames", "1-2")
        farm.wait_for_job(extended)
        expect(films(farm, extended) == ["frame-0001.kept", "frame-0002.kept"], films(farm, extended))
        farm.cli("extend", extended, "--spp", "1000000", "--frames", "2", expect=0)
        farm.cli("pause", extended, expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator("--store-limit", "1")
        wait_for(lambda: "frame-0001.kept" not in films(farm, extended), "the done frame's film to go")
        gc(farm)
        expect("frame-0002.kept" in films(farm, extended), "the film from which a frame goes on stays")


@tests.add
def prune():
    """prune chooses by age and state, asks, and removes jobs or only their films"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = farm.scene()
        jobs = [farm.submit(scene, *SMALL, "--name", "p%d" % i) for i in range(3)]
        for job in jobs:
            farm.wait_for_job(job)
        active = farm.submit(scene, *ENDLESS)
        begun(farm, active)
        result = farm.cli("prune")
        expect(result.code == 2, result)
        expect(farm.cli("prune", "--older-than", "soon").code == 2, "not a time")
        expect(farm.cli("prune", "--older-than", "1d", "--yes").code == 5, "none is so old")
        result = farm.cli("prune", "--older-than", "0s")
        expect(result.code == 2 and "3 jobs" in result.err and "--yes" in result.err, result)
        farm.cli("prune", "p0", "--films", "--yes", expect=0)
        expect(not films(farm, jobs[0]) and pictures(farm, jobs[0]) and films(farm, jobs[1]), "only films")
        result = farm.cli("prune", active, "--films")
        expect(result.code == 5 and farm.job(active)["state"] == "running", result)
        result = farm.cli("prune", active)
        expect(result.code == 5 and "cancel" in result.err, result)
        farm.cli("prune", "--older-than", "0s", "--state", "done", "--yes", expect=0)
        expect(not any(exists(farm, j) for j in jobs) and exists(farm, active), "pruned")


@tests.add
def killed():
    """A coordinator killed in the middle of a collection has lost nothing, and goes on"""
    with Farm() as farm:
        farm.start_coordinator(*COLLECT_ALL)
        farm.start_worker()
        scene = scene_with_textures(farm, 24)
        number = farm.submit(scene, *LONG)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")
        needed = blobs(farm)
        for delay_s in (0.0, 0.01, 0.03):
            others = [farm.submit(farm.scene("o%d.gltf" % i, light=2.0 + i), *SMALL) for i in range(4)]
            for other in others:
                farm.wait_for_job(other)
            kept = farm.submit(scene, *LONG)
            begun(farm, kept)
            farm.coordinator.kill()
            farm.restart_coordinator("--keep", "0s", *COLLECT_ALL)
            time.sleep(delay_s)  # a sweep over moments, not a wait
            farm.coordinator.kill()
            farm.restart_coordinator(*COLLECT_ALL)
            gc(farm)
            expect(blobs(farm) >= needed, "its blobs")
            farm.wait_for_job(kept)
            expect_same(farm, Outcome(farm, kept, "kept%g" % delay_s), reference, "after %g s" % delay_s,
                        counts=False)
        farm.coordinator.stop()
        farm.restart_coordinator("--keep", "0s", *COLLECT_ALL)
        wait_for(lambda: not any(exists(farm, o) for o in others + [kept]), "all that has ended to go")
        for folder in ("films", "outputs"):
            wait_for(lambda: all(exists(farm, n) for n in os.listdir(farm.path("store", folder))), folder + " without a job to go")


def freed(farm, job):
    """The room of what was removed is free, and the database has its reserve again. What is still to be
    written about it (a job's log flushes that) takes the reserve for a moment."""
    farm.cli("log", job, expect=0)

    def done():
        return not trash(farm) and os.path.exists(os.path.join(farm.store, "reserve"))
    wait_for(done, "the room to be freed")


@tests.add
def full_disk():
    """On a full disk gc, prune and the limits make room, and what waited goes on"""
    with Farm() as farm, SmallDisk(farm, 48 << 20) as disk:
        if disk is None:
            raise Skip("mounting is not permitted: no full disk here")
        farm.store = os.path.join(disk, "store")
        farm.start_coordinator(*COLLECT_ALL)
        farm.start_worker()
        scene = farm.scene()
        # What is removed is far more than what the database's log grows by meanwhile: the reserve must fit beside that.
        old = [farm.submit(scene, "--size", "640x400", "--spp", "1") for _ in range(3)]
        for job in old:
            farm.wait_for_job(job)
        number = farm.submit(scene, "--size", "128x80", "--spp", "768")
        begun(farm, number)
        farm.cli("pause", number, expect=0)
        fill_up(os.path.join(disk, "filler"))
        farm.cli("prune", old[0], "--films", expect=0)
        freed(farm, number)
        fill_up(os.path.join(disk, "filler-2"))
        farm.cli("prune", old[0], expect=0)
        expect(not exists(farm, old[0]), "pruned")
        freed(farm, number)
        fill_up(os.path.join(disk, "filler-3"))
        gc(farm)
        farm.coordinator.kill()
        farm.restart_coordinator("--store-limit", "1", *COLLECT_ALL)
        wait_for(lambda: not exists(farm, old[1]) and not exists(farm, old[2]), "the limit to make room")
        expect(films(farm, number), "what a paused job has stays")
        os.unlink(os.path.join(disk, "filler"))
        farm.coordinator.stop()
        farm.restart_coordinator(*COLLECT_ALL)
        farm.cli("resume", number, expect=0)
        farm.wait_for_job(number)


@tests.add
def room():
    """show --farm adds up; a job that cannot fit is told so when it is submitted"""
    with Farm() as farm:
        farm.start_coordinator("--owner-limit", "200M", "--store-limit", "400M")
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        told = farm.cli("show", "--farm", "--json", expect=0).json()
        row = [r for r in told["jobs"] if r["job"] == number][0]
        expect(row["films"] > 0 and row["pictures"] > 0 and row["state"] == "done", row)
        expect(told["owners"][0]["jobs"] == 1 and told["store_limit"] == 400 << 20, told)
        text = farm.cli("show", "--farm", expect=0).out
        for word in ("films", "pictures", "blobs", "database", "reserve", row["owner"], "400"):
            expect(word in text, text)
        expect(farm.cli("show").code == 2 and farm.cli("show", number, "--farm").code == 2, "usage")
        result = farm.cli("submit", farm.scene(), "--size", "4000x3000", "--frames", "1-9", "--spp", "4")
        expect(result.code == 3 and "--owner-limit" in result.err, result)
        farm.coordinator.stop()
        farm.restart_coordinator("--store-limit", "400M")
        big = ("--size", "4000x3000", "--frames", "1-9", "--spp", "4")
        result = farm.cli("submit", farm.scene(), *big)
        expect(result.code == 3 and "--force" in result.err and "show --farm" in result.err, result)
        forced = farm.submit(farm.scene(), *big, "--force")
        farm.cli("cancel", forced, "--discard", expect=0)


tests.run()
