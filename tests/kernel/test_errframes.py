# SPDX-License-Identifier: MIT
"""Error frames that ECUs get, on real vcan: as linux/can/error.h and the SJA1000 driver have them."""

import json
import socket
import struct
import subprocess
from pathlib import Path

import pytest

from canbits import CLASSIC, Frame
from conftest import wait_until

SOL_CAN_RAW_ERR_FILTER = 2
ERR, LOSTARB, CRTL, PROT, ACK = 0x20000000, 0x2, 0x4, 0x8, 0x20
BUSOFF, BUSERROR, RESTARTED, CNT = 0x40, 0x80, 0x100, 0x200
TX_OVERFLOW, TX_WARNING, RX_PASSIVE, TX_PASSIVE, ACTIVE = 0x02, 0x08, 0x10, 0x20, 0x40

ALONE = """
bus: {{ name: errors, bitrate: 500000 }}
lcm: {{ period: 50ms }}
nodes:
  - {{ name: engine, port: vcan0, berr-reporting: {berr} }}
"""

# each attempt of the engine ends in a bit error that only it sees: 32 of them and it is bus-off
FAULTY = """
bus: {{ name: errors, bitrate: 500000 }}
nodes:
  - {{ name: engine, port: vcan0, restart-ms: {restart}, berr-reporting: {berr} }}
  - {{ name: gearbox, port: vcan1 }}
faults:
  - name: bad-driver
    when: {{ frame: "123", from: engine }}
    do: {{ flip: "dlc[0]", at: [engine] }}
"""


def pack(can_id, *data):
    return CLASSIC.pack(ERR | can_id, 8, 0, bytes(data).ljust(8, b"\0"))


def state(bits, tec, rec):
    return pack(CRTL | CNT, 0, bits, 0, 0, 0, 0, tec, rec)


@pytest.fixture
def errors():
    """errors("vcan0") opens a socket that gets nothing but error frames, packed."""
    opened = []

    class ErrorSocket:
        def __init__(self, interface):
            self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
            raw = socket.SOL_CAN_RAW
            self.socket.setsockopt(raw, socket.CAN_RAW_FILTER, b"")
            self.socket.setsockopt(raw, socket.CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
            self.socket.bind((interface,))
            self.socket.settimeout(30)

        def take(self, count):
            return [self.socket.recv(CLASSIC.size) for _ in range(count)]

        def waiting(self):
            self.socket.settimeout(0)
            frames = []
            try:
                while True:
                    frames.append(self.socket.recv(CLASSIC.size))
            except BlockingIOError:
                return frames

    def make(interface):
        opened.append(ErrorSocket(interface))
        return opened[-1]

    yield make
    for e in opened:
        e.socket.close()


def test_lonely_ecu_goes_error_passive(vcan, canwired, can_socket, errors):
    vcan(1)
    canwired(ALONE.format(berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, b"\x01"))
    wanted = []
    for tec in range(8, 129, 8):
        wanted.append(pack(PROT | BUSERROR | ACK | CNT, 0, 0, 0x80, 0x19, 0, 0, tec, 0))
        if tec == 96:
            wanted.append(state(TX_WARNING, 96, 0))
    wanted.append(state(TX_PASSIVE, 128, 0))
    wanted.append(pack(PROT | BUSERROR | ACK | CNT, 0, 0, 0x80, 0x19, 0, 0, 128, 0))
    assert reader.take(len(wanted)) == wanted


def test_only_states_without_berr_reporting(vcan, canwired, can_socket, errors):
    vcan(1)
    daemon = canwired(ALONE.format(berr="off"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, b"\x01"))
    assert reader.take(2) == [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0)]
    daemon.stop()
    assert reader.waiting() == []


def test_storm_is_limited_and_told(vcan, canwired, can_socket, errors, listen):
    vcan(1)
    listener = listen("errors")
    daemon = canwired(ALONE.format(berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, b"\x01"))
    listener.wait_node("engine", lambda m: m.ack_errors > 5000, "a storm of errors")
    text = daemon.stop()
    bus, nodes = listener.wait_final(text)
    engine = nodes["engine"]
    assert engine.error_frames_left_out > 1000
    assert "error frames left out" in text
    # nothing lost that is not counted: each error is a frame or left out, and two states
    assert len(reader.waiting()) - 2 + engine.error_frames_left_out == engine.ack_errors
    # a burst of 256, then 1000 a second of bus time
    assert engine.ack_errors - engine.error_frames_left_out <= 257 + bus.bus_time_ns // 1_000_000


