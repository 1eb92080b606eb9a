"""Scenes submitted by uploading their files: every format, and what goes wrong or is meant to."""
import base64
import http.client
import json
import os
import re
import signal
import socket
import struct
import sys
import threading
import time
import urllib.parse
import zlib

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from disk import SmallDisk
from farm import BIN, Failure, Farm, PATIENCE, Skip, Tests, read_bytes, wait_for, write_scene

tests = Tests()
SMALL = ["--size", "32x24", "--spp", "4"]


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def json(self):
        return json.loads(self.body)

    def __str__(self):
        return "%d %s" % (self.status, self.body[:2000].decode("utf-8", "replace"))


def start(farm, *options, listen="127.0.0.1:0", env=None):
    """A coordinator with its page; farm.page: the page's address, with its token."""
    farm.start_coordinator("--web", "127.0.0.1:0", *options, listen=listen, env=env)
    farm.page = farm.coordinator.wait_line("page: ")


class Api:
    """The API of a farm's coordinator as one token sees it."""

    def __init__(self, farm, token=None):
        address, own = farm.page.split("/#token=")
        self.host = urllib.parse.urlsplit(address).netloc
        self.token = token or own

    def connect(self):
        return http.client.HTTPConnection(self.host, timeout=120 * PATIENCE)

    def ask(self, method, path, body=None, expect_=None):
        connection = self.connect()
        headers = {"Authorization": "Bearer " + self.token}
        if isinstance(body, (dict, list)):
            body = json.dumps(body).encode()
            headers["Content-Type"] = "application/json"
        try:
            connection.request(method, "/api/v1/" + path, body=body, headers=headers)
        except (BrokenPipeError, ConnectionResetError):
            pass  # refused before all of it was sent: there is an answer
        response = connection.getresponse()
        answer = Answer(response.status, response.headers, response.read())
        connection.close()
        if expect_ is not None and answer.status != expect_:
            raise Failure("%s %s: expected %d, not %s" % (method, path, expect_, answer))
        return answer

    def begin(self):
        return self.ask("POST", "imports", b"", 201).json()["import"]

    def put(self, number, path, data, expect_=201):
        return self.ask("PUT", "imports/%d/files/%s" % (number, urllib.parse.quote(path)), data, expect_)

    def submit(self, number, scene, *options, expect_=201):
        return self.ask("POST", "imports/%d" % number, {"scene": scene, "options": list(options)}, expect_).json()

    def upload(self, files, scene, *options):
        number = self.begin()
        for path, data in files.items():
            self.put(number, path, data)
        return self.submit(number, scene, *options)


def folders(farm):
    """The uploads that take room."""
    try:
        return [f for f in os.listdir(os.path.join(farm.store, "imports")) if f != "trash"]
    except FileNotFoundError:
        return []


