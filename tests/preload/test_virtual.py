# SPDX-License-Identifier: MIT
"""Unmodified programs in virtual time: canwire run --virtual at a bus with `pacing: virtual`."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from compiled import compiled
from simtool import (CANWIRE, CANWIRED, ROOT, TIMEOUT_S, canwire, events, journal_text,
                     kill_all, listens, stop_canwired)
from test_record import wait_until

BUS = """bus: {{ name: slow, bitrate: 500000 }}
control: slow.sock
pacing: virtual
virtual: {{ programs: {programs} }}
{more}
nodes:
  - {{ name: engine, port: "unix:engine.sock"{engine} }}
  - {{ name: dash, port: "unix:dash.sock" }}
  - {{ name: idle }}
"""


class Virtual:
    def __init__(self, folder, programs=1, more="", engine="", environment=None):
        folder.mkdir(exist_ok=True)
        self.folder, self.log, self.started = folder, folder / "stderr", []
        (folder / "bus.yaml").write_text(BUS.format(programs=programs, more=more, engine=engine))
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml", "--journal", "journal"],
                                            cwd=folder, stderr=log,
                                            env={**os.environ, **(environment or {})})
        wait_until(lambda: listens(folder / "slow.sock") or self.process.poll() is not None,
                   "the bus")

    def begin(self, node, *program, **more):
        words = [CANWIRE, "run", "--virtual", "--bus", "./slow.sock", "--as", node, "--", *program]
        more = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE,
                "stderr": subprocess.PIPE, **more}
        self.started.append(subprocess.Popen(list(map(str, words)), cwd=self.folder, text=True,
                                             **more))
        return self.started[-1]

    @staticmethod
    def end(program, status=0):
        out, errors = program.communicate(timeout=TIMEOUT_S)
        assert program.returncode == status, (program.returncode, out, errors)
        return out

    def run(self, node, *program, status=0):
        return self.end(self.begin(node, *program), status)

    def status(self):
        return json.loads(canwire("status", "./slow.sock", "--json", cwd=self.folder).stdout)

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture
def bus(tmp_path):
    """bus(KEY=TEXT…) starts a canwired in virtual time, in a folder of its own."""
    buses = []

    def make(**more):
        buses.append(Virtual(tmp_path / f"bus-{len(buses)}", **more))
        return buses[-1]

    yield make
    for one in buses:
        kill_all([*one.started, one.process])


@pytest.fixture(scope="module")
def waits(tmp_path_factory):
    """The path of the program waits.c."""
    made = tmp_path_factory.mktemp("waits") / "waits"
    subprocess.run([os.environ.get("CC", "cc"), "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra",
                    "-Werror", "-pthread", "-o", made, ROOT / "tests/preload/waits.c"], check=True)
    return made


# ---- Waiting -------------------------------------------------------------------------------------

EXPECTED = {
    "sleeps": """5.000 nanosleep 0
1000.000 clock_nanosleep 0
1000.250 usleep 0
3601000.250 sleep 0
3601007.250 poll 0
3601010.250 select 0
1 1 1
""",
    # alarm() ends a read, and the timer of 1 ms has rung four times more
    "timers": """30.000 timerfd 1
80.000 timerfd 2
90.000 poll 1
2090.000 read -4
2094.000 alarms 5
""",
    "spins": "over\n",
    "computes": "0.000 computed 0\n",
    "has_children": """1.000 slept 0
