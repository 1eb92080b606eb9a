"""Strangers at the coordinator's port: many sockets without a key, in one thread beside the test."""
import os
import resource
import select
import socket
import struct
import threading
import time

from farm import BUILD, Failure, Program, Skip, wait_for

CROWD = os.path.join(BUILD, "tests", "farm", "crowd")


def need_descriptors(count):
    """Let this process have so many; Skip where it may not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < count:
        raise Skip("the hard limit of file descriptors is %d, below %d" % (hard, count))
    if soft < count:
        resource.setrlimit(resource.RLIMIT_NOFILE, (count, hard))


def descriptors_of(program):
    return len(os.listdir("/proc/%d/fd" % program.pid))


def resident_bytes(program):
    with open("/proc/%d/statm" % program.pid) as source:
        return int(source.read().split()[1]) * os.sysconf("SC_PAGESIZE")


class Workers(Program):
    """So many workers of one process that connect at once; see crowd.c."""

    def __init__(self, farm, count, key=None):
        host, port = farm.address.rsplit(":", 1)
        super().__init__("crowd", [CROWD, "workers", host, port, key or farm.key, str(count)],
                         farm.path("crowd-%d.log" % len(farm.programs)), pipe_stdout=True,
                         pipe_stdin=True)
        farm.programs.append(self)

    def settled(self, limit_s=120.0):
        """(welcomed, failed), once each has its answer."""
        words = self.wait_line("welcomed ", limit_s).split()
        return int(words[0]), int(words[2])

    def end(self):
        self.process.stdin.close()
        self.wait(60)


def first_record(farm):
    """What a worker of this farm sends first; whoever has recorded it can send it again."""
    host, port = farm.address.rsplit(":", 1)
    tool = Program("crowd record", [CROWD, "record", host, port, farm.key], farm.path("record.log"),
                   pipe_stdout=True)
    farm.programs.append(tool)
    return bytes.fromhex(tool.wait_line("record "))


class Strangers(threading.Thread):
    """COUNT connections from an address, kept up until the `with` block ends.

    Each sends `first` when it is connected; one that the coordinator closes is replaced. With
    trickle, each sends `first` a byte a second; with reset_s, it is reset after so many seconds and
    replaced, however it fares."""

    def __init__(self, farm, count, source="127.0.0.1", first=b"", trickle=False, reset_s=None,
                 again=True):
        super().__init__(daemon=True)
        host, port = farm.address.rsplit(":", 1)
        self.peer, self.count, self.source = (host, int(port)), count, source
        self.first, self.trickle, self.reset_s, self.again = first, trickle, reset_s, again
        self.open = {}         # descriptor: (socket, opened at)
        self.sent = {}         # of a trickling one: bytes so far
        self.connected = set()
        self.answered = set()  # that heard something of the coordinator
        self.closed = 0
        self.over = False
        self.fault = None
        self.poll = select.epoll()

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.over = True
        self.join()
        for peer, _at in list(self.open.values()):
            peer.close()
        self.poll.close()

    def all_connected(self, limit_s=60.0):
        wait_for(lambda: self.fault or len(self.connected) >= self.count,
                 "%d strangers to be connected" % self.count, limit_s)
        if self.fault:
            raise Failure("strangers: %s" % self.fault)

    def run(self):
        try:
            while not self.over:
                self.turn()
        except Exception as fault:  # pylint: disable=broad-except
            self.fault = fault

    def turn(self):
        made = 0
        while len(self.open) < self.count and made < 200 and (self.again or self.closed == 0):
            peer = socket.socket()
            peer.setblocking(False)
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            if self.source != "127.0.0.1":
                peer.bind((self.source, 0))
            peer.connect_ex(self.peer)
            self.poll.register(peer, select.EPOLLOUT)
            self.open[peer.fileno()] = (peer, time.monotonic())
            made += 1
        for number, events in self.poll.poll(0.02, 500):
            peer = self.open[number][0]
            if number not in self.connected and not events & (select.EPOLLHUP | select.EPOLLERR):
                self.connected.add(number)
                self.poll.modify(peer, select.EPOLLIN)
                if self.first and not self.trickle:
                    peer.send(self.first)
            elif not self.hear(number, peer):
                self.drop(number)
        self.pass_time()

    def hear(self, number, peer):
        try:
            if peer.recv(65536):
                self.answered.add(number)
                return True
        except BlockingIOError:
            return True
        except OSError:
            pass
        return False

    def pass_time(self):
        now = time.monotonic()
        for number, (peer, opened) in list(self.open.items()):
            if self.trickle and number in self.connected:
                done = self.sent.get(number, 0)
                if done < min(now - opened, len(self.first)):
                    try:
                        peer.send(self.first[done:done + 1])
                        self.sent[number] = done + 1
                    except OSError:
                        self.drop(number)
            elif self.reset_s is not None and now - opened > self.reset_s:
                self.drop(number)

    def drop(self, number):
        self.poll.unregister(number)  # a child just forked may hold it open for a moment
        self.open.pop(number)[0].close()
        self.sent.pop(number, None)
        self.connected.discard(number)
        self.answered.discard(number)
        self.closed += 1
