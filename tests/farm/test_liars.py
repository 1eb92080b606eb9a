"""Workers that send what cannot be: they are named and blocked, and what they held is rendered by others."""
import os
import sqlite3
import sys
import time

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BUILD, Farm, Program, Skip, Tests, read_bytes, wait_for
from jobs import AREA, Outcome, expect
from exr import read_exr
from odd import OddPeer

tests = Tests()
SMALL = ["--size", "64x64", "--spp", "4"]  # 16 units
LIES = {"fill=-1": "negative radiance", "fill=-1e-30": "negative radiance", "fill=nan": "not finite",
        "fill=inf": "not finite", "samples=3": "samples", "rays=18446744073709551615": "rays", "floats=1535": "numbers",
        "lease=1000000": "never granted", "tile=16": "there is none", "cpu=%d" % (1 << 61): "processor time",
        "tile=15": "not a unit of lease"}


def blocked(farm):
    return {m["name"]: m for m in farm.cli("workers", "--json", expect=0).json()["marks"] if m["blocked"]}


@tests.add
def what_cannot_be():
    """a result that cannot be changes nothing; its worker is blocked by name, stays so, and others render its units"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        for place, (lie, words) in enumerate(LIES.items()):
            name = "liar-%d" % place
            peer = OddPeer(farm, hello="host=" + name)
            peer.say("request 1")
            expect(peer.grant()["job"] == number, "another job")
            peer.say("result " + lie)
            wait_for(lambda: name in blocked(farm), "the block of %s after %s" % (name, lie))
            expect("the coordinator" in blocked(farm)[name]["who"], blocked(farm))
            line = [e for e in farm.cli("log", number, expect=0).out.splitlines() if name + " is blocked" in e]
            expect(len(line) == 1 and words in line[0], (lie, farm.cli("log", number).out))
        again = OddPeer(farm, hello="host=liar-0")  # as if it were started again
        again.say("request 1")
        farm.start_worker()
        farm.wait_for_job(number)
        expect(farm.job(number)["conflicts"] == 0, farm.job(number))
        picture = Outcome(farm, number, "with-liars")
        farm.cli("workers", "unblock", "liar-0", expect=0)
        expect("liar-0" not in blocked(farm), "it cannot come back")
        honest = farm.submit(farm.scene(), *SMALL)
        again.end()
        farm.wait_for_job(honest)
        expect(Outcome(farm, honest, "honest").bits == picture.bits, "a lie is in the picture")


@tests.add
def another_ones_lease():
    """a result under a lease that another worker holds changes nothing; who sends it is blocked, and the holder goes on"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL)
        holder, thief = [OddPeer(farm, hello="host=" + name) for name in ("holder", "thief")]
        holder.say("request 1")
        held = holder.grant()
        thief.say("request 1")
        expect(thief.grant()["lease"] != held["lease"], "one lease for two")
        tile, group, part = held["units"][0]
        thief.say("result lease=%d epoch=%d tile=%d group=%d pass=%d" % (held["lease"], held["epoch"], tile, group, part))
        wait_for(lambda: "thief" in blocked(farm), "the block of the thief")
        expect("another worker" in farm.cli("log", number, expect=0).out, "not said")
        holder.say("result")
        holder.wait_line("ack ")
        expect(set(blocked(farm)) == {"thief"}, blocked(farm))


LIAR = os.path.join(BUILD, "tests", "farm", "liar")
FRAME = ["--size", "160x96", "--spp", "16"]  # 60 tiles, 480 units


def start_liar(farm, name, share, key=None, **how):
    """A worker as any other, which lies about a share of its units (liar.c)."""
    env = dict(os.environ, LIAR_SHARE=str(share), **{"LIAR_" + k.upper(): str(v) for k, v in how.items()})
    liar = Program("liar " + name, [LIAR, "--coordinator", farm.address, "--key", key or farm.key, "--threads", "1", "--name", name,
                                    "--cache", farm.path("cache-" + name)], farm.path(name + ".log"), env=env)
    farm.programs.append(liar)
    return liar


