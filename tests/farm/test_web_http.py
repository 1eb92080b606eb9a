#!/usr/bin/env python3
"""The page's server: what it answers, whom it answers, and what those cost who want it to fail."""
import base64
import hashlib
import os
import re
import select
import signal
import socket
import ssl
import stat
import struct
import subprocess
import sys
import threading
import time
import warnings

from disk import SmallDisk
from farm import Failure, Farm, PATIENCE, SANITIZED, Skip, Tests, wait_for
from jobs import expect
from page import Page, need_page
from websocket import Closed, WebSocket
from strangers import descriptors_of, need_descriptors, resident_bytes

tests = Tests()
CONNECTIONS_MAX = 256
BODY_MAX = 1 << 20


def started(farm, *options, **how):
    return Page(farm.start_coordinator(*options, **how))


def request_bytes(page, path="/healthz", method="GET", more="", body=b""):
    length = "content-length: %d\r\n" % len(body) if body or method != "GET" else ""
    return ("%s %s HTTP/1.1\r\nhost: %s\r\n%s%s\r\n" % (method, path, page.host, length, more)).encode() + body


def statuses(data):
    return [int(s) for s in re.findall(rb"HTTP/1\.[01] (\d{3})", data)]


def is_closed(peer, limit_s):
    """Does the other side end this connection within the limit? What it sends is skipped."""
    end = time.monotonic() + limit_s * PATIENCE
    try:
        while time.monotonic() < end:
            peer.settimeout(max(0.1, end - time.monotonic()))
            if not peer.recv(65536):
                return True
    except socket.timeout:
        return False
    except OSError:
        return True
    return False


@tests.add
def answers():
    """files with ETags, HEAD, what is not there, methods that are not known, and the headers of each answer"""
    with Farm() as farm:
        page = started(farm)
        index = page.get("/", token="")
        expect(index.status == 200 and b"<html" in index.body, index)
        expect(index.headers["content-type"].startswith("text/html"), index)
        expect(index.headers["cache-control"] == "no-cache", index)
        again = page.get("/", token="", headers={"If-None-Match": '"x", ' + index.headers["etag"]})
        expect(again.status == 304 and again.body == b"", again)
        expect(page.get("/", token="", headers={"If-None-Match": '"x"'}).status == 200, "another ETag")
        head = page.request("HEAD", "/", token="")
        expect(head.status == 200 and head.body == b"", head)
        expect(head.headers["content-length"] == str(len(index.body)), head)
        missing = page.get("/api/v1/nothing")
        expect(missing.status == 404 and missing.headers["content-type"] == "application/problem+json", missing)
        expect(missing.json()["code"] == "not-found" and missing.json()["instance"] == "/api/v1/nothing", missing)
        for path in ("/assets/../index.html", "/assets/%2e%2e/index.html", "/assets/nothing.js", "/assets/"):
            expect(page.get(path, token="").status in (404, 400), path)
        wrong = page.post("/healthz")
        expect(wrong.status == 405 and wrong.headers["allow"] == "GET, HEAD", wrong)
        options = page.request("OPTIONS", "/healthz", headers={"Origin": "http://evil.example"})
        expect(options.status in (403, 405), options)
        untold = page.get("/api/v1/jobs", token="")
        expect(untold.status == 401 and "Bearer" in untold.headers["www-authenticate"], untold)
        expect(page.get("/api/v1/jobs", token="azt_" + 64 * "0").status == 401, "a wrong token")
        expect(page.get("/api/v1/jobs").status == 200, "the coordinator's own token")
        for answer in (index, again, head, missing, wrong, options, untold):
            names = {k.lower(): v for k, v in answer.headers.items()}
            expect(names["content-security-policy"].startswith("default-src 'self'"), answer)
            expect("unsafe" not in names["content-security-policy"], answer)
            expect(names["x-content-type-options"] == "nosniff" and names["referrer-policy"] == "no-referrer", answer)
            expect(names["cross-origin-opener-policy"] == names["cross-origin-resource-policy"] == "same-origin", answer)
            expect(names["cache-control"] in ("no-store", "no-cache"), answer)
            expect(not [n for n in names if n.startswith("access-control")], answer)


