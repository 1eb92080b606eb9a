"""The documents: what they name exists (scripts/check-docs.py), and their commands run as they stand, on a small scale
(tests/farm/doc_shim.py). A block that cannot be run is marked with the reason."""
import contextlib
import functools
import importlib.util
import io
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "scripts"))
from documents import load, tracked
from farm import BIN, BUILD, PATIENCE, Farm, Failure, Skip, Tests, wait_for
from jobs import expect

tests = Tests()
SLOW = os.environ.get("DOCS") == "all"     # make test-docs
LIMIT_S = 600 if SLOW else 300     # what takes longer hangs
CHECK = os.path.join(ROOT, "scripts", "check-docs.py")
SHIM = os.path.join(ROOT, "tests", "farm", "doc_shim.py")
FARM_VERBS = set("""submit list show watch fetch develop cancel extend start pause resume finish priority retry remove log prune trace gc
    top workers token""".split())
# Folders that commands read from. Scenes may not be links: a scene reads only below its own folder.
COPIED = ("scenes", "deploy")


def check(root):
    return subprocess.run([sys.executable, "-B", CHECK, "--root", root, "--bin", BIN], capture_output=True, text=True, check=False)


def checker():
    """A function that checks a tree as the script does, and asks the programs for their options only once."""
    spec = importlib.util.spec_from_file_location("check_docs", CHECK)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.Tables = functools.lru_cache(script.Tables)

    def run(root):
        out, sys.argv = io.StringIO(), [CHECK, "--root", root, "--bin", BIN]
        with contextlib.redirect_stdout(out):
            failed = script.main()
        return subprocess.CompletedProcess(sys.argv, int(failed), out.getvalue(), "")
    return run


# ---- the checker -------------------------------------------------------------------------------------------------

@tests.add
def all_names_exist():
    """links, anchors, pictures, files, commands and options of every document exist"""
    done = check(ROOT)
    expect(done.returncode == 0, done.stdout + done.stderr)
    counts = dict((name, int(number)) for number, name in re.findall(r"(\d+) (\w+)", done.stdout))
    expect(counts["links"] > 100 and counts["pictures"] > 20 and counts["commands"] > 200 and counts["blocks"] > 25, done.stdout)


GOOD = """# Title

See [below](#what-it-does), [the other](docs/other.md#a-part) and ![a picture](docs/images/a.png).

## What it does

`azulejo render SCENE --size 64x64`, `make demo`, `docs/other.md`.

```sh
azulejo=build/release/bin/azulejo    # or `make install`
$azulejo render docs/a.gltf --tonemap agx && make demo JOBS=2 | grep -c a   # --no-such-option in a comment
azulejo token create --role view \\
    --name x
```
"""

FAULTS = (
    ("docs/other.md#a-part", "docs/missing.md", "there is no docs/missing.md"),
    ("docs/other.md#a-part", "docs/other.md#no-part", "no heading with the anchor '#no-part'"),
    ("#what-it-does", "#what-it-did", "no heading with the anchor '#what-it-did'"),
    ("![a picture](docs/images/a.png)", "<img src=\"docs/images/b.png\">", "there is no docs/images/b.png"),
    ("![a picture](docs/images/a.png)", "a picture", "docs/images/a.png: no document shows this picture"),
    ("--size 64x64", "--sise 64x64", "azulejo render has no option --sise"),
    ("`make demo`", "`make dema`", "the Makefile has no target 'dema'"),
    ("`docs/other.md`", "`docs/others.md`", "there is no file docs/others.md"),
    ("$azulejo render", "$azulejo rendre", "azulejo has no command 'rendre'"),
    ("docs/a.gltf", "docs/b.gltf", "there is no file docs/b.gltf"),
    ("--tonemap agx", "--tonemap agfa", "--tonemap has no value 'agfa'"),
    ("&& make demo", "&& make deme", "the Makefile has no target 'deme'"),
    ("JOBS=2", "JOPS=2", "the Makefile does not use JOPS"),
    ("grep -c a", "grab -c a", "no program 'grab' is known"),
    ("token create", "token invent", "azulejo token has no 'invent'"),
    ("    --name x", "    --nome x", "azulejo token has no option --nome"),
    ("   # --no-such", "   " + 60 * "#" + " --no-such", "a command of "),
    ("```sh\n", "```\n", "this block looks like commands"),
    ("```sh\nazulejo=", "<!-- not run: -->\n```sh\nazulejo=", "'not run' needs a reason"),
    ("```sh\nazulejo=", "<!-- run by: docs/other.md -->\n```sh\nazulejo=", "does not name README.md"),
)


