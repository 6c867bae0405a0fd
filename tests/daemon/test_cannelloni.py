# SPDX-License-Identifier: MIT
"""Tunnels to ECUs on other machines, ports cannelloni:, against a second implementation.

This needs no CAN in the kernel.
"""

import json
import re
import signal
import socket

import pytest

from busrig import BusRig, rig_fixture
from busclient import FD as CLIENT_FD
from busclient import LOOPBACK, Client
from cannelloni import FD, RTR, Datagrams, Stream, connect, pack, packet
from ports import free_port
from simtool import canwire, kill_all
from talker import PATIENCE_S
from test_record import wait_until

BUS = """bus: {{ name: far, bitrate: {bitrate}{bus} }}
control: far.sock
defaults: {{ order: fifo }}
nodes:
  - {{ name: far, port: "cannelloni:{port}"{far} }}
  - {{ name: lamp, port: "unix:lamp.sock"{lamp} }}
"""
EFF = 0x80000000


class Rig(BusRig):
    TEXT, CONTROL = BUS, "far.sock"
    VALUES = {"bitrate": 500000, "bus": "", "far": "", "lamp": ""}

    def __init__(self, folder, port, **more):
        super().__init__(folder, port=port, **more)

    def lamp(self, options=LOOPBACK):
        return Client(self.folder / "lamp.sock", "lamp", options)

    def node(self, name="far"):
        return self.nodes()[name]

    def tunnel(self):
        return self.node()["tunnel"]

    def wait(self, condition, what):
        wait_until(lambda: condition(self.node()), what)


fixture_rig = rig_fixture(Rig)


def udp(rig, more="", **other):
    """Returns a bus and the other end of its tunnel."""
    end, own = Datagrams(), free_port(socket.SOCK_DGRAM)
    r = rig(f"udp,listen={own},peer=127.0.0.1:{end.port}{more}", **other)
    return r, end.to(own)


FRAMES = [(0x123, b"\1\2\3"), (0x7FF, b""), (0, bytes(range(8))), (0x1ABCDEF0 | EFF, b"\xff"),
          (0x123 | EFF, bytes(8))]


def test_udp_in_both_directions(rig):
    r, end = udp(rig)
    lamp = r.lamp()
    end.send(0, *(pack(*frame) for frame in FRAMES), pack(0x321 | RTR, length=5))
    got = [lamp.receive() for _ in range(6)]
    assert [(m.can_id, m.data) for m in got[:5]] == FRAMES
    assert (got[5].can_id, got[5].body[4]) == (0x321 | RTR, 5)
    for can_id, data in FRAMES:
        lamp.send(can_id, data)
    lamp.send(0x321 | RTR, bytes(3))
    assert [end.receive() for _ in range(6)] == [(i, d, None) for i, d in FRAMES] + [
        (0x321 | RTR, 3, None)]
    assert [number for number, *_ in end.packets] == list(range(len(end.packets)))
    tunnel = r.tunnel()
    assert (tunnel["state"], tunnel["packets_read"]) == ("up", 1)
    assert tunnel["packets_written"] == len(end.packets)
    assert tunnel["held_max_ns"] >= tunnel["held_last_ns"] > 0
    assert tunnel["missing"] == tunnel["late"] == tunnel["duplicate"] == tunnel["malformed"] == 0
    interface = r.node()["interface"]
    assert (interface["read"], interface["written"], interface["unheard"]) == (6, 6, 0)
    text = r.run("status", "./far.sock").stdout
    assert "    tunnel up: packets read 1 written " in text
    assert re.search(r"    tunnel delay: held here up to \d+ us, waited to be read up to \d+ us\n",
                     text)
    r.stop()


