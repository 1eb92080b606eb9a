#!/usr/bin/env python3
"""Writes the scenes of docs/LIQUIDS.md: a tumbler of water in three ways, a wine glass in several
meshes, ice in water. The geometry of each is in a .bin of its name.

    scenes/liquids/make_liquids.py [FOLDER]
"""
import json
import math
import operator
import os
import random
import struct
import sys

SEGMENTS = 48


def lathe(profile):
    """A surface of revolution about y. The profile runs counter-clockwise in the plane of radius and
    height as seen from +z, so that its outside is to the right; ends on the axis close it. Each of
    its segments has vertices of its own; normals are smooth where it bends by less than 40 degrees."""
    ways = []
    for (r, y), (q, z) in zip(profile, profile[1:]):
        length = math.hypot(q - r, z - y)
        ways.append(((z - y) / length, (r - q) / length))
    positions, normals, indices = [], [], []
    for i, (one, way) in enumerate(zip(zip(profile, profile[1:]), ways)):
        rings = []
        for end, other in ((0, i - 1), (1, i + 1)):
            n = way
            if 0 <= other < len(ways) and sum(map(operator.mul, way, ways[other])) > 0.76:
                n = (way[0] + ways[other][0], way[1] + ways[other][1])
            if one[end][0] == 0:
                n = (0, math.copysign(1, n[1]))
            length = math.hypot(*n)
            rings.append(len(positions))
            for k in range(SEGMENTS):
                a = 2 * math.pi * k / SEGMENTS
                positions.append((one[end][0] * math.cos(a), one[end][1],
                                  one[end][0] * math.sin(a)))
                normals.append((n[0] / length * math.cos(a), n[1] / length,
                                n[0] / length * math.sin(a)))
        a, b = rings
        for k in range(SEGMENTS):
            n = (k + 1) % SEGMENTS
            if one[0][0] > 0:
                indices += [a + k, b + n, a + n]
            if one[1][0] > 0:
                indices += [a + k, b + k, b + n]
    return positions, indices, normals


def arc(cx, cy, r, start, end, steps):
    return [(cx + r * math.cos(math.radians(start + (end - start) * i / steps)),
             cy + r * math.sin(math.radians(start + (end - start) * i / steps)))
            for i in range(steps + 1)]


def box(size, centre, turn):
    """A cube turned about two axes."""
    corners, indices = [], []
    sa, ca, sb, cb = math.sin(turn[0]), math.cos(turn[0]), math.sin(turn[1]), math.cos(turn[1])
    for i in range(8):
        x, y, z = [size * ((i >> a & 1) - 0.5) for a in range(3)]
        x, z = ca * x + sa * z, ca * z - sa * x
        y, z = cb * y + sb * z, cb * z - sb * y
        corners.append((x + centre[0], y + centre[1], z + centre[2]))
    for a, b, c, d in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2),
                       (1, 3, 7, 5)):
        indices += [a, b, c, a, c, d]
    return corners, indices


def quad(corners):
    return list(corners), [0, 1, 2, 0, 2, 3]


