#!/usr/bin/env python3
"""The parts of the Blender add-on (docs/BLENDER.md) that need no Blender: what is added to the scene, the options, the programs it runs."""
import json
import math
import os
import struct
import subprocess
import sys
import zipfile

from farm import BIN, ROOT, Failure, Farm, Skip, Tests, read_bytes, wait_for
from jobs import expect

sys.path.insert(0, os.path.join(ROOT, "deploy", "blender"))
from azulejo_render import farm as programs  # noqa: E402
from azulejo_render import options, scene_fix  # noqa: E402

AZULEJO = os.path.join(BIN, "azulejo")
IDENTITY = [[float(i == j) for j in range(4)] for i in range(4)]
tests = Tests()


def camera(**more):
    return dict({"name": "eye", "matrices": [IDENTITY], "lens_mm": 50.0, "sensor_mm": 36.0, "fit": "AUTO", "ortho_scale": None,
                 "shift": [0, 0], "lens_radius": 0.0, "focus": 0.0}, **more)


def light(kind, **more):
    return dict({"name": kind, "kind": kind, "matrix": IDENTITY, "color": [1, .5, .25], "watts": 100.0, "radius": 0.0,
                 "angle": 0.0, "size": 1.0, "blend": 0.5, "shape": "SQUARE", "width": 2.0, "height": 2.0}, **more)


def fixed(lights=(), size=(160, 90), begin=0.0, **more):
    gltf = {"asset": {"version": "2.0"}}
    scene_fix.fix(gltf, {"camera": camera(**more), "lights": list(lights), "size": list(size), "begin": begin})
    return gltf


def close(a, b, tolerance=1e-6):
    expect(abs(a - b) <= tolerance * max(1, abs(b)), "%r is not %r" % (a, b))


def settings(**more):
    return dict({"samples": 64, "target_error": "", "time_limit_s": 0, "max_depth": 12, "seed": 0, "frame": 7, "shutter": 0,
                 "transparent": False, "aovs": [], "denoise": "off", "filter": None, "name": "cube-0007", "priority": 0}, **more)


def exported(**more):
    return {"scene": {"camera": camera(**more)}, "gltf": "/tmp/scene.gltf",
            "env": {"file": "/tmp/world.pfm", "strength": 2.0, "rotate_deg": -40.0}}


def option(words, name):
    return words[words.index(name) + 1] if name in words else None


def raised(kind, function, *arguments):
    try:
        function(*arguments)
    except kind as problem:
        return str(problem)
    raise Failure("nothing was raised")


# ---- the scene -----------------------------------------------------------------------------------------------------------

@tests.add
def lights_keep_their_watts():
    """a point and a spot of 100 W have 100/(4 pi) W/sr, a sun its W/m^2; sizes share it among many"""
    rows = fixed([light("POINT"), light("SPOT"), light("SUN"), light("SPOT", radius=.1), light("SUN", angle=.1)])
    lamps = rows["extensions"]["KHR_lights_punctual"]["lights"]
    close(lamps[0]["intensity"], 100 / (4 * math.pi))
    close(lamps[1]["intensity"], 100 / (4 * math.pi))
    close(lamps[2]["intensity"], 100)
    expect([l["type"] for l in lamps[:3]] == ["point", "spot", "directional"], lamps[:3])
    for kind, whole in (("spot", 100 / (4 * math.pi)), ("directional", 100)):
        part = [l["intensity"] for l in lamps[3:] if l["type"] == kind]
        expect(len(part) == scene_fix.SPREAD, part)
        close(sum(part), whole)


