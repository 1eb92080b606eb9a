#!/usr/bin/env python3
"""Writes one small scene for each effect of glTF materials, lights, cameras and animation.

All share a stage: a tiled ground, a lamp above, two softboxes at the sides, and three objects
whose materials differ in the one thing that the scene is about. The geometry is in
features.bin, which is the same each time; the scenes are written next to it.

    scenes/features/make_features.py [FOLDER]
"""
import json
import math
import os
import struct
import sys
import zlib

SEGMENTS, RINGS = 48, 24


class Stage:
    """One glTF file under construction."""

    def __init__(self):
        self.bin = bytearray()
        self.doc = {"asset": {"version": "2.0", "generator": "azulejo scenes",
                              "copyright": "Azulejo authors, Apache-2.0"},
                    "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
                    "materials": [], "accessors": [], "bufferViews": [], "cameras": []}
        self.extensions = set()

    def accessor(self, rows, kind, code="f", bounds=False):
        while len(self.bin) % 4:
            self.bin.append(0)
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        flat = [x for row in rows for x in (row if width > 1 else [row])]
        view = {"buffer": 0, "byteOffset": len(self.bin)}
        self.bin += struct.pack("<%d%s" % (len(flat), code), *flat)
        view["byteLength"] = len(self.bin) - view["byteOffset"]
        self.doc["bufferViews"].append(view)
        item = {"bufferView": len(self.doc["bufferViews"]) - 1, "count": len(flat) // width,
                "componentType": {"f": 5126, "H": 5123, "B": 5121}[code], "type": kind}
        if bounds:
            kept = [struct.unpack("<f", struct.pack("<f", x))[0] for x in flat]
            item["min"] = [min(kept[c::width]) for c in range(width)]
            item["max"] = [max(kept[c::width]) for c in range(width)]
        self.doc["accessors"].append(item)
        return len(self.doc["accessors"]) - 1

    def primitive(self, shape):
        attributes = {"POSITION": self.accessor(shape["positions"], "VEC3", bounds=True),
                      "NORMAL": self.accessor(shape["normals"], "VEC3"),
                      "TEXCOORD_0": self.accessor(shape["uvs"], "VEC2")}
        if "tangents" in shape:
            attributes["TANGENT"] = self.accessor(shape["tangents"], "VEC4")
        if "colors" in shape:
            attributes["COLOR_0"] = self.accessor(shape["colors"], "VEC4")
        return {"attributes": attributes,
                "indices": self.accessor(shape["indices"], "SCALAR", "H")}

    def material(self, name, base=(0.8, 0.8, 0.8, 1), metallic=0.0, roughness=0.5, **rest):
        extensions = rest.pop("extensions", None)
        m = {"name": name, "pbrMetallicRoughness": {
            "baseColorFactor": list(base) + [1] * (4 - len(base)),
            "metallicFactor": metallic, "roughnessFactor": roughness}}
        for key in ("baseColorTexture",):
            if key in rest:
                m["pbrMetallicRoughness"][key] = rest.pop(key)
        m.update(rest)
        if extensions:
            m["extensions"] = extensions
            self.extensions.update(extensions)
        self.doc["materials"].append(m)
        return len(self.doc["materials"]) - 1

    def mesh(self, name, primitive, material, **rest):
        p = dict(primitive, material=material)
        p.update({k: v for k, v in rest.items() if k in ("targets", "extensions")})
        mesh = {"name": name, "primitives": [p]}
        if "weights" in rest:
            mesh["weights"] = rest["weights"]
        self.doc["meshes"].append(mesh)
        return len(self.doc["meshes"]) - 1

    def node(self, root=True, **what):
        self.doc["nodes"].append(what)
        if root:
            self.doc["scenes"][0]["nodes"].append(len(self.doc["nodes"]) - 1)
        return len(self.doc["nodes"]) - 1

    def camera(self, eye, target, yfov=0.6):
        d = [t - e for t, e in zip(target, eye)]
        yaw = math.atan2(-d[0], -d[2])
        pitch = math.atan2(d[1], math.hypot(d[0], d[2]))
        sy, cy, sx, cx = (math.sin(yaw / 2), math.cos(yaw / 2), math.sin(pitch / 2),
                          math.cos(pitch / 2))
        self.doc["cameras"].append({"type": "perspective", "perspective": {
            "yfov": yfov, "aspectRatio": 1.5, "znear": 0.01}})
        return self.node(name="camera", camera=len(self.doc["cameras"]) - 1,
                         translation=list(eye), rotation=[cy * sx, sy * cx, -sy * sx, cy * cx])

    def image(self, uri):
        self.doc.setdefault("images", []).append({"uri": uri})
        self.doc.setdefault("samplers", [{"wrapS": 10497, "wrapT": 10497}])
        self.doc.setdefault("textures", []).append(
            {"source": len(self.doc["images"]) - 1, "sampler": 0})
        return {"index": len(self.doc["textures"]) - 1}

    def save(self, folder, name, bin_name):
        doc = self.doc
        if self.extensions:
            doc["extensionsUsed"] = sorted(self.extensions)
        doc["buffers"] = [{"byteLength": len(self.bin), "uri": bin_name}]
        for key in [k for k, v in doc.items() if v == []]:
            del doc[key]
        text = json.dumps(doc, indent=1, ensure_ascii=False)
        with open(os.path.join(folder, name + ".gltf"), "w") as out:
            out.write(text + "\n")
        with open(os.path.join(folder, bin_name), "wb") as out:
            out.write(self.bin)


