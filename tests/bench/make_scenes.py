"""Scenes that only measurements need, made rather than kept.

    make_scenes.py instances OUT.gltf   49 turned and stretched spheres of one mesh (4 000 triangles
                                        each, so that they stay instances) over a floor, and a lamp
    make_scenes.py empty OUT.gltf       one triangle in front of a camera: what a process costs
    make_scenes.py large OUT.gltf       a wavy floor of half a million triangles
"""
import base64
import json
import math
import struct
import sys


class Maker:
    """Collects meshes, each with positions, normals and indices, into one embedded buffer."""

    def __init__(self, materials):
        self.data = b""
        self.gltf = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [],
            "extensionsUsed": ["KHR_materials_emissive_strength"], "meshes": [],
            "materials": materials, "accessors": [], "bufferViews": [],
            "cameras": [{"type": "perspective",
                         "perspective": {"yfov": 0.7, "aspectRatio": 1, "znear": 0.1}}]}

    def accessor(self, kind, component, code, values, **more):
        packed = struct.pack("<%d%s" % (len(values), code), *values)
        self.gltf["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(packed)})
        self.data += packed
        width = {"SCALAR": 1, "VEC3": 3}[kind]
        self.gltf["accessors"].append(dict(
            bufferView=len(self.gltf["bufferViews"]) - 1, componentType=component, type=kind,
            count=len(values) // width, **more))
        return len(self.gltf["accessors"]) - 1

    def mesh(self, points, normals, triangles, material):
        """Add a mesh; returns its number."""
        bounds = {"min": [min(p[k] for p in points) for k in range(3)],
                  "max": [max(p[k] for p in points) for k in range(3)]}
        # Bounds must be those of the floats that are written.
        bounds = {k: list(struct.unpack("<3f", struct.pack("<3f", *v))) for k, v in bounds.items()}
        attributes = {
            "POSITION": self.accessor("VEC3", 5126, "f", [c for p in points for c in p], **bounds),
            "NORMAL": self.accessor("VEC3", 5126, "f", [c for n in normals for c in n])}
        indices = self.accessor("SCALAR", 5125, "I", [i for t in triangles for i in t])
        self.gltf["meshes"].append({"primitives": [
            {"attributes": attributes, "indices": indices, "material": material}]})
        return len(self.gltf["meshes"]) - 1

    def node(self, **fields):
        self.gltf["nodes"].append(fields)
        self.gltf["scenes"][0]["nodes"].append(len(self.gltf["nodes"]) - 1)

    def write(self, path):
        self.gltf["buffers"] = [{
            "byteLength": len(self.data), "uri": "data:application/octet-stream;base64," +
                                                 base64.b64encode(self.data).decode("ascii")}]
        with open(path, "w") as out:
            json.dump(self.gltf, out)


def lambert(color):
    return {"pbrMetallicRoughness": {"baseColorFactor": color + [1], "metallicFactor": 0,
                                     "roughnessFactor": 0.5}}


LAMP = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
        "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 15}}}


def sphere(rings, sectors):
    """A unit sphere with 2 * sectors * (rings - 1) triangles."""
    points, triangles = [], []
    for i in range(rings + 1):
        theta = math.pi * i / rings
        for j in range(sectors + 1):
            phi = 2 * math.pi * j / sectors
            points.append((math.sin(theta) * math.cos(phi), math.cos(theta),
                           math.sin(theta) * math.sin(phi)))
    for i in range(rings):
        for j in range(sectors):
            a, b = i * (sectors + 1) + j, (i + 1) * (sectors + 1) + j
            if i > 0:
                triangles.append((a, a + 1, b))
            if i < rings - 1:
                triangles.append((a + 1, b + 1, b))
    return points, points, triangles


def grid(size, steps, height):
    """A square of 2 * steps^2 triangles, facing up, height(x, z) metres high."""
    points, triangles = [], []
    for i in range(steps + 1):
        for j in range(steps + 1):
            x, z = size * (j / steps - 0.5), size * (i / steps - 0.5)
            points.append((x, height(x, z), z))
    for i in range(steps):
        for j in range(steps):
            a, b = i * (steps + 1) + j, (i + 1) * (steps + 1) + j
            triangles += [(a, b, a + 1), (a + 1, b, b + 1)]
    return points, [(0.0, 1.0, 0.0)] * len(points), triangles


def lamp_over(maker, material):
    points, normals, triangles = grid(2, 1, lambda x, z: 0.0)
    lamp = maker.mesh(points, [(0.0, 1.0, 0.0)] * 4, triangles, material)
    maker.node(mesh=lamp, translation=[1, 8, 1], rotation=[1, 0, 0, 0])  # facing down


def camera_at(maker, x, y, z, down):
    """Look along -z, turned down by so many radians."""
    maker.node(camera=0, translation=[x, y, z],
               rotation=[-math.sin(down / 2), 0, 0, math.cos(down / 2)])


def make_instances(path):
    maker = Maker([lambert([0.6, 0.6, 0.6]), lambert([0.7, 0.3, 0.2]), LAMP])
    ball = maker.mesh(*sphere(32, 64), 1)
    floor = maker.mesh(*grid(24, 1, lambda x, z: 0.0), 0)
    maker.node(mesh=floor)
    for i in range(7):
        for j in range(7):
            turn = 0.37 * (7 * i + j)
            maker.node(mesh=ball, translation=[1.3 * (j - 3), 0.5 + 0.04 * i, 1.3 * (i - 3)],
                       rotation=[0, math.sin(turn), 0, math.cos(turn)],
                       scale=[0.55, 0.4 + 0.02 * j, 0.45])
    lamp_over(maker, 2)
    camera_at(maker, 0, 6, 11, 0.5)
    maker.write(path)


def make_empty(path):
    maker = Maker([lambert([0.5, 0.5, 0.5])])
    maker.node(mesh=maker.mesh([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)],
                               [(0.0, 0.0, 1.0)] * 3, [(0, 1, 2)], 0))
    camera_at(maker, 0, 0, 5, 0)
    maker.write(path)


def make_large(path):
    maker = Maker([lambert([0.5, 0.5, 0.5]), LAMP])
    wavy = grid(16, 512, lambda x, z: 0.4 * math.sin(1.7 * x) * math.cos(2.3 * z))
    maker.node(mesh=maker.mesh(*wavy, 0))
    lamp_over(maker, 1)
    camera_at(maker, 0, 6, 11, 0.5)
    maker.write(path)


KINDS = {"instances": make_instances, "empty": make_empty, "large": make_large}
if len(sys.argv) != 3 or sys.argv[1] not in KINDS:
    sys.exit(__doc__)
KINDS[sys.argv[1]](sys.argv[2])