@tests.add
def methods_and_lengths():
    """a method that HTTP or the page does not have is answered, and a body that is too long is refused before it comes"""
    with Farm() as farm:
        page = started(farm)
        for method in ("BREW", "PROPFIND", "TRACE", "CONNECT", "G", "X" * 200):
            for path in ("/healthz", "/nothing", "*", "evil.example:443"):
                answer = page.raw(request_bytes(page, path, method), limit_s=10)
                expect(statuses(answer) == [501] and b"application/problem+json" in answer, (method, path, answer))
                expect(b"content-security-policy" in answer and answer.count(b"\r\n\r\n") == 1, answer)
        for nonsense in (b"\x16\x03\x01\x02", b"hello\r\n\r\n", b"\0" * 100):
            expect(statuses(page.raw(nonsense, limit_s=10)) == [400], nonsense)
        token = "authorization: Bearer %s\r\n" % page.token
        upload = page.post("/api/v1/imports").json()["import"]
        for length in (10**13, 10**19):
            for method, path in (("PUT", "/api/v1/blobs/" + "0" * 64), ("PUT", "/api/v1/imports/%d/files/a" % upload),
                                 ("POST", "/api/v1/imports"), ("POST", "/api/v1/jobs/1/pause")):
                began = time.monotonic()
                answer = page.raw(request_bytes(page, path, method, token + "expect: 100-continue\r\ncontent-length: %d\r\n" % length)
                                  .replace(b"content-length: 0\r\n", b""), limit_s=10)
                expect(statuses(answer) == [413], (length, path, answer))
                expect(time.monotonic() - began < 5 * PATIENCE, (path, "took long"))
        for path in ("/api/v1/jobs", "/healthz", "/nothing", "/api/v1/workers"):
            head, get = page.request("HEAD", path), page.get(path)
            expect(head.status == get.status and head.body == b"", (path, head))
            expect(head.headers["content-type"] == get.headers["content-type"], (path, head))
        expect(page.get("/healthz").status == 200, "the page")


@tests.add
def hosts():
    """a request for another host's name gets nothing, however it is put"""
    with Farm() as farm:
        page = started(farm, "--web-name", "render.example")
        port = page.port
        for host in ("evil.example", "evil.example:%d" % port, "127.0.0.1", "localhost:%d" % (port - 1), "",
                     "127.0.0.1:%d.evil.example" % port, "localhost.evil.example:%d" % port, "127.0.0.2:%d" % port,
                     "localhost:", "localhost:%d@evil.example:%d" % (port, port), "[::2]:%d" % port, "a" * 5000):
            answer = page.get("/", headers={"Host": host})
            expect(answer.status == 421 and b"<html" not in answer.body, "%s: %s" % (host, answer))
        for host in ("localhost", "LocalHost", "127.0.0.1", "[::1]", "render.example", "RENDER.example"):
            expect(page.get("/", headers={"Host": "%s:%d" % (host, port)}).status == 200, host)
        none = page.raw(b"GET / HTTP/1.1\r\nconnection: close\r\n\r\n")
        expect(statuses(none) in ([421], [400], []), none)
        two = page.raw(b"GET / HTTP/1.1\r\nhost: %s\r\nhost: evil.example\r\nconnection: close\r\n\r\n"
                       % page.host.encode())
        expect(b"<html" not in two, two)
        whole = page.raw(b"GET http://evil.example/ HTTP/1.1\r\nhost: %s\r\nconnection: close\r\n\r\n"
                         % page.host.encode())
        expect(b"<title>" not in whole and whole.count(b"content-security-policy") == len(statuses(whole)), whole)


