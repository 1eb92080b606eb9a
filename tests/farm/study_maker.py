"""Studies of scenes that do not exist: power laws with noise, biases, pictures with grain.

Run as a program, it writes the sample that the tests keep: study_maker.py > tests/support/study.json
Everything follows from fixed seeds, so the same file comes out everywhere.
"""
import base64
import json
import math
import random
import struct
import sys
import zlib


def png(width, height, rgb):
    """An 8-bit RGB picture as a PNG file."""
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    rows = b"".join(b"\0" + rgb[3 * width * y:3 * width * (y + 1)] for y in range(height))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def interval(value, spread):
    """A figure with an interval that is symmetric on a logarithmic scale."""
    return [rounded(value), rounded(value / (1 + spread)), rounded(value * (1 + spread))]


def rounded(value):
    return float("%.6g" % value)


def crop(codes, kind, side=72):
    """A ball on a floor (or bright light through glass, "worst") with grain of so many codes."""
    noise = random.Random("%s %g" % (kind, codes))
    out = bytearray()
    for y in range(side):
        for x in range(side):
            u, v = (x - 35.5) / 26, (y - 31.5) / 26
            r2 = u * u + v * v
            if r2 < 1:
                n = max(0.0, (-0.5 * u - 0.62 * v + 0.6 * math.sqrt(1 - r2)))
                base = [0.10 + 0.62 * n, 0.14 + 0.44 * n, 0.16 + 0.36 * n]
                shine = max(0.0, 1 - ((u + 0.35) ** 2 + (v + 0.45) ** 2) * 14)
                base = [b + 0.4 * shine ** 2 for b in base]
            else:
                shadow = math.exp(-((u - 0.35) ** 2 + ((v - 1.05) * 2.2) ** 2) * 1.6)
                floor = 0.60 - 0.08 * v
                base = [floor * (1 - 0.7 * shadow) * tint for tint in (1.0, 0.96, 0.90)]
            if kind == "worst":
                glow = math.exp(-(((u - 0.5 * math.sin(2.2 * v)) * 5) ** 2))
                base = [0.5 * b + 0.5 * glow * tint for b, tint in zip(base, (1, 0.85, 0.55))]
            if kind == "worst" and noise.random() < min(0.2, codes / 255):
                base = [b + noise.random() * 0.6 for b in base]
            for b in base:
                out.append(min(255, max(0, round(255 * min(1, b) + noise.gauss(0, codes / 1.96)))))
    return base64.b64encode(png(side, side, bytes(out))).decode()


class Law:
    """error^2 = (codes at 1 core second * t^-exponent)^2 + bias^2, measured with noise."""

    def __init__(self, codes_at_1, exponent, bias=0.0, cores=2.0, seed="law", spread=0.05):
        self.codes_at_1, self.exponent, self.bias = codes_at_1, exponent, bias
        self.cores, self.noise, self.spread = cores, random.Random(seed), spread

    def codes(self, core_s):
        grain = self.codes_at_1 * core_s ** -self.exponent
        return math.hypot(200 * math.tanh(grain / 200), self.bias)  # codes end at 255

    def point(self, core_s, **more):
        codes = self.codes(core_s) * math.exp(self.noise.gauss(0, self.spread / 2))
        out = {"core_s": rounded(core_s), "wall_s": rounded(core_s / self.cores / 0.97),
               "samples": rounded(max(4, 2.9 * core_s)), "rays": float(round(4.1e6 * core_s)),
               "codes": interval(codes, self.spread),
               "psnr_db": rounded(20 * math.log10(255 / codes) + 4.3),
               "rmse": interval(codes / 255 * 1.4, 1.4 * self.spread), "reliable": True,
               "top_share": 0.04, "reason": None}
        out.update(more)
        return out

    def points(self, costs, **more):
        return [self.point(c, **more) for c in costs]


