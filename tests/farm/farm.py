"""A real farm on the loopback address, for tests: processes, sockets and files are all real.

    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--threads", "1")
        job = farm.submit(farm.scene(), "--size", "32x32", "--spp", "4")
        farm.wait_for_job(job, "done")

Everything lives in one temporary folder and dies with the `with` block. Nothing here sleeps
for a guess: wait_for() looks again and again until a deadline. BUILD names the build tree;
sanitizer builds are slower, so every deadline is multiplied by FARM_PATIENCE (or 5 in a
build tree whose name tells of a sanitizer).
"""
import atexit
import base64
import contextlib
import json
import os
import random
import re
import select
import shutil
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import traceback

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
BIN = os.path.join(BUILD, "bin")
SOUND = BIN  # a test may put faulty programs in its place
RESTING = os.path.join(BUILD, "tests", "farm", "resting")
PATIENCE = float(os.environ.get(
    "FARM_PATIENCE", 5 if re.search("address|thread|undefined|debug", BUILD) else 1))
SANITIZED = bool(re.search("address|thread|undefined", BUILD))  # memory says nothing then


def preloaded(name):
    """The path of a library of this folder for LD_PRELOAD, which parts paths at spaces and colons."""
    path = os.path.join(BUILD, "tests", "farm", name)
    if not re.search("[ :]", path) or not os.path.exists(path):
        return path
    folder = tempfile.mkdtemp(prefix="azulejo-preload-", dir="/var/tmp")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return shutil.copy(path, folder)


# What is late, by so much, to show which tests count on a moment (make steady LATE=): "database" (its changes are written
# later), "sync" (fsync and fdatasync begin later), "answer" (a test learns its answers later, while the farm goes on).
LATE, LATE_MS = os.environ.get("FARM_LATE"), {"database": 300, "sync": 100, "answer": 300}
if LATE in ("database", "sync"):
    os.environ["LD_PRELOAD"] = preloaded("odd_disk.so")
    os.environ["LATE_DISK"] = "%s,%d" % (LATE, LATE_MS[LATE])
SANITIZER_MARKS = ("ERROR: AddressSanitizer", "ERROR: LeakSanitizer", "runtime error:",
                   "WARNING: ThreadSanitizer")


class Failure(Exception):
    """A condition that did not come true, or a program that misbehaved."""


class Skip(Exception):
    """This machine cannot run the test; the text says why."""


def wait_for(condition, what, limit_s=60.0):
    """Wait until condition() is true and return its value; Failure after limit_s.

    A look often runs the client: three quarters of the time are left to what is waited for."""
    start = time.monotonic()
    end = start + limit_s * PATIENCE
    while True:
        began = time.monotonic()
        value = condition()
        if value:
            return value
        if time.monotonic() > end:
            raise Failure("waited %g s for %s" % (limit_s * PATIENCE, what))
        # How often we look, not how long it takes: seldom after a while.
        now = time.monotonic()
        time.sleep(min(max(0.01, 3 * (now - began), (now - start) / 8), 0.25))


def answer_comes():
    """Where a test gets an answer."""
    if LATE == "answer":
        time.sleep(LATE_MS[LATE] / 1000)


def readable(fd, limit_s):
    """Wait until there is something to read; any descriptor number will do, unlike with select()."""
    source = select.poll()
    source.register(fd, select.POLLIN)
    return bool(source.poll(limit_s * 1000))


