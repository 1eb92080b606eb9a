"""Which job is next: owners, jobs that wait for jobs or for a time, tags, memory."""
import datetime
import os
import re
import shutil
import sqlite3
import subprocess
import tempfile
import time

from farm import BIN, PATIENCE, Failure, Farm, Skip, Tests, wait_for
from jobs import expect

tests = Tests()
ENDLESS = ("--size", "320x200", "--spp", "1000000")
SHORT = ("--size", "32x32", "--spp", "4")


def note(farm, number):
    """What `show` says of the job; `list` says it too."""
    lines = farm.cli("show", number, expect=0).out.splitlines()
    shown = [line.split(None, 1)[1] for line in lines if line.strip().startswith("note ")]
    return shown[0] if shown else ""


def waits(farm, number, words):
    wait_for(lambda: words in note(farm, number),
             "job %d to say '%s'; it says '%s'" % (number, words, note(farm, number)), 20)
    listed = [line for line in farm.cli("list", expect=0).out.splitlines()
              if line.split()[0] == str(number)]
    expect(words[:24] in listed[0], listed)


def samples(farm, number):
    return farm.job(number)["samples_done"]


def submit_as(farm, user, uid, *options):
    """Submit as another user of this machine, whom it does not know.

    The user need not be able to enter the folders of the build and of the farm: what it takes is copied to where all
    may go, whatever TMPDIR is."""
    if os.getuid() != 0:
        raise Skip("only root can become another user")
    with tempfile.TemporaryDirectory(prefix="azulejo-user-", dir="/var/tmp") as home:
        program, key, scene = (os.path.join(home, name) for name in ("azulejo", "farm.key", "tiny.gltf"))
        for source, copy in ((os.path.join(BIN, "azulejo"), program), (farm.key, key), (farm.scene(), scene)):
            shutil.copyfile(source, copy)
            os.chmod(copy, 0o700 if copy == program else 0o600)
            os.chown(copy, uid, uid)
        os.chown(home, uid, uid)
        argv = farm.cli_argv("submit", scene, "--json", *options, key=key)
        done = subprocess.run([program] + argv[1:], user=uid, group=uid, cwd=home,
                              env={"USER": user, "HOME": home, "PATH": os.environ["PATH"]},
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60 * PATIENCE)
    if done.returncode != 0:
        raise Failure(str(done))
    number = int(done.stdout.split(b'"job":')[1].split(b",")[0])
    expect(farm.job(number)["owner"].startswith(user + "@"), farm.job(number)["owner"])
    return number


@tests.add
def several_at_once():
    """A job that cannot use all workers leaves the rest to the next one"""
    with Farm() as farm:
        farm.start_coordinator()
        # One tile: when the last of its units are lent, some of which take seconds, there is nothing left to lend.
        small = farm.submit(farm.scene(), "--size", "16x16", "--spp", "65536", "--max-depth", "64")
        large = farm.submit(farm.scene(), *ENDLESS)
        for _ in range(2):
            farm.start_worker(threads=2, rests=False)
        wait_for(lambda: farm.job(small)["workers"] > 0 and farm.job(large)["workers"] > 0,
                 "workers on both at the same time")