@tests.add
def origins():
    """another page's requests are refused: writes, reads of the API, and WebSockets"""
    with Farm() as farm:
        page = started(farm)
        cookie = {"Cookie": "a=b; " + sign_in(page)}
        read = page.get("/api/v1/jobs", token="", headers=cookie)
        expect(read.status == 200, read)
        for origin in ("http://evil.example", "null", "http://localhost:%d" % page.port, "http://127.0.0.1",
                       "https://" + page.host, page.origin + ".evil.example"):
            for how in (dict(token="", headers=dict(cookie, Origin=origin)), dict(headers={"Origin": origin})):
                answer = page.post("/api/v1/store/collect", **how)
                expect(answer.status == 403, "%s: %s" % (origin, answer))
                expect(not [n for n in answer.headers if n.lower().startswith("access-control")], answer)
            expect(handshake(page, "/api/v1/live", origin, cookie["Cookie"])[0] == 403, "WebSocket from " + origin)
        expect(page.post("/api/v1/jobs/1/pause", token="", headers=cookie).status == 403, "a cookie without an Origin")
        expect(page.post("/api/v1/jobs/1/pause", token="", headers=dict(cookie, Origin=page.origin)).status == 404,
               "our own page")
        expect(page.post("/api/v1/jobs/1/pause").status == 404, "a program")
        for site, mode, status in (("cross-site", "no-cors", 403), ("same-site", "cors", 403),
                                   ("cross-site", "navigate", 200), ("same-origin", "cors", 200), ("none", "navigate", 200)):
            answer = page.get("/api/v1/jobs", token="", headers=dict(
                cookie, **{"Sec-Fetch-Site": site, "Sec-Fetch-Mode": mode}))
            expect(answer.status == status, "%s %s: %s" % (site, mode, answer))
        expect(handshake(page, "/api/v1/live", page.origin, "")[0] == 401, "a WebSocket without a token")
        expect(handshake(page, "/api/v1/live", None, cookie["Cookie"])[0] == 403, "a cookie without an Origin")
        expect(handshake(page, "/healthz", page.origin, cookie["Cookie"])[0] == 404, "no WebSocket there")


def sign_in(page):
    answer = page.post("/api/v1/session", {"token": page.token}, token="", headers={"Origin": page.origin})
    expect(answer.status in (200, 204), answer)
    return answer.headers["set-cookie"].split(";")[0]


def handshake(page, path, origin, cookie):
    """Ask for a WebSocket; the status and the socket."""
    peer = page.connect()
    lines = ["GET %s HTTP/1.1" % path, "host: " + page.host, "upgrade: websocket", "connection: Upgrade",
             "sec-websocket-version: 13", "sec-websocket-key: " + base64.b64encode(os.urandom(16)).decode()]
    lines += ["origin: " + origin] if origin else []
    lines += ["cookie: " + cookie] if cookie else []
    peer.sendall("\r\n".join(lines + ["", ""]).encode())
    got = b""
    while b"\r\n\r\n" not in got:
        piece = peer.recv(4096)
        if not piece:
            break
        got += piece
    return (statuses(got) or [0])[0], peer


@tests.add
def odd_requests():
    """pipelines, single bytes, halves, sizes that are none, and bodies without end"""
    with Farm() as farm:
        page = started(farm)
        one = request_bytes(page)
        got = page.raw(one * 40, until=lambda b: b.count(b"HTTP/1.1 200") == 40)
        expect(statuses(got) == [200] * 40, statuses(got))
        mixed = (request_bytes(page, "/healthz", "POST", body=b"GET / HTTP/1.1\r\nhost: evil\r\n\r\n") + one)
        got = page.raw(mixed, until=lambda b: len(statuses(b)) >= 2)
        expect(statuses(got) in ([405], [405, 200]), got)
        with page.connect() as peer:
            for byte in one:
                peer.send(bytes([byte]))
            expect(b"200 OK" in peer.recv(4096), "byte for byte")
        for line in ("content-length: x", "content-length: -1", "content-length: 5x", "content-length: 99999999999999999999",
                     "transfer-encoding: chunked", "content-length: 3\r\ntransfer-encoding: chunked",
                     "content-length: 3\r\ncontent-length: 4"):
            got = page.raw(("POST /api/v1/jobs HTTP/1.1\r\nhost: %s\r\nauthorization: Bearer %s\r\n%s\r\n\r\n{}" % (
                page.host, page.token, line)).encode() + b"0\r\n\r\n" + one)
            expect(statuses(got) in ([400], []) and (got or "chunked" in line), "%s: %s" % (line, got[:300]))
        got = page.raw(("PUT /api/v1/blobs/%s HTTP/1.1\r\nhost: %s\r\nauthorization: Bearer %s\r\ncontent-length: %d\r\n\r\n" % (
            "0" * 64, page.host, page.token, 10**13)).encode(), until=lambda b: b"\r\n\r\n" in b)
        expect(statuses(got) == [413], "refused before a byte of it came: %s" % got)
        for junk in (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + os.urandom(500), b"\r\n\r\n\r\n", b"GET\r\n\r\n",
                     b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"\0" * 3000,
                     b"GET /%00 HTTP/1.1\r\nhost: " + page.host.encode() + b"\r\nconnection: close\r\n\r\n",
                     b"CONNECT evil.example:443 HTTP/1.1\r\nhost: " + page.host.encode() + b"\r\n\r\n",
                     request_bytes(page, more="upgrade: h2c\r\nconnection: Upgrade, HTTP2-Settings\r\nhttp2-settings: AAMAAABk\r\n"),
                     request_bytes(page, more="upgrade: nonsense\r\nconnection: Upgrade\r\n")):
            with page.connect() as peer:
                peer.sendall(junk)
                peer.shutdown(socket.SHUT_WR)
                got = b""
                try:
                    while True:
                        piece = peer.recv(65536)
                        if not piece:
                            break
                        got += piece
                except ConnectionResetError:
                    pass
            expect(not [s for s in statuses(got) if s < 200], got[:300])
            expect(got.count(b"content-security-policy") == len(statuses(got)), got[:600])
        expect(page.get("/healthz").status == 200, "still there")


