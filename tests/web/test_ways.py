#!/usr/bin/env python3
"""Ways to the page: over TLS, in several windows at once, without WebSockets, and of a local render."""
import base64
import glob
import hashlib
import os
import re
import signal
import ssl
import subprocess
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import PATIENCE, Failure, Tests  # noqa: E402
from jobs import AREA, expect  # noqa: E402
from pressing import verb  # noqa: E402
from test_live_picture import PICTURE  # noqa: E402
from webfarm import WebFarm, connected  # noqa: E402

tests = Tests()
SMALL = ["--size", "16x16", "--spp", "2"]
LONG = ["--size", "160x96", "--spp", "1000000"]
WINDOWS = 7  # more than the connections that a browser opens to one host by HTTP/1.1

# A proxy that answers requests and refuses the upgrade of a WebSocket looks like this to a page.
NO_SOCKETS = """window.WebSocket = class { static OPEN = 1; readyState = 3;
      constructor() { setTimeout(() => this.onclose && this.onclose({}), 20); }
      send() {} close() {} };"""


def key_hash(host, port):
    """The hash of a server's public key as Chromium's --ignore-certificate-errors-spki-list wants it."""
    pem = ssl.get_server_certificate((host, port))
    key = subprocess.run(["openssl", "x509", "-pubkey", "-noout"], input=pem.encode(), stdout=subprocess.PIPE, check=True)
    der = subprocess.run(["openssl", "pkey", "-pubin", "-outform", "der"], input=key.stdout, stdout=subprocess.PIPE, check=True)
    return base64.b64encode(hashlib.sha256(der.stdout).digest()).decode()


@tests.add
def over_tls():
    """a self-signed certificate: refused by a browser that does not know it; the picture arrives in one that does"""
    with WebFarm() as farm:
        farm.start_coordinator("--web", "0.0.0.0:0")
        farm.start_worker()
        port = int(farm.page_address.rsplit(":", 1)[1])
        origin, token = "https://127.0.0.1:%d" % port, farm.tokens["start"]
        job = farm.submit(AREA, *LONG)
        with Browser() as strange:
            page = strange.page()
            page.allow("ERR_CERT")
            try:
                page.open(origin + "/#token=" + token)
                raise AssertionError("an unknown certificate was accepted")
            except Failure as failure:
                expect("ERR_CERT_AUTHORITY_INVALID" in str(failure), failure)
        with Browser(["--ignore-certificate-errors-spki-list=" + key_hash("127.0.0.1", port)]) as browser:
            page = browser.page(width=1600, height=1000)
            page.open(origin + "/#token=" + token)
            connected(page)
            page.js("location.hash = '#/job/%d'" % job)
            page.wait("%s?.pixels && %s.pixels.arrived === %s.pixels.tiles" % (PICTURE, PICTURE, PICTURE), "the picture")
            expect(page.sockets and all(s.startswith("wss://") for s in page.sockets), page.sockets)
            cookies = page.call("Network.getCookies")["cookies"]
            expect(cookies and all(c["secure"] and c["httpOnly"] and c["sameSite"] == "Strict" for c in cookies), cookies)
            verb(page, "Pause")
            farm.wait_for_job(job, "paused")


