#!/usr/bin/env python3
"""The page's queue, verbs and links in a real Chromium on a real farm: what people press becomes what the farm does."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Farm, Tests, kept_port, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from page import Page, need_page  # noqa: E402

tests = Tests()
need_page()

ROWS = "[...document.querySelectorAll('.rows li')].map(li => Number(li.dataset.job))"


class Desk:
    """A farm without workers, so that jobs stay where they are put; its page; and somebody in front of it."""

    def __init__(self, jobs=0, options=(), **how):
        self.farm, self.browser = Farm(), Browser()
        self.farm.__enter__()
        self.web = Page(self.farm.start_coordinator(*options))
        for number in range(jobs):
            self.farm.submit(self.farm.scene(), "--name", "job-%c" % (ord("a") + number), "--spp", "8")
        self.how = how
        self.page = None

    def open(self, where="#/"):
        self.page = self.browser.page("%s/#token=%s" % (self.web.origin, self.web.token), **self.how)
        self.page.wait("document.documentElement.dataset.connection === 'open'")
        self.page.wait("import('/assets/state.js').then(({state}) => state.loaded)", "verbs, too")
        if where != "#/":
            self.page.js("location.hash = %r" % where)
        return self.page

    def rows(self, wanted):
        self.page.wait("JSON.stringify(%s) === '%s'" % (ROWS, str(wanted).replace(" ", "")), "rows %s" % wanted)

    def priority(self, job):
        return self.farm.job(job)["priority"]

    def __enter__(self):
        return self

    def __exit__(self, *why):
        try:
            self.browser.__exit__(*why)
        finally:
            self.farm.__exit__(*why)


@tests.add
def reordering():
    """a job is dragged, or moved by keys, to another place: the farm has the priority for it, and undo takes it back"""
    with Desk(jobs=3) as desk:
        page = desk.open("#/job/3")
        desk.rows([1, 2, 3])
        page.press("K")
        desk.rows([1, 3, 2])
        expect([desk.priority(j) for j in (1, 2, 3)] == [1, 0, 1], [desk.priority(j) for j in (1, 2, 3)])
        page.press("u")
        desk.rows([1, 2, 3])
        expect([desk.priority(j) for j in (1, 2, 3)] == [0, 0, 0], "undo left a priority")
        page.press("J")  # the last: there is no place below
        last, first = page.place("li[data-job='3']"), page.place("li[data-job='1']")
        page.drag((last["x"], last["y"]), (first["x"], first["top"] + 8))
        desk.rows([3, 1, 2])
        expect([desk.priority(j) for j in (1, 2, 3)] == [0, 0, 1], "dragging to the top changed others")
        top, under = page.place("li[data-job='3']"), page.place("li[data-job='2']")
        page.drag((top["x"], top["y"]), (under["x"], under["top"] + under["height"] - 8))
        desk.rows([1, 2, 3])
        expect(desk.priority(3) == 0, desk.priority(3))


@tests.add
def priorities_of_a_place():
    """the least change of priorities that puts a job at a place, for jobs of one owner and of several"""
    with Desk() as desk:
        page = desk.open()
        cases = [
            # priorities and owners of jobs 1, 2, ...; the moved job, its place; what changes
            ([(0, "a"), (0, "a"), (0, "a")], 3, 0, {3: 1}),
            ([(0, "a"), (0, "a"), (0, "a")], 1, 2, {1: -1}),
            ([(0, "a"), (0, "b"), (0, "a")], 3, 1, {1: 1, 3: 1}),
            ([(5, "a"), (0, "a"), (0, "a")], 3, 1, {3: 1}),
            ([(2, "a"), (1, "a"), (0, "a")], 3, 1, {3: 2}),
            ([(1, "b"), (1, "a"), (1, "a")], 3, 1, {1: 3, 3: 2}),
            ([(0, "a"), (0, "a")], 2, 1, {}),
            ([(9, "a"), (3, "b"), (3, "b")], 1, 2, {1: 2}),
        ]
        for jobs, moved, place, wanted in cases:
            found = page.js("""import('/assets/verbs.js').then(({prioritiesFor}) => {
                const list = %s.map(([priority, owner], i) => ({job: i + 1, priority, owner}));
                return prioritiesFor(list, list[%d], %d).map(([j, p]) => [j.job, p]); })""" % (
                str([list(j) for j in jobs]), moved - 1, place))
            found = dict(map(tuple, found))
            after = {i + 1: (found.get(i + 1, p), o) for i, (p, o) in enumerate(jobs)}
            rest = [j for j in after if j != moved]
            order = rest[:place] + [moved] + rest[place:]
            for above, below in zip(order, order[1:]):
                # At the same priority only jobs of one owner keep their order.
                expect(after[above][0] > after[below][0] or (after[above] == after[below] and above < below),
                       "%s: %d is not before %d after %s" % (jobs, above, below, found))
            expect(found == wanted, "%s, job %d to place %d: %s was changed instead of %s" % (
                jobs, moved, place, found, wanted))


@tests.add
def places_are_kept():
    """under the pointer rows keep their places for two seconds; what they say changes at once"""
    with Desk(jobs=3) as desk:
        page = desk.open()
        desk.rows([1, 2, 3])
        at = page.place("li[data-job='1']")
        page.js("window.jumped = 0; addEventListener('pointermove', e => { window.moved = performance.now(); }, true); new MutationObserver(() => { window.jumped ||= performance.now(); })"
                ".observe(document.querySelector('.rows'), {childList: true}); 1")
        page.mouse("mouseMoved", at["x"], at["y"])
        page.mouse("mouseMoved", at["x"] + 2, at["y"])
        desk.farm.cli("priority", "3", "--to", "5", expect=0)
        desk.farm.cli("pause", "2", expect=0)
        page.wait("document.querySelector(\"li[data-job='2']\").className === 'paused'")
        desk.rows([3, 1, 2])
        held = page.js("window.jumped - window.moved")
        expect(held >= 1900, "rows moved %d ms after the pointer" % held)


@tests.add
def several():
    """jobs are chosen by x and Shift, a verb acts on all, and only what all allow is offered"""
    with Desk(jobs=4) as desk:
        page = desk.open("#/job/1")
        desk.rows([1, 2, 3, 4])
        page.press("x", "j", "x", "j", "x")
        page.wait("document.querySelector('.bulk').innerText.includes('3 chosen')")
        page.js("[...document.querySelectorAll('.bulk button')].find(b => b.textContent === 'Pause').click()")
        wait_for(lambda: [desk.farm.job(j)["state"] for j in (1, 2, 3, 4)] == ["paused"] * 3 + ["queued"], "three pauses")
        page.wait("[...document.querySelectorAll('.bulk button')].some(b => b.textContent === 'Resume')")
        offered = page.js("[...document.querySelectorAll('.bulk button')].map(b => b.textContent)")
        expect("Pause" not in offered and "Extend" not in offered and "Cancel" in offered, offered)
        page.press("u")
        wait_for(lambda: desk.farm.job(3)["state"] == "queued", "undo")


@tests.add
def removed_while_asked_for():
    """an answer about a job that comes after the news of its removal does not bring it back"""
    with Desk(jobs=2) as desk:
        page = desk.open("#/job/1")  # of job 2 it asks nothing by itself
        desk.rows([1, 2])
        page.js("""const real = window.fetch;
            window.fetch = async (url, ...rest) => {
                const answer = await real(url, ...rest);
                if (/jobs[/]2$/.test(url)) await new Promise(go => { window.letGo = go; });
                return answer;
            };
            import('/assets/state.js').then(({loadJob, state}) => {
                loadJob(2).then(() => { window.back = !!state.job(2); });
            }); 1""")
        page.wait("window.letGo")
        desk.farm.cli("cancel", "--discard", 2, expect=0)
        desk.farm.cli("remove", 2, "--yes", expect=0)
        desk.rows([1])
        page.js("window.letGo(); 1")
        page.wait("window.back !== undefined")
        expect(page.js("window.back") is False, "job 2 is back")


@tests.add
def overtaken_by_an_answer():
    """an event that was sent before an answer and comes after it does not bring the job's former state back"""
    with Desk(jobs=1, options=("--web", "127.0.0.1:%d" % kept_port())) as desk:
        page = desk.open("#/job/1")
        desk.rows([1])
        page.wait("[...document.querySelectorAll('#side button')].some(b => b.textContent === 'Pause')")
        page.js("import('/assets/state.js').then(({state}) => { window.former = structuredClone(state.job(1)); })")
        page.click("=Pause")
        page.wait("document.querySelector(\"li[data-job='1']\").className === 'paused'")
        state = page.js("""import('/assets/state.js').then(({takeEvent, state}) => {
            takeEvent('job', window.former);
            return state.job(1).state;
        })""")
        expect(state == "paused", "the job is %s again" % state)
        page.allow("WebSocket|ERR_|closed|503")
        desk.farm.coordinator.kill()
        desk.farm.restart_coordinator("--web", "127.0.0.1:%d" % desk.web.port)
        desk.farm.cli("resume", 1, expect=0)
        page.wait("document.querySelector(\"li[data-job='1']\").className === 'queued'", "news of the one that was started again")


