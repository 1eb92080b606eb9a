"""A page in a real Chromium, for tests: what it shows, what it asks for, and what a person does to it.

    with Browser() as browser:
        page = browser.page("http://127.0.0.1:7421/#token=...")
        page.wait("document.querySelector('h1')")
        page.click("button.pause")

An error in the console, an exception that nothing caught, a violation of the Content-Security-Policy or a dialog
(alert) fails the test when the `with` block ends, unless page.allow(PATTERN) said that it belongs to the test.
Nothing here sleeps for a guess: wait() looks again until a deadline.
"""
import atexit
import base64
import json
import re
import shutil
import tempfile
import time

from cdp import Chromium
from farm import PATIENCE, Failure

WAIT_S = 20  # how long something may take that takes a moment

# Helpers inside the page. An element is named by a CSS selector, or by "=NAME": something to press whose
# accessible name is NAME, or by "~NAME": begins with NAME. Hidden ones do not count.
FIND = """(() => {
  const shown = e => e.checkVisibility({checkOpacity: true, checkVisibilityCSS: true});
  const name = e => (e.getAttribute('aria-label') || e.innerText || e.value || '').trim().replace(/\\s+/g, ' ');
  const pressable = 'button,a[href],input,select,textarea,summary,[role=button],[role=menuitem],[role=tab],' +
                    '[role=option],[role=switch],[role=link],[role=row],[tabindex]';
  return {
    all(what) {
      if (what[0] === '=' || what[0] === '~') {
        const text = what.slice(1);
        const match = what[0] === '=' ? e => name(e) === text : e => name(e).startsWith(text);
        return [...document.querySelectorAll(pressable)].filter(e => shown(e) && match(e));
      }
      return [...document.querySelectorAll(what)].filter(shown);
    },
    hits: (e, top) => !!top && (e.contains(top) || top.contains(e) || [...(e.labels || [])].some(l => l.contains(top))),
    /* Where the next press lands: window.pressHit says whether on this element, or on one like it that took its place when
     * the page was drawn anew. */
    watch(what) {
      const e = this.all(what)[0];
      const words = x => x && [x.tagName, name(x), (x.closest('tr,li,dialog,section') || x).innerText.split(/[\\t\\n]/)[0]].join();
      const wanted = words(e);
      window.pressHit = null;
      addEventListener('pointerdown', p => {
        window.pressHit = !!e && (this.hits(e, p.target) || (!e.isConnected && words(p.target.closest(pressable)) === wanted));
      }, {capture: true, once: true});
      return !!e;
    },
    place(what) {
      const e = this.all(what)[0];
      if (!e) return null;
      e.scrollIntoView({block: 'nearest', inline: 'nearest', behavior: 'instant'});
      const r = e.getBoundingClientRect();
      const x = r.x + r.width / 2, y = r.y + r.height / 2;
      const top = document.elementFromPoint(x, y);
      return {x, y, left: r.x, top: r.y, width: r.width, height: r.height, disabled: !!e.disabled,
              covered: !this.hits(e, top),
              by: top ? top.outerHTML.slice(0, 200) : 'nothing'};
    }
  };
})()"""

# Keys that are not a character of their own: name -> (code, number, text).
KEYS = {"Enter": ("Enter", 13, "\r"), "Tab": ("Tab", 9, ""), "Escape": ("Escape", 27, ""),
        "Backspace": ("Backspace", 8, ""), "Delete": ("Delete", 46, ""), " ": ("Space", 32, " "),
        "ArrowUp": ("ArrowUp", 38, ""), "ArrowDown": ("ArrowDown", 40, ""),
        "ArrowLeft": ("ArrowLeft", 37, ""), "ArrowRight": ("ArrowRight", 39, ""),
        "Home": ("Home", 36, ""), "End": ("End", 35, ""), "PageUp": ("PageUp", 33, ""),
        "PageDown": ("PageDown", 34, "")}
MODIFIERS = {"Alt": 1, "Control": 2, "Meta": 4, "Shift": 8}


def started(flags=()):
    """A Chromium that answers."""
    chromium = Chromium(tempfile.mkdtemp(prefix="azulejo-chromium-"), flags)
    atexit.register(end, chromium)
    return chromium.__enter__()


def end(chromium):
    if chromium is Browser.shared:
        Browser.shared = None
    chromium.close()
    shutil.rmtree(chromium.folder, ignore_errors=True)


