#!/usr/bin/env python3
"""What people see of a farm: watch, list and top."""
import contextlib
import fcntl
import os
import pty
import re
import signal
import sqlite3
import struct
import subprocess
import termios

from farm import Farm, Tests, wait_for
from jobs import expect

tests = Tests()
SMALL = ["--size", "32x32", "--spp", "4", "--max-depth", "3"]
LONG = ["--size", "256x256", "--spp", "100000"]


class Screen:
    """A command on a terminal of its own; `seen` grows as it writes."""

    def __init__(self, argv, rows=24, columns=100):
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("4H", rows, columns, 0, 0))
        self.before = termios.tcgetattr(slave)
        self.slave = slave
        self.seen = b""
        self.process = subprocess.Popen(argv, stdin=slave, stdout=slave, stderr=slave,
                                        env=dict(os.environ, TERM="xterm"), start_new_session=True)
        os.set_blocking(self.master, False)

    def read(self):
        with contextlib.suppress(BlockingIOError, OSError):
            while True:
                self.seen += os.read(self.master, 65536)
        return self.seen

    def wait_text(self, pattern):
        return wait_for(lambda: re.search(pattern, self.read()), pattern)

    def write(self, data):
        os.write(self.master, data)

    def end(self):
        """Its exit status, when it has ended."""
        code = self.process.wait(60)
        self.read()
        return code

    def settings_are_restored(self):
        return termios.tcgetattr(self.slave) == self.before

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        os.close(self.slave)
        os.close(self.master)


@tests.add
def watch_says_which_job_and_who_renders_it():
    """watch shows name, time and place in the queue; with --workers a line for each worker"""
    with Farm() as farm:
        farm.start_coordinator()
        first = farm.submit(farm.scene(), *LONG, "-o", "first")
        second = farm.submit(farm.scene(), *LONG, "-o", "second")
        expect(farm.job(first)["queue_position"] == 1 and farm.job(second)["queue_position"] == 2,
               "places")
        with Screen(farm.cli_argv("watch", second, "--workers")) as screen:
            screen.wait_text(rb"second  [0-9.:]+ ?s?  queued, number 2 in the queue: waits: no worker")
            farm.start_worker()
            screen.wait_text(rb"number 2 in the queue: waits behind 1 job")
            farm.cli("cancel", first, "--discard", expect=0)
            screen.wait_text(rb"\n\r\x1b\[K  [^\n]*, process %d   1 thread   [^\n]* samples/s   \d+ units" %
                             farm.workers[0].pid)
            # The line above is redrawn, so the cursor goes back up.
            screen.wait_text(rb"\x1b\[1A\r")
            # The coordinator dies and comes back: watch goes on.
            farm.coordinator.kill()
            screen.wait_text(rb"waiting up to 10:00")
            farm.restart_coordinator()
            screen.wait_text(rb"is back")
            back = len(screen.read())
            wait_for(lambda: b"process %d" % farm.workers[0].pid in screen.read()[back:], "its worker")
            screen.process.send_signal(signal.SIGINT)
            expect(screen.end() == 130, screen.seen)
        expect(farm.job(second)["state"] == "running", "it goes on")
        expect(farm.job(first)["queue_position"] == 0, "it has ended")


if __name__ == "__main__":
    tests.run()
