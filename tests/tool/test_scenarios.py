# SPDX-License-Identifier: MIT
"""Scenarios: a configuration each, and the exact events that `canwire sim` must give for it.

The traces in tests/scenarios follow from the protocol digest by counting bits; they are not copied
from the tool. The comment at the top of each YAML file gives the reasons. A line `# arguments: ...`
in it is given to `canwire sim`. Needs no CAN in the kernel. CANWIRE is the tool, by default
build/release/canwire.
"""

import difflib
import functools
from pathlib import Path

import pytest

from simtool import ROOT, events, sim, stats

SCENARIOS = sorted((ROOT / "tests/scenarios").glob("*.yaml"))

BIT_NS = 2000  # the tests here run at 500 kbit/s
TX_BIT = 89  # end of EOF of 123#DEADBEEF when it starts first: 11 + 78 wire bits

SMALL = """
bus: { name: small, bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 123#DEADBEEF } ]
  - name: b
"""

# The flip acts on what a listener samples: it shows which frames were drawn, and no more happens.
RANDOM = """
bus: { name: random, bitrate: 500000 }
seed: 7
nodes:
  - name: a
    traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 200 } ]
  - name: b
  - name: c
    listen-only: on
faults:
  - { name: coin, when: { probability: 0.5 }, do: { flip: "data[0.0]", at: [c] } }
"""

ENDLESS = SMALL.replace("DEADBEEF", "DEADBEEF, every: 1ms")


def node_stats(report, name):
    return next(node for node in report["nodes"] if node["name"] == name)


# ---- Scenarios -----------------------------------------------------------------------------------


def arguments_of(path):
    for line in path.read_text().splitlines():
        if line.startswith("# arguments:"):
            return line.partition(":")[2].split()
    return []


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_scenario(path):
    expected = path.with_suffix(".events").read_text().splitlines()
    got = sim(path, *arguments_of(path), "--events", "-").stdout.splitlines()
    difference = list(difflib.unified_diff(expected, got, "expected", "canwire sim", lineterm=""))
    assert not difference, "\n" + "\n".join(difference[:60])


def test_every_trace_has_its_scenario():
    folder = ROOT / "tests/scenarios"
    assert SCENARIOS
    assert {p.stem for p in folder.glob("*.events")} == {p.stem for p in SCENARIOS}


def scenario(name):
    return ROOT / "tests/scenarios" / f"{name}.yaml"


@functools.cache
def stats_of(path):
    """A process of pytest counts a scenario once: equal runs have equal results."""
    return stats(path, *arguments_of(path))


