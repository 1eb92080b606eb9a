"""What goes wrong on a farm, and what must come of it: workers that die, keys and versions that do not
fit, peers that break every rule, full disks, damaged files, and programs that must leave nothing behind."""
import json
import os
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, PATIENCE, Farm, Skip, Tests, read_bytes, wait_for
from disk import SmallDisk, fill_up
from jobs import (SLOW, SPHERES, LongJob, Outcome, expect, expect_same, wait_mid_frame, worker_of)
from odd import OddPeer, talk_raw

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]


class Normal:
    """A job that the coordinator must still be able to serve, and what it must give."""
    reference = None

    @classmethod
    def check(cls, farm, what):
        """With a worker connected: the job runs and gives the same picture as ever."""
        number = farm.submit(farm.scene(), *SMALL)
        job = farm.wait_for_job(number)
        expect(job["conflicts"] == 0, job)
        outcome = Outcome(farm, number, "normal-%d" % number)
        if cls.reference is None:
            with Farm() as other:  # an undisturbed one
                other.start_coordinator()
                other.start_worker()
                first = other.submit(other.scene(), *SMALL)
                other.wait_for_job(first)
                cls.reference = Outcome(other, first, "normal")
                expect(cls.reference.means[0] > 0.001, "a black picture")
        expect(outcome.bits == cls.reference.bits, what + ": the picture differs")


def text_of(farm, number):
    return farm.cli("show", number, expect=0).out


# ---- workers -------------------------------------------------------------------------------

@tests.add
def only_worker_killed():
    """the only worker dies: the job waits and says why, nothing is blackened, a new one ends it"""
    long_job = LongJob(1.0 if not SLOW else 3.0, "129x97")
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        farm.wait_for_workers(1)
        long_job.measure(farm)
        number = long_job.submit(farm)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")
        number = long_job.submit(farm)
        wait_mid_frame(farm, number)
        farm.workers[0].kill()
        farm.wait_for_workers(0)
        job = farm.job(number)
        expect(job["state"] == "running" and job["workers"] == 0, job)
        expect("no worker is connected" in job["state_text"], job)
        expect("no worker is connected" in text_of(farm, number), text_of(farm, number))
        expect(farm.cli("watch", number, "--limit", "0.5").code == 7, "watch did not wait")
        expect(farm.cli("fetch", number, "-o", "early").code == 5, "an unfinished picture is out")
        expect(farm.job(number)["samples_done"] == job["samples_done"], "samples from nowhere")
        farm.start_worker()
        expect(farm.cli("watch", number, limit_s=300).code == 0, "watch")
        outcome = Outcome(farm, number, "end")
        expect(outcome.black_tiles == reference.black_tiles, "black tiles")
        expect_same(farm, outcome, reference, "after the only worker's death")


@tests.add
def wrong_keys():
    """a client with another farm's key exits with 5 and says so, a worker with it says so and does not join"""
    with Farm() as farm:
        farm.start_coordinator()
        other = farm.path("other.key")
        farm.cli("keygen", "-o", other, expect=0)
        stranger = farm.start_worker(key=other)
        wait_for(lambda: "another farm" in stranger.log_text(), "the worker to say so")
        result = farm.cli("submit", farm.scene(), key=other)
        expect(result.code == 5 and "another farm" in result.err and farm.address in result.err,
               result)
        wait_for(lambda: "not of this farm" in farm.coordinator.log_text(), "the coordinator to say so")
        expect(farm.list_workers() == [] and stranger.alive(), "a stranger joined, or ended")
        farm.start_worker()
        Normal.check(farm, "after strangers")