def test_fd(rig):
    r, end = udp(rig, bus=", dbitrate: 2000000")
    lamp = r.lamp(LOOPBACK | CLIENT_FD)
    end.send(0, pack(0x123, bytes(range(12)), flags=5), pack(0x124, b"\1" * 64, flags=0),
             pack(0x125, b"\2" * 9, flags=1), pack(0x126, b"", flags=1), pack(0x127, b"\3"))
    got = [lamp.receive() for _ in range(5)]
    assert [(m.can_id, len(m.body), m.data, m.body[5]) for m in got] == [
        (0x123, 72, bytes(range(12)), 5), (0x124, 72, b"\1" * 64, 4),
        (0x125, 72, b"\2" * 9 + bytes(3), 5), (0x126, 72, b"", 5), (0x127, 16, b"\3", 0)]
    lamp.send_fd(0x200, bytes(range(48)), flags=1)
    lamp.send(0x201, b"x")
    assert [end.receive() for _ in range(2)] == [(0x200, bytes(range(48)), 5), (0x201, b"x", None)]
    assert r.node()["interface"]["rounded"] == 1
    r.stop()


def test_frames_are_collected_until_a_packet_is_full(rig):
    """A frame of 8 bytes has 13 bytes in a packet of 5 + 7 * 13 = 96."""
    r, end = udp(rig, ",timeout=1s,mtu=97")
    lamp = r.lamp()
    for i in range(22):
        lamp.send(0x100 + i, bytes(8))
    assert [end.receive() for _ in range(22)] == [(0x100 + i, bytes(8), None) for i in range(22)]
    assert [len(frames) for _, frames, _ in end.packets] == [7, 7, 7, 1]
    assert [size for *_, size in end.packets] == [96, 96, 96, 18]
    held = r.tunnel()["held_max_ns"]
    assert held >= 1000000000  # the last one has waited for the timeout
    r.stop()


def test_without_a_timeout_each_frame_is_a_packet(rig):
    r, end = udp(rig, ",timeout=0")
    lamp = r.lamp()
    for i in range(10):
        lamp.send(i)
    for _ in range(10):
        end.receive()
    assert [(number, len(frames)) for number, frames, _ in end.packets] == [
        (i, 1) for i in range(10)]
    r.stop()


def test_numbers_that_are_missing_late_or_twice(rig):
    r, end = udp(rig)
    lamp = r.lamp()

    def expect(*numbers):
        assert [lamp.receive().can_id for _ in numbers] == list(numbers)

    for number in 254, 255, 0, 1:  # the begin does not matter, nor the end of eight bits
        end.send(number, pack(number))
    expect(254, 255, 0, 1)
    assert r.tunnel()["missing"] == 0
    end.send(4, pack(4))
    end.send(3, pack(3))  # late
    end.send(3, pack(3))  # twice
    end.send(4, pack(4))  # twice
    end.send(5, pack(5))
    expect(4, 3, 5)
    tunnel = r.tunnel()
    assert (tunnel["missing"], tunnel["late"], tunnel["duplicate"]) == (2, 1, 2)
    end.send(0, pack(0x700))  # the peer has begun again
    end.send(1, pack(0x701))
    end.send(100, pack(0x702))
    expect(0x700, 0x701, 0x702)
    tunnel = r.tunnel()
    assert (tunnel["missing"], tunnel["restarts"], tunnel["packets_read"]) == (100, 1, 12)
    end.send(101)  # no frames
    end.send(102, pack(0x703))
    expect(0x703)
    assert r.tunnel()["missing"] == 100
    r.stop()
    assert "packets of the tunnel that have not come, or not yet" in r.log.read_text()


@pytest.mark.parametrize("wrong", [
    b"", b"\2", packet(0)[:4], packet(0, pack(0x123), version=1), packet(0, version=3),
    packet(0, pack(0x123), operation=1), packet(0, pack(0x123), count=2),
    packet(0, pack(0x123, b"12345678"))[:-1], packet(0, pack(0x123, bytes(9))),
    packet(0, pack(1), pack(0x123, length=FD - 1)), packet(0, pack(0x123, bytes(65), flags=0)),
    packet(0, pack(0x123))[:-1], packet(0, pack(1), b"\0\0\0"[:3], count=2)])
