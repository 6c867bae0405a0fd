# SPDX-License-Identifier: MIT
"""The receivers of each frame, and the order of frames, on real vcan."""

import random
import select
import shutil
import socket
import subprocess
import time

import can
import pytest

from canbits import ERROR, EXTENDED, FD, REMOTE, Frame, priority, slot_bits
from conftest import PATIENCE_S, wait_until
from test_faults import Shell

pytestmark = pytest.mark.kept

CAN_RAW_ERR_FILTER = 2  # of linux/can/raw.h; Python has no name for it

TWO_NODES = """
bus: {{ name: {bus}, bitrate: 1000000 }}
nodes:
  - {{ name: a, port: vcan0, queue: 4096 }}
  - {{ name: b, port: vcan1, queue: 4096 }}
lcm: {{ period: 100ms }}
"""


# ---- Order ---------------------------------------------------------------------------------------

CONTENDED = {
    "a": ["7FF#", "100#AA", "200#R2", "1FFFFFFF#01", "300#"],
    "b": ["0FF#BB", "200#22", "08000000#", "7FE#00"],
    "c": ["08000000#R4", "555#5555", "001#", "0FFFFFFF#"],
}


def test_frames_written_while_the_bus_is_busy_come_in_the_order_of_priority(
    vcan, can_socket, canwired
):
    vcan(4)
    hog = Frame.parse("000#")
    receiver = can_socket("vcan3")
    ecus = {name: can_socket(f"vcan{i}") for i, name in enumerate(CONTENDED)}
    text = """
bus: { name: contention, bitrate: 125000 }
control: contention.sock
nodes:
  - { name: a, port: vcan0 }
  - { name: b, port: vcan1 }
  - { name: c, port: vcan2 }
  - { name: receiver, port: vcan3 }
"""
    daemon = canwired(text + f"""  - name: hog # keeps the bus busy until it is removed
    queue: 4096
    traffic: [ {{ send: 000#, every: {slot_bits(hog) - 1}bit, offset: 11bit }} ]
""")
    shell = Shell(daemon)
    frames = {name: [Frame.parse(t) for t in texts] for name, texts in CONTENDED.items()}
    for name, own in frames.items():
        ecus[name].send(*own)
        shell.wait_node(name, lambda n, own=own: n["queue"] == len(own), "all its frames",
                        bus="contention")
    daemon.config.write_text(text)
    shell.run("reload", "contention")
    order = sorted(sum(frames.values(), []), key=priority)
    for name, port in (*ecus.items(), ("receiver", receiver)):
        others = [f for f in order if f not in frames.get(name, ())]
        wait_until(lambda p=port, last=others[-1]: last in seen_by(p), "the last frame")
        hogs = len(port.seen) - len(others)
        assert hogs > 0 and port.seen == [hog] * hogs + others, f"ECU {name}"
    daemon.stop()


def test_a_node_with_order_fifo_sends_in_the_order_of_writing(vcan, can_socket, canwired):
    vcan(2)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    daemon = canwired("""
bus: { name: fifo, bitrate: 125000 }
nodes:
  - { name: a, port: vcan0, order: fifo }
  - { name: b, port: vcan1 }
""")
    written = [Frame.parse(f"{i:03X}#{i:04X}") for i in (0x700, 0x100, 0x600, 0x200, 0x500)]
    a.send(*written)
    assert b.receive(len(written)) == written
    daemon.stop()


# ---- To whom -------------------------------------------------------------------------------------


def test_no_frame_comes_back_to_its_sender(vcan, can_socket, canwired):
    vcan(3)
    daemon = canwired("""
bus: { name: sender, bitrate: 1000000 }
nodes:
  - { name: a, port: vcan0 }
  - { name: b, port: vcan1 }
  - { name: c, port: vcan2 }
""")
    ports = [can_socket(f"vcan{i}") for i in range(3)]
    neighbours = [can_socket(f"vcan{i}") for i in range(3)]  # other programs in the same ECU
    frames = [[Frame.parse(f"{i + 1}{k:02X}#{k:02X}") for k in range(10)] for i in range(3)]
    for port, own in zip(ports, frames):
        port.send(*own)
    last = Frame.parse("7FF#")  # of the lowest priority: when it is there, so are all others
    ports[0].send(last)
    for port in ports[1:]:
        wait_until(lambda p=port: last in seen_by(p), "the last frame")
    # all ECUs have had time for whatever should not come
    for i, (port, neighbour) in enumerate(zip(ports, neighbours)):
        others = sorted(f for k, own in enumerate(frames) if k != i for f in own)
        others += [last] if i else []
        assert sorted(seen_by(port)) == sorted(others)
        own = frames[i] + ([] if i else [last])
        assert sorted(neighbour.drain()) == sorted(own + others)  # own ones once: vcan's own echo
    daemon.stop()


def seen_by(port):
    """Returns all frames that a socket has received so far."""
    port.seen = getattr(port, "seen", []) + port.drain()
    return port.seen


