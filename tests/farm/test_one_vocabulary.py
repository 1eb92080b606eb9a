#!/usr/bin/env python3
"""Commands' JSON and the API's are one language: the same keys and the same values, for jobs and workers."""
import json

from farm import Failure, Farm, Tests, wait_for
from jobs import expect
from page import Page

tests = Tests()
MANY = ("--size", "64x48", "--region", "8,4,40,32", "--spp", "8", "--max-depth", "5", "--seed", "9007199254740993",
        "--camera", "0", "--env-rotate", "12.5", "--env-strength", "0.3", "--env-sampling", "uniform-only", "--isa", "sse2",
        "--sampler", "independent", "--light-choice", "power", "--texture-filter", "nearest", "--bvh-quality", "high",
        "--robust", "off", "--roulette", "off", "--clamp", "7.1", "--without", "caustics,normal-map", "--aov", "depth,normal",
        "--tonemap", "reinhard02", "--scale", "local", "--key", "0.2", "--exposure", "1.5", "--white-balance", "5000",
        "--temporal", "3", "--auto-exposure", "percentile", "--percentile", "97", "--format", "exr,png,jpg",
        "--png-bits", "16", "--jpeg-quality", "80", "--no-dither", "--half", "--target-error", "45dB", "--min-spp", "2",
        "--priority", "3", "--name", "many", "--frames", "1-2", "--shutter", "0.5", "--lens", "0.01", "--focus", "3")


def untold(answer):
    """Without the numbers of the messages, which are two."""
    if isinstance(answer, dict):
        return {k: untold(v) for k, v in answer.items() if k != "told"}
    return [untold(v) for v in answer] if isinstance(answer, list) else answer


def same(ours, theirs):
    """Both answers, asked until they are of the same moment."""
    def now():
        a, b = untold(ours()), untold(theirs())
        return a if a == b else None
    try:
        return wait_for(now, "equal answers", 5)
    except Failure:
        a, b = untold(ours()), untold(theirs())
        if isinstance(a, dict) and isinstance(b, dict):
            keys = {k: (a.get(k, "absent"), b.get(k, "absent")) for k in sorted(set(a) | set(b)) if a.get(k, "absent") != b.get(k, "absent")}
        else:
            keys = (a, b)
        raise Failure("commands and API differ: %s" % json.dumps(keys, indent=1))


def command(farm, *words):
    return farm.cli(*words, "--json", expect=0).json()


@tests.add
def jobs_and_workers():
    """show, list, workers, store and log print what the API answers"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        farm.start_worker()
        api = lambda path: page.get("/api/v1" + path).json()
        for number in (farm.submit(farm.scene(), *MANY), farm.submit(farm.scene(), "--size", "32x32", "--spp", "4")):
            farm.wait_for_job(number)
            wait_for(lambda: api("/jobs/%d" % number)["jobs"][0]["frames_developed"] > 0, "pictures")
            job = same(lambda: command(farm, "show", number), lambda: api("/jobs/%d" % number)["jobs"][0])
            work = job["work"]
            expect(0 < int(work["escaped_rays"]) <= int(work["samples"]), work)
            same(lambda: command(farm, "show", number, "--history"),
                 lambda: api("/jobs/%d/frames/%d/history" % (number, job["now_frame"])))
            same(lambda: [json.loads(line) for line in farm.cli("log", number, "--json", expect=0).out.splitlines()],
                 lambda: api("/jobs/%d/log" % number)["events"])
            missed = 9 if job.get("missed") else 0  # of its target: 8 samples are few
            same(lambda: farm.cli("watch", number, "--json", expect=missed).json(), lambda: api("/jobs/%d" % number)["jobs"][0])
        settings = command(farm, "show", 1)["settings"]
        expect(settings["sampler"] == "independent" and settings["without"] == ["normal-map", "caustics"] and
               settings["env_sampling"] == "uniform-only" and settings["seed"] == "9007199254740993", settings)
        # Settings that are not of one job only: a list has no bits of frames.
        same(lambda: command(farm, "list")["jobs"], lambda: api("/jobs")["jobs"])
        expect(command(farm, "list").keys() == api("/jobs").keys(), "the list's own keys")
        moving = ("connected_s", "status_age_s", "status", "samples_per_second", "core_seconds", "lines")
        still = lambda answer: dict(answer, workers=[{k: "" if k in moving else v for k, v in w.items()} for w in answer["workers"]])
        same(lambda: still(command(farm, "workers")), lambda: still(api("/workers")))
        name = command(farm, "workers")["workers"][0]["name"]
        same(lambda: still(command(farm, "workers", "show", name)), lambda: still(api("/workers/" + name)))
        same(lambda: command(farm, "show", "--farm").keys(), lambda: api("/store").keys())


@tests.add
def own_words_submit():
    """what show prints of a job's settings can be submitted again as it is"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        number = farm.submit(farm.scene(), *MANY)
        job = command(farm, "show", number)
        body = {key: job[key] for key in ("name", "scene", "settings", "output", "first_frame", "last_frame", "stop", "priority")}
        made = page.post("/api/v1/jobs", body).json()["job"]
        again = command(farm, "show", made)
        expect(all(again[key] == body[key] for key in body), again)
        wrong = page.post("/api/v1/jobs", dict(body, settings=dict(body["settings"], sampler="halton")))
        expect(wrong.status == 400 and "it may be sobol, independent" in wrong.body.decode(), wrong)


if __name__ == "__main__":
    tests.run()
