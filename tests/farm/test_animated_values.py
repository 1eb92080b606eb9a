"""KHR_animation_pointer: a frame of an animated file is the picture of the file that has the frame's values."""
import json
import os
import shutil

import exr
import moving
from farm import Farm, Tests
from jobs import expect

tests = Tests()
FEATURES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "scenes", "features")
SIZE = ("--size", "64x48", "--spp", "8", "--fps", "24")
BALL = "/materials/3/"
STRENGTH = "/extensions/KHR_materials_emissive_strength/emissiveStrength"
# Of both keys, at 0 and 1 s.
VALUES = {
    BALL + "emissiveFactor": (0, 0, 0, 1, .5, .25),
    "/materials/1" + STRENGTH: (8, 0),
    "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/offset": (0, 0, 1, .5),
    "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/rotation": (0, 1),
    "/cameras/0/perspective/yfov": (.75, .25),
}


def put_features(farm):
    for name in ("features.bin", "checker.png", "checks.png", "bumps.png", "holes.png"):
        shutil.copy(os.path.join(FEATURES, name), farm.path(name))


def set_value(scene, pointer, numbers):
    *way, key = pointer.strip("/").split("/")
    at = scene
    for step in way:
        at = at[int(step)] if isinstance(at, list) else at.setdefault(step, {})
    at[key] = list(numbers) if len(numbers) > 1 else numbers[0]


def write_still(source, out, share):
    """With what `share` of the way between the keys gives."""
    with open(source) as file:
        scene = json.load(file)
    for pointer, keys in VALUES.items():
        half = len(keys) // 2
        set_value(scene, pointer, [a + share * (b - a) for a, b in zip(keys[:half], keys[half:])])
    with open(out, "w") as file:
        json.dump(scene, file)


@tests.add
def animated_values_reach_the_picture():
    """emission, a lamp that goes out, a texture that turns and slides, a lens that zooms: on two workers, and over a restart"""
    with Farm() as farm:
        source = os.path.join(FEATURES, "emissive-strength.gltf")
        put_features(farm)
        moving.write(source, farm.path("animated.gltf"), VALUES)
        facts = farm.cli("import", farm.path("animated.gltf"), "--json", connect=False, expect=0).json()
        expect(facts["tracks"] == 6 and facts["duration_s"] == 1 and not facts["warnings"], facts)  # a rotation's scale, too
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.path("animated.gltf"), *SIZE, "--frames", "0-24x6")
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.start_worker(cache=farm.path("cache-1"))
        farm.wait_for_job(number)
        pictures = sorted(f for f in farm.fetch(number) if f.endswith(".exr"))
        expect(len(pictures) == 5, pictures)
        seen = set()
        for frame, picture in zip(range(0, 25, 6), pictures):
            write_still(source, farm.path("still.gltf"), frame / 24)
            farm.cli("render", farm.path("still.gltf"), *SIZE, "--frames", str(frame), "-o", "still-%d.exr" % frame, expect=0,
                     connect=False)
            got = exr.read_exr(picture)
            still = exr.read_exr(farm.path("still-%d.exr" % frame))
            expect(got.bits() == still.bits(), "frame %d" % frame)
            expect(got.attributes["worldToNDC"] == still.attributes["worldToNDC"], "frame %d: where the camera looks" % frame)
            seen.add(got.bits())
        expect(len(seen) == 5, "frames are alike")


@tests.add
def what_is_hidden_is_not_there():
    """a ball, and a lamp, that a key of KHR_node_visibility shows from one frame on"""
    with Farm() as farm:
        put_features(farm)
        with open(os.path.join(FEATURES, "unlit.gltf")) as file:
            scene = json.load(file)
        meshes = {scene["materials"][scene["meshes"][n["mesh"]]["primitives"][0]["material"]]["name"]: i
                  for i, n in enumerate(scene["nodes"]) if "mesh" in n}
        hidden = [meshes["unlit 1"], meshes["lamp"]]
        moving.write(os.path.join(FEATURES, "unlit.gltf"), farm.path("animated.gltf"),
                     {"/nodes/%d/extensions/KHR_node_visibility/visible" % n: (0, 1) for n in hidden})
        pictures = {}
        with open(farm.path("whole.gltf"), "w") as file:
            json.dump(scene, file)
        for n in hidden:
            del scene["nodes"][n]["mesh"]
        with open(farm.path("without.gltf"), "w") as file:
            json.dump(scene, file)
        for name, frame in (("animated", 23), ("animated", 24), ("without", 23), ("whole", 24)):
            out = "%s-%d.exr" % (name, frame)
            farm.cli("render", farm.path(name + ".gltf"), *SIZE, "--frames", str(frame), "--aov", "depth", "-o", out, expect=0,
                     connect=False)
            pictures[name, frame] = exr.read_exr(farm.path(out))
        expect(pictures["animated", 24].bits() == pictures["whole", 24].bits(), "shown")
        depths = zip(pictures["animated", 23].values("Z"), pictures["without", 23].values("Z"))
        expect(all(a == b or abs(a / b - 1) < 1e-5 for a, b in depths), "hidden")  # another origin of coordinates rounds otherwise
        expect(pictures["animated", 23].channels["Z"] != pictures["whole", 24].channels["Z"], "the ball is seen")
        light = {k: sum(p.values("R")) for k, p in pictures.items()}
        expect(abs(light["animated", 23] / light["without", 23] - 1) < .02, light)


tests.run()
