# SPDX-License-Identifier: MIT
"""canwire campaign with real programs at the nodes."""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import jsonschema
import pytest
import yaml

from compiled import compiled
from simtool import CANWIRE, ROOT, SCHEMAS, TIMEOUT_S, canwire, journal_text, run
from test_record import wait_until

SCHEMA = json.loads((SCHEMAS / "canwire-campaign.schema.json").read_text())
BUS = """bus: { name: powertrain, bitrate: 500000 }
nodes:
  - name: engine
  - name: dash
  - name: gearbox
    traffic: [ { send: 100#0000, every: 10ms } ]
"""
ECU = "{ node: engine, run: [ PROGRAM, engine ], ready: small-ecu is ready }"
DATA = '  - { name: data, set: "nodes.gearbox.traffic[0].send", values: [ VALUES ] }\n'
ONE = "  - { set: seed, values: [ 7 ] }\n"


def rows_of(text):
    return [json.loads(line) for line in text.splitlines()]


def processes_in(folder):
    """Returns the processes that work in a folder, with their commands."""
    found = {}
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            if entry.name.isdigit() and (os.readlink(entry / "cwd") + "/").startswith(f"{folder}/"):
                found[int(entry.name)] = (entry / "cmdline").read_bytes().replace(b"\0", b" ")
    return found


@pytest.fixture(autouse=True)
def fixture_nothing_is_left(monkeypatch, tmp_path):
    """No socket and no process outlives a campaign. TMPDIR is short, as paths of sockets are."""
    for name in list(os.environ):
        if name.startswith(("CI_NODE_", "SLURM_", "JOB_COMPLETION")):
            monkeypatch.delenv(name)
    with tempfile.TemporaryDirectory(prefix="cw", dir="/tmp") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        yield
        wait_until(lambda: not processes_in(tmp_path), "the end of all programs")
        wait_until(lambda: not list(Path(folder).glob("canwire-*")), "the end of all sockets")


@pytest.fixture(name="make")
def fixture_make(write):
    """make(ecus, vary, more) writes a campaign beside the scenario BUS; its path."""
    def make(*ecus, vary=ONE, more="until: 200ms\n", bus=BUS):
        write(bus)
        text = f"scenario: bus.yaml\n{more}ecu:\n" + "".join(f"  - {one}\n" for one in ecus)
        text = text.replace("PROGRAM", str(compiled("small-ecu"))) + "vary:\n" + vary
        jsonschema.validate(yaml.load(text, yaml.BaseLoader), SCHEMA)
        return write(text, "campaign.yaml")
    return make


def campaign(file, *arguments, status=0):
    """Runs a campaign; its rows."""
    done = canwire("campaign", "run", file.name, *arguments, status=status, cwd=file.parent)
    assert "no network of their own" not in done.stderr or os.geteuid() != 0
    return rows_of(done.stdout)


def log_of(file, row, name="engine"):
    return (file.parent / row["ecus"][name]["log"]).read_text()


# ---- rows ----------------------------------------------------------------------------------------

def test_a_row_has_the_keys_of_any_row_and_those_of_its_programs(make):
    expect = "expect:\n  - { name: answer, frame: \"101\", from: engine, seen: yes }\n"
    text = BUS + "faults:\n  - { name: hit, when: { frame: \"100\", skip: 3, count: 1 }, " \
        "do: { flip: \"crc[3]\", at: [ dash ] } }\n" + expect
    file = make(ECU, "{ node: dash, run: \"candump dash\", ready: { line: \"101\" } }", bus=text)
    row, = campaign(file, "--keep")
    assert row["outcome"] == "passed" and row["expectations"] == {"met": 1, "failed": []}
    assert row["seed"] == 7 and row["faults"] == 1 and row["error_frames"] == 1
    assert row["first_error"]["type"] == "crc" and row["first_error"]["node"] == "dash"
    assert list(row)[-3:] == ["ecus", "replay", "repeat"]
    plain = file.parent / "plain.yaml"
    plain.write_text("scenario: bus.yaml\nuntil: 1s\nvary:\n" + ONE)
    other, = rows_of(canwire("campaign", "run", plain, status=3).stdout)
    assert list(other) == [key for key in row if key not in ("ecus", "replay")]
    # 200 ms after both were ready, with some 20 frames and their answers
    ready = max(one["ready"] for one in row["ecus"].values())
    assert 0.2 <= row["t"] - ready < 0.2 + 60
    assert row["nodes"]["engine"]["tx_frames"] >= 10
    assert "got 100\n" in log_of(file, row) and " 101 " in log_of(file, row, "dash")
    assert {one["end"] for one in row["ecus"].values()} == {"running"}