@tests.add
def isa_that_does_not_fit():
    """a worker without a job's instruction set gets none of it, is told why, and so is everybody who asks"""
    with Farm() as farm:
        farm.start_coordinator()
        weak = farm.start_worker("--isa", "sse2")
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), *SMALL)  # pinned to avx2
        wait_for(lambda: "avx2" in weak.log_text(), "the worker to be told")
        told = [l for l in weak.log_text().splitlines() if "avx2" in l]
        expect(len(told) == 1 and "no work of job %d" % number in told[0], told)
        note = worker_of(farm, weak)["note"]
        expect("avx2" in note and "job %d" % number in note, note)
        expect("avx2" in farm.cli("workers", expect=0).out, "workers")
        expect(re.search("note .*waits.*avx2", text_of(farm, number)), text_of(farm, number))
        # A job for it goes through, although the other is before it in the queue.
        other = farm.submit(farm.scene(), *SMALL, "--isa", "sse2")
        farm.wait_for_job(other)
        job = farm.job(number)
        expect(job["state"] == "queued" and job["samples_done"] == 0, job)
        with open("/proc/cpuinfo") as source:
            if not re.search(r"\bavx2\b", source.read()):
                raise Skip("this CPU has no avx2: the job cannot be finished here")
        strong = farm.start_worker()
        farm.wait_for_job(number)
        expect(worker_of(farm, weak)["units_done"] == worker_of(farm, strong)["units_done"],
               "each has done one of two jobs of equal size: %s" % farm.list_workers())
        result = farm.start_worker("--isa", "mmx")
        expect(result.wait(20) == 2 and "mmx" in result.log_text(), result.log_text())


@tests.add
def broken_job():
    """a job that no worker can render fails with the worker's words; one that others can render goes on"""
    with Farm() as farm:
        farm.start_coordinator()
        peer = OddPeer(farm)
        peer.say("request 2")
        number = farm.submit(farm.scene(), *SMALL)
        peer.grant()
        peer.say("broken code=4")  # ERR_INPUT: the scene's fault
        job = farm.wait_for_job(number, "failed")
        expect("the odd peer cannot" in job["state_text"], job)
        result = farm.cli("watch", number)
        expect(result.code == 6 and "the odd peer cannot" in result.err, result)
        expect(farm.cli("fetch", number).code in (5, 6), "a picture of a failed job")
        peer.end()
        # With another worker there, the job is the other's.
        peer = OddPeer(farm)
        farm.start_worker()
        farm.wait_for_workers(2)
        peer.say("request 1")
        number = farm.submit(farm.scene(), "--size", "256x256", "--spp", "64")
        expect(peer.grant()["job"] == number, "another job")
        peer.say("broken code=4")
        farm.wait_for_job(number)
        Normal.check(farm, "after a broken job")


@tests.add
def kernel_that_does_not_fit():
    """two versions of the ray tracing kernel are never mixed in a job, and one that died without a result binds nobody"""
    with Farm() as farm:
        farm.start_coordinator()
        peer = OddPeer(farm, hello="kernel=other-kernel-9")
        peer.say("request 2")
        number = farm.submit(farm.scene(), *SMALL)
        peer.grant()
        honest = farm.start_worker()
        wait_for(lambda: "other-kernel-9" in honest.log_text(), "the worker to be told")
        expect("other-kernel-9" in worker_of(farm, honest)["note"], farm.list_workers())
        expect(worker_of(farm, honest)["units_done"] == 0, "kernels were mixed")
        peer.kill()  # without a result: the job is as good as new
        farm.wait_for_job(number)
        first = Outcome(farm, number, "first")
        # The other way round: the job is in work by one kernel, so the other gets nothing of it.
        number = farm.submit(farm.scene(), "--size", "96x96", "--spp", "100000")
        wait_mid_frame(farm, number, 0.001)
        peer = OddPeer(farm, hello="kernel=other-kernel-9")
        peer.say("request 2")
        expect("no work of job %d" % number in peer.wait_line("notice "), "not told")
        honest.kill()
        job = wait_for(lambda: (lambda j: j if j["state_text"] else None)(farm.job(number)), "words")
        expect("other-kernel-9" in job["state_text"] and "embree" in job["state_text"], job)
        farm.cli("cancel", number, expect=0)
        peer.end()
        farm.start_worker()
        Normal.check(farm, "after two kernels")
        expect(first.bits == Normal.reference.bits, "the picture differs")


# ---- peers that break the rules ------------------------------------------------------------

