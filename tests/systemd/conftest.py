# SPDX-License-Identifier: MIT
"""The shared parts of the tests under a real systemd: canwire installed, and buses as units.

Run with: make build man deb
          scripts/guest --systemd -- build/venv/bin/python -m pytest tests/systemd
Without systemd they fail; they are never skipped.
"""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest_plugins = ["depth", "hang"]

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/kernel"))

from canbits import Frame  # pylint: disable=wrong-import-position
from readme import wait_until  # pylint: disable=wrong-import-position,unused-import

FRAME = Frame.parse("123#DEADBEEF")
PATIENCE_S = 60  # until something that must come counts as missing; not a measure of speed


def run(*words, status=0):
    """Runs a command; returns what it wrote to standard output, or to both if it fails."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == status, (words, done.stdout + done.stderr)
    return done.stdout + done.stderr if status else done.stdout


def systemctl(*words, status=0):
    return run("systemctl", *words, status=status)


def checked(*words, status=0):
    """Returns the line of `canwire status --check`. It gives systemctl 5 s to answer. It is asked
    again in a loaded guest, which may need longer."""
    while True:
        done = subprocess.run(["canwire", "status", "--check", *words], capture_output=True,
                              text=True, check=False)
        if "no answer within 5 s" not in done.stdout + done.stderr:
            break
    assert done.returncode == status, (words, done.stdout + done.stderr)
    return done.stdout + done.stderr if status else done.stdout


def links():
    return set(os.listdir("/sys/class/net"))


def can_socket(interface):
    s = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    s.bind((interface,))
    s.settimeout(PATIENCE_S)
    return s


def drop_in(unit, text):
    folder = Path(f"/etc/systemd/system/{unit}.service.d")
    folder.mkdir(parents=True)
    (folder / "test.conf").write_text(text)


RMEM_MAX = Path("/proc/sys/net/core/rmem_max")  # the limit of the kernel for receive buffers
RMEM_MAX_DEFAULT = "212992"


@pytest.fixture(scope="session", name="installed")
def fixture_installed():
    """Installs canwire below /usr/local; it goes with the guest, or with test_uninstall.py."""
    RMEM_MAX.write_text(RMEM_MAX_DEFAULT)
    run(ROOT / "scripts/install-files", "install")


PAIR = """
bus: {{ name: {0}, bitrate: 500000 }}
control: /run/canwire/{0}.sock
nodes:
  - {{ name: a, port: {0}0 }}
  - {{ name: b, port: {0}1 }}
"""


class Bus:
    """A bus as a unit, with two nodes: of bus "one" at one0 and one1."""

    def __init__(self, name, text):
        self.name, self.unit = name, f"canwired@{name}.service"
        self.vcan_unit = f"canwire-vcan@{name}.service"
        self.config = Path(f"/etc/canwire/{name}.yaml")
        self.socket = Path(f"/run/canwire/{name}.sock")
        self.config.write_text(text)

    def carries(self):
        """Returns True when a frame gets from one ECU to the other."""
        with can_socket(f"{self.name}0") as a, can_socket(f"{self.name}1") as b:
            a.send(FRAME.pack())
            return Frame.unpack(b.recv(16)) == FRAME  # whole: a frame

    def start(self):
        systemctl("start", self.unit)

    def show(self, name):
        return systemctl("show", "-P", name, self.unit).strip()

    def pid(self):
        return int(self.show("MainPID"))

    def status(self):
        return json.loads(run("canwire", "status", self.name, "--json"))

    def messages(self, *matches):
        """Returns the messages of canwired in the journal, as dicts of fields."""
        run("journalctl", "--sync")
        text = run("journalctl", "-o", "json", "--no-pager", f"_SYSTEMD_UNIT={self.unit}", *matches)
        return [json.loads(line) for line in text.splitlines()]

    def close(self):
        systemctl("stop", self.unit, self.vcan_unit)
        subprocess.run(["systemctl", "reset-failed", self.unit], check=False, capture_output=True)
        self.config.unlink()


@pytest.fixture
def bus():
    """bus(NAME) starts a bus; change(TEXT) returns a changed configuration."""
    buses = []

    def start(name, change=lambda text: text):
        buses.append(Bus(name, change(PAIR.format(name))))
        buses[-1].start()
        return buses[-1]

    yield start
    for each in buses:
        each.close()
