"""A finished job goes on: some of its frames, an estimate, a submission that is sent again."""
import os
import sqlite3
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests, read_bytes, wait_for
from jobs import AREA, expect

tests = Tests()
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
MOTION = os.path.join(ROOT, "scenes", "features", "motion.gltf")
SIZE = ["--size", "49x33"]
OWN = {"azulejo:measured"}


def farm_of(farm, workers=1):
    farm.start_coordinator()
    for _ in range(workers):
        farm.start_worker()
    farm.wait_for_workers(workers)


def pictures(farm, number, name):
    """File name without the job's folder -> (bits, attributes) of every frame's EXR."""
    made = {}
    for path in farm.fetch(number, "%s-%s" % (name, number)):
        if path.endswith(".exr"):
            picture = read_exr(path)
            made[os.path.basename(path).split(".")[-2]] = (
                picture.bits(), {k: v for k, v in picture.attributes.items() if k not in OWN})
    return made


def edit_store(farm, statement):
    """Change a row of the stopped coordinator's database."""
    farm.coordinator.stop()
    farm.edit_store(lambda store: store.execute(statement))
    farm.restart_coordinator()


@tests.add
def an_extended_job_answers_to_its_token():
    """submit --token after extend: the same job, also after a restart; another job is still refused"""
    with Farm() as farm:
        farm_of(farm)
        options = [AREA, *SIZE, "--spp", "8", "--token", "mine"]
        number = farm.submit(*options)
        farm.wait_for_job(number)
        farm.cli("extend", number, "--spp", "16", expect=0)
        farm.wait_for_job(number)
        expect(farm.submit(*options) == number, "another job")
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(farm.submit(*options) == number, "another job after a restart")
        other = farm.cli("submit", AREA, *SIZE, "--spp", "9", "--token", "mine", expect=5)
        expect("was used for job %d" % number in other.err, other.err)


@tests.add
def only_the_same_release_extends():
    """extend: the release that the job recorded counts, not what the ray tracer is called"""
    with Farm() as farm:
        farm_of(farm)
        number = farm.submit(AREA, *SIZE, "--spp", "8")
        farm.wait_for_job(number)
        edit_store(farm, "UPDATE jobs SET kernel='embree 9'")
        farm.cli("extend", number, "--spp", "16", expect=0)
        farm.cli("cancel", number, expect=0)
        second = farm.submit(AREA, *SIZE, "--spp", "8")
        farm.wait_for_workers(1)
        farm.wait_for_job(second)
        edit_store(farm, "UPDATE jobs SET release='0.0.9'")
        refused = farm.cli("extend", second, "--spp", "16", expect=5)
        expect("azulejo 0.0.9" in refused.err and "do not mix" in refused.err, refused.err)


@tests.add
def some_frames_go_on():
    """extend --frames: only those get more samples, with the bits of --spp at once; the counts stay right"""
    with Farm() as farm:
        farm_of(farm)
        options = [MOTION, "--name", "walk", "--size", "33x20", "--frames", "2-5"]
        few = farm.submit(*options, "--spp", "8")
        many = farm.submit(*options, "--spp", "24")
        for number in (few, many):
            farm.wait_for_job(number)
        before, at_once = pictures(farm, few, "few"), pictures(farm, many, "many")
        farm.cli("extend", few, "--spp", "24", "--frames", "3,5", expect=0)
        farm.wait_for_job(few)
        after = pictures(farm, few, "after")
        expect(len(after) == 4, after.keys())
        for frame in after:
            wanted = at_once if frame[-1] in "35" else before
            expect(after[frame] == wanted[frame], "frame %s: other bits or attributes" % frame)

        def counts():
            job = farm.job(few)
            expect(job["samples_done"] == 33 * 20 * 2 * (8 + 24), job["samples_done"])
            expect(job["work"]["samples"] == job["samples_done"], job["work"])
            expect([c["frame"] for c in job["cut_frames"]] == [2, 4], job["cut_frames"])
            expect(job["frames_done"] == 4, job)
        counts()
        farm.coordinator.kill()
        farm.restart_coordinator()
        counts()
        # Then the rest, and all of them. The film of another frame may be gone.
        os.unlink(os.path.join(farm.store, "films", str(few), "frame-0005.kept"))
        farm.cli("extend", few, "--spp", "24", "--frames", "2-4", expect=0)
        farm.wait_for_job(few)
        expect(pictures(farm, few, "rest") == at_once, "the rest")
        for frames, words in (("1", "has frames 2 to 5"), ("3-x", "--frames"), ("5-3", "--frames")):
            wrong = farm.cli("extend", few, "--spp", "32", "--frames", frames)
            expect(wrong.code and words in wrong.err, wrong)
        expect("larger --spp" in farm.cli("extend", few, "--spp", "24", "--frames", "3", expect=5).err, "no more")
        for frames in (["--frames", "4-5"], []):
            gone = farm.cli("extend", few, "--spp", "32", *frames, expect=5).err
            expect("frame 5: its film was not kept" in gone, gone)


