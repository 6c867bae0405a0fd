# SPDX-License-Identifier: MIT
"""Filters and buffers of controllers, and controllers before CAN 2.0B, in simulated runs."""

import json
import random

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


@pytest.mark.parametrize("model, data, before", [("basic", "", 0), ("mcp2515", "", 1),
                                                 ("sja1000", "", 20),
                                                 ("sja1000", "1122334455667788", 4)])
def test_buffers_that_stay_full_ask_for_time_after_each_frame(tmp_path, model, data, before):
    """A host that never fetches: behind the frames that leave room, each one is followed by two
    overload frames, also when it is lost. The FIFO of an sja1000 is full when its bytes are."""
    count = before + 4
    for step in [], ["--step"]:
        events, nodes = run(
            tmp_path, f"  - {{ name: a, traffic: [ {{ send: '123#{data}', count: {count}, "
                      "every: 300us } ] }\n"
                      f"  - {{ name: b, controller: {{ model: {model}, overload-when-full: on, "
                      "service-time: 1s } }\n", "--until", "20ms", *step)
        asked = [e["event"] for e in events
                 if e["event"] == "tx" or (e["event"], e["node"]) == ("overload", "b")]
        assert asked == before * ["tx"] + 4 * ["tx", "overload", "overload"]
        assert nodes["b"]["overruns"] == len(of(events, "b", "overrun")) == 3


@pytest.mark.parametrize("mode", ["listen-only", "restricted"])
def test_a_controller_that_may_not_ask_for_time_misses_nothing_by_it(tmp_path, mode):
    """Its own flags would be all that it sees of the next frame."""
    events, nodes = run(
        tmp_path, "  - { name: a, traffic: [ { send: '123#', count: 6, every: 10us } ] }\n"
                  f"  - {{ name: b, {mode}: on, controller: {{ model: basic, "
                  "overload-when-full: on, service-time: 90us } }\n  - name: c\n")
    assert not [e for e in events if e["event"] in ("overload", "error")]
    assert len(of(events, "b", "rx")) == 6 and nodes["b"]["overruns"] == 0


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


# ---- Presets -------------------------------------------------------------------------------------

def frames(n, data):
    return "".join(f"{{ send: '300#{data}', offset: {300 * i}us, count: 1 }}, " for i in range(n))


@pytest.mark.parametrize("model, data, kept, counter", [
    ("sja1000", "", 21, "overruns"), ("sja1000", "1122334455667788", 5, "overruns"),
    ("mcp2515", "", 2, "overruns"), ("m_can", "", 64, "overruns"), ("flexcan", "", 6, "overruns"),
    ("bxcan", "", 3, "overwritten")])
def test_a_preset_has_the_receive_buffers_of_its_chip(tmp_path, model, data, kept, counter):
    """Of 70 frames a host that is too slow gets those that the buffers hold."""
    _, nodes = run(
        tmp_path, f"  - {{ name: a, traffic: [ {frames(70, data)} ] }}\n  - {{ name: b, "
                  f"controller: {{ model: {model}, service-time: 10s }} }}\n", "--until", "1s")
    assert (nodes["b"]["rx_held"], nodes["b"][counter]) == (kept, 70 - kept)
    assert nodes["b"]["rx_dropped"]["queue-full"] == 70 - kept


def test_the_fifo_of_bxcan_keeps_the_newest_frame_and_that_of_others_the_oldest(tmp_path):
    got = {}
    for model in "bxcan", "mcp2515":
        events, _ = run(
            tmp_path, "  - { name: a, traffic: [ " +
                      "".join(f"{{ send: '30{i}#', offset: {300 * i}us, count: 1 }}, "
                              for i in range(6)) +
                      f"] }}\n  - {{ name: b, controller: {{ model: {model}, service-time: 10ms "
                      "} }\n")
        got[model] = [e["frame"] for e in of(events, "b", "rx")]
    assert got == {"bxcan": ["300#", "301#", "305#"], "mcp2515": ["300#", "301#"]}