class Program:
    """One running coordinator or worker; its output goes to a log file."""

    def __init__(self, label, argv, log, pipe_stdout=False, env=None, pipe_stdin=False):
        self.label = label
        self.argv = argv
        self.log = log
        self.rest = b""
        with open(log, "ab") as sink:
            self.process = subprocess.Popen(
                argv, stdin=subprocess.PIPE if pipe_stdin else subprocess.DEVNULL, stderr=sink,
                env=env,
                stdout=subprocess.PIPE if pipe_stdout else sink)

    @property
    def pid(self):
        return self.process.pid

    def alive(self):
        return self.process.poll() is None

    def log_text(self):
        with open(self.log, "rb") as source:
            return source.read().decode("utf-8", "replace")

    def wait_line(self, prefix, limit_s=30.0):
        """The rest of the first line of standard output that starts with prefix."""
        end = time.monotonic() + limit_s * PATIENCE
        fd = self.process.stdout.fileno()
        while True:
            while b"\n" in self.rest:
                line, self.rest = self.rest.split(b"\n", 1)
                text = line.decode("utf-8", "replace")
                if text.startswith(prefix):
                    return text[len(prefix):].strip()
            left = end - time.monotonic()
            if left <= 0:
                raise Failure("%s did not print '%s...'" % (self.label, prefix))
            if readable(fd, left):
                data = os.read(fd, 65536)
                if not data:
                    self.process.wait()
                    raise Failure("%s ended with %s before it printed '%s...':\n%s" % (
                        self.label, self.process.returncode, prefix, self.log_text()))
                self.rest += data

    def stands_still(self):
        with open("/proc/%d/stat" % self.pid) as stat:
            return stat.read().rsplit(")", 1)[1].split()[0] in "TtZX"

    def signal(self, number):
        """Send it; SIGSTOP returns once the process stands still."""
        self.process.send_signal(number)
        if number == signal.SIGSTOP:
            wait_for(self.stands_still, "%s to stand still" % self.label)

    def kill(self):
        """SIGKILL: as a power cut would."""
        if self.alive():
            self.process.kill()
        self.process.wait()

    def stop(self, limit_s=20.0):
        """SIGTERM, and its exit status."""
        if self.alive():
            self.process.terminate()
        return self.wait(limit_s)

    def wait(self, limit_s=60.0):
        try:
            return self.process.wait(limit_s * PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise Failure("%s did not end:\n%s" % (self.label, self.log_text()))

    def close(self):
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe:
                pipe.close()


class Client(subprocess.Popen):
    """The command line client in the background."""

    def communicate(self, input=None, timeout=60):
        return super().communicate(input, timeout and timeout * PATIENCE)


class Result:
    """What one run of the command line client gave."""

    def __init__(self, argv, code, out, err):
        self.argv, self.code, self.out, self.err = argv, code, out, err

    def json(self):
        return json.loads(self.out)

    def __str__(self):
        return "%s\nexit status %d\nstdout: %s\nstderr: %s" % (
            " ".join(self.argv), self.code, self.out, self.err)


class Clients:
    """Runs client commands by tests/farm/clients.c, which forks where a program would start."""
    # Those that only talk to a coordinator: no programs of the farm are started, or sought beside their own.
    COMMANDS = ("submit", "list", "show", "watch", "fetch", "develop", "cancel", "resume", "extend", "workers", "start",
                "pause", "finish", "priority", "comment", "retry", "remove", "log", "prune", "gc", "owners", "token",
                "key", "keygen")
    PROGRAM = os.path.join(BUILD, "tests/farm/clients")  # an older release, which a benchmark measures, has none
    running = None

    @classmethod
    def take(cls, argv, environment):
        """Those that can run this command as its program would run; None: the program it is."""
        if SANITIZED or BIN != SOUND or argv[1] not in cls.COMMANDS or sum(map(len, argv)) > 100000 or \
                not os.path.exists(cls.PROGRAM):
            return None
        if cls.running is None:
            cls.running = cls(environment)
        return cls.running if cls.running.environment == environment else None

    @classmethod
    def leave(cls):
        """What this process has changed for its children since (its mounts) holds for the next ones."""
        if cls.running:
            atexit.unregister(cls.running.end)
            cls.running.end()
            cls.running = None

    def __init__(self, environment):
        self.environment = environment
        self.socket, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its:
            self.process = subprocess.Popen([self.PROGRAM, str(its.fileno())],
                                            stdin=subprocess.DEVNULL, env=environment, pass_fds=[its.fileno()])
        atexit.register(self.end)

    def end(self):
        self.socket.close()
        self.process.wait()

    def cpu_seconds(self):
        with open("/proc/%d/stat" % self.process.pid) as stat:
            return sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:15])) / os.sysconf("SC_CLK_TCK")

    def run(self, argv, cwd, limit_s):
        """Exit status, output and complaints, as bytes; subprocess.TimeoutExpired."""
        number = struct.Struct("=i")
        out, err = os.memfd_create("out"), os.memfd_create("err")
        reports, report = os.pipe()
        try:
            socket.send_fds(self.socket, [b"".join(os.fsencode(word) + b"\0" for word in [cwd] + argv)], [out, err, report])
            os.close(report)
            report = None
            pid, = number.unpack(os.read(reports, number.size))
            if not readable(reports, limit_s):
                os.kill(pid, signal.SIGKILL)
                raise subprocess.TimeoutExpired(argv, limit_s)
            how, = number.unpack(os.read(reports, number.size))
            return (os.waitstatus_to_exitcode(how), *(os.pread(fd, os.fstat(fd).st_size, 0) for fd in (out, err)))
        finally:
            for fd in (out, err, reports, report):
                if fd is not None:
                    os.close(fd)


