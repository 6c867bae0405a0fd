# SPDX-License-Identifier: MIT
"""`canwire sim --journal`: outputs, messages and exit status.

Needs no CAN in the kernel. That the events are those of the live run is tested in
tests/unit/engine/test_journal_play.c and, with canwired on real vcan, in
tests/kernel/test_journal.py.
"""

import json
import os
import re
import subprocess

import pytest

from simtool import ROOT, canwire, sim

pytestmark = pytest.mark.kept

TICKS_PER_S = 80_000_000
VERSION = canwire("--version").stdout.split()[-1]

FIRST = """
bus: { name: night, bitrate: 500000 }
nodes: [ { name: a }, { name: b } ]
"""
SECOND = """
bus: { name: night, bitrate: 500000 }
nodes: [ { name: b }, { name: c }, { name: a } ]
"""
NONE = dict.fromkeys(("frames", "error_frames", "overload_frames", "arbitration_lost", "faults",
                      "pending"), 0)
RELOAD_TICK = TICKS_PER_S // 100


def config(text):
    return [{"name": "bus.yaml", "text": text}]


def send(node, frame, tick):
    return {"at": tick, "send": node, "frame": frame, "tick": tick}


def lines(second=SECOND, first=FIRST):
    """Returns a frame, another configuration after 10 ms, and two more frames."""
    return [
        {"canwire-journal": 1, "canwire": VERSION},
        {"at": 0, "config": config(first)},
        send("a", "123#", 0),
        {"at": RELOAD_TICK, "reload": config(second)},
        send("a", "124#", 2 * RELOAD_TICK),
        send("b", "125#", 3 * RELOAD_TICK),
        {"at": 4 * RELOAD_TICK, "end": dict(NONE, frames=3)},
    ]


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    def write(entries, end="\n"):
        path = tmp_path / "journal"
        path.write_text("\n".join(json.dumps(entry) for entry in entries) + end)
        return path

    return write


def play(path, *arguments, status=0):
    return sim("--journal", path, *arguments, status=status)


def sent(path, *arguments):
    events = map(json.loads, play(path, "--events", "-", *arguments).stdout.splitlines())
    return [(event["node"], event["frame"]) for event in events if event["event"] == "tx"]


def test_names_are_those_of_their_time(write):
    assert sent(write(lines())) == [("a", "123#"), ("a", "124#"), ("b", "125#")]


def test_defaults_of_nodes_are_in_it(write):
    text = FIRST + "defaults: { queue: 1, one-shot: on }\n"
    entries = lines(text, text)
    entries[2:3] = [send("a", "123#", 0), send("a", "122#", 0), send("a", "121#", 0)]
    entries[-1]["end"]["frames"] = 3
    events = map(json.loads, play(write(entries), "--events", "-").stdout.splitlines())
    assert [event["why"] for event in events if event["event"] == "drop"] == ["queue-full"] * 2


def test_each_configuration_is_judged(write, tmp_path):
    first = FIRST + "expect: [ { name: before, delivered: 1, from: a } ]\n"
    second = SECOND + "expect: [ { name: after, delivered: 1, from: a } ]\n"
    path = write(lines(second, first))
    report = play(path).stdout
    result = play(path, "--junit", tmp_path / "junit")
    assert report.endswith(result.stdout)
    assert result.stdout.splitlines() == [
        "ok     before: wanted 1 frame from a, got 1",
        "ok     after: wanted 1 frame from a, got 1",
        "2 expectations, 2 met, 0 failed",
    ]
    text = (tmp_path / "junit").read_text()
    assert 'tests="2"' in text and 'name="before"' in text and 'name="after"' in text
    worse = lines(second.replace("delivered: 1", "delivered: 2"), first)
    assert "FAILED after" in play(write(worse), status=3).stdout


