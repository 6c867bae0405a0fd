# SPDX-License-Identifier: MIT
"""Programs that speak as to socketcand, at ports tcp:PORT: python-can's own interface, and others
by the protocol of canwire-ports(7).

This needs no CAN in the kernel.
"""

import contextlib
import logging
import re
import socket
import subprocess
import time
import xml.etree.ElementTree as ElementTree

import can
import pytest

from busclient import Client
from busrig import BusRig, rig_fixture
from ports import bind_soon, free_port
from simtool import CANWIRED, ROOT, canwire, kill_all, listens
from talker import PATIENCE_S, Talker
from test_record import wait_until

BUS = """bus: {{ name: talk, bitrate: {bitrate}{bus} }}
control: talk.sock
defaults: {{ order: fifo }}
nodes:
  - {{ name: engine, port: "tcp:{port}"{engine} }}
  - {{ name: dash, port: "tcp:127.0.0.1:{port}{as_}"{dash} }}
  - {{ name: lamp, port: "unix:lamp.sock"{lamp} }}
{more}"""


class Rig(BusRig):
    TEXT, CONTROL = BUS, "talk.sock"
    VALUES = {"bitrate": 500000, "bus": "", "engine": "", "dash": "", "lamp": "", "more": "",
              "as_": ""}

    def __init__(self, folder, port=None, **more):
        self.port = port or free_port()
        super().__init__(folder, **more)

    def write(self, **more):
        super().write(port=self.port, **more)

    def can(self, channel="engine", **more):
        return can.Bus(interface="socketcand", host="127.0.0.1", port=self.port, channel=channel,
                       **more)

    def talk(self, bus="engine", mode="rawmode", **more):
        return Talker(self.port, bus, mode, **more)

    def lamp(self):
        return Client(self.folder / "lamp.sock")

    def node(self, name="engine"):
        return self.nodes()[name]

    def wait(self, condition, what, name="engine"):
        wait_until(lambda: condition(self.node(name)), what)


fixture_rig = rig_fixture(Rig)


def seen(bus):
    """Returns the next message of python-can: identifier, extended, data."""
    message = bus.recv(PATIENCE_S)  # whole: a frame
    assert message is not None
    return message.arbitration_id, message.is_extended_id, bytes(message.data)


# ---- python-can ---------------------------------------------------------------------------------

FRAMES = [(0x123, False, b"\1\2\3"), (0x7FF, False, b""), (0, False, bytes(range(8))),
          (0x1ABCDEF0, True, b"\xff"), (0x123, True, bytes(8))]


def test_python_can_in_both_directions(rig):
    r = rig()
    with r.can() as engine, r.can("dash") as dash:
        for can_id, extended, data in FRAMES:
            engine.send(can.Message(arbitration_id=can_id, is_extended_id=extended, data=data))
        assert [seen(dash) for _ in FRAMES] == FRAMES
        for can_id, extended, data in FRAMES:
            dash.send(can.Message(arbitration_id=can_id, is_extended_id=extended, data=data))
        assert [seen(engine) for _ in FRAMES] == FRAMES
        for name in "engine", "dash":
            node = r.node(name)
            assert (node["interface"]["read"], node["interface"]["written"]) == (5, 5), node
            (client,) = node["clients"]
            assert re.fullmatch(r"127\.0\.0\.1:\d+", client["name"])
            assert (client["read"], client["written"], client["lost"]) == (5, 5, 0)
        assert re.search(r"    client 127\.0\.0\.1:\d+: read 5 written 5 lost 0\n",
                         r.run("status", "./talk.sock").stdout)
    r.wait(lambda node: node["clients"] == [], "the end of the program")
    r.stop()


