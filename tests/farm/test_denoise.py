"""--denoise: a layer beside the raw picture, whose bits stay; the same bits on any farm; switched without rendering; with the
frames around."""
import os

from exr import read_exr
from farm import ROOT, Farm, Tests, read_bytes, wait_for
from jobs import expect
from moving import write as write_moving
from png import Png

tests = Tests()
BOX = os.path.join(ROOT, "scenes", "cornell", "cornell-area.gltf")
SIZE = ("--size", "64x64", "--spp", "8")
LAYER = ("denoised.R", "denoised.G", "denoised.B")
GUIDES = ("Denoising Albedo.R", "Denoising Normal.X", "emission.G")


def raw(picture):
    return [picture.channels[c] for c in "RGB"]


def layer(picture):
    return [picture.channels[c] for c in LAYER]


def squared_error(codes, truth):
    """In codes of the display, by pixel and channel."""
    return sum((a - b) ** 2 for row, right in zip(codes, truth) for a, b in zip(row, right)) / sum(map(len, truth))


def display(path):
    return Png(read_bytes(path)).codes


@tests.add
def beside_the_raw_picture():
    """the raw channels keep their bits, the layer and the PNG have less than a quarter of their squared error"""
    with Farm() as farm:
        for name, options in (("plain", ()), ("clean", ("--denoise", "on")), ("fast", ("--denoise", "fast")),
                              ("truth", ("--spp", "256"))):
            farm.cli("render", BOX, *SIZE, "--size", "96x96", *options, "-o", name, connect=False, expect=0)
        plain, clean, fast = (read_exr(farm.path(n + ".exr")) for n in ("plain", "clean", "fast"))
        expect(sorted(plain.channels) == ["B", "G", "R"], "what is not asked for is not there")
        expect(raw(plain) == raw(clean) == raw(fast), "raw bits")
        expect(all(c in clean.channels for c in LAYER + GUIDES), sorted(clean.channels))
        expect(layer(clean) != raw(clean) and layer(clean) != layer(fast), "three pictures")
        expect(clean.attributes["azulejo:denoiseMethod"] == b"full" and
               fast.attributes["azulejo:denoiseMethod"] == b"fast", "methods")
        expect(clean.number("azulejo:denoiseVersion") >= 1, "version")
        expect(clean.attributes["azulejo:denoiseGuides"] == b"albedo, normal, emission", "guides")
        truth = display(farm.path("truth.png"))
        noise = squared_error(display(farm.path("plain.png")), truth)
        for name in ("clean", "fast"):
            expect(squared_error(display(farm.path(name + ".png")), truth) < noise / 4, name)
        # The command of the header makes the same file again.
        expect(b"--denoise on" in clean.attributes["azulejo:command"], clean.attributes["azulejo:command"])
        # tonemap takes the layer, or says that it is missing.
        farm.cli("tonemap", "clean.exr", "-o", "mapped.png", "--denoise", "on", connect=False, expect=0)
        expect(display(farm.path("mapped.png")) == display(farm.path("clean.png")), "mapped")
        refused = farm.cli("tonemap", "plain.exr", "-o", "mapped.png", "--denoise", "on", connect=False)
        expect(refused.code != 0 and "denoised.R" in refused.err, refused.err)


@tests.add
def the_same_bits_anywhere():
    """one worker of one thread, three of several, and a coordinator that was killed give the same layer"""
    pictures = []
    for threads in ((1,), (1, 2, 2)):
        with Farm() as farm:
            farm.start_coordinator()
            number = farm.submit(BOX, *SIZE, "--spp", "64", "--denoise", "on")
            for count in threads:
                farm.start_worker(threads=count)
            if len(threads) > 1:
                wait_for(lambda: int(farm.job(number)["samples_done"]) > 0 or farm.job(number)["state"] == "done", "a start")
                farm.coordinator.kill()
                farm.restart_coordinator()
            farm.wait_for_job(number)
            pictures.append(read_exr(farm.fetch(number)[0]))
    first, second = pictures
    expect(layer(first) == layer(second) and raw(first) == raw(second), "bits")
    expect(all(first.channels[c] == second.channels[c] for c in GUIDES), "guides")


