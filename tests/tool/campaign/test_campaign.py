# SPDX-License-Identifier: MIT
"""canwire campaign: one scenario with many values of what varies."""

import contextlib
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import time

import pytest
import yaml

import test_schema
from simtool import CANWIRE, SCHEMAS, TIMEOUT_S, canwire, run, sim

VALIDATOR = test_schema.Validator(
    json.loads((SCHEMAS / "canwire-campaign.schema.json").read_text()))
BUS = """# a comment stays
bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
    traffic: [ { send: 123#DEADBEEF, every: 10ms, count: 3 } ]
  - name: gearbox
  - { name: dash }
faults:
  - name: hit
    when: { frame: "123", count: 1 }
    do: { flip: "crc[3]", at: [gearbox] }
expect:
  - { name: calm, errors: { max: 3 } }
"""
MANY = """scenario: bus.yaml
vary:
  - { name: rate, set: bus.bitrate, values: [ 250000, 500000 ] }
  - { name: bit, set: faults.hit.do.flip, positions: [ "data[0..7].*", "crc.*", "bit[0]" ],
      frame: "123#DEADBEEF" }
  - { set: faults.hit.do.at, nodes: all }
  - { set: "faults[0].when.skip", range: { from: 0, to: 2, step: 1 } }
  - { set: seed, range: { from: 1, to: 1, step: 1 } }
"""
INLINE = """scenario:
  bus: { name: powertrain, bitrate: 500000 }
  nodes:
    - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 10ms } ] }
    - name: gearbox
    - name: dash
until: 25ms
vary:
"""


def campaign(*arguments, status=0, cwd=None):
    return canwire("campaign", *arguments, status=status, cwd=cwd)


def rows_of(text):
    return [json.loads(line) for line in text.splitlines()]


@pytest.fixture(autouse=True)
def fixture_no_shard(monkeypatch):
    """The machine that runs the tests may give the jobs numbers of its own."""
    for name in list(os.environ):
        if name.startswith(("CI_NODE_", "SLURM_", "JOB_COMPLETION")):
            monkeypatch.delenv(name)


@pytest.fixture(name="make")
def fixture_make(write):
    """make(text) writes a campaign beside the scenario BUS; its path."""
    def make(text, bus=BUS):
        write(bus)
        VALIDATOR.validate(test_schema.convert(test_schema.compose(text)))
        return write(text, "campaign.yaml")
    return make


# ---- rows ----------------------------------------------------------------------------------------

def test_the_full_product_has_all_combinations_in_order(make):
    text = "scenario: bus.yaml\nvary:\n" \
        "  - { name: rate, set: bus.bitrate, values: [ 250000, 500000 ] }\n" \
        "  - { set: nodes.dash.queue, range: { from: 1, to: 5, step: 2 } }\n" \
        "  - { set: faults.hit.when.time, values: [ \"0s..1s\", 5ms..1s ] }\n"
    rows = rows_of(campaign("run", make(text)).stdout)
    assert [list(row["factors"].values()) for row in rows] == [
        list(values) for values in itertools.product([250000, 500000], [1, 3, 5],
                                                     ["0s..1s", "5ms..1s"])]
    assert [row["number"] for row in rows] == list(range(12))
    # the rate decides about the latency, and the window about the frame
    for row in rows:
        rate, _, window = row["factors"].values()
        assert row["latency"] == 14 / rate
        assert row["first_error"]["t"] == pytest.approx((0.01 if window[0] == "5" else 22 / rate)
                                                        + 82 / rate - 22 / rate, abs=21 / rate)


def test_rows_are_the_same_with_whole_loads_and_any_number_of_processes(make):
    file = make(MANY)
    wanted = campaign("run", file, "--jobs", "1").stdout
    assert len(wanted.splitlines()) == 2 * (32 + 15 + 1) * 3 * 3
    assert campaign("run", file, "--jobs", "3").stdout == wanted
    assert campaign("run", file, "--reload").stdout == wanted
    parts = [campaign("run", file, "--shard", f"{k}/4").stdout for k in range(1, 5)]
    assert "".join(parts) == wanted
    assert {row["first_error"]["type"] if row["first_error"] else None
            for row in rows_of(wanted)} == {"crc", "stuff", "form", "bit"}


