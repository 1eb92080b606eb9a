"""Write a glTF scene again, with only what every renderer understands in the same way.

    lambert_variant.py SCENE.gltf OUT.gltf [--filtered]

Dielectrics become pure Lambert reflectors, normal maps go, textures are looked up without
interpolation (unless --filtered). Materials that are metal or transmit light are kept. Buffers and
images are copied to OUT's folder, which must be another than the scene's.
"""
import json
import os
import shutil
import sys

paths = [a for a in sys.argv[1:] if a != "--filtered"]
if len(paths) != 2:
    sys.exit(__doc__)
with open(paths[0]) as source:
    gltf = json.load(source)
folder, target = (os.path.dirname(os.path.abspath(p)) for p in paths)
for thing in gltf.get("buffers", []) + gltf.get("images", []):
    uri = thing.get("uri", "data:")
    if not uri.startswith("data:") and not os.path.lexists(os.path.join(target, uri)):
        shutil.copyfile(os.path.join(folder, uri), os.path.join(target, uri))
changed = []
for material in gltf.get("materials", []):
    extensions = material.setdefault("extensions", {})
    metallic = material.get("pbrMetallicRoughness", {}).get("metallicFactor", 1)
    material.pop("normalTexture", None)
    if metallic == 0 and "KHR_materials_transmission" not in extensions:
        extensions["KHR_materials_specular"] = {"specularFactor": 0}
        changed.append(material.get("name", "?"))
used = gltf.setdefault("extensionsUsed", [])
if changed and "KHR_materials_specular" not in used:
    used.append("KHR_materials_specular")
if "--filtered" not in sys.argv:
    for sampler in gltf.setdefault("samplers", []):
        sampler.update(magFilter=9728, minFilter=9728)  # NEAREST
    gltf["samplers"].append({"magFilter": 9728, "minFilter": 9728})
    for texture in gltf.get("textures", []):
        texture.setdefault("sampler", len(gltf["samplers"]) - 1)
with open(paths[1], "w") as copy:
    json.dump(gltf, copy)
print("Lambert: " + ", ".join(changed))
