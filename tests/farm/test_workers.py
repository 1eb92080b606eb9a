"""Workers that people and machines hold back: names, drain and block, pauses, what is kept of those that left."""
import ctypes
import os
import re
import signal
import socket
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import ROOT, Failure, Farm, Skip, Tests, wait_for
from jobs import LongJob, Outcome, expect, expect_same, wait_mid_frame
from odd import FarAway, OddPeer

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]  # 16 units
ENDLESS = ["--size", "128x128", "--spp", "1000000"]
HOST = re.sub(r"[^A-Za-z0-9._-]", "-", socket.gethostname())


def named(farm, name):
    """The connected worker of that name; None."""
    found = [w for w in farm.list_workers() if w["name"] == name]
    expect(len(found) < 2, "two workers have the name %s" % name)
    return found[0] if found else None


def wait_state(farm, name, state, limit_s=60):
    def look():
        worker = named(farm, name)
        return worker if worker and worker["state"] == state else None
    return wait_for(look, "worker %s to be %s (%s)" % (name, state, named(farm, name)), limit_s)


def gone(farm, name):
    return [w for w in farm.cli("workers", "--gone", "--json", expect=0).json()["gone"]
            if w["name"] == name]


@tests.add
def names():
    """names are given, wished for, unique, and survive the coordinator and the connection"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        wait_for(lambda: named(farm, HOST), "the host's name")
        farm.start_worker()
        wait_for(lambda: named(farm, HOST + "-2"), "a number")
        farm.start_worker("--name", "render.7")
        wait_for(lambda: named(farm, "render.7"), "a name that was chosen")
        pids = {w["name"]: w["process"] for w in farm.list_workers()}
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_workers(3)
        expect({w["name"]: w["process"] for w in farm.list_workers()} == pids, "other names")
        # A second one waits, says why, and joins when the first has left.
        second = farm.start_worker("--name", "render.7")
        wait_for(lambda: "belongs to a worker that is connected already" in second.log_text(), "a reason")
        expect(second.alive() and named(farm, "render.7")["process"] == pids["render.7"], "it was replaced")
        farm.workers[2].kill()
        wait_for(lambda: (named(farm, "render.7") or {}).get("process") == second.pid, "the second one", 90)
        # The free number is given again.
        farm.workers[0].stop()
        third = farm.start_worker()
        wait_for(lambda: (named(farm, HOST) or {}).get("process") == third.pid, "the free name")
        for bad in ("", "a b", "x" * 64, "w*", "-x"):
            worker = farm.start_worker("--name=" + bad)
            expect(worker.wait() == 2 and "--name" in worker.log_text(), bad)


@tests.add
def the_same_process_again():
    """a process that connects again before its old connection is lost keeps its name, and its units are free"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        old = OddPeer(farm, hello="host=odd instance=77 threads=16")
        old.say("request 16")
        expect(len(old.grant()["units"]) == 16, "not all")
        new = OddPeer(farm, hello="host=odd instance=77 threads=16 name=odd")
        old.wait_line("ended")
        expect([w["name"] for w in farm.list_workers()] == ["odd"], farm.list_workers())
        new.say("request 16")
        expect(len(new.grant()["units"]) == 16, "they are still lent")
        other = OddPeer(farm, hello="host=odd instance=78 name=odd")
        expect(sorted(w["name"] for w in farm.list_workers()) == ["odd", "odd-2"], farm.list_workers())
        expect(other.alive() and farm.job(number)["state"] == "running", "running")


