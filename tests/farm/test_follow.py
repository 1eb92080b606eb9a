"""fetch and submit --follow: the pictures of a job as they are finished, whatever happens to the coordinator; the one
meaning of -o; videos (--video)."""
import json
import os
import shutil
import signal
import struct
import time

from exr import read_exr
from farm import Farm, Skip, Tests, read_bytes, readable, wait_for
from jobs import expect

tests = Tests()
SMALL = ("--size", "32x32", "--spp", "4")
# One thread renders a frame in a good part of a second: there is a middle to look at.
SLOW = ("--size", "160x160", "--spp", "64")


def there(folder):
    return sorted(f for f in os.listdir(folder) if not f.startswith(".")) if os.path.isdir(folder) else []


def ends(process, limit_s=120):
    out, err = process.communicate(timeout=limit_s)
    return process.returncode, out.decode(), err.decode()


@tests.add
def frames_as_they_finish():
    """fetch --follow brings each frame when it is done, over a restart of the coordinator, and ends as the job does"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SLOW, "--frames", "1-6", "--name", "walk")
        client = farm.start_cli("fetch", number, "-o", "all/", "--follow", "--manifest")
        wait_for(lambda: "walk-0001.png" in there(farm.path("all")), "the first frame")
        expect(farm.job(number)["state"] == "running", "a frame came before the job's end")
        farm.coordinator.kill()
        farm.restart_coordinator()
        code, out, err = ends(client)
        expect(code == 0, (code, out, err))
        expect("is back" in err, err)
        expect(there(farm.path("all")) == sorted("walk-%04d.%s" % (f, e) for f in range(1, 7)
                                                 for e in ("exr", "png", "effects.json")), out)
        expect(out.count("walk-0003.exr") == 1, out)
        for path in farm.fetch(number, "again"):
            expect(read_bytes(path) == read_bytes(farm.path("all", os.path.basename(path))), path)


@tests.add
def a_frozen_coordinator():
    """a coordinator that listens but does not answer is waited for, and said to be silent, also at the start"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL, "--name", "walk")
        commands = {"watch": ("watch", number), "log": ("log", number, "--follow"),
                    "fetch": ("fetch", number, "-o", "new/", "--follow"), "top": ("top", )}
        early = {k: farm.start_cli(*v) for k, v in commands.items()}
        early["fetch"].kill()
        early["fetch"].communicate()
        early["fetch"] = farm.start_cli("fetch", number, "-o", "old/", "--follow")
        wait_for(lambda: farm.job(number)["state"] == "queued", "the job")
        for name in ("log", "top"):  # in the midst of its first handshake a client would lose its connection
            expect(readable(early[name].stdout.fileno(), 60), name)
        farm.coordinator.signal(signal.SIGSTOP)
        late = {k: farm.start_cli(*v, "--timeout", "2") for k, v in commands.items()}
        once = farm.cli("list", "--timeout", "2")
        expect(once.code == 7 and "within 2 seconds" in once.err, once)
        time.sleep(8)  # longer than --timeout, and than silence goes without a word
        for name, client in list(early.items()) + list(late.items()):
            expect(client.poll() is None, "%s ended with %s: %s" % (name, client.returncode, client.poll() is not None
                                                                    and client.communicate()))
        farm.coordinator.signal(signal.SIGCONT)
        farm.start_worker()
        for when, clients in (("before", early), ("after", late)):
            for name, client in clients.items():
                if name == "top":
                    client.send_signal(signal.SIGINT)
                code, out, err = ends(client)
                expect(code == (130 if name == "top" else 0), (when, name, code, out, err))
                if when == "before" and name == "watch":
                    expect("does not answer" in err and "answers again" in err, err)
                if when == "after" and name != "top":
                    expect("waiting up to" in err and "is back" in err, (name, err))


