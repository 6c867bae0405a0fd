# SPDX-License-Identifier: MIT
"""Nodes that sleep, in simulated runs: events, statistics, pictures, runs of several ways."""

import json

import pytest

from simtool import canwire, sim

BUS = """
bus: {{ name: t, bitrate: {rate} }}
nodes:
  - {{ name: a, traffic: [ {{ send: '{frame}', every: 1ms, offset: 1ms, count: 5 }} ] }}
  - {{ name: b, {b} }}
  - {{ name: c }}
"""


def run(tmp_path, *arguments, rate=500000, frame="123#0102", b="sleep: on", more=""):
    path = tmp_path / "bus.yaml"
    path.write_text(BUS.format(rate=rate, frame=frame, b=b) + more)
    lines = sim(path, "--events", "-", *arguments).stdout.splitlines()
    stats = json.loads(sim(path, "--stats", "-", *arguments).stdout)
    return [json.loads(line) for line in lines], {n["name"]: n for n in stats["nodes"]}


def of(events, node, kind):
    return [e for e in events if e.get("node") == node and e["event"] == kind]


def us(event):
    return round(event["t"] * 1e6, 3)


def test_a_frame_wakes_a_node_that_gets_the_next_one(tmp_path):
    for step in [], ["--step"]:
        events, nodes = run(tmp_path, *step, b="sleep: on, wake-time: 200us")
        assert [e["state"] for e in of(events, "b", "state")] == ["sleeping", "error-active"]
        (wake,) = of(events, "b", "wake")
        assert wake["by"] == "pattern" and us(wake) == 1006  # the third dominant bit
        assert us(of(events, "b", "state")[1]) == 1206
        assert len(of(events, "b", "rx")) == 4 and len(of(events, "c", "rx")) == 5
        assert nodes["b"]["wake_ups"] == 1 and nodes["b"]["asleep_ns"] == 1206000
        assert "wake_ups" not in nodes["c"]


@pytest.mark.parametrize("rate, frame, bits", [
    (1000000, "000#", 5),   # five bits are 5 us
    (1000000, "7FF#FFFFFFFFFFFFFFFF", None),
    (800000, "000#", 4),
    (500000, "000#", 3),
    (250000, "000#", 2),
    (125000, "7FF#FFFF", 1)])  # SOF alone, 8 us
def test_the_default_filter_is_5_us(tmp_path, rate, frame, bits):
    events, _ = run(tmp_path, "--until", "1900us", rate=rate, frame=frame)
    wakes = of(events, "b", "wake")
    assert len(wakes) == (bits is not None)
    if bits:
        assert us(wakes[0]) == 1000 + bits * 1e6 / rate


@pytest.mark.parametrize("text, received", [
    ('"124"', 0), ('"123"', 4), ('"100:700"', 4), ('[ 124, "~124" ]', 4), ('"~100:700"', 0)])
def test_frames_wake_a_node(tmp_path, text, received):
    events, nodes = run(tmp_path, b=f"sleep: on, wake-on: {text}")
    assert len(of(events, "b", "rx")) == received
    assert [e["by"] for e in of(events, "b", "wake")] == ["frame"] * (received > 0)
    assert (nodes["b"]["state"] == "sleeping") == (received == 0)
    assert nodes["b"]["wake_ups"] == (received > 0)


def test_a_run_ends_when_all_sleep(tmp_path):
    """A frame that waits at a node that sleeps is left there."""
    rules = "faults:\n  - { name: x, when: { time: 7ms }, do: { set: [ a, b, c ], sleep: on } }\n"
    events, nodes = run(tmp_path, more=rules, b="traffic: [ { send: 100#, offset: 8ms } ]")
    assert {n["state"] for n in nodes.values()} == {"sleeping"}
    assert nodes["b"]["queue"] == 1 and nodes["b"]["handed_in"] == 1
    assert events[-1]["t"] == 0.007


def test_bits_of_a_node_that_sleeps(tmp_path):
    run(tmp_path, b="sleep: on, wake-on: 123")
    vcd = sim(tmp_path / "bus.yaml", "--vcd", "-").stdout
    assert "sasleep" in vcd and "ssleeping" in vcd
    svg = sim(tmp_path / "bus.yaml", "--svg", "-", "--to", "1300us").stdout
    assert "asleep" in svg and "woken by a frame" in svg


def test_until_it_sleeps_or_wakes(tmp_path):
    run(tmp_path)
    for event, end in ("b:sleeping", 0), ("b:wake", 1006000), ("wake", 1006000):
        result = sim(tmp_path / "bus.yaml", "--until-event", event, "--stats", "-")
        assert abs(json.loads(result.stdout)["bus"]["time_ns"] - end) <= 2000


def test_nodes_with_clocks_of_their_own_sleep(tmp_path):
    """Its clock is slow by 1 %, and it looks at the end of each quantum, 1/16 of a bit."""
    events, _ = run(tmp_path, b="sleep: on, wake-filter: 5900ns, ppm: -5000, sample-point: 87.5%")
    (wake,) = of(events, "b", "wake")
    assert us(wake) == 1006 and len(of(events, "b", "rx")) == 4


def test_messages(tmp_path):
    run(tmp_path)
    for key in "wake-filter: 3bit", "wake-time: 2s":
        (tmp_path / "bad.yaml").write_text(
            BUS.format(rate=500000, frame="123#", b=key))
        result = canwire("check", tmp_path / "bad.yaml", status=1)
        assert "expected a time from 0 to 1s" in result.stderr
