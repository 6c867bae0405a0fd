# SPDX-License-Identifier: MIT
"""Nodes of real ECUs that sleep: `canwire set BUS NODE sleep=on` puts them to sleep, and a frame of
another ECU wakes them."""

import json
import os
import socket
import subprocess
import time
from pathlib import Path

import pytest

from canbits import Frame
from conftest import ROOT, ask_status, wait_until

CANWIRE = os.environ.get("CANWIRE") or ROOT / "build/release/canwire"
BUS = """
bus: {{ name: body, bitrate: 125000 }}
nodes:
  - {{ name: door, port: vcan0 }}
  - {{ name: seat, port: vcan1, wake-time: 20ms }}
  - {{ name: roof, port: vcan2 }}
lcm: {{ period: 100ms, events: [ wake, state ] }}
control: {path}
"""
FRAME = Frame.parse("123#DEADBEEF")
CAN_RAW_ERR_FILTER = 2  # a name that Python lacks


class Body:
    def __init__(self, folder, canwired):
        self.environment = dict(os.environ, CANWIRE_RUN=str(folder))
        self.path = folder / "body.sock"
        self.text = BUS.format(path=self.path)
        self.daemon = canwired(self.text)

    def tool(self, *words):
        done = subprocess.run([CANWIRE, *words], env=self.environment, text=True,
                              capture_output=True, check=True)
        return done.stdout

    def node(self, name):
        nodes = ask_status(self.path)["nodes"]
        return next(n for n in nodes if n["name"] == name)

    def state(self, name):
        return self.node(name)["state"]


@pytest.fixture
def body(tmp_path, vcan, canwired):
    vcan(3)
    return Body(tmp_path, canwired)


def test_a_frame_of_another_ecu_wakes_a_node(body, can_socket, listen):
    door, seat, roof = (can_socket(f"vcan{i}") for i in range(3))
    errors = can_socket("vcan1")
    errors.socket.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x1FFFFFFF)
    messages = listen("body")
    body.tool("set", "body", "seat", "sleep=on")
    wait_until(lambda: body.state("seat") == "sleeping", "the sleep")
    assert "state SLEEPING (berr-counter tx 0 rx 0)" in body.tool("status", "body")
    messages.wait_node("seat", lambda m: m.state == "sleeping", "its state by LCM")
    door.send(FRAME)
    assert roof.receive(1) == [FRAME]
    wait_until(lambda: body.state("seat") == "error-active", "the wake-up")
    assert seat.drain() == [] and errors.drain() == []
    door.send(FRAME)
    assert seat.receive(1) == [FRAME] == roof.receive(1)
    node = body.node("seat")
    assert node["wake_ups"] == 1 and node["asleep_ns"] >= 20_000_000
    wait_until(lambda: len(messages.events) == 3, "its events by LCM")
    sleep, wake, awake = (json.loads(e.json) for e in messages.events)
    assert (sleep["state"], wake["by"], awake["state"]) == ("sleeping", "pattern", "error-active")
    assert 0.020 <= round(awake["t"] - wake["t"], 9) < 0.0201
    assert errors.drain() == [FRAME]  # no error frames


def test_frames_of_an_ecu_wait_while_its_node_sleeps(body, can_socket):
    door, seat, roof = (can_socket(f"vcan{i}") for i in range(3))
    body.tool("set", "body", "seat", "sleep=on", "wake-on=7FF")
    seat.send(FRAME, FRAME)
    door.send(Frame.parse("7FE#"))
    assert roof.receive(1) == [Frame.parse("7FE#")]
    wait_until(lambda: body.node("seat")["queue"] == 2, "the frames")
    assert body.state("seat") == "sleeping"
    settings = body.node("seat")["settings"]
    assert settings["sleep"] is True and settings["wake-on"] == "7FF"
    body.tool("set", "body", "seat", "sleep=off")
    assert roof.receive(2) == [FRAME, FRAME] == door.receive(2)
    assert body.node("seat")["conserved"]


def test_the_last_one_awake_is_acknowledged_when_it_has_woken_the_others(body, can_socket):
    door, seat = can_socket("vcan0"), can_socket("vcan1")
    for node in "seat", "roof":
        body.tool("set", "body", node, "sleep=on")
    wait_until(lambda: body.state("roof") == body.state("seat") == "sleeping", "the sleep")
    door.send(FRAME)
    wait_until(lambda: body.node("door")["tx_frames"] == 1, "an acknowledgement")
    assert body.node("door")["errors"]["ack"] > 0
    wait_until(lambda: body.state("seat") != "sleeping", "the other one")
    door.send(FRAME)
    assert FRAME in seat.receive(1)


def test_a_bus_that_sleeps_has_no_wake_ups_and_a_reload_keeps_it(body, tmp_path):
    for node in "door", "seat", "roof":
        body.tool("set", "body", node, "sleep=on")
    wait_until(lambda: body.state("roof") == "sleeping", "the sleep")
    (tmp_path / "other.yaml").write_text(body.text)
    body.tool("reload", "body")
    assert [body.state(n) for n in ("door", "seat", "roof")] == ["sleeping"] * 3
    switches = Path(f"/proc/{body.daemon.process.pid}/status")

    def woken():
        lines = switches.read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("voluntary"))

    before, began = woken(), time.monotonic()
    time.sleep(2)  # no wait: this time is measured
    assert woken() - before < (time.monotonic() - began) * 10 * 3  # LCM has a period of 100 ms
