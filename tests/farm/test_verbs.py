"""What people do to jobs, at the command line: one job, several or a filter; the coordinator killed
around each answer; the bits of what continues."""
import itertools
import json
import os
import pty
import re
import socket
import subprocess
import time

from farm import BIN, BUILD, PATIENCE, ROOT, Failure, Farm, Tests, read_bytes, readable, wait_for
from jobs import Outcome, expect, expect_same, wait_slowly
from page import Page
from test_one_vocabulary import command, same

tests = Tests()
LONG = ("--size", "160x96", "--frames", "1-2", "--spp", "100")
ENDLESS = ("--size", "320x200", "--spp", "1000000")
ENDED = ("done", "failed", "cancelled")


def begun(farm, number):
    """Wait until it has samples, and not many."""
    wait_slowly(farm, lambda: farm.job(number)["samples_done"] > 0, "job %d to begin" % number)


def state(farm, number):
    return farm.job(number)["state"]


def verb(farm, *args):
    return farm.cli(*args, expect=0)


def kill_and_restart(farm):
    farm.coordinator.kill()
    farm.restart_coordinator()


DELAYS_S = itertools.cycle((0.03, 0.01, 0.05, 0.02, 0.08, 0.005, 0.04))


def killed_during(farm, before, after, *args):
    """The coordinator dies at some moment around the change: then the job is in a state of `before`,
    unless it was answered, or in one of `after`. Ends with the verb done."""
    number = args[1]
    client = farm.start_cli(*args)
    try:
        client.wait(next(DELAYS_S))  # a sweep over moments, not a wait
    except subprocess.TimeoutExpired:
        pass
    farm.coordinator.kill()
    client.communicate(timeout=60)
    farm.restart_coordinator()
    expect(client.returncode in (0, 4), "%s: %s" % (args, client.returncode))
    now = farm.cli("show", number, "--json")
    now = now.json()["state"] if now.code == 0 else "gone"
    expect(now in after or (client.returncode == 4 and now in before),
           "%s: status %d, and it is %s" % (args, client.returncode, now))
    if now in after:
        return
    if "running" in before:
        begun(farm, number)
    verb(farm, *args)
    kill_and_restart(farm)


OPEN = ("queued", "running")


