"""Workers that are stuck, cannot, or die, and jobs that kill them: neither may stop anything else."""
import os
import re
import signal
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Tests, wait_for
from jobs import Outcome, expect
from odd import OddPeer, die_of

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]  # 16 units


@tests.add
def claims_without_results():
    """three workers that claim 4,096 threads and deliver nothing do not keep a job from an honest one"""
    with Farm() as farm:
        farm.start_coordinator("--lease-seconds", "3600")  # no lease lapses in this test
        claimants = [OddPeer(farm, hello="threads=4096 host=claimant-%d" % i) for i in range(3)]
        large = farm.submit(farm.scene(), "--size", "512x512", "--spp", "4")  # 1,024 units
        for peer in claimants:
            peer.say("request 100000")
            expect([len(peer.grant()["units"]) for _ in range(2)] == [16, 16], "a claim was believed")
        farm.cli("cancel", large, expect=0)
        # What there is of this job fits into what they are trusted with.
        number = farm.submit(farm.scene(), *SMALL)
        peer = claimants[0]
        peer.say("request 100000")
        grant = peer.grant()
        expect(grant["job"] == number and len(grant["units"]) == 16, grant)
        for peer in claimants[1:]:
            peer.say("request 100000")
            peer.grant()  # copies, as soon as the units are overdue
        farm.start_worker()
        farm.wait_for_job(number)
        expect(all(p.alive() for p in claimants), "a claimant was dropped")


@tests.add
def one_machine_says_broken():
    """a machine that says again and again that it cannot render a job counts once; without a lease, never"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), "--size", "512x512", "--spp", "1000000")
        farm.wait_for_job(number, "running")
        peer = OddPeer(farm)
        peer.say("request 1")
        expect(peer.grant()["job"] == number, "another job")
        for restart in range(4):
            peer.say("broken code=4")  # ERR_INPUT
            peer.say("request 1")  # in vain
            wait_for(lambda: any("cannot render job %d" % number in w["note"]
                                 for w in farm.list_workers()), "the note")
            expect(farm.job(number)["state"] == "running", farm.job(number))
            peer.end()
            peer = OddPeer(farm)  # as if its supervisor had started it again
            peer.say("request 1")
        expect(farm.coordinator.log_text().count("cannot render job %d" % number) >= 4, "not heard")
        expect(farm.job(number)["state"] == "running", farm.job(number))


@tests.add
def a_poisonous_job():
    """a job that kills its workers is parked after a few, the next one runs, and resume takes it up again"""
    with Farm() as farm:
        farm.start_coordinator()
        poison = farm.submit(farm.scene(), *SMALL)
        after = farm.submit(farm.scene(), *SMALL)
        for death in range(4):
            expect(die_of(farm, "machine-%d" % (death % 2)) == poison, "parked too early")
        job = farm.wait_for_job(poison, "parked")
        expect("4 workers in a row died" in job["state_text"], job)
        expect("resume %d" % poison in job["state_text"], job)
        expect(re.search(r"\bparked\b", farm.cli("list", expect=0).out), "list")
        expect("several machines" in farm.cli("show", poison, expect=0).out, "show")
        expect("is parked" in farm.coordinator.log_text(), "log")
        farm.start_worker()
        farm.wait_for_job(after)
        expect(farm.job(poison)["samples_done"] == 0, farm.job(poison))
        farm.workers[0].signal(signal.SIGSTOP)  # it would have the job before the answer
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(farm.job(poison)["state"] == "parked", farm.job(poison))
        expect(farm.cli("resume", after).code == 5, "a job that is done was resumed")
        expect("queued" in farm.cli("resume", poison, expect=0).out, "resume")
        farm.workers[0].signal(signal.SIGCONT)
        farm.wait_for_job(poison)
        expect(Outcome(farm, poison, "poison").bits == Outcome(farm, after, "after").bits, "bits")
        # A parked job can be cancelled.
        farm.workers[0].stop()
        poison = farm.submit(farm.scene(), *SMALL)
        for death in range(4):
            die_of(farm, "machine-%d" % (death % 2))
        expect("cancelled" in farm.cli("cancel", poison, expect=0).out, "cancel")


@tests.add
def a_suspected_job_takes_one_worker():
    """after a death without a result a job is lent to one worker at a time; its first result frees it"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        other = farm.submit(farm.scene(), *SMALL)
        expect(die_of(farm, "first") == number, "another job")
        probe, second = [OddPeer(farm, hello="host=machine-%d" % i) for i in range(2)]
        probe.say("request 1")
        expect(probe.grant()["job"] == number, "not even one")
        second.say("request 1")
        expect(second.grant()["job"] == other, "both were put at risk")
        probe.say("result fill=0.25")
        probe.wait_line("ack ")
        second.say("request 1")
        expect(second.grant()["job"] == number, "it is still suspected")


if __name__ == "__main__":
    tests.run()
