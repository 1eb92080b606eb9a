"""What effects and accuracy cost: bias apart from noise, effects left out by themselves, studies."""
import contextlib
import csv
import json
import math
import os
import pty
import re
import signal
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import BIN, ROOT, Farm, Failure, Tests, readable, wait_for
from png import Png

tests = Tests()
FEATURES = os.path.join(ROOT, "scenes", "features")
MIRROR = os.path.join(ROOT, "scenes", "cornell", "cornell-mirror.gltf")
CORNELL = os.path.join(ROOT, "scenes", "cornell", "cornell-area.gltf")


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def measured(farm, scene, *options):
    """The effects that were measured, by name."""
    out = farm.cli("effects", scene, "--measure", "--json", "--quiet", *options, expect=0).json()
    expect(out["measured"]["rounds"] == 4 and out["measured"]["core_seconds"] > 0, out["measured"])
    return {row["effect"]: row for row in out["effects"] if "bias_codes" in row}


@tests.add
def no_bias_from_noise():
    """a portal changes the noise alone: its bias is 0 within the interval; a sky that is off is a gross one"""
    with Farm() as farm:
        rows = measured(farm, os.path.join(FEATURES, "portal.pbrt"), "--size", "48x32", "--spp", "32")
        portal, sky = rows["portal"], rows["environment light"]
        expect(portal["differs"], portal)
        for figure in ("bias_codes", "bias_rms_codes"):
            value, low, high = portal[figure]
            expect(low == 0 and high > 0 and low <= value <= high, portal)
        # the picture is black without its sky: half of the pixels are above 60 of 255
        value, low, high = sky["bias_codes"]
        expect(60 < low < value < high <= 255, sky)
        expect(sky["mean_change"] == -1, sky)
        expect(sky["time_share"][1] > 0, sky)


@tests.add
def interrupted_measuring():
    """Ctrl-C on effects --measure keeps the rounds that are whole, and says that it was interrupted"""
    with Farm() as farm:
        master, slave = pty.openpty()  # on a terminal each round is shown, however short it is
        client = subprocess.Popen(farm.cli_argv("effects", os.path.join(FEATURES, "portal.pbrt"), "--measure",
                                                "--json", "--size", "48x32", "--spp", "96", "--threads", "1"),
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=slave,
                                  env=dict(os.environ, TERM="xterm"), cwd=farm.folder, start_new_session=True)
        os.close(slave)
        err = bytearray()
        while b"round 3" not in err:
            err += os.read(master, 4096)
        client.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # the terminal is gone with its last writer
            while True:
                err += os.read(master, 4096)
        out = client.communicate(timeout=120)[0]
        os.close(master)
        expect(client.returncode != 0 and b"interrupted" in err, (client.returncode, err))
        seen = json.loads(out)
        expect(seen["measured"]["rounds"] == 2, seen["measured"])
        expect(any("bias_codes" in row for row in seen["effects"]), seen)


