"""What one address may have of the coordinator's connections: others still get in."""
import socket
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Tests, wait_for
from jobs import expect
from page import Page

tests = Tests()
MOST = 6


def stream(page, source, token=None):
    """An event stream from that address, and the first bytes of its answer."""
    peer = socket.create_connection(("127.0.0.1", page.port), timeout=20, source_address=(source, 0))
    try:
        peer.sendall(("GET /api/v1/events HTTP/1.1\r\nHost: %s\r\nAuthorization: Bearer %s\r\n\r\n" % (page.host, token or page.token)).encode())
        answer = peer.recv(1000)
    except ConnectionError:
        answer = b""
    return peer, answer


def end(process):
    process.terminate()
    process.wait()


@tests.add
def page_connections():
    """300 event streams from one address: the first ones stay, the others are told why not, another address gets in"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        secret = page.post("/api/v1/tokens", {"role": "admin", "name": "second"}).json()["secret"]
        held, refused = [], []
        for i in range(300):  # one token may not have so many
            peer, answer = stream(page, "127.0.0.1", secret if i % 2 else None)
            (held if b" 200 " in answer else refused).append((peer, answer))
        expect(len(held) == 192, "three quarters of 256, not %d" % len(held))
        expect(any(b" 503 " in answer and b"--connections-per-address" in answer for _, answer in refused), refused[0])
        other, answer = stream(page, "127.0.0.2")
        expect(b" 200 " in answer, "another address: %s" % answer)
        told = [line for line in farm.coordinator.log_text().splitlines() if "turned away" in line]
        expect(len(told) == 1 and "127.0.0.1" in told[0], told)
        held.pop()[0].close()
        wait_for(lambda: b" 200 " in stream(page, "127.0.0.1")[1], "a place that is free again")
        for peer, _ in held + refused + [(other, b"")]:
            peer.close()


@tests.add
def sessions():
    """--connections-per-address: a client above it is told so; a free place is taken again"""
    with Farm() as farm:
        farm.start_coordinator("--connections-per-address", str(MOST))
        followers = []

        def ask():
            """The answer to a client when all places are held; None: this one found a place, perhaps a follower's."""
            followers[:] = [f for f in followers if f.poll() is None]
            followers.extend(farm.start_cli("log", "--all", "-f") for _ in range(MOST - len(followers)))
            result = farm.cli("list")
            return result if result.code else None

        refused = wait_for(ask, "a client that is turned away")
        expect("--connections-per-address" in refused.err and str(MOST) in refused.err, refused)
        end(followers.pop())
        wait_for(lambda: farm.cli("list").code == 0, "a free place")
        for follower in followers:
            end(follower)


tests.run()
