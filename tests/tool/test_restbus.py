# SPDX-License-Identifier: MIT
"""canwire-restbus: configurations of a DBC and a KCD, and entries of traffic that name messages.

`canwire check` accepts all that it writes, and cantools decodes the frames of the bus."""

import os
import pathlib
import re
import subprocess
import sys

import cantools
import pytest
import yaml
from cantools.autosar.end_to_end import check_profile2_crc

from simtool import ROOT, canwire, run, sim

RESTBUS = ROOT / "lib/python/src/canwire/restbus.py"
CAR = ROOT / "config/restbus/car.dbc"

GROUP_MAPPING = """<SHORT-NAME>groupMapping</SHORT-NAME>
              <I-SIGNAL-GROUP-REF DEST="I-SIGNAL-GROUP">/Net/Group</I-SIGNAL-GROUP-REF>
            </I-SIGNAL-TO-I-PDU-MAPPING>
            <I-SIGNAL-TO-I-PDU-MAPPING>
              <SHORT-NAME>fiveMapping</SHORT-NAME>"""

GROUP = """        <I-SIGNAL-GROUP>
          <SHORT-NAME>Group</SHORT-NAME>
          <TRANSFORMATION-I-SIGNAL-PROPSS>
            <END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS>
              <END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS-VARIANTS>
                <END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS-CONDITIONAL>
                  <TRANSFORMER-REF DEST="TRANSFORMATION-TECHNOLOGY">/Net/Set/Five</TRANSFORMER-REF>
                  <DATA-IDS>
                    <DATA-ID>4660</DATA-ID>
                  </DATA-IDS>
                </END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS-CONDITIONAL>
              </END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS-VARIANTS>
            </END-TO-END-TRANSFORMATION-I-SIGNAL-PROPS>
          </TRANSFORMATION-I-SIGNAL-PROPSS>
        </I-SIGNAL-GROUP>
        <DATA-TRANSFORMATION-SET>
          <SHORT-NAME>Set</SHORT-NAME>
          <TRANSFORMATION-TECHNOLOGYS>
            <TRANSFORMATION-TECHNOLOGY>
              <SHORT-NAME>Five</SHORT-NAME>
              <TRANSFORMATION-DESCRIPTIONS>
                <END-TO-END-TRANSFORMATION-DESCRIPTION>
                  <PROFILE-NAME>PROFILE_05</PROFILE-NAME>
                  <OFFSET>64</OFFSET>
                </END-TO-END-TRANSFORMATION-DESCRIPTION>
              </TRANSFORMATION-DESCRIPTIONS>
            </TRANSFORMATION-TECHNOLOGY>
          </TRANSFORMATION-TECHNOLOGYS>
        </DATA-TRANSFORMATION-SET>
      </ELEMENTS>
    </AR-PACKAGE>
  </AR-PACKAGES>
</AUTOSAR>
"""

NETWORK = ROOT / "tests/tool/restbus/network"  # the same in three formats


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


def resolved(tmp_path, entries, database):
    """Returns what the entries of traffic of a node become, without braces."""
    (tmp_path / "entries.yaml").write_text(
        "bus: { bitrate: 500000, dbitrate: 2000000 }\nnodes:\n  - name: a\n    traffic:\n" +
        "".join(f"      {line.replace('{', f'{{ dbc: {database},', 1)}\n"
                for line in entries.strip().splitlines()))
    _, path = made(tmp_path, tmp_path / "entries.yaml")
    return [line.strip()[len("- { send: "):-len(" }")] for line in
            path.read_text().splitlines()[4:]]


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
    assert result.stderr.splitlines() == [
        f"canwire-restbus: {CAR}: Diagnosis (700) has no sender and is left out; --sender NODE "
        "sends such messages",
        f"canwire-restbus: {CAR}: DashButton (400) has no cycle time and is not sent; --cycle TIME "
        "gives one to all, --cycle MESSAGE=TIME to one"]
    assert "# { send: 400#00 } # DashButton: no cycle time" in result.stdout


# ---- What the database does not say --------------------------------------------------------------


