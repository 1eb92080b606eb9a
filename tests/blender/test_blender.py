#!/usr/bin/env python3
"""The add-on in a real Blender without a window: `make test-blender`. Skipped by name where no Blender is installed."""
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(os.path.dirname(HERE), "farm"))
from exr import read_exr  # noqa: E402
from farm import BIN, PATIENCE, ROOT, Failure, Farm, Skip, Tests, wait_for  # noqa: E402
from jobs import expect  # noqa: E402

AZULEJO = os.path.join(BIN, "azulejo")
LIMIT_S = 200
tests = Tests()


class Run:
    """One Blender that renders a case of inside.py."""

    def __init__(self, farm, case, program=AZULEJO, **options):
        blender = shutil.which(os.environ.get("BLENDER", "blender"))
        if not blender:
            raise Skip("no Blender here: apt-get install blender python3-numpy")
        self.folder = farm.path("%s-%d" % (case, len(os.listdir(farm.folder))))
        os.mkdir(self.folder)
        self.log = os.path.join(self.folder, "log")
        words = [blender, "-b", "-t", "1", "--factory-startup", "--python-exit-code", "3", "-P", os.path.join(HERE, "inside.py"),
                 "--", case, self.folder, program] + ["%s=%s" % row for row in options.items()]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("AZULEJO_")}
        # A folder of settings of its own: nothing of this machine's user is read or written.
        # Debian's Blender takes the Python that PATH has first for its own, so that must be the system's.
        environment.update(BLENDER_USER_RESOURCES=os.path.join(self.folder, "user"), TMPDIR=self.folder,
                           PATH="/usr/local/bin:/usr/bin:/bin")
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment,
                                            start_new_session=True)

    def text(self):
        with open(self.log, encoding="utf-8", errors="replace") as source:
            return source.read()

    def path(self, name):
        return os.path.join(self.folder, name)

    def wait_for_a_picture(self):
        def look():
            if self.process.poll() is not None:
                raise Failure("Blender ended with %s:\n%s" % (self.process.returncode, self.text()[-3000:]))
            return os.path.exists(self.path("looks"))
        wait_for(look, "a first picture")

    def end(self):
        """What it said; Failure on a traceback, on a crash and on files that stay."""
        try:
            self.process.wait(LIMIT_S * PATIENCE)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            raise Failure("Blender hangs:\n" + self.text()[-3000:]) from None
        # Without a window, Blender ends with 1 after a render that failed.
        if self.process.returncode not in (0, 1) or "Traceback" in self.text() or not os.path.exists(self.path("said.json")):
            raise Failure("Blender ended with %s:\n%s" % (self.process.returncode, self.text()[-3000:]))
        left = [name for name in os.listdir(self.folder) if name.startswith("azulejo-") and not name.endswith(".exr")]
        expect(not left, "files stay: %s" % left)
        with open(self.path("said.json"), encoding="utf-8") as source:
            return json.load(source)


GLOW = 1.3  # no surface of the scenes reflects that much; pixels with more show a lamp, or its edge


def rows_of(path):
    picture = read_exr(path)
    return list(zip(*(picture.values(c) for c in "RGB")))


def means(path):
    rows = rows_of(path)
    return [sum(row[i] for row in rows) / len(rows) for i in range(3)]


def agree(run, percent):
    """The means of the pixels in which no lamp itself is seen, in either."""
    pairs = [(a, b) for a, b in zip(rows_of(run.path("azulejo.exr")), rows_of(run.path("cycles.exr"))) if max(a + b) < GLOW]
    for channel in range(3):
        mine, other = (sum(pair[side][channel] for pair in pairs) for side in range(2))
        expect(len(pairs) > 100 and abs(mine / other - 1) < percent / 100, "Azulejo %g, Cycles %g" % (mine, other))


def no_error(said):
    expect(not said["error"], said["error"])
    return said


