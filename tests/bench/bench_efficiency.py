"""`make bench-efficiency BASE=FOLDER`: is this tree at least as efficient as the last release?

FOLDER is a built checkout of the release, or its build folder. Both renderers, alone and on one thread, make the same
pictures in turns, of the same seeds, so that where the bits are the same only time is compared. There is no reference:
the squared error of a picture is its squared distance from the mean of the program's other pictures, times (n - 1) / n,
which has the picture's variance as its expectation, however noisy the others are. It is taken over the squared mean: of
all pixels, each clipped at the value that one in a thousand exceeds, and of the median pixel. A program's bias is not in
it; the statistical tests look for that.

Squared error times CPU time is what a picture of some quality costs; the table shows the other program's over ours, so
above 1 we are cheaper. Its interval is the jackknife's over the pairs of pictures, of the ratio's logarithm, with
Student's t, and so wide that in 95 of 100 tables all of them hold (Sidak): a table of forty ratios of 95 % each would
condemn an equal tree every other time. It fails if a whole interval lies below .97.

pbrt-v4 (`pbrt`, for pbrt scenes) and Cycles (`blender`, for glTF) are measured where they are installed.

  bench_efficiency.py BASE [--write] [SCENE]...     --write: the table of docs/PERFORMANCE.md, too
"""
import json
import math
import os
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "farm"))
from exr import read_exr
from farm import BIN, BUILD, ROOT

LEAST = 0.97
SIZE, SPP = (96, 72), 64
PAIRS = 16
CLIPPED = 0.001
LEVEL = 0.05  # of a table: the probability that any of its intervals misses
DATA = os.environ.get("AZULEJO_DATA")
KEPT = os.path.join(BUILD, "efficiency")
BEGIN, END = "<!-- make bench-efficiency -->\n", "<!-- end of make bench-efficiency -->\n"


class Scene:
    def __init__(self, kind, path, depth=12, env=None, data=False, without=None, name=None, words=()):
        self.kind, self.depth, self.env, self.without = kind, depth, env, without
        self.path = os.path.join(DATA or "" if data else os.path.join(ROOT, "scenes"), path)
        stem = os.path.splitext(os.path.basename(path))[0]
        self.words = words
        self.name = name or (os.path.basename(os.path.dirname(path)) if stem == "scene-v4" else stem)

    def prepare(self):
        """A script that writes the scene becomes what it writes."""
        if self.path.endswith(".py"):
            written = os.path.join(KEPT, self.name + ".pbrt")
            subprocess.run([sys.executable, self.path, written, *self.words], check=True)
            self.path = written

    def environment(self):
        if self.env != "sky":
            return self.env and os.path.join(DATA, self.env)
        sky = os.path.join(KEPT, "sky.exr")
        if not os.path.exists(sky):
            subprocess.run([os.path.join(BIN, "scenes", "sky", "make_sky"), "-o", sky], check=True, capture_output=True)
        return sky


SCENES = [
    Scene("room", "cornell/cornell-area.gltf"),
    Scene("room", "features/window.pbrt"),
    Scene("room", "features/portal.pbrt"),
    Scene("room, no portal", "features/window.pbrt", without="portal", name="window-plain"),
    Scene("room, no portal", "features/window.pbrt", env="sky", without="portal", name="window-sky"),
    Scene("room, no portal", "features/portal.pbrt", without="portal", name="portal-plain"),
    Scene("mirrors, open", "cornell/cornell-mirror.gltf", env="sky", name="cornell-mirror-sky"),
    Scene("water, lamp", "../docs/images/make_pool.py", name="pool-lamp", words=("lamp",)),
    Scene("textured", "studio/textured-spheres.gltf", env="sky"),
    Scene("textured", "features/normal-map.gltf"),
    Scene("textured", "features/alpha.gltf"),
    Scene("layered", "features/clearcoat.gltf"),
    Scene("many lights", "features/many-lights.gltf"),
    Scene("lamps, hidden", "features/house.pbrt"),
    Scene("glass", "features/glass.gltf"),
    Scene("glass", "features/nested.gltf"),
    Scene("glass", "liquids/wine.gltf"),
    Scene("media", "features/media.pbrt"),
    Scene("media", "features/fog.pbrt"),
]
if DATA:
    SCENES += [
        Scene("room", "pbrt/bitterli-cornell-box/scene-v4.pbrt", 4, data=True),
        Scene("room", "pbrt/bitterli-staircase2/scene-v4.pbrt", 65, data=True),
        Scene("glass", "pbrt/bitterli-coffee/scene-v4.pbrt", 17, data=True),
        Scene("lamps", "pbrt/bitterli-veach-mis/scene-v4.pbrt", 3, data=True),
        Scene("media, glass", "pbrt/bitterli-volumetric-caustic/scene-v4.pbrt", 7, data=True),
        Scene("textured", "gltf/DamagedHelmet/DamagedHelmet.glb", env="hdri/chinese_garden_1k.hdr", data=True),
        Scene("textured", "gltf/FlightHelmet/FlightHelmet.gltf", env="hdri/chinese_garden_1k.hdr", data=True),
    ]


