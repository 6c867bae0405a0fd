# SPDX-License-Identifier: MIT
"""Events as columns of numbers. Their reference are the same events as dicts."""

import sys

import pytest

from canwire import Bus, Columns, Error, Frame
from simtool import ROOT
from test_python_bus import EMPTY, run_like_sim
from test_scenarios import SCENARIOS, arguments_of

# The columns leave these out.
REST = {"late_ns", "was", "pending", "pending_node", "local-time", "skipped_ns", "phase_error_tq",
        "phase_error_ps"}
DETAILS = {"state": "state", "link": "state", "error": "type", "drop": "why", "wake": "by"}
NUMBERS = {"error": "index", "arbitration-lost": "bit", "fault": "hit"}


def frame_of(columns, row):
    """Returns the text of a frame."""
    can_id, flags = columns.can_id[row], columns.flags[row]
    extended, remote = bool(can_id & 0x80000000), bool(can_id & 0x40000000)
    data = bytes(columns.data[row, i] for i in range(columns.data.shape[1]))
    length = columns.length[row]
    assert not any(data[0 if remote else length:])
    return str(Frame(can_id & 0x1FFFFFFF, b"" if remote else data[:length], extended, remote,
                     bool(flags & 1), bool(flags & 2), bool(flags & 4),
                     length if remote else columns.raw_dlc[row] or None))


def event_of(columns, row, rig):
    """Returns an event as Bus.events() has it."""
    kind = columns.words[columns.event[row]]
    event = {"event": kind, "t": columns.t[row]}
    if rig:
        event["bus"] = columns.buses[columns.bus[row]]
    if columns.node[row] >= 0:
        event["node"] = columns.nodes[columns.node[row]]
    if kind in DETAILS:
        event[DETAILS[kind]] = columns.words[columns.detail[row]]
    else:
        assert columns.words[columns.detail[row]] == ""
    if kind in NUMBERS:
        event[NUMBERS[kind]] = columns.number[row]
    if kind == "fault":
        event["rule"] = columns.rules[columns.rule[row]]
    if kind in ("error", "state"):
        event["tec"], event["rec"] = columns.tec[row], columns.rec[row]
    if columns.can_id[row] != Columns.NO_FRAME:
        event["frame"] = frame_of(columns, row)
    if kind == "error":
        marks = columns.marks[row]
        event["role"] = "tx" if marks & Columns.TX else "rx"
        event["field"] = columns.words[columns.field[row]]
        event["flag"] = ("active" if marks & Columns.ACTIVE else
                         "passive" if marks & Columns.PASSIVE else "none")
        if marks & Columns.STUFF:
            event["stuff"] = True
        if marks & Columns.DATA_RATE:
            event["rate"] = "data"
    return event


def rounded(event):
    """Returns what columns have of an event, with its time in nanoseconds."""
    kept = {key: value for key, value in event.items() if key not in REST}
    if event["event"] == "sync":
        del kept["type"]
    return {**kept, "t": round(event["t"] * 1e9)}


def events_of(columns, rig=False):
    return [event_of(columns, row, rig) for row in range(columns.rows)]


def test_columns_have_the_events_of_each_scenario():
    kinds, details = set(), set()
    for path in SCENARIOS:
        with Bus(path, listen=False) as bus:
            if not run_like_sim(bus, arguments_of(path)):
                continue
            expected = [rounded(event) for event in bus.events()]
            bus.reset()
            run_like_sim(bus, arguments_of(path))
            columns = bus.take_columns()
            assert events_of(columns) == expected, path
            assert bus.take_columns().rows == 0 and bus.events() == []
            kinds |= {event["event"] for event in expected}
            details |= set(columns.detail)
    assert len(kinds) > 10 and len(details) > 15


def test_columns_of_a_rig_and_of_a_run_in_pieces():
    with Bus(ROOT / "config/rig/rig.yaml", listen=False) as rig:
        rig.run("100ms")
        expected = [rounded(event) for event in rig.events()]
        rig.reset()
        found = []
        for part in range(1, 11):
            rig.run(part / 100)
            found += events_of(rig.take_columns(), rig=True)
        assert found == expected and len({event["bus"] for event in found}) > 1


def test_rules_have_the_names_that_they_had():
    with Bus.from_yaml(EMPTY) as bus:
        for name in ("first", "second", "first"):
            bus.inject(name=name, when={"frame": "123", "count": 1}, do={"flip": "crc[3]"})
            bus.send("a", "123#11")
            bus.run(duration="2ms")
            bus.clear(name)
        columns = bus.take_columns("event", "rule")
        hits = [row for row in range(columns.rows)
                if columns.words[columns.event[row]] == "fault"]
        assert [columns.rules[columns.rule[row]] for row in hits] == ["first", "second", "first"]
        assert columns.rules == ["first", "second"]


def test_columns_are_chosen_by_name():
    with Bus.from_yaml(EMPTY) as bus:
        bus.send("a", "123#11")
        bus.run("1ms")
        columns = bus.take_columns("t", "node")
        assert list(columns) == ["t", "node"] and columns["t"] == columns.t
        assert columns.node.tolist() == [1, 2, 0] and columns.t.tolist()[0] == columns.t[1]
        assert repr(columns) == "<canwire.Columns of 3 events: t, node>"
        with pytest.raises(AttributeError, match="no column 'data'"):
            print(columns.data)
        with pytest.raises(Error, match="there is no column 'time'; there is t, bus, node"):
            bus.take_columns("time")
        bus.close()
        with pytest.raises(Error, match="closed"):
            bus.take_columns()


@pytest.mark.skipif(sys.version_info < (3, 11), reason="NumPy has no wheel for this Python")
def test_columns_become_a_frame_of_pandas():
    config = {"bus": {"bitrate": 500000, "dbitrate": 2000000},
              "nodes": [{"name": "a"}, {"name": "b"}, {"name": "c"}],
              "faults": [{"name": "flip", "when": {"frame": "123", "count": 1},
                          "do": {"flip": "crc[3]", "at": ["c"]}}]}
    with Bus.from_dict(config) as bus:
        for frame in ("123#DEADBEEF", "12345678#R3", "124##1" + "11" * 64):
            bus.send("a", frame)
        bus.run("5ms")
        columns = bus.take_columns()
        table = columns.frame()
        assert list(table) == list(columns) and len(table) == columns.rows
        got = table[(table.event == "rx") & (table.node == "b")]
        assert got.data.tolist() == [b"\xde\xad\xbe\xef", b"\x11" * 64, b""]
        assert got.can_id.tolist() == [0x123, 0x124, 0x12345678 | 0xC0000000]
        assert got.t.tolist() == [t / 1e9 for t, event, node in zip(
            columns.t, columns.event, columns.node)
            if (columns.words[event], node) == ("rx", 1)]
        fault, = table[table.event == "fault"].itertuples()
        assert fault.rule == "flip" and fault.number == 1
        without = table[["node", "can_id", "detail"]].iloc[fault.Index]
        assert without.isna().all() and table.rule.count() == 1
        error = table[table.event == "error"].iloc[0]
        assert (error.detail, error.field, error.node) == ("crc", "ack-delimiter", "c")
        empty = bus.take_columns().frame()
        assert len(empty) == 0 and list(empty) == list(table)
