#!/usr/bin/env python3
"""What an administrator does on the page: tokens, the store; and notifications of the browser."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from pressing import confirm, field, press_in  # noqa: E402
from webfarm import WebFarm, connected  # noqa: E402

tests = Tests()
SMALL = ["--size", "16x16", "--spp", "2"]
OLD_JOBS = 1030  # ended jobs: more than one answer has (1000)

# Notification as the browser has it, but what is shown is kept, too.
KEPT = """window.notes = [];
    window.Notification = class extends Notification {
      constructor(...what) { super(...what); notes.push({title: what[0], ...what[1], it: this}); } };"""
# Browsers of phones have it, and say at each notification that a page cannot make one.
REFUSED = """window.Notification = class { static permission = 'granted';
      constructor() { throw new TypeError('Illegal constructor.'); } };"""


def press_in_row(page, words, name):
    """Press a button in the row of a table that has these words."""
    press_in(page, "tr", name, words)


@tests.add
def a_token_is_renewed():
    """Renew shows a new secret once; the old one's pages end at once, the new one opens the page with the same role"""
    with WebFarm() as farm, Browser() as browser, Browser() as other:
        farm.start_coordinator()
        guest = farm.page(other, role="view")
        guest.allow("401|WebSocket|ERR_|closed")
        page = farm.page(browser, "#/access")
        press_in_row(page, "view@test", "Renew")
        page.wait_text("refused at once", "dialog[open]")
        confirm(page, "Keep")
        expect(farm.ask("GET", "/api/v1/farm", token=farm.tokens["view"])[0].status == 200, "Keep renewed the token")
        press_in_row(page, "view@test", "Renew")
        confirm(page, "Renew")
        page.wait("document.querySelector('dialog[open] code')", "the new secret")
        secret = page.text("dialog[open] code").strip()
        confirm(page, "I have it")
        expect(secret not in page.text(), "the secret is still shown")
        expect(farm.ask("GET", "/api/v1/farm", token=farm.tokens["view"])[0].status == 401, "the old secret is accepted")
        guest.wait("document.querySelector('#token')", "the old page to ask for a token")
        guest.type("#token", secret)
        guest.click("=Open")
        connected(guest)
        expect(guest.js("document.body.dataset.role") == "view", "the role changed")


@tests.add
def my_own_token_is_renewed():
    """an admin who renews the token of this page keeps the new secret in sight and signs in with it"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, "#/access", role="admin")
        page.allow("401|WebSocket|ERR_|closed")
        press_in_row(page, "admin@test", "Renew")
        page.wait_text("sign in again", "dialog[open]")
        confirm(page, "Renew")
        page.wait("document.querySelector('dialog[open] code')", "the new secret")
        page.wait("document.querySelector('#token')", "the page to ask for a token")
        secret = page.text("dialog[open] code").strip()
        confirm(page, "I have it")
        page.type("#token", secret)
        page.click("=Open")
        connected(page)


@tests.add
def prune_finds_all_old_jobs():
    """prune removes every old job of the state, also those that the page had not loaded; a running one stays"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.fill(OLD_JOBS)
        for job in range(1, OLD_JOBS + 1):
            farm.api("POST", "/jobs/%d/cancel" % job, {"discard": True})
        kept = farm.submit(farm.scene(), *SMALL)
        done = lambda: farm.api("GET", "/farm")["states"].get("cancelled", 0)
        wait_for(lambda: int(done()) == OLD_JOBS, "all jobs to be cancelled")
        page = farm.page(browser, "#/store")
        page.click("=Prune")
        field(page, "Ended more than", "3")
        confirm(page, "Show which")
        page.wait_text("No such job is that old")
        page.click("=Prune")
        field(page, "Ended more than", "0")
        confirm(page, "Show which")
        page.wait_text("%d jobs" % OLD_JOBS, "dialog[open]")
        confirm(page, "Remove")
        wait_for(lambda: [j["job"] for j in farm.api("GET", "/jobs?filter=all")["jobs"]] == [kept], "the old jobs to go", 60)


@tests.add
def notifications_are_shown():
    """of all jobs: each end is told once with name and state, a press leads to the job; off: nothing is told"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        browser.call("Browser.grantPermissions", {"origin": farm.origin(), "permissions": ["notifications"],
                                                 "browserContextId": browser.context})
        page = browser.page()
        page.call("Page.addScriptToEvaluateOnNewDocument", {"source": KEPT})
        page.open("%s/#token=%s" % (farm.origin(), farm.token("start")))
        connected(page)
        first, second, third = (farm.submit(farm.scene(), *SMALL, "--name", n) for n in ("kitchen", "hall", "attic"))
        page.click("#who")
        page.choose("#notify", "all")
        page.click("=Close")
        farm.cli("cancel", first, expect=0)
        page.wait("notes.length", "a notification")
        expect(page.js("notes[0].title") == "kitchen: cancelled", page.js("notes[0].title"))
        page.js("location.hash = '#/job/%d'" % second)
        page.js("notes[0].it.onclick()")
        page.wait("location.hash === '#/job/%d'" % first, "the press to lead to the job")
        page.click("#who")
        page.choose("#notify", "off")
        page.click("=Close")
        farm.cli("cancel", second, expect=0)
        page.wait("document.querySelector('[data-job=\"%d\"].cancelled')" % second)
        page.click("#who")
        page.choose("#notify", "all")
        page.click("=Close")
        farm.cli("cancel", third, expect=0)
        page.wait("notes.length > 1", "the third job's notification")
        expect(page.js("notes.map(n => n.title)") == ["kitchen: cancelled", "attic: cancelled"], page.js("notes.map(n => n.title)"))


@tests.add
def a_browser_that_cannot_notify():
    """a browser that refuses each notification (a phone's) is said to, and the page's figures go on"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = browser.page()
        page.call("Page.addScriptToEvaluateOnNewDocument", {"source": REFUSED})
        page.open("%s/#token=%s" % (farm.origin(), farm.token("start")))
        connected(page)
        job = farm.submit(farm.scene(), *SMALL)
        page.wait("document.getElementById('n-queue').textContent === '1'", "the job in the header")
        page.click("#who")
        page.choose("#notify", "all")
        page.click("=Close")
        farm.cli("cancel", job, expect=0)
        page.wait("document.getElementById('n-queue').textContent === '0'", "the header to go on")
        page.wait_text("cannot show notifications")


if __name__ == "__main__":
    tests.run()
