#!/usr/bin/env python3
"""The API: every route answers as openapi.yaml says, in states that allow it and in others, for each role;
submitting over HTTP; files; what strangers may send."""
import glob
import hashlib
import json
import os
import random
import re
import shlex
import shutil
import subprocess
import time

from contract import Contract
from farm import ROOT, Failure, Farm, Skip, Tests, read_bytes, wait_for
from jobs import SLOW, expect
from page import Page
from png import Png

tests = Tests()
JOB, FRAME = "/api/v1/jobs/{job}", "/api/v1/jobs/{job}/frames/{frame}"
ENDLESS = ("--size", "96x64", "--spp", "1000000")
SHORT = ("--size", "48x32", "--spp", "4")


def started(farm, *options):
    return Contract(Page(farm.start_coordinator(*options)))


def made_token(api, role, owner):
    return api.does(200, "post", "/api/v1/tokens", {"role": role, "owner": owner, "name": role}).json()["secret"]


def info(api, job):
    return api.does(200, "get", JOB, job=job).json()["jobs"][0]


def reaches(api, job, state):
    wait_for(lambda: info(api, job)["state"] == state, "job %d to be %s" % (job, state))


def allowed(api, verb, job, state, body=None):
    answer = api.does(200, "post", JOB + "/" + verb, body, job=job)
    got = answer.json()["jobs"][0]
    expect(got["job"] == job and got["state"] in state.split(), "%s: %s" % (verb, got["state"]))
    return got


def refused(api, verb, job, body=None):
    answer = api.does(409, "post", JOB + "/" + verb, body, job=job)
    expect(len(answer.json()["detail"]) > 20, "a sentence: %s" % answer)


