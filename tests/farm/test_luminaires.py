"""EXT_lights_ies: what a measured luminaire sends to a floor, by its inverse square law."""
import base64
import json
import math
import os
import struct

import exr
from farm import Farm, Tests
from jobs import expect

tests = Tests()
SIDE, EDGE, HEIGHT = 32, 2.0, 1.0  # pixels, half of the floor, of the lamp above it
GREY = .5


def candela(vertical, horizontal):
    """Brightest between 0 and 90 degrees around; nothing is symmetric."""
    h, v = math.radians(horizontal), math.radians(vertical)
    return max(math.cos(v), 0) * (100 + 60 * math.cos(h) * math.sin(v) + 30 * math.sin(h) * math.sin(v))


def profile():
    vertical, horizontal = [5 * i for i in range(19)], [5 * i for i in range(73)]
    values = "\n".join(" ".join("%.6g" % candela(v, h) for v in vertical) for h in horizontal)
    return "IESNA:LM-63-1995\nTILT=NONE\n1 -1 1 %d %d 1 2 0 0 0\n1 1 10\n%s\n%s\n%s\n" % (
        len(vertical), len(horizontal), " ".join(map(str, vertical)), " ".join(map(str, horizontal)), values)


def quaternion(axis, degrees):
    s = math.sin(math.radians(degrees) / 2)
    return [axis[0] * s, axis[1] * s, axis[2] * s, math.cos(math.radians(degrees) / 2)]


def product(a, b):
    (x, y, z, w), (i, j, k, r) = a, b
    return [w * i + x * r + y * k - z * j, w * j - x * k + y * r + z * i, w * k + x * j - y * i + z * r, w * r - x * i - y * j - z * k]


def write(path, turn, animated):
    """A floor under a lamp that hangs and is turned by so many degrees around the vertical axis; animated: in 1 s, to the other side."""
    corners = struct.pack("<12f", -9, 0, -9, -9, 0, 9, 9, 0, 9, 9, 0, -9) + struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    data = corners + struct.pack("<2f", 0, 1) + struct.pack("<8f", *quaternion((0, 1, 0), turn), *quaternion((0, 1, 0), turn + 180))
    down = quaternion((1, 0, 0), -90)  # -z becomes -y
    scene = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0, 1, 2]}], "extensionsUsed": ["EXT_lights_ies"],
        "extensions": {"EXT_lights_ies": {"lights": [{"uri": "lamp.ies"}]}},
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 5, 0], "rotation": quaternion((1, 0, 0), -90)},
                  {"translation": [0, HEIGHT, 0], "rotation": quaternion((0, 1, 0), turn), "children": [3]},
                  {"name": "lamp", "rotation": down, "scale": [3, 3, 3],
                   "extensions": {"EXT_lights_ies": {"light": 0, "multiplier": 2, "color": [1, .5, 0]}}}],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": EDGE, "ymag": EDGE, "znear": .1, "zfar": 9}}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [GREY, GREY, GREY, 1], "metallicFactor": 0},
                       "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
        "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in ((0, 48), (48, 12), (60, 8), (68, 32))],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-9, 0, -9], "max": [9, 0, 9]},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
                      {"bufferView": 2, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]},
                      {"bufferView": 3, "componentType": 5126, "count": 2, "type": "VEC4"}]}
    if animated:
        scene["animations"] = [{"samplers": [{"input": 2, "output": 3, "interpolation": "STEP"}],
                                "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}]}]
    with open(path, "w") as file:
        json.dump(scene, file)


def wanted(px, py, turn):
    """The floor's radiance in the middle of a pixel: x to the right, -z up."""
    x, z = EDGE * (2 * (px + .5) / SIDE - 1), EDGE * (2 * (py + .5) / SIDE - 1)
    # Turned back: the node's x is the world's, its y the world's -z.
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    along, across = c * x - s * z, -(s * x + c * z)
    square = x * x + z * z + HEIGHT * HEIGHT
    cosine = HEIGHT / math.sqrt(square)
    light = candela(math.degrees(math.acos(cosine)), math.degrees(math.atan2(across, along)))
    return GREY / math.pi * 2 * light * cosine / square


def compare(picture, turn, words):
    red, green, blue = (picture.values(c) for c in "RGB")
    worst = max(abs(red[y * SIDE + x] / wanted(x, y, turn) - 1) for y in range(1, SIDE, 3) for x in range(1, SIDE, 3))
    expect(worst < .04, (words, worst))
    expect(all(abs(g - r / 2) < 1e-2 * r for r, g in zip(red, green)) and not any(blue), (words, "colour"))


@tests.add
def a_luminaire_lights_the_floor():
    """turned by any angle, and in motion"""
    with Farm() as farm:
        with open(farm.path("lamp.ies"), "w") as file:
            file.write(profile())
        options = ("--size", "%dx%d" % (SIDE, SIDE), "--spp", "64", "--light-units", "radiometric", "--fps", "24")
        for turn in (0, 90, -37):
            write(farm.path("still.gltf"), turn, False)
            farm.cli("render", farm.path("still.gltf"), *options, "-o", "still%d.exr" % turn, expect=0, connect=False)
            compare(exr.read_exr(farm.path("still%d.exr" % turn)), turn, turn)
        write(farm.path("moving.gltf"), 20, True)
        farm.cli("render", farm.path("moving.gltf"), *options, "--frames", "23-24", "-o", "moving/", expect=0, connect=False)
        for frame in (23, 24):
            compare(exr.read_exr(farm.path("moving", "moving-%04d.exr" % frame)), 20 + 180 * (frame == 24), "frame %d" % frame)


@tests.add
def a_damaged_profile_is_named():
    """the scene does without it, with a warning; --strict ends there"""
    with Farm() as farm:
        write(farm.path("scene.gltf"), 0, False)
        for text, words in ((None, "lamp.ies"), (profile()[:-40], "ends before its candela"), ("no profile\n", "not an IES profile")):
            if text is not None:
                with open(farm.path("lamp.ies"), "w") as file:
                    file.write(text)
            result = farm.cli("import", farm.path("scene.gltf"), connect=False, expect=0)
            expect("the light \"lamp.ies\" cannot be used" in result.out and words in result.out, result)
            result = farm.cli("import", farm.path("scene.gltf"), "--strict", connect=False)
            expect(result.code != 0 and words in result.err, result)


tests.run()
