# SPDX-License-Identifier: MIT
"""CAN FD on whole buses, in virtual time. Some kinds of nodes do not go together, and some rates do
not. Some delays need compensation, and all of it takes its time."""

import json

import pytest

from simtool import canwire, sim

BUS = "bus: {{ name: fd, bitrate: 500000, sample-point: 0.8, dbitrate: {dbitrate}{more} }}\n"


class Run:
    """The report of a simulation."""

    def __init__(self, events, stats):
        self.events = [json.loads(line) for line in events.splitlines()]
        self.bus = stats["bus"]
        self.nodes = {node["name"]: node for node in stats["nodes"]}

    def of(self, kind, node=None):
        return [e for e in self.events if e["event"] == kind and node in (None, e.get("node"))]


@pytest.fixture
def play(tmp_path):
    def run(nodes, until="20ms", dbitrate=2000000, more=", dsample-point: 0.8", faults=""):
        scenario = tmp_path / "fd.yaml"
        scenario.write_text(BUS.format(dbitrate=dbitrate, more=more) +
                            "nodes:\n" + "".join(f"  - {{ {n} }}\n" for n in nodes) + faults)
        events, stats = tmp_path / "events", tmp_path / "stats"
        sim(scenario, "--until", until, "--events", events, "--stats", stats)
        return Run(events.read_text(), json.loads(stats.read_text()))
    return run


def sender(name, frame, every="2ms", more=""):
    return f'name: {name}{more}, traffic: [ {{ send: "{frame}", every: {every}, offset: 1ms }} ]'


def test_a_classical_node_destroys_fd_frames_until_it_is_passive(play):
    """It finds a stuff error in the bits of the data phase, 1 for it and 8 for the sender. Then its
    passive flag destroys nothing."""
    run = play([sender("a", "123##1DEADBEEF", "200us"), "name: b", "name: old, kind: classical"],
               "100ms")
    passive = next(e["t"] for e in run.of("state", "old") if e["state"] == "error-passive")
    assert not [e for e in run.of("rx", "b") if e["t"] < passive]
    assert [e for e in run.of("rx", "b") if e["t"] > passive]
    assert [e["state"] for e in run.of("state", "a")][:2] == ["error-warning", "error-passive"]
    first = run.of("error")[0]
    assert (first["node"], first["type"], first["role"]) == ("old", "stuff", "rx")


def test_a_classical_frame_of_a_passive_node_fails_among_fd_frames(play):
    """Behind each frame that it cannot read it waits for an idle bus. A bus full of FD frames has
    no room for it."""
    run = play([sender("a", "123##1DEADBEEF", "110us"), "name: b",
                sender("old", "321#11", "1ms", ", kind: classical")], "100ms")
    assert len(run.of("tx", "a")) > 500
    assert len(run.of("tx", "old")) < 50, "half of its frames are late"


def test_a_tolerant_node_does_not_mind(play):
    run = play([sender("a", "123##1DEADBEEF"), "name: b",
                sender("old", "321#11", "2ms", ", kind: fd-tolerant")])
    assert not run.of("error") and len(run.of("protocol-exception", "old")) == 10
    assert {e["node"] for e in run.of("protocol-exception")} == {"old"}
    assert len(run.of("tx", "a")) == len(run.of("tx", "old")) == 10
    assert {e["frame"] for e in run.of("rx", "b")} == {"123##1DEADBEEF", "321#11"}


def test_without_the_exception_the_same_node_signals_a_form_error(play):
    run = play([sender("a", "123##1DEADBEEF"), "name: b",
                "name: old, kind: fd-tolerant, protocol-exception: off"])
    first = run.of("error", "old")[0]
    assert (first["type"], first["field"]) == ("form", "r0") or first["field"] == "fdf"
    assert not run.of("protocol-exception")


def test_a_node_at_another_data_rate_destroys_frames_with_brs_only(play):
    wrong = "name: c, dbrp: 2, dprop-seg: 9, dphase-seg1: 9, dphase-seg2: 6"  # 1.6 Mbit/s
    run = play([sender("a", "123##1DEADBEEF"), "name: b", wrong])
    first = run.of("error")[0]
    assert first["node"] == "c" and first["rate"] == "data"
    assert "error-passive" in [e["state"] for e in run.of("state", "c")]
    assert not run.of("rx", "c")
    run = play([sender("a", "123##0DEADBEEF"), "name: b", wrong])
    assert not run.of("error") and len(run.of("tx", "a")) == 10