def test_the_journal_repeats_a_row(make):
    file = make(ECU)
    row, = campaign(file, "--keep")
    words = shlex.split(row["replay"])
    assert words[:3] == ["canwire", "sim", "--journal"]
    stats = json.loads(run(CANWIRE, *words[1:], "--stats", "-", cwd=file.parent).stdout)
    assert stats["bus"]["frames"] == row["frames"] > 0
    assert stats["bus"]["time_ns"] == round(row["t"] * 1e9)
    for node in stats["nodes"]:
        assert node["tx_frames"] == row["nodes"][node["name"]]["tx_frames"]


def test_folders_of_rows_that_have_passed_go(make):
    file = make(ECU, vary=DATA.replace("VALUES", "100#00, 100#DEAD, 100#01"))
    rows = campaign(file, "--out", "rows.ndjson", status=3) or \
        rows_of((file.parent / "rows.ndjson").read_text())
    assert [row["outcome"] for row in rows] == ["passed", "crashed", "passed"]
    assert rows[0]["repeat"] == "canwire campaign run campaign.yaml --only 0"
    assert "replay" not in rows[0] and "replay" in rows[1]
    work = file.parent / "rows.ndjson.d"
    assert [path.name for path in work.iterdir()] == ["row-1"]
    assert {path.name for path in (work / "row-1").iterdir()} == {
        "scenario.yaml", "journal", "canwired.log", "engine", "engine.log"}
    assert "port" in (work / "row-1/scenario.yaml").read_text()
    campaign(file, "--only", "0", "--work", "elsewhere", "--keep")
    assert (file.parent / "elsewhere/row-0/journal").exists()
    campaign(file, "--only", "0")
    assert not (file.parent / "campaign.yaml.d").exists()


def test_programs_of_python_and_of_can_utils(make, write):
    write("import can\nwith can.Bus('can7', interface='socketcan') as bus:\n"
          "    print('listening')\n    for message in bus:\n"
          "        bus.send(can.Message(arbitration_id=0x300, data=message.data))\n", "node.py")
    file = make(f"{{ node: engine, interface: can7, run: \"{sys.executable} $CANWIRE_CAMPAIGN/"
                "node.py\", ready: { line: listening, within: 60s } }",
                "{ node: dash, run: [ candump, dash ], ready: { line: \"300\", within: 60s } }")
    row, = campaign(file, "--keep")
    assert row["outcome"] == "passed" and row["nodes"]["engine"]["tx_frames"] > 0
    assert re.search(r"dash +0*300 +\[2\] +00 00", log_of(file, row, "dash"))


def test_without_until_a_row_ends_with_its_programs(make):
    file = make("{ node: dash, run: \"candump -n 21 dash\", ready: \"100\" }",
                "{ node: engine, run: \"cangen engine -g 1 -n 20 -I 321\", after: dash }", more="",
                bus=BUS.replace("every: 10ms", "every: 10ms, count: 1, offset: 300ms"))
    row, = campaign(file, "--keep")
    assert row["outcome"] == "passed" and row["nodes"]["engine"]["tx_frames"] == 20
    assert {one["end"] for one in row["ecus"].values()} == {"exit 0"}
    assert len(log_of(file, row, "dash").splitlines()) == 21


def test_an_expectation_that_is_not_met(make):
    file = make(ECU, bus=BUS + "expect: [ { name: other, frame: \"555\", seen: yes } ]\n")
    row, = campaign(file, status=3)
    assert row["outcome"] == "failed" and row["expectations"]["failed"][0]["name"] == "other"
    assert Path(file.parent / row["ecus"]["engine"]["log"]).exists()


