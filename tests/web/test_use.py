#!/usr/bin/env python3
"""The page by keyboard, on a phone, after a reload, for screen readers; axe-core looks at every view."""
import json
import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Failure, Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from webfarm import WebFarm, axe, connected  # noqa: E402

tests = Tests()
SMALL = ["--size", "32x32", "--spp", "4"]
LONG = ["--size", "128x128", "--spp", "1000000"]
VIEWS = ["#/job/1", "#/job/2", "#/job/3", "#/workers", "#/worker/ana", "#/events", "#/store", "#/access", "#/submit"]


def busy(farm):
    """Job 1 is done, 2 is in work, 3 waits for 2 and is an animation; one worker, ana."""
    farm.start_coordinator()
    farm.start_worker("--name", "ana")
    first = farm.submit(farm.scene(), *SMALL)
    farm.wait_for_job(first)
    second = farm.submit(farm.scene(), *LONG, "--name", "kitchen")
    third = farm.submit(farm.scene(), *SMALL, "--name", "turntable", "--frames", "1-24", "--after", str(second))
    wait_for(lambda: farm.job(second)["state"] == "running", "the job to run")
    return first, second, third


@tests.add
def links_back_and_reload():
    """a link shows its job and frame; back goes back; a reload loses nothing; a second page needs no token"""
    with WebFarm() as farm, Browser() as browser:
        _, second, third = busy(farm)
        page = farm.page(browser, "#/job/%d" % second, width=1600, height=1000)
        page.wait_text("kitchen", "#side")
        page.click("[data-job=\"%d\"] a" % third)
        page.wait_text("turntable", "#side")
        expect(page.url().endswith("#/job/%d" % third), page.url())
        page.back()
        page.wait_text("kitchen", "#side")
        page.reload()
        connected(page)
        page.wait_text("kitchen", "#side")
        expect(page.url().endswith("#/job/%d" % second), page.url())
        link = "%s/#/job/%d/frame/7" % (farm.origin(), third)
        other = browser.page(link, width=1600, height=1000)
        connected(other)
        other.wait_text("frame 7", "#side")


@tests.add
def the_price_is_that_of_the_commands():
    """what the page says of an error's price is what `azulejo estimate` says of the same frame"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        made = farm.cli("estimate", farm.scene(), "--size", "640x480", "--pilot-spp", "16", "--json", expect=0).json()
        number, core = made["job"], made["pilots"][0]["points"][-1]["core_seconds"]
        history = farm.api("GET", "/jobs/%d/frames/1/history" % number)
        expect([c["measure"] for c in history["curves"]] == ["display", "psnr", "rmse"], history["curves"])
        page = farm.page(browser, "#/job/%d" % number, width=1300, height=900)
        rows = [row for row in made["curve"] if row["core_seconds"] > core]
        expect(len(rows) >= 3, made["curve"])
        for row in rows:  # the page draws straight lines between the curve's points
            told = page.js("import('/assets/job/cost.js').then(({costOf}) => costOf(%s, %r))" % (
                json.dumps(history["curves"][0]["points"]), row["display"]))
            for key, want in (("value", row["core_seconds"]), ("lo", row["core_seconds_low"]), ("hi", row["core_seconds_high"])):
                expect(abs(told[key] / want - 1) < (1e-3 if key == "value" else 0.005), (row, told))
        # What is shown: a number, or that it is too early to say one, as the same law's interval has it.
        page.wait_text("/255.* more", ".price")
        text, law = page.text(".price"), history["curves"][0]
        error = float(re.match(r"([\d.]+)/255", text)[1]) * law["stop"]
        told = page.js("import('/assets/job/cost.js').then(({costOf}) => costOf(%s, %r))" % (json.dumps(law["points"]), error))
        least, most = (max(told[key] - core, 0) for key in ("lo", "hi"))
        expect(("too early to say" in text) == (most > law["width"] * least), (text, least, most))
        number = re.search(r"([\d.]+) core-seconds more", text)
        expect(not number or abs(float(number[1]) / (told["value"] - core) - 1) < 0.05, (text, told))


@tests.add
def an_address_pasted_into_an_open_page():
    """the whole address signs in where the page, or its form, is already open; it does not stay in the address"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, role="view")

        def paste(role):
            page.open("%s/#token=%s" % (farm.origin(), farm.token(role)))
            page.wait("document.body && document.body.dataset.role === '%s'" % role, "the page to be signed in as " + role)
            connected(page)
            expect("token" not in page.url(), page.url())
        paste("operate")
        number = [t["token"] for t in farm.api("GET", "/tokens")["tokens"] if t["name"] == "operate"][0]
        page.allow("401|WebSocket|connection")
        farm.api("DELETE", "/tokens/%d" % number, expect=(200, 204))
        page.wait("document.querySelector('main.login')", "the form")
        page.open("%s/#token=azt_wrong" % farm.origin())
        page.wait("!location.hash.includes('token') && document.querySelector('main.login .problem').innerText",
                  "the wrong token to be refused")
        paste("view")


