"""Which of Azulejo's output variables (docs/AOV.md) become which of Blender's passes. No bpy in here."""
import numpy

from .exr import BadFile

FAR = 1e10  # what Cycles writes as the depth of nothing
DENOISED = "denoised"  # instead of a view layer's flag: wherever the picture is denoised
CRYPTO_LAYERS = 3  # of two levels each


class Pass:
    """`flag`: the property of a view layer that asks for it; `aov`: for --aov; `make`: its values from a Picture."""

    def __init__(self, name, flag, aov, letters, kind, make):
        self.name, self.flag, self.aov, self.letters, self.kind, self.make = name, flag, aov, letters, kind, make
        self.levels_before = 0  # of Cryptomatte


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


def _layer(name, letters):
    names = [name + "." + letter for letter in letters]
    return lambda picture: picture.layer(*names)


def _crypto(what, number):
    """Blender's compositor finds it by this name; small letters, as Cycles has them, are kept from lossy compression."""
    name = "Crypto%s%02d" % (what, number)
    made = Pass(name, "use_pass_cryptomatte_" + what.lower(), "crypto-" + what.lower(), "rgba", "COLOR", _layer(name, "RGBA"))
    made.levels_before = 2 * number
    return made


PASSES = (
    Pass("Depth", "use_pass_z", "depth", "Z", "VALUE", _depth),
    Pass("Normal", "use_pass_normal", "normal", "XYZ", "VECTOR",
         lambda p: blender_axes(p.layer("N.X", "N.Y", "N.Z"))),
    Pass("Position", "use_pass_position", "position,normal", "XYZ", "VECTOR", _position),
    Pass("UV", "use_pass_uv", "uv", "UVA", "VECTOR", _uv),
    Pass("Noisy Image", DENOISED, "", "RGBA", "COLOR", lambda p: with_alpha(p, "R", "G", "B")),
    Pass("Denoising Albedo", "azulejo_denoising", "denoising-albedo", "RGB", "COLOR", _layer("Denoising Albedo", "RGB")),
    Pass("Denoising Normal", "azulejo_denoising", "denoising-normal", "XYZ", "VECTOR",
         lambda p: blender_axes(p.layer("Denoising Normal.X", "Denoising Normal.Y", "Denoising Normal.Z"))),
    Pass("Denoising Depth", "azulejo_denoising", "denoising", "Z", "VALUE", _layer("Denoising Depth", "Z")),
    *(_crypto(what, number) for what in ("Object", "Material", "Asset") for number in range(CRYPTO_LAYERS)),
    Pass("Azulejo Error", "azulejo_error", "error", "RGB", "COLOR", _layer("error", "RGB")),
    Pass("Azulejo Samples", "azulejo_samples", "samples", "X", "VALUE", lambda p: p.layer("samples.Y")),
    Pass("Azulejo Object", "azulejo_object", "object-id", "X", "VALUE", lambda p: p.layer("objectId.X")),
    Pass("Azulejo Material", "azulejo_material", "material-id", "X", "VALUE", lambda p: p.layer("materialId.X")),
)


def wanted(has, levels=2 * CRYPTO_LAYERS):
    """The passes whose flag `has(flag)` says yes to; of Cryptomatte as many as `levels` need."""
    return [p for p in PASSES if has(p.flag) and p.levels_before < levels]


def aovs(passes):
    """The words for --aov."""
    words = []
    for p in passes:
        words += [word for word in p.aov.split(",") if word and word not in words]
    return words


def expose(picture, gain):
    """Blender's film exposure."""
    for name, values in picture.channels.items():
        if name in ("R", "G", "B") or name.startswith((DENOISED + ".", "error.")):
            values *= numpy.float32(gain)


def with_alpha(picture, *names):
    """The channels and A; without a channel A all is opaque. None if there are no such channels."""
    color, alpha = picture.layer(*names), picture.layer("A")
    if color is None:
        return None
    alpha = numpy.ones(color.shape[:2] + (1,), dtype=numpy.float32) if alpha is None else alpha
    return numpy.concatenate([color, alpha], axis=2)


def is_denoised(picture):
    return DENOISED + ".R" in picture.channels


def combined(picture):
    """The picture without its noise, if it has been denoised, else as it is: R, G, B and A."""
    names = [DENOISED + "." + letter for letter in "RGB"] if is_denoised(picture) else ["R", "G", "B"]
    color = with_alpha(picture, *names)
    if color is None:
        raise BadFile("the picture has no channels R, G and B")
    return color


def murmur3(text):
    """MurmurHash3_32 of Cryptomatte 1.2, seed 0."""
    data, most = text.encode("utf-8"), 0xffffffff
    hashed = 0

    def mixed(word):
        word = word * 0xcc9e2d51 & most
        return ((word << 15 | word >> 17) & most) * 0x1b873593 & most
    whole = len(data) // 4 * 4
    for at in range(0, whole, 4):
        hashed ^= mixed(int.from_bytes(data[at:at + 4], "little"))
        hashed = ((hashed << 13 | hashed >> 19) & most) * 5 + 0xe6546b64 & most
    if whole < len(data):
        hashed ^= mixed(int.from_bytes(data[whole:], "little"))
    hashed ^= len(data)
    for shift, factor in ((16, 0x85ebca6b), (13, 0xc2b2ae35), (16, 1)):
        hashed = (hashed ^ hashed >> shift) * factor & most
    return hashed


def crypto_fields(picture, layer):
    """Cryptomatte's names and manifests, as (field, text), for a file in which Blender's `layer` holds the passes."""
    fields = []
    for name, value in picture.attributes.items():
        if name.startswith("cryptomatte/") and name.endswith("/name"):
            old, kind = name[:-len("name")], layer + "." + value.decode("utf-8", "replace")
            new = "cryptomatte/%s/" % ("%08x" % murmur3(kind))[:7]
            fields.append((new + "name", kind))
            fields += [(new + part, picture.attributes[old + part].decode("utf-8", "replace"))
                       for part in ("hash", "conversion", "manifest") if old + part in picture.attributes]
    return fields


def blender_rows(values):
    """Blender's rows begin at the bottom; one flat array of float32."""
    return numpy.ascontiguousarray(values[::-1], dtype=numpy.float32).ravel()
