# SPDX-License-Identifier: MIT
"""CAN frames, their length on the wire and the order in which a bus carries them.

Written from the protocol, not from the library: what the tests expect must not come from the
code that they test.
"""

import functools
import socket
import struct
from typing import NamedTuple

EXTENDED = socket.CAN_EFF_FLAG
REMOTE = socket.CAN_RTR_FLAG
ERROR = socket.CAN_ERR_FLAG

INTEGRATION_BITS = 11  # a bus starts with all nodes integrating: the first SOF is bit 11
INTERMISSION_BITS = 3
TRAILER_BITS = 1 + 1 + 1 + 7  # CRC delimiter, ACK slot, ACK delimiter, EOF
CRC15 = 0x4599

CLASSIC = struct.Struct("=IBxxB8s")  # struct can_frame: can_id, len, two of padding, len8_dlc, data
FD = struct.Struct("=IBBxx64s")  # struct canfd_frame: can_id, len, flags, data


class Frame(NamedTuple):
    """A classical frame. can_id carries SocketCAN's flags; dlc is the raw 0..15."""

    can_id: int
    dlc: int
    data: bytes = b""

    @classmethod
    def parse(cls, text):
        """Reads can-utils' notation: 123#1122, 12345678#, 123#R4, 123#1122334455667788_F."""
        identifier, _, rest = text.partition("#")
        can_id = int(identifier, 16) | (EXTENDED if len(identifier) == 8 else 0)
        rest, _, raw_dlc = rest.partition("_")
        if rest.startswith("R"):
            dlc = int(raw_dlc or rest[1:] or "0", 16)
            return cls(can_id | REMOTE, dlc)
        data = bytes.fromhex(rest)
        return cls(can_id, int(raw_dlc, 16) if raw_dlc else len(data), data)

    @classmethod
    def unpack(cls, packed):
        can_id, length, len8_dlc, data = CLASSIC.unpack(packed)
        return cls(can_id, max(length, len8_dlc), b"" if can_id & REMOTE else data[:length])

    def pack(self):
        length = min(self.dlc, 8)
        return CLASSIC.pack(self.can_id, length, self.dlc if self.dlc > 8 else 0, self.data)

    @property
    def identifier(self):
        return self.can_id & 0x1FFFFFFF


def number_bits(value, count):
    return [value >> i & 1 for i in reversed(range(count))]


def header_bits(frame):
    """Returns the bits from the first identifier bit to the last one of the arbitration field and
    IDE."""
    remote = 1 if frame.can_id & REMOTE else 0
    if frame.can_id & EXTENDED:
        high, low = frame.identifier >> 18, frame.identifier & 0x3FFFF
        return number_bits(high, 11) + [1, 1] + number_bits(low, 18) + [remote]
    return number_bits(frame.identifier, 11) + [remote, 0]


def crc15(bits):
    crc = 0
    for bit in bits:
        crc = (crc << 1 ^ (CRC15 if bit ^ crc >> 14 else 0)) & 0x7FFF
    return crc


def stuff_bit_count(bits):
    count, run, last = 0, 0, None
    for bit in bits:
        run, last = (run + 1, last) if bit == last else (1, bit)
        if run == 5:  # the stuff bit starts a run of its own
            count, run, last = count + 1, 1, 1 - bit
    return count


@functools.cache
def wire_bits(frame):
    """Returns the bits from SOF to EOF, stuff bits included."""
    reserved = [0, 0] if frame.can_id & EXTENDED else [0]
    bits = [0] + header_bits(frame) + reserved + number_bits(frame.dlc, 4)
    for byte in frame.data:
        bits += number_bits(byte, 8)
    bits += number_bits(crc15(bits), 15)
    return len(bits) + stuff_bit_count(bits) + TRAILER_BITS


def slot_bits(frame):
    """Returns the bits from SOF to the next possible SOF."""
    return wire_bits(frame) + INTERMISSION_BITS


def priority(frame):
    """Sorts as arbitration does: the frame with the first dominant bit goes first."""
    return header_bits(frame)


class Source(NamedTuple):
    """One `send` of a node's traffic; times in bits."""

    node: str
    frame: Frame
    every: int
    count: int
    offset: int = INTEGRATION_BITS


def predict(sources):
    """Returns the traffic of a bus: the frames in their order, and the bit after the last
    intermission."""
    sources = sorted(sources, key=lambda s: priority(s.frame))
    slots = [slot_bits(s.frame) for s in sources]
    nodes = [[i for i, s in enumerate(sources) if s.node == n] for n in {s.node for s in sources}]
    release = [s.offset for s in sources]
    left = [s.count for s in sources]
    bit, order = INTEGRATION_BITS, []

    def offer(node):
        """Returns the next source of a node; a frame that comes a bit later still joins (M6)."""
        for latest in (bit, bit + 1):
            for i in node:
                if left[i] and release[i] <= latest:
                    return i
        return len(sources)

    while any(left):
        bit = max(bit, min(r for r, n in zip(release, left) if n))
        winner = min(map(offer, nodes))
        order.append(sources[winner].frame)
        left[winner] -= 1
        release[winner] += sources[winner].every
        bit += slots[winner]
    return order, bit
