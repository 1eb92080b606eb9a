"""Removing films and pictures never holds the coordinator up, however long the disk takes to free their room."""
import os
import threading
import time

from disk import OddDisk, SmallDisk
from farm import PATIENCE, Farm, Skip, Tests, wait_for
from jobs import Outcome, expect, expect_same
from keeping import begun, exists, films, gc, total, trash

tests = Tests()

# A film of more than 2 MiB a frame, soon rendered; and one for a small disk.
LARGE = ("--size", "640x400", "--spp", "4")
MIDDLE = ("--size", "320x200", "--spp", "4")
ENDLESS = ("--size", "320x200", "--spp", "1000000")
SLOW_S = 6 * PATIENCE
ANSWER_S = SLOW_S / 2  # far more than an answer takes, far less than one removal


class Watch:
    """Asks the coordinator for its jobs all the time, and notes the longest wait."""

    def __init__(self, farm):
        self.farm, self.worst, self.asked, self.failed, self.ended = farm, 0.0, 0, None, False
        self.thread = threading.Thread(target=self.ask)

    def __enter__(self):
        self.thread.start()
        wait_for(lambda: self.asked > 0, "a first answer")
        return self

    def ask(self):
        while not self.ended and not self.failed:
            begin = time.monotonic()
            result = self.farm.cli("list")
            self.worst = max(self.worst, time.monotonic() - begin)
            self.failed = None if result.code == 0 else result
            self.asked += 1
            time.sleep(0.05)  # a removal takes a hundred times as long

    def __exit__(self, kind, *_):
        asked = self.asked
        if not kind:
            wait_for(lambda: self.asked > asked + 1 or self.failed, "another answer")
        self.ended = True
        self.thread.join()
        if not kind:
            expect(not self.failed, str(self.failed))
            expect(self.worst < ANSWER_S, "an answer took %.1f s" % self.worst)


def large_film(farm, number):
    folder = os.path.join(farm.store, "films", str(number))
    wait_for(lambda: any(os.path.getsize(os.path.join(folder, name)) > 1 << 20 for name in films(farm, number)),
             "job %d to have a large film" % number)


@tests.add
def every_way_to_remove():
    """cancel --discard, the end of a frame, prune --films, remove and a limit: the coordinator answers meanwhile"""
    with Farm() as farm:
        disk = OddDisk(farm, SLOW_S)
        farm.start_coordinator(env=disk.env)
        scene = farm.scene()
        farm.start_worker()
        number = farm.submit(scene, *ENDLESS)
        begun(farm, number)
        large_film(farm, number)
        with Watch(farm):
            farm.cli("cancel", number, "--discard", expect=0)
            wait_for(lambda: not films(farm, number), "the films to go")
        with Watch(farm):  # each frame's film in work is replaced by a kept one
            kept = [farm.submit(scene, *LARGE) for _ in range(2)]
            for job in kept:
                farm.wait_for_job(job)
        for job in kept:
            large_film(farm, job)
        with Watch(farm):
            farm.cli("prune", kept[0], "--films", "--yes", expect=0)
            wait_for(lambda: not films(farm, kept[0]), "pruned films to go")
        with Watch(farm):
            farm.cli("remove", kept[1], expect=0)
            expect(not exists(farm, kept[1]) and not films(farm, kept[1]), "removed")
        with disk.fast():
            farm.coordinator.stop()
        farm.restart_coordinator("--store-limit", "1M", env=disk.env)
        wait_for(lambda: farm.list_workers(), "the worker to be back")
        with Watch(farm):
            limited = farm.submit(scene, *LARGE, "--force")
            # The limit may take it before anybody sees that it is done.
            wait_for(lambda: {job["job"]: job["state"] for job in farm.cli("list", "--json", expect=0).json()["jobs"]}.get(
                limited, "done") == "done", "job %d to be done" % limited)
            gc(farm)
            wait_for(lambda: not films(farm, limited), "the limit to be kept")
        farm.coordinator.kill()  # an orderly end waits for the file that is being removed


@tests.add
def again_at_once():
    """A job whose films are just being removed is tried again: the same bits"""
    with Farm() as farm:
        farm.start_coordinator(env=OddDisk(farm, SLOW_S).env)
        scene = farm.scene()
        farm.start_worker()
        some = ("--size", "320x200", "--spp", "32")
        reference = farm.submit(scene, *some)
        farm.wait_for_job(reference)
        outcome = Outcome(farm, reference, "reference")
        number = farm.submit(scene, *some)
        begun(farm, number)
        with Watch(farm):
            farm.cli("cancel", number, "--discard", expect=0)
            farm.cli("retry", number, "--frames", "1", expect=0)
            expect(trash(farm), "its film is still being removed")
            farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "again"), outcome, "tried again", counts=False)
        farm.coordinator.kill()


