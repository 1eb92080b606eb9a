#!/usr/bin/python3
"""Compare the tone mapping operators with other implementations of them.

    tests/peers/compare_tonemap.py [PICTURE.exr]

Needs a built tree (`make all tests`) and numpy (Debian 12: apt-get install python3-numpy). The
others are pfstools (apt-get install pfstools) and OpenColorIO (apt-get install
python3-pyopencolorio); what is missing is named and skipped. Without a picture it renders
scenes/features/portal.pbrt under a sky: a dim room, the sun on its floor, the sky in its window.

For each operator with the same parameters on both sides: how far the two pictures are apart in
display codes 0..255, before rounding, as PSNR, largest difference, and share of channels that are
within one code. Then experiments on what is behind the differences. Then the time of both on one
processor, in turns, medians: of the operator alone, and from the EXR file to a PNG file.

A tool for people, not part of `make test`. From the environment: BUILD, the build tree; SIZE
(960x640) and SPP (32) of the picture that it renders; ROUNDS (5) of timing, 0 for none;
KEEP=FOLDER, keep the pictures there.
"""
import contextlib
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

try:
    import numpy
except ImportError:
    sys.exit("numpy is missing: apt-get install python3-numpy, and run this with /usr/bin/python3")

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests", "farm"))
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(ROOT, "tests", "peers"))
import exr
import mantiuk06

BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
AZULEJO = os.path.join(BUILD, "bin", "azulejo")
BENCH = os.path.join(BUILD, "tests", "bench", "bench_tonemap")
ROUNDS = int(os.environ.get("ROUNDS", "5"))
WEIGHTS = numpy.array([0.212656, 0.715158, 0.072186])
THEIR_RATIO = 43 ** (1 / 8)  # of pfstools' scales of reinhard02
PAPERS_MAXIMUM = ["--percentile", "100"]
NO_WHITE = ["--white", "1e9"]  # the paper's local operator has no white point

# name, our options, pfstools' command, does it give codes instead of light?
CASES = [
    ("reinhard02, global, white 0", ["reinhard02", "--white", "0"], ["pfstmo_reinhard02"], False),
    ("reinhard02, local", ["reinhard02", "--scale", "local"] + NO_WHITE,
     ["pfstmo_reinhard02", "--scales", "--phi", "8"], False),
    ("drago03, percentile 100", ["drago03"] + PAPERS_MAXIMUM, ["pfstmo_drago03"], False),
    ("drago03, percentile 100, bias 0.75", ["drago03", "--bias", "0.75"] + PAPERS_MAXIMUM, ["pfstmo_drago03", "-b", "0.75"], False),
    ("mantiuk06, mapping 0.3", ["mantiuk06", "--contrast", "0.3", "--detail", "1"],
     ["pfstmo_mantiuk06", "-f", "0.3"], False),
    ("mantiuk06, equalize 0.5",
     ["mantiuk06", "--mode", "equalize", "--contrast", "0.5", "--detail", "1"],
     ["pfstmo_mantiuk06", "-e", "0.5"], False),
    ("mantiuk08, lcd", ["mantiuk08"], ["pfstmo_mantiuk08"], True),
    ("mantiuk08, lcd_office", ["mantiuk08", "--display", "lcd_office"],
     ["pfstmo_mantiuk08", "-d", "pd=lcd_office"], True),
    ("mantiuk08, lcd_bright", ["mantiuk08", "--display", "lcd_bright"],
     ["pfstmo_mantiuk08", "-d", "pd=lcd_bright"], True),
    ("mantiuk08, crt", ["mantiuk08", "--display", "crt"], ["pfstmo_mantiuk08", "-d", "pd=crt"],
     True),
    ("mantiuk08, contrast 1.15", ["mantiuk08", "--contrast", "1.15"],
     ["pfstmo_mantiuk08", "-e", "1.15"], True),
    ("mantiuk08, saturation 1.5", ["mantiuk08", "--saturation", "1.5"],
     ["pfstmo_mantiuk08", "-c", "1.5"], True),
    ("mantiuk08, white 5", ["mantiuk08", "--white", "5"], ["pfstmo_mantiuk08", "-y", "5"], True),
]
TIMED = ["reinhard02, global, white 0", "reinhard02, local", "drago03, percentile 100", "mantiuk06, mapping 0.3",
         "mantiuk08, lcd"]


