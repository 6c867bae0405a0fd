# SPDX-License-Identifier: MIT
"""canwire campaign report --scenarios: what stays true of a row when it is made shorter."""

import json
import shlex
import time

import pytest
import yaml

from simtool import CANWIRE, canwire, run
from test_campaign_report import class_of, outcome, reasons_of

BODY = """bus: { name: body, bitrate: 125000 }
nodes:
  - name: airbag
    traffic:
      - { send: 050#01, every: 50ms, offset: 5ms, count: 4 }
      - { send: 051#, every: 20ms, count: 9 }
      - { replay: drive.log }
  - { name: door, traffic: [ { send: 400#00, every: 20ms, count: 10 } ] }
  - { name: gateway }
faults:
  - { name: idle, when: { frame: "7FF" }, do: { flip: "crc[1]" } }
  - { name: hit, when: { frame: "%s", count: %d }, do: { %s } }
"""
TRAIN = """bus: { name: rig, bitrate: 500000 }
nodes:
  - { name: engine, traffic: [ { send: 100#00, every: 10ms, count: 20 } ] }
  - { name: brakes }
  - { name: gateway }
expect:
  - { name: "it arrives", delivered: { min: 4 }, frame: "020", to: brakes }
"""
LEFT = "bus: { name: left, bitrate: 500000 }\nnodes: [ { name: a }, { name: b } ]\n"
RIG = """buses: [ body.yaml, parts/train.yaml, left.yaml ]
gateways:
  - { name: useless, between: [ "left:a", "body:door" ], rules: [ { filter: "7F0" } ] }
  - name: central
    between: [ "body:gateway", "rig:gateway" ]
    rules:
      - { filter: "7F0:7F0", direction: both }
      - { filter: "050", id: "020", delay: 100us, direction: forward }
"""
DROP = "drop: rx, at: [ gateway ]"
FLIP = 'flip: "crc[3]", at: [ gateway ]'


@pytest.fixture(name="report")
def fixture_report(tmp_path):
    """report(rows, ...) is a report with its shortest scenarios, in the folder `short`."""
    def report(rows, *options):
        done = canwire("campaign", "report", rows, "--scenarios", "short", "--json", "-",
                       "--minimise", "1h", *options, cwd=tmp_path)
        return json.loads(done.stdout)
    return report


@pytest.fixture(name="rows")
def fixture_rows(write, tmp_path):
    """rows(campaign, NAME=text ...) runs a campaign: the file of its rows, and the rows."""
    def rows(campaign, **files):
        for name, text in files.items():
            write(text, f"{name}.yaml")
        write(campaign, "campaign.yaml")
        out = tmp_path / "rows.ndjson"
        run("sh", "-c", shlex.join([CANWIRE, "campaign", "run", "campaign.yaml", "--out",
                                    str(out)]) + " || test $? = 3", cwd=tmp_path)
        return out, [json.loads(line) for line in out.read_bytes().splitlines()]
    return rows


# ---- rigs ----------------------------------------------------------------------------------------

@pytest.fixture(name="rig_rows")
def fixture_rig_rows(rows, write, tmp_path):
    """The rows of a campaign with a rig: a frame that a gateway loses, and a node in trouble."""
    (tmp_path / "parts").mkdir()
    write(TRAIN, "parts/train.yaml")
    write("(0.000100) can0 456#00\n", "drive.log")
    return rows("scenario: rig.yaml\nvary:\n"
                '  - { name: body, set: "buses[0]", values: [ body.yaml, calm.yaml, bad.yaml ] }\n'
                '  - { name: d, set: "gateways.central.rules[1].delay", values: [ 100us, 1ms ] }\n',
                rig=RIG, left=LEFT, body=BODY % ("050", 1, DROP), calm=BODY % ("7FE", 1, FLIP),
                bad=BODY % ("400", 300, FLIP))


def test_the_shortest_rig_does_the_same(rig_rows, report, tmp_path):
    file, every = rig_rows
    found = report(file)
    one = found["scenarios"][0]
    folder = tmp_path / "short"
    assert one["class"] == "failed undetected" == class_of(every[one["number"]])
    assert one["name"] == "failed-undetected-1/rig.yaml" and one["minimised"] and one["run_again"]
    assert one["expectation"] == "it arrives" and (one["rules"], one["traffic"]) == (1, 1)
    assert (folder / one["name"]).read_text() == one["yaml"]
    assert one["yaml"].splitlines()[2] == f"# {one['command']}"
    # the buses are beside the rig, one of them has the name `rig`, and one is gone
    assert sorted(one["buses"]) == ["bus-body.yaml", "bus-rig.yaml"]
    for name, text in one["buses"].items():
        assert (folder / "failed-undetected-1" / name).read_text() == text
    rig = yaml.safe_load(one["yaml"])
    assert rig["buses"] == ["bus-body.yaml", "bus-rig.yaml"]
    assert [gateway["name"] for gateway in rig["gateways"]] == ["central"]
    assert [rule["filter"] for rule in rig["gateways"][0]["rules"]] == ["050"]
    body = yaml.safe_load(one["buses"]["bus-body.yaml"])
    assert [rule["name"] for rule in body["faults"]] == ["hit"]
    assert [node.get("traffic") for node in body["nodes"]] == [
        [{"send": "050#01", "every": "50ms", "offset": "5ms", "count": 4}], None, None]
    canwire("check", folder / one["name"])
    row = outcome(one["command"], folder)
    assert class_of(row) == "failed undetected"
    assert [each["name"] for each in row["expectations"]["failed"]] == ["it arrives"]
    # without the rule all is well
    del body["faults"]
    (folder / "failed-undetected-1/bus-body.yaml").write_text(yaml.safe_dump(body))
    assert outcome(one["command"], folder)["outcome"] == "passed"


