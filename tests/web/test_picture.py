#!/usr/bin/env python3
"""The page's picture: its operators are the farm's, and what is drawn, read and chosen is right."""
import base64
import json
import os
import subprocess
import sys
import tempfile

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
  const {Pixels, eachTile} = await import('/assets/pixels.js');
  const {Screen} = await import('/assets/gl.js');
  const {prepare, readCube} = await import('/assets/tonemap.js');
  const {presetsOf} = await import('/assets/controls.js');
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


if __name__ == "__main__":
    tests.run()
