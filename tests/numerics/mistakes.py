#!/usr/bin/env python3
"""Make mistakes on purpose, one at a time, and see which tests notice.

    mistakes.py FOLDER [--only NAME,...] [--tests TEST,...]
    mistakes.py --check

mistakes.txt has the mistakes: where, the lines as they are and as they are mistaken, and the tests that must notice. Each is made in
FOLDER, a copy of the sources with a build tree of its own; these are never touched. --tests runs others in place of the named ones.
--check makes nothing: it fails where the lines of a mistake are not in the sources any more."""
import argparse
import filecmp
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
LIMIT_S = 900


class Mistake:
    """One row: `old` is in `file` once, and `new` stands there instead."""

    def __init__(self, name, seen):
        self.name, self.seen, self.file, self.old, self.new, self.tests = name, seen, "", "", "", []

    def made(self, text):
        """The file's text with the mistake. ValueError: the lines are not there, or several times."""
        if text.count(self.old) != 1:
            raise ValueError("%s: its lines are %d times in %s: write them as they are now" % (self.name, text.count(self.old), self.file))
        return text.replace(self.old, self.new)


def table(path):
    """The mistakes, in the file's order."""
    rows = []
    with open(path, encoding="utf-8") as lines:
        for line in lines:
            key, _, rest = line.rstrip("\n").partition(" ")
            if key == "mistake":
                rows.append(Mistake(*rest.split(": ", 1)))
            elif key == "in":
                rows[-1].file = rest
            elif key == "by":
                rows[-1].tests += rest.split()
            elif key.startswith("-"):
                rows[-1].old += line[1:]
            elif key.startswith("+"):
                rows[-1].new += line[1:]
            elif line.strip() and not line.startswith("#"):
                sys.exit("mistakes.txt: what is this line? " + line)
    return rows


def read(*path):
    with open(os.path.join(*path), encoding="utf-8") as file:
        return file.read()


def copy_sources(folder):
    """What git knows. A new file keeps its time, so that make builds nothing that was copied built; one that differs gets a new
    one, since its object may be that of a mistake."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    names = {name for name in listed.splitlines() if os.path.isfile(os.path.join(ROOT, name))}
    for name in names:
        at, to = os.path.join(ROOT, name), os.path.join(folder, name)
        if not os.path.exists(to):
            os.makedirs(os.path.dirname(to), exist_ok=True)
            shutil.copy2(at, to)
        elif not filecmp.cmp(at, to, shallow=False):
            shutil.copy(at, to)
    for at, folders, files in os.walk(folder):
        if at == folder:
            folders[:] = set(folders) - {"build"}
        for name in files:
            if os.path.relpath(os.path.join(at, name), folder) not in names:
                os.unlink(os.path.join(at, name))


def build(folder, tests):
    """What the tests run. "" or what make says."""
    programs = ["build/release/tests/" + test.partition(":")[0] for test in tests if ".py" not in test]
    if any(".py" in test for test in tests):  # the programs, and what is beside them or preloaded
        at = "build/release/tests/farm"
        programs += ["all"] + ["%s/%s" % (at, name) for name in sorted(os.listdir(os.path.join(folder, at)))]
    done = subprocess.run(["make", "-s", "-j%d" % os.cpu_count()] + programs, cwd=folder, capture_output=True, text=True)
    return done.stdout + done.stderr if done.returncode else ""


def failures(folder, test):
    """What the test says is wrong, a line each."""
    program, _, function = test.partition(":")
    env = dict(os.environ, BUILD="build/release", CMOCKA_MESSAGE_OUTPUT="TAP")
    env.pop("AZULEJO_DATA", None)
    if program.endswith(".py"):
        command = [sys.executable, "-B", os.path.join("tests", program)] + ([function] if function else [])
    else:
        command = [os.path.join("build/release/tests", program)]
        if function:
            env["TEST_FILTER"] = function
    try:
        done = subprocess.run(command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return ["does not end within %d s" % LIMIT_S]
    text = done.stdout.decode("utf-8", "replace")
    found = re.findall(r"^\s*not ok \d+ - (.+)", text, re.M)  # a skipped one has no dash
    if not found and done.returncode:
        found = ["exit %d" % done.returncode]
    return found


def expect_green(folder, tests):
    """A test that fails without a mistake notices none."""
    wrong = build(folder, tests)
    if wrong:
        sys.exit("the copy is not compiled: " + wrong[-800:])
    for test in tests:
        found = failures(folder, test)
        if found:
            sys.exit("%s fails without any mistake: %s" % (test, ", ".join(found)))


def score(folder, mistake):
    """1: noticed. Prints what noticed it: the first test that does."""
    at, found = os.path.join(folder, mistake.file), []
    text = read(at)
    with open(at, "w", encoding="utf-8") as file:
        file.write(mistake.made(text))
    try:
        wrong = build(folder, mistake.tests)
        if wrong:
            print("not ok - %s\n#   is not compiled: %s" % (mistake.name, wrong[-800:]))
            return 0
        for test in mistake.tests:
            found.append((test, failures(folder, test)))
            if found[-1][1]:
                break
    finally:
        with open(at, "w", encoding="utf-8") as file:
            file.write(text)
    noticed = [(test, names) for test, names in found if names]
    print("%sok - %s: %s" % ("" if noticed else "not ", mistake.name, mistake.seen))
    for test, names in noticed:
        print("#   noticed by %s: %s" % (test, ", ".join(names[:6])))
    for test, names in found:
        if not names:
            print("#   not noticed by %s" % test)
    sys.stdout.flush()
    return bool(noticed)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?")
    parser.add_argument("--only", default="")
    parser.add_argument("--tests", default="")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    rows = table(os.path.join(HERE, "mistakes.txt"))
    try:
        for row in rows:
            row.made(read(ROOT, row.file))
    except ValueError as wrong:
        sys.exit("mistakes.txt: %s" % wrong)
    if options.check:
        return
    only = set(filter(None, options.only.split(",")))
    rows = [row for row in rows if not only or row.name in only]
    for row in rows:
        row.tests = options.tests.split(",") if options.tests else row.tests
    copy_sources(options.folder)
    expect_green(options.folder, sorted({test for row in rows for test in row.tests}))
    noticed = sum(score(options.folder, row) for row in rows)
    print("%d of %d mistakes are noticed" % (noticed, len(rows)))
    sys.exit(noticed < len(rows))


if __name__ == "__main__":
    main()
