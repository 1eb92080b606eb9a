"""A farm with its page, for tests in a browser.

    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser)
"""
import glob
import http.client
import json
import os
import subprocess
import sys
import urllib.parse

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "farm"))

from cdp import program  # noqa: E402
from farm import BIN, BUILD, ROOT, Failure, Farm, Skip, read_bytes  # noqa: E402

AXE = os.path.join(ROOT, "build", "axe", "axe.min.js")


class WebFarm(Farm):
    """Its page's address, and its API as a program uses it."""

    def __init__(self):
        program()  # no browser: nothing is started
        super().__init__()
        self.page_address = None  # "127.0.0.1:PORT"
        self.tokens = {}          # role -> token

    def start_coordinator(self, *options, **how):
        help_text = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--help"],
                                   stdout=subprocess.PIPE, universal_newlines=True, check=False).stdout
        if "--web" not in help_text:
            raise Skip("this build has no page (WEB=0)")
        if "--web" not in options:
            options += ("--web", self.page_address or "127.0.0.1:0")
        super().start_coordinator(*options, **how)
        address = self.coordinator.wait_line("page: ").split()[0]
        self.page_address = urllib.parse.urlsplit(address).netloc
        self.tokens["start"] = address.split("#token=")[1]
        return self.coordinator

    def page_url(self):
        return read_bytes(os.path.join(self.store, "page.url")).decode().strip()

    def origin(self):
        return "http://" + self.page_address

    def api(self, method, path, body=None, role="start", expect=200, headers=None):
        """The JSON (or the bytes) that the API answers; expect: a status, or several."""
        answer, data = self.ask(method, "/api/v1" + path, body, self.token(role), headers)
        if answer.status not in (expect if isinstance(expect, tuple) else (expect, )):
            raise Failure("%s %s: %d, not %s: %s" % (method, path, answer.status, expect, data[:2000]))
        kind = answer.getheader("Content-Type") or ""
        return json.loads(data) if "json" in kind and data else data

    def ask(self, method, path, body=None, token=None, headers=None):
        """(answer, its bytes); token: sent as a program does."""
        connection = http.client.HTTPConnection(self.page_address, timeout=60)
        head = dict(headers or {})
        if token:
            head["Authorization"] = "Bearer " + token
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
            head.setdefault("Content-Type", "application/json")
        try:
            connection.request(method, path, body, head)
            answer = connection.getresponse()
            return answer, answer.read()
        finally:
            connection.close()

    def token(self, role):
        """A token of that role, made once; its owner is ROLE@test. "start": the coordinator's own."""
        if role not in self.tokens:
            made = self.api("POST", "/tokens", {"name": role, "role": role, "owner": role + "@test"},
                            expect=(200, 201))
            self.tokens[role] = made["secret"]
        return self.tokens[role]

    def page(self, browser, link="", role="start", **how):
        """The page, logged in with that role's token, connected, at a link such as "#/job/1"."""
        page = browser.page(**how)
        page.open("%s/#token=%s" % (self.origin(), self.token(role)))
        connected(page)
        if link:
            page.open(self.origin() + "/" + link)
        return page

    def fill(self, jobs):
        """So many small jobs behind every other, quickly."""
        done = subprocess.run([os.path.join(BUILD, "tests", "bench", "bench_scale"), "fill", "--key", self.key,
                               "--coordinator", self.address, "--jobs", str(jobs)],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, check=False)
        if done.returncode != 0:
            raise Failure(done.stdout)


def connected(page):
    """Wait until the page has the farm's state and the live connection."""
    page.wait("document.documentElement?.dataset.connection === 'open'", "the page to be connected")


def axe(page, where, rules_off=()):
    """Failure if axe-core finds anything in what is shown; Skip where axe-core could not be had."""
    if not os.path.exists(AXE):
        raise Skip("no axe-core: scripts/fetch-axe.sh gets it from the npm registry")
    if not page.js("typeof axe === 'object'"):
        page.call("Runtime.evaluate", {"expression": read_bytes(AXE).decode()})
    found = page.js("""axe.run(document, {resultTypes: ['violations'], rules: %s}).then(r => r.violations.map(v =>
        ({id: v.id, help: v.help, nodes: v.nodes.slice(0, 5).map(n => n.html.slice(0, 160) + '  ' +
          n.any.concat(n.all, n.none).map(c => c.message).join('; ').slice(0, 240))})))""" % json.dumps(
              {rule: {"enabled": False} for rule in rules_off}))
    if found:
        raise Failure("%s: axe-core finds %d faults:\n%s" % (where, len(found), "\n".join(
            "%s: %s\n    %s" % (v["id"], v["help"], "\n    ".join(v["nodes"])) for v in found)))


def assets_bytes():
    """Bytes of all that the page is made of."""
    return sum(os.path.getsize(f) for f in glob.glob(
        os.path.join(ROOT, "web", "assets", "**"), recursive=True) if os.path.isfile(f))
