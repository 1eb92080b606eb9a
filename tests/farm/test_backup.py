"""A store that is backed up while it runs, and restored."""
import fcntl
import os
import signal
import sqlite3
import subprocess
import time

from farm import BIN, PATIENCE, Failure, Farm, Tests, wait_for
from jobs import Outcome, expect, expect_same
from keeping import COLLECT_ALL, LONG, SMALL, blobs, exists, films, gc, pictures, scene_with_textures

tests = Tests()


def copy_store(command, folder, store):
    return subprocess.run([os.path.join(BIN, "azulejo-coordinator"), command, folder, "--store", store],
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          timeout=120 * PATIENCE)


def start_copy(command, folder, store):
    return subprocess.Popen([os.path.join(BIN, "azulejo-coordinator"), command, folder, "--store", store],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def epoch_limit(store):
    with sqlite3.connect(os.path.join(store, "queue.sqlite")) as database:
        return database.execute("SELECT value FROM meta WHERE name='epoch_limit'").fetchone()[0]


@tests.add
def backup():
    """A store is backed up while it runs, restored into a fresh one, and renders on to the same bits"""
    with Farm() as farm:
        farm.start_coordinator(*COLLECT_ALL)
        farm.start_worker()
        scene = scene_with_textures(farm, 4)
        done = farm.submit(scene, *LONG)
        farm.wait_for_job(done)
        reference = Outcome(farm, done, "reference")
        running = farm.submit(scene, *LONG)
        wait_for(lambda: farm.job(running)["samples_done"] > 0.1 * farm.job(running)["samples_total"], "mid-frame")
        waiting = farm.submit(scene, *SMALL, "--name", "waiting", "--priority", "-1")
        first = farm.path("backup-1")
        result = copy_store("backup", first, farm.store)
        expect(result.returncode == 0, result)
        result = copy_store("backup", first, farm.store)
        expect(result.returncode == 5 and b"not empty" in result.stderr, result)
        result = copy_store("backup", farm.path("store", "inside"), farm.store)
        expect(result.returncode == 5, result)
        farm.wait_for_job(running)
        farm.cli("remove", done, expect=0)
        gc(farm)
        late = farm.submit(scene, *SMALL, "--name", "late")
        farm.wait_for_job(late)
        result = copy_store("restore", first, farm.store)
        expect(result.returncode == 5 and b"has jobs already" in result.stderr, result)

        for _ in range(2):  # each start of the old coordinator takes epochs
            farm.coordinator.kill()
            farm.restart_coordinator(*COLLECT_ALL)
        farm.coordinator.stop()
        granted = epoch_limit(farm.store)
        farm.store = farm.path("fresh")
        result = copy_store("restore", farm.path("nothing"), farm.store)
        expect(result.returncode == 8 and not os.path.exists(farm.store), result)
        result = copy_store("restore", first, farm.store)
        expect(result.returncode == 0, result)
        expect(epoch_limit(farm.store) > granted, "leases of the old store are older than all of the new one")
        for folder, folders, names in os.walk(farm.store):
            for name in folders + names:
                expect(os.stat(os.path.join(folder, name)).st_mode & 0o77 == 0, os.path.join(folder, name))
        farm.restart_coordinator(*COLLECT_ALL)
        expect(farm.job(done)["state"] == "done" and not exists(farm, late), "as it was")
        expect_same(farm, Outcome(farm, done, "restored"), reference, "restored", counts=False)
        expect(farm.job(running)["samples_done"] > 0, "films of frames in work are there")
        gc(farm)
        farm.wait_for_job(running)
        expect_same(farm, Outcome(farm, running, "rendered-on"), reference, "rendered on", counts=False)
        farm.wait_for_job(waiting)
        farm.cli("extend", done, "--spp", "160", expect=0)
        farm.wait_for_job(done)


def developed(farm, number):
    """The job, when its pictures follow its settings."""
    job = farm.job(number)
    return job if job["frames_developed"] == job["frames_done"] else None


@tests.add
def backup_while_developing():
    """Pictures that are developed again while they are backed up belong to the settings in the backup"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "200x150", "--frames", "1-6", "--spp", "2")
        farm.wait_for_job(number)
        reference = {}
        for operator in ("aces", "agx"):
            farm.cli("develop", number, "--tonemap", operator, expect=0)
            wait_for(lambda: developed(farm, number), "the pictures")
            reference[operator] = Outcome(farm, number, operator).pngs
        expect(reference["aces"] != reference["agx"], "two operators")
        for i, operator in enumerate(("aces", "agx")):
            folder = farm.path("backup-%d" % i)
            program = start_copy("backup", folder, farm.store)
            while not os.path.exists(os.path.join(folder, "queue.sqlite")) and program.poll() is None:
                pass
            program.send_signal(signal.SIGSTOP)  # it has begun with the database
            asked = farm.start_cli("develop", number, "--tonemap", operator)
            try:
                asked.wait(5 * PATIENCE)
                wait_for(lambda: developed(farm, number), "the pictures")
            except subprocess.TimeoutExpired:
                print("# it stood still with a lock of SQLite's, for which the coordinator waits")
            program.send_signal(signal.SIGCONT)
            expect(asked.wait(60 * PATIENCE) == 0, asked.communicate())
            expect(program.wait(60 * PATIENCE) == 0, "the backup")
        farm.coordinator.stop()
        for i in range(2):
            farm.store = farm.path("restored-%d" % i)
            expect(copy_store("restore", farm.path("backup-%d" % i), farm.store).returncode == 0, "restore")
            farm.restart_coordinator()
            job = wait_for(lambda: developed(farm, number), "the pictures")
            expect(Outcome(farm, number, "out-%d" % i).pngs == reference[job["output"]["tonemap"]], job)
            farm.coordinator.stop()


@tests.add
def backup_disturbed():
    """Killed at any moment, a backup or a restore is no half one; what is removed meanwhile is in the backup"""
    with Farm() as farm:
        farm.start_coordinator(*COLLECT_ALL)
        farm.start_worker()
        scene = scene_with_textures(farm, 24)
        number = farm.submit(scene, *LONG)
        farm.wait_for_job(number)
        reference = Outcome(farm, number, "reference")

        for turn, delay_s in enumerate((0.0, 0.002, 0.005, 0.01, 0.03)):
            folder, fresh = farm.path("killed-%d" % turn), farm.path("fresh-%d" % turn)
            program = start_copy("backup", folder, farm.store)
            time.sleep(delay_s)  # a sweep over moments, not a wait
            program.kill()
            program.wait()
            if not os.path.exists(os.path.join(folder, "backup")):
                expect(copy_store("restore", folder, fresh).returncode == 8, "half a backup")
        whole = farm.path("whole")
        # A reader that holds the store as a backup does.
        holder = open(os.path.join(farm.store, "hold"), "w")
        fcntl.flock(holder, fcntl.LOCK_SH)
        before = blobs(farm)
        farm.cli("remove", number, expect=0)
        told = gc(farm)
        expect("backup" in told["held"] and blobs(farm) == before, told)
        expect(pictures(farm, number) and films(farm, number), "its files stay for the backup")
        holder.close()
        gc(farm)
        wait_for(lambda: not pictures(farm, number) and not films(farm, number) and not blobs(farm), "them to go after it")
        number = farm.submit(scene, *LONG)
        farm.wait_for_job(number)
        expect(copy_store("backup", whole, farm.store).returncode == 0, "a whole one")
        farm.coordinator.kill()
        for turn, delay_s in enumerate((0.0, 0.003, 0.005, 0.007, 0.01)):
            farm.store = farm.path("again-%d" % turn)
            program = start_copy("restore", whole, farm.store)
            time.sleep(delay_s)  # a sweep over moments, not a wait
            program.kill()
            program.wait()
            if os.path.exists(os.path.join(farm.store, "restoring")):
                try:
                    farm.restart_coordinator()
                    raise AssertionError("a coordinator started on half a store")
                except Failure as failure:
                    expect("not finished" in str(failure), failure)
            if not os.path.exists(os.path.join(farm.store, "queue.sqlite")):
                again = copy_store("restore", whole, farm.store)
                expect(again.returncode == 0, again)
            farm.restart_coordinator()
            expect_same(farm, Outcome(farm, number, "again-%d" % turn), reference, "restored", counts=False)
            farm.coordinator.kill()


tests.run()
