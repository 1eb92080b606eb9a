"""The command line client from the outside: words, exit statuses, files, and a render for real."""
import json
import os
import re
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import threading

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import BIN, BUILD, ROOT, Farm, Failure, Tests, read_bytes, wait_for
from odd import Proxy

tests = Tests()
COMMANDS = ["render", "estimate", "import", "effects", "accuracy", "submit", "list", "show", "watch", "fetch",
            "develop", "cancel", "comment", "extend", "start", "pause", "resume", "finish",
            "priority", "retry", "remove", "log", "prune", "gc", "top", "workers", "token", "key", "keygen", "tonemap", "compare", "debug-pixel",
            "trace", "owners", "verify", "distrust", "completion"]
SMALL = ["--size", "32x32", "--spp", "4", "--max-depth", "3"]


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def children_of(pid):
    """Processes whose parent is pid."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open("/proc/%s/stat" % entry) as source:
                    fields = source.read().rsplit(")", 1)[1].split()
                if int(fields[1]) == pid and fields[0] != "Z":
                    found.append(int(entry))
            except (OSError, IndexError):
                pass
    return found


def gone(pid):
    try:
        with open("/proc/%d/stat" % pid) as source:
            return source.read().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True

def clamped_share(job):
    """Of the light."""
    lost, kept = job["work"]["clamped_luminance"], job["work"]["kept_luminance"]
    return lost / (lost + kept)


@tests.add
def help_everywhere():
    """every command's --help works and names the command"""
    with Farm() as farm:
        overview = farm.cli("--help", expect=0).out
        expect(farm.cli("help", expect=0).out == overview, "help is not --help")
        for command in COMMANDS:
            expect(re.search(r"^  %s\b" % command, overview, re.M), command + " is not listed")
            text = farm.cli(command, "--help", expect=0, connect=False)
            expect(text.out.startswith("usage: azulejo " + command), text)
            expect(text.err == "", text)
            expect(farm.cli(command, "-h", expect=0, connect=False).out == text.out, text)
        expect(re.match(r"azulejo \d+\.\d+\.\d+(-dev)?\n$", farm.cli("--version", expect=0).out), "version")
        listed = re.findall(r"^  ([a-z-]+)  ", overview, re.M)
        expect(sorted(listed) == sorted(COMMANDS), "a command is not tested: %s" % listed)


def options_of(text):
    return re.findall(r"^  (?:-., |    )--([a-z0-9-]+)", text, re.M)


@tests.add
def words_that_are_near():
    """of a word that is none of a verb's the message says which was meant, as of an unknown verb or option"""
    with Farm() as farm:
        picture = farm.path("x.exr")
        for words, meant in ((("tonemap", picture, "-o", "x.png", "--tonemap", "reinard02"), "reinhard02"), (("workers", "blok", "w"), "block"),
                             (("token", "creat"), "create"), (("key", "rovoke", "anna"), "revoke"),
                             (("shwo", "1"), "show"), (("list", "--nevest", "1"), "--newest")):
            result = farm.cli(*words, connect=False)
            expect(result.code in (2, 3) and ": did you mean %s?" % meant in result.err, result)
        result = farm.cli("workers", "quarantine", "w", connect=False)
        expect(result.code == 2 and "did you mean" not in result.err, result)


@tests.add
def help_fits():
    """help has no line over the terminal's width; --help of many options describes the usual ones and names the rest"""
    with Farm() as farm:
        for word in ("help", "--help"):
            for width in (50, 80, 132):
                text = farm.cli(word, expect=0, connect=False, env={"COLUMNS": str(width)}).out
                expect(all(len(line) <= width for line in text.splitlines()), (word, width, text))
        for command in COMMANDS:
            short, whole = ([farm.cli(*words, expect=0, connect=False, env={"COLUMNS": str(width)}).out
                             for width in (50, 80, 132)] for words in ((command, "--help"), ("help", command)))
            for width, text in zip((50, 80, 132) * 2, short + whole):
                # Words that are longer themselves stand on one line.
                long = [l for l in text.splitlines() if len(l) > width and " " in l.strip()]
                expect(not long, (command, width, long))
            expect(len({re.sub(r"(?<=\|)\s+|\s+(?=\|)", "", " ".join(text.split())) for text in whole}) == 1, "another text in another width: " + command)
            described, listed = options_of(short[1]), options_of(whole[1])
            named = re.findall(r"--([a-z0-9-]+)", short[1].split("\nmore options")[1]) if "\nmore options" in short[1] else []
            expect(set(described) | set(named) == set(listed) and len(set(listed)) == len(listed), command)
            expect(not set(described) & set(named), (command, described, named))
            if command in ("render", "submit"):
                expect(described[0] in ("output", "name") and len(short[1].splitlines()) < 90, short[1])


@tests.add
def slips():
    """a misspelt command or option is answered with the one that was meant; far ones with none"""
    with Farm() as farm:
        for words, meant in ((["rendr"], "render"), (["submti"], "submit"), (["lst"], "list"),
                             (["list", "--jsn"], "--json"), (["render", "x", "--target-eror=3/255"], "--target-error"),
                             (["help", "fetsh"], "fetch")):
            result = farm.cli(*words, connect=False)
            expect(result.code == 2 and "did you mean %s?" % meant in result.err, result)
        for words in (["photograph"], ["list", "--photograph"], ["render", "x", "-Z"]):
            result = farm.cli(*words, connect=False)
            expect(result.code == 2 and "did you mean" not in result.err, result)


