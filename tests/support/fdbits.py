# SPDX-License-Identifier: MIT
"""The wire bits of CAN FD frames (ISO 11898-1:2015), put together from strings.

This is slow, and knows nothing of the encoder under test. An entry is (level, kind): kind
is "", "dynamic" or "fixed".
"""

LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
CRC_17 = format(1 << 17 | 0x1685B, "018b")
CRC_21 = format(1 << 21 | 0x102899, "022b")
GRAY = ("000", "001", "011", "010", "110", "111", "101", "100")


def dlc_of(count):
    return next(dlc for dlc, length in enumerate(LENGTHS) if length >= count)


def remainder(bits, divisor, first):
    """Divides with the register that begins with `first`, bit by bit."""
    register = first
    for bit in bits:
        out = register[0] != bit
        register = register[1:] + "0"
        if out:
            register = "".join(str(int(a != b)) for a, b in zip(register, divisor[1:]))
    return register


def stuffed(bits):
    out = []
    for bit in bits:
        out.append((bit, ""))
        levels = "".join(level for level, _ in out[-5:])
        if levels in ("00000", "11111"):
            out.append(("1" if levels[0] == "0" else "0", "dynamic"))
    return out


def head(identifier, extended, brs, esi, data):
    dlc = format(dlc_of(len(data)), "04b")
    control = f"10{int(brs)}{int(esi)}{dlc}"  # FDF res BRS ESI DLC
    if extended:
        name = format(identifier, "029b")
        bits = f"0{name[:11]}11{name[11:]}0{control}"  # SRR IDE ... RRS
    else:
        bits = f"0{identifier:011b}00{control}"  # RRS IDE
    padded = data + bytes(LENGTHS[dlc_of(len(data))] - len(data))
    return bits + "".join(f"{byte:08b}" for byte in padded), len(padded)


def encode(identifier, data, extended=False, brs=False, esi=False, iso=True):
    """Returns the bits from SOF to EOF."""
    bits, length = head(identifier, extended, brs, esi, data)
    wire = stuffed(bits)
    # no dynamic stuff bit is sent after the last bit: the first fixed one takes its place (D3)
    if wire[-1][1] == "dynamic":
        wire.pop()
    count = sum(kind == "dynamic" for _, kind in wire)
    covered = "".join(level for level, _ in wire)
    field = ""
    if iso:
        gray = GRAY[count % 8]
        field = gray + str(gray.count("1") % 2)
        covered += field
    divisor = CRC_17 if length <= 16 else CRC_21
    first = ("1" if iso else "0") + "0" * (len(divisor) - 2)
    field += remainder(covered, divisor, first)
    for n, bit in enumerate(field):
        if n % 4 == 0:
            wire.append(("0" if wire[-1][0] == "1" else "1", "fixed"))
        wire.append((bit, ""))
    return wire + [(bit, "") for bit in "1" + "11" + "1" + "1111111"]


def levels(wire):
    return "".join(level for level, _ in wire)
