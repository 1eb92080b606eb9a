#!/usr/bin/env python3
"""The page at its edges: what is asked while the coordinator restarts, what is removed while it is shown, names that are hard
to show, a browser that keeps nothing, and links to what is not there."""
import json
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from disk import SmallDisk, fill_up  # noqa: E402
from farm import Skip, Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from pressing import field, press_in, verb  # noqa: E402
from webfarm import WebFarm, connected  # noqa: E402

tests = Tests()
LONG = ["--size", "64x64", "--spp", "1000000"]
LOST = "WebSocket|ERR_|Failed to fetch|404|401"
PICTURE = "document.getElementById('picture').picture"


def clear(page):
    """No message is shown any more."""
    page.js("for (const id of ['said', 'refused']) document.getElementById(id).replaceChildren()")


def remove(farm, page, job):
    """Somebody else removes a job; the page knows."""
    farm.cli("cancel", job, "--discard", "--yes", expect=0)
    farm.wait_for_job(job, "cancelled")
    farm.cli("remove", job, "--yes", expect=0)
    page.wait("!document.querySelector('[data-job=\"%d\"]')" % job, "the page to know of the removal")


def down(farm, page):
    """The coordinator is gone, and the page has seen it."""
    farm.coordinator.kill()
    page.wait("document.documentElement.dataset.connection === 'lost'", "the page to lose the connection")


def refused(page, words):
    """The open question says so, and can be answered again."""
    page.wait("document.querySelector('dialog[open] .problem')?.textContent.includes(%s)"
              " && !document.querySelector('dialog .primary').disabled" % json.dumps(words), words)


def answer(page, name):
    press_in(page, "dialog[open]", name)


