"""Blender's default scene (cube, point light of 1000 W, camera) as Cycles renders it, and as its
glTF exporter writes it, for docs/BLENDER.md.

  blender -b --factory-startup --python tests/peers/blender_default.py -- OUT [lambert]

writes OUT.exr and OUT.glb. The world's grey background is switched off, because glTF has none. The
light is a point, because glTF's have no radius. With "lambert" the cube is a Lambert reflector in
both, so that the lights alone are compared."""
import json
import struct
import sys

import bpy



def without_specular(path):
    """The same GLB file with materials that are nothing but Lambert reflectors."""
    with open(path, "rb") as source:
        data = source.read()
    size = struct.unpack("<I", data[12:16])[0]
    scene_json, rest = json.loads(data[20:20 + size]), data[20 + size:]
    for material in scene_json["materials"]:
        material["extensions"] = {"KHR_materials_specular": {"specularFactor": 0}}
    text = json.dumps(scene_json).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as out:
        out.write(data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + b"JSON" +
                  text + rest)


arguments = sys.argv[sys.argv.index("--") + 1:]
bpy.ops.wm.read_factory_settings()
scene = bpy.context.scene
scene.objects["Light"].data.shadow_soft_size = 0
scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
scene.render.engine = "CYCLES"
scene.cycles.samples = 256
scene.cycles.use_adaptive_sampling = False
scene.cycles.use_denoising = False
scene.render.resolution_x, scene.render.resolution_y = 480, 270
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = arguments[0] + ".exr"
bpy.ops.export_scene.gltf(filepath=arguments[0] + ".glb", export_lights=True, export_cameras=True)
if arguments[1:] == ["lambert"]:
    tree = scene.objects["Cube"].data.materials[0].node_tree
    matte = tree.nodes.new("ShaderNodeBsdfDiffuse")
    matte.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    tree.links.new(matte.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    without_specular(arguments[0] + ".glb")
bpy.ops.render.render(write_still=True)
