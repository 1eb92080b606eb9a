#!/usr/bin/env python3
"""Those without a key: what they cost, and that they keep nobody out who has one."""
import re
import signal
import socket
import ssl
import subprocess
import sys
import time

from farm import SANITIZED, Farm, Tests, wait_for
from jobs import expect
from odd import OddPeer, talk_raw
from page import need_page
from strangers import (Strangers, Workers, descriptors_of, first_record, need_descriptors,
                       resident_bytes)

tests = Tests()
SMALL = ("--size", "64x64", "--spp", "4")
IDLE_BYTES_MAX = 16 << 10       # a connection that says nothing, or waits for its handshake
HANDSHAKE_BYTES_MAX = 96 << 10
HANDSHAKES_MAX = 64             # ADMISSION_HANDSHAKES_MAX, half of them of one address


def limited(count):
    """The start of a command line that runs with so many file descriptors and may not raise that."""
    return ["sh", "-c", "ulimit -n %d && exec \"$@\"" % count, "sh"]


def warnings(farm):
    return [l for l in farm.coordinator.log_text().splitlines() if " warn " in l]


def measure(farm, what, count, limit):
    """Print and check what each of count connections added to resident memory since farm.base."""
    each = (resident_bytes(farm.coordinator) - farm.base) / count
    print("# %s: %.1f KB each" % (what, each / 1024), flush=True)
    if not SANITIZED:  # they add to every allocation
        expect(each <= limit, "%s: %.0f bytes each, more than %d" % (what, each, limit))


@tests.add
def memory():
    """2,000 idle connections cost 16 KB each at most, 64 in the handshake 96 KB, 2,000 in line little"""
    need_descriptors(6000)
    for idle in (True, False):
        with Farm() as farm:
            farm.start_coordinator()
            farm.cli("list", expect=0)  # what is made once is there
            before = descriptors_of(farm.coordinator) - 1  # that of the command may not be closed yet
            farm.base = resident_bytes(farm.coordinator)
            if idle:
                with Strangers(farm, 2000) as crowd:
                    crowd.all_connected()
                    wait_for(lambda: descriptors_of(farm.coordinator) >= before + 2000, "them to be in")
                    measure(farm, "idle", 2000, IDLE_BYTES_MAX)
                continue
            record = first_record(farm)
            half = HANDSHAKES_MAX // 2
            with Strangers(farm, half, "127.0.0.2", record) as one, \
                    Strangers(farm, half, "127.0.0.3", record) as two:
                wait_for(lambda: len(one.answered) == len(two.answered) == half, "64 handshakes")
                measure(farm, "in the handshake", HANDSHAKES_MAX, HANDSHAKE_BYTES_MAX)
                with Strangers(farm, 2000, "127.0.0.4", record) as crowd:
                    crowd.all_connected()
                    wait_for(lambda: descriptors_of(farm.coordinator) >= before + 2000, "them to be in")
                    measure(farm, "with the first record sent", 2000 + HANDSHAKES_MAX,
                            IDLE_BYTES_MAX)
                    farm.cli("list", expect=0)


@tests.add
def descriptors():
    """1,100 idle connections under a limit of 1,024 descriptors fail no job, and the limit is raised"""
    need_descriptors(3000)
    with Farm() as farm:
        farm.start_coordinator(prefix=["sh", "-c", "ulimit -Sn 256 && ulimit -Hn 1024 && exec \"$@\"", "sh"])
        expect(re.search(r" info .*1024 file descriptors \(raised from 256\)", farm.coordinator.log_text()),
               farm.coordinator.log_text())
        with Strangers(farm, 1100) as crowd:
            wait_for(lambda: crowd.closed > 0, "strangers to make room")
            farm.start_worker()
            for number in [farm.submit(farm.scene(), *SMALL) for _ in range(8)]:
                farm.wait_for_job(number)
            expect(descriptors_of(farm.coordinator) <= 1024 - 64, "the reserve was touched")
            expect(not crowd.fault, crowd.fault)
        expect("Too many open files" not in farm.coordinator.log_text(), "descriptors ran out")


@tests.add
def a_full_farm_has_room_for_its_page():
    """killed while workers have all sessions, the page's program comes back"""
    with Farm() as farm:
        need_page()
        farm.start_coordinator("--connections-per-address", "1000", "--web", "127.0.0.1:0", prefix=limited(160))
        sessions = int(re.search(r"of these (\d+) sessions", farm.coordinator.log_text()).group(1))
        wait_for(lambda: "the page is at" in farm.coordinator.log_text(), "the page")
        crowd = Workers(farm, sessions)
        expect(crowd.settled() == (sessions, 0), "not all were welcomed")
        subprocess.run(["pkill", "-KILL", "-P", str(farm.coordinator.pid), "azulejo-web"], check=True)
        wait_for(lambda: farm.coordinator.log_text().count("info azulejo-coordinator: the page is at") == 2, "the page again")
        crowd.end()