def picture(farm, number, name):
    return [read_exr(f).bits() for f in sorted(farm.fetch(number, name)) if f.endswith(".exr")]


def right_pictures(farm, jobs, bits):
    """wait for them; a job that is done may begin again between two looks, and then has nothing to fetch"""
    def is_right(number):
        if farm.job(number)["state"] != "done":
            return False
        result = farm.cli("fetch", number, "-o", farm.path("job-%d" % number), "--json")
        return result.code == 0 and bits == [
            read_exr(os.path.join(farm.folder, f)).bits() for f in sorted(result.json()["files"]) if f.endswith(".exr")]

    for number in jobs:
        wait_for(lambda n=number: is_right(n), "the right picture of job %d" % number)


def lies(share, honest, more, liars=("liar",), alone=True, **how):
    """Jobs with liars from the first unit on: they are blocked, and all pictures are those of a farm without them."""
    with Farm() as farm:
        farm.start_coordinator()
        worker = farm.start_worker("--name", "first")
        good = farm.submit(farm.scene(), *FRAME)
        farm.wait_for_job(good)
        bits = picture(farm, good, "good")
        worker.stop()
        if not alone:
            for name in honest:
                farm.start_worker("--name", name)
            farm.wait_for_workers(len(honest))
        for name in liars:
            start_liar(farm, name, share, **how)
        jobs = []
        if alone:
            jobs = [farm.submit(farm.scene(), *FRAME, *more)]
            farm.wait_for_job(jobs[0])  # it is alone: its word is all there is
            expect(share < 100 or picture(farm, jobs[0], "alone") != bits, "it does not lie")
            for name in honest:
                farm.start_worker("--name", name)
        else:
            farm.wait_for_workers(len(liars) + len(honest))
        while not jobs or set(blocked(farm)) != set(liars):
            expect(set(blocked(farm)) <= set(liars), blocked(farm))  # no honest one is blocked
            if len(jobs) == 20:  # audits follow the jobs; they are not counted by how soon
                wait_for(lambda: set(blocked(farm)) == set(liars), "audits of 20 jobs of 480 units to notice")
                break
            jobs.append(farm.submit(farm.scene(), *FRAME, *more))
            farm.wait_for_job(jobs[-1])
        for name in liars:
            expect("an audit" in blocked(farm)[name]["who"], blocked(farm))
        right_pictures(farm, jobs, bits)
        expect(not alone or len(jobs) > 1 or "rendered again" in farm.cli("log", jobs[0], expect=0).out, "not noted")
        print("# %g %% lies of %s: noticed with %d jobs of 480 units" % (share, ", ".join(liars), len(jobs)))


@tests.add
def always():
    """a worker that always delivers a constant 7 is blocked by name; what it rendered before is rendered again"""
    lies(100, ("second", "third"), ())


@tests.add
def always_and_expensive():
    """a liar that claims 50 s of processor time for each lie is noticed as well: what it claims delays no audit"""
    lies(100, ("second", "third"), (), cpu_s=50, until=20)


