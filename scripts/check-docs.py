#!/usr/bin/env python3
"""Prove that what the documents name exists: `make docs-check`, a part of `make test`.

    scripts/check-docs.py [--root FOLDER] [--bin FOLDER]

Checked in every Markdown file: links and their anchors, pictures (each one in docs/images is named somewhere), files named in
`code`, and every command in a block or in `code`: its program, sub-command, options, option values that come from a list, make
target and files. The programs' own tables (`azulejo completion`) say what exists. A block of commands is marked if no test can
run it, on the line before it:

    <!-- not run: needs several machines -->
    <!-- run by: tests/farm/test_web_api.py -->      another test runs it
    <!-- run slowly: renders two hours -->           only `make test-docs` runs it

tests/farm/test_docs.py runs all others."""
import argparse
import os
import re
import shlex
import subprocess
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from documents import load, tracked

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".svg", ".gif")
PICTURE_BYTES_MOST = 400000
LINE_MOST = 110     # characters of a command: longer ones must be scrolled on a screen
# Programs of others, and words of the shell, that documents may use.
OTHERS = set("""apt-get awk bash blender cat cd chmod cmp cp curl cut diff do done echo else esac export false ffmpeg fi for git grep head
    if in install journalctl kill kubectl ls mkdir mpirun mv nice openssl podman printf read rm sbatch scp sed set sh sha256sum sleep sort srun ssh
    sudo systemctl systemd-analyze tail tar tee test then timeout trap true umask until valgrind wait wc while xdg-open zstd [ [[ : . { }""".split())
PREFIXES = set("do else exec if nice nohup sudo then time until while { !".split())
REPOSITORY_PATH = re.compile(r"^(?:\.{1,2}/)*(?:client|common|coordinator|deploy|docs|protocol|scenes|scripts|tests|web|worker)/[\w./-]+$")


# ---- what the programs know ---------------------------------------------------------------------

class Command:
    def __init__(self):
        self.options, self.values, self.words = set(), {}, set()


class Tables:
    """The options of every command of the three programs, from their completion, and of the generators, from their help."""

    def __init__(self, folder):
        self.folder = folder
        self.commands = {}
        self.helps = {}
        self._read("azulejo")
        for name in ("azulejo-coordinator", "azulejo-web", "azulejo-worker"):
            self._read(name)
        for (program, command), entry in self.commands.items():
            # Sub-commands of a sub-command stand in its usage alone: `token create|list`.
            usage = self.help([program] + ([command] if command else [])).split("\n\n")[0]
            entry.words |= set(re.findall(r"(?<![\w-])[a-z]+(?![\w-])", usage)) - {"usage"}

    def _run(self, *words):
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        return done.stdout + done.stderr

    def help(self, words):
        key = tuple(words)
        if key not in self.helps:
            self.helps[key] = self._run(os.path.join(self.folder, words[0]), *words[1:], "--help")
        return self.helps[key]

    def _read(self, program):
        command, names = "" if program != "azulejo" else None, []
        for line in self._run(os.path.join(self.folder, "azulejo"), "completion", "bash", program).splitlines():
            name = re.match(r"^    ([a-z][a-z-]*)\)$", line)
            if name:
                command = name[1]
            if command is None:
                continue
            entry = self.commands.setdefault((program, command), Command())
            options = re.match(r"^ +options='(-[^']*)'$", line)
            if options:
                entry.options |= set(options[1].split())
                names.append(command)
            value = re.match(r"^ +(-[^)]*)\) value=(\w+)(?: values='([^']*)')?", line)
            if value:
                for option in value[1].split(" | "):
                    entry.values[option] = (value[2], set((value[3] or "").split()))
            if line.strip() == "esac" and command == "":
                break
        if not names:
            raise SystemExit("check-docs: %s has no completion for %s: build first" % (self.folder, program))

    def generator(self, name):
        for folder, _, names in os.walk(os.path.join(self.folder, "scenes")):
            if name in names:
                return os.path.relpath(os.path.join(folder, name), self.folder)
        return None


