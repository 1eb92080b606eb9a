#!/usr/bin/env python3
"""What float's rounding does to pictures: the same paths in float and in double.

    precision.py FLOAT DOUBLE [--quick] [--only NAME] [--runs N] [--spp N] [--markdown FILE]

FLOAT and DOUBLE are build folders (build/release, and build/double of `make DOUBLE=1`). Both render every scene with the same random
numbers, so each pair of groups differs only where rounding changed a value or a decision. Prints TAP, a line for each scene, and the
table of docs/NUMERICS.md.

The test: in each block of 8x8 pixels, and in the picture as a whole, the differences of the pairs are independent and have the mean that
float is wrong by. A block fails where that mean is surely (Student's t, two-sided, Bonferroni over all blocks and pictures: together
1e-4) more than TOLERANCE of the block's radiance, or of a hundredth of the picture's where the block is darker: an 8-bit code is 4e-3 or more of what it stands for."""
import argparse
import glob
import json
import math
import os
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "farm"))
sys.path.insert(0, HERE)
import exr  # noqa: E402
import hard_scenes  # noqa: E402

SIGNIFICANCE = 1e-4
TOLERANCE = 2e-4
BLOCK, WIDTH, HEIGHT, GROUPS = 8, 64, 48, 2
BLOCKS = WIDTH // BLOCK * (HEIGHT // BLOCK)
OTHER_PATH = 1e-4  # of a value; rounding alone changes most by less
SHOWN_CODES = 0.005  # a scene with less has no line of its own in the table
QUICK = ("glass", "iridescence", "clearcoat", "motion", "media", "wine", "furnace-10km", "room-100km", "ground-1000km", "needle-1m", "dense-1e5",
         "far-balls-100km", "grazing-glass", "near-mirrors", "touching-glass")


def scenes(folder):
    """[(name, file, environment map or None)]"""
    sky = os.path.join("scenes", "features", "sky.hdr")
    out = []
    for path in sorted(glob.glob("scenes/*/*.gltf") + glob.glob("scenes/*/*.pbrt")):
        place, name = path.split(os.sep)[1:]
        out.append((os.path.splitext(name)[0], path, None if place in ("features", "cornell") else sky))
    return out + [(name, path, None) for name, path in hard_scenes.write(folder).items()]


def render(build, path, sky, spp, seed, out):
    command = [os.path.join(build, "tests", "bench", "bench_render"), path, "--size", "%dx%d" % (WIDTH, HEIGHT), "--spp", str(spp),
               "--seed", str(seed), "--groups", out, "--json"] + (["--env", sky] if sky else [])
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        sys.exit("precision.py: %s: %s" % (path, done.stderr.strip()))
    picture = exr.read_exr(out)
    r, g, b = (picture.values(c) for c in "RGB")
    return [0.2126 * x + 0.7152 * y + 0.0722 * z for x, y, z in zip(r, g, b)], json.loads(done.stdout)["cpu_s"]


def block_means(luminance):
    """[group][block]"""
    out = []
    for r in range(GROUPS):
        means = [0.0] * BLOCKS
        for y in range(HEIGHT):
            row = luminance[(r * HEIGHT + y) * WIDTH:][:WIDTH]
            for x in range(0, WIDTH, BLOCK):
                means[y // BLOCK * (WIDTH // BLOCK) + x // BLOCK] += sum(row[x:x + BLOCK]) / BLOCK ** 2
        out.append(means)
    return out


def beta_fraction(a, b, x):
    """The regularised incomplete beta function by its continued fraction (Abramowitz and Stegun 26.5.8)."""
    if x > (a + 1) / (a + b + 2):
        return 1 - beta_fraction(b, a, 1 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)) / a
    c, d = 1.0, 1 / (1 - (a + b) * x / (a + 1))
    value = d
    for m in range(1, 300):
        for top in (m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
                    -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))):
            d, c = 1 / (1 + top * d), 1 + top / c
            value *= c * d
    return front * value


def t_limit(degrees, probability):
    """The t that is exceeded to either side with this probability."""
    low, high = 0.0, 1e6
    for _ in range(200):
        middle = (low + high) / 2
        if beta_fraction(degrees / 2, 0.5, degrees / (degrees + middle * middle)) > probability:
            low = middle
        else:
            high = middle
    return high


def code(value):
    value = min(max(value, 0.0), 1.0)
    return 255 * (12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055)


