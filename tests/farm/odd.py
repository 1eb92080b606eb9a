"""Peers that break the rules: odd_peer (beside this file, in C) with the farm's key, and bare sockets."""
import os
import select
import socket
import time

from farm import BUILD, PATIENCE, Failure, Program

ODD_PEER = os.path.join(BUILD, "tests", "farm", "odd_peer")


class OddPeer(Program):
    """A connection that says what the test tells it to; see odd_peer.c for the commands."""

    def __init__(self, farm, role="worker", hello=""):
        """Connects; with hello not None it says Hello (with these changes) and awaits the Welcome."""
        host, port = farm.address.rsplit(":", 1)
        number = len(farm.programs)
        super().__init__("odd peer %d" % number, [ODD_PEER, host, port, farm.key, role],
                         farm.path("odd-%d.log" % number), pipe_stdout=True, pipe_stdin=True)
        farm.programs.append(self)
        self.wait_line("open")
        if hello is not None:
            self.say("hello " + hello)
            self.wait_line("welcome")

    def say(self, line):
        try:
            self.process.stdin.write((line + "\n").encode("ascii"))
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # it ended before; what it printed tells why

    def grant(self, limit_s=30.0):
        """Wait for work; {"lease": .., "epoch": .., "job": .., "frame": .., "units": [(tile, pass)]}."""
        fields = dict(f.split("=") for f in self.wait_line("grant ", limit_s).split())
        units = [tuple(map(int, u.split(":"))) for u in fields.pop("units").split(",")]
        return dict({k: int(v) for k, v in fields.items()}, units=units)

    def end(self):
        """Say goodbye and be gone."""
        self.say("close")
        self.wait(20)


def talk_raw(farm, data, until_closed=True, limit_s=30.0):
    """Send bytes without TLS; what came back until the other side closed."""
    host, port = farm.address.rsplit(":", 1)
    heard = b""
    end = time.monotonic() + limit_s * PATIENCE
    with socket.create_connection((host, int(port)), limit_s * PATIENCE) as peer:
        try:
            peer.sendall(data)
            while until_closed:
                left = end - time.monotonic()
                if left <= 0 or not select.select([peer], [], [], left)[0]:
                    raise Failure("the coordinator did not close a connection that sent %r..." %
                                  data[:20])
                got = peer.recv(65536)
                if not got:
                    break
                heard += got
        except (ConnectionResetError, BrokenPipeError):
            pass
    return heard