# Factors that change the whole file. There are more scenarios than stay loaded, and they come again
# in any order. A rule has its name in some of them only. Some are no scenarios.
WHOLE_FILES = {
    "more than stay": """sample: { random: 1500 }
vary:
  - { set: nodes.dash.queue, range: { from: 1, to: 80, step: 1 } }
  - { set: faults.hit.do.flip, positions: [ "crc.*" ] }
  - { set: seed, range: { from: 1, to: 1000, step: 1 } }
""",
    "the last one varies": """vary:
  - { set: faults.hit.do.flip, positions: [ "crc.*" ] }
  - { set: "nodes.engine.traffic[0].every", range: { from: 1000us, to: 12000us, step: 250us } }
""",
    "names": """vary:
  - { set: faults.hit.name, values: [ hit, other ] }
  - { set: faults.hit.do.flip, positions: [ "crc.*" ] }
  - { set: nodes.dash.queue, values: [ 1, 2 ] }
""",
    "none": """vary:
  - { set: faults.hit.do.flip, positions: [ "crc.*" ] }
  - { set: nodes.dash.queue, values: [ 0, 1, 2 ] }
  - { set: faults.hit.do.at, values: [ dash, nobody ] }
""",
}


@pytest.mark.parametrize("kind", WHOLE_FILES)
def test_rows_are_the_same_when_scenarios_stay_loaded(make, kind):
    file = make("scenario: bus.yaml\n" + WHOLE_FILES[kind])
    status = 1 if kind == "none" else 0
    wanted = campaign("run", file, "--reload", status=status).stdout
    assert campaign("run", file, "--jobs", "1", status=status).stdout == wanted
    assert campaign("run", file, "--jobs", "2", status=status).stdout == wanted
    assert len({json.dumps(row["factors"]) for row in rows_of(wanted)}) > 50


def test_a_row_is_the_scenario_that_show_prints(make, write):
    file = make(MANY)
    rows = rows_of(campaign("run", file).stdout)
    for row in rows[::171]:
        text = campaign("show", file, row["number"]).stdout
        assert "# a comment stays" in text
        shown = write(text, "shown.yaml")
        canwire("check", shown)
        alone = rows_of(sim(shown, "--seeds", row["seed"]).stdout)[0]
        for key in "outcome", "t", "first_error", "latency", "nodes", "faults", "error_frames":
            assert alone[key] == row[key]
        words = shlex.split(row["repeat"])
        assert words[0] == "canwire"
        assert rows_of(run(CANWIRE, *words[1:]).stdout) == [row]


def test_each_bit_of_a_frame(make):
    text = INLINE + "  - { name: bit, each-bit: { from: engine, at: gearbox } }\n"
    rows = rows_of(campaign("run", make(text)).stdout)
    wire = canwire("bits", "123#DEADBEEF", "--raw").stdout.strip()
    assert len(rows) == len(wire)
    assert [row["factors"]["bit"]["bit"] for row in rows] == list(range(len(wire)))
    assert rows[0]["factors"]["bit"] == {"frame": "123", "bit": 0, "place": "sof"}
    by_place = {row["factors"]["bit"]["place"]: row for row in rows}
    assert by_place["crc[3]"]["first_error"]["type"] == "crc"
    assert by_place["crc[3]"]["first_error"]["node"] == "gearbox"
    assert by_place["eof[6]"]["first_error"] is None  # a receiver ignores it but for an overload
    assert all(row["faults"] == 1 and row["frames"] == 3 for row in rows)
    stuff = {place for place in by_place if place.endswith(" stuff")}
    assert all(by_place[place]["first_error"]["type"] == "stuff" for place in stuff) and stuff


def test_pairs_of_bits_of_a_field(make):
    text = INLINE + "  - { pairs-of-bits: { frame: 123#DEADBEEF, at: [ dash ], field: crc } }\n"
    rows = rows_of(campaign("run", make(text)).stdout)
    assert len(rows) == 15 * 14 // 2
    assert all(row["factors"]["pairs-of-bits"]["places"][0][:4] == "crc[" for row in rows)
    assert {row["outcome"] for row in rows} == {"passed"}
    assert all(row["first_error"]["node"] == "dash" for row in rows)


def test_rules_of_spaces_join_those_that_are_there(make):
    space = "  - { name: bit, each-bit: { frame: 123#DEADBEEF, at: dash, skip: 1 } }\n"
    for bus in BUS, BUS.replace("faults:\n  - name: hit\n    when: { frame: \"123\", count: 1 }\n"
                                "    do: { flip: \"crc[3]\", at: [gearbox] }",
                                "faults: [ { name: hit, when: { frame: \"123\", count: 1 }, "
                                "do: { flip: \"crc[3]\", at: [gearbox] } } ]"):
        file = make("scenario: bus.yaml\nvary:\n" + space + space.replace("bit,", "other,"), bus)
        row = json.loads(campaign("run", file, "--only", "300", status=3).stdout)
        assert row["faults"] == 3 and row["error_frames"] == 3 or row["faults"] == 2