def without_times(tmp_path):
    """Writes the database of the car without cycle times."""
    text = re.sub(r'^BA_ "GenMsgCycleTime".*\n', "", CAR.read_text(), flags=re.MULTILINE)
    (tmp_path / "silent.dbc").write_text(text)
    return tmp_path / "silent.dbc"


def test_a_silent_bus_is_told(tmp_path):
    file = without_times(tmp_path)
    told = restbus(file).stderr
    assert f"{file}: 5 of 5 messages have no cycle time and are not sent: EngineData (0C9), " \
        "GearboxData (100), GearboxInfo (300), DashData (18FEF1FE), DashButton (400); " in told
    assert f"{file}: no message is sent periodically: this bus is silent" in told


def test_a_cycle_time_is_for_all_that_have_none_or_for_one(tmp_path):
    configuration, _ = made(tmp_path, CAR, "--cycle", "250us", "--cycle", "EngineData=1.5s")
    assert sends(configuration, "DASH") == {"18FEF1FE#0200": {"every": "100ms"},
                                            "400#00": {"every": "0.25ms"}}
    assert sends(configuration, "ENGINE") == {"0C9#0000800C3C000000": {"every": "1500ms"}}
    file = without_times(tmp_path)
    configuration, _ = made(tmp_path, file, "--cycle", "100ms")
    assert {rest["every"] for node in configuration["nodes"]
            for rest in sends(configuration, node["name"]).values()} == {"100ms", "200ms"}
    assert "cycle time" not in restbus(file, "--cycle", "100ms").stderr
    told = restbus(file, "--cycle", "EngineData=10ms").stderr
    assert "4 of 5 messages have no cycle time and are not sent: GearboxData (100), " in told


@pytest.mark.parametrize("value", ["0ms", "100", "10bit", "=10ms", "EngineData=", "-1ms"])
def test_a_wrong_cycle_time_is_refused(value):
    assert f"'{value}': expected a time such as 100ms" in \
        restbus(CAR, f"--cycle={value}", status=2).stderr


def test_messages_without_a_sender_are_sent_by_the_node_that_is_named(tmp_path):
    arguments = (CAR, "--sender", "DASH", "--cycle", "100ms", "--only", "DASH")
    configuration, _ = made(tmp_path, *arguments)
    assert set(sends(configuration, "DASH")) == {"18FEF1FE#0200", "400#00", "700#" + "00" * 8}
    assert restbus(*arguments).stderr == (
        f"canwire-restbus: {CAR}: only one node sends, and nobody acknowledges its frames; add "
        "another node, such as the ECU with its port\n")
    configuration, _ = made(tmp_path, CAR, "--sender", "rest of it", "--cycle", "100ms")
    assert set(sends(configuration, "rest_of_it")) == {"700#" + "00" * 8}


def with_attributes(tmp_path, *lines):
    """Writes the database of the car with further attributes of messages."""
    kinds = '"Cyclic","Event","cyclicIfActive","NoMsgSendType","CyclicAndSpontaneous"'
    (tmp_path / "more.dbc").write_text("\n".join([
        CAR.read_text(), f'BA_DEF_ BO_ "GenMsgSendType" ENUM {kinds};',
        'BA_DEF_ BO_ "GenMsgStartDelayTime" INT 0 65535;',
        'BA_DEF_DEF_ "GenMsgSendType" "NoMsgSendType";',
        'BA_DEF_DEF_ "GenMsgStartDelayTime" 0;', *lines, ""]))
    return tmp_path / "more.dbc"


def test_messages_that_are_sent_at_events_are_told(tmp_path):
    file = with_attributes(tmp_path, 'BA_ "GenMsgSendType" BO_ 201 1;',
                           'BA_ "GenMsgSendType" BO_ 256 2;', 'BA_ "GenMsgSendType" BO_ 768 4;')
    result = restbus(file)
    assert f"{file}: 2 of 5 messages are not sent: their send type is Event, cyclicIfActive: " \
        "EngineData (0C9), GearboxData (100); --cycle TIME sends all, " in result.stderr
    assert f"{file}: DashButton (400) has no cycle time and is not sent; " in result.stderr
    assert "# { send: 0C9#0000800C3C000000 } # EngineData: Event" in result.stdout
    assert "- { send: 300##1" in result.stdout
    configuration, _ = made(tmp_path, file, "--cycle", "EngineData=1s", "--only", "ENGINE")
    assert sends(configuration, "ENGINE") == {"0C9#0000800C3C000000": {"every": "1000ms"}}