def sphere():
    s = {"positions": [], "normals": [], "tangents": [], "uvs": [], "indices": []}
    for r in range(RINGS + 1):
        for k in range(SEGMENTS + 1):
            theta, phi = math.pi * r / RINGS, 2 * math.pi * (k % SEGMENTS) / SEGMENTS
            flat = 0 if r in (0, RINGS) else 1
            n = (math.sin(theta) * math.sin(phi) * flat, math.cos(theta),
                 math.sin(theta) * math.cos(phi) * flat)
            s["positions"].append(n)
            s["normals"].append(n)
            s["tangents"].append((math.cos(phi), 0, -math.sin(phi), 1))
            s["uvs"].append((k / SEGMENTS, r / RINGS))
    for r in range(RINGS):
        for k in range(SEGMENTS):
            a = r * (SEGMENTS + 1) + k
            b = a + SEGMENTS + 1
            if r > 0:
                s["indices"] += [a, b, a + 1]
            if r + 1 < RINGS:
                s["indices"] += [a + 1, b, b + 1]
    return s


def quad(repeats=1):
    """From -1 to 1 in x and z, facing up."""
    return {"positions": [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)],
            "normals": [(0, 1, 0)] * 4, "tangents": [(1, 0, 0, 1)] * 4,
            "uvs": [(0, repeats), (repeats, repeats), (repeats, 0), (0, 0)],
            "indices": [0, 1, 2, 0, 2, 3]}


def box():
    s = {"positions": [], "normals": [], "uvs": [], "indices": []}
    for axis in range(3):
        for sign in (-1, 1):
            base = len(s["positions"])
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                p = [0, 0, 0]
                p[axis] = sign
                p[(axis + 1) % 3] = u * sign
                p[(axis + 2) % 3] = v
                s["positions"].append(tuple(p))
                n = [0, 0, 0]
                n[axis] = sign
                s["normals"].append(tuple(n))
                s["uvs"].append(((u + 1) / 2, (v + 1) / 2))
            s["indices"] += [base, base + 1, base + 2, base, base + 2, base + 3]
    return s