def spread(values):
    """Mean and standard error."""
    n, mean = len(values), sum(values) / len(values)
    return mean, math.sqrt(sum((v - mean) ** 2 for v in values) / (n * (n - 1)))


def compare(builds, path, sky, options, folder, limit):
    blocks = [[], []]  # [build][pair][block]
    times, other, pixels = [0.0, 0.0], 0, 0
    for seed in range(1, options.runs + 1):
        pair = []
        for k, build in enumerate(builds):
            luminance, cpu = render(build, path, sky, options.spp, seed, os.path.join(folder, "out.exr"))
            times[k] += cpu
            blocks[k] += block_means(luminance)
            pair.append(luminance)
        floor = sum(pair[1]) / len(pair[1])
        other += sum(abs(a - b) > OTHER_PATH * (abs(b) + floor) for a, b in zip(*pair))
        pixels += len(pair[0])
    mean = sum(map(sum, blocks[1])) / (len(blocks[1]) * BLOCKS)
    row = {"mean": 0.0, "codes": 0.0, "errors": 0.0, "surely": 0.0, "other": other / pixels, "time": times[1] / times[0]}
    for b in range(BLOCKS):
        value, noise = spread([p[b] for p in blocks[1]])
        difference, error = spread([p[b] - q[b] for p, q in zip(*blocks)])
        row["mean"] += difference / BLOCKS / mean if mean else 0
        row["codes"] = max(row["codes"], abs(code(value + difference) - code(value)))
        row["errors"] = max(row["errors"], abs(difference) / noise if noise else 0)
        row["surely"] = max(row["surely"], (abs(difference) - limit * error) / max(value, mean / 100) if value or mean else 0)
    difference, error = spread([(sum(p) - sum(q)) / BLOCKS for p, q in zip(*blocks)])
    row["surely"] = max(row["surely"], (abs(difference) - limit * error) / mean if mean else 0)
    return row


def table(rows):
    """A row for each hard scene and each whose pictures can differ; one for all others, with the worst of them."""
    def line(name, r):
        return "| %s | %+.1e | %.3f | %.3f | %.2f %% | %.2f |" % (name, r["mean"], r["codes"], r["errors"], 100 * r["other"], r["time"])

    alone = [(n, r) for n, r in rows if n in hard_scenes.SCENES or r["codes"] > SHOWN_CODES]
    others = [r for n, r in rows if (n, r) not in alone]
    lines = ["| scene | mean | largest block, codes | largest block, standard errors | other values | time |", "|---|---:|---:|---:|---:|---:|"]
    lines += [line(*row) for row in alone]
    if others:
        worst = {key: max((r[key] for r in others), key=abs) for key in others[0]}
        lines.append(line("the worst of %d others" % len(others), worst))
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("builds", nargs=2, metavar="BUILD")
    parser.add_argument("--quick", action="store_true", help="fewer scenes")
    parser.add_argument("--only", default="", help="scenes whose name contains this")
    parser.add_argument("--runs", type=int, default=8, help="seeds; each gives four pairs")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--markdown", help="write the table here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        chosen = [s for s in scenes(folder) if options.only in s[0] and (not options.quick or s[0] in QUICK)]
        limit = t_limit(GROUPS * options.runs - 1, SIGNIFICANCE / ((BLOCKS + 1) * max(len(chosen), 1)))
        rows, failed = [], 0
        print("1..%d" % len(chosen))
        for at, (name, path, sky) in enumerate(chosen, 1):
            row = compare(options.builds, path, sky, options, folder, limit)
            bad = row["surely"] > TOLERANCE
            failed += bad
            rows.append((name, row))
            if options.markdown:
                with open(options.markdown, "w", encoding="utf-8") as file:
                    file.write("\n".join(table(rows)) + "\n")
            print("%sok %d - %s: mean %+.1e, largest block %.3f codes, %.2f standard errors, surely %.1e of its radiance; "
                  "other values %.3f %%, time %.2f" % ("not " if bad else "", at, name, row["mean"], row["codes"], row["errors"],
                                                      max(row["surely"], 0), 100 * row["other"], row["time"]), flush=True)
    print("# %d of %d scenes: float is wrong in a block by more than %g (t above %.1f, together %g)"
          % (failed, len(chosen), TOLERANCE, limit, SIGNIFICANCE))
    return 1 if failed or not chosen else 0


sys.exit(main())
