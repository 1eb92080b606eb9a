"""Small pbrt scenes at the limits of float: `write(folder)` returns {name: path}."""
import os

HEAD = """LookAt {eye} {at} 0 1 0
Camera "perspective" "float fov" {fov}
Film "rgb" "integer xresolution" 64 "integer yresolution" 48 "string filename" "out.exr"
Sampler "zsobol" "integer pixelsamples" 16
Integrator "volpath" "integer maxdepth" 12
{media}WorldBegin
"""
SKY = 'LightSource "infinite" "rgb L" [0.6 0.7 1]\n'
SUN = 'LightSource "distant" "point3 from" [3 4 2] "point3 to" [0 0 0] "rgb L" [3 2.8 2.5]\n'


def numbers(values):
    return " ".join("%.9g" % v for v in values)


def scene(eye, at, fov, *parts, media=""):
    return HEAD.format(eye=numbers(eye), at=numbers(at), fov=fov, media=media) + "".join(parts)


def part(material, *shapes, before=""):
    return "AttributeBegin\n%s  Material %s\n  %s\nAttributeEnd\n" % (before, material, "\n  ".join(shapes))


def box(low, high, inward=False):
    x, y, z = zip(low, high)
    points = [(x[i & 1], y[i >> 1 & 1], z[i >> 2]) for i in range(8)]
    faces = [0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5]
    if inward:
        faces = faces[::-1]
    return mesh([c for p in points for c in p], faces)


def mesh(points, faces):
    return 'Shape "trianglemesh" "point3 P" [%s] "integer indices" [%s]' % (numbers(points), " ".join(map(str, faces)))


def square(y, half, at=(0, 0)):
    x, z = at
    return mesh([x - half, y, z - half, x - half, y, z + half, x + half, y, z + half, x + half, y, z - half], [0, 1, 2, 0, 2, 3])


def ball(centre, radius):
    return 'Translate %s Shape "sphere" "float radius" %.9g' % (numbers(centre), radius)


def lamp(centre, half, radiance):
    x, y, z = centre
    corners = [x - half, y, z - half, x + half, y, z - half, x + half, y, z + half, x - half, y, z + half]
    return part(WHITE, mesh(corners, [0, 1, 2, 0, 2, 3]),
                before='  AreaLightSource "diffuse" "rgb L" [%s]\n' % numbers(radiance))


WHITE = '"diffuse" "rgb reflectance" [0.7 0.7 0.7]'
RED = '"diffuse" "rgb reflectance" [0.7 0.2 0.1]'
GLASS = '"dielectric" "float eta" 1.5'


def conductor(roughness):
    return '"conductor" "rgb reflectance" [0.9 0.8 0.6] "float roughness" %g' % roughness


def stage(s):
    """A ball of glass and a red one on a floor beneath a lamp, s metres wide."""
    return scene((0, 2 * s, 5 * s), (0, 0.8 * s, 0), 40, SKY, lamp((0, 4 * s, 0), 0.7 * s, (8, 8, 7)),
                 part(WHITE, square(0, 6 * s)), part(GLASS, ball((-0.9 * s, s, 0), 0.8 * s)),
                 part(RED, ball((0.9 * s, 0.8 * s, 0), 0.8 * s)))


def room(x):
    """A room of 4 m, lit from within, and a box as far on the other side of the scene's middle."""
    return scene((x, 1.5, 1.9), (x, 1.2, -2), 70, part(WHITE, box((x - 2, 0, -2), (x + 2, 3, 2), True)),
                 part(RED, box((x - 1, 0, -1), (x, 1, 0))), part(GLASS, ball((x + 0.8, 0.6, -0.5), 0.5)),
                 lamp((x, 2.95, 0), 0.4, (10, 10, 9)), part(WHITE, box((-x - 1, 0, -1), (-x + 1, 2, 1))))


def furnace(x):
    """A room whose walls all shine, far from the scene's middle: hardly any noise, so a ray that is lost shows."""
    return scene((x, 1.5, 1.9), (x, 1.2, -2), 70,
                 part(WHITE, box((x - 2, 0, -2), (x + 2, 3, 2), True), before='  AreaLightSource "diffuse" "rgb L" [0.3 0.3 0.3]\n'),
                 part(WHITE, box((x - 1, 0, -1), (x, 1, 0))), part(WHITE, box((-x - 1, 0, -1), (-x + 1, 2, 1))))