@tests.add
def bits():
    """Paused, finished, cancelled and tried again, with kill -9 around each: the same bits"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = farm.scene()
        number = farm.submit(scene, *LONG)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")

        number = farm.submit(scene, *LONG)
        begun(farm, number)
        killed_during(farm, OPEN, ("paused",), "pause", number)
        job = farm.job(number)
        expect(job["state"] == "paused" and "paused by " + job["owner"] in job["state_text"], job)
        farm.wait_for_workers(1)
        expect(farm.job(number)["workers"] == 0, "a paused job has no workers")
        killed_during(farm, ("paused",), OPEN + ("done",), "resume", number)
        farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "paused"), reference, "paused", counts=False)

        number = farm.submit(scene, *LONG)
        begun(farm, number)
        killed_during(farm, OPEN, ("finishing", "done"), "finish", number)
        job = farm.wait_for_job(number)
        expect(job["finished_early"] and job["cut_frames"], job)
        expect(all(c["end"] == "finish" and c["tiles_empty"] == 0
                   for c in job["cut_frames"]), job)
        expect(len(farm.fetch(number, "early")) == 2 * job["frames_done"], "whole pictures")
        killed_during(farm, ("done",), OPEN, "retry", number)
        job = farm.wait_for_job(number)
        expect(not job["finished_early"] and not job["cut_frames"], job)
        expect_same(farm, Outcome(farm, number, "retried"), reference, "finished, tried again",
                    counts=False)

        number = farm.submit(scene, *LONG)
        begun(farm, number)
        killed_during(farm, OPEN, ("cancelling", "cancelled"), "cancel", number)
        farm.wait_for_job(number, "cancelled")
        verb(farm, "retry", number)
        farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "cancelled"), reference, "cancelled, tried again",
                    counts=False)
        os.unlink(farm.path("store", "outputs", str(number), "frame-0002.png"))
        expect(farm.cli("fetch", number, "-o", "lost").code == 9, "a lost picture")
        verb(farm, "retry", number, "--frames", "2")  # from its film
        farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "again"), reference, "made again", counts=False)


@tests.add
def kept():
    """Priority and removal are on disk when they are answered"""
    with Farm() as farm:
        farm.start_coordinator()
        first, second = (farm.submit(farm.scene(), *ENDLESS) for _ in range(2))
        verb(farm, "priority", second, "--to", "7")
        kill_and_restart(farm)
        expect(farm.job(second)["priority"] == 7, farm.job(second))
        expect("behind 1 job" in farm.job(first)["state_text"] or
               "no worker" in farm.job(first)["state_text"], farm.job(first))
        farm.start_worker()
        begun(farm, second)
        expect(farm.job(first)["samples_done"] == 0, "the first has to wait")
        result = farm.cli("remove", second)
        expect(result.code == 5 and "'cancel' it first" in result.err, result)
        verb(farm, "cancel", second)
        killed_during(farm, ("cancelled",), ("gone",), "remove", second)
        expect(farm.cli("show", second).code == 5, "it is gone")
        for folder in ("films", "outputs"):
            expect(not os.path.exists(farm.path("store", folder, str(second))), folder)
        expect(farm.submit(farm.scene(), *ENDLESS) == second + 1, "a number is not used again")


@tests.add
def refusals():
    """A verb that a state does not allow says why in a sentence, and what to do"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *ENDLESS)
        for args, words in ((("resume",), "is queued"), (("retry",), "is queued"),
                            (("remove",), "'cancel' it first"), (("finish",), "no frame in work")):
            result = farm.cli(args[0], number)
            expect(result.code == 5 and words in result.err, result)
        verb(farm, "cancel", number)
        for name in ("pause", "resume", "finish"):
            result = farm.cli(name, number)
            expect(result.code == 5 and "is cancelled" in result.err and "'retry'" in result.err,
                   result)
        result = farm.cli("priority", number, "--to", "3")
        expect(result.code == 5 and "is cancelled" in result.err, result)
        expect(farm.cli("priority", number).code == 2, "--to is missing")
        expect(farm.cli("pause").code == 2, "no job")
        expect(farm.cli("pause", 99).code == 5, "no such job")


def ask(farm, answer, *args):
    """Run the client with a terminal that types `answer`; its exit status and standard error."""
    mine, its = pty.openpty()
    client = subprocess.Popen(farm.cli_argv(*args), stdin=its, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE)
    os.close(its)
    os.write(mine, answer)
    out, err = client.communicate(timeout=60)
    os.close(mine)
    return client.returncode, err.decode()


@tests.add
def many():
    """Several jobs, names with wildcards, --state and --mine: shown and asked, or --yes"""
    with Farm() as farm:
        farm.start_coordinator()
        names = ("walk-1", "walk-2", "run-1", "run-2")
        jobs = [farm.submit(farm.scene(), *ENDLESS, "--name", n) for n in names]
        states = lambda: [state(farm, n) for n in jobs]

        result = farm.cli("pause", "walk-*")
        expect(result.code == 2 and "--yes" in result.err, result)
        expect(states() == ["queued"] * 4, states())
        # One job by its whole name is as sure as by its number.
        for words in (("pause", "walk-1"), ("resume", "walk-1"), ("priority", "walk-1", "--to", "7"), ("comment", "walk-1", "why")):
            verb(farm, *words)
        expect(farm.job(jobs[0])["priority"] == 7 and farm.job(jobs[0])["comment"] == "why", farm.job(jobs[0]))
        twin = farm.submit(farm.scene(), *ENDLESS, "--name", "walk-1")
        result = farm.cli("comment", "walk-1", "why")
        expect(result.code == 2 and "2 jobs" in result.err and "--yes" in result.err, result)
        verb(farm, "cancel", twin, "--discard")
        verb(farm, "remove", twin)
        code, err = ask(farm, b"n\n", "pause", "walk-*")
        expect(code == 0 and "walk-1" in err and "walk-2" in err and "run-1" not in err, err)
        expect("nothing was changed" in err and states() == ["queued"] * 4, states())
        code, err = ask(farm, b"y\n", "pause", "walk-*")
        expect(code == 0 and states() == ["paused", "paused", "queued", "queued"], states())

        result = farm.cli("pause", jobs[0], jobs[2], "--yes", "--json", expect=0).json()
        expect([j["state"] for j in result["jobs"]] == ["paused", "paused"], result)
        verb(farm, "resume", "--state", "paused", "--yes")
        expect(states() == ["queued"] * 4, states())
        verb(farm, "cancel", "*-2", "--yes")
        expect(states() == ["queued", "cancelled", "queued", "cancelled"], states())
        # A number for which it cannot be done does not stop the others.
        result = farm.cli("pause", jobs[0], jobs[1], jobs[2], "--yes")
        expect(result.code == 5 and "job %d is cancelled" % jobs[1] in result.err, result)
        expect(states() == ["paused", "cancelled", "paused", "cancelled"], states())
        verb(farm, "resume", "--mine", "--yes")
        verb(farm, "retry", "--mine", "--state", "cancelled", "--yes")
        expect(states() == ["queued"] * 4, states())
        owner = farm.job(jobs[0])["owner"]
        expect(owner.endswith("@" + socket.gethostname()), owner)
        verb(farm, "cancel", "--mine", "--yes", "--discard")
        verb(farm, "remove", "--mine", "--yes")
        expect(farm.cli("list", "--json").json()["jobs"] == [], "all are gone")
        expect(farm.cli("remove", "--mine", "--yes").code == 5, "no job matches")
        expect(farm.cli("pause", "--state", "lost").code == 2, "an unknown state")


