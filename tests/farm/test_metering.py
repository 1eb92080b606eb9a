"""Two seeds have the same brightness, and a missed target is said in every place that shows a job."""
import os
import re
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Tests, read_bytes
from jobs import AREA, expect
from png import Png

tests = Tests()
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SCENES = os.path.join(ROOT, "tests", "accuracy", "scenes")
ROOM = os.path.join(SCENES, "room-window.pbrt")
SMALL = ("--size", "96x54")
LOOKS = ((), ("-t", "linear", "--auto-exposure", "key"))


def data(*names):
    """A file of AZULEJO_DATA; None without it."""
    path = os.path.join(os.environ.get("AZULEJO_DATA", "/nowhere"), *names)
    return path if os.path.exists(path) else None


def scenes():
    """A room with a window, a lamp in a bulb; with AZULEJO_DATA also objects under suns and lamps."""
    yield (ROOM,)
    yield (os.path.join(SCENES, "lamp-in-bulb.pbrt"),)
    for scene, light in ((("gltf", "DamagedHelmet", "DamagedHelmet.glb"), "kloppenheim_05_1k.hdr"),
                         (("gltf", "SheenChair", "SheenChair.gltf"), "circus_arena_1k.hdr"),
                         (("gltf", "ToyCar", "ToyCar.gltf"), "leadenhall_market_1k.hdr")):
        if data(*scene) and data("hdri", light):
            yield (data(*scene), "--env", data("hdri", light))


def codes_of(farm, picture, *look):
    farm.cli("tonemap", picture, "-o", "shown.png", "--bits", "16", "--no-dither", *look, expect=0)
    return [code / 257 for row in Png(read_bytes(farm.path("shown.png"))).codes for code in row]


@tests.add
def two_seeds_have_one_brightness():
    """64 samples a pixel, two seeds: the mean codes of the pictures are within 1, by default and with automatic exposure"""
    with Farm() as farm:
        for at, scene in enumerate(scenes()):
            pictures = []
            for seed in (1, 2):
                pictures.append(farm.path("%d-%d.exr" % (at, seed)))
                farm.cli("render", *scene, *SMALL, "-q", "--spp", "64", "--seed", seed, "--format", "exr", "-o",
                         pictures[-1], expect=0)
            for look in LOOKS:
                means = [sum(codes) / len(codes) for codes in (codes_of(farm, p, *look) for p in pictures)]
                expect(abs(means[0] - means[1]) < 1, "%s, %s: %s" % (scene, look, means))


@tests.add
def a_target_is_met_by_the_default_operator():
    """a dim room to 25/255: the picture is within 1.1 of that of a long one, and the command succeeds"""
    with Farm() as farm:
        farm.cli("render", ROOM, "--size", "64x36", "-q", "--spp", "1024", "--seed", "99", "--format", "exr", "-o", "long.exr",
                 expect=0)
        farm.cli("render", ROOM, "--size", "64x36", "-q", "--target-error", "25/255", "--spp", "1024", "--format", "exr", "-o",
                 "short.exr", expect=0)
        long, short = codes_of(farm, "long.exr"), codes_of(farm, "short.exr")
        apart = sorted(max(abs(long[i + c] - short[i + c]) for c in range(3)) for i in range(0, len(long), 3))
        error = apart[int(0.95 * (len(apart) - 1))]
        expect(error < 1.1 * 25, "%.1f/255" % error)


@tests.add
def a_missed_target_is_said_everywhere():
    """a cap on the samples below what a target needs: list, show, JSON and exit statuses of render and watch; extend mends it"""
    few = (AREA, "--size", "65x49", "--target-error", "8/255", "--spp", "8", "--min-spp", "8")
    with Farm() as farm:
        done = farm.cli("render", *few, "-o", "few", expect=9)
        expect(os.path.exists(farm.path("few.exr")) and os.path.exists(farm.path("few.png")), "no pictures")
        expect(re.search(r"target missed: [0-9.]+/255", done.err), done.err)
        expect("wrote" in done.out, done.out)
        job = farm.cli("render", *few, "--json", "-o", "few", expect=9).json()["job"]
        expect(job["missed"] > 1.1 * 8 and job["missed_frame"] == job["first_frame"], job["missed"])
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(*few)
        farm.wait_for_job(number)
        words = "target missed: %.2g/255" % farm.job(number)["missed"]
        expect(farm.job(number)["missed"] == job["missed"], "another figure")
        expect(farm.job(number)["missed"] == farm.job(number)["worst"], "not the frame's figure")
        for verb in ("list", "show"):
            expect(words in farm.cli(verb, *([number] if verb == "show" else []), expect=0).out, verb)
        expect(farm.job(number)["state_text"] == words, farm.job(number)["state_text"])
        expect(words in farm.cli("watch", number, "-q", expect=9).err, "watch")
        expect(words in farm.cli("fetch", number, "--follow", "-o", "followed/", expect=9).err, "fetch --follow")
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(farm.job(number)["state_text"] == words, "after a restart")
        farm.cli("extend", number, "--target-error", "7/255", "--spp", "4096", expect=0)
        farm.wait_for_job(number)
        met = farm.job(number)
        expect(met["missed"] == 0 and met["state_text"] == "", met["state_text"])
        expect([c["end"] for c in met["cut_frames"]] == ["target"], met["cut_frames"])
        farm.cli("watch", number, "-q", expect=0)


@tests.add
def frames_that_miss_are_named():
    """several frames, ended by the core limit: the worst of those that miss is named, and what ended it stays in `end`"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(AREA, "--size", "65x49", "--frames", "1-3", "--target-error", "0.5/255", "--core-limit", "0.4s")
        farm.wait_for_job(number)
        job = farm.job(number)
        expect(job["missed_frame"] == job["worst_frame"] and job["missed"] == job["worst"], job["missed"])
        expect(job["state_text"] == "target missed: frame %d has %.2g/255" % (job["missed_frame"], job["missed"]),
               job["state_text"])
        expect({c["end"] for c in job["cut_frames"]} == {"cores"}, job["cut_frames"])


@tests.add
def other_jobs_have_no_target_to_miss():
    """without a target nothing is missed; nor in a measure other than the one that is asked for"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        for options in (("--spp", "4"), ("--spp", "64", "--target-error", "10dB"), ("--spp", "64", "--target-error", "500%")):
            number = farm.submit(AREA, "--size", "65x49", *options)
            farm.wait_for_job(number)
            expect(farm.job(number)["missed"] == 0 and farm.job(number)["state_text"] == "", (options, farm.job(number)))
            farm.cli("watch", number, "-q", expect=0)
        number = farm.submit(AREA, "--size", "65x49", "--spp", "8", "--min-spp", "8", "--target-error", "60dB")
        farm.wait_for_job(number)
        job = farm.job(number)
        expect(10 < job["missed"] < 60 and abs(job["missed"] - job["now"]["figures"]["psnr_db"]) < 1e-3, job["missed"])
        expect(re.fullmatch(r"target missed: [0-9.]+dB", job["state_text"]), job["state_text"])


tests.run()
