# SPDX-License-Identifier: MIT
"""A run tells its losses: frames dropped or never sent, rules that never act, early ends.

`canwire sim` tells at its end, rows and reports of campaigns have it, and `canwire check` warns of
what can be seen before. A run without losses stays silent. Needs no CAN in the kernel.
"""

import json
import re

import pytest

from simtool import ROOT, canwire, sim

CROWD = "".join(f"      - {{ send: {0x101 + i:03X}#00, every: 100ms, count: 10 }}\n"
                for i in range(17))
FULL = "bus: { bitrate: 500000 }\nnodes:\n  - name: a\n    QUEUE\n    traffic:\n" + CROWD + \
    "  - { name: b }\n"


def warnings(path):
    """Returns the warnings of `canwire check`, which does not fail for them."""
    return [line.split(": warning: ")[1] for line in canwire("check", path).stderr.splitlines()]


# ---- Queues --------------------------------------------------------------------------------------


def test_frames_that_the_queue_cannot_hold_are_told_with_what_helps(write):
    path = write(FULL.replace("QUEUE", "queue: 16"))
    for step in ([], ["--step"]):
        result = sim(path, "--log", "-", *step)
        assert result.stderr == \
            "dropped: a: 10 frames, queue-full (111, …): queue: 17 or offsets\n"
        assert len(result.stdout.splitlines()) == 160
    assert canwire("check", path).stderr == \
        f"{path}:6:9: warning: a: 17 frames come at 0ns and its queue holds 16, so others are " \
        "dropped: queue: 17 or offsets\n"


def test_what_helps_helps(write):
    for text in (FULL.replace("QUEUE", "queue: 17"),
                 FULL.replace("QUEUE", "queue: 16").replace("117#00,", "117#00, offset: 5ms,", 1)
                 .replace("111#00,", "111#00, offset: 5ms,")):
        path = write(text)
        assert sim(path).stderr == "" and canwire("check", path).stderr == ""


def test_entries_that_meet_later_are_found(write):
    """Entries with periods of 6, 10 and 15 ms meet at 30 ms."""
    entries = ("{ send: 101#, every: 6ms }, { send: 102#, every: 10ms }, "
               "{ send: 103#, every: 15ms }, { send: 104#, every: 1s, offset: 30ms }")
    path = write("bus: { bitrate: 500000 }\nnodes:\n  - { name: a, queue: 3, traffic: [ "
                 f"{entries} ] }}\n  - {{ name: b }}\n")
    assert warnings(path) == ["a: 4 frames come at 30ms and its queue holds 3, so others are "
                              "dropped: queue: 4 or offsets"]
    jitter = write(path.read_text().replace("every: 6ms", "every: 6ms, jitter: 1ms"))
    assert warnings(jitter) == []


def test_each_node_and_reason_has_a_line(write):
    path = write("""
bus: { bitrate: 500000 }
nodes:
  - { name: a, queue: 1, traffic: [ { send: 12345678#, every: 100us, count: 50 } ] }
  - { name: b, one-shot: on, traffic: [ { send: 200# }, { send: 201# } ] }
  - { name: c, listen-only: on, traffic: [ { send: 300# } ] }
  - { name: d }
faults:
  - { name: lose, when: { frame: "201" }, do: { flip: "crc[3]", at: d } }
  - { name: asked, when: { frame: "200" }, do: { drop: rx, at: d } }
""")
    told = sim(path).stderr.splitlines()
    assert len(told) == 3
    assert "dropped: c: 1 frame, listen-only (300): listen-only: off lets it send" in told
    assert "dropped: b: 1 frame, one-shot (201): one-shot: off repeats them" in told
    assert re.search(r"^dropped: a: \d\d frames, queue-full \(12345678, …\): queue: more than 1, "
                     "offsets or less traffic$", "\n".join(told), re.MULTILINE)


# ---- Acknowledgement, early ends -----------------------------------------------------------------


def test_a_node_alone_is_told(write):
    alone = "bus: { bitrate: 500000 }\nnodes: [ { name: a, traffic: [ { send: 100# } ] } ]\n"
    path = write(alone)
    assert warnings(path) == ["a: no other node acknowledges its frames, so it never gets one "
                              "through: add a node, or presume-ack: on"]
    assert sim(path).stderr == (
        "canwire sim: ended after 10 s of bus time without a frame, while frames wait "
        "(--until TIME waits longer)\nnot sent: a: 1 frame: no other node acknowledges\n")
    assert sim(path, "--until", "1s").stderr == \
        "not sent: a: 1 frame: no other node acknowledges\n"
    listener = write(alone.replace("] } ]", "] }, { name: b, listen-only: on } ]"))
    assert len(warnings(listener)) == 1
    for more in ("] }, { name: b } ]", "] }, { name: b, listen-only: on, port: vcan0 } ]",
                 "], presume-ack: on } ]"):
        assert warnings(write(alone.replace("] } ]", more))) == []


