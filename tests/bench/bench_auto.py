"""What `render --effects auto` leaves out, and saves: the table of docs/EFFECTS.md (`report.py auto`)."""
import json
import os
import re
import subprocess
import sys
import tempfile

from farm import BIN, ROOT

SIZE, SPP, TARGETS, ROUNDS = "120x80", 256, ("3/255", "12/255"), 3


def scene(*parts):
    return os.path.join(ROOT, "scenes", *parts)


SCENES = [
    ("cornell-area", scene("cornell", "cornell-area.gltf")),
    ("textured-spheres", scene("studio", "textured-spheres.gltf")),
    ("clearcoat", scene("features", "clearcoat.gltf")),
    ("iridescence", scene("features", "iridescence.gltf")),
    ("dispersion", scene("features", "dispersion.gltf")),
    ("absorption", scene("features", "absorption.gltf")),
    ("wine", scene("liquids", "wine.gltf")),
    ("portal", scene("features", "portal.pbrt")),
]


def render(path, folder, *options):
    """The job's core seconds, what it was rendered without, and what was said."""
    done = subprocess.run(
        [os.path.join(BIN, "azulejo"), "render", path, "--size", SIZE, "--spp", str(SPP), "--threads", "1",
         "--json", "--format", "exr", "-o", os.path.join(folder, "p.exr"), *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if done.returncode:
        sys.exit("failed: %s: %s" % (path, done.stderr))
    job = json.loads(done.stdout)["job"]
    return job["stats"]["cpu_seconds"], job["settings"]["without"], done.stderr


def row(name, path, target, folder):
    _, without, words = render(path, folder, "--effects", "auto", "--target-error", target)
    spent = float(re.search(r"measuring took ([0-9.e+]+) core", words).group(1)) if "measuring" in words else 0
    if not without:
        return "| %s | %s | nothing | - | - | %.1f |" % (name, target, spent)
    change = re.search(r"changes ([0-9.]+)/255 \(at most ([0-9.]+)", words).groups()
    whole, less = [], []
    for _ in range(ROUNDS):  # in turn, so that the machine's moods meet both
        whole.append(render(path, folder)[0])
        less.append(render(path, folder, "--without", ",".join(without))[0])
    return "| %s | %s | %s | %s (at most %s) | %.0f %% | %.1f |" % (
        name, target, ", ".join(w.replace("-", " ") for w in without), *change,
        100 * (1 - min(less) / min(whole)), spent)


def show_auto(title, only=()):
    """`only`: names of scenes; none: all."""
    title("Effects left out: render SCENE --size %s --spp %d --effects auto --target-error N/255" % (SIZE, SPP))
    print("| scene | target | left out | that changes, of 255 | time saved | measuring, core-s |")
    print("|---|---|---|---|---:|---:|")
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        for name, path in [s for s in SCENES if not only or s[0] in only]:
            for target in TARGETS:
                print(row(name, path, target, folder), flush=True)
