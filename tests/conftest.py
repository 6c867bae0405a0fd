# SPDX-License-Identifier: MIT
"""Fixtures of the tests that need no CAN in the kernel."""

import os
import signal
from pathlib import Path

import pytest

from simtool import CANWIRE

pytest_plugins = ["depth", "hang"]

# the package canwire of the checkout finds the library that has just been built
os.environ.setdefault("CANWIRE_SIM_LIBRARY", str(Path(CANWIRE).with_name("libcanwire-sim.so")))

# a test links what it builds as the programs are linked that it runs
LINKED = Path(CANWIRE).with_name("lto")
if LINKED.exists():
    os.environ.setdefault("LTO", LINKED.read_text(encoding="ascii").strip())

# a shell starts jobs in the background without Ctrl-C, which some tests send
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--backwards", action="store_true",
                     help="run the last test first: finds those that need what others leave")


def pytest_collection_modifyitems(config, items):
    if config.getoption("backwards"):
        items.reverse()


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    """write(text) is the path of a file with that text; write(text, name) has another name."""
    def write(text, name="bus.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write