@tests.add
def jobs_by_name():
    """every command that takes a job takes its name; a name of several jobs is refused with their numbers"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--name", "walk-1")
        farm.wait_for_job(number)
        for words in (["show"], ["watch"], ["fetch", "-o", "got"], ["log"], ["owners"], ["trace"],
                      ["develop", "-t", "aces", "-q"], ["extend", "--spp"]):
            for name, spp in (("walk-1", "16"), ("walk-?", "32")):
                farm.cli(words[0], name, *words[1:], *([spp] if words[0] == "extend" else []), expect=0)
        expect(os.path.exists(farm.path("got", "walk-1.exr")), os.listdir(farm.path("got")))
        result = farm.cli("show", "walk-2")
        expect(result.code == 5 and "no job is named 'walk-2'" in result.err, result)
        others = [farm.submit(farm.scene(), *SMALL, "--name", "walk-1") for _ in range(6)]
        result = farm.cli("show", "walk-1")
        expect(result.code == 2 and "7 jobs are named 'walk-1': give the number of one" in result.err and
               ", ".join(map(str, others[1:])) in result.err, result)


@tests.add
def bad_usage():
    """unknown commands, options and values exit with 2 and one line that helps"""
    with Farm() as farm:
        scene = farm.scene()
        cases = [[], ["nonsense"], ["--nonsense"], ["list", "--nonsense"], ["list", "extra"],
                 ["show"], ["show", ""], ["show", "0"], ["cancel", "-1"], ["resume"], ["pause", "--state", "x"], ["retry", "1", "--frames", "5-3"], ["priority", "1"],
                 ["log", "0"], ["extend", "0"], ["remove", "--frames", "1"], ["watch", "1", "2"],
                 ["render"], ["render", scene, "--spp", "0"], ["render", scene, "--spp", "many"],
                 ["render", scene, "--spp"], ["render", scene, "--size", "32"],
                 ["render", scene, "--frames", "5-1"], ["render", scene, "--tonemap", "nonsense"],
                 ["render", scene, "--tonemap-param", "nonsense=1"],
                 ["render", scene, "--tonemap-param", "x"], ["render", scene, "--isa", "mmx"],
                 ["render", scene, "--env-sampling", "guess"], ["render", scene, "--workers", "0"],
                 ["render", scene, "--camera", "nobody"], ["render", scene, scene],
                 ["submit", scene, "--env-strength", "-1"], ["submit", scene, "--priority", "1.5"],
                 ["keygen", "--role", "worker"], ["keygen", "--from", "x"],
                 ["keygen", "--role", "king", "--from", "x"], ["compare", "one"],
                 ["compare", "a", "b", "--max-relmse", "-1"], ["tonemap", "one"],
                 ["tonemap", "--list", "x"], ["develop"], ["develop", "0"],
                 ["develop", "1", "--tonemap", "nonsense"], ["develop", "1", "--format", "tif"],
                 ["develop", "1", "--no-wait", "-o", "x"], ["submit", scene, "--format", "exr,"],
                 ["render", scene, "-o", "x.png", "--format", "exr"], ["list", "--coordinator", "host:99999"],
                 ["list", "--timeout", "0"]]
        for case in cases:
            result = farm.cli(*case, connect=False) if case else \
                farm_run_bare(farm)
            expect(result.code == 2, result)
            if case:
                expect(result.err.startswith("azulejo") and result.err.count("\n") == 1 and
                       "--help" in result.err, result)
                expect(result.out == "", result)


def farm_run_bare(farm):
    done = subprocess.run([os.path.join(BIN, "azulejo")], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, cwd=farm.folder)

    class Bare:
        code, out, err = done.returncode, done.stdout.decode(), done.stderr.decode()
    expect("usage:" in Bare.out, Bare.out)
    return Bare


@tests.add
def readers_that_go_away():
    """output into a pipe that nothing reads ends quietly, like other tools; a full disk does not"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        for words in (["tonemap", "--list"], ["tonemap", "--list", "--json"], ["--help"], ["list"],
                      ["list", "--json"], ["show", number], ["show", number, "--json"],
                      ["submit", "--help"], ["effects", farm.scene()]):
            reader, writer = os.pipe()
            os.close(reader)
            done = subprocess.run(farm.cli_argv(*words), stdout=writer, stderr=subprocess.PIPE)
            os.close(writer)
            expect((done.returncode, done.stderr) == (141, b""), (words, done))
            with open("/dev/full", "wb") as full:
                done = subprocess.run(farm.cli_argv(*words), stdout=full, stderr=subprocess.PIPE)
            expect(done.returncode == 8, (words, done))


@tests.add
def nobody_there():
    """an unreachable coordinator exits with 4 and names host, port and remedy"""
    with Farm() as farm:
        holder = socket.socket()
        holder.bind(("127.0.0.1", 0))  # bound but not listening: refuses, and nobody else gets it
        address = "127.0.0.1:%d" % holder.getsockname()[1]
        for command in (["list"], ["workers"], ["show", "1"], ["watch", "1"], ["cancel", "1"],
                        ["fetch", "1"], ["develop", "1"], ["submit", farm.scene()]):
            result = farm.cli(*command, "--coordinator", address, "--key", farm.key)
            expect(result.code == 4, result)
            expect(address in result.err and "--coordinator" in result.err, result)
        result = farm.cli("list", env={"AZULEJO_COORDINATOR": address, "AZULEJO_KEY": farm.key})
        expect(result.code == 4 and address in result.err, result)
        result = farm.cli("list", "--coordinator", "no-such-host.invalid", "--key", farm.key)
        expect(result.code == 4 and "no-such-host.invalid" in result.err, result)
        holder.close()


@tests.add
def silent_peer():
    """a peer that accepts and says nothing ends with status 7 after --timeout"""
    with Farm() as farm:
        server = socket.socket()
        server.bind(("127.0.0.1", 0))
        server.listen(4)
        result = farm.cli("list", "--coordinator", "127.0.0.1:%d" % server.getsockname()[1],
                          "--key", farm.key, "--timeout", "0.2")
        expect(result.code == 7, result)
        server.close()


@tests.add
def garbage_peer():
    """a peer that is no coordinator is an error, not a hang or a crash"""
    with Farm() as farm:
        server = socket.socket()
        server.bind(("127.0.0.1", 0))
        server.listen(4)

        def talk():
            peer, _ = server.accept()
            peer.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" * 20)
            try:
                while peer.recv(4096):
                    pass
            except OSError:
                pass
            peer.close()
        thread = threading.Thread(target=talk)
        thread.start()
        result = farm.cli("list", "--coordinator", "127.0.0.1:%d" % server.getsockname()[1],
                          "--key", farm.key, "--timeout", "10")
        expect(result.code in (4, 5, 7), result)
        thread.join()
        server.close()


@tests.add
def keys():
    """keygen makes keys that only their owner can read, and derives the roles' from the farm's"""
    with Farm() as farm:
        mode = os.stat(farm.key).st_mode
        expect(stat.S_IMODE(mode) == 0o600, oct(mode))
        first, second = (farm.cli("keygen", expect=0).out for _ in range(2))
        expect("farm" in first and first != second, first)
        result = farm.cli("keygen", "-o", farm.key)
        expect(result.code == 8 and "farm.key" in result.err, result)  # never overwrites
        derived = [farm.cli("keygen", "--role", "worker", "--from", farm.key, expect=0).out
                   for _ in range(2)]
        expect(derived[0] == derived[1] and "worker" in derived[0], derived)
        role_key = farm.path("worker.key")
        farm.cli("keygen", "--role", "worker", "--from", farm.key, "-o", role_key, expect=0)
        expect(farm.cli("keygen", "--role", "client", "--from", role_key).code == 3, "not refused")
        expect(farm.cli("keygen", "--role", "client", "--from", farm.path("none")).code == 3, "none")
        for text in ("", "nonsense", "azulejo-key-1 farm 1234", "azulejo-key-1 farm " + "zz" * 32):
            with open(farm.path("bad.key"), "w") as out:
                out.write(text)
            result = farm.cli("list", "--key", farm.path("bad.key"))
            expect(result.code == 3 and "bad.key" in result.err, result)


@tests.add
def wrong_keys():
    """another farm's key is refused with status 5, and so is a worker's key"""
    with Farm() as farm:
        farm.start_coordinator()
        expect(farm.cli("list", expect=0).out.startswith("JOB"), "no table")
        other, worker, client = (farm.path(n) for n in ("other.key", "worker.key", "client.key"))
        farm.cli("keygen", "-o", other, expect=0)
        for role, path in (("worker", worker), ("client", client)):
            farm.cli("keygen", "--role", role, "--from", farm.key, "-o", path, expect=0)
        result = farm.cli("list", key=other)
        expect(result.code == 5 and farm.address in result.err, result)
        result = farm.cli("list", key=worker)
        expect(result.code == 5 and "client" in result.err, result)
        farm.cli("list", key=client, expect=0)


@tests.add
def bad_scenes():
    """a scene that is missing or damaged exits with 3 and names the file"""
    with Farm() as farm:
        broken = farm.path("broken.gltf")
        with open(broken, "w") as out:
            out.write("{ \"asset\": ")
        for command in ("import", "render", "submit"):
            for scene in (farm.path("missing.gltf"), broken, farm.folder):
                result = farm.cli(command, scene, "--coordinator", "127.0.0.1:1") \
                    if command == "submit" else farm.cli(command, scene)
                expect(result.code == 3 and os.path.basename(scene) in result.err, result)
        result = farm.cli("render", farm.scene(), "--env", farm.path("missing.exr"))
        expect(result.code == 3 and "missing.exr" in result.err, result)