def expect_failure(peer, words):
    """The coordinator answers with a Failure that has these words, and ends the connection in order."""
    said = peer.wait_line("failure ")
    expect(re.search(words, said), "'%s' is not in '%s'" % (words, said))
    peer.wait_line("ended")
    peer.wait(20)


@tests.add
def hellos_that_do_not_fit():
    """another version, arithmetic, role or a senseless Hello is refused with words that help"""
    with Farm() as farm:
        farm.start_coordinator()
        cases = [("worker", "version=999", "version 999.*version 5.*same release"),
                 ("client", "version=0", "version 0"),
                 ("worker", "arithmetic=1", "arithmetic.*same release"),
                 ("worker", "role=2", "key|role"), ("client", "role=1", "key|role"),
                 ("worker", "role=0", "key|role"), ("client", "role=77", "key|role"),
                 ("worker", "threads=0", "threads"), ("worker", "threads=4294967295", "threads"),
                 ("worker", "kernel=", "ray tracer"), ("worker", "kernel=" + "x" * 5000, "ray tracer")]
        for role, changes, words in cases:
            peer = OddPeer(farm, role, hello=None)
            peer.say("hello " + changes)
            expect_failure(peer, words)
        for role, first in (("client", "query 0"), ("worker", "request 1"), ("client", "heartbeat")):
            peer = OddPeer(farm, role, hello=None)
            peer.say(first)
            expect_failure(peer, "first message must be a Hello")
        expect(farm.list_workers() == [], "one of them joined")
        farm.start_worker()
        Normal.check(farm, "after odd greetings")


@tests.add
def messages_of_another_role():
    """a worker may not act as a client, nor a client as a worker; unknown scenes and jobs are refused"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        for role, line in (("worker", "query 0"), ("worker", "cancel %d" % number),
                           ("worker", "workers"), ("worker", "submit " + "00" * 32),
                           ("client", "request 9"), ("worker", "hello"), ("client", "hello")):
            peer = OddPeer(farm, role)
            peer.say(line)
            expect_failure(peer, "code=refused: a %s may not send" % role)
        peer = OddPeer(farm, "client")
        for line, words in (("submit " + "ab" * 32, "not found.*scene|scene.*"),
                            ("submit 1234", "scene"), ("query 99", "no job 99"),
                            ("cancel 99", "no job 99")):
            peer.say(line)
            said = peer.wait_line("failure ")
            expect(re.search(words, said), said)
        peer.say("query 0")
        expect(peer.wait_line("jobs ") == "1", "the connection, or the list, suffered")
        peer.end()
        expect(farm.job(number)["state"] == "queued", "a worker cancelled a job")
        farm.start_worker()
        Normal.check(farm, "after messages of another role")


@tests.add
def garbage():
    """garbage in and under the TLS stream ends that connection and nothing else"""
    chance = random.Random(20240229)
    with Farm() as farm:
        farm.start_coordinator()
        for data in (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\0" * 100000, b"\xff" * 100000,
                     chance.randbytes(65536), b"\x16\x03\x01\x00\x05hello", b"\x16\x03\x03\xff\xff" +
                     chance.randbytes(70000)):
            talk_raw(farm, data)
        host, port = farm.address.rsplit(":", 1)
        crowd = [socket.create_connection((host, int(port))) for _ in range(200)]
        farm.cli("list", expect=0)  # served while all of them wait
        for n, peer in enumerate(crowd):
            if n % 2:  # a reset instead of an end
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            peer.close()
        for hello in (None, ""):
            for role in ("worker", "client"):
                for line, words in (("raw 00000000", "message of 0 bytes"),
                                    ("raw ffffffff", "message of 4294967295 bytes"),
                                    ("raw 01004000" + "aa" * 100, "message of 4194305 bytes"),
                                    ("raw 04000000ffffffff", "code="),
                                    ("raw 0800000012ffffffff7f0102", "code="),
                                    ("raw 020000007a00", "")):  # a field of a later version
                    peer = OddPeer(farm, role, hello)
                    peer.say(line)
                    expect_failure(peer, words)
                peer = OddPeer(farm, role, hello)
                peer.say("tcp " + chance.randbytes(2000).hex())  # damaged TLS records
                wait_for(lambda: not peer.alive() or None, "the end of a damaged connection")
                peer = OddPeer(farm, role, hello)
                peer.say("raw 10000000aabb")  # half a message, then nobody is there any more
                peer.kill()
        wait_for(lambda: farm.list_workers() == [], "all of them to be gone")
        expect(farm.coordinator.alive(), "the coordinator died")
        farm.start_worker()
        Normal.check(farm, "after garbage")


@tests.add
def results_that_break_the_rules():
    """results out of range, of the wrong size, not finite, never lent or unknown change nothing"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        violations = ["tile=16", "tile=4294967295", "group=2", "group=4294967295", "samples=0",
                      "rays=18446744073709551615", "pass=1", "pass=4294967295", "floats=0",
                      "floats=1535", "floats=1537", "floats=500000", "fill=nan", "fill=inf",
                      "fill=-inf", "epoch=0", "epoch=18446744073709551615", "tile=16 floats=0"]
        unwanted = ["job=4242", "job=0", "frame=77", "frame=4294967295", "epoch=1", "job=4242 tile=99"]
        for place, changes in enumerate(violations):
            peer = OddPeer(farm, hello="host=machine-%d" % place)  # each is blocked by name
            peer.say("request 1")
            peer.grant()
            peer.say("result " + changes)
            expect_failure(peer, "code=protocol violation")
            expect(farm.coordinator.alive(), "the coordinator died of " + changes)
        peer = OddPeer(farm)
        peer.say("request 1")
        lease = peer.grant()["lease"]
        for changes in unwanted:
            peer.say("result " + changes)
            expect(peer.wait_line("revoke ").split()[0] == "lease=%d" % lease, changes)
        job = farm.job(number)
        expect(job["samples_done"] == 0 and job["conflicts"] == 0, job)
        peer.end()
        farm.start_worker()
        farm.wait_for_job(number)
        first = Outcome(farm, number, "first")
        Normal.check(farm, "after bad results")
        expect(first.bits == Normal.reference.bits, "a bad result is in the picture")


