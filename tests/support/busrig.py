# SPDX-License-Identifier: MIT
"""A canwired with a bus of its own, for tests that need no CAN in the kernel."""

import json
import subprocess

import pytest

from simtool import CANWIRED, canwire, kill_all, listens, stop_canwired
from test_record import wait_until


class BusRig:
    """A running canwired in a folder. A subclass has the text of its configuration and the usual
    values of what is in braces there."""

    TEXT = ""      # with a control socket ...
    CONTROL = ""   # ... of this name
    VALUES = {}

    def __init__(self, folder, journal=False, **more):
        self.folder, self.log = folder, folder / "stderr"
        self.write(**more)
        words = ["--journal", "bus.journal"] if journal else []
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml", *words], cwd=folder,
                                            stderr=log)
        wait_until(lambda: listens(folder / self.CONTROL) or self.process.poll() is not None,
                   "the bus")

    def write(self, **more):
        """Writes the configuration."""
        self.text = self.TEXT.format(**{**self.VALUES, **more})
        (self.folder / "bus.yaml").write_text(self.text)

    def run(self, *words, status=0):
        return canwire(*words, cwd=self.folder, status=status)

    def nodes(self):
        status = json.loads(self.run("status", f"./{self.CONTROL}", "--json").stdout)
        return {node["name"]: node for node in status["nodes"]}

    def again(self):
        """Returns the events of the journal, run again."""
        self.run("sim", "--journal", "bus.journal", "--events", "again")
        return [json.loads(line) for line in (self.folder / "again").read_text().splitlines()]

    def close(self):
        """Closes what programs have open, before canwired ends."""

    def stop(self):
        for name, node in self.nodes().items():
            assert node["conserved"] is True, (name, node)
        self.close()
        return stop_canwired(self.process, self.log)


def rig_fixture(kind):
    """Returns a fixture: rig(*words, **more) starts one of that kind, which ends with the test."""
    @pytest.fixture(name="rig")
    def fixture_rig(tmp_path):
        rigs = []

        def start(*words, **more):
            rigs.append(kind(tmp_path, *words, **more))
            return rigs[-1]

        yield start
        kill_all(rig.process for rig in rigs)

    return fixture_rig