@tests.add
def import_reports():
    """import prints a report, and the same as JSON"""
    with Farm() as farm:
        scene = farm.scene()
        expect(farm.cli("import", scene, expect=0).out.strip(), "nothing printed")
        expect(isinstance(farm.cli("import", scene, "--json", expect=0).json(), dict), "JSON")


@tests.add
def unwritable_outputs():
    """an output that cannot be written is found before anything is rendered"""
    with Farm() as farm:
        blocker = farm.path("file")
        with open(blocker, "w") as out:
            out.write("x")
        for target in (os.path.join(blocker, "sub", "pic"), "/proc/nowhere/pic.exr", "/proc/pic"):
            result = farm.cli("render", farm.scene(), *SMALL, "-o", target)
            expect(result.code == 8 and "rendered" not in result.out, result)
        farm.start_coordinator()
        result = farm.cli("fetch", "1", "-o", os.path.join(blocker, "sub"))
        expect(result.code == 8 and "file" in result.err, result)


@tests.add
def unknown_jobs():
    """a job that is not there exits with 5 and says so"""
    with Farm() as farm:
        farm.start_coordinator()
        for command in ("show", "watch", "fetch", "develop", "cancel", "resume", "pause", "finish",
                        "retry", "remove", "log"):
            result = farm.cli(command, "12345")
            expect(result.code == 5 and "12345" in result.err, result)
        expect(farm.cli("list", "--json", expect=0).json() == {"jobs": [], "older": 0, "states": []},
               "jobs")
        expect(farm.cli("workers", "--json", expect=0).json() == {"workers": [], "gone": [], "marks": []},
               "workers")


@tests.add
def render_for_real():
    """render writes both pictures, says so, and leaves nothing behind"""
    with Farm() as farm:
        temporary = farm.path("tmp")
        os.mkdir(temporary)
        env = {"TMPDIR": temporary}
        result = farm.cli("render", farm.scene(), *SMALL, "--workers", "2", "-o", "new/pic", env=env,
                          expect=0)
        expect("new/pic.exr" in result.out and "new/pic.png" in result.out, result)
        expect(read_bytes(farm.path("new/pic.exr"))[:4] == b"\x76\x2f\x31\x01", "no EXR")
        expect(read_bytes(farm.path("new/pic.png"))[:8] == b"\x89PNG\r\n\x1a\n", "no PNG")
        expect(sorted(os.listdir(farm.path("new"))) == ["pic.exr", "pic.png"], "other files")
        expect(os.listdir(temporary) == [], os.listdir(temporary))
        # Again, with one worker: the same bits.
        farm.cli("render", farm.scene(), *SMALL, "-o", "again.exr", "--quiet", env=env, expect=0)
        expect(not os.path.exists(farm.path("again.png")), "a PNG nobody asked for")
        farm.cli("compare", farm.path("new/pic.exr"), farm.path("again.exr"), expect=0)
        expect(farm.cli("compare", farm.path("new/pic.exr"), farm.path("again.exr"), "--json",
                        expect=0).json()["identical"], "not identical")
        # The lamp lights the floor: the picture is not black.
        json_result = farm.cli("render", farm.scene(), *SMALL, "--seed", "1", "-o", "other/",
                               "--json", env=env, expect=0).json()
        expect(json_result["job"]["state"] == "done", json_result)
        expect(json_result["job"]["work"]["samples"] == 32 * 32 * 4, json_result)
        expect(json_result["files"] == ["other/tiny.exr", "other/tiny.png"], json_result)
        # Other noise, but the same picture.
        result = farm.cli("compare", farm.path("other/tiny.exr"), farm.path("new/pic.exr"), "--json")
        figures = result.json()
        expect(result.code == 1 and not figures["identical"], result)
        expect(0 < figures["relative_mse"] < 0.5 and figures["max_absolute"] > 0, figures)
        farm.cli("compare", farm.path("other/tiny.exr"), farm.path("new/pic.exr"), "--max-relmse",
                 figures["relative_mse"] * 1.01, expect=0)
        farm.cli("compare", farm.path("other/tiny.exr"), farm.path("new/pic.exr"), "--max-relmse",
                 figures["relative_mse"] * 0.99, expect=1)


@tests.add
def tonemap_is_the_farms():
    """tonemap makes the same PNG as the farm, and another operator another"""
    with Farm() as farm:
        farm.cli("render", farm.scene(), *SMALL, "-o", "pic", "--exposure", "0.5", expect=0)
        exr = farm.path("pic.exr")
        farm.cli("tonemap", exr, "same.png", "--exposure", "0.5", expect=0)
        expect(read_bytes(farm.path("same.png")) == read_bytes(farm.path("pic.png")), "PNGs differ")
        operators = farm.cli("tonemap", "--list", "--json", expect=0).json()["operators"]
        text = farm.cli("tonemap", "--list", expect=0).out
        pictures = set()
        for operator in operators:
            expect(re.search("^%s$" % re.escape(operator["name"]), text, re.M), operator)
            options = []
            for p in operator["parameters"]:
                value = p["default"] if p["kind"] == "choice" else repr(p["default"])
                options += ["--tonemap-param", "%s=%s" % (p["name"], value)]
            if operator["file"] == "required":
                continue
            farm.cli("tonemap", exr, "plain.png", "-t", operator["name"], expect=0)
            farm.cli("tonemap", exr, "spelled.png", "-t", operator["name"], *options, expect=0)
            expect(read_bytes(farm.path("plain.png")) == read_bytes(farm.path("spelled.png")),
                   "defaults of %s" % operator["name"])
            pictures.add(read_bytes(farm.path("plain.png")))
            for p in operator["parameters"]:
                wrong = "nonsense" if p["kind"] == "choice" else \
                    repr(p["max"] + abs(p["max"]) + 1)
                result = farm.cli("tonemap", exr, "x.png", "-t", operator["name"], "-p",
                                  "%s=%s" % (p["name"], wrong))
                expect(result.code == 2 and p["name"] in result.err, result)
        expect(len(pictures) > 1, "all operators give the same picture")


@tests.add
def several_frames():
    """a range of frames is numbered, and each has other noise"""
    with Farm() as farm:
        farm.cli("render", farm.scene(), *SMALL, "--frames", "9-11", "-o", "anim/f.exr", expect=0)
        expect(sorted(os.listdir(farm.path("anim"))) == ["f-0009.exr", "f-0010.exr", "f-0011.exr"],
               os.listdir(farm.path("anim")))
        farm.cli("compare", "anim/f-0009.exr", "anim/f-0010.exr", expect=1)