@tests.add
def result_that_differs():
    """a result that differs from the one merged before is counted and logged, and the first is kept"""
    long_job = LongJob(1.0 if not SLOW else 3.0, "129x97")
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker()
        farm.wait_for_workers(1)
        long_job.measure(farm)
        number = long_job.submit(farm)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")
        farm.workers[0].kill()
        farm.wait_for_workers(0)

        peer = OddPeer(farm, hello="threads=4")
        peer.say("request 2")
        number = long_job.submit(farm)
        grant = peer.grant()
        expect(len(grant["units"]) == 2, grant)
        # One unit goes back and is rendered by an honest worker first of all, while the peer keeps the
        # lease by its other unit.
        peer.say("return unit=0")
        peer.say("mute")
        worker = farm.start_worker()
        wait_for(lambda: (worker_of(farm, worker) or {"units_done": 0})["units_done"] >= 8,
                 "the honest worker to render it")
        worker.signal(signal.SIGSTOP)  # nothing else happens to the job now
        before = farm.job(number)
        expect(before["state"] == "running" and before["conflicts"] == 0, before)
        for count in (1, 2):
            peer.say("result unit=0 fill=0.5")
            expect(peer.wait_line("ack ").endswith("units=%d:%d:%d" % grant["units"][0]), "ack")
            job = farm.job(number)
            expect(job["conflicts"] == count and job["samples_done"] == before["samples_done"], job)
        expect("differs from the one merged before" in farm.coordinator.log_text(), "not logged")
        line = [l for l in farm.coordinator.log_text().splitlines() if "differs from" in l][-1]
        names = re.search(r"\((\S+), process \d+, .*came from session \d+ \((\S+), process (\d+)\)", line)
        expect(names and names.group(1) == "odd" and int(names.group(3)) == worker.pid,
               "it does not name both: " + line)
        peer.end()
        worker.signal(signal.SIGCONT)
        farm.wait_for_job(number)
        expect(farm.job(number)["conflicts"] == 2, "the count is lost")
        expect(re.search("conflict|differ", text_of(farm, number), re.I), "show hides it: " +
               text_of(farm, number))
        # The picture is the honest one.
        files = [f for f in farm.fetch(number, "end") if f.endswith(".exr")]
        farm.cli("compare", files[0], reference.exrs[0], expect=0)


