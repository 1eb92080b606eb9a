"""What other programs write: no key, statement or property of a scene file is dropped without a word.

Each is given to a small file with a value that is not the default. Either the scene changes by it, or a warning names it, or it
is in the list of those that change no picture, with the reason.
"""
import base64
import copy
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import zlib

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, Failure, PATIENCE, ROOT, Tests

tests = Tests()


class Folder:
    """Files of scenes, and what an import makes of them."""

    def __enter__(self):
        self.holder = tempfile.TemporaryDirectory(prefix="azulejo-keys-")
        self.path = self.holder.name
        self.write("a.png", PNG)
        self.write("b.png", OTHER_PNG)
        self.write("m.ply", PLY % (("",) * 6))
        return self

    def __exit__(self, *_):
        self.holder.cleanup()

    def write(self, name, data):
        with open(os.path.join(self.path, name), "wb") as out:
            out.write(data if isinstance(data, bytes) else data.encode())

    def read(self, name, data):
        """The scene, and the warnings."""
        self.write(name, data)
        done = subprocess.run([os.path.join(BIN, "azulejo"), "import", "--json", "--studio", "off", name], cwd=self.path,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60 * PATIENCE)
        if done.returncode:
            raise Failure("%s\n%s" % (done.stderr.decode(), data if isinstance(data, str) else ""))
        report = json.loads(done.stdout)
        scene = {key: report[key] for key in report if key not in ("inputs", "warnings", "bytes", "file", "simplified")}
        return scene, report["warnings"]


def judge(key, without, with_it, quiet, faults):
    """One line into `faults` if `key` had neither an effect nor a warning."""
    (scene, before), (other, warnings) = without, with_it
    if scene != other:
        heard = "read"
    elif any(key in line for line in warnings if line not in before):
        heard = "named"
    else:
        heard = None
    if heard and key in quiet:
        faults.append("%s is %s, and in the list of those that are not" % (key, heard))
    if not heard and key not in quiet:
        faults.append("%s is dropped without a word" % key)


def settle(faults):
    if faults:
        raise Failure("\n".join(faults))


def png(*pixels):
    """Two pixels of RGB."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 6, 0, 0, 0)) + \
        chunk(b"IDAT", zlib.compress(b"\0" + b"".join(bytes(p) for p in pixels))) + chunk(b"IEND", b"")


PNG = png((200, 100, 50, 90), (20, 40, 240, 200))
OTHER_PNG = png((10, 90, 150, 255), (220, 140, 40, 30))
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
%selement face 1
property list uchar int vertex_indices
%send_header
0 0 0%s
1 0 0%s
0 1 0%s
3 0 1 2%s
"""


# ---- OBJ ----------------------------------------------------------------------------------------

OBJ = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nusemtl m\n%s\nf 1/1 2/2 3/3\nf 3/3 2/2 4/4\n"
OBJ_STATEMENTS = {
    "v": "v 5 5 5 0.5 0.5 0.5\nf -1 1 2", "vt": "vt .5 .5\nf 1/1 2/2 4/-1", "vn": "vn 1 0 0\nf 1//-1 2//-1 4//-1", "f": "f 1 2 4",
    "fo": "fo 1 2 4", "o": "o a b", "g": "g a b", "usemtl": "usemtl n", "mtllib": "mtllib other.mtl\nusemtl k", "s": "s 1",
    "p": "p 1", "l": "l 1 2", "vp": "vp 0 0", "cstype": "cstype bezier", "deg": "deg 3 3", "bmat": "bmat u 1", "step": "step 1 1",
    "curv": "curv 0 1 1 2", "curv2": "curv2 1 2", "surf": "surf 0 1 0 1 1 2 3 4", "parm": "parm u 0 1", "trim": "trim 0 1 1",
    "hole": "hole 0 1 1", "scrv": "scrv 0 1 1", "sp": "sp 1", "end": "end", "con": "con 1 0 1 1 2 0 1 1", "mg": "mg 1 0.5",
    "bevel": "bevel on", "c_interp": "c_interp on", "d_interp": "d_interp on", "lod": "lod 5", "maplib": "maplib a.map",
    "usemap": "usemap a", "shadow_obj": "shadow_obj a.obj", "trace_obj": "trace_obj a.obj", "ctech": "ctech cparm 1",
    "stech": "stech cparma 1 1", "call": "call a.obj", "csh": "csh ls", "xyzzy": "xyzzy 1",
}
OBJ_QUIET = {"mg",  # of free-form surfaces, which have a warning
             "lod"}  # which of a viewer's levels this is
OBJ_NAMED_AS = {w: "free-form" for w in
                "vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech".split()}
OBJ_NAMED_AS.update(p="points", l="lines")


@tests.add
def obj():
    """each statement of Wavefront's OBJ changes the scene or is named"""
    faults = []
    with Folder() as folder:
        folder.write("m.mtl", "newmtl m\nKd .5 .5 .5\nnewmtl n\nKd 1 0 0\n")
        folder.write("other.mtl", "newmtl k\nKd 0 0 1\n")
        without = folder.read("a.obj", OBJ % "")
        for word, line in OBJ_STATEMENTS.items():
            judge(OBJ_NAMED_AS.get(word, word), without, folder.read("a.obj", OBJ % line), OBJ_QUIET, faults)
    settle(faults)


MTL_BASE = "newmtl m\nKd .5 .4 .3\n%s\n"
MTL_STATEMENTS = {  # statement: what it needs beside it, and itself
    "Ka": "Ka .2 .2 .2", "Kd": "Kd .1 .2 .3", "Ks": "Ks .5 .5 .5", "Ke": "Ke 1 1 1", "Tf": ("illum 6\nd .5", "Tf .5 .6 .7"),
    "illum": "illum 7", "d": "d .5", "-halo": "d -halo .5", "Tr": "Tr .5", "Ns": ("Ks .5 .5 .5", "Ns 200"), "sharpness": "sharpness 500",
    "Ni": ("illum 6\nd .5", "Ni 1.8"), "Km": "Km .5", "map_Ka": "map_Ka a.png", "map_Kd": "map_Kd a.png", "map_Ks": ("Ks 1 1 1", "map_Ks a.png"),
    "map_Ke": "map_Ke a.png", "map_Ns": ("Ks 1 1 1", "map_Ns a.png"), "map_d": "map_d a.png", "map_Tr": "map_Tr a.png", "map_aat": "map_aat on",
    "disp": "disp a.png", "decal": "decal a.png", "bump": "bump a.png", "map_bump": "map_bump a.png", "map_Bump": "map_Bump a.png",
    "refl": "refl -type sphere a.png", "map_refl": "map_refl a.png", "map_Tf": "map_Tf a.png", "map_Ni": "map_Ni a.png",
    "Pr": "Pr .3", "Pm": "Pm .7", "Ps": "Ps .5", "Pc": "Pc .5", "Pcr": ("Pc 1", "Pcr .4"), "aniso": ("Pr .4\nPm 1", "aniso .5"),
    "anisor": ("Pr .4\nPm 1\naniso .5", "anisor .25"), "norm": "norm a.png", "map_Pr": "map_Pr a.png", "map_Pm": "map_Pm a.png",
    "map_Ps": ("Ps 1", "map_Ps a.png"), "map_Pc": ("Pc 1", "map_Pc a.png"), "map_Pcr": ("Pc 1", "map_Pcr a.png"), "map_RMA": "map_RMA a.png",
    "map_ORM": "map_ORM a.png", "map_occlusion": "map_occlusion a.png", "map_Kn": "map_Kn a.png", "xyzzy": "xyzzy 1",
    "\"Kd\"": "Kd spectral a.rfl", "\"Ks\"": "Ks xyz .2 .3 .4",
    "-s": ("#map", "map_Kd -s 2 2 1 a.png"), "-o": ("#map", "map_Kd -o .25 .25 0 a.png"), "-t": ("#map", "map_Kd -t .1 .1 .1 a.png"),
    "-mm": ("#map", "map_Kd -mm .2 .5 a.png"), "-clamp": ("#map", "map_Kd -clamp on a.png"), "-cc": ("#map", "map_Kd -cc on a.png"),
    "-blendu": ("#map", "map_Kd -blendu off a.png"), "-blendv": ("#map", "map_Kd -blendv off a.png"),
    "-boost": ("#map", "map_Kd -boost 3 a.png"), "-texres": ("#map", "map_Kd -texres 64 a.png"),
    "-bm": ("bump a.png", "bump -bm .3 a.png"), "-imfchan": ("map_d b.png", "map_d -imfchan r b.png"), "-type": ("#map", "map_Kd -type sphere a.png"),
}
MTL_QUIET = {"Ka", "map_Ka",  # light from all sides, which is traced here
             "sharpness",  # of a reflection map
             "map_aat", "-blendu", "-blendv", "-boost", "-texres",  # how a viewer filters
             "-type"}  # of a reflection map