@tests.add
def settings_of_a_job():
    """what a job asks for beyond the usual comes back in show, in words and in JSON"""
    with Farm() as farm:
        farm.start_coordinator()
        scene = farm.scene()
        plain = farm.submit(scene, *SMALL)
        shown = farm.cli("show", plain, expect=0).out
        expect(not re.search("  (motion|lens|without|aovs) ", shown), shown)
        settings = farm.job(plain)["settings"]
        expect((settings["fps"], settings["shutter"]) == (24, 0), settings)
        expect(settings["lens_radius"] == settings["focus_distance"] == 0 and not settings["pinhole"], settings)
        expect(settings["without"] == [] and settings["aovs"] == [], settings)
        choices = {"env_sampling": "learned", "sampler": "sobol", "light_choice": "learned",
                   "no_roulette": False, "texture_filter": "cone", "pixel_filter": "blackman-harris", "filter_width": 0, "bvh_quality": "medium",
                   "not_robust": False, "clamp": 0, "exr_names": "plain"}
        expect({name: settings[name] for name in choices} == choices, settings)
        expect(" choices " not in shown, shown)
        number = farm.submit(scene, *SMALL, "--fps", "25", "--shutter", "0.5", "--lens", "0.125",
                             "--focus", "2.5", "--without", "caustics,multiple-scattering",
                             "--without", "sheen")
        shown = farm.cli("show", number, expect=0).out
        for words in ("25 frames a second, shutter open for 0.5", "  lens        radius 0.125 m\n", "  focus       2.5 m\n",
                      "sheen,microfacet-multiple-scattering,caustics"):
            expect(words in shown, shown)
        settings = farm.job(number)["settings"]
        expect((settings["fps"], settings["shutter"], settings["lens_radius"],
                settings["focus_distance"]) == (25, 0.5, 0.125, 2.5), settings)
        expect(settings["without"] == ["sheen", "microfacet-multiple-scattering", "caustics"],
               settings)
        pinhole = farm.submit(scene, *SMALL, "--lens", "0")
        expect(farm.job(pinhole)["settings"]["pinhole"], "pinhole")
        expect("pinhole" in farm.cli("show", pinhole, expect=0).out, "pinhole")
        for words in (["--without", "nonsense"], ["--aov", "nonsense"], ["--lens", "1"],
                      ["--focus", "0"], ["--shutter", "1.5"], ["--fps", "0"]):
            result = farm.cli("submit", scene, *words)
            expect(result.code == 2 and words[0] in result.err, result)


@tests.add
def choices_of_a_job():
    """choices of algorithm come back in show and in the EXR; what clamping takes away is reported"""
    with Farm() as farm:
        scene = farm.scene()
        farm.cli("render", scene, *SMALL, "-o", "plain.exr", "--quiet", expect=0)
        plain = read_exr(farm.path("plain.exr"))
        expect(not [name for name in plain.attributes if name.startswith(("azulejo:clamp", "azulejo:sampler"))
                and name != "azulejo:clampedValues"],
               plain.attributes.keys())
        words = ["--sampler", "independent", "--light-choice", "power", "--roulette", "off",
                 "--texture-filter", "nearest", "--bvh-quality", "high", "--robust", "off",
                 "--env-sampling", "uniform-only", "--clamp", "0.25"]
        result = farm.cli("render", scene, *SMALL, *words, "-o", "pic.exr", expect=0)
        told = re.search(r"clamped +(\d+) samples were above 0.25 .* lacks ([\d.]+) %", result.out)
        expect(told, result.out)
        picture = read_exr(farm.path("pic.exr"))
        for name, value in (("sampler", "independent"), ("lightChoice", "power"),
                            ("roulette", "off"), ("textureFilter", "nearest"),
                            ("bvhQuality", "high"), ("robust", "off"),
                            ("envSampling", "uniform-only")):
            expect(picture.attributes["azulejo:" + name] == value.encode(), (name, picture.attributes))
        expect(picture.number("azulejo:clamp") == 0.25, "clamp")
        expect(picture.number("azulejo:clampedSamples") == int(told[1]) > 0, told[0])
        expect(abs(100 * picture.number("azulejo:clampedShare") - float(told[2])) < 0.05, told[0])
        expect(max(struct.unpack("<%df" % (32 * 32), picture.channels["R"])) <= 0.25, "brighter")
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(scene, *SMALL, *words)
        farm.wait_for_job(number)
        shown = farm.cli("show", number, expect=0).out
        expect("sampler independent, light choice power, roulette off, clamp 0.25, texture filter "
               "nearest, BVH quality high, robust off" in shown and told[0] in shown, shown)
        job = farm.job(number)
        expect((job["settings"]["clamp"], job["settings"]["no_roulette"], job["settings"]["not_robust"]) ==
               (0.25, True, True), job)
        expect(job["work"]["clamped_samples"] == int(told[1]), job)
        expect(abs(100 * clamped_share(job) - float(told[2])) < 0.05, job)
        for words in (["--sampler", "x"], ["--light-choice", "x"], ["--roulette", "maybe"],
                      ["--clamp", "-1"], ["--texture-filter", "x"], ["--robust", "x"]):
            result = farm.cli("submit", scene, *words)
            expect(result.code == 2 and words[0] in result.err, result)
        result = farm.cli("submit", scene, "--bvh-quality", "high")
        expect(result.code == 3 and "--robust off" in result.err, result)


@tests.add
def what_output_cannot_be():
    """-o of another format, a device or a pipe is refused with the remedy, and nothing is written beside it"""
    with Farm() as farm:
        scene = farm.scene()
        os.mkfifo(farm.path("pipe"))
        before = sorted(os.listdir(farm.folder))
        for out, why in (("pic.tiff", ".exr, .png or .jpg"), ("pic.HDR", ".exr, .png or .jpg"),
                         ("film.MP4", "--video"), ("pipe", "neither a file nor a folder"),
                         ("/dev/null", "neither a file nor a folder")):
            result = farm.cli("render", scene, *SMALL, "-o", out)
            expect(result.code == 2 and out in result.err and why in result.err, result)
        expect(sorted(os.listdir(farm.folder)) == before, os.listdir(farm.folder))
        farm.cli("render", scene, *SMALL, "-o", "scene.v2", "--quiet", expect=0)
        expect(os.path.exists(farm.path("scene.v2.exr")), "another dot is part of the name")


@tests.add
def words_that_reach_the_terminal():
    """a file's name does not speak to the terminal; help that cannot be written says so"""
    with Farm() as farm:
        result = farm.cli("render", "a\033[31mb.gltf", "-o", "x")
        expect(result.code == 3 and "\033" not in result.err and "a?[31mb.gltf" in result.err, result)
        for word in ("--help", "--version"):
            with open("/dev/full", "wb") as full:
                done = subprocess.run(farm.cli_argv(word), stdout=full, stderr=subprocess.PIPE)
            expect(done.returncode == 8 and b"standard output" in done.stderr, done)


@tests.add
def default_size_and_camera():
    """the size follows the camera's aspect, cameras go by name or number"""
    with Farm() as farm:
        options = ["--spp", "1", "--max-depth", "0", "--json", "-o"]
        job = farm.cli("render", farm.scene(), *options, "a.exr", expect=0).json()["job"]
        settings = job["settings"]
        expect((settings["width"], settings["height"]) == (1080, 720), settings)
        for camera in ("side", "0"):
            farm.cli("render", farm.scene(), *SMALL, "--camera", camera, "-o", "b.exr", expect=0)
        result = farm.cli("render", farm.scene(), "--camera", "1")
        expect(result.code == 2 and "side" in result.err, result)


@tests.add
def interrupted_render():
    """Ctrl-C ends a local render: status 130, no process and no folder left"""
    with Farm() as farm:
        temporary = farm.path("tmp")
        os.mkdir(temporary)
        client = farm.start_cli("render", farm.scene(), "--size", "512x512", "--spp", "1000000",
                                "--workers", "2", "-o", "pic", env={"TMPDIR": temporary})
        try:
            programs = wait_for(lambda: (lambda c: c if len(c) == 3 else None)(
                children_of(client.pid)), "the coordinator and two workers")
            client.send_signal(signal.SIGINT)
            out, err = client.communicate(timeout=60)
        finally:
            client.kill()
            client.wait()
        expect(client.returncode == 130, (client.returncode, out, err))
        wait_for(lambda: all(gone(p) for p in programs), "the programs to end")
        expect(os.listdir(temporary) == [], os.listdir(temporary))


