"""While the store's disk hangs, every request that changes something waits alone. The list of requests is the coordinator's
own (its openapi.yaml, made from the table of routes, which has the table of verbs), so that none can be forgotten."""
import hashlib
import os
import re
import signal
import sys
import threading
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import StalledDisk
from farm import PATIENCE, Farm, Failure, Tests, read_bytes, wait_for
from jobs import expect
from page import Page

tests = Tests()
SMALL = ["--size", "32x24", "--spp", "4", "--format", "exr,png"]
LONG = ["--size", "64x64", "--spp", "1000000"]
LOOK_S = 0.3    # how long others are asked while a request waits
HANG_S = 4.0    # the disk goes on by itself then: a loop that waits for it is free again, and too late
SOON_S = 2.0
JOB = "/api/v1/jobs/{job}"


class World:
    """What requests need: jobs in the right states, made before the disk hangs."""

    def __init__(self, farm, page):
        self.farm, self.page = farm, page
        self.count = 0

    def ask(self, method, path, body=None, **how):
        answer = self.page.request(method, path, body=body if body is not None or method != "POST" else {}, **how)
        expect(answer.status < 300, "%s %s: %s" % (method, path, answer))
        return answer

    def do(self, job, verb, body=None):
        return self.ask("POST", "/api/v1/jobs/%d/%s" % (job, verb), body)

    def queued(self, *options):
        return self.farm.submit(self.farm.scene(), *LONG, *options)

    def begun(self):
        job = self.queued("--priority", "1000")
        wait_for(lambda: self.farm.job(job)["samples_done"] > 0, "samples")
        return job

    def done(self):
        job = self.farm.submit(self.farm.scene(), *SMALL, "--priority", "2000")
        self.farm.wait_for_job(job)
        return job

    def cancelled(self):
        job = self.queued()
        self.do(job, "cancel")
        self.farm.wait_for_job(job, "cancelled")
        return job

    def paused(self):
        job = self.queued()
        self.do(job, "pause")
        return job

    def token(self):
        return self.ask("POST", "/api/v1/tokens", {"role": "view", "name": "t%d" % self.new()}).json()["info"]["token"]

    def upload(self, file=False):
        number = self.ask("POST", "/api/v1/imports").json()["import"]
        if file:
            self.ask("PUT", "/api/v1/imports/%d/files/a.gltf" % number, read_bytes(self.farm.scene()))
        return number

    def blocked(self):
        name = "w%d" % self.new()
        self.ask("POST", "/api/v1/workers/%s/block" % name)
        return name

    def joined(self):
        name = "j%d" % self.new()
        self.farm.start_worker("--name", name)
        wait_for(lambda: name in [w["name"] for w in self.farm.list_workers()], "the worker " + name)
        return name

    def new(self):
        self.count += 1
        return self.count


def job_path(make, body=None):
    return lambda w: ({"{job}": make(w)}, body)


def blob(w):
    data = b"blob %d" % w.new()
    return {"{digest}": hashlib.sha256(data).hexdigest()}, data


def drained(w):
    w.ask("POST", "/api/v1/workers/first/drain")
    return "first"


def doubted(w):
    """A worker that delivered tiles of two jobs, one of which is done. Another takes them over."""
    w.ask("POST", "/api/v1/workers/first/drain")
    name = w.joined()
    w.done()
    w.do(w.begun(), "priority", {"priority": 900})  # after those of later requests
    w.ask("POST", "/api/v1/workers/first/resume")
    return name


def submission(w):
    """The newest job once more: what it needs is on the coordinator."""
    with open(w.farm.path("scene-digest")) as source:
        scene = source.read()
    return {}, {"scene": scene, "name": "again", "first_frame": 1, "last_frame": 1,
                "settings": {"width": 32, "height": 24, "spp": 4}, "output": {"formats": ["exr"]}}


