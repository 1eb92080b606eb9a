"""The pixels of an OpenEXR file, read without any code of Azulejo's: scan lines, uncompressed or
with ZIP, channels of half or float. Enough to check that two files hold the same bits."""
import itertools
import json
import math
import struct
import zlib

PIXEL_BYTES = {1: 2, 2: 4}  # half, float
LINES = {0: 1, 2: 1, 3: 16}  # of a chunk: uncompressed, ZIPS, ZIP


class Picture:
    """channels: name -> the bytes of its samples, row by row from the top; attributes: name -> the
    bytes of its value in the header."""

    def __init__(self, width, height, kinds, channels, attributes):
        self.width, self.height, self.kinds, self.channels = width, height, kinds, channels
        self.attributes = attributes
        self.reproducible = None  # all of the file but what was measured

    def measured(self):
        """What another farm would tell otherwise."""
        return json.loads(self.attributes["azulejo:measured"].decode())

    def number(self, name):
        """An attribute of type double."""
        return struct.unpack("<d", self.attributes[name])[0]

    def bits(self):
        return (self.width, self.height, tuple(sorted(self.kinds.items())),
                tuple(sorted(self.channels.items())))

    def values(self, name):
        """The samples as numbers."""
        kind = {1: "e", 2: "f"}[self.kinds[name]]
        data = self.channels[name]
        return struct.unpack("<%d%s" % (len(data) // PIXEL_BYTES[self.kinds[name]], kind), data)

    def check(self):
        """Every sample is finite, none is negative; returns the mean of all of them."""
        total, count = 0.0, 0
        for name in self.channels:
            values = self.values(name)
            light = sum(values)  # not finite if one of them is not
            if not math.isfinite(light) or min(values) < 0:
                raise ValueError("a sample of %s is not finite or negative" % name)
            total += light
            count += len(values)
        return total / count

    def black_tiles(self, size=16):
        """How many tiles have no light at all."""
        rows = {n: self.values(n) for n in self.channels}
        black = 0
        for y in range(0, self.height, size):
            for x in range(0, self.width, size):
                black += not any(
                    any(v[r * self.width + x:r * self.width + min(x + size, self.width)])
                    for v in rows.values() for r in range(y, min(y + size, self.height)))
        return black


def text_at(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode("ascii"), end + 1


def unpredict(data):
    """ZIP's second half: differences of bytes, of which first the even ones come, then the odd."""
    summed = bytes(itertools.accumulate(data, lambda a, b: (a + b - 128) & 255))
    out = bytearray(len(data))
    half = (len(data) + 1) // 2
    out[0::2] = summed[:half]
    out[1::2] = summed[half:]
    return bytes(out)


def read_exr(path):
    with open(path, "rb") as source:
        data = source.read()
    if data[:4] != b"\x76\x2f\x31\x01" or struct.unpack_from("<I", data, 4)[0] & ~0x400 != 2:
        raise ValueError(path + ": no scan line EXR")
    at, attributes, reproducible = 8, {}, [data[:8]]
    while data[at]:
        begin = at
        name, at = text_at(data, at)
        _, at = text_at(data, at)
        size, = struct.unpack_from("<I", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
        if name != "azulejo:measured":
            reproducible.append(data[begin:at])
    at += 1
    kinds, where, chlist = {}, 0, attributes["channels"]
    while chlist[where]:
        name, where = text_at(chlist, where)
        kinds[name], = struct.unpack_from("<i", chlist, where)
        where += 16
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    compression = attributes["compression"][0]
    lines = LINES[compression]
    chunks = (height + lines - 1) // lines
    offsets = struct.unpack_from("<%dQ" % chunks, data, at)
    reproducible += [repr([o - offsets[0] for o in offsets]).encode(), data[offsets[0]:]]
    channels = {name: bytearray() for name in kinds}
    row_bytes = {name: width * PIXEL_BYTES[kind] for name, kind in kinds.items()}
    for number, offset in enumerate(offsets):
        y, size = struct.unpack_from("<iI", data, offset)
        if y != y0 + number * lines:
            raise ValueError(path + ": chunks out of order")
        rows = min(lines, height - number * lines)
        packed = data[offset + 8:offset + 8 + size]
        if size < rows * sum(row_bytes.values()):
            packed = unpredict(zlib.decompress(packed))
        if len(packed) != rows * sum(row_bytes.values()):
            raise ValueError("%s: chunk %d has %d bytes" % (path, number, len(packed)))
        used = 0
        for _ in range(rows):
            for name in kinds:  # a line holds its channels in the order of the header
                channels[name] += packed[used:used + row_bytes[name]]
                used += row_bytes[name]
    picture = Picture(width, height, kinds, {n: bytes(c) for n, c in channels.items()}, attributes)
    picture.reproducible = b"".join(reproducible)
    return picture
