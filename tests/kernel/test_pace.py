# SPDX-License-Identifier: MIT
"""Time that passes without the daemon, or is set: what the bus makes up for and what it skips."""

import json
import os
import re
import signal
import socket
import time

import pytest

from canbits import Frame
from compiled import compiled
from conftest import assert_balance, wait_until
from test_faults import Shell

HOURS_NS = 3600 * 10**9
STOP_S = 3.0
BUSY = """
bus: {{ name: pace, bitrate: 500000 }}
control: pace.sock
nodes:
  - {{ name: engine, port: vcan0, queue: 4096 }}
  - {{ name: gearbox, port: vcan1 }}
  - name: clock
    queue: 4096
    traffic: [ {{ send: 700#00, every: 1ms }} ]
catch-up: {catch_up}
"""
QUIET = """
bus: { name: pace, bitrate: 500000 }
control: pace.sock
nodes:
  - { name: engine, port: vcan0, queue: 4096 }
  - { name: gearbox, port: vcan1 }
"""
WARNING_S = 10  # between two warnings
TOO_MUCH = BUSY.format(catch_up="100ms").replace("every: 1ms", "every: 25ns")


def frames(identifier, count):
    return [Frame(identifier, 2, i.to_bytes(2, "big")) for i in range(count)]


class Bus:
    def __init__(self, daemon):
        self.daemon = daemon
        self.shell = Shell(daemon)

    def status(self):
        return self.shell.status("pace")

    def clock(self):
        return next(n for n in self.status()["nodes"] if n["name"] == "clock")

    def stopped(self, seconds):
        """Stops the daemon for some time."""
        self.daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)  # no wait: at least so long
        self.daemon.process.send_signal(signal.SIGCONT)

    def stop(self):
        for node in self.status()["nodes"]:
            assert_balance(node)
        return self.daemon.stop()


@pytest.fixture
def bus(vcan, canwired):
    vcan(2)
    return lambda text: Bus(canwired(text))


@pytest.fixture
def skips(tmp_path):
    """skips(bus) gets the skip events from now on; the result is called for the next one."""
    opened = []

    def start(b):
        s = socket.socket(socket.AF_UNIX)
        opened.append(s)
        s.settimeout(30)
        s.connect(str(b.daemon.config.parent / "pace.sock"))
        s.sendall(b'{"request":"watch","events":["skip"]}\n')
        lines = s.makefile()
        assert json.loads(lines.readline())["ok"]
        return lambda: json.loads(lines.readline())

    yield start
    for s in opened:
        s.close()


# ---- A daemon that is stopped --------------------------------------------------------------------


