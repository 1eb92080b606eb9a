"""The pictures of docs/GALLERY.md: what is rendered, and what is said about it."""
import math
import os

from gallery_scene import ROOT, Setting, place

KHR = "KHR_materials_"
CC0, BY3, BY4 = ("[CC0](https://creativecommons.org/publicdomain/zero/1.0/)",
                 "[CC BY 3.0](https://creativecommons.org/licenses/by/3.0/)",
                 "[CC BY 4.0](https://creativecommons.org/licenses/by/4.0/)")
KHRONOS = "Khronos glTF Sample Assets"
OWN = "Own scene, Apache-2.0."


def haven(name, first="map"):
    return "%s: %s, Poly Haven, %s" % (first, name, CC0)


# ---- settings: each returns what writes a glTF file; data is the data folder, folder where it is written -----

def helmet(data, folder):
    s = Setting(os.path.join(data, "gltf/FlightHelmet/FlightHelmet.gltf"), folder)
    s.disc(1.3, s.surface((0.035, 0.022, 0.015), 0.22))
    s.lamp((1.5, 1.0, 1.2), (0, 0.5, 0), 0.9, 1.1, 16, (1, 0.92, 0.82))
    s.lamp((-1.6, 1.2, -0.6), (0, 0.5, 0), 0.5, 1.2, 14, (1, 0.85, 0.7))
    s.camera((-0.58, 0.57, 1.09), (0.125, 0.487, 0.09), 24.5, 16 / 9)
    return s


def chair(data, folder):
    s = Setting(os.path.join(data, "gltf/SheenChair/SheenChair.gltf"), folder)
    s.sweep(s.surface((0.20, 0.25, 0.27)), 9, 3, -1.6, 3.5)
    s.lamp((-2.2, 2.0, 1.4), (0, 0.4, 0), 1.4, 1.4, 9, (1, 0.95, 0.88))
    s.lamp((2.4, 1.6, -0.9), (0, 0.4, 0), 0.7, 1.6, 9, (0.85, 0.93, 1))
    s.lamp((0.5, 3.4, 1.0), (0, 0.2, -0.3), 2.5, 2.0, 1.2)
    s.camera((-0.95, 0.85, 2.0), (0.0, 0.335, 0), 25)
    return s


def vase(data, folder):
    s = Setting(os.path.join(data, "gltf/GlassVaseFlowers/GlassVaseFlowers.glb"), folder)
    for node in s.gltf["nodes"][:2]:  # the flowers in the vase that only pretends to be glass
        node.pop("mesh")
    s.disc(0.9, s.surface((0.62, 0.57, 0.50), 0.6))
    s.camera((-0.10, 0.17, 0.55), (0.09, 0.107, 0), 22)
    return s


def shaderballs(data, folder):
    s = Setting(None, folder)
    ball = os.path.join(data, "gltf/shaderball/threejs-shaderball.glb")
    gold = s.surface((1.0, 0.71, 0.29), 0.12, 1.0)
    brushed = s.surface((0.78, 0.79, 0.80), 0.38, 1.0,
                        **{KHR + "anisotropy": {"anisotropyStrength": 0.85}})
    copper = s.surface((0.93, 0.50, 0.36), 0.4, 1.0)
    for x, turn, material in ((-2.35, 35, brushed), (0, 20, gold), (2.35, 5, copper)):
        s.put(ball, place(x, 0, -0.35 * abs(x), turn), material)
    s.sweep(s.surface((0.022, 0.024, 0.03), 0.25), 40, 12, -7, 14)
    s.lamp((-5, 5, 4), (0, 1, 0), 2.5, 4.5, 14)
    s.lamp((5.5, 4, 1), (0, 1, 0), 1.2, 5, 14, (1.0, 0.86, 0.7))
    s.lamp((0, 7, -2), (0, 0.5, 0), 7, 1.2, 8, (0.8, 0.9, 1.0))
    s.camera((0, 3.0, 12.5), (0, 0.90, -0.3), 20)
    return s


def crystal(data, folder):
    s = Setting(None, folder)
    glass = s.surface((1, 1, 1), 0.0, 0.0, **{
        KHR + "transmission": {"transmissionFactor": 1.0}, KHR + "ior": {"ior": 1.6},
        KHR + "volume": {"thicknessFactor": 1.0}, KHR + "dispersion": {"dispersion": 1.5}})
    s.node(mesh=s.ball(1.0, glass, 96), translation=[0, 1, 0])
    s.disc(3.2, s.surface((0.06, 0.045, 0.035), 0.4))
    s.camera((0, 1.55, 5.6), (0.45, 0.98, 0), 26)
    return s