@tests.add
def early():
    """A name or a filter chooses what retry goes on with: also a job that was finished early, not one with all samples"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        whole = farm.submit(farm.scene(), "--size", "32x32", "--spp", "4", "--name", "walk-1")
        farm.wait_for_job(whole)
        number = farm.submit(farm.scene(), *ENDLESS, "--name", "walk-2")
        begun(farm, number)
        verb(farm, "finish", number)
        expect(farm.wait_for_job(number)["finished_early"], "it was not finished early")
        verb(farm, "retry", "walk-*", "--yes")
        expect(state(farm, number) in OPEN and state(farm, whole) == "done", (state(farm, number), state(farm, whole)))
        verb(farm, "cancel", number, "--discard")
        result = farm.cli("retry", "walk-*", "--frames", "1", "--yes", "--json", expect=0).json()
        expect([j["job"] for j in result["jobs"]] == [whole, number], result)


ROWS = re.findall(r"STATE\((\w+), (\w+), (\d+),", read_bytes(os.path.join(ROOT, "common/schema/job_states.h")).decode())
STATES = {name: int(number) for _, name, number in ROWS}
STUCK = ("finishing", "cancelling")  # states that end by themselves
ARGUMENTS = {"priority": (("--to", "3"), {"priority": 3}), "retry-frames": (("--frames", "1"), {"frames": [1]}),
             "discard": (("--discard",), {"discard": True}), "extend": (None, {"spp": 64}), "develop": (None, {"output": {}}), "comment": ((), {"comment": "words"})}
WORDS = {"comment": ("words",)}  # behind the jobs


def jobs_in_each_state(farm, api, names):
    """A job of every name in every state but STUCK: {(name, state): number}. Nothing of them was rendered."""
    first = api.get("/api/v1/jobs/%d" % farm.submit(farm.scene(), *ENDLESS)).json()["jobs"][0]
    copy = {key: first[key] for key in ("scene", "settings", "output", "first_frame", "last_frame")}
    jobs = {}
    for name, state in itertools.product(names, (s for s in STATES if s not in STUCK)):
        answer = api.post("/api/v1/jobs", dict(copy, name="%s.%s" % (name, state)))
        jobs[name, state] = answer.json()["job"]
    verb(farm, "cancel", first["job"], "--discard")
    farm.coordinator.stop()
    farm.edit_store(lambda store: store.executemany(
        "UPDATE jobs SET state=?, finished_at=? WHERE id=?",
        [(STATES[state], state in ENDED, number) for (_, state), number in jobs.items()]))
    return jobs


def post(api, row, number, state):
    """Whether the farm takes the verb in that state is what the table says."""
    answer = api.post("/api/v1/jobs/%d/%s" % (number, row["path"]), ARGUMENTS.get(row["name"], ((), {}))[1])
    by_state = answer.status == 409 and "is %s and cannot be" % state in answer.json()["detail"]
    expect(by_state == (state not in row["states"] + row["accepted"]), (row["name"], state, answer))


@tests.add
def table():
    """Every verb in every state: command line, API, JSON and farm say what common/schema/verbs.h says; show prints the API's answer"""
    with Farm() as farm:
        api = Page(farm.start_coordinator())
        still = lambda job: dict(job, samples_per_second=0, seconds_active=0)  # a job that is open has others at each question
        told = lambda number: same(lambda: still(command(farm, "show", number)),
                                   lambda: still(api.get("/api/v1/jobs/%d" % number).json()["jobs"][0]))
        rows = {row["name"]: row for row in api.get("/api/v1/verbs").json()["verbs"]}
        jobs = jobs_in_each_state(farm, api, ["%s-%s" % pair for pair in itertools.product(("cli", "api"), rows)])
        api = Page(farm.start_coordinator())
        theirs = {j["job"]: j for j in api.get("/api/v1/jobs").json()["jobs"]}
        ours = {j["job"]: j for j in farm.cli("list", "--json", expect=0).json()["jobs"]}
        for (name, state), number in jobs.items():
            expect(theirs[number]["state"] == state and ours[number]["verbs"] == theirs[number]["verbs"], theirs[number])
            # These depend on more than the state: it waits for nothing, and nothing of it was rendered or left out.
            but = {"start"} | ({"finish"} if state == "queued" else {"retry"} if state == "done" else set())
            expect(theirs[number]["verbs"] == [n for n in rows if state in rows[n]["states"] and n not in but],
                   (state, theirs[number]["verbs"]))
        for state in (s for s in STATES if s not in STUCK):
            expect(told(jobs["cli-cancel", state])["state"] == state, state)
        for name, row in rows.items():
            options = ARGUMENTS.get(name, ((), {}))[0]
            if options is None:
                continue  # it takes one job, by its number
            mine = {number for (job, _), number in jobs.items() if job == "cli-" + name}
            offered = {number for number in mine if name in ours[number]["verbs"]}
            done = farm.cli(row["path"], "cli-%s.*" % name, *WORDS.get(name, ()), "--yes", "--json", *options)
            if offered:
                got = done.json()
                expect({j["job"] for j in got["jobs"] + got["failed"]} == offered, (name, done))
                expect(not any(" and cannot be " in j["error"] for j in got["failed"]), (name, done))
            else:
                expect(done.code == 5 and "nothing to do" in done.err, (name, done))
            for state in (s for s in STATES if s not in STUCK):
                post(api, row, jobs["api-" + name, state], state)
        # A picture that cannot be written keeps a job in the states that end by themselves.
        farm.start_worker()
        stuck = farm.submit(farm.scene(), *ENDLESS, "--priority", "9")
        begun(farm, stuck)
        os.makedirs(farm.path("store", "outputs"), exist_ok=True)
        open(farm.path("store", "outputs", str(stuck)), "w").close()
        for state, way in (("finishing", "finish"), ("cancelling", "cancel")):
            expect(api.post("/api/v1/jobs/%d/%s" % (stuck, way), {}).status == 200, way)
            for name in (n for n in rows if n not in ("cancel", "discard") or state == "cancelling" and n == "cancel"):
                post(api, rows[name], stuck, state)
            expect(told(stuck)["state"] == state, state)
            expect(farm.job(stuck)["verbs"] == [n for n in rows if state in rows[n]["states"] and n != "start"],
                   farm.job(stuck))
        post(api, rows["discard"], stuck, "cancelling")
        expect(farm.job(stuck)["state"] == "cancelled", farm.job(stuck))


