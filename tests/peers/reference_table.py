"""Tell how far Azulejo's pictures are from a reference picture. Runs inside Blender, which reads
every EXR: blender -b --factory-startup -P tests/peers/reference_table.py -- ROW...
A row: NAME,OURS0,OURS1,REFERENCE,REGION. REGION: `all`, or X0:Y0:X1:Y1 in shares of the picture
from its upper left corner.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy

import pictures

BLOCKS = 16  # across the picture


def region_of(shape, text):
    where = numpy.ones(shape[:2], bool)
    if text != "all":
        x0, y0, x1, y1 = (float(x) for x in text.split(":"))
        where[:] = False
        height, width = shape[:2]
        # The first row is the lowest.
        where[round((1 - y1) * height):round((1 - y0) * height),
              round(x0 * width):round(x1 * width)] = True
    return where


for row in sys.argv[sys.argv.index("--") + 1:]:
    name, first, second, reference, region = row.split(",")
    ours, theirs = [pictures.read(first), pictures.read(second)], pictures.read(reference)
    where = region_of(ours[0].shape, region)
    height, width = ours[0].shape[:2]
    if theirs.shape[0] % height == 0 and theirs.shape[1] % width == 0:
        # The same pixels' edges, or a region whose edge lies on something bright is another one.
        theirs = pictures.shrink(theirs, height, width)
    blocks = [pictures.shrink(p, height * BLOCKS // width, BLOCKS)
              for p in (sum(ours) / 2, theirs)]
    inside = region_of(blocks[0].shape, region)
    apart = "%.1e" % pictures.relative_mse(*(b[inside] for b in blocks)) if inside.any() else "-"
    print("row: %-34s %s  relative MSE %s" % (
        name, pictures.percents(*pictures.difference(
            ours, [theirs], where, region_of(theirs.shape, region))), apart), flush=True)