# ---- Completeness --------------------------------------------------------------------------------

MANY = 10000
OUTSTANDING = 500  # written and not yet seen by the peer


def test_10000_frames_each_way_arrive_once_and_in_order(vcan, can_socket, canwired, listen):
    vcan(2)
    messages = listen("many")
    daemon = canwired(TWO_NODES.format(bus="many"))
    ends = [can_socket("vcan0"), can_socket("vcan1")]
    written = [[sequence_frame(0x100 + i, k) for k in range(MANY)] for i in range(2)]
    sent, received = [0, 0], [[], []]
    deadline = time.monotonic() + 4 * PATIENCE_S
    while min(map(len, received)) < MANY and time.monotonic() < deadline:
        for i, end in enumerate(ends):
            received[i] += end.drain()
            upto = min(MANY, len(received[1 - i]) + OUTSTANDING)
            end.send(*written[i][sent[i] : upto])
            sent[i] = max(upto, sent[i])
        select.select([e.socket for e in ends], [], [], 1)  # poll: in a loop
    assert received[1] == written[0]
    assert received[0] == written[1]
    bus, nodes = messages.wait_final(daemon.stop())
    assert bus.frames == 2 * MANY
    assert bus.error_frames == 0
    for node in nodes.values():
        assert (node.handed_in, node.tx_frames, node.rx_frames) == (MANY, MANY, MANY)
    assert not ends[0].drain() and not ends[1].drain()


def sequence_frame(can_id, number):
    return Frame(can_id, 4, number.to_bytes(4, "big"))


def test_python_can_and_can_utils_talk_to_each_other(vcan, canwired):
    for tool in ("candump", "cansend"):
        assert shutil.which(tool), f"{tool} is missing: run scripts/install-deps test"
    vcan(2)
    daemon = canwired(TWO_NODES.format(bus="programs"))
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        subprocess.run(["cansend", "vcan1", "123#DEADBEEF"], check=True)
        message = bus.recv(PATIENCE_S)  # whole: a frame
        assert (message.arbitration_id, message.data) == (0x123, b"\xde\xad\xbe\xef")
        assert not message.is_extended_id

        dump = subprocess.Popen(
            ["candump", "-L", "-n", "1", "vcan1"], stdout=subprocess.PIPE, text=True
        )
        reply = can.Message(arbitration_id=0x12345678, data=b"\x01\x02", is_extended_id=True)
        line = ""
        while not line:  # until candump listens
            bus.send(reply)
            if select.select([dump.stdout], [], [], 0.2)[0]:  # poll: in a loop
                line = dump.stdout.readline()
        assert line.split()[1:] == ["vcan1", "12345678#0102"]
        assert dump.wait(PATIENCE_S) == 0
    daemon.stop()


# ---- Content -------------------------------------------------------------------------------------


def all_kinds():
    """Returns data and remote, base and extended frames, with every DLC of the wire."""
    kinds, digits = [], random.Random(1)
    for flags in (0, EXTENDED, REMOTE, EXTENDED | REMOTE):
        for dlc in range(16):
            identifier = digits.getrandbits(29 if flags & EXTENDED else 11)
            data = b"" if flags & REMOTE else digits.randbytes(min(dlc, 8))
            kinds.append(Frame(identifier | flags, dlc, data))
    return kinds


def test_every_kind_of_frame_passes_unchanged(vcan, can_socket, canwired):
    vcan(2)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    daemon = canwired(TWO_NODES.format(bus="kinds").replace("4096", "4096, order: fifo"))
    frames = all_kinds()
    a.send(*frames)
    assert b.receive(len(frames)) == frames
    b.send(*frames)
    assert a.receive(len(frames)) == frames
    daemon.stop()


def raw_frame(can_id):
    return lambda s: s.send_raw(Frame(can_id, 0).pack())


def fd_frame(s):
    s.allow_fd()
    s.send_raw(FD.pack(0x123, 8, 0, bytes(64)))


BAD = {
    "11-bit identifier over 7FF": (raw_frame(0x800), 16, "dropped_bad_frame"),
    "FD frame on a classical bus": (fd_frame, 72, "dropped_bad_frame"),
    "error frame": (raw_frame(ERROR | 0x004), 16, "error_frames_ignored"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_frames_are_counted_and_never_sent(kind, vcan, can_socket, canwired, listen):
    write, mtu, counter = BAD[kind]
    vcan(2, mtu)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    b.allow_fd()
    b.socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, socket.CAN_ERR_MASK)
    messages = listen("bad")
    daemon = canwired(TWO_NODES.format(bus="bad"))
    good = Frame.parse("456#00")
    write(a)
    write(a)
    a.send(good)
    assert b.receive(1) == [good]
    bus, nodes = messages.wait_final(daemon.stop())
    assert getattr(nodes["a"], counter) == 2
    assert (bus.frames, nodes["a"].tx_frames, nodes["b"].rx_frames) == (1, 1, 1)
    assert not b.drain()
