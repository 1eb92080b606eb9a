#!/usr/bin/env python3
"""Stands for one of Azulejo's programs, and for curl, while the commands of a document are tried on a small scale.

What it changes: pictures have 48x32 pixels, 4 samples a pixel at most and two frames at most; `top` prints once; without ffmpeg no video is made; what asks gets a
yes; coordinators and workers run in the background, on loopback addresses that are free and in folders below the scratch folder;
HOST and names ending in example.org are the coordinator that was started first.
Environment: DOC_BIN (the real programs), DOC_SCRATCH (the folder)."""
import os
import re
import shutil
import subprocess
import sys
import time

REAL = os.environ["DOC_BIN"]
SCRATCH = os.environ["DOC_SCRATCH"]
NAME = os.path.basename(sys.argv[0])
RENDERS = ("render", "submit", "estimate", "accuracy")
SPP_MOST = 4


def scratch(name):
    return os.path.join(SCRATCH, name)


def value_of(words, *names):
    """Where the value of an option stands, or None: (index, '' or 'NAME=' before it)."""
    for index, word in enumerate(words):
        if word in names and index + 1 < len(words):
            return index + 1, ""
        for name in names:
            if word.startswith(name + "=") and name.startswith("--"):
                return index, name + "="
    return None


def change(words, names, function):
    found = value_of(words, *names)
    if found:
        index, before = found
        words[index] = before + function(words[index][len(before):])
    return bool(found)


def recorded(name):
    with open(scratch(name), encoding="utf-8") as file:
        return file.read().strip()


def below_scratch(path):
    """/srv/azulejo is a folder of its own in the scratch folder."""
    if not path.startswith("/") or path.startswith((SCRATCH, "/tmp/")):
        return path
    path = scratch("root") + path
    os.makedirs(os.path.dirname(path), exist_ok=True)
    return path


def address_of(text):
    stands_for = re.match(r"^(HOST|127\.0\.0\.1|[\w.-]*example\.org)(:7420)?$", text)
    return recorded("address") if stands_for and os.path.exists(scratch("address")) else text


def smaller_frames(text):
    first_two = re.match(r"^(\d+)-(\d+)$", text)
    return "%s-%d" % (first_two[1], int(first_two[1]) + 1) if first_two and int(first_two[2]) > int(first_two[1]) else text


def client(words):
    if words and words[0] in RENDERS:
        if words[0] != "accuracy" and not change(words, ("--size", "-s"), lambda _: "48x32"):
            words += ["--size", "48x32"]
        change(words, ("--spp", "-n"), lambda text: str(min(int(text), SPP_MOST)))
        change(words, ("--frames", "-f"), smaller_frames)
    found = value_of(words, "--video")
    if found and not shutil.which("ffmpeg"):
        del words[found[0] - (0 if found[1] else 1):found[0] + 1]
    if words[:1] == ["top"]:
        words += ["--once"]
    if words[:1] == ["workers"] and len(words) > 2 and words[1] != "show":
        words += ["--yes"]
    change(words, ("--coordinator", "-c"), address_of)
    if os.path.exists(scratch("address")):   # a farm runs; its address and key are in the environment, as its users have them
        os.environ["AZULEJO_COORDINATOR"] = address_of(os.environ.get("AZULEJO_COORDINATOR", "HOST"))
        os.environ.setdefault("AZULEJO_KEY", scratch("farm.key"))
    os.execv(os.path.join(REAL, NAME), [NAME] + words)


def in_background(words, ready, limit_s=120):
    """Start it, and return what its log has when it is ready; a worker need not be."""
    log = scratch("%s-%d.log" % (NAME, os.getpid()))
    with open(log, "wb") as sink:
        program = subprocess.Popen([os.path.join(REAL, NAME)] + words, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink,
                                   start_new_session=True)
    with open(scratch("pids"), "a", encoding="utf-8") as file:
        file.write("%d\n" % program.pid)
    end = time.monotonic() + limit_s
    while ready:
        with open(log, encoding="utf-8", errors="replace") as file:
            text = file.read()
        found = re.search(ready, text)
        if found:
            return found
        if program.poll() is not None or time.monotonic() > end:
            sys.exit("%s did not become ready:\n%s" % (NAME, text))
        time.sleep(0.02)


def coordinator(words):
    change(words, ("--store", "-s"), below_scratch)
    if words and words[0] in ("backup", "restore"):
        words[1] = below_scratch(words[1])
        if words[0] == "backup" and os.path.exists(scratch("store-of-farm")):
            change(words, ("--store", "-s"), lambda _: recorded("store-of-farm"))
        os.execv(os.path.join(REAL, NAME), [NAME] + words)
    if "--check" in words:
        os.execv(os.path.join(REAL, NAME), [NAME] + words)
    store = value_of(words, "--store", "-s")
    store = os.path.abspath(words[store[0]][len(store[1]):] if store else "azulejo-store")
    if not change(words, ("--listen", "-l"), lambda _: "127.0.0.1:0"):
        words += ["--listen", "127.0.0.1:0"]
    if not change(words, ("--web",), lambda _: "127.0.0.1:0"):
        words += ["--web", "127.0.0.1:0"]
    found = in_background(words, r"listening on ([\d.:]+)")
    if os.path.exists(scratch("address")):
        return
    for name, value in (("address", found[1]), ("store-of-farm", store)):
        with open(scratch(name), "w", encoding="utf-8") as file:
            file.write(value)


def worker(words):
    change(words, ("--coordinator", "-c"), address_of)
    if not value_of(words, "--name"):
        words += ["--name", "render-7"]
    in_background(words + ["--threads", "1", "--cache", scratch("cache-%d" % os.getpid())], None)


def curl(words):
    """The page's port in a document is the one that the coordinator took."""
    with open(os.path.join(recorded("store-of-farm"), "page.url"), encoding="utf-8") as file:
        page = re.match(r"https?://([^/]+)/", file.read())[1]
    own = os.path.dirname(os.path.abspath(sys.argv[0]))
    os.environ["PATH"] = ":".join(folder for folder in os.environ["PATH"].split(":") if folder != own)
    os.execvp("curl", ["curl", "--max-time", "60"] + [word.replace("127.0.0.1:7421", page) for word in words])


def main():
    words = sys.argv[1:]
    if NAME == "curl":
        curl(words)
    elif set(words) & {"--help", "--version", "-h"} or NAME not in ("azulejo-coordinator", "azulejo-worker"):
        client(words)
    elif NAME == "azulejo-coordinator":
        coordinator(words)
    else:
        worker(words)


main()
