#!/usr/bin/env python3
"""Every verb by the mouse, and what each role is offered and refused."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import BUILD, Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from pressing import confirm, field, settled, verb  # noqa: E402
from webfarm import WebFarm  # noqa: E402

tests = Tests()
SMALL = ["--size", "32x32", "--spp", "4"]
LONG = ["--size", "128x128", "--spp", "1000000"]


def info(farm, job):
    return farm.api("GET", "/jobs/%d" % job)["jobs"][0]


def state(farm, job):
    return info(farm, job)["state"]


def until(farm, page, job, wanted):
    """Wait until the job is in that state, and the page shows it."""
    wait_for(lambda: state(farm, job) == wanted, "job %d to be %s" % (job, wanted), 30)
    page.wait("document.querySelector('[data-job=\"%d\"]')?.classList.contains('%s')" % (job, wanted),
              "the page to show job %d as %s" % (job, wanted))
    settled(page)


def show(farm, page, job):
    """The job's details, with the page's own idea of it up to date."""
    page.open("%s/#/job/%d" % (farm.origin(), job))
    page.wait("location.hash === '#/job/%d'" % job)


@tests.add
def verbs_of_a_job_in_work():
    """pause, undo, priority, resume, finish, retry, cancel, cancel and discard, remove"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), *LONG)
        page = farm.page(browser, width=1600, height=1000)
        until(farm, page, job, "running")
        show(farm, page, job)
        verb(page, "Pause")
        until(farm, page, job, "paused")
        page.click("=Undo")
        until(farm, page, job, "running")
        verb(page, "Pause")
        until(farm, page, job, "paused")
        verb(page, "Resume")
        until(farm, page, job, "running")
        verb(page, "Priority")
        field(page, "Priority", "7")
        confirm(page, "Set the priority")
        wait_for(lambda: info(farm, job)["priority"] == 7, "priority 7")
        wait_for(lambda: int(info(farm, job)["samples_done"]) >= 2 * 128 * 128, "samples of the whole picture")
        verb(page, "Finish")
        until(farm, page, job, "done")
        verb(page, "Retry")
        until(farm, page, job, "running")
        verb(page, "Cancel")
        until(farm, page, job, "cancelled")
        verb(page, "Retry")
        until(farm, page, job, "running")
        verb(page, "Cancel and discard")
        page.wait_text("lost", "dialog[open]")
        confirm(page, "Keep")
        expect(state(farm, job) == "running", "it was cancelled")
        verb(page, "Cancel and discard")
        confirm(page, "Discard the samples")
        until(farm, page, job, "cancelled")
        verb(page, "Remove")
        confirm(page, "Remove")
        wait_for(lambda: farm.cli("show", job).code != 0, "the job to be gone")
        page.wait("!document.querySelector('[data-job=\"%d\"]')" % job)


@tests.add
def a_button_keeps_its_click():
    """The job's state changes while the mouse is down on a button that stays"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), *LONG)
        page = farm.page(browser, width=1600, height=1000)
        until(farm, page, job, "running")
        show(farm, page, job)
        at = page.place("#side button[aria-haspopup=menu]")
        page.mouse("mouseMoved", at["x"], at["y"])
        page.mouse("mousePressed", at["x"], at["y"], "left", 1, 1)
        farm.api("POST", "/jobs/%d/pause" % job, {}, expect=(200, 202))
        page.wait("[...document.querySelectorAll('#side button')].some(b => b.textContent === 'Resume')")
        page.mouse("mouseReleased", at["x"], at["y"], "left", 1)
        page.wait("document.querySelector('[role=menu]')", "the menu to open")
        page.report()


@tests.add
def verbs_of_waiting_and_finished_jobs():
    """start, extend, develop, retry frames; dragging a job and moving it by keys changes the order"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        worker = farm.start_worker()
        done = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(done)
        page = farm.page(browser, width=1600, height=1000)
        show(farm, page, done)
        until(farm, page, done, "done")
        verb(page, "Extend")
        field(page, "Samples", "16")
        field(page, "Error", "")
        confirm(page, "Extend")
        wait_for(lambda: int(info(farm, done)["samples_done"]) == 16 * 32 * 32, "16 samples a pixel")
        until(farm, page, done, "done")
        verb(page, "Develop")
        field(page, "Operator", "gamma")
        confirm(page, "Develop")
        wait_for(lambda: info(farm, done)["output"]["tonemap"] == "gamma", "the operator")
        worker.stop()
        first, second, third = (farm.submit(farm.scene(), *LONG, "--name", n) for n in ("first", "second", "third"))
        later = farm.submit(farm.scene(), *LONG, "--name", "later", "--after", str(first))
        show(farm, page, later)
        until(farm, page, later, "queued")
        verb(page, "Start")
        wait_for(lambda: not info(farm, later)["after"], "job 'later' to wait no more")
        order = lambda: [j["job"] for j in sorted(
            farm.api("GET", "/jobs?filter=active")["jobs"], key=lambda j: j["queue_position"])]
        wait_for(lambda: order() == [first, second, third, later], "the order of submission")
        page.wait("document.querySelectorAll('[data-job]').length === 5")
        begin, end = (page.place("[data-job=\"%d\"] a" % n) for n in (third, first))
        page.drag((begin["x"], begin["y"]), (end["x"], end["top"] + 2))
        wait_for(lambda: order()[0] == third, "the dragged job to be the first: %s" % order())


