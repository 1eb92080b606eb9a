"""`make bench-scale`: what a result costs a coordinator with many workers and a long queue.

    bench_scale.py [--tree FOLDER] [--seconds S] [--quick] [TABLE...]
    bench_scale.py [--base FOLDER] [--pairs N] farm        (make bench-farm BASE=FOLDER)

Tables: workers, queue, latency, sparse, efficiency, tiny; all without one. --tree: the programs of another checkout,
which is built. --quick: fewer rows. The simulated workers (tests/bench/bench_scale.c) and the echo
(tests/bench/bench_echo.c) are always this tree's. farm: what real jobs cost, this tree's and the base's in turns,
medians of the pairs; without a base beside the last release's stored figures (LAST_RELEASE). The exit status is 1
where a figure is beyond its limit (GATES).

On a shared machine compare CPU time (us a result) and results a CPU-second of the server; results a second
depend on who else computes. Both servers have TLS on; an echo returns the bytes of a result.
"""
import argparse
import json
import os
import statistics
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


# ---- real jobs ----------------------------------------------------------------------------------------------------

def thread_seconds(pid):
    """CPU time of each thread of a process, by its number."""
    out = {}
    for thread in os.listdir("/proc/%d/task" % pid):
        try:
            with open("/proc/%d/task/%s/schedstat" % (pid, thread)) as source:
                out[int(thread)] = int(source.read().split()[0]) / 1e9
        except (FileNotFoundError, ProcessLookupError):  # it ended
            continue
    return out


def proc_number(pid, name, key):
    with open("/proc/%d/%s" % (pid, name)) as source:
        return next(int(line.split()[1]) for line in source if line.startswith(key + ":"))


def process_seconds(pid):
    """With the threads that have ended."""
    with open("/proc/%d/stat" % pid) as source:
        fields = source.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def job_of(farm, scene, *options):
    """One job on two workers of one thread. A worker's rendering thread is the one that takes the most. What the
    coordinator has read is nearly all from workers; what it has written is what went to the disk's cache as dirty pages."""
    coordinator = farm.start_coordinator()
    for _ in range(2):
        farm.start_worker(threads=1)
    farm.wait_for_workers(2)
    pid = coordinator.pid
    before = [thread_seconds(p.pid) for p in farm.programs]
    cpu, read, written = process_seconds(pid), proc_number(pid, "io", "rchar"), proc_number(pid, "io", "write_bytes")
    start = time.monotonic()
    number = farm.submit(os.path.join(ROOT, "scenes", scene), *options)
    farm.cli("watch", number, expect=0, limit_s=600)
    seconds = time.monotonic() - start
    took = [{t: s - b.get(t, 0) for t, s in thread_seconds(p.pid).items()} for p, b in zip(farm.programs, before)]
    assert farm.programs[0] is coordinator
    rendering = sum(max(t.values()) for t in took[1:])
    return {"seconds": seconds, "rendering": rendering, "rest": sum(sum(t.values()) for t in took[1:]) - rendering,
            "coordinator": process_seconds(pid) - cpu, "read": proc_number(pid, "io", "rchar") - read,
            "written": proc_number(pid, "io", "write_bytes") - written,
            "peak": proc_number(pid, "status", "VmHWM") * 1024}


TINY_FRAMES = 240
# name, scene, size, samples, frames
JOBS = (("cornell-area 400x400 64 spp", "cornell/cornell-area.gltf", (400, 400), 64, 1),
        ("textured-spheres 640x360 64 spp", "studio/textured-spheres.gltf", (640, 360), 64, 1),
        ("cornell-area 640x360 256 spp", "cornell/cornell-area.gltf", (640, 360), 256, 1),
        ("%d frames of 64x36, 4 spp" % TINY_FRAMES, "studio/textured-spheres.gltf", (64, 36), 4, TINY_FRAMES))


def measure_job(Farm, row):
    """The figures of a row of JOBS, by name."""
    _, scene, (width, height), spp, frames = JOBS[row]
    with Farm() as farm:
        r = job_of(farm, scene, "--size", "%dx%d" % (width, height), "--spp", spp, "--frames", "1-%d" % frames)
    out = {"coordinator, s": r["coordinator"], "workers' other threads, s": r["rest"],
           "coordinator, share of rendering": r["coordinator"] / r["rendering"],
           "rendering threads' share": r["rendering"] / (r["rendering"] + r["rest"] + r["coordinator"]),
           "read, bytes a pixel": r["read"] / (width * height * frames),
           "written per byte read": r["written"] / r["read"]}
    if frames > 1:
        return {"coordinator, ms a frame": 1000 * r["coordinator"] / frames,
                "coordinator, share of rendering": r["coordinator"] / r["rendering"], "frames a second": frames / r["seconds"]}
    out["coordinator's peak, MiB"] = r["peak"] / 2**20
    return out


