"""--region X,Y,W,H renders a part of a picture, with the bits of the whole one."""
import os
import struct

from exr import PIXEL_BYTES, read_exr
from farm import ROOT, Farm, Tests, read_bytes, wait_for
from jobs import expect, make_sky

tests = Tests()
X, Y, W, H = 13, 9, 37, 22
REGION = ("--region", "%d,%d,%d,%d" % (X, Y, W, H))
WIDTH, HEIGHT = 70, 50
SIZE = ("--size", "%dx%d" % (WIDTH, HEIGHT))


def crop(picture, x, y, width, height):
    """The channels of a rectangle of the picture, as bytes."""
    out = {}
    for name, data in picture.channels.items():
        size = PIXEL_BYTES[picture.kinds[name]]
        rows = [data[(r * picture.width + x) * size:(r * picture.width + x + width) * size]
                for r in range(y, y + height)]
        out[name] = b"".join(rows)
    return out


def window(picture, name):
    return struct.unpack("<4i", picture.attributes[name])


def check(part, whole, x=X, y=Y, width=W, height=H, but=()):
    expect((part.width, part.height) == (width, height), (part.width, part.height))
    expect(window(part, "dataWindow") == (x, y, x + width - 1, y + height - 1), window(part, "dataWindow"))
    expect(window(part, "displayWindow") == (0, 0, whole.width - 1, whole.height - 1), window(part, "displayWindow"))
    wanted = crop(whole, x, y, width, height)
    expect(sorted(part.channels) == sorted(wanted), part.channels.keys())
    for name in wanted:
        expect(name in but or part.channels[name] == wanted[name], "other bits in " + name)


def png_size(path):
    return struct.unpack(">2I", read_bytes(path)[16:24])


@tests.add
def the_same_bits():
    """every pixel and every output variable of a region is the whole picture's, for each kind of camera"""
    with Farm() as farm:
        scenes = os.path.join(ROOT, "scenes", "features")
        panorama = [f for f in os.listdir(scenes) if "panorama" in f and f.endswith((".gltf", ".pbrt"))]
        for name in ["motion.gltf", "orthographic.gltf", "textures.gltf"] + panorama[:1]:
            scene = os.path.join(scenes, name)
            if not os.path.exists(scene):
                continue
            options = (*SIZE, "--spp", "8", "--aov", "depth,normal,uv,motion,samples", "--env", make_sky(farm))
            farm.cli("render", scene, *options, "-o", "whole.exr", connect=False, expect=0)
            farm.cli("render", scene, *options, *REGION, "-o", "part/", connect=False, expect=0)
            stem = "part/" + name.rsplit(".", 1)[0]
            whole, part = read_exr(farm.path("whole.exr")), read_exr(farm.path(stem + ".exr"))
            check(part, whole)
            for pair in ((stem + ".exr", "whole.exr"), ("whole.exr", stem + ".exr")):
                expect("every one of %d pixels" % (W * H) in farm.cli("compare", *pair, expect=0).out, pair)
            expect(png_size(farm.path(stem + ".png")) == (W, H), "PNG")
            expect(" --size %dx%d --region %d,%d,%d,%d " % (WIDTH, HEIGHT, X, Y, W, H) in
                   part.attributes["azulejo:command"].decode(), part.attributes["azulejo:command"])
        for edge in ((0, 0, 1, 1), (WIDTH - 1, HEIGHT - 1, 1, 1), (0, 0, WIDTH, 1), (16, 16, 16, 16)):
            farm.cli("render", scene, *options, "--region", "%d,%d,%d,%d" % edge, "-o", "edge.exr", connect=False, expect=0)
            check(read_exr(farm.path("edge.exr")), whole, *edge)
        farm.cli("compare", "edge.exr", "whole.exr", expect=0)
        farm.cli("render", scene, *options, "--region", "%d,%d,%d,%d" % (X + 1, Y, W, H), "-o", "beside.exr", connect=False, expect=0)
        error = farm.cli("compare", "beside.exr", stem + ".exr", expect=3).err
        expect("different regions" in error, error)
        # All of it is the picture itself.
        farm.cli("render", scene, *options, "--region", "0,0,%d,%d" % (WIDTH, HEIGHT), "-o", "all.exr", connect=False,
                 expect=0)
        everything = read_exr(farm.path("all.exr"))
        expect(everything.reproducible == whole.reproducible, "the whole picture as a region")


