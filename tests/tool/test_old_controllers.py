# SPDX-License-Identifier: MIT
"""Controllers of CAN 2.0A among random frames, against a model that reads them bit by bit."""

import random

import pytest

import fdbits
import oldbits
from simtool import canwire, events

BIT_US, JOIN_BITS = 2, 11


def random_frame(draw):
    """Returns the text of a classical frame, and its bits."""
    extended, remote, dlc = draw.random() < 0.7, draw.random() < 0.25, draw.randrange(9)
    identifier = draw.getrandbits(29 if extended else 11) & draw.choice((0x1FFFFFFF, 0x1F0007F0))
    data = draw.choice((draw.randbytes(dlc), bytes(dlc), b"\xff" * dlc))
    name = f"{identifier:08X}" if extended else f"{identifier:03X}"
    text = f"{name}#R{dlc}" if remote else f"{name}#{data.hex().upper()}"
    if not remote and dlc == 8 and draw.random() < 0.5:
        dlc = draw.randrange(9, 16)
        text += f"_{dlc:X}"
    return text, oldbits.wire(oldbits.fields(identifier, extended, remote, dlc, data))


def random_fd_frame(draw):
    """Returns the text of a CAN FD frame without BRS, and its bits, of which the arbitration field
    has places."""
    extended = draw.random() < 0.5
    identifier = draw.getrandbits(29 if extended else 11)
    data = draw.randbytes(draw.choice((0, 1, 5, 8, 12, 64)))
    bits, count = [], 0
    for level, kind in fdbits.encode(identifier, data, extended=extended):
        count += kind == ""
        field = "id" if 1 < count <= (33 if extended else 13) else "data"
        bits.append((level, kind != "", (field, count)))
    bits[-10] = (bits[-10][0], False, ("ack-slot", 0))
    name = f"{identifier:08X}" if extended else f"{identifier:03X}"
    return f"{name}##0{data.hex().upper()}", bits


def errors_of(all_events, node):
    """Returns the first thing that a node finds wrong: its bit, and the event."""
    wrong = [e for e in all_events if e.get("node") == node and
             e["event"] in ("error", "arbitration-lost")]
    return (round(wrong[0]["t"] * 1e6) // BIT_US - JOIN_BITS - 1, wrong[0]) if wrong else (-1, None)


def run(folder, text, *step):
    fd = "##" in text
    (folder / "bus.yaml").write_text(
        f"bus: {{ bitrate: 500000{', dbitrate: 500000' if fd else ''} }}\nnodes:\n"
        f"  - {{ name: new, one-shot: on, traffic: [ {{ send: '{text}' }} ] }}\n"
        "  - { name: old, kind: 2.0A }\n  - { name: other }\n"
        "  - { name: tolerant, kind: fd-tolerant }\n")
    return events(folder / "bus.yaml", *step)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("kind", [random_frame, random_fd_frame])
def test_an_old_controller_reads_each_frame_as_a_base_frame(tmp_path, kind, seed):
    text, bits = kind(random.Random(seed))
    levels = "".join(level for level, _, _ in bits)
    assert canwire("bits", text, "--raw").stdout.strip() == levels
    old, sender = oldbits.attempt(bits)
    found = run(tmp_path, text)
    assert run(tmp_path, text, "--step") == found
    bit, error = errors_of(found, "old")
    got = (bit, error["type"], error["field"], error["index"], error.get("stuff", False)) if error \
        else None
    assert got == old.error
    assert any(e["event"] == "rx" and e["node"] == "old" for e in found) == old.accepted
    bit, error = errors_of(found, "new")
    assert bit == (sender[1] if sender else -1)
    if error and kind is random_frame:
        what = "lost" if error["event"] == "arbitration-lost" else error["type"]
        assert what == sender[0]
        assert what == "lost" or (error["field"], error["index"]) == sender[2:]


def test_the_model_has_the_known_answer():
    """12345678#01: a form error in wire bit 35, and the sender's bit error in dlc[3], bit 39."""
    old, sender = oldbits.attempt(oldbits.wire(oldbits.fields(0x12345678, True, False, 1, b"\1")))
    assert old.error == (35, "form", "crc-delimiter", 0, False)
    assert sender == ("bit", 39, "dlc", 3)