5.000 child 3
2005.000 system 0
""",
}


@pytest.mark.parametrize("way", EXPECTED)
def test_each_wait_ends_at_its_time(bus, waits, way):
    assert bus().run("engine", waits, way, "engine") == EXPECTED[way]


def test_frames_wake_those_who_wait_for_them(bus, waits):
    """A frame of no data and identifier 0 lasts 56 bits with its stuff bits and acknowledgement.
    It is there at the end of the last but one bit of EOF."""
    b = bus(programs=2)
    reader = b.begin("dash", waits, "receives", "dash")
    b.run("engine", "cangen", "engine", "-g", "10", "-n", "3", "-I", "123", "-L", "0")
    shown = [line.split(" ", 1) for line in b.end(reader).splitlines()]
    assert [line[1] for line in shown] == [
        "poll 1", "read 16", "select 0", "blocking read 16", "read with a limit -11",
        "epoll_wait 0", "epoll_wait 1", "read 16", "read -11"]
    at = [float(line[0]) for line in shown]
    assert at[0] == at[1] and 0.1 < at[0] < 0.15  # its bits, and 11 before that
    assert at[2] == pytest.approx(at[0] + 4, abs=0.0011)
    assert at[3] == pytest.approx(at[0] + 10, abs=0.05)
    assert at[4] == pytest.approx(at[3] + 4, abs=0.0011) and at[6] == at[7] == at[8]


def test_a_program_of_an_hour_takes_no_time(bus):
    b, begun = bus(), time.monotonic()
    b.run("engine", "sleep", "3600")
    assert time.monotonic() - begun < 20
    assert b.status()["virtual"] == {"socket": "slow.sock.time", "programs": 1, "joined": 0,
                                     "begun": True, "now_ns": 3600 * 10**9, "runs": None,
                                     "rests": True}


# ---- Runs are the same ---------------------------------------------------------------------------

SCRIPT = ("cansequence engine --loop=100; sleep 3; cansend engine 111#22; sleep 0.01; "
          "cangen engine -g 5 -n 50; cangen engine -g 0 -p 1 -n 200")


def drive(b):
    """Runs three programs, one of them a shell with others; what they have shown."""
    record = subprocess.Popen([CANWIRE, "record", "./slow.sock", "bus.log"], cwd=b.folder,
                              stderr=subprocess.PIPE, text=True)
    assert "writing" in record.stderr.readline()
    wait_until(lambda: (b.folder / "bus.log").exists(), "the recording")
    dump = b.begin("dash", "candump", "-t", "z", "-x", "-T", "4000", "dash")
    other = b.begin("dash", "cangen", "dash", "-g", "7", "-n", "30")
    b.run("engine", "sh", "-c", SCRIPT)
    b.end(other)
    shown = b.end(dump)
    wait_until(lambda: (b.folder / "bus.log").read_bytes().count(b"\n") == 381, "all of it")
    record.send_signal(signal.SIGINT)
    assert record.wait(TIMEOUT_S) == 0
    b.stop()
    return shown


def without_configuration(journal):
    return [line for line in journal_text(journal).splitlines() if '"config"' not in line]


def test_two_runs_are_the_same_byte_for_byte(bus):
    pair = [bus(programs=3), bus(programs=3)]
    one, other = map(drive, pair)
    assert one == other and len(one.splitlines()) == 381
    journals = [without_configuration(b.folder / "journal") for b in pair]
    assert journals[0] == journals[1] and len(journals[0]) > 381
    logs = [(b.folder / "bus.log").read_bytes() for b in pair]
    assert logs[0] == logs[1] and logs[0].count(b"\n") == 381
    assert logs[0].startswith(b"(1000000000.000134) engine 002#00\n")


def test_the_journal_repeats_the_run(bus):
    b = bus(programs=2)
    dump = b.begin("dash", "candump", "-L", "-T", "1000", "dash")
    b.run("engine", "cangen", "engine", "-g", "3", "-n", "40")
    seen = [re.sub(r"\(\d+\.\d+\) dash ", "", line) for line in b.end(dump).splitlines()]
    b.stop()
    log = canwire("sim", "--journal", "journal", "--events", "-", cwd=b.folder).stdout
    assert [e["frame"] for e in map(json.loads, log.splitlines()) if e["event"] == "rx" and
            e["node"] == "dash"] == seen and len(seen) == 40


# ---- Programs ------------------------------------------------------------------------------------

PYTHON_CAN = """
import can, time
begin = time.monotonic()
with can.Bus(interface="socketcan", channel="{node}") as bus:
    {body}