def prism():
    """An equilateral one along z, edges of length 2, one edge up."""
    h = math.sqrt(3) / 2
    tri = [(-1, -h * 2 / 3), (1, -h * 2 / 3), (0, h * 4 / 3)]
    s = {"positions": [], "normals": [], "uvs": [], "indices": []}

    def face(corners):
        base = len(s["positions"])
        a, b, c = corners[:3]
        e1 = [y - x for x, y in zip(a, b)]
        e2 = [y - x for x, y in zip(a, c)]
        n = [e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2],
             e1[0] * e2[1] - e1[1] * e2[0]]
        length = math.sqrt(sum(x * x for x in n))
        for p in corners:
            s["positions"].append(p)
            s["normals"].append(tuple(x / length for x in n))
            s["uvs"].append((0, 0))
        for i in range(1, len(corners) - 1):
            s["indices"] += [base, base + i, base + i + 1]

    face([(x, y, 1) for x, y in tri])
    face([(x, y, -1) for x, y in reversed(tri)])
    for i in range(3):
        (x0, y0), (x1, y1) = tri[i], tri[(i + 1) % 3]
        face([(x0, y0, -1), (x1, y1, -1), (x1, y1, 1), (x0, y0, 1)])
    return s


def bar():
    """A tall box of 9 storeys, for bending: y from 0 to 2."""
    s = {"positions": [], "normals": [], "uvs": [], "indices": []}
    sides = [((-1, 1), (1, 1), (0, 1)), ((1, 1), (1, -1), (1, 0)), ((1, -1), (-1, -1), (0, -1)),
             ((-1, -1), (-1, 1), (-1, 0))]
    for (x0, z0), (x1, z1), (nx, nz) in sides:
        base = len(s["positions"])
        for level in range(10):
            for x, z, u in ((x0, z0, 0), (x1, z1, 1)):
                s["positions"].append((0.3 * x, 2 * level / 9, 0.3 * z))
                s["normals"].append((nx, 0, nz))
                s["uvs"].append((u, level / 9))
        for level in range(9):
            a = base + 2 * level
            s["indices"] += [a, a + 1, a + 3, a, a + 3, a + 2]
    base = len(s["positions"])
    for x, z in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
        s["positions"].append((0.3 * x, 2, 0.3 * z))
        s["normals"].append((0, 1, 0))
        s["uvs"].append((0, 0))
    s["indices"] += [base, base + 1, base + 2, base, base + 2, base + 3]
    return s


