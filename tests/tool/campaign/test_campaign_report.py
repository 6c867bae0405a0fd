# SPDX-License-Identifier: MIT
"""canwire campaign report: what the rows of a campaign show together."""

import ast
import collections
import html.parser
import json
import math
import os
import re
import shlex
import statistics
import subprocess
import sys
import xml.etree.ElementTree

import pytest
import yaml

import test_schema
from simtool import CANWIRE, ROOT, SCHEMAS, canwire, run, sim

SCHEMA = json.loads((SCHEMAS / "canwire-campaign.schema.json").read_text())
VALIDATOR = test_schema.Validator(SCHEMA)
# Bit errors at one node, once or often. Of 300 hits the engine becomes bus-off. A dropped frame is
# not seen by any controller.
BUS = """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
    traffic:
      - { send: 123#DEADBEEF, every: 10ms, count: 3 }
      - { send: 200#11, every: 10ms, count: 3 }
  - { name: gearbox }
  - { name: dash }
faults:
  - { name: hit, when: { frame: "123", count: 1 }, do: { flip: "crc[3]", at: [gearbox] } }
  - { name: gone, when: { frame: "200", count: 1 }, do: { drop: rx, at: [dash] } }
expect:
  - { name: fresh, delivered: { min: 3 }, frame: "123", to: dash, before: 40ms }
  - { name: whole, delivered: { min: 3 }, frame: "200", to: dash }
"""
CAMPAIGN = """scenario: bus.yaml
vary:
  - { name: position, set: faults.hit.do.flip, positions: [ "crc[0..9]", "eof[6]" ] }
  - { name: hits, set: faults.hit.when.count, values: [ 1, 20, 300 ] }
  - { name: frame, set: faults.gone.when.frame, values: [ "200", "7FF" ] }
"""
PASSING = CAMPAIGN.replace('values: [ "200", "7FF" ]', 'values: [ "7FF" ]').replace(
    "values: [ 1, 20, 300 ]", "values: [ 1 ]")
NO_SHARD = ("CI_NODE_", "SLURM_", "JOB_COMPLETION")


@pytest.fixture(autouse=True)
def fixture_no_shard(monkeypatch):
    """The machine that runs the tests may give the jobs numbers of its own."""
    for name in list(os.environ):
        if name.startswith(NO_SHARD):
            monkeypatch.delenv(name)


@pytest.fixture(name="rows")
def fixture_rows(write, tmp_path):
    """rows(text) runs a campaign of the scenario BUS: the file of its rows, and the rows."""
    def rows(text=CAMPAIGN, bus=BUS, name="rows.ndjson"):
        write(bus)
        assert VALIDATOR.is_valid(test_schema.convert(test_schema.compose(text)))
        file = write(text, "campaign.yaml")
        out = tmp_path / name
        done = run("sh", "-c", f"'{CANWIRE}' campaign run '{file}' --out '{out}' || test $? = 3")
        assert done.stdout == ""
        return out, [json.loads(line) for line in out.read_text().splitlines()]
    return rows


def report(*arguments, status=0, cwd=None):
    return canwire("campaign", "report", *arguments, status=status, cwd=cwd)


def in_json(*arguments):
    return json.loads(report(*arguments, "--json", "-").stdout)


def class_of(row):
    """The class of a row as canwire-report(7) defines it, without signs."""
    if row["outcome"] not in ("passed", "failed"):
        return row["outcome"]
    nodes = row["nodes"].values()
    if row["outcome"] == "failed":
        seen = row["latency"] if row["faults"] else row["first_error"]
        return "failed undetected" if seen is None else "expectation failed but detected"
    if row["undetected_errors"] or any(
            node["dropped"] or node["rx_dropped"] or node["error_passive"] or node["bus_off"] or
            node["state"] != "error-active" for node in nodes):
        return "degraded"
    return "corrected by retransmission" if row["first_error"] else "no effect"


def wilson(count, every, z=1.959963984540054):
    middle = (count / every + z * z / (2 * every)) / (1 + z * z / every)
    half = z / (1 + z * z / every) * math.sqrt(
        count / every * (1 - count / every) / every + z * z / (4 * every * every))
    return middle - half, middle + half


# ---- what it counts ------------------------------------------------------------------------------

def test_classes_are_those_of_the_rows(rows):
    file, every = rows()
    wanted = collections.Counter(map(class_of, every))
    assert set(wanted) == {"no effect", "corrected by retransmission", "degraded",
                           "expectation failed but detected", "failed undetected"}
    found = in_json(file)
    assert found["rows"] == {"read": 66, "possible": 66, "missing": False, "numbers": [[0, 65]]}
    for name, counted in found["classes"].items():
        assert counted["rows"] == wanted[name]
        assert counted["share"] == pytest.approx(wanted[name] / 66)
        low, high = wilson(wanted[name], 66)
        assert (counted["low"], counted["high"]) == (
            pytest.approx(max(low, 0), abs=1e-9), pytest.approx(high, abs=1e-9))
    assert set(found["without_rate"].values()) == {0}
    text = report(file).stdout
    for name, count in wanted.items():
        assert f"{name:32} {count:10}  " in text
    assert "no metric of it" in text and "An FMEDA needs a fault model with rates." in text