def make_targets(root):
    with open(os.path.join(root, "Makefile"), encoding="utf-8") as file:
        text = file.read()
    targets = set(re.findall(r"^([a-z][\w-]*)(?: [a-z][\w -]*)?:(?!=)", text, re.M))
    for line in re.findall(r"^\.PHONY:(.*)$", text, re.M):
        targets |= set(line.split())
    return targets, {used or given for used, given in re.findall(r"\$\(([A-Z_]+)\)|^([A-Z_]+) ?\??:?=", text, re.M)}


# ---- the shell's words ---------------------------------------------------------------------------

def simple_commands(text):
    """The words of each simple command of a line, without comments, redirections and assignments; and the assignments."""
    text = re.sub(r"\$\(([^()]*)\)", r" ; \1 ; ", text)         # a command whose output is a word
    lexer = shlex.shlex(text, posix=True, punctuation_chars=True)
    lexer.wordchars += "$@%^+:,~[]{}!"
    lexer.commenters = ""
    words, redirected = [], False
    for token in lexer:
        if token.startswith("#"):
            break
        if set(token) <= set("();&|\n"):
            yield words
            words, redirected = [], False
        elif set(token) <= set("<>"):
            redirected = True
        elif redirected:
            redirected = False
        else:
            words.append(token)
    yield words


def split(text):
    """[(assignments, words)] of a line; a line that is no shell gives one with a word of its own."""
    text = re.sub(r"(?:^|(?<=\s))#[^\n]*", "", text)
    text = re.sub(r"\[[A-Z][^\]\n]*\]", "", text)              # [WHAT MAY BE LEFT OUT]
    try:
        commands = list(simple_commands(text))
    except ValueError as error:
        return [({}, ["?", str(error)])]
    found = []
    for words in commands:
        given = {}
        while words and (words[0] in PREFIXES or re.match(r"^[A-Za-z_]\w*=", words[0])):
            name, equals, value = words.pop(0).partition("=")
            if equals:
                given[name] = value
        if words or given:
            found.append((given, words))
    return found


