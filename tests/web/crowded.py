"""A farm that is busier than its machine could be: simulated workers, and how smoothly the page keeps up."""
import os

from farm import BUILD, Failure, Program, wait_for

FIRST_PASS = 512  # samples of a tile's first pass: 2 of each pixel


class Crowd:
    """So many simulated workers that deliver so many results a second of a job of their own (1920x1080)."""

    def __init__(self, farm, coordinator, workers, rate):
        self.farm = farm
        known = {j["job"] for j in self.jobs()}
        self.program = Program("bench_scale", [
            os.path.join(BUILD, "tests", "bench", "bench_scale"), "run", "--key", farm.key, "--coordinator",
            farm.address, "--pid", str(coordinator.pid), "--workers", str(workers), "--rate", str(rate),
            "--seconds", "600"], farm.path("crowd-%d.log" % len(farm.programs)))
        self.job = wait_for(lambda: [j["job"] for j in self.jobs() if j["job"] not in known],
                            "the simulated workers' job")[0]

    def jobs(self):
        return self.farm.api("GET", "/jobs?filter=active&first=10")["jobs"]

    def wait(self, count, page=None):
        """Wait until at least the samples of so many first passes have been merged, while the page goes on."""
        def samples():
            if not self.program.alive():
                raise Failure(self.program.log_text())
            if page:
                page.browser.pump(0.02)
            info = self.farm.api("GET", "/jobs/%d" % self.job)
            return int((info["jobs"][0] if "jobs" in info else info)["samples_done"])
        begin = samples()
        wait_for(lambda: samples() >= begin + count * FIRST_PASS, "%d results" % count)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.program.kill()


def summary(times):
    """Milliseconds between animation frames, as words."""
    if not times:
        raise Failure("the page drew nothing")
    times = sorted(times)
    return "%.0f frames/s, median %.1f ms, 99 %% within %.1f ms" % (
        1000 * len(times) / sum(times), times[len(times) // 2], times[int(len(times) * 0.99)])


def frame_times(page, seconds):
    """How long each animation frame took for so many seconds."""
    return summary(page.js("""new Promise(done => { const out = []; let last = 0, begin = 0; /* the first frame may be late */
        const f = now => { begin ||= now; if (last) out.push(now - last); last = now;
          if (now - begin < %d) requestAnimationFrame(f); else done(out); };
        requestAnimationFrame(f); })""" % (seconds * 1000)))


def scroll(page, what, seconds):
    """The same while the list that `what` is in scrolls to and fro."""
    page.wait("""(() => { for (const row of document.querySelectorAll(%r))
          for (let e = row.parentElement; e; e = e.parentElement)
            if (e.scrollHeight > e.clientHeight + 1) return window.list = e; })()""" % what, "a list that can scroll")
    return summary(page.js("""new Promise(done => { const out = []; let last = 0, begin = 0; /* the first frame may be late */
        const f = now => { begin ||= now; if (last) out.push(now - last); last = now;
          const at = (now - begin) / 1000 %% 2; list.scrollTop = (at < 1 ? at : 2 - at) * 4000;
          if (now - begin < %d) requestAnimationFrame(f); else { list.scrollTop = 0; done(out); } };
        requestAnimationFrame(f); })""" % (seconds * 1000)))
