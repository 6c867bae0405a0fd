# SPDX-License-Identifier: MIT
"""python-can's `socketcan` interface, unchanged, at nodes of a bus."""

import signal
import subprocess
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
    r = bus(bitrate=20000, engine=", restart-ms: 10")
    running = r.begin("engine=can0 dash=can1", sys.executable, SESSION, ALONE)
    assert running.stdout.readline() == "ready\n"
    canwire("inject", "./share.sock", "{ name: off, do: { bus-off: engine } }", cwd=r.folder)
    assert (running.communicate(timeout=60)[0], running.returncode) == ("", 0)
    r.stop()


SCANNER = """
import sys, canopen
network = canopen.Network()
network.connect(interface="socketcan", channel="can0")
print("ready", flush=True)
sys.stdin.readline()
network.scanner.search()
print("all written", flush=True)
network.disconnect()
"""


def test_a_scanner_of_canopen_does_not_wait(bus):
    """It writes 127 frames at once, here while canwired gets no processor, and reads no error."""
    r = bus()
    scanner = r.begin("engine=can0", sys.executable, "-c", SCANNER, stdin=subprocess.PIPE)
    assert scanner.stdout.readline() == "ready\n"
    r.process.send_signal(signal.SIGSTOP)
    try:
        scanner.stdin.write("go\n")
        scanner.stdin.flush()
        said = scanner.stdout.readline()
    finally:
        r.process.send_signal(signal.SIGCONT)
    assert said == "all written\n", said + scanner.stdout.read()
    assert scanner.wait(60) == 0
    assert r.nodes()["engine"]["tx_frames"] == 127
    r.stop()