@tests.add
def over_restarts():
    """what waits to be rendered again outlives the coordinator, killed or ended: a liar that was alone is blocked after that"""
    def alone():
        liar = start_liar(farm, "liar", 100)
        jobs.append(farm.submit(farm.scene(), *FRAME))
        farm.wait_for_job(jobs[-1])
        expect(picture(farm, jobs[-1], "alone") != bits, "it does not lie")
        liar.stop()

    def stored():
        database = sqlite3.connect("file:%s?mode=ro" % farm.path("store/queue.sqlite"), uri=True)
        try:
            return database.execute("SELECT count(DISTINCT unit) FROM votes").fetchone()[0]
        finally:
            database.close()

    with Farm() as farm:
        farm.start_coordinator()
        first = farm.start_worker("--name", "first")
        jobs = [farm.submit(farm.scene(), *FRAME)]
        farm.wait_for_job(jobs[0])
        bits = picture(farm, jobs[0], "good")
        first.stop()
        alone()
        wait_for(lambda: stored() >= 40, "what waits to be in the store")  # the first 20 of each connection
        farm.coordinator.kill()
        farm.restart_coordinator()
        alone()
        expect(farm.coordinator.stop() == 0, "it does not end")
        expect(stored() >= 60, stored())
        farm.restart_coordinator()
        for name in ("second", "third"):
            farm.start_worker("--name", name)
        wait_for(lambda: set(blocked(farm)) == {"liar"}, "the block of the liar")
        right_pictures(farm, jobs, bits)
        wait_for(lambda: stored() == 0, "no votes that nobody needs")


@tests.add
def one_in_four():
    """a worker that lies in 25 % of its units is noticed, and no lie stays in a picture"""
    # Some 50 of its units are audited in 20 jobs: it escapes once in a million runs. Of 5 % lies, 6 in 100 would.
    lies(25, ("second", "third"), ())


@tests.add
def one_bit():
    """a worker with one flipped bit in memory, which 30 % of its units read, is noticed, and no such bit stays in a picture"""
    lies(30, ("second", "third"), (), flip=1)


def found_after(share):
    """Units of its own after which a liar beside three honest workers is blocked; all pictures are right then."""
    big = ["--size", "640x384", "--spp", "16"]  # 960 tiles, 7,680 units
    with Farm() as farm:
        farm.start_coordinator()
        workers = [farm.start_worker("--name", name) for name in ("first", "second", "third")]
        farm.wait_for_workers(3)
        good = farm.submit(farm.scene(), *big)
        farm.wait_for_job(good)
        bits = picture(farm, good, "good")
        start_liar(farm, "liar", share)
        farm.wait_for_workers(4)
        jobs = []
        while not blocked(farm):
            jobs.append(farm.submit(farm.scene(), *big))
            farm.wait_for_job(jobs[-1])
        expect(set(blocked(farm)) == {"liar"}, blocked(farm))
        right_pictures(farm, jobs, bits)
        expect(all(w.alive() for w in workers), "an honest worker ended")
        listed = farm.cli("workers", "--gone", "--json", expect=0).json()
        return sum(w["units_done"] for w in listed["workers"] + listed.get("gone", []) if w["name"] == "liar"), len(jobs)


@tests.add
def rare_lies():
    """a liar of 5 % and one of 0.1 % of their units are found as soon as OPERATIONS.md says, in 99 of 100 runs (LIARS=rare; minutes)"""
    if os.environ.get("LIARS") != "rare":
        raise Skip("LIARS=rare asks for it; test_audits.c simulates it")
    for share, most in ((5, 7300), (0.1, 460000)):
        units, jobs = found_after(share)
        print("# %g %%: found after %d units of its own, in %d jobs of 7,680" % (share, units, jobs), flush=True)
        expect(units <= most, "%d units" % units)


@tests.add
def two_that_agree():
    """two liars that tell the same lie are blocked beside three honest workers, and no honest one is"""
    lies(100, ("second", "third", "fourth"), (), liars=("liar", "accomplice"), alone=False)


