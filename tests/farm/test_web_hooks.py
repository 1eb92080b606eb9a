#!/usr/bin/env python3
"""Webhooks: what receivers get, and what becomes of events when they fail, hang, lie or are killed."""
import contextlib
import hashlib
import hmac
import os
import socket
import sqlite3
import ssl
import subprocess
import sys
import threading
import time

from disk import OddDisk
from farm import Farm, PATIENCE, Tests, wait_for
from jobs import expect
from odd import OddPeer, die_of
from page import Page
from receiver import Receiver

tests = Tests()


def add(farm, url):
    """Its number and its secret."""
    made = farm.cli("webhook", "add", url, "--json", expect=0).json()
    return made["webhooks"][0]["webhook"], made["secret"]


def listed(farm, number):
    return [w for w in farm.cli("webhook", "list", "--json", expect=0).json()["webhooks"] if w["webhook"] == number][0]


def is_signed(headers, body, secret, at_most_s=60):
    stamp = headers["X-Azulejo-Timestamp"]
    expect(abs(time.time() - int(stamp)) < at_most_s * PATIENCE, headers)
    right = hmac.new(secret.encode(), stamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    return hmac.compare_digest(headers["X-Azulejo-Signature"], "sha256=" + right)


@tests.add
def told():
    """a test and a job that is done, but not one that was cancelled: JSON, signed, in order, once each"""
    with Farm() as farm, Receiver() as receiver:
        page = Page(farm.start_coordinator())
        number, secret = add(farm, receiver.url)
        expect(len(secret) == 64, secret)
        farm.cli("webhook", "test", number, expect=0)
        expect(receiver.events()[0]["event"] == "test", receiver.events())
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "4", "--name", 'a "b" \u2713')
        farm.wait_for_job(job)
        wait_for(lambda: len(receiver.events()) == 2, "the event")
        done = receiver.events()[1]
        expect((done["event"], done["job"], done["name"], done["state"], done["frames"], done["frames_done"]) ==
               ("job-done", job, 'a "b" \u2713', "done", 1, 1), done)
        expect(done["url"] == "%s/#/job/%d" % (page.origin, job) and abs(done["at"] - time.time()) < 60 * PATIENCE, done)
        expect(done["finished_at"] > 0 and len(done["delivery"]) == 16, done)
        path, headers, body = receiver.got[1]
        expect(path == "/hook" and headers["Content-Type"] == "application/json", headers)
        expect(headers["User-Agent"].startswith("azulejo/"), headers)
        expect(is_signed(headers, body, secret) and not is_signed(headers, body, "0" * 64), "the signature")
        farm.cli("cancel", farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000"), expect=0)
        view = listed(farm, number)
        expect((view["sent"], view["waiting"], view["failed"], view["given_up"], view["last_error"]) == (1, 0, 0, 0, ""), view)
        expect("azulejo_webhook_events_total{result=\"sent\"} 1\n" in page.get("/metrics").body.decode(), "counted")
        farm.cli("webhook", "remove", number, expect=0)
        farm.wait_for_job(farm.submit(farm.scene(), "--size", "16x16", "--spp", "8"))
        expect(farm.cli("webhook", "list", "--json", expect=0).json()["webhooks"] == [], "removed")
        expect(len(receiver.events()) == 2, receiver.events())


@tests.add
def kept_to_itself():
    """a password in an address is in no list and no log; no webhook goes to a link-local address, by any name"""
    with Farm() as farm, Receiver() as receiver:
        farm.start_coordinator()
        number, _ = add(farm, receiver.url.replace("http://", "http://render:s3cret@"))
        expect("//*@" in listed(farm, number)["url"], listed(farm, number))
        farm.cli("webhook", "test", number, expect=0)
        expect(receiver.got[0][1]["Authorization"].startswith("Basic "), receiver.got[0])
        for address in ("169.254.169.254", "[fe80::1]", "[::ffff:169.254.169.254]"):
            refused, _ = add(farm, "http://%s/latest" % address)
            result = farm.cli("webhook", "test", refused)
            expect(result.code != 0 and "link-local" in result.err, result)
        for folder, _, files in os.walk(farm.folder):
            for name in files:
                if name.endswith(".log"):
                    with open(os.path.join(folder, name), "rb") as source:
                        expect(b"s3cret" not in source.read(), name)
        with open(farm.path("store", "audit.log")) as source:
            expect("http://*@127.0.0.1" in source.read(), "the address is noted")


@tests.add
def failed():
    """a job that no worker can render fails, with the worker's words"""
    with Farm() as farm, Receiver() as receiver:
        farm.start_coordinator()
        add(farm, receiver.url)
        peer = OddPeer(farm)
        peer.say("request 2")
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "4")
        peer.grant()
        peer.say("broken code=4")
        farm.wait_for_job(job, "failed")
        event = wait_for(lambda: receiver.events() or None, "the event")[0]
        expect((event["event"], event["job"], event["state"]) == ("job-failed", job, "failed"), event)
        expect("the odd peer cannot" in event["text"], event)