@tests.add
def pipelined_bodies():
    """requests behind a body that was not answered yet: the first is answered, and the coordinator goes on"""
    with Farm() as farm:
        page = started(farm)
        known = "content-type: application/json\r\nauthorization: Bearer %s\r\n" % page.token
        cases = (("/api/v1/session", "", b'{"token": "none"}', 401),   # answered at once, and to anybody
                 ("/api/v1/session", "content-type: application/json\r\n", b"{}", 400),
                 ("/api/v1/jobs/1/priority", known, b'{"priority": 1}', 404),
                 ("/api/v1/blobs/missing", known, b'{"digest": []}', 200),
                 ("/api/v1/tokens", known, b'{"role": "view"}', 200))  # answered when it is on disk
        for path, more, body, first in cases:
            for last in (request_bytes(page, path, "POST", more, body), request_bytes(page), b"G", b"\r\n"):
                with page.connect(5) as peer:
                    peer.sendall(request_bytes(page, path, "POST", more, body) + last)
                    got = peer.recv(65536)
                    expect(statuses(got)[:1] == [first], "%s: %s" % (path, got[:200]))
                    expect(page.get("/healthz", limit_s=5).status == 200, "%s, then %s" % (path, last[:20]))


@tests.add
def large():
    """headers and bodies above their limits are refused, and cost nothing"""
    with Farm() as farm:
        page = started(farm)
        expect(page.get("/healthz", headers={"X-Filler": "a" * 8000}).status == 200, "8 KB of headers")
        before = resident_bytes(farm.coordinator)
        for more in ("x-filler: %s\r\n" % ("a" * 100000), "cookie: %s\r\n" % ("a" * 100000),
                     "".join("x-%d: y\r\n" % i for i in range(20000)), "host: x\r\n" * 5000):
            got = page.raw(request_bytes(page, more=more + "connection: close\r\n"))
            expect(not statuses(got) or statuses(got)[0] >= 400 or len(more) > 100000, got[:300])
        got = page.raw(request_bytes(page, "/" + "a" * 100000))
        expect(not statuses(got) or statuses(got)[0] >= 400, got[:300])
        got = page.raw(request_bytes(page, "/healthz?" + "&".join("a%d=b" % i for i in range(2000))))
        expect(not statuses(got) or statuses(got)[0] >= 200, got[:300])
        headers = {"Content-Type": "application/json"}
        held = page.post("/api/v1/jobs", b" " * (BODY_MAX + 1), headers=headers)
        expect(held.status == 413 and held.json()["code"] == "too-large", held)
        expect(page.post("/api/v1/jobs", b"{" * BODY_MAX, headers=headers).status == 400, "as large as may be")
        endless = page.raw(("POST /api/v1/jobs HTTP/1.1\r\nhost: %s\r\nauthorization: Bearer %s\r\n"
                            "content-length: 5000000000\r\n\r\n" % (page.host, page.token)).encode() + b" " * (8 << 20))
        expect(statuses(endless) in ([413], []), endless[:300])
        expect(page.get("/healthz").status == 200, "still there")
        if not SANITIZED:
            expect(resident_bytes(farm.coordinator) - before < 16 << 20, "memory grew")


