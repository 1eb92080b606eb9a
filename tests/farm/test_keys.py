#!/usr/bin/env python3
"""Keys of names: what each may do (every message against every kind of key), whose its jobs are, revoked, rotated, over
restarts, and with the keys that a role shares turned off."""
import json
import os
import re
import subprocess

from farm import BUILD, PATIENCE, Failure, Farm, Tests, wait_for
from jobs import expect
from odd import OddPeer
from page import Page, need_page

tests = Tests()
MATRIX = os.path.join(BUILD, "tests", "farm", "key_matrix")
NAMED = ("worker", "view", "submit", "operate", "admin")
SHARED = ("worker", "client", "admin", "web")
SMALL = ("--size", "16x16", "--spp", "2", "--format", "exr")
LONG = ("--size", "64x64", "--spp", "100000", "--format", "exr")


def make(farm, name, role, *options):
    return farm.named_key(name, role, *options)


def shared(farm, role):
    path = farm.path("shared-%s.key" % role)
    farm.cli("keygen", "--role", role, "--from", farm.key, "-o", path, expect=0, connect=False)
    return path


def refused(result, *words):
    expect(result.code == 5, result)
    for word in words:
        expect(word in result.err, "'%s' in %s" % (word, result))


def names(farm, key=None):
    return {k["name"]: k for k in farm.cli("key", "list", "--json", expect=0, key=key).json()["keys"]}


def submit(farm, key, *options):
    return farm.cli("submit", farm.scene(), "--json", *options, key=key)


@tests.add
def matrix():
    """every message of the protocol with every kind of key: taken or refused as the one table says"""
    with Farm() as farm:
        has_page = "noweb" not in BUILD
        farm.start_coordinator(*(("--web-apart", "--web", "127.0.0.1:0") if has_page else ("--no-web",)))
        kinds = [(make(farm, "n", role), "worker" if role == "worker" else "client") for role in NAMED]
        kinds += [(shared(farm, role), role) for role in SHARED if has_page or role != "web"]
        taken = []
        for path, role in kinds:
            done = subprocess.run([MATRIX] + farm.address.rsplit(":", 1) + [path, role], stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, timeout=120 * PATIENCE)
            text = done.stdout.decode() + done.stderr.decode()
            expect(done.returncode == 0, "%s: %s" % (os.path.basename(path), text))
            found = re.search(r"(\d+) messages, (\d+) taken, 0 differ", text)
            expect(found and int(found.group(1)) > 70, text)
            taken.append(int(found.group(2)))
        # The roles differ, each may do what those before it may, and the shared keys of people do all of it.
        expect(taken[1] < taken[2] < taken[3] < taken[4] == taken[6] == taken[7], taken)
        expect(not has_page or taken[7] < taken[8], taken)


@tests.add
def routes():
    """every route of the API with a token of every role: refused below the role that the one table says"""
    need_page()
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        table = json.loads(subprocess.run([os.path.join(BUILD, "gen", "openapi_routes")], stdout=subprocess.PIPE,
                                          check=True).stdout.decode())["routes"]
        roles = ("none", "view", "submit", "operate", "admin")
        tokens = {role: farm.cli("token", "create", "--role", role, "--json", expect=0).json()["secret"] for role in roles[1:]}
        tried = 0
        for route in table:
            path = re.sub(r"\{\w+(\.\.\.)?\}", "999", route["path"])
            least = roles.index("submit" if route["own"] and route["role"] != "view" else route["role"])
            for at, role in enumerate(roles[:-1]):
                if at >= least and not route["message"]:
                    continue  # what they answer has tests of its own; some never end
                answer = page.request(route["method"].upper(), path, token=tokens.get(role, ""),
                                      body=None if route["method"] == "get" else {})
                expect((answer.status in (401, 403)) == (at < least), "%s %s as %s: %s" % (route["method"], path, role, answer))
                tried += 1
        expect(tried > 150, tried)