def test_python_can_with_several_programs_and_filters(rig):
    r = rig()
    with r.can() as first, r.can() as second, r.can(
            can_filters=[{"can_id": 0x120, "can_mask": 0x7F0}]) as third, r.can("dash") as dash:
        first.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"a"))
        second.send(can.Message(arbitration_id=0x321, is_extended_id=False, data=b"b"))
        dash.send(can.Message(arbitration_id=0x12F, is_extended_id=False, data=b"c"))
        assert sorted(seen(first)[0] for _ in range(2)) == [0x12F, 0x321]  # never its own
        assert sorted(seen(second)[0] for _ in range(2)) == [0x123, 0x12F]
        assert [seen(third)[0] for _ in range(2)] == [0x123, 0x12F]
        assert sorted(seen(dash)[0] for _ in range(2)) == [0x123, 0x321]
    r.stop()


def test_python_can_sees_what_was_sent_when_the_bus_has_sent_it(rig):
    r = rig(engine=", clients: { echo: sent }", dash=", listen-only: on", lamp=", listen-only: on")
    with r.can() as first, r.can() as second:
        first.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        error = second.recv(PATIENCE_S)  # whole: a frame; nobody acknowledges
        assert error.is_error_frame and error.arbitration_id == 0x204  # CAN_ERR_CRTL, CNT
        r.run("set", "./talk.sock", "lamp", "listen-only=off")
        while (message := second.recv(PATIENCE_S)).is_error_frame:
            pass
        assert message.arbitration_id == 0x123
    r.stop()


def test_python_can_comes_to_a_busy_bus(rig):
    """It wants the answer to `rawmode` in a piece of its own."""
    r = rig(bitrate=1000000, 
            more="  - { name: load, traffic: [ { send: 100#1122334455667788, every: 150us } ] }\n")
    for _ in range(3):
        t = r.talk(mode=None)
        began = time.monotonic()
        assert t.ask("rawmode") == "< ok >"
        assert t.receive().startswith("< frame 100 ") and time.monotonic() - began >= 0.05
        with contextlib.suppress(can.CanError), r.can() as bus:  # if this processor is not away
            assert seen(bus)[0] == seen(bus)[0] == 0x100
    r.stop()


def test_the_example_of_the_page(rig):
    r = rig()
    page = (ROOT / "daemon/man/canwire-ports.7.md").read_text()
    example = next(text for text in re.findall(r"```python\n(.*?)```", page, re.S)
                   if "socketcand" in text)
    lamp, names = r.lamp(), {}
    exec(example.replace("29536", str(r.port)), names)
    message = lamp.receive()
    assert (message.can_id, message.data) == (0x123, b"\x11\x22")
    names["bus"].shutdown()
    r.stop()


def test_what_python_can_does_not_say_is_counted(rig):
    """Its interface has one command for all frames (canwire-ports(7))."""
    r = rig()
    lamp = r.lamp()
    with r.can() as engine:
        engine.send(can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True,
                                dlc=3))
        engine.send(can.Message(arbitration_id=0x124, is_extended_id=False, is_fd=True,
                                data=bytes(12)))
        engine.send(can.Message(arbitration_id=0x125, is_extended_id=False, is_fd=True, data=b"a"))
        assert (message := lamp.receive()).can_id == 0x125 and message.data == b"a"
        assert r.node()["interface"]["malformed"] == 2
        assert "    port: connected 1 refused 0 gave-way 0 malformed 2\n" in r.run(
            "status", "./talk.sock").stdout
    r.stop()


def test_python_can_sends_periodically(rig):
    r = rig()
    with r.can() as engine, r.can("dash") as dash:
        task = engine.send_periodic(can.Message(arbitration_id=0x100, is_extended_id=False), 0.01)
        assert [seen(dash)[0] for _ in range(5)] == [0x100] * 5
        task.stop()
    r.stop()


def test_python_can_at_a_wrong_bus(rig):
    r = rig()
    with pytest.raises(can.CanError, match="could not open bus"):
        r.can("can0")
    r.wait(lambda node: node["interface"]["refused"] == 1, "the refusal")
    r.stop()
    assert "refused" in r.log.read_text()


