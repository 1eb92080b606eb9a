#!/usr/bin/env python3
"""--on-event: what its program gets, and what becomes of events when it fails, hangs, is killed or missing; and the program
that posts them, with receivers that fail, hang and are killed."""
import contextlib
import hashlib
import hmac
import json
import os
import re
import signal
import socket
import sqlite3
import ssl
import subprocess
import sys
import threading
import time

from disk import OddDisk
from farm import BIN, Farm, PATIENCE, ROOT, Tests, wait_for
from jobs import expect
from odd import OddPeer, die_of
from page import Page
from receiver import Receiver

tests = Tests()
SECRET = "0123456789abcdef" * 4


class Program:
    """A program in the farm's folder. `body` is Python: `event` is what it read, `say(text)` keeps a line that runs() has."""

    def __init__(self, farm, body="say(event['event'])", name="on-event"):
        self.path, self.said = farm.path(name), farm.path(name + ".said")
        with open(self.path, "w") as file:
            file.write("#!%s\nimport json, os, signal, sys, time\nSAID = %r\n"
                       "def say(what):\n    with open(SAID, 'a') as out:\n        out.write(json.dumps(what) + chr(10))\n"
                       "def runs():\n    return len(open(SAID).readlines()) if os.path.exists(SAID) else 0\n"
                       "text = sys.stdin.read()\nevent = json.loads(text)\n%s\n" % (sys.executable, self.said, body))
        os.chmod(self.path, 0o755)

    def runs(self):
        if not os.path.exists(self.said):
            return []
        with open(self.said) as source:
            return [json.loads(line) for line in source.read().split("\n")[:-1]]

    def wait_for(self, count, limit_s=60):
        wait_for(lambda: len(self.runs()) >= count, "%d runs" % count, limit_s)
        return self.runs()