@tests.add
def mtl():
    """each statement and option of Wavefront's MTL changes the scene or is named"""
    faults = []
    with Folder() as folder:
        for word, line in MTL_STATEMENTS.items():
            beside, line = line if isinstance(line, tuple) else ("", line)
            beside = beside.replace("#map", "map_Kd a.png")
            folder.write("m.mtl", MTL_BASE % beside)
            without = folder.read("a.obj", OBJ % "")
            folder.write("m.mtl", MTL_BASE % (beside + "\n" + line))
            judge(word, without, folder.read("a.obj", OBJ % ""), MTL_QUIET, faults)
    settle(faults)


# ---- PLY ----------------------------------------------------------------------------------------

PLY_VERTEX = ["nx ny nz", "red green blue", "alpha", "diffuse_red diffuse_green diffuse_blue", "r g b", "ambient_red ambient_green ambient_blue",
              "specular_red specular_green specular_blue", "specular_power", "s t", "u v", "texture_u texture_v", "texcoord_u texcoord_v", "quality",
              "intensity", "confidence", "radius", "opacity", "scale_0 scale_1 scale_2", "rot_0 rot_1 rot_2 rot_3", "f_dc_0 f_dc_1 f_dc_2", "value",
              "flags", "material_index", "tx ty tz", "curvature", "xyzzy"]
PLY_FACE = ["red green blue", "nx ny nz", "quality", "flags", "texnumber", "material_index", "xyzzy"]


@tests.add
def ply():
    """each usual property of a PLY file changes the scene or is named"""
    faults = []
    with Folder() as folder:
        without = folder.read("a.ply", PLY % ("", "", "", "", "", ""))
        for of_face in (0, 1):
            for names in PLY_FACE if of_face else PLY_VERTEX:
                each = names.split()
                lines = "".join("property %s %s\n" % ("uchar" if name in ("red", "green", "blue", "alpha") else "float", name) for name in each)
                beside = without
                if names == "texnumber":
                    text = (PLY % ("property float s\nproperty float t\n", lines, " 0 0", " 1 0", " 0 1", " 7")).replace(
                        "element vertex", "comment TextureFile a.png\nelement vertex")
                    each = ["another than the first texture"]
                elif names == "alpha":  # has a meaning beside colours alone
                    base = "".join("property uchar %s\n" % n for n in ("red", "green", "blue"))
                    beside = folder.read("a.ply", PLY % (base, "", " 9 9 9", " 90 9 9", " 9 90 9", ""))
                    text = PLY % (base + lines, "", " 9 9 9 50", " 90 9 9 5", " 9 90 9 5", "")
                elif of_face:
                    text = PLY % ("", lines, "", "", "", " 7" * len(each))
                else:
                    text = PLY % (lines, "", " 0" * len(each), " 1" * len(each), "".join(" %d" % (i % 2) for i in range(len(each))), "")
                mark = each[0]
                judge(mark, beside, folder.read("a.ply", text), set(), faults)
        for line in ("element edge 1\nproperty int vertex1\n", "element tristrips 1\nproperty list int int vertex_indices\n"):
            text = without and PLY % ("", "", "", "", "", "")
            text = text.replace("end_header", line + "end_header") + ("1\n" if "edge" in line else "3 0 1 2\n")
            judge(line.split()[1], without, folder.read("a.ply", text), set(), faults)
    settle(faults)


# ---- glTF ---------------------------------------------------------------------------------------

def gltf_file():
    """A textured, lit, moving, skinned and morphing triangle of every table that glTF has."""
    data, views, accessors = b"", [], []

    def add(kind, values, component=5126, form="f", **more):
        nonlocal data
        raw = struct.pack("<%d%s" % (len(values), form), *values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(raw)})
        size = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        accessors.append(dict({"bufferView": len(views) - 1, "componentType": component, "count": len(values) // size, "type": kind}, **more))
        data += raw + bytes(-len(raw) % 4)
        return len(accessors) - 1
    position = add("VEC3", [0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1], min=[0, 0, 0], max=[1, 1, 1])
    normal = add("VEC3", [0, 0, 1] * 4)
    uv = add("VEC2", [0, 0, 1, 0, 0, 1, 1, 1])
    uv1 = add("VEC2", [.5, 0, 1, 0, 0, .7, 1, 1])
    times, values, still = add("SCALAR", [0, 1]), add("VEC3", [0, 0, 0, 1, 2, 3]), add("VEC3", [0] * 6)
    index = add("SCALAR", [0, 1, 2, 1, 3, 2], 5123, "H")
    morph = add("VEC3", [0, 0, 1] * 4)
    joints, weights = add("VEC4", [0, 0, 0, 0] * 4, 5121, "B"), add("VEC4", [1, 0, 0, 0] * 4)
    inverse = add("MAT4", [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, .5, 0, 1])
    color = add("VEC4", [1, 0, 0, .5] * 4)
    tangent = add("VEC4", [0, 1, 0, 1] * 4)
    spare = add("VEC3", [2, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1])
    texture = {"index": 0}
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}, {"nodes": [0]}],
        "nodes": [{"mesh": 0}, {"camera": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 5]},
                  {"mesh": 1, "skin": 0, "children": [4]}, {"translation": [0, 1, 0]}, {"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "TEXCOORD_1": uv1},
                                    "indices": index, "material": 0, "targets": [{"POSITION": morph}]}], "weights": [.5]},
                   {"primitives": [{"attributes": {"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}],
        "skins": [{"joints": [4], "inverseBindMatrices": inverse}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [.9, .8, .7, .6], "baseColorTexture": texture,
                                                "metallicFactor": .5, "roughnessFactor": .5, "metallicRoughnessTexture": texture},
                       "normalTexture": texture, "occlusionTexture": texture, "emissiveTexture": texture, "emissiveFactor": [1, 1, 1],
                       "alphaMode": "MASK"}, {}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1}], "samplers": [{}, {"wrapS": 33071}],
        "images": [{"uri": "a.png"}, {"uri": "b.png"}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": .8, "znear": .1}, "orthographic": {"xmag": 2, "ymag": 1}},
                    {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": .1, "zfar": 9}}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
                        "samplers": [{"input": times, "output": values}, {"input": times, "output": still}]}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]},
                       "KHR_materials_variants": {"variants": [{"name": "v"}]}},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_variants"],
    }, {"uv": uv, "color": color, "tangent": tangent, "spare": spare, "times": times, "values": values, "joints": joints}