def test_pairs_of_bits_join_a_block_of_rules(make):
    left = BUS.replace("faults:\n  - name: hit\n    when", "faults:\n- name: hit\n  when")
    for bus in BUS, left.replace("    do:", "  do:"):
        pairs = "  - { name: p, pairs-of-bits: { frame: 123#DEADBEEF, at: dash, field: NAME } }\n"
        text = "scenario: bus.yaml\nvary:\n" + pairs.replace("NAME", "crc") + \
            pairs.replace("NAME", "eof").replace("p,", "q,")
        file = make(text, bus)
        shown = yaml.safe_load(campaign("show", file, "3").stdout)
        assert [rule["name"] for rule in shown["faults"]] == ["p.1", "p.2", "q.1", "q.2", "hit"]
        row = json.loads(campaign("run", file, "--only", "3", status=3).stdout)
        assert row["outcome"] == "failed" and row["faults"] >= 4


def test_a_block_that_is_not_further_right_than_its_key(make):
    bus = "bus: { name: b, bitrate: 500000 }\nnodes:\n- name: engine\n  traffic:\n" \
        "  - { send: 123#, every: 1ms, count: 2 }\n- name: dash\nfaults:\n- name: hit\n" \
        "  when: { frame: \"123\" }\n  do: { flip: sof }\n"
    text = "scenario: bus.yaml\nvary:\n" \
        "  - { set: nodes.engine.traffic,\n" \
        "      values: [ [ { send: 124#, every: 1ms, count: 3 } ] ] }\n" \
        "  - { set: faults, values: [ [] ] }\n"
    assert json.loads(campaign("run", make(text, bus)).stdout)["frames"] == 3


def test_a_value_that_is_shared(make):
    bus = "bus: { name: b, bitrate: 500000 }\nnodes:\n  - { name: a, traffic: &t [ " \
        "{ send: 123#, every: &e 1ms, count: 2 } ] }\n  - { name: b, traffic: *t }\n"
    for path in "nodes.b.traffic[0].count", "nodes.a.traffic":
        text = f"scenario: bus.yaml\nvary:\n  - {{ set: \"{path}\", values: [ 3 ] }}\n"
        message = campaign("plan", make(text, bus), status=1).stderr
        assert f"3:12: set: '{path}': 'traffic' is shared by an alias" in message


@pytest.mark.parametrize("sample", ["full", "{ random: 4 }"])
def test_keys_that_are_put_in_keep_out_of_spaces(make, write, sample):
    space = "  - { name: NAME, each-bit: { frame: 123#DEADBEEF, at: dash } }\n"
    text = INLINE.replace("until:", f"sample: {sample}\nuntil:") + space.replace("NAME", "a") + \
        "  - { set: seed, values: [ 7 ] }\n" + space.replace("NAME", "b")
    file = make(text)
    shown = yaml.safe_load(campaign("show", file, "3").stdout)
    assert [rule["name"] for rule in shown["faults"]] == ["a", "b"] and shown["seed"] == 7
    assert json.loads(campaign("run", file, "--only", "3").stdout)["faults"] > 0


# ---- samples -------------------------------------------------------------------------------------

FACTORS = [("a", "nodes.engine.queue", 4), ("b", "nodes.gearbox.queue", 3),
           ("c", "nodes.dash.queue", 5), ("d", "nodes.dash.warning-limit", 2)]


def sampled(make, sample):
    lines = "".join(f"  - {{ name: {n}, set: {p}, range: {{ from: 1, to: {c}, step: 1 }} }}\n"
                    for n, p, c in FACTORS)
    file = make(f"scenario: bus.yaml\nseed: 7\nsample: {sample}\nvary:\n{lines}")
    return [row["factors"] for row in rows_of(campaign("run", file).stdout)]


def test_pairwise_has_each_pair_of_values(make):
    rows = sampled(make, "pairwise")
    assert 20 <= len(rows) <= 28  # 5 * 4 is the least possible number; the product has 120
    for (n1, _, c1), (n2, _, c2) in itertools.combinations(FACTORS, 2):
        assert {(row[n1], row[n2]) for row in rows} == set(
            itertools.product(range(1, c1 + 1), range(1, c2 + 1)))


