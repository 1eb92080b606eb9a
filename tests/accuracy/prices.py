#!/usr/bin/env python3
"""`make accuracy-prices`: is the price of a smaller error right? Renders scenes on a farm of this machine and asks for the price of the error that
the picture has at its end, when it has a sixteenth and a quarter of the samples.

    prices.py [--write] [--bin FOLDER] [--size WxH] [--spp N] [--allocation HOW] [--log FILE] [SCENE...]

Rules may be chosen on the first half of the scenes; the second half judges them. --bin: other programs than those of this
tree. --write: the table of docs/ACCURACY.md."""
import argparse
import json
import math
import os
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import written  # noqa: E402
from written import ROOT  # noqa: E402

sys.path.insert(0, os.path.join(ROOT, "tests/farm"))
import farm as farms  # noqa: E402

OWN, SCENES = "tests/accuracy/scenes/", "scenes/"
CHOSEN_ON = [OWN + "soft-sky.pbrt", SCENES + "studio/textured-spheres.gltf", SCENES + "features/glass.gltf",
             OWN + "room-window.pbrt", SCENES + "features/metal.gltf", SCENES + "features/absorption.gltf"]
JUDGED_ON = [SCENES + "cornell/cornell-area.gltf", OWN + "metal-sun.pbrt", SCENES + "features/many-lights.gltf",
             SCENES + "features/nested.gltf", SCENES + "features/coated.pbrt", SCENES + "features/fire.pbrt"]
SHARES = (16, 4)


def along(points, x, key):
    """`key` where the curve's error is x, both logarithmic (CostPoint in azulejo.proto)."""
    i = 1
    while i < len(points) - 1 and points[i]["error"] > x:
        i += 1
    a, b = points[i - 1], points[i]
    values = [float(p[key]) for p in (a, b)]
    if not all(0 < v < math.inf for v in values) or a["error"] == b["error"]:
        return math.inf
    part = math.log(x / a["error"]) / math.log(b["error"] / a["error"])
    return values[0] * (values[1] / values[0]) ** part


def watch(farm, number):
    """The curves as the samples grow, and the history's last point."""
    seen = []
    while True:
        history = farm.cli("show", number, "--history", "--json", expect=0).json()
        state = farm.job(number)["state"]
        points = [p for p in history["points"] if p.get("figures")]
        curve = next((c["points"] for c in history.get("curves", []) if c["measure"] == "display"), None)
        if state == "done":
            return seen, points[-1]
        if curve and points and (not seen or points[-1]["samples"] > seen[-1][0]):
            seen.append((points[-1]["samples"], points[-1]["core_seconds"], curve))
        time.sleep(0.1)


def judge(farm, scene, options):
    number = farm.submit(os.path.join(ROOT, scene), "--size", options.size, "--spp", options.spp,
                         "--allocation", options.allocation)
    seen, last = watch(farm, number)
    rows = []
    for share in SHARES:
        known = [s for s in seen if s[0] <= last["samples"] / share]
        if not known:
            continue
        samples, spent, curve = known[-1]
        error = last["figures"]["display"]
        if error >= curve[0]["error"]:
            continue
        price, low, high = (along(curve, error, key) - spent for key in
                            ("core_seconds", "core_seconds_low", "core_seconds_high"))
        truth = last["core_seconds"] - spent
        rows.append({"scene": os.path.basename(scene), "share": share, "spp": samples / last["samples"] * int(options.spp),
                     "ratio": price / truth, "holds": low <= truth <= high, "width": high / low if low > 0 else math.inf})
    return rows


def report(name, rows):
    """Lines of a table."""
    lines = []
    for share in SHARES:
        some = [r for r in rows if r["share"] == share]
        if not some:
            continue
        good = sum(0.8 <= r["ratio"] <= 1.25 for r in some)
        off = math.exp(sum(abs(math.log(r["ratio"])) if 0 < r["ratio"] < math.inf else 5 for r in some) / len(some))
        widths = sorted(r["width"] for r in some)
        lines.append("| %s | 1/%d | %d of %d | %.2f | %.0f | %d of %d |" % (
            name, share, good, len(some), off, widths[len(widths) // 2], sum(r["holds"] for r in some), len(some)))
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--bin")
    parser.add_argument("--size", default="96x54")
    parser.add_argument("--spp", default="1024")
    parser.add_argument("--allocation", default="adaptive")
    parser.add_argument("--log", help="write a line of JSON for each price")
    parser.add_argument("scenes", nargs="*")
    options = parser.parse_args()
    if options.bin:
        farms.BIN = options.bin
    parts = [("given", options.scenes)] if options.scenes else [("chosen on", CHOSEN_ON), ("judged on", JUDGED_ON)]
    table = ["| scenes | at | within 25 % | off by a factor of | median width of the interval | it holds |",
             "|---|---:|---:|---:|---:|---:|"]
    with farms.Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=1)
        for name, scenes in parts:
            rows = [row for scene in scenes for row in judge(farm, scene, options)]
            for row in rows:
                print("  %-24s from %4.0f spp: %5.2f of the truth%s" % (row["scene"], row["spp"], row["ratio"],
                                                                      "" if row["holds"] else ", outside its interval"))
            table += report(name, rows)
            if options.log:
                with open(options.log, "a") as log:
                    log.writelines(json.dumps(row) + "\n" for row in rows)
    print("\n".join(table))
    if options.write:
        written.write("accuracy-prices", "\n".join(table))


main()
