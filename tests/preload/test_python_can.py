# SPDX-License-Identifier: MIT
"""python-can's `socketcan` interface, unchanged, at nodes of a bus."""

import sys

import pytest

import session
from simtool import ROOT, canwire

SESSION = ROOT / "tests/preload/session.py"
ALONE = "error_frames"  # the test below takes part


@pytest.mark.parametrize("name", [name for name in session.NAMES if name != ALONE])
def test_python_can(bus, name):
    r = bus(bus=", dbitrate: 2000000")
    r.run("engine=can0 dash=can1", sys.executable, SESSION, name)
    r.stop()


def test_error_frames(bus):
    r = bus()
    running = r.begin("engine=can0 dash=can1", sys.executable, SESSION, ALONE)
    assert running.stdout.readline() == "ready\n"
    canwire("inject", "./share.sock", "{ name: off, do: { bus-off: engine } }", cwd=r.folder)
    assert (running.communicate(timeout=60)[0], running.returncode) == ("", 0)
    r.stop()
