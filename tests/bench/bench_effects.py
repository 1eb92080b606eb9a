"""`make bench-effects`: does an effect that a scene lacks cost anything?

Each of ten scenes is rendered by the kernel that is shipped, and by one that is compiled for this scene, with
only its effects (Makefile: $(BUILD)/exact). Both programs have the same name and arguments and make the same
bits. The difference is to be at most 2 % of the time.

  make bench-effects                                       nine pairs of copies in turns, CPU time
  make bench-effects EFFECTS_ARGS='--instructions [SCENE]...'   callgrind's count, which no other work disturbs
"""
import hashlib
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import bench_farm  # noqa: F401  it says where `farm` is
from farm import BIN, BUILD, ROOT

MOST = 1.02
PAIRS = 9
TIMED, COUNTED = ["--size", "128x128", "--spp", "16"], ["--size", "32x32", "--spp", "4"]
SHIPPED = os.path.join(BUILD, "tests", "bench", "bench_render")


def scenes(sky):
    def of(path, *options):
        return os.path.join(ROOT, "scenes", path), list(options)
    return {
        "cornell-area": of("cornell/cornell-area.gltf"),
        "cornell-mirror": of("cornell/cornell-mirror.gltf", "--env", sky),
        "textured-spheres": of("studio/textured-spheres.gltf", "--env", sky),
        "many-lights": of("features/many-lights.gltf"),
        "alpha": of("features/alpha.gltf"),
        "glass": of("features/glass.gltf"),
        "normal-map": of("features/normal-map.gltf"),
        "clearcoat": of("features/clearcoat.gltf"),
        "sheen": of("features/sheen.gltf"),
        "media": of("features/media.pbrt"),
    }


def render(program, scene, options, size):
    out = subprocess.run([program, scene, "--json"] + options + size, check=True, capture_output=True, text=True)
    return json.loads(out.stdout)


def exact_program(run):
    """The program whose kernel has only the run's effects."""
    path = os.path.join(BUILD, "exact", run["effects"], run["kernel"] + "_bench_render")
    subprocess.run(["make", "-s", os.path.relpath(path, ROOT)], check=True, cwd=ROOT)
    return path


def digest(program, scene, options, folder):
    picture = os.path.join(folder, "picture.exr")
    render(program, scene, options + ["--out", picture], COUNTED)
    with open(picture, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def instructions(program, scene, options):
    out = subprocess.run(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--toggle-collect=render_tile",
                          program, scene] + options + COUNTED, check=True, capture_output=True, text=True)
    return int(re.search(r"Collected : (\d+)", out.stderr).group(1))


def time_ratios(programs, scene, options, folder):
    """Shipped over exact, of each pair of copies: where a file's pages lie in memory moves a ratio by per cents."""
    ratios = []
    for i in range(PAIRS):
        copies = [os.path.join(folder, "%d%s" % (i, kind)) for kind in "se"]
        for program, copy in zip(programs, copies):
            shutil.copy(program, copy)
        order = (0, 1) if i % 2 else (1, 0)
        runs = {k: render(copies[k], scene, options, TIMED) for k in order}
        ratios.append(runs[1]["samples_per_cpu_s"] / runs[0]["samples_per_cpu_s"])
    return sorted(ratios)


def main():
    count = "--instructions" in sys.argv[1:]
    wanted = [arg for arg in sys.argv[1:] if arg != "--instructions"]
    costly = []
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        sky = os.path.join(folder, "sky.exr")
        subprocess.run([os.path.join(BIN, "scenes", "sky", "make_sky"), "-o", sky], check=True, capture_output=True)
        print("| scene | kernel | %s |\n|---|---|---:|---:|" % (
            "its instructions over the exact kernel's | over the general one's" if count else
            "its time over the exact kernel's | 96 % of such medians"))
        for name, (scene, options) in scenes(sky).items():
            if wanted and name not in wanted:
                continue
            run = render(SHIPPED, scene, options, COUNTED)
            programs = [SHIPPED, exact_program(run)]
            if len({digest(program, scene, options, folder) for program in programs}) != 1:
                sys.exit("bench-effects: %s: the two kernels' bits differ" % name)
            if count:
                shipped, exact = (instructions(program, scene, options) for program in programs)
                ratio = shipped / exact
                text = "%.3f | %.3f" % (ratio, shipped / instructions(SHIPPED, scene, options + ["--general"]))
            else:
                ratios = time_ratios(programs, scene, options, folder)
                ratio = statistics.median(ratios)
                text = "%.3f | %.3f to %.3f" % (ratio, ratios[1], ratios[-2])
            print("| %s | %s | %s |" % (name, run["kernel"], text), flush=True)
            if ratio > MOST:
                costly.append(name)
    if costly:
        sys.exit("bench-effects: effects that they lack cost more than %.0f %%: %s" % (100 * (MOST - 1), ", ".join(costly)))


main()