# A machine whose clock is two hours ahead.
AHEAD = "{ const now = Date.now; Date.now = () => now() + 7200e3; }"


@tests.add
def two_people_at_one_browser():
    """another tab's sign-in is said; hidden tabs watch nothing; a wrong clock changes no age; a revocation is said once"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        page = browser.page(width=1600, height=1000)
        page.allow("401|403|WebSocket|connection|ERR_")
        page.call("Page.addScriptToEvaluateOnNewDocument", {"source": AHEAD})
        page.open("%s/#token=%s" % (farm.origin(), farm.token("operate")))
        connected(page)
        job = farm.submit(farm.scene(), *LONG)
        page.wait_text("submitted just now", "#side")
        page.wait("/--key /.test(document.querySelector('#side .command code')?.textContent)", "a command with the key")
        picture = "document.getElementById('picture').picture"
        page.wait("%s?.pixels?.arrived" % picture, "the picture")
        page.js("""import('/assets/live.js').then(() => { const late = setTimeout; window.setTimeout = (f, ms) => late(f, ms === 10000 ? 0 : ms);
            Object.defineProperty(document, 'hidden', {get: () => window.away, configurable: true});
            window.away = true; document.dispatchEvent(new Event('visibilitychange')); })""")
        mean = "%s.pixels.samples.reduce((a, b) => a + b, 0)" % picture
        page.frames(30)
        before = page.js(mean)
        wait_for(lambda: int(farm.job(job)["samples_done"]) > 2.5 * 128 * 128 * before / 64, "twice the samples at the farm")
        expect(page.js(mean) == before, "a hidden page goes on watching")
        page.js("window.away = false; document.dispatchEvent(new Event('visibilitychange'))")
        page.wait("%s > %g" % (mean, 1.2 * before), "the picture to go on")
        other = farm.page(browser, role="view")
        other.allow("401|WebSocket|connection|ERR_")
        page.wait_text("signed in as view@test, role view: this tab is that, too", "#said")
        page.wait("document.body.dataset.role === 'view'", "the role of the other tab")
        connected(page)
        number = [t["token"] for t in farm.api("GET", "/tokens")["tokens"] if t["name"] == "view"][0]
        page.js("""window.told = 0; new MutationObserver(list => { for (const m of list) told += m.addedNodes.length; })
            .observe(document.getElementById('refused'), {childList: true})""")
        farm.api("DELETE", "/tokens/%d" % number, expect=(200, 204))
        for each in (page, other):
            each.wait("document.querySelector('main.login .problem')?.innerText", "the form, and why")
        for _ in range(3):
            page.js("import('/assets/notice.js').then(n => n.trouble({status: 401, message: 'no token'}))")
        expect(page.js("told") <= 1 and not page.text("#refused"), "it is said %d times" % page.js("told"))
        other.open("%s/#token=%s" % (farm.origin(), farm.token("operate")))
        page.wait("document.body.dataset.role === 'operate'", "the first tab to be signed in, too")


@tests.add
def events_are_shown_once():
    """events that come live and those of the jobs' logs are one list, newest first, each line once"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        first = farm.submit(farm.scene(), *SMALL, "--name", "early")
        page = farm.page(browser, "#/events")
        second = farm.submit(farm.scene(), *SMALL, "--name", "late")
        for verb in (("pause", ), ("resume", ), ("pause", ), ("resume", ), ("priority", "--to", "7")):
            farm.cli(verb[0], second, *verb[1:], expect=0)
        farm.start_worker()
        for job in (first, second):
            farm.wait_for_job(job)

        def same():
            for job in (second, first):
                told = [e["text"] for e in farm.api("GET", "/jobs/%d/log?after=0" % job)["events"]
                        if not e["from_worker"]]
                shown = """[...document.querySelectorAll('ol.log li')].filter(l =>
                    l.querySelector('a').hash === '#/job/%d').map(l => l.lastChild.textContent).reverse()""" % job
                try:
                    page.wait("JSON.stringify(%s) === %s" % (shown, json.dumps(json.dumps(
                        told, separators=(",", ":"), ensure_ascii=False))), "the log of job %d" % job, 5)
                except Failure as failure:
                    raise Failure("%s:\ntold  %s\nshown %s" % (failure, told, page.js(shown))) from failure
        same()
        for _ in range(2):
            page.open(farm.origin() + "/#/workers")
            page.wait_text("thread", "#view")
            page.open(farm.origin() + "/#/events")
            same()