def test_the_beacon(rig):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bind_soon(s, ("127.255.255.255", 42000))  # loopback's network alone
        s.settimeout(PATIENCE_S)
        r = rig(engine=", clients: { beacon: yes }", dash=", clients: { beacon: yes }")
        while True:  # there may be others
            root = ElementTree.fromstring(s.recv(65536).decode())
            if root.find("URL").text == f"can://127.0.0.1:{r.port}":
                break
    assert root.tag == "CANBeacon" and root.get("type") == "SocketCAN"
    wait = [bus.get("name") for bus in root.findall("Bus")]
    assert wait in (["engine"], ["engine", "dash"])  # the first may come before all are open
    r.stop()


# ---- The protocol -------------------------------------------------------------------------------


def test_opening(rig):
    r = rig(as_="/can0", engine=", clients: 2")
    for wrong in "engine2", "dash", "x" * 40:
        t = Talker(r.port)
        assert t.ask(f"open {wrong}") == "< error could not open bus >"
        assert t.ends()
    t = Talker(r.port)
    assert t.ask("rawmode") == "< error unknown command >"
    assert t.ask("echo") == "< echo >"
    assert t.ask("open engine x") == "< error syntax error in open command >"
    assert t.ask("open engine") == "< ok >"
    assert t.ask("open engine") == "< error unknown command >"
    can0 = r.talk("can0")  # the name that dash has here
    other = r.talk()
    third = Talker(r.port)
    assert "as many clients as it takes" in third.ask("open engine")
    assert third.ends()
    t.send("send 123 0")
    assert can0.frame() == ("123", "")
    t.close()
    other.close()
    r.wait(lambda node: node["clients"] == [], "the end of both")
    assert r.talk().ask("echo") == "< echo >"
    bits = Talker(r.port)
    assert bits.ask("can0 B 500000 875 125 6 7 2 1 10") == (
        "< error bit timing and modes are those of the configuration >")
    assert bits.ends()
    r.stop()


def test_frames_as_texts(rig):
    r = rig()
    engine, dash, lamp = r.talk(), r.talk("dash"), r.lamp()
    engine.send("send 123 3 1 F aB")
    assert re.fullmatch(r"< frame 123 \d+\.\d{6} 010FAB >", dash.receive())
    engine.send("send 00000123 1 ff")
    assert re.fullmatch(r"< frame 00000123 \d+\.\d{6} FF >", dash.receive())
    engine.send("send 7FF 0 ")
    assert re.fullmatch(r"< frame 7FF \d+\.\d{6}  >", dash.receive())
    engine.send("sendrtr 123 5")
    assert re.fullmatch(r"< rtr 123 \d+\.\d{6} 5 >", dash.receive())
    assert [lamp.receive().can_id for _ in range(4)] == [0x123, 0x80000123, 0x7FF, 0x40000123]
    lamp.send(0x1FFFFFFF | 0x80000000, b"\xaa\xbb")
    for t in engine, dash:
        assert re.fullmatch(r"< frame 1FFFFFFF \d+\.\d{6} AABB >", t.receive())
    r.stop()


@pytest.mark.parametrize("command", [
    "send", "send 123", "send 800 0", "send 20000000 0", "send 123 9 1 2 3 4 5 6 7 8 9",
    "send 123 2 1", "send 123 1 1 2", "send 123 1 100", "send 123 1 -1", "send xyz 0",
    "send 0x1 0", "send 123456789 0", "sendrtr 123", "sendrtr 123 9", "sendrtr 123 0 1"])
def test_wrong_frames(rig_for_all, command):
    r = rig_for_all
    engine, dash = r.talk(), r.talk("dash")
    assert engine.ask(command) == f"< error syntax error in {command.split()[0]} command >"
    engine.send("send 111 0")
    assert dash.frame() == ("111", "")


@pytest.fixture(name="rig_for_all", scope="module")
def fixture_rig_for_all(tmp_path_factory):
    r = Rig(tmp_path_factory.mktemp("all"))
    yield r
    kill_all([r.process])


