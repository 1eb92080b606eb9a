#!/usr/bin/env python3
"""The audit log: who did what to which jobs, with what outcome."""
import datetime
import getpass
import json
import os
import socket

from farm import Farm, Tests, wait_for
from jobs import expect

tests = Tests()
ENDLESS = ("--size", "64x64", "--spp", "1000000")


def audit(farm, name="audit.log"):
    with open(farm.path("store", name), encoding="utf-8") as log:
        lines = [json.loads(line) for line in log]
    for line in lines:
        datetime.datetime.strptime(line["time"], "%Y-%m-%dT%H:%M:%S.%fZ")
        expect(line["outcome"] in ("done", "refused", "failed"), line)
    return lines


@tests.add
def verbs():
    """Every verb is a line with person, address, key, job and outcome; questions are none; over a kill -9"""
    with Farm() as farm:
        client, worker = farm.path("client.key"), farm.path("worker.key")
        farm.cli("keygen", "--role", "client", "--from", farm.key, "-o", client, expect=0)
        farm.cli("keygen", "--role", "worker", "--from", farm.key, "-o", worker, expect=0)
        farm.start_coordinator()
        me = "%s@%s" % (getpass.getuser(), socket.gethostname())
        one = farm.submit(farm.scene(), *ENDLESS, "--name", 'a "b" \u2713', "--token", "t")
        again = farm.submit(farm.scene(), *ENDLESS, "--name", 'a "b" \u2713', "--token", "t")
        expect(one == again, "one job")
        for question in (("list",), ("show", one), ("log", one), ("workers",), ("trace", one)):
            farm.cli(*question, expect=0)
        farm.cli("pause", one, expect=0, key=client)
        farm.coordinator.kill()
        farm.restart_coordinator()
        farm.cli("priority", one, "--to", "-3", expect=0)
        expect(farm.cli("retry", one).code == 5, "it has not ended")
        expect(farm.cli("finish", 99).code == 5, "no such job")
        farm.cli("cancel", one, "--discard", expect=0)
        farm.cli("retry", one, "--frames", "1", expect=0)
        farm.cli("cancel", one, expect=0)
        farm.cli("remove", one, expect=0)
        expect(farm.cli("submit", farm.scene(), "--spp", "4", key=worker).code != 0, "a worker's key")
        expect(farm.coordinator.stop() == 0, "it ends")
        lines = audit(farm)
        short = [(l["verb"], l.get("job"), l["outcome"]) for l in lines]
        expect(short == [
            ("start", None, "done"), ("submit", one, "done"), ("submit", one, "done"), ("pause", one, "done"),
            ("start", None, "done"), ("priority", one, "done"), ("retry", one, "refused"), ("finish", 99, "failed"),
            ("cancel", one, "done"), ("retry", one, "done"), ("cancel", one, "done"), ("remove", one, "done"),
            ("end", None, "done")], short)
        for line in lines:
            if line["verb"] in ("start", "end"):
                expect(line["who"] == "coordinator" and "address" not in line, line)
            else:
                expect(line["who"] == me and line["address"].startswith("127.0.0.1:") and line["key"] == "client" and
                       line["session"] > 0, line)
        expect(lines[1]["details"] == {"name": 'a "b" \u2713'} and lines[2]["details"]["again"] is True, lines[2])
        expect(lines[5]["details"] == {"priority": -3}, lines[5])
        expect("is paused" in lines[6]["error"] and lines[6]["status"] == 5, lines[6])
        expect(lines[8]["details"] == {"discard": True} and lines[9]["details"] == {"frames": [1]}, lines[8:10])
        expect(os.stat(farm.path("store", "audit.log")).st_mode & 0o777 == 0o600, "only the owner reads it")


@tests.add
def more():
    """extend, develop, resume and a submission that is refused; a file that was moved away is begun again"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "16x16", "--spp", "4")
        farm.wait_for_job(number)
        farm.cli("extend", number, "--spp", "8", expect=0)
        farm.wait_for_job(number)
        os.rename(farm.path("store", "audit.log"), farm.path("old.log"))
        farm.cli("develop", number, "--tonemap", "linear", "--exposure", "2", expect=0)
        result = farm.cli("resume", number)
        expect(result.code == 5, result)
        lines = audit(farm)
        expect([(l["verb"], l["outcome"]) for l in lines] == [("develop", "done"), ("resume", "refused")], lines)
        expect(lines[0]["details"]["output"]["tonemap"] == "linear" and
               lines[0]["details"]["output"]["exposure_ev"] == 2, lines[0])
        farm.cli("extend", number, "--target-error", "20dB", expect=0)
        # Numbers that stand for words are these words, as in the API.
        expect(audit(farm)[2]["details"]["stop"]["measure"] == "psnr", audit(farm)[2])
        farm.cli("render", farm.scene(), "--size", "16x16", "--spp", "1", "-o", farm.path("a.png"), expect=0,
                 connect=False)  # a farm of its own keeps none, and says nothing


@tests.add
def unwritable():
    """A log that cannot be written stops nobody; the log says so once, and the next line how many are lost"""
    with Farm() as farm:
        farm.start_coordinator()
        numbers = [farm.submit(farm.scene(), *ENDLESS) for _ in range(3)]
        os.rename(farm.path("store", "audit.log"), farm.path("old.log"))
        os.mkdir(farm.path("store", "audit.log"))
        for number in numbers:
            farm.cli("pause", number, expect=0)
        text = farm.coordinator.log_text()
        expect(text.count("audit.log: cannot be written: Is a directory") == 1, text)
        os.rmdir(farm.path("store", "audit.log"))
        farm.cli("resume", numbers[0], expect=0)
        farm.cli("resume", numbers[1], expect=0)
        lines = audit(farm)
        expect([l.get("lost") for l in lines] == [3, None] and lines[0]["job"] == numbers[0], lines)
        expect("audit.log: written again; 3 lines are lost" in farm.coordinator.log_text(), "the end is said")


tests.run()
