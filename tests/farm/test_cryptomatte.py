"""--aov cryptomatte: which object and material a pixel shows, by name, as compositors pick them."""
import base64
import json
import os
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import ROOT, Farm, Tests, read_bytes, wait_for
from jobs import MIRROR, LongJob, expect, make_sky, wait_mid_frame
from png import Png

tests = Tests()
FEATURES = os.path.join(ROOT, "scenes", "features")
RANKS = 6
KEYS = {"CryptoObject": "3ae39a5", "CryptoMaterial": "be359d6", "CryptoAsset": "f42029d"}  # of the specification


def murmur(data):
    """MurmurHash3_x86_32 with seed 0."""
    def rotate(x, by):
        return (x << by | x >> 32 - by) & 0xffffffff

    def mix(block):
        return rotate(block * 0xcc9e2d51 & 0xffffffff, 15) * 0x1b873593 & 0xffffffff
    state, whole = 0, len(data) // 4 * 4
    for at in range(0, whole, 4):
        state = (rotate(state ^ mix(struct.unpack_from("<I", data, at)[0]), 13) * 5 + 0xe6546b64) & 0xffffffff
    state ^= mix(int.from_bytes(data[whole:], "little")) ^ len(data)
    for shift, factor in ((16, 0x85ebca6b), (13, 0xc2b2ae35), (16, 1)):
        state = (state ^ state >> shift) * factor & 0xffffffff
    return state


def id_of(name):
    bits = murmur(name.encode())
    return bits ^ 1 << 23 if bits >> 23 & 255 in (0, 255) else bits