@tests.add
def comment():
    """A comment is in list, show, JSON, the log and the audit log, over restarts, and after the job has ended; empty: none"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *ENDLESS, "--name", "walk")
        text = "left hand: \u201cagain\u201d, 100%s"
        verb(farm, "comment", number, text)
        kill_and_restart(farm)
        verb(farm, "cancel", "walk", "--yes")
        kill_and_restart(farm)
        expect(farm.job(number)["comment"] == text and farm.job(number)["state"] == "cancelled", farm.job(number))
        for args in (("list",), ("show", number), ("log", number)):
            expect("comment: " + text in farm.cli(*args, expect=0).out, args)
        lines = [json.loads(line) for line in read_bytes(farm.path("store", "audit.log")).decode().splitlines()]
        expect({"comment": text} in [l["details"] for l in lines if l["verb"] == "comment"], lines)
        expect(farm.cli("comment", number, "x" * 256).code == 3 and farm.job(number)["comment"] == text, "255 bytes")
        expect(farm.cli("comment", "walk").code == 2, "no text")
        verb(farm, "comment", number, "")
        expect(farm.job(number)["comment"] == "" and "comment:" not in farm.cli("show", number, expect=0).out, "none")


@tests.add
def row():
    """A verb that only its row, its message and its function describe: command, help, completion, API, JSON, log, audit"""
    there = os.path.join(BUILD, "row", "verb", "bin")
    azulejo = lambda *words: subprocess.run([os.path.join(there, "azulejo"), *words], capture_output=True, text=True, timeout=60)
    with Farm() as farm:
        api = Page(farm.start_coordinator(program=os.path.join(there, "azulejo-coordinator")))
        number = farm.submit(farm.scene(), *ENDLESS, "--name", "walk")
        gone = farm.submit(farm.scene(), *ENDLESS, "--name", "walk")
        farm.cli("cancel", gone, expect=0)
        where = ("--coordinator", farm.address, "--key", farm.key)
        helps = " ".join(azulejo("salute", "--help").stdout.split())
        expect("usage: azulejo salute JOB... TEXT [OPTION]..." in helps and "several jobs are saluted" in helps, helps)
        expect("  salute       salute jobs\n" in azulejo("--help").stdout, "the list of commands")
        expect("salute" in azulejo("completion", "bash").stdout, "completion")
        told = azulejo("salute", "walk", "good day", "--yes", *where)
        expect(told.returncode == 0 and told.stdout.startswith("job %d: queued" % number) and told.stdout.count("job") == 1, told)
        told = azulejo("salute", str(gone), "good day", *where)
        expect(told.returncode == 5 and "job %d is cancelled and cannot be saluted: 'retry'" % gone in told.stderr, told)
        expect("salute" in farm.job(number)["verbs"] and "salute" not in farm.job(gone)["verbs"], farm.job(number)["verbs"])
        answer = api.post("/api/v1/jobs/%d/salute" % number, {"words": "by API"})
        expect(answer.status == 200, answer)
        verbs = {v["name"]: v for v in api.get("/api/v1/verbs").json()["verbs"]}
        expect(verbs["salute"]["takes"] == "text" and verbs["salute"]["label"] == "Salute", verbs["salute"])
        log = farm.cli("log", number, expect=0).out
        expect(": saluted: good day" in log and ": saluted: by API" in log, log)
        lines = [json.loads(line) for line in read_bytes(farm.path("store", "audit.log")).decode().splitlines()]
        expect([l["details"] for l in lines if l.get("verb") == "salute" and l["outcome"] == "done"] ==
               [{"words": "good day"}, {"words": "by API"}], lines)


@tests.add
def log():
    """log JOB names who did what; -f follows over a restart until the job ends"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *ENDLESS)
        me = farm.job(number)["owner"]
        follower = farm.start_cli("log", number, "-f")

        lines = []

        def next_line(words):
            """The first line from here on with these words."""
            end = time.monotonic() + 30 * PATIENCE
            while True:
                while lines and b"\n" in lines[0]:
                    line, lines[0] = lines[0].split(b"\n", 1)
                    if words in line.decode():
                        return line.decode()
                if not readable(follower.stdout.fileno(), max(0, end - time.monotonic())):
                    raise Failure("no line with '%s'" % words)
                data = os.read(follower.stdout.fileno(), 65536)
                expect(data, "it ended before '%s'" % words)
                lines[:] = [b"".join(lines) + data]
        expect(me + ": submitted as tiny" in next_line("submitted"), "who submitted it")
        verb(farm, "pause", number)
        next_line(me + ": paused")
        kill_and_restart(farm)
        verb(farm, "resume", number)
        next_line(me + ": resumed")
        farm.start_worker()
        next_line("coordinator: runs")
        next_line("triangles")  # a line of the worker about its scene
        verb(farm, "cancel", number, "--discard")
        next_line(me + ": cancel")
        next_line("coordinator: cancelled")
        follower.communicate(timeout=60)
        expect(follower.returncode == 0, "it ends with the job")
        lines = farm.cli("log", number, expect=0).out.splitlines()
        expect(sum(": paused" in line for line in lines) == 1, lines)
        worker = [line for line in lines if "triangles" in line]
        expect(len(worker) == 1 and "worker %s, process %d: " % (socket.gethostname(),
               farm.workers[0].pid) in worker[0], lines)
        events = [json.loads(line) for line in farm.cli("log", number, "--json", expect=0).out.splitlines()]
        # The worker may have added lines about its last results since.
        expect(len(events) >= len(lines) and all(e["text"] in line for e, line in zip(events, lines)), (lines, events))
        expect(farm.cli("log", 99).code == 5, "no such job")