def test_wrong_packets(wrong, tmp_path):
    end, own = Datagrams(), free_port(socket.SOCK_DGRAM)
    r = Rig(tmp_path, f"udp,listen={own},peer=127.0.0.1:{end.port}", bus=", dbitrate: 2000000")
    try:
        lamp = r.lamp()
        end.to(own).socket.send(wrong)
        end.send(7, pack(0x700))
        assert lamp.receive().can_id == 0x700
        assert r.tunnel()["malformed"] == r.node()["interface"]["malformed"] == 1
        r.stop()
    finally:
        kill_all([r.process])


def test_bytes_behind_the_frames_of_a_packet_are_left_alone(rig):
    """As cannelloni does, whose parser reads as many frames as the head says."""
    r, end = udp(rig)
    lamp = r.lamp()
    end.socket.send(packet(0, pack(0x123, b"1")) + b"padding")
    end.socket.send(packet(1) + bytes(40))
    end.socket.send(packet(2, pack(0x124), pack(0x125, b"2"), count=1))
    end.send(3, pack(0x126))
    assert [lamp.receive().can_id for _ in range(3)] == [0x123, 0x124, 0x126]
    tunnel = r.tunnel()
    assert (tunnel["packets_read"], tunnel["malformed"], tunnel["missing"]) == (4, 0, 0)
    r.stop()


def test_packets_of_strangers(rig):
    end, own = Datagrams(), free_port(socket.SOCK_DGRAM)
    r = rig(f"udp,listen=0.0.0.0:{own},peer=127.0.0.2:{end.port}")
    lamp = r.lamp()
    end.to(own).send(0, pack(0x123))
    peer = Datagrams("127.0.0.2").to(own)  # its port does not matter
    peer.send(0, pack(0x124))
    assert lamp.receive().can_id == 0x124
    assert r.tunnel()["strangers"] == 1
    r.stop()


def test_error_frames_do_not_pass(rig):
    r, end = udp(rig, far=", berr-reporting: on", lamp=", listen-only: on")
    lamp = r.lamp()
    end.send(0, pack(0x20000000, bytes(8)), pack(0x123))
    r.wait(lambda node: node["tx_errors"] > 20, "errors, as nobody acknowledges")
    node = r.node()
    assert node["interface"]["errors_ignored"] == 1
    assert node["interface"]["errors_unheard"] > 0 and node["interface"]["errors_written"] == 0
    r.run("set", "./far.sock", "lamp", "listen-only=off")
    assert lamp.receive().can_id == 0x123
    lamp.send(0x124)
    assert end.receive() == (0x124, b"", None)
    r.stop()


def test_more_frames_than_the_queue_holds_wait(rig):
    r, end = udp(rig, far=", queue: 3")
    lamp = r.lamp()
    for number in range(10):
        end.send(number, *(pack(0x100 + i, bytes([number])) for i in range(100)))
    got = [lamp.receive() for _ in range(1000)]
    assert [(m.can_id, m.data) for m in got] == [
        (0x100 + i, bytes([number])) for number in range(10) for i in range(100)]
    node = r.node()
    assert node["interface"]["pushed_back"] > 0 and node["interface"]["kernel_dropped"] == 0
    r.stop()


# ---- TCP ----------------------------------------------------------------------------------------