@tests.add
def a_restart_while_something_is_asked():
    """what was written and chosen stays while the coordinator restarts; why it failed is said; nothing is done twice"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        job = farm.submit(farm.scene(), *LONG, "--name", "kitchen")
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        page.allow(LOST)
        verb(page, "Priority")
        field(page, "Priority", "42")
        down(farm, page)
        answer(page, "Set the priority")
        refused(page, "not known whether this was done")
        expect(not page.text("#refused"), "said twice: " + page.text("#refused"))
        farm.restart_coordinator()
        connected(page)
        expect(page.js("document.querySelector('dialog input').value") == "42", "what was written is lost")
        answer(page, "Set the priority")
        wait_for(lambda: farm.job(job)["priority"] == 42, "the priority")
        page.wait("!document.querySelector('dialog')", "the question to go")
        page.open(farm.origin() + "/#/access")
        page.click("=Create a token")
        field(page, "Name", "guest")
        field(page, "Role", "view")
        down(farm, page)
        answer(page, "Create")
        refused(page, "not known whether this was done")
        farm.restart_coordinator()
        connected(page)
        expect(page.js("[...document.querySelectorAll('dialog :is(input, select)')].slice(0, 2).map(e => e.value)") == ["guest", "view"],
               "what was chosen is lost")
        page.js("for (let i = 0; i < 3; i++) document.querySelector('dialog form').requestSubmit()")  # an impatient person
        page.wait("document.querySelector('dialog.secret code')", "the secret")
        made = [t for t in farm.api("GET", "/tokens")["tokens"] if t["name"] == "guest"]
        expect(len(made) == 1, "%d tokens were made" % len(made))
        page.press("Escape")
        page.wait("!document.querySelector('dialog')", "the secret to go")
        page.open(farm.origin() + "/#/submit")
        page.give_files("#pick-files", [farm.scene()])
        page.wait("document.querySelector('#scene option')", "the scene")
        page.js("document.querySelector('[name=name]').value = 'again'")
        down(farm, page)
        page.click("form.submit .primary")
        page.wait("document.querySelector('form.submit .problem').textContent.includes('does not answer')", "why")
        farm.restart_coordinator()
        connected(page)
        expect(page.js("[document.querySelector('[name=name]').value, document.querySelector('#scene').value]") ==
               ["again", "tiny.gltf"], "the form is empty")
        page.click("form.submit .primary")
        page.wait("location.hash === '#/job/%d'" % (job + 1), "the job")
        expect(len(farm.api("GET", "/jobs?filter=all")["jobs"]) == 2, "it was submitted twice")


@tests.add
def a_job_is_removed_under_the_hand():
    """menu, question, undo, drag, picture and log of a job that somebody removed say so, and do nothing"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        worker = farm.start_worker()
        jobs = [farm.submit(farm.scene(), *LONG, "--name", "job-" + n) for n in "abcdef"]
        page = farm.page(browser, "#/job/%d" % jobs[0], width=1600, height=1000)
        page.allow(LOST)
        gone = "removed"
        page.wait("%s?.pixels?.arrived" % PICTURE, "the picture")
        # By the keyboard: what is above it comes meanwhile, and the mouse would let go beside it.
        page.wait("(f => { f?.focus(); return f && document.activeElement === f; })(document.querySelector('#side details:last-of-type summary'))", "Log")
        page.press("Enter")
        page.wait("document.querySelector('#side .log li')", "the log")
        worker.stop()
        remove(farm, page, jobs[0])
        page.wait_text("There is no such job", "#side")
        page.wait_text("The job was removed", "#picture")

        page.js("location.hash = '#/job/%d'" % jobs[1])
        page.wait_text("job-b", "#side")
        page.wait("!/was removed/.test(document.getElementById('picture').innerText)", "the note to go")
        verb(page, "Pause")
        page.wait("document.querySelector('#said button')", "the way back")
        press_in(page, "#side", "More")
        page.wait("document.querySelector('[role=menu]')", "the menu")
        remove(farm, page, jobs[1])
        page.js("document.querySelector('[role=menu] button').click()")
        page.wait_text(gone, "#refused")
        clear(page)

        page.js("location.hash = '#/job/%d'" % jobs[2])
        page.wait_text("job-c", "#side")
        verb(page, "Pause")
        page.wait("document.querySelector('#said button')", "the way back")
        remove(farm, page, jobs[2])
        page.js("document.querySelector('#said button').click()")
        page.wait_text(gone, "#refused")
        clear(page)

        page.js("location.hash = '#/job/%d'" % jobs[3])
        page.wait_text("job-d", "#side")
        verb(page, "Priority")
        field(page, "Priority", "9")
        remove(farm, page, jobs[3])
        answer(page, "Set the priority")
        refused(page, "no job %d" % jobs[3])
        answer(page, "Back")

        extra = [farm.submit(farm.scene(), *LONG, "--name", "job-" + n) for n in "gh"]
        rest = jobs[4:] + extra
        page.wait("document.querySelectorAll('[data-job]').length === 4", "four jobs")
        begin, end = (page.place("[data-job=\"%d\"] a" % n) for n in (rest[3], rest[1]))
        page.drag_data = None
        page.call("Input.setInterceptDrags", {"enabled": True})
        page.mouse("mouseMoved", begin["x"], begin["y"])
        page.mouse("mousePressed", begin["x"], begin["y"], button="left", clicks=1, held=1)
        for step in (2, 8, 16, 24):
            if not page.drag_data:
                page.mouse("mouseMoved", begin["x"], begin["y"] - step, button="left", held=1)
        page.pump_until(lambda: page.drag_data, "the drag to begin")
        page.drop_event("dragEnter", end["x"], end["top"] + 50)
        page.drop_event("dragOver", end["x"], end["top"] + 50)
        page.wait("document.querySelector('.below, .above')", "the mark")
        remove(farm, page, rest[3])
        page.drop_event("dragOver", end["x"], end["top"] + 50)
        page.drop_event("drop", end["x"], end["top"] + 50)
        page.mouse("mouseReleased", end["x"], end["top"] + 50, button="left", clicks=1)
        page.call("Input.setInterceptDrags", {"enabled": False})
        page.wait_text("removed meanwhile: nothing was moved", "#said")
        expect([farm.job(n)["priority"] for n in rest[:3]] == [0] * 3, "others were moved")


# Names as a person writes them, or somebody who wants harm. A line break, and what turns text around, becomes a "?" at
# the coordinator.
NAMES = {"long": "x" * 255, "words": "kitchen " * 31, "reversed": "\u05de\u05d8\u05d1\u05d7 " * 20, "override": "abc\u202egnp.exe",
         "emoji": "\U0001f469\u200d\U0001f467" * 20, "marks": "e" + "\u0301" * 120, "markup": "<img src=x onerror=alert(1)>",
         "spaces": "     ", "nothing": "\u200b\u2060"}