def fit(points):
    """A straight line through the logarithms, with intervals; None for fewer than two points."""
    if len(points) < 2:
        return {"exponent": [None] * 3, "pivot_core_s": None, "codes_at_pivot": [None] * 3}
    x = [math.log(p["core_s"]) for p in points]
    y = [math.log(p["codes"][0]) for p in points]
    mx, my = sum(x) / len(x), sum(y) / len(y)
    sxx = sum((a - mx) ** 2 for a in x)
    slope = sum((a - mx) * (b - my) for a, b in zip(x, y)) / sxx
    left = sum((b - my - slope * (a - mx)) ** 2 for a, b in zip(x, y))
    sigma = math.sqrt(left / max(1, len(x) - 2)) + 0.01
    half = 2.2 * sigma / math.sqrt(sxx)
    return {"exponent": [rounded(-slope), rounded(-slope - half), rounded(-slope + half)],
            "pivot_core_s": rounded(math.exp(mx)),
            "codes_at_pivot": interval(math.exp(my), 2.2 * sigma / math.sqrt(len(x)))}


def choice(name, words, law, costs, gain, at, floor, note=None, baseline=False):
    return {"name": name, "words": words, "note": note, "baseline": baseline, "unbiased": False, "missed": False,
            "points": law.points(costs) if law else [], "gain_at": at,
            "gain": interval(gain, 0.07) if gain else [None] * 3, "floor": floor}


NONE = [0.01, 0.0, 0.03]  # a bias that is not there


def slower(factor, seed, bias=0.0):
    return Law(94 * factor ** 0.53, 0.53, bias, seed=seed)


COSTS = [1.4, 5.5, 21.0, 84.0, 340.0, 1400.0]
FEWER = [1.4, 7.0, 35.0, 170.0, 820.0]


def questions():
    usual = choice("usual", "As usual", None, [], None, None, [None] * 3, baseline=True)

    def ask(title, usual_name, *choices):
        return {"title": title, "choices": [dict(usual, name=usual_name)] + list(choices)}

    return [
        ask("Numbers in files", "float",
            choice("half", "16-bit EXR", slower(1, "half"), FEWER, 1.0, 3.0, [0.05, 0.0, 0.1],
                   "half the bytes")),
        ask("Sampler", "Sobol",
            choice("independent", "Independent random numbers instead of Sobol's", slower(1.7, "ind"),
                   FEWER, 1 / 1.7, 3.0, NONE)),
        ask("Path depth", "16 bounces",
            choice("8 bounces", "At most 8 bounces", slower(0.86, "8", 0.4), FEWER, 1.16, 3.0,
                   interval(0.42, 0.2)),
            choice("4 bounces", "At most 4 bounces", slower(0.62, "4", 2.4), FEWER, 1.6, 3.0,
                   interval(2.4, 0.06), "too dark in the corner"),
            choice("2 bounces", "At most 2 bounces", slower(0.4, "2", 9.0), FEWER, 2.6, 12.0,
                   interval(9.1, 0.04), "the glass is black")),
        ask("Environment sampling", "MIS",
            choice("uniform", "Environment sampled uniformly (the report's way)",
                   slower(31, "uniform"), FEWER, 1 / 31, 3.0, NONE),
            choice("BSDF only", "Environment found by the BSDF only", slower(9, "bsdf"), FEWER, 1 / 9,
                   3.0, NONE),
            choice("importance", "Environment by its own importance only", slower(1.3, "importance"),
                   FEWER, 1 / 1.3, 3.0, NONE)),
        ask("Fireflies", "kept",
            choice("clamped", "Fireflies clamped at 10 times the mean", slower(0.47, "clamp", 5.0),
                   FEWER, 2.1, 10.0, interval(5.0, 0.05), "removes 3.1 % of the energy")),
        ask("Choice of lights", "tree",
            choice("uniform", "Lights chosen uniformly", slower(3.8, "lu"), FEWER, 1 / 3.8, 3.0, NONE),
            choice("power", "Lights chosen by power", slower(1.4, "lp"), FEWER, 1 / 1.4, 3.0, NONE)),
        ask("Arithmetic", "float",
            choice("double", "Double instead of float arithmetic", slower(1.9, "double"), FEWER[:4],
                   1 / 1.9, 3.0, NONE)),
        ask("Embree's robust flag", "on",
            choice("off", "Without Embree's robust flag", slower(1, "robust"), FEWER, 1.02, 3.0,
                   [0.02, 0.0, 0.04])),
    ]


