#!/usr/bin/env python3
"""Make the page's mark: mark.py AZULEJO OUT.svg

A glazed tile, blue on white, seen from above under a white sky: it is rendered at 16 x 16 pixels, and each pixel becomes
a square of the nearest of a few blues.
"""
import math
import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

SIZE = 16
BLUE = (0x1F, 0x5F, 0xA8)
STEPS = 3  # blues between white and BLUE, BLUE among them
WHITE_GLAZE, BLUE_GLAZE = (0.9, 0.9, 0.9), (0.02, 0.11, 0.36)


def ring(x, y, inner, outer, begin, end):
    """A part of a ring as triangles: points of both circles by turns."""
    steps = 48
    angles = [math.radians(begin + (end - begin) * i / steps) for i in range(steps + 1)]
    return [(x + r * math.cos(a), y + r * math.sin(a)) for a in angles for r in (inner, outer)]


def petal(angle, near, far, width):
    """A leaf from the middle outwards."""
    steps = 24
    points = []
    for i in range(steps + 1):
        along = near + (far - near) * i / steps
        half = width / 2 * math.sin(math.pi * i / steps)
        for side in (-half, half):
            points.append((along * math.cos(angle) - side * math.sin(angle), along * math.sin(angle) + side * math.cos(angle)))
    return points


def motif():
    half = SIZE / 2
    strips = [ring(0, 0, 0, 1.45, 0, 360)]
    strips += [petal(math.radians(45 + 90 * i), 1.9, 6.4, 3.1) for i in range(4)]
    strips += [petal(math.radians(90 * i), 5.0, 8.0, 2.3) for i in range(4)]
    for i, (x, y) in enumerate(((-half, -half), (half, -half), (half, half), (-half, half))):
        strips.append(ring(x, y, 3.9, 5.1, 90 * i, 90 * i + 90))
        strips.append(ring(x, y, 0, 2.1, 90 * i, 90 * i + 90))
    return strips


def mesh(strip, z):
    points = " ".join(f"{x:.5f} {y:.5f} {z}" for x, y in strip)
    indices = " ".join(f"{i} {i + 1} {i + 2}" for i in range(len(strip) - 2))
    return f'Shape "trianglemesh" "point3 P" [{points}] "integer indices" [{indices}]'


def glaze(colour):
    return 'Material "diffuse" "rgb reflectance" [{} {} {}]'.format(*colour)


def scene():
    lines = [f'Film "rgb" "integer xresolution" {SIZE} "integer yresolution" {SIZE} "string filename" "mark.exr"',
             "LookAt 0 0 20  0 0 0  0 1 0",
             f'Camera "orthographic" "float screenwindow" [{-SIZE / 2} {SIZE / 2} {-SIZE / 2} {SIZE / 2}]',
             "WorldBegin", 'LightSource "infinite" "rgb L" [1 1 1]',
             glaze(WHITE_GLAZE), mesh([(-20, -20), (20, -20), (-20, 20), (20, 20)], 0), glaze(BLUE_GLAZE)]
    lines += [mesh(strip, 0.001 * (i + 1)) for i, strip in enumerate(motif())]
    return "\n".join(lines) + "\n"


def png_rows(data):
    """The rows of a PNG with 8 bits a channel and three channels: lists of (r, g, b)."""
    at, packed, header = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBB", body[:10])
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    width, height, bits, colour = header
    if (bits, colour) != (8, 2):
        sys.exit(f"mark.py: the picture has {bits} bits and colour type {colour}; 8 and 2 were expected")
    raw, stride, before, rows = zlib.decompress(packed), 3 * width, bytes(3 * width), []
    for y in range(height):
        kind, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            a, b, c = (line[i - 3] if i >= 3 else 0), before[i], (before[i - 3] if i >= 3 else 0)
            paeth = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
            line[i] = (line[i] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255
        rows.append([tuple(line[i:i + 3]) for i in range(0, stride, 3)])
        before = bytes(line)
    return rows


def levels(rows):
    """How blue each pixel is, 0..STEPS: the red channel tells it best, in linear light."""
    linear = [[(pixel[0] / 255) ** 2.2 for pixel in row] for row in rows]
    darkest, lightest = min(map(min, linear)), max(map(max, linear))
    end = SIZE - 1

    def mean(x, y):  # of the places that the tile's symmetry makes equal: noise must not decide
        places = [(x, y), (y, x), (end - x, y), (y, end - x), (x, end - y), (end - y, x), (end - x, end - y), (end - y, end - x)]
        return sum(linear[v][u] for u, v in places) / len(places)

    return [[round(STEPS * (lightest - mean(x, y)) / (lightest - darkest)) for x in range(SIZE)] for y in range(SIZE)]


def svg(grid):
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}" shape-rendering="crispEdges">',
           f'<path fill="#fff" d="M0 0h{SIZE}v{SIZE}H0z"/>']
    for level in range(1, STEPS + 1):
        share = level / STEPS
        colour = "#" + "".join(f"{round(255 + (c - 255) * share):02x}" for c in BLUE)
        path = ""
        for y, row in enumerate(grid):
            x = 0
            while x < SIZE:
                run = 0
                while x + run < SIZE and row[x + run] == level:
                    run += 1
                if run:
                    path += f"M{x} {y}h{run}v1h-{run}z"
                x += max(run, 1)
        if path:
            out.append(f'<path fill="{colour}" d="{path}"/>')
    return "".join(out) + "</svg>\n"


def main(azulejo, out):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "mark.pbrt"
        path.write_text(scene())
        subprocess.run([azulejo, "render", str(path), "--size", f"{SIZE}x{SIZE}", "--spp", "1024", "--max-depth", "1", "--tonemap", "gamma",
                        "--no-dither", "--format", "png", "--quiet", "-o", str(path.with_suffix(".png"))], check=True)
        rows = png_rows(path.with_suffix(".png").read_bytes())
    pathlib.Path(out).write_text(svg(levels(rows)))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__.splitlines()[0])
    main(*sys.argv[1:])
