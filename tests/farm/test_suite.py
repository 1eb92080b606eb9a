#!/usr/bin/env python3
"""tests/run.sh: what fails once runs again alone, what fails twice fails the run, what hangs is a time-out."""
import os
import re
import shutil
import subprocess
import tempfile

from farm import PATIENCE, ROOT, Tests
from jobs import expect

tests = Tests()
GOOD = "print('ok 1 - good')\n"
BAD = "print('not ok 1 - bad')\nprint('# a reason')\nraise SystemExit(1)\n"
HANGS = "import time\nprint('ok 1 - begun', flush=True)\ntime.sleep(1000)\n"
DIES = "import os, resource\nresource.setrlimit(resource.RLIMIT_CORE, (0, 0))\nos.abort()\n"


def blinks(name):
    """Fails when it runs for the first time."""
    return ("import os\nif not os.path.exists('seen-{0}'):\n    open('seen-{0}', 'w').close()\n"
            "    print('not ok 1 - it blinked')\nelse:\n    print('ok 1 - good')\n").format(name)


def run(files, build="build/release", limit_s=600):
    """Run the suite over these files, {path: Python}; its status and its lines."""
    with tempfile.TemporaryDirectory(prefix="azulejo-suite-") as folder:
        for kind in ("unit", "statistics", "numerics", "fuzz", "farm", "web", "blender"):
            os.makedirs(os.path.join(folder, "tests", kind))
        for name in ("run.sh", "slowest.txt"):
            shutil.copy(os.path.join(ROOT, "tests", name), os.path.join(folder, "tests"))
        for path, text in files.items():
            if path.endswith(".c"):  # stands for its program
                open(os.path.join(folder, path), "w").close()
                path = os.path.join(build, path[:-2])
                text = "#!/usr/bin/env python3\n" + text
            path = os.path.join(folder, path)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w") as out:
                out.write(text)
            os.chmod(path, 0o755)
        done = subprocess.run([os.path.join(folder, "tests", "run.sh")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              timeout=120 * PATIENCE, text=True, stdin=subprocess.DEVNULL,
                              env=dict(os.environ, BUILD=build, TEST_LIMIT_S=str(limit_s)))
        logs = os.listdir(os.path.join(folder, build, "test-logs"))
    return done.returncode, done.stdout.splitlines(), logs


def has(lines, pattern):
    return any(re.search(pattern, line) for line in lines)


@tests.add
def a_blink():
    """A farm, a page and a unit that fail once: two pass alone and are named, their logs are kept, the run is green"""
    code, lines, logs = run({"tests/farm/test_blink.py": blinks("farm"), "tests/farm/test_good.py": GOOD,
                             "tests/unit/test_blink.c": blinks("unit")})
    expect(code == 0 and lines[-1] == "3 passed, 0 failed", (code, lines))
    for name in ("tests/farm/test_blink.py", "tests/unit/test_blink"):
        expect(has(lines, r"^once %s \(0 ok, 1 failed" % re.escape(name)), lines)
        expect(has(lines, r"^unsteady %s \(failed once, passed alone\)" % re.escape(name)), lines)
        log = name.replace("/", "_")
        expect({log + ".log", log + ".first.log"} <= set(logs), logs)
    expect(not has(lines, "^FAIL"), lines)


@tests.add
def too_many_blinks():
    """Three unsteady files fail the run"""
    code, lines, _ = run({"tests/farm/test_%s.py" % name: blinks(name) for name in ("one", "two", "three")})
    expect(code == 1 and lines[-1] == "3 passed, 1 failed", (code, lines))
    expect(has(lines, "^FAIL 3 files are unsteady; at most 2 may be"), lines)


@tests.add
def a_failure():
    """What fails twice, dies or hangs fails the run, with its reason; a time-out is called so"""
    code, lines, _ = run({"tests/farm/test_bad.py": BAD, "tests/web/test_hangs.py": HANGS, "tests/unit/test_dies.c": DIES,
                          "tests/farm/test_good.py": GOOD}, limit_s=5)
    expect(code == 1 and lines[-1] == "2 passed, 3 failed", (code, lines))
    expect(has(lines, r"^FAIL tests/farm/test_bad.py \(0 ok, 1 failed, exit 1\)") and has(lines, "# a reason"), lines)
    expect(has(lines, r"^FAIL tests/web/test_hangs.py \(time-out after 5 s, 1 ok\)"), lines)
    expect(has(lines, r"^FAIL tests/unit/test_dies \(0 ok, 1 failed, exit 134\)"), lines)
    expect(not has(lines, "^unsteady"), lines)


@tests.add
def never_again():
    """Statistics and numerics have fixed seeds, and a sanitizer's word counts once: neither runs again"""
    code, lines, _ = run({"tests/statistics/test_a.c": blinks("a"), "tests/numerics/test_b.c": blinks("b")})
    expect(code == 1 and lines[-1] == "0 passed, 2 failed" and not has(lines, "^(once|unsteady)"), (code, lines))
    code, lines, _ = run({"tests/farm/test_c.py": blinks("c")}, build="build/thread")
    expect(code == 1 and lines[-1] == "0 passed, 1 failed" and not has(lines, "^(once|unsteady)"), (code, lines))


if __name__ == "__main__":
    tests.run()
