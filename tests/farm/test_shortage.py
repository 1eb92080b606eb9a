"""A machine's own shortage (memory, disk, descriptors, threads) never fails a job: it waits, says why, and is tried
again until the machine has what it lacks, also where there is no other machine."""
import resource
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Skip, Tests, wait_for
from jobs import SLOW, expect
from odd import OddPeer

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]  # 16 units


def limit(worker, kind, value):
    """From now on; None: no limit."""
    soft = resource.RLIM_INFINITY if value is None else value
    resource.prlimit(worker.pid, kind, (soft, resource.prlimit(worker.pid, kind)[1]))


def address_space(worker):
    with open("/proc/%d/statm" % worker.pid) as statm:
        return int(statm.read().split()[0]) * resource.getpagesize()


def wait_for_reason(farm, number, *words):
    """Wait until the job waits, and says these words."""
    def look():
        job = farm.job(number)
        expect(job["state"] in ("queued", "running"), job)
        return job if all(w in job["state_text"] for w in words) else None
    return wait_for(look, "the reason %r" % (words, ))


@tests.add
def memory_of_the_only_machine():
    """a job whose only worker has no memory for it waits with the reason, and is rendered when there is some"""
    if SLOW:
        raise Skip("a sanitizer's shadow does not fit a limit of the address space")
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker(rests=False)
        undisturbed = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(undisturbed)
        limit(worker, resource.RLIMIT_AS, address_space(worker))
        number = farm.submit(farm.scene("other.gltf", light=2.5), *SMALL)
        wait_for_reason(farm, number, "annot", "memory", "tried again")
        for view in (farm.cli("list", expect=0).out, farm.cli("show", number, expect=0).out):
            expect("memory" in view, view)
        limit(worker, resource.RLIMIT_AS, None)
        expect(farm.wait_for_job(number)["state_text"] == "", "it still says why it waited")


@tests.add
def what_is_short():
    """no worker ends for lack of memory for its stack, or for the threads of its libraries: at its first scene or later"""
    if SLOW:
        raise Skip("a sanitizer's shadow does not fit a limit of the address space")
    with Farm() as farm:
        farm.start_coordinator()
        for scenes_before in range(3):
            worker = farm.start_worker(rests=False)
            farm.wait_for_workers(1)
            for i in range(scenes_before):
                scene = farm.scene("%d-%d.gltf" % (scenes_before, i), light=1.5 + scenes_before + i / 4)
                farm.wait_for_job(farm.submit(scene, *SMALL))
            for more in (0, 64 << 10, 1 << 20, 3 << 20, 6 << 20):  # a thread's stack: 4 MiB
                limit(worker, resource.RLIMIT_AS, address_space(worker) + more)
                number = farm.submit(farm.scene("%d-%d.gltf" % (scenes_before, more), light=2.5 + more), *SMALL)
                wait_for(lambda: not worker.alive() or farm.job(number)["state"] == "done" or farm.job(number)["state_text"],
                         "what comes of it")
                expect(worker.alive(), worker.log_text())
                limit(worker, resource.RLIMIT_AS, None)
                farm.wait_for_job(number)
            worker.stop()


@tests.add
def words_of_machines():
    """a shortage never fails a job, however many machines tell of one; a damaged scene does, by all machines' word"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        peers = [OddPeer(farm, hello="host=machine-%d" % i) for i in range(4)]
        for peer in peers:  # ERR_NO_MEMORY
            peer.say("request 1")
            expect(peer.grant()["job"] == number, "another job")
            peer.say("broken code=2")
        wait_for_reason(farm, number, "the odd peer cannot", "tried again")
        # Each is asked again, and none of them for ever in vain.
        for peer in peers[:2]:
            peer.say("request 1")
            expect(peer.grant()["job"] == number, "another job")
        for peer in peers[2:]:
            peer.end()
        peers[0].say("broken code=4")  # ERR_INPUT: damaged, says one
        wait_for(lambda: "cannot render it: the odd peer cannot" in farm.cli("log", number, expect=0).out, "its word")
        expect(farm.job(number)["state"] == "running", farm.job(number))
        peers[1].say("broken code=4")
        failed = farm.wait_for_job(number, "failed")
        expect("2 machines cannot render it" in failed["state_text"], failed)


@tests.add
def another_machine_has_more():
    """a machine without memory keeps no job from one that has it"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        short = OddPeer(farm, hello="host=small")
        short.say("request 1")
        expect(short.grant()["job"] == number, "another job")
        short.say("broken code=2")
        wait_for_reason(farm, number, "the odd peer cannot")
        farm.start_worker()
        farm.wait_for_job(number)


if __name__ == "__main__":
    tests.run()