SLOT = {"index": 1, "texCoord": 1}
EXTENSIONS = {  # of materials: what it needs beside each key, and the keys
    "KHR_materials_anisotropy": ({"anisotropyStrength": .5}, {"anisotropyStrength": .7, "anisotropyRotation": 1, "anisotropyTexture": SLOT}),
    "KHR_materials_clearcoat": ({"clearcoatFactor": .5, "clearcoatRoughnessFactor": .5}, {"clearcoatFactor": .7, "clearcoatTexture": SLOT, "clearcoatRoughnessFactor": .4,
                                                         "clearcoatRoughnessTexture": SLOT, "clearcoatNormalTexture": SLOT}),
    "KHR_materials_dispersion": ({}, {"dispersion": .4}),
    "KHR_materials_emissive_strength": ({}, {"emissiveStrength": 3}),
    "KHR_materials_ior": ({}, {"ior": 1.7}),
    "KHR_materials_iridescence": ({"iridescenceFactor": .5},
                                  {"iridescenceFactor": 1, "iridescenceTexture": SLOT, "iridescenceIor": 1.8, "iridescenceThicknessMinimum": 200,
                                   "iridescenceThicknessMaximum": 700, "iridescenceThicknessTexture": SLOT}),
    "KHR_materials_sheen": ({"sheenColorFactor": [.2, .3, .4], "sheenRoughnessFactor": .3}, {"sheenColorFactor": [1, 1, 1], "sheenColorTexture": SLOT,
                                                                 "sheenRoughnessFactor": .5, "sheenRoughnessTexture": SLOT}),
    "KHR_materials_specular": ({}, {"specularFactor": .5, "specularTexture": SLOT, "specularColorFactor": [.5, .6, .7], "specularColorTexture": SLOT}),
    "KHR_materials_transmission": ({"transmissionFactor": .3}, {"transmissionFactor": .5, "transmissionTexture": SLOT}),
    "KHR_materials_volume": ({"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [.5, .6, .7]},
                             {"thicknessFactor": 0, "thicknessTexture": SLOT, "attenuationDistance": 1, "attenuationColor": [1, 0, 0]}),
    "KHR_materials_diffuse_transmission": ({"diffuseTransmissionFactor": .4},
                                           {"diffuseTransmissionFactor": .6, "diffuseTransmissionTexture": SLOT,
                                            "diffuseTransmissionColorFactor": [1, 0, 0], "diffuseTransmissionColorTexture": SLOT}),
    "KHR_materials_unlit": ({}, {}),
    "KHR_materials_pbrSpecularGlossiness": ({"diffuseFactor": [.5, .5, .5, 1]},
                                            {"diffuseFactor": [1, 0, 0, 1], "diffuseTexture": SLOT, "specularFactor": [.5, .5, .5],
                                             "glossinessFactor": .5, "specularGlossinessTexture": SLOT}),
    "KHR_materials_diffuse_roughness": ({"diffuseRoughnessFactor": .3}, {"diffuseRoughnessFactor": .7, "diffuseRoughnessTexture": SLOT}),
}
GLTF_KEYS = [  # place, key, value
    ("asset", "copyright", "c"), ("asset", "generator", "g"), ("asset", "minVersion", "2.0"), ("asset", "xyzzy", 1),
    ("", "scene", 1), ("", "extras", {"a": 1}), ("", "xyzzy", 1), ("scenes.0", "name", "n"), ("scenes.0", "nodes", [0, 1]),
    ("scenes.0", "extras", 1), ("scenes.0", "xyzzy", 1),
    ("nodes.0", "name", "n"), ("nodes.0", "matrix", [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), ("nodes.0", "translation", [1, 2, 3]),
    ("nodes.0", "rotation", [0, 0, 1, 0]), ("nodes.0", "scale", [2, 1, 1]), ("nodes.0", "weights", [.25]), ("nodes.0", "children", [5]),
    ("nodes.0", "camera", 0), ("nodes.0", "mesh", 1), ("nodes.3", "skin", None), ("nodes.0", "extras", 1), ("nodes.0", "xyzzy", 1),
    ("meshes.0", "name", "n"), ("meshes.0", "weights", [.75]), ("meshes.0", "extras", {"targetNames": ["a"]}), ("meshes.0", "xyzzy", 1),
    ("meshes.0.primitives.0", "mode", 1), ("meshes.0.primitives.0", "mode", 5), ("meshes.0.primitives.0", "material", 1),
    ("meshes.0.primitives.0", "indices", None), ("meshes.0.primitives.0", "targets", None), ("meshes.0.primitives.0", "xyzzy", 1),
    ("meshes.0.primitives.0.attributes", "COLOR_0", "color"), ("meshes.0.primitives.0.attributes", "TANGENT", "tangent"),
    ("meshes.0.primitives.0.attributes", "NORMAL", None), ("meshes.0.primitives.0.attributes", "TEXCOORD_2", "uv"),
    ("meshes.0.primitives.0.attributes", "COLOR_1", "color"), ("meshes.0.primitives.0.attributes", "_CUSTOM", "color"),
    ("meshes.0.primitives.0.attributes", "XYZZY", "color"), ("meshes.1.primitives.0.attributes", "JOINTS_2", "joints"),
    ("meshes.0.primitives.0.targets.0", "NORMAL", "spare"), ("meshes.0.primitives.0.targets.0", "TANGENT", "spare"),
    ("meshes.0.primitives.0.targets.0", "TEXCOORD_0", "uv"), ("meshes.0.primitives.0.targets.0", "COLOR_0", "color"),
    ("skins.0", "name", "n"), ("skins.0", "skeleton", 4), ("skins.0", "inverseBindMatrices", None), ("skins.0", "xyzzy", 1),
    ("materials.0", "name", "n"), ("materials.0", "emissiveFactor", [.5, .5, .5]), ("materials.0", "emissiveTexture", SLOT),
    ("materials.0", "normalTexture", SLOT), ("materials.0", "occlusionTexture", SLOT), ("materials.0", "alphaMode", "BLEND"),
    ("materials.0", "alphaCutoff", .3), ("materials.0", "doubleSided", True), ("materials.0", "extras", 1), ("materials.0", "xyzzy", 1),
    ("materials.0.normalTexture", "scale", .5), ("materials.0.occlusionTexture", "strength", .5), ("materials.0.normalTexture", "xyzzy", 1),
    ("materials.0.pbrMetallicRoughness", "baseColorFactor", [.1, .1, .1, 1]), ("materials.0.pbrMetallicRoughness", "baseColorTexture", SLOT),
    ("materials.0.pbrMetallicRoughness", "metallicFactor", .2), ("materials.0.pbrMetallicRoughness", "roughnessFactor", .2),
    ("materials.0.pbrMetallicRoughness", "metallicRoughnessTexture", SLOT), ("materials.0.pbrMetallicRoughness", "xyzzy", 1),
    ("materials.0.pbrMetallicRoughness.baseColorTexture", "texCoord", 1), ("materials.0.pbrMetallicRoughness.baseColorTexture", "xyzzy", 1),
    ("textures.0", "name", "n"), ("textures.0", "source", 1), ("textures.0", "sampler", 1), ("textures.0", "xyzzy", 1),
    ("samplers.0", "name", "n"), ("samplers.0", "magFilter", 9728), ("samplers.0", "minFilter", 9728), ("samplers.0", "wrapS", 33071),
    ("samplers.0", "wrapT", 33648), ("samplers.0", "xyzzy", 1),
    ("images.0", "name", "n"), ("images.0", "mimeType", "image/png"), ("images.0", "uri", "b.png"), ("images.0", "xyzzy", 1),
    ("cameras.0", "name", "n"), ("cameras.0", "type", "orthographic"), ("cameras.0", "xyzzy", 1),
    ("cameras.0.perspective", "aspectRatio", 2), ("cameras.0.perspective", "yfov", 1), ("cameras.0.perspective", "znear", 2),
    ("cameras.0.perspective", "zfar", 3), ("cameras.0.perspective", "xyzzy", 1),
    ("animations.0", "name", "n"), ("animations.0.channels.0", "sampler", 1), ("animations.0.channels.0.target", "path", "scale"),
    ("animations.0.channels.0.target", "node", 1), ("animations.0.samplers.0", "interpolation", "STEP"),
    ("animations.0.channels.0", "xyzzy", 1), ("animations.0.channels.0.target", "xyzzy", 1), ("animations.0.samplers.0", "xyzzy", 1),
    ("animations.0", "xyzzy", 1),
    ("accessors.0", "name", "n"), ("accessors.0", "byteOffset", 0), ("accessors.0", "normalized", False), ("accessors.0", "sparse", "sparse"),
    ("accessors.0", "min", [-1, 0, 0]), ("accessors.0", "max", [2, 1, 1]), ("accessors.0", "xyzzy", 1),
    ("bufferViews.0", "name", "n"), ("bufferViews.0", "target", 34962), ("bufferViews.0", "byteStride", 12), ("bufferViews.0", "xyzzy", 1),
    ("buffers.0", "name", "n"), ("buffers.0", "xyzzy", 1),
    ("extensions.KHR_lights_punctual.lights.0", "name", "n"), ("extensions.KHR_lights_punctual.lights.0", "color", [1, 0, 0]),
    ("extensions.KHR_lights_punctual.lights.0", "intensity", 7), ("extensions.KHR_lights_punctual.lights.0", "type", "point"),
    ("extensions.KHR_lights_punctual.lights.0", "range", 3), ("extensions.KHR_lights_punctual.lights.0.spot", "innerConeAngle", .2),
    ("extensions.KHR_lights_punctual.lights.0.spot", "outerConeAngle", .5), ("extensions.KHR_lights_punctual.lights.0", "xyzzy", 1),
    ("extensions.KHR_materials_variants.variants.0", "name", "w"),
    ("nodes.0", "extensions", {"KHR_node_visibility": {"visible": False}}),
    ("nodes.0", "extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": "spare"}}}),
    ("nodes.0", "extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": "spare", "COLOR_0": "color"}}}),
    ("nodes.0", "extensions", {"XYZ_xyzzy": {}}), ("materials.0", "extensions", {"XYZ_xyzzy": {}}), ("", "extensionsUsed", ["XYZ_xyzzy"]),
    ("", "extensions", {"EXT_lights_image_based": {"lights": []}}), ("materials.0", "extensions", {"KHR_materials_subsurface": {}}),
    ("materials.0", "extensions", {"KHR_materials_volume_scatter": {}}),
    ("textures.0", "extensions", {"KHR_texture_basisu": {"source": 1}}), ("textures.0", "extensions", {"EXT_texture_webp": {"source": 1}}),
    ("textures.0", "extensions", {"EXT_texture_avif": {"source": 1}}), ("textures.0", "extensions", {"MSFT_texture_dds": {"source": 1}}),
    ("meshes.0.primitives.0", "extensions", {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0]}]}}),
    ("animations.0.channels.0.target", "extensions", {"KHR_animation_pointer": {"pointer": "/materials/0/emissiveFactor"}}),
] + [("materials.0.pbrMetallicRoughness.baseColorTexture", "extensions", {"KHR_texture_transform": {key: value}}) for key, value in
     {"offset": [.1, .2], "rotation": .5, "scale": [2, 2], "texCoord": 1, "xyzzy": 1}.items()]
