#!/usr/bin/env python3
"""`make accuracy-fresh`: how old is the figure of error that a job shows while a large frame renders? At most 5 s, or a tenth
of the time so far.

    fresh.py [--write] [--size WxH] [--spp N] [--threads N] [SCENE...]

Renders scenes one after the other on a farm of this machine, and asks for the job again and again. --write: the table of
docs/ACCURACY.md."""
import argparse
import os
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import written  # noqa: E402
from written import ROOT  # noqa: E402

sys.path.insert(0, os.path.join(ROOT, "tests/farm"))
from farm import Farm  # noqa: E402

SCENES = ["scenes/cornell/cornell-area.gltf", "scenes/studio/textured-spheres.gltf", "scenes/features/glass.gltf",
          "tests/accuracy/scenes/soft-sky.pbrt", "tests/accuracy/scenes/room-window.pbrt"]


def watch(farm, number):
    """Seconds of work, and of those how many the figure that is shown is old (None: there is none yet); until it is done."""
    seen = []
    while True:
        job = farm.job(number)
        if job["frames_done"] or job["state"] not in ("queued", "running"):
            return seen
        known = (job.get("now") or {}).get("figures")
        if job.get("seconds_active", 0) > 0:
            seen.append((job["seconds_active"], job["seconds_active"] - job["now"]["wall_seconds"] if known else None))
        time.sleep(0.2)


def row_of(scene, seen):
    known = [(at, age) for at, age in seen if age is not None]
    stale = [1 for at, age in known if age > max(5, at / 10) + 0.5]
    return "| %s | %.0f s | %s | %s | %s |" % (
        os.path.basename(scene), seen[-1][0], "%.0f s" % known[0][0] if known else "never",
        "%.0f s" % max(age for _, age in known) if known else "-", "%.0f %%" % (100 * len(stale) / len(known)) if known else "-")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--spp", default="16")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    options = parser.parse_args()
    table = ["| scene | frame | first figure after | oldest | older than 5 s and a tenth of the time |", "|---|---:|---:|---:|---:|"]
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=options.threads)
        for scene in options.scenes:
            number = farm.submit(os.path.join(ROOT, scene), "--size", options.size, "--spp", options.spp)
            table.append(row_of(scene, watch(farm, number)))
            print(table[-1], flush=True)
            farm.wait_for_job(number)
    if options.write:
        written.write("accuracy-fresh", "\n".join(table))


main()
