"""The report of `make bench`. Every table says what was run, so that it can be run again."""
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import bench_farm
import bench_auto  # after bench_farm, which says where `farm` is
from farm import BIN, BUILD, ROOT

DATA = os.environ.get("AZULEJO_DATA")
ROUNDS = 3
SIZE, SPP = "400x400", 16
GROUP_SIZE = "240x160"
KERNEL_SIZE, KERNEL_SPP, KERNEL_ROUNDS = "64x64", 8, 9
KERNEL_COPIES = 9
TABLES = ("renderer", "groups", "kernels", "threads", "memory", "preview", "merging", "tonemapping", "workers")


def output(*argv):
    try:
        return subprocess.run(argv, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=True,
                              universal_newlines=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""


def find(pattern, text, default="unknown"):
    found = re.search(pattern, text, re.MULTILINE)
    return found.group(1).strip() if found else default


def title(text):
    print("\n%s\n%s" % (text, "-" * len(text)), flush=True)


def median(values):
    return statistics.median(values)


def show_machine():
    with open("/proc/cpuinfo") as source:
        cpu = source.read()
    with open("/proc/meminfo") as source:
        memory = int(find(r"^MemTotal:\s+(\d+)", source.read(), "0")) / 1048576
    flags = find(r"^flags\s*: (.*)", cpu).split()
    title("Machine")
    print("CPU       %s (family %s, model %s), %d processors; load %.1f before the run" % (
        find(r"^model name\s*: (.*)", cpu), find(r"^cpu family\s*: (.*)", cpu),
        find(r"^model\s*: (.*)", cpu), os.cpu_count(), os.getloadavg()[0]))
    print("ISA       %s" % " ".join(f for f in ("avx2", "fma", "avx512f") if f in flags))
    print("memory    %.0f GiB" % memory)
    print("system    %s, Linux %s" % (
        find(r'^PRETTY_NAME="(.*)"', output("cat", "/etc/os-release")), os.uname().release))
    print("compiler  %s" % output(os.environ.get("CC", "cc"), "--version").split("\n")[0])
    print("Embree    %s" % find(r"embree ([0-9.]+)", output("strings", "-a", os.path.join(
        BIN, "azulejo-worker")), find(r"(libembree[0-9]+\.so\.[0-9.]+)",
                                     output("ldd", os.path.join(BIN, "azulejo-worker")))))


def bench_render(scene, *options, program=os.path.join(BUILD, "tests", "bench", "bench_render")):
    argv = [program, scene, "--json"]
    if "--size" not in options:
        argv += ["--size", SIZE]
    if "--spp" not in options:
        argv += ["--spp", str(SPP)]
    argv += options
    text = output(*argv)
    if not text:
        sys.exit("failed: " + " ".join(argv))
    return json.loads(text)


def show_renderer(scenes):
    title("The renderer alone: bench_render SCENE --size %s --spp %d, one thread, median of %d" % (
        SIZE, SPP, ROUNDS))
    print("%-18s %10s %10s %7s %8s %9s" % ("", "samples/", "rays/", "rays/", "Embree's", "BVH and"))
    print("%-18s %10s %10s %7s %8s %9s" % ("scene", "CPU-s", "CPU-s", "sample", "share", "tables s"))
    runs = {name: [] for name, _, _ in scenes}
    for _ in range(ROUNDS):  # in turn, so that the machine's moods meet all scenes
        for name, scene, options in scenes:
            runs[name].append(bench_render(scene, *options))
    for name, scene, options in scenes:
        traced = bench_render(scene, "--trace", *options)
        print("%-18s %10.0f %10.0f %7.2f %7.0f%% %9.3f" % (
            name, median([r["samples_per_cpu_s"] for r in runs[name]]),
            median([r["rays_per_cpu_s"] for r in runs[name]]), runs[name][0]["rays_per_sample"],
            100 * traced["trace_share"], median([r["build_s"] for r in runs[name]])), flush=True)
    print("(Embree's share: from a run of its own with --trace, clock readings included.)")


def show_effect_groups(groups):
    """A table of docs/PERFORMANCE.md; `report.py groups` prints it alone."""
    title("One scene for each group of effects: bench_render SCENE --size %s --spp %d, one thread, "
          "median of %d" % (GROUP_SIZE, SPP, ROUNDS))
    print("| group | kernel | samples / CPU-s | rays / CPU-s | rays a sample |")
    print("|---|---|---:|---:|---:|")
    for name, scene, options in groups:
        runs = [bench_render(scene, "--size", GROUP_SIZE, *options) for _ in range(ROUNDS)]
        print("| %s | %s | %.2f M | %.2f M | %.2f |" % (
            name, runs[0]["kernel"], median([r["samples_per_cpu_s"] for r in runs]) * 1e-6,
            median([r["rays_per_cpu_s"] for r in runs]) * 1e-6, runs[0]["rays_per_sample"]),
            flush=True)


def kernel_ratio(program, scene, options):
    argv = [program, scene, "--json", "--size", KERNEL_SIZE, "--spp", str(KERNEL_SPP),
            "--rounds", str(KERNEL_ROUNDS)] + options
    text = output(*argv)
    if not text.startswith("{"):
        sys.exit("failed: %s\n%s" % (" ".join(argv), text))
    return json.loads(text)


def show_kernels(scenes):
    """Time against the general kernel; `report.py kernels` prints it alone.

    Where a program's pages happen to lie in memory moves such a ratio by some per cent, for as long
    as the file is cached: so each scene is rendered by several copies of the program.
    """
    title("Each scene's own kernel against the general one: bench_kernels SCENE --size %s --spp %d "
          "--rounds %d, by %d copies of the program" % (KERNEL_SIZE, KERNEL_SPP, KERNEL_ROUNDS,
                                                        KERNEL_COPIES))
    print("| scene | kernel | its ns a sample | the general one's | share of its time | 96 % of such medians |")
    print("|---|---|---:|---:|---:|---|")
    slower = []
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-", dir=BUILD) as folder:
        copies = [os.path.join(folder, str(i)) for i in range(KERNEL_COPIES)]
        for copy in copies:
            shutil.copy(os.path.join(BUILD, "tests", "bench", "bench_kernels"), copy)
        for name, scene, options in scenes:
            runs = [kernel_ratio(copy, scene, options) for copy in copies]
            ratios = sorted(r["ratio"] for r in runs)
            print("| %s | %s | %.0f | %.0f | %.3f | %.3f to %.3f |" % (
                name, runs[0]["kernel"], median([r["ns"] for r in runs]),
                median([r["general_ns"] for r in runs]), median(ratios), ratios[1], ratios[-2]),
                flush=True)
            if median(ratios) > 1 and runs[0]["kernel"] != "general":  # that would be the same code
                slower.append(name)
    print("the general kernel is faster on: %s" % (", ".join(slower) or "none"))


def show_threads(name, scene, options):
    title("Two threads: %s, %d pairs" % (name, ROUNDS))
    speed, efficiency = [], []
    for _ in range(ROUNDS):
        one = bench_render(scene, "--threads", "1", *options)
        two = bench_render(scene, "--threads", "2", *options)
        speed.append(one["wall_s"] / two["wall_s"])
        efficiency.append(two["samples_per_cpu_s"] / one["samples_per_cpu_s"])
    print("speed-up by the clock %.2f   samples/CPU-s of two against one %.2f" % (
        median(speed), median(efficiency)))


def show_memory(scenes, empty):
    title("Memory of a worker with one thread: its peak against mesh + textures + BVH, MiB")
    options = ["--size", "64x64", "--spp", "4"]
    base = bench_farm.render(empty, options, 1)["peak_mib"]
    print("%-18s %8s %8s %8s %8s" % ("scene", "holds", "peak", "ratio", "less empty"))
    print("%-18s %8s %8.1f" % ("empty", "0", base))
    for name, scene, env in scenes:
        holds = bench_render(scene, *env)["scene_mib"]
        peak = bench_farm.render(scene, options + env, 1)["peak_mib"]
        print("%-18s %8.1f %8.1f %8.2f %8.2f" % (
            name, holds, peak, peak / holds, (peak - base) / holds), flush=True)


def show_preview(scene, options):
    title("From submission to the first preview: 640x360, 64 spp, a worker with 2 threads")
    times = [bench_farm.first_preview(scene, options) for _ in range(5)]
    print("nothing cached: accepted after %.2f s, preview on disk after %.2f s "
          "(median of 5; %.2f to %.2f s)" % (
              median([t[0] for t in times]), median([t[1] for t in times]),
              min(t[1] for t in times), max(t[1] for t in times)))


def show_merging():
    title("Merging: bench_merge, workers that answer at once, 1920x1080, 64 spp")
    for workers in (1, 8):
        runs = [bench_farm.merging(workers, 1) for _ in range(ROUNDS)]
        print("%d workers: %6.0f tiles/s merged, made durable and acknowledged; coordinator "
              "%.3f CPU-s a thousand (median of %d)" % (
                  workers, median([r[0] for r in runs]), median([r[1] for r in runs]), ROUNDS),
              flush=True)


def show_workers(name, scene, options):
    title("Two workers of one thread each: %s, 400x400, 32 spp, %d pairs" % (name, ROUNDS))
    options = ["--size", "400x400", "--spp", "32"] + options
    alone, one, two = [], [], []
    for _ in range(ROUNDS):
        alone.append(bench_render(scene, *options)["cpu_s"])
        one.append(bench_farm.render(scene, options, 1))
        two.append(bench_farm.render(scene, options, 2))
    print("speed-up by the clock, from submission to the end  %.2f" %
          median([a["seconds"] / b["seconds"] for a, b in zip(one, two)]))
    print("CPU-s: the renderer alone %.2f, one worker %.2f, two workers %.2f, coordinator %.2f" % (
        median(alone), median([r["worker_cpu"] for r in one]),
        median([r["worker_cpu"] for r in two]), median([r["coordinator_cpu"] for r in two])))


def feature(name):
    return os.path.join(ROOT, "scenes/features", name)


def kernel_scenes(scenes, sky):
    """Some for each variant; the last one calls for what only the general one has."""
    return scenes + [
        ("cornell-area under a sky", os.path.join(ROOT, "scenes/cornell/cornell-area.gltf"),
         ["--env", sky]),
        ("normal-map", feature("normal-map.gltf"), []),
        ("many-lights", feature("many-lights.gltf"), []),
        ("alpha", feature("alpha.gltf"), []),
        ("glass", feature("glass.gltf"), []),
        ("thin-transmission", feature("thin-transmission.gltf"), []),
        ("fog: nothing to leave out", feature("fog.pbrt"), []),
    ]


def effect_groups(sky):
    return [
        ("layered materials", feature("clearcoat.gltf"), []),
        ("sheen", feature("sheen.gltf"), []),
        ("glass", feature("glass.gltf"), []),
        ("glass with dispersion", feature("dispersion.gltf"), []),
        ("glass in glass", feature("nested.gltf"), []),
        ("metals", feature("conductor.pbrt"), []),
        ("mixes", feature("mix.pbrt"), []),
        ("textures, filtered", feature("texture-filter.gltf"), []),
        ("normal maps", feature("normal-map.gltf"), []),
        ("alpha", feature("alpha.gltf"), []),
        ("many lights", feature("many-lights.gltf"), []),
        ("environment with a sun, a portal", feature("portal.pbrt"), ["--env", sky]),
        ("panorama", feature("panorama.pbrt"), []),
        ("lens", feature("lens.pbrt"), []),
        ("motion blur", feature("motion.gltf"), ["--shutter", "0.5", "--frame", "6"]),
        ("skins and morphs, blurred", feature("deformation.gltf"),
         ["--shutter", "0.5", "--frame", "6"]),
        ("fog", feature("fog.pbrt"), []),
        ("media, one of them a grid", feature("media.pbrt"), []),
        ("output variables, all", feature("normal-map.gltf"), ["--aovs"]),
    ]


def show_tonemapping():
    title("Tone mapping: bench_tonemap, a frame's whole development, median of %d" % ROUNDS)
    program = os.path.join(BUILD, "tests", "bench", "bench_tonemap")
    columns = [(size, threads) for size in ("1920x1080", "3840x2160") for threads in (1, 0)]
    table = {}
    for size, threads in columns:
        argv = [program, "--size", size, "--threads", str(threads), "--rounds", str(ROUNDS)]
        for line in output(*argv).splitlines():
            run = json.loads(line)
            table.setdefault(run["operator"], []).append(run)
    if not table:
        sys.exit("failed: " + program)
    print("%-14s%18s%18s" % ("Mpixel/s", columns[0][0], columns[2][0]))
    print("%-14s%s%9s" % ("threads", 2 * ("%9s%9s" % (1, os.cpu_count())), "CPU-s 4K"))
    for name, runs in table.items():
        print("%-14s%s%9.2f" % (name, "".join("%9.1f" % r["mpixel_per_s"] for r in runs),
                                runs[-1]["cpu_s"]), flush=True)


def main():
    if not (sys.argv[1:2] == ["auto"] or set(sys.argv[1:]) <= set(TABLES)):
        sys.exit("usage: report.py [%s]... | auto [SCENE]..." % " | ".join(TABLES))
    if not os.path.exists(os.path.join(BUILD, "tests", "bench", "bench_render")):
        sys.exit("make bench: %s is not built" % BUILD)
    with tempfile.TemporaryDirectory(prefix="azulejo-bench-") as folder:
        sky = os.path.join(folder, "sky.exr")
        output(os.path.join(BIN, "scenes", "sky", "make_sky"), "-o", sky)
        made = {}
        for kind in ("empty", "instances", "large"):
            made[kind] = os.path.join(folder, kind + ".gltf")
            output(sys.executable, "-B", os.path.join(ROOT, "tests", "bench", "make_scenes.py"),
                   kind, made[kind])
        scenes = [
            ("cornell-area", os.path.join(ROOT, "scenes/cornell/cornell-area.gltf"), []),
            ("cornell-mirror", os.path.join(ROOT, "scenes/cornell/cornell-mirror.gltf"),
             ["--env", sky]),
            ("textured-spheres", os.path.join(ROOT, "scenes/studio/textured-spheres.gltf"),
             ["--env", sky]),
            ("instances", made["instances"], []),
        ]
        large = [("large", made["large"], [])]
        if DATA:
            helmet = ("DamagedHelmet", os.path.join(DATA, "gltf/DamagedHelmet/DamagedHelmet.glb"),
                      ["--env", os.path.join(DATA, "hdri/chinese_garden_1k.hdr")])
            scenes.append(helmet)
            large.append(helmet)
        spheres = scenes[2]
        show_machine()
        if sys.argv[1:2] == ["auto"]:
            bench_auto.show_auto(title, sys.argv[2:])
            return
        tables = {
            "renderer": lambda: show_renderer(scenes),
            "groups": lambda: show_effect_groups(effect_groups(sky)),
            "kernels": lambda: show_kernels(kernel_scenes(scenes, sky)),
            "threads": lambda: show_threads(*spheres),
            "memory": lambda: show_memory([spheres] + large, made["empty"]),
            "preview": lambda: show_preview(spheres[1], spheres[2] + ["--size", "640x360", "--spp", "64"]),
            "merging": show_merging,
            "tonemapping": show_tonemapping,
            "workers": lambda: show_workers(*spheres),
        }
        for name in sys.argv[1:] or tables:
            tables[name]()


main()