def shown_change(farm, scene, *options, spp="128"):
    """95 % of the pixels change by at most so many codes."""
    pictures = []
    for more in ((), options):
        farm.cli("render", scene, "--size", "96x64", "--spp", spp, "-o", "shown.png", *more, expect=0)
        with open(farm.path("shown.png"), "rb") as source:
            pictures.append(Png(source.read()))
    worst = sorted(max(abs(a - b) for a, b in zip(p[3 * x:3 * x + 3], q[3 * x:3 * x + 3]))
                   for p, q in zip(pictures[0].codes, pictures[1].codes) for x in range(pictures[0].width))
    return worst[len(worst) * 95 // 100]


def thin_fog(farm):
    """The scene of fog with so little of it that nobody sees it; it still costs a third of the time."""
    with open(os.path.join(FEATURES, "fog.pbrt")) as source:
        lines = source.read().splitlines(keepends=True)
    expect("MakeNamedMedium" in lines[0], lines[0])
    lines[0] = ('MakeNamedMedium "haze" "string type" "homogeneous" "rgb sigma_a" [0 0 0] '
                '"rgb sigma_s" [1e-6 1e-6 1e-6] "float g" 0.4\n')
    with open(farm.path("thin-fog.pbrt"), "w") as out:
        out.writelines(lines)
    return farm.path("thin-fog.pbrt")


@tests.add
def auto_leaves_out_the_hidden():
    """--effects auto leaves out a fog too thin to see at 3/255, says so everywhere, and changes less than the target"""
    with Farm() as farm:
        scene = thin_fog(farm)
        farm.start_coordinator()
        farm.start_worker()
        result = farm.cli("submit", scene, "--size", "96x64", "--spp", "64", "--frames", "1-500", "--effects", "auto",
                          "--target-error", "3/255", expect=0)
        number = int(result.out)
        expect("left out" in result.err and "fog (" in result.err and "core-seconds" in result.err, result.err)
        expect("fog" in farm.job(number)["settings"]["without"], result.err)
        took, whole = map(float, re.search(r"measuring took (\S+) core-seconds; .* about (\S+)", result.err).groups())
        expect(took < 0.15 * whole, result.err)  # planned for a tenth, by what was known before
        farm.cli("cancel", number, expect=0)
        # A render that is too short for pilots keeps everything, and says so.
        result = farm.cli("render", scene, "--size", "96x64", "--spp", "64", "--effects", "auto", "--target-error",
                          "3/255", "-o", "short")
        expect("more than a tenth of the render" in result.err and "fog" in result.err, result.err)
        farm.cli("render", scene, "--size", "96x64", "--spp", "16", "--without", "fog", "--manifest", "-o", "auto", expect=0)
        expect(b"fog" in read_exr(farm.path("auto.exr")).attributes["azulejo:without"], "header")
        with open(farm.path("auto.effects.json")) as source:
            expect("fog" in json.dumps(json.load(source)["switched_off"]), "manifest")
        # What was left out shows at most a quarter of the target, by pilots with other numbers.
        row = measured(farm, scene, "--size", "48x32", "--spp", "64", "--seed", "99")["fog"]
        for figure in ("bias_codes", "bias_rms_codes"):
            expect(row[figure][1] < 0.75, row)
        # As shown, at equal random numbers: 95 % of the pixels are within the target of the full picture.
        expect(shown_change(farm, scene, "--without", "fog", spp="64") <= 3, "the target")


@tests.add
def auto_keeps_what_is_seen():
    """--effects auto keeps a sheen that shows, and a portal without which a sample is cheap but the target far"""
    with Farm() as farm:
        scene = os.path.join(FEATURES, "sheen.gltf")
        expect(shown_change(farm, scene, "--without", "sheen") > 3, "a sheen that shows")
        result = farm.cli("render", scene, "--size", "48x32", "--spp", "4", "--effects", "auto",
                          "--target-error", "3/255", "-o", "auto", "--json", expect=9)
        expect(result.json()["job"]["settings"]["without"] == [], result)
        expect("nothing is left out" in result.err and "core-seconds" in result.err, result.err)
        result = farm.cli("render", os.path.join(FEATURES, "portal.pbrt"), "--size", "48x32", "--spp", "4",
                          "--effects", "auto", "--target-error", "128/255", "-o", "auto", "--json", expect=0)
        expect(result.json()["job"]["settings"]["without"] == [], result)


@tests.add
def auto_on_a_farm():
    """submit measures on the farm itself; what the options lack is said before anything is rendered"""
    with Farm() as farm:
        for options, words in (
                (["--effects", "auto"], "--target-error 3/255"),
                (["--effects", "auto", "--target-error", "1%"], "--target-error 1%"),
                (["--effects", "auto", "--target-error", "0/255"], "a target of 0/255")):
            for command in ("render", "submit"):
                result = farm.cli(command, CORNELL, *options, connect=False, expect=2)
                expect(words in result.err, result)
        farm.start_coordinator()
        farm.start_worker()
        result = farm.cli("submit", CORNELL, "--size", "32x32", "--spp", "4", "--frames", "1-500", "--effects", "auto",
                          "--target-error", "2/255", expect=0)
        expect("nothing is left out" in result.err, result.err)
        expect(farm.job(int(result.out))["settings"]["without"] == [], result)
        farm.cli("cancel", int(result.out), expect=0)
        names = [job["name"] for job in farm.cli("list", "--json", expect=0).json()["jobs"]]
        expect(names.count("pilot") == 9 and "cornell-area" in names, names)


def study(farm, *options, scene=CORNELL, name="s", expected=0, limit_s=180):
    result = farm.cli("accuracy", scene, "--size", "32x32", "--threads", "1", "-o", name + ".html",
                      *options, expect=expected, limit_s=limit_s)
    with open(farm.path(name + ".json")) as source:
        return json.load(source), result


def choices_of(data):
    return {question["title"]: {choice["name"]: choice for choice in question["choices"]}
            for question in data["questions"]}


@tests.add
def quick_study():
    """a quick study of a tiny scene, end to end: what it finds, its page, and no noise called bias"""
    with Farm() as farm:
        data, result = study(farm, "--quick", "--minutes", "3", "--spp", "32",
                             "--target-error", "4/255")
        expect(data["complete"], result)
        points = data["points"]
        expect([p["samples"] for p in points] == [4, 8, 16, 32], points)
        for p, q in zip(points, points[1:]):
            expect(q["core_s"] > p["core_s"] and q["codes"][0] < p["codes"][0], points)
            expect(p["codes"][1] < p["codes"][0] < p["codes"][2] and p["rays"] > 0, p)
        expect(0.3 < data["fit"]["exponent"][0] < 1, data["fit"])
        expect(len(data["regions"]) == 2 and data["target_codes"] == 4, "regions")
        choices = choices_of(data)
        expect(choices["Sampler"]["Sobol"]["baseline"], choices["Sampler"])
        # Independent numbers, other light choices and no roulette have the same mean, and the pictures agree.
        for title, name in (("Sampler", "independent"), ("Choice of lights", "power"),
                            ("Choice of lights", "uniform"), ("Russian roulette", "off")):
            choice = choices[title][name]
            expect(choice["unbiased"] and not choice["missed"] and choice["floor"] == [0, 0, 0], (title, choice))
        expect(not choices["Path depth"]["1"]["unbiased"], choices["Path depth"]["1"])
        # The lamp off is grossly wrong, and one edge shows direct light alone.
        dark = choices["Effects left out"]["emissive mesh"]
        expect(dark["floor"][1] > 50, dark)
        expect(choices["Path depth"]["1"]["floor"][1] > 20, choices["Path depth"]["1"])
        half = choices["Bits of the picture"]["16"]
        expect(half["floor"][2] < 0.2, half)
        effect = {e["name"]: e for e in data["effects"]}["emissive mesh"]
        expect(effect["saved"][0] > 0 and effect["bias"] == dark["floor"], effect)
        with open(farm.path("s.html")) as page:
            text = page.read()
        expect("<svg" in text and "Path depth" in text and "never better than" in text, text[:500])
        expect("core-seconds" in result.out and "s.html" in result.out, result.out)
        for extension in ("csv", "json"):
            expect(os.path.getsize(farm.path("s." + extension)) > 100, extension)


@tests.add
def against_a_reference():
    """relMSE and FLIP against a reference fall with the samples, and stay below none; one of another size is refused"""
    with Farm() as farm:
        farm.cli("render", CORNELL, "--size", "32x32", "--spp", "512", "--seed", "9", "-o", "right.exr", expect=0)
        result = farm.cli("accuracy", CORNELL, "--size", "40x32", "--reference", "right.exr", "-o", "s.html", expect=3)
        expect("--reference right.exr has 32x32 pixels" in result.err and "--size 32x32" in result.err, result)
        data, result = study(farm, "--quick", "--spp", "32", "--minutes", "0.3", "--reference", "right.exr")
        expect(data["reference"] == "right.exr" and len(data["points"]) >= 3, data["points"])
        for p, q in zip(data["points"], data["points"][1:]):
            for figure in ("relmse", "flip"):
                expect(0 < q[figure][0] < p[figure][0] < 1, (figure, p, q))
                expect(p[figure][1] <= p[figure][0] <= p[figure][2], (figure, p))
            expect(p["seeds"][1] <= p["seeds"][0] <= p["seeds"][2], p)


@tests.add
def one_word():
    """a study calls an error reliable where `render` does so of both of its pictures, for the same reason"""
    glass = os.path.join(FEATURES, "fog.pbrt")  # few samples of it meet the lamp
    with Farm() as farm:
        def words(samples, first_seed, *options):
            told = [farm.cli("render", glass, "--size", "48x36", "--spp", str(samples), "--seed", str(seed),
                             "-o", "one", *options, expect=0).out for seed in (first_seed, first_seed + 1)]
            return {reason.split("; the RMSE")[0] for text in told
                    for reason in re.findall(r"^ +may be understated: (.*)$", text, re.M)}

        data, result = study(farm, "--quick", "--size", "48x36", "--spp", "32", "--minutes", "1", scene=glass)
        doubted = {}
        for point in data["points"]:
            doubted[point["samples"]] = reasons = words(int(point["samples"]), 0)
            expect(point["reliable"] == (not reasons), (point, reasons))
            expect(point["reason"] in (reasons or {None}), (point, reasons))
        expect(doubted[4] and not doubted[32], "the scene no longer shows both words: %s" % doubted)
        other = choices_of(data)["Sampler"]["independent"]["points"]
        for point in other:
            reasons = words(int(point["samples"]), 2, "--sampler", "independent")
            expect(point["reliable"] == (not reasons) and point["reason"] in (reasons or {None}),
                   (point, reasons))
        with open(farm.path("s.csv")) as source:
            rows = list(csv.DictReader(source))
        expect([int(row["reliable"]) for row in rows[:4]] == [p["reliable"] for p in data["points"]], rows[:4])
        with open(farm.path("s.html")) as page:
            text = page.read()
        expect("may be understated" in text and "noisy pixels have not been lit yet" in text, "the page")


@tests.add
def light_that_is_missed():
    """a sun that a way hardly ever finds is noise that its pictures do not show, not a bias; adaptive has its plot"""
    with Farm() as farm:
        sky = farm.path("sky.exr")
        subprocess.run([os.path.join(BIN, "scenes", "sky", "make_sky"), "--sun-azimuth", "325", "--size", "256x128",
                        "-o", sky], check=True,
                       stdout=subprocess.DEVNULL)
        data, result = study(farm, "--size", "40x40", "--env", sky, "--spp", "64", "--minutes", "5", scene=MIRROR,
                             limit_s=600)
        choices = choices_of(data)
        # Directions by the surfaces alone meet the sun about once in 100 000 samples.
        blind = choices["Environment sampling"]["BSDF"]
        expect(blind["unbiased"] and blind["missed"] and blind["floor"] == [0, 0, 0], blind)
        expect("have not met all of the light" in blind["note"], blind)
        expect(all(not p["reliable"] and p["reason"] == blind["note"] for p in blind["points"]), blind)
        expect(blind["gain"][2] < 1, blind["gain"])
        independent = choices["Sampler"]["independent"]
        expect(independent["unbiased"] and not independent["missed"], independent)
        expect(choices["Path depth"]["1"]["floor"][1] > 20, choices["Path depth"]["1"])
        # As good as the usual picture, by whatever samples that takes, and not the same for all tiles.
        adaptive, usual = choices["Adaptive sampling"]["adaptive"], data["points"]
        expect(choices["Adaptive sampling"]["uniform"]["baseline"] and adaptive["unbiased"], adaptive)
        last = adaptive["points"][-1]
        aimed = min(usual, key=lambda p: abs(math.log(p["codes"][0] / last["codes"][0])))
        expect(0.7 < last["codes"][0] / aimed["codes"][0] < 1.4, (last, usual))
        samples = data["tile_samples"]
        expect(samples["columns"] == samples["rows"] == 3, samples)
        expect(len(set(samples["values"])) > 1, samples)
        sides = (16, 16, 8)  # of the tiles in 40x40 pixels
        mean = sum(n * sides[k // 3] * sides[k % 3] for k, n in enumerate(samples["values"])) / 1600
        expect(abs(mean - last["samples"]) <= 0.02 * mean, (mean, last["samples"]))
        with open(farm.path("s.html")) as page:
            text = page.read()
        for words in ("Where adaptive sampling goes", "Few pixels or many?", "Half of the error sits in",
                      "at least", "have not met all of the light"):
            expect(words in text, words)
        tail = data["tail"]
        expect(tail["error"] == sorted(tail["error"]), tail)
        expect(abs(tail["error"][-1] - 1) < 1e-9 and tail["pixels"][-1] == 1, tail)


@tests.add
def study_goes_on():
    """Ctrl-C keeps what is measured; --continue measures the rest, and nothing twice; other scenes are refused"""
    with Farm() as farm:
        client = farm.start_cli("accuracy", CORNELL, "--size", "32x32", "--threads", "1", "--spp", "16",
                                "--quick", "-o", "s.html")

        def some_choices():
            try:
                with open(farm.path("s.json")) as source:
                    return len(json.load(source)["questions"]) >= 2
            except OSError:
                return False
        wait_for(some_choices, "the first choices")
        client.send_signal(signal.SIGINT)
        _, err = client.communicate(timeout=60)
        expect(client.returncode != 0 and b"--continue s.json" in err, err)
        with open(farm.path("s.json")) as source:
            before = json.load(source)
        expect(not before["complete"] and os.path.exists(farm.path("s.html")), before["complete"])
        for options, words in ((["--size", "40x32"], "--size 32x32"), (["--seed", "3"], "--seed 0")):
            result = farm.cli("accuracy", CORNELL, "--size", "32x32", *options, "--continue", "s.json",
                              expect=2)
            expect(words in result.err, result)
        result = farm.cli("accuracy", os.path.join(FEATURES, "glass.gltf"), "--size", "32x32",
                          "--continue", "s.json", expect=2)
        expect("cornell-area.gltf" in result.err, result)
        after, result = study(farm, "--quick", "--continue", "s.json")
        expect(after["complete"] and after["points"] == before["points"], result)
        for title, old in choices_of(before).items():
            for name, choice in old.items():
                expect(choices_of(after)[title][name] == choice, (title, name))


@tests.add
def study_on_a_farm():
    """--farm measures on the farm, and ends its jobs when it is interrupted"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        where = ["--farm", "--coordinator", farm.address, "--key", farm.key]
        result = farm.cli("accuracy", CORNELL, "--coordinator", farm.address, expect=2)
        expect("--farm" in result.err, result)
        client = farm.start_cli("accuracy", CORNELL, "--size", "64x64", "--minutes", "5", "-o",
                                "s.html", *where)
        wait_for(lambda: os.path.exists(farm.path("s.json")), "the first point")
        client.send_signal(signal.SIGINT)
        client.communicate(timeout=60)

        def all_over():
            jobs = farm.cli("list", "--json", expect=0).json()["jobs"]
            return all(job["state"] in ("done", "cancelled") for job in jobs)
        wait_for(all_over, "no job to be left")


@tests.add
def study_survives_its_workers():
    """a study on a farm goes on with the workers that are left; without any it says so, and waits for the next"""
    with Farm() as farm:
        farm.start_coordinator()
        workers = [farm.start_worker("--threads", "1") for _ in range(2)]

        def points():
            try:
                with open(farm.path("s.json")) as source:
                    return len(json.load(source)["points"])
            except OSError:
                return 0
        client = farm.start_cli("accuracy", CORNELL, "--size", "64x64", "--minutes", "1", "--spp", "64", "-o",
                                "s.html", "--farm", "--coordinator", farm.address, "--key", farm.key)
        wait_for(lambda: points() >= 1, "the first point")
        workers[0].kill()
        before = points()
        wait_for(lambda: points() > before, "a point by the worker that is left")
        workers[1].kill()
        said = b""
        while b"has no worker" not in said:
            expect(readable(client.stderr.fileno(), 60), "nothing is said: %s" % said)
            more = os.read(client.stderr.fileno(), 4096)
            expect(more, "the study ended without workers: %s" % said)
            said += more
        farm.start_worker("--threads", "1")
        before = points()
        wait_for(lambda: points() > before or client.poll() is not None, "a point by the new worker", 90)
        expect(client.poll() is None, "the study has ended: %s" % said)
        client.send_signal(signal.SIGINT)
        client.communicate(timeout=60)
        with open(farm.path("s.json")) as source:
            data = json.load(source)
        expect(data["points"] and not data["complete"], data["points"])
        expect(os.path.exists(farm.path("s.html")), "the page of what was measured")


if __name__ == "__main__":
    tests.run()
