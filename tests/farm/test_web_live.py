"""What pages see without asking: events, and a picture while it is rendered."""
import http.client
import json
import math
import os
import re
import socket
import struct
import subprocess
import sys
import time
import zlib

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import exr
from farm import ROOT, SANITIZED, Failure, Farm, Tests, wait_for, write_scene
from websocket import Closed, Refused, WebSocket

tests = Tests()
NAN_HALF = 0x7E00


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


class Page:
    """The page's server of a farm's coordinator."""

    def __init__(self, farm, *options):
        self.farm = farm
        # Any free port: after a restart that of the page may be somebody else's.
        options += ("--web", "127.0.0.1:0")
        if farm.address is None:
            farm.start_coordinator(*options)
        else:
            farm.restart_coordinator(*options)
        url = farm.coordinator.wait_line("page: ")
        base, self.token = url.split("/#token=")
        self.address = base.split("//")[1]

    def socket(self, **how):
        return Live(WebSocket(self.address, "/api/v1/live", self.token, **how))

    def get(self, path, token=None, headers=None):
        connection = http.client.HTTPConnection(self.address, timeout=60)
        connection.request("GET", path, headers=dict({"Authorization": "Bearer " + (token or self.token)}, **(headers or {})))
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        return answer.status, json.loads(body) if answer.status == 200 else body


class Picture:
    """What the tiles made of a picture; NaN where none came."""

    def __init__(self, told):
        self.told = told
        self.width, self.height = told["width"], told["height"]
        self.pixels = {}         # tile -> (x, y, width, height, samples, halves)
        self.count = 0

    def take(self, data):
        magic, serial, count = struct.unpack_from("<4sII", data)
        expect(magic == b"AZL1" and serial == self.told["watch"], (magic, serial))
        at = 12
        for _ in range(count):
            tile, width, height, samples = struct.unpack_from("<IHHI", data, at)
            x, y = tile % self.told["tiles_x"] * 16, tile // self.told["tiles_x"] * 16
            expect(width == min(16, self.width - x) and height == min(16, self.height - y), (tile, width, height))
            at += 12
            self.pixels[tile] = (x, y, width, height, samples, data[at:at + width * height * 8])
            at += width * height * 8
        expect(at == len(data), "%d bytes too many" % (len(data) - at))
        self.count += count

    def is_whole(self):
        return len(self.pixels) == self.told["tiles_x"] * self.told["tiles_y"]

    def channel(self, c):
        """Halves as bits, row by row."""
        out = [0] * (self.width * self.height)
        for x, y, width, height, _, halves in self.pixels.values():
            values = struct.unpack("<%dH" % (width * height * 4), halves)
            for row in range(height):
                for column in range(width):
                    out[(y + row) * self.width + x + column] = values[(row * width + column) * 4 + c]
        return out

    def samples(self):
        return {tile: p[4] / 256 for tile, p in self.pixels.items()}


class Live:
    """A WebSocket with what came over it."""

    def __init__(self, ws):
        self.ws = ws
        self.events = []         # (id, name, data)
        self.told = []           # texts about pictures: (event, data)
        self.picture = None
        self.serial = 0

    def __enter__(self):
        return self

    def __exit__(self, kind, value, trace):
        self.ws.drop()

    def listen(self, last=None):
        self.ws.send({"resume": last})
        return self

    def watch(self, job, frame=0, layer="color"):
        self.serial += 1
        self.picture = None
        self.told = []
        self.ws.send({"watch": self.serial, "job": job, "frame": frame, "layer": layer})
        return self

    def step(self, limit_s=0.2):
        message = self.ws.receive(limit_s)
        if message is None:
            return False
        if message[0] == "binary":
            if struct.unpack_from("<I", message[1], 4)[0] == self.serial:
                expect(self.picture is not None, "tiles came before their picture was announced")
                self.picture.take(message[1])
            return True
        text = json.loads(message[1])
        if text["event"] in ("picture", "picture-done"):
            if text["data"]["watch"] == self.serial:
                self.told.append((text["event"], text["data"]))
                if text["event"] == "picture":
                    self.picture = Picture(text["data"])
        else:
            self.events.append((text.get("id"), text["event"], text["data"]))
        return True

    def until(self, condition, what, limit_s=60):
        def look():
            while self.step(0.05):
                if condition():
                    return True
            return condition()
        wait_for(look, what, limit_s)
        return self

    def until_done(self, limit_s=120):
        self.until(lambda: self.told and self.told[-1][0] == "picture-done", "the picture to be done", limit_s)
        return self.told[-1][1]

    def names(self):
        return [name for _, name, _ in self.events]

    def of(self, name):
        return [data for _, n, data in self.events if n == name]

    def last_id(self):
        return [id for id, _, _ in self.events if id][-1]


