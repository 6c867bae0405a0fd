# SPDX-License-Identifier: MIT
"""The shared parts of the tests on real vcan: interfaces, a running canwired, CAN sockets, LCM.

Run with: scripts/guest -- build/venv/bin/python -m pytest tests/kernel The tests fail without
AF_CAN; they are never skipped.
"""

import contextlib
import importlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import lcm
import pytest

import rtnetlink
from canbits import CLASSIC, Frame

pytest_plugins = ["depth", "hang"]

ROOT = Path(__file__).resolve().parents[2]
CANWIRED = os.environ.get("CANWIRED") or ROOT / "build/release/canwired"
PATIENCE_S = 30  # until something that must come counts as missing; not a measure of speed
RECEIVE_BUFFER_BYTES = 256 << 20  # a frame takes about 800 in the kernel
SO_RCVBUFFORCE = 33
MULTICAST_ROUTE = "224.0.0.0/4 dev lo"


def needs_adapters(item):
    if item.path.name == "test_usb.py":
        return item.name != "test_usb_in_the_guest"
    return hasattr(item, "callspec") and "usb" in item.callspec.params.values()


def pytest_collection_modifyitems(items):
    """Adapters appear in the initial network namespace: a host runs their tests in a guest."""
    if os.environ.get("CANWIRE_PLACE") == "host":
        items[:] = [item for item in items if not needs_adapters(item)]


def ip(*lines):
    """Runs `ip` commands, one a line."""
    if rtnetlink.change(lines):
        return
    text = "\n".join(lines) + "\n"
    subprocess.run(["ip", "-batch", "-"], input=text, text=True, check=True)


def wait_until(condition, what, timeout_s=PATIENCE_S):
    """Returns the first true value of condition(). It looks less often as time goes by, since a
    look may cost more in the guest than all else."""
    deadline, pause_s = time.monotonic() + timeout_s, 0.01
    while not (value := condition()):
        assert time.monotonic() < deadline, f"waited {timeout_s} s for {what}"
        time.sleep(pause_s)  # no wait: it looks again
        pause_s = min(pause_s * 1.5, 0.2)
    return value


def ask_status(path):
    """Returns what `canwire status --json` shows, without a process: its start takes far longer in
    the guest than the answer."""
    with socket.socket(socket.AF_UNIX) as control:
        control.settimeout(PATIENCE_S)
        control.connect(str(path))
        control.sendall(b'{"request":"status"}\n')
        with control.makefile() as lines:
            answer = json.loads(lines.readline())
    assert answer["ok"], answer
    return answer["status"]


def listeners(interface, kind="all"):
    """Returns the number of sockets that read an interface: all frames, or those of "err"."""
    lists = Path(f"/proc/net/can/rcvlist_{kind}").read_text(encoding="ascii")
    return sum(line.split()[:1] == [interface] for line in lists.splitlines())


@pytest.fixture
def vcan():
    """vcan(2) makes vcan0 and vcan1; mtu=72 lets FD frames through."""
    made = []

    def make(count, mtu=16):
        names = [f"vcan{i}" for i in range(count)]
        ip(*(f"link add {n} type vcan" for n in names))
        made.extend(names)
        ip(*(f"link set {n} mtu {mtu} up" for n in names))
        return names

    yield make
    if made:
        ip(*(f"link del {n}" for n in made))


class CanSocket:
    """A raw CAN socket, as a program in an ECU has it."""

    def __init__(self, interface):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
        self.socket.bind((interface,))
        self.socket.setblocking(False)

    def allow_fd(self):
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)

    def send(self, *frames):
        for frame in frames:
            self.socket.send(frame.pack())

    def send_raw(self, packed):
        self.socket.send(packed)

    def drain(self):
        """Returns the frames that wait to be read."""
        frames = []
        try:
            while True:
                frames.append(Frame.unpack(self.socket.recv(CLASSIC.size)))
        except BlockingIOError:
            return frames

    def receive(self, count, timeout_s=PATIENCE_S):
        """Waits for count frames; returns what has come, more or fewer."""
        frames, deadline = self.drain(), time.monotonic() + timeout_s
        while len(frames) < count and time.monotonic() < deadline:
            time.sleep(0.01)  # rather than a wake-up for each frame
            frames += self.drain()
        return frames

    def close(self):
        self.socket.close()


