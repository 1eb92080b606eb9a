#!/usr/bin/env python3
"""Write docs/openapi.yaml, the description of the API: from the table of routes (coordinator/web/routes.c) and the
messages of protocol/azulejo.proto, whose JSON form is coordinator/web/json_wire.h's.

    scripts/openapi.py            write it
    scripts/openapi.py --check    fail if it is not what would be written
"""
import json
import os
import re
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
ROUTES = os.path.join(ROOT, "coordinator/web/routes.c")
PROBLEMS = os.path.join(ROOT, "coordinator/web/problem.h")
VERBS = os.path.join(ROOT, "common/schema/verbs.h")
PROTO = os.path.join(ROOT, "protocol/azulejo.proto")
OUT = os.path.join(ROOT, "docs/openapi.yaml")


# ---- the table of routes ----------------------------------------------------------------------------------------

def split_arguments(text):
    """Split at commas outside of brackets and strings."""
    parts, depth, start, quoted = [], 0, 0, False
    for at, c in enumerate(text):
        if c == '"' and text[at - 1] != "\\":
            quoted = not quoted
        elif quoted:
            continue
        elif c in "({[":
            depth += 1
        elif c in ")}]":
            depth -= 1
        elif c == "," and depth == 0:
            parts.append(text[start:at].strip())
            start = at + 1
    return [p for p in parts + [text[start:].strip()] if p]


def closing(text, at):
    """The place of the bracket that closes the one at `at`."""
    depth, quoted = 0, False
    while True:
        c = text[at]
        if c == '"' and text[at - 1] != "\\":
            quoted = not quoted
        elif not quoted:
            depth += (c in "({") - (c in ")}")
            if depth == 0:
                return at
        at += 1


def expand(text, macros):
    """The text with the macros' calls replaced, as the C preprocessor does."""
    pattern = re.compile(r"\b(%s)\(" % "|".join(macros))
    while True:
        call = pattern.search(text)
        if not call:
            return text
        names, body = macros[call.group(1)]
        end = closing(text, call.end() - 1)
        for name, value in zip(names, split_arguments(text[call.end():end])):
            body = re.sub(r"\b%s\b(?=(?:[^\"]*\"[^\"]*\")*[^\"]*$)" % name, lambda m: value, body)
        text = text[:call.start()] + body + text[end + 1:]


def text_of(literal):
    return "".join(re.findall(r'"((?:[^"\\]|\\.)*)"', literal)).replace('\\"', '"')


def read_verbs():
    """The arguments of each VERB of verbs.h, as text."""
    source = open(VERBS).read().replace("\\\n", " ")
    source = source[source.index("#define JOB_VERBS"):]
    return [source[m.end():closing(source, m.end() - 1)] for m in re.finditer(r"\bVERB\(", source[:source.index("\nenum")])]


def read_routes():
    source = open(ROUTES).read().replace("\\\n", " ")
    macros = {m[1]: ([a.strip() for a in m[2].split(",") if a.strip() != "..."], m[3])
              for m in re.finditer(r"^#define (\w+)\(([^)]*)\)(.*)$", source, re.M)}
    table = re.search(r"struct web_route routes\[\] = \{(.*?)\n\};", source, re.S)[1]
    table = re.sub(r"/\*.*?\*/", "", table, flags=re.S)
    table = table.replace("JOB_VERBS(VERB, VARIANT)", "".join("VERB(%s)" % row for row in read_verbs()))
    routes = []
    table = expand(table, {k: v for k, v in macros.items() if k != "BODY"}).replace("##", "")
    for row in split_arguments(re.sub(r"#(\w+)", r'"\1"', table)):
        cells = split_arguments(row.strip()[1:-1])
        named = dict((c.split("=", 1)[0].strip().lstrip("."), c.split("=", 1)[1].strip()) for c in cells[3:])
        body = lambda key: re.search(r"BODY\((\w+)\)", named[key])[1].lower() if key in named else None
        routes.append({
            "method": cells[0].replace("WEB_", "").lower(), "path": text_of(cells[1]),
            "role": cells[2].replace("WEB_ROLE_", "").lower(), "own": "own_jobs_suffice" in named,
            "message": body("message"), "answer": body("answer"), "run": "run" in named, "open": "open" in named,
            "streams": "streams_body" in named, "query": text_of(named.get("query", "")).split(),
            "fixed": [f.split("=")[0] for f in text_of(named.get("fixed", "")).split()],
            "summary": text_of(named["summary"])})
    return routes


