# SPDX-License-Identifier: MIT
"""No failing call for an interface breaks anything or loses anything in silence.

These tests follow tests/calls/test_calls.py and test_calls_daemon.py, for calls that need a kernel
with CAN: raw sockets, claims of interfaces, netlink. Each site of these calls fails once. In
another run one site of each call in each source file fails with all of its kind from then on.
"""

import fcntl
import itertools
import json
import re
import select
import socket
import struct
import subprocess
import time
from pathlib import Path

import pytest

from canbits import CLASSIC, Frame
from conftest import CANWIRED, PATIENCE_S, CanSocket, assert_balance, wait_until
from depth import some
from failing import Calls, Try, build_library
from test_vcan import CANWIRE, PAIR, PEERS, enter, netns, rig  # pylint: disable=unused-import

FILES = ("socketcan.c", "port.c", "claim.c", "linkwatch.c", "links.c", "loopless.c", "vcan.c")
GROUPS = {"descriptor", "socket", "traffic", "close", "read"}
# Possible errors of the kernel. A link that is down or gone would be reported in another way, too.
ERRORS = {"socket": "EMFILE", "fopen": "EMFILE", "open": "EACCES", "openat": "EACCES",
          "bind": "ENOMEM", "setsockopt": "ENOMEM", "getsockopt": "ENOBUFS", "ioctl": "ENODEV",
          "send": "ENOBUFS", "recv": "ENOBUFS", "recvmsg": "ENOBUFS", "recvmmsg": "ENOMEM",
          "fgets": "EIO", "close": "EIO"}
MUST_TELL = {"fopen", "fgets"}  # frames go through without what they are for
TIMERS = {"on_status"}
FRAMES = 10
SIOCGIFFLAGS, SIOCSIFFLAGS, SIOCGIFMTU = 0x8913, 0x8914, 0x8921
IFF_UP = 1
INTERFACE_REQUEST = struct.Struct("16si20x")


@pytest.fixture(name="calls", scope="module")
def fixture_calls(tmp_path_factory):
    return Calls(tmp_path_factory.mktemp("calls"), build_library())


def callers_of(program, sites):
    """Returns the functions and the source files of the callers, by address."""
    addresses = sorted({f - 1 for site in sites for f in site.frames})
    found = subprocess.run(["addr2line", "-sfe", program, *map(hex, addresses)],
                           capture_output=True, text=True, check=True).stdout.split("\n")
    functions = {a + 1: function for a, function in zip(addresses, found[::2])}
    return functions, {a + 1: line.split(":")[0] for a, line in zip(addresses, found[1::2])}


def tries_of(program, sites):
    """Selects each call in one of FILES once, and one of each call and file from then on. The most
    frequent one stands for all sites with the same two callers. Sites called by a timer are left
    out, since a run may end before. The same calls are made at start and end, too."""
    functions, files = callers_of(program, sites)
    callers, lasting, tries = set(), set(), []
    for site in sorted(sites, key=lambda s: -s.count):
        if any(functions[f] in TIMERS for f in site.frames):
            continue
        ours = [files[f] for f in site.frames[:3] if files[f] in FILES]
        key = site.call, site.frames[:2]
        if site.group not in GROUPS or site.call not in ERRORS or not ours or key in callers:
            continue
        callers.add(key)
        tries.append(Try(site, ERRORS[site.call]))
        # a failed close() has closed all the same: once is enough
        if site.call != "close" and (site.call, ours[0]) not in lasting:
            tries.append(Try(site, ERRORS[site.call], lasting=True))
        lasting.add((site.call, ours[0]))
    return some(tries, 5)