# The tolerances are some four times the noise of these sample counts, and below what a wrong unit or angle would do.
@tests.add
def the_default_scene_is_as_bright():
    """Blender's first scene, its cube a Lambert reflector: within 2 % of Cycles"""
    with Farm() as farm:
        run = Run(farm, "default", engines="azulejo,cycles", width=160, height=90, samples=64)
        said = no_error(run.end())
        expect(said["notes"] == [], said["notes"])
        expect(" samples a pixel" in run.text() and "1 worker" in run.text(), "no progress in the status line")
        agree(run, 2)


@tests.add
def a_room_is_as_bright():
    """an area light and a turned HDRI: within 3 % of Cycles; the lamp that is seen is named"""
    with Farm() as farm:
        run = Run(farm, "room", engines="azulejo,cycles", width=96, height=54, samples=128)
        said = no_error(run.end())
        expect(any("ceiling light: is in the camera's view" in n for n in said["notes"]), said["notes"])
        agree(run, 3)


@tests.add
def every_lamp_is_as_bright():
    """point, ball, spot, disc and sun: within 3 % of Cycles"""
    with Farm() as farm:
        run = Run(farm, "lamps", engines="azulejo,cycles", width=120, height=68, samples=64)
        no_error(run.end())
        agree(run, 3)


@tests.add
def a_lens_and_a_baked_world_are_as_bright():
    """shift and depth of field; an orthographic portrait at half resolution; a world of nodes: within 3 % of Cycles"""
    with Farm() as farm:
        for case, size in (("lens", {"width": 120, "height": 68}), ("upright", {}), ("sky", {"width": 80, "height": 45})):
            run = Run(farm, case, engines="azulejo,cycles", samples=64, **size)
            no_error(run.end())
            agree(run, 3)
            if case == "upright":
                picture = read_exr(run.path("azulejo.exr"))
                expect((picture.width, picture.height) == (90, 160), (picture.width, picture.height))


def columns(path):
    """The mean of each column of pixels."""
    picture = read_exr(path)
    values = picture.values("G")
    return [sum(values[x::picture.width]) / picture.height for x in range(picture.width)]


@tests.add
def an_edge_is_as_soft():
    """Cycles' pixel filters, whose widths Blender's panel sets: each column across an edge within four times the noise"""
    with Farm() as farm:
        pixels = []
        for kind, width in (("BLACKMAN_HARRIS", 1.5), ("BLACKMAN_HARRIS", 4), ("GAUSSIAN", 6), ("BOX", 4)):
            run = Run(farm, "edge", engines="azulejo,cycles", width=64, height=64, samples=256, filter=kind, filter_width=width)
            said = no_error(run.end())
            expect(said["notes"] == [], said["notes"])
            mine, other = (columns(run.path(name + ".exr")) for name in ("azulejo", "cycles"))
            off = max(abs(a - b) for a, b in zip(mine, other))
            expect(off < .03, (kind, width, off, mine[26:38], other[26:38]))
            pixels.append(mine[32])
        expect(all(b - a > .03 for a, b in zip(sorted(pixels), sorted(pixels)[1:])), ("filters are alike", pixels))


@tests.add
def clear_things_are_as_clear():
    """glass, filled glass, alpha, no material, culling, two mixes with Transparent: each ball's mean within 2 % of Cycles, and its pixels alike; a coat's within 10 %"""
    with Farm() as farm:
        run = Run(farm, "balls", engines="azulejo,cycles", width=320, height=40, samples=512)
        said = no_error(run.end())
        expect(said["notes"] == [], said["notes"])
        mine, other = (rows_of(run.path(name + ".exr")) for name in ("azulejo", "cycles"))
        for ball, name in enumerate(("glass", "juice", "ghost", "leaf", "veil", "coat", "bare", "culled")):
            inside = [y * 320 + x for y in range(40) for x in range(ball * 40, ball * 40 + 40)
                      if math.hypot(x + .5 - ball * 40 - 20, y + .5 - 20) < 17]
            a, b = (sum(sum(rows[p]) for p in inside) for rows in (mine, other))
            off = sum(abs(sum(mine[p]) - sum(other[p])) for p in inside) / b
            expect(abs(a / b - 1) < (.1 if name == "coat" else .02) and off < .15, (name, a / b, off))