@tests.add
def odd_names():
    """Names with characters that patterns, formats, options and numbers use mean the job of that name only"""
    with Farm() as farm:
        farm.start_coordinator()
        names = ("take[1]", "take1", "back\\slash", "backslash", "100%s%n", "-y", "two?lines", "two lines", "\u2713 fin", "42")
        jobs = {n: farm.submit(farm.scene(), *ENDLESS, "--name", n) for n in names}
        paused = lambda: sorted(n for n in names if state(farm, jobs[n]) == "paused")
        for name in names[:-1]:
            options = ("--coordinator", farm.address, "--key", farm.key)
            done = farm.cli("pause", "--yes", *options, "--", name, connect=False)
            meant = [name] if "?" not in name else ["two lines", "two?lines"]
            expect(done.code == 0 and paused() == meant, (name, done, paused()))
            for n in meant:
                verb(farm, "resume", jobs[n])
        # A number is a job's number, never a name.
        result = farm.cli("pause", "42", "--yes")
        expect(result.code == 5 and "no job 42" in result.err, result)
        # What does not exist is said before anything is changed, beside others and with filters.
        for args, words in ((("take1", "taek2"), "no job is named 'taek2'"), ((jobs["take1"], "x-*"), "'x-*'"),
                            (("take1", "99", "--mine"), "no job 99"),
                            (("n" * 256, ), "at most 255 bytes")):
            result = farm.cli("pause", *args, "--yes")
            expect(result.code in (2, 5) and words in result.err and paused() == [], result)


