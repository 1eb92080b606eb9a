#!/usr/bin/env python3
"""`make accuracy-targets`: does a picture that was rendered to a target error have it? Renders scenes to each target, and compares the PNG with
one of many samples that is metered by itself: the 95 % quantile of the largest channel's difference, over the
subject's pixels (by the share of their camera rays that meet a surface or medium).

    targets.py [--write] [--bin FOLDER] [--size WxH] [--spp N] [--reference-spp N] [--seeds N] [--targets E,E] [--cache FOLDER] [SCENE...]

The scenes are of the half that accuracy.py does not choose rules on, and cornell-area. With AZULEJO_DATA also those of the data. --bin: other
programs than those of this tree. --cache keeps the references: remove them after a change of the renderer or the tone
mapping. --write: the table of docs/ACCURACY.md."""
import argparse
import os
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import written  # noqa: E402
from accuracy import MODELS  # noqa: E402
from written import ROOT  # noqa: E402

sys.path.insert(0, os.path.join(ROOT, "tests/farm"))
from png import Png  # noqa: E402

SCENES = ["scenes/features/window.pbrt", "scenes/cornell/cornell-area.gltf", "scenes/cornell/cornell-mirror.gltf",
          "scenes/features/coated.pbrt", "scenes/features/media.pbrt", "scenes/features/dispersion.gltf",
          "scenes/features/emissive-strength.gltf", "scenes/features/thin-transmission.gltf", "scenes/features/fog.pbrt"]
DATA = [(path, "--env", env) if env else (path,) for path, env in MODELS]
QUANTILE = 0.95
MISSED = 9  # exit status
SLACK = 1.1


def render(options, scene, out, *arguments):
    """Writes out.png. The exit status."""
    command = [os.path.join(options.bin, "azulejo"), "render", *scene, "--size", options.size, "--no-dither", "--quiet", "-o", out + ".png", *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if done.returncode not in (0, MISSED):
        sys.exit("targets.py: %s\n%s" % (" ".join(command), done.stderr))
    return done.returncode


def picture(path):
    with open(path, "rb") as file:
        return Png(file.read())


def difference(path, reference, subject):
    """In display codes. `subject`: a picture whose alpha is the share of the rays that meet something."""
    pixels = []
    one, two, mask = picture(path), picture(reference), picture(subject)
    for row, other, alpha in zip(one.codes, two.codes, mask.codes):
        for x in range(one.width):
            p, q, weight = row[3 * x:3 * x + 3], other[3 * x:3 * x + 3], alpha[4 * x + 3]
            if weight:
                pixels.append((max(abs(s - t) for s, t in zip(p, q)), weight))
    pixels.sort()
    left = QUANTILE * sum(weight for _, weight in pixels)
    for codes, weight in pixels:
        left -= weight
        if left <= 0:
            return codes
    return 0


def scene_of(path):
    """Arguments of the client."""
    name = os.environ.get("AZULEJO_DATA", "")
    return [path[0] if os.path.exists(path[0]) else os.path.join(name, path[0])] + \
        [a if a.startswith("--") else os.path.join(name, a) for a in path[1:]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--bin", default=os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "bin"))
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--spp", type=int, default=1024)
    parser.add_argument("--reference-spp", type=int, default=1024)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--targets", default="25,12")
    parser.add_argument("--cache")
    parser.add_argument("scenes", nargs="*")
    options = parser.parse_args()
    os.chdir(ROOT)
    scenes = [(s,) for s in options.scenes or SCENES]
    if not options.scenes and os.environ.get("AZULEJO_DATA"):
        scenes += DATA
    targets = [float(t) for t in options.targets.split(",")]
    held = missed = runs = 0
    table = ["| scene | %s |" % " | ".join("%g/255" % target for target in targets), "|---|%s" % ("---:|" * len(targets))]
    with tempfile.TemporaryDirectory() as folder:
        cache = options.cache or folder
        os.makedirs(cache, exist_ok=True)
        for scene in scenes:
            name = os.path.basename(os.path.dirname(scene[0])) + "-" + os.path.basename(scene[0]).split(".")[0]
            reference = os.path.join(cache, name + ".png")
            if not os.path.exists(reference):
                render(options, scene_of(scene), reference[:-4], "--spp", options.reference_spp, "--seed", 1000)
                render(options, scene_of(scene), reference[:-4] + "-subject", "--spp", 16, "--alpha")
            line = []
            for target in targets:
                cell = []
                for seed in range(1, options.seeds + 1):
                    out = os.path.join(folder, "picture")
                    status = render(options, scene_of(scene), out, "--spp", options.spp, "--seed", seed,
                                    "--target-error", "%g/255" % target)
                    codes = difference(out + ".png", reference, reference[:-4] + "-subject.png")
                    runs += 1
                    held += codes <= SLACK * target
                    missed += status == MISSED and codes > SLACK * target
                    cell.append("%d%s" % (codes, " (missed)" if status == MISSED else ""))
                line.append(", ".join(cell))
            table.append("| %s | %s |" % (os.path.basename(scene[0]) if not scene[0].startswith("pbrt/") else name.rsplit("-", 2)[0], " | ".join(line)))
            print(table[-1], flush=True)
    table += ["", "Within %g of the target: %d of %d runs; of the others %d say that it is missed." % (SLACK, held, runs, missed)]
    print(table[-1])
    if options.write:
        written.write("accuracy-targets", "\n".join(table))


if __name__ == "__main__":
    main()
