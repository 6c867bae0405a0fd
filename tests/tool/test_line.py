# SPDX-License-Identifier: MIT
"""The longest line that works, and the next metre, against the exact formula.

A node sees an edge after the way D, and its bits begin floor(D / q) quanta behind those of the
sender. So its ACK comes floor(D / q) x q + D behind the begin of the slot, and must be there before
the sample point. tests/scenarios/time-line-1m.yaml has more about it. CANWIRE is the tool, by
default build/release/canwire.
"""

import pytest

from simtool import sim

BUS = """bus: {{ name: line, bitrate: {rate} }}
defaults: {{ clock: 16MHz, brp: {brp}, prop-seg: {prop}, phase-seg1: {seg1}, phase-seg2: {seg2},
  sjw: {sjw}, tx-delay: 50ns, rx-delay: 50ns }}
nodes:
  - {{ name: a, one-shot: on, traffic: [ {{ send: 555#55 }} ] }}
  - {{ name: b, position: {metres}m }}
"""
SEGMENTS = [(11, 2, 2, 2), (10, 2, 3, 2), (8, 4, 3, 1), (5, 6, 4, 3), (1, 12, 2, 1), (4, 3, 8, 3)]


def is_in_time(metres, quantum_ns, to_sample):
    way = 5 * metres + 100
    return way // quantum_ns * quantum_ns + way < to_sample * quantum_ns


@pytest.mark.parametrize("brp", [1, 8, 20])
@pytest.mark.parametrize("segments", SEGMENTS)
def test_the_first_line_that_breaks_is_that_of_the_formula(tmp_path, brp, segments):
    path = tmp_path / "line.yaml"
    prop, seg1, seg2, sjw = segments
    longest = 0
    while is_in_time(longest + 1, 62.5 * brp, 1 + prop + seg1):
        longest += 1
    assert longest >= (prop * 62.5 * brp / 2 - 100) / 5 - 1  # T10 is enough
    for metres, works in (longest, True), (longest + 1, False):
        path.write_text(BUS.format(rate=1000000 // brp, brp=brp, prop=prop, seg1=seg1, seg2=seg2,
                                   sjw=sjw, metres=metres))
        out = sim(path, "--events", "-", "--until", f"{100 * brp}us").stdout
        assert ('"ack"' not in out and '"tx"' in out) == works
