#!/usr/bin/env python3
"""Write openapi.yaml, the description of the API, to standard output: from the routes that scripts/openapi_routes.c
prints, on standard input, and the messages of protocol/azulejo.proto, whose JSON form is protocol/json/json_wire.h's.

    openapi_routes | scripts/openapi.py DESCRIPTORS

DESCRIPTORS is what protoc-c --descriptor_set_out --include_source_info makes of the schema.
"""
import json
import os
import re
import sys


# ---- the messages -----------------------------------------------------------------------------------------------

def values(data):
    """{field's number: [its values]} of an encoded message: numbers, and bytes."""
    found, at = {}, 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
    while at < len(data):
        key = varint()
        if key & 7 == 0:
            value = varint()
        else:
            size = varint() if key & 7 == 2 else 8 if key & 7 == 1 else 4
            value = data[at:at + size]
            at += size
        found.setdefault(key >> 3, []).append(value)
    return found


# Of google/protobuf/descriptor.proto: the numbers of fields, and of types.
FILE_MESSAGE, FILE_ENUM, FILE_SOURCE, NAME, FIELD, NESTED, LABEL, TYPE, TYPE_NAME, PATH, LEADING, TRAILING = 4, 5, 9, 1, 2, 3, 4, 5, 6, 1, 3, 4
REPEATED, MESSAGE, ENUM = 3, 11, 14
TYPES = ("", "double", "float", "int64", "uint64", "int32", "fixed64", "fixed32", "bool", "string", "", "", "bytes", "uint32", "",
         "sfixed32", "sfixed64", "sint32", "sint64")


def text(message, field):
    return message[field][0].decode() if field in message else ""


def read_proto(path):
    """{message: [(name, type, repeated, comment)]}, {enum: [words]}; a map is (name, "map<its values' type>", False, comment)"""
    with open(path, "rb") as file:
        schema = values(values(file.read())[1][0])
    comments = {}
    for location in map(values, values(schema[FILE_SOURCE][0])[1]):
        words = text(location, LEADING) + text(location, TRAILING)
        comments[location.get(PATH, [b""])[0]] = " ".join(words.split())

    def kind(field):
        return text(field, TYPE_NAME).rpartition(".")[2] if field[TYPE][0] in (MESSAGE, ENUM) else TYPES[field[TYPE][0]]
    messages, enums = {}, {}
    for number, message in enumerate(map(values, schema[FILE_MESSAGE])):
        maps = {text(entry, NAME): "map<%s>" % kind(values(entry[FIELD][1])) for entry in map(values, message.get(NESTED, []))}
        rows = messages[text(message, NAME)] = []
        for place, field in enumerate(map(values, message.get(FIELD, []))):
            found = maps.get(kind(field), kind(field))
            rows.append((text(field, NAME), found, field[LABEL][0] == REPEATED and found == kind(field),
                         comments.get(path_of(FILE_MESSAGE, number, FIELD, place), "")))
    for enum in map(values, schema[FILE_ENUM]):
        words = [text(values(value), NAME) for value in enum[2]]
        prefix = os.path.commonprefix(words)
        enums[text(enum, NAME)] = [w[prefix.rfind("_") + 1:].lower() for w in words]
    return messages, enums


def path_of(*numbers):
    """As SourceCodeInfo.Location.path is encoded."""
    out = b""
    for n in numbers:
        while n > 127:
            out += bytes([n & 127 | 128])
            n >>= 7
        out += bytes([n])
    return out


NUMBERS = {"uint32": (0, 2**32 - 1), "fixed32": (0, 2**32 - 1), "int32": (-2**31, 2**31 - 1), "sint32": (-2**31, 2**31 - 1)}


def ref(name):
    return {"$ref": "#/components/schemas/" + name}