def test_tcp_that_listens(rig):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    lamp = r.lamp()
    assert r.tunnel()["state"] == "waiting"
    lamp.send(0x100)
    r.wait(lambda node: node["interface"]["unheard"] == 1, "a frame for nobody")
    end = connect(port)
    r.wait(lambda node: node["tunnel"]["state"] == "up", "the greeting")
    whole = b"".join(pack(*frame) for frame in FRAMES) + pack(0x321 | RTR, length=5)
    for byte in whole:
        end.send(bytes([byte]))
    got = [lamp.receive() for _ in range(6)]
    assert [(m.can_id, m.data) for m in got[:5]] == FRAMES
    end.send(whole * 100)  # more than one read, and than the queue
    for _ in range(100):
        assert [lamp.receive().can_id for _ in range(6)] == [i for i, _ in FRAMES] + [0x321 | RTR]
    for can_id, data in FRAMES:
        lamp.send(can_id, data)
    assert [end.receive() for _ in range(5)] == [(i, d, None) for i, d in FRAMES]
    with socket.create_connection(("127.0.0.1", port)) as other:  # one at a time
        assert other.recv(1) == b""  # whole: the end
    assert r.node()["interface"]["refused"] == 1
    end.close()
    r.wait(lambda node: node["tunnel"]["state"] == "waiting", "its end")
    end = connect(port)
    end.send(pack(0x222))
    assert lamp.receive().can_id == 0x222
    assert r.node()["interface"]["connected"] == 2
    r.stop()
    assert "the peer is connected" in r.log.read_text()


def test_a_connection_that_does_not_greet_leaves_its_place(rig):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    lamp, tries = r.lamp(), []

    def comes():
        tries.append(socket.create_connection(("127.0.0.1", port)))
        tries[-1].sendall(b"CANNELLONIv1" + pack(0x123))
        try:
            return tries[-1].recv(12) == b"CANNELLONIv1"  # whole: it is sent at once
        except ConnectionResetError:
            return False

    with socket.create_connection(("127.0.0.1", port)) as silent:
        assert silent.recv(12) == b"CANNELLONIv1"  # whole: it is sent at once
        wait_until(comes, "a place for a peer that greets")
        assert silent.recv(1) == b""  # whole: the end
        assert lamp.receive().can_id == 0x123
        with socket.create_connection(("127.0.0.1", port)) as other:  # that one stays
            assert other.recv(1) == b""  # whole: the end
    for end in tries:
        end.close()
    r.stop()


def test_a_peer_that_connects_again_at_once_comes_in(rig):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    lamp = r.lamp()
    before = connect(port)
    before.send(pack(0x100))
    assert lamp.receive().can_id == 0x100
    r.process.send_signal(signal.SIGSTOP)
    after = socket.create_connection(("127.0.0.1", port))
    after.sendall(b"CANNELLONIv1" + pack(0x101))
    before.close()
    r.process.send_signal(signal.SIGCONT)  # and finds both the new one and the end of the old one
    assert lamp.receive().can_id == 0x101
    assert r.node()["interface"]["refused"] == 0
    after.close()
    r.stop()


@pytest.mark.parametrize("ids", [[], [0x100, 0x101]])
def test_a_peer_that_goes_at_once_keeps_nobody_out(rig, ids):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    lamp = r.lamp()
    r.process.send_signal(signal.SIGSTOP)
    before = socket.create_connection(("127.0.0.1", port))
    if ids:
        before.sendall(b"CANNELLONIv1" + b"".join(pack(i) for i in ids))
    before.close()
    after = socket.create_connection(("127.0.0.1", port))
    after.sendall(b"CANNELLONIv1" + pack(0x102))
    r.process.send_signal(signal.SIGCONT)  # and finds both, the first one with its end
    assert [lamp.receive().can_id for _ in (*ids, 0)] == [*ids, 0x102]
    assert r.node()["interface"]["refused"] == 0
    after.close()
    r.stop()


def stuck(rig, more=""):
    """Returns a bus, its port and a peer that has gone, whose 1000 frames wait since nobody
    acknowledges."""
    port = free_port()
    r = rig(f"tcp,listen={port}{more}", far=", queue: 4", lamp=", listen-only: on",
            bitrate=1000000)
    before = connect(port)
    before.send(*(pack(i, bytes(8)) for i in range(1000)))
    r.wait(lambda node: node["pushing_back"], "a full queue")
    before.close()
    return r, port