def poster(farm, url):
    """A copy of deploy/on-event/post.py that posts there."""
    conf, path = farm.path("post.conf"), farm.path("post")
    with open(os.open(conf, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
        file.write("%s\n%s\n" % (url, SECRET))
    with open(os.path.join(ROOT, "deploy/on-event/post.py")) as source:
        text = source.read()
    expect('\nFILE = "/etc/azulejo/on-event"\n' in text, "the file's name is in its head")
    with open(path, "w") as file:
        file.write(text.replace("/etc/azulejo/on-event", conf, 1))
    os.chmod(path, 0o755)
    return path


def counts(farm):
    view = farm.cli("show", "--farm", "--json", expect=0).json()
    return tuple(int(view["events_" + name]) for name in ("taken", "waiting", "failed", "dropped"))


def wait_for_counts(farm, wanted, limit_s=60):
    wait_for(lambda: counts(farm) == wanted, "taken, waiting, failed, dropped to be %s, not %s" % (wanted, counts(farm)), limit_s)


def stored(farm):
    """How many events wait in the store."""
    with contextlib.closing(sqlite3.connect("file:%s?mode=ro" % farm.path("store", "queue.sqlite"), uri=True)) as db:
        return db.execute("SELECT count(*) FROM waiting_events").fetchone()[0]


def render(farm, *options):
    job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "4", *options)
    farm.wait_for_job(job)
    return job


def is_signed(headers, body, at_most_s=60):
    stamp = headers["X-Azulejo-Timestamp"]
    now = int(subprocess.run(["date", "+%s"], env={"PATH": os.environ["PATH"]}, capture_output=True, check=True).stdout)
    expect(abs(now - int(stamp)) < at_most_s * PATIENCE, headers)  # an event's program has no LD_PRELOAD either
    right = hmac.new(SECRET.encode(), stamp.encode() + b"." + body, hashlib.sha256).hexdigest()
    return hmac.compare_digest(headers["X-Azulejo-Signature"], "sha256=" + right)


def free_port():
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        return place.getsockname()[1]


@tests.add
def told():
    """a job that is done, but not one that was cancelled: one JSON object, once; counted and logged with its exit status"""
    with Farm() as farm:
        program = Program(farm, "say(text)\nsys.stderr.write('looked\\nall is \\x1b[1mwell\\n\\n')")
        page = Page(farm.start_coordinator("--on-event", program.path))
        farm.start_worker()
        job = render(farm, "--name", 'a "b" \u2713')
        text, = program.wait_for(1)
        done = json.loads(text)
        expect(text.count("\n") == 1 and text.endswith("\n"), "a line")
        expect((done["event"], done["job"], done["name"], done["state"], done["frames"], done["frames_done"]) ==
               ("job-done", job, 'a "b" \u2713', "done", 1, 1), done)
        expect(done["url"] == "%s/#/job/%d" % (page.origin, job) and abs(done["at"] - time.time()) < 60 * PATIENCE, done)
        expect(done["finished_at"] > 0 and done["submitted_at"] > 0 and len(done["delivery"]) == 16 and done["owner"], done)
        wait_for_counts(farm, (1, 0, 0, 0))
        log = farm.coordinator.log_text()
        expect(re.search(r"%s, for job-done of job %d, delivery %s: exit status 0: all is  \[1mwell\n" % (
            re.escape(program.path), job, done["delivery"]), log), log)
        shown = farm.cli("show", "--farm", expect=0).out
        expect("for %s: 1 taken, 0 wait, 0 failed, 0 dropped" % program.path in " ".join(shown.split()), shown)
        farm.cli("cancel", farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000"), expect=0)
        render(farm)
        wait_for_counts(farm, (2, 0, 0, 0))
        metrics = page.get("/metrics").body.decode()
        expect('azulejo_events_total{result="taken"} 2\n' in metrics and "azulejo_events_waiting 0\n" in metrics, metrics)
        expect(len(program.runs()) == 2 and len({json.loads(text)["delivery"] for text in program.runs()}) == 2, program.runs())
        wait_for(lambda: stored(farm) == 0, "none to wait")


@tests.add
def alone():
    """the program has no key, no argument, three descriptors, four variables, no ignored or blocked signal, a session of
    its own"""
    with Farm() as farm:
        program = Program(farm, "say([sys.argv[1:], sorted(os.environ), sorted(map(int, os.listdir('/proc/self/fd')))[:-1],\n"
                          "os.getsid(0) == os.getpid(), os.path.samefile('/proc/self/fd/1', '/dev/null'), os.environ['TZ']])")
        shell = farm.path("shell")  # Python ignores some signals itself
        with open(shell, "w") as file:
            file.write("#!/bin/sh\ngrep -E 'Sig(Blk|Ign)' /proc/self/status >'%s.signals'\nexec '%s'\n" % (shell, program.path))
        os.chmod(shell, 0o755)
        farm.start_coordinator("--on-event", shell, prefix=("sh", "-c", "exec 7</; exec \"$@\"", "sh"),
                               env={"AZULEJO_KEY": farm.key, "SECRET": "x", "TZ": "UTC", "LANG": "C.UTF-8", "HOME": farm.folder})
        farm.start_worker()
        render(farm)
        arguments, names, open_files, leads, drops, zone = program.wait_for(1)[0]
        # A shell adds some names itself.
        expect(arguments == [] and set(names) - {"PWD", "OLDPWD", "SHLVL", "_"} == {"PATH", "HOME", "LANG", "TZ"} and zone == "UTC", (arguments, names))
        expect(open_files == [0, 1, 2] and leads and drops, (open_files, leads, drops))
        with open(shell + ".signals") as source:
            masks = re.findall(r"\t([0-9a-f]+)", source.read())
        expect([int(mask, 16) & ~(3 << 31) for mask in masks] == [0, 0], masks)  # 32 and 33 are the C library's own


@tests.add
def refused():
    """a program that is missing, no file, or not executable is refused at the start: the path and what to do"""
    with Farm() as farm:
        plain = farm.path("plain")
        with open(plain, "w"):
            pass
        os.chmod(plain, 0o644)
        for path, words in ((farm.path("none"), "name a program"), (farm.folder, "is no file"), (plain, "chmod +x")):
            result = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--listen", "127.0.0.1:0", "--key", farm.key, "--store", farm.path("store"), "--no-web",
                                     "--on-event", path], capture_output=True, text=True, timeout=60)
            expect(result.returncode == 3 and path in result.stderr and words in result.stderr, result)