@tests.add
def sessions_over_the_limit():
    """more key holders than there are descriptors are refused in words, and workers try again"""
    with Farm() as farm:
        farm.start_coordinator("--connections-per-address", "1000", prefix=limited(160))
        sessions = int(re.search(r"of these (\d+) sessions", farm.coordinator.log_text()).group(1))
        crowd = Workers(farm, sessions)
        expect(crowd.settled() == (sessions, 0), "not all were welcomed")
        refused = farm.cli("list")
        expect(refused.code == 3 and "file descriptors" in refused.err, refused)
        expect(descriptors_of(farm.coordinator) <= 160 - 64, "the reserve was touched")
        worker = farm.start_worker()
        wait_for(lambda: "file descriptors" in worker.log_text(), "the worker to be refused")
        crowd.end()
        wait_for(lambda: farm.cli("list").code == 0, "room for a client")
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))


@tests.add
def one_workers_key():
    """connections of one worker's key are at most half of all: another's worker, and people, get in"""
    with Farm() as farm:
        farm.start_coordinator("--no-web", "--connections-per-address", "1000", prefix=limited(160))
        sessions = int(re.search(r"of these (\d+) sessions", farm.coordinator.log_text()).group(1))
        keys = {}
        for name in ("greedy", "honest"):
            keys[name] = farm.path(name + ".key")
            farm.cli("key", "new", name, "--role", "worker", "--key", farm.key, "-o", keys[name], expect=0, connect=False)
        crowd = Workers(farm, sessions, key=keys["greedy"])
        expect(crowd.settled() == (sessions // 2, sessions - sessions // 2), "not half were welcomed")
        expect("the key of greedy has %d connections" % (sessions // 2) in farm.coordinator.log_text(), warnings(farm))
        farm.start_worker(key=keys["honest"])
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        crowd.end()


@tests.add
def two_thousand_workers_at_once():
    """2,000 workers of one machine that connect at once are all welcomed"""
    need_descriptors(6000)
    with Farm() as farm:
        farm.start_coordinator()
        crowd = Workers(farm, 2000)
        welcomed, failed = crowd.settled()
        expect((welcomed, failed) == (2000, 0), "%d welcomed, %d failed" % (welcomed, failed))
        expect(len(farm.list_workers()) == 2000, "some are not listed")
        crowd.end()
        farm.wait_for_workers(0)


@tests.add
def worker_among_strangers():
    """a worker and a client get in within seconds beside 5,000 strangers, whatever these do"""
    need_descriptors(12000)
    with Farm() as farm:
        farm.start_coordinator()
        record = first_record(farm)
        for what, how in (("silent", {}),
                          ("a byte a second", {"first": record, "trickle": True}),
                          ("TLS with a wrong key", {"first": record[:-1] + bytes([record[-1] ^ 1]),
                                                    "source": "127.0.0.3"}),
                          ("reconnecting", {"reset_s": 0.5}),
                          ("recorded handshakes", {"first": record, "source": "127.0.0.2"})):
            with Strangers(farm, 5000, **how) as crowd:
                # As many as there are places, or as come round in a loop.
                wait_for(lambda: crowd.fault or len(crowd.connected) + crowd.closed > 5000, what)
                peer = OddPeer(farm)  # within the limits of a handshake, or it fails
                farm.cli("list", expect=0, limit_s=20)
                peer.end()
                expect(not crowd.fault, "%s: %s" % (what, crowd.fault))
        farm.start_worker()
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        expect(len(warnings(farm)) < 30, "%d warnings" % len(warnings(farm)))


@tests.add
def a_stopped_coordinator_counts_no_time():
    """a handshake that the coordinator itself could not go on with is not cut off when it goes on"""
    with Farm() as farm:
        farm.start_coordinator()
        with socket.create_connection(("127.0.0.1", int(farm.address.rsplit(":", 1)[1]))) as stranger:
            stranger.sendall(b"\x16")
            time.sleep(0.5)  # until its byte was read
            farm.coordinator.signal(signal.SIGSTOP)
            time.sleep(7)    # longer than a handshake may take
            farm.coordinator.signal(signal.SIGCONT)
            stranger.settimeout(1)
            try:
                expect(False, "the connection was ended: %r" % stranger.recv(1))
            except socket.timeout:
                pass


@tests.add
def probes():
    """connections that close at once leave no warning, and HTTP or keyless TLS one line a minute"""
    with Farm() as farm:
        farm.start_coordinator()
        host, port = farm.address.rsplit(":", 1)
        for _ in range(50):
            socket.create_connection((host, int(port))).close()
        farm.cli("list", expect=0)  # it has looked at them all
        expect(warnings(farm) == [], warnings(farm))
        for _ in range(20):
            talk_raw(farm, b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        wait_for(lambda: len(warnings(farm)) == 1, "a line about HTTP")
        expect("does not speak TLS" in warnings(farm)[0] and "127.0.0.1" in warnings(farm)[0],
               warnings(farm))
        context = ssl._create_unverified_context()  # pylint: disable=protected-access
        for _ in range(20):
            try:
                with socket.create_connection((host, int(port))) as peer:
                    context.wrap_socket(peer)
            except OSError:
                pass  # an alert: it has no key
        wait_for(lambda: len(warnings(farm)) == 2, "a line about TLS without a key")
        expect("no farm key" in warnings(farm)[1], warnings(farm))


if __name__ == "__main__":
    sys.setswitchinterval(0.002)
    tests.run()