def test_segments(rig):
    r = rig()
    engine, dash = r.talk(), r.talk("dash")
    count = 300
    engine.raw("".join(f"< send {i:03X} 2 {i >> 8:X} {i & 255:X} >" for i in range(count)))
    assert [dash.frame() for _ in range(count)] == [(f"{i:03X}", f"{i:04X}") for i in range(count)]
    for letter in "< send 123 1 42 >":
        engine.raw(letter)
    assert dash.frame() == ("123", "42")
    engine.raw("< send 1")
    other = r.talk()
    other.send("send 124 0")
    assert dash.frame() == ("124", "")
    engine.raw("25 0 >< send 126 0 >< se")
    engine.raw("nd 127 0 >")
    assert [dash.frame()[0] for _ in range(3)] == ["125", "126", "127"]
    engine.raw("\r\n<send 128 0>\n  <  send\t129  1\t7 >\n")  # white space does not matter
    assert [dash.frame() for _ in range(2)] == [("128", ""), ("129", "07")]
    assert r.node()["interface"]["malformed"] == 0
    r.stop()


def test_garbage(rig):
    r = rig()
    engine, dash = r.talk(), r.talk("dash")
    engine.raw("hello? > < send 1")
    engine.raw("23 < send 124 0 >")  # the one before has no end
    assert dash.frame() == ("124", "")
    for wrong in "", "x", "\0", "SEND 123 0", "fly me to the moon", "frame 123 1.0 00":
        assert engine.ask(wrong) == "< error unknown command >", wrong
    engine.socket.sendall(bytes(range(128, 256)) * 100)
    engine.send("send 125 0")
    assert dash.frame() == ("125", "")
    assert r.node()["interface"]["malformed"] == 8
    engine.raw("<" + "send 123 0 " * 2000)  # an endless command
    assert engine.ends() and "the command is too long" in engine.got
    flood = r.talk()
    flood.raw("x" * 1000000)  # no command at all
    flood.send("send 126 0")
    assert dash.frame() == ("126", "")
    r.wait(lambda node: len(node["clients"]) == 1, "the end of the endless one")
    r.stop()
    assert "messages that are no frames" in r.log.read_text()


def test_modes_that_are_not_there(rig):
    r = rig()
    t = r.talk(mode=None)
    assert t.ask("isotpmode") == "< error isotpmode is not supported >"
    assert t.ask("muxfilter 0 0 123 2 FF 00") == "< error muxfilter is not supported >"
    assert t.ask("statistics 10") == "< error unknown command >"
    assert t.ask("bcmmode") == "< ok >"
    assert t.ask("rawmode") == "< ok >"
    assert t.ask("subscribe 0 0 123") == "< error unknown command >"
    r.stop()


def test_subscriptions(rig):
    r = rig()
    t, dash = r.talk(mode=None), r.talk("dash")
    t.send("subscribe 0 0 123", "filter 0 0 124 2 FF 0F", "subscribe 3600 0 125",
           "subscribe 0 0 00000123")
    assert t.ask("echo") == "< echo >"
    dash.send("send 123 2 1 2", "send 122 0", "send 123 2 1 2",  # any content
              "send 124 2 1 2", "send 124 2 1 F2", "send 124 2 1 3", "send 124 2 2 3",
              "send 125 1 1", "send 125 1 2",  # the second one within an hour
              "send 00000123 0", "sendrtr 123 0", "send 123 1 9")
    assert [t.frame() for _ in range(8)] == [
        ("123", "0102"), ("123", "0102"), ("124", "0102"), ("124", "0103"), ("124", "0203"),
        ("125", "01"), ("00000123", ""), ("123", "09")]
    t.send("unsubscribe 123")
    assert t.ask("unsubscribe 7FF") == "< error no subscription has this identifier >"
    dash.send("send 123 0", "send 00000123 1 7")
    assert t.frame() == ("00000123", "07")
    t.send("subscribe 0 0 200", "send 200 1 5")
    assert t.frame() == ("200", "05")  # its own, when the bus has sent it
    for wrong in "subscribe 0 0", "subscribe 0 0 123 1", "filter 0 0 123", "filter 0 0 123 1":
        assert t.ask(wrong) == f"< error syntax error in {wrong.split()[0]} command >"
    r.stop()