WORKER = "w" * 63
# Elements that reach beyond the window, or whose text reaches beyond them, and that nothing cuts off or scrolls.
SPILLS = """(() => { const out = new Set(), cut = e => /hidden|auto|scroll|clip/.test(getComputedStyle(e).overflowX);
  for (const e of document.querySelectorAll('body *')) {
    if (!e.checkVisibility() || e.closest('svg')) continue;
    const r = e.getBoundingClientRect(), name = `${e.tagName}#${e.id}.${e.className} of ${e.parentElement.id}`;
    let p = e; while (p && !cut(p)) p = p.parentElement;
    if (r.width > 1 && (r.right > innerWidth + 1 || r.left < -1) && !p) out.add(name + ' at ' + Math.round(r.right));
    if (e.clientWidth > 1 && e.scrollWidth > e.clientWidth + 1 && !cut(e) && getComputedStyle(e).display !== 'inline') out.add(name + ' has ' + e.scrollWidth);
  }
  return [...out].slice(0, 8); })()"""
VIEWS = ["#/workers", "#/worker/" + WORKER, "#/events", "#/store", "#/access", "#/submit"]


@tests.add
def names_that_are_hard_to_show():
    """long, reversed, empty names and markup: wide, on a phone and at 200 % nothing overflows, titles have all of it"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker("--name", WORKER)
        model = farm.api("GET", "/jobs/%d" % farm.submit(farm.scene(), *LONG))["jobs"][0]
        jobs = {what: farm.api("POST", "/jobs", {
            "name": name, "scene": model["scene"], "settings": model["settings"], "output": model["output"], "first_frame": 1,
            "last_frame": 1, "owner": "o" * 100 + "@host"}, expect=(200, 201))["job"] for what, name in NAMES.items()}
        farm.api("POST", "/tokens", {"name": "t" * 63, "role": "view", "owner": "o" * 120 + "@host"}, expect=(200, 201))
        page = farm.page(browser, width=1600, height=1000)
        faults = []

        def look(where):
            page.frames(3)
            faults.extend("%s: %s" % (where, spill) for spill in page.js(SPILLS))
        for width, height, scale, phone in ((1600, 1000, 1, False), (640, 400, 2, False), (390, 844, 1, True)):
            page.size(width, height, scale, phone)
            for what in ("long", "reversed", "marks"):
                page.js("location.hash = '#/job/%d'" % jobs[what])
                page.wait("%s?.known === %d" % (PICTURE, jobs[what]), what)
                for tab in ("details", "picture", "queue", "workers")[:4 if what == "long" else 1] if width < 800 else ("picture", ):
                    page.js("document.querySelector('#tabs [data-tab=%s]').click()" % tab)
                    look("%s, %d wide, %s" % (what, width, tab))
            for view in VIEWS:
                page.js("location.hash = '%s'" % view)
                page.wait_text("Workers|Events|Store|Token|Submit a scene", "#view")
                look("%s, %d wide" % (view, width))
            for what in ("long", "reversed"):
                page.js("location.hash = '#/job/%d'" % jobs[what])
                page.press("P")
                page.wait("document.querySelector('dialog[open]')", "a question")
                look("question about %s, %d wide" % (what, width))
                page.press("Escape")
                page.wait("!document.querySelector('dialog')", "the question to go")
                page.press("J")
                page.wait("document.querySelector('#said .notice')", "a message")
                look("message about %s, %d wide" % (what, width))
                clear(page)
        expect(not faults, "\n".join(faults))
        for what, job in jobs.items():
            row, name = "[data-job=\"%d\"] " % job, NAMES[what]
            seen = page.js("[document.querySelector('%sa').title, document.querySelector('%s.name').textContent]" % (row, row))
            wanted = name.replace("\u202e", "?") if what not in ("spaces", "nothing") else "job %d" % job
            expect(seen[0].startswith("job %d: %s\n" % (job, wanted)) and seen[1] == wanted, "%s: %s" % (what, seen))
        page.js("location.hash = '#/job/%d'" % jobs["reversed"])
        page.press("P")
        page.wait("/\\u2068\\u05de.*\\u2069$/.test(document.querySelector('dialog[open] h2')?.textContent)",
                  "the name to turn nothing but itself around")
        chip = page.js("document.querySelector('#workers li a').title")
        expect(chip.startswith(WORKER), "the worker's title: " + chip)


# A browser that keeps nothing for this address, whose clock is a day late and is then set a day back.
FORGETFUL = """for (const name of ['localStorage', 'sessionStorage'])
      Object.defineProperty(window, name, {get() { throw new DOMException('denied', 'SecurityError'); }});
    window.BroadcastChannel = class { constructor() { throw new DOMException('denied', 'SecurityError'); } };
    { const now = Date.now; window.late = 86400e3; Date.now = () => now() - late; }"""


@tests.add
def a_browser_that_keeps_nothing():
    """storage refused, the clock wrong and set meanwhile, no motion wanted: the page works, its ages are right"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        jobs = [farm.submit(farm.scene(), *LONG, "--name", n) for n in ("first", "second")]
        page = browser.page(width=1600, height=1000, still=True)
        page.allow("404.*/tiles")  # of a job that has not begun
        page.call("Page.addScriptToEvaluateOnNewDocument", {"source": FORGETFUL})
        page.open("%s/#token=%s" % (farm.origin(), farm.token("start")))
        connected(page)
        page.open("%s/#/job/%d" % (farm.origin(), jobs[0]))
        page.wait_text("submitted just now", "#side")
        page.click("#theme")
        page.wait("document.documentElement.dataset.theme === 'dark'", "the theme")
        page.click("=mine 2")
        page.wait("%s?.pixels?.arrived" % PICTURE, "the picture")
        page.js("(() => { const s = %s.controls.overlay; s.value = 'workers'; s.dispatchEvent(new Event('change')); })()" % PICTURE)
        page.wait("%s.map" % PICTURE, "who rendered what")
        asked = "performance.getEntriesByType('resource').filter(r => r.name.includes('/tiles')).length"
        before = page.js("(() => { late += 86400e3; return %s; })()" % asked)
        page.wait("%s > %d + 1" % (asked, before), "to be asked again after the clock was set")
        moving = page.js("[...document.querySelectorAll('*')].filter(e => getComputedStyle(e).transitionDuration !== '0s').length")
        expect(moving == 0, "%d elements move" % moving)
        page.js("import('/assets/dom.js').then(d => { document.body.append(Object.assign(d.moment(d.clockNow()), {id: 'now'})); })")
        page.wait("document.getElementById('now')?.textContent === 'just now'", "the right age")
        page.js("for (let i = 0; i < 30; i++) location.hash = i % 2 ? '#/workers' : `#/job/${i % 4 ? 1 : 2}`")
        for _ in range(29):
            page.back()
        page.wait("location.hash === '#/job/2'", "the first of thirty")
        page.wait_text("second", "#side")
        for _ in range(28):
            page.js("history.forward()")
        page.wait_text("second", "#side")
        page.wait("location.hash === '#/job/2'", "the last but one")