@tests.add
def on_a_farm():
    """submit, watch, show, extend, develop and debug-pixel work on a region; only its pixels are rendered"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = farm.scene()
        whole = farm.submit(scene, *SIZE, "--spp", "32")
        number = farm.submit(scene, *SIZE, *REGION, "--spp", "8", "--name", "part")
        job = farm.wait_for_job(number)
        expect(job["samples_done"] == job["samples_total"] == W * H * 8 == job["work"]["samples"], job)
        settings = job["settings"]
        expect([settings[k] for k in ("whole_width", "whole_height", "region_x", "region_y", "width", "height")] == [WIDTH, HEIGHT, X, Y, W, H], settings)
        expect("37 x 22 pixels, at 13,9 of 70 x 50" in farm.cli("show", number, expect=0).out, "show")
        expect(job["now"]["figures"]["display"] is not None, job["now"])
        farm.cli("extend", number, "--spp", "32", "--watch", expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator()
        wait_for(lambda: farm.list_workers(), "the worker")
        farm.wait_for_job(whole)
        exr, png = sorted(farm.fetch(number, "part"))
        check(read_exr(exr), read_exr([f for f in farm.fetch(whole, "whole") if f.endswith(".exr")][0]))
        farm.cli("develop", number, "--tonemap", "linear", "-o", "lin/", expect=0)
        expect(png_size(farm.path("lin", "part.png")) == (W, H), "developed again")
        farm.cli("tonemap", exr, "-o", "mine.png", "-t", "linear", connect=False, expect=0)
        expect(read_bytes(farm.path("mine.png")) == read_bytes(farm.path("lin", "part.png")), "tonemap")
        # Pixels are the whole picture's.
        inside = farm.cli("debug-pixel", number, "--pixel", "20,15", "--json", expect=0).json()
        same = farm.cli("debug-pixel", whole, "--pixel", "20,15", "--json", expect=0).json()
        expect(inside["samples"] == same["samples"], (inside, same))
        for outside in ("12,15", "50,15", "20,8", "20,31"):
            result = farm.cli("debug-pixel", number, "--pixel", outside, expect=3)
            expect("outside" in result.err, result)
        farm.cli("estimate", scene, *SIZE, *REGION, "--spp", "64", "--coordinator", farm.address, "--key", farm.key, expect=0)


@tests.add
def by_a_schedule():
    """a region that a limit ended is rendered again by its schedule, as that region only"""
    with Farm() as farm:
        scene = os.path.join(ROOT, "scenes", "features", "glass.gltf")
        farm.cli("render", scene, *SIZE, *REGION, "--spp", "100000", "--time-limit", "1s", "-o", "cut.exr", connect=False, expect=0)
        expect(read_exr(farm.path("cut.exr")).attributes["azulejo:region"].decode() == "13,9,37,22 of 70x50", "header")
        farm.cli("render", scene, *SIZE, *REGION, "--schedule-from", "cut.exr", "-o", "again.exr", connect=False, expect=0)
        farm.cli("compare", "cut.exr", "again.exr", connect=False, expect=0)
        for options in ((), SIZE, (*SIZE, "--region", "12,9,37,22"), ("--size", "71x50", *REGION)):
            result = farm.cli("render", scene, *options, "--schedule-from", "cut.exr", "-o", "x.exr", connect=False, expect=2)
            expect("--size 70x50 --region 13,9,37,22" in result.err, result)
        farm.cli("render", scene, "--size", "37x22", "--spp", "100000", "--time-limit", "1s", "-o", "whole.exr", connect=False,
                 expect=0)
        result = farm.cli("render", scene, *SIZE, *REGION, "--schedule-from", "whole.exr", "-o", "x.exr", connect=False, expect=2)
        expect("without --region" in result.err, result)


@tests.add
def wrong_regions():
    """a region that is none, or not inside the picture, is refused at once"""
    with Farm() as farm:
        for text in ("1,2,3", "1,2,3,4,5", "a,b,c,d", "1,2,0,4", "-1,0,4,4", "1x2,3,4", "70,0,1,1", "60,0,11,1", "0,49,1,2",
                     "0,0,71,1", "0,0,99999999999,1"):
            result = farm.cli("render", farm.scene(), *SIZE, "--region", text, "-o", "x.exr", connect=False, expect=2)
            expect("--region" in result.err and "unknown" not in result.err and not os.path.exists(farm.path("x.exr")), result)


PBRT = ('LookAt 0 1 4  0 0 0  0 1 0\nCamera "perspective"\nFilm "rgb" "integer xresolution" 60 "integer yresolution" 40 %s\n'
        'Sampler "independent" "integer pixelsamples" 4\nWorldBegin\nLightSource "infinite" "rgb L" [1 2 3]\n'
        'Shape "sphere" "float radius" 1\n')


@tests.add
def crop_window_of_pbrt():
    """a pbrt film's cropwindow and pixelbounds are regions; an option on the command line is stronger"""
    with Farm() as farm:
        pictures = {}
        for name, words in (("whole", ""), ("window", '"float cropwindow" [0.24 0.5 0.1 0.8]'),
                            ("bounds", '"integer pixelbounds" [15 30 4 32]')):
            with open(farm.path(name + ".pbrt"), "w") as scene:
                scene.write(PBRT % words)
            result = farm.cli("render", farm.path(name + ".pbrt"), "-o", farm.path(name + ".exr"), connect=False, expect=0)
            expect(("crop window" in result.err) == (name != "whole"), result)
            pictures[name] = read_exr(farm.path(name + ".exr"))
        check(pictures["window"], pictures["whole"], 15, 4, 15, 28)
        check(pictures["bounds"], pictures["whole"], 15, 4, 15, 28)
        farm.cli("render", farm.path("window.pbrt"), "--region", "1,2,3,4", "-o", farm.path("own.exr"), connect=False, expect=0)
        check(read_exr(farm.path("own.exr")), pictures["whole"], 1, 2, 3, 4)


