"""One sample rendered again: its bits are the film's, on this machine and on a farm, while a job renders and after
it is done, whatever becomes of the workers; and what cannot be rendered is refused in words."""
import json
import os
import shlex
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from exr import read_exr
from farm import ROOT, Farm, Tests, wait_for
from jobs import AREA, LongJob, expect, wait_mid_frame
from odd import OddPeer

tests = Tests()
NESTED = os.path.join(ROOT, "scenes", "features", "nested.gltf")
MEDIA = os.path.join(ROOT, "scenes", "features", "media.pbrt")
FOG = os.path.join(ROOT, "scenes", "features", "fog.pbrt")
MOTION = os.path.join(ROOT, "scenes", "features", "motion.gltf")
WIDTH, HEIGHT = 36, 20


def single(value):
    """Rounded to a float."""
    return struct.unpack("<f", struct.pack("<f", value))[0]


def floats(sample):
    """What the film adds, from the bits."""
    return [struct.unpack("<f", bytes.fromhex(b)[::-1])[0] for b in sample["bits"]]


def pass_ends(samples):
    """Where the passes of a group end: common/film/tiles.h."""
    ends, k = [2, 4], 4
    while ends[-1] < samples:
        ends += [k * 3 // 2, k * 2] if k >= 16 else [k * 2]
        k *= 2
    return [min(e, samples) for i, e in enumerate(ends) if i == 0 or ends[i - 1] < samples]


def film_pixel(samples, spp):
    """The film's mean of a pixel: each group's sum over a pass is rounded to float and added in double."""
    groups = [[floats(s) for s in sorted(samples, key=lambda s: s["sample"]) if s["sample"] % 2 == g] for g in (0, 1)]
    groups = [g for g in groups if g]
    mean = [0.0] * 3
    for mine in groups:
        for c in range(3):
            total, begin = 0.0, 0
            for end in pass_ends(len(mine)):
                part = 0.0
                for i in range(begin, end):
                    part += mine[i][c]
                total += single(part)
                begin = end
            mean[c] += 1 / len(groups) * (total / len(mine))
    return [single(m) for m in mean]


def picture_pixel(picture, x, y):
    return [picture.values(c)[y * picture.width + x] for c in "RGB"]


def size(spp):
    return ("--size", "%dx%d" % (WIDTH, HEIGHT), "--spp", spp)


@tests.add
def one_sample_is_the_picture():
    """of a picture with one sample a pixel, the sample has the pixel's bits: glass, media, motion, clamping"""
    with Farm() as farm:
        for scene, more, frame in ((NESTED, (), 1), (MEDIA, ("--seed", "7"), 1), (MOTION, ("--shutter", "0.5"), 12),
                                   (AREA, ("--clamp", "0.2"), 1), (NESTED, ("--sampler", "independent"), 3)):
            out = farm.path("one.exr")
            farm.cli("render", scene, *size(1), *more, "--frames", frame, "-o", out, expect=0)
            picture = read_exr(out)
            lit = 0
            for x, y in ((0, 0), (17, 9), (18, 12), (35, 19)):
                told = farm.cli("debug-pixel", scene, *size(1), *more, "--frame", frame, "--pixel", "%d,%d" % (x, y),
                                "--sample", 0, "--json", expect=0).json()
                sample = told["samples"][0]
                expect(told["frame"] == frame and told["pixel"] == [x, y] and told["job"] is None, told)
                expect(floats(sample) == picture_pixel(picture, x, y), (scene, x, y, sample["bits"]))
                expect(sample["path"]["vertices"] and sample["path"]["end"], sample)
                lit += any(floats(sample))
            expect(lit > 0, "only black pixels of %s were compared" % scene)


@tests.add
def all_samples_are_the_pixel():
    """the samples of a pixel, as the film adds them up, give the pixel; the list names the largest first"""
    with Farm() as farm:
        for scene, spp in ((NESTED, 27), (AREA, 64)):
            out = farm.path("all.exr")
            farm.cli("render", scene, *size(spp), "-o", out, expect=0)
            picture = read_exr(out)
            for x, y in ((17, 9), (5, 13)):
                command = ("debug-pixel", scene, *size(spp), "--pixel", "%d,%d" % (x, y))
                samples = farm.cli(*command, "--json", expect=0).json()["samples"]
                expect(sorted(s["sample"] for s in samples) == list(range(spp)), samples)
                expect(all(a["luminance"] >= b["luminance"] for a, b in zip(samples, samples[1:])), "the order")
                expect(film_pixel(samples, spp) == picture_pixel(picture, x, y),
                       (scene, x, y, film_pixel(samples, spp), picture_pixel(picture, x, y)))
                text = farm.cli(*command, expect=0).out
                expect("%d samples" % spp in text, text)
                expect(text.splitlines()[3].split()[0] == str(samples[0]["sample"]), text)


@tests.add
def words():
    """the text fits 100 columns and names materials, objects and lights as the scene does"""
    with Farm() as farm:
        seen = farm.cli("debug-pixel", AREA, *size(64), "--pixel", "20,3", "--sample", "0-31", "--sample", 33, expect=0).out
        expect(seen.count("bits ") == 33 and max(map(len, seen.splitlines())) <= 100, seen)
        for word in ("white of back wall", "triangle 0 of lamp", "diffuse", "density", "weight", "throughput", "hidden",
                     "visible", "adds", "survives with", "Russian roulette"):
            expect(word in seen, "%s is missing:\n%s" % (word, seen[:4000]))
        glass = farm.cli("debug-pixel", NESTED, *size(16), "--pixel", "18,12", "--sample", "0-15", expect=0).out
        for word in ("inside glass", "in water", "interface", "delta lobe"):
            expect(word in glass, "%s is missing:\n%s" % (word, glass[:4000]))
        tea = farm.cli("debug-pixel", MEDIA, *size(16), "--pixel", "18,12", "--sample", 0, expect=0).out
        expect("through medium tea" in tea, tea)
        fog = farm.cli("debug-pixel", FOG, *size(16), "--pixel", "18,12", "--sample", "0-15", expect=0).out
        expect("  medium   at" in fog and "goes on  phase" in fog, fog[:4000])


@tests.add
def a_job():
    """of a job, a worker of the farm renders it: while the job renders, after it is done, after a restart"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        long_job = LongJob(1)
        long_job.measure(farm)
        number = long_job.submit(farm)
        wait_mid_frame(farm, number, 0.2)
        during = farm.cli("debug-pixel", number, "--pixel", "3,4", "--sample", 1, "--json", expect=0).json()
        expect(farm.job(number)["state"] == "running", "the job is over already: it was to be asked during it")
        farm.cli("cancel", number, "--discard", expect=0)
        expect(during["job"] == number and during["samples"][0]["worker"], during)
        number = farm.submit(MOTION, *size(5), "--frames", "11-12", "--shutter", "0.5")
        farm.wait_for_job(number)
        pictures = [read_exr(f) for f in sorted(farm.fetch(number)) if f.endswith(".exr")]
        for restart in (False, True):
            for frame, picture in ((11, pictures[0]), (12, pictures[1])):
                told = farm.cli("debug-pixel", number, "--frame", frame, "--pixel", "18,10", "--json", expect=0).json()
                expect(film_pixel(told["samples"], 5) == picture_pixel(picture, 18, 10), (frame, restart))
            named = farm.cli("debug-pixel", "motion", "--pixel", "18,10", "--json", expect=0).json()
            expect(named["frame"] == 11 and named["job"] == number, "the first frame, by the job's name")
            if not restart:
                farm.coordinator.stop()
                farm.restart_coordinator()
                farm.wait_for_workers(1)


@tests.add
def errors():
    """what cannot be rendered is refused, with its place and what to do"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *size(4))

        def refused(status, words, *args):
            result = farm.cli("debug-pixel", *args)
            expect(result.code == status and words in result.err, "%s: %s" % (words, result))
        refused(5, "no worker is connected: start one", number, "--pixel", "1,1", "--sample", 0)
        farm.start_worker()
        farm.wait_for_job(number)
        refused(3, "outside the picture of 36x20", number, "--pixel", "36,0", "--sample", 0)
        refused(3, "outside the picture of 36x20", number, "--pixel", "0,20")
        refused(3, "samples 0 to 3", number, "--pixel", "0,0", "--sample", 4)
        refused(3, "has frames 1 to 1", number, "--pixel", "0,0", "--frame", 2)
        refused(5, "99", 99, "--pixel", "0,0")
        refused(5, "no job is named 'nobody'", "nobody", "--pixel", "0,0")
        refused(3, "nobody.gltf: ", "nobody.gltf", "--pixel", "0,0")
        refused(2, "--pixel X,Y", number)
        refused(2, "as in 33,40", number, "--pixel", "3")
        refused(2, "as in 5 or 0-3", number, "--pixel", "0,0", "--sample", "x")
        refused(2, "at most 64", number, "--pixel", "0,0", "--sample", "0-64")
        refused(2, "has its own settings", number, "--pixel", "0,0", "--seed", 3)
        refused(2, "is a scene, which is rendered here", farm.scene(), "--pixel", "0,0", "--timeout", 3)
        refused(3, "outside the picture", farm.scene(), *size(4), "--pixel", "99,0")
        refused(3, "samples 0 to 3", farm.scene(), *size(4), "--pixel", "0,0", "--sample", 4)
        # The coordinator looks itself, whatever the client says.
        odd = OddPeer(farm, "client")
        for line, words in (("x=36 y=0", "outside the picture of 36x20"), ("x=0 y=0 first=3 count=2", "has 0 to 3"),
                            ("x=0 y=0 count=4097", "must be 1..4096"), ("x=0 y=0 count=0", "must be 1..4096"),
                            ("tile=99", "tile"), ("tile=0 x=0", "a unit or a pixel"), ("", "a unit or a pixel"),
                            ("x=0 y=0 frame=9", "frames 1 to 1, not 9"), ("x=0 y=0 job=77", "there is no job 77"),
                            ("x=0 y=0 job=0", "the scene")):
            odd.say("render job=%d frame=1 %s" % (number, line) if "job" not in line and "frame" not in line
                    else "render job=%d %s" % (number, line) if "job" not in line else "render frame=1 " + line)
            expect(words in odd.wait_line("failure request=5"), line)
        farm.cli("debug-pixel", number, "--pixel", "0,0", "--sample", 0, expect=0)


@tests.add
def lost_workers():
    """a worker that is lost during a request: another renders it; none is left: it is said; clients may go"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")  # which ask the odd peers, too
        worker = farm.start_worker()
        number = farm.submit(farm.scene(), *size(4))
        farm.wait_for_job(number)
        first = farm.cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2, "--json", expect=0).json()
        worker.stop()
        odd = OddPeer(farm, "worker")
        client = farm.start_cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2, "--json")
        wait_for(lambda: odd.wait_line("asked"), "the request")
        again = farm.start_worker()
        wait_for(lambda: any(str(again.pid) in str(w) for w in farm.list_workers()), "the second worker")
        odd.kill()
        out, err = client.communicate(timeout=60)
        expect(client.returncode == 0, err)
        told = json.loads(out)
        expect(told["samples"][0]["bits"] == first["samples"][0]["bits"], told)
        expect("process %d" % again.pid in told["samples"][0]["worker"], told["samples"][0]["worker"])
        again.stop()
        # Nobody is left.
        odd = OddPeer(farm, "worker")
        client = farm.start_cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2)
        odd.wait_line("asked")
        odd.kill()
        out, err = client.communicate(timeout=60)
        expect(client.returncode == 5 and b"no worker is connected" in err, err)
        # It crashes them all.
        odds = [OddPeer(farm, "worker") for _ in range(4)]
        client = farm.start_cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2)
        for _ in range(3):
            struck = wait_for(lambda: [o for o in odds if o.alive() and asked(o)], "the request")
            struck[0].kill()
        out, err = client.communicate(timeout=60)
        expect(client.returncode == 4 and b"3 workers were lost while they rendered it" in err, (client.returncode, err))
        # The client goes first; the answer is for nobody. A false answer is found out.
        odd = [o for o in odds if o.alive()][0]
        client = farm.start_cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2)
        name = odd.wait_line("asked ")
        client.kill()
        client.communicate()
        odd.say("rendered %s 12" % name)
        client = farm.start_cli("debug-pixel", number, "--pixel", "5,5", "--sample", 2)
        odd.say("rendered %s 13" % odd.wait_line("asked "))
        out, err = client.communicate(timeout=60)
        expect(client.returncode != 0 and b"something else than 1 sample" in err, err)


def asked(peer):
    """Has it been asked by now?"""
    try:
        peer.wait_line("asked", 0.05)
        return True
    except Exception:
        return False


@tests.add
def units():
    """a named unit's digest is the same from every worker, and another unit's is another"""
    with Farm() as farm:
        farm.start_coordinator()
        first = farm.start_worker()
        number = farm.submit(NESTED, *size(9))
        farm.wait_for_job(number)
        odd = OddPeer(farm, "client")

        def rendered(line):
            odd.say("render job=%d frame=1 %s" % (number, line))
            return dict(f.split("=", 1) for f in odd.wait_line("rendered ").split(" ", 3))
        names = ["tile=%d group=%d pass=%d" % (t, g, p) for t in (0, 4) for g in (0, 1) for p in (0, 1)]
        digests = [rendered(name)["digest"] for name in names]
        expect(len(set(digests)) == len(names) and all(len(d) == 64 for d in digests), digests)
        expect(rendered(names[0])["samples"] == str(2 * 256), "samples")
        first.stop()
        second = farm.start_worker(threads=2)
        farm.wait_for_workers(1)
        again = [rendered(name) for name in names]
        expect([a["digest"] for a in again] == digests, "another worker gives other digests")
        expect("process %d" % second.pid in again[0]["worker"], again[0])
        expect(rendered("x=3 y=4 first=1 count=8")["bytes"] == "96", "eight samples")


def run_command(farm, picture, name, here):
    """Run the command of a picture's header in the folder `here`; the picture that it makes."""
    words = shlex.split(picture.attributes["azulejo:command"].decode())
    expect(words[:2] == ["azulejo", "render"], words)
    words = [picture.path if w == "FILE.exr" else w for w in words[1:]]
    out = farm.path(name + "-again.exr")
    farm.cli(*words, "-o", out, "-q", expect=0, cwd=here)
    return read_exr(out)


@tests.add
def the_headers_command():
    """the command in a header, run in the scene's folder, gives the same pixels and the same header"""
    features = os.path.join(ROOT, "scenes", "features")
    cases = (
        ("defaults", ("nested.gltf", "--size", "32x20", "--spp", "5")),
        ("everything", ("lens.pbrt", "--size", "31x17", "--spp", "6", "--seed", "12345678901234", "--frames", "3",
                        "--lens", "0.1234567", "--focus", "3.7", "--max-depth", "5", "--sampler", "independent",
                        "--light-choice", "power", "--texture-filter", "nearest", "--roulette", "off", "--clamp", "0.7",
                        "--without", "caustics", "--aov", "depth,normal", "--env-strength", "0.3", "--half",
                        "--env-sampling", "uniform", "--isa", "sse2", "--robust", "off", "--bvh-quality", "low")),
        ("sky", ("horizon.gltf", "--env", "sky.hdr", "--env-rotate", "33.3", "--size", "32x20", "--spp", "4")),
        ("motion", ("motion.gltf", "--frames", "11-12", "--fps", "30", "--shutter", "0.3", "--size", "32x20", "--spp", "4")),
        ("variant", ("variants.gltf", "--variant", "1", "--size", "32x20", "--spp", "4")),
        ("target", ("nested.gltf", "--size", "48x32", "--spp", "256", "--target-error", "20/255", "--exposure", "0.5",
                    "--tonemap", "reinhard02", "--min-spp", "8")),
        ("clock", ("nested.gltf", "--size", "48x32", "--core-limit", "0.3s")),
    )
    with Farm() as farm:
        for name, options in cases:
            out = farm.path(name + ".exr")
            told = farm.cli("render", *options, "-o", out, "--json", expect=0, cwd=features).json()
            for path in told["files"]:
                path = os.path.join(features, path)
                if not path.endswith(".exr"):
                    continue
                first = read_exr(path)
                first.path = path
                again = run_command(farm, first, name, features)
                command = first.attributes["azulejo:command"].decode()
                expect(again.bits() == first.bits(), "%s: other pixels: %s" % (name, command))
                if name != "clock":  # its rules are its schedule then
                    expect(again.attributes["azulejo:command"].decode() == command, command)
                expect(again.attributes["azulejo:scene"] == first.attributes["azulejo:scene"], "scene")
                expect(ROOT not in command and farm.folder not in command, command)
            if name == "clock":
                expect("--schedule-from" in command, command)


if __name__ == "__main__":
    tests.run()
