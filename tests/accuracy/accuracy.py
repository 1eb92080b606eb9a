#!/usr/bin/env python3
"""`make accuracy`: do the figures of error say what the errors are? Writes the tables of docs/ACCURACY.md and the
plot beside it.

    accuracy.py [--quick] [--tonemap OPERATOR] [--cache FOLDER] [--jobs N] [--print]

--quick takes small pictures and few seeds, and only prints. --tonemap: another operator than the default, and only prints.
--cache keeps the pictures, of any operator: remove them after a change of the renderer. --print writes no file."""
import argparse
import collections
import concurrent.futures
import csv
import io
import math
import os
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import written  # noqa: E402
from written import ROOT  # noqa: E402

BUILD = os.environ.get("BUILD", "build/release")
TOOL = os.path.join(ROOT, BUILD, "tests/accuracy/calibrate")
PLOT = os.path.join(ROOT, "docs/images/accuracy.svg")
OWN, SCENES = "tests/accuracy/scenes/", "scenes/"
# The rules and constants of common/accuracy were chosen with these in sight.
CHOSEN_ON = [
    OWN + "black.pbrt", OWN + "constant.pbrt", OWN + "soft-sky.pbrt", OWN + "media-sky.pbrt", OWN + "metal-sun.pbrt",
    OWN + "room-window.pbrt", OWN + "glass-sun.pbrt", OWN + "small-caustic.pbrt", OWN + "lamps-in-glass.pbrt",
    SCENES + "cornell/cornell-area.gltf", SCENES + "studio/textured-spheres.gltf",
    SCENES + "features/absorption.gltf", SCENES + "features/fire.pbrt", SCENES + "features/fog.pbrt",
    SCENES + "features/glass.gltf", SCENES + "features/many-lights.gltf", SCENES + "features/nested.gltf",
]
# Looked at once, at the end: failures there are reported, and no rule is changed because of them. (docs/ACCURACY.md says
# where that was not kept.)
JUDGED_ON = [
    OWN + "lamp-in-bulb.pbrt", SCENES + "cornell/cornell-mirror.gltf", SCENES + "features/anisotropy.gltf",
    SCENES + "features/clearcoat.gltf", SCENES + "features/conductor.pbrt", SCENES + "features/dispersion.gltf",
    SCENES + "features/emissive-strength.gltf", SCENES + "features/iridescence.gltf",
    SCENES + "features/lights.gltf", SCENES + "features/media.pbrt", SCENES + "features/panes.pbrt",
    SCENES + "features/portal.pbrt", SCENES + "features/thin-transmission.gltf", SCENES + "features/window.pbrt",
    SCENES + "features/coated.pbrt", SCENES + "features/lens.pbrt", SCENES + "features/metal.gltf",
]
# Looked at in the same way, in the folder AZULEJO_DATA, with an environment map.
MODELS = [
    ("pbrt/bitterli-staircase2/scene-v4.pbrt", None), ("pbrt/bitterli-coffee/scene-v4.pbrt", None),
    ("pbrt/bitterli-veach-mis/scene-v4.pbrt", None), ("pbrt/bitterli-volumetric-caustic/scene-v4.pbrt", None),
    ("gltf/ToyCar/ToyCar.gltf", "hdri/vestibule_1k.hdr"), ("gltf/DamagedHelmet/DamagedHelmet.glb", "hdri/kloppenheim_05_1k.hdr"),
    ("gltf/IridescentDishWithOlives/IridescentDishWithOlives.gltf", "hdri/studio_small_05_1k.hdr"),
    ("gltf/GlassVaseFlowers/GlassVaseFlowers.glb", "hdri/circus_arena_1k.hdr"),
    ("gltf/ClearCoatTest/ClearCoatTest.glb", "hdri/st_peters_square_night_1k.hdr"),
    ("gltf/SheenChair/SheenChair.gltf", "hdri/leadenhall_market_1k.hdr"),
]
SKY = "cornell-mirror.gltf"  # it needs one
SHOWN = (4, 16, 64)
# Pixels, seeds, levels from 4 spp on, samples of the reference.
SMALL, LARGE, QUICK = ("64x64", 8, 6, 2048), ("160x90", 4, 5, 1024), ("32x32", 8, 5, 2048)
PARTS = ("chosen on", "judged on", "models")


def mean(values):
    return sum(values) / len(values) if values else math.nan