"""
PERIODIC = """task = bus.send_periodic(can.Message(arbitration_id=0x77, is_extended_id=False), 0.25)
    time.sleep(60.1)
    task.stop()
    print(round(time.monotonic() - begin, 6))"""
RECEIVE = """stamps = [bus.recv(5).timestamp for _ in range(241)]
    print(len({round(b - a, 6) for a, b in zip(stamps, stamps[1:])} - {0.25}), bus.recv(5))"""


def test_python_can_with_frames_of_can_bcm(bus):
    b = bus(programs=2)
    reader = b.begin("dash", sys.executable, "-c", PYTHON_CAN.format(node="dash", body=RECEIVE))
    out = b.run("engine", sys.executable, "-c", PYTHON_CAN.format(node="engine", body=PERIODIC))
    assert float(out) == pytest.approx(60.1, abs=0.05)
    assert b.end(reader) == "0 None\n"


def test_a_program_whose_queue_is_full_waits_for_the_bus(bus):
    """A frame of 8 bytes has 111 to 135 bits with intermission; the program could write all at
    once."""
    b = bus(engine=", queue: 2")
    b.run("engine", "cangen", "engine", "-g", "0", "-n", "2000", "-L", "8", "-I", "555")
    wait_until(lambda: b.status()["virtual"]["rests"], "the end")
    status = b.status()
    assert status["bus"]["frames"] == 2000 and not any(status["nodes"][0]["dropped"].values())
    assert 2000 * 111 * 2000 <= status["virtual"]["now_ns"] < 2000 * 136 * 2000


def test_guests_in_virtual_time(bus):
    b = bus(more='guests: { count: 4, port: "unix:guests.sock" }')
    assert b.run("tester", "sh", "-c", "cansend tester 123#45; sleep 1; cansend tester 124#") == ""
    assert b.status()["bus"]["frames"] == 2


def test_threads_are_refused(bus, waits):
    b = bus()
    program = b.begin("engine", waits, "makes_threads", "engine")
    out, errors = program.communicate(timeout=TIMEOUT_S)
    assert out == "0.000 pthread_create 1\n"
    assert errors.count("only programs of one thread have virtual time") == 1


def test_signals_reach_a_program_that_waits(bus):
    b = bus(programs=2)
    dump = b.begin("dash", "candump", "dash")
    sleeper = b.begin("engine", "sh", "-c", "sleep 5; cansend engine 01A#; sleep 2")
    b.end(sleeper)
    assert dump.stdout.readline().split() == ["dash", "01A", "[0]"]
    wait_until(lambda: b.status()["virtual"]["rests"], "the wait")  # a handler alone ends nothing
    dump.send_signal(signal.SIGTERM)
    assert dump.wait(TIMEOUT_S) == 0  # it has a handler
    wait_until(lambda: b.status()["virtual"]["joined"] == 0, "its end")


def test_a_signal_between_turn_and_wait_ends_the_wait(bus, monkeypatch):
    """With a call of the kernel there is nothing between them."""
    monkeypatch.setenv("LD_PRELOAD", str(compiled("signal_at_wait.so")))
    code = """import signal
signal.signal(signal.SIGUSR1, lambda number, frame: None)
signal.pause()"""
    b = bus()
    b.run("engine", sys.executable, "-c", code)


def test_a_program_that_is_killed_holds_nobody(bus, waits):
    b = bus(programs=2)
    idle = b.begin("dash", "sleep", "1000000")
    busy = b.begin("engine", sys.executable, "-c", "while True: pass")
    wait_until(lambda: "while True" in (b.status()["virtual"]["runs"] or ""), "its turn")
    assert b.status()["virtual"]["now_ns"] < 10**7 and idle.poll() is None
    busy.kill()
    b.end(idle)


def test_the_log_tells_who_holds_time(bus):
    b = bus()
    busy = b.begin("engine", sys.executable, "-c", "while True: pass")
    wait_until(lambda: "virtual time holds for 5 s: process " in b.log.read_text(), "the message")
    assert b.log.read_text().rstrip().endswith("while True: pass")
    assert "holds for" in canwire("status", "./slow.sock", cwd=b.folder).stdout
    busy.kill()


def test_other_descriptors_end_a_wait(bus):
    """asyncio waits with epoll for a pipe, and select for its end; frames do not disturb."""
    code = """import asyncio, os, select, sys