@tests.add
def a_paused_job_keeps_its_figures():
    """of a paused picture the error, the time and the samples stay, also of one that was open from its start"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        job = farm.submit(farm.scene(), *LONG)
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        page.wait_text("not known yet", "#side")
        farm.start_worker()
        known = r"error\s+[0-9.]+/255.*spent\s+[0-9.]+ core-"
        page.wait_text(known, "#side")
        wait_for(lambda: farm.api("GET", "/jobs/%d/frames/1/history" % job)["points"], "a point of its history")
        farm.cli("pause", job, expect=0)
        page.wait_text("paused by", "#side")
        page.wait_text(known + r".*[1-9][0-9.]* ?[kMG]? samples", "#side")
        page.reload()
        connected(page)
        page.wait_text(known + r".*[1-9][0-9.]* ?[kMG]? samples", "#side")


def told_job(**more):
    """As tests/unit/client/test_figures_view.c has it: 7.2 codes after 30 s; 5 codes in 40 s."""
    end = {"display": 5, "at_end": True, "seconds": 40, "seconds_low": 40, "seconds_high": 40, **more.pop("end", {})}
    return {"now": {"figures": {"display": 7.2, "reliable": more.pop("reliable", True)}}, "seconds_active": 30, "seconds_left": -1,
            "forecasts": [end], **more}


@tests.add
def the_line_has_the_words_of_the_terminal():
    """what the page says of a running job is what `azulejo watch` says, word for word"""
    cases = [(told_job(), "7.2/255 now -> 5/255 at 1:10"),
             (told_job(reliable=False, seconds_left=36, end={"seconds_low": 20, "seconds_high": 100}),
              "36 s left  7.2/255? now -> 5/255 at 1:10 (50 s to 2:10)"),
             (told_job(end={"seconds_high": 27096}), "7.2/255 now -> 5/255 (too early to say when)"),
             (told_job(end={"seconds_low": 0, "seconds_high": 93}), "7.2/255 now -> 5/255 (too early to say when)"),
             (told_job(error_slope=-0.5), "7.2/255\u2198 now -> 5/255 at 1:10"),
             (told_job(error_slope=0.02), "7.2/255\u2192 now -> 5/255 at 1:10"),
             (told_job(error_slope=0.3, end={"seconds": -1}), "7.2/255\u2197 now"),
             ({"seconds_left": 3725, "seconds_active": 1}, "1:02:05 left"), ({"seconds_left": -1}, "")]
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, "#/")
        for job, words in cases:
            said = page.js("import('/assets/format.js').then(m => m.lineWords(%s))" % json.dumps(job))
            expect(said == words, (job, said, words))
        farm.start_worker()
        number = farm.submit(farm.scene(), *LONG)
        page.js("location.hash = '#/job/%d'" % number)
        page.wait_text(r"\d left\s+[0-9.]+/255\S* now", "#side")
        page.wait_text(r"\d left\s+[0-9.]+/255\S* now", "[data-job=\"%d\"]" % number)


@tests.add
def a_missed_target_is_not_good_enough():
    """of a job that missed its target every line says so, and the cost says nothing before its answer is there"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "64x48", "--spp", "16", "--target-error", "2/255")
        farm.wait_for_job(number)
        page = farm.page(browser, "#/job/%d" % number)
        page.wait_text("target missed", "#side")
        page.wait_text(r"good enough\s+no: 2/255 is missed", "#side")
        page.wait("document.querySelector('.cost-chart').checkVisibility()", "the curve")
        expect("No figures" not in page.js("document.getElementById('side').innerText"), "figures and none")