@tests.add
def failed():
    """a job that no worker can render fails, with the worker's words"""
    with Farm() as farm:
        program = Program(farm, "say(event)")
        farm.start_coordinator("--on-event", program.path)
        peer = OddPeer(farm)
        peer.say("request 2")
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "4")
        peer.grant()
        peer.say("broken code=4")
        farm.wait_for_job(job, "failed")
        event = program.wait_for(1)[0]
        expect((event["event"], event["job"], event["state"]) == ("job-failed", job, "failed"), event)
        expect("the odd peer cannot" in event["text"], event)


@tests.add
def parked():
    """a job that kills its workers is parked, which needs a person; without a page there is no url"""
    with Farm() as farm:
        program = Program(farm, "say(event)")
        farm.start_coordinator("--on-event", program.path, "--no-web")
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "1000000")
        for death in range(4):
            die_of(farm, "machine-%d" % (death % 2))
        farm.wait_for_job(job, "parked")
        event = program.wait_for(1)[0]
        expect(event["event"] == "job-parked" and event["job"] == job and event["text"] and "url" not in event, event)


@tests.add
def store():
    """a store that cannot be used is told after a while, and its recovery, although nothing can be stored meanwhile"""
    with Farm() as farm:
        program = Program(farm, "say(event)")
        disk = OddDisk(farm)
        farm.start_coordinator("--on-event", program.path, env=disk.env)
        job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "1000000")
        farm.start_worker()
        disk.fail(28, "/store/")
        farm.cli("priority", job, "--to", "2")
        event = program.wait_for(1)[0]
        expect(event["event"] == "store-unusable" and event["text"], event)
        disk.work()
        expect(program.wait_for(2)[1]["event"] == "store-usable", program.runs())
        wait_for_counts(farm, (2, 0, 0, 0))
        wait_for(lambda: stored(farm) == 0, "none to wait")


@tests.add
def ends():
    """status 75 and a signal bring the same event again, later and later, before any other; another status does not"""
    with Farm() as farm:
        program = Program(farm, "say([event['job'], event['delivery'], time.monotonic()])\nn = runs()\n"
                          "if n == 1: sys.exit(75)\nif n == 2: os.kill(os.getpid(), signal.SIGKILL)\n"
                          "if n == 4: print('no such room', file=sys.stderr); sys.exit(9)")
        farm.start_coordinator("--on-event", program.path)
        farm.start_worker()
        jobs = [render(farm) for _ in range(3)]
        runs = program.wait_for(5)
        expect([job for job, _, _ in runs] == [jobs[0]] * 3 + jobs[1:], runs)
        expect(len({delivery for _, delivery, _ in runs[:3]}) == 1, "the same event")
        expect(runs[1][2] - runs[0][2] > 1.9 and runs[2][2] - runs[1][2] > 3.9, runs)
        wait_for_counts(farm, (2, 0, 1, 0))
        log = farm.coordinator.log_text()
        for words in ("exit status 75; it is run again in 2 s", "ended by signal 9; it is run again in 4 s",
                      "exit status 9: no such room; the event does not come again"):
            expect(words in log, (words, log))
        wait_for(lambda: stored(farm) == 0, "none to wait")


@tests.add
def seen():
    """how a run failed, with the program's words, is shown to admins alone; the counts to all"""
    with Farm() as farm:
        program = Program(farm, "sys.exit('no such room')")
        page = Page(farm.start_coordinator("--on-event", program.path))
        viewer = farm.cli("token", "create", "--role", "view", expect=0).out.strip()
        farm.start_worker()
        render(farm)
        wait_for_counts(farm, (0, 0, 1, 0))
        expect("exit status 1: no such room" in farm.cli("show", "--farm", expect=0).out, "said")
        for token, words in ((page.token, "exit status 1: no such room"), (viewer, "")):
            shown = page.get("/api/v1/store", token=token).json()
            expect((shown["events_trouble"], int(shown["events_failed"]), shown["on_event"]) == (words, 1, program.path), shown)


