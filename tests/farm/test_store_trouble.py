"""A store that is full, read-only or cannot be opened pauses what it touches: no job fails, no film is
lost, everybody learns why, and all goes on by itself when the cause is gone."""
import errno
import os
import re
import resource
import signal
import socket
import sqlite3
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import OddDisk, SmallDisk, fill_up
from farm import BUILD, PATIENCE, Farm, Skip, Tests, wait_for
from jobs import SLOW, LongJob, Outcome, expect, expect_same, wait_mid_frame
from odd import die_of
from page import Page

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]
DISK_BYTES = 24 << 20
NOT_STORED = 11  # exit status: it is done, but not on disk yet


class Reference:
    """What the small job gives on a farm that nothing disturbs."""
    outcome = None

    @classmethod
    def expect_same(cls, farm, number):
        if cls.outcome is None:
            with Farm() as other:
                other.start_coordinator()
                other.start_worker()
                first = other.submit(other.scene(), *SMALL)
                other.wait_for_job(first)
                cls.outcome = Outcome(other, first, "reference")
        mine = Outcome(farm, number, "job-%d" % number)
        expect(mine.bits == cls.outcome.bits and mine.pngs == cls.outcome.pngs, "job %d" % number)


def small_disk(farm):
    """A small disk that holds the store; used by `with`."""
    disk = SmallDisk(farm, DISK_BYTES)
    farm.store = os.path.join(disk.folder, "store")
    farm.filler = os.path.join(disk.folder, "filler")
    return disk


def need(folder):
    if folder is None:
        raise Skip("mounting is not permitted: no small disk here")


def wait_text(farm, number, words):
    """Wait until the job says so; it must not have ended."""
    def look():
        job = farm.job(number)
        expect(job["state"] in ("queued", "running"), job)
        return job if words in job["state_text"] else None
    return wait_for(look, "job %d to say '%s'" % (number, words))


def wait_log(farm, words, count=1):
    wait_for(lambda: farm.coordinator.log_text().count(words) >= count, "the log to say " + words)


def films(farm, number):
    folder = os.path.join(farm.store, "films", str(number))
    return sorted(os.listdir(folder)) if os.path.isdir(folder) else []


