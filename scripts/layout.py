#!/usr/bin/env python3
"""Lay out C by clang-format, but keep what is aligned by hand.

layout.py [--check] [FILE ...]: all C files of the repository where none is named. --check changes nothing, names the
places and exits with 1.

A place is laid out where clang-format 14 changes no token and makes it no longer. Macros, initialisers, enumerations and
lines in columns stay as they are. Another version's layout differs: without 14, nothing is done, and it says so."""
import difflib
import itertools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
BATCH = 40  # files
OPENS_TABLE = re.compile(r"=\s*\{[^;]*$|=.*\)\s*\{[^;]*$|\s*(typedef )?enum\b.*\{")
STATEMENT = re.compile(r"\s*(if|for|while|switch|do|else)\b")


def kept_by_hand(lines):
    """For each line whether it belongs to a macro, an initialiser or an enumeration."""
    keep = [False] * (len(lines) + 1)
    i = 0
    while i < len(lines):
        end = i
        if lines[i].lstrip().startswith("#define"):
            while lines[end].endswith("\\") and end + 1 < len(lines):
                end += 1
            keep[i:end + 1] = [True] * (end + 1 - i)
        elif OPENS_TABLE.match(lines[i]) or (OPENS_TABLE.search(lines[i]) and not STATEMENT.match(lines[i])):
            depth = lines[i].count("{") - lines[i].count("}")
            while depth > 0 and end + 1 < len(lines):
                end += 1
                depth += lines[end].count("{") - lines[end].count("}")
            keep[i:end + 1] = [True] * (end + 1 - i)
        i = end + 1
    return keep


def squeezed(lines):
    return re.sub(r"\s+", "", "".join(lines))


def in_columns(lines):
    return any(re.search(r"\S  +\S", line) for line in lines if "/*" not in line)


def lines_of(path):
    with open(path, encoding="utf-8") as source:
        return source.read().split("\n")


def formatted(paths):
    """What clang-format makes of these files, path by path: of copies, as it starts slowly and many files at once are
    formatted in place only."""
    with tempfile.TemporaryDirectory(prefix="azulejo-layout-") as folder:
        shutil.copy(os.path.join(ROOT, ".clang-format"), folder)
        copies = [os.path.join(folder, "%d%s" % (n, os.path.splitext(path)[1])) for n, path in enumerate(paths)]
        for path, copy in zip(paths, copies):
            shutil.copyfile(path, copy)
        subprocess.run(["clang-format", "-i", "--style=file"] + copies, check=True)
        return [lines_of(copy) for copy in copies]


def lay_out(path, new):
    """The file's lines as they are, and as they should be if clang-format wants `new`."""
    old = lines_of(path)
    if new == old:
        return old, old
    keep = kept_by_hand(old)
    result = []
    for tag, a, b, c, d in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        better = (not any(keep[a:max(b, a + 1)]) and d - c <= b - a and squeezed(old[a:b]) == squeezed(new[c:d]) and
                  not in_columns(old[a:b]))
        result += new[c:d] if better else old[a:b]
    return old, result


def is_there():
    try:
        return " 14." in subprocess.run(["clang-format", "--version"], capture_output=True, text=True).stdout
    except FileNotFoundError:
        return False


def main():
    if not is_there():
        print("layout: skipped, clang-format 14 is not installed")
        return 0
    check = "--check" in sys.argv
    paths = [a for a in sys.argv[1:] if a != "--check"]
    if not paths:
        paths = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "*.c", "*.h"], check=True, capture_output=True,
                               text=True).stdout.split()
    wrong = 0
    batches = [paths[at:at + BATCH] for at in range(0, len(paths), BATCH)]
    with ThreadPoolExecutor() as pool:
        for path, wanted in zip(paths, itertools.chain.from_iterable(pool.map(formatted, batches))):
            old, new = lay_out(path, wanted)
            if old == new:
                continue
            wrong += 1
            if check:
                line = next((i for i, (a, b) in enumerate(zip(old, new)) if a != b), 0)
                print("layout: %s:%d is laid out differently (make format)" % (path, line + 1))
            else:
                with open(path, "w", encoding="utf-8") as target:
                    target.write("\n".join(new))
    if check and not wrong:
        print("layout: ok, %d files" % len(paths))
    return 1 if check and wrong else 0


if __name__ == "__main__":
    sys.exit(main())
