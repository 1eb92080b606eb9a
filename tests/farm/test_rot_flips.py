"""Random flips and cuts over all kinds of files in a store, seeded: never silent, never unstartable, the remedy in one line.

ROT_ROUNDS (70) says how many, ROT_SEED (1) which."""
import functools
import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, Farm, Tests, read_bytes, wait_for
from jobs import expect
from exr import read_exr

tests = Tests()
ROUNDS, SEED = int(os.environ.get("ROT_ROUNDS", "70")), int(os.environ.get("ROT_SEED", "1"))
SMALL = ["--size", "48x32", "--spp", "4"]
LEFT_ALONE = ("lock", "hold", "reserve", "audit.log", "queue.sqlite-shm")  # their bytes decide nothing
REMEDIES = ("azulejo", "again", "--repair", "back-up", "is removed", "made again")


def stored(farm, table):
    queue = sqlite3.connect("file:%s?mode=ro" % os.path.join(farm.store, "queue.sqlite"), uri=True)
    try:
        return queue.execute("SELECT count(*) FROM " + table).fetchone()[0]
    finally:
        queue.close()


def make_store(farm):
    """Jobs of one frame and of several, with every kind of picture, and one in work; the newest was removed. A token, a
    revoked key, a blocked name, and what waits to be rendered on a second worker."""
    farm.start_coordinator()
    farm.start_worker()
    for more in ([], ["--frames", "1-3", "--format", "exr,png,jpg", "--half"], ["--name", "last"]):
        number = farm.submit(farm.scene(), *SMALL, *more)
        farm.wait_for_job(number)
    farm.cli("workers", "block", "somebody", expect=0)
    farm.cli("comment", number, "a word", expect=0)
    farm.cli("token", "create", "--name", "ana", "--role", "view", expect=0)
    farm.cli("key", "revoke", "bruno", expect=0)
    begun = farm.submit(farm.scene(), "--size", "48x32", "--spp", "1000000")
    wait_for(lambda: farm.job(begun)["samples_done"] > 0, "samples")
    farm.cli("pause", begun, expect=0)
    wait_for(lambda: farm.job(begun)["state"] == "paused" and stored(farm, "votes") > 0, "an open film, and votes in the store")
    removed = farm.submit(farm.scene(), *SMALL)
    farm.wait_for_job(removed)
    farm.cli("remove", removed, "--yes", expect=0)
    whole = state_of(farm)
    farm.workers[0].stop()
    farm.coordinator.stop()
    return whole, removed


@functools.lru_cache(None)
def pixels(path, content):
    """Of an EXR file with these bytes: in most rounds they are those of the rounds before."""
    return read_exr(path).bits()


def pictures(farm, number, where):
    """{name: pixels or bytes} of what can be fetched, and what is said of the rest."""
    folder = farm.path(where)
    shutil.rmtree(folder, ignore_errors=True)
    answer = farm.cli("fetch", number, "-o", folder)
    found = {}
    for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else ():
        path = os.path.join(folder, name)
        if name[0] != "." and os.path.isfile(path):
            content = read_bytes(path)
            found[name] = pixels(path, content) if name.endswith(".exr") else content
    return answer, found


def state_of(farm):
    """What people see of the farm's jobs."""
    seen = {}
    for job in farm.cli("list", "--json", expect=0).json()["jobs"]:
        number = job["job"]
        log = [line for line in farm.cli("log", number, expect=0).out.splitlines()]
        seen[number] = (job["state"], job["name"], log, pictures(farm, number, "see-%d" % number)[1])
    marks = [(m["name"], m["blocked"]) for m in farm.cli("workers", "--json", expect=0).json()["marks"]]
    return seen, marks


def files_of(store):
    found = []
    for folder, _, names in os.walk(store):
        for name in names:
            path = os.path.join(folder, name)
            if name not in LEFT_ALONE and os.path.getsize(path) > 0:
                found.append(path)
    return sorted(found)


def kind_of(path):
    name = os.path.basename(path)
    return name.split(".", 1)[1] if "." in name else "blob"


