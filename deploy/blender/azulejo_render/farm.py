"""Runs the program `azulejo` and, for the local machine, a coordinator and a worker. No bpy in here.

Nothing blocks: a command runs beside us and `tick()`, which the caller gives, is called while it does; what tick raises ends the
command. A local farm ends with this process, however that ends: it hangs on a pipe."""
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time

from . import options

TICK_S = 0.05
COMMAND_LIMIT_S = 60.0       # a question; an upload has no limit but the user's patience
START_LIMIT_S = 20.0
STOP_LIMIT_S = 5.0
SILENCE_S = 10               # --timeout of questions
UNREACHABLE = 4              # exit status of azulejo: no coordinator there
TIMED_OUT = 7
WRONG_WORDS = 2

# Ends its program when standard input ends, which it does when Blender is gone.
KEEPER = """exec 3<&0
"$@" </dev/null 3<&- &
child=$!
(cat <&3 >/dev/null; kill $child 2>/dev/null) &
trap 'kill $child 2>/dev/null' TERM
wait $child
wait $child"""


class Trouble(Exception):
    """Something that the user must know; the text is one sentence that says what happened and what to do."""

    def __init__(self, text, code=None):
        super().__init__(text)
        self.code = code


class Gone(Trouble):
    """The coordinator does not answer now."""


def environment():
    """The program's own defaults must not decide where a job goes."""
    return {k: v for k, v in os.environ.items() if k not in ("AZULEJO_COORDINATOR", "AZULEJO_KEY") and
            not k.startswith(("PYTHON", "LD_LIBRARY_PATH"))}


def find_program(path):
    """The full path of azulejo; `path` may be empty (then PATH counts), a folder or the program."""
    path = os.path.expanduser(path.strip())
    if os.path.isdir(path):
        path = os.path.join(path, "azulejo")
    found = shutil.which(path or "azulejo")
    if found:
        return os.path.abspath(found)
    if path:
        raise Trouble("there is no program azulejo at %s: set its path in the panel Azulejo" % path)
    raise Trouble("the program azulejo is not found: install it, or set its path in the panel Azulejo")


class Command:
    """A program that runs beside us; its output goes to files, so that no pipe can fill up."""

    def __init__(self, words, folder, keeper=None):
        """keeper: the end of a pipe; the program is ended when the other end is closed."""
        self.words = words
        self.out = tempfile.TemporaryFile(dir=folder)
        self.err = tempfile.TemporaryFile(dir=folder)
        argv = words if keeper is None else ["/bin/sh", "-c", KEEPER, "azulejo"] + words
        try:
            self.process = subprocess.Popen(argv, stdin=subprocess.DEVNULL if keeper is None else keeper, stdout=self.out,
                                            stderr=self.err, env=environment(), start_new_session=True)
        except OSError as problem:
            raise Trouble("%s cannot be started: %s" % (words[0], problem.strerror)) from problem

    @staticmethod
    def _text(file):
        file.seek(0)
        return file.read().decode("utf-8", "replace")

    def stdout(self):
        return self._text(self.out)

    def stderr(self):
        return self._text(self.err)

    def ended(self):
        return self.process.poll() is not None

    def stop(self):
        if not self.ended():
            self.process.terminate()
            try:
                self.process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.out.close()
        self.err.close()


def run(words, folder, tick, limit_s=COMMAND_LIMIT_S):
    """Run a command to its end; (exit status, stdout, stderr). Raises what tick raises, and Gone when it takes too long."""
    command = Command(words, folder)
    try:
        end = time.monotonic() + limit_s
        while not command.ended():
            tick()
            if time.monotonic() > end:
                raise Gone("%s did not end in %g s" % (" ".join(words[:2]), limit_s), TIMED_OUT)
            time.sleep(TICK_S)
        return command.process.returncode, command.stdout(), command.stderr()
    finally:
        command.stop()