async def main():
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    await asyncio.sleep(3)
    print(await reader.readline(), flush=True)
    await asyncio.sleep(3600)
asyncio.run(main())
print(select.select([0], [], [])[0])"""
    b = bus()
    program = b.begin("engine", sys.executable, "-c", code, stdin=subprocess.PIPE)
    wait_until(lambda: b.status()["virtual"]["now_ns"] >= 3 * 10**9, "three seconds")
    assert b.status()["virtual"]["rests"]
    program.stdin.write("hello\n")
    program.stdin.flush()
    assert program.stdout.readline() == "b'hello\\n'\n"
    program.stdin.close()
    assert program.stdout.read() == "[0]\n" and program.wait(TIMEOUT_S) == 0
    assert 3603 * 10**9 < b.status()["virtual"]["now_ns"] < 3604 * 10**9


def test_time_begins_when_all_programs_are_there(bus):
    b = bus(programs=2)
    first = b.begin("engine", "cangen", "engine", "-g", "100", "-n", "10")
    wait_until(lambda: b.status()["virtual"]["joined"] == 1, "the first program")
    time.sleep(0.2)  # no wait: nothing begins meanwhile
    status = b.status()
    assert first.poll() is None and not status["virtual"]["begun"]
    assert status["bus"]["frames"] == 0 and status["virtual"]["now_ns"] == 0
    b.run("dash", "candump", "-n", "10", "dash")
    b.end(first)


def test_time_stands_still_at_its_end(bus):
    made = bus(programs="1, until: 10s")
    out = made.folder / "out"
    with out.open("w") as file:
        made.begin("engine", "sh", "-c", "while sleep 0.4; do echo on; done", stdout=file)
        wait_until(lambda: made.status()["virtual"]["now_ns"] == 10 * 10**9, "the end of time")
        wait_until(lambda: made.status()["virtual"]["rests"], "the last turn")
    assert made.started[-1].poll() is None and out.read_text() == "on\n" * 25


def test_a_program_comes_after_one_that_was_killed(bus):
    b = bus(programs=1)
    first = b.begin("engine", "sh", "-c", "sleep 5; echo ready; read line; sleep 100",
                    stdin=subprocess.PIPE)
    assert first.stdout.readline() == "ready\n"
    first.kill()
    code = "import time; print(time.monotonic())"
    assert 1005 <= float(b.run("engine", sys.executable, "-c", code)) < 1015


HOLD = "import time\ntime.sleep(1)\nprint('holds', flush=True)\nwhile True: pass"
SLEEP = "import time\nprint('waits', flush=True)\nbegin = time.monotonic()\ntime.sleep(2)\n" \
    "print(2 <= time.monotonic() - begin < 60)"
READ = "import can\nwith can.Bus(interface='socketcan', channel='engine') as b:\n" \
    "    print('waits', flush=True)\n" \
    "    try:\n        b.recv()\n    except can.CanError as e:\n        print(e)\n"


SENDS = """
import socket, struct, time
s = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
s.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, 1)
s.bind(("engine",))
for _ in range(3):
    time.sleep(0.0020511)
    begin = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    s.send(struct.pack("=IB3x8s", 0x123, 1, b"\\1"))
    s.recv(16)
    print(time.clock_gettime_ns(time.CLOCK_MONOTONIC) - begin)