def effects():
    rows = [("caustics", 0.31, 6.2), ("dispersion", 0.17, 0.21), ("volumetric absorption", 0.11, 4.1),
            ("depth of field", 0.03, 9.5), ("motion blur", 0.06, 2.4), ("clearcoat", 0.04, 0.06),
            ("sheen", 0.015, 0.02), ("normal maps", 0.02, 3.3)]
    return [{"name": n, "saved": [s, rounded(s - 0.012), rounded(s + 0.012)], "bias": interval(b, 0.15)}
            for n, s, b in rows]


def tiles(columns, rows):
    noise = random.Random("tiles")
    error, samples = [], []
    for y in range(rows):
        for x in range(columns):
            u, v = (x + 0.5) / columns - 0.5, (y + 0.5) / rows - 0.55
            hard = 0.25 + math.exp(-18 * (u * u + 2 * v * v)) + 2 * math.exp(-160 * ((u - .2) ** 2 + (v - .2) ** 2))
            error.append(rounded(1.1 * hard ** 0.4 * math.exp(noise.gauss(0, 0.12))))
            samples.append(float(2 ** round(9 + 1.4 * math.log2(hard))))
    return ({"columns": float(columns), "rows": float(rows), "values": error},
            {"columns": float(columns), "rows": float(rows), "values": samples})


def histogram():
    out, low = [], 1 / 64
    for i in range(24):
        high = low * math.sqrt(2)
        out.append({"low": rounded(low), "high": rounded(high),
                    "count": float(round(90000 * math.exp(-((math.log2(low) + 0.6) / 1.5) ** 2)))})
        low = high
    return out


def study(**changes):
    """A whole study; keyword arguments replace parts of it."""
    main = Law(94, 0.53, seed="main")
    points = main.points(COSTS)
    error, samples = tiles(50, 38)
    out = {
        "azulejo_study": 1, "scene": "glasshouse.gltf", "machine": "shared Intel Xeon, 2 cores, 24 GiB",
        "date": "2026-03-01 14:05", "command": "azulejo accuracy glasshouse.gltf --size 800x600 -o glasshouse.html",
        "version": "azulejo 0.2.0", "transform": "exposure 0 EV, filmic, sRGB", "width": 800.0,
        "height": 600.0, "cores": 2.0, "seed": 1.0, "traversal_share": 0.41, "target_codes": 3.0,
        "target_core_s": [668.0, 590.0, 760.0], "price_core_hour": 0.04, "currency": "EUR",
        "deadline_s": 1800.0, "deadline": "18:00", "complete": True, "points": points,
        "fit": fit(points),
        "regions": [{"label": kind, "x": 300.0, "y": 220.0, "crops": [
            {"core_s": p["core_s"], "codes": p["codes"][0] * (1 if kind == "typical" else 2.2),
             "picture": crop(p["codes"][0] * (1 if kind == "typical" else 2.2), kind)}
            for p in (points[1], points[3], points[5])]} for kind in ("typical", "worst")],
        "questions": questions(), "effects": effects(),
        "workers": [{"name": "worker-%d" % (i + 1), "cores": 1.0}
                    for i in range(2)],
        "tile_error": error, "tile_samples": samples, "histogram": histogram(),
        "tail": {"pixels": [rounded(10 ** (i / 8)) for i in range(-32, 1)],
                 "error": [rounded(10 ** (i / 40)) for i in range(-32, 1)], "index": 0.38},
        "predictions": [{"round": float(k), "core_s_then": rounded(COSTS[k - 1]), "target_codes": 3.0,
                         "core_s": interval(668 * f, s), "core_s_true": 671.0}
                        for k, f, s in ((2, 1.31, 0.6), (3, 0.88, 0.3), (4, 1.06, 0.15), (5, 0.99, 0.08))],
    }
    out.update(changes)
    return out


if __name__ == "__main__":
    json.dump(study(), sys.stdout, indent=1, ensure_ascii=False)
    print()
