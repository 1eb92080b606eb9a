#!/usr/bin/env python3
"""Prove that each field of a job in the coordinator is written in one room.

    scripts/check-fields.py [--list]

The files of the folder where the structure stands write its fields, or those of a folder that a comment above the fields
names ("written by FOLDER"); the rest asks by a named function. The store, which makes jobs from rows, is free to write.
--list shows who writes each field."""
import collections
import os
import re
import subprocess
import sys

STRUCTURES = {"job": "coordinator/job/queue.h"}
STORE = "coordinator/store"
WRITES = r"(\+\+|--)?%s->(\w+)((?:\[[^\]]*\]|[.]\w+)*\s*(?:[-+*/|&^]=|<<=|>>=|=(?!=)|\+\+|--))?"


def fields(name, path):
    """{field: folder that writes it}"""
    with open(path, encoding="utf-8") as file:
        body = re.search(r"^struct %s \{\n(.*?)^\};" % name, file.read(), re.S | re.M)[1]
    room, found = os.path.dirname(path), {}
    for line in body.split("\n"):
        said = re.search(r"/\* .*written by (coordinator/\w+)", line)
        room = said[1] if said else room
        line = re.sub(r"/\*.*?(\*/|$)", "", line)
        line = re.sub(r"^.*\*/", "", line)
        for field in re.findall(r"(\w+)(?:\[[^\]]*\])*(?:\s*:\s*\d+)?\s*[,;]", line):
            found[field] = room
    return found


def variables(text, name):
    """Names that stand for such a structure in a file, and the paths that end in one."""
    names = set(re.findall(r"struct %s \*(?:const )?(\w+)\s*[,;)=]" % name, text))
    return [re.escape(n) for n in names]


def main():
    sources = subprocess.run(["git", "ls-files", "coordinator"], check=True, capture_output=True, text=True).stdout.split()
    sources = [p for p in sources if p.endswith((".c", ".h"))]
    texts = {}
    for path in sources:
        with open(path, encoding="utf-8") as file:
            texts[path] = re.sub(r"/\*.*?\*/", lambda m: "\n" * m[0].count("\n"), file.read(), flags=re.S)
    bad, count = 0, 0
    for name, header in STRUCTURES.items():
        writers = collections.defaultdict(set)
        rooms = fields(name, header)
        count += len(rooms)
        members = set()  # of other structures: t->job
        for text in texts.values():
            members |= set(re.findall(r"^\s+struct %s \*(\w+);" % name, text, re.M))
        for path, text in texts.items():
            known = variables(text, name)
            if not known and not any("->%s->" % m in text for m in members):
                continue
            owner = r"(?<![\w>.])(?:%s)" % "|".join(known) if known else "(?!)"
            owner = r"(?:%s|[>.](?:%s))" % (owner, "|".join(map(re.escape, members)) or "(?!)")
            for m in re.finditer(WRITES % owner, text):
                if m[2] in rooms and (m[1] or m[3]):
                    writers[m[2]].add((path, text.count("\n", 0, m.start()) + 1))
        for field, room in rooms.items():
            if "--list" in sys.argv:
                print("%-10s %-24s %s" % (name, field, " ".join(sorted({p for p, _ in writers[field]}))))
            for path, line in sorted(writers[field]):
                if os.path.dirname(path) not in (room, STORE):
                    bad = 1
                    print("%s:%d: %s of struct %s is written by %s: give it a named function there (or say in %s "
                          "who writes it)" % (path, line, field, name, room, header))
    if not bad:
        print("fields: ok, %d" % count)
    return bad


if __name__ == "__main__":
    sys.exit(main())