@tests.add
def averaged_statistics_follow():
    """extend of a job with --temporal: its pictures are those of one with all samples at once"""
    with Farm() as farm:
        farm_of(farm)
        look = ["--frames", "1-3", "--temporal", "2", "--auto-exposure", "key", "--format", "png", "--png-bits", "16"]
        whole, few = (farm.submit(AREA, *SIZE, "--spp", str(spp), *look) for spp in (32, 4))
        for number in (whole, few):
            farm.wait_for_job(number)
        farm.cli("extend", few, "--spp", "32", expect=0)
        farm.wait_for_job(few)
        made, right = ([read_bytes(f) for f in sorted(farm.fetch(n, "averaged-%d" % n))] for n in (few, whole))
        expect(len(made) == 3 and made == right, "averaged with what the frames were before")


@tests.add
def an_estimate_is_gone_on_from():
    """estimate on a farm, then submit: bits and attributes of a job that was never estimated, for uniform and
    adaptive jobs, for one that needs fewer samples than the estimate took, and over a restart"""
    with Farm() as farm:
        farm_of(farm)
        # Options of both commands, those of submit alone, the frames that are estimated.
        cases = [([AREA, *SIZE, "--spp", "40"], [], "1", 1), ([AREA, *SIZE, "--target-error", "16/255"], [], "1", 1),
                 ([AREA, *SIZE, "--target-error", "120/255"], ["--min-spp", "4"], "1", 1),
                 ([AREA, *SIZE, "--spp", "16"], [], "1", 1),
                 ([MOTION, "--size", "33x20", "--frames", "2-6", "--spp", "24", "--temporal", "2"], [], "2, 4 and 6", 3)]
        for options, own, frames, rendered in cases:
            fresh = farm.submit(*options, *own)
            farm.wait_for_job(fresh)
            told = farm.cli("estimate", *options, "-q", expect=0)
            line = told.out.strip().splitlines()[-1]
            expect("azulejo submit " in line and "--quiet" not in line and " -q" not in line, told.out)
            number = max(j["job"] for j in farm.cli("list", "--json", expect=0).json()["jobs"])
            expect(number != fresh, "no job")
            job = farm.job(number)
            expect(job["state"] == "done" and job["estimate"] and job["frames_done"] == rendered, job)
            expect(rendered == 1 or "frames " + frames in told.out, told.out)
            spent = job["work"]["samples"]
            if rendered == 3:
                farm.coordinator.kill()
                farm.restart_coordinator()
                farm.wait_for_workers(1)
            sent = farm.cli("submit", *options, *own, "--json", expect=0)
            expect(sent.json()["job"] == number and sent.json()["estimate_spp"] == 16, sent)
            done = farm.wait_for_job(number)
            expect(not done["estimate"] and done["work"]["samples"] != spent or "16" in options, done)
            a, b = pictures(farm, fresh, "fresh"), pictures(farm, number, "went-on")
            expect(a == b, "%s: not as if it were never estimated: %s" % (
                options, [(n, k) for n in a for k in a[n][1] if a[n][1][k] != b[n][1].get(k)]))
            again = farm.cli("submit", *options, *own, "--json", expect=0).json()
            expect(again["job"] != number and again["estimate_spp"] == 0, "an estimate serves once")
            farm.cli("cancel", "--discard", again["job"], expect=0)