@tests.add
def drain_and_resume():
    """drain: it finishes what it has and gets no more, over lost connections; resume ends it; its process's end, too"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "a")
        farm.start_worker("--name", "b")
        farm.wait_for_workers(2)
        number = farm.submit(farm.scene(), *ENDLESS)
        wait_state(farm, "a", "working")
        wait_state(farm, "b", "working")
        out = farm.cli("workers", "drain", "a", expect=0).out
        expect(re.match("worker a: drain(ing|ed)", out), out)
        worker = wait_state(farm, "a", "drained")
        expect("drained by " in worker["note"] and worker["units_leased"] == 0, worker)
        expect("worker a: drained by " in farm.coordinator.log_text(), "the log")
        wait_for(lambda: "drained by" in farm.workers[0].log_text(), "the worker's log")
        farm.cli("workers", "drain", "a", expect=0)  # nothing changes
        done = named(farm, "b")["units_done"]
        wait_for(lambda: named(farm, "b")["units_done"] > done, "the other one to go on")
        expect(named(farm, "a")["units_done"] == worker["units_done"], "it works")
        farm.coordinator.kill()
        farm.restart_coordinator()
        wait_state(farm, "b", "working")
        # It may send again what was not on disk when the coordinator was killed, and no more.
        worker = wait_state(farm, "a", "drained")
        again = int(re.findall(r"(\d+) results? to send again", farm.workers[0].log_text())[-1])
        expect(worker["units_done"] <= again, "it worked: %s, %d sent again" % (worker, again))
        out = farm.cli("workers", "resume", "a", expect=0).out
        expect(out.startswith("worker a: "), out)
        wait_state(farm, "a", "working")
        # Both: the job says what it waits for.
        out = farm.cli("workers", "drain", "*")
        expect(out.code == 2 and "--yes" in out.err, out)
        farm.cli("workers", "drain", "*", "--yes", expect=0)
        wait_state(farm, "a", "drained")
        wait_state(farm, "b", "drained")
        wait_for(lambda: "no worker takes work" in farm.job(number)["state_text"], "the reason")
        result = farm.cli("workers", "drain", "*", "--yes")
        expect(result.code == 5 and "can be drained" in result.err, result)
        # A new process of that name works. The old one ends when its results are on disk; those of later passes wait for
        # earlier ones, which only the other worker renders now.
        farm.cli("workers", "resume", "b", expect=0)
        wait_state(farm, "b", "working")
        farm.workers[0].stop()
        farm.start_worker("--name", "a")
        wait_state(farm, "a", "working")


@tests.add
def block_and_unblock():
    """block: its work goes to others at once; restarts of both change nothing; unblock ends it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "a")
        farm.wait_for_workers(1)
        long = LongJob(0.6, "129x97")
        long.measure(farm)
        reference = long.submit(farm)
        farm.wait_for_job(reference)
        number = long.submit(farm)
        wait_mid_frame(farm, number)
        farm.cli("workers", "block", "a", expect=0)
        worker = wait_state(farm, "a", "blocked")
        expect(worker["units_leased"] == 0 and "blocked by " in worker["note"], worker)
        for verb, remedy in (("drain", "unblock"), ("resume", "unblock")):
            result = farm.cli("workers", verb, "a")
            expect(result.code == 5 and remedy in result.err, result)
        farm.cli("workers", "block", "a", expect=0)
        farm.cli("workers", "block", "nobody", expect=0)
        farm.coordinator.kill()
        farm.workers[0].kill()
        farm.restart_coordinator()
        farm.start_worker("--name", "a")
        wait_state(farm, "a", "blocked")
        expect("nobody" in farm.cli("workers", expect=0).out, "a blocked name is not shown")
        expect(farm.job(number)["state_text"].startswith("waits: no worker takes work"), farm.job(number))
        farm.cli("workers", "unblock", "*", "--yes", expect=0)
        farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "blocked"), Outcome(farm, reference, "reference"), "blocked")
        expect(farm.cli("workers", "--json", expect=0).json()["marks"] == [], "still blocked")
        result = farm.cli("workers", "unblock", "nobody")
        expect(result.code == 5 and "nobody" in result.err, result)
        for words in (["drain"], ["hold", "a"], ["show", "a", "b"], ["show", "a", "--gone"]):
            expect(farm.cli("workers", *words).code == 2, words)