def half_bits(value):
    """To the nearest half, as the coordinator does."""
    if math.isnan(value):
        return NAN_HALF
    value = max(-65504.0, min(65504.0, value))
    return struct.unpack("<H", struct.pack("<e", value))[0]


def expect_same_pixels(picture, path, names):
    """The picture's channels are the file's, to a half's precision."""
    file = exr.read_exr(path)
    expect((file.width, file.height) == (picture.width, picture.height), "another size")
    for c, name in enumerate(names):
        wanted = [half_bits(v) for v in file.values(name)]
        have = picture.channel(c)
        wrong = [i for i in range(len(wanted)) if wanted[i] != have[i] and not (wanted[i] in (0, 0x8000) and have[i] in (0, 0x8000))]
        expect(not wrong, "%s: %d of %d pixels differ, the first at %d: %04x, not %04x" % (
            name, len(wrong), len(wanted), wrong[0] if wrong else 0, have[wrong[0]] if wrong else 0,
            wanted[wrong[0]] if wrong else 0))


def exr_of(farm, job):
    return [p for p in farm.fetch(job, "fetched-%d" % job) if p.endswith(".exr")][0]


# ---- the picture ---------------------------------------------------------------------------------


@tests.add
def live_picture_ends_as_the_exr():
    """the live picture grows and ends with the pixels of the EXR file"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "64")
        with page.socket().watch(job) as live:
            live.until(lambda: live.picture, "the picture to be announced")
            told = live.picture.told
            expect((told["job"], told["frame"], told["width"], told["height"], told["tiles_x"], told["tiles_y"]) ==
                   (job, 1, 100, 70, 7, 5), told)
            expect(told["complete"] is False and told["linear"] is True and
                   told["layers"] == ["color", "samples", "error"], told)
            farm.start_worker()
            live.until(lambda: live.picture.pixels, "a tile")
            live.until_done()
            expect(live.picture.is_whole(), "%d tiles" % len(live.picture.pixels))
            expect(set(live.picture.samples().values()) == {64.0}, live.picture.samples())
            farm.wait_for_job(job)
            expect_same_pixels(live.picture, exr_of(farm, job), ["R", "G", "B"])
            errors = live.picture.channel(3)
            expect(any(0 < e < 0x7C00 for e in errors), "no standard error is known")
            expect(all(e <= 0x7C00 for e in errors), "a standard error is negative or not a number")


@tests.add
def each_sees_the_layer_that_it_asked_for():
    """two who look at one frame in work get different layers of it, each its own"""
    with Farm() as farm:
        page = Page(farm)
        worker = farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "65536")
        wait_for(lambda: farm.job(job)["samples_done"] >= 100 * 70 * 8, "a few samples of each pixel")
        worker.stop()
        wait_for(lambda: not farm.list_workers(), "all that it delivered to be there")
        with page.socket() as one, page.socket() as other:
            def seen(live, layer):
                live.watch(job, 0, layer).until(lambda: live.picture and live.picture.is_whole(), "the picture")
                return [[live.picture.channel(c) for c in range(3)], live.picture.samples()]

            # Each asks when the other has seen all of its layer.
            color, counts = seen(one, "color"), seen(other, "samples")
            expect(seen(other, "color") == color and seen(one, "samples") == counts, "another layer")
            expect(color[0] != counts[0] and color[1] == counts[1], "the layers are the same")
            expect(set(counts[0][0]) <= {half_bits(v) for v in counts[1].values()}, "not numbers of samples")


@tests.add
def done_frame_is_read_from_the_store():
    """a frame that is done comes from its film with its errors and layers, without it from its EXR file"""
    with Farm() as farm:
        page = Page(farm)
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "16", "--aov", "normal,depth,error")
        farm.wait_for_job(job)
        path = exr_of(farm, job)
        with page.socket() as live:
            done = live.watch(job, 1).until_done()
            expect("error" not in done, done)
            expect(live.told[0][1]["complete"] is True, live.told)
            expect(live.told[0][1]["layers"] == ["color", "depth", "normal", "samples", "error"], live.told)
            expect(live.picture.is_whole() and live.picture.count == 35, live.picture.count)
            expect_same_pixels(live.picture, path, ["R", "G", "B"])
            expect(any(0 < e < 0x7C00 for e in live.picture.channel(3)), "no standard error is known")
            for layer, names in (("normal", ["N.X", "N.Y", "N.Z"]), ("depth", ["Z"]),
                                 ("error", ["error.R", "error.G", "error.B"])):
                live.watch(job, 0, layer).until_done()
                expect_same_pixels(live.picture, path, names)
            done = live.watch(job, 1, "albedo").until_done()
            expect("no layer 'albedo'" in done["error"], done)
            farm.cli("cancel", job, "--discard", expect=0)  # of a done job: its films are removed
            done = live.watch(job, 1).until_done()
            expect("error" not in done, done)
            expect_same_pixels(live.picture, path, ["R", "G", "B"])
            expect(set(live.picture.channel(3)) == {NAN_HALF}, "errors that nobody knows")
            done = live.watch(job, 1, "normal").until_done()
            expect("was not kept" in done["error"], done)


@tests.add
def frame_zero_follows_the_animation():
    """a watch of frame 0 goes on with the next frame"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8", "--frames", "1-3")
        with page.socket().watch(job) as live:
            live.until(lambda: live.told, "the picture to be announced")
            farm.start_worker()
            live.until(lambda: live.picture.told["frame"] == 3 and live.told[-1][0] == "picture-done", "the third frame")
            frames = [data["frame"] for event, data in live.told if event == "picture"]
            expect(frames == sorted(frames) and set(frames) >= {1, 3}, frames)
            expect(live.picture.is_whole(), len(live.picture.pixels))


