# SPDX-License-Identifier: MIT
"""Nodes with clocks of their own, by the keys of a configuration."""

import json
import re

import pytest

from simtool import ROOT, canwire, sim

PLAIN = ""
SAME = "clock: 40MHz, sample-point: 80%"
WRONG = "clock: 16MHz, brp: 2, prop-seg: 4, phase-seg1: 5, phase-seg2: 6, ppm: 60000"


def config(keys_a, keys_b, name="can"):
    return f"""
bus: {{ name: {name}, bitrate: 500000 }}
nodes:
  - {{ name: a, {keys_a} }}
  - {{ name: b, {keys_b} }}
"""


def traffic(keys):
    sends = "traffic: [{ send: 123#00FF00FF00, every: 1ms, count: 9 }]"
    return keys + (", " if keys else "") + sends


@pytest.fixture(name="run")
def fixture_run(tmp_path):
    def run(text):
        path = tmp_path / "bus.yaml"
        path.write_text(text)
        return sim(path, "--events", "-", "--until", "20ms").stdout

    return run


def test_equal_clocks_change_no_event(run):
    plain = run(config(traffic(PLAIN), PLAIN))
    assert plain.count('"tx"') == 9
    assert run(config(traffic(SAME), SAME)) == plain


def test_a_clock_inside_of_the_tolerance_makes_no_error(run):
    out = run(config(traffic(SAME), SAME + ", ppm: 300"))
    assert out.count('"tx"') == 9 and '"error"' not in out


def test_a_clock_outside_of_the_tolerance_makes_errors(run):
    assert '"error"' in run(config(traffic(PLAIN), WRONG))



DRIFTED = config(traffic(SAME + ", ppm: 3000"), SAME)


def test_synchronisations_are_events_when_asked_for(tmp_path):
    """0.3 per cent of 10 bits of 80 quanta are 2.4: an edge comes 1 to 3 quanta early."""
    path = tmp_path / "bus.yaml"
    path.write_text(DRIFTED)
    plain = sim(path, "--events", "-", "--until", "20ms").stdout.splitlines()
    lines = sim(path, "--sync", "--events", "-", "--until", "20ms").stdout.splitlines()
    syncs = [json.loads(line) for line in lines if '"sync"' in line]
    assert [line for line in lines if '"sync"' not in line] == plain and '"sync"' not in str(plain)
    of_b = [event for event in syncs if event["node"] == "b"]
    hard = [event for event in of_b if event["type"] == "hard"]
    assert len(hard) == 9 and all("phase_error_tq" not in event for event in hard)
    resyncs = [event for event in of_b if event["type"] == "resync"]
    assert len(resyncs) > 9
    assert {event["phase_error_tq"] for event in resyncs} <= {-1, -2, -3}
    assert all(event["phase_error_ps"] == event["phase_error_tq"] * 25000 for event in resyncs)
    counted = stats_of(path)[1]
    assert counted["hard"] == len(hard) and counted["resync"] == len(resyncs)
    assert counted["phase_error_tq"] == min(event["phase_error_tq"] for event in resyncs)
    assert 0 < counted["margin_ps"] < 2000000


def stats_of(path):
    """Returns how the clocks of the nodes keep up in the statistics at the end of a run."""
    out = sim(path, "--stats", "-", "--until", "20ms").stdout
    return [node["synchronisation"] for node in json.loads(out)["nodes"]]


def test_statistics_of_equal_clocks_have_no_synchronisations(tmp_path):
    path = tmp_path / "bus.yaml"
    path.write_text(config(traffic(PLAIN), PLAIN))
    assert stats_of(path) == [None, None]


def test_a_synchronisation_can_be_awaited(tmp_path):
    path = tmp_path / "bus.yaml"
    path.write_text(DRIFTED)
    lines = sim(path, "--until-event", "b:sync", "--sync", "--events", "-").stdout.splitlines()
    assert json.loads(lines[-1]) == {"t": json.loads(lines[-1])["t"], "node": "b", "event": "sync",
                                     "type": "hard"}
    assert "sync" not in sim(path, "--until-event", "b:sync", "--events", "-").stdout


def test_synchronisations_without_events_are_refused(tmp_path):
    path = tmp_path / "bus.yaml"
    path.write_text(DRIFTED)
    assert "--sync: it is for --events" in sim(path, "--sync", status=2).stderr


JITTER = """
faults:
  - { name: hum, do: { jitter: 700ns, at: [a] } }
  - { name: needle, when: { frame: "123", probability: 0.5 },
      do: { pulse: dominant, from: "data[1.3]", offset: 60%, for: 900ns } }
"""


