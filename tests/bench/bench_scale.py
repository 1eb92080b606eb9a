"""`make bench-scale`: what a result costs a coordinator with many workers and a long queue.

    bench_scale.py [--tree FOLDER] [--seconds S] [--quick] [TABLE...]

Tables: workers, queue, latency, sparse, efficiency; all without one. --tree: the programs of another checkout,
which is built. --quick: fewer rows. The simulated workers (tests/bench/bench_scale.c) and the echo
(tests/bench/bench_echo.c) are always this tree's.

On a shared machine compare CPU time (us a result) and results a CPU-second of the server; results a second
depend on who else computes. Both servers have TLS on; an echo returns the bytes of a result.
"""
import argparse
import json
import os
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.normpath(os.path.join(HERE, "..", ".."))
TOOLS = os.path.join(ROOT, "build", "release", "tests", "bench")
QUEUE_MAX = 9990  # JOBS_ACTIVE_MAX, less those that measure


def tool(name, *argv):
    done = subprocess.run([os.path.join(TOOLS, name), *map(str, argv)], stdout=subprocess.PIPE,
                          universal_newlines=True)
    if done.returncode != 0:
        sys.exit("bench_scale: %s %s" % (name, " ".join(map(str, argv))))
    return json.loads(done.stdout) if done.stdout else None


class Bench:
    """A coordinator with a queue, measured again and again."""

    def __init__(self, farm, options):
        self.farm, self.options = farm, options
        self.process = farm.start_coordinator()
        self.to = ("--key", farm.key, "--coordinator", farm.address)

    def fill(self, jobs, *options):
        tool("bench_scale", "fill", *self.to, "--jobs", jobs, *options)

    def run(self, workers, *options):
        return tool("bench_scale", "run", *self.to, "--pid", self.process.pid, "--workers", workers,
                    "--seconds", self.options.seconds, *options)