@tests.add
def frame_zero_ends_with_the_last_frame():
    """a watch of frame 0 ends with the last frame, also if frames end together or in another order"""
    with Farm() as farm:
        page = Page(farm)
        farm.start_worker(threads=2)
        for _ in range(10):  # frames of one tile: both often end between two looks of the page's server
            job = farm.submit(farm.scene(), "--size", "16x16", "--spp", "2", "--frames", "1-2")
            with page.socket().watch(job) as live:
                farm.wait_for_job(job)
                live.until(lambda: live.picture and live.picture.told["frame"] == 2 and live.told[-1][0] == "picture-done",
                           "frame 2 of job %d" % job, 5)
                expect(live.picture.is_whole(), len(live.picture.pixels))


@tests.add
def a_new_watch_replaces_the_old_one():
    """a client has one picture; what it cannot have is said; a watch of 0 ends it"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8")
        with page.socket() as live:
            for frame, words in ((7, "has frames 1 to 1"), ):
                done = live.watch(job, frame).until_done()
                expect(words in done["error"], done)
            done = live.watch(999).until_done()
            expect("there is none" in done["error"], done)
            live.watch(job).until(lambda: live.told, "the picture")
            live.ws.send({"watch": 0})
            farm.start_worker()
            farm.wait_for_job(job)
            while live.step():
                pass
            expect(not live.picture.pixels, "tiles came of a watch that ended")
            live.watch(job).until_done()
            expect(live.picture.is_whole(), len(live.picture.pixels))


@tests.add
def a_removed_job_ends_its_watch():
    """a job that is removed while it is watched: the client is told"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8")
        farm.start_worker()
        farm.wait_for_job(job)
        with page.socket().listen() as live:
            live.watch(job).until_done()
            farm.cli("remove", job, expect=0)
            live.until(lambda: "job-removed" in live.names(), "job-removed")
            expect(live.of("job-removed") == [{"job": job}], live.events)
            live.until(lambda: "error" in live.told[-1][1], "the end of the watch")


@tests.add
def an_extended_job_goes_on():
    """a done frame that goes on begins again with what it had, and ends as its new file"""
    with Farm() as farm:
        page = Page(farm)
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "10")
        farm.wait_for_job(job)
        with page.socket().watch(job) as live:
            live.until_done()
            farm.cli("extend", job, "--spp", "64", expect=0)
            live.until(lambda: live.told[-1][0] == "picture", "the picture again")
            live.until_done()
            farm.wait_for_job(job)
            expect(set(live.picture.samples().values()) == {64.0}, live.picture.samples())
            expect_same_pixels(live.picture, exr_of(farm, job), ["R", "G", "B"])