def png(width, height, rgb):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + bytes(rgb) * width for _ in range(height))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def gltf_files(farm, texture="textures/wood red.png"):
    """A scene with its buffer and a texture in files of their own."""
    write_scene(farm.path("whole.gltf"))
    with open(farm.path("whole.gltf")) as source:
        scene = json.load(source)
    data = base64.b64decode(scene["buffers"][0]["uri"].split(",")[1])
    places = struct.pack("<8f", 0, 0, 1, 0, 1, 1, 0, 1)
    scene["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": len(places)})
    scene["accessors"].append({"bufferView": len(scene["bufferViews"]) - 1, "componentType": 5126, "count": 4, "type": "VEC2"})
    scene["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = len(scene["accessors"]) - 1
    scene["images"] = [{"uri": urllib.parse.quote(texture)}]
    scene["textures"] = [{"source": 0}]
    scene["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    data += places
    scene["buffers"] = [{"byteLength": len(data), "uri": "buffers/all.bin"}]
    return {"scene.gltf": json.dumps(scene).encode(), "buffers/all.bin": data, texture: png(8, 8, (200, 40, 30))}


def glb(farm):
    write_scene(farm.path("whole.gltf"))
    scene = read_bytes(farm.path("whole.gltf"))
    scene += b" " * (-len(scene) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(scene), len(scene), b"JSON") + scene


OBJ = {
    "room/room.obj": b"""mtllib ../materials/room.mtl
v -2 0 2
v 2 0 2
v 2 0 -2
v -2 0 -2
v -1 2 -1
v 1 2 -1
v 1 2 1
v -1 2 1
usemtl floor
f 1 2 3 4
usemtl lamp
f 5 6 7 8
""",
    "materials/room.mtl": b"newmtl floor\nKd 0.7 0.6 0.5\nnewmtl lamp\nKd 0 0 0\nKe 5 5 5\n",
}

PBRT = {
    "scenes/main.pbrt": b"""LookAt 0 2 8  0 0.8 0  0 1 0
Camera "perspective" "float fov" 34
Film "rgb" "integer xresolution" 480 "integer yresolution" 320
WorldBegin
Include "../shared/light.pbrt"
Texture "wood" "spectrum" "imagemap" "string filename" "../shared/wood.png"
Material "diffuse" "texture reflectance" "wood"
Shape "trianglemesh" "point3 P" [-1 0 1  1 0 1  1 0 -1  -1 0 -1] "integer indices" [0 1 2  0 2 3] "point2 uv" [0 0 1 0 1 1 0 1]
""",
    "shared/light.pbrt": b'LightSource "infinite" "rgb L" [1 1 1]\n',
}


def ignore(function, *args):
    try:
        return function(*args)
    except (OSError, http.client.HTTPException):
        return None


@tests.add
def every_format():
    """glTF with buffers and textures, GLB, OBJ with materials and a folder of pbrt files become jobs that render; the same bits as submit's"""
    with Farm() as farm:
        start(farm)
        farm.start_worker()
        api = Api(farm)
        files = gltf_files(farm)
        jobs = {"gltf": api.upload(files, "scene.gltf", "--name", "chair & <b>table</b>", *SMALL)}
        jobs["glb"] = api.upload({"a b/scene.glb": glb(farm)}, "a b/scene.glb", *SMALL)
        jobs["obj"] = api.upload(OBJ, "room/room.obj", *SMALL)
        jobs["pbrt"] = api.upload(dict(PBRT, **{"shared/wood.png": png(4, 4, (9, 99, 9))}), "scenes/main.pbrt", *SMALL)
        for kind, answer in jobs.items():
            expect(set(answer) == {"job", "estimate_spp", "warnings"}, (kind, answer))
            job = farm.wait_for_job(answer["job"])
            expect(job["frames_done"] == 1, (kind, job))
        expect(farm.job(jobs["gltf"]["job"])["name"] == "chair & <b>table</b>", farm.job(jobs["gltf"]["job"]))
        expect(farm.job(jobs["glb"]["job"])["name"] == "scene", farm.job(jobs["glb"]["job"]))
        # What the command line makes of the same files.
        for path, data in files.items():
            path = farm.path("own", path)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "wb") as out:
                out.write(data)
        own = farm.submit(farm.path("own", "scene.gltf"), "--name", "own", *SMALL)
        farm.wait_for_job(own)
        pictures = [[read_bytes(f) for f in sorted(farm.fetch(n, "fetched-%d" % n)) if f.endswith(".png")]
                    for n in (own, jobs["gltf"]["job"])]
        expect(pictures[0] and pictures[0] == pictures[1], "another picture than submit's")
        wait_for(lambda: not folders(farm), "the uploads to go")


@tests.add
def asked_twice():
    """asking again after an answer gives the same job; an error leaves the files, and one more file mends it"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        files = gltf_files(farm)
        number = api.begin()
        for path, data in files.items():
            if not path.endswith(".bin"):
                api.put(number, path, data)
        problem = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf"}, None)
        expect(400 <= problem.status < 500 and "buffers/all.bin: is not among the uploaded files" in problem.json()["detail"], problem)
        expect(problem.headers["Content-Type"] == "application/problem+json" and farm.folder not in str(problem), problem)
        api.put(number, "buffers/all.bin", b"x")
        problem = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf"}, None)
        expect(400 <= problem.status < 500 and "all.bin" in problem.json()["detail"], problem)
        api.put(number, "buffers/all.bin", files["buffers/all.bin"])  # replaces it
        first = api.submit(number, "scene.gltf", *SMALL)
        expect(api.submit(number, "scene.gltf", *SMALL) == first, "two jobs")
        expect(len(farm.cli("list", "--json", expect=0).json()["jobs"]) == 1, "two jobs")
        expect(api.put(number, "late.png", b"x", None).status == 409, "a file after the job")


@tests.add
def a_look_first():
    """with keep the upload stays: each look is a job of its own, small and in the file's proportions; then it is submitted as ever"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        files = gltf_files(farm)
        number = api.begin()
        for path, data in files.items():
            api.put(number, path, data)
        body = {"scene": "scene.gltf", "options": ["--size", "640x480", "--fit", "32x32", "--spp", "2"], "keep": True}
        looks = [api.ask("POST", "imports/%d" % number, body, 201).json() for _ in range(2)]
        farm.start_worker()
        expect(looks[0]["job"] != looks[1]["job"], "a second look is the first one")
        settings = farm.job(looks[0]["job"])["settings"]
        expect((settings["width"], settings["height"], settings["spp"]) == (32, 24, 2), settings)
        for wrong in ("yes", 1, None):
            problem = api.ask("POST", "imports/%d" % number, dict(body, keep=wrong), 422).json()
            expect("keep: must be true or false" in problem["detail"], problem)
        expect(folders(farm) == [str(number)], folders(farm))
        for look in looks:
            farm.wait_for_job(look["job"])
            farm.cli("remove", str(look["job"]), expect=0)
        api.put(number, "textures/wood red.png", png(8, 8, (20, 40, 200)))  # another file, and only that
        job = api.submit(number, "scene.gltf", *SMALL)["job"]
        farm.wait_for_job(job)
        expect(api.submit(number, "scene.gltf", *SMALL)["job"] == job, "two jobs")
        whole = api.upload(dict(files, **{"textures/wood red.png": png(8, 8, (20, 40, 200))}), "scene.gltf", *SMALL)["job"]
        farm.wait_for_job(whole)
        pictures = [read_bytes(f) for n in (job, whole) for f in farm.fetch(n, "got-%d" % n) if f.endswith(".png")]
        expect(pictures[0] == pictures[1], "another picture than without a look")
        wait_for(lambda: not folders(farm), "the uploads to go")


@tests.add
def paths():
    """names that lead out of the upload, or are none, are refused and make no file"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        number = api.begin()
        bad = ["..", "../x", "a/../../x", "a/..", "a\nb", "a\0b", "a/", "\x1b[2J", "n" * 256, "d/" * 40 + "x"]
        for path in bad:
            for quoted in {urllib.parse.quote(path, safe=""), urllib.parse.quote(path)} | ({path} if path.isprintable() else set()):
                answer = ignore(api.ask, "PUT", "imports/%d/files/%s" % (number, quoted), b"bad")  # a control character ends the connection
                expect(not answer or 400 <= answer.status < 500, (path, str(answer)))
                expect(answer or not path.isprintable(), (path, "no answer"))
        found = [os.path.join(at, f) for at, _, names in os.walk(farm.store) for f in names
                 if os.path.getsize(os.path.join(at, f)) == 3 and read_bytes(os.path.join(at, f)) == b"bad"]
        expect(not found, found)
        api.put(number, "a", b"a file")
        expect(api.put(number, "a/b", b"x", None).status == 422, "a file as a folder")
        api.put(number, "d/e", b"x")
        expect(api.put(number, "d", b"x", None).status == 422, "a folder as a file")
        for scene in bad + ["nothing.gltf", "-o", "d"]:
            answer = api.ask("POST", "imports/%d" % number, {"scene": scene})
            expect(400 <= answer.status < 500, (scene, str(answer)))
            expect(farm.folder not in str(answer), answer)
        expect(farm.cli("list", "--json", expect=0).json()["jobs"] == [], "a job")


@tests.add
def options():
    """only the options that concern the picture and the queue may be given; their errors are the command line's"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        number = api.begin()
        for path, data in gltf_files(farm).items():
            api.put(number, path, data)
        secret = farm.path("secret.exr")
        for words in (["-o", "/tmp/x"], ["--output=/tmp/x", "--follow"], ["--follow"], ["--watch"], ["--key", farm.key],
                      ["--coordinator", "127.0.0.1:1"], ["--allow-outside", "/"], ["--schedule-from", secret], ["--env", secret],
                      ["--env", "../../../secret.exr"], ["--lut=/etc/passwd"], ["--token", "x"], ["--owner", "root@host"], ["--force"],
                      ["--", "x"], ["x"], "--spp 4", {"spp": 4}, [4], ["--spp"], ["--effects", "auto"], ["--help"]):
            answer = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf", "options": words})
            expect(400 <= answer.status < 500 and "options" in answer.json()["detail"], (words, str(answer)))
        for body in (b"", b"{", b"[]", b'{"scene": 1}', b'{"scene": "scene.gltf", "shell": "id"}', b'{"scene": "scene.gltf", "scene": "x"}',
                     b"[" * 100000):
            answer = api.ask("POST", "imports/%d" % number, body)
            expect(400 <= answer.status < 500, (body[:50], str(answer)))
        for words, what in ((["--spp", "0"], "--spp"), (["--size", "0x0"], "--size"), (["--spp", "many"], "--spp"),
                            (["--camera", "nobody"], "--camera"), (["--after", "999"], "999"), (["--tonemap", "magic"], "magic")):
            answer = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf", "options": words})
            expect(400 <= answer.status < 500 and what in answer.json()["detail"] and "azulejo submit" not in answer.json()["detail"],
                   (words, str(answer)))
        expect(farm.cli("list", "--json", expect=0).json()["jobs"] == [], "a job")
        job = farm.job(api.submit(number, "scene.gltf", *SMALL, "--priority", "7", "--name", "--output=x", "--tonemap", "aces")["job"])
        expect(job["priority"] == 7 and job["name"] == "--output=x", job)


@tests.add
def files_of_the_machine():
    """a scene cannot read the coordinator's files, nor learn whether they exist"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        with open(farm.path("secret.png"), "wb") as out:
            out.write(png(4, 4, (1, 2, 3)))
        key = os.path.join(farm.store, "queue.sqlite")
        said = set()
        for target in (farm.path("secret.png"), farm.path("missing.png"), key, "/etc", "../../../../web.token", "../../../../none"):
            number = api.begin()
            files = gltf_files(farm)
            scene = json.loads(files["scene.gltf"])
            scene["images"] = [{"uri": target}]
            api.put(number, "buffers/all.bin", files["buffers/all.bin"])
            api.put(number, "scene.gltf", json.dumps(scene).encode())
            answer = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf", "options": [*SMALL, "--strict"]})
            expect(400 <= answer.status < 500, (target, str(answer)))
            said.add(answer.json()["detail"].replace(target, "TARGET"))
            api.ask("DELETE", "imports/%d" % number, None, 204)
        expect(len(said) == 1, said)
        for name, text in (("a.pbrt", 'Include "%s"\n'), ("a.obj", "mtllib %s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")):
            said = set()
            for target in ("/etc/passwd", "/etc/nothing", "../../../../web.token", "../../../../none"):
                number = api.begin()
                api.put(number, name, (text % target).encode())
                answer = api.ask("POST", "imports/%d" % number, {"scene": name, "options": SMALL})
                said.add(answer.body.decode().replace(target, "TARGET").replace(str(number), "N"))
                api.ask("DELETE", "imports/%d" % number)
            expect(len({re.sub('"job":[0-9]+', "", answer) for answer in said}) == 1, said)


@tests.add
def bombs():
    """pictures and files that would need all memory are refused, and the coordinator goes on"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        def chunk(kind, data):
            return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        z = zlib.compressobj(9)
        packed = b"".join(z.compress(bytes(1 << 20)) for _ in range(64)) + z.flush()
        for width, height in ((1 << 30, 1 << 30), (60000, 60000), (16384, 16384)):
            bomb = (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 6, 0, 0, 0)) +
                    chunk(b"IDAT", packed) + chunk(b"IEND", b""))
            number = api.begin()
            for path, data in gltf_files(farm).items():
                api.put(number, path, bomb if path.endswith(".png") else data)
            strict = ["--strict"] * (width == 16384)  # not too large, but damaged: left out otherwise
            answer = api.ask("POST", "imports/%d" % number, {"scene": "scene.gltf", "options": SMALL + strict})
            expect(400 <= answer.status < 500, (width, str(answer)))
            api.ask("DELETE", "imports/%d" % number, None, 204)
        number = api.begin()
        api.put(number, "deep.pbrt", b'Include "deep.pbrt"\n')
        expect(400 <= api.ask("POST", "imports/%d" % number, {"scene": "deep.pbrt"}).status < 500, "a circle of files")
        api.put(number, "deep.gltf", b"[" * 1000000)
        expect(400 <= api.ask("POST", "imports/%d" % number, {"scene": "deep.gltf"}).status < 500, "deep JSON")
        for _ in range(7):
            api.begin()
        expect(api.ask("POST", "imports", b"").status == 429, "a ninth upload")
        api.ask("DELETE", "imports/%d" % number, None, 204)
        api.begin()


