#!/usr/bin/env python3
"""What people combine: names and reasons that one part knows must be what another part shows."""
import json
import re

from farm import Farm, Tests, wait_for
from jobs import expect
from test_seeing import Screen

tests = Tests()
SMALL = ("--size", "48x32", "--spp", "16")
ENDLESS = ("--size", "160x96", "--spp", "1000000")


def begun(farm, number):
    wait_for(lambda: farm.job(number)["samples_done"] > 0, "job %d to begin" % number)


@tests.add
def names():
    """A worker has one name everywhere: top, watch --workers and trace show it, also of one that left"""
    with Farm() as farm:
        farm.start_coordinator()
        left = farm.start_worker("--name", "left-7")
        farm.start_worker("--name", "right-7")
        farm.wait_for_workers(2)
        number = farm.submit(farm.scene(), *ENDLESS)
        wait_for(lambda: farm.job(number)["workers"] == 2, "both to work")
        wait_for(lambda: all(w["units_done"] for w in farm.list_workers()), "results of both")
        farm.cli("workers", "drain", "right-7", expect=0)
        wait_for(lambda: "drained" in [w["state"] for w in farm.list_workers()], "it to be drained")
        rows = dict(re.findall(r"^(\S+) +(\S+) .*", farm.cli("top", "--once", expect=0).out, re.M))
        expect(rows.get("left-7") == "working" and rows.get("right-7") == "drained", rows)
        with Screen(farm.cli_argv("watch", number, "--workers")) as screen:
            screen.wait_text(rb"\n\r\x1b\[K  left-7 \([^\n]*, process %d\)   1 thread   " % left.pid)
        left.stop()
        wait_for(lambda: farm.cli("workers", "--gone", "--json", expect=0).json()["gone"], "it to leave")
        events = json.loads(farm.cli("trace", number, expect=0).out)["traceEvents"]
        shown = {e["args"]["name"].split(" (")[0] for e in events if e["name"] == "process_name"}
        expect(shown == {"coordinator", "worker left-7", "worker right-7"}, shown)


@tests.add
def audit_names_the_verb():
    """The audit log calls each verb what people typed; questions about the store are not in it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "node")
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), *SMALL)
        waiting = farm.submit(farm.scene(), *SMALL, "--not-before", "2h")
        farm.wait_for_job(number)
        for verb in ("drain", "resume", "block", "unblock"):
            farm.cli("workers", verb, "node", expect=0)
        farm.cli("show", "--farm", expect=0)
        farm.cli("gc", expect=0)
        farm.cli("start", waiting, expect=0)
        farm.wait_for_job(waiting)
        farm.cli("prune", number, "--films", "--yes", expect=0)
        farm.cli("prune", number, "--yes", expect=0)
        farm.cli("remove", waiting, expect=0)
        with open(farm.path("store", "audit.log")) as log:
            lines = [json.loads(line) for line in log]
        expect([line["verb"] for line in lines] ==
               ["start", "submit", "submit", "workers drain", "workers resume", "workers block", "workers unblock",
                "gc", "start", "cancel", "prune", "remove"], [line["verb"] for line in lines])
        expect(all(line["details"] == {"name": "node"} for line in lines[3:7]), lines[3:7])
        expect([line.get("job") for line in lines[7:]] == [None, waiting, number, number, waiting], lines[7:])


@tests.add
def held_back_and_unable():
    """Of two workers one cannot render the job and the other is drained: the reason says so, and what ends it"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "gpu-node", "--tag", "gpu")
        farm.start_worker("--name", "plain")
        farm.wait_for_workers(2)
        farm.cli("workers", "drain", "gpu-node", expect=0)
        number = farm.submit(farm.scene(), *SMALL, "--require", "gpu")
        note = farm.job(number)["state_text"]
        expect(note == "waits: the 1 worker that could render it takes no work at present; gpu-node: drained by %s"
               % farm.job(number)["owner"], note)
        farm.cli("workers", "resume", "gpu-node", expect=0)
        farm.wait_for_job(number)


@tests.add
def finishing_waits():
    """A job that finishes while no worker takes work says what it waits for"""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker("--name", "node")
        farm.wait_for_workers(1)
        number = farm.submit(farm.scene(), "--size", "2048x2048", "--spp", "64")
        begun(farm, number)
        farm.cli("workers", "block", "node", expect=0)
        farm.cli("finish", number, expect=0)
        note = farm.job(number)["state_text"]
        expect(note == "waits: no worker takes work at present ('azulejo workers' says why)", note)
        extend = farm.cli("extend", number, "--spp", "128", expect=5)
        expect("'finish'" not in extend.err and "it ends with" in extend.err, extend)
        worker.kill()
        wait_for(lambda: farm.job(number)["state_text"] == "waits: no worker is connected", "the reason")
        fetch = farm.cli("fetch", number, expect=5)
        expect("--preview" in fetch.err, fetch)
        farm.cli("cancel", number, "--discard", expect=0)


@tests.add
def paused_has_no_preview():
    """fetch of a paused job without a finished frame does not recommend a preview that it refuses"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *ENDLESS)
        begun(farm, number)
        fetch = farm.cli("fetch", number, expect=5)
        expect("--preview" in fetch.err, fetch)
        farm.cli("pause", number, expect=0)
        fetch = farm.cli("fetch", number, expect=5)
        expect("--preview" not in fetch.err and "'azulejo resume %d'" % number in fetch.err, fetch)


if __name__ == "__main__":
    tests.run()
