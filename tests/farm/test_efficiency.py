"""make bench-efficiency computes what it says: on renderers whose error and time are known, and without any clock."""
import contextlib
import io
import json
import os
import random
import shutil
import stat
import statistics
import subprocess
import sys
import tempfile
import types

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Failure, ROOT, Tests

tests = Tests()
SCRIPT = os.path.join(ROOT, "tests", "bench", "bench_efficiency.py")
sys.path.insert(0, os.path.dirname(SCRIPT))
# The script with smaller pictures.
SMALL = "import sys; sys.path.insert(0, %r); import bench_efficiency; bench_efficiency.SIZE = 48, 36; bench_efficiency.main()" % os.path.dirname(SCRIPT)
import bench_efficiency as bench_script
import bench_scale

# A renderer of a grey picture: 1 + NOISE * a pattern of the seed; one pixel in 2000 is a firefly.
FAKE = r'''#!{python} -S
import random, struct, sys
argv = sys.argv[1:]
def of(name): return argv[argv.index(name) + 1]
pbrt = "--nthreads" in argv
cycles = "-P" in argv
if cycles:
    import os
    rest = argv[argv.index("--") + 1:]
    out, width, height, spp, seed = rest[1], int(rest[2]), int(rest[3]), int(rest[4]), int(os.environ["CYCLES_SEED"])
elif pbrt:
    out, spp, seed = of("--outfile"), int(of("--spp")), int(of("--seed"))
    width, height = 48, 36
    text = open(argv[-1]).read()
    assert '"integer xresolution" [ 48 ]' in text and '"integer yresolution" [ 36 ]' in text, text
else:
    out, spp, seed = of("--out"), int(of("--spp")), int(of("--seed"))
    width, height = (int(v) for v in of("--size").split("x"))
rng = random.Random(seed)
values = []
for i in range(width * height):
    wave = rng.uniform(0.5, 1.5) * rng.choice((-1, 1))
    values.append({level} * (1 + {noise} * wave))
    if i % 2000 == 7 and seed % 3 == 0:
        values[-1] += {firefly}
def attribute(name, kind, data):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(data)) + data
channels = b"".join(c.encode() + b"\0" + struct.pack("<iIii", 2, 0, 1, 1) for c in "BGR") + b"\0"
box = struct.pack("<4i", 0, 0, width - 1, height - 1)
head = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\0") + \
    attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box) + attribute("lineOrder", "lineOrder", b"\0") + \
    attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) + attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) + \
    attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
rows = [struct.pack("<%df" % (3 * width), *(values[y * width:(y + 1) * width] * 3)) for y in range(height)]
at = len(head) + 8 * height
chunk = 8 + 12 * width
with open(out, "wb") as file:
    file.write(head + b"".join(struct.pack("<Q", at + y * chunk) for y in range(height)) +
               b"".join(struct.pack("<iI", y, len(r)) + r for y, r in enumerate(rows)))
if cycles:
    print("cycles: render 1.00 seconds, {cpu} CPU-seconds")
elif not pbrt:
    print('{{"cpu_s": {cpu}}}')
'''


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def put(path, noise, cpu, firefly=0, level=1):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as file:
        file.write(FAKE.format(python=sys.executable, noise=noise, cpu=cpu, firefly=firefly, level=level))
    os.chmod(path, os.stat(path).st_mode | stat.S_IXUSR)


class Bench:
    """A folder with two fake trees; with peers, too."""

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="azulejo-test-")
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.folder)

    def path(self, *parts):
        return os.path.join(self.folder, *parts)

    def trees(self, ours, base):
        put(self.path("ours", "tests", "bench", "bench_render"), **ours)
        put(self.path("base", "tests", "bench", "bench_render"), **base)

    def run(self, *scenes):
        env = dict(os.environ, BUILD=self.path("ours"), PATH=self.path("bin") + ":/nowhere")
        env.pop("AZULEJO_DATA", None)
        return subprocess.run([sys.executable, "-B", "-c", SMALL, self.path("base")] + list(scenes or ("cornell-area",)), env=env,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, timeout=300)

    def row(self, result, scene="cornell-area"):
        lines = [line for line in result.stdout.split("\n") if line.startswith("| %s |" % scene)]
        expect(len(lines) == 1, result)
        return [cell.strip() for cell in lines[0].split("|")[1:-1]]


