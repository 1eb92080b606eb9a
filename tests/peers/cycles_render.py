"""Render a glTF file under an environment map with Cycles, set up as an unbiased reference.

Run inside Blender (Debian 12: 3.4.1, with python3-numpy):
    blender -b --factory-startup -P tests/peers/cycles_render.py -- \
        SCENE OUT.exr WIDTH HEIGHT SPP DEPTH [ENVIRONMENT|-] [CONSTANT]
Prints "cycles: render S seconds, C CPU-seconds".
"""
import os
import resource
import sys
import time

import numpy

if not hasattr(numpy, "bool"):
    numpy.bool = bool  # removed in numpy 1.24; Blender 3.4's glTF importer still asks for it

import bpy

argv = sys.argv[sys.argv.index("--") + 1:]
scene_path, out_path = argv[0], argv[1]
width, height, spp, depth = (int(x) for x in argv[2:6])
environment = argv[6] if len(argv) > 6 else "-"
constant = float(argv[7]) if len(argv) > 7 else 0.0

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=scene_path)
scene = bpy.context.scene

# What the importer cannot say: a dielectric without reflection (specularFactor 0) is Lambert.
import json
import struct


def gltf_json(path):
    data = open(path, "rb").read()
    if data[:4] == b"glTF":
        length = struct.unpack("<I", data[12:16])[0]
        return json.loads(data[20:20 + length])
    return json.loads(data)


for m in gltf_json(scene_path).get("materials", []):
    ext = m.get("extensions", {})
    pbr = m.get("pbrMetallicRoughness", {})
    lambert = ext.get("KHR_materials_specular", {}).get("specularFactor", 1) == 0 \
        and pbr.get("metallicFactor", 1) == 0
    material = bpy.data.materials.get(m.get("name", ""))
    if not lambert or material is None:
        continue
    tree = material.node_tree
    principled = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if principled is None:
        continue
    emission = list(principled.inputs["Emission"].default_value)[:3]
    strength = principled.inputs["Emission Strength"].default_value
    if max(emission) * strength > 0:
        continue
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    base = principled.inputs["Base Color"]
    if base.is_linked:
        tree.links.new(base.links[0].from_socket, diffuse.inputs["Color"])
    else:
        diffuse.inputs["Color"].default_value = base.default_value
    for link in list(principled.outputs["BSDF"].links):
        tree.links.new(diffuse.outputs["BSDF"], link.to_socket)

if scene.camera is None:
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if not cameras:
        sys.exit("cycles: the file has no camera; give it one to compare")
    scene.camera = cameras[0]
scene.camera.data.sensor_fit = "VERTICAL" if scene.camera.data.type == "PERSP" else "AUTO"
if scene.camera.data.type == "PERSP":
    camera = gltf_json(scene_path)["cameras"][0]
    scene.camera.data.lens_unit = "FOV"
    scene.camera.data.angle = camera["perspective"]["yfov"]
scene.camera.data.dof.use_dof = False

world = bpy.data.worlds.new("world")
scene.world = world
world.use_nodes = True
background = world.node_tree.nodes["Background"]
background.inputs["Color"].default_value = (constant, constant, constant, 1)
if environment != "-":
    texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(os.path.abspath(environment))
    texture.image.colorspace_settings.name = "Linear"
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])

scene.render.engine = "CYCLES"
cycles = scene.cycles
cycles.device = "CPU"
cycles.samples = spp
cycles.use_adaptive_sampling = False
cycles.use_denoising = False
cycles.seed = int(os.environ.get("CYCLES_SEED", "0"))
cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
cycles.blur_glossy = 0
cycles.light_sampling_threshold = 0
cycles.caustics_reflective = cycles.caustics_refractive = True
cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = depth
cycles.transmission_bounces = cycles.transparent_max_bounces = depth
cycles.pixel_filter_type = "BLACKMAN_HARRIS"
cycles.filter_width = 1.5
scene.render.threads_mode = "FIXED"
scene.render.threads = int(os.environ.get("CYCLES_THREADS", str(os.cpu_count())))
scene.render.resolution_x, scene.render.resolution_y = width, height
scene.render.resolution_percentage = 100
scene.render.film_transparent = False
scene.view_settings.view_transform = "Raw"
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.image_settings.exr_codec = "ZIP"
scene.render.filepath = os.path.abspath(out_path)

before = resource.getrusage(resource.RUSAGE_SELF)
start = time.monotonic()
bpy.ops.render.render(write_still=True)
after = resource.getrusage(resource.RUSAGE_SELF)
cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
print("cycles: render %.2f seconds, %.2f CPU-seconds" % (time.monotonic() - start, cpu))
