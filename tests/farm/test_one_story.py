"""`list`, `show`, their JSON, the page's API and the files tell one story about a job, in each of its states."""
import json
import math
import os
import re
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests, wait_for
from jobs import AREA, expect
from odd import OddPeer, die_of
from page import Page, need_page

tests = Tests()
SAME = ("state", "frames_done", "verbs", "stop", "finished_early", "missed")
STANDING = ("now", "now_frame", "error_slope", "forecasts", "efficiency", "seconds_left")  # while nobody works on it
MOVING = ("done_share", "core_seconds", "samples_done")  # they may grow between two questions


def near(a, b):
    return math.isclose(a, b, rel_tol=0.02, abs_tol=0.02)


def row_of(farm, number):
    """The job's line of `azulejo list`, by title."""
    lines = farm.cli("list", expect=0).out.splitlines()
    line = next(l for l in lines[1:] if l.split()[0] == str(number))
    return line


def check(farm, page, number, state):
    """All say the same; returns what."""
    job = farm.job(number)
    listed = next(j for j in farm.cli("list", "--json", expect=0).json()["jobs"] if j["job"] == number)
    shown = page.get("/api/v1/jobs/%d" % number).json()
    shown = shown.get("jobs", [shown])[0]
    expect(job["state"] == state, job["state"])
    for other in (listed, shown):
        for key in SAME:
            expect(other.get(key) == job.get(key), "%s: %s: %s, not %s" % (state, key, other.get(key), job.get(key)))
        for key in MOVING:
            expect(state == "running" or near(other[key], job[key]), "%s: %s: %s, not %s" % (state, key, other[key], job[key]))
    row = row_of(farm, number)
    expect(" %s " % state in row, row)
    expect(state == "running" or " %d %% " % int(100 * job["done_share"]) in row, (row, job["done_share"]))
    words = farm.cli("show", number, expect=0).out
    expect(state in words, state)
    if state != "running":
        for other in (listed, shown):
            for key in STANDING:
                expect(other.get(key) == job.get(key), "%s: %s: %s, not %s" % (state, key, other.get(key), job.get(key)))
        figures = (job.get("now") or {}).get("figures")
        error = re.search(r" (\d\S*/255)(\?| |$)", row)
        expect(bool(error) == bool(figures), (row, figures))
        expect(not figures or ("  error       %s " % error[1] in words or ": %s (" % error[1] in words), (row, words))
    return job


def wait_until_closed(farm, number):
    """A paused job's frame is closed a moment after its last result; its answers stand still from then on."""
    wait_for(lambda: farm.job(number)["workers"] == 0 and not farm.job(number)["preview_ready"], "its frame to be closed")


def kept(farm, page, number, state, before):
    """What is known of the picture's error outlives the work on it, and a restart of the coordinator."""
    job = check(farm, page, number, state)
    expect(job.get("now") and job["now"]["samples"] >= before["now"]["samples"], (state, job.get("now"), before["now"]))
    farm.coordinator.stop()  # what nobody was answered need not be on disk when it is killed
    farm.restart_coordinator()
    page = Page(farm.coordinator)
    again = check(farm, page, number, state)
    for seen in (job, again):
        expect(seen["core_seconds"] >= 0.9 * before["now"]["core_seconds"] and seen["done_share"] > 0 and seen["samples_done"] > 0, (state, seen))
    expect(again.get("now") and again["now"]["figures"] == job["now"]["figures"] and again["now_frame"] == job["now_frame"],
           (state, again.get("now"), job["now"]))
    return page