@tests.add
def everything_by_keyboard():
    """j and k move, p pauses, / searches, ? lists the keys; Tab reaches every control and shows where it is"""
    with WebFarm() as farm, Browser() as browser:
        first, second, _ = busy(farm)
        page = farm.page(browser, "#/job/%d" % second, width=1600, height=1000)
        page.wait_text("kitchen", "#side")
        page.wait("document.querySelectorAll('[data-job]').length === 3", "all jobs")
        page.press("j")
        page.wait("location.hash !== '#/job/%d'" % second, "j to move")
        page.press("k")
        page.wait("location.hash === '#/job/%d'" % second, "k to move back")
        page.press("p")
        wait_for(lambda: farm.job(second)["state"] == "paused", "p to pause")
        page.wait_text("Undo")
        page.press("u")
        wait_for(lambda: farm.job(second)["state"] in ("running", "queued"), "u to undo")
        page.press("?")
        page.wait_text("Keys", "dialog[open]")
        page.press("Escape")
        page.wait("!document.querySelector('dialog[open]')")
        page.press("/")
        page.wait("document.activeElement.tagName === 'INPUT'", "/ to search")
        page.call("Input.insertText", {"text": "turntable"})
        page.wait("[...document.querySelectorAll('[data-job]')].filter(e => e.checkVisibility()).length === 1",
                  "one job to be found")
        page.press("Escape")
        page.js("document.activeElement.blur()")
        # Nothing in work, so that the list keeps its order; a job that has ended, so that its verbs stay what they are.
        page.wait("document.querySelector('[data-job=\"%d\"]:not(.paused)')" % second, "the undo to be shown")
        # A key that is pressed before the page knows the verbs waits for them.
        page.js("import('/assets/state.js').then(({state}) => state.verbs.clear())")
        page.press("p")
        page.wait_text("paused", "[data-job=\"%d\"]" % second)
        page.js("location.hash = '#/job/%d'" % first)
        page.wait_text("done", "#side")
        page.wait("document.querySelector('#side') && !/Pause/.test(document.querySelector('#side').innerText)",
                  "the verbs of a job that is done")
        page.wait("""(() => { const now = [...document.querySelectorAll('[data-job]')].map(e => e.dataset.job).join();
                if (now !== window.order) Object.assign(window, {order: now, since: performance.now()});
                return performance.now() - since > 3000; })()""", "the list to keep its order")
        # Not beyond the last one: there Tab would leave the page for the browser's own controls.
        count = page.js("""(() => { window.stops = [...document.querySelectorAll(
                'button, a[href], input, select, summary, canvas, [tabindex]')].filter(e => e.tabIndex >= 0 && !e.disabled
                && e.checkVisibility({checkVisibilityCSS: true})); return stops.length; })()""")
        page.js("stops[0].focus()")
        unseen, missed = [], None
        for _ in range(count - 1):
            page.press("Tab")
            seen, missed = page.js("""(() => { const e = document.activeElement, s = getComputedStyle(e);
                const words = e => e.tagName + '#' + e.id + ' ' + (e.getAttribute('aria-label') || e.textContent).trim().slice(0, 40);
                stops.splice(0, stops.indexOf(e) > 0 ? 1 : 0);
                return [s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 0 || s.boxShadow !== 'none' ? '' : words(e),
                        stops.indexOf(e) === 0 ? null : words(e) + ' instead of ' + words(stops[0])]; })()""")
            unseen += [seen] if seen else []
            if missed:
                break
        expect(not missed, "Tab reaches %s" % missed)
        expect(not unseen, "the focus is not seen on %s" % unseen)