@tests.add
def parked():
    """a job that kills its workers is parked, which needs a person"""
    with Farm() as farm, Receiver() as receiver:
        farm.start_coordinator()
        add(farm, receiver.url)
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "1000000")
        for death in range(4):
            die_of(farm, "machine-%d" % (death % 2))
        farm.wait_for_job(job, "parked")
        event = wait_for(lambda: receiver.events() or None, "the event")[0]
        expect(event["event"] == "job-parked" and event["job"] == job and event["text"], event)


@tests.add
def tried_again():
    """a receiver that fails, redirects or answers rubbish gets the same event again, later and later"""
    answers = {1: 500, 2: (302, {"location": "/elsewhere"})}
    times = []

    def answer(number, body):
        times.append(time.monotonic())
        return answers.get(number, 200)
    with Farm() as farm, Receiver(answer) as receiver:
        farm.start_coordinator()
        number, secret = add(farm, receiver.url)
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "4")
        farm.wait_for_job(job)
        wait_for(lambda: len(receiver.got) >= 1, "the first attempt")
        view = wait_for(lambda: (lambda v: v if v["failed"] == 1 else None)(listed(farm, number)), "its failure")
        expect("500" in view["last_error"] and view["waiting"] == 1, view)
        wait_for(lambda: len(receiver.got) >= 3, "the attempts", 30)
        view = wait_for(lambda: (lambda v: v if (v["sent"], v["waiting"]) == (1, 0) else None)(listed(farm, number)), "its end")
        expect([path for path, _, _ in receiver.got] == 3 * ["/hook"], "redirects are not followed")
        expect(len({e["delivery"] for e in receiver.events()}) == 1, receiver.events())
        expect(all(is_signed(h, b, secret) for _, h, b in receiver.got), "each is signed")
        stamps = [int(h["X-Azulejo-Timestamp"]) for _, h, _ in receiver.got]
        expect(stamps[0] < stamps[1] < stamps[2], stamps)
        expect(times[1] - times[0] > 1.5 and times[2] - times[1] > 3, times)
        expect((view["failed"], view["last_error"]) == (2, ""), view)


def stored(farm):
    """How many events the store holds."""
    with contextlib.closing(sqlite3.connect("file:%s?mode=ro" % farm.path("store", "queue.sqlite"), uri=True)) as db:
        return db.execute("SELECT count(*) FROM webhook_events").fetchone()[0]


@tests.add
def survives():
    """a coordinator killed while nobody listens, and a receiver killed in the middle: each event comes, once"""
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        port = place.getsockname()[1]
    with Farm() as farm:
        farm.start_coordinator()
        number, secret = add(farm, "http://127.0.0.1:%d/hook" % port)
        farm.start_worker()
        jobs = [farm.submit(farm.scene(), "--size", "16x16", "--spp", str(4 + k)) for k in range(3)]
        for job in jobs:
            farm.wait_for_job(job)
        wait_for(lambda: listed(farm, number)["waiting"] == 3 and listed(farm, number)["failed"] > 0, "they wait")
        wait_for(lambda: stored(farm) == 3, "the store to have them")
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(listed(farm, number)["waiting"] == 3, listed(farm, number))
        # A real program, which is killed while it holds the first request.
        program = ("import socket,sys,time\ns=socket.create_server(('127.0.0.1',%d))\nc,_=s.accept()\n"
                   "print(c.recv(99999),flush=True)\ntime.sleep(99)\n" % port)
        child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
        expect(b"POST /hook" in child.stdout.readline(), "the request")
        child.kill()
        child.wait()
        child.stdout.close()
        with Receiver(port=port) as receiver:
            wait_for(lambda: len(receiver.events()) >= 3, "the events", 60)
            expect(sorted(e["job"] for e in receiver.events()) == jobs, receiver.events())  # they may end in any order
            expect(all(is_signed(h, b, secret) for _, h, b in receiver.got), "signed, with the same secret")
            wait_for(lambda: listed(farm, number)["waiting"] == 0, "their end")
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(listed(farm, number)["waiting"] == 0, "nothing is sent again")


@tests.add
def hangs():
    """a receiver that hangs holds up neither the farm, nor the page, nor the end"""
    wait = threading.Event()
    with Farm() as farm, Receiver(lambda number, body: wait.wait(60) and 200) as receiver, Receiver() as other:
        page = Page(farm.start_coordinator())
        slow = add(farm, receiver.url)[0]
        quick = add(farm, other.url)[0]
        farm.start_worker()
        farm.wait_for_job(farm.submit(farm.scene(), "--size", "16x16", "--spp", "4"))
        wait_for(lambda: receiver.got, "its request")
        begun = time.monotonic()
        for _ in range(20):
            expect(page.get("/healthz", token="").status == 200, "it lives")
        expect(time.monotonic() - begun < 5 * PATIENCE, "the page answers")
        farm.wait_for_job(farm.submit(farm.scene(), "--size", "16x16", "--spp", "8"))
        wait_for(lambda: len(other.events()) == 2, "the other receiver's events", 60)
        expect(listed(farm, slow)["sent"] == 0 and listed(farm, quick)["sent"] >= 1, "each has its own queue")
        before = len(receiver.got)
        wait_for(lambda: len(receiver.got) > before, "a request that hangs", 60)
        begun = time.monotonic()
        expect(farm.coordinator.stop() == 0 and time.monotonic() - begun < 6 * PATIENCE, "it ends soon")
        wait.set()