@tests.add
def result_twice():
    """the same result twice is acknowledged twice and counted once"""
    with Farm() as farm:
        farm.start_coordinator()
        peer = OddPeer(farm, hello="threads=8")
        peer.say("request 2")
        number = farm.submit(farm.scene(), *SMALL)
        unit = "units=%d:%d:%d" % peer.grant()["units"][0]
        for fill, conflicts in (("0.5", 0), ("0.5", 0), ("0.5", 0), ("0.75", 1)):
            peer.say("result fill=" + fill)
            expect(peer.wait_line("ack ").endswith(unit), "ack")
            job = farm.job(number)
            expect(job["samples_done"] == 16 * 16 * 2 and job["conflicts"] == conflicts, job)
        farm.cli("cancel", number, expect=0)
        peer.wait_line("revoke ")
        peer.say("result fill=0.5")  # of a job that is over
        peer.wait_line("revoke ")
        peer.end()
        farm.start_worker()
        Normal.check(farm, "after duplicates")


@tests.add
def stalled_peers():
    """peers that connect and say nothing, or fall silent with work in hand, are dropped; others work on"""
    with Farm() as farm:
        farm.start_coordinator()
        host, port = farm.address.rsplit(":", 1)
        silent = socket.create_connection((host, int(port)))      # no TLS
        handshake = socket.create_connection((host, int(port)))   # a little TLS
        handshake.sendall(b"\x16\x03\x01\x02")
        unpolite = OddPeer(farm, hello=None)                       # no Hello
        unpolite.say("mute")
        mute = OddPeer(farm, hello="threads=16")                   # no heartbeats, 16 units
        mute.say("request 16")
        number = farm.submit(farm.scene(), *SMALL)
        expect(len(mute.grant()["units"]) > 1, "no work")
        mute.say("mute")
        farm.start_worker()
        farm.wait_for_job(number, limit_s=30)  # overdue work goes to the other long before the silence ends
        expect(mute.alive(), "it was dropped before")
        Normal.check(farm, "beside stalled peers")
        for peer in (silent, handshake):
            peer.settimeout(60 * PATIENCE)
            expect(peer.recv(1) == b"" or peer.recv(1000) is not None, "not closed")
            peer.close()
        unpolite.wait_line("lost", 60)
        mute.wait_line("lost", 60)
        expect("silent for" in farm.coordinator.log_text(), farm.coordinator.log_text())
        expect(len(farm.list_workers()) == 1, "it is still listed")
        Normal.check(farm, "after stalled peers")


# ---- one coordinator, one port, one store --------------------------------------------------

def coordinator_alone(farm, *options, limit_s=20):
    """Run a coordinator that must end by itself; its exit status and words."""
    done = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--key", farm.key] +
                          list(options), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, timeout=limit_s * PATIENCE, cwd=farm.folder)
    return done.returncode, done.stderr.decode("utf-8", "replace")


@tests.add
def port_and_store_in_use():
    """a second coordinator on the same port or store says what is in its way, and harms nobody"""
    with Farm() as farm:
        farm.start_coordinator()
        port = farm.address.rsplit(":", 1)[1]
        code, words = coordinator_alone(farm, "--listen", farm.address, "--store", farm.path("two"))
        expect(code == 8 and farm.address in words and "in use" in words and "--listen" in words,
               (code, words))
        code, words = coordinator_alone(farm, "--listen", "127.0.0.1:0", "--store", farm.store)
        expect(code == 5 and farm.store in words and str(farm.coordinator.pid) in words, (code, words))
        code, words = coordinator_alone(farm, "--listen", "192.0.2.1:" + port, "--store",
                                        farm.path("three"))
        expect(code == 8 and "192.0.2.1" in words, (code, words))
        farm.start_worker()
        Normal.check(farm, "after rivals")
        farm.coordinator.kill()
        farm.restart_coordinator()  # a lock that a killed one left is no lock
        farm.wait_for_workers(1)
        Normal.check(farm, "after a restart")