def kept_port():
    """A free port for one that must be had again after a restart: meanwhile the kernel gives it to no connection."""
    with open("/proc/sys/net/ipv4/ip_local_port_range") as file:
        first = int(file.read().split()[0])
    while True:
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", random.randrange(min(10000, first - 1000), first)))
                return probe.getsockname()[1]
            except OSError:
                pass


class Farm:
    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="azulejo-farm-")
        self.key = self.path("farm.key")
        self.programs = []
        self.coordinator = None
        self.workers = []
        self.address = None
        self.store = self.path("store")

    def __enter__(self):
        self.cli("keygen", "-o", self.key, expect=0, connect=False)
        return self

    def __exit__(self, kind, value, trace):
        for program in self.programs:
            if program.alive():
                program.signal(signal.SIGCONT)  # a stopped one could not be ended in good order
                program.process.terminate()
        words = None
        for program in self.programs:
            try:
                program.wait(20)
            except Failure as failure:
                words = words or str(failure)
            program.close()
            log = program.log_text()
            for mark in SANITIZER_MARKS:
                if mark in log:
                    words = words or "%s: a sanitizer complained:\n%s" % (
                        program.label, log[log.index(mark):][:6000])
        if kind not in (None, Skip):
            for program in self.programs:
                print("# ---- %s" % program.label)
                lines = program.log_text().splitlines()
                found = [i for i, line in enumerate(lines) if "Sanitizer" in line or "runtime error" in line]
                for line in lines[found[0]:][:150] if found else lines[-25:]:
                    print("# " + line)
        shutil.rmtree(self.folder, ignore_errors=True)
        if kind in (None, Skip) and words:
            raise Failure(words)

    def path(self, *parts):
        return os.path.join(self.folder, *parts)

    # ---- programs ------------------------------------------------------------------------

    def start_coordinator(self, *options, listen="127.0.0.1:0", key=None, prefix=(), env=None, program=None):
        """Start (or, after a kill, start again with the same store) and wait until it listens.

        prefix: words before the command, such as a shell that sets limits and runs it."""
        argv = list(prefix) + [program or os.path.join(BIN, "azulejo-coordinator"), "--listen", listen,
                "--key", key or self.key, "--store", self.store] + list(options)
        self.coordinator = Program("coordinator", argv,
                                   self.path("coordinator-%d.log" % len(self.programs)),
                                   pipe_stdout=True,
                                   env=dict(os.environ, **env) if env else None)
        self.programs.append(self.coordinator)
        self.address = self.coordinator.wait_line("listening on ").split()[0]
        return self.coordinator

    def restart_coordinator(self, *options, env=None):
        """Again at the same address, as a service manager would; its page at any: the port after that of its
        address may be somebody else's."""
        if not hasattr(self, "page_address") and "noweb" not in BUILD and \
                not any(str(o).startswith(("--web", "--no-web")) for o in options):
            options += ("--web", "127.0.0.1:0")
        return self.start_coordinator(*options, listen=self.address, env=env)

    def start_worker(self, *options, key=None, threads=1, env=None, cache=None, rests=True):
        """rests: it renders jobs that are there to be in work some of the time only (resting.c)."""
        number = len(self.workers) + 1
        program = RESTING if rests and Tests.running and BIN == SOUND else os.path.join(BIN, "azulejo-worker")
        argv = [program, "--coordinator", self.address,
                "--key", key or self.key, "--threads", str(threads),
                "--cache", cache or self.path("cache-%d" % number)] + list(options)
        worker = Program("worker %d" % number, argv, self.path("worker-%d.log" % number),
                         env=dict(os.environ, **env) if env else None)
        self.programs.append(worker)
        self.workers.append(worker)
        return worker

    # ---- the client ----------------------------------------------------------------------

    def named_key(self, name, role, *options):
        """The file of a key of that name."""
        path = self.path("%s-%s%s.key" % (name, role, "".join(options)))
        self.cli("key", "new", name, "--role", role, "--key", self.key, "-o", path, *options, expect=0, connect=False)
        return path

    def cli_argv(self, *args, connect=True, key=None):
        argv = [os.path.join(BIN, "azulejo")] + [str(a) for a in args]
        if connect and self.address and args[0] in (
                "submit", "list", "show", "watch", "fetch", "develop", "cancel", "resume", "extend",
                "workers", "top", "estimate", "start", "pause", "finish", "priority", "comment", "retry", "remove", "log", "prune", "gc", "trace", "owners", "verify", "distrust", "token", "key") or (
                    connect and self.address and args[0] == "debug-pixel" and not set("./") & set(str(args[1]))):
            argv += ["--coordinator", self.address, "--key", key or self.key]
        return argv

    def cli(self, *args, expect=None, limit_s=120.0, connect=True, key=None, env=None, cwd=None):
        """Run `azulejo ARGS...`; with expect, Failure unless it exits with that status."""
        argv = self.cli_argv(*args, connect=connect, key=key)
        environment = {k: v for k, v in os.environ.items() if not k.startswith("AZULEJO_")}
        environment.update(env or {})
        clients = Clients.take(argv, environment)
        try:
            if clients:
                code, out, words = clients.run(argv, cwd or self.folder, limit_s * PATIENCE)
            else:
                done = subprocess.run(argv, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                      stderr=subprocess.PIPE, timeout=limit_s * PATIENCE,
                                      env=environment, cwd=cwd or self.folder)
                code, out, words = done.returncode, done.stdout, done.stderr
        except subprocess.TimeoutExpired:
            raise Failure("did not end: " + " ".join(argv))
        answer_comes()
        result = Result(argv, code, out.decode("utf-8", "replace"), words.decode("utf-8", "replace"))
        for mark in SANITIZER_MARKS:
            if mark in result.err:
                raise Failure(str(result))
        if expect is not None and result.code != expect:
            raise Failure("expected exit status %d: %s" % (expect, result))
        return result

    def cli_bytes(self, *args):
        """What `azulejo ARGS...`, which must succeed, writes to standard output."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith("AZULEJO_")}
        done = subprocess.run(self.cli_argv(*args), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, timeout=120 * PATIENCE, env=environment, cwd=self.folder)
        if done.returncode != 0:
            raise Failure("%s: %s" % (args, done.stderr.decode("utf-8", "replace")))
        return done.stdout

    def start_cli(self, *args, env=None, cwd=None, key=None):
        """Run the client in the background, in a process group of its own."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith("AZULEJO_")}
        environment.update(env or {})
        return Client(self.cli_argv(*args, key=key), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                      env=environment, cwd=cwd or self.folder, start_new_session=True)

    def edit_store(self, edit):
        """Change the rows of a stopped coordinator's database by edit(connection). It takes the new rows for its own."""
        with contextlib.closing(sqlite3.connect(os.path.join(self.store, "queue.sqlite"))) as store:
            edit(store)
            store.execute("DROP TABLE sums")
            for column in ("denoised", "display_all", "worst_part", "fireflies", "subject"):
                store.execute("ALTER TABLE history DROP COLUMN %s" % column)
            for column in ("deliverers.label", "deliverers.distrusted", "frames.deliverers", "frames.done_at"):
                store.execute("ALTER TABLE %s DROP COLUMN %s" % tuple(column.split(".")))
            store.execute("ALTER TABLE jobs DROP COLUMN accounts")
            store.execute("PRAGMA user_version=9")  # the next start fills the digests in
            store.commit()

    def submit(self, scene, *options):
        """Submit and return the job's number."""
        return self.cli("submit", scene, "--json", *options, expect=0).json()["job"]

    def job(self, number):
        return self.cli("show", number, "--json", expect=0).json()

    def wait_for_job(self, number, state="done", limit_s=120.0):
        """Wait until the job is in that state; Failure when it ends in another."""
        final = ("done", "failed", "cancelled")

        def look():
            job = self.job(number)
            if job["state"] == state:
                return job
            if job["state"] in final:
                raise Failure("job %d is %s, not %s: %s" % (
                    number, job["state"], state, job["state_text"]))
            return None
        return wait_for(look, "job %s to be %s" % (number, state), limit_s)

    def list_workers(self):
        return self.cli("workers", "--json", expect=0).json()["workers"]

    def wait_for_workers(self, count, limit_s=30.0):
        return wait_for(lambda: (lambda w: (w, ) if len(w) == count else None)(self.list_workers()),
                        "%d workers" % count, limit_s)[0]

    def fetch(self, number, name="fetched"):
        """Fetch every output into a new folder; returns the paths."""
        folder = self.path(name)
        return [os.path.join(self.folder, f) for f in
                self.cli("fetch", number, "-o", folder, "--json", expect=0).json()["files"]]

    def scene(self, name="tiny.gltf", **how):
        path = self.path(name)
        if not os.path.exists(path):
            write_scene(path, **how)
        return path