@tests.add
def a_paused_job_shows_what_it_has():
    """the picture of a paused job comes from its film on disk, and goes on when it is resumed"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "4096")
        farm.start_worker()
        with page.socket().watch(job) as live:
            live.until(lambda: live.picture and live.picture.is_whole(), "the whole picture")
            farm.cli("pause", job, expect=0)
            path = "/api/v1/jobs/%d/frames/1/tiles" % job
            with page.socket().watch(job) as other:
                other.until(lambda: other.picture and other.picture.is_whole(), "the paused job's picture")
                expect(other.told[0][1]["complete"] is False and len(other.told) == 1, other.told)
                while other.step(0.5):
                    pass
                status, told = page.get(path)
                expect(status == 200, told)
                expect({t: s["samples"] for t, s in enumerate(told["tiles"])} == other.picture.samples(),
                       "other samples than the tiles' list")
                before = other.picture.samples()
                farm.cli("resume", job, expect=0)
                other.until(lambda: other.picture.samples() != before, "the picture to go on")
                expect(all(other.picture.samples()[t] >= before[t] for t in before), "samples were lost")
                expect(len(other.told) == 1, other.told)


@tests.add
def a_restart_is_survived():
    """a killed coordinator: resuming gives a reset, and the picture goes on"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "160x120", "--spp", "512")
        farm.start_worker()
        with page.socket().listen().watch(job) as live:
            live.until(lambda: live.picture and live.picture.is_whole() and live.events, "the whole picture")
            last = live.last_id()
            farm.coordinator.kill()
            try:
                while True:
                    live.step(5)
            except (Closed, OSError):
                pass
        page = Page(farm)
        with page.socket().listen(last).watch(job) as live:
            live.until(lambda: live.events, "an event")
            expect(live.names()[0] == "reset", live.events)
            expect(live.events[0][0] != last, live.events)
            live.until(lambda: live.picture and live.picture.is_whole(), "the whole picture again")
            live.until_done()
            farm.wait_for_job(job)
            expect_same_pixels(live.picture, exr_of(farm, job), ["R", "G", "B"])


# ---- clients that do not behave ------------------------------------------------------------------


