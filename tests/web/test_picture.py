#!/usr/bin/env python3
"""The page's picture: its operators are the farm's, and what is drawn, read and chosen is right."""
import base64
import json
import math
import os
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from farm import BIN, Tests  # noqa: E402
from jobs import expect  # noqa: E402
from png import Png  # noqa: E402
from stage import Light, Stage, context, wild_light  # noqa: E402

tests = Tests()

# Looks as the page has them, and the options that ask `azulejo tonemap` for the same.
LOOKS = [
    ("linear", {}, {}), ("linear", {}, {"ev": -3.5}),
    ("gamma", {}, {}), ("gamma", {"gamma": 1.6, "gain": 1.3}, {"ev": 1}),
    ("normalize", {}, {}), ("normalize", {"percentile": 90}, {"ev": 2, "kelvin": 3200}),
    ("reinhard02", {}, {}), ("reinhard02", {"key": 0.5, "white": 4}, {"ev": 1.25}),
    ("reinhard02", {}, {"kelvin": 2856, "metering": "key", "ev": -1}),
    ("reinhard02", {"white": 0}, {}), ("drago03", {"percentile": 100}, {"ev": 1}), ("drago03", {"percentile": 90}, {}),
    ("drago03", {}, {}), ("drago03", {"bias": 0.7, "display": 80}, {"ev": -2}),
    ("aces", {}, {}), ("aces", {}, {"ev": 3}), ("aces", {}, {"ev": -4}), ("aces", {}, {"kelvin": 9000}),
    ("aces-hill", {}, {}), ("aces-hill", {}, {"ev": 2}),
    ("agx", {}, {}), ("agx", {"outset": 1}, {"ev": 1}),
    ("pbr-neutral", {}, {}), ("pbr-neutral", {}, {"ev": 2, "kelvin": 4500}),
    ("hable", {}, {}), ("hable", {"white": 4, "bias": 1}, {"ev": 1}),
    ("linear", {}, {"metering": "percentile", "percentile": 80}), ("linear", {}, {"metering": "key"}),
    ("aces", {}, {"metering": "percentile", "percentile": 99, "kelvin": 7500}),
    ("lut", {}, {}), ("lut", {"input": 1, "result": 1}, {}), ("lut", {"input": 2}, {"ev": -1}),
]
WORDS = {"outset": ["off", "on"], "input": ["srgb", "linear", "log2"], "result": ["display", "linear"]}


def cube_text():
    """A line of 5 entries with a range of its own, and a cube of 4^3 that turns colours."""
    rows = ["# made up", "LUT_1D_SIZE 5", "LUT_1D_INPUT_RANGE -0.1 1.2", "LUT_3D_SIZE 4"]
    rows += ["%g %g %g" % ((i / 4) ** 0.8, i / 4, (i / 4) ** 1.2) for i in range(5)]
    rows += ["%g %g %g" % (0.2 + 0.7 * (r / 3) ** 2, 0.8 * g / 3 + 0.1 * b / 3, 1 - 0.9 * (b / 3) ** 0.5 + 0.05 * r)
             for b in range(4) for g in range(4) for r in range(4)]
    return "\n".join(rows) + "\n"


def farm_codes(exr, cube, look, folder):
    """The codes of `azulejo tonemap`, rounded."""
    name, values, rest = look
    argv = [os.path.join(BIN, "azulejo"), "tonemap", exr, "-o", os.path.join(folder, "out.png"), "-t", name,
            "--no-dither", "--exposure", str(rest.get("ev", 0))]
    for key, value in values.items():
        argv += ["-p", "%s=%s" % (key, WORDS[key][value] if key in WORDS else value)]
    if name == "lut":
        argv += ["--lut", cube]
    if "metering" in rest:
        argv += ["--auto-exposure", rest["metering"]]
    if rest.get("metering") == "percentile":
        argv += ["--percentile", str(rest["percentile"])]
    if "kelvin" in rest:
        argv += ["--white-balance", str(rest["kelvin"])]
    subprocess.run(argv, check=True, stdout=subprocess.DEVNULL)
    with open(os.path.join(folder, "out.png"), "rb") as file:
        return Png(file.read()).codes


OPERATE = """(async () => {
  const {Pixels, eachTile} = await import('/assets/picture/pixels.js');
  const {Screen} = await import('/assets/picture/gl.js');
  const {prepare, readCube} = await import('/assets/picture/tonemap.js');
  const {presetsOf} = await import('/assets/picture/controls.js');
  const look = %s, operators = %s, cube = %s;
  if (!window.screen3) {
    window.pixels3 = new Pixels(%d, %d);
    window.screen3 = new Screen(document.createElement('canvas'));
    screen3.setPixels(pixels3);
    const bytes = Uint8Array.from(atob(%s), c => c.charCodeAt(0));
    eachTile(bytes.buffer, tile => { if (!pixels3.take(tile)) throw new Error('a tile was refused'); screen3.changed(tile.tile); });
  }
  const [operator, values, rest] = look;
  const all = {...presetsOf(operators.find(o => o.name === operator)), ...values};
  const one = {operator, values: all, ev: rest.ev || 0, metering: rest.metering || 'off', percentile: rest.percentile || 99, kelvin: rest.kelvin || 0};
  const pane = {operator, ...prepare(one, pixels3), file: operator === 'lut' ? readCube(cube, 'made.cube') : undefined};
  return [...screen3.codes(pane).data];
})()"""