@tests.add
def errors_in_words():
    """an error is never rounded to none"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser)
        told = page.js("import('/assets/format.js').then(f => [0, 7.9e-16, .004, .006, .5, 3.14, 12, NaN].map(f.display))")
        expect(told == ["0/255", "under 0.01/255", "under 0.01/255", "0.01/255", "0.50/255", "3.1/255", "12/255", "?"], told)


@tests.add
def a_phone_has_no_sideways_scroll():
    """at 390 and 320 pixels no view is wider than the window, and the bottom bar changes between the views"""
    with WebFarm() as farm, Browser() as browser:
        busy(farm)
        page = farm.page(browser, width=390, height=844, phone=True)
        for width in (390, 320):
            page.size(width, 844, phone=True)
            for view in ["#/"] + VIEWS:
                page.open(farm.origin() + "/" + view)
                page.frames(5)
                wide = page.js("[document.documentElement.scrollWidth, innerWidth]")
                expect(wide[0] <= wide[1], "%s is %d pixels wide at %d" % (view, wide[0], width))
        page.size(390, 844, phone=True)
        page.open(farm.origin() + "/#/job/2")
        tabs = page.js("[...document.querySelectorAll('#tabs button')].filter(e => e.checkVisibility()).length")
        expect(tabs >= 3, "the bottom bar has %d buttons" % tabs)
        shown = set()
        for n in range(tabs):
            at = page.js("""(() => { const r = document.querySelectorAll('#tabs button')[%d].getBoundingClientRect();
                return [r.x + r.width / 2, r.y + r.height / 2, r.height]; })()""" % n)
            expect(at[2] >= 40, "a button of %g pixels" % at[2])
            page.click_at(at[0], at[1])
            page.frames(3)
            shown.add(page.text("body"))
            wide = page.js("[document.documentElement.scrollWidth, innerWidth]")
            expect(wide[0] <= wide[1], "tab %d is %d pixels wide" % (n, wide[0]))
        expect(len(shown) == tabs, "tabs show the same")


@tests.add
def axe_finds_nothing():
    """axe-core finds no fault in any view, dark or light, wide or phone, with questions and the sign-in open"""
    with WebFarm() as farm, Browser() as browser:
        busy(farm)
        page = farm.page(browser, width=1600, height=1000)
        faults = []

        def look(where):
            page.frames(5)
            try:
                axe(page, where)
            except Failure as failure:
                faults.append(str(failure))
        for dark in (False, True):
            page.size(1600, 1000)
            page.media(dark=dark, still=True)
            for view in VIEWS:
                page.open(farm.origin() + "/" + view)
                look("%s %s" % (view, "dark" if dark else "light"))
            page.press("?")
            page.wait("document.querySelector('dialog[open]')")
            look("keys")
            page.press("Escape")
            page.size(390, 844, phone=True)
            for view in ("#/", "#/job/2"):
                page.open(farm.origin() + "/" + view)
                look("%s phone %s" % (view, "dark" if dark else "light"))
        page.allow("401")  # of the question who is signed in
        page.js("fetch('/api/v1/session', {method: 'DELETE'})")
        page.reload()
        page.wait("document.querySelector('main.login')")
        look("sign in")
        expect(not faults, "\n".join(faults))


@tests.add
def an_empty_farm_teaches():
    """without workers and jobs the page shows the commands to copy, with this coordinator's address"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, width=1600, height=1000)
        page.wait_text("azulejo-worker .*" + farm.address.replace(".", "\\."))
        page.wait_text("azulejo submit .*")
        axe(page, "an empty farm")


if __name__ == "__main__":
    tests.run()
