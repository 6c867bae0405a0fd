# SPDX-License-Identifier: MIT
"""Counters and checksums of traffic, against cantools, which has AUTOSAR's profiles 2 and 5.

Profile 22 is profile 2 behind other bytes, so its CRC is that of its bytes in another order. For
profiles 1 and 11 the specification puts together a CRC of the package crccheck. The known answers
are those of the specification, and of catalogues of CRCs for "123456789".
"""

import functools
import operator

import pytest
from cantools.autosar.end_to_end import check_profile2_crc, check_profile5_crc
from crccheck.crc import Crc8Autosar, Crc8SaeJ1850

from simtool import sim

IDS = bytes([7, 3, 250, 4, 99, 0, 255, 17, 18, 19, 20, 21, 22, 23, 24, 25])
DATA = "A5F00FC3123456789ABCDEF011223344"  # 16 bytes
FRAMES = 20  # all values of a counter of four bits, and the first ones again


def frames(tmp_path, checksum, length, rest="", data=DATA):
    """Returns the data of the frames that a node sends."""
    keys = (f"checksum: {checksum}" if checksum else "") + rest
    path = tmp_path / "bus.yaml"
    path.write_text(f"""
bus: {{ bitrate: 500000, dbitrate: 2000000 }}
nodes:
  - name: a
    traffic:
      - {{ send: "123##1{data[:2 * length]}", every: 1ms, count: {FRAMES},
          {keys} }}
  - name: b
""")
    lines = sim(path, "--log", "-").stdout.splitlines()
    assert len(lines) == FRAMES
    return [bytes.fromhex(line.rpartition("##1")[2]) for line in lines]


def as_list(ids):
    return "[" + ", ".join(map(str, ids)) + "]"


ID_LIST = as_list(range(1, 17))
ANSWERS = [  # AUTOSAR_PRS_E2EProtocol: all data are 0; the first frames from byte 0 or 8 on
    ("p1, at: 0, data-id: 0x123", ["CC00", "9101"]),
    ("p1, at: 0, data-id: 0x123, data-id-mode: alt", ["CE00", "0201"]),
    ("p1, at: 0, data-id: 0x123, data-id-mode: nibble", ["2A10", "7711"]),
    ("p11, at: 0, data-id: 0x123", ["CC00", "9101"]),
    ("p11, at: 0, data-id: 0x123, data-id-mode: nibble", ["2A10", "7711"]),
    (f"p2, at: 0, data-id: {ID_LIST}", ["1B01"]),
    (f"p22, at: 0, data-id: {ID_LIST}", ["1B01"]),
    (f"p22, at: 8, data-id: {ID_LIST}", ["1401"]),
    ("p5, at: 0, data-id: 0x1234", ["1CCA00"]),
    ("p5, at: 8, data-id: 0x1234", ["289100"]),
]


@pytest.mark.parametrize("kind, answers", ANSWERS)
def test_profiles_have_the_answers_of_the_specification(tmp_path, kind, answers):
    at = 8 if "at: 8" in kind else 0
    sent = frames(tmp_path, f"{{ kind: e2e-{kind} }}", 8 + at, data="00" * 16)
    for data, answer in zip(sent, answers):
        assert data[at:].hex().upper().startswith(answer)


@pytest.mark.parametrize("kind, data, ids, answer", [
    ("xor", "1234567", "89", 0x31), ("sum", "1234567", "89", 0xDD),
    ("crc8-h2f", "1234567", "89", 0xDF),
    ("crc8-j1850", "3456789", "12", 0x4B)])  # its Data ID comes first
def test_plain_checksums_have_the_answers_of_catalogues(tmp_path, kind, data, ids, answer):
    data = "00" + data.encode().hex()
    sent = frames(tmp_path, f"{{ kind: {kind}, at: 0, data-id: {as_list(ids.encode())} }}", 8,
                  data=data)
    assert {frame[0] for frame in sent} == {answer}


@pytest.mark.parametrize("kind, independent", [
    ("xor", lambda data: functools.reduce(operator.xor, data)),
    ("sum", lambda data: sum(data) % 256),
    ("crc8-h2f", Crc8Autosar.calc), ("crc8-j1850", Crc8SaeJ1850.calc)])
@pytest.mark.parametrize("at, counter, bits, most, start", [
    (63, 3, 5, 20, 18), (0, 507, 5, 31, 30), (31, 22, 13, 8190, 8185),
    (62, 449, 32, 2 ** 32 - 1, 2 ** 32 - 5), (5, 15, 1, 1, 1)])