@tests.add
def unusable_stores():
    """a store that cannot be made, is no store, or is damaged is named, and the exit status is 8"""
    with Farm() as farm:
        with open(farm.path("file"), "w") as out:
            out.write("not a folder")
        os.mkdir(farm.path("foreign"))
        with open(farm.path("foreign", "queue.sqlite"), "wb") as out:
            out.write(b"this is no data base" * 1000)
        for store in (farm.path("file"), farm.path("file", "below"), "/proc/azulejo", farm.path("foreign")):
            code, words = coordinator_alone(farm, "--listen", "127.0.0.1:0", "--store", store)
            expect(code == 8 and os.path.basename(store) in words, (store, code, words))
            expect(words.count("\n") <= 2, words)


@tests.add
def signals():
    """SIGTERM and SIGINT end coordinator and worker with 0, idle or waiting for each other"""
    with Farm() as farm:
        for number in (signal.SIGTERM, signal.SIGINT):
            farm.start_coordinator()
            worker = farm.start_worker()
            farm.wait_for_workers(1)
            for program in (worker, farm.coordinator):
                program.signal(number)
                code = program.wait(30)
                expect(code == 0, "%s: exit status %d\n%s" % (program.label, code,
                                                               program.log_text()))
            lonely = farm.start_worker()  # nobody listens there any more
            wait_for(lambda: "trying again" in lonely.log_text(), "the worker to find nobody")
            lonely.signal(number)
            expect(lonely.wait(30) == 0, lonely.log_text())
        farm.start_coordinator()
        worker = farm.start_worker("--exit-on-disconnect")
        farm.wait_for_workers(1)
        farm.coordinator.stop()
        expect(worker.wait(30) in (0, 4), worker.log_text())


# ---- disks ---------------------------------------------------------------------------------

@tests.add
def full_disk_of_the_client():
    """a disk that is full or a folder that cannot be: fetch and render say so, and lose nothing"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        with open(farm.path("file"), "w") as out:
            out.write("x")
        for folder in (farm.path("file"), farm.path("file", "below"), "/proc/below"):
            result = farm.cli("fetch", number, "-o", folder)
            expect(result.code == 8 and folder in result.err, result)
            result = farm.cli("render", farm.scene(), *SMALL, "-o", folder + "/x")
            expect(result.code == 8 and folder in result.err, result)
        with SmallDisk(farm, 16384) as disk:
            if disk is None:
                print("# mounting is not permitted: only folders that cannot be are tested here")
            else:
                fill_up(os.path.join(disk, "filler"))
                result = farm.cli("fetch", number, "-o", disk)
                expect(result.code == 8 and disk in result.err and "space" in result.err.lower(), result)
                expect(os.listdir(disk) == ["filler"], os.listdir(disk))
                temporary = farm.path("tmp")
                os.mkdir(temporary)
                result = farm.cli("render", farm.scene(), *SMALL, "-o", disk + "/x", "--workers", "1",
                                  env={"TMPDIR": temporary})
                expect(result.code == 8 and "space" in result.err.lower(), result)
                expect(os.listdir(disk) == ["filler"], os.listdir(disk))
                # What was rendered is not thrown away: the message says where it is.
                kept = re.search(r"kept in (.+)", result.err)
                expect(kept and sorted(os.listdir(kept.group(1))) == ["x.exr", "x.png"], result)
                shutil.rmtree(temporary)
        outcome = Outcome(farm, number, "elsewhere")  # nothing is lost
        expect(outcome.means[0] > 0.001, "black")


@tests.add
def full_disk_of_the_coordinator():
    """the store's disk is full: the coordinator says so and lives, and no wrong picture comes out"""
    with Farm() as farm, SmallDisk(farm, 8 << 20) as disk:
        if disk is None:
            raise Skip("mounting is not permitted: no full disk here")
        farm.store = os.path.join(disk, "store")
        farm.start_coordinator()
        farm.start_worker()
        Normal.check(farm, "before the disk is full")
        # Its film has 12 MiB and more: it fits no such disk.
        number = farm.submit(farm.scene(), "--size", "512x512", "--spp", "1", "--force")

        def stuck():
            job = farm.job(number)
            return job if job["state"] == "failed" or "space" in job["state_text"] else None
        job = wait_for(stuck, "the coordinator to find its disk full", 120)
        expect("space" in job["state_text"].lower(), job)
        expect(farm.coordinator.alive(), "the coordinator died")
        farm.cli("cancel", number, "--discard")  # without it, its film would wait for room
        farm.wait_for_workers(1)
        wait_for(lambda: farm.coordinator.log_text().count("can be used again") ==
                 farm.coordinator.log_text().count("cannot be used"), "the store to work")
        Normal.check(farm, "after a full disk")