def test_start_delays_are_offsets_and_others_are_spread(tmp_path):
    file = with_attributes(tmp_path, 'BA_ "GenMsgStartDelayTime" BO_ 201 7;',
                           'BA_ "GenMsgStartDelayTime" BO_ 256 33;')
    configuration, _ = made(tmp_path, file)
    assert sends(configuration, "ENGINE") == {
        "0C9#0000800C3C000000": {"every": "10ms", "offset": "7ms"}}
    expected = {"100#00000000": {"every": "40ms", "offset": "33ms"},
                "100#00010000": {"every": "40ms", "offset": "53ms"},
                "300##1" + "00" * 16: {"every": "1000ms"}}
    assert sends(configuration, "GEARBOX") == expected
    configuration, _ = made(tmp_path, file, "--spread")
    expected["300##1" + "00" * 16]["offset"] = "500ms"  # the third of four
    assert sends(configuration, "GEARBOX") == expected
    assert sends(configuration, "DASH") == {"18FEF1FE#0200": {"every": "100ms", "offset": "75ms"}}


def test_a_node_has_a_queue_for_all_its_messages(tmp_path):
    more = "".join(f"BO_ {n} M{n}: 1 DASH\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" ENGINE\n\n"
                   for n in range(1500, 1520))
    (tmp_path / "many.dbc").write_text(CAR.read_text().replace("BA_DEF_", more + "BA_DEF_", 1))
    configuration, path = made(tmp_path, tmp_path / "many.dbc", "--cycle", "100ms")
    assert [node.get("queue") for node in configuration["nodes"]] == [None, None, 22]
    sent = sim(path, "--until", "1s", "--log", "-").stdout.splitlines()
    counts = [sum(f" {n:03X}#" in line for line in sent) for n in range(1500, 1520)]
    assert set(counts) == {10}


def test_nodes_that_send_one_identifier_are_told(tmp_path):
    text = CAR.read_text().replace("BO_ 1024 DashButton: 1 DASH", "BO_ 201 DashButton: 1 DASH")
    (tmp_path / "same.dbc").write_text(text.replace(" SG_ 1024 ", " SG_ 201 "))
    assert "several nodes send 0C9, and destroy each other's frames: EngineData, DashButton\n" in \
        restbus(tmp_path / "same.dbc", "--cycle", "10ms").stderr


def test_checks_of_cantools_can_be_skipped(tmp_path):
    (tmp_path / "long.dbc").write_text(CAR.read_text().replace("32|8@1+", "60|8@1+"))
    told = restbus(tmp_path / "long.dbc", status=1).stderr
    assert "The signal temperature does not fit in message EngineData" in told
    assert told.endswith("--no-strict skips this check\n")
    result = restbus(tmp_path / "long.dbc", "--no-strict")
    assert "GEARBOX" in result.stdout and "# { send: 400#00 } # DashButton" in result.stdout
    (tmp_path / "bus.yaml").write_text("bus: { bitrate: 500000 }\nnodes:\n  - name: a\n    "
                                       "traffic: [ { dbc: long.dbc, message: DashButton } ]\n")
    told = restbus("bus.yaml", status=1, cwd=tmp_path).stderr
    assert told.startswith("bus.yaml:4:23: dbc: ") and "--no-strict" in told
    result = restbus("bus.yaml", "--no-strict", cwd=tmp_path)
    assert "- { send: 400#00 }" in result.stdout or "[ { send: 400#00 } ]" in result.stdout
    assert "bus.yaml:4: DashButton has no cycle time and is sent once" in result.stderr


