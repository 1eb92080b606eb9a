"""Chromium's DevTools protocol over a pair of pipes: messages are JSON, each ended by a NUL.

    with Chromium(folder) as chromium:
        chromium.call("Target.createTarget", {"url": "about:blank"})

One thread: call() sends a command and reads until its answer has come; what comes meanwhile (events) goes to
the functions in `listeners`. Such a function must not call(); it may send(), which waits for nothing.
"""
import glob
import json
import os
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "farm"))

from farm import PATIENCE, Failure, Skip, readable  # noqa: E402

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
ANSWER_LIMIT_S = 60

# No GPU is needed: SwiftShader draws WebGL 2 on the processor. Nothing that the browser does by itself may
# reach another host, and nothing waits for a window to be visible.
FLAGS = [
    "--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-dev-shm-usage",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--force-color-profile=srgb", "--hide-scrollbars", "--mute-audio", "--no-first-run",
    "--no-default-browser-check", "--disable-background-networking", "--disable-component-update",
    "--disable-component-extensions-with-background-pages", "--disable-default-apps",
    "--disable-extensions", "--disable-sync", "--disable-domain-reliability", "--disable-breakpad",
    "--disable-crash-reporter", "--no-pings", "--metrics-recording-only", "--no-service-autorun",
    "--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding", "--disable-ipc-flooding-protection",
    "--password-store=basic", "--use-mock-keychain", "--lang=en-GB",
    "--disable-features=Translate,OptimizationHints,MediaRouter,DialMediaRouteProvider,"
    "InterestFeedContentSuggestions,CertificateTransparencyComponentUpdater,AutofillServerCommunication,"
    "LocalNetworkAccessChecks,HttpsUpgrades,"
    # Pages of each window that nobody sees: .7 s of a core.
    "WebUIOmniboxPopup,WebUIOmniboxAimPopup,WebUIOmniboxFullPopup,PreloadTopChromeWebUI",
    "--host-resolver-rules=MAP *.test 127.0.0.1 , MAP * ~NOTFOUND , EXCLUDE 127.0.0.1 , EXCLUDE localhost",
]


def program():
    """The path of a Chromium, or Skip."""
    named = os.environ.get("CHROMIUM")
    if named:
        return named
    for name in NAMES:
        found = shutil.which(name)
        if found:
            return found
    raise Skip("no Chromium (Debian: apt-get install chromium; or name one: CHROMIUM=PATH)")


def processes_of(profile):
    """Numbers of the processes whose command line names this profile folder."""
    found = []
    for path in glob.glob("/proc/[0-9]*/cmdline"):
        try:
            with open(path, "rb") as source:
                if profile.encode() in source.read():
                    found.append(int(path.split("/")[2]))
        except OSError:
            pass  # it has ended meanwhile
    return found


class Chromium:
    """One browser process with a profile folder of its own; all of it ends with the `with` block."""

    def __init__(self, folder, flags=()):
        self.folder = folder
        self.profile = os.path.join(folder, "chromium-profile")
        self.log = os.path.join(folder, "chromium.log")
        self.listeners = []
        self.answers = {}
        self.count = 0
        self.rest = b""
        os.makedirs(self.profile, exist_ok=True)
        child_in, self.write_fd = os.pipe()
        self.read_fd, child_out = os.pipe()
        argv = [program()] + FLAGS + list(flags) + ["--user-data-dir=" + self.profile, "about:blank"]
        environment = {k: v for k, v in os.environ.items() if not k.lower().endswith("_proxy")}
        environment["HOME"] = folder  # settings of the person who runs the tests change nothing
        with open(self.log, "ab") as sink:
            # The shell puts the pipes where Chromium looks for them: 3 and 4.
            self.process = subprocess.Popen(
                ["bash", "-c", 'exec "$@" 3<&%d 4>&%d' % (child_in, child_out), "chromium"] + argv,
                pass_fds=(child_in, child_out), stdin=subprocess.DEVNULL, stdout=sink, stderr=sink,
                env=environment, start_new_session=True)
        os.close(child_in)
        os.close(child_out)
        os.set_blocking(self.read_fd, False)

    def __enter__(self):
        try:
            self.call("Browser.getVersion", limit_s=60)
        except Failure as failure:
            self.close()
            if os.environ.get("TEST_WEB") == "required":
                raise
            raise Skip("this machine's Chromium does not start ('make test-web' shows why): %s" %
                       str(failure).splitlines()[0]) from failure
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """End every process of this browser and wait until they are gone."""
        if self.write_fd is None:
            return
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self.process.wait()
        os.close(self.write_fd)
        os.close(self.read_fd)
        self.write_fd = None
        end = time.monotonic() + 20
        while time.monotonic() < end:
            left = processes_of(self.profile)
            for number in left:  # helpers that began a process group of their own
                try:
                    os.kill(number, signal.SIGKILL)
                except ProcessLookupError:
                    pass
            if not left:
                break
            time.sleep(0.01)
        shutil.rmtree(self.profile, ignore_errors=True)

    def log_text(self):
        with open(self.log, "rb") as source:
            return source.read().decode("utf-8", "replace")

    # ---- messages ------------------------------------------------------------------------

    def send(self, method, params=None, session=None):
        """Send a command and return its number without waiting for the answer."""
        if self.write_fd is None:
            raise Failure("Chromium was ended before %s" % method)
        self.count += 1
        message = {"id": self.count, "method": method, "params": params or {}}
        if session:
            message["sessionId"] = session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self.write_fd, data):]
        return self.count

    def call(self, method, params=None, session=None, limit_s=ANSWER_LIMIT_S):
        """Send a command and return its result; Failure on an error or after limit_s."""
        number = self.send(method, params, session)
        self.answers[number] = None
        end = time.monotonic() + limit_s * PATIENCE
        while self.answers[number] is None:
            left = end - time.monotonic()
            if left <= 0:
                raise Failure("Chromium did not answer %s" % method)
            self.pump(left)
        answer = self.answers.pop(number)
        if "error" in answer:
            raise Failure("%s: %s" % (method, answer["error"].get("message")))
        return answer["result"]

    def pump(self, limit_s):
        """Take in what has come; wait at most limit_s for the first of it."""
        if not readable(self.read_fd, max(limit_s, 0)):
            return
        try:
            data = os.read(self.read_fd, 1 << 20)
        except BlockingIOError:
            return
        if not data:
            raise Failure("Chromium has ended:\n" + self.log_text()[-3000:])
        *whole, self.rest = (self.rest + data).split(b"\0")
        for text in whole:
            message = json.loads(text)
            if "id" in message:
                if message["id"] in self.answers:
                    self.answers[message["id"]] = message
            else:
                for listener in list(self.listeners):
                    listener(message)