@pytest.mark.parametrize("model", ["sja1000", "mcp2515", "m_can", "flexcan", "bxcan"])
def test_frames_of_a_preset_go_in_the_order_in_which_they_were_written(tmp_path, model):
    """So do all these drivers; m_can and bxcan have several mailboxes, in the order of requests."""
    text = ("  - { name: a, controller: { model: %s }, traffic: [\n"
            "      { send: '500#', offset: 50us, count: 1 }, "
            "{ send: '300#', offset: 52us, count: 1 },\n"
            "      { send: '100#', offset: 54us, count: 1 }, "
            "{ send: '001#', offset: 56us, count: 1 } ]%s }\n"
            "  - { name: b, traffic: [ { send: '000#1122334455667788' } ] }\n")
    written = ["500#", "300#", "100#", "001#"]
    order = [e["frame"] for e in of(run(tmp_path, text % (model, ""))[0], "a", "tx")]
    assert order == written
    # keys beside the preset: mailboxes go by priority, and behind one by the order of the queue
    order = [e["frame"] for e in of(run(tmp_path, text % (
        f"{model}, mailboxes: 8, transmit: priority", ""))[0], "a", "tx")]
    assert order == written[::-1]
    order = [e["frame"] for e in of(run(tmp_path, text % (model, ", order: priority"))[0],
                                    "a", "tx")]
    waiting = {"m_can": written, "bxcan": written}
    assert order == waiting.get(model, ["500#", "001#", "100#", "300#"])


def test_a_preset_has_the_limits_of_its_bit_timing(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        "bus: { bitrate: 500000 }\nnodes:\n"
        "  - { name: a, clock: 8MHz, controller: { model: mcp2515 }, brp: 1, prop-seg: 1, "
        "phase-seg1: 1, phase-seg2: 13 }\n")
    refused = canwire("check", tmp_path / "bus.yaml", status=1).stderr
    assert "prop-seg + phase-seg1 would be 2, mcp2515 has 3 to 16" in refused


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


# ---- Variants ------------------------------------------------------------------------------------


@pytest.mark.parametrize("flags", [[], ["--step"]])
def test_a_controller_that_forbids_a_dlc_destroys_its_frame(tmp_path, flags):
    """c finds a form error in dlc[3] = bit 18; there is no stuff bit before it. Its flag takes the
    next six bits, data[0.0] on. The sender has its first recessive bit in data[0.3]. b finds the
    sixth dominant bit behind data[0.4], and its flag goes on for six bits behind that of c. So c
    adds 1 + 8 an attempt. After 15 of them it is passive and says no more."""
    events, nodes = run(
        tmp_path, "  - { name: a, traffic: [ { send: '123#1122334455667788_F' } ] }\n  - name: b\n"
                  "  - { name: c, controller: { dlc-over-8: off } }\n", *flags)
    found = [e for e in of(events, "c", "error") if e["field"] == "dlc"]
    assert [(e["type"], e["index"], e["flag"]) for e in found] == \
        15 * [("form", 3, "active")] + [("form", 3, "passive")]
    assert [e["rec"] for e in found][:15] == [9 * n + 1 for n in range(15)]
    sent = of(events, "a", "error")
    assert [(e["type"], e["field"], e["index"], e["tec"]) for e in sent] == \
        [("bit", "data", 3, 8 * n) for n in range(1, 16)]
    assert [(e["type"], e["field"], e["index"], e.get("stuff")) for e in of(events, "b", "error")] \
        == 15 * [("stuff", "data", 4, True)]
    passive = [e for e in of(events, "c", "state") if e["state"] == "error-passive"]
    assert [e["rec"] for e in passive] == [135]
    assert [e["frame"] for e in of(events, "a", "tx")] == ["123#1122334455667788_F"]
    assert len(of(events, "b", "rx")) == 1 and not of(events, "c", "rx")
    assert nodes["a"]["tec"] == 119 and nodes["b"]["rec"] == 14


