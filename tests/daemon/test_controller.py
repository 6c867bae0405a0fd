# SPDX-License-Identifier: MIT
"""A node whose controller is a program: the protocol of canwire-usb(8), with canwired alone.

This needs no CAN in the kernel, and no root. tests/kernel/test_usb.py has the kernel's driver.
"""

import errno
import json
import struct
import subprocess

import pytest

from busclient import (DROPPED, ERROR, FRAME, HELLO, LOOPBACK, OWN, RECV_OWN, TELL_DROPPED, Client)
from simtool import CANWIRED, canwire, kill_all, listens, stop_canwired
from test_record import wait_until

BUS = """bus: { name: usb, bitrate: 500000 }
control: usb.sock
nodes:
  - { name: engine, port: { usb: can0, socket: engine.usb } }
  - { name: dash, port: "unix:dash.sock" }
"""
CONTROL, STATE = 8, 9
CONTROLLER = 64
PLACES = 63  # for clients of a port
SET, OFF, ON, RESTART = range(4)
ACTIVE, WARNING, PASSIVE, BUS_OFF = range(4)
MINE = LOOPBACK | RECV_OWN | TELL_DROPPED | CONTROLLER


class Rig:
    def __init__(self, folder, text=BUS):
        self.folder, self.log = folder, folder / "stderr"
        (folder / "bus.yaml").write_text(text)
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [CANWIRED, "-c", "bus.yaml", "--journal", "bus.journal"], cwd=folder, stderr=log)
        wait_until(lambda: listens(folder / "usb.sock") or self.process.poll() is not None, "a bus")

    def controller(self, options=MINE):
        return Client(self.folder / "engine.usb", "can0", options)

    def dash(self):
        return Client(self.folder / "dash.sock", "dash")

    def run(self, *words):
        return canwire(*words, cwd=self.folder).stdout

    def node(self, name="engine"):
        status = json.loads(self.run("status", "./usb.sock", "--json"))
        return next(node for node in status["nodes"] if node["name"] == name)

    def wait_link(self, link):
        wait_until(lambda: self.node()["link"] == link, f"link {link}")

    def stop(self):
        assert self.node()["conserved"] is True
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="rig")
def fixture_rig(tmp_path):
    rig = Rig(tmp_path)
    yield rig
    kill_all([rig.process])


def order(client, what, settings=None):
    text = json.dumps(settings).encode() if settings is not None else b""
    client.write(CONTROL, struct.pack("=I", what) + text)


def until(client, kind):
    """Returns the first message of a type, and the states before it."""
    states = []
    while True:
        message = client.receive()
        if message.type == kind:
            return message, states
        assert message.type == STATE, message
        states.append(struct.unpack("=III", message.body))


def test_a_node_is_on_the_bus_while_its_controller_says_so(rig):
    assert rig.node()["link"] == "down"
    c = rig.controller()
    assert c.welcome.type == HELLO and rig.node()["link"] == "down"
    dash = rig.dash()
    c.send(0x100, b"\1", number=1)  # off: dropped
    message, _ = until(c, DROPPED)
    assert (message.number, message.text) == (1, "link-down")
    order(c, ON)
    c.send(0x101, b"\2", number=2)
    message, _ = until(c, FRAME)
    assert (message.number, message.flags & OWN, message.can_id) == (2, OWN, 0x101)
    assert dash.receive().can_id == 0x101
    dash.send(0x200)
    assert until(c, FRAME)[0].can_id == 0x200
    order(c, OFF)
    rig.wait_link("down")
    order(c, ON)
    rig.wait_link("up")
    c.close()
    rig.wait_link("down")
    rig.stop()
    rig.run("sim", "--journal", "bus.journal", "--events", "again")
    events = [json.loads(line) for line in (rig.folder / "again").read_text().splitlines()]
    links = [e["state"] for e in events if e["event"] == "link" and e["node"] == "engine"]
    assert links == ["up", "down", "up", "down"]


def test_settings_are_those_of_canwire_set(rig):
    c = rig.controller()
    order(c, ON, {"brp": 10, "prop-seg": 6, "phase-seg1": 7, "phase-seg2": 2, "listen-only": True})
    rig.wait_link("up")
    assert rig.node()["settings"]["listen-only"] is True
    for settings, why in [
        ({"brp": 0}, "brp: expected"),
        ({"nonsense": 1}, "there is no setting 'nonsense'"),
        ([1], "the settings are no JSON object"),
    ]:
        order(c, SET, settings)
        message, _ = until(c, ERROR)
        assert (message.number, message.code) == (CONTROL, errno.EINVAL) and why in message.text
    rig.wait_link("up")
    order(c, ON, {"brp": 0})  # wrong settings do not come onto the bus
    rig.wait_link("down")
    assert "node engine: its controller asks for" in rig.log.read_text()
    rig.stop()


