#!/usr/bin/env python3
"""`make accuracy`: do the figures of error say what the errors are? Writes the tables of docs/ACCURACY.md and the
plot beside it.

    accuracy.py [--quick] [--seeds N] [--cache FOLDER] [--jobs N] [--any-reference] [--print]

--quick takes small pictures and few seeds, and only prints. --any-reference uses cached pictures whatever their
reference. --print writes no file."""
import argparse
import collections
import concurrent.futures
import csv
import io
import math
import os
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
TOOL = os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "tests/accuracy/calibrate")
DOCUMENT = os.path.join(ROOT, "docs/ACCURACY.md")
PLOT = os.path.join(ROOT, "docs/images/accuracy.svg")
BEGIN, END = "<!-- written by make accuracy -->", "<!-- end -->"
OWN, SCENES = "tests/accuracy/scenes/", "scenes/"
# Path, and whether the rules and constants of common/accuracy were chosen with it in sight. The other half is looked at
# once, at the end: failures there are reported, and no rule is changed because of them. (docs/ACCURACY.md says where that was not kept.)
CASES = [
    (OWN + "black.pbrt", 1), (OWN + "constant.pbrt", 1), (OWN + "soft-sky.pbrt", 1),
    (OWN + "media-sky.pbrt", 1), (OWN + "metal-sun.pbrt", 1), (OWN + "room-window.pbrt", 1),
    (OWN + "glass-sun.pbrt", 1), (OWN + "small-caustic.pbrt", 1), (OWN + "lamps-in-glass.pbrt", 1),
    (SCENES + "cornell/cornell-area.gltf", 1), (SCENES + "studio/textured-spheres.gltf", 1),
    (SCENES + "features/absorption.gltf", 1), (SCENES + "features/fire.pbrt", 1),
    (SCENES + "features/fog.pbrt", 1), (SCENES + "features/glass.gltf", 1),
    (SCENES + "features/many-lights.gltf", 1), (SCENES + "features/nested.gltf", 1),
    (OWN + "lamp-in-bulb.pbrt", 0), (SCENES + "cornell/cornell-mirror.gltf", 0), (SCENES + "features/anisotropy.gltf", 0),
    (SCENES + "features/clearcoat.gltf", 0), (SCENES + "features/conductor.pbrt", 0),
    (SCENES + "features/dispersion.gltf", 0), (SCENES + "features/emissive-strength.gltf", 0),
    (SCENES + "features/iridescence.gltf", 0), (SCENES + "features/lights.gltf", 0), (SCENES + "features/media.pbrt", 0),
    (SCENES + "features/panes.pbrt", 0), (SCENES + "features/portal.pbrt", 0),
    (SCENES + "features/thin-transmission.gltf", 0), (SCENES + "features/window.pbrt", 0),
    (SCENES + "features/coated.pbrt", 0), (SCENES + "features/lens.pbrt", 0),
    (SCENES + "features/metal.gltf", 0),
]
SHOWN = (4, 16, 64, 256)


def mean(values):
    return sum(values) / len(values) if values else math.nan


def calibrate(path, options, arguments):
    command = [TOOL, path] + arguments
    if options.cache:
        name = os.path.splitext(os.path.basename(path))[0]
        command += ["--cache", os.path.join(options.cache, name + ".cal")]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, universal_newlines=True)
    if done.returncode != 0:
        print("accuracy.py: no figures of %s" % path, file=sys.stderr)
        return ""
    return done.stdout


def collect(options):
    arguments = []
    if options.quick:
        arguments = ["--size", "32x32", "--seeds", "8", "--levels", "5", "--reference-seeds", "1",
                     "--reference-spp", "2048"]
    elif options.any_reference:
        arguments = ["--reference-seeds", "0"]
    for name in ("seeds", "levels", "reference_seeds", "reference_spp"):
        if getattr(options, name):
            arguments += ["--" + name.replace("_", "-"), str(getattr(options, name))]
    header = subprocess.run([TOOL, "--header"], stdout=subprocess.PIPE, check=True,
                            universal_newlines=True).stdout
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        texts = list(pool.map(lambda case: calibrate(case[0], options, arguments), CASES))
    rows = list(csv.DictReader(io.StringIO(header + "".join(texts))))
    for row in rows:
        for key in row:
            if key != "scene":
                row[key] = float(row[key])
    return rows


