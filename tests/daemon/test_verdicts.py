# SPDX-License-Identifier: MIT
"""canwired judges `expect` while it runs: log, status, LCM, exit status, report; over reloads; in
rigs.

Nodes have traffic of their own, so all times are those of the bus. CANWIRE and CANWIRED are the
programs.
"""

import contextlib
import importlib.util
import json
import re
import signal
import struct
import subprocess
import xml.etree.ElementTree as ET

import pytest

from busclient import Client
from simtool import CANWIRED, answer, canwire, kill_all, sim
from test_daemon import HOST, fixture_lcm_server, limit_files  # pylint: disable=unused-import
from test_record import PATIENCE_S, wait_until
from test_sinks import Bus

FEW = "{ name: few, delivered: { max: 20 }, frame: '123' }"
GAP = "{ gap: 50ms, frame: '124', to: dash }"
SOON = "{ name: soon, seen: yes, frame: '123', before: 100ms }"
MANY = "{ delivered: { min: 1000000 } }"
CALM = "{ name: calm, errors: 0 }"

FEW_FAILED = ("expectation failed at 200.106ms by tx 123#11 at load: few: wanted at most 20 frames "
              "123, got 21")
GAP_WANTED = "gaps of at most 50ms between frames 124 to dash"
GAP_FAILED = f"expectation failed at 50ms: wanted {GAP_WANTED}, got none since 0ns"
MET, FAILED, LOST = 0, 3, 1


def expect(*all_of_them, report="verdict.xml"):
    return f"expect-report: {report}\nexpect: [ {', '.join(all_of_them)} ]\n"


class Judge(Bus):
    """A canwired with expectations."""

    def verdicts(self):
        return {one["name"]: one for one in self.json().get("expectations", [])}

    def wait_failed(self, *names):
        wait_until(lambda: all(self.verdicts()[name]["state"] == "failed" for name in names), names)

    def end(self, status):
        self.manager.close()
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == status, self.log.read_text()
        return self.log.read_text()

    def report(self):
        return read_report(self.folder / "verdict.xml")


def read_report(file):
    """Returns the name of the suite, and the message of each case; None: it is met."""
    suites = ET.parse(file).getroot()
    [suite] = suites
    failures = {case.get("name"): [each.get("message") for each in case] for case in suite}
    assert suites.get("tests") == suite.get("tests") == str(len(failures))
    assert suites.get("failures") == str(sum(bool(each) for each in failures.values()))
    assert all(case.get("classname") == suite.get("name") for case in suite)
    return suite.get("name"), {name: each[0] if each else None for name, each in failures.items()}


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    started = []

    def start(more, *words, **changes):
        started.append(Judge(tmp_path, more, *words, **changes))
        started[-1].line("load")
        return started[-1]

    yield start
    kill_all(each.process for each in started)


def test_failures_are_told_once_and_everywhere(bus):
    running = bus(expect(FEW, GAP, SOON, MANY, CALM))
    running.wait_failed("few", GAP_WANTED)
    assert ", 2 expectations failed" in running.line("expectations failed")
    wait_until(lambda: running.verdicts()["soon"]["state"] == "met", "the window")
    now = running.verdicts()
    assert {name: one["state"] for name, one in now.items()} == {
        "few": "failed", GAP_WANTED: "failed", "soon": "met", "at least 1000000 frames": "open",
        "calm": "met"}
    assert (now["few"]["failed_ns"], now["few"]["event"]) == (200106000, "tx 123#11 at load")
    assert (now[GAP_WANTED]["failed_ns"], now[GAP_WANTED]["event"]) == (50000000, None)
    assert now["soon"]["got"] == "one at 128us" and "failed_ns" not in now["soon"]
    text = running.canwire("status", "./day.sock")
    assert "\n5 expectations: met 2 open 1 failed 2\n" in text
    assert "\n    FAILED few: wanted at most 20 frames 123, got " in text
    check = canwire("status", "--check", "./day.sock", status=1, cwd=running.folder).stdout
    assert ", 2 expectations failed" in check
    running.process.send_signal(signal.SIGTERM)
    running.line("expectation failed at ", " by the end of the run: wanted at least 1000000 frames")
    log = running.end(FAILED)
    assert log.count(FEW_FAILED + "\n") == log.count(GAP_FAILED + "\n") == 1
    assert log.count("expectation failed") == 3
    assert re.search(r"expectation failed at \S+ by the end of the run: wanted at least 1000000 "
                     r"frames, got \d+\n", log)
    assert "5 expectations, 2 met, 3 failed\n" in log
    name, cases = running.report()
    assert name == "day" and [key for key, why in cases.items() if not why] == ["soon", "calm"]
    assert cases["few"].startswith("wanted at most 20 frames 123, got ")
    assert cases["few"].endswith("; failed at 200.106ms by tx 123#11 at load")
    assert cases[GAP_WANTED].endswith("; failed at 50ms")