class Case:
    """A scene in one size."""

    def __init__(self, part, run, path, env=None):
        self.part, self.run, self.path, self.env = part, run, path, env
        self.name = os.path.basename(path)
        if part == "models" and "/gltf/" not in path:
            self.name = os.path.basename(os.path.dirname(path)).replace("bitterli-", "")

    def measure(self, options):
        """Lines of calibrate."""
        size, seeds, levels, reference = self.run
        command = [TOOL, self.path, "--size", size, "--seeds", str(seeds), "--levels", str(levels), "--reference-seeds", "1",
                   "--reference-spp", str(reference)]
        if options.tonemap:
            command += ["--tonemap", options.tonemap]
        if self.env:
            command += ["--env", self.env]
        if options.cache:
            command += ["--cache", os.path.join(options.cache, "%s-%s.cal" % (os.path.splitext(self.name)[0], size))]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, universal_newlines=True)
        if done.returncode != 0:
            sys.exit("accuracy.py: no figures of %s: %s ended with %d" % (self.path, " ".join(command), done.returncode))
        return done.stdout


def cases(options, sky):
    """All of them. `sky`: a file, which is made."""
    subprocess.run([os.path.join(ROOT, BUILD, "bin/scenes/sky/make_sky"), "--size", "512x256", "-o", sky],
                   stdout=subprocess.DEVNULL, check=True)
    out, data = [], os.environ.get("AZULEJO_DATA")
    for run in (QUICK,) if options.quick else (SMALL, LARGE):
        for part, paths in zip(PARTS, (CHOSEN_ON, JUDGED_ON)):
            out += [Case(part, run, path, sky if path.endswith(SKY) else None) for path in paths]
    if data and not options.quick:
        out += [Case(PARTS[2], LARGE, os.path.join(data, path), env and os.path.join(data, env)) for path, env in MODELS]
    return out


def collect(options):
    header = subprocess.run([TOOL, "--header"], stdout=subprocess.PIPE, check=True,
                            universal_newlines=True).stdout
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        todo = cases(options, os.path.join(folder, "sky.exr"))
        texts = list(pool.map(lambda case: case.measure(options), todo))
    rows = []
    for case, text in zip(todo, texts):
        for row in csv.DictReader(io.StringIO(header + text)):
            rows.append({key: value if key == "scene" else float(value) for key, value in row.items()})
            rows[-1].update(scene=case.name, scenes=case.part, size=case.run[0])
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


def parts_of(rows):
    """Every part of the scenes at every size, in order: its name in tables, and its rows."""
    out = collections.OrderedDict()
    for row in rows:
        out.setdefault("%s | %s" % (row["scenes"], row["size"]), []).append(row)
    return out


def cells_of(rows, *keys):
    out = collections.OrderedDict()
    for row in rows:
        out.setdefault(tuple(row[key] for key in keys or CELL), []).append(row)
    return out


CELL = ("scene", "size", "spp")


def table_of_words(rows, out):
    out.append("| figure | scenes | pixels | wrong by more than 1.5: warned | within 15 %: warned | in between: warned |")
    out.append("|---|---|---|---:|---:|---:|")
    for figure, name in FIGURES:
        for part, all_of_it in parts_of(rows).items():
            columns = []
            for low, high in ((1.5, math.inf), (0, 1.15), (1.15, 1.5)):
                some = [r for r in all_of_it if low < off_by(r, figure) <= high]
                warned = sum(not is_reliable(r, figure) for r in some)
                columns.append("%d of %d%s" % (warned, len(some), " (%.0f %%)" % (100 * warned / len(some)) if some else ""))
            out.append("| %s | %s | %s |" % (name, part, " | ".join(columns)))


def table_of_calibration(rows, out):
    """Cells whose mean is within 15 % of the truth, whatever the word says."""
    out.append("| figure | scenes | pixels | all cells within 15 % | from 32 spp on |")
    out.append("|---|---|---|---:|---:|")
    for figure, name in FIGURES + (("part", "worst part"),):
        for part, all_of_it in parts_of(rows).items():
            some = [(cell[0]["spp"], ratio_of(cell, figure)) for cell in cells_of(all_of_it).values() if not is_empty(cell[0])]
            some = [(spp, ratio) for spp, ratio in some if not math.isnan(ratio)]
            good = [spp for spp, ratio in some if 0.85 <= ratio <= 1.15]
            out.append("| %s | %s | %d of %d | %d of %d |" % (
                name, part, len(good), len(some), sum(s >= 32 for s in good), sum(s >= 32 for s, _ in some)))