def run(argv, **how):
    """What it printed, and the CPU seconds of it and its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(argv, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, **how)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit("bench-efficiency: failed: %s\n%s" % (" ".join(argv), done.stdout[-2000:]))
    return done.stdout, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


# ---- renderers: each renders a scene into an EXR and returns its CPU seconds without the scene's preparation ------

class Azulejo:
    def __init__(self, name, build):
        self.name, self.program = name, os.path.join(build, "tests", "bench", "bench_render")
        if not os.path.exists(self.program):
            sys.exit("bench-efficiency: %s is not there: build it (make all build/release/tests/bench/bench_render)" %
                     self.program)

    def reads(self, scene):
        return True

    def render(self, scene, seed, spp, threads, out):
        argv = [self.program, scene.path, "--size", "%dx%d" % SIZE, "--spp", str(spp), "--seed", str(seed), "--max-depth",
                str(scene.depth), "--threads", str(threads), "--json", "--out", out]
        if scene.environment():
            argv += ["--env", scene.environment()]
        if scene.without:
            argv += ["--without", scene.without]
        return json.loads(run(argv)[0].strip().split("\n")[-1])["cpu_s"]


class Pbrt:
    name = "pbrt-v4"

    def __init__(self):
        self.program = shutil.which("pbrt")

    def reads(self, scene):
        return self.program and scene.path.endswith(".pbrt") and not scene.without

    def render(self, scene, seed, spp, threads, out):
        """Of the scene's text only the picture's size is changed; its files lie beside it by links."""
        with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
            for name in os.listdir(os.path.dirname(scene.path)):
                os.symlink(os.path.join(os.path.dirname(scene.path), name), os.path.join(folder, name))
            with open(scene.path) as file:
                text = file.read()
            for side, value in zip("xy", SIZE):
                text = re.sub(r'("integer %sresolution")\s*\[?\s*\d+\s*\]?' % side, r"\1 [ %d ]" % value, text)
            copy = os.path.join(folder, os.path.basename(scene.path))
            os.remove(copy)
            with open(copy, "w") as file:
                file.write(text)
            argv = [self.program, "--quiet", "--nthreads", str(threads), "--seed", str(seed), "--outfile", out]
            once = run(argv + ["--spp", "1", copy])[1]
            return max(run(argv + ["--spp", str(spp), copy])[1] - once, 1e-3)


class Cycles:
    name = "Cycles"

    def __init__(self):
        self.program = shutil.which("blender")

    def reads(self, scene):
        return self.program and not scene.path.endswith(".pbrt")

    def render(self, scene, seed, spp, threads, out):
        argv = [self.program, "-b", "--factory-startup", "-P", os.path.join(HERE, "..", "peers", "cycles_render.py"), "--",
                scene.path, out, str(SIZE[0]), str(SIZE[1]), str(spp), str(scene.depth), scene.environment() or "-"]
        text = run(argv, env=dict(os.environ, CYCLES_SEED=str(seed), CYCLES_THREADS=str(threads)))[0]
        return float(re.search(r"([0-9.]+) CPU-seconds", text).group(1))


# ---- figures -----------------------------------------------------------------------------------------------------

def pixels(path):
    """[pixel][R, G, B]"""
    picture = read_exr(path)
    return list(zip(*(picture.values(channel) for channel in "RGB")))


def errors(pictures):
    """Of each picture: the mean, clipped, and the median of its pixels' squared errors over the squared mean."""
    count = len(pictures)
    sums = [[sum(values) for values in zip(*pixel)] for pixel in zip(*pictures)]
    mean = statistics.fmean(v for pixel in sums for v in pixel) / count
    if not mean > 0:
        return [(0, 0)] * count
    # (P - mean of the others)^2 (n - 1) / n = (n P - sum)^2 / (n (n - 1))
    scale = 1 / (3 * count * (count - 1) * mean ** 2)
    found = []
    for picture in pictures:
        squares = sorted(scale * sum((count * a - b) ** 2 for a, b in zip(p, s)) for p, s in zip(picture, sums))
        most = squares[len(squares) - 1 - int(CLIPPED * len(squares))]
        found.append((statistics.fmean(min(s, most) for s in squares), statistics.median(squares)))
    return found


def student(probability, degrees):
    """Quantile of Student's t, by Simpson's rule and bisection."""
    def above_half(t, steps=2000):
        def density(x):
            return (1 + x * x / degrees) ** (-(degrees + 1) / 2)
        inner = sum((4 if i % 2 else 2) * density(t * i / steps) for i in range(1, steps))
        return (inner + density(0) + density(t)) * t / steps / 3 * math.exp(
            math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)) / math.sqrt(degrees * math.pi)

    low, high = 0.0, 1000.0
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if above_half(middle) < probability - 0.5 else (low, middle)
    return low