def test_files_of_the_scenario_are_found(make, write):
    write("(0.000000) any 111#33\n(3.000000) any 222#33\n", "drive.log")
    shutil.copy(ROOT / "config/profiles/deaf-ecu.yaml", write("", "x").parent / "deaf.yaml")
    parameters = yaml.safe_load((ROOT / "config/profiles/deaf-ecu.yaml").read_text())["parameters"]
    given = ", ".join(f"{key}: dash" for key, value in parameters.items() if value is None)
    file = make(ECU.replace("small-ecu is ready", "got 222"),
                bus=BUS.replace("traffic: [", "traffic: [ { replay: drive.log },") +
                f"profiles: [ {{ file: deaf.yaml, with: {{ {given} }} }} ]\n")
    row, = campaign(file, "--keep")
    assert row["outcome"] == "passed" and row["ecus"]["engine"]["ready"] > 3


def test_the_report_of_rows_of_programs(make):
    file = make(ECU, vary=DATA.replace("VALUES", "100#00, 100#DEAD"))
    campaign(file, "--out", "rows", status=3)
    done = canwire("campaign", "report", "rows", "--json", "-", cwd=file.parent)
    assert json.loads(done.stdout)["rows"]["read"] == 2
    message = canwire("campaign", "report", "rows", "--scenarios", "x", status=1,
                      cwd=file.parent).stderr
    assert "--scenarios: the rows of campaign.yaml are those of programs" in message


# ---- virtual time --------------------------------------------------------------------------------

VIRTUAL = "virtual: on\nuntil: 100s\n"
SENDER = ("{ node: engine, run: \"cangen engine -g 100 -I 123 -L 2 -D i\", "
          "ready: { frame: \"123\" } }")


def test_in_virtual_time_rows_are_the_same_byte_for_byte(make):
    crash = "{ node: dash, name: bad, run: \"candump -n 7 dash; kill -SEGV $$\" }"
    file = make(SENDER, "{ node: dash, run: \"candump -t z dash\" }", crash, more=VIRTUAL,
                vary=DATA.replace("VALUES", "100#00, 100#DEAD, 100#BEEF"),
                bus=BUS.replace("every: 10ms", "every: 1s, offset: 1s"))
    texts, logs, journals = [], [], []
    for jobs in "1", "2":
        canwire("campaign", "run", file.name, "--out", f"rows{jobs}", "--work", "work", "--keep",
                "--jobs", jobs, status=3, cwd=file.parent)
        texts.append((file.parent / f"rows{jobs}").read_text())
        logs.append([log_of(file, row, "dash") for row in rows_of(texts[-1])])
        journals.append([(file.parent / f"work/row-{row}/journal").read_bytes()
                         for row in range(3)])
    assert texts[0] == texts[1] and logs[0] == logs[1] and journals[0] == journals[1]
    assert not list((file.parent / "work").glob("row-*/.sockets"))
    for row in rows_of(texts[0]):
        assert (row["outcome"], row["why"], row["t"]) == ("crashed", "bad: signal SEGV", 100)
        assert row["frames"] == 1000 + 99 or row["frames"] == 1000 + 100
        ends = {name: one["end"] for name, one in row["ecus"].items()}
        assert ends == {"engine": "running", "dash": "running", "bad": "signal SEGV"}
        assert row["ecus"]["engine"]["ready"] < 0.1 and row["ecus"]["dash"]["ready"] is None


def test_virtual_time_goes_on_to_the_end_of_the_row_when_nothing_happens(make):
    file = make("{ node: dash, run: \"candump dash\" }", more="virtual: on\nuntil: 1h\n",
                bus=BUS.replace("every: 10ms", "count: 1, offset: 5s"))
    row, = campaign(file)
    assert row["outcome"] == "passed" and row["t"] == 3600 and row["frames"] == 1


def test_in_virtual_time_a_row_may_end_with_its_programs(make):
    file = make("{ node: engine, run: \"cangen engine -g 1000 -n 20 -I 321\" }",
                more="virtual: on\n", bus=BUS.replace("every: 10ms", "every: 1s"))
    rows = [campaign(file)[0] for _ in range(2)]
    assert rows[0] == rows[1] and rows[0]["ecus"]["engine"]["end"] == "exit 0"
    assert rows[0]["nodes"]["engine"]["tx_frames"] == 20 and 19 <= rows[0]["t"] < 22


