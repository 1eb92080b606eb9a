"""The rows of compare_features.sh: edits the scenes, renders them with Azulejo, writes ROWS.json.

    features.py FOLDER AZULEJO SIZE SPP DEPTH SKY|- DATA|- PATTERN
"""
import fnmatch
import json
import os
import subprocess
import sys

STAGE = ["tiles", "lamp", "softbox"]
LAMBERT_STAGE = "lambert=" + ",".join(STAGE)
SINGLE = ["--without", "microfacet-multiple-scattering"]
GGX, MULTI = "GGX", "MULTI_GGX"
FLAT = ["lambert=all", "flat", "nearest"]


def row(name, scene, edits=(), options=(), ggx=GGX, match=False, frame=1, shutter=0.0, whole=False,
        furnace=False, sampled=True):
    """whole: nothing of the stage is Lambert's. furnace: no stage, light 1 from everywhere.
    sampled: Cycles sends rays to the lamps."""
    if furnace:
        edits = list(edits) + ["bare=" + ",".join(STAGE)]
    return dict(name=name, scene=scene, options=list(options), ggx=ggx, match=match, frame=frame,
                shutter=shutter, furnace=furnace, sampled=sampled, edits=["both-sides"] +
                ([] if whole else [LAMBERT_STAGE, "nearest"]) + list(edits))


# Scenes of scenes/features. "Lambert": all dielectrics without reflection. "single", "multi": both
# with or both without what microfacets throw back among themselves. "nodes": the material is built
# again from Cycles' own nodes, from the numbers in the file.
FEATURES = [
    row("metal", "metal"),
    row("metal,single", "metal", options=SINGLE),
    row("metal,multi", "metal", ggx=MULTI),
    row("metal,white,single", "metal", ["white"], SINGLE),
    row("metal,white,multi", "metal", ["white"], ggx=MULTI),
    row("metal,white,multi,unsampled", "metal", ["white"], ggx=MULTI, sampled=False),
    row("metal,white,single,furnace", "metal", ["white"], SINGLE, furnace=True),
    row("metal,white,multi,furnace", "metal", ["white"], ggx=MULTI, furnace=True),
    row("anisotropy", "anisotropy"),
    row("anisotropy,white,single,nodes", "anisotropy", ["white"], SINGLE, match=True),
    row("glass", "glass"),
    row("glass,single,nodes", "glass", options=SINGLE, match=True),
    row("glass,multi,nodes", "glass", ggx=MULTI, match=True),
    row("glass,multi,nodes,unsampled", "glass", ggx=MULTI, match=True, sampled=False),
    row("glass,single,nodes,furnace", "glass", options=SINGLE, match=True, furnace=True),
    row("glass,multi,nodes,furnace", "glass", ggx=MULTI, match=True, furnace=True),
    row("plastic,furnace", "normal-map", ["flat"], furnace=True),
    row("clearcoat,furnace", "clearcoat", furnace=True),
    row("sheen,furnace", "sheen", furnace=True),
    row("absorption", "absorption"),
    row("absorption,nodes", "absorption", match=True),
    row("thin-transmission", "thin-transmission"),
    row("thin-transmission,smooth,nodes", "thin-transmission", ["smooth"], match=True),
    row("diffuse-transmission", "diffuse-transmission"),
    row("diffuse-transmission,Lambert,nodes", "diffuse-transmission", ["lambert=all"], match=True),
    row("clearcoat", "clearcoat"),
    row("clearcoat,none", "clearcoat", ["without=clearcoat"]),
    row("clearcoat,none,Lambert", "clearcoat", FLAT),
    row("clearcoat,none,Lambert,faceted", "clearcoat", FLAT + ["faceted"]),
    row("sheen", "sheen"),
    row("sheen,none,Lambert", "sheen", FLAT),
    row("specular", "specular"),
    row("specular,Lambert", "specular", FLAT),
    row("normal-map", "normal-map"),
    row("normal-map,Lambert", "normal-map", ["lambert=all"]),
    row("normal-map,Lambert,flat", "normal-map", FLAT),
    row("alpha", "alpha"),
    row("alpha,Lambert", "alpha", FLAT),
    row("emissive-strength", "emissive-strength"),
    row("emissive-strength,Lambert", "emissive-strength", FLAT),
    row("unlit", "unlit"),
    row("lights", "lights"),
    row("lights,Lambert", "lights", FLAT),
    row("lights,Lambert,hard-spots", "lights", FLAT + ["hard-spots"]),
    row("many-lights,Lambert", "many-lights", FLAT),
    row("texture-filter,Lambert", "texture-filter", FLAT),
    row("nested", "nested"),
    row("nested,nodes", "nested", match=True),
    row("motion,Lambert", "motion", FLAT, frame=10),
    row("motion,Lambert,shutter", "motion", FLAT, ["--shutter", "0.5"], frame=10, shutter=0.5),
    row("motion,Lambert,key", "motion", FLAT, frame=12),
    row("deformation,Lambert,faceted", "deformation", FLAT + ["faceted"], frame=10),
    row("deformation,Lambert", "deformation", FLAT, frame=10),
    row("deformation,Lambert,shutter", "deformation", FLAT, ["--shutter", "0.5"], frame=10,
        shutter=0.5),
]