@tests.add
def a_photographers_table_is_as_bright():
    """paper, clay, glass and brass within 3 % of Cycles; plastic, whose diffuse part is another one, within 10 %"""
    with Farm() as farm:
        run = Run(farm, "product", engines="azulejo,cycles", width=240, height=135, samples=256)
        expect(no_error(run.end())["notes"] == [], "notes")
        mine, other = (rows_of(run.path(name + ".exr")) for name in ("azulejo", "cycles"))
        for name, left, top, right, bottom in (("paper", 160, 10, 230, 55), ("clay", 80, 55, 135, 100), ("glass", 33, 88, 57, 112),
                                               ("brass", 75, 23, 140, 40), ("plastic", 160, 70, 200, 110)):
            inside = [y * 240 + x for y in range(top, bottom) for x in range(left, right)]
            ratio = sum(sum(mine[p]) for p in inside) / sum(sum(other[p]) for p in inside)
            print("# %s: %.3f of Cycles" % (name, ratio))
            expect(abs(ratio - 1) < (.1 if name == "plastic" else .03), (name, ratio))


@tests.add
def an_animation_with_a_rig():
    """three frames of a bending bar under a moving camera, with a frame step: each within 4 % of Cycles, and blurred"""
    with Farm() as farm:
        run = Run(farm, "rig", animation=1, engines="azulejo,cycles", width=64, height=48, samples=64)
        no_error(run.end())
        for frame in (1, 3, 5):
            mine, other = (means(run.path("%s-%04d.exr" % (name, frame))) for name in ("azulejo", "cycles"))
            expect(abs(mine[0] / other[0] - 1) < .04, (frame, mine, other))
        pictures = {open(run.path("azulejo-%04d.exr" % f), "rb").read() for f in (1, 3, 5)}
        expect(len(pictures) == 3, "frames are equal")
        expect(not os.path.exists(run.path("azulejo-0002.exr")), "a frame between the steps")
        blurred = Run(farm, "rig", engines="azulejo,cycles", width=64, height=48, samples=64, shutter=1, frame=3)
        no_error(blurred.end())
        sharp = run.path("azulejo-0003.exr")
        moves = differing(blurred.path("azulejo.exr"), sharp)
        expect(moves > .005 and differing(blurred.path("azulejo.exr"), blurred.path("cycles.exr")) < moves / 3,
               ("nothing is blurred, or otherwise than by Cycles", moves,
                differing(blurred.path("azulejo.exr"), blurred.path("cycles.exr"))))


def differing(one, two):
    a, b = (read_exr(p).values("R") for p in (one, two))
    return sum(abs(x - y) for x, y in zip(a, b)) / len(a)


@tests.add
def a_border_is_a_part():
    """a border renders the same pixels as the whole picture, cropped or not"""
    with Farm() as farm:
        border = ".25,.2,.75,.9"
        runs = [Run(farm, "default", width=64, height=40, samples=8, **more) for more in (
            {}, {"border": border}, {"border": border, "crop": 1})]
        for run in runs:
            no_error(run.end())
        whole, part, crop = (read_exr(run.path("azulejo.exr")) for run in runs)
        expect((part.width, part.height, crop.width, crop.height) == (64, 40, 32, 28), (part.width, crop.width, crop.height))
        for y in range(40):
            for x in range(64):
                inside = 16 <= x < 48 and 4 <= y < 32
                value = whole.values("R")[y * 64 + x] if inside else 0.0
                if part.values("R")[y * 64 + x] != value:
                    raise Failure("pixel %d, %d is %r, not %r" % (x, y, part.values("R")[y * 64 + x], value))
                if inside and crop.values("R")[(y - 4) * 32 + x - 16] != value:
                    raise Failure("pixel %d, %d of the crop" % (x, y))


