#!/usr/bin/env python3
"""Write a manual page to standard output, from its prose and the option tables that the programs print as --help.

    scripts/man.py BIN docs/man/PROGRAM.1.in [COMMAND]

With COMMAND, the page of this command of azulejo: its section, and all of its options.

The prose is mdoc(7). These lines stand for what the tables have:

    @synopsis NAME                 the usage of a program
    @options TABLE [not TABLE]     a list of the options, less those of the page's @shared lists and of the table behind `not`
    --name                         ... mdoc that follows the help of this option
    --name =                       ... mdoc in place of its help
    @end
    @shared TABLE... [only|but NAME...]   the same for the options that all these tables have; `but` leaves some to the commands' own
                                   lists, where options with another help stand anyway
    @names TABLE in TABLE          the names of a table's options that another one has, too, to the end of a sentence
    @command NAME                  begins the section of a command, up to the next one: a line of the program's own page
    @having NAME                   the commands that have this option, to the end of a sentence
    @parameters TABLE              the parameters of tone mapping operators

A TABLE is a command of azulejo, or another program. It is an error if prose belongs to no option.
"""
import os
import re
import subprocess
import sys


class Row:
    """An option: its letter, name, argument, choices and help."""

    def __init__(self, letter, name, argument, text):
        choices = re.search(r" \[([^\[\] ]*\|[^\[\] ]*)\]$", text)
        self.letter, self.name, self.argument = letter, name, argument or ""
        self.choices = choices[1].split("|") if choices else []
        self.help = text[:choices.start()] if choices else text

    def same(self, other):
        return other is not None and (self.argument, self.choices, self.help) == (other.argument, other.choices, other.help)

    def head(self):
        value = " ".join(["Cm"] + " | ".join(self.choices).split()) if self.choices else "Ar " + self.argument if self.argument else ""
        letter = "Fl %s , " % self.letter if self.letter else ""
        return (".It %sFl -%s %s" % (letter, self.name, value)).rstrip()


class Table:
    """What a program says of itself."""

    def __init__(self, folder, name):
        words = [name, "--help"] if name.startswith("azulejo") else ["azulejo", "help"] + name.split()
        text = subprocess.run([os.path.join(folder, words[0]), *words[1:]], capture_output=True, text=True, check=True,
                              env=dict(os.environ, COLUMNS="9999")).stdout
        usage, _, self.text = text.partition("\n\n")
        self.usage = [part.strip() for line in usage.splitlines() for part in re.split(r"^usage: | \| (?=azulejo)", line) if part.strip()]
        before, _, after = self.text.partition("\nparameters of the tone mapping operators")
        self.parameters = re.findall(r"^      --([a-z0-9-]+) VALUE +(.*)$", after, re.M)
        rows = re.findall(r"^  (?:-(\w), |    )--([a-z0-9-]+)(?: (\S+))?(?: *\n)? {2,}(\S.*)$", before, re.M)
        self.rows = {row[1]: Row(*row) for row in rows if row[1] != "help"}


def plain(text):
    """A sentence of help as mdoc."""
    text = text + ("" if text.endswith((".", "?")) else ".")
    # A help that begins with a value explains it.
    text = text if re.match(r"[a-z]+: ", text) else text[0].upper() + text[1:]
    text = text.replace("\\", "\\e").replace("^", "\\(ha")
    text = re.sub(r"(?<![\w-])(--?)([a-z][a-z-]*)", lambda m: "\\fB\\%" + m[1].replace("-", "\\-") + m[2].replace("-", "\\-") + "\\fP", text)
    return "\\&" + text if text[0] in ".'" else text


def usage_line(usage):
    """azulejo list [OPTION]... as mdoc."""
    words = usage.split(" ", 1)[1] if " " in usage else ""
    words = re.sub(r"(?<![\w])([A-Z][A-Z0-9_]*(?:\.[a-z]+)?)(?!\w)", lambda m: "\\fI%s\\fP" % m[1].lower(), words)
    return ".Nm\n" + re.sub(r"(?<![\w\\-])(--?[a-z][a-z-]*|[a-z][a-z-]*)(?![\w\\-])", lambda m: "\\fB%s\\fP" % m[1].replace("-", "\\-"), words)


