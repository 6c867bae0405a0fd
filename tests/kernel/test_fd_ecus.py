# SPDX-License-Identifier: MIT
"""CAN FD on real vcan, beside plain frames. ECUs see ESI and error frames with places. Sockets have
messages of both sizes. LCM, journal and recordings know CAN FD.
"""

import socket
import struct

import can
import pytest

from conftest import PATIENCE_S, ask_status, wait_until
from test_fd import Fd
from test_journal import Night, again, assert_same

BUS = """
bus: {{ name: faults, bitrate: 500000, dbitrate: 2000000 }}
control: faults.sock
lcm: {{ period: 50ms }}
nodes:
  - {{ name: a, port: {a} }}
  - {{ name: b, port: {b} }}
{more}"""
BERR = "vcan0, tdc-mode: off, berr-reporting: on"
BRS, ESI, FDF = 1, 2, 4
CAN_RAW_ERR_FILTER = 2
CLASSICAL = struct.Struct("=IB3x8s")
FD_MESSAGE = struct.Struct("=IBB2x64s")


def bus(a="vcan0", b="vcan1", more=""):
    return BUS.format(a=a, b=b, more=more)


# ---- ESI -----------------------------------------------------------------------------------------

def test_a_passive_node_sends_esi(vcan, canwired):
    """Its controller decides, whatever the program has written."""
    vcan(2, mtu=72)
    daemon = canwired(bus(more="faults: [ { name: p, do: { counters: a, tec: 140 } } ]\n"))
    a, b = Fd("vcan0"), Fd("vcan1")
    a.send(0x123, BRS, b"\x01")
    assert b.receive() == (72, 0x123, BRS | ESI | FDF, b"\x01")
    b.send(0x124, BRS | ESI, b"\x02")
    assert a.receive() == (72, 0x124, BRS | FDF, b"\x02")
    daemon.stop()


# ---- Error frames --------------------------------------------------------------------------------

LOC_RES0, LOC_DLC, LOC_CRC = 0x09, 0x0B, 0x08
BIT, FORM = 0x01, 0x02
PLACES = [("fdf", BIT, LOC_RES0), ("res", BIT, LOC_RES0), ("brs", BIT, LOC_DLC),
          ("esi", BIT, LOC_DLC), ("stuff-count[1]", BIT, LOC_CRC), ("crc[20]", BIT, LOC_CRC),
          ("fixed-stuff[2]", FORM, LOC_CRC)]


@pytest.mark.parametrize("position, kind, location", PLACES)
def test_an_error_frame_has_the_place(vcan, canwired, position, kind, location):
    """The transmitter reads one of its own bits wrongly."""
    vcan(2, mtu=72)
    rule = f'{{ name: f, when: {{ count: 1 }}, do: {{ flip: "{position}", at: a }} }}'
    daemon = canwired(bus(BERR, more=f"faults: [ {rule} ]\n"))
    errors = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    errors.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", 0x7FF, 0xFFF))
    errors.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
    errors.bind(("vcan0",))
    errors.settimeout(PATIENCE_S)
    a, b = Fd("vcan0"), Fd("vcan1")
    a.send(0x123, BRS, bytes(range(20)))
    raw = errors.recv(72)  # whole: a frame
    can_id, _, data = CLASSICAL.unpack(raw)
    assert len(raw) == 16 and can_id & 0x88 == 0x88, "a protocol violation on the bus"
    assert (data[2] & 0x1F, data[3]) == (kind, location)
    assert b.receive()[1] == 0x123, "the frame comes in the end"
    daemon.stop()


# ---- Sockets with messages of both sizes ---------------------------------------------------------

def connect(path):
    s = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    wait_until(path.exists, "the socket")
    s.connect(str(path))
    s.settimeout(PATIENCE_S)
    return s