def test_a_peer_that_has_gone_gives_its_place_when_its_frames_have_been_read(rig):
    r, port = stuck(rig)
    lamp = r.lamp()
    after = [socket.create_connection(("127.0.0.1", port)) for _ in range(5)]
    after[-1].sendall(b"CANNELLONIv1" + pack(0x7FF))  # the last to come is the one that is alive
    r.run("set", "./far.sock", "lamp", "listen-only=off")
    ids = []
    while 0x7FF not in ids:  # an error-passive sender sends what lamp has got already again
        if (can_id := lamp.receive().can_id) < 0x800 and can_id not in ids:
            ids.append(can_id)
    interface = r.node()["interface"]
    assert ids == [*range(1000 - interface["kernel_dropped"]), 0x7FF]
    assert (interface["refused"], interface["connected"]) == (4, 2)
    for end in after:
        end.close()
    r.stop()


def test_what_waits_for_a_peer_that_has_gone_is_lost_and_counted(rig):
    port = free_port()
    r = rig(f"tcp,listen={port},timeout=1s")
    lamp, end = r.lamp(), connect(port)
    r.wait(lambda node: node["tunnel"]["state"] == "up", "the greeting")
    r.process.send_signal(signal.SIGSTOP)
    for i in range(5):
        lamp.send(i)
    end.close()
    r.process.send_signal(signal.SIGCONT)
    r.wait(lambda node: node["tunnel"]["state"] == "waiting", "its end")
    lamp.send(5)
    r.wait(lambda node: sum(node["interface"][key] for key in ("unheard", "write_failed")) == 6,
           "the loss of all frames")
    assert r.node()["interface"]["written"] == 0
    r.stop()


def test_many_connections_at_once(rig):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    lamp, end = r.lamp(), connect(port)
    r.wait(lambda node: node["tunnel"]["state"] == "up", "the greeting")
    r.process.send_signal(signal.SIGSTOP)
    others = []
    for _ in range(8):  # these need no answer of canwired
        others.append(socket.socket())
        others[-1].settimeout(PATIENCE_S)
        others[-1].connect(("127.0.0.1", port))
    r.process.send_signal(signal.SIGCONT)
    for other in others:
        assert other.recv(1) == b""  # whole: the end
    end.send(pack(0x123))
    assert lamp.receive().can_id == 0x123
    assert r.node()["interface"]["refused"] == 8
    r.stop()


def test_tcp_that_connects(rig):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.settimeout(PATIENCE_S)
        r = rig(f"tcp,connect=127.0.0.1:{listener.getsockname()[1]}", bus=", dbitrate: 2000000")
        lamp = r.lamp(LOOPBACK | CLIENT_FD)
        for _ in range(2):  # it connects again when the peer has gone
            end = Stream(listener.accept()[0])
            end.send(pack(0x123, bytes(16), flags=1), pack(0x124 | EFF))
            assert [lamp.receive().can_id for _ in range(2)] == [0x123, 0x124 | EFF]
            lamp.send_fd(0x125, bytes(64), flags=1)
            assert end.receive() == (0x125, bytes(64), 5)
            end.close()
    r.stop()


def test_tcp_waits_for_a_peer_that_listens_later(rig):
    port = free_port()
    r = rig(f"tcp,connect=127.0.0.1:{port}")
    assert r.tunnel()["state"] in ("waiting", "connecting")
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen()
        listener.settimeout(PATIENCE_S)
        end = Stream(listener.accept()[0])
        r.lamp().send(0x123)
        r.wait(lambda node: node["tunnel"]["state"] == "up", "the greeting")
        r.lamp().send(0x124)
        assert end.receive()[0] in (0x123, 0x124)
    r.stop()


@pytest.mark.parametrize("greeting, more", [
    (b"GET / HTTP/1.1\r\n\r\n", b""), (b"CANNELLONIv2", b""),
    (b"CANNELLONIv1", pack(0x123, bytes(9)))])