def test_a_subscription_with_an_interval_ends_with_the_last_frame(rig):
    r = rig()
    t, dash = r.talk(mode=None), r.talk("dash")
    t.send("subscribe 0 200000 123")
    assert t.ask("echo") == "< echo >"
    dash.send(*(f"send 123 1 {i:X}" for i in range(200)))
    got = [int(t.frame()[1], 16)]
    while got[-1] != 199:
        got.append(int(t.frame()[1], 16))
    assert got[0] == 0 and got == sorted(set(got)) and len(got) < 200
    r.stop()


def test_jobs(rig):
    r = rig()
    t, dash = r.talk(mode=None), r.talk("dash")
    t.send("add 0 5000 123 2 1 2")
    assert [dash.frame() for _ in range(5)] == [("123", "0102")] * 5
    t.send("update 123 1 7")
    while dash.frame() != ("123", "07"):
        pass
    assert [dash.frame() for _ in range(3)] == [("123", "07")] * 3
    t.send("delete 123", "send 124 0", "add 0 0 125 0", "add 3600 0 126 1 1")
    got = [dash.frame()]
    while got[-1][0] != "126":
        got.append(dash.frame())
    after = got[[g[0] for g in got].index("124"):]
    assert after == [("124", ""), ("125", ""), ("126", "01")]
    assert t.ask("delete 123") == "< error no job has this identifier >"
    assert t.ask("update 123 0") == "< error no job has this identifier >"
    for i in range(254):  # 125 and 126 are there
        t.send(f"add 3600 0 {0x300 + i:X} 0")
    assert t.ask("add 3600 0 100 0") == "< error too many jobs >"
    assert [dash.frame()[0] for _ in range(254)] == [f"{0x300 + i:X}" for i in range(254)]
    t.send("delete 300", "add 0 1000 127 0")
    assert dash.frame()[0] == "127"
    assert t.ask("rawmode") == "< ok >"  # this ends all jobs
    t.send("send 128 0")
    while dash.frame()[0] != "128":
        pass
    before = r.node()["interface"]["read"]
    t.send("send 129 0")
    assert dash.frame()[0] == "129"
    assert r.node()["interface"]["read"] == before + 1
    r.stop()


def test_statistics(rig):
    r = rig()
    t, dash = r.talk(mode="controlmode"), r.talk("dash")
    assert t.ask("statistics x") == "< error syntax error in statistics command >"
    t.send("statistics 5")
    assert t.receive() == "< stat 0 0 0 0 >"
    dash.send("send 123 8 1 2 3 4 5 6 7 8", "send 124 1 1")
    sender = r.talk()
    sender.send("send 125 3 1 2 3")
    while t.receive() != "< stat 9 2 3 1 >":
        pass
    t.send("statistics 0")
    assert t.ask("echo") == "< echo >" or t.receive()
    r.stop()


def test_fd(rig):
    r = rig(bus=", dbitrate: 2000000", dash=", kind: fd-tolerant")
    engine, dash = r.talk(), r.talk("dash")
    other = r.talk()
    assert dash.ask("fdsend 123 1 0") == "< error the node knows no CAN FD >"
    engine.send("fdsend 123 5 12 1 2 3 4 5 6 7 8 9 A B C", "fdsend 00000001 0 9" + " FF" * 9,
                "fdsend 7FF 1 64" + " 55" * 64, "send 124 0")
    assert re.fullmatch(r"< fdframe 123 05 \d+\.\d{6} 0102030405060708090A0B0C >", other.receive())
    assert re.fullmatch(r"< fdframe 00000001 04 \d+\.\d{6} F{18}000000 >", other.receive())
    assert re.fullmatch(r"< fdframe 7FF 05 \d+\.\d{6} (55){64} >", other.receive())
    assert other.frame() == ("124", "")
    assert engine.ask("fdsend 123 0 65" + " 00" * 65) == "< error syntax error in fdsend command >"
    assert r.node()["interface"]["rounded"] == 1
    r.stop()


