#!/usr/bin/env python3
"""Files of `--exr-names blender` in a real Blender's compositor. Skipped by name where no Blender is installed."""
import json
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(os.path.dirname(HERE), "farm"))
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


@tests.add
def compositor_has_the_passes():
    """the compositor's image node offers a view layer with the passes of the file"""
    blender = shutil.which(os.environ.get("BLENDER", "blender"))
    if not blender:
        raise Skip("no Blender here: apt-get install blender python3-numpy")
    with Farm() as farm:
        farm.cli("render", farm.scene(), "--size", "32x32", "--spp", "2", "-q", "--alpha", "--aov",
                 "depth,normal,position,object-id,samples,denoising-albedo", "--exr-names", "blender", "-o", farm.path("picture"),
                 expect=0, connect=False)
        with open(farm.path("inside.py"), "w") as script:
            script.write(INSIDE)
        run = subprocess.run([blender, "-b", "--factory-startup", "--python-exit-code", "3", "-P", farm.path("inside.py"), "--",
                              farm.path("picture.exr"), farm.path("found.json")], capture_output=True, text=True,
                             env=dict(os.environ, PATH="/usr/local/bin:/usr/bin:/bin"), timeout=120 * PATIENCE)
        if run.returncode:
            raise Failure(run.stdout + run.stderr)
        with open(farm.path("found.json")) as source:
            found = json.load(source)
        expect(found["type"] == "MULTILAYER" and found["layer"] == "ViewLayer", found)
        for name, kind in (("Combined", "RGBA"), ("Depth", "VALUE"), ("Normal", "RGBA"), ("Position", "RGBA"), ("IndexOB", "VALUE"),
                           ("Denoising Albedo", "RGBA"), ("samples", "VALUE")):
            expect(found["sockets"].get(name) == kind, found)


if __name__ == "__main__":
    tests.run()
