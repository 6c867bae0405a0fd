# SPDX-License-Identifier: MIT
"""The shipped campaign config/wheel-speed: what canwire-wheel-speed(7) says of it is true.

All of it has a million rows; here are those that the page is about.
"""
import json
import pathlib
import re

import pytest
import yaml

from simtool import canwire

ROOT = pathlib.Path(__file__).resolve().parents[2]
CAMPAIGN = ROOT / "config/wheel-speed/campaign.yaml"
PAGE = (ROOT / "daemon/man/canwire-wheel-speed.7.md").read_text(encoding="utf-8")
CLASS = re.compile(r"^ *([a-z][a-z ]+[a-z]) +(\d+)  (\d+\.\d+) % \(.* %\)$", re.MULTILINE)
WORST = re.compile(r"^ *(\w[^,\n]*, .*?) +(\d+) +(\d+)  (\d+\.\d+) % \(.* %\)$", re.MULTILINE)
MODES = [("off", 20), ("off", 100), ("on", 20), ("on", 100)]


@pytest.fixture(name="make")
def fixture_make(write):
    """make(NAME=value or list, ...): the campaign with these values of factors only, and seed 1
    without others; its path."""
    def make(**chosen):
        text = yaml.load(CAMPAIGN.read_text(encoding="utf-8"), yaml.BaseLoader)
        text["scenario"] = str(CAMPAIGN.parent / text["scenario"])
        for factor in text["vary"]:
            name = factor.get("name", factor["set"]).replace("-", "_")
            values = chosen.pop(name, 1 if name == "seed" else None)
            if values is None:
                continue
            for key in "values", "range", "positions":
                factor.pop(key, None)
            factor["values"] = values if isinstance(values, list) else [values]
        assert not chosen
        return write(yaml.dump(text), "campaign.yaml")
    return make


@pytest.fixture(name="rows")
def fixture_rows(make):
    """rows(status, NAME=value or list, ...): the rows of such a campaign."""
    def rows(status, **chosen):
        out = canwire("campaign", "run", make(**chosen), status=status)
        return [json.loads(line) for line in out.stdout.splitlines()]
    return rows


def test_it_has_a_million_rows():
    plan = canwire("campaign", "plan", CAMPAIGN).stdout
    assert re.match(r"1003200 rows: the full product\n", plan), plan


def test_a_bit_that_is_wrong_once_never_makes_the_speed_stale(rows):
    """All bits of all frames, at each node and at all, in all modes."""
    found = rows(0, times=1)
    assert len(found) == 4 * 4 * 5 * 114
    assert {row["outcome"] for row in found} == {"passed"}
    assert sum(row["faults"] for row in found) > 0.9 * len(found)


def one(rows, status, one_shot="off", restart_ms=100, frame="0D0", at="wire", times=40,
        bit="data[0.0]"):
    row, = rows(status, one_shot=one_shot, restart_ms=restart_ms, frame=frame, at=at, times=times,
                bit=bit)
    return row


def gap_of(row):
    failed, = row["expectations"]["failed"]
    assert failed["name"] == "wheel speed at the dash"
    return float(re.match(r"at most ([0-9.]+)ms", failed["got"])[1])


def test_the_brakes_go_bus_off_when_they_repeat_a_frame(rows):
    """32 errors of a sender in a row are 256 in its error counter. Eight are left for later."""
    row = one(rows, 3)
    assert (row["nodes"]["brakes"]["bus_off"], row["faults"]) == (1, 40)
    assert gap_of(row) > 100
    row = one(rows, 0, restart_ms=20)
    assert (row["nodes"]["brakes"]["bus_off"], row["faults"]) == (1, 40)


@pytest.mark.parametrize("one_shot, restart_ms", MODES)
def test_sixteen_errors_are_repaired_by_repetition_alone(rows, one_shot, restart_ms):
    row = one(rows, 0 if one_shot == "off" else 3, one_shot, restart_ms, times=16)
    brakes = row["nodes"]["brakes"]
    assert brakes["bus_off"] == 0
    if one_shot == "off":
        assert (brakes["error_passive"], brakes["dropped"], brakes["retransmissions"]) == (1, 0, 16)
    else:
        assert brakes["retransmissions"] == 0 and gap_of(row) > 120


