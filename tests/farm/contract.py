"""The API's description, and requests whose answers are checked against it."""
import json
import re
import urllib.parse

from farm import Skip
from jobs import expect

try:
    import jsonschema
    import yaml
except ImportError:
    jsonschema = yaml = None


class Contract:
    """ask() a path template of openapi.yaml; every answer must have the form that it promises."""

    def __init__(self, page):
        if not yaml:
            raise Skip("python3-yaml and python3-jsonschema are needed")
        self.page, self.called = page, set()
        answer = page.get("/api/v1/openapi.yaml")
        expect(answer.status == 200, answer)
        self.document = yaml.safe_load(answer.body)
        self.operations = {(method, path): what for path, methods in self.document["paths"].items()
                           for method, what in methods.items()}
        self.checkers = {}

    def check(self, key, schema, value):
        if key not in self.checkers:
            # References lead into the document.
            whole = dict(schema, components=self.document["components"])
            self.checkers[key] = jsonschema.Draft202012Validator(whole)
        faults = sorted(self.checkers[key].iter_errors(value), key=lambda e: len(e.path))
        expect(not faults, "%s: %s at %s" % (key, faults and faults[0].message[:300], faults and list(faults[0].path)))

    def check_answer(self, method, template, answer):
        what = self.operations[method, template]
        if answer.status >= 400:
            expect(answer.headers["content-type"] == "application/problem+json", answer)
            problem = answer.json()
            self.check("problem", {"$ref": "#/components/schemas/Problem"}, problem)
            expect(problem["status"] == answer.status and problem["detail"], answer)
            return
        expect(str(answer.status) in what["responses"], "%s %s: %s" % (method, template, answer))
        content = what["responses"][str(answer.status)].get("content", {})
        if answer.status in (204, 304) or not content:
            return
        kind = answer.headers["content-type"].split(";")[0]
        expect(kind in content or "*/*" in content, "%s %s: %s" % (method, template, answer))
        if kind == "application/json":
            self.check((method, template), content[kind]["schema"], answer.json())

    def ask(self, method, template, body=None, query=None, token=None, headers=None, **values):
        """The checked answer. `values` fill the template."""
        path = re.sub(r"\{(\w+)\}", lambda m: urllib.parse.quote(str(values[m[1]]), safe="/" if m[1] == "path" else ""),
                      template)
        if query:
            path += "?" + urllib.parse.urlencode(query)
        if body is None and method in ("post", "put"):
            body = b""
        answer = self.page.request(method.upper(), path, body=body, token=token, headers=headers, limit_s=60)
        self.called.add((method, template))
        self.check_answer(method, template, answer)
        return answer

    def does(self, status, method, template, *args, **how):
        answer = self.ask(method, template, *args, **how)
        expect(answer.status == status, "%s %s: %d was expected: %s" % (method, template, status, answer))
        return answer