@tests.add
def links_to_what_is_not_there():
    """a frame that the job has not, a job of another person or none, and pictures of a pixel: each says what it is"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        worker = farm.start_worker()
        walk = farm.submit(farm.scene(), "--size", "16x16", "--spp", "2", "--frames", "3-5", "--name", "walk")
        one = farm.submit(farm.scene(), "--size", "1x1", "--spp", "1", "--name", "one")
        wide = farm.submit(farm.scene(), "--size", "16x3", "--spp", "16", "--name", "wide")
        for job in (walk, one, wide):
            farm.wait_for_job(job)
        page = farm.page(browser, "#/job/%d/frame/99" % walk, role="view", width=1600, height=1000)
        page.allow(LOST)
        page.wait_text("walk has no frame 99: it has frames 3 to 5", "#said")
        page.wait("location.hash === '#/job/%d'" % walk, "the job")
        page.wait_text("frame [345] / 5", "#side")
        asked = [r["url"] for r in page.requests if "/frames/99" in r["url"]]
        expect(not asked, "the frame was asked for: %s" % asked)
        page.open("%s/#/job/999" % farm.origin())
        page.wait_text("There is no such job", "#side")
        for job, size in ((one, "1 by 1"), (wide, "16 by 3")):
            page.js("location.hash = '#/job/%d'" % job)
            page.wait("%s.pixels?.arrived === 1 && %s.canvas.getAttribute('aria-label').includes('%s pixels')" % (PICTURE, PICTURE, size), size)
            fitted = page.js("%s.view.scale" % PICTURE)
            page.press("+")
            expect(page.js("%s.view.scale" % PICTURE) >= min(fitted, 64), "+ makes it smaller")
            page.press("0", "-")
            page.wait("%s.view.scale < %g" % (PICTURE, fitted), "- to make it smaller")
        page.js("location.hash = '#/job/%d'" % one)
        page.wait_text("too few samples to know.*No figures: the frame ended before.*Nothing was measured", "#side")
        worker.stop()


@tests.add
def signed_out_elsewhere():
    """another tab signs out, or the token is revoked: open questions and menus go, why is said, and nothing is asked any more"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), *LONG)
        page = farm.page(browser, "#/job/%d" % job, role="operate", width=1600, height=1000)
        other = browser.page("%s/#/workers" % farm.origin(), width=1600, height=1000)
        for each in (page, other):
            each.allow(LOST)
            connected(each)
        page.wait("%s?.pixels?.arrived" % PICTURE, "the picture")
        verb(page, "Priority")
        field(page, "Priority", "3")
        other.click("#who")
        other.click("=Sign out")
        page.wait_text("signed out in another tab", "main.login .problem")
        page.wait("document.activeElement.id === 'token'", "the form to have the focus")
        expect(page.find("dialog[open]") == 0, "a question of nobody is open")
        page.frames(5)
        before = len(page.requests)
        other.wait("document.querySelector('main.login')", "the other tab's form")
        other.type("#token", farm.token("operate"))
        expect(len(page.requests) == before, "it asks on: %s" % page.requests[before:])
        other.click("=Open")
        page.wait("document.body.dataset.role === 'operate' && %s?.pixels?.arrived" % PICTURE, "the first tab to be signed in, too")
        expect(page.url().endswith("#/job/%d" % job), page.url())
        press_in(page, "#side", "More")
        page.wait("document.querySelector('.menu')", "the menu")
        number = [t["token"] for t in farm.api("GET", "/tokens")["tokens"] if t["name"] == "operate"][0]
        farm.api("DELETE", "/tokens/%d" % number, expect=(200, 204))
        for each in (page, other):
            each.wait_text("revoked", "main.login .problem")
            expect(each.find(".menu") == 0, "a menu of nobody is open")


