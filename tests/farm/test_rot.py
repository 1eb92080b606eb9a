"""Bits that flip at rest, on the coordinator's disk: noticed, never passed on, and what is lost is made or sent again."""
import glob
import os
import shutil
import sqlite3
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, Farm, Tests, read_bytes, wait_for
from jobs import expect
from exr import read_exr
from odd import OddPeer

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]


def flip(path, at=None):
    """One bit, as a disk does it: the file's times stay."""
    info = os.stat(path)
    with open(path, "r+b") as both:
        place = info.st_size // 2 if at is None else at
        both.seek(place)
        byte = both.read(1)[0]
        both.seek(place)
        both.write(bytes([byte ^ 1]))
    os.utime(path, ns=(info.st_atime_ns, info.st_mtime_ns))


def blobs(farm):
    return glob.glob(os.path.join(farm.store, "blobs", "??", "*"))


def bits(farm, number):
    folder = farm.path("fetched-%d" % number)
    files = farm.cli("fetch", number, "-o", folder, "--json", expect=0).json()["files"]
    return read_exr(os.path.join(farm.folder, next(f for f in files if f.endswith(".exr")))).bits()


def forget_cache(worker_cache):
    shutil.rmtree(worker_cache, ignore_errors=True)


@tests.add
def blobs_are_sent_again():
    """a damaged blob of any kind is noticed when its job is submitted again, sent again, and the job is done"""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker()
        first = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(first)
        good = {path: read_bytes(path) for path in blobs(farm)}
        expect(len(good) >= 2, good)
        for path in good:
            worker.kill()
            forget_cache(farm.path("cache-%d" % len(farm.workers)))
            farm.coordinator.stop()
            flip(path)
            farm.restart_coordinator()
            worker = farm.start_worker()
            number = farm.submit(farm.scene(), *SMALL)
            farm.wait_for_job(number)
            expect(bits(farm, number) == bits(farm, first), "other bits")
            expect(read_bytes(path) == good[path], "it is still damaged")