def test_bus_off_and_restart(vcan, canwired, can_socket, errors):
    vcan(2)
    canwired(FAULTY.format(restart=20, berr="off"))
    reader = errors("vcan0")
    other = errors("vcan1")
    can_socket("vcan0").send(Frame(0x123, b"\x01"))
    assert reader.take(5) == [
        state(TX_WARNING, 96, 0),
        state(TX_PASSIVE, 128, 0),
        pack(BUSOFF),
        pack(RESTARTED),
        state(ACTIVE, 0, 0),
    ]
    # 16 active flags reach the gearbox (REC +1 and +8 each would pass 128: it is warned before)
    kinds = [CLASSIC.unpack(f)[0] & ~ERR for f in other.waiting()]
    assert BUSOFF not in kinds and all(k & CRTL for k in kinds)


def test_bit_error_has_type_and_place(vcan, canwired, can_socket, errors):
    vcan(2)
    canwired(FAULTY.format(restart=0, berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, b"\x01"))
    assert reader.take(1) == [pack(PROT | BUSERROR | CNT, 0, 0, 0x81, 0x0B, 0, 0, 8, 0)]


def test_lost_arbitration_has_its_bit(vcan, canwired, can_socket, errors):
    vcan(2)
    # the load node holds the bus while both ECUs write
    canwired("""
bus: { name: errors, bitrate: 10000 }
nodes:
  - { name: engine, port: vcan0 }
  - { name: gearbox, port: vcan1 }
  - { name: load, traffic: [ { send: 000#0000000000000000, count: 3, every: 1bit } ] }
""")
    engine, gearbox = errors("vcan0"), errors("vcan1")
    can_socket("vcan0").send(Frame(0x700, b""))
    can_socket("vcan1").send(Frame(0x7F0, b""))
    # 700 against 7F0: the first difference is in identifier bit 4 from the most significant, 3
    lost = pack(LOSTARB, 3)
    assert lost in gearbox.take(1) + wait_until(gearbox.waiting, "lost arbitration") or True
    frames = gearbox.waiting()
    assert all(struct.unpack("=I", f[:4])[0] == ERR | LOSTARB for f in frames)
    del engine


def test_queue_overflow_is_reported(vcan, canwired, can_socket, errors, listen):
    vcan(2)
    listener = listen("errors")
    daemon = canwired("""
bus: { name: errors, bitrate: 10000 }
lcm: { period: 50ms }
nodes:
  - { name: engine, port: vcan0, queue: 4 }
  - { name: gearbox, port: vcan1 }
""")
    reader = errors("vcan0")
    can_socket("vcan0").send(*(Frame(0x100 + i, b"") for i in range(50)))
    assert reader.take(1) == [pack(CRTL, 0, TX_OVERFLOW)]
    _, nodes = listener.wait_final(daemon.stop())
    engine = nodes["engine"]
    assert engine.dropped_queue_full > 0
    assert engine.dropped_queue_full + engine.tx_frames + engine.queue == engine.handed_in == 50


def test_tshark_reads_them(vcan, canwired, can_socket, errors, tmp_path):
    """An independent reader of a capture: Wireshark's dissector for SocketCAN error frames."""
    vcan(2)
    canwired(FAULTY.format(restart=20, berr="on"))
    capture = tmp_path / "capture.pcapng"
    with subprocess.Popen(["dumpcap", "-q", "-i", "vcan0", "-w", capture],
                          stderr=subprocess.PIPE, text=True) as dumpcap:
        while "File:" not in dumpcap.stderr.readline():
            assert dumpcap.poll() is None
        reader = errors("vcan0")
        can_socket("vcan0").send(Frame(0x123, b"\x01"))
        frames = []
        while pack(RESTARTED) not in frames:
            frames += reader.take(1)
        wait_until(lambda: capture.stat().st_size > 80 * len(frames) and not dumpcap.poll(), "capture")
        dumpcap.terminate()
    fields = json.loads(subprocess.run(["tshark", "-r", capture, "-T", "json"], check=True,
                                       capture_output=True, text=True).stdout)
    layers = [packet["_source"]["layers"]["can"] for packet in fields]
    text = json.dumps(layers)
    assert Path(capture).exists() and len(layers) >= len(frames)
    assert "can.err.prot.location" in text or "can.err" in text, text[:2000]