def test_factors_and_pairs_are_counted(rows):
    file, every = rows()
    found = in_json(file)
    assert [one["name"] for one in found["factors"]] == ["position", "hits", "frame"]
    assert [(one["seen"], one["possible"]) for one in found["factors"]] == [(11, 11), (3, 3),
                                                                           (2, 2)]
    for factor in found["factors"]:
        for value in factor["values"]:
            mine = [row for row in every
                    if str(row["factors"][factor["name"]]) == value["value"]]
            assert value["rows"] == len(mine) > 0
            classes = collections.Counter(map(class_of, mine))
            assert {key: value[key] for key in value if key in classes} == dict(classes)
    assert [(one["met"], one["possible"]) for one in found["pairs"]] == [(33, 33), (22, 22), (6, 6)]
    part = file.with_name("part.ndjson")
    part.write_text("".join(file.read_text().splitlines(True)[:7]))
    found = in_json(part, "--partial")
    assert [(one["seen"], one["possible"]) for one in found["factors"]] == [(2, 11), (3, 3), (2, 2)]
    assert [(one["met"], one["possible"]) for one in found["pairs"]] == [(4, 33), (3, 22), (6, 6)]


def test_a_random_sample_covers_what_it_has_drawn(rows):
    text = CAMPAIGN + "  - { set: nodes.gearbox.queue, " \
        "uniform: { from: 1, to: 9, step: 2 } }\nsample: { random: 20 }\n"
    file, every = rows(text)
    found = in_json(file)
    for factor in found["factors"]:
        seen = {row["factors"][factor["name"]] for row in every}
        assert factor["seen"] == len(seen)
    assert [one["possible"] for one in found["factors"]] == [11, 3, 2, 5]
    for pair in found["pairs"]:
        assert pair["met"] == len({tuple(row["factors"][name] for name in pair["factors"])
                                   for row in every})


def test_faults_of_a_space_are_counted_by_frame_and_field(rows):
    file, every = rows("scenario: bus.yaml\nvary:\n"
                       "  - { name: bit, each-bit: { from: engine, at: gearbox } }\n")
    groups = {one["name"]: {value["value"]: value["rows"] for value in one["values"]}
              for one in in_json(file)["groups"]}
    frames = collections.Counter(row["factors"]["bit"]["frame"] for row in every)
    assert groups["bit.frame"] == dict(frames) and set(frames) == {"123", "200"}
    fields = collections.Counter(
        row["factors"]["bit"]["place"].split("[")[0] +
        (" stuff" if row["factors"]["bit"]["place"].endswith("] stuff") else "")
        for row in every)
    assert groups["bit.field"] == dict(fields)
    assert fields["eof"] == 14 and fields["id"] == 22 and fields["data stuff"] > 0


def test_latencies_are_held_against_a_limit(rows):
    file, every = rows("ftti: 20us\n" + CAMPAIGN)
    latencies = sorted(row["latency"] for row in every if row["latency"] is not None)
    found = in_json(file)["latency"]
    assert found["rows"] == len(latencies) > 50
    assert found["min"] == latencies[0] and found["max"] == latencies[-1]
    assert found["median"] == pytest.approx(statistics.median_low(latencies), rel=0.008)
    within = sum(value <= 20e-6 for value in latencies)
    assert found["limit"] == 20e-6 and found["within"]["rows"] == within
    assert 0 < within < len(latencies)
    assert found["within"]["share"] == pytest.approx(within / len(latencies))
    failed = [row for row in every if row["outcome"] == "failed"]
    assert found["failed_within"]["rows"] == sum(
        row["latency"] is not None and row["latency"] <= 20e-6 for row in failed)
    assert found["failed_within"]["share"] == pytest.approx(
        found["failed_within"]["rows"] / len(failed))
    assert sum(one["rows"] for one in found["histogram"]) == len(latencies)
    assert in_json(file, "--ftti", "1s")["latency"]["within"]["rows"] == len(latencies)
    assert "within the limit of 0.02 ms" in report(file).stdout


def test_signs_tell_of_a_detection(rows):
    bus = BUS + '  - { name: dtc, seen: yes, frame: "7E8" }\n'
    bus = bus.replace('  - { name: gearbox }', """  - name: gearbox
    traffic: [ { reply: 7E8#, to: "200" } ]""")
    text = CAMPAIGN.replace('"7FF"', '"200~300"')  # nothing is dropped there, either
    # without a sign, all rows in which the controllers see nothing are undetected
    plain = in_json(rows(text, BUS)[0])["classes"]
    assert plain["failed undetected"]["rows"] > 0
    # the gearbox tells of each frame 200
    signs = in_json(rows("detected: dtc\n" + text, bus)[0])["classes"]
    assert signs["failed undetected"]["rows"] == 0
    assert signs["expectation failed but detected"]["rows"] == \
        plain["failed undetected"]["rows"] + plain["expectation failed but detected"]["rows"]
    # a sign that is never there is no failure
    never = BUS + '  - { name: dtc, seen: yes, frame: "7E8" }\n'
    file, every = rows("detected: [ dtc ]\n" + text, never)
    assert {row["outcome"] for row in every} == {"failed"}
    found = in_json(file)
    assert found["classes"] == plain
    assert "dtc" not in [one["value"] for one in found["expectations"][0]["values"]]


