#!/usr/bin/env python3
"""Prove that a test notices the loss of each safeguard.

    safeguards.py BUILD [--only NAME,...] [--jobs N] [--markdown FILE]

BUILD is a tree made with SAFEGUARDS=1. safeguards.txt names the tests of each safeguard. Each runs with all safeguards on, where it
must pass, and with that one off, where at least one of them must fail. A row "setting NAME ..." is a job's setting that
the switch forces: its tests must all pass with it, too. Prints the matrix, and TAP: one line for each safeguard."""
import argparse
import collections
import concurrent.futures
import os
import re
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
LIMIT_S = 600
HEAD = """# Safeguards

**%d safeguards and settings, and each safeguard has a test that notices its loss.** The table is the output of

<!-- not run: takes 20 minutes -->
```sh
make numerics NUMERICS_ARGS="--markdown docs/SAFEGUARDS.md"
```

which builds the tests with switches, runs those that [tests/numerics/safeguards.txt](../tests/numerics/safeguards.txt) names with and
without each safeguard, and fails where all of them pass without it. A figure is what the test measured without the safeguard, then with it,
then the range in which it must lie, and what that range is. The switches are in [common/base/safeguard.h](../common/base/safeguard.h); an
ordinary build has none of them.

"""
FIGURE = re.compile(r"# figure (?P<what>.*) = (?P<value>\S+) in \[(?P<low>\S+), (?P<high>\S+)\], (?P<level>.*)")


def table(build):
    """[(name, what it prevents)], in the order of the header."""
    text = open(os.path.join("common", "base", "safeguard.h"), encoding="utf-8").read().replace("\\\n", " ")
    found = re.findall(r'X\(([A-Z0-9_]+),\s*((?:"[^"]*"\s*)+)\)', text)
    return [(name, "".join(re.findall(r'"([^"]*)"', words))) for name, words in found]


def rows():
    """{name: [test]}, {names of settings}"""
    out, settings = {}, set()
    for line in open(os.path.join(HERE, "safeguards.txt"), encoding="utf-8"):
        words = line.split("#")[0].split()
        if words[:1] == ["setting"]:
            words = words[1:]
            settings.update(words[:1])
        if words:
            out.setdefault(words[0], []).extend(words[1:])
    return out, settings


def run(build, test, off):
    """(failures, figures): failures is a list of 'test: message', figures {(what, how often before): match}."""
    program, _, function = test.partition(":")
    env = dict(os.environ, BUILD=build, CMOCKA_MESSAGE_OUTPUT="TAP", AZULEJO_SAFEGUARD_OFF=off)
    if function:
        env["TEST_FILTER"] = function
    command = [sys.executable, "-B", os.path.join("tests", program)] if program.endswith(".py") else [os.path.join(build, "tests", program)]
    try:
        done = subprocess.run(command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LIMIT_S)
        text, code = done.stdout.decode("utf-8", "replace"), done.returncode
    except subprocess.TimeoutExpired as late:
        text, code = (late.stdout or b"").decode("utf-8", "replace"), None
    figures, times = {}, collections.Counter()
    for match in filter(None, map(FIGURE.search, text.splitlines())):
        figures[match["what"], times[match["what"]]] = match
        times[match["what"]] += 1
    failures, lines = [], text.splitlines()
    for at, line in enumerate(lines):
        match = re.match(r"\s*not ok \d+ - (\S+)", line)
        if not match or re.search(r"# ?skip", line, re.I) or (function and match[1] != function):
            continue
        said = [re.sub(r"^#\s?", "", l.strip()) for l in lines[at + 1:at + 8] if l.strip().startswith("#")]
        said = [l for l in said if l and not l.startswith("figure ")]
        failures.append("%s: %s" % (match[1], said[0] if said else "fails"))
    if code is None:
        failures.append("does not end within %d s" % LIMIT_S)
    elif code < 0:
        failures.append("dies of signal %d" % -code)
    elif code and not failures:
        failures.append("exit %d: %s" % (code, lines[-1] if lines else ""))
    if not re.search(r"^\s*(not )?ok \d+", text, re.M) and code == 0:
        failures.append("ran no test")
    return failures, figures