@tests.add
def twenty_jobs_and_a_full_disk():
    """a full disk fails none of 20 jobs; all say why, and are done with the same bits when there is room"""
    with Farm() as farm, small_disk(farm) as folder:
        need(folder)
        farm.start_coordinator()
        jobs = [farm.submit(farm.scene(), *SMALL, "--token", "job %d" % i) for i in range(20)]
        fill_up(farm.filler)
        worker = farm.start_worker()
        wait_text(farm, jobs[0], "No space left on device")
        for job in farm.cli("list", "--json", expect=0).json()["jobs"]:
            expect(job["state"] in ("queued", "running"), job)
            expect("the store cannot be used" in job["state_text"], job)
        expect(farm.cli("list", expect=0).out.count("No space left on device") == 20, "list")
        expect("No space left" in farm.cli("show", jobs[19], expect=0).out, "show")
        result = farm.cli("submit", farm.scene(), *SMALL)
        expect(result.code == 8 and "No space left" in result.err and "try again" in result.err, result)
        # A repeated submission needs no room: its answer may be what was lost.
        expect(farm.submit(farm.scene(), *SMALL, "--token", "job 7") == jobs[7], "the repeated submission")
        result = farm.cli("submit", farm.scene(), *SMALL, "--seed", 1, "--token", "job 7")
        expect(result.code == 5 and "was used for job %d" % jobs[7] in result.err, result)
        result = farm.cli("submit", farm.scene("other.gltf", light=3.0), *SMALL)
        expect(result.code == 8 and "No space left" in result.err, result)
        expect(os.listdir(os.path.join(farm.store, "blobs", "tmp")) == [], "half a blob")
        # What ends now is on disk all the same: the reserve is for that.
        farm.cli("cancel", jobs[19], expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(farm.job(jobs[19])["state"] == "cancelled", farm.job(jobs[19]))
        wait_text(farm, jobs[0], "No space left on device")
        text = farm.coordinator.log_text()
        expect(text.count("the store cannot be used") == 1 and "again after" not in text, text)
        os.unlink(farm.filler)
        for number in jobs[:19]:
            farm.wait_for_job(number)
        Reference.expect_same(farm, jobs[0])
        Reference.expect_same(farm, jobs[18])
        text = farm.coordinator.log_text()
        expect(text.count("the store cannot be used") == 1, text)
        expect(text.count("the store can be used again") == 1, text)
        expect(os.path.getsize(os.path.join(farm.store, "reserve")) == 4 << 20, "the reserve")
        expect(worker.alive(), "the worker ended")


def interrupted(farm, fill, clear, end):
    """In mid-frame the disk goes wrong and the coordinator ends; it starts on the bad disk, and what was
    rendered is there. Returns the job's number once it is done, and its undisturbed twin's outcome."""
    long_job = LongJob(1.0 if not SLOW else 3.0, "129x97")
    farm.start_coordinator()
    farm.start_worker()
    farm.wait_for_workers(1)
    long_job.measure(farm)
    number = long_job.submit(farm)
    farm.wait_for_job(number)
    reference = Outcome(farm, number, "reference")
    finished, number = number, long_job.submit(farm)
    wait_mid_frame(farm, number, 0.25)
    end(fill)
    job = wait_text(farm, number, "the store cannot be used")
    expect(job["state"] == "running" and job["samples_done"] > 0, job)
    expect(films(farm, number) == ["frame-0000.film"] or films(farm, number) == ["frame-0001.film"],
           films(farm, number))
    Outcome(farm, finished, "early")  # what is finished can be fetched
    result = farm.cli("submit", farm.scene(), *SMALL)
    expect(result.code == 8 and "cannot be used" in result.err, result)
    clear()
    farm.wait_for_job(number)
    expect_same(farm, Outcome(farm, number, "end"), reference, "after the outage", counts=False)
    wait_for(lambda: [f[-5:] for f in films(farm, number)] == [".kept"], "the film to be closed up")


@tests.add
def killed_on_a_full_disk():
    """killed with -9 on a full disk and started on it, the coordinator has the film's samples and goes on"""
    with Farm() as farm, small_disk(farm) as folder:
        need(folder)

        def end(fill):
            fill()
            farm.coordinator.kill()
            farm.restart_coordinator()
        interrupted(farm, lambda: fill_up(farm.filler), lambda: os.unlink(farm.filler), end)


@tests.add
def read_only_disk():
    """started on a read-only disk after an orderly end or a kill, the coordinator serves what it has"""
    for orderly in (True, False):
        with Farm() as farm, small_disk(farm) as folder:
            need(folder)
            disk = SmallDisk(farm, 0)

            def end(fill):
                if orderly:
                    expect(farm.coordinator.stop() == 0, farm.coordinator.log_text())
                else:
                    farm.coordinator.kill()
                fill()
                farm.restart_coordinator()
            interrupted(farm, lambda: disk.remount("ro"), lambda: disk.remount("rw"), end)


@tests.add
def cancelled_on_a_disk_that_cannot_be_written():
    """a cancel that is not on disk says so, and a parked job says why it is parked, not that it waits"""
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        parked = farm.submit(farm.scene(), *SMALL)
        for death in range(4):
            die_of(farm, "machine-%d" % (death % 2))
        farm.wait_for_job(parked, "parked")
        number = farm.submit(farm.scene(), "--size", "512x512", "--spp", "1000000")
        worker = farm.start_worker()
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
        disk.fail(errno.EROFS, "/store/")
        wait_text(farm, number, "the store cannot be used")
        result = farm.cli("cancel", number, expect=NOT_STORED)
        expect("not stored yet" in result.out and "Read-only" in result.out, result)
        expect("4 workers in a row died" in farm.job(parked)["state_text"], farm.job(parked))
        farm.coordinator.kill()
        disk.work()
        farm.restart_coordinator(env=disk.env)
        wait_for(lambda: farm.job(number)["workers"] == 1, "what was not stored to run again")
        farm.cli("cancel", number, expect=0)
        expect("not stored" not in farm.wait_for_job(number, "cancelled")["state_text"], "the note")
        expect(worker.alive(), "the worker ended")


@tests.add
def no_descriptors():
    """idle connections leave the store its descriptors; while it has none at all, jobs wait for them"""
    with Farm() as farm:
        def limit(soft):
            resource.prlimit(farm.coordinator.pid, resource.RLIMIT_NOFILE, (soft, 4096))

        def held_jobs(count):  # nothing is rendered before the test lets the worker go on
            worker.signal(signal.SIGSTOP)
            jobs = [farm.submit(farm.scene(), *SMALL) for _ in range(count)]
            watches = [farm.start_cli("watch", number) for number in jobs]
            for watch in watches:
                wait_log(farm, ":%d connects" % watch.pid)
            return jobs, watches

        farm.start_coordinator("--log-level", "debug")
        worker = farm.start_worker()
        farm.wait_for_workers(1)
        jobs, watches = held_jobs(8)
        limit(256)
        host, port = farm.address.rsplit(":", 1)
        idle = [socket.create_connection((host, int(port))) for _ in range(300)]
        wait_log(farm, "it makes room")
        worker.signal(signal.SIGCONT)
        for watch in watches:
            expect(watch.wait(60 * PATIENCE) == 0, "a job ended badly: %s" % watch.stderr.read())
        used = len(os.listdir("/proc/%d/fd" % farm.coordinator.pid))
        expect(100 < used <= 256 - 128 + 1, "%d descriptors in use" % used)
        expect("until it works" not in farm.coordinator.log_text(), farm.coordinator.log_text())
        for connection in idle:
            connection.close()
        limit(4096)
        Reference.expect_same(farm, jobs[-1])

        jobs, watches = held_jobs(1)
        limit(8)
        worker.signal(signal.SIGCONT)
        wait_log(farm, "the store cannot be used")
        expect("Too many open files" in farm.coordinator.log_text(), farm.coordinator.log_text())
        expect(watches[0].poll() is None, "the job ended")
        limit(4096)
        expect(watches[0].wait(60 * PATIENCE) == 0, "watch")
        wait_log(farm, "the store can be used again")
        Reference.expect_same(farm, jobs[0])


ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE, errno.ENFILE, errno.EACCES,
          errno.EPERM, errno.ENOENT, errno.ENOMEM)


