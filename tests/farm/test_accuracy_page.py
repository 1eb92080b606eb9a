"""What accuracy costs, from a file to a page: sentences, markup, plots, and studies that hold little."""
import csv
import html.parser
import io
import json
import math
import os
import re
import struct
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import study_maker
from farm import Farm, Failure, ROOT, Tests, read_bytes

tests = Tests()
SAMPLE = os.path.join(ROOT, "tests", "support", "study.json")
VOID = {"meta", "img", "br", "hr", "link", "input"}
NASTY = "<b>&\"x'</b>\u2028 \U0001f525 ]]>--"


def expect(condition, words):
    if not condition:
        raise Failure(str(words))


class Page(html.parser.HTMLParser):
    """Checks that elements nest, and collects texts, attributes and the texts of plots."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.texts, self.tags, self.plots = [], [], [], []
        self.feed(text)
        self.close()
        expect(not self.open, "still open at the end: %s" % self.open)

    def handle_starttag(self, tag, attributes):
        names = [name for name, _ in attributes]
        expect(len(names) == len(set(names)), "an attribute twice: %s" % attributes)
        self.tags.append((tag, dict(attributes)))
        if tag == "svg" and "svg" not in self.open:
            self.plots.append({"box": dict(attributes)["viewbox"], "texts": []})
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        expect(self.open and self.open[-1] == tag, "</%s> closes %s" % (tag, self.open[-3:]))
        self.open.pop()

    def handle_data(self, data):
        self.texts.append(data)
        if self.open and self.open[-1] == "text":
            self.plots[-1]["texts"].append((self.tags[-1][1], data))

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())

    def first(self, tag):
        """The text that follows the first such element's start."""
        return self.body.split("<%s>" % tag, 1)[1].split("</%s>" % tag, 1)[0]


def draw(farm, study, name="page", expect_code=0, **how):
    """Write the study, draw its page and take it apart."""
    with open(farm.path(name + "-in.json"), "w") as out:
        json.dump(study, out)
    result = farm.cli("accuracy", "--from", farm.path(name + "-in.json"), "-o",
                      farm.path(name + ".html"), expect=expect_code, connect=False, **how)
    body = read_bytes(farm.path(name + ".html")).decode("utf-8")
    page = Page(body)
    page.body, page.result = body, result
    return page


def text_boxes(plot):
    """About where the texts of a plot are: (x0, y0, x1, y1, text); turned ones are left out."""
    out = []
    for attributes, text in plot["texts"]:
        if "transform" in attributes:
            continue
        size = 11 if re.search("name|title|faintword", attributes.get("class", "")) else 12
        width = 0.52 * size * len(text)
        x, y = float(attributes["x"]), float(attributes["y"])
        x -= width * {None: 0, "middle": 0.5, "end": 1}[attributes.get("text-anchor")]
        out.append((x, y - 0.7 * size, x + width, y + 0.1 * size, text))
    return out


def check_plots(page):
    for plot in page.plots:
        _, _, width, height = map(float, plot["box"].split())
        boxes = text_boxes(plot)
        for i, a in enumerate(boxes):
            expect(a[0] > -3 and a[2] < width + 3 and a[1] > -3 and a[3] < height + 3,
                   "outside of its plot: %s" % (a,))
            for b in boxes[:i]:
                expect(a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1],
                       "on each other: %s %s" % (a, b))


def check_self_contained(page):
    expect(page.body.startswith("<!DOCTYPE html>\n<html lang=\"en\">"), page.body[:60])
    for tag, attributes in page.tags:
        expect(tag not in ("script", "link", "iframe", "object"), tag)
        for name, value in attributes.items():
            expect(not name.startswith("on"), name)
            if name in ("src", "href"):
                expect(value.startswith("data:image/png;base64,"), value[:60])
        if tag == "img":
            expect(attributes.get("alt"), attributes)
    rest = re.sub("base64,[A-Za-z0-9+/=]*", "", page.body.replace("http://www.w3.org/2000/svg", ""))
    for word in ("http:", "https:", "url(", "@import", "NaN", "nan\"", "inf\"", "(null)"):
        expect(word not in rest, word)
    expect(all("aria-label" in a for t, a in page.tags if t == "svg" and a.get("role")), "aria-label")