@tests.add
def killed_render():
    """the programs of a local render die with it, even by SIGKILL"""
    with Farm() as farm:
        client = farm.start_cli("render", farm.scene(), "--size", "512x512", "--spp", "1000000",
                                "-o", "pic", env={"TMPDIR": farm.folder})
        try:
            programs = wait_for(lambda: (lambda c: c if len(c) == 2 else None)(
                children_of(client.pid)), "the coordinator and a worker")
        finally:
            client.kill()
            client.communicate()
        wait_for(lambda: all(gone(p) for p in programs), "the programs to die")


@tests.add
def dying_programs():
    """a local program that ends early is reported with its words"""
    with Farm() as farm:
        for victim in ("azulejo-coordinator", "azulejo-worker"):
            client = farm.start_cli("render", farm.scene(), "--size", "512x512", "--spp", "1000000",
                                    "-o", "pic", env={"TMPDIR": farm.folder})
            try:
                def find():
                    for pid in children_of(client.pid):
                        try:
                            with open("/proc/%d/cmdline" % pid, "rb") as source:
                                name = source.read().split(b"\0")[0].decode()
                        except OSError:
                            continue
                        if os.path.basename(name) == victim and len(children_of(client.pid)) == 2:
                            return pid
                    return None
                os.kill(wait_for(find, victim), signal.SIGKILL)
                out, err = client.communicate(timeout=60)
            finally:
                client.kill()
                client.wait()
            expect(client.returncode == 6, (client.returncode, out, err))
            words = victim.replace("azulejo-", "")
            expect(words in err.decode() and "signal 9" in err.decode(), err)
        # One of two workers: the other takes over, and the job ends well.
        client = farm.start_cli("render", farm.scene(), "--size", "256x256", "--spp", "64",
                                "--workers", "2", "--threads", "1", "-o", "pic.exr",
                                env={"TMPDIR": farm.folder})
        try:
            workers = wait_for(lambda: (lambda c: c if len(c) == 3 else None)(
                children_of(client.pid)), "two workers")
            os.kill(max(workers), signal.SIGKILL)
            out, err = client.communicate(timeout=300)
        finally:
            client.kill()
            client.wait()
        expect(client.returncode == 0, (client.returncode, out, err))
        farm.cli("render", farm.scene(), "--size", "256x256", "--spp", "64", "-o", "whole.exr",
                 expect=0)
        farm.cli("compare", "pic.exr", "whole.exr", expect=0)


@tests.add
def a_job_on_a_farm():
    """submit, list, show, watch, fetch and cancel work on a farm, in words and in JSON"""
    with Farm() as farm:
        farm.start_coordinator()
        scene = farm.scene()
        number = farm.submit(scene, *SMALL, "-o", "first", "--frames", "1-2", "--half")
        job = farm.job(number)
        expect(job["state"] in ("queued", "running") and job["name"] == "first", job)
        expect(job["output"]["exr_half"] is True and job["last_frame"] == 2, job)
        result = farm.cli("fetch", number)
        expect(result.code == 5, result)  # nothing is there yet
        result = farm.cli("watch", number, "--limit", "0.3")
        expect(result.code == 7, result)  # no worker: it waits
        farm.start_worker()
        result = farm.cli("watch", number, expect=0)
        expect("done" in result.out and "2 of 2" in result.out, result)
        expect(farm.cli("watch", number, "--json", expect=0).json()["state"] == "done", "watch")
        expect("first" in farm.cli("list", expect=0).out, "list")
        expect([j["job"] for j in farm.cli("list", "--json", expect=0).json()["jobs"]] == [number],
               "list")
        expect("32 x 32" in farm.cli("show", number, expect=0).out, "show")
        files = farm.fetch(number)
        expect(len(files) == 4 and all(os.path.getsize(f) > 100 for f in files), files)
        only = farm.cli("fetch", number, "--frames", "2", "-o", "two", "--json", expect=0).json()
        expect(len(only["files"]) == 2, only)
        expect(farm.cli("fetch", number, "--frames", "3").code == 2, "frame 3")
        workers = farm.list_workers()
        expect(len(workers) == 1 and workers[0]["threads"] == 1, workers)
        expect(workers[0]["host"] in farm.cli("workers", expect=0).out, "workers")
        # Watched and submitted in one go; the scene is there already.
        result = farm.cli("submit", scene, *SMALL, "--watch", "--json", expect=0)
        expect(result.json()["state"] == "done", result)


@tests.add
def fetching_into_one_folder():
    """no job overwrites another's files, whatever they are called; fetching again changes nothing"""
    def contents(folder):
        return {f: read_bytes(os.path.join(folder, f)) for f in os.listdir(folder)
                if not f.startswith(".")}

    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = farm.scene()
        longest = "\u00e9" * 127 + "x"  # 255 bytes
        first, second = [farm.submit(scene, *SMALL, "-o", "shot", "--seed", seed)
                         for seed in (1, 2)]
        cut, twin = [farm.submit(scene, *SMALL, "-o", longest[:-1] + end, "--frames", "7-8")
                     for end in "xy"]
        third = farm.submit(scene, *SMALL, "-o", "shot", "--format", "png")
        for number in (first, second, cut, twin, third):
            farm.wait_for_job(number)
        folder = farm.path("all")
        farm.cli("fetch", first, "-o", folder, "--manifest", expect=0)
        before = contents(folder)
        expect(sorted(before) == ["shot.effects.json", "shot.exr", "shot.png"], before.keys())
        result = farm.cli("fetch", second, "-o", folder, expect=0)
        expect("shot-job2" in result.err and "--force" in result.err, result)
        both = contents(folder)
        expect(dict(both, **before) == both, "the first job's files were changed")
        expect(both["shot-job2.exr"] != both["shot.exr"], "the second job's picture")
        # Again, in any order, and with other pictures: each has its own.
        farm.cli("fetch", second, "-o", folder, expect=0)
        farm.cli("fetch", first, "-o", folder, "--manifest", expect=0)
        expect(contents(folder) == both, "fetching again is not the same")
        for number in (first, second):
            farm.cli("develop", number, "--tonemap", "linear", "-o", folder, expect=0)
        now = contents(folder)
        expect(sorted(now) == sorted(both) and now["shot.png"] != both["shot.png"], now.keys())
        farm.cli("fetch", third, "-o", folder, expect=0)
        farm.cli("fetch", third, "-o", folder, "--force", expect=0)
        expect(contents(folder)["shot.png"] == contents(folder)["shot-job%d.png" % third], "force")
        # At the same time: one chooses its names after the other.
        together = [farm.start_cli("fetch", n, "-o", "race") for n in (first, second, third) * 3]
        for fetch in together:
            out, err = fetch.communicate(timeout=120)
            expect(fetch.returncode == 0, err)
        expect(len(contents(farm.path("race"))) == 5, os.listdir(farm.path("race")))
        # What render left there is not overwritten either.
        farm.cli("render", scene, *SMALL, "-o", os.path.join(folder, "mine"), expect=0)
        mine = read_bytes(os.path.join(folder, "mine.exr"))
        number = farm.submit(scene, *SMALL, "-o", "mine", "--seed", 5)
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", folder, expect=0)
        expect(read_bytes(os.path.join(folder, "mine.exr")) == mine, "render's picture")
        # Names as long as a job's may be, the same up to the last byte.
        files = [f for n in (cut, twin) for f in farm.cli(
            "fetch", n, "-o", folder, "--json", expect=0).json()["files"]]
        expect(len(set(files)) == 8 and all(os.path.exists(f) for f in files), files)
        expect(all(re.search(r"-000[78]\.(exr|png)$", f) for f in files), files)