@tests.add
def another_job_does_not_go_on_from_an_estimate():
    """submit with another seed, size, range, --token or fewer samples than an estimate has: a new job"""
    with Farm() as farm:
        farm_of(farm)
        options = [AREA, *SIZE, "--spp", "64"]
        made = farm.cli("estimate", *options, "--json", "-q", expect=0).json()
        number = made["job"]
        expect(made["cores"] == sum(w["threads"] for w in farm.list_workers()), made["cores"])
        expect(farm.job(number)["name"] == "cornell-area", "name")
        for other in (["--seed", "2"], ["--size", "49x34"], ["--spp", "8"], ["--frames", "1-2"], ["--max-depth", "3"],
                      ["--aov", "depth"]):
            expect(farm.submit(*options, *other) != number, other)
        edit_store(farm, "UPDATE jobs SET release='0.0.9' WHERE id=%d" % number)
        expect(farm.submit(*options) != number, "another release")
        edit_store(farm, "UPDATE jobs SET release=(SELECT release FROM jobs WHERE id>%d AND release<>'' LIMIT 1) "
                   "WHERE id=%d" % (number, number))
        kept = os.path.join(farm.store, "films", str(number), "frame-0001.kept")
        os.rename(kept, kept + ".away")
        expect(farm.submit(*options) != number, "without its film")
        os.rename(kept + ".away", kept)
        first = farm.submit(*options, "--token", "mine", "--priority", "3", "--name", "mine")
        expect(first == number and farm.submit(*options, "--token", "mine", "--name", "mine") == first, "token")
        job = farm.job(number)
        expect((job["name"], job["priority"]) == ("mine", 3), job)


@tests.add
def limits_and_history_count_by_one_clock():
    """extend --core-limit counts again, and what is left says so; the history goes on; both over a restart"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=1)
        farm.wait_for_workers(1)
        number = farm.submit(AREA, "--size", "160x120", "--core-limit", "3s")
        farm.wait_for_job(number)
        first = farm.job(number)["now"]["core_seconds"]
        expect(3 <= first < 5, first)
        farm.cli("extend", number, "--core-limit", "3s", expect=0)

        def going():
            job = farm.job(number)
            expect(job["state"] != "done", "it ended at once")
            known = job["state"] == "running" and job.get("now") and job["seconds_left"] >= 0
            return job if known and job["now"]["core_seconds"] > first else None
        job = wait_for(going, "figures of the extension")
        expect(job["seconds_left"] > 0.3, (job["seconds_left"], job["now"]["core_seconds"]))
        spent = job["now"]["core_seconds"]
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_job(number)
        after = farm.cli("show", number, "--json", expect=0).json()
        expect(first + 3 - 2.5 <= after["now"]["core_seconds"] < first + 3 + 2, after["now"])
        history = farm.cli("show", number, "--history", "--json", expect=0).json()
        points = [p["core_seconds"] for p in history["points"]]
        expect(points == sorted(points) and any(spent <= p for p in points), points)
        # The clock that limits count by is the history's.
        farm.coordinator.stop()
        store = sqlite3.connect(os.path.join(farm.store, "queue.sqlite"))
        clock = store.execute("SELECT cpu_ns FROM clocks WHERE job=%d" % number).fetchone()[0]
        store.close()
        expect(abs(clock / 1e9 - points[-1]) < 1e-6, (clock, points[-1]))


tests.run()