@pytest.mark.parametrize("kind, count", [("classical", 1), ("fd-tolerant", 1), ("fd", 0)])
def test_no_other_node_knows_fd(write, kind, count):
    assert len(warnings(write(f"""
bus: {{ bitrate: 500000, dbitrate: 2000000 }}
nodes:
  - {{ name: a, traffic: [ {{ send: 100##100 }} ] }}
  - {{ name: b, kind: {kind} }}
"""))) == count


def test_a_window_that_sends_once_has_no_key_against_it():
    done = sim(ROOT / "config/time-triggered/matrix.yaml", "--until", "100ms")
    assert re.search(r"^dropped: front: \d+ frames, one-shot \(302, …\)$", done.stderr,
                     re.MULTILINE)


def test_a_bus_off_node_keeps_its_frames(write):
    path = write("""
bus: { bitrate: 500000 }
nodes: [ { name: a, traffic: [ { send: 100#, count: 40, every: 1ms } ] }, { name: b } ]
faults: [ { name: kill, when: { frame: "100" }, do: { flip: "crc[1]" } } ]
""")
    told = sim(path).stderr
    assert "dropped: a: " in told
    assert "bus-off (100, …): restart-ms: TIME brings the node back" in told


@pytest.mark.parametrize("entry, name, gap", [
    ("{ replay: r.log }", "a", "from 8s to 18.5s"),
    ("{ send: 100#, every: 11s, count: 2 }", "a", "from 0ns to 11s"),
    ("{ send: 100#, offset: 12s }", "a", "from 0ns to 12s")])
def test_a_gap_that_ends_a_run_is_told(entry, name, gap, write, tmp_path):
    (tmp_path / "r.log").write_text("(1.0) c 123#\n(9.0) c 124#\n(19.5) c 125#\n")
    path = write("bus: { bitrate: 500000 }\nnodes: [ { name: a, traffic: [ " + entry +
                 " ] }, { name: b } ]\n")
    assert warnings(path) == [f"{name}: no frame comes {gap}: canwire sim ends after 10 s without "
                              "one, with --until TIME it goes on"]
    assert sim(path).stderr == \
        "canwire sim: ended before the last release, after 10 s of bus time without a frame; " \
        f"the next one, of a, comes at {gap.split()[-1]} (--until TIME waits longer)\n"
    assert sim(path, "--until", "20s").stderr == ""
    bridged = write(path.read_text().replace("{ name: b }", "{ name: b, traffic: [ "
                                             "{ send: 7FF#, every: 5s, count: 4 } ] }"))
    assert warnings(bridged) == [] and sim(bridged).stderr == ""


# ---- Rules ---------------------------------------------------------------------------------------

RULES = """
bus: { bitrate: 500000 }
nodes: [ { name: a, traffic: [ { send: 100#00 } ] }, { name: b } ]
faults:
"""


def rules(*texts):
    return RULES + "".join(f"  - {{ name: r{i}, {text} }}\n" for i, text in enumerate(texts))


def test_a_run_goes_on_to_the_time_of_a_rule(write):
    path = write(rules("when: { time: 1ms }, do: { bus-off: a }") +
                 "expect: [ { state: bus-off, node: a, reached: never } ]\n")
    for until in ([], ["--until", "2ms"]):
        assert "1 failed" in sim(path, *until, status=3).stdout
    short = sim(path, "--until", "500us")
    assert short.stderr == "rule r0: never matched: the run ended before 1ms\n"


CIRCLE = ("when: { after: { rule: r1 } }, do: { bus-off: a }",
          "when: { after: { rule: r0 } }, do: { bus-off: a }",
          "when: { after: { rule: r1 } }, do: { bus-off: a }")


