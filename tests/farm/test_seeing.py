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
                                        env=dict(os.environ, TERM="xterm"), start_new_session=True,
                                        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0))
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
            screen.wait_text(rb"\n\r\x1b\[K  [^\n]*, process %d\)   1 thread   [^\n]* samples/s   \d+ units" %
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


@tests.add
def watch_says_why_a_job_waits():
    """on a terminal of any width the line has the reason whole; its place, its name and its state are left out before that"""
    with Farm() as farm:
        farm.start_coordinator()
        number = farm.submit(farm.scene(), *SMALL, "-o", "shot")
        for columns, line in ((100, rb"shot  [0-9.:]+ ?s?  queued, number 1 in the queue: "), (75, rb"shot  [0-9.:]+ ?s?  queued: "),
                              (47, rb"0% queued: "), (40, rb"0% ")):
            with Screen(farm.cli_argv("watch", number), columns=columns) as screen:
                screen.wait_text(line + rb"waits: no worker is connected\r")


@tests.add
def top_shows_the_farm():
    """top prints jobs in the order of service and workers; on a terminal again and again, until q"""
    with Farm() as farm:
        farm.start_coordinator()
        result = farm.cli("top", "--once", expect=0)
        expect("no jobs; 0 workers" in result.out and "\x1b" not in result.out, result)
        jobs = [farm.submit(farm.scene(), *LONG, "-o", "job-%d" % i) for i in range(60)]
        farm.cli("priority", jobs[-1], "--to", "5", "--yes", expect=0)
        farm.cli("pause", jobs[3], expect=0)
        farm.start_worker()
        farm.wait_for_job(jobs[-1], "running")
        wait_for(lambda: farm.list_workers()[0]["samples_per_second"] > 0, "a rate")
        out = farm.cli("top", "--once", expect=0).out
        expect("1 running, 58 queued, 1 paused" in out.replace("58 queued, 1 running", "1 running, 58 queued"),
               out)
        expect("1 worker, 1 busy, 1 thread;" in out, out)
        rows = re.findall(r"^ *(\d+) +job-(\d+) +(\d+)", out, re.M)
        # Paused: it is not in the order of service, so it comes after all that are.
        expect([int(row[1]) for row in rows] == [59] + [i for i in range(50) if i != 3], rows)
        expect(rows[0][2] == "5" and "... and 10 more" in out, out)
        name = farm.list_workers()[0]["name"]
        expect(re.search(r"^%s +working +1 +\S.* %d +" % (re.escape(name), jobs[-1]), out, re.M), out)
        # In a pipe it comes again and again.
        pipe = farm.start_cli("top", "--interval", "0.1")
        try:
            for _ in range(3):
                wait_for(lambda: b"azulejo top: " in pipe.stdout.readline(), "another one")
        finally:
            pipe.terminate()
            pipe.communicate(timeout=60)
        # On a terminal: one screen, and the terminal as it was when it ends.
        for columns, end in ((80, lambda s: s.write(b"q")), (72, lambda s: s.process.send_signal(signal.SIGINT))):
            with Screen(farm.cli_argv("top", "--interval", "0.1"), rows=20, columns=columns) as screen:
                screen.wait_text(rb"(?s)\x1b\[\?1049h\x1b\[\?25l.*\x1b\[H\x1b\[2J.*\x1b\[H\x1b\[2J.*more")
                expect(not screen.settings_are_restored(), "keys would be seen")
                pictures = screen.seen.split(b"\x1b[H\x1b[2J")
                lines = pictures[1].decode().splitlines()
                expect(len(lines) < 20 and all(len(line) <= 80 for line in lines), lines)
                expect(all(len(line) <= columns for line in lines[3:]), lines)
                expect("waits " in lines[5], lines[5])
                end(screen)
                expect(screen.end() in (0, 130), screen.process.returncode)
                expect(screen.seen.endswith(b"\x1b[?25h\x1b[?1049l"), screen.seen[-100:])
                expect(screen.settings_are_restored(), "the terminal's settings")
        # The coordinator goes away and comes back.
        with Screen(farm.cli_argv("top", "--interval", "0.1")) as screen:
            screen.wait_text(rb"1 running")
            farm.coordinator.kill()
            screen.wait_text(rb"trying again")
            farm.restart_coordinator()
            gone = len(screen.read())
            wait_for(lambda: b"queued" in screen.read()[gone:], "its answer")
            screen.write(b"q")
            expect(screen.end() == 0, screen.process.returncode)
        farm.coordinator.kill()
        farm.cli("top", "--once", expect=4)


if __name__ == "__main__":
    tests.run()
