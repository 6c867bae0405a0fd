# SPDX-License-Identifier: MIT
"""The plugin of pytest and the strategies of hypothesis, in a pytest of their own."""

import json
import os
import random
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from hypothesis import configuration, find, settings

from canwire import Scenario
from canwire.strategies import frames, scenarios
from simtool import CANWIRE, ROOT, TIMEOUT_S, sim

configuration.set_hypothesis_home_dir("/dev/null/none")  # it would write into the checkout

ALWAYS = settings(database=None, deadline=None, derandomize=True, max_examples=2000)

TESTS = '''
import time

import pytest
from hypothesis import given, settings

from canwire.strategies import scenarios

BUS = """
bus: { name: powertrain, bitrate: 500000 }
nodes: [ { name: engine }, { name: dash, port: vcan7 } ]
"""

@pytest.mark.canwire(BUS)
def test_fails(canwire_bus):
    canwire_bus.send("engine", "123#DEADBEEF")
    canwire_bus.run("1ms")
    canwire_bus.inject("{ name: bad, when: { frame: 123, count: 1 }, "
                       "do: { flip: 'crc[3]', at: [dash] } }")
    canwire_bus.send("dash", "200#R2", at="2ms")
    canwire_bus.send("engine", "123#CAFE", at="1.5ms")
    canwire_bus.run("3ms")
    assert canwire_bus["engine"].tec == 0, "an error"

@pytest.mark.canwire(BUS, seed=7)
def test_is_good(canwire_bus, canwire_time):
    before = time.time()
    time.sleep(100)
    assert 100 <= time.time() - before < 101 and canwire_bus.buses[0].seed == 7

def test_has_a_file(canwire_bus):
    assert canwire_bus.name == "filed"

def test_has_two(canwire_sim):
    one, other = canwire_sim(BUS), canwire_sim("bus.yaml")
    one.inject(name="x", when={"manual": True}, do={"bus-off": "engine"})
    one.fire("x")
    one.run("1ms")
    assert one["engine"].state == other.nodes[0].state

def test_closes_its_bus(canwire_sim):
    with canwire_sim(BUS) as bus:
        bus.send("engine", "321#")
        assert bus.run("1ms") is None

@pytest.mark.canwire(BUS)
@pytest.mark.parametrize("word", ["a/b", "a_b", "long" * 80])
def test_has_words(canwire_bus, word):
    canwire_bus.send("engine", f"{len(word):03X}#")
    canwire_bus.run("1ms")
    assert word is None

@pytest.mark.canwire(BUS, events="tx")
def test_keeps_some_events(canwire_bus):
    canwire_bus.inject(name="bad", when={"count": 1, "frame": "123"},
                       do={"flip": "crc[3]", "at": ["dash"]})
    canwire_bus.send("engine", "123#DEADBEEF")
    canwire_bus.run("1ms")
    canwire_bus.keep_events("rx")
    canwire_bus.send("dash", "124#")
    canwire_bus.run("2ms")
    assert not canwire_bus.events()

RULES = BUS + """
faults:
  - { name: first, when: { frame: "100" }, do: { error-flag: [dash] } }
  - { name: later, when: { time: 2ms.. }, do: { stuck: dominant, on: dash.tx } }
  - { name: window, when: { time: 1ms..3ms }, do: { drop: rx, at: [dash] } }
"""

@pytest.mark.canwire(RULES)
def test_clears_rules_of_the_file(canwire_bus):
    canwire_bus.send("engine", "100#")
    canwire_bus.run("500us")
    canwire_bus.clear("first")
    canwire_bus.inject(name="own", when={"frame": "100"}, do={"error-flag": ["dash"]})
    canwire_bus.run("700us")
    canwire_bus.clear()
    canwire_bus.clear("later")
    canwire_bus.run("2.5ms")
    assert not canwire_bus.events()

@pytest.mark.canwire(RULES)
def test_clears_what_a_file_cannot_say(canwire_bus):
    canwire_bus.clear("window")
    canwire_bus.clear("first")
    canwire_bus.inject(name="first", when={"frame": "100"}, do={"no-ack": ["dash"]})
    canwire_bus.run("100us")
    canwire_bus.inject(name="window", when={"frame": "100"}, do={"no-ack": ["dash"]})
    canwire_bus.send("engine", "101#")
    canwire_bus.run("2.5ms")
    assert not canwire_bus.events()

@settings(database=None, deadline=None, derandomize=True)
@given(scenario=scenarios(nodes=["engine", "dash"]))
def test_no_node_goes_off(scenario):
    with scenario.run("100ms") as bus:
        assert not [event for event in bus.events("state") if event["state"] == "bus-off"]
'''