@tests.add
def killed_while_emptying():
    """What a kill left in the trash goes after the next start, and the removed job stays removed"""
    with Farm() as farm:
        disk = OddDisk(farm, SLOW_S)
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        number = farm.submit(farm.scene(), *LARGE)
        farm.wait_for_job(number)
        with disk.fast():
            wait_for(lambda: not trash(farm), "the film in work to go", 300.0)
        farm.cli("remove", number, expect=0)
        farm.coordinator.kill()
        expect(trash(farm), "something is left")
        begin = time.monotonic()
        farm.restart_coordinator(env=disk.env)
        expect(time.monotonic() - begin < ANSWER_S, "the start does not wait for it")
        expect(not exists(farm, number), "removed")
        with Watch(farm) as watch:
            wait_for(lambda: watch.asked > 10, "answers while it is emptied")
            expect(trash(farm), "it is emptied at once")
            with disk.fast():
                wait_for(lambda: not trash(farm), "the trash to be emptied", 300.0)


@tests.add
def ends_at_once():
    """neither a coordinator nor a local render waits at its end until the room of its films is free"""
    with Farm() as farm:
        disk = OddDisk(farm, SLOW_S)
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        number = farm.submit(farm.scene(), *LARGE)
        farm.wait_for_job(number)
        farm.cli("remove", number, expect=0)
        expect(trash(farm), "its films are being removed")
        begin = time.monotonic()
        farm.coordinator.stop()
        expect(time.monotonic() - begin < ANSWER_S, "the end took %.1f s" % (time.monotonic() - begin))
        farm.restart_coordinator(env=disk.env)
        with disk.fast():
            wait_for(lambda: not trash(farm), "the next start to go on", 300.0)
    with Farm() as farm:
        scratch = farm.path("scratch")
        os.mkdir(scratch)
        disk = OddDisk(farm, SLOW_S)
        env = dict(os.environ, TMPDIR=scratch, **disk.env)
        begin = time.monotonic()
        farm.cli("render", farm.scene(), *LARGE, "-o", "picture", expect=0, env=env)
        took = time.monotonic() - begin
        expect(took < ANSWER_S, "a render took %.1f s" % took)
        expect(os.listdir(scratch), "its store went at once")
        with disk.fast():
            wait_for(lambda: not os.listdir(scratch), "its store to go", 300.0)


@tests.add
def without_syncs():
    """a local render asks its disk for nothing but room: its folder is removed when it ends, whatever happens"""
    with Farm() as farm:
        disk, where = OddDisk(farm), farm.path("tmp")
        os.makedirs(where)
        disk.fail(5, "/azulejo-render-", "sync")
        farm.cli("render", farm.scene(), *MIDDLE, "-o", "out.exr", env=dict(disk.env, TMPDIR=where), expect=0)
        expect(os.listdir(where) == [], os.listdir(where))
        disk.work()
        # A farm's coordinator does sync.
        farm.start_coordinator(env=disk.env)
        farm.start_worker()
        disk.fail(5, "/store/films/", "sync")
        number = farm.submit(farm.scene(), *MIDDLE)
        wait_for(lambda: "cannot be written" in farm.job(number)["state_text"], "trouble")
        disk.work()
        farm.wait_for_job(number)
        expect_same(farm, Outcome(farm, number, "farm"), Outcome(farm, number, "again"), "farm")
        expect(farm.cli("compare", "out.exr", farm.fetch(number, "third")[0]).code == 0, "the pictures differ")


@tests.add
def room_being_freed():
    """show --farm names what is being freed, which no limit counts"""
    with Farm() as farm:
        farm.start_coordinator(env=OddDisk(farm, 5 * SLOW_S).env)
        farm.start_worker()
        number = farm.submit(farm.scene(), *LARGE)
        farm.wait_for_job(number)
        farm.cli("remove", number, expect=0)
        store = farm.cli("show", "--farm", "--json", expect=0).json()
        expect(store["trash"] > 1 << 20, store)
        expect(store["films"] == 0 and total(store) < store["trash"], store)
        expect("being freed" in farm.cli("show", "--farm", expect=0).out, "in words")
        farm.coordinator.kill()  # an orderly end waits for the file that is being removed


def free_bytes(folder):
    free = os.statvfs(folder)
    return free.f_bavail * free.f_frsize


@tests.add
def room_for_the_next():
    """A job that fits once the trash is empty is taken, and rendered when it is"""
    with Farm() as farm, SmallDisk(farm, 96 << 20) as disk:
        if disk is None:
            raise Skip("mounting is not permitted: no full disk here")
        farm.store = os.path.join(disk, "store")
        odd = OddDisk(farm, SLOW_S)
        farm.start_coordinator(env=odd.env)
        farm.start_worker()
        scene = farm.scene()
        large = farm.submit(scene, "--size", "640x360", "--spp", "8")
        farm.wait_for_job(large)
        with odd.fast():
            wait_for(lambda: not trash(farm), "the film in work to go", 300.0)
        wait_for(lambda: free_bytes(disk) == (time.sleep(0.3), free_bytes(disk))[1], "its room")
        with open(os.path.join(disk, "filler"), "wb") as filler:
            filler.write(bytes(free_bytes(disk) - (8 << 20)))
        refused = farm.cli("submit", scene, *MIDDLE)
        expect(refused.code == 3 and "on the coordinator's disk" in refused.err, refused)
        farm.cli("remove", large, expect=0)
        number = farm.submit(scene, *MIDDLE)
        expect(trash(farm), "what was removed is still being freed")
        farm.wait_for_job(number)
        farm.coordinator.kill()


tests.run()
