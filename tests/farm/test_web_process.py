"""azulejo-web is a process of its own: whatever becomes of it, pictures and jobs stay what they are, and it comes back."""
import ctypes
import errno
import http.client
import json
import os
import re
import resource
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import OddDisk, SmallDisk
from farm import BIN, PATIENCE, Failure, Farm, Program, Skip, Tests, preloaded, read_bytes, wait_for
from jobs import LongJob, Outcome, expect, expect_same, wait_mid_frame, wait_slowly
from page import Page, need_page
from websocket import Closed, WebSocket

tests = Tests()
LONG = LongJob(1.5)
LIBRARIES = re.compile(r"libwebsockets|libcurl|libjansson")


def children(pid):
    with open("/proc/%d/task/%d/children" % (pid, pid), encoding="ascii") as source:
        return [int(word) for word in source.read().split()]


def name_of(pid):
    try:
        with open("/proc/%d/comm" % pid, encoding="ascii") as source:
            return source.read().strip()
    except OSError:
        return ""


def web_of(farm):
    """The number of the page's process; None: it does not run."""
    return next((p for p in children(farm.coordinator.pid) if name_of(p) == "azulejo-web"), None)


def state_of(pid):
    """"T": stopped; "": it is gone."""
    try:
        with open("/proc/%d/stat" % pid, encoding="ascii") as source:
            return source.read().rsplit(")", 1)[1].split()[0]
    except OSError:
        return ""


def start_by_hand(farm, folder):
    """A page with a key of its role, of a coordinator with --web-apart."""
    key = farm.path("web.key")
    farm.cli("keygen", "--role", "web", "--from", farm.key, "-o", key, expect=0)
    farm.programs.append(Program("web", [os.path.join(BIN, "azulejo-web"), "--coordinator", farm.address, "--web", "127.0.0.1:0",
                                         "--folder", folder, "--key", key], farm.path("web.log")))


def begin(farm, *options, env=None, by_hand=None):
    """A coordinator with its page, a worker, and the picture of an undisturbed job. by_hand: the folder of a page that is
    started so."""
    need_page()
    coordinator = farm.start_coordinator(*options, env=env)
    if by_hand:
        start_by_hand(farm, by_hand)
    page = Page(coordinator)
    farm.start_worker(threads=1)
    farm.wait_for_workers(1)
    if not LONG.spp:
        LONG.measure(farm)
    number = LONG.submit(farm)
    farm.wait_for_job(number)
    return page, Outcome(farm, number, "undisturbed")


def finish(farm, number, reference, what):
    farm.wait_for_job(number)
    expect_same(farm, Outcome(farm, number, "disturbed"), reference, what)


def answers(page):
    try:
        return page.get("/readyz", token="", limit_s=2).status == 200
    except (OSError, http.client.HTTPException):
        return False


def listen(page):
    """A WebSocket that is told what changes."""
    ws = WebSocket(page.host, "/api/v1/live", page.token)
    ws.send({"resume": None})
    return ws


def next_event(ws, name, limit_s=30):
    end = time.monotonic() + limit_s * PATIENCE
    while time.monotonic() < end:
        got = ws.receive(limit_s=1)
        if got and got[0] == "text" and json.loads(got[1])["event"] == name:
            return json.loads(got[1])
    raise Failure("no event '%s'" % name)


@tests.add
def libraries():
    """the coordinator has no library of HTTP or JSON; the page's program has no file of the store open"""
    with Farm() as farm:
        need_page()
        Page(farm.start_coordinator())
        web = web_of(farm)
        with open("/proc/%d/maps" % farm.coordinator.pid, encoding="utf-8") as source:
            expect(not LIBRARIES.search(source.read()), "a library of the page in the coordinator")
        with open("/proc/%d/maps" % web, encoding="utf-8") as source:
            expect(LIBRARIES.search(source.read()), "the libraries are in its own program")
        folder = "/proc/%d/fd" % web
        held = [os.readlink(os.path.join(folder, fd)) for fd in os.listdir(folder)]
        expect(not [f for f in held if f.startswith(farm.store) and not f.startswith(os.path.join(farm.store, "imports"))], held)
        with open("/proc/%d/status" % web, encoding="ascii") as source:
            expect("NoNewPrivs:\t1" in source.read(), "it could get privileges")
        with open("/proc/%d/limits" % web, encoding="ascii") as source:
            limits = dict(re.findall(r"^Max (core file size|address space|open files) +(\S+)", source.read(), re.M))
        expect(limits["core file size"] == "0" and limits["open files"].isdigit(), limits)
        if "address" not in os.environ.get("SANITIZE", "") and "thread" not in os.environ.get("SANITIZE", ""):
            expect(limits["address space"] == str(4 << 30), limits)
        for word in (farm.key, "azt_"):  # a secret is in no command line
            with open("/proc/%d/cmdline" % web, "rb") as source:
                expect(word.encode() not in source.read(), word)