@tests.add
def many_windows_at_once():
    """three windows with a picture and four with lists: all are live, and none keeps another's requests waiting"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(AREA, *LONG)
        pages = [farm.page(browser, "#/job/%d" % job, width=1200)]
        for number in range(1, WINDOWS):
            page = browser.page("%s/#/%s" % (farm.origin(), "job/%d" % job if number < 3 else "workers"), width=1200)
            connected(page)
            pages.append(page)
        for page in pages[:3]:
            page.wait("%s?.pixels && %s.pixels.arrived === %s.pixels.tiles" % (PICTURE, PICTURE, PICTURE), "the picture")
        for page in pages:
            expect(page.js("fetch('/api/v1/farm', {signal: AbortSignal.timeout(%d)}).then(r => r.status)" % (
                10000 * PATIENCE)) == 200, "a request")
        verb(pages[0], "Pause")
        for page in pages:
            page.wait("[...document.querySelectorAll('[data-job=\"%d\"]')].some(e => e.classList.contains('paused'))" % job,
                      "each window to know of the pause")


@tests.add
def without_websockets():
    """where WebSockets do not get through the page says so, reads the lists again by itself, and shows previews"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(AREA, *LONG, "--name", "kitchen")
        page = browser.page(width=1600, height=1000)
        page.allow("404.*preview.png")  # a frame has none before its first samples
        page.call("Page.addScriptToEvaluateOnNewDocument", {"source": NO_SOCKETS})
        page.open("%s/#token=%s" % (farm.origin(), farm.token("start")))
        page.wait_text("live connection", "#connection-bar")
        page.wait_text("kitchen", "#queue")
        page.js("location.hash = '#/job/%d'" % job)
        page.wait("document.querySelector('img.picture')?.naturalWidth === 160", "the coordinator's preview", 30)
        farm.submit(AREA, *LONG, "--name", "hall")
        page.wait_text("hall", "#queue", 30)
        verb(page, "Pause")
        farm.wait_for_job(job, "paused")
        farm.coordinator.kill()
        page.allow("ERR_CONNECTION")
        page.wait_text("No connection since", "#connection-bar", 30)
        farm.restart_coordinator()
        page.wait_text("live connection", "#connection-bar", 30)


@tests.add
def a_scene_by_its_form():
    """the form has operator, denoising with the frames around, rotation, layers and tags; the job's settings say so"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        page = farm.page(browser, "#/submit", width=1600, height=1000)
        page.allow("404.*preview.png")  # a frame has none before its first samples
        page.wait("document.querySelector('form.submit [name=tonemap] option[value=drago03]')", "the operators")
        page.give_files("#pick-files", [farm.scene()])
        page.wait("document.querySelector('#scene option')", "the scene")
        page.click("form.submit summary")
        wanted = {"size": "32x32", "spp": "4", "frames": "1-3", "tonemap": "drago03", "denoise-around": "1", "env-rotate": "90",
                  "aov": "depth,normal", "require": "big"}
        for name, value in wanted.items():
            page.js("document.querySelector('form.submit [name=%s]').value = '%s'" % (name, value))
        page.click("form.submit .primary")
        page.wait_text("only where Denoise is on", "form.submit .problem")
        page.js("document.querySelector('form.submit [name=denoise]').value = 'on'")
        page.click("form.submit .primary")
        page.wait("location.hash.startsWith('#/job/')", "the job")
        job = farm.job(int(page.js("location.hash").split("/")[-1]))
        expect(job["output"]["tonemap"] == "drago03" and job["output"]["denoise"] == "on" and job["output"]["denoise_around"] == 1, job["output"])
        expect({"depth", "normal", "position"} <= set(job["settings"]["aovs"]) and job["require"] == "big", job)
        page.click("=Settings")
        page.wait_text("denoised.*yes, with 1 frame before and after each", "#side")


@tests.add
def a_local_render():
    """the address that `render --web` prints shows the picture as it comes; finish on the page ends the render"""
    with WebFarm() as farm, Browser() as browser:
        child = farm.start_cli("render", AREA, *LONG, "-o", farm.path("out"), "--web", "--quiet")
        try:
            url = re.match(r"page: (http://\S+)", child.stderr.readline().decode()).group(1)
            page = browser.page(width=1600, height=1000)
            page.allow("WebSocket|ERR_CONNECTION|Failed to fetch")
            page.open(url)
            connected(page)
            page.wait("%s && %s.pixels && %s.pixels.arrived === %s.pixels.tiles" % ((PICTURE, ) * 4), "the picture")
            verb(page, "Finish")
            expect(child.wait(60 * PATIENCE) == 0, "the render's end: %s" % child.stderr.read().decode())
            expect(glob.glob(farm.path("out*.png")), "no picture: %s" % os.listdir(farm.folder))
            page.wait("document.getElementById('connection-bar').checkVisibility()", "the page to say that it ended")
        finally:
            if child.poll() is None:
                child.send_signal(signal.SIGINT)
            child.communicate(timeout=60 * PATIENCE)


if __name__ == "__main__":
    tests.run()