def test_messages_of_several_frames_are_left_out(tmp_path):
    database = tmp_path / "long.dbc"
    database.write_text(CAR.read_text().replace("GearboxData: 4", "GearboxData: 39"))
    result = restbus(database)
    assert "GearboxData (100) is no single frame and is left out" in result.stderr
    assert "# GearboxData: no single frame" in result.stdout
    made(tmp_path, database)


def test_options_say_what_the_database_does_not(tmp_path):
    configuration, _ = made(tmp_path, f"{NETWORK}.kcd", "--bitrate", 250000, "--name", "0")
    assert configuration["bus"] == {"name": "0", "bitrate": 250000}
    assert "--name: 1 to 32" in restbus(CAR, "--name", "a: b", status=2).stderr


# ---- Formats -------------------------------------------------------------------------------------


def test_three_formats_of_a_network_agree(tmp_path):
    """KCD has no initial values, so its data are 0, and it has no first page."""
    dbc, arxml, kcd = (made(tmp_path, f"{NETWORK}.{kind}")[0] for kind in ("dbc", "arxml", "kcd"))
    assert dbc["bus"] == kcd["bus"] == {"name": "network", "bitrate": 500000}
    assert arxml["bus"] == {**dbc["bus"], "dbitrate": 2000000}
    assert arxml["nodes"][:3] == dbc["nodes"]
    assert sends(dbc, "Engine") == {"0A2#00800CFFB0000000": {"every": "50ms"}}
    assert sends(dbc, "Gearbox") == {"100#00010102": {"every": "40ms"},
                                     "100#00000000": {"every": "40ms", "offset": "20ms"}}
    assert sends(kcd, "Gearbox") == {"100#00000000": {"every": "40ms"},
                                     "100#00010000": {"every": "40ms", "offset": "20ms"}}
    assert sends(kcd, "Engine") == {"0A2#0000000000000000": {"every": "50ms"}}
    assert sends(kcd, "Dash") == sends(dbc, "Dash")


@pytest.mark.parametrize("kind", ["dbc", "arxml", "kcd"])
def test_messages_of_all_formats_become_the_same_frames(tmp_path, kind):
    lines = resolved(tmp_path, f"""
- {{ message: EngineSpeed, signals: {{ speed: 1234.5, torque: -300 }} }}
- {{ message: GearboxState, signals: {{ oil: 90 }} }}
- {{ message: GearboxState, signals: {{ load: 0xABC }} }}
- {{ message: DashLight, signals: {{ light: beam }} }}""", f"{NETWORK}.{kind}")
    assert lines == ["0A2#004A13ED40000000, every: 50ms", "100#00008200, every: 20ms",
                     "100#0001BC0A, every: 20ms", "18FEF1FE#0200, every: 100ms"]


def test_the_protection_of_arxml_has_its_places(tmp_path):
    configuration, path = made(tmp_path, f"{NETWORK}.arxml")
    assert "SafePart (206) is sent without its protection PROFILE_02: only a part" in \
        restbus(f"{NETWORK}.arxml").stderr
    keys = {send[:3]: rest for send, rest in sends(configuration, "Safe").items()}
    assert keys["201"] == {"every": "10ms", "counter": {"at": "0.0"}, "checksum": {
        "kind": "e2e-p1", "at": 1, "data-id": 0xABC, "data-id-mode": "nibble",
        "data-id-nibble": "0.4"}}
    assert keys["205"]["checksum"] == {"kind": "e2e-p5", "at": 8, "data-id": 0xBEEF}
    assert keys["206"] == {"every": "10ms"}
    database = cantools.database.load_file(f"{NETWORK}.arxml")
    sent = [bytes.fromhex(line.rpartition("202#")[2]) for line in
            sim(path, "--until", "100ms", "--log", "-").stdout.splitlines() if "202#" in line]
    assert len({data[0] for data in sent}) > 5
    assert all(check_profile2_crc(data, database.get_message_by_name("SafeTwo")) for data in sent)


