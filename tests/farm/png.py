"""The pixels of an RGB or RGBA PNG, read without any code of Azulejo's: 8 or 16 bits, not interlaced."""
import itertools
import struct
import zlib


class Png:
    """codes: rows of numbers, `channels` (3, or 4 with alpha) for each pixel."""

    def __init__(self, data):
        if data[:8] != b"\x89PNG\r\n\x1a\n":
            raise ValueError("no PNG")
        at, packed = 8, b""
        while at < len(data):
            size, kind = struct.unpack_from(">I4s", data, at)
            body = data[at + 8:at + 8 + size]
            if struct.unpack_from(">I", data, at + 8 + size)[0] != zlib.crc32(kind + body):
                raise ValueError("a chunk's checksum is wrong")
            if kind == b"IHDR":
                self.width, self.height, self.bits, color, _, _, interlace = struct.unpack(
                    ">IIBBBBB", body)
                if color not in (2, 6) or interlace or self.bits not in (8, 16):
                    raise ValueError("not a plain RGB or RGBA PNG")
                self.channels = 4 if color == 6 else 3
            elif kind == b"IDAT":
                packed += body
            at += 12 + size
        self.codes = self.rows(zlib.decompress(packed))

    def rows(self, raw):
        step = self.channels * self.bits // 8
        line = self.width * step
        before, rows = bytes(line), []
        for y in range(self.height):
            kind = raw[y * (line + 1)]
            now = bytearray(raw[y * (line + 1) + 1:(y + 1) * (line + 1)])
            if kind == 1:
                for c in range(step):
                    now[c::step] = bytes(v & 255 for v in itertools.accumulate(now[c::step]))
            elif kind == 2:
                now = bytearray((v + up) & 255 for v, up in zip(now, before))
            elif kind:
                for i, up in enumerate(before):
                    left, corner = (now[i - step], before[i - step]) if i >= step else (0, 0)
                    if kind == 3:
                        now[i] = now[i] + (left + up) // 2 & 255
                        continue
                    to_left, to_up, to_corner = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
                    now[i] = now[i] + (left if to_left <= to_up and to_left <= to_corner else
                                       up if to_up <= to_corner else corner) & 255
            rows.append(struct.unpack(">%d%s" % (line * 8 // self.bits,
                                                 "B" if self.bits == 8 else "H"), now))
            before = bytes(now)
        return rows

    def part(self, x, y, width, height):
        return [row[3 * x:3 * (x + width)] for row in self.codes[y:y + height]]
