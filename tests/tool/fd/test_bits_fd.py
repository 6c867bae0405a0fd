# SPDX-License-Identifier: MIT
"""`canwire bits` of CAN FD frames: against an encoder of its own (support/fdbits.py), which knows
nothing of ours. Needs no CAN in the kernel.
"""

import random
import re

import pytest

import fdbits
from simtool import canwire


def text_of(identifier, data, extended=False, brs=False, esi=False):
    return f"{identifier:0{8 if extended else 3}X}##{brs + 2 * esi}{data.hex().upper()}"


def drawn(seed):
    """Returns a frame; its bits often have runs, so that there are stuff bits."""
    draw = random.Random(seed)
    extended = draw.random() < 0.5
    identifier = draw.choice((0, -1, draw.getrandbits(29))) & (0x1FFFFFFF if extended else 0x7FF)
    data = bytes(draw.choice((0, 255, draw.getrandbits(8))) for _ in range(draw.randrange(65)))
    return {"identifier": identifier, "data": data, "extended": extended,
            "brs": draw.random() < 0.5, "esi": draw.random() < 0.5}


# Each length that a frame can have, those between, and the edges of both CRCs.
FRAMES = [*({"identifier": 0x123, "data": bytes(range(0xF0, 0xF0 + n) if n < 16 else n)}
            for n in (*range(17), 20, 21, 24, 32, 33, 48, 63, 64)),
          *(drawn(seed) for seed in range(60)),
          {"identifier": 0x1FFFFFFF, "data": b"\xff" * 64, "extended": True, "brs": True},
          {"identifier": 0, "data": bytes(64)}]


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: text_of(**frame)[:30])
@pytest.mark.parametrize("iso", [True, False], ids=["iso", "non-iso"])
def test_the_bits_are_those_of_another_encoder(frame, iso):
    options = [] if iso else ["--fd-non-iso"]
    wanted = fdbits.levels(fdbits.encode(**frame, iso=iso))
    assert canwire("bits", "--raw", text_of(**frame), *options).stdout == wanted + "\n"


def test_each_bit_has_a_rate_and_stuff_bits_are_marked(monkeypatch):
    monkeypatch.setenv("COLUMNS", "1000")
    for seed in range(20):
        frame = drawn(seed)
        wire = fdbits.encode(**frame)
        rows = canwire("bits", text_of(**frame)).stdout.split("\n\n")[1:-1]
        lines = {}
        for row in rows:
            column = {line[:6].strip(): line[7:] for line in row.splitlines()}
            width = len(column["level"])
            for name in ("level", "rate", "stuff"):
                lines[name] = lines.get(name, "") + column.get(name, "").ljust(width) + " "
        places = [n for n, c in enumerate(lines["level"]) if c in "01"]
        assert [lines["level"][n] for n in places] == [level for level, _ in wire]
        kinds = {" ": "", "^": "dynamic", "f": "fixed"}
        assert [kinds[lines["stuff"][n]] for n in places] == [kind for _, kind in wire]
        rates = "".join(lines["rate"][n] for n in places)
        if frame["brs"]:  # 10 bits follow the CRC delimiter
            assert re.fullmatch(r"n+md+mn{10}", rates)
            assert wire[rates.index("m")][0] == "1"
        else:
            assert set(rates) == {"n"}


def test_positions_are_named():
    text = canwire("bits", "123##3" + "55" * 20).stdout
    names = " ".join(line[7:] for line in text.splitlines() if line.startswith("field")).split()
    assert names == ["sof", "id", "rtr", "ide", "fdf", "res", "brs", "esi", "dlc",
                     *(f"data[{n}]" for n in range(20)), "stuff-count", "crc", "crc-delimiter",
                     "ack-slot", "ack-delimiter", "eof"]
    names = canwire("bits", "-n", "12345678##0").stdout
    assert "stuff-count" not in names and "stuff count" not in names and "not ISO" in names


# Without dynamic stuff bits the length is a formula; here these stand in the data phase alone.
@pytest.mark.parametrize("count, crc, fixed", [(0, 17, 6), (8, 17, 6), (16, 17, 6), (20, 21, 7),
                                               (64, 21, 7)])
def test_the_length_is_that_of_both_rates(count, crc, fixed):
    text = canwire("bits", "555##1" + "55" * count).stdout
    bits, stuff, shown = map(int, re.search(
        r"bits +(\d+) from SOF to EOF, (\d+) of them stuff bits?, (\d+) fixed", text).groups())
    nominal, data = map(int, re.search(r"rates +(\d+) nominal bits and (\d+) data", text).groups())
    assert f"(CRC-{crc})" in text and shown == fixed
    # SOF id RRS IDE FDF res BRS; CRC delimiter, two bits of ACK slot, delimiter, EOF
    assert nominal == 1 + 11 + 5 + 10
    # ESI DLC data, stuff count, CRC, and one bit for BRS and CRC delimiter
    assert data == 1 + 4 + 8 * count + 4 + crc + fixed + stuff + 1
    assert nominal + data == bits
    us = (nominal * 2000 + data * 500) / 1000
    assert f"{us:.3f} us at 500 kbit/s and 2 Mbit/s" in text
    slow = canwire("bits", "555##0" + "55" * count).stdout
    assert "rates" not in slow and "us at 1 Mbit/s" in slow


def test_data_is_filled_up_to_the_next_length():
    assert canwire("bits", "123##1" + "11" * 9).stdout == canwire(
        "bits", "123##1" + "11" * 9 + "000000").stdout
    assert canwire("bits", "123##1" + "11" * 9).stdout.startswith(
        "123##1" + "11" * 9 + "000000\n")


def test_classical_frames_have_no_rate_and_no_other_format():
    text = canwire("bits", "123#DEADBEEF").stdout
    assert "rate" not in text and "fixed" not in text
    error = canwire("bits", "123#DEADBEEF", "--fd-non-iso", status=1).stderr
    assert error == ("canwire bits: FRAME 123#DEADBEEF: no CAN FD frame (##), as --fd-non-iso "
                     "wants it\n")
