"""Runs in Blender: builds a small scene, renders it with Azulejo, with Cycles, or both.

    blender -b --factory-startup -P tests/blender/inside.py -- CASE FOLDER AZULEJO [KEY=VALUE ...]

Writes FOLDER/azulejo.exr and FOLDER/cycles.exr, and FOLDER/said.json: {"notes", "error"}."""
import importlib
import json
import math
import os
import sys
import threading
import time

import bpy

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.dont_write_bytecode = True


# ---- scenes --------------------------------------------------------------------------------------------------------------

def lambert(name, color):
    """The same model in both: a diffuse BSDF."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    node = tree.nodes.new("ShaderNodeBsdfDiffuse")
    node.inputs["Color"].default_value = color + (1, )
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def box(name, place, size, material):
    bpy.ops.mesh.primitive_cube_add(size=1, location=place)
    thing = bpy.context.object
    thing.name = name
    thing.scale = size
    thing.data.materials.append(material)
    return thing


def aim(thing, target):
    away = thing.location - target
    thing.rotation_euler = away.to_track_quat("Z", "Y").to_euler()


def add_camera(place, target, lens=35.0):
    import mathutils
    data = bpy.data.cameras.new("Camera")
    thing = bpy.data.objects.new("Camera", data)
    bpy.context.scene.collection.objects.link(thing)
    thing.location = place
    aim(thing, mathutils.Vector(target))
    data.lens = lens
    bpy.context.scene.camera = thing
    return thing


def add_lamp(kind, name, place, target, energy, **more):
    import mathutils
    data = bpy.data.lights.new(name, kind)
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    thing.location = place
    aim(thing, mathutils.Vector(target))
    data.energy = energy
    for key, value in more.items():
        setattr(data, key, value)
    return thing


def empty():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    return scene


def sky_map(folder):
    """A small HDRI whose four quarters differ, as an EXR file."""
    path = os.path.join(folder, "sky.exr")
    image = bpy.data.images.new("sky", 64, 32, float_buffer=True)
    pixels = []
    for y in range(32):
        for x in range(64):
            quarter = x // 16
            pixels += [(2.0, 0.1, 0.1, 1), (0.1, 1.5, 0.1, 1), (0.1, 0.1, 1.0, 1), (0.3, 0.3, 0.3, 1)][quarter]
    image.pixels = pixels
    image.file_format = "OPEN_EXR"
    image.filepath_raw = path
    image.save()
    bpy.data.images.remove(image)
    return path


def light_by_map(scene, path, degrees, strength):
    tree = scene.world.node_tree
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(path)
    coordinates, mapping = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value = (0, 0, math.radians(degrees))
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = strength


def default(folder):
    """Blender's own first scene, its cube a Lambert reflector."""
    scene = bpy.context.scene
    scene.objects["Cube"].data.materials[0] = lambert("grey", (0.8, 0.8, 0.8))


def principled(folder):
    """Blender's own first scene as it is."""


def room(folder):
    """A room that is open to a map: an area light, and a window."""
    scene = empty()
    white, red, green = lambert("white", (.75, .75, .75)), lambert("red", (.6, .1, .1)), lambert("green", (.1, .5, .1))
    box("floor", (0, 0, -.05), (4, 4, .1), white)
    box("ceiling", (0, 0, 2.55), (4, 4, .1), white)
    box("back", (0, 2.05, 1.25), (4, .1, 2.6), white)
    box("left", (-2.05, 0, 1.25), (.1, 4, 2.6), red)
    box("right", (2.05, 1.2, 1.25), (.1, 1.6, 2.6), green)
    box("block", (-.5, .6, .5), (.8, .8, 1), white)
    box("ball", (.8, .2, .3), (.5, .5, .6), white)
    add_lamp("AREA", "ceiling light", (0, .5, 2.45), (0, .5, 0), 60, shape="RECTANGLE", size=1.0, size_y=.5)
    add_camera((0, -4.6, 1.3), (0, 0, 1.15), lens=32)
    light_by_map(scene, sky_map(folder), 40, .6)


