"""What other programs read of an EXR: the camera and the rate of its header, and names as Blender has them."""
import shutil
import struct
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Failure, Tests

tests = Tests()
SIZE = ["--size", "48x32", "--spp", "4", "-q"]
SHIFT = (300.0, -40.0, 25.0)


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def write_model(path):
    with open(path, "w") as out:
        for corner in [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 0.75, 0.5)]:
            out.write("v %.17g %.17g %.17g\n" % tuple(a + b for a, b in zip(corner, SHIFT)))
        out.write("f 1 2 3 4\nf 1 5 2\nf 2 5 3\nf 3 5 4\nf 4 5 1\n")


def through(matrix, point):
    """OpenEXR's vectors are rows."""
    return [sum(point[k] * matrix[4 * k + c] for k in range(3)) + matrix[12 + c] for c in range(4)]


def check_camera(picture, x0, y0, whole):
    """Each pixel's place, taken through the header's matrices, is its depth and its place in the display window."""
    attributes = picture.attributes
    to_camera = struct.unpack("<16f", attributes["worldToCamera"])
    to_ndc = struct.unpack("<16f", attributes["worldToNDC"])
    origin = struct.unpack("<3d", attributes["azulejo:origin"])
    depth = picture.values("Z")
    places = list(zip(*(picture.values("P." + axis) for axis in "XYZ")))
    seen = 0
    for at, z in enumerate(depth):
        if z == 0:
            continue
        seen += 1
        world = [a + b for a, b in zip(places[at], origin)]
        expect(abs(through(to_camera, world)[2] - z) < 2e-4 * abs(z) + 1e-4, (through(to_camera, world), z))
        x, y, _, w = through(to_ndc, world)
        pixel = x / w * whole[0] - 0.5, y / w * whole[1] - 0.5
        off = max(abs(pixel[0] - x0 - at % picture.width), abs(pixel[1] - y0 - at // picture.width))
        expect(off < 1.7, "pixel %d of the picture is at %s" % (at, pixel))  # the filter is 1.5 pixels wide each way
    expect(seen > 50, seen)


@tests.add
def camera_in_the_header():
    """worldToCamera and worldToNDC lead from the file's coordinates to depth and pixel, in a region too; framesPerSecond"""
    with Farm() as farm:
        model = farm.path("model.obj")
        write_model(model)
        for words, corner, rate in (([], (0, 0), (24, 1)), (["--region", "12,8,20,16", "--fps", "23.976"], (12, 8), (24000, 1001)),
                                    (["--fps", "12.5"], (0, 0), (12500, 1000))):
            farm.cli("render", model, *SIZE, "--aov", "depth,position", *words, "-o", farm.path("out"),
                     expect=0, connect=False)
            picture = read_exr(farm.path("out.exr"))
            check_camera(picture, corner[0], corner[1], (48, 32))
            expect(struct.unpack("<iI", picture.attributes["framesPerSecond"]) == rate, rate)


@tests.add
def names_as_blender_has_them():
    """--exr-names blender renames the channels and nothing else; what reads the file finds the picture"""
    with Farm() as farm:
        scene, words = farm.scene(), ["--alpha", "--aov", "depth,normal,position,object-id,samples,error,uv,denoising-albedo"]
        pictures = []
        for names in ("plain", "blender"):
            farm.cli("render", scene, *SIZE, *words, "--exr-names", names, "-o", farm.path(names), expect=0, connect=False)
            pictures.append(read_exr(farm.path(names + ".exr")))
        plain, blender = pictures
        expect(blender.attributes["azulejo:exrNames"] == b"blender" and "azulejo:exrNames" not in plain.attributes, "header")
        expect(b"--exr-names blender" in blender.attributes["azulejo:command"], blender.attributes["azulejo:command"])
        pairs = {"R": "Combined.R", "A": "Combined.A", "Z": "Depth.Z", "N.X": "Normal.X", "P.Y": "Position.Y",
                 "objectId.X": "IndexOB.X", "samples.Y": "samples.Y", "error.G": "error.G", "uv.U": "uv.U",
                 "Denoising Albedo.B": "Denoising Albedo.B", "tileError.Y": "tileError.Y"}
        for old, new in pairs.items():
            expect(plain.channels[old] == blender.channels["ViewLayer." + new], (old, new))
        expect(len(plain.channels) == len(blender.channels), blender.channels.keys())
        expect(all(name.startswith("ViewLayer.") for name in blender.channels), blender.channels.keys())
        for names in ("plain", "blender"):
            farm.cli("tonemap", farm.path(names + ".exr"), "-o", farm.path(names + "-again.png"), expect=0, connect=False)
        with open(farm.path("plain-again.png"), "rb") as one, open(farm.path("blender-again.png"), "rb") as two:
            expect(one.read() == two.read(), "tone mapped otherwise")
        result = farm.cli("submit", scene, "--exr-names", "nuke")
        expect(result.code == 2 and "plain" in result.err and "blender" in result.err, result)
        if shutil.which("oiiotool"):
            said = subprocess.run(["oiiotool", "--info", "-v", farm.path("blender.exr")], capture_output=True, text=True, check=True).stdout
            expect("worldtocamera" in said.lower() and "ViewLayer.Combined.R" in said, said)


@tests.add
def develops_again():
    """a picture with Blender's names and alpha, stored on the coordinator, is developed again"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SIZE[:-1], "--alpha", "--exr-names", "blender")
        farm.cli("watch", number, "-q", expect=0)
        farm.cli("develop", number, "--exposure", "1", expect=0)
        farm.cli("fetch", number, "-o", farm.path("got.png"), expect=0)
        with open(farm.path("got.png"), "rb") as source:
            expect(source.read(8) == b"\x89PNG\r\n\x1a\n", "no PNG")


if __name__ == "__main__":
    tests.run()