def run_pytest(folder, *words):
    """Runs a pytest with the plugin; its output."""
    path = os.pathsep.join([str(ROOT / "lib/python/src"), str(ROOT / "tests/python/installed"),
                            *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words], cwd=folder,
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        env={**os.environ, "PYTHONPATH": path, "CANWIRE": CANWIRE})
    return done.stdout + done.stderr


@pytest.fixture(name="done", scope="module")
def fixture_done(tmp_path_factory):
    """The folder and the output of a run of TESTS."""
    folder = tmp_path_factory.mktemp("ecu")
    (folder / "test_ecu.py").write_text(TESTS)
    (folder / "bus.yaml").write_text(
        "bus: { name: filed, bitrate: 125000 }\nnodes: [ { name: a } ]")
    (folder / "pytest.ini").write_text("[pytest]\ncanwire_bus = bus.yaml\n")
    return folder, run_pytest(folder, "--junit-xml", "report.xml", "--canwire-out", "out")


def test_a_test_that_fails_shows_what_was_on_the_bus(done):
    folder, output = done
    assert "10 failed, 2 passed" in output, output
    section = output.split("canwire: powertrain")[1]
    assert '"event":"fault","rule":"bad","hit":1}' in section
    assert "does not" not in section.split("canwire: ")[0]
    files = sorted(path.name for path in (folder / "out/test_ecu.py_test_fails").iterdir())
    assert files == ["bus.yaml", "events.jsonl", "scenario.yaml", "wire.svg", "wire.vcd"]
    found = {path.name for path in (folder / "out").iterdir() if "words" not in path.name}
    assert found == {f"test_ecu.py_test_{name}" for name in (
        "clears_rules_of_the_file", "clears_what_a_file_cannot_say", "closes_its_bus", "fails",
        "has_two", "has_two-2", "keeps_some_events")}


def test_each_test_has_a_folder_of_its_own(done):
    folders = sorted((done[0] / "out").glob("*words*"))
    frames = {json.loads((folder / "events.jsonl").read_text().splitlines()[-1])["frame"]
              for folder in folders}
    assert frames == {"003#", "140#"} and len(folders) == 3
    assert re.fullmatch(r"test_ecu.py_test_has_words_a_b-[0-9a-f]{8}", folders[0].name)
    assert all(len(folder.name) < 120 and len(list(folder.iterdir())) == 5 for folder in folders)


def test_files_that_cannot_be_written_are_reported(done):
    output = run_pytest(done[0], "-k", "test_fails", "--canwire-out", "bus.yaml")
    assert "files are missing: [Errno 20] Not a directory" in output, output
    assert "an error" in output and '"event":"fault","rule":"bad"' in output
    assert "1 failed" in output and "INTERNALERROR" not in output


def report(done, name):
    """Returns what the report of a test says of its bus."""
    return re.search(rf"_ test_{name} _.*?- canwire: \w+ -+\n(.*?)\n(?:_____|=====)", done[1],
                     re.S)[1]


def test_a_test_that_keeps_some_events_has_a_scenario_and_a_picture(done):
    text = report(done, "keeps_some_events")
    assert "not all" not in text and "wire.svg" in text, text
    events = (done[0] / "out/test_ecu.py_test_keeps_some_events/events.jsonl").read_text()
    assert re.findall('"event":"([a-z]+)","frame":"([0-9A-F#]+)"', events) == [
        ("tx", "123#DEADBEEF"), ("rx", "124#")]
    text = (done[0] / "out/test_ecu.py_test_keeps_some_events/wire.vcd").read_text()
    assert "error" in text  # the wire around the error, not the end


def test_rules_of_the_file_that_were_cleared_are_in_the_scenario(done):
    text = report(done, "clears_rules_of_the_file")
    assert "not all" not in text, text
    text = (done[0] / "out/test_ecu.py_test_clears_rules_of_the_file/scenario.yaml").read_text()
    assert re.findall(r"time: \"?([^\s\",]+)", text) == [
        "0s..500000ns", "1ms..3ms", "500000ns..700000ns"]
    text = report(done, "clears_what_a_file_cannot_say")
    assert "not all that the test did\n  clear window at 0.000000000 s\n" \
        "  the rule window at 0.000100000 s\nfiles: " in text, text


def test_a_bus_that_is_closed_is_reported(done):
    folder = done[0] / "out/test_ecu.py_test_closes_its_bus"
    assert '"frame":"321#"' in (folder / "events.jsonl").read_text()
    assert (folder / "scenario.yaml").exists() and (folder / "wire.svg").exists()


