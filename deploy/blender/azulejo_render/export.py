"""Runs in a Blender of its own, without a window: reads a copy of the scene, and exports frames of it on request.

    blender -b --factory-startup --python export.py -- SCENE.blend NAME CAMERA

Each line of standard input is a request in JSON, {"frame", "folder", "size", "shutter", "position", "layer"}; the answer is a
file in that folder, answer.json: {"scene": what scene_fix.fix takes, "env": {...}, "notes": [what is not exported]} or {"error"}.
The copy may be changed at will, and a Blender that ends takes this one with it: standard input then ends."""
import json
import math
import os
import shutil
import struct
import sys
import traceback

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import scene_fix  # noqa: E402  (by its folder: the package may have any name)

# Nodes from which the glTF exporter makes what they are.
READ_NODES = {"BSDF_PRINCIPLED", "OUTPUT_MATERIAL", "TEX_IMAGE", "NORMAL_MAP", "MAPPING", "UVMAP", "TEX_COORD", "SEPRGB",
              "SEPARATE_COLOR", "RGB", "VALUE", "REROUTE", "FRAME", "GROUP_INPUT", "GROUP_OUTPUT", "EMISSION", "BSDF_TRANSPARENT",
              "ATTRIBUTE", "VERTEX_COLOR"}
# Inputs of the Principled BSDF that no glTF file holds, by their names before and since Blender 4: what they are without effect,
# and what a note calls them.
LOST_INPUTS = ((("Subsurface", "Subsurface Weight"), 0.0, "subsurface scattering"), (("Anisotropic", ), 0.0, "anisotropy"),
               (("Sheen", ), 0.0, "sheen"), (("Transmission Roughness", ), 0.0, "roughness of transmission alone"),
               (("Thin Film Thickness", ), 0.0, "thin film"), (("Coat Tint", ), (1.0, 1.0, 1.0, 1.0), "tint of the coat"))
NEVER_SHAPES = {"VOLUME": "volume", "GPENCIL": "grease pencil", "GREASEPENCIL": "grease pencil", "POINTCLOUD": "point cloud",
                "CURVES": "hair curves", "META": "metaball"}
WORLD_BAKE_WIDTH = 2048


class Refused(Exception):
    """Nothing can be rendered; the text says why and what to do."""


class Notes(list):
    def say(self, text):
        if text not in self:
            self.append(text)


# ---- the scene -----------------------------------------------------------------------------------------------------------

def open_scene(path, name, camera):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(path, link=False) as (there, here):
        here.scenes = [name]
    scene = here.scenes[0]
    bpy.context.window.scene = scene
    if camera:
        scene.camera = bpy.data.objects[camera]
    return scene


def renderable(layer_collection, out):
    collection = layer_collection.collection
    if layer_collection.exclude or collection.hide_render:
        return
    layer_collection.hide_viewport = collection.hide_viewport = False
    if not layer_collection.holdout and not layer_collection.indirect_only:
        out.update(o for o in collection.objects if not o.hide_render)
    for child in layer_collection.children:
        renderable(child, out)


def show_what_renders(scene, layer_name, notes):
    """The exporter looks at what the viewport shows; make that what a render shows."""
    layer = scene.view_layers.get(layer_name) or scene.view_layers[0]
    bpy.context.window.view_layer = layer
    seen = set()
    renderable(layer.layer_collection, seen)
    for thing in layer.objects:
        thing.hide_render = thing not in seen
        thing.hide_viewport = False
        thing.hide_set(False)
        for modifier in thing.modifiers:
            if hasattr(modifier, "render_levels"):
                modifier.levels = modifier.render_levels
            modifier.show_viewport = modifier.show_render
        if thing in seen:
            look_at_object(thing, notes)
    return seen


def look_at_object(thing, notes):
    if thing.type in NEVER_SHAPES:
        notes.say("object %s: a %s is not exported; convert it to a mesh" % (thing.name, NEVER_SHAPES[thing.type]))
    for system in thing.particle_systems:
        if system.settings.render_type not in ("NONE", ) or system.settings.type == "HAIR":
            notes.say("object %s: the particles %s are not exported; make their instances real or convert them to a mesh" % (
                thing.name, system.name))
    if thing.type == "MESH" and not getattr(thing, "visible_camera", True):
        notes.say("object %s: is hidden from the camera in Cycles; that is not exported" % thing.name)
    if thing.type == "MESH" and (getattr(thing, "is_holdout", False) or getattr(thing, "is_shadow_catcher", False)):
        notes.say("object %s: holdouts and shadow catchers are not exported" % thing.name)