@tests.add
def each_fault_is_found():
    """a broken link, anchor, picture, file, program, command, option, value, target or mark: each is found, and nothing else"""
    with Farm() as farm:
        check_again = checker()
        root = farm.path("tree")
        os.makedirs(os.path.join(root, "docs", "images"))
        for name, text in (("docs/other.md", "# Other\n\n## A part\n"), ("docs/images/a.png", ""), ("docs/a.gltf", ""),
                           ("Makefile", "demo: all ## it\n\t@echo $(JOBS)\n")):
            with open(os.path.join(root, name), "w", encoding="utf-8") as file:
                file.write(text)
        for right, wrong, words in (("", "", None),) + FAULTS:
            expect(right in GOOD, right)
            with open(os.path.join(root, "README.md"), "w", encoding="utf-8") as file:
                file.write(GOOD.replace(right, wrong, 1) if right else GOOD)
            done = check_again(root)
            if words is None:
                expect(done.returncode == 0, done.stdout + done.stderr)
            else:
                expect(done.returncode == 1 and words in done.stdout, "%s -> %s: %s %s" % (right, wrong, done.stdout, done.stderr))
        with open(os.path.join(root, "README.md"), "w", encoding="utf-8") as file:
            file.write(GOOD)
        with open(os.path.join(root, "docs", "images", "a.png"), "wb") as file:
            file.write(bytes(400001))
        done = check(root)
        expect(done.returncode == 1 and "docs/images/a.png: larger than 400 kB" in done.stdout, done.stdout)


@tests.add
def dependencies_are_listed():
    """docs/INSTALL.md names every package that scripts/install-deps.sh installs"""
    with open(os.path.join(ROOT, "scripts", "install-deps.sh"), encoding="utf-8") as file:
        text = file.read()
    packages = " ".join(re.findall(r"debian\+?=\(([^)]*)\)", text)).split()
    expect(len(packages) > 20, packages)
    named = {text for _, text in load(ROOT, ["docs/INSTALL.md"])[0].spans()}
    expect(set(packages) <= named, "docs/INSTALL.md does not name %s" % sorted(set(packages) - named))


# ---- the commands ------------------------------------------------------------------------------------------------

def to_run(document):
    return [b for b in document.blocks if b.kind != "text" and (not b.mark or (b.mark == "run slowly" and SLOW))]


def script_of(document, blocks):
    """The document's commands as a script whose lines have the numbers of the document's lines."""
    lines = [""] * (len(document.lines) + 1)
    for block in blocks:
        for number, text in block.commands():
            for below, part in enumerate(text.split("\n")):     # a quoted text may have several lines
                lines[number - 1 + below] = part
    head = "set -eu; trap 'echo \"failed: $LINENO\" >&2' ERR; PS4='+$LINENO '; set -x;"
    return "\n".join([head + lines[0]] + lines[1:]) + "\n"


def write_glb(farm, path):
    """A binary glTF of the tiny scene."""
    with open(farm.scene("glb.gltf"), "rb") as file:
        text = file.read()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as out:
        out.write(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text)