class Scene:
    def __init__(self):
        self.bin = bytearray()
        self.doc = {"asset": {"version": "2.0", "generator": "azulejo scenes",
                              "copyright": "Azulejo authors, Apache-2.0"},
                    "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
                    "materials": [], "accessors": [], "bufferViews": [],
                    "cameras": [{"type": "perspective",
                                 "perspective": {"yfov": 0.42, "znear": 0.01}}]}
        self.extensions = set()

    def accessor(self, rows, kind, code):
        flat = [x for row in rows for x in row] if kind == "VEC3" else rows
        view = {"buffer": 0, "byteOffset": len(self.bin)}
        self.bin += struct.pack("<%d%s" % (len(flat), code), *flat)
        view["byteLength"] = len(self.bin) - view["byteOffset"]
        while len(self.bin) % 4:
            self.bin.append(0)
        self.doc["bufferViews"].append(view)
        item = {"bufferView": len(self.doc["bufferViews"]) - 1, "count": len(rows), "type": kind,
                "componentType": 5126 if code == "f" else 5123}
        if code == "f":
            kept = [struct.unpack("<f", struct.pack("<f", x))[0] for x in flat]
            item["min"] = [min(kept[c::3]) for c in range(3)]
            item["max"] = [max(kept[c::3]) for c in range(3)]
        self.doc["accessors"].append(item)
        return len(self.doc["accessors"]) - 1

    def material(self, name, color=(0.8, 0.8, 0.8), emission=0, **rest):
        m = {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*color, 1],
                                                    "metallicFactor": 0, "roughnessFactor": 1}}
        if emission:
            m["emissiveFactor"] = [1, 1, 1]
            self.extension(m, "KHR_materials_emissive_strength", {"emissiveStrength": emission})
        self.doc["materials"].append({**m, **rest})
        return len(self.doc["materials"]) - 1

    def extension(self, m, name, values):
        m.setdefault("extensions", {})[name] = values
        self.extensions.add(name)

    def volume(self, name, ior, color=None, distance=None, priority=None):
        m = {"name": name, "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0}}
        self.extension(m, "KHR_materials_transmission", {"transmissionFactor": 1})
        self.extension(m, "KHR_materials_ior", {"ior": ior})
        volume = {"thicknessFactor": 1}
        if color:
            volume.update(attenuationColor=color, attenuationDistance=distance)
        self.extension(m, "KHR_materials_volume", volume)
        if priority is not None:
            m["extras"] = {"dielectric_priority": priority}
        self.doc["materials"].append(m)
        return len(self.doc["materials"]) - 1

    def mesh(self, name, parts, translation=None):
        """One node with a primitive for each (shape, material)."""
        primitives = []
        for (positions, indices, *normals), material in parts:
            attributes = {"POSITION": self.accessor(positions, "VEC3", "f")}
            if normals:
                attributes["NORMAL"] = self.accessor(normals[0], "VEC3", "f")
            primitives.append({"attributes": attributes,
                               "indices": self.accessor(indices, "SCALAR", "H"),
                               "material": material})
        self.doc["meshes"].append({"name": name, "primitives": primitives})
        node = {"name": name, "mesh": len(self.doc["meshes"]) - 1}
        if translation:
            node["translation"] = translation
        self.doc["nodes"].append(node)
        self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)

    def stage(self, eye, target):
        """A table in two tones, a wall, a lamp behind and one above; sizes in decimetres."""
        light = self.material("light cloth", (0.75, 0.72, 0.66))
        dark = self.material("dark cloth", (0.1, 0.17, 0.28))
        lamp = self.material("lamp", (0, 0, 0), 9)
        cloth = {light: ([], []), dark: ([], [])}
        for i in range(-7, 7):
            for k in range(-7, 5):
                positions, indices = cloth[dark if (i + k) % 2 else light]
                at = len(positions)
                x, z = 0.5 * i, 0.5 * k
                positions += [(x, 0, z), (x, 0, z + 0.5), (x + 0.5, 0, z + 0.5), (x + 0.5, 0, z)]
                indices += [at + j for j in (0, 1, 2, 0, 2, 3)]
        self.mesh("cloth", [(cloth[light], light), (cloth[dark], dark)])
        self.mesh("wall", [(quad([(-6, -1, -3.5), (6, -1, -3.5), (6, 6, -3.5), (-6, 6, -3.5)]),
                            light)])
        self.mesh("lamps", [(quad([(-3, 1, -3.2), (-1.2, 1, -3.2), (-1.2, 4, -3.2), (-3, 4, -3.2)]),
                             lamp),
                            (quad([(1, 5, -1), (3, 5, -1), (3, 5, 1), (1, 5, 1)]), lamp)])
        z = [eye[a] - target[a] for a in range(3)]
        length = math.sqrt(sum(v * v for v in z))
        z = [v / length for v in z]
        x = [z[2], 0, -z[0]]
        length = math.hypot(x[0], x[2])
        x = [v / length for v in x]
        y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
        self.doc["nodes"].append({"camera": 0, "matrix": [*x, 0, *y, 0, *z, 0, *eye, 1]})
        self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)

    def write(self, folder, name):
        self.doc["buffers"] = [{"uri": name + ".bin", "byteLength": len(self.bin)}]
        self.doc["extensionsUsed"] = sorted(self.extensions)
        with open(os.path.join(folder, name + ".bin"), "wb") as out:
            out.write(self.bin)
        with open(os.path.join(folder, name + ".gltf"), "w", encoding="utf-8") as out:
            json.dump(self.doc, out, indent=1)
            out.write("\n")