@tests.add
def every_route():
    """every route answers as described; every verb in a state that allows it, and in one that does not"""
    with Farm() as farm:
        api = started(farm)
        worker = farm.start_worker()
        name = wait_for(lambda: api.does(200, "get", "/api/v1/workers").json()["workers"], "the worker")[0]["name"]
        for path in ("/", "/docs/errors", "/healthz", "/readyz", "/metrics", "/api/v1/farm", "/api/v1/operators",
                     "/api/v1/effects", "/api/v1/verbs", "/api/v1/openapi.yaml", "/api/v1/session", "/api/v1/store"):
            api.does(200, "get", path)
        api.does(200, "get", "/assets/{file}", file="style.css")
        api.does(200, "get", "/assets/{folder}/{file}", folder="picture", file="gl.js")
        # Two programs print the same table: the page and a script read it alike.
        theirs = json.loads(farm.cli("tonemap", "--list", "--json", connect=False, expect=0).out)["operators"]
        ours = api.does(200, "get", "/api/v1/operators").json()["operators"]
        expect([{k: o[k] for k in t} for o, t in zip(ours, theirs)] == theirs and len(ours) == len(theirs), ours)

        done = farm.submit(farm.scene(), "--format", "exr,png,jpg", *SHORT)
        reaches(api, done, "done")
        for file in ("exr", "png", "jpg", "effects.json"):
            answer = api.does(200, "get", FRAME + "/" + file, job=done, frame=1)
            digest = '"%s"' % hashlib.sha256(answer.body).hexdigest()
            expect(answer.headers["etag"] == digest, "its ETag is its SHA-256: %s" % answer.headers["etag"])
            api.does(304, "get", FRAME + "/" + file, job=done, frame=1, headers={"If-None-Match": digest})
        for file in ("preview.png", "preview.exr", "history", "tiles", "live"):
            api.does(200, "get", FRAME + "/" + file, job=done, frame=1)
            api.does(404, "get", FRAME + "/" + file, job=done, frame=2)
            api.does(404, "get", FRAME + "/" + file, job=999, frame=1)
        plain, shares = (api.does(200, "get", FRAME + "/tiles", job=done, frame=1, query=q).json() for q in (None, {"shares": 1}))
        expect(all(t["shares"] == [] for t in plain["tiles"]), "only if they are asked for")
        expect(all(sum(s["samples"] for s in t["shares"]) == t["samples"] > 0 for t in shares["tiles"]), shares)
        for number in ("0", "000"):
            answer = api.does(404, "get", JOB, job=number)  # not the list: a message without a number asks for that
            expect("no job 0" in answer.json()["detail"], answer)
        for what in ("log", "trace"):
            api.does(200, "get", JOB + "/" + what, job=done, query={"after": 0})
            api.does(404, "get", JOB + "/" + what, job=999)
        for query in ({"filter": "ended"}, {"filter": "active"}, {"before": done}, {"first": 3}, None):
            api.does(200, "get", "/api/v1/jobs", query=query)
        api.does(400, "get", "/api/v1/jobs", query={"filter": "some"})
        api.does(400, "get", "/api/v1/jobs", query={"order": "name"})
        api.does(404, "get", JOB, job=999)
        api.does(400, "get", JOB, job="twelve")

        refused(api, "pause", done)
        refused(api, "resume", done)
        refused(api, "finish", done)
        refused(api, "start", done)
        refused(api, "priority", done, {"priority": 3})
        allowed(api, "develop", done, "done", {"output": {"tonemap": "aces", "formats": ["png"]}})
        api.does(422, "post", JOB + "/develop", {"output": {"tonemap": "no-such"}}, job=done)
        wait_for(lambda: info(api, done)["frames_developed"] == 1, "its pictures")
        for nothing in (None, {}, {"spp": 0}, {"stop": {}}, {"stop": {"adaptive": True}}):
            answer = api.does(422, "post", JOB + "/extend", nothing, job=done)
            expect("no rule says" in answer.json()["detail"], answer)
        expect(info(api, done)["state"] == "done", "it is as it was")
        allowed(api, "extend", done, "queued running done", {"spp": 8})
        reaches(api, done, "done")
        job = farm.submit(farm.scene(), "--name", "long", *ENDLESS)
        wait_for(lambda: info(api, job)["samples_done"] > 0, "the job to begin")
        refused(api, "retry", job)
        allowed(api, "extend", job, "running", {"stop": {"measure": "display", "target": 0.02, "adaptive": True}})
        expect(info(api, job)["stop"]["target"] == 0.02, info(api, job)["stop"])
        refused(api, "extend", job, {"spp": 64, "frames": [1]})
        api.does(409, "delete", JOB, job=job)
        refused(api, "remove", job)
        api.does(400, "post", JOB + "/priority", {"priority": "high"}, job=job)
        api.does(400, "post", JOB + "/priority", {"job": 2, "priority": 1}, job=job)
        allowed(api, "priority", job, "running", {"priority": 7})
        allowed(api, "pause", job, "paused")
        allowed(api, "resume", job, "queued running")
        allowed(api, "finish", job, "finishing done")
        reaches(api, job, "done")
        later = farm.submit(farm.scene(), "--after", "%d" % farm.submit(farm.scene(), *ENDLESS), *SHORT)
        allowed(api, "start", later, "queued running done")
        allowed(api, "cancel", later - 1, "cancelling cancelled", {"discard": True})
        allowed(api, "retry", later - 1, "queued running")
        allowed(api, "cancel", later - 1, "cancelling cancelled")
        reaches(api, later - 1, "cancelled")
        for verb in {v["path"] for v in api.page.get("/api/v1/verbs").json()["verbs"]}:
            api.does(404, "post", JOB + "/" + verb, {"output": {}} if verb == "develop" else {}, job=999)
        allowed(api, "remove", later - 1, "cancelled")
        api.does(200, "delete", JOB, job=done)
        api.does(404, "delete", JOB, job=done)

        reaches(api, later, "done")
        for verb in ("drain", "resume", "block", "unblock"):
            api.does(200, "post", "/api/v1/workers/{name}/" + verb, name=name)
            api.does(404, "post", "/api/v1/workers/{name}/" + verb, name="nobody-of-that-name") if verb == "resume" else None
        report = api.does(200, "post", "/api/v1/workers/{name}/distrust", {"since": int(time.time()) + 60}, name=name).json()
        expect(report["worker"] == name and report["again"] == report["left"] == 0, report)
        api.does(404, "post", "/api/v1/workers/{name}/distrust", {}, name="nobody-of-that-name")
        api.does(200, "post", "/api/v1/workers/{name}/unblock", name=name)
        one = api.does(200, "get", "/api/v1/workers/{name}", name=name).json()
        expect(len(one["workers"]) == 1 and one["workers"][0]["lines"], "a worker with its lines: %s" % one)
        worker.stop()
        wait_for(lambda: api.does(200, "get", "/api/v1/workers", query={"gone": 1}).json()["gone"], "it to be gone")
        api.does(200, "post", "/api/v1/store/collect")

        made = api.does(200, "post", "/api/v1/tokens", {"role": "view", "name": "guest"}).json()
        number = made["info"]["token"]
        api.does(200, "get", "/api/v1/session", token=made["secret"])
        api.does(200, "get", "/api/v1/tokens")
        again = api.page.post("/api/v1/tokens/%d/renew" % number)
        expect(again.status == 200 and again.json()["secret"] != made["secret"], again)
        api.called.add(("post", "/api/v1/tokens/{token}/renew"))
        gone = api.page.request("DELETE", "/api/v1/tokens/%d" % number)
        api.called.add(("delete", "/api/v1/tokens/{token}"))
        api.check_answer("delete", "/api/v1/tokens/{token}", gone)
        expect(gone.status == 200, gone)
        api.does(401, "get", "/api/v1/session", token=again.json()["secret"])
        api.does(200, "get", "/api/v1/keys")
        for verb, body in (("revoke", {}), ("rotate", {"keep_s": 60})):
            keys = api.does(200, "post", "/api/v1/keys/{name}/" + verb, body, name="ana").json()["keys"]
            expect([k["name"] for k in keys] == ["ana"], keys)

        signed = api.does(200, "post", "/api/v1/session", {"token": api.page.token}, headers={"Origin": api.page.origin})
        cookie = signed.headers["set-cookie"].split(";")[0]
        api.ask("delete", "/api/v1/session", token="", headers={"Cookie": cookie, "Origin": api.page.origin})
        api.does(200, "post", "/api/v1/blobs/missing", {"digest": ["00" * 32]})
        api.does(200, "put", "/api/v1/blobs/{digest}", b"abc", digest=hashlib.sha256(b"abc").hexdigest())
        api.does(200, "put", "/api/v1/blobs/{digest}", b"abc", digest=hashlib.sha256(b"abc").hexdigest())
        api.does(422, "put", "/api/v1/blobs/{digest}", b"abd", digest=hashlib.sha256(b"abc!").hexdigest())
        api.does(400, "put", "/api/v1/blobs/{digest}", b"abc", digest="abc")
        api.does(404, "post", "/api/v1/jobs", {"scene": "11" * 32})
        upload = api.does(201, "post", "/api/v1/imports", {}).json()["import"]
        for method in ("put", "post", "delete"):
            path = "/api/v1/imports/{import}" + ("/files/{path}" if method == "put" else "")
            body = {"put": b"no scene", "post": {"scene": "a/b.gltf"}}.get(method)
            answer = api.ask(method, path, body, path="a/b.gltf", **{"import": upload})
            expect((answer.status < 300) == (method != "post"), "%s %s" % (method, answer))
        events = api.does(200, "get", "/api/v1/log", query={"newest": 5}).json()["events"]
        expect(len(events) == 5 and api.does(200, "get", "/api/v1/log", query={"after": events[-1]["seq"]}).json()["events"] == [],
               events)
        api.does(426, "get", "/api/v1/live")
        for version, is_chunked in (("1.1", True), ("1.0", False)):  # a client of 1.0 knows no chunks
            told = api.page.raw(("GET /api/v1/events HTTP/%s\r\nHost: %s\r\nAuthorization: Bearer %s\r\n\r\n" % (
                version, api.page.host, api.page.token)).encode(), until=lambda got: b"event: begin" in got)
            head, _, events = told.partition(b"\r\n\r\n")
            expect(b" 200 OK" in head and b"text/event-stream" in head, head)
            expect((b"chunked" in head) == is_chunked and events.startswith(b"id: ") != is_chunked, told)
        api.called.add(("get", "/api/v1/events"))
        expect(not set(api.operations) - api.called, "never asked: %s" % sorted(set(api.operations) - api.called))