def go_through(program, tries, attempt):
    """Makes all tries. attempt(try) returns the violation, or None, and True when the call was
    reached. The machine decides when frames meet, and which program reads them."""
    begin, found, reached = time.monotonic(), [], set()
    for each in tries:
        wrong, was_reached = attempt(each)
        assert was_reached or each.site.group == "traffic", each.text(program)
        if was_reached:
            reached.add(each.site.call)
        if wrong:
            found.append(f"{wrong}: {each.text(program)}")
    print(f"{len(tries)} runs in {time.monotonic() - begin:.0f} s")
    assert not found, "\n".join(found)
    # Traffic may take another way in each run: a call of it in one run can be missing in the next.
    assert reached >= {each.site.call for each in tries if each.site.group != "traffic"}


# ---- Interfaces ----------------------------------------------------------------------------------


def ask_interface(name, request, value=0):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        packed = fcntl.ioctl(s, request, INTERFACE_REQUEST.pack(name.encode(), value))
        return INTERFACE_REQUEST.unpack(packed)[1]


def set_up(name, up):
    flags = ask_interface(name, SIOCGIFFLAGS) & 0xFFFF
    ask_interface(name, SIOCSIFFLAGS, flags | IFF_UP if up else flags & ~IFF_UP)


# ---- canwired ------------------------------------------------------------------------------------

BUS = """
bus: { name: calls, bitrate: 500000 }
control: calls.sock
nodes:
  - { name: engine, port: vcan0 }
  - { name: gearbox, port: vcan1 }
"""


class Ended(Exception):
    """Reports that canwired has ended by itself."""