@pytest.mark.parametrize("texts, told, warned", [
    (("when: { frame: '123' }, do: { flip: 'crc[1]' }",),
     ["rule r0: never matched: no node sends such a frame"],
     ["rule r0: no node sends a frame that it waits for"]),
    (("when: { frame: '100', from: b }, do: { flip: 'crc[1]' }",),
     ["rule r0: never matched: no node sends such a frame"],
     ["rule r0: no node sends a frame that it waits for"]),
    (("when: { frame: '100', time: 1s.. }, do: { flip: 'crc[1]' }",),
     ["rule r0: never matched: the run ended before 1s"], []),
    (("when: { frame: '100' }, do: { flip: 'data[4.0]' }",), ["rule r0: never matched"], []),
    (CIRCLE,
     ["rule r0: never matched: never armed, since rule r1 has not acted",
      "rule r1: never matched: never armed, since rule r0 has not acted",
      "rule r2: never matched: never armed, since rule r1 has not acted"],
     [f"rule r{i} is never armed: the rules that come after each other go in a circle"
      for i in range(3)]),
])
def test_a_rule_that_never_matches_is_told(texts, told, warned, write):
    path = write(rules(*texts))
    assert sim(path).stderr.splitlines() == told
    assert sim(path, "--events", "-", "--step").stderr.splitlines() == told
    assert warnings(path) == warned


@pytest.mark.parametrize("texts", [
    ("when: { frame: '100', skip: 5 }, do: { flip: 'crc[1]' }",),  # it matches
    ("when: { frame: '100', probability: 0 }, do: { flip: 'crc[1]' }",),
    ("when: { manual: yes }, do: { bus-off: a }",  # a hand may come
     "when: { after: { rule: r0 } }, do: { bus-off: a }"),
    ("do: { send: 123#, as: b }", "when: { frame: '123', count: 1 }, do: { flip: 'crc[1]' }"),
    ("when: { frame: '100' }, do: { change: { id: 123 } }",
     "when: { frame: '123', count: 1 }, do: { flip: 'crc[1]' }"),
    ("do: { noise: 0 }",),
])
def test_a_rule_that_can_act_is_not_told(texts, write):
    path = write(rules(*texts))
    assert sim(path).stderr == "" and warnings(path) == []


@pytest.mark.parametrize("node, why", [("port: vcan0", ": programs at ports are not there"),
                                       ("traffic: [ { replay: r.log } ]", "")])
def test_check_is_silent_where_others_send(node, why, write, tmp_path):
    (tmp_path / "r.log").write_text("(1.0) c 124#\n")
    path = write(rules("when: { frame: '123' }, do: { flip: 'crc[1]' }")
                 .replace("{ name: b }", "{ name: b, " + node + " }"))
    assert warnings(path) == []
    assert f"rule r0: never matched{why}\n" in sim(path).stderr
    row = canwire("campaign", "run", write(f"scenario: {path.name}\nvary: [ {{ set: seed, values: "
                                           "[ 1 ] } ]\n", "camp.yaml"), cwd=tmp_path).stdout
    assert ('"lost":[]' in row) == ("port" in node)


# ---- Rules that come again -----------------------------------------------------------------------


def test_a_rule_comes_again_and_again(write):
    path = write(rules("when: { time: 1s.., period: 1s }, "
                       "do: { stuck: dominant, on: a.tx, for: 5ms }"))
    assert f"{path}:5:5: a rule with `period` never ends: give `count`, an end of its `time`, " \
        "--until TIME" in sim(path, status=1).stderr
    plain = sim(path, "--until", "4500ms", "--events", "-").stdout
    hits = [json.loads(line)["t"] for line in plain.splitlines() if '"fault"' in line]
    assert hits == [1, 2, 3, 4]
    assert sim(path, "--until", "4500ms", "--events", "-", "--step").stdout == plain


@pytest.mark.parametrize("when, hits", [
    ("time: 1s..3s, period: 500ms", [1, 1.5, 2, 2.5]),
    ("period: 4s, count: 3", [0, 4, 8]),
    ("period: 20s, count: 2", [0, 20]),
    ("time: 1s..2s, period: 1h", [1]),
])
def test_a_run_ends_with_the_last_time_of_a_rule(when, hits, write):
    path = write(rules(f"when: {{ {when} }}, do: {{ counters: b, rec: 0 }}"))
    found = [json.loads(line) for line in sim(path, "--events", "-").stdout.splitlines()]
    assert [e["t"] for e in found if e["event"] == "fault"] == hits
    last = json.loads(sim(path, "--stats", "-").stdout)["bus"]["time_ns"]
    assert 0 <= last - hits[-1] * 1e9 < 1e6


@pytest.mark.parametrize("when", ["period: 1s", "period: 1s, count: 1, state: { b: bus-off }",
                                  "period: 1s, count: 1, probability: 0"])
