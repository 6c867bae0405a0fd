# SPDX-License-Identifier: MIT
"""Local times, schedules and what is expected of them, as a user of `canwire sim` sees them.

tests/scenarios/time-triggered*.yaml have exact traces. Needs no CAN in the kernel. CANWIRE is the
tool, by default build/release/canwire.
"""

import pytest

from simtool import ROOT, events, sim, stats

MATRIX = ROOT / "config/time-triggered/matrix.yaml"
STOP = ["--until", "100ms"]

CLOCK = """bus: {{ name: clock, bitrate: 500000 }}
nodes:
  - {{ name: a, traffic: [ {{ send: 123#, offset: 1ms, every: 1ms, count: 19 }} ] }}
  - {{ name: b, local-time: {{ unit: 1us, {local} }}, {node} }}
faults:
  - {{ name: change, when: {{ time: 10ms }}, do: {{ set: b, {change} }} }}
"""

PAIR = """bus: {{ name: pair, bitrate: 500000 }}
nodes:
  - name: master
    time-triggered: on
    local-time: {{}}
    schedule: {{ reference: "010", triggers: [ {{ at: 5000, slot: 100, send: 010# }} ] }}
  - name: slave
    time-triggered: on
    ppm: {ppm}
    local-time: {{}}
    schedule: {{ reference: "010", triggers: [ {{ at: 4000, slot: {slot}, send: 200# }} ] }}
  - {{ name: loud, traffic: [ {{ send: 100#1122334455667788, offset: {loud} }} ] }}
expect:
  - {expect}
"""


def node(report, name):
    return next(n for n in report["nodes"] if n["name"] == name)


def clock(folder, *arguments, local="bits: 16", sets="ppm: 0", keys="queue: 16"):
    path = folder / "clock.yaml"
    path.write_text(CLOCK.format(local=local, change=sets, node=keys))
    return node(stats(path, "--until", "20ms", *arguments), "b")["local-time"]


@pytest.mark.parametrize("step", [[], ["--step"]], ids=["fast", "step"])
def test_the_example_meets_its_expectations(step):
    assert "5 met, 0 failed" in sim(MATRIX, *STOP, *step).stdout
    assert events(MATRIX, *STOP, *step, "--captures") == events(MATRIX, *STOP, "--captures")


def test_slaves_know_the_time_of_the_master():
    report = stats(MATRIX, *STOP)
    master, front, rear = (node(report, name)["local-time"] for name in ("master", "front", "rear"))
    assert node(report, "front")["local_time"] == front  # the deprecated key
    now = report["bus"]["time_ns"] // 1000  # the last bits of all nodes are over
    assert now in (100000, 100002) and master["now"] == master["global"] == now % 65536
    assert front["now"] in ((509 + now) % 65536, (510 + now) % 65536)  # 100 ppm fast
    assert rear["now"] in (now - 11, now - 10)  # 100 ppm slow, and 32 bits wide
    assert all(abs(n["global"] - master["now"]) <= 2 for n in (front, rear))  # whole captures
    assert front["master"] == rear["master"] == "master"


def test_no_cycle_time_while_no_cycle_is_under_way(tmp_path):
    """The third reference message is handed in some bits before 15 ms, and captured in its slot."""
    path = tmp_path / "tt.yaml"
    path.write_text(PAIR.format(expect="{ drops: 0 }", ppm=0, slot=50, loud="1s"))
    for until, under_way in (("14900us", True), ("14998us", False), ("15050us", False),
                             ("15200us", True)):
        schedule = node(stats(path, "--until", until), "master")["schedule"]
        assert schedule["in_cycle"] is under_way
        assert (schedule["cycle_time"] is not None) is under_way
        assert not under_way or 0 <= schedule["cycle_time"] <= 5000


def test_captures_come_only_when_asked_for():
    assert not any(e["event"] == "capture" for e in events(MATRIX, *STOP))
    captures = [e for e in events(MATRIX, *STOP, "--captures") if e["event"] == "capture"]
    assert {e["node"] for e in captures} == {"master", "front", "rear"}
    assert "it is for --events" in sim(MATRIX, "--until", "1ms", "--captures", status=2).stderr


def test_captures_are_those_of_the_sample_point_of_sof():
    """The scenario has the frames; a SOF that begins at 1000 us is sampled at 1001.75 us."""
    slots = ROOT / "tests/scenarios/time-triggered-slots.yaml"
    captures = [e for e in events(slots, "--until", "2500us", "--captures")
                if e["event"] == "capture"]
    assert [e["local-time"] for e in captures] == [n for n in (1001, 1303, 1591, 2003, 2305)
                                                   for _ in range(3)]
    assert captures[0] == {"t": 0.001114, "node": "master", "event": "capture", "frame": "010#00",
                           "local-time": 1001}