def is_empty(row):
    """Nothing to be measured: every sample is the same."""
    return row["display_true"] < 0.01 and row["rmse_true"] == 0


def holds(row, figure):
    return row[figure + "_lo"] <= row[figure + "_true"] <= row[figure + "_hi"]


FIGURES = (("display", "display error"), ("rmse", "RMSE"))
RMSE_REASONS = 1 | 2 | 4  # unseen, top, disagree (ACCURACY_RMSE_REASONS in common/accuracy/word.h)


def is_reliable(row, figure):
    """Each figure has a word of its own."""
    return bool(row["reliable"]) if figure in ("display", "part") else not int(row["reasons"]) & RMSE_REASONS


def off_by(row, figure):
    """By what factor the figure is off."""
    if row[figure] > 0 and row[figure + "_true"] > 0:
        ratio = row[figure] / row[figure + "_true"]
        return max(ratio, 1 / ratio)
    return 1 if is_empty(row) or row[figure] == row[figure + "_true"] else math.inf


def binomial(successes, count, chance):
    """Two-sided: how likely is a number as unlikely as this one?"""
    def density(k):
        return math.comb(count, k) * chance ** k * (1 - chance) ** (count - k)
    limit = density(successes) * (1 + 1e-9)
    return min(1, sum(density(k) for k in range(count + 1) if density(k) <= limit))


def ratio_of(rows, figure):
    truth = mean([r[figure + "_true"] for r in rows])
    return mean([r[figure] for r in rows]) / truth if rows and truth > 0 else math.nan


def show(value, form="%.2f"):
    return "-" if math.isnan(value) else form % value