# ---- materials -----------------------------------------------------------------------------------------------------------

def reached(tree, out, seen=None):
    """The nodes from which the active output's surface gets something, in groups as well."""
    seen = set() if seen is None else seen
    starts = [n for n in tree.nodes if n.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD") and n.is_active_output] or \
             [n for n in tree.nodes if n.type == "GROUP_OUTPUT"]
    while starts:
        node = starts.pop()
        if node in seen or node.mute:
            continue
        seen.add(node)
        out.append(node)
        if node.type == "GROUP" and node.node_tree:
            reached(node.node_tree, out, seen)
        for socket in node.inputs:
            if not (node.type.startswith("OUTPUT_") and socket.name in ("Volume", "Displacement")):
                starts += [link.from_node for link in socket.links]
    return out


def find(node, *names):
    """The input that has one of these names: they differ between Blender 3.4 and 4.x."""
    return next((node.inputs[name] for name in names if name in node.inputs), None)


def put(node, value, *names):
    socket = find(node, *names)
    if socket:
        socket.default_value = value


def value_of(socket):
    value = socket.default_value
    return tuple(value) if hasattr(value, "__len__") else value


def as_principled(tree, node):
    """A Principled BSDF in place of a plain shader; None if it has no counterpart."""
    if node.type == "BSDF_PRINCIPLED":
        return node
    if node.type not in ("BSDF_DIFFUSE", "BSDF_GLOSSY", "BSDF_ANISOTROPIC", "BSDF_GLASS", "EMISSION"):
        return None
    new = tree.nodes.new("ShaderNodeBsdfPrincipled")
    color = node.inputs["Color"]
    target = "Base Color"
    if node.type == "BSDF_DIFFUSE":
        put(new, 1.0, "Roughness")
        put(new, 0.0, "Specular", "Specular IOR Level")
    elif node.type == "EMISSION":
        put(new, (0, 0, 0, 1), "Base Color")
        put(new, 0.0, "Specular", "Specular IOR Level")
        put(new, value_of(node.inputs["Strength"]), "Emission Strength")
        target = "Emission" if "Emission" in new.inputs else "Emission Color"
    else:
        put(new, value_of(node.inputs["Roughness"]), "Roughness")
        if node.type == "BSDF_GLASS":
            put(new, 1.0, "Transmission", "Transmission Weight")
            put(new, value_of(node.inputs["IOR"]), "IOR")
        else:
            put(new, 1.0, "Metallic")
    put(new, value_of(color), target)
    if color.is_linked:
        tree.links.new(color.links[0].from_socket, new.inputs[target])
    if "Normal" in node.inputs and node.inputs["Normal"].is_linked:
        tree.links.new(node.inputs["Normal"].links[0].from_socket, new.inputs["Normal"])
    return new


def is_clear(node):
    """Whether it is a white Transparent BSDF."""
    if node is None or node.type != "BSDF_TRANSPARENT" or node.inputs["Color"].is_linked:
        return False
    return min(node.inputs["Color"].default_value[:3]) == 1


def without_mix(tree, mix):
    """A Principled BSDF with alpha in place of a mix of a shader with a Transparent BSDF; None if the mix is another one."""
    factor, shaders = mix.inputs[0], [s.links[0].from_node if s.is_linked else None for s in mix.inputs[1:3]]
    clear = [is_clear(s) for s in shaders]
    if None in shaders or clear.count(True) != 1 or (clear[1] and factor.is_linked):  # 1 less an image is none
        return None
    new = as_principled(tree, shaders[clear.index(False)])
    if new is None or new.inputs["Alpha"].is_linked or new.inputs["Alpha"].default_value != 1:
        return None
    if factor.is_linked:
        tree.links.new(factor.links[0].from_socket, new.inputs["Alpha"])
    else:
        new.inputs["Alpha"].default_value = 1 - factor.default_value if clear[1] else factor.default_value
    return new


def absorption(output):
    """(density, color) of a Volume Absorption that is the same everywhere; None: the material has another volume."""
    node = output.inputs["Volume"].links[0].from_node
    if node.type != "VOLUME_ABSORPTION" or any(s.is_linked for s in node.inputs):
        return None
    return node.inputs["Density"].default_value, [min(max(c, 0.0), 1.0) for c in node.inputs["Color"].default_value[:3]]


def look_at_principled(material, node, notes):
    for names, neutral, what in LOST_INPUTS:
        socket = find(node, *names)
        if socket and (socket.is_linked or value_of(socket) != neutral):
            notes.say("material %s: its %s is not exported" % (material.name, what))
    if node.inputs["Alpha"].is_linked or node.inputs["Alpha"].default_value < 1:
        material.blend_method = "BLEND"  # which the exporter asks, and Cycles does not


def look_at_material(material, found, notes):
    """Makes of the material what the exporter reads, and names the rest. found: what scene_fix.fix takes."""
    material.use_backface_culling = False  # likewise
    if not material.use_nodes or not material.node_tree:
        return
    tree = material.node_tree
    outputs = [n for n in tree.nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output]
    if not outputs or not outputs[0].inputs["Surface"].is_linked:
        return
    first = outputs[0].inputs["Surface"].links[0].from_node
    new = without_mix(tree, first) if first.type == "MIX_SHADER" else as_principled(tree, first)
    if new:
        tree.links.new(new.outputs[0], outputs[0].inputs["Surface"])
    for socket in ("Volume", "Displacement"):
        if outputs[0].inputs[socket].is_linked:
            inside = absorption(outputs[0]) if socket == "Volume" else None
            if inside:
                found["absorption"][material.name] = inside
            else:
                notes.say("material %s: its %s is not exported" % (material.name, socket.lower()))
    for node in reached(tree, []):
        label = node.bl_label
        if node.type == "BSDF_PRINCIPLED":
            look_at_principled(material, node, notes)
        if node.type.startswith("TEX_") and node.type not in READ_NODES:
            notes.say("material %s: %s is not exported; bake it" % (material.name, label))
        elif node.type == "TEX_IMAGE" and node.image and node.image.is_dirty and not node.image.packed_file:
            notes.say("material %s: the image %s has changes that are not saved" % (material.name, node.image.name))
        elif node.type == "TEX_COORD":
            for out in node.outputs:
                if out.is_linked and out.name != "UV":
                    notes.say("material %s: %s coordinates are not exported; use UV coordinates" % (material.name, out.name))
        elif node.type == "GROUP":
            notes.say("material %s: the node group %s is exported only as far as glTF's exporter reads groups" % (
                material.name, node.node_tree.name if node.node_tree else label))
        elif node.type not in READ_NODES and not node.type.startswith("TEX_"):
            what = "bake it" if not node.type.startswith(("BSDF", "SUBSURFACE", "ADD_SHADER", "MIX_SHADER")) else "use a Principled BSDF"
            notes.say("material %s: %s is not exported; %s" % (material.name, label, what))


def look_at_materials(seen, found, notes):
    used = set()
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        thing = instance.object
        if (instance.parent if instance.is_instance else thing).original in seen:
            used.update(m.original for m in getattr(thing.data, "materials", ()) if m)
            used.update(s.material for s in thing.original.material_slots if s.material)
    for material in sorted(used, key=lambda m: m.name):
        look_at_material(material, found, notes)


# ---- lights ----------------------------------------------------------------------------------------------------------------

def emission_of(lamp, notes):
    """Color times power; nodes count where they are one Emission."""
    color = [c * lamp.energy for c in lamp.color]
    if not lamp.use_nodes or not lamp.node_tree:
        return color
    nodes = [n for n in lamp.node_tree.nodes if n.type == "EMISSION" and n.outputs[0].is_linked]
    others = [n for n in lamp.node_tree.nodes if n.type not in ("EMISSION", "OUTPUT_LIGHT") and n.outputs and
              any(o.is_linked for o in n.outputs)]
    for node in others:
        notes.say("light %s: %s is not exported" % (lamp.name, node.bl_label))
    if nodes:
        strength, tint = nodes[0].inputs["Strength"].default_value, nodes[0].inputs["Color"].default_value
        color = [c * strength * t for c, t in zip(color, tint)]
    return color


def light_row(thing, lamp, matrix, notes):
    color = emission_of(lamp, notes)
    watts = max(color)
    row = {"name": thing.name, "kind": lamp.type, "matrix": [list(r) for r in matrix], "watts": watts,
           "color": [c / watts for c in color] if watts > 0 else [0, 0, 0], "radius": getattr(lamp, "shadow_soft_size", 0),
           "angle": getattr(lamp, "angle", 0), "size": getattr(lamp, "spot_size", 0), "blend": getattr(lamp, "spot_blend", 0),
           "shape": "", "width": 0, "height": 0}
    if lamp.type == "AREA":
        wide = lamp.shape in ("RECTANGLE", "ELLIPSE")
        row.update(shape=lamp.shape, width=lamp.size, height=lamp.size_y if wide else lamp.size)
        if getattr(lamp, "spread", math.pi) < math.pi - 1e-3:
            notes.say("light %s: its spread is not exported: it shines to all sides of its front" % thing.name)
        if lamp.cycles.is_portal if hasattr(lamp, "cycles") else False:
            return None
    if min(color) < 0:
        notes.say("light %s: negative light is not exported" % thing.name)
        return None
    return row if watts > 0 else None


def lights(seen, notes):
    rows = []
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for instance in depsgraph.object_instances:
        thing = instance.object
        holder = instance.parent if instance.is_instance else thing
        if thing.type != "LIGHT" or (holder.original not in seen) or thing.original.hide_render:
            continue
        row = light_row(thing, thing.data, instance.matrix_world.copy(), notes)
        if row:
            rows.append(row)
    return rows


# ---- the camera ------------------------------------------------------------------------------------------------------------

def camera_row(scene, matrices, notes):
    thing = scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get())
    camera = thing.data
    if camera.type == "PANO":
        raise Refused("camera %s is a panorama, which is not exported; choose perspective or orthographic" % thing.name)
    lens, focus = 0.0, 0.0
    if camera.dof.use_dof:
        if camera.type == "PERSP":
            lens = camera.lens * 1e-3 / 2 / camera.dof.aperture_fstop
        else:
            lens = 0.5 / camera.dof.aperture_fstop
        focus = camera.dof.focus_distance
        if camera.dof.focus_object:
            target = camera.dof.focus_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
            away = target.matrix_world.translation - thing.matrix_world.translation
            focus = abs(away.dot(thing.matrix_world.to_3x3().col[2].normalized()))
        focus = max(focus, 1e-3)
        if camera.dof.aperture_blades > 2 or camera.dof.aperture_ratio != 1:
            notes.say("camera %s: blades and ratio of its aperture are not exported: it is round" % thing.name)
    sensor = camera.sensor_height if camera.sensor_fit == "VERTICAL" else camera.sensor_width
    return {"name": thing.name, "matrices": matrices, "lens_mm": camera.lens, "sensor_mm": sensor, "fit": camera.sensor_fit,
            "ortho_scale": camera.ortho_scale if camera.type == "ORTHO" else None,
            "shift": [camera.shift_x, camera.shift_y], "lens_radius": lens, "focus": focus}


