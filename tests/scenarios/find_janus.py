#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Looks for two frames that a transmitter can send as one. It drives one frame at first in each
bit, and the other one later in the bit, when it lets go of some of them.

Both have the same identifier, length and number of wire bits, and both CRCs are right. Wherever
they differ the first is dominant and the second recessive. So no edge to dominant moves, and
receivers stay synchronised. The output has frames in the form of `canwire sim`, and the wire bits
(bit[N] of a fault rule) that differ. Pairs with the fewest such bits come last.

    find_janus.py [IDENTIFIER [DATA_BYTES]]
"""

import sys

from find_blind_spot import encode, stuff


def differing_bits(first, second):
    """Returns the wire bits that differ, or None where that is no such pair."""
    if len(first) != len(second) or any(a > b for a, b in zip(first, second)):
        return None
    return [n for n, pair in enumerate(zip(first, second)) if pair[0] != pair[1]]


def pairs(identifier, length):
    wires = [stuff(encode(identifier, data.to_bytes(length, "big")))
             for data in range(1 << 8 * length)]
    for second, wire in enumerate(wires):
        first = second
        while first:
            first = (first - 1) & second  # all values whose bits are bits of the second
            bits = differing_bits(wires[first], wire)
            if bits:
                yield first, second, bits


def main():
    identifier = int(sys.argv[1], 16) if len(sys.argv) > 1 else 0x123
    length = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    fewest = 64
    for first, second, bits in pairs(identifier, length):
        if len(bits) <= fewest:
            fewest = len(bits)
            names = " ".join(f"bit[{n}]" for n in bits)
            frames = [f"{identifier:03X}#{data:0{2 * length}X}" for data in (first, second)]
            print(*frames, names)


if __name__ == "__main__":
    main()