@pytest.mark.parametrize("sample", ["random", "low-discrepancy"])
def test_samples_are_even_and_the_begin_of_larger_ones(make, sample):
    rows = sampled(make, f"{{ {sample}: 400 }}")
    assert len(rows) == 400
    assert sampled(make, f"{{ {sample}: 30 }}") == rows[:30]
    for name, _, count in FACTORS:
        found = [sum(row[name] == value for row in rows) for value in range(1, count + 1)]
        slack = 8 if sample == "low-discrepancy" else 45
        assert all(abs(number - 400 / count) <= slack for number in found)


def test_distributions(make):
    text = "scenario: bus.yaml\nsample: { random: 1000 }\nvary:\n" \
        "  - { name: u, set: \"nodes.engine.traffic[0].offset\",\n" \
        "      uniform: { from: 0ms, to: 9.5ms, step: 0.5ms } }\n" \
        "  - { name: n, set: nodes.gearbox.ppm, normal: { mean: 20, deviation: 10, step: 1 } }\n"
    rows = rows_of(campaign("run", make(text), "--reload").stdout)
    u = [float(row["factors"]["u"].removesuffix("ms")) for row in rows]
    n = [row["factors"]["n"] for row in rows]
    assert set(u) == {i / 2 for i in range(20)}
    mean = sum(n) / len(n)
    deviation = (sum((x - mean) ** 2 for x in n) / len(n)) ** 0.5
    assert abs(mean - 20) < 1.5 and abs(deviation - 10) < 1  # 4.7 and 4.5 standard errors
    assert abs(sum(u) / len(u) - 4.75) < 0.5


# ---- runs ----------------------------------------------------------------------------------------

def test_a_run_that_was_killed_goes_on(make, tmp_path):
    file, out = make(MANY), tmp_path / "rows.ndjson"
    part = tmp_path / "rows.ndjson.part"
    wanted = campaign("run", file).stdout
    for rows, torn in (100, 37), (850, 0):
        lines = wanted.splitlines(True)
        part.write_text("".join(lines[:rows]) + lines[rows][:torn])
        campaign("run", file, "--out", out, "--resume")
        assert out.read_text() == wanted and not part.exists()
        out.unlink()
    campaign("run", file, "--out", out)
    before = out.stat()
    again = campaign("run", file, "--out", out, "--resume")
    assert "864 rows: 864 passed" in again.stderr and out.stat().st_mtime_ns == before.st_mtime_ns


def test_processes_that_are_killed_cost_no_row(make, tmp_path):
    file, out = make(MANY), tmp_path / "rows.ndjson"
    wanted = campaign("run", file).stdout
    with subprocess.Popen([CANWIRE, "campaign", "run", file, "--reload", "--jobs", "2", "--out",
                           out], stderr=subprocess.PIPE) as running:
        killed = set()  # two: a row that is killed three times is lost
        end = time.monotonic() + 60
        while running.poll() is None and len(killed) < 2 and time.monotonic() < end:
            with contextlib.suppress(OSError):  # it may have ended already
                children = open(f"/proc/{running.pid}/task/{running.pid}/children",
                                encoding="ascii").read().split()
                for child in [child for child in children if child not in killed][:1]:
                    os.kill(int(child), signal.SIGKILL)
                    killed.add(child)
        assert running.wait(60) == 0
    assert out.read_text() == wanted


def test_rows_go_into_regular_files(make, tmp_path):
    file, real, link = make(MANY), tmp_path / "real.ndjson", tmp_path / "link.ndjson"
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name in "folder", "pipe":
        message = campaign("run", file, "--only", "0", "--out", tmp_path / name, status=1).stderr
        assert f"{name}: it is no regular file" in message
    real.write_text("old")
    link.symlink_to("real.ndjson")
    campaign("run", file, "--only", "0", "--out", link)
    assert link.is_symlink() and len(rows_of(real.read_text())) == 1
    real.unlink()
    (tmp_path / "folder/next").symlink_to("../link.ndjson")  # links to a file that is to come
    campaign("run", file, "--only", "0", "--out", tmp_path / "folder/next")
    assert link.is_symlink() and len(rows_of(real.read_text())) == 1
    real.unlink()
    real.symlink_to("link.ndjson")
    message = campaign("run", file, "--only", "0", "--out", link, status=1).stderr
    assert "Too many levels of symbolic links" in message


def test_a_whole_file_is_replaced_when_all_rows_are_there(make, tmp_path):
    file, out = make(MANY), tmp_path / "rows.ndjson"
    out.write_text("old")
    campaign("run", file, "--only", "100000", "--out", out, status=1)
    assert out.read_text() == "old"
    campaign("run", file, "--only", "0", "--out", out)
    assert len(rows_of(out.read_text())) == 1


