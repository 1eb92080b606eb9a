#!/usr/bin/env python3
"""Prove that the source files form no large circles: files that call each other in a loop.

    scripts/check-circles.py BUILD [--list]

Reads the symbols of the object files below BUILD/obj, so an edge is a name that one file uses and
another defines. A header's inline functions count as part of the file that includes them. Fails on a
circle between folders, and on one of more than CIRCLE_MAX files within a folder."""
import collections
import os
import subprocess
import sys

CIRCLE_MAX = 3
ROOMS = ("common", "protocol", "coordinator", "web", "worker", "client")


def objects(build):
    root = os.path.join(build, "obj")
    for folder, _, names in os.walk(root):
        for name in names:
            path = os.path.join(folder, name)
            source = os.path.relpath(path, root)[:-2] + ".c"
            if name.endswith(".o") and source.startswith(ROOMS) and os.path.exists(source):
                yield path, source


def symbols(sources):
    """({name: source that defines it}, {source: names that it uses}) of {object file: source}."""
    owner, uses = {}, {source: set() for source in sources.values()}
    out = subprocess.run(["nm", "-A", "-P", *sources], check=True, capture_output=True, text=True).stdout
    for line in out.splitlines():
        path, name, kind = line.split()[:3]
        source = sources[path[:-1]]
        if kind == "U":
            uses[source].add(name)
        elif kind.isupper():
            owner[name] = source
    return owner, uses


def circles(graph):
    """Tarjan's strongly connected components of more than one node."""
    index, low, stack, on_stack, found = {}, {}, [], set(), []
    counter = [0]

    def visit(node):
        index[node] = low[node] = counter[0]
        counter[0] += 1
        stack.append(node)
        on_stack.add(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in on_stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            members = []
            while True:
                member = stack.pop()
                on_stack.discard(member)
                members.append(member)
                if member == node:
                    break
            if len(members) > 1:
                found.append(sorted(members))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


def main():
    sys.setrecursionlimit(10000)
    build, listed = sys.argv[1], "--list" in sys.argv
    sources = dict(objects(build))
    if not sources:
        sys.exit("check-circles: no object files below %s/obj: build first" % build)
    owner, uses = symbols(sources)
    graph = {source: {owner[n] for n in names if n in owner and owner[n] != source}
             for source, names in uses.items()}
    folders = collections.defaultdict(set)
    for source, others in graph.items():
        for other in others:
            if os.path.dirname(other) != os.path.dirname(source):
                folders[os.path.dirname(source)].add(os.path.dirname(other))
                folders[os.path.dirname(other)]
    bad = 0
    for members in circles(folders):
        bad = 1
        print("a circle between folders: %s" % ", ".join(members))
        for source in sorted(graph):
            for other in sorted(graph[source]):
                pair = os.path.dirname(source), os.path.dirname(other)
                if pair[0] != pair[1] and pair[0] in members and pair[1] in members:
                    print("  %s -> %s: %s" % (source, other, ", ".join(sorted(
                        n for n in uses[source] if owner.get(n) == other)[:4])))
    for members in circles(graph):
        if len(members) > CIRCLE_MAX or listed:
            bad |= len(members) > CIRCLE_MAX
            print("a circle of %d files: %s" % (len(members), ", ".join(members)))
            for source in members:
                for other in sorted(graph[source] & set(members)):
                    print("  %s -> %s: %s" % (source, other, ", ".join(sorted(
                        n for n in uses[source] if owner.get(n) == other)[:6])))
    if not bad:
        print("circles: ok")
    return bad


if __name__ == "__main__":
    sys.exit(main())