@tests.add
def a_job_that_rests_keeps_its_error():
    """paused, parked, cancelled, failed: the last known error stays in list, show, JSON and on the page"""
    need_page()
    with Farm() as farm:
        page = Page(farm.start_coordinator())

        def begin():
            worker = farm.start_worker(threads=2, rests=False)
            number = farm.submit(AREA, "--size", "96x72", "--spp", "65536", "--allocation", "uniform")
            wait_for(lambda: (farm.job(number).get("now") or {}).get("figures"), "an error", 120)
            return worker, number, farm.job(number)

        worker, number, before = begin()
        farm.cli("pause", number, expect=0)
        wait_until_closed(farm, number)
        page = kept(farm, page, number, "paused", before)
        farm.cli("cancel", number, expect=0)
        farm.wait_for_job(number, "cancelled")
        page = kept(farm, page, number, "cancelled", before)
        worker.stop()
        worker, number, before = begin()
        worker.stop()
        for death in range(4):
            expect(die_of(farm, "machine-%d" % (death % 2)) == number, "another job")
        farm.wait_for_job(number, "parked")
        page = kept(farm, page, number, "parked", before)
        worker, number, before = begin()
        worker.stop()
        peer = OddPeer(farm)
        peer.say("request 1")
        expect(peer.grant()["job"] == number, "another job")
        peer.say("broken code=4")
        farm.wait_for_job(number, "failed")
        peer.end()
        page = kept(farm, page, number, "failed", before)
        farm.cli("retry", number, expect=0)  # it goes on with its films
        kept(farm, page, number, "queued", before)


def spent(farm, number):
    points = farm.cli("show", number, "--history", "--json", expect=0).json()["points"]
    return points[-1]["core_seconds"] if points else 0


@tests.add
def every_state_is_one_story():
    """a job that ends by a target: queued, running, paused, resumed, finished early"""
    need_page()
    with Farm() as farm:
        farm.start_coordinator()
        page = Page(farm.coordinator)
        number = farm.submit(AREA, "--size", "96x72", "--spp", "65536", "--target-error", "0.3/255")
        job = check(farm, page, number, "queued")
        expect(job["done_share"] == 0 and job["core_seconds"] == 0, job)
        farm.start_worker(threads=2, rests=False)
        wait_for(lambda: farm.job(number)["done_share"] > 0.01 and spent(farm, number) > 1.2, "a part of the job", 120)
        check(farm, page, number, "running")
        before = farm.job(number)
        farm.cli("pause", number, expect=0)
        wait_until_closed(farm, number)
        paused = check(farm, page, number, "paused")
        expect(paused["done_share"] >= 0.8 * before["done_share"] > 0, (paused["done_share"], before["done_share"]))
        expect(paused["core_seconds"] >= before["core_seconds"] > 1, (paused["core_seconds"], before["core_seconds"]))
        farm.coordinator.kill()
        farm.restart_coordinator()
        page = Page(farm.coordinator)
        again = check(farm, page, number, "paused")
        expect(again["core_seconds"] >= 0.5 * paused["core_seconds"], (again["core_seconds"], paused["core_seconds"]))
        farm.wait_for_workers(1)
        farm.cli("resume", number, expect=0)
        wait_for(lambda: farm.job(number)["core_seconds"] > paused["core_seconds"] + 0.5, "more work", 120)
        check(farm, page, number, "running")
        farm.cli("finish", number, expect=0)
        farm.wait_for_job(number)
        done = check(farm, page, number, "done")
        expect(done["done_share"] == 1 and done["finished_early"], done["done_share"])
        expect("extend" in done["verbs"], done["verbs"])
        picture = read_exr(next(f for f in farm.fetch(number) if f.endswith(".exr")))
        measured = json.loads(picture.attributes["azulejo:measured"].decode())
        expect(near(measured["cpu_seconds"], done["core_seconds"]), (measured, done["core_seconds"]))
        expect(near(done["now"]["core_seconds"], done["core_seconds"]), (done["now"], done["core_seconds"]))


def told_by_files(farm, number):
    """What the picture's header and its manifest say: core-seconds, and the error."""
    picture = read_exr(next(f for f in farm.fetch(number) if f.endswith(".exr")))
    folder = farm.path("manifest-%d-%d" % (number, len(os.listdir(farm.folder))))
    farm.cli("fetch", number, "-o", folder, "--manifest", expect=0)
    with open(os.path.join(folder, next(f for f in os.listdir(folder) if f.endswith(".effects.json"))), encoding="utf-8") as file:
        manifest = json.load(file)
    return json.loads(picture.attributes["azulejo:measured"].decode()), picture.number("azulejo:errorDisplay"), manifest