@tests.add
def survives():
    """a coordinator killed while events wait: each comes, once, in order; a program that is gone is waited for"""
    with Farm() as farm:
        program = Program(farm, "say(event['job'])\nsys.exit(0 if os.path.exists(SAID + '.go') else 75)")
        farm.start_coordinator("--on-event", program.path)
        farm.start_worker()
        jobs = [render(farm) for _ in range(3)]
        program.wait_for(1)
        wait_for(lambda: stored(farm) == 3, "the store to have them")
        farm.coordinator.kill()
        farm.restart_coordinator("--on-event", program.path)
        expect(counts(farm) == (0, 3, 0, 0), counts(farm))
        os.rename(program.path, program.path + ".away")
        wait_for(lambda: "cannot be run: No such file" in farm.coordinator.log_text(), "it to be missed")
        with open(program.said + ".go", "w"):
            pass
        os.unlink(program.said)
        os.rename(program.path + ".away", program.path)
        program.wait_for(3)
        wait_for_counts(farm, (3, 0, 0, 0))
        expect(program.runs() == jobs, program.runs())
        wait_for(lambda: stored(farm) == 0, "none to wait")
        farm.coordinator.kill()
        farm.restart_coordinator("--on-event", program.path)
        expect(counts(farm) == (0, 0, 0, 0) and program.runs() == jobs, "nothing comes again")


@tests.add
def webhooks_are_gone():
    """a store with webhooks opens; one line says what to do"""
    with Farm() as farm:
        program = Program(farm)
        farm.start_coordinator()
        farm.start_worker()
        job = render(farm)
        farm.coordinator.stop()

        def as_before(db):
            db.execute("DROP TABLE waiting_events")
            db.execute("CREATE TABLE webhooks (number INTEGER PRIMARY KEY AUTOINCREMENT, url TEXT NOT NULL, secret BLOB NOT NULL,"
                       " made_by TEXT NOT NULL, made_at INTEGER NOT NULL)")
            db.execute("CREATE TABLE webhook_events (id INTEGER PRIMARY KEY AUTOINCREMENT, webhook INTEGER NOT NULL"
                       " REFERENCES webhooks(number) ON DELETE CASCADE, at INTEGER NOT NULL, body TEXT NOT NULL)")
            for number in (1, 2):
                db.execute("INSERT INTO webhooks VALUES (?, 'http://u:s3cret@127.0.0.1:9/', x'00', 'ana', 1)", (number,))
                db.execute("INSERT INTO webhook_events (webhook, at, body) VALUES (?, 1, '{}')", (number,))
        farm.edit_store(as_before)
        farm.restart_coordinator("--on-event", program.path)
        log = farm.coordinator.log_text()
        expect(len(re.findall("had 2 webhooks.*--on-event PROGRAM", log)) == 1 and "s3cret" not in log, log)
        expect(farm.job(job)["state"] == "done", "the job is there")
        render(farm)
        program.wait_for(1)
        wait_for_counts(farm, (1, 0, 0, 0))  # once the program has ended
        with contextlib.closing(sqlite3.connect("file:%s?mode=ro" % farm.path("store", "queue.sqlite"), uri=True)) as db:
            expect(not db.execute("SELECT name FROM sqlite_master WHERE name LIKE '%webhook%'").fetchall(), "no tables")
        farm.coordinator.stop()
        farm.restart_coordinator()
        expect("webhook" not in farm.coordinator.log_text(), "said once")
        result = farm.cli("webhook", "list")
        expect(result.code == 2, result)


@tests.add
def hangs():
    """a program that hangs holds up neither the farm, nor the page, nor the end; its event comes again after a restart"""
    with Farm() as farm:
        program = Program(farm, "say([event['job'], os.getpid()])\n"
                          "signal.signal(signal.SIGTERM, (lambda *_: sys.exit(1)) if os.fork() else signal.SIG_IGN)\nfor _ in range(12000):\n    if os.path.exists(SAID + '.go'): break\n    time.sleep(0.01)")
        page = Page(farm.start_coordinator("--on-event", program.path))
        farm.start_worker()
        job = render(farm)
        _, process = program.wait_for(1)[0]
        begun = time.monotonic()
        for _ in range(20):
            expect(page.get("/healthz", token="").status == 200, "it lives")
        expect(time.monotonic() - begun < 5 * PATIENCE, "the page answers")
        other = render(farm)
        expect(len(program.runs()) == 1, "one at a time")
        begun = time.monotonic()
        expect(farm.coordinator.stop() == 0 and time.monotonic() - begun < 6 * PATIENCE, "it ends soon")

        def group_is_gone():
            try:
                os.killpg(process, 0)
            except ProcessLookupError:
                return True
            return False
        wait_for(group_is_gone, "the program and its child to be gone")
        with open(program.said + ".go", "w"):
            pass
        farm.restart_coordinator("--on-event", program.path)
        wait_for_counts(farm, (2, 0, 0, 0))
        expect([number for number, _ in program.runs()] == [job, job, other], program.runs())


