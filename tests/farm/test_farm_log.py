"""The log of the whole farm: one list with numbers that go on after a restart, by the API, the command line and live; and
previews that are tone mapped otherwise."""
import contextlib
import json
import sqlite3
import sys
import urllib.request

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Tests, read_bytes, wait_for
from jobs import expect
from page import Page
from png import Png

tests = Tests()
SMALL = ["--size", "32x24", "--spp", "4"]


def lines(farm, *options):
    return [json.loads(line) for line in farm.cli("log", *options, "--json", expect=0).out.splitlines()]


def ask(page, path):
    answer = page.get(path)
    expect(answer.status == 200, answer)
    return json.loads(answer.body)


def with_worker(events):
    """The events; None: the worker's line on the scene is not among them yet."""
    return events if any(e["from_worker"] for e in events) else None


def last_stored(farm):
    with contextlib.closing(sqlite3.connect("file:%s?mode=ro" % farm.path("store", "queue.sqlite"), uri=True)) as db:
        return db.execute("SELECT max(seq) FROM events").fetchone()[0]


@tests.add
def one_log_of_all_jobs():
    """GET /log and log --all: every job's events in their order, after a number, the newest, and over a restart"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker()
        jobs = [farm.submit(farm.scene(), *SMALL, "--name", "n%d" % i) for i in range(3)]
        for job in jobs:
            farm.wait_for_job(job)
        everything = wait_for(lambda: with_worker(lines(farm, "--all")), "the worker's line, which may come last")
        numbers = [e["seq"] for e in everything]
        expect(numbers == sorted(set(numbers)) and {e["job"] for e in everything} == set(jobs), everything)
        for job in jobs:
            expect([e for e in everything if e["job"] == job] == lines(farm, job), "job %d's own log" % job)
        expect("job %d  " % jobs[1] in farm.cli("log", "--all", expect=0).out, "as text")
        answer = ask(page, "/api/v1/log?after=%d" % numbers[2])
        expect([e["seq"] for e in answer["events"]] == numbers[3:] and not answer["more"], answer)
        expect([e["seq"] for e in ask(page, "/api/v1/log?newest=2")["events"]] == numbers[-2:], "the newest")
        expect(page.get("/api/v1/log?newest=1001").status == 422, "too many at a time")
        expect(page.get("/api/v1/jobs/0/log").status == 404, "there is no job 0")
        wrong = farm.cli("log", "--all", jobs[0], expect=2)
        expect("leave out" in wrong.err and "--all" in farm.cli("log", expect=2).err, wrong)

        wait_for(lambda: last_stored(farm) >= numbers[-1], "the last line to be on disk")
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.cli("remove", jobs[0], "--yes", expect=0)
        farm.cli("submit", farm.scene(), *SMALL, expect=0)
        new = lines(farm, "--all")
        expect([e for e in new if e["seq"] <= numbers[-1]] == [e for e in everything if e["job"] != jobs[0]], "the old ones")
        expect(len([e for e in new if e["seq"] > numbers[-1]]) >= 1, "and new ones")


@tests.add
def it_is_read_in_parts():
    """more than 1,000 events: `more` says so, and log --all prints them all"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        first, second = (farm.submit(farm.scene(), *SMALL) for _ in range(2))
        for i in range(1, 520):
            for job in (first, second):
                page.post("/api/v1/jobs/%d/priority" % job, {"priority": i})
        part = ask(page, "/api/v1/log")
        expect(len(part["events"]) == 1000 and part["more"], len(part["events"]))
        rest = ask(page, "/api/v1/log?after=%d" % part["events"][-1]["seq"])
        expect(not rest["more"] and len(rest["events"]) == 1040 - 1000, len(rest["events"]))
        expect(len(lines(farm, "--all")) == 1040, "all of them")


@tests.add
def live_events_have_their_numbers():
    """a `log` event of the event stream has the number that the stored one has"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        stream = urllib.request.urlopen(urllib.request.Request(
            page.origin + "/api/v1/events", headers={"Authorization": "Bearer " + page.token}), timeout=20)
        job = farm.submit(farm.scene(), *SMALL)
        farm.cli("pause", job, expect=0)
        live, kind = [], b""
        while len(live) < 2:
            line = stream.readline().strip()
            if line.startswith(b"event: "):
                kind = line[7:]
            elif line.startswith(b"data: ") and kind == b"log":
                live.append(json.loads(line[6:]))
        expect(live == ask(page, "/api/v1/log")["events"][:2] and live[0]["seq"] > 0, live)


@tests.add
def a_preview_otherwise():
    """fetch --preview --tonemap, --exposure: as the API gives it; the job's own without; the job stays as it is"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker()
        job = farm.submit(farm.scene(), *SMALL, "--tonemap", "reinhard02")
        farm.wait_for_job(job)
        base = "/api/v1/jobs/%d/frames/1/preview.png" % job

        def fetched(*options):
            path = farm.path("preview.png")
            farm.cli("fetch", job, "--preview", path, *options, expect=0)
            return Png(read_bytes(path)).codes

        def given(query):
            return Png(page.get(base + query).body).codes
        own = fetched()
        expect(own == given(""), "the job's own")
        for options, query in ((("--tonemap", "aces"), "?tonemap=aces"), (("--exposure", "1"), "?exposure=1"),
                               (("--tonemap", "drago03", "--exposure", "-1", "--tonemap-param", "bias=0.6"),
                                "?tonemap=drago03&exposure=-1&param.bias=0.6"),
                               (("--white-balance", "3000", "--no-dither"), "?white_kelvin=3000&no_dither=1")):
            other = fetched(*options)
            expect(other == given(query), "%s is %s" % (options, query))
            expect(other != own, "%s changes it" % (options,))
        expect(fetched() == own, "the job stays as it is")
        expect("--preview" in farm.cli("fetch", job, "--tonemap", "aces", expect=2).err, "without a preview")
        expect("--preview" in farm.cli("fetch", job, "--preview", "x.exr", "--tonemap", "aces", expect=2).err, "linear")
        expect("give --tonemap" in farm.cli("fetch", job, "--preview", "x.png", "--tonemap-param", "bias=1", expect=2).err, "whose")


tests.run()