# ---- Programs that do not behave, or go ---------------------------------------------------------


def test_a_program_that_does_not_read_loses_frames_alone(rig):
    r = rig(bitrate=1000000)
    deaf, reader, dash = r.talk(room=2048), r.talk(), r.talk("dash")
    count = 0
    while r.node()["interface"]["clients_lost"] == 0:
        dash.send(*(f"send {i:X} 8 1 2 3 4 5 6 7 8" for i in range(0x100, 0x100 + 1000)))
        assert [reader.frame()[0] for _ in range(1000)] == [f"{i:X}" for i in range(256, 1256)]
        count += 1000
    clients = {c["lost"] > 0: c for c in r.node()["clients"]}
    assert clients[False]["written"] == count
    lost, written = clients[True]["lost"], clients[True]["written"]
    assert lost + written == count
    assert r.node()["interface"]["unheard"] == 0
    got = [deaf.frame() for _ in range(written)]  # it reads whole frames after all
    assert got[:3] == [("100", "0102030405060708"), ("101", "0102030405060708"),
                       ("102", "0102030405060708")]
    dash.send("send 7FF 0")
    assert deaf.frame() == ("7FF", "")
    r.stop()
    assert "not taken by single clients of the port" in r.log.read_text()


def test_connections_that_say_nothing_keep_nobody_out(rig):
    r = rig()
    silent = []
    for i in range(140):  # two ports have 63 places each
        silent.append(socket.create_connection(("127.0.0.1", r.port)))
        if i % 3 == 0:
            silent[-1].sendall(b"< op")  # a half command is none
        if i % 3 == 1:
            silent[-1].sendall(b"< echo >")
    talker = r.talk()
    other = r.talk("dash")
    talker.send("send 123 0")
    assert other.frame() == ("123", "")
    for _ in range(130):  # those that have opened a bus stay
        silent.append(socket.create_connection(("127.0.0.1", r.port)))
    last = r.talk()
    last.send("send 124 0")
    assert other.frame() == talker.frame() == ("124", "")
    nodes = r.nodes()
    gave_way = sum(nodes[name]["interface"]["gave_way"] for name in ("engine", "dash"))
    assert gave_way >= 270 + 3 - 2 * 63
    for name in "engine", "dash":
        assert nodes[name]["interface"]["refused"] == 0
    silent[0].settimeout(PATIENCE_S)
    said = b""
    while part := silent[0].recv(4096):  # whole: up to its end
        said += part
    assert said.endswith(b"< error nothing was said here, and another program has come >")
    for s in silent:
        s.close()
    r.stop()
    assert "connections ended for new ones, since they had said nothing" in r.log.read_text()


LISTENS = ", listen-only: on"


def test_a_program_that_has_gone_keeps_nobody_out_while_its_frames_wait(rig):
    r = rig(engine=", clients: 1, queue: 4", dash=LISTENS, lamp=LISTENS)
    lamp = r.lamp()
    before = r.talk()
    before.send(*(f"send {i:X} 0" for i in range(0x100, 0x180)))
    r.wait(lambda node: node["pushing_back"], "a full queue, as nobody acknowledges")
    before.close()
    after = r.talk(mode=None)
    after.send("send 200 0")
    assert [client["name"] for client in r.node()["clients"]] != []
    r.run("set", "./talk.sock", "lamp", "listen-only=off")
    wanted = {*range(0x100, 0x180), 0x200}
    while wanted:  # nothing is lost; an error-passive sender sends what lamp has got already again
        wanted.discard(lamp.receive().can_id)
    assert r.node()["interface"]["refused"] == 0
    r.stop()


