#!/usr/bin/env python3
"""invariance_table.py [SPP]: docs/NUMERICS.md's table of invariance.

Runs the programs test_invariance_* with SPP samples a pixel (default 256) and takes together what all
scenes show for one way of writing them. BUILD names the build tree. `make invariance` calls it.
"""
import os
import re
import subprocess
import sys

PROGRAMS = ("scale", "place", "triangles", "files")


def way_of(what):
    if re.search(r"scaled by 2\^", what):
        return "scaled by 2^-30, 2^-10, 2^10, 2^30"
    if "scaled by" in what:
        return "scaled by 1e-9, 1e-3, 1e3, 1e9"
    return what


def number(text):
    match = re.match(r"[0-9.e+-]+", text)
    return float(match.group()) if match else 0.0


def rows_of(program, spp):
    path = os.path.join(os.environ.get("BUILD", "build/release"), "tests/statistics",
                        "test_invariance_" + program)
    run = subprocess.run([path, "--table", spp], capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{path} failed:\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    for line in run.stdout.splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        if len(cells) == 7 and cells[0] != "scene" and not cells[0].startswith("---"):
            yield cells


def main():
    spp = sys.argv[1] if len(sys.argv) > 1 else "256"
    ways = {}
    for program in PROGRAMS:
        for scene, what, _, apart, z, block, mean in rows_of(program, spp):
            # What is blended is compared by its noise alone: it has rows of its own.
            way = ways.setdefault(("blended: " if scene == "veil" else "") + way_of(what),
                                  {"cases": 0, "equal": 0, "apart": 0.0, "z": 0.0, "block": 0.0,
                                   "mean": 0.0})
            way["cases"] += 1
            equal = "bit" in apart
            way["equal"] += equal
            way["apart"] = max(way["apart"], 0 if equal else number(apart))
            if not equal:
                way["z"] = max(way["z"], number(z))
                way["block"] = max(way["block"], number(block))
                way["mean"] = max(way["mean"], number(mean))
    print("| written as | pictures | equal to the bit | pixels apart, same seed | largest z of a block "
          "| largest deviation of a block | of the mean |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name, way in ways.items():
        rest = (f"{way['apart']:.2g} % | {way['z']:.1f} | {way['block']:.2g} % | {way['mean']:.2g} %"
                if way["equal"] < way["cases"] else "| | | ").rstrip()
        print(f"| {name} | {way['cases']} | {way['equal']} | {rest} |".replace("| | | | |", "| | | | |"))


main()
