"""`make dist`: the archive of a release has every file of the commit and no other, has the same bytes from any clone, and builds."""
import hashlib
import os
import re
import shlex
import subprocess
import sys
import tarfile

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Skip, Tests, read_bytes
from jobs import expect

tests = Tests()
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def run(*words, cwd=ROOT, **environment):
    return subprocess.run(words, cwd=cwd, env=dict(os.environ, **environment), capture_output=True, text=True, check=False)


def version():
    with open(os.path.join(ROOT, "Makefile"), encoding="utf-8") as file:
        return re.search(r"^VERSION := (\S+)$", file.read(), re.M)[1]


def archive(folder, cwd=ROOT, **environment):
    done = run("bash", "-c", "umask %s; scripts/dist.sh %s %s" % (environment.pop("mask", "022"), version(), shlex.quote(folder)), cwd=cwd, **environment)
    expect(done.returncode == 0, done.stdout + done.stderr)
    path = os.path.join(folder, "azulejo-%s.tar.gz" % version())
    expect(hashlib.sha256(read_bytes(path)).hexdigest() in done.stdout, done.stdout)
    return path


@tests.add
def reproducible_and_whole():
    """the same bytes from another clone, another day, time zone and umask; the files of the commit and no other; it builds"""
    if run("git", "rev-parse", "HEAD").returncode:
        raise Skip("this is no git clone")
    with Farm() as farm:
        first = archive(farm.path("first"))
        clone = farm.path("clone")
        done = run("git", "clone", "-q", ROOT, clone)
        expect(done.returncode == 0, done.stderr)
        expect(run("git", "checkout", "-q", run("git", "rev-parse", "HEAD").stdout.strip(), cwd=clone).returncode == 0, "the same commit")
        with open(os.path.join(clone, "README.md"), "a", encoding="utf-8") as file:
            file.write("not committed\n")
        os.makedirs(os.path.join(clone, "build"))
        with open(os.path.join(clone, "build", "ignored"), "w", encoding="utf-8") as file:
            file.write("not to be in it\n")
        second = archive(farm.path("second"), cwd=clone, mask="077", TZ="Asia/Tokyo", GZIP="", GIT_CONFIG_COUNT="1",
                         GIT_CONFIG_KEY_0="tar.umask", GIT_CONFIG_VALUE_0="0077")
        expect(read_bytes(first) == read_bytes(second), "two archives of one commit differ")

        with tarfile.open(first) as tar:
            names = sorted(member.name for member in tar.getmembers() if not member.isdir())
            expect(all(member.uid == 0 and not member.name.startswith("/") for member in tar.getmembers()), "owners and names")
            tar.extractall(farm.path("unpacked"))
        prefix = "azulejo-%s/" % version()
        committed = run("git", "ls-tree", "-r", "--name-only", "-z", "HEAD").stdout.split("\0")[:-1]
        expect(names == sorted(prefix + name for name in committed), "the files of the commit and no other")

        tree = farm.path("unpacked", prefix)
        done = run("make", "-n", "all", cwd=tree)
        expect(done.returncode == 0 and "azulejo-coordinator" in done.stdout, done.stdout[-500:] + done.stderr)
        done = run(sys.executable, "-B", "scripts/check-docs.py", "--bin", os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "bin"), cwd=tree)
        expect(done.returncode == 0, done.stdout + done.stderr)


@tests.add
def programs_say_the_version():
    """the three programs and the changelog name one version"""
    for program in ("azulejo", "azulejo-coordinator", "azulejo-worker"):
        said = run(os.path.join(ROOT, os.environ.get("BUILD", "build/release"), "bin", program), "--version").stdout
        expect(said.split()[:2] == [program, version()], said)
    with open(os.path.join(ROOT, "CHANGELOG.md"), encoding="utf-8") as file:
        newest = re.search(r"^## (\d\S*)", file.read(), re.M)[1]
    expect(newest == version(), "the newest section of CHANGELOG.md is %s, VERSION is %s" % (newest, version()))


if __name__ == "__main__":
    tests.run()