def echo(farm, connections, seconds, size=6300):
    server = subprocess.Popen([os.path.join(TOOLS, "bench_echo"), "--serve", "--key", farm.key],
                              stdout=subprocess.PIPE, universal_newlines=True)
    try:
        port = int(server.stdout.readline().split()[1])
        return tool("bench_echo", "--key", farm.key, "--port", port, "--pid", server.pid,
                    "--connections", connections, "--seconds", seconds, "--bytes", size,
                    "--window", max(1, min(64, 4096 // connections)))
    finally:
        server.kill()
        server.wait()


def title(text):
    print("\n%s\n%s" % (text, "-" * len(text)), flush=True)


HEAD = "%26s %10s %10s %7s %7s" % ("", "results/s", "us each", "server", "client")


def line(name, r):
    print("%26s %10.0f %10.1f %7.2f %7.2f" % (
        name, r["results_per_s"], r["cpu_us_per_result"], r["coordinator_busy"], r["client_busy"]),
        flush=True)


def show_workers(Farm, options):
    title("Workers: no other job, no latency; beside an echo of the same bytes")
    print(HEAD + " %10s %8s %8s" % ("echo/s", "us each", "CPU x"))
    for workers in (1, 100, 1000) if options.quick else (1, 10, 100, 1000, 10000):
        with Farm() as farm:
            bench = Bench(farm, options)
            r = bench.run(workers)
            e = echo(farm, workers, options.seconds)
            print("%26s %10.0f %10.1f %7.2f %7.2f %10.0f %8.1f %8.2f" % (
                "%d workers" % workers, r["results_per_s"], r["cpu_us_per_result"],
                r["coordinator_busy"], r["client_busy"], e["messages_per_s"],
                e["cpu_us_per_message"], r["cpu_us_per_result"] / e["cpu_us_per_message"]),
                flush=True)


QUEUE_ROWS = ((16, 200), (16, 1000), (500, 200), (1000, 0))  # workers, results a second together (0: all they can)


def show_queue(Farm, options):
    title("The queue: other jobs behind the one that is measured, or before it for other machines")
    print(HEAD)
    for jobs, where in ((0, ""), (QUEUE_MAX, "behind"), (QUEUE_MAX, "before")):
        with Farm() as farm:
            bench = Bench(farm, options)
            if jobs:
                bench.fill(jobs, *(["--ahead"] if where == "before" else []))
            for workers, rate in QUEUE_ROWS:
                line("%d %s, %d w, %s/s" % (jobs, where or "jobs", workers, rate or "max"),
                     bench.run(workers, "--rate", rate))


def show_latency(Farm, options):
    title("Latency: 1000 workers, from a grant to its results")
    print(HEAD)
    with Farm() as farm:
        bench = Bench(farm, options)
        for jobs in (0, QUEUE_MAX):
            if jobs:
                bench.fill(jobs)
            for latency in (0, 50, 150):
                line("%d jobs, %d ms" % (jobs, latency), bench.run(1000, "--latency-ms", latency))


def show_sparse(Farm, options):
    title("Sparse results: 16 workers that render")
    print(HEAD)
    with Farm() as farm:
        bench = Bench(farm, options)
        for rate in (50, 200, 1000, 5000):
            line("%d results/s" % rate, bench.run(16, "--rate", rate))


def thread_seconds(pid):
    """CPU time of each thread of a process, by its name."""
    out, ticks = {}, os.sysconf("SC_CLK_TCK")
    for thread in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/stat" % (pid, thread)) as source:
            text = source.read()
        fields = text.rsplit(")", 1)[1].split()
        out[int(thread)] = (int(fields[11]) + int(fields[12])) / ticks
    return out


def efficiency(farm, scene, options, workers):
    """Share of the CPU time of two workers and the coordinator that rendering threads take. A worker's
    rendering thread is the one that takes the most."""
    coordinator = farm.start_coordinator()
    for _ in range(workers):
        farm.start_worker(threads=1)
    farm.wait_for_workers(workers)
    before = [thread_seconds(p.pid) for p in farm.programs]
    number = farm.submit(scene, *options)
    farm.cli("watch", number, expect=0, limit_s=600)
    after = [thread_seconds(p.pid) for p in farm.programs]
    took = [{t: a[t] - b.get(t, 0) for t in a} for a, b in zip(after, before)]
    rendering = sum(max(t.values()) for t in took[1:])
    assert farm.programs[0] is coordinator
    return rendering, sum(sum(t.values()) for t in took[1:]) - rendering, sum(took[0].values())


def show_efficiency(Farm, options):
    title("Two workers of one thread: rendering threads' CPU over all CPU, coordinator counted")
    scene = os.path.join(ROOT, "scenes/cornell/cornell-area.gltf")
    for settings in (["--size", "400x400", "--spp", "64"], ["--size", "640x360", "--spp", "256"]):
        with Farm() as farm:
            rendering, rest, coordinator = efficiency(farm, scene, settings, 2)
        print("%26s rendering %.2f s, their other threads %.2f s, coordinator %.2f s: %.3f" % (
            " ".join(settings[1::2]) + " spp", rendering, rest, coordinator,
            rendering / (rendering + rest + coordinator)), flush=True)


TABLES = {"workers": show_workers, "queue": show_queue, "latency": show_latency,
          "sparse": show_sparse, "efficiency": show_efficiency}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tree", default=ROOT)
    parser.add_argument("--seconds", type=int, default=4)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=" ".join(TABLES))
    options = parser.parse_args()
    for name in options.tables:
        if name not in TABLES:
            parser.error("no table %s" % name)
    os.environ["BUILD"] = os.path.join(options.tree, "build", "release")
    sys.path.insert(0, os.path.join(ROOT, "tests", "farm"))
    from farm import Farm
    print("%s, load %.1f, %s" % (time.strftime("%Y-%m-%d"), os.getloadavg()[0], options.tree))
    for name, show in TABLES.items():
        if not options.tables or name in options.tables:
            show(Farm, options)


main()