class Local:
    """A coordinator and a worker of this machine, with a key and a store of their own."""

    def __init__(self, program, threads, parent, tick):
        self.folder = tempfile.mkdtemp(prefix="azulejo-local-", dir=parent)
        self.key = os.path.join(self.folder, "farm.key")
        self.threads, self.pipe, self.commands = threads, None, []
        self.program = program
        try:
            self._start(os.path.dirname(program), tick)
        except BaseException:
            self.stop()
            raise

    def _start(self, folder, tick):
        for name in ("azulejo-coordinator", "azulejo-worker"):
            if not os.access(os.path.join(folder, name), os.X_OK):
                raise Trouble("there is no %s beside azulejo in %s: the local machine needs it" % (name, folder))
        code, _, err = run([self.program, "keygen", "-o", self.key], self.folder, tick)
        if code != 0:
            raise Trouble(options.complaint(err, code), code)
        ours, self.pipe = os.pipe()  # children see its end when we are gone
        try:
            coordinator = self._keep(ours, [os.path.join(folder, "azulejo-coordinator"), "--listen", "127.0.0.1:0", "--key",
                                            self.key, "--store", os.path.join(self.folder, "store"), "--no-web"])
            self.address = self._await_address(coordinator, tick)
            threads = self.threads or len(os.sched_getaffinity(0))
            self._keep(ours, [os.path.join(folder, "azulejo-worker"), "--coordinator", self.address, "--key", self.key,
                              "--threads", "%d" % threads, "--cache", os.path.join(self.folder, "cache"), "--memory", "0",
                              "--exit-on-disconnect"])
        finally:
            os.close(ours)

    def _keep(self, pipe, words):
        command = Command(words, self.folder, keeper=pipe)
        self.commands.append(command)
        return command

    @staticmethod
    def _await_address(coordinator, tick):
        end = time.monotonic() + START_LIMIT_S
        while time.monotonic() < end:
            for line in coordinator.stdout().splitlines(True):
                if line.startswith("listening on ") and line.endswith("\n"):
                    return line[len("listening on "):].split()[0].rstrip(",")
            if coordinator.ended():
                raise Trouble("the local coordinator ended: " +
                              options.complaint(coordinator.stderr(), coordinator.process.returncode))
            tick()
            time.sleep(TICK_S)
        raise Trouble("the local coordinator did not say its address in %g s" % START_LIMIT_S)

    def check(self):
        """Raise Trouble when one of the programs has ended."""
        for command in self.commands:
            if command.ended():
                raise Trouble("the local %s ended: %s" % (os.path.basename(command.words[0]), options.complaint(
                    command.stderr(), command.process.returncode)))

    def alive(self):
        return bool(self.commands) and not any(c.ended() for c in self.commands)

    def stop(self):
        if self.pipe is not None:
            os.close(self.pipe)
            self.pipe = None
        for command in reversed(self.commands):
            command.stop()
            try:
                os.killpg(command.process.pid, signal.SIGKILL)  # the rest of its session
            except ProcessLookupError:
                pass
        self.commands = []
        shutil.rmtree(self.folder, ignore_errors=True)


class Job:
    """A job on a farm, asked for by `azulejo`'s own commands."""

    def __init__(self, program, address, key, folder, tick):
        self.program, self.folder, self.tick, self.number = program, folder, tick, None
        self.where = (["--coordinator", address] if address else []) + (["--key", os.path.expanduser(key)] if key else [])
        self.warnings = []

    def _ask(self, command, words, limit_s=COMMAND_LIMIT_S):
        code, out, err = run([self.program, command] + words + self.where, self.folder, self.tick, limit_s)
        if code in (UNREACHABLE, TIMED_OUT):
            raise Gone(options.complaint(err, code), code)
        if code != 0:
            raise Trouble(options.complaint(err, code), code)
        return out, err

    def submit(self, words):
        out, err = self._ask("submit", words, limit_s=float("inf"))
        self.warnings = options.warnings(err)
        self.number = json.loads(out)["job"]

    def _timeout(self):
        return ["--timeout", "%d" % SILENCE_S]

    def info(self):
        return json.loads(self._ask("show", ["%d" % self.number, "--json"] + self._timeout())[0])

    def preview(self, path):
        """The picture as it is, as an EXR file, denoised as the job says; False: there is none yet."""
        try:
            self._ask("fetch", ["%d" % self.number, "--preview", path, "--json"] + self._timeout())
            return True
        except Trouble as trouble:
            if isinstance(trouble, Gone) or trouble.code == WRONG_WORDS:
                raise
            return False

    def finish(self):
        """End it early, with a whole picture."""
        self._ask("finish", ["%d" % self.number] + self._timeout())

    def cancel(self):
        self._ask("cancel", ["%d" % self.number, "--discard"] + self._timeout())

    def fetch(self, path):
        self._ask("fetch", ["%d" % self.number, "-o", path, "--force", "--json"] + self._timeout(), limit_s=float("inf"))


class Exporter:
    """The second Blender: a request a line, an answer a file."""

    def __init__(self, words, folder):
        self.log = tempfile.TemporaryFile(dir=folder)
        try:
            self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=self.log, stderr=self.log,
                                            start_new_session=True)
        except OSError as problem:
            raise Trouble("%s cannot be started: %s" % (words[0], problem.strerror)) from problem

    def ended(self):
        return self.process.poll() is not None

    def ask(self, request, answer, tick, limit_s):
        try:
            self.process.stdin.write(json.dumps(request).encode() + b"\n")
            self.process.stdin.flush()
        except OSError:
            raise Trouble("the exporting Blender ended: " + self.last_words()) from None
        end = time.monotonic() + limit_s
        while not os.path.exists(answer):
            if self.ended() and not os.path.exists(answer):
                raise Trouble("the exporting Blender ended: " + self.last_words())
            if time.monotonic() > end:
                raise Trouble("the export took longer than %g s" % limit_s)
            tick()
            time.sleep(TICK_S)
        with open(answer, encoding="utf-8") as source:
            return json.load(source)

    def last_words(self):
        self.log.seek(0)
        lines = [l for l in self.log.read().decode("utf-8", "replace").splitlines() if l.strip() and "Blender quit" not in l]
        return lines[-1].strip() if lines else "it said nothing"

    def stop(self):
        """It ends by the end of its input; a busy one is killed."""
        try:
            self.process.stdin.close()
        except OSError:
            pass
        try:
            self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()