@tests.add
def surfaces_keep_their_watts():
    """an area light's quad and a ball have the radiance that their watts ask for, and shine from their fronts alone"""
    rows = fixed([light("AREA", matrix=[[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]), light("POINT", radius=.5)])
    quad, ball = rows["materials"]
    close(quad["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"], 100 / (4 * 8))
    strength = ball["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    expect(abs(strength / (100 / (4 * math.pi ** 2 * .25)) - 1) < .06, strength)  # 16x8 faces are a little less than a ball
    expect(quad["emissiveFactor"] == [1, .5, .25] and not quad.get("doubleSided"), quad)
    corners = [struct.unpack_from("<3f", bytes_of(rows, 0), 12 * i) for i in range(4)]
    expect(max(abs(c[0]) for c in corners) == 2, corners)       # scaled
    u, v = [[corners[k][i] - corners[0][i] for i in range(3)] for k in (1, 2)]
    expect(u[0] * v[1] - u[1] * v[0] < 0, "the quad does not face -Z")
    points, faces = scene_fix.sphere(1.0)
    for face in faces:
        a, b, c = (points[i] for i in face)
        u, v = [b[i] - a[i] for i in range(3)], [c[i] - a[i] for i in range(3)]
        cross = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        expect(sum(cross[i] * a[i] for i in range(3)) > 0, "a face of the ball looks inwards")


def bytes_of(gltf, accessor):
    import base64
    view = gltf["bufferViews"][gltf["accessors"][accessor]["bufferView"]]
    return base64.b64decode(gltf["buffers"][view["buffer"]]["uri"].split(",")[1])


@tests.add
def the_sun_is_spread_about_its_direction():
    """the directions of a sun's parts lie within its angle, evenly about the middle"""
    angle = .3
    total = [0.0, 0.0, 0.0]
    for x, y in scene_fix.on_disc(scene_fix.SPREAD):
        m = scene_fix.turned(IDENTITY, x * math.tan(angle / 2), y * math.tan(angle / 2))
        for column in range(3):
            close(sum(m[row][column] ** 2 for row in range(3)), 1)
        expect(-m[2][2] < 0 and math.acos(m[2][2]) <= angle / 2 + 1e-9, m)
        total = [t - m[row][2] / scene_fix.SPREAD for row, t in enumerate(total)]
    expect(abs(total[0]) < .01 and abs(total[1]) < .01, total)


@tests.add
def spots_have_blenders_rim():
    """the inner cone is where Blender's smooth step begins, and the file says which rim it is"""
    inner, outer = scene_fix.spot_cones(1.2, .25)
    close(outer, .6)
    close(math.cos(inner), math.cos(.6) + (1 - math.cos(.6)) * .25)
    expect(scene_fix.spot_cones(math.pi, 0)[1] < math.pi / 2 and scene_fix.spot_cones(1, 0)[0] < .5, "cones out of range")
    row = fixed([light("SPOT")])["extensions"]["KHR_lights_punctual"]["lights"][0]
    expect(row["extras"] == {"falloff": "smoothstep"}, row)


@tests.add
def the_camera_sees_what_blenders_does():
    """sensor fit, portrait, orthographic; a shift widens the view and asks for a part of it"""
    view = fixed()["cameras"][0]["perspective"]
    close(math.tan(view["yfov"] / 2), 18 / 50 * 90 / 160)
    close(math.tan(fixed(size=(90, 160))["cameras"][0]["perspective"]["yfov"] / 2), 18 / 50)
    close(math.tan(fixed(fit="VERTICAL", sensor_mm=24)["cameras"][0]["perspective"]["yfov"] / 2), 12 / 50)
    flat = fixed(ortho_scale=8)["cameras"][0]["orthographic"]
    close(flat["xmag"], 4)
    close(flat["ymag"], 4 * 90 / 160)
    shifted = camera(shift=[.1, -.05])
    expect(scene_fix.widened(shifted, 160, 90) == (192, 106, 32, 16), scene_fix.widened(shifted, 160, 90))
    close(math.tan(fixed(shift=[.1, -.05])["cameras"][0]["perspective"]["yfov"] / 2), 18 / 50 * 106 / 160)
    turn = [[0, 0, 1, 5], [1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 0, 1]]
    expect(fixed(matrices=[turn])["nodes"][0]["matrix"] == [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 5, 2, 0, 1], "axes")


@tests.add
def materials_are_cycles():
    """a clear material bounds a solid, which a volume may fill; before Blender 4 a coat has a quarter of its weight; no material is grey"""
    gltf = {"meshes": [{"primitives": [{"material": 0}, {}]}, {"primitives": [{}]}], "materials": [{"name": "plain"}, {"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}},
                          {"name": "juice", "extensions": {"KHR_materials_transmission": {}, "KHR_materials_volume": {"thicknessFactor": .2}}},
                          {"name": "coat", "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": .8}}}]}
    scene_fix.fix(gltf, {"camera": camera(), "lights": [], "size": [8, 8], "begin": 0, "coat": .25, "absorption": {"juice": (4, [1, .5, 0])}})
    plain, glass, juice, coat, grey = (row.get("extensions") for row in gltf["materials"])
    expect(plain is None and glass["KHR_materials_volume"] == {"thicknessFactor": 1}, gltf)
    volume = juice["KHR_materials_volume"]
    expect(volume["thicknessFactor"] == .2 and volume["attenuationDistance"] == .25, volume)
    for part, absorbed in zip(volume["attenuationColor"], (0, 2, 4)):
        close(-math.log(part) / volume["attenuationDistance"], absorbed)
    close(coat["KHR_materials_clearcoat"]["clearcoatFactor"], .2)
    expect([p["material"] for mesh in gltf["meshes"] for p in mesh["primitives"]] == [0, 4, 4], gltf["meshes"])
    expect(grey == {"KHR_materials_specular": {"specularFactor": 0}}, grey)
    expect(gltf["extensionsUsed"] == ["KHR_materials_volume", "KHR_materials_specular"], gltf["extensionsUsed"])


@tests.add
def motion_is_retimed():
    """a frame is a second, all is as much later as the shutter wants it, shared times change once"""
    keys = bytearray(struct.pack("<3f3f", .25, .5, .75, 9, 9, 9))
    gltf = {"animations": [{"samplers": [{"input": 0, "output": 1}, {"input": 0, "output": 1}]}],
            "accessors": [{"bufferView": 0, "count": 3, "componentType": 5126, "type": "SCALAR"}, {}],
            "bufferViews": [{"buffer": 0, "byteOffset": 0}]}
    scene_fix.retime(gltf, [keys], 4, .25)
    expect(struct.unpack("<6f", keys) == (1.25, 2.25, 3.25, 9, 9, 9), struct.unpack("<6f", keys))
    expect(gltf["accessors"][0]["min"] == [1.25] and gltf["accessors"][0]["max"] == [3.25], gltf)
    moved = [[row[:] for row in IDENTITY] for _ in range(3)]
    for i, matrix in enumerate(moved):
        matrix[0][3] = float(i)
    animation = fixed(matrices=moved, begin=.25)["animations"][0]
    expect([c["target"]["path"] for c in animation["channels"]] == ["translation", "rotation"], animation)


@tests.add
def lights_in_view_are_named():
    """a glowing surface in front of the camera is named, one behind it, or turned away, is not"""
    def seen(z, turned=False):
        matrix = [[1, 0, 0, 0], [0, -1 if turned else 1, 0, 0], [0, 0, -1 if turned else 1, z], [0, 0, 0, 1]]
        return scene_fix.glowing_in_view({"camera": camera(), "size": [160, 90], "lights": [light("AREA", matrix=matrix)]})
    expect(seen(-5, turned=True) == ["AREA"], "not seen")
    expect(seen(-5) == [] and seen(5, turned=True) == [] and seen(5) == [], "seen")


@tests.add
def azulejo_reads_what_is_added():
    """azulejo import takes a scene of added lights and a moving camera without a warning"""
    moved = [[row[:] for row in IDENTITY] for _ in range(3)]
    for i, matrix in enumerate(moved):
        matrix[0][3] = .1 * i
    with Farm() as farm:
        gltf = fixed([light(k, radius=.1, angle=.1) for k in ("POINT", "SPOT", "SUN", "AREA")] +
                     [light("AREA", shape="DISK")], matrices=moved)
        with open(farm.path("scene.gltf"), "w", encoding="utf-8") as out:
            json.dump(gltf, out)
        result = farm.cli("import", farm.path("scene.gltf"), "--json", expect=0, connect=False)
        expect("warning" not in result.err.replace("light units", ""), result)


# ---- options, answers ----------------------------------------------------------------------------------------------------

@tests.add
def options_say_what_the_panel_says():
    """size, region, lens, world, stop rules, seed and passes become azulejo's options"""
    words = options.submit_words(settings(), exported(), (160, 90), None)
    expect(option(words, "--size") == "160x90" and option(words, "--spp") == "64" and option(words, "--seed") == "7" and
           option(words, "--env-rotate") == "-40" and option(words, "--lens") == "0" and option(words, "--region") is None and
           option(words, "--focus") is None and "--alpha" not in words and "--denoise" not in words, words)
    words = options.submit_words(settings(samples=0, target_error="2/255", time_limit_s=90, shutter=.5, transparent=True,
                                          aovs=["depth", "normal"], denoise="fast"),
                                 exported(lens_radius=.01, focus=3.0, shift=[.1, -.05]), (160, 90), (40, 10, 80, 60))
    expect(option(words, "--size") == "192x106" and option(words, "--region") == "72,36,80,60" and
           option(words, "--target-error") == "2/255" and option(words, "--time-limit") == "90s" and
           option(words, "--shutter") == "0.5" and option(words, "--focus") == "3" and option(words, "--spp") is None and
           "--alpha" in words and option(words, "--denoise") == "fast" and option(words, "--aov") == "depth,normal", words)
    expect(options.border_pixels((100, 50), .1, .2, .5, 1.0) == (10, 10, 40, 40), options.border_pixels((100, 50), .1, .2, .5, 1))
    expect(option(options.submit_words(settings(frame=-3), exported(), (8, 8), None), "--seed") == str((1 << 31) - 3), "seed")


@tests.add
def the_filter_is_cycles():
    """Cycles' pixel filters become Azulejo's, each with the width of its support; one that is too wide becomes 16 pixels"""
    for kind, width, name, pixels in (("BLACKMAN_HARRIS", 1.5, "blackman-harris", "3"), ("BOX", 4.0, "box", "1"),
                                      ("GAUSSIAN", 1.5, "gaussian", "2.25"), ("BLACKMAN_HARRIS", 10, "blackman-harris", "16")):
        words = options.submit_words(settings(filter=options.pixel_filter(kind, width)), exported(), (8, 8), None)
        expect((option(words, "--pixel-filter"), option(words, "--filter-width")) == (name, pixels), words)
    expect(options.pixel_filter("MITCHELL", 1) is None, "one that is not known")


@tests.add
def every_option_exists():
    """azulejo submit knows each of them"""
    words = options.submit_words(settings(target_error="1%", time_limit_s=1, shutter=1, transparent=True, aovs=["depth"], denoise="on",
                                          priority=1, filter=("box", 1.0)),
                                 exported(lens_radius=1, focus=1, shift=[.5, .5]), (8, 8), None)
    text = subprocess.run([AZULEJO, "help", "submit"], capture_output=True, text=True, check=True).stdout
    for word in words:
        expect(not word.startswith("--") or word in text, word)


@tests.add
def the_panel_is_checked():
    """a picture that would never be done, and an error that is none, are refused in one sentence"""
    expect(options.wrong(settings()) is None, "refused")
    expect("nothing says when" in options.wrong(settings(samples=0)), options.wrong(settings(samples=0)))
    for bad in ("2", "-1%", "two", "1 %; rm"):
        expect("2/255" in options.wrong(settings(target_error=bad)), bad)
    for good in ("2/255", "0.5%", "45dB"):
        expect(options.wrong(settings(target_error=good)) is None, good)


@tests.add
def progress_is_one_line():
    """samples, error and time left, if they are known; what a job waits for, if it does"""
    job = {"state": "running", "state_text": "", "done_share": .25, "samples_done": 800, "samples_total": 3200, "workers": 2,
           "settings": {"width": 10, "height": 10, "spp": 32}, "seconds_left": 75.2, "now": {"figures": {"display": 3.217}}}
    expect(options.progress(job) == (.25, "8 samples a pixel | error 3.2/255 | 1:15 min left | 2 workers"), options.progress(job))
    job["now"]["figures"]["rmse_percent"], job["now"]["denoised"] = 34.04, {"rmse_percent": 8.13}
    expect("error 3.2/255 | RMSE 34 %, denoised 8.1 % | 1:15" in options.progress(job)[1], options.progress(job))
    job.update(done_share=0, seconds_left=-1, now=None, workers=0)
    expect(options.progress(job) == (.25, "8 samples a pixel | waits for a worker"), options.progress(job))
    expect(options.progress({"state": "queued", "state_text": "", "settings": {}}) == (0, "queued"), "queued")
    expect(options.complaint("warning: x\nazulejo submit: no coordinator at 1.2.3.4\n", 4) == "no coordinator at 1.2.3.4", "words")
    expect("status 5" in options.complaint("", 5), options.complaint("", 5))


# ---- programs --------------------------------------------------------------------------------------------------------------

def no_tick():
    pass


@tests.add
def a_missing_program_is_named():
    """no azulejo, or none where the panel says, is an error that says what to do"""
    expect("set its path" in raised(programs.Trouble, programs.find_program, "/nowhere/azulejo"), "words")
    expect(programs.find_program(BIN) == AZULEJO and programs.find_program(AZULEJO) == AZULEJO, "not found")


@tests.add
def the_local_farm_renders_and_goes():
    """a coordinator and a worker start, render a job, and are gone with their files"""
    with Farm() as farm:
        local = programs.Local(AZULEJO, 1, farm.folder, no_tick)
        try:
            job = programs.Job(AZULEJO, local.address, local.key, farm.folder, no_tick)
            job.submit([farm.scene(), "--json", "--size", "32x32", "--spp", "4", "--format", "exr"])
            wait_for(lambda: job.info()["state"] == "done", "the job to be done")
            job.fetch(farm.path("picture.exr"))
            expect(read_bytes(farm.path("picture.exr"))[:4] == b"\x76\x2f\x31\x01", "no EXR")
            local.check()
        finally:
            groups = [c.process.pid for c in local.commands]
            local.stop()
        expect(len(groups) == 2 and not os.path.exists(local.folder), "the folder stays")
        wait_for(lambda: not any(group_lives(g) for g in groups), "the programs to end")


def group_lives(group):
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open("/proc/%s/stat" % name, encoding="ascii", errors="replace") as stat:
                    fields = stat.read().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[2]) == group and fields[0] not in "ZX":
                return True
    return False