ORDER = ("none", "view", "submit", "operate", "admin")


@tests.add
def roles():
    """each route refuses smaller roles, by name; a job's owner may what operators may, for that job only"""
    with Farm() as farm:
        api = started(farm)
        tokens = {role: made_token(api, role, "ana@ws3") for role in ORDER[1:]}
        mine, other = (farm.submit(farm.scene(), "--owner", owner, *ENDLESS) for owner in ("ana@ws3", "rui@ws4"))
        values = {"job": other, "frame": 1, "name": "lab", "token": 99, "digest": "00" * 32,
                  "import": 99, "path": "a", "file": "style.css"}
        for (method, path), what in sorted(api.operations.items()):
            least = ORDER.index(what["x-role"])
            for role in range(least):
                status = 401 if role == 0 else 403
                concrete = re.sub(r"\{(\w+)\}", lambda m: str(values[m[1]]), path)
                answer = api.page.request(method.upper(), concrete, body=b"" if method in ("post", "put") else None,
                                          token=tokens[ORDER[role]] if role else "")
                api.check_answer(method, path, answer)
                expect(answer.status == status, "%s %s as %s: %s" % (method, path, ORDER[role], answer))
        for verb, body in (("priority", {"priority": 2}), ("pause", {}), ("resume", {}), ("cancel", {"discard": True})):
            theirs = api.does(403, "post", JOB + "/" + verb, body, job=other, token=tokens["submit"]).json()
            expect("belongs to rui@ws4" in theirs["detail"], theirs)
            api.does(200, "post", JOB + "/" + verb, body, job=mine, token=tokens["submit"])
        expect(info(api, other)["state"] == "queued" and info(api, other)["priority"] == 0, "untouched")
        api.does(404, "post", JOB + "/pause", {}, job=999, token=tokens["submit"])
        scene = info(api, other)["scene"]
        settings = {"width": 16, "height": 16, "spp": 1, "max_depth": 4}
        job = {"scene": scene, "first_frame": 1, "last_frame": 1, "settings": settings}
        api.does(403, "post", "/api/v1/jobs", dict(job, owner="rui@ws4"), token=tokens["submit"])
        number = api.does(200, "post", "/api/v1/jobs", job, token=tokens["submit"]).json()["job"]
        expect(info(api, number)["owner"] == "ana@ws3", info(api, number)["owner"])
        number = api.does(200, "post", "/api/v1/jobs", dict(job, owner="rui@ws4"), token=tokens["operate"]).json()["job"]
        expect(info(api, number)["owner"] == "rui@ws4", info(api, number)["owner"])
        with open(farm.path("store", "audit.log"), encoding="utf-8") as log:
            lines = [json.loads(line) for line in log]
        expect(any(l["verb"] == "priority" and l["who"] == "ana@ws3" for l in lines), "the audit log says who: %s" % lines[-3:])


