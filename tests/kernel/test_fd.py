# SPDX-License-Identifier: MIT
"""CAN FD on real vcan: can-utils, python-can and kernel ISO-TP through canwired."""

import os
import re
import shutil
import socket
import struct
import subprocess
import threading

import can
import pytest

from conftest import PATIENCE_S, ROOT, listeners, wait_until

CANWIRE = os.environ.get("CANWIRE") or ROOT / "build/release/canwire"
BUS = """
bus: {{ name: {bus}, bitrate: 500000, dbitrate: 2000000 }}
control: {bus}.sock
nodes:
  - {{ name: a, port: vcan0{a} }}
  - {{ name: b, port: vcan1{b} }}
"""
FD_HEAD = "=IBB2x"


def start(canwired, bus, a="", b=""):
    return canwired(BUS.format(bus=bus, a=a, b=b))


class Fd:
    """A raw CAN socket of a program that knows CAN FD."""

    def __init__(self, interface):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        self.socket.bind((interface,))
        self.socket.settimeout(PATIENCE_S)

    def send(self, identifier, flags, data, length=None):
        head = struct.pack("=IBBBB", identifier, len(data) if length is None else length, flags,
                           0, 0)
        self.socket.send(head + data.ljust(64, b"\0"))

    def receive(self):
        raw = self.socket.recv(72)  # whole: a frame
        identifier, length, flags = struct.unpack_from("=IBB", raw)
        return len(raw), identifier, flags, raw[8:8 + length]


def status(daemon, bus):
    done = subprocess.run([CANWIRE, "status", daemon.config.parent / f"{bus}.sock", "--json"],
                          capture_output=True, text=True, check=True)
    return done.stdout


class Dump:
    """A candump of an interface in the log format, without times."""

    def __init__(self, interface):
        before = listeners(interface)
        self.process = subprocess.Popen([shutil.which("candump"), "-L", interface],
                                        stdout=subprocess.PIPE, text=True)
        self.lines = []
        wait_until(lambda: listeners(interface) > before, "candump to listen")
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.process.stdout:
            self.lines.append(line.split()[2])

    def close(self):
        self.process.kill()
        self.process.wait()


@pytest.fixture
def dump():
    opened = []

    def make(interface):
        opened.append(Dump(interface))
        return opened[-1]

    yield make
    for d in opened:
        d.close()


def test_fd_frames_come_as_a_driver_delivers_them(vcan, canwired):
    vcan(2, mtu=72)
    daemon = start(canwired, "flags")
    a, b = Fd("vcan0"), Fd("vcan1")
    a.send(0x123, 0x01, bytes(range(64)))
    assert b.receive() == (72, 0x123, 0x05, bytes(range(64))), "BRS, and FDF is set"
    a.send(0x124, 0x02, b"\x01\x02")
    assert b.receive() == (72, 0x124, 0x04, b"\x01\x02"), "the ESI of a writer is ignored"
    a.send(0x125, 0x00, bytes(range(13)))
    assert b.receive() == (72, 0x125, 0x04, bytes(range(13)) + bytes(3)), "rounded up"
    b.socket.send(struct.pack("=IB3x8s", 0x80000777, 3, b"abc"))
    assert a.receive()[:3] == (16, 0x80000777, 0)
    assert '"rounded":1' in status(daemon, "flags").replace(" ", "")
    daemon.stop()


def test_can_utils_send_and_dump_fd_frames(vcan, canwired, dump, tmp_path):
    vcan(2, mtu=72)
    daemon = start(canwired, "utils")
    seen = dump("vcan1")
    for text in ("123##1DEADBEEF", "00000123##0", "7FF##1" + "55" * 64, "100#11"):
        subprocess.run([shutil.which("cansend"), "vcan0", text], check=True)
    wait_until(lambda: len(seen.lines) >= 4, "four frames")
    assert seen.lines[0] == "123##5DEADBEEF" or seen.lines[0] == "123##1DEADBEEF"
    assert seen.lines[2].startswith("7FF##") and seen.lines[2].endswith("55" * 64)
    assert seen.lines[3] == "100#11"
    log = tmp_path / "fd.log"
    log.write_text("(1.000000) vcan0 321##1010203\n(1.000500) vcan0 322#AA\n")
    subprocess.run([shutil.which("canplayer"), "-I", log], check=True)
    wait_until(lambda: len(seen.lines) >= 6, "frames of the log")
    assert seen.lines[4].endswith("010203") and seen.lines[5] == "322#AA"
    for option in ("-f", "-b"):
        before = len(seen.lines)
        subprocess.run([shutil.which("cangen"), "vcan0", option, "-n", "50", "-g", "2"],
                       check=True)
        wait_until(lambda n=before: len(seen.lines) == n + 50, f"frames of cangen {option}")
        assert all("##" in line for line in seen.lines[before:])
    daemon.stop()