@tests.add
def addresses():
    """only http and https, never the coordinator itself under whatever name, and certificates are checked"""
    with Farm() as farm, Receiver() as receiver:
        page = Page(farm.start_coordinator())
        for url in ("", "ftp://a/b", "file:///etc/passwd", "http://", "http://a b/", "javascript:1", "//a/b", "a",
                    "http://a/\u2713", "http://a/\n", "http://" + "a" * 1000, "gopher://127.0.0.1/"):
            result = farm.cli("webhook", "add", url)
            expect(result.code == 3 and ("http://HOST" in result.err or "1000 bytes" in result.err), result)
        port, farm_port = page.port, int(farm.address.rsplit(":", 1)[1])
        for url in ("http://127.0.0.1:%d/" % port, "http://localhost:%d/" % port, "http://127.1.2.3:%d/" % port,
                    "http://0.0.0.0:%d/" % port, "http://0:%d/" % port, "http://[::1]:%d/" % port,
                    "http://[::ffff:127.0.0.1]:%d/" % port, "http://%s:%d/" % (socket.gethostname(), port),
                    "http://127.0.0.1:%d/" % farm_port):
            number = add(farm, url)[0]
            result = farm.cli("webhook", "test", number)
            expect(result.code in (5, 4) and ("own" in result.err or "resolve" in result.err), result)
            expect("own" in result.err or "hostname" in url or socket.gethostname() in url, result)
            farm.cli("webhook", "remove", number, expect=0)
        requests = page.get("/metrics").body.decode()
        expect('azulejo_web_requests_total{code="4xx"} 0\n' in requests, "none of them reached the page")
        for wrong, code in ((("test", "99"), 5), (("remove", "99"), 5), (("test", "x"), 2), (("add",), 2), (("burn",), 2)):
            result = farm.cli("webhook", *wrong)
            expect(result.code == code, result)
        numbers = [add(farm, receiver.url)[0] for _ in range(16)]
        result = farm.cli("webhook", "add", receiver.url)
        expect(result.code == 3 and "16 webhooks" in result.err, result)
        for number in numbers:
            farm.cli("webhook", "remove", number, expect=0)
        cert, key = farm.path("cert.pem"), farm.path("key.pem")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-subj", "/CN=127.0.0.1", "-days", "2", "-keyout", key, "-out", cert], check=True,
                       capture_output=True)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(cert, key)
        with Receiver(tls=context) as secret:
            number = add(farm, secret.url)[0]
            result = farm.cli("webhook", "test", number)
            expect(result.code == 4 and "certificate" in result.err and not secret.got, result)


@tests.add
def by_api():
    """an admin's token may do all of it over the API, no other"""
    with Farm() as farm, Receiver() as receiver:
        page = Page(farm.start_coordinator())
        operator = farm.cli("token", "create", "--role", "operate", expect=0).out.strip()
        expect(page.post("/api/v1/webhooks", {"url": receiver.url}, token=operator).status == 403, "admins only")
        made = page.post("/api/v1/webhooks", {"url": receiver.url})
        expect(made.status == 200 and len(made.json()["secret"]) == 64, made)
        number = made.json()["webhooks"][0]["webhook"]
        tried = page.post("/api/v1/webhooks/%d/test" % number)
        expect(tried.status == 200 and receiver.events()[0]["event"] == "test", tried)
        shown = page.get("/api/v1/webhooks").json()
        expect([w["url"] for w in shown["webhooks"]] == [receiver.url] and not shown["secret"], shown)
        expect(page.request("DELETE", "/api/v1/webhooks/%d" % number).status == 200, "removed")
        expect(page.request("DELETE", "/api/v1/webhooks/%d" % number).status == 404, "gone")
        wrong = page.post("/api/v1/webhooks", {"url": "ftp://x"})
        expect(wrong.status in (400, 422) and "http" in wrong.json()["detail"], wrong)


@tests.add
def store():
    """a store that cannot be used is told after a while, and its recovery, although nothing can be stored meanwhile"""
    with Farm() as farm, Receiver() as receiver:
        disk = OddDisk(farm)
        farm.start_coordinator(env=disk.env)
        add(farm, receiver.url)
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000")
        farm.start_worker()
        disk.fail(28, "/store/")
        farm.cli("priority", job, "--to", "2")
        event = wait_for(lambda: receiver.events() or None, "the event", 60)[0]
        expect(event["event"] == "store-unusable" and event["text"], event)
        disk.work()
        wait_for(lambda: len(receiver.events()) == 2, "the recovery", 60)
        expect(receiver.events()[1]["event"] == "store-usable", receiver.events())


tests.run()