@tests.add
def two_with_one_key():
    """two liars of one key that tell the same lie are one voice: an honest worker does not lose to them; with a second one the
    key is blocked, whatever a worker of it calls itself"""
    with Farm() as farm:
        farm.start_coordinator()
        keys = {name: farm.named_key(name, "worker") for name in ("first", "second", "eve")}
        farm.start_worker("--name", "first", key=keys["first"])
        good = farm.submit(farm.scene(), *FRAME)
        farm.wait_for_job(good)
        bits = picture(farm, good, "good")
        for name in ("left", "right"):
            start_liar(farm, name, 100, key=keys["eve"])
        farm.wait_for_workers(3)
        names = {w["name"] for w in farm.cli("workers", "--json", expect=0).json()["workers"]}
        expect(names == {"first", "eve@left", "eve@right"}, names)
        jobs = []
        while "workers eve@" not in farm.coordinator.log_text() and "workers first, eve@" not in farm.coordinator.log_text():
            expect(len(jobs) < 20, "20 jobs, and no audit has found that results differ")
            jobs.append(farm.submit(farm.scene(), *FRAME))
            farm.wait_for_job(jobs[-1])
        expect(not blocked(farm), blocked(farm))  # one word against one
        farm.start_worker("--name", "second", key=keys["second"])
        wait_for(lambda: blocked(farm), "a third voice to decide")
        expect(set(blocked(farm)) == {"eve"}, blocked(farm))
        right_pictures(farm, jobs, bits)
        start_liar(farm, "honest", 100, key=keys["eve"])
        farm.wait_for_workers(5)
        states = {w["name"]: w["state"] for w in farm.cli("workers", "--json", expect=0).json()["workers"]}
        expect(all((state == "blocked") == name.startswith("eve@") for name, state in states.items()), states)
        expect(len(states) == 5, states)
        more = farm.submit(farm.scene(), *FRAME)
        farm.wait_for_job(more)
        right_pictures(farm, [more], bits)


@tests.add
def one_machine_of_a_key():
    """where machines share a key, a machine that computes wrongly is blocked alone, and the others go on"""
    with Farm() as farm:
        farm.start_coordinator()
        key = farm.named_key("render", "worker")
        honest = [OddPeer(farm, hello="host=machine-%d" % i, key=key) for i in range(2)]
        liar = OddPeer(farm, hello="host=machine-9", key=key)
        number = farm.submit(farm.scene(), *SMALL)
        liar.say("request 1")
        liar.grant()
        liar.say("result fill=nan")
        wait_for(lambda: blocked(farm), "a block")
        expect(set(blocked(farm)) == {"render@machine-9"}, blocked(farm))
        honest[0].say("request 1")
        expect(honest[0].grant()["job"] == number, "the others get no work")
        for place in (8, 7):  # the third of a key is the key's
            other = OddPeer(farm, hello="host=machine-%d" % place, key=key)
            other.say("request 1")
            other.grant()
            other.say("result fill=nan")
            wait_for(lambda n=place: len(blocked(farm)) == 10 - n, "the next block")
        expect(set(blocked(farm)) == {"render@machine-9", "render@machine-8", "render"}, blocked(farm))
        expect("blocked" in {w["state"] for w in farm.cli("workers", "--json", expect=0).json()["workers"]}, "the others work")
        refused = farm.cli("workers", "unblock", "render@machine-1")
        expect(refused.code == 5 and "unblock 'render'" in refused.err, refused)
        farm.cli("workers", "unblock", "render", expect=0)
        states = {w["name"]: w["state"] for w in farm.cli("workers", "--json", expect=0).json()["workers"]}
        expect(set(states) == {"render@machine-0", "render@machine-1"} and "blocked" not in states.values(), states)


@tests.add
def honest_to_newcomers_audits():
    """a worker that begins to lie after its first units is noticed by later audits"""
    lies(100, ("second", "third"), (), alone=False, after=60)


