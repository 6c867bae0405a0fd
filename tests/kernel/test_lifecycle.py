# SPDX-License-Identifier: MIT
"""Start and stop of canwired, and what it does when its surroundings are not as they should be."""

import re
import signal
import time

import pytest

from canbits import Frame
from conftest import MULTICAST_ROUTE, ip, wait_until

pytestmark = pytest.mark.kept

SATURATED = """
bus: { name: stop, bitrate: 500000 }
nodes:
  - { name: receiver, port: vcan0 }
  - name: load
    traffic: [ { send: 123#DEADBEEF, every: 100us } ]
lcm: { period: 100ms, events: [] }
"""
PAIR = """
bus: { name: pair, bitrate: 500000 }
nodes:
  - { name: a, port: vcan0 }
  - { name: b, port: vcan1 }
lcm: { period: 100ms }
"""


TOO_MUCH = SATURATED.replace("100us", "1us")  # for a machine that is slow enough


@pytest.mark.parametrize("traffic", [SATURATED, TOO_MUCH], ids=["saturated", "too-much"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_stops_cleanly_under_load(number, traffic, vcan, can_socket, canwired, listen):
    vcan(1)
    receiver = can_socket("vcan0")
    messages = listen("stop")
    daemon = canwired(traffic)
    messages.wait_bus(lambda m: m.frames > 1000, "traffic")
    stderr = daemon.stop(number)
    bus, nodes = messages.wait_final(stderr)
    assert nodes["load"].dropped_queue_full > 0, "the bus was not saturated"
    assert bus.pending > 0
    assert bus.bits - bus.busy_bits <= 11, "the bus had rested"
    assert receiver.receive(bus.frames) == [Frame.parse("123#DEADBEEF")] * bus.frames
    assert daemon.notified("STOPPING=1")


def test_stops_cleanly_at_rest(vcan, canwired, listen):
    vcan(2)
    messages = listen("pair")
    bus, _ = messages.wait_final(canwired(PAIR).stop())
    assert (bus.frames, bus.busy_bits) == (0, 0)


def test_tells_systemd_that_it_is_ready_and_how_it_is(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR)
    status = wait_until(lambda: daemon.notified("STATUS="), "STATUS")
    assert re.search(r"pair.*2 nodes.*500000 bit/s", status), status
    daemon.stop()


def test_names_every_missing_interface(vcan, launch):
    vcan(1)
    daemon = launch(PAIR.replace("vcan0", "nosuch0").replace("vcan1", "nosuch1"))
    assert daemon.wait() == 1
    assert "nosuch0" in daemon.stderr() and "nosuch1" in daemon.stderr()
    assert not daemon.notified("READY=1")


def test_runs_without_multicast_route_and_finds_it_later(
    vcan, can_socket, canwired, listen, no_multicast
):
    vcan(2)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    daemon = canwired(PAIR)
    wait_until(lambda: "warning" in daemon.stderr(), "the warning")
    assert f"ip route add {MULTICAST_ROUTE}" in daemon.stderr()
    wait_until(lambda: any(" waiting: no multicast route" in n for n in daemon.notifications),
               "the status line")
    frame = Frame.parse("123#DEADBEEF")
    a.send(frame)
    assert b.receive(1) == [frame]

    no_multicast()  # the route is back
    messages = listen("pair")
    bus = messages.wait_bus(lambda m: m.frames == 1, "statistics")
    assert bus.events_dropped > 0  # events that could not be published in the meantime
    assert daemon.stop().count("warning") == 1


WARNING_S = 10  # between two warnings
LOST = "messages cannot be sent and are lost"


def test_a_multicast_route_that_is_lost_and_comes_back(vcan, can_socket, canwired, listen):
    """Again and again; the log is not filled with it, the bus does not notice."""
    vcan(2)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    begin = time.monotonic()
    daemon = canwired(PAIR)
    messages = listen("pair")
    before = messages.wait_bus(lambda m: m.bits > 0, "statistics").events_dropped
    frame = Frame.parse("123#DEADBEEF")
    for i in range(4):
        ip(f"route del {MULTICAST_ROUTE}")
        try:
            if i == 0:
                wait_until(lambda: LOST in daemon.stderr(), "the warning")
                wait_until(lambda: any("failing: Network is unreachable" in n
                                       for n in daemon.notifications), "the status line")
            a.send(frame)
            assert b.receive(1) == [frame]
            time.sleep(0.3)  # no wait: for some messages, of which the first has been lost by now
        finally:
            ip(f"route add {MULTICAST_ROUTE}")
        seen = len(messages.bus)
        wait_until(lambda n=seen: len(messages.bus) > n + 2, "statistics again")
    assert messages.bus[-1].events_dropped > before
    assert messages.bus[-1].frames == 4
    log = daemon.stop()
    assert "Network is unreachable" in log and "LCM at udpm" in log and "works again" in log
    assert 1 <= log.count(LOST) <= 2 + (time.monotonic() - begin) / WARNING_S
