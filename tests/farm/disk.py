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


class OddDisk:
    """A coordinator's calls on files that fail at a test's word; start it with env=disk.env. slow: removing a file
    of more than 1 MiB takes so many seconds."""

    def __init__(self, farm, slow=0):
        if not os.path.exists(ODD_DISK):
            raise Skip("odd_disk.so is not built")
        self.control = farm.path("odd-disk")
        # A sanitizer's runtime wants to be loaded first, and would leave when it is not.
        options = os.environ.get("ASAN_OPTIONS", "")
        self.env = {"ODD_DISK": self.control, "LD_PRELOAD": ODD_DISK,
                    "ASAN_OPTIONS": options + ("" if PATIENCE == 1 else
                                               ":verify_asan_link_order=0")}
        if slow:
            self.env["SLOW_REMOVAL"] = "%d,%d" % (slow * 1000, 1 << 20)

    def fail(self, number, text, kind="write"):
        with open(self.control + ".new", "w") as out:
            out.write("%d %s %s" % (number, kind, text))
        os.rename(self.control + ".new", self.control)

    def work(self):
        os.unlink(self.control)

    @contextlib.contextmanager
    def fast(self):
        """Meanwhile removing takes no time, neither what begins nor what is under way."""
        with open(self.control + "-fast", "w"):
            pass
        yield
        os.unlink(self.control + "-fast")


class StalledDisk(OddDisk):
    """A disk that hangs at a test's word: while it does, no call returns that syncs, or writes at a place, in a file
    whose path has `text`."""

    def __init__(self, farm):
        super().__init__(farm)
        self.stalled = farm.path("stalled-disk")
        self.env["STALLED_DISK"] = self.stalled

    def hang(self, text="/store/"):
        with open(self.stalled + ".new", "w") as out:
            out.write(text)
        os.rename(self.stalled + ".new", self.stalled)

    def go_on(self):
        if os.path.exists(self.stalled):
            os.unlink(self.stalled)