def prepare(farm, document, blocks):
    """What a reader of the document has: the repository, the programs in PATH, a scene, a sky, a picture, and a farm with two
    finished jobs and a worker unless the document starts one."""
    for name in COPIED:
        for path in tracked(ROOT):
            if path.startswith(name + "/"):
                os.makedirs(os.path.dirname(farm.path(path)), exist_ok=True)
                shutil.copy(os.path.join(ROOT, path), farm.path(path))
    bin_folder = farm.path("build", "release", "bin")
    os.makedirs(bin_folder)
    os.symlink(os.path.join(BIN, "scenes"), os.path.join(bin_folder, "scenes"))
    for name in ("azulejo", "azulejo-coordinator", "azulejo-worker", "curl"):
        shutil.copy(SHIM, os.path.join(bin_folder, name))
        os.chmod(os.path.join(bin_folder, name), 0o755)
    for name in ("scene.glb", "walk.glb", "room.glb"):
        write_glb(farm, farm.path(name))
    os.makedirs(farm.path("out"))
    farm.cli("render", farm.scene(), "--size", "48x32", "--spp", "4", "-q", "-o", farm.path("frame"), expect=0, connect=False)
    for name in ("out/cornell.exr", "sky.exr", "world.exr", "out/sky.exr", "out/field.exr"):
        shutil.copy(farm.path("frame.exr"), farm.path(name))
    environment = dict(os.environ, DOC_BIN=BIN, DOC_SCRATCH=farm.folder, HOME=farm.folder, PATH=bin_folder + ":" + os.environ["PATH"])
    for name in ("AZULEJO_COORDINATOR", "AZULEJO_KEY"):
        environment.pop(name, None)
    text = "\n".join(text for block in blocks for _, text in block.commands())
    own = re.search(r"azulejo-coordinator (?!backup|restore)", text)
    if not own and (re.search(r"azulejo (%s)\b" % "|".join(FARM_VERBS), text) or "127.0.0.1:7421" in text or "backup" in text):
        farm.start_coordinator(*(() if "noweb" in BUILD else ("--web", "127.0.0.1:0")))
        farm.start_worker("--name", "render-7")
        for _ in range(2):
            farm.wait_for_job(farm.submit(farm.scene(), "--size", "48x32", "--spp", "4"))
        environment.update(AZULEJO_COORDINATOR=farm.address, AZULEJO_KEY=farm.key)
        for name, value in (("address", farm.address), ("store-of-farm", farm.store)):
            with open(farm.path(name), "w", encoding="utf-8") as file:
                file.write(value)
    if "keygen -o farm.key" in text:
        os.rename(farm.key, farm.path("given.key"))     # the document makes its own
        if farm.address:
            environment["AZULEJO_KEY"] = farm.path("given.key")
    return environment


def end_programs(farm):
    """SIGTERM to what the document's commands left running, workers first."""
    if not os.path.exists(farm.path("pids")):
        return
    with open(farm.path("pids"), encoding="utf-8") as file:
        pids = [int(line) for line in file]
    for pid in reversed(pids):
        try:
            os.kill(pid, signal.SIGTERM)
        except ProcessLookupError:
            continue
        wait_for(lambda pid=pid: not os.path.exists("/proc/%d/stat" % pid) or
                 open("/proc/%d/stat" % pid, encoding="utf-8").read().rsplit(")", 1)[1].split()[0] == "Z", "%d to end" % pid)


def run_document(document, blocks):
    with Farm() as farm:
        environment = prepare(farm, document, blocks)
        begun = time.monotonic()
        try:
            done = subprocess.run(["bash", "-c", script_of(document, blocks)], cwd=farm.folder, env=environment, text=True,
                                  stdin=subprocess.DEVNULL, capture_output=True, timeout=LIMIT_S * PATIENCE, check=False)
            code, out = done.returncode, done.stdout + done.stderr
        except subprocess.TimeoutExpired as late:
            code, out = -1, "%s\nstopped after %g s" % ((late.stderr or b"").decode("utf-8", "replace"), LIMIT_S * PATIENCE)
        finally:
            end_programs(farm)
        if code:
            line = (re.findall(r"^failed: (\d+)$", out, re.M) or re.findall(r"^\++(\d+) ", out, re.M) or ["?"])[-1]
            raise Failure("%s:%s: this command failed with status %d:\n%s" % (document.path, line, code, out[-3000:]))
        return time.monotonic() - begun


def add(document, blocks):
    def test():
        if "noweb" in BUILD and re.search(r"azulejo token|7421|--web", "\n".join(line for b in blocks for line in b.lines)):
            raise Skip("this build has no page")
        took = run_document(document, blocks)
        print("# %s: %.1f s" % (document.path, took))
    test.__name__ = re.sub(r"\W", "_", document.path)
    test.__doc__ = "the commands of %s run (%d blocks)" % (document.path, len(blocks))
    tests.add(test)


for each in load(ROOT):
    if to_run(each):
        add(each, to_run(each))


@tests.add
def a_failing_command_is_found():
    """a command that fails is found, with its line; a marked one is not run"""
    with Farm() as farm:
        with open(farm.path("README.md"), "w", encoding="utf-8") as file:
            file.write("# A\n\n```sh\ntrue\nfalse | true\nfalse\n```\n")
        document = load(farm.folder, ["README.md"])[0]
        try:
            run_document(document, to_run(document))
            raise AssertionError("no failure was found")
        except Failure as failure:
            expect("README.md:6: this command failed" in str(failure), failure)
        with open(farm.path("README.md"), "w", encoding="utf-8") as file:
            file.write("# A\n\n<!-- not run: it fails -->\n```sh\nfalse\n```\n")
        expect(not to_run(load(farm.folder, ["README.md"])[0]), "a marked block is not run")


if __name__ == "__main__":
    tests.run()