@tests.add
def test_sample():
    """the kept sample is what its generator makes"""
    with open(SAMPLE) as source:
        kept = json.load(source)

    def same(a, b, where):
        if isinstance(b, dict):
            expect(list(a) == list(b), where)
            for key in b:
                if key != "picture":  # a deflate stream depends on the library's release
                    same(a[key], b[key], where + "." + key)
        elif isinstance(b, list):
            expect(len(a) == len(b), where)
            for i, (x, y) in enumerate(zip(a, b)):
                same(x, y, "%s[%d]" % (where, i))
        elif isinstance(b, float):
            expect(math.isclose(a, b, rel_tol=1e-4), where)
        else:
            expect(a == b, where)
    same(kept, json.loads(json.dumps(study_maker.study())), "")


@tests.add
def test_page():
    """the sample's page: true numbers, whole markup, nothing from elsewhere, no label on another"""
    with Farm() as farm:
        study = study_maker.study(target_core_s=[None] * 3)
        page = draw(farm, study)
        check_self_contained(page)
        check_plots(page)
        fit = study["fit"]
        cost = fit["pivot_core_s"] * (fit["codes_at_pivot"][0] / 3) ** (1 / fit["exponent"][0])
        headline = re.search(r"3/255 costs (\S+) core-minutes; every halving of the error costs (\S+) "
                             "times as much", page.first("h1"))
        expect(headline, page.first("h1"))
        expect(abs(float(headline.group(1)) - cost / 60) <= 0.5, (headline.groups(), cost))
        expect(abs(float(headline.group(2)) - 2 ** (1 / fit["exponent"][0])) <= 0.05, headline.groups())
        for words in (
                "Environment sampled uniformly (the report's way): 31 times the time to 3/255 (29 to 33)",
                "At most 4 bounces: 1.6 times less time to 3/255 (1.5 to 1.7), never better than "
                "2.4/255 (2.3 to 2.5); too dark in the corner.",
                "2.1 times less time to 10/255 (2.0 to 2.2), never better than 5.0/255 (4.8 to 5.3)",
                "16-bit EXR: no clear difference in time", "half the bytes.",
                "the same picture to 0.1/255", "The error is reliable: the samples agree on it",
                "could be left out at this accuracy"):
            expect(words in page.text, words)
        titles = re.findall("<article><h3>(.*?)</h3>", page.body)
        expect(titles[:2] == ["Path depth", "Environment sampling"], titles)
        expect("Numbers in files" not in titles, "what has no effect has a plot")
        expect(len([t for t, _ in page.tags if t == "img"]) == 2 * 3 + 2, "crops and maps")


@tests.add
def test_files():
    """the files beside the page: CSV, JSON, plots; the same bytes every time"""
    with Farm() as farm:
        study = study_maker.study()
        draw(farm, study, "one")
        draw(farm, study, "two")
        draw(farm, json.loads(read_bytes(farm.path("one.json"))), "three")
        ends = [".html", ".csv", ".json"] + [
            "-%s.%s" % (n, e) for n in ("plot", "choices", "effects") for e in ("svg", "png")]
        for end in ends:
            data = read_bytes(farm.path("one" + end))
            expect(data == read_bytes(farm.path("two" + end)), end)
            expect(data == read_bytes(farm.path("three" + end)), "drawn from its own JSON: " + end)
            if end.endswith("svg"):
                Page(data.decode())
                expect(b"var(" not in data and b"$" not in data, "unresolved colours")
                size = re.search(rb'width="(\d+)" height="(\d+)"', data)
                png = read_bytes(farm.path("one" + end[:-3] + "png"))
                expect(struct.unpack(">II", png[16:24]) == tuple(2 * int(s) for s in size.groups()),
                       "the PNG's size")
        rows = list(csv.DictReader(io.StringIO(read_bytes(farm.path("one.csv")).decode())))
        points = len(study["points"]) + sum(
            len(c["points"]) for q in study["questions"] for c in q["choices"])
        expect(len(rows) == points, len(rows))
        expect([float(r["codes"]) for r in rows[:6]] == [p["codes"][0] for p in study["points"]], rows)