def resident(pid):
    with open("/proc/%d/statm" % pid) as f:
        return int(f.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def memory_of(program):
    return resident(program.pid)


def page_program(farm):
    """The number of the process azulejo-web."""
    pid = farm.coordinator.pid
    with open("/proc/%d/task/%d/children" % (pid, pid)) as f:
        for child in f.read().split():
            with open("/proc/%s/comm" % child) as name:
                if name.read() == "azulejo-web\n":
                    return int(child)
    raise Failure("the coordinator has no process azulejo-web")


@tests.add
def a_client_that_never_reads_costs_little():
    """clients that never read take bounded memory, and do not hold up one that does"""
    with Farm() as farm:
        page = Page(farm)
        jobs = [farm.submit(farm.scene(), "--size", "640x480", "--spp", str(spp)) for spp in (4, 1 << 20)]
        farm.start_worker()
        farm.wait_for_job(jobs[0])
        with page.socket() as live:
            live.watch(jobs[0]).until_done()
            live.watch(jobs[1]).until(lambda: live.picture and live.picture.is_whole(), "the whole picture")
            farm.cli("pause", jobs[1], expect=0)  # else the film grows, too
            before = memory_of(farm.coordinator)
            idle = [page.socket(receive_buffer=4096).listen().watch(job) for job in jobs for _ in range(8)]
            live.watch(jobs[0]).until_done()
            expect(live.picture.is_whole(), len(live.picture.pixels))
            for i in range(40):
                farm.cli("priority", jobs[1], "--to", i % 7, expect=0)
            grown = memory_of(farm.coordinator) - before
            # A queue of one mebibyte and a message each; two that are read, and what the C library keeps.
            expect(SANITIZED or grown < 16 * (3 << 19) + (12 << 20), "%d bytes more" % grown)
            for each in idle:
                each.ws.drop()


@tests.add
def slow_client_gets_the_newest():
    """a client that slept gets the tiles as they are now"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "160x120", "--spp", "512")
        farm.start_worker()
        with page.socket(receive_buffer=4096).listen().watch(job) as live:
            live.until(lambda: live.picture and live.picture.pixels, "a tile")
            wake = time.monotonic() + 8  # a client that takes nothing for 20 s is ended (docs/OPERATIONS.md)
            wait_for(lambda: farm.job(job)["state"] == "done" or time.monotonic() > wake, "the client to wake")
            if farm.job(job)["state"] != "done":
                farm.cli("finish", job)  # it may be done by now
            farm.wait_for_job(job)
            live.until_done()
            expect(live.picture.is_whole(), len(live.picture.pixels))
            expect_same_pixels(live.picture, exr_of(farm, job), ["R", "G", "B"])
            # How many states it got is the kernel's matter: its buffer of 4 MiB holds 2,000 tiles. That only the
            # newest are queued is test_web_picture's.


@tests.add
def vanishing_clients_leave_nothing():
    """five hundred clients that vanish in the middle of a picture leave nothing behind"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "320x240", "--spp", "16")
        farm.start_worker()
        farm.wait_for_job(job)

        def crowd(count):
            for i in range(count):
                with page.socket().listen().watch(job, i % 2) as live:
                    if i % 3 == 0:
                        live.until(lambda: live.picture, "the picture")
        crowd(100)
        before = memory_of(farm.coordinator)
        crowd(400)
        with page.socket().watch(job) as live:
            live.until_done()
            expect(live.picture.is_whole(), len(live.picture.pixels))
        grown = memory_of(farm.coordinator) - before
        expect(grown < 8 << 20, "%d bytes more" % grown)


@tests.add
def nonsense_is_refused_in_words():
    """messages that make no sense are refused, and the connection goes on"""
    with Farm() as farm:
        page = Page(farm)
        with page.socket() as live:
            nonsense = ["", "x", "[]", "{}", '{"watch": "1"}', '{"watch": {}}', '{"resume": null, "resume": null}',
                        '{"watch": 1' + " " * 5000 + "}", "\u0000", '{"resum": null}', "[" * 2000]
            for text in nonsense:
                live.ws.send(text)
            live.until(lambda: len(live.of("refused")) == len(nonsense), "%d refusals" % len(nonsense))
            for text in ('{"watch": -1}', '{"watch": 1, "job": -1}', '{"watch": 99999999999999999999}',
                         '{"watch": 1, "job": 1, "frame": 5000000000}', '{"watch": 2, "layer": 7}', '{"resume": 7}',
                         '{"resume": "1-1"}', '{"watch": 1, "layer": "%s"}' % ("x" * 3000)):
                live.ws.send(text)
            live.listen().until(lambda: "begin" in live.names() or "reset" in live.names(), "an answer")
        for how in ({"token": "wrong"}, {"token": None}, {"token": page.token, "origin": "http://evil.example"}):
            try:
                WebSocket(page.address, "/api/v1/live", **how).drop()
                raise Failure("was let in: %s" % how)
            except Refused as refused:
                expect(refused.status in (401, 403), refused.status)


# ---- events --------------------------------------------------------------------------------------


@tests.add
def events_say_what_changes():
    """a job's events come at most twice a second, and say the same as the API"""
    with Farm() as farm:
        page = Page(farm)
        with page.socket().listen() as live:
            live.until(lambda: live.names()[:1] == ["begin"], "the beginning")
            begun = time.monotonic()
            job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "1024")
            farm.start_worker()
            live.until(lambda: any(j["state"] == "done" for j in live.of("job")), "the job to be done")
            took = time.monotonic() - begun
            expect(len(live.of("job")) <= 2 * took + 4, "%d events in %.1f s" % (len(live.of("job")), took))
            expect({j["job"] for j in live.of("job")} == {job}, live.of("job"))
            done = [j["samples_done"] for j in live.of("job")]
            expect(done == sorted(done) and done[-1] == 64 * 48 * 1024 and len(set(done)) > 1, done)
            live.until(lambda: live.of("log") and live.of("workers") and live.of("farm"), "the other events")
            expect(all(line["job"] == job and line["text"] for line in live.of("log")), live.of("log"))
            live.until(lambda: any(w["workers"] for w in live.of("workers")), "the worker")
            status, told = page.get("/api/v1/jobs/%d" % job)
            expect(status == 200, told)
            wanted = told["jobs"][0]

            def same():
                have = live.of("job")[-1]
                return all(wanted[key] == have[key] for key in
                           ("name", "state", "samples_done", "frames_done", "frames_developed", "owner", "core_seconds"))
            live.until(same, "an event that says what the API says")


@tests.add
def resuming_misses_nothing():
    """a listener that comes back soon gets what it missed, and after a long time a reset"""
    with Farm() as farm:
        page = Page(farm)
        with page.socket().listen() as live:
            job = farm.submit(farm.scene(), "--size", "32x24", "--spp", "4")
            live.until(lambda: live.of("job"), "the job")
            last = live.last_id()
        farm.cli("pause", job, expect=0)
        with page.socket().listen(last) as live:
            live.until(lambda: any(j["state"] == "paused" for j in live.of("job")), "the pause")
            expect("reset" not in live.names() and "begin" not in live.names(), live.names())
            numbers = [int(id.split("-")[1]) for id, _, _ in live.events]
            expect(numbers == list(range(int(last.split("-")[1]) + 1, numbers[-1] + 1)), numbers)
        for stale in ("1-1", last.split("-")[0] + "-999999", "nonsense"):
            with page.socket().listen(stale) as live:
                live.until(lambda: live.events, "an event")
                expect(live.names()[0] == "reset", (stale, live.names()))


