"""Where a coordinator and its page listen: on every address of the name that they are given."""
import http.client
import os
import signal
import socket
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
from farm import BIN, BUILD, Farm, PATIENCE, Tests, wait_for
from jobs import expect

tests = Tests()
HAS_PAGE = "noweb" not in BUILD


def listener(host):
    """A socket that listens at any port of that address; None: the machine does not have it."""
    found = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    try:
        found.bind((host, 0))
    except OSError:
        found.close()
        return None
    found.listen()
    return found


def has_ipv6():
    probe = listener("::1")
    if not probe:
        print("  this machine has no IPv6: 127.0.0.1 alone is tried")
        return False
    probe.close()
    return True


def addresses(port):
    return ["127.0.0.1:%s" % port] + ["[::1]:%s" % port] * has_ipv6()


def answers(farm, address):
    return subprocess.run([os.path.join(BIN, "azulejo"), "list", "--coordinator", address, "--key", farm.key],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60 * PATIENCE).returncode == 0


def refusal(farm, *options):
    """The message and the exit status of a coordinator that does not start."""
    done = subprocess.run([os.path.join(BIN, "azulejo-coordinator"), "--key", farm.key, "--store", farm.path("other")] +
                          list(options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60 * PATIENCE)
    return done.stderr.decode().strip().splitlines()[-1], done.returncode


@tests.add
def both():
    """--listen localhost: both addresses answer on one port, also after more connections than a turn takes"""
    with Farm() as farm:
        coordinator = farm.start_coordinator("--no-web", listen="localhost:0")
        port = int(farm.address.rsplit(":", 1)[1])
        wanted = addresses(port)
        expect(farm.address == wanted[0], farm.address)
        expect("listening on %s, store" % " and ".join(wanted) in coordinator.log_text(), coordinator.log_text())
        for address in wanted:
            expect(answers(farm, address), address)
        coordinator.signal(signal.SIGSTOP)
        crowd = [socket.create_connection((address.rsplit(":", 1)[0].strip("[]"), port)) for address in wanted for _ in range(150)]
        coordinator.signal(signal.SIGCONT)
        for peer in crowd:
            peer.close()
        for address in wanted:
            wait_for(lambda: answers(farm, address), address)


@tests.add
def page():
    """--web localhost: the page answers on both addresses"""
    if not HAS_PAGE:
        return
    with Farm() as farm:
        coordinator = farm.start_coordinator("--web", "localhost:0", listen="localhost:0")
        port = int(coordinator.wait_line("page: http://localhost:").split("/")[0])
        for address in addresses(port):
            peer = http.client.HTTPConnection(address.rsplit(":", 1)[0].strip("[]"), port, timeout=20)
            peer.request("GET", "/", headers={"Host": address})
            expect(peer.getresponse().status == 200, address)
            peer.close()


@tests.add
def busy():
    """an address of the name that is in use is an error that names it, and a name that nobody knows is one"""
    with Farm() as farm:
        for host in ["127.0.0.1"] + ["::1"] * has_ipv6():
            taken = listener(host)
            port = taken.getsockname()[1]
            name = ("[%s]:%d" if ":" in host else "%s:%d") % (host, port)
            text, code = refusal(farm, "--no-web", "--listen", "localhost:%d" % port)
            expect(code == 8 and name + " is in use" in text and "--listen" in text, (text, code))
            if HAS_PAGE:
                text, code = refusal(farm, "--listen", "127.0.0.1:0", "--web", "localhost:%d" % port)
                expect(code != 0 and name + " is in use" in text and "--web" in text, (text, code))
            taken.close()
        text, code = refusal(farm, "--no-web", "--listen", "no-such-host.invalid:0")
        expect(code == 8 and "--listen no-such-host.invalid: " in text, (text, code))
        if HAS_PAGE:
            text, code = refusal(farm, "--listen", "127.0.0.1:0", "--web", "no-such-host.invalid:0")
            expect(code != 0 and "--web no-such-host.invalid: " in text, (text, code))


tests.run()