@tests.add
def fetching_a_part():
    """a fetch that lacks frames or files ends with status 9 and keeps what it got"""
    with Farm() as farm:
        farm.start_coordinator()
        scene = farm.scene()
        number = farm.submit(scene, *SMALL, "-o", "part", "--frames", "1-3")
        farm.start_worker()
        farm.wait_for_job(number)
        stored = farm.path("store", "outputs", str(number))
        os.unlink(os.path.join(stored, "frame-0002.png"))
        result = farm.cli("fetch", number, "-o", "there", expect=9)
        expect("frame 2" in result.err and "1 file could not be fetched" in result.err, result)
        expect(sum(f.startswith("part-") for f in os.listdir(farm.path("there"))) == 5, result)
        told = farm.cli("fetch", number, "-o", "there", "--json", expect=9).json()
        expect(len(told["files"]) == 5 and [(m["frame"], m["file"]) for m in told["missing"]] ==
               [(2, "png")], told)
        os.unlink(os.path.join(stored, "frame-0002.exr"))
        farm.cli("fetch", number, "--frames", 2, "-o", "there", expect=5)  # nothing at all
        # A job that goes on: the frames that are finished come, and the status tells.
        farm.workers[0].kill()
        running = farm.submit(scene, "--size", "160x160", "--spp", "128", "-o", "on",
                              "--frames", "1-50")
        farm.start_worker()
        wait_for(lambda: farm.job(running)["frames_done"] > 0, "a frame")
        result = farm.cli("fetch", running, "-o", "on", expect=9)
        expect("not rendered yet" in result.err, result)
        expect(os.path.exists(farm.path("on", "on-0001.exr")), result)
        # The frame in work, as a picture and as light; nothing is fetched for a name that is neither.
        wait_for(lambda: farm.job(running)["preview_ready"], "a preview")
        for name in ("x.jpg", "x", "x.exr.txt"):
            result = farm.cli("fetch", running, "--preview", name, expect=2)
            expect(".exr" in result.err and not os.path.exists(farm.path(name)), result)
        farm.cli("fetch", running, "--preview", "x.png", expect=0)
        expect(read_bytes(farm.path("x.png"))[:4] == b"\x89PNG", "no PNG")
        farm.cli("fetch", running, "--preview", "x.exr", expect=0)
        preview = read_exr(farm.path("x.exr"))
        expect((preview.width, preview.height) == (160, 160), "the preview's size")
        samples = struct.unpack("<d", preview.attributes["azulejo:samples"])[0]
        expect(0 < samples <= 160 * 160 * 128, samples)  # all of them between its last unit and its end
        farm.cli("cancel", running, expect=0)


@tests.add
def lists_on_a_terminal():
    """on a terminal of 80 columns list cuts names instead of breaking lines; in a pipe it does not"""
    import fcntl
    import pty
    import termios
    with Farm() as farm:
        farm.start_coordinator()
        name = "a-name-as-long-as-people-give-\u00e9\u00e9\u00e9\u00e9-shot-0040-v012"
        farm.submit(farm.scene(), *SMALL, "-o", name, "--frames", "1-100000", "--force")  # however small the disk is
        expect(name in farm.cli("list", expect=0).out, "a pipe")
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("4H", 24, 80, 0, 0))
        subprocess.run(farm.cli_argv("list"), stdout=slave, check=True, timeout=60)
        lines = os.read(master, 65536).decode().splitlines()
        os.close(slave)
        os.close(master)
        expect(len(lines) == 3 and all(len(line) <= 80 for line in lines), lines)
        expect(lines[2] == "     waits: no worker is connected", lines)
        expect("a-name-" in lines[1] and ".." in lines[1] and "100000" in lines[1], lines)


@tests.add
def lists_of_many_jobs():
    """list shows every job, in pages of 1,000; --newest leaves old ones out and says how many"""
    with Farm() as farm:
        farm.start_coordinator()
        active = farm.submit(farm.scene(), *SMALL)
        ended = farm.submit(farm.scene(), *SMALL)
        farm.cli("cancel", ended, expect=0)
        farm.coordinator.stop()
        # 3,000 more like the one that has ended, as years of use would leave them.

        def add_jobs(store):
            columns = ", ".join(row[1] for row in store.execute("PRAGMA table_info(jobs)") if row[1] not in ("id", "token"))
            store.executemany("INSERT INTO jobs (%s) SELECT %s FROM jobs WHERE id=?" % (columns, columns), [(ended, )] * 3000)

        farm.edit_store(add_jobs)
        farm.restart_coordinator()
        shown = farm.cli("list", "--json", expect=0).json()
        expect([job["job"] for job in shown["jobs"]] == list(range(1, 3003)), len(shown["jobs"]))
        expect(shown["older"] == 0, shown["older"])
        result = farm.cli("list", expect=0)
        expect(result.out.count("\n") == 3003 and result.err == "", result.err)
        shown = farm.cli("list", "--newest", "1500", "--json", expect=0).json()
        numbers = [job["job"] for job in shown["jobs"]]
        expect(numbers == [active] + list(range(1503, 3003)), (numbers[:3], len(numbers)))
        expect(shown["older"] == 1501, shown["older"])
        result = farm.cli("list", "-n", "2", expect=0)
        expect(result.out.count("\n") == 4 and "2999 older" in result.err, result)
        shown = farm.cli("list", "--state", "queued,running", "--mine", "--json", expect=0).json()
        expect([job["job"] for job in shown["jobs"]] == [active], shown)
        expect(farm.cli("list", "--state", "failed", expect=0).out.count("\n") == 1, "none failed")
        farm.cli("list", "--state", "asleep", expect=2)
        farm.cli("list", "--mine", "--newest", "1", expect=2)


@tests.add
def shares_of_the_effects():
    """a frame's manifest says how the time is shared among its effects, on a farm and alone"""
    def check(manifest, words):
        looks, none = manifest["time"]["looks"], manifest["time"]["no_effect"]
        shares = {row["effect"]: row.get("share") for row in manifest["ran"]}
        for effect in ("instancing", "back-face culling"):  # they have no time of their own
            expect(shares.pop(effect, None) is None, shares)
        # A frame of two seconds or more, at a hundred looks a second.
        expect(looks >= 100, (words, looks))
        expect(all(0 <= share <= 1 for share in shares.values()), (words, shares))
        expect(abs(sum(shares.values()) + none - 1) < 1e-3, (words, shares, none))
        expect(not any("share" in row for row in manifest["switched_off"]), words)
        return shares

    options = ["--size", "192x144", "--spp", "48"]
    with Farm() as farm:
        fog = os.path.join(ROOT, "scenes/features/fog.pbrt")
        farm.start_coordinator()
        farm.start_worker("--threads", "1")
        number = farm.submit(fog, *options)
        farm.wait_for_job(number)
        shares = check(farm.cli("show", number, "--effects", "--json", expect=0).json(), "fog")
        # About a quarter of the time; a tenth would be many standard errors off.
        expect(shares["fog"] > 0.1 and "texture" not in shares, shares)
        words = farm.cli("show", number, "--effects", expect=0).out
        expect(re.search(r"^EFFECT +SHARE +CALLED FOR BY$", words, re.M), words)
        expect(re.search(r"^fog +[0-9.]+ % +medium", words, re.M), words)
        expect(re.search(r"^\(none of them\) +[0-9.]+ % ", words, re.M), words)
        expect(re.search(r"^instancing +- +mesh", words, re.M), words)
    with Farm() as farm:
        farm.cli("render", os.path.join(ROOT, "scenes/features/clearcoat.gltf"), *options,
                 "--without", "clearcoat", "--manifest", "-o", "coat", expect=0)
        with open(farm.path("coat.effects.json")) as file:
            manifest = json.load(file)
        shares = check(manifest, "coat")
        expect("clearcoat" not in shares and shares["emissive mesh"] > 0.05, shares)
        expect([row["effect"] for row in manifest["switched_off"]] == ["clearcoat"], manifest)


