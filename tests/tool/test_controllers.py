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


# ---- Mailboxes -----------------------------------------------------------------------------------

def test_the_newest_frame_overwrites_a_mailbox_and_the_older_one_is_counted(tmp_path):
    """Slots of 100 us, a host that needs 150 us: it gets each second frame, the newer, whole."""
    events, nodes = run(
        tmp_path, "  - { name: a, traffic: [ { send: '123#00', every: 200us, count: 10 }, "
                  "{ send: '123#0101', every: 200us, offset: 120us, count: 10 }, "
                  "{ send: '7FF#', every: 5ms, count: 1 } ] }\n"
                  "  - { name: b, controller: { model: full, service-time: 150us, mailboxes: [\n"
                  "      { direction: rx, id: 124 }, { direction: rx, id: 123 } ] } }\n")
    assert {e["frame"] for e in of(events, "b", "rx")} == {"123#0101"}
    assert {e["frame"] for e in of(events, "b", "overrun")} == {"123#00"}
    b = nodes["b"]
    assert b["overwritten"] == b["rx_dropped"]["queue-full"] == 10
    assert len(of(events, "b", "overrun")) == 10
    assert b["overruns"] == b["rx_held"] == 0 and b["filtered"] == 1
    assert b["rx_frames"] == 10 and b["rx_accepted"] == 20


@pytest.mark.parametrize("transmit, order", [
    ("priority", ["001#", "100#", "300#", "500#"]), ("number", ["500#", "300#", "100#", "001#"]),
    ("request", ["500#", "300#", "100#", "001#"])])
def test_mailboxes_go_by_priority_or_by_number(tmp_path, transmit, order):
    """Four frames come while another node sends."""
    events, _ = run(
        tmp_path, f"  - {{ name: a, controller: {{ model: full, transmit: {transmit} }}, "
                  "traffic: [\n"
                  "      { send: '500#', offset: 50us, count: 1 },\n"
                  "      { send: '300#', offset: 52us, count: 1 },\n"
                  "      { send: '100#', offset: 54us, count: 1 },\n"
                  "      { send: '001#', offset: 56us, count: 1 } ] }\n"
                  "  - { name: b, traffic: [ { send: '000#1122334455667788' } ] }\n")
    assert [e["frame"] for e in of(events, "a", "tx")] == order


def test_frames_wait_behind_mailboxes_in_the_order_of_the_host(tmp_path):
    """Of one mailbox for each sort of frames, those for 5xx do not keep 100 waiting."""
    text = ("  - { name: a, %s, traffic: [\n"
            "      { send: '500#', offset: 50us }, { send: '501#', offset: 52us },\n"
            "      { send: '502#', offset: 54us }, { send: '400#', offset: 56us } ] }\n"
            "  - { name: b, traffic: [ { send: '000#1122334455667788' } ] }\n")
    one = "controller: { model: full, mailboxes: [ { direction: tx } ] }"
    own = ("controller: { model: full, mailboxes: [ { direction: tx, id: '500:7F0' }, "
           "{ direction: tx, id: '400:7F0' } ] }")
    for keys, order in ((one, ["500#", "501#", "502#", "400#"]),
                        (one + ", order: priority", ["500#", "400#", "501#", "502#"]),
                        (own, ["400#", "500#", "501#", "502#"])):
        events, _ = run(tmp_path, text % keys)
        assert [e["frame"] for e in of(events, "a", "tx")] == order


@pytest.mark.parametrize("step", [[], ["--step"]])
def test_a_mailbox_answers_remote_frames_without_its_host(tmp_path, step):
    """Two requests, two replies; what the host writes in between is sent whole."""
    events, nodes = run(
        tmp_path, "  - { name: a, controller: { model: full, mailboxes: [\n"
                  "      { direction: tx, id: 123, reply: auto, data: 01 }, { direction: tx }, "
                  "{ direction: rx } ] },\n"
                  "      traffic: [ { send: '123#0203040506070809', offset: 5ms, count: 1 },\n"
                  "                 { send: '124#', offset: 5ms, count: 1 } ] }\n"
                  "  - { name: b, traffic: [ { send: '123#R', every: 10ms, count: 2 } ] }\n", *step)
    assert [e["frame"] for e in of(events, "a", "tx")] == ["123#01", "124#", "123#0203040506070809"]
    assert not of(events, "a", "rx") and len(of(events, "b", "rx")) == 3
    requests = [round(e["t"] * 1e6) for e in of(events, "b", "tx")]
    replies = [round(e["t"] * 1e6) for e in of(events, "a", "tx") if e["frame"] != "124#"]
    bits = [len(canwire("bits", "--raw", frame).stdout.strip())
            for frame in ("123#01", "123#0203040506070809")]
    assert replies == [end + (3 + n) * BIT_US for end, n in zip(requests, bits)]
    a = nodes["a"]
    assert a["replies"] == 2 and a["stored"] == 1 and a["filtered"] == a["rx_frames"] == 0
    assert a["handed_in"] + a["made_by_rules"] == 4 == a["tx_frames"] + a["stored"]


def test_a_number_of_mailboxes_is_half_for_reception_half_for_sending(tmp_path):
    """Of 9, 5 receive, 4 send: the 6th frame overwrites, the 5th of the host waits."""
    events, nodes = run(
        tmp_path, "  - { name: a, controller: { model: full, mailboxes: 9 }, traffic: [ "
                  + ", ".join(f"{{ send: '{0x500 - n:03X}#', offset: {50 + n}us, count: 1 }}"
                              for n in range(6)) + " ] }\n"
                  "  - { name: b, controller: { model: full, mailboxes: 9, service-time: 1s }, "
                  "traffic: [ { send: '000#1122334455667788' } ] }\n")
    assert [e["frame"] for e in of(events, "a", "tx")] == [
        f"{i:03X}#" for i in (0x4FD, 0x4FC, 0x4FB, 0x4FE, 0x4FF, 0x500)]
    assert nodes["b"]["overwritten"] == 1 and [e["frame"] for e in of(events, "b", "rx")] == [
        f"{i:03X}#" for i in (0x4FD, 0x4FC, 0x4FB, 0x4FE, 0x500)]


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