def read_problems():
    """(HTTP status, code, title) of problem.h."""
    rows = re.findall(r'X\(\w+, "([a-z-]+)", (\d+), "([^"]*)"', open(PROBLEMS).read())
    return [(int(status), code, title) for code, status, title in rows]


# ---- the messages -----------------------------------------------------------------------------------------------

def read_proto():
    """{message: [(name, type, repeated, comment)]}, {enum: [words]}, {envelope's field: message}"""
    messages, enums, envelope, name, comments = {}, {}, {}, None, []
    source = open(PROTO).read()
    # One-line messages in lines of their own.
    source = re.sub(r"message (\w+) \{ ?(.*?) ?\}", lambda m: "message %s {\n  %s\n}" % (m[1], re.sub(r"; (?=\w)", ";\n  ", m[2])), source)
    for line in source.splitlines():
        begin = re.match(r"(message|enum) (\w+) \{", line)
        if begin:
            kind, name, comments = begin[1], begin[2], []
            (messages if kind == "message" else enums)[name] = []
            continue
        if re.match(r"\}", line):
            name, comments = None, []
            continue
        alone = re.match(r"\s+// ?(.*)", line)
        if alone:
            comments.append(alone[1])
            continue
        field = re.match(r"\s+(repeated )?(map<string, \w+>|\w+) (\w+) = (\d+);\s*(?://\s*(.*))?", line)
        if name and field and kind == "message":
            if name == "Envelope":
                envelope[field[3]] = field[2]
            messages[name].append((field[3], field[2], bool(field[1]), " ".join(comments + [field[5] or ""]).strip()))
        value = re.match(r"\s+(\w+) = (\d+);", line)
        if name and value and kind == "enum":
            enums[name].append(value[1])
        comments = []
    for enum, words in enums.items():
        prefix = os.path.commonprefix(words)
        prefix = prefix[:prefix.rfind("_") + 1]
        enums[enum] = [w[len(prefix):].lower() for w in words]
    return messages, enums, envelope


NUMBERS = {"uint32": (0, 2**32 - 1), "fixed32": (0, 2**32 - 1), "int32": (-2**31, 2**31 - 1), "sint32": (-2**31, 2**31 - 1)}


def ref(name):
    return {"$ref": "#/components/schemas/" + name}


