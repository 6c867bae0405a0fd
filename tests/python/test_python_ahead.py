# SPDX-License-Identifier: MIT
"""Looking ahead for the next event, and the frames that errors belong to."""

import pytest

from canwire import Ahead, Bus, Columns, Error
from simtool import ROOT
from test_scenarios import SCENARIOS

BUS = {"bus": {"bitrate": 500000}, "nodes": [{"name": "a"}, {"name": "b"}, {"name": "c"}]}
NEVER = 2**63 - 1
KINDS = "rx,tx,error,state,drop,fault"


def times_of(bus, kinds):
    return [round(event["t"] * 1e9) for event in bus.events() if event["event"] in kinds]


def walk(bus, end):
    """Goes from event to event. Returns how many have been foreseen, at times of their own."""
    foreseen, now = 0, -1
    while now < end:
        ahead = bus.next_event(KINDS, until=end / 1e9)
        assert now < ahead.t_ns <= end
        now = ahead.t_ns
        bus.run(f"{now}ns")
        came = [t for t in times_of(bus, KINDS.split(",")) if t > bus.walked]
        assert set(came) <= {now} and (came or not ahead.comes or now == 0)
        bus.walked = now
        foreseen += ahead.comes
    return foreseen


def check_walk(path, end):
    """Compares what is foreseen with what happens. Returns how many times have been foreseen."""
    with Bus(path) as bus:
        bus.walked = 0
        return walk(bus, end)


def test_each_event_of_a_scenario_is_foreseen():
    assert sum(check_walk(path, 30_000_000) for path in SCENARIOS[::6]) > 100


def test_gateways_of_a_rig_hand_in_frames():
    assert check_walk(ROOT / "config/rig/rig.yaml", 50_000_000) >= 30


def test_a_look_ends_where_nothing_comes_or_comes_for_ever():
    for start in ("bit", "tick"):
        idle = {**BUS, "bus": {"bitrate": 500000, "start": start}}
        with Bus.from_dict(idle) as bus:
            assert bus.next_event("rx") == Ahead(False, NEVER)
            bus.send("a", "123#11")
            bus.run("2s")
            assert bus.next_event("rx") == Ahead(False, NEVER)
            with pytest.raises(Error, match="that time is over"):
                bus.next_event("rx", until="1s")
    lonely = {"bus": {"bitrate": 500000, "dbitrate": 2000000}, "nodes": [{"name": "a"}]}
    with Bus.from_dict(lonely) as bus:
        bus.send("a", "123#11")
        assert bus.next_event("tx") == Ahead(False, 10_000_000_000)


def test_an_event_is_foreseen_and_nothing_happens():
    with Bus.from_dict(BUS) as bus:
        assert bus.next_event() == Ahead(False, NEVER)
        bus.send("a", "123#11")
        before = bus.stats()
        assert bus.next_event("tx", until="50us") == Ahead(False, 50_000)
        accepted, sent = bus.next_event("rx"), bus.next_event("tx")
        assert accepted.comes and sent == Ahead(True, accepted.t_ns + 2_000)
        assert bus.now_ns == 0 and bus.stats() == before and bus.events() == []
        bus.run(f"{sent.t_ns - 1}ns")
        assert [event["event"] for event in bus.events()] == ["rx", "rx"]
        assert bus.next_event("tx") == sent
        bus.run(f"{sent.t_ns}ns")
        assert [event["event"] for event in bus.events()] == ["rx", "rx", "tx"]
        with pytest.raises(Error, match="there is no event 'txx'"):
            bus.next_event("rx,txx")
        bus.keep_events("rx")
        with pytest.raises(Error, match="'tx' has events that are not kept"):
            bus.next_event("tx")


def error_ids(config, frames):
    with Bus.from_dict({**BUS, **config}) as bus:
        for node, frame in frames:
            bus.send(node, frame)
        bus.run("2ms")
        columns = bus.take_columns("event", "node", "error_id")
        return [(columns.nodes[node], number) for event, node, number in
                zip(columns.event, columns.node, columns.error_id)
                if columns.words[event] == "error"]


def test_errors_name_their_frames():
    flip = {"faults": [{"name": "flip", "when": {"frame": "12345678", "count": 1},
                        "do": {"flip": "crc[3]"}}]}
    frames = [("b", "123#"), ("a", "12345678#0102")]
    assert error_ids(flip, frames) == [(node, 0x92345678) for node in "abc"]
    pulse = {"faults": [{"name": "pulse", "when": {"time": "1ms"},
                         "do": {"stuck": "dominant", "for": "1bit"}}]}
    assert error_ids(pulse, frames) == [(node, Columns.NO_FRAME) for node in "abc"]
