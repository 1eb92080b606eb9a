"""What deploy/systemd allows the programs is what they need: a page that is kept from files, and scenes that come by it."""
import ctypes
import glob
import os
import shutil
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, ROOT, Farm, Program, Skip, Tests, read_bytes, wait_for
from jobs import expect
from page import Page, need_page

tests = Tests()
UNITS = os.path.join(ROOT, "deploy", "systemd")
UNDER = os.path.join(ROOT, "tests", "farm", "under_unit.py")
LANDLOCK_CREATE_RULESET, VERSION = 444, 1


def under(unit):
    if not shutil.which("systemd-analyze"):
        raise Skip("there is no systemd-analyze")
    return [sys.executable, "-B", UNDER, os.path.join(UNITS, unit)]


def has_landlock():
    return ctypes.CDLL(None).syscall(LANDLOCK_CREATE_RULESET, None, 0, VERSION) >= 2


def upload(farm, page):
    """A scene that comes by the page is rendered."""
    number = wait_for(lambda: page.post("/api/v1/imports").json().get("import"), "the page's own connection")
    answer = page.request("PUT", "/api/v1/imports/%s/files/a.gltf" % number, body=read_bytes(farm.scene()))
    expect(answer.status == 201, answer)
    answer = page.post("/api/v1/imports/%s" % number, {"scene": "a.gltf", "options": ["--size", "32x24", "--spp", "1"]})
    expect(answer.status in (200, 201, 202), answer)
    wait_for(lambda: page.get("/api/v1/jobs").json()["jobs"][0]["state"] == "done", "the job")


def start_worker(farm):
    farm.programs.append(Program("worker", under("azulejo-worker.service") + [
        os.path.join(BIN, "azulejo-worker"), "--coordinator", farm.address, "--key", farm.key, "--threads", "1", "--cache",
        farm.path("cache")], farm.path("worker.log")))
    farm.wait_for_workers(1)


def expect_kept(log):
    expect("files are not kept" not in log or not has_landlock(), log)


@tests.add
def page_of_its_own():
    """the coordinator, the page and a worker, each under its unit's filter"""
    need_page()
    with Farm() as farm:
        farm.start_coordinator("--web-apart", prefix=under("azulejo-coordinator.service"))
        key = farm.path("web.key")
        farm.cli("keygen", "--role", "web", "--from", farm.key, "-o", key, expect=0)
        web = Program("web", under("azulejo-web.service") + [
            os.path.join(BIN, "azulejo-web"), "--coordinator", farm.address, "--key", key, "--web", "127.0.0.1:0", "--folder",
            farm.path("page")], farm.path("web.log"))
        farm.programs.append(web)
        page = Page(farm.coordinator)
        start_worker(farm)
        upload(farm, page)
        expect_kept(web.log_text())


@tests.add
def page_of_the_coordinator():
    """a coordinator that starts the page itself"""
    need_page()
    with Farm() as farm:
        page = Page(farm.start_coordinator("--web", "127.0.0.1:0", prefix=under("azulejo-coordinator.service")))
        start_worker(farm)
        upload(farm, page)
        expect_kept(farm.coordinator.log_text())


@tests.add
def read_by_systemd():
    """systemd reads the units without a complaint, but for the programs, which are not installed"""
    if not shutil.which("systemd-analyze"):
        raise Skip("there is no systemd-analyze")
    for unit in sorted(glob.glob(os.path.join(UNITS, "*"))):
        done = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True, check=False)
        wrong = [l for l in done.stderr.splitlines() if "is not executable: No such file" not in l]
        expect(not wrong, "%s: %s" % (unit, wrong))


if __name__ == "__main__":
    tests.run()