class Stream:
    """Server-sent events, read by hand."""

    def __init__(self, page, last=None, after=None):
        self.connection = http.client.HTTPConnection(page.address, timeout=30)
        headers = {"Authorization": "Bearer " + page.token}
        if last:
            headers["Last-Event-ID"] = last
        self.connection.request("GET", "/api/v1/events" + ("?after=" + after if after else ""), headers=headers)
        self.answer = self.connection.getresponse()
        expect(self.answer.status == 200, self.answer.status)
        expect(self.answer.getheader("content-type").startswith("text/event-stream"), self.answer.getheaders())

    def next(self):
        """(id, event, data); comments are left out."""
        fields = {}
        while True:
            line = self.answer.readline().decode()
            expect(line, "the stream ended")
            line = line.rstrip("\n")
            if line.startswith(":"):
                continue
            if not line:
                if fields:
                    return fields.get("id"), fields.get("event"), json.loads(fields["data"])
                continue
            name, value = line.split(": ", 1)
            fields[name] = value


@tests.add
def server_sent_events_are_the_same():
    """server-sent events: the same ids, events and resuming as over the WebSocket"""
    with Farm() as farm:
        page = Page(farm)
        with page.socket().listen() as live:
            stream = Stream(page)
            first = stream.next()
            expect(first[1] == "begin", first)
            job = farm.submit(farm.scene(), "--size", "32x24", "--spp", "4")
            farm.cli("pause", job, expect=0)
            live.until(lambda: any(j["state"] == "paused" for j in live.of("job")), "the pause")
            have = {id: (name, data) for id, name, data in live.events}
            got = []
            while not any(name == "job" and data["state"] == "paused" for _, name, data in got):
                got.append(stream.next())
            for id, name, data in got:
                if id in have:
                    expect(have[id] == (name, data), (id, name))
            for again in (Stream(page, last=got[0][0]), Stream(page, after=got[0][0])):
                expect(again.next() == got[1], "resuming goes on with another event")
            expect(Stream(page, last="7-7").next()[1] == "reset", "an id of another run")


# ---- the picture as an answer ----------------------------------------------------------------------


class Answer:
    """A frame's tiles as one answer, with nothing but http.client; the messages are the WebSocket's."""

    def __init__(self, page, job, frame=0, layer=None, token=None, receive_buffer=None):
        self.connection = http.client.HTTPConnection(page.address, timeout=60)
        if receive_buffer:
            self.connection.sock = socket.socket()
            self.connection.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
            host, port = page.address.rsplit(":", 1)
            self.connection.sock.connect((host, int(port)))
        path = "/api/v1/jobs/%d/frames/%d/live%s" % (job, frame, "?layer=" + layer if layer else "")
        self.connection.request("GET", path, headers={"Authorization": "Bearer " + (token or page.token)})
        self.answer = self.connection.getresponse()
        self.status = self.answer.status
        if self.status != 200:
            self.problem = json.loads(self.answer.read())
            self.connection.close()
        self.told, self.picture = [], None

    def step(self):
        """False: the answer has ended."""
        head = self.answer.read(4)
        if not head:
            return False
        size = struct.unpack("<I", head)[0]
        message = self.answer.read(size)
        expect(len(message) == size, "the answer ended within a message")
        if message[:1] == b"{":
            text = json.loads(message)
            expect(text["data"]["watch"] == 1, text)
            self.told.append((text["event"], text["data"]))
            if text["event"] == "picture":
                self.picture = Picture(text["data"])
        elif message:
            self.picture.take(message)
        return True

    def until(self, condition, what):
        while not condition():
            expect(self.step(), "the answer ended before " + what)
        return self

    def to_the_end(self):
        while self.step():
            pass
        self.connection.close()
        return self

    def drop(self):
        self.answer.close()
        self.connection.close()