def test_wrong_streams(rig, greeting, more):
    port = free_port()
    r = rig(f"tcp,listen={port}")
    end = Stream(socket.create_connection(("127.0.0.1", port)), greeting)
    end.send(more)
    assert end.ends()
    assert r.tunnel()["malformed"] == 1
    lamp, good = r.lamp(), connect(port)
    good.send(pack(0x123))
    assert lamp.receive().can_id == 0x123
    r.stop()


def test_tcp_to_a_peer_that_does_not_read(rig):
    port = free_port()
    r = rig(f"tcp,listen={port},timeout=0", bitrate=1000000)
    lamp = r.lamp()
    quiet = socket.socket()
    quiet.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    quiet.connect(("127.0.0.1", port))
    end = Stream(quiet)
    r.wait(lambda node: node["tunnel"]["state"] == "up", "the greeting")
    number = 0
    while (interface := r.node()["interface"])["write_failed"] == 0:
        for _ in range(1000):
            lamp.send(number & 0x7FF, number.to_bytes(8, "little"))
            number += 1
    written = interface["written"]
    r.wait(lambda node: node["interface"]["written"] + node["interface"]["write_failed"] == number,
           "the last frame")
    numbers = [int.from_bytes(end.receive()[1], "little") for _ in range(written)]
    assert numbers == list(range(written))  # whole frames, and the first ones
    r.stop()


def test_a_reload(rig):
    r, end = udp(rig)
    lamp = r.lamp()
    end.send(10, pack(0x100))
    assert lamp.receive().can_id == 0x100
    text = (r.folder / "bus.yaml").read_text()
    (r.folder / "bus.yaml").write_text(text.replace("order: fifo", "order: fifo, restart-ms: 7"))
    r.run("reload", "./far.sock")
    end.send(11, pack(0x101))
    assert lamp.receive().can_id == 0x101
    assert r.tunnel()["packets_read"] == 2  # the port is the same
    other = free_port(socket.SOCK_DGRAM)
    r.write(port=f"udp,listen={other},peer=127.0.0.1:{end.port}")
    r.run("reload", "./far.sock")
    end.to(other).send(12, pack(0x102))
    assert lamp.receive().can_id == 0x102
    assert r.tunnel()["packets_read"] == 1
    r.stop()


def test_the_journal(rig):
    r, end = udp(rig, journal=True)
    lamp = r.lamp()
    end.send(0, *(pack(0x100 + i, bytes(i & 7)) for i in range(50)))
    assert [lamp.receive().can_id for _ in range(50)] == [0x100 + i for i in range(50)]
    r.stop()
    out = canwire("sim", "--journal", "bus.journal", "--events", "-", cwd=r.folder).stdout
    ids = [json.loads(line)["frame"].split("#")[0] for line in out.splitlines()
           if '"event":"tx"' in line]
    assert ids == [f"{0x100 + i:X}" for i in range(50)]


def test_two_buses_are_joined_by_a_tunnel(tmp_path):
    ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
    rigs = []
    try:
        for k in range(2):
            (tmp_path / str(k)).mkdir()
            rigs.append(Rig(tmp_path / str(k), f"udp,listen={ports[k]},peer=127.0.0.1:"
                                               f"{ports[1 - k]}"))
        lamps = [r.lamp() for r in rigs]
        for k in range(2):  # two nodes with one identifier would disturb each other
            for i in range(200):
                lamps[k].send(0x200 * k + i)
        for k in range(2):
            assert [lamps[1 - k].receive().can_id for _ in range(200)] == [
                0x200 * k + i for i in range(200)]
        for r in rigs:
            assert r.tunnel()["missing"] == 0
            r.stop()
    finally:
        kill_all(r.process for r in rigs)


def test_interfaces_are_not_made_for_it(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        'bus: { bitrate: 500000 }\n'
        'nodes: [ { name: a, port: "cannelloni:udp,peer=192.168.1.2:20001" } ]\n')
    canwire("check", "--ports", "bus.yaml", cwd=tmp_path)
    assert canwire("vcan", "up", "bus.yaml", cwd=tmp_path).stdout == ""
