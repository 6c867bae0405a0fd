# SPDX-License-Identifier: MIT
"""canwired reports to its service manager, and does not wait for it."""

import signal

import pytest

from canbits import Frame
from compiled import compiled
from conftest import wait_until
from test_faults import Shell

PAIR = """
bus: { name: pair, bitrate: 500000 }
control: pair.sock
nodes:
  - { name: a, port: vcan0 }
  - { name: b, port: vcan1 }
"""
WATCHDOG_US = "300000"


@pytest.fixture
def frozen_clock(tmp_path):
    """Returns the environment of a program whose clock stands while a file exists, and that
    file."""
    file = tmp_path / "frozen"
    environment = {"LD_PRELOAD": str(compiled("frozen_clock.so")), "FROZEN": str(file),
                   "ASAN_OPTIONS": "verify_asan_link_order=0"}
    return environment, file


def count(daemon, start):
    return sum(n.startswith(start) for n in daemon.notifications)


def wait_more(daemon, start, more):
    """Waits until this many more notifications of a kind have come."""
    enough = count(daemon, start) + more
    wait_until(lambda: count(daemon, start) >= enough, f"{more} more {start}")


def last_status(daemon):
    return next((n for n in reversed(daemon.notifications) if n.startswith("STATUS=")), "")


def test_a_manager_that_does_not_read_holds_up_nothing(vcan, can_socket, launch):
    vcan(2)
    a, b = can_socket("vcan0"), can_socket("vcan1")
    daemon = launch(PAIR, crowded=True, WATCHDOG_USEC=WATCHDOG_US)
    wait_until(lambda: "2 nodes" in daemon.stderr(), "the start")
    a.send(*[Frame.parse("123#DEADBEEF")] * 10)
    assert len(b.receive(10)) == 10
    daemon.process.send_signal(signal.SIGHUP)
    wait_until(lambda: "reloaded" in daemon.stderr(), "the reload")
    a.send(Frame.parse("124#"))
    assert b.receive(1) == [Frame.parse("124#")]
    assert not daemon.notifications
    daemon.listen()
    wait_until(lambda: count(daemon, "READY=1") == 2, "what had been held back")
    states = [n for n in daemon.notifications if n.startswith(("READY", "RELOADING"))]
    assert states == ["READY=1", "RELOADING=1", "READY=1"]
    wait_until(lambda: count(daemon, "WATCHDOG=1"), "a sign of life")
    wait_until(lambda: ", 11 frames" in last_status(daemon), "the newest status")
    daemon.stop()
    wait_until(lambda: count(daemon, "STOPPING=1"), "STOPPING=1")


def test_the_watchdog_is_fed_while_the_bus_rests(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR, WATCHDOG_USEC=WATCHDOG_US)
    wait_more(daemon, "WATCHDOG=1", 5)
    daemon.stop()


def test_nobody_is_fed_who_does_not_ask(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR)
    wait_more(daemon, "STATUS=", 2)
    assert count(daemon, "WATCHDOG=1") == 0


def test_the_watchdog_is_not_fed_by_a_bus_that_stands(vcan, canwired, frozen_clock):
    vcan(2)
    environment, file = frozen_clock
    daemon = canwired(PAIR, WATCHDOG_USEC=WATCHDOG_US, **environment)
    wait_more(daemon, "WATCHDOG=1", 2)
    file.touch()
    wait_more(daemon, "STATUS=", 1)  # earlier messages have arrived by now
    fed = count(daemon, "WATCHDOG=1")
    wait_more(daemon, "STATUS=", 3)  # its loop is alive
    assert count(daemon, "WATCHDOG=1") == fed
    file.unlink()
    wait_more(daemon, "WATCHDOG=1", 2)
    daemon.stop()


def test_a_reload_is_told_whoever_asks_for_it(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR)
    shell = Shell(daemon)
    shell.run("reload", "pair")
    wait_until(lambda: count(daemon, "READY=1") == 2, "READY=1 after the reload")
    assert count(daemon, "MONOTONIC_USEC=") == 1
    daemon.process.send_signal(signal.SIGHUP)
    wait_until(lambda: count(daemon, "READY=1") == 3, "READY=1 after the reload")
    states = [n for n in daemon.notifications if n.startswith(("READY", "RELOADING"))]
    assert states == ["READY=1", "RELOADING=1", "READY=1", "RELOADING=1", "READY=1"]


def test_the_status_tells_a_refused_reload_until_one_is_good(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR)
    daemon.config.write_text(PAIR.replace("500000", "250000"))
    daemon.process.send_signal(signal.SIGHUP)
    wait_until(lambda: "reload refused: " in last_status(daemon), "the refusal")
    assert "bus.bitrate cannot change" in last_status(daemon)
    assert count(daemon, "READY=1") == 2
    daemon.config.write_text(PAIR)
    Shell(daemon).run("reload", "pair")
    wait_until(lambda: "refused" not in last_status(daemon), "the good one")


def test_the_status_names_nodes_in_trouble(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR + "faults: [ { name: off, do: { bus-off: a } } ]\n")
    wait_until(lambda: last_status(daemon).endswith(", a bus-off"), "the node")


def test_messages_go_to_standard_error_where_that_is_not_the_journal(vcan, canwired):
    vcan(2)
    daemon = canwired(PAIR, JOURNAL_STREAM="1:2")
    assert daemon.stop().startswith("canwired: pair: 2 nodes at 500000 bit/s, classical CAN\n")