def test_the_places_of_a_transformer_are_taken_too(tmp_path):
    text = pathlib.Path(f"{NETWORK}.arxml").read_text()
    text = text[:text.index("        <END-TO-END-PROTECTION-SET>")] + GROUP
    text = text.replace("<SHORT-NAME>fiveMapping</SHORT-NAME>", GROUP_MAPPING)
    (tmp_path / "group.arxml").write_text(text)
    configuration, _ = made(tmp_path, tmp_path / "group.arxml", "--only", "Safe")
    assert {send[:3]: rest.get("checksum") for send, rest in sends(configuration, "Safe").items()
            if "checksum" in rest} == {"205": {"kind": "e2e-p5", "at": 8, "data-id": 4660}}


# ---- Start values --------------------------------------------------------------------------------


def dbc(path, *changes):
    """Writes the database of this test with other text in places."""
    text = pathlib.Path(f"{NETWORK}.dbc").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


def test_defaults_of_attributes_are_taken(tmp_path):
    file = dbc(tmp_path / "a.dbc", ('"GenSigStartValue" 0;', '"GenSigStartValue" 3;'))
    configuration, _ = made(tmp_path, file)
    assert sends(configuration, "Dash") == {"18FEF1FE#0300": {"every": "100ms"}}
    assert "100#00000300" in sends(configuration, "Gearbox")


@pytest.mark.parametrize("value, data", [
    ("4294967296", "0000"), ("-1", "0000"), ("1.5", "0000"), ("1e400", "0000")])
def test_a_start_value_that_does_not_fit_is_told(tmp_path, value, data):
    file = dbc(tmp_path / "a.dbc", ('"GenSigStartValue" INT', '"GenSigStartValue" FLOAT'),
               ("162 speed 3200", f"162 speed {value}"))
    assert f"0A2#00{data}" in restbus(file).stdout
    assert "EngineSpeed (0A2): speed cannot begin with" in restbus(file).stderr


def test_a_start_value_of_64_bits_is_exact_and_a_rounded_one_is_the_greatest(tmp_path):
    for kind, value, data in (("INT", "12345678901234567891", "D30A1FEB8CA954AB"),
                              ("FLOAT", "1.84467440737096E+019", "FF" * 8)):
        file = dbc(tmp_path / "a.dbc", ('"GenSigStartValue" INT', f'"GenSigStartValue" {kind}'),
                   (" SG_ torque : 31|12@0- (1,0) [-2048|2047] \"Nm\" Gearbox\n", ""),
                   ('BA_ "GenSigStartValue" SG_ 162 torque -5;\n', ""),
                   ("speed : 8|16@1+ (0.25,0) [0|16383.75]", "speed : 0|64@1+ (1,0) [0|0]"),
                   ("162 speed 3200", f"162 speed {value}"))
        assert f"0A2#{data}" in restbus(file).stdout


def test_more_pages_than_a_node_can_send_are_told(tmp_path):
    file = dbc(tmp_path / "a.dbc", ("page M : 8|8@1+", "page M : 0|16@1+"),
               (' SG_ load m1 : 16|16@1+ (1,0) [0|65535] "" Dash\n', "".join(
                   f' SG_ s{n} m{n} : 16|8@1+ (1,0) [0|0] "" Dash\n' for n in range(1, 4200))),
               ('BA_ "GenSigStartValue" SG_ 256 load 513;\n', ""),
               ("256 page 1", "256 page 4100"))
    result = restbus(file)
    assert "GearboxState (100) has 4200 pages; 4096 are sent" in result.stderr
    lines = [line for line in result.stdout.splitlines() if " send: 100#" in line]
    assert len(lines) == 4096 and "100#04100000" in lines[0] and "100#00000000" in lines[1]
    lines = resolved(tmp_path, "- { message: GearboxState, signals: { s4199: 255 } }", file)
    assert lines == ["100#6710FF00, every: 20ms"]


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
    assert lines[7:11] == [""] * 4  # lines keep their numbers
    assert lines[11:] == BUS.splitlines()[11:]
    refused = canwire("check", file, status=1).stderr
    assert "bus.yaml:6:16: dbc: canwire reads no databases" in refused
    assert f"canwire-restbus {file} > FILE" in refused


