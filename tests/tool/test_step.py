# SPDX-License-Identifier: MIT
"""Runs that once differed between the fast paths and single bits (--step).

Needs no CAN in the kernel. CANWIRE is the tool, by default build/release/canwire.
"""

import json

import pytest

from simtool import sim

# A node rests ahead of the bus, in the middle of its own bit.
ASLEEP = """bus: { name: asleep, bitrate: 500000 }
nodes:
  - name: n0
    ppm: 160
    sleep: on
    time-triggered: on
    local-time: {}
    schedule: { reference: "010", triggers: [ { at: 2910, slot: 50, send: 010#00 } ] }
"""

ASLEEP_FD = """bus: { name: asleep-fd, bitrate: 1000000, dbitrate: 2000000 }
nodes:
  - name: n0
    kind: fd-tolerant
    sleep: on
    wake-on: [ "100:700" ]
    time-triggered: on
    local-time: {}
    schedule: { reference: "010", triggers: [ { at: 1371, slot: 3, send: 010#00 } ] }
  - name: n1
  - { name: n2, traffic: [ { send: 1C5##100112233445566778899AABB } ] }
"""

# It ends in the middle of a data phase.
DATA_PHASE = """bus: { name: phase, bitrate: 125000, dbitrate: 2000000 }
nodes:
  - name: n0
    traffic: [ { send: 170##100112233445566778899AABB, every: 430us, offset: 297us } ]
  - name: n1
"""

# Idle time between slots, with a node that sleeps.
RESTS = """bus: { name: rests, bitrate: 500000 }
nodes:
  - name: n0
    ppm: 100
    time-triggered: on
    local-time: {}
    schedule: { reference: "010", triggers: [ { at: 9000, slot: 300, send: 010#00 } ] }
  - name: n1
    ppm: -100
    time-triggered: on
    local-time: { capture: eof }
    schedule: { reference: "010", triggers: [ { at: 2000, slot: 3, send: 110#00 } ] }
  - { name: n2, ppm: 160, sleep: on, wake-on: [ "700" ], local-time: {} }
  - { name: n3, sleep: on, ppm: 20, traffic: [ { send: 123#, every: 7ms, offset: 31ms } ] }
"""

# A node in loopback begins a frame while the bus is in a data phase. It does not see these bits.
LOOPBACK = """bus: { name: loop, bitrate: 125000, dbitrate: 2000000 }
nodes:
  - { name: a, traffic: [ { send: 0C9##1, every: 1022us, offset: 3473us, count: 18 } ] }
  - { name: b, loopback: on, traffic: [ { send: 65F#, every: 694us, offset: 3310us, count: 17 } ] }
"""

# Two rules change the state of a node at the end of one bit, and back.
RESET = """bus: { name: reset, bitrate: 500000 }
nodes:
  - { name: a, traffic: [ { send: 123# } ] }
  - { name: b }
faults:
  - { name: r1, when: { frame: "123" }, do: { counters: a, rec: 246 } }
  - { name: r2, when: { frame: "123" }, do: { hardware-reset: a } }
"""

CASES = [
    (LOOPBACK, "40ms"),
    (RESET, "2ms"),
    (RESTS, "80ms"),
    (ASLEEP, "40ms"),
    (ASLEEP_FD, "3ms"),
    (DATA_PHASE, "10325us"),
    (DATA_PHASE, "10350us"),
    (DATA_PHASE, "10375us"),
]


@pytest.mark.parametrize("text, until", CASES)
def test_single_bits_give_the_same_events_and_counts(tmp_path, text, until):
    file = tmp_path / "bus.yaml"
    file.write_text(text)
    runs = []
    for step in ([], ["--step"]):
        stats = tmp_path / "stats"
        run = sim(file, "--until", until, "--events", "-", "--stats", stats, *step)
        runs.append((run.stdout, json.loads(stats.read_text())))
    assert runs[0] == runs[1]


def test_a_data_phase_does_not_go_on_behind_the_end(tmp_path):
    file = tmp_path / "bus.yaml"
    file.write_text(DATA_PHASE)
    for step in ([], ["--step"]):
        report = json.loads(sim(file, "--until", "10325us", "--stats", "-", *step).stdout)
        assert report["bus"]["time_ns"] == 10322500


@pytest.mark.parametrize("ppm", [0, 100])
def test_a_state_that_is_there_within_a_bit_alone_is_not_told(tmp_path, ppm):
    file = tmp_path / "bus.yaml"
    file.write_text(RESET.replace("{ name: b }", f"{{ name: b, ppm: {ppm} }}"))
    told = sim(file, "--until", "2ms", "--events", "-").stdout
    assert '"event":"drop"' in told and '"event":"state"' not in told