@tests.add
def time_limit():
    """after 30 s a program gets SIGTERM, then SIGKILL, and its event is kept"""
    with Farm() as farm:
        program = Program(farm, "signal.signal(signal.SIGTERM, lambda *_: say('asked'))\nsay('begun')\n"
                          "while runs() < 3: time.sleep(0.05)")
        farm.start_coordinator("--on-event", program.path)
        farm.start_worker()
        render(farm)
        program.wait_for(1)
        begun = time.monotonic()
        expect(program.wait_for(2)[:2] == ["begun", "asked"], program.runs())
        expect(28 < time.monotonic() - begun, time.monotonic() - begun)
        wait_for_counts(farm, (1, 0, 0, 0))
        expect("ended by signal 9, after its 30 s; it is run again in 2 s" in farm.coordinator.log_text(), "killed")


@tests.add
def bounded():
    """1,000 events wait at most: the oldest go, which is counted and logged, and the rest comes in order"""
    with Farm() as farm:
        program, go, said = farm.path("on-event"), farm.path("go"), farm.path("said")
        with open(program, "w") as file:  # a shell starts sooner than Python
            file.write('#!/bin/sh\n[ -e "%s" ] || exit 75\nsed \'s/.*"job": \\([0-9]*\\).*/\\1/\' >>"%s"\n' % (go, said))
        os.chmod(program, 0o755)
        farm.start_coordinator("--on-event", program)
        farm.start_worker()
        job = render(farm)
        wait_for(lambda: stored(farm) == 1, "the store to have it")
        farm.coordinator.stop()

        def many(db):
            (text,) = db.execute("SELECT json FROM waiting_events").fetchone()
            for k in range(2, 1001):
                db.execute("INSERT INTO waiting_events VALUES (?, 0, ?)", (k, text.replace('"job": %d' % job, '"job": %d' % (1000 + k))))
        farm.edit_store(many)
        farm.restart_coordinator("--on-event", program)
        expect(counts(farm) == (0, 1000, 0, 0), counts(farm))
        others = [render(farm) for _ in range(3)]
        wait_for_counts(farm, (0, 1000, 0, 3))
        wait_for(lambda: "1000 events wait for" in farm.coordinator.log_text(), "the log to say it")
        with open(go, "w"):
            pass
        wait_for_counts(farm, (1000, 0, 0, 3), 300)
        with open(said) as source:
            runs = [int(line) for line in source]
        expect(runs[-3:] == others and runs[:-3] == sorted(runs[:-3]) and len(runs) == 1000, (len(runs), runs[:3], runs[-5:]))


@tests.add
def posts():
    """deploy/on-event/post.py posts each event, signed, in order, once; a password goes to the receiver and to no log"""
    with Farm() as farm, Receiver() as receiver:
        program = poster(farm, receiver.url.replace("http://", "http://render:s3cret@"))
        farm.start_coordinator("--on-event", program)
        farm.start_worker()
        jobs = [render(farm) for _ in range(3)]
        wait_for_counts(farm, (3, 0, 0, 0))
        expect([event["job"] for event in receiver.events()] == jobs, receiver.events())
        for path, headers, body in receiver.got:
            expect(path == "/hook" and headers["Content-Type"] == "application/json" and is_signed(headers, body), headers)
            expect(not is_signed(headers, body + b" ") and headers["User-Agent"].startswith("azulejo"), headers)
            expect(headers["Authorization"].startswith("Basic "), headers)
        for folder, _, files in os.walk(farm.folder):
            for name in files:
                if name.endswith(".log"):
                    with open(os.path.join(folder, name), "rb") as source:
                        text = source.read()
                    expect(b"s3cret" not in text and SECRET.encode() not in text, name)


