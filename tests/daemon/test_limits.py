# SPDX-License-Identifier: MIT
"""All that read a configuration tell at its place what the library does not take.

cw_bus_check() is the one judge. "out of memory" is for the want of memory alone.
"""

import subprocess

import pytest
from canwire import Bus, ConfigError

from busrig import BusRig, rig_fixture
from simtool import CANWIRED, TIMEOUT_S, canwire

BUS = """bus: {{ name: limits, {bus} }}
control: limits.sock
nodes:
  - {{ name: a{a} }}
  - {{ name: b{b} }}
"""
GOOD = {"bus": "bitrate: 125000, dbitrate: 8000000", "a": "", "b": ""}
BIT = "a bit of a node in the data phase lasts between 1/64 and 64 bits of the bus: it lasts "
WAY = "no edge is under way for longer than 16 of the shortest bits, but those from 'a' are: "
CASES = [
    (dict(GOOD, a=", ppm: 1"),
     f"4:21: {BIT}124.999 ns, expected at least 125 ns"),
    (dict(GOOD, a=", tx-delay: 1001ns", b=", rx-delay: 1us"),
     f"5:26: {WAY}2001 ns, expected at most 2000 ns"),
]
LEAST = dict(GOOD, a=", ppm: 0, tx-delay: 1us", b=", rx-delay: 1us")


class Rig(BusRig):
    TEXT, CONTROL, VALUES = BUS, "limits.sock", GOOD


fixture_rig = rig_fixture(Rig)


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    def write(values, name="bus.yaml"):
        (tmp_path / name).write_text(BUS.format(**values))
        return tmp_path / name
    return write


@pytest.mark.parametrize("values, message", CASES)
def test_all_say_the_same(write, tmp_path, values, message):
    path = write(values)
    for words in (["check", path], ["sim", path], ["sim", path, "--seeds", "1..2"],
                  ["analyse", path]):
        assert canwire(*words, status=1).stderr == f"{path}:{message}\n", words
    daemon = subprocess.run([CANWIRED, "-c", path], cwd=tmp_path, capture_output=True, text=True,
                            timeout=TIMEOUT_S, check=False)
    assert (daemon.returncode, daemon.stderr) == (1, f"{path}:{message}\n")
    with pytest.raises(ConfigError) as raised:
        Bus(path)
    assert str(raised.value).strip() == f"{path}:{message}"


def test_all_take_what_is_at_the_limit(write):
    path = write(LEAST)
    canwire("check", path)
    canwire("sim", path)
    with Bus(path) as bus:
        assert bus.run("1ms")


@pytest.mark.parametrize("values, message", CASES)
def test_a_reload_says_it_and_changes_nothing(rig, values, message):
    r = rig()
    r.write(**values)
    refused = r.run("reload", "./limits.sock", status=1)
    assert f"bus.yaml:{message}" in refused.stderr
    r.write(**GOOD)
    r.run("reload", "./limits.sock")
    r.stop()


@pytest.mark.parametrize("more", [[], ["--reload"]])
def test_a_row_of_a_campaign_says_it(write, tmp_path, more):
    path = write(dict(GOOD, a=", ppm: 0"))
    campaign = tmp_path / "campaign.yaml"
    campaign.write_text("scenario: bus.yaml\nvary: [ { set: nodes.a.ppm, values: [ 0, 1 ] } ]\n")
    done = canwire("campaign", "run", campaign, *more, status=1)
    assert f"{path}:{CASES[0][1]}\n" in done.stderr and "1 passed, 1 invalid" in done.stderr
