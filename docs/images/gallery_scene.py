"""Put a glTF model of somebody else's into a setting: a ground, lamps and a camera.

The model's file stays where it is; `compose` writes a glTF file that refers to its buffers and images.
"""
import base64
import copy
import json
import math
import os
import struct
from urllib.parse import quote

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def sub(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return [x / length for x in a]


def look_at(eye, target):
    """The node matrix, by columns, of something at `eye` whose -z points to `target`."""
    z = unit(sub(eye, target))
    up = [0.0, 1.0, 0.0] if abs(z[1]) < 0.999 else [0.0, 0.0, 1.0]
    x = unit(cross(up, z))
    y = cross(z, x)
    return [*x, 0, *y, 0, *z, 0, *eye, 1]


def load(path, folder):
    """The JSON of a .gltf or .glb file, its URIs as seen from `folder`."""
    data = open(path, "rb").read()
    if data[:4] != b"glTF":
        document = json.loads(data)
        place = os.path.relpath(os.path.dirname(path), folder)
        for item in document.get("buffers", []) + document.get("images", []):
            if "uri" in item and not item["uri"].startswith("data:"):
                item["uri"] = quote(place) + "/" + item["uri"]
        return document
    size = struct.unpack("<I", data[12:16])[0]
    document = json.loads(data[20:20 + size])
    binary = os.path.splitext(os.path.basename(path))[0] + ".bin"
    with open(os.path.join(folder, binary), "wb") as out:
        out.write(data[28 + size:])
    document["buffers"][0]["uri"] = binary
    return document


class Setting:
    """A glTF document to which things are added."""

    ending = ".gltf"

    def __init__(self, path, folder):
        self.folder = folder
        self.files = [path] if path else []
        self.gltf = load(path, folder) if path else {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}]}
        self.roots = self.gltf["scenes"][self.gltf.get("scene", 0)]["nodes"]

    @property
    def options(self):
        """What `azulejo render` needs to read the models' own files."""
        own = [os.path.abspath(f).startswith(os.path.join(ROOT, "scenes")) for f in self.files]
        return ["--allow-outside", "scenes" if all(own) else "$AZULEJO_DATA"] if own else []

    def add(self, kind, item):
        items = self.gltf.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def extension(self, name):
        used = self.gltf.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)

    def material(self, **values):
        for name in values.get("extensions", {}):
            self.extension(name)
        return self.add("materials", values)

    def surface(self, colour, roughness=1.0, metallic=0.0, **extensions):
        return self.material(pbrMetallicRoughness={"baseColorFactor": [*colour, 1.0],
                                                   "roughnessFactor": roughness, "metallicFactor": metallic},
                             extensions=extensions)

    def node(self, **values):
        self.roots.append(self.add("nodes", values))
        return self.roots[-1]

    def put(self, path, matrix=None, material=None, only=None):
        """Another file's model, or so many of its nodes; all of one material if one is given."""
        other = load(path, self.folder)
        self.files.append(path)
        shift = {kind: len(self.gltf.get(kind, [])) for kind in (
            "buffers", "bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes")}
        refer = {"buffer": "buffers", "bufferView": "bufferViews", "source": "images", "sampler": "samplers",
                 "index": "textures", "material": "materials", "mesh": "meshes", "indices": "accessors"}

        def moved(value, key=""):
            if isinstance(value, list):
                return [moved(v, key) for v in value]
            if isinstance(value, dict):
                if key == "attributes":
                    return {k: v + shift["accessors"] for k, v in value.items()}
                return {k: moved(v, k) for k, v in value.items() if k not in ("extras", "camera", "animations")}
            if key in refer and isinstance(value, int):
                return value + shift[refer[key]]
            if key == "children":
                return value + shift["nodes"]
            return value
        for kind in shift:
            for item in other.get(kind, []):
                added = self.add(kind, moved(copy.deepcopy(item), kind))
                if kind == "meshes" and material is not None:
                    for primitive in self.gltf["meshes"][added]["primitives"]:
                        primitive["material"] = material
        for name in other.get("extensionsUsed", []):
            self.extension(name)
        children = [n + shift["nodes"] for n in other["scenes"][other.get("scene", 0)]["nodes"][:only]]
        return self.node(children=children, **({"matrix": matrix} if matrix else {}))

    def mesh(self, positions, normals, triangles, material, matrix=None):
        blobs = [struct.pack("<%df" % (3 * len(v)), *[x for p in v for x in p]) for v in (positions, normals)]
        blobs.append(struct.pack("<%dI" % (3 * len(triangles)), *[i for t in triangles for i in t]))
        uri = "data:application/octet-stream;base64," + base64.b64encode(b"".join(blobs)).decode()
        buffer = self.add("buffers", {"byteLength": sum(map(len, blobs)), "uri": uri})
        at, accessors = 0, []
        for number, blob in enumerate(blobs):
            view = self.add("bufferViews", {"buffer": buffer, "byteOffset": at, "byteLength": len(blob)})
            at += len(blob)
            accessor = {"bufferView": view, "componentType": 5125 if number == 2 else 5126,
                        "type": "SCALAR" if number == 2 else "VEC3",
                        "count": 3 * len(triangles) if number == 2 else len(positions)}
            if number == 0:
                for name, choose in (("min", min), ("max", max)):
                    exact = [choose(p[i] for p in positions) for i in range(3)]
                    accessor[name] = list(struct.unpack("<3f", struct.pack("<3f", *exact)))
            accessors.append(self.add("accessors", accessor))
        mesh = self.add("meshes", {"primitives": [{
            "attributes": {"POSITION": accessors[0], "NORMAL": accessors[1]}, "indices": accessors[2],
            "material": material}]})
        self.node(mesh=mesh, **({"matrix": matrix} if matrix else {}))

    def disc(self, radius, material, y=0.0, centre=(0.0, 0.0)):
        ring = [[centre[0] + radius * math.cos(i * math.pi / 64), y, centre[1] + radius * math.sin(i * math.pi / 64)]
                for i in range(128)]
        points = [[centre[0], y, centre[1]]] + ring
        self.mesh(points, [[0, 1, 0]] * len(points), [[0, 1 + (i + 1) % 128, 1 + i] for i in range(128)], material)

    def ball(self, radius, material, steps=24):
        """A ball around the origin; returns its mesh, for `node`."""
        points, triangles = [], []
        for i in range(steps + 1):
            a = math.pi * i / steps
            for j in range(2 * steps):
                b = math.pi * j / steps
                points.append([math.sin(a) * math.cos(b), math.cos(a), math.sin(a) * math.sin(b)])
        for i in range(steps):
            for j in range(2 * steps):
                here, right = i * 2 * steps + j, i * 2 * steps + (j + 1) % (2 * steps)
                down, corner = here + 2 * steps, right + 2 * steps
                triangles += ([[here, right, corner]] if i > 0 else []) + ([[here, corner, down]] if i < steps - 1 else [])
        self.mesh([[radius * x for x in p] for p in points], points, triangles, material)
        return self.gltf["nodes"][self.roots.pop()]["mesh"]

    def sweep(self, material, width, front, back, height, y=0.0, radius=None):
        """A photographer's paper: a floor from z=front to z=back that bends up into a wall."""
        radius = radius or height / 3
        line = [(front, y, 1.0, 0.0)]
        for i in range(33):
            a = i * math.pi / 64
            line.append((back + radius - radius * math.sin(a), y + radius - radius * math.cos(a),
                         math.cos(a), math.sin(a)))
        line.append((back, y + height, 0.0, 1.0))
        points, normals, triangles = [], [], []
        for z, h, ny, nz in line:
            points += [[-width / 2, h, z], [width / 2, h, z]]
            normals += [[0, ny, nz]] * 2
        for i in range(0, len(points) - 2, 2):
            triangles += [[i, i + 1, i + 2], [i + 1, i + 3, i + 2]]
        self.mesh(points, normals, triangles, material)

    def lamp(self, eye, target, width, height, radiance, colour=(1.0, 1.0, 1.0)):
        """A softbox at `eye` that shines towards `target`."""
        brightest = max(colour)
        material = self.material(
            pbrMetallicRoughness={"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0.0},
            emissiveFactor=[c / brightest for c in colour],
            extensions={"KHR_materials_emissive_strength": {"emissiveStrength": radiance * brightest},
                        "KHR_materials_specular": {"specularFactor": 0.0}})
        w, h = width / 2, height / 2
        self.mesh([[-w, -h, 0], [w, -h, 0], [w, h, 0], [-w, h, 0]], [[0, 0, -1]] * 4, [[0, 2, 1], [0, 3, 2]],
                  material, look_at(eye, target))

    def camera(self, eye, target, degrees, aspect=1.5):
        """The only camera; `degrees` is the picture's height. Returns its node."""
        for node in self.gltf.get("nodes", []):
            node.pop("camera", None)
        self.gltf["cameras"] = [{"type": "perspective", "perspective": {
            "yfov": math.radians(degrees), "znear": 0.01, "aspectRatio": aspect}}]
        return self.node(camera=0, matrix=look_at(eye, target), name="photograph")

    def move(self, nodes, way, seconds):
        """Put the nodes into a carriage that goes along `way` in so many seconds."""
        self.roots[:] = [n for n in self.roots if n not in nodes]
        carriage = self.node(children=list(nodes))
        data = struct.pack("<8f", 0, seconds, 0, 0, 0, *way)
        buffer = self.add("buffers", {"byteLength": len(data), "uri": "data:application/octet-stream;base64,"
                                      + base64.b64encode(data).decode()})
        times = self.add("accessors", {
            "bufferView": self.add("bufferViews", {"buffer": buffer, "byteLength": 8}), "componentType": 5126,
            "type": "SCALAR", "count": 2, "min": [0.0], "max": [float(seconds)]})
        places = self.add("accessors", {
            "bufferView": self.add("bufferViews", {"buffer": buffer, "byteOffset": 8, "byteLength": 24}),
            "componentType": 5126, "type": "VEC3", "count": 2})
        self.add("animations", {"samplers": [{"input": times, "output": places}], "channels": [
            {"sampler": 0, "target": {"node": carriage, "path": "translation"}}]})

    def write(self, path):
        with open(path, "w") as out:
            json.dump(self.gltf, out)


def place(x=0.0, y=0.0, z=0.0, turn=0.0, scale=1.0):
    """A node matrix: scaled, turned by `turn` degrees about +y, moved."""
    c, s = scale * math.cos(math.radians(turn)), scale * math.sin(math.radians(turn))
    return [c, 0, -s, 0, 0, scale, 0, 0, s, 0, c, 0, x, y, z, 1]