def test_python_can_with_fd(vcan, canwired):
    vcan(2, mtu=72)
    daemon = start(canwired, "python")
    with can.Bus(interface="socketcan", channel="vcan0", fd=True) as a, \
            can.Bus(interface="socketcan", channel="vcan1", fd=True) as b:
        for one, other in ((a, b), (b, a)):
            sent = can.Message(arbitration_id=0x155, is_fd=True, bitrate_switch=True,
                               is_extended_id=False, data=bytes(range(48)))
            one.send(sent)
            got = other.recv(PATIENCE_S)
            assert got and got.is_fd and got.bitrate_switch and not got.error_state_indicator
            assert (got.arbitration_id, bytes(got.data)) == (0x155, bytes(range(48)))
    daemon.stop()


def test_fd_frames_at_a_classical_node_are_counted(vcan, canwired):
    vcan(2, mtu=72)
    daemon = start(canwired, "classical", a=", kind: classical")
    a, b = Fd("vcan0"), Fd("vcan1")
    a.send(0x123, 0x01, b"\x01")
    a.socket.send(struct.pack("=IB3x8s", 0x124, 1, b"x"))
    assert b.receive()[:3] == (16, 0x124, 0)
    wait_until(lambda: re.search(r'"bad-frame":1\b', status(daemon, "classical").replace(" ", "")),
               "the drop")
    daemon.stop()


def test_an_mtu_that_is_too_small_is_told_with_the_remedy(vcan, canwired):
    vcan(2)
    daemon = start(canwired, "small", b=", kind: classical")
    wait_until(lambda: "its MTU is 16" in daemon.stderr(), "the warning")
    assert "ip link set vcan0 mtu 72" in daemon.stderr()
    daemon.stop()


def test_vcan_up_makes_the_right_mtu(tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text(BUS.format(bus="up", a="", b=", kind: classical"))
    subprocess.run([CANWIRE, "vcan", "up", rig], check=True)
    try:
        assert (open("/sys/class/net/vcan0/mtu").read().strip(),
                open("/sys/class/net/vcan1/mtu").read().strip()) == ("72", "16")
    finally:
        subprocess.run([CANWIRE, "vcan", "down", rig], check=True)


SOL_CAN_ISOTP, CAN_ISOTP_OPTS, CAN_ISOTP_LL_OPTS = 106, 1, 5
CAN_ISOTP_WAIT_TX_DONE = 0x400


def isotp(interface, source, target):
    s = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_ISOTP)
    s.setsockopt(SOL_CAN_ISOTP, CAN_ISOTP_OPTS,
                 struct.pack("=IIBBBB", CAN_ISOTP_WAIT_TX_DONE, 0, 0, 0, 0, 0))
    s.setsockopt(SOL_CAN_ISOTP, CAN_ISOTP_LL_OPTS, struct.pack("=BBB", 72, 64, 1))  # BRS
    s.bind((interface, source, target))
    s.settimeout(PATIENCE_S)
    return s


def test_iso_tp_with_frames_of_64_bytes(vcan, canwired):
    vcan(2, mtu=72)
    daemon = start(canwired, "isotp")
    tester, ecu = isotp("vcan0", 0x7E8, 0x7E0), isotp("vcan1", 0x7E0, 0x7E8)
    for size in (1, 7, 62, 63, 500, 4000):
        data = bytes(i * 7 % 256 for i in range(size))
        tester.send(data)
        assert ecu.recv(8192) == data, size  # whole: a message
    text = status(daemon, "isotp").replace(" ", "")
    assert int(re.search(r'"fd_frames":(\d+)', text)[1]) > 64
    daemon.stop()