@tests.add
def what_is_there():
    """what is there and whole is not sent again; what is damaged is"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-3", "--name", "a")
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", "out/", expect=0)
        whole = {f: read_bytes(farm.path("out", f)) for f in there(farm.path("out"))}
        with open(farm.path("out", "a-0002.exr"), "r+b") as damaged:
            damaged.truncate(1000)
        with open(farm.path("out", "a-0003.png"), "r+b") as damaged:
            damaged.seek(100)
            damaged.write(b"x")
        os.unlink(farm.path("out", "a-0001.exr"))
        stamps = {f: os.stat(farm.path("out", f)).st_mtime_ns for f in there(farm.path("out"))}
        for options in (("--follow",), ()):
            result = farm.cli("fetch", number, "-o", "out/", *options, expect=0)
            expect(result.out.count("unchanged") == (3 if options else 6), result)
            expect({f: read_bytes(farm.path("out", f)) for f in there(farm.path("out"))} == whole, result)
        for name in ("a-0001.png", "a-0002.png", "a-0003.exr"):
            expect(os.stat(farm.path("out", name)).st_mtime_ns == stamps[name], name + " was written again")
        told = farm.cli("fetch", number, "-o", "out/", "--json", expect=0).json()
        expect(len(told["files"]) == 6 and told["unchanged"] == 6, told)


@tests.add
def the_end():
    """fetch --follow ends with the status of the job's end: cancelled, and frames that are missing; ranges"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SLOW, "--frames", "1-90", "--name", "long")
        client = farm.start_cli("fetch", number, "-o", "part/", "--follow", "--frames", "1-80x2", "--json")
        wait_for(lambda: farm.job(number)["frames_done"] > 1, "two frames")
        farm.cli("cancel", number, expect=0)
        code, out, err = ends(client)
        expect(code == 6, (code, out, err))
        files = json.loads(out)["files"]
        expect(farm.path("part", "long-0001.exr") in [farm.path(f) for f in files], out)
        expect(not any("-0002." in f for f in there(farm.path("part"))), there(farm.path("part")))
        # Ctrl-C leaves the job alone.
        number = farm.submit(farm.scene(), *SLOW, "--frames", "1-90")
        client = farm.start_cli("fetch", number, "-o", "two/", "--follow")
        wait_for(lambda: there(farm.path("two")), "a frame")
        client.send_signal(signal.SIGINT)
        code, out, err = ends(client)
        expect(code == 130 and "continues" in err, (code, err))
        expect(farm.job(number)["state"] == "running", "the job")
        farm.cli("cancel", number, "--discard", expect=0)
        # A job that is done, a file of which was lost.
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-2")
        farm.wait_for_job(number)
        os.unlink(farm.path("store", "outputs", str(number), "frame-0002.png"))
        result = farm.cli("fetch", number, "-o", "lost/", "--follow", expect=9)
        expect("frame 2" in result.err, result)
        result = farm.cli("fetch", number, "--follow", "--preview", "x.png", expect=2)
        expect("--follow" in result.err, result)
        farm.cli("fetch", 999, "--follow", expect=5)