@tests.add
def cancelling():
    """a cancelled job ends watch with status 6; a detached watch leaves its job alone"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "512x512", "--spp", "1000000")
        farm.wait_for_job(number, "running")
        wait_for(lambda: farm.job(number)["preview_ready"], "a preview")
        preview = farm.path("preview.png")
        farm.cli("fetch", number, "--preview", preview, expect=0)
        expect(read_bytes(preview)[:4] == b"\x89PNG", "no PNG")
        watcher = farm.start_cli("watch", number)
        try:
            wait_for(lambda: catches_signals(watcher.pid), "the watcher to catch signals")
            watcher.send_signal(signal.SIGINT)
            out, err = watcher.communicate(timeout=60)
        finally:
            watcher.kill()
            watcher.wait()
        expect(watcher.returncode == 130 and b"continues" in err, (watcher.returncode, out, err))
        expect(farm.job(number)["state"] == "running", "it does not go on")
        watcher = farm.start_cli("watch", number)
        try:
            wait_for(lambda: catches_signals(watcher.pid), "the watcher")
            expect("cancelled" in farm.cli("cancel", number, expect=0).out, "cancel")
            out, err = watcher.communicate(timeout=60)
        finally:
            watcher.kill()
            watcher.wait()
        expect(watcher.returncode == 6 and b"cancelled" in err, (watcher.returncode, out, err))
        expect(farm.job(number)["state"] == "cancelled", "state")


def catches_signals(pid):
    """Does the process have a handler for SIGINT?"""
    with open("/proc/%d/status" % pid) as source:
        caught = int(re.search(r"SigCgt:\s*([0-9a-f]+)", source.read()).group(1), 16)
    return bool(caught >> (signal.SIGINT - 1) & 1)


@tests.add
def coordinator_goes_away():
    """watch outlives a coordinator that is killed and started again; with --reconnect 0 it ends with 4"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "256x256", "--spp", "64", "-o", "survivor")
        farm.wait_for_job(number, "running")
        patient, hasty, short = watchers = [
            farm.start_cli("watch", number, *options)
            for options in ([], ["--reconnect", "0"], ["--limit", "3"])]
        stopped = farm.start_cli("watch", number)
        try:
            for watcher in watchers + [stopped]:
                wait_for(lambda: catches_signals(watcher.pid), "the watcher")
            farm.coordinator.kill()
            out, err = hasty.communicate(timeout=60)
            expect(hasty.returncode == 4 and farm.address.encode() in err,
                   (hasty.returncode, out, err))
            out, err = short.communicate(timeout=60)
            expect(short.returncode == 7 and b"3 seconds" in err, (short.returncode, out, err))
            stopped.send_signal(signal.SIGINT)
            out, err = stopped.communicate(timeout=60)
            expect(stopped.returncode == 130 and b"continues" in err, (stopped.returncode, out, err))
            farm.restart_coordinator()
            job = farm.wait_for_job(number, "done")
            out, err = patient.communicate(timeout=60)
            expect(patient.returncode == 0 and b": done" in out, (patient.returncode, out, err))
            expect(err.count(b"waiting up to 10:00") == 1 and err.count(b" is back") == 1, err)
        finally:
            for watcher in watchers + [stopped]:
                watcher.kill()
                watcher.communicate()
        expect(job["name"] == "survivor" and job["conflicts"] == 0, job)
        files = farm.fetch(number)
        farm.cli("render", farm.scene(), "--size", "256x256", "--spp", "64", "-o", "whole.exr",
                 expect=0)
        farm.cli("compare", [f for f in files if f.endswith(".exr")][0], "whole.exr", expect=0)


@tests.add
def submitted_twice():
    """a submission whose answer is lost is one job, and so is one that a script repeats"""
    with Farm() as farm:
        farm.start_coordinator()
        jobs = lambda: len(farm.cli("list", "--json", expect=0).json()["jobs"])
        # Cut at every answer in turn: the handshake's, the welcome, each of the submission's.
        for answer in range(1, 20):
            before = jobs()
            with Proxy(farm, which=1, answer=answer) as proxy:
                done = subprocess.run(
                    [os.path.join(BIN, "azulejo"), "submit", farm.scene(), *SMALL, "-c",
                     proxy.address, "-k", farm.key], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                    timeout=60)
                expect(done.returncode in (0, 4), done)
                expect(jobs() == before + (done.returncode == 0), (answer, done))
                if not proxy.cut:
                    break
                # One connection and a number: it was the goodbye that was cut.
                expect(done.returncode == 4 or (b"is back" in done.stderr) == (proxy.count == 2),
                       (answer, done))
        expect(not proxy.cut, "there were more than 20 answers")
        expect("submitted again with its token" in farm.coordinator.log_text(),
               "no answer to a JobSubmit was lost")
        # A person's script.
        first = farm.submit(farm.scene(), *SMALL, "--token", "nightly 7")
        count = jobs()
        expect(farm.submit(farm.scene(), *SMALL, "--token", "nightly 7", "--tonemap", "linear") ==
               first, "another job")
        farm.coordinator.kill()
        farm.restart_coordinator()
        expect(farm.submit(farm.scene(), *SMALL, "--token", "nightly 7") == first, "a restart")
        result = farm.cli("submit", farm.scene(), *SMALL, "--seed", 1, "--token", "nightly 7",
                          expect=5)
        expect("nightly 7" in result.err and "job %d" % first in result.err, result)
        for token in ("", "x" * 65):
            farm.cli("submit", farm.scene(), *SMALL, "--token", token, expect=2)
        farm.cli("submit", farm.scene(), *SMALL, "--token", "a\nb", expect=3)
        expect(jobs() == count, "more jobs")