class Schemas:
    def __init__(self, messages, enums, choices):
        self.messages, self.enums = messages, enums
        # {(message, field): (words, is it a set?)}
        self.choices = {(c["message"], c["field"]): ([w.replace(" ", "-") for w in c["words"]], c["set"]) for c in choices}
        self.made = {}
        self.asked = set()

    def reach(self, name, into):
        """All messages in this one."""
        if name in into or name not in self.messages:
            return into
        into.add(name)
        for _, kind, _, _ in self.messages[name]:
            self.reach(kind, into)
        return into

    def kind(self, kind):
        if kind in NUMBERS:
            return {"type": "integer", "minimum": NUMBERS[kind][0], "maximum": NUMBERS[kind][1]}
        if re.fullmatch(r"u?s?int64|s?fixed64", kind):
            return ref("Integer64")
        if kind in ("float", "double"):
            return ref("Real")
        if kind == "bool":
            return {"type": "boolean"}
        if kind == "string":
            return {"type": "string"}
        if kind == "bytes":
            return ref("Bytes")
        if kind.startswith("map<"):
            return {"type": "object", "additionalProperties": ref("Parameter")}
        if kind in self.enums:
            return {"type": "string", "enum": self.enums[kind]}
        return self.message(kind)

    def property(self, message, field, kind, repeated, comment):
        words, is_set = self.choices.get((message, field), (None, False))
        schema = {"type": "string", "enum": words} if words else self.kind(kind)
        if repeated or is_set:
            schema = {"type": "array", "items": schema}
        return {"allOf": [schema], "description": comment} if comment and "$ref" in schema else \
            dict(schema, description=comment) if comment else schema

    def fields(self, name, without=()):
        return {field: self.property(name, field, kind, repeated, comment)
                for field, kind, repeated, comment in self.messages[name] if field not in without}

    def message(self, name):
        if name not in self.made:
            self.made[name] = {}
            schema = {"type": "object", "additionalProperties": False, "properties": self.fields(name)}
            # What is written has all values; a message may be absent.
            required = [f for f, kind, repeated, _ in self.messages[name] if repeated or kind not in self.messages]
            if name not in self.asked and required:
                schema["required"] = required
            self.made[name] = schema
        return ref(name)


# ---- what has a form of its own -----------------------------------------------------------------------------------

def obj(required="", optional="", **kinds):
    """An object of these fields; of text, unless `kinds` says otherwise."""
    names = required.split() + optional.split()
    return {"type": "object", "required": required.split(),
            "properties": {n: kinds.get(n, {"type": "string"}) for n in names}, "additionalProperties": False}


def array(items):
    return {"type": "array", "items": items}


WHOLE, BOOL, TEXT, REAL, BIG = ({"type": "integer", "minimum": 0}, {"type": "boolean"}, {"type": "string"}, ref("Real"),
                                ref("Integer64"))
PARAMETER = obj("name kind default help", "min max choices", kind={"enum": ["number", "integer", "choice"]},
                min=REAL, max=REAL, default={}, choices=array(TEXT))
OPERATOR = obj("name summary source adaptive measured display_encoded local file parameters", adaptive=BOOL,
               measured=BOOL, display_encoded=BOOL, local=BOOL, file={"enum": ["none", "optional", "required"]},
               parameters=array(PARAMETER))
HEALTH = obj("name one many remedy")
WORDS = array(TEXT)
VERB = obj("name path role says label done question button takes field single states accepted front", single=BOOL,
           states=WORDS, accepted=WORDS, front=WORDS,
           takes={"enum": ["nothing", "flag", "number", "text", "frames", "form"]})
NAMES = "effects stages aovs isas env_samplings samplers light_choices texture_filters bvh_qualities pixel_filters stop_measures"
SESSION = obj("role who", "token software farm name address port login_required", role={
    "enum": ["none", "view", "submit", "operate", "admin"]}, token=WHOLE)
SESSION["additionalProperties"] = True
# Method and path: what is answered (content type, schema), and the body that is taken.
FORMS = {
    "get /": ("text/html", TEXT), "get /assets/{file}": ("*/*", {}), "get /assets/{folder}/{file}": ("*/*", {}),
    "get /docs/errors": ("text/plain", TEXT),
    "get /healthz": ("text/plain", TEXT), "get /readyz": ("text/plain", TEXT), "get /metrics": ("text/plain", TEXT),
    "get /api/v1/openapi.yaml": ("application/yaml", TEXT),
    "post /api/v1/session": ("application/json", SESSION, obj("token")),
    "get /api/v1/session": ("application/json", SESSION),
    "delete /api/v1/session": ("application/json", {}),
    "get /api/v1/operators": ("application/json", obj(
        "operators metering denoise exposure_max kelvin_min kelvin_max temporal_max", operators=array(OPERATOR),
        metering=array(TEXT), denoise=array(TEXT), exposure_max=WHOLE, kelvin_min=WHOLE, kelvin_max=WHOLE, temporal_max=WHOLE)),
    "get /api/v1/effects": ("application/json", obj("switchable health " + NAMES, switchable=WORDS, health=array(HEALTH),
                                                    **{n: array(TEXT) for n in NAMES.split()})),
    "get /api/v1/verbs": ("application/json", obj("verbs", verbs=array(VERB))),
    "put /api/v1/blobs/{digest}": ("application/json", obj("digest bytes", digest=ref("Bytes"), bytes=BIG)),
    "get /api/v1/events": ("text/event-stream", TEXT), "get /api/v1/live": (None, {}),
    "get /api/v1/jobs/{job}/frames/{frame}/live": ("application/octet-stream", {"type": "string", "format": "binary"}),
    "post /api/v1/imports": ("application/json", obj("import", **{"import": BIG})),
    "put /api/v1/imports/{import}/files/{path...}": ("application/json", obj("path bytes", bytes=BIG)),
    "post /api/v1/imports/{import}": ("application/json", obj("job", job=BIG), obj("scene", "options", options=array(TEXT), keep=BOOL)),
    "delete /api/v1/imports/{import}": ("application/json", {}),
}
FORMS["post /api/v1/imports/{import}"][1]["additionalProperties"] = True
CREATES = {"post /api/v1/imports", "put /api/v1/imports/{import}/files/{path...}"}  # answered with 201
# Of a file: its type.
FILES = {"exr": "image/x-exr", "png": "image/png", "jpg": "image/jpeg", "effects.json": "application/json",
         "preview.exr": "image/x-exr", "preview.png": "image/png"}