@tests.add
def the_local_farm_ends_with_blender():
    """when the process that started it is killed, coordinator and worker end"""
    script = ("import sys, time; sys.path.insert(0, %r)\nfrom azulejo_render import farm\n"
              "f = farm.Local(%r, 1, sys.argv[1], lambda: None)\n"
              "print(*[c.process.pid for c in f.commands], flush=True); time.sleep(600)") % (
                  os.path.join(ROOT, "deploy", "blender"), AZULEJO)
    with Farm() as farm:
        with subprocess.Popen([sys.executable, "-c", script, farm.folder], stdout=subprocess.PIPE, text=True) as child:
            groups = [int(word) for word in child.stdout.readline().split()]
            expect(len(groups) == 2 and all(group_lives(g) for g in groups), groups)
            child.kill()
        wait_for(lambda: not any(group_lives(g) for g in groups), "the programs to end")


@tests.add
def strangers_are_errors():
    """no coordinator there, a wrong key, and a worker's key are told apart and end"""
    with Farm() as farm:
        farm.start_coordinator()
        gone = programs.Job(AZULEJO, "127.0.0.1:1", farm.key, farm.folder, no_tick)
        expect("127.0.0.1:1" in raised(programs.Gone, gone.submit, [farm.scene(), "--json"]), "words")
        for number, words in enumerate((["keygen"], ["keygen", "--role", "worker", "--from", farm.key])):
            key = farm.path("other-%d.key" % number)
            farm.cli(*words, "-o", key, expect=0, connect=False)
            job = programs.Job(AZULEJO, farm.address, key, farm.folder, no_tick)
            expect("key" in raised(programs.Trouble, job.submit, [farm.scene(), "--json"]), "words")
        expect(raised(programs.Trouble, programs.Job(AZULEJO, farm.address, farm.path("none.key"), farm.folder, no_tick).submit,
                      [farm.scene(), "--json"]), "words")