@tests.add
def collected_from_the_page():
    """Collect removes the job whose time has come, says what it freed, and shows how long jobs are kept"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator("--keep", "1s", "--keep-blobs", "0s", "--keep-failed", "30d", "--age-wait", "0s")
        farm.start_worker()
        page = farm.page(browser, "#/store")
        page.wait_text("kept.*1.0 s.*failed jobs.*30.0 d.*No job takes room", "#view")
        job = farm.submit(farm.scene(), "--size", "32x32", "--spp", "4", "--name", "old")
        farm.wait_for_job(job)
        page.wait_text("Jobs that take the most.*old", "#view")  # what is shown follows

        def collected():
            page.click("=Collect")
            page.wait("document.querySelector('#said .notice')", "what was removed")
            words = page.text("#said")
            clear(page)
            return words if "Removed 1 job" in words else None
        expect("blobs (" in wait_for(collected, "the job to go"), "the scene's blobs stay")
        page.wait_text("No job takes room", "#view")
        page.wait("!document.querySelector('[data-job]')", "the queue to be empty")


@tests.add
def a_full_store_is_said():
    """while the disk is full the page says so with a way to what takes the room; a submission is refused in words and kept"""
    farm = WebFarm()
    with farm, SmallDisk(farm, 24 << 20) as folder, Browser() as browser:
        if folder is None:
            raise Skip("mounting is not permitted: no small disk here")
        farm.store, filler = os.path.join(folder, "store"), os.path.join(folder, "filler")
        farm.start_coordinator()
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "4", "--name", "kitchen")
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        page.allow("503|507|429|500")
        page.wait_text("kitchen", "#side")
        fill_up(filler)
        farm.start_worker()
        page.wait_text("No space left on device.*What takes the room", "#farm-trouble")
        page.wait_text("store cannot be used", "#side .state")
        page.click("#farm-trouble a")
        page.wait_text("0 B of 24.0 MiB are free", "#view")
        page.js("location.hash = '#/submit'")
        page.wait("document.querySelector('form.submit')", "the form")
        page.give_files("#pick-files", [farm.scene()])
        page.wait("document.querySelector('#scene option')", "the scene")
        page.js("for (const [k, v] of Object.entries({size: '32x32', spp: '4'})) document.querySelector(`[name=${k}]`).value = v")
        page.click("form.submit .primary")
        page.wait_text("No space left on device", "form.submit .problem")
        os.unlink(filler)
        page.wait("document.getElementById('farm-trouble').hidden", "the trouble to pass", 60)
        page.click("form.submit .primary")
        page.wait("location.hash === '#/job/%d'" % (job + 1), "the job")
        farm.wait_for_job(job)


if __name__ == "__main__":
    tests.run()
