"""A finished job goes on: some of its frames, an estimate, a submission that is sent again."""
import os
import sqlite3
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests
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
    store = sqlite3.connect(os.path.join(farm.store, "queue.sqlite"))
    store.execute(statement)
    store.commit()
    store.close()
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


tests.run()