def test_a_program_that_holds_virtual_time_is_a_time_out(make):
    file = make("{ node: engine, run: \"cansend engine 123#; while :; do :; done\" }",
                "{ node: dash, run: \"candump dash\" }", more="virtual: on\nuntil: 1h\nlimit: 1s\n")
    row, = campaign(file, status=3)
    assert row["outcome"] == "time-out" and row["t"] < 3600


# ---- ends ----------------------------------------------------------------------------------------

def test_a_crash_is_a_row_with_all_keys_up_to_there(make):
    file = make(ECU, vary=DATA.replace("VALUES", "100#DEAD"), more="until: 60s\n")
    row, = campaign(file, status=3)
    assert row["outcome"] == "crashed" and row["why"] == "engine: signal ABRT"
    assert row["ecus"]["engine"]["end"] == "signal ABRT" and row["t"] < 60
    assert row["nodes"]["engine"]["rx_frames"] >= 1 and row["nodes"]["engine"]["tx_frames"] == 0
    assert log_of(file, row).endswith("got 100\n")


@pytest.mark.parametrize("command, why, end, output", [
    ("sleep 0.1; echo bad; exit 3", "engine: exit status 3", "exit 3", "bad\n"),
    ("kill -SEGV $$", "engine: signal SEGV", "signal SEGV", ""),
    ("./missing --fast", "engine: exit status 127", "exit 127", "missing: not found"),
])
def test_a_program_that_fails(make, command, why, end, output):
    file = make(f"{{ node: engine, run: \"{command}\" }}", more="until: 60s\n")
    row, = campaign(file, status=3)
    assert (row["outcome"], row["why"], row["ecus"]["engine"]["end"]) == ("crashed", why, end)
    assert output in log_of(file, row)


def test_a_fault_at_the_end_is_a_crash(make):
    file = make("{ node: engine, run: \"trap 'kill -SEGV $$' TERM; echo on; "
                "while :; do sleep 0.01; done\", ready: \"on\" }")
    row, = campaign(file, status=3)
    assert row["outcome"] == "crashed" and row["why"] == "engine: signal SEGV"


def test_a_program_that_does_not_end_is_killed(make):
    file = make(ECU[:-2] + ", grace: 50ms }", vary=DATA.replace("VALUES", "100#BEEF"),
                more="until: 1s\n")
    row, = campaign(file)
    assert row["outcome"] == "passed" and row["ecus"]["engine"]["end"] == "killed"


def test_a_program_that_is_never_ready(make):
    file = make("{ node: engine, run: \"echo hello; exec sleep 100\", "
                "ready: { frame: \"123\", within: 300ms } }", ECU.replace("engine", "dash"))
    row, = campaign(file, status=3)
    assert row["outcome"] == "time-out" and row["why"] == "engine: not ready after 0.3 s"
    assert row["ecus"]["engine"]["ready"] is None and row["t"] >= 0.3
    assert log_of(file, row) == "hello\n"


@pytest.mark.parametrize("command, ready, outcome, why", [
    ("(sleep 0.1; echo up; exec sleep 100) &", "up", "passed", None),
    ("sleep 0.1 &", "up", "crashed", "engine: it has ended before it was ready"),
    ("cansend engine 123#", "{ frame: \"123\" }", "passed", None),
    ("true", "{ frame: \"123\", within: 200ms }", "time-out", "engine: not ready after 0.2 s"),
])
def test_a_program_that_ends_before_it_is_ready(make, command, ready, outcome, why):
    file = make(f"{{ node: engine, run: \"{command}\", ready: {ready} }}",
                "{ node: dash, run: \"exec sleep 100\", after: engine }")
    row, = campaign(file, status=0 if outcome == "passed" else 3)
    assert (row["outcome"], row.get("why")) == (outcome, why)
    assert row["ecus"]["engine"]["end"] == "exit 0"
    assert row["ecus"]["dash"]["end"] == ("running" if outcome == "passed" else "not started")