@tests.add
def a_queued_job_waits_for_its_blob():
    """a blob that rots under a queued job is not sent; the job waits, says so, and goes on when the scene comes again"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        for path in blobs(farm):
            flip(path)
        farm.start_worker()

        def look():
            job = farm.job(number)
            expect(job["state"] in ("queued", "running"), job)
            return "submit the scene again" in job["state_text"]
        wait_for(look, "the reason")
        again = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(again)
        farm.wait_for_job(number)
        expect(bits(farm, number) == bits(farm, again), "other bits")


ENDLESS = ["--size", "128x96", "--spp", "1000000"]


def units_of(farm, name):
    return sum(w["units_done"] for w in farm.list_workers() if w["name"] == name)


@tests.add
def a_workers_cache_has_it():
    """a blob that rots or is cut under a job comes back from a worker that has it: the next worker renders, nothing is submitted"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        number = farm.submit(farm.scene(), *ENDLESS)
        farm.start_worker("--name", "first")
        wait_for(lambda: units_of(farm, "first") > 0, "the first worker's results")
        good = {path: read_bytes(path) for path in blobs(farm)}
        expect(len(good) >= 2, good)
        harms = (flip, lambda path: os.truncate(path, os.path.getsize(path) // 2), os.unlink)
        for at, harm in enumerate(harms):
            for path in good:
                harm(path)
            name = "after-%d" % at
            farm.start_worker("--name", name)
            wait_for(lambda: units_of(farm, name) > 0, "the results of a worker that lacked the blobs: %s" % farm.job(number))
            expect(all(read_bytes(path) == good[path] for path in good), "a blob is still damaged")
        expect("from the cache of worker" in farm.coordinator.log_text(), farm.coordinator.log_text())


@tests.add
def others_send_no_blobs():
    """a worker sends a blob only when it is asked for it; one that sends other bytes, or none, is passed by"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        number = farm.submit(farm.scene(), *ENDLESS)
        liar, empty, silent = [OddPeer(farm, hello="threads=1 name=" + name) for name in ("liar", "empty", "silent")]
        liar.say("put 1 %s 00" % ("00" * 32))
        expect("and no others" in liar.wait_line("failure request=1 "), "a blob that was not asked for")
        farm.start_worker("--name", "honest")
        wait_for(lambda: units_of(farm, "honest") > 0, "results")
        path = max(blobs(farm), key=os.path.getsize)
        good = read_bytes(path)
        flip(path)
        for name in ("one", "two"):  # the first one finds the damage
            farm.start_worker("--name", name)
        request, digest = liar.wait_line("wanted ").split()
        expect(digest == os.path.basename(path), digest)
        liar.say("put %s %s 0011" % (request, digest))
        request, digest = empty.wait_line("wanted ").split()
        empty.say("put %s %s -" % (request, digest))
        silent.wait_line("wanted ")
        silent.kill()
        for name in ("one", "two"):
            wait_for(lambda: units_of(farm, name) > 0, "the results of %s: %s" % (name, farm.job(number)))
        expect(read_bytes(path) == good, "it is still damaged")
        liar.say("put %s %s 0011" % (request, digest))  # too late, or never its own
        expect(farm.job(number)["state"] == "running", farm.job(number))
        wait_for(lambda: "blob %.12s is back, from the cache of worker honest" % digest in farm.coordinator.log_text(), "its line")
        expect("sent other bytes" in farm.coordinator.log_text(), farm.coordinator.log_text())


def outputs(farm, number, extension):
    return [path for path in glob.glob(os.path.join(farm.store, "outputs", str(number), "*"))
            if os.path.basename(path).split(".", 1)[1] == extension]


@tests.add
def pictures_are_made_again():
    """a damaged or cut EXR, PNG, JPEG or manifest is never fetched: it is made again from the film, with the same bits, also where
    pictures are made of several frames"""
    made_again(())
    made_again(("--denoise", "on", "--denoise-around", "1"))


def made_again(look):
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "64x64", "--spp", "4", "--frames", "1-2", "--format", "exr,png,jpg", "--half",
                             *look)
        farm.wait_for_job(number)
        worker.stop()
        good = {os.path.basename(f): f for f in farm.fetch(number)}
        before = {name: read_bytes(path) for name, path in good.items()}
        pixels = {name: read_exr(path).bits() for name, path in good.items() if name.endswith(".exr")}
        harms = (flip, lambda path: os.truncate(path, os.path.getsize(path) // 2), lambda path: os.truncate(path, 0))
        for place, extension in enumerate(("exr", "png", "jpg", "effects.json", "picture.exr", "sums")):
            path = sorted(outputs(farm, number, extension))[place % 2]
            harms[place % 3](path)
            answer = farm.cli("fetch", number, "--manifest", "-o", farm.path("after-%d" % place), "--frames", place % 2 + 1)
            if extension == "picture.exr":
                expect(answer.code == 0, answer)  # nobody fetches it: it is found when it is read
                farm.cli("develop", number, "--tonemap", "reinhard02", *look, expect=0)
            else:
                expect(answer.code in (8, 9), answer)
                expect("damaged" in answer.err and "made again" in answer.err, answer)

            def is_there():
                return farm.job(number)["state"] == "done" and \
                    farm.cli("fetch", number, "--manifest", "-o", farm.path("again-%d" % place)).code == 0
            wait_for(is_there, "the picture after a damaged " + extension)
            for name in before:
                fresh = farm.path("again-%d" % place, name)
                if name.endswith(".exr"):
                    expect(read_exr(fresh).bits() == pixels[name], name)
                elif not name.endswith(".json"):
                    expect(read_bytes(fresh) == before[name], name)
        expect("made again from its film" in farm.cli("log", number, expect=0).out, farm.cli("log", number).out)


@tests.add
def pictures_without_films():
    """without the film a PNG is developed from the EXR; a damaged EXR is refused with the remedy, which works"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        good = bits(farm, number)
        farm.cli("prune", number, "--films", "--yes", expect=0)
        png = outputs(farm, number, "png")[0]
        before = read_bytes(png)
        flip(png)
        answer = farm.cli("fetch", number, "-o", farm.path("other"))
        expect(answer.code == 9 and "developed again" in answer.err, answer)
        wait_for(lambda: farm.cli("fetch", number, "-o", farm.path("other")).code == 0, "the PNG")
        expect(read_bytes(png) == before, "another PNG")
        flip(outputs(farm, number, "exr")[0])
        answer = farm.cli("fetch", number, "-o", farm.path("third"))
        expect(answer.code == 9 and "azulejo retry %d --frames 1" % number in answer.err, answer)
        farm.cli("retry", number, "--frames", "1", expect=0)
        farm.wait_for_job(number)
        expect(bits(farm, number) == good, "other bits")


def start(farm):
    return subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--listen", "127.0.0.1:0", "--no-web", "--key", farm.key,
                           "--store", farm.store], stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60)


