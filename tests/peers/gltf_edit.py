"""Write a glTF file (.gltf or .glb) again, with edits that make it comparable.

    gltf_edit.py SCENE OUT.gltf [EDIT]...

    lambert=NAME,...   these dielectrics (or `all`) get no reflection: pure Lambert reflectors
    nearest            textures are not interpolated
    flat               no normal maps
    white              metals get the base colour 1, so that Schlick's term is 1 as well
    smooth             roughness 0
    faceted            no normals but the triangles' own
    hard-spots         spot lights without a soft rim
    both-sides         nothing is culled
    without=EXTENSION  leave out that KHR_materials_ extension
    bare=NAME,...      take away what has these materials
    camera             put a camera where it sees everything, if there is none
Buffers and images are copied to OUT's folder, which must be another than the scene's.
"""
import json
import math
import os
import shutil
import struct
import sys


def load(path, folder):
    """The document; a GLB's binary chunk is written into the folder."""
    with open(path, "rb") as source:
        data = source.read()
    if data[:4] != b"glTF":
        return json.loads(data)
    length, = struct.unpack("<I", data[12:16])
    gltf = json.loads(data[20:20 + length])
    if len(data) > 28 + length:
        name = "chunk-%d.bin" % os.getpid()
        with open(os.path.join(folder, name), "wb") as chunk:
            chunk.write(data[28 + length:])
        gltf["buffers"][0]["uri"] = name
    return gltf


def copy_files(gltf, source, target):
    for thing in gltf.get("buffers", []) + gltf.get("images", []):
        uri = thing.get("uri", "data:").replace("%20", " ")
        link = os.path.join(target, uri)
        if not uri.startswith("data:") and not os.path.lexists(link):
            os.makedirs(os.path.dirname(link), exist_ok=True)
            shutil.copyfile(os.path.join(source, uri), link)


def matrix_of(node):
    """Row-major 3x4."""
    if "matrix" in node:
        m = node["matrix"]
        return [[m[4 * c + r] for c in range(4)] for r in range(3)]
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    s, t = node.get("scale", [1, 1, 1]), node.get("translation", [0, 0, 0])
    turn = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return [[turn[r][c] * s[c] for c in range(3)] + [t[r]] for r in range(3)]


