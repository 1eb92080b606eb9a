"""What `azulejo submit` is told, and what its answers say. No bpy in here."""
import math
import re

from . import scene_fix

SEED_MOST = (1 << 31) - 1
FILTER_WIDTH_MOST = 16.0  # pixels
# Azulejo's name of each of Cycles' pixel filters, and its whole width where Cycles' is 1. Cycles' Gaussian has a standard
# deviation of a quarter of its width; Azulejo's is six of them wide.
FILTERS = {"BLACKMAN_HARRIS": ("blackman-harris", 2.0), "GAUSSIAN": ("gaussian", 1.5), "BOX": ("box", 1.0)}


def seconds(number):
    """A time option's value."""
    return "%gs" % number


def region(camera, size, border):
    """(whole width, whole height, None or (x, y, width, height)) in Azulejo's pixels, from the upper left corner.

    border: None, or (x, y, width, height) within `size` in Blender's pixels, from the lower left corner."""
    width, height = size
    whole_width, whole_height, x, y = scene_fix.widened(camera, width, height)
    if border:
        bx, by, bw, bh = border
        return whole_width, whole_height, (x + bx, y + height - by - bh, bw, bh)
    if (whole_width, whole_height) != (width, height):
        return whole_width, whole_height, (x, y, width, height)
    return width, height, None


def border_pixels(size, low_x, low_y, high_x, high_y):
    """Blender's rectangle for a border of these shares of the picture, as its own C code rounds it."""
    width, height = size
    x, y = int(low_x * width + 1e-4), int(low_y * height + 1e-4)
    return x, y, max(int(high_x * width + 1e-4) - x, 1), max(int(high_y * height + 1e-4) - y, 1)


def pixel_filter(kind, width):
    """(Azulejo's name, its whole width in pixels) of Cycles' filter; None: one that is not known. Cycles' box has always one pixel."""
    if kind not in FILTERS:
        return None
    name, times = FILTERS[kind]
    return name, times * (1.0 if kind == "BOX" else width)


def submit_words(settings, exported, size, border):
    """The words after `azulejo submit` but for the coordinator's.

    settings: {samples, target_error, time_limit_s, max_depth, seed, frame, shutter, transparent, aovs, denoise, name, priority,
    filter: None, or what pixel_filter() returns}"""
    found, env = exported["scene"], exported["env"]
    camera = found["camera"]
    width, height, part = region(camera, size, border)
    words = [exported["gltf"], "--json", "--quiet", "--name", settings["name"], "--format", "exr", "--light-units", "radiometric",
             "--frames", "%d" % (settings["frame"] if settings["shutter"] > 0 else 1), "--fps", "1", "--size", "%dx%d" % (width, height), "--max-depth", "%d" % settings["max_depth"],
             "--seed", "%d" % ((settings["seed"] + settings["frame"]) & SEED_MOST), "--lens", "%.9g" % camera["lens_radius"],
             "--env", env["file"], "--env-strength", "%.9g" % env["strength"], "--env-rotate", "%.9g" % env["rotate_deg"]]
    if camera["lens_radius"] > 0:
        words += ["--focus", "%.9g" % camera["focus"]]
    if settings["shutter"] > 0:
        words += ["--shutter", "%.9g" % settings["shutter"]]
    if part:
        words += ["--region", "%d,%d,%d,%d" % part]
    if settings["samples"] > 0:
        words += ["--spp", "%d" % settings["samples"]]
    if settings["target_error"]:
        words += ["--target-error", settings["target_error"]]
    if settings["time_limit_s"] > 0:
        words += ["--time-limit", seconds(settings["time_limit_s"])]
    if settings["filter"]:
        name, width = settings["filter"]
        words += ["--pixel-filter", name, "--filter-width", "%.9g" % min(width, FILTER_WIDTH_MOST)]
    if settings["transparent"]:
        words += ["--alpha"]
    if settings["aovs"]:
        words += ["--aov", ",".join(settings["aovs"])]
    if settings["denoise"] != "off":
        words += ["--denoise", settings["denoise"]]
    if settings["priority"]:
        words += ["--priority", "%d" % settings["priority"]]
    return words


def wrong(settings):
    """What is wrong with the panel's values, in one sentence; None: nothing."""
    if settings["samples"] <= 0 and not settings["target_error"] and settings["time_limit_s"] <= 0:
        return "give samples, a target error or a time limit: nothing says when the picture is done"
    if settings["target_error"] and not re.fullmatch(r"[0-9.]+(/255|%|dB)", settings["target_error"]):
        return "the target error is '%s': write it as 2/255, 1%% or 45dB" % settings["target_error"]
    return None


def duration(number):
    number = max(int(number + 0.5), 0)
    if number < 60:
        return "%d s" % number
    if number < 3600:
        return "%d:%02d min" % divmod(number, 60)
    return "%d:%02d h" % (number // 3600, number % 3600 // 60)


def known(value):
    return isinstance(value, (int, float)) and math.isfinite(value)


def progress(job):
    """(share done 0..1, the line for the status bar) of what `azulejo show --json` prints."""
    share = job.get("done_share") or 0
    samples, total = job.get("samples_done") or 0, job.get("samples_total") or 0
    if not share and total > 0 and (job.get("settings") or {}).get("spp", 0) < 1 << 20:
        share = samples / total
    settings = job.get("settings") or {}
    words = []
    pixels = (settings.get("width") or 0) * (settings.get("height") or 0)
    if job.get("state") != "running":
        words.append(job.get("state_text") or job.get("state") or "")
    elif pixels:
        words.append("%.3g samples a pixel" % (samples / pixels))
    display = ((job.get("now") or {}).get("figures") or {}).get("display")
    if known(display) and display > 0:
        words.append("error %.2g/255" % display)
    noisy, clean = ((((job.get("now") or {}).get(name) or {}).get("rmse_percent")) for name in ("figures", "denoised"))
    if known(noisy) and known(clean):
        words.append("RMSE %.2g %%, denoised %.2g %%" % (noisy, clean))
    left = job.get("seconds_left")
    if known(left) and left >= 0 and job.get("state") == "running":
        words.append("%s left" % duration(left))
    workers = job.get("workers")
    if job.get("state") == "running" and workers is not None:
        words.append("%d worker%s" % (workers, "" if workers == 1 else "s") if workers else "waits for a worker")
    return min(max(share, 0.0), 1.0), " | ".join(w for w in words if w)


def complaint(stderr, code):
    """The last line that a command wrote, without its own name; never empty."""
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    text = lines[-1] if lines else ""
    text = re.sub(r"^azulejo(-[a-z]+)?( [a-z-]+)?: ", "", re.sub(r"^\S+Z (error|fatal|warning) azulejo-[a-z]+: ", "", text))
    return text or "azulejo ended with status %d and said nothing" % code


def warnings(stderr):
    """Warnings of an import, for the report."""
    return [m.group(1) for m in re.finditer(r"^(?:azulejo [a-z]+: )?warning: (.*)$", stderr, re.M)]