def lamps(folder):
    """Every kind of lamp, with and without a size."""
    empty()
    box("floor", (0, 0, -.05), (12, 8, .1), lambert("white", (.7, .7, .7)))
    for x in (-4, -2, 0, 2, 4):
        box("post", (x, .3, .4), (.15, .15, .8), lambert("post", (.5, .5, .5)))
    add_lamp("POINT", "ball", (-4, -.8, 1.5), (-4, -1, 0), 60, shadow_soft_size=.2)
    add_lamp("POINT", "point", (-2, -.8, 1.5), (-2, -1, 0), 60, shadow_soft_size=0)
    add_lamp("SPOT", "spot", (0, -1, 3), (0, 0, 0), 200, shadow_soft_size=0, spot_size=.8, spot_blend=.5)
    add_lamp("AREA", "disc", (2, -1, 1.5), (2, 0, 0), 20, shape="DISK", size=.5)
    add_lamp("SUN", "sun", (4, 0, 5), (3, 1, 0), .5, angle=.2, color=(1, .9, .8))
    add_camera((0, -9, 5), (0, 0, 0), lens=35)


def rig(folder):
    """Two bones bend a bar, and the camera moves."""
    scene = empty()
    bar = box("bar", (0, 0, 1), (.3, .3, 2), lambert("bar", (.02, .02, .02)))
    bpy.ops.object.transform_apply(location=True, scale=True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide(number_cuts=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.armature_add(location=(0, 0, 0))
    armature = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    first = armature.data.edit_bones[0]
    first.tail = (0, 0, 1)
    second = armature.data.edit_bones.new("upper")
    second.head, second.tail, second.parent = (0, 0, 1), (0, 0, 2), first
    bpy.ops.object.mode_set(mode="OBJECT")
    bar.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    bone = armature.pose.bones["upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((1, -1.5), (5, 1.5)):
        bone.rotation_euler = (0, 0, angle)  # sideways; Y is along the bone
        bone.keyframe_insert("rotation_euler", frame=frame)
    camera = add_camera((0, -6, 1), (0, 0, 1))
    for frame, x in ((1, -.3), (5, .3)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 20
    scene.frame_start, scene.frame_end, scene.frame_step = 1, 5, 2
    scene.frame_set(1)


def lens(folder):
    """A shifted camera that is out of focus."""
    default(folder)
    camera = bpy.context.scene.camera.data
    camera.shift_x, camera.shift_y = .12, -.08
    camera.dof.use_dof, camera.dof.aperture_fstop, camera.dof.focus_distance = True, .05, 6.0


def upright(folder):
    """A portrait, at half its resolution, orthographic."""
    default(folder)
    scene = bpy.context.scene
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6
    scene.camera.data.shift_x = .1
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 180, 320, 50


def noise(folder):
    """What cannot be exported."""
    default(folder)
    scene = bpy.context.scene
    material = bpy.data.materials.new("marble")
    material.use_nodes = True
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    scene.objects["Cube"].data.materials[0] = material


def sky(folder):
    """A world of nodes, which is baked."""
    default(folder)
    scene = bpy.context.scene
    scene.objects["Light"].hide_render = True
    tree = scene.world.node_tree
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], gradient.inputs["Vector"])
    tree.links.new(gradient.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 2


def edge(folder):
    """A black half in front of a white world, orthographic. 64 pixels wide, the edge is between two of them."""
    scene = empty()
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 1
    camera = add_camera((0, -6, 0), (0, 0, 0))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 64
    box("half", (-50, 0, 0), (100, 1, 100), lambert("black", (0, 0, 0)))


def principled_like(name, color, **inputs):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    node = material.node_tree.nodes["Principled BSDF"]
    node.inputs["Base Color"].default_value = color + (1, )
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    return material


def smooth(name, material, bevel=0.0):
    """The object that was just made, with this material and soft edges."""
    thing = bpy.context.object
    thing.name = name
    thing.data.materials.append(material)
    bpy.ops.object.shade_smooth()
    if bevel:
        rounded = thing.modifiers.new("Bevel", "BEVEL")
        rounded.width, rounded.segments, rounded.limit_method = bevel, 6, "ANGLE"
        thing.data.use_auto_smooth = True
    return thing


def nodes_of(name, kind, **inputs):
    """A new material whose surface is a node of this kind; its tree and that node."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    return material, tree, node


def instanced(thing, place):
    """Show an object by an instance of its collection alone."""
    parts, holder = bpy.data.collections.new("parts"), bpy.data.objects.new("holder", None)
    parts.objects.link(thing)
    bpy.context.collection.objects.unlink(thing)
    holder.instance_type, holder.instance_collection, holder.location = "COLLECTION", parts, place
    bpy.context.scene.collection.objects.link(holder)


def image_with_holes(folder):
    """A PNG file of 8x8 pixels, ochre where it is not clear."""
    image = bpy.data.images.new("holes", 8, 8, alpha=True)
    image.pixels = [c for y in range(8) for x in range(8) for c in (.8, .5, .1, (x + y) % 2)]
    image.file_format, image.filepath_raw = "PNG", os.path.join(folder, "holes.png")
    image.save()
    bpy.data.images.remove(image)
    return bpy.data.images.load(os.path.join(folder, "holes.png"))


def ball(x, material):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=.45, location=(x, 0, 0))
    return smooth(material.name, material)


def balls(folder):
    """Eight balls before stripes, 40 pixels each at a width of 320: clear, with alpha, coated, without a material, inside out."""
    scene = empty()
    leaf, tree, mix = nodes_of("leaf", "ShaderNodeMixShader")
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[2])
    holes = tree.nodes.new("ShaderNodeTexImage")
    holes.image, holes.interpolation = image_with_holes(folder), "Closest"
    tree.links.new(holes.outputs["Alpha"], mix.inputs["Fac"])
    tree.links.new(holes.outputs["Color"], mix.inputs[2].links[0].from_node.inputs["Color"])
    veil, tree, mix = nodes_of("veil", "ShaderNodeMixShader", Fac=.3)
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
    juice, tree, _ = nodes_of("juice", "ShaderNodeBsdfGlass", Roughness=0, IOR=1.33)
    inside = tree.nodes.new("ShaderNodeVolumeAbsorption")
    inside.inputs["Color"].default_value, inside.inputs["Density"].default_value = (.9, .5, .1, 1), 3
    tree.links.new(inside.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    for i, material in enumerate((
            principled_like("glass", (.9, .6, .4), Transmission=1, Roughness=0), juice, principled_like("ghost", (.7, .2, .2), Alpha=.5, Specular=0),
            leaf, veil, principled_like("coat", (0, 0, 0), Specular=0, Clearcoat=1, Roughness=1))):
        ball(i - 3.5, material)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=.45, location=(2.5, 0, 0))
    box("empty slot", (2.5, -.7, 0), (.4, .4, .4), None)
    culled = lambert("culled", (.3, .6, .2))
    culled.use_backface_culling = True
    ball(3.5, culled).data.flip_normals()
    bpy.ops.mesh.primitive_cube_add(size=.4)
    instanced(bpy.context.object, (3.5, -.7, 0))
    for i in range(-8, 9):
        box("stripe", (i * .5, 1.5, 0), (.25, .05, 6), lambert("stripe", (.7, .7, .7) if i % 2 else (.1, .3, .5)))
    camera = add_camera((0, -6, 0), (0, 0, 0))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 8
    light_by_map(scene, sky_map(folder), 40, .6)


def lost(folder):
    """Parts of the Principled BSDF, and mixes of shaders, that cannot be exported."""
    default(folder)
    odd = principled_like("odd", (.5, .5, .5), Subsurface=.1, Anisotropic=.5, Sheen=.2)
    two, tree, mix = nodes_of("two", "ShaderNodeMixShader")
    for socket in mix.inputs[1:3]:
        tree.links.new(tree.nodes.new("ShaderNodeBsdfPrincipled").outputs[0], socket)
    fog, tree, _ = nodes_of("fog", "ShaderNodeBsdfGlass")
    tree.links.new(tree.nodes.new("ShaderNodeVolumeScatter").outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    for i, material in enumerate((odd, two, fog)):
        box("thing", (i * 3 - 3, 3, 0), (1, 1, 1), material)
    inner = box("inner", (0, 0, 0), (1, 1, 1), principled_like("inner", (.5, .5, .5), Subsurface=.1))
    made = bpy.data.node_groups.new("made", "GeometryNodeTree")
    made.inputs.new("NodeSocketGeometry", "Geometry")
    made.outputs.new("NodeSocketGeometry", "Geometry")
    first, node, last = (made.nodes.new(n) for n in ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput"))
    node.inputs["Material"].default_value = principled_like("made", (.5, .5, .5), Sheen=1)
    made.links.new(first.outputs[0], node.inputs["Geometry"])
    made.links.new(node.outputs[0], last.inputs[0])
    box("made", (0, 9, 0), (1, 1, 1), None).modifiers.new("made", "NODES").node_group = made
    instanced(inner, (0, 6, 0))


def product(folder):
    """A jar with a metal lid, a plastic ball and a glass one in a photographer's studio."""
    scene = empty()
    background = scene.world.node_tree.nodes["Background"].inputs
    background["Color"].default_value, background["Strength"].default_value = (.8, .9, 1, 1), .15
    profile = [(-6, 0)] + [(2 + 1.5 * math.sin(a), 1.5 - 1.5 * math.cos(a)) for a in (i * math.pi / 32 for i in range(17))] + [(3.5, 6)]
    count = len(profile)
    sweep = bpy.data.meshes.new("sweep")
    sweep.from_pydata([(x, y, z) for x in (-8, 8) for y, z in profile], [],
                      [(i, count + i, count + i + 1, i + 1) for i in range(count - 1)])
    thing = bpy.data.objects.new("sweep", sweep)
    scene.collection.objects.link(thing)
    sweep.materials.append(lambert("paper", (.7, .7, .7)))
    for face in sweep.polygons:
        face.use_smooth = True
    bpy.ops.mesh.primitive_cylinder_add(vertices=96, radius=.6, depth=1.2, location=(-.2, 0, .6))
    smooth("jar", lambert("clay", (.7, .25, .1)), .08)
    bpy.ops.mesh.primitive_cylinder_add(vertices=96, radius=.62, depth=.3, location=(-.2, 0, 1.36))
    smooth("lid", principled_like("brass", (.9, .7, .35), Metallic=1, Roughness=.25), .05)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=.45, location=(.95, -.3, .45))
    smooth("plastic ball", principled_like("plastic", (.08, .25, .6), Roughness=.3))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=.35, location=(-1.15, -.5, .35))
    smooth("glass ball", principled_like("glass", (1, 1, 1), Transmission=1, Roughness=0))
    add_lamp("AREA", "key", (-3.5, -2.5, 4), (0, 0, .6), 250, shape="SQUARE", size=2.0)
    add_lamp("AREA", "rim", (4, 0, 2.5), (0, 0, .6), 80, shape="RECTANGLE", size=.5, size_y=2.5)
    add_camera((0, -6.5, 1.9), (0, 0, .75), lens=60)


CASES = {f.__name__: f for f in (default, principled, room, lamps, rig, lens, upright, noise, sky, edge, balls, lost, product)}


# ---- rendering -------------------------------------------------------------------------------------------------------------

def install(how):
    """Register the add-on: from its folder, or (how: a zip) as a user installs it."""
    if how.endswith(".zip"):
        bpy.ops.preferences.addon_install(filepath=how, overwrite=True)
        bpy.ops.preferences.addon_enable(module="azulejo_render")
        return sys.modules["azulejo_render"]
    sys.path.insert(0, how)
    package = importlib.import_module("azulejo_render")
    package.register()
    return package


def picture_settings(scene, options):
    render = scene.render
    if "width" in options:
        render.resolution_x, render.resolution_y = int(options["width"]), int(options["height"])
        render.resolution_percentage = 100
    render.image_settings.file_format = options.get("file", "OPEN_EXR")
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "ZIP"
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.samples = int(options.get("cycles_samples", options.get("samples", 16)))
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 12
    scene.cycles.sample_clamp_indirect = scene.cycles.blur_glossy = 0
    if "filter" in options:
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = options["filter"], float(options["filter_width"])
    if "border" in options:
        render.use_border, render.use_crop_to_border = True, options.get("crop") == "1"
        render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y = (
            float(v) for v in options["border"].split(","))
    render.film_transparent = options.get("transparent") == "1"
    if "frame" in options:
        scene.frame_set(int(options["frame"]))
    if "shutter" in options:
        render.use_motion_blur, render.motion_blur_shutter = True, float(options["shutter"])


def azulejo_settings(scene, program, options):
    panel = scene.azulejo
    panel.program, panel.threads = program, 1
    panel.samples = int(options.get("samples", 16))
    panel.target_error = options.get("target_error", "")
    panel.patience = float(options.get("patience", 60))
    panel.denoise = options.get("denoise", "OFF")
    if "address" in options:
        panel.device, panel.address, panel.key_file = "FARM", options["address"], options["key"]


class Layout:
    """Stands for a panel's: without a window nothing is drawn. A property that is not there fails."""
    active = use_property_split = use_property_decorate = False

    def column(self):
        return self
    row = column

    def prop(self, data, name, text=""):
        getattr(data, name)

    def label(self, text, icon=""):
        pass


def draw_panels(package):
    """What a mistake in them is: an exception."""
    for panel in package.panel.CLASSES:
        if hasattr(panel, "draw"):
            layout = type("Drawn", (), {"layout": Layout(), "column": lambda self: self.layout})()
            panel.draw(layout, bpy.context)


def composite(scene, matte):
    """The compositor's picture is the matte of a thing: "object NAME" or "material NAME"."""
    kind, name = matte.split(" ", 1)
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    layers, node, out = (tree.nodes.new("CompositorNode" + n) for n in ("RLayers", "CryptomatteV2", "Composite"))
    node.source, node.scene = "RENDER", scene
    node.layer_name = "%s.Crypto%s" % (bpy.context.view_layer.name, kind.capitalize())
    node.matte_id = name
    tree.links.new(layers.outputs["Image"], node.inputs["Image"])
    tree.links.new(node.outputs["Matte"], out.inputs["Image"])


def stop_when(look, path):
    """Do as if Esc were pressed when a picture has been shown `look` times; write down that it was. (Ctrl-C, which a Blender without
    a window takes for Esc, ends Blender after the render.)"""
    from azulejo_render import engine
    usual_show, usual_tick = engine.Frame.show, engine.Frame.tick

    def show(self, *arguments, **named):
        usual_show(self, *arguments, **named)
        self.looks = getattr(self, "looks", 0) + 1
        with open(path, "w", encoding="utf-8") as out:
            out.write("%d" % self.looks)

    def tick(self):
        if look and not self.stopped and getattr(self, "looks", 0) >= look:
            raise engine.Stopped()
        usual_tick(self)
    engine.Frame.show, engine.Frame.tick = show, tick


def render(scene, path, animation=False):
    scene.render.filepath = path
    try:
        if animation:
            bpy.ops.render.render(animation=True)
        else:
            bpy.ops.render.render(write_still=True)
    except RuntimeError as problem:
        return str(problem)
    return None


def main(case, folder, program, *words):
    options = dict(word.split("=", 1) for word in words)
    CASES[case](folder)
    package = install(options.get("package", os.path.join(ROOT, "deploy", "blender")))
    scene = bpy.context.scene
    picture_settings(scene, options)
    azulejo_settings(scene, program, options)
    layer = bpy.context.view_layer
    for flag in filter(None, options.get("passes", "").split(",")):
        setattr(layer, flag, True)
    if "matte" in options:
        scene.render.engine = "AZULEJO"  # whose passes the nodes have
        composite(scene, options["matte"])
    draw_panels(package)
    stop_when(int(options.get("stop_at", 0)), os.path.join(folder, "looks"))
    said = {"error": None}
    began = time.time()
    if "azulejo" in options.get("engines", "azulejo"):
        scene.render.engine = "AZULEJO"
        said["error"] = render(scene, os.path.join(folder, "azulejo-" if options.get("animation") else "azulejo.exr"),
                               bool(options.get("animation")))
        said["notes"] = list(package.engine.Current.notes)
        said["seconds"], began = time.time() - began, time.time()
        if "stop_at" in options:
            bpy.data.images["Render Result"].save_render(os.path.join(folder, "azulejo.exr"))
    if "cycles" in options.get("engines", ""):
        scene.render.engine = "CYCLES"
        said["cycles_error"] = render(scene, os.path.join(folder, "cycles-" if options.get("animation") else "cycles.exr"),
                                      bool(options.get("animation")))
        said["cycles_seconds"] = time.time() - began
    said["threads"] = [t.name for t in threading.enumerate()]
    with open(os.path.join(folder, "said.json"), "w", encoding="utf-8") as out:
        json.dump(said, out)


main(*sys.argv[sys.argv.index("--") + 1:])
