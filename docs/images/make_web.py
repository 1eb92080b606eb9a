#!/usr/bin/env python3
"""Make the screenshots of docs/WEB.md again: a busy farm, every view, dark and light, wide and phone.

    docs/images/make_web.py --models FOLDER --skies FOLDER [--only PATTERN]

Needs Chromium. --models: a folder with the Khronos sample assets ToyCar, GlassVaseFlowers and FlightHelmet
(CC0: docs/MODELS.md); --skies: one with vestibule_1k.hdr and studio_small_05_1k.hdr (CC0, Poly Haven). Four
minutes on two idle processors. BUILD names the build tree.
"""
import argparse
import os
import re
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests", "web"))

from browser import Browser  # noqa: E402
from farm import wait_for  # noqa: E402
from webfarm import WebFarm  # noqa: E402

IMAGES = os.path.join(ROOT, "docs", "images")
BYTES_MAX = 120000
WIDE, SMALL = {"width": 1600, "height": 1000}, {"width": 800, "height": 600}
PHONE = {"width": 390, "height": 844, "scale": 2, "phone": True}
AT = {"USER": "maria"}


def submit(farm, scene, name, *options):
    return farm.cli("submit", scene, "--name", name, "--json", *map(str, options), expect=0, env=AT).json()["job"]


class Busy:
    """A farm with jobs in every state. `car` is in work, `vase` waits, an animation is paused, others ended."""

    def __init__(self, farm, models, skies):
        self.farm = farm
        vestibule, studio = (os.path.join(skies, n + ".hdr") for n in ("vestibule_1k", "studio_small_05_1k"))
        car, vase, helmet = (os.path.join(models, *p) for p in (
            ("ToyCar", "ToyCar.gltf"), ("GlassVaseFlowers", "GlassVaseFlowers.glb"),
            ("FlightHelmet", "FlightHelmet.gltf")))
        box = os.path.join(ROOT, "scenes", "cornell", "cornell-area.gltf")
        spheres = os.path.join(ROOT, "scenes", "studio", "textured-spheres.gltf")
        farm.start_coordinator()
        for name in ("ana", "rui", "lab-3"):
            farm.start_worker("--name", name)
        farm.wait_for_workers(3)
        self.done = submit(farm, helmet, "helmet", "--env", studio, "--size", "480x360", "--spp", "24",
                           "--tonemap", "agx")
        farm.wait_for_job(self.done, limit_s=300)
        self.ended = submit(farm, box, "box tests", "--size", "64x64", "--spp", "8")
        farm.wait_for_job(self.ended)
        stopped = submit(farm, spheres, "spheres, too dark", "--size", "256x256", "--spp", "4000")
        wait_for(lambda: farm.job(stopped)["state"] == "running", "the job to run")
        farm.cli("cancel", stopped, expect=0)
        self.car = submit(farm, car, "toy car", "--env", vestibule, "--size", "960x600", "--target-error", "2/255",
                          "--spp", "4096", "--tonemap", "reinhard02", "--priority", 10, "--aov", "normal,depth")
        self.paused = submit(farm, spheres, "spheres turntable", "--frames", "1-48", "--size", "640x360")
        farm.cli("pause", self.paused, expect=0)
        self.vase = submit(farm, vase, "vase", "--env", vestibule, "--size", "960x600", "--target-error", "3/255")
        self.later = submit(farm, vase, "vase, close", "--env", vestibule, "--size", "1920x1080", "--spp", "512",
                            "--after", self.vase)
        submit(farm, helmet, "helmet, final", "--env", studio, "--size", "1920x1080", "--target-error", "1/255")
        farm.cli("workers", "drain", "lab-3", expect=0)

    def wait_for_samples(self, per_pixel):
        """Until the car's picture has so many samples a pixel."""
        def enough():
            info = self.farm.api("GET", "/jobs/%d" % self.car)
            info = info["jobs"][0] if "jobs" in info else info
            return int(info["samples_done"]) >= per_pixel * 960 * 600
        wait_for(enough, "%d samples a pixel" % per_pixel, 600)


