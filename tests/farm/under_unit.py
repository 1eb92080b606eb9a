"""Run a program with the system calls that a systemd unit allows it; all others fail with EPERM.

    under_unit.py UNIT PROGRAM [ARGUMENT]...

What `SystemCallFilter=` of the unit names is taken from `systemd-analyze syscall-filter`, and made a filter of the
kernel's. The unit's other lines have no effect."""
import ctypes
import os
import re
import struct
import subprocess
import sys

PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER = 38, 22, 2
ALLOW, REFUSE = 0x7FFF0000, 0x00050000 | 1  # with EPERM
LOAD, JUMP_IF_EQUAL, RETURN = 0x20, 0x15, 0x06


def groups():
    """Name -> its system calls, with those of the groups in it."""
    text = subprocess.run(["systemd-analyze", "syscall-filter"], capture_output=True, text=True, check=True).stdout
    found, name = {}, None
    for line in text.splitlines():
        if line.startswith("@"):
            name = line.strip()
            found[name] = []
        elif line.startswith("    ") and name and not line.strip().startswith("#"):
            found[name].append(line.strip())

    def calls(word):
        return set().union(*(calls(w) for w in found[word])) if word in found else {word}
    return calls


def allowed(unit):
    calls, names = groups(), set()
    with open(unit, encoding="utf-8") as source:
        for line in source:
            match = re.match(r"SystemCallFilter=(~?)(.*)", line)
            if match:
                words = set().union(*(calls(w) for w in match.group(2).split()))
                names = names - words if match.group(1) else names | words
    return names


def numbers():
    text = subprocess.run(["cc", "-dM", "-E", "-x", "c", "-"], input="#include <sys/syscall.h>\n", capture_output=True,
                          text=True, check=True).stdout
    return {name: int(number) for name, number in re.findall(r"#define __NR_(\w+) (\d+)", text)}


def filter_calls(names):
    known = numbers()
    code = [(LOAD, 0, 0, 0)]
    for number in sorted(known[n] for n in names if n in known):
        code += [(JUMP_IF_EQUAL, 0, 1, number), (RETURN, 0, 0, ALLOW)]
    code.append((RETURN, 0, 0, REFUSE))
    packed = b"".join(struct.pack("HBBI", *c) for c in code)
    block = ctypes.create_string_buffer(packed)
    program = struct.pack("HxxxxxxP", len(code), ctypes.addressof(block))
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) or libc.prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, program, 0, 0):
        sys.exit("under_unit.py: %s" % os.strerror(ctypes.get_errno()))


if __name__ == "__main__":
    filter_calls(allowed(sys.argv[1]))
    os.execv(sys.argv[2], sys.argv[2:])
