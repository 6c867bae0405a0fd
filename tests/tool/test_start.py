# SPDX-License-Identifier: MIT
"""Commands and programs that come while a bus is just starting."""

import json
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, TIMEOUT_S, kill_all

BUS = """bus: { name: new, bitrate: 500000 }
control: new.sock
nodes:
  - { name: engine, port: "unix:engine.sock" }
  - { name: dash, traffic: [ { send: 123#, every: 1ms } ] }
"""


@pytest.fixture(name="folder")
def fixture_folder(tmp_path):
    (tmp_path / "new.yaml").write_text(BUS)
    return tmp_path


@pytest.fixture(name="begin")
def fixture_begin(folder):
    """begin(PROGRAM, WORD...) starts a program, which ends with the test."""
    programs = []

    def begin(*words):
        programs.append(subprocess.Popen(words, cwd=folder, text=True, stdout=subprocess.PIPE,
                                         stderr=subprocess.PIPE))
        return programs[-1]

    yield begin
    kill_all(programs)


def leave_sockets(folder):
    """Leaves the sockets of a canwired that is killed."""
    killed = subprocess.Popen([CANWIRED, "-c", "new.yaml"], cwd=folder, stderr=subprocess.PIPE,
                              text=True)
    assert "2 nodes" in killed.stderr.readline()
    killed.kill()
    killed.communicate()
    assert (folder / "engine.sock").is_socket() and (folder / "new.sock").is_socket()


@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("words, told", [
    (["status", "./new.sock"], "2: dash: "),
    (["faults", "./new.sock"], ""),
    (["top", "./new.sock", "--once"], "dash"),
    (["watch", "./new.sock", "tx"], '"frame":"123#"'),
    (["record", "./new.sock", "-", "--format", "candump"], "dash 123#"),
    (["run", "--bus", "new.yaml", "--as", "engine", "candump", "-n1", "engine"], "engine  123"),
    (["run", "--bus", "./new.sock", "--as", "engine", "candump", "-n1", "engine"], "engine  123"),
])
def test_they_wait_for_a_bus_that_starts_later(folder, begin, words, told, left):
    if left:
        leave_sockets(folder)
    early = begin(CANWIRE, words[0], "--wait", "2min", *words[1:])
    begin(CANWIRED, "-c", "new.yaml")
    if told:
        while told not in (line := early.stdout.readline()):
            assert line, early.stderr.read()
    if words[0] in ("watch", "record"):
        early.terminate()
    error = early.communicate(timeout=TIMEOUT_S)[1]
    assert early.returncode == (-15 if words[0] == "watch" else 0), error


def test_the_limit_is_that_of_all_waits_together(folder, begin):
    """Two nodes whose ports are not there."""
    as_two = ["--as", "engine", "--interface", "a", "--as", "engine", "--interface", "b"]
    refused = begin(CANWIRE, "run", "--wait", "0.2s", "--bus", "new.yaml", *as_two, "true")
    assert "engine.sock: No such file" in refused.communicate(timeout=TIMEOUT_S)[1]
    assert refused.returncode == 1


def test_what_is_wrong_otherwise_is_told_at_once(folder, begin):
    """A wait of an hour does not take one."""
    for words, why in ((["status", "./new.yaml/x"], "Not a directory"),
                       (["run", "--bus", "new.yaml", "--as", "nobody", "true"], "no such node")):
        refused = begin(CANWIRE, words[0], "--wait", "1h", *words[1:])
        assert why in refused.communicate(timeout=TIMEOUT_S)[1]


def test_a_look_at_all_buses_waits_for_none(folder, begin, monkeypatch):
    leave_sockets(folder)
    monkeypatch.setenv("CANWIRE_RUN", str(folder))
    shown = begin(CANWIRE, "status", "--json", "--wait", "1h")
    assert json.loads(shown.communicate(timeout=TIMEOUT_S)[0]) == []
