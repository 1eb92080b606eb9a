"""`make bench-page`: how fast the page is in Chromium, and what it costs the coordinator (docs/WEB.md).

    bench_page.py [--jobs N] [--workers N] [--rate R] [--seconds S]
    bench_page.py --faults [--workers N] [--rate R] [--seconds S]     results a second that the coordinator takes while
                                        its page is killed again and again, stands still, or computes for good

Chromium draws on the processor here (SwiftShader), on the same cores as the farm: on a desk with a graphics card
the page has both for itself. Figures of this machine are for comparing, not for promising.
"""
import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import threading
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "web"))

from browser import Browser  # noqa: E402
from crowded import Crowd, frame_times, scroll  # noqa: E402
from farm import BUILD, preloaded  # noqa: E402
from webfarm import WebFarm, assets_bytes, connected  # noqa: E402

LOADS = 7
ROUNDS = 3


def line(what, value):
    print("%-58s %s" % (what, value), flush=True)


def first_paint(farm, browser):
    """Milliseconds from the request to the first paint with content, of a page that is logged in: the median."""
    page = farm.page(browser)
    times = []
    for _ in range(LOADS):
        page.reload()
        connected(page)
        times.append(page.wait("performance.getEntriesByName('first-contentful-paint')[0]?.startTime"))
    page.close()
    return sorted(times)[LOADS // 2]


def busy_s(pid):
    """CPU seconds of a process until now."""
    with open("/proc/%d/stat" % pid) as source:
        fields = source.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def share(pid, seconds, pump):
    """CPU seconds a second that a process takes, while `pump` keeps browsers going."""
    begin, cpu = time.monotonic(), busy_s(pid)
    while time.monotonic() < begin + seconds:
        pump(0.05)
    return (busy_s(pid) - cpu) / (time.monotonic() - begin)


def page_of(coordinator):
    """The number of the page's process; None: it does not run."""
    found = subprocess.run(["pgrep", "-P", str(coordinator.pid), "azulejo-web"], stdout=subprocess.PIPE,
                           universal_newlines=True, check=False).stdout.split()
    return int(found[0]) if found else None


def disturb(coordinator, fault, over):
    """Until `over` is set."""
    while not over.wait(0.25):
        page = page_of(coordinator)
        if page and fault:
            try:
                os.kill(page, fault)
            except ProcessLookupError:
                pass


def results_a_second(fault, options):
    """What the coordinator takes while the page gets that signal."""
    with WebFarm() as farm:
        coordinator = farm.start_coordinator(env={"LD_PRELOAD": preloaded("odd_reach.so"), "ODD_REACH": "spin"})
        over = threading.Event()
        disturber = threading.Thread(target=disturb, args=(coordinator, fault, over))
        disturber.start()
        try:
            words = subprocess.run(
                [os.path.join(BUILD, "tests", "bench", "bench_scale"), "run", "--key", farm.key, "--coordinator", farm.address,
                 "--pid", str(coordinator.pid), "--workers", str(options.workers), "--rate", str(options.rate),
                 "--seconds", str(options.seconds)], stdout=subprocess.PIPE, universal_newlines=True, check=True)
        finally:
            over.set()
            disturber.join()
        return json.loads(words.stdout)["results_per_s"]


def faults(options):
    kinds = {"undisturbed": 0, "killed": signal.SIGKILL, "stands still": signal.SIGSTOP, "computes for good": signal.SIGUSR2}
    found = {kind: [] for kind in kinds}
    for _ in range(ROUNDS):  # in turn: what the machine does besides falls on all alike
        for kind, fault in kinds.items():
            found[kind].append(results_a_second(fault, options))
    for kind, rates in found.items():
        shares = sorted(rate / base for rate, base in zip(rates, found["undisturbed"]))
        line("results/s, the page %s" % kind, "%.0f, of the undisturbed %.3f (%.3f to %.3f)" % (
            statistics.median(rates), statistics.median(shares), shares[0], shares[-1]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--jobs", type=int, default=500)
    parser.add_argument("--workers", type=int, default=200)
    parser.add_argument("--rate", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=5)
    parser.add_argument("--faults", action="store_true")
    options = parser.parse_args()
    if options.faults:
        faults(options)
        return
    with WebFarm() as farm, Browser() as browser:
        coordinator = farm.start_coordinator()
        line("the page, bytes of its files", assets_bytes())
        line("first paint, empty farm, ms", "%.0f" % first_paint(farm, browser))
        farm.fill(options.jobs)
        line("first paint, %d jobs, ms" % options.jobs, "%.0f" % first_paint(farm, browser))
        with Crowd(farm, coordinator, options.workers, options.rate) as crowd:
            watched = "%d results/s of %d workers" % (options.rate, options.workers)
            crowd.wait(1000)
            line("coordinator, %s, no page: CPU s/s" % watched,
                 "%.3f" % share(coordinator.pid, options.seconds, time.sleep))
            link = "#/job/%d" % crowd.job
            pages = [farm.page(browser, link, width=1600, height=1000)]
            crowd.wait(1000, pages[0])
            line("coordinator, one page watches: CPU s/s",
                 "%.3f" % share(coordinator.pid, options.seconds, browser.pump))
            line("page, the picture arrives", frame_times(pages[0], options.seconds))
            line("page, the queue of %d scrolls" % options.jobs, scroll(pages[0], "[data-job]", options.seconds))
            pages += [farm.page(browser, link) for _ in range(2)]
            line("coordinator, three pages watch: CPU s/s",
                 "%.3f" % share(coordinator.pid, options.seconds, browser.pump))
            line("page, three watch, the picture arrives", frame_times(pages[0], options.seconds))
            pages[0].open(farm.origin() + "/#/workers")
            line("page, %d workers scroll" % options.workers, scroll(pages[0], "[data-worker]", options.seconds))


main()