# Models of the data folder, under a sky.
MODELS = [row(name + label, scene, ["camera"] + edits, whole=True, frame=frame,
              **more)
          for name, scene, frame in (
              ("SheenChair", "SheenChair/SheenChair.gltf", 1),
              ("ClearCoatTest", "ClearCoatTest/ClearCoatTest.glb", 1),
              ("AlphaBlendModeTest", "AlphaBlendModeTest/AlphaBlendModeTest.glb", 1),
              ("VertexColorTest", "VertexColorTest/VertexColorTest.glb", 1),
              ("TextureTransformTest", "TextureTransformTest/TextureTransformTest.gltf", 1),
              ("NormalTangentTest", "NormalTangentTest/NormalTangentTest.glb", 1),
              ("DamagedHelmet", "DamagedHelmet/DamagedHelmet.glb", 1),
              ("CesiumMan@20", "CesiumMan/CesiumMan.glb", 20),
              ("RiggedFigure@20", "RiggedFigure/RiggedFigure.glb", 20),
              ("AnimatedMorphCube@20", "AnimatedMorphCube/AnimatedMorphCube.gltf", 20),
              ("InterpolationTest@20", "InterpolationTest/InterpolationTest.glb", 20),
              ("LightsPunctualLamp", "LightsPunctualLamp/LightsPunctualLamp.gltf", 1),
              ("TransmissionTest", "TransmissionTest/TransmissionTest.glb", 1),
              ("AnisotropyStrengthTest",
               "AnisotropyStrengthTest/AnisotropyStrengthTest.glb", 1),
              ("IridescenceSuzanne", "IridescenceSuzanne/IridescenceSuzanne.glb", 1))
          for label, edits, more in (("", [], {}), (",Lambert", FLAT, {}))]
MODELS += [row(name + ",nodes", "%s/%s.glb" % (name, name), ["camera"] + edits,
               SINGLE, whole=True, match=True)
           for name, edits in (("GlassVaseFlowers", FLAT), ("TransmissionRoughnessTest", FLAT))]


def main():
    folder, azulejo, size, spp, depth, sky, data, pattern = sys.argv[1:9]
    width, height = (int(x) for x in size.split("x"))
    here = os.path.dirname(os.path.abspath(__file__))
    white = os.path.join(folder, "white.hdr")
    with open(white, "wb") as out:
        out.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + b"\x80\x80\x80\x81" * 128)
    chosen = []
    for models, item in [(False, r) for r in FEATURES] + [(True, r) for r in MODELS]:
        if not any(fnmatch.fnmatch(item["name"], p) for p in pattern.split()) or \
                (models and "-" in (data, sky)):
            continue
        source = os.path.join(data, "gltf", item["scene"]) if models else \
            os.path.join(here, "../../scenes/features", item["scene"] + ".gltf")
        place = os.path.join(folder, item["name"])
        os.makedirs(place, exist_ok=True)
        light = os.path.abspath(sky) if models else white if item["furnace"] else "-"
        item.update(environment=light, width=width, height=height,
                    spp=int(spp), depth=int(depth), stage=STAGE, ours=[])
        subprocess.run([sys.executable, "-B", os.path.join(here, "gltf_edit.py"), source,
                        place + "/scene.gltf"] + item["edits"], check=True)
        item["scene"] = place + "/scene.gltf"
        for seed in (0, 1):
            out = "%s/azulejo%d.exr" % (place, seed)
            subprocess.run([azulejo, "render", item["scene"], "-o", out, "--size", size, "--spp", spp,
                            "--max-depth", depth, "--seed", str(seed), "--quiet",
                            "--frames", str(item["frame"])] + item["options"] +
                           (["--env", light] if light != "-" else []), check=True)
            item["ours"].append(out)
        chosen.append(item)
        print("azulejo: %s" % item["name"], file=sys.stderr, flush=True)
    with open(os.path.join(folder, "rows.json"), "w") as out:
        json.dump(chosen, out)


main()