def needle(length):
    """A wedge of glass with edges of two degrees, seen through its flat sides and along its edge."""
    h = length * 0.0175
    points = [-length, 0.3, -0.5, -length, 0.3, 0.5, length, 0.3 + h, -0.5, length, 0.3 - h, -0.5, length, 0.3 + h, 0.5, length, 0.3 - h, 0.5]
    faces = [0, 3, 2, 1, 4, 5, 0, 2, 4, 0, 4, 1, 0, 1, 5, 0, 5, 3, 2, 3, 5, 2, 5, 4]
    return scene((-1.6, 0.45, 2.2), (0, 0.3, 0), 40, SKY, SUN, part(WHITE, square(0, 4)), part(GLASS, mesh(points, faces)))


def dense(coefficient):
    return scene((0, 1, 4), (0, 0.8, 0), 40, SKY, SUN, part(WHITE, square(0, 5)),
                 'AttributeBegin\nMediumInterface "m" ""\nMaterial "interface"\n%s\nAttributeEnd\n' % ball((0, 1, 0), 0.9),
                 media='MakeNamedMedium "m" "string type" "homogeneous" "rgb sigma_a" [%g %g %g] "rgb sigma_s" [%g %g %g]\n'
                 % (*[coefficient * 1e-3] * 3, *[coefficient] * 3))


def far_balls(distance):
    fov = 400 / distance
    return scene((0, 0, 0), (0, 0, -distance), fov, SKY, SUN, part(RED, ball((-1.2, 0, -distance), 1)),
                 part(GLASS, ball((1.2, 0, -distance), 1)), part(WHITE, ball((0, 0, -distance - 40), 6)))


SCENES = {
    "stage-1e-6": stage(1e-6), "stage-1e-3": stage(1e-3), "stage-1e6": stage(1e6),
    "room-1km": room(1e3), "room-10km": room(1e4), "room-100km": room(1e5),
    "furnace-1km": furnace(1e3), "furnace-10km": furnace(1e4), "furnace-100km": furnace(1e5),
    "ground-1000km": scene((0.05, 0.04, 0.08), (0, 0.008, 0), 40, SKY, SUN, part(WHITE, square(0, 1e6)),
                           part(RED, box((-0.01, 0, -0.01), (0.01, 0.02, 0.01)))),
    "thin-walls": scene((0, 1.2, 1.8), (0, 1, 0), 70, SKY, SUN, part(WHITE, box((-2, 0, -2), (2, 3, 2), True)),
                        part(WHITE, box((-2.001, -0.001, -2.001), (2.001, 3.001, 2.001))), lamp((0, 2.9, 0), 0.3, (6, 6, 6))),
    "needle-1m": needle(1), "needle-100m": needle(100),
    "dense-1e2": dense(1e2), "dense-1e5": dense(1e5), "dense-1e8": dense(1e8),
    "far-balls-1km": far_balls(1e3), "far-balls-100km": far_balls(1e5),
    "grazing": scene((0, 0.002, 1), (0, 0.0015, 0), 30, SKY, lamp((0, 1, -2), 0.5, (9, 9, 9)), part(conductor(0.03), square(0, 50)),
                     part(RED, ball((0.1, 0.1, -0.5), 0.1))),
    "grazing-glass": scene((0, 0.002, 1), (0, 0.0015, 0), 30, SKY, SUN, part(GLASS, square(0, 50)), part(WHITE, square(-1, 50))),
    "near-mirrors": scene((0, 1, 4), (0, 0.8, 0), 45, SKY, lamp((0, 3, 0), 0.3, (30, 30, 30)), part(WHITE, square(0, 5)),
                          *[part(conductor(r), ball((1.3 * i - 1.95, 0.6, 0), 0.6)) for i, r in enumerate((0, 1e-5, 1e-3, 3e-2))]),
    "touching-glass": scene((0, 1.2, 3), (0, 0.5, 0), 40, SKY, SUN, part(WHITE, square(-0.01, 5)),
                            part(GLASS, box((-1, 0, -1), (0, 1, 1))), part(GLASS, box((0, 0, -1), (1, 1, 1)))),
    "lamp-at-1mm": scene((0, 0.02, 0.05), (0, 0, 0), 40, part(WHITE, square(0, 1)), lamp((0, 0.001, 0), 0.0002, (1e4, 1e4, 1e4)),
                         part(RED, ball((0.012, 0.006, -0.01), 0.006))),
}


def write(folder):
    paths = {}
    for name, text in SCENES.items():
        paths[name] = os.path.join(folder, name + ".pbrt")
        with open(paths[name], "w", encoding="utf-8") as file:
            file.write(text)
    return paths