# ---- pictures: numpy arrays, height x width x 3 ------------------------------------------------

def unpredict(data):
    """exr.py's, but faster."""
    steps = numpy.frombuffer(data, numpy.uint8).copy()
    steps[1:] -= 128
    summed = numpy.cumsum(steps, dtype=numpy.uint8)
    out, half = numpy.empty_like(summed), (len(summed) + 1) // 2
    out[0::2], out[1::2] = summed[:half], summed[half:]
    return out.tobytes()


exr.unpredict = unpredict


def read_exr(path):
    picture = exr.read_exr(path)
    kinds = {1: "<f2", 2: "<f4"}
    return numpy.stack(
        [numpy.frombuffer(picture.channels[c], kinds[picture.kinds[c]]).reshape(
            picture.height, picture.width) for c in "RGB"], axis=2).astype(numpy.float64)


def read_pfm(data):
    kind, size, scale, body = data.split(b"\n", 3)
    width, height = map(int, size.split())
    if kind != b"PF" or float(scale) >= 0:
        raise ValueError("no little-endian PFM in colour")
    rows = numpy.frombuffer(body, "<f4", width * height * 3).reshape(height, width, 3)
    return rows[::-1].astype(numpy.float64)


def write_pfm(path, picture):
    with open(path, "wb") as out:
        out.write(b"PF\n%d %d\n-1.0\n" % (picture.shape[1], picture.shape[0]))
        out.write(picture[::-1].astype("<f4").tobytes())