class Run:
    """A canwired at two interfaces, from its start to its end; one of them is down for a while."""

    def __init__(self, launch, calls, known=frozenset()):
        self.calls, self.known = calls, known
        self.sent, self.received, self.failed = 0, 0, 0
        self.nodes, self.status = {}, None
        self.daemon = launch(BUS, **calls.environment())
        self.control = self.daemon.config.parent / "calls.sock"
        self.ecus = [CanSocket("vcan0"), CanSocket("vcan1")]
        try:
            self.go()
        except Ended:
            pass
        finally:
            if not self.has_ended():
                self.daemon.process.terminate()
            self.returned = self.daemon.wait()
            self.receive_rest()
            for each in self.ecus:
                each.close()
        self.failed += calls.failed()
        self.text = self.daemon.stderr()

    # ---- Steps

    def has_ended(self):
        return self.daemon.process.poll() is not None

    def lift(self):
        """Calls are good again."""
        self.failed += self.calls.failed()
        self.calls.order(False)

    def news(self):
        """Returns messages that a run without failures does not have, other than those of a slow
        machine."""
        return {re.sub(r"\d+", "#", line) for line in self.daemon.stderr().splitlines()
                if "the bus fell behind real time" not in line} - self.known

    def go(self):
        wait_until(lambda: self.daemon.notified("READY=1") or self.has_ended()
                   or (self.calls.failed() and self.listens()), "READY=1")
        self.ask()
        self.exchange()
        set_up("vcan1", False)
        self.wait(lambda: self.nodes["gearbox"]["link"] != "up")
        set_up("vcan1", True)
        self.wait(lambda: self.nodes["gearbox"]["link"] == "up")
        self.exchange()
        self.status = self.ask()  # that of before may be older than the last frame

    def exchange(self):
        """Sends frames from one ECU to the other; all arrive, or a message reports the loss."""
        for number in range(FRAMES):
            self.ecus[0].send(Frame(0x100, 1, bytes([number])))
            self.sent += 1
        self.wait(lambda: self.receive() == self.sent)

    def receive(self):
        """Returns the number of frames so far."""
        try:
            while self.ecus[1].socket.recv(CLASSIC.size):
                self.received += 1
        except BlockingIOError:
            return self.received
        except OSError:  # the interface was down, which is reported once
            return self.receive()

    def receive_rest(self):
        """Waits for the frames of the daemon, which pass through the kernel on their own."""
        interface = self.status and self.status["gearbox"]["interface"]
        written, deadline = interface["written"] if interface else 0, time.monotonic() + PATIENCE_S
        while self.receive() < written and time.monotonic() < deadline:
            time.sleep(0.01)

    def wait(self, condition):
        """Waits until the condition holds, or a message comes, and no frame is under way."""
        def settled():
            self.nodes = self.ask()
            under_way = sum(n["queue"] + n["inbox"] for n in self.nodes.values()
                            if n["link"] == "up")
            return condition() or (self.news() and not under_way)

        wait_until(settled, "what is to come, or a message")

    def ask(self):
        """Returns the nodes' status. Its own calls may fail, too; they work from then on."""
        for _ in range(5):
            if self.has_ended():
                raise Ended
            try:
                reply = self.request()
            except OSError:
                reply = b""
            if b'"status"' in reply and reply.endswith(b"\n"):
                return {n["name"]: n for n in json.loads(reply)["status"]["nodes"]}
            self.lift()
        raise AssertionError("it does not answer")

    def listens(self):
        """Returns True when canwired still listens; it may be unable to notify, since these calls
        fail, too."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            return client.connect_ex(str(self.control)) == 0

    def request(self):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.settimeout(PATIENCE_S)
            client.connect(str(self.control))
            client.sendall(b'{"request":"status"}\n')
            poll = select.poll()
            poll.register(client, select.POLLIN)
            while not poll.poll(50):
                if "no connection can be accepted" in self.daemon.stderr():
                    self.lift()
            return client.makefile("rb").readline()

    # ---- What there is in the end

    def wrong(self):
        """Returns a violation, or None."""
        if self.returned < 0:
            return f"it crashes: {self.returned}"
        if self.status is None:
            return None if self.returned == 1 and self.news() else "no message of its end"
        for node in self.status.values():
            assert_balance(node)
        if self.returned != 0:
            return f"status {self.returned}"
        interface = self.status["gearbox"]["interface"]
        if interface and self.received < interface["written"]:
            return f"{self.received} frames came, of {interface['written']}"
        all_well = self.received == self.sent and interface["written"] == self.sent
        return None if all_well or self.news() else "in silence: frames are missing"

    def failed_reads(self):
        """Returns True for counted failures of reads, or when canwired has not come to reading."""
        if self.status is None:
            return True
        return any((node["interface"] or {}).get("read_failed") for node in self.status.values())



def test_canwired(vcan, launch, calls):
    vcan(2)
    calls.list_sites()
    good = Run(launch, calls)
    assert good.wrong() is None and good.received == good.sent == 2 * FRAMES, good.text
    known = {re.sub(r"\d+", "#", line) for line in good.text.splitlines()}
    sites = calls.sites()
    assert {s.call for s in sites} >= {"socket", "bind", "setsockopt", "ioctl", "send", "recvmmsg",
                                       "recvmsg", "fopen"}
    tries = tries_of(CANWIRED, sites)
    assert tries

    def attempt(each):
        set_up("vcan1", True)
        calls.fail(each)
        run = Run(launch, calls, known)
        wrong = run.wrong()
        if not wrong and each.site.call in MUST_TELL and not run.news():
            wrong = "in silence: what was to be read is not known"
        if not wrong and each.site.call == "recvmmsg" and not run.failed_reads():
            wrong = "in silence: a read that failed is not counted"
        return wrong, run.failed > 0

    go_through(CANWIRED, tries, attempt)


# ---- canwire vcan --------------------------------------------------------------------------------


def run_vcan(verb, file, environment=None):
    return subprocess.run([CANWIRE, "vcan", verb, file], capture_output=True, text=True,
                          env=environment, timeout=PATIENCE_S, check=False)


def seen_here():
    """Interfaces of the namespace that this thread is in, with MTU, and whether they are up."""
    return {name: (bool(ask_interface(name, SIOCGIFFLAGS) & IFF_UP),
                   ask_interface(name, SIOCGIFMTU)) for _, name in socket.if_nameindex()}


def interfaces():
    """Returns all interfaces with their state, also in the namespaces; here also with their
    alias."""
    found = {None: seen_here()}
    found["alias"] = {name: Path(f"/sys/class/net/{name}/ifalias").read_text(encoding="utf-8")
                      for name in found[None]}
    with open("/proc/thread-self/ns/net", encoding="ascii") as here:
        try:
            for namespace in "ecu1", "ecu2":
                enter(f"/run/netns/{namespace}")
                found[namespace] = seen_here()
        finally:
            enter(f"/proc/self/fd/{here.fileno()}")
    return found


@pytest.mark.parametrize("verb", ["up", "down"])
def test_canwire_vcan(verb, rig, netns, calls):  # pylint: disable=redefined-outer-name
    """A failure is reported, and another call without failures repairs it."""
    netns("ecu1", "ecu2")
    rig.file.write_text(PEERS + "  - { name: d, port: v4 }\n")
    none = interfaces()
    other = "down" if verb == "up" else "up"
    assert run_vcan(other, rig.file).returncode == 0
    before = interfaces()
    calls.list_sites()
    good = run_vcan(verb, rig.file, calls.environment())
    assert good.returncode == 0
    sites, done = calls.sites(), interfaces()
    tries = tries_of(CANWIRE, sites)
    assert {s.call for s in sites} >= {"socket", "send", "recv"}

    def attempt(each):
        calls.order(False)
        if interfaces() != before:
            turned = run_vcan(other, rig.file)
            assert turned.returncode == 0 and interfaces() == before, turned
        calls.fail(each)
        run = run_vcan(verb, rig.file, calls.environment())
        return wrong_with(run), calls.failed() > 0

    def wrong_with(run):
        if run.returncode < 0 or "Sanitizer" in run.stderr:
            return f"it crashes: {run.returncode}, {run.stderr}"
        now = interfaces()
        if run.returncode == 0:
            return None if now == done else f"status 0, but {now}"
        if not set(run.stderr.splitlines()) - set(good.stderr.splitlines()):
            return "no message"
        if now == before:
            return None
        for name in re.findall("ip link del (.*)\\)", run.stderr):  # it could not itself
            subprocess.run(["ip", "link", "del", name], check=False)
        again = run_vcan(verb, rig.file)
        if again.returncode != 0 or interfaces() != done:
            return f"after {run.stderr!r} again: {again.returncode}, {again.stderr!r}"
        return None

    go_through(CANWIRE, tries, attempt)
    assert run_vcan("down", rig.file).returncode == 0
    assert interfaces() == none


@pytest.mark.deep
def test_an_mtu_that_does_not_change(rig, calls):  # pylint: disable=redefined-outer-name
    """The interface is down for a moment. When a request fails, it is as before; when only the
    answer is lost, the change may have been made."""
    rig("up", PAIR)
    assert seen_here()["v0"] == (True, 16)
    rig.file.write_text(PAIR.replace("500000", "500000, dbitrate: 2000000"))
    calls.list_sites()
    assert run_vcan("up", rig.file, calls.environment()).returncode == 0
    assert seen_here()["v0"] == (True, 72)
    sites = calls.sites()
    functions, _ = callers_of(CANWIRE, sites)
    ours = [s for s in sites
            if s.call in ("send", "recv") and "links_set_mtu" in map(functions.get, s.frames)]
    assert [s.call for s in ours].count("send") >= 3 <= [s.call for s in ours].count("recv")
    fd_file = rig.file.read_text()
    for site, up in itertools.product(ours, (True, False)):
        calls.order(False)
        rig("up", PAIR)
        subprocess.run(["ip", "link", "set", "v0", "up" if up else "down"], check=True)
        before = seen_here()
        assert before["v0"] == (up, 16)
        rig.file.write_text(fd_file)
        calls.fail(Try(site, "ENOBUFS"))
        run = run_vcan("up", rig.file, calls.environment())
        assert calls.failed() == 1 and run.returncode == 1
        assert "No buffer space available" in run.stderr
        after = seen_here()
        done = site.call == "recv" and after["v0"] == (True, 72)
        assert after == (before | {"v0": (True, 72)} if done else before)
