#!/usr/bin/env python3
"""azulejo owners: which worker and thread rendered each tile, as legend, JSON and picture."""
import json

from farm import Farm, Tests, read_bytes, wait_for
from jobs import expect
from png import Png

tests = Tests()
JOB = ("--size", "120x90", "--spp", "64")
COLUMNS, ROWS = 8, 6                             # the last ones are cut
ENDLESS = ("--size", "64x48", "--spp", "1000000")
NAMES = ("ana", "bruno", "carla")
GREY = (24, 24, 24)                              # of tiles without samples


def started(farm, names=NAMES, threads=1):
    farm.start_coordinator()
    workers = [farm.start_worker("--name", name, threads=threads) for name in names]
    farm.wait_for_workers(len(names))
    return workers


def owners(farm, number, *options):
    return farm.cli("owners", number, "--json", *options, expect=0).json()


def units_sent(farm, number):
    """(worker, thread, tile) of every unit in the job's trace, which is noted apart from the films."""
    events = json.loads(farm.cli("trace", number, expect=0).out)["traceEvents"]
    names = {e["pid"]: e["args"]["name"].split()[1] for e in events if e["name"] == "process_name" and
             e["args"]["name"].startswith("worker ")}
    threads = {(e["pid"], e["tid"]): e["args"]["name"].split()[1] for e in events if e["name"] == "thread_name" and
               e["pid"] in names}
    return [(names[e["pid"]], int(threads[e["pid"], e["tid"]]), e["args"]["tile"])
            for e in events if e.get("cat") == "render"]