def write_hdr(path, width, height, paint):
    """Radiance RGBE without run lengths; paint(x, y) -> three floats."""
    def rgbe(rgb):
        top = max(rgb)
        if top <= 1e-32:
            return bytes(4)
        mantissa, exponent = math.frexp(top)
        scale = mantissa * 256 / top
        return bytes([int(v * scale) for v in rgb] + [exponent + 128])

    with open(path, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        out.write(b"".join(rgbe(paint(x, y)) for y in range(height) for x in range(width)))


def write_png(path, width, height, paint, alpha=False):
    """paint(x, y) -> codes 0..255, three or four."""
    rows = b"".join(b"\0" + bytes(c for x in range(width) for c in paint(x, y))
                    for y in range(height))

    def chunk(tag, data):
        body = tag + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", width, height, 8, 6 if alpha else 2, 0, 0, 0)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) +
                  chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def ext(**extensions):
    names = {"emissive": "emissive_strength", "diffuse_transmission": "diffuse_transmission"}
    return {"KHR_materials_" + names.get(k, k): v for k, v in extensions.items()}


GLASS = dict(base=(1, 1, 1), roughness=0.0)
RED, BLUE, GOLD = (0.7, 0.08, 0.06), (0.06, 0.2, 0.6), (1.0, 0.78, 0.34)


def variants_of(name, values, make):
    """Three materials named after their values."""
    return [(name + " %g" % v, make(v)) for v in values]


def solid(**volume):
    return dict(GLASS, extensions=ext(transmission={"transmissionFactor": 1},
                                      volume=dict({"thicknessFactor": 1}, **volume)))


# name: (object, [(material name, material arguments)])
MATERIALS = {
    "anisotropy": ("sphere", variants_of("strength", (0, 0.5, 1), lambda v: dict(
        base=(0.9, 0.9, 0.92), metallic=1, roughness=0.35,
        extensions=ext(anisotropy={"anisotropyStrength": v, "anisotropyRotation": 0.5})))),
    "clearcoat": ("sphere", variants_of("coat", (0, 0.5, 1), lambda v: dict(
        base=RED, metallic=0, roughness=0.7,
        extensions=ext(clearcoat={"clearcoatFactor": v, "clearcoatRoughnessFactor": 0.05})))),
    "diffuse-transmission": ("sphere", variants_of("through", (0, 0.5, 1), lambda v: dict(
        base=(0.3, 0.6, 0.15), roughness=0.9, doubleSided=True,
        extensions=ext(diffuse_transmission={
            "diffuseTransmissionFactor": v,
            "diffuseTransmissionColorFactor": [0.8, 0.8, 0.2]})))),
    "diffuse-roughness": ("sphere", variants_of("diffuse rough", (0, 0.5, 1), lambda v: dict(
        base=(0.8, 0.35, 0.2), roughness=1, extensions=ext(
            specular={"specularFactor": 0},
            diffuse_roughness={"diffuseRoughnessFactor": v})))),
    "dispersion": ("prism", variants_of("dispersion", (0, 0.5, 4), lambda v: dict(
        GLASS, extensions=ext(transmission={"transmissionFactor": 1}, ior={"ior": 1.6},
                              volume={"thicknessFactor": 1}, dispersion={"dispersion": v})))),
    "iridescence": ("sphere", variants_of("film nm", (200, 400, 800), lambda v: dict(
        base=(0.1, 0.1, 0.1), roughness=0.1, extensions=ext(iridescence={
            "iridescenceFactor": 1, "iridescenceIor": 1.8,
            "iridescenceThicknessMaximum": v})))),
    "metal": ("sphere", variants_of("rough", (0, 0.3, 1), lambda v: dict(
        base=GOLD, metallic=1, roughness=v))),
    "sheen": ("sphere", variants_of("sheen rough", (0.2, 0.5, 1), lambda v: dict(
        base=BLUE, roughness=1, extensions=ext(sheen={
            "sheenColorFactor": [0.9, 0.8, 0.7], "sheenRoughnessFactor": v})))),
    "specular": ("sphere", variants_of("specular", (0, 0.5, 1), lambda v: dict(
        base=(0.05, 0.05, 0.05), roughness=0.2, extensions=ext(
            specular={"specularFactor": v, "specularColorFactor": [1, 0.6, 0.2]},
            ior={"ior": 1.8})))),
    "thin-transmission": ("sphere", variants_of("thin rough", (0, 0.2, 0.5), lambda v: dict(
        base=(0.7, 0.9, 0.8), roughness=v,
        extensions=ext(transmission={"transmissionFactor": 1})))),
    "glass": ("sphere", variants_of("rough", (0, 0.15, 0.4), lambda v: dict(
        solid(), roughness=v))),
    "absorption": ("sphere", variants_of("distance", (4, 1, 0.25), lambda v: solid(
        attenuationDistance=v, attenuationColor=[0.9, 0.5, 0.2]))),
    "emissive-strength": ("sphere", variants_of("strength", (1, 2, 4), lambda v: dict(
        base=(0, 0, 0), emissiveFactor=[0.2, 0.6, 1.0],
        extensions=ext(emissive={"emissiveStrength": v})))),
    "unlit": ("sphere", variants_of("unlit", (0.25, 0.5, 1), lambda v: dict(
        base=(v, v / 2, 0), extensions=ext(unlit={})))),
    "alpha": ("sphere", [
        ("blend 0.5", dict(base=(0.9, 0.2, 0.1, 0.5), alphaMode="BLEND", doubleSided=True)),
        ("mask", dict(base=(1, 1, 1), alphaMode="MASK", doubleSided=True,
                      baseColorTexture="holes.png")),
        ("opaque", dict(base=(0.9, 0.2, 0.1, 0.5)))]),
    "normal-map": ("sphere", [
        ("half", dict(base=RED, roughness=0.3, normalTexture=("bumps.png", 0.5))),
        ("whole", dict(base=RED, roughness=0.3, normalTexture=("bumps.png", 1.0))),
        ("none", dict(base=RED, roughness=0.3))]),
}


def stage(objects=True, ground=True):
    """Ground, lamps and camera; the shapes come first, so that features.bin is always the same."""
    s = Stage()
    s.shapes = {"sphere": s.primitive(sphere()), "ground": s.primitive(quad(12)),
                "quad": s.primitive(quad()), "box": s.primitive(box()),
                "prism": s.primitive(prism()), "bar": s.primitive(bar())}
    if ground:
        tiles = s.material("tiles", base=(1, 1, 1), roughness=0.9,
                           baseColorTexture=s.image("checker.png"), doubleSided=True)
        s.node(name="ground", mesh=s.mesh("ground", s.shapes["ground"], tiles), scale=[12, 1, 12])
    lamp = s.material("lamp", base=(0, 0, 0), emissiveFactor=[1, 0.95, 0.9],
                      extensions=ext(emissive={"emissiveStrength": 8}))
    mesh = s.mesh("lamp", s.shapes["quad"], lamp)
    s.node(name="lamp", mesh=mesh, translation=[0, 6, 1], rotation=[1, 0, 0, 0],
           scale=[1.5, 1, 1.5])
    soft = s.material("softbox", base=(0, 0, 0), emissiveFactor=[0.8, 0.9, 1],
                      extensions=ext(emissive={"emissiveStrength": 2}))
    mesh = s.mesh("softbox", s.shapes["quad"], soft)
    half = math.sqrt(0.5)
    s.node(name="left", mesh=mesh, translation=[-6, 2.5, 2], rotation=[0, 0, -half, half],
           scale=[1.5, 1, 2])
    s.node(name="right", mesh=mesh, translation=[6, 2.5, 2], rotation=[0, 0, half, half],
           scale=[1.5, 1, 2])
    s.camera((0, 2.2, 8), (0, 0.8, 0))
    return s


def material_scene(shape, rows):
    s = stage()
    for i, (name, arguments) in enumerate(rows):
        arguments = dict(arguments)
        if "baseColorTexture" in arguments:
            arguments["baseColorTexture"] = s.image(arguments["baseColorTexture"])
        if "normalTexture" in arguments:
            image, scale = arguments["normalTexture"]
            arguments["normalTexture"] = dict(s.image(image), scale=scale)
        mesh = s.mesh(name, s.shapes[shape], s.material(name, **arguments))
        s.node(name=name, mesh=mesh, translation=[2.3 * (i - 1), 1 if shape != "prism" else 0.7, 0],
               **({"rotation": turn(math.pi / 2, (0, 1, 0))} if shape == "prism" else {}))
    if shape == "prism":
        # Bright and dark stripes to look at through the slanted faces.
        for i in range(4):
            m = s.material("stripe %d" % i, base=(0, 0, 0), emissiveFactor=[1, 1, 1])
            s.node(name="stripe", mesh=s.mesh("stripe", s.shapes["quad"], m),
                   translation=[0, 0.5 + 1.5 * i, -6], rotation=turn(math.pi / 2, (1, 0, 0)),
                   scale=[9, 1, 0.3])
    return s


def nested_scene():
    """A glass with water whose surface overlaps the glass's inside, and a ball in it."""
    s = stage()
    glass = s.material("glass", **dict(GLASS, extensions=ext(
        transmission={"transmissionFactor": 1}, ior={"ior": 1.5}, volume={"thicknessFactor": 1})))
    water = s.material("water", **dict(GLASS, extensions=ext(
        transmission={"transmissionFactor": 1}, ior={"ior": 1.33},
        volume={"thicknessFactor": 1, "attenuationDistance": 3,
                "attenuationColor": [0.6, 0.8, 0.9]})))
    ball = s.material("ball", base=RED, roughness=0.4)
    s.node(name="glass", mesh=s.mesh("glass", s.shapes["sphere"], glass), translation=[0, 1.2, 0],
           scale=[1.2] * 3)
    s.node(name="water", mesh=s.mesh("water", s.shapes["sphere"], water), translation=[0, 1.2, 0],
           scale=[0.9] * 3)
    s.node(name="ball", mesh=s.mesh("ball", s.shapes["sphere"], ball), translation=[0, 1.2, 0],
           scale=[0.4] * 3)
    return s


def lights_scene():
    s = stage()
    for node in s.doc["nodes"]:
        if node.get("name") in ("lamp", "left", "right"):
            s.doc["scenes"][0]["nodes"].remove(s.doc["nodes"].index(node))
    plain = s.material("plain", roughness=0.6)
    for i in range(3):
        s.node(name="ball %d" % i, mesh=s.mesh("ball", s.shapes["sphere"], plain),
               translation=[2.3 * (i - 1), 1, 0])
    s.extensions.add("KHR_lights_punctual")
    s.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "name": "point", "color": [1, 0.6, 0.3], "intensity": 12},
        {"type": "spot", "name": "spot", "color": [0.4, 0.7, 1], "intensity": 60,
         "spot": {"innerConeAngle": 0.15, "outerConeAngle": 0.3}},
        {"type": "directional", "name": "sun", "intensity": 0.8}]}}
    half = math.sin(-0.6), math.cos(-0.6)
    place = [dict(translation=[-2.3, 3.2, 1.5]),
             dict(translation=[0, 5, 3], rotation=[half[0] * 0.8, 0, 0, 0.87]),
             dict(rotation=[-0.35, 0.35, 0.15, 0.85])]
    for i, where in enumerate(place):
        s.node(name="light %d" % i, extensions={"KHR_lights_punctual": {"light": i}}, **where)
    return s