# ---- the world -------------------------------------------------------------------------------------------------------------

def write_constant(path, color):
    """A PFM file of 4x2 pixels."""
    with open(path, "wb") as out:
        out.write(b"PF\n4 2\n-1.0\n" + struct.pack("<3f", *color) * 8)


def background(world):
    """The Background node that is the world's surface, if it is one."""
    for node in world.node_tree.nodes:
        if node.type == "OUTPUT_WORLD" and node.is_active_output and node.inputs["Surface"].is_linked:
            first = node.inputs["Surface"].links[0].from_node
            return first if first.type == "BACKGROUND" else None
    return None


def turn_about_z(node):
    """Degrees by which a chain of Mapping and Texture Coordinate turns the map about Z; None if it does something else."""
    socket = node.inputs["Vector"]
    if not socket.is_linked:
        return 0.0
    source = socket.links[0].from_node
    if source.type == "TEX_COORD":
        return 0.0 if socket.links[0].from_socket.name == "Generated" else None
    if source.type != "MAPPING" or source.vector_type not in ("POINT", "TEXTURE", "VECTOR") or turn_about_z(source) != 0.0:
        return None
    if any(s.is_linked for s in source.inputs[1:]):
        return None
    place, turn, scale = (tuple(source.inputs[name].default_value) if name in source.inputs else default
                          for name, default in (("Location", (0, 0, 0)), ("Rotation", (0, 0, 0)), ("Scale", (1, 1, 1))))
    if (any(place) and source.vector_type != "VECTOR") or any(turn[:2]) or len(set(scale)) != 1 or scale[0] <= 0:
        return None
    angle = math.degrees(turn[2])
    return angle if source.vector_type == "TEXTURE" else -angle