@tests.add
def every_error_of_films_and_outputs():
    """films or pictures that cannot be made, for any of 10 reasons: jobs wait, say which, and go on"""
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        for number in ERRORS:
            for where in ("/films/", "/outputs/"):
                disk.fail(number, where, "any" if where == "/films/" else "write")
                job = farm.submit(farm.scene(), *SMALL)
                other = wait_text(farm, job, os.strerror(number))
                expect(where in other["state_text"] and "trying again" in other["state_text"], other)
                disk.work()
                farm.wait_for_job(job)
                Reference.expect_same(farm, job)
        text = farm.coordinator.log_text()
        expect(text.count("the coordinator keeps trying") == 2 * len(ERRORS), text)
        expect(text.count("continues after") == 2 * len(ERRORS), text)


@tests.add
def every_error_of_the_store():
    """a whole store that cannot be written, for any of 10 reasons: one line in the log, no job fails"""
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        for i, number in enumerate(ERRORS):
            jobs = [farm.submit(farm.scene(), *SMALL) for _ in range(2)]
            disk.fail(number, "/store/")
            worker = farm.start_worker()
            wait_text(farm, jobs[0], "the store cannot be used")
            job = wait_text(farm, jobs[1], os.strerror(number))
            expect(job["state"] == "queued", job)
            disk.work()
            for job in jobs:
                farm.wait_for_job(job)
                Reference.expect_same(farm, job)
            text = farm.coordinator.log_text()
            expect(text.count("the store cannot be used") == i + 1, text)
            expect(text.count("the store can be used again") == i + 1, text)
            expect("keeps trying" not in text.replace("the coordinator keeps trying", "", i + 1), text)
            worker.stop()
            farm.wait_for_workers(0)


