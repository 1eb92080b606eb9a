#!/usr/bin/env python3
"""Write the pool of docs/CAUSTICS.md, a pbrt file: water with ripples under a point light, or a square lamp of 16 cm.

    docs/images/make_pool.py pool.pbrt [lamp]
"""
import math
import sys

SIDE, HALF, LEVEL = 96, 2.0, 1.0
LAMP, SIZE, POWER = (0.8, 3.6, -0.6), 0.16, (14, 13, 11)
RIPPLES = ((0.035, 5.1, 1.3, 0), (0.025, -3.7, 6.2, 1), (0.015, 9.5, 8.1, 2), (0.012, -12, 7.3, 0))


def height(x, z):
    return sum(a * math.sin(p * x + q * z + phase) for a, p, q, phase in RIPPLES)


def normal(x, z):
    slope_x = sum(a * p * math.cos(p * x + q * z + phase) for a, p, q, phase in RIPPLES)
    slope_z = sum(a * q * math.cos(p * x + q * z + phase) for a, p, q, phase in RIPPLES)
    length = math.sqrt(1 + slope_x ** 2 + slope_z ** 2)
    return -slope_x / length, 1 / length, -slope_z / length


def water():
    places, normals, indices = [], [], []
    for j in range(SIDE + 1):
        for i in range(SIDE + 1):
            x, z = (2 * HALF * k / SIDE - HALF for k in (i, j))
            places.append((x, LEVEL + height(x, z), z))
            normals.append(normal(x, z))
    for j in range(SIDE):
        for i in range(SIDE):
            a = j * (SIDE + 1) + i
            c = a + SIDE + 1
            indices.append((a, c, a + 1))
            indices.append((a + 1, c, c + 1))
    return mesh(places, indices, normals)


def mesh(places, indices, normals=()):
    def listed(rows):
        return " ".join(f"{value:.6g}" for row in rows for value in row)
    return (f'Shape "trianglemesh" "point3 P" [{listed(places)}] "integer indices" [{listed(indices)}]'
            + (f' "normal N" [{listed(normals)}]' if normals else ""))


def quad(*corners):
    return mesh(corners, ((0, 1, 2), (0, 2, 3)))


def light(square):
    def listed(row):
        return " ".join(f"{value:.6g}" for value in row)
    x, y, z = LAMP
    r = SIZE / 2
    if not square:
        return [f'LightSource "point" "point3 from" [{listed(LAMP)}] "rgb I" [{listed(POWER)}]']
    return ["AttributeBegin", f'AreaLightSource "diffuse" "rgb L" [{listed(v / SIZE ** 2 for v in POWER)}]',
            quad((x - r, y, z - r), (x + r, y, z - r), (x + r, y, z + r), (x - r, y, z + r)), "AttributeEnd"]


def main():
    h, rim = HALF, 1.4
    walls = [((-h, -h), (h, -h)), ((-h, -h), (-h, h)), ((h, -h), (h, h)), ((-h, h), (h, h))]
    lines = ['LookAt 0 3.4 4.6  0 0.4 0  0 1 0', 'Camera "perspective" "float fov" [42]',
             'Film "rgb" "integer xresolution" [320] "integer yresolution" [180]',
             'Sampler "independent" "integer pixelsamples" [16]', "WorldBegin",
             *light(sys.argv[2:] == ["lamp"]), 'Material "diffuse" "rgb reflectance" [0.55 0.7 0.75]',
             quad((-h, 0, -h), (-h, 0, h), (h, 0, h), (h, 0, -h))]
    lines += [quad((a, 0, b), (c, 0, d), (c, rim, d), (a, rim, b)) for (a, b), (c, d) in walls]
    lines += ['Material "diffuse" "rgb reflectance" [0.6 0.5 0.4]',
              quad((-20, rim, -20), (-20, rim, -h), (20, rim, -h), (20, rim, -20)),
              'Material "dielectric" "float eta" [1.33]', water()]
    with open(sys.argv[1], "w", encoding="utf-8") as out:
        out.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