def map_file(image, folder):
    """The image as an EXR or HDR file that Azulejo reads, or None."""
    name = os.path.basename(bpy.path.abspath(image.filepath or image.name))
    if image.source != "FILE" or image.is_dirty or not name.lower().endswith((".exr", ".hdr")) or \
            image.colorspace_settings.name.lower() not in ("linear", "linear rec.709", "non-color", "raw"):
        return None
    if image.packed_file:
        path = os.path.join(folder, name)
        with open(path, "wb") as out:
            out.write(image.packed_file.data)
        return path
    path = bpy.path.abspath(image.filepath)
    return path if os.path.isfile(path) else None


def bake_world(scene, path, notes):
    """Let Cycles render the world as a lat-long map."""
    bake = bpy.data.scenes.new("Azulejo world")
    bake.world = scene.world
    data = bpy.data.cameras.new("Azulejo world")
    camera = bpy.data.objects.new("Azulejo world", data)
    camera.rotation_euler = (math.pi / 2, 0, -math.pi / 2)  # u = 0.5 is +X
    bake.collection.objects.link(camera)
    bake.camera = camera
    bake.render.engine = "CYCLES"
    data.type = "PANO"
    for holder in (data, getattr(data, "cycles", None)):
        if hasattr(holder, "panorama_type"):
            holder.panorama_type = "EQUIRECTANGULAR"
    bake.cycles.samples, bake.cycles.use_adaptive_sampling, bake.cycles.use_denoising = 4, False, False
    bake.render.resolution_x, bake.render.resolution_y = WORLD_BAKE_WIDTH, WORLD_BAKE_WIDTH // 2
    bake.render.resolution_percentage, bake.render.film_transparent = 100, False
    bake.render.image_settings.file_format = "OPEN_EXR"
    bake.render.image_settings.color_depth = "32"
    bake.render.use_motion_blur = False
    bake.render.filepath = path
    bpy.ops.render.render(write_still=True, scene=bake.name)
    bpy.data.scenes.remove(bake)
    if not os.path.isfile(path):
        notes.say("world %s: could not be baked, and is black" % scene.world.name)
        return None
    return path


