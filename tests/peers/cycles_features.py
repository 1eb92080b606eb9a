"""Render many scenes with Cycles, each twice, and tell how far Azulejo's two pictures are from them.

Run inside Blender by compare_features.sh:
    blender -b --factory-startup -P tests/peers/cycles_features.py -- ROWS.json
A row is what features.py writes: name, scene, environment, ours (two pictures), width, height, spp,
depth, frame, shutter, ggx, match, stage (materials that are not the subject).
"""
import json
import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy

import pictures
import bpy
import cycles_render

# See cycles_render.cut_lamps: Cycles' large lamps are too dark where they are seen edge-on.
LAMP_CUTS = 15


def node(tree, kind, **inputs):
    made = tree.nodes.new(kind)
    for name, value in inputs.items():
        made.inputs[name.replace("_", " ")].default_value = value
    return made


def rgba(color):
    return tuple(color[:3]) + (1,)


def absorption(tree, volume):
    """Cycles' coefficient is density * (1 - colour); glTF's -log(colour) / distance. (Blender's
    importer puts the colour itself there.)"""
    sigma = [-math.log(max(c, 1e-6)) / volume["attenuationDistance"]
             for c in volume.get("attenuationColor", [1, 1, 1])]
    most = max(sigma)
    return node(tree, "ShaderNodeVolumeAbsorption", Density=most,
                Color=rgba([1 - s / most for s in sigma]))


def schlick(tree, f0):
    """F0 + (1 - F0) (1 - cos)^5 at the surface's own normal."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    cosine = tree.nodes.new("ShaderNodeVectorMath")
    cosine.operation = "DOT_PRODUCT"
    tree.links.new(geometry.outputs["Normal"], cosine.inputs[0])
    tree.links.new(geometry.outputs["Incoming"], cosine.inputs[1])
    steps = [cosine.outputs["Value"]]
    for operation, other in (("SUBTRACT", None), ("POWER", 5.0), ("MULTIPLY", 1 - f0),
                             ("ADD", f0)):
        made = tree.nodes.new("ShaderNodeMath")
        made.operation = operation
        first, second = (1, 0) if other is None else (0, 1)
        tree.links.new(steps[-1], made.inputs[first])
        made.inputs[second].default_value = 1.0 if other is None else other
        steps.append(made.outputs[0])
    return steps[-1]


def mixed(tree, factor, first, second):
    mix = tree.nodes.new("ShaderNodeMixShader")
    if hasattr(factor, "is_linked"):
        tree.links.new(factor, mix.inputs["Fac"])
    else:
        mix.inputs["Fac"].default_value = factor
    tree.links.new(first.outputs[0], mix.inputs[1])
    tree.links.new(second.outputs[0], mix.inputs[2])
    return mix


def matched(tree, material, ggx):
    """Cycles' own nodes for a material that they can express exactly, else nothing."""
    pbr = material.get("pbrMetallicRoughness", {})
    extensions = {k[14:]: v for k, v in material.get("extensions", {}).items()}
    base, roughness = rgba(pbr.get("baseColorFactor", [1] * 4)), pbr.get("roughnessFactor", 1)
    if "transmission" in extensions and "volume" in extensions:
        glass = node(tree, "ShaderNodeBsdfGlass", Color=base, Roughness=roughness,
                     IOR=extensions.get("ior", {}).get("ior", 1.5))
        glass.distribution = ggx
        volume = extensions["volume"]
        return glass, absorption(tree, volume) if "attenuationDistance" in volume else None
    if "transmission" in extensions and roughness == 0:
        return mixed(tree, schlick(tree, 0.04), node(tree, "ShaderNodeBsdfTransparent", Color=base),
                     node(tree, "ShaderNodeBsdfGlossy", Color=rgba([1] * 3), Roughness=0)), None
    if "diffuse_transmission" in extensions:
        through = extensions["diffuse_transmission"]
        below = node(tree, "ShaderNodeBsdfTranslucent",
                     Color=rgba(through.get("diffuseTransmissionColorFactor", [1] * 3)))
        return mixed(tree, through.get("diffuseTransmissionFactor", 0),
                     node(tree, "ShaderNodeBsdfDiffuse", Color=base), below), None
    if "anisotropy" in extensions and pbr.get("metallicFactor", 1) == 1:
        # glTF: alpha along the tangent is mix(alpha, 1, strength^2). Cycles: alpha (1 - a) along
        # it and alpha / (1 - a) across, for a > 0; a < 0 turns that round.
        strength = extensions["anisotropy"].get("anisotropyStrength", 0)
        across = roughness ** 2
        along = across + (1 - across) * strength ** 2
        metal = node(tree, "ShaderNodeBsdfAnisotropic", Color=base,
                     Roughness=math.sqrt(math.sqrt(along * across)),
                     Anisotropy=-(1 - math.sqrt(across / along)),
                     Rotation=extensions["anisotropy"].get("anisotropyRotation", 0) / (2 * math.pi))
        metal.distribution = "GGX"
        tangent = tree.nodes.new("ShaderNodeTangent")
        tangent.direction_type = "UV_MAP"
        tree.links.new(tangent.outputs[0], metal.inputs["Tangent"])
        return metal, None
    return None, None