def test_a_bus_that_does_what_is_expected_ends_well(bus, tmp_path):
    (tmp_path / "verdict.xml").write_text("of yesterday")
    running = bus(expect(SOON, CALM))
    assert not (tmp_path / "verdict.xml").exists(), "nobody takes it for the verdict of today"
    running.line("load")
    sink = running.sinks()["expect-report", "verdict.xml"]
    assert (sink["state"], sink["good"], sink["written"], sink["lost"]) == ("judging", True, 2, 0)
    assert "\nexpect-report verdict.xml: judging verdicts 2\n" in running.canwire("status",
                                                                                  "./day.sock")
    wait_until(lambda: running.verdicts()["soon"]["state"] == "met", "the frame")
    assert "expectation failed" not in running.end(MET)
    assert running.report() == ("day", {"soon": None, "calm": None})


def test_without_expectations_nothing_is_said_of_them(bus):
    running = bus("")
    assert running.verdicts() == {} and "expect" not in running.canwire("status", "./day.sock")
    assert "expectation" not in running.end(MET)


def test_the_verdict_of_the_journal_is_the_same(bus, tmp_path):
    running = bus(expect(FEW, GAP, SOON, MANY, CALM), "--journal", "day.journal")
    running.wait_failed("few")
    running.end(FAILED)
    sim("--journal", "day.journal", "--junit", "again.xml", status=FAILED, cwd=tmp_path)
    told = {name: why and why.partition("; failed")[0] for name, why in running.report()[1].items()}
    again = read_report(tmp_path / "again.xml")[1]
    assert told.keys() == again.keys()
    for name in ("few", "soon", "calm", "at least 1000000 frames"):
        assert told[name] == again[name]


# ---- LCM -----------------------------------------------------------------------------------------