@tests.add
def developed_meanwhile():
    """who follows a job that is developed in another way, or averages over frames, ends with the pictures as they are then"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SLOW, "--frames", "1-5", "--name", "d")
        client = farm.start_cli("fetch", number, "-o", "d/", "--follow", "--json")
        wait_for(lambda: "d-0001.png" in there(farm.path("d")), "a picture")
        first = read_bytes(farm.path("d", "d-0001.png"))
        farm.cli("develop", number, "--tonemap", "linear", "--no-wait", expect=0)
        code, out, err = ends(client)
        expect(code == 0, (code, out, err))
        files = json.loads(out)["files"]
        expect(len(files) == len(set(files)) == 10, files)
        for path in farm.fetch(number, "after"):
            expect(read_bytes(path) == read_bytes(farm.path("d", os.path.basename(path))), path)
        expect(read_bytes(farm.path("d", "d-0001.png")) != first, "the first look")
        result = farm.cli("submit", farm.scene(), *SMALL, "--frames", "1-4", "--temporal", "3", "-o", "t/", "--follow", expect=0)
        expect(len(there(farm.path("t"))) == 8, result)


@tests.add
def submitted_and_followed():
    """submit -o OUT --follow brings the pictures; -o without it still names the job, and says what it will mean"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        result = farm.cli("submit", farm.scene(), *SMALL, "--frames", "1-2", "-o", "new/dir", "--name", "n", "--follow",
                          expect=0)
        expect(there(farm.path("new/dir")) == ["n-0001.exr", "n-0001.png", "n-0002.exr", "n-0002.png"], result)
        result = farm.cli("submit", farm.scene(), *SMALL, "-o", "one.png", "--follow", "--json", expect=0)
        expect(there(farm.folder).count("one.png") == 1 and result.json()["job"]["state"] == "done", result)
        expect(result.json()["files"] == ["one.png"] and not os.path.exists(farm.path("one.exr")), result)
        result = farm.cli("submit", farm.scene(), *SMALL, "-o", "picture", expect=0)
        expect(farm.job(int(result.out))["name"] == "picture" and "--name" in result.err, result)
        for out in ("some/where", "x.png", "dir/"):
            result = farm.cli("submit", farm.scene(), *SMALL, "-o", out, expect=2)
            expect("--follow" in result.err, result)
        result = farm.cli("submit", farm.scene(), *SMALL, "-o", "p", "--name", "n", expect=2)
        expect("--follow" in result.err, result)


@tests.add
def one_meaning():
    """-o is a folder, or one picture's file, for render, fetch, develop and tonemap"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), *SMALL, "--frames", "1-2", "--name", "a")
        farm.wait_for_job(number)
        os.mkdir(farm.path("old"))
        for out in ("new", "new2/", "old", "deep/er/"):
            farm.cli("fetch", number, "-o", out, expect=0)
            expect(there(farm.path(out)) == ["a-0001.exr", "a-0001.png", "a-0002.exr", "a-0002.png"], out)
        farm.cli("fetch", number, "-o", "files/b.png", expect=0)
        expect(there(farm.path("files")) == ["b-0001.png", "b-0002.png"], there(farm.path("files")))
        farm.cli("fetch", number, "--frames", 2, "-o", "still.exr", expect=0)
        expect(read_bytes(farm.path("still.exr")) == read_bytes(farm.path("new", "a-0002.exr")), "still.exr")
        result = farm.cli("fetch", number, "-o", "x.jpg", expect=5)
        expect("--format jpg" in result.err, result)
        farm.cli("develop", number, "--tonemap", "linear", "-o", "lin/", expect=0)
        expect(there(farm.path("lin")) == ["a-0001.png", "a-0002.png"], there(farm.path("lin")))
        farm.cli("develop", number, "--tonemap", "linear", "-o", "lin/c.png", expect=0)
        expect("c-0001.png" in there(farm.path("lin")), there(farm.path("lin")))
        farm.cli("tonemap", "still.exr", "-o", "far/away/t.png", connect=False, expect=0)
        farm.cli("tonemap", "still.exr", "-o", "maps/", connect=False, expect=0)
        expect(there(farm.path("maps")) == ["still.png"], there(farm.path("maps")))
        result = farm.cli("estimate", farm.scene(), "--size", "32x32", "-o", "est", connect=False)
        expect(result.code == 2 and "--name" in result.err, result)


def probe(path):
    """Width, height, frames a second and frames of a video."""
    import subprocess
    out = subprocess.run(["ffprobe", "-v", "error", "-count_frames", "-select_streams", "v", "-show_entries",
                          "stream=width,height,r_frame_rate,nb_read_frames,codec_name", "-of", "json", path],
                         stdout=subprocess.PIPE, check=True).stdout
    stream = json.loads(out)["streams"][0]
    return stream["width"], stream["height"], stream["r_frame_rate"], int(stream["nb_read_frames"])


FAKE = """#!/bin/sh
echo "$@" > "$FAKE_LOG"
for last; do :; done
cat > "$last"
"""


@tests.add
def videos():
    """--video hands ffmpeg the pictures in their order at the job's rate; it says what to install; nothing is left behind"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "33x31", "--spp", "4", "--frames", "1-5", "--fps", "12.5", "--name", "f")
        farm.wait_for_job(number)
        os.mkdir(farm.path("bin"))
        bare = {"PATH": farm.path("bin"), "FAKE_LOG": farm.path("words")}
        result = farm.cli("fetch", number, "-o", "p/", "--video", "x.mp4", env=bare, expect=3)
        expect("apt-get install ffmpeg" in result.err and not os.path.exists(farm.path("p")), result)
        fake = farm.path("bin", "ffmpeg")
        with open(fake, "w") as out:
            out.write(FAKE)
        os.chmod(fake, 0o755)
        os.symlink(shutil.which("cat"), farm.path("bin", "cat"))
        for name, options in (("all.mp4", ()), ("two.mkv", ("--frames", "2,5")), ("exr.mp4", ("-o", "e.exr"))):
            farm.cli("fetch", number, "-o", "p/", *options, "--video", name, env=bare, expect=0)
            frames = (2, 5) if name == "two.mkv" else range(1, 6)
            wanted = b"".join(read_bytes(farm.path("p", "f-%04d.png" % f)) for f in frames)
            expect(read_bytes(farm.path(name)) == wanted, name)
            expect("-framerate 12.5 " in read_bytes(farm.path("words")).decode(), name)
        result = farm.cli("fetch", number, "-o", "p/", "--video", "x.avi", env=bare, expect=2)
        expect(".mp4" in result.err, result)
        with open(fake, "w") as out:
            out.write("#!/bin/sh\necho no such codec >&2\nexit 3\n")
        result = farm.cli("fetch", number, "-o", "p/", "--video", "x.mp4", env=bare, expect=8)
        expect("no such codec" in result.err and "exit status 3" in result.err, result)
        expect(not [f for f in os.listdir(farm.folder) if "x.mp4" in f or "ffmpeg" in f], os.listdir(farm.folder))
        one = farm.submit(farm.scene(), *SMALL)
        farm.wait_for_job(one)
        result = farm.cli("fetch", one, "--video", "x.mp4", env=bare, expect=2)
        expect("one frame" in result.err, result)
        result = farm.cli("submit", farm.scene(), *SMALL, "--video", "x.mp4", env=bare, expect=2)
        expect("--follow" in result.err, result)