def test_frames_of_64_bytes_are_counted_at_any_bit(tmp_path, kind, independent, at, counter, bits,
                                                  most, start):
    before = bytes(range(100, 164))
    sent = frames(tmp_path, f"{{ kind: {kind}, at: {at} }}", 64, data=before.hex(), rest=(
        f", counter: {{ at: \"{counter // 8}.{counter % 8}\", bits: {bits}, max: {most}, "
        f"start: {start} }}"))
    here = (1 << bits) - 1 << 512 - counter - bits
    for number, data in enumerate(sent):
        value = int.from_bytes(data, "big")
        assert (value & here) >> 512 - counter - bits == (start + number) % (most + 1)
        assert data[at] == independent(data[:at] + data[at + 1:])
        untouched = ~(here | 0xFF << 8 * (63 - at))
        assert value & untouched == int.from_bytes(before, "big") & untouched


def crc_of_profile_1(data, at, data_id, mode):
    """PRS_E2E_00163: Data ID, then the data without their checksum, without any inversion."""
    low, high = data_id & 0xFF, data_id >> 8
    ids = {"both": [low, high], "alt": [high if data[at + 1] & 1 else low], "low": [low],
           "nibble": [low, 0]}[mode]
    protected = bytes(ids) + data[:at] + data[at + 1:]
    return Crc8SaeJ1850.calc(protected, initvalue=0) ^ 0xFF


@pytest.mark.parametrize("kind, modes", [("e2e-p1", ["both", "alt", "low", "nibble"]),
                                         ("e2e-p11", ["both", "nibble"])])
def test_profiles_1_and_11_are_those_of_the_specification(tmp_path, kind, modes):
    for mode, length, at in ((mode, *where) for mode in modes for where in ((8, 0), (16, 8))):
        sent = frames(tmp_path, f"{{ kind: {kind}, at: {at}, data-id: 0xABC, "
                                f"data-id-mode: {mode} }}", length)
        before = bytes.fromhex(DATA)
        for number, data in enumerate(sent):
            assert data[at + 1] & 0xF == number % 15
            assert data[at] == crc_of_profile_1(data, at, 0xABC, mode)
            assert data[at + 1] >> 4 == (0xA if mode == "nibble" else before[at + 1] >> 4)
            assert data[:at] == before[:at] and data[at + 2:] == before[at + 2:length]


def test_profile_2_is_that_of_cantools(tmp_path):
    sent = frames(tmp_path, f"{{ kind: e2e-p2, at: 0, data-id: {as_list(IDS)} }}", 8)
    assert [data[1] & 0xF for data in sent] == [n % 16 for n in range(1, FRAMES + 1)]
    for data in sent:
        assert check_profile2_crc(data, IDS[data[1] & 0xF])
        assert not check_profile2_crc(data, IDS[data[1] & 0xF] ^ 1)


def test_profile_22_is_profile_2_in_another_order(tmp_path):
    sent = frames(tmp_path, f"{{ kind: e2e-p22, at: 6, data-id: {as_list(IDS)} }}", 16)
    assert [data[7] & 0xF for data in sent] == [n % 16 for n in range(1, FRAMES + 1)]
    for data in sent:
        in_order = data[6:7] + data[:6] + data[7:]
        assert check_profile2_crc(in_order, IDS[data[7] & 0xF])


@pytest.mark.parametrize("offset", [0, 8])
def test_profile_5_is_that_of_cantools(tmp_path, offset):
    sent = frames(tmp_path, f"{{ kind: e2e-p5, at: {offset}, data-id: 0xBEEF }}", 16,
                  rest=", counter: { start: 250 }")
    assert [data[offset + 2] for data in sent] == [n % 256 for n in range(250, 250 + FRAMES)]
    for data in sent:
        in_order = data[offset:offset + 2] + data[:offset] + data[offset + 2:]
        assert check_profile5_crc(in_order, 0xBEEF)
        assert not check_profile5_crc(in_order, 0xBEEE)


def test_wrong_checksums_are_wrong_for_others_too(tmp_path):
    path = tmp_path / "bus.yaml"
    path.write_text(f"""
bus: {{ bitrate: 500000 }}
nodes:
  - name: a
    traffic:
      - {{ send: 123#{DATA[:16]}, every: 1ms, count: 9,
          checksum: {{ kind: e2e-p2, at: 0, data-id: {as_list(IDS)} }} }}
  - name: b
faults:
  - {{ name: wrong, when: {{ frame: "123", every: 3 }}, do: {{ checksum: wrong }} }}
  - {{ name: repeat, when: {{ frame: "123", skip: 4, count: 1 }}, do: {{ counter: repeat }} }}
""")
    lines = sim(path, "--log", "-").stdout.splitlines()
    sent = [bytes.fromhex(line.rpartition("#")[2]) for line in lines]
    assert [check_profile2_crc(data, IDS[data[1] & 0xF]) for data in sent] == \
        [n % 3 > 0 for n in range(9)]
    assert [data[1] & 0xF for data in sent] == [1, 2, 3, 4, 4, 6, 7, 8, 9]
