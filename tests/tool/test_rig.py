# SPDX-License-Identifier: MIT
"""Rigs: several buses in one virtual time, and the gateways between them."""

import json
import struct
from xml.etree import ElementTree

import jsonschema
import pytest
import yaml

from simtool import ROOT, SCHEMAS, canwire, sim

pytestmark = pytest.mark.kept

SCHEMA = json.loads((SCHEMAS / "canwire-rig.schema.json").read_text())
EXAMPLE = ROOT / "config/rig/rig.yaml"
BODY = """bus: { name: body, bitrate: 125000 }
nodes:
  - { name: sender, traffic: [ %s ] }
  - { name: gw, queue: %d }
  - { name: other }
"""
TRAIN = """bus: { name: train, bitrate: 500000 }
nodes:
  - { name: sender, traffic: [ %s ] }
  - { name: gw, queue: %d }
  - { name: other }
"""
HEAD = "buses: [ body.yaml, train.yaml ]\ngateways:\n"
GATEWAY = '  - { name: %s, between: [ "body:%s", "train:%s" ], rules: [ %s ] }\n'


def write(folder, gateways, body="", train="", queue=16):
    (folder / "body.yaml").write_text(BODY % (body, queue))
    (folder / "train.yaml").write_text(TRAIN % (train, queue))
    (folder / "rig.yaml").write_text(gateways)
    return folder / "rig.yaml"


def events_of(file, *arguments):
    return [json.loads(line)
            for line in sim(file, *arguments, "--events", "-").stdout.splitlines()]


def stats_of(file, *arguments):
    return json.loads(sim(file, *arguments, "--stats", "-").stdout)


def without_bus(events, bus):
    return [{key: value for key, value in e.items() if key != "bus"}
            for e in events if e["bus"] == bus]


# ---- check ---------------------------------------------------------------------------------------

def test_check_tells_what_is_in_a_rig():
    lines = canwire("check", EXAMPLE).stdout.splitlines()
    assert lines[-1] == f"{EXAMPLE}: ok (rig, 2 buses, 1 gateway, 2 rules)"
    assert len(lines) == 3
    jsonschema.validate(yaml.load(EXAMPLE.read_text(), yaml.BaseLoader), SCHEMA)


RULE = GATEWAY % ("g", "gw", "gw", "%s")
# the text, the place and the message, and whether a schema can see it
WRONG = [
    ("", "1:1: the file is empty", None),
    ("gateways: []\nbuses: 1\n", "2:8: buses: ", False),
    ("buses: []\n", "1:8: buses: ", False),
    ("buses: [ none.yaml ]\n", "1:10: buses: there are errors in", True),
    ("buses: [ body.yaml, body.yaml ]\n", "1:21: buses: duplicate file", True),
    ("buses: [ body.yaml, ./body.yaml ]\n", "1:21: buses: duplicate bus 'body'", True),
    ("buses: [ body.yaml ]\ngates: []\n", "2:1: rig: unknown key 'gates'", False),
    (HEAD + "  - { name: g }\n", "3:5: gateway: ", False),
    (HEAD + GATEWAY % ("g", "gw", "gw", ""), "rules: ", False),
    (HEAD + GATEWAY % ("g", "gwx", "gw", "{}"), "3:27: between: there is no node 'gwx' on bus body "
     "(did you mean 'gw'?)", True),
    (HEAD + '  - { name: g, between: [ "body:gw", "trian:gw" ], rules: [ {} ] }\n',
     "3:38: between: there is no bus 'trian' (did you mean 'train'?)\n", True),
    (HEAD + '  - { name: g, between: [ "body:gw", "body:other" ], rules: [ {} ] }\n',
     "both nodes are on bus body", True),
    (HEAD + '  - { name: g, between: [ gw, "train:gw" ], rules: [ {} ] }\n',
     "3:27: between: expected BUS:NODE", False),
    (HEAD + GATEWAY % ("g", "gw", "gw", "{}") * 2, "duplicate gateway 'g'", True),
    (HEAD + RULE % "{ filter: 12345 }", "3:71: filter: ", None),
    (HEAD + RULE % "{ id: 12345 }", "3:67: id: ", False),
    (HEAD + RULE % "{ delay: 3bit }", "delay: bits of which bus?", False),
    (HEAD + RULE % "{ queue: 0 }", "queue: ", False),
    (HEAD + RULE % "{ direction: up }", "direction: ", False),
    (HEAD + RULE % "{ data: 1 }", "unknown key 'data'", False),
]