# Values of a query that are fields of no message.
QUERIES = {"tonemap": TEXT, "exposure": {"type": "number"}, "metering": {"enum": ["off", "key", "percentile"]},
           "metering_percentile": {"type": "number"}, "white_kelvin": {"type": "number"},
           "denoise": {"enum": ["off", "on", "fast"]}, "no_dither": {"enum": ["0", "1"]}, "after": TEXT, "layer": TEXT}


# ---- the document -------------------------------------------------------------------------------------------------

def parameters(route, schemas):
    fields = {f: (kind, comment) for f, kind, _, comment in
              schemas.messages[route["message"]["type"]]} if route["message"] else {}
    out = []
    for name in re.findall(r"\{([\w.]+)\}", route["path"]):
        schema = schemas.kind(fields[name][0]) if name in fields else TEXT
        out.append({"name": name.rstrip("."), "in": "path", "required": True, "schema": schema})
    for name in route["query"].split():
        if name.endswith(".*"):
            out.append({"name": "parameters", "in": "query", "style": "form", "explode": True,
                        "description": "The operator's own, as %sNAME=VALUE." % name[:-1],
                        "schema": {"type": "object", "additionalProperties": TEXT}})
            continue
        known = not route["run"] and name in fields
        schema = schemas.kind(fields[name][0]) if known else QUERIES[name]
        out.append(dict({"name": name, "in": "query", "schema": schema},
                        **({"description": fields[name][1]} if known and fields[name][1] else {})))
    return out