@tests.add
def limits_of_a_farm():
    """make bench-farm fails where a farm costs more than the base beyond the noise, or more than 2 bytes are written for one"""
    share, written, cost = "rendering threads' share", "written per byte read", "coordinator, share of rendering"
    for now, base, failures in (({share: 0.9, written: 2.0}, {share: 0.9, written: 5.0}, 0),
                                ({share: 0.891, written: 1.5}, {share: 0.9, written: 1.4}, 0),
                                ({share: 0.889, written: 1.5}, {share: 0.9, written: 1.4}, 1),
                                ({cost: 0.114, written: 1.5}, {cost: 0.1, written: 1.4}, 0),
                                ({cost: 0.116, written: 1.5}, {cost: 0.1, written: 1.4}, 1),
                                ({share: 0.95, written: 2.01}, {share: 0.9, written: 5.0}, 1),
                                ({share: 0.8, written: 3.0, "other": 9.0}, {share: 0.9, written: 1.0, "other": 1.0}, 2)):
        def measured(argv, now=now, base=base, **_):
            tree = argv[argv.index("--tree") + 1]
            return subprocess.CompletedProcess(argv, 0, json.dumps(now if tree == bench_scale.ROOT else base) + "\n")
        real, bench_scale.subprocess = bench_scale.subprocess, types.SimpleNamespace(run=measured, PIPE=subprocess.PIPE)
        out, said = io.StringIO(), io.StringIO()
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
                found = bench_scale.show_farm(types.SimpleNamespace(base="/base", pairs=1))
        finally:
            bench_scale.subprocess = real
        jobs = len(bench_scale.JOBS)
        expect(found == failures * jobs and said.getvalue().count("beyond its limit") == found, (found, said.getvalue()))
        expect(out.getvalue().count("| 5.000 |") == (jobs if base[written] == 5 else 0), out.getvalue())


@tests.add
def known_ratio():
    """the ratio is the base's squared error times CPU time over ours; at .96 it fails and says where, at .98 it passes"""
    for cpu, passes in ((1.0, True), (0.96, False), (0.98, True)):
        with Bench() as bench:
            bench.trees(dict(noise=0.1, cpu=1), dict(noise=0.1, cpu=cpu))
            result = bench.run()
            cells = bench.row(result)
            expect(cells[2] == cells[3] == "%.2f (%.2f to %.2f)" % (cpu, cpu, cpu), cells)
            expect((result.returncode == 0) == passes, result)
            expect(passes or "cornell-area, mean; cornell-area, median pixel" in result.stderr, result.stderr)
            expect(cells[4:] == ["not installed"] * 4, cells)
            with open(bench.path("ours", "efficiency", "table.md")) as file:
                expect(file.read() == result.stdout, "table.md")


@tests.add
def error_is_squared():
    """twice the error costs four times as much; the level of the picture does not matter"""
    with Bench() as bench:
        bench.trees(dict(noise=0.1, cpu=1), dict(noise=0.2, cpu=0.5, level=7))
        cells = bench.row(bench.run())
        expect(cells[2].startswith("2.00 ") and cells[3].startswith("2.00 "), cells)


@tests.add
def few_bright_samples():
    """bright samples in one pixel of 2000 are clipped from the mean, of which they would be a quarter"""
    with Bench() as bench:
        bench.trees(dict(noise=0.1, cpu=1, firefly=5), dict(noise=0.1, cpu=1))
        result = bench.run()
        cells = bench.row(result)
        expect(result.returncode == 0 and cells[2].startswith("1.00 ") and cells[3].startswith("1.00 "), cells)