def test_a_rig_of_which_one_bus_is_left_is_a_bus(rig_rows, report, tmp_path):
    file, every = rig_rows
    degraded = [one for one in report(file)["scenarios"] if one["class"] == "degraded"]
    for one in degraded:
        assert one["name"].endswith(".yaml") and "/" not in one["name"] and "buses" not in one
        assert reasons_of(outcome(one["command"], tmp_path / "short")) == one["degraded_by"]
        assert one["degraded_by"] == reasons_of(every[one["number"]])
    assert degraded and (degraded[0]["rules"], degraded[0]["traffic"]) == (1, 1)
    page = tmp_path / "page.html"
    text = canwire("campaign", "report", file, "--scenarios", "short", "--html", page,
                   cwd=tmp_path).stdout
    assert "  failed-undetected-1/rig.yaml: 1 rule, 1 entry of traffic, 2 buses, " in text
    assert "# bus-rig.yaml\n" in page.read_text()


def test_seeds_of_a_rig_are_made_shorter_too(write, report, tmp_path):
    """Each bus of a rig has the seed of the row."""
    write(BODY.replace("count: %d", "count: 1, probability: 0.5").replace(
        "      - { replay: drive.log }\n", "") % ("050", DROP), "body.yaml")
    write(TRAIN, "train.yaml")
    write(LEFT, "left.yaml")
    write(RIG.replace("parts/", ""), "rig.yaml")
    out = tmp_path / "rows"
    run("sh", "-c", f"'{CANWIRE}' sim rig.yaml --seeds 1..8 >rows || test $? = 3", cwd=tmp_path)
    every = {row["seed"]: row for row in map(json.loads, out.read_text().splitlines())}
    one, = report(out)["scenarios"]
    assert every[one["seed"]]["outcome"] == "failed" and len(one["buses"]) == 2
    assert f"--seed {one['seed']}" in one["command"]
    assert outcome(one["command"], tmp_path / "short")["outcome"] == "failed"


# ---- the end of a run ----------------------------------------------------------------------------

def wear(*traffic):
    """A bus whose engine gets into trouble twice, and recovers in between. The rules of the profile
    go or stay together."""
    return f"""bus: {{ name: b, bitrate: 500000 }}
nodes:
  - {{ name: engine, traffic: [ {", ".join(traffic)} ] }}
  - {{ name: gearbox }}
  - {{ name: dash }}
profiles: [ {{ file: twice.yaml }} ]
"""


TWICE = """faults:
  - { name: first, when: { frame: "123", time: ..50ms, count: 16 }, do: { flip: "crc[3]" } }
  - { name: second, when: { frame: "123", time: 60ms.., count: 16 }, do: { flip: "crc[3]" } }
"""
ONE = ["{ send: 123#00, every: 1ms, count: 64 }"]
FOUR = ["{ send: 123#00, every: 1ms, offset: 5ms, count: 50 }",
        "{ send: 123#02, every: 1ms, offset: 60ms, count: 4 }",
        "{ send: 124#00, offset: 1ms }",
        "{ send: 123#01, every: 1ms, count: 4 }"]


def recovered(file):
    """When the engine became error-active again, in a run to the end."""
    events = canwire("sim", file, "--events", "-").stdout.splitlines()
    return [event["t"] for event in map(json.loads, events) if event["event"] == "state" and
            event["node"] == "engine" and event["state"] == "error-active"]


# Half of the time, or of the traffic, leaves the engine as the first rule has made it.
@pytest.mark.parametrize("traffic", [ONE, FOUR], ids=["time", "traffic"])
def test_a_run_does_not_end_in_a_bad_state_that_the_row_has_left(rows, report, tmp_path, write,
                                                                 traffic):
    write(TWICE, "twice.yaml")
    file, (row,) = rows("scenario: bus.yaml\nvary: [ { set: seed, values: [ 0 ] } ]\n",
                        bus=wear(*traffic))
    back, = recovered(tmp_path / "bus.yaml")
    assert row["t"] / 2 < back < 0.06 and "not error-active in the end" in reasons_of(row)
    one, = report(file)["scenarios"]
    assert one["minimised"] and one["traffic"] == 1
    last = outcome(one["command"], tmp_path / "short")
    assert reasons_of(last) == reasons_of(row) == one["degraded_by"]
    assert 0.06 < last["t"] < row["t"]