def body_of(route, schemas):
    """The JSON that the route takes: the message without what the path says."""
    form = FORMS.get("%s %s" % (route["method"], route["path"]))
    if route["streams"]:
        return {"required": True, "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
    if route["method"] in ("get", "delete"):
        return None
    if form and len(form) > 2:
        return {"required": True, "content": {"application/json": {"schema": form[2]}}}
    if not route["message"]:
        return None
    taken = set(re.findall(r"\{([\w.]+)\}", route["path"])) | {f.split("=")[0] for f in route["fixed"].split()}
    fields = schemas.fields(route["message"]["type"], taken)
    if not fields:
        return {"required": False, "content": {"application/json": {"schema": obj()}}}
    return {"required": False, "content": {"application/json": {"schema": {
        "type": "object", "additionalProperties": False, "properties": fields}}}}


def content_of(route, schemas):
    form = FORMS.get("%s %s" % (route["method"], route["path"]))
    if (route["answer"] or {}).get("field") == "output_data":
        kind = FILES[route["path"].rsplit("/", 1)[1]]
        schema = {} if kind == "application/json" else {"type": "string", "format": "binary"}
        return {kind: {"schema": schema}}
    if route["answer"]:
        return {"application/json": {"schema": schemas.message(route["answer"]["type"])}}
    if not form:
        sys.exit("openapi.py: %s %s has no message and no form: add it to FORMS" % (route["method"], route["path"]))
    return {form[0]: {"schema": form[1]}} if form[0] else None


def operation(route, schemas):
    content = content_of(route, schemas)
    out = {"summary": route["summary"], "operationId": re.sub(r"\W+", "_", route["method"] + route["path"]).strip("_"),
           "x-role": route["role"]}
    if route["own"]:
        out["x-own-jobs-suffice"] = True
    if route["role"] == "none":
        out["security"] = []
    if parameters(route, schemas):
        out["parameters"] = parameters(route, schemas)
    body = body_of(route, schemas)
    if body:
        out["requestBody"] = body
    success = dict({"description": "Done."}, **({"content": content} if content else {}))
    out["responses"] = {"101": {"description": "The WebSocket is open."}} if route["open"] else {
        "201" if "%s %s" % (route["method"], route["path"]) in CREATES else "200": success}
    if route["method"] != "get" and (route["answer"] or {}).get("type", "").endswith("JobList"):
        out["responses"]["202"] = dict(success, description="Done, but not on the coordinator's disk yet (not_stored).")
    if (route["answer"] or {}).get("field") == "output_data":
        out["responses"]["304"] = {"description": "The file is the one of If-None-Match."}
    if route["method"] in ("delete", "put") and not route["answer"]:
        out["responses"]["204"] = {"description": "Done."}
    out["responses"]["default"] = {"$ref": "#/components/responses/Problem"}
    return out


def document(table, messages, enums):
    schemas, routes = Schemas(messages, enums, table["choices"]), table["routes"]
    for route in routes:
        if route["message"] and route["method"] not in ("get", "delete"):
            schemas.reach(route["message"]["type"], schemas.asked)
    paths = {}
    for route in routes:
        path = route["path"].replace("...}", "}")
        paths.setdefault(path, {})[route["method"]] = operation(route, schemas)
    problems = table["problems"]
    schemas.made["Integer64"] = {"description": "A whole number; above 2^53 as text of its digits.", "oneOf": [
        {"type": "integer"}, {"type": "string", "pattern": "^-?[0-9]{16,20}$"}]}
    schemas.made["Parameter"] = {"description": "An operator's; a word where it is a choice.",
                                 "oneOf": [{"type": "number"}, {"type": "string"}]}
    schemas.made["Real"] = {"description": "null: not known.", "oneOf": [
        {"type": "number"}, {"type": "null"}, {"type": "string", "enum": ["inf", "-inf"]}]}
    schemas.made["Bytes"] = {"description": "Two lower-case hexadecimal digits a byte.", "type": "string",
                             "pattern": "^([0-9a-f]{2})*$"}
    schemas.made["Problem"] = dict(obj("type title status code detail instance", status=WHOLE,
                                       code={"enum": [p["code"] for p in problems]}),
                                   description="; ".join("%(code)s (%(status)d): %(title)s" % p for p in problems))
    return {
        "openapi": "3.1.0",
        "info": {"title": "Azulejo", "version": "1",
                 "description": "The coordinator's API. docs/API.md introduces it."},
        "servers": [{"url": "http://127.0.0.1:7421"}],
        "security": [{"token": []}, {"cookie": []}],
        "paths": paths,
        "components": {
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"},
                                "cookie": {"type": "apiKey", "in": "cookie", "name": "azulejo_session_7421"}},
            "responses": {"Problem": {"description": "What went wrong, and what to do.", "content": {
                "application/problem+json": {"schema": ref("Problem")}}}},
            "schemas": dict(sorted(schemas.made.items())),
        },
    }


# ---- YAML ---------------------------------------------------------------------------------------------------------

def scalar(value):
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9 _/-]*", value) and \
            value.lower() not in ("true", "false", "null", "yes", "no", "on", "off", "y", "n"):
        return value
    return json.dumps(value, ensure_ascii=False)


def key(value):
    return value if re.fullmatch(r"[A-Za-z_][\w-]*", value) and scalar(value) == value else json.dumps(value)


def is_small(value):
    return not isinstance(value, (dict, list)) or not value or \
        (len(json.dumps(value)) < 100 and not any(isinstance(v, (dict, list)) and v for v in
                                                  (value.values() if isinstance(value, dict) else value)))


def flow(value):
    if isinstance(value, dict):
        return "{" + ", ".join("%s: %s" % (key(k), flow(v)) for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(flow(v) for v in value) + "]"
    return scalar(value)


def emit(value, indent, out):
    items = value.items() if isinstance(value, dict) else ((None, v) for v in value)
    for name, v in items:
        head = "  " * indent + ("- " if name is None else key(name) + ":")
        if is_small(v):
            out.append(head + ("" if name is None else " ") + flow(v))
        elif name is None:
            inner = []
            emit(v, indent + 1, inner)
            out.append(head + inner[0].lstrip())
            out.extend(inner[1:])
        else:
            out.append(head)
            emit(v, indent + 1, out)
    return out


if __name__ == "__main__":
    print("\n".join(emit(document(json.load(sys.stdin), *read_proto(sys.argv[1])), 0, [])))