def simulated(rng, noise, rare, count=bench_script.PAIRS, size=300):
    """(mean error, seconds) of `count` pictures of grey pixels. In each a pixel errs by `noise`; with the odds `rare` by ten times that."""
    pictures = []
    for _ in range(count):
        values = [1 + noise * rng.gauss(0, 1) * (10 if rng.random() < rare else 1) for _ in range(size)]
        pictures.append([(v, v, v) for v in values])
    return [(mean, 1) for mean, _ in bench_script.errors(pictures)]


@tests.add
def noise_of_all_pictures():
    """the error needs no reference: over many sets of sixteen noisy pictures its mean is the known one"""
    rng = random.Random(1)
    found = [e for _ in range(60) for e, _ in simulated(rng, 0.1, 0)]
    expect(abs(statistics.fmean(found) / 0.01 - 1) < 0.005, statistics.fmean(found))
    # Few pictures are as good in the mean, however noisy the others are.
    found = [e for _ in range(600) for e, _ in simulated(rng, 0.1, 0, count=3)]
    expect(abs(statistics.fmean(found) / 0.01 - 1) < 0.01, statistics.fmean(found))


@tests.add
def intervals_hold():
    """of renderers of known errors an interval of 95 % misses as seldom as it says, also where a few samples decide; an
    equal renderer is not condemned, and one of half the efficiency is"""
    rng = random.Random(2)
    wide, table = bench_script.student(0.975, bench_script.PAIRS - 1), bench_script.width(40)
    for rare, most in ((0, 0.08), (0.003, 0.13)):
        missed = condemned = caught = 0
        runs = 200
        for _ in range(runs):
            ours, same = simulated(rng, 0.15, rare, size=100), simulated(rng, 0.15, rare, size=100)
            worse = [(e / 2, t) for e, t in same]
            _, low, high = bench_script.interval(ours, same, wide)
            missed += not low <= 1 <= high
            condemned += bench_script.fails(bench_script.interval(ours, same, table))
            caught += bench_script.fails(bench_script.interval(ours, worse, table))
        expect(missed <= most * runs, "%d of %d intervals missed, rare %g" % (missed, runs, rare))
        expect(condemned <= 1, "%d of %d equal renderers condemned, rare %g" % (condemned, runs, rare))
        expect(caught >= (0.95 if rare == 0 else 0.2) * runs, "%d of %d caught, rare %g" % (caught, runs, rare))


@tests.add
def student_quantiles():
    """Student's t as tables have it"""
    for probability, degrees, value in ((0.975, 7, 2.3646), (0.975, 15, 2.1314), (0.9995, 15, 4.0728), (0.95, 1, 6.3138)):
        expect(abs(bench_script.student(probability, degrees) - value) < 2e-3, (probability, degrees))


@tests.add
def peers():
    """pbrt renders pbrt scenes and Cycles glTF; their ratios are against ours"""
    with Bench() as bench:
        bench.trees(dict(noise=0.1, cpu=1), dict(noise=0.1, cpu=1))
        put(bench.path("bin", "blender"), noise=0.2, cpu=2)
        put(bench.path("bin", "pbrt"), noise=0.1, cpu=0)
        result = bench.run("cornell-area", "window")
        expect(result.returncode == 0, result)
        expect(bench.row(result)[4:] == ["-"] * 2 + ["8.00 (8.00 to 8.00)"] * 2, result.stdout)
        expect(bench.row(result, "window")[6:] == ["-"] * 2 and bench.row(result, "window")[4] != "-", result.stdout)


@tests.add
def questions():
    """without a base, with one that is not built, with an unknown scene: one line, no traceback"""
    with Bench() as bench:
        bench.trees(dict(noise=0.1, cpu=1), dict(noise=0.1, cpu=1))
        names = bench.run("nonsense").stderr
        expect("scenes are cornell-area" in names and names.count(",") >= 11, names)
        os.remove(bench.path("base", "tests", "bench", "bench_render"))
        result = bench.run()
        expect("is not there: build it" in result.stderr and "Traceback" not in result.stderr, result)
        result = subprocess.run([sys.executable, "-B", SCRIPT], stderr=subprocess.PIPE, universal_newlines=True)
        expect("usage" in result.stderr and result.returncode != 0, result)


tests.run()