@tests.add
def interrupted_videos():
    """Ctrl-C ends a fetch whose ffmpeg is slow, and a render, without a video and without leftovers; the pictures stay"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "300x200", "--spp", "1", "--frames", "1-3", "--name", "f")
        farm.wait_for_job(number)
        os.mkdir(farm.path("bin"))
        fake = farm.path("bin", "ffmpeg")
        with open(fake, "w") as out:
            out.write("#!/bin/sh\n: > \"$FAKE_LOG\"\nexec sleep 1000\n")
        os.chmod(fake, 0o755)
        slow = {"PATH": farm.path("bin") + ":" + os.environ["PATH"], "FAKE_LOG": farm.path("begun")}
        client = farm.start_cli("fetch", number, "-o", "p/", "--video", "p/x.mp4", env=slow)
        wait_for(lambda: os.path.exists(farm.path("begun")), "ffmpeg")
        client.send_signal(signal.SIGINT)
        code, out, err = ends(client)
        expect(code == 130 and "no video" in err, (code, out, err))
        expect(sorted(f for f in os.listdir(farm.path("p")) if f != ".azulejo-fetched") == there(farm.path("p")), "leftovers")
        expect(len(there(farm.path("p"))) == 6, there(farm.path("p")))
        os.mkdir(farm.path("r"))
        client = farm.start_cli("render", farm.scene(), *SLOW, "--frames", "1-900", "-o", "r/", "--video", "r/x.mp4", env=slow)
        wait_for(lambda: b"left" in os.read(client.stderr.fileno(), 4096), "progress")
        client.send_signal(signal.SIGINT)
        code, out, err = ends(client)
        expect(code == 130 and "written" in err, (code, out, err))
        expect(sorted(os.listdir(farm.path("r"))) == there(farm.path("r")) != [], os.listdir(farm.path("r")))
        expect(not [f for f in there(farm.path("r")) if f.endswith(".mp4")], "a video")


@tests.add
def real_videos():
    """with ffmpeg: a video of the size (made even), rate and length that it should have, from fetch, submit and render"""
    if not shutil.which("ffmpeg") or not shutil.which("ffprobe"):
        raise Skip("ffmpeg is not installed")
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        options = ("--size", "33x31", "--spp", "4", "--frames", "1-5", "--fps", "12.5")
        result = farm.cli("submit", farm.scene(), *options, "-o", "s/", "--follow", "--video", "s/film.mp4", expect=0)
        expect(probe(farm.path("s", "film.mp4")) == (34, 32, "25/2", 5), result)
        result = farm.cli("fetch", 1, "-o", "s/", "--video", "again.webm", "--json", expect=0)
        expect(result.json()["video"] == "again.webm" and result.json()["unchanged"] == 10, result)
        expect(probe(farm.path("again.webm"))[3] == 5, "webm")
        result = farm.cli("render", farm.scene(), *options, "--format", "exr", "-o", "r/", "--video", "r/film.mp4",
                          connect=False, expect=0)
        expect(probe(farm.path("r", "film.mp4")) == (34, 32, "25/2", 5), result)
        expect(len(there(farm.path("r"))) == 6, there(farm.path("r")))
        result = farm.cli("render", farm.scene(), *SMALL, "-o", "r/", "--video", "r/film.mp4", connect=False, expect=2)
        expect("--frames" in result.err, result)


@tests.add
def several_pictures():
    """tonemap maps several pictures into a folder under their names, as each by itself, and as a job's --temporal does"""
    with Farm() as farm:
        farm.start_coordinator()
        farm.start_worker()
        scene = os.path.join(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))), "scenes",
                             "features", "motion.gltf")
        look = ("--tonemap", "reinhard02", "--auto-exposure", "key")
        number = farm.submit(scene, *SMALL, "--frames", "0-3", *look, "--temporal", "3", "--name", "m")
        farm.wait_for_job(number)
        farm.cli("fetch", number, "-o", "job/", expect=0)
        exrs = ["job/m-%04d.exr" % f for f in range(4)]
        result = farm.cli("tonemap", *exrs, "-o", "maps/", *look, connect=False, expect=0)
        expect(there(farm.path("maps")) == ["m-%04d.png" % f for f in range(4)] and result.out.count("\n") == 4, result)
        farm.cli("tonemap", exrs[2], "-o", "one.png", *look, connect=False, expect=0)
        expect(read_bytes(farm.path("one.png")) == read_bytes(farm.path("maps", "m-0002.png")), "each by itself")
        farm.cli("tonemap", *exrs, "-o", "calm", *look, "--temporal", 3, connect=False, expect=0)
        for f in range(4):
            name = "m-%04d.png" % f
            expect(read_bytes(farm.path("calm", name)) == read_bytes(farm.path("job", name)), name)
        expect(any(read_bytes(farm.path("calm", f)) != read_bytes(farm.path("maps", f)) for f in there(farm.path("maps"))),
               "--temporal changes nothing")
        for words, told in ((exrs[:2] + ["-o", "x.png"], "folder"), ([exrs[0], exrs[0], "-o", "x/"], "both"),
                            (exrs[:1] + ["-o", "x.png", "--temporal", "3"], "several"),
                            (exrs[:3], "-o"), (exrs[:2] + ["-o", "x/", "--sweep", "key=1,2"], "one sheet")):
            result = farm.cli("tonemap", *words, connect=False, expect=2)
            expect(told in result.err, result)


tests.run()