@tests.add
def disk_full_at_the_end():
    """a disk that fills up in mid-frame costs no work: the picture is written when there is room again"""
    options = ["--size", "128x128", "--spp", "120"]
    with Farm() as farm, SmallDisk(farm, 32 << 20) as disk:  # films of finished frames stay
        if disk is None:
            raise Skip("mounting is not permitted: no full disk here")
        farm.store = os.path.join(disk, "store")
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *options)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")
        filler = os.path.join(disk, "filler")
        for restart in (False, True):
            number = farm.submit(farm.scene(), *options)
            wait_mid_frame(farm, number, 0.25)
            fill_up(filler)
            job = wait_for(lambda: (lambda j: j if "trying again" in j["state_text"] else None)(
                farm.job(number)), "the job to find no room", 120)
            expect(job["state"] == "running" and job["samples_done"] > 0, job)
            expect("No space left" in job["state_text"], job)
            if restart:
                farm.coordinator.stop()
                fill_up(filler)  # the database's log went as it was closed
                farm.restart_coordinator()
                job = farm.job(number)
                expect(job["state"] == "running" and "cannot be used" in job["state_text"], job)
                expect(job["samples_done"] > 0, job)
            os.unlink(filler)
            farm.wait_for_job(number)
            expect_same(farm, Outcome(farm, number, "end-%d" % number), reference,
                        "after a full disk", counts=False)


# ---- files ---------------------------------------------------------------------------------

def make_glb(gltf_path, path):
    """The .gltf as one .glb: its JSON as it is, no binary chunk."""
    text = read_bytes(gltf_path)
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as out:
        out.write(struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON")
                  + text)