def table_of_fireflies(rows, out):
    """What stands out of its neighbours above the reference, and what the picture alone says (judge.h)."""
    out.append("| scenes | pixels | spp | fireflies | found | false ones, of 10,000 pixels |")
    out.append("|---|---|---:|---:|---:|---:|")
    for part, all_of_it in parts_of(rows).items():
        for spp in SHOWN:
            some = [r for r in all_of_it if r["spp"] == spp]
            there, pixels = sum(r["fireflies"] for r in some), sum(r["pixels"] for r in some)
            out.append("| %s | %d | %d | %s | %.1f |" % (
                part, spp, there, "%.0f %%" % (100 * sum(r["found"] for r in some) / there) if there else "-",
                10000 * sum(r["wrong"] for r in some) / pixels))


def table_of_intervals(rows, out):
    out.append("| figure | pixels | reliable pictures | interval holds | cells too low or high, Sidak |")
    out.append("|---|---|---:|---:|---:|")
    for figure, name in FIGURES:
        for (size,), all_of_it in cells_of(rows, "size").items():
            good = [[r for r in cell if is_reliable(r, figure) and not is_empty(r)] for cell in cells_of(all_of_it).values()]
            good = [cell for cell in good if cell]
            if not good:
                continue
            level = 1 - 0.95 ** (1 / len(good))
            odd = sum(binomial(sum(holds(r, figure) for r in cell), len(cell), 0.95) < level for cell in good)
            out.append("| %s | %s | %d in %d cells | %.1f %% | %d |" % (
                name, size, sum(map(len, good)), len(good), 100 * mean([holds(r, figure) for cell in good for r in cell]), odd))


def table_of_exposures(rows, out):
    """The log-mean by which a picture is shown, over the truth's."""
    out.append("| scenes | pixels | spp | off by | the worst scene | seeds differ by, at most |")
    out.append("|---|---|---:|---:|---:|---:|")
    for part, all_of_it in parts_of(rows).items():
        for spp in SHOWN:
            cells = cells_of([r for r in all_of_it if r["spp"] == spp], "scene")
            off = sorted((mean([r["exposure"] for r in cell]), scene) for (scene,), cell in cells.items())
            worst = max(off, key=lambda one: abs(one[0]))
            spread = max(max(r["exposure"] for r in cell) - min(r["exposure"] for r in cell) for cell in cells.values())
            out.append("| %s | %d | %.0f %% | %s: %.2f | %.0f %% |" % (
                part, spp, 100 * math.expm1(mean([abs(value) for value, _ in off])), worst[1], math.exp(worst[0]),
                100 * math.expm1(spread)))


def demands(rows, out):
    """Where a demand is missed, in words."""
    missed = []
    for (scene, size, spp), cell in cells_of(rows).items():
        for figure, name in FIGURES:
            good = [r for r in cell if is_reliable(r, figure) and not is_empty(r)]
            ratio = ratio_of(good, figure)
            if len(good) >= 3 and not 0.85 <= ratio <= 1.15:
                missed.append("%s, %s, %d spp: %s %.2f" % (scene, size, spp, name, ratio))
    out.append("Cells of at least three reliable pictures whose mean, printed over true, is off by more than 15 %%: %s." % ("; ".join(missed) or "none"))


def predictions(rows, out):
    """The cost curve through the points so far, asked for the cost of the error that 4 times the samples showed: in
    samples, in CPU-seconds, and in samples from the seeds' mean figures, which have almost no noise."""
    out.append("| scenes | pixels | from | reliable pictures | samples: within 25 % | interval holds | CPU-seconds: within 25 % | samples, without the figures' noise |")
    out.append("|---|---|---:|---:|---:|---:|---:|---:|")
    for part, all_of_it in parts_of(rows).items():
        for (spp,), some in cells_of(all_of_it, "spp").items():
            truth = 4 * spp
            found = [(near(r["samples"], truth), r["samples_lo"] <= truth <= r["samples_hi"], near(r["cost"], r["later_cpu_s"]),
                      near(r["samples_even"], truth)) for r in some if r["reliable"] and r["later_reliable"] and r["samples"] > 0]
            if found:
                out.append("| %s | %d spp | %d | %s |" % (
                    part, spp, len(found), " | ".join("%.0f %%" % (100 * mean([f[i] for f in found])) for i in range(4))))


def table_of_cells(rows, out):
    """The true error, and printed over true, and how many pictures are warned of."""
    cells = cells_of(rows)
    out.append("| scene | pixels | %s |" % " | ".join("%s, %d spp" % (name, spp) for _, name in FIGURES for spp in SHOWN))
    out.append("|---|---|%s" % ("---:|" * len(FIGURES) * len(SHOWN)))
    for scene, size in cells_of(rows, "scene", "size"):
        line = []
        for figure, _ in FIGURES:
            for spp in SHOWN:
                cell = cells[scene, size, spp]
                warned = sum(not is_reliable(r, figure) for r in cell)
                line.append("%s: %s%s" % (
                    show(mean([r[figure + "_true"] for r in cell]), "%.1f" if figure == "display" else "%.3g %%"),
                    show(ratio_of(cell, figure)), ", %d of %d warned" % (warned, len(cell)) if warned else ""))
        out.append("| %s | %s | %s |" % (scene, size, " | ".join(line)))