def test_the_rows_of_seeds_have_a_report_too(write, tmp_path):
    text = BUS.replace("count: 1 }", "probability: 0.3 }")
    write(text)
    done = run("sh", "-c", f"cd '{tmp_path}' && "
               f"'{CANWIRE}' sim bus.yaml --seeds 5..54 || test $? = 3")
    out = tmp_path / "seeds.ndjson"
    out.write_text(done.stdout)
    wanted = collections.Counter(class_of(json.loads(line)) for line in done.stdout.splitlines())
    found = in_json(out)
    assert {key: one["rows"] for key, one in found["classes"].items() if one["rows"]} == wanted
    assert found["rows"] == {"read": 50, "possible": None, "missing": False, "seeds": [[5, 54]]}
    large = 2**64 - 3
    out.write_text(sim("bus.yaml", "--seeds", f"{large}..{large + 2}", cwd=tmp_path,
                       status=3).stdout)
    assert in_json(out)["rows"]["read"] == 3


# ---- files that do not fit -----------------------------------------------------------------------

def test_parts_make_a_whole(rows, tmp_path):
    file, _ = rows()
    lines = file.read_text().splitlines(True)
    one, two = tmp_path / "1", tmp_path / "2"
    one.write_text("".join(lines[:30]))
    two.write_text("".join(lines[30:]))
    whole = report(file).stdout
    assert report(one, two).stdout == whole
    assert report(two, one).stdout.splitlines()[:10] == whole.splitlines()[:10]
    assert "rows 30 to 65 are missing" in report(one, status=1).stderr
    assert "rows 0 to 29 are missing" in report(two, status=1).stderr
    assert f"{two}:1: row 30 is there twice" in report(two, one, two, status=1).stderr
    partial = report(one, "--partial").stdout
    assert "30 of 66 rows are there. The first ones that are missing are 30 to 65." in partial
    one.write_text("".join(lines[:30]) + lines[30][:-20])
    assert f"{one}:31: the line is cut" in report(one, two, status=1).stderr
    assert report(one, two, "--partial").stdout == whole


def value(line, key, text):
    """The line with another value for the first such key."""
    old = rf'"{key}":(\{{[^}}]*\}}|\[[^\]]*\]|"[^"]*"|[^,}}]*)'
    return re.sub(old, f'"{key}":{text}', line, count=1)


@pytest.mark.parametrize("change,message", [
    (lambda line: line.replace('"crc[2]"', '"crc[3]"'), "has other values than"),
    (lambda line: line.replace('"seed":0', '"seed":1'), "has other values than"),
    (lambda line: line.replace('"number":', '"number":1'), "has no row 1"),
    (lambda line: "\n", "it is no row of canwire campaign run"),
    (lambda line: line.replace('"outcome":"', '"outcome":"x'), "no outcome that is known"),
    (lambda line: line.replace('"nodes":', '"node":'), "keys are missing"),
    (lambda line: line.replace("canwire campaign run", "canwire sim"), "no command"),
    (lambda line: line.replace('"number":', '"number":0,"number":'), "a key is there twice"),
    (lambda line: line.replace('"tec":', '"tec":1,"tec":'), "a key is there twice"),
    (lambda line: line.replace('"number":', '"number":-'), "it is no row of canwire"),
    (lambda line: value(line, "latency", '"soon"'), "`latency`: expected seconds, 0 or more, or"),
    (lambda line: value(line, "latency", "-0.001"), "`latency`: expected seconds, 0 or more, or"),
    (lambda line: value(line, "latency", "1e9"), "`latency`: it is longer than the run"),
    (lambda line: value(line, "latency", "true"), "`latency`: expected seconds"),
    (lambda line: value(line, "first_error", "null"), "`latency`: there is no error"),
    (lambda line: line.replace('"type":', '"kind":'), "`first_error`: `type`: expected a text"),
    (lambda line: value(line, "t", "-1"), "`t`: expected seconds"),
    (lambda line: value(line, "frames", "-1"), "`frames`: expected an integer, 0 or more"),
    (lambda line: value(line, "faults", "1.5"), "`faults`: expected an integer, 0 or more"),
    (lambda line: value(line, "error_frames", '"2"'), "`error_frames`: expected an integer"),
    (lambda line: value(line, "tec_max", "-8"), "`tec_max`: expected an integer, 0 or more"),
    (lambda line: value(line, "dropped", "0.5"), "`dropped`: expected an integer, 0 or more"),
    (lambda line: value(line, "bus_off", "null"), "`bus_off`: expected an integer, 0 or more"),
    (lambda line: value(line, "state", '"asleep"'), "`nodes`: `state`: expected error-active,"),
    (lambda line: value(line, "met", "-2"), "`met`: expected an integer, 0 or more"),
    (lambda line: value(line, "outcome", '"failed"'), "the row has failed, but `expectations`"),
    (lambda line: value(line, "failed", '[{"name":"whole","got":"0"}]'),
     "the row has passed, but `expectations`"),
    (lambda line: value(line, "failed", '["whole"]'), "each with its `name`"),
])
def test_rows_that_do_not_belong_there_are_refused(rows, change, message):
    file, _ = rows()
    lines = file.read_text().splitlines(True)
    at = next(i for i, line in enumerate(lines) if '"crc[2]"' in line and
              '"passed"' in line and '"latency":0' in line)
    before = lines[at]
    lines[at] = change(before)
    assert lines[at] != before
    file.write_text("".join(lines))
    found = report(file, "--partial", status=1)
    assert f"{file}:{at + 1}: " in found.stderr and message in found.stderr
    assert found.stdout == ""