def test_a_dash_that_samples_wrong_is_left_alone(rows):
    """It becomes error-passive, and its flags then disturb nobody. Good frames of others bring it
    back, so that it disturbs one frame now and then."""
    row = one(rows, 3, at="dash")
    nodes = row["nodes"]
    assert nodes["dash"]["error_passive"] > 1
    assert nodes["brakes"]["bus_errors"] < nodes["dash"]["bus_errors"]
    # all others get each frame of the brakes
    sent = {name: node["tx_frames"] for name, node in nodes.items()}
    assert (sent["brakes"], nodes["brakes"]["bus_off"]) == (20, 0)
    assert nodes["engine"]["rx_frames"] == sent["brakes"] + sent["gateway"] + sent["dash"]
    assert nodes["dash"]["rx_frames"] < sent["brakes"] + sent["gateway"] + sent["engine"] - 10


@pytest.mark.parametrize("bit, stale", [("data[0.0]", False), ("ack-delimiter", True),
                                        ("eof[5]", True), ("eof[6]", False)])
def test_a_third_node_takes_the_brakes_off_the_bus_at_the_end_of_a_frame(rows, bit, stale):
    """It has acknowledged the frame, which takes it out of error-passive before the bit."""
    row = one(rows, 3 if stale else 0, at="engine", bit=bit)
    nodes = row["nodes"]
    assert (nodes["brakes"]["bus_off"], nodes["engine"]["bus_off"]) == (int(stale), 0)
    assert not stale or gap_of(row) > 100


@pytest.mark.parametrize("bit", ["id[3]", "id[4]", "stuff[0]"])
def test_a_sender_that_begins_anew_again_and_again_blocks_the_bus(rows, bit):
    """No error counter of a sender rises: it has lost the arbitration, or sees another level in a
    stuff bit of it."""
    row = one(rows, 3, frame="0C0", times=100000, bit=bit)
    assert row["nodes"]["engine"]["bus_off"] == 0
    assert row["faults"] > 500 and gap_of(row) > 50


def test_only_overload_frames_are_not_seen(rows):
    """Of the faults without an end. All others that make the speed stale have an error."""
    found = rows(3, one_shot="off", restart_ms=100, times=100000)
    stale = [row for row in found if row["outcome"] == "failed"]
    unseen = {row["factors"]["bit"] for row in stale if row["first_error"] is None}
    assert unseen == {"intermission[0]", "intermission[1]"}
    assert {row["factors"]["frame"] for row in stale if row["first_error"] is None} == {
        "0D0", "0C0", "3E0", "4A0"}
    assert all(row["latency"] is not None for row in stale if row["first_error"])


@pytest.mark.figures
@pytest.mark.deep
def test_the_report_is_as_it_is_shown(make, tmp_path):
    """The page has that of the whole campaign. One of the 22 seeds has the same shares, nearly."""
    shown = CLASS.findall(PAGE)
    assert len(shown) == 5 and sum(int(rows) for _, rows, _ in shown) == 1003200
    summary = re.search(r"1003200 rows: (\d+) passed, (\d+) failed", PAGE)
    assert int(summary[2]) == sum(int(rows) for name, rows, _ in shown if "failed" in name)
    out = tmp_path / "rows.ndjson"
    canwire("campaign", "run", make(), "--out", out, status=3)
    report = canwire("campaign", "report", out).stdout
    lines = report.splitlines()[:8]
    assert lines[0] == f"{tmp_path}/campaign.yaml: 45600 rows, 7 factors"
    assert re.search(r"^    " + re.escape(lines[2]) + "$", PAGE, re.MULTILINE)
    found = CLASS.findall("\n".join(lines))
    assert [name for name, _, _ in found] == [name for name, _, _ in shown]
    for (name, _, share), (_, _, wanted) in zip(found, shown):
        assert abs(float(share) - float(wanted)) < 2, name
    shown = WORST.findall(PAGE)
    assert len(shown) == 2  # the third one is another one with some seeds
    pairs = {name: (int(rows), float(share)) for name, rows, _, share in WORST.findall(report)}
    for name, every, _, about in shown:  # those with nearly the same shares may change places
        assert 22 * pairs[name][0] == int(every)
        assert abs(pairs[name][1] - float(about)) < 2, name