class Browser:
    """A profile of its own in a Chromium (cookies, storage, pages) and a temporary folder. Without flags the Chromium is
    shared by all of this process, as each start costs three seconds of a core; after a failure the next one is new."""

    shared = None

    def __init__(self, flags=()):
        if flags or Browser.shared is None:
            self.chromium = started(flags)
            if not flags:
                Browser.shared = self.chromium
        else:
            self.chromium = Browser.shared
        self.pages = []
        self.call, self.send, self.pump = self.chromium.call, self.chromium.send, self.chromium.pump
        self.context = self.call("Target.createBrowserContext")["browserContextId"]
        self.folder = tempfile.mkdtemp(prefix="azulejo-web-")

    def __enter__(self):
        return self

    def __exit__(self, kind, value, trace):
        errors = []
        try:
            if kind is None:
                for page in self.pages:
                    page.settle()
                    errors += page.unexpected()
            else:
                for page in self.pages:
                    page.report()
        finally:
            self.close(keep=kind is None)
        if errors:
            raise Failure("the page complained:\n" + "\n".join(errors))

    def close(self, keep=False):
        """keep: a shared Chromium goes on."""
        for page in self.pages:
            page.forget()
        if keep and self.chromium is Browser.shared:
            self.call("Target.disposeBrowserContext", {"browserContextId": self.context})
        else:
            end(self.chromium)
        shutil.rmtree(self.folder, ignore_errors=True)

    def page(self, url=None, **how):
        """A new window. how: width, height, scale, dark, phone (see Page.size and Page.media)."""
        page = Page(self, **how)
        self.pages.append(page)
        if url:
            page.open(url)
        return page


