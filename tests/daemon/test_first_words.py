# SPDX-License-Identifier: MIT
"""The tool understands a socket in the current folder, and arguments in another order."""

import contextlib
import os
import re
import socket
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED, answer, stop_canwired
from failing import SANITIZERS
from test_record import wait_until

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes: [ { name: engine }, { name: dash } ]
"""
RULE = "{ name: off, when: { manual: yes }, do: { bus-off: engine } }"


@contextlib.contextmanager
def running(folder, *words):
    """Is a canwired and what it has written to standard error when it has ended."""
    (folder / "bus.yaml").write_text(BUS)
    log, told = folder / "stderr", []
    with log.open("w") as errors:
        with subprocess.Popen([CANWIRED, "-c", "bus.yaml", *words], cwd=folder, stderr=errors,
                              env=dict(os.environ, **SANITIZERS)) as process:
            wait_until(lambda: " bit/s, " in log.read_text(), "the bus")
            try:
                yield told
            finally:
                told.append(stop_canwired(process, log))


def test_the_socket_in_this_folder_needs_no_slash(tmp_path, monkeypatch):
    monkeypatch.setenv("CANWIRE_RUN", str(tmp_path / "run"))
    (tmp_path / "run").mkdir()
    with running(tmp_path):
        assert answer(tmp_path, "status", "day.sock").startswith("day: bitrate 500000 ")
        assert "no such bus" in answer(tmp_path, "status", "bus.yaml", status=1)
        # a bus of that name goes before
        with socket.socket(socket.AF_UNIX) as other:
            other.bind(str(tmp_path / "run/day.sock.sock"))
            assert "nobody listens at" in answer(tmp_path, "status", "day.sock", status=1)


SWAPPED = [("inject", "rules.yaml", "{bus}"), ("inject", RULE, "{bus}"),
           ("record", "x.log", "{bus}"), ("clear", "off", "{bus}"), ("restart", "engine", "{bus}"),
           ("set", "engine", "{bus}", "queue=2"), ("set", "engine", "queue=2", "{bus}"),
           ("fire", "off", "{bus}")]


@pytest.mark.parametrize("words", SWAPPED, ids=lambda words: f"{words[0]} {words[1][:5]}")
def test_swapped_arguments_are_recognised(tmp_path, words):
    (tmp_path / "rules.yaml").write_text(f"faults: [ {RULE} ]\n")
    right = [words[0], "{bus}", *(word for word in words[1:] if word != "{bus}")]
    with running(tmp_path) as told:
        if words[1] == "off":
            answer(tmp_path, "inject", "day.sock", "rules.yaml")
        error = answer(tmp_path, *(word.replace("{bus}", "day.sock") for word in words), status=2)
        assert error.startswith(f"canwire {words[0]}: the bus comes first, and that is day.sock\n"
                                f"usage: canwire {words[0]} ")
        if words[0] not in ("record", "restart"):
            answer(tmp_path, *(word.replace("{bus}", "day.sock") for word in right))
    assert "control: client" not in told[0]


def test_swapped_arguments_of_inject_without_a_bus(tmp_path):
    (tmp_path / "rules.yaml").write_text(f"faults: [ {RULE} ]\n")
    for rules in ("rules.yaml", RULE):
        assert "the bus comes first, and that is day\n" in answer(tmp_path, "inject", rules, "day",
                                                                  status=2)
    assert "no such bus" in answer(tmp_path, "inject", "day", "rules.yaml", status=1)
    done = subprocess.run([CANWIRE, "restart", "engine", "day"], cwd=tmp_path, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 1 and "no such bus" in done.stderr


def test_a_node_is_not_taken_for_the_bus(tmp_path):
    """Its ECU's socket, or another bus, may have its name."""
    with running(tmp_path), socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as port:
        port.bind(str(tmp_path / "engine"))
        port.listen()
        for words in (["day.sock", "queue=2", "engine"], ["engine", "queue=2", "ppm=3"]):
            error = answer(tmp_path, "set", *words, status=2)
            assert error.startswith("canwire set: queue=2: a bus and one of its nodes come before")
        assert "bus nosuch: no such bus" in answer(tmp_path, "set", "nosuch", "engine", "queue=2",
                                                   status=1)


def test_a_setting_is_given_once(tmp_path):
    with running(tmp_path):
        for key in "sample-point", "queue":
            error = answer(tmp_path, "set", "day.sock", "engine", f"{key}=1", "ppm=0", f"{key}=2",
                           status=2)
            assert error == f"canwire set: {key} is given twice\n"


def test_the_list_of_settings_is_whole(tmp_path):
    with running(tmp_path):
        error = answer(tmp_path, "set", "day.sock", "engine", "zzzzzzzzz=1", status=1)
        known = answer(tmp_path, "set", "--help").splitlines()
        keys = [line.split()[0] for line in known if re.match("  [a-z]", line)]
        assert error.rstrip().split("there are ")[1].split(", ") == keys and len(keys) > 30


def test_clients_are_told_where_that_is_asked_for(tmp_path):
    with running(tmp_path, "--verbose") as told:
        answer(tmp_path, "status", "day.sock")
    assert f"control: client: uid {os.getuid()}, pid " in told[0]
