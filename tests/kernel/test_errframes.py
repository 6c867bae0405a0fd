# SPDX-License-Identifier: MIT
"""Error frames that ECUs get, on real vcan: as linux/can/error.h and the SJA1000 driver have
them."""

import socket
import subprocess

import pytest

from canbits import CLASSIC, Frame
from conftest import RECEIVE_BUFFER_BYTES, SO_RCVBUFFORCE, wait_until
from test_faults import Shell

CAN_RAW_ERR_FILTER = 2  # option of SOL_CAN_RAW that Python does not name
ERR, LOSTARB, CRTL, PROT, ACK = 0x20000000, 0x2, 0x4, 0x8, 0x20
BUSOFF, BUSERROR, RESTARTED, CNT = 0x40, 0x80, 0x100, 0x200
PROT_BIT0 = 0x08  # a dominant bit could not be sent
RX_OVERFLOW, TX_OVERFLOW, TX_WARNING = 0x01, 0x02, 0x08
RX_PASSIVE, TX_PASSIVE, ACTIVE = 0x10, 0x20, 0x40

# as FAULTY, with the error frames of a driver
PRESETS = """
bus: {{ name: errors, bitrate: 500000 }}
nodes:
  - {{ name: engine, port: vcan0, restart-ms: 20, berr-reporting: {berr},
      controller: {{ model: {model} }} }}
  - {{ name: gearbox, port: vcan1 }}
faults:
  - name: bad-driver
    when: {{ frame: "123", from: engine }}
    do: {{ flip: "dlc[0]", at: [engine] }}
"""

ALONE = """
bus: {{ name: errors, bitrate: 500000 }}
lcm: {{ period: 50ms, events: [state] }} # single errors would be a flood
nodes:
  - {{ name: engine, port: vcan0, berr-reporting: {berr} }}
"""

SLOW = """
bus: {{ name: slow, bitrate: 500000 }}
control: slow.sock
nodes:
  - name: dash
    port: vcan0
    filter: "100:700"
    controller: {{ model: basic, service-time: 3s }}
  - {{ name: engine, port: vcan1 }}
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
            self.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
            self.socket.setsockopt(raw, socket.CAN_RAW_FILTER, b"")
            self.socket.setsockopt(raw, CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
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
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
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
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    assert reader.take(2) == [state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0)]
    daemon.stop()
    assert reader.waiting() == []


def test_storm_is_limited_and_told(vcan, canwired, can_socket, errors, listen):
    vcan(1)
    listener = listen("errors")
    daemon = canwired(ALONE.format(berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    listener.wait_node("engine", lambda m: m.ack_errors > 5000, "a storm of errors")
    text = daemon.stop()
    bus, nodes = listener.wait_final(text)
    engine = nodes["engine"]
    assert engine.error_frames_left_out > 1000
    assert "error frames left out" in text
    # nothing lost that is not counted: each error is a frame or left out, and two states
    reader.take(engine.ack_errors - engine.error_frames_left_out + 2)
    assert reader.waiting() == []
    # a burst of 256, then 1000 a second of bus time
    assert engine.ack_errors - engine.error_frames_left_out <= 257 + bus.bus_time_ns // 1_000_000


def test_bus_off_and_restart(vcan, canwired, can_socket, errors):
    vcan(2)
    canwired(FAULTY.format(restart=20, berr="off"))
    reader = errors("vcan0")
    other = errors("vcan1")
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    assert reader.take(5) == [
        state(TX_WARNING, 96, 0),
        state(TX_PASSIVE, 128, 0),
        pack(BUSOFF),
        pack(RESTARTED),
        state(ACTIVE, 0, 0),
    ]
    # the gearbox sees 16 active flags, each one error more, and stays far from any limit
    assert other.waiting() == []


def test_a_frame_behind_the_restart_waits(vcan, canwired, can_socket, errors):
    """R12: the frame is written before the 128 x 11 bits are over, which take 140 ms."""
    vcan(2)
    canwired(FAULTY.format(restart=20, berr="off").replace("500000", "10000"))
    reader, engine, gearbox = errors("vcan0"), can_socket("vcan0"), can_socket("vcan1")
    engine.send(Frame(0x123, 1, b"\x01"))
    assert reader.take(4)[2:] == [pack(BUSOFF), pack(RESTARTED)]
    engine.send(Frame(0x124, 1, b"\x02"))
    assert gearbox.receive(1) == [Frame(0x124, 1, b"\x02")]
    assert reader.take(1) == [state(ACTIVE, 0, 0)]


@pytest.mark.parametrize("model, counters", [
    ("sja1000", True), ("mcp2515", False), ("m_can", True), ("flexcan", False), ("bxcan", True)])
def test_a_preset_tells_what_its_driver_tells(vcan, canwired, can_socket, errors, model, counters):
    """Nobody tells that the node is error-active after a restart; only some tell counters."""
    vcan(2)
    daemon = canwired(PRESETS.format(model=model, berr="off"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    climb = ([state(TX_WARNING, 96, 0), state(TX_PASSIVE, 128, 0)] if counters else
             [pack(CRTL, 0, TX_WARNING), pack(CRTL, 0, TX_PASSIVE)])
    assert reader.take(4) == climb + [pack(BUSOFF), pack(RESTARTED)]
    daemon.stop()
    assert reader.waiting() == []


@pytest.mark.parametrize("model, wanted", [
    ("sja1000", (CNT, 0, 0, 0x81, 0x0B, 0, 0, 8, 0)), ("m_can", (0, 0, 0, PROT_BIT0)),
    ("flexcan", (0, 0, 0, PROT_BIT0)), ("bxcan", (0, 0, 0, PROT_BIT0)), ("mcp2515", None)])
def test_a_preset_tells_bus_errors_as_its_driver_does(vcan, canwired, can_socket, errors, model,
                                                      wanted):
    vcan(2)
    canwired(PRESETS.format(model=model, berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    first = (pack(PROT | BUSERROR | wanted[0], *wanted[1:]) if wanted else
             pack(CRTL, 0, TX_WARNING))
    assert reader.take(1)[0] == first


def test_bit_error_has_type_and_place(vcan, canwired, can_socket, errors):
    vcan(2)
    canwired(FAULTY.format(restart=0, berr="on"))
    reader = errors("vcan0")
    can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
    assert reader.take(1) == [pack(PROT | BUSERROR | CNT, 0, 0, 0x81, 0x0B, 0, 0, 8, 0)]


@pytest.mark.parametrize("reporting", ["on", "off"])
def test_lost_arbitration_has_its_bit(vcan, canwired, can_socket, errors, listen, reporting):
    vcan(2)
    listener = listen("errors")
    daemon = canwired("""
