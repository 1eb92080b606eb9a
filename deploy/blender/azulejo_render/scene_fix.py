"""Adds to an exported glTF scene what Blender's exporter leaves out. No bpy in here.

`fix(gltf, scene)` changes the parsed JSON. `scene` is what export.py found in Blender's scene, lengths in metres,
matrices as 4 rows of 4 numbers in Blender's axes (+Z up):

    camera  {name, matrices, lens_mm, sensor_mm, fit, ortho_scale | None, shift}
    lights  [{name, kind, matrix, color, watts, radius, angle, size, blend, shape, width, height}]
    size    [width, height] of the whole picture, in pixels
    begin   when the first of several matrices holds, in seconds; see retime()

matrices: one, or one for each of the frames before, in and after the picture for motion blur."""
import base64
import math
import struct

SPREAD = 64          # lights that stand for a lamp with a size that is no surface: suns and spots
SPHERE_RINGS, SPHERE_SEGMENTS = 8, 16
DISC_SEGMENTS = 48
FLOAT, USHORT = 5126, 5123
LIGHTS, STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"


# ---- axes and matrices -----------------------------------------------------------------------------------------------

def multiply(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


TO_GLTF = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]


def columns(matrix):
    """A node's `matrix`: 16 numbers, column by column, with +Y up. Cameras and lamps look along -Z in both worlds."""
    m = multiply(TO_GLTF, matrix)
    return [m[row][column] for column in range(4) for row in range(4)]


def without_scale(matrix):
    out = [list(row) for row in matrix]
    for column in range(3):
        length = math.sqrt(sum(matrix[row][column] ** 2 for row in range(3)))
        for row in range(3):
            out[row][column] = matrix[row][column] / length if length > 0 else float(row == column)
    return out


def scales(matrix):
    return [math.sqrt(sum(matrix[row][column] ** 2 for row in range(3))) for column in range(3)]


def moved(matrix, x, y, z):
    """The matrix, moved along its own axes."""
    out = [list(row) for row in matrix]
    for row in range(3):
        out[row][3] += matrix[row][0] * x + matrix[row][1] * y + matrix[row][2] * z
    return out