def write_scene(path, light=5.0, camera=True):
    """A white floor of 4x4 m under a square lamp, seen from the side: glTF with its buffer inside.

    Everything in it is diffuse, so that a few samples a pixel give a picture."""
    def quad(half, y, up):
        s = 1.0 if up else -1.0
        return ([(-half, y, half * s), (half, y, half * s), (half, y, -half * s),
                 (-half, y, -half * s)], [(0.0, s, 0.0)] * 4)
    floor, floor_normals = quad(2.0, 0.0, True)
    lamp, lamp_normals = quad(0.5, 2.0, False)
    vectors = [floor, floor_normals, lamp, lamp_normals]
    data = b"".join(struct.pack("<3f", *v) for block in vectors for v in block)
    indices = struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    views = [{"buffer": 0, "byteOffset": 48 * i, "byteLength": 48} for i in range(4)]
    views.append({"buffer": 0, "byteOffset": 192, "byteLength": 12})
    accessors = []
    for i, block in enumerate(vectors):
        accessor = {"bufferView": i, "componentType": 5126, "count": 4, "type": "VEC3"}
        if i % 2 == 0:
            accessor["min"] = [min(v[k] for v in block) for k in range(3)]
            accessor["max"] = [max(v[k] for v in block) for k in range(3)]
        accessors.append(accessor)
    accessors.append({"bufferView": 4, "componentType": 5123, "count": 6, "type": "SCALAR"})
    gltf = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_emissive_strength"],
        "scene": 0,
        "scenes": [{"name": "tiny", "nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "name": "floor"}, {"mesh": 1, "name": "lamp"}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 4,
                             "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 2, "NORMAL": 3}, "indices": 4,
                             "material": 1}]}],
        "materials": [
            {"name": "white", "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.7, 0.6, 1], "metallicFactor": 0}},
            {"name": "lamp", "emissiveFactor": [1, 1, 1],
             "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": light}}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data) + len(indices),
                     "uri": "data:application/octet-stream;base64," +
                            base64.b64encode(data + indices).decode("ascii")}],
    }
    if camera:
        gltf["nodes"].append({"camera": 0, "translation": [0, 1, 5], "name": "eye"})
        gltf["scenes"][0]["nodes"].append(2)
        gltf["cameras"] = [{"name": "side", "type": "perspective",
                            "perspective": {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}}]
    with open(path, "w") as out:
        json.dump(gltf, out)