class Page:
    def __init__(self, browser, width=1280, height=800, scale=1, phone=False, dark=False, still=False):
        self.browser = browser
        self.requests = []       # of {url, method, kind, headers}: all that was asked for, in order
        self.responses = {}      # request number -> {status, url, bytes}
        self.sockets = []        # URLs of WebSockets
        self.errors = []         # words of the console and the browser
        self.allowed = []        # patterns of those that belong to the test
        self.loaded = 0          # documents that finished loading
        self.drag_data = None
        self.closed = False
        self.answering = None    # a function that answers requests (intercept)
        target = browser.call("Target.createTarget", {"url": "about:blank", "newWindow": True,
                                                      "browserContextId": browser.context})
        self.target = target["targetId"]
        self.session = browser.call("Target.attachToTarget",
                                    {"targetId": self.target, "flatten": True})["sessionId"]
        browser.chromium.listeners.append(self.hear)
        for domain in ("Page", "Runtime", "Network", "Log", "DOM"):
            self.call(domain + ".enable")
        self.call("Emulation.setFocusEmulationEnabled", {"enabled": True})
        self.call("Page.addScriptToEvaluateOnNewDocument", {"source": """
            document.addEventListener('securitypolicyviolation', e =>
                console.error('CSP: ' + e.violatedDirective + ' ' + e.blockedURI));"""})
        self.size(width, height, scale, phone)
        self.media(dark=dark, still=still)

    # ---- the protocol --------------------------------------------------------------------

    def call(self, method, params=None, limit_s=60):
        return self.browser.call(method, params, self.session, limit_s)

    def hear(self, message):
        if message.get("sessionId") != self.session:
            return
        function = getattr(self, "on_" + message["method"].replace(".", "_"), None)
        if function:
            function(message["params"])

    def on_Network_requestWillBeSent(self, event):
        request = event["request"]
        self.requests.append({"url": request["url"], "method": request["method"],
                              "kind": event.get("type"), "id": event["requestId"]})

    def on_Network_responseReceived(self, event):
        answer = event["response"]
        self.responses[event["requestId"]] = {
            "status": answer["status"], "url": answer["url"], "headers": answer["headers"], "bytes": 0}

    def on_Network_loadingFinished(self, event):
        if event["requestId"] in self.responses:
            self.responses[event["requestId"]]["bytes"] = event["encodedDataLength"]

    def on_Network_webSocketCreated(self, event):
        self.sockets.append(event["url"])

    def on_Runtime_consoleAPICalled(self, event):
        if event["type"] in ("error", "assert"):
            self.errors.append("console: " + " ".join(
                str(a.get("value", a.get("description", a["type"]))) for a in event["args"]))

    def on_Runtime_exceptionThrown(self, event):
        details = event["exceptionDetails"]
        thrown = details.get("exception", {})
        self.errors.append("exception: %s (%s:%s)" % (
            thrown.get("description", details["text"]), details.get("url"), details["lineNumber"] + 1))

    def on_Log_entryAdded(self, event):
        entry = event["entry"]
        if entry["level"] == "error":
            self.errors.append("%s: %s %s" % (entry["source"], entry["text"], entry.get("url", "")))

    def on_Page_javascriptDialogOpening(self, event):
        if event["type"] != "beforeunload":
            self.errors.append("dialog: %s: %s" % (event["type"], event["message"]))
        self.browser.send("Page.handleJavaScriptDialog", {"accept": True}, self.session)

    def on_Page_loadEventFired(self, _):
        self.loaded += 1

    def on_Input_dragIntercepted(self, event):
        self.drag_data = event["data"]

    def on_Fetch_requestPaused(self, event):
        """Lets self.answering decide: None goes on; a number fails with that status; a dict is the answer."""
        answer = self.answering(event["request"]) if self.answering else None
        if answer is None:
            self.browser.send("Fetch.continueRequest", {"requestId": event["requestId"]}, self.session)
        else:
            self.browser.send("Fetch.fulfillRequest", {
                "requestId": event["requestId"], "responseCode": answer["status"],
                "responseHeaders": [{"name": "Content-Type", "value": answer["type"]}],
                "body": base64.b64encode(answer["body"]).decode()}, self.session)

    # ---- errors --------------------------------------------------------------------------

    def allow(self, pattern):
        """Complaints that match belong to the test."""
        self.allowed.append(pattern)

    def settle(self):
        """Take in what the page has complained of until now."""
        if not self.closed:
            self.js("new Promise(done => setTimeout(done))")

    def unexpected(self):
        return [e for e in self.errors if not any(re.search(p, e) for p in self.allowed)]

    def report(self):
        """What helps to understand a failure, as TAP comments."""
        lines = ["page complained: " + e for e in self.errors[-10:]]
        try:
            lines.append("page is at " + self.js("location.href"))
            lines += ["| " + l for l in self.js("document.body.innerText").splitlines()[:60] if l.strip()]
        except Failure:
            pass
        for line in lines:
            print("# " + line)

    # ---- where it is ---------------------------------------------------------------------

    def open(self, url, limit_s=WAIT_S):
        """Go there and wait until it has loaded. A change of the fragment alone loads nothing."""
        before = self.loaded
        answer = self.call("Page.navigate", {"url": url})
        if answer.get("errorText"):
            raise Failure("%s: %s" % (url, answer["errorText"]))
        if "loaderId" in answer:
            self.pump_until(lambda: self.loaded > before, url + " to load", limit_s)

    def reload(self):
        before = self.loaded
        self.call("Page.reload")
        self.pump_until(lambda: self.loaded > before, "the page to load again")

    def back(self):
        self.js("history.back()")

    def url(self):
        return self.js("location.href")

    def close(self):
        self.browser.call("Target.closeTarget", {"targetId": self.target})
        self.forget()
        self.closed = True

    def forget(self):
        """Hear no more of it."""
        if self.hear in self.browser.chromium.listeners:
            self.browser.chromium.listeners.remove(self.hear)

    # ---- what it shows -------------------------------------------------------------------

    def js(self, expression, limit_s=60):
        """The value of an expression (awaited when it is a promise)."""
        answer = self.call("Runtime.evaluate", {
            "expression": expression, "returnByValue": True, "awaitPromise": True}, limit_s)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise Failure("%s\nin %s" % (details.get("exception", {}).get("description", details["text"]),
                                         expression[:300]))
        return answer["result"].get("value")

    def wait(self, expression, what=None, limit_s=WAIT_S):
        """Wait until the expression is true, awaited when it is a promise, and return its value (true for an object)."""
        end = time.monotonic() + limit_s * PATIENCE
        while True:
            try:
                value = self.js("(async () => { const v = await (%s); return v instanceof Object && !Array.isArray(v) ? true : v; })()" % expression)
            except Failure as failure:  # a part that is not there yet, or a page that gives way to another
                if not re.search("TypeError: Cannot read properties of|target navigated or closed", str(failure)) \
                        or time.monotonic() > end:
                    raise
                value = None
            if value:
                return value
            if time.monotonic() > end:
                raise Failure("waited %g s for %s" % (limit_s * PATIENCE, what or expression))
            self.browser.pump(0.03)  # how often we look, not how long it takes

    def pump_until(self, condition, what, limit_s=WAIT_S):
        """Wait for something that the browser tells (requests, errors, answers)."""
        end = time.monotonic() + limit_s * PATIENCE
        while not condition():
            left = end - time.monotonic()
            if left <= 0:
                raise Failure("waited %g s for %s" % (limit_s * PATIENCE, what))
            self.browser.pump(min(left, 0.1))

    def find(self, what):
        """How many such elements are shown."""
        return self.js("%s.all(%s).length" % (FIND, json.dumps(what)))

    def text(self, what="body"):
        return self.js("((%s.all(%s)[0] || {}).innerText || '')" % (FIND, json.dumps(what)))

    def wait_text(self, pattern, what="body", limit_s=WAIT_S):
        """Wait until the element's text matches; returns the match's text."""
        return self.wait("(%s.test(((%s.all(%s)[0] || {}).innerText || '')) || null)" % (
            "new RegExp(%s, 's')" % json.dumps(pattern), FIND, json.dumps(what)),
            "text '%s' in %s" % (pattern, what), limit_s)

    def frames(self, count=2):
        """Let the page draw that many times."""
        self.js("new Promise(done => { let n = %d; const f = () => n-- ? requestAnimationFrame(f) : done(1);"
                " f(); })" % count)

    def screenshot(self, clip=None, form="png", quality=None):
        """The bytes of a picture of the window, or of clip (x, y, width, height) in CSS pixels."""
        request = {"format": form, "captureBeyondViewport": False}
        if quality is not None:
            request["quality"] = quality
        if clip:
            request["clip"] = dict(zip(("x", "y", "width", "height"), clip), scale=1)
        return base64.b64decode(self.call("Page.captureScreenshot", request)["data"])

    def tree(self):
        """The accessibility tree, flat: a list of (role, name) of what is not ignored."""
        nodes = self.call("Accessibility.getFullAXTree")["nodes"]
        return [(n.get("role", {}).get("value", ""), n.get("name", {}).get("value", ""))
                for n in nodes if not n.get("ignored")]

    # ---- what a person does --------------------------------------------------------------

    def place(self, what, limit_s=15):
        """Wait until such an element is shown, is not covered and stands still; then its place."""
        end = time.monotonic() + limit_s * PATIENCE
        before = None
        while True:
            now = self.js("%s.place(%s)" % (FIND, json.dumps(what)))
            if now and now == before and not now["covered"] and not now["disabled"]:
                return now
            if time.monotonic() > end:
                raise Failure("waited %g s for '%s' to be pressable: %s" % (
                    limit_s * PATIENCE, what,
                    "it is not shown" if not now else "it is disabled" if now["disabled"]
                    else "it is covered by " + now["by"] if now["covered"] else "it moves"))
            before = now
            self.browser.pump(0.03)

    def mouse(self, kind, x, y, button="none", clicks=0, held=0, **more):
        self.call("Input.dispatchMouseEvent", dict(
            {"type": kind, "x": x, "y": y, "button": button, "clickCount": clicks, "buttons": held}, **more))

    def click(self, what, limit_s=15, button="left", times=1):
        """What moves away between the look and the press is pressed again; a person would, too."""
        end = time.monotonic() + limit_s * PATIENCE
        while True:
            at = self.place(what, limit_s)
            if not self.js("%s.watch(%s)" % (FIND, json.dumps(what))):
                continue  # gone since then; something else may be in its place
            self.click_at(at["x"], at["y"], button, times)
            try:
                if self.js("window.pressHit") is not False or times > 1:
                    return
            except Failure:  # the press has opened another page
                return
            if time.monotonic() > end:
                raise Failure("'%s' moves away from each press" % what)

    def click_at(self, x, y, button="left", times=1):
        held = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mouseMoved", x, y)
        for n in range(1, times + 1):
            self.mouse("mousePressed", x, y, button, n, held)
            self.mouse("mouseReleased", x, y, button, n)

    def hover(self, what):
        at = self.place(what)
        self.mouse("mouseMoved", at["x"], at["y"])

    def wheel(self, x, y, delta, modifiers=0):
        self.mouse("mouseWheel", x, y, deltaX=0, deltaY=delta, modifiers=modifiers)

    def drag(self, start, end, steps=8):
        """Press at start (x, y), move to end and release; drags of the browser's own kind included."""
        self.drag_data = None
        self.call("Input.setInterceptDrags", {"enabled": True})
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, button="left", clicks=1, held=1)
        for n in range(1, steps + 1):
            x, y = (a + (b - a) * n / steps for a, b in zip(start, end))
            if self.drag_data:
                self.drop_event("dragOver", x, y)
            else:
                self.mouse("mouseMoved", x, y, button="left", held=1)
                if self.drag_data:
                    self.drop_event("dragEnter", x, y)
        if self.drag_data:
            self.drop_event("drop", *end)
        self.mouse("mouseReleased", *end, button="left", clicks=1)
        self.call("Input.setInterceptDrags", {"enabled": False})

    def drop_event(self, kind, x, y):
        self.call("Input.dispatchDragEvent", {"type": kind, "x": x, "y": y, "data": self.drag_data})

    def drop_files(self, what, paths):
        """Drop files or folders from outside onto an element."""
        at = self.place(what)
        self.drag_data = {"items": [], "files": list(paths), "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.drop_event(kind, at["x"], at["y"])

    def give_files(self, selector, paths):
        """Choose files in an <input type=file>, which may be hidden."""
        self.wait("!!document.querySelector(%r)" % selector, selector)
        node = self.call("Runtime.evaluate", {"expression": "document.querySelector(%s)" % json.dumps(selector)})
        self.call("DOM.setFileInputFiles", {"files": list(paths), "objectId": node["result"]["objectId"]})

    def press(self, *keys):
        """Press keys one after the other: "a", "?", "Enter", "Control+k"."""
        for key in keys:
            *held, name = key.split("+") if len(key) > 1 else [key]
            bits = sum(MODIFIERS[m] for m in held)
            code, number, text = KEYS.get(name, (
                "Key" + name.upper() if name.isalpha() else "Digit" + name if name.isdigit() else "",
                ord(name.upper()) if len(name) == 1 and name.isalnum() else 0, name))
            event = {"key": name, "code": code, "windowsVirtualKeyCode": number, "modifiers": bits}
            if text and not bits & ~MODIFIERS["Shift"]:
                event["text"] = text
            self.call("Input.dispatchKeyEvent", dict(event, type="keyDown" if "text" in event else "rawKeyDown"))
            event.pop("text", None)
            self.call("Input.dispatchKeyEvent", dict(event, type="keyUp"))

    def type(self, what, text, replace=True):
        """Put text into a field as a person does: click, select what is there, write."""
        self.click(what)
        if replace:
            self.js("document.activeElement.select && document.activeElement.select()")
        self.call("Input.insertText", {"text": text})

    def choose(self, what, value):
        """Choose an option of a <select> by its value."""
        self.place(what)
        self.js("""(() => { const e = %s.all(%s)[0]; e.value = %s;
            e.dispatchEvent(new Event('input', {bubbles: true}));
            e.dispatchEvent(new Event('change', {bubbles: true})); })()""" % (
                FIND, json.dumps(what), json.dumps(value)))

    # ---- what it runs on -----------------------------------------------------------------

    def size(self, width, height, scale=1, phone=False):
        self.call("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone})
        self.call("Emulation.setTouchEmulationEnabled", {"enabled": phone, "maxTouchPoints": 5 if phone else 1})

    def media(self, dark=False, still=False):
        """dark: prefers-color-scheme; still: prefers-reduced-motion."""
        self.call("Emulation.setEmulatedMedia", {"features": [
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
            {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"}]})

    def network(self, offline=False, bytes_per_s=-1, delay_ms=0):
        self.call("Network.emulateNetworkConditions", {
            "offline": offline, "latency": delay_ms, "downloadThroughput": bytes_per_s,
            "uploadThroughput": bytes_per_s})

    def slow_down(self, factor):
        self.call("Emulation.setCPUThrottlingRate", {"rate": factor})

    def intercept(self, answering, pattern="*"):
        """answering(request) is asked about each request: None lets it through, a dict with status, type and
        body answers it."""
        self.answering = answering
        self.call("Fetch.enable", {"patterns": [{"urlPattern": pattern}]})

    def metrics(self):
        """Chromium's own figures: Nodes, JSHeapUsedSize, LayoutCount, ScriptDuration, ..."""
        self.call("Performance.enable")
        return {m["name"]: m["value"] for m in self.call("Performance.getMetrics")["metrics"]}

    def collect_garbage(self):
        self.call("HeapProfiler.collectGarbage")
