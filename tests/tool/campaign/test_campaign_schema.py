# SPDX-License-Identifier: MIT
"""The JSON schema of campaigns and their reader agree, on files that differ in one place.

See test_schema.py, which does so for configurations. SEMANTIC lists what only the reader can find.
"""

import json
import subprocess

import jsonschema
import pytest
import yaml

import test_schema
from depth import some
from simtool import CANWIRE, SCHEMAS, TIMEOUT_S
from test_campaign import BUS

SCHEMA = json.loads((SCHEMAS / "canwire-campaign.schema.json").read_text())
VALIDATOR = test_schema.Validator(SCHEMA)
INLINE = """scenario:
  bus: { name: b, bitrate: 500000 }
  nodes: [ { name: engine, traffic: [ { send: 123#11, every: 10ms } ] }, { name: gearbox } ]
until: 25ms
limit: 1.5s
seed: 7
"""
FACTORS = {
    "values": "{ name: v, set: bus.bitrate, values: [ 250000, 500000 ] }",
    "range": "{ set: nodes.engine.queue, range: { from: 1, to: 5, step: 2 } }",
    "uniform": "{ set: nodes.engine.ppm, uniform: { from: -5, to: 5.5, step: 0.5, draws: 3 } }",
    "normal": "{ set: \"nodes[0].traffic[0].offset\", "
              "normal: { mean: 5ms, deviation: 1ms, step: 1ms, draws: 2 } }",
    "positions": "{ set: faults.hit.do.flip, frame: 123#11, positions: [ \"crc[3]\", eof.* ] }",
    "nodes": "{ set: faults.hit.do.at, nodes: [ gearbox ] }",
    "each-bit": "{ each-bit: { frame: 123#11, from: engine, at: [ gearbox ], skip: 1 } }",
    "pairs-of-bits": "{ name: p, pairs-of-bits: { frame: 123#11, at: gearbox, field: crc } }",
}
SAMPLES = ["full", "pairwise", "{ random: 5 }", "{ low-discrepancy: 5 }"]
FILE = "scenario: bus.yaml\nvary: [ "

# Errors that the reader finds and the schema cannot, about the scenario and about other keys.
SEMANTIC = [
    "has no '", "expected a key, or the name", "expected '.', '['", "expected the number of an",
    "the numbers have different units", "'step' is more than 0", "'to' is below 'from'",
    "'deviation' is not below 0", "'draws' says how many", "all its values are pruned",
    "expected a position, or several", "unknown key", "there are errors in the scenario",
    "has no node '", "it needs 'frame', or 'from'", "expected 'set', the path", "has no 'set'",
    "the node of 'from' sends no frames", "the frame has no two bits", "'field' is for pairs",
    "duplicate factor", "No such file", "not a regular file", "up to 15 digits", "never ends",
    "seeds are whole numbers", "the full product has more", "the scenario has a rule",
    "for this bus", "is part of what", "within 0.1 %", "pairwise is for factors", "is twice",
    "expected a real time from 1s to 24h", "the frame has no more than",
]


@pytest.fixture(name="judge")
def fixture_judge(tmp_path):
    """judge(text) tells how schema and reader differ about a campaign, or None."""
    (tmp_path / "bus.yaml").write_text(BUS)
    path = tmp_path / "campaign.yaml"

    def judge(text):
        path.write_text(text)
        result = subprocess.run([CANWIRE, "campaign", "show", path, "0"], capture_output=True,
                                text=True, timeout=TIMEOUT_S, check=False)
        errors = result.stderr.splitlines()
        assert result.returncode == (1 if errors else 0), result
        accepted = VALIDATOR.is_valid(test_schema.convert(test_schema.compose(text)))
        if accepted and errors and not any(each in line for line in errors for each in SEMANTIC):
            return f"only the reader refuses {text}\n{errors}"
        if not accepted and not errors:
            return f"only the schema refuses {text}"
        return None
    return judge


def texts():
    yield from (INLINE + f"sample: {sample}\nvary: [ {FACTORS['range']} ]\n" for sample in SAMPLES)
    yield from (FILE + f"{factor} ]\n" for factor in FACTORS.values())


def changes(root):
    """Each change of a campaign; the scenario in it has a schema of its own."""
    for key, value in root.value:
        if key.value == "scenario" and isinstance(value, yaml.MappingNode):
            continue
        yield from test_schema.value_changes(
            root.value, root.value.index((key, value)), lambda new, key=key: (key, new))
        yield from test_schema.places(value)
    yield from test_schema.map_changes(root)


@pytest.mark.parametrize("text", list(texts()), ids=[*SAMPLES, *FACTORS])
def test_files_that_differ_in_one_place_are_judged_alike(judge, text):
    assert judge(text) is None
    root = test_schema.compose(text)
    found = []
    for items, changed in some(changes(root), 4):
        before = items[:]
        items[:] = changed
        found.append(judge(test_schema.write(root)))
        items[:] = before
    found = [each for each in found if each]
    assert not found, f"{len(found)} disagreements, first:\n{found[:40]}"


# (a line, is it good, does the schema know that)
@pytest.mark.parametrize("line, good, known", [
    ("limit: 1s", True, True), ("limit: 999ms", False, True), ("limit: 1000ms", True, True),
    ("limit: 0.5s", False, True), ("limit: 999999.9us", False, True), ("limit: 24h", True, True),
    ("limit: 1440min", True, True), ("limit: 24.5h", False, False), ("limit: 86401s", False, False),
    ("limit: 0s", False, True), ("limit: 100bit", False, True), ("limit: 0", False, True),
    ("limit: 1000000000ns", True, True), ("limit: 00001s", False, True),
    ("limit: 0.01min", False, False), ("limit: 0.02min", True, True),
    ("sample: { random: 0 }", False, True), ("sample: { random: 281474976710656 }", True, True),
    ("sample: { random: 281474976710657 }", False, True), ("sample: {}", False, True),
    ("sample: { random: 1, low-discrepancy: 1 }", False, True), ("sample: half", False, True),
    ("seed: 18446744073709551615", True, True), ("seed: 18446744073709551616", False, True),
    ("seed: -1", False, True), ("until: 0", True, True), ("until: 5bit", True, True),
    ("until: 5", False, True), ("until: 1.5ms", True, True), ("until: 01ms", False, True),
])
def test_limits_of_values(judge, line, good, known):
    text = FILE + f"{FACTORS['range']} ]\n{line}\n"
    assert judge(text) is None
    accepted = VALIDATOR.is_valid(test_schema.convert(test_schema.compose(text)))
    assert accepted == (good or not known)


@pytest.mark.parametrize("position, good", [
    ("sof", True), ("crc[3]", True), ("crc[0..14]", True), ("data[0..7].*", True), ("crc.*", True),
    ("data.*", True), ("data[2.7]", True), ("ack-slot", True), ("x y", False), ("on", False),
    ("crc[", False), ("crc[a]", False), ("10ms", False), ("crc[3].", False), ("*", False),
])
def test_positions(judge, position, good):
    text = FILE + f"{{ set: faults.hit.do.flip, positions: \"{position}\" }} ]\n"
    assert judge(text) is None
    assert VALIDATOR.is_valid(test_schema.convert(test_schema.compose(text))) == good


def test_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
