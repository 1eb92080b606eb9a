#!/usr/bin/env python3
"""Prove that the glossary of docs/ARCHITECTURE.md is true.

Each row of the table under "## Words of the code" names a term, its meaning, where it is defined (`file: identifier`), and the
words that it replaced. The identifier must stand in that file, and no source file may use a replaced word."""
import os
import re
import sys

DOCUMENT = "docs/ARCHITECTURE.md"
ROOMS = ("client", "common", "coordinator", "protocol", "scenes", "tests", "web", "worker")


def rows():
    text = open(DOCUMENT, encoding="utf-8").read()
    table = text.split("## Words of the code", 1)[1].split("\n## ", 1)[0]
    for line in table.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 4 and not cells[0].startswith(("term", "-")):
            yield cells


def sources():
    """(path, lines) of every source file."""
    for room in ROOMS:
        for folder, _, names in os.walk(room):
            for name in sorted(names):
                if name.endswith((".c", ".h", ".inc")):
                    path = os.path.join(folder, name)
                    with open(path, encoding="utf-8") as file:
                        yield path, file.read().splitlines()


def uses_of(word, files):
    pattern = re.compile(r"(?<!\w)%s(?!\w)" % re.escape(word))
    return ["%s:%d: %s" % (path, number, line.strip())
            for path, lines in files for number, line in enumerate(lines, 1) if word in line and pattern.search(line)]


def main():
    bad = count = 0
    files = list(sources())
    for term, _, where, replaced in rows():
        count += 1
        match = re.fullmatch(r"`([^`:]+): ([^`]+)`", where)
        if not match:
            print("%s: '%s' is not of the form `file: identifier`" % (term, where))
            bad += 1
            continue
        path, identifier = match.groups()
        try:
            source = open(path, encoding="utf-8").read()
        except OSError as error:
            source = ""
            print("%s: %s" % (term, error))
        if not re.search(r"(?<!\w)%s(?!\w)" % re.escape(identifier), source):
            print("%s: %s does not define %s" % (term, path, identifier))
            bad += 1
        for word in re.findall(r"`([^`]+)`", replaced):
            for use in uses_of(word, files):
                print("%s: use it in place of '%s': %s" % (term, word, use))
                bad += 1
    if count < 10:
        print("%s: the table of words has only %d rows" % (DOCUMENT, count))
        bad += 1
    if not bad:
        print("words: ok")
    return bad > 0


if __name__ == "__main__":
    sys.exit(main())