@tests.add
def those_that_left():
    """what they did, why they left and their last lines are kept, also by a coordinator that was killed"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "a")
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        farm.workers[0].stop()
        left = wait_for(lambda: gone(farm, "a"), "it to leave")
        expect(len(left) == 1 and left[0]["why"] == "it ended: SIGTERM", left)
        expect(left[0]["units_done"] == 32 and left[0]["samples_done"] == 64 * 64 * 4 and
               left[0]["core_seconds"] > 0 and left[0]["process"] == farm.workers[0].pid, left)
        farm.start_worker("--name", "a")
        farm.wait_for_workers(1)
        farm.workers[1].kill()
        wait_for(lambda: len(gone(farm, "a")) == 2, "the second to leave")
        farm.coordinator.kill()
        farm.restart_coordinator()
        rows = gone(farm, "a")
        expect(len(rows) == 2 and rows[1]["why"] == left[0]["why"] and
               rows[1]["units_done"] == 32, rows)
        expect("the connection was lost" in rows[0]["why"], rows)
        text = farm.cli("workers", "show", "a", expect=0).out
        expect("SIGTERM" in text and "finishing units in progress" in text and "joins from" in text, text)
        expect("it ended: SIGTERM" in farm.cli("workers", "--gone", expect=0).out, "the table")
        expect(farm.cli("workers", "show", "nobody").code == 5, "nobody")
        # One row for a process, however often it connects; what the killed coordinator saw counts, too.
        farm.start_worker("--name", "c")
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        farm.start_worker("--name", "d")
        farm.wait_for_workers(2)
        farm.coordinator.stop()
        farm.workers[3].kill()
        farm.restart_coordinator()
        farm.wait_for_workers(1)
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        expect(gone(farm, "c") == [], "it is there")
        expect([row["why"] for row in gone(farm, "d")] == ["the coordinator ended"], gone(farm, "d"))
        farm.workers[2].stop()
        row = wait_for(lambda: gone(farm, "c"), "c to leave")
        expect(len(row) == 1 and row[0]["connections"] == 2 and row[0]["units_done"] == 64, row)


@tests.add
def what_is_told():
    """`workers`, its JSON and `show` have state, job, threads, processors, memory and cache"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "a", threads=2)
        wait_state(farm, "a", "idle")
        number = farm.submit(farm.scene(), *ENDLESS)

        def look():
            worker = named(farm, "a")
            status = worker.get("status", {"cpus": 0})
            return worker if worker["state"] == "working" and status["cpus"] > 0 and status["threads_busy"] > 0 else None
        worker = wait_for(look, "a measurement")
        status = worker["status"]
        expect(worker["job"] == number and status["threads_busy"] <= 2, worker)
        expect(status["memory_bytes"] > 1 << 20 and status["machine_memory_bytes"] > status["memory_bytes"], worker)
        expect(status["cache_bytes"] > 0 and status["cache_limit_bytes"] == 10 << 30, worker)
        expect(worker["core_seconds"] > 0 and worker["samples_per_second"] > 0, worker)
        text = farm.cli("workers", expect=0).out
        expect(re.search(r"^a +working +%d +\d/2 " % number, text, re.M), text)
        text = farm.cli("workers", "show", "a", expect=0).out
        for word in ("a: working", "job:", "of 2 render", "memory:", "cache:", "last lines:"):
            expect(word in text, text)


@tests.add
def paused_by_a_signal():
    """SIGUSR1: it finishes the units in work, returns the rest and is shown as paused; SIGUSR2 ends it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "a")
        farm.submit(farm.scene(), *ENDLESS)
        # The first lease may be of a single unit, of which nothing could be returned.
        wait_for(lambda: (lambda w: w["units_done"] > 0 and w["units_leased"] > 3)(wait_state(farm, "a", "working")),
                 "units to return")
        farm.workers[0].signal(signal.SIGUSR1)
        worker = wait_for(lambda: (lambda w: w["units_leased"] == 0 and w)(wait_state(farm, "a", "paused")),
                          "no units")
        expect("SIGUSR1" in worker["note"], worker)
        expect(re.search(r"returns \d+ work units: the worker is paused", farm.coordinator.log_text()), "not returned")
        result = farm.cli("workers", "resume", "a")
        expect(result.code == 5 and "SIGUSR2" in result.err, result)
        # It stays paused over a lost connection.
        farm.coordinator.kill()
        farm.restart_coordinator()
        wait_state(farm, "a", "paused")
        resent = int(re.findall(r"(\d+) results to send again", farm.workers[0].log_text())[-1])
        time.sleep(0.5)  # as long as a hundred units of this scene take
        worker = wait_state(farm, "a", "paused")
        expect(worker["units_done"] <= resent and worker["units_leased"] == 0, (resent, worker))
        farm.workers[0].signal(signal.SIGUSR2)
        wait_state(farm, "a", "working")
        farm.workers[0].signal(signal.SIGUSR1)
        wait_state(farm, "a", "paused")
        expect(farm.workers[0].stop() == 0, "a paused worker ends")


@tests.add
def hours_and_idleness():
    """--hours and --when-idle: outside, a worker is paused and says until when, or what is in use; inside it works"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.submit(farm.scene(), *ENDLESS)
        # It is noon there, give or take an hour of changing clocks: all day's middle.
        hour = time.gmtime().tm_hour
        noon = {"TZ": "NOON%d" % (hour - 12)}
        farm.start_worker("--name", "night", "--hours", "20:00-08:00", env=noon)
        farm.start_worker("--name", "day", "--hours", "23:00-23:30,08:00-20:00", env=noon)
        farm.start_worker("--name", "shy", "--when-idle", "--idle-load", "0", "--idle-for", "3600", "--nice", "5")
        worker = wait_state(farm, "night", "paused")
        expect("until 20:00" in worker["note"] and worker["units_done"] == 0, worker)
        wait_state(farm, "day", "working")
        wait_state(farm, "shy", "paused")
        wait_for(lambda: "in use" in named(farm, "shy")["note"], "a measurement")
        expect(named(farm, "shy")["state"] == "paused" and named(farm, "shy")["status"]["other_cpus"] > 0, "shy")
        with open("/proc/%d/stat" % farm.workers[2].pid) as stat:
            expect(stat.read().rsplit(")")[1].split()[16] == "5", "--nice")
        farm.start_worker("--name", "calm", "--when-idle", "--idle-load", "100", "--idle-for", "0")
        wait_state(farm, "calm", "working")
        for bad in (["--hours", "20-8"], ["--hours", "25:00-08:00"], ["--hours", "08:00-08:00"], ["--hours", ""],
                    ["--hours", "08:60-09:00"], ["--nice", "20"], ["--idle-load", "101"], ["--drain-status", "200"]):
            worker = farm.start_worker(*bad)
            expect(worker.wait() == 2 and bad[0] in worker.log_text(), bad)