def test_when_all_places_are_taken_one_that_has_gone_leaves_it(rig):
    r = rig(engine=", clients: 63, queue: 4", dash=LISTENS, lamp=LISTENS)
    lamp = r.lamp()
    count, each, more = 63, 7, 5
    # all before the first frame: when the queue is full the port reads no more commands
    for i, t in enumerate([r.talk(mode=None) for _ in range(count)]):
        t.send(*(f"send {i * each + k:X} 0" for k in range(each)))
        t.close()
    r.wait(lambda node: node["pushing_back"], "a full queue, as nobody acknowledges")
    talkers = [r.talk(mode=None) for _ in range(more)]
    interface = r.node()["interface"]
    assert interface["refused"] == 0 and interface["kernel_dropped"] >= (more - 2) * each
    for t in talkers:
        t.send("send 7FF 0")
    r.run("set", "./talk.sock", "lamp", "listen-only=off")
    got = set()
    while len(got) < count * each + 1 - interface["kernel_dropped"]:
        if (can_id := lamp.receive().can_id) < 0x800:
            got.add(can_id)
    assert 0x7FF in got
    assert r.node()["interface"]["kernel_dropped"] == interface["kernel_dropped"]
    r.stop()


def test_what_a_program_has_sent_before_it_goes_is_sent(rig):
    r = rig(engine=", queue: 4")
    dash = r.talk("dash")
    for _ in range(5):
        t = r.talk()
        t.send(*(f"send {i:X} 8 1 2 3 4 5 6 7 8" for i in range(0x100, 0x180)))
        t.close()
        assert [dash.frame()[0] for _ in range(0x80)] == [f"{i:X}" for i in range(0x100, 0x180)]
    assert r.node()["interface"]["pushed_back"] > 0
    assert r.node()["dropped"] == {} or sum(r.node()["dropped"].values()) == 0
    r.stop()


def test_a_program_is_held_back_soon(rig):
    """The kernel keeps 64 KB of it here, and not the megabytes that it would."""
    r = rig(engine=", queue: 4", dash=", listen-only: on", lamp=", listen-only: on")
    t = r.talk()
    t.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    t.socket.settimeout(1)  # poll: a program that is held back later sends more, and fails
    frame, sent = b"< send 123 8 11 22 33 44 55 66 77 88 >", 0
    with pytest.raises(TimeoutError):
        while sent < 1 << 20:
            sent += t.socket.send(frame[sent % len(frame):])
    assert r.node()["pushing_back"] and sent < 130_000, sent
    assert t.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG) <= 1400
    t.close()
    r.stop()


def test_all_programs_of_a_busy_port_take_turns(rig):
    r = rig(engine=", queue: 2")
    dash, many, one = r.talk("dash"), r.talk(), r.talk()
    many.send(*(["send 100 8 1 2 3 4 5 6 7 8"] * 2000))
    one.send("send 7FF 0")
    got = 0
    while dash.frame()[0] != "7FF":
        got += 1
    assert got < 2000
    assert [dash.frame()[0] for _ in range(2000 - got)] == ["100"] * (2000 - got)
    r.stop()


def test_the_journal(rig):
    r = rig(journal=True)
    t, lamp = r.talk(mode=None), r.lamp()
    t.send("add 0 2000 123 1 1", "send 124 0")
    assert [lamp.receive() for _ in range(20)]
    t.close()
    r.wait(lambda node: node["clients"] == [], "the end of the program")
    r.stop()
    once = canwire("sim", "--journal", "bus.journal", "--events", "-", cwd=r.folder).stdout
    assert once.count('"event":"tx"') >= 20
    assert once == canwire("sim", "--journal", "bus.journal", "--events", "-",
                           cwd=r.folder).stdout


# ---- Addresses, reloads -------------------------------------------------------------------------


def test_a_reload(rig):
    r = rig()
    engine, dash = r.talk(), r.talk("dash")
    r.write(engine=", queue: 8", dash=", restart-ms: 10")
    r.run("reload", "./talk.sock")
    engine.send("send 123 0")  # the ports are the same
    assert dash.frame() == ("123", "")
    r.write(as_="/can0")  # dash has another name here
    r.run("reload", "./talk.sock")
    assert dash.ends()
    can0 = r.talk("can0")
    engine.send("send 124 0")
    assert can0.frame() == ("124", "")
    old, r.port = r.port, free_port()
    r.write()
    r.run("reload", "./talk.sock")
    assert engine.ends() and can0.ends()
    with socket.socket() as s:
        assert s.connect_ex(("127.0.0.1", old)) != 0
    engine, dash = r.talk(), r.talk("dash")
    engine.send("send 125 0")
    assert dash.frame() == ("125", "")
    with socket.socket() as s:  # a bad one changes nothing
        s.bind(("127.0.0.1", 0))
        s.listen()
        port, r.port = r.port, s.getsockname()[1]
        r.write()
        assert canwire("reload", "./talk.sock", status=1, cwd=r.folder)
        r.port = port
    engine.send("send 126 0")
    assert dash.frame() == ("126", "")
    r.stop()