@pytest.mark.parametrize("sets, keys, now", [
    ("ppm: 0", "queue: 16", 20000),
    ("ppm: 10000", "queue: 16", 20100),  # 10 ms at 1.01
    ("ppm: 0", "ppm: 1000", 20010),  # 10 ms at 1.001
    ("clock: 40MHz, sample-point: 87.5%", "clock: 80MHz", 20000),  # the same unit
    ("ramp: { ppm: 0..1000, over: 10ms }", "queue: 16", 20005),  # 500 ppm in the mean
], ids=["right", "set ppm", "ppm", "set clock", "ramp"])
def test_local_time_follows_the_clock_of_the_node(tmp_path, sets, keys, now):
    for arguments in ([], ["--step"]):
        local = clock(tmp_path, *arguments, sets=sets, keys=keys)
        assert now - 1 <= local["now"] <= now + 2  # off the grid a bit more has passed
    assert local["captures"] == 19 and local["unit_ps"] == 1000000


def test_the_counter_wraps_at_its_width(tmp_path):
    assert clock(tmp_path, local="bits: 16, start: 65000")["now"] == (65000 + 20000) % 65536
    assert clock(tmp_path, local="bits: 17, start: 65000")["now"] == 85000
    assert clock(tmp_path, local="bits: 17, start: 65000, capture: eof")["capture"] == "eof"


def pair(folder, expect, ppm=0, slot=50, loud="1s"):
    path = folder / "pair.yaml"
    path.write_text(PAIR.format(expect=expect, ppm=ppm, slot=slot, loud=loud))
    return path


# Each with what must come of it. The slave's slots begin at 9001 us, 14003 us and so on.
OUTCOMES = [
    ("{ drops: 0, why: slot-missed }", {}, True),
    ("{ drops: 0, why: slot-missed }", {"loud": "8990us"}, False),
    ("{ drops: 1, why: slot-missed, window: exclusive }", {"loud": "8990us"}, True),
    ("{ drops: 0, why: slot-missed, window: arbitrating }", {"loud": "8990us"}, True),
    ("{ drops: 0, why: slot-missed }", {"loud": "8990us", "slot": 500}, True),  # it goes later
    ("{ jitter: 2us, window: exclusive }", {}, True),
    ("{ jitter: 2us }", {"loud": "8990us", "slot": 500}, False),
    ("{ jitter: 300us }", {"loud": "8990us", "slot": 500}, True),
    ("{ jitter: 2us, frame: 010 }", {"loud": "8990us", "slot": 500}, True),
    ("{ jitter: 2us, window: arbitrating }", {}, False),  # there is no such frame
    ("{ arbitration-lost: 0, window: any }", {"loud": "9006us"}, True),
    ("{ arbitration-lost: 1, window: exclusive, node: slave }", {"loud": "9002us"}, True),
]


@pytest.mark.parametrize("expect, keys, met", OUTCOMES)
def test_expectations_of_slots(tmp_path, expect, keys, met):
    report = sim(pair(tmp_path, expect, **keys), "--until", "50ms", status=0 if met else 3).stdout
    assert ("1 met" in report) == met


def test_a_time_master_never_ends(tmp_path):
    message = sim(pair(tmp_path, "{ drops: 0 }"), status=1).stderr
    assert "pair.yaml:6:15: the schedule of a time master never ends" in message
    assert sim(pair(tmp_path, "{ drops: 0 }"), "--until-event", "slave:tx").stdout


def test_without_a_reference_message_slaves_are_silent(tmp_path):
    path = tmp_path / "quiet.yaml"
    path.write_text(PAIR.format(expect="{ drops: 0 }", ppm=0, slot=5, loud="1ms").replace(
        '"010", triggers: [ { at: 5000', '"011", triggers: [ { at: 5000'))
    assert {e["node"] for e in events(path, "--until", "50ms") if e["event"] == "tx"} == {"loud"}


REPLIES = """bus: { name: replies, bitrate: 500000 }
nodes:
  - name: m
    time-triggered: on
    local-time: {}
    controller:
      model: full
      mailboxes: [ { direction: rx }, { direction: tx }, { direction: tx, id: 123, reply: auto } ]
    schedule:
      reference: "010"
      triggers: [ { at: 300, slot: 50, send: 123#AA }, { at: 1000, slot: 100, send: 010#00 } ]
  - name: other
"""


def test_a_trigger_that_writes_what_a_mailbox_replies_misses_no_slot(tmp_path):
    file = tmp_path / "replies.yaml"
    file.write_text(REPLIES)
    m = node(stats(file, "--until", "4500us"), "m")  # four cycles, and half of one
    assert m["stored"] == 4
    assert [t["missed"] for t in m["schedule"]["triggers"]] == [0, 0]