@tests.add
def an_answer_is_the_same_picture():
    """over plain HTTP the picture grows, and ends with the EXR file's pixels; so do layers and done frames"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "64", "--aov", "normal")
        answer = Answer(page, job, 1)
        expect(answer.answer.getheader("content-type") == "application/octet-stream", answer.answer.getheaders())
        answer.until(lambda: answer.picture, "the picture was announced")
        told = answer.picture.told
        expect((told["job"], told["frame"], told["width"], told["height"], told["complete"], told["layers"]) ==
               (job, 1, 100, 70, False, ["color", "normal", "samples", "error"]), told)
        farm.start_worker()
        answer.to_the_end()
        expect([event for event, _ in answer.told] == ["picture", "picture-done"], answer.told)
        expect("error" not in answer.told[-1][1], answer.told)
        expect(answer.picture.is_whole() and set(answer.picture.samples().values()) == {64.0}, answer.picture.samples())
        farm.wait_for_job(job)
        expect_same_pixels(answer.picture, exr_of(farm, job), ["R", "G", "B"])
        again = Answer(page, job, 1, "normal").to_the_end()
        expect(again.picture.told["complete"] is True and again.picture.count == 35, again.told)
        expect_same_pixels(again.picture, exr_of(farm, job), ["N.X", "N.Y", "N.Z"])


@tests.add
def an_answer_follows_an_animation():
    """over plain HTTP frame 0 goes on with the next frame, until the job is removed"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8", "--frames", "1-3")
        answer = Answer(page, job)
        answer.until(lambda: answer.told, "the picture was announced")
        farm.start_worker()
        answer.until(lambda: answer.picture.told["frame"] == 3 and answer.told[-1][0] == "picture-done", "the third frame")
        expect(answer.picture.is_whole(), len(answer.picture.pixels))
        frames = [data["frame"] for event, data in answer.told if event == "picture"]
        expect(frames == sorted(frames) and set(frames) >= {1, 3}, frames)
        farm.wait_for_job(job)
        farm.cli("remove", job, expect=0)
        answer.to_the_end()
        expect("there is none" in answer.told[-1][1].get("error", ""), answer.told)


@tests.add
def an_answer_that_cannot_be_is_a_problem():
    """over plain HTTP what there is not is 404 with its reason, and without a token 401"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8")
        for number, frame, layer, words in ((job, 7, None, "has frames 1 to 1"), (999, 1, None, "there is none"),
                                            (job, 1, "albedo", "no layer 'albedo'"), (0, 1, None, "no job 0")):
            answer = Answer(page, number, frame, layer)
            expect(answer.status == 404 and answer.problem["code"] == "not-found", answer.problem)
            expect(words in answer.problem["detail"], answer.problem)
        answer = Answer(page, job, 1, token="azt_nobody")
        expect(answer.status == 401, answer.status)
        status, _ = page.get("/api/v1/jobs/%d/frames/1/live?frame=1" % job)
        expect(status == 400, status)


@tests.add
def an_answer_ends_with_the_coordinator():
    """over plain HTTP a killed coordinator breaks the answer off, and the next one goes on with what there was"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "160x120", "--spp", "512")
        farm.start_worker()
        answer = Answer(page, job, 1)
        answer.until(lambda: answer.picture and answer.picture.is_whole(), "the whole picture")
        farm.coordinator.kill()
        try:
            answer.to_the_end()
            raise Failure("a broken answer ended as a whole one")
        except (http.client.HTTPException, OSError):
            pass
        answer = Answer(Page(farm), job, 1).to_the_end()
        expect(answer.told[-1][0] == "picture-done" and answer.picture.is_whole(), answer.told)
        farm.wait_for_job(job)
        expect_same_pixels(answer.picture, exr_of(farm, job), ["R", "G", "B"])


@tests.add
def the_documented_program_keeps_a_picture():
    """the program of docs/API.md keeps a frame that is rendered, and ends with the EXR file's pixels"""
    with Farm() as farm:
        page = Page(farm)
        with open(os.path.join(ROOT, "docs", "API.md"), encoding="utf-8") as f:
            program = re.search(r"```python\n(.*?)```", f.read(), re.S).group(1)
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "64")
        path = farm.path("live.pfm")
        reader = subprocess.Popen([sys.executable, "-c", program, "http://%s/api/v1" % page.address, page.token, str(job), "1", path],
                                  stdout=subprocess.PIPE, text=True)
        expect(reader.stdout.readline() == "picture\n", "the picture is announced")
        farm.start_worker()
        expect(reader.communicate(timeout=120)[0] == "picture-done\n" and reader.returncode == 0, reader.returncode)
        file = exr.read_exr(exr_of(farm, job))
        with open(path, "rb") as f:
            head, size, scale, rest = f.read().split(b"\n", 3)
        expect((head, size, scale) == (b"PF", b"100 70", b"-1.0"), (head, size, scale))
        rows = [rest[at:at + 1200] for at in range(0, len(rest), 1200)][::-1]
        values = struct.unpack("<%df" % (100 * 70 * 3), b"".join(rows))
        for c, name in enumerate("RGB"):
            expect([half_bits(v) for v in values[c::3]] == [half_bits(v) for v in file.values(name)], name)


