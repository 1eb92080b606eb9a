"""Peers that break the rules: odd_peer (beside this file, in C) with the farm's key, and bare sockets."""
import os
import select
import socket
import threading
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


class Proxy:
    """Between a client and the farm's coordinator; cuts one connection, passes the others on.

    Connection number `which` (from 1) is cut when the coordinator's answer number `answer` to it
    has come: that one is not passed on. `cut` tells whether it came to that."""

    def __init__(self, farm, which=0, answer=0):
        self.target = farm.address.rsplit(":", 1)
        self.which, self.answer, self.cut, self.count = which, answer, False, 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.listener.shutdown(socket.SHUT_RDWR)  # close alone does not wake accept
        self.listener.close()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            self.count += 1
            threading.Thread(target=self.carry, args=(client, self.count), daemon=True).start()

    def carry(self, client, number):
        answers = 0
        try:
            with client, socket.create_connection((self.target[0], int(self.target[1]))) as farm:
                while True:
                    for end in select.select([client, farm], [], [])[0]:
                        data = end.recv(65536)
                        answers += end is farm
                        if number == self.which and answers == self.answer and end is farm:
                            self.cut = True
                            return
                        if not data:
                            return
                        (farm if end is client else client).sendall(data)
        except OSError:
            pass