def environment(scene, folder, notes):
    """{"file", "rotate_deg", "strength"}: always there, so that black is black."""
    black = os.path.join(folder, "world.pfm")
    out = {"file": black, "rotate_deg": 0.0, "strength": 1.0}
    color = (0, 0, 0)
    world = scene.world
    if world and not (world.use_nodes and world.node_tree):
        color = tuple(world.color)
    elif world:
        node = background(world)
        tint = node.inputs["Color"] if node else None
        if node and not node.inputs["Strength"].is_linked:
            strength = node.inputs["Strength"].default_value
            source = tint.links[0].from_node if tint.is_linked else None
            if source is None:
                color = tuple(c * strength for c in tuple(tint.default_value)[:3])
            elif source.type == "TEX_ENVIRONMENT" and source.image and source.projection == "EQUIRECTANGULAR":
                path, turn = map_file(source.image, folder), turn_about_z(source)
                if path and turn is not None:
                    return {"file": path, "rotate_deg": turn, "strength": max(strength, 0.0)}
        if any(n.type == "OUTPUT_WORLD" and n.inputs["Volume"].is_linked for n in world.node_tree.nodes):
            notes.say("world %s: its volume is not exported" % world.name)
        nodes = reached(world.node_tree, [])
        if (node is None or tint.is_linked or node.inputs["Strength"].is_linked) and len(nodes) > 1:
            if any(n.type == "LIGHT_PATH" for n in nodes):
                notes.say("world %s: Light Path is not exported: all rays see what the camera sees" % world.name)
            if any(n.type == "TEX_SKY" and getattr(n, "sun_disc", False) for n in nodes):
                notes.say("world %s: the sky's sun is as sharp as a map of %d pixels; a Sun light is sharper" % (
                    world.name, WORLD_BAKE_WIDTH))
            baked = bake_world(scene, os.path.join(folder, "world.exr"), notes)
            if baked:
                return {"file": baked, "rotate_deg": 0.0, "strength": 1.0}
    write_constant(black, [max(c, 0.0) for c in color])
    return out