# Expected statistics of scenarios: (scenario, node or None for the bus, key, value).
COUNTED = [
    ("blind-spot-seed", None, "undetected_errors", 2),
    ("blind-spot-seed", "b", "undetected_errors", 1),
    ("blind-spot-seed", "c", "undetected_errors", 1),
    ("blind-spot-constructed", None, "undetected_errors", 1),
    ("blind-spot-constructed", "b", "undetected_errors", 1),
    ("blind-spot-constructed", "c", "undetected_errors", 0),
    ("globalisation", None, "undetected_errors", 0),
    ("globalisation", None, "error_frames", 1),
    ("globalisation", "a", "retransmissions", 1),
    ("globalisation", "a", "tec", 7),
    ("globalisation", "b", "rec", 8),
    ("globalisation", "c", "rec", 0),
    ("inconsistent-reception", "b", "rx_frames", 1),
    ("inconsistent-reception", "c", "rx_frames", 2),
    ("doubling-wire", "a", "tx_frames", 1),
    ("doubling-wire", "b", "rx_frames", 2),
    ("doubling-receiver", "b", "rx_frames", 2),
    ("doubling-receiver", "c", "rx_frames", 1),
    ("doubling-receiver", "c", "rec", 8),  # 1 + 8, then a good frame
    ("faulty-node", "faulty", "bus_off", 1),
    ("faulty-node", "faulty", "error_passive", 1),
    ("faulty-node", "faulty", "error_warning", 1),
    ("faulty-node", "faulty", "retransmissions", 31),
    ("faulty-node", "b", "state", "error-active"),
    ("faulty-node", "c", "rec", 29),  # 32 errors, then three good frames
    ("bus-off-restart", "faulty", "restarts", 1),
    ("bus-off-restart", "faulty", "tec", 0),
    ("eight-to-one", "a", "tec", 0),
    ("eight-to-one", "a", "tx_frames", 24),
    ("listen-only", "listener", "rec", 0),
    ("lonely-node", "alone", "bus_off", 0),
    ("queue-full", "a", "queue_peak", 2),
    ("suspend-yields", "a", "retransmissions", 16),
    ("attack-double-receive", "b", "rx_frames", 8),  # of five messages
    ("attack-double-receive", "b", "rec", 0),
    ("attack-freeze-doom-loop", None, "overload_frames", 9),
    ("attack-freeze-doom-loop", None, "error_frames", 0),
    ("attack-freeze-doom-loop", "a", "tec", 0),
    ("attack-freeze-doom-loop", "c", "tec", 199),  # 200, then a frame of its own
    ("attack-error-passive-spoofing", "a", "tx_frames", 1),
    ("attack-error-passive-spoofing", "b", "rx_frames", 2),
    ("attack-error-passive-spoofing", "b", "rec", 14),  # 16 errors, then two good frames
    ("attack-bus-off-by-timing", "a", "bus_off", 1),
    ("attack-bus-off-by-timing", "c", "tec", 121),  # 127, then six frames
]


@pytest.mark.parametrize("name, node, key, value", COUNTED)
def test_statistics_of_scenarios(name, node, key, value):
    report = stats_of(scenario(name))
    assert (node_stats(report, node) if node else report["bus"])[key] == value


def test_drops_by_reason():
    faulty = node_stats(stats_of(scenario("bus-off-restart")), "faulty")
    assert faulty["dropped"]["bus-off"] == 3  # two queued, one before the request
    assert faulty["errors"]["bit"] == faulty["bus_errors"] == 32
    assert node_stats(stats_of(scenario("queue-full")), "a")["dropped"]["queue-full"] == 2


# ---- When a run ends -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "until, names",
    [
        ("178us", ["rx", "tx"]),  # an event at exactly TIME is written
        ("89bit", ["rx", "tx"]),
        ("177999ns", ["rx"]),
        ("176us", ["rx"]),
        ("175us", []),
        ("0s", []),
    ],
)
def test_until_is_inclusive(write, until, names):
    assert [e["event"] for e in events(write(SMALL), "--until", until)] == names


def test_a_run_ends_after_eleven_recessive_bits(write):
    # the ACK delimiter and the EOF are eight of them
    assert stats(write(SMALL))["bus"]["time_ns"] == (TX_BIT + 3) * BIT_NS


def test_until_goes_on_after_the_traffic(write):
    assert stats(write(SMALL), "--until", "1s")["bus"]["time_ns"] == 10**9


def test_endless_traffic_needs_until(write):
    path = write(ENDLESS)
    result = sim(path, "--events", "-", status=1)
    assert "--until" in result.stderr and str(path) in result.stderr
    assert result.stdout == ""
    assert len(events(path, "--until", "10ms")) == 2 * 10


IDLE = """
bus: { name: idle, bitrate: 500000 }
nodes:
  - name: a
    traffic: [ { send: 123#, count: 3, every: 1ms }, { send: 124#, offset: 9000000000s } ]
  - { name: b, restart-ms: 4000000000 }
faults:
  - { name: down, when: { time: 10ms }, do: { bus-off: b } }
  - { name: noisy, when: { time: 20ms }, do: { noise: 0.5, at: [b], for: 1ms } }
  - { name: late, when: { time: 8000000000s }, do: { send: 125#, as: a } }
"""


