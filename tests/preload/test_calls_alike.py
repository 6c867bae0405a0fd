# SPDX-License-Identifier: MIT
"""The calls of SocketCAN give here what a real vcan gives (tests/kernel/test_preload.py)."""

from simtool import ROOT

EXPECTED = (ROOT / "tests/preload/calls.expected").read_text()


def test_the_calls_give_what_a_real_vcan_gives(bus, calls):
    r = bus(bus=", dbitrate: 2000000")
    assert r.run("engine=can0", calls, "can0").stdout == EXPECTED
    assert r.run("engine", calls, "engine").stdout == EXPECTED
    r.stop()
