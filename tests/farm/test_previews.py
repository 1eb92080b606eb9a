#!/usr/bin/env python3
"""Previews: they show the whole picture from the first moment, say what they show, and are kept while somebody looks."""
import os
import signal
import struct

from exr import read_exr
from farm import Farm, Skip, Tests, read_bytes, wait_for
from jobs import SPHERES, expect, make_sky
from png import Png

tests = Tests()


def text_of(data, keyword):
    """The number in a tEXt chunk of a PNG."""
    key = keyword.encode() + b"\0"
    at = data.index(b"tEXt" + key)
    size = struct.unpack_from(">I", data, at - 4)[0]
    return float(data[at + 4 + len(key):at + 4 + size])


def black_tiles(path):
    picture = Png(read_bytes(path))
    count = 0
    for y in range(0, picture.height, 16):
        for x in range(0, picture.width, 16):
            part = picture.part(x, y, 16, 16)
            count += not any(any(row) for row in part)
    return count


def begin(farm):
    """A job whose worker stopped before every tile had samples; its number, and its tiles."""
    for width, height in ((1280, 720), (2560, 1440), (5120, 2880)):
        number = farm.submit(SPHERES, "--env", make_sky(farm), "--size", "%dx%d" % (width, height),
                             "--spp", "4096")
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
        farm.workers[-1].signal(signal.SIGSTOP)
        if farm.job(number)["preview_covered"] < 1:
            return number, width * height // 256
        farm.workers[-1].signal(signal.SIGCONT)  # this machine was busy with something else
        farm.cli("cancel", number, "--discard", expect=0)
    raise Skip("this machine renders a frame faster than it looks at it")


def log_lines(farm, text):
    return farm.coordinator.log_text().count(text)


@tests.add
def the_first_preview_shows_the_whole_picture():
    """a preview of a part of the tiles has no black ones, and says which share has samples"""
    with Farm() as farm:
        farm.start_coordinator("--log-level", "debug")
        queued = farm.submit(SPHERES, "--env", make_sky(farm), "--size", "64x64", "--spp", "4")
        result = farm.cli("fetch", queued, "--preview", "none.png", expect=5)
        expect("no samples yet" in result.err and not os.path.exists(farm.path("none.png")), result)
        farm.cli("cancel", queued, expect=0)
        farm.start_worker()
        number, tiles = begin(farm)
        result = farm.cli("fetch", number, "--preview", "part.png", "--json", expect=0)
        shows = result.json()["preview"]
        expect(0 < shows["covered"] < 1 and 0 < shows["samples"] < 4 and shows["frame"] == 1 and
               shows["spp"] == 4096, shows)
        data = read_bytes(farm.path("part.png"))
        expect(abs(text_of(data, "azulejo:covered") - shows["covered"]) < 1e-4, shows)
        expect(abs(text_of(data, "azulejo:samplesMean") - shows["samples"]) < 0.01, shows)
        expect(black_tiles(farm.path("part.png")) == 0, "black tiles")
        result = farm.cli("fetch", number, "--preview", "part.png", expect=0)
        expect("% of the tiles have any" in result.out and "filled" in result.out, result)
        farm.cli("fetch", number, "--preview", "part.exr", expect=0)
        picture = read_exr(farm.path("part.exr"))
        expect(picture.number("azulejo:tilesWithoutSamples") > 0, "no tile is empty")
        expect(abs(picture.number("azulejo:covered") + picture.number("azulejo:tilesWithoutSamples") / tiles - 1)
               < 1e-9, picture.number("azulejo:covered"))
        expect(picture.black_tiles() == 0, "black tiles")
        job = farm.job(number)
        expect(0 < job["preview_covered"] < 1 and not job["preview_ready"], job)
        # A coordinator that is killed has the film on disk, and makes the preview again.
        farm.coordinator.kill()
        farm.restart_coordinator()
        result = wait_for(lambda: (lambda r: r if r.code == 0 else None)(
            farm.cli("fetch", number, "--preview", "again.png", "--json")), "a preview after a restart")
        expect(0 < result.json()["preview"]["covered"] < 1, result)
        expect(black_tiles(farm.path("again.png")) == 0, "black tiles")


@tests.add
def a_kept_preview_is_a_copy():
    """a preview is made when it is asked for, and not again for the same film; new settings are followed at once"""
    with Farm() as farm:
        farm.start_coordinator("--log-level", "debug")
        farm.start_worker()
        number = farm.submit(SPHERES, "--env", make_sky(farm), "--size", "160x96", "--spp", "100000")
        wait_for(lambda: farm.job(number)["preview_ready"], "all tiles")
        expect(log_lines(farm, "a preview took") == 0, "nobody had asked for it")
        farm.workers[0].signal(signal.SIGSTOP)
        # The film stands still: what is kept follows it, and then nothing is made any more.
        done = farm.job(number)["samples_done"] / (160 * 96)

        def shown():
            return farm.cli("fetch", number, "--preview", "a.png", "--json",
                            expect=0).json()["preview"]
        wait_for(lambda: abs(shown()["samples"] - farm.job(number)["samples_done"] / (160 * 96)) < 1e-9,
                 "the newest preview")
        expect(shown()["covered"] == 1 and shown()["samples"] >= done, shown())
        made = log_lines(farm, "a preview took")
        for name in ("b.png", "c.png", "d.png"):
            farm.cli("fetch", number, "--preview", name, expect=0)
            expect(read_bytes(farm.path(name)) == read_bytes(farm.path("a.png")), name)
        expect(log_lines(farm, "a preview took") == made, "it was made again")
        farm.cli("develop", number, "--exposure", "3", expect=0)
        farm.cli("fetch", number, "--preview", "e.png", expect=0)
        expect(read_bytes(farm.path("e.png")) != read_bytes(farm.path("a.png")), "the old settings")
        # A paused job has none: its film is on disk.
        farm.cli("pause", number, expect=0)
        wait_for(lambda: farm.job(number)["state"] == "paused", "the pause")
        result = farm.cli("fetch", number, "--preview", "f.png", expect=5)
        expect("paused" in result.err and "resume" in result.err, result)


tests.run()
