#!/usr/bin/env python3
"""Prove that the glossary of docs/ARCHITECTURE.md is true.

Each row of the table under "## Words of the code" names a term, its meaning, where it is defined (`file: identifier`), and the
words that it replaced. The identifier must stand in that file, and no source file may use a replaced word."""
import re
import subprocess
import sys

DOCUMENT = "docs/ARCHITECTURE.md"


def rows():
    text = open(DOCUMENT, encoding="utf-8").read()
    table = text.split("## Words of the code", 1)[1].split("\n## ", 1)[0]
    for line in table.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 4 and not cells[0].startswith(("term", "-")):
            yield cells


def uses_of(word):
    found = subprocess.run(["git", "grep", "-nwF", "--", word, "*.c", "*.h", "*.inc"], capture_output=True, text=True)
    return found.stdout.splitlines()


def main():
    bad = count = 0
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
            for use in uses_of(word):
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
