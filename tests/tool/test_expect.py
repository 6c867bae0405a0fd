# SPDX-License-Identifier: MIT
"""`expect` in a scenario: the report of `canwire sim`, as text, JUnit XML and exit status.

Needs no CAN in the kernel. CANWIRE is the tool, by default build/release/canwire.
tests/unit/files/test_expect.c has the effects of events on each kind of expectation.
"""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from simtool import sim

# 100 frames; in every tenth one gearbox sees a wrong CRC bit, and the frame is repeated.
BUS = """
bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
    traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 100 } ]
  - name: gearbox
  - name: dash
faults:
  - name: bad-bit
    when: { frame: "123", count: 10, every: 10 }
    do: { flip: "crc[3]", at: gearbox }
expect:
"""

# Each with what must come of it. A clean frame takes 78 bits of 2 us.
OUTCOMES = [
    ("{ delivered: 100, to: [ gearbox, dash ], from: engine }", True),
    ("{ delivered: { min: 100 } }", True),
    ("{ delivered: { max: 99 } }", False),
    ("{ delay: { p50: 156us }, time: 1ms.. }", True),
    ("{ delay: 156us, time: 1ms.. }", False),
    ("{ delay: { max: 400us, p90: 160us } }", True),
    ("{ seen: yes, frame: 123, before: 179us }", False),  # the first attempt has the first fault
    ("{ seen: yes, frame: 123, before: 1ms }", True),
    ("{ seen: never, frame: 100~700 }", True),
    ("{ state: error-passive, node: [ engine, gearbox, dash ], reached: never }", True),
    ("{ state: error-passive, node: engine }", False),
    ("{ errors: 10, node: gearbox, type: crc }", True),
    ("{ errors: 0 }", False),
    ("{ drops: 0 }", True),
    ("{ faults: 10, rule: bad-bit }", True),
    ("{ load: { min: 15%, max: 20% } }", True),
    ("{ load: { max: 15% } }", False),
    ("{ errors: 0, time: 10s.. }", False),  # the run ends before
]


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    def write(*expectations):
        path = tmp_path / "bus.yaml"
        path.write_text(BUS + "".join(f"  - {line}\n" for line in expectations))
        return path

    return write


@pytest.mark.parametrize("expectation, met", OUTCOMES)
def test_outcome_is_exit_status(write, expectation, met):
    out = sim(write(expectation), status=0 if met else 3).stdout
    assert re.search(rf"^{'ok    ' if met else 'FAILED'} wanted .*, got ", out, re.M), out
    assert out.endswith(f"1 expectation, {int(met)} met, {int(not met)} failed\n")


def test_one_that_fails_is_enough(write):
    path = write(*[expectation for expectation, _ in OUTCOMES])
    lines = sim(path, status=3).stdout.splitlines()[-len(OUTCOMES) - 1:]
    assert [line.startswith("ok ") for line in lines[:-1]] == [met for _, met in OUTCOMES]
    failed = sum(not met for _, met in OUTCOMES)
    assert lines[-1] == f"18 expectations, {18 - failed} met, {failed} failed"


def test_steps_and_leaps_are_judged_alike(write):
    path = write(*[expectation for expectation, _ in OUTCOMES])
    assert sim(path, status=3).stdout == sim(path, "--step", status=3).stdout


def test_the_report_leaves_standard_output_to_what_was_asked_for(write):
    path = write("{ name: many, delivered: 100 }")
    result = sim(path, "--events", "-", status=0)
    assert result.stderr == (
        "ok     many: wanted 100 frames, got 100\n1 expectation, 1 met, 0 failed\n")
    assert all(line.startswith('{"t":') for line in result.stdout.splitlines())


def test_without_expectations_nothing_is_said(write):
    path = write()
    path.write_text(BUS.replace("expect:\n", ""))
    result = sim(path, status=0)
    assert "expectation" not in result.stdout and result.stderr == ""


def test_until_ends_what_is_judged(write):
    path = write("{ delivered: 10 }")
    sim(path, "--until", "9999us", status=0)
    sim(path, status=3)


def test_an_output_that_fails_is_status_one_all_the_same(write):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    assert "/dev/full" in sim(write("{ delivered: 1 }"), "--junit", "/dev/full", status=1).stderr