ANCHORS = """bus: { name: car, bitrate: 500000, dbitrate: 2000000 }
nodes:
  - name: a
    traffic: &all
      - &idle { dbc: car.dbc, message: &engine EngineData, signals: &idles { rpm: &r 2000 } }
      - dbc: car.dbc
        message: *engine
        signals: *idles
        every: &slow 50ms
      - { send: 123#00, every: *slow }
  - { name: b, traffic: *all }
  - name: c
    traffic: [*idle, { send: 124#00, every: &fast 5ms, offset: *fast }]
  - name: d
    traffic:
      - dbc: car.dbc
        message: EngineData
        every: *fast
"""


def test_anchors_and_aliases_are_what_they_stand_for(tmp_path):
    (tmp_path / "car.dbc").write_text(CAR.read_text())
    (tmp_path / "bus.yaml").write_text(ANCHORS)
    configuration, path = made(tmp_path, tmp_path / "bus.yaml")
    idle = {"send": "0C9#0000401F3C000000", "every": "10ms"}
    first = [idle, {**idle, "every": "50ms"}, {"send": "123#00", "every": "50ms"}]
    assert [node["traffic"] for node in configuration["nodes"]] == [
        first, first, [idle, {"send": "124#00", "every": "5ms", "offset": "5ms"}],
        [{"send": "0C9#0000800C3C000000", "every": "5ms"}]]
    assert len(path.read_text().splitlines()) == len(ANCHORS.splitlines())


def test_signals_of_64_bits_keep_all_bits(tmp_path):
    file = dbc(tmp_path / "a.dbc", ("torque : 31|12@0- (1,0) [-2048|2047]",
                                    "torque : 63|1@1- (1,0) [0|0]"),
               ("speed : 8|16@1+ (0.25,0) [0|16383.75]", "speed : 0|63@1+ (0.1,1) [0|0]"),
               ('BA_ "GenSigStartValue" SG_ 162 torque -5;\n', ""))
    lines = resolved(tmp_path, """
- { message: EngineSpeed, signals: { speed: 0x100000000000001 } }
- { message: EngineSpeed, signals: { speed: 123456789012345678.9 } }""", file)
    raw = [(0x100000000000001 - 1) * 10, 1234567890123456779]
    assert lines == [f"0A2#{(value & ~(1 << 63)).to_bytes(8, 'little').hex().upper()}, every: 50ms"
                     for value in raw]


ERRORS = [
    (("EngineData", "EngineDat"),
     "6:34: message: car.dbc has no 'EngineDat' (did you mean 'EngineData'?)"),
    (("rpm:", "rmp:"), "6:57: signals: EngineData has no 'rmp' (did you mean 'rpm'?)"),
    (("rpm:", "wxyz:"), "6:57: signals: EngineData has no 'wxyz'; it has rpm, temperature, "
                        "running"),
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
    (("2000 }", "nan }"), "6:62: rpm: expected a number"),
    (("2000 }", "1e999999999 }"), "6:62: rpm: expected a number"),
    (("2000 }", "[1] }"), "6:62: rpm: expected a number"),
    (("rpm: 2000", "[rpm]: 1"), "6:57: signals: EngineData has no '?'"),
    (("rpm: 2000", "rpm: 1, rpm: 2"), "6:65: signals: 'rpm' is there twice"),
    (("traffic:", "traffic: &t [*t]\n    traffic:"), "5:18: *t is inside of &t"),
    (("# idle", "# \x07"), "6:73: this character is not allowed"),
    (("message: EngineData", "message: GearboxLong"), "6:34: message: car.dbc has no"),
]


@pytest.mark.parametrize("change, message", ERRORS)
def test_errors_have_their_place(tmp_path, change, message):
    (tmp_path / "car.dbc").write_text(CAR.read_text())
    (tmp_path / "bus.yaml").write_text(BUS.replace(*change))
    result = restbus("bus.yaml", status=1, cwd=tmp_path)
    assert result.stderr.startswith(f"bus.yaml:{message}") and result.stdout == ""