@tests.add
def slow():
    """headers, bodies and readers that take too long end, and hold little"""
    with Farm() as farm:
        page = started(farm)
        authorized = "authorization: Bearer %s\r\n" % page.token
        headers, body, reader, silent = page.connect(), page.connect(), page.connect(), page.connect()
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stop = threading.Event()

        def drip():
            headers.send(b"GET / HTTP/1.1\r\nhost: " + page.host.encode() + b"\r\nx: ")
            body.send(request_bytes(page, "/api/v1/jobs", "POST", authorized, b" " * 1000)[:-999])
            while not stop.wait(0.5):
                for peer in (headers, body):
                    try:
                        peer.send(b"a")
                    except OSError:
                        pass

        def ask_much():
            try:
                while not stop.is_set():
                    reader.sendall(request_bytes(page, "/"))
            except OSError:
                pass

        def answer_pings():
            try:
                while not stop.is_set():
                    polite.receive(0.5)
            except (Closed, OSError):
                pass

        threads = [threading.Thread(target=f, daemon=True) for f in (drip, ask_much, answer_pings)]
        before = resident_bytes(farm.coordinator)
        polite = WebSocket(page.host, "/api/v1/live", page.token)  # asks for nothing, so it gets nothing but pings
        stream = page.connect()
        stream.sendall(request_bytes(page, "/api/v1/events", more=authorized))
        status, dumb = handshake(page, "/api/v1/live", page.origin, sign_in(page))
        expect(status == 101, status)
        begun = time.monotonic()
        for thread in threads:
            thread.start()
        expect(is_closed(headers, 20), "headers that drip")
        expect(is_closed(silent, 20), "a connection that asks nothing")
        expect(is_closed(body, 45), "a body that drips")
        end = time.monotonic() + 45 * PATIENCE
        while threads[1].is_alive() and time.monotonic() < end:
            threads[1].join(0.1)
        expect(not threads[1].is_alive(), "a reader that reads nothing")
        if not SANITIZED:
            expect(resident_bytes(farm.coordinator) - before < 8 << 20, "memory grew")
        expect(is_closed(dumb, 45), "a WebSocket whose client answers no ping")
        expect(not is_closed(stream, (65 - (time.monotonic() - begun)) / PATIENCE), "a stream of events lives on")
        expect(threads[2].is_alive(), "a WebSocket whose client answers its pings lives on")
        stop.set()
        threads[2].join()
        polite.drop()
        for peer in (headers, body, reader, silent, stream, dumb):
            peer.close()


def cpu_seconds(pid):
    with open("/proc/%d/stat" % pid) as stat:
        return sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:13])) / os.sysconf("SC_CLK_TCK")


def answers_to(peer, count, limit_s=30):
    """What comes until so many answers are whole."""
    got, found, end = bytearray(), 0, time.monotonic() + limit_s * PATIENCE
    while found < count and time.monotonic() < end:
        peer.settimeout(max(0.1, end - time.monotonic()))
        data = peer.recv(65536)
        if not data:
            break
        found += (got[-6:] + data).count(b"</html>")
        got += data
    return got