def interval(ours, theirs, wide):
    """Their mean error times their mean time over ours, and the ends of its interval of `wide` standard errors.
    Lists of (error, seconds), of the same seeds."""
    def ratio(without=None):
        sums = [math.fsum(pair[k] for i, pair in enumerate(costs) if i != without) for costs in (ours, theirs) for k in (0, 1)]
        return math.log(sums[2]) + math.log(sums[3]) - math.log(sums[0]) - math.log(sums[1])

    count, middle = len(ours), ratio()
    left_out = [ratio(i) for i in range(count)]
    half = wide * math.sqrt((count - 1) * statistics.pvariance(left_out))
    return tuple(math.exp(x) for x in (middle, middle - half, middle + half))


def width(ratios):
    """Standard errors on either side, so that all of a table's intervals hold at once."""
    return student(1 - (1 - (1 - LEVEL) ** (1 / ratios)) / 2, PAIRS - 1)


def fails(ratio):
    """Is it surely below LEAST?"""
    return ratio[2] < LEAST


def measure(ours, others, scene, wide, folder):
    """Of each of the others: the ratios of the clipped mean and of the median pixel, or None."""
    everyone = [ours] + [r for r in others if r.reads(scene)]
    pictures, seconds = {r: [] for r in everyone}, {r: [] for r in everyone}
    out = os.path.join(folder, "picture.exr")
    for i in range(PAIRS):
        for r in everyone if i % 2 else everyone[::-1]:
            seconds[r].append(r.render(scene, i + 1, SPP, 1, out))
            pictures[r].append(pixels(out))
    found = {r: errors(pictures[r]) for r in everyone}
    for r in everyone:
        if min(map(min, found[r])) <= 0 or min(seconds[r]) <= 0:
            sys.exit("bench-efficiency: %s: %s has no noise, or took no time" % (scene.name, r.name))
    costs = {r: [[(e[k], t) for e, t in zip(found[r], seconds[r])] for k in (0, 1)] for r in everyone}
    return [[interval(costs[ours][k], costs[r][k], wide) for k in (0, 1)] if r in costs else None for r in others]


# ---- the table ---------------------------------------------------------------------------------------------------

def cell(ratio):
    return "%.2f (%.2f to %.2f)" % ratio


def write_document(text):
    path = os.path.join(ROOT, "docs", "PERFORMANCE.md")
    with open(path) as file:
        before, rest = file.read().split(BEGIN)
    with open(path, "w") as file:
        file.write(before + BEGIN + text + END + rest.split(END)[1])


def main():
    words = [w for w in sys.argv[1:] if w != "--write"]
    if not words or not words[0]:
        sys.exit("usage: make bench-efficiency BASE=FOLDER, of a built checkout of the last release")
    base = words[0]
    if os.path.exists(os.path.join(base, "build", "release", "bin")):
        base = os.path.join(base, "build", "release")
    ours, base = Azulejo("this", BUILD), Azulejo("the last release", os.path.abspath(base))
    peers = [Pbrt(), Cycles()]
    chosen = [s for s in SCENES if not words[1:] or s.name in words[1:]]
    if not chosen or len(chosen) < len(words[1:]):
        sys.exit("bench-efficiency: scenes are %s" % ", ".join(s.name for s in SCENES))
    os.makedirs(KEPT, exist_ok=True)
    lines, low, logs = [], [], []
    wide = width(2 * len(chosen))

    def say(line):
        lines.append(line)
        print(line, flush=True)

    say("| scene | what | release: mean | median pixel | %s |" % " | ".join("%s: mean | median pixel" % p.name for p in peers))
    say("|---|---|---|---|%s" % ("---|" * 2 * len(peers)))
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        for scene in chosen:
            scene.prepare()
            release, *theirs = measure(ours, [base] + peers, scene, wide, folder)
            cells = [cell(r) for r in release]
            for peer, ratios in zip(peers, theirs):
                cells += [cell(r) for r in ratios] if ratios else ["-" if peer.program else "not installed"] * 2
            say("| %s | %s | %s |" % (scene.name, scene.kind, " | ".join(cells)))
            low += ["%s, %s" % (scene.name, what) for what, r in zip(("mean", "median pixel"), release) if fails(r)]
            logs.append([math.log(r[0]) for r in release])
    say("| **geometric mean** | | **%.2f** | **%.2f** |%s" % (
        math.exp(statistics.fmean(l[0] for l in logs)), math.exp(statistics.fmean(l[1] for l in logs)), " |" * 2 * len(peers)))
    with open(os.path.join(KEPT, "table.md"), "w") as file:
        file.write("\n".join(lines) + "\n")
    if "--write" in sys.argv[1:]:
        write_document("\n".join(lines) + "\n")
    if low:
        sys.exit("bench-efficiency: below %.2f of the last release's efficiency: %s" % (LEAST, "; ".join(low)))


if __name__ == "__main__":
    main()