@tests.add
def test_reference():
    """errors against a reference have two plots, columns and a figure of their own; without one there is none of it"""
    with Farm() as farm:
        study = study_maker.study(reference=NASTY)
        for i, p in enumerate(study["points"]):
            p.update(relmse=[0.1 / 4 ** i, 0.09 / 4 ** i, 0.11 / 4 ** i], flip=[0.2 / 2 ** i, 0.19 / 2 ** i, 0.21 / 2 ** i],
                     seeds=[p["codes"][0], p["codes"][1], p["codes"][2]])
        page = draw(farm, study)
        check_self_contained(page)
        check_plots(page)
        expect("Against the reference " + " ".join(NASTY.split()) in page.text, page.text[-3000:])
        expect("FLIP (seeds)" in page.text and "by each seed's samples" in page.text, "the table")
        Page(read_bytes(farm.path("page-reference.svg")).decode())
        rows = list(csv.DictReader(io.StringIO(read_bytes(farm.path("page.csv")).decode())))
        expect(float(rows[1]["flip"]) == 0.1 and float(rows[0]["relmse_high"]) == 0.11, rows[0])
        expect(float(rows[0]["seeds_low"]) == study["points"][0]["codes"][1], rows[0])
        page = draw(farm, study_maker.study(), "without")
        expect("Against the reference" not in page.text and "FLIP" not in page.text, "no reference")
        expect(not os.path.exists(farm.path("without-reference.svg")), "no reference's figure")


@tests.add
def test_by_target():
    """where adaptive sampling surely differs, its cost is the headline's, and has a mark of its own in the plot"""
    with Farm() as farm:
        study = study_maker.study()
        choice = study["questions"][1]["choices"][1]
        choice.update(by_target=True, unbiased=True, gain=study_maker.interval(1.6, 0.05), floor=[0, 0, 0])
        page = draw(farm, study)
        check_plots(page)
        expect("3/255 costs 7.0 core-minutes with adaptive sampling, as --target-error renders (11 core-minutes with the "
               "same samples everywhere)" in page.first("h1"), page.first("h1"))
        expect(any(text == "adaptive: 7.0 core-minutes" for _, text in page.plots[0]["texts"]), page.plots[0]["texts"])


@tests.add
def test_escaping():
    """names with markup, quotes and emoji show as they are, and change nothing else"""
    with Farm() as farm:
        study = study_maker.study(scene=NASTY, machine=NASTY, command=NASTY, date=NASTY, version=NASTY,
                                  transform=NASTY, currency=NASTY, deadline=NASTY)
        study["points"][-1].update(reliable=False, reason=NASTY)
        study["questions"][3]["title"] = NASTY
        for c in study["questions"][3]["choices"]:
            c.update(name=NASTY, words=NASTY, note=NASTY)
        study["effects"][0]["name"] = study["workers"][0]["name"] = NASTY
        study["regions"][0]["label"] = NASTY
        page = draw(farm, study)
        check_self_contained(page)
        check_plots(page)
        shown = " ".join(NASTY.split())
        expect(page.text.count(shown) >= 12, page.text.count(shown))
        expect(not any(t == "b" and "class" in a for t, a in page.tags), "markup from a name")
        expect("<b>&" not in page.body, "unescaped")
        for name in ("plot", "choices", "effects"):
            Page(read_bytes(farm.path("page-%s.svg" % name)).decode())
        rows = list(csv.DictReader(io.StringIO(read_bytes(farm.path("page.csv")).decode())))
        expect(any(r["choice"] == NASTY for r in rows), "CSV")