def textures_scene():
    """A ground that runs to the horizon: what is not filtered by its footprint shimmers."""
    s = stage(ground=False)
    tiles = s.material("tiles", base=(1, 1, 1), roughness=1.0,
                       baseColorTexture=s.image("checker.png"), doubleSided=True)
    s.node(name="ground", mesh=s.mesh("ground", s.primitive(quad(400)), tiles),
           scale=[400, 1, 400])
    return s


def horizon_scene():
    """Fine checks from below the camera to the horizon, lit by nothing: every sample is a lookup,
    and tests/statistics/test_texture_filter.c knows what each should say. The ground is turned, so
    that a row of pixels meets the checks in all phases."""
    s = Stage()
    checks = s.material("checks", base=(1, 1, 1), baseColorTexture=s.image("checks.png"),
                        doubleSided=True, extensions=ext(unlit={}))
    s.node(name="ground", mesh=s.mesh("ground", s.primitive(quad(3600)), checks),
           scale=[200, 1, 200], rotation=turn(0.5, (0, 1, 0)))
    s.camera((0, 1.5, 0), (0, 1.5 - math.tan(0.25), -1))
    return s


def many_lights_scene():
    s = stage()
    plain = s.material("plain", roughness=0.5)
    for i in range(3):
        s.node(name="ball %d" % i, mesh=s.mesh("ball", s.shapes["sphere"], plain),
               translation=[2.3 * (i - 1), 1, 0])
    for i in range(64):
        hue = [0.5 + 0.5 * math.cos(i * 0.7 + c * 2.1) for c in range(3)]
        m = s.material("bulb %d" % i, base=(0, 0, 0), emissiveFactor=hue,
                       extensions=ext(emissive={"emissiveStrength": 30}))
        x, z = (i % 8 - 3.5) * 1.1, (i // 8 - 5) * 1.1
        s.node(name="bulb", mesh=s.mesh("bulb", s.shapes["quad"], m), scale=[0.05, 1, 0.05],
               translation=[x, 0.3 + 0.1 * math.sin(i), z], rotation=[1, 0, 0, 0])
    return s


def vertex_color_scene():
    """Three spheres painted at their vertices: by height, by longitude, and not at all."""
    s = stage()
    white = s.material("white", base=(1, 1, 1), roughness=0.8)
    for i in range(3):
        shape = sphere()
        if i < 2:
            shape["colors"] = [((1 + n[1]) / 2, 0.3, (1 - n[1]) / 2, 1) if i == 0 else
                               ((1 + n[0]) / 2, (1 + n[2]) / 2, 0.2, 1) for n in shape["normals"]]
        s.node(name="ball %d" % i, mesh=s.mesh("ball", s.primitive(shape), white),
               translation=[2.3 * (i - 1), 1, 0])
    return s


def orthographic_scene():
    """Three spheres one behind the other are equally large."""
    s = stage()
    s.doc["cameras"][0] = {"type": "orthographic", "orthographic": {
        "xmag": 4.2, "ymag": 2.8, "znear": 0.01, "zfar": 100}}
    for i, color in enumerate((RED, GOLD, BLUE)):
        m = s.material("ball %d" % i, base=color, roughness=0.5)
        s.node(name="ball %d" % i, mesh=s.mesh("ball", s.shapes["sphere"], m),
               translation=[2.3 * (i - 1), 1, 4 * (1 - i)])
    return s


def culling_scene():
    """Three upright squares that turn their fronts, their backs, and their double-sided backs."""
    s = stage()
    half = math.sqrt(0.5)
    front, back = [half, 0, 0, half], [-half, 0, 0, half]
    rows = (("front", front, False), ("back", back, False), ("both", back, True))
    for i, (name, turned, both) in enumerate(rows):
        m = s.material(name, base=RED, roughness=0.9, **({"doubleSided": True} if both else {}))
        s.node(name=name, mesh=s.mesh(name, s.shapes["quad"], m), translation=[2.3 * (i - 1), 1, 0],
               rotation=turned, scale=[0.9] * 3)
    return s


def animation(s, channels):
    """channels: (node, path, times, values, kind)."""
    samplers, rows = [], []
    for node, path, times, values, kind in channels:
        samplers.append({"input": s.accessor(times, "SCALAR", bounds=True),
                         "output": s.accessor(values, kind), "interpolation": "LINEAR"})
        rows.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
    s.doc["animations"] = [{"name": "move", "samplers": samplers, "channels": rows}]


def turn(angle, axis):
    return [math.sin(angle / 2) * a for a in axis] + [math.cos(angle / 2)]


def motion_scene():
    """A ball that flies, a box that turns, a ball that stands. Seconds 0 to 1."""
    s = stage()
    plain = s.material("plain", base=RED, roughness=0.4)
    tiled = s.material("tiled", base=(1, 1, 1), roughness=0.6,
                       baseColorTexture={"index": 0})
    fly = s.node(name="flying", mesh=s.mesh("ball", s.shapes["sphere"], plain),
                 translation=[-3, 1, 0], scale=[0.8] * 3)
    spin = s.node(name="turning", mesh=s.mesh("box", s.shapes["box"], tiled),
                  translation=[0, 1.2, 0], scale=[0.8] * 3)
    s.node(name="standing", mesh=s.mesh("ball", s.shapes["sphere"], plain),
           translation=[2.5, 1, 0])
    animation(s, [(fly, "translation", [0, 1], [(-3, 1, 0), (-3, 9, 0)], "VEC3"),
                  (spin, "rotation", [0, 0.5, 1], [turn(0, (0, 1, 0)), turn(2, (0, 1, 0)),
                                                   turn(4, (0, 1, 0))], "VEC4")])
    return s


def deform_scene():
    """A skinned bar that bends, and a ball whose morph target makes it an egg."""
    s = stage()
    plain = s.material("plain", base=BLUE, roughness=0.4)
    shape = bar()
    primitive = json.loads(json.dumps(s.shapes["bar"]))
    weights = [(max(0, 1 - y / 2), min(1, y / 2), 0, 0) for _, y, _ in shape["positions"]]
    primitive["attributes"]["WEIGHTS_0"] = s.accessor(weights, "VEC4")
    primitive["attributes"]["JOINTS_0"] = s.accessor([(0, 1, 0, 0)] * len(weights), "VEC4", "B")
    tip = s.node(root=False, name="tip", translation=[0, 1, 0])
    root = s.node(name="root", translation=[-1.5, 0, 0], children=[tip])
    s.doc["skins"] = [{"joints": [root, tip], "inverseBindMatrices": s.accessor(
        [(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1),
         (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1)], "MAT4")}]
    s.node(name="bar", mesh=s.mesh("bar", primitive, plain), skin=0)
    ball = sphere()
    target = {"POSITION": s.accessor([(0, 0.6 * y if y > 0 else 0, 0)
                                      for _, y, _ in ball["positions"]], "VEC3", bounds=True)}
    egg = s.node(name="egg", mesh=s.mesh("egg", s.shapes["sphere"],
                                         s.material("egg", base=(0.9, 0.8, 0.6), roughness=0.5),
                                         targets=[target], weights=[0]), translation=[1.5, 1, 0])
    animation(s, [(tip, "rotation", [0, 1], [turn(0, (0, 0, 1)), turn(-1.5, (0, 0, 1))], "VEC4"),
                  (egg, "weights", [0, 1], [0, 1], "SCALAR")])
    return s


def variants_scene():
    s = stage()
    rows = [s.material("red", base=RED), s.material("blue", base=BLUE)]
    s.extensions.add("KHR_materials_variants")
    s.doc["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "red"},
                                                                   {"name": "blue"}]}}
    mappings = {"KHR_materials_variants": {"mappings": [
        {"material": rows[0], "variants": [0]}, {"material": rows[1], "variants": [1]}]}}
    plain = s.material("grey", base=(0.5, 0.5, 0.5))
    s.node(name="ball", mesh=s.mesh("ball", s.shapes["sphere"], plain, extensions=mappings),
           translation=[0, 1, 0])
    return s


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    join = os.path.join
    write_png(join(folder, "checker.png"), 64, 64,
              lambda x, y: (200, 196, 188) if (x // 32 + y // 32) % 2 else (70, 72, 80))
    write_png(join(folder, "checks.png"), 16, 16,
              lambda x, y: (230, 200, 120) if (x // 8 + y // 8) % 2 else (30, 60, 20))
    write_png(join(folder, "holes.png"), 64, 64,
              lambda x, y: (60, 150, 80, 0 if (x % 16 - 7.5) ** 2 + (y % 16 - 7.5) ** 2 < 30
                            else 255), alpha=True)

    def bump(x, y):
        dx, dy = math.cos(x * math.pi / 4), math.cos(y * math.pi / 4)
        n = math.sqrt(dx * dx + dy * dy + 1)
        return tuple(int(round((v / n * 0.5 + 0.5) * 255)) for v in (dx, dy, 1))
    write_png(join(folder, "bumps.png"), 64, 64, bump)
    slide = ((220, 40, 30), (240, 200, 40), (40, 160, 60), (40, 80, 200))
    write_png(join(folder, "slide.png"), 64, 64,
              lambda x, y: slide[x // 32 + 2 * (y // 32)] if (x // 4 + y // 4) % 2 else
              tuple(c // 4 for c in slide[x // 32 + 2 * (y // 32)]))

    def sky(x, y):
        if 10 <= x < 13 and 9 <= y < 11:
            return 60, 45, 25
        up = max(0, 1 - y / 16)
        return (0.5 - 0.3 * up, 0.6 - 0.2 * up, 0.7 + 0.1 * up) if y < 16 else (0.1, 0.09, 0.08)
    write_hdr(join(folder, "sky.hdr"), 64, 32, sky)
    scenes = {name: (lambda a=a: material_scene(*a)) for name, a in MATERIALS.items()}
    scenes.update({"nested": nested_scene, "lights": lights_scene, "variants": variants_scene,
                   "orthographic": orthographic_scene, "culling": culling_scene})
    for name, make in sorted(scenes.items()):
        make().save(folder, name, "features.bin")
    for name, make in (("motion", motion_scene), ("deformation", deform_scene),
                       ("vertex-color", vertex_color_scene),
                       ("many-lights", many_lights_scene), ("texture-filter", textures_scene),
                       ("horizon", horizon_scene)):
        make().save(folder, name, name + ".bin" if name != "many-lights" else "features.bin")


if __name__ == "__main__":
    main()
