#!/usr/bin/env python3
"""Prove that folders and circles of includes stay within their limits.

    scripts/check-budget.py [--write]

A folder of sources has at most FILES files and LINES lines, and no more than CIRCLE modules include one another in a
loop (a module is a .c, its header and its _parts.h). scripts/budget.txt has the exceptions, each with its limit and its
reason. A row that is larger than needed fails, too, so that limits only rise where a commit says why. --write lowers
the rows to what is there."""
import collections
import importlib.util
import os
import re
import sys

ROOMS = ("client", "common", "coordinator", "protocol", "web", "worker")
KINDS = (".c", ".h", ".js", ".css", ".html", ".proto")
FILES, LINES, CIRCLE = 30, 5000, 3
LIST = "scripts/budget.txt"
SLACK = {"files": 1, "lines": 200, "circle": 0}  # by which a row may be too large
ROUND = {"files": 1, "lines": 100, "circle": 1}  # --write rounds up to a multiple


def check_circles():
    """scripts/check-circles.py as a module, for its circles()."""
    spec = importlib.util.spec_from_file_location("check_circles", "scripts/check-circles.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sources():
    for room in ROOMS:
        for folder, _, names in os.walk(room):
            yield from (os.path.join(folder, name) for name in sorted(names) if name.endswith(KINDS))


def module_of(path):
    return re.sub("_parts$", "", os.path.splitext(path)[0])


def measure():
    """{(what, where): number} of folders and circles, and each circle's edges for messages."""
    found, graph, edges = collections.Counter(), collections.defaultdict(set), collections.defaultdict(list)
    paths = set(sources())
    for path in sorted(paths):
        with open(path, encoding="utf-8") as file:
            text = file.read()
        folder = os.path.dirname(path)
        found["files", folder] += 1
        found["lines", folder] += text.count("\n")
        graph[module_of(path)]
        for name in re.findall(r'^\s*#\s*include "([^"]+)"', text, re.M):
            if name in paths and module_of(name) != module_of(path):
                graph[module_of(path)].add(module_of(name))
                edges[module_of(path), module_of(name)].append("  %s includes %s" % (path, name))
    circles = {}
    for members in check_circles().circles(graph):
        where = os.path.commonpath([os.path.dirname(m) for m in members])
        found["circle", where] = max(found["circle", where], len(members))
        circles.setdefault(where, []).extend(
            line for pair in sorted(edges) if set(pair) <= set(members) for line in edges[pair])
    return found, circles


def read_rows():
    rows = {}
    with open(LIST, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            words = line.split("#")[0].split()
            if not words:
                continue
            if len(words) < 4 or words[0] not in SLACK or not words[2].isdigit():
                sys.exit("%s:%d: not 'files|lines|circle FOLDER LIMIT REASON'" % (LIST, number))
            rows[words[0], words[1]] = int(words[2])
    return rows


def write_rows(found):
    with open(LIST, encoding="utf-8") as file:
        lines = file.read().split("\n")
    out = []
    for line in lines:
        row = re.match(r"(files|lines|circle)(\s+)(\S+)(\s+)(\d+)(.*)", line)
        if row:
            key = row[1], row[3]
            if found[key] <= {"files": FILES, "lines": LINES, "circle": CIRCLE}[row[1]]:
                continue
            rounded = -(-found[key] // ROUND[row[1]]) * ROUND[row[1]]
            if rounded < int(row[5]):
                line = row[1] + row[2] + row[3] + row[4] + "%d" % rounded + row[6]
        out.append(line)
    with open(LIST, "w", encoding="utf-8") as file:
        file.write("\n".join(out))


def main():
    found, circles = measure()
    if sys.argv[1:] == ["--write"]:
        write_rows(found)
    rows, bad = read_rows(), 0
    default = {"files": FILES, "lines": LINES, "circle": CIRCLE}
    for key in sorted(set(found) | set(rows)):
        what, where = key
        limit = rows.get(key, default[what])
        if found[key] > limit:
            bad = 1
            print("budget: %s has %s, the limit is %d: divide it, or raise the limit in %s and say why in the commit" % (
                where, ("a circle of %d modules" if what == "circle" else "%d " + what) % found[key], limit, LIST))
            if what == "circle":
                print("\n".join(circles[where]))
        elif key in rows and found[key] + SLACK[what] < limit:
            bad = 1
            print("budget: %s needs only %d %s: lower its row in %s (scripts/check-budget.py --write)" % (
                where, found[key], "modules in a circle" if what == "circle" else what, LIST))
    if not bad:
        print("budget: ok, %d files, %d lines" % (
            sum(n for (what, _), n in found.items() if what == "files"),
            sum(n for (what, _), n in found.items() if what == "lines")))
    return bad


if __name__ == "__main__":
    sys.exit(main())
