"""A glTF file with something on the way, for tests and measurements of animations:
moving.py SCENE.gltf OUT.gltf NAME=X,Y,Z ...  moves each node (or `camera`) by so many metres within the first second. A NAME that begins
with / is a pointer of KHR_animation_pointer, with the numbers of its first key and its second. Files that the scene names must lie
beside OUT."""
import base64
import json
import struct
import sys


def write(scene_path, out_path, moves):
    """`moves`: {node name, or "camera": (x, y, z)}, {pointer: numbers of both keys}."""
    with open(scene_path) as file:
        scene = json.load(file)
    data, samplers, channels = struct.pack("<2f", 0, 1), [], []
    buffer, views, accessors = len(scene.setdefault("buffers", [])), scene.setdefault("bufferViews", []), scene.setdefault("accessors", [])

    def accessor(kind, offset, floats, **more):
        views.append({"buffer": buffer, "byteOffset": offset, "byteLength": 4 * floats})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": 2, "type": kind, **more})
        return len(accessors) - 1

    times = accessor("SCALAR", 0, 2, min=[0], max=[1])
    def channel(output, target):
        samplers.append({"input": times, "output": output})
        channels.append({"sampler": len(samplers) - 1, "target": target})

    for name, way in moves.items():
        if name.startswith("/"):
            kind = ("SCALAR", "VEC2", "VEC3", "VEC4")[len(way) // 2 - 1]
            channel(accessor(kind, len(data), len(way)), {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": name}}})
            data += struct.pack("<%df" % len(way), *way)
            continue
        node = next(i for i, n in enumerate(scene["nodes"]) if ("camera" in n if name == "camera" else n.get("name") == name))
        at = scene["nodes"][node].get("translation", [0, 0, 0])
        channel(accessor("VEC3", len(data), 6), {"node": node, "path": "translation"})
        data += struct.pack("<6f", *at, *(a + b for a, b in zip(at, way)))
    scene["buffers"].append({"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()})
    scene["animations"] = [{"samplers": samplers, "channels": channels}]
    with open(out_path, "w") as out:
        json.dump(scene, out)


if __name__ == "__main__":
    write(sys.argv[1], sys.argv[2], {name: [float(x) for x in way.split(",")] for name, way in (a.split("=") for a in sys.argv[3:])})