GLTF_QUIET = {"asset copyright", "asset generator", "asset minVersion", " extras", "scenes.0 extras", "nodes.0 extras", "materials.0 extras",
              "meshes.0 extras", "skins.0 name", "textures.0 name", "samplers.0 name", "accessors.0 name",
              "bufferViews.0 name", "buffers.0 name", "images.0 mimeType",
              "skins.0 skeleton", "accessors.0 byteOffset", "accessors.0 normalized", "bufferViews.0 target", "bufferViews.0 byteStride",  # the same values
              "accessors.0 min", "accessors.0 max",  # follow from the values
              "meshes.0.primitives.0.attributes _CUSTOM",  # the application's own
              "meshes.0.primitives.0.attributes TEXCOORD_2",  # has a warning where a material uses it
              "meshes.0.primitives.0 extensions",  # a variant, which --variant takes
              "cameras.0.perspective znear", "cameras.0.perspective zfar",  # rays have no clipping planes
              "KHR_materials_volume thicknessTexture",  # paths measure the thickness themselves
              "samplers.0 minFilter",  # a sampler of pixels needs none
              "materials.0 occlusionTexture", "materials.0.occlusionTexture strength"}  # light from all sides, which is traced here


def placed(scene, place, key, value, known):
    """`scene` with the key at its place; None removes it."""
    scene = copy.deepcopy(scene)
    into = scene
    for step in place.split(".") if place else ():
        into = into[int(step) if step.isdigit() else step]
    if value == "sparse":
        value = {"count": 1, "indices": {"bufferView": 0, "byteOffset": 0, "componentType": 5125}, "values": {"bufferView": 1}}
    if key == "extensions" and "attributes" in json.dumps(value):
        value = json.loads(json.dumps(value).replace('"spare"', str(known["spare"])).replace('"color"', str(known["color"])))
    if value is None:
        into.pop(key, None)
    elif key == "extensions" and key in into:
        into[key].update(value)
    else:
        into[key] = known[value] if isinstance(value, str) and value in known else value
    return scene


@tests.add
def gltf():
    """each key of glTF 2.0 and its extensions changes the scene or is named"""
    faults = []
    with Folder() as folder:
        scene, known = gltf_file()

        def read(what):
            return folder.read("a.gltf", json.dumps(what))
        without = read(scene)
        for place, key, value in GLTF_KEYS:
            if (place, key) == ("nodes.0", "matrix"):
                base = placed(scene, "", "animations", [], known)
                before = read(base)
            else:
                base, before = scene, without
            mark = list(value)[0] if key == "extensions" else key
            if mark == "KHR_texture_transform":
                mark = list(value[mark])[0]
            elif mark == "EXT_mesh_gpu_instancing" and len(value[mark]["attributes"]) > 1:
                before, mark = read(placed(base, place, key, {mark: {"attributes": {"TRANSLATION": "spare"}}}, known)), "COLOR_0"
            elif key == "extensionsUsed":
                mark = value[0]
            try:
                after = read(placed(base, place, key, value, known))
            except Failure as failure:
                if mark not in str(failure).splitlines()[0] or mark == "xyzzy":
                    faults.append("%s %s: %s" % (place, key, str(failure).splitlines()[0]))
                continue
            found = []
            judge(mark, before, after, {mark} if "%s %s" % (place, key) in GLTF_QUIET else (), found)
            faults += ["%s: %s" % (place, line) for line in found]
        for name, (beside, keys) in EXTENSIONS.items():
            keys = dict(keys, xyzzy=1)
            more = {"KHR_materials_transmission": {"transmissionFactor": .5}} if "volume" in name or "dispersion" in name else {}
            base = placed(scene, "materials.0", "extensions", dict(more, **{name: beside}), known)
            before = read(base)
            for key, value in keys.items():
                after = read(placed(base, "materials.0.extensions." + name, key, value, known))
                found = []
                judge(key, before, after, {key} if "%s %s" % (name, key) in GLTF_QUIET else (), found)
                faults += ["%s: %s" % (name, line) for line in found]
    settle(faults)