# A tumbler 1 dm high: its outside upwards, a round rim, its inside downwards.
WALL = [(0.34 + 0.05 * i / 8, 0.12 + 0.83 * i / 8) for i in range(9)]   # inside, from the bottom up
TUMBLER = ([(0, 0.001)] + arc(0.36, 0.031, 0.03, -90, 0, 4)[:-1] + [(0.39, 0.031)] +
           [(0.43, 0.95)] + arc(0.41, 0.95, 0.02, 0, 180, 8)[1:-1] + WALL[::-1] +
           [(0.3, 0.09), (0.2, 0.085), (0, 0.085)])
LEVEL = 6                                               # of WALL: how far the water reaches
INSIDE = [(0, 0.085), (0.2, 0.085), (0.3, 0.09)] + WALL[:LEVEL + 1]
WATER = dict(ior=1.333, color=[0.55, 0.8, 0.95], distance=0.8)


def tumbler(folder, name, shift):
    """The water's wall lies where the glass's does, or by so much within or outside of it."""
    scene = Scene()
    glass, water = scene.volume("glass", 1.5), scene.volume("water", **WATER)
    body = [(r + (shift if r else 0), y - shift * (y < 0.1)) for r, y in INSIDE]
    scene.mesh("tumbler", [(lathe(TUMBLER), glass)])
    scene.mesh("water", [(lathe(body), water), (lathe([body[-1], (0, body[-1][1])]), water)])
    scene.stage((0.9, 1.3, 3.2), (0, 0.47, 0))
    scene.write(folder, name)


def wine(folder):
    """The glass's inside and outside are two primitives, and so are the wine's surface and its wall,
    which is the glass's."""
    scene = Scene()
    glass = scene.volume("glass", 1.52)
    red = scene.volume("wine", 1.345, [0.55, 0.05, 0.08], 0.25)
    bowl = [(0.42 * math.sin(math.radians(a)), 1.05 - 0.45 * math.cos(math.radians(a)))
            for a in range(15, 136, 10)]                                # inside, upwards
    inside = [(0, 0.6)] + bowl
    outer = [(r + 0.015, y) for r, y in bowl]
    foot = ([(0, 0.001), (0.38, 0.001), (0.4, 0.011), (0.38, 0.02), (0.12, 0.05), (0.045, 0.12),
             (0.035, 0.3), (0.05, 0.5)] + outer[1:])
    rim = [outer[-1], (bowl[-1][0] + 0.0075, bowl[-1][1] + 0.008), bowl[-1]]
    scene.mesh("wine glass", [(lathe(foot + rim[1:]), glass), (lathe(inside[::-1]), glass)])
    level = 7
    scene.mesh("wine", [(lathe(inside[:level + 1]), red),
                        (lathe([inside[level], (0, inside[level][1])]), red)])
    scene.stage((0.9, 1.5, 4.2), (0, 0.72, 0))
    scene.write(folder, "wine")


def ice(folder):
    """Cubes of ice that float: they stand out of the water, so their priority is the higher one."""
    scene = Scene()
    glass, water = scene.volume("glass", 1.5), scene.volume("water", **WATER)
    cube = scene.volume("ice", 1.31, priority=1)
    rng = random.Random(3)
    top = INSIDE[-1][1]
    cubes = [(box(0.2, (0.14 * math.cos(a), top - 0.06 + 0.03 * rng.random(), 0.14 * math.sin(a)),
                  (rng.random() * 1.5, rng.random() * 0.8)), cube)
             for a in (0.4, 2.5, 4.6)]
    scene.mesh("tumbler", [(lathe(TUMBLER), glass)])
    scene.mesh("water", [(lathe(INSIDE + [(0, top)]), water)])
    scene.mesh("ice", cubes)
    scene.stage((0.9, 1.5, 3.2), (0, 0.5, 0))
    scene.write(folder, "ice")


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    tumbler(folder, "water-contact", 0)
    tumbler(folder, "water-overlap", 0.01)
    tumbler(folder, "water-gap", -0.002)
    wine(folder)
    ice(folder)


if __name__ == "__main__":
    main()