class Matte:
    """A picture's layers of one type: pixels[i] = {name or id: share}, ranks[i] = its shares in their order."""

    def __init__(self, picture, layer, view=""):
        key = "cryptomatte/%07x/" % (id_of(view + layer) >> 4)
        said = {k[len(key):]: v.decode() for k, v in picture.attributes.items() if k.startswith(key)}
        expect(said.pop("name") == view + layer, said)
        self.manifest = json.loads(said.pop("manifest"))
        expect(said == {"hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}, said)
        expect(all(int(bits, 16) == id_of(name) for name, bits in self.manifest.items()), self.manifest)
        names = {int(bits, 16): name for name, bits in self.manifest.items()}
        planes = []
        for rank in range(RANKS):
            for letter in ("RG", "BA")[rank % 2]:
                channel = "%s%s%02d.%s" % (view, layer, rank // 2, letter)
                expect(picture.kinds[channel] == 2, channel + " is no 32-bit float")
                planes.append(struct.unpack("<%dI" % (picture.width * picture.height), picture.channels[channel])
                              if letter in "RB" else picture.values(channel))
        self.pixels, self.ranks = [], []
        for row in zip(*planes):
            ids, shares = row[0::2], row[1::2]
            expect(all((i == 0) == (s == 0) for i, s in zip(ids, shares)), row)
            expect(list(shares) == sorted(shares, reverse=True) and sum(shares) <= 1 + 1e-6, row)
            expect(len({i for i in ids if i}) == sum(i != 0 for i in ids), row)
            self.pixels.append({names.get(i, i): s for i, s in zip(ids, shares) if i})
            self.ranks.append(shares)


def write_boards(path):
    """Boards side by side before nothing, one unit a pixel of 32x16: "left" from x = -10 to 0.5, a pixel's centre, and a
    second node "left" below it; an unnamed one from 0.5 to 10; materials "red" and one without a name. The second and third
    are in a node of a node "set"."""
    corners = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0) + struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    boards = [{"name": "left", "mesh": 0, "translation": [-10, 0, 0], "scale": [10.5, 4, 1]},
              {"name": "left", "mesh": 1, "translation": [-10, -4, 0], "scale": [10.5, 4, 1]},
              {"mesh": 1, "translation": [0.5, -4, 0], "scale": [9.5, 8, 1]}]
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 4, 3]}],
        "nodes": boards + [{"camera": 0, "translation": [0, 0, 10]}, {"name": "set", "children": [5]}, {"name": "row", "children": [1, 2]}],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 16, "ymag": 8, "znear": 1, "zfar": 100}}],
        "materials": [{"name": "red", "emissiveFactor": [1, 0, 0]}, {"emissiveFactor": [0, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": m}]} for m in range(2)],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"byteLength": 60, "uri": "data:application/octet-stream;base64," + base64.b64encode(corners).decode()}]}
    with open(path, "w") as out:
        json.dump(scene, out)
    return path


def near(got, wanted, what, within=0.02):
    expect(abs(got - wanted) <= within, "%s: %g instead of %g" % (what, got, wanted))


def check_edges(matte, left, right):
    """Shares of the boards against the pixel filter, which is symmetric and 1.5 pixels wide each way."""
    for y in range(16):
        row = matte.pixels[32 * y:32 * y + 32]
        inside = sum(sum(p.values()) for p in row) / 20  # of the row
        for name, width in ((left, 10.5), (right, 9.5)):
            near(sum(p.get(name, 0) for p in row), width * inside, "row %d of %s" % (y, name), 0.1)
        if 6 <= y < 10:
            expect(row[10] == {left: 1} and row[20] == {right: 1} and row[2] == {} == row[29], (row[10], row[20], row[2]))
            near(row[16][left], 0.5, "left of the edge in a pixel's centre")
            near(row[16][right], 0.5, "right of it")
            near(row[5][left] + row[6][left], 1, "an edge between pixels")
    near(sum(sum(p.values()) for p in matte.pixels), 20 * 8, "the boards' area", 0.5)


@tests.add
def shares_of_known_shapes():
    """coverage of boards has the closed form, sums to alpha, and is under the names of nodes and materials"""
    with Farm() as farm:
        boards = write_boards(farm.path("boards.gltf"))
        farm.cli("render", boards, "--size", "32x16", "--spp", "256", "--aov", "cryptomatte,crypto-asset", "--alpha", "--half", "-o", "picture",
                 connect=False, expect=0)
        picture = read_exr(farm.path("picture.exr"))
        for layer, key in KEYS.items():
            expect("cryptomatte/%s/name" % key in picture.attributes, key)
        things = Matte(picture, "CryptoObject")
        expect(set(things.manifest) == {"left", "object 3"}, things.manifest)
        check_edges(things, "left", "object 3")
        for ranks, alpha in zip(things.ranks, picture.values("A")):
            expect(abs(sum(ranks) - alpha) <= 2 ** -11, (ranks, alpha))
        made = Matte(picture, "CryptoMaterial")
        expect(set(made.manifest) == {"red", "material 2"}, made.manifest)
        near(sum(p.get("red", 0) for p in made.pixels), 10.5 * 4, "the red board's area", 0.5)
        parts = Matte(picture, "CryptoAsset")
        expect(set(parts.manifest) == {"left", "set"}, parts.manifest)
        near(sum(p.get("left", 0) for p in parts.pixels), 10.5 * 4, "the upper board's area", 0.5)
        near(sum(p.get("set", 0) for p in parts.pixels), 20 * 8 - 10.5 * 4, "the set's area", 0.5)
        for a, b in zip(things.pixels, made.pixels):
            near(sum(a.values()), sum(b.values()), "materials and objects", 1e-6)
        expect("azulejo:mattesLost" not in picture.attributes, "lost")


@tests.add
def pictures_of_every_kind():
    """names for Blender, regions, one layer alone, cut-outs, motion, depth of field, panoramas; nothing else changes"""
    with Farm() as farm:
        boards, size = write_boards(farm.path("boards.gltf")), ("--size", "32x16", "--spp", "16")

        def render(scene, out, *options):
            farm.cli("render", scene, *options, "-o", out, connect=False, expect=0)
            return read_exr(farm.path(out + ".exr"))
        plain, whole = render(boards, "plain", *size), render(boards, "whole", *size, "--aov", "cryptomatte")
        expect(all(plain.channels[c] == whole.channels[c] for c in "RGB"), "the picture has other bits")
        expect(read_bytes(farm.path("plain.png")) == read_bytes(farm.path("whole.png")), "the PNG")
        objects = Matte(whole, "CryptoObject")
        blender = render(boards, "blender", *size, "--aov", "cryptomatte", "--exr-names", "blender")
        expect(Matte(blender, "CryptoObject", "ViewLayer.").pixels == objects.pixels, "for Blender")
        part = render(boards, "part", *size, "--aov", "crypto-object", "--region", "5,3,17,9")
        expect(not any("Material" in c for c in part.channels), part.channels.keys())
        wanted = [p for i, p in enumerate(objects.pixels) if 5 <= i % 32 < 22 and 3 <= i // 32 < 12]
        expect(Matte(part, "CryptoObject").pixels == wanted, "a region")
        for name in ("plain", "whole", "blender"):
            farm.cli("tonemap", farm.path(name + ".exr"), "-o", name + "2.png", connect=False, expect=0)
        expect(read_bytes(farm.path("plain2.png")) == read_bytes(farm.path("whole2.png")), "tonemap")
        expect(Png(read_bytes(farm.path("plain2.png"))).codes == Png(read_bytes(farm.path("blender2.png"))).codes, "tonemap")
        farm.cli("compare", farm.path("plain.exr"), farm.path("whole.exr"), connect=False, expect=0)
        for name, options in (("alpha.gltf", ()), ("motion.gltf", ("--shutter", "0.5", "--frames", "3")), ("panorama.pbrt", ()),
                              ("lens.pbrt", ("--lens", "0.02", "--focus", "4"))):
            picture = render(os.path.join(FEATURES, name), name.split(".")[0],
                             "--size", "40x24", "--spp", "16", "--aov", "crypto-material,crypto-asset",
                             "--alpha", *options)
            names = [set(Matte(picture, layer).manifest) for layer in ("CryptoObject", "CryptoAsset")]
            if name == "panorama.pbrt":
                expect(names[0] == {"trianglemesh 1", "trianglemesh 2", "sphere 3", "sphere 4", "sphere 5"} == names[1], names)
            for layer in KEYS:
                matte = Matte(picture, layer)
                expect(any(0 < sum(p.values()) < 1 or len(p) > 1 for p in matte.pixels), name + ": no edges")
                for ranks, alpha in zip(matte.ranks, picture.values("A")):
                    expect(abs(sum(ranks) - alpha) < 1e-5, (name, ranks, alpha))


@tests.add
def the_same_on_every_farm():
    """one worker, three, and a coordinator killed in mid-frame give the same file; so do extend and adaptive jobs"""
    long = LongJob(1.5, "97x61")
    options = ("--aov", "cryptomatte,alpha")
    with Farm() as farm:
        def finish(number, name):
            farm.wait_for_job(number)
            return read_exr(next(f for f in farm.fetch(number, name) if f.endswith(".exr")))
        boards = write_boards(farm.path("boards.gltf"))
        farm.start_coordinator()
        farm.start_worker()
        long.measure(farm)
        size = ("--size", "97x61", "--env", make_sky(farm))
        adaptive = (MIRROR, *size, "--target-error", "20/255", "--spp", "128", *options)
        one = finish(long.submit(farm, *options), "one")
        short = finish(farm.submit(boards, "--size", "96x48", "--spp", "45", *options), "short")
        calm = finish(farm.submit(*adaptive), "calm")
        expect(any(len(p) > 1 for p in Matte(one, "CryptoObject").pixels), "edges")
        farm.start_worker(threads=2)
        farm.start_worker()
        farm.wait_for_workers(3)
        number = long.submit(farm, *options)
        wait_mid_frame(farm, number, 0.2)
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(finish(number, "killed").reproducible == one.reproducible, "a killed coordinator")
        expect(finish(long.submit(farm, *options), "three").reproducible == one.reproducible, "three workers")
        expect(finish(farm.submit(*adaptive), "calm3").reproducible == calm.reproducible, "adaptive")
        number = farm.submit(boards, "--size", "96x48", "--spp", "13", *options)  # which ends with a short pass
        finish(number, "before")
        farm.cli("extend", number, "--spp", "45", expect=0)
        expect(finish(number, "extended").bits() == short.bits(), "extend")
        farm.cli("verify", number, "--tiles", "3", expect=0)
        expect(farm.job(number)["conflicts"] == 0, "conflicts")


tests.run()
