"""Which of Azulejo's output variables (docs/AOV.md) become which of Blender's passes. No bpy in here."""
import numpy

from .exr import BadFile

FAR = 1e10  # what Cycles writes as the depth of nothing


class Pass:
    """`flag`: the property of a view layer that asks for it; `aov`: for --aov; `make`: its values from a Picture."""

    def __init__(self, name, flag, aov, letters, kind, make):
        self.name, self.flag, self.aov, self.letters, self.kind, self.make = name, flag, aov, letters, kind, make


def blender_axes(vectors):
    """glTF has +Y up, Blender +Z: (x, y, z) becomes (x, -z, y)."""
    return numpy.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], axis=-1)


def _depth(picture):
    z = picture.layer("Z")
    return numpy.where(z > 0, z, numpy.float32(FAR))


def _position(picture):
    place = picture.layer("P.X", "P.Y", "P.Z")
    hit = numpy.any(picture.layer("N.X", "N.Y", "N.Z") != 0, axis=2, keepdims=True) if "N.X" in picture.channels else True
    place = (place + numpy.asarray(picture.origin())).astype(numpy.float32)
    return blender_axes(numpy.where(hit, place, numpy.float32(0)))


def _uv(picture):
    uv = picture.layer("uv.U", "uv.V")
    return numpy.stack([uv[..., 0], 1 - uv[..., 1], numpy.ones_like(uv[..., 0])], axis=2)


PASSES = (
    Pass("Depth", "use_pass_z", "depth", "Z", "VALUE", _depth),
    Pass("Normal", "use_pass_normal", "normal", "XYZ", "VECTOR",
         lambda p: blender_axes(p.layer("N.X", "N.Y", "N.Z"))),
    Pass("Position", "use_pass_position", "position,normal", "XYZ", "VECTOR", _position),
    Pass("UV", "use_pass_uv", "uv", "UVA", "VECTOR", _uv),
    Pass("Denoising Albedo", "azulejo_albedo", "albedo", "RGB", "COLOR",
         lambda p: p.layer("albedo.R", "albedo.G", "albedo.B")),
    Pass("Denoising Normal", "azulejo_denoising_normal", "normal", "XYZ", "VECTOR",
         lambda p: blender_axes(p.layer("N.X", "N.Y", "N.Z"))),
    Pass("Azulejo Error", "azulejo_error", "error", "RGB", "COLOR",
         lambda p: p.layer("error.R", "error.G", "error.B")),
    Pass("Azulejo Samples", "azulejo_samples", "samples", "X", "VALUE", lambda p: p.layer("samples.Y")),
    Pass("Azulejo Object", "azulejo_object", "object-id", "X", "VALUE", lambda p: p.layer("objectId.X")),
    Pass("Azulejo Material", "azulejo_material", "material-id", "X", "VALUE", lambda p: p.layer("materialId.X")),
)


def wanted(has):
    """The passes whose flag `has(flag)` says yes to."""
    return [p for p in PASSES if has(p.flag)]


def aovs(passes):
    """The words for --aov."""
    words = []
    for p in passes:
        words += [word for word in p.aov.split(",") if word not in words]
    return words


def combined(picture, gain=1.0):
    """R, G, B and A; without a channel A all is opaque."""
    color = picture.layer("R", "G", "B")
    if color is None:
        raise BadFile("the picture has no channels R, G and B")
    alpha = picture.layer("A")
    alpha = numpy.ones(color.shape[:2] + (1,), dtype=numpy.float32) if alpha is None else alpha
    return numpy.concatenate([color * numpy.float32(gain), alpha], axis=2)


def blender_rows(values):
    """Blender's rows begin at the bottom; one flat array of float32."""
    return numpy.ascontiguousarray(values[::-1], dtype=numpy.float32).ravel()