# Of each request: makes what it is about, and returns what the path's words stand for, and the body.
RECIPES = {
    ("POST", JOB + "/pause"): job_path(World.queued),
    ("POST", JOB + "/resume"): job_path(World.paused),
    ("POST", JOB + "/finish"): job_path(World.begun),
    ("POST", JOB + "/start"): job_path(lambda w: w.queued("--not-before", "2040-01-01")),
    ("POST", JOB + "/priority"): job_path(World.queued, {"priority": -5}),
    ("POST", JOB + "/retry"): job_path(World.cancelled),
    ("POST", JOB + "/extend"): job_path(World.done, {"spp": 8}),
    ("POST", JOB + "/develop"): job_path(World.done, {"output": {"tonemap": "aces", "formats": ["png"]}}),
    ("POST", JOB + "/comment"): job_path(World.done, {"comment": "seen"}),
    ("POST", JOB + "/cancel"): job_path(World.queued, {"discard": True}),
    ("POST", JOB + "/remove"): job_path(World.done),
    ("DELETE", JOB): job_path(World.cancelled),
    ("POST", "/api/v1/jobs"): submission,
    ("POST", "/api/v1/workers/{name}/drain"): lambda w: ({"{name}": "first"}, None),
    ("POST", "/api/v1/workers/{name}/resume"): lambda w: ({"{name}": drained(w)}, None),
    ("POST", "/api/v1/workers/{name}/block"): lambda w: ({"{name}": "nobody"}, None),
    ("POST", "/api/v1/workers/{name}/unblock"): lambda w: ({"{name}": w.blocked()}, None),
    ("POST", "/api/v1/workers/{name}/distrust"): lambda w: ({"{name}": doubted(w)}, {}),
    ("POST", "/api/v1/tokens"): lambda w: ({}, {"role": "view", "name": "new"}),
    ("DELETE", "/api/v1/tokens/{token}"): lambda w: ({"{token}": w.token()}, None),
    ("POST", "/api/v1/tokens/{token}/renew"): lambda w: ({"{token}": w.token()}, None),
    ("POST", "/api/v1/keys/{name}/revoke"): lambda w: ({"{name}": "key%d" % w.new()}, None),
    ("POST", "/api/v1/keys/{name}/rotate"): lambda w: ({"{name}": "key%d" % w.new()}, None),
    ("POST", "/api/v1/imports/{import}"): lambda w: ({"{import}": w.upload(file=True)}, {"scene": "a.gltf", "options": SMALL}),
    ("PUT", "/api/v1/blobs/{digest}"): blob,
}
# The same requests in other circumstances, which the coordinator serves otherwise.
MORE = [
    (("POST", JOB + "/extend"), job_path(World.begun, {"spp": 1000})),
    (("POST", JOB + "/retry"), job_path(World.done, {"frames": [1]})),
    (("POST", JOB + "/cancel"), job_path(World.begun)),
]
# These store nothing that the store's disk holds up, or nothing that anybody relies on: they need not wait, but must not
# hold up others either.
AT_ONCE = {
    ("POST", "/api/v1/session"): lambda w: ({}, {"token": w.page.token}),
    ("DELETE", "/api/v1/session"): lambda w: ({}, None),
    ("POST", "/api/v1/store/collect"): lambda w: ({}, {}),
    ("POST", "/api/v1/blobs/missing"): lambda w: ({}, {"digest": ["31" * 32]}),
    ("POST", "/api/v1/imports"): lambda w: ({}, {}),
    ("PUT", "/api/v1/imports/{import}/files/{path}"): lambda w: ({"{import}": w.upload(), "{path}": "a.gltf"}, b"{}"),
    ("DELETE", "/api/v1/imports/{import}"): lambda w: ({"{import}": w.upload()}, None),
}
MAY_FAIL = {("PUT", "/api/v1/imports/{import}/files/{path}")}


# What the log says of a verb that is done.
DONE = re.compile(r"job \d+ \(\w+\) is (paused|resumed|finished early|started|tried again|extended|cancelled|rid of its films|removed).*")
TOLD = {"pause", "resume", "finish", "start", "retry", "extend", "cancel", "remove"}


def changing_requests(page):
    """Of the coordinator's own description: (method, path) of all that is not a question."""
    found, path = [], None
    for line in page.get("/api/v1/openapi.yaml").body.decode().splitlines():
        begin = re.fullmatch(r'  "(/\S*)":', line)
        method = re.fullmatch(r"    (post|put|delete|patch):", line)
        path = begin.group(1) if begin else path
        if method:
            found.append((method.group(1).upper(), path))
    expect(len(found) > 20, "the description of the API has %s" % found)
    return found


class Request(threading.Thread):
    def __init__(self, page, method, path, body):
        super().__init__(daemon=True)
        self.page, self.what = page, (method, path, body)
        self.answer = None

    def run(self):
        method, path, body = self.what
        try:
            self.answer = self.page.request(method, path, body={} if body is None and method == "POST" else body, limit_s=60)
        except OSError as gone:
            self.answer = gone