@pytest.mark.parametrize("option", [["--only", "-1"], ["--shard", "0/3"], ["--jobs", "0"]])
def test_a_bad_value_of_an_option_is_bad_input(make, option):
    message = campaign("run", make(MANY), *option, status=1).stderr
    assert f"{option[0]} {option[1]}: expected" in message and "usage" not in message


def test_closed_descriptors_get_no_rows(make):
    file = make(MANY)
    def start(ends, *words, status=0):
        return run("sh", "-c", f'exec "$0" "$@" {ends}', CANWIRE, "campaign", "run", file, *words,
                   cwd=file.parent, status=status)
    told = start(">&-", status=1).stderr
    assert "standard output: Bad file descriptor" in told
    for name, ends in ("whole", ""), ("quiet", "<&- >&- 2>&-"):
        start(ends, "--out", name)
    assert (file.parent / "quiet").read_bytes() == (file.parent / "whole").read_bytes()


def test_a_full_disk_is_told_once(make):
    with open("/dev/full", "w", encoding="ascii") as full:
        result = subprocess.run([CANWIRE, "campaign", "run", make(MANY), "--jobs", "1"],
                                stdout=full, stderr=subprocess.PIPE, text=True, check=False,
                                timeout=TIMEOUT_S)
    assert result.returncode == 1 and result.stderr.count("No space left on device") == 1
    assert "Success" not in result.stderr


def test_rows_of_another_campaign_are_not_continued(make, tmp_path):
    out = tmp_path / "rows.ndjson"
    first = campaign("run", make(MANY), "--only", "0").stdout
    (tmp_path / "rows.ndjson.part").write_text(first.replace("250000", "125000"))
    message = campaign("run", tmp_path / "campaign.yaml", "--out", out, "--resume", status=1).stderr
    assert "rows.ndjson.part: it has other rows than this campaign" in message
    out.write_text(first)
    message = campaign("run", tmp_path / "campaign.yaml", "--out", out, "--resume", status=1).stderr
    assert "rows are missing in it" in message


@pytest.mark.parametrize("environment, number", [
    ({"SLURM_ARRAY_TASK_ID": "3", "SLURM_ARRAY_TASK_COUNT": "4", "SLURM_ARRAY_TASK_MIN": "1",
      "SLURM_ARRAY_TASK_MAX": "4"}, 3),
    ({"JOB_COMPLETION_INDEX": "2", "JOB_COMPLETIONS": "4"}, 3),
    ({"CI_NODE_INDEX": "3", "CI_NODE_TOTAL": "4"}, 3),
])
def test_the_shard_comes_from_the_environment(make, monkeypatch, environment, number):
    file = make(MANY)
    wanted = campaign("run", file, "--shard", f"{number}/4").stdout
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert campaign("run", file).stdout == wanted
    index, count = list(environment)[:2]
    monkeypatch.delenv(count)
    assert f"{count} is missing in the environment, which has {index}; give --shard K/N" \
        in campaign("run", file, status=1).stderr
    assert campaign("run", file, "--shard", f"{number}/4").stdout == wanted


def test_tasks_of_an_array_that_are_submitted_again_need_the_number_of_parts(make, monkeypatch):
    file = make(MANY)
    for name, value in {"ID": "7", "COUNT": "2", "MIN": "3", "MAX": "7", "STEP": "1"}.items():
        monkeypatch.setenv(f"SLURM_ARRAY_TASK_{name}", value)  # --array=3,7
    assert "SLURM_ARRAY_TASK_MIN to SLURM_ARRAY_TASK_MAX are 3 to 7, with 2 tasks: that may be a " \
        "part of an array; give --shard K/N" in campaign("run", file, status=1).stderr


