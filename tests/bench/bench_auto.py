"""What `render --effects auto` leaves out, and saves: the table of docs/EFFECTS.md (`report.py auto`)."""
import json
import os
import re
import subprocess
import sys
import tempfile

from farm import BIN, ROOT

DATA = os.environ.get("AZULEJO_DATA")
SIZE, SPP, TARGET = "96x64", 1024, "3/255"


def scene(*parts):
    return [os.path.join(ROOT, "scenes", *parts)]


def data(*parts, sky=None):
    path = [os.path.join(DATA or "", *parts)]
    return path + ["--env", os.path.join(DATA or "", "hdri", sky)] if sky else path


SCENES = [
    ("cornell-area", scene("cornell", "cornell-area.gltf")),
    ("textured-spheres", scene("studio", "textured-spheres.gltf")),
    ("iridescence", scene("features", "iridescence.gltf")),
    ("portal", scene("features", "portal.pbrt")),
]
REAL_SCENES = [
    ("DamagedHelmet", data("gltf", "DamagedHelmet", "DamagedHelmet.glb", sky="chinese_garden_1k.hdr")),
    ("FlightHelmet", data("gltf", "FlightHelmet", "FlightHelmet.gltf")),
    ("coffee", data("pbrt", "bitterli-coffee", "scene-v4.pbrt")),
    ("staircase2", data("pbrt", "bitterli-staircase2", "scene-v4.pbrt")),
]


def render(arguments, folder, *options):
    """The job's core seconds, what it was rendered without, and what was said."""
    done = subprocess.run(
        [os.path.join(BIN, "azulejo"), "render", *arguments, "--size", SIZE, "--spp", str(SPP), "--target-error",
         TARGET, "--threads", "1", "--json", "--format", "exr", "-o", os.path.join(folder, "p.exr"), *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if done.returncode not in (0, 9):  # 9: --spp ended it above the target
        sys.exit("failed: %s: %s" % (arguments[0], done.stderr))
    job = json.loads(done.stdout)["job"]
    return job["stats"]["cpu_ns"] / 1e9, job["settings"]["without"], done.stderr


def row(name, arguments, folder):
    less, without, words = render(arguments, folder, "--effects", "auto")
    pilots = float(re.search(r"measuring took ([0-9.e+]+) core", words).group(1))
    if not without:
        return "| %s | nothing | - | %.1f | - | %.1f | - | - |" % (name, less, pilots)
    change = re.search(r"changes ([0-9.]+)/255 \(at most ([0-9.]+)", words).groups()
    whole = render(arguments, folder)[0]
    saved = 1 - less / whole
    return "| %s | %s | %s (at most %s) | %.1f | %.0f %% | %.1f | %+.0f %% | %s |" % (
        name, ", ".join(w.replace("-", " ") for w in without), *change, whole, 100 * saved, pilots,
        100 * (saved - pilots / whole), "%.0f" % (pilots / saved) if saved > 0 else "never")


def show_auto(title, only=()):
    """`only`: names of scenes; none: all."""
    title("Effects left out: render SCENE --size %s --spp %d --effects auto --target-error %s" % (SIZE, SPP, TARGET))
    print("| scene | left out | that changes, of 255 | whole render, core-s | time saved | pilots, core-s "
          "| saved, pilots counted | pays from, core-s |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        for name, arguments in SCENES + (REAL_SCENES if DATA else []):
            if not only or name in only:
                print(row(name, arguments, folder), flush=True)