def test_three_centuries_of_an_idle_bus_are_skipped(write):
    """A run that looks in again and again would take hours for this."""
    path = write(IDLE)
    until = "10000000000s"
    found = [(e["t"], e["event"], e.get("node"), e.get("frame"))
             for e in events(path, "--until", until)]
    assert (4000000.01, "restart", "b", None) in found
    assert [f[0] // 1000000000 for f in found if f[3] == "125#" and f[1] == "tx"] == [8]
    assert [f[0] // 1000000000 for f in found if f[3] == "124#" and f[1] == "tx"] == [9]
    assert stats(path, "--until", until)["bus"]["bits"] == 5 * 10**15


def test_a_run_gives_up_after_ten_quiet_seconds(write):
    lonely = SMALL.replace("  - name: b\n", "")
    bus = stats(write(lonely))["bus"]
    assert 10 * 10**9 <= bus["time_ns"] <= 10 * 10**9 + 100 * BIT_NS
    assert bus["frames"] == 0 and bus["pending"] == 1


def test_pauses_under_ten_seconds_are_waited_for(write):
    text = SMALL.replace("DEADBEEF", "DEADBEEF, every: 9s, count: 3")
    sent = [e["t"] for e in events(write(text)) if e["event"] == "tx"]
    assert [round(t) for t in sent] == [0, 9, 18]


def test_a_longer_pause_ends_the_run(write):
    text = SMALL.replace("DEADBEEF", "DEADBEEF, every: 11s, count: 3")
    sent = [e["t"] for e in events(write(text)) if e["event"] == "tx"]
    assert [round(t) for t in sent] == [0]


def test_a_bus_without_traffic(write):
    silent = "bus: { name: silent, bitrate: 500000 }\nnodes: [ { name: a } ]\n"
    assert stats(write(silent))["bus"]["bits"] == 11
    assert events(write(silent)) == []


def many_at_once(frames, offset):
    sends = f"      - {{ send: 123#, offset: {offset} }}\n" * frames
    return (
        "bus: { name: many, bitrate: 500000 }\nnodes:\n"
        f"  - name: a\n    queue: 4096\n    traffic:\n{sends}  - name: b\n"
    )


@pytest.mark.parametrize("offset", ["0s", "25ns", "2us"])
def test_more_releases_at_once_than_can_be_noted_down(write, offset):
    sender = node_stats(stats(write(many_at_once(1500, offset))), "a")
    assert sender["tx_frames"] == sender["queue_peak"] == 1500


# ---- Seed ----------------------------------------------------------------------------------------


def drawn(*arguments):
    return [int(e["t"] * 1000) for e in events(*arguments) if e["event"] == "fault"]


def test_seed_decides_the_draws_and_repeats_them(write):
    path = write(RANDOM)
    own = drawn(path)
    assert 70 < len(own) < 130
    assert own == drawn(path)
    assert own == drawn(path, "--seed", 7)
    assert own != drawn(path, "--seed", 8)
    assert drawn(path, "--seed", 2**64 - 1) != drawn(path, "--seed", 0)


def test_the_whole_output_repeats(write):
    path = write(RANDOM)
    once, again = (sim(path, "--events", "-", "--log", "-", "--stats", "-").stdout for _ in "ab")
    assert once == again


# ---- Outputs -------------------------------------------------------------------------------------


def test_log_is_that_of_candump(write):
    text = SMALL.replace("{ send: 123#DEADBEEF }", """
      { send: 123#DEADBEEF }, { send: 12345678#, offset: 1ms }, { send: 7FF#R4, offset: 2ms },
      { send: 0#R, offset: 3ms }, { send: 001#1122334455667788_F, offset: 1234567us }""".replace(
        "0#R", "000#R"))
    lines = sim(write(text), "--log", "-").stdout.splitlines()
    assert lines[0] == "(0000000000.000178) a 123#DEADBEEF"
    assert [line.split()[2] for line in lines] == [
        "123#DEADBEEF", "12345678#", "7FF#R4", "000#R", "001#1122334455667788_F"]
    assert lines[4].startswith("(0000000001.2")


def test_log_names_the_port_of_a_node(write):
    # a node with a port has no traffic of its own; in sim it is there and acknowledges
    text = SMALL.replace("- name: b", "- { name: b, port: vcan7 }")
    assert [e["node"] for e in events(write(text))] == ["b", "a"]
    assert sim(write(text), "--log", "-").stdout.split()[1] == "a"


def test_times_are_nanoseconds_with_nine_decimals(write):
    lines = sim(write(SMALL), "--events", "-").stdout.splitlines()
    assert lines == [
        '{"t":0.000176000,"node":"b","event":"rx","frame":"123#DEADBEEF"}',
        '{"t":0.000178000,"node":"a","event":"tx","frame":"123#DEADBEEF"}',
    ]


def test_times_are_truncated(write):
    # a frame handed in a tick late is dropped at 12.5 ns: printed as 12
    text = SMALL.replace("- name: a", "- name: a\n    listen-only: on").replace(
        "DEADBEEF", "DEADBEEF, offset: 13ns")
    lines = sim(write(text), "--events", "-").stdout.splitlines()
    assert lines[0].startswith('{"t":0.000000025,"node":"a","event":"drop"')


def test_outputs_go_to_files(write, tmp_path):
    path = write(SMALL)
    names = {what: tmp_path / what for what in ("events", "log", "stats")}
    result = sim(path, *[word for what, name in names.items() for word in (f"--{what}", name)])
    assert result.stdout == "" and result.stderr == ""
    for what, name in names.items():
        assert name.read_text() == sim(path, f"--{what}", "-").stdout


def test_one_to_a_file_and_one_to_the_terminal(write, tmp_path):
    result = sim(write(SMALL), "--events", tmp_path / "e", "--log", "-")
    assert result.stdout == "(0000000000.000178) a 123#DEADBEEF\n"
    assert len((tmp_path / "e").read_text().splitlines()) == 2


def test_a_summary_when_nothing_else_is_wanted(write):
    out = sim(write(SMALL)).stdout
    assert "small" in out and "1 frame," in out
    assert [line.split()[0] for line in out.splitlines()[-2:]] == ["a", "b"]


def assert_balance(node):
    """Checks that every frame of a node was sent, waits, or was dropped for a named reason."""
    assert node["handed_in"] + node["made_by_rules"] == (
        node["tx_frames"] + node.get("stored", 0) + node["queue"] + node["held"] +
        sum(node["dropped"].values())), node
    assert node["rx_accepted"] + node["rx_made_by_rules"] == (
        node["rx_frames"] + node["rx_held"] + sum(node["rx_dropped"].values())), node


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_no_frame_is_unaccounted_for(path):
    for node in stats_of(path)["nodes"]:
        assert_balance(node)


def test_statistics_have_bus_nodes_and_rules(write):
    report = stats(write(RANDOM))
    assert list(report) == ["bus", "nodes", "rules"]
    assert [node["name"] for node in report["nodes"]] == ["a", "b", "c"]
    rule = report["rules"][0]
    assert rule["name"] == "coin" and rule["matches"] == 200
    assert rule["hits"] == report["bus"]["faults"] == len(drawn(write(RANDOM)))
    sender = node_stats(report, "a")
    assert sender["handed_in"] == sender["tx_frames"] == 200
    assert sender["delay"]["count"] == 200
    assert sender["delay"]["max_ns"] == TX_BIT * BIT_NS  # the first one waits for integration


# ---- Exit status ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments", [[], ["a.yaml", "b.yaml"], ["--nonsense", "a.yaml"], ["a.yaml", "--until"]]
)
def test_wrong_usage_is_status_two(arguments):
    assert "usage: canwire sim" in sim(*arguments, status=2).stderr


@pytest.mark.parametrize(
    "option, value",
    [("--until", "soon"), ("--until", "-1s"), ("--until", "10"), ("--seed", "x"), ("--seed", "-1"),
     ("--seed", "18446744073709551616"), ("--seed", "")],
)
def test_a_bad_value_is_status_one(write, option, value):
    assert f"{option} {value}" in sim(write(SMALL), option, value, status=1).stderr


def test_a_bad_configuration_is_status_one_and_says_where(write):
    path = write(SMALL.replace("bitrate", "bitrat"))
    result = sim(path, "--events", "-", status=1)
    assert f"{path}:2:" in result.stderr and "bitrat" in result.stderr
    assert result.stdout == ""


def test_a_missing_file_is_status_one(tmp_path):
    assert "no.yaml" in sim(tmp_path / "no.yaml", status=1).stderr


def test_an_output_that_cannot_be_opened_is_status_one(write, tmp_path):
    assert "nowhere" in sim(write(SMALL), "--log", tmp_path / "nowhere/log", status=1).stderr


def test_a_full_disk_is_status_one(write):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    assert "/dev/full" in sim(write(SMALL), "--events", "/dev/full", status=1).stderr


def test_help_is_status_zero():
    assert "--until" in sim("--help").stdout


def test_two_outputs_do_not_share_a_file(tmp_path):
    scenario = tmp_path / "small.yaml"
    scenario.write_text(SMALL)
    out = tmp_path / "out"
    result = sim(scenario, "--log", out, "--events", out, status=2)
    assert f"{out}: two outputs into one file" in result.stderr
    assert not out.exists()
    assert len(sim(scenario, "--log", "-", "--events", "-").stdout.splitlines()) > 2


# An output that is there already, with what a run that does not begin must leave in it.
REFUSED = {
    "traffic without end": (ENDLESS, [], 1),
    "a bad configuration": (SMALL.replace("bitrate", "bitrat"), [], 1),
    "another output that cannot be written": (SMALL, ["--junit", "/nowhere/out"], 1),
    "a picture that is known to be too long": (ENDLESS, ["--svg", "SVG", "--until", "1s"], 1),
    "a window behind the end": (ENDLESS, ["--svg", "SVG", "--until", "1ms", "--from", "2ms"], 1),
    "a window of nothing": (SMALL, ["--svg", "SVG", "--from", "1ms", "--to", "1ms"], 1),
    "no such node": (SMALL, ["--until-event", "c:tx"], 1),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_leaves_outputs_as_they_are(name, write, tmp_path):
    text, arguments, status = REFUSED[name]
    outputs = []
    for what in ("events", "log", "pcapng", "stats", "vcd"):
        (tmp_path / what).write_text("what was there")
        outputs += [f"--{what}", tmp_path / what]
    arguments = [tmp_path / "svg" if a == "SVG" else a for a in arguments]
    sim(write(text), *outputs, *arguments, status=status)
    assert {p.read_text() for p in tmp_path.iterdir() if p.name != "bus.yaml"} == {"what was there"}
    assert not (tmp_path / "svg").exists()


def test_an_output_is_written_from_its_start(write, tmp_path):
    (tmp_path / "out").write_text("what was there" * 1000)
    for what in ("events", "log", "pcapng", "stats", "vcd", "svg", "junit"):
        sim(write(SMALL), f"--{what}", tmp_path / "out")
        sim(write(SMALL), f"--{what}", tmp_path / "new")
        assert (tmp_path / "out").read_bytes() == (tmp_path / "new").read_bytes() != b""
        (tmp_path / "new").unlink()


def test_outputs_may_be_pipes(write):
    result = sim(write(SMALL), "--log", "/dev/stdout")
    assert result.stdout == "(0000000000.000178) a 123#DEADBEEF\n"
