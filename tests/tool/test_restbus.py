# SPDX-License-Identifier: MIT
"""canwire-restbus: configurations of a DBC and a KCD, and entries of traffic that name messages.

`canwire check` accepts all that it writes, and cantools decodes the frames of the bus."""

import subprocess
import sys

import cantools
import pytest
import yaml
from readme import Session, example

from simtool import ROOT, canwire, run, sim

RESTBUS = ROOT / "lib/python/src/canwire/restbus.py"
CAR = ROOT / "config/restbus/car.dbc"

KCD = """<?xml version="1.0" encoding="UTF-8"?>
<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0">
  <Document name="small"/>
  <Node id="1" name="Motor"/>
  <Node id="2" name="Gearbox"/>
  <Bus name="Motor" baudrate="125000">
    <Message id="0x0A2" length="2" name="Speed" interval="50">
      <Producer><NodeRef id="1"/></Producer>
      <Signal name="speed" offset="8" length="8"/>
    </Message>
  </Bus>
</NetworkDefinition>
"""


def restbus(*arguments, status=0, cwd=None):
    return run(sys.executable, RESTBUS, *arguments, status=status, cwd=cwd)


def made(tmp_path, *arguments):
    """Returns a configuration that canwire accepts, and its path."""
    text = restbus(*arguments).stdout
    path = tmp_path / "made.yaml"
    path.write_text(text)
    canwire("check", path)
    return yaml.safe_load(text), path


def sends(configuration, name):
    """Returns what the node of that name sends, as frames with their other keys."""
    node = next(node for node in configuration["nodes"] if node["name"] == name)
    return {entry.pop("send"): entry for entry in node["traffic"]}


def test_each_sender_is_a_node_with_its_messages(tmp_path):
    configuration, _ = made(tmp_path, CAR)
    assert configuration["bus"] == {"name": "car", "bitrate": 500000, "dbitrate": 2000000}
    assert [node["name"] for node in configuration["nodes"]] == ["ENGINE", "GEARBOX", "DASH"]
    assert sends(configuration, "ENGINE") == {"0C9#0000800C3C000000": {"every": "10ms"}}
    assert sends(configuration, "DASH") == {"18FEF1FE#0200": {"every": "100ms"}}


def test_a_multiplexed_message_comes_in_turn_and_fd_frames_are_such(tmp_path):
    configuration, _ = made(tmp_path, CAR, "--only", "GEARBOX")
    assert [node["name"] for node in configuration["nodes"]] == ["GEARBOX"]
    assert sends(configuration, "GEARBOX") == {
        "100#00000000": {"every": "40ms"}, "100#00010000": {"every": "40ms", "offset": "20ms"},
        "300##1" + "00" * 16: {"every": "1000ms"}}


def test_nodes_can_be_left_out(tmp_path):
    configuration, path = made(tmp_path, CAR, "--without", "ENGINE", "--without", "GEARBOX")
    assert [node["name"] for node in configuration["nodes"]] == ["DASH"]
    assert "# - { name: ENGINE, port: vcan0 }" in path.read_text()


def test_what_is_not_sent_is_told(tmp_path):
    del tmp_path
    result = restbus(CAR)
    assert "Diagnosis (700) has no sender and is left out" in result.stderr
    assert "# { send: 400#00 } # DashButton: no cycle time" in result.stdout


def test_messages_of_several_frames_are_left_out(tmp_path):
    database = tmp_path / "long.dbc"
    database.write_text(CAR.read_text().replace("GearboxData: 4", "GearboxData: 39"))
    result = restbus(database)
    assert "GearboxData (100) is no single frame and is left out" in result.stderr
    assert "# GearboxData: no single frame" in result.stdout
    made(tmp_path, database)


def test_other_formats_and_options(tmp_path):
    database = tmp_path / "small.kcd"
    database.write_text(KCD)
    configuration, _ = made(tmp_path, database)
    assert configuration["bus"] == {"name": "small", "bitrate": 125000}
    assert sends(configuration, "Motor") == {"0A2#0000": {"every": "50ms"}}
    configuration, _ = made(tmp_path, database, "--bitrate", 250000, "--name", "other")
    assert configuration["bus"] == {"name": "other", "bitrate": 250000}


def test_the_bus_sends_what_the_database_says(tmp_path):
    _, path = made(tmp_path, CAR)
    database = cantools.database.load_file(CAR)
    found = {}
    for line in sim(path, "--until", "35ms", "--log", "-").stdout.splitlines():
        name, _, data = line.split()[2].partition("#")
        if not data.startswith("#"):
            found.setdefault(int(name, 16), database.decode_message(int(name, 16),
                                                                    bytes.fromhex(data)))
    assert found[0xC9] == {"rpm": 800.0, "temperature": 20, "running": 0}
    assert found[0x18FEF1FE] == {"light": "beam"}


