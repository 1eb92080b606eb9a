"""Lights without power leave the picture black, and the brightest ones lose no sample."""
import os
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Failure, Tests

tests = Tests()
VIEW = ('Film "rgb" "integer xresolution" 16 "integer yresolution" 16\n'
        'LookAt 0 0 5 0 0 0 0 1 0\nCamera "perspective"\nWorldBegin\n')
FLOOR = ('Material "diffuse"\n'
         'Shape "trianglemesh" "point3 P" [-2 -2 0 2 -2 0 0 2 0] "integer indices" [0 1 2]\n')
LIGHTS = {
    "point": 'LightSource "point" "rgb I" [0 0 0]\n',
    "distant": 'LightSource "distant" "float scale" 0\n',
    "infinite": 'LightSource "infinite" "rgb L" [0 0 0]\n',
    "area": 'AttributeBegin AreaLightSource "diffuse" "float scale" 0\n'
            'Shape "sphere" AttributeEnd\n',
}


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def write(path, content):
    with open(path, "wb") as out:
        out.write(content if isinstance(content, bytes) else content.encode())
    return path


def exr_file(width, height, value_at):
    """A grey OpenEXR file of floats, uncompressed: channels B, G, R alike."""
    def attribute(name, kind, data):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(data)) + data
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(c + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for c in (b"B", b"G", b"R"))
    head = (struct.pack("<ii", 20000630, 2) + attribute(b"channels", b"chlist", channels + b"\0") +
            attribute(b"compression", b"compression", b"\0") +
            attribute(b"dataWindow", b"box2i", box) + attribute(b"displayWindow", b"box2i", box) +
            attribute(b"lineOrder", b"lineOrder", b"\0") +
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)) +
            attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)) +
            attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0")
    line = 12 * width
    offsets = b"".join(struct.pack("<Q", len(head) + 8 * height + (8 + line) * y)
                       for y in range(height))
    rows = b"".join(struct.pack("<ii", y, line) +
                    struct.pack("<%df" % width, *[value_at(x, y) for x in range(width)]) * 3
                    for y in range(height))
    return head + offsets + rows


CUBE = """v 2 3 -1
v 4 3 -1
v 4 5 -1
v 2 5 -1
v 2 3 1
v 4 3 1
v 4 5 1
v 2 5 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def render(farm, scene, *options):
    out = os.path.splitext(scene)[0] + "-picture.exr"
    result = farm.cli("render", scene, "-o", out, "--spp", "16", "--json", *options, expect=0)
    return read_exr(out), result


@tests.add
def no_power():
    """a file whose lights have no power renders black, with a warning, and gets no other light"""
    with Farm() as farm:
        for name, light in LIGHTS.items():
            picture, result = render(farm, write(farm.path(name + ".pbrt"), VIEW + light + FLOOR))
            expect(all(v == 0 for c in "RGB" for v in picture.values(c)), name)
            expect("no light" not in result.err and "any power" in result.err, result)
        # A file that has none at all gets a studio's light, which has a shape, or an even white one.
        none = write(farm.path("none.pbrt"), VIEW + FLOOR)
        picture, result = render(farm, none)
        expect(min(picture.values("G")) > 0 and "soft studio light" in result.err, result)
        picture, result = render(farm, none, "--studio", "off")
        expect(max(picture.values("G")) > 0 and "an even white environment" in result.err, result)


@tests.add
def model_alone():
    """a model that comes without camera and light has a picture that shows it: on a ground, neither white nor even"""
    with Farm() as farm:
        scene = write(farm.path("cube.obj"), CUBE)
        studio, result = render(farm, scene, "--size", "96x72", "--aov", "normal")
        expect("neither camera nor light" in result.err, result)
        # The ground fills what the cube leaves.
        expect(all(any(n) for n in zip(*(studio.values("N." + c) for c in "XYZ"))), "something is not covered")
        even, _ = render(farm, scene, "--size", "96x72", "--studio", "off")
        contrast = spread(sorted(studio.values("G")))
        expect(contrast > 3, contrast)
        expect(sorted(even.values("G"))[len(even.values("G")) // 2] == 1, "the sky is white")


def spread(values):
    """the ratio of the bright to the dark, without the noisiest"""
    return values[len(values) * 99 // 100] / max(values[len(values) // 100], 1e-6)


@tests.add
def black_map():
    """a black environment map that the user gives is black, not white"""
    with Farm() as farm:
        scene = write(farm.path("none.pbrt"), VIEW + FLOOR)
        sky = write(farm.path("black.exr"), exr_file(8, 4, lambda x, y: 0))
        picture, result = render(farm, scene, "--env", sky)
        expect(all(v == 0 for c in "RGB" for v in picture.values(c)), "not black")
        expect("any power" in result.err, result)


@tests.add
def brightest_map():
    """no sample of a map of the largest floats is lost, however directions are chosen"""
    with Farm() as farm:
        scene = write(farm.path("none.pbrt"), VIEW + FLOOR)
        for name, value in (("half", lambda x, y: 3e38 if x < 4 else 1), ("all", lambda x, y: 3e38),
                            ("sun", lambda x, y: 3e38 if (x, y) == (3, 1) else 0)):
            sky = write(farm.path(name + ".exr"), exr_file(8, 4, value))
            for how in ("importance", "uniform", "bsdf"):
                picture, result = render(farm, scene, "--env", sky, "--env-sampling", how)
                expect(result.json()["job"]["work"]["health"] == [], (name, how, result))
                expect(picture.check() > 1e27, (name, how))
                expect("above 1e+30" in result.err, result)


tests.run()
