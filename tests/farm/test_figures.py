"""How wrong a picture is: the same figures wherever they are reported, kept over restarts, and a word where
they cannot be trusted."""
import glob
import json
import math
import os
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import Farm, Tests, read_bytes, wait_for
from jobs import AREA, MIRROR, SPHERES, expect
from png import Png

tests = Tests()
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SCENES = os.path.join(ROOT, "tests", "accuracy", "scenes")
FEATURES = os.path.join(ROOT, "scenes", "features")
KEYS = {"azulejo:errorDisplay": "display", "azulejo:errorDisplayLow": "display_low",
        "azulejo:errorDisplayHigh": "display_high", "azulejo:errorPsnr": "psnr_db",
        "azulejo:errorRmsePercent": "rmse_percent", "azulejo:errorRmsePercentLow": "rmse_low",
        "azulejo:errorRmsePercentHigh": "rmse_high", "azulejo:errorTopShare": "top_share",
        "azulejo:errorDisplayAll": "display_all", "azulejo:errorWorstPart": "worst_part",
        "azulejo:errorFireflies": "fireflies", "azulejo:errorSubject": "subject"}


def listed(farm, number):
    return next(j for j in farm.cli("list", "--json", expect=0).json()["jobs"] if j["job"] == number)


def history_of(farm, number, *options):
    return farm.cli("show", number, "--history", "--json", *options, expect=0).json()["points"]


def header_text(picture, name):
    return picture.attributes[name].decode()


