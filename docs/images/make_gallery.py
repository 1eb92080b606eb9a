#!/usr/bin/env python3
"""Make the pictures of docs/GALLERY.md again, and the page: `make gallery`.

    AZULEJO_DATA=../shared/data docs/images/make_gallery.py [--work FOLDER] [NAME...]

Renders each picture (all, without a NAME) from the data folder and scenes/, tone maps it, writes the JPEG, notes the command, time,
samples and error in docs/images/gallery/gallery.json, and writes docs/GALLERY.md. The films stay in the work folder (out/gallery):
a picture whose film was made by the same command is only developed again. The table of pictures is gallery_pictures.py; a JPEG's
quality is the best that fits the picture's limit. Needs netpbm and cjpeg (libjpeg). BUILD names the build tree.

    --draft SPP   small pictures of so many samples, and a sheet of them, in the work folder only
    --scenes      only write the scenes that put a model into a setting
    --page        only write the page
    --check       is the page what the table and the record make, and is every picture there and small enough? Needs no data."""
import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from array import array

sys.dont_write_bytecode = True
HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
sys.path.insert(0, HERE)

sys.path.insert(0, os.path.join(ROOT, "tests", "farm"))

from exr import read_exr  # noqa: E402
from gallery_pictures import PICTURES  # noqa: E402

GALLERY = os.path.join(HERE, "gallery")
RECORD = os.path.join(GALLERY, "gallery.json")
PAGE = os.path.join(ROOT, "docs", "GALLERY.md")
WORK = "out/gallery"
INTRODUCTION = """# Gallery

%(count)d pictures, each with its command, its time and its error. An error of 3/255 means: in 95 %% of the pixels, no colour is more than 3 of 255
steps away from the picture of infinitely many samples, as displayed. A picture is rendered until it is as good as asked for, or until
its core time is spent; what ended at the time says so by its larger error.

Times are core time on a shared Intel Xeon (family 6, model 167, two cores), which was busy. The models and maps belong to others:
credit and licence stand below each picture. `make gallery` makes them all again, if `AZULEJO_DATA` names a folder that has the
[Khronos sample assets](https://github.com/KhronosGroup/glTF-Sample-Assets) in `gltf`, maps of [Poly Haven](https://polyhaven.com) in `hdri`
and Benedikt Bitterli's [scenes](https://benedikt-bitterli.me/resources/) for pbrt-v4 in `pbrt`. [SCENES.md](SCENES.md) lists what every scene of that
folder shows.
"""


def word_of(job):
    return "reliable" if job["now"]["figures"]["reliable"] else "may be understated"