"""


def test_a_frame_in_the_middle_of_a_bit_begins_with_the_next_one(bus):
    """It has 55 bits of 2 us, and waits for a part of one. No time is skipped."""
    b = bus()
    took = b.run("engine", sys.executable, "-c", SENDS).split()
    assert len(took) == 3 and all(110_000 <= int(ns) <= 112_000 for ns in took), took
    assert "skipped" not in b.log.read_text()


@pytest.mark.parametrize("code, said", [
    pytest.param(SLEEP, "True", id="sleeps"), pytest.param(READ, "Network is down", id="reads")])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_program_that_waits_goes_on_when_the_bus_goes(bus, code, said, number):
    """Time goes on with the clock of the machine, and calls of sockets fail."""
    b = bus(programs=2)
    waiter = b.begin("engine", sys.executable, "-c", code)
    holder = b.begin("dash", sys.executable, "-c", HOLD)
    assert waiter.stdout.readline() == "waits\n" and holder.stdout.readline() == "holds\n"
    b.process.send_signal(number)
    b.process.wait(TIMEOUT_S)
    assert said in b.end(waiter)


@pytest.mark.parametrize("call", ["b.recv()", "b.socket.recv(72)"])
def test_a_port_that_goes_later_than_time_ends_a_wait(bus, call, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    b = bus(programs=2, environment={"LD_PRELOAD": str(compiled("late_end.so")),
                                     "LATE_END": str(pipe)})
    code = READ.replace("b.recv()", call).replace("can.CanError", "(can.CanError, OSError)")
    waiter = b.begin("engine", sys.executable, "-c", code)
    holder = b.begin("dash", sys.executable, "-c", HOLD)
    assert waiter.stdout.readline() == "waits\n" and holder.stdout.readline() == "holds\n"
    b.process.send_signal(signal.SIGTERM)
    with pipe.open("rb"):  # canwired is about to close the port
        time.sleep(0.2)  # no wait: the program may see both ends at once
    with pipe.open("wb"):
        pass
    assert "Network is down" in b.end(waiter)


# ---- The protocol --------------------------------------------------------------------------------

HEAD = struct.Struct("<BBHIIIQQ")
JOIN, NOW, WAIT = 1, 2, 3


def join_time(connection, pid):
    body = struct.pack("<8sIi16i36s128s", b"canwire", 1, pid, *[0] * 16, b"engine", b"by hand")
    connection.send(HEAD.pack(JOIN, 0, HEAD.size + len(body), 0, 0, 0, 0, 0) + body)


def now_ns(connection):
    kind, *_, bus_ns = HEAD.unpack(connection.recv(512))  # whole: a packet
    assert kind == NOW
    return bus_ns


def test_who_has_connected_and_not_joined_yet_is_waited_for(bus):
    """A child connects before its parent waits. Both messages may come at once."""
    b = bus()
    folder = Path(f"/proc/{b.process.pid}/fd")
    with (socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as parent,
          socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as child):
        for one in (parent, child):
            one.settimeout(TIMEOUT_S)
        parent.connect(str(b.folder / "slow.sock.time"))
        join_time(parent, os.getpid())
        assert now_ns(parent) == 0
        before = len(list(folder.iterdir()))
        child.connect(str(b.folder / "slow.sock.time"))
        wait_until(lambda: len(list(folder.iterdir())) > before, "the connection")
        b.process.send_signal(signal.SIGSTOP)
        join_time(child, 1)
        parent.send(HEAD.pack(WAIT, 0, HEAD.size, 0, 0, 0, 0, 1000000))
        b.process.send_signal(signal.SIGCONT)
        assert now_ns(child) == 0


def test_time_begins_with_programs_that_join_at_once(bus):
    """The message of the second one is read while that of the first one is obeyed."""
    b = bus(programs=2)
    folder = Path(f"/proc/{b.process.pid}/fd")
    before = len(list(folder.iterdir()))
    with (socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as first,
          socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as second):
        for one in (first, second):
            one.settimeout(TIMEOUT_S)
            one.connect(str(b.folder / "slow.sock.time"))
        wait_until(lambda: len(list(folder.iterdir())) >= before + 2, "the connections")
        b.process.send_signal(signal.SIGSTOP)
        join_time(first, os.getpid())
        join_time(second, 1)
        b.process.send_signal(signal.SIGCONT)
        wait_until(lambda: b.status()["virtual"]["begun"], "the time of both")


# ---- What is refused -----------------------------------------------------------------------------

def test_virtual_needs_virtual_time(bus, tmp_path):
    b = bus()
    (tmp_path / "real.yaml").write_text("bus: { name: r, bitrate: 500000 }\nnodes:\n"
                                        "  - { name: engine, port: 'unix:r.sock' }\n")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(tmp_path / "r.sock"))
        listener.listen()
        done = canwire("run", "--virtual", "--bus", "real.yaml", "--as", "engine", "--", "true",
                       status=1, cwd=tmp_path)
    assert done.stderr == ("canwire run: --virtual: bus real.yaml has real time: it needs "
                           "'pacing: virtual'\n")
    done = canwire("run", "--bus", "./slow.sock", "--as", "engine", "--", "true", cwd=b.folder)
    assert "bus ./slow.sock has virtual time" in done.stderr


@pytest.mark.parametrize("text, message", [
    ("virtual: {}\n", "3:10: virtual: only a bus with 'pacing: virtual' has it"),
    ("pacing: virtual\n", "3:9: virtual: socket: expected the path of a socket"),
    ("pacing: virtual\nvirtual: { programs: 0, socket: s }\n",
     "programs: expected a decimal integer 1..64, not '0'"),
    ("pacing: virtual\nvirtual: { socket: " + "x" * 200 + " }\n", "has at most 107 bytes"),
])
def test_wrong_configurations(tmp_path, text, message):
    (tmp_path / "bus.yaml").write_text("bus: { name: r, bitrate: 500000 }\nnodes: [{ name: a }]\n" +
                                       text)
    assert message in canwire("check", "bus.yaml", status=1, cwd=tmp_path).stderr


def test_a_reload_keeps_the_kind_of_time(bus):
    b = bus()
    file = b.folder / "bus.yaml"
    text = file.read_text()
    file.write_text(text.replace("pacing: virtual\nvirtual: { programs: 1 }", "pacing: tick"))
    assert "pacing: virtual cannot change while the bus runs" in \
        canwire("reload", "./slow.sock", status=1, cwd=b.folder).stderr
    file.write_text(text.replace("idle", "other"))
    canwire("reload", "./slow.sock", cwd=b.folder)
    b.run("other", "true", status=1)
    b.run("engine", "sh", "-c", "cansend engine 123#; sleep 1")
    assert [n["name"] for n in b.status()["nodes"]] == ["engine", "dash", "other"]
    assert b.status()["bus"]["frames"] == 1


def test_no_bus_of_a_rig_has_virtual_time(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        "bus: { name: r, bitrate: 500000 }\npacing: virtual\nvirtual: { socket: s }\n"
        "nodes: [{ name: a }]\n")
    (tmp_path / "rig.yaml").write_text("buses: [ bus.yaml ]\n")
    assert "rig.yaml:1:10: buses: 'bus.yaml' has 'pacing: virtual', which a bus of a rig cannot " \
        "have" in canwire("check", "rig.yaml", status=1, cwd=tmp_path).stderr


def test_sim_runs_such_a_file_as_any_other(tmp_path):
    (tmp_path / "bus.yaml").write_text(
        "bus: { name: r, bitrate: 500000 }\npacing: virtual\nvirtual: { socket: s }\n"
        "nodes: [{ name: a, traffic: [{ send: 123# }] }, { name: b }]\n")
    assert [e["event"] for e in events(tmp_path / "bus.yaml")] == ["rx", "tx"]
