#!/usr/bin/env python3
"""/healthz, /readyz and /metrics: what those see who watch a farm from outside."""
import glob
import json
import math
import os
import re

from disk import OddDisk
from farm import Failure, Farm, ROOT, Tests, wait_for
from jobs import expect
from page import Page
from prometheus import Metrics

tests = Tests()
NASTY = 'a "b" \\ c\u2713 {x="1"} # HELP'


def scrape(page):
    answer = page.get("/metrics")
    expect(answer.status == 200 and answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8", answer)
    return Metrics(answer.body.decode())


def only_grow(before, after):
    for key, value in before.counters().items():
        expect(after.counters().get(key, -1) >= value, ("a counter decreased", key, value, after.values.get(key)))


@tests.add
def parser():
    """the parser of these tests refuses what is not the format"""
    good = '# HELP a_total x\n# TYPE a_total counter\na_total{b="c\\"\\\\\\n"} 1\n'
    expect(Metrics(good).get("a_total", b='c"\\\n') == 1, "it reads")
    for wrong in (good[:-1], good.replace("a_total", "a"), good + good, good.replace("\\n", "\\t"), good + "\n",
                  good.replace(" 1\n", " one\n"), "a 1\n", good.replace("# HELP a_total x\n", ""),
                  good.replace('"} 1', '"1'), good.replace("{b=", "{quantile="), good + "b 1\n",
                  "# HELP h x\n# TYPE h histogram\nh_bucket{le=\"1\"} 2\nh_bucket{le=\"+Inf\"} 1\nh_sum 1\nh_count 1\n"):
        try:
            Metrics(wrong)
        except Failure:
            continue
        raise Failure("it took: " + wrong)


@tests.add
def numbers():
    """the format to the letter, jobs, samples, workers, leases, syncs and errors with any name; counters never decrease"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        first = scrape(page)
        expect(sum(first.of("azulejo_jobs").values()) == 0 and first.get("azulejo_results_total") == 0, "nothing yet")
        expect(math.isnan(first.get("azulejo_lease_age_seconds", share="1")), "no lease")
        for name in first.types:
            expect(name.startswith("azulejo_"), name)
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "64")
        expect(scrape(page).get("azulejo_jobs", state="queued") == 1, "queued")
        farm.start_worker(threads=2)
        farm.wait_for_job(job)
        done = scrape(page)
        only_grow(first, done)
        expect(done.get("azulejo_jobs", state="done") == 1 and done.get("azulejo_jobs_ended_total", state="done") == 1, "done")
        expect(done.get("azulejo_samples_total") == 64 * 64 * 64, done.get("azulejo_samples_total"))
        expect(done.get("azulejo_results_total") > 0 and done.get("azulejo_frames_done_total") == 1, "results")
        expect(done.get("azulejo_conflicts_total") == 0 and done.get("azulejo_core_seconds_total") > 0, "work")
        expect(done.get("azulejo_sync_seconds_count") > 0, "syncs")
        expect(set(dict(labels)["kind"] for labels in done.of("azulejo_faults_total")) >=
               {"dropped_samples", "clamped_values"}, "kinds of faults")
        expect(sum(done.of("azulejo_workers").values()) == 1 and sum(done.of("azulejo_threads").values()) == 2, "workers")
        farm.cli("remove", job, expect=0)
        gone = scrape(page)
        only_grow(done, gone)
        expect(sum(gone.of("azulejo_jobs").values()) == 0 and gone.get("azulejo_samples_total") == 64 ** 3, "removed")
        endless = farm.submit(farm.scene(), "--size", "64x64", "--spp", "1000000", "--name", NASTY)

        def with_error():
            now = scrape(page)
            return now if now.of("azulejo_frame_error_codes") else None
        busy = wait_for(with_error, "a frame's error")
        only_grow(gone, busy)
        [(labels, error)] = busy.of("azulejo_frame_error_codes").items()
        expect(dict(labels) == {"job": str(endless), "name": NASTY, "frame": "1"} and error > 0, labels)
        expect(busy.get("azulejo_leases") >= 1 and busy.get("azulejo_lease_age_seconds", share="1") >=
               busy.get("azulejo_lease_age_seconds", share="0.5") >= 0, busy.of("azulejo_lease_age_seconds"))
        expect(busy.get("azulejo_workers", state="working") == 1, busy.of("azulejo_workers"))
        farm.workers[0].kill()
        lost = wait_for(lambda: (lambda m: m if m.get("azulejo_workers_lost_total") == 1 else None)(scrape(page)), "its loss")
        only_grow(busy, lost)
        expect(sum(lost.of("azulejo_workers").values()) == 0 and lost.get("azulejo_leases") == 0, "it is gone")
        measured = wait_for(lambda: (lambda m: m if m.get("azulejo_store_measured_age_seconds") >= 0 else None)(scrape(page)),
                            "the store's size")
        expect(measured.get("azulejo_store_bytes", kind="database") > 0 and
               0 < measured.get("azulejo_disk_free_bytes") <= measured.get("azulejo_disk_bytes"), measured.of("azulejo_store_bytes"))
        expect(measured.get("azulejo_web_requests_total", code="2xx") > 5, "requests")
        expect(measured.get("azulejo_web_connections") >= 1, "this one")
        expect(page.get("/nothing").status == 404, "404")
        expect(scrape(page).get("azulejo_web_requests_total", code="4xx") >= 1, "it is counted")
        expect(page.get("/metrics", token="").status == 401, "not without a token")


@tests.add
def readiness():
    """/healthz and /readyz need no token; a store that fails, and an end, are 503 with the reason"""
    with Farm() as farm:
        disk = OddDisk(farm)
        page = Page(farm.start_coordinator(env=disk.env))
        for path in ("/healthz", "/readyz"):
            answer = page.get(path, token="")
            expect((answer.status, answer.body) == (200, b"ok\n") and answer.headers["content-type"].startswith("text/plain"),
                   answer)
        expect(page.request("HEAD", "/readyz", token="").status == 200, "HEAD")
        farm.start_worker()
        job = farm.submit(farm.scene(), "--size", "64x64", "--spp", "1000000")
        disk.fail(28, "/store/")
        farm.cli("priority", job, "--to", "2")
        bad = wait_for(lambda: (lambda a: a if a.status == 503 else None)(page.get("/readyz", token="")), "it to notice")
        expect(b"store cannot be used" in bad.body and farm.store.encode() not in bad.body, bad)
        told = page.get("/readyz")
        expect(told.status == 503 and farm.store.encode() in told.body, "with a token it says where")
        expect(page.get("/healthz", token="").status == 200, "it lives")
        expect(scrape(page).get("azulejo_store_usable") == 0, "the metric")
        disk.work()
        wait_for(lambda: page.get("/readyz", token="").status == 200, "it to recover", 60)
        expect(scrape(page).get("azulejo_store_usable") == 1, "the metric")


@tests.add
def dashboard():
    """every metric and label that the dashboard and the alerts name exists"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        now = scrape(page)
        known = set(now.types)
        for name, kind in now.types.items():
            if kind == "histogram":
                known |= {name + "_bucket", name + "_sum", name + "_count"}
        with open(os.path.join(ROOT, "deploy", "grafana", "azulejo.json"), encoding="utf-8") as source:
            board = json.load(source)
        expressions = [t["expr"] for p in board["panels"] for t in p.get("targets", [])]
        expect(len(expressions) >= 12, "panels")
        for path in sorted(glob.glob(os.path.join(ROOT, "deploy", "prometheus", "*.yml"))):
            with open(path, encoding="utf-8") as source:
                text = source.read()
            expressions += re.findall(r"^\s*expr: (.*)$", text, re.M)
        for expression in expressions:
            names = re.findall(r"azulejo_[a-z_]+", expression)
            expect(names, "no metric: " + expression)
            for name in names:
                expect(name in known, "%s is named by: %s" % (name, expression))
            for name, label, value in re.findall(r'(azulejo_[a-z_]+)\{([a-z]+)="([^"]*)"', expression):
                expect(any(dict(l).get(label) == value for l in now.of(name)), "%s{%s=%s}" % (name, label, value))
        alerts = re.findall(r"^\s*- alert: (\S+)$", open(os.path.join(ROOT, "deploy", "prometheus", "alerts.yml"),
                                                         encoding="utf-8").read(), re.M)
        expect(set(alerts) >= {"AzulejoDown", "AzulejoNoWorker", "AzulejoStoreUnusable", "AzulejoConflicts",
                               "AzulejoWorkerSilent", "AzulejoErrorStands"}, alerts)


tests.run()