@tests.add
def switched_afterwards():
    """develop turns it on and off without rendering, also after a restart; both errors are told; previews take it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        size = (*SIZE, "--spp", "32")
        wanted = farm.submit(BOX, *size, "--denoise", "on")
        plain = farm.submit(BOX, *size)
        guided = farm.submit(BOX, *size, "--aov", "denoising,emission")
        for number in (wanted, plain, guided):
            farm.wait_for_job(number)
        farm.workers[0].kill()
        info = farm.job(wanted)
        expect(info["output"]["denoise"] == "on" and "denoising-albedo" in info["settings"]["aovs"], info["settings"])
        expect(info["now"]["denoised"]["rmse_percent"] > 0, info["now"])
        shown = farm.cli("show", wanted, expect=0).out
        expect(" raw, " in shown and " denoised" in shown, shown)
        expect("denoised" not in farm.job(plain)["now"], "a figure of what was not made")
        noisy, clean = (display([p for p in farm.fetch(n, "f%d" % n) if p.endswith(".png")][0]) for n in (plain, wanted))
        expect(noisy != clean, "the PNG")

        def developed(number, *options):
            said = farm.cli("develop", number, *options, "-o", "again/p.png", "--force", expect=0).out
            return display(farm.path("again", "p.png")), said

        expect(developed(wanted, "--denoise", "off")[0] == noisy, "off")
        expect(developed(wanted, "--denoise", "on")[0] == clean, "on again")
        # Rendered with what guides it: the same bits, made of the kept film.
        expect(developed(guided, "--denoise", "on")[0] == clean, "of the kept film")
        expect(farm.job(guided)["now"]["denoised"]["rmse_percent"] > 0, "its figures")
        codes, _ = developed(plain, "--denoise", "on")
        expect(codes != noisy and codes != clean, "by colours alone")
        said = farm.cli("develop", plain, "--denoise", "on", expect=0).out
        expect("by colours alone" in said, said)
        farm.coordinator.stop()
        farm.restart_coordinator()
        expect(farm.job(guided)["now"]["denoised"]["rmse_percent"] > 0, "its figures after a restart")
        expect(developed(wanted, "--denoise", "off")[0] == noisy, "off after a restart")
        # One who looks gets it, and the job's pictures stay.
        farm.cli("fetch", plain, "--preview", "look.png", "--denoise", "on", expect=0)
        farm.cli("fetch", plain, "--preview", "raw.png", "--denoise", "off", expect=0)
        expect(display(farm.path("raw.png")) == noisy and display(farm.path("look.png")) != noisy, "a preview")


def pictures(farm, folder):
    """The display pictures in a folder of the farm's."""
    return [display(farm.path(folder, p)) for p in sorted(os.listdir(farm.path(folder))) if p.endswith(".png")]


def change(shown, truth):
    """From each frame to the next, the squared change that is not the truth's."""
    return sum(((q - p) - (s - r)) ** 2 for a, b, c, d in zip(shown, shown[1:], truth, truth[1:])
               for rows in zip(a, b, c, d) for p, q, r, s in zip(*rows))