@tests.add
def not_audited():
    """on a farm of one machine the manifest says that nothing was audited; with two it says how much was"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker("--name", "first")
        number = farm.submit(farm.scene(), *FRAME)
        farm.wait_for_job(number)
        audit = farm.cli("show", number, "--effects", "--json", expect=0).json()["audit"]
        expect(audit == {"units": 0, "says": "not audited"}, audit)
        expect("not audited" in farm.cli("show", number, "--effects", expect=0).out, "no words")
        farm.start_worker("--name", "second")
        farm.wait_for_workers(2)
        long = farm.submit(farm.scene(), "--size", "160x96", "--spp", "256")
        farm.wait_for_job(long)
        audit = farm.cli("show", long, "--effects", "--json", expect=0).json()["audit"]
        expect(audit["units"] > 0 and audit["says"] == "audited", audit)


def pictures_of_a_liar(farm, jobs, *more):
    """A farm without audits: the right bits, and jobs that a liar rendered alone; an honest worker takes its place."""
    worker = farm.start_worker("--name", "first")
    good = farm.submit(farm.scene(), *FRAME, *more)
    farm.wait_for_job(good)
    bits = picture(farm, good, "good")
    worker.stop()
    liar = start_liar(farm, "liar", 100)
    numbers = [farm.submit(farm.scene(), *FRAME, *more) for _ in range(jobs)]
    for number in numbers:
        farm.wait_for_job(number)
        expect(picture(farm, number, "lie-%d" % number) != bits, "it does not lie")
    return good, numbers, bits, liar


@tests.add
def distrust():
    """'azulejo distrust' renders again what a worker delivered, also in a job that is done and over a restart; it lists what
    was pruned, and leaves what was done before --since"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        good, (bad, pruned, target), bits, liar = pictures_of_a_liar(farm, 3)
        farm.cli("prune", pruned, "--films", "--yes", expect=0)
        wait_for(lambda: time.time() > farm.job(target)["finished_at"] + 3, "three seconds after the last job")
        later = farm.cli("distrust", "liar", "--since", "1s", "--json")  # all of it was done before
        expect(later.json()["again"] == 0 and later.json()["left"] == 0 and later.code == 0, later)
        expect("liar" in blocked(farm), "it is not blocked")
        report = farm.cli("distrust", "liar", "--json", expect=9).json()
        frames = [(j["job"], j["fate"], j["frames"]) for j in report["jobs"]]
        expect(frames == [(bad, "again", [1]), (pruned, "no_film", [1]), (target, "again", [1])], report)
        expect((report["again"], report["left"]) == (2, 1), report)
        farm.coordinator.kill()  # before any worker could render it
        farm.start_coordinator("--no-audits")
        farm.start_worker("--name", "second")
        right_pictures(farm, [bad, target], bits)
        expect(picture(farm, pruned, "pruned") != bits, "it was not to be rendered")
        expect("retry %d --frames 1" % pruned in farm.cli("log", pruned, expect=0).out, "no remedy in the log")
        again = farm.cli("distrust", "liar", expect=9).out
        expect("job %d" % bad not in again and "azulejo retry %d --frames 1" % pruned in again, again)
        farm.cli("retry", pruned, "--frames", "1", expect=0)
        right_pictures(farm, [pruned, good], bits)
        expect("no picture has samples of it" in farm.cli("distrust", "liar", expect=0).out, "there are frames left")
        expect("no worker 'nobody'" in farm.cli("distrust", "nobody", expect=5).err, "nobody is distrusted")
        expect("nobody" not in blocked(farm), blocked(farm))
        farm.cli("distrust", "liar", "--since", "3000-01-01", expect=2)


