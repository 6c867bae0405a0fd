# SPDX-License-Identifier: MIT
"""canwire campaign: what is wrong in a file is said before any row runs, with its place."""

import pytest

from test_campaign import BUS, campaign, fixture_no_shard, rows_of

pytestmark = pytest.mark.kept

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
    "{ set: faults.hit.do.flip, values: [ sof ] }", "{ set: bus.bitrate, values: [ 250000 ] }",
    "{ each-bit: { frame: 123#, at: dash } }",
])
def test_a_scenario_that_no_factor_ends(complaint, factor):
    found = complaint(f"vary:\n  - {factor}\nscenario: bus.yaml\n", ENDLESS)
    assert found == "bus.yaml:5:16: traffic without `count` never ends: give `until` in the " \
        "campaign\n"


@pytest.mark.parametrize("factor", [
    "{ set: \"nodes.engine.traffic[0].count\", values: [ 2 ] }",
    "{ set: nodes.engine.traffic, values: [ [ { send: 123#, every: 1ms, count: 2 } ] ] }",
    "{ set: \"nodes[0]\", values: [ { name: e, traffic: [ { send: 1FF# }, { send: 1FE# } ] } ] }",
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


# ---- paths ---------------------------------------------------------------------------------------

KEY = "expected a key, or the name of an item: letters, digits, '_' and '-' at character"
ITEM = "expected the number of an item, such as [0] or [12] at character"
END = "expected '.', '[' or the end at character"


@pytest.mark.parametrize("path, message", [
    ("a..b", f"{KEY} 3"), (".bus", f"{KEY} 1"), ("bus.", f"{KEY} 5"), ("nodes.[0]", f"{KEY} 7"),
    ("[0]", f"{KEY} 1"), ("bus bitrate", f"{END} 4"), ("bus.bit rate", f"{END} 8"),
    (" bus", f"{KEY} 1"), ("bus ", f"{END} 4"), ("nodes[01].ppm", f"{ITEM} 6"),
    ("nodes[].ppm", f"{ITEM} 6"), ("nodes[ 1].ppm", f"{ITEM} 6"), ("nodes[+1].ppm", f"{ITEM} 6"),
    ("nodes[1", f"{ITEM} 6"), ("nodes[1]ppm", f"{END} 9"), ("nodes[a].ppm", f"{ITEM} 6"),
    ("bus.{x}", f"{KEY} 5"), ("bus.x: y", f"{END} 6"), ("bus.\u00e4", f"{KEY} 5"),
    ("x" * 128, "a key has at most 127 characters at character 1"),
    ("nodes[99999999999999999999].ppm", "the scenario has no '99999999999999999999' there"),
    ("nodes[3].ppm", "the scenario has no '3' there"), ("bus[0]", "the scenario has no '0' there"),
    ("nodes.dash.ppm.x", "the scenario has no 'ppm' there"),
    ("bus.name.x", "the scenario has no 'x' there"),
    ("nodes.dash.ppn", "unknown key 'ppn' (did you mean 'ppm'?)"),
    ("sed", "unknown key 'sed' (did you mean 'seed'?)"),
])
def test_paths(complaint, path, message):
    found = complaint(f"scenario: bus.yaml\nvary:\n  - {{ set: \"{path}\", values: [ 1 ] }}\n")
    column = 5 if "unknown" in message else 12
    assert found.startswith(f"3:{column}: set: '{path}': {message}") and found.count("\n") == 1


# ---- names ---------------------------------------------------------------------------------------

@pytest.mark.parametrize("factors, message", [
    (["name: hit, each-bit: { frame: 123#, at: dash }"],
     "3:5: the scenario has a rule 'hit'; this space of faults needs another 'name'"),
    (["name: hi, pairs-of-bits: { frame: 123#, at: dash, field: crc }",
      "name: hi.2, each-bit: { frame: 123#, at: dash }"],
     "4:5: 'hi' has a rule 'hi.2', too; this space of faults needs another 'name'"),
    (["each-bit: { frame: 123#, at: dash }", "each-bit: { frame: 123#, at: dash }"],
     "4:5: duplicate factor 'each-bit'\n4:5: 'each-bit' has a rule 'each-bit', too; this space of "
     "faults needs another 'name'"),
])
def test_names_of_rules_that_are_there(complaint, factors, message):
    found = complaint("scenario: bus.yaml\nvary:\n" +
                      "".join(f"  - {{ {factor} }}\n" for factor in factors))
    assert found == message + "\n"


def test_a_rule_of_a_profile_is_there_too(complaint, write):
    write("parameters: { victim: ~ }\nfaults: [ { name: deaf, when: { frame: 123 }, "
          "do: { flip: sof, at: $victim } } ]\n", "profile.yaml")
    profile = "profiles: [ { file: profile.yaml, with: { victim: dash } } ]\n"
    found = complaint("scenario: bus.yaml\nvary:\n  - { name: deaf, each-bit: { frame: 123# } }\n",
                      BUS + profile)
    assert found.startswith("3:5: the scenario has a rule 'deaf'")


# ---- sizes ---------------------------------------------------------------------------------------

def bomb(levels, width):
    """A value with width ** levels words, in a few lines."""
    lines = ["   - &v0 [ x ]"]
    lines += [f"   - &v{i} [ {', '.join([f'*v{i - 1}'] * width)} ]" for i in range(1, levels + 1)]
    return "\n".join(lines)


def test_aliases_are_not_written_out_without_end(complaint):
    text = f"scenario: bus.yaml\nvary:\n - set: nodes.dash.queue\n   values:\n{bomb(9, 10)}\n"
    found = complaint(text)
    assert "12:6: this value is too large: one has up to 1 MiB, and all of a file 64 MiB" in found
    loop = "scenario: bus.yaml\nvary:\n - { set: bus.bitrate, values: [ &v [ *v ] ] }\n"
    assert complaint(loop) == "3:34: this value is nested too deeply\n"


def test_a_value_is_never_cut_short(complaint):
    text = 'scenario: bus.yaml\nvary:\n - { set: bus.name, values: [ "a", "b\\0c" ] }\n'
    assert complaint(text) == "3:36: NUL characters are not allowed\n"


def test_all_values_of_a_file_have_a_limit(write):
    write(BUS)
    for count, status in (60, 0), (200, 1):
        text = "scenario: bus.yaml\nvary:\n - set: nodes.dash.queue\n   values:\n" \
            f"{bomb(5, 10)}\n" + count * "   - *v5\n"
        found = campaign("show", write(text, "campaign.yaml"), "0", status=status).stderr
        assert ("this value is too large" in found) == (status == 1)


@pytest.mark.figures
def test_a_space_of_faults_has_a_limit(write):
    frames = ", ".join(f"{{ send: '{i:03X}##0{'5A' * 64}' }}" for i in range(1, 9))
    bus = "bus: { name: b, bitrate: 500000, dbitrate: 2000000 }\nnodes:\n" \
        f"  - {{ name: e, traffic: [ {frames} ] }}\n  - name: dash\n"
    write(bus)
    file = write("scenario: bus.yaml\nvary:\n  - { pairs-of-bits: { from: e, at: dash } }\n",
                 "campaign.yaml")
    assert campaign("show", file, "0", status=1).stderr == \
        f"{file}:3:22: a factor has at most 1000000 values\n"