@tests.add
def no_queue_beside_films():
    """a store that lost its queue, or has an empty one, is refused with the remedy: numbers never begin again"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        farm.wait_for_job(farm.submit(farm.scene(), *SMALL))
        farm.coordinator.stop()
        queue = os.path.join(farm.store, "queue.sqlite")
        kept = read_bytes(queue)
        for harm in (lambda: os.unlink(queue), lambda: open(queue, "wb").close()):
            harm()
            before = os.path.getsize(queue) if os.path.exists(queue) else None
            ended = start(farm)
            expect(ended.returncode == 8, ended)
            expect(b"restore" in ended.stderr and b"outputs/1" in ended.stderr, ended.stderr)
            expect((os.path.getsize(queue) if os.path.exists(queue) else None) == before, "something was made of it")
        with open(queue, "wb") as out:
            out.write(kept)
        farm.start_coordinator()
        expect(farm.submit(farm.scene(), *SMALL) == 2, "another number")


@tests.add
def a_lost_sequence():
    """the newest job was removed, and where SQLite keeps the next number is damaged: it is not given again, also after --repair"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        newest = 0
        for repairs in (False, True):
            for _ in range(2):
                newest = farm.submit(farm.scene(), *SMALL)
            farm.cli("cancel", newest, expect=0)
            wait_for(lambda: farm.job(newest)["state"] == "cancelled", "its end")
            farm.cli("remove", newest, "--yes", expect=0)
            farm.coordinator.stop()
            with sqlite3.connect(os.path.join(farm.store, "queue.sqlite")) as queue:
                queue.execute("DELETE FROM sqlite_sequence WHERE name='jobs'")
            queue.close()
            if repairs:
                said = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--check", "--repair", "--store", farm.store],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60, check=False)
                expect(b"next job's number" in said.stdout, said)
            farm.start_coordinator("--no-web")
            number = farm.submit(farm.scene(), *SMALL)
            expect(number == newest + (1001 if repairs else 1), (number, "after", newest))


@tests.add
def a_bad_schema():
    """a damaged name of a column is found by --check, and --repair brings every row back, also what keys were revoked"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        farm.start_worker("--name", "one")
        number = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(number)
        farm.cli("key", "revoke", "bruno", expect=0)
        log = farm.cli("log", number, expect=0).out
        farm.workers[0].stop()
        for table, name, flipped in (("jobs", "priority", "qriority"), ("events", "job", "jnb"), ("keys", "revoked", "sevoked")):
            farm.coordinator.stop()
            with sqlite3.connect(os.path.join(farm.store, "queue.sqlite")) as queue:
                queue.execute("PRAGMA writable_schema=ON")
                queue.execute("UPDATE sqlite_master SET sql=replace(sql, ?, ?) WHERE name=?", (name, flipped, table))
            queue.close()
            refused = start(farm)
            expect(refused.returncode == 8 and b"--repair" in refused.stderr, refused)
            for more, code in (([], 8), (["--repair"], 0), ([], 0)):
                said = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--check", *more, "--store", farm.store],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60, check=False)
                expect(said.returncode == code and (code == 0 or b"--repair saves what can be read" in said.stdout), (table, said))
            farm.start_coordinator("--no-web")
            expect(farm.job(number)["state"] == "done", farm.job(number))
            expect(farm.cli("log", number, expect=0).out.startswith(log), "another log")
            expect("bruno" in farm.cli("key", "list", expect=0).out, "it may come in again")


@tests.add
def a_bad_row():
    """a job whose row is damaged is parked with the reason; the farm starts, and all others go on"""
    with Farm() as farm:
        farm.start_coordinator()
        first, bad, last = [farm.submit(farm.scene(), *SMALL) for _ in range(3)]
        farm.coordinator.stop()
        with sqlite3.connect(os.path.join(farm.store, "queue.sqlite")) as queue:
            queue.execute("UPDATE jobs SET request=x'ff00ff' WHERE id=?", (bad, ))
        queue.close()
        farm.start_coordinator()
        farm.start_worker()
        farm.wait_for_job(first)
        farm.wait_for_job(last)
        job = farm.job(bad)
        expect(job["state"] == "parked" and "damaged" in job["state_text"], job)
        expect(farm.cli("resume", bad).code == 5, "it was resumed")
        for _ in range(2):  # it stays so, and can be removed
            farm.coordinator.stop()
            farm.start_coordinator()
            expect(farm.job(bad)["state"] == "parked", farm.job(bad))
        farm.cli("cancel", bad, expect=0)
        wait_for(lambda: farm.job(bad)["state"] == "cancelled", "its end")
        farm.cli("remove", bad, "--yes", expect=0)


if __name__ == "__main__":
    tests.run()