LOOP = "tx-delay: 100ns, rx-delay: 100ns"


@pytest.mark.parametrize("mode, frame, errors", [
    ("off", "123##1DEADBEEF", True), ("off", "123##0DEADBEEF", False),
    ("auto", "123##1DEADBEEF", False)])
def test_a_loop_of_200_ns_needs_compensation_at_5_mbit(play, mode, frame, errors):
    run = play([sender("a", frame, more=f", {LOOP}, tdc-mode: {mode}"), f"name: b, {LOOP}"],
               dbitrate=5000000, more="")
    found = run.of("error", "a")
    assert bool(found) == errors
    assert not errors or (found[0]["type"], found[0]["rate"]) == ("bit", "data")
    assert errors or len(run.of("tx", "a")) == 10


def test_can_xl_frames_are_protocol_exceptions(play):
    faults = ('faults:\n  - { name: xl, when: { from: a }, '
              'do: { force: recessive, from: res, at: [b] } }\n')
    run = play([sender("a", "123##1DEADBEEF"), "name: b", "name: c"], faults=faults)
    assert len(run.of("protocol-exception", "b")) == 10 and not run.of("error")
    assert len(run.of("rx", "c")) == 10 and not run.of("rx", "b")


def test_times_of_a_frame_with_64_bytes(play):
    """BRS 1700 ns, data bits 500 ns, CRC delimiter 800 ns, all others 2000 ns."""
    run = play([sender("a", "123##1" + "55" * 64), "name: b"], "3ms")
    (tx,) = run.of("tx", "a")
    nominal = 1 + 11 + 1 + 1 + 1 + 1 + 2 + 1 + 7  # SOF to res, ACK slot to EOF
    fast = 1 + 4 + 512 + 32  # ESI to the CRC
    begin = tx["t"] - (nominal * 2000 + fast * 500 + 1700 + 800) * 1e-9
    assert abs(begin - 1e-3) < 1e-9


@pytest.mark.parametrize("delay", [249, 250])
def test_a_node_that_check_warns_of_cannot_send_and_others_can(play, tmp_path, delay):
    """A data bit is sampled 250 ns behind its begin. A level that comes then is not seen (T12)."""
    run = play([sender("a", "123##1DEADBEEF", more=f", tdc-mode: off, tx-delay: {delay}ns"),
                "name: b"], more=", dsample-point: 0.5")
    warned = "cannot send at the data rate" in canwire("check", tmp_path / "fd.yaml").stderr
    failed = [e for e in run.of("error", "a") if e["type"] == "bit" and e["rate"] == "data"]
    assert (warned, bool(failed), bool(run.of("rx", "b"))) == (
        (True, True, False) if delay == 250 else (False, False, True))


def test_rules_change_the_data_phase_and_back(play):
    """From 5 to 10 ms b has half of the data rate, and no frame passes."""
    nodes = [sender("a", "123##1DEADBEEF", "1ms", ", restart-ms: 1"), "name: b"]
    run = play(nodes, "40ms", faults=(
        "faults:\n"
        "  - { name: away, when: { time: 5ms }, do: { set: b, dbrp: 2 } }\n"
        "  - { name: back, when: { time: 10ms }, do: { set: b, dbrp: 1 } }\n"))
    assert [e["rule"] for e in run.of("fault")] == ["away", "back"]
    received = [e["t"] for e in run.of("rx", "b")]
    errors = [e["t"] for e in run.of("error")]
    assert len([t for t in received if t < 0.005]) == 4
    assert not [t for t in received if 0.005 <= t < 0.010]
    assert [t for t in received if t > 0.030] and not [t for t in errors if t < 0.005]
    assert [t for t in errors if t < 0.010] and not [t for t in errors if t > 0.030]


def test_nodes_from_before_the_standard_talk_to_each_other(play):
    """Without stuff count the CRC field is shorter: 4 bits and a fixed stuff bit."""
    frame = sender("a", "123##1" + "55" * 8)
    iso = play([frame, "name: b"])
    old = play([frame, "name: b"], more=", dsample-point: 0.8, fd-non-iso: on")
    assert not old.of("error") and len(old.of("tx", "a")) == len(old.of("rx", "b")) == 10
    assert {e["frame"] for e in old.of("rx", "b")} == {"123##1" + "55" * 8}
    assert old.of("rx", "b")[0]["t"] < iso.of("rx", "b")[0]["t"]