def seen(failures, with_it, without):
    """One line: what the loss did, with the figures on both sides."""
    for what, figure in without.items():
        try:
            low, high, value = (float(figure[k]) for k in ("low", "high", "value"))
        except ValueError:
            continue
        if not low <= value <= high:
            before = with_it[what]["value"] if what in with_it else "?"
            return "%s: %s, with it %s (%s to %s; %s)" % (what[0], figure["value"], before, figure["low"], figure["high"], figure["level"])
    return failures[0][:150]


def holds(name, tests, results):
    """A setting: 1 if all its tests pass with it, and a line for each."""
    good, lines = bool(tests), []
    for test in tests:
        failures, figures = results[test, name]
        good = good and not failures
        if failures:
            lines.append((test, "fails: " + seen(failures, results[test, ""][1], figures)))
        else:
            same = sum(m["value"] == figures[what]["value"] for what, m in results[test, ""][1].items() if what in figures)
            lines.append((test, "holds, %d of %d figures the same" % (same, len(figures))))
    return good, lines


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("build")
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--markdown")
    options = parser.parse_args()
    safeguards, (tests, settings) = table(options.build), rows()
    only = set(filter(None, options.only.split(",")))
    unknown = (set(tests) | only) - {name for name, _ in safeguards}
    if unknown:
        sys.exit("safeguards.py: no such safeguard in common/base/safeguard.h: " + ", ".join(sorted(unknown)))
    if only:
        safeguards = [row for row in safeguards if row[0] in only]

    wanted = {(test, "") for name, _ in safeguards for test in tests.get(name, [])}
    wanted |= {(test, name) for name, _ in safeguards for test in tests.get(name, [])}
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        order = sorted(wanted)
        results = dict(zip(order, pool.map(lambda key: run(options.build, *key), order)))

    bad, lines = 0, []
    for test in sorted({test for test, off in wanted if not off}):
        failures = results[test, ""][0]
        if failures:
            bad += 1
            print("not ok - %s fails with all safeguards on: %s" % (test, failures[0]))
    for number, (name, prevents) in enumerate(safeguards, 1):
        caught = []
        if name in settings:
            good, caught = holds(name, tests[name], results)
            bad += not good
            print("%sok %d - %s (a setting)" % ("" if good else "not ", number, name))
            for test, figure in caught:
                print("#   %s: %s" % (test, figure))
            lines.append("| `%s` | %s | %s |" % (name, prevents, "<br>".join("`%s`: %s" % row for row in caught)))
            continue
        for test in tests.get(name, []):
            failures, figures = results[test, name]
            if failures and not results[test, ""][0]:
                caught.append((test, seen(failures, results[test, ""][1], figures)))
        bad += not caught
        print("%sok %d - %s" % ("" if caught else "not ", number, name))
        for test, figure in caught:
            print("#   %s: %s" % (test, figure))
        if not caught:
            print("#   no test notices that it is gone (%s); tried: %s" % (prevents, ", ".join(tests.get(name, [])) or "none"))
        lines.append("| `%s` | %s | %s |" % (name, prevents, "<br>".join("`%s`: %s" % (t, f.replace("|", "\\|")) for t, f in caught) or "none"))
    if options.markdown:
        with open(options.markdown, "w", encoding="utf-8") as file:
            file.write(HEAD % len(safeguards) + "| safeguard | without it | caught by |\n|---|---|---|\n" + "\n".join(lines) + "\n")
    print("1..%d" % len(safeguards))
    print("%d safeguards, %d passed, %d failed" % (len(safeguards), len(safeguards) - min(bad, len(safeguards)), bad))
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
