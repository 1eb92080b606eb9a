"""Parts of docs/ACCURACY.md that programs write: <!-- written by make NAME --> ... <!-- end -->."""
import os

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DOCUMENT = os.path.join(ROOT, "docs/ACCURACY.md")


def write(target, text):
    """`target` of the Makefile wrote this."""
    begin = "<!-- written by make %s -->" % target
    with open(DOCUMENT) as source:
        before, rest = source.read().split(begin)
    with open(DOCUMENT, "w") as document:
        document.write(before + begin + "\n\n" + text + "\n\n<!-- end -->" + rest.split("<!-- end -->", 1)[1])
