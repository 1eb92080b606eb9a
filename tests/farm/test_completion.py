#!/usr/bin/env python3
"""Completion in bash, zsh and fish: the scripts are run by the shells, and asked what a person would see."""
import os
import re
import shlex
import shutil
import socket
import subprocess
import time

from farm import BIN, PATIENCE, Farm, Skip, Tests
from jobs import expect

tests = Tests()
PROGRAMS = ("azulejo", "azulejo-coordinator", "azulejo-web", "azulejo-worker")
ENDLESS = ("--size", "64x64", "--spp", "1000000")

# Complete the line as readline would: split at COMP_WORDBREAKS, then print the offers.
BASH = r'''
source "$1"
line=$2
export COMP_LINE=$line COMP_POINT=${#line}
COMP_WORDS=() word=
for ((i = 0; i < ${#line}; i++)); do
    c=${line:i:1}
    case $c in
    ' ') [ "$word" ] && COMP_WORDS+=("$word"); word= ;;
    = | :) [ "$word" ] && COMP_WORDS+=("$word"); COMP_WORDS+=("$c"); word= ;;
    *) word+=$c ;;
    esac
done
case $line in *[=:]) ;; *) COMP_WORDS+=("$word") ;; esac
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
function=$(complete -p "$3" | sed 's/.*-F \([^ ]*\).*/\1/')
$function
printf '%s\n' "${COMPREPLY[@]}"
'''

def script(shell, program, folder):
    done = subprocess.run([os.path.join(BIN, "azulejo"), "completion", shell, program], capture_output=True,
                          text=True, timeout=60)
    expect(done.returncode == 0 and done.stderr == "", done)
    path = os.path.join(folder, "%s.%s" % (program, shell))
    with open(path, "w") as out:
        out.write(done.stdout)
    return path


class Bash:
    name = "bash"

    def offers(self, path, line, program, cwd, env):
        done = subprocess.run(["bash", "--norc", "-c", BASH, "test", path, line, program], capture_output=True,
                              text=True, timeout=60 * PATIENCE, cwd=cwd, env=env)
        expect(done.returncode == 0 and done.stderr == "", (line, done))
        return [re.sub(r"\\(.)", r"\1", word).strip() for word in done.stdout.splitlines() if word]


class Fish:
    name = "fish"

    def offers(self, path, line, program, cwd, env):
        done = subprocess.run(["fish", "--no-config", "-c", "source $argv[1]; complete -C $argv[2]", path, line],
                              capture_output=True, text=True, timeout=60 * PATIENCE, cwd=cwd, env=env)
        expect(done.returncode == 0 and done.stderr == "", (line, done))
        words = [word.split("\t")[0] for word in done.stdout.splitlines() if word]
        prefix = re.search(r"(--[^ =]*=)[^ ]*$", line)
        return [w[len(prefix[1]):] if prefix and w.startswith(prefix[1]) else w for w in words]


class Zsh:
    name = "zsh"
    RC = r'''
stty columns 2000 rows 500
PROMPT= RPS1= PS2=
fpath=("$ZDOTDIR" $fpath)
autoload -Uz compinit; compinit -u -D
setopt no_beep; unsetopt list_beep
compadd () {
    if [[ ${@[1,(i)(-|--)]} == *-(O|A|D)\ * ]]; then builtin compadd "$@"; return $?; fi
    typeset -a hits
    builtin compadd -A hits "$@"
    (( $#hits )) && print -lr -- "<"${^hits}">"
    builtin compadd "$@"
}
finish () { print -r -- "<end>"; exit }
comppostfuncs=(finish)
bindkey "^I" complete-word
'''

    def offers(self, path, line, program, cwd, env):
        folder = os.path.join(os.path.dirname(path), "zsh")
        os.makedirs(folder, exist_ok=True)
        with open(os.path.join(folder, ".zshrc"), "w") as out:
            out.write(self.RC)
        shutil.copy(path, os.path.join(folder, "_" + program))  # loaded by its first use, as when installed
        code = r'''
zmodload zsh/zpty
zpty z zsh -i
zpty -w -n z "$1"$'\t'
while zpty -r z chunk; do print -rn -- $chunk; [[ $chunk == *"<end>"* ]] && break; done
'''
        done = subprocess.run(["zsh", "-f", "-c", code, "test", line], capture_output=True, text=True,
                              timeout=60 * PATIENCE, cwd=cwd,
                              env=dict(env, ZDOTDIR=folder, TERM="dumb"))
        expect("<end>" in done.stdout, (line, done))
        return list(dict.fromkeys(re.sub(r"\\(.)", r"\1", w) for w in re.findall(r"<([^>\r\n]*)>", done.stdout) if w != "end"))


