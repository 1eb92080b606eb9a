#!/usr/bin/env python3
"""The live picture is the picture: what the display shows is compared with the files that the farm makes."""
import glob
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import Tests, read_bytes, wait_for  # noqa: E402
from jobs import AREA, expect  # noqa: E402
from shown import canvas_pixels, canvas_place, largest_difference, picture_pixels, png_rows  # noqa: E402
from webfarm import WebFarm, connected  # noqa: E402

tests = Tests()
WIDTH, HEIGHT = 70, 50  # tiles at the right and below are cut
PICTURE = "document.getElementById('picture').picture"

# Each operator that the page draws itself, with options that tell it from its presets.
DRAWN = {
    "linear": ({}, {}), "normalize": ({}, {}), "aces-hill": ({}, {}), "gamma": ({"gamma": 1.8, "gain": 1.5}, {}), "reinhard02": ({"white": 3}, {}),
    "drago03": ({"bias": 0.7}, {}), "aces": ({}, {"exposure": 1.5}), "agx": ({}, {"white-balance": 4000}),
    "pbr-neutral": ({}, {"auto-exposure": "key"}), "hable": ({}, {"auto-exposure": "percentile"}),
}
DEVELOPED = ["mantiuk06", "mantiuk08"]
CUBE = "TITLE \"warm\"\nLUT_3D_SIZE 3\n" + "".join(
    "%g %g %g\n" % (min(1, r / 2 * 1.2), (g / 2) ** 1.3, b / 2 * 0.8)
    for b in range(3) for g in range(3) for r in range(3))


def made(farm, job, operator, parameters, options):
    """The rows of the PNG that the farm makes like this, not dithered; the job keeps the settings."""
    path = farm.path("%s.png" % operator)
    words = ["--tonemap", operator, "--no-dither", "-o", path, "--force"]
    for name, value in parameters.items():
        words += ["-p", "%s=%s" % (name, value)]
    for name, value in options.items():
        words += ["--" + name, str(value)]
    farm.cli("develop", job, *words, expect=0)
    return png_rows(read_bytes(path))


def control(page, name, value):
    """Choose this in one of the lists below the picture."""
    page.js("%s.controls.%s.id = 'to-choose'" % (PICTURE, name))
    page.choose("#to-choose", value)
    page.js("document.getElementById('to-choose').removeAttribute('id')")


def drawn(page):
    """Wait until the canvas shows what the page knows."""
    page.wait(PICTURE + ".settled", "the picture to be drawn")
    page.frames(2)


def at_one_to_one(page):
    """Wait until all of the picture is there, and show it pixel by pixel."""
    page.wait(PICTURE, "the part that shows the picture")
    page.wait("%s.pixels && %s.pixels.arrived === %s.pixels.tiles" % (PICTURE, PICTURE, PICTURE), "all tiles")
    page.js("document.activeElement.blur()")
    page.press("1")
    page.wait("%s.view.scale === 1" % PICTURE, "one pixel a pixel")
    page.frames(3)


def same_look(page, operator):
    """Wait until the page shows the job's own settings, of which the operator is this."""
    page.wait("%s.controls.look && %s.controls.look.operator === '%s' && %s.lookOfJob.operator === '%s'" % (
        PICTURE, PICTURE, operator, PICTURE, operator), "the operator " + operator)
    drawn(page)


def developed_exactly(page, operator, wanted):
    """The page shows the picture that the coordinator developed, and says so."""
    same_look(page, operator)
    page.wait("/developed by the coordinator at/.test(%s.note.textContent)" % PICTURE, operator)
    drawn(page)
    got = largest_difference(picture_pixels(page, WIDTH, HEIGHT), wanted)
    expect(got[0] == 0, "%s differs by %d at %d, %d" % ((operator, ) + got))


def look(page):
    """The middle of the canvas: rows of codes."""
    drawn(page)
    return canvas_pixels(page, 200, 120).codes