@tests.add
def pictures_that_nobody_reads_cost_little():
    """pictures that are not read, over a WebSocket or HTTP, take bounded memory and hold up no other; dropped, they leave nothing"""
    with Farm() as farm:
        page = Page(farm)
        job = farm.submit(farm.scene(), "--size", "1600x1200", "--spp", "1")  # 15 MB of tiles, of which the kernel takes 4
        farm.start_worker()
        farm.wait_for_job(job)
        web = page_program(farm)

        def seconds():
            begin = time.monotonic()
            expect(Answer(page, job, 1).to_the_end().picture.is_whole(), "a whole picture")
            with page.socket().watch(job, 1) as live:
                expect("error" not in live.until_done() and live.picture.is_whole(), live.told)
            return time.monotonic() - begin

        for kept in (True, False):
            if not kept:
                farm.cli("cancel", job, "--discard", expect=0)  # without its film the picture is read from the EXR file
            alone = seconds()
            before, handles = memory_of(farm.coordinator) + resident(web), len(os.listdir("/proc/%d/fd" % web))
            idle = [page.socket(receive_buffer=4096).watch(job, 1).ws for _ in range(4)]
            idle += [Answer(page, job, 1, receive_buffer=4096) for _ in range(4)]
            beside = seconds()
            expect(beside < 5 * alone + 5, "%.1f s, alone %.1f s" % (beside, alone))
            grown = memory_of(farm.coordinator) + resident(web) - before
            # A mebibyte and a message are queued for each, and a quarter is read ahead; without a film two have all pixels.
            expect(SANITIZED or grown < 8 * (4 << 20) + (8 << 20 if kept else 64 << 20), "%d bytes more" % grown)
            for each in idle:
                each.drop()
            wait_for(lambda: len(os.listdir("/proc/%d/fd" % web)) <= handles, "the dropped ones to end")


# ---- tiles ---------------------------------------------------------------------------------------


@tests.add
def tiles_name_their_workers():
    """each tile's samples, error, time, worker and thread are known, also of a done frame and after a restart"""
    with Farm() as farm:
        page = Page(farm)
        farm.start_worker("--name", "ana", threads=2)
        job = farm.submit(farm.scene(), "--size", "100x70", "--spp", "1024")
        path = "/api/v1/jobs/%d/frames/1/tiles" % job

        def check(told, samples=None):
            expect((told["width"], told["height"], told["tiles_x"], told["tiles_y"]) == (100, 70, 7, 5), told)
            expect(len(told["tiles"]) == 35, len(told["tiles"]))
            expect([w["name"] for w in told["workers"]] == ["ana"], told["workers"])
            expect(told["workers"][0]["process"] == farm.workers[0].pid, told["workers"])
            for tile in told["tiles"]:
                expect(tile["worker"] == 1 and tile["thread"] in (1, 2), tile)
                expect(tile["units"] > 0 and tile["cpu_ns"] > 0 and tile["passes"] > 0, tile)
                expect(tile["error"] is not None and tile["error"] >= 0, tile)
                expect(samples is None or tile["samples"] == samples, tile)

        def whole():
            status, told = page.get(path)
            # A group has no error before it is known how a display shows the frame; the other one may be far ahead by then.
            return told if status == 200 and all(t["units"] > 4 and t["error"] is not None for t in told["tiles"]) else None
        check(wait_for(whole, "all tiles"))
        farm.wait_for_job(job)
        status, told = page.get(path)
        expect(status == 200, told)
        check(told, 1024)
        shares = page.get(path + "?shares=1")[1]["tiles"]
        expect({s["thread"] for tile in shares for s in tile["shares"]} == {1, 2}, "one thread did it all")
        farm.coordinator.kill()
        page = Page(farm)
        status, again = page.get(path)
        expect(status == 200, again)
        expect(again["tiles"] == told["tiles"], "other tiles after a restart")
        check(again, 1024)
        status, why = page.get("/api/v1/jobs/%d/frames/2/tiles" % job)
        expect(status == 404 and b"frames 1 to 1" in why, why)
        farm.cli("cancel", job, "--discard", expect=0)
        status, why = page.get(path)
        expect(status == 404 and b"not kept" in why, why)


tests.run()