def table_of_cells(cells, out):
    out.append("| scene | spp | display error | printed / true | reliable | RMSE | printed / true | reliable | reference |")
    out.append("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for (scene, spp), rows in cells.items():
        if spp not in SHOWN:
            continue
        good = {figure: [r for r in rows if is_reliable(r, figure)] for figure, _ in FIGURES}
        out.append("| %s | %d | %s | %s | %d of %d | %s %% | %s | %d of %d | %d |" % (
            scene, spp, show(mean([r["display_true"] for r in rows]), "%.1f"), show(ratio_of(rows, "display")),
            len(good["display"]), len(rows), show(mean([r["rmse_true"] for r in rows]), "%.3g"),
            show(ratio_of(rows, "rmse")), len(good["rmse"]), len(rows), rows[0]["reference"]))


KNOWN = {os.path.basename(path) for path, seen in CASES if seen}
HALVES = (("chosen on", True), ("judged on", False))


def table_of_words(rows, out):
    out.append("| figure | scenes | wrong by more than 1.5: warned | within 15 %: warned | in between: warned |")
    out.append("|---|---|---:|---:|---:|")
    for figure, name in FIGURES:
        for half, known in HALVES:
            columns = []
            for low, high in ((1.5, math.inf), (0, 1.15), (1.15, 1.5)):
                some = [r for r in rows if (r["scene"] in KNOWN) == known and low < off_by(r, figure) <= high]
                warned = sum(not is_reliable(r, figure) for r in some)
                columns.append("%d of %d%s" % (warned, len(some), " (%.0f %%)" % (100 * warned / len(some)) if some else ""))
            out.append("| %s | %s | %s |" % (name, half, " | ".join(columns)))


def table_of_calibration(cells, out):
    """Cells whose mean is within 15 % of the truth, whatever the word says."""
    out.append("| figure | scenes | all cells within 15 % | from 32 spp on |")
    out.append("|---|---|---:|---:|")
    for figure, name in FIGURES + (("part", "worst part"),):
        for half, known in HALVES:
            some = [(spp, ratio_of(rows, figure)) for (scene, spp), rows in cells.items() if (scene in KNOWN) == known and not is_empty(rows[0])]
            some = [(spp, ratio) for spp, ratio in some if not math.isnan(ratio)]
            good = [spp for spp, ratio in some if 0.85 <= ratio <= 1.15]
            out.append("| %s | %s | %d of %d | %d of %d |" % (
                name, half, len(good), len(some), sum(s >= 32 for s in good), sum(s >= 32 for s, _ in some)))


def table_of_fireflies(rows, out):
    """What stands out of its neighbours above the reference, and what the picture alone says (judge.h)."""
    out.append("| scenes | spp | fireflies | found | false ones, of 10,000 pixels |")
    out.append("|---|---:|---:|---:|---:|")
    for half, known in HALVES:
        for spp in SHOWN:
            some = [r for r in rows if (r["scene"] in KNOWN) == known and r["spp"] == spp]
            there, pixels = sum(r["fireflies"] for r in some), sum(r["pixels"] for r in some)
            if pixels:
                out.append("| %s | %d | %d | %s | %.1f |" % (
                    half, spp, there, "%.0f %%" % (100 * sum(r["found"] for r in some) / there) if there else "-",
                    10000 * sum(r["wrong"] for r in some) / pixels))


def table_of_intervals(cells, out):
    out.append("| figure | reliable pictures | interval holds | cells too low or high, Sidak |")
    out.append("|---|---:|---:|---:|")
    for figure, name in FIGURES:
        good = [[r for r in rows if is_reliable(r, figure) and not is_empty(r)] for rows in cells.values()]
        good = [rows for rows in good if rows]
        count = sum(len(rows) for rows in good)
        if not count:
            continue
        level = 1 - 0.95 ** (1 / len(good))
        odd = sum(binomial(sum(holds(r, figure) for r in rows), len(rows), 0.95) < level for rows in good)
        out.append("| %s | %d in %d cells | %.1f %% | %d |" % (
            name, count, len(good), 100 * mean([holds(r, figure) for rows in good for r in rows]), odd))


def demands(cells, out):
    """Where a demand is missed, in words."""
    missed = []
    for (scene, spp), rows in cells.items():
        for figure, name in FIGURES:
            good = [r for r in rows if is_reliable(r, figure) and not is_empty(r)]
            ratio = ratio_of(good, figure)
            if len(good) >= 3 and not 0.85 <= ratio <= 1.15:
                missed.append("%s at %d spp: %s %.2f of the truth in %d pictures" % (scene, spp, name, ratio, len(good)))
    out.append("Cells of at least three reliable pictures whose mean is off by more than 15 %%: %s." % ("; ".join(missed) or "none"))


def predictions(cells, out):
    """The cost curve through the points so far, asked for the cost of the error that 4 times the samples showed: in
    samples, in CPU-seconds, and in samples from the seeds' mean figures, which have almost no noise."""
    out.append("| scenes | from | reliable pictures | samples: within 25 % | interval holds | CPU-seconds: within 25 % | samples, without the figures' noise |")
    out.append("|---|---:|---:|---:|---:|---:|---:|")
    values = collections.defaultdict(list)
    for (scene, spp), rows in cells.items():
        for row in rows:
            if row["reliable"] and row["later_reliable"] and row["samples"] > 0:
                truth = 4 * spp
                values[scene not in KNOWN, spp].append(
                    (near(row["samples"], truth), row["samples_lo"] <= truth <= row["samples_hi"],
                     near(row["cost"], row["later_cpu_s"]), near(row["samples_even"], truth)))
    for (other, spp), found in sorted(values.items()):
        out.append("| %s | %d spp | %d | %s |" % (
            HALVES[other][0], spp, len(found), " | ".join("%.0f %%" % (100 * mean([f[i] for f in found])) for i in range(4))))


def near(value, truth):
    return value > 0 and abs(math.log(value / truth)) < math.log(1.25)


COLOURS = ("#1b6ca8", "#c0392b", "#27893a", "#8e44ad", "#c77c11", "#16807a", "#7a5230", "#d0408f", "#555555", "#2f4858")


def draw(cells):
    """Printed / true over samples, one line a scene; dots where most pictures are reliable."""
    width, height, left, top = 360, 300, 46, 30
    out = ['<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 370" font-family="sans-serif" font-size="11">',
           '<rect width="960" height="370" fill="white"/>']
    low, high = math.log(0.25), math.log(2)
    for panel, (figure, name) in enumerate((("display", "display error"), ("rmse", "RMSE"))):
        x0 = left + panel * (width + 30)
        def across(spp):
            return x0 + math.log2(spp / 4) / 6 * (width - 40)
        def up(ratio):
            return top + (high - max(low, min(high, math.log(ratio)))) / (high - low) * height
        out.append('<text x="%.0f" y="18">%s, printed / true</text>' % (x0, name))
        out.append('<rect x="%.1f" y="%.1f" width="%.1f" height="%.1f" fill="#e8f0e8"/>' % (x0, up(1.15), width - 40, up(0.85) - up(1.15)))
        for ratio in (0.25, 0.5, 1, 2):
            out.append('<path d="M%.1f %.1fh%.1f" stroke="#bbb"/><text x="%.1f" y="%.1f" text-anchor="end">%g</text>' % (x0, up(ratio), width - 40, x0 - 5, up(ratio) + 4, ratio))
        for spp in SHOWN:
            out.append('<text x="%.1f" y="%d" text-anchor="middle">%d</text>' % (across(spp), top + height + 16, spp))
        for index, scene in enumerate(sorted({s for s, _ in cells})):
            points = [(spp, rows) for (s, spp), rows in cells.items() if s == scene]
            points = [(spp, ratio_of(rows, figure), mean([is_reliable(r, figure) for r in rows])) for spp, rows in points]
            points = [p for p in points if p[1] > 0]
            colour = COLOURS[index % len(COLOURS)]
            out.append('<polyline fill="none" stroke="%s"%s points="%s"/>' % (colour, ' stroke-dasharray="4 3"' if index >= len(COLOURS) else "", " ".join("%.1f,%.1f" % (across(s), up(r)) for s, r, _ in points)))
            out += ['<circle cx="%.1f" cy="%.1f" r="2.6" fill="%s"/>' % (across(s), up(r), colour) for s, r, share in points if share > 0.5]
            if panel == 1:
                out.append('<text x="808" y="%d" fill="%s">%s</text>' % (top + 8 + index * 16, colour, scene))
    out.append('<text x="%d" y="364">samples of a pixel; dots: most pictures are reliable; band: 15 %%</text></svg>' % left)
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seeds", type=int, help="pictures of each scene; default: 20")
    parser.add_argument("--levels", type=int, help="4, 8, ... samples of a pixel; default: 7, to 256")
    parser.add_argument("--reference-seeds", type=int, help="default: 3")
    parser.add_argument("--reference-spp", type=int, help="samples of each; default: 4096")
    parser.add_argument("--any-reference", action="store_true")
    parser.add_argument("--print", action="store_true", dest="only_print")
    parser.add_argument("--cache")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if options.cache:
        os.makedirs(options.cache, exist_ok=True)
    rows = collect(options)
    cells = collections.OrderedDict()
    for row in rows:
        cells.setdefault((row["scene"], int(row["spp"])), []).append(row)
    out = ["### The word", ""]
    table_of_words(rows, out)
    out += ["", "### Calibration", ""]
    table_of_calibration(cells, out)
    out += ["", "### Fireflies", ""]
    table_of_fireflies(rows, out)
    out += ["", "### Intervals of 95 %", ""]
    table_of_intervals(cells, out)
    out.append("")
    demands(cells, out)
    out += ["", "### Cost", ""]
    predictions(cells, out)
    out += ["", "### All cells", ""]
    table_of_cells(cells, out)
    text = "\n".join(out)
    print(text)
    if options.quick or options.only_print:
        return
    with open(DOCUMENT) as source:
        before, rest = source.read().split(BEGIN)
    with open(DOCUMENT, "w") as target:
        target.write(before + BEGIN + "\n\n" + text + "\n\n" + END + rest.split(END)[1])
    with open(PLOT, "w") as target:
        target.write(draw(cells))


if __name__ == "__main__":
    main()
