"""Render a glTF file under an environment map with Cycles, set up as an unbiased reference.

Run inside Blender (Debian 12: 3.4.1, with python3-numpy):
    blender -b --factory-startup -P tests/peers/cycles_render.py -- \
        SCENE OUT.exr WIDTH HEIGHT SPP DEPTH [ENVIRONMENT|-] [CONSTANT]
Prints "cycles: render S seconds, C CPU-seconds". From the environment: CYCLES_SEED,
CYCLES_THREADS, and LAMP_CUTS (see cut_lamps).
"""
import json
import os
import resource
import struct
import sys
import time

import numpy

numpy.bool = bool  # removed in numpy 1.24; Blender 3.4's glTF importer still asks for it

import bmesh
import bpy


def gltf_json(path):
    with open(path, "rb") as source:
        data = source.read()
    if data[:4] == b"glTF":
        length, = struct.unpack("<I", data[12:16])
        return json.loads(data[20:20 + length])
    return json.loads(data)


def is_lambert(material):
    """A dielectric without reflection; the importer makes it reflect by half."""
    specular = material.get("extensions", {}).get("KHR_materials_specular", {})
    return specular.get("specularFactor", 1) == 0 and \
        material.get("pbrMetallicRoughness", {}).get("metallicFactor", 1) == 0


def copy_input(tree, source, target):
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
    else:
        target.default_value = source.default_value


def make_lambert(material):
    """Put a Lambert reflector, its own light and its alpha in the place of Principled's."""
    tree = material.node_tree
    principled = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if principled is None:
        return
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    emission = tree.nodes.new("ShaderNodeEmission")
    both = tree.nodes.new("ShaderNodeAddShader")
    copy_input(tree, principled.inputs["Base Color"], diffuse.inputs["Color"])
    if principled.inputs["Normal"].is_linked:
        copy_input(tree, principled.inputs["Normal"], diffuse.inputs["Normal"])
    copy_input(tree, principled.inputs["Emission"], emission.inputs["Color"])
    copy_input(tree, principled.inputs["Emission Strength"], emission.inputs["Strength"])
    tree.links.new(diffuse.outputs["BSDF"], both.inputs[0])
    tree.links.new(emission.outputs["Emission"], both.inputs[1])
    lit = emission.inputs["Color"].is_linked or (
        max(list(emission.inputs["Color"].default_value)[:3]) > 0 and
        emission.inputs["Strength"].default_value > 0)
    surface = both.outputs["Shader"] if lit else diffuse.outputs["BSDF"]
    alpha = principled.inputs["Alpha"]
    if alpha.is_linked or alpha.default_value < 1:
        mix = tree.nodes.new("ShaderNodeMixShader")
        copy_input(tree, alpha, mix.inputs["Fac"])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        tree.links.new(surface, mix.inputs[2])
        surface = mix.outputs["Shader"]
    for link in list(principled.outputs["BSDF"].links):
        tree.links.new(surface, link.to_socket)


def cut_lamps(gltf, cuts):
    """Cut every edge of a lamp so many times.

    Cycles samples a triangle that looks large from a point by its solid angle, found in float with
    quick arc cosines; seen at a grazing angle that is a small difference of large numbers, and too
    dark by several percent. Small triangles it samples by area.
    """
    lamps = {m.get("name") for m in gltf.get("materials", [])
             if max(m.get("emissiveFactor", [0])) > 0}
    cut = set()
    for thing in bpy.context.scene.objects:
        slots = [i for i, m in enumerate(thing.data.materials) if m and m.name in lamps] \
            if thing.type == "MESH" else []
        if not slots or thing.data.name in cut:
            continue
        cut.add(thing.data.name)
        mesh = bmesh.new()
        mesh.from_mesh(thing.data)
        edges = {e for face in mesh.faces if face.material_index in slots for e in face.edges}
        bmesh.ops.subdivide_edges(mesh, edges=list(edges), cuts=cuts, use_grid_fill=True)
        mesh.to_mesh(thing.data)
        mesh.free()
        print("cycles: lamp %s has %d faces" % (thing.name, len(thing.data.polygons)))


def set_camera(scene, gltf):
    if scene.camera is None:
        cameras = [o for o in scene.objects if o.type == "CAMERA"]
        if not cameras:
            sys.exit("cycles: the file has no camera; give it one to compare")
        scene.camera = cameras[0]
    camera = scene.camera.data
    camera.dof.use_dof = False
    if camera.type == "PERSP":
        camera.sensor_fit = "VERTICAL"
        camera.lens_unit = "FOV"
        camera.angle = gltf["cameras"][0]["perspective"]["yfov"]


def set_world(scene, environment, constant):
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    tree = scene.world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Color"].default_value = (constant, constant, constant, 1)
    if environment != "-":
        texture = tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = bpy.data.images.load(os.path.abspath(environment))
        texture.image.colorspace_settings.name = "Linear"
        tree.links.new(texture.outputs["Color"], background.inputs["Color"])


def set_render(scene, out_path, width, height, spp, depth):
    cycles = scene.cycles
    scene.render.engine = "CYCLES"
    cycles.device = "CPU"
    cycles.samples = spp
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.seed = int(os.environ.get("CYCLES_SEED", "0"))
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = 0
    cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    # Azulejo counts a path's edges after the camera's ray, the last of which may be a shadow
    # ray; Cycles does not count the shadow ray.
    cycles.max_bounces = max(depth - 1, 0)
    for kind in ("diffuse", "glossy", "transmission", "transparent_max"):
        setattr(cycles, kind + "_bounces", cycles.max_bounces)
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


def main():
    argv = sys.argv[sys.argv.index("--") + 1:]
    scene_path, out_path = argv[0], argv[1]
    width, height, spp, depth = (int(x) for x in argv[2:6])
    gltf = gltf_json(scene_path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    # COMPAT: a watt a steradian for a candela, as Azulejo has it; the default divides by 683.
    bpy.ops.import_scene.gltf(filepath=scene_path, convert_lighting_mode="COMPAT")
    scene = bpy.context.scene
    for material in gltf.get("materials", []):
        if is_lambert(material) and material.get("name", "") in bpy.data.materials:
            make_lambert(bpy.data.materials[material["name"]])
    cuts = int(os.environ.get("LAMP_CUTS", "0"))
    if cuts > 0:
        cut_lamps(gltf, cuts)
    set_camera(scene, gltf)
    set_world(scene, argv[6] if len(argv) > 6 else "-", float(argv[7]) if len(argv) > 7 else 0.0)
    set_render(scene, out_path, width, height, spp, depth)
    before = resource.getrusage(resource.RUSAGE_SELF)
    start = time.monotonic()
    bpy.ops.render.render(write_still=True)
    after = resource.getrusage(resource.RUSAGE_SELF)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print("cycles: render %.2f seconds, %.2f CPU-seconds" % (time.monotonic() - start, cpu))


if __name__ == "__main__":
    main()