def test_a_dlc_of_8_and_a_base_identifier_below_2032_are_nothing_special(tmp_path):
    events, nodes = run(
        tmp_path, "  - { name: a, controller: { dlc-over-8: off, high-identifiers: off },\n"
                  "      traffic: [ { send: '7EF#1122334455667788' }, { send: 1FBFFFFF# } ] }\n"
                  "  - { name: b, controller: { dlc-over-8: off } }\n")
    assert len(of(events, "a", "tx")) == len(of(events, "b", "rx")) == 2
    assert not of(events, "b", "error")


REPLAYED = [("7EF#", False), ("7F0#", True), ("7FF#11", True), ("7F0#R", True),
            ("1FBFFFFF#", False), ("1FC00000#", True), ("1FFFFFFF#", True),
            ("123#1122334455667788_9", False)]


def test_high_identifiers_are_refused_and_received(tmp_path):
    log = "".join(f"({n / 1000:.6f}) can0 {frame}\n" for n, (frame, _) in enumerate(REPLAYED))
    (tmp_path / "drive.log").write_text(log)
    replay = "traffic: [ { replay: drive.log } ]"
    events, nodes = run(
        tmp_path, f"  - {{ name: a, controller: {{ high-identifiers: off }}, {replay} }}\n"
                  f"  - {{ name: b, {replay} }}\n  - name: c\n")
    refused = [frame for frame, high in REPLAYED if high]
    drops = of(events, "a", "drop")
    assert [(e["frame"], e["why"]) for e in drops] == [(f, "bad-frame") for f in refused]
    assert nodes["a"]["dropped"]["bad-frame"] == len(refused)
    assert len(of(events, "b", "tx")) == len(of(events, "c", "rx")) == len(REPLAYED)
    assert [e["frame"] for e in of(events, "a", "rx")] == refused


def test_a_long_dlc_is_refused(tmp_path):
    frames = ["123#1122334455667788_9", "123#1122334455667788", "123#R8_9", "123#R8"]
    (tmp_path / "drive.log").write_text(
        "".join(f"({n / 1000:.6f}) can0 {frame}\n" for n, frame in enumerate(frames)))
    events, nodes = run(tmp_path, "  - { name: a, controller: { dlc-over-8: off }, "
                                  "traffic: [ { replay: drive.log } ] }\n  - name: b\n")
    assert [e["frame"] for e in of(events, "a", "drop")] == [frames[0], frames[2]]
    assert len(of(events, "b", "rx")) == 2


PASSIVE = """bus: { name: t, bitrate: 500000 }
nodes: [ { name: a }, { name: b, controller: { VARIANT } } ]
faults:
  - { name: near, when: { time: 100us }, do: { counters: b, rec: 127 } }
  - { name: over, when: { time: 200us }, do: { error-flag: b } }
  - { name: more, when: { time: 300us }, do: { error-flag: b } }
  - { name: good, when: { time: 400us }, do: { send: 123#, as: a } }
  - { name: end, when: { time: 1ms }, do: { error-flag: b } }
"""


@pytest.mark.parametrize("variant, most", [("model: queue", [136, 137]),
                                           ("rec-when-passive: off", [128, 128])])
def test_a_receive_error_counter_holds_when_passive(tmp_path, variant, most):
    """127 + 1, then + 8 by R2, since a answers; the passive flag of the second error adds 1. A good
    frame sets either to 120, and the next error adds 1 + 8."""
    (tmp_path / "t.yaml").write_text(PASSIVE.replace("VARIANT", variant))
    rec = []
    for until in "290us", "390us", "990us", "1100us":
        report = json.loads(sim(tmp_path / "t.yaml", "--until", until, "--stats", "-").stdout)
        rec.append(report["nodes"][1]["rec"])
    assert rec == most + [120, 129]


