"""What one token may take of the farm: disk, memory and connections, measured (common/schema/token_ceilings.h)."""
import hashlib
import os
import re
import socket
import sys
import threading

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import PATIENCE, SANITIZED, Farm, Tests, wait_for
from jobs import expect
from odd import OddPeer
from page import Page

tests = Tests()
MIB = 1 << 20
QUESTIONS = 4000


def token(page, role):
    answer = page.post("/api/v1/tokens", {"role": role, "name": "greedy"})
    expect(answer.status == 200, answer)
    return answer.json()["secret"]


def disk_used(folder):
    return sum(os.path.getsize(os.path.join(where, name)) for where, _, names in os.walk(folder) for name in names)


def memory(pid, what="VmRSS"):
    with open("/proc/%d/status" % pid) as status:
        return int(re.search(what + r":\s+(\d+) kB", status.read()).group(1)) * 1024


def put(page, secret, data):
    return page.request("PUT", "/api/v1/blobs/" + hashlib.sha256(data).hexdigest(), body=data, token=secret)


@tests.add
def a_token_does_not_fill_the_disk():
    """blobs that no job needs: a token may send so many, others go on, and gc --now gives all of it back"""
    with Farm() as farm:
        page = Page(farm.start_coordinator("--submit-blobs", "4M"))
        greedy, other = token(page, "submit"), token(page, "submit")
        blobs = os.path.join(farm.store, "blobs")
        answers = [put(page, greedy, bytes([i]) * MIB) for i in range(8)]
        expect([a.status for a in answers[:4]] == [200] * 4, answers[3])
        expect(all(a.status in (429, 503) for a in answers[4:]), answers[4])
        expect("gc --now" in answers[4].body.decode(), answers[4])
        expect(disk_used(blobs) <= 4 * MIB, disk_used(blobs))
        expect(put(page, other, b"small").status == 200, "another token is refused as well")
        farm.cli("gc", expect=0)
        expect(disk_used(blobs) > 4 * MIB, "gc without --now removed what was sent a moment ago")
        farm.cli("gc", "--now", expect=0)
        expect(disk_used(blobs) == 0, disk_used(blobs))
        expect(put(page, greedy, b"\7" * MIB).status == 200, "the token may send nothing after gc --now")


@tests.add
def what_jobs_need_does_not_count():
    """a job that is accepted frees its token's room, and gc --now keeps what it needs"""
    with Farm() as farm:
        page = Page(farm.start_coordinator("--submit-blobs", "4M"))
        number = farm.submit(farm.scene(), "--size", "32x24", "--spp", "2")
        before = disk_used(os.path.join(farm.store, "blobs"))
        farm.cli("gc", "--now", expect=0)
        expect(before > 0 and disk_used(os.path.join(farm.store, "blobs")) == before, "gc --now removed what a job needs")
        farm.start_worker()
        farm.wait_for_job(number)
        expect(page.get("/healthz").status == 200, "the page is gone")


@tests.add
def keys_of_names_have_them_too():
    """a submit key: blobs, pictures and connections are limited as a token's are; other names and the farm's key go on"""
    with Farm() as farm:
        farm.start_coordinator("--submit-blobs", "100")
        keys = {}
        for name, role in (("greedy", "submit"), ("ana", "submit"), ("boss", "admin")):
            keys[name] = farm.path(name + ".key")
            farm.cli("key", "new", name, "--role", role, "--key", farm.key, "-o", keys[name], expect=0, connect=False)
        scene = farm.scene()
        refused = farm.cli("submit", scene, "--size", "32x24", "--spp", "2", key=keys["greedy"])
        expect(refused.code == 3 and "this key has sent" in refused.err and "gc --now" in refused.err, refused)
        farm.cli("submit", scene, "--size", "32x24", "--spp", "2", key=keys["boss"], expect=0)
        number = farm.submit(scene, "--size", "32x24", "--spp", "2")
        watches = [farm.start_cli("watch", number, "--reconnect", "0", key=keys["ana"]) for _ in range(70)]
        ended = wait_for(lambda: [w for w in watches if w.poll() is not None][5:], "six watches to be refused", 120)
        out, err = ended[0].communicate()
        expect(ended[0].returncode == 3 and b"the key of ana has 64 connections" in err, (ended[0].returncode, out, err))
        expect(sum(w.poll() is None for w in watches) == 64, "not 64 are left")
        expect(farm.cli("list", key=keys["ana"]).code == 3, "one more is taken")
        farm.cli("list", key=keys["greedy"], expect=0)
        farm.cli("list", expect=0)
        for watch in watches:
            watch.kill()
            watch.communicate()
        wait_for(lambda: farm.cli("list", key=keys["ana"]).code == 0, "the key to be served again")