@tests.add
def with_the_frames_around():
    """a frame's picture takes in those before and after, along a moving camera; locally and on any farm the same bits"""
    with Farm() as farm:
        # A tenth of a metre a frame: some two pixels, whose place in the picture is the same in no two frames.
        scene = farm.path("moving.gltf")
        write_moving(BOX, scene, {"camera": (2.4, 0, 0)})
        size = ("--size", "96x72", "--spp", "16", "--frames", "9-13", "--format", "png")
        for name, options in (("alone", ("--denoise", "on")), ("around", ("--denoise", "on", "--denoise-around", "1")),
                              ("still", ("--denoise", "on", "--denoise-around", "2")), ("truth", ("--spp", "256"))):
            farm.cli("render", BOX if name == "still" else scene, *size, *options, "-o", name, connect=False, expect=0)
        shown = {name: [display(farm.path("%s-%04d.png" % (name, f))) for f in range(9, 14)]
                 for name in ("alone", "around", "still", "truth")}
        errors = {name: sum(squared_error(a, b) for a, b in zip(shown[name], shown["truth"])) for name in ("alone", "around")}
        expect(errors["around"] < 0.85 * errors["alone"], errors)
        flicker = {name: change(shown[name], shown["truth"]) for name in errors}
        expect(flicker["around"] < 0.9 * flicker["alone"], flicker)
        farm.start_coordinator()
        number = farm.submit(scene, *size, "--denoise", "on", "--denoise-around", "1")
        for threads in (1, 2):
            farm.start_worker(threads=threads)
        wait_for(lambda: farm.job(number)["frames_done"] > 0, "a frame")
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_job(number)
        expect("position" in farm.job(number)["settings"]["aovs"], farm.job(number)["settings"])
        expect(farm.job(number)["output"]["denoise_around"] == 1, farm.job(number)["output"])
        shown_as = farm.cli("show", number, expect=0).out
        expect("denoised with 1 frame before and after each" in shown_as, shown_as)

        farm.cli("fetch", number, "-o", "f", expect=0)
        expect(pictures(farm, "f") == shown["around"], "the bits of a local render")
        # The EXR's layer, too; nothing else of the file changes.
        for name, options in (("one", ()), ("three", ("--denoise-around", "1")), ("halves", ("--denoise-around", "1", "--half"))):
            farm.cli("render", scene, *size, "--frames", "9-10", "--region", "16,8,64,48", "--denoise", "on", "--aov", "position,object-id,depth",
                     *options, "--format", "exr", "-o", name, connect=False, expect=0)
        one, three, halves = (read_exr(farm.path(name + "-0009.exr")) for name in ("one", "three", "halves"))
        expect(sorted(one.channels) == sorted(three.channels) and one.attributes.keys() == three.attributes.keys(), "the same names")
        expect([c for c in one.channels if one.channels[c] != three.channels[c]] == sorted(LAYER), "only the layer")
        changed = {a for a in one.attributes if one.attributes[a] != three.attributes[a]}
        expect(changed - {"azulejo:measured"} <= {a for a in changed if a.startswith("azulejo:denoise")}, changed)
        expect([p.number("azulejo:denoiseFrames") for p in (one, three, halves)] == [1, 2, 2], "frames")
        expect(halves.kinds["denoised.R"] == 1 and halves.kinds["Z"] == 2, halves.kinds)
        # Switched without rendering; a look at a done frame has what the job has.
        farm.cli("develop", number, "--denoise", "on", "-o", "g", expect=0)
        expect(pictures(farm, "g") == shown["alone"], "each by itself")
        farm.cli("develop", number, "--denoise", "on", "--denoise-around", "1", "-o", "h", expect=0)
        expect(pictures(farm, "h") == shown["around"], "with those around again")
        farm.cli("fetch", number, "--frames", "11", "--preview", "look.png", "--denoise", "on", expect=0)
        expect(display(farm.path("look.png")) == shown["around"][2], "a look")
        refused = farm.cli("extend", number, "--spp", "32", "--frames", "10")
        expect(refused.code == 5 and "--denoise-around" in refused.err, refused)
        refused = farm.cli("submit", scene, "--denoise-around", "1")
        expect(refused.code == 2 and "--denoise on" in refused.err, refused)
        refused = farm.cli("submit", scene, "--denoise", "on", "--denoise-around", "3")
        expect(refused.code == 2 and "2" in refused.err, refused)


