"""Disks that go wrong: small ones that fill up or become read-only, which only root can mount, and
ones whose every call fails as a test wants (odd_disk.c), which need no rights."""
import contextlib
import ctypes
import fcntl
import os
import shutil
import struct
import subprocess
import tempfile

from farm import PATIENCE, Clients, Failure, Skip, wait_for, preloaded

ODD_DISK = preloaded("odd_disk.so")
CONTROL_BYTES = 256  # as in odd_disk.c
CLONE_NEWNS = 0x20000


def leave_mounts():
    """From here on this process and its children mount where nobody else sees it; False: not allowed."""
    if os.geteuid() != 0 or ctypes.CDLL(None).unshare(CLONE_NEWNS) != 0:
        return False
    Clients.leave()
    return subprocess.run(["mount", "--make-rprivate", "/"],
                          stderr=subprocess.DEVNULL).returncode == 0


class SmallDisk:
    """A file system of so many bytes; entered as None where mounting is not permitted."""

    def __init__(self, farm, size):
        self.folder, self.size = farm.path("disk"), size

    def __enter__(self):
        os.makedirs(self.folder, exist_ok=True)
        self.mounted = leave_mounts() and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=%d,mode=700" % self.size, "azulejo-test",
             self.folder], stderr=subprocess.DEVNULL).returncode == 0
        return self.folder if self.mounted else None

    def __exit__(self, *_):
        if self.mounted:
            subprocess.run(["umount", "-l", self.folder], check=True)

    def remount(self, how):
        subprocess.run(["mount", "-o", "remount," + how, self.folder], check=True)


class PowerDisk:
    """An ext4 on a loop device that loses its power at a test's word: what was not synced is gone, as with a machine's.
    Entered as None where that is not permitted. The programs that use it end inside of the `with`."""

    SHUTDOWN, NO_LOG_FLUSH = 0x8004587d, 2  # FS_IOC_SHUTDOWN, EXT4_GOING_FLAGS_NOLOGFLUSH
    NEEDS = "root, loop devices and mkfs.ext4"

    def __enter__(self):
        self.place = tempfile.mkdtemp(prefix="azulejo-power-")
        self.image, self.folder = os.path.join(self.place, "disk"), os.path.join(self.place, "store")
        os.mkdir(self.folder)
        with open(self.image, "wb") as out:
            out.truncate(256 << 20)
        self.mounted = leave_mounts() and shutil.which("mkfs.ext4") is not None and \
            subprocess.run(["mkfs.ext4", "-q", self.image], stderr=subprocess.DEVNULL).returncode == 0 and self.mount()
        return self if self.mounted else None

    def mount(self):
        return subprocess.run(["mount", "-o", "loop", self.image, self.folder], stderr=subprocess.DEVNULL).returncode == 0

    def cut(self):
        """From now on nothing reaches the disk."""
        folder = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.ioctl(folder, self.SHUTDOWN, struct.pack("I", self.NO_LOG_FLUSH))
        finally:
            os.close(folder)

    def on(self):
        """Again, once all that used it have died with it. The journal is replayed."""
        wait_for(lambda: subprocess.run(["umount", self.folder], stderr=subprocess.DEVNULL).returncode == 0, "the disk's users to die")
        if not self.mount():
            raise Failure("the disk cannot be mounted after a power cut")

    def __exit__(self, *_):
        if self.mounted:
            subprocess.run(["umount", "-l", self.folder], check=True)
        shutil.rmtree(self.place, ignore_errors=True)


def fill_up(path):
    """Leave no page of the disk free; its folders still take new names."""
    with open(path, "wb", buffering=0) as filler:
        try:
            while filler.write(b"x" * 4096):
                pass
        except OSError:
            pass


def control(path):
    """The path, of a file with which a test tells odd_disk.c what to do: nothing yet."""
    with open(path, "wb") as out:
        out.write(bytes(CONTROL_BYTES))
    return path


def say(path, text):
    """Programs have it mapped: it is written in place, its first byte last."""
    text = text.encode().ljust(CONTROL_BYTES, b"\0")
    assert len(text) == CONTROL_BYTES, text
    with open(path, "r+b", buffering=0) as out:
        for at, part in ((0, b"\0"), (1, text[1:]), (0, text[:1])):
            os.pwrite(out.fileno(), part, at)


class OddDisk:
    """A coordinator's calls on files that fail at a test's word; start it with env=disk.env. slow: removing a file
    of more than 1 MiB takes so many seconds."""

    def __init__(self, farm, slow=0):
        if not os.path.exists(ODD_DISK):
            raise Skip("odd_disk.so is not built")
        self.control = control(farm.path("odd-disk"))
        # A sanitizer's runtime wants to be loaded first, and would leave when it is not.
        options = os.environ.get("ASAN_OPTIONS", "")
        self.env = {"ODD_DISK": self.control, "LD_PRELOAD": ODD_DISK,
                    "ASAN_OPTIONS": options + ("" if PATIENCE == 1 else
                                               ":verify_asan_link_order=0")}
        if slow:
            self.env["SLOW_REMOVAL"] = "%d,%d" % (slow * 1000, 1 << 20)

    def fail(self, number, text, kind="write"):
        say(self.control, "%d %s %s" % (number, kind, text))

    def work(self):
        say(self.control, "")

    @contextlib.contextmanager
    def fast(self):
        """Meanwhile removing takes no time, neither what begins nor what is under way."""
        with open(self.control + "-fast", "w"):
            pass
        yield
        os.unlink(self.control + "-fast")


class StalledDisk(OddDisk):
    """A disk that hangs at a test's word: while it does, no call returns that syncs, or writes at a place, in a file
    whose path has `text`; after "data " no fdatasync."""

    def __init__(self, farm):
        super().__init__(farm)
        self.stalled = control(farm.path("stalled-disk"))
        self.env["STALLED_DISK"] = self.stalled

    def hang(self, text="/store/"):
        say(self.stalled, text)

    def go_on(self):
        say(self.stalled, "")