def blob(farm, digest):
    return read_bytes(farm.path("store", "blobs", digest[:2], digest))


@tests.add
def submission():
    """a job submitted over HTTP, blob by blob, gives the same bits as one submitted by the program"""
    with Farm() as first, Farm() as second:
        here, there = started(first), started(second)
        first.start_worker()
        second.start_worker()
        number = first.submit(first.scene(), *SHORT)
        reaches(here, number, "done")
        blobs = [f for _, _, files in os.walk(first.path("store", "blobs")) for f in files if len(f) == 64]
        missing = there.does(200, "post", "/api/v1/blobs/missing", {"digest": blobs}).json()["digest"]
        expect(sorted(missing) == sorted(blobs), "all are missing")
        for digest in missing:
            there.does(200, "put", "/api/v1/blobs/{digest}", blob(first, digest), digest=digest)
        expect(there.does(200, "post", "/api/v1/blobs/missing", {"digest": blobs}).json()["digest"] == [], "none is missing")
        told = info(here, number)
        job = {key: told[key] for key in ("name", "scene", "settings", "output", "first_frame", "last_frame", "stop")}
        copy = there.does(200, "post", "/api/v1/jobs", dict(job, token="once")).json()["job"]
        again = there.does(200, "post", "/api/v1/jobs", dict(job, token="once")).json()["job"]
        expect(copy == again, "a repeated submission is the same job")
        reaches(there, copy, "done")
        pictures = [api.does(200, "get", FRAME + "/png", job=n, frame=1).body for api, n in ((here, number), (there, copy))]
        expect(pictures[0] == pictures[1], "the same picture")