def test_ipv6(rig, tmp_path):
    port = free_port(host="::1")
    r = rig(more=f'  - {{ name: six, port: "tcp:[0::1]:{port}" }}\n')
    six, engine = Talker(port, "six", "rawmode", host="::1"), r.talk()
    six.send("send 123 0")
    assert engine.frame() == ("123", "")
    assert r.node("six")["clients"][0]["name"].startswith("[::1]:")
    r.stop()


def test_an_address_that_is_in_use(tmp_path):
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        s.listen()
        port = s.getsockname()[1]
        (tmp_path / "bus.yaml").write_text(
            f'bus: {{ bitrate: 500000 }}\nnodes: [ {{ name: a, port: "tcp:{port}" }} ]\n')
        result = subprocess.run([CANWIRED, "-c", "bus.yaml"], cwd=tmp_path, text=True,
                                capture_output=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 1
    assert f"port tcp:127.0.0.1:{port}/a: Address already in use" in result.stderr


def test_a_broadcast_address_of_a_network(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        'bus: { bitrate: 500000 }\nnodes: [ { name: a, port: "tcp:127.255.255.254" } ]\n')
    canwire("check", "bus.yaml", cwd=tmp_path)  # on this machine it is an address as any other
    for address, kind in ("224.0.0.251", "multicast"), ("127.255.255.255", "broadcast"):
        (tmp_path / "bus.yaml").write_text(
            f'bus: {{ bitrate: 500000 }}\nnodes: [ {{ name: a, port: "tcp:{address}" }} ]\n')
        result = canwire("check", "bus.yaml", cwd=tmp_path, status=1)
        assert (f"bus.yaml:2:27: port: {address} is a {kind} address; expected that of one machine"
                in result.stderr)


def test_the_buses_of_a_rig_have_one_address(tmp_path):
    port = free_port()
    for bus, rate in ("body", 125000), ("power", 500000):
        (tmp_path / f"{bus}.yaml").write_text(
            f"bus: {{ name: {bus}, bitrate: {rate} }}\ncontrol: {bus}.sock\nnodes:\n"
            f"  - {{ name: {bus}-ecu, port: \"tcp:{port}\" }}\n  - {{ name: gw }}\n")
    (tmp_path / "rig.yaml").write_text(
        "buses: [ body.yaml, power.yaml ]\ngateways:\n"
        '  - { name: gw, between: [ "body:gw", "power:gw" ], rules: [ { id: "020" } ] }\n')
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen([CANWIRED, "-c", "rig.yaml"], cwd=tmp_path, stderr=log)
    try:
        for bus in "body", "power":
            wait_until(lambda bus=bus: listens(tmp_path / f"{bus}.sock"), bus)
        body, power = (Talker(port, f"{bus}-ecu", "rawmode") for bus in ("body", "power"))
        for _ in range(3):
            body.send("send 123 1 7")
            assert power.frame() == ("020", "07")
            power.send("send 124 1 8")
            assert body.frame() == ("020", "08")
    finally:
        kill_all([process])


def test_interfaces_are_not_made_for_it(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        'bus: { bitrate: 500000 }\nnodes: [ { name: a, port: "tcp:" } ]\n')
    canwire("check", "--ports", "bus.yaml", cwd=tmp_path)
    assert canwire("vcan", "up", "bus.yaml", cwd=tmp_path).stdout == ""


logging.getLogger("can").setLevel(logging.ERROR)
