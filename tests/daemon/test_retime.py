# SPDX-License-Identifier: MIT
"""Clocks and bit timings that change while the bus runs, and a journal that has the same run.

Nodes have traffic of their own here, so this needs no CAN in the kernel. CANWIRE and CANWIRED are
the programs.
"""

import json
import subprocess

import pytest

from simtool import CANWIRE, journal_lines, kill_all, sim
from test_daemon import Daemon
from test_record import PATIENCE_S, wait_until

BUS = """bus: { name: day, bitrate: 500000, sample-point: 80% }
control: day.sock
seed: 7
nodes:
  - name: engine
    ppm: 200
    position: 12m
    tx-delay: 120ns
    traffic: [ { send: 123#DEADBEEF, every: 1ms, jitter: 100us } ]
  - name: dash
    rx-delay: { dominant: 120ns, recessive: 180ns }
    traffic: [ { send: 100#00FF00FF00FF, every: 3ms } ]
  - { name: brake, triple-sampling: on }
faults:
  - { name: hum, do: { jitter: 400ns, at: [engine] } }
  - name: needle
    when: { frame: "123", every: 7 }
    do: { pulse: dominant, from: "data[1.2]", offset: 30%, for: 900ns }
"""
PLAIN = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 1ms } ] }
  - { name: dash }
"""


def assert_is_part(live, whole):
    """A client that was slow is told how many events it has not got."""
    at = whole.index(live[0])
    for line in live:
        if line.startswith('{"lost":'):
            at += json.loads(line)["lost"]
        else:
            assert whole[at] == line
            at += 1


class Watched:
    """A bus with a journal, and the events of its live run from a moment on."""

    def __init__(self, folder, text):
        self.bus = Daemon(folder, "--journal", "day.journal", text=text)
        self.bus.wait_ready()
        self.live = folder / "live"
        with self.live.open("w") as out:
            self.watch = subprocess.Popen([CANWIRE, "watch", "./day.sock", "--json"], cwd=folder,
                                          stdout=out, stderr=subprocess.DEVNULL)
        self.wait_events(20)

    def count(self, event):
        return self.live.read_text().count(f'"event":"{event}"')

    def wait_events(self, number):
        """Waits for so many further events."""
        before = self.live.read_text().count("\n")
        wait_until(lambda: self.live.read_text().count("\n") >= before + number, "events")

    def set(self, *words):
        return self.bus.canwire("set", "./day.sock", *words)

    def refused(self, *words):
        """Returns the message about settings that are refused."""
        done = subprocess.run([CANWIRE, "set", "./day.sock", *words], cwd=self.bus.folder,
                              capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode == 1, done.stderr
        return done.stderr.strip()

    def reload(self, *changes):
        """Puts other texts into the configuration and reloads it."""
        path = self.bus.folder / "bus.yaml"
        text = path.read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        self.bus.canwire("reload", "./day.sock")

    def end(self):
        """Ends it, and checks that its journal gives the same events. Returns its lines."""
        self.bus.stop()
        self.watch.wait(PATIENCE_S)
        journal = self.bus.folder / "day.journal"
        live = self.live.read_text()
        assert live.count("\n") > 20
        again = sim("--journal", journal, "--events", "-").stdout
        assert_is_part(live.splitlines(), again.splitlines())
        assert sim("--journal", journal, "--events", "-").stdout == again
        return journal_lines(journal)


@pytest.fixture(name="watched")
def fixture_watched(tmp_path):
    started = []

    def start(text=BUS):
        started.append(Watched(tmp_path, text))
        return started[-1]

    yield start
    kill_all(process for each in started for process in (each.bus.process, each.watch))


def test_clocks_pulses_jitter_and_settings_are_in_the_journal(watched):
    run = watched()
    run.set("engine", "ppm=-300")
    run.wait_events(30)
    run.set("engine", "sjw=2", "berr-reporting=on", "triple-sampling=on")
    run.set("brake", "sample-point=0.7")
    run.set("dash", "rx-delay=120ns/180ns", "position=30m", "stub=50cm", "ringing=90ns")
    run.wait_events(30)
    run.set("brake", "tx-delay=60ns")
    run.bus.canwire("inject", "./day.sock",
                    "{ name: damp, do: { set: engine, ringing: 150ns, position: 2m, "
                    "rx-delay: { dominant: 50ns, recessive: 75ns } } }")
    run.bus.canwire("inject", "./day.sock",
                    "{ name: warm, do: { set: dash, ramp: { ppm: 0..900, over: 20ms } } }")
    run.wait_events(30)
    run.bus.canwire("inject", "./day.sock", "{ name: cold, do: { set: dash, ppm: -900 } }")
    run.wait_events(30)
    settings = [line["settings"] for line in run.end() if "set" in line]
    assert settings == [{"ppm": "-300"},
                        {"berr-reporting": True, "sjw": "2", "triple-sampling": "on"},
                        {"sample-point": "0.700"},
                        {"rx-delay": "120ns/180ns", "position": "30000mm", "stub": "500mm",
                         "ringing": "90ns"},
                        {"tx-delay": "60ns"}]


def test_a_clock_that_is_far_off_makes_errors_and_the_right_one_none(watched):
    run = watched(PLAIN.replace("traffic", "restart-ms: 1, traffic"))
    assert run.count("error") == 0
    run.set("dash", "ppm=60000")
    wait_until(lambda: run.count("error") > 20, "errors")
    run.set("dash", "ppm=0")
    wait_until(lambda: run.bus.status()["nodes"][0]["state"] == "error-active", "health")
    errors = run.bus.status()["nodes"][1]["errors"]
    run.wait_events(30)
    assert run.bus.status()["nodes"][1]["errors"] == errors
    run.end()


def test_synchronisations_are_watched_only_when_named(watched):
    """A client that names no kinds sees none of those that another one has asked for."""
    run = watched()
    named = subprocess.Popen([CANWIRE, "watch", "./day.sock", "sync", "tx", "--json"],
                             cwd=run.bus.folder, stdout=subprocess.PIPE, text=True)
    wanted = {("sync", "hard"), ("sync", "resync"), ("tx", None)}
    seen = set()
    try:
        while not wanted <= seen:
            event = json.loads(named.stdout.readline())
            seen.add((event["event"], event.get("type")))
    finally:
        named.kill()
        named.wait()
    assert seen == wanted
    run.wait_events(30)
    assert run.count("sync") == 0
    assert not any("sync" in line for line in run.end())


def test_a_place_that_is_too_far_makes_errors_and_the_right_one_none(watched):
    run = watched(PLAIN.replace("traffic", "restart-ms: 1, traffic"))
    run.set("dash", "position=400m")
    wait_until(lambda: run.count("error") > 20, "errors")
    run.set("dash", "position=0")
    wait_until(lambda: run.bus.status()["nodes"][0]["state"] == "error-active", "health")
    errors = run.bus.status()["nodes"][1]["errors"]
    run.wait_events(30)
    assert run.bus.status()["nodes"][1]["errors"] == errors
    run.end()


def test_what_set_changed_stays_until_a_reload(watched):
    """brp changes the quantum, and the error of the clock stays."""
    run = watched()
    run.set("engine", "ppm=-300")
    run.set("engine", "brp=1", "prop-seg=60", "phase-seg1=67", "phase-seg2=32")
    run.wait_events(30)
    run.reload(("ppm: 200", "ppm: 100"))
    run.wait_events(30)
    assert [line["reload"][0]["text"].count("ppm: 100")
            for line in run.end() if "reload" in line] == [1]


QUIET = BUS[:BUS.index("faults:")] + """faults:
  - name: needle
    when: { frame: "123" }
    do: { pulse: dominant, from: "data[1.2]", offset: 45%, for: 300ns }