def srgb(light):
    light = numpy.clip(light, 0, 1)
    return numpy.where(light <= 0.0031308, 12.92 * light,
                       1.055 * numpy.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def luminance(picture):
    return picture @ WEIGHTS


def around(values):
    """The sums of the 9x9 values around each, as far as there are some."""
    for axis in 0, 1:
        padded = numpy.pad(values, [(4, 4) if k == axis else (0, 0) for k in (0, 1)])
        values = sum(numpy.take(padded, range(k, k + values.shape[axis]), axis) for k in range(9))
    return values


def stops_to_pixels(light):
    """Our log-mean is that of windows (common/tonemap/statistics.c), the papers' is of single pixels: in stops."""
    y = numpy.ascontiguousarray(luminance(light), numpy.float64)
    lit = y > 0
    logs = numpy.where(lit, y.view(numpy.uint64) >> 40, 0).astype(numpy.int64)  # rough ones, in steps of 2^-12
    most = around(logs) // numpy.maximum(around(lit.astype(numpy.int64)), 1) + (6 << 12)
    limited = numpy.minimum(y, (most.astype(numpy.uint64) << 40).view(numpy.float64))
    means = around(limited) / around(numpy.ones_like(y))
    return (numpy.log(means[lit]).mean() - numpy.log(y[lit]).mean()) / numpy.log(2)


def distance(ours, theirs):
    """Of two pictures of codes 0..1. What pfstools makes no number of does not count."""
    off = 255 * numpy.abs(numpy.clip(ours, 0, 1) - numpy.clip(theirs, 0, 1))
    missing = numpy.isnan(off).any(axis=2).sum()
    off = off[~numpy.isnan(off)]
    error = (off ** 2).mean()
    psnr = 10 * numpy.log10(255 ** 2 / error) if error > 0 else numpy.inf
    return "%8.1f dB %7.2f %8.2f %%%s" % (
        psnr, off.max(), 100 * (off <= 1).mean(),
        "  (%d pixels are not a number)" % missing if missing else "")


# ---- who does it -------------------------------------------------------------------------------

class Work:
    """A picture: as a file, as an array of light, and as pfstools read it."""

    def __init__(self, folder, picture, light, pfs):
        self.folder, self.picture, self.light, self.pfs = folder, picture, light, pfs

    def path(self, name):
        return os.path.join(self.folder, name)

    def ours(self, options):
        out = self.path("ours.exr")
        stops = stops_to_pixels(self.light) if options[0] in ("reinhard02", "drago03") else 0
        if "--exposure" in options:
            stops += float(options[options.index("--exposure") + 1])
        subprocess.run([AZULEJO, "tonemap", self.picture, "-o", out, "--operator"] + options +
                       ["--exposure", str(stops)], check=True)
        return srgb(read_exr(out))

    def theirs(self, command, encoded, source=None):
        with open(source or self.pfs, "rb") as stream:
            mapped = subprocess.run(command, stdin=stream, check=True, stdout=subprocess.PIPE,
                                    stderr=subprocess.DEVNULL).stdout
        out = self.path("theirs.pfm")
        subprocess.run(["pfsoutpfm", out], input=mapped, check=True, stderr=subprocess.DEVNULL)
        with open(out, "rb") as result:
            light = read_pfm(result.read())
        return light if encoded else srgb(light)

    def to_pfs(self, picture, name):
        pfs = self.path(name + ".pfs")
        write_pfm(self.path(name + ".pfm"), picture)
        with open(pfs, "wb") as stream:
            # The name goes along in the pfs file, and one of 28 to 30 characters ends mantiuk08.
            subprocess.run(["pfsinpfm", name + ".pfm"], cwd=self.folder, stdout=stream, check=True)
        return pfs

    def variant(self, picture, name):
        """Another picture, the same for both sides: as a Radiance HDR can hold it."""
        hdr, pfm, pfs = (self.path(name + end) for end in (".hdr", ".pfm", ".pfs"))
        with open(self.to_pfs(picture, name), "rb") as stream:
            subprocess.run(["pfsout", hdr], stdin=stream, check=True)
        with open(pfs, "wb") as stream:
            subprocess.run(["pfsin", name + ".hdr"], cwd=self.folder, stdout=stream, check=True)
        with open(pfs, "rb") as stream:
            subprocess.run(["pfsoutpfm", pfm], stdin=stream, check=True)
        with open(pfm, "rb") as result:
            return Work(self.folder, hdr, read_pfm(result.read()), pfs)

    def complaint(self, command):
        with open(self.pfs, "rb") as stream:
            said = subprocess.run(command, stdin=stream, stdout=subprocess.DEVNULL,
                                  stderr=subprocess.PIPE).stderr.decode()
        return "; ".join(line.split("Warning: ")[-1] for line in said.replace("\r", "\n").split("\n")
                         if "Not converged" in line)


def aces_by_ocio():
    """A function from light to sRGB codes, or None."""
    try:
        import PyOpenColorIO as ocio
    except ImportError:
        print("OpenColorIO is missing, aces is not compared: apt-get install python3-pyopencolorio")
        return None
    # linear Rec. 709 to ACES2065-1, by Bradford
    matrix = numpy.eye(4)
    matrix[:3, :3] = rec709_to_aces()
    transform = ocio.GroupTransform([
        ocio.MatrixTransform(matrix=matrix.flatten().tolist()),
        ocio.BuiltinTransform(style="ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0"),
        ocio.BuiltinTransform(style="DISPLAY - CIE-XYZ-D65_to_sRGB")])
    config = ocio.Config.CreateRaw()
    print("OpenColorIO %s" % ocio.__version__)

    def apply(light, exact):
        level = ocio.OPTIMIZATION_LOSSLESS if exact else ocio.OPTIMIZATION_DEFAULT
        processor = config.getProcessor(transform).getOptimizedCPUProcessor(level)
        pixels = numpy.ascontiguousarray(light, numpy.float32).reshape(-1, 3).copy()
        processor.applyRGB(pixels)
        return pixels.reshape(light.shape).astype(numpy.float64)
    return apply


def rec709_to_aces():
    def to_xyz(primaries, white):
        columns = numpy.array([[x / y, 1, (1 - x - y) / y] for x, y in primaries]).T
        point = numpy.array([white[0] / white[1], 1, (1 - sum(white)) / white[1]])
        return columns * numpy.linalg.solve(columns, point), point

    bradford = numpy.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367],
                            [0.0389, -0.0685, 1.0296]])
    rec709, d65 = to_xyz([(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)], (0.3127, 0.3290))
    aces, white = to_xyz([(0.7347, 0.2653), (0, 1), (0.0001, -0.0770)], (0.32168, 0.33767))
    adapt = numpy.linalg.inv(bradford) @ numpy.diag(
        (bradford @ white) / (bradford @ d65)) @ bradford
    return numpy.linalg.inv(aces) @ adapt @ rec709


# ---- what is behind the differences ------------------------------------------------------------