def monkeys(data, folder):
    s = Setting(os.path.join(data, "gltf/IridescenceSuzanne/IridescenceSuzanne.glb"), folder)
    s.gltf["nodes"][3].pop("extensions")  # the point light
    for number, turn in enumerate((24, 0, -24)):
        t = math.radians(turn) / 2
        s.gltf["nodes"][number]["rotation"] = [0, math.sin(t), 0, math.cos(t)]
    s.disc(9, s.surface((0.05, 0.04, 0.035), 0.4), y=-0.97)
    s.camera((0, 1.4, 13), (0, -0.05, 0), 18, 2.0)
    return s


def balls(data, folder):
    s = Setting(os.path.join(data, "gltf/MetalRoughSpheresNoTextures/MetalRoughSpheresNoTextures.glb"), folder)
    s.camera((-0.0018, 0.0068, -0.0082), (0.0021, 0.0043, -0.003), 27)
    return s


def drive(data, folder, follow):
    """The toy car goes along its own axis over its cloth; the camera goes with it, or stands."""
    s = Setting(os.path.join(data, "gltf/ToyCar/ToyCar.gltf"), folder)
    if follow:
        camera = s.camera((-0.052, 0.018, 0.046), (0.001, 0.0065, 0.001), 24)
        s.move([0, 2, camera], (0, 0, 0.05), 1 / 24)
    else:
        s.camera((-0.085, 0.028, 0.062), (0.0, 0.004, 0.0), 20, 2.0)
        s.move([0, 2], (0, 0, 0.03), 1.0)
    return s