def test_files_are_those_that_another_machine_needs(make, write, tmp_path):
    write("(0.001) engine 321#11\n", "drive.log")
    write("faults:\n  - { name: late, when: { frame: \"321\" }, do: { flip: \"crc[0]\" } }\n",
          "late.yaml")
    make(MANY, BUS.replace("  - name: gearbox\n",
                           "  - { name: gearbox, traffic: [ { replay: drive.log } ] }\n") +
         "profiles: [ { file: late.yaml }, { file: late.yaml, with: {}, as: x } ]\n")
    wanted = ["campaign.yaml", "bus.yaml", "late.yaml", "drive.log"]
    assert campaign("files", "campaign.yaml", cwd=tmp_path).stdout.split() == wanted
    inside = campaign("files", tmp_path / "campaign.yaml").stdout.split()
    assert inside == [str(tmp_path / name) for name in wanted]
    assert "usage:" in campaign("files", "campaign.yaml", "--reload", status=2, cwd=tmp_path).stderr
    write("buses: [ bus.yaml, other.yaml ]\ngateways:\n  - name: g\n    between: "
          "[ \"powertrain:dash\", \"other:dash\" ]\n    rules: [ { filter: \"123\" } ]\n",
          "rig.yaml")
    write(BUS.replace("powertrain", "other"), "other.yaml")
    write("scenario: rig.yaml\nvary: [ { set: seed, values: [ 1 ] } ]\n", "of-rig.yaml")
    assert campaign("files", "of-rig.yaml", cwd=tmp_path).stdout.split() == [
        "of-rig.yaml", "rig.yaml", "bus.yaml", "late.yaml", "drive.log", "other.yaml"]


@pytest.mark.parametrize("named, listed", [
    ("a/../bus.yaml", "bus.yaml"), ("./a/.././bus.yaml", "bus.yaml"),
    ("a/b/../../../TOP/bus.yaml", "../TOP/bus.yaml"), ("../TOP/../TOP/bus.yaml", "../TOP/bus.yaml"),
    ("a//../bus.yaml", "bus.yaml"), ("PATH/a/../bus.yaml", "PATH/bus.yaml"),
    ("/..PATH/bus.yaml", "/..PATH/bus.yaml"), ("link/../bus.yaml", "link/../bus.yaml"),
])
def test_files_are_listed_without_detours(make, tmp_path, named, listed):
    named, listed = (text.replace("TOP", tmp_path.name).replace("PATH", str(tmp_path))
                     for text in (named, listed))
    file = make(MANY.replace("bus.yaml", named))
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "other/folder").mkdir(parents=True)
    (tmp_path / "other/bus.yaml").write_text(BUS)
    (tmp_path / "link").symlink_to("other/folder")
    assert campaign("files", file.name, cwd=tmp_path).stdout.split() == ["campaign.yaml", listed]


def test_failed_expectations_and_invalid_rows(make):
    text = "scenario: bus.yaml\nvary:\n" \
        "  - { set: faults.hit.when.count, values: [ 1, 2 ] }\n"
    result = campaign("run", make(text), status=3)
    assert [row["outcome"] for row in rows_of(result.stdout)] == ["passed", "failed"]
    assert "2 rows: 1 passed, 1 failed" in result.stderr
    result = campaign("run", make(text.replace("2 ]", "0, 1 ]")), status=1)
    assert [row["outcome"] for row in rows_of(result.stdout)] == ["passed", "invalid", "passed"]
    assert "bus.yaml:10:34: count:" in rows_of(result.stdout)[1]["why"]
    assert "row 1 could not be run:" in result.stderr and "bus.yaml:10:34: count:" in result.stderr


def test_a_row_that_is_broken_says_why(make, tmp_path):
    (tmp_path / "drive.log").write_text("DROPCOUNT: dropped 1 CAN frame\n" * 2000 + "a 700#11\n")
    bus = BUS.replace("  - name: gearbox\n",
                      "  - name: gearbox\n    traffic: [ { replay: drive.log } ]\n")
    file = make("scenario: bus.yaml\nvary:\n  - { set: seed, values: [ 1, 2 ] }\n", bus)
    why = next(line for line in sim(tmp_path / "bus.yaml", status=1).stderr.splitlines()
               if line.startswith(f"{tmp_path}/drive.log:"))
    assert why.startswith(f"{tmp_path}/drive.log:2001:1: there is no time stamp")
    result = campaign("run", file, status=1)
    for row in rows_of(result.stdout):
        assert list(row) == ["number", "factors", "seed", "outcome", "why", "repeat"]
        assert row["outcome"] == "broken" and row["why"] == why
    assert f"row 0 could not be run:\n{why}\n" in result.stderr
    rows = rows_of(sim(tmp_path / "bus.yaml", "--seeds", "1..2", status=1).stdout)
    assert [row["why"] for row in rows] == [why, why]