# ---- Entries that name messages ------------------------------------------------------------------

BUS = """# my car
bus: { name: car, bitrate: 500000 }   # as it is
nodes:
  - name: engine
    traffic:  # two messages
      - { dbc: car.dbc, message: EngineData, signals: { rpm: 2000 } } # idle
      - dbc: car.dbc
        message: GearboxData
        every: 50ms
        signals: { gear: first, load: 250 }
        counter: { at: "0.0" }
      # the last one
      - { send: 123#00, every: 1s }
  - { name: dash }
"""


def test_messages_become_frames_and_all_else_stays(tmp_path):
    (tmp_path / "car.dbc").write_text(CAR.read_text())
    file = tmp_path / "bus.yaml"
    file.write_text(BUS)
    _, path = made(tmp_path, file)
    lines = path.read_text().splitlines()
    assert lines[:5] == BUS.splitlines()[:5]
    assert lines[5] == "      - { send: 0C9#0000401F3C000000, every: 10ms } # idle"
    assert lines[6] == "      - { send: 100#0101FA00, every: 50ms, counter: { at: \"0.0\" } }"
    assert lines[7:] == BUS.splitlines()[11:]
    refused = canwire("check", file, status=1).stderr
    assert "bus.yaml:6:16: dbc: canwire reads no databases" in refused
    assert f"canwire-restbus {file} > FILE" in refused


ERRORS = [
    (("EngineData", "EngineDat"),
     "6:34: message: car.dbc has no 'EngineDat' (did you mean 'EngineData'?)"),
    (("rpm:", "rmp:"), "6:57: signals: EngineData has no 'rmp' (did you mean 'rpm'?); it has rpm, "
                       "temperature, running"),
    (("2000 }", "fast }"), "6:62: rpm: expected a number"),
    (("2000 }", "20000 }"), "6:62: rpm: 20000 is not 0..16383 1/min"),
    (("gear: first", "gear: fifth"),
     "10:26: gear: expected a number or one of neutral, first, reverse"),
    (("load: 250", "load: 250, oil: 20"),
     "10:18: signals: GearboxData is multiplexed, and has no frame with all of these"),
    (("{ dbc: car.dbc, m", "{ dbc: bus.dbc, m"), "6:16: dbc: "),
    (("every: 50ms", "evry: 50ms"), "9:9: traffic: unknown key 'evry'"),
    (("{ dbc: car.dbc, message: EngineData,", "{ dbc: car.dbc,"),
     "6:9: traffic: the key 'message' is missing"),
    (("bus: {", "bus: }"), "2:6: "),
]


@pytest.mark.parametrize("change, message", ERRORS)
def test_errors_have_their_place(tmp_path, change, message):
    (tmp_path / "car.dbc").write_text(CAR.read_text())
    (tmp_path / "bus.yaml").write_text(BUS.replace(*change))
    result = restbus("bus.yaml", status=1, cwd=tmp_path)
    assert result.stderr.startswith(f"bus.yaml:{message}") and result.stdout == ""


@pytest.mark.parametrize("arguments, message", [
    (("none.dbc",), "canwire-restbus: none.dbc: No such file or directory"),
    ((ROOT / "README.md",), "canwire-restbus: "),
    ((CAR, "--without", "ENGIN"), "there is no node 'ENGIN' (did you mean 'ENGINE'?); nodes: DASH, "
                                  "ENGINE, GEARBOX"),
    ((CAR, "--only", "ENGINE", "--without", "ENGINE"), "no node is left that sends"),
])
def test_bad_databases_and_names(arguments, message):
    assert message in restbus(*arguments, status=1).stderr


def test_without_cantools_it_says_how_to_get_it():
    result = subprocess.run([sys.executable, "-S", "-E", RESTBUS, CAR], capture_output=True,
                            text=True, check=False)
    assert result.returncode == 1
    assert "the Python package cantools is missing; install it with 'pip install" in result.stderr


def test_the_example_of_the_readme(tmp_path):
    text, commands = example("car")
    (tmp_path / "car.yaml").write_text(text)
    canwire("check", tmp_path / "car.yaml")
    (tmp_path / "car.dbc").write_text(CAR.read_text())
    program = tmp_path / "canwire-restbus"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {RESTBUS} "$@"\n')
    program.chmod(0o755)
    with Session(tmp_path) as session:
        session.environment["PATH"] += f":{tmp_path}"
        output = [session.run(line) for line in commands]
    canwire("check", tmp_path / "restbus.yaml")
    assert "18FEF1FE#0200" in output[-1] and "0C9#" not in output[-1]