@tests.add
def owners():
    """a submit key owns what it submits, and steers that alone; no key below operate invents an owner or pushes ahead"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        ana, rui, boss, looks = (make(farm, "ana@ws3", "submit"), make(farm, "rui", "submit"), make(farm, "boss", "operate"),
                                 make(farm, "eyes", "view"))
        job = submit(farm, ana, *LONG).json()["job"]
        expect(farm.job(job)["owner"] == "ana@ws3", farm.job(job))
        expect("ana@ws3" in farm.cli("list", "--mine", key=ana, expect=0).out, "her own")
        expect(str(job) not in farm.cli("list", "--mine", key=rui, expect=0).out.split(), "not his")
        refused(submit(farm, rui, "--owner", "ana@ws3", *SMALL), "submits for rui only")
        refused(submit(farm, rui, "--owner", "boss@studio", "--priority", "1000000", *SMALL), "submits for rui only")
        refused(submit(farm, rui, "--priority", "1000000", *SMALL), "at most 100")
        expect(submit(farm, rui, "--priority", "100", *SMALL).code == 0, "as a token may")
        refused(submit(farm, looks, *SMALL), "role submit")
        for verb in (("pause", job), ("priority", job, "--to", "1"), ("cancel", job), ("comment", job, "mine")):
            for key, word in ((rui, "belongs to ana@ws3"), (looks, "of the role operate")):
                refused(farm.cli(*verb, key=key), word)
        refused(farm.cli("priority", job, "--to", "101", key=ana), "at most 100")
        farm.cli("priority", job, "--to", "3", key=ana, expect=0)
        farm.cli("priority", job, "--to", "1000", key=boss, expect=0)
        farm.cli("pause", job, key=ana, expect=0)
        other = submit(farm, boss, "--owner", "rui", *LONG).json()["job"]
        farm.cli("cancel", other, key=rui, expect=0)
        refused(farm.cli("gc", key=boss), "of the role admin")
        refused(farm.cli("key", "list", key=boss), "of the role admin")
        # What is noted was proved.
        lines = [json.loads(line) for line in open(farm.path("store", "audit.log"), encoding="utf-8")]
        expect(any(l.get("key") == "submit 1 ana@ws3" and l["who"] == "ana@ws3" and l["verb"] == "submit" for l in lines), lines)


@tests.add
def a_worker_reads_its_leases():
    """a worker's key gets the blobs of its leases, and no others; it renders all the same"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        job = submit(farm, farm.key, *SMALL).json()["job"]
        scene = farm.job(job)["scene"]
        key = make(farm, "node", "worker")
        with_none = OddPeer(farm, key=key)
        with_none.say("blob " + scene)
        expect("no lease of this worker needs the blob" in with_none.wait_line("failure "), "a refusal")
        with_none.say("request 1")
        with_none.grant()
        with_none.say("blob " + scene)
        with_none.wait_line("blob_data")
        with_none.say("blob " + "00" * 32)
        expect("no lease of this worker" in with_none.wait_line("failure "), "another blob")
        with_none.end()
        farm.start_worker(key=key)
        farm.wait_for_job(job)


@tests.add
def revoked():
    """revoke ends a key's connections at once and for good, over kill -9; another name's stay"""
    with Farm() as farm:
        farm.start_coordinator("--no-web", "--no-shared-keys")
        admin, worker, ana, rui = (make(farm, "root", "admin"), make(farm, "node", "worker"), make(farm, "ana", "submit"),
                                   make(farm, "rui", "submit"))
        for role in ("worker", "client", "admin"):
            refused(farm.cli("list", key=shared(farm, role)), "everybody's" if role != "worker" else "worker's key")
        refused(farm.cli("list"), "everybody's")
        machine = farm.start_worker(key=worker)
        wait_for(lambda: farm.cli("workers", "--json", key=admin, expect=0).json()["workers"], "a worker")
        watch = farm.start_cli("watch", submit(farm, ana, *LONG).json()["job"], key=ana)
        other = OddPeer(farm, key=rui, role="client")
        wait_for(lambda: names(farm, admin)["ana"]["connections"] > 0, "her connection")
        expect(names(farm, admin)["node"]["roles"] == "worker", names(farm, admin))
        for name in ("ana", "node"):
            expect("revoked" in farm.cli("key", "revoke", name, key=admin, expect=0).out, name)
        expect(watch.wait(30 * PATIENCE) == 5, watch)
        watch.communicate()
        wait_for(lambda: "worker key of node (generation 1) was revoked" in machine.log_text(), "the worker to be told")
        expect(machine.alive(), "it waits for another key")
        other.say("workers")
        other.wait_line("worker_list")
        refused(farm.cli("list", key=ana), "was revoked")
        farm.coordinator.kill()
        farm.start_coordinator("--no-web", "--no-shared-keys", listen=farm.address)
        refused(farm.cli("list", key=ana), "was revoked")
        expect(names(farm, admin)["ana"]["revoked"], names(farm, admin))
        # The worker takes the next generation from its file, without a restart.
        os.replace(make(farm, "node", "worker", "--generation", "2"), worker)
        wait_for(lambda: farm.cli("workers", "--json", key=admin, expect=0).json()["workers"], "the worker again")
        farm.cli("list", key=make(farm, "ana", "submit", "--generation", "2"), expect=0)
        expect(not names(farm, admin)["ana"]["revoked"], names(farm, admin))