@tests.add
def an_exit_status_for_schedulers():
    """--drain-status: what SIGTERM ends with; other ends keep their statuses"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--drain-status", "99")
        farm.wait_for_workers(1)
        expect(farm.workers[0].stop() == 99, "status")
        worker = farm.start_worker("--drain-status", "99", "--exit-on-disconnect")
        farm.wait_for_workers(1)
        farm.coordinator.kill()
        expect(worker.wait() == 4, "status")


@tests.add
def ended_while_others_hold_back():
    """a worker that is ended does not wait for results of earlier passes that nobody renders; its own are not lost"""
    with Farm() as farm:
        farm.start_coordinator("--lease-seconds", "3600")
        idle = OddPeer(farm, hello="host=idle")
        number = farm.submit(farm.scene(), "--size", "64x64", "--spp", "512")
        idle.say("request 4")
        idle.grant()  # nothing beyond the first pass is merged without these units
        farm.start_worker("--name", "a")
        wait_for(lambda: (named(farm, "a") or {"units_done": 0})["units_done"] >= 48, "results that wait")
        expect(farm.workers[0].stop(limit_s=15) == 0, "status")
        found = re.findall(r"(\d+) results? .*rendered again only if", farm.workers[0].log_text())
        expect(len(found) == 1 and int(found[0]) > 0, farm.workers[0].log_text())
        idle.kill()
        farm.start_worker("--name", "b")
        farm.wait_for_job(number)
        units = named(farm, "b")["units_done"]
        reference = farm.submit(farm.scene(), "--size", "64x64", "--spp", "512")
        farm.wait_for_job(reference)
        whole = named(farm, "b")["units_done"] - units
        expect(units + gone(farm, "a")[0]["units_done"] == whole, "units were rendered again: %d, %d" % (units, whole))
        expect_same(farm, Outcome(farm, number, "left"), Outcome(farm, reference, "reference"), "left")


@tests.add
def a_unit_that_hangs():
    """a unit rendered for far longer than its kind ever took goes to another worker, and the first one is noted"""
    with Farm() as farm:
        farm.start_coordinator("--unit-seconds", "2", "--lease-seconds", "3600")
        odd, other, third = [OddPeer(farm, hello="threads=4 host=" + name) for name in ("odd", "other", "third")]
        number = farm.submit(farm.scene(), "--size", "64x32", "--spp", "1000")
        odd.say("request 2")
        grant = odd.grant()
        odd.say("result fill=0.25")
        odd.wait_line("ack ")
        tile, group, part = grant["units"][1]
        unit = "job=%d frame=%d tile=%d group=%d pass=%d" % (number, grant["frame"], tile, group, part)
        odd.say("status %s ms=1900" % unit)
        expect(named(farm, "odd")["note"] == "", named(farm, "odd"))
        odd.say("status %s ms=4000" % unit)
        worker = wait_for(lambda: (lambda w: w["note"] and w)(named(farm, "odd")), "the note")
        expect("job %d (frame 1, tile %d" % (number, tile) in worker["note"], worker)
        expect("another worker gets it" in farm.cli("log", number, expect=0).out, "the job's log")
        # It hangs there: others get it, this one does not, although it asks first.
        odd.say("request 1")
        expect(odd.grant()["units"] != [(tile, group, part)], "it got it again")
        other.say("request 1")
        expect(other.grant()["units"] == [(tile, group, part)], "the other did not get it")
        other.say("status %s ms=4000" % unit)
        wait_for(lambda: named(farm, "other")["note"], "the second note")
        third.say("request 1")
        expect(third.grant()["units"] == [(tile, group, part)], "the third did not get it")
        expect(farm.job(number)["state"] == "running", farm.job(number))
        third.say("status %s ms=4000" % unit)
        job = farm.wait_for_job(number, "parked")
        expect("3 workers hung on one work unit (frame 1, tile %d" % tile in job["state_text"], job)
        farm.cli("resume", number, expect=0)
        fourth = OddPeer(farm, hello="host=fourth")
        fourth.say("request 4")
        expect(fourth.grant()["job"] == number, "resumed")


class StoppedThread:
    """The thread of a process that renders is stopped, and nothing else of it, as in a hang."""
    SEIZE, INTERRUPT, DETACH, ANY_THREAD = 0x4206, 0x4207, 17, 0x40000000

    def __init__(self, pid):
        def busy(thread):
            try:
                with open("/proc/%d/task/%s/stat" % (pid, thread)) as stat:
                    return int(stat.read().rsplit(")")[1].split()[11])
            except (FileNotFoundError, ProcessLookupError):  # it ended
                return -1
        self.thread = int(max(os.listdir("/proc/%d/task" % pid), key=busy))

    def ptrace(self, request):
        libc = ctypes.CDLL(None, use_errno=True)
        libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
        if libc.ptrace(request, self.thread, None, None) != 0:
            raise Skip("a thread cannot be stopped here: %s" % os.strerror(ctypes.get_errno()))

    def __enter__(self):
        self.ptrace(self.SEIZE)
        self.ptrace(self.INTERRUPT)
        os.waitpid(self.thread, self.ANY_THREAD)
        return self

    def __exit__(self, *_):
        self.ptrace(self.DETACH)  # it goes on, so that its process can end


@tests.add
def a_thread_that_hangs():
    """a stopped rendering thread: the job ends with the same bits, and the worker is noted"""
    with Farm() as farm:
        farm.start_coordinator("--unit-seconds", "1", "--lease-seconds", "3600")
        farm.start_worker("--name", "a")
        farm.wait_for_workers(1)
        long = LongJob(0.6, "129x97")
        long.measure(farm)
        reference = long.submit(farm)
        farm.wait_for_job(reference)
        number = long.submit(farm)
        wait_mid_frame(farm, number)
        with StoppedThread(farm.workers[0].pid):
            # Before another worker is there: it could render the unit as an overdue one first.
            wait_for(lambda: "has been rendering a unit of job %d" % number in named(farm, "a")["note"],
                     "the note")
            farm.start_worker("--name", "b")
            farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "hung"), Outcome(farm, reference, "reference"), "hung")
        expect("another worker gets it" in farm.cli("log", number, expect=0).out, "the job's log")


def busy_ns(pid):
    """Of the thread that computed most: what it computed, and what it waited for a processor beside."""
    threads = []
    for thread in os.listdir("/proc/%d/task" % pid):
        try:
            with open("/proc/%d/task/%s/schedstat" % (pid, thread)) as source:
                ran, waited, _ = map(int, source.read().split())
        except (FileNotFoundError, ProcessLookupError):  # it ended
            continue
        threads.append((ran, ran + waited))
    return max(threads)


@tests.add
def a_far_coordinator():
    """a worker 50 ms away from its coordinator has work while its results and requests are under way"""
    with Farm() as farm:
        farm.start_coordinator()
        with FarAway(farm, 0.05) as proxy:
            farm.address, near = proxy.address, farm.address
            farm.start_worker()
            farm.address = near
            farm.wait_for_workers(1)
            pid = farm.workers[0].pid
            number = farm.submit(os.path.join(ROOT, "scenes/cornell/cornell-area.gltf"), "--size", "720x405",
                                 "--spp", "8")
            seen = []  # (when, computed, computed or waited), each time that it has computed more
            while not seen or farm.job(number)["state"] != "done":
                ran, busy = busy_ns(pid)
                if not seen or ran > seen[-1][1]:
                    seen.append((time.monotonic_ns(), ran, busy))
            # Its first units tell how long one takes.
            first = next(i for i in range(len(seen)) if seen[i][1] - seen[0][1] > 0.3e9)
            time_ns, busy = (seen[-1][k] - seen[first][k] for k in (0, 2))
            expect(busy > 0.85 * time_ns, "busy for %.2f of %.2f s" % (busy / 1e9, time_ns / 1e9))


if __name__ == "__main__":
    tests.run()
