# SPDX-License-Identifier: MIT
"""A controller of CAN 2.0A, which knows base frames alone, as a reader of bits.

Frames are put together from strings, and read bit by bit. This is slow, and knows nothing of the
controllers under test. A bit on the wire is (level, is it a stuff bit, (field, index)).
"""

ARBITRATION = ("id", "srr", "ide", "rtr")
FIXED = ("crc-delimiter", "ack-slot", "ack-delimiter") + 7 * ("eof",)


def crc_15(bits):
    register = 0
    for bit in bits:
        differs = (register >> 14) != int(bit)
        register = register << 1 & 0x7FFF ^ (0x4599 if differs else 0)
    return f"{register:015b}"


def numbered(field, bits, first=0):
    return [(bit, (field, first + n)) for n, bit in enumerate(bits)]


def fields(identifier, extended, remote, dlc, data):
    """Returns the bits from SOF to the data, with their places."""
    rtr = str(int(remote))
    if extended:
        name = f"{identifier:029b}"
        head = (numbered("id", name[:11]) + [("1", ("srr", 0)), ("1", ("ide", 0))] +
                numbered("id", name[11:], 11) +
                [(rtr, ("rtr", 0)), ("0", ("r1", 0)), ("0", ("r0", 0))])
    else:
        head = (numbered("id", f"{identifier:011b}") +
                [(rtr, ("rtr", 0)), ("0", ("ide", 0)), ("0", ("r0", 0))])
    content = "" if remote else "".join(f"{byte:08b}" for byte in data[:min(dlc, 8)])
    return ([("0", ("sof", 0))] + head + numbered("dlc", f"{dlc:04b}") +
            numbered("data", content))


def wire(bits):
    """Returns all bits of a frame on the wire, SOF to EOF."""
    bits = bits + numbered("crc", crc_15("".join(bit for bit, _ in bits)))
    out = []
    for bit, place in bits:
        out.append((bit, False, place))
        levels = "".join(level for level, _, _ in out[-5:])
        if levels in ("00000", "11111"):
            out.append(("1" if bit == "0" else "0", True, place))
    return out + [("1", False, (field, n - 3 if field == "eof" else 0))
                  for n, field in enumerate(FIXED)]


class Old:
    """The receiver. `error` is (bit on the wire, type, field, index, was it a stuff bit)."""

    def __init__(self):
        self.levels = ""  # of the stuffed part
        self.bits = ""    # without stuff bits
        self.count = 0    # bits on the wire
        self.tail = -1    # index into FIXED
        self.crc_error = False
        self.error = None
        self.accepted = False

    def length(self):
        if len(self.bits) < 19:
            return 1000
        bytes_ = 0 if self.bits[12] == "1" else min(int(self.bits[15:19], 2), 8)
        return 19 + 8 * bytes_ + 15

    def place(self):
        """Returns the field and index of the last bit."""
        at = len(self.bits) - 1
        for field, first in (("crc", self.length() - 15), ("data", 19), ("dlc", 15), ("r0", 14),
                             ("ide", 13), ("rtr", 12), ("id", 1), ("sof", 0)):
            if at >= first:
                return field, at - first
        return None

    def drives(self):
        return "0" if self.tail == 1 and not self.crc_error else "1"

    def find(self, kind, field, index, stuff=False):
        self.error = (self.count, kind, field, index, stuff)

    def sample(self, level):
        if self.tail < 0:
            self.sample_stuffed(level)
        elif self.tail < len(FIXED):
            self.sample_fixed(level)
        self.count += 1

    def sample_stuffed(self, level):
        stuff = self.levels[-5:] in ("00000", "11111")
        if stuff and level == self.levels[-1]:
            self.find("stuff", *self.place(), True)
        if stuff:
            self.levels += "x" + level  # it begins the next run
        else:
            self.bits += level
            self.levels += level
        if len(self.bits) == self.length() and self.levels[-5:] not in ("00000", "11111"):
            self.crc_error = crc_15(self.bits[:-15]) != self.bits[-15:]
            self.tail = 0

    def sample_fixed(self, level):
        field = FIXED[self.tail]
        index = max(self.tail - 3, 0)
        if field == "ack-slot":
            if level != self.drives() and self.drives() == "0":
                self.find("bit", field, 0)
        elif level == "0" and index < 6:
            self.find("form", field, index)
        elif field == "ack-delimiter" and self.crc_error:
            self.find("crc", field, 0)
        self.accepted = self.accepted or (index == 5 and not self.error)
        self.tail += 1


def attempt(bits):
    """Sends a frame among an old controller and one that knows it. Returns what the old one makes
    of it, and the first thing that the sender finds wrong: (type, bit, field, index), or None."""
    old = Old()
    for n, (level, stuff, (field, index)) in enumerate(bits):
        flag = old.error is not None
        on_wire = min(level, old.drives(), "0" if flag or field == "ack-slot" else "1")
        if on_wire != level and field != "ack-slot":
            kind = "stuff" if stuff and field in ARBITRATION else "bit"
            if field in ARBITRATION and not stuff:
                kind = "lost"
            return old, ("form" if field in FIXED else kind, n, field, index)
        if not flag:
            old.sample(on_wire)
    return old, None