@tests.add
def files():
    """a program that it runs for an upload reads no file of the store"""
    with Farm() as farm:
        need_page()
        seen = os.path.join(farm.store, "imports", "seen")
        program = farm.path("reader")
        with open(program, "w", encoding="utf-8") as out:
            out.write("#!/bin/sh\nfor f in web.token audit.log queue.sqlite; do\n"
                      "  if head -c 1 '%s'/$f >/dev/null 2>&1; then echo \"azulejo submit: read $f\" >&2; exit 3; fi\ndone\n"
                      "if echo x >'%s/here' 2>/dev/null; then echo 'azulejo submit: wrote' >&2; exit 3; fi\n"
                      "echo 'azulejo submit: nothing could be read' >&2\nexit 3\n" % (farm.store, farm.store))
        os.chmod(program, stat.S_IRWXU)
        page = Page(farm.start_coordinator("--client-program", program))
        number = page.post("/api/v1/imports").json()["import"]
        expect(page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % number, body=b"{}").status == 201, "an upload")
        answer = page.post("/api/v1/imports/%s" % number, {"scene": "a.gltf"})
        if "kept from this program" in farm.coordinator.log_text():
            return  # the kernel has no Landlock
        # Behind its wall (web/base/wall.h) even the script's shell cannot start.
        expect(re.search(r"nothing could be read|status 12[67]", answer.json()["detail"]), answer)
        expect(not os.path.exists(seen), "no file")


@tests.add
def every_thread():
    """no thread of it reads or writes the farm's key, the store, /etc, /run or what lies beside them, or executes a shell"""
    if os.environ.get("SANITIZE"):
        raise Skip("a sanitizer wants to be loaded first, and no fork in a signal's handler")
    with Farm() as farm:
        need_page()
        beside = farm.path("beside")
        with open(beside, "w", encoding="ascii") as out:
            out.write("x")
        may = ["r/usr/lib", "w/dev/null", "r" + os.path.join(farm.store, "imports"),
               "x" + os.path.join(os.path.abspath(BIN), "azulejo")]
        may_not = ["r" + farm.key, "r" + os.path.join(farm.store, "queue.sqlite"), "r/etc/passwd", "r/run", "r" + beside,
                   "w" + beside, "x/bin/sh"]
        page = Page(farm.start_coordinator(env={"LD_PRELOAD": preloaded("odd_reach.so"), "ODD_REACH": ":".join(may + may_not)}))
        if "kept from this program" in farm.coordinator.log_text():
            raise Skip("this kernel has no Landlock")
        number = page.post("/api/v1/imports").json()["import"]
        expect(page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % number, body=b"{}").status == 201, "an upload")
        web = web_of(farm)
        threads = [int(t) for t in os.listdir("/proc/%d/task" % web)]
        expect(len(threads) > 2, threads)
        for thread in threads:
            expect(ctypes.CDLL(None).tgkill(web, thread, signal.SIGUSR2) == 0, thread)
        said = lambda: re.findall(r"^reach (\d+) (.+) (\d+)$", farm.coordinator.log_text(), re.M)
        wait_for(lambda: len(said()) == len(threads) * len(may + may_not), "each thread's words")
        for thread, item, code in said():
            expect(int(code) == (0 if item in may else errno.EACCES), "thread %s (of %d), %s: %s" % (thread, web, item, code))
        with open("/proc/%d/oom_score_adj" % web, encoding="ascii") as source:
            expect(source.read().strip() == "1000", "the kernel ends it first")


