#!/usr/bin/env python3
"""azulejo trace: a file in Chrome's trace format that says when each thread did what for a job."""
import json
import os
import signal

from farm import BIN, Farm, Tests, wait_for
from jobs import expect

tests = Tests()
JOB = ("--size", "48x32", "--spp", "32", "--frames", "1-2")
ENDLESS = ("--size", "64x64", "--spp", "1000000")
# Chrome's trace format: the fields that each phase must have, and their types.
NUMBER = (int, float)
FIELDS = {
    "X": {"name": str, "cat": str, "pid": int, "tid": int, "ts": NUMBER, "dur": NUMBER, "args": dict},
    "i": {"name": str, "cat": str, "pid": int, "tid": int, "ts": NUMBER, "s": str, "args": dict},
    "M": {"name": str, "pid": int, "tid": int, "args": dict},
}
METADATA = {"process_name": {"name": str}, "thread_name": {"name": str},
            "process_sort_index": {"sort_index": int}, "thread_sort_index": {"sort_index": int}}


class Trace:
    """A trace file that was checked against the format; its slices by category."""

    def __init__(self, text):
        self.all = json.loads(text)
        expect(set(self.all) == {"traceEvents", "displayTimeUnit", "otherData"}, list(self.all))
        expect(self.all["displayTimeUnit"] in ("ms", "ns"), self.all["displayTimeUnit"])
        self.processes, self.threads, self.slices, lanes = {}, {}, {}, {}
        self.instants = []
        for event in self.all["traceEvents"]:
            fields = FIELDS[event["ph"]]
            expect(set(event) == set(fields) | {"ph"}, event)
            expect(all(isinstance(event[name], kind) for name, kind in fields.items()), event)
            if event["ph"] == "M":
                expect({k: type(v) for k, v in event["args"].items()} == METADATA[event["name"]], event)
                if event["name"] == "process_name":
                    expect(event["pid"] not in self.processes, event)
                    self.processes[event["pid"]] = event["args"]["name"]
                if event["name"] == "thread_name":
                    expect((event["pid"], event["tid"]) not in self.threads, event)
                    self.threads[event["pid"], event["tid"]] = event["args"]["name"]
            elif event["ph"] == "i":
                expect(event["s"] in "gpt" and event["ts"] >= 0, event)
                self.instants.append(event)
            else:
                expect(event["ts"] >= 0 and event["dur"] >= 0, event)
                lanes.setdefault((event["pid"], event["tid"]), []).append(event)
                self.slices.setdefault(event["cat"], []).append(event)
        for lane, events in lanes.items():
            expect(lane in self.threads and lane[0] in self.processes, lane)
            events.sort(key=lambda e: (e["ts"], e["dur"]))
            for one, other in zip(events, events[1:]):
                expect(one["ts"] + one["dur"] <= other["ts"] + 0.0015, (one, other))  # no overlap
        self.workers = {pid for pid, name in self.processes.items() if name.startswith("worker ")}

    def units(self, category="render"):
        return sorted(tuple(e["args"][k] for k in ("frame", "tile", "group", "pass"))
                      for e in self.slices.get(category, []))


def trace_of(farm, number):
    path = farm.path("trace-%d.json" % number)
    result = farm.cli("trace", number, "-o", path, expect=0)
    expect(path in result.out, result)
    with open(path) as text:
        return Trace(text.read()), result