def test_old_clients_go_on_beside_those_with_72_bytes(vcan, canwired, tmp_path):
    vcan(1, mtu=72)
    daemon = canwired(bus(f'"unix:{tmp_path}/old"', f'"unix:{tmp_path}/new"',
                          "  - { name: c, port: vcan0 }\n"))
    old, new, ecu = connect(tmp_path / "old"), connect(tmp_path / "new"), Fd("vcan0")
    new.send(FD_MESSAGE.pack(0x200, 12, BRS, bytes(range(12)).ljust(64, b"\0")))
    assert ecu.receive() == (72, 0x200, BRS | FDF, bytes(range(12)))
    ecu.send(0x201, BRS, b"\x05" * 64)
    assert new.recv(100) == FD_MESSAGE.pack(0x201, 64, BRS | FDF, b"\x05" * 64)  # whole: a message
    old.send(CLASSICAL.pack(0x100, 2, b"ab"))
    assert ecu.receive() == (16, 0x100, 0, b"ab")
    assert new.recv(100) == CLASSICAL.pack(0x100, 2, b"ab")  # whole: a message
    new.send(CLASSICAL.pack(0x101, 1, b"z"))
    assert old.recv(100) == CLASSICAL.pack(0x101, 1, b"z")  # whole: not one of the FD frames
    status = ask_status(daemon.config.parent / "faults.sock")
    assert [node["interface"]["unheard"] for node in status["nodes"]] == [2, 0, 0]
    daemon.stop()


# ---- LCM -----------------------------------------------------------------------------------------

def test_old_subscribers_go_on_beside_the_new_messages(vcan, canwired, listen):
    vcan(2, mtu=72)
    old, new = listen("faults"), listen("faults", fd=True)
    daemon = canwired(bus())
    a, b = Fd("vcan0"), Fd("vcan1")
    a.send(0x123, BRS, bytes(64))
    assert b.receive()[1] == 0x123
    assert old.wait_bus(lambda m: m.frames == 1, "the frame").bitrate_bps == 500000
    old.wait_node("b", lambda m: m.rx_bytes == 64, "the receiver")
    of_bus = wait_until(lambda: next((m for m in new.fd_bus if m.fd_frames), None), "bus_fd_t")
    assert of_bus.data_bits > 512 and of_bus.nominal_bits < 50
    # the last one is the CRC delimiter: 75 % of a data bit, and 12.5 % of a nominal one
    assert of_bus.data_ns == of_bus.data_bits * 500 - 125 + 250
    of_node = wait_until(lambda: next((m for m in new.fd_nodes if m.node == "a"), None),
                         "node_fd_t")
    assert (of_node.dbitrate_bps, of_node.tdc_mode) == (2000000, "auto")
    daemon.stop()


# ---- Journal and recordings ----------------------------------------------------------------------

RULES = """
faults:
  - { name: hello, when: { manual: yes }, do: { counters: b, rec: 0 } }
  - { name: coin, when: { rate: data, probability: 0.2 }, do: { flip: "fixed-stuff[2]", at: b } }
  - { name: esi, when: { frame: "120:7F0", every: 3 }, do: { flip: esi, at: b } }
  - { name: noise, do: { noise: 1e-4 } }
"""


@pytest.mark.deep
def test_the_journal_of_a_run_with_fd_runs_again_to_the_byte(vcan, launch, tmp_path):
    vcan(2, mtu=72)
    text = bus("vcan0, restart-ms: 10", "vcan1, restart-ms: 10", RULES)
    night = Night(launch, tmp_path, text)
    a, b = Fd("vcan0"), Fd("vcan1")
    for n in range(60):
        a.send(0x100 + n, n % 2, bytes(range(n % 65)))
        b.send(0x180 + n, 1, b"\x55" * (n % 17))
        if n == 30:
            night.run("set", "b", "tdc-mode=off", "dsample-point=70%")
            night.daemon.config.write_text(text.replace("2000000", "4000000"))
            night.run("reload")
    wait_until(lambda: night.live.read_text().count('"tx"') > 50, "frames")
    _, live = night.morning()
    replayed, _ = again(night.journal)
    assert '"rate":"data"' in live and "##1" in live
    assert_same(replayed, live, 200)


def test_a_recording_has_the_frames(vcan, canwired, tmp_path):
    vcan(2, mtu=72)
    log = tmp_path / "fd.log"
    daemon = canwired(bus(more=f"record: [ {{ file: {log} }} ]\n"))
    a, b = Fd("vcan0"), Fd("vcan1")
    for n in (0, 8, 12, 64):
        a.send(0x300 + n, BRS, bytes(range(n)))
        assert b.receive()[1] == 0x300 + n
    daemon.stop()
    frames = [(m.arbitration_id, bytes(m.data), m.is_fd, m.bitrate_switch)
              for m in can.CanutilsLogReader(log)]
    assert frames == [(0x300 + n, bytes(range(n)), True, True) for n in (0, 8, 12, 64)]