def test_one_seed_gives_one_run_and_another_one_another(run):
    def with_seed(seed):
        return run(f"seed: {seed}" + config(traffic(SAME), SAME + ", ppm: 300") + JITTER)

    first = with_seed(1)
    assert '"error"' in first
    assert with_seed(1) == first
    assert with_seed(2) != first


SETS = """
faults:
  - { name: warm, when: { time: 5ms, count: 1 }, do: { set: %s } }
"""


@pytest.mark.parametrize("keys", ["b, brp: 4", "b, ppm: 60000", "b, clock: 50MHz",
                                  "b, prop-seg: 5, phase-seg1: 2", "a, sample-point: 10%"])
def test_a_rule_changes_the_bits_of_a_node(run, keys):
    """The sample point becomes one before the node sees its own edges."""
    bit = "clock: 40MHz, brp: 5, prop-seg: 7, phase-seg1: 4, phase-seg2: 4, sjw: 1"
    out = run(config(traffic(bit) + ", tx-delay: 300ns", bit) + SETS % keys)
    before, after = out.split('"event":"fault"')
    assert '"error"' not in before and '"error"' in after


def test_a_rule_that_sets_what_is_brings_no_change(run):
    plain = run(config(traffic(SAME), SAME))
    same = run(config(traffic(SAME), SAME) + SETS % "b, ppm: 0, sample-point: 80%, clock: 40MHz")
    assert [line for line in same.splitlines() if '"fault"' not in line] == plain.splitlines()


def test_a_trace_of_nodes_with_clocks_of_their_own(tmp_path):
    path = tmp_path / "bus.yaml"
    path.write_text(config(traffic(SAME), SAME + ", ppm: 300, position: 12m"))
    done = sim(path, "--vcd", tmp_path / "v", "--svg", tmp_path / "s", "--to", "2ms")
    assert done.returncode == 0, done.stderr
    assert "$timescale" in (tmp_path / "v").read_text()
    assert "<svg" in (tmp_path / "s").read_text()


@pytest.mark.parametrize("bitrate, most", [(125000, 20), (125001, 30), (1000000, 30)])
def test_more_nodes_than_a_line_has_are_told(tmp_path, bitrate, most):
    path = tmp_path / "bus.yaml"
    for count, told in ((most, False), (most + 1, True), (64, True)):
        nodes = "".join(f"  - name: n{i}\n" for i in range(count))
        path.write_text(f"bus: {{ bitrate: {bitrate} }}\nnodes:\n{nodes}")
        error = canwire("check", path).stderr
        assert (f":3:3: warning: a line has at most {most} nodes by ISO 11" in error) == told


@pytest.mark.parametrize("termination, has_errors", [("both", False), ("one", False),
                                                     ("none", True)])
def test_a_line_without_terminators_rings(tmp_path, termination, has_errors):
    """Bits of 1 us are sampled after 750 ns. 30 m ring for 300 ns, or for 900 ns."""
    path = tmp_path / "bus.yaml"
    path.write_text(f"""
bus: {{ bitrate: 1000000, termination: {termination} }}
nodes:
  - name: a
    traffic: [ {{ send: 123#00FF00FF00, every: 1ms, count: 9 }} ]
  - {{ name: b, position: 30m }}
""")
    out = sim(path, "--events", "-", "--until", "20ms").stdout
    assert ('"error"' in out) == has_errors
    assert (out.count('"tx"') == 9) != has_errors


def test_the_example_of_the_reference_is_good(tmp_path):
    text = (ROOT / "daemon/man/canwire-timing.7.md").read_text()
    path = tmp_path / "bus.yaml"
    path.write_text(re.search(r"```yaml\n(.*?)```", text, re.DOTALL)[1])
    assert canwire("check", path).stderr == ""


def test_a_run_has_all_events_up_to_its_end(tmp_path):
    """Nodes end their bits before the bit of the bus does, or behind it."""
    (tmp_path / "bus.yaml").write_text(DRIFTED)
    every = [json.loads(line) for line in sim(tmp_path / "bus.yaml", "--events", "-",
                                              "--until", "20ms").stdout.splitlines()]
    for end in sorted({e["t"] for e in every})[:9]:
        run = sim(tmp_path / "bus.yaml", "--events", "-", "--until", f"{round(end * 1e9)}ns")
        assert [json.loads(line) for line in run.stdout.splitlines()] == [
            e for e in every if e["t"] <= end]