def check(shell):
    """What the shell offers for lines of all kinds."""
    if not shutil.which(shell.name):
        raise Skip("%s is not installed" % shell.name)
    with Farm() as farm:
        farm.start_coordinator()
        names = ("walk-1", "walk-2", "run: 3", "a (b) 'c'", "77")
        jobs = {n: farm.submit(farm.scene(), *ENDLESS, "--name", n) for n in names}
        farm.cli("pause", jobs["walk-2"], expect=0)
        os.makedirs(farm.path("here", "pictures"))
        for name in ("scene one.gltf", "other.glb", "farm2.key"):
            open(farm.path("here", name), "w").close()
        paths = {p: script(shell.name, p, farm.folder) for p in PROGRAMS}
        env = {k: v for k, v in os.environ.items() if not k.startswith("AZULEJO_")}
        env.update(PATH=BIN + ":" + env["PATH"], HOME=farm.folder)
        with_farm = dict(env, AZULEJO_COORDINATOR=farm.address, AZULEJO_KEY=farm.key)

        def offers(line, environment=env):
            program = line.split()[0]
            return shell.offers(paths[program], line, program, farm.path("here"), environment)

        def offered(line, wanted, unwanted=(), environment=env):
            got = offers(line, environment)
            expect(set(wanted) <= set(got) and not set(unwanted) & set(got), (shell.name, line, got))

        def exactly(line, wanted, environment=env):
            got = offers(line, environment)
            expect(sorted(got) == sorted(wanted), (shell.name, line, got))

        exactly("azulejo pa", ["pause"])
        offered("azulejo ", ["render", "submit", "trace", "completion"])
        offered("azulejo pause --", ["--mine", "--state", "--yes", "--coordinator", "--json"], ["--to", "--spp"]) \
            if shell.name != "zsh" else offered("azulejo pause --m", ["--mine"])
        exactly("azulejo render --sampler ", ["sobol", "independent"])
        exactly("azulejo render --sampler=in", ["independent"])
        exactly("azulejo keygen -r wo", ["worker"])
        exactly("azulejo completion z", ["zsh"])
        offered("azulejo tonemap -t mant", ["mantiuk06", "mantiuk08"], ["aces"])
        offered("azulejo pause --state pau", ["paused"], ["queued"])
        got = offers("azulejo pause --state queued,pau")
        expect(any(g in ("paused", "queued,paused") for g in got) and len(got) == 1, (shell.name, got))
        exactly("azulejo-worker --log-level w", ["warn"])
        exactly("azulejo-coordinator --precision ", ["float", "double"])
        offered("azulejo-coordinator --re" if shell.name != "zsh" else "azulejo-coordinator --rem",
                ["--remove-store-at-end"])
        # Files and folders of here.
        files = [w.rstrip("/") for w in offers("azulejo import ")]
        expect({"scene one.gltf", "other.glb"} <= {w.replace("\\", "") for w in files}, (shell.name, files))
        folders = [w.rstrip("/") for w in offers("azulejo-coordinator --store ")]
        expect(folders == ["pictures"], (shell.name, folders))
        offered("azulejo list -k farm", ["farm2.key"])
        exactly("azulejo submit x --size ", [])
        # Jobs: numbers, and names for verbs that take them; from the line's options or the environment.
        numbers = [str(n) for n in jobs.values()]
        plain = [n for n in names if n != "77"]
        line = "azulejo show --coordinator %s --key %s " % (farm.address, shlex.quote(farm.key))
        exactly(line, numbers)
        shutil.copy(farm.key, farm.path("here", "a key.key"))
        for key in ("'a key.key'", '"a key.key"', "a\\ key.key"):
            exactly("azulejo show --coordinator %s --key %s " % (farm.address, key), numbers)
        exactly("azulejo show ", numbers, with_farm)
        exactly("azulejo resume ", numbers + plain, with_farm)
        exactly("azulejo resume wa", ["walk-1", "walk-2"], with_farm)
        exactly("azulejo pause 1 walk-2 a", ["a (b) 'c'"], with_farm)
        offered("azulejo debug-pixel ", numbers + ["other.glb"], plain, with_farm)
        # No farm, a key that is none, a coordinator that does not answer: nothing, soon and silently.
        with socket.socket() as silent:
            silent.bind(("127.0.0.1", 0))
            silent.listen()
            for changes in ({}, {"AZULEJO_KEY": "/nowhere"}, {"AZULEJO_COORDINATOR": "no host"},
                            {"AZULEJO_COORDINATOR": "127.0.0.1:%d" % silent.getsockname()[1]}):
                environment = dict(with_farm, **changes) if changes else env
                exactly("azulejo show ", [], environment)