@tests.add
def closed_descriptors():
    """Standard input, output and error that the caller closed: nothing crashes, nothing else gets them"""
    closing = lambda words, argv: ["bash", "-c", 'exec "$@" ' + words, "closed"] + argv
    with Farm() as farm:
        farm.start_coordinator(prefix=closing("<&- 2>&-", []))
        held = os.readlink("/proc/%d/fd/2" % farm.coordinator.pid)
        expect(held == "/dev/null", "the coordinator's messages go to " + held)
        jobs = [farm.submit(farm.scene(), *ENDLESS) for _ in range(2)]
        for words, args, code in (("<&-", ("pause", *jobs), 2), ("<&- 2>&-", ("pause", *jobs, "--yes"), 0),
                                  ("<&- >&- 2>&-", ("resume", *jobs, "--yes"), 8)):
            ended = subprocess.run(closing(words, farm.cli_argv(*args)), stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, timeout=60)
            expect(ended.returncode == code, (words, args, ended))
            expect(code != 2 or b"give --yes" in ended.stderr, ended)
        expect([state(farm, n) for n in jobs] == ["queued"] * 2, "what was asked for is done")
        worker = subprocess.Popen(closing("<&- >&- 2>&-", [
            os.path.join(BIN, "azulejo-worker"), "--coordinator", farm.address, "--key", farm.key,
            "--threads", "1", "--cache", farm.path("cache")]))
        try:
            begun(farm, jobs[0])
            held = os.readlink("/proc/%d/fd/2" % worker.pid)
            expect(held == "/dev/null", "the worker's messages go to " + held)
        finally:
            worker.terminate()
            expect(worker.wait(60) == 0, "the worker ends in good order")
        picture = farm.path("closed.png")
        subprocess.run(closing("<&- >&- 2>&-", farm.cli_argv(
            "render", farm.scene(), "--size", "16x10", "--spp", "1", "-o", picture)), timeout=60)
        expect(os.path.exists(picture), "a picture on a farm of its own")


tests.run()