@tests.add
def owners():
    """The owner who used less goes first, also after a kill of the coordinator"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(rests=False)
        first = submit_as(farm, "ana", 54321, *ENDLESS)
        wait_for(lambda: samples(farm, first) > 0, "ana's job")

        def stored():
            store = sqlite3.connect("file:%s/queue.sqlite?mode=ro" % farm.store, uri=True)
            rows = dict(store.execute("SELECT owner, core_s FROM shares"))
            store.close()
            return [v for k, v in rows.items() if k.startswith("ana@")]
        wait_for(lambda: stored() and stored()[0] > 0.5, "ana's share in the store")
        farm.coordinator.kill()
        farm.workers[0].kill()
        farm.restart_coordinator()
        second = submit_as(farm, "ana", 54321, *ENDLESS)
        third = submit_as(farm, "ben", 54322, *ENDLESS)
        waits(farm, third, "no worker")
        farm.start_worker()
        wait_for(lambda: samples(farm, third) > 0, "ben's job, the last one")
        expect(samples(farm, second) == 0, "ana's second waits")
        waits(farm, second, "waits behind 2 jobs")

        # Without shares: first come, first served.
        farm.coordinator.stop()
        farm.workers[1].kill()
        farm.restart_coordinator("--half-life", "off", "--longest-wait", "off")
        fourth = submit_as(farm, "cat", 54323, *ENDLESS)
        before = samples(farm, first)
        farm.start_worker()
        wait_for(lambda: samples(farm, first) > before, "the first job")
        waits(farm, fourth, "waits behind 3 jobs")
        for option in ("--half-life", "--longest-wait"):
            wrong = subprocess.run([farm.coordinator.argv[0], option, "often"], stderr=subprocess.PIPE)
            expect(wrong.returncode == 2 and option.encode() in wrong.stderr, wrong)


@tests.add
def after():
    """--after waits for other jobs to be done, whatever becomes of them; start ends the wait"""
    with Farm() as farm:
        farm.start_coordinator()
        result = farm.cli("submit", farm.scene(), "--after", "7", *SHORT)
        expect(result.code == 3 and "no such job" in result.err, result)
        for wrong in ("", "1,", "0", ",".join(str(i) for i in range(1, 40))):
            expect(farm.cli("submit", farm.scene(), "--after", wrong).code == 2, wrong)
        result = farm.cli("submit", farm.scene(), "--after", "no-such-name")
        expect(result.code == 5 and "--after: no job is named 'no-such-name'" in result.err, result)
        done = farm.submit(farm.scene(), *SHORT)
        one = farm.submit(farm.scene(), *ENDLESS)
        two = farm.submit(farm.scene(), *ENDLESS, "--name", "two")
        third = farm.submit(farm.scene(), *SHORT, "--after", "%d,%d,two" % (done, one), "--priority", "9")
        lost = farm.submit(farm.scene(), *SHORT, "--after", "%d" % two)
        waits(farm, third, "waits for jobs %d, %d and %d" % (done, one, two))
        farm.start_worker()
        farm.wait_for_job(done)
        waits(farm, third, "waits for jobs %d and %d" % (one, two))
        expect(farm.job(third)["after"] == [one, two], farm.job(third))
        expect("after       jobs %d, %d\n" % (one, two) in farm.cli("show", third).out, "show")

        # What was done once is waited for no longer, also after a kill.
        farm.cli("extend", done, "--spp", "100000", expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator()
        waits(farm, third, "waits for jobs %d and %d" % (one, two))
        farm.cli("cancel", done, expect=0)

        farm.cli("cancel", one, "--discard", expect=0)
        waits(farm, third, "%d was cancelled: 'retry' it, or 'start'" % one)
        farm.cli("remove", one, expect=0)
        waits(farm, third, "%d was removed before it was done: 'start'" % one)
        expect(samples(farm, third) == 0, "it waits")
        # Finished early is done.
        wait_for(lambda: samples(farm, two) > 0, "the second one to begin")
        farm.cli("finish", two, expect=0)
        farm.wait_for_job(lost)
        waits(farm, third, "waits for job %d; %d was removed" % (one, one))
        answer = farm.cli("start", third, expect=0)
        # As it is when the start is on disk: the worker may have begun with it.
        expect(re.search(r"job %d: (queued|running|done)\b" % third, answer.out), answer)
        farm.wait_for_job(third)
        expect("started: it waits for no other job" in farm.cli("log", third).out, "the log")
        result = farm.cli("start", third)
        expect(result.code == 5 and "is done and cannot be started" in result.err, result)
        # For a job that is done, nothing is waited for.
        at_once = farm.submit(farm.scene(), *SHORT, "--after", str(third))
        farm.wait_for_job(at_once)


@tests.add
def start_is_kept():
    """A start that was answered is on disk; one that was not leaves the job waiting or started"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *ENDLESS, "--not-before", "2099-01-01", "--require", "gpu")
        for delay_s in (0.005, 0.01, 0.02, 0.03, 0.05):
            client = farm.start_cli("start", number)
            try:
                client.wait(delay_s)  # a sweep over moments, not a wait
            except subprocess.TimeoutExpired:
                pass
            farm.coordinator.kill()
            client.communicate(timeout=60)
            farm.restart_coordinator()
            waits_still = "waits until" in note(farm, number)
            expect(client.returncode in (0, 4) and not (waits_still and client.returncode == 0), client.returncode)
        farm.cli("start", number, expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator()
        waits(farm, number, "waits: no worker is connected")
        job = farm.job(number)
        expect(job["not_before"] == 0 and job["require"] == "gpu", job)


@tests.add
def not_before():
    """--not-before takes times of day, dates and lengths; the job begins then, also after a restart"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        now = datetime.datetime.now()
        for text, seconds in (("2h", 7200), ((now + datetime.timedelta(hours=3)).strftime("%H:%M"), 10800),
                              ((now + datetime.timedelta(days=2)).strftime("%Y-%m-%d %H:%M"), 172800),
                              ((now + datetime.timedelta(days=2)).strftime("%Y-%m-%dT%H:%M:%S"), 172800),
                              (time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(time.time() + 5000)), 5000),
                              (time.strftime("%Y-%m-%dT%H:%M:%S+02:00", time.gmtime(time.time() + 12200)), 5000)):
            number = farm.submit(farm.scene(), *SHORT, "--not-before", text)
            job = farm.job(number)
            expect(abs(job["not_before"] - time.time() - seconds) < 100, (text, job["not_before"] - time.time()))
            when = time.localtime(job["not_before"])
            words = time.strftime("%H:%M" if seconds < 86400 else "%Y-%m-%d %H:%M", when)
            waits(farm, number, "waits until " + words)
            expect(job["state_text"] == "waits until %s UTC" % time.strftime(
                "%Y-%m-%d %H:%M", time.gmtime(job["not_before"])), job["state_text"])
        again = [farm.submit(farm.scene(), *SHORT, "--token", "x", "--not-before", t) for t in ("1h", "3h")]
        expect(again[0] == again[1], "a token is one job, whatever it waits for")
        for wrong in ("25:00", "noon", "2026-02-30", "2026-13-01 10:00", "", "12:5", "2026-03-01T10:00X", "-3"):
            result = farm.cli("submit", farm.scene(), "--not-before=" + wrong)
            expect(result.code == 2 and "18:00" in result.err, result)
        farm.coordinator.kill()
        farm.restart_coordinator()
        waits(farm, number, "waits until ")
        farm.cli("start", number, expect=0)
        farm.wait_for_job(number)
        soon = farm.submit(farm.scene(), *SHORT, "--not-before", "3s")
        expect(farm.job(soon)["state"] == "queued", "not yet")
        farm.wait_for_job(soon)
        past = farm.submit(farm.scene(), *SHORT, "--not-before", "2020-01-01")
        farm.wait_for_job(past)


@tests.add
def tags():
    """Only workers with the tags render a job that requires them"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--tag", "big,fast")
        farm.wait_for_workers(1)
        gpu = farm.submit(farm.scene(), *SHORT, "--require", "gpu")
        both = farm.submit(farm.scene(), *SHORT, "--require", "gpu,big")
        plain = farm.submit(farm.scene(), *SHORT)
        farm.wait_for_job(plain)
        waits(farm, gpu, "waits: no worker has the tag gpu")
        expect(farm.job(both)["require"] == "big,gpu", farm.job(both))
        farm.start_worker("--tag", "gpu")
        farm.wait_for_job(gpu)
        waits(farm, both, "waits: no worker has all of the tags big,gpu")
        table = {w["process"]: w["tags"] for w in farm.list_workers()}
        expect(table == {farm.workers[0].pid: "big,fast", farm.workers[1].pid: "gpu"}, table)
        notes = {w["process"]: w["note"] for w in farm.list_workers()}
        expect(notes[farm.workers[1].pid] == "it has no tag big, which job %d requires" % both, notes)
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_workers(2)
        waits(farm, both, "waits: no worker has all of the tags")
        farm.start_worker("--tag=gpu,big,gpu")
        farm.wait_for_job(both)
        for wrong in ("", "a,", "a b", "x" * 40, ",".join("t%d" % i for i in range(20))):
            expect(farm.cli("submit", farm.scene(), "--require=" + wrong).code == 2, wrong)
            worker = subprocess.run([farm.workers[0].argv[0], "--tag=" + wrong], stderr=subprocess.PIPE)
            expect(worker.returncode == 2 and b"--tag" in worker.stderr, worker)


