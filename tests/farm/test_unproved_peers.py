"""What a worker finds on its coordinator's port when that is not its coordinator: whatever speaks without
the farm's key may delay the worker, never end it."""
import os
import re
import shutil
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BUILD, ROOT, Farm, Program, Tests, wait_for
from jobs import Outcome, expect
from odd import OddPeer, Strangers, alert, passing_on, saying

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]
HTTP = saying(b"HTTP/1.1 400 Bad Request\r\nServer: other\r\nContent-Length: 0\r\n\r\n")
TROUBLE = "trying again until it works"


def check_renders(farm, name="rendered"):
    number = farm.submit(farm.scene(), *SMALL)
    farm.wait_for_job(number)
    expect(Outcome(farm, number, name).means[0] > 0.001, "a black picture")


def lines_with(worker, words):
    return [l for l in worker.log_text().splitlines() if words in l]


def status_number(name):
    """The number that stands for STATUS_ERR_name on the wire."""
    with open(os.path.join(ROOT, "common", "base", "status.h")) as source:
        return re.findall(r"^    X\((\w+),", source.read(), re.M).index("ERR_" + name)


def make_keys(farm):
    """Another farm's key, and this farm's keys for a worker and a client."""
    other, worker, client = (farm.path(n + ".key") for n in ("other", "worker", "client"))
    farm.cli("keygen", "-o", other, expect=0)
    farm.cli("keygen", "--role", "worker", "--from", farm.key, "-o", worker, expect=0)
    farm.cli("keygen", "--role", "client", "--from", farm.key, "-o", client, expect=0)
    return other, worker, client


def replace(path, source):
    """As a careful person does: the new file is complete before it has the name."""
    shutil.copyfile(source, path + ".new")
    os.chmod(path + ".new", 0o600)
    os.rename(path + ".new", path)


@tests.add
def strangers_on_the_port():
    """alerts, garbage, HTTP, a certificate, another farm and damaged handshakes end no worker"""
    with Farm() as farm, Farm() as other, Farm() as twin:
        other.start_coordinator()
        twin.start_coordinator(key=farm.key)
        stranger = Program("stranger", [os.path.join(BUILD, "tests", "farm", "stranger")],
                           farm.path("stranger.log"), pipe_stdout=True, pipe_stdin=True)
        farm.programs.append(stranger)
        certificate = "127.0.0.1:" + stranger.wait_line("listening on ")
        manners = [alert(40), alert(47), alert(51), HTTP, saying(bytes(range(256)) * 4), saying(b""),
                   passing_on(certificate), passing_on(other.address),
                   passing_on(twin.address, damage_client_at=20),
                   passing_on(twin.address, damage_server_at=20)]
        with Strangers(*manners) as strangers:
            farm.address = strangers.address
            workers = [farm.start_worker() for _ in range(5)]
            wait_for(lambda: strangers.met >= 2 * len(manners), "every stranger to be met")
        stranger.wait_line("met")
        for worker in workers:
            expect(worker.alive(), "%s: %s" % (worker.label, worker.log_text()))
        expect("joins" not in other.coordinator.log_text() + twin.coordinator.log_text(), "one joined")
        farm.restart_coordinator()
        farm.wait_for_workers(len(workers))
        check_renders(farm)


@tests.add
def trouble_is_said_once():
    """the same trouble is logged once, another kind once more, and its end once"""
    with Farm() as farm:
        with Strangers(alert(40), alert(47), alert(51), HTTP) as strangers:
            farm.address = strangers.address
            worker = farm.start_worker()
            wait_for(lambda: strangers.met >= 4, "the fourth stranger")
        wait_for(lambda: len(lines_with(worker, TROUBLE)) >= 3, "the empty port to be logged")
        farm.restart_coordinator()
        farm.wait_for_workers(1)
        troubles = lines_with(worker, TROUBLE)
        expect(len(troubles) == 3 and all(" warn" in l for l in troubles), worker.log_text())
        for line, words in zip(troubles, ("key was not taken", "wrong version", "cannot connect")):
            expect(words in line and farm.address in line, line)
        over = lines_with(worker, "connected after")
        expect(len(over) == 1 and int(re.search(r"after (\d+) failures", over[0]).group(1)) >= 5, over)


@tests.add
def key_replaced_in_place():
    """a worker whose key is not the farm's any more takes the new one from its file, unusable files in between"""
    with Farm() as farm:
        farm.start_coordinator()
        other, worker_key, client = make_keys(farm)
        key = farm.path("mine.key")
        replace(key, other)
        worker = farm.start_worker(key=key)
        wait_for(lambda: lines_with(worker, "another farm"), "the key to be refused")
        os.remove(key)
        wait_for(lambda: lines_with(worker, "No such file"), "the missing file")
        replace(key, client)
        wait_for(lambda: lines_with(worker, "client key cannot act as worker"), "the wrong role")
        expect(worker.alive() and farm.list_workers() == [], worker.log_text())
        replace(key, worker_key)
        farm.wait_for_workers(1)
        check_renders(farm)
        expect(len(lines_with(worker, "stays in use")) == 2, worker.log_text())


def meet_odd_coordinator(farm, answer, address="127.0.0.1:0"):
    """A worker's Hello to a coordinator that holds the key gets this answer; the worker."""
    peer = OddPeer.coordinator(farm, address)
    worker = farm.start_worker()
    peer.wait_line("hello")
    peer.say(answer)
    return worker


@tests.add
def refusals_of_the_own_farm():
    """a coordinator with the farm's key that refuses the release ends a worker with 10; other failures do not"""
    refused, unsupported, limit, mismatch = (
        status_number(n) for n in ("REFUSED", "UNSUPPORTED", "LIMIT", "MISMATCH"))
    with Farm() as farm:
        for answer in ("failure %d" % refused, "failure %d" % unsupported, "welcome version=999"):
            worker = meet_odd_coordinator(farm, answer)
            code = worker.wait(20)
            expect(code == 10, "%s: exit status %d: %s" % (answer, code, worker.log_text()))
            expect(re.search("odd coordinator will not have it|same release", worker.log_text()),
                   worker.log_text())
        worker = meet_odd_coordinator(farm, "failure %d" % limit)
        wait_for(lambda: lines_with(worker, TROUBLE), "the failure to be logged")
        farm.restart_coordinator()
        farm.wait_for_workers(1)
        # Once it works, no Failure ends it.
        farm.coordinator.stop()
        for code in (unsupported, mismatch):
            peer = OddPeer.coordinator(farm, farm.address)
            peer.wait_line("hello")
            peer.say("welcome")
            peer.wait_line("lease_request")
            peer.say("failure %d" % code)
            peer.wait(20)
        farm.restart_coordinator()
        farm.wait_for_workers(1)
        check_renders(farm)


@tests.add
def keys_that_cannot_work():
    """a key of another role ends a worker at once; with --exit-on-disconnect another farm's key does, too"""
    with Farm() as farm:
        farm.start_coordinator()
        other, _, client = make_keys(farm)
        for words, key, options in (("client key cannot act as worker", client, []),
                                    ("another farm", other, ["--exit-on-disconnect"])):
            worker = farm.start_worker(*options, key=key)
            code = worker.wait(20)
            expect(code == 5 and words in worker.log_text(), "%s: %s" % (code, worker.log_text()))
        worker = farm.start_worker(key=farm.path("missing.key"))
        expect(worker.wait(20) == 3 and "missing.key" in worker.log_text(), worker.log_text())
        expect(farm.list_workers() == [], "one of them joined")


if __name__ == "__main__":
    tests.run()
