"""What pages that watch cost a render: processor time of the coordinator and of the worker, for the same job.

    bench_page_cost.py [--size WxH] [--spp N] [--pages N,N,...] [--rounds N]

Each page is a WebSocket that takes tiles and events as fast as they come (docs/API.md, the live picture), in a
process of its own. Processor time, not wall time, so that a busy machine does not count. "loss" is what the
coordinator took more than without pages, as a share of the processor time of the whole job.
"""
import argparse
import multiprocessing
import os
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "farm"))

from farm import Farm  # noqa: E402
from page import Page  # noqa: E402
from websocket import Closed, WebSocket  # noqa: E402

SCENE = os.path.join(HERE, "..", "..", "scenes", "cornell", "cornell-area.gltf")


def busy_s(pid):
    """CPU seconds of a process until now."""
    with open("/proc/%d/stat" % pid) as source:
        fields = source.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def watch(address, token, job, tiles):
    """Watch until the server ends the connection; count the tiles."""
    with WebSocket(address, "/api/v1/live", token) as socket:
        socket.send({"resume": None})
        socket.send({"watch": 1, "job": job, "frame": 0, "layer": "color"})
        try:
            while True:
                message = socket.receive(limit_s=600)
                if message and message[0] == "binary":
                    with tiles.get_lock():
                        tiles.value += int.from_bytes(message[1][8:12], "little")
        except (Closed, OSError):
            pass


def measure(pages, options):
    """(CPU seconds of the coordinator, of the worker, tiles sent) of one job."""
    with Farm() as farm:
        coordinator = farm.start_coordinator("--web", "127.0.0.1:0")
        page = Page(coordinator)
        worker = farm.start_worker(threads=1)
        tiles = multiprocessing.Value("Q", 0)
        number = farm.submit(SCENE, "--size", options.size, "--spp", str(options.spp), "-o", "picture")
        watchers = [multiprocessing.Process(target=watch, args=(page.host, page.token, number, tiles), daemon=True)
                    for _ in range(pages)]
        for watcher in watchers:
            watcher.start()
        while farm.job(number)["state"] in ("queued", "running"):
            time.sleep(2)  # each question is a connection of its own, with a handshake
        result = busy_s(coordinator.pid), busy_s(worker.pid), tiles.value
        for watcher in watchers:
            watcher.terminate()
        return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--pages", default="0,1,3")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    counts = [int(n) for n in options.pages.split(",")]
    best = {}
    for _ in range(options.rounds):  # in turn: what the machine does besides falls on all alike
        for pages in counts:
            found = measure(pages, options)
            if pages not in best or found[0] < best[pages][0]:
                best[pages] = found
    print("%s, %d spp, one thread; the least of %d rounds" % (options.size, options.spp, options.rounds))
    print("%5s %14s %9s %8s %7s" % ("pages", "coordinator s", "worker s", "tiles", "loss"))
    base = best[counts[0]]
    for pages in counts:
        cpu, work, tiles = best[pages]
        print("%5d %14.2f %9.2f %8d %6.2f%%" % (pages, cpu, work, tiles, 100 * (cpu - base[0]) / (base[0] + base[1])))


main()