@tests.add
def passes_arrive():
    """depth, normal, position, albedo and samples become layers in Blender's axes; alpha leaves the background out"""
    with Farm() as farm:
        run = Run(farm, "default", width=64, height=40, samples=8, file="OPEN_EXR_MULTILAYER", transparent=1,
                  passes="use_pass_z,use_pass_normal,use_pass_position,azulejo_denoising,azulejo_samples,azulejo_error")
        no_error(run.end())
        picture = read_exr(run.path("azulejo.exr"))
        middle = 20 * 64 + 32

        def at(name, where=middle):
            return picture.values("ViewLayer." + name)[where]
        expect(5 < at("Depth.Z") < 15 and at("Depth.Z", 0) > 1e9, "depth %g" % at("Depth.Z"))
        place = [at("Position." + c) for c in "XYZ"]
        expect(all(-1.01 < c < 1.01 for c in place) and max(abs(c) for c in place) > .98, place)  # on the cube
        normal = [at("Normal." + c) for c in "XYZ"]
        expect(abs(sum(n * n for n in normal) - 1) < .1, normal)
        face = max(range(3), key=lambda i: abs(normal[i]))
        expect(normal[face] > .9 and place[face] > .98, (normal, place))
        expect(abs(at("Denoising Albedo.R") - .8) < .01, at("Denoising Albedo.R"))
        expect(at("Azulejo Samples.X") == 8 and at("Azulejo Error.R") >= 0, "samples")
        expect(at("Combined.A") == 1 and at("Combined.A", 0) == 0 and at("Combined.R", 0) == 0, "alpha")


def off(picture, layer, truth):
    """The root of the mean squared difference of red and green, above 1 cut off."""
    pairs = [(a, b) for c in "RG" for a, b in zip(picture.values(layer + "." + c), truth.values("ViewLayer.Combined." + c))]
    return math.sqrt(sum((min(a, 1) - min(b, 1)) ** 2 for a, b in pairs) / len(pairs))


@tests.add
def a_picture_without_noise():
    """the denoised picture is Blender's; the rendered one is a pass, with the bits that it has alone, and what guides the denoiser"""
    size = {"width": 96, "height": 54, "file": "OPEN_EXR_MULTILAYER"}
    with Farm() as farm:
        pictures = []
        for more in ({"samples": 16}, {"samples": 16, "denoise": "ON", "passes": "azulejo_denoising"}, {"samples": 1024}):
            run = Run(farm, "room", **size, **more)
            said = no_error(run.end())
            expect(not any("denois" in n for n in said["notes"]), said["notes"])
            pictures.append(read_exr(run.path("azulejo.exr")))
        raw, clean, truth = pictures
        for channel in "RGBA":
            expect(clean.values("ViewLayer.Noisy Image." + channel) == raw.values("ViewLayer.Combined." + channel),
                   "the noisy image is not the picture")
        before, after = (off(clean, "ViewLayer." + name, truth) for name in ("Noisy Image", "Combined"))
        expect(after < before / 2, "off by %g, denoised by %g" % (before, after))
        middle = 30 * 96 + 36  # the block
        expect(abs(clean.values("ViewLayer.Denoising Albedo.R")[middle] - .75) < .01 and
               clean.values("ViewLayer.Denoising Normal.Y")[middle] < -.9 and
               4 < clean.values("ViewLayer.Denoising Depth.Z")[middle] < 6, "guides")


@tests.add
def mattes_reach_the_compositor():
    """Blender's Cryptomatte node picks an object and a material of the render, to the share; the file has both manifests"""
    with Farm() as farm:
        for matte, flag in (("object Cube", "use_pass_cryptomatte_object"), ("material grey", "use_pass_cryptomatte_material")):
            run = Run(farm, "default", width=64, height=40, samples=16, file="OPEN_EXR_MULTILAYER", transparent=1, matte=matte,
                      passes=flag)
            no_error(run.end())
            picture = read_exr(run.path("azulejo.exr"))
            shares, alpha = picture.values("Composite.Combined.R"), picture.values("ViewLayer.Combined.A")
            expect(max(abs(a - b) for a, b in zip(shares, alpha)) < 1e-5, "the matte of all there is is not alpha")
            expect(0 < min(s for s in shares if s > 0) < .9 and max(shares) > .999, "no edge, or no inside")
            kind, name = matte.split()
            layer = "ViewLayer.Crypto" + kind.capitalize()
            keys = [k for k, v in picture.attributes.items() if k.startswith("cryptomatte/") and v == layer.encode()]
            expect(len(keys) == 1, list(picture.attributes))
            manifest = json.loads(picture.attributes[keys[0].replace("/name", "/manifest")])
            expect(struct.pack("<I", int(manifest[name], 16)) == struct.pack(
                "<f", picture.values(layer + "00.r")[20 * 64 + 32]), manifest)