def make_hdr(path, width=32, height=16):
    with open(path, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        out.write(bytes([100, 120, 140, 129]) * (width * height))


@tests.add
def damaged_files():
    """missing or truncated scenes, textures and light maps are refused, and the file is named"""
    with Farm() as farm:
        spheres = farm.path("spheres")
        shutil.copytree(os.path.dirname(SPHERES), spheres)
        name = os.path.join(spheres, os.path.basename(SPHERES))
        sky = farm.path("sky.exr")
        subprocess.run([os.path.join(BIN, "scenes", "sky", "make_sky"), "--size", "64x32", "-o", sky],
                       check=True, stdout=subprocess.DEVNULL)
        make_hdr(farm.path("sky.hdr"))
        make_glb(farm.scene(), farm.path("tiny.glb"))
        tiny = ["--size", "16x16", "--spp", "1"]
        uris = [i["uri"] for i in json.loads(read_bytes(name))["images"]]
        # Whole, all of them are fine.
        for scene, env in ((name, None), (farm.path("tiny.glb"), None), (farm.scene(), sky),
                           (farm.scene(), farm.path("sky.hdr"))):
            farm.cli("render", scene, *tiny, "-o", "whole.exr", *(["--env", env] if env else []), expect=0)
        cases = [(name, None, os.path.join(spheres, uri)) for uri in uris]
        cases += [(name, None, os.path.join(spheres, "textured-spheres.bin")),
                  (farm.path("tiny.glb"), None, farm.path("tiny.glb")),
                  (farm.scene(), sky, sky), (farm.scene(), farm.path("sky.hdr"), farm.path("sky.hdr"))]
        temporary = farm.path("tmp")
        os.mkdir(temporary)
        for scene, env, victim in cases:
            whole = read_bytes(victim)
            extra = ["--env", env] if env else []
            for share in (None, 0.0, 0.5, 0.97):
                if share is None:
                    os.unlink(victim)
                else:
                    with open(victim, "wb") as out:
                        out.write(whole[:int(len(whole) * share)])
                what = "%s, %s of it" % (os.path.basename(victim), share)
                for command in (["import", scene, "--strict"], ["render", scene, *tiny, "--strict", "-o", "bad", *extra]):
                    if command[0] == "import" and env:
                        continue
                    result = farm.cli(*command, env={"TMPDIR": temporary})
                    expect(result.code == 3 and os.path.basename(victim) in result.err,
                           "%s: %s" % (what, result))
                expect(not os.path.exists(farm.path("bad.exr")), "a picture: " + what)
                expect(os.listdir(temporary) == [], "a folder was left: " + what)
            with open(victim, "wb") as out:
                out.write(whole)


# ---- nothing is left behind ----------------------------------------------------------------

def processes_with(mark):
    """Living processes that have this in their environment."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open("/proc/%s/environ" % entry, "rb") as source:
                    if mark.encode() in source.read():
                        found.append(int(entry))
            except OSError:
                pass
    return found


def program_of(pid):
    try:
        with open("/proc/%d/cmdline" % pid, "rb") as source:
            return os.path.basename(source.read().split(b"\0")[0].decode())
    except OSError:
        return ""


@tests.add
def nothing_left_behind():
    """`azulejo render` leaves no process and no folder: after its end, SIGINT, SIGTERM, or a death inside"""
    with Farm() as farm:
        temporary = farm.path("tmp")
        os.mkdir(temporary)
        env = {"TMPDIR": temporary}
        mark = "TMPDIR=" + temporary
        endless = ["render", farm.scene(), "--size", "512x512", "--spp", "1000000", "--workers", "2",
                   "-o", "endless"]
        dying = endless[:-1] + ["dying"]

        def check(what):
            wait_for(lambda: processes_with(mark) == [], what + ": processes are left")
            expect(os.listdir(temporary) == [], "%s: left: %s" % (what, os.listdir(temporary)))

        farm.cli("render", farm.scene(), *SMALL, "-o", "good", env=env, expect=0)
        check("after a normal end")

        def named(count, name):
            pids = [p for p in processes_with(mark) if program_of(p) == name]
            return pids if len(pids) >= count else None

        # Interrupted at several moments: as soon as the client, the coordinator, a worker is there.
        for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
            for count, name in ((1, "azulejo-coordinator"), (1, "azulejo-worker"), (2, "azulejo-worker")):
                client = farm.start_cli(*endless, env=env)
                try:
                    wait_for(lambda: named(count, name), name)
                    client.send_signal(number)
                    out, err = client.communicate(timeout=60 * PATIENCE)
                finally:
                    client.kill()
                    client.wait()
                expect(client.returncode == code, (name, client.returncode, out, err))
                check("after %s when %d %s ran" % (number.name, count, name))
        for victims, name in ((2, "azulejo-worker"), (1, "azulejo-coordinator")):
            client = farm.start_cli(*dying, env=env)
            try:
                for pid in wait_for(lambda: named(victims, name), name):
                    os.kill(pid, signal.SIGKILL)
                out, err = client.communicate(timeout=60 * PATIENCE)
            finally:
                client.kill()
                client.wait()
            expect(client.returncode == 6 and name.replace("azulejo-", "") in err.decode(),
                   (client.returncode, out, err))
            check("after the death of every " + name)
        expect(not os.path.exists(farm.path("dying.exr")), "a picture of a job that never ended")


if __name__ == "__main__":
    tests.run()