def harm(path, dice):
    """A flip, a few flips in one block, zeros or a cut, as disks do it; the file's times stay."""
    info = os.stat(path)
    what = dice.choice(("flip", "flip", "flips", "zeros", "cut"))
    at = dice.randrange(info.st_size)
    if what == "cut":
        os.truncate(path, at)
    else:
        with open(path, "r+b") as both:
            for _ in range(1 if what != "flips" else 8):
                both.seek(at)
                old = both.read(64 if what == "zeros" else 1)
                both.seek(at)
                both.write(bytes(len(old)) if what == "zeros" else bytes([old[0] ^ 1 << dice.randrange(8)]))
                at = min(info.st_size - 1, at + dice.randrange(1, 200))
    os.utime(path, ns=(info.st_atime_ns, info.st_mtime_ns))
    return "%s at %d of %d" % (what, at, info.st_size)


def check(farm, *more):
    done = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--check", "--store", farm.store, *more],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=300, universal_newlines=True)
    return done.returncode, done.stdout.splitlines()[:-1] if done.returncode in (0, 8) else [], done


def starts(farm):
    """Does it start without repair? If not, its one line names the remedy."""
    done = subprocess.Popen([os.path.join(BIN, "azulejo-coordinator"), "--listen", "127.0.0.1:0", "--no-web", "--key", farm.key,
                             "--store", farm.store], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    line = done.stdout.readline()
    done.terminate()
    _, words = done.communicate(timeout=60)
    expect(line or b"--repair" in words, words)


def round_of(farm, whole, newest, dice, template):
    shutil.rmtree(farm.store, ignore_errors=True)
    shutil.copytree(template, farm.store, copy_function=shutil.copy2)
    kinds = {}
    for path in files_of(farm.store):
        kinds.setdefault(kind_of(path), []).append(path)
    kind = dice.choice(sorted(kinds) + ["sqlite"] * 4)
    path = dice.choice(kinds[kind])
    what = "%s: %s" % (os.path.relpath(path, farm.store), harm(path, dice))
    code, lines, done = check(farm)
    expect(code in (0, 8), (what, done))
    for line in lines:
        expect(any(word in line for word in REMEDIES), (what, "no remedy", line))
    if code == 8:
        expect(lines, (what, done))
        starts(farm)  # what it parks has a new row, in which --repair finds nothing
        code, repaired, done = check(farm, "--repair")
        expect(code == 0, (what, done))
        lines += repaired
    farm.start_coordinator("--no-web")
    try:
        seen, marks = state_of(farm)
        for number, job in whole[0].items():
            now = seen.get(number)
            expect(now or any(word in line for line in lines for word in ("job %d" % number, "back-up")), (what, number, lines))
            if now and (now[:2], now[3]) != (job[:2], job[3]) and not any("row" in line for line in lines):
                back(farm, number, job, what)
            if now and not lines and now[2] != job[2]:
                expect(now[2][:len(job[2])] == job[2], (what, "its log", now[2], job[2]))  # more lines may have come
        expect(lines or marks == whole[1], (what, marks))
        expect(farm.submit(farm.scene(), *SMALL) > newest, (what, "a number was given again"))
    except Exception:
        print("# round: %s; %s" % (what, lines))
        raise
    finally:
        farm.coordinator.stop()
        farm.programs = [p for p in farm.programs if p is not farm.coordinator]
        farm.coordinator.close()
    return bool(lines)


def back(farm, number, job, what):
    """What is missing was refused with a remedy, and comes back with the same bits."""
    answer, found = pictures(farm, number, "back")
    if "azulejo retry" in answer.err:
        return
    if answer.code != 0:
        expect("again" in answer.err or "finished" in answer.err or "not rendered yet" in answer.err, (what, str(answer)))
    wait_for(lambda: farm.job(number)["state"] == "done" and pictures(farm, number, "back")[1] == job[3],
             "%s: job %d's pictures" % (what, number))


@tests.add
def flips_and_cuts():
    """after any flip, zeros or cut in any file the farm says so or nothing has changed; it starts, and pictures come back"""
    with Farm() as farm:
        whole, newest = make_store(farm)
        expect(check(farm)[0] == 0, check(farm))
        template = farm.path("template")
        shutil.move(farm.store, template)
        found = 0
        for at in range(ROUNDS):
            found += round_of(farm, whole, newest, random.Random(SEED * 1000003 + at), template)
        print("# %d rounds, %d found by --check, the others harmed nothing" % (ROUNDS, found))
        expect(found > ROUNDS / 2 or ROUNDS < 20, found)


if __name__ == "__main__":
    tests.run()
