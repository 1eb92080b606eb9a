"""A strict parser of Prometheus' text format 0.0.4
(https://prometheus.io/docs/instrumenting/exposition_formats/): what a lenient one would forgive is a Failure."""
import re

from farm import Failure

NAME = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
LABEL = re.compile(r"[a-zA-Z_][a-zA-Z0-9_]*")
NUMBER = re.compile(r"(NaN|[+-]Inf|[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?)")


class Metrics:
    """`types`: name -> type; `values`: (name, ((label, text), ...)) -> number."""

    def __init__(self, text):
        self.types, self.helps, self.values = {}, {}, {}
        self.line, self.family, self.closed = "", None, set()
        if not text.endswith("\n"):
            raise Failure("the last line has no end")
        for self.line in text[:-1].split("\n"):
            if self.line.startswith("# "):
                self._comment()
            else:
                self._sample()
        for name in self.types:
            if self.types[name] == "histogram":
                self._check_histogram(name)

    def _wrong(self, what):
        raise Failure("%s: '%s'" % (what, self.line))

    def _comment(self):
        words = self.line.split(" ", 3)
        if len(words) < 4 or words[1] not in ("HELP", "TYPE") or not NAME.fullmatch(words[2]):
            self._wrong("neither HELP nor TYPE")
        name = words[2]
        if words[1] == "HELP":
            if name in self.helps or name in self.types:
                self._wrong("a second HELP, or one behind TYPE")
            if re.search(r"\\(?![\\n])", words[3]) or not words[3].strip():
                self._wrong("help")
            self.helps[name] = words[3]
            return
        if name in self.types or name not in self.helps or words[3] not in ("counter", "gauge", "histogram"):
            self._wrong("a second TYPE, one without HELP, or an unknown one")
        if words[3] == "counter" and not name.endswith("_total"):
            self._wrong("a counter whose name does not end in _total")
        self.types[name] = words[3]
        if self.family:
            self.closed.add(self.family)
        self.family = name

    def _labels(self, text):
        labels, at = [], 0
        while True:
            found = LABEL.match(text, at)
            if not found or not text.startswith('="', found.end()):
                self._wrong("a label's name")
            name, at, value = found.group(), found.end() + 2, ""
            while at < len(text) and text[at] != '"':
                if text[at] == "\\":
                    if text[at + 1:at + 2] not in ("\\", '"', "n"):
                        self._wrong("an unknown escape")
                    value += {"n": "\n"}.get(text[at + 1], text[at + 1])
                    at += 2
                else:
                    value += text[at]
                    at += 1
            if at >= len(text):
                self._wrong("a label's value has no end")
            if name == "quantile":
                self._wrong("a label that only summaries have (promtool check metrics)")
            if name in [n for n, _ in labels]:
                self._wrong("a label twice")
            labels.append((name, value))
            at += 1
            if text[at:at + 1] == ",":
                at += 1
            elif text[at:at + 1] == "}":
                return tuple(labels), text[at + 1:]
            else:
                self._wrong("labels have no end")

    def _sample(self):
        found = NAME.match(self.line)
        if not found:
            self._wrong("no name")
        name, rest, labels = found.group(), self.line[found.end():], ()
        if rest.startswith("{"):
            labels, rest = self._labels(rest[1:])
        number = NUMBER.fullmatch(rest[1:])
        if not rest.startswith(" ") or not number:
            self._wrong("no number")
        family = name
        for end in ("_bucket", "_sum", "_count"):
            if name.endswith(end) and self.types.get(name[:-len(end)]) == "histogram":
                family = name[:-len(end)]
        if family != self.family:
            self._wrong("a sample outside of its family" if family in self.closed else "a sample without TYPE")
        if (name, labels) in self.values:
            self._wrong("a sample twice")
        self.values[name, labels] = float(number.group().replace("Inf", "inf"))

    def _check_histogram(self, name):
        bounds = [(float(dict(labels)["le"].replace("Inf", "inf")), value)
                  for (sample, labels), value in self.values.items() if sample == name + "_bucket"]
        counts = [value for _, value in bounds]
        if [b for b, _ in bounds] != sorted(b for b, _ in bounds) or counts != sorted(counts) or \
                bounds[-1] != (float("inf"), self.values[name + "_count", ()]) or (name + "_sum", ()) not in self.values:
            raise Failure("the histogram %s is not cumulative, or has no end" % name)

    def get(self, name, **labels):
        return self.values[name, tuple(labels.items())]

    def of(self, name):
        """labels -> value of one metric."""
        return {labels: value for (sample, labels), value in self.values.items() if sample == name}

    def counters(self):
        """All values that may only grow."""
        return {key: value for key, value in self.values.items()
                if self.types.get(key[0]) == "counter" or
                any(key[0] == n + e for n, t in self.types.items() if t == "histogram" for e in ("_bucket", "_sum", "_count"))}