class Maker:
    def __init__(self, data, work):
        self.data, self.work = os.path.abspath(data), os.path.abspath(work)
        self.azulejo = os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "bin", "azulejo")
        os.makedirs(self.work, exist_ok=True)

    def real(self, words):
        """The words of a command as they are shown, for this machine's folders."""
        return [w.replace("$AZULEJO_DATA", self.data).replace(WORK, self.work) for w in words]

    def scene(self, picture):
        """The scene's file as the command shows it; written if it is a setting."""
        if not callable(picture.scene):
            return picture.scene.replace("@", "$AZULEJO_DATA"), []
        setting = picture.scene(self.data, self.work)
        name = picture.name + setting.ending
        setting.write(os.path.join(self.work, name))
        return "%s/%s" % (WORK, name), setting.options

    def command(self, picture, draft=False):
        scene, more = self.scene(picture)
        words = ["render", scene, *more, *shlex.split(picture.options.replace("@/", "$AZULEJO_DATA/"))]
        if draft:
            w, h = map(int, picture.size.split("x"))
            words += ["--size", "%dx%d" % (round(240 * w / max(w, h)), round(240 * h / max(w, h))), "--spp", str(draft)]
        else:
            words += ["--size", picture.size, "--target-error", picture.error, "--core-limit", "%gm" % picture.limit]
        return words + shlex.split(picture.tonemap) + ["-o", "%s/%s%s" % (WORK, "draft/" if draft else "", picture.name)]

    def render(self, words):
        run = subprocess.run(["nice", "-n", "10", self.azulejo, *self.real(words), "--format", "exr", "--json", "--quiet"],
                             cwd=ROOT, stdout=subprocess.PIPE)
        if run.returncode not in (0, 9):  # 9: the limit ended it above the target
            run.check_returncode()
        return json.loads(run.stdout)

    def film(self, picture, words):
        """What is noted about the film: rendered now, or before by the same command."""
        note = os.path.join(self.work, picture.name + ".json")
        if os.path.exists(note):
            kept = json.load(open(note))
            if kept["command"] == words:
                return kept
        print("rendering", picture.name, flush=True)
        self.prepare(picture)
        started = time.time()
        job = self.render(words)["job"]
        width, height = map(int, picture.size.split("x"))
        frames = max(1, job["frames_done"])
        kept = {"command": words, "samples": round(job["work"]["samples"] / (width * height * frames)),
                "core_seconds": round(job["stats"]["cpu_ns"] / 1e9), "wall_seconds": round(time.time() - started),
                "display_error": round(job["now"]["figures"]["display"], 1), "word": word_of(job)}
        json.dump(kept, open(note, "w"), indent=1)
        return kept

    def prepare(self, picture):
        """Run what makes the picture's map, if its file is not there."""
        for command in picture.before:
            words = self.real(shlex.split(command))
            if not os.path.exists(words[-1]):
                subprocess.run([os.path.join(ROOT, words[0]), *words[1:]], cwd=ROOT, check=True)

    def encode(self, picture, source, out):
        """The best JPEG of `source` that is not larger than the picture's limit."""
        for quality in (94, 92, 90, 87, 84, 80, 75, 70, 64, 58, 50):
            with open(out, "wb") as jpeg:
                subprocess.run(["cjpeg", "-quality", str(quality), "-optimize", "-progressive", source],
                               stdout=jpeg, check=True)
            if os.path.getsize(out) < picture.largest * 1000:
                return
        raise SystemExit("%s: no quality makes it smaller than %d KB" % (out, picture.largest))

    def develop(self, picture, film):
        """Tone map an EXR into a PPM file; returns its path."""
        png, ppm = film[:-4] + ".png", film[:-4] + ".ppm"
        subprocess.run([self.azulejo, "tonemap", film, *shlex.split(picture.tonemap), "-o", png], cwd=ROOT, check=True,
                       stdout=subprocess.DEVNULL)
        with open(ppm, "wb") as out:
            subprocess.run(["pngtopnm", png], stdout=out, check=True)
        return ppm

    def films(self, base):
        folder, name = os.path.split(base)
        return sorted(os.path.join(folder, f) for f in os.listdir(folder)
                      if f.endswith(".exr") and (f == name + ".exr" or f.startswith(name + ".") or f.startswith(name + "-")))

    def operators(self, picture):
        """A sheet of another picture's film by several operators."""
        words = ["tonemap", "%s/%s.exr" % (WORK, picture.of), *shlex.split(picture.options), "-o", "%s/%s.png" % (WORK, picture.name)]
        subprocess.run([self.azulejo, *self.real(words)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        out = os.path.join(self.work, picture.name + ".pnm")
        with open(out, "wb") as pnm:
            subprocess.run(["pngtopnm", os.path.join(self.work, picture.name + ".png")], stdout=pnm, check=True)
        return {"command": words}, out

    def make(self, picture):
        """Make one picture; returns what is noted about it."""
        out = os.path.join(self.work, picture.name + "-sheet.pnm")
        if picture.kind == "operators":
            kept, out = self.operators(picture)
        else:
            kept = self.film(picture, self.command(picture))
            films = self.films(os.path.join(self.work, picture.name))
            parts = [self.develop(picture, f) for f in films]
            if picture.kind == "layers":
                parts += layers(films[0], os.path.join(self.work, picture.name))
            sheet(parts, 1 if picture.kind == "picture" else 3, out)
        self.encode(picture, out, os.path.join(HERE, picture.file))
        return kept

    def draft(self, pictures, samples):
        os.makedirs(os.path.join(self.work, "draft"), exist_ok=True)
        parts = []
        for picture in pictures:
            words = self.command(picture, samples)
            base = self.real([words[-1]])[0]
            job = self.render(words)["job"]
            print("%-12s error %6.1f %s after %d spp, %.1f core-seconds" % (
                picture.name, job["now"]["figures"]["display"], word_of(job), samples, job["stats"]["cpu_ns"] / 1e9), flush=True)
            parts += [self.develop(picture, f) for f in self.films(base)]
        sheet(parts, 4, os.path.join(self.work, "draft", "sheet.pnm"))
        with open(os.path.join(self.work, "draft", "sheet.png"), "wb") as out:
            subprocess.run(["pnmtopng", os.path.join(self.work, "draft", "sheet.pnm")], stdout=out, check=True, stderr=subprocess.DEVNULL)


def sheet(parts, columns, out):
    """Lay PPM files out in rows of so many."""
    rows = []
    for at in range(0, len(parts), columns):
        rows.append("%s.row%d" % (out, at))
        with open(rows[-1], "wb") as row:
            subprocess.run(["pnmcat", "-lr", "-jcenter", *parts[at:at + columns]], stdout=row, check=True)
    with open(out, "wb") as whole:
        subprocess.run(["pnmcat", "-tb", "-jleft", *rows], stdout=whole, check=True)
    for row in rows:
        os.remove(row)


def layers(film, base):
    """Albedo, normals, depth, samples and error of a film as PPM files."""
    picture = read_exr(film)

    def plane(name):
        return array("f", picture.channels[name])

    def encoded(x):
        x = min(max(x, 0.0), 1.0)
        return 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055

    def scaled(values):
        ordered = sorted(v for v in values if v > 0)
        low, high = ordered[len(ordered) // 100], ordered[len(ordered) * 99 // 100]
        return [min(max((v - low) / (high - low), 0.0), 1.0) if v > 0 else 1.0 for v in values]

    error = [max(c) for c in zip(*(plane("error." + c) for c in "RGB"))]
    panels = {
        "albedo": [[encoded(v) for v in plane("albedo." + c)] for c in "RGB"],
        "normal": [[0.5 + 0.5 * v for v in plane("N." + c)] for c in "XYZ"],
        "depth": [[1 - v for v in scaled(plane("Z"))]] * 3,
        "samples": [[encoded(v) for v in scaled(plane("samples.Y"))]] * 3,
        "error": [[encoded(v) for v in scaled(error)]] * 3}
    made = []
    for name, planes in panels.items():
        made.append("%s-%s.ppm" % (base, name))
        with open(made[-1], "wb") as out:
            out.write(b"P6 %d %d 255\n" % (picture.width, picture.height))
            out.write(bytes(min(max(round(255 * v), 0), 255) for pixel in zip(*planes) for v in pixel))
    return made


# ---- the page --------------------------------------------------------------------------------------------------

def shown(program, words):
    """A command over several lines, each of which fits a screen."""
    parts, line, units = [], program, []
    for word in words:
        quoted = word if word.startswith("$") else shlex.quote(word)
        if units and units[-1].startswith("-") and " " not in units[-1] and not word.startswith("-"):
            units[-1] += " " + quoted
        else:
            units.append(quoted)
    for unit in units:
        if len(line) + len(unit) > 88:
            parts.append(line)
            line = "   "
        line += " " + unit
    return " \\\n".join(parts + [line])


def figures(picture, note):
    """The line of figures below a picture."""
    if "display_error" not in note:
        return ""
    seconds = note["core_seconds"]
    time_spent = "%d core-seconds" % seconds if seconds < 100 else "%.1f core-minutes" % (seconds / 60)
    each, which = (" a frame", " in the last frame") if picture.kind == "strip" else ("", "")
    return "*Error %.1f/255%s%s, %d samples a pixel, %s, %s pixels%s.*" % (
        note["display_error"], which, "" if note["word"] == "reliable" else " (may be understated)", note["samples"], time_spent,
        picture.size.replace("x", " x "), each)


def section(picture, note):
    words = note["command"]
    commands = [shown(c[0], c[1:]) for c in map(shlex.split, picture.before)]
    if callable(picture.scene):
        commands.append("docs/images/make_gallery.py --scenes %s    # writes the scene" % picture.name)
    commands.append(shown("azulejo", words))
    reason = ("needs the film of the first picture" if picture.of else
              "needs AZULEJO_DATA" if callable(picture.scene) or "AZULEJO_DATA" in " ".join(words) else "takes minutes")
    lines = ["", "## " + picture.title, "", "![%s](images/%s)" % (picture.alt, picture.file), "", picture.words, "",
             figures(picture, note), picture.credit, "", "<details><summary>Command</summary>", "",
             "<!-- not run: %s -->" % reason,
             "```sh", *commands, "```", "", "</details>"]
    return "\n".join(line for n, line in enumerate(lines) if line or lines[n - 1]) + "\n"


def page(record):
    made = [p for p in PICTURES if p.name in record]
    return INTRODUCTION % {"count": len(made)} + "".join(section(p, record[p.name]) for p in made)


def check(record):
    """What is wrong with the page and the pictures, in words."""
    faults = []
    for picture in PICTURES:
        path = os.path.join(HERE, picture.file)
        if picture.name not in record:
            continue
        if not os.path.exists(path):
            faults.append("docs/images/%s is missing: make_gallery.py %s makes it" % (picture.file, picture.name))
        elif os.path.getsize(path) > picture.largest * 1000:
            faults.append("docs/images/%s is larger than %d KB" % (picture.file, picture.largest))
    if len(record) < 16:
        faults.append("docs/images/gallery/gallery.json notes %d pictures, fewer than 16" % len(record))
    unknown = set(record) - {p.name for p in PICTURES}
    if unknown:
        faults.append("docs/images/gallery/gallery.json notes what is not in the table: " + ", ".join(sorted(unknown)))
    with open(PAGE) as text:
        if text.read() != page(record):
            faults.append("docs/GALLERY.md differs from the table and the record: docs/images/make_gallery.py --page writes it again")
    return faults


def read_record():
    if not os.path.exists(RECORD):
        return {}
    with open(RECORD) as text:
        return json.load(text)


def write_page(record):
    with open(PAGE, "w") as out:
        out.write(page(record))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--work", default=os.path.join(ROOT, WORK), help="where films are kept")
    parser.add_argument("--draft", type=int, metavar="SPP", help="small pictures of so many samples, and a sheet of them")
    parser.add_argument("--scenes", action="store_true", help="only write the settings")
    parser.add_argument("--page", action="store_true", help="only write the page")
    parser.add_argument("--check", action="store_true", help="does the page agree with the table and the record?")
    parser.add_argument("names", nargs="*", metavar="NAME")
    arguments = parser.parse_args()
    table = {p.name: p for p in PICTURES}
    for name in arguments.names:
        if name not in table:
            parser.error("there is no picture '%s'; there are %s" % (name, ", ".join(table)))
    if arguments.check:
        faults = check(read_record())
        print("\n".join(faults) or "the gallery's page, record and pictures agree")
        return 1 if faults else 0
    if arguments.page:
        return write_page(read_record())
    if "AZULEJO_DATA" not in os.environ:
        parser.error("AZULEJO_DATA names the folder of the models and maps; it is not set")
    missing = [t for t in ("cjpeg", "pngtopnm", "pnmcat", "pnmtopng") if not shutil.which(t)]
    if missing:
        parser.error("there is no %s: install netpbm and libjpeg-turbo-progs" % ", ".join(missing))
    maker = Maker(os.environ["AZULEJO_DATA"], arguments.work)
    chosen = [table[name] for name in arguments.names or table]
    if arguments.draft:
        return maker.draft(chosen, arguments.draft)
    for picture in chosen:
        if arguments.scenes:
            maker.scene(picture)
            continue
        note = maker.make(picture)
        record = {**read_record(), picture.name: note}
        with open(RECORD, "w") as out:
            json.dump({p.name: record[p.name] for p in PICTURES if p.name in record}, out, indent=1)
            out.write("\n")
        write_page(record)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except FileNotFoundError as error:
        sys.exit("make_gallery.py: %s: there is no such file; does AZULEJO_DATA name the folder of the data?" % error.filename)
    except subprocess.CalledProcessError as error:
        sys.exit("make_gallery.py: this command failed: " + shlex.join(error.cmd))