def write_grid(path, n):
    """2 n^2 triangles, as PLY."""
    with open(path, "w") as out:
        out.write("ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                  "property float z\nelement face %d\nproperty list uchar int vertex_indices\n"
                  "end_header\n" % ((n + 1) ** 2, 2 * n * n))
        for i in range(n + 1):
            for j in range(n + 1):
                out.write("%g %g %g\n" % (i / n, (i * 7919 + j * 104729) % 97 / 97 / n, j / n))
        for a in (i * (n + 1) + j for i in range(n) for j in range(n)):
            out.write("3 %d %d %d\n3 %d %d %d\n" % (a, a + 1, a + n + 1, a + 1, a + n + 2, a + n + 1))


@tests.add
def estimate():
    """The memory that a scene is estimated to need is somewhat less than what a worker takes for it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        write_grid(farm.path("grid.ply"), 250)
        number = farm.submit(farm.path("grid.ply"), *SHORT, "--studio", "off")
        farm.wait_for_job(number)
        line = next(l for l in farm.workers[0].log_text().splitlines() if "125000 triangles" in l)
        taken = float(re.search(r"([0-9.]+) MiB", line).group(1)) * 2 ** 20
        expect(0.75 * taken < farm.job(number)["memory"] < 1.05 * taken, (farm.job(number)["memory"], line))


@tests.add
def memory():
    """A job that needs more memory than the machines have says which one has how much"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--memory", "1M")
        farm.start_worker("--memory", "0")
        farm.wait_for_workers(2)
        machine = next(w["memory"] for w in farm.list_workers() if w["memory"])
        expect(machine == 1 << 20, farm.list_workers())
        # A machine that does not say what it has is tried.
        farm.wait_for_job(farm.submit(farm.scene(), *SHORT, "--memory", "64G"))
        farm.workers[1].stop()
        farm.wait_for_workers(1)
        big = farm.submit(farm.scene(), *SHORT, "--memory", "64G")
        waits(farm, big, "waits: no worker has enough memory: it needs 64.0 GiB;")
        expect("has 1.0 MiB" in note(farm, big), note(farm, big))
        expect("memory      64.0 GiB" in farm.cli("show", big).out, "show")
        small = farm.submit(farm.scene(), *SHORT)
        farm.wait_for_job(small)
        need = farm.job(small)
        expect(not need["memory_said"] and 1000 < need["memory"] < 10000, need["memory"])
        any_machine = farm.submit(farm.scene(), *SHORT, "--memory", "0")
        farm.wait_for_job(any_machine)
        farm.start_worker()  # announces what the machine has
        wait_for(lambda: any(w["memory"] > 100 << 20 for w in farm.list_workers()), "its memory")


