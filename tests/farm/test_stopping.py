"""Stopping keeps the picture: Ctrl-C on a local render, cancel on a farm; and a killed render leaves nothing."""
import contextlib
import fcntl
import glob
import json
import os
import re
import signal
import sqlite3
import struct
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import PATIENCE, Farm, Tests, read_bytes, wait_for
from jobs import expect, wait_mid_frame
from png import Png

tests = Tests()
ENDLESS = ["--size", "129x97", "--spp", "1000000"]
# Where the passes of one group of samples end; a pixel has samples of two.
BOUNDARIES = [0, 2, 4, 8] + [k << e for e in range(9) for k in (16, 24)] + [8192]
SUMS = {a + b for a in BOUNDARIES for b in BOUNDARIES}


def check_picture(farm, path, spp):
    """Its header tells the truth, and where both groups of a pixel must have equally many samples it is what
    a whole render of so many gives."""
    picture = read_exr(path)
    counts = picture.values("samples.Y")
    pixels = picture.width * picture.height
    expect(picture.number("azulejo:spp") == spp, "spp")
    expect(picture.number("azulejo:complete") == 0, "complete")
    expect(picture.number("azulejo:samples") == sum(counts), "samples")
    expect(picture.number("azulejo:samplesMin") == min(counts), "least")
    expect(picture.number("azulejo:samplesMax") == max(counts), "most")
    expect(abs(picture.number("azulejo:samplesMean") - sum(counts) / pixels) < 1e-9, "mean")
    expect(max(counts) > 0, "no samples")
    colors = {c: struct.unpack("<%dI" % pixels, picture.channels[c]) for c in "RGB"}
    equal = even = 0
    for count in sorted(set(counts)):
        here = [i for i in range(pixels) if counts[i] == count]
        if count == 0:
            expect(all(colors[c][i] == 0 for c in "RGB" for i in here), "not black")
            continue
        expect(count in SUMS, "%g samples: no passes end there" % count)
        if count / 2 not in BOUNDARIES:
            continue  # one group has more than the other: no whole render has
        name = "whole-%d.exr" % count
        if not os.path.exists(farm.path(name)):
            farm.cli("render", farm.scene(), "--size", "129x97", "--spp", int(count), "-o", name, expect=0)
        whole = read_exr(farm.path(name))
        expect(whole.number("azulejo:complete") == 1, "a whole picture says that it is not")
        expect(whole.number("azulejo:samplesMin") == count, "whole: least")
        bits = {c: struct.unpack("<%dI" % pixels, whole.channels[c]) for c in "RGB"}
        equal += sum(all(bits[c][i] == colors[c][i] for c in "RGB") for i in here)
        even += len(here)
    # Groups may differ and add up to as many samples: 16 and 48 are two times 32. It is rare, but where only a few tiles
    # are even two of them may be such.
    expect(even - equal <= max(0.1 * even, 2 * 256), "%d of %d pixels are not what a whole render gives" % (even - equal, even))
    return picture


def stored_state(farm, number):
    """A job's state on disk, as the number in its row: what a crash leaves of it."""
    with contextlib.closing(sqlite3.connect(os.path.join(farm.store, "queue.sqlite"))) as store:
        return store.execute("SELECT state FROM jobs WHERE id = ?", (number,)).fetchone()[0]


def scratch_folders(folder):
    return glob.glob(os.path.join(folder, "azulejo-render-*"))


def has_samples(folder):
    """Tiles of a render in this TMPDIR are on disk."""
    films = glob.glob(os.path.join(folder, "azulejo-render-*", "films", "1", "*.film"))
    return bool(films) and os.path.getsize(films[0]) > 1 << 18


class Render:
    """An endless `azulejo render` in a TMPDIR of its own."""

    def __init__(self, farm, *options):
        self.temporary = farm.path("tmp")
        os.makedirs(self.temporary, exist_ok=True)
        self.client = farm.start_cli("render", farm.scene(), *ENDLESS, "--aov", "samples", *options,
                                     env={"TMPDIR": self.temporary})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.client.kill()
        self.client.wait()
        self.client.stdout.close()
        self.client.stderr.close()

    def wait_for_samples(self):
        wait_for(lambda: has_samples(self.temporary), "samples")

    def end(self):
        out, err = self.client.communicate(timeout=60 * PATIENCE)
        return self.client.returncode, out.decode(), err.decode()

    def pid_of(self, name):
        """The process number of its coordinator or worker; 0: it is not there."""
        for entry in os.listdir("/proc"):
            if entry.isdigit():
                try:
                    environment = read_bytes("/proc/%s/environ" % entry).decode("utf-8", "replace")
                    program = read_bytes("/proc/%s/cmdline" % entry).split(b"\0")[0].decode()
                except OSError:
                    continue
                if "TMPDIR=" + self.temporary in environment and os.path.basename(program) == name:
                    return int(entry)
        return 0


