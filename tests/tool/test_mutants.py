# SPDX-License-Identifier: MIT
"""Configurations in which a line is missing, through the programs themselves.

tests/mutants tries thousands of them in one process; here is a sample, and a canwired that reloads
each one of its own. Nothing crashes, the exit status is 0 or 1 (3: an expectation failed), and what
is refused is refused with a place. Needs no CAN in the kernel.
"""

import re
import subprocess

import pytest

from simtool import CANWIRE, ROOT, TIMEOUT_S, kill_all
from test_daemon import Daemon

pytestmark = pytest.mark.kept

STRIDE = 41  # one of so many lines of all files
FILES = sorted([*ROOT.glob("config/*.yaml"), *ROOT.glob("tests/scenarios/*.yaml"),
                *ROOT.glob("tests/config/good/*.yaml")])
PLACE = re.compile(r"^[^\n]+:[0-9]+:[0-9]+: ", re.M)

# As many keys as there are, one a line.
BUS = """bus:
  name: day
  bitrate: 500000
seed: 4
control: day.sock
pacing: tick
missing-port: wait
catch-up: 2s
nodes:
  - name: engine
    traffic:
      - send: 123#DEADBEEF
        every: 5ms
        offset: 1ms
        jitter: 1ms
      - send: 7FF#
        every: 7ms
        count: 1000
  - name: dash
    queue: 4
    restart-ms: 10
    order: fifo
    warning-limit: 90
    berr-reporting: on
    traffic:
      - reply: 100#11
        to: "100"
        delay: 1ms
  - name: door
    port: "unix:door.sock"
    one-shot: on
profiles:
  - file: noisy.yaml
    with:
      victim: dash
    as: n
faults:
  - name: crc
    when:
      frame: "123"
      from: engine
      skip: 1
      every: 3
    do:
      flip: "crc[3]"
      at: [dash]
  - name: then
    when:
      after:
        rule: crc
        delay: 1ms
    do:
      overload: dash
      frames: 1
record:
  - file: day.log
    files: 2
"""
NOISY = """parameters:
  victim: wire
  rate: 1e-4
faults:
  - name: noise
    do:
      noise: $rate
      at: $victim
"""


def line_mutants(text):
    lines = text.splitlines(keepends=True)
    return [(i + 1, "".join(lines[:i] + lines[i + 1:])) for i in range(len(lines))]


def check_outcome(result, allowed):
    assert result.returncode in allowed, result
    if result.returncode == 1:
        assert PLACE.search(result.stderr), result


def sample():
    mutants = [(path, line, text) for path in FILES for line, text in
               line_mutants(path.read_text())]
    return mutants[::STRIDE]


@pytest.mark.parametrize(("path", "line", "text"), sample(),
                         ids=lambda value: getattr(value, "name", None) if not
                         isinstance(value, int) else f"line{value}")
def test_a_file_without_a_line_is_good_or_refused_with_a_place(tmp_path, path, line, text):
    del line
    folder = tmp_path / "tests" / "config" / "good"  # files are named relative to it
    folder.mkdir(parents=True)
    (tmp_path / "config").symlink_to(ROOT / "config")
    (tmp_path / "tests/traces").symlink_to(ROOT / "tests/traces")
    (tmp_path / "tests/config/profiles").symlink_to(ROOT / "tests/config/profiles")
    (folder / "profiles").symlink_to(ROOT / "config/profiles")
    (folder / "demo").symlink_to(ROOT / "config/demo")
    mutant = folder / path.name
    mutant.write_text(text)
    for words, allowed in ((["check"], (0, 1)), (["sim", "--until", "20ms"], (0, 1, 3))):
        result = subprocess.run([CANWIRE, *words, str(mutant)], capture_output=True, text=True,
                                timeout=TIMEOUT_S, check=False)
        check_outcome(result, allowed)


def reload(bus):
    return subprocess.run([CANWIRE, "reload", "./day.sock"], cwd=bus.folder, capture_output=True,
                          text=True, timeout=TIMEOUT_S, check=False)


def test_a_running_bus_reloads_files_without_each_of_their_lines(tmp_path):
    whole = {"bus.yaml": BUS, "noisy.yaml": NOISY}
    (tmp_path / "noisy.yaml").write_text(NOISY)
    bus = Daemon(tmp_path, "--journal", "day.journal", text=BUS)
    outcomes = []
    try:
        bus.wait_ready()
        for name, text in whole.items():
            for _, mutant in line_mutants(text):
                (tmp_path / name).write_text(mutant)
                result = reload(bus)
                check_outcome(result, (0, 1))
                outcomes.append(result.returncode)
            (tmp_path / name).write_text(text)
            assert reload(bus).returncode == 0
        assert {node["name"] for node in bus.status()["nodes"]} == {"engine", "dash", "door"}
        bus.stop()
    finally:
        kill_all([bus.process])
    assert outcomes.count(0) > 15 and outcomes.count(1) > 15
    played = subprocess.run([CANWIRE, "sim", "--journal", "day.journal", "--log", "-"],
                            cwd=tmp_path, capture_output=True, text=True, timeout=TIMEOUT_S,
                            check=False)
    assert (played.returncode, played.stderr) == (0, "")
