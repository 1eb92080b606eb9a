#!/usr/bin/env python3
"""The browser that the other tests here use does what they take for granted."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from cdp import processes_of  # noqa: E402
from farm import Failure, Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from png import Png  # noqa: E402
from site_here import Site  # noqa: E402

tests = Tests()

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>a page</title>
<link rel="icon" href="data:,">
<style>body { margin: 0 } #box { width: 64px; height: 32px; background: #1f5fa8 }
@media (prefers-color-scheme: dark) { #box { background: #7fb2ee } }</style>
<div id="box"></div><canvas id="gl" width="16" height="16"></canvas>
<button id="count">Count</button><output id="seen">0</output>
<input id="field"><select id="list"><option value="a">A</option><option value="b">B</option></select>
<div id="drop" style="width:200px;height:50px">drop</div>
<ul><li draggable="true" id="one">one</li><li id="two">two</li></ul>
<script src="/page.js"></script>"""

SCRIPT = """
const seen = document.querySelector('#seen');
let keys = '';
document.querySelector('#count').onclick = () => { seen.textContent = +seen.textContent + 1; };
document.addEventListener('keydown', e => { keys += e.key; document.title = keys; });
const drop = document.querySelector('#drop'), two = document.querySelector('#two');
for (const e of [drop, two]) e.addEventListener('dragover', v => v.preventDefault());
drop.addEventListener('drop', e => { e.preventDefault();
  drop.textContent = [...e.dataTransfer.files].map(f => f.name + ':' + f.size).join(); });
two.addEventListener('drop', e => { e.preventDefault(); two.textContent = 'dropped'; });
document.querySelector('#one').addEventListener('dragstart', e => e.dataTransfer.setData('text/plain', 'x'));
const gl = document.querySelector('#gl').getContext('webgl2');
if (gl) { gl.clearColor(1, 0.5, 0, 1); gl.clear(gl.COLOR_BUFFER_BIT); }
fetch('/data').then(r => r.text()).then(t => { document.body.dataset.answer = t; });
"""


def site(**more):
    return Site(dict({"/": ("text/html", PAGE), "/page.js": ("text/javascript", SCRIPT),
                      "/data": ("text/plain", "asked")}, **more))


@tests.add
def a_page_can_be_used():
    """a page is opened, read, clicked, typed into, dragged, dropped on, and shown in its colours"""
    with site() as server, Browser() as browser:
        page = browser.page(server.url())
        page.wait("document.body.dataset.answer === 'asked'")
        page.click("=Count")
        page.click("#count", times=2)
        expect(page.text("#seen") == "3", page.text("#seen"))
        page.type("#field", "kitchen")
        expect(page.js("document.querySelector('#field').value") == "kitchen", "typed")
        page.choose("#list", "b")
        expect(page.js("document.querySelector('#list').value") == "b", "chosen")
        page.click("#drop")
        page.press("j", "?", "Escape", "ArrowDown", "Shift+Tab")
        expect(page.js("document.title") == "j?EscapeArrowDownTab", page.js("document.title"))
        path = os.path.join(browser.folder, "some.gltf")
        with open(path, "w", encoding="ascii") as out:
            out.write("12345")
        page.drop_files("#drop", [path])
        expect(page.text("#drop") == "some.gltf:5", page.text("#drop"))
        one, two = page.place("#one"), page.place("#two")
        page.drag((one["left"] + 5, one["y"]), (two["left"] + 5, two["y"]))
        expect(page.text("#two") == "dropped", page.text("#two"))
        for dark, color in ((False, (0x1f, 0x5f, 0xa8)), (True, (0x7f, 0xb2, 0xee))):
            page.media(dark=dark)
            page.frames()
            picture = Png(page.screenshot((0, 0, 64, 32)))
            expect(picture.codes[5][:3] == color, "%s, not %s" % (picture.codes[5][:3], color))
        expect(("button", "Count") in page.tree(), "the accessibility tree")
        asked = [r["url"] for r in page.requests if not r["url"].startswith("data:")]
        expect(asked == [server.url(p) for p in ("/", "/page.js", "/data")], asked)


@tests.add
def webgl_draws_without_a_gpu():
    """WebGL 2 draws, and a screenshot has its exact colours"""
    with site() as server, Browser() as browser:
        page = browser.page(server.url())
        page.frames()
        at = page.place("#gl")
        codes = Png(page.screenshot((at["left"], at["top"], 16, 16))).codes
        expect(codes[8][:2] == (255, 128) or codes[8][:2] == (255, 127), codes[8][:6])
        expect(codes[8][2] == 0, codes[8][:6])


@tests.add
def complaints_fail_a_test():
    """an exception, console.error, an alert, a missing file or a blocked script fails the test"""
    cases = {"exception": ("throw new Error('oops')", "oops"),
             "console": ("console.error('bad', 3)", "bad 3"),
             "dialog": ("alert('hello')", "hello"),
             "network": ("fetch('/nothing')", "404"),
             "CSP": ("const m = document.createElement('meta'); m.httpEquiv = 'Content-Security-Policy';"
                     "m.content = \"script-src 'self'\"; document.head.append(m);"
                     "const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
                     "document.body.append(s);", "Content Security Policy directive")}
    answers = {"/%s.js" % n: ("text/javascript", code) for n, (code, _) in cases.items()}
    answers.update({"/" + n: ("text/html", "<link rel=icon href=data:,><body><script src='/%s.js'></script>" % n)
                    for n in cases})
    with Site(answers) as server:
        for name, (_, words) in cases.items():
            try:
                with Browser() as browser:
                    page = browser.page(server.url("/" + name))
                    page.pump_until(lambda: page.errors, name)
            except Failure as failure:
                expect(words in str(failure), "%s: %s" % (name, failure))
            else:
                raise Failure("%s was not noticed" % name)
        with Browser() as browser:
            page = browser.page()
            page.allow("oops")
            page.open(server.url("/exception"))
            page.pump_until(lambda: page.errors, "the exception")


@tests.add
def nothing_is_left():
    """when a browser is closed, its profile and folder are gone, a Chromium of its own as well; no name resolves to another host"""
    with site() as server:
        for _ in range(2):
            with Browser() as browser:
                page = browser.page(server.url())
                expect(page.js("document.cookie") == "", "another browser's cookie")
                page.js("document.cookie = 'mine=1'")
                expect(page.js("document.cookie") == "mine=1", "kept")
    with Browser(["--force-dark-mode"]) as browser:
        page = browser.page()
        page.allow("ERR_NAME_NOT_RESOLVED")
        expect(page.js("fetch('http://example.org/').then(() => 1, () => 0)") == 0, "it was reached")
        folder, profile = browser.folder, browser.chromium.profile
        expect(processes_of(browser.chromium.profile), "its processes are found")
    expect(not os.path.exists(folder), "the folder is there")
    wait_for(lambda: not processes_of(profile), "its processes to end", 5)


if __name__ == "__main__":

    tests.run()