def blur(plane, s):
    """By exp(-r^2 / (alpha s)^2), with the picture mirrored at its borders."""
    margin = int(4 * 0.35355339 * s) + 1
    padded = numpy.pad(plane, margin, mode="symmetric")
    kernel = numpy.exp(-(numpy.arange(-margin, margin + 1) / (0.35355339 * s)) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        padded = sum(w * numpy.roll(padded, i - margin, axis=axis) for i, w in enumerate(kernel))
    return padded[margin:-margin, margin:-margin]


def dodge_and_burn(scaled, planes, last_that_passes, ratio=1.6):
    """reinhard02's local operator as factors of the light, given V1 at all scales."""
    chosen, growing = planes[0], numpy.ones(scaled.shape, bool)
    for i in range(8):
        sharp = 2 ** 8 * 0.18 / ratio ** (2 * i)
        quiet = abs(planes[i] - planes[i + 1]) <= 0.05 * (sharp + planes[i])
        chosen = numpy.where(growing & (quiet | (not last_that_passes)), planes[i], chosen)
        growing &= quiet
    return 1 / (1 + chosen)


def planes_of_pfstools(work, scaled):
    """Its V1 at all scales: with a huge phi no scale is too sharp, so the last of --range is taken.
    The first is the picture itself."""
    planes = [scaled]
    for count in range(2, 10):
        light = work.theirs(["pfstmo_reinhard02", "--scales", "--phi", "60", "--range", str(count)],
                            True)
        planes.append(scaled / luminance(light) - 1)
    return planes


def show(text, *pictures):
    print("  %-66s%s" % (text, distance(*pictures)), flush=True)


def experiment_reinhard(work):
    ours = work.ours(["reinhard02", "--scale", "local"] + NO_WHITE)
    theirs = work.theirs(["pfstmo_reinhard02", "--scales", "--phi", "8"], False)
    preset = work.theirs(["pfstmo_reinhard02", "--scales"], False)
    y = luminance(work.light)
    scale = 0.18 / numpy.exp(numpy.log(1e-5 + y).mean())
    planes = planes_of_pfstools(work, scale * y)
    gauss = [blur(scale * y, 1.6 ** i) for i in range(9)]

    def by(blurred, last, ratio=1.6):
        factors = scale * dodge_and_burn(scale * y, blurred, last, ratio)
        return srgb(work.light * factors[..., None])
    print("reinhard02, local: the paper in Python, with V1 and the scale taken as ...")
    show("ours | Gaussians, the last scale that passes", ours, by(gauss, True))
    show("pfstools | the same", theirs, by(gauss, True))
    show("pfstools | Gaussians, the first scale that fails", theirs, by(gauss, False))
    show("pfstools | its own V1, the last scale that passes", theirs, by(planes, True, THEIR_RATIO))
    show("pfstools | its own V1, the first scale that fails", theirs, by(planes, False, THEIR_RATIO))
    show("ours against pfstools with its preset phi of 1", ours, preset)
    flat = work.variant(numpy.ones_like(work.light), "flat")
    print("  V1 of a constant picture at the eight larger scales, over the constant:")
    for plane in planes_of_pfstools(flat, numpy.full(y.shape, 0.18))[1:]:
        print("    pfstools %.3f to %.3f" % (plane.min() / 0.18, plane.max() / 0.18))


def experiment_reinhard_black(work):
    """The lower half black: pfstools counts it in the log-mean."""
    half = work.light.copy()
    half[half.shape[0] // 2:] = 0
    pfs = work.to_pfs(half, "half")
    top = slice(0, half.shape[0] // 2)
    print("reinhard02, global, with the lower half of the picture black (upper half compared)")
    y = luminance(half)
    counted = y > 0
    mean = numpy.exp(numpy.log(y[counted]).mean())
    with_black = numpy.exp(numpy.log(1e-5 + y).mean())
    print("  log-mean of what is lit: %.4g; with 1e-5 added to every pixel, as pfstools: %.4g" % (
        mean, with_black))

    def by_paper(log_mean):
        scaled = 0.18 * y / log_mean
        factor = 0.18 / log_mean * (1 + scaled / scaled.max() ** 2) / (1 + scaled)
        return srgb(half * factor[..., None])[top]
    theirs = work.theirs(["pfstmo_reinhard02"], False, pfs)[top]
    show("pfstools against the formula with the log-mean of what is lit", theirs, by_paper(mean))
    show("pfstools against the formula with its own log-mean", theirs, by_paper(with_black))


def experiment_drago(work):
    bias = 0.75
    stops = str(-5 * numpy.log2(1 + bias - 0.85))
    print("drago03, bias 0.75")
    show("ours with the paper's (1 + bias - 0.85)^5 taken back by --exposure",
         work.ours(["drago03", "--bias", str(bias), "--exposure", stops] + PAPERS_MAXIMUM),
         work.theirs(["pfstmo_drago03", "-b", str(bias)], False))


def coarse_share(ours, theirs):
    """How much of the squared difference is already there between the means of large blocks."""
    off = numpy.clip(ours, 0, 1) - numpy.clip(theirs, 0, 1)
    side = max(1, off.shape[1] // 32)
    off = off[:off.shape[0] // side * side, :off.shape[1] // side * side]
    means = off.reshape(off.shape[0] // side, side, off.shape[1] // side, side, 3).mean(axis=(1, 3))
    return (means ** 2).mean() / (off ** 2).mean()


def mantiuk06_shown(light, plane):
    """Codes of a plane after contrast processing: percentiles to 2.3 decades, saturation 0.8."""
    low, high = numpy.percentile(plane, [0.1, 99.9])
    y = luminance(light)[..., None]
    return srgb((light / y) ** 0.8 * 10 ** (2.3 * (plane - high) / (high - low))[..., None])


def experiment_mantiuk06(work):
    options = ["mantiuk06", "--contrast", "0.3", "--detail", "1"]
    command, solved = ["pfstmo_mantiuk06", "-f", "0.3"], ["--bcg", "--tol", "1e-4", "--itmax", "500"]
    ours, theirs = work.ours(options), work.theirs(command, False)
    print("mantiuk06, mapping 0.3")
    print("  pfstools says: %s" % (work.complaint(command) or "nothing"))
    show("pfstools, its other solver, to the end (%s)" % " ".join(solved), ours,
         work.theirs(command + solved, False))
    print("  of the squared difference %.0f %% lie between the means of 32 blocks across" % (
        100 * coarse_share(ours, theirs)))
    raised = numpy.maximum(work.light, 1e-7 * luminance(work.light).max())
    if (raised != work.light).any():
        lifted = work.variant(raised, "raised")
        show("the same, the picture raised to 1e-7 of its maximum, as pfstools does",
             lifted.ours(options), lifted.theirs(command + solved, False))
    paper = mantiuk06.Contrasts(numpy.log10(luminance(raised)))
    responses = paper.responses()
    by_paper = mantiuk06_shown(raised, paper.solve(paper.wanted([0.3 * r for r in responses])))
    show("ours | the paper in Python", ours, by_paper)
    show("pfstools, to the end | the paper in Python", work.theirs(command + solved, False), by_paper)
    firefly = work.light.copy()
    firefly[firefly.shape[0] // 2, firefly.shape[1] // 2] = 1e30
    lost = work.theirs(command, False, work.to_pfs(firefly, "firefly"))
    print("  with one pixel of 1e30, pfstools' codes have a deviation of %.1f (without: %.1f)" % (
        255 * numpy.std(numpy.nan_to_num(lost)), 255 * numpy.std(theirs)))
    print("mantiuk06, equalize")
    for factor in ("0.1", "0.5", "1"):
        ours = work.ours(["mantiuk06", "--mode", "equalize", "--contrast", factor, "--detail", "1"])
        theirs = work.theirs(["pfstmo_mantiuk06", "-e", factor] + solved, False)
        planes = [paper.solve(paper.wanted(mantiuk06.equalized(responses, float(factor), full)))
                  for full in (False, True)]
        show("factor %s: ours | the paper in Python" % factor, ours,
             mantiuk06_shown(raised, planes[0]))
        show("pfstools, to the end | the same", theirs, mantiuk06_shown(raised, planes[0]))
        show("pfstools, to the end | ..., the full response in last corners", theirs,
             mantiuk06_shown(raised, planes[1]))


def mantiuk08_by_curve(work, curve, forward):
    """mantiuk08 of a given curve, with the slope for colours taken towards the next node, or
    between the nodes at both sides."""
    x, y = curve[:, 1], curve[:, 2]
    rise = numpy.diff(y) / numpy.diff(x)
    after, before = numpy.append(rise, 0), numpy.insert(rise, 0, 0)
    power = numpy.maximum(after if forward else (after + before) / 2, 0) ** 0.82
    light = numpy.maximum(luminance(work.light), 1e-8)
    place = numpy.log10(light)
    exponent = numpy.interp(place, x, 2.48 * power / (1 + 1.48 * power))
    shown = (work.light / light[..., None]) ** exponent[..., None] * (
        10 ** numpy.interp(place, x, y))[..., None]
    black = 0.8 + 0.01 / numpy.pi * 60
    return numpy.clip((shown - black) / (200 - 0.8), 0, 1) ** (1 / 2.2)


def experiment_mantiuk08(work):
    ours, theirs = work.ours(["mantiuk08"]), work.theirs(["pfstmo_mantiuk08"], True)
    print("mantiuk08, lcd")
    grey = work.variant(numpy.repeat(luminance(work.light)[..., None], 3, axis=2), "grey")
    show("the picture in grey: the curves alone", grey.ours(["mantiuk08"]),
         grey.theirs(["pfstmo_mantiuk08"], True))
    table = work.path("curve.csv")
    work.theirs(["pfstmo_mantiuk08", "-o", table], True)
    curve = numpy.loadtxt(table, delimiter=",")
    show("pfstools | its curve, the colours' slope towards the next node", theirs,
         mantiuk08_by_curve(work, curve, True))
    show("ours | pfstools' curve, the slope between both neighbours", ours,
         mantiuk08_by_curve(work, curve, False))
    print("  pfstools' codes above 1, cut off here: %.2f %% of the channels, the largest %.4f" % (
        100 * (theirs > 1).mean(), theirs.max()))
    no_vision = ["--visual-model", "none"]
    show("without the visual model", work.ours(["mantiuk08"] + no_vision),
         work.theirs(["pfstmo_mantiuk08"] + no_vision, True))
    candela = work.variant(1e4 * work.light, "candela")
    show("the eye adapts to what it looks at, picture in cd/m2 (times 10000)",
         candela.ours(["mantiuk08", "--adaptation", "auto"]),
         candela.theirs(["pfstmo_mantiuk08", "--scene-y-adapt", "auto"], True))


# ---- time --------------------------------------------------------------------------------------

def timed(argv, stdin=None):
    """Seconds by the clock and of all processors."""
    def used():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime
    with contextlib.ExitStack() as stack:
        source = stack.enter_context(open(stdin, "rb")) if stdin else subprocess.DEVNULL
        before, start = used(), time.monotonic()
        subprocess.run(argv, stdin=source, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                       check=True)
        return time.monotonic() - start, used() - before


def bench(work, options):
    argv = [BENCH, "--picture", work.picture, "--threads", "1", "--rounds", "1", "--operator",
            options[0]]
    for name, value in zip(options[1::2], options[2::2]):
        argv += ["--param", name[2:] + "=" + value]
    run = json.loads(subprocess.run(argv, check=True, stdout=subprocess.PIPE).stdout)
    return run["wall_s"], run["cpu_s"]


def medians(runs):
    return [statistics.median(column) for column in zip(*runs)]


def show_time(work, aces):
    height, width, _ = work.light.shape
    pixels = width * height * 1e-6
    print("\nSeconds at %dx%d (%.2f megapixels), %d rounds in turns, medians; load average %.1f" % (
        width, height, pixels, ROUNDS, os.getloadavg()[0]))
    print("%-25s%30s%34s" % ("", "the operator alone, CPU-s", "EXR file to PNG file, wall (CPU)"))
    print("%-25s%9s%12s%9s%17s%17s" % ("", "ours", "theirs", "ratio", "ours", "theirs"))
    for name, options, command, encoded in CASES:
        if name not in TIMED or not shutil.which(command[0]):
            continue
        runs = []
        whole = "pfsin '%s' | %s %s | pfsout '%s'" % (
            work.picture, " ".join(command), "" if encoded else "| pfsgamma -g 2.2",
            work.path("theirs.png"))
        for _ in range(ROUNDS):
            alone = bench(work, options)
            theirs = timed(command, work.pfs)
            pipe = timed(["pfstag", "--set", "a=b"], work.pfs)
            ours_whole = timed([AZULEJO, "tonemap", work.picture, "-j", "1", "-o",
                                work.path("ours.png"), "--operator"] + options)
            runs.append(alone + (theirs[1] - pipe[1],) + ours_whole + timed(["sh", "-c", whole]))
        _, cpu, theirs, wall, all_cpu, their_wall, their_cpu = medians(runs)
        print("%-25s%9.3f%12.3f%9.2f%10.2f (%4.2f)%10.2f (%4.2f)" % (
            name, cpu, theirs, cpu / theirs, wall, all_cpu, their_wall, their_cpu), flush=True)
    if aces:
        runs = []
        for _ in range(ROUNDS):
            start = time.process_time()
            aces(work.light, False)
            runs.append((time.process_time() - start, bench(work, ["aces"])[1]))
        theirs, cpu = medians(runs)
        print("%-25s%9.3f%12.3f%9.2f   (OpenColorIO with its default optimisations)" % (
            "aces", cpu, theirs, cpu / theirs))
    print("Ours alone: the whole development to sRGB codes. Theirs alone: pfstmo_* from a pfs file to "
          "nowhere, less pfstag,\nwhich only copies it; without the sRGB curve, but for mantiuk08.")


# ---- all of it ---------------------------------------------------------------------------------

def render(folder):
    sky, out = os.path.join(folder, "sky.exr"), os.path.join(folder, "picture.exr")
    subprocess.run([os.path.join(BUILD, "bin", "scenes", "sky", "make_sky"), "--sun-elevation",
                    "25", "--sun-azimuth", "170", "-o", sky], check=True, stdout=subprocess.DEVNULL)
    subprocess.run([AZULEJO, "render", os.path.join(ROOT, "scenes/features/portal.pbrt"), "--env",
                    sky, "--size", os.environ.get("SIZE", "960x640"), "--spp",
                    os.environ.get("SPP", "32"), "--quiet", "-o", out], check=True)
    return out


def compare(folder, picture):
    source = picture or render(folder)
    work = Work(folder, source, read_exr(source), os.path.join(folder, "picture.pfs"))
    y = luminance(work.light)
    print("%s, %dx%d, luminance from %.3g to %.3g, %.2f %% black" % (
        picture or "scenes/features/portal.pbrt under a sky", y.shape[1], y.shape[0],
        y[y > 0].min(initial=numpy.inf), y.max(), 100 * (y <= 0).mean()))
    pfstools = all(map(shutil.which, ("pfsin", "pfsinpfm", "pfsoutpfm", "pfstag", "pfsout")))
    if pfstools:
        version = subprocess.run(["pfstmo_reinhard02", "--help"], stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT).stdout.split(b"(")[1].split(b")")[0]
        print(version.decode())
        work.to_pfs(work.light, "picture")
    else:
        print("pfstools is missing, only aces is compared: apt-get install pfstools")
    aces = aces_by_ocio()
    print("\n%-26s%11s %7s %10s" % ("codes 0..255", "PSNR", "most", "within 1"))
    for name, options, command, encoded in CASES:
        if not pfstools:
            break
        if not shutil.which(command[0]):
            print("%-24s%s is missing: skipped" % (name, command[0]))
            continue
        print("%-24s%s" % (name, distance(work.ours(options), work.theirs(command, encoded))),
              flush=True)
    if aces:
        reference = aces(work.light, True)
        print("%-24s%s" % ("aces", distance(work.ours(["aces"]), reference)))
        print("%-24s%s" % ("aces-hill (the fit)", distance(work.ours(["aces-hill"]), reference)))
    if pfstools:
        print("\n%-68s%11s %7s %10s" % ("Experiments", "PSNR", "most", "within 1"))
        for experiment in (experiment_reinhard, experiment_reinhard_black, experiment_drago,
                           experiment_mantiuk06, experiment_mantiuk08):
            experiment(work)
    if ROUNDS > 0 and (pfstools or aces):
        show_time(work, aces)


def main():
    if len(sys.argv) > 2 or sys.argv[1:2] in (["-h"], ["--help"]):
        print(__doc__.strip())
        return
    for program in (AZULEJO, BENCH):
        if not os.path.exists(program):
            sys.exit("%s is not built: make all tests" % program)
    keep = os.environ.get("KEEP")
    if keep:
        os.makedirs(keep, exist_ok=True)
        compare(keep, *(sys.argv[1:] or [None]))
        return
    with tempfile.TemporaryDirectory(prefix="azulejo-tonemap-") as folder:
        compare(folder, *(sys.argv[1:] or [None]))


main()