@tests.add
def killed():
    """killed in mid-frame, the page changes no bit of the picture; it is started again where it was, and pages that
    were open go on"""
    with Farm() as farm:
        page, reference = begin(farm)
        ws = listen(page)
        next_event(ws, "begin")
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        first = web_of(farm)
        os.kill(first, signal.SIGKILL)
        try:
            while ws.receive(limit_s=10):
                pass
            raise Failure("its connections did not end")
        except (Closed, OSError):
            pass
        wait_slowly(farm, lambda: web_of(farm) not in (None, first) and answers(page), "the page to come back at its address")
        farm.workers[0].signal(signal.SIGSTOP)
        expect(page.get("/api/v1/session").json()["role"] == "admin", "the token is what it was")
        again = listen(page)
        next_event(again, "begin")
        farm.workers[0].signal(signal.SIGCONT)
        expect(str(next_event(again, "job")["data"]["job"]) == str(number), "what goes on is told")
        finish(farm, number, reference, "a page that was killed")
        log = farm.coordinator.log_text()
        expect("azulejo-web has ended (signal 9): it is started again" in log, log)
        for _ in range(3):  # again and again: each time later
            last = web_of(farm)
            os.kill(last, signal.SIGKILL)
            wait_for(lambda: web_of(farm) not in (None, last) and answers(page), "the page")
        waits = [float(s) for s in re.findall(r"it is started again in (\S+) s; jobs", farm.coordinator.log_text())]
        expect(len(waits) == 4 and waits[2] == 2 * waits[1] and waits[3] == 2 * waits[2], waits)
        expect(farm.coordinator.stop() == 0, "the coordinator's end")


@tests.add
def standing_still():
    """stopped (SIGSTOP) while a job is rendered and ends, the page changes nothing, holds up nobody, and goes on; a
    coordinator ends without waiting for it"""
    with Farm() as farm:
        page, reference = begin(farm)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        web = web_of(farm)
        os.kill(web, signal.SIGSTOP)
        wait_for(lambda: state_of(web) == "T", "it to stand still")
        began = time.monotonic()
        farm.cli("list", expect=0)
        farm.cli("token", "create", "--role", "view", "--name", "hall", expect=0)
        expect(time.monotonic() - began < 10 * PATIENCE, "a client waited for the page")
        finish(farm, number, reference, "a page that stood still")
        expect(state_of(web) in ("T", ""), "it stood still to the end, or until it was given up")
        if web_of(farm) == web:
            os.kill(web, signal.SIGCONT)
        wait_for(lambda: answers(page), "it to go on")
        expect(page.get("/api/v1/jobs/%d" % number).json()["jobs"][0]["state"] == "done", "it knows of the end")
        os.kill(web_of(farm), signal.SIGSTOP)
        began = time.monotonic()
        expect(farm.coordinator.stop() == 0, "the coordinator's end")
        expect(time.monotonic() - began < 15 * PATIENCE, "it waited for its page")


