# SPDX-License-Identifier: MIT
"""Filters and buffers of controllers, and controllers before CAN 2.0B, in simulated runs."""

import json

import pytest

from simtool import canwire, sim

JOIN_US, BIT_US = 22, 2


def run(tmp_path, text, *arguments):
    """Returns the events of a bus of 500 kbit/s with these nodes, and the statistics of each."""
    (tmp_path / "bus.yaml").write_text("bus: { name: t, bitrate: 500000 }\nnodes:\n" + text)
    events = sim(tmp_path / "bus.yaml", "--events", "-", *arguments).stdout.splitlines()
    stats = json.loads(sim(tmp_path / "bus.yaml", "--stats", "-", *arguments).stdout)
    return [json.loads(line) for line in events], {n["name"]: n for n in stats["nodes"]}


def of(events, node, kind):
    return [e for e in events if e.get("node") == node and e["event"] == kind]


# ---- Filters and buffers -------------------------------------------------------------------------

FRAMES = "".join(f"{{ send: '{i:03X}#', every: 1ms, offset: {100 * n}us, count: 2 }}, "
                 for n, i in enumerate((0x123, 0x100, 0x1FF, 0x223, 0x7FF)))


@pytest.mark.parametrize("text, passed", [
    ('"123"', [0x123]), ('"100:700"', [0x123, 0x100, 0x1FF]),
    ('"~123"', [0x100, 0x1FF, 0x223, 0x7FF]), ('"100~700"', [0x223, 0x7FF]),
    ('"~100:700"', [0x223, 0x7FF]), ('[ "123", "7FF" ]', [0x123, 0x7FF]),
    ('"123,223"', [0x123, 0x223]), ('"~123,123"', [0x123, 0x100, 0x1FF, 0x223, 0x7FF])])
def test_a_filter_passes_what_candump_would_show(tmp_path, text, passed):
    events, nodes = run(tmp_path, f"  - {{ name: a, traffic: [ {FRAMES} ] }}\n"
                                  f"  - {{ name: b, filter: {text} }}\n")
    assert {int(e["frame"].split("#")[0], 16) for e in of(events, "b", "rx")} == set(passed)
    assert nodes["b"]["filtered"] == 10 - 2 * len(passed)
    assert nodes["b"]["rx_accepted"] == nodes["b"]["rx_frames"] == 2 * len(passed)
    assert len(of(events, "a", "tx")) == 10


@pytest.mark.parametrize("service, lost", [(150, 20), (90, 0)])
def test_a_slow_host_loses_frames_in_slots_of_100_us(tmp_path, service, lost):
    events, nodes = run(
        tmp_path, "  - { name: a, traffic: [ { send: '123#', every: 100us, count: 40 } ] }\n"
                  f"  - {{ name: b, controller: {{ model: basic, service-time: {service}us }} }}\n")
    assert len(of(events, "b", "overrun")) == nodes["b"]["overruns"] == lost
    assert len(of(events, "b", "rx")) == 40 - lost and nodes["b"]["rx_held"] == 0
    assert all(a["t"] <= b["t"] for a, b in zip(events, events[1:]))


@pytest.mark.parametrize("service, frames", [(150, 2), (40, 2), (20, 1), (1, 0)])
def test_a_full_controller_asks_for_time_by_overload_frames(tmp_path, service, frames):
    """Frames follow each other after 3 bits. Each overload frame puts 15 bits in between, 30 us."""
    for step in [], ["--step"]:
        events, nodes = run(
            tmp_path, "  - { name: a, traffic: [ { send: '123#', count: 10, every: 10us } ] }\n"
                      "  - { name: b, controller: { model: basic, overload-when-full: on, "
                      f"service-time: {service}us }} }}\n  - name: c\n", *step)
        assert not of(events, "b", "overrun") and len(of(events, "b", "rx")) == 10
        assert len(of(events, "b", "overload")) == nodes["b"]["overloads"] == 10 * frames
        ends = [round(e["t"] * 1e6) for e in of(events, "a", "tx")]
        assert {later - end for end, later in zip(ends, ends[1:])} == {96 + 30 * frames}
        assert all(n["rec"] == n["tec"] == 0 for n in nodes.values())