@tests.add
def filters_and_links():
    """filter and words survive a reload; a link shows its job and frame, back the one before; a removed job is said"""
    with Desk(jobs=3) as desk:
        desk.farm.submit(desk.farm.scene(), "--name", "walk", "--frames", "1-9", "--spp", "8")
        page = desk.open("#/job/4/frame/7")
        page.wait("document.querySelector('#side h2').innerText.includes('frame 7')")
        page.js("location.hash = '#/job/2'")
        page.wait("document.querySelector('#side h2').innerText.startsWith('job-b')")
        page.back()
        page.wait("document.querySelector('#side h2').innerText.includes('frame 7')")
        page.press("[")
        page.wait("location.hash === '#/job/4/frame/6'")
        page.press("/")
        for letter in "job":
            page.press(letter)
        desk.rows([1, 2, 3])
        page.reload()
        page.wait("document.querySelector('#queue input[type=search]')?.value === 'job'")
        desk.rows([1, 2, 3])
        page.wait("document.querySelector('#side h2').innerText.includes('frame 6')")
        desk.farm.cli("cancel", "4", "--discard", "--yes", expect=0)
        desk.farm.wait_for_job(4, "cancelled")
        desk.farm.cli("remove", "4", "--yes", expect=0)
        page.wait("document.querySelector('#side .empty')?.checkVisibility()")
        page.allow(r".*404.*")
        page.js("location.hash = '#/job/77'")
        page.wait("document.querySelector('#side .empty')?.checkVisibility()")