@tests.add
def frames_that_never_come():
    """a cancelled job's frames have pictures made of those that are there; without films, what was made stays"""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker(threads=1)
        number = farm.submit(BOX, *SIZE, "--frames", "1-4", "--denoise", "on", "--denoise-around", "2", "--format", "png")
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", "whole", expect=0)
        cut = farm.submit(BOX, *SIZE, "--frames", "1-400", "--denoise", "on", "--denoise-around", "2", "--format", "png")
        wait_for(lambda: farm.job(cut)["frames_done"] >= 4, "four frames")
        farm.cli("cancel", cut, expect=0)
        wait_for(lambda: farm.job(cut)["state"] == "cancelled", "the end")
        job = farm.job(cut)
        expect(job["frames_developed"] == job["frames_done"] < 400, job)
        farm.cli("fetch", cut, "-o", "cut", expect=9)
        expect(len(pictures(farm, "cut")) == job["frames_done"], "each has a picture")
        expect(pictures(farm, "cut")[0] == pictures(farm, "whole")[0], "the first frame had all that it needs")
        farm.cli("prune", number, "--films", expect=0)
        farm.cli("develop", number, "--denoise", "off", "-o", "raw", expect=0)
        farm.cli("develop", number, "--denoise", "on", "--denoise-around", "2", "-o", "again", expect=0)
        expect(pictures(farm, "again") == pictures(farm, "whole") != pictures(farm, "raw"), "what was kept")
        # Without its film and picture a frame cannot be made again; the others are.
        gap = farm.submit(BOX, *SIZE, "--frames", "1-3", "--format", "png")
        farm.wait_for_job(gap)
        for path in ("films/%s/frame-0002.kept", "outputs/%s/frame-0002.picture.exr"):
            os.unlink(os.path.join(farm.store, path % gap))
        refused = farm.cli("develop", gap, "--denoise", "on", "--denoise-around", "1")
        expect(refused.code != 0 and "frame 2" in refused.err, refused)
        wait_for(lambda: farm.job(gap)["frames_developed"] >= 1, "frame 1")
        # Cancelled when one of them was to be rendered again: those beside it are made without it.
        last = farm.submit(BOX, *SIZE, "--frames", "1-3", "--denoise", "on", "--denoise-around", "1", "--format", "png")
        farm.wait_for_job(last)
        worker.stop()
        os.unlink(os.path.join(farm.store, "films", str(last), "frame-0002.kept"))
        farm.cli("retry", last, "--frames", "2", expect=0)
        farm.cli("cancel", last, expect=0)
        wait_for(lambda: farm.job(last)["state"] == "cancelled", "the end")
        job = farm.job(last)
        expect(job["frames_developed"] == job["frames_done"] == 2, job)


@tests.add
def what_is_small_or_odd():
    """one pixel, one sample, a region, alpha, halves: an answer each time"""
    with Farm() as farm:
        for name, options in (("pixel", ("--size", "1x1")), ("sample", ("--spp", "1")), ("line", ("--size", "3x40")),
                              ("region", ("--region", "9,7,21,18")), ("alpha", ("--alpha",)), ("half", ("--half",)),
                              ("deep", ("--max-depth", "0"))):
            farm.cli("render", BOX, *SIZE, *options, "--denoise", "on", "-o", name, connect=False, expect=0)
            picture = read_exr(farm.path(name + ".exr"))
            expect(all(c in picture.channels for c in LAYER), name)
            if name == "sample":  # there is one group only, so nothing is known
                expect(layer(picture) == raw(picture), name)
            if name == "half":
                expect(picture.kinds["denoised.R"] == 1, name)
        refused = farm.cli("render", BOX, *SIZE, "--denoise", "much", "-o", "x", connect=False)
        expect(refused.code == 2 and "off" in refused.err and "fast" in refused.err, refused.err)


tests.run()