def test_a_program_that_is_ready_at_the_end_of_much_output(make):
    file = make("{ node: engine, run: [ dd, \"if=../../../said\", bs=100000 ], ready: is ready }",
                "{ node: dash, run: \"exec sleep 100\", after: engine }")
    (file.parent / "said").write_text("x" * 79 + "\n")
    with open(file.parent / "said", "a", encoding="utf-8") as said:
        said.write(("x" * 79 + "\n") * 700 + "it is ready\n")
    row, = campaign(file)
    assert row["outcome"] == "passed" and row["ecus"]["engine"]["end"] == "exit 0"


def test_a_row_that_takes_too_long(make):
    file = make("{ node: engine, run: \"exec sleep 100\" }", more="limit: 1s\n")
    row, = campaign(file, status=3)
    assert row["outcome"] == "time-out" and row["why"] == "it took longer than 1 s"
    assert row["ecus"]["engine"]["end"] == "running"


@pytest.mark.parametrize("command, why", [
    ("kill -STOP $PPID; sleep 1000", ""),
    ("kill -STOP $(ps -o ppid= -p $PPID); sleep 1000", ""),
    ("while kill -STOP $PPID; do :; done", ", and a program stopped the process that keeps it"),
    ("while kill -STOP $(ps -o ppid= -p $PPID); do :; done", None)])
def test_a_program_cannot_stop_the_limit(make, command, why):
    """Its parent ends it in time; the parent of that one watches."""
    file = make(f"{{ node: engine, run: '{command}', grace: 1s }}", more="limit: 1s\n")
    row, = campaign(file, status=3)
    assert row["outcome"] == "time-out"
    assert why is None or re.fullmatch(f"it took longer than 1 s(?:{why})?", row["why"])


def test_a_program_that_kills_its_parent_is_told_and_leaves_nothing(make, tmp_path):
    file = make("{ node: engine, run: 'setsid sleep 1000 & kill -KILL $PPID; sleep 1000' }")
    row, = campaign(file, status=1)
    assert row["why"] == "the process that keeps the programs has ended"
    assert not processes_in(tmp_path)


def test_canwired_that_does_not_start(make):
    file = make(ECU, bus=BUS.replace("name: dash", "{ name: dash, port: nosuch0 }"))
    done = canwire("campaign", "run", file.name, status=1, cwd=file.parent)
    row, = rows_of(done.stdout)
    assert row["outcome"] == "broken" and "nosuch0" in row["why"]
    assert "row 0 could not be run" in done.stderr
    assert row["ecus"]["engine"] == {"ready": None, "end": "not started",
                                     "log": "campaign.yaml.d/row-0/engine.log"}


def test_values_that_make_no_scenario(make):
    file = make(ECU, vary="  - { set: bus.bitrate, values: [ 500000, 77 ] }\n")
    done = canwire("campaign", "run", file.name, status=1, cwd=file.parent)
    good, bad = rows_of(done.stdout)
    assert (good["outcome"], bad["outcome"]) == ("passed", "invalid")
    assert bad["why"].startswith("bus.yaml:1:35: bitrate: ") and bad["why"] in done.stderr


def test_files_of_others_stay(make):
    file = make(ECU)
    mine = file.parent / "campaign.yaml.d/row-0/mine"
    mine.parent.mkdir(parents=True)
    mine.write_text("precious")
    done = canwire("campaign", "run", file.name, status=1, cwd=file.parent)
    assert "File exists" in rows_of(done.stdout)[0]["why"]
    assert mine.read_text() == "precious"


@pytest.mark.parametrize("left", [[], [".sockets"], [".sockets", "scenario.yaml", "engine"]])
def test_what_another_run_has_begun_is_taken_over(make, left):
    """It has made the folder of the row, has not yet locked it, and ends."""
    file = make(ECU)
    row = file.parent / "campaign.yaml.d/row-0"
    row.mkdir(parents=True)
    for name in left:
        (row / name).symlink_to("nowhere")
    assert campaign(file)[0]["outcome"] == "passed"
    assert not row.parent.exists()


# ---- nothing is left -----------------------------------------------------------------------------