def test_a_rule_that_may_come_for_ever_needs_an_end(when, write):
    path = write(rules(f"when: {{ {when} }}, do: {{ counters: b, rec: 0 }}"))
    assert "a rule with `period` never ends" in sim(path, status=1).stderr
    assert sim(path, "--until", "3s", "--log", "-").stdout.count("\n") == 1


def test_a_campaign_of_such_a_rule_needs_an_end(write, tmp_path):
    write(rules("when: { period: 1s }, do: { counters: b, rec: 0 }"))
    text = "scenario: bus.yaml\nvary: [ { set: SET } ]\n"
    told = "bus.yaml:5:5: a rule with `period` never ends: give `until` in the campaign"
    other = write(text.replace("SET", "seed, values: [ 1, 2 ]"), "camp.yaml")
    assert told in canwire("campaign", "plan", other, status=1, cwd=tmp_path).stderr
    # each row decides where the rule varies
    same = write(text.replace("SET", "faults.r0.when.period, values: [ 1s, 2s ]"), "camp.yaml")
    rows = canwire("campaign", "run", same, status=1, cwd=tmp_path).stdout.splitlines()
    assert [json.loads(row)["why"].endswith(told) for row in rows] == [True] * 2
    bounded = write("until: 2500ms\n" + same.read_text(), "camp.yaml")
    rows = canwire("campaign", "run", bounded, cwd=tmp_path).stdout.splitlines()
    assert [json.loads(row)["faults"] for row in rows] == [3, 2]


# ---- Rigs and campaigns --------------------------------------------------------------------------


def test_a_rig_names_the_bus(write, tmp_path):
    write(FULL.replace("QUEUE", "queue: 16").replace("bus: {", "bus: { name: one,"), "one.yaml")
    write(rules("when: { frame: '123' }, do: { flip: 'crc[1]' }")
          .replace("bus: {", "bus: { name: two,"), "two.yaml")
    path = write("buses: [ one.yaml, two.yaml ]\n", "rig.yaml")
    assert sim(path).stderr == (
        "dropped: one:a: 10 frames, queue-full (111, …): queue: 17 or offsets\n"
        "rule two:r0: never matched: no node sends such a frame\n")
    assert canwire("check", path).stderr.count("warning: ") == 2
    write("buses: [ one.yaml, two.yaml ]\ngateways:\n  - { name: g, between: [ 'one:b', 'two:b' ], "
          "rules: [ { filter: '101' } ] }\n", "rig.yaml")
    told = sim(path).stderr
    assert "rule two:r0: never matched\n" in told  # frames of the other bus may match
    assert canwire("check", path).stderr.count("warning: ") == 1


def test_rows_and_reports_of_campaigns_have_it(write, tmp_path):
    write(FULL.replace("QUEUE", "queue: 16") +
          "faults: [ { name: x, when: { frame: '101', time: 2s.. }, do: { bus-off: a } } ]\n")
    campaign = write("scenario: bus.yaml\nvary:\n"
                     "  - { name: q, set: 'nodes[0].queue', values: [ 16, 17 ] }\n"
                     "  - { name: t, set: 'faults[0].when.time', values: [ 2s.., 500ms.. ] }\n",
                     "camp.yaml")
    result = canwire("campaign", "run", campaign, cwd=tmp_path)
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    dropped = {"node": "a", "why": "queue-full", "frames": 10, "ids": "111, …",
               "help": "queue: more than 16, offsets or less traffic"}
    never = {"rule": "x", "why": "never matched", "help": "the run ended before 2s"}
    lost = {(row["factors"]["q"], row["factors"]["t"]): row["lost"] for row in rows}
    assert lost[16, "2s.."] == [dropped, never] and lost[17, "2s.."] == [never]
    assert lost[17, "500ms.."][0]["why"] == "bus-off"
    (tmp_path / "rows").write_text(result.stdout)
    report = canwire("campaign", "report", "rows", "--json", "report.json", cwd=tmp_path).stdout
    assert "a: queue-full" in report and "rule x: never matched" in report
    assert "lost" in json.loads((tmp_path / "report.json").read_text())


def test_a_row_without_losses(write, tmp_path):
    write(FULL.replace("QUEUE", "queue: 17"))
    campaign = write("scenario: bus.yaml\nvary: [ { set: seed, values: [ 1, 2 ] } ]\n", "camp.yaml")
    result = canwire("campaign", "run", campaign, cwd=tmp_path)
    assert result.stdout.count('"lost":[]') == 2
    (tmp_path / "rows").write_text(result.stdout)
    report = canwire("campaign", "report", "rows", "--json", "-", cwd=tmp_path).stdout
    assert "lost" not in json.loads(report)