@tests.add
def posts_again():
    """a receiver that fails, redirects or is not there gets the same event again, each time signed; one killed in the middle, too"""
    answers = {1: 500, 2: (302, {"location": "/elsewhere"})}
    port = free_port()
    with Farm() as farm:
        farm.start_coordinator("--on-event", poster(farm, "http://127.0.0.1:%d/hook" % port))
        farm.start_worker()
        # A real program, which is killed while it holds the first request.
        text = ("import socket,sys,time\ns=socket.create_server(('127.0.0.1',%d))\nprint('here',flush=True)\nc,_=s.accept()\n"
                "print(c.recv(99999),flush=True)\ntime.sleep(99)\n" % port)
        child = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
        expect(child.stdout.readline() == b"here\n", "it listens")
        jobs = [render(farm) for _ in range(2)]
        expect(b"POST /hook" in child.stdout.readline(), "the request")
        child.kill()
        child.wait()
        child.stdout.close()
        with Receiver(lambda number, body: answers.get(number, 200), port=port) as receiver:
            wait_for_counts(farm, (2, 0, 0, 0))
            expect([path for path, _, _ in receiver.got] == 4 * ["/hook"], "redirects are not followed")
            expect([event["job"] for event in receiver.events()] == [jobs[0]] * 3 + [jobs[1]], receiver.events())
            expect(len({event["delivery"] for event in receiver.events()}) == 2, receiver.events())
            expect(all(is_signed(headers, body) for _, headers, body in receiver.got), "each is signed")
            stamps = [int(headers["X-Azulejo-Timestamp"]) for _, headers, _ in receiver.got]
            expect(stamps[0] < stamps[1] < stamps[2], stamps)
        log = farm.coordinator.log_text()
        for words in ("exit status 75: the receiver answered 500", "exit status 75: the receiver answered 302"):
            expect(words in log, (words, log))


def post_alone(program, body=b'{"event": "test"}\n'):
    return subprocess.run([program], input=body, capture_output=True, timeout=60 * PATIENCE, env={"PATH": os.environ["PATH"],
                                                                                                  "http_proxy": "http://127.0.0.1:9"})


@tests.add
def posts_by_hand():
    """by hand it sends a test; a file that others can read, that lacks a line, or a certificate that is not good is refused"""
    with Farm() as farm, Receiver() as receiver:
        program = poster(farm, receiver.url)
        result = post_alone(program)
        expect(result.returncode == 0 and not result.stderr and receiver.events() == [{"event": "test"}], result)
        conf = farm.path("post.conf")
        os.chmod(conf, 0o604)
        result = post_alone(program)
        expect(result.returncode == 75 and b"chmod 600" in result.stderr and len(receiver.got) == 1, result)
        for url in ("ftp://a/b", "http://", "http://a/\u2713", "javascript:1", "//a/b", receiver.url + "\nx", "http://a:99999/"):
            result = post_alone(poster(farm, url))
            expect(result.returncode == 75 and result.stderr.count(b"\n") == 1 and SECRET.encode() not in result.stderr, result)
        os.unlink(conf)
        result = post_alone(program)
        expect(result.returncode == 75 and b"No such file" in result.stderr, result)
        cert, key = farm.path("cert.pem"), farm.path("key.pem")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-subj", "/CN=127.0.0.1", "-days", "2", "-keyout", key, "-out", cert], check=True,
                       capture_output=True)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(cert, key)
        with Receiver(tls=context) as secret:
            result = post_alone(poster(farm, secret.url))
            expect(result.returncode == 75 and b"certificate" in result.stderr and not secret.got, result)


@tests.add
def posts_slowly():
    """a receiver that hangs costs an attempt 10 s, and the farm nothing"""
    wait = threading.Event()
    with Farm() as farm, Receiver(lambda number, body: (number > 1 or wait.wait(60 * PATIENCE)) and 200) as receiver:
        farm.start_coordinator("--on-event", poster(farm, receiver.url))
        farm.start_worker()
        job = render(farm)
        wait_for(lambda: receiver.got, "its request")
        other = render(farm)
        wait_for_counts(farm, (2, 0, 0, 0))
        wait.set()
        expect([event["job"] for event in receiver.events()] == [job, job, other], receiver.events())
        expect("exit status 75: timed out" in farm.coordinator.log_text(), farm.coordinator.log_text())


tests.run()
