"""What one worker and its coordinator send each other for a picture.

    bench_wire.py [--size WxH] [--spp N] [--tree FOLDER]

Renders the Cornell box through a relay that counts, and prints bytes of the stream (TLS and all) a pixel
in either direction. --tree: the programs of another checkout, which is built.
"""
import argparse
import os
import socket
import sys
import threading

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.normpath(os.path.join(HERE, "..", ".."))


class Relay:
    """Accepts one connection at a time to the address, and counts what passes."""

    def __init__(self, address):
        host, port = address.rsplit(":", 1)
        self.target = (host, int(port))
        self.up = self.down = 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            worker, _ = self.listener.accept()
            coordinator = socket.create_connection(self.target)
            for source, sink, name in ((worker, coordinator, "up"), (coordinator, worker, "down")):
                threading.Thread(target=self.pass_on, args=(source, sink, name), daemon=True).start()

    def pass_on(self, source, sink, name):
        try:
            while True:
                data = source.recv(1 << 16)
                if not data:
                    break
                setattr(self, name, getattr(self, name) + len(data))
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--tree", default=ROOT)
    options = parser.parse_args()
    os.environ["BUILD"] = os.path.join(options.tree, "build", "release")
    sys.path.insert(0, os.path.join(ROOT, "tests", "farm"))
    from farm import Farm
    width, height = map(int, options.size.split("x"))
    with Farm() as farm:
        farm.start_coordinator()
        real, relay = farm.address, Relay(farm.address)
        farm.address = relay.address
        farm.start_worker()
        farm.address = real
        farm.wait_for_workers(1)
        number = farm.submit(os.path.join(ROOT, "scenes", "cornell", "cornell-area.gltf"), "--size",
                             options.size, "--spp", str(options.spp))
        farm.wait_for_job(number, limit_s=600)
        pixels = width * height
        print('{"size": "%s", "spp": %d, "to_coordinator_bytes_a_pixel": %.1f, '
              '"to_worker_bytes_a_pixel": %.1f}' % (options.size, options.spp, relay.up / pixels,
                                                    relay.down / pixels))


main()