@tests.add
def the_display_shows_what_fetch_gives():
    """each operator of WebGL: within 1/255 of the farm's PNG without dither; developed ones: exactly it"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        job = farm.submit(AREA, "--size", "%dx%d" % (WIDTH, HEIGHT), "--spp", "16")
        farm.wait_for_job(job)
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        at_one_to_one(page)
        found = {}
        for operator, (parameters, options) in DRAWN.items():
            wanted = made(farm, job, operator, parameters, options)
            same_look(page, operator)
            found[operator] = largest_difference(picture_pixels(page, WIDTH, HEIGHT), wanted)
            expect("oordinator" not in page.text("#picture .note"), "%s was not drawn by the page" % operator)
        cube = farm.path("warm.cube")
        with open(cube, "w", encoding="ascii") as out:
            out.write(CUBE)
        wanted = made(farm, job, "lut", {}, {"lut": cube})
        developed_exactly(page, "lut", wanted)
        made(farm, job, "linear", {}, {})
        same_look(page, "linear")
        control(page, "operator", "lut")
        page.wait("document.querySelector('#picture input[type=file]')")
        page.wait("/needs a .cube file/.test(%s.note.textContent)" % PICTURE)
        page.give_files("#picture input[type=file]", [cube])
        page.wait(PICTURE + ".controls.look.file", "the .cube file to be read")
        drawn(page)
        found["lut"] = largest_difference(picture_pixels(page, WIDTH, HEIGHT), wanted)
        print("# largest differences: %s" % ", ".join("%s %d" % (n, d[0]) for n, d in found.items()))
        far = {n: d for n, d in found.items() if d[0] > 1}
        expect(not far, "more than 1/255: %s" % far)
        for operator in DEVELOPED:
            developed_exactly(page, operator, made(farm, job, operator, {}, {}))


@tests.add
def the_picture_arrives_and_survives_a_restart():
    """tiles arrive while it renders; after a killed coordinator the picture stays, a bar says so, and it goes on"""
    with WebFarm() as farm, Browser() as browser:
        coordinator = farm.start_coordinator()
        farm.start_worker()
        job = farm.submit(AREA, "--size", "160x96", "--spp", "200000")
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        page.allow("WebSocket|ERR_CONNECTION|Failed to fetch")
        at_one_to_one(page)
        mean = "%s.pixels.samples.reduce((a, b) => a + b, 0)" % PICTURE
        first = page.js(mean)
        wait_for(lambda: page.js(mean) > 1.5 * first, "more samples in the picture")
        coordinator.kill()
        page.wait("document.getElementById('connection-bar').checkVisibility()", "the bar")
        expect("No connection since" in page.text("#connection-bar"), page.text("#connection-bar"))
        drawn(page)
        before = look(page)
        page.wait("/again/.test(document.getElementById('connection-bar').innerText)")
        expect(look(page) == before, "the picture changed without a connection")
        expect(len({c for row in before for c in row}) > 20, "there is no picture")
        expect(page.find("[data-job=\"%d\"]" % job) == 1, "the queue is gone")
        last = page.js(mean)
        farm.restart_coordinator()
        connected(page)
        page.wait("!document.getElementById('connection-bar').checkVisibility()", "the bar to go")
        wait_for(lambda: page.js(mean) > 1.2 * last, "the picture to go on: %s, then %s" % (last, page.js(mean)))
        wait_for(lambda: canvas_pixels(page, 200, 120).codes != before, "another picture than before")


@tests.add
def overlays_and_the_pixel_under_the_pointer():
    """overlays colour tiles by worker, samples, error and time, with a legend; a pixel tells its values"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker("--name", "ana")
        farm.start_worker("--name", "rui")
        farm.wait_for_workers(2)
        job = farm.submit(AREA, "--size", "160x96", "--spp", "64", "--aov", "normal,depth")
        farm.wait_for_job(job)
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        at_one_to_one(page)
        plain = look(page)
        kinds = page.js("[...%s.controls.overlay.options].map(o => o.value)" % PICTURE)
        expect(len(kinds) >= 5, kinds)
        for kind in kinds[1:]:
            control(page, "overlay", kind)
            page.wait("%s.controls.legend.checkVisibility() && %s.controls.legend.innerText.trim().length > 2" % (PICTURE, PICTURE), kind)
            wait_for(lambda: look(page) != plain, "the overlay '%s' to be seen" % kind)
            if kind == "workers":
                owners = [t["worker"] for t in farm.cli("owners", job, "--json", expect=0).json()["tiles"]]
                expect(owners and set(owners) <= {"ana", "rui"}, owners)
                for name in set(owners):  # one may have most samples of every tile
                    page.wait("[...%s.controls.legend.children].some(e => e.textContent === '%s %d')" % (PICTURE, name, owners.count(name)),
                              "%s's tiles to be those that azulejo owners counts" % name)
        control(page, "overlay", kinds[0])
        left, top, width, height = canvas_place(page)
        page.mouse("mouseMoved", left + width / 2, top + height / 2)
        page.wait("/linear .*display .*samples/s.test(%s.reading.textContent)" % PICTURE, "the pixel's values")
        page.wait("/(ana|rui)/.test(%s.reading.textContent)" % PICTURE, "the tile's worker")
        print("# " + page.js("%s.reading.textContent" % PICTURE))
        expect("finished" in page.js("%s.canvas.getAttribute('aria-label')" % PICTURE), "the text alternative")
        layers = page.js("[...%s.controls.layer.options].map(o => o.value)" % PICTURE)
        for layer in ("N", "normal"):
            if layer in layers:
                break
        else:
            layer = [n for n in layers if n != "color"][0]
        control(page, "layer", layer)
        wait_for(lambda: look(page) != plain, "the layer '%s' of %s to be seen" % (layer, layers))


