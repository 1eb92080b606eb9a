"""--tev: a stand-in for the viewer that takes every packet to pieces."""
import os
import socket
import struct
import sys
import threading

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Failure, Tests, wait_for

tests = Tests()


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


class Reader:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values if len(values) != 1 else values[0]

    def text(self):
        end = self.data.index(b"\0", self.at)
        text = self.data[self.at:end].decode()
        self.at = end + 1
        return text


class Viewer:
    """Accepts one connection after the other. leave: end the first one after so many packets."""

    def __init__(self, leave=None):
        self.leave, self.images, self.creates, self.updates, self.wrong = leave, {}, 0, 0, None
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.connections = 0
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        while True:
            try:
                peer, _ = self.listener.accept()
            except OSError:
                return
            self.connections += 1
            try:
                with peer:
                    self.packets(peer, self.leave if self.connections == 1 else None)
            except (ValueError, struct.error, KeyError, AssertionError, UnicodeDecodeError) as error:
                self.wrong = repr(error)
                return

    def packets(self, peer, most):
        stream, count = peer.makefile("rb"), 0
        while most is None or count < most:
            head = stream.read(4)
            if not head:
                return
            length, = struct.unpack("<I", head)
            assert 6 <= length < 1 << 24, length
            body = stream.read(length - 4)
            if len(body) != length - 4:
                return  # the client ended in the middle, after a failure of its own
            self.packet(Reader(body))
            count += 1

    def packet(self, r):
        kind, focus, name = r.take("b"), r.take("?"), r.text()
        assert focus is False
        if kind == 4:
            width, height, n = r.take("iii")
            channels = [r.text() for _ in range(n)]
            assert channels in (["R", "G", "B"], ["R", "G", "B", "A"]), channels
            self.images[name] = (width, height, channels, [None] * (width * height * n))
            self.creates += 1
        else:
            assert kind == 6, kind
            width, height, channels, pixels = self.images[name]
            n = r.take("i")
            assert [r.text() for _ in range(n)] == channels
            x, y, w, h = r.take("iiii")
            assert 0 <= x and 0 <= y and w > 0 and h > 0 and x + w <= width and y + h <= height
            offsets, strides = r.take("%dq" % n), r.take("%dq" % n)
            size = max(o + (w * h - 1) * s + 1 for o, s in zip(offsets, strides))
            values = r.take("%df" % size)
            for row in range(h):
                for column in range(w):
                    for c in range(n):
                        pixels[((y + row) * width + x + column) * n + c] = values[offsets[c] + (row * w + column) * strides[c]]
            self.updates += 1
        assert r.at == len(r.data), "bytes after the packet"

    def end(self):
        self.listener.close()
        if self.wrong:
            raise Failure("a packet is wrong: " + self.wrong)

    def shows(self, name, path):
        """Has the image the pixels of the file?"""
        picture = read_exr(path)
        width, height, channels, pixels = self.images[name]
        expect((width, height) == (picture.width, picture.height), (width, height))
        for c, channel in enumerate(channels):
            got = struct.pack("<%df" % (width * height), *pixels[c::len(channels)])
            expect(got == picture.channels[channel], "%s of %s differs" % (channel, name))


def shown(viewer, name, path):
    """The client has ended, so all is sent; the thread may have some to read."""

    def look():
        if viewer.wrong:
            raise Failure("a packet is wrong: " + viewer.wrong)
        try:
            viewer.shows(name, path)
        except (Failure, KeyError, struct.error, TypeError):
            return False
        return True
    wait_for(look, "the finished picture of " + name)


@tests.add
def render_shows_pictures():
    """render --tev: what the viewer has at the end are the EXR's pixels, of each frame, with alpha"""
    with Farm() as farm:
        scene, viewer = farm.scene(), Viewer()
        name = os.path.splitext(os.path.basename(scene))[0]
        farm.cli("render", scene, "--size", "150x40", "--spp", "4", "--alpha", "-o", farm.path("one"), "--tev",
                 "127.0.0.1:%d" % viewer.port, expect=0, connect=False)
        shown(viewer, name, farm.path("one.exr"))
        expect(viewer.creates == 1, viewer.creates)
        viewer.end()


@tests.add
def watch_survives_the_viewer():
    """watch --tev: a viewer that goes away and comes back gets the whole picture again; none is no failure"""
    with Farm() as farm:
        farm.start_coordinator()
        viewer = Viewer(leave=1)
        number = farm.submit(farm.scene(), "--size", "64x64", "--spp", "64", "--name", "shot")
        farm.start_worker()
        farm.cli("watch", number, "--tev", "127.0.0.1:%d" % viewer.port, expect=0)
        farm.cli("fetch", number, "-o", farm.path("got.exr"), expect=0)
        farm.cli("watch", number, "--tev", "127.0.0.1:%d" % viewer.port, expect=0)
        shown(viewer, "shot", farm.path("got.exr"))
        viewer.end()
        with socket.socket() as deaf:  # it has the port and does not listen
            deaf.bind(("127.0.0.1", 0))
            result = farm.cli("watch", number, "--tev", "127.0.0.1:%d" % deaf.getsockname()[1], expect=0)
        expect("no viewer at 127.0.0.1" in result.err, result)
        result = farm.cli("watch", number, "--tev", "host:99999")
        expect(result.code == 2 and "99999" in result.err, result)


if __name__ == "__main__":
    tests.run()