@tests.add
def rotated():
    """rotate: both generations are good for a while, then the older one's connections end"""
    with Farm() as farm:
        farm.start_coordinator("--no-web")
        first, second = make(farm, "ana", "submit"), make(farm, "ana", "submit", "--generation", "2")
        farm.cli("list", key=first, expect=0)
        refused(farm.cli("list", key=second), "not good yet")
        farm.cli("key", "rotate", "ana", "--keep", "1h", expect=0)
        for key in (first, second):
            farm.cli("list", key=key, expect=0)
        farm.coordinator.kill()
        farm.start_coordinator("--no-web", listen=farm.address)
        for key in (first, second):
            farm.cli("list", key=key, expect=0)
        old = OddPeer(farm, key=second, role="client")
        farm.cli("key", "rotate", "ana", "--keep", "2s", expect=0)
        refused(farm.cli("list", key=first), "revoked")
        expect("was replaced" in old.wait_line("failure "), "its connection is told")
        refused(farm.cli("list", key=second), "was replaced")
        farm.cli("list", key=make(farm, "ana", "submit", "--generation", "3"), expect=0)


@tests.add
def a_key_is_no_coordinator():
    """who has one key cannot play the coordinator to another one's holder"""
    with Farm() as farm:
        for number, role in enumerate(("worker", "submit", "admin")):
            mine, victim = make(farm, "mallory%d" % number, role), make(farm, "ana%d" % number, "submit")
            odd = OddPeer.coordinator(farm, key=mine)
            result = farm.cli("list", key=victim)
            expect(result.code in (4, 5) and "jobs" not in result.out, result)
            odd.wait()
            said = odd.rest + odd.process.stdout.read()
            expect(b"open" not in said and b"hello" not in said, "nothing reaches it: %s" % said)


@tests.add
def names_of_workers():
    """the name of a worker begins with the name of its key; no other worker can have it, and a block of it blocks all of the key"""
    def states(with_key=None):
        return {w["name"]: w["state"] for w in farm.cli("workers", "--json", expect=0).json()["workers"]}

    with Farm() as farm:
        farm.start_coordinator()
        node, other = make(farm, "node", "worker"), make(farm, "other", "worker")
        peers = [OddPeer(farm, hello="host=node", key=node) for _ in range(2)]
        peers.append(OddPeer(farm, hello="host=ws3", key=node))
        peers.append(OddPeer(farm, hello="host=ws3 name=gpu chosen=1", key=node))
        peers.append(OddPeer(farm, hello="host=ws4 name=node@gpu", key=other))  # as it was called with another key
        peers.append(OddPeer(farm, hello="host=node", key=other))
        peers.append(OddPeer(farm, hello="host=node"))  # of the farm's key
        expect(sorted(states()) == ["node", "node-2", "node@2", "node@gpu", "node@ws3", "other@node", "other@ws4"], states())
        taken = OddPeer(farm, hello=None)
        taken.say("hello host=ws5 name=other chosen=1")
        expect("belongs to the workers with the key" in taken.wait_line("failure "), "not refused")
        farm.cli("workers", "block", "node", expect=0)
        expect(sorted(n for n, s in states().items() if s == "blocked") == ["node", "node@2", "node@gpu", "node@ws3"], states())
        expect(farm.cli("workers", "show", "node", "--json", expect=0).json()["workers"][0]["name"] == "node", "another one")
        farm.coordinator.kill()
        farm.restart_coordinator()
        OddPeer(farm, hello="host=new", key=node)
        OddPeer(farm, hello="host=new", key=other)
        expect(states() == {"node@new": "blocked", "other@new": "idle"}, states())
        farm.cli("workers", "block", "node@new", expect=0)
        farm.cli("workers", "unblock", "node", expect=0)
        expect(states()["node@new"] == "blocked", states())
        farm.cli("workers", "unblock", "node@new", expect=0)
        expect(states()["node@new"] == "idle", states())
        result = farm.cli("key", "new", "ana@ws3", "--role", "worker", "--key", farm.key, connect=False)
        expect(result.code == 2 and "'@'" in result.err, result)


@tests.add
def files():
    """key files: made of the farm's key alone, never over another file, names and roles checked"""
    with Farm() as farm:
        path = make(farm, "ana@ws3", "submit")
        expect(os.stat(path).st_mode & 0o777 == 0o600, oct(os.stat(path).st_mode))
        text = open(path).read()
        expect(re.search(r"^azulejo-key-2 submit 1 ana@ws3 [0-9a-f]{64}$", text, re.M), text)
        again = farm.cli("key", "new", "ana@ws3", "--role", "submit", "--key", farm.key, expect=0, connect=False)
        expect(again.out == text, "the same key again: nothing is enrolled")
        for words, code in ((("--role", "submit", "--key", path), 3), (("--key", farm.key), 2),
                            (("--role", "client", "--key", farm.key), 2), (("--role", "submit", "--key", farm.key, "-o", path), 8)):
            result = farm.cli("key", "new", "rui", *words, connect=False)
            expect(result.code == code, result)
        for name in ("", "-x", "a b", "a/b", "x" * 64, "\u00e9"):
            expect(farm.cli("key", "new", "--role", "view", "--key", farm.key, "--", name, connect=False).code == 2, name)


if __name__ == "__main__":
    tests.run()