# ---- the export ----------------------------------------------------------------------------------------------------------

def export_gltf(path, moving):
    known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    wanted = {"filepath": path, "check_existing": False, "export_format": "GLTF_SEPARATE", "export_cameras": False,
              "export_lights": False, "export_apply": True, "export_yup": True, "use_renderable": True, "use_visible": False,
              "use_active_scene": True, "use_selection": False, "export_extras": False, "export_animations": moving,
              "export_skins": moving, "export_morph": True, "export_current_frame": True, "export_frame_range": True,
              "export_force_sampling": True, "export_nla_strips": False, "export_animation_mode": "SCENE",
              "export_anim_slide_to_zero": False, "export_optimize_animation_size": False,
              "export_draco_mesh_compression_enable": False, "export_all_influences": True, "export_def_bones": False,
              "export_image_format": "AUTO", "export_keep_originals": False, "export_import_convert_lighting_mode": "RAW"}
    result = bpy.ops.export_scene.gltf(**{k: v for k, v in wanted.items() if k in known})
    if "FINISHED" not in result or not os.path.isfile(path):
        raise Refused("Blender's glTF exporter wrote nothing")


def retime_file(gltf, folder, fps, shift):
    files = [os.path.join(folder, b["uri"]) for b in gltf.get("buffers", ())]
    data = []
    for name in files:
        with open(name, "rb") as source:
            data.append(bytearray(source.read()))
    scene_fix.retime(gltf, data, fps, shift)
    for name, content in zip(files, data):
        with open(name, "wb") as out:
            out.write(content)


def export(scene, request):
    notes, folder, frame = Notes(), request["folder"], request["frame"]
    if scene.camera is None:
        raise Refused("the scene has no camera; add one, or make one active")
    shutter = request["shutter"]
    # The shutter opens at the frame's own second.
    shift = {"START": 0.0, "END": shutter}.get(request["position"], shutter / 2)
    seen = show_what_renders(scene, request["layer"], notes)
    found = {"absorption": {}, "coat": 0.25 if bpy.app.version < (4, 0) else 1.0}
    look_at_materials(seen, found, notes)
    matrices = []
    scene.frame_start, scene.frame_end, scene.frame_step = frame - 1, frame + 1, 1
    for moment in ((frame - 1, frame, frame + 1) if shutter > 0 else (frame, )):
        scene.frame_set(moment)
        thing = scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices.append([list(row) for row in thing.matrix_world])
    scene.frame_set(frame)
    found.update(camera=camera_row(scene, matrices, notes), lights=lights(seen, notes), size=request["size"], begin=frame - 1 + shift)
    for name in scene_fix.glowing_in_view(found):
        notes.say("light %s: is in the camera's view and is seen as a glowing surface, which Cycles hides" % name)
    env = environment(scene, folder, notes)
    path = os.path.join(folder, "scene.gltf")
    export_gltf(path, shutter > 0)
    with open(path, encoding="utf-8") as source:
        gltf = json.load(source)
    if shutter > 0:
        retime_file(gltf, folder, scene.render.fps / scene.render.fps_base, shift)
    scene_fix.fix(gltf, found)
    with open(path, "w", encoding="utf-8") as out:
        json.dump(gltf, out)
    return {"scene": found, "env": env, "gltf": path, "notes": notes}


def answer(folder, what):
    path = os.path.join(folder, "answer.json")
    with open(path + ".part", "w", encoding="utf-8") as out:
        json.dump(what, out)
    os.replace(path + ".part", path)


def serve(path, name, camera):
    scene = problem = None
    try:
        scene = open_scene(path, name, camera)
    except Exception as caught:  # pylint: disable=broad-except  # it becomes the answer to each request
        problem = str(caught) or repr(caught)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if problem:
                raise Refused("the copy of the scene cannot be read: " + problem)
            answer(request["folder"], export(scene, request))
        except Refused as refused:
            answer(request["folder"], {"error": str(refused)})
        except Exception as caught:  # pylint: disable=broad-except  # as above
            traceback.print_exc()
            answer(request["folder"], {"error": "the export failed: %s" % (str(caught).strip().splitlines() or [repr(caught)])[-1]})


if __name__ == "__main__":
    serve(*sys.argv[sys.argv.index("--") + 1:])
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