def test_rows_of_other_runs_are_refused(rows, write, tmp_path):
    file, _ = rows()
    seeds = tmp_path / "seeds.ndjson"
    seeds.write_text(sim(write(BUS), "--seeds", "1..2", status=3).stdout)
    assert "the first row is of" in report(file, seeds, status=1).stderr
    other = tmp_path / "other"
    other.write_text(seeds.read_text().replace("bus.yaml", "other.yaml").replace(
        '"seed":1,', '"seed":3,').replace('"seed":2,', '"seed":4,'))
    assert "the first row is of" in report(seeds, other, status=1).stderr
    # without the campaign's file, the names of the factors must fit
    (tmp_path / "campaign.yaml").unlink()
    other.write_text(file.read_text().replace('"hits":', '"hit":').replace('"number":',
                                                                          '"number":9'))
    assert "its factors are not those" in report(file, other, status=1).stderr


def test_blanks_and_the_order_of_keys_do_not_matter(rows, tmp_path):
    file, every = rows()
    other = tmp_path / "other"
    other.write_text("".join(json.dumps(row, sort_keys=True) + "\n" for row in every[::-1]))
    found, wanted = in_json(other), in_json(file)
    for one in found, wanted:
        one["expectations"] = one["first_errors"] = None  # in the order of the rows
    assert found == wanted


def test_a_campaign_that_cannot_be_opened_is_not_missing(rows, tmp_path):
    file, _ = rows()
    (tmp_path / "campaign.yaml").unlink()
    (tmp_path / "campaign.yaml").symlink_to("campaign.yaml")
    why = "campaign.yaml cannot be read: Too many levels of symbolic links"
    assert f"{why}. So " in in_json(file)["remarks"][0]
    assert f"{why}, so there are no scenarios." in report(file, "--scenarios",
                                                          tmp_path / "none").stdout


@pytest.fixture(name="large", scope="module")
def fixture_large(tmp_path_factory):
    """Rows of more than 8 MB, which several processes read: a list of lines."""
    folder = tmp_path_factory.mktemp("large")
    (folder / "bus.yaml").write_text(BUS)
    (folder / "large.yaml").write_text(PASSING.replace(
        "vary:", "vary:\n  - { set: seed, range: { from: 1, to: 800, step: 1 } }"))
    run("sh", "-c", f"'{CANWIRE}' campaign run large.yaml --out rows || test $? = 3", cwd=folder)
    lines = (folder / "rows").read_bytes().splitlines(keepends=True)
    assert sum(map(len, lines)) > 8 << 20
    return folder, lines


def replaced(lines, number, old, new):
    assert old in lines[number]
    return [*lines[:number], lines[number].replace(old, new), *lines[number + 1:]]


@pytest.mark.parametrize("change", [
    lambda lines: lines,
    lambda lines: lines[::-1],
    lambda lines: replaced(lines, 6000, b'"t":', b'"t":' + b" " * 200000),
    lambda lines: [*lines[:7000], lines[0], *lines[7000:]],
    lambda lines: replaced(lines, 5000, b'"seed":', b'"seed":1'),
    lambda lines: replaced(lines, 5000, b'"nodes":', b'"nodes":1,"nodes":'),
    lambda lines: replaced(lines, 5000, b"large.yaml", b"small.yaml"),
    lambda lines: replaced(lines, len(lines) - 1, b"\n", b""),
    lambda lines: [*lines[:-1], lines[-1][:100]],
], ids=["whole", "backwards", "long", "double", "other seed", "key twice", "other", "no end",
        "cut"])