@tests.add
def esc_keeps_what_there_is():
    """Esc in the middle of a long render ends soon, with the picture as it is; on a farm the job is finished early"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        run = Run(farm, "default", width=160, height=90, samples=1000000, stop_at=2, address=farm.address, key=farm.key,
                  passes="use_pass_z")
        said = run.end()
        expect(not any("stopped:" in n for n in said["notes"]), said["notes"])
        expect(means(run.path("azulejo.exr"))[0] > .01, "a black picture")
        job = farm.job(1)
        expect(job["state"] == "done" and job["finished_early"], job["state"])


@tests.add
def a_coordinator_that_goes_away():
    """a coordinator that is killed is waited for; if it does not come back Blender reports it, and does not hang"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        run = Run(farm, "default", width=160, height=90, samples=1000000, address=farm.address, key=farm.key, patience=3)
        run.wait_for_a_picture()
        farm.coordinator.kill()
        said = run.end()
        expect("the coordinator has gone" in (said["error"] or ""), said)
        expect("waiting for it" in run.text(), "it was not waited for")


@tests.add
def a_coordinator_that_comes_back():
    """a coordinator that is killed and started again goes on, and the picture arrives"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        run = Run(farm, "default", width=160, height=90, samples=3000, address=farm.address, key=farm.key, patience=120)
        run.wait_for_a_picture()
        farm.coordinator.kill()
        wait_for(lambda: "waiting for it" in run.text(), "Blender to notice")
        farm.restart_coordinator()
        no_error(run.end())
        expect(os.path.exists(run.path("azulejo.exr")), "no picture")


@tests.add
def errors_are_one_sentence():
    """no azulejo, no coordinator, a wrong key and nothing to end the render are reported, without a traceback"""
    with Farm() as farm:
        farm.start_coordinator()
        other = farm.path("other.key")
        farm.cli("keygen", "-o", other, expect=0, connect=False)
        for words, run in (
                ("set its path", Run(farm, "default", program="/nowhere/azulejo", width=32, height=18)),
                ("127.0.0.1:1", Run(farm, "default", width=32, height=18, address="127.0.0.1:1", key=farm.key)),
                ("key", Run(farm, "default", width=32, height=18, address=farm.address, key=other)),
                ("nothing says when", Run(farm, "default", width=32, height=18, samples=0))):
            said = run.end()
            expect(said["error"] and words in said["error"], said)


@tests.add
def what_is_not_exported_is_named():
    """a procedural texture, by material and name; from the zip, installed as a user does"""
    with Farm() as farm:
        with open(os.path.join(ROOT, "Makefile"), encoding="utf-8") as makefile:
            version = next(l for l in makefile if l.startswith("VERSION :=")).split()[2]
        package = farm.path("azulejo-blender.zip")
        subprocess.run([sys.executable, os.path.join(ROOT, "deploy", "blender", "make_zip.py"), version, package], check=True)
        run = Run(farm, "noise", width=32, height=18, samples=4, package=package)
        said = no_error(run.end())
        expect("material marble: Noise Texture is not exported; bake it" in said["notes"], said["notes"])
        lost = no_error(Run(farm, "lost", width=32, height=18, samples=4).end())["notes"]
        for words in ("odd: its subsurface scattering", "odd: its anisotropy", "odd: its sheen", "two: Mix Shader", "fog: its volume",
                      "inner: its subsurface scattering", "made: its sheen"):
            expect(any(n.startswith("material " + words) and "not exported" in n for n in lost), (words, lost))
        expect(len(lost) == 7, lost)
        expect(os.path.exists(os.path.join(run.folder, "user")), "not installed in a folder of its own")


tests.run()
