"""How soon a picture can be recognised, as a table.

    make bench-preview, or: python3 -B tests/bench/bench_preview.py [SCENE [OPTION...]]

A new coordinator and one worker of two threads, which hold nothing of the scene. `azulejo fetch
--preview` is repeated from the moment that `azulejo submit` has returned. For each preview: the time from the
start of submit until it was on disk, the share of the tiles with samples, and how far it is from a
picture of 640x360 with 64 samples a pixel: the mean difference, in codes of 255, of the means of squares
whose side is 1/32 of the width. A black picture's distance is given, too.
"""
import os
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "farm"))
from farm import Farm, wait_for, read_bytes
from jobs import SPHERES, make_sky
from png import Png

SIZES = ("640x360", "1920x1080")
REFERENCE_SPP = 64
REFERENCE_SIZE = SIZES[0]
SQUARES = 32  # across
ROWS_MAX = 6


def squares(path):
    """The mean codes of squares, row by row."""
    picture = Png(read_bytes(path))
    side = max(1, picture.width // SQUARES)
    means = []
    for y in range(0, picture.height - side + 1, side):
        rows = picture.codes[y:y + side:max(1, side // 8)]  # every few rows: it is only a mean
        for x in range(0, picture.width - side + 1, side):
            part = [code for row in rows for code in row[3 * x:3 * (x + side)]]
            means.append(sum(part) / len(part) * 255 / (255 if picture.bits == 8 else 65535))
    return means


def distance(one, other):
    return sum(abs(a - b) for a, b in zip(one, other)) / len(one)


def previews(farm, scene, options, until=1.0):
    """(seconds, share of tiles, samples, path) of each preview until that share is covered."""
    found = []
    start = time.monotonic()
    number = farm.submit(scene, *options)
    accepted = time.monotonic() - start

    def look():
        path = farm.path("preview-%d.png" % len(found))
        done = farm.cli("fetch", number, "--preview", path, "--json")
        if done.code:
            return False
        shows = done.json()["preview"]
        found.append((time.monotonic() - start, shows["covered"], shows["samples"], path))
        return shows["covered"] >= until
    wait_for(look, "a covered preview", 120)
    farm.cli("cancel", number, expect=0)
    return accepted, found


def new_farm(farm, options):
    farm.start_coordinator()
    farm.start_worker(threads=2)
    farm.wait_for_workers(1)
    return options if options is not None else ["--env", make_sky(farm)]


def finished(scene, options):
    """The reference's squares."""
    with Farm() as farm:
        options = new_farm(farm, options)
        number = farm.submit(scene, *options, "--size", REFERENCE_SIZE, "--spp", str(REFERENCE_SPP))
        farm.wait_for_job(number, limit_s=600)
        return squares([f for f in farm.fetch(number) if f.endswith(".png")][0])


def measure(scene, options, size, reference):
    with Farm() as farm:
        options = new_farm(farm, options)
        accepted, found = previews(farm, scene, options + ["--size", size, "--spp", "4096"])
        new = [f for i, f in enumerate(found) if i == 0 or f[2] != found[i - 1][2]]  # not copies
        step = (len(new) + ROWS_MAX - 1) // ROWS_MAX
        rows = [(seconds, covered, samples, distance(squares(path), reference))
                for seconds, covered, samples, path in new[:-1:step] + new[-1:]]
    return accepted, rows, distance([0] * len(reference), reference)


def main():
    scene = sys.argv[1] if len(sys.argv) > 1 else SPHERES
    options = sys.argv[2:] if len(sys.argv) > 1 else None
    reference = finished(scene, options)
    for size in SIZES:
        accepted, rows, black = measure(scene, options, size, reference)
        print("%s, %s: accepted after %.2f s; a black picture is %.0f codes away" % (
            os.path.basename(scene), size, accepted, black))
        print("%8s %8s %8s %8s" % ("s", "tiles", "spp", "codes"))
        for row in rows:
            print("%8.2f %7.1f%% %8.2f %8.1f" % (row[0], 100 * row[1], row[2], row[3]), flush=True)


if __name__ == "__main__":
    main()