@tests.add
def looks():
    """a preview with settings of its own is what develop makes of the job, which it does not change"""
    with Farm() as farm:
        api = started(farm)
        farm.start_worker()
        number = farm.submit(farm.scene(), "--size", "64x48", "--spp", "8")
        reaches(api, number, "done")
        query = {"tonemap": "aces", "exposure": "1.5", "no_dither": 1}
        plain = api.does(200, "get", FRAME + "/preview.png", job=number, frame=1)
        look = api.does(200, "get", FRAME + "/preview.png", job=number, frame=1, query=query)
        expect(info(api, number)["revision"] == 0, "the job is as it was")
        expect(plain.body == api.does(200, "get", FRAME + "/png", job=number, frame=1).body, "and its picture")
        output = dict(info(api, number)["output"], tonemap="aces", parameters={}, exposure_ev=1.5, no_dither=True)
        api.does(200, "post", JOB + "/develop", {"output": output}, job=number)
        wait_for(lambda: info(api, number)["frames_developed"] == 1, "the frame to be developed")
        made = api.does(200, "get", FRAME + "/png", job=number, frame=1)
        expect(Png(made.body).codes == Png(look.body).codes, "the same pixels")
        expect(Png(made.body).codes != Png(plain.body).codes, "which are others than before")
        for query in ({"param.key": "high"}, {"tonemap": "no-such"}, {"exposure": "bright"}, {"metering": "all"},
                      {"tonemap": "lut"}, {"white_kelvin": 3}):
            api.does(422, "get", FRAME + "/preview.png", job=number, frame=1, query=query)
        running = farm.submit(farm.scene(), *ENDLESS)
        # The first tile may be black: every pixel has samples.
        wait_for(lambda: info(api, running)["samples_done"] >= 2 * 96 * 64, "samples everywhere")
        codes = [Png(api.does(200, "get", FRAME + "/preview.png", job=running, frame=1,
                              query={"tonemap": "linear", "exposure": ev}).body).codes for ev in (-20, 20)]
        expect(codes[0] != codes[1] and max(max(row) for row in codes[0]) < 3, "of a frame in work, too")
        number = farm.submit(farm.scene(), "--format", "exr", "--priority", "9", *SHORT)
        reaches(api, number, "done")
        api.does(404, "get", FRAME + "/png", job=number, frame=1)
        api.does(200, "get", FRAME + "/preview.png", job=number, frame=1)


def resident_kib(program):
    with open("/proc/%d/status" % program.pid, encoding="ascii") as status:
        return int(re.search(r"VmRSS:\s+(\d+)", status.read())[1])