@tests.add
def tile_errors_are_a_layer():
    """--aov error: one number a tile, which together are the picture's error"""
    width, height = 60, 44
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(AREA, "--size", "%dx%d" % (width, height), "--spp", "16", "--aov", "error")
        farm.wait_for_job(number)
        psnr = farm.job(number)["now"]["figures"]["psnr_db"]
        picture = read_exr(next(f for f in farm.fetch(number) if f.endswith(".exr")))
        errors = picture.values("tileError.Y")
        tiles = {}
        for i, error in enumerate(errors):
            tiles.setdefault((i // width // 16, i % width // 16), set()).add(error)
        expect(len(tiles) == 12 and all(len(values) == 1 for values in tiles.values()), tiles)
        expect(len({value for values in tiles.values() for value in values}) > 6, tiles)
        # PSNR is of all channels, a tile's error of the largest of three.
        ratio = math.sqrt(sum(e * e for e in errors) / len(errors)) / (255 / 10 ** (psnr / 20))
        expect(1 <= ratio <= math.sqrt(3), ratio)


@tests.add
def the_figures_are_the_same_everywhere():
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(os.path.join(FEATURES, "metal.gltf"), "--size", "60x44", "--spp", "64",
                             "--exposure", "1")
        farm.wait_for_job(number)
        shown = farm.job(number)
        now, error = shown["now"], shown["now"]["figures"]
        expect(shown["now_frame"] == shown["first_frame"] and error["reliable"] and error["reasons"] == [], error)
        expect(0 < error["display_low"] < error["display"] < error["display_high"] < 255, error)
        expect(now["samples"] == 60 * 44 * 64, now)
        expect(listed(farm, number)["now"] == now, "list --json: %s" % listed(farm, number)["now"])
        history = history_of(farm, number)
        expect(history[-1] == now, "%s is not %s" % (history[-1], now))
        picture = read_exr(next(f for f in farm.fetch(number) if f.endswith(".exr")))
        for name, key in KEYS.items():
            expect(picture.number(name) == error[key],
                   "%s: %s, not %s" % (name, picture.number(name), error[key]))
        expect(header_text(picture, "azulejo:errorWord") == "reliable", picture.attributes)
        expect("reinhard" in header_text(picture, "azulejo:errorTransform") and
               "+1 EV" in header_text(picture, "azulejo:errorTransform"),
               picture.attributes["azulejo:errorTransform"])
        expect(shown["error_transform"] == header_text(picture, "azulejo:errorTransform"), error)
        # 1 / (codes^2 * core-seconds) of the only frame.
        expect(math.isclose(shown["efficiency"], 1 / (error["display"] ** 2 * now["core_seconds"]),
                            rel_tol=1e-5), shown["efficiency"])
        table = farm.cli("show", number, "--history", expect=0).out
        expect(len(table.splitlines()) == len(history) + 1, table)
        words = farm.cli("show", number, expect=0).out
        folder = farm.path("manifests")
        farm.cli("fetch", number, "-o", folder, "--manifest", expect=0)
        name = next(f for f in os.listdir(folder) if f.endswith(".effects.json"))
        with open(os.path.join(folder, name), encoding="utf-8") as file:
            written = json.load(file)["error"]
        expect(all(math.isclose(written[key], error[key], rel_tol=1e-8)
                   for key in ("display", "display_all", "worst_part", "fireflies", "subject")), written)
        expect("worst part" in words and "in 95 % of the pixels" in words and "reliable" in words and "efficiency" in words, words)


@tests.add
def figures_of_large_frames_are_of_a_sample():
    """while a large frame renders its figures are of some of its tiles, and come again and again; its last are of all"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(AREA, "--size", "800x450", "--spp", "4096")
        seen = {}

        def three_points():
            now = farm.job(number).get("now")
            if now:
                seen[now["samples"]] = now
            return len(seen) >= 3

        wait_for(three_points, "figures three times", 240)
        last = seen[max(seen)]
        farm.cli("cancel", number, expect=0)
        whole = farm.wait_for_job(number, "cancelled")["now"]
        growth = math.sqrt(whole["samples"] / last["samples"])
        sample, figures = last["figures"], whole["figures"]
        # The interval of N/255 is about as wide in both: most of it is what its law is known to be wrong by.
        expect(sample["rmse_high"] / sample["rmse_low"] > 1.1 * figures["rmse_high"] / figures["rmse_low"], (sample, figures))
        expect(sample["display_low"] / 1.3 < growth * figures["display"] < 1.3 * sample["display_high"], (sample, figures, growth))
        expect(abs(sample["subject"] - figures["subject"]) < 0.1, (sample, figures))


BACKDROP = """LookAt 0 1 5  0 1 0  0 1 0
Camera "perspective" "float fov" 40
Sampler "independent" "integer pixelsamples" 16
Film "rgb" "integer xresolution" 96 "integer yresolution" 64
WorldBegin
LightSource "infinite" "rgb L" [%s]
LightSource "distant" "point3 from" [2 5 3] "point3 to" [0 0 0] "rgb L" [3 3 3]
Material "diffuse" "rgb reflectance" [.6 .5 .4]
Translate 0 1 0
Shape "sphere" "float radius" .8
"""


@tests.add
def a_model_is_rated_without_its_backdrop():
    """a small model in front of a sky: its error is that of a picture that it fills; all pixels together have much less"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        path = farm.path("backdrop.pbrt")
        with open(path, "w", encoding="utf-8") as file:
            file.write(BACKDROP % ".3 .35 .4")
        errors = {}
        for name, options in (("whole", []), ("cut", ["--region", "36,20,24,24"])):
            number = farm.submit(path, "--size", "96x64", "--spp", "16", "--tonemap", "linear", *options)
            farm.wait_for_job(number)
            errors[name] = farm.job(number)["now"]["figures"]
        whole, cut = errors["whole"], errors["cut"]
        expect(whole["subject"] < 0.3 and cut["subject"] > 0.9, errors)
        expect(whole["display_all"] < 0.8 * whole["display"], whole)
        expect(math.isclose(whole["display"], cut["display"], rel_tol=0.25), errors)


@tests.add
def a_history_survives_the_coordinator():
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=1)
        number = farm.submit(os.path.join(FEATURES, "glass.gltf"), "--size", "96x72", "--spp", "4096")

        def points():
            return history_of(farm, number)

        wait_for(lambda: len(points()) >= 3, "three points of the history", 120)
        job = farm.job(number)
        expect(job["seconds_left"] > 0 and job["cores"] > 0 and job["forecasts"], job)
        expect(any(f["at_end"] for f in job["forecasts"]), job["forecasts"])
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.wait_for_workers(1)
        wait_for(lambda: len(points()) >= 3, "the history of before", 60)
        before = points()
        expect(before[0]["core_seconds"] > 0 and before[0]["figures"]["display"] > before[-1]["figures"]["display"], before)
        wait_for(lambda: points()[-1]["samples"] > before[-1]["samples"], "a point after the restart", 120)
        after = points()
        expect(after[:len(before) - 1] == before[:-1], "%s, not %s" % (after, before))
        expect(all(a["core_seconds"] < b["core_seconds"] and a["wall_seconds"] < b["wall_seconds"]
                   for a, b in zip(after, after[1:])), after)
        farm.cli("cancel", number, expect=0)
        job = farm.wait_for_job(number, "cancelled")
        expect(job["now"]["samples"] >= after[-1]["samples"], job["now"])


@tests.add
def a_time_limit_promises_what_it_keeps():
    """the milestone of a frame that a clock ends is the error that the picture has in the end"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(AREA, "--size", "160x120", "--time-limit", "20s")
        promised = {}

        def follow():
            job = farm.job(number)
            end = next((f for f in job.get("forecasts") or [] if f["at_end"]), None)
            if job["seconds_active"] > 6 and end and end["seconds"] > 0:
                promised[job["seconds_active"]] = end["display"]
            return job["state"] == "done"

        wait_for(follow, "the end", 120)
        figures = farm.job(number)["now"]["figures"]
        expect(promised, "no milestone")
        # The clock is sure; the error of half the work and the rate of the processors are not.
        expect(all(0.6 < error / figures["display"] < 1.6 for error in promised.values()), (promised, figures))


@tests.add
def what_may_be_understated_says_so():
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(os.path.join(SCENES, "glass-sun.pbrt"), "--size", "48x48", "--spp", "16")
        job = farm.wait_for_job(number)
        error = job["now"]["figures"]
        expect(error["reliable"] and "unseen" in error["reasons"] and "caustics" in job["error_effects"], error)
        words = farm.cli("show", number, expect=0).out
        expect("reliable; the RMSE may be understated: " in words and "caustics" in words, words)
        number = farm.submit(os.path.join(SCENES, "lamps-in-glass.pbrt"), "--size", "48x48", "--spp", "8")
        error = farm.wait_for_job(number)["now"]["figures"]
        expect(not error["reliable"] and "sparse" in error["reasons"], error)
        words = farm.cli("show", number, expect=0).out
        expect("may be understated: " in words and "have not been lit yet" in words, words)
        table = farm.cli("list", expect=0).out
        expect("/255?" in table, table)


@tests.add
def the_word_needs_no_map():
    """how bright a map is stands in the scene: the coordinator, which has the farm's key, decodes no picture that a client sent"""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker()
        sun, scene = farm.path("sun.pfm"), os.path.join(FEATURES, "glass.gltf")
        small = ["--size", "48x48", "--spp", "16", "--env", sun]
        with open(sun, "wb") as out:
            out.write(b"PF\n16 8\n-1.0\n" + struct.pack("<384f", *([0.1] * 192 + [1e5] * 3 + [0.1] * 189)))
        first = farm.submit(scene, *small)
        before = farm.wait_for_job(first)["now"]["figures"]
        expect(before["unseen"] > 0, before)
        worker.stop()
        second = farm.submit(scene, *small)
        for path in glob.glob(os.path.join(farm.store, "blobs", "??", "*")):
            if read_bytes(path) == read_bytes(sun):
                os.unlink(path)
        farm.start_worker(cache=farm.path("cache-1"))  # it has the map in its cache
        after = farm.wait_for_job(second)["now"]["figures"]
        expect(after == before, (before, after))


@tests.add
def the_level_of_light_does_not_change_relative_figures():
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        figures = []
        for strength, exposure in ((1, 0), (10000, -math.log2(10000))):
            number = farm.submit(os.path.join(SCENES, "soft-sky.pbrt"), "--size", "48x40", "--spp", "16",
                                 "--env-strength", strength, "--tonemap", "linear",
                                 "--exposure", "%.17g" % exposure)
            figures.append(farm.wait_for_job(number)["now"]["figures"])
        for key in ("display", "psnr_db", "rmse_percent", "rmse_low", "rmse_high"):
            expect(math.isclose(figures[0][key], figures[1][key], rel_tol=0.002),
                   "%s: %s and %s" % (key, figures[0][key], figures[1][key]))


@tests.add
def animations_tell_each_frame_the_worst_and_the_change():
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker(threads=2)
        number = farm.submit(os.path.join(FEATURES, "motion.gltf"), "--size", "48x32", "--spp", "16",
                             "--frames", "2-4")
        farm.wait_for_job(number)
        farm.coordinator.kill()
        farm.restart_coordinator()
        job = farm.job(number)
        each = {frame: history_of(farm, number, "--frame", frame)[-1]["figures"]["display"] for frame in (2, 3, 4)}
        worst = max(each, key=each.get)
        expect(job["worst_frame"] == worst, (job["worst"], each))
        expect(math.isclose(job["worst"], each[worst], rel_tol=1e-6), each)
        changes = {frame: math.hypot(each[frame], each[frame + 1]) for frame in (2, 3)}
        expect(math.isclose(job["flicker"], max(changes.values()), rel_tol=1e-6),
               (job["flicker"], changes))
        expect(job["flicker_frame"] == max(changes, key=changes.get), (job["flicker"], changes))


@tests.add
def flicker_is_what_neighbouring_frames_differ_by():
    """Where nothing moves all that changes from a frame to the next is noise: its 95 % quantile in display codes,
    measured in the pictures, is the flicker that is reported"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        cases = [(AREA, 64), (os.path.join(SCENES, "soft-sky.pbrt"), 64)]
        if os.environ.get("FLICKER_ALL"):  # the figures of docs/ACCURACY.md
            cases = [(scene, spp) for spp in (16, 64, 256)
                     for scene in (AREA, MIRROR, SPHERES, os.path.join(FEATURES, "glass.gltf"),
                                   os.path.join(SCENES, "soft-sky.pbrt"), os.path.join(SCENES, "glass-sun.pbrt"))]
        for scene, spp in cases:
            number = farm.submit(scene, "--size", "160x120", "--spp", spp, "--frames", "1-2", "--png-bits", "16",
                                 "--no-dither")
            job = farm.wait_for_job(number)
            told = job["flicker"]
            first, second = (Png(read_bytes(f)).codes for f in farm.fetch(number, str(number)) if f.endswith(".png"))
            changes = sorted(max(abs(a[3 * x + c] - b[3 * x + c]) for c in range(3)) / 257
                             for a, b in zip(first, second) for x in range(160))
            # Of the pixels that see the subject: the background does not change.
            changes = changes[int((1 - job["now"]["figures"]["subject"]) * len(changes)):]
            measured = changes[int(0.95 * len(changes))]
            print("# %s, %d spp: told %.3g, measured %.3g, ratio %.3f, %s" % (
                os.path.basename(scene), spp, told, measured, told / measured, "reliable" if job["now"]["figures"]["reliable"] else "may be understated"))
            expect(0.93 < told / measured < 1.07 or len(cases) > 2, "%s: told %g, measured %g" % (scene, told, measured))


@tests.add
def an_estimate_says_what_accuracy_costs():
    scene = os.path.join(FEATURES, "metal.gltf")
    with Farm() as farm:
        made = farm.cli("estimate", scene, "--size", "48x40", "--pilot-spp", "32", "--spp", "256", "--frames",
                        "1-6", "--price", "3600/core-hour", "--by", "12:00", "--json", connect=False,
                        expect=0).json()
        expect(made["pilot"]["settings"]["spp"] == 32 and made["frames"] == 6, made["pilot"])
        lasts = [pilot["points"][-1] for pilot in made["pilots"]]
        expect([pilot["frame"] for pilot in made["pilots"]] == [1, 3, 6], made["pilots"])
        last = max(lasts, key=lambda point: point["figures"]["display"])
        # Eight times the samples, six frames of which three were rendered; a core-second costs 1. The start counts once.
        expect(math.isclose(made["cap"]["core_seconds"], 6 / 3 * 8 * sum(p["core_seconds"] for p in lasts),
                            rel_tol=0.3), made["cap"])
        expect(made["job"] is None and made["command"] is None, "a job of a farm that is gone")
        expect(math.isclose(made["cap"]["price"], made["cap"]["core_seconds"], rel_tol=1e-9), made["cap"])
        expect(made["cap"]["display"] < last["figures"]["display"] and 0.25 <= made["exponent"] <= 1, made)
        costs = [row["core_seconds"] for row in made["curve"]]
        expect(costs == sorted(costs) and costs[0] > 0, costs)
        text = farm.cli("estimate", scene, "--size", "48x40", "--target-error", "40dB", "-q", connect=False,
                        expect=0).out
        expect("target 40" in text, text)
        for wrong in (["--price", "cheap"], ["--by", "25:00"], ["--by", "noon"]):
            result = farm.cli("estimate", scene, *wrong, connect=False, expect=2)
            expect(wrong[0] in result.err, result)


tests.run()