@tests.add
def manual_pages():
    """every option of --help is in its manual page, with its help, and the other way round"""
    with Farm() as farm:
        wide = {"COLUMNS": "9999"}
        helps = {"azulejo-" + c: farm.cli("help", c, expect=0, connect=False, env=wide).out for c in COMMANDS}
        helps["azulejo-accuracy"] = helps["azulejo-accuracy"].split("\nparameters of")[0]  # which stand in other pages
        for program in ("azulejo-coordinator", "azulejo-worker"):
            helps[program] = subprocess.run([os.path.join(BIN, program), "--help"], check=True, stdout=subprocess.PIPE,
                                            env=dict(os.environ, **wide)).stdout.decode()
        for program, text in helps.items():
            with open(os.path.join(BUILD, "man", program + ".1")) as source:
                page = source.read()
            pattern = r"\bFl -([a-z][a-z0-9-]*)" if program == "azulejo-accuracy" else r"^\.It (?:Fl . , )?Fl -([a-z][a-z0-9-]*)"
            there = set(re.findall(pattern, page, re.M)) - {"name", "help", "version"}
            wanted = set(re.findall(r"^  (?:-., |    )--([a-z][a-z0-9-]*)", text, re.M)) - {"name", "help", "version"}
            expect(there == wanted, "%s: %s" % (program, sorted(there ^ wanted)))
            for letter, name, words in re.findall(r"^  (?:-(.), |    )--([a-z][a-z-]*)(?: \S+)?\s+([a-z][a-z' ]{12,})", text, re.M):
                expect(not letter or re.search(r"\bFl %s , Fl -%s\b" % (letter, name), page), "%s -%s" % (program, letter))
                expect(program == "azulejo-accuracy" or words[1:].strip() in page, "%s --%s: %s" % (program, name, words))
        with open(os.path.join(BUILD, "man", "azulejo.1")) as source:
            expect(set(re.findall(r"Xr azulejo-([a-z-]+) 1", source.read())) >= set(COMMANDS), "each command has its line")


@tests.add
def manual_pages_refuse_what_is_not_there():
    """prose of an option that no table has, or has twice, and a command without prose stop scripts/man.py"""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "page")
        for lines, words in (("@options list\n--mine\nMore.\n@end", ""), ("@options list\n--minr\nMore.\n@end", "minr"),
                             ("@options list\n--mine\nOne.\n--mine\nTwo.\n@end", "twice"), ("@options list\nMore.\n@end", "before"),
                             ("@shared list only minr\n@end", "minr"), ("@having json", "does not describe"), ("@optoins list", "unknown")):
            with open(path, "w") as file:
                file.write(lines + "\n")
            made = subprocess.run([os.path.join(ROOT, "scripts", "man.py"), BIN, path], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  text=True, check=False)
            expect((made.returncode == 0) == (not words) and words in made.stderr and "Traceback" not in made.stderr, (lines, made))


@tests.add
def terminal_progress():
    """on a terminal the progress line stands in place, without colour under NO_COLOR"""
    import pty
    with Farm() as farm:
        for no_color in (False, True):
            master, slave = pty.openpty()
            env = dict(os.environ, TERM="xterm", TMPDIR=farm.folder)
            env.pop("NO_COLOR", None)
            if no_color:
                env["NO_COLOR"] = "1"
            client = subprocess.Popen(
                [os.path.join(BIN, "azulejo"), "render", farm.scene(), "--size", "256x256", "--spp",
                 "32", "-o", "pic"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=slave,
                cwd=farm.folder, env=env)
            os.close(slave)
            seen = b""
            try:
                while True:
                    data = os.read(master, 65536)
                    if not data:
                        break
                    seen += data
            except OSError:
                pass  # EIO: the other side has closed it
            os.close(master)
            client.communicate(timeout=120)
            expect(client.returncode == 0, seen)
            expect(b"\r\x1b[K" in seen and b"%" in seen, seen)
            expect((b"\x1b[32m" in seen) == (not no_color), seen)
            expect(seen.endswith(b"\r\x1b[K"), seen)  # the line is taken away at the end


def lines_on_terminal(farm, columns, *args):
    """What a command shows on a terminal of so many columns, each state of the progress line, too."""
    import fcntl
    import pty
    import termios
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))
    client = subprocess.Popen([os.path.join(BIN, "azulejo"), *args], stdin=subprocess.DEVNULL, stdout=slave, stderr=slave,
                              cwd=farm.folder, env=dict(os.environ, TERM="xterm", TMPDIR=farm.folder, LC_ALL="C.UTF-8"))
    os.close(slave)
    seen = b""
    try:
        while True:
            seen += os.read(master, 65536)
    except OSError:
        pass  # EIO: the other side has closed it
    os.close(master)
    expect(client.wait(timeout=120) == 0, seen)
    return [line for line in re.split(r"[\r\n]+", re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", seen.decode())) if line]


@tests.add
def lines_fit_the_terminal():
    """while it renders and at its end no line is wider than the terminal; what does not fit is left out by whole phrases"""
    glass = os.path.join(ROOT, "scenes", "features", "glass.gltf")
    with Farm() as farm:
        command = ["render", glass, "--size", "80x60", "--target-error", "30/255", "-o", "g.exr"]  # always the same figures
        words = set(re.findall("[A-Za-z]{2,}", " ".join(lines_on_terminal(farm, 300, *command))))
        words |= set("queued waits no worker is connected samples now left sending the scene of KiB too early to say when at its last pictures "
                     "are being made".split())
        for columns, error in ((80, "in 95 % of the pixels"), (40, "/255 (")):
            lines = lines_on_terminal(farm, columns, *command)
            wide = [line for line in lines if len(line) > columns]
            expect(not wide, (columns, wide))
            cut = [line for line in lines if line.rstrip()[-1] in ",;:.(" or set(re.findall("[A-Za-z]{2,}", line)) - words]
            expect(not cut, (columns, cut))
            expect(any(line.startswith("  error ") and error in line for line in lines), lines)
            # A sentence goes on in lines of its own instead.
            expect("leave" in " ".join(lines) and "max-depth" in " ".join(lines), lines)


@tests.add
def show_fits_the_terminal():
    """show JOB and show --farm break every line to the terminal's width, show JOB leaves nothing out; the rules of a job are a line, a light map only where it is turned"""
    with Farm() as farm:
        farm.start_coordinator()
        plain = farm.submit(farm.scene(), *SMALL)
        number = farm.submit(farm.scene(), "--size", "40x30", "--core-limit", "4s", "--max-rays", "2e9", "--target-error", "2/255", "--spp", "4096",
                             "--env-rotate", "30", "--env-strength", "0.5", "--shutter", "0.5", "--aov", "depth,normal,albedo",
                             "--tonemap", "mantiuk06", "--auto-exposure", "percentile", "--white-balance", "5000", "--require", "gpu")
        shown = farm.cli("show", plain, expect=0).out
        expect("  until       4 samples a pixel\n" in shown and "light map" not in shown, shown)
        shown = farm.cli("show", number, expect=0).out
        expect("  until       2/255, at most 4096 samples a pixel, 4s of core time a frame, 2000 million rays a frame\n" in shown and
               "  light map   turned 30 degrees, strength 0.5\n" in shown, shown)
        for command in (["show", number], ["show", "--farm"]):
            argv = farm.cli_argv(*command)[1:]
            whole = " ".join(lines_on_terminal(farm, 1000, *argv)).split()
            for columns in (80, 45):  # a table takes 42
                lines = lines_on_terminal(farm, columns, *argv)
                expect(all(len(line) <= columns for line in lines), (columns, lines))
                if command[-1] == number:  # the disk's figures are others', too
                    expect(" ".join(lines).split() == whole, (columns, lines, whole))


@tests.add
def clamping_dispersed_light():
    """--clamp with light of single wavelengths, whose luminance may be below 0, ends with a picture"""
    with Farm() as farm:
        scene = os.path.join(ROOT, "scenes", "features", "dispersion.gltf")
        result = farm.cli("render", scene, "--size", "128x96", "--spp", "64", "--clamp", "8", "--json", "-o",
                          farm.path("d.exr"), connect=False, expect=0)
        share = clamped_share(json.loads(result.out)["job"])
        expect(0 < share < 0.5, share)


if __name__ == "__main__":
    tests.run()
