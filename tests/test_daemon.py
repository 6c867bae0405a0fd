# SPDX-License-Identifier: MIT
"""canwired and the surroundings it runs in: what happens to it, and what it does to others.

Nodes have traffic of their own here, so this needs no CAN in the kernel. CANWIRE and CANWIRED are
the programs.
"""

import json
import os
import signal
import subprocess

import pytest

from simtool import CANWIRE, CANWIRED
from test_record import PATIENCE_S, wait_until

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 5ms } ] }
  - { name: dash }
"""


class Daemon:
    """A canwired in a folder that others may share; stderr: where its messages go, or its log."""

    def __init__(self, folder, *words, text=BUS, stderr=None):
        self.folder, self.log = folder, folder / "stderr"
        (folder / "bus.yaml").write_text(text)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml", *words], cwd=folder,
                                            stderr=log if stderr is None else stderr)

    def wait_ready(self):
        wait_until((self.folder / "day.sock").exists, "the control socket")
        assert self.status()["bus"]["name"] == "day"

    def canwire(self, *words):
        return subprocess.run([CANWIRE, *words], cwd=self.folder, capture_output=True, text=True,
                              timeout=PATIENCE_S, check=True).stdout

    def status(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, self.log.read_text()
        assert not (self.folder / "day.sock").exists()
        return self.read_log()

    def read_log(self):
        text = self.log.read_text()
        assert "Sanitizer" not in text and "runtime error" not in text, text
        return text


@pytest.fixture(name="canwired")
def fixture_canwired(tmp_path):
    """canwired("--journal", "j", text=BUS) is a bus that runs."""
    started = []

    def start(*words, **more):
        started.append(Daemon(tmp_path, *words, **more))
        started[-1].wait_ready()
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.process.kill()
            each.process.wait()


# ---- Starts that are refused ---------------------------------------------------------------------


def refused(folder, *words):
    """The messages of a canwired that does not get as far as running."""
    result = subprocess.run([CANWIRED, "-c", "bus.yaml", *words], cwd=folder, capture_output=True,
                            text=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 1, result.stderr
    assert "nodes at" not in result.stderr
    return result.stderr


def test_a_start_that_is_refused_leaves_the_journal_of_the_running_bus(canwired, tmp_path):
    bus = canwired("--journal", "day.journal")
    for _ in range(2):  # of the files that are kept, there are two
        assert "day.sock" in refused(tmp_path, "--journal", "day.journal")
    bus.canwire("set", "./day.sock", "dash", "listen-only=on")
    bus.stop()
    assert not (tmp_path / "day.journal.1").exists()
    text = (tmp_path / "day.journal").read_text()
    assert '"send":"engine"' in text and '"set":"dash"' in text and '"end":' in text
    bus.canwire("sim", "--journal", "day.journal")


def test_a_journal_that_cannot_begin_is_an_error(tmp_path):
    (tmp_path / "bus.yaml").write_text(BUS)
    assert "journal no/journal: No such file" in refused(tmp_path, "--journal", "no/journal")
    assert not (tmp_path / "day.sock").exists()


# ---- Whoever reads the messages ------------------------------------------------------------------


def test_a_reader_of_the_messages_that_is_gone_does_not_end_it(canwired, tmp_path):
    reader, writer = os.pipe()
    bus = canwired("--journal", "day.journal", stderr=writer)
    os.close(writer)
    os.close(reader)
    for _ in range(2):  # each client is a message, and so is each reload
        bus.canwire("reload", "./day.sock")
    assert bus.status()["bus"]["name"] == "day"
    bus.stop()
    assert '"end":' in (tmp_path / "day.journal").read_text()


def test_a_reader_of_events_that_is_gone_ends_the_tool_quietly(canwired):
    bus = canwired()
    with subprocess.Popen([CANWIRE, "watch", "./day.sock"], cwd=bus.folder, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as watch:
        assert watch.stdout.readline()
        watch.stdout.close()
        assert watch.stderr.read() == ""
        assert watch.wait(PATIENCE_S) == -signal.SIGPIPE
    bus.stop()