@tests.add
def roles_and_strangers():
    """view may not; submit may, as the owner of its jobs; another token's upload does not exist"""
    with Farm() as farm:
        start(farm)
        tokens = {}
        for role, owner in (("view", "vera@home"), ("submit", "maria@studio"), ("submit2", "rui@studio")):
            made = farm.cli("token", "create", "--role", role.rstrip("2"), "--owner", owner, "--coordinator", farm.address, "--key", farm.key,
                            expect=0).out
            tokens[role] = re.search(r"[A-Za-z0-9_-]{40,}", made).group()
        view, maria, rui = (Api(farm, tokens[r]) for r in ("view", "submit", "submit2"))
        expect(view.ask("POST", "imports", b"").status == 403, "view may upload")
        number = maria.begin()
        files = gltf_files(farm)
        for path, data in files.items():
            maria.put(number, path, data)
        expect(rui.put(number, "x", b"x", None).status == 404, "rui may write")
        expect(rui.ask("POST", "imports/%d" % number, {"scene": "scene.gltf"}).status == 404, "rui may submit")
        expect(rui.ask("DELETE", "imports/%d" % number).status == 404, "rui may remove")
        nobody = Api(farm, "x" * 43)
        expect(nobody.ask("POST", "imports", b"").status == 401, "nobody may upload")
        job = farm.job(maria.submit(number, "scene.gltf", *SMALL)["job"])
        expect(job["owner"] == "maria@studio", job)
        lines = [json.loads(line) for line in read_bytes(os.path.join(farm.store, "audit.log")).splitlines()]
        expect(any(l["verb"] == "import" and l["who"] == "maria@studio" and l["job"] == job["job"] for l in lines), lines[-3:])