@tests.add
def slow_readers():
    """clients that read a large file slowly, or vanish, hold up nobody and take no memory"""
    with Farm() as farm:
        api = started(farm)
        farm.start_worker()
        number = farm.submit(farm.scene(), *SHORT)
        reaches(api, number, "done")
        # Far more than sockets hold.
        [path] = glob.glob(farm.path("store", "**", "frame-0001.exr"), recursive=True)
        with open(path, "wb") as file:
            file.write(random.Random(1).randbytes(16 << 20))
        os.unlink(path[:-len("exr")] + "sums")  # or it counts as damaged
        whole = api.does(200, "get", FRAME + "/exr", job=number, frame=1).body
        expect(len(whole) == 16 << 20, "the large file")
        ask = ("GET /api/v1/jobs/%d/frames/1/exr HTTP/1.1\r\nHost: %s\r\nAuthorization: Bearer %s\r\n\r\n" % (
            number, api.page.host, api.page.token)).encode()
        before = resident_kib(farm.coordinator)
        peers = [api.page.connect() for _ in range(20)]
        for peer in peers:
            peer.sendall(ask)
            begin = peer.recv(64)
            expect(begin.startswith(b"HTTP/1.1 200"), "it begins: %r" % begin)
        begun = time.monotonic()
        expect(api.does(200, "get", FRAME + "/exr", job=number, frame=1).body == whole, "one that reads gets all of it")
        expect(info(api, number)["state"] == "done", "and other questions are answered")
        grown = resident_kib(farm.coordinator) - before
        expect(SLOW or grown < 20 * 2048, "%d KiB for 20 slow readers of %d bytes" % (grown, len(whole)))
        # A file that ends too soon ends its connection: what follows would be taken for its rest.
        cut = peers.pop()
        os.truncate(path, 1000)
        got = b""
        while True:
            piece = cut.recv(1 << 20)
            if not piece:
                break
            got += piece
        expect(len(got) < 16 << 20, "what was cut off is not made up")
        cut.close()
        with open(path, "wb") as file:
            file.write(whole)
        for peer in peers:
            peer.close()
        print("# %.2f s beside 20 slow readers, %d KiB for them, of files of %d KiB" % (
            time.monotonic() - begun, grown, len(whole) // 1024))
        expect(api.does(200, "get", FRAME + "/exr", job=number, frame=1).body == whole, "afterwards, too")


@tests.add
def examples():
    """the examples of docs/API.md run as they stand there"""
    with open(os.path.join(ROOT, "docs", "API.md"), encoding="utf-8") as text:
        blocks = re.findall(r"^```sh\n(.*?)^```$", text.read(), re.M | re.S)
    expect(len(blocks) >= 6, "the examples were found")
    if not shutil.which("curl"):
        raise Skip("curl is needed")
    with Farm() as farm:
        api = started(farm)
        farm.start_worker()
        for options in (SHORT, ENDLESS):
            farm.submit(farm.scene("scene.gltf"), *options)
        with open(farm.path("blob.bin"), "wb") as file:
            file.write(b"a blob")
        script = "set -eu\n" + "".join(blocks).replace("127.0.0.1:7421", api.page.host).replace(
            "azulejo-store/", shlex.quote(farm.path("store") + "/"))
        done = subprocess.run(["sh", "-c", script], cwd=farm.folder, capture_output=True, text=True, timeout=300, check=False)
        expect(done.returncode == 0, "%s\n%s" % (done.stdout[-2000:], done.stderr))
        for words in ('"code":"not-found"', '"software":"azulejo', '"job":3', '"state":"paused"'):
            expect(words in done.stdout, "%s in %s" % (words, done.stdout))
        for name, begin in (("picture.png", b"\x89PNG"), ("picture.exr", b"\x76\x2f\x31\x01"), ("agx.png", b"\x89PNG")):
            expect(read_bytes(farm.path(name)).startswith(begin), name)
        expect(not os.path.exists(farm.path("unchanged")) or not read_bytes(farm.path("unchanged")), "what has not changed")
        names = [j["name"] for j in api.does(200, "get", "/api/v1/jobs").json()["jobs"]]
        expect("by-curl" in names, names)


# ---- what strangers may send --------------------------------------------------------------------------------------

WORDS = ["", "0", "1", "2", "-1", "999999999999999999999", "18446744073709551615", "NaN", "a", "..", "%00", "%ff", "é",
         "<b>", "active", "true", "null", "00" * 32, "x" * 300]


def random_value(rng, schema, document, depth=0):
    """Something that fits the schema, mostly."""
    if rng.random() < 0.05 or depth > 4:
        return rng.choice([None, -1, 0, 1.5, 1e300, "", "x", [], {}, True, [[[]]], 2**63, "9" * 30])
    if "$ref" in schema:
        return random_value(rng, document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]], document, depth)
    for many in ("allOf", "oneOf", "anyOf"):
        if many in schema:
            return random_value(rng, rng.choice(schema[many]), document, depth)
    if "enum" in schema:
        return rng.choice(schema["enum"])
    kind = schema.get("type")
    if kind == "object":
        return {name: random_value(rng, s, document, depth + 1) for name, s in schema.get("properties", {}).items()
                if rng.random() < 0.5}
    if kind == "array":
        return [random_value(rng, schema["items"], document, depth + 1) for _ in range(rng.randrange(4))]
    if kind == "integer":
        return rng.choice([0, 1, 2, 3, 64, 1000, 2**31, 2**32 - 1, 2**53])
    if kind == "number":
        return rng.choice([0, 1, -1, 0.18, 1e-30, 1e30])
    if kind == "boolean":
        return rng.random() < 0.5
    return rng.choice(WORDS)


