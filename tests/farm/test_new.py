"""make new-lobe and make new-tonemap, in a copy of the tree: bad names change nothing, good ones change what the manual says.

With --build (make test-new) the copy is built, with DOUBLE=1 too, and the tests that concern what was made are run."""
import glob
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Failure, ROOT, Tests

tests = Tests()
PRODUCT = ["common/scene/effects.h", "common/scene/material_fields.h", "common/scene/scene.proto", "worker/render/bsdf/bsdf.h",
           "worker/render/bsdf/layering.h", "worker/render/bsdf/lobe_velvet.h"]


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def copy_tree(folder):
    copy = os.path.join(folder, "tree")
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns("build", "out", ".git", "__pycache__"))
    return copy


def digests(copy):
    found = {}
    for folder, _, names in os.walk(copy):
        for name in names:
            path = os.path.join(folder, name)
            with open(path, "rb") as file:
                found[os.path.relpath(path, copy)] = hashlib.sha256(file.read()).hexdigest()
    return found


def make(copy, *words):
    environment = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL", "BUILD", "SANITIZE")}
    return subprocess.run(["make", "-s", *words], cwd=copy, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, check=False)


def refused(copy, target, names):
    before = digests(copy)
    # make takes most of a second to begin: it asks once, and then its script.
    script, = glob.glob(os.path.join(copy, "scripts", target + ".*"))
    for name in names:
        run = make(copy, target, "NAME=" + name) if name == names[0] else \
            subprocess.run([script, name], cwd=copy, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        expect(run.returncode != 0, (target, name, run.returncode, run.stdout))
        expect(run.stdout.startswith(target + ": ") and "NAME" in run.stdout.splitlines()[0], (target, name, run.stdout))
        expect(digests(copy) == before, "%s NAME=%s changed the tree" % (target, name))


@tests.add
def bad_names():
    """bad and taken names change nothing"""
    with tempfile.TemporaryDirectory() as folder:
        refuse_all(copy_tree(folder))


def refuse_all(copy):
    refused(copy, "new-lobe", ["", "Velvet", "1x", "../x", "int", "errno", "fog", "sheen", "clearcoat", "metallic", "lobe", "s"])
    refused(copy, "new-tonemap", ["", "Filmic", "../x", "hable"])


@tests.add
def lobe():
    """a lobe changes five product files and makes one, which compiles with float and with double"""
    with tempfile.TemporaryDirectory() as folder:
        make_lobes(copy_tree(folder))


def make_lobes(copy):
    before = digests(copy)
    run = make(copy, "new-lobe", "NAME=velvet")
    expect(run.returncode == 0, run.stdout)
    after = digests(copy)
    changed = sorted(path for path in after if after[path] != before.get(path))
    expect([path for path in changed if not path.startswith(("tests/", "docs/"))] == PRODUCT, changed)
    refused(copy, "new-lobe", ["velvet"])
    run = make(copy, "new-lobe", "NAME=retro_b")
    expect(run.returncode == 0, run.stdout)
    for check in ("layers", "words"):
        run = make(copy, check)
        expect(run.returncode == 0, run.stdout)
    for variant, words in (("release", ()), ("double", ("DOUBLE=1",))):
        run = make(copy, *words, "build/%s/obj/worker/render/bsdf/bsdf.o" % variant)
        expect(run.returncode == 0, run.stdout[-4000:])


def build(copy):
    for words in (("new-lobe", "NAME=velvet"), ("new-lobe", "NAME=retro_b"), ("new-tonemap", "NAME=soft_knee"),
                  ("-j%d" % (os.cpu_count() or 1), "all", "tests"), ("DOUBLE=1", "-j%d" % (os.cpu_count() or 1), "all"),
                  ("layers", "circles", "words")):
        run = make(copy, *words)
        expect(run.returncode == 0 and "warning" not in run.stdout, run.stdout[-4000:])
    environment = dict(os.environ, BUILD="build/release")
    run = subprocess.run(["tests/run.sh", "test_bsdf|unit/scene|unit/tonemap|unit/render/test_(kernels|profile_scope|slots)"],
                         cwd=copy, env=environment, check=False)
    expect(run.returncode == 0, "tests of what was made fail")


if __name__ == "__main__":
    if sys.argv[1:] == ["--build"]:
        with tempfile.TemporaryDirectory() as place:
            build(copy_tree(place))
    else:
        tests.run()