@pytest.fixture(name="verdict_t", scope="module")
def fixture_verdict_t(tmp_path_factory):
    folder = tmp_path_factory.mktemp("types")
    subprocess.run(["lcm-gen", "-p", "--ppath", folder, "config/lcm/verdict_t.lcm"], check=True)
    spec = importlib.util.spec_from_file_location("verdict_t",
                                                  folder / "canwire" / "verdict_t.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.verdict_t


def test_lcm_has_them(bus, lcm_server, verdict_t):
    """The last message has what only the end has decided."""
    server = lcm_server()
    running = bus(f"lcm: {{ url: 'tcpq://{HOST}:{server.port}', period: 50ms }}\n" +
                  expect(FEW, GAP, CALM, MANY))
    server.accept()
    received = b""

    def wait_told(failed):
        nonlocal received
        told = None
        while not told or told.failed < failed:
            received += server.client.recv(1 << 16)
            _, found, last = received.rpartition(b"CANWIRE.day.VERDICT")
            size = struct.unpack(">I", last[:4])[0] if len(last) > 4 else 0
            if found and 0 < size <= len(last) - 4:
                told = verdict_t.decode(last[4:4 + size])
        return told

    told = wait_told(2)
    assert (told.bus, told.expectations, told.failed, told.count) == ("day", 4, 2, 2)
    assert told.name == ["few", GAP_WANTED]
    assert told.wanted == ["at most 20 frames 123", GAP_WANTED]
    assert told.got == ["21", "none since 0ns"]
    assert told.event == ["tx 123#11 at load", ""]
    assert list(told.failed_ns) == [200106000, 50000000] and told.bus_time_ns >= 200106000
    running.process.send_signal(signal.SIGTERM)
    assert wait_told(3).name[-1] == "at least 1000000 frames"
    server.close()
    running.end(FAILED)


# ---- Reload --------------------------------------------------------------------------------------

def reload(running, *all_of_them, report="verdict.xml", status=0):
    text = (running.folder / "day.yaml").read_text()
    head = text.partition("expect-report:")[0]
    (running.folder / "day.yaml").write_text(head + expect(*all_of_them, report=report))
    return answer(running.folder, "reload", "./day.sock", status=status)


def test_expectations_over_reloads(bus):
    """Those that stay go on, those that change begin anew, those that have failed are kept."""
    once = "{ name: once, seen: yes, frame: '123', before: 100ms }"
    changed = "{ name: changed, delivered: { max: %d }, frame: '123' }"
    running = bus(expect(FEW, once, changed % 30, CALM, MANY))
    running.wait_failed("few", "changed")
    reload(running, once, changed % 1000000, "{ name: late, seen: yes, frame: '7FF', before: 1ms }")
    running.wait_failed("late")
    states = [(one["name"], one["state"], one["removed"])
              for one in running.json()["expectations"]]
    assert states == [("few", "failed", True), ("changed", "failed", True), ("once", "met", False),
                      ("changed", "met", False), ("late", "failed", False)]
    reload(running, FEW, once)
    assert running.verdicts()["once"]["got"] == "one at 128us"
    log = running.end(FAILED)
    assert log.count(FEW_FAILED + "\n") == 1
    assert "expectation removed: calm\n" in log
    assert "expectation removed: at least 1000000 frames\n" in log
    _, cases = running.report()
    assert sorted(cases) == ["changed", "few (configuration 1)", "few (configuration 3)", "late",
                             "once"]
    assert cases["few (configuration 1)"] == ("wanted at most 20 frames 123, got 21; failed at "
                                              "200.106ms by tx 123#11 at load")
    assert not cases["once"] and "nothing: it is judged from " in cases["late"]


def test_a_kept_expectation_goes_on_counting(bus):
    kept = "{ name: kept, delivered: { max: 100 }, frame: '123', to: dash }"
    running = bus(expect(kept))
    text = (running.folder / "day.yaml").read_text().replace("nodes: [ ",
                                                             "nodes: [ { name: first }, ")
    (running.folder / "day.yaml").write_text(text)
    reload(running, kept, CALM)
    running.wait_failed("kept")
    assert running.verdicts()["kept"]["event"] == "rx 123#11 at dash"
    assert running.verdicts()["kept"]["failed_ns"] == 1000104000
    running.end(FAILED)


def test_a_guest_with_a_name_of_its_own_changes_no_verdict(bus, tmp_path):
    """It is told under its new name, also after a reload."""
    quiet = ("{ name: quiet, state: bus-off, reached: never, node: [ dash, guest-1 ], "
             "before: 100ms }")
    heard = "{ name: heard, delivered: { min: 3 }, frame: '123', to: guest-1 }"
    running = bus('guests: { count: 2, port: "unix:bus.sock" }\n' + expect(quiet, heard))
    wait_until(lambda: running.verdicts()["quiet"]["state"] == "met", "the window")
    with contextlib.closing(Client(tmp_path / "bus.sock", "tool")):
        wait_until(lambda: "tool" in running.verdicts()["quiet"]["wanted"], "its name")
        wait_until(lambda: running.verdicts()["heard"]["state"] == "met", "its frames")
        reload(running, quiet, heard, CALM)
        assert running.verdicts()["heard"]["state"] == "met"
    wait_until(lambda: "guest-1" in running.verdicts()["quiet"]["wanted"], "the old name")
    log = running.end(MET)
    assert "expectation removed" not in log and "failed at" not in log
    assert running.report()[1] == {"quiet": None, "heard": None, "calm": None}


def test_many_expectations_leave_room_in_a_reply(bus):
    never = ["{ name: '%03d %s', delivered: { min: 1 }, frame: '7FF', to: dash%s }" %
             (i, "x" * 190, ", before: 1ms" if i % 10 == 9 else "") for i in range(400)]
    running = bus(expect(*never))
    wait_until(lambda: sum(one["state"] == "failed" for one in running.verdicts().values()) == 40,
               "the windows")
    status = running.json()
    shown = len(status["expectations"])
    assert shown + status["expectations_left_out"] == 400 and 40 < shown < 400
    assert f"and {400 - shown} more" in running.canwire("status", "./day.sock")
    running.end(FAILED)


def test_a_gap_whose_window_is_over_says_so(bus):
    running = bus(expect(FEW))
    running.wait_failed("few")
    reload(running, FEW, "{ name: late, gap: 5s, frame: '124', before: 1ms }")
    running.wait_failed("late")
    late = running.verdicts()["late"]
    assert late["got"].startswith("nothing: it is judged from ") and late["failed_ns"] > 200000000
    running.end(FAILED)


def test_a_reload_to_another_report_removes_the_old_one(bus, tmp_path):
    (tmp_path / "other.xml").write_text("stale")
    running = bus(expect(CALM))
    reload(running, CALM, report="other.xml")
    wait_until(lambda: not (tmp_path / "other.xml").exists(), "its removal")
    running.end(MET)
    assert read_report(tmp_path / "other.xml") == ("day", {"calm": None})


# ---- A crash -------------------------------------------------------------------------------------

CRASHED = r"with the crash at \d{4}-\d\d-\d\d \d\d:\d\d:\d\d"


def test_verdicts_that_a_crash_has_lost_are_told(bus, tmp_path):
    running, rules = bus(expect(FEW, CALM)), tmp_path / "day.sock.rules"

    def crash():
        running.manager.close()
        running.process.kill()
        running.process.wait()
        (tmp_path / "manager").unlink()
        return bus(expect(FEW, CALM))

    def wait_noted(failed):
        wait_until(lambda: rules.exists() and
                   json.loads(rules.read_text())["judges"]["failed"] == failed, "a note")

    running.wait_failed("few")
    wait_noted(1)
    running = crash()
    lost = re.compile(f"2 verdicts were lost {CRASHED}, 1 of them failed")
    assert re.search(f"warning: {lost.pattern}\n", running.log.read_text())
    assert lost.search(running.line("verdicts were lost"))
    assert re.search(f"^{lost.pattern}$", running.canwire("status", "./day.sock"), re.M)
    told = running.json()["lost_verdicts"]
    assert (told["expectations"], told["failed"]) == (2, 1) and lost.fullmatch(told["note"])
    assert lost.search(canwire("status", "--check", "./day.sock", status=1, cwd=tmp_path).stdout)
    running.wait_failed("few")
    wait_noted(1)
    running = crash()
    assert re.search(f"4 verdicts were lost {CRASHED}, 2 of them failed", running.log.read_text())
    running.wait_failed("few")
    (tmp_path / "manager").unlink()
    running.end(FAILED)
    assert not rules.exists()
    assert "lost_verdicts" not in bus(expect(CALM)).json()


# ---- Reports that cannot be ----------------------------------------------------------------------

def test_a_report_that_cannot_be_written_is_refused(bus, tmp_path):
    why = "expect-report nowhere/v.xml: No such file or directory"
    (tmp_path / "bad.yaml").write_text(
        "bus: { name: bad, bitrate: 500000 }\nnodes: [ { name: a } ]\n" +
        expect(CALM, report="nowhere/v.xml"))
    started = subprocess.run([CANWIRED, "-c", "bad.yaml"], cwd=tmp_path, capture_output=True,
                             text=True, timeout=PATIENCE_S, check=False)
    assert started.returncode == LOST and f"bad.yaml:3:16: {why}" in started.stderr
    running = bus(expect(CALM))
    assert f"day.yaml:4:16: {why}" in reload(running, CALM, report="nowhere/v.xml", status=1)
    running.end(MET)
    assert running.report() == ("day", {"calm": None})


@pytest.mark.parametrize("more, message", [
    ("record: [ { file: verdict.xml, format: candump } ]\n", "verdict.xml"),
    ("lcm: { period: 1s }\nprofiles: [ { file: verdict.xml } ]\n", "verdict.xml")])
def test_a_report_has_no_other_use(tmp_path, more, message):
    (tmp_path / "verdict.xml").write_text("profile: p\nfaults: []\n")
    (tmp_path / "bad.yaml").write_text(
        "bus: { name: bad, bitrate: 500000 }\nnodes: [ { name: a } ]\n" + more + expect(CALM))
    started = subprocess.run([CANWIRED, "-c", "bad.yaml"], cwd=tmp_path, capture_output=True,
                             text=True, timeout=PATIENCE_S, check=False)
    assert started.returncode == LOST and message in started.stderr
    assert (tmp_path / "verdict.xml").read_text().startswith("profile")


def test_a_report_that_is_lost_is_an_error(bus, tmp_path):
    (tmp_path / "reports").mkdir()
    running = bus(expect(CALM, report="reports/v.xml"))
    (tmp_path / "reports").rmdir()
    sink = wait_until(lambda: (one := running.sinks()["expect-report", "v.xml"]) and
                      not one["good"] and one, "the loss")
    assert (sink["state"], sink["why"]) == ("judging", "No such file or directory")
    running.line(", expect-report v.xml judging: No such file or directory")
    assert "expect-report reports/v.xml judging: No such file" in canwire(
        "status", "--check", "./day.sock", status=1, cwd=running.folder).stdout
    (tmp_path / "reports").mkdir()
    wait_until(lambda: running.sinks()["expect-report", "v.xml"]["good"], "the folder")
    log = running.log.read_text()
    assert log.count("warning: expect-report reports/v.xml: it could not be written now: No such "
                     "file or directory\n") == 1
    assert log.count("canwired: expect-report reports/v.xml: it could be written again\n") == 1
    (tmp_path / "reports").rmdir()
    assert "error: expect-report reports/v.xml: No such file or directory\n" in running.end(LOST)


def test_no_report_is_better_than_a_part_of_one(bus, tmp_path):
    met = [f"{{ name: met {i}, seen: yes, frame: '123' }}" for i in range(40)]
    running = bus(expect(FEW, *met))
    running.wait_failed("few")
    limit_files(running.process, 2000)  # a full disk; the log is shorter
    assert "expect-report verdict.xml: File too large" in running.end(FAILED)
    assert not (tmp_path / "verdict.xml").exists()


# ---- Rigs ----------------------------------------------------------------------------------------

def test_each_bus_of_a_rig_has_its_verdict(tmp_path):
    for name, every in ("one", "10ms"), ("two", "1h"):
        (tmp_path / f"{name}.yaml").write_text(
            f"bus: {{ name: {name}, bitrate: 500000 }}\ncontrol: {name}.sock\n"
            f"nodes: [ {{ name: load, traffic: [ {{ send: 123#11, every: {every} }} ] }}, "
            "{ name: dash } ]\n" + expect(FEW, SOON, report=f"{name}.xml"))
    (tmp_path / "rig.yaml").write_text("buses: [ one.yaml, two.yaml ]\n")
    text = f"one: {FEW_FAILED}\n"
    with (tmp_path / "log").open("w") as log, subprocess.Popen(
            [CANWIRED, "-c", "rig.yaml"], cwd=tmp_path, stderr=log) as process:
        try:
            wait_until(lambda: text in (tmp_path / "log").read_text(), text)
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE_S) == FAILED
        finally:
            kill_all([process])
    log = (tmp_path / "log").read_text()
    assert log.count(text) == 1 and "two: expectation failed" not in log
    assert "one: 2 expectations, 1 met, 1 failed\n" in log
    assert "two: 2 expectations, 2 met, 0 failed\n" in log
    assert read_report(tmp_path / "two.xml") == ("two", {"few": None, "soon": None})
    assert read_report(tmp_path / "one.xml")[0] == "one"