@tests.add
def verbs_that_the_coordinator_lists():
    """the page offers what each job carries, and asks for the argument of a verb that none of its files name"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator(program=os.path.join(BUILD, "row", "verb", "bin", "azulejo-coordinator"))
        job, ended = (farm.submit(farm.scene(), *LONG) for _ in range(2))
        farm.cli("cancel", ended, expect=0)
        page = farm.page(browser, width=1600, height=1000)
        show(farm, page, job)
        until(farm, page, job, "queued")
        until(farm, page, ended, "cancelled")
        for number in (job, ended):
            offered = page.js("import('/assets/verbs.js').then(async (v) => v.offered([(await import('/assets/state.js'))"
                              ".state.job(%d)]).map((o) => o.name))" % number)
            expect(offered == farm.job(number)["verbs"], "job %d: %s" % (number, offered))
        verb(page, "Salute")
        field(page, "Words", "good day")
        confirm(page, "Salute")
        wait_for(lambda: "saluted: good day" in farm.cli("log", job).out, "the log to say so")


@tests.add
def verbs_of_workers():
    """drain, resume, block, unblock; the page says what became of it"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker("--name", "ana")
        farm.wait_for_workers(1)
        page = farm.page(browser, "#/worker/ana")
        now = lambda: farm.list_workers()[0]["state"]
        for name, wanted in (("Drain", "drained"), ("Resume", "idle"), ("Block", "blocked"), ("Unblock", "idle")):
            page.click("=" + name)
            wait_for(lambda: now() == wanted, "%s: %s, not %s" % (name, now(), wanted))


