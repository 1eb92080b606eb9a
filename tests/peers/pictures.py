"""Pictures as arrays, and what two renderers' pictures differ by. Runs inside Blender, which reads
every EXR."""
import numpy

numpy.bool = bool  # removed in numpy 1.24; Blender 3.4's glTF importer still asks for it

import bpy


def read(path):
    """height x width x 4 floats, as they are in the file; the first row is the lowest."""
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Raw"
    width, height = image.size
    pixels = numpy.empty(width * height * 4, numpy.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4).astype(numpy.float64)


def shrink(picture, height, width):
    """By averaging; the picture is a whole multiple as large."""
    rows, columns = picture.shape[0] // height, picture.shape[1] // width
    return picture.reshape(height, rows, width, columns, -1).mean(axis=(1, 3))


def mean_and_error(pictures, where):
    """Mean per channel, and its standard error. Two independent pictures of one pixel differ by
    noise alone, and pixels do not depend on each other. Of one picture alone only a bound is known:
    pixels side by side differ by noise, and by what is to be seen."""
    where = where.astype(float)
    if where.ndim == 2:
        where = where[..., None]
    if len(pictures) == 2:
        first, second = (p[..., :3] for p in pictures)
        mean, noise = (first + second) / 2, (first - second) / 2
    else:
        mean = pictures[0][..., :3]
        noise = (mean - numpy.roll(mean, 1, axis=1)) / numpy.sqrt(2)
    count = where.sum()
    return ((where * mean).sum(axis=(0, 1)) / count,
            numpy.sqrt((where * noise ** 2).sum(axis=(0, 1))) / count)


def difference(ours, theirs, where, where_theirs=None):
    """Relative difference of the means per channel, and its standard error."""
    a, a_error = mean_and_error(ours, where)
    b, b_error = mean_and_error(theirs, where if where_theirs is None else where_theirs)
    ratio = a / b
    return ratio - 1, ratio * numpy.sqrt((a_error / a) ** 2 + (b_error / b) ** 2)


def percents(values, errors):
    return " ".join("%+7.2f" % (100 * v) for v in values) + "  +- %.2f" % (100 * max(errors))


def relative_mse(ours, theirs):
    """pbrt's; the noise of both is in it."""
    a, b = ours[..., :3], theirs[..., :3]
    return float(((a - b) ** 2 / (b ** 2 + 0.01)).mean())
