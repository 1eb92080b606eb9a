#!/usr/bin/env python3
"""The page's colours are told apart: WCAG's contrast (AA) of every pair that is used, in light and dark."""
import pathlib
import re
import sys

STYLE = pathlib.Path(__file__).resolve().parents[2] / "web/assets/style.css"
TEXT, PART = 4.5, 3.0  # least contrast of text, and of a control's outline or a mark

BACKGROUNDS = ("page", "panel", "hover", "chosen")
PAIRS = [(ink, ground, TEXT) for ink in ("text", "muted", "accent", "amber", "red", "green") for ground in BACKGROUNDS]
PAIRS += [("on-accent", "accent", TEXT), ("text", "stage", TEXT), ("page", "text", TEXT)]
PAIRS += [("field", ground, PART) for ground in ("page", "panel")] + [("accent", "bar", PART)]


def colours(style, selector):
    body = re.search(re.escape(selector) + r"\s*\{(.*?)\}", style, re.S).group(1)
    found = dict(re.findall(r"--([\w-]+):\s*#([0-9a-f]+)", body))
    return {name: h if len(h) == 6 else "".join(c * 2 for c in h) for name, h in found.items()}


def luminance(colour):
    def linear(code):
        value = code / 255
        return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
    red, green, blue = (linear(int(colour[i:i + 2], 16)) for i in (0, 2, 4))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one, other):
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def main():
    style = STYLE.read_text()
    schemes = {"light": colours(style, ":root"), "dark": colours(style, ":root[data-theme=dark]")}
    failed = 0
    print("1..%d" % len(schemes))
    for number, (scheme, found) in enumerate(schemes.items(), 1):
        faint = [(ink, ground, least) for ink, ground, least in PAIRS
                 if contrast(found[ink], found[ground]) < least]
        worst = min((contrast(found[a], found[b]) / least, a, b) for a, b, least in PAIRS)
        print("# %s: %d pairs; nearest to its limit is %s on %s: %.2f" % (
            scheme, len(PAIRS), worst[1], worst[2], contrast(found[worst[1]], found[worst[2]])))
        for ink, ground, least in faint:
            print("# %s on %s: %.2f is less than %.1f" % (ink, ground, contrast(found[ink], found[ground]), least))
        print("%sok %d - the colours of the %s scheme can be read (WCAG AA)" % ("not " if faint else "", number, scheme))
        failed += len(faint)
    return failed


if __name__ == "__main__":
    sys.exit(1 if main() else 0)