@tests.add
def interrupted_render():
    """Ctrl-C and SIGTERM: the picture is written with the samples that there are, and its header tells which"""
    with Farm() as farm:
        for number, code, options in ((signal.SIGINT, 130, []), (signal.SIGTERM, 143, ["--json"])):
            # Two threads: with many the groups of a pixel are often far apart.
            with Render(farm, "-o", "cut", "--manifest", "--threads", "2", *options) as render:
                render.wait_for_samples()
                render.client.send_signal(number)
                returned, out, err = render.end()
            expect(returned == code, (returned, out, err))
            expect(re.search(r"interrupted; frame 1 holds [0-9.]+ of 1000000 samples a pixel", err) and
                   "cut.exr" in err, err)
            expect(os.listdir(render.temporary) == [], os.listdir(render.temporary))
            picture = check_picture(farm, farm.path("cut.exr"), 1000000)
            png = Png(read_bytes(farm.path("cut.png")))
            expect((png.width, png.height) == (picture.width, picture.height), "PNG")
            with open(farm.path("cut.effects.json")) as source:
                told = json.load(source)["picture"]
            expect(told["complete"] is False and
                   told["samples_min"] == picture.number("azulejo:samplesMin") and
                   told["samples_max"] == picture.number("azulejo:samplesMax"), told)
            if options:
                cut, = json.loads(out)["job"]["cut_frames"]
                expect(cut["samples"] == picture.number("azulejo:samples") and
                       cut["tiles_empty"] == picture.number("azulejo:tilesWithoutSamples"), cut)
            os.unlink(farm.path("cut.exr"))


@tests.add
def interrupted_twice():
    """a second Ctrl-C ends a render at once, without a picture, and leaves nothing behind"""
    with Farm() as farm, Render(farm, "-o", "cut") as render:
        render.wait_for_samples()
        os.kill(render.pid_of("azulejo-coordinator"), signal.SIGSTOP)  # it cannot make the picture
        render.client.send_signal(signal.SIGINT)
        said = b""
        while b"Ctrl-C again" not in said:
            said += os.read(render.client.stderr.fileno(), 4096)
        render.client.send_signal(signal.SIGINT)
        code, out, err = render.end()
        expect(code == 130 and "abandoned" in err, (code, out, err))
        expect(not os.path.exists(farm.path("cut.exr")), "a picture")
        expect(os.listdir(render.temporary) == [], os.listdir(render.temporary))


def is_locked(folder):
    """whether a process holds the scratch folder or its store"""
    for name in ("owner", "lock"):
        path = os.path.join(folder, name)
        if not os.path.exists(path):  # killed before it had a store
            continue
        with open(path) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
    return False


@tests.add
def signals_again():
    """further signals do not cut off a coordinator's end: its temporary store is gone"""
    with Farm() as farm:
        for number in (signal.SIGTERM, signal.SIGINT):
            coordinator = farm.start_coordinator("--remove-store-at-end")
            farm.submit(farm.scene(), *ENDLESS)
            while coordinator.alive():
                os.kill(coordinator.pid, number)
                time.sleep(0.001)  # faster than it can take them they would hold it up for ever
            expect(coordinator.wait() == 0, "it ended by the signal")
            expect(not os.path.exists(farm.store), os.listdir(farm.path()))


@tests.add
def killed_render():
    """a render that is killed leaves no folder; what a killed coordinator leaves, the next render removes"""
    with Farm() as farm:
        with Render(farm, "-o", "cut") as render:
            render.wait_for_samples()
            expect(len(scratch_folders(render.temporary)) == 1, "no scratch folder")
            render.client.kill()
            wait_for(lambda: os.listdir(render.temporary) == [], "the folder to go")
        with Render(farm, "-o", "cut") as render, Render(farm, "-o", "other") as other:
            wait_for(lambda: len(scratch_folders(render.temporary)) == 2, "two folders")
            render.wait_for_samples()
            # The coordinators die first, so nobody removes the folders.
            for client in (render.client, other.client):
                client.send_signal(signal.SIGSTOP)
            for _ in range(2):
                victim = wait_for(lambda: render.pid_of("azulejo-coordinator"), "a coordinator")
                os.kill(victim, signal.SIGKILL)
                wait_for(lambda: render.pid_of("azulejo-coordinator") != victim, "its end")
            for client in (render.client, other.client):
                client.kill()
            wait_for(lambda: not render.pid_of("azulejo-worker"), "the workers' end")
        stale = set(scratch_folders(farm.path("tmp")))
        expect(len(stale) == 2, stale)
        # Linux takes a while to close the files of a process that was killed; nothing else may hold them.
        for folder in stale:
            wait_for(lambda: not is_locked(folder), "the locks to be free")
        # One whose owner lives stays, the stale ones go.
        with Render(farm, "-o", "cut") as render:
            wait_for(lambda: set(scratch_folders(render.temporary)) - stale, "its own folder")
            farm.cli("render", farm.scene(), "--size", "32x32", "--spp", "4", "-o", "small",
                     env={"TMPDIR": render.temporary}, expect=0)
            # Large files are removed by a process that nothing waits for.
            wait_for(lambda: not stale & set(scratch_folders(render.temporary)), "the stale folders to go")
            expect(len(scratch_folders(render.temporary)) == 1, scratch_folders(render.temporary))
            render.wait_for_samples()
            expect(render.client.poll() is None, "it was swept away")