def test_a_reload_keeps_the_settings(rig):
    c = rig.controller()
    order(c, ON, {"listen-only": True})
    rig.wait_link("up")
    rig.run("reload", "./usb.sock")
    assert rig.node()["settings"]["listen-only"] is True and rig.node()["link"] == "up"
    rig.stop()


def test_states_and_counters_are_told_at_every_change(rig):
    """Nobody acknowledges: TEC 8, 16 ... 128 by attempts of the bus; then 32 bit errors."""
    c = rig.controller()
    rig.run("set", "./usb.sock", "dash", "listen-only=on")
    order(c, ON, {"restart-ms": 0})
    c.send(0x100, number=1)
    seen = []
    while not seen or seen[-1][0] != PASSIVE:
        seen.append(struct.unpack("=III", c.receive().body))
    steps = [s for s in seen if s[1] > 0]
    assert [s[1] for s in steps] == sorted(s[1] for s in steps)
    assert (WARNING, 96, 0) in steps and steps[-1] == (PASSIVE, 128, 0)
    rig.run("inject", "./usb.sock",
            "{ name: stuck, when: { time: 0s }, do: { stuck: recessive, on: engine.tx } }")
    while seen[-1][0] != BUS_OFF:
        seen.append(struct.unpack("=III", c.receive().body))
    assert seen[-1] == (BUS_OFF, 256, 0)
    rig.run("clear", "./usb.sock", "stuck")
    rig.run("set", "./usb.sock", "dash", "listen-only=off")
    order(c, RESTART)
    message, states = until(c, DROPPED)
    assert (message.number, message.text, states) == (1, "bus-off", [])
    wait_until(lambda: rig.node()["state"] == "error-active", "128 times 11 bits")
    c.send(0x101, number=2)
    message, states = until(c, FRAME)
    assert message.number == 2 and states[-1] == (ACTIVE, 0, 0)
    rig.stop()


def test_a_frame_that_a_rule_changes_comes_to_its_end(rig):
    rig.run("inject", "./usb.sock",
            "{ name: scale, when: { frame: '123' }, do: { change: { set: 'FF' } } }")
    c = rig.controller()
    dash = rig.dash()
    order(c, ON)
    c.send(0x123, b"\1\2", number=5)
    assert until(c, FRAME)[0].number == 5
    assert dash.receive().data == b"\xff\2"
    rig.stop()


def test_wrong_clients(rig):
    assert Client(rig.folder / "dash.sock", "x", MINE).welcome.code == errno.EOPNOTSUPP
    first = rig.controller()
    assert rig.controller().welcome.code == errno.EBUSY
    guest = rig.controller(LOOPBACK)  # a client beside it may read and write, but give no orders
    assert guest.welcome.type == HELLO
    order(guest, ON)
    assert guest.receive().code == errno.EPERM
    first.write(CONTROL, struct.pack("=I", 4))
    assert until(first, ERROR)[0].code == errno.EINVAL
    first.set_options(LOOPBACK)
    assert until(first, ERROR)[0].text == "the hello says who is the controller"
    assert rig.node()["interface"]["malformed"] == 3
    rig.stop()


def test_a_full_port_is_another_answer_than_another_controller(tmp_path):
    rig = Rig(tmp_path, f"defaults: {{ clients: {PLACES} }}\n" + BUS)
    try:
        guests = [rig.controller(LOOPBACK) for _ in range(PLACES)]
        assert [guest.welcome.type for guest in guests] == [HELLO] * PLACES
        refusal = rig.controller().welcome
        assert (refusal.type, refusal.code) == (ERROR, errno.EUSERS)
        assert "as many clients as it takes" in refusal.text
        guests.pop().close()
        wait_until(lambda: len(rig.node()["clients"]) == PLACES - 1, "its going")
        assert rig.controller().welcome.type == HELLO
        rig.stop()
    finally:
        kill_all([rig.process])


def test_a_bus_of_a_rig(tmp_path):
    """The order comes through the buses that go in step."""
    (tmp_path / "one.yaml").write_text(BUS + "  - { name: gateway }\n")
    (tmp_path / "two.yaml").write_text(
        "bus: { name: two, bitrate: 125000 }\ncontrol: two.sock\n"
        'nodes: [ { name: body, port: "unix:body.sock" }, { name: gateway } ]\n')
    (tmp_path / "rig.yaml").write_text(
        'buses: [ one.yaml, two.yaml ]\ngateways: [ { name: g, between: [ "usb:gateway", '
        '"two:gateway" ], rules: [ { direction: both } ] } ]\n')
    with subprocess.Popen([CANWIRED, "-c", "rig.yaml"], cwd=tmp_path) as process:
        wait_until(lambda: listens(tmp_path / "two.sock"), "the rig")
        c = Client(tmp_path / "engine.usb", "can0", MINE)
        body = Client(tmp_path / "body.sock", "body")
        order(c, ON)
        c.send(0x123, b"\1", number=1)
        assert until(c, FRAME)[0].flags & OWN
        assert body.receive().can_id == 0x123
        process.terminate()
        assert process.wait(60) == 0