def test_entries_that_are_not_replayed_are_told_in_rows_and_once(make, tmp_path):
    (tmp_path / "drive.log").write_text("(1.0) can0 700#11\n(1.1) can0 7\n(9.0) can0 701#\n")
    bus = BUS.replace("  - name: gearbox\n",
                      "  - name: gearbox\n    traffic: [ { replay: drive.log } ]\n")
    file = make("scenario: bus.yaml\nuntil: 500ms\nvary:\n"
                "  - { set: seed, range: { from: 1, to: 3, step: 1 } }\n", bus)
    note = f"{tmp_path}/drive.log: left out: 1 damaged entry of 13 bytes (line 2: expected a line"
    for result, program in ((campaign("run", file), "canwire campaign"),
                            (sim(tmp_path / "bus.yaml", "--until", "500ms", "--seeds", "1..3"),
                             "canwire sim")):
        rows = rows_of(result.stdout)
        assert len(rows) == 3 and all(row["notes"][0].startswith(note) for row in rows)
        assert result.stderr.count("left out") == 1 and f"{program}: {note}" in result.stderr
        assert result.stderr.endswith("3 passed; 3 with notes\n")


def test_plan_tells_what_there_is(make):
    lines = campaign("plan", make(MANY)).stdout.splitlines()
    assert lines[0] == "864 rows: the full product; 576 rows are pruned"
    assert "  bit: 48 values, 32 pruned" in lines
    assert lines[6] == 'row 0: rate=250000 bit="data[0.0]" faults.hit.do.at="engine" ' \
        'faults[0].when.skip=0 seed=1'
    assert lines[-1].startswith("about ") and lines[-1].endswith(" us a row")


def test_more_processes_than_the_system_allows(make, tmp_path):
    file = make(MANY)
    wanted = campaign("run", file).stdout
    for words in ["campaign", "run", file], ["sim", tmp_path / "bus.yaml", "--seeds", "1..500"]:
        result = subprocess.run(
            ["sh", "-c", "ulimit -n 24; exec \"$@\"", "sh", CANWIRE, *words, "--jobs", "256"],
            capture_output=True, text=True, check=False)
        assert result.returncode == 0
        lines = result.stderr.splitlines()
        assert re.fullmatch(r"canwire \w+: [12]?[0-9] processes at a time, as no more can be made: "
                            "Too many open files", lines[0])
        assert len(lines) == 2
        if words[0] == "campaign":
            assert result.stdout == wanted


@pytest.mark.parametrize("until, limit, message", [
    ("100000000s", "24h", "row 0 takes more than 3 s; how long all take is not known"),
    ("100000000s", "1s", "row 0 takes more than 1 s; how long all take is not known"),
    ("20s", "24h", "about "),
])
def test_plan_ends_whatever_the_rows_do(make, until, limit, message):
    text = INLINE.replace("25ms", until).replace("vary:", f"limit: {limit}\nvary:")
    seeds = "  - { set: seed, range: { from: 1, to: 100, step: 1 } }\n"
    last = campaign("plan", make(text + seeds),
                    "--jobs", "1").stdout.splitlines()[-1]
    assert last.startswith(message)


# ---- bad files -----------------------------------------------------------------------------------

@pytest.mark.parametrize("factor, message", [
    ("{ set: bus.bitrate }", "4:5: expected one of values, range, uniform"),
    ("{ values: [ 1 ] }", "4:5: expected 'set', the path of what varies"),
    ("{ set: nodes.motor.ppm, values: [ 1 ] }",
     "4:12: set: 'nodes.motor.ppm': the scenario has no 'motor' there"),
    ("{ set: nodes[7].ppm, values: [ 1 ] }", "has no '7' there"),
    ("{ set: bus.bitrate, range: { from: 1, to: 2 } }", "range: the key 'step' is missing"),
    ("{ set: bus.bitrate, range: { from: 1, to: 2, step: 0 } }", "range: 'step' is more than 0"),
    ("{ set: bus.bitrate, range: { from: 1us, to: 2%, step: 1us } }",
     "range: the numbers have different units"),
    ("{ set: bus.bitrate, range: { from: 3, to: 2, step: 1 } }", "range: 'to' is below 'from'"),
    ("{ set: bus.bitrate, uniform: { from: 1, to: 2, step: 1 } }",
     "uniform: 'draws' says how many values there are"),
    ("{ set: faults.hit.do.flip, positions: [ crc(3) ] }", "positions: "),
    ("{ set: faults.hit.do.flip, positions: [ \"crc[9..3]\" ] }",
     "expected a position, or several"),
    ("{ set: faults.hit.do.at, nodes: [ motor ] }", "nodes: the scenario has no node 'motor'"),
    ("{ each-bit: { from: dash } }", "the node of 'from' sends no frames"),
    ("{ each-bit: { at: dash } }", "it needs 'frame', or 'from'"),
    ("{ pairs-of-bits: { frame: 123#, field: crc } }", "it needs 'at'"),
    ("{ pairs-of-bits: { frame: 123#, at: dash, field: sof } }", "the frame has no two bits there"),
    ("{ set: seed, values: [ 1.5 ] }", "seeds are whole numbers from 0 on"),
    ("{ set: bus, values: [ 1 ] }\n  - { set: bus.bitrate, values: [ 1 ] }",
     "'bus.bitrate' is part of what 'bus' varies"),
    ("{ set: faults.hit.do.flip, positions: [ \"data[0..7].*\" ], frame: 123# }",
     "all its values are pruned"),
    ("{ each-bit: { frame: 123#, at: dash, field: crc } }", "each-bit: 'field' is for pairs-of"),
    ("{ set: faults, values: [ [] ] }\n  - { each-bit: { frame: 123#, at: dash } }",
     "5:5: 'each-bit' is part of what 'faults' varies"),
    ("{ set: \"nodes[0].ppm\", values: [ 1 ] }\n  - { set: \"nodes[0]\", values: [ {} ] }",
     "5:5: 'nodes[0].ppm' is part of what 'nodes[0]' varies"),
    ("{ set: nodes.dash.ppm, values: [ 1 ] }\n  - { set: \"nodes[2].ppm\", values: [ 1 ] }",
     "5:5: 'nodes.dash.ppm' and 'nodes[2].ppm' vary the same"),
    ("{ set: seed, values: [ 1 ] }\n  - { set: seed, values: [ 1 ] }", "5:5: duplicate factor"),
    ("{ set: seed, valeus: [ 1 ] }", "unknown key 'valeus' (did you mean 'values'?)"),
])
def test_bad_factors(write, factor, message):
    write(BUS)
    file = write(f"scenario: bus.yaml\nuntil: 1s\nvary:\n  - {factor}\n", "campaign.yaml")
    found = campaign("plan", file, status=1).stderr
    assert f"{file}:" in found and message in found