def named_key(farm, name, role="submit"):
    path = farm.path(name + ".key")
    farm.cli("key", "new", name, "--role", role, "--key", farm.key, "-o", path, expect=0, connect=False)
    return path


def heavy(farm, number):
    """A scene of some 450 KiB, as no other number gives."""
    path = farm.path("heavy-%d.obj" % number)
    with open(path, "w") as out:
        for i in range(48000):
            out.write("v %d %d %d\n" % (i % 100, i // 100, number + i * 7919 % 13))
        for i in range(1, 47999, 3):
            out.write("f %d %d %d\n" % (i, i + 1, i + 2))
    return path


@tests.add
def jobs_fill_no_disk():
    """what the jobs of one submit key take, with their scenes, has a ceiling: each scene counts once, also after a restart"""
    with Farm() as farm:
        options = ["--submit-blobs", "1M", "--submit-jobs", "3M"]
        farm.start_coordinator(*options)
        greedy, other = named_key(farm, "greedy"), named_key(farm, "other")
        small = ["--size", "16x16", "--spp", "2"]
        for _ in range(8):  # of one scene
            farm.cli("submit", heavy(farm, 0), *small, key=greedy, expect=0)
        answers = [farm.cli("submit", heavy(farm, i), *small, "--json", key=greedy) for i in range(1, 12)]
        expect(3 in [a.code for a in answers], ([a.code for a in answers], disk_used(os.path.join(farm.store, 'blobs'))))
        taken = [a.code for a in answers].index(3)
        expect(2 <= taken <= 8 and all(a.code == 3 for a in answers[taken:]), [a.code for a in answers])
        for word in ("greedy", "--submit-jobs", "3.0 MiB", "prune --mine"):
            expect(word in answers[taken].err, answers[taken].err)
        expect(farm.cli("submit", heavy(farm, 0), *small, key=greedy, expect=0), "nothing more of a scene that is there")
        farm.cli("submit", heavy(farm, 20), *small, key=other, expect=0)
        farm.cli("submit", heavy(farm, 21), *small, expect=0)
        farm.coordinator.kill()
        farm.restart_coordinator(*options)
        again = farm.cli("submit", heavy(farm, taken + 1), *small, key=greedy)
        expect(again.code == 3 and "--submit-jobs" in again.err, again)
        gone = answers[0].json()["job"]
        farm.cli("cancel", gone, key=greedy, expect=0)
        farm.cli("remove", gone, "--yes", key=greedy, expect=0)
        farm.cli("submit", heavy(farm, taken + 1), *small, key=greedy, expect=0)


@tests.add
def pictures_count_too():
    """films and pictures of jobs that have ended count with those of the role submit, until they are removed"""
    with Farm() as farm:
        farm.start_coordinator("--submit-jobs", "3M")
        greedy = named_key(farm, "greedy")
        farm.start_worker(threads=2)
        last = None
        for _ in range(12):
            result = farm.cli("submit", farm.scene(), "--size", "128x96", "--spp", "4", "--json", key=greedy)
            if result.code != 0:
                break
            last = result.json()["job"]
            farm.wait_for_job(last)
        expect(last and result.code == 3 and "--submit-jobs" in result.err, result)
        kept = float(re.search(r"greedy has jobs for ([0-9.]+) MiB", result.err).group(1))
        films, pictures = (disk_used(os.path.join(farm.store, kind)) / MIB for kind in ("films", "outputs"))
        expect(films > 0.15 and pictures > 0.15 and abs(kept - films - pictures) < 0.1, (result.err, films, pictures))
        farm.cli("prune", "--films", "--mine", "--yes", key=greedy, expect=0)
        farm.cli("submit", farm.scene(), "--size", "128x96", "--spp", "4", key=greedy, expect=0)


@tests.add
def who_does_not_read_is_not_heard():
    """a key asks again and again and reads no answer: few wait in the coordinator's memory, and nothing is lost when it reads"""
    with Farm() as farm:
        coordinator = farm.start_coordinator()
        key = farm.path("deaf.key")
        farm.cli("key", "new", "deaf", "--role", "view", "--key", farm.key, "-o", key, expect=0, connect=False)
        scene = farm.scene()
        for i in range(20):
            farm.submit(scene, "--size", "32x24", "--spp", "2", "--name", "n" * 60)
        before = memory(coordinator.pid)
        deaf = [OddPeer(farm, role="client", key=key) for _ in range(4)]
        for peer in deaf:
            peer.say("deaf")
            peer.say("times %d query 0" % QUESTIONS)
        most = 0
        for _ in range(60):
            farm.cli("list", expect=0)  # others are served
            most = max(most, memory(coordinator.pid) - before)
        expect(SANITIZED or most < 64 * MIB, "the answers take %d MiB" % (most / MIB))
        patient = OddPeer(farm, role="client", key=key)
        patient.say("times 500 query 0")
        for _ in range(500):
            expect("20" in patient.wait_line("jobs "), "an answer has other jobs")


@tests.add
def memory_goes_back():
    """many previews by one token: few are made at once, and their memory goes back"""
    with Farm() as farm:
        coordinator = farm.start_coordinator()
        page = Page(coordinator)
        worker = farm.start_worker("--threads", "2")
        number = farm.submit(farm.scene(), "--size", "1920x1080", "--spp", "100000")
        wait_for(lambda: farm.job(number)["samples_done"] > 1920 * 1080, "samples")
        worker.kill()
        secret = token(page, "view")
        path = "/api/v1/jobs/%d/frames/1/preview.png?tonemap=mantiuk06" % number
        wait_for(lambda: page.get(path + "&exposure=0", token=secret, limit_s=120).status == 200, "a preview", 120)
        before = memory(coordinator.pid)
        answers = []

        def ask(i):
            answers.append(page.get(path + "&exposure=%.1f" % (i / 10), token=secret, limit_s=120).status)
        askers = [threading.Thread(target=ask, args=(i, )) for i in range(1, 9)]
        for asker in askers:
            asker.start()
        for asker in askers:
            asker.join(180 * PATIENCE)
        expect(200 in answers and set(answers) <= {200, 429, 503} and answers.count(200) < 8, answers)
        if SANITIZED:  # its allocator keeps what was freed
            return
        wait_for(lambda: memory(coordinator.pid) < before + 48 * MIB, "the memory to go back: %d MiB, then %d MiB" % (
            before / MIB, memory(coordinator.pid) / MIB), 20)


@tests.add
def connections_of_one_token():
    """a token that holds as many connections as it can shuts out nobody behind the same address"""
    with Farm() as farm:
        page = Page(farm.start_coordinator())
        greedy, other = token(page, "view"), token(page, "view")
        streams, taken = [], 0
        try:
            for _ in range(192):
                peer = socket.create_connection(("127.0.0.1", page.port), timeout=20 * PATIENCE)
                streams.append(peer)
                peer.sendall(("GET /api/v1/events HTTP/1.1\r\nHost: %s\r\nAuthorization: Bearer %s\r\n\r\n" %
                              (page.host, greedy)).encode())
                taken += peer.recv(12) == b"HTTP/1.1 200"
            expect(taken == 64, "%d streams were given to one token" % taken)
            expect(page.get("/api/v1/jobs", token=other).status == 200, "another token is shut out")
        finally:
            for peer in streams:
                peer.close()
        wait_for(lambda: page.get("/api/v1/jobs", token=greedy).status == 200, "the token to be served again")


if __name__ == "__main__":
    tests.run()