@tests.add
def whole():
    """Two workers of two threads: each unit once, on its worker and thread; merges, disk, pictures, log"""
    with Farm() as farm:
        farm.start_coordinator()
        for _ in range(2):
            farm.start_worker(threads=2)
        farm.wait_for_workers(2)
        number = farm.submit(farm.scene(), *JOB)
        job = farm.wait_for_job(number)
        trace, result = trace_of(farm, number)
        expect(result.err == "", result)
        units = trace.units()
        # 3x2 tiles, two groups, 16 samples of each group: passes of 2, 2, 4 and 8.
        expect(units == sorted((f, t, g, p) for f in (1, 2) for t in range(6) for g in (0, 1) for p in range(4)),
               (len(units), units[:9]))
        expect(units == trace.units("merge"), "each is merged once")
        for e in trace.slices["render"]:
            expect(e["pid"] in trace.workers and "process %d" % 0 not in trace.processes[e["pid"]], e)
            expect(trace.threads[e["pid"], e["tid"]] in ("thread 1", "thread 2"), e)
            expect(e["dur"] > 0 and e["args"]["cpu_ms"] > 0 and "estimated" not in e["args"], e)
        expect({trace.processes[p].rsplit(" ", 1)[1].rstrip(")") for p in trace.workers} <=
               {str(w.pid) for w in farm.workers}, trace.processes)
        # A unit was rendered before it was merged, up to the difference between clocks on one machine.
        merged = {tuple(e["args"][k] for k in ("frame", "tile", "group", "pass")): e["ts"]
                  for e in trace.slices["merge"]}
        for e in trace.slices["render"]:
            name = tuple(e["args"][k] for k in ("frame", "tile", "group", "pass"))
            expect(e["ts"] + e["dur"] <= merged[name] + 1000, (e, merged[name]))
        disk = {e["name"] for e in trace.slices["disk"]}
        expect(disk == {"write", "fsync"}, disk)
        expect(sum(e["args"]["tiles"] for e in trace.slices["disk"] if e["name"] == "write") >= 12, "tiles")
        pictures = sorted(e["args"]["frame"] for e in trace.slices["develop"] if e["name"] == "pictures")
        expect(pictures == [1, 2], pictures)
        texts = [e["name"] for e in trace.instants]
        expect(any(t.startswith("submitted") for t in texts) and any(t.startswith("done") for t in texts), texts)
        other = trace.all["otherData"]
        expect(other["job"] == number and other["name"] == job["name"] and other["lost_events"] == 0, other)
        # To standard output, the same slices.
        again = Trace(farm.cli("trace", number, expect=0).out)
        expect(again.units() == units, "standard output")
        farm.cli("develop", number, "--tonemap", "linear", expect=0)
        wait_for(lambda: farm.job(number)["frames_developed"] == 2, "pictures made again")
        again, _ = trace_of(farm, number)
        expect(sum(e["name"] == "pictures again" for e in again.slices["develop"]) == 2, "developed again")


@tests.add
def states():
    """A trace in every state: before any result, running, paused, cancelled, removed, and over restarts"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *ENDLESS)
        trace, result = trace_of(farm, number)
        expect(not trace.slices and "no result" in result.err, result)
        worker = farm.start_worker()
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
        trace, result = trace_of(farm, number)
        expect(trace.units() and result.err == "", result)
        farm.cli("pause", number, expect=0)
        paused, result = trace_of(farm, number)
        expect(set(paused.units()) >= set(trace.units()) and "paused" in str(paused.instants), result)
        # The worker connects again: the same process in the file, though the farm counts two.
        farm.coordinator.kill()
        farm.restart_coordinator()
        result = farm.cli("trace", number, expect=0)
        expect("nothing of job %d is known from before" % number in result.err and
               not Trace(result.out).slices, result)
        farm.cli("resume", number, expect=0)
        wait_for(lambda: Trace(farm.cli("trace", number, expect=0).out).units(), "a trace after the restart")
        farm.cli("cancel", number, "--discard", expect=0)
        trace, _ = trace_of(farm, number)
        expect(len(trace.workers) == 1 and "process %d" % worker.pid in str(trace.processes), trace.processes)
        farm.cli("remove", number, expect=0)
        expect(farm.cli("trace", number).code == 5, "it is gone")
        expect(farm.cli("trace").code == 2 and farm.cli("trace", "0").code == 2, "usage")
        expect(farm.cli("trace", 99).code == 5, "no such job")
        number = farm.submit(farm.scene(), *JOB)
        farm.wait_for_job(number)
        result = farm.cli("trace", number, "-o", farm.path("no", "such", "folder.json"))
        expect(result.code == 8 and "no/such" in result.err, result)


@tests.add
def reconnecting():
    """A worker that lost its connection is one process in the trace, and its clock is still known"""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker()
        number = farm.submit(farm.scene(), *ENDLESS)
        wait_for(lambda: farm.job(number)["samples_done"] > 0, "samples")
        worker.signal(signal.SIGSTOP)
        farm.coordinator.kill()
        farm.restart_coordinator()
        worker.signal(signal.SIGCONT)
        wait_for(lambda: len(Trace(farm.cli("trace", number, expect=0).out).units()) > 4, "results again")
        trace, _ = trace_of(farm, number)
        expect(len(trace.workers) == 1, trace.processes)
        expect(not any("estimated" in e["args"] for e in trace.slices["render"]), "times are told")


tests.run()