def test_several_processes_read_the_same(change, large):
    folder, lines = large
    (folder / "changed").write_bytes(b"".join(change(lines)))
    several, alone, partial = (subprocess.run(
        [CANWIRE, "campaign", "report", "changed", "--json", "-", *options], cwd=folder,
        capture_output=True, text=True, check=False)
        for options in (["--jobs", "3"], ["--jobs", "1"], ["--jobs", "3", "--partial"]))
    assert (several.stdout, several.stderr) == (alone.stdout, alone.stderr)
    assert several.returncode == alone.returncode
    assert (several.returncode == 0) == (several.stderr == "") == (several.stdout != "")
    assert partial.returncode == 0 or partial.stderr == several.stderr != ""


def test_the_campaign_may_be_elsewhere(rows, tmp_path, write):
    file, _ = rows("detected: whole\nftti: 20us\n" + CAMPAIGN)
    wanted = in_json(file)
    (tmp_path / "campaign.yaml").rename(tmp_path / "moved.yaml")
    found = in_json(file)
    assert "is not there" in found["remarks"][0] and found["rows"]["possible"] is None
    assert found["classes"] != wanted["classes"]
    assert found["factors"][0]["possible"] is None and "limit" not in found["latency"]
    found = in_json(file, "--campaign", tmp_path / "moved.yaml")
    assert found.pop("campaign") == str(tmp_path / "moved.yaml")
    assert wanted.pop("campaign") == str(tmp_path / "campaign.yaml")
    assert found == wanted
    bad = write("scenario: bus.yaml\n", "bad.yaml")
    assert "vary" in report(file, "--campaign", bad, status=1).stderr
    missing = report(file, "--campaign", tmp_path / "none.yaml", status=1).stderr
    assert "none.yaml" in missing


@pytest.mark.parametrize("arguments,status,message", [
    ((), 2, "usage: canwire campaign report F..."),
    (("--only", "1", "x"), 2, "usage"),
    (("x", "--jobs", "0"), 1, "--jobs 0: expected a whole number from 1 to 256"),
    (("x", "--jobs", "257"), 1, "--jobs 257: expected"),
    (("none.ndjson",), 1, "none.ndjson: No such file or directory"),
    (("/",), 1, "Is a directory"),
    (("/dev/null",), 1, "there are no rows"),
    (("x", "--ftti", "10bit"), 1, "--ftti 10bit: expected a time such as 50ms"),
    (("x", "--ftti", "0s"), 1, "--ftti 0s: expected"),
    (("x", "--confidence", "0.95"), 1, "--confidence 0.95: expected 50% to 99.9999%"),
    (("x", "--confidence", "100%"), 1, "--confidence 100%: expected"),
    (("x", "--confidence", "nan%"), 1, "--confidence nan%: expected"),
], ids=str)
def test_bad_command_lines(arguments, status, message, tmp_path):
    found = report(*arguments, status=status, cwd=tmp_path)
    assert message in found.stderr and found.stdout == ""


@pytest.mark.parametrize("keys,message", [
    ("detected: none", ":1:11: detected: the scenario has no expectation with the name 'none'"),
    ("detected: []", ":1:11: detected: expected"),
    ("ftti: 0s", ":1:7: ftti: expected a time such as 50ms"),
    ("ftti: 10bit", ":1:7: ftti: expected a time such as 50ms"),
    ("ftti: soon", ":1:7: ftti:"),
])
def test_bad_keys_of_the_campaign(write, keys, message):
    write(BUS)
    file = write(f"{keys}\n{CAMPAIGN}", "campaign.yaml")
    assert message in canwire("campaign", "plan", file, status=1).stderr


# ---- the shortest scenarios ----------------------------------------------------------------------

def crowded():
    """The scenario with more traffic and rules, which have nothing to do with the failures."""
    text = BUS.replace(
        "      - { send: 200#11", "      - { send: 300#22, every: 3ms, count: 9 }\n"
        "      - { replay: drive.log }\n      - { send: 200#11")
    return text.replace("faults:\n", """faults:
  - { name: idle, when: { frame: "7FF" }, do: { flip: "crc[1]" } }
  - { name: late, when: { frame: "7FE", count: 1 }, do: { flip: "crc[1]" } }
""")


@pytest.fixture(name="shortest")
def fixture_shortest(rows, write, tmp_path):
    """The report of a campaign with its shortest scenarios, and their folder."""
    write("(0.000100) can0 456#00\n", "drive.log")
    file, every = rows(CAMPAIGN, crowded())
    folder = tmp_path / "shortest"
    return in_json(file, "--scenarios", folder, "--minimise", "1h"), folder, every


def outcome(command, folder):
    """The row of a command of a report, as its seed gives it."""
    words = shlex.split(command)
    assert words[:2] == ["canwire", "sim"]
    options = dict(zip(words[3::2], words[4::2]))
    seed = options.get("--seed", "0")
    until = ["--until", options["--until"]] if "--until" in options else []
    done = run("sh", "-c", shlex.join([CANWIRE, "sim", str(folder / words[2]), "--seeds", seed,
                                       *until]) + " || test $? = 3")
    return json.loads(done.stdout)


