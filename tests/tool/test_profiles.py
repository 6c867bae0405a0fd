#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Each profile in a small scenario, in virtual time: what its comment says is what happens.

Three ECUs at 500 kbit/s: the engine sends 123 each 2 ms, the gearbox 200 each 3 ms, the dash only
listens. Without faults that are 150 and 100 frames in 300 ms.
"""

import collections
import json
import re
import subprocess
import sys

import pytest

from simtool import CANWIRE, ROOT, TIMEOUT_S, sim

pytestmark = pytest.mark.kept

PROFILES = ROOT / "config/profiles"
ENGINE_FRAMES, GEARBOX_FRAMES = 150, 100
BEGIN, END = 0.1, 0.15  # of the faults that have a time, by default

SCENARIO = """
bus: {{ name: profiles, bitrate: 500000 }}
seed: 1
nodes:
  - {{ name: engine, restart-ms: 20, traffic: [ {{ send: 123#1122334455667788, every: 2ms }} ] }}
  - {{ name: gearbox, restart-ms: 20, traffic: [ {gearbox} ] }}
  - {{ name: dash, restart-ms: 20{dash} }}
profiles: [ {{ file: {file}, with: {{ {parameters} }} }} ]
"""


class Run:
    """The report of a simulation."""

    def __init__(self, events, stats):
        self.events = events
        self.bus = stats["bus"]
        self.nodes = {node["name"]: node for node in stats["nodes"]}
        self.counts = collections.Counter((e.get("node"), e["event"]) for e in events)

    def of(self, kind, node=None, begin=0.0, end=1.0):
        return [e for e in self.events
                if e["event"] == kind and node in (None, e.get("node")) and begin <= e["t"] < end]

    def states(self, node):
        return [e["state"] for e in self.of("state", node)]

    def first(self, node, state):
        return next(e["t"] for e in self.of("state", node) if e["state"] == state)

    def nothing_lost(self):
        return (self.counts["engine", "tx"], self.counts["gearbox", "tx"]) == (
            ENGINE_FRAMES, GEARBOX_FRAMES)


def simulate(folder, text):
    """Runs a scenario for 300 ms."""
    scenario, events, stats = (folder / name for name in ("scenario.yaml", "events", "stats"))
    scenario.write_text(text)
    sim(scenario, "--until", "300ms", "--events", events, "--stats", stats)
    return Run([json.loads(line) for line in events.read_text().splitlines()],
               json.loads(stats.read_text()))


@pytest.fixture
def play(tmp_path):
    def run(name, parameters="", dash="", gearbox="{ send: 200#0102, every: 3ms, offset: 1ms }"):
        return simulate(tmp_path, SCENARIO.format(
            file=PROFILES / f"{name}.yaml", parameters=parameters, dash=dash, gearbox=gearbox))
    return run


def test_every_profile_is_played():
    with open(__file__, encoding="utf-8") as own:
        text = own.read()
    for profile in PROFILES.glob("*.yaml"):
        assert f'"{profile.stem}"' in text, f"{profile.stem} has no run here"


def errors_behind(run, hits):
    """Returns the first error behind each hit, up to the next hit, or None."""
    errors = run.of("error")
    ends = [hit["t"] for hit in hits[1:]] + [1.0]
    return [next((e for e in errors if hit["t"] <= e["t"] < end), None)
            for hit, end in zip(hits, ends)]


def test_noisy_harness(play):
    """Of four pulses two miss the sample point, and do nothing."""
    run = play("noisy-harness")
    hits = run.of("fault")
    assert 8 <= len(hits) <= 35  # 20 expected of 250 frames
    assert run.nothing_lost() and not run.of("state")
    errors = errors_behind(run, hits)
    bad = [hit["rule"] for hit, error in zip(hits, errors) if error]
    assert 0 < len(bad) == run.bus["error_frames"] < len(hits)
    assert set(bad) <= {"pulse-3", "pulse-4"}
    assert run.counts["dash", "rx"] == ENGINE_FRAMES + GEARBOX_FRAMES


def test_noisy_harness_at_one_ecu(play):
    """Whatever it reads wrongly, it is the first that finds an error."""
    run = play("noisy-harness", "victim: dash")
    errors = [e for e in errors_behind(run, run.of("fault")) if e]
    assert len(errors) == run.bus["error_frames"] > 0 and run.nothing_lost()
    assert {e["node"] for e in errors} == {"dash"}


def test_noisy_harness_whose_pulses_miss_the_sample_point(play):
    """None of them reaches 87.5% of the bit: the last begins at 1700 ns, and ends at 1740."""
    run = play("noisy-harness", "rate: 0.2, for: 40ns")
    assert run.counts[None, "fault"] > 100
    assert run.nothing_lost() and not run.of("error")


def test_loose_connector(play):
    run = play("loose-connector", "victim: gearbox")
    openings = run.of("fault")
    assert 3 <= len(openings) <= 13
    assert all(round(b["t"] - a["t"], 9) >= 0.020 for a, b in zip(openings, openings[1:]))
    assert run.nothing_lost()
    # 3 ms without the engine's frames, each time
    assert len(openings) <= ENGINE_FRAMES - run.counts["gearbox", "rx"] <= 3 * len(openings)
    assert run.counts["dash", "rx"] == ENGINE_FRAMES + GEARBOX_FRAMES
    for opening in openings:
        quiet = opening["t"], opening["t"] + 0.003
        assert not run.of("rx", "gearbox", *quiet) and not run.of("tx", "gearbox", *quiet)


def test_shorted_bus(play):
    run = play("shorted-bus")
    for node in ("engine", "gearbox"):
        assert run.first(node, "error-passive") < BEGIN + 16 * 2e-6 + 0.003
        assert run.first(node, "bus-off") < BEGIN + 0.004
        assert run.states(node).count("bus-off") == run.counts[node, "restart"] > 1
    assert not run.of("error", "dash")
    assert not run.of("tx", begin=BEGIN, end=END)
    assert run.of("tx", "engine", begin=END) and run.of("tx", "gearbox", begin=END)


def test_shorted_bus_dominant(play):
    run = play("shorted-bus", "level: dominant, begin: 100100us")
    assert run.first("dash", "error-passive") - 0.1001 == pytest.approx(130 * 2e-6, rel=0.1)
    assert run.first("engine", "bus-off") - 0.1001 == pytest.approx(260 * 2e-6, rel=0.1)
    assert "bus-off" not in run.states("dash") + run.states("gearbox")
    assert not run.of("tx", begin=BEGIN, end=END)
    assert run.of("tx", "engine", begin=END) and run.of("tx", "gearbox", begin=END)


def test_tx_stuck_dominant(play):
    run = play("tx-stuck-dominant", "victim: dash, begin: 100100us")
    assert not run.of("tx", begin=BEGIN, end=END)
    assert run.first("gearbox", "error-passive") - 0.1001 == pytest.approx(130 * 2e-6, rel=0.1)
    assert run.first("engine", "bus-off") - 0.1001 == pytest.approx(260 * 2e-6, rel=0.1)
    assert "bus-off" not in run.states("gearbox")
    assert run.counts["engine", "restart"] == 1
    assert run.counts["engine", "drop"] > 0
    for node in ("engine", "gearbox"):
        assert run.of("tx", node, begin=END)
        assert run.nodes[node]["state"] == "error-active"


def test_tx_stuck_dominant_with_timeout(play):
    run = play("tx-stuck-dominant-timeout", "victim: dash")
    assert run.states("gearbox")[:2] == ["error-warning", "error-passive"]
    assert not run.of("tx", begin=BEGIN, end=0.102)
    assert run.of("tx", begin=0.102, end=0.104)  # long before the pin is free
    assert run.nothing_lost()
    assert run.of("rx", "dash", begin=0.102, end=END)


def test_tx_stuck_dominant_with_timeout_of_a_sender(play):
    run = play("tx-stuck-dominant-timeout", "victim: gearbox")
    assert not run.of("tx", "gearbox", begin=BEGIN, end=END)
    assert run.of("rx", "gearbox", begin=0.102, end=END)
    assert "bus-off" in run.states("gearbox")
    assert run.counts["engine", "tx"] == ENGINE_FRAMES


def test_missing_termination(play):
    run = play("missing-termination", "far: dash, rate: 0.05")
    hits = run.of("fault")
    assert len(hits) == run.bus["error_frames"] > 5
    assert {e["node"] for e in errors_behind(run, hits)} == {"dash"}
    assert {e["type"] for e in run.of("error", "dash")} <= {"stuff", "form"}
    assert run.nothing_lost()
    assert run.counts["dash", "rx"] == ENGINE_FRAMES + GEARBOX_FRAMES
    assert not run.of("state")


@pytest.mark.parametrize("length, has_errors", [("1749ns", False), ("1750ns", True)])
def test_missing_termination_matters_at_the_sample_point(play, length, has_errors):
    run = play("missing-termination", f"far: dash, rate: 0.05, for: {length}")
    assert run.of("fault") and bool(run.of("error")) == has_errors


def test_deaf_ecu_that_listens(play):
    run = play("deaf-ecu", "victim: dash")
    assert not run.of("rx", "dash")
    assert run.nothing_lost()
    assert not run.of("error")


def test_deaf_ecu_that_sends(play):
    run = play("deaf-ecu", "victim: gearbox, begin: 100ms")
    sent = run.of("error", "gearbox")[0]
    assert (sent["type"], sent["field"]) == ("bit", "sof")
    assert run.first("gearbox", "error-passive") - sent["t"] <= 16 * 2e-6
    assert run.first("gearbox", "bus-off") - sent["t"] <= 0.001
    assert not run.of("rx", "gearbox", begin=BEGIN)
    assert run.counts["engine", "tx"] == ENGINE_FRAMES
    assert any(e["type"] == "stuff" for e in run.of("error", "engine"))


def test_wrong_bit_rate(play):
    """Flags of nine bits: the senders are bus-off before the ECU is error-passive."""
    run = play("wrong-bit-rate", "victim: dash")
    assert not run.of("rx", "dash")
    for node in "engine", "gearbox":
        assert run.first(node, "error-passive") < run.first(node, "bus-off") < 0.025
    assert run.first("dash", "error-passive") > 0.025
    assert run.nodes["dash"]["state"] == "error-passive" and "bus-off" not in run.states("dash")
    assert not run.nothing_lost()
    assert {e["why"] for e in run.of("drop")} == {"bus-off"}


def test_wrong_bit_rate_twice_as_fast_disturbs_nobody(play):
    """Flags of three bits are no stuff errors."""
    run = play("wrong-bit-rate", "victim: dash, brp: 1")
    assert not run.of("rx", "dash")
    assert run.first("dash", "error-passive") < 0.0005
    assert run.nothing_lost()
    assert not run.of("state", "engine") and not run.of("state", "gearbox")


def test_wrong_bit_rate_half_as_fast_loses_no_frame(play):
    run = play("wrong-bit-rate", "victim: dash, brp: 4")
    assert not run.of("rx", "dash")
    assert run.first("dash", "error-passive") < 0.010
    assert "error-passive" in run.states("engine") + run.states("gearbox")
    assert "bus-off" not in run.states("engine") + run.states("gearbox")
    assert run.nothing_lost()


def test_wrong_bit_rate_begins_in_time_and_the_right_one_is_none(play):
    run = play("wrong-bit-rate", "victim: dash, begin: 100ms")
    assert run.of("rx", "dash", end=BEGIN) and not run.of("error", end=BEGIN)
    assert not run.of("rx", "dash", begin=BEGIN + 0.001) and run.of("error")
    right = play("wrong-bit-rate", "victim: dash, brp: 2")
    assert right.nothing_lost() and not right.of("error")


@pytest.mark.parametrize("brp", [3, 4, 5])
def test_wrong_bit_rate_of_a_sender(play, brp):
    run = play("wrong-bit-rate", f"victim: gearbox, brp: {brp}")
    assert run.states("gearbox").count("bus-off") > 1  # again after a restart
    assert not run.of("tx", "gearbox") and not run.of("rx", "gearbox")
    assert not [e for e in run.of("rx", "dash") if e["frame"].startswith("200")]


def test_wrong_bit_rate_of_a_fast_sender_blocks_the_bus(play):
    run = play("wrong-bit-rate", "victim: gearbox, brp: 1")
    assert run.states("gearbox") == ["error-warning", "error-passive"]
    assert {e["type"] for e in run.of("error", "gearbox", begin=0.01)} >= {"ack"}
    assert not run.of("tx", begin=0.01)


def test_bus_off_attack(play):
    run = play("bus-off-attack", 'frame: "123"')
    hits = [e["t"] for e in run.of("fault")]
    assert len(hits) == 32
    assert hits[15] <= run.first("engine", "error-passive") < hits[16]
    assert hits[31] <= run.first("engine", "bus-off") < hits[31] + 20e-6
    assert {(e["type"], e["field"]) for e in run.of("error")} == {("form", "crc-delimiter")}
    assert run.states("gearbox") + run.states("dash") == []
    assert max(e["rec"] for e in run.of("error", "dash")) in range(25, 33)


def test_babbling_idiot(play):
    run = play("babbling-idiot", "idiot: dash")
    idiot = run.of("tx", "dash")
    busy = len(idiot) * (124 + 3)  # with its stuff bits and the intermission
    assert 0.97 < busy * 2e-6 / 0.05 < 1.02
    assert len(run.of("tx", "engine", begin=BEGIN + 0.001, end=END)) == 0
    assert {e["why"] for e in run.of("drop")} == {"queue-full"}
    assert not run.of("error")
    waited = run.of("tx", "engine", begin=END, end=END + 0.01)
    assert len(waited) >= 16  # the queue


def test_cable_cut(play):
    run = play("cable-cut", "victim: engine")
    assert run.states("engine") == [
        "error-warning", "error-passive", "error-warning", "error-active"]
    assert {e["type"] for e in run.of("error", "engine")} == {"ack"}
    assert max(e["tec"] for e in run.of("error", "engine")) == 128
    assert not run.of("tx", "engine", begin=BEGIN, end=END)
    assert run.of("tx", "engine", begin=END, end=END + 0.002)
    assert run.counts["gearbox", "tx"] == GEARBOX_FRAMES
    assert run.states("gearbox") == []


def test_crc_blind_spot(play):
    run = play("crc-blind-spot", "victim: gearbox",
               dash=", traffic: [ { send: 32A#35403783970DB6A1, offset: 600us } ]")
    frames = {e["node"]: e["frame"] for e in run.of("rx") if e["frame"].startswith("32A")}
    assert frames["engine"] == "32A#35403783970DB6A1"
    assert frames["gearbox"] != frames["engine"]
    assert not run.of("error")
    assert run.bus["undetected_errors"] == run.nodes["gearbox"]["undetected_errors"] == 1


def test_message_doubling(play):
    run = play("message-doubling")
    assert run.counts["engine", "tx"] == ENGINE_FRAMES
    assert len([e for e in run.of("rx", "dash") if e["frame"].startswith("123")]) == (
        ENGINE_FRAMES + 1)
    assert [(e["node"], e["type"], e["field"], e["tec"]) for e in run.of("error")] == [
        ("engine", "form", "eof", 8)]
    assert run.counts["dash", "overload"] == run.counts["gearbox", "overload"] == 1


def test_overload_happy(play):
    run = play("overload-happy", "victim: dash")
    frames = ENGINE_FRAMES + GEARBOX_FRAMES
    assert run.nothing_lost()
    assert run.bus["overload_frames"] == 2 * frames
    assert all(run.counts[node, "overload"] == 2 * frames for node in run.nodes)
    assert not run.of("error") and not run.of("state")
    plain = play("overload-happy", "victim: dash, frames: 1")
    longer = (run.bus["busy_bits"] - plain.bus["busy_bits"]) / frames
    assert 14 <= longer <= 16


def test_double_receive(play):
    run = play("double-receive", 'frame: "123", count: 4')
    assert run.nothing_lost()
    hits = [e["t"] for e in run.of("fault")]
    assert [round(b - a, 4) for a, b in zip(hits, hits[1:])] == [0.002] * 3  # one each message
    errors = run.of("error")
    assert {(e["node"], e["type"], e["field"], e["index"]) for e in errors} == {
        ("engine", "form", "eof", 6)}
    assert [e["tec"] for e in errors] == [8, 15, 22, 29]
    for node in "gearbox", "dash":
        received = [e["t"] for e in run.of("rx", node) if e["frame"].startswith("123")]
        assert len(received) == ENGINE_FRAMES + 4
        assert all(sum(t < e <= t + 0.0005 for e in received) == 1 for t in hits)
        assert run.counts[node, "overload"] == 4


def test_double_receive_until_bus_off(play):
    run = play("double-receive", 'frame: "123", count: 100')
    hits = [e["t"] for e in run.of("fault")]
    assert hits[18] <= run.first("engine", "error-passive") < hits[19]
    assert hits[36] == run.first("engine", "bus-off")
    assert not run.of("error", "gearbox") and not run.of("error", "dash")


def test_freeze_doom_loop(play):
    run = play("freeze-doom-loop")
    hits = [e["t"] for e in run.of("fault")]
    assert {round((b - a) / 2e-6) for a, b in zip(hits, hits[1:])} == {15}
    assert BEGIN < hits[0] < BEGIN + 0.002 and END - 0.0001 < hits[-1] <= END + 2e-6
    assert all(run.counts[node, "overload"] == len(hits) > 1600 for node in run.nodes)
    assert not run.of("error") and not run.of("state")
    assert all(node["tec"] == node["rec"] == 0 for node in run.nodes.values())
    assert not run.of("tx", begin=hits[0], end=END) and not run.of("rx", begin=hits[0], end=END)
    assert {(e["node"], e["why"]) for e in run.of("drop")} <= {
        ("engine", "queue-full"), ("gearbox", "queue-full")}
    assert len(run.of("tx", begin=END, end=END + 0.01)) >= 2 * 16  # both queues


def spoofed(true, false):
    """Returns the profile's `from` and `bits` for a false frame, and the first bit that differs."""
    wire = [sim_bits(frame) for frame in (true, false)]
    first = next(i for i, pair in enumerate(zip(*wire)) if len(set(pair)) == 2)
    assert wire[0][first] == "1"
    return first, wire[1][first:-10].replace("1", "x")


def sim_bits(frame):
    return subprocess.run([CANWIRE, "bits", frame, "--raw"], check=True, capture_output=True,
                          text=True, timeout=TIMEOUT_S).stdout.strip()


def own_attempts(errors):
    """Splits off those of frames that follow at once and meet a passive victim's delimiter."""
    cut_off = [e for e in errors if e["field"] == "error-delimiter"]
    assert {(e["type"], e["index"], e["flag"]) for e in cut_off} <= {("form", 5, "passive")}
    return [e for e in errors if e not in cut_off], cut_off


@pytest.mark.parametrize("count", [1, 3])
def test_error_passive_spoofing(play, count):
    true, false = "123#1122334455667788", "123#1122334455667701"
    first, bits = spoofed(true, false)
    run = play("error-passive-spoofing", f'victim: engine, frame: "123", from: "bit[{first}]", '
               f"bits: {bits}, count: {count}")
    engine = run.of("error", "engine")
    attempts, cut_off = own_attempts(engine)
    assert [(e["type"], e["field"], e["flag"]) for e in attempts] == (
        [("form", "crc-delimiter", "active")] * 16 + [("bit", "data", "passive")] * count)
    assert [e["tec"] for e in engine] == [8 * n for n in range(1, 1 + len(engine))]
    assert 1 <= len(cut_off) <= count  # the gearbox's frame has waited
    for node in "gearbox", "dash":
        errors = run.of("error", node)
        assert len(errors) == 16 and errors[-1]["rec"] <= 16  # none by the false frame
        frames = [e["frame"] for e in run.of("rx", node) if e["frame"].startswith("123")]
        assert frames[:count + 1] == [false] * count + [true]
        assert frames.count(false) == count and len(frames) == ENGINE_FRAMES + count
    assert run.nothing_lost() and "bus-off" not in run.states("engine")


def test_error_passive_spoofing_of_a_dominant_bit_gives_no_frame(play):
    """The attacker lets go of the bus, but the victim does not."""
    true, false = "123#1122334455667788", "123#1122334455667798"  # 1 where the true frame has 0
    first = next(i for i, pair in enumerate(zip(sim_bits(true), sim_bits(false)))
                 if len(set(pair)) == 2)
    run = play("error-passive-spoofing", f'victim: engine, frame: "123", from: "bit[{first}]", '
               f"bits: {sim_bits(false)[first:-10].replace('1', 'x')}")
    assert {e["frame"] for e in run.of("rx", "dash") if e["frame"].startswith("123")} == {true}


def test_janus(play):
    """The dash sends one frame and the others, whose sample points are later, get another one."""
    run = play("janus", "attacker: dash",
               dash=", sample-point: 75%, traffic: [ { send: 124#68, every: 3ms, offset: 600us } ]")
    false = [e for e in run.of("rx") if e["frame"].startswith("124")]
    assert {(e["node"], e["frame"]) for e in false} == {
        ("engine", "124#E8"), ("gearbox", "124#E8")}
    assert {e["frame"] for e in run.of("tx", "dash")} == {"124#68"}
    assert run.counts["dash", "tx"] == 100 and len(false) == 200
    assert run.nothing_lost() and not run.of("error")


def test_janus_with_one_sample_point_gives_one_frame(play):
    run = play("janus", "attacker: dash, offset: 90%, for: 200ns",
               dash=", sample-point: 75%, traffic: [ { send: 124#68, every: 3ms, offset: 600us } ]")
    assert {e["frame"] for e in run.of("rx") if e["frame"].startswith("124")} == {"124#68"}
    assert run.nothing_lost() and not run.of("error")


def test_find_janus_finds_the_pair_of_the_profile():
    found = subprocess.run(
        [sys.executable, ROOT / "tests/scenarios/find_janus.py", "124"], check=True,
        capture_output=True, text=True, timeout=TIMEOUT_S).stdout.splitlines()
    first, second, *bits = found[-1].split()
    text = (PROFILES / "janus.yaml").read_text()
    assert f"{first} and {second}" in text
    assert re.findall(r'from: "(.*?)"', text) == bits


def test_bus_off_by_timing(play):
    run = play("bus-off-by-timing", 'attacker: dash, frame: "123", rival: 123#, every: 2ms, '
               "delay: 1900us, for: 200ms")
    off = run.first("engine", "bus-off")
    attempts, cut_off = own_attempts(run.of("error", "engine", end=off + 1e-6))
    assert {(e["type"], e["field"], e["index"]) for e in attempts} == {("bit", "dlc", 0)}
    # 16 attempts of both, one after the other, from the engine's second frame on
    lockstep = [e for e in attempts if e["flag"] == "active"]
    assert [e["tec"] for e in lockstep] == [8 * n for n in range(1, 17)]
    assert 0.002 < lockstep[0]["t"] and lockstep[-1]["t"] < 0.004
    assert [e["tec"] for e in run.of("error", "dash", end=off)] == [8 * n for n in range(1, 17)]
    # then one round in 2 ms: 8 for the victim, 1 back, and 8 more when the gearbox follows at once
    rounds = [e for e in attempts if e["flag"] != "active"]
    assert {round(b["t"] - a["t"], 4) for a, b in zip(rounds[1:], rounds[2:])} == {0.002}
    assert [e["tec"] for e in rounds] == [
        136 + 7 * n + 8 * sum(e["t"] < at["t"] for e in cut_off) for n, at in enumerate(rounds)]
    assert len(cut_off) > 2 and rounds[-1]["t"] == off and rounds[-1]["flag"] == "none"
    assert run.states("dash")[:3] == ["error-warning", "error-passive", "error-warning"]
    instead = [e for e in run.of("rx", "gearbox", off, off + 0.02) if e["frame"].startswith("123")]
    assert {e["frame"] for e in instead} == {"123#"} and len(instead) == 10


def test_bus_off_by_timing_on_a_quiet_bus(play):
    """17 attempts at once, and 18 more rounds."""
    run = play("bus-off-by-timing", 'attacker: dash, frame: "123", rival: 123#, every: 2ms, '
               "delay: 1900us, for: 60ms", gearbox="")
    off = run.first("engine", "bus-off")
    assert [e["tec"] for e in run.of("error", "engine", end=off + 1e-6)] == (
        [8 * n for n in range(1, 18)] + [136 + 7 * n for n in range(1, 19)])
    assert [e["tec"] for e in run.of("state", "dash", end=off)] == [96, 128, 127, 95]


def test_xl_frame(tmp_path):
    """Profile "xl-frame": who reads it so leaves without an error; the dash acknowledges."""
    run = simulate(tmp_path, f"""
bus: {{ name: profiles, bitrate: 500000, dbitrate: 2000000 }}
nodes:
  - {{ name: engine, traffic: [ {{ send: "123##1DEADBEEF", every: 2ms }} ] }}
  - name: gearbox
  - name: dash
profiles: [ {{ file: {PROFILES}/xl-frame.yaml, with: {{ sender: engine, reader: gearbox }} }} ]
""")
    assert run.counts["gearbox", "protocol-exception"] == ENGINE_FRAMES == run.counts["dash", "rx"]
    assert not run.of("error") and not run.counts["gearbox", "rx"]


@pytest.fixture
def play_fd(tmp_path):
    """Plays a profile with two senders of CAN FD frames and a listener."""
    def run(name, parameters, flags, dbitrate=2000000, delay=""):
        return simulate(tmp_path, f"""
bus: {{ name: profiles, bitrate: 500000, sample-point: 0.8, dbitrate: {dbitrate} }}
nodes:
  - {{ name: engine{delay}, traffic: [ {{ send: "123##{flags}DEADBEEF", every: 2ms }} ] }}
  - {{ name: gearbox{delay}, traffic: [ {{ send: 200#0102, every: 3ms, offset: 1ms }} ] }}
  - {{ name: dash{delay} }}
profiles: [ {{ file: {PROFILES}/{name}.yaml, with: {{ {parameters} }} }} ]
""")
    return run


def test_wrong_data_bit_rate(play_fd):
    run = play_fd("wrong-data-bit-rate", "victim: dash", flags=1)
    first = run.of("error")[0]
    assert (first["node"], first["rate"]) == ("dash", "data")
    passive = run.first("dash", "error-passive")
    assert not [e for e in run.of("rx", end=passive) if e["frame"].startswith("123")]
    assert [e for e in run.of("rx", "gearbox", passive) if e["frame"].startswith("123")]
    assert not [e for e in run.of("rx", "dash") if e["frame"].startswith("123")]
    assert run.counts["gearbox", "tx"] == GEARBOX_FRAMES
    states = run.states("dash")
    assert "error-warning" in states[states.index("error-passive"):]  # active again
    assert run.states("engine")[-1] == "bus-off"


def test_wrong_data_bit_rate_does_nothing_without_brs(play_fd):
    run = play_fd("wrong-data-bit-rate", "victim: dash", flags=0)
    assert run.nothing_lost() and not run.of("error")


def test_wrong_data_bit_rate_begins_in_time(play_fd):
    run = play_fd("wrong-data-bit-rate", "victim: dash, begin: 100ms", flags=1)
    assert not run.of("error", end=BEGIN)
    assert run.of("error", "dash", begin=BEGIN)


LOOP_200_NS = ", tx-delay: 100ns, rx-delay: 100ns"


def test_no_delay_compensation(play_fd):
    run = play_fd("no-delay-compensation", "victim: engine", 1, 5000000, LOOP_200_NS)
    first = run.of("error")[0]
    assert (first["node"], first["type"], first["rate"]) == ("engine", "bit", "data")
    assert run.first("engine", "error-passive") < run.first("engine", "bus-off")
    assert not run.of("tx", "engine")


def test_no_delay_compensation_does_nothing_without_brs(play_fd):
    run = play_fd("no-delay-compensation", "victim: engine", 0, 5000000, LOOP_200_NS)
    assert run.nothing_lost() and not run.of("error")


def test_no_delay_compensation_begins_in_time(play_fd):
    run = play_fd("no-delay-compensation", "victim: engine, begin: 100ms", 1, 5000000,
                  LOOP_200_NS)
    assert run.of("tx", "engine", end=BEGIN) and not run.of("error", end=BEGIN)
    assert not run.of("tx", "engine", begin=BEGIN + 0.001) and run.of("error", "engine")


# ---- ECUs that are older than CAN FD -------------------------------------------------------------


FD_SCENARIO = """
bus: {{ name: profiles, bitrate: 500000, dbitrate: 2000000 }}
nodes:
  - {{ name: engine, restart-ms: 20, traffic: [ {{ send: "{frame}", every: 2ms }} ] }}
  - {{ name: gearbox, restart-ms: 20{gearbox} }}
  - {{ name: dash{dash} }}
{profiles}
"""

@pytest.fixture
def play_older(tmp_path):
    def run(name, parameters="", frame="123##1DEADBEEF", gearbox="", dash=""):
        profiles = f"profiles: [ {{ file: {PROFILES}/{name}.yaml, with: {{ {parameters} }} }} ]"
        return simulate(tmp_path, FD_SCENARIO.format(
            frame=frame, gearbox=gearbox, dash=dash, profiles=profiles if name else ""))
    return run


def test_classical_among_fd(play_older):
    """The sender is bus-off after 32 attempts; after four rounds the old ECU is error-passive."""
    run = play_older("classical-among-fd", "victim: dash")
    off = run.first("engine", "bus-off")
    assert [e["tec"] for e in run.of("error", "engine", end=off + 1e-9)] == [
        8 * n for n in range(1, 33)]
    passive = run.first("dash", "error-passive")
    assert run.counts["dash", "error"] > len(run.of("error", "dash", end=passive)) == 127
    assert not run.of("tx", "engine", end=passive) and run.of("tx", "engine", begin=passive)
    assert len(run.of("rx", "gearbox")) == run.counts["engine", "tx"] and not run.of("rx", "dash")


def test_classical_among_fd_is_as_a_classical_node(play_older):
    def events(run):
        return [e for e in run.events if e["event"] != "fault"]

    own = ", traffic: [ { send: 321#11, every: 3ms } ]"
    imitated = play_older("classical-among-fd", "victim: dash", gearbox=own)
    assert events(imitated) == events(play_older(None, gearbox=own, dash=", kind: classical"))
    assert imitated.counts["dash", "error"] > 100


def test_classical_among_fd_without_fd_frames(play_older):
    run = play_older("classical-among-fd", "victim: dash", frame="123#DEADBEEF")
    assert not run.of("error") and run.counts["dash", "rx"] == ENGINE_FRAMES


def test_tolerant_among_fd(play_older):
    """As a tolerant node, but for the bit in which it leaves."""
    own = ", traffic: [ { send: 321#11, every: 4ms, offset: 1ms } ]"
    imitated = play_older("tolerant-among-fd", "victim: dash", dash=own)
    real = play_older(None, dash=own + ", kind: fd-tolerant")
    for run in imitated, real:
        assert not run.of("error")
        assert run.counts["dash", "protocol-exception"] == run.counts["engine", "tx"] == (
            ENGINE_FRAMES) == run.counts["gearbox", "rx"] - run.counts["dash", "tx"]
    assert imitated.counts == collections.Counter(
        {**real.counts, (None, "fault"): imitated.counts[None, "fault"]})