@tests.add
def what_was_extended_is_one_story():
    """cancelled, tried again over a restart, and extended: core-seconds are summed, files and lists have one error"""
    need_page()
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker(threads=2, rests=False)
        number = farm.submit(AREA, "--size", "96x72", "--spp", "65536", "--allocation", "uniform")
        wait_for(lambda: farm.job(number)["core_seconds"] > 0.5, "some work", 120)
        check(farm, page, number, "running")
        farm.cli("cancel", number, expect=0)
        farm.wait_for_job(number, "cancelled")
        cancelled = check(farm, page, number, "cancelled")
        expect(0 < cancelled["done_share"] < 1 and cancelled["core_seconds"] > 0.5, cancelled)
        farm.coordinator.kill()
        farm.restart_coordinator()
        page = Page(farm.coordinator)
        farm.wait_for_workers(1)
        again = check(farm, page, number, "cancelled")
        expect(again["stats"].get("accounts") and again["stats"]["effects"] == cancelled["stats"]["effects"], "the time of effects, after a restart")
        expect(near(again["core_seconds"], cancelled["core_seconds"]), (again["core_seconds"], cancelled["core_seconds"]))
        farm.cli("retry", number, expect=0)
        wait_for(lambda: farm.job(number)["core_seconds"] > cancelled["core_seconds"] + 0.5, "more work", 120)
        check(farm, page, number, "running")
        farm.cli("finish", number, expect=0)
        farm.wait_for_job(number)
        done = check(farm, page, number, "done")
        expect(done["core_seconds"] > cancelled["core_seconds"] + 0.5, (done["core_seconds"], cancelled["core_seconds"]))
        measured, error, manifest = told_by_files(farm, number)
        expect(near(measured["cpu_seconds"], done["core_seconds"]), (measured, done["core_seconds"]))
        expect(near(error, done["now"]["figures"]["display"]) and near(manifest["error"]["display"], error), (error, done["now"]))
        farm.cli("extend", number, "--spp", "131072", expect=0)
        wait_for(lambda: farm.job(number)["core_seconds"] > done["core_seconds"] + 0.5, "more work", 120)
        extended = check(farm, page, number, "running")
        expect(extended["done_share"] < 1, extended["done_share"])
        farm.cli("finish", number, expect=0)
        farm.wait_for_job(number)
        last = check(farm, page, number, "done")
        measured, error, manifest = told_by_files(farm, number)
        expect(near(measured["cpu_seconds"], last["core_seconds"]) and last["core_seconds"] > done["core_seconds"] + 0.5, (measured, last["core_seconds"]))
        expect(near(error, last["now"]["figures"]["display"]), (error, last["now"]))


@tests.add
def what_has_no_film_is_not_extended():
    """a done job whose films are gone offers no `extend`"""
    need_page()
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker(threads=2, rests=False)
        number = farm.submit(AREA, "--size", "32x32", "--spp", "16")
        farm.wait_for_job(number)
        expect("extend" in check(farm, page, number, "done")["verbs"], "there is a film")
        farm.cli("prune", number, "--films", "--yes", expect=0)
        done = check(farm, page, number, "done")
        expect("extend" not in done["verbs"], done["verbs"])
        expect(farm.cli("extend", number, "--spp", "64").code != 0, "extended without a film")


@tests.add
def a_pause_does_not_slow_what_follows():
    """the time left after a pause goes by the speed of the work, not by the time that passed"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(rests=False)
        number = farm.submit(AREA, "--size", "160x120", "--spp", "16384", "--allocation", "uniform")
        wait_for(lambda: farm.job(number)["seconds_left"] > 0 and farm.job(number)["seconds_active"] > 3, "a rate", 60)
        farm.cli("pause", number, expect=0)
        wait_until_closed(farm, number)
        before = farm.job(number)["seconds_active"]
        time.sleep(15)  # the pause itself is what is tested
        farm.cli("resume", number, expect=0)
        job = wait_for(lambda: (lambda j: j if j["seconds_left"] > 0 and j["cores"] > 0 and
                                j["seconds_active"] > before + 1 else None)(farm.job(number)), "a rate again", 60)
        # Both are of the same results. Counted over the pause as well, the first would be a fifth of the other.
        farm.cli("cancel", number, expect=0)
        expect(job["cores"] > 0.5 * job["core_seconds"] / job["seconds_active"], job)


tests.run()