DAEMON = "{ node: engine, run: \"setsid sleep 1000 & sleep 1000 & echo up; COMMAND\", ready: up }"


def test_all_that_programs_start_ends_with_the_row(make, tmp_path):
    for command, status in ("exec sleep 1000", 0), ("exit 0", 0), ("exit 1", 3):
        campaign(make(DAEMON.replace("COMMAND", command)), status=status)
        assert not processes_in(tmp_path)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_nothing_outlives_a_campaign_that_is_killed(make, tmp_path, number):
    file = make(DAEMON.replace("COMMAND", "exec sleep 1000"), more="until: 1h\nlimit: 2h\n",
                vary="  - { set: seed, range: { from: 1, to: 9, step: 1 } }\n")
    with subprocess.Popen([CANWIRE, "campaign", "run", file.name, "--out", "rows", "--jobs", "2"],
                          cwd=file.parent, start_new_session=True) as running:
        # two sleeps and one that the shell has become, twice
        wait_until(lambda: sum(b"sleep 1000" in command.split(b";")[-1] and
                               command.startswith(b"sleep")
                               for command in processes_in(tmp_path).values()) == 6, "programs")
        running.send_signal(number)
        assert running.wait(TIMEOUT_S) == -number
    wait_until(lambda: not processes_in(tmp_path), "the end of all programs")
    wait_until(lambda: not list((file.parent / "rows.d").glob("*")), "the end of all folders")


def test_a_campaign_that_was_killed_goes_on(make):
    file = make(ECU, more="until: 300ms\n",
                vary="  - { set: seed, range: { from: 1, to: 4, step: 1 } }\n")
    part = file.parent / "rows.part"
    with subprocess.Popen([CANWIRE, "campaign", "run", file.name, "--out", "rows", "--jobs", "1"],
                          cwd=file.parent) as running:
        wait_until(lambda: part.exists() and part.read_text().count("\n") >= 1, "a row")
        running.kill()
    wait_until(lambda: not processes_in(file.parent), "the end of all processes")
    before = part.read_text()
    campaign(file, "--out", "rows", "--resume")
    text = (file.parent / "rows").read_text()
    assert text.startswith(before[:before.rindex("\n") + 1])
    assert [row["seed"] for row in rows_of(text)] == [1, 2, 3, 4]
    assert not (file.parent / "rows.d").exists()


def test_a_process_that_is_killed_costs_no_row(make):
    file = make(ECU, more="until: 300ms\n",
                vary="  - { set: seed, range: { from: 1, to: 3, step: 1 } }\n")
    with subprocess.Popen([CANWIRE, "campaign", "run", file.name, "--out", "rows", "--jobs", "1"],
                          cwd=file.parent) as running:
        wait_until(lambda: list(file.parent.glob("rows.d/row-*/journal")), "a row")
        children = Path(f"/proc/{running.pid}/task/{running.pid}/children").read_text().split()
        os.kill(int(children[0]), signal.SIGKILL)
        assert running.wait(TIMEOUT_S) == 0
    assert [row["outcome"] for row in rows_of((file.parent / "rows").read_text())] == ["passed"] * 3


def test_two_runs_share_the_folders_of_their_rows(make):
    file = make("{ node: engine, run: \"exec sleep 100\" }", more="until: 5ms\n",
                vary="  - { set: seed, range: { from: 1, to: 6, step: 1 } }\n")
    with contextlib.ExitStack() as stack:
        all_runs = [stack.enter_context(subprocess.Popen(
            [CANWIRE, "campaign", "run", file.name, "--out", f"rows{i}", "--work", "work",
             "--jobs", "2"], cwd=file.parent)) for i in range(3)]
        assert [one.wait(TIMEOUT_S) for one in all_runs] == [0, 0, 0]
    assert not (file.parent / "work").exists()


# ---- environment ---------------------------------------------------------------------------------