def gltf_table():
    """The importer's table of keys, as docs/FORMATS.md has it."""
    with open(os.path.join(ROOT, "client/import/gltf/gltf_keys.c")) as source:
        text = source.read().split("} objects[] = {")[1].split("\n};")[0]
    rows = re.findall(r'\{"(\w+)",((?:\s*"[^"]*")+)\}', text)
    lines = ["| object | keys |", "|---|---|"]
    for name, keys in rows:
        keys = "".join(re.findall('"([^"]*)"', keys)).split()
        names = ["`%s`" % re.sub(r"\*?>.*", "", key).replace("#", "...") for key in keys]
        lines.append("| %s | %s |" % ("the file" if name == "file" else "`%s`" % name, " ".join(names) or "-"))
    return "\n".join(lines) + "\n"


@tests.add
def gltf_document():
    """docs/FORMATS.md has the importer's table of glTF's keys"""
    with open(os.path.join(ROOT, "docs/FORMATS.md")) as source:
        if gltf_table() not in source.read():
            raise Failure("docs/FORMATS.md should have this table:\n" + gltf_table())


# ---- pbrt ---------------------------------------------------------------------------------------

WORLD = """%(film)s
%(before)s
Camera %(camera)s
WorldBegin
Texture "t" "spectrum" "imagemap" "string filename" "a.png"
Texture "f" "float" "imagemap" "string filename" "a.png"
MakeNamedMaterial "m1" "string type" "%(diffuse)s"
MakeNamedMaterial "m2" "string type" "%(diffuse)s" "rgb %(color)s" [1 0 0]
LightSource "point" "point3 from" [0 3 0]
%(world)s
Shape "trianglemesh" "integer indices" [0 1 2] "point3 P" [5 0 0 6 0 0 5 1 0] "point2 uv" [0 0 1 0 0 1]
"""
V4 = {"film": 'Film "rgb" "integer xresolution" 32 "integer yresolution" 16', "before": "", "camera": '"perspective" "float fov" 50',
      "world": "", "diffuse": "diffuse", "color": "reflectance"}
