"""A scene in map coordinates, as a user has it: its picture, its header, what is said of it."""
import json
import os
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Failure, Tests

tests = Tests()
CENTRE = (500000.0, -4649776.0, 250.0)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 0.75, 0.5)]


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def write_obj(path, shift):
    with open(path, "w") as out:
        for corner in CORNERS:
            out.write("v %.17g %.17g %.17g\n" % tuple(a + b for a, b in zip(corner, shift)))
        out.write("f 1 2 3 4\nf 1 5 2\nf 2 5 3\nf 3 5 4\nf 4 5 1\n")


@tests.add
def map_coordinates():
    """an OBJ in map coordinates: the picture of the same model at the origin, and where it lies"""
    with Farm() as farm:
        pictures = []
        for name, shift in (("near", (0.0, 0.0, 0.0)), ("far", CENTRE)):
            path = os.path.join(farm.folder, name + ".obj")
            write_obj(path, shift)
            out = os.path.join(farm.folder, name)
            farm.cli("render", path, "--size", "48x32", "--spp", "8", "--aov", "position", "--studio", "off", "-q",
                     "-o", out, expect=0, connect=False)
            picture = read_exr(out + ".exr")
            origin = struct.unpack("<3d", picture.attributes["azulejo:origin"])
            middle = [s + m for s, m in zip(shift, (0.5, 0.375, 0.5))]
            expect(list(origin) == middle, (origin, middle))
            expect(max(abs(v) for axis in "XYZ" for v in picture.values("P." + axis)) < 1,
                   "positions are not relative to the origin")
            pictures.append(picture.bits())
        expect(pictures[0] == pictures[1], "the shifted model gives another picture")
        report = json.loads(farm.cli("import", "--json", path, expect=0, connect=False).out)
        expect(report["origin"] == middle and 0 < report["position_spacing_m"] < 1e-6, report)
        expect(report["degenerate_triangles"] == 0, report)
        shown = farm.cli("import", path, expect=0, connect=False).out
        expect("centre:         500000.5, -4649775.625, 250.5 m" in shown, shown)


if __name__ == "__main__":
    tests.run()