@pytest.mark.parametrize("text, message, valid", WRONG)
def test_errors_have_their_place(tmp_path, text, message, valid):
    file = write(tmp_path, text)
    told = canwire("check", file, status=1).stderr
    assert f"{file}:{message}" in told if message[0].isdigit() else message in told
    assert f"{file}:" in told
    if valid is not None:
        document = yaml.load(text, yaml.BaseLoader)
        schema = jsonschema.Draft202012Validator(SCHEMA)
        assert schema.is_valid(document) == valid


def test_an_error_in_the_file_of_a_bus_has_its_place(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{}")
    (tmp_path / "train.yaml").write_text("bus: { name: train, bitrate: 500000 }\nnodes: 3\n")
    told = canwire("check", file, status=1).stderr
    assert f"{tmp_path}/train.yaml:2:8: nodes: " in told


def test_a_port_belongs_to_one_bus(tmp_path):
    for name in "one", "two":
        (tmp_path / f"{name}.yaml").write_text(
            f"bus: {{ name: {name}, bitrate: 500000 }}\nnodes: [ {{ name: a, port: vcan9 }} ]\n")
    (tmp_path / "rig.yaml").write_text("buses: [ one.yaml, two.yaml ]\n")
    assert "1:20: buses: duplicate port 'vcan9'" in canwire("check", tmp_path / "rig.yaml",
                                                            status=1).stderr


def test_other_commands_say_that_a_rig_is_no_configuration():
    assert "is a rig: analyse its buses" in canwire("analyse", EXAMPLE, status=1).stderr


@pytest.mark.parametrize("first, second, loop", [
    ("{}", "{}", True),
    ("{ filter: '123', direction: forward }", "{ filter: '123', direction: backward }", True),
    ("{ filter: '123', direction: forward }", "{ filter: '123', direction: forward }", False),
    ("{ filter: '123', direction: forward }", "{ filter: '124', direction: backward }", False),
    ("{ filter: '100:700', id: '200', direction: forward }",
     "{ filter: '200', id: '1FF', direction: backward }", True),
    ("{ filter: '123', id: '200', direction: forward }",
     "{ filter: '200', id: '1FF', direction: backward }", False),
    ("{ filter: '123', id: '200', direction: forward }",
     "{ filter: '200', id: '00000123', direction: backward }", False),
    ("{ filter: '123', direction: forward }", "{ filter: '~123', direction: backward }", False),
    ("{ filter: '123', direction: forward }",
     "{ filter: '123', id: '300', direction: backward }, { direction: backward }", False),
    ("{ filter: '100:700', direction: forward }", "{ filter: '003:003', direction: backward }",
     True),
])
def test_a_loop_of_two_gateways_is_told(tmp_path, first, second, loop):
    file = write(tmp_path, HEAD + GATEWAY % ("one", "gw", "gw", first) +
                 GATEWAY % ("two", "other", "other", second))
    told = canwire("check", file, status=1 if loop else 0)
    if loop:
        assert f"{file}:3:" in told.stderr and "a loop: " in told.stderr
        assert "through one, two, and one again" in told.stderr
    else:  # and it ends by itself
        write(tmp_path, file.read_text(), "{ send: '123#01' }, { send: '103#', offset: 5ms }",
              "{ send: '123#02' }, { send: '1FF#', offset: 5ms }")
        events_of(file)


@pytest.mark.parametrize("first, second, nodes, loop", [
    # a rule that the frame takes twice, with another identifier each time
    ("{ filter: [ '100', '200' ], direction: forward }",
     "{ filter: '100', id: '200', direction: backward }, "
     "{ filter: '200', id: '100', direction: backward }", "", True),
    # two earlier rules leave nothing
    ("{ filter: '100:700', direction: forward }",
     "{ filter: '100:780', id: '300', direction: backward }, "
     "{ filter: '180:780', id: '300', direction: backward }, { direction: backward }", "", False),
    # ... or one frame, since filters overlap
    ("{ filter: '100:7F0', direction: forward }",
     "{ filter: [ '100:7F8', '~10F:7FF' ], id: '300', direction: backward }, "
     "{ direction: backward }", "", True),
    # the filter of a node counts
    ("{ filter: '123', direction: forward }", "{ direction: backward }", "filter: '~123'", False),
    # and so does what its controller sends
    ("{ filter: '00000123', direction: forward }", "{ direction: backward }", "kind: 2.0B-passive",
     False),
    # mailboxes count: those of the node that receives
    *[("{ filter: '123', direction: forward }", "{ direction: backward }",
       f"controller: {{ model: full, mailboxes: [ {boxes}, {{ direction: tx }} ] }}", loop)
      for boxes, loop in [
          ("{ direction: rx, id: '100:700' }", True),
          ("{ direction: rx, id: '200:700' }, { direction: rx, id: '~123' }", False),
          ("{ direction: tx }", False)]],
    # ... and of the one that sends
    *[("{ filter: '123', direction: backward }", "{ direction: forward }",
       f"controller: {{ model: full, mailboxes: [ {boxes} ] }}", loop)
      for boxes, loop in [("{ direction: tx, id: '100:700' }", True),
                          ("{ direction: tx, id: '321' }", False),
                          ("{ direction: tx, id: '321' }, { direction: tx, id: '123' }", True),
                          ("{ direction: tx, id: '123', reply: auto }", False)]],
    # ... also of frames whose identifier a rule sets
    *[("{ filter: '100', direction: forward }", "{ id: '100', direction: backward }",
       f"controller: {{ model: full, mailboxes: [ {{ direction: rx, id: '{number}' }} ] }}", loop)
      for number, loop in [("100", True), ("101", False)]],
    *[("{ filter: '100', direction: backward }", "{ id: '100', direction: forward }",
       f"controller: {{ model: full, mailboxes: [ {{ direction: tx, id: '{number}' }} ] }}", loop)
      for number, loop in [("100", True), ("101", False)]],
    # in loopback it sends none
    ("{ filter: '123', direction: forward }", "{ direction: backward }", "loopback: on", False),
])
def test_loops_are_found_frame_by_frame(tmp_path, first, second, nodes, loop):
    file = write(tmp_path, HEAD + GATEWAY % ("one", "gw", "gw", first) +
                 GATEWAY % ("two", "other", "other", second))
    train = tmp_path / "train.yaml"
    train.write_text(train.read_text().replace("name: other", f"name: other, {nodes}")
                     if nodes else train.read_text())
    told = canwire("check", file, status=1 if loop else 0).stderr
    assert ("a loop: a frame such as " in told) == loop


def test_a_node_in_loopback_hears_what_its_gateway_sends(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{ filter: '123' }")
    for name in "body", "train":
        bus = tmp_path / f"{name}.yaml"
        bus.write_text(bus.read_text().replace("name: gw", "name: gw, loopback: on"))
    assert "123# goes round for ever" in canwire("check", file, status=1).stderr


def test_a_gateway_in_both_directions_is_no_loop(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{}", "{ send: '123#01' }", "{ send: '200#02' }")
    sent = [(e["bus"], e["node"], e["frame"]) for e in events_of(file) if e["event"] == "tx"]
    assert sorted(sent) == [("body", "gw", "200#02"), ("body", "sender", "123#01"),
                            ("train", "gw", "123#01"), ("train", "sender", "200#02")]


# ---- sim -----------------------------------------------------------------------------------------

LOAD = ", ".join(f"{{ send: '{i:03X}#{i:06X}', every: {9 + i % 7}ms, offset: {i % 50}00us }}"
                 for i in range(0x100, 0x180, 5))


def test_buses_without_gateways_are_those_of_their_files(tmp_path):
    file = write(tmp_path, "buses: [ body.yaml, train.yaml ]\n", LOAD, LOAD)
    together = events_of(file, "--until", "200ms")
    for bus in "body", "train":
        assert without_bus(together, bus) == events_of(tmp_path / f"{bus}.yaml", "--until", "200ms")
    assert all(a["t"] <= b["t"] for a, b in zip(together, together[1:]))


def test_an_airbag_comes_to_the_safety_bus_in_time():
    """The gateway has 050#01 at 5.440 ms. 020#01 follows 100 us later, on a bus at rest."""
    got = [e for e in events_of(EXAMPLE, "--until", "20ms")
           if e.get("frame") in ("050#01", "020#01")]
    body = [e for e in got if e["bus"] == "body"]
    raw = canwire("bits", "020#01", "--raw").stdout.strip()
    assert {e["t"] for e in body if e["event"] == "rx"} == {0.00544}
    assert [e["t"] for e in got if e["bus"] == "powertrain" and e["event"] == "tx"] == [
        round(0.00554 + len(raw) * 2e-6, 9)]


@pytest.mark.parametrize("delay", ["0us", "370us", "5ms", "1234567ns"])
def test_the_far_bus_is_as_if_its_gateway_sent_by_itself(tmp_path, delay):
    file = write(tmp_path, HEAD + RULE % (f"{{ filter: '100:7E0', delay: {delay}, queue: 1024, "
                                          "direction: backward }"), LOAD, LOAD, queue=64)
    together = events_of(file, "--until", "100ms")
    assert events_of(file, "--until", "100ms", "--step") == together
    nano = {"0us": 0, "370us": 370000, "5ms": 5000000}.get(delay, 1234567)
    entries = []
    for e in together:
        if e["bus"] == "train" and e["node"] == "gw" and e["event"] == "rx":
            if int(e["frame"][:3], 16) & 0x7E0 == 0x100:
                at = round(e["t"] * 1e9) + nano
                entries.append(f"{{ send: '{e['frame']}', offset: {at}ns }}")
    assert len(entries) > 20
    traffic = f"queue: 64, traffic: [ {', '.join(entries)} ]"
    alone = (BODY % (LOAD, 64)).replace("queue: 64", traffic)
    (tmp_path / "alone.yaml").write_text(alone)
    assert without_bus(together, "body") == events_of(tmp_path / "alone.yaml", "--until", "100ms")


def test_loss_at_the_far_queue_is_counted(tmp_path):
    """A power train at full load is more than a body bus can carry."""
    file = write(tmp_path, HEAD + RULE % "{ queue: 1024 }", "",
                 "{ send: '123#0011223344556677', every: 250us, count: 400 }", queue=4)
    stats = stats_of(file)
    body = {n["name"]: n for n in stats["buses"][0]["nodes"]}
    side = stats["gateways"][0]["backward"]
    assert side["rules"] == [{"rule": 0, "forwarded": 400, "lost": 0}]
    assert side["dropped"] == body["gw"]["dropped"]["queue-full"] > 200
    assert body["gw"]["tx_frames"] + side["dropped"] == 400
    assert len([e for e in events_of(file) if e["event"] == "drop"]) == side["dropped"]
    assert stats["gateways"][0]["forward"]["dropped"] == 0


def test_an_overrun_shows_its_frame(tmp_path):
    file = write(tmp_path, "buses: [ body.yaml ]\n", "{ send: '123#A5', every: 1ms, count: 3 }")
    body = tmp_path / "body.yaml"
    body.write_text(body.read_text().replace(
        "name: other", "name: other, controller: { model: basic, service-time: 9ms }"))
    lost = [e for e in events_of(file) if e["event"] == "overrun"]
    assert [e["frame"] for e in lost] == 2 * ["123#A5"]
    assert without_bus(events_of(file), "body") == events_of(body)


def test_an_improper_arbitration_shows_its_frame(tmp_path):
    file = write(tmp_path, "buses: [ body.yaml ]\n", "{ send: '7FF#A5' }, { send: '100#5A' }")
    body = tmp_path / "body.yaml"
    body.write_text(body.read_text().replace("name: sender", "name: sender, order: fifo").replace(
        "name: other", "name: other, traffic: [ { send: '300#' } ]"))
    together = events_of(file)
    assert [e["frame"] for e in together if e["event"] == "improper-arbitration"]
    assert without_bus(together, "body") == events_of(body)


@pytest.mark.parametrize("step", [[], ["--step"]])
def test_events_at_one_time_are_in_the_order_of_the_buses(tmp_path, step):
    """A frame that comes in at a tick and finds no room is dropped at that tick."""
    file = write(tmp_path, HEAD + RULE % "{ direction: backward }", "",
                 "{ send: '123#', every: 192us, count: 12 }", queue=1)
    events = events_of(file, *step)
    at = [(e["t"], ("body", "train").index(e["bus"])) for e in events]
    assert at == sorted(at)
    drops = {e["t"] for e in events if e["event"] == "drop"}
    assert drops and drops < {e["t"] for e in events if e["event"] == "rx" and e["bus"] == "train"}


def test_the_last_bit_has_the_drops_of_its_frames(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{ direction: backward }", "",
                 "{ send: '123#', every: 192us, count: 12 }", queue=1)
    events = events_of(file)
    last = max(e["t"] for e in events if e["event"] == "drop")
    assert events_of(file, "--until", f"{round(last * 1e9)}ns") == [
        e for e in events if e["t"] <= last]


def test_loss_in_the_queue_of_a_rule_is_counted(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{ queue: 2, delay: 10ms }",
                 "", "{ send: '123#', every: 1ms, count: 40 }")
    side = stats_of(file)["gateways"][0]["backward"]
    assert side["rules"] == [{"rule": 0, "forwarded": 8, "lost": 32}] and side["dropped"] == 0


@pytest.mark.parametrize("rule, received", [
    ("{ filter: '123', id: '00000123' }", "00000123#AA"), ("{ filter: '123' }", "123#AA"),
    ("{ filter: '124' }", None), ("{ filter: '123', id: '7FF' }, { id: '100' }", "7FF#AA")])
def test_the_first_rule_that_matches_decides(tmp_path, rule, received):
    file = write(tmp_path, HEAD + RULE % rule, "{ send: '123#AA' }")
    got = [e["frame"] for e in events_of(file) if e["bus"] == "train" and e["node"] == "other"]
    assert got == ([received] if received else [])


def test_rules_and_replies_send_in_time(tmp_path):
    """Frames that rules send come to a bus without a word before."""
    file = write(tmp_path, HEAD + RULE % "{ direction: backward }",
                 "{ reply: '300#01', to: '200' }", "")
    with open(tmp_path / "train.yaml", "a", encoding="utf-8") as train:
        train.write("faults:\n"
                    "  - { name: s, when: { time: 3ms }, do: { send: '200#', as: other } }\n")
    sent = [(e["node"], e["frame"]) for e in events_of(file, "--until", "20ms")
            if e["event"] == "tx"]
    assert sent == [("other", "200#"), ("gw", "200#"), ("sender", "300#01")]


def test_expectations_of_each_bus_are_judged(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{}", "{ send: '123#' }")
    with open(tmp_path / "train.yaml", "a", encoding="utf-8") as train:
        train.write("expect: [ { delivered: 2, frame: 124 } ]\n")
    sim(file, status=3)


def test_endless_traffic_needs_an_end_and_bits_have_no_length(tmp_path):
    assert "never ends" in sim(EXAMPLE, status=1).stderr
    assert "several lengths" in sim(EXAMPLE, "--until", "3bit", status=2).stderr


def test_no_output_is_an_input(tmp_path):
    file = write(tmp_path, HEAD + RULE % "{}", "{ send: '123#' }")
    before = (tmp_path / "body.yaml").read_text()
    sim(file, "--events", tmp_path / "body.yaml", status=1)
    sim(file, "--log", file, status=1)
    assert (tmp_path / "body.yaml").read_text() == before


# ---- Outputs of all buses ------------------------------------------------------------------------

def test_a_capture_has_the_nodes_of_all_buses(tmp_path):
    file = write(tmp_path, HEAD + GATEWAY % ("g", "gw", "gw", '{ filter: "123" }'),
                 body="{ send: 123#44, count: 2, every: 10ms }")
    sim(file, "--pcapng", tmp_path / "c.pcapng")
    data = (tmp_path / "c.pcapng").read_bytes()
    for name in ("body:sender", "body:gw", "train:gw", "train:other"):
        assert name.encode() in data
    packets, at = [], 0
    while at < len(data):
        kind, length = struct.unpack_from("<II", data, at)
        if kind == 6:  # an enhanced packet block: interface, time, and the CAN identifier
            interface, high, low = struct.unpack_from("<III", data, at + 8)
            packets.append((interface, high << 32 | low,
                            struct.unpack_from(">I", data, at + 28)[0]))
        at += length
    whole = [e for e in events_of(file) if e["event"] == "tx"]
    nodes = {("body", "sender"): 0, ("train", "gw"): 4}
    assert packets == [(nodes[e["bus"], e["node"]], round(e["t"] * 1e9), 0x123) for e in whole]
    assert len(packets) == 4


def test_junit_has_a_suite_for_each_bus(tmp_path):
    file = write(tmp_path, HEAD + GATEWAY % ("g", "gw", "gw", '{ filter: "123" }'),
                 body="{ send: 123#44, count: 2, every: 10ms }")
    for bus, wanted in (("body", "yes"), ("train", "never")):
        path = tmp_path / f"{bus}.yaml"
        path.write_text(path.read_text() + f'expect: [ {{ seen: {wanted}, frame: "123" }} ]\n')
    sim(file, "--junit", tmp_path / "j.xml", status=3)
    root = ElementTree.parse(tmp_path / "j.xml").getroot()
    assert (root.get("tests"), root.get("failures")) == ("2", "1")
    assert [(s.get("name"), s.get("failures")) for s in root] == [("body", "0"), ("train", "1")]
    assert len(root[1][0]) == 1


def test_a_summary_tells_what_gateways_have_lost(tmp_path):
    file = write(tmp_path, HEAD + GATEWAY % ("g", "gw", "gw",
                                             '{ filter: "123", delay: 1s, queue: 2 }'),
                 body="{ send: 123#44, count: 5, every: 10ms }")
    assert "gateway g: body:gw to train:gw: forwarded 2 lost 3 dropped 0\n" in sim(file).stdout


@pytest.mark.parametrize("option", ["--vcd", "--svg"])
def test_what_a_rig_has_not_is_refused(tmp_path, option):
    error = sim(EXAMPLE, option, tmp_path / "x", status=2).stderr
    assert "bits of several lengths are not in one --vcd or --svg" in error
    assert "for those of one bus run its own file" in error


@pytest.mark.parametrize("text, awaited", [
    ("rx:020", {"event": "rx", "frame": "020#01"}),
    ("body:rx", {"event": "rx", "bus": "body"}),
    ("powertrain:gateway:tx", {"event": "tx", "bus": "powertrain", "node": "gateway"}),
    ("airbag:rx:400", {"event": "rx", "bus": "body", "node": "airbag", "frame": "400#00"}),
    ("body:airbag:tx:050", {"event": "tx", "bus": "body", "frame": "050#01"}),
    ("powertrain:tx", {"event": "tx", "bus": "powertrain"})])
def test_a_run_ends_with_an_event_of_any_bus(text, awaited):
    """All that comes up to its tick is there, and nothing behind it, on the other bus either."""
    whole = events_of(EXAMPLE, "--until", "100ms")
    end = next(e["t"] for e in whole if awaited.items() <= e.items())
    assert events_of(EXAMPLE, "--until-event", text) == [e for e in whole if e["t"] <= end]
    assert stats_of(EXAMPLE, "--until-event", text) == stats_of(
        EXAMPLE, "--until", f"{round(end * 1e9)}ns")


def test_an_event_that_does_not_come_is_told():
    told = sim(EXAMPLE, "--until-event", "body:bus-off", "--until", "20ms", "--events", "-")
    assert "--until-event body:bus-off: it did not happen" in told.stderr
    assert told.stdout == sim(EXAMPLE, "--until", "20ms", "--events", "-").stdout
    for text, message in (("explosion", "there is no event 'explosion'"),
                          ("powertrain:door:tx", "there is no node 'door': there is engine, "),
                          ("body:explosion", "there is no event 'explosion'")):
        assert message in sim(EXAMPLE, "--until-event", text, status=1).stderr


def test_captures_and_synchronisations_are_those_of_each_bus(tmp_path):
    file = write(tmp_path, "buses: [ body.yaml, train.yaml ]\n", LOAD, LOAD)
    for bus, ppm in ("body", 300), ("train", -700):
        path = tmp_path / f"{bus}.yaml"
        path.write_text(path.read_text().replace(
            "name: other", f"name: other, ppm: {ppm}, local-time: {{ unit: 1us }}"))
    for options in (["--captures"], ["--sync"], ["--captures", "--sync"], []):
        got = events_of(file, "--until", "50ms", *options)
        for option, event in ("--captures", "capture"), ("--sync", "sync"):
            assert any(e["event"] == event for e in got) == (option in options)
        for bus in "body", "train":
            alone = events_of(tmp_path / f"{bus}.yaml", "--until", "50ms", *options)
            assert without_bus(got, bus) == alone