def slow_scene(spheres=300):
    """Takes the importer a second to read, or two."""
    return b'Camera "perspective"\nWorldBegin\nLightSource "infinite" "rgb L" [1 1 1]\n' + b"".join(
        b'AttributeBegin\nTranslate %d 0 0\nShape "sphere" "float radius" 1\nAttributeEnd\n' % i for i in range(spheres))


def importers():
    """The `azulejo submit` processes of this build."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            if b"\0submit\0" in read_bytes("/proc/%s/cmdline" % pid) and os.path.realpath("/proc/%s/exe" % pid) == os.path.realpath(
                    os.path.join(BIN, "azulejo")):
                found.append(int(pid))
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            pass
    return found


def importers_of(farm):
    """Those that work on this farm's uploads."""
    def at(pid):
        try:
            return os.readlink("/proc/%d/cwd" % pid).startswith(farm.store)
        except OSError:
            return False
    return [pid for pid in importers() if at(pid)]


@tests.add
def vanished_clients():
    """a client that vanishes while it sends leaves no file; while its scene is imported, no process"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        number = api.begin()
        host, port = api.host.split(":")
        with socket.create_connection((host, int(port))) as half:
            half.sendall(b"PUT /api/v1/imports/%d/files/half.bin HTTP/1.1\r\nHost: %s\r\nAuthorization: Bearer %s\r\nContent-Length: 10000000\r\n\r\n"
                         % (number, api.host.encode(), api.token.encode()) + bytes(3000000))
            parts = os.path.join(farm.store, "imports", str(number))
            wait_for(lambda: os.listdir(os.path.join(parts, "tmp")), "the file to arrive")
        wait_for(lambda: not os.listdir(os.path.join(parts, "tmp")), "the half file to go")
        expect(os.listdir(os.path.join(parts, "files")) == [], "half a file")
        api.put(number, "slow.pbrt", slow_scene())
        body = json.dumps({"scene": "slow.pbrt", "options": SMALL}).encode()
        with socket.create_connection((host, int(port))) as gone:
            gone.sendall(b"POST /api/v1/imports/%d HTTP/1.1\r\nHost: %s\r\nAuthorization: Bearer %s\r\nContent-Type: application/json\r\n"
                         b"Content-Length: %d\r\n\r\n" % (number, api.host.encode(), api.token.encode(), len(body)) + body)
            wait_for(lambda: importers_of(farm), "the importer")
        wait_for(lambda: not importers_of(farm), "the importer to end")
        wait_for(lambda: api.ask("POST", "imports/%d" % number, {"scene": "slow.pbrt", "options": SMALL}).status == 201, "the job")
        expect(len(farm.cli("list", "--json", expect=0).json()["jobs"]) == 1, "more than one job")


@tests.add
def holds_no_key():
    """the program that reads an upload has a key that opens nothing but its way through the page"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        number = api.begin()
        api.put(number, "slow.pbrt", slow_scene(600))
        answers = []
        asking = threading.Thread(target=lambda: answers.append(
            api.ask("POST", "imports/%d" % number, {"scene": "slow.pbrt", "options": SMALL})))
        asking.start()
        pid = wait_for(lambda: importers_of(farm), "the importer")[0]
        os.kill(pid, signal.SIGSTOP)
        try:
            words = read_bytes("/proc/%d/cmdline" % pid).decode()
            expect(farm.address not in words and "127.0.0.1:" in words, words)
            key = read_bytes("/proc/%d/fd/3" % pid)
            farm.cli("keygen", "--role", "web", "--from", farm.key, "-o", farm.path("web.key"), expect=0)
            known = [line for path in (farm.key, farm.path("web.key")) for line in read_bytes(path).splitlines() if len(line) > 20]
            held = read_bytes("/proc/%d/environ" % pid) + words.encode() + key
            expect(known and not [line for line in known if line in held], "it holds a key of the farm")
            with open(farm.path("stolen.key"), "wb") as stolen:
                stolen.write(key)
            os.chmod(farm.path("stolen.key"), 0o600)
            refused = farm.cli("list", key=farm.path("stolen.key"))
            expect(refused.code == 5, refused)
        finally:
            os.kill(pid, signal.SIGCONT)
        asking.join()
        expect(answers[0].status == 201, answers[0])