@tests.add
def max_cores():
    """a job with --max-cores has so many cores at most, over workers that come and go; the others render what is next"""
    with Farm() as farm:
        farm.start_coordinator()
        few = farm.submit(farm.scene(), *ENDLESS, "--max-cores", "2", "--priority", "1")
        other = farm.submit(farm.scene(), *ENDLESS)
        expect(re.search(r"^  max-cores   2$", farm.cli("show", few, expect=0).out, re.M), "show")
        expect("max-cores" not in farm.cli("show", other, expect=0).out, "show")
        first = [farm.start_worker() for _ in range(3)]
        farm.wait_for_workers(3)

        def counts():
            found = [farm.job(few)["workers"], farm.job(other)["workers"]]
            expect(found[0] <= 2, found)
            return found

        wait_for(lambda: counts() == [2, 1], "two workers on the job, and one on the other")
        first[0].kill()
        first[1].kill()
        farm.start_worker()
        farm.start_worker()
        wait_for(lambda: counts() == [2, 1], "two other workers on the job")
        farm.coordinator.kill()
        farm.restart_coordinator()
        wait_for(lambda: counts() == [2, 1], "the same after a restart")
        for words in (["--max-cores", "0"], ["--max-cores", "x"]):
            result = farm.cli("submit", farm.scene(), *words)
            expect(result.code == 2 and "--max-cores" in result.err, result)


tests.run()