@pytest.fixture
def can_socket():
    """can_socket("vcan0") opens a CanSocket."""
    opened = []

    def make(interface):
        opened.append(CanSocket(interface))
        return opened[-1]

    yield make
    for s in opened:
        s.close()


def stay_on_one_processor(process):
    """Keeps the frames that a process writes in their order. The kernel has a queue for each
    processor, and one of them may be late."""
    with contextlib.suppress(ProcessLookupError):  # it has ended
        os.sched_setaffinity(process, {max(os.sched_getaffinity(0))})


class Daemon:
    """A canwired, with the notification socket of systemd. crowded: the socket has no room until
    listen() is called; before, after: words around its command line."""

    def __init__(self, folder, text, crowded=False, before=(), after=(), **environment):
        self.config = folder / "bus.yaml"
        self.config.write_text(text)
        self.errors = folder / "stderr"
        self.notifications = []
        self.notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.notify.bind(str(folder / "notify"))
        if crowded:
            self.crowd()
        else:
            self.listen()
        environment = dict(os.environ, NOTIFY_SOCKET=str(folder / "notify"), **environment)
        with self.errors.open("w") as errors:
            self.process = subprocess.Popen(
                [*before, CANWIRED, "-c", self.config, *after], stderr=errors, env=environment
            )
        stay_on_one_processor(self.process.pid)

    def crowd(self):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as crowd:
            with pytest.raises(BlockingIOError):
                while True:
                    crowd.sendto(b"CROWD=1", self.notify.getsockname())

    def listen(self):
        threading.Thread(target=self.read_notifications, daemon=True).start()

    def stderr(self):
        text = self.errors.read_text()
        assert "Sanitizer" not in text and "runtime error:" not in text, text
        assert "unaccounted for" not in text, text
        return text

    def read_notifications(self):
        """Reads all the time, as systemd does."""
        while text := self.notify.recv(4096).decode():
            self.notifications += text.splitlines()

    def notified(self, start):
        """Returns the first line of the notifications that starts with this, or None."""
        return next((n for n in self.notifications if n.startswith(start)), None)

    def wait_ready(self):
        def ready_or_dead():
            return self.notified("READY=1") or self.process.poll() is not None

        wait_until(ready_or_dead, "READY=1")
        assert self.process.poll() is None, self.stderr()

    def wait(self):
        """Waits for the end; returns the exit status."""
        return self.process.wait(PATIENCE_S)

    def stop(self, number=signal.SIGTERM):
        """Ends it as systemd would; it must end well. Returns what it wrote to stderr."""
        self.process.send_signal(number)
        status, text = self.wait(), self.stderr()
        assert status == 0, text
        return text

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.notify.shutdown(socket.SHUT_RD)  # ends the thread


@pytest.fixture
def launch(tmp_path):
    """launch(TEXT) starts canwired with this configuration and does not wait. More: see Daemon."""
    launched = []

    def start(text, **more):
        folder = tmp_path / f"canwired{len(launched)}"
        folder.mkdir()
        launched.append(Daemon(folder, text, **more))
        return launched[-1]

    yield start
    for daemon in launched:
        daemon.close()


@pytest.fixture
def canwired(launch):
    """canwired(TEXT) starts canwired and waits until it is ready."""

    def start(text, **more):
        daemon = launch(text, **more)
        daemon.wait_ready()
        return daemon

    return start


@pytest.fixture(scope="session")
def lcm_types(tmp_path_factory):
    """Returns the Python module that lcm-gen makes from config/lcm."""
    folder = tmp_path_factory.mktemp("lcm")
    types = sorted((ROOT / "config/lcm").glob("*.lcm"))
    assert types
    subprocess.run(["lcm-gen", "-p", "--ppath", folder, *types], check=True)
    sys.path.insert(0, str(folder))
    return importlib.import_module("canwire")


LCM_URL = "udpm://239.255.76.67:7667?ttl=0"


def make_room_for_lcm():
    """Enlarges the buffers of this process's sockets for LCM_URL. Those of liblcm have room for
    some 160 messages, and a bus that catches up has more events than that at once."""
    port = int(re.search(r":(\d+)\?", LCM_URL)[1])
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed by now, as that of iterdir()
            if os.readlink(entry).startswith("socket:"):
                with socket.socket(fileno=os.dup(int(entry.name))) as own:
                    if own.family == socket.AF_INET and own.getsockname()[1] == port:
                        own.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)