def random_request(rng, api, jobs):
    (method, path), what = rng.choice(sorted(api.operations.items()))
    word = lambda name: str(rng.choice(jobs)) if name in ("job", "frame", "import") and rng.random() < 0.7 else rng.choice(WORDS)
    path = re.sub(r"\{(\w+)\}", lambda m: word(m[1]), path)
    query = [p["name"] for p in what.get("parameters", []) if p["in"] == "query" and rng.random() < 0.5]
    if query or rng.random() < 0.05:
        path += "?" + "&".join("%s=%s" % (n, rng.choice(WORDS)) for n in query or ["x"])
    content = what.get("requestBody", {}).get("content", {})
    body = None
    if "application/json" in content:
        body = json.dumps(random_value(rng, content["application/json"]["schema"], api.document))
        if rng.random() < 0.05:
            body = body[:rng.randrange(len(body) + 1)]
    elif content:
        body = bytes(rng.randrange(256) for _ in range(rng.randrange(200)))
    elif rng.random() < 0.02:
        body = "{}"
    if rng.random() < 0.03:
        method = rng.choice(["get", "post", "put", "patch", "delete", "head", "options", "foo"])
    return method.upper(), re.sub(r"[^\x21-\x7e]", lambda m: "%%%02x" % (ord(m[0]) & 255), path), body


# Asked elsewhere: streams without end, and what would end the test's own token or send requests to others.
NOT_AT_RANDOM = re.compile(r"/api/v1/(events|tokens|session)|/live$|/imports")


@tests.add
def at_random():
    """4,000 requests at random: no failure of the coordinator's, and no growth"""
    count = 1500 if SLOW else 4000
    with Farm() as farm:
        api = started(farm)
        farm.start_worker()
        jobs = [farm.submit(farm.scene(), *how) for how in (SHORT, ENDLESS, SHORT, ENDLESS)]
        api.operations = {k: v for k, v in api.operations.items() if not NOT_AT_RANDOM.search(k[1])}
        rng = random.Random(15)
        seen, marks = {}, []
        for number in range(count):
            method, path, body = random_request(rng, api, jobs + [1, 2, 99])
            if number in (count // 4, count - 1):
                marks.append(resident_kib(farm.coordinator))
            try:
                answer = api.page.request(method, path, body=body, limit_s=60)
            except ConnectionError as error:
                if "%00" in path: # no HTTP library sends that: the connection ends
                    continue
                raise Failure("request %d: %s %s %r: %s" % (number, method, path, body, error)) from error
            seen[answer.status] = seen.get(answer.status, 0) + 1
            expect(answer.status < 500 or (answer.status, method) == (501, "FOO"),
                   "request %d: %s %s %r: %s" % (number, method, path, body, answer))
        print("# %d requests: %s; %d, then %d KiB" % (count, dict(sorted(seen.items())), *marks))
        expect(SLOW or marks[1] - marks[0] < 24 * 1024, "it grew from %d to %d KiB" % tuple(marks))
        expect({200, 400, 404, 409, 422} <= set(seen), seen)
        api.does(200, "get", "/api/v1/farm")


tests.run()
