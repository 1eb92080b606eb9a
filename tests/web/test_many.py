#!/usr/bin/env python3
"""A large farm on the page: 500 jobs, 200 workers, 1,000 results a second. What depends on this machine's speed
is printed (make bench-page measures it); what does not is checked."""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from browser import Browser  # noqa: E402
from crowded import Crowd, frame_times, scroll  # noqa: E402
from farm import Tests  # noqa: E402
from jobs import expect  # noqa: E402
from webfarm import WebFarm  # noqa: E402

tests = Tests()
JOBS, WORKERS, RATE = 500, 200, 1000
NODES_MAX = 15000      # of the document with all these rows: 30 a row of the queue
GROWTH_MAX = 0.25      # of the page's memory, from the first busy seconds to the last


@tests.add
def five_hundred_jobs_and_a_thousand_tiles():
    """500 jobs, 200 workers and 1,000 tiles/s: the page stays usable, and neither nodes nor memory grow"""
    with WebFarm() as farm, Browser() as browser:
        coordinator = farm.start_coordinator()
        farm.fill(JOBS)
        page = farm.page(browser, width=1600, height=1000)
        page.wait("document.querySelectorAll('[data-job]').length > 0", "rows of jobs")
        with Crowd(farm, coordinator, WORKERS, RATE) as crowd:
            page.open("%s/#/job/%d" % (farm.origin(), crowd.job))
            page.wait("document.body.innerText.includes('%d workers')" % WORKERS, "all workers")
            crowd.wait(2000, page)
            page.collect_garbage()
            before = page.metrics()
            drawn = frame_times(page, 3)
            rows = scroll(page, "[data-job]", 2)
            crowd.wait(3000, page)
            page.collect_garbage()
            after = page.metrics()
            print("# %d nodes; heap %.1f MB, then %.1f MB; while tiles come: %s; while the queue scrolls: %s" % (
                after["Nodes"], before["JSHeapUsedSize"] / 1e6, after["JSHeapUsedSize"] / 1e6, drawn, rows))
            expect(after["Nodes"] <= NODES_MAX, "%d nodes" % after["Nodes"])
            expect(after["Nodes"] <= before["Nodes"] * (1 + GROWTH_MAX), "nodes grow: %d, then %d" % (
                before["Nodes"], after["Nodes"]))
            expect(after["JSHeapUsedSize"] <= before["JSHeapUsedSize"] * (1 + GROWTH_MAX) + 4e6, "memory grows")
            expect(after["JSEventListeners"] <= before["JSEventListeners"] + 50, "listeners grow: %d, then %d" % (
                before["JSEventListeners"], after["JSEventListeners"]))


if __name__ == "__main__":
    tests.run()