@tests.add
def more_than_was_asked_for():
    """a client that says more, or that it says no more, before its answer is over costs no processor time"""
    with Farm() as farm:
        page = started(farm)
        web = int(subprocess.check_output(["pgrep", "-P", str(farm.coordinator.pid), "azulejo-web"]))
        stream = request_bytes(page, "/api/v1/events", more="authorization: Bearer %s\r\n" % page.token)
        talks, ends, asks, half = (page.connect() for _ in range(4))
        for peer in (talks, ends):
            peer.sendall(stream)
            expect(statuses(peer.recv(4096)) == [200], "a stream")
        talks.sendall(b"x")
        ends.shutdown(socket.SHUT_WR)
        expect(is_closed(ends, 5), "a stream whose client says no more")
        asks.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        asks.setblocking(False)
        asked, one = 0, request_bytes(page, "/")
        while asked < 3000 * len(one):  # until both sides are full
            try:
                asked += asks.send(one[asked % len(one):])
            except BlockingIOError:
                if wait_for_room(asks):
                    continue
                break
        half.sendall(one)
        half.shutdown(socket.SHUT_WR)
        expect(statuses(answers_to(half, 1)) == [200], "the answer to one that says no more")
        before, begun = cpu_seconds(web), time.monotonic()
        while time.monotonic() < begun + 3:
            expect(page.get("/healthz").status == 200, "others are answered")
            time.sleep(0.1)
        spent = cpu_seconds(web) - before
        if not SANITIZED:
            expect(spent < 0.15 * (time.monotonic() - begun), "%.1f s of processor time for those who wait" % spent)
        asks.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        # Not all 3,000: where the kernel paces what it sends (BBR), a client that took nothing for seconds gets the rest slowly.
        wanted = min(200, asked // len(one))
        got = statuses(answers_to(asks, wanted))
        expect(len(got) >= wanted and set(got) == {200}, "%d of %d answers" % (len(got), wanted))
        for peer in (talks, ends, asks, half):
            peer.close()


def wait_for_room(peer):
    """Can more be sent within half a second?"""
    return bool(select.select([], [peer], [], 0.5)[1])


@tests.add
def crowd():
    """1,100 idle connections: the farm works, the page does, and no more than 256 are held"""
    need_descriptors(4000)
    with Farm() as farm:
        page = started(farm)
        farm.start_worker()
        farm.wait_for_workers(1)
        before = descriptors_of(farm.coordinator)
        idle = []
        for _ in range(1100):
            idle.append(page.connect())
        expect(page.get("/healthz").status == 200, "an answer in the crowd")
        expect(descriptors_of(farm.coordinator) - before <= CONNECTIONS_MAX + 8, "too many descriptors")
        job = farm.submit(farm.scene(), "--size", "32x32", "--spp", "4")
        farm.wait_for_job(job)
        for peer in idle:
            peer.close()
        wait_for(lambda: descriptors_of(farm.coordinator) <= before + 8, "their end")


@tests.add
def few_descriptors():
    """with few descriptors the page takes at most an eighth of them, and the farm has its own"""
    need_descriptors(1000)
    with Farm() as farm:
        page = started(farm, prefix=["sh", "-c", "ulimit -n 256 && exec \"$@\"", "sh"])
        idle = [page.connect() for _ in range(300)]
        expect(descriptors_of(farm.coordinator) <= 256 // 2, "descriptors: %d" % descriptors_of(farm.coordinator))
        farm.start_worker()
        farm.wait_for_workers(1)
        expect(page.get("/healthz").status == 200, "an answer")
        for peer in idle:
            peer.close()


@tests.add
def vanished():
    """clients that vanish at any moment leave nothing behind"""
    with Farm() as farm:
        page = started(farm)
        authorized = "authorization: Bearer %s\r\n" % page.token
        asked = [request_bytes(page, "/", more=authorized), request_bytes(page, "/api/v1/jobs", more=authorized),
                 request_bytes(page, "/api/v1/jobs", "POST", authorized, b"{}" + b" " * 5000),
                 request_bytes(page, "/api/v1/events", more=authorized),
                 request_bytes(page, "/assets/api.js") * 50]

        def vanish(count):
            for i in range(count):
                data = asked[i % len(asked)]
                with page.connect() as peer:
                    if i % 3 == 0:  # a reset rather than an end
                        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    peer.sendall(data[:len(data) - (i * 37) % len(data)])
        vanish(300)
        before, files = resident_bytes(farm.coordinator), descriptors_of(farm.coordinator)
        vanish(3000)
        wait_for(lambda: page.get("/healthz").status == 200, "an answer")
        wait_for(lambda: descriptors_of(farm.coordinator) <= files + 4, "their end")
        if not SANITIZED:
            grown = resident_bytes(farm.coordinator) - before
            expect(grown < 4 << 20, "memory grew by %d bytes" % grown)


@tests.add
def ends():
    """a coordinator ends at once, whatever its page's connections do, and starts again with token and port"""
    with Farm() as farm:
        page = started(farm)
        peers = [page.connect() for _ in range(6)]
        peers[1].sendall(b"GET / HT")
        peers[2].sendall(request_bytes(page, "/") * 100)
        peers[3].sendall(request_bytes(page, "/api/v1/jobs", "POST", "authorization: Bearer %s\r\n" % page.token, b"{" * 100)[:-50])
        peers[4].sendall(request_bytes(page, "/api/v1/events", more="authorization: Bearer %s\r\n" % page.token))
        live, socket_ = handshake(page, "/api/v1/live", page.origin, sign_in(page))
        expect(live == 101, live)
        page.get("/healthz")
        begun = time.monotonic()
        expect(farm.coordinator.stop() == 0, "its end")
        expect(time.monotonic() - begun < 5 * PATIENCE, "it took %.1f s" % (time.monotonic() - begun))
        again = started(farm, "--web", "127.0.0.1:%d" % page.port)
        expect(again.token == page.token and again.port == page.port, "another token or port")
        farm.coordinator.kill()
        again = started(farm, "--web", "127.0.0.1:%d" % page.port)
        expect(again.get("/api/v1/jobs").status == 200, "after a kill")
        expect(stat.S_IMODE(os.stat(farm.store + "/page.url").st_mode) == 0o600, "page.url can be read by others")
        for peer in peers + [socket_]:
            peer.close()


def second_of_two_ports():
    """A socket bound to a port whose lower neighbour is free. Not one of those that the kernel gives to others'
    connections."""
    for port in range(20000 + os.getpid() * 7 % 10000, 32000, 2):
        with socket.socket() as lower:
            upper = socket.socket()
            try:
                lower.bind(("127.0.0.1", port))
                upper.bind(("127.0.0.1", port + 1))
                return upper
            except OSError:
                upper.close()
    raise Failure("no two free ports")


@tests.add
def ports():
    """a port in use is an error if it was asked for, else only a warning; --no-web listens nowhere"""
    with Farm() as farm, second_of_two_ports() as busy:
        need_page()
        busy.listen()
        port = busy.getsockname()[1]
        try:
            farm.start_coordinator("--web", "127.0.0.1:%d" % port)
            farm.coordinator.wait_line("page: ")
            raise AssertionError("it started")
        except Failure as failure:
            expect("is in use" in str(failure) and "--web" in str(failure), failure)
        farm.coordinator.wait()
        farm.start_coordinator(listen="127.0.0.1:%d" % (port - 1))
        farm.cli("list", expect=0)
        wait_for(lambda: "no page: 127.0.0.1:%d is in use" % port in farm.coordinator.log_text(), "the warning")
        farm.coordinator.stop()
        farm.start_coordinator("--no-web")
        farm.cli("list", expect=0)
        farm.coordinator.stop()
        expect("page" not in farm.coordinator.rest.decode(), farm.coordinator.rest)


@tests.add
def bad_disk():
    """started on a disk that cannot be written, the coordinator has its page, with its token if there is one"""
    with Farm() as farm, SmallDisk(farm, 24 << 20) as folder:
        need_page()
        if not folder:
            raise Skip("mounting is not permitted")
        farm.store = os.path.join(folder, "store")
        token = started(farm).token
        farm.coordinator.stop()
        os.rename(farm.store + "/web.token", farm.store + "/token")
        for there in (False, True):
            if there:
                os.rename(farm.store + "/token", farm.store + "/web.token")
            disk = SmallDisk(farm, 0)
            disk.remount("ro")
            farm.start_coordinator()
            farm.cli("list", expect=0)
            page = Page(farm.coordinator)
            expect((page.token == token) == there and page.get("/api/v1/jobs").status == 200, "the page")
            farm.coordinator.stop()
            disk.remount("rw")


@tests.add
def tls():
    """beyond this machine only TLS, with a certificate that is made once and whose fingerprint is printed"""
    with Farm() as farm:
        need_page()
        farm.start_coordinator("--web", "0.0.0.0:0")
        printed = farm.coordinator.wait_line("page certificate: SHA-256 ")
        page = Page(farm.coordinator)
        expect(page.tls, page.origin)
        with page.connect() as peer:
            shown = hashlib.sha256(peer.getpeercert(binary_form=True)).hexdigest()
            expect(peer.version() in ("TLSv1.2", "TLSv1.3"), peer.version())
        expect(printed.replace(":", "").lower() == shown, "%s, not %s" % (shown, printed))
        expect(page.get("/healthz").status == 200, "over TLS")
        expect(page.get("/", headers={"Host": "127.0.0.1:%d" % page.port}).status == 200, "an address")
        expect(page.get("/", headers={"Host": "evil.example:%d" % page.port}).status == 421, "another name")
        expect("; Secure" in page.post("/api/v1/session", {"token": page.token}, token="",
                                       headers={"Origin": page.origin}).headers["set-cookie"], "the cookie")
        with socket.create_connection(("127.0.0.1", page.port)) as plain:
            plain.sendall(request_bytes(page))
            expect(is_closed(plain, 20), "plain HTTP")
        old = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            old.maximum_version = ssl.TLSVersion.TLSv1_1
        try:
            with socket.create_connection(("127.0.0.1", page.port)) as peer:
                old.wrap_socket(peer)
            raise AssertionError("TLS 1.1 was taken")
        except OSError:
            pass
        expect(stat.S_IMODE(os.stat(farm.store + "/web-key.pem").st_mode) == 0o600, "the key can be read by others")
        before = descriptors_of(farm.coordinator)
        for i in range(300):
            with socket.create_connection(("127.0.0.1", page.port)) as peer:
                peer.send((b"\x16\x03\x01\x02\x00\x01", b"\x16\x03", b"\x00" * 600, b"")[i % 4])
        expect(page.get("/healthz").status == 200, "after half handshakes")
        wait_for(lambda: descriptors_of(farm.coordinator) <= before + 4, "their end")
        silent = page.connect()
        half = socket.create_connection(("127.0.0.1", page.port))
        half.send(b"\x16\x03\x01")
        expect(farm.coordinator.stop() == 0, "its end")
        silent.close()
        half.close()
        farm.start_coordinator("--web", "0.0.0.0:%d" % page.port)
        expect(farm.coordinator.wait_line("page certificate: SHA-256 ") == printed, "another certificate")
        farm.coordinator.stop()
        # One of one's own, and a key that is not its.
        os.rename(farm.store + "/web-cert.pem", farm.path("cert.pem"))
        os.rename(farm.store + "/web-key.pem", farm.path("key.pem"))
        page = started(farm, "--web", "127.0.0.1:0", "--web-cert", farm.path("cert.pem"), "--web-key", farm.path("key.pem"))
        expect(page.tls and page.get("/healthz").status == 200, page.origin)
        farm.coordinator.stop()
        for key in (farm.key, farm.path("none")):
            try:
                started(farm, "--web", "127.0.0.1:0", "--web-cert", farm.path("cert.pem"), "--web-key", key)
                raise AssertionError("it started with " + key)
            except Failure as failure:
                expect("certificate or key" in str(failure), failure)
            farm.coordinator.wait()


@tests.add
def local():
    """`azulejo render --web` has a page while it renders, and none without"""
    with Farm() as farm:
        need_page()
        child = farm.start_cli("render", farm.scene(), "--size", "256x256", "--spp", "4096", "-o", farm.path("out"),
                               "--web", "--quiet")
        line = child.stderr.readline().decode()
        expect(line.startswith("page: http://127.0.0.1:"), line)
        port = int(re.search(r":(\d+)/", line).group(1))
        token = line.split("token=")[1].strip()
        page = object.__new__(Page)
        page.tls, page.name, page.port, page.token = False, "127.0.0.1", port, token
        page.host, page.connect_to = "127.0.0.1:%d" % port, "127.0.0.1"
        jobs = wait_for(lambda: page.get("/api/v1/jobs").json().get("jobs"), "the job on the page")
        expect(len(jobs) == 1, jobs)
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=60 * PATIENCE)


if __name__ == "__main__":
    tests.run()