class Page:
    def __init__(self, folder, lines, part_of=None):
        self.folder, self.lines, self.tables = folder, lines, part_of.tables if part_of else {}
        self.whole = part_of.lines if part_of else lines
        self.shared = {}     # line of its directive: its rows
        taken = set()
        directives = [(n, line.split()[1:]) for n, line in enumerate(lines) if line.startswith("@shared ")]
        # Lists that name their options come first.
        for n, words in sorted(directives, key=lambda d: "only" not in d[1]):
            names, mode, chosen = self.split(words, "only", "but")
            first, *others = [self.table(name) for name in names]
            rows = [row for row in first.rows.values() if all(row.same(t.rows.get(row.name)) for t in others)]
            rows = [row for row in rows if (row.name in chosen if mode == "only" else row.name not in chosen and row.name not in taken)]
            if mode and set(chosen) - set(first.rows):
                raise SystemExit("%s: no option %s" % (" ".join(words), set(chosen) - set(first.rows)))
            self.shared[n] = rows
            taken |= {row.name for row in rows}

    @staticmethod
    def split(words, *modes):
        for mode in modes:
            if mode in words:
                return words[:words.index(mode)], mode, words[words.index(mode) + 1:]
        return words, None, []

    def table(self, name):
        if name not in self.tables:
            self.tables[name] = Table(self.folder, name)
        return self.tables[name]

    def own_rows(self, words):
        (name,), _, others = self.split(words, "not")
        shared = {row.name: row for rows in self.shared.values() for row in rows}
        for other in others:
            shared.update(self.table(other).rows)
        return [row for row in self.table(name).rows.values() if not row.same(shared.get(row.name))]

    @staticmethod
    def prose_of(what, prose):
        """The prose about options besides their help, by name: (in its place, lines)."""
        said, name = {}, None
        for line in prose:
            begins = re.fullmatch(r"--([a-z0-9-]+)( =)?", line)
            if begins:
                name = begins[1]
                if name in said:
                    raise SystemExit("%s: --%s twice" % (what, name))
                said[name] = (bool(begins[2]), [])
            elif name is None:
                raise SystemExit("%s: prose before the first option: %s" % (what, line))
            else:
                said[name][1].append(line)
        return said

    def option_list(self, what, rows, prose):
        """The list, and the prose about each option."""
        said = self.prose_of(what, prose)
        if set(said) - {row.name for row in rows}:
            raise SystemExit("%s: no option %s" % (what, ", ".join(sorted(set(said) - {row.name for row in rows}))))
        return self.listed(rows, said)

    @staticmethod
    def listed(rows, said):
        out = [".Bl -tag -width Ds"] if rows else []
        for row in rows:
            instead, lines = said.get(row.name, (False, []))
            out += [row.head()] + ([] if instead else [plain(row.help)]) + lines
        return out + ([".El"] if rows else [])

    def made(self):
        out, n = [], 0
        if "@command" in " ".join(self.lines):
            self.commands()
        while n < len(self.lines):
            line, start = self.lines[n], n
            word, *words = line.split() or [""]
            n += 1
            if word in ("@options", "@shared"):
                end = self.lines.index("@end", n)
                rows = self.own_rows(words) if word == "@options" else self.shared[start]
                out += self.option_list(line, rows, self.lines[n:end])
                n = end + 1
            elif word == "@command":
                out += [".It Xr azulejo-%s 1" % words[0], plain(self.summaries()[words[0]])]
                n = self.section_end(n)
            elif word == "@synopsis":
                for name in words:
                    out += [usage_line(usage) for usage in self.table(name).usage]
            elif word == "@names":
                there = self.table(words[2]).rows
                names = [row for row in self.table(words[0]).rows.values() if row.same(there.get(row.name))]
                out += [".Fl %s-%s %s" % (row.letter + " , Fl " if row.letter else "", row.name, "." if row is names[-1] else ",") for row in names]
            elif word == "@having":
                names = [name for name in self.commands() if words[0] in self.table(name).rows]
                out += [".Cm %s %s" % (name, "." if name is names[-1] else ",") for name in names]
            elif word == "@parameters":
                out += [".Bl -tag -width Ds -compact"]
                out += [".It Fl -%s Ar value Pq %s" % (name, ", ".join(re.findall(r"([\w]+): ", text)))
                        for name, text in sorted(self.table(words[0]).parameters)] + [".El"]
            elif word.startswith("@"):
                raise SystemExit("unknown: " + line)
            else:
                out.append(line)
        return out

    def section_end(self, n):
        """Where the section of a command ends that begins at line n."""
        depth = 0
        while depth >= 0 and not (depth == 0 and self.lines[n].startswith("@command ")):
            depth += self.lines[n].startswith(".Bl") - self.lines[n].startswith(".El")
            n += 1
        return n - (depth < 0)

    def made_of(self, command):
        """The page of a command: what the program's page says of it, and all of its options."""
        begin = self.lines.index("@command " + command) + 1
        section = self.lines[begin:self.section_end(begin)]
        table, said = self.table(command), {}
        for at, rows in self.shared.items():
            block = self.prose_of(self.lines[at], self.lines[at + 1:self.lines.index("@end", at)])
            said.update({row.name: block[row.name] for row in rows if row.name in block and row.same(table.rows.get(row.name))})
        if "@options " + command in section:
            at = section.index("@options " + command)
            end = section.index("@end", at)
            own = self.prose_of(section[at], section[at + 1:end])
            if set(own) - set(table.rows):
                raise SystemExit("%s: no option %s" % (command, ", ".join(sorted(set(own) - set(table.rows)))))
            said.update(own)
            section[at:end + 1] = []
        out = [self.lines[0], ".Dt AZULEJO-%s 1" % command.upper(), ".Os", ".Sh NAME", ".Nm azulejo-" + command,
               ".Nd " + self.summaries()[command], ".Sh SYNOPSIS"]
        out += [usage_line(usage).replace(".Nm", ".Nm azulejo", 1) for usage in table.usage]
        out += [".Sh DESCRIPTION"] + section + [".Sh OPTIONS"] + self.listed(list(table.rows.values()), said)
        for word, name, title in (("exposure", "Tone mapping options", "TONE MAPPING"), ("state", "Choosing jobs", "CHOOSING JOBS")):
            if word in table.rows and (word != "state" or "mine" in table.rows):
                out += [".Sh " + title] + self.text_of(name)
        return out + [".Sh EXIT STATUS", "As of", ".Xr azulejo 1 .", ".Sh SEE ALSO", ".Xr azulejo 1"]

    def text_of(self, name):
        """A subsection of the program's page without its lists of options."""
        n, out = self.lines.index(".Ss " + name) + 1, []
        while not self.lines[n].startswith((".Ss", ".Sh")):
            if self.lines[n].startswith("@shared"):
                n = self.lines.index("@end", n)
            else:
                out.append(self.lines[n])
            n += 1
        return Page(self.folder, out, self).made()

    def summaries(self):
        """What the program's help says of each command."""
        return dict(re.findall(r"^  ([a-z][a-z-]+)  +(\S.*)$", self.table("azulejo").text, re.M))

    def commands(self):
        """Those of azulejo; the page describes each of them."""
        names = list(self.summaries())
        for name in names:
            if "@command " + name not in self.whole:
                raise SystemExit("the page does not describe the command " + name)
        return names


def main(folder, path, command=None):
    with open(path, encoding="utf-8") as file:
        page = Page(folder, file.read().splitlines())
    print("\n".join(page.made_of(command) if command else page.made()))


if __name__ == "__main__":
    main(*sys.argv[1:])