class Listener:
    """Subscribes to all messages of one bus, and keeps them. fd: to those of CAN FD, too.
    controllers: to those of filters, buffers and mailboxes. tunnels: to those of tunnels."""

    def __init__(self, types, bus, fd=False, controllers=False, tunnels=False):
        self.decoders = {
            f"CANWIRE.{bus}.BUS": (types.bus_stats_t, "bus"),
            f"CANWIRE.{bus}.QUALITY": (types.bus_quality_t, "quality"),
            f"CANWIRE.{bus}.NODE": (types.node_stats_t, "nodes"),
            f"CANWIRE.{bus}.LOCALTIME": (types.node_time_t, "times"),
            f"CANWIRE.{bus}.EVENT": (types.event_t, "events"),
        }
        if fd:
            self.decoders[f"CANWIRE.{bus}.FDBUS"] = (types.bus_fd_t, "fd_bus")
            self.decoders[f"CANWIRE.{bus}.FDNODE"] = (types.node_fd_t, "fd_nodes")
        if controllers:
            self.decoders[f"CANWIRE.{bus}.CONTROLLER"] = (types.node_controller_t, "controllers")
        if tunnels:
            self.decoders[f"CANWIRE.{bus}.TUNNEL"] = (types.tunnel_t, "tunnels")
        self.tunnels = []
        self.bus, self.nodes, self.events, self.fd_bus, self.fd_nodes = [], [], [], [], []
        self.quality, self.controllers, self.times = [], [], []
        self.lcm = lcm.LCM(LCM_URL)
        for channel in self.decoders:
            name = channel.replace(".", "\\.")
            self.lcm.subscribe(name, self.take).set_queue_capacity(100000)
        make_room_for_lcm()
        self.closing = False
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.closing:
            self.lcm.handle_timeout(100)

    def take(self, channel, data):
        message_type, collection = self.decoders[channel]
        getattr(self, collection).append(message_type.decode(data))

    def node(self, name):
        """Returns the last message of a node, or None."""
        return next((m for m in reversed(self.nodes) if m.node == name), None)

    def wait_bus(self, condition, what):
        """Returns the first BUS message that fulfils a condition."""
        return wait_until(lambda: next(filter(condition, self.bus), None), what)

    def wait_node(self, name, condition, what):
        """Returns the first NODE message of a node that fulfils a condition."""

        def found():
            return next((m for m in self.nodes if m.node == name and condition(m)), None)

        return wait_until(found, what)

    def wait_final(self, stderr):
        """Returns the last BUS message, and a dict of the last NODE messages, after canwired
        ended."""
        assert "stopped: " in stderr

        def complete():
            if not self.bus:
                return False
            last = self.bus[-1]
            said = rf"stopped: {last.frames} frames?, {last.error_frames} error frames?,"
            if not re.search(said, stderr):
                return False
            end_ns = self.bus[-1].bus_time_ns
            return {m.node for m in self.nodes if m.bus_time_ns == end_ns} == {
                m.node for m in self.nodes
            }

        wait_until(complete, "the final statistics")
        return self.bus[-1], {m.node: m for m in self.nodes}

    def close(self):
        self.closing = True
        self.thread.join()


@pytest.fixture
def listen(lcm_types):
    """listen("bus") starts a Listener."""
    listeners = []

    def start(bus, **more):
        listeners.append(Listener(lcm_types, bus, **more))
        return listeners[-1]

    yield start
    for listener in listeners:
        listener.close()


@pytest.fixture
def no_multicast():
    """Takes the multicast route away; calling it puts it back."""
    ip(f"route del {MULTICAST_ROUTE}")
    missing = [True]

    def restore():
        if missing:
            missing.clear()
            ip(f"route add {MULTICAST_ROUTE}")

    yield restore
    restore()


def assert_balance(node):
    """Checks that all frames of a node are accounted for, by its status."""
    dropped = {key: sum(node[key].values()) for key in ("dropped", "rx_dropped")}
    assert node["handed_in"] + node["made_by_rules"] == (
        node["tx_frames"] + node.get("stored", 0) + node["queue"] + node["held"] +
        dropped["dropped"]), node
    assert node["rx_accepted"] + node["rx_made_by_rules"] == (
        node["rx_frames"] + node["rx_held"] + dropped["rx_dropped"]), node
    interface = node["interface"]
    if interface:
        assert interface["read"] == node["handed_in"] + node["inbox"], node
        went = interface["written"] + interface["write_failed"] + interface["unheard"]
        assert node["rx_frames"] == went, node
    assert node["conserved"] is True