@tests.add
def test_little():
    """studies with nothing, one point, unknown numbers and a doubtful error have a page that says so"""
    with Farm() as farm:
        nothing = dict(azulejo_study=1)
        page = draw(farm, nothing)
        check_self_contained(page)
        expect("Nothing has been measured yet." in page.text, page.text)
        expect("not complete" in page.text, page.text)
        law = study_maker.Law(94, 0.53)
        page = draw(farm, dict(azulejo_study=1, target_codes=3, complete=True, points=law.points([5])))
        check_self_contained(page)
        check_plots(page)
        expect("What a smaller error costs needs more points." in page.first("h1"), page.first("h1"))
        hollow = json.loads(json.dumps(study_maker.study()), parse_float=lambda text: None)
        for part in ("tile_error", "tile_samples"):
            hollow[part] = {"columns": 0, "rows": 0, "values": []}
        check_self_contained(draw(farm, hollow))
        broken = study_maker.study()
        for p in broken["points"] + broken["questions"][0]["choices"][1]["points"]:
            p.update(codes=[None] * 3, psnr_db=-1e300, core_s=0)
        check_self_contained(draw(farm, broken))
        huge = study_maker.study(target_codes=1e-9, target_core_s=[1e300, 1e299, 1e301])
        huge["fit"] = {"exponent": [1e-5, 1e-6, 1], "pivot_core_s": 1e-300,
                       "codes_at_pivot": [1e200, 1e-200, 1e300]}
        check_self_contained(draw(farm, huge))
        doubtful = study_maker.study()
        doubtful["points"][-1].update(reliable=False, reason='83 % of the squared error is in 0.1 % of '
                                      'the pixels; likely cause: caustics')
        page = draw(farm, doubtful)
        expect("The error may be understated: 83 % of the squared error is in 0.1 % of the pixels; "
               "likely cause: caustics."
               in page.text, page.text)
        expect("3/255 costs at least" in page.first("h1"), page.first("h1"))


@tests.add
def test_terminal():
    """the terminal gets ten lines and the page's name"""
    with Farm() as farm:
        page = draw(farm, study_maker.study())
        lines = page.result.out.rstrip("\n").split("\n")
        expect(len(lines) == 11 and lines[-1].endswith("page.html"), lines)
        expect(lines[0].startswith("3/255 costs 11 core-minutes"), lines[0])
        expect([l.split()[0] for l in lines[2:7]] == ["%d/255" % n for n in (50, 20, 5, 2, 1)], lines)
        expect("WORKERS FOR 18:00" in lines[1] and "COST" in lines[1], lines[1])
        expect(lines[6].split()[-1] == "4", "1/255 in half an hour: %s" % lines[6])
        page = draw(farm, study_maker.study(scene="x\x1b[31m", price_core_hour=None, deadline_s=None))
        expect("\x1b" not in page.result.out and "COST" not in page.result.out, page.result.out)


@tests.add
def test_errors():
    """what is wrong is named, with what to do"""
    with Farm() as farm:
        def fails(code, words, *args, **how):
            result = farm.cli("accuracy", *args, expect=code, connect=False, **how)
            expect(words in result.err, result)
        fails(2, "a scene, or --from FILE.json, is missing")
        fails(2, "must end in .html", "--from", SAMPLE, "-o", farm.path("a.png"))
        fails(2, "leave out --from", "--from", SAMPLE, "--reference", "x.exr")
        fails(3, "nowhere.exr", os.path.join(ROOT, "scenes", "features", "metal.gltf"), "--reference", "nowhere.exr")
        fails(3, "nowhere.json", "--from", farm.path("nowhere.json"))
        with open(farm.path("bad.json"), "w") as out:
            json.dump({"azulejo_study": 1, "points": [{"codes": 3}]}, out)
        fails(3, "points[0].codes", "--from", farm.path("bad.json"))
        expect(not os.path.exists(farm.path("bad.html")), "a page of a damaged study")
        fails(9, "librsvg2-bin", "--from", SAMPLE, "-o", farm.path("a.html"), env={"PATH": "/nowhere"})
        expect(os.path.exists(farm.path("a-plot.svg")) and not os.path.exists(farm.path("a-plot.png")),
               "the plots that can be made")
        farm.cli("accuracy", "--from", SAMPLE, "-o", farm.path("b.html"), "--page-only", "-q", expect=0,
                 connect=False, env={"PATH": "/nowhere"})
        expect([f for f in os.listdir(farm.folder) if f.startswith("b.")] == ["b.html"], "--page-only")


if __name__ == "__main__":
    tests.run()
