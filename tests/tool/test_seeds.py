# SPDX-License-Identifier: MIT
"""canwire sim --seeds: one configuration with many seeds, in several processes."""

import json
import shlex
import subprocess

import pytest

from simtool import CANWIRE, ROOT, run, sim, stats

NOISY = """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 10ms, count: 10 } ] }
  - { name: gearbox }
  - { name: dash }
faults:
  - { name: hit, when: { probability: 0.05 }, do: { flip: "crc[3]", at: [gearbox] } }
expect:
  - { name: none is lost, delivered: 10, frame: "123", to: gearbox }
  - { name: "no \\"errors\\"", errors: 0 }
"""
ENDLESS = """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 10ms } ] }
  - { name: gearbox }
"""


def rows(*arguments, status=0):
    result = sim(*arguments, status=status)
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_a_row_is_what_a_run_with_its_seed_gives(write):
    file = write(NOISY)
    found = rows(file, "--seeds", "0..19", status=3)
    assert [row["seed"] for row in found] == list(range(20))
    assert {row["outcome"] for row in found} == {"passed", "failed"}
    for row in found[:6]:
        alone = stats(file, "--seed", row["seed"]) if row["outcome"] == "passed" else \
            json.loads(sim(file, "--seed", row["seed"], "--stats", "-", status=3).stdout)
        assert row["frames"] == alone["bus"]["frames"]
        assert row["error_frames"] == alone["bus"]["error_frames"]
        for node in alone["nodes"]:
            counters = row["nodes"][node["name"]]
            assert counters["rx_frames"] == node["rx_frames"]
            for key in "tx_frames", "tec", "rec", "state", "retransmissions", "bus_errors":
                assert counters[key] == node[key]


def test_a_row_tells_the_first_error_and_failed_expectations(write):
    # The known answer of the README. The gearbox sees the CRC error at the ACK delimiter, which
    # ends 14 bits after crc[3], and a bit lasts 2 us.
    text = NOISY.replace("probability: 0.05", "count: 1")
    row, = rows(write(text), "--seeds", "7", status=3)
    assert row["expectations"] == {"met": 1, "failed": [{"name": 'no "errors"', "got": "3"}]}
    assert row["first_error"] == {"t": 0.000164, "node": "gearbox", "role": "rx", "type": "crc",
                                  "field": "ack-delimiter", "index": 0}
    assert row["latency"] == 0.000028
    assert row["nodes"]["engine"]["tec_max"] == 8 and row["nodes"]["engine"]["tec"] == 0
    assert row["nodes"]["engine"]["retransmissions"] == 1
    assert row["faults"] == 1 and row["error_frames"] == 1 and row["undetected_errors"] == 0


def test_rows_are_the_same_for_any_number_of_processes(write):
    file = write(NOISY)
    wanted = sim(file, "--seeds", "1..700", "--jobs", "1", status=3)
    for jobs in "2", "5":
        assert sim(file, "--seeds", "1..700", "--jobs", jobs, status=3).stdout == wanted.stdout
    assert "700 seeds" in wanted.stderr and "failed" in wanted.stderr
    stepped = sim(file, "--seeds", "1..20", "--step", status=3).stdout
    assert stepped == "".join(wanted.stdout.splitlines(True)[:20])


def test_the_command_of_a_row_repeats_it(write):
    file = write(NOISY, "it's a bus.yaml")
    row, = rows(file, "--seeds", "3", "--until", "25ms", status=3)
    words = shlex.split(row["repeat"])
    assert words == ["canwire", "sim", str(file), "--seed", "3", "--until", "25ms"]
    again = run(CANWIRE, *words[1:], "--stats", "-", status=3)
    assert json.loads(again.stdout)["bus"]["frames"] == row["frames"] == 3


def test_a_note_is_in_the_rows_of_its_runs_alone(write):
    faults = NOISY.index("faults:")
    file = write(NOISY[:faults] + "faults:\n  - { name: off, when: { time: 5ms, "
                 "probability: 0.5 }, do: { disconnect: engine } }\n")
    found = rows(file, "--seeds", "0..19", "--jobs", "1")
    assert len({row["faults"] for row in found}) == 2
    for row in found:
        assert [note[:8] for note in row.get("notes", [])] == ["ended af"] * row["faults"]


def test_all_pass(write):
    assert len(rows(write(ENDLESS), "--seeds", "1..3", "--until", "1s")) == 3


def test_a_rig_has_the_nodes_of_all_buses():
    row, = rows(ROOT / "config/rig/rig.yaml", "--seeds", "1", "--until", "20ms")
    assert {name.split(":")[0] for name in row["nodes"]} == {"body", "powertrain"}


@pytest.mark.parametrize("arguments, status, message", [
    (["--seeds", "5..1"], 1, "--seeds 5..1: expected FIRST..LAST, such as 1..100"),
    (["--seeds", "1..2..3"], 1, "--seeds 1..2..3: expected FIRST..LAST"),
    (["--seeds", "0..18446744073709551615"], 1, "expected FIRST..LAST"),
    (["--seeds", "1..2", "--jobs", "0"], 1, "--jobs 0: a whole number from 1 to 256"),
    (["--seeds", "1..2", "--events", "-"], 2, "--seeds: it has no journal"),
    (["--seeds", "1..2", "--seed", "1"], 2, "--seeds: it has no journal"),
    (["--jobs", "2"], 2, "--jobs: it is for --seeds"),
    (["--seeds", "1..2"], 1, ":3:32: traffic without `count` never ends: give `count`, or --until"),
])
def test_wrong_use(write, arguments, status, message):
    assert message in sim(write(ENDLESS), *arguments, status=status).stderr


def test_a_bad_file_is_reported_once(write):
    result = sim(write(ENDLESS.replace("500000", "501")), "--seeds", "1..9", status=1)
    assert result.stderr.count("bus.yaml:1:") == 1 and not result.stdout


def test_a_full_disk_is_an_error(write):
    with open("/dev/full", "w", encoding="ascii") as full:
        ended = subprocess.run([CANWIRE, "sim", write(NOISY), "--seeds", "1..2000"], stdout=full,
                               stderr=subprocess.PIPE, timeout=60, check=False)
    assert ended.returncode == 1 and b"No space left" in ended.stderr