def test_a_host_is_not_told_of_error_passive(tmp_path):
    steps = [(100, "error-warning"), (130, None), (100, None), (10, "error-active"),
             (130, "error-warning"), (256, "bus-off"), (200, "error-warning"), (256, "bus-off")]
    rules = "".join(f"  - {{ name: r{n}, when: {{ time: {n + 1}ms }}, "
                    f"do: {{ counters: b, tec: {tec} }} }}\n" for n, (tec, _) in enumerate(steps))
    text = "bus: { name: t, bitrate: 500000 }\n" \
           "nodes: [ { name: a }, { name: b, controller: { report-passive: off } } ]\nfaults:\n"
    (tmp_path / "t.yaml").write_text(text + rules)
    out = sim(tmp_path / "t.yaml", "--until", "10ms", "--events", "-").stdout.splitlines()
    told = [json.loads(line) for line in out if '"state"' in line]
    assert [(round(e["t"] * 1000), e["state"], e["tec"]) for e in told] == \
        [(n + 1, state, tec) for n, (tec, state) in enumerate(steps) if state]
    report = sim(tmp_path / "t.yaml", "--until", "2.5ms", "--stats", "-").stdout
    stats = json.loads(report)["nodes"][1]
    assert stats["state"] == "error-passive" and stats["error_passive"] == 1


def test_the_flag_of_a_silent_node_is_passive(tmp_path):
    """On the wire nothing is silent: the flag of b is passive, so a sees nothing of it."""
    (tmp_path / "t.yaml").write_text(
        "bus: { name: t, bitrate: 500000 }\n"
        "nodes: [ { name: a }, { name: b, controller: { report-passive: off } } ]\nfaults:\n"
        "  - { name: passive, when: { time: 1ms }, do: { counters: b, rec: 130 } }\n"
        "  - { name: flag, when: { time: 2ms }, do: { error-flag: b } }\n")
    out = sim(tmp_path / "t.yaml", "--until", "3ms", "--events", "-").stdout
    assert '"error"' not in out


@pytest.mark.parametrize("frame, key, says", [
    ("7F0#", "high-identifiers", "whose first seven bits are all recessive"),
    ("123#1122334455667788_F", "dlc-over-8", "a DLC above 8")])
def test_traffic_that_a_controller_refuses_is_an_error(tmp_path, frame, key, says):
    for text in (f"nodes: [ {{ name: a, controller: {{ {key}: off }}, "
                 f"traffic: [ {{ send: '{frame}' }} ] }} ]",
                 f"nodes: [ {{ name: a, controller: {{ {key}: off }} }} ]\n"
                 f"faults: [ {{ name: r, do: {{ babble: '{frame}', as: a }} }} ]"):
        (tmp_path / "t.yaml").write_text("bus: { bitrate: 500000 }\n" + text + "\n")
        done = canwire("check", tmp_path / "t.yaml", status=1)
        assert says in done.stderr and f"{key}: off" in done.stderr


@pytest.mark.parametrize("keys", ["controller: mcp2515", "sample-point: 0.75"])
@pytest.mark.parametrize("seed", range(4))
def test_another_bit_timing_leaves_frames_and_hosts_their_times(tmp_path, keys, seed):
    """Off the common grid of bits, with right clocks. Frames come anywhere in a bit."""
    rng = random.Random(seed)
    nodes = []
    for name in "abc":
        sent = ", ".join(
            f"{{ send: '{rng.randrange(0x700):03X}#{rng.choice(('', '00', 'FF00FF'))}', "
            f"every: {rng.randrange(300_000, 3_000_000)}ns, offset: {rng.randrange(900_000)}ns }}"
            for _ in range(2))
        host = f", service-time: {rng.randrange(50, 900)}us" if name != "b" else ""
        model = f", controller: {{ model: basic{host} }}" if host else ", KEYS"
        nodes.append(f"  - {{ name: {name}{model}, traffic: [ {sent} ] }}\n")
    text = "".join(nodes) + (
        "faults:\n  - { name: f, when: { frame: '000~7FF', every: 5 }, do: { flip: 'crc[2]', "
        "at: [c] } }\n  - { name: r, when: { time: 7777777ns }, do: { software-reset: a } }\n")
    on_grid, _ = run(tmp_path, text.replace(", KEYS", ""), "--until", "30ms")
    off_grid, _ = run(tmp_path, text.replace("KEYS", keys), "--until", "30ms")
    assert off_grid == on_grid and len(on_grid) > 150
    assert {e["event"] for e in on_grid} >= {"rx", "tx", "error", "overrun", "arbitration-lost"}