# ---- the time for it -----------------------------------------------------------------------------

ENDLESS = """scenario:
  bus: { name: b, bitrate: 1000000 }
  nodes:
    - { name: a, traffic: [ { send: 123#00, every: 200us } ] }
    - { name: b, traffic: [ { send: 124#00, every: 200us } ] }
until: 1000000s
limit: %s
vary: [ { set: seed, values: [ 7 ] } ]
"""
CUT_ROW = {"number": 0, "factors": {"seed": 7}, "seed": 7, "outcome": "time-out",
           "repeat": "canwire campaign run campaign.yaml --only 0"}


def report_of_a_time_out(write, report, limit, allowed):
    """A report of a row with a time-out: its scenario, and the seconds that it took."""
    write(ENDLESS % limit, "campaign.yaml")
    rows = write(json.dumps(CUT_ROW, separators=(",", ":")) + "\n", "rows.ndjson")
    begin = time.monotonic()
    one, = report(rows, "--minimise", allowed)["scenarios"]
    return one, time.monotonic() - begin


def test_a_trial_ends_with_the_time_for_all(write, report):
    # the first trial would take a minute
    one, taken = report_of_a_time_out(write, report, "60s", "300ms")
    assert taken < 50
    assert one["class"] == "time-out" and not one["run_again"] and not one["minimised"]
    assert one["yaml"].splitlines()[1].endswith("campaign.yaml, not run again for lack of time")


def test_a_time_out_is_one_when_its_limit_has_passed(write, report):
    one, taken = report_of_a_time_out(write, report, "1s", "1900ms")
    assert taken > 1
    assert one["run_again"] and not one["minimised"]


def test_a_row_whose_trial_takes_too_long_is_not_run_again(write, report):
    # the row says that it has crashed; nothing shows that within the time
    row = dict(CUT_ROW, outcome="crashed", why="signal SEGV")
    row["repeat"] = row.pop("repeat")
    write(ENDLESS % "60s", "campaign.yaml")
    rows = write(json.dumps(row, separators=(",", ":")) + "\n", "rows.ndjson")
    found = report(rows, "--minimise", "300ms")
    one, = found["scenarios"]
    assert one["class"] == "crashed" and not one["run_again"]
    assert found["scenarios_not_repeated"] == 0


# ---- odd rows ------------------------------------------------------------------------------------

ODD = """scenario:
  bus: { name: b, bitrate: 500000 }
  nodes:
    - { name: a, traffic: [ { send: 123#00, every: 1ms, count: 3 } ] }
    - { name: b }
  faults: [ { name: hit, when: { frame: "123", count: 1 }, do: { drop: rx, at: [b] } } ]
  expect: [ { name: "%s", delivered: { min: 3 }, to: b } ]
vary: [ { set: faults.hit.when.count, values: [ 1, 2 ] } ]
"""


@pytest.mark.parametrize("name", [
    r"Überlauf \u2014 # <b>&'", r"a\u2028bus: c", r"a\u2029bus: c", "line", "[x]: {y}"])
def test_names_in_any_script_make_files_that_can_be_read(rows, report, tmp_path, name):
    file, _ = rows(ODD % name)
    wanted = yaml.safe_load(f'"{name}"')
    one, = report(file)["scenarios"]
    assert one["expectation"] == wanted
    canwire("check", tmp_path / "short" / one["name"])
    row = outcome(one["command"], tmp_path / "short")
    assert [each["name"] for each in row["expectations"]["failed"]] == [wanted]


def test_rows_of_a_scenario_that_has_changed_since_are_no_scenarios(rows, report, write):
    file, _ = rows(ODD % "there")
    write((ODD % "there").replace("drop: rx", 'flip: "crc[1]"'), "campaign.yaml")
    found = report(file)
    assert found["scenarios"] == [] and found["scenarios_not_repeated"] == 1


def test_rows_of_two_campaigns_are_not_one_report(rows, write, tmp_path):
    file, _ = rows(ODD % "there")
    lines = file.read_text().splitlines(keepends=True)
    write(ODD % "there", "other.yaml")
    canwire_rows = "canwire campaign run other.yaml"
    mixed = write(lines[0] + lines[1].replace("canwire campaign run campaign.yaml", canwire_rows),
                  "mixed")
    done = canwire("campaign", "report", mixed, status=1, cwd=tmp_path)
    assert "mixed:2: it is of other.yaml, and the first row is of campaign.yaml" in done.stderr
    # other folders do not matter, nor do names when the campaign is given
    mixed.write_text(lines[0] + lines[1].replace("run campaign.yaml", "run x/campaign.yaml"))
    canwire("campaign", "report", mixed, cwd=tmp_path)
    mixed.write_text(lines[0] + lines[1].replace("run campaign.yaml", "run other.yaml"))
    canwire("campaign", "report", mixed, "--campaign", "campaign.yaml", cwd=tmp_path)
