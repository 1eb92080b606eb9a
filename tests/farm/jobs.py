"""Jobs for the tests of the whole farm: real scenes, comparisons to the bit, and jobs that take
long enough to be disturbed in mid-frame on any machine."""
import os
import re
import shutil
import signal
import subprocess
import time

from exr import read_exr
from farm import BIN, BUILD, ROOT, Failure, read_bytes, wait_for

# Sanitizer builds render about ten times slower: smaller pictures, the same tests.
SLOW = bool(os.environ.get("SANITIZE")) or bool(re.search("address|thread|undefined", BUILD))
MIRROR = os.path.join(ROOT, "scenes", "cornell", "cornell-mirror.gltf")
AREA = os.path.join(ROOT, "scenes", "cornell", "cornell-area.gltf")
SPHERES = os.path.join(ROOT, "scenes", "studio", "textured-spheres.gltf")


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def make_sky(farm):
    """A small sky with its sun, made by our generator once for all tests of this build; the path of a copy."""
    path = farm.path("sky.exr")
    if not os.path.exists(path):
        program, kept = os.path.join(BIN, "scenes", "sky", "make_sky"), os.path.join(BUILD, "tests", "sky.exr")
        if not os.path.exists(kept) or os.path.getmtime(kept) < os.path.getmtime(program):
            made = os.path.join(BUILD, "tests", "sky-%d.exr" % os.getpid())
            subprocess.run([program, "--size", "128x64", "-o", made], check=True, stdout=subprocess.DEVNULL)
            os.replace(made, kept)
        shutil.copyfile(kept, path)
    return path


class Outcome:
    """What a finished job gave: each frame's pixels and PNG, and what was counted."""

    def __init__(self, farm, number, name):
        self.job = farm.job(number)
        self.files = farm.fetch(number, name)
        self.exrs = sorted(f for f in self.files if f.endswith(".exr"))
        self.pngs = [read_bytes(f) for f in sorted(self.files) if f.endswith(".png")]
        pictures = [read_exr(f) for f in self.exrs]
        self.bits = [p.bits() for p in pictures]
        self.reproducible = [p.reproducible for p in pictures]
        self.measured = [p.measured() for p in pictures]
        self.means = [p.check() for p in pictures]
        self.black_tiles = [p.black_tiles() for p in pictures]
        expect(self.job["conflicts"] == 0, "conflicts: %s" % self.job)
        expect(self.job["frames_done"] == len(self.exrs) == len(self.pngs) > 0, self.job)

    def keep(self, folder):
        """Copies of the pictures that outlive the farm."""
        os.makedirs(folder, exist_ok=True)
        kept = []
        for number, path in enumerate(self.exrs):
            kept.append(os.path.join(folder, "%d.exr" % number))
            with open(kept[-1], "wb") as out:
                out.write(read_bytes(path))
        self.exrs = kept
        return self


def expect_same(farm, outcome, reference, what, counts=True):
    """The same bits: by `azulejo compare`, by the decoded pixels, and in all that derives from them."""
    expect(len(outcome.exrs) == len(reference.exrs), what)
    for mine, other in zip(outcome.exrs, reference.exrs):
        result = farm.cli("compare", mine, other)
        expect(result.code == 0, "%s: %s" % (what, result))
    expect(outcome.bits == reference.bits, what + ": the pixels' bytes differ")
    expect(outcome.reproducible == reference.reproducible,
           what + ": the EXR files differ in more than azulejo:measured")
    expect(outcome.pngs == reference.pngs, what + ": the PNGs differ")
    if len(outcome.exrs) == 1:  # of several frames it is the one that was written last
        mine, other = ({key: value for key, value in job["now"].items() if key not in ("core_seconds", "wall_seconds")}
                       for job in (outcome.job, reference.job))
        expect(mine == other, "%s: the error: %s, not %s" % (what, mine, other))
    if counts:
        for name in ("samples", "rays", "vertices", "health"):
            expect(outcome.job["work"][name] == reference.job["work"][name],
                   "%s: %s: %s, not %s" % (what, name, outcome.job["work"][name], reference.job["work"][name]))


class LongJob:
    """A job of about `seconds` of one core's work, measured once, so that there is a mid-frame to
    disturb on fast machines and an end on slow ones. All jobs made from it are the same job. A second
    will do: workers stand still while wait_mid_frame looks."""

    def __init__(self, seconds, size="193x121"):
        self.seconds, self.size, self.spp = seconds, size, None
        self.reference = None

    def options(self, farm, spp=None):
        return ["--env", make_sky(farm), "--size", self.size, "--spp", str(spp or self.spp)]

    def measure(self, farm):
        """With a worker connected: choose the samples a pixel."""
        number = farm.submit(MIRROR, *self.options(farm, 16))
        job = farm.wait_for_job(number)
        width, height = map(int, self.size.split("x"))
        cost = job["stats"]["cpu_ns"] / 1e9 / job["work"]["samples"]
        self.spp = max(64, int(self.seconds / cost / (width * height)) | 1)

    def submit(self, farm, *options):
        return farm.submit(MIRROR, *self.options(farm), *options)


def wait_slowly(farm, condition, what, limit_s=60.0, keep_stopped=()):
    """wait_for, but the workers work for 50 ms before each look and stand still otherwise: however late a look
    comes on a busy machine, they have not gone far. Those of keep_stopped stand still when it returns."""
    workers = [w for w in farm.workers if w.alive() and not w.stands_still()]

    def look():
        for worker in workers:
            worker.signal(signal.SIGCONT)
        time.sleep(0.05)
        for worker in workers:
            worker.signal(signal.SIGSTOP)
        return condition()
    try:
        return wait_for(look, what, limit_s)
    finally:
        for worker in workers:
            if worker not in keep_stopped:
                worker.signal(signal.SIGCONT)


def wait_mid_frame(farm, number, share=0.1):
    """Wait until the job is in work, and be sure that it is far from done."""
    def look():
        job = farm.job(number)
        return job if job["samples_done"] >= share * job["samples_total"] else None
    job = wait_slowly(farm, look, "job %d to get to %g %%" % (number, 100 * share))
    expect(job["state"] == "running" and job["samples_done"] < 0.85 * job["samples_total"],
           "too late to disturb it: %s" % job)
    return job


def worker_of(farm, program):
    """The coordinator's words about this worker; None: not connected."""
    for worker in farm.list_workers():
        if worker["process"] == program.pid:
            return worker
    return None
