#!/usr/bin/env python3
"""Which tests of farms and pages waver? Run them again and again, in random order and in lanes, on a machine that is made busy.

    tests/steady.py [--rounds N] [--lanes L] [--seed S] [--calm] [--late WHAT] [PATTERN]

Each round runs every file whose path matches once. Beside them two processes burn processor time and one fills the page
cache; --calm leaves these out. --late makes changes of the store, syncs or answers late (FARM_LATE in tests/farm/farm.py). The end is a table: file, runs, failures, the slowest in seconds. What a failed run
printed is kept in build/steady. The exit status says if all passed. BUILD names the build tree."""
import argparse
import collections
import glob
import os
import queue
import random
import re
import signal
import subprocess
import sys
import threading
import time

LIMIT_S = 900
LONG = r"tests/web/test_(admin|edges|ways)\.py$"  # as in tests/run.sh: not in make test
BURN = "while True: pass"
FILL = """
import os, sys
chunk = os.urandom(1 << 20)
while True:
    with open(sys.argv[1], "wb") as out:
        for _ in range(2048):
            out.write(chunk)
"""


def busy_machine(folder):
    """Start what disturbs the tests."""
    return [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(2)] + \
           [subprocess.Popen([sys.executable, "-c", FILL, os.path.join(folder, "filling")])]


def run(path, log):
    """Seconds, and what failed (a text; empty: nothing)."""
    began = time.monotonic()
    with open(log, "wb") as out:
        process = subprocess.Popen([sys.executable, path], stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                                   start_new_session=True)
        try:
            code = process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return time.monotonic() - began, "time-out"
    took = time.monotonic() - began
    with open(log, errors="replace") as source:
        text = source.read()
    bad = re.findall(r"^\s*not ok \d+ - (.*)", text, re.M)
    bad = [b for b in bad if not re.search(r"# ?skip", b, re.I)]
    if code != 0 and not bad:
        bad = ["exit %d" % code]
    return took, "; ".join(bad)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--lanes", type=int, default=(os.cpu_count() or 1) + 1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true")
    parser.add_argument("--late", choices=("database", "sync", "answer"))
    parser.add_argument("pattern", nargs="?", default=".")
    options = parser.parse_args()

    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
    os.environ.setdefault("BUILD", "build/release")
    os.environ.setdefault("FARM_PATIENCE", "3")  # as in tests/run.sh
    if options.late:
        os.environ["FARM_LATE"] = options.late
    files = [f for f in sorted(glob.glob("tests/farm/test_*.py") + glob.glob("tests/web/test_*.py"))
             if re.search(options.pattern, f) and not (options.pattern == "." and re.match(LONG, f))]
    if not files:
        parser.error("no file of tests/farm or tests/web matches '%s'" % options.pattern)
    folder = os.path.join("build", "steady")
    os.makedirs(folder, exist_ok=True)
    random.seed(options.seed)
    work, lock = queue.Queue(), threading.Lock()
    for turn in range(1, options.rounds + 1):
        for path in random.sample(files, len(files)):
            work.put((turn, path))
    runs, failures, slowest = collections.Counter(), collections.Counter(), collections.Counter()

    def lane():
        while True:
            try:
                turn, path = work.get_nowait()
            except queue.Empty:
                return
            log = os.path.join(folder, "%s.%s%d.%d.log" % (path[:-3].replace("/", "_"), options.late or "", options.seed, turn))
            took, bad = run(path, log)
            with lock:
                runs[path] += 1
                slowest[path] = max(slowest[path], took)
                if bad:
                    failures[path] += 1
                    print("FAIL %s, round %d (%.0f s): %s; %s" % (path, turn, took, bad[:200], log), flush=True)
                else:
                    os.unlink(log)

    disturbers = [] if options.calm else busy_machine(folder)
    try:
        lanes = [threading.Thread(target=lane) for _ in range(options.lanes)]
        for thread in lanes:
            thread.start()
        for thread in lanes:
            thread.join()
    finally:
        for process in disturbers:
            process.kill()
            process.wait()
        if os.path.exists(os.path.join(folder, "filling")):
            os.unlink(os.path.join(folder, "filling"))
    print("\n%-44s %5s %8s %10s" % ("file", "runs", "failures", "slowest"))
    for path in sorted(files, key=lambda f: (-failures[f], -slowest[f])):
        print("%-44s %5d %8d %8.0f s" % (path, runs[path], failures[path], slowest[path]))
    total = sum(failures.values())
    print("%d of %d runs failed" % (total, sum(runs.values())))
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main())