bus: { name: errors, bitrate: 10000 }
lcm: { period: 50ms }
nodes:
  - { name: engine, port: vcan0, queue: 64 }
  - { name: gearbox, port: vcan1, queue: 64, lost-arbitration-reporting: REPORTING }
""".replace("REPORTING", reporting))
    engine, gearbox = errors("vcan0"), errors("vcan1")
    ecus = can_socket("vcan0"), can_socket("vcan1")
    met = False
    for sent in range(40, 20 * 40, 40):  # again, where this process was held up between the two
        ecus[0].send(*[Frame(0x700, 0)] * 40)
        ecus[1].send(*[Frame(0x7F0, 0)] * 40)
        met = listener.wait_node("gearbox", lambda m, sent=sent: m.tx_frames == sent,
                                 "all frames of the gearbox").arbitration_lost > 0
        if met:
            break
    assert met
    _, nodes = listener.wait_final(daemon.stop())
    # 700 and 7F0 differ first in the fourth identifier bit, number 3 as the SJA1000 counts
    told = nodes["gearbox"].arbitration_lost if reporting == "on" else 0
    assert gearbox.take(told) == [pack(LOSTARB, 3)] * told
    assert gearbox.waiting() == [] and engine.waiting() == []
    assert nodes["engine"].arbitration_lost == 0


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
    can_socket("vcan0").send(*(Frame(0x100 + i, 0) for i in range(50)))
    assert reader.take(1) == [pack(CRTL, 0, TX_OVERFLOW)]
    _, nodes = listener.wait_final(daemon.stop())
    engine = nodes["engine"]
    assert engine.dropped_queue_full > 0
    assert engine.dropped_queue_full + engine.tx_frames + engine.queue == engine.handed_in == 50


@pytest.mark.deep
def test_tshark_reads_them(vcan, canwired, can_socket, errors, tmp_path):
    """An independent reader of a capture: Wireshark's dissector for SocketCAN error frames."""
    vcan(2)
    canwired(FAULTY.format(restart=20, berr="on"))
    capture = tmp_path / "capture.pcapng"
    # the frame, 32 bit errors, warning, passive, bus-off, restarted, active: then it ends by itself
    dumpcap = subprocess.Popen(["dumpcap", "-i", "vcan0", "-c", "38", "-w", capture],
                               stderr=subprocess.PIPE, text=True)
    try:
        while "File:" not in dumpcap.stderr.readline():
            assert dumpcap.poll() is None
        can_socket("vcan0").send(Frame(0x123, 1, b"\x01"))
        dumpcap.communicate(timeout=60)
    finally:
        dumpcap.kill()
    names = ("flags.err", "err.prot", "err.buserror", "err.prot.type.bit", "err.prot.type.tx",
             "err.prot.location", "err.ctrl.tx_warning", "err.ctrl.tx_passive", "err.busoff",
             "err.restarted", "err.ctrl.active", "len")
    fields = [argument for name in names for argument in ("-e", f"can.{name}")]
    lines = subprocess.run(["tshark", "-r", capture, "-T", "fields", *fields], check=True,
                           capture_output=True, text=True).stdout.splitlines()
    lines = [line.replace("True", "1") for line in lines]  # newer versions write words
    read = [dict(zip(names, line.split("\t"))) for line in lines]
    read = [frame for frame in read if frame["flags.err"] == "1"]
    bit_errors = [frame for frame in read if frame["err.prot"] == "1"]
    # 32 attempts, each with a bit error of the transmitter in the DLC (location 0B)
    assert len(bit_errors) == 32
    assert all(int(f["err.prot.location"], 0) == 0x0B and f["err.buserror"] == "1" and
               f["err.prot.type.bit"] == "1" and f["err.prot.type.tx"] == "1" for f in bit_errors)
    for name in ("err.ctrl.tx_warning", "err.ctrl.tx_passive", "err.busoff", "err.restarted"):
        assert sum(frame[name] == "1" for frame in read) == 1, name


def test_an_ecu_that_reads_too_slowly_is_told_of_the_overrun(vcan, canwired, can_socket, errors):
    """Frames in a row; the host is still at the first one when the others have come."""
    vcan(2)
    daemon = canwired(SLOW.format())
    ecu = can_socket("vcan0")
    reader = errors("vcan0")
    frames = [Frame(0x100, 1, bytes([number])) for number in range(4)]
    can_socket("vcan1").send(*frames, Frame(0x200, 1, b"\xff"))  # the filter keeps the last one out
    assert reader.take(3) == [pack(CRTL, 0, RX_OVERFLOW)] * 3
    assert ecu.receive(1) == frames[:1]
    node = Shell(daemon).status("slow")["nodes"][0]
    assert (node["overruns"], node["filtered"], node["rx_frames"]) == (3, 1, 1)
    daemon.stop()
    assert reader.waiting() == []