@pytest.mark.parametrize("sample", ["full", "pairwise", "{ random: 3 }", "{ low-discrepancy: 3 }"])
def test_a_factor_without_values(write, sample):
    write(BUS)
    file = write(f"scenario: bus.yaml\nsample: {sample}\nvary:\n  - {{ set: faults.hit.do.flip, "
                 "positions: \"data.*\", frame: 123# }\n", "campaign.yaml")
    assert "4:43: all its values are pruned" in campaign("plan", file, status=1).stderr


def test_a_limit_is_at_least_a_second(write):
    write(BUS)
    file = write("scenario: bus.yaml\nlimit: 999ms\nvary: [ { set: seed, values: [ 1 ] } ]\n",
                 "campaign.yaml")
    assert "expected a real time from 1s to 24h" in campaign("plan", file, status=1).stderr


def test_bad_scenarios(write):
    write(BUS.replace("500000", "501"))
    file = write("scenario: bus.yaml\nvary: [ { set: seed, values: [ 1 ] } ]\n", "campaign.yaml")
    found = campaign("plan", file, status=1).stderr
    assert "bus.yaml:2:35: " in found and "campaign.yaml:1:11: scenario: there are errors" in found
    inline = write(INLINE.replace("500000", "501") + "  - { set: seed, values: [ 1 ] }\n", "i.yaml")
    assert "i.yaml:2:37: bitrate" in campaign("plan", inline, status=1).stderr
    endless = write(INLINE.replace("until: 25ms\n", "") + "  - { set: seed, values: [ 1 ] }\n")
    found = campaign("run", endless, status=1).stderr
    assert "never ends: give `until` in the campaign" in found


@pytest.mark.parametrize("arguments, status, message", [
    (["run"], 2, "usage: canwire campaign"),
    (["walk", "campaign.yaml"], 2, "usage: canwire campaign"),
    (["plan", "campaign.yaml", "--out", "x"], 2, "usage: canwire campaign"),
    (["run", "campaign.yaml", "--resume"], 2, "--resume needs --out F"),
    (["run", "campaign.yaml", "--shard", "5/4"], 1, "--shard 5/4: expected K/N, such as 1/4"),
    (["run", "campaign.yaml", "--jobs", "x"], 1, "--jobs x: expected a whole number"),
    (["run", "campaign.yaml", "--only", "864"], 1, "--only 864: the last row is 863"),
    (["show", "campaign.yaml", "864"], 1, "there is no row 864, the last one is 863"),
    (["show", "campaign.yaml", "x"], 1, "row x: expected its number, from 0 on"),
])
def test_wrong_use(make, tmp_path, arguments, status, message):
    make(MANY)
    assert message in campaign(*arguments, status=status, cwd=tmp_path).stderr