@tests.add
def distrust_tiles():
    """only the tiles with samples of the worker are rendered again, where others cannot have been touched by them"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        more = ("--exposure", "0", "--tonemap", "linear")
        good, _, bits, liar = pictures_of_a_liar(farm, 0, *more)
        farm.start_worker("--name", "second")
        farm.wait_for_workers(2)
        number = farm.submit(farm.scene(), "--size", "160x96", "--spp", "16", *more)
        farm.wait_for_job(number)
        expect(picture(farm, number, "mixed") != bits, "the liar had no part in it")
        liar.stop()
        farm.cli("distrust", "liar", expect=0)
        right_pictures(farm, [number], bits)
        log = farm.cli("log", number, expect=0).out
        expect(" of the 60 tiles of frame 1 are rendered again" in log, log)


def shown(farm, number):
    """What each frame of a job shows, layers and all; None: it is in work."""
    if farm.job(number)["state"] != "done":
        return None
    result = farm.cli("fetch", number, "-o", farm.path("shown-%d" % number), "--json")
    files = [os.path.join(farm.folder, f) for f in sorted(result.json()["files"])] if result.code == 0 else []
    exrs, pngs = ([f for f in files if f.endswith(end)] for end in (".exr", ".png"))
    return [(read_exr(exr).bits(), read_bytes(png)) for exr, png in zip(exrs, pngs)] or None


@tests.add
def distrust_reaches_the_frames_around():
    """pictures that are made of several frames (--denoise-around, --temporal) are made again when one of these was a liar's, also over
    a restart; one that cannot be stays and says so"""
    around, calm = ("--denoise", "on", "--denoise-around", "1"), ("--temporal", "2", "--auto-exposure", "key")
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        worker = farm.start_worker("--name", "first")
        jobs = {farm.submit(AREA, "--size", "48x48", "--spp", "8", "--frames", "1-3", "--format", "exr,png", *options): how
                for options, how in ((around, {"flip": 1}), (around, {"flip": 1}), (calm, {"value": 7}))}
        for number in jobs:
            farm.wait_for_job(number)
        bits = {number: shown(farm, number) for number in jobs}
        worker.stop()
        for number, how in jobs.items():
            liar = start_liar(farm, "liar", 100, **how)
            os.unlink(os.path.join(farm.store, "films", str(number), "frame-0002.kept"))
            farm.cli("retry", number, "--frames", "2", expect=0)
            wait_for(lambda n=number: shown(farm, n), "the lie")
            changed = [a != b for a, b in zip(shown(farm, number), bits[number])]
            expect(changed == [how != {"value": 7}, True, True], (how, changed))
            liar.stop()
        gone = list(jobs)[1]
        os.unlink(os.path.join(farm.store, "films", str(gone), "frame-0003.kept"))
        farm.cli("distrust", "liar", expect=0)
        wait_for(lambda: all(farm.job(n)["state"] == "queued" for n in jobs), "the jobs to begin again")
        farm.coordinator.kill()
        farm.start_coordinator("--no-audits")
        farm.start_worker("--name", "second")
        wait_for(lambda: all(shown(farm, n) == bits[n] for n in jobs if n != gone), "the right pictures")
        wait_for(lambda: shown(farm, gone), "the other job")
        same = [a == b for a, b in zip(shown(farm, gone), bits[gone])]
        expect(same == [True, False, False], same)  # the third cannot be made; the second is made without it
        expect("retry %d --frames 3" % gone in farm.cli("log", gone, expect=0).out, "no remedy in the log")
        farm.cli("retry", gone, "--frames", "3", expect=0)
        wait_for(lambda: shown(farm, gone) == bits[gone], "the right pictures")


@tests.add
def retry_after_block():
    """'retry --frames' keeps no result of a worker that a person has blocked since"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        _, (bad, ), bits, _ = pictures_of_a_liar(farm, 1)
        farm.start_worker("--name", "second")
        farm.cli("retry", bad, "--frames", "1", expect=0)
        farm.wait_for_job(bad)
        expect(picture(farm, bad, "kept") != bits, "the film was not kept")
        farm.cli("workers", "block", "liar", expect=0)
        farm.cli("retry", bad, "--frames", "1", expect=0)
        right_pictures(farm, [bad], bits)