def test_the_shortest_scenarios_do_the_same(shortest):
    found, folder, every = shortest
    classes = [one["class"] for one in found["scenarios"]]
    assert set(classes) == {"degraded", "expectation failed but detected", "failed undetected"}
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        one["name"] for one in found["scenarios"])
    for one in found["scenarios"]:
        text = (folder / one["name"]).read_text()
        assert text == one["yaml"] and one["minimised"]
        assert text.splitlines()[2] == f"# {one['command']}"
        canwire("check", folder / one["name"])
        row = outcome(one["command"], folder)
        assert class_of(row) == one["class"] == class_of(every[one["number"]])
        failed = [each["name"] for each in row["expectations"]["failed"]]
        assert (one["expectation"] in failed) if one["expectation"] else not failed
        # without its faults nothing fails
        document = yaml.safe_load(text)
        assert len(document.pop("faults")) == one["rules"]
        (folder / "calm.yaml").write_text(yaml.safe_dump(document))
        calm = outcome(one["command"].replace(one["name"], "calm.yaml"), folder)
        assert calm["outcome"] == "passed", text
    texts = ["".join(one["yaml"].splitlines(True)[3:]) for one in found["scenarios"]]
    assert len(set(texts)) == len(texts)


def test_the_shortest_scenarios_are_short(shortest):
    found, _, _ = shortest
    first = {}
    for one in found["scenarios"]:
        first.setdefault(one["class"], one)
    # one frame that is dropped at the dash, and nothing else
    undetected = first["failed undetected"]
    assert (undetected["rules"], undetected["traffic"]) == (1, 1)
    document = yaml.safe_load(undetected["yaml"])
    assert [rule["name"] for rule in document["faults"]] == ["gone"]
    assert document["nodes"][0]["traffic"] == [{"send": "200#11", "every": "10ms", "count": 3}]
    assert [one["name"] for one in document["expect"]] == ["whole"]
    detected = yaml.safe_load(first["expectation failed but detected"]["yaml"])
    assert "idle" not in [rule["name"] for rule in detected["faults"]]
    degraded = first["degraded"]
    assert (degraded["rules"], degraded["traffic"]) == (1, 1)
    assert "expect" not in yaml.safe_load(degraded["yaml"])
    assert "--until" in degraded["command"]


def reasons_of(row):
    """Why a row is degraded, in the words and the order of the report."""
    nodes = row["nodes"].values()
    found = {
        "error-passive": any(node["error_passive"] for node in nodes),
        "bus-off": any(node["bus_off"] for node in nodes),
        "not error-active in the end": any(node["state"] != "error-active" for node in nodes),
        "dropped frame": any(node["dropped"] or node["rx_dropped"] for node in nodes),
        "undetected error": row["undetected_errors"] > 0,
    }
    return [reason for reason, is_so in found.items() if is_so]


def test_a_degraded_scenario_keeps_its_reasons(rows, tmp_path):
    # of 20 hits the engine becomes error-passive, and recovers; of 300 it stays bus-off
    bus = """bus: { name: b, bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 120 } ] }
  - { name: gearbox }
  - { name: dash }
faults:
  - { name: hit, when: { frame: "123", count: 20 }, do: { flip: "crc[3]", at: [gearbox] } }
"""
    file, every = rows("scenario: bus.yaml\nvary:\n"
                       "  - { set: faults.hit.when.count, values: [ 20, 300 ] }\n", bus)
    assert [class_of(row) for row in every] == ["degraded", "degraded"]
    assert reasons_of(every[0]) == ["error-passive"]
    folder = tmp_path / "shortest"
    found = in_json(file, "--scenarios", folder)["scenarios"]
    assert sorted(one["number"] for one in found) == [0, 1]
    for one in found:
        wanted = reasons_of(every[one["number"]])
        assert one["degraded_by"] == wanted
        assert reasons_of(outcome(one["command"], folder)) == wanted
        assert one["yaml"].splitlines()[0] == f"# degraded: {', '.join(wanted)}"
        assert one["rules"] == one["traffic"] == 1
    text = report(file, "--scenarios", folder).stdout
    assert "; number 0; error-passive\n" in text


def test_names_of_files_hold_in_the_other_folder(rows, write, tmp_path):
    write("(0.000100) can0 123#00\n", "drive.log")
    bus = """bus: { name: b, bitrate: 500000 }
nodes: [ { name: a, traffic: [ { replay: drive.log } ] }, { name: b } ]
faults: [ { name: hit, when: { frame: "123", count: 1 }, do: { drop: rx, at: [b] } } ]
expect: [ { name: there, delivered: 1, to: b } ]
"""
    file, _ = rows("scenario: bus.yaml\nvary: [ { set: seed, values: [ 7 ] } ]\n", bus)
    folder = tmp_path / "shortest"
    one, = in_json(file, "--scenarios", folder)["scenarios"]
    assert str(tmp_path / "drive.log") in one["yaml"] and "--seed" not in one["command"]
    assert class_of(outcome(one["command"], folder)) == "failed undetected"


