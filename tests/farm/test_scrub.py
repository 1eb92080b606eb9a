"""A store in use is looked through for damage while nothing is rendered: blobs, pictures and rows, each with its remedy."""
import os
import re
import sqlite3

from farm import BUILD, Farm, Tests, read_bytes, wait_for
from jobs import Outcome, expect

tests = Tests()
SMALL = ["--size", "48x32", "--spp", "4"]
ENDLESS = ["--size", "320x200", "--spp", "1000000"]


def flip(path, at):
    with open(path, "r+b") as both:
        both.seek(at)
        old = both.read(1)
        both.seek(at)
        both.write(bytes([old[0] ^ 16]))


def largest(folder):
    return max((os.path.join(where, name) for where, _, names in os.walk(folder) for name in names), key=os.path.getsize)


def store_of(farm):
    return farm.cli("show", "--farm", "--json", expect=0).json()


@tests.add
def found_and_mended():
    """a blob, a picture and a job's row that are damaged under a running coordinator: found, said, and good again"""
    with Farm() as farm:
        farm.start_coordinator("--scrub-rate", "1G")
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        before = Outcome(farm, number, "before")
        row = farm.submit(farm.scene(), *SMALL, "--name", "mine")  # nothing else writes its row again
        farm.wait_for_job(row)
        busy = farm.submit(farm.scene(), *ENDLESS)  # nothing is looked at while this is rendered
        wait_for(lambda: farm.job(busy)["samples_done"] > 0, "samples")
        picture = os.path.join(farm.store, "outputs", str(number), "frame-0001.exr")
        flip(picture, os.path.getsize(picture) // 2)
        with sqlite3.connect(os.path.join(farm.store, "queue.sqlite")) as db:
            db.execute("UPDATE jobs SET name='other' WHERE id=?", (row,))
        db.close()
        files = store_of(farm)["scrub_files"]
        wait_for(lambda: farm.job(busy)["samples_done"] > 10 * 320 * 200, "more samples")
        expect(store_of(farm)["scrub_files"] == files, "it looked while a job was rendered")
        farm.cli("cancel", "--discard", busy, expect=0)
        blob = largest(os.path.join(farm.store, "blobs"))  # a frame in work would read it, and find the damage
        good = read_bytes(blob)
        flip(blob, os.path.getsize(blob) // 2)
        store = wait_for(lambda: (lambda s: s if s["scrubbed_at"] and s["scrub_faults"] >= 3 else None)(store_of(farm)),
                         "three faults: %s" % store_of(farm), 90)
        expect(store["scrub_faults"] == 3 and store["scrub_files"] >= 6, store)
        log = farm.coordinator.log_text()
        expect(len(re.findall("found while nothing was rendered", log)) == 3, log)
        expect(os.path.basename(blob) in log and "a row of jobs" in log and "exr file was damaged" in log, log)
        shown = farm.cli("show", "--farm", expect=0).out
        expect(re.search(r"scrub +\d+ files were read again since the start, all of them by .*; 3 were damaged", shown), shown)
        if "noweb" not in BUILD:
            expect("behind a wall" in shown or "cannot keep them from" in shown, shown)
        wait_for(lambda: os.path.exists(blob) and read_bytes(blob) == good, "the blob to come back from the worker's cache")
        wait_for(lambda: farm.cli("fetch", number, "-o", farm.path("now")).code == 0, "the picture to be made again")
        expect(Outcome(farm, number, "after").bits == before.bits, "other bits")
        again = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(again)
        expect(Outcome(farm, again, "again").bits == before.bits, "other bits of the next job")
        farm.coordinator.kill()
        farm.restart_coordinator()
        job = farm.job(row)
        expect(job["state"] == "done" and job["name"] == "mine", job)
        expect("damaged" not in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def can_be_turned_off():
    """--scrub-rate 0: nothing is read"""
    with Farm() as farm:
        farm.start_coordinator("--scrub-rate", "0")
        farm.start_worker()
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        wait_for(lambda: "listening" in farm.coordinator.log_text(), "the coordinator")
        expect(store_of(farm)["scrub_files"] == 0 and "no file was read again" in farm.cli("show", "--farm").out, store_of(farm))


if __name__ == "__main__":
    tests.run()