def read_bytes(path):
    with open(path, "rb") as source:
        return source.read()


def cpu_seconds():
    """Of this process and of all programs that it has started and waited for."""
    spent = os.times()
    return (spent.user + spent.system + spent.children_user + spent.children_system +
            (Clients.running.cpu_seconds() if Clients.running else 0))


class Tests:
    """Collects functions and prints TAP: `ok N - name`, or `not ok` and what was wrong."""

    running = False  # not in benchmarks

    def __init__(self):
        self.functions = []

    def add(self, function):
        self.functions.append(function)
        return function

    def run(self):
        Tests.running = True
        failed = 0
        only = sys.argv[1] if len(sys.argv) > 1 else ""
        chosen = [f for f in self.functions if re.search(only, f.__name__)]
        print("1..%d" % len(chosen), flush=True)
        for number, function in enumerate(chosen, 1):
            name = (function.__doc__ or function.__name__).strip().splitlines()[0]
            began, before = time.monotonic(), cpu_seconds()
            try:
                function()
                print("ok %d - %s" % (number, name), flush=True)
            except Skip as skip:
                print("ok %d - %s # SKIP %s" % (number, name, skip), flush=True)
            except Exception:
                failed += 1
                for line in traceback.format_exc().splitlines():
                    print("# " + line)
                print("not ok %d - %s" % (number, name), flush=True)
            print("# %s: %.1f s, of them CPU %.1f" % (function.__name__, time.monotonic() - began, cpu_seconds() - before), flush=True)
        sys.exit(1 if failed else 0)