@tests.add
def dangers():
    """a verb that loses something says what, and Escape or Keep changes nothing; undo of a cancel goes on with the samples"""
    with Desk(jobs=2) as desk:
        page = desk.open("#/job/1")
        desk.rows([1, 2])
        page.press("c")
        page.wait("document.querySelector('#said button')?.textContent === 'Retry'")
        page.wait("document.querySelector('.state').textContent.startsWith('cancelled')")
        page.press("u")
        wait_for(lambda: desk.farm.job(1)["state"] == "queued", "the cancel is undone")
        page.wait("document.querySelector('.state').textContent.startsWith('queued')")
        page.press("c")
        desk.farm.wait_for_job(1, "cancelled")
        page.wait("document.querySelector('.state').textContent.startsWith('cancelled')")
        page.press("Delete")
        page.wait("document.querySelector('dialog[open]')?.innerText.includes('lost')")
        page.press("Escape")
        page.wait("!document.querySelector('dialog')")
        page.press("Delete")
        page.wait("document.querySelector('dialog[open]')")
        page.click("=Keep")
        expect(desk.farm.job(1)["state"] == "cancelled", "Keep removed the job")
        page.press("Delete")
        page.wait("document.querySelector('dialog[open]')")
        # The page goes on to the next job, also when its answer comes after the farm's word that the job is gone.
        page.js("""(() => { const real = window.fetch; window.fetch = async (...words) => { const answer = await real(...words);
            while (words[1]?.method && words[1].method !== 'GET' && JSON.stringify(%s) !== '[2]') await new Promise(requestAnimationFrame);
            return answer; }; })()""" % ROWS)
        page.js("[...document.querySelectorAll('dialog button')].find(b => b.textContent === 'Remove').click()")
        desk.rows([2])
        page.wait("location.hash === '#/job/2'")


@tests.add
def dropping():
    """files dropped onto the page become a job with the options of the form; what is wrong is said in words"""
    with Desk() as desk:
        page = desk.open()
        page.wait("document.querySelector('#nothing code')?.textContent.startsWith('azulejo submit')")
        page.wait("document.querySelector('#workers code')?.textContent.includes('%s')" %
                  desk.farm.address.rsplit(":", 1)[1])
        page.drop_files("#stage", [desk.farm.scene()])
        page.wait("location.hash === '#/submit' && document.querySelector('#scene option')")
        page.js("for (const [k, v] of Object.entries({size: '32x24', spp: '5', name: 'dropped', priority: '3'}))"
                " document.querySelector(`[name=${k}]`).value = v")
        page.js("document.querySelector('[name=frames]').value = '3-1'")
        page.js("document.querySelector('.submit .primary').click()")
        page.wait("document.querySelector('.problem').textContent.includes('3-1')")
        page.js("document.querySelector('[name=frames]').value = ''")
        page.js("document.querySelector('.submit .primary').click()")
        page.wait("location.hash === '#/job/1'")
        job = desk.farm.job(1)
        expect((job["name"], job["priority"], job["settings"]["spp"], job["settings"]["width"]) == ("dropped", 3, 5, 32), job)


if __name__ == "__main__":
    tests.run()