@tests.add
def cancelled_job():
    """a cancelled job's picture is made of what is rendered and can be fetched, also over a crash"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        for crash in (False, True):
            number = farm.submit(farm.scene(), "--size", "129x97", "--spp", "4000", "--aov", "samples",
                                 "--frames", "1-9", "-o", "job")
            wait_for(lambda: farm.job(number)["samples_done"] > 129 * 97 * 40, "samples")
            if crash:
                client = farm.start_cli("cancel", number)
                wait_for(lambda: stored_state(farm, number) == cancelled, "the store to hold the cancel")
                farm.coordinator.kill()
                client.communicate(timeout=60 * PATIENCE)
                farm.restart_coordinator()
            else:
                said = farm.cli("cancel", number, expect=0).out
                expect("cancelled" in said and "samples a pixel" in said and "fetch" in said, said)
            job = farm.wait_for_job(number, "cancelled")
            cancelled = stored_state(farm, number)
            expect(len(job["cut_frames"]) >= 1, job)
            expect(job["samples_done"] == sum(c["samples"] for c in job["cut_frames"]) +
                   (job["frames_done"] - len(job["cut_frames"])) * 129 * 97 * 4000, job)
            expect("cut short" in farm.cli("show", number, expect=0).out, "show")
            farm.cli("fetch", number, "-o", "out-%d" % number, "--manifest")
            for cut in job["cut_frames"]:
                base = farm.path("out-%d" % number, "job-%04d" % cut["frame"])
                picture = check_picture(farm, base + ".exr", 4000)
                expect(picture.number("azulejo:samples") == cut["samples"], cut)
                Png(read_bytes(base + ".png"))
            films = os.path.join(farm.store, "films", str(number))
            expect(os.path.exists(films), "retry has no films")
            farm.cli("cancel", number, "--discard", expect=0)
            expect(not os.path.exists(films), "films are left")


@tests.add
def discarded_job():
    """cancel --discard makes no picture"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *ENDLESS)
        wait_mid_frame(farm, number, 1e-5)
        expect("cancelled" in farm.cli("cancel", number, "--discard", expect=0).out, "cancel")
        job = farm.job(number)
        expect(job["frames_done"] == 0 and job["cut_frames"] == [] and "discard" in job["state_text"], job)
        result = farm.cli("fetch", number)
        expect(result.code == 5 and "is cancelled and has no picture" in result.err, result)
        expect("preview" not in result.err, "there is no frame in work: %s" % result)


@tests.add
def limits_far_too_short():
    """limits of a millisecond, alone and beside each other rule, at any size: each tile has samples, and the limit is named"""
    sizes = (["--size", "16x16"], ["--size", "17x33"], ["--size", "640x400"], ["--size", "320x200", "--region", "17,5,200,150"])
    limits = {"time": ["--time-limit", "0.001s"], "cores": ["--core-limit", "0.001s"], "rays": ["--max-rays", "1"]}
    others = ([], ["--target-error", "1/255"], ["--allocation", "adaptive"], ["--allocation", "uniform"], ["--frames", "1-3"])
    with Farm() as farm:
        farm.start_coordinator()
        for _ in range(2):
            farm.start_worker(rests=False)
        jobs = {}
        for size in sizes:
            for end, limit in limits.items():
                for other in others if size is sizes[-1] else [[]]:
                    jobs[farm.submit(farm.scene(), "--spp", "1000000", *size, *limit, *other)] = (end, size, other)
            jobs[farm.submit(farm.scene(), "--spp", "1000000", *size, *limits["time"], *limits["cores"])] = ("time cores", size, "both")
        for number, (end, size, other) in jobs.items():
            farm.wait_for_job(number)
            for cut in farm.job(number)["cut_frames"]:
                expect(cut["tiles_empty"] == 0 and cut["samples_min"] > 0, (size, other, cut))
                expect(cut["end"] in end.split(), (size, other, end, cut))
            expect(len(farm.job(number)["cut_frames"]) == (3 if "--frames" in other else 1), (size, other, farm.job(number)))
            for path in farm.fetch(number, "out-%d" % number):
                if path.endswith(".exr"):
                    picture = read_exr(path)
                    expect(picture.number("azulejo:samplesMin") > 0 and picture.number("azulejo:tilesWithoutSamples") == 0,
                           (size, end, other))


if __name__ == "__main__":
    tests.run()