def turned(matrix, x, y):
    """The matrix, so that it looks along (x, y, -1) of its own axes."""
    length = math.sqrt(x * x + y * y + 1)
    back = (-x / length, -y / length, 1 / length)
    side = (back[2], 0.0, -back[0])                    # (0, 1, 0) x back
    norm = math.hypot(side[0], side[2])
    side = (side[0] / norm, 0.0, side[2] / norm)
    up = (back[1] * side[2] - back[2] * side[1], back[2] * side[0] - back[0] * side[2],
          back[0] * side[1] - back[1] * side[0])
    local = [[side[i], up[i], back[i], 0.0] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
    return multiply(matrix, local)


def quaternion(matrix):
    """x, y, z, w of a rotation's matrix in glTF's axes."""
    m = multiply(TO_GLTF, matrix)
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0:
        s = 2 * math.sqrt(trace + 1)
        return [(m[2][1] - m[1][2]) / s, (m[0][2] - m[2][0]) / s, (m[1][0] - m[0][1]) / s, s / 4]
    i = max(range(3), key=lambda k: m[k][k])
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2 * math.sqrt(max(1 + m[i][i] - m[j][j] - m[k][k], 1e-30))
    out = [0.0, 0.0, 0.0, (m[k][j] - m[j][k]) / s]
    out[i], out[j], out[k] = s / 4, (m[j][i] + m[i][j]) / s, (m[k][i] + m[i][k]) / s
    return out


# ---- the file's tables ---------------------------------------------------------------------------------------------

def add(gltf, table, row):
    rows = gltf.setdefault(table, [])
    rows.append(row)
    return len(rows) - 1


def uses(gltf, extension):
    names = gltf.setdefault("extensionsUsed", [])
    if extension not in names:
        names.append(extension)


def add_node(gltf, node):
    number = add(gltf, "nodes", node)
    scenes = gltf.setdefault("scenes", [{"nodes": []}])
    scenes[gltf.setdefault("scene", 0)].setdefault("nodes", []).append(number)
    return number


def add_accessor(gltf, values, kind, component=FLOAT):
    """values: tuples of equal length."""
    data = struct.pack("<%d%s" % (len(values) * len(values[0]), "f" if component == FLOAT else "H"),
                       *(number for value in values for number in value))
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode("ascii")
    buffer = add(gltf, "buffers", {"byteLength": len(data), "uri": uri})
    view = add(gltf, "bufferViews", {"buffer": buffer, "byteLength": len(data)})
    row = {"bufferView": view, "componentType": component, "count": len(values), "type": kind}
    if component == FLOAT:
        # As they are stored: in single precision.
        stored = list(zip(*[iter(struct.unpack("<%df" % (len(data) // 4), data))] * len(values[0])))
        row["min"] = [min(v[i] for v in stored) for i in range(len(values[0]))]
        row["max"] = [max(v[i] for v in stored) for i in range(len(values[0]))]
    return add(gltf, "accessors", row)


# ---- the camera ------------------------------------------------------------------------------------------------------

def is_wide(camera, width, height):
    """Does the sensor's size hold for the picture's width?"""
    return camera["fit"] == "HORIZONTAL" or (camera["fit"] != "VERTICAL" and width >= height)


def shift_pixels(camera, width, height):
    """How far the frame lies from the optical axis, in whole pixels to the right and upwards."""
    side = width if is_wide(camera, width, height) else height
    return round(camera["shift"][0] * side), round(camera["shift"][1] * side)


def widened(camera, width, height):
    """(whole width, whole height, x, y): with a shift, the frame is a part, at x, y from the upper left corner, of a larger
    picture whose middle is the optical axis."""
    dx, dy = shift_pixels(camera, width, height)
    return width + 2 * abs(dx), height + 2 * abs(dy), 2 * max(dx, 0), 2 * max(-dy, 0)


def add_camera(gltf, camera, width, height, begin):
    whole_width, whole_height = widened(camera, width, height)[:2]
    wide = is_wide(camera, width, height)
    row = {"name": camera["name"]}
    if camera["ortho_scale"] is not None:
        half = camera["ortho_scale"] / 2 / (width if wide else height)  # of a pixel
        row.update(type="orthographic", orthographic={
            "xmag": half * whole_width, "ymag": half * whole_height, "znear": 0, "zfar": 1e6})
    else:
        half = camera["sensor_mm"] / 2 / camera["lens_mm"] / (width if wide else height)
        row.update(type="perspective", perspective={
            "yfov": 2 * math.atan(half * whole_height), "aspectRatio": whole_width / whole_height, "znear": 1e-3})
    matrices = [without_scale(m) for m in camera["matrices"]]
    node = {"name": camera["name"], "camera": add(gltf, "cameras", row)}
    still = all(m == matrices[0] for m in matrices)
    if still:
        node["matrix"] = columns(matrices[0])
    number = add_node(gltf, node)
    if not still:
        turn = [quaternion(m) for m in matrices]
        for before, q in zip(turn, turn[1:]):
            if sum(a * b for a, b in zip(before, q)) < 0:
                q[:] = [-value for value in q]
        middle = len(matrices) // 2
        node["rotation"] = turn[middle]
        places = [tuple(multiply(TO_GLTF, m)[row][3] for row in range(3)) for m in matrices]
        node["translation"] = list(places[middle])
        times = add_accessor(gltf, [(begin + i,) for i in range(len(matrices))], "SCALAR")
        add(gltf, "animations", {"name": "camera", "samplers": [
            {"input": times, "output": add_accessor(gltf, places, "VEC3")},
            {"input": times, "output": add_accessor(gltf, [tuple(q) for q in turn], "VEC4")}], "channels": [
                {"sampler": 0, "target": {"node": number, "path": "translation"}},
                {"sampler": 1, "target": {"node": number, "path": "rotation"}}]})


# ---- lights ----------------------------------------------------------------------------------------------------------

def on_disc(count):
    """Points of a disc of radius 1 that share its area evenly (Vogel's spiral)."""
    golden = math.pi * (3 - math.sqrt(5))
    for i in range(count):
        radius = math.sqrt((i + 0.5) / count)
        yield radius * math.cos(i * golden), radius * math.sin(i * golden)


def add_lamp(gltf, row, matrix):
    uses(gltf, LIGHTS)
    rows = gltf.setdefault("extensions", {}).setdefault(LIGHTS, {}).setdefault("lights", [])
    rows.append(row)
    add_node(gltf, {"name": row["name"], "matrix": columns(without_scale(matrix)),
                    "extensions": {LIGHTS: {"light": len(rows) - 1}}})


def spot_cones(size, blend):
    """Inner and outer half angle: Blender's rim is a smooth step of the cosine."""
    outer = min(size / 2, math.pi / 2 - 1e-4)
    cosine = math.cos(outer)
    return math.acos(min(1.0, cosine + (1 - cosine) * max(blend, 1e-4))), outer


def add_glow(gltf, name, points, faces, radiance, matrix):
    """A surface that shines from its front alone, by `radiance`, W/(sr m^2) in R, G and B."""
    strength = max(radiance)
    if strength <= 0:
        return
    uses(gltf, STRENGTH)
    material = add(gltf, "materials", {
        "name": name, "emissiveFactor": [value / strength for value in radiance],
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
        "extensions": {STRENGTH: {"emissiveStrength": strength}, "KHR_materials_specular": {"specularFactor": 0}}})
    uses(gltf, "KHR_materials_specular")
    corners = [(index,) for face in faces for index in face]
    mesh = add(gltf, "meshes", {"name": name, "primitives": [{
        "attributes": {"POSITION": add_accessor(gltf, points, "VEC3")},
        "indices": add_accessor(gltf, corners, "SCALAR", USHORT), "material": material}]})
    add_node(gltf, {"name": name, "mesh": mesh, "matrix": columns(matrix)})


def triangle_area(a, b, c):
    u, v = [b[i] - a[i] for i in range(3)], [c[i] - a[i] for i in range(3)]
    cross = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    return math.sqrt(sum(x * x for x in cross)) / 2


def area_of(points, faces):
    return sum(triangle_area(*(points[i] for i in face)) for face in faces)


def sphere(radius):
    points, faces = [(0.0, 0.0, radius)], []
    for ring in range(1, SPHERE_RINGS):
        polar = math.pi * ring / SPHERE_RINGS
        for segment in range(SPHERE_SEGMENTS):
            turn = 2 * math.pi * segment / SPHERE_SEGMENTS
            points.append((radius * math.sin(polar) * math.cos(turn), radius * math.sin(polar) * math.sin(turn),
                           radius * math.cos(polar)))
    points.append((0.0, 0.0, -radius))
    last = len(points) - 1
    for s in range(SPHERE_SEGMENTS):
        after = (s + 1) % SPHERE_SEGMENTS
        faces.append((0, 1 + s, 1 + after))
        for ring in range(SPHERE_RINGS - 2):
            a, b = 1 + ring * SPHERE_SEGMENTS, 1 + (ring + 1) * SPHERE_SEGMENTS
            faces += [(a + s, b + s, b + after), (a + s, b + after, a + after)]
        low = 1 + (SPHERE_RINGS - 2) * SPHERE_SEGMENTS
        faces.append((low + s, last, low + after))
    return points, faces


def flat(light):
    """An area light's outline, which shines along -Z."""
    x, y = light["width"] / 2, light["height"] / 2
    if light["shape"] in ("DISK", "ELLIPSE"):
        rim = [(x * math.cos(a), y * math.sin(a), 0.0)
               for a in (2 * math.pi * i / DISC_SEGMENTS for i in range(DISC_SEGMENTS))]
        return rim, [(0, i + 1, i) for i in range(1, DISC_SEGMENTS - 1)]
    return [(-x, -y, 0.0), (-x, y, 0.0), (x, y, 0.0), (x, -y, 0.0)], [(0, 1, 2), (0, 2, 3)]


def scaled(points, scale):
    return [tuple(value * s for value, s in zip(point, scale)) for point in points]


def add_light(gltf, light):
    matrix, name, color = light["matrix"], light["name"], light["color"]
    kind, watts = light["kind"], light["watts"]
    if kind == "SUN":  # W/m^2
        parts = [(x, y) for x, y in on_disc(SPREAD)] if light["angle"] > 0 else [(0, 0)]
        reach = math.tan(min(light["angle"], 3.0) / 2)
        for x, y in parts:
            add_lamp(gltf, {"type": "directional", "name": name, "color": color, "intensity": watts / len(parts)},
                     turned(without_scale(matrix), x * reach, y * reach))
    elif kind == "SPOT":
        inner, outer = spot_cones(light["size"], light["blend"])
        parts = [(x, y) for x, y in on_disc(SPREAD)] if light["radius"] > 0 else [(0, 0)]
        for x, y in parts:
            add_lamp(gltf, {"type": "spot", "name": name, "color": color,
                            "intensity": watts / (4 * math.pi) / len(parts),
                            "spot": {"innerConeAngle": inner, "outerConeAngle": outer},
                            "extras": {"falloff": "smoothstep"}},
                     moved(without_scale(matrix), x * light["radius"], y * light["radius"], 0))
    elif kind == "AREA":
        points, faces = flat(light)
        points = scaled(points, scales(matrix))
        area = area_of(points, faces)
        if area > 0:
            # Cycles' area lights emit pi/4 of their watts (Blender 3.4: measured to 1 %).
            add_glow(gltf, name, points, faces, [c * watts / (4 * area) for c in color], without_scale(matrix))
    elif light["radius"] > 0:
        points, faces = sphere(light["radius"])
        area = area_of(points, faces)  # a convex body is seen by a quarter of its surface, on the mean
        add_glow(gltf, name, points, faces, [c * watts / (math.pi * area) for c in color], without_scale(matrix))
    else:
        add_lamp(gltf, {"type": "point", "name": name, "color": color, "intensity": watts / (4 * math.pi)}, matrix)


# ---- motion ----------------------------------------------------------------------------------------------------------

def retime(gltf, buffers, fps, shift):
    """Make a frame a second, and all `shift` seconds later: the exporter counts seconds from Blender's frame 0.
    buffers: the bytes of each of the file's buffers (bytearrays), changed in place."""
    rows = sorted({sampler["input"] for animation in gltf.get("animations", ()) for sampler in animation["samplers"]})
    spans = []
    for number in rows:
        accessor = gltf["accessors"][number]
        view = gltf["bufferViews"][accessor["bufferView"]]
        spans.append((accessor, view["buffer"], view.get("byteOffset", 0) + accessor.get("byteOffset", 0)))
    keys = {}
    for accessor, buffer, at in spans:
        keys[buffer, at] = struct.unpack_from("<%df" % accessor["count"], buffers[buffer], at)
    done = set()
    for accessor, buffer, at in spans:
        times = [t * fps + shift for t in keys[buffer, at]]
        if (buffer, at) not in done:
            struct.pack_into("<%df" % len(times), buffers[buffer], at, *times)
            done.add((buffer, at))
        accessor["min"], accessor["max"] = [times[0]], [times[-1]]


# ---- materials -------------------------------------------------------------------------------------------------------

def fix_material(gltf, row, scene):
    """What Cycles makes of a material, and the exporter writes otherwise: clear surfaces bound a solid, which a volume may
    fill, and before Blender 4 a coat has a quarter of its weight."""
    known = row.get("extensions", {})
    coat = known.get("KHR_materials_clearcoat")
    if coat and "clearcoatFactor" in coat:
        coat["clearcoatFactor"] *= scene["coat"]
    if "KHR_materials_transmission" not in known:
        return
    uses(gltf, "KHR_materials_volume")
    volume = known.setdefault("KHR_materials_volume", {"thicknessFactor": 1.0})
    density, color = scene["absorption"].get(row.get("name"), (0, None))
    if density > 0:
        # Cycles absorbs density * (1 - color) a metre.
        volume["attenuationDistance"] = 1 / density
        volume["attenuationColor"] = [math.exp(c - 1) for c in color]


def fill_without_material(gltf):
    """Cycles' material for what has none: a grey one. glTF's is a white metal."""
    bare = [p for mesh in gltf.get("meshes", ()) for p in mesh["primitives"] if "material" not in p]
    if not bare:
        return
    uses(gltf, "KHR_materials_specular")
    number = add(gltf, "materials", {
        "name": "no material", "doubleSided": True, "extensions": {"KHR_materials_specular": {"specularFactor": 0}},
        "pbrMetallicRoughness": {"baseColorFactor": [.8, .8, .8, 1], "metallicFactor": 0, "roughnessFactor": 1}})
    for primitive in bare:
        primitive["material"] = number


def fix(gltf, scene):
    """Mend the materials of the parsed JSON, and add the lights and the camera."""
    width, height = scene["size"]
    for row in gltf.get("materials", ()):
        fix_material(gltf, row, scene)
    fill_without_material(gltf)
    for light in scene["lights"]:
        add_light(gltf, light)
    add_camera(gltf, scene["camera"], width, height, scene["begin"])


# ---- what is in the picture --------------------------------------------------------------------------------------------

def glowing_in_view(scene):
    """Names of lights that become surfaces, and that the camera sees: Cycles hides them."""
    camera = scene["camera"]
    width, height = scene["size"]
    m = without_scale(camera["matrices"][len(camera["matrices"]) // 2])
    wide = is_wide(camera, width, height)
    names = []
    for light in scene["lights"]:
        if not (light["kind"] == "AREA" or (light["kind"] == "POINT" and light["radius"] > 0)):
            continue
        if light["kind"] == "AREA":
            toward = [m[i][3] - light["matrix"][i][3] for i in range(3)]
            if sum(-light["matrix"][i][2] * toward[i] for i in range(3)) <= 0:
                continue  # its back
        offset = [light["matrix"][i][3] - m[i][3] for i in range(3)]
        x, y, z = (sum(m[i][k] * offset[i] for i in range(3)) for k in range(3))
        if camera["ortho_scale"] is not None:
            half = camera["ortho_scale"] / 2
        elif z < 0:
            half = -z * camera["sensor_mm"] / 2 / camera["lens_mm"]
        else:
            continue
        side = (width if wide else height) / 2
        if abs(x / half * side) <= width / 2 and abs(y / half * side) <= height / 2:
            names.append(light["name"])
    return names