V3 = dict(V4, film='Film "image" "integer xresolution" 32 "integer yresolution" 16', diffuse="matte", color="Kd")
ROUGH = {"float roughness": .3, "float uroughness": .2, "float vroughness": .4}
MATERIAL = 'Material "%s" %%s'
TEXTURE = 'Texture "x" "spectrum" "%s" %%s\nMaterial "diffuse" "texture reflectance" "x"'
NUMBERS = 'Texture "x" "float" "%s" %%s\nMaterial "diffuse" "texture reflectance" "x"'
LIGHT = 'LightSource "%s" %%s'
SHAPE = 'Shape "%s" %%s'
MEDIUM = 'MakeNamedMedium "fog" "string type" "%s" %%s\nMediumInterface "fog" ""\nMaterial "interface"\nShape "sphere"'
P4 = '"point3 P" [0 0 0 1 0 0 0 1 0 1 1 2]'
V4_PARAMETERS = [  # the place in the scene, the line, what it has beside, and the parameters
    ("world", MATERIAL % "diffuse", "", {"rgb reflectance": "[.1 .2 .3]", "string normalmap": "b.png", "texture displacement": "f", "bool xyzzy": "true"}),
    ("world", MATERIAL % "coateddiffuse", '"float roughness" .1',
     dict(ROUGH, **{"rgb reflectance": "[.1 .2 .3]", "float eta": 1.8, "float thickness": .1, "bool remaproughness": "false", "integer maxdepth": 3,
                    "integer nsamples": 4, "rgb albedo": "[.5 .5 .5]", "float g": .5, "string normalmap": "b.png", "texture displacement": "f", "float xyzzy": 1})),
    ("world", MATERIAL % "coatedconductor", '"float interface.roughness" .1 "float conductor.roughness" .1',
     {"float interface.roughness": .3, "float interface.uroughness": .2, "float interface.vroughness": .4, "float interface.thickness": .1,
      "float interface.eta": 1.8, "spectrum conductor.eta": "metal-Ag-eta", "spectrum conductor.k": "metal-Ag-k", "rgb reflectance": "[.1 .2 .3]",
      "float conductor.roughness": .3, "float conductor.uroughness": .2, "float conductor.vroughness": .4, "bool remaproughness": "false",
      "integer maxdepth": 3, "integer nsamples": 4, "rgb albedo": "[.5 .5 .5]", "float g": .5, "string normalmap": "b.png", "texture displacement": "f",
      "float xyzzy": 1}),
    ("world", MATERIAL % "conductor", '"float roughness" .1',
     dict(ROUGH, **{"spectrum eta": "metal-Ag-eta", "spectrum k": "metal-Ag-k", "rgb reflectance": "[.1 .2 .3]", "bool remaproughness": "false",
                    "string normalmap": "b.png", "texture displacement": "f", "float xyzzy": 1})),
    ("world", MATERIAL % "dielectric", '"float roughness" .1',
     dict(ROUGH, **{"float eta": 1.8, "bool remaproughness": "false", "string normalmap": "b.png", "texture displacement": "f", "float xyzzy": 1})),
    ("world", MATERIAL % "thindielectric", "", {"float eta": 1.8, "string normalmap": "b.png", "texture displacement": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "diffusetransmission", "", {"rgb reflectance": "[.1 .2 .3]", "rgb transmittance": "[.1 .2 .3]", "float scale": .5,
                                                     "string normalmap": "b.png", "texture displacement": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "mix", '"string materials" ["m1" "m2"]', {"string materials": '["m2" "m1"]', "float amount": .2, "float xyzzy": 1}),
    ("world", TEXTURE % "imagemap", '"string filename" "a.png"',
     {"string filename": "b.png", "string wrap": "clamp", "string filter": "point", "float maxanisotropy": 4, "float scale": .5, "bool invert": "true",
      "string encoding": "linear", "string mapping": "spherical", "float uscale": 2, "float vscale": 2, "float udelta": .3, "float vdelta": .3, "float xyzzy": 1}),
    ("world", TEXTURE % "imagemap", '"string filename" "a.png" "string mapping" "planar"', {"vector3 v1": "[2 0 0]", "vector3 v2": "[0 2 0]"}),
    ("world", TEXTURE % "constant", "", {"rgb value": "[.1 .2 .3]", "float xyzzy": 1}),
    ("world", TEXTURE % "scale", '"rgb tex" [.5 .5 .5]', {"rgb tex": "[.1 .2 .3]", "float scale": .5, "float xyzzy": 1}),
    ("world", TEXTURE % "mix", "", {"rgb tex1": "[.1 .2 .3]", "rgb tex2": "[.1 .2 .3]", "float amount": .2, "float xyzzy": 1}),
    ("world", TEXTURE % "bilerp", "", {"rgb v00": "[.1 .2 .3]", "rgb v01": "[.1 .2 .3]", "rgb v10": "[.1 .2 .3]", "rgb v11": "[.1 .2 .3]", "float xyzzy": 1}),
    ("world", TEXTURE % "checkerboard", "", {"integer dimension": 3, "rgb tex1": "[.1 .2 .3]", "rgb tex2": "[.1 .2 .3]", "float uscale": 3, "float xyzzy": 1}),
    ("world", TEXTURE % "dots", "", {"rgb inside": "[.1 .2 .3]", "rgb outside": "[.1 .2 .3]", "float uscale": 3, "float xyzzy": 1}),
    ("world", LIGHT % "point", "", {"rgb I": "[1 2 3]", "float scale": 2, "float power": 5, "point3 from": "[1 2 3]", "float xyzzy": 1}),
    ("world", LIGHT % "spot", "", {"rgb I": "[1 2 3]", "float scale": 2, "float power": 5, "point3 from": "[1 2 3]", "point3 to": "[1 2 3]",
                                   "float coneangle": 20, "float conedeltaangle": 2, "float xyzzy": 1}),
    ("world", LIGHT % "distant", "", {"rgb L": "[1 2 3]", "float scale": 2, "float illuminance": 5, "point3 from": "[1 2 3]", "point3 to": "[1 2 3]",
                                      "float xyzzy": 1}),
    ("world", LIGHT % "goniometric", '"string filename" "a.png"', {"string filename": "b.png", "rgb I": "[1 2 3]", "float scale": 2, "float power": 5,
                                                                   "float xyzzy": 1}),
    ("world", LIGHT % "projection", '"string filename" "a.png"', {"string filename": "b.png", "rgb I": "[1 2 3]", "float scale": 2, "float power": 5,
                                                                  "float fov": 30, "float xyzzy": 1}),
    ("world", LIGHT % "infinite", "", {"rgb L": "[1 2 3]", "string filename": "a.png", "float scale": 2, "float illuminance": 5, "float xyzzy": 1}),
    ("world", LIGHT % "infinite", '"string filename" "a.png"', {"point3 portal": "[0 0 0 1 0 0 1 1 0 0 1 0]"}),
    ("world", 'AreaLightSource "diffuse" %s\nShape "sphere"', "", {"rgb L": "[1 2 3]", "float scale": 2, "bool twosided": "true", "float power": 5,
                                                                   "string filename": "a.png", "float xyzzy": 1}),
    ("world", SHAPE % "sphere", "", {"float radius": 2, "float zmin": -.5, "float zmax": .5, "float phimax": 90, "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "cylinder", "", {"float radius": 2, "float zmin": -.5, "float zmax": .5, "float phimax": 90, "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "disk", "", {"float radius": 2, "float innerradius": .5, "float height": .5, "float phimax": 90, "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "trianglemesh", '"integer indices" [0 1 2 1 3 2] ' + P4,
     {"integer indices": "[0 1 2]", "point3 P": "[0 0 0 2 0 0 0 2 0 1 1 2]", "normal N": "[1 0 0 1 0 0 1 0 0 1 0 0]",
      "vector3 S": "[1 0 0 1 0 0 1 0 0 1 0 0]", "point2 uv": "[0 0 0 1 1 0 1 1]", "integer faceIndices": "[1 2]", "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "bilinearmesh", '"integer indices" [0 1 2 3] ' + P4,
     {"integer indices": "[1 0 3 2]", "normal N": "[1 0 0 1 0 0 1 0 0 1 0 0]", "point2 uv": "[0 0 0 1 1 0 1 .5]", "integer faceIndices": "[1]",
      "string emissionfilename": "a.png", "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "plymesh", '"string filename" "m.ply"', {"texture displacement": "f", "float edgelength": .5, "bool displacement.uvscale": "true",
                                                              "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "curve", '"point3 P" [0 0 0 1 0 1 0 1 0 1 1 2 2 0 0 2 1 0 3 0 0]',
     {"string type": "cylinder", "string basis": "bspline", "integer degree": 2, "float width": 2, "float width0": 2, "float width1": .5,
      "integer splitdepth": 1, "float alpha": .5, "float xyzzy": 1}),
    ("world", SHAPE % "curve", '"string type" "ribbon" "normal N" [0 0 1 0 0 1] "point3 P" [0 0 0 1 0 1 0 1 0 1 1 2]', {"normal N": "[0 1 0 0 0 1]"}),
    ("world", SHAPE % "loopsubdiv", '"integer indices" [0 1 2 1 3 2] ' + P4, {"integer levels": 1, "string scheme": "loop", "float alpha": .5, "float xyzzy": 1}),
    ("world", MEDIUM % "homogeneous", "", {"rgb sigma_a": "[.1 .2 .3]", "rgb sigma_s": "[.1 .2 .3]", "float scale": 2, "rgb Le": "[1 2 3]", "float g": .5,
                                           "string preset": "Apple", "float xyzzy": 1}),
    ("world", MEDIUM % "homogeneous", '"rgb Le" [1 1 1]', {"float Lescale": 3}),
    ("world", MEDIUM % "uniformgrid", '"integer nx" 2 "integer ny" 1 "integer nz" 1 "float density" [.5 1]',
     {"rgb sigma_a": "[.1 .2 .3]", "rgb sigma_s": "[.1 .2 .3]", "float scale": 2, "rgb Le": "[1 2 3]", "float g": .5, "float density": "[1 .5]",
      "point3 p0": "[-1 0 0]", "point3 p1": "[2 2 2]", "float temperature": "[300 400]", "string preset": "Apple", "float xyzzy": 1}),
    ("world", MEDIUM % "uniformgrid", '"integer nx" 2 "integer ny" 1 "integer nz" 1 "float density" [.5 1] "float temperature" [300 400]',
     {"float temperatureoffset": 2, "float temperaturescale": 3, "float temperaturecutoff": 3}),
    ("camera", '"perspective" %s', "", {"float fov": 30, "float frameaspectratio": 3, "float screenwindow": "[-.5 .5 -.5 .5]", "float lensradius": .1,
                                        "float shutteropen": .5, "float shutterclose": 3, "float xyzzy": 1}),
    ("camera", '"perspective" %s', '"float lensradius" .1', {"float focaldistance": 3}),
    ("camera", '"orthographic" %s', "", {"float frameaspectratio": 3, "float screenwindow": "[-.5 .5 -.5 .5]", "float lensradius": .1, "float xyzzy": 1}),
    ("camera", '"spherical" %s', '"string mapping" "equirectangular"', {"string mapping": "equalarea", "float xyzzy": 1}),
    ("film", 'Film "rgb" %s', "", {"integer xresolution": 64, "integer yresolution": 32, "float cropwindow": "[0 .5 0 .5]", "integer pixelbounds": "[0 9 0 9]",
                                   "float diagonal": 70, "string filename": "x.exr", "bool savefp16": "false", "string sensor": "nikon_d850", "float iso": 400,
                                   "float whitebalance": 3000, "float imagingratio": 2, "float maxcomponentvalue": 2, "float xyzzy": 1}),
    ("before", 'Sampler "zsobol" %s', "", {"integer pixelsamples": 77, "integer seed": 3, "string randomization": "none", "float xyzzy": 1}),
    ("before", 'Sampler "stratified" %s', "", {"bool jitter": "false", "integer xsamples": 7, "integer ysamples": 7, "float xyzzy": 1}),
    ("before", 'Integrator "volpath" %s', "", {"integer maxdepth": 17, "bool regularize": "true", "string lightsampler": "uniform", "float xyzzy": 1}),
    ("before", 'Integrator "simplepath" %s', "", {"bool samplelights": "false", "bool samplebsdf": "false", "float xyzzy": 1}),
    ("before", 'Integrator "bdpt" %s', "", {"bool visualizestrategies": "true", "bool visualizeweights": "true", "float xyzzy": 1}),
    ("before", 'Integrator "mlt" %s', "", {"integer bootstrapsamples": 9, "integer chains": 9, "integer mutationsperpixel": 9,
                                           "float largestepprobability": .9, "float sigma": .1, "float xyzzy": 1}),
    ("before", 'Integrator "sppm" %s', "", {"integer photonsperiteration": 9, "float radius": .1, "integer seed": 9, "float xyzzy": 1}),
    ("before", 'Accelerator "bvh" %s', "", {"integer maxnodeprims": 9, "string splitmethod": "middle", "float xyzzy": 1}),
    ("before", 'Option %s', "", {"bool disablepixeljitter": "true", "bool disabletexturefiltering": "true", "bool disablewavelengthjitter": "true",
                                 "float displacementedgescale": 2, "bool forcediffuse": "true", "string msereferenceimage": "a.exr",
                                 "string msereferenceout": "a.txt", "bool pixelstats": "true", "string rendercoordsys": "world", "integer seed": 9,
                                 "bool quiet": "true", "bool xyzzy": "true"}),
]
QUADRIC = {"float phimax": 90, "float alpha": .5, "float shadowalpha": .5, "float xyzzy": 1}
V3_PARAMETERS = [
    ("world", MATERIAL % "matte", "", {"rgb Kd": "[.1 .2 .3]", "float sigma": 20, "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "plastic", "", {"rgb Kd": "[.1 .2 .3]", "rgb Ks": "[.1 .2 .3]", "float roughness": .3, "bool remaproughness": "false",
                                         "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "metal", "", dict(ROUGH, **{"rgb eta": "[1 1 1]", "rgb k": "[1 2 3]", "bool remaproughness": "false", "texture bumpmap": "f",
                                                     "float xyzzy": 1})),
    ("world", MATERIAL % "mirror", "", {"rgb Kr": "[.1 .2 .3]", "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "glass", '"float uroughness" .1 "float vroughness" .1',
     {"rgb Kr": "[.1 .2 .3]", "rgb Kt": "[.1 .2 .3]", "float uroughness": .3, "float vroughness": .3, "float eta": 1.8, "float index": 1.8,
      "bool remaproughness": "false", "texture bumpmap": "f", "float roughness": .5, "float xyzzy": 1}),
    ("world", MATERIAL % "translucent", "", {"rgb Kd": "[.1 .2 .3]", "rgb Ks": "[.1 .2 .3]", "rgb reflect": "[.1 .2 .3]", "rgb transmit": "[.1 .2 .3]",
                                             "float roughness": .3, "bool remaproughness": "false", "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "uber", "", dict(ROUGH, **{"rgb Kd": "[.1 .2 .3]", "rgb Ks": "[.1 .2 .3]", "rgb Kr": "[.1 .2 .3]", "rgb Kt": "[.1 .2 .3]",
                                                    "float eta": 1.8, "float index": 1.8, "rgb opacity": "[.5 .5 .5]", "bool remaproughness": "false",
                                                    "texture bumpmap": "f", "float xyzzy": 1})),
    ("world", MATERIAL % "substrate", "", {"rgb Kd": "[.1 .2 .3]", "rgb Ks": "[.1 .2 .3]", "float uroughness": .3, "float vroughness": .3,
                                           "bool remaproughness": "false", "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "disney", '"float clearcoat" .5 "float sheen" .5',
     {"rgb color": "[.1 .2 .3]", "float metallic": .5, "float eta": 1.8, "float roughness": .3, "float speculartint": .5, "float anisotropic": .5,
      "float sheen": .8, "float sheentint": .9, "float clearcoat": .8, "float clearcoatgloss": .5, "float spectrans": .5,
      "rgb scatterdistance": "[1 1 1]", "bool thin": "true", "float difftrans": .5, "float flatness": .5, "texture bumpmap": "f", "float xyzzy": 1}),
    ("world", MATERIAL % "mix", '"string namedmaterial1" "m1" "string namedmaterial2" "m2"', {"rgb amount": "[.2 .2 .2]", "string namedmaterial1": "m2",
                                                                                             "string namedmaterial2": "m1", "float xyzzy": 1}),
    ("world", TEXTURE.replace("diffuse", "matte").replace("reflectance", "Kd") % "imagemap", '"string filename" "a.png"',
     {"string wrap": "clamp", "bool gamma": "false", "bool trilinear": "true", "float maxanisotropy": 4, "float scale": .5, "string mapping": "spherical",
      "float uscale": 2, "float xyzzy": 1}),
    ("world", TEXTURE.replace("diffuse", "matte").replace("reflectance", "Kd") % "checkerboard", "",
     {"string aamode": "none", "integer dimension": 3, "rgb tex1": "[.1 .2 .3]", "float xyzzy": 1}),
    ("world", LIGHT % "point", "", {"rgb I": "[1 2 3]", "rgb scale": "[1 2 3]", "point from": "[1 2 3]", "float xyzzy": 1}),
    ("world", LIGHT % "spot", "", {"float coneangle": 20, "float conedeltaangle": 2, "float xyzzy": 1}),
    ("world", LIGHT % "goniometric", '"string mapname" "a.png"', {"string mapname": "b.png", "rgb I": "[1 2 3]", "float xyzzy": 1}),
    ("world", LIGHT % "projection", '"string mapname" "a.png"', {"string mapname": "b.png", "float fov": 30, "rgb I": "[1 2 3]", "float xyzzy": 1}),
    ("world", LIGHT % "infinite", "", {"string mapname": "a.png", "rgb L": "[1 2 3]", "integer samples": 9, "integer nsamples": 9, "float xyzzy": 1}),
    ("world", 'AreaLightSource "diffuse" %s\nShape "sphere"', "", {"rgb L": "[1 2 3]", "bool twosided": "true", "integer samples": 9, "integer nsamples": 9,
                                                                   "float xyzzy": 1}),
    ("world", SHAPE % "cone", "", dict(QUADRIC, **{"float radius": 2, "float height": 2})),
    ("world", SHAPE % "paraboloid", "", dict(QUADRIC, **{"float radius": 2, "float zmin": .2, "float zmax": 2})),
    ("world", SHAPE % "hyperboloid", "", dict(QUADRIC, **{"point p1": "[1 2 3]", "point p2": "[3 2 1]"})),
    ("world", SHAPE % "trianglemesh", '"integer indices" [0 1 2 1 3 2] ' + P4.replace("point3", "point"),
     {"float st": "[0 0 0 1 1 0 1 1]", "float uv": "[0 0 0 1 1 0 1 1]", "vector S": "[1 0 0 1 0 0 1 0 0 1 0 0]", "texture alpha": "f",
      "texture shadowalpha": "f", "integer faceIndices": "[1 2]", "float xyzzy": 1}),
    ("world", SHAPE % "loopsubdiv", '"integer indices" [0 1 2 1 3 2] ' + P4.replace("point3", "point"), {"integer levels": 1, "integer nlevels": 1,
                                                                                                        "string scheme": "loop", "float xyzzy": 1}),
    ("film", 'Film "image" %s', "", {"float scale": 2, "float diagonal": 70, "float maxsampleluminance": 2, "string filename": "x.exr",
                                     "float cropwindow": "[0 .5 0 .5]", "float xyzzy": 1}),
    ("before", 'Integrator "directlighting" %s', "", {"string strategy": "one", "float xyzzy": 1}),
    ("before", 'Integrator "path" %s', "", {"integer maxdepth": 17, "float rrthreshold": .5, "string lightsamplestrategy": "uniform",
                                           "integer pixelbounds": "[0 9 0 9]", "float xyzzy": 1}),
    ("before", 'Sampler "halton" %s', "", {"integer pixelsamples": 77, "bool samplepixelcenter": "true", "integer dimensions": 9, "float xyzzy": 1}),
    ("camera", '"environment" %s', "", {"float shutteropen": .5, "float shutterclose": 3, "float lensradius": .1, "float xyzzy": 1}),
]
PBRT_KINDS = {  # those that are not read as they are meant: the kind is named
    "world": [MATERIAL % kind for kind in ("hair", "measured", "subsurface", "kdsubsurface", "fourier", "xyzzy")] +
             [TEXTURE % kind for kind in ("ptex", "directionmix", "marble", "xyzzy")] + [NUMBERS % kind for kind in ("fbm", "wrinkled", "windy")] +
             [SHAPE % kind for kind in ("heightfield", "nurbs", "xyzzy")] + [LIGHT % "xyzzy"] + ['AreaLightSource "xyzzy" %s\nShape "sphere"'] +
             [MEDIUM % kind for kind in ("rgbgrid", "cloud", "nanovdb", "xyzzy")],
    "before": ['Integrator "%s" %%s' % kind for kind in ("ambientocclusion", "function", "whitted", "xyzzy")] +
              ['PixelFilter "%s" %%s' % kind for kind in ("mitchell", "sinc", "xyzzy")],
    "film": ['Film "gbuffer" %s', 'Film "spectral" %s'],
}
PBRT_QUIET = {
    # how it is worked out, not what
    "nsamples", "samples", "splitdepth", "maxanisotropy", "trilinear", "lightsampler", "lightsamplestrategy", "rrthreshold", "dimensions", "jitter", "randomization",
    "seed of zsobol", "seed of Option", "maxnodeprims", "splitmethod", "xyzzy of Accelerator", "visualizestrategies", "visualizeweights", "aamode",
    "maxdepth of coateddiffuse", "maxdepth of coatedconductor",  # ours is the limit of many
    "thickness", "interface.thickness", "g of coateddiffuse", "g of coatedconductor",  # of an "albedo", which has a warning
    "v1", "v2",  # of a "mapping", which has a warning
    "edgelength", "displacement.uvscale", "displacementedgescale",  # of a "displacement", which has a warning
    "Ks of translucent", "roughness of translucent", "remaproughness of translucent",  # its gloss, which has a warning
    "type of curve",  # flat ones and cylinders are tubes
    "scheme",  # there is one
    "shutteropen of environment", "shutterclose of environment",  # no exposure in pbrt-v3; nothing moves here
    # what the program says and writes
    "filename of Film", "savefp16", "pixelstats", "msereferenceimage", "msereferenceout", "rendercoordsys",
    "diagonal",  # of the film, for lenses of the realistic camera
    "faceIndices",  # for other textures
}


def pbrt_value(declaration, value):
    text = str(value)
    return '"%s" %s' % (declaration, text if text.startswith("[") or not declaration.startswith(("string", "texture", "spectrum")) else '"%s"' % text)


def pbrt_check(version, parameters, faults):
    with Folder() as folder:
        def read(place, line):
            return folder.read("a.pbrt", WORLD % dict(version, **{place: line}))
        for place, line, beside, values in parameters:
            plug = [word for word in re.findall('"([^"]+)"', line) + [line.split()[0]] if word not in ("x", "spectrum", "fog", "string type")][0]
            word = line.split()[0]
            without = read(place, line % beside)
            for declaration, value in values.items():
                name = declaration.split()[1]
                kept = " ".join(p for p in re.findall(r'"[^"]*" (?:\[[^]]*\]|"[^"]*"|\S+)', beside) if p.split('"')[1] != declaration)
                quiet = {q.split(" of ")[0] for q in PBRT_QUIET if " of " not in q or q.split(" of ")[1] in (plug, word)}
                found = []
                try:
                    judge(name, without, read(place, line % (kept + " " + pbrt_value(declaration, value))), quiet, found)
                except Failure as failure:
                    found = [str(failure).splitlines()[0]]
                faults += ["%s \"%s\": %s" % (word, plug, text) for text in found]


@tests.add
def pbrt_v4():
    """each parameter of pbrt-v4's plug-ins changes the scene or is named"""
    faults = []
    pbrt_check(V4, V4_PARAMETERS, faults)
    settle(faults)


@tests.add
def pbrt_v3():
    """each parameter of pbrt-v3's plug-ins changes the scene or is named"""
    faults = []
    pbrt_check(V3, V3_PARAMETERS, faults)
    settle(faults)


PBRT_DIRECTIVES = {  # each before a sphere
    "Identity": ("Translate 1 2 3", "Identity"), "Translate": "Translate 1 2 3", "Scale": "Scale 1 2 3", "Rotate": "Rotate 30 1 0 0",
    "LookAt": "LookAt 1 2 3 0 0 0 0 1 0", "Transform": "Transform [1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1]",
    "ConcatTransform": "ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1]",
    "CoordinateSystem": ('CoordinateSystem "a"\nTranslate 1 2 3\nCoordSysTransform "a"', 'CoordinateSystem "a"'),
    "CoordSysTransform": ("Translate 1 2 3", 'CoordSysTransform "camera"'), "ReverseOrientation": "ReverseOrientation",
    "ActiveTransform": "ActiveTransform EndTime\nTranslate 1 2 3", "ColorSpace": 'ColorSpace "rec2020"', "Attribute": 'Attribute "shape" "float radius" 2',
    "AttributeBegin": ("Translate 1 2 3", "AttributeBegin\nTranslate 1 2 3\nAttributeEnd"),
    "TransformBegin": ("Translate 1 2 3", "TransformBegin\nTranslate 1 2 3\nTransformEnd"),
    "ObjectBegin": 'ObjectBegin "o"\nShape "disk"\nObjectEnd\nObjectInstance "o"', "Include": 'Include "part.pbrt"', "Import": 'Import "part.pbrt"',
    "NamedMaterial": 'NamedMaterial "m2"', "MediumInterface": 'MakeNamedMedium "x" "string type" "homogeneous"\nMediumInterface "x" ""\nMaterial "dielectric"',
    "xyzzy": "xyzzy",
}
PBRT_DIRECTIVES.update({'"float %s_xyzzy"' % target: 'Attribute "%s" "float %s_xyzzy" 1' % (target, target)
                        for target in ("shape", "light", "material", "medium", "texture")})


@tests.add
def pbrt_directives():
    """each directive of pbrt changes the scene, or is refused by name"""
    faults = []
    with Folder() as folder:
        folder.write("part.pbrt", 'Shape "disk"\n')
        for word, line in PBRT_DIRECTIVES.items():
            beside, line = line if isinstance(line, tuple) else ("", line)
            both = beside + "\n" + line if word in ("Identity", "CoordSysTransform") else line
            scenes = []
            for text in (beside, both):
                world = text + ('\nMaterial "diffuse" "rgb reflectance" [.1 .5 .3]' if word == "ColorSpace" else "") + '\nShape "sphere"'
                try:
                    scenes.append(folder.read("a.pbrt", WORLD % dict(V4, world=world)))
                except Failure as failure:
                    if word not in str(failure).splitlines()[0]:
                        faults.append("%s: %s" % (word, str(failure).splitlines()[0]))
            if len(scenes) == 2 and word != "CoordinateSystem":
                judge(word, *scenes, (), faults)
    settle(faults)


@tests.add
def pbrt_kinds():
    """a kind that is not read as it is meant is named, or refused by name"""
    faults = []
    with Folder() as folder:
        for place, lines in PBRT_KINDS.items():
            for line in lines:
                kind = [word for word in re.findall('"([^"]+)"', line) if word not in ("x", "spectrum", "float", "fog", "string type")][0]
                try:
                    warnings = folder.read("a.pbrt", WORLD % dict(V4, **{place: line % ""}))[1]
                except Failure as failure:
                    warnings = str(failure).splitlines()[:1]
                if not any(kind in text for text in warnings):
                    faults.append("%s: %s" % (line.split()[0], kind))
    settle(faults)


tests.run()