class Hanging:
    """`with Hanging(disk):` the disk hangs, for files with `text` in their path, and goes on at the end, or by itself after
    HANG_S."""

    def __init__(self, disk, text="/store/"):
        self.disk, self.text = disk, text

    def __enter__(self):
        self.timer = threading.Timer(HANG_S * PATIENCE, self.disk.go_on)
        self.disk.hang(self.text)
        self.timer.start()

    def __exit__(self, *_):
        self.timer.cancel()
        self.disk.go_on()


def ask_others(page, request, what):
    """Others are answered while the request waits."""
    begun = time.monotonic()
    asked = 0
    while asked < 3 or time.monotonic() < begun + LOOK_S:
        before = time.monotonic()
        page.get("/healthz", token="")
        page.get("/api/v1/jobs?first=1")
        page.get("/api/v1/workers/first")
        took = time.monotonic() - before
        expect(took < SOON_S * PATIENCE, "%s held up others for %.1f s" % (what, took))
        asked += 1
        time.sleep(0.03)  # how often we ask
    return request and request.is_alive()


def try_one(farm, disk, page, what, recipe):
    words, body = recipe(World.of)
    log_before = len(farm.coordinator.log_text())
    method, path = what
    for word, value in words.items():
        path = path.replace(word, str(value))
    request = Request(page, method, path, body)
    with Hanging(disk):
        request.start()
        waited = ask_others(page, request, "%s %s" % what)
        early = DONE.search(farm.coordinator.log_text()[log_before:])
        expect(not waited or not early, "%s %s: the log has it before the disk: %s" % (*what, early and early.group()))
    request.join(60 * PATIENCE)
    expect(not request.is_alive(), "%s %s was never answered" % what)
    answer = request.answer
    expect(what in MAY_FAIL or (not isinstance(answer, OSError) and answer.status < 300), "%s %s: %s" % (*what, answer))
    log = farm.coordinator.log_text()[log_before:]
    expect("held up" not in log, "%s %s: %s" % (*what, log[-600:]))
    expect("/jobs/" not in path or path.split("/")[-1] not in TOLD or DONE.search(log), "%s %s: the log does not say it: %s" % (*what, log[-600:]))
    return waited


def begin(farm):
    disk = StalledDisk(farm)
    page = Page(farm.start_coordinator(env=disk.env))
    farm.start_worker("--name", "first")
    farm.wait_for_workers(1)
    World.of = World(farm, page)
    return disk, page


def scene_digest(farm, page):
    """Of the packed scene of the newest job, in base64 as JSON has it."""
    listed = page.get("/api/v1/jobs").json()["jobs"]
    with open(farm.path("scene-digest"), "w") as out:
        out.write(listed[-1]["scene"])


@tests.add
def every_change_waits_alone():
    """each verb and each route that changes something, with a disk that hangs"""
    with Farm() as farm:
        disk, page = begin(farm)
        World.of.done()
        scene_digest(farm, page)
        wrong = []
        todo = [(what, RECIPES.get(what) or AT_ONCE.get(what)) for what in changing_requests(page)]
        for what, recipe in todo + MORE:
            expect(recipe, "%s %s: has no recipe here; a new request needs one" % what)
            try:
                waited = try_one(farm, disk, page, what, recipe)
                if what in RECIPES and not waited:
                    wrong.append("%s %s was answered before it was on disk" % what)
            except Failure as why:
                wrong.append(str(why)[:300])
        expect(not wrong, "\n".join(wrong))


@tests.add
def the_coordinators_own_token():
    """its renewal, which writes files of its own, with a disk that hangs"""
    with Farm() as farm:
        disk, page = begin(farm)
        with Hanging(disk):
            request = Request(page, "POST", "/api/v1/tokens/1/renew", None)
            request.start()
            waited = ask_others(page, request, "renewal of the coordinator's own token")
        request.join(60 * PATIENCE)
        expect(waited and request.answer.status == 200, "%s %s" % (waited, request.answer))
        page.token = request.answer.json()["secret"]
        answer = page.get("/api/v1/jobs")
        expect(answer.status == 200, "the new token is not taken: %s" % answer)


