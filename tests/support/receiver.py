# SPDX-License-Identifier: MIT
"""One frame as a receiver with a clock of its own reads it, by T1 to T6 and T12 of lib/RULES.md.

A reference for tests, apart from the library: exact fractions, a look at the end of each quantum,
nothing skipped. The sender keeps its time, and the receiver does not disturb it. All times are in
microseconds.
"""

from fractions import Fraction
from math import ceil

DOMINANT, RECESSIVE = 0, 1


class Timing:
    """Segments of a bit, in quanta."""

    def __init__(self, prop, seg1, seg2, sjw):
        self.sample = 1 + prop + seg1
        self.end = self.sample + seg2
        self.sjw = sjw


class Reading:
    """Begins, ends and levels of the bits of a receiver, from the SOF on."""

    def __init__(self):
        self.begins, self.ends, self.levels = [], [], []


def level_before(bits, sof, bit_time, moment):
    """Returns what was driven last before a moment (T12)."""
    bit = ceil((moment - sof) / bit_time) - 1
    return int(bits[bit]) if 0 <= bit < len(bits) else RECESSIVE


def receive(bits, sof, bit_time, timing, quantum):
    """Returns the reading of a receiver that has been idle since 0, and acknowledges.

    bits: what the sender drives, with a recessive ACK slot.
    """
    reading = Reading()
    ack = len(bits) - 9
    look = Fraction(ceil(sof / quantum) - 1) * quantum
    count, sampled, synchronised = 0, False, False
    last = before = RECESSIVE
    sample_at, end_at = timing.sample, timing.end

    def begin_bit(begin, driven):
        nonlocal sample_at, end_at, sampled
        if reading.begins:
            reading.ends.append(driven)
        reading.begins.append(begin)
        sample_at, end_at, sampled = timing.sample, timing.end, False

    while len(reading.ends) < len(bits):
        if reading.begins and count == end_at:
            begin_bit(look, look)
            count = 0
        look += quantum
        count += 1
        drives = len(reading.begins) - 1 == ack
        level = DOMINANT if drives else level_before(bits, sof, bit_time, look)
        edge = before == RECESSIVE and level == DOMINANT and last == RECESSIVE
        before = level
        late = count - 1
        if edge and not reading.begins:  # T4: the SOF
            begin_bit(look - quantum, look)
            count, synchronised = 1, True
        elif edge and not synchronised and sampled:  # T5, early
            synchronised = True
            if end_at - late <= timing.sjw:
                begin_bit(look - quantum, look)
                count = 1
            else:
                end_at -= timing.sjw
        elif edge and not synchronised and not (drives and late):  # T5, T6
            synchronised = True
            sample_at += min(late, timing.sjw)
            end_at += min(late, timing.sjw)
        if reading.begins and count == sample_at and not sampled:
            reading.levels.append(level)
            last, sampled, synchronised = level, True, False
    return reading