@tests.add
def unblocking_a_worker_of_a_key():
    """a worker that is blocked with all of its key is unblocked with all of its key, and the page says so"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        key = farm.path("ana.key")
        farm.cli("key", "new", "ana", "--role", "worker", "--key", farm.key, "-o", key, expect=0, connect=False)
        for _ in range(2):
            farm.start_worker(key=key)
        names = wait_for(lambda: (lambda all: all if len(all) == 2 else None)(
            sorted(w["name"] for w in farm.list_workers())), "two workers of the key")
        now = lambda: {w["state"] for w in farm.list_workers()}
        farm.cli("workers", "block", "ana", expect=0)
        wait_for(lambda: now() == {"blocked"}, "both to be blocked")
        page = farm.page(browser, "#/workers")
        page.wait_text("blocked", "table")
        expect("Not connected" not in page.text("#main"), "a key is called not connected")
        page.open(farm.origin() + "/#/worker/" + names[-1])
        page.click("=Unblock")
        wait_for(lambda: now() == {"idle"}, "%s: not both are unblocked" % names)
        page.wait_text("all workers of the key ana")


@tests.add
def tokens_and_the_store():
    """an admin makes and revokes a token and collects the store; a revoked token's page asks for another"""
    with WebFarm() as farm, Browser() as browser, Browser() as other:
        farm.start_coordinator()
        page = farm.page(browser, "#/access")
        page.wait_text("this coordinator's", "tr th[scope=row]")
        expect("Renew" in page.text("#main") and "Revoke" not in page.text("#main"), "its own token cannot be revoked")
        page.click("=Create a token")
        field(page, "Name", "guest")
        field(page, "Role", "view")
        confirm(page, "Create")
        page.wait("document.querySelector('dialog[open] code')")
        farm.tokens["guest"] = page.text("dialog[open] code").strip()
        confirm(page, "I have it")
        guest = farm.page(other, role="guest")
        guest.allow("401|WebSocket|ERR_|closed")
        page.wait_text("guest")
        page.js("[...document.querySelectorAll('tr')].find(r => r.innerText.includes('guest'))"
                ".querySelector('button').click()")
        page.wait_text("guest", "dialog[open]")
        confirm(page, "Revoke")
        guest.wait("document.documentElement.dataset.connection !== 'open'", "the guest's page to lose its connection")
        answer, _ = farm.ask("GET", "/api/v1/farm", token=farm.tokens["guest"])
        expect(answer.status == 401, "the revoked token got %d" % answer.status)
        guest.wait("document.querySelector('input[type=password], input[name=token]')", "the guest to be asked for a token")
        page.open(farm.origin() + "/#/store")
        page.click("=Collect")
        page.wait_text("Removed 0 jobs")


@tests.add
def roles_are_offered_what_they_may():
    """view is offered no verbs; submit those of its own jobs; and the coordinator refuses the rest itself"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker("--name", "ana")
        other = farm.submit(farm.scene(), *LONG)
        wait_for(lambda: state(farm, other) == "running", "the job to run")
        model = info(farm, other)
        own = farm.api("POST", "/jobs", {
            "name": "own", "scene": model["scene"], "settings": model["settings"], "output": model["output"],
            "first_frame": 1, "last_frame": 1}, role="submit", expect=(200, 201))["job"]
        offers = "['Pause', 'Resume', 'Finish', 'Cancel', 'More', 'Drain', 'Block', 'Collect', 'Remove']"
        count = ("[...document.querySelectorAll('button')].filter(b => b.checkVisibility() && %s.includes("
                 "b.textContent.trim())).length" % offers)
        refused = {"view": [("POST", "/jobs/%d/pause" % other), ("POST", "/jobs/%d/pause" % own), ("POST", "/jobs"),
                            ("POST", "/workers/ana/drain"), ("POST", "/tokens"), ("POST", "/store/collect")],
                   "submit": [("POST", "/jobs/%d/pause" % other), ("DELETE", "/jobs/%d" % other),
                              ("POST", "/workers/ana/drain"), ("POST", "/tokens")],
                   "operate": [("POST", "/tokens"), ("GET", "/tokens"), ("POST", "/store/collect")]}
        for role, requests in refused.items():
            page = farm.page(browser, "#/job/%d" % other, role=role, width=1600, height=1000)
            page.allow("403")
            page.wait_text("tiny")
            page.frames()
            expect((page.js(count) > 0) == (role == "operate"), "%s is offered %d verbs" % (role, page.js(count)))
            show(farm, page, own)
            page.wait_text("own")
            if role == "view":
                page.frames(5)
                expect(page.js(count) == 0, "view is offered verbs of another's job")
            else:
                page.wait(count, "%s to be offered verbs of the job" % role)
            for method, path in requests:
                got = page.js("fetch('/api/v1%s', {method: '%s', headers: {'content-type': 'application/json'}%s})"
                              ".then(r => r.json().then(p => [r.status, p.detail]))" % (
                                  path, method, ", body: '{}'" if method == "POST" else ""))
                expect(got[0] == 403 and got[1], "%s: %s %s: %s" % (role, method, path, got))
            page.allow("401")  # what it asked before it was signed out
            page.js("fetch('/api/v1/session', {method: 'DELETE'})")
            page.close()
        expect(state(farm, other) == "running" and farm.list_workers()[0]["state"] != "drained", "it was done")


if __name__ == "__main__":
    tests.run()
