# SPDX-License-Identifier: MIT
"""canwire campaign: what is wrong in a file is said before any row runs, with its place."""

import pytest

from test_campaign import BUS, campaign, fixture_no_shard, rows_of

__all__ = ["fixture_no_shard"]
ENDLESS = BUS.replace(", count: 3", "")
RIG = "buses: [ bus.yaml, other.yaml ]\ngateways: []\n"


@pytest.fixture(name="complaint")
def fixture_complaint(write):
    """complaint(text, bus) is the message about a campaign, without the name of its file."""
    def complain(text, bus=BUS):
        write(bus)
        file = write(text, "campaign.yaml")
        found = {campaign(*words, status=1).stderr
                 for words in (["plan", file], ["run", file], ["show", file, "0"])}
        assert len(found) == 1  # no row has run
        return found.pop().replace(f"{file.parent}/", "").replace("campaign.yaml:", "")
    return complain


# ---- the end of a scenario -----------------------------------------------------------------------

@pytest.mark.parametrize("factor", [
    "{ set: seed, values: [ 1 ] }", "{ set: nodes.dash.ppm, values: [ 1 ] }",
    "{ set: faults.hit.do.flip, values: [ \"crc[2]\" ] }", "{ set: bus.bitrate, values: [ 250000 ] }",
    "{ each-bit: { frame: 123#, at: dash } }",
])
def test_a_scenario_that_no_factor_ends(complaint, factor):
    found = complaint(f"vary:\n  - {factor}\nscenario: bus.yaml\n", ENDLESS)
    assert found == "bus.yaml:5:16: traffic without `count` never ends: give `until` in the campaign\n"


@pytest.mark.parametrize("factor", [
    "{ set: \"nodes.engine.traffic[0].count\", values: [ 2 ] }",
    "{ set: nodes.engine.traffic, values: [ [ { send: 123#, every: 1ms, count: 2 } ] ] }",
    "{ set: \"nodes[0]\", values: [ { name: engine, traffic: [ { send: 1FF# }, { send: 1FE# } ] } ] }",
    "{ set: nodes, values: [ [ { name: engine, traffic: [ { send: 1FF# }, { send: 1FE# } ] }, "
    "{ name: dash } ] ] }",
])
def test_a_scenario_that_a_factor_ends(write, factor):
    write(ENDLESS.split("faults:", maxsplit=1)[0])
    file = write(f"scenario: bus.yaml\nvary:\n  - {factor}\n", "campaign.yaml")
    assert [row["frames"] for row in rows_of(campaign("run", file).stdout)] == [2]


def test_a_rig_without_an_end(complaint, write):
    write(ENDLESS.replace("powertrain", "body"), "other.yaml")
    write(RIG, "rig.yaml")
    factor = "vary: [ { set: seed, values: [ 1 ] } ]\n"
    found = complaint(f"scenario: rig.yaml\n{factor}")
    assert found == "other.yaml:5:16: traffic without `count` never ends: give `until` in the " \
        "campaign\n"
    found = complaint(f"scenario: rig.yaml\nuntil: 100bit\n{factor}")
    assert found == "2:8: until: a rig has bits of several lengths; give a time such as 10ms\n"
