#!/usr/bin/env python3
"""What a page from elsewhere, a name made to harm, or a script in the page can do: nothing."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402
from site_here import Site  # noqa: E402
from webfarm import WebFarm, assets_bytes, connected  # noqa: E402

tests = Tests()
LONG = ["--size", "64x64", "--spp", "100000"]
PAGE_BYTES_MAX = 125 * 1000


@tests.add
def the_page_asks_nobody_else():
    """the printed address opens the page; it asks only its own host, keeps the token out of URLs, and is small"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), *LONG)
        address = farm.page_url()
        page = browser.page(address)
        connected(page)
        page.wait_text("tiny")
        token = address.split("#token=")[1]
        expect(token not in page.url(), "the token stays in the address: " + page.url())
        expect(page.js("document.cookie") == "", "scripts can read the cookie")
        expect(token not in page.js("JSON.stringify(localStorage) + JSON.stringify(sessionStorage)"),
               "the token is stored where scripts can read it")
        page.open("%s/#/job/%d" % (farm.origin(), job))
        page.wait("document.querySelector('canvas')")
        page.frames(20)
        strange = [r["url"] for r in page.requests
                   if not r["url"].startswith((farm.origin() + "/", "data:", "blob:" + farm.origin() + "/"))]
        expect(not strange, "it asked for %s" % strange)
        expect(page.sockets and all(s.startswith("ws://" + farm.page_address + "/") for s in page.sockets),
               page.sockets)
        expect(not [u for u in [r["url"] for r in page.requests] + page.sockets if token in u.split("#")[0]],
               "the token is in a URL")
        loaded = sum(r["bytes"] for r in page.responses.values()
                     if r["url"] == farm.origin() + "/" or "/assets/" in r["url"])
        print("# the page: %d bytes with headers, %d bytes of sources" % (loaded, assets_bytes()))
        expect(0 < loaded <= PAGE_BYTES_MAX, "it is too large: %d" % loaded)


@tests.add
def scripts_in_the_page_do_not_run():
    """every answer has a strict policy: inline scripts, handlers, styles and frames are blocked"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser)
        for path in ("/", "/assets/main.js", "/api/v1/farm", "/api/v1/nothing", "/healthz"):
            answer, _ = farm.ask("GET", path, token=farm.token("start"))
            policy = answer.getheader("Content-Security-Policy") or ""
            expect("default-src 'self'" in policy or "default-src 'none'" in policy, "%s: %s" % (path, policy))
            expect("unsafe" not in policy and "*" not in policy, "%s: %s" % (path, policy))
            expect("frame-ancestors 'none'" in policy, "%s may be framed: %s" % (path, policy))
            expect(answer.getheader("X-Content-Type-Options") == "nosniff", path)
        page.allow("Content Security Policy|CSP:")
        for what, code in {
                "script": "const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
                          "document.body.append(s)",
                "handler": "const d = document.createElement('div');"
                           "d.innerHTML = '<img src=\"/assets/none.png\" onerror=\"window.ran = 1\">';"
                           "document.body.append(d)",
                "link": "const a = document.createElement('a'); a.href = 'javascript:window.ran = 1';"
                        "document.body.append(a); a.click()"}.items():
            page.allow("none.png")
            before = len([e for e in page.errors if "Content Security Policy" in e])
            page.js("(() => { %s })()" % code)
            page.pump_until(lambda: len([e for e in page.errors if "Content Security Policy" in e]) > before,
                            "the %s to be blocked" % what)
        expect(page.js("window.ran") is None, "it ran")


@tests.add
def another_name_gets_nothing():
    """a page under another name for this host (DNS rebinding) gets 421 and nothing else"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.page(browser)  # a cookie is there
        port = farm.page_address.split(":")[1]
        page = browser.page()
        page.allow("421|Cross-Origin-Opener-Policy header has been ignored")
        page.open("http://rebound.test:%s/" % port)
        expect(list(page.responses.values())[0]["status"] == 421, page.responses)
        expect(page.js("document.scripts.length") == 0, "a page came")
        for path in ("/api/v1/farm", "/api/v1/session", "/healthz", "/metrics", "/assets/main.js"):
            got = page.js("fetch('%s').then(r => r.status + ' ' + r.headers.get('set-cookie'))" % path)
            expect(got == "421 null", "%s: %s" % (path, got))
        answer, _ = farm.ask("GET", "/api/v1/farm", token=farm.token("start"),
                             headers={"Host": "rebound.test:" + port})
        expect(answer.status == 421, "even with a token: %d" % answer.status)


