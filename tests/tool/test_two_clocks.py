# SPDX-License-Identifier: MIT
"""Two clocks that differ: each outcome is that of an independent reference, receiver.py."""

from fractions import Fraction
from math import ceil

import pytest

from receiver import RECESSIVE, Timing, receive
from simtool import events, raw

# name: bit/s, clock, brp, prop-seg, phase-seg1, phase-seg2, sjw
TIMINGS = {
    "1M 10 quanta": (1000000, 10, 1, 6, 1, 2, 1),
    "1M 16 quanta": (1000000, 16, 1, 10, 2, 3, 2),
    "500k": (500000, 16, 2, 4, 5, 6, 4),
    "125k": (125000, 16, 8, 11, 2, 2, 2),
    "50k": (50000, 16, 16, 11, 4, 4, 4),
    "100k": (100000, 10, 10, 1, 4, 4, 4),
}
FRAMES = ["123#787C3C3C3C3C3C3C", "123#53"]  # edges ten bits apart; the last one ten before the ACK
FIRST_BIT = 26
TICK = Fraction(1, 80)  # in microseconds, as all times here


def predicted(frame, timing, ppm):
    """Returns the time of the receiver's event `rx` in ticks, or None where there is an error."""
    rate, clock, brp, prop, seg1, seg2, sjw = timing
    bit_time, quantum = Fraction(10**6, rate), Fraction(brp, clock)
    sof = FIRST_BIT * bit_time
    acknowledged = [int(level) for level in raw(frame)]
    ack = len(acknowledged) - 9
    driven = acknowledged[:ack] + [RECESSIVE] + acknowledged[ack + 1:]
    reading = receive(driven, sof, bit_time, Timing(prop, seg1, seg2, sjw),
                      quantum / (1 + Fraction(ppm, 10**6)))
    looks = [sof + n * bit_time + (1 + prop + seg1) * quantum for n in range(len(driven))]
    begin, end = reading.ends[ack - 1], reading.ends[ack]  # of the ACK at the sender
    in_slot = looks[ack - 1] <= begin < looks[ack] and end < looks[ack + 1]
    if reading.levels != acknowledged or not in_slot:
        return None
    return ceil(reading.ends[-2] / TICK)


def simulated(write, frame, timing, ppm):
    rate, clock, brp, prop, seg1, seg2, sjw = timing
    bits = (f"clock: {clock}MHz, brp: {brp}, prop-seg: {prop}, phase-seg1: {seg1}, "
            f"phase-seg2: {seg2}, sjw: {sjw}")
    path = write(f"""
bus: {{ name: pair, bitrate: {rate} }}
nodes:
  - {{ name: a, {bits}, one-shot: on, traffic: [ {{ send: {frame}, offset: {FIRST_BIT}bit }} ] }}
  - {{ name: b, {bits}, ppm: {ppm} }}
""")
    found = events(path)
    if any(e["event"] == "error" for e in found):
        return None
    return next(ceil(e["t"] * 10**6 / TICK - 0.1) for e in found if e["event"] == "rx")


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    def write(text):
        path = tmp_path / "pair.yaml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("sign", [1, -1], ids=["fast", "slow"])
@pytest.mark.parametrize("name", TIMINGS)
def test_errors_begin_where_the_phase_error_says(write, name, sign):
    outcomes = set()
    for percent_100 in [30, 60, 90, 110, 120, 130, 150, 200, 250, 280, 350, 400, 450, 500]:
        for frame in FRAMES:
            ppm = sign * (100 * percent_100 + 37)  # no edge comes just when the receiver looks
            expected = predicted(frame, TIMINGS[name], ppm)
            assert simulated(write, frame, TIMINGS[name], ppm) == expected, (frame, ppm)
            outcomes.add(expected is None)
    assert outcomes == {True, False}