def near(value, truth):
    return value > 0 and abs(math.log(value / truth)) < math.log(1.25)


COLOURS = ("#1b6ca8", "#c0392b", "#27893a", "#8e44ad", "#c77c11", "#16807a", "#7a5230", "#d0408f", "#555555", "#2f4858")


def draw(rows):
    """Display error, printed over true, over samples, one line a scene; dots where most pictures are reliable. Scenes that
    leave the band have a colour and a name."""
    width, height, left, top = 360, 300, 46, 30
    cells = {key: cell for key, cell in cells_of(rows).items() if ratio_of(cell, "display") > 0}
    off = sorted({scene for (scene, _, _), cell in cells.items() if not 0.85 <= ratio_of(cell, "display") <= 1.15})
    colour = dict(zip(off, COLOURS * 2))
    out = ['<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 370" font-family="sans-serif" font-size="11">',
           '<rect width="960" height="370" fill="white"/>']
    low, high = math.log(0.5), math.log(2)
    for panel, at in enumerate((SMALL[0], LARGE[0])):
        x0 = left + panel * (width + 30)
        def across(spp):
            return x0 + math.log2(spp / 4) / 5 * (width - 40)
        def up(ratio):
            return top + (high - max(low, min(high, math.log(ratio)))) / (high - low) * height
        out.append('<text x="%.0f" y="18">display error of %s pixels, printed / true</text>' % (x0, at))
        out.append('<rect x="%.1f" y="%.1f" width="%.1f" height="%.1f" fill="#e8f0e8"/>' % (x0, up(1.15), width - 40, up(0.85) - up(1.15)))
        for ratio in (0.5, 1, 2):
            out.append('<path d="M%.1f %.1fh%.1f" stroke="#bbb"/><text x="%.1f" y="%.1f" text-anchor="end">%g</text>' % (x0, up(ratio), width - 40, x0 - 5, up(ratio) + 4, ratio))
        for spp in (4, 8, 16, 32, 64, 128):
            out.append('<text x="%.1f" y="%d" text-anchor="middle">%d</text>' % (across(spp), top + height + 16, spp))
        for scene in sorted({s for s, size, _ in cells if size == at}, key=lambda one: one in colour):
            points = [(across(spp), up(ratio_of(cell, "display")), sum(bool(r["reliable"]) for r in cell) > len(cell) / 2)
                      for (s, size, spp), cell in cells.items() if s == scene and size == at]
            out.append('<polyline fill="none" stroke="%s" points="%s"/>' % (colour.get(scene, "#999"), " ".join("%.1f,%.1f" % p[:2] for p in points)))
            out += ['<circle cx="%.1f" cy="%.1f" r="2.6" fill="%s"/>' % (x, y, colour[scene]) for x, y, reliable in points if reliable and scene in colour]
    out += ['<text x="808" y="%d" fill="%s">%s</text>' % (top + 8 + index * 16, colour[scene], os.path.splitext(scene)[0]) for index, scene in enumerate(off)]
    out.append('<text x="808" y="%d" fill="#777">all others</text>' % (top + 8 + len(off) * 16))
    out.append('<text x="%d" y="364">samples of a pixel; dots: most pictures are reliable; band: 15 %%</text></svg>' % left)
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--tonemap", help="another operator than the default; prints, and writes no file")
    parser.add_argument("--print", action="store_true", dest="only_print")
    parser.add_argument("--cache")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if options.cache:
        os.makedirs(options.cache, exist_ok=True)
    rows = collect(options)
    out = []
    for title, table in (("The word", table_of_words), ("Calibration", table_of_calibration), ("Fireflies", table_of_fireflies),
                         ("Intervals of 95 %", table_of_intervals), ("Exposure", table_of_exposures), ("Cells that are off", demands), ("Cost", predictions),
                         ("All cells", table_of_cells)):
        out += ["### " + title, ""]
        table(rows, out)
        out.append("")
    text = "\n".join(out[:-1])
    print(text)
    if options.quick or options.only_print or options.tonemap:
        return
    written.write("accuracy", text)
    with open(PLOT, "w") as target:
        target.write(draw(rows))


if __name__ == "__main__":
    main()
