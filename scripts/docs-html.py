#!/usr/bin/env python3
"""The documents as web pages, as they look on a screen or a phone: `make docs-html`. Needs Debian's cmark-gfm.

    scripts/docs-html.py [FOLDER]

Every Markdown file becomes a page in FOLDER (out/html), with its links to other documents; pictures are linked to, not copied."""
import html
import os
import re
import shutil
import subprocess
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from documents import Document, heading_anchors, tracked

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>%s</title><style>
:root { color-scheme: light dark }
body { max-width: 980px; margin: 0 auto; padding: 16px; font: 16px/1.5 system-ui, sans-serif; overflow-wrap: break-word }
img { max-width: 100%%; height: auto; background: #fff }
pre { overflow-x: auto; padding: 12px; border-radius: 6px; background: #8881; font-size: 85%% }
code { font-size: 85%% } pre code { font-size: 100%% }
table { display: block; overflow-x: auto; border-collapse: collapse; width: max-content; max-width: 100%% }
th, td { border: 1px solid #8885; padding: 4px 10px; text-align: start }
</style><main>%s</main></html>
"""


def page(path, folder):
    done = subprocess.run(["cmark-gfm", "--unsafe", "-e", "table", "-e", "autolink", "-e", "strikethrough", path], cwd=ROOT,
                          capture_output=True, text=True, check=True)
    anchors = iter(heading_anchors(Document(ROOT, path).prose))
    text = re.sub(r"<h([1-6])>", lambda m: '<h%s id="%s">' % (m[1], next(anchors)), done.stdout)

    def target(match):
        name, _, anchor = match[2].partition("#")
        if not name or re.match(r"^[a-z]+:", name):
            return match[0]
        where = os.path.normpath(os.path.join(os.path.dirname(path), html.unescape(name)))
        base = folder if where.endswith(".md") else ROOT
        there = os.path.relpath(os.path.join(base, re.sub(r"\.md$", ".html", where)), os.path.dirname(os.path.join(folder, path)))
        return '%s="%s%s"' % (match[1], there, "#" + anchor if anchor else "")
    text = re.sub(r'(href|src|srcset)="([^"]*)"', target, text)
    out = os.path.join(folder, re.sub(r"\.md$", ".html", path))
    os.makedirs(os.path.dirname(out), exist_ok=True)
    with open(out, "w", encoding="utf-8") as file:
        file.write(PAGE % (path, text))


def main():
    folder = os.path.abspath(sys.argv[1] if len(sys.argv) > 1 else os.path.join(ROOT, "out", "html"))
    if not shutil.which("cmark-gfm"):
        sys.exit("docs-html: cmark-gfm is missing: apt-get install cmark-gfm")
    documents = [path for path in tracked(ROOT) if path.endswith(".md")]
    for path in documents:
        page(path, folder)
    print("%d pages: %s" % (len(documents), os.path.join(folder, "README.html")))


main()