def show_job(Farm, row):
    for name, value in measure_job(Farm, row).items():
        print("%34s  %-30s %10.3f" % (JOBS[row][0], name, value), flush=True)


def show_efficiency(Farm, options):
    title("Two workers of one thread; rendering threads' CPU over all CPU, coordinator counted")
    for row in range(2 if options.quick else 3):
        show_job(Farm, row)


def show_tiny(Farm, options):
    title("Tiny frames: what a frame costs besides its samples")
    show_job(Farm, len(JOBS) - 1)


# The noise of the medians of three pairs on a shared machine: of a share, and of CPU times.
NOISE_SHARE, NOISE_CPU = 0.01, 0.15
# The limits of `farm`: what a figure, by its name, should be beside the base's.
GATES = {"rendering threads' share": ("at least the base's, less %g" % NOISE_SHARE,
                                      lambda now, base: now >= base - NOISE_SHARE),
         "coordinator, share of rendering": ("at most the base's and %g %%" % (100 * NOISE_CPU),
                                             lambda now, base: now <= base * (1 + NOISE_CPU)),
         "read, bytes a pixel": ("at most the base's and 2 %", lambda now, base: now <= base * 1.02),
         "coordinator's peak, MiB": ("at most the base's and 10 %", lambda now, base: now <= base * 1.1),
         "written per byte read": ("at most 2", lambda now, base: now <= 2)}
# Figures of 0.2.0 that hardly depend on the machine, by row of JOBS (two cores, otherwise idle; docs/SCALE.md).
LAST_RELEASE = ({"rendering threads' share": .825, "read, bytes a pixel": 300, "written per byte read": 5.0,
                 "coordinator's peak, MiB": 86},
                {"rendering threads' share": .809, "read, bytes a pixel": 300, "written per byte read": 5.0,
                 "coordinator's peak, MiB": 94},
                {"rendering threads' share": .890, "read, bytes a pixel": 495, "written per byte read": 5.1,
                 "coordinator's peak, MiB": 98},
                {})


def beyond(name, now, base):
    """What the figure should be and is not; None: it is within its limit, or has none."""
    words, holds = GATES.get(name, ("", lambda now, base: True))
    return None if holds(now, base) else words


def show_farm(options):
    """Each tree by a process of its own: a farm's programs are chosen when farm.py is read. The number of figures beyond
    their limits."""
    failed = []
    trees = (ROOT, os.path.abspath(options.base)) if options.base else (ROOT,)
    print("load %.1f, %d processors" % (os.getloadavg()[0], os.cpu_count()))
    print("| job | figure | base | now |\n|---|---|---:|---:|")
    for row in range(len(JOBS)):
        found = {tree: [] for tree in trees}
        for i in range(options.pairs):
            for tree in trees if i % 2 else trees[::-1]:
                done = subprocess.run([sys.executable, "-B", __file__, "--tree", tree, "--row", str(row)],
                                      stdout=subprocess.PIPE, check=True, universal_newlines=True)
                found[tree].append(json.loads(done.stdout.strip().split("\n")[-1]))
        for name in found[ROOT][0]:
            now = statistics.median(f[name] for f in found[ROOT])
            base = statistics.median(f[name] for f in found[trees[1]]) if options.base else LAST_RELEASE[row].get(name)
            print("| %s | %s | %s | %.3f |" % (JOBS[row][0], name, "-" if base is None else "%.3f" % base, now),
                  flush=True)
            if base is not None and beyond(name, now, base):
                failed.append("%s: %s is %.3f, should be %s (base: %.3f)" % (JOBS[row][0], name, now,
                                                                             beyond(name, now, base), base))
    for words in failed:
        print("beyond its limit: " + words, file=sys.stderr)
    return len(failed)


TABLES = {"workers": show_workers, "queue": show_queue, "latency": show_latency,
          "sparse": show_sparse, "efficiency": show_efficiency, "tiny": show_tiny}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tree", default=ROOT)
    parser.add_argument("--seconds", type=int, default=4)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--base", help="a built checkout of the last release, for the table farm")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--row", type=int, help="only that row of JOBS, as JSON")
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=" ".join(TABLES) + " farm")
    options = parser.parse_args()
    if options.tables == ["farm"]:
        sys.exit(1 if show_farm(options) else 0)
    for name in options.tables:
        if name not in TABLES:
            parser.error("no table %s" % name)
    os.environ["BUILD"] = os.path.join(options.tree, "build", "release")
    sys.path.insert(0, os.path.join(ROOT, "tests", "farm"))
    from farm import Farm
    if options.row is not None:
        print(json.dumps(measure_job(Farm, options.row)))
        return
    print("%s, load %.1f, %s" % (time.strftime("%Y-%m-%d"), os.getloadavg()[0], options.tree))
    for name, show in TABLES.items():
        if not options.tables or name in options.tables:
            show(Farm, options)


if __name__ == "__main__":
    main()