@tests.add
def held_up():
    """a page that stands still for long is killed and started again"""
    with Farm() as farm:
        need_page()
        page = Page(farm.start_coordinator())
        web = web_of(farm)
        os.kill(web, signal.SIGSTOP)
        wait_for(lambda: web_of(farm) not in (None, web) and answers(page), "another one", 90)
        expect("does not answer" in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def endless_loop():
    """a page that never comes back to its loop is killed and started again; what is rendered meanwhile has the same bits"""
    if os.environ.get("SANITIZE"):
        raise Skip("a sanitizer wants to be loaded first")
    with Farm() as farm:
        page, reference = begin(farm, env={"LD_PRELOAD": preloaded("odd_reach.so"), "ODD_REACH": "hang"})
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        web = web_of(farm)
        os.kill(web, signal.SIGUSR2)
        wait_for(lambda: not answers(page), "it to hang")
        farm.cli("list", expect=0)
        finish(farm, number, reference, "a page that hangs")
        wait_for(lambda: web_of(farm) not in (None, web) and answers(page), "another one", 90)
        expect("does not answer" in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def out_of_memory():
    """a page that gets no more memory, asked by sixty browsers, changes no bit, and answers when there is some again"""
    if os.environ.get("SANITIZE"):
        raise Skip("a sanitizer reserves addresses of its own")
    with Farm() as farm:
        page, reference = begin(farm)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        web = web_of(farm)
        with open("/proc/%d/statm" % web, encoding="ascii") as source:
            used = int(source.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        soft, hard = resource.prlimit(web, resource.RLIMIT_AS)
        resource.prlimit(web, resource.RLIMIT_AS, (used, hard))
        body = b"x" * (8 << 20)
        refused = 0
        for _ in range(60):
            try:
                upload = page.post("/api/v1/imports", limit_s=2).json().get("import")
                refused += page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % upload, body=body, limit_s=2).status >= 500
                listen(page)
            except (OSError, ValueError, AttributeError, Failure, http.client.HTTPException):
                refused += 1
        expect(refused > 0, "it had memory enough: the test shows nothing")
        farm.cli("list", expect=0)
        try:
            resource.prlimit(web, resource.RLIMIT_AS, (soft, hard))
        except ProcessLookupError:
            pass  # it has ended for want of memory
        finish(farm, number, reference, "a page without memory")
        wait_for(lambda: answers(page), "it to be back", 60)
        expect(page.get("/api/v1/jobs/%d" % number).json()["jobs"][0]["state"] == "done", "it knows of the end")


@tests.add
def strangers():
    """1,000 connections that say nothing, or nonsense, hold up no job and not the page of somebody else"""
    each, addresses = 200, ["127.0.0.%d" % i for i in range(2, 7)]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2048:
        raise Skip("2,048 descriptors are not permitted")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    with Farm() as farm:
        page, reference = begin(farm)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        web = web_of(farm)
        host, port = page.host.rsplit(":", 1)
        connections, tried = [], 0
        for address in addresses:
            for i in range(each):
                tried += 1
                try:
                    connection = socket.create_connection((host, int(port)), timeout=5, source_address=(address, 0))
                    if i % 2:
                        connection.sendall(b"\x16\x03\x01\x00\xffGET / HTTP\r\n" * (i % 7 + 1))
                    connections.append(connection)
                except OSError:
                    pass  # turned away
        expect(tried == 1000 and len(connections) > 100, "%d of %d" % (len(connections), tried))
        finish(farm, number, reference, "strangers")
        wait_for(lambda: answers(page), "the page of somebody else", 60)
        expect(page.get("/api/v1/jobs/%d" % number).json()["jobs"][0]["state"] == "done", "it knows of the end")
        for connection in connections:
            connection.close()
        expect(web_of(farm) == web, "the page was started again")


@tests.add
def full_folder():
    """an upload that fills the page's disk is refused with the reason, holds up no job, and later ones come again"""
    with Farm() as farm, SmallDisk(farm, 4 << 20) as disk:
        if not disk:
            raise Skip("needs root, to mount a tmpfs")
        page, reference = begin(farm, "--web-apart", by_hand=disk)
        number = LONG.submit(farm)
        wait_mid_frame(farm, number)
        upload = wait_for(lambda: page.post("/api/v1/imports").json().get("import"), "the page's own connection")
        answer = page.request("PUT", "/api/v1/imports/%s/files/a.bin" % upload, body=b"x" * (8 << 20))
        expect(answer.status == 503 and "nearly full" in answer.json()["detail"], answer)
        expect(page.get("/api/v1/jobs/%d" % number).status == 200, "it answers")
        finish(farm, number, reference, "a full folder")
        expect(page.request("DELETE", "/api/v1/imports/%s" % upload).status < 300, "the upload goes")
        upload = page.post("/api/v1/imports").json()["import"]
        expect(page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % upload, body=read_bytes(farm.scene())).status == 201, "a later one")


@tests.add
def full_in_mid_write():
    """an upload whose disk fills up while it comes is refused with the reason and leaves nothing; a later one comes"""
    with Farm() as farm:
        need_page()
        disk = OddDisk(farm)
        page = Page(farm.start_coordinator(env=disk.env))
        imports = os.path.join(farm.store, "imports")
        held = lambda: sum(os.path.getsize(os.path.join(folder, f)) for folder, _, files in os.walk(imports) for f in files)
        number = page.post("/api/v1/imports").json()["import"]
        path, half = "/api/v1/imports/%s/files/a.bin" % number, b"x" * (4 << 20)
        connection = http.client.HTTPConnection(page.host, timeout=60)
        connection.putrequest("PUT", path)
        connection.putheader("Authorization", "Bearer " + page.token)
        connection.putheader("Content-Length", str(2 * len(half)))
        connection.endheaders()
        connection.send(half)
        wait_for(lambda: held() > 0, "the first half")
        disk.fail(errno.ENOSPC, "/imports/")
        try:
            connection.send(half)
        except OSError:
            pass  # it does not read the rest
        answer = connection.getresponse()
        words = answer.read().decode()
        connection.close()
        expect(answer.status == 503 and "No space left on device" in words, (answer.status, words))
        disk.work()
        wait_for(lambda: held() == 0, "what came of it to be removed")
        expect(page.request("PUT", path, body=half).status == 201, "a later one")


@tests.add
def with_its_coordinator():
    """killed, a coordinator leaves no page behind"""
    with Farm() as farm:
        need_page()
        page = Page(farm.start_coordinator())
        web = web_of(farm)
        farm.coordinator.kill()
        wait_for(lambda: name_of(web) != "azulejo-web" or state_of(web) == "Z", "the page to end")
        expect(not answers(page), "it answers")


@tests.add
def by_hand():
    """started by hand, with a key of its role, it serves a coordinator with --web-apart, also after that was
    started again"""
    with Farm() as farm:
        need_page()
        farm.start_coordinator("--web-apart")
        key = farm.path("web.key")
        farm.cli("keygen", "--role", "web", "--from", farm.key, "-o", key, expect=0)
        wrong = farm.path("client.key")
        farm.cli("keygen", "--role", "client", "--from", farm.key, "-o", wrong, expect=0)
        by_name = "localhost:" + farm.address.rsplit(":", 1)[1]  # which it must look up again and again
        words = [os.path.join(BIN, "azulejo-web"), "--coordinator", by_name, "--web", "127.0.0.1:0", "--folder",
                 farm.path("page"), "--key"]
        refused = subprocess.run(words + [wrong], capture_output=True, text=True, check=False)
        expect(refused.returncode == 5 and "role web" in refused.stderr, refused)
        web = Program("web", words + [key], farm.path("web.log"))
        farm.programs.append(web)
        page = Page(farm.coordinator)
        expect(page.get("/api/v1/farm").json()["address"] == farm.address, "the farm")
        secret = page.post("/api/v1/tokens", {"name": "desk", "role": "view"}).json()["secret"]
        expect(page.get("/api/v1/jobs", token=secret).status == 200, "a new token is known at once")
        ws = listen(page)
        next_event(ws, "begin")
        farm.coordinator.kill()
        wait_for(lambda: page.get("/readyz", token="").status == 503, "it to notice")
        farm.restart_coordinator("--web-apart")
        next_event(ws, "reset")
        wait_for(lambda: answers(page), "it to be back")
        expect(page.get("/api/v1/jobs", token=secret).status == 200, "the token is what it was")
        number = wait_for(lambda: page.post("/api/v1/imports").json().get("import"), "its own connection to be back")
        expect(page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % number, body=read_bytes(farm.scene())).status == 201, "an upload")
        answer = page.post("/api/v1/imports/%s" % number, {"scene": "a.gltf", "options": ["--size", "32x24", "--spp", "1"]})
        expect(answer.status in (200, 201, 202), answer)
        expect(web.stop() == 0, "its end")
        farm.cli("list", expect=0)


