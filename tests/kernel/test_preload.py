# SPDX-License-Identifier: MIT
"""The kernel's SocketCAN is the measure of the library of `canwire run`: tests/preload has more."""

import os
import subprocess

from conftest import ROOT

EXPECTED = ROOT / "tests/preload/calls.expected"


def test_a_real_vcan_gives_what_the_library_must_give(vcan, tmp_path):
    vcan(1, mtu=72)
    calls = tmp_path / "calls"
    subprocess.run([os.environ.get("CC", "cc"), "-D_GNU_SOURCE", "-O1", "-pthread", "-o", calls,
                    ROOT / "tests/preload/calls.c"], check=True)
    done = subprocess.run([calls, "vcan0"], capture_output=True, text=True, check=True)
    assert done.stdout == EXPECTED.read_text()
