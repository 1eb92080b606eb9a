"""What the Markdown documents of this repository consist of: headings, links, pictures, spans of code, and blocks of commands.

It knows the Markdown that is written here, not all of it. scripts/check-docs.py and tests/farm/test_docs.py read documents by it."""
import os
import re
import shlex
import subprocess

MARK = re.compile(r"^\s*<!--\s*(not run|run by|run slowly)\s*:\s*(.*?)\s*-->\s*$")
FENCE = re.compile(r"^(\s*)(```+|~~~+)\s*([\w-]*)\s*$")
# The first word of a line of commands. Others are found out by the shell's words (scripts/check-docs.py).
PROGRAM = re.compile(r"^(\$ )?([A-Za-z_]\w*=\S* +)*"
                     r"(azulejo(-coordinator|-worker)?|make|python3|curl|ssh|blender|valgrind|kubectl|podman|install|git|"
                     r"(\./)?(tests|scripts|build|deploy)/[\w./-]+|\w+=(tests|scripts|build)/\S+)( |$)")


def quote_is_open(text):
    try:
        shlex.split(text, comments=True)
        return False
    except ValueError:
        return True


class Block:
    """A block of code: where it begins, its language ('' for none), its lines, and the mark above it.

    kind: 'commands' to be run as they stand, 'transcript' of "$ COMMAND" and its output, or 'text'."""

    def __init__(self, document, line, language, lines, mark):
        self.document, self.line, self.language, self.lines = document, line, language, lines
        self.mark, self.reason = mark or ("", "")
        words = [text.strip() for text in lines if text.strip()]
        first = words[0] if words else ""
        if language == "sh":
            self.kind = "commands"
        elif language in ("", "console") and first.startswith("$ "):
            self.kind = "transcript"
        else:
            self.kind = "text"
        self.looks_like_commands = self.kind == "text" and language == "" and bool(PROGRAM.match(first))

    def commands(self):
        """(line number, shell text) of each command, with continued lines joined and line numbers of the document."""
        number = self.line
        text, begin = "", 0
        for line in self.lines:
            number += 1
            if self.kind == "transcript":
                if not text and not line.strip().startswith("$ "):
                    continue
                line = line.strip()[2:] if not text else line
            begin = begin if text else number
            text += line.strip() + "\n"
            if text.endswith("\\\n"):
                text = text[:-2] + " "
                continue
            if quote_is_open(text):
                continue
            if text.strip():
                yield begin, text.strip()
            text = ""
        if text.strip():
            yield begin, text.strip()


def heading_anchors(prose):
    """The anchors that GitHub gives the headings, in their order."""
    anchors = []
    for _, line in prose:
        heading = re.match(r"^#{1,6} +(.*?)(?: +#+)?$", line)
        if not heading:
            continue
        text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading[1])
        name = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        unique, count = name, 0
        while unique in anchors:
            count += 1
            unique = "%s-%d" % (name, count)
        anchors.append(unique)
    return anchors


class Document:
    def __init__(self, root, path):
        self.root, self.path = root, path
        with open(os.path.join(root, path), encoding="utf-8") as file:
            self.lines = file.read().splitlines()
        self.blocks = []
        self.prose = []      # (line number, text without blocks)
        self._split()
        self.anchors = self._anchors()

    def _split(self):
        mark, index, after_blank = None, 0, True
        while index < len(self.lines):
            line = self.lines[index]
            fence = FENCE.match(line)
            if fence:
                end = index + 1
                while end < len(self.lines) and not self.lines[end].strip().startswith(fence[2]):
                    end += 1
                self.blocks.append(Block(self, index + 1, fence[3], self.lines[index + 1:end], mark))
                index, mark, after_blank = end + 1, None, True
                continue
            if after_blank and line.startswith("    ") and (PROGRAM.match(line.strip()) or line.strip().startswith("$ ")):
                end = index
                while end < len(self.lines) and (self.lines[end].startswith("    ") or not self.lines[end].strip()):
                    end += 1
                lines = self.lines[index:end]
                language = "" if line.strip().startswith("$ ") else "sh"
                self.blocks.append(Block(self, index, language, lines, mark))
                index, mark, after_blank = end, None, True
                continue
            found = MARK.match(line)
            if found:
                mark = (found[1], found[2])
            elif line.strip():
                mark = None
            after_blank = not line.strip() or bool(found)
            self.prose.append((index + 1, line))
            index += 1

    def _anchors(self):
        named = [name for _, line in self.prose for name in re.findall(r"<a (?:id|name)=\"([^\"]+)\"", line)]
        return set(named + heading_anchors(self.prose))

    def links(self):
        """(line number, target, is a picture) of each link."""
        for number, line in self.prose:
            text = re.sub(r"`[^`]*`", "", line)
            for bang, target in re.findall(r"(!?)\[(?:[^\[\]]|\[[^\]]*\]\([^)]*\))*\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)", text):
                yield number, target, bool(bang)
            for target in re.findall(r"!\[[^\]]*\]\(<?([^)\s>]+)>?[^)]*\)\]", text):   # a picture that is a link
                yield number, target, True
            for tag, target in re.findall(r"<(img|a|source)\b[^>]*?(?:src|href|srcset)=\"([^\"]+)\"", text):
                yield number, target, tag != "a"
            reference = re.match(r"^\[[^\]]+\]:\s+(\S+)", text)
            if reference:
                yield number, reference[1], False

    def spans(self):
        """(line number, text) of each span of code."""
        for number, line in self.prose:
            for text in re.findall(r"(?<!`)`([^`]+)`(?!`)", line):
                yield number, text.strip()


def tracked(root):
    """The files of the tree: git's, with those that are new and not ignored; without git, all."""
    try:
        done = subprocess.run(["git", "-C", root, "ls-files", "--cached", "--others", "--exclude-standard"],
                              capture_output=True, text=True, check=True)
        return sorted(path for path in set(done.stdout.splitlines()) if os.path.exists(os.path.join(root, path)))
    except (OSError, subprocess.CalledProcessError):
        found = []
        for folder, folders, names in os.walk(root):
            folders[:] = [name for name in folders if not name.startswith(".") and (folder != root or name not in ("build", "out"))]
            found += [os.path.relpath(os.path.join(folder, name), root) for name in names]
        return sorted(found)


def load(root, files=None):
    return [Document(root, path) for path in files or tracked(root) if path.endswith(".md")]