@tests.add
def killed_before_it_listens():
    """a page's program that is killed while it starts is started again: the coordinator, which was asked for a page, goes on"""
    with Farm() as farm:
        need_page()
        alone, program = farm.path("azulejo-coordinator"), farm.path("azulejo-web")
        shutil.copy(os.path.join(BIN, "azulejo-coordinator"), alone)
        with open(program, "w", encoding="utf-8") as out:
            out.write("#!/bin/sh\nif mkdir '%s'; then kill -9 $$; fi\nexec '%s' \"$@\"\n" %
                      (farm.path("was-here"), os.path.join(BIN, "azulejo-web")))
        os.chmod(program, 0o755)
        page = Page(farm.start_coordinator("--web", "127.0.0.1:0", program=alone))
        expect(page.get("/healthz").status == 200, "no page")
        expect("ended before it listened (signal 9): it is started again" in farm.coordinator.log_text(), farm.coordinator.log_text())
        with open(program, "w", encoding="utf-8") as out:
            out.write("#!/bin/sh\nkill -9 $$\n")
        farm.coordinator.stop()
        try:
            farm.start_coordinator("--web", "127.0.0.1:0", program=alone).wait_line("page: ")
            raise AssertionError("it started")
        except Failure as failure:
            expect("signal 9" in str(failure), failure)