ATTACK = """
(async () => {
  const out = {}, base = 'http://%(address)s/api/v1';
  const one = async (name, run) => { try { out[name] = await run(); } catch (e) { out[name] = 'failed'; } };
  await one('read', async () => (await fetch(base + '/jobs', {credentials: 'include'})).text());
  await one('opaque', async () => (await fetch(base + '/jobs/%(job)d', {mode: 'no-cors', credentials: 'include'})).text());
  for (const type of ['text/plain', 'application/x-www-form-urlencoded', 'application/json'])
    await one('post ' + type, async () => (await fetch(base + '/jobs/%(job)d/cancel', {method: 'POST', mode: type ===
      'application/json' ? 'cors' : 'no-cors', credentials: 'include', headers: {'content-type': type}, body: '{}'})).text());
  await one('delete', async () => (await fetch(base + '/jobs/%(job)d', {method: 'DELETE', credentials: 'include'})).text());
  await one('socket', () => new Promise((done, fail) => { const s = new WebSocket('ws://%(address)s/api/v1/live');
    s.onopen = () => done('open'); s.onerror = fail; }));
  await one('events', () => new Promise((done, fail) => { const s = new EventSource(base + '/events', {withCredentials: true});
    s.onopen = () => done('open'); s.onerror = () => { s.close(); fail(); }; }));
  await one('image', () => new Promise((done, fail) => { const i = new Image(); i.onload = () => done('shown');
    i.onerror = fail; i.src = base + '/jobs/%(job)d/frames/1/preview.png'; }));
  await one('script', () => new Promise((done, fail) => { const s = document.createElement('script');
    s.onload = () => done('ran'); s.onerror = fail; s.src = 'http://%(address)s/assets/main.js'; document.head.append(s); }));
  return out;
})()"""


@tests.add
def another_origin_gets_nothing():
    """a page of another origin, whose requests carry the cookie, reads nothing and changes nothing (CSRF)"""
    with WebFarm() as farm, Browser() as browser, Site({}) as elsewhere:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(farm.scene(), *LONG)
        wait_for(lambda: farm.job(job)["state"] == "running", "the job to run")
        farm.page(browser)
        form = ("<form action='http://%s/api/v1/jobs/%d/cancel' method=post enctype=text/plain>"
                "<input name='{}' value=''></form><iframe src='http://%s/'></iframe>" % (
                    farm.page_address, job, farm.page_address))
        elsewhere.answers["/"] = ("text/html", "<link rel=icon href=data:,>" + form)
        page = browser.page()
        page.allow("")
        page.open(elsewhere.url())
        got = page.js(ATTACK % {"address": farm.page_address, "job": job})
        leaked = {k: v for k, v in got.items() if v not in ("failed", "")}
        expect(not leaked, "it got %s" % leaked)
        expect(page.js("!document.querySelector('iframe').contentDocument"), "the page is in its frame")
        framed = [r for r in page.responses.values() if r["url"] == farm.origin() + "/"]
        expect(all("frame-ancestors 'none'" in r["headers"].get("content-security-policy", "") for r in framed), framed)
        page.js("document.forms[0].submit()")
        page.pump_until(lambda: [r for r in page.responses.values() if r["url"].endswith("/cancel")
                                 and r["status"] in (401, 403)], "the form's answer")
        state = farm.job(job)["state"]
        expect(state == "running", "the job is " + state)


MARKS = {
    "image": "<img src=x onerror=alert(1)>",
    "script": "</script><script>alert(2)</script>",
    "link": "javascript:alert(3)",
    "quotes": "\"'><svg onload=alert(4)>{{7*7}}${alert(5)}",
    "reversed": "abc\u202egnp.exe",
}


@tests.add
def names_made_to_harm_are_only_text():
    """names of jobs, owners, workers and files that are markup, script or reversed text are shown as text"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        first = farm.submit(farm.scene(), *LONG)
        info = farm.api("GET", "/jobs/%d" % first)
        info = info["jobs"][0] if "jobs" in info else info
        numbers = {}
        for what, name in MARKS.items():
            made = farm.api("POST", "/jobs", {
                "name": name, "scene": info["scene"], "settings": info["settings"], "output": info["output"],
                "first_frame": 1, "last_frame": 1, "source": name, "owner": "<i>%s</i>@host" % what},
                expect=(200, 201, 400, 422))
            if "job" in made:
                numbers[what] = made["job"]
        print("# taken: %s" % ", ".join(numbers))
        expect(set(numbers) >= {"image", "link", "quotes"}, "the farm refused too much to try")
        page = farm.page(browser)
        for what, number in numbers.items():
            page.open("%s/#/job/%d" % (farm.origin(), number))
            page.wait("document.body.innerText.includes(%r)" % MARKS[what][-7:], what)
            page.frames()
        for view in ("#/workers", "#/worker/%3Cimg%20src=x%20onerror=alert(6)%3E", "#/events", "#/store", "#/"):
            page.open(farm.origin() + "/" + view)
            page.frames(5)
        strange = page.js("""[...document.querySelectorAll('*')].filter(e => [...e.attributes].some(a =>
            /^on/i.test(a.name) || /^\\s*javascript:/i.test(a.value))).map(e => e.outerHTML.slice(0, 200))""")
        expect(not strange, strange)
        expect(page.js("!document.querySelector('img[src=x], svg[onload], b[onclick]')"), "markup became elements")
        if "reversed" in numbers:
            loose = page.js("""(() => { const out = [], walk = document.createTreeWalker(document.body, 4);
                for (let n; (n = walk.nextNode());) if (/[\\u202a-\\u202e\\u2066-\\u2069]/.test(n.data)) {
                  let e = n.parentElement;
                  while (e && !/isolate|plaintext/.test(getComputedStyle(e).unicodeBidi)) e = e.parentElement;
                  if (!e || e === document.body) out.push(n.parentElement.outerHTML.slice(0, 200)); }
                return out; })()""")
            expect(not loose, "reversed text reaches beyond its own element: %s" % loose)


if __name__ == "__main__":
    tests.run()