def test_each_row_has_a_network_of_its_own(make):
    if os.geteuid() != 0:
        pytest.skip("user namespaces may be forbidden")
    server = f"{sys.executable} -c 'import socket, time; " \
        "s = socket.create_server((\\\"127.0.0.1\\\", 5555)); " \
        "print(\\\"open\\\"); time.sleep(1000)'"
    show = "readlink /proc/self/ns/net; cut -d: -f1 /proc/net/dev | tail -n +3; echo end; " \
        "sleep 1000"
    programs = [f"{{ node: engine, run: \"{server}\", ready: {{ line: open, within: 60s }} }}",
                f"{{ node: dash, run: \"{show}\", ready: end }}"]
    rows = campaign(make(*programs, more="until: 500ms\n",
                         vary="  - { set: seed, values: [ 1, 2 ] }\n"), "--jobs", "2", "--keep")
    file = make(*programs)
    own = [log_of(file, row, "dash").split() for row in rows]
    assert [row["outcome"] for row in rows] == ["passed"] * 2
    assert own[0][0] != own[1][0] and own[0][1:] == ["lo", "end"]
    row, = campaign(make(*programs[1:], more="network: host\nuntil: 10ms\n"), "--keep")
    assert log_of(file, row, "dash").split()[0] == os.readlink("/proc/self/ns/net")


def test_the_environment_of_a_program(make, tmp_path):
    show = "pwd; env | grep -E '^(CANWIRE_|SPEED|NOTIFY)' | sort; " \
        f"env -u LD_PRELOAD {CANWIRE} inject $CANWIRE_BUS " \
        "'{ name: mine, when: { manual: yes }, do: { flip: sof } }'; "
    file = make(f"{{ node: engine, name: first, run: \"{show}\", env: {{ SPEED: 5 }} }}",
                "{ node: engine, name: second, run: \"pwd; test -S $CANWIRE_PORT\", cwd: sub, "
                "preload: off }", more="")
    (tmp_path / "sub").mkdir()
    row, = campaign(file, "--keep")
    assert row["outcome"] == "passed"
    first = log_of(file, row, "first")
    folder = file.parent.resolve()
    assert first.splitlines()[0] == str(folder / "campaign.yaml.d/row-0/first")
    values = dict(line.split("=", 1) for line in first.splitlines() if "=" in line)
    assert values["SPEED"] == "5" and values["CANWIRE_SEED"] == "7"
    assert values["CANWIRE_ROW"] == "0" and values["CANWIRE_NODE"] == "engine"
    assert values["CANWIRE_BUS"] == "powertrain" and values["CANWIRE_CAMPAIGN"] == str(folder)
    assert "NOTIFY_SOCKET" not in values
    assert '"inject"' in journal_text(folder / "campaign.yaml.d/row-0/journal")
    assert log_of(file, row, "second").split() == [str(folder / "sub")]


def test_a_long_path(make, tmp_path):
    work = tmp_path / ("long" * 40)
    work.mkdir()
    row, = campaign(make(ECU), "--work", work / "rows", "--keep")
    assert row["outcome"] == "passed" and (work / "rows/row-0/journal").exists()


# ---- the file ------------------------------------------------------------------------------------

@pytest.mark.parametrize("ecu, message", [
    ("{ node: nobody, run: x }", "4:13: node: the scenario has no node 'nobody'"),
    ("{ node: gearbox, run: x }", "4:13: node: 'gearbox' has traffic of its own"),
    ("{ node: engine }", "4:5: ecu: the key 'run' is missing"),
    ("{ node: engine, run: x, name: ../up }", "up to 64 letters, digits"),
    ("{ node: engine, run: x, name: canwired }", "4:5: 'canwired' is a name of files of a row"),
    ("{ node: engine, run: x, name: a.log }", "4:5: 'a.log' is a name of files of a row"),
    ("{ node: engine, run: x, ready: { within: 1s } }", "either 'line' or 'frame' is needed"),
    ("{ node: engine, run: x, ready: { frame: \"1\" } }", "frame: "),
    ("{ node: engine, run: x, grace: 2h }", "a real time from 0s to 1h"),
    ("{ node: engine, run: x, grace: 100bit }", "a real time from 0s to 1h"),
    ("{ node: engine, run: x, env: { 1A: x } }", "letters, digits and '_', no digit in front"),
    ("{ node: engine, run: x, interface: far-too-long-name }", "at most 15 characters"),
    ("{ node: engine, run: x, preload: perhaps }", "preload: "),
    ("{ node: engine, run: x, preload: off, interface: can0 }",
     "4:5: interface: a program with 'preload: off' has none"),
    ("{ node: engine, run: x, after: engine }", "the name of a program before this one"),
    ("{ node: engine, run: x, speed: 3 }", "unknown key 'speed'"),
])
def test_bad_programs_are_refused(write, ecu, message):
    write(BUS)
    file = write(f"scenario: bus.yaml\nuntil: 1s\necu:\n  - {ecu}\nvary:\n{ONE}", "campaign.yaml")
    assert message in canwire("campaign", "plan", file, status=1).stderr