def test_a_float_must_fit(tmp_path):
    file = dbc(tmp_path / "a.dbc", ("speed : 8|16@1+", "speed : 32|32@1-"),
               ("[0|16383.75]", "[0|0]"),
               ("torque : 31|12@0-", "torque : 7|12@0-"), ("162 speed 3200", "162 speed 0"),
               ("VAL_ ", "SIG_VALTYPE_ 162 speed : 1;\nVAL_ "))
    assert resolved(tmp_path, "- { message: EngineSpeed, signals: { speed: -1.5 } }", file) == \
        ["0A2#FFB000000000C0C0, every: 50ms"]
    for number in "1e39", "-1e400":
        (tmp_path / "bus.yaml").write_text(f"nodes: [{{ traffic: [{{ dbc: {file}, message: "
                                           f"EngineSpeed, signals: {{ speed: {number} }} }}] }}]")
        assert f"speed: {number} is too great for 32 bits" in \
            restbus(tmp_path / "bus.yaml", status=1).stderr


def test_a_configuration_in_another_encoding_is_refused(tmp_path):
    (tmp_path / "bus.yaml").write_bytes(BUS.encode() + b"# \xe4\n")
    result = restbus("bus.yaml", status=1, cwd=tmp_path)
    assert result.stderr == "bus.yaml:15:3: this is not UTF-8\n"


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00\x00", b"\x7fELF", b"BO_ 1 A: 8"])
def test_what_is_no_database_is_refused(tmp_path, content):
    (tmp_path / "a.dbc").write_bytes(content)
    result = restbus("a.dbc", status=1, cwd=tmp_path)
    assert result.stderr.startswith("canwire-restbus: a.dbc: ") and result.stdout == ""
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments, message", [
    (("none.dbc",), "canwire-restbus: none.dbc: No such file or directory"),
    ((ROOT / "README.md",), "canwire-restbus: "),
    ((CAR, "--without", "ENGIN"), "there is no node 'ENGIN' (did you mean 'ENGINE'?)"),
    ((CAR, "--without", "XYZ"), "there is no node 'XYZ'; it has DASH, ENGINE, GEARBOX"),
    ((CAR, "--only", "ENGINE", "--without", "ENGINE"), "no node is left that sends"),
    ((CAR, "--cycle", "EngineDat=1s"), "--cycle: no message 'EngineDat' is sent (did you mean "
                                       "'EngineData'?)"),
])
def test_bad_databases_and_names(arguments, message):
    assert message in restbus(*arguments, status=1).stderr


def test_without_cantools_it_says_how_to_get_it():
    result = subprocess.run([sys.executable, "-S", "-E", RESTBUS, CAR], capture_output=True,
                            text=True, check=False)
    assert result.returncode == 1
    assert "the Python package cantools is missing; install it with '" in result.stderr
    assert "pip install cantools pyyaml'" in result.stderr


def test_it_runs_from_a_checkout(tmp_path):
    path = f"{os.path.dirname(sys.executable)}:{os.environ['PATH']}"
    shown = subprocess.run([ROOT / "scripts/canwire-restbus", CAR], capture_output=True, text=True,
                           check=False, cwd=tmp_path, env={**os.environ, "PATH": path})
    assert (shown.returncode, shown.stdout) == (0, restbus(CAR).stdout), shown.stderr


def test_a_bit_rate_has_the_limits_of_the_configuration():
    shown = restbus(f"{NETWORK}.kcd", "--bitrate", 1, status=2)
    assert "--bitrate: expected 5000..1000000, not 1" in shown.stderr


def test_a_value_that_is_rounded_is_a_warning(tmp_path):
    entries = "- { message: EngineSpeed, signals: { speed: 1234.4321 } }"
    resolved(tmp_path, entries, f"{NETWORK}.kcd")
    shown = restbus(tmp_path / "entries.yaml")
    assert "speed: 1234.4321 is sent as 1234.5: its resolution is " in shown.stderr