class Schemas:
    def __init__(self):
        self.messages, self.enums, self.envelope = read_proto()
        self.made = {}
        self.asked = set()
        for name in ("Hello",):
            assert name in self.messages

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
            return {"type": "object", "additionalProperties": self.kind(kind[4:-1].split(", ")[1])}
        if kind in self.enums:
            return {"type": "string", "enum": self.enums[kind]}
        return self.message(kind)

    def property(self, kind, repeated, comment):
        schema = self.kind(kind)
        if repeated:
            schema = {"type": "array", "items": schema}
        return {"allOf": [schema], "description": comment} if comment and "$ref" in schema else \
            dict(schema, description=comment) if comment else schema

    def fields(self, name, without=()):
        return {field: self.property(kind, repeated, comment)
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
NAMES = "effects stages aovs isas samplers light_choices texture_filters bvh_qualities"
SESSION = obj("role who", "token software farm name address port login_required", role={
    "enum": ["none", "view", "submit", "operate", "admin"]}, token=WHOLE)
SESSION["additionalProperties"] = True
# Method and path: what is answered (content type, schema), and the body that is taken.
FORMS = {
    "get /": ("text/html", TEXT), "get /assets/{file}": ("*/*", {}), "get /docs/errors": ("text/plain", TEXT),
    "get /healthz": ("text/plain", TEXT), "get /readyz": ("text/plain", TEXT), "get /metrics": ("text/plain", TEXT),
    "get /api/v1/openapi.yaml": ("application/yaml", TEXT),
    "post /api/v1/session": ("application/json", SESSION, obj("token")),
    "get /api/v1/session": ("application/json", SESSION),
    "delete /api/v1/session": ("application/json", {}),
    "get /api/v1/farm": ("application/json", obj(
        "software address protocol_version begun_at now ending states workers workers_working threads samples_per_second "
        "conflicts store_usable store_why", protocol_version=WHOLE, begun_at=WHOLE, now=WHOLE, ending=BOOL,
        states={"type": "object", "additionalProperties": WHOLE}, workers=WHOLE, workers_working=WHOLE, threads=WHOLE,
        samples_per_second=REAL, conflicts=WHOLE, store_usable=BOOL)),
    "get /api/v1/operators": ("application/json", obj(
        "operators metering exposure_max kelvin_min kelvin_max temporal_max", operators=array(OPERATOR),
        metering=array(TEXT), exposure_max=WHOLE, kelvin_min=WHOLE, kelvin_max=WHOLE, temporal_max=WHOLE)),
    "get /api/v1/effects": ("application/json", obj("switchable health " + NAMES, switchable=BIG, health=array(HEALTH),
                                                    **{n: array(TEXT) for n in NAMES.split()})),
    "get /api/v1/verbs": ("application/json", obj("verbs", verbs=array(VERB))),
    "put /api/v1/blobs/{digest}": ("application/json", obj("digest bytes", digest=ref("Bytes"), bytes=BIG)),
    "get /api/v1/events": ("text/event-stream", TEXT), "get /api/v1/live": (None, {}),
    "post /api/v1/imports": ("application/json", obj("import", **{"import": BIG})),
    "put /api/v1/imports/{import}/files/{path...}": ("application/json", obj("path bytes", bytes=BIG)),
    "post /api/v1/imports/{import}": ("application/json", obj("job", job=BIG), obj("scene", "options", options=array(TEXT))),
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
           "no_dither": {"enum": ["0", "1"]}, "after": TEXT}


# ---- the document -------------------------------------------------------------------------------------------------

def parameters(route, schemas):
    fields = {f: (kind, comment) for f, kind, _, comment in
              schemas.messages.get(schemas.envelope.get(route["message"]), [])}
    out = []
    for name in re.findall(r"\{([\w.]+)\}", route["path"]):
        schema = schemas.kind(fields[name][0]) if name in fields else TEXT
        out.append({"name": name.rstrip("."), "in": "path", "required": True, "schema": schema})
    for name in route["query"]:
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
    taken = set(re.findall(r"\{([\w.]+)\}", route["path"])) | set(route["fixed"])
    fields = schemas.fields(schemas.envelope[route["message"]], taken)
    if not fields:
        return {"required": False, "content": {"application/json": {"schema": obj()}}}
    return {"required": False, "content": {"application/json": {"schema": {
        "type": "object", "additionalProperties": False, "properties": fields}}}}


def content_of(route, schemas):
    form = FORMS.get("%s %s" % (route["method"], route["path"]))
    if route["answer"] == "output_data":
        kind = FILES[route["path"].rsplit("/", 1)[1]]
        schema = {} if kind == "application/json" else {"type": "string", "format": "binary"}
        return {kind: {"schema": schema}}
    if route["answer"]:
        return {"application/json": {"schema": schemas.message(schemas.envelope[route["answer"]])}}
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
    if route["answer"] == "output_data":
        out["responses"]["304"] = {"description": "The file is the one of If-None-Match."}
    if route["method"] in ("delete", "put") and not route["answer"]:
        out["responses"]["204"] = {"description": "Done."}
    out["responses"]["default"] = {"$ref": "#/components/responses/Problem"}
    return out


def document():
    schemas = Schemas()
    routes = read_routes()
    for route in routes:
        if route["message"] and route["method"] not in ("get", "delete"):
            schemas.reach(schemas.envelope[route["message"]], schemas.asked)
    paths = {}
    for route in routes:
        path = route["path"].replace("...}", "}")
        paths.setdefault(path, {})[route["method"]] = operation(route, schemas)
    problems = read_problems()
    schemas.made["Integer64"] = {"description": "A whole number; above 2^53 as text of its digits.", "oneOf": [
        {"type": "integer"}, {"type": "string", "pattern": "^-?[0-9]{16,20}$"}]}
    schemas.made["Real"] = {"description": "null: not known.", "oneOf": [
        {"type": "number"}, {"type": "null"}, {"type": "string", "enum": ["inf", "-inf"]}]}
    schemas.made["Bytes"] = {"description": "Two lower-case hexadecimal digits a byte.", "type": "string",
                             "pattern": "^([0-9a-f]{2})*$"}
    schemas.made["Problem"] = dict(obj("type title status code detail instance", status=WHOLE,
                                       code={"enum": [code for _, code, _ in problems]}),
                                   description="; ".join("%s (%d): %s" % (c, s, t) for s, c, t in problems))
    return {
        "openapi": "3.1.0",
        "info": {"title": "Azulejo", "version": "1",
                 "description": "The coordinator's API. docs/API.md introduces it. Made by scripts/openapi.py: do not edit."},
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


def main():
    text = "\n".join(emit(document(), 0, [])) + "\n"
    if "--check" in sys.argv[1:]:
        if not os.path.exists(OUT) or open(OUT).read() != text:
            sys.exit("docs/openapi.yaml is not current: run scripts/openapi.py")
        return
    with open(OUT, "w") as file:
        file.write(text)


if __name__ == "__main__":
    main()