def test_its_scenario_repeats_the_test(done):
    folder = done[0] / "out/test_ecu.py_test_fails"
    text = (folder / "scenario.yaml").read_text()
    assert re.search(r"send: 123#CAFE|send: \"123#CAFE\", offset: 1500000ns", text), text
    until = re.match(r"# canwire sim scenario.yaml --until (\d+ns) --events -\n", text)[1]
    again = sim(folder / "scenario.yaml", "--until", until, "--events", "-").stdout
    kept = (folder / "events.jsonl").read_text()
    assert [json.loads(line) for line in again.splitlines()] == [
        json.loads(line) for line in kept.splitlines()]
    assert len(again.splitlines()) >= 9
    assert "<svg" in (folder / "wire.svg").read_text()
    assert "$enddefinitions" in (folder / "wire.vcd").read_text()


def test_what_a_scenario_cannot_repeat_is_said(done):
    folder, output = done
    assert "scenario.yaml has not all that the test did\n  fire x at 0.000000000 s" in output
    text = (folder / "out/test_ecu.py_test_has_two/scenario.yaml").read_text()
    assert "# not in it: fire x at 0.000000000 s\n" in text


def test_the_files_are_properties_in_junit_xml(done):
    folder = done[0]
    case, = ElementTree.parse(folder / "report.xml").iterfind(".//testcase[@name='test_fails']")
    properties = {one.get("name"): one.get("value") for one in case.iter("property")}
    where = folder / "out/test_ecu.py_test_fails"
    assert properties == {f"canwire.powertrain.{name}": str(where / name) for name in (
        "bus.yaml", "events.jsonl", "scenario.yaml", "wire.svg", "wire.vcd")}


def test_hypothesis_prints_the_smallest_scenario_as_yaml(done):
    example = re.search(r'scenario=Scenario\("""\n(.*?)"""\)', done[1], re.S)[1]
    lines = [line.lstrip("E").strip() for line in example.splitlines()]
    assert [line for line in lines if line] == [
        "bus: { name: drawn, bitrate: 500000 }", "nodes:",
        '- { name: engine, traffic: [{ send: "000#", offset: 0 }] }', "- { name: dash }", "faults:",
        '- { name: rule-1, when: { frame: "0:0", count: 1 }, do: { bus-off: [engine] } }']
    file = done[0] / "example.yaml"
    file.write_text("\n".join(re.sub("^E? *", " " * 4 * line.lstrip("E ").startswith("-"), line)
                              for line in example.splitlines()))
    again = sim(file, "--until", "100ms", "--events", "-").stdout
    assert '"node":"engine","event":"state","state":"bus-off"' in again


@pytest.mark.deep
def test_scenarios_shrink_to_what_matters():
    def destroyed(scenario):
        with scenario.run("100ms", listen=False) as bus:
            return len(bus.events("error")) >= 4 and bus.node("b").tec > 7

    small = find(scenarios(), destroyed, settings=ALWAYS)
    assert len(small.config["faults"]) == 1 and small.config["faults"][0]["when"]["count"] <= 4
    assert sum(len(one.get("traffic", [])) for one in small.config["nodes"]) == 1
    assert Scenario(small.yaml).yaml == small.yaml  # the text is all of it


def goes_off(scenario):
    with scenario.run("100ms", listen=False, events="state") as bus:
        return any(event["state"] == "bus-off" for event in bus.events("state"))


def dash_sends(scenario):
    with scenario.run("100ms", listen=False, events="tx") as bus:
        return bool(bus.events("tx", node="dash"))


@pytest.mark.deep
@pytest.mark.parametrize("fails, rules, seed", [(goes_off, 1, 2), (dash_sends, 0, 4)])
def test_no_superfluous_rule_or_frame_is_left(fails, rules, seed):
    small = find(scenarios(["engine", "dash"]), fails, random=random.Random(seed),
                 settings=settings(ALWAYS, derandomize=False))
    assert len(small.config.get("faults", [])) == rules
    assert sum(len(one.get("traffic", [])) for one in small.config["nodes"]) == 1


def test_frames_are_those_that_exist():
    def smallest(strategy, condition):
        return str(find(strategy, condition, settings=ALWAYS))

    assert smallest(frames(), lambda frame: True) == "000#"
    assert smallest(frames(fd=True), lambda frame: len(frame.data) > 20) == "000##0" + "00" * 24
    assert smallest(frames(extended=True, remote=True), lambda frame: frame.remote) == "00000000#R"


def test_the_example_of_the_page_passes(tmp_path):
    text = (ROOT / "daemon/man/canwire-pytest.7.md").read_text(encoding="utf-8")
    (tmp_path / "test_ecu.py").write_text(re.search(r"```python\n(.*?)```", text, re.S)[1])
    output = run_pytest(tmp_path)
    assert "1 passed" in output, output
    assert not (tmp_path / "canwire-failures").exists()
