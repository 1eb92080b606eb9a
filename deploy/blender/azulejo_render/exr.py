"""Reads the OpenEXR files that Azulejo writes: one part, scan lines, uncompressed or ZIP, half or float.

No bpy in here. Needs numpy, which Blender has (and its glTF exporter needs)."""
import struct
import zlib

import numpy

KINDS = {1: "<f2", 2: "<f4"}
LINES = {0: 1, 2: 1, 3: 16}  # of a chunk: uncompressed, ZIPS, ZIP
PIXELS_MOST = 1 << 28


class BadFile(Exception):
    """The file is not what Azulejo writes; the text says in what."""


class Picture:
    """channels: name -> array [height][width] of float32, the first row on top; attributes: name -> bytes."""

    def __init__(self, width, height, channels, attributes):
        self.width, self.height, self.channels, self.attributes = width, height, channels, attributes

    def layer(self, *names):
        """The named channels as [height][width][n], or None if one is missing."""
        if any(name not in self.channels for name in names):
            return None
        return numpy.stack([self.channels[name] for name in names], axis=2)

    def origin(self):
        """What positions are relative to (docs/AOV.md)."""
        value = self.attributes.get("azulejo:origin", b"")
        return struct.unpack("<3d", value) if len(value) == 24 else (0.0, 0.0, 0.0)


def _text(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode("utf-8", "replace"), end + 1


def _header(data):
    attributes, at = {}, 8
    while data[at]:
        name, at = _text(data, at)
        _, at = _text(data, at)
        size, = struct.unpack_from("<I", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def _channels(chlist):
    kinds, at = {}, 0
    while chlist[at]:
        name, at = _text(chlist, at)
        kind, = struct.unpack_from("<i", chlist, at)
        if kind not in KINDS:
            raise BadFile("channel %s is neither half nor float" % name)
        kinds[name] = numpy.dtype(KINDS[kind])
        at += 16
    return kinds


def _unpack(data):
    """ZIP's second half: differences of bytes, of which first the even ones come, then the odd."""
    raw = numpy.frombuffer(zlib.decompress(data), dtype=numpy.uint8).astype(numpy.int64)
    raw[1:] -= 128
    summed = (numpy.cumsum(raw) & 255).astype(numpy.uint8)
    out = numpy.empty_like(summed)
    half = (len(summed) + 1) // 2
    out[0::2], out[1::2] = summed[:half], summed[half:]
    return out.tobytes()


def _read(data):
    if data[:4] != b"\x76\x2f\x31\x01" or struct.unpack_from("<I", data, 4)[0] & ~0x400 != 2:
        raise BadFile("no scan line EXR")
    attributes, at = _header(data)
    kinds = _channels(attributes["channels"])
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height, compression = x1 - x0 + 1, y1 - y0 + 1, attributes["compression"][0]
    if compression not in LINES:
        raise BadFile("compression %d" % compression)
    if not (0 < width and 0 < height and width * height <= PIXELS_MOST):
        raise BadFile("a size of %dx%d" % (width, height))
    lines = LINES[compression]
    line_bytes = sum(width * kind.itemsize for kind in kinds.values())
    channels = {name: numpy.empty((height, width), dtype=numpy.float32) for name in kinds}
    for number, offset in enumerate(struct.unpack_from("<%dQ" % -(-height // lines), data, at)):
        y, size = struct.unpack_from("<iI", data, offset)
        rows = min(lines, height - number * lines)
        packed = data[offset + 8:offset + 8 + size]
        if size < rows * line_bytes:
            packed = _unpack(packed)
        if y - y0 != number * lines or len(packed) != rows * line_bytes:
            raise BadFile("chunk %d is damaged" % number)
        block = numpy.frombuffer(packed, dtype=numpy.uint8).reshape(rows, line_bytes)
        begin = 0
        for name, kind in kinds.items():
            end = begin + width * kind.itemsize
            channels[name][y - y0:y - y0 + rows] = numpy.ascontiguousarray(block[:, begin:end]).view(kind)
            begin = end
    return Picture(width, height, channels, attributes)


def read(path):
    with open(path, "rb") as source:
        data = source.read()
    try:
        return _read(data)
    except (BadFile, struct.error, zlib.error, KeyError, IndexError, ValueError) as problem:
        raise BadFile("%s: cannot be read: %s" % (path, problem)) from problem