def test_scenarios_say_why_there_are_none(rows, tmp_path, write):
    file, _ = rows(PASSING)
    text = report(file, "--scenarios", tmp_path / "none").stdout
    assert "the shortest scenarios\n  none\n" in text
    file, _ = rows()
    (tmp_path / "campaign.yaml").unlink()
    text = report(file, "--scenarios", tmp_path / "none").stdout
    assert "campaign.yaml is not there, so there are no scenarios." in text
    assert "File exists" not in text and list((tmp_path / "none").iterdir()) == []
    write("", "file")
    assert "Not a directory" in report(file, "--scenarios", tmp_path / "file/x", status=1).stderr


def test_a_short_time_makes_scenarios_less_short(rows, tmp_path):
    file, _ = rows()
    found = in_json(file, "--scenarios", tmp_path / "short", "--minimise", "0s")
    assert found["scenarios"] and not any(one["minimised"] for one in found["scenarios"])
    for one in found["scenarios"]:
        assert class_of(outcome(one["command"], tmp_path / "short")) == one["class"]
    assert "--minimise 25h: expected" in report(file, "--minimise", "25h", status=1).stderr


# ---- other forms ---------------------------------------------------------------------------------


class Page(html.parser.HTMLParser):
    """A page whose elements are closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.seen, self.text = [], collections.Counter(), []

    def handle_starttag(self, tag, attrs):
        self.seen[tag] += 1
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.seen[tag] += 1

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_a_page_needs_nothing_else(rows, tmp_path):
    bus = BUS.replace("name: whole", 'name: "<b>whole & more</b>"')
    file, _ = rows(CAMPAIGN, bus)
    out = tmp_path / "report.html"
    report(file, "--html", out, "--scenarios", tmp_path / "shortest")
    text = out.read_text()
    page = Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert page.seen["svg"] >= 6 and page.seen["table"] >= 6 and page.seen["pre"] > 0
    assert not {"script", "link", "img", "b", "iframe"} & set(page.seen)
    assert "http" not in text and "<b>" not in text
    words = "".join(page.text)
    assert "<b>whole & more</b>" in words and "no metric of it" in words
    assert "failed-undetected-1.yaml" in words
    assert report(file, "--html", "-").stdout.startswith("<!DOCTYPE html>")
    for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        xml.etree.ElementTree.fromstring(svg)


def test_junit_has_a_case_for_each_class_and_value(rows, tmp_path):
    file, every = rows()
    out = tmp_path / "report.xml"
    report(file, "--junit", out)
    root = xml.etree.ElementTree.parse(out).getroot()
    assert [suite.get("name") for suite in root] == ["classes", "position", "hits", "frame"]
    for suite in root:
        cases = list(suite)
        assert int(suite.get("tests")) == len(cases)
        assert int(suite.get("failures")) == sum(case.find("failure") is not None
                                                 for case in cases)
        assert len({case.get("name") for case in cases}) == len(cases)
    for case in root[3]:
        undetected = [row for row in every if row["factors"]["frame"] == case.get("name") and
                      class_of(row) == "failed undetected"]
        assert (case.find("failure") is not None) == bool(undetected)
    failed, = [case for case in root[0] if case.find("failure") is not None]
    assert failed.get("name") == "failed undetected"


def test_outputs_are_whole_or_not_there(rows, tmp_path):
    file, _ = rows()
    out = tmp_path / "report.json"
    out.write_text("old")
    report(file, "--partial", file, "--json", out, status=1)
    assert out.read_text() == "old"
    report(file, "--json", out)
    assert json.loads(out.read_text()) == in_json(file)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("form", ["", "--html", "--junit"])
def test_texts_that_turn_or_hide_others_are_seen(form, rows, tmp_path):
    """U+202E lets what follows be read from the right: such characters become '?'."""
    evil = "\u202egnp.\u2066\u200b\x9b31m\x1b[31m"
    _, every = rows(PASSING)
    for row in every:
        row.update(outcome="failed", repeat=row["repeat"] + evil,
                   factors={name + evil: f"{value}{evil}" for name, value in
                            row["factors"].items()},
                   expectations={"met": 0, "failed": [{"name": "calm" + evil}]})
    (tmp_path / "campaign.yaml").unlink()
    file = tmp_path / "evil.ndjson"
    file.write_text("".join(json.dumps(row) + "\n" for row in every))
    shown = report(file, *([form, "-"] if form else [])).stdout
    assert re.search(r"\?gnp\.\?+31m\?\[31m", shown)
    assert all(c.isprintable() or c == "\n" for c in shown)


@pytest.mark.parametrize("option", ["--json", "--html", "--junit"])
def test_outputs_are_opened_before_the_work(option, rows, tmp_path):
    """A file of rows that is none tells what came first."""
    file, _ = rows()
    (tmp_path / "none").write_text("no rows\n")
    (tmp_path / "folder").mkdir()
    for name, why in (("gone/x", "No such file"), ("folder", "Is a directory")):
        error = report(tmp_path / "none", option, tmp_path / name, status=1).stderr
        assert error.count("\n") == 1 and why in error
    report(file, option, "/dev/null")
    assert os.stat("/dev/null").st_rdev == os.makedev(1, 3)
    read = subprocess.run(f"{CANWIRE} campaign report {file} {option} /dev/stderr >{os.devnull}",
                          shell=True, capture_output=True, check=True).stderr
    report(file, option, tmp_path / "out")
    assert read == (tmp_path / "out").read_bytes() != b""
    report(tmp_path / "none", option, tmp_path / "new", status=1)
    assert not (tmp_path / "new").exists() and not list(tmp_path.glob("*.part"))


@pytest.mark.skipif(sys.version_info < (3, 11), reason="DuckDB has no wheel for this Python")
def test_the_page_makes_parquet_of_rows(rows, tmp_path):
    file, every = rows()
    page = (ROOT / "daemon/man/canwire-report.7.md").read_text()
    code, = re.findall(r"```python\n(import duckdb.*?)```", page, re.DOTALL)
    run(sys.executable, "-c", code, cwd=tmp_path)
    ask = "import duckdb\nprint(duckdb.sql(\"SELECT count(*), sum(nodes.engine.tec_max), " \
        "max(latency), count(DISTINCT factors.position) FROM 'rows.parquet'\").fetchall()[0])"
    found = ast.literal_eval(run(sys.executable, "-c", ask, cwd=tmp_path).stdout)
    assert file.name == "rows.ndjson" and found == (
        66, sum(row["nodes"]["engine"]["tec_max"] for row in every),
        max(row["latency"] for row in every if row["latency"] is not None), 11)


# ---- latencies -----------------------------------------------------------------------------------

def test_an_error_before_the_first_hit_hides_no_later_one(rows):
    # nobody acknowledges the frames, and the rule acts on the second one alone
    bus = """bus: { name: b, bitrate: 500000 }