@tests.add
def blob_that_cannot_be_read():
    """a blob that the coordinator cannot open is waited for: no worker calls the job broken"""
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        job = farm.submit(farm.scene(), *SMALL)
        disk.fail(errno.EMFILE, "/store/blobs/", "any")
        farm.start_worker()
        wait_log(farm, "it is sent when it can be read")
        expect(farm.job(job)["state"] in ("queued", "running"), farm.job(job))
        disk.work()
        farm.wait_for_job(job)
        Reference.expect_same(farm, job)
        expect("cannot render" not in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def results_are_kept_and_sent_again():
    """results whose film cannot be opened after a restart stay with their worker, which delivers them later"""
    long_job = LongJob(1.0 if not SLOW else 3.0, "129x97")
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        worker = farm.start_worker()
        farm.wait_for_workers(1)
        long_job.measure(farm)
        number = long_job.submit(farm)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")
        number = long_job.submit(farm)
        wait_mid_frame(farm, number, 0.2)
        disk.fail(errno.EACCES, "/films/", "any")
        wait_text(farm, number, "Permission denied")  # nothing is acknowledged from here on
        farm.coordinator.kill()
        farm.restart_coordinator(env=disk.env)
        wait_text(farm, number, "frame 1 cannot be opened")
        wait_for(lambda: worker.log_text().count("joined as session") == 2, "the worker to come back")
        kept = re.findall(r"(\d+) results to send again", worker.log_text())[-1]
        expect(int(kept) > 0, "nothing to keep")
        expect(farm.job(number)["state"] == "running", farm.job(number))
        disk.work()
        wait_for(lambda: worker.log_text().count("joined as session") == 3, "the worker to deliver")
        farm.wait_for_job(number)
        expect("connect and send what was not acknowledged" in worker.log_text(), worker.log_text())
        again = re.findall(r"(\d+) results to send again", worker.log_text())[-1]
        expect(int(again) >= int(kept), "results were lost: %s of %s" % (again, kept))
        expect_same(farm, Outcome(farm, number, "end"), reference, "after the outage", counts=False)


def stored_state(farm, number):
    with sqlite3.connect("file:%s?mode=ro" % os.path.join(farm.store, "queue.sqlite"), uri=True) as db:
        return db.execute("SELECT state FROM jobs WHERE id=?", (number,)).fetchone()[0]


@tests.add
def steered_on_a_disk_that_cannot_be_written():
    """the first answer of a verb whose change is not on disk says so; a kill loses it, the disk's return does not"""
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        for first in ("pause", "resume", "priority", "cancel"):
            for killed in (False, True):
                number = farm.submit(farm.scene(), *SMALL)
                more = ("--to", "7") if first == "priority" else ("--discard", ) if first == "cancel" else ()
                if first == "resume":
                    farm.cli("pause", number, expect=0)
                before = {k: farm.job(number)[k] for k in ("state", "priority")}
                disk.fail(errno.EIO, "/queue.sqlite")
                page = Page(farm.coordinator) if "noweb" not in BUILD and first != "resume" else None
                result = farm.cli(first, number, *more, expect=NOT_STORED)
                expect("not stored yet" in result.err, result)
                if page:  # the same request again, which changes nothing: it is still not stored
                    body = {"priority": 7} if first == "priority" else {"discard": True} if first == "cancel" else {}
                    answer = page.post("/api/v1/jobs/%d/%s" % (number, first), body)
                    expect(answer.status == 202 and answer.json()["jobs"][0]["not_stored"], answer)
                expect("not stored yet" in farm.job(number)["state_text"], (first, farm.job(number)))
                expect("not stored yet" in result.out, result)
                after = {k: farm.job(number)[k] for k in ("state", "priority")}
                expect(after != before, (first, after))
                if killed:
                    farm.coordinator.kill()
                disk.work()
                if not killed:
                    wait_for(lambda: "not stored" not in farm.job(number)["state_text"], "it to be stored")
                    farm.coordinator.kill()
                farm.restart_coordinator(env=disk.env)
                now = {k: farm.job(number)[k] for k in ("state", "priority")}
                expect(now == (before if killed else after), (first, killed, now))


@tests.add
def films_outlive_what_is_not_stored():
    """a job's films are removed only when its end is in the database; until then `show` says so"""
    cancelled = 4
    with Farm() as farm:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        long_job = ["--size", "64x64", "--spp", "1048576"]
        for killed in (False, True):
            number = farm.submit(farm.scene(), *long_job)
            # A film that has no results yet, but the room for its header, goes when its frame closes.
            wait_for(lambda: any(os.path.getsize(os.path.join(farm.store, "films", str(number), film)) > 1024
                                 for film in films(farm, number)), "samples on disk")
            if killed:  # only what is on disk outlives that
                expect(farm.coordinator.stop() == 0, farm.coordinator.log_text())
                farm.restart_coordinator(env=disk.env)
            disk.fail(errno.EIO, "/queue.sqlite")
            farm.cli("cancel", "--discard", number, expect=NOT_STORED)
            job = wait_for(lambda: (lambda j: j if "not stored yet" in j["state_text"] else None)(
                farm.job(number)), "the job to say that it is not stored")
            expect(job["state"] == "cancelled" and films(farm, number) != [], job)
            if killed:  # nobody was promised more
                farm.coordinator.kill()
                disk.work()
                farm.restart_coordinator(env=disk.env)
                expect(farm.job(number)["state"] == "running", farm.job(number))
                expect(farm.job(number)["samples_done"] > 0, "the film is gone")
                farm.cli("cancel", "--discard", number, expect=0)
            else:
                disk.work()
            wait_for(lambda: films(farm, number) == [], "the films to go")
            expect(stored_state(farm, number) == cancelled, stored_state(farm, number))
            if not killed:
                wait_log(farm, "the store can be used again")


@tests.add
def private_store():
    """the store and the cache are only their user's, and an older store with wider rights is reported"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        farm.cli("submit", farm.scene(), *SMALL, expect=0)
        for top in (farm.store, farm.path("cache-1")):
            for path, folders, files in os.walk(top):
                for name in [""] + files:
                    mode = os.stat(os.path.join(path, name)).st_mode & 0o777
                    expect(mode == (0o600 if name else 0o700), "%s/%s: %o" % (path, name, mode))
        expect("other users" not in farm.coordinator.log_text(), farm.coordinator.log_text())
        farm.coordinator.stop()
        os.chmod(farm.store, 0o755)
        os.chmod(os.path.join(farm.store, "blobs"), 0o755)
        farm.restart_coordinator()
        expect(farm.coordinator.log_text().count("chmod -R go=") == 1, farm.coordinator.log_text())


if __name__ == "__main__":
    tests.run()
