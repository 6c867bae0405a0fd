# SPDX-License-Identifier: MIT
"""The cost of a message with python-can, in calls. They do not depend on the machine.

`make bench` prints the times.
"""

import sys
import time
import types

import can
import pytest

from canwire import Bus, VirtualTime, _library, pythoncan

NODES = 4
FRAMES = 40
START_S = 1_700_000_000


class Clock:
    """The clocks of a machine on which only waiting takes time, and a look at them 5 us."""

    def __init__(self):
        self.ns = 0

    def wait(self, seconds=None):
        assert seconds is not None, "nothing will come"
        self.ns += round(seconds * 1e9)

    def look(self):
        self.ns += 5000
        return self.ns

    def module(self):
        return types.SimpleNamespace(**{
            **vars(time), "monotonic_ns": self.look, "monotonic": lambda: self.look() / 1e9,
            "time": lambda: START_S + self.look() / 1e9})


@pytest.fixture(name="clock")
def fixture_clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(pythoncan, "time", clock.module())
    monkeypatch.setattr(pythoncan.Wire, "wait_for_change", clock.wait)
    return clock


def deliver(buses, messages):
    """One sends, and the others receive it."""
    for number, message in enumerate(messages):
        sender = number % NODES
        buses[sender].send(message)
        got = [bus.recv(1) for node, bus in enumerate(buses) if node != sender]
        assert [one.data for one in got] == [message.data] * (NODES - 1)


def calls_of_a_message(channels=("speed",) * NODES, **options):
    """Returns the calls of functions of Python, and of the library, for each message."""
    def count(frame, event, _):
        if event == "call":
            calls["python"] += 1
            calls["library"] += frame.f_code is library_call
    buses = [can.Bus(channel=channel, **options) for channel in channels]
    library_call = _library.Guarded(_library.library(), RuntimeError).offer.__code__
    messages = [can.Message(arbitration_id=number * 37 % 0x800, is_extended_id=False,
                            data=bytes((number + i) % 256 for i in range(8)))
                for number in range(FRAMES)]
    calls = {"python": 0, "library": 0}
    before = sys.getprofile()
    deliver(buses, messages)  # some things are done only once
    sys.setprofile(count)
    try:
        deliver(buses, messages)
    finally:
        sys.setprofile(before)
        for bus in buses:
            bus.shutdown()
    return {what: number / FRAMES for what, number in calls.items()}


def test_a_message_in_virtual_time_costs_less_than_with_virtual():
    calls = calls_of_a_message(interface="canwire", virtual_time=True)
    assert calls["library"] <= 4  # one to send it, and one for each that receives it
    assert calls["python"] <= 48
    assert calls["python"] < calls_of_a_message(interface="virtual")["python"] / 2


def test_a_message_between_nodes_in_the_time_of_their_bus_costs_little_more_than_with_virtual():
    nodes = [{"name": name} for name in "abcd"]
    with Bus.from_dict({"bus": {"bitrate": 500000}, "nodes": nodes}) as bus, VirtualTime(bus):
        calls = calls_of_a_message(channels="abcd", interface="canwire")
    assert calls["library"] <= 11
    assert calls["python"] <= 105


def test_a_message_in_real_time_costs_one_wait(clock):
    calls = calls_of_a_message(interface="canwire")
    assert calls["library"] <= 5  # the first receiver waits once
    assert calls["python"] <= 70  # with 8 looks at the clock
    assert clock.ns > 2 * FRAMES * 200_000
