"""Tone mapping from the outside: pictures on disk, sheets, and jobs developed again."""
import os
import re
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Failure, ROOT, Tests, read_bytes, wait_for
from png import Png

tests = Tests()
SMALL = ["--size", "48x32", "--spp", "4", "--max-depth", "3"]
WIDTH, HEIGHT = 40, 24


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def write_hdr(path, width=WIDTH, height=HEIGHT):
    """A Radiance picture whose luminance runs over six decades, with colours."""
    data = bytearray()
    for y in range(height):
        for x in range(width):
            exponent = 118 + 20 * x // width
            data += bytes((128 + 5 * y % 128, 200, 255 - 3 * y % 128, exponent))
    with open(path, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        out.write(bytes(data))
    return path


def write_cube(path):
    """The table that changes nothing."""
    with open(path, "w") as out:
        out.write("LUT_3D_SIZE 2\n" + "".join(
            "%d %d %d\n" % (i & 1, i >> 1 & 1, i >> 2) for i in range(8)))
    return path


def operators(farm):
    return farm.cli("tonemap", "--list", "--json", expect=0).json()["operators"]


def png(farm, name):
    return Png(read_bytes(farm.path(name)))


def same(farm, one, other):
    return read_bytes(farm.path(one)) == read_bytes(farm.path(other))


def jpeg_size(data):
    """Width and height of a whole JPEG file."""
    expect(data[:2] == b"\xff\xd8" and data[-2:] == b"\xff\xd9", "no whole JPEG")
    at = 2
    while data[at + 1] not in (0xc0, 0xc1, 0xc2):
        expect(data[at] == 0xff, "no marker")
        at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    height, width = struct.unpack_from(">HH", data, at + 5)
    return width, height


@tests.add
def every_operator():
    """every operator of --list makes a PNG of a small HDR picture; with a file, where it needs one"""
    with Farm() as farm:
        hdr, cube = write_hdr(farm.path("a.hdr")), write_cube(farm.path("a.cube"))
        text = farm.cli("tonemap", "--list", expect=0).out
        for operator in operators(farm):
            name = operator["name"]
            expect(re.search("^%s$" % re.escape(name), text, re.M), text)
            options = []
            if operator["file"] == "required":
                result = farm.cli("tonemap", hdr, "-o", "x.png", "--operator", name)
                expect(result.code == 2 and "--lut" in result.err, result)
                options = ["--lut", cube]
            elif operator["file"] == "none":
                result = farm.cli("tonemap", hdr, "-o", "x.png", "--operator", name, "--lut", cube)
                expect(result.code == 2 and "--lut" in result.err, result)
            farm.cli("tonemap", hdr, "-o", "a.png", "--operator", name, *options, expect=0)
            picture = png(farm, "a.png")
            expect((picture.width, picture.height, picture.bits) == (WIDTH, HEIGHT, 8), name)
            expect(len({p for row in picture.codes for p in row}) > 8, "%s: a flat picture" % name)
            farm.cli("tonemap", hdr, "-o", "b.png", "-t", name, "--threads", "1", *options,
                     expect=0)
            expect(same(farm, "a.png", "b.png"), "%s: with one thread" % name)


@tests.add
def every_parameter():
    """each parameter can be given directly, each word of a choice is taken, wrong ones list them"""
    with Farm() as farm:
        hdr, cube = write_hdr(farm.path("a.hdr"), 16, 8), write_cube(farm.path("a.cube"))
        help_text = farm.cli("help", "tonemap", expect=0, env={"COLUMNS": "9999"}).out
        options_part, direct_part = help_text.split("\nparameters of", 1)
        for operator in operators(farm):
            start = ["tonemap", hdr, "-t", operator["name"], "-o"]
            if operator["file"] == "required":
                start[2:2] = ["--lut", cube]
            for p in operator["parameters"]:
                option = "--" + p["name"]
                taken = re.search("%s " % option, options_part)
                expect(taken or re.search("%s VALUE .*%s:" % (option, operator["name"]),
                                          direct_part.replace("\n", " ")), option)
                for value in p.get("choices", [p["default"]]):
                    # A word may need a file that is not there.
                    result = farm.cli(*start, "a.png", "-p", "%s=%s" % (p["name"], value))
                    expect(result.code == 0 or "choices" in p and result.code == 2 and
                           "--lut" in result.err, result)
                    if result.code == 0 and not taken:
                        farm.cli(*start, "b.png", option, value, expect=0)
                        expect(same(farm, "a.png", "b.png"), option)
                wrong = farm.cli(*start, "x.png", "-p", "%s=nonsense" % p["name"])
                expect(wrong.code == 2 and p["name"] in wrong.err, wrong)
                for word in p.get("choices", []):
                    expect(word in wrong.err, wrong)
            wrong = farm.cli(*start, "x.png", "-p", "nonsense=1")
            expect(wrong.code == 2 and all(p["name"] in wrong.err for p in operator["parameters"]),
                   wrong)
        wrong = farm.cli("tonemap", hdr, "-o", "x.png", "--operator", "gamma", "--key", "1")
        expect(wrong.code == 2 and "--key" in wrong.err and "gain" in wrong.err, wrong)
        expect(not os.path.exists(farm.path("x.png")), "a picture in spite of an error")


@tests.add
def documented_parameters():
    """docs/TONEMAPPING.md and --list have the same parameters, ranges, words and presets"""
    with open(os.path.join(ROOT, "docs/TONEMAPPING.md")) as source:
        sections = re.findall(r"^### ([\w, -]+)\n(.*?)(?=^##)", source.read(), re.M | re.S)
    documented = {}
    for titles, text in sections:
        text = " ".join(text.split())
        # A row of a table, or a bracket behind the name: `white` (0.1..1000, preset 11.2).
        found = re.findall(r"\| `([\w-]+)` \| ([^|]+) \| ([^|]+) \|", text)
        found += re.findall(r"`([\w-]+)` \(?([^()|]{3,30}?)[,;] preset ([^ );]+)", text)
        for name, values, preset in found:
            preset = preset.strip("`")
            if ".." in values:
                values, preset = [float(v) for v in values.split("..")], float(preset)
            else:
                values = re.findall(r"`([\w-]+)`", values)
            documented.setdefault(titles, {})[name] = (values, preset)
    with Farm() as farm:
        program = {op["name"]: {p["name"]: (p.get("choices") or [p["min"], p["max"]], p["default"])
                                for p in op["parameters"]} for op in operators(farm)}
    seen = set()
    for titles, parameters in documented.items():
        names = titles.split(", ")
        wanted = {k: v for name in names for k, v in program[name].items()}
        expect(parameters == wanted, "%s: documented %s, the program has %s" % (
            titles, parameters, wanted))
        seen.update(names)
    expect(all(name in seen or not p for name, p in program.items()), (seen, program.keys()))


@tests.add
def formats():
    """the name's ending says the format: 8 and 16 bits of PNG, JPEG, EXR of linear display light"""
    with Farm() as farm:
        hdr = write_hdr(farm.path("a.hdr"))
        start = ["tonemap", hdr, "--operator", "linear", "-o"]
        farm.cli(*start, "a.png", "--no-dither", expect=0)
        farm.cli(*start, "b.png", "--no-dither", "--bits", "16", expect=0)
        shallow, deep = png(farm, "a.png"), png(farm, "b.png")
        expect((shallow.bits, deep.bits) == (8, 16), "bits")
        for a, b in zip(shallow.codes, deep.codes):
            expect(all(abs(v / 255 - w / 65535) <= 0.5 / 255 + 1e-6 for v, w in zip(a, b)), "codes")
        expect(any(w % 257 for row in deep.codes for w in row), "16 bits that hold 8")
        farm.cli(*start, "c.png", expect=0)
        expect(not same(farm, "a.png", "c.png"), "dither does nothing")
        farm.cli("tonemap", hdr, "d.png", "-t", "linear", expect=0)  # the older way to say it
        expect(same(farm, "c.png", "d.png"), "two arguments")
        sizes = []
        for quality in ("30", "95"):
            farm.cli(*start, "a.jpeg", "--quality", quality, expect=0)
            data = read_bytes(farm.path("a.jpeg"))
            expect(jpeg_size(data) == (WIDTH, HEIGHT), "JPEG")
            sizes.append(len(data))
        expect(sizes[0] < sizes[1], sizes)
        farm.cli(*start, "a.exr", expect=0)
        light = read_exr(farm.path("a.exr"))
        for c, name in enumerate("RGB"):
            values = light.values(name)
            for y, row in enumerate(deep.codes):
                for x in range(WIDTH):
                    v = values[y * WIDTH + x]
                    code = 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055
                    expect(abs(code - row[3 * x + c] / 65535) < 2e-5, "EXR")


@tests.add
def common_options():
    """exposure, metering, white balance and percentile do what they say"""
    with Farm() as farm:
        hdr = write_hdr(farm.path("a.hdr"))

        def values(*options):
            farm.cli("tonemap", hdr, "-t", "linear", "-o", "a.exr", *options, expect=0)
            picture = read_exr(farm.path("a.exr"))
            return [picture.values(c) for c in "RGB"]
        plain, brighter = values(), values("--exposure", "1")
        expect(all(b == min(2 * a, 1) for p, q in zip(plain, brighter) for a, b in zip(p, q)), "+1")
        warm = values("--white-balance", "3200")
        expect(sum(warm[2]) / sum(warm[0]) > sum(plain[2]) / sum(plain[0]), "white balance")
        dark = values("--auto-exposure", "percentile", "--percentile", "100")
        bright = values("--auto-exposure", "percentile", "--percentile", "50")
        expect(sum(map(sum, dark)) < sum(map(sum, bright)), "percentile")
        expect(max(max(c) for c in dark) > 0.9, "the brightest pixel")
        key = values("--auto-exposure", "key")
        expect(key not in (plain, dark, bright), "key")


@tests.add
def wrong_pictures():
    """bad files and options name what is wrong, and exit as documented"""
    with Farm() as farm:
        hdr = write_hdr(farm.path("a.hdr"))
        broken = farm.path("broken.exr")
        with open(broken, "wb") as out:
            out.write(b"\x76\x2f\x31\x01" + bytes(20))
        bad_cube = farm.path("bad.cube")
        with open(bad_cube, "w") as out:
            out.write("LUT_3D_SIZE two\n")
        takes_file = [o["name"] for o in operators(farm) if o["file"] == "required"]
        cases = [
            (3, "missing.exr", ["missing.exr", "-o", "x.png"]),
            (3, "broken.exr", [broken, "-o", "x.png"]),
            (2, ".png", [hdr, "-o", "x.tif"]),
            (2, ".png", [hdr, "-o", "x"]),
            (2, "-o", [hdr]),
            (2, "x.png", [hdr, "x.png", "-o", "y.png"]),
            (8, "nowhere", [hdr, "-o", "/proc/nowhere/x.png"]),
            (2, "--bits", [hdr, "-o", "x.jpg", "--bits", "16"]),
            (2, "--bits", [hdr, "-o", "x.png", "--bits", "12"]),
            (2, "--quality", [hdr, "-o", "x.png", "--quality", "90"]),
            (2, "--quality", [hdr, "-o", "x.jpg", "--quality", "101"]),
            (2, "--no-dither", [hdr, "-o", "x.exr", "--no-dither"]),
            (2, "--sweep", [hdr, "-o", "x.png", "--tile-width", "100"]),
            (2, "there are", [hdr, "-o", "x.png", "--operator", "nonsense"]),
            (2, "--white-balance", [hdr, "-o", "x.png", "--white-balance", "100"]),
            (2, "--auto-exposure", [hdr, "-o", "x.png", "-t", "linear", "--percentile", "5"]),
            (2, "--lut", [hdr, "-o", "x.png", "-t", "linear", "--lut", bad_cube]),
            (2, "--sweep", [hdr, "-o", "x.png", "--sweep", "key"]),
            (2, "--sweep", [hdr, "-o", "x.png", "--sweep", "key=1,,2"]),
            (2, "nonsense", [hdr, "-o", "x.png", "--sweep", "nonsense=1,2"]),
            (2, "nonsense", [hdr, "-o", "x.png", "--sweep", "operator=linear,nonsense"]),
            (2, "key", [hdr, "-o", "x.png", "--sweep", "key=1,1e9"]),
            (2, "exposure", [hdr, "-o", "x.png", "--sweep", "exposure=1,x"]),
            (2, "twice", [hdr, "-o", "x.png", "--sweep", "key=1", "--sweep", "key=2"]),
            (2, "swept", [hdr, "-o", "x.png", "--sweep", "key=1", "--key", "2"]),
            (2, "swept", [hdr, "-o", "x.png", "--sweep", "operator=all", "-t", "linear"]),
            (2, "gain", [hdr, "-o", "x.png", "--sweep", "operator=linear,reinhard02", "--gain",
                         "2"]),
            (2, "3 sweeps", [hdr, "-o", "x.png", "--sweep", "key=1", "--sweep", "white=2",
                             "--sweep", "exposure=1"]),
        ]
        for name in takes_file:
            cases.append((3, "bad.cube", [hdr, "-o", "x.png", "-t", name, "--lut", bad_cube]))
            cases.append((3, "missing.cube", [hdr, "-o", "x.png", "-t", name, "--lut",
                                              "missing.cube"]))
        for code, word, arguments in cases:
            result = farm.cli("tonemap", *arguments)
            expect(result.code == code and word in result.err and result.err.count("\n") == 1 and
                   result.out == "", result)
        expect(not os.path.exists(farm.path("x.png")), "a picture in spite of an error")


def distinct_tiles(sheet, columns, rows, left, top, step_x, step_y, width, height):
    tiles = [str(sheet.part(left + c * step_x, top + r * step_y, width, height))
             for r in range(rows) for c in range(columns)]
    return len(set(tiles)) == len(tiles)


@tests.add
def sweeps():
    """one sweep is a row or a grid, two are a table; the tiles are what tonemap makes"""
    with Farm() as farm:
        hdr = write_hdr(farm.path("a.hdr"), 400, 200)
        start = ["tonemap", hdr, "-o", "sheet.png", "--no-dither"]
        # The font's scale is 2 here: margins of 8, lines of 22.
        farm.cli(*start, "--sweep", "key=0.09,0.18,0.36", expect=0)
        sheet = png(farm, "sheet.png")
        expect((sheet.width, sheet.height) == (8 + 3 * 408, 16 + 22 + 222 + 8),
               (sheet.width, sheet.height))
        expect(distinct_tiles(sheet, 3, 1, 8, 60, 408, 0, 400, 200), "tiles")
        # At the picture's own width a tile is the picture.
        farm.cli("tonemap", hdr, "-o", "one.png", "--key", "0.18", "--no-dither", expect=0)
        expect(sheet.part(8 + 408, 60, 400, 200) == png(farm, "one.png").codes, "the middle one")
        farm.cli(*start, "--sweep", "exposure=-2,-1,0,1,2,3", "--tile-width", "100", expect=0)
        sheet = png(farm, "sheet.png")
        expect(sheet.width == 4 + 3 * 104 and sheet.height > 2 * 50, (sheet.width, sheet.height))
        farm.cli(*start, "--sweep", "exposure=-1,0,1", "--sweep", "key=0.09,0.20",
                 "--tile-width", "200", expect=0)
        sheet = png(farm, "sheet.png")
        left = 4 + 6 * 8 - 1 + 4  # the scale is 1, "key=0.09" the longest label of a row
        top = 2 * 4 + 11 + 11
        expect((sheet.width, sheet.height) == (left + 3 * 204, top + 2 * 104),
               (sheet.width, sheet.height))
        expect(distinct_tiles(sheet, 3, 2, left, top, 204, 104, 200, 100), "tiles")
        count = sum(o["file"] != "required" for o in operators(farm))
        farm.cli(*start, "--sweep", "operator=all", "--sweep", "exposure=0", "--tile-width", "20",
                 "--gain", "1.5", expect=0)
        before = read_bytes(farm.path("sheet.png"))
        expect(png(farm, "sheet.png").width > count * 20, "all operators")
        farm.cli(*start, "--sweep", "operator=all", "--sweep", "exposure=0", "--tile-width", "20",
                 "--gain", "1.5", "--threads", "1", expect=0)
        expect(read_bytes(farm.path("sheet.png")) == before, "with one thread")
        # Sheets in the other formats, and of a picture smaller than its label.
        farm.cli("tonemap", hdr, "-o", "sheet.jpg", "--sweep", "key=1,2", expect=0)
        expect(jpeg_size(read_bytes(farm.path("sheet.jpg")))[0] == 8 + 2 * 408, "JPEG")
        farm.cli("tonemap", hdr, "-o", "sheet.exr", "--sweep", "key=1,2", expect=0)
        expect(read_exr(farm.path("sheet.exr")).width == 8 + 2 * 408, "EXR")
        tiny = write_hdr(farm.path("tiny.hdr"), 1, 1)
        farm.cli("tonemap", tiny, "-o", "tiny.png", "--sweep", "operator=reinhard02,linear",
                 expect=0)
        expect(png(farm, "tiny.png").width == 4 + 2 * (6 * 10 - 1 + 4), "tiny")


def fetched(farm, number, folder, *options):
    """Develop and fetch; name -> bytes."""
    result = farm.cli("develop", number, "-o", folder, "--json", *options, expect=0).json()
    return {os.path.basename(f): read_bytes(farm.path(f)) for f in result["files"]}


@tests.add
def develop():
    """a job's pictures are made again: the same bytes as tonemap makes of its EXR, again and again"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-2", "-o", "pic")
        farm.wait_for_job(number)
        first = farm.fetch(number, "first")
        expect(sorted(map(os.path.basename, first)) == [
            "pic-0001.exr", "pic-0001.png", "pic-0002.exr", "pic-0002.png"], first)
        ways = [["--operator", "gamma", "--gamma", "1.6"],
                ["--tonemap", "reinhard02", "-p", "key=0.4", "--exposure", "1"],
                ["-t", "linear", "--auto-exposure", "key", "--white-balance", "4000"]]
        for o in operators(farm):
            way = ["-t", o["name"]]
            if o["file"] == "required":
                way += ["--lut", write_cube(farm.path("a.cube"))]
            ways.append(way)
        for revision, way in enumerate(ways, 1):
            made = fetched(farm, number, "made", *way)
            expect(sorted(made) == ["pic-0001.png", "pic-0002.png"], list(made))
            job = farm.job(number)
            expect(job["revision"] == revision and job["frames_developed"] == 2 and
                   job["develop_error"] == "", job)
            for name, data in made.items():
                farm.cli("tonemap", "first/" + name.replace("png", "exr"), "-o", "mine.png", *way,
                         expect=0)
                expect(read_bytes(farm.path("mine.png")) == data, "%s: %s" % (way, name))
        again = [fetched(farm, number, "again", *ways[0]) for _ in range(2)]
        other = fetched(farm, number, "again", *ways[1])
        expect(again[0] == again[1] != other, "developed twice")
        # Deep PNG and JPEG; what is not said of the files stays so the next time.
        made = fetched(farm, number, "made", "--format", "jpg,png", "--jpeg-quality", "70",
                       "--png-bits", "16", "-t", "gamma")
        expect(len(made) == 4 and Png(made["pic-0001.png"]).bits == 16, list(made))
        farm.cli("tonemap", "first/pic-0002.exr", "-o", "mine.jpg", "--quality", "70", "-t", "gamma",
                 expect=0)
        expect(read_bytes(farm.path("mine.jpg")) == made["pic-0002.jpg"], "JPEG")
        made = fetched(farm, number, "made", "-t", "linear")
        expect(len(made) == 4 and Png(made["pic-0001.png"]).bits == 16, list(made))
        output = farm.job(number)["output"]
        expect((output["tonemap"], output["parameters"], output["jpeg_quality"]) ==
               ("linear", {}, 70), output)
        everything = farm.fetch(number, "everything")
        expect(len(everything) == 6, everything)
        expect(same(farm, "everything/pic-0001.exr", "first/pic-0001.exr"), "the EXR changed")
        # After a restart it is as it was, and goes on.
        farm.coordinator.stop()
        farm.restart_coordinator()
        expect(fetched(farm, number, "again", *ways[0], "--format", "png", "--png-bits", "8") ==
               again[0], "after a restart")
        words = farm.cli("develop", number, "-t", "linear", expect=0).out
        expect("2 frames developed with linear" in words, words)
        expect("will be made" in farm.cli("develop", number, "-t", "gamma", "--no-wait",
                                          expect=0).out, "--no-wait")


@tests.add
def develop_before_the_end():
    """a job in work, or still waiting, is developed, too: previews and frames to come follow"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL, "-o", "later")
        words = farm.cli("develop", number, "--operator", "gamma", "--gain", "0.5", expect=0).out
        expect("will be made with gamma" in words, words)
        farm.start_worker()
        farm.wait_for_job(number)
        exr, made = sorted(farm.fetch(number, "later"))
        farm.cli("tonemap", exr, "-o", "mine.png", "-t", "gamma", "--gain", "0.5", expect=0)
        expect(read_bytes(farm.path("mine.png")) == read_bytes(made), "frames to come")
        number = farm.submit(farm.scene(), "--size", "256x256", "--spp", "1000000")
        wait_for(lambda: farm.job(number)["preview_ready"], "a preview")
        farm.cli("fetch", number, "--preview", "before.png", expect=0)
        farm.cli("develop", number, "-t", "linear", "--exposure", "-60", expect=0)
        farm.cli("fetch", number, "--preview", "after.png", expect=0)
        before, after = png(farm, "before.png"), png(farm, "after.png")
        expect(max(map(max, before.codes)) > 100 and max(map(max, after.codes)) <= 1, "preview")
        expect(farm.job(number)["state"] == "running", "it does not go on")
        farm.cli("cancel", number, expect=0)


@tests.add
def develop_other_formats():
    """jobs without PNG or EXR: what can be developed is, the rest says what to do"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "-o", "raw", "--format", "exr")
        farm.wait_for_job(number)
        expect([os.path.basename(f) for f in farm.fetch(number, "raw")] == ["raw.exr"], "formats")
        result = farm.cli("develop", number, "-t", "gamma")
        expect(result.code == 2 and "--format png" in result.err, result)
        made = fetched(farm, number, "made", "-t", "gamma", "--format", "png")
        farm.cli("tonemap", "raw/raw.exr", "-o", "mine.png", "-t", "gamma", expect=0)
        expect(list(made.values()) == [read_bytes(farm.path("mine.png"))], "PNG of an EXR job")
        number = farm.submit(farm.scene(), *SMALL, "-o", "raw", "--format", "jpg", "--jpeg-quality",
                             "80")
        farm.wait_for_job(number)
        expect(jpeg_size(read_bytes(farm.fetch(number, "jpg")[0])) == (48, 32), "JPEG job")
        result = farm.cli("develop", number, "-t", "gamma", "--format", "exr,png")
        expect(result.code == 2 and "EXR" in result.err, result)
        made = fetched(farm, number, "made", "-t", "gamma", "--format", "png")
        expect(list(made.values()) == [read_bytes(farm.path("mine.png"))], "PNG of a JPEG job")
        result = farm.cli("develop", number, "-t", "reinhard02", "--key", "0.5", connect=False)
        expect(result.code == 2 and "-p key=0.5" in result.err, result)


PBRT = """LookAt 0 1 5  0 1 0  0 1 0
Camera "perspective" "float fov" 40
Film "rgb" "string filename" "x.exr" "integer xresolution" 48 "integer yresolution" 32
  "float iso" 400
WorldBegin
LightSource "infinite" "rgb L" [0.1 0.2 0.3]
Shape "sphere" "float radius" 1
"""


@tests.add
def the_cameras_exposure():
    """what a camera adds to the exposure stays when a job is developed again"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = farm.path("film.pbrt")
        with open(scene, "w") as out:
            out.write(PBRT)
        number = farm.submit(scene, "--spp", "4", "-o", "film", "-t", "linear", "--exposure", "-1")
        output = farm.wait_for_job(number)["output"]
        expect((output["camera_ev"], output["exposure_ev"]) == (2, 1), output)
        exr, _ = sorted(farm.fetch(number, "film"))
        made = fetched(farm, number, "made", "-t", "linear", "--exposure", "1")
        output = farm.job(number)["output"]
        expect((output["camera_ev"], output["exposure_ev"]) == (2, 3), output)
        farm.cli("tonemap", exr, "-o", "mine.png", "-t", "linear", "--exposure", "3", expect=0)
        expect(list(made.values()) == [read_bytes(farm.path("mine.png"))], "the picture")
        expect("the camera's" in farm.cli("show", number, expect=0).out, "show")


@tests.add
def averaged_sequences():
    """averaged pictures are the same with another farm, and after a coordinator is killed"""
    scene = os.path.join(ROOT, "scenes", "features", "motion.gltf")
    options = ["--size", "48x32", "--spp", "4", "--frames", "0-5", "-t", "mantiuk08", "--format",
               "png"]
    pictures = []
    for workers, killed in ((1, False), (3, True)):
        with Farm() as farm:
            farm.start_coordinator()
            for _ in range(workers):
                farm.start_worker()
            number = farm.submit(scene, *options, "--temporal", "3", "-o", "calm")
            if killed:
                wait_for(lambda: farm.job(number)["frames_done"] > 0, "the first frame")
                farm.coordinator.kill()
                farm.restart_coordinator()
            farm.wait_for_job(number)
            pictures.append([read_bytes(f) for f in sorted(farm.fetch(number, "calm"))])
            if killed:
                continue
            number = farm.submit(scene, *options, "-o", "alone")
            farm.wait_for_job(number)
            alone = [read_bytes(f) for f in sorted(farm.fetch(number, "alone"))]
    expect(len(alone) == 6 and pictures[0] == pictures[1], "another farm, other pictures")
    expect(alone[0] == pictures[0][0], "the first frame has none before it")
    expect(all(a != b for a, b in zip(alone[1:], pictures[0][1:])), "nothing was averaged")


@tests.add
def jobs():
    """submit and render take all of it, and show tells it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        options = ["-t", "gamma", "--gamma", "1.8", "-p", "gain=0.9", "--auto-exposure",
                   "percentile", "--percentile", "95", "--white-balance", "5000", "--format",
                   "exr,png,jpg", "--png-bits", "16", "--jpeg-quality", "60", "--no-dither"]
        number = farm.submit(farm.scene(), *SMALL, "-o", "pic", *options)
        output = farm.wait_for_job(number)["output"]
        wanted = {"tonemap": "gamma", "parameters": {"gamma": 1.8, "gain": 0.9},
                  "metering": "percentile", "metering_percentile": 95, "white_kelvin": 5000,
                  "formats": ["exr", "png", "jpg"], "png_bits": 16, "jpeg_quality": 60,
                  "no_dither": True, "tonemap_file": "", "exposure_ev": 0, "camera_ev": 0}
        expect(all(output[k] == v for k, v in wanted.items()), output)
        shown = farm.cli("show", number, expect=0).out
        for words in ("32-bit EXR, 16-bit PNG, JPEG of quality 60, not dithered", "gamma=1.8",
                      "percentile 95", "5000 K"):
            expect(words in shown, shown)
        files = farm.fetch(number, "out")
        expect(sorted(map(os.path.basename, files)) == ["pic.exr", "pic.jpg", "pic.png"], files)
        mine = ["tonemap", "out/pic.exr"] + options[:12] + ["--no-dither", "-o"]
        farm.cli(*mine, "mine.png", "--bits", "16", expect=0)
        farm.cli(*mine, "mine.jpg", "--quality", "60", expect=0)
        expect(same(farm, "mine.png", "out/pic.png") and same(farm, "mine.jpg", "out/pic.jpg"),
               "not what tonemap makes")
        for o in operators(farm):
            if o["file"] == "required":
                number = farm.submit(farm.scene(), *SMALL, "-t", o["name"], "--lut",
                                     write_cube(farm.path("a.cube")))
                expect(farm.wait_for_job(number)["output"]["tonemap_file_name"] == "a.cube", "lut")
                expect("a.cube" in farm.cli("show", number, expect=0).out, "lut")
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-3", "--temporal", "3", "-o", "t")
        expect(farm.wait_for_job(number)["output"]["temporal"] == 3, "temporal")
        wait_for(lambda: farm.job(number)["frames_developed"] == 3, "the pictures")
        expect(len(farm.fetch(number, "temporal")) == 6, "temporal")
        expect("averaged over 3 frames" in farm.cli("show", number, expect=0).out, "temporal")
        farm.cli("render", farm.scene(), *SMALL, "-o", "one.jpg", expect=0)
        expect(jpeg_size(read_bytes(farm.path("one.jpg"))) == (48, 32), "render -o one.jpg")
        farm.cli("render", farm.scene(), *SMALL, "--format", "png,jpg", "-o", "two/", "--frames",
                 "1-3", "--temporal", "2", expect=0)
        expect(sorted(os.listdir(farm.path("two"))) == sorted(
            "tiny-000%d.%s" % (n, e) for n in (1, 2, 3) for e in ("jpg", "png")), "two formats")


if __name__ == "__main__":
    tests.run()
