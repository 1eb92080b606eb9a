"""The files that a scene names: only those below its own folder are read, whatever the format."""
import json
import os
import shlex
import struct
import sys
import zlib

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import Farm, Failure, Tests, read_bytes, write_scene

tests = Tests()


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


def write(path, content):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "wb") as out:
        out.write(content if isinstance(content, bytes) else content.encode())
    return path


def png(width, height):
    """Black, one bit a pixel: a few bytes for millions of pixels."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    pack = zlib.compressobj(9)
    row = bytes(1 + (width + 7) // 8)
    data = b"".join(pack.compress(row) for _ in range(height)) + pack.flush()
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)) +
            chunk(b"IDAT", data) + chunk(b"IEND", b""))


TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
PLY = ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
       "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
       "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
OBJ = "mtllib %s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
SHAPE = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "point2 uv" [0 0 1 0 0 1]\n'
LAMP = 'LightSource "point"\n'


def gltf_buffer(name):
    return json.dumps({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": name}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}]})


def gltf_image(name):
    scene = json.loads(gltf_buffer("triangle.bin"))
    scene["images"] = [{"uri": name}]
    scene["textures"] = [{"source": 0}]
    scene["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    scene["meshes"][0]["primitives"][0]["material"] = 0
    return json.dumps(scene)


# What names the file, in which kind of scene, and what the file is.
CASES = {
    "buffer.gltf": (gltf_buffer, TRIANGLE),
    "image.gltf": (gltf_image, png(2, 2)),
    "library.obj": (lambda name: OBJ % name, "newmtl a\nKd 1 0 0\n"),
    "texture.obj": (lambda name: OBJ % "texture.mtl", png(2, 2)),
    "include.pbrt": (lambda name: 'WorldBegin\nInclude "%s"\n' % name + LAMP + SHAPE, SHAPE),
    "import.pbrt": (lambda name: 'WorldBegin\nImport "%s"\n' % name + LAMP + SHAPE, SHAPE),
    "ply.pbrt": (lambda name: 'WorldBegin\n' + LAMP +
                 'Shape "plymesh" "string filename" "%s"\n' % name, PLY),
    "texture.pbrt": (lambda name: 'WorldBegin\n' + LAMP + 'Texture "t" "spectrum" "imagemap" '
                     '"string filename" "%s"\nMaterial "diffuse" "texture reflectance" "t"\n' % name
                     + SHAPE, png(2, 2)),
    "spectrum.pbrt": (lambda name: 'WorldBegin\n' + LAMP +
                      'Material "diffuse" "spectrum reflectance" "%s"\n' % name + SHAPE,
                      "400 0.5\n700 0.5\n"),
    "profile.pbrt": (lambda name: 'WorldBegin\nLightSource "goniometric" "string filename" "%s"\n'
                     % name + SHAPE, png(2, 2)),
    "sky.pbrt": (lambda name: 'WorldBegin\nLightSource "infinite" "string filename" "%s"\n' % name +
                 SHAPE, b"PF\n2 2\n-1.0\n" + bytes(48)),
}


def put_scene(folder, case, name):
    """A scene of that kind that names the file so."""
    write(os.path.join(folder, "triangle.bin"), TRIANGLE)
    write(os.path.join(folder, "texture.mtl"), "newmtl a\nmap_Kd %s\n" % name)
    return write(os.path.join(folder, case), CASES[case][0](name))


def refused(farm, scene, secret, *options):
    """The import fails because of `secret`, and the option it names lets it pass."""
    result = farm.cli("import", scene, *options, expect=3)
    expect("--allow-outside" in result.err, result)
    expect(os.path.basename(scene).split(".")[0] in result.err, result)
    words = shlex.split(result.err[result.err.index("--allow-outside"):])[:2]
    expect(words[1] == os.path.dirname(os.path.realpath(secret)), result)
    report = farm.cli("import", scene, "--json", *words, *options, expect=0).json()
    expect(any(os.path.realpath(f["name"]) == os.path.realpath(secret) and
               f["bytes"] == os.path.getsize(secret) for f in report["inputs"]), report)


@tests.add
def outside():
    """a file elsewhere is refused in every format, and the option that the message names allows it"""
    with Farm() as farm:
        secrets, folder = farm.path("it's private"), farm.path("scene")
        for case, (_, content) in CASES.items():
            secret = write(os.path.join(secrets, "secret"), content)
            refused(farm, put_scene(folder, case, "../it's private/secret"), secret)


@tests.add
def ways_out():
    """absolute paths, percent signs, links to files and folders, and back and forth all end outside"""
    with Farm() as farm:
        folder = farm.path("scene")
        secret = write(farm.path("private", "secret"), TRIANGLE)
        os.makedirs(os.path.join(folder, "sub"))
        os.symlink("../private/secret", os.path.join(folder, "link"))
        os.symlink(farm.path("private"), os.path.join(folder, "away"))
        for name in (secret, "../private/secret", "%2e%2e/private%2Fsecret", "..\\private\\secret",
                     "sub/../../private/secret", "link", "away/secret", "away/../private/secret",
                     "../scene/link", "./link"):
            refused(farm, put_scene(folder, "buffer.gltf", name), secret)
        for name in ("C:\\secret", "file://" + secret):
            result = farm.cli("import", put_scene(folder, "buffer.gltf", name), expect=3)
            expect("scheme" in result.err, result)
        # A neighbour whose name begins like the folder's is not below it.
        write(farm.path("scene2", "secret"), TRIANGLE)
        refused(farm, put_scene(folder, "buffer.gltf", "../scene2/secret"),
                farm.path("scene2", "secret"))


@tests.add
def inside():
    """what lies inside is read: through '..', links, absolute paths, from another working folder"""
    with Farm() as farm:
        folder = farm.path("scene")
        for case, (_, content) in CASES.items():
            inner = write(os.path.join(folder, "sub", "inner"), content)
            for name in ("sub/inner", "sub/../sub/inner", "../scene/sub/inner", inner):
                farm.cli("import", put_scene(folder, case, name), expect=0)
        os.symlink("sub/inner", os.path.join(folder, "link"))
        write(os.path.join(folder, "sub", "inner"), TRIANGLE)
        put_scene(folder, "buffer.gltf", "link")
        farm.cli("import", "buffer.gltf", cwd=folder, expect=0)
        farm.cli("import", "../buffer.gltf", cwd=os.path.join(folder, "sub"), expect=0)
        os.symlink(folder, farm.path("other name"))
        farm.cli("import", farm.path("other name", "buffer.gltf"), expect=0)


@tests.add
def not_regular():
    """a pipe, a device and a folder are refused without waiting for them"""
    with Farm() as farm:
        folder = farm.path("scene")
        os.makedirs(os.path.join(folder, "sub"))
        os.mkfifo(os.path.join(folder, "pipe"))
        for case in CASES:
            for name in ("pipe", "sub", ".", "/dev/zero"):
                result = farm.cli("import", put_scene(folder, case, name), "--strict", "--allow-outside", "/dev",
                                  limit_s=20, expect=3)
                expect("regular" in result.err, result)


@tests.add
def a_library_that_is_missing():
    """an OBJ file without its material library is grey, with a warning; --strict refuses it by file and line"""
    with Farm() as farm:
        scene = write(farm.path("a.obj"), "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n")
        result = farm.cli("import", scene, expect=0)
        expect('the material library "gone.mtl" cannot be read' in result.err + result.out, result)
        result = farm.cli("import", scene, "--strict", expect=3)
        expect("a.obj: line 1: mtllib: " in result.err and "gone.mtl" in result.err, result)


@tests.add
def every_command():
    """render, submit and effects refuse the same, and allow it with the same option"""
    with Farm() as farm:
        farm.start_coordinator()
        secret = write(farm.path("private", "secret"), TRIANGLE)
        scene = put_scene(farm.path("scene"), "buffer.gltf", "../private/secret")
        small = ["--size", "8x8", "--spp", "1", "--max-depth", "1"]
        for command, more in (("submit", []), ("render", ["-o", farm.path("out")]), ("effects", [])):
            result = farm.cli(command, scene, *small, *more)
            expect(result.code == 3 and "--allow-outside " + shlex.quote(os.path.dirname(secret)) in result.err,
                   result)
            result = farm.cli(command, scene, *small, *more, "--allow-outside",
                              os.path.dirname(secret), expect=0)
            # effects sends nothing.
            expect(("takes 2 files" in result.err) == (command != "effects"), result)
        result = farm.cli("import", scene, "--allow-outside", farm.path("missing"))
        expect(result.code == 2 and "--allow-outside" in result.err, result)


@tests.add
def lists():
    """import lists the files with their sizes; submit and render count them, and list them in JSON"""
    with Farm() as farm:
        farm.start_coordinator()
        folder = farm.path("scene")
        write(os.path.join(folder, "picture.png"), png(2, 2))
        scene = put_scene(folder, "image.gltf", "picture.png")
        sky = write(farm.path("sky.pfm"), "")
        wanted = {p: os.path.getsize(p) for p in (scene, os.path.join(folder, "picture.png"),
                                                  os.path.join(folder, "triangle.bin"))}
        text = farm.cli("import", scene, expect=0).out
        expect("takes:          3 files" in text, text)
        for path, size in wanted.items():
            expect("%s %d B" % (path, size) in " ".join(text.split()), text)
        report = farm.cli("import", scene, "--json", expect=0).json()
        expect({f["name"]: f["bytes"] for f in report["inputs"]} == wanted, report)
        result = farm.cli("submit", scene, "--json", "--size", "8x8", expect=0)
        expect({f["name"]: f["bytes"] for f in result.json()["inputs"]} == wanted, result)
        expect("takes 3 files" in result.err, result)
        expect("takes" not in farm.cli("submit", scene, "-q", expect=0).err, "-q")
        expect(os.path.exists(sky), sky)


@tests.add
def too_large():
    """an image beyond the limit is refused by its header, with the option that would allow it"""
    with Farm() as farm:
        folder = farm.path("scene")
        bomb = png(32768, 32768)
        write(os.path.join(folder, "bomb.png"), bomb)
        write(os.path.join(folder, "bomb.tga"),
              struct.pack("<BBBHHBHHHHBB", 0, 0, 10, 0, 0, 0, 0, 0, 32768, 32768, 24, 0) +
              b"\xff\0\0\0" * (32768 * 32768 // 128))
        for case, name in (("image.gltf", "bomb.png"), ("texture.obj", "bomb.png"),
                           ("texture.pbrt", "bomb.png"), ("texture.pbrt", "bomb.tga")):
            result = farm.cli("import", put_scene(folder, case, name), expect=3, limit_s=20)
            expect(name in result.err and "32768 x 32768" in result.err and
                   "270 million" in result.err and "--max-image 1074" in result.err, result)
        # The option is read: what is one pixel too large for it passes one step higher.
        write(os.path.join(folder, "wide.png"), png(1000, 1001))
        scene = put_scene(folder, "image.gltf", "wide.png")
        expect("--max-image 2" in farm.cli("import", scene, "--max-image", "1", expect=3).err, "1")
        farm.cli("import", scene, "--max-image", "2", expect=0)
        result = farm.cli("import", scene, "--max-image-memory", "100K", expect=3)
        expect("wide.png" in result.err and "--max-image-memory" in result.err, result)
        farm.cli("import", scene, "--max-image-memory", "1M", expect=0)
        sky = write(farm.path("sky.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 40000\n")
        result = farm.cli("import", scene, "--env", sky, expect=3)
        expect("sky.hdr" in result.err and "--max-image 800" in result.err, result)


tests.run()