def test_a_transmit_buffer_makes_urgent_frames_wait(tmp_path):
    """Inner priority inversion: 700 has lost arbitration and keeps 001 of the same node waiting."""
    order = []
    for model in "queue", "basic":
        events, _ = run(
            tmp_path, f"  - {{ name: a, controller: {{ model: {model} }}, traffic: [\n"
                      "      { send: '700#' }, { send: '001#', offset: 30us } ] }\n"
                      "  - { name: b, traffic: [ { send: '300#' }, { send: '301#' } ] }\n")
        order.append([e["frame"] for e in events if e["event"] == "tx"])
    assert order == [["300#", "001#", "301#", "700#"], ["300#", "301#", "700#", "001#"]]


# ---- Controllers before CAN 2.0B -----------------------------------------------------------------

OLD = ("  - { name: new, traffic: [ { send: '12345678#01' } ] }\n"
       "  - { name: old, kind: 2.0A }\n  - { name: other }\n")


@pytest.mark.parametrize("step", [[], ["--step"]])
def test_a_controller_of_can_2_0a_destroys_extended_frames_until_it_is_passive(tmp_path, step):
    events, nodes = run(tmp_path, OLD, *step)
    errors = of(events, "old", "error")
    assert [(e["field"], e["type"]) for e in errors] == 16 * [("crc-delimiter", "form")]
    assert round(errors[0]["t"] * 1e6) == JOIN_US + (35 + 1) * BIT_US
    assert [e["rec"] for e in errors] == [9 * n + 1 for n in range(15)] + [136]
    assert [e["flag"] for e in errors] == 15 * ["active"] + ["passive"]
    assert [(e["state"], e["rec"]) for e in of(events, "old", "state")] == [
        ("error-warning", 99), ("error-passive", 135)]
    sender = of(events, "new", "error")
    assert [(e["field"], e["index"], e["type"], e["tec"]) for e in sender] == [
        ("dlc", 3, "bit", 8 * n) for n in range(1, 16)]
    assert round(sender[0]["t"] * 1e6) == JOIN_US + (39 + 1) * BIT_US
    assert len(of(events, "new", "tx")) == len(of(events, "other", "rx")) == 1
    assert nodes["new"]["tec"] == 119 and nodes["old"]["rx_frames"] == 0


def test_base_frames_are_as_ever_to_old_controllers(tmp_path):
    events, nodes = run(
        tmp_path, "  - { name: a, traffic: [ { send: '123#01' }, { send: '123#R' } ] }\n"
                  "  - { name: b, kind: 2.0A, traffic: [ { send: '456#02' } ] }\n"
                  "  - { name: c, kind: 2.0B-passive }\n  - { name: d, kind: 2.0B }\n")
    assert not [e for e in events if e["event"] == "error"]
    assert [len(of(events, n, "rx")) for n in "abcd"] == [1, 2, 3, 3]
    assert nodes["c"]["filtered"] == 0


def test_a_passive_controller_acknowledges_extended_frames_and_its_host_gets_none(tmp_path):
    events, nodes = run(tmp_path, "  - { name: a, traffic: [ { send: '12345678#01', every: 1ms, "
                                  "count: 3 } ] }\n  - { name: b, kind: 2.0B-passive }\n")
    assert len(of(events, "a", "tx")) == 3 and not of(events, "b", "rx")
    assert nodes["b"]["filtered"] == 3 and not of(events, "a", "error")


@pytest.mark.parametrize("kind", ["2.0A", "2.0B-passive"])
def test_old_controllers_send_no_extended_frames(tmp_path, kind):
    (tmp_path / "log").write_text("(1.000000) can0 12345678#01\n(1.001000) can0 123#02\n")
    events, nodes = run(
        tmp_path, f"  - {{ name: a, kind: {kind}, traffic: [ {{ replay: log }} ] }}\n"
                  "  - name: b\n")
    assert [(e["frame"], e["why"]) for e in of(events, "a", "drop")] == [
        ("12345678#01", "bad-frame")]
    assert len(of(events, "b", "rx")) == nodes["a"]["tx_frames"] == 1
    (tmp_path / "bad.yaml").write_text(
        "bus: { bitrate: 500000 }\nnodes:\n"
        f"  - {{ name: a, kind: {kind}, traffic: [ {{ send: '12345678#01' }} ] }}\n")
    refused = canwire("check", tmp_path / "bad.yaml", status=1).stderr
    assert "bad.yaml:3:" in refused and "sends base frames only" in refused