def bulbs(data, folder):
    """A tree of lamps: a spiral of bulbs around a cone, on a wet floor."""
    s = Setting(None, folder)
    colours = ((1, 0.30, 0.10), (1, 0.70, 0.22), (0.22, 0.60, 1), (0.9, 0.22, 0.6), (0.28, 0.9, 0.5))
    meshes = [s.ball(0.04, s.material(
        pbrMetallicRoughness={"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0.0}, emissiveFactor=c,
        extensions={KHR + "emissive_strength": {"emissiveStrength": 2.6}}), 6) for c in colours]
    count = 180
    for i in range(count):
        t = math.sqrt((i + 0.5) / count)
        a = i * math.pi * (3 - math.sqrt(5))
        s.node(mesh=meshes[i % len(meshes)], translation=[0.95 * t * math.cos(a), 2.3 * (1 - t) + 0.06, 0.95 * t * math.sin(a)])
    inside = s.surface((0.55, 0.6, 0.55), 0.9)
    ring = [[0.86 * math.cos(i * math.pi / 24), 0.0, 0.86 * math.sin(i * math.pi / 24)] for i in range(48)]
    points, normals, triangles = [], [], []
    for i, p in enumerate(ring):
        points += [p, [0, 2.15, 0]]
        normals += [[p[0] * 1.07, 0.37, p[2] * 1.07]] * 2
        triangles.append([2 * i, 2 * i + 1, 2 * ((i + 1) % 48)])
    s.mesh(points, normals, triangles, inside)
    chrome = s.ball(0.30, s.surface((0.95, 0.95, 0.95), 0.04, 1.0))
    for x, z, size in ((-1.25, 0.7, 1.0), (1.2, 0.95, 0.75), (0.55, 1.45, 0.5), (-0.75, 1.55, 0.4)):
        s.node(mesh=chrome, translation=[x, 0.3 * size, z], scale=[size] * 3)
    s.disc(12, s.surface((0.03, 0.035, 0.045), 0.16))
    s.camera((0, 1.25, 6.4), (0, 0.93, 0), 25)
    return s


def drinks(data, folder):
    """Wine, and ice in water, before a shining wall: glass is drawn by its dark edges."""
    s = Setting(None, folder)
    s.put(os.path.join(ROOT, "scenes/liquids/ice.gltf"), place(-0.55, 0, 0.25, 20), only=3)
    s.put(os.path.join(ROOT, "scenes/liquids/wine.gltf"), place(0.55, 0, -0.05), only=2)
    s.disc(14, s.surface((0.045, 0.05, 0.06), 0.18))
    s.lamp((0, 1.6, -4.5), (0, 1.6, 0), 9.5, 4.2, 1.1, (0.80, 0.90, 1.0))
    s.lamp((-4.5, 2.5, 2.0), (0, 0.6, 0), 1.2, 3.5, 6, (1, 0.93, 0.85))
    s.lamp((3.5, 4.5, 2.5), (0, 0.6, 0), 2, 2, 4)
    s.camera((0.15, 1.15, 5.6), (0, 0.70, 0), 18)
    return s


def dish(data, folder):
    s = Setting(os.path.join(data, "gltf/IridescentDishWithOlives/IridescentDishWithOlives.gltf"), folder)
    s.disc(0.75, s.surface((0.09, 0.055, 0.035), 0.35))
    s.camera((0.62, 0.36, 0.52), (0.0, 0.085, 0.0), 27)
    return s


def spheres(data, folder):
    s = Setting(os.path.join(ROOT, "scenes/studio/textured-spheres.gltf"), folder)
    s.roots.remove(1)  # its lamp
    s.camera((0.7, 1.0, 5.2), (0.0, 0.52, 0), 22)
    return s


class Text:
    """A scene in pbrt's words."""

    ending, options = ".pbrt", []

    def __init__(self, text):
        self.text = text

    def write(self, path):
        with open(path, "w") as out:
            out.write(self.text)


def lanterns(data, folder):
    """A road between lanterns, in fog."""
    words = ["""MakeNamedMedium "fog" "string type" "homogeneous" "rgb sigma_a" [0.004 0.004 0.004] "rgb sigma_s" [0.055 0.06 0.07] "float g" 0.3
MediumInterface "" "fog"
LookAt 0 1.7 9  0 1.75 0  0 1 0
Camera "perspective" "float fov" 30
Film "rgb" "integer xresolution" 720 "integer yresolution" 480 "string filename" "out.exr"
Integrator "volpath" "integer maxdepth" 10
WorldBegin
AttributeBegin
  Material "coateddiffuse" "rgb reflectance" [0.04 0.04 0.045] "float roughness" 0.08
  Shape "trianglemesh" "point3 P" [-60 0 60  60 0 60  60 0 -60  -60 0 -60] "integer indices" [0 1 2  0 2 3]
AttributeEnd
"""]
    for row in range(7):
        for side in (-1, 1):
            x, z, light = 2.3 * side, 2.5 - 4.2 * row, ("[26 15 6]", "[9 15 26]")[side > 0]
            words.append("""AttributeBegin
  Translate %g 0 %g
  AttributeBegin
    Material "diffuse" "rgb reflectance" [0.03 0.03 0.03]
    Shape "trianglemesh" "point3 P" [-.05 0 .05  .05 0 .05  .05 2.6 .05  -.05 2.6 .05  -.05 0 -.05  .05 0 -.05  .05 2.6 -.05  -.05 2.6 -.05]
      "integer indices" [0 1 2 0 2 3  1 5 6 1 6 2  5 4 7 5 7 6  4 0 3 4 3 7]
  AttributeEnd
  Translate 0 2.9 0
  AreaLightSource "diffuse" "rgb L" %s
  Shape "sphere" "float radius" 0.26
AttributeEnd
""" % (x, z, light))
    return Text("".join(words))


class Picture:
    """One picture of the gallery.

    scene: a function above, or a path; "@" stands for the data folder. options: those of `azulejo render`.
    error: the display error to reach; limit: core-minutes at most. tonemap: options of `azulejo tonemap`.
    kind: picture, strip (frames side by side), layers (the picture and its output variables), or operators (a sheet of the
    film of another picture, `of`). before: commands that make what it needs, each with its file at the end. largest: kilobytes.
    """

    def __init__(self, name, title, words, alt, credit, scene=None, options="", size="600x400", error="5/255",
                 limit=0.8, tonemap="", kind="picture", of=None, largest=150, file=None, before=()):
        self.name, self.title, self.words, self.alt, self.credit = name, title, words, alt, credit
        self.scene, self.options, self.size, self.error, self.limit = scene, options, size, error, limit
        self.tonemap, self.kind, self.of, self.largest, self.before = tonemap, kind, of, largest, before
        self.file = file or "gallery/%s.jpg" % name


PICTURES = [
    Picture("helmet", "A flight helmet in a garden",
            "Leather, rubber and glass by daylight; the garden is a map, out of focus behind a lens of 28 mm aperture.",
            "A leather flight helmet with goggles and oxygen mask on a wooden stand, a blurred garden behind it",
            "Model: Gary Hsu, Microsoft (%s), %s; %s." % (KHRONOS, CC0, haven("Chinese Garden")),
            helmet, "--env @/hdri/chinese_garden_1k.hdr --env-rotate 345 --lens 0.014 --focus 1.13",
            "1600x900", "2/255", 25, "--tonemap agx --exposure 0.5", largest=400, file="hero.jpg"),
    Picture("toycar", "A toy car on a cloth", "Clear coat over paint, sheen on cloth, windows that let light pass.",
            "A green toy car with flames on a red cloth",
            "Model: Guido Odendahl (%s), %s; %s." % (KHRONOS, CC0, haven("Vestibule")),
            "@/gltf/ToyCar/ToyCar.gltf", "--env @/hdri/vestibule_1k.hdr --camera 1", "720x480", "4/255", 3),
    Picture("field", "Mirrors in a wheat field", "The Cornell box with blocks of mirror, in a landscape that a program of this repository "
            "makes: rows of wheat, hills, clouds and a sun.", "A Cornell box with two mirror blocks that stands in a wheat field under clouds",
            OWN, "scenes/cornell/cornell-field.gltf", "--env out/gallery/field.exr", "600x400", "4/255", 2, "--exposure 0.4",
            before=("build/release/bin/scenes/sky/make_sky --field --sun-elevation 47 --sun-azimuth 335 "
                    "--size 3072x1536 -o out/gallery/field.exr",)),
    Picture("olives", "Olives under an iridescent lid", "The lid is glass with a film of a few hundred nanometres.",
            "A dish of olives under a shimmering glass lid",
            "Model: Wayfair, LLC (%s), %s; %s." % (KHRONOS, BY4, haven("Vestibule")),
            dish, "--env @/hdri/vestibule_1k.hdr --env-rotate 200 --max-depth 24 --lens 0.006 --focus 0.8 --clamp 20", limit=6,
            tonemap="--tonemap agx --exposure 0.5"),
    Picture("vase", "Flowers in a glass vase", "A thick glass, refracted through both of its walls; the leaves "
            "are cut out by alpha.", "Pink flowers in a thick glass vase on a pale table",
            "Model: Eric Chadwick and Rico Cilliers (%s), %s; %s." % (KHRONOS, CC0, haven("Vestibule")),
            vase, "--env @/hdri/vestibule_1k.hdr --env-rotate 60 --lens 0.006 --focus 0.56 --max-depth 24", "720x480", "4/255", 3,
            tonemap="--tonemap agx --exposure 0.4"),
    Picture("drinks", "Water and wine", "Liquids touch their glass, and the border between them has the index "
            "of both ([LIQUIDS.md](LIQUIDS.md)).", "A tumbler of water with ice and a glass of red wine before a bright wall", OWN,
            drinks, "--max-depth 24", limit=1.3, tonemap="--tonemap agx --exposure 0.9"),
    Picture("crystal", "A crystal ball", "The index of its glass depends on the wavelength: the garden in it stands on its "
            "head, and its edges have colours.", "A crystal ball in a garden that is seen in it upside down, with coloured edges",
            OWN + " " + haven("Chinese Garden", "Map") + ".", crystal,
            "--env @/hdri/chinese_garden_1k.hdr --env-rotate 200 --lens 0.05 --focus 4.6 --max-depth 24 --clamp 8",
            tonemap="--tonemap agx --exposure 1.2", limit=5),
    Picture("chair", "A velvet chair", "Sheen makes the rim of cloth bright; the light is two softboxes and a "
            "ceiling.", "An armchair of orange velvet before a grey paper backdrop",
            "Model: Wayfair, LLC (%s), %s." % (KHRONOS, CC0), chair, "", "720x480", "4/255", 3,
            tonemap="--tonemap agx --exposure 0.6"),
    Picture("shaderballs", "Steel, gold, copper", "Brushed steel stretches its highlights; rough metals lose no "
            "energy, because light that is reflected twice between their facets is counted.",
            "Three material balls of brushed steel, polished gold and satin copper in a dark studio",
            "Model: three.js, MIT.", shaderballs, limit=6, tonemap="--tonemap agx --exposure 0.6"),
    Picture("bulbs", "A tree of lamps", "Each point chooses among the lamps by what they do there.",
            "A cone of small coloured lamps on a dark floor, mirrored in chrome balls", OWN + " " + haven("Dikhololo Night", "Map") + ".", bulbs,
            "--env @/hdri/pmndrs_night.hdr", tonemap="--tonemap pbr-neutral", limit=1.3),
    Picture("monkeys", "Thin films", "The same film over a pale body, over metal, and on glass. `--clamp` holds single bright samples down.",
            "Three monkey heads with rings of rainbow colour: pale, metal and glass",
            "Model: UX3D (%s), %s; %s." % (KHRONOS, CC0, haven("Chinese Garden")), monkeys, "--env @/hdri/chinese_garden_1k.hdr --env-rotate 250 --max-depth 24 --lens 0.12 --focus 12.5 --clamp 8",
            "640x320", limit=4, tonemap="--tonemap agx --exposure 0.4"),
    Picture("balls", "From mirror to chalk, near to far", "A million triangles and a lens that is sharp at one "
            "column only.", "Rows of balls from mirror to matt, sharp in the middle and blurred at both ends",
            "Model: %s, %s; %s." % (KHRONOS, CC0, haven("Vestibule")), balls,
            "--env @/hdri/vestibule_1k.hdr --lens 0.0003 --focus 0.0062", limit=1.3),
    Picture("coffee", "A coffee maker", "Coated plastic, steel and thin glass under three softboxes.",
            "An orange coffee maker with a glass pot on a shining floor",
            "Scene: “Coffee Maker” by cekuhnen, %s, from Benedikt Bitterli's [rendering resources]"
            "(https://benedikt-bitterli.me/resources/)." % BY3,
            "@/pbrt/bitterli-coffee/scene-v4.pbrt", size="400x500", limit=1.3),
    Picture("staircase", "A hall with a staircase", "Light goes from wall to wall, and the tiles mirror the "
            "window.", "A bright hall with a wooden staircase",
            "Scene: “Modern Hall” by NewSee2l035, %s, from Benedikt Bitterli's [rendering resources]"
            "(https://benedikt-bitterli.me/resources/)." % BY3,
            "@/pbrt/bitterli-staircase2/scene-v4.pbrt", size="440x440", limit=5),
    Picture("fog", "A road in fog", "Light is scattered on its way: each lantern has a halo, and distance swallows them.",
            "Two rows of lanterns, warm and cold, that fade into fog", OWN, lanterns,
            tonemap="--tonemap agx --exposure 1.2", limit=4),
    Picture("sun", "Hard sunlight", "Two thirds of this map's light come from a thousandth of its texels; a table "
            "of the map finds them.", "Balls in hard sunlight", OWN + " " + haven("Kloppenheim 05", "Map") + ".",
            spheres, "--env @/hdri/kloppenheim_05_1k.hdr --env-rotate 30", limit=1.3,
            tonemap="--tonemap agx --exposure 0.5"),
    Picture("motion", "Going along with it", "The camera drives beside the car: the cloth runs by while "
            "the shutter is open.", "A toy car in sharp focus on a cloth that is blurred by motion",
            "Model: Guido Odendahl (%s), %s; %s." % (KHRONOS, CC0, haven("Vestibule")),
            lambda data, folder: drive(data, folder, True),
            "--env @/hdri/vestibule_1k.hdr --frames 0 --shutter 0.5"),
    Picture("strip", "Six frames of an animation", "The toy car drives by, with the shutter open for half of "
            "each frame.", "Six frames in which a toy car drives along a cloth",
            "Model: Guido Odendahl (%s), %s; %s." % (KHRONOS, CC0, haven("Vestibule")),
            lambda data, folder: drive(data, folder, False),
            "--env @/hdri/vestibule_1k.hdr --frames 0-20x4 --shutter 0.5", "440x220", "6/255", 0.7,
            kind="strip", largest=200, file="strip.jpg"),
    Picture("layers", "What else a film holds", "The picture, and its layers: albedo, normals, depth, how many samples each tile got, and "
            "the error of each pixel ([AOV.md](AOV.md)).", "A toy car six times: as a picture, its albedo, normals, depth, samples and error",
            "Model: Guido Odendahl (%s), %s; %s." % (KHRONOS, CC0, haven("Vestibule")),
            "@/gltf/ToyCar/ToyCar.gltf", "--env @/hdri/vestibule_1k.hdr --camera 1 --aov albedo,normal,depth,samples,error",
            "420x280", "8/255", 1, kind="layers"),
    Picture("operators", "The same film by nine operators", "Rendered once, developed nine times ([TONEMAPPING.md](TONEMAPPING.md)).",
            "The flight helmet eight times, tone mapped by nine operators",
            "Model: Gary Hsu, Microsoft (%s), %s; %s." % (KHRONOS, CC0, haven("Chinese Garden")),
            options="--exposure 0.5 --sweep operator=reinhard02,drago03,mantiuk08,mantiuk06,aces,aces-hill,agx,pbr-neutral,hable "
            "--tile-width 400", kind="operators", of="helmet"),
]