@tests.add
def pixel_filter_of_pbrt():
    """a pbrt file's filter is used, and said; with either of its options on the command line it is the options' alone"""
    with Farm() as farm:
        def picture(name, *options):
            where = farm.path("-".join((name, ) + options) + ".exr")
            farm.cli("render", farm.path(name + ".pbrt"), *options, "-o", where, connect=False, expect=0)
            return read_exr(where).values("R")
        for name, words in (("plain", ""), ("wide", '\nPixelFilter "triangle" "float xradius" 3 "float yradius" 3')):
            with open(farm.path(name + ".pbrt"), "w") as scene:
                scene.write(PBRT % words)
        result = farm.cli("render", farm.path("wide.pbrt"), "-o", farm.path("said.exr"), connect=False, expect=0)
        expect("pixel filter triangle" in result.err, result)
        plain, wide = picture("plain"), picture("wide")
        expect(wide != plain and wide == picture("plain", "--pixel-filter", "triangle", "--filter-width", "6"), "the file's filter")
        for options in (("--filter-width", "2"), ("--pixel-filter", "box")):
            expect(picture("wide", *options) == picture("plain", *options) not in (plain, wide), options)
        expect(picture("wide", "--pixel-filter", "blackman-harris") == plain, "the default's name")


tests.run()
