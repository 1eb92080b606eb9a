"""What tests of retention and of back-ups share: what lies in a store, and a scene of many blobs."""
import json
import os
import random
import struct
import zlib

from farm import wait_for

SMALL = ("--size", "32x32", "--spp", "16")
LONG = ("--size", "128x80", "--frames", "1-2", "--spp", "128")
ENDLESS = ("--size", "320x200", "--spp", "1000000")
COLLECT_ALL = ("--keep-blobs", "0s")


def begun(farm, number):
    wait_for(lambda: farm.job(number)["samples_done"] > 0, "job %d to begin" % number)


def gc(farm):
    return farm.cli("gc", "--json", expect=0).json()


def total(store):
    """Bytes of what `show --farm` tells by kind."""
    return sum(store[kind] for kind in ("films", "pictures", "blobs", "database", "reserve", "other"))


def blobs(farm):
    found = set()
    for folder, _, names in os.walk(os.path.join(farm.store, "blobs")):
        if os.path.basename(folder) != "tmp":
            found.update(names)
    return found


def exists(farm, number):
    return farm.cli("show", number).code == 0


def films(farm, number):
    folder = os.path.join(farm.store, "films", str(number))
    return sorted(os.listdir(folder)) if os.path.exists(folder) else []


def pictures(farm, number):
    folder = os.path.join(farm.store, "outputs", str(number))
    return sorted(os.listdir(folder)) if os.path.exists(folder) else []


def trash(farm):
    folder = os.path.join(farm.store, "trash")
    return sorted(os.listdir(folder)) if os.path.exists(folder) else []


def log_of(farm, number):
    return farm.cli("log", number, expect=0).out


def scene_with_textures(farm, count):
    """A scene with many images, each a blob of its own."""
    noise = random.Random(7)

    def png():
        def chunk(kind, data):
            return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 48, 48, 8, 2, 0, 0, 0)) +
                chunk(b"IDAT", zlib.compress(b"".join(b"\0" + noise.randbytes(3 * 48) for _ in range(48)))) +
                chunk(b"IEND", b""))
    path = farm.scene("textures.gltf")
    with open(path) as source:
        gltf = json.load(source)
    gltf["images"], gltf["textures"] = [], []
    for i in range(count):
        with open(farm.path("t%d.png" % i), "wb") as out:
            out.write(png())
        gltf["images"].append({"uri": "t%d.png" % i})
        gltf["textures"].append({"source": i})
        gltf["materials"].append({"name": "m%d" % i, "pbrMetallicRoughness": {"baseColorTexture": {"index": i}}})
        gltf["meshes"][0]["primitives"].append(dict(gltf["meshes"][0]["primitives"][0],
                                                    material=len(gltf["materials"]) - 1))
    gltf["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"})
    for primitive in gltf["meshes"][0]["primitives"]:
        primitive["attributes"]["TEXCOORD_0"] = len(gltf["accessors"]) - 1
    with open(path, "w") as out:
        json.dump(gltf, out)
    return path