def check(seen, spp=None):
    """What must hold of any frame: tiles, workers and shares agree."""
    tiles, workers = seen["tiles"], {w["name"]: w for w in seen["workers"]}
    expect(len(tiles) == seen["tiles_x"] * seen["tiles_y"], len(tiles))
    for i, tile in enumerate(tiles):
        expect(tile["x"] == i % seen["tiles_x"] * 16 and tile["y"] == i // seen["tiles_x"] * 16, tile)
        expect(tile["width"] == min(16, seen["width"] - tile["x"]), tile)
        expect(tile["height"] == min(16, seen["height"] - tile["y"]), tile)
        shares = tile["shares"]
        expect(sum(s["units"] for s in shares) == tile["units"], tile)
        expect(sum(s["samples"] for s in shares) == tile["samples"], tile)
        expect(spp is None or tile["samples"] == spp, tile)
        if not shares:
            expect(tile["worker"] is None and tile["color"] is None, tile)
            continue
        by_worker = {}
        for s in shares:
            by_worker[s["worker"]] = by_worker.get(s["worker"], 0) + s["samples"]
        expect(by_worker[tile["worker"]] == max(by_worker.values()), tile)
        mine = [s for s in shares if s["worker"] == tile["worker"]]
        expect(tile["thread"] in [s["thread"] for s in mine if s["samples"] == max(m["samples"] for m in mine)], tile)
    for name, worker in workers.items():
        expect(worker["tiles"] == sum(t["worker"] == name for t in tiles), worker)
        shares = [(s, t) for t in tiles for s in t["shares"] if s["worker"] == name]
        expect(worker["units"] == sum(s["units"] for s, _ in shares), worker)
        expect(worker["samples"] == sum(s["samples"] * t["width"] * t["height"] for s, t in shares), worker)
        expect(worker["threads"] == sorted({s["thread"] for s, _ in shares if s["thread"]}), worker)
    expect(abs(sum(w["samples_share"] for w in workers.values()) - 1) < 1e-9, workers)
    return workers


def shared_by_all(farm):
    """A finished job of which each of the three workers rendered units; the answer about it."""
    def one():
        number = farm.submit(farm.scene(), *JOB)
        farm.wait_for_job(number)
        seen = owners(farm, number)
        return (number, seen) if len(seen["workers"]) == 3 else None
    return wait_for(one, "a job that all three work for")


def rgb(color):
    return tuple(int(color[i:i + 2], 16) for i in (1, 3, 5)) if color else GREY


def check_picture(data, seen, scale):
    picture = Png(data)
    expect((picture.width, picture.height) == (seen["width"] * scale, seen["height"] * scale), picture.width)
    for tile in seen["tiles"]:
        for x, y in ((0.5, 0.5), (0.9, 0.3), (0.3, 0.9)):
            at, line = int((tile["x"] + x * tile["width"]) * scale), int((tile["y"] + y * tile["height"]) * scale)
            code = picture.codes[line][3 * at:3 * at + 3]
            expect(tuple(code) == rgb(tile["color"]), (tile, code))
    return picture


@tests.add
def three_workers():
    """Each tile has one of three workers; units agree with the trace, pixels with the JSON, the legend with both"""
    with Farm() as farm:
        started(farm, threads=2)
        number, seen = shared_by_all(farm)
        expect((seen["job"], seen["frame"], seen["tiles_x"], seen["tiles_y"]) == (number, 1, COLUMNS, ROWS), seen)
        workers = check(seen, spp=64)
        expect(set(workers) == set(NAMES), list(workers))
        sent = units_sent(farm, number)
        for name, worker in workers.items():
            expect(worker["units"] == sum(w == name for w, _, _ in sent), (name, worker["units"]))
            expect(set(worker["threads"]) == {t for w, t, _ in sent if w == name} <= {1, 2}, worker)
            expect(worker["process"] in [w.pid for w in farm.workers], worker)
        for i, tile in enumerate(seen["tiles"]):
            units = sorted((w, t) for w, t, at in sent if at == i)
            expect(units == sorted((s["worker"], s["thread"]) for s in tile["shares"] for _ in range(s["units"])), tile)
        # The first three are red, green and blue.
        expect([w["color_name"] for w in seen["workers"]] == ["red", "green", "blue"], seen["workers"])
        path = farm.path("owners.png")
        legend = farm.cli("owners", number, "-o", path, expect=0).out
        for name, worker in workers.items():
            expect([worker["color_name"], name, "%d" % len(worker["threads"]), "%d" % worker["tiles"],
                    "%d" % worker["units"], "%.1f" % (100 * worker["samples_share"]), "%"] in
                   [line.split() for line in legend.splitlines()], legend)
        check_picture(read_bytes(path), seen, 4)
        check_picture(farm.cli_bytes("owners", number, "-o", "-", "--scale", "3"), seen, 3)
        farm.cli("owners", number, "-o", farm.path("owners.json"), expect=0)
        with open(farm.path("owners.json")) as text:
            expect(json.load(text) == seen, "the file is what is printed")
        # The frame's picture shines through: each pixel is a mixture with the same weights.
        plain = check_picture(farm.cli_bytes("owners", number, "-o", "-", "--scale", "1"), seen, 1)
        over = Png(farm.cli_bytes("owners", number, "-o", "-", "--scale", "1", "--over"))
        frame = Png(read_bytes([f for f in farm.fetch(number) if f.endswith(".png")][0]))
        for y in range(plain.height):
            for mixed, tint, code in zip(over.codes[y], plain.codes[y], frame.codes[y]):
                expect(abs(mixed - (0.45 * tint + 0.55 * code)) <= 1.01, (y, mixed, tint, code))


def has_at_least(seen, stored):
    """Each thread has its samples of each tile still, or more."""
    for old, new in zip(stored["tiles"], seen["tiles"]):
        for share in old["shares"]:
            expect(any((s["worker"], s["thread"]) == (share["worker"], share["thread"]) and
                       s["samples"] >= share["samples"] for s in new["shares"]), (old, new))


@tests.add
def restarts():
    """After the coordinator was killed, while a frame is in work and when it is done, each worker is still one"""
    with Farm() as farm:
        started(farm)
        number = farm.submit(farm.scene(), *ENDLESS)

        def far():
            now = owners(farm, number) if farm.job(number)["samples_done"] else {"workers": [], "tiles": []}
            return len(now["workers"]) >= 2 and sum(t["units"] for t in now["tiles"]) > 100
        wait_for(far, "two workers' units, most of which must be on disk")
        # What is on disk when the coordinator is killed stays as it was.
        farm.cli("pause", number, expect=0)
        before = owners(farm, number)
        check(before)
        farm.coordinator.kill()
        farm.restart_coordinator()
        stored = owners(farm, number)
        check(stored)
        expect(len(stored["workers"]) >= 2, stored["workers"])
        has_at_least(before, stored)
        farm.wait_for_workers(3)
        farm.cli("resume", number, expect=0)
        units = sum(t["units"] for t in stored["tiles"])
        wait_for(lambda: sum(t["units"] for t in owners(farm, number)["tiles"]) > units + 6, "more units")
        farm.cli("finish", number, expect=0)
        farm.wait_for_job(number)
        seen = owners(farm, number)
        workers = check(seen)
        expect(set(workers) <= set(NAMES), list(workers))
        expect({w["process"] for w in workers.values()} <= {w.pid for w in farm.workers}, workers)
        has_at_least(seen, stored)
        # Without any worker, and started again: the same from the kept film.
        for worker in farm.workers:
            worker.stop()
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(owners(farm, number) == seen, "the same after another restart")


@tests.add
def errors():
    """Errors name the job, the frame or the option, and say what to do"""
    with Farm() as farm:
        farm.start_coordinator()

        def refused(code, words, *arguments):
            result = farm.cli("owners", *arguments)
            expect(result.code == code and words in result.err and not result.out, result)

        refused(5, "job 7", 7)
        number = farm.submit(farm.scene(), *JOB, "--frames", "1-2")
        refused(5, "job %d, frame 1 has no samples yet" % number, number)
        refused(5, "job %d has frames 1 to 2" % number, number, "--frame", "3")
        refused(2, "argument is missing")
        refused(2, "picture.jpg: must end in .png", number, "-o", "picture.jpg")
        refused(2, "--over is about the picture", number, "--over")
        refused(2, "--scale is about the picture", number, "--scale", "2", "-o", "x.json")
        refused(2, "give one of them", number, "-o", "-", "--json")
        farm.start_worker()
        farm.wait_for_job(number)
        expect({owners(farm, number, "--frame", f)["frame"] for f in (1, 2)} == {1, 2}, "frames")
        refused(8, "no/such", number, "-o", farm.path("no", "such", "folder.png"))
        no_png = farm.submit(farm.scene(), *JOB, "--format", "exr")
        farm.wait_for_job(no_png)
        refused(5, "makes no PNG or JPEG", no_png, "--over", "-o", farm.path("over.png"))
        jpeg = farm.submit(farm.scene(), *JOB, "--format", "exr,jpg")
        farm.wait_for_job(jpeg)
        farm.cli("owners", jpeg, "--over", "-o", farm.path("over.png"), expect=0)
        farm.cli("prune", number, "--films", "--yes", expect=0)
        refused(5, "its film was not kept", number)


tests.run()