@tests.add
def an_unblocked_worker_is_believed_again():
    """what a worker delivers after an 'unblock' counts, and is not rendered again"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        farm.start_worker("--name", "first")
        number = farm.submit(farm.scene(), *FRAME)
        farm.wait_for_job(number)
        bits = picture(farm, number, "good")
        farm.cli("distrust", "first", expect=0)
        farm.cli("workers", "unblock", "first", expect=0)
        wait_for(lambda: farm.cli("log", number, expect=0).out.count("rendered again") == 1, "the job to begin again")
        right_pictures(farm, [number], bits)
        # Its picture is right before it begins again, too.
        wait_for(lambda: farm.cli("retry", number, "--frames", "1").code == 0, "the job to be done again")
        right_pictures(farm, [number], bits)
        expect(farm.cli("log", number, expect=0).out.count("rendered again") == 1, farm.cli("log", number).out)


@tests.add
def verify():
    """'azulejo verify' renders tiles again on other workers, says which differ and whose they are, and exits with 12 then"""
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        good, (bad, ), _, _ = pictures_of_a_liar(farm, 1)
        farm.start_worker("--name", "second")
        farm.wait_for_workers(2)
        farm.cli("workers", "block", "liar", expect=0)  # it would be asked, too
        right = farm.cli("verify", good, "--tiles", 200, "--json", expect=0).json()
        expect(right["tiles_checked"] == 60 and right["tiles_differ"] + right["tiles_same_worker"] == 0, right)
        expect(sorted(t["tile"] for t in right["tiles"]) == list(range(60)), "not all tiles")
        wrong = farm.cli("verify", bad, "--tiles", 5, "--json", expect=12).json()
        expect(wrong["tiles_checked"] == wrong["tiles_differ"] == 5, wrong)
        for tile in wrong["tiles"]:
            expect(tile["rendered_by"] == ["liar"] and tile["verified_by"] == ["second"] and tile["differs"], tile)
        words = farm.cli("verify", bad, "--tiles", 1, expect=12).out
        expect("rendered by liar; now by second" in words and "1 tile rendered again, 1 differs" in words, words)
        path = [f for f in farm.fetch(good, "of-good") if f.endswith(".exr")][0]
        farm.cli("verify", path, "--tiles", 60, expect=0)
        lie = [f for f in farm.fetch(bad, "of-bad") if f.endswith(".exr")][0]
        farm.cli("verify", lie, "--tiles", 1, expect=12)
        expect("no film" not in farm.cli("prune", good, "--films", "--yes", expect=0).out, "")
        pruned = farm.cli("verify", good, "--tiles", 3, "--json", expect=0).json()
        expect([t["rendered_by"] for t in pruned["tiles"]] == [[]] * 3, pruned)
        farm.cli("verify", good, "--frame", 7, expect=5)
        with open(farm.path("other.exr"), "wb") as other:
            other.write(b"no picture")
        expect("other.exr" in farm.cli("verify", farm.path("other.exr"), expect=3).err, "the file is not named")
        farm.cli("remove", good, "--yes")
        farm.cli("verify", path, expect=5)


@tests.add
def verify_kinds():
    """half floats, alpha, regions, other layers and adaptive pictures verify as well"""
    kinds = [("--half", ), ("--aov", "alpha"), ("--aov", "albedo,normal"), ("--region", "16,16,100,70"),
             ("--target-error", "10/255", "--spp", "64")]
    with Farm() as farm:
        farm.start_coordinator("--no-audits")
        for name in ("first", "second"):
            farm.start_worker("--name", name)
        for kind in kinds:
            number = farm.submit(farm.scene(), *FRAME[:2], *(() if "--spp" in kind else FRAME[2:]), *kind)
            farm.wait_for_job(number)
            result = farm.cli("verify", number, "--tiles", 10)
            expect(result.code == 0, (kind, result))


@tests.add
def honest_ones_are_believed():
    """with honest workers nobody is blocked or doubted, and rendering again costs a part of the work"""
    with Farm() as farm:
        farm.start_coordinator("--log-level", "debug")
        for name in ("first", "second", "third"):
            farm.start_worker("--name", name)
        farm.wait_for_workers(3)
        for _ in range(3):
            farm.wait_for_job(farm.submit(farm.scene(), *FRAME))
        expect(not blocked(farm), blocked(farm))
        expect("other bits" not in farm.coordinator.log_text(), "they differ")


if __name__ == "__main__":
    tests.run()