@tests.add
def a_look_becomes_the_files():
    """A|B shows the picture in two operators; Apply makes the job's files as the page shows them"""
    with WebFarm() as farm, Browser() as browser:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        job = farm.submit(AREA, "--size", "%dx%d" % (WIDTH, HEIGHT), "--spp", "16")
        farm.wait_for_job(job)
        before = farm.path("before")
        farm.cli("fetch", job, "-o", before, expect=0)
        page = farm.page(browser, "#/job/%d" % job, width=1600, height=1000)
        at_one_to_one(page)
        drawn(page)
        plain = canvas_pixels(page, WIDTH, HEIGHT)
        page.click("=A|B")
        control(page, "other", "linear")
        page.js(PICTURE + ".setSplit(0.5)")
        drawn(page)
        both = canvas_pixels(page, WIDTH, HEIGHT)
        middle, n = WIDTH // 2 * both.channels, both.channels * 14  # what is under the border's handle
        sides = [sum(p != q for a, b in zip(plain.codes, both.codes) for p, q in zip(a[part], b[part]))
                 for part in (slice(middle - n), slice(middle + n, None))]
        expect(min(sides) == 0 and max(sides) > WIDTH * HEIGHT / 8, "pixels that differ left and right: %s" % sides)
        page.click("=A|B")
        control(page, "operator", "aces")
        page.click("=Apply to the job")
        wait_for(lambda: farm.api("GET", "/jobs/%d" % job)["jobs"][0]["output"]["tonemap"] == "aces", "the operator")
        same_look(page, "aces")
        farm.wait_for_job(job)
        drawn(page)
        shown = picture_pixels(page, WIDTH, HEIGHT)
        path = farm.path("after")
        wait_for(lambda: farm.job(job).get("frames_to_develop", 0) == 0, "the files")
        farm.cli("fetch", job, "-o", path, expect=0)
        first, after = (png_rows(read_bytes(glob.glob(p + "/**/*.png", recursive=True)[0])) for p in (before, path))
        expect(largest_difference(first, after)[0] > 8, "the file did not change")
        got = largest_difference(shown, after)
        expect(got[0] <= 2, "the file differs from the page by %d at %d, %d" % got)  # it is dithered


if __name__ == "__main__":
    tests.run()