@tests.add
def operators_are_the_farms():
    """every operator of the page gives the codes of `azulejo tonemap` within 1, with exposure, metering and white balance"""
    light = wild_light(67, 45)
    operators = json.loads(subprocess.run([os.path.join(BIN, "azulejo"), "tonemap", "--list", "--json"], check=True,
                                          stdout=subprocess.PIPE).stdout)["operators"]
    with tempfile.TemporaryDirectory() as folder, Stage() as site, Browser() as browser:
        exr, cube = os.path.join(folder, "in.exr"), os.path.join(folder, "made.cube")
        with open(exr, "wb") as file:
            file.write(light.exr())
        with open(cube, "w", encoding="ascii") as file:
            file.write(cube_text())
        page = browser.page(site.url())
        tiles, wrong = json.dumps(base64.b64encode(light.tiles()).decode()), []
        for look in LOOKS:
            want = farm_codes(exr, cube, look, folder)
            got = page.js(OPERATE % (json.dumps(look), json.dumps(operators), json.dumps(cube_text()), light.width,
                                     light.height, tiles))
            channels = len(want[0]) // light.width
            worst = max(abs(want[y][channels * x + c] - got[4 * (y * light.width + x) + c])
                        for y in range(light.height) for x in range(light.width) for c in range(3))
            spread = len({v for row in want for v in row})
            if worst > 1 or spread < 20:
                wrong.append("%s: off by %d codes; the picture has %d different ones" % (look, worst, spread))
        expect(not wrong, "\n".join(wrong))


INFO = {"job": 1, "name": "helmet", "state": "done", "verbs": ["extend"], "owner": "maria@ana", "samples_done": 100, "cores": 2.0,
        "output": {"tonemap": "linear", "parameters": {}, "exposure_ev": 0.0, "metering": "", "metering_percentile": 0.0,
                   "white_kelvin": 0.0, "camera_ev": 0.0, "formats": ["png"]},
        "stop": {"measure": "display", "target": 4.0}, "now_frame": 1, "stats": {"accounts": [60, 30, 0, 10]}}
FIGURES = ((1, 20, 18, 23), (2, 13, 12, 14.5), (4, 9.5, 9, 10.1), (9, 6.1, 0, 0), (16, 4.9, 4.7, 5.1))
POINTS = [{"core_seconds": c, "samples": 100 * c, "figures": {"display": e, "display_low": lo, "display_high": hi,
                                                            "psnr_db": 30 + c, "psnr_low": 29 + c, "psnr_high": 31 + c}}
          for c, e, lo, hi in FIGURES]


def curve(measure, error):
    """What the coordinator sends of a curve that falls with the root of the cost, from this error at 16 core-seconds on."""
    return {"measure": measure, "stop": 1.0, "width": 10.0, "points": [{"error": error / (1 + i / 4), "core_seconds": 16 * (1 + i / 4) ** 2,
                                            "core_seconds_low": 15 * (1 + i / 4) ** 1.9, "core_seconds_high": 17 * (1 + i / 4) ** 2.1}
                                           for i in range(48)]}