@tests.add
def bash():
    """bash: commands, options, values, files, jobs"""
    check(Bash())


@tests.add
def zsh():
    """zsh: commands, options, values, files, jobs"""
    check(Zsh())


@tests.add
def fish():
    """fish: commands, options, values, files, jobs"""
    check(Fish())


@tests.add
def jobs():
    """completion --jobs is quick and silent whatever it meets"""
    with Farm() as farm:
        with socket.socket() as silent:
            silent.bind(("127.0.0.1", 0))
            silent.listen()
            begin = time.monotonic()
            result = farm.cli("completion", "--jobs", "--", "pause", "-c",
                              "127.0.0.1:%d" % silent.getsockname()[1], "-k", farm.key)
            expect(result.code == 0 and not result.out and not result.err, result)
            expect(time.monotonic() - begin < 20 * PATIENCE, "its limit is .7 s")
        for words in (("-c",), ("-k",), ("--key=",), ("-c", "x y", "-k", farm.key), ("--coordinator=:::", "--", "-")):
            result = farm.cli("completion", "--jobs", "--", *words)
            expect(result.code == 0 and not result.out and not result.err, result)
        for args in ((), ("csh",), ("bash", "sh"), ("bash", "azulejo", "x")):
            expect(farm.cli("completion", *args).code == 2, args)


@tests.add
def complete():
    """Every command and option of --help is in each script"""
    for shell in ("bash", "zsh", "fish"):
        for program in PROGRAMS:
            done = subprocess.run([os.path.join(BIN, "azulejo"), "completion", shell, program],
                                  capture_output=True, text=True, timeout=60)
            commands = [None]
            if program == "azulejo":
                text = subprocess.run([os.path.join(BIN, program), "help"], capture_output=True, text=True).stdout
                commands = re.findall(r"^  ([a-z-]+)  ", text, re.M)
                expect(len(commands) > 20, commands)
            for command in commands:
                words = [os.path.join(BIN, program)] + (["help", command] if command else ["--help"])
                text = subprocess.run(words, capture_output=True, text=True).stdout
                options = re.findall(r"^  (?:-., |    )--([a-z0-9-]+)", text, re.M)
                expect(options, text)
                if command is None:
                    part = done.stdout
                elif shell == "fish":
                    part = "\n".join(l for l in done.stdout.splitlines() if "_is %s'" % command in l)
                else:
                    part = done.stdout.split("\n    %s)\n" % command)[1]
                    part = re.split(r"\n    [a-z-]+\)\n", part)[0]
                for option in options:
                    sign = "-l %s " % option if shell == "fish" else "--%s" % option
                    expect(sign in part, (shell, program, command, option))


tests.run()
