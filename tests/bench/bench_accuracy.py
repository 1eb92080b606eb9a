"""This tree's efficiency, 1 / (error^2 x CPU-seconds), over another commit's: `make bench-accuracy AGAINST=COMMIT`.

Both render the same scenes with the same seeds. An error^2 is half the mean squared difference of two
pictures of different seeds, as a screen shows them (sRGB): no reference is needed. Pairs of seeds are the
sample: the ratio is the geometric mean over scenes and pairs, its interval Student's t over the pairs of the
means over the scenes, so it is about these scenes and any seeds. A tree that renders another picture may
well be efficient at it: the last column is how far the frames' means are apart, t over the seeds.
"""
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SIZE, SPP = os.environ.get("BENCH_SIZE", "96x64"), int(os.environ.get("BENCH_SPP", "64"))
PAIRS = int(os.environ.get("BENCH_PAIRS", "6"))
SCENES = ["scenes/cornell/cornell-area.gltf", "scenes/cornell/cornell-mirror.gltf",
          "scenes/studio/textured-spheres.gltf", "scenes/features/clearcoat.gltf",
          "scenes/features/portal.pbrt", "scenes/features/glass.gltf"]
T95 = [math.nan, 12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179]


def run(*argv, codes=(0,), **how):
    done = subprocess.run(argv, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, **how)
    if done.returncode not in codes:
        sys.exit("failed (%d): %s\n%s" % (done.returncode, " ".join(argv), done.stderr[-2000:]))
    return done.stdout


def interval(values):
    """Mean and half of its 95 % interval."""
    if len(values) < 2:
        return values[0], math.nan
    t = T95[min(len(values) - 1, len(T95) - 1)]
    return statistics.mean(values), t * statistics.stdev(values) / math.sqrt(len(values))


def checkout(commit):
    """The commit, built beside our own objects; made once."""
    full = run("git", "-C", ROOT, "rev-parse", "--verify", commit + "^{commit}").strip()
    tree = os.path.join(ROOT, "build", "against-" + full[:12])
    if not os.path.exists(os.path.join(tree, "Makefile")):
        run("git", "clone", "--quiet", "--shared", "--no-checkout", ROOT, tree)
        run("git", "-C", tree, "checkout", "--quiet", "--detach", full)
    print("building %s" % full[:12], file=sys.stderr, flush=True)
    run("make", "-s", "-C", tree, "-j%d" % os.cpu_count(), "all",
        env={k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k != "BUILD"})
    return os.path.join(tree, "build", "release", "bin", "azulejo")


def render(program, scene, seed, out):
    text = run(program, "render", os.path.join(ROOT, scene), "--size", SIZE, "--spp", str(SPP), "--threads", "1",
               "--seed", str(seed), "--format", "exr", "--json", "-o", out)
    return json.loads(text)["job"]["stats"]["cpu_ns"] / 1e9


def compare(ours, a, b):
    """Mean squared difference of the sRGB pictures, and how far the means are apart."""
    seen = json.loads(run(ours, "compare", a, b, "--json", codes=(0, 1)))
    psnr, means = seen.get("psnr_db"), [m for m in seen.get("mean_relative", []) if m is not None]
    return 0 if psnr is None else 10 ** (-psnr / 10), statistics.mean(means) if means else 0


def measure_pair(programs, scene, pair, folder):
    """ln(efficiency of programs[0] / of programs[1]), and the relative differences of the means."""
    cost = [0.0, 0.0]
    for seed in (2 * pair, 2 * pair + 1):
        for which in (0, 1) if seed % 2 else (1, 0):  # in turns
            cost[which] += render(programs[which], scene, seed,
                                  os.path.join(folder, "%d-%d.exr" % (which, seed % 2)))
    path = [[os.path.join(folder, "%d-%d.exr" % (which, seed)) for seed in (0, 1)] for which in (0, 1)]
    error = [compare(programs[0], *path[which])[0] for which in (0, 1)]
    apart = [compare(programs[0], path[0][seed], path[1][seed])[1] for seed in (0, 1)]
    if min(error) <= 0:
        sys.exit("%s: two seeds give the same picture, so it has no noise to compare" % scene)
    return math.log(error[1] * cost[1] / (error[0] * cost[0])), apart


def main():
    if len(sys.argv) != 2 or not sys.argv[1]:
        sys.exit("usage: make bench-accuracy AGAINST=COMMIT")
    programs = [os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "bin", "azulejo"),
                checkout(sys.argv[1])]
    rows = []
    print("efficiency 1/(error^2 CPU-s) of this tree over that of %s: render --size %s --spp %d, "
          "%d pairs of seeds\n" % (sys.argv[1], SIZE, SPP, PAIRS))
    print("| scene | ratio | 95 % | means apart, % |\n|---|---:|---|---:|")
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        for scene in SCENES:
            pairs = [measure_pair(programs, scene, pair, folder) for pair in range(PAIRS)]
            rows.append([log for log, _ in pairs])
            mean, half = interval(rows[-1])
            apart, apart_half = interval([100 * a for _, both in pairs for a in both])
            print("| %s | %.2f | %.2f to %.2f | %+.2f +- %.2f |" % (
                os.path.splitext(os.path.basename(scene))[0], math.exp(mean), math.exp(mean - half),
                math.exp(mean + half), apart, apart_half), flush=True)
    mean, half = interval([statistics.mean(pair) for pair in zip(*rows)])
    print("| **all** | **%.2f** | %.2f to %.2f | |" % (math.exp(mean), math.exp(mean - half),
                                                     math.exp(mean + half)))


main()