def soft_light(width, height):
    return Light(width, height, lambda x, y: (x / width, y / height, 0.25 + 0.5 * ((x // 7 + y // 5) % 2), 0.01))


def answers(width=67, height=45):
    tiles = ((width + 15) // 16) * ((height + 15) // 16)
    operators = json.loads(subprocess.run([os.path.join(BIN, "azulejo"), "tonemap", "--list", "--json"], check=True,
                                          stdout=subprocess.PIPE).stdout)
    return {"/operators": operators, "/effects": {"effects": ["diffuse", "glossy", "mirror"]},
            "/jobs/1/frames/1/history": {"points": POINTS, "curves": [curve("display", 4.9), curve("psnr", 1.278)]},
            "/jobs/1/frames/1/tiles": {
                "width": width, "height": height, "workers": [{"name": "ana"}, {"name": "<img src=x onerror=alert(1)>"}],
                "tiles": [{"samples": 16, "error": 1.5 + i, "cpu_ns": (i + 1) * 100000000, "units": 3, "worker": 1 + i % 2,
                           "thread": 1 + i % 4} for i in range(tiles)]}}


def begin(page, light, info=None, layers=("color",), tiles=None, more=None):
    page.js(context(info or INFO, dict(answers(light.width, light.height), **(more or {}))))
    show(page, light, layers, tiles)
    page.wait("stage.picture.controls.ready")
    page.frames()


def show(page, light, layers=("color",), tiles=None, **more):
    page.js("stage.begin(%s)" % json.dumps(dict({"job": 1, "frame": 1, "width": light.width, "height": light.height,
                                                 "layers": list(layers), "complete": False}, **more)))
    send(page, light, tiles)


def send(page, light, tiles=None):
    page.js("stage.send('%s')" % base64.b64encode(light.tiles(wanted=tiles)).decode())
    page.frames()


def seen(page):
    """The picture as it is on the screen at 1:1: rows of (r, g, b)."""
    page.wait("stage.picture.settled", "all to be drawn")
    left, top, width = page.js("(r => [r.x, r.y, r.width])(document.querySelector('canvas.picture').getBoundingClientRect())")
    x, y, pixels, dense, across, down = page.js("(({view: v, canvas: c}) => [v.x, v.y, c.width, devicePixelRatio, ...v.size])(stage.picture)")
    expect(pixels == width * dense, "the canvas has %d pixels across and the screen %g" % (pixels, width * dense))
    # Whole pixels of the page around the picture.
    x0, y0 = int(x // dense), int(y // dense)
    png = Png(page.screenshot((left + x0, top + y0, (x + across) // dense + 1 - x0, (y + down) // dense + 1 - y0)))
    x, y = x - x0 * dense, y - y0 * dense
    return [[row[png.channels * i:png.channels * i + 3] for i in range(x, x + across)] for row in png.codes[y:y + down]]


def srgb(light):
    light = min(max(light, 0), 1)
    return 255 * (12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055)


@tests.add
def pixels_are_pixels_of_the_screen():
    """at 1:1 each pixel of the picture is one of the screen, on ordinary and on dense screens, and later tiles replace earlier ones"""
    light, later = soft_light(67, 45), wild_light(67, 45, 5)
    for scale in (1, 2):
        with Stage() as site, Browser() as browser:
            page = browser.page(site.url(), width=1300, height=800, scale=scale)
            begin(page, light, tiles=range(0, 14))
            page.click("~Pixel by pixel")
            page.frames()
            rows = seen(page)
            for x, y in ((0, 0), (15, 15), (16, 0), (40, 31), (66, 20)):
                want = [srgb(v) for v in light.rows[y][x][:3]]
                expect(all(abs(a - b) <= 1 for a, b in zip(want, rows[y][x])), (scale, x, y, want, rows[y][x]))
            expect(len({p for row in rows[32:] for p in row[64:]}) == 1, "tiles that are not there are of one grey")
            send(page, light)
            send(page, later, tiles=[3])
            rows = seen(page)
            want = [srgb(v) for v in later.rows[9][52][:3]]
            expect(all(abs(a - b) <= 1 for a, b in zip(want, rows[9][52])), (want, rows[9][52]))
            want = [srgb(v) for v in light.rows[44][66][:3]]
            expect(all(abs(a - b) <= 1 for a, b in zip(want, rows[44][66])), (want, rows[44][66]))


COUNT_DRAWS = """(() => { const {screen} = stage.picture, draw = screen.draw; stage.whole = stage.parts = 0;
    screen.draw = (panes, view, opacity, all) => { stage[all ? 'whole' : 'parts']++; draw.call(screen, panes, view, opacity, all); }; })()"""


def whole_draws(page):
    """How often all was drawn, and how often changed tiles alone."""
    return page.js("[stage.whole, stage.parts]")


@tests.add
def changed_tiles_are_drawn_alone():
    """a tile that came is drawn alone, as all of it would be: at every scale, with two operators and under an overlay"""
    light, later = soft_light(167, 95), wild_light(167, 95, 5)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.js(COUNT_DRAWS)

        def same(where):
            """What stands there after tiles came, and what is drawn when all is drawn again."""
            page.wait("stage.picture.settled", where)
            page.js("stage.whole = stage.parts = 0")
            send(page, later, tiles=[0, 14, 27, 28])
            send(page, later, tiles=[65])
            page.wait("stage.picture.settled", where)
            whole, parts = whole_draws(page)
            expect(whole == 0 and parts >= 1, "%s: all was drawn %d times, tiles alone %d" % (where, whole, parts))
            page.frames()
            got = page.screenshot((0, 0, 900, 560))
            page.js("stage.picture.renew()")
            page.wait("stage.picture.settled", where)
            page.frames()
            expect(whole_draws(page)[0] == 1 and page.screenshot((0, 0, 900, 560)) == got, "%s: another picture" % where)
            send(page, light)

        for scale in (1, 0.31, 0.5, 1.37, 4):
            page.js("stage.picture.view.zoomTo(%g)" % scale)
            same("scale %g" % scale)
        page.js("stage.picture.controls.toggleWipe(); stage.picture.setSplit(0.43)")
        same("two operators")
        page.js("(() => { const {overlay} = stage.picture.controls; overlay.value = 'time'; overlay.dispatchEvent(new Event('change')); })()")
        page.wait("stage.picture.map && !stage.picture.mapBusy")
        page.js("stage.picture.mapAsked = Infinity")  # its answer draws all
        same("an overlay")


@tests.add
def what_can_hardly_be_seen_waits():
    """a measure of the picture that changes by little draws it again when no more tiles come, and one that changes by much at once"""
    light = soft_light(67, 45)
    # Of 15 tiles one: the mean changes by 4 and by 0.3 %.
    bright, brighter = (Light(67, 45, lambda x, y, by=by: tuple(c * by for c in light.rows[y][x])) for by in (1.8, 1.88))
    look = json.dumps(dict(INFO["output"], tonemap="reinhard02"))
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.js("stage.info = {...stage.info, output: %s}; stage.emit('job')" % look)
        page.click("~Pixel by pixel")
        seen(page)
        page.js("stage.picture.quietMs = 3.6e6")  # an hour
        page.js(COUNT_DRAWS)
        idle = "stage.picture.screen.isDone && !stage.picture.screen.waiting.size && stage.parts + stage.whole"
        send(page, bright, tiles=[6])
        page.wait("stage.whole && stage.picture.settled", "all to be drawn after a change of 4 %")
        page.js("stage.whole = stage.parts = 0")
        for _ in range(3):
            send(page, brighter, tiles=[6])
            page.wait(idle)
            page.frames(3)
        expect(whole_draws(page)[0] == 0 and not page.js("stage.picture.settled"), "after small ones: %s" % whole_draws(page))
        page.js("stage.picture.settled = true")
        between = seen(page)
        page.js("stage.picture.settled = false; stage.picture.quietMs = 0; stage.picture.redraw()")
        rows = seen(page)
        expect(whole_draws(page)[0] == 1, "when no tiles come: %s" % whole_draws(page))
        apart = max(abs(a - b) for r, s in zip(rows, between) for p, q in zip(r, s) for a, b in zip(p, q))
        expect(apart <= 1, "until then it was off by %d" % apart)
        page.js("stage.picture.renew()")
        expect(seen(page) == rows, "all of it is what it should be")


# Tiles come every 5 ms for a second: how often they were drawn, and how often that may be.
STREAM = """(async () => { const begin = performance.now(), body = Uint8Array.from(atob('%s'), c => c.charCodeAt(0)).buffer;
  while (performance.now() < begin + 1000) { stage.watches.at(-1).to.tiles(body); await new Promise(done => setTimeout(done, 5)); }
  return [stage.parts, (performance.now() - begin) / 80 + 2]; })()"""


@tests.add
def tiles_are_drawn_twelve_times_a_second():
    """however many come; and as soon as more than 2,048 wait"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        seen(page)
        page.js(COUNT_DRAWS)
        parts, most = page.js(STREAM % base64.b64encode(light.tiles(wanted=[6])).decode())
        expect(parts <= most, "drawn %d times, of %.1f" % (parts, most))
        page.wait("stage.parts && stage.picture.settled", "the last of them")
        page.js("stage.picture.tilePace.until = performance.now() + 3.6e6")  # an hour
        page.js("Object.defineProperty(stage.picture.screen, 'isFull', {value: true}); stage.parts = 0")
        send(page, light, tiles=[6])
        page.wait("stage.parts", "the tiles to be drawn")


@tests.add
def a_slow_display_is_spared():
    """where drawing takes long, what follows the measure of the picture waits, changed tiles and people do not"""
    light, later = soft_light(67, 45), wild_light(67, 45, 5)
    look = json.dumps(dict(INFO["output"], tonemap="reinhard02"))
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.js("stage.info = {...stage.info, output: %s}; stage.emit('job')" % look)
        page.click("~Pixel by pixel")
        before = seen(page)
        # An hour: setTimeout takes Infinity for 0.
        page.js("stage.picture.pace.until = performance.now() + 3.6e6")
        send(page, later, tiles=[3])
        page.wait("stage.picture.timer && stage.picture.screen.isDone && !stage.picture.screen.waiting.size")
        page.frames()
        page.js("stage.picture.settled = true")
        between = seen(page)
        apart = {(x // 16, y // 16) for y, row in enumerate(between) for x, p in enumerate(row) if p != before[y][x]}
        expect(apart == {(3, 0)}, "tiles that changed: %s" % apart)
        page.js("clearTimeout(stage.picture.timer); stage.picture.timer = 0; stage.picture.pace.until = 0; stage.picture.redraw()")
        after = seen(page)
        expect(sum(p != q for a, b in zip(after, between) for p, q in zip(a, b)) > 500, "the operator measures no more")
        page.js("stage.picture.pace.until = performance.now() + 3.6e6; stage.picture.controls.nudge(1)")
        page.wait("stage.picture.screen.isDone && stage.picture.drawn.chosen === stage.picture.chosen()")
        expect(seen(page) != after, "the exposure waits")


@tests.add
def measures_follow_the_tiles():
    """what operators measure is the same whether tiles came once or were replaced, and however often a pixel without light is read"""
    first, then = wild_light(67, 45, 2), wild_light(67, 45, 3)
    then.rows[5][60] = (math.nan, math.nan, math.nan, 0.0)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url())
        begin(page, first)
        measure = """(async () => { const {Pixels, eachTile} = await import('/assets/picture/pixels.js');
          const fresh = new Pixels(67, 45), old = stage.picture.pixels;
          eachTile(Uint8Array.from(atob('%s'), c => c.charCodeAt(0)).buffer, t => fresh.take(t));
          return [old, fresh].map(p => [p.measured(), p.percentile(99, false), p.percentile(50, true), p.percentile(100, true)]); })()"""
        page.js("stage.picture.pixels.percentile(50, true)")
        send(page, then, tiles=[0, 3, 14])
        send(page, then)
        old, fresh = page.js(measure % base64.b64encode(then.tiles()).decode())
        expect(old == fresh, (old, fresh))
        lit = sorted(max(p[:3]) for row in then.rows for p in row if max(p[:3]) > 0)
        expect(fresh[3] == lit[-1] and abs(fresh[2] / lit[int(0.5 * (len(lit) - 1) + 0.5)] - 1) < 1e-6, (fresh, lit[-1]))


@tests.add
def broken_messages_are_refused():
    """a message that is cut short or has impossible tiles is reported, and the picture stays"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url())
        begin(page, light)
        whole = light.tiles(wanted=[0])
        for data in (whole[:60], whole[:12] + b"\x00\x00\x00\x00" + b"\x40\x00\x40\x00" + whole[20:],
                     whole[:12] + b"\xff\xff\xff\xff" + whole[16:]):
            page.js("stage.send('%s')" % base64.b64encode(data).decode())
        page.frames()
        expect(len(page.js("stage.said")) == 2, page.js("stage.said"))
        expect(page.js("stage.picture.pixels.arrived") == 15, "all tiles are there still")


@tests.add
def a_pixel_is_read():
    """hovering and arrow keys tell a pixel's value, error, tile, worker, thread and time; the canvas has words, too"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        label = page.js("document.querySelector('canvas.picture').getAttribute('aria-label')")
        expect("helmet" in label and "frame 1" in label and "67 by 45" in label, label)
        page.click("~Pixel by pixel")
        page.frames()
        at = page.place("canvas.picture")
        x, y = page.js("[stage.picture.view.x, stage.picture.view.y]")
        page.mouse("mouseMoved", at["left"] + x + 40.5, at["top"] + y + 20.5)
        page.wait_text("onerror=alert.1.>, thread 4", "output.reading")
        words, value = page.text("output.reading"), light.rows[20][40]
        expect(words.startswith("40, 20 ") and "tile 7" in words and "300 ms" not in words and "800 ms" in words, words)
        expect("display %d %d %d" % tuple(round(srgb(v)) for v in value[:3]) in words, (words, [srgb(v) for v in value[:3]]))
        expect("16 samples" in words and "3 passes" in words and "8.5/255" in words, words)
        light_of = sum(w * v for w, v in zip((0.212656, 0.715158, 0.072186), value))
        more = max(srgb(v * (1 + value[3] / light_of)) - srgb(v) for v in value[:3])
        told = float(words.split("\u00b1 ")[1].split("/")[0])
        expect(abs(told - more) < 0.05 * more + 0.05, (told, more))
        page.js("document.querySelector('canvas.picture').focus()")
        page.press("ArrowRight", "ArrowRight", "Shift+ArrowDown")
        page.wait_text("34, 38 ", "output.reading")
        expect(page.js("document.querySelector('output.reading').getAttribute('aria-live')") == "polite", "it is spoken")
        expect(page.find(".crosshair"), "a cross hair")


@tests.add
def overlays_have_a_legend():
    """each overlay colours tiles and explains itself; names are text"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        page.js("stage.picture.opacity = 1")
        began = time.monotonic()
        for name, word in (("workers", "<img src=x onerror=alert(1)> 7"), ("error", "1.5/255"), ("time", "1.5 s"), ("samples", "16"),
                           ("pixels", "32/255")):
            page.js("(() => { const {overlay} = stage.picture.controls; overlay.value = '%s'; overlay.dispatchEvent(new Event('change')); })()" % name)
            page.wait("document.querySelector('.legend').textContent.includes(%s)" % json.dumps(word), "%s in the legend" % word)
            page.frames(3)
            rows = seen(page)
            colors = {rows[y + 2][x + 2] for y in range(0, 45, 16) for x in range(0, 67, 16)}
            expect(len(colors) == {"workers": 4, "error": 15, "time": 15, "samples": 1}.get(name, len(colors)), (name, len(colors)))
        asked = [p for p in page.js("stage.asked") if p.split("?")[0].endswith("/tiles")]
        expect(1 <= len(asked) <= 2 + (time.monotonic() - began) / 3, asked)
        page.js("(() => { const {overlay} = stage.picture.controls; overlay.value = 'none'; overlay.dispatchEvent(new Event('change')); })()")
        page.frames(3)
        expect(len({p for row in seen(page) for p in row}) > 500, "the picture is back")
        # The worker with the most samples comes first in `shares`; `worker` is the newest unit's.
        page.js("""(() => { const {picture, answers} = stage, map = Object.values(answers).find(a => a.tiles);
            for (const tile of map.tiles) Object.assign(tile, {worker: 1, shares: [{worker: 2, thread: 1, units: 2, samples: 12}, {worker: 1, thread: 1, units: 1, samples: 4}]});
            window.second = map.workers[1].name; Object.assign(picture, {map: null, mapAsked: 0});
            const {overlay} = picture.controls; overlay.value = 'workers'; overlay.dispatchEvent(new Event('change')); })()""")
        page.wait("document.querySelector('.legend').textContent === `${second} 15`", "all tiles to be those of the second worker")


@tests.add
def fireflies_are_ringed():
    """pixels that one group of samples alone found bright get a ring, stars that both have none; the worst part is framed"""
    fireflies, stars = [(5, 5), (40, 3), (20, 30), (66, 44), (0, 20)], [(28, 14), (55, 24)]

    def value(x, y):
        if (x, y) in fireflies:
            return (0.8, 0.8, 0.8, 0.6)  # 1.4 in one group, 0.2 in the other
        return (0.8, 0.8, 0.8, 0.02) if (x, y) in stars else (0.2, 0.2, 0.2, 0.005)

    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, Light(67, 45, value))
        page.click("~Pixel by pixel")
        expect(not page.find(".rings"), "rings without their overlay")
        page.js("(() => { const {overlay} = stage.picture.controls; overlay.value = 'fireflies'; overlay.dispatchEvent(new Event('change')); })()")
        page.wait("document.querySelector('.legend').textContent.includes('5 pixels stand out')", "the number of fireflies")
        found = page.js("stage.picture.marks")
        expect(sorted(map(tuple, found)) == sorted(fireflies), found)
        page.wait("stage.picture.map", "the tiles")
        page.frames(3)
        # A ring around the firefly, its colour at its edge; nothing around the star.
        pink = """([x, y]) => { const {view, rings} = stage.picture, [left, top] = view.screen([x + .5, y + .5]);
            return [...rings.getContext('2d').getImageData(left - 6, top - 6, 12, 12).data].some((c, i, all) => i % 4 === 0 && c > 200 && all[i + 1] < 150); }"""
        for places, want in ((fireflies[:3], True), (stars, False)):
            for place in places:
                expect(page.js("(%s)(%s)" % (pink, list(place))) is want, (place, want))
        worst = page.js("import('/assets/picture/overlays.js').then(m => m.worstTiles(stage.picture.map))")
        errors = page.js("stage.picture.map.tiles.map(t => t.error)")
        expect(len(worst) >= 1 and max(errors) == errors[worst[-1]], (worst, errors))


@tests.add
def layers_are_shown_as_what_they_are():
    """a layer is watched, and normals and depths are made visible"""
    light, normals = soft_light(67, 45), Light(67, 45, lambda x, y: (0, 0, -1.0, 0))
    depth = Light(67, 45, lambda x, y: ((1.0, 1.0, 1.0, 0) if x < 20 else (8.0, 8.0, 8.0, 0)))
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light, layers=("color", "normal", "depth"))
        page.click("~Pixel by pixel")
        for name, picture, want in (("normal", normals, {(128, 128, 0)}), ("depth", depth, {(255, 255, 255), (26, 26, 26)})):
            page.js("(() => { const {layer} = stage.picture.controls; layer.value = '%s'; layer.dispatchEvent(new Event('change')); })()" % name)
            expect(page.js("stage.watches.at(-1).want.layer") == name and page.js("stage.watches.length") == 1, "the layer is asked for")
            show(page, picture, ("color", "normal", "depth"))
            page.frames(3)
            colors = {p for row in seen(page) for p in row}
            near = all(any(max(abs(a - b) for a, b in zip(c, w)) <= 1 for w in want) for c in colors)
            expect(near and len(colors) == len(want), (name, colors))


@tests.add
def the_farm_develops_what_the_page_cannot():
    """an operator that needs the whole picture is asked of the coordinator once, shown exactly, and said to be so"""
    light = soft_light(67, 45)
    with tempfile.TemporaryDirectory() as folder, Stage() as site, Browser() as browser:
        exr, png = os.path.join(folder, "in.exr"), os.path.join(folder, "out.png")
        with open(exr, "wb") as file:
            file.write(light.exr())
        subprocess.run([os.path.join(BIN, "azulejo"), "tonemap", exr, "-o", png, "-t", "mantiuk06"], check=True, stdout=subprocess.DEVNULL)
        with open(png, "rb") as file:
            data = file.read()
        site.answers["/api/v1/jobs/1/frames/1/preview.png"] = ("image/png", data)
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        page.js("stage.picture.controls.choose('mantiuk06'); stage.picture.controls.setExposure(1)")
        page.wait_text("developed by the coordinator", ".picture-note")
        page.frames()
        expect([list(sum((list(p) for p in row), [])) for row in seen(page)] == [list(row) for row in Png(data).codes], "the coordinator's codes")
        asked = [p for p in page.js("stage.asked") if "preview" in p]
        expect(len(asked) == 1 and "tonemap=mantiuk06" in asked[0] and "exposure=1" in asked[0] and "param.saturation=0.8" in asked[0] and
               "param.mode=mapping" in asked[0], asked)
        page.click("=Refresh")
        page.wait("stage.asked.filter(p => p.includes('preview')).length === 2")
        page.js("stage.picture.controls.choose('aces')")
        page.frames(3)
        expect("coordinator" not in page.text("body"), "no note where none is due")


@tests.add
def a_look_is_applied_and_taken_back():
    """exposure, white balance and operator change the picture at once; a wipe shows two; apply and reset do that"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        page.frames()
        before = seen(page)
        page.js("(() => { const {exposure} = stage.picture.controls; exposure.value = 1; exposure.dispatchEvent(new Event('input')); })()")
        page.frames()
        want = [srgb(2 * v) for v in light.rows[10][20][:3]]
        expect(all(abs(a - b) <= 1 for a, b in zip(want, seen(page)[10][20])), "one stop brighter")
        page.click("=A|B")
        page.js("stage.picture.setSplit(0.5)")
        page.frames()
        rows = seen(page)
        expect(rows[10][20] != before[10][20] and page.find(".wipe"), "two operators")
        page.js("document.querySelector('.wipe').focus()")
        page.press("Home")
        page.frames()
        aces = seen(page)
        expect(aces[10][20] != rows[10][20] and aces[10][60] == rows[10][60], "the border was moved by keys")
        page.press("End")
        page.frames()
        page.click("=A|B")
        page.click("=Apply to the job")
        page.wait("stage.acted.length === 1")
        verb, jobs, body = page.js("stage.acted[0]")
        expect((verb, jobs, body["output"]["exposure_ev"], body["output"]["tonemap"], body["output"]["formats"]) ==
               ("develop", [1], 1, "linear", ["png"]), (verb, jobs, body))
        page.click("=Reset")
        page.frames()
        expect(seen(page) == before, "as the job has it")
        page.wheel(450, 150, -300)
        page.frames()
        expect(page.js("stage.picture.view.scale") > 1.5, "the wheel zooms")
        page.click("=Fit (0)")
        expect(page.js("stage.picture.view.fitted"), "fitted")


@tests.add
def another_job_is_another_picture():
    """a chosen job never shows the picture of the one before; a frame that comes again keeps its tiles"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        page.frames()
        before = seen(page)
        show(page, light, tiles=[])  # the connection came back
        expect(seen(page) == before, "the picture stays")
        show(page, light, tiles=[], frame=2)
        expect(len({p for row in seen(page) for p in row}) == 1, "another frame begins empty")
        send(page, light)
        expect(seen(page) == before, "and fills")
        page.js("stage.job = 2; stage.info = {...stage.info, job: 2, name: 'kitchen'}; stage.emit('select')")
        page.frames(3)
        expect(len({p for row in seen(page) for p in row}) == 1, "nothing of the job before")
        expect(page.js("document.querySelector('canvas.picture').getAttribute('aria-label')") == "No picture", "and no words of it")


@tests.add
def a_lost_context_comes_back():
    """a graphics card that was taken away and given back shows the same picture"""
    light = soft_light(67, 45)
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        page.allow("CONTEXT_LOST|context lost")
        begin(page, light)
        page.click("~Pixel by pixel")
        page.frames()
        before = seen(page)
        page.js("window.lose = stage.picture.screen.gl.getExtension('WEBGL_lose_context'); lose.loseContext()")
        page.frames(3)
        page.js("new Promise(done => { stage.picture.canvas.addEventListener('webglcontextrestored', done); lose.restoreContext(); })")
        page.frames(3)
        expect(seen(page) == before, "the same pixels")


# A picture of one colour, of which message after message comes; counts what goes to the card at once.
HUGE = """(async () => {
  const {screen} = stage.picture, {gl} = screen, sent = window.sent = [], out = {};
  for (const name of ['texImage2D', 'texSubImage2D']) { const real = gl[name]; gl[name] = (...a) => {
    const data = a.at(-1) instanceof Uint16Array || a.at(-2) instanceof Uint16Array; if (data && a.length > 8) sent.push(a[4] * (name === 'texImage2D' ? a[3] : a[5])); return real.apply(gl, a); }; }
  const draw = screen.draw; screen.draw = (...a) => { const from = sent.length; draw.apply(screen, a);
    out.most = Math.max(out.most || 0, sent.slice(from).reduce((x, y) => x + y, 0)); };
  stage.begin({job: 1, frame: 1, width: 1600, height: 1040, layers: ['color'], complete: true});
  out.begun = sent.reduce((x, y) => x + y, 0);
  const {pixels} = stage.picture, send = tiles => { const body = new ArrayBuffer(12 + tiles.length * 2060), v = new DataView(body);
    v.setUint32(8, tiles.length, true);
    tiles.forEach((tile, i) => { const at = 12 + i * 2060; v.setUint32(at, tile, true); v.setUint16(at + 4, 16, true); v.setUint16(at + 6, 16, true);
      v.setUint32(at + 8, 256, true); new Uint16Array(body, at + 12, 1024).fill(0x3000 + tile % 512); });
    stage.watches.at(-1).to.tiles(body); };
  send(Array.from({length: pixels.tiles - 1}, (_, i) => i)); /* the last one is missing */
  while (!stage.picture.settled) await new Promise(done => setTimeout(done, 10));
  stage.picture.setOverlay('none');
  const image = stage.picture.codes(), at = (x, y) => [...image.data.slice(4 * (y * image.width + x), 4 * (y * image.width + x) + 3)];
  const tile = n => at(n % 100 * 16 + 5, Math.floor(n / 100) * 16 + 5);
  return Object.assign(out, {tiles: pixels.tiles, same: [0, 1, 2050, 4000, 6498].map(n => String(tile(n)) === String(tile(n % 512))), colours: new Set([0, 100, 300].map(n => String(tile(n)))).size, missing: tile(6499), none: pixels.at(1599, 1039)});
})()"""


@tests.add
def a_huge_picture_comes_in_slices():
    """nothing of a new picture goes to the card before its tiles, these at most 4 MB at once; all of it is drawn at last"""
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, soft_light(67, 45))
        got = page.js(HUGE)
        expect(got["begun"] == 0, "%d pixels were sent at the beginning" % got["begun"])
        expect(0 < got["most"] <= 2048 * 256 + 65 * 1600, "%d pixels at once" % got["most"])
        expect(all(got["same"]) and got["colours"] == 3, got)
        expect(got["none"] is None and len(set(got["missing"])) <= 3 and max(got["missing"]) < 255, got)


@tests.add
def what_is_pointed_at_is_drawn_all_the_same():
    """tiles that come while a pixel is read are drawn, also under an operator that measures nothing"""
    light, dark = soft_light(67, 45), Light(67, 45, lambda x, y: (0.02, 0.03, 0.04, 0.001))
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, light)
        page.click("~Pixel by pixel")
        page.js("stage.picture.controls.choose('linear')")
        page.wait("stage.picture.settled")
        box = page.js("(() => { const r = stage.picture.canvas.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()")
        page.mouse("mouseMoved", *box)
        page.wait("stage.picture.map && stage.picture.settled")
        page.js("stage.picture.mapAsked = Infinity")  # its answer draws all
        send(page, dark)
        page.wait("stage.picture.settled")
        page.frames(3)
        codes = {p for row in seen(page) for p in row}
        expect(len(codes) == 1, "%d colours of one" % len(codes))


@tests.add
def without_webgl_there_is_a_preview():
    """a browser without WebGL 2 shows the coordinator's preview, with words"""
    light = soft_light(67, 45)
    with Stage() as site, Browser(["--disable-3d-apis"]) as browser:
        site.answers["/api/v1/jobs/1/frames/1/preview.png"] = ("image/svg+xml", b"<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>")
        page = browser.page(site.url())
        page.allow("WebGL")
        page.js(context(INFO, answers()))
        page.wait("document.querySelector('img.picture')?.complete && document.querySelector('img.picture').naturalWidth === 9")
        expect("helmet, frame 1" in page.js("document.querySelector('img.picture').alt"), "it has a text")
        expect("preview" in page.text(".picture-note") and "WebGL" in page.text(".picture-note"), page.text(".picture-note"))
        page.js("stage.picture.controls.choose('aces')")
        page.wait("stage.asked.some(p => p.includes('tonemap=aces'))")
        expect(light.width, "")


@tests.add
def the_price_is_read_first():
    """the target line is moved by keys and by hand, the price is told in words, and the verb is what the job allows"""
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, soft_light(67, 45))
        page.wait_text("4/255 in 0:[0-9][0-9], [0-9.]+ core-seconds more \\(", ".price")
        page.js("document.querySelector('.target').focus()")
        page.press("PageDown")
        page.wait_text("2.9/255 in 0:[0-9][0-9]", ".price")
        expect(page.js("document.querySelector('.target').getAttribute('aria-valuetext')").startswith("2.9/255"), "spoken")
        page.click("=Extend to 2.9/255")
        page.wait("stage.acted.length === 1")
        expect(page.js("stage.acted[0]") == ["extend", [1], {"spp": 0, "stop": {"measure": "display", "target": 2.9, "adaptive": True}}],
               page.js("stage.acted"))
        chart = page.place(".cost-chart")
        page.drag((chart["x"], chart["y"]), (chart["x"], chart["top"] + chart["height"] * 0.15))
        page.wait_text("is reached", ".price")
        expect(not page.find("~Extend"), "nothing to extend to")
        page.js("stage.info = {...stage.info, state: 'running'}; stage.emit('job')")
        page.wait("document.querySelector('.cost-part button').textContent.startsWith('Set the target to ')")
        page.js("document.querySelector('.cost-part button').click()")
        page.wait("stage.acted.length === 2")
        expect(page.js("stage.acted[1]")[0] == "extend", page.js("stage.acted"))
        page.choose(".cost-part select", "psnr")
        page.wait_text("dB", ".price")


@tests.add
def effects_are_shares():
    """an effect's share is its part of the samples of the threads"""
    with Stage() as site, Browser() as browser:
        page = browser.page(site.url(), width=1300, height=800)
        begin(page, soft_light(67, 45))
        page.wait_text("tracing rays, geometry\\s+60 %\\s+diffuse\\s+30 %\\s+mirror\\s+10 %", "#effects")


if __name__ == "__main__":
    tests.run()