@tests.add
def killed_coordinator():
    """a coordinator that is killed takes its importers with it, and its successor removes the uploads; SIGTERM ends it quickly"""
    with Farm() as farm:
        start(farm)
        for how in (signal.SIGKILL, signal.SIGTERM):
            api = Api(farm)
            number = api.begin()
            api.put(number, "slow.pbrt", slow_scene())
            thread = threading.Thread(target=lambda: ignore(api.ask, "POST", "imports/%d" % number, {"scene": "slow.pbrt", "options": SMALL}))
            thread.start()
            wait_for(lambda: importers_of(farm), "the importer")
            began = time.monotonic()
            farm.coordinator.signal(how)
            code = farm.coordinator.wait(20)
            expect(code == (-9 if how == signal.SIGKILL else 0), "it ended with %d" % code)
            expect(time.monotonic() - began < 10 * PATIENCE, "the end took long")
            wait_for(lambda: not importers_of(farm), "the importer to end")
            thread.join()
            start(farm, listen=farm.address)
            wait_for(lambda: not folders(farm), "the uploads to go")
            expect(Api(farm).ask("DELETE", "imports/%d" % number).status == 404, "an upload of before")
        expect(farm.cli("list", "--json", expect=0).json()["jobs"] == [], "a job")


@tests.add
def three_at_once():
    """two are imported at a time, a third waits for its turn; one that is removed while it is imported ends; the farm answers meanwhile"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        numbers = [api.begin() for _ in range(4)]
        for number in numbers:
            api.put(number, "slow.pbrt", slow_scene())
        answers = {}
        def submit(number):
            answers[number] = api.ask("POST", "imports/%d" % number, {"scene": "slow.pbrt", "options": SMALL + ["--name", str(number)]})
        threads = [threading.Thread(target=submit, args=(number,)) for number in numbers]
        for thread in threads:
            thread.start()
        most, slowest = 0, 0
        wait_for(lambda: len(importers_of(farm)) == 2, "two importers")
        removed = None
        while any(thread.is_alive() for thread in threads):
            most = max(most, len(importers_of(farm)))
            began = time.monotonic()
            expect(farm.cli("list", "--json").code == 0, "the farm does not answer")
            slowest = max(slowest, time.monotonic() - began)
            time.sleep(0.05)  # how often we ask
            if removed is None:
                removed = numbers[3]
                api.ask("DELETE", "imports/%d" % removed, None, 204)
        for thread in threads:
            thread.join()
        expect(most == 2, "%d importers at a time" % most)
        expect(slowest < 5 * PATIENCE, "the farm answered after %g s" % slowest)
        for number in numbers:
            expect((answers[number].status == 201) == (number != removed), (number == removed, str(answers[number])))
        names = sorted(job["name"] for job in farm.cli("list", "--json", expect=0).json()["jobs"])
        expect(names == sorted(map(str, numbers[:3])), names)


@tests.add
def full_disk():
    """a nearly full disk refuses uploads and keeps what it must; so does --store-limit"""
    with Farm() as farm:
        with SmallDisk(farm, 64 << 20) as disk:
            if not disk:
                raise Skip("only root may mount small disks")
            farm.store = os.path.join(disk, "store")
            start(farm)
            api = Api(farm)
            number = api.begin()
            api.put(number, "a.bin", bytes(20 << 20))
            free = os.statvfs(disk)
            for size in (60 << 20, free.f_bavail * free.f_frsize - (3 << 20)):  # the second would fit, but a tenth stays free
                answer = api.put(number, "b.bin", bytes(size), None)
                expect(answer.status == 503 and "disk" in answer.json()["detail"], str(answer))
            expect(farm.cli("list", "--json").code == 0, "the farm does not answer")
            api.ask("DELETE", "imports/%d" % number, None, 204)
            wait_for(lambda: os.statvfs(disk).f_bavail * free.f_frsize > 50 << 20, "the room to be free again")
            farm.coordinator.stop()
    with Farm() as farm:
        start(farm, "--store-limit", "20M")
        api = Api(farm)
        number = api.begin()
        api.put(number, "a.bin", bytes(2 << 20))
        answer = wait_for(lambda: (lambda a: a if a.status != 201 else None)(api.put(number, "b.bin", bytes(30 << 20), None)), "a refusal")
        expect(answer.status in (413, 429) and "--store-limit" in answer.json()["detail"], str(answer))


@tests.add
def memory():
    """a large file is never held in memory, whether its sender is fast or slow"""
    with Farm() as farm:
        start(farm)
        api = Api(farm)
        number = api.begin()
        api.put(number, "first.bin", bytes(4 << 20))
        def peak():
            return int(re.search(r"VmHWM:\s+(\d+)", read_bytes("/proc/%d/status" % farm.coordinator.pid).decode()).group(1)) << 10
        before = peak()
        api.put(number, "large.bin", bytes(256 << 20))
        expect(peak() - before < (24 << 20) * PATIENCE, "%d MiB more" % ((peak() - before) >> 20))
        expect(os.path.getsize(os.path.join(farm.store, "imports", str(number), "files", "large.bin")) == 256 << 20, "its size")


@tests.add
def side_by_side():
    """files that arrive faster than the disk takes them are all answered, and soon"""
    with Farm() as farm:
        start(farm, env={"UV_THREADPOOL_SIZE": "1"})
        api = Api(farm)
        number = api.begin()
        slowest = []
        def send(which):
            for turn in range(20):
                began = time.monotonic()
                answer = ignore(api.put, number, "%d/%d.bin" % (which, turn), bytes((1 << 20) + 8192 * turn), None)
                slowest.append((time.monotonic() - began, str(answer)[:100]))
        threads = [threading.Thread(target=send, args=(which,)) for which in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        expect(all(answer.startswith("201") for _, answer in slowest), sorted(slowest)[-3:])
        expect(max(slowest)[0] < 10 * PATIENCE, sorted(slowest)[-3:])


tests.run()
