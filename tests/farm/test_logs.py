#!/usr/bin/env python3
"""Logs as JSON: every line of a coordinator and its workers is an object, from start to end."""
import datetime
import json
import os
import subprocess

from farm import BIN, Farm, Tests, wait_for
from jobs import expect

tests = Tests()


def lines_of(text, program):
    """The program's lines. The page's program, which the coordinator starts, writes to the same place."""
    lines = [json.loads(line) for line in text.splitlines()]
    lines = [line for line in lines if line["program"] != "azulejo-web"]
    for line in lines:
        expect(sorted(line) == ["level", "pid", "program", "text", "time"], line)
        expect(line["program"] == program and line["level"] in ("error", "warn", "info", "debug"), line)
        datetime.datetime.strptime(line["time"], "%Y-%m-%dT%H:%M:%S.%fZ")
    return lines


@tests.add
def as_json():
    """--log-format json and AZULEJO_LOG_FORMAT: all lines, with odd names in them, and the last error"""
    with Farm() as farm:
        coordinator = farm.start_coordinator("--log-format", "json", "--log-level", "debug")
        worker = farm.start_worker(env={"AZULEJO_LOG_FORMAT": "json"})
        plain = farm.start_worker("--log-format", "text", env={"AZULEJO_LOG_FORMAT": "json"})
        name = 'a "name" \\ \u2713'
        number = farm.submit(farm.scene(), "--size", "16x16", "--spp", "4", "--name", name)
        farm.wait_for_job(number)
        farm.wait_for_workers(2)
        for program in (worker, plain, coordinator):
            expect(program.stop() == 0, program.label)
        lines = lines_of(coordinator.log_text(), "azulejo-coordinator")
        expect({line["pid"] for line in lines} == {coordinator.pid}, lines[0])
        expect(any(name in line["text"] and "is done" in line["text"] for line in lines), lines)
        expect(lines[-1]["text"] == "ended" and {"debug", "info"} <= {line["level"] for line in lines}, lines[-1])
        lines = lines_of(worker.log_text(), "azulejo-worker")
        expect({line["pid"] for line in lines} == {worker.pid}, lines[0])
        expect("{" not in plain.log_text() and " info azulejo-worker: " in plain.log_text(), plain.log_text())

        # What ends a program is a line like the others.
        for program, options in (("azulejo-coordinator", ("--key", farm.path("none.key"))),
                                 ("azulejo-worker", ("--key", farm.path("none.key")))):
            done = subprocess.run([os.path.join(BIN, program), "--log-format", "json", *options],
                                  capture_output=True, text=True, timeout=60)
            line = lines_of(done.stderr, program)[-1]
            expect(done.returncode == 3 or done.returncode == 8, done)
            expect(line["level"] == "error" and "none.key" in line["text"], line)
            for environment, options in (({}, ("--log-format", "xml")), ({"AZULEJO_LOG_FORMAT": "xml"}, ())):
                done = subprocess.run([os.path.join(BIN, program), *options], capture_output=True, text=True,
                                      env=dict(os.environ, **environment), timeout=60)
                expect(done.returncode == 2 and "xml" in done.stderr, done)


tests.run()