def corners(gltf):
    """Of all meshes' boxes, in world space."""
    points = []

    def visit(index, chain):
        node = gltf["nodes"][index]
        chain = chain + [matrix_of(node)]
        for primitive in gltf["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            box = gltf["accessors"][primitive["attributes"]["POSITION"]]
            for k in range(8):
                p = [box["max" if k >> a & 1 else "min"][a] for a in range(3)]
                for m in reversed(chain):
                    p = [sum(m[r][c] * p[c] for c in range(3)) + m[r][3] for r in range(3)]
                points.append(p)
        for child in node.get("children", []):
            visit(child, chain)

    for root in gltf["scenes"][gltf.get("scene", 0)]["nodes"]:
        visit(root, [])
    return points


def add_camera(gltf):
    if gltf.get("cameras"):
        return
    points = corners(gltf)
    low, high = ([f(p[a] for p in points) for a in range(3)] for f in (min, max))
    centre = [(a + b) / 2 for a, b in zip(low, high)]
    radius = max(math.dist(p, centre) for p in points)
    yfov, yaw, pitch = 0.7, 0.45, -0.3
    away = radius / math.sin(yfov / 2)
    toward = (math.sin(yaw) * math.cos(pitch), -math.sin(pitch), math.cos(yaw) * math.cos(pitch))
    sy, cy, sx, cx = (f(a / 2) for a in (yaw, pitch) for f in (math.sin, math.cos))
    gltf["cameras"] = [{"type": "perspective", "perspective": {
        "yfov": yfov, "znear": away / 100, "zfar": away * 10}}]
    gltf["nodes"].append({"name": "the camera", "camera": 0,
                          "translation": [c + t * away for c, t in zip(centre, toward)],
                          "rotation": [cy * sx, sy * cx, -sy * sx, cy * cx]})
    gltf["scenes"][gltf.get("scene", 0)]["nodes"].append(len(gltf["nodes"]) - 1)


def make_lambert(gltf, names):
    for material in gltf.get("materials", []):
        extensions = material.setdefault("extensions", {})
        metallic = material.setdefault("pbrMetallicRoughness", {}).get("metallicFactor", 1)
        if (names == "all" or material.get("name") in names.split(",")) and \
                "KHR_materials_transmission" not in extensions and \
                "KHR_materials_unlit" not in extensions and (metallic == 0 or names == "all"):
            material["pbrMetallicRoughness"]["metallicFactor"] = 0
            material["pbrMetallicRoughness"].pop("metallicRoughnessTexture", None)
            for extra in ("clearcoat", "sheen", "iridescence", "anisotropy", "ior"):
                extensions.pop("KHR_materials_" + extra, None)
            extensions["KHR_materials_specular"] = {"specularFactor": 0}
    used = gltf.setdefault("extensionsUsed", [])
    if "KHR_materials_specular" not in used:
        used.append("KHR_materials_specular")


def edit(gltf, change):
    key, _, value = change.partition("=")
    materials = gltf.get("materials", [])
    if key == "lambert":
        make_lambert(gltf, value)
    elif key == "nearest":
        for sampler in gltf.setdefault("samplers", []):
            sampler.update(magFilter=9728, minFilter=9728)
        gltf["samplers"].append({"magFilter": 9728, "minFilter": 9728})
        for texture in gltf.get("textures", []):
            texture.setdefault("sampler", len(gltf["samplers"]) - 1)
    elif key == "flat":
        for material in materials:
            material.pop("normalTexture", None)
            material.get("extensions", {}).get("KHR_materials_clearcoat", {}).pop(
                "clearcoatNormalTexture", None)
    elif key in ("white", "smooth"):
        for material in materials:
            pbr = material.get("pbrMetallicRoughness", {})
            if key == "smooth":
                pbr["roughnessFactor"] = 0
            elif pbr.get("metallicFactor", 1) == 1:
                pbr["baseColorFactor"] = [1, 1, 1, 1]
    elif key == "faceted":
        for primitive in (p for m in gltf["meshes"] for p in m["primitives"]):
            for attribute in ("NORMAL", "TANGENT"):
                primitive["attributes"].pop(attribute, None)
    elif key == "hard-spots":
        for light in gltf["extensions"]["KHR_lights_punctual"]["lights"]:
            if "spot" in light:
                light["spot"]["innerConeAngle"] = 0.9999 * light["spot"]["outerConeAngle"]
    elif key == "both-sides":
        for material in materials:
            material["doubleSided"] = True
    elif key == "without":
        for material in materials:
            material.get("extensions", {}).pop("KHR_materials_" + value, None)
        for where in ("extensionsUsed", "extensionsRequired"):
            if "KHR_materials_" + value in gltf.get(where, []):
                gltf[where].remove("KHR_materials_" + value)
    elif key == "bare":
        gone = [i for i, m in enumerate(materials) if m.get("name") in value.split(",")]
        for thing in gltf["nodes"]:
            if "mesh" in thing and \
                    gltf["meshes"][thing["mesh"]]["primitives"][0].get("material") in gone:
                del thing["mesh"]
    elif key == "camera":
        add_camera(gltf)
    else:
        sys.exit("gltf_edit: '%s' is no edit\n%s" % (change, __doc__))


def empty_unused_nodes(gltf):
    """Blender's importer takes nodes that are not in the scene, too."""
    used, stack = set(), list(gltf["scenes"][gltf.get("scene", 0)]["nodes"])
    while stack:
        index = stack.pop()
        used.add(index)
        stack += gltf["nodes"][index].get("children", [])
    for index, node in enumerate(gltf["nodes"]):
        if index not in used:
            for key in ("mesh", "camera", "extensions"):
                node.pop(key, None)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    scene, out = sys.argv[1:3]
    target = os.path.dirname(os.path.abspath(out))
    gltf = load(scene, target)
    copy_files(gltf, os.path.dirname(os.path.abspath(scene)), target)
    for change in sys.argv[3:]:
        edit(gltf, change)
    empty_unused_nodes(gltf)
    for index, material in enumerate(gltf.get("materials", [])):
        material.setdefault("name", "material %d" % index)
    for where in ("extensionsUsed", "extensionsRequired"):
        if gltf.get(where) == []:
            del gltf[where]
    with open(out, "w") as copy:
        json.dump(gltf, copy)


main()
