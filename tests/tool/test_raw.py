# SPDX-License-Identifier: MIT
"""Deviant senders: reserved bits at receivers that know other frames; bits in all forms."""

import json

import pytest

from simtool import canwire, sim

STEP = [[], ["--step"]]


def run(tmp_path, nodes, do, *arguments, at="100bit"):
    (tmp_path / "t.yaml").write_text(
        f"bus: {{ name: t, bitrate: 500000 }}\nnodes: [ {nodes} ]\n"
        f"faults: [ {{ name: r, when: {{ time: {at} }}, do: {do} }} ]\n")
    lines = sim(tmp_path / "t.yaml", "--until", "2ms", "--events", "-", *arguments).stdout
    return [json.loads(line) for line in lines.splitlines()]


def of(events, node, kind):
    return [e for e in events if e.get("node") == node and e["event"] == kind]


R0 = "{ raw: { frame: 123#11, r0: recessive }, as: a }"


@pytest.mark.parametrize("flags", STEP)
def test_a_reserved_bit_is_fdf_to_a_node_that_knows_fd(tmp_path, flags):
    """d reads on: res and BRS and ESI are dlc[0..2], and the DLC is dlc[3] and three bits of the
    data: 8 bytes. Its data go on into the EOF: 5 bits of the data, 15 of the CRC, the delimiter,
    ACK, its delimiter. That one and eof[0..3] are five recessive bits, the last of them data[26].
    eof[4] is no stuff bit to d, so its flag destroys the frame in eof[5]."""
    events = run(tmp_path, "{ name: a }, { name: b }, { name: d, kind: fd }", R0, *flags)
    first = of(events, "d", "error")[0]
    assert (first["type"], first["field"], first["index"], first["stuff"]) == \
        ("stuff", "data", 26, True)
    # 54 bits; eof[4] is the last but two
    assert round(first["t"] * 5e5) == 100 + 54 - 2
    for node in "a", "b":
        error = of(events, node, "error")[0]
        assert (error["type"], error["field"], error["index"]) == ("form", "eof", 5)
    assert not of(events, "b", "rx")


@pytest.mark.parametrize("flags", STEP)
def test_a_tolerant_node_leaves_the_frame(tmp_path, flags):
    events = run(tmp_path, "{ name: a }, { name: b }, { name: t, kind: fd-tolerant }", R0, *flags)
    left = of(events, "t", "protocol-exception")
    assert [round(e["t"] * 5e5) for e in left] == [100 + 15]  # r0 is bit 14
    assert [e["frame"] for e in of(events, "b", "rx") + of(events, "a", "tx")] == 2 * ["123#11"]
    assert not of(events, "t", "rx") and not [e for e in events if e["event"] == "error"]


def test_r0_of_an_extended_frame_and_srr_are_nothing_to_fd(tmp_path):
    """FDF is in the place of r1 there."""
    for key in "r0: recessive", "srr: dominant":
        events = run(tmp_path, "{ name: a, kind: fd }, { name: d, kind: fd }",
                     f"{{ raw: {{ frame: 12345678#01, {key} }}, as: a }}")
        assert len(of(events, "d", "rx")) == len(of(events, "a", "tx")) == 1
        assert not [e for e in events if e["event"] == "error"]


@pytest.mark.parametrize("frame", ["123#1122334455667788", "12345678#R3", "7FF#"])
def test_bits_of_a_frame_are_that_frame_to_a_mac(tmp_path, frame):
    bits = canwire("bits", frame, "--raw").stdout.strip()
    nodes = "{ name: a }, { name: b }"
    expected = run(tmp_path, nodes, f"{{ send: {frame}, as: a }}")
    assert run(tmp_path, nodes, f"{{ raw: '{bits}', as: a, mac: on }}") == expected
    assert run(tmp_path, nodes, f"{{ raw: {frame}, as: a }}") == expected
    spaced = " ".join(bits[n:n + 8] for n in range(0, len(bits), 8))
    without = run(tmp_path, nodes, f"{{ raw: {{ bits: '{spaced}' }}, as: a }}")
    assert without == [e for e in expected if e["event"] != "tx"]
    assert run(tmp_path, nodes, f"{{ raw: {frame}, as: a, mac: off }}") == without


def test_deviating_bits_of_a_frame_are_found_in_its_bits(tmp_path):
    """r0 is bit 14 of 123#11; the bits are those of the scenario action-raw-frame."""
    bits = "000100100011001000100010001011111000001011101111111111"
    nodes = "{ name: a }, { name: b }"
    assert run(tmp_path, nodes, f"{{ raw: '{bits}', as: a, mac: on }}") == run(tmp_path, nodes, R0)


@pytest.mark.parametrize("flags", STEP)
def test_an_idiot_with_a_lower_identifier_wins_without_knowing(tmp_path, flags):
    """200 and 100 differ in id[1] and id[2]. a has lost in id[2]. SOF and id[0..3] are five
    dominant bits then, and the next one is no stuff bit: no node has ever sent 000."""
    events = run(tmp_path, "{ name: a, traffic: [ { send: 100#00, offset: 100bit } ] }, "
                           "{ name: b }, { name: c }", "{ raw: 200#00, as: c, mac: off }", *flags)
    lost = of(events, "a", "arbitration-lost")[0]
    assert lost["bit"] == 2 and round(lost["t"] * 5e5) == 104
    for node in "a", "b":
        error = of(events, node, "error")[0]
        assert (error["type"], error["role"], error["field"], error["index"], error["stuff"]) == \
            ("stuff", "rx", "id", 3, True)
        assert round(error["t"] * 5e5) == 106
    assert not of(events, "c", "error") and len(of(events, "a", "tx")) == 1


def test_raw_acts_for_each_hit(tmp_path):
    (tmp_path / "t.yaml").write_text(
        "bus: { name: t, bitrate: 500000 }\n"
        "nodes: [ { name: a }, { name: b, traffic: [ { send: 100#, every: 1ms, count: 3 } ] }, "
        "{ name: c } ]\n"
        "faults:\n"
        "  - { name: one, when: { frame: '100', hold-off: 900us }, do: { raw: 001#, as: a } }\n"
        "  - name: two\n    when: { after: { rule: one, delay: 500us } }\n"
        "    do: { raw: 002#, as: a, mac: off }\n")
    lines = sim(tmp_path / "t.yaml", "--until", "4ms", "--events", "-").stdout.splitlines()
    events = [json.loads(line) for line in lines]
    assert [e["frame"] for e in of(events, "a", "tx")] == 3 * ["001#"]
    assert [e["frame"] for e in of(events, "c", "rx")] == 3 * ["001#", "100#", "002#"]
    assert [e["hit"] for e in events if e.get("rule") == "two"] == [1, 2, 3]
    assert not [e for e in events if e["event"] == "error"]