def test_a_bus_that_was_stopped_too_long_skips_it_and_says_so(bus, skips, can_socket):
    b = bus(BUSY.format(catch_up="1s"))
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    next_skip = skips(b)
    wait_until(lambda: b.clock()["tx_frames"] > 10, "traffic")
    written = frames(0x100, 20)
    b.daemon.process.send_signal(signal.SIGSTOP)
    engine.send(*written)
    time.sleep(STOP_S)  # no wait: at least so long
    b.daemon.process.send_signal(signal.SIGCONT)
    event = next_skip()
    assert set(event) == {"t", "event", "skipped_ns"}
    assert 1e9 < event["skipped_ns"] < 100e9
    received = []
    wait_until(lambda: received.extend(f for f in gearbox.drain() if f.identifier == 0x100)
               or len(received) >= 20, "what was written meanwhile")
    assert received == written
    status = b.status()
    assert status["bus"]["skips"] >= 1
    assert status["bus"]["skipped_ns"] >= event["skipped_ns"]
    # bus time stood still: the clock has not made up for what it missed
    clock = next(n for n in status["nodes"] if n["name"] == "clock")
    assert abs(clock["handed_in"] - status["bus"]["time_ns"] // 10**6) <= 1
    assert "fell behind real time" in b.shell.run("status", "pace")
    assert "the bus fell behind real time and has skipped" in b.stop()


def test_what_is_allowed_to_be_caught_up_is(bus):
    b = bus(BUSY.format(catch_up="10min"))
    before = b.status()["bus"]["time_ns"]
    b.stopped(STOP_S)
    wait_until(lambda: b.status()["bus"]["time_ns"] > before + STOP_S * 1e9, "the bus")
    status = b.status()
    assert (status["bus"]["skips"], status["bus"]["skipped_ns"]) == (0, 0)
    clock = next(n for n in status["nodes"] if n["name"] == "clock")
    assert clock["handed_in"] == status["bus"]["time_ns"] // 10**6 + 1  # none was left out
    assert "fell behind" not in b.stop()


def test_a_bus_at_rest_misses_nothing(bus, can_socket):
    """It was stopped for longer than it may fall behind, but nothing was due meanwhile."""
    b = bus(QUIET)
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    written = frames(0x100, 10)
    b.stopped(STOP_S)
    assert b.status()["bus"]["skips"] == 0
    engine.send(*written)
    assert gearbox.receive(10) == written
    b.stop()


def test_a_machine_that_is_too_slow(bus):
    """40 million frames a second are too much for any machine; the bus still serves its clients."""
    begin = time.monotonic()
    b = bus(TOO_MUCH)
    wait_until(lambda: b.status()["bus"]["skips"] > 5, "skips")
    b.shell.run("set", "pace", "clock", "listen-only=on")
    wait_until(lambda: b.clock()["dropped"]["listen-only"] > 0, "drops")
    told = b.daemon.stop().count("fell behind")
    assert told <= 2 + (time.monotonic() - begin) / WARNING_S


def test_a_machine_that_was_suspended(vcan, bus, tmp_path, monkeypatch, can_socket):
    """As the clocks show it: CLOCK_BOOTTIME went on, CLOCK_MONOTONIC did not."""
    mark = tmp_path / "suspended"
    monkeypatch.setenv("SUSPENDED", str(mark))
    monkeypatch.setenv("LD_PRELOAD", str(compiled("suspended_clock.so")))
    b = bus(QUIET)
    monkeypatch.delenv("LD_PRELOAD")
    mark.touch()
    wait_until(lambda: b.status()["bus"]["skips"], "the skip")
    bus_status = b.status()["bus"]
    assert (bus_status["skips"], round(bus_status["skipped_ns"] / 1e9)) == (1, 7200)
    assert bus_status["time_ns"] < 3600e9  # it stood still
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    written = frames(0x100, 3)
    engine.send(*written)
    assert gearbox.receive(3) == written
    assert re.search(r"has skipped (7199\.9|7200\.0)", b.stop())


# ---- A clock that is set -------------------------------------------------------------------------


@pytest.fixture
def set_clock():
    """set_clock(NS) steps CLOCK_REALTIME; it is right again at the end."""
    if os.environ.get("CANWIRE_PLACE") != "qemu":
        pytest.skip("the clock of this machine is not ours to set")
    steps = []

    def step(ns):
        steps.append(ns)
        time.clock_settime_ns(time.CLOCK_REALTIME, time.clock_gettime_ns(time.CLOCK_REALTIME) + ns)

    yield step
    step(-sum(steps))


@pytest.mark.parametrize("hours", [3, -5])
def test_steps_of_the_clock_do_not_matter(hours, bus, set_clock, can_socket):
    b = bus(BUSY.format(catch_up="10min"))
    engine, gearbox = can_socket("vcan0"), can_socket("vcan1")
    written, received = frames(0x100, 2000), []
    for i in range(0, 2000, 100):
        engine.send(*written[i : i + 50])
        if i % 400 == 0:
            set_clock(hours * HOURS_NS if i % 800 == 0 else -hours * HOURS_NS)
        engine.send(*written[i + 50 : i + 100])
        received += [f for f in gearbox.drain() if f.identifier == 0x100]
    wait_until(lambda: received.extend(f for f in gearbox.drain() if f.identifier == 0x100)
               or len(received) >= 2000, "all frames")
    assert received == written
    status = b.status()
    assert status["bus"]["skips"] == 0 and status["bus"]["time_ns"] < HOURS_NS
    for node in status["nodes"]:
        assert node["delay"]["max_ns"] < 600e9
    clock = b.clock()
    assert sum(clock["dropped"].values()) == 0
    b.stop()


def test_a_clock_that_is_set_back_does_not_delay_lcm(
    vcan, canwired, listen, no_multicast, set_clock
):
    vcan(1)
    daemon = canwired("bus: { name: pace, bitrate: 500000 }\nnodes: [ { name: a, port: vcan0 } ]\n"
                      "lcm: { period: 100ms }\n")
    wait_until(lambda: "cannot start" in daemon.stderr(), "the warning")
    set_clock(-5 * HOURS_NS)
    no_multicast()  # the route is back
    listen("pace").wait_bus(lambda m: m.bits > 0, "statistics")
    daemon.stop()