nodes:
  - { name: engine, one-shot: on, traffic: [ { send: 123#11 }, { send: 124#11, offset: 9ms } ] }
  - { name: dash, listen-only: on }
faults: [ { name: hit, when: { frame: "124" }, do: { flip: "data[0.0]", at: [engine] } } ]
expect: [ { name: calm, errors: 0 } ]
"""
    file, every = rows("scenario: bus.yaml\nvary: [ { name: bit, set: faults.hit.do.flip, "
                       'positions: "data[0..0].*" } ]\n', bus)
    for row in every:
        assert row["first_error"]["type"] == "ack" and row["first_error"]["t"] < 0.001
        assert row["latency"] == 0  # the engine sees its own bit
    assert in_json(file)["classes"]["expectation failed but detected"]["rows"] == 8


def test_an_error_that_a_deviating_clock_shows_before_the_hit_is_due_to_it(rows):
    # the dash samples its own wrong bit before the bus ends that bit
    bus = """bus: { name: b, bitrate: 1000000 }
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 10ms, count: 2 } ] }
  - { name: dash }
faults:
  - { name: hit, when: { frame: "123", count: 40 }, do: { flip: "eof[4]", at: [dash] } }
expect: [ { name: calm, errors: 0 } ]
"""
    file, every = rows("""scenario: bus.yaml
until: 100ms
vary:
  - { set: nodes.engine.ppm, values: [ 0, 100, -100 ] }
  - { set: faults.hit.do.flip, positions: [ "eof[0..5]" ] }
""", bus)
    early = 0
    for row in every:
        seen = row["first_error"]
        assert (seen["node"], seen["type"]) == ("dash", "form") and row["latency"] is not None
        early += row["factors"]["nodes.engine.ppm"] != 0 and row["latency"] == 0
    assert early > 0
    classes = in_json(file)["classes"]
    assert classes["failed undetected"]["rows"] == 0
    assert classes["expectation failed but detected"]["rows"] == len(every)


# ---- files ---------------------------------------------------------------------------------------

def test_no_output_replaces_an_input_or_another_output(rows, tmp_path):
    file, _ = rows(PASSING)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "link").symlink_to(file)
    for name in "rows.ndjson", "./rows.ndjson", "link", "campaign.yaml", "bus.yaml":
        for option in "--json", "--html", "--junit":
            found = report(file, option, name, status=1, cwd=tmp_path)
            assert f"{option} {name}: the report reads this file" in found.stderr
            assert found.stdout == ""
    shell = f"'{CANWIRE}' campaign report - --json rows.ndjson < rows.ndjson; test $? = 1"
    assert "reads this file" in run("sh", "-c", shell, cwd=tmp_path).stderr
    for first, second in (("new", "new"), ("new", "./new"), ("-", "-")):
        found = report(file, "--json", first, "--junit", second, status=1, cwd=tmp_path)
        assert f"--junit {second}: it is the file of --json, too" in found.stderr
    (tmp_path / "link").unlink()
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    report(file, "--json", "new", "--junit", "other", cwd=tmp_path)
