#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The JSON schema for editors and the loader (`canwire check`) agree.

They agree on all files of tests/config, config and config/profiles, and on thousands of files that
differ from the good ones in one place. SEMANTIC lists errors that only the loader can find (missing
names, duplicates). A bad file with no other errors says "only the loader" in a comment.

Scalars are read as by the loader, which ignores quotes. A number is any decimal integer without
sign and leading 0. So a pattern of the schema applies to the written text, numbers included, and
`on` is no boolean as it was in YAML 1.1.
"""

import json
import random
import re
import subprocess

import jsonschema
import pytest
import yaml

from depth import DEEP
from simtool import CANWIRE, ROOT, SCHEMAS, TIMEOUT_S

CONFIG = ROOT / "tests/config"
GOOD = sorted([*CONFIG.glob("good/*.yaml"), *CONFIG.glob("profiles/[nt]*.yaml"),
               *ROOT.glob("config/profiles/*.yaml"), *ROOT.glob("config/*.yaml")])
BAD = sorted(CONFIG.glob("bad/*.yaml"))
SCHEMA = json.loads((SCHEMAS / "canwire.schema.json").read_text())
MUTANTS_MAX = 150  # of one file; drawn with a fixed seed
MUTANTS_RUN = 150 if DEEP else 40  # the first of them
DEPTH_MAX = 40

# Errors that the loader finds and the schema cannot.
SEMANTIC = [
    "there is no node", "profiles: there is no", "there is no rule", "duplicate",
    "cannot come after itself",
    "is too long for one",
    "is in the list twice", "is in the map twice", "is named twice", "nothing is separated",
    "wait for the same states", "another node", "needs a frame on the bus",
    "a pulse in a frame needs a position",
    "error frames (#MASK)", "for error frames (#MASK), not for both", "more frame filters than fit",
    "within 0.1 %", "whole nanoseconds", "too large", "window must end after", "No such file",
    "cannot read", "profiles: there are errors", "no fault profile", "has no parameter",
    "of the profile needs a value", "there is no parameter", "has more than 63 characters",
    "No such file", "neither beside", "not a regular file", "this is neither",
    "there is no time stamp",
    "expected a line of candump", "expected an event such as", "at most as long as 'every'",
    "at most 107 bytes", "merge keys", "expected a size from", "$$ stands for a dollar",
    "error frames (bit 20000000)",
    "would be", "5 % are allowed", "has no segments", "100kHz to 1GHz", "a length of at most 10km",
    "in whole", "no edge is under way", "lasts between", "no delay and no way", "at most 100ns/m",
    "as the configuration has none of them", "too long or too short for this bus",
    "a classical node has none", "only a node of kind fd", "only tdc-mode manual",
    "tdcv is missing",
    "tdc-mode is off", "knows no CAN FD", "the bus has no data rate", "none is of kind fd",
    "the data phase is not slower", "tdco and tdcv together",
    "with an IPv4 address has one",
    "has clients", "a bus has at most 64 nodes", "is the name of the node in line",
    "the nodes of one rule have", "min is more than max", "does not get its own frames",
    "but the bus is classical", "as the bus is classical", "knows classical frames only",
    "which begins the next basic cycle", "before the one of line", "does not divide",
    "there is no cycle", "in which cycle-byte puts", "bits of local-time can count",
    "goes in each basic cycle",
    "has a schedule, which needs it", "needs local-time", "needs time-triggered", "a counter of",
    "lasts 13ns to 1s", "a slot lasts a unit",
    "counter: the key 'at' is missing", "the counter ends at", "the checksum needs byte",
    "bits have at most", "as 'max' says", "the counter is in the checksum", "the counter of 'e2e-",
    "at most 0xFFF", "it is half a byte", "counter or checksum are at", "data bytes, no",
    "both need the same 'counter'", "no traffic that the rule waits for",
    "must be those of a frame",
]


class Integer(int):
    """A number with its written form."""


class Decimal(float):
    """A number with its written form, which has a fraction or an exponent."""


def convert(node, depth=0):
    """Converts a YAML node for JSON schema; of duplicate keys the last one counts."""
    assert depth < DEPTH_MAX, "a cycle"
    if isinstance(node, yaml.MappingNode):
        return {key.value if isinstance(key, yaml.ScalarNode) else "?": convert(value, depth + 1)
                for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [convert(value, depth + 1) for value in node.value]
    return scalar(node.value, node.style is None)


def scalar(text, plain):
    if plain and text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if re.fullmatch("0|[1-9][0-9]*", text):
        result = Integer(text)
    elif re.fullmatch(r"-?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]+)?", text):
        result = Decimal(text)
    else:
        return text
    result.text = text
    return result


def check_pattern(validator, pattern, instance, schema):
    del validator, schema
    text = getattr(instance, "text", instance)
    if isinstance(text, str) and not re.search(pattern, text):
        yield jsonschema.ValidationError(f"{text!r} does not match {pattern!r}")


def is_integer(checker, instance):
    del checker
    return isinstance(instance, Integer)


Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator, {"pattern": check_pattern},
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine("integer", is_integer))
VALIDATOR = Validator(SCHEMA)


def compose(text):
    return yaml.compose(text, Loader=yaml.BaseLoader)


def schema_accepts(node):
    try:
        return VALIDATOR.is_valid(convert(node))
    except AssertionError:
        return True  # not for a schema to see


def loader_errors(path):
    result = subprocess.run([CANWIRE, "check", path], capture_output=True, text=True,
                            timeout=TIMEOUT_S, check=False)
    errors = [line for line in result.stderr.splitlines() if ": warning: " not in line]
    assert result.returncode == (1 if errors else 0), result
    return errors


def relative(path):
    return str(path.relative_to(ROOT))


def test_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("path", GOOD, ids=relative)
def test_good_files_are_good_for_both(path):
    assert loader_errors(path) == []
    VALIDATOR.validate(convert(compose(path.read_text())))


@pytest.mark.parametrize("path", BAD, ids=relative)
def test_bad_files_are_bad_for_both(path):
    text = path.read_text()
    assert loader_errors(path) != []
    try:
        node = compose(text)
    except yaml.YAMLError:
        return  # no YAML at all
    if node is None:
        return  # no document
    assert schema_accepts(node) == ("only the loader" in text)


def test_examples_of_the_reference_are_good(tmp_path):
    text = (ROOT / "daemon/man/canwire-faults.7.md").read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    rules = [line for block in blocks for line in block.splitlines() if line.startswith("- { name")]
    assert len(rules) > 15
    nodes = ", ".join(f"{{ name: {name} }}" for name in ("engine", "gearbox", "dash", "load"))
    path = tmp_path / "examples.yaml"
    path.write_text("bus: { bitrate: 500000 }\nnodes: [ " + nodes + " ]\nfaults:\n"
                    + "\n".join("  " + rule for rule in rules))
    assert loader_errors(path) == []
    VALIDATOR.validate(convert(compose(path.read_text())))


PLAIN = jsonschema.Draft202012Validator(SCHEMA)  # as an editor has it


def editor_accepts(text):
    return PLAIN.is_valid(json.loads(json.dumps(yaml.safe_load(text))))


@pytest.mark.parametrize("node, good", [
    ("queue: 16", True), ("queue: '16'", True), ("queue: '016'", False), ("queue: '0x10'", False),
    ("queue: '16.0'", False), ("queue: '0'", False), ("queue: '4096'", True),
    ("queue: 16.5", False), ("queue: '4097'", False), ("queue: 4097", False),
    ("one-shot: 'true'", True),
    ("traffic: [ { send: 123#11, every: 10 } ]", False), ("ppm: 100001", False),
    ("traffic: [ { send: 123#11, every: 10ms } ]", True),
    ("traffic: [ { send: 123#11, every: 10ms, offset: 0 } ]", True),
    ("sample-point: 0.875", True), ("sample-point: 87.5", False), ("ppm: -5", True),
])
def test_an_editor_judges_as_the_loader_does(tmp_path, node, good):
    """It knows the value and not how it is written: 0x10 and 16.0 are 16 there, and only the loader
    refuses them."""
    text = f"bus: {{ bitrate: 500000 }}\nnodes: [ {{ name: a, {node} }}, {{ name: true }} ]\n"
    (tmp_path / "bus.yaml").write_text(text)
    errors = loader_errors(tmp_path / "bus.yaml")
    assert (not errors) == good, errors
    assert editor_accepts(text) == good


@pytest.mark.parametrize("more, good", [
    ("pacing: virtual", False), ("pacing: virtual\ncontrol: a.sock", True),
    ("pacing: virtual\nvirtual: { socket: a.time }", True),
    ("pacing: virtual\nvirtual: { programs: 2 }", False),
    ("control: a.sock\nvirtual: { programs: 2 }", False),
])
def test_virtual_time_needs_a_socket(tmp_path, more, good):
    text = f"bus: {{ bitrate: 500000 }}\nnodes: [ {{ name: a }} ]\n{more}\n"
    (tmp_path / "bus.yaml").write_text(text)
    assert (not loader_errors(tmp_path / "bus.yaml")) == good
    assert editor_accepts(text) == good


def test_patterns_of_whole_numbers():
    """Those of all ranges of numbers, at and around their limits."""
    found = 0
    for low, high, pattern in number_ranges(SCHEMA):
        found += 1
        powers = [10 ** n + d for n in range(21) for d in (-1, 0, 1)]
        around = [low, low + 1, high, high - 1, high + 1, (low + high) // 2, max(low - 1, 0)]
        for number in (*powers, *around, *range(200)):
            fits = re.search(pattern, str(number)) is not None
            assert fits == (low <= number <= high), (number, pattern)
    assert found > 50


def number_ranges(schema):
    if isinstance(schema, dict):
        if schema.get("type") == ["integer", "string"]:
            yield schema["minimum"], schema["maximum"], schema["pattern"]
        schema = list(schema.values())
    if isinstance(schema, list):
        for each in schema:
            yield from number_ranges(each)


# ---- Files that differ in one place --------------------------------------------------------------

REPLACEMENTS = ["", "-1", "x y", "0", "1.5", "0500", "99999999999999999999", "on", "dominant", "tx",
                "123", "12345678", "crc[15]", "10ms", "2s..5s", "60%", "123#11", "#4", "$", "1e-5"]


def write(node):
    """Returns the node as YAML again, on one line."""
    if isinstance(node, yaml.MappingNode):
        return "{" + ", ".join(f"{write(k)}: {write(v)}" for k, v in node.value) + "}"
    if isinstance(node, yaml.SequenceNode):
        return "[" + ", ".join(map(write, node.value)) + "]"
    plain = node.style is None
    return "~" if scalar(node.value, plain) is None else json.dumps(node.value)


def text_node(text):
    return yaml.ScalarNode("tag:yaml.org,2002:str", text, style='"')


def places(node):
    """Each change that can be made in a tree: the list of a node, and what it becomes.

    Only the loader knows the meaning of a parameter, so that values of parameters stay
    unchanged."""
    if isinstance(node, yaml.MappingNode):
        yield from map_changes(node)
        for i, (key, value) in enumerate(node.value):
            if key.value in ("parameters", "with"):
                continue
            yield from value_changes(node.value, i, lambda new, key=key: (key, new))
            yield from places(value)
    elif isinstance(node, yaml.SequenceNode):
        yield node.value, []
        for i, value in enumerate(node.value):
            yield node.value, node.value[:i] + node.value[i + 1:]
            yield from value_changes(node.value, i, lambda new: new)
            yield from places(value)


def map_changes(node):
    yield node.value, node.value + [(text_node("unknown"), text_node("x"))]
    for i in range(len(node.value)):
        yield node.value, node.value[:i] + node.value[i + 1:]


def value_changes(items, i, make):
    others = [text_node(text) for text in REPLACEMENTS]
    others += [yaml.SequenceNode("", []), yaml.MappingNode("", []),
               yaml.ScalarNode("", "", style=None)]
    for other in others:
        yield items, items[:i] + [make(other)] + items[i + 1:]


def is_allowed(changed):
    """Returns False for a parameter outside of profiles: the schema accepts it, since profiles use
    the same one."""
    return not any(item.value == "$" for pair in changed
                   for item in (pair if isinstance(pair, tuple) else [pair]))


def mutants(path):
    """Texts that differ from a file in one place."""
    root = compose(path.read_text())
    is_profile = all(key.value != "bus" for key, _ in root.value)
    changes = [(items, changed) for items, changed in places(root)
               if is_profile or is_allowed(changed)]
    chosen = random.Random(path.name).sample(changes, min(MUTANTS_MAX, len(changes)))
    for items, changed in chosen[:MUTANTS_RUN]:
        before = items[:]
        items[:] = changed
        yield write(root)
        items[:] = before


def is_semantic(line):
    return any(known in line for known in SEMANTIC)


def disagreement(path, text):
    path.write_text(text)
    errors = loader_errors(path)
    accepted = schema_accepts(compose(text))
    if errors and accepted and not all(is_semantic(line) for line in errors):
        return f"only the loader refuses: {text[:2000]}\n" + "\n".join(errors)
    if not errors and not accepted:
        return f"only the schema refuses: {text[:2000]}"
    return None


def beside_its_files(path, tmp_path):
    """Makes a place for a file in which the names of path's files are valid, `../..` included, by
    links. Nothing is written where other tests read."""
    here, there = ROOT, tmp_path
    for part in path.relative_to(ROOT).parts[:-1]:
        link_all(here, there, part)
        here, there = here / part, there / part
        there.mkdir()
    link_all(here, there, path.name)
    return there / path.name


def link_all(here, there, but):
    for each in here.iterdir():
        if each.name != but and not each.name.startswith("."):
            (there / each.name).symlink_to(each)


@pytest.mark.parametrize("path", GOOD, ids=relative)
def test_files_that_differ_in_one_place_are_judged_alike(path, tmp_path):
    if "cycle" in path.name or "aliases" in path.name:
        pytest.skip("aliases are not written back")
    mutant = beside_its_files(path, tmp_path)
    found = [d for d in (disagreement(mutant, text) for text in mutants(path)) if d]
    assert not found, f"{len(found)} disagreements, first:\n{found[0]}"


# ---- Keys of JSON --------------------------------------------------------------------------------

DEPRECATED = {"when_full", "local_time"}  # beside the new ones
COUNTERS = {"arbitration_lost", "bus_off"}  # events of these names are keys of a configuration
NO_KEYS = {"canwire-journal"}  # the first word of a file


def keys_of(schema):
    """Returns all keys that a schema allows anywhere."""
    if isinstance(schema, list):
        return set().union(*map(keys_of, schema))
    if not isinstance(schema, dict):
        return set()
    return set(schema.get("properties", ())).union(*map(keys_of, schema.values()))


def test_keys_of_json_follow_one_rule():
    """Those of a configuration as there, with hyphens; all others with underscores. See
    canwire-control(7)."""
    configured = set().union(*(keys_of(json.loads(path.read_text()))
                               for path in SCHEMAS.glob("*.json")))
    sources = "".join(path.read_text() for path in ROOT.glob("daemon/**/*.[ch]")
                      if path.name != "timing_table.c")  # it has the words of `ip link`
    writers = r"\b(?:put(?:_[a-z]+)*|AT_[A-Z]+|jsontext_[a-z]+)"
    found = set(re.findall(writers + r'\([^"();]*?"([\w-]+)"', sources)) | \
        set(re.findall(r'\\"([a-z][\w-]*)\\":', sources)) | \
        set(re.findall(r"\bX\(\w+, \w+, (\w+)", (ROOT / "lib/canwire_counters.h").read_text()))
    assert len(found) > 300 and DEPRECATED < found
    assert {key for key in found if "_" in key and key.replace("_", "-") in configured} == \
        DEPRECATED | COUNTERS
    assert {key for key in found if "-" in key and key not in configured} == NO_KEYS
    assert {key.replace("_", "-") for key in DEPRECATED} < found
