#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Looks for frames in which two wrong bits go undetected (protocol digest, section 6).

A flip that makes five equal bits turns the data bit behind them into a stuff bit. One that
separates five equal bits turns their stuff bit into data. When both happen, the bits between are
shifted by one bit. For one frame in some thousands the CRC polynomial divides that difference. The
output has frames in the form of `canwire sim`, the two wire bits (bit[N] of a fault rule) and the
frames of receivers. The first one takes about a minute.

    find_blind_spot.py [HOW_MANY [SEED]]
"""

import random
import sys

GENERATOR = 0b1100010110011001
DATA_BYTES = 8
HEAD_BITS = 19  # SOF, identifier, RTR, IDE, r0, DLC


def append_number(bits, value, count):
    bits.extend((value >> n) & 1 for n in reversed(range(count)))


def remainder(bits):
    """Returns the CRC by long division: the remainder of the bits with 15 zeros behind them."""
    rest = list(bits) + [0] * 15
    for i in range(len(bits)):
        if rest[i]:
            for j in range(16):
                rest[i + j] ^= (GENERATOR >> (15 - j)) & 1
    return rest[-15:]


def stuff(bits):
    wire, run, last = [], 0, None
    for bit in bits:
        wire.append(bit)
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            last = 1 - bit
            wire.append(last)
            run = 1
    return wire


def destuff(wire):
    """Returns the bits without stuff bits; None for a visible stuff error."""
    bits, run, last = [], 0, None
    for bit in wire:
        if run == 5:
            if bit == last:
                return None
            run, last = 1, bit
            continue
        bits.append(bit)
        run = run + 1 if bit == last else 1
        last = bit
    return bits


def encode(identifier, data):
    bits = [0]
    append_number(bits, identifier, 11)
    bits += [0, 0, 0]
    append_number(bits, len(data), 4)
    for byte in data:
        append_number(bits, byte, 8)
    return bits + remainder(bits)


def blind_spots(bits):
    """Pairs of wire bits whose inversion gives another frame that every check lets pass."""
    wire = stuff(bits)
    for i in range(HEAD_BITS, len(wire)):
        for j in range(i + 6, min(i + 60, len(wire))):
            wrong = list(wire)
            wrong[i] ^= 1
            wrong[j] ^= 1
            got = destuff(wrong)
            if got is None or len(got) != len(bits) or got[:HEAD_BITS] != bits[:HEAD_BITS]:
                continue
            if remainder(got[:-15]) == got[-15:]:
                yield i, j, got


def data_of(bits):
    text = "".join(map(str, bits[HEAD_BITS:-15]))
    return bytes(int(text[n : n + 8], 2) for n in range(0, len(text), 8))


def main():
    how_many = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    rng = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    while how_many:
        identifier = rng.randrange(0x800)
        data = bytes(rng.randrange(256) for _ in range(DATA_BYTES))
        for i, j, got in blind_spots(encode(identifier, data)):
            print(f"{identifier:03X}#{data.hex().upper()} bit[{i}] bit[{j}] "
                  f"read as {identifier:03X}#{data_of(got).hex().upper()}")
            how_many -= 1
            if not how_many:
                break


if __name__ == "__main__":
    main()