@tests.add
def the_page_comes_back_while_the_token_is_renewed():
    """the page's program dies and comes back while a renewal waits for the disk: nothing stands still, page.url has the new token"""
    with Farm() as farm:
        disk, page = begin(farm)
        children = "/proc/%d/task/%d/children" % (farm.coordinator.pid, farm.coordinator.pid)
        pids = [p for p in open(children).read().split() if "azulejo-web" in open("/proc/%s/cmdline" % p).read()]
        expect(b"UV_THREADPOOL_SIZE" not in read_bytes("/proc/%s/environ" % pids[0]), "the page's program has the coordinator's environment")
        with Hanging(disk):
            renewal = farm.start_cli("token", "renew")
            wait_for(lambda: len([f for f in os.listdir(farm.store) if "web.token" in f]) > 1, "the renewal to write", HANG_S)
            os.kill(int(pids[0]), signal.SIGKILL)
            wait_for(lambda: farm.coordinator.log_text().count("info azulejo-coordinator: the page is at") == 2, "the page again", HANG_S)
            farm.cli("list", expect=0)
            expect(renewal.poll() is None, "it was answered before it was on disk")
        renewal.communicate()
        expect(renewal.returncode == 0, renewal.returncode)
        token = open(farm.path("store", "web.token"), encoding="utf-8").read().strip()
        expect(token != page.token, "the token is the old one")
        wait_for(lambda: open(farm.path("store", "page.url"), encoding="utf-8").read().strip().endswith("#token=" + token), "the link")
        expect("held up" not in farm.coordinator.log_text(), farm.coordinator.log_text()[-600:])


@tests.add
def many_changes_wait_and_questions_do_not():
    """more uploads wait for the disk than the coordinator has threads; pictures and tiles are answered meanwhile"""
    with Farm() as farm:
        disk, page = begin(farm)
        job = World.of.done()
        frame = "/api/v1/jobs/%d/frames/1" % job
        with Hanging(disk):
            puts = [Request(page, "PUT", "/api/v1/blobs/" + hashlib.sha256(b"%d" % i).hexdigest(), b"%d" % i) for i in range(12)]
            for put in puts:
                put.start()
            ask_others(page, puts[0], "uploads")  # until all of them wait
            for path in (frame + "/png", frame + "/tiles", "/api/v1/jobs?first=1"):
                before = time.monotonic()
                answer = page.get(path)
                expect(answer.status == 200, answer)
                expect(time.monotonic() - before < SOON_S * PATIENCE, "%s waited %.1f s for others' disk" % (path, time.monotonic() - before))
            expect(all(put.is_alive() for put in puts), "an upload was answered before it was on disk")
        for put in puts:
            put.join(60 * PATIENCE)
            expect(put.answer.status == 200, put.answer)


@tests.add
def a_frame_begins_meanwhile():
    """a frame begins while the disk hangs, and holds up nobody"""
    with Farm() as farm:
        disk, page = begin(farm)
        job = World.of.queued("--not-before", "2040-01-01")
        with Hanging(disk):
            request = Request(page, "POST", "/api/v1/jobs/%d/start" % job, None)
            request.start()
            wait_for(lambda: page.get("/api/v1/jobs/%d" % job).json()["jobs"][0]["state"] == "running", "the job to run", 3)
            ask_others(page, request, "a beginning frame")
            expect(request.is_alive(), "start was answered before it was on disk")
        request.join(60 * PATIENCE)
        wait_for(lambda: farm.job(job)["samples_done"] > 0, "samples")
        expect("held up" not in farm.coordinator.log_text(), farm.coordinator.log_text()[-600:])


@tests.add
def a_frames_digests_wait():
    """the digests of a finished frame's pictures wait for the disk, and nothing else does"""
    with Farm() as farm:
        disk, page = begin(farm)
        World.of.done()
        with Hanging(disk, ".sums"):
            job = farm.submit(farm.scene(), *SMALL)
            folder = farm.path("store", "outputs", str(job))
            wait_for(lambda: os.path.isdir(folder) and any(".sums." in name for name in os.listdir(folder)), "the digests", HANG_S / 2)
            ask_others(page, None, "a frame's digests")
            expect(farm.job(job)["state"] == "running", "the frame was done before its digests were on disk")
        farm.wait_for_job(job)
        expect(page.get("/api/v1/jobs/%d/frames/1/png" % job).status == 200, "the picture's digest is wrong")
        expect("held up" not in farm.coordinator.log_text(), farm.coordinator.log_text()[-600:])


if __name__ == "__main__":
    tests.run()