"""


@pytest.mark.parametrize("change", [("ppm: 200", "ppm: 60000"), ("12m", "400m"),
                                    ("sample-point: 80%", "sample-point: 51%")])
def test_a_reload_changes_time_at_once_and_the_journal_has_it(watched, change):
    """Each makes errors: a wrong clock, a way of 2 us, and a sample point inside the pulses."""
    run = watched(QUIET)
    assert run.count("error") == 0
    run.reload(change)
    wait_until(lambda: run.count("error") > 20, "errors")
    reloads = [line["reload"][0]["text"] for line in run.end() if "reload" in line]
    assert [change[1] in text for text in reloads] == [True]


WRONG = [
    (["ppm=100001"], "ppm: expected a whole number of millionths from -100000 to 100000, not "
                     "'100001'"),
    (["ppm=fast"], "ppm: expected a whole number of millionths from -100000 to 100000, not 'fast'"),
    (["clock=99999"], "clock: expected 100kHz to 1GHz, not '99999'"),
    (["brp=0"], "brp: expected a decimal integer 1..1024, not '0'"),
    (["sample-point=9%"], "sample-point: '9%': expected a part of the bit such as 87.5% or 0.875, "
                          "from 10% to 99.9%"),
    (["triple-sampling=3"], "triple-sampling: expected one of on, off, yes, no, true, false, not "
                            "'3'"),
    (["sjw=128"], "node engine: sjw would be 128, at most"),
    (["ppm=5", "sample-point=80%", "brp=2"], "node engine: sample-point: the segments say where "
                                             "it is; use one or the other"),
    (["one-shot=on", "brp=1024"], "node engine: a bit of the node would be too long or too short "
                                  "for this bus"),
    (["position=11km"], "position: expected a length of at most 10km, not '11km'"),
    (["stub=3"], "stub: expected a length of at most 10km, not '3'"),
    (["tx-delay=11ms"], "tx-delay: expected a time up to 10ms, or two as in 120ns/180ns, to "
                        "dominant and to recessive, not '11ms'"),
    (["rx-delay=1ns/"], "rx-delay: expected a time up to 10ms, or two"),
    (["ringing=1ns/2ns"], "ringing: expected a time up to 10ms, not '1ns/2ns'"),
    (["one-shot=on", "position=8km"], "node engine: no edge is under way and no wire rings for "
                                      "longer than 16 of the shortest bits"),
    (["controller=any"], "controller: change it in the configuration and reload"),
    (["pmm=3"], "there is no setting 'pmm' (did you mean 'ppm'?)"),
]


def test_wrong_values_change_nothing(watched):
    run = watched(PLAIN.replace("name: engine,", "name: engine, ppm: 0, brp: 10, prop-seg: 6, "
                                "phase-seg1: 6, phase-seg2: 3,"))
    for words, message in WRONG:
        assert message in run.refused("engine", *words)
    assert not run.bus.status()["nodes"][0]["settings"]["one-shot"]
    assert not [line for line in run.end() if "set" in line]


def test_a_node_without_keys_of_time_needs_all_segments(watched):
    run = watched(PLAIN)
    assert "prop-seg is missing" in run.refused("dash", "brp=2")
    run.set("dash", "brp=10", "prop-seg=6", "phase-seg1=6", "phase-seg2=3", "clock=80MHz")
    run.set("dash", "brp=11")
    run.end()


# ---- The data phase of CAN FD --------------------------------------------------------------------

FAST = """bus: { name: day, bitrate: 500000, dbitrate: 2000000 }
control: day.sock
nodes:
  - { name: engine, restart-ms: 1, traffic: [ { send: 123##1DEADBEEF0011223344, every: 1ms } ] }
  - { name: dash, controller: m_can }
  - { name: old, kind: fd-tolerant }
"""


def data_timing(bus, node):
    return bus.status()["nodes"][node]["data_timing"]


def test_the_status_says_what_nodes_make_of_can_fd(watched):
    run = watched(FAST)
    nodes = run.bus.status()["nodes"]
    assert [node["kind"] for node in nodes] == ["fd", "fd", "fd-tolerant"]
    assert all(node["protocol-exception"] for node in nodes)
    assert [node.get("fd-non-iso") for node in nodes] == [False, False, None]
    run.end()


def test_the_status_of_a_classical_bus_has_no_kinds(watched):
    run = watched(PLAIN)
    assert "kind" not in run.bus.status()["nodes"][0]
    run.end()


# Keys of a node, and what its data phase then has.
DATA = [
    (["dbrp=2", "dprop-seg=6", "dphase-seg1=7", "dphase-seg2=6", "dsjw=2"],
     {"dbrp": 2, "dbitrate": 2000000, "dsample-point": "0.700", "tdco": 28}),
    (["dsample-point=70%"], {"dbrp": 1, "dbitrate": 2000000, "dsample-point": "0.700"}),
    (["clock=40MHz", "sample-point=70%"],
     {"dbrp": 1, "dbitrate": 2000000, "dsample-point": "0.750"}),
    (["clock=40MHz", "dsample-point=60%", "sample-point=80%", "dsjw=4"],
     {"dbitrate": 2000000, "dsample-point": "0.600", "dsjw": 4}),
    (["dsjw=3", "tdc-mode=off"], {"dsjw": 3, "tdc-mode": "off"}),
    (["tdco=25"], {"tdc-mode": "auto", "tdco": 25}),
    (["tdc-mode=manual", "tdcv=9"], {"tdc-mode": "manual", "tdcv": 9, "tdco": 30}),
]


@pytest.mark.parametrize(("words", "has"), DATA)
def test_a_data_phase_is_the_same_by_set_and_by_configuration(watched, words, has):
    run = watched(FAST)
    before = data_timing(run.bus, 0)
    run.set("dash", *words)
    run.wait_events(30)
    by_set = run.bus.status()["nodes"][1]
    assert has.items() <= by_set["data_timing"].items()
    assert data_timing(run.bus, 0) == before
    run.reload(("dash,", "dash, " + ", ".join(word.replace("=", ": ") for word in words) + ","))
    run.wait_events(30)
    by_file = run.bus.status()["nodes"][1]
    for key in ("timing", "data_timing"):
        assert by_set[key] == by_file[key]
    settings = [line["settings"] for line in run.end() if "set" in line]
    assert [set(each) for each in settings] == [{word.split("=")[0] for word in words}]


def test_a_wrong_data_rate_makes_errors_and_the_right_one_none(watched):
    run = watched(FAST)
    assert run.count("error") == 0
    run.set("dash", "dbrp=2")
    wait_until(lambda: run.count("error") > 20, "errors")
    assert data_timing(run.bus, 1)["dbitrate"] == 1000000
    run.set("dash", "dbrp=1")
    wait_until(lambda: run.bus.status()["nodes"][0]["state"] == "error-active", "health")
    errors = run.bus.status()["nodes"][1]["errors"]
    run.wait_events(30)
    assert run.bus.status()["nodes"][1]["errors"] == errors
    run.end()


def test_a_clock_alone_changes_both_rates(watched):
    run = watched(FAST)
    run.set("dash", "clock=40MHz")
    node = run.bus.status()["nodes"][1]
    assert (node["timing"]["bitrate"], node["data_timing"]["dbitrate"]) == (250000, 1000000)
    run.end()


WRONG_DATA = [
    ("dash", ["dbrp=0"], "dbrp: expected a decimal integer 1..1024, not '0'"),
    ("dash", ["dsample-point=9%"], "dsample-point: '9%': expected a part of the bit such as"),
    ("dash", ["tdc-mode=on"], "tdc-mode: expected one of off, auto, manual, not 'on'"),
    ("dash", ["tdcv=0"], "tdcv: expected a decimal integer 1..65535, not '0'"),
    ("dash", ["tdcv=5"], "node dash: tdcv: only tdc-mode manual has it; auto measures it"),
    ("dash", ["tdc-mode=manual"], "node dash: tdcv is missing: tdc-mode manual needs it"),
    ("dash", ["tdc-mode=off", "tdco=5"], "node dash: tdco: tdc-mode is off; auto or manual"),
    ("dash", ["tdco=1280"], "node dash: tdco and tdcv together are less than 32 bits of the data "
                            "phase, here 1280 clocks"),
    ("dash", ["dbrp=33"], "node dash: data phase: brp would be 33, m_can has 1 to 32"),
    ("dash", ["dsjw=16"], "node dash: data phase: sjw would be 16, at most"),
    ("dash", ["dbrp=1", "dsample-point=70%"], "node dash: dsample-point: the segments say where it "
                                              "is; use one or the other"),
    ("dash", ["one-shot=on", "clock=3MHz", "sample-point=80%"], "node dash: data phase: the "
                                                                "nearest bit rate is 50.00 % off"),
    ("old", ["dsjw=1"], "node old: dsjw: only a node of kind fd has a data phase"),
    ("dash", ["kind=classical"], "kind: change it in the configuration and reload"),
    ("dash", ["fd=off"], "fd: change it in the configuration and reload"),
]


def test_a_wrong_data_phase_changes_nothing(watched):
    run = watched(FAST)
    before = run.bus.status()["nodes"]
    for node, words, message in WRONG_DATA:
        assert message in run.refused(node, *words)
    after = run.bus.status()["nodes"]
    assert not after[1]["settings"]["one-shot"]
    for key in ("timing", "data_timing"):
        assert after[1][key].items() >= {k: v for k, v in before[1][key].items()
                                         if k != "tdcv"}.items()
    assert not [line for line in run.end() if "set" in line]


def test_a_bus_without_a_data_rate_has_no_data_phase(watched):
    run = watched(PLAIN.replace("name: dash", "name: dash, kind: fd"))
    assert "dsjw: the bus has no data rate; bus: { dbitrate } gives it one" in run.refused(
        "dash", "dsjw=1")
    run.end()


def test_a_bus_goes_to_classical_frames_and_back(watched):
    """Bits that were shorter leave the ones behind them at any tick."""
    run = watched(FAST)
    run.wait_events(15)
    classical = [(", dbitrate: 2000000", ""), ("123##1DEADBEEF0011223344", "123#DEADBEEF"),
                 (", kind: fd-tolerant", "")]
    run.reload(*classical)
    run.wait_events(15)
    run.set("dash", "one-shot=on")
    run.wait_events(15)
    run.reload((" bitrate: 500000", " bitrate: 500000, dbitrate: 4000000"),
               ("123#DEADBEEF", "123##1DEADBEEF"))
    run.wait_events(15)
    run.end()