def test_virtual_time_without_programs_is_refused(write):
    write(BUS)
    file = write("scenario: bus.yaml\nuntil: 1s\necu: { node: engine, run: x, preload: off }\n"
                 f"virtual: on\nvary:\n{ONE}", "campaign.yaml")
    message = canwire("campaign", "plan", file, status=1).stderr
    assert "4:10: virtual: no program in 'ecu' runs under canwire run" in message


def test_virtual_time_of_the_scenario_alone_is_refused(write):
    file = write(f"scenario: bus.yaml\nuntil: 1s\necu: {{ node: engine, run: x }}\nvary:\n{ONE}",
                 "campaign.yaml")
    write(BUS + "pacing: virtual\n")
    message = canwire("campaign", "plan", file, status=1).stderr
    assert "virtual: socket: expected" in message and "'virtual: on' beside 'ecu'" in message
    write(BUS + "pacing: virtual\ncontrol: bus.sock\n")
    message = canwire("campaign", "plan", file, status=1).stderr
    assert "3:6: ecu: the scenario has 'pacing: virtual'; leave that out, and give 'virtual: on' " \
        "beside 'ecu'" in message


def test_without_programs_pacing_changes_nothing(write):
    file = write(f"scenario: bus.yaml\nuntil: 1s\nvary:\n{ONE}", "campaign.yaml")
    rows = []
    for more in "", "pacing: virtual\nvirtual: { socket: s }\n":
        write(BUS + more)
        rows.append(campaign(file))
    assert rows[0] == rows[1] and rows[0][0]["frames"] > 0


def test_two_programs_of_the_same_name_are_refused(write):
    write(BUS)
    file = write("scenario: bus.yaml\nuntil: 1s\necu:\n  - { node: engine, run: x }\n"
                 f"  - {{ node: engine, run: y }}\nvary:\n{ONE}", "campaign.yaml")
    message = canwire("campaign", "plan", file, status=1).stderr
    assert "5:5: two programs are called 'engine'; give one of them a name" in message


def test_a_rig_has_no_programs(write):
    write(BUS)
    file = write("scenario: { buses: [ bus.yaml ] }\nuntil: 1s\necu: { node: engine, run: x }\n"
                 f"vary:\n  - {{ set: \"buses[0]\", values: [ bus.yaml ] }}\n", "campaign.yaml")
    assert "3:6: ecu: the scenario is a rig" in canwire("campaign", "plan", file, status=1).stderr


def test_the_plan_tells_the_time_and_runs_nothing(make):
    file = make("{ node: engine, run: \"touch $CANWIRE_CAMPAIGN/ran\" }", more="until: 2s\n")
    text = canwire("campaign", "plan", file, "--jobs", "1").stdout
    assert "2 s in 1 process, 2 s a row" in text and not (file.parent / "ran").exists()


def test_the_example_of_the_document(write):
    text = (ROOT / "daemon/man/canwire-campaign.7.md").read_text().split("## Real ECUs")[1]
    example = re.search(r"```yaml\n(.*?)```", text, re.DOTALL)[1]
    jsonschema.validate(yaml.load(example, yaml.BaseLoader), SCHEMA)
    file = write(example, "campaign.yaml")
    rows = campaign(file, "--keep")
    assert [row["outcome"] for row in rows] == ["passed"] * 2
    assert [row["error_frames"] for row in rows] == [1, 1]
    assert all(row["nodes"]["engine"]["tx_frames"] >= 10 for row in rows)