def put(tree, surface, volume):
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    tree.links.new(surface.outputs[0], output.inputs["Surface"])
    for link in list(output.inputs["Volume"].links):
        tree.links.remove(link)
    if volume is not None:
        tree.links.new(volume.outputs[0], output.inputs["Volume"])


def set_materials(gltf, row):
    for material in gltf.get("materials", []):
        made = bpy.data.materials.get(material["name"])
        if made is None:
            continue
        if cycles_render.is_lambert(material) and \
                "KHR_materials_diffuse_transmission" not in material.get("extensions", {}):
            cycles_render.make_lambert(made)
        elif row["match"]:
            surface, volume = matched(made.node_tree, material, row["ggx"])
            if surface is not None:
                put(made.node_tree, surface, volume)
        made.cycles.sample_as_light = row["sampled"]
        for shader in made.node_tree.nodes:
            if shader.type in ("BSDF_PRINCIPLED", "BSDF_GLASS"):
                shader.distribution = row["ggx"]


def set_time(scene, row):
    """The importer leaves all animations but the first stopped, and moves those whose first key is
    at 0 s to frame 1."""
    for thing in list(scene.objects) + list(bpy.data.shape_keys):
        animation = thing.animation_data
        if animation is None:
            continue
        if animation.nla_tracks:
            animation.action = None
        for track in list(animation.nla_tracks):
            action = track.strips[0].action
            animation.nla_tracks.remove(track)
            animation.nla_tracks.new().strips.new(
                action.name, round(action.frame_range[0]), action)
    scene.render.fps, scene.render.fps_base = 24, 1
    scene.frame_set(row["frame"])
    scene.render.use_motion_blur = row["shutter"] > 0
    scene.render.motion_blur_shutter = max(row["shutter"], 0.01)
    scene.cycles.motion_blur_position = "START"
    for thing in scene.objects:
        thing.cycles.use_deform_motion = True
        thing.cycles.motion_steps = 4
        thing.cycles.shadow_terminator_geometry_offset = 0


def set_lights():
    """glTF's punctual lights have no size; Blender's are a quarter of a metre by default."""
    for light in bpy.data.lights:
        if light.type == "SUN":
            light.angle = 0
        else:
            light.shadow_soft_size = 0


def separate_alpha():
    """Else Cycles multiplies a picture's colour by its alpha, even where alpha is not used."""
    for image in bpy.data.images:
        image.alpha_mode = "CHANNEL_PACKED"


def render_mask(scene, stage, path):
    """Where the subject is seen: what is left of alpha when the stage is hidden."""
    hidden = [o for o in scene.objects if o.type == "MESH" and
              any(m and m.name in stage for m in o.data.materials)]
    for thing in hidden:
        thing.hide_render = True
    samples, scene.cycles.samples = scene.cycles.samples, 4
    scene.render.film_transparent = True
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    scene.render.film_transparent = False
    scene.cycles.samples = samples
    for thing in hidden:
        thing.hide_render = False


def compare(row, folder):
    with open(row["scene"]) as source:
        gltf = json.load(source)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=row["scene"], convert_lighting_mode="COMPAT")
    scene = bpy.context.scene
    set_materials(gltf, row)
    set_lights()
    separate_alpha()
    cycles_render.cut_lamps({"materials": [m for m in gltf.get("materials", [])
                                           if m["name"] in row["stage"]]}, LAMP_CUTS)
    cycles_render.set_camera(scene, gltf)
    cycles_render.set_world(scene, row["environment"], 0.0)
    paths = [os.path.join(folder, "%s-cycles%s.exr" % (row["name"], k)) for k in ("0", "1", "-mask")]
    cycles_render.set_render(scene, paths[0], row["width"], row["height"], row["spp"], row["depth"])
    set_time(scene, row)
    render_mask(scene, row["stage"], paths[2])
    for seed in (0, 1):
        scene.cycles.seed = 1000 * seed + 1
        scene.render.filepath = paths[seed]
        bpy.ops.render.render(write_still=True)
    ours = [pictures.read(p) for p in row["ours"]]
    theirs = [pictures.read(p) for p in paths[:2]]
    subject = pictures.read(paths[2])[..., 3] > 0.25
    if not subject.any():
        subject[:] = True
    everywhere = numpy.ones(subject.shape, bool)
    print("row: %-34s %s | %s  (%2.0f %%)" % (
        row["name"], pictures.percents(*pictures.difference(ours, theirs, everywhere)),
        pictures.percents(*pictures.difference(ours, theirs, subject)), 100 * subject.mean()),
        flush=True)


def main():
    path = sys.argv[sys.argv.index("--") + 1]
    with open(path) as source:
        rows = json.load(source)
    for row in rows:
        compare(row, os.path.dirname(path))


if __name__ == "__main__":
    main()