@tests.add
def missing():
    """without its program a page that was asked for is an error, else only a warning"""
    with Farm() as farm:
        need_page()
        alone = farm.path("azulejo-coordinator")
        shutil.copy(os.path.join(BIN, "azulejo-coordinator"), alone)
        farm.start_coordinator(program=alone)
        farm.cli("list", expect=0)
        wait_for(lambda: "no page: " in farm.coordinator.log_text(), "the warning")
        farm.coordinator.stop()
        try:
            farm.start_coordinator("--web", "127.0.0.1:0", program=alone)
            farm.coordinator.wait_line("page: ")
            raise AssertionError("it started")
        except Failure as failure:
            expect("azulejo-web" in str(failure), failure)


@tests.add
def hangs_at_the_start():
    """a page's program that never answers: the farm runs meanwhile, over a restart, and ends when it is told to"""
    with Farm() as farm:
        need_page()
        alone = farm.path("azulejo-coordinator")
        shutil.copy(os.path.join(BIN, "azulejo-coordinator"), alone)
        with open(farm.path("azulejo-web"), "w", encoding="ascii") as script:
            script.write("#!/bin/sh\nexec sleep 1000\n")
        os.chmod(farm.path("azulejo-web"), 0o755)
        farm.start_coordinator(program=alone)
        farm.start_worker(threads=1)
        job = farm.submit(farm.scene(), "--size", "32x32", "--spp", "100000")
        wait_for(lambda: farm.job(job)["samples_done"] > 32 * 32 * 64, "samples")
        expect(farm.coordinator.stop() == 0, "SIGTERM")
        farm.start_coordinator(program=alone, listen=farm.address)
        expect(farm.job(job)["samples_done"] > 32 * 32 * 64, "the samples of before")
        expect("the page is at" not in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def another_farms_key():
    """by hand with the key of another farm it says what is wrong, and goes on trying"""
    with Farm() as farm:
        need_page()
        farm.start_coordinator("--web-apart")
        farm.cli("keygen", "-o", "other.key", expect=0)
        farm.cli("keygen", "--role", "web", "--from", "other.key", "-o", "web.key", expect=0)
        web = Program("azulejo-web", [os.path.join(BIN, "azulejo-web"), "--coordinator", farm.address, "--web", "127.0.0.1:0",
                                      "--key", farm.path("web.key")], farm.path("web.log"))
        farm.programs.append(web)
        wait_for(lambda: "is not of this farm" in farm.coordinator.log_text(), "the coordinator's reason")
        wait_for(lambda: " warn azulejo-web: the coordinator cannot be reached: " in web.log_text(), "its own")
        expect("belongs to another farm" in web.log_text() and web.process.poll() is None, web.log_text())


@tests.add
def hangs_when_started_again():
    """a page's program that is started again and never answers is killed in its turn"""
    with Farm() as farm:
        need_page()
        alone, web, real = farm.path("azulejo-coordinator"), farm.path("azulejo-web"), os.path.join(BIN, "azulejo-web")
        shutil.copy(os.path.join(BIN, "azulejo-coordinator"), alone)
        shutil.copy(real, web)
        farm.start_coordinator("--web", "127.0.0.1:0", program=alone)
        farm.coordinator.wait_line("page: ")
        first = web_of(farm)
        with open(web + ".new", "w", encoding="ascii") as script:
            script.write("#!/bin/sh\nexec sleep 1000\n")
        os.chmod(web + ".new", 0o755)
        os.rename(web + ".new", web)
        os.kill(first, signal.SIGKILL)
        wait_for(lambda: "sleep" in map(name_of, children(farm.coordinator.pid)), "the one that hangs")
        shutil.copy(real, web + ".new")
        os.rename(web + ".new", web)
        wait_for(lambda: farm.coordinator.log_text().count("azulejo-coordinator: the page is at") == 2, "the page again")


if __name__ == "__main__":
    tests.run()