class Checker:
    def __init__(self, root, folder):
        self.root = root
        self.files = tracked(root)
        self.known = set(self.files)
        for path in self.files:
            while "/" in path:
                path = path.rsplit("/", 1)[0]
                self.known.add(path)
        self.documents = load(root, self.files)
        self.by_path = {document.path: document for document in self.documents}
        self.tables = Tables(folder)
        self.targets, self.variables = make_targets(root)
        self.faults = []
        self.counts = dict(links=0, pictures=0, commands=0, blocks=0, marked=0)

    def fault(self, document, line, text):
        self.faults.append("%s:%d: %s" % (document.path, line, text))

    # ---- links ----

    def link(self, document, line, target, picture):
        if re.match(r"^[a-z][a-z+.-]*:", target):
            return
        self.counts["pictures" if picture else "links"] += 1
        path, _, anchor = target.partition("#")
        where = os.path.normpath(os.path.join(os.path.dirname(document.path), path)) if path else document.path
        if where not in self.known and where != ".":
            there = os.path.exists(os.path.join(self.root, where))
            self.fault(document, line, "the link '%s': %s" % (
                target, "git ignores %s" % where if there else "there is no %s" % where))
            return
        if anchor and where.endswith(".md") and anchor not in self.by_path[where].anchors:
            self.fault(document, line, "the link '%s': %s has no heading with the anchor '#%s'" % (target, where, anchor))

    def pictures(self):
        """Each picture of docs/images is named in some document, and is small enough to be loaded with it."""
        named = set()
        for document in self.documents:
            for _, target, _ in document.links():
                named.add(os.path.normpath(os.path.join(os.path.dirname(document.path), target.partition("#")[0])))
        for path in self.files:
            if path.startswith("docs/images/") and path.endswith(PICTURES) and path not in named:
                self.faults.append("%s: no document shows this picture: remove it, or link to it" % path)
            if path.startswith("docs/images/") and os.path.getsize(os.path.join(self.root, path)) > PICTURE_BYTES_MOST:
                self.faults.append("%s: larger than %d kB: make it smaller" % (path, PICTURE_BYTES_MOST // 1000))

    # ---- commands ----

    def path(self, document, line, word, what):
        """A word that names a file of the repository must name one that is there."""
        if not REPOSITORY_PATH.match(word) or word.endswith("...") or "NAME" in word:
            return
        here = os.path.join(os.path.dirname(document.path), word)
        for path in (os.path.normpath(word), os.path.normpath(here)):
            if self.known & {path, path + ".c", path + ".h"}:   # `folder/noun` is the file of that noun
                return
        self.fault(document, line, "%s: there is no file %s" % (what, word))

    def options(self, document, line, program, words, entry, what):
        index = 0
        while index < len(words):
            word = words[index]
            index += 1
            if word == "--":
                return
            if not re.match(r"^--?[A-Za-z0-9]", word) or re.match(r"^-\d", word):
                self.path(document, line, word, what)
                continue
            option, equals, value = word.partition("=")
            if option not in entry.options and option not in ("--help", "--version", "-h", "-V") and option.rstrip("0123456789") not in entry.options:
                self.fault(document, line, "'%s': %s has no option %s" % (what, program, option))
                continue
            if option not in entry.values:
                continue
            if not equals:
                value = words[index] if index < len(words) else ""
                index += 1
            kind, values = entry.values[option]
            if kind in ("words", "list") and values and re.match(r"^[a-z][\w,.-]*$", value):
                for part in value.split(",") if kind == "list" else [value]:
                    if part not in values:
                        self.fault(document, line, "'%s': %s has no value '%s'" % (what, option, part))
            elif kind in ("file", "folder"):
                self.path(document, line, value, what)

    def command(self, document, line, words, variables):
        """One simple command: does what it names exist?"""
        words = [re.sub(r"\$(\w+)", lambda m: variables.get(m[1], m[0]), word) for word in words]
        what = " ".join(words)[:90]
        name = words[0]
        program = os.path.basename(name)
        self.counts["commands"] += 1
        if name == "?":
            self.fault(document, line, "this is no shell: %s" % words[1])
        elif program in ("azulejo", "azulejo-coordinator", "azulejo-web", "azulejo-worker"):
            self.azulejo(document, line, program, words[1:], what)
        elif program == "make":
            self.make(document, line, words[1:], what)
        elif program.startswith("make_") and "." not in program:
            there = self.tables.generator(program)
            if not there or ("/" in name and not name.endswith("/bin/" + there)):
                self.fault(document, line, "'%s': there is no program %s" % (what, name))
            else:
                entry = Command()
                entry.options = set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", self.tables.help([there])))
                self.options(document, line, program, words[1:], entry, what)
        elif REPOSITORY_PATH.match(name) or program in ("python3", "bash", "sh"):
            self.script(document, line, words, what)
        elif program in OTHERS or name in variables.get("functions", ()):
            for word in words[1:]:
                self.path(document, line, word, what)
        elif not name.startswith(("/", "build/", "$")):
            self.fault(document, line, "'%s': no program '%s' is known here; if it is right, add it to OTHERS in scripts/check-docs.py" % (
                what, name))

    def azulejo(self, document, line, program, words, what):
        if program == "azulejo":
            if not words:
                return
            if words[0] in ("--help", "--version", "-h", "help", "COMMAND", "..."):
                return
            if words[0].isupper() or words[0][0].isdigit():   # COMMAND, or the release, as in `azulejo 0.2.0`
                return
            entry = self.tables.commands.get((program, words[0]))
            if not entry:
                self.fault(document, line, "'%s': azulejo has no command '%s'" % (what, words[0]))
                return
            if words[0] in ("token", "workers") and len(words) > 1 and re.match(r"^[a-z]+$", words[1]) and \
                    words[1] not in entry.words:
                self.fault(document, line, "'%s': azulejo %s has no '%s'" % (what, words[0], words[1]))
            self.options(document, line, "azulejo " + words[0], words[1:], entry, what)
        else:
            entry = self.tables.commands[(program, "")]
            if words and re.match(r"^[a-z]+$", words[0]) and words[0] not in entry.words:
                self.fault(document, line, "'%s': %s has no '%s'" % (what, program, words[0]))
            self.options(document, line, program, words, entry, what)

    def make(self, document, line, words, what):
        for word in words:
            variable = re.match(r"^([A-Z_]+)=", word)
            if variable:
                if variable[1] not in self.variables and variable[1] not in ("CC", "NAME"):
                    self.fault(document, line, "'%s': the Makefile does not use %s" % (what, variable[1]))
            elif word.startswith("-") or not re.match(r"^[a-z][\w-]*$", word):
                self.path(document, line, word, what)
            elif word not in self.targets:
                self.fault(document, line, "'%s': the Makefile has no target '%s'" % (what, word))

    def script(self, document, line, words, what):
        """A script of the repository: it is there, and its text knows each option."""
        script = words[0] if REPOSITORY_PATH.match(words[0]) else next((w for w in words[1:] if REPOSITORY_PATH.match(w)), None)
        for word in words:
            self.path(document, line, word, what)
        if not script or script not in self.known or not script.endswith((".py", ".sh")):
            return
        if words[0] == script and not os.access(os.path.join(self.root, script), os.X_OK):
            self.fault(document, line, "'%s': %s cannot be executed: chmod +x" % (what, script))
        with open(os.path.join(self.root, script), encoding="utf-8") as file:
            text = file.read()
        for word in words[words.index(script) + 1:]:
            option = word.partition("=")[0]
            if option.startswith("--") and len(option) > 2 and option not in text and '"$@"' not in text and "more" not in text:
                self.fault(document, line, "'%s': %s has no option %s" % (what, script, option))

    def block(self, document, block):
        if block.looks_like_commands:
            self.fault(document, block.line, "this block looks like commands: begin it with ```sh")
        if block.kind == "text":
            if block.mark:
                self.fault(document, block.line, "only a block of commands can be marked '%s'" % block.mark)
            return
        self.counts["blocks"] += 1
        if block.mark:
            self.counts["marked"] += 1
            if not block.reason:
                self.fault(document, block.line, "'%s' needs a reason" % block.mark)
            if block.mark == "run by":
                test = block.reason.split()[0]
                path = os.path.join(self.root, test)
                if test not in self.known or os.path.basename(document.path) not in open(path, encoding="utf-8").read():
                    self.fault(document, block.line, "'run by: %s': no such test, or it does not name %s" % (test, document.path))
        if block.kind == "commands":
            for number, line in enumerate(block.lines, block.line + 1):
                if len(line) > LINE_MOST:
                    self.fault(document, number, "a command of %d characters: continue it with \\ after %d at most" % (len(line), LINE_MOST))
        variables = {}
        functions = set()
        for line, text in block.commands():
            function = re.match(r"^(\w+)\(\) *\{(.*)\}$", text)
            if function:
                functions.add(function[1])
                text = function[2]
            for given, words in split(text):
                for name, value in given.items():
                    variables[name] = value
                if words:
                    variables["functions"] = functions | document.functions
                    self.command(document, line, words, variables)
        document.functions |= functions

    def spans(self, document):
        for line, text in document.spans():
            words = re.match(r"^(azulejo(?:-coordinator|-web|-worker)?|make|scripts/\S+|tests/\S+)(?: |$)", text)
            if REPOSITORY_PATH.match(text):
                self.path(document, line, text, "`%s`" % text)
            elif words and re.search(r"[\[\]|*<>…]|\.\.\.", text) is None and " " in text:
                for given, command in split(text):
                    if command and os.path.basename(command[0]) not in OTHERS:
                        self.command(document, line, command, given)

    def run(self):
        for document in self.documents:
            document.functions = set()
            for link in document.links():
                self.link(document, *link)
            for block in document.blocks:
                self.block(document, block)
            self.spans(document)
        self.pictures()
        return self.faults


def main():
    parser = argparse.ArgumentParser(description="Prove that what the documents name exists.")
    parser.add_argument("--root", default=os.path.dirname(os.path.dirname(os.path.abspath(__file__))), help="the tree to check")
    parser.add_argument("--bin", default=os.path.join(os.environ.get("BUILD", "build/release"), "bin"), help="the programs' folder")
    given = parser.parse_args()
    checker = Checker(os.path.abspath(given.root), os.path.abspath(given.bin))
    faults = checker.run()
    for fault in faults:
        print(fault)
    if faults:
        print("%d faults in the documents" % len(faults))
    else:
        print("docs: ok (%(links)d links, %(pictures)d pictures, %(commands)d commands, %(blocks)d blocks, %(marked)d of them marked)" % checker.counts)
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
