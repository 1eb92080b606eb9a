"""What a whole farm costs: time to the first preview, merging, scaling over workers, memory.

Each function starts its own coordinator and workers on the loopback address (tests/farm) and
returns plain numbers. Run through tests/bench/run.sh.
"""
import os
import re
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "farm"))
from farm import BUILD, Farm, Failure, wait_for


def cpu_seconds(program):
    """User and system time that a running program has taken so far."""
    with open("/proc/%d/stat" % program.pid) as source:
        fields = source.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def peak_mib(program):
    with open("/proc/%d/status" % program.pid) as source:
        return int(re.search(r"VmHWM:\s+(\d+) kB", source.read()).group(1)) / 1024


def first_preview(scene, options, threads=2):
    """Seconds from the start of `azulejo submit` until it returned, and until the PNG of the first
    preview lay on the disk. Coordinator and worker are new: they hold nothing of the scene."""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=threads)
        farm.wait_for_workers(1)
        start = time.monotonic()
        number = farm.submit(scene, *options)
        accepted = time.monotonic() - start
        picture = farm.path("preview.png")
        wait_for(lambda: farm.cli("fetch", number, "--preview", picture).code == 0,
                 "the first preview")
        ready = time.monotonic() - start
        farm.cli("cancel", number, expect=0)
    return accepted, ready


def merging(workers, frames):
    """Tile results a second, and CPU-seconds of the coordinator a thousand results."""
    with Farm() as farm:
        coordinator = farm.start_coordinator()
        before = cpu_seconds(coordinator)
        done = subprocess.run(
            [os.path.join(BUILD, "tests", "bench", "bench_merge"), "--coordinator", farm.address,
             "--key", farm.key, "--workers", str(workers), "--frames", str(frames)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        found = re.search(r"results (\d+) .* (\d+) tiles/s", done.stdout)
        if done.returncode != 0 or not found:
            raise Failure("bench_merge: " + done.stdout)
        cpu = cpu_seconds(coordinator) - before
    return int(found.group(2)), cpu / int(found.group(1)) * 1000


def render(scene, options, workers):
    """One job on so many workers of one thread: seconds from its submission to its end, CPU-seconds
    of the workers and of the coordinator, and the largest worker's peak memory in MiB."""
    with Farm() as farm:
        farm.start_coordinator()
        for _ in range(workers):
            farm.start_worker(threads=1)
        farm.wait_for_workers(workers)
        idle = [cpu_seconds(p) for p in farm.programs]
        start = time.monotonic()
        number = farm.submit(scene, *options)
        farm.cli("watch", number, expect=0, limit_s=300)  # asking again and again would cost
        seconds = time.monotonic() - start
        cpu = [cpu_seconds(p) - i for p, i in zip(farm.programs, idle)]
        peak = max(peak_mib(w) for w in farm.workers)
    return {"seconds": seconds, "worker_cpu": sum(cpu[1:]), "coordinator_cpu": cpu[0],
            "peak_mib": peak}
