#!/usr/bin/env python3
"""Files of `--exr-names blender` in a real Blender's compositor. Skipped by name where no Blender is installed."""
import json
import os
import shutil
import struct
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(os.path.dirname(HERE), "farm"))
from exr import read_exr  # noqa: E402
from farm import PATIENCE, Failure, Farm, Skip, Tests  # noqa: E402
from jobs import expect  # noqa: E402

tests = Tests()
INSIDE = """
import bpy, json, sys
path, out = sys.argv[-2:]
image = bpy.data.images.load(path)
scene = bpy.context.scene
scene.use_nodes = True
node = scene.node_tree.nodes.new("CompositorNodeImage")
node.image = image
json.dump({"type": image.type, "layer": node.layer, "sockets": {s.name: s.type for s in node.outputs if s.enabled}}, open(out, "w"))
"""


def run_blender(farm, script, *words):
    """Run a script in a Blender without its window."""
    blender = shutil.which(os.environ.get("BLENDER", "blender"))
    if not blender:
        raise Skip("no Blender here: apt-get install blender python3-numpy")
    with open(farm.path("inside.py"), "w") as out:
        out.write(script)
    run = subprocess.run([blender, "-b", "--factory-startup", "--python-exit-code", "3", "-P", farm.path("inside.py"), "--", *words],
                         capture_output=True, text=True, env=dict(os.environ, PATH="/usr/local/bin:/usr/bin:/bin"), timeout=120 * PATIENCE)
    if run.returncode:
        raise Failure(run.stdout + run.stderr)


@tests.add
def compositor_has_the_passes():
    """the compositor's image node offers a view layer with the passes of the file"""
    with Farm() as farm:
        farm.cli("render", farm.scene(), "--size", "32x32", "--spp", "2", "-q", "--alpha", "--aov",
                 "depth,normal,position,object-id,samples,denoising-albedo", "--exr-names", "blender", "-o", farm.path("picture"),
                 expect=0, connect=False)
        run_blender(farm, INSIDE, farm.path("picture.exr"), farm.path("found.json"))
        with open(farm.path("found.json")) as source:
            found = json.load(source)
        expect(found["type"] == "MULTILAYER" and found["layer"] == "ViewLayer", found)
        for name, kind in (("Combined", "RGBA"), ("Depth", "VALUE"), ("Normal", "RGBA"), ("Position", "RGBA"), ("IndexOB", "VALUE"),
                           ("Denoising Albedo", "RGBA"), ("samples", "VALUE")):
            expect(found["sockets"].get(name) == kind, found)


MATTE = """
import bpy, sys
path, layer, name, out = sys.argv[-4:]
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 48, 32, 100
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
scene.render.filepath = out
scene.use_nodes = True
scene.node_tree.nodes.clear()
node = scene.node_tree.nodes.new("CompositorNodeCryptomatteV2")
node.source, node.image = "IMAGE", bpy.data.images.load(path)
node.layer_name, node.matte_id = layer, name
target = scene.node_tree.nodes.new("CompositorNodeComposite")
scene.node_tree.links.new(node.outputs["Matte"], target.inputs["Image"])
bpy.ops.render.render(write_still=True)
"""


@tests.add
def compositor_picks_mattes():
    """the compositor's Cryptomatte node finds layers and names in files of either naming, and makes the matte from them"""
    with Farm() as farm:
        for view, names in (("", "plain"), ("ViewLayer.", "blender")):
            path = farm.path(names + ".exr")
            farm.cli("render", os.path.join(os.path.dirname(HERE), "..", "scenes", "features", "alpha.gltf"), "--size", "48x32", "--spp",
                     "16", "-q", "--aov", "cryptomatte", "--exr-names", names, "-o", farm.path(names), expect=0, connect=False)
            run_blender(farm, MATTE, path, view + "CryptoObject", "mask", farm.path("matte.exr"))
            matte, picture = read_exr(farm.path("matte.exr")).values("R"), read_exr(path)
            manifest = json.loads(next(v for k, v in picture.attributes.items() if k.endswith("/manifest") and b"mask" in v and b"ground" in v))
            wanted = [0.0] * len(matte)
            for rank in range(6):
                layer = "%sCryptoObject%02d." % (view, rank // 2)
                ids = struct.unpack("<%dI" % len(matte), picture.channels[layer + "RB"[rank % 2]])
                for at, share in enumerate(picture.values(layer + "GA"[rank % 2])):
                    wanted[at] += share if ids[at] == int(manifest["mask"], 16) else 0
            expect(sum(wanted) > 20 and list(matte) == wanted, names)


if __name__ == "__main__":
    tests.run()
