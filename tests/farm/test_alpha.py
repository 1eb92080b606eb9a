"""--alpha: what camera rays meet, premultiplied in the EXR and straight in the PNG."""
import os

from exr import read_exr
from farm import ROOT, Farm, Tests, read_bytes, wait_for
from jobs import expect, make_sky
from png import Png

tests = Tests()
SIZE = ("--size", "48x32", "--spp", "16")
FEATURES = os.path.join(ROOT, "scenes", "features")


def pixels(picture):
    return list(zip(*(picture.values(c) for c in "RGBA" if c in picture.channels)))


def render(farm, scene, out, *options):
    farm.cli("render", scene, *SIZE, "--env", make_sky(farm), *options, "-o", out, connect=False, expect=0)
    return read_exr(farm.path(out + ".exr"))


@tests.add
def coverage():
    """alpha is 1 on things, 0 beside them, and a share at edges; the light of things keeps its bits, the rest is black"""
    with Farm() as farm:
        plain = pixels(render(farm, farm.scene(), "plain"))
        cut = render(farm, farm.scene(), "cut", "--alpha")
        expect(sorted(cut.channels) == ["A", "B", "G", "R"], cut.channels.keys())
        kinds = {"whole": 0, "none": 0, "edge": 0}
        for whole, (r, g, b, a) in zip(plain, pixels(cut)):
            expect(0 <= a <= 1, a)
            kinds["whole" if a == 1 else "none" if a == 0 else "edge"] += 1
            if a == 1:
                expect((r, g, b) == whole, "other bits where alpha is 1")
            elif a == 0:
                expect((r, g, b) == (0, 0, 0), "light where alpha is 0")
            else:
                expect(r <= whole[0] and g <= whole[1] and b < whole[2], "at an edge")
                expect(abs(a * 16 - round(a * 16)) < 1e-6, a)
        expect(kinds["whole"] > 200 and kinds["none"] > 200 and kinds["edge"] > 20, kinds)
        # The PNG is straight: colours at edges are as bright as beside them.
        png = Png(read_bytes(farm.path("cut.png")))
        expect(png.channels == 4, png.channels)
        values = [c for row in png.codes for c in row]
        for i, (r, g, b, a) in enumerate(pixels(cut)):
            expect(values[4 * i + 3] == int(a * 255 + 0.5), (i, a, values[4 * i + 3]))
            expect(a > 0 or values[4 * i:4 * i + 3] == [0, 0, 0], "colour where alpha is 0")
        expect(Png(read_bytes(farm.path("plain.png"))).channels == 3, "a PNG without --alpha")


@tests.add
def things_that_let_through():
    """glass is a thing; a cut-out is not where it is cut out; fog that scatters is a thing in part"""
    with Farm() as farm:
        glass = render(farm, os.path.join(FEATURES, "glass.gltf"), "glass", "--alpha")
        plain = render(farm, os.path.join(FEATURES, "glass.gltf"), "glassy")
        whole = [p for p in zip(pixels(glass), pixels(plain)) if p[0][3] == 1]
        expect(len(whole) > 100 and all(p[0][:3] == p[1] for p in whole), "through glass the environment stays")
        cut = pixels(render(farm, os.path.join(FEATURES, "alpha.gltf"), "holes", "--alpha"))
        plain = pixels(render(farm, os.path.join(FEATURES, "alpha.gltf"), "holey"))
        expect(any(0 < p[3] < 1 for p in cut), "holes")
        for with_alpha, without in zip(cut, plain):
            expect(with_alpha[3] < 1 or with_alpha[:3] == without, "other bits")
        fog = [f for f in sorted(os.listdir(FEATURES)) if "fog" in f and f.endswith((".gltf", ".pbrt"))]
        for name in fog:
            values = [p[3] for p in pixels(render(farm, os.path.join(FEATURES, name), "fog", "--alpha"))]
            expect(all(0 <= v <= 1 for v in values), name)


@tests.add
def on_a_farm():
    """regions, halves, jobs without an EXR, previews, other developments and --temporal keep alpha"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene, sky = farm.scene(), make_sky(farm)
        options = (*SIZE, "--env", sky, "--alpha", "--tonemap", "linear")
        whole = farm.submit(scene, *options)
        region = farm.submit(scene, *options, "--region", "9,7,21,18")
        halves = farm.submit(scene, *options, "--half", "--format", "exr,png,jpg")
        bare = farm.submit(scene, *options, "--format", "png")
        calm = farm.submit(scene, *options, "--temporal", "3", "--frames", "1-3", "--auto-exposure", "key")
        for number in (whole, region, halves, bare, calm):
            expect("alpha" in farm.wait_for_job(number)["settings"]["aovs"], number)
        files = {n: sorted(farm.fetch(n, "job%d" % n)) for n in (whole, region, halves, bare, calm)}
        exr, png = files[whole]
        first, part = read_exr(exr), read_exr(files[region][0])
        wanted = [p for i, p in enumerate(pixels(first)) if 9 <= i % 48 < 30 and 7 <= i // 48 < 25]
        expect(pixels(part) == wanted, "a region's alpha")
        expect(read_exr(files[halves][0]).kinds["A"] == 1, "half alpha")
        expect(read_bytes(files[bare][0]) == read_bytes(png), "without an EXR")
        for path in files[calm]:
            expect(path.endswith(".exr") or Png(read_bytes(path)).channels == 4, path)
        # Developed another way and back: the stored picture has alpha too.
        for number, path in ((whole, png), (bare, files[bare][0])):
            farm.cli("develop", number, "--tonemap", "reinhard02", "-o", "other/", expect=0)
            farm.cli("develop", number, "--tonemap", "linear", "-o", "again/p.png", "--force", expect=0)
            expect(read_bytes(farm.path("again", "p.png")) == read_bytes(path), "developed again")
        farm.cli("extend", whole, "--spp", "32", "--watch", expect=0)
        farm.workers[0].kill()
        running = farm.submit(scene, "--size", "160x160", "--spp", "4096", "--env", sky, "--alpha")
        farm.start_worker()
        wait_for(lambda: farm.job(running)["preview_ready"], "a preview")
        farm.cli("fetch", running, "--preview", "p.exr", expect=0)
        farm.cli("fetch", running, "--preview", "p.png", expect=0)
        expect("A" in read_exr(farm.path("p.exr")).channels and Png(read_bytes(farm.path("p.png"))).channels == 4, "previews")
        farm.cli("cancel", running, expect=0)


tests.run()
