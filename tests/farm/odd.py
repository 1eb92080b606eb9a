"""Peers that break the rules: odd_peer (beside this file, in C) with the farm's key, bare sockets, and
strangers on the coordinator's port."""
import os
import queue
import select
import socket
import threading
import time

from farm import BUILD, PATIENCE, Failure, Program, wait_for

ODD_PEER = os.path.join(BUILD, "tests", "farm", "odd_peer")


class OddPeer(Program):
    """A connection that says what the test tells it to; see odd_peer.c for the commands."""

    def __init__(self, farm, role="worker", hello="", key=None):
        """Connects; with hello not None it says Hello (with these changes) and awaits the Welcome."""
        host, port = farm.address.rsplit(":", 1)
        number = len(farm.programs)
        super().__init__("odd peer %d" % number, [ODD_PEER, host, port, key or farm.key, role],
                         farm.path("odd-%d.log" % number), pipe_stdout=True, pipe_stdin=True)
        farm.programs.append(self)
        self.wait_line("open")
        if hello is not None:
            self.say("hello " + hello)
            self.wait_line("welcome")

    @classmethod
    def coordinator(cls, farm, address="127.0.0.1:0", key=None):
        """One that listens at the address (farm.address from now on) and takes one connection."""
        self = cls.__new__(cls)
        number = len(farm.programs)
        Program.__init__(self, "odd coordinator %d" % number,
                         [ODD_PEER] + address.rsplit(":", 1) + [key or farm.key, "coordinator"],
                         farm.path("odd-%d.log" % number), pipe_stdout=True, pipe_stdin=True)
        farm.programs.append(self)
        farm.address = self.wait_line("listening on ")
        return self

    def say(self, line):
        try:
            self.process.stdin.write((line + "\n").encode("ascii"))
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # it ended before; what it printed tells why

    def grant(self, limit_s=30.0):
        """Wait for work; {"lease": .., "epoch": .., "job": .., "frame": .., "units": [(tile, group, pass)]}."""
        fields = dict(f.split("=") for f in self.wait_line("grant ", limit_s).split())
        units = [tuple(map(int, u.split(":"))) for u in fields.pop("units").split(",")]
        return dict({k: int(v) for k, v in fields.items()}, units=units)

    def end(self):
        """Say goodbye and be gone."""
        self.say("close")
        self.wait(20)


def die_of(farm, host):
    """A worker on that machine is lent work and dies; the job that it died of."""
    peer = OddPeer(farm, hello="threads=2 host=" + host)
    peer.say("request 2")
    job = peer.grant()["job"]
    peer.kill()
    wait_for(lambda: not any(w["process"] == peer.pid for w in farm.list_workers()), "its end")
    return job


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


class Strangers:
    """What a worker may find on its coordinator's port: each connection gets the next of `manners`,
    over and over. A manner is a function of the connected socket; it runs in a thread of its own."""

    def __init__(self, *manners):
        self.manners, self.met = manners, 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        self.threads = [threading.Thread(target=self.receive)]

    def __enter__(self):
        self.threads[0].start()
        return self

    def __exit__(self, *_):
        """The port is free again when every conversation has ended."""
        self.listener.shutdown(socket.SHUT_RDWR)
        for thread in self.threads:
            thread.join()
        self.listener.close()

    def receive(self):
        while True:
            try:
                peer, _ = self.listener.accept()
            except OSError:
                return
            thread = threading.Thread(target=self.meet,
                                      args=(self.manners[self.met % len(self.manners)], peer))
            self.threads.append(thread)
            thread.start()
            self.met += 1

    @staticmethod
    def meet(manner, peer):
        with peer:
            peer.settimeout(30 * PATIENCE)
            try:
                manner(peer)
            except OSError:
                pass  # the worker was first to go


def saying(data):
    """Answers the first bytes with these."""
    def manner(peer):
        peer.recv(65536)
        peer.sendall(data)
        peer.shutdown(socket.SHUT_WR)
        while peer.recv(65536):
            pass
    return manner


def alert(number):
    """Answers with a fatal TLS alert: seven plain bytes."""
    return saying(bytes([21, 3, 3, 0, 2, 2, number]))


def passing_on(address, damage_client_at=None, damage_server_at=None):
    """Passes everything on to and from another address; one bit of that byte is turned over."""
    def manner(peer):
        host, port = address.rsplit(":", 1)
        with socket.create_connection((host, int(port)), 30 * PATIENCE) as server:
            ways = {peer: [server, 0, damage_client_at], server: [peer, 0, damage_server_at]}
            while True:
                for source in select.select(list(ways), [], [], 30 * PATIENCE)[0]:
                    target, passed, damage_at = ways[source]
                    data = bytearray(source.recv(65536))
                    if not data:
                        return
                    if damage_at is not None and 0 <= damage_at - passed < len(data):
                        data[damage_at - passed] ^= 1
                    ways[source][1] += len(data)
                    target.sendall(data)
    return manner


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


class FarAway:
    """Between a worker and the farm's coordinator: what either sends arrives `delay_s` later."""

    def __init__(self, farm, delay_s):
        self.target, self.delay_s = farm.address.rsplit(":", 1), delay_s
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()

    def accept(self):
        while True:
            try:
                near, _ = self.listener.accept()
            except OSError:
                return
            far = socket.create_connection((self.target[0], int(self.target[1])))
            for source, to in ((near, far), (far, near)):
                to.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                waiting = queue.Queue()
                threading.Thread(target=self.read, args=(source, waiting), daemon=True).start()
                threading.Thread(target=self.write, args=(to, waiting), daemon=True).start()

    def read(self, source, waiting):
        data = b"-"
        while data:
            try:
                data = source.recv(1 << 20)
            except OSError:
                data = b""
            waiting.put((time.monotonic() + self.delay_s, data))

    @staticmethod
    def write(to, waiting):
        with to:
            while True:
                due, data = waiting.get()
                time.sleep(max(0, due - time.monotonic()))
                try:
                    if not data:
                        to.shutdown(socket.SHUT_WR)
                        return
                    to.sendall(data)
                except OSError:
                    return