# ---- JUnit XML -----------------------------------------------------------------------------------

# Attributes that the schema of Jenkins' xUnit plugin has (junit-10.xsd), the required ones first.
ATTRIBUTES = {
    "testsuites": ((), {"name", "time", "tests", "failures", "errors"}),
    "testsuite": (("name", "tests", "failures", "errors"),
                  {"time", "skipped", "timestamp", "hostname", "id", "package", "group", "file"}),
    "testcase": (("name",), {"time", "classname", "group"}),
    "failure": ((), {"type", "message"}),
}
CHILDREN = {"testsuites": {"testsuite"}, "testsuite": {"testcase"}, "testcase": {"failure"},
            "failure": set()}


def check_element(element):
    required, allowed = ATTRIBUTES[element.tag]
    assert set(required) <= set(element.attrib) <= set(required) | allowed
    assert re.fullmatch(r"[0-9]+\.[0-9]{3}", element.get("time", "0.000"))
    for child in element:
        assert child.tag in CHILDREN[element.tag]
        check_element(child)


def junit(*arguments, status):
    root = ElementTree.fromstring(sim(*arguments, "--junit", "-", status=status).stdout.encode())
    assert root.tag == "testsuites"
    check_element(root)
    return root


def test_junit_has_a_case_for_each(write):
    root = junit(write("{ name: good, delivered: 100 }", "{ name: bad, drops: 1, before: 50ms }"),
                 status=3)
    (suite,) = root
    assert suite.get("name") == "powertrain"
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "1", "0")
    good, bad = suite
    assert (good.get("name"), good.get("classname"), len(good)) == ("good", "powertrain", 0)
    assert bad.get("time") == "0.050"
    assert bad[0].get("message") == "wanted 1 frame dropped before 50ms, got 0"
    assert float(suite.get("time")) == float(root.get("time")) == float(good.get("time")) >= 0.099


@pytest.mark.parametrize("name", [
    "a < b && c > 'd'", "]]> <!-- & -->", 'quotes " and &quot;', "Größe ≥ 1 · 🚗", "%s %n {}",
])
def test_names_come_through(write, name):
    quoted = name.replace("\\", "\\\\").replace('"', '\\"')
    root = junit(write(f'{{ name: "{quoted}", drops: 0 }}'), status=0)
    assert [case.get("name") for case in root.iter("testcase")] == [name]


def test_what_xml_cannot_hold_is_replaced(write):
    root = junit(write('{ name: "\\uFFFE\\uFFFF!", drops: 0 }'), status=0)
    assert [case.get("name") for case in root.iter("testcase")] == ["??!"]


def test_junit_without_expectations_is_empty(write):
    path = write()
    path.write_text(BUS.replace("expect:\n", ""))
    (suite,) = junit(path, status=0)
    assert (suite.get("tests"), len(suite)) == ("0", 0)


# ---- Delays begin when the host has handed the frame in ------------------------------------------

OWN_FRAMES = """
bus: { bitrate: 500000 }
nodes:
  - { name: a, loopback: on, traffic: [ { send: 100#01, every: 1ms, count: 3 } ] }
  - { name: b }
"""

# The sender is gone and has its next frame when the others receive this one.
LEFT = """
bus: { bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 100#01, offset: 1ms, count: 1 }, { send: 200#01, offset: 1102us, count: 1 } ]
  - { name: b }
  - { name: c }
faults: [ { name: gone, when: { time: 1098us }, do: { hardware-reset: a } } ]
"""


@pytest.mark.parametrize("step", [[], ["--step"]], ids=["fast", "step"])
@pytest.mark.parametrize("text, to, longest_us", [(OWN_FRAMES, "a", 130), (LEFT, "c", 108)],
                         ids=["own", "left"])
def test_a_delay_is_that_of_the_frame_itself(tmp_path, text, to, longest_us, step):
    path = tmp_path / "bus.yaml"
    for limit_us, status in ((longest_us, 0), (longest_us - 1, 3)):
        path.write_text(text + f"expect: [ {{ name: d, delay: {limit_us}us, to: {to}, "
                        "frame: 100 } ]\n")
        sim(path, *step, status=status)
