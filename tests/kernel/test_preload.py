# SPDX-License-Identifier: MIT
"""The kernel's SocketCAN is the measure of the library of `canwire run`: tests/preload has more."""

import subprocess

from compiled import compiled
from conftest import ROOT

EXPECTED = ROOT / "tests/preload/calls.expected"


def test_a_real_vcan_gives_what_the_library_must_give(vcan):
    vcan(1, mtu=72)
    done = subprocess.run([compiled("socketcan-calls"), "vcan0"], capture_output=True, text=True,
                          check=True)
    assert done.stdout == EXPECTED.read_text()