class Camera:
    """Takes a view dark and light; a file over the limit is made again with a lower quality."""

    def __init__(self, farm, browser, only):
        self.farm, self.browser, self.only = farm, browser, only

    def take(self, name, link, how, prepare=None, schemes=("light", "dark"), page=None):
        if not re.search(self.only, name):
            return
        for scheme in schemes:
            shown = page or self.farm.page(self.browser, link, dark=scheme == "dark", **how)
            if page:
                page.media(dark=scheme == "dark")
            if prepare:
                prepare(shown)
            shown.frames(10)
            path = os.path.join(IMAGES, "web-%s-%s.webp" % (name, scheme))
            for quality in (90, 80, 70, 60, 45, 30):
                data = shown.screenshot(form="webp", quality=quality)
                if len(data) <= BYTES_MAX:
                    break
            with open(path, "wb") as out:
                out.write(data)
            print("%s: %d bytes, quality %d" % (os.path.relpath(path, ROOT), len(data), quality), flush=True)
            if not page:
                shown.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--models", required=True)
    parser.add_argument("--skies", required=True)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    with WebFarm() as farm, Browser() as browser:
        busy = Busy(farm, options.models, options.skies)
        camera = Camera(farm, browser, options.only)
        busy.wait_for_samples(6)
        views(farm, browser, busy, camera)
    empty(camera)


def overlay(page):
    page.wait("document.getElementById('picture').picture?.map || document.querySelector('canvas')")
    page.js("(() => { const p = document.getElementById('picture').picture; p.controls.overlay.value = 'workers';"
            " p.controls.overlay.dispatchEvent(new Event('change')); })()")
    page.wait("/ana/.test(document.getElementById('picture').innerText)")


def details(page):
    page.click("#tabs [data-tab=details]")


def queue(page):
    page.click("#tabs [data-tab=queue]")


def all_tiles(page):
    page.wait("(p => p && p.pixels && p.pixels.arrived === p.pixels.tiles)(document.getElementById('picture').picture)")


def then_overlay(page):
    all_tiles(page)
    overlay(page)


def views(farm, browser, busy, camera):
    job = "#/job/%d" % busy.car
    camera.take("farm", job, WIDE, all_tiles)
    camera.take("overlay", job, WIDE, then_overlay)
    camera.take("done", "#/job/%d" % busy.done, WIDE, all_tiles)
    camera.take("events", "#/events", WIDE, lambda page: page.wait("document.querySelectorAll('.log li').length > 5"))
    for name in ("workers", "store", "access"):
        camera.take(name, "#/" + name, WIDE, lambda page: page.wait("document.querySelector('#view tbody tr')"))
    camera.take("submit", "#/submit", WIDE)
    camera.take("worker", "#/worker/ana", WIDE, lambda page: page.wait("document.querySelectorAll('.log li').length > 1"))
    camera.take("phone-queue", job, PHONE, queue)
    camera.take("phone-picture", job, PHONE, all_tiles)
    camera.take("phone-details", job, PHONE, details)
    if re.search(camera.only, "login"):
        with Browser() as fresh:
            page = fresh.page(farm.origin(), **SMALL)
            page.allow("401")
            page.wait("document.querySelector('main.login')")
            camera.take("login", None, SMALL, page=page)
    if re.search(camera.only, "lost"):
        page = farm.page(browser, job, **WIDE)
        page.allow("WebSocket|ERR_|Failed to")
        all_tiles(page)
        farm.coordinator.kill()
        page.wait("document.getElementById('connection-bar').checkVisibility()")
        camera.take("lost", None, WIDE, page=page)


def empty(camera):
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator(listen="127.0.0.1:7420")
        camera.farm, camera.browser = farm, browser
        camera.take("empty", "#/", WIDE)


main()
