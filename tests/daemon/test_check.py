# SPDX-License-Identifier: MIT
"""`canwire status --check`: a line for monitoring and the exit status of a plugin of Nagios.

CANWIRE and CANWIRED are the programs.
"""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import time

import pytest

from simtool import CANWIRE, CANWIRED, answer, kill_all
from test_record import wait_until

OK, WARNING, CRITICAL, UNKNOWN = range(4)

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: load, traffic: [ { send: 123#11, every: 10ms } ] }
  - { name: dash }
  - { name: ecu, port: "unix:port.sock" }  # which lies beside that of the bus
"""


class Bus:
    def __init__(self, folder):
        self.folder, self.process = folder, None

    def start(self, more="", *words):
        (self.folder / "day.yaml").write_text(BUS + more)
        log = self.folder / "stderr"
        with log.open("w") as errors:
            self.process = subprocess.Popen([CANWIRED, "-c", "day.yaml", *words], cwd=self.folder,
                                            stderr=errors)
        wait_until(lambda: " bit/s, " in log.read_text(), "the bus")

    def check(self, *words):
        """Returns exit status and line; nothing else is said."""
        environment = dict(os.environ, CANWIRE_RUN=str(self.folder))
        done = subprocess.run([CANWIRE, "status", "--check", "--wait", "0ms", *words],
                              cwd=self.folder, env=environment, capture_output=True, text=True,
                              timeout=60, check=False)
        assert done.returncode == UNKNOWN or (done.stderr == "" and done.stdout.count("\n") == 1)
        return done.returncode, done.stdout.strip()

    def inject(self, rule):
        subprocess.run([CANWIRE, "inject", "./day.sock", rule], cwd=self.folder, check=True,
                       capture_output=True)


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    bus = Bus(tmp_path)
    yield bus
    kill_all([bus.process] if bus.process else [])


def test_a_bus_that_is_well(bus):
    bus.start("record: [ { file: a.log } ]\n")
    for words in ([], ["day"], ["./day.sock"]):
        status, line = bus.check(*words)
        assert status == OK
        assert re.fullmatch(r"CANWIRE OK - day: load \d\.\d %, 3 nodes, 1 sink "
                            r"\| day_load=\d\.\d%;;;0;100", line)


def test_a_bus_that_is_not_there(bus):
    assert bus.check() == (CRITICAL, f"CANWIRE CRITICAL - no bus runs in {bus.folder}")
    status, line = bus.check("night")
    assert status == CRITICAL and line.startswith("CANWIRE CRITICAL - ") and "night" in line
    bus.start()
    bus.process.kill()
    bus.process.wait()
    status, line = bus.check()
    assert status == CRITICAL and "day.sock" in line


def test_limits_of_the_load(bus):
    bus.start()
    wait_until(lambda: bus.check("--load", "1,")[0] == WARNING, "a second of load")
    status, line = bus.check("--load", "0,1")
    assert status == CRITICAL and line.endswith("%;;1;0;100")
    assert bus.check("--load", "90,95")[0] == OK
    assert bus.check("--load", "90,0")[0] == OK
    status, line = bus.check("--load", "0.1,90.5%")
    assert status == WARNING and line.split("%;")[1] == "0.1;90.5;0;100"


@pytest.mark.parametrize("option, limits, why", [
    ("--load", "90,70", "expected a limit for WARNING that is at most the one for CRITICAL, such "
     "as 70,90"),
    ("--state", "bus-off,error-passive", "the worse one last")])
def test_limits_that_are_the_wrong_way_round(tmp_path, option, limits, why):
    told = answer(tmp_path, "status", "--check", option, limits, "day", status=UNKNOWN)
    assert f"{option} {limits}: " in told and why in told


def test_states_sinks_and_rules(bus):
    bus.start('lcm: { url: "tcpq://127.0.0.1:1" }\n')  # nobody listens there
    wait_until(lambda: "lcm tcpq://127.0.0.1:1 failing: Connection refused" in bus.check()[1],
               "the first messages")
    status, line = bus.check()
    assert status == WARNING and line.startswith("CANWIRE WARNING - day: ")
    quiet = ("--sinks", "ok")
    assert bus.check(*quiet)[0] == OK
    assert bus.check("--sinks", "critical")[0] == CRITICAL
    bus.inject("{name: end, do: {bus-off: dash}}")
    wait_until(lambda: bus.check(*quiet)[0] == CRITICAL, "bus-off")
    assert ", dash bus-off" in bus.check(*quiet)[1]
    assert bus.check(*quiet, "--state", "bus-off,none")[0] == WARNING
    assert bus.check(*quiet, "--state", "none,none")[0] == OK
    bus.process.kill()
    bus.process.wait()
    bus.start()
    status, line = bus.check(*quiet)
    assert status == WARNING
    assert ", 1 injected rule was lost with the crash at " in line and ": end |" in line


def test_a_bus_that_is_stopped_is_critical(bus):
    """The check ends by itself: it waits ten seconds."""
    bus.start()
    bus.process.send_signal(signal.SIGSTOP)
    assert bus.check("day") == (CRITICAL, "CANWIRE CRITICAL - bus day: it does not answer")
    bus.process.send_signal(signal.SIGCONT)


def test_a_bus_that_takes_no_more_clients_is_critical(bus):
    """So does this one: a connection waits for a place as long as for a reply."""
    bus.start()
    bus.process.send_signal(signal.SIGSTOP)
    waiting = []
    try:
        while True:
            waiting.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK))
            waiting[-1].connect(str(bus.folder / "day.sock"))
    except BlockingIOError:
        pass  # the last place is taken
    socket_path = bus.folder / "day.sock"
    assert bus.check("day") == (CRITICAL, f"CANWIRE CRITICAL - bus day: {socket_path}: it does "
                                          "not answer")
    bus.process.send_signal(signal.SIGCONT)
    for one in waiting:
        one.close()


def test_two_buses_of_one_name_have_two_labels(bus):
    reply = json.dumps({"ok": True, "status": status_of([])}).encode() + b"\n"
    with socket.socket(socket.AF_UNIX) as one, socket.socket(socket.AF_UNIX) as two:
        for name, listener in (("one", one), ("two", two)):
            listener.bind(str(bus.folder / f"{name}.sock"))
            listener.listen()
            listener.settimeout(60)

        def serve():
            for client in [listener.accept()[0] for listener in (one, two)]:
                client.makefile().readline()
                client.sendall(reply)
                client.close()

        server = threading.Thread(target=serve)
        server.start()
        _, line = bus.check()
        server.join()
    assert line.split(" | ")[1] == "day_load=0.5%;;;0;100 day.two_load=0.5%;;;0;100"


def test_buses_that_hang_are_asked_at_the_same_time(bus):
    """Both have their request before the first one has missed its time."""
    listeners = [socket.socket(socket.AF_UNIX) for _ in range(3)]
    reply = {"ok": True, "status": status_of([])}
    for name, listener in zip("abc", listeners):
        listener.bind(str(bus.folder / f"{name}.sock"))
        listener.listen()
        listener.settimeout(60)
    asked = []

    def serve():
        clients = [listener.accept()[0] for listener in listeners]
        for client in clients:
            asked.append(json.loads(client.makefile().readline())["request"])
        try:
            asked.append(clients[0].recv(1, socket.MSG_DONTWAIT))  # whole: the end
        except BlockingIOError:
            asked.append("it still waits")
        clients[2].sendall(json.dumps(reply).encode() + b"\n")
        clients[0].recv(1)  # whole: the end, the check is over
        clients[1].recv(1)  # whole: the end

    server = threading.Thread(target=serve)
    server.start()
    found, line = bus.check()
    server.join()
    for listener in listeners:
        listener.close()
    assert asked == ["status"] * 3 + ["it still waits"] and found == CRITICAL
    assert line.count("it does not answer") == 2 and "day: load 0.5 %, 0 nodes, 0 sinks" in line


def status_of(nodes, **more):
    return {"bus": {"name": "day", "load_second_permille": 5}, "nodes": nodes, "sinks": [], **more}


def answer_once(listener, reply):
    """Answers a request for the status."""
    with listener.accept()[0] as client:
        client.makefile().readline()
        client.sendall(json.dumps(reply).encode() + b"\n")


def check_answer(bus, reply, *words):
    """Checks a bus that gives this reply."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(bus.folder / "day.sock"))
        listener.listen()
        server = threading.Thread(target=answer_once, args=(listener, reply))
        server.start()
        found = bus.check(*words)
        server.join()
    return found


@pytest.mark.parametrize("words, expected", [
    ((), WARNING), (("--links", "critical"), CRITICAL), (("--links", "ok"), OK)])
def test_links(bus, words, expected):
    """The interfaces of a bus need the kernel, so the bus is one of the test."""
    nodes = [{"name": "a", "state": "error-active", "link": "up"},
             {"name": "b", "state": "error-active", "link": "missing"},
             {"name": "g", "state": "error-active", "link": "down", "guest": 1},
             {"name": "s", "state": "sleeping", "link": None}]
    status, line = check_answer(bus, {"ok": True, "status": status_of(nodes)}, *words)
    assert status == expected
    assert (", b link missing |" in line) == (expected != OK) and "g link" not in line


def test_a_tunnel_that_waits_is_a_link_that_is_down(bus):
    bus.start('  - { name: far, port: "cannelloni:tcp,connect=127.0.0.1:1" }\n')  # nobody listens
    status, line = bus.check()
    assert status == WARNING and re.search(r", far tunnel (waiting|connecting) \|", line)
    assert bus.check("--links", "critical")[0] == CRITICAL
    assert bus.check("--links", "ok")[0] == OK


@pytest.mark.parametrize("words, expected", [
    ((), WARNING), (("--losses", "critical"), CRITICAL), (("--losses", "ok"), OK)])
def test_losses_of_late(bus, words, expected):
    lately = [{"node": "a", "what": "dropped, queue full"}, {"node": None, "what": "fell behind"}]
    status, line = check_answer(bus, {"ok": True, "status": status_of([], lately=lately)}, *words)
    assert status == expected
    assert (", a frames dropped, queue full, the bus fell behind |" in line) == (expected != OK)


@pytest.mark.parametrize("words, expected", [
    ((), WARNING), (("--sinks", "critical"), CRITICAL), (("--sinks", "ok"), OK)])
def test_a_journal_with_a_gap(bus, words, expected):
    sink = {"kind": "journal", "name": "j", "state": "writing", "good": True, "gaps": 1}
    reply = {"ok": True, "status": status_of([], sinks=[sink, sink | {"name": "whole", "gaps": 0}])}
    status, line = check_answer(bus, reply, *words)
    assert status == expected and "whole" not in line
    assert (", journal j has 1 gap |" in line) == (expected != OK)


def test_a_bus_that_loses_frames_and_time(bus):
    bus.start("  - { name: much, queue: 1, traffic: [ { send: 7FF#11, every: 20us } ] }\n")
    wait_until(lambda: ", much frames dropped, queue full" in bus.check()[1], "the loss")
    bus.process.send_signal(signal.SIGSTOP)
    time.sleep(1)  # no wait: the bus is to miss more than it catches up
    bus.process.send_signal(signal.SIGCONT)
    wait_until(lambda: ", the bus fell behind real time and has skipped some" in bus.check()[1],
               "the time that is missing")
    assert bus.check()[0] == WARNING and bus.check("--losses", "ok")[0] == OK
    answer(bus.folder, "reload", "./day.sock")
    assert ", much frames dropped, queue full" in bus.check()[1]


JUNK = "what it answers has not got"


@pytest.mark.parametrize("status, expected, message", [
    (None, UNKNOWN, f"{JUNK} a status"), ([], UNKNOWN, f"{JUNK} a status"),
    ({}, UNKNOWN, f"{JUNK} the name of a bus"),
    (status_of([], bus={"name": "day"}), UNKNOWN, f"{JUNK} a load"),
    (status_of(None), UNKNOWN, f"{JUNK} nodes"), (status_of([], sinks=1), UNKNOWN, f"{JUNK} sinks"),
    (status_of([5]), UNKNOWN, ",  without a state"),
    (status_of([{"name": "a", "state": "\x1b"}]), UNKNOWN, ", a ?"),
    (status_of([{"name": "a", "state": "?"}, {"name": "b", "state": "bus-off"}]), CRITICAL,
     ", b bus-off")])
def test_what_is_no_status_is_unknown(bus, status, expected, message):
    for words in ((), ("day",)):
        found, line = check_answer(bus, {"ok": True, "status": status}, *words)
        assert found == expected and message in line, line
        (bus.folder / "day.sock").unlink()


def test_an_answer_without_the_status_is_unknown(bus):
    assert check_answer(bus, {"ok": True}, "day") == (
        UNKNOWN, f"CANWIRE UNKNOWN - bus day: {JUNK} a status")


@pytest.mark.parametrize("words", [
    ("--load", "70"), ("--load", "x,1"), ("--load", "1,101"), ("--load", "0.01,1"),
    ("--state", "off,none"), ("--sinks", "bad"), ("--nonsense",), ("a", "b")])
def test_wrong_usage_is_unknown_and_no_state_of_a_bus(bus, words):
    status, line = bus.check(*words)
    assert (status, line) == (UNKNOWN, "")


@pytest.mark.parametrize("words", [("--load", "1,2"), ("--json", "--check")])
def test_limits_without_a_check_are_wrong_usage(bus, words):
    done = subprocess.run([CANWIRE, "status", *words], cwd=bus.folder, capture_output=True,
                          text=True, timeout=60, check=False)
    assert done.returncode == (UNKNOWN if "--check" in words else 2)
    assert done.stdout == "" and "go with --check" in done.stderr