@tests.add
def stopping_is_quick():
    """what the caller raises while a command runs ends the command"""
    calls = []

    def tick():
        calls.append(1)
        if len(calls) > 2:
            raise KeyError("stop")
    with Farm() as farm:
        raised(KeyError, programs.run, ["/bin/sh", "-c", "sleep 600"], farm.folder, tick)


def modules_with_numpy():
    try:
        import numpy
    except ImportError as problem:
        raise Skip("this Python has no numpy, which Blender has") from problem
    from azulejo_render import exr, passes
    return numpy, exr, passes


@tests.add
def pictures_are_read():
    """an EXR of Azulejo's becomes Blender's rows: bottom up, opaque, +Z up"""
    numpy, exr, passes = modules_with_numpy()
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "40x24", "--spp", "2", "--aov", "depth,normal,position,uv,albedo,error,samples",
                             "--format", "exr")
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", "p.exr", expect=0)
        picture = exr.read(farm.path("p.exr"))
        from exr import read_exr  # the tests' own reader
        other = read_exr(farm.path("p.exr"))
        for name, values in picture.channels.items():
            expect(numpy.array_equal(values.ravel(), numpy.array(other.values(name), dtype=numpy.float32)), name)
        rows = passes.blender_rows(passes.combined(picture)).reshape(24, 40, 4)
        expect(numpy.all(rows[..., 3] == 1) and numpy.array_equal(rows[0, :, 0], picture.channels["R"][-1]), "rows")
        chosen = passes.wanted(lambda flag: flag in ("use_pass_z", "use_pass_normal", "use_pass_position", "use_pass_uv"))
        expect(passes.aovs(chosen) == ["depth", "normal", "position", "uv"], passes.aovs(chosen))
        for one in chosen:
            expect(one.make(picture).shape[2] == len(one.letters), one.name)
        normal = chosen[1].make(picture)
        floor = picture.channels["Z"] > 0
        expect(normal[floor][:, 2].max() > .9, "the floor's normal is not +Z in Blender's axes")
        data = read_bytes(farm.path("p.exr"))
        for size in (0, 3, 100, len(data) // 2):
            with open(farm.path("cut.exr"), "wb") as out:
                out.write(data[:size])
            raised(exr.BadFile, exr.read, farm.path("cut.exr"))


@tests.add
def every_pass_is_filled():
    """all passes at once: the file has the channels of each; the denoised picture goes first, the rendered one is a pass; names of mattes"""
    numpy, exr, passes = modules_with_numpy()
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        every = passes.wanted(lambda flag: True)
        number = farm.submit(farm.scene(), "--size", "40x24", "--spp", "4", "--denoise", "on", "--aov", ",".join(passes.aovs(every)),
                             "--format", "exr")
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", "p.exr", expect=0)
        picture = exr.read(farm.path("p.exr"))
        raw, clean = (picture.layer(*(name + c for c in "RGB")) for name in ("", "denoised."))
        expect(passes.is_denoised(picture) and not numpy.array_equal(raw, clean), "not denoised")
        hashes = passes.crypto_fields(picture, "View é")
        passes.expose(picture, 2.0)
        expect(numpy.array_equal(passes.combined(picture)[..., :3], 2 * clean), "not the denoised picture, or not exposed")
        for one in every:
            values = one.make(picture)
            expect(values is not None and values.shape[2] == len(one.letters), one.name)
            expect(one.name != "Noisy Image" or numpy.array_equal(values[..., :3], 2 * raw), "the noisy image")
        expect(max(len(p.name) for p in every) < 64, "Blender cuts names of passes")
        for name, value in picture.attributes.items():  # the program's own key
            if name.startswith("cryptomatte/") and name.endswith("/name"):
                expect(name.split("/")[1] == ("%08x" % passes.murmur3(value.decode()))[:7], name)
        names = {text: field.split("/")[1] for field, text in hashes if field.endswith("/name")}
        expect(sorted(names) == ["View é.Crypto" + kind for kind in ("Asset", "Material", "Object")], names)
        manifest = dict(hashes)["cryptomatte/%s/manifest" % names["View é.CryptoMaterial"]]
        expect(all("%08x" % passes.murmur3(name) == word or int(word, 16) >> 23 & 255 in (0, 1, 254, 255)
                   for name, word in json.loads(manifest).items()), manifest)
        # Blender asks for levels, two a layer.
        objects = [p.name for p in passes.wanted(lambda flag: flag == "use_pass_cryptomatte_object", 4)]
        expect(objects == ["CryptoObject00", "CryptoObject01"], objects)


@tests.add
def one_zip_for_both_forms():
    """make blender-addon packs the sources with both descriptions, and the same bytes each time"""
    with Farm() as farm:
        for name in ("a.zip", "b.zip"):
            with open(os.path.join(ROOT, "Makefile"), encoding="utf-8") as makefile:
                version = next(l for l in makefile if l.startswith("VERSION :=")).split()[2]
            subprocess.run([sys.executable, os.path.join(ROOT, "deploy", "blender", "make_zip.py"), version, farm.path(name)], check=True)
        expect(read_bytes(farm.path("a.zip")) == read_bytes(farm.path("b.zip")), "other bytes")
        names = zipfile.ZipFile(farm.path("a.zip")).namelist()
        expect({"azulejo_render/__init__.py", "azulejo_render/blender_manifest.toml", "azulejo_render/export.py"} <= set(names) and
               all(n.startswith("azulejo_render/") for n in names), names)


tests.run()
