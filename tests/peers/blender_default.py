"""Blender's default scene (cube, point light of 1000 W, camera) as Cycles renders it, and as its
glTF exporter writes it, for docs/BLENDER.md.

  blender -b --factory-startup --python tests/peers/blender_default.py -- OUT [SPECULAR]

writes OUT.exr and OUT.glb. The world's grey background is switched off, because glTF has none. The
light is a point, because glTF's have no radius. SPECULAR is the material's value (default: 0.5)."""
import sys

import bpy

arguments = sys.argv[sys.argv.index("--") + 1:]
bpy.ops.wm.read_factory_settings()
scene = bpy.context.scene
scene.objects["Light"].data.shadow_soft_size = 0
scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
if len(arguments) > 1:
    material = scene.objects["Cube"].data.materials[0]
    material.node_tree.nodes["Principled BSDF"].inputs["Specular"].default_value = float(arguments[1])
scene.render.engine = "CYCLES"
scene.cycles.samples = 256
scene.cycles.use_adaptive_sampling = False
scene.cycles.use_denoising = False
scene.render.resolution_x, scene.render.resolution_y = 480, 270
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = arguments[0] + ".exr"
bpy.ops.export_scene.gltf(filepath=arguments[0] + ".glb", export_lights=True, export_cameras=True)
bpy.ops.render.render(write_still=True)