def test_cases_of_each_configuration_have_names_and_times_of_their_own(write, tmp_path):
    text = FIRST + ("expect: [ { name: same, errors: 0 }, { drops: 0 }, { drops: 0 }, "
                    "{ name: rest, restarts: 0, time: 15ms.. } ]\n")
    entries = lines(text, text)
    entries.insert(5, {"at": 2 * RELOAD_TICK + RELOAD_TICK // 2, "reload": config(FIRST)})
    entries.insert(6, {"at": 3 * RELOAD_TICK, "reload": config(text)})
    play(write(entries), "--junit", tmp_path / "junit", status=3)
    cases = re.findall(r'<testcase name="([^"]*)" classname="night" time="([^"]*)"',
                       (tmp_path / "junit").read_text())
    drops = "0 frames dropped"
    assert cases == [  # the third one expects nothing
        ("same (configuration 1)", "0.010"), (f"{drops} (configuration 1)", "0.010"),
        (f"{drops} (configuration 1) (2)", "0.010"), ("rest (configuration 1)", "0.000"),
        ("same (configuration 2)", "0.015"), (f"{drops} (configuration 2)", "0.015"),
        (f"{drops} (configuration 2) (2)", "0.015"), ("rest (configuration 2)", "0.010"),
        ("same (configuration 4)", "0.010"), (f"{drops} (configuration 4)", "0.010"),
        (f"{drops} (configuration 4) (2)", "0.010"), ("rest (configuration 4)", "0.010")]


def test_until_ends_it_before(write):
    assert sent(write(lines()), "--until", "15ms") == [("a", "123#")]
    assert sent(write(lines()), "--until-event", "tx:124") == [("a", "123#"), ("a", "124#")]
    assert len(sent(write(lines()), "--until", "1h")) == 3


@pytest.mark.parametrize("event", ["tx:124", "rx:125", "bus-off", "b:tx", "drop"])
def test_an_event_ends_all_where_it_does_with_care_in_every_bit(event, write):
    path, words = write(lines()), ("--until-event", event, "--events", "-", "--stats", "-")
    quick, careful = play(path, *words), play(path, *words, "--step")
    assert (quick.stdout, quick.stderr) == (careful.stdout, careful.stderr)


def test_a_journal_from_a_pipe_is_read_once(write, tmp_path):
    path = write(lines())
    os.mkfifo(tmp_path / "pipe")
    with subprocess.Popen(["cp", path, tmp_path / "pipe"]) as writer:
        assert sent(tmp_path / "pipe", "--until-event", "tx:124") == [("a", "123#"), ("a", "124#")]
    assert writer.returncode == 0


def test_a_skip_can_be_waited_for(write):
    entries = lines()
    entries.insert(4, {"at": 2 * RELOAD_TICK - 160, "skip": 1000})
    events = play(write(entries), "--events", "-", "--until-event", "skip").stdout.splitlines()
    assert '"event":"skip"' in events[-1]
    assert not any('"event":"skip"' in line or "124#" in line for line in events[:-1])


def test_a_node_that_is_waited_for_keeps_its_name(write):
    assert sent(write(lines()), "--until-event", "b:tx") == sent(write(lines()))
    events = play(write(lines()), "--events", "-", "--until-event", "b:rx:124").stdout.splitlines()
    assert '"b","event":"rx","frame":"124#"' in events[-2]  # c gets it at the same time


def test_a_node_that_goes_is_told_once(write):
    path = write(lines(first=FIRST.replace("{ name: b }", "{ name: b }, { name: x }")))
    told = play(path, "--until-event", "x:tx").stderr
    assert told.count("there is no node 'x'") == 1
    assert told == play(path, "--until-event", "x:tx", "--step").stderr


def test_statistics_go_on(write):
    stats = json.loads(play(write(lines()), "--stats", "-").stdout)
    assert stats["bus"]["frames"] == 3 and stats["bus"]["time_ns"] == 40_000_000
    assert {node["name"]: node["tx_frames"] for node in stats["nodes"]} == {"a": 2, "b": 1, "c": 0}


def nodes_in(vcd):
    """Returns the nodes in their order."""
    names = [line.split()[4] for line in vcd.splitlines() if line.startswith("$var")]
    return [name.removesuffix(".driven") for name in names if name.endswith(".driven")]


def test_bits_of_either_configuration(write, tmp_path):
    vcd = tmp_path / "vcd"
    assert play(write(lines()), "--vcd", vcd, "--from", "0s", "--to", "1ms").stderr == ""
    assert nodes_in(vcd.read_text()) == ["a", "b"]
    play(write(lines()), "--vcd", vcd, "--from", "20ms", "--to", "21ms")
    assert nodes_in(vcd.read_text()) == ["b", "c", "a"]


def test_bits_end_where_the_nodes_change(write, tmp_path):
    result = play(write(lines()), "--vcd", tmp_path / "vcd", "--svg", tmp_path / "svg", "--from",
                  "9500us", "--to", "11ms")
    assert "the bus goes over to other nodes at 0.010000000 s" in result.stderr
    assert nodes_in((tmp_path / "vcd").read_text()) == ["a", "b"]
    assert (tmp_path / "svg").read_text().rstrip().endswith("</svg>")


def test_bits_go_on_with_the_same_nodes(write, tmp_path):
    same = lines(FIRST.replace("500000 }", "500000 }\nseed: 1"))
    result = play(write(same), "--vcd", tmp_path / "vcd", "--from", "9500us", "--to", "21ms")
    assert result.stderr == ""
    last = [line for line in (tmp_path / "vcd").read_text().splitlines() if line[0] == "#"][-1]
    assert int(last[1:]) == 210_000  # 100 ns


def test_a_capture_has_a_section_for_each(write, tmp_path):
    play(write(lines()), "--pcapng", tmp_path / "pcapng")
    assert (tmp_path / "pcapng").read_bytes().count(b"\x0a\x0d\x0d\x0a") == 2
    play(write(lines(FIRST)), "--pcapng", tmp_path / "pcapng")
    assert (tmp_path / "pcapng").read_bytes().count(b"\x0a\x0d\x0d\x0a") == 1


def test_steps_and_leaps_are_the_same(write):
    whole = play(write(lines()), "--events", "-").stdout
    assert play(write(lines()), "--events", "-", "--step").stdout == whole != ""


# ---- Journals of before --------------------------------------------------------------------------

OLD = {"night": "139 inputs, 0 s to 0.172044000 s", "rig": "96 inputs, 0 s to 0.103558000 s"}


@pytest.mark.parametrize("name", OLD)
@pytest.mark.parametrize("pack", [None, ["zstd", "-q"], ["zstd", "-q", "--ultra", "-22"]])
def test_a_journal_of_version_2_or_3_is_read_as_then(name, pack, tmp_path):
    """Those of canwire 0.2.0, with all frames, of a bus and of a rig; and the events of then."""
    path = ROOT / f"tests/tool/journals/{name}.journal"
    if pack:
        subprocess.run([*pack, "-o", tmp_path / name, path], check=True)
        path = tmp_path / name
    run = play(path, "--events", "-")
    assert run.stdout == (ROOT / f"tests/tool/journals/{name}.events").read_text()
    assert f", {OLD[name]}, ended)" in canwire("check", "--journal", path).stdout


# ---- What is said --------------------------------------------------------------------------------


def test_a_journal_that_is_cut_off_is_good_as_far_as_it_goes(write):
    path = write(lines()[:-1], end="")
    result = play(path, "--events", "-")
    assert result.stderr.startswith(
        f"{path}: the journal is cut off at 0.020000000 s (line 6, byte 443); "
        "what followed is not known\n")
    assert '"124#"' not in result.stdout


def test_another_version_is_mentioned(write):
    entries = lines()
    entries[0]["canwire"] = "0.0.0"
    assert f"written by canwire 0.0.0; this is {VERSION}" in play(write(entries)).stderr


def test_another_run_is_status_one(write):
    entries = lines()
    entries[-1]["end"]["frames"] = 4
    path = write(entries)
    assert f"{path}:7:24: this run is another one" in play(path, status=1).stderr


def test_a_bad_line_is_status_one_and_says_where(write):
    entries = lines()
    entries[4]["send"] = "z"
    path = write(entries)
    result = play(path, "--events", "-", status=1)
    assert f"{path}:5:25: there is no node 'z'" in result.stderr
    assert '"123#"' in result.stdout  # as far as it is good


def test_a_configuration_with_errors_is_told_by_its_name(write):
    entries = lines()
    entries[1]["config"] = config("bus: { bitrat: 1 }")
    assert "bus.yaml:1:8: bus: unknown key 'bitrat'" in play(write(entries), status=1).stderr


@pytest.mark.parametrize("arguments", [["bus.yaml"], ["--seed", "1"]])
def test_wrong_usage_is_status_two(write, arguments):
    assert "usage: canwire sim" in play(write(lines()), *arguments, status=2).stderr


def test_what_is_no_journal_is_status_one(tmp_path):
    assert f"{tmp_path}/none: No such file or directory" in play(tmp_path / "none", status=1).stderr
    assert f"{tmp_path}:1:1: cannot read: " in play(tmp_path, status=1).stderr
    (tmp_path / "bus.yaml").write_text(FIRST)
    assert "bus.yaml:1:" in play(tmp_path / "bus.yaml", status=1).stderr
