# SPDX-License-Identifier: MIT
"""canwired and the surroundings it runs in: what happens to it, and what it does to others.

Nodes have traffic of their own here, so this needs no CAN in the kernel. CANWIRE and CANWIRED are
the programs.
"""

import contextlib
import json
import os
import re
import resource
import signal
import socket
import struct
import subprocess
import threading
from pathlib import Path

import pytest

from simtool import CANWIRE, CANWIRED, journal_text, kill_all, read_clean_log, stop_canwired
from test_record import PATIENCE_S, wait_until

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 5ms } ] }
  - { name: dash }
"""


class Daemon:
    """A canwired in a folder that others may share; stderr: the file of its messages, or its
    log."""

    def __init__(self, folder, *words, text=BUS, stderr=None):
        self.folder, self.log = folder, folder / "stderr"
        (folder / "bus.yaml").write_text(text)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "bus.yaml", *words], cwd=folder,
                                            stderr=log if stderr is None else stderr)

    def wait_ready(self):
        wait_until(self.answers, "the control socket")
        assert self.status()["bus"]["name"] == "day"

    def answers(self):
        """Returns True when it answers: it listens a moment after its socket exists."""
        with socket.socket(socket.AF_UNIX) as client:
            return client.connect_ex(str(self.folder / "day.sock")) == 0

    def canwire(self, *words):
        return subprocess.run([CANWIRE, *words], cwd=self.folder, capture_output=True, text=True,
                              timeout=PATIENCE_S, check=True).stdout

    def status(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def stop(self):
        text = stop_canwired(self.process, self.log)
        assert not (self.folder / "day.sock").exists()
        return text

    def read_log(self):
        return read_clean_log(self.log)


@pytest.fixture(name="canwired")
def fixture_canwired(tmp_path):
    """canwired("--journal", "j", text=BUS) is a bus that runs."""
    started = []

    def start(*words, **more):
        started.append(Daemon(tmp_path, *words, **more))
        started[-1].wait_ready()
        return started[-1]

    yield start
    kill_all(each.process for each in started)


# ---- Starts that are refused ---------------------------------------------------------------------


def refused(folder, *words):
    """Returns the messages of a canwired that refuses to start."""
    result = subprocess.run([CANWIRED, "-c", "bus.yaml", *words], cwd=folder, capture_output=True,
                            text=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 1, result.stderr
    assert " bit/s, " not in result.stderr
    return result.stderr


def test_a_start_that_is_refused_leaves_the_journal_of_the_running_bus(canwired, tmp_path):
    bus = canwired("--journal", "day.journal")
    for _ in range(2):  # of the files that are kept, there are two
        assert "day.sock" in refused(tmp_path, "--journal", "day.journal")
    bus.canwire("set", "./day.sock", "dash", "listen-only=on")
    bus.stop()
    assert not (tmp_path / "day.journal.1").exists()
    text = journal_text(tmp_path / "day.journal")
    assert '"sent":' in text and '"set":"dash"' in text and '"end":' in text
    bus.canwire("sim", "--journal", "day.journal")


def test_a_journal_that_cannot_begin_is_an_error(tmp_path):
    (tmp_path / "bus.yaml").write_text(BUS)
    assert "journal no/journal: No such file" in refused(tmp_path, "--journal", "no/journal")
    assert not (tmp_path / "day.sock").exists()


# ---- A journal that cannot be written ------------------------------------------------------------


def limit_files(process, size):
    """Stands for a full disk: no file of this process may become larger."""
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


@pytest.mark.parametrize("how", ["itself", "reload", "end"])
def test_a_broken_journal_is_shown_and_taken_up_again(canwired, tmp_path, how):
    bus = canwired("--journal", "day.journal")

    def journal():
        return bus.status()["journal"]

    assert (journal()["state"], journal()["gaps"]) == ("writing", 0)
    assert "journal day.journal: writing lines" in bus.canwire("status", "./day.sock")
    limit_files(bus.process, (tmp_path / "day.journal").stat().st_size + 300)
    wait_until(lambda: journal()["state"] == "broken", "the end of the journal")
    assert journal()["why"] == "File too large" and journal()["broken_ns"] > 0
    assert "journal day.journal: broken: File too large" in bus.canwire("status", "./day.sock")
    wait_until(lambda: "journal day.journal: broken from " in bus.read_log(), "the message")
    limit_files(bus.process, resource.RLIM_INFINITY)
    if how == "reload":
        bus.canwire("reload", "./day.sock")
    if how != "end":
        wait_until(lambda: journal()["state"] == "writing", "a journal that is written again")
        assert journal()["gaps"] == 1 and journal()["lost"] > 0
        wait_frames(bus, 20)
    assert "taken up again, nothing is written from " in bus.stop()
    checked = subprocess.run([CANWIRE, "check", "--journal", "day.journal"], cwd=tmp_path,
                             capture_output=True, text=True, check=False)
    assert checked.returncode == 1 and " ended, 1 gap)" in checked.stdout
    lines = checked.stderr.splitlines()
    assert len(lines) == 1 and "(File too large), " in lines[0], checked.stderr
    again = subprocess.run([CANWIRE, "sim", "--journal", "day.journal", "--events", "-"],
                           cwd=tmp_path, capture_output=True, text=True, check=False)
    assert again.returncode == 0 and '"event":"tx"' in again.stdout
    assert "what followed cannot be run again" in again.stderr


def test_a_journal_is_told_over_lcm(canwired, lcm_server):
    server = lcm_server()
    bus = canwired("--journal", "day.journal", text=LCM.replace("PORT", str(server.port)).replace(
        "events: [rx, tx]", "events: [state]"))
    server.accept()
    received = b""
    while b"CANWIRE.day.FILE" not in received or b"day.journal\0" not in received:
        received += server.client.recv(1 << 16)
    server.close()
    bus.stop()


def test_an_empty_journal_is_not_one_too_many(canwired, tmp_path):
    (tmp_path / "day.journal").touch()
    bus = canwired("--journal", "day.journal")
    removed = [line for line in bus.log.read_text().splitlines() if "is removed" in line]
    assert len(removed) == 1 and removed[0].endswith("empty) is removed")
    bus.stop()


def test_in_a_loop_of_crashes_the_first_journal_stays(canwired, tmp_path):
    for _ in range(6):
        bus = canwired("--journal", "day.journal", "--journal-files", "3")
        wait_until(lambda: (tmp_path / "day.journal").stat().st_size > 0, "its first lines")
        bus.process.kill()
        bus.process.wait()
        (tmp_path / "day.sock").unlink()
        if not (tmp_path / "first").exists():
            (tmp_path / "first").write_bytes((tmp_path / "day.journal").read_bytes())
        log = bus.log.read_text()
    assert log.count("has no end") == 3 and "journal day.journal.1 " in log
    assert "is removed" in log
    kept = sorted(path.name for path in tmp_path.glob("day.journal*"))
    assert kept == ["day.journal", "day.journal.1", "day.journal.2"]
    assert (tmp_path / "day.journal.2").read_bytes() == (tmp_path / "first").read_bytes()


@pytest.mark.parametrize("words", [["--journal", "j", "--journal-files", "1"],
                                   ["--journal", "j", "--journal-files", "x"],
                                   ["--journal-files", "3"]])
def test_wrong_numbers_of_journals_are_wrong_usage(tmp_path, words):
    result = subprocess.run([CANWIRED, "-c", "bus.yaml", *words], cwd=tmp_path, check=False,
                            capture_output=True, timeout=PATIENCE_S)
    assert result.returncode == 2


# ---- Whoever reads the messages ------------------------------------------------------------------


def test_a_reader_of_the_messages_that_is_gone_does_not_end_it(canwired, tmp_path):
    reader, writer = os.pipe()
    bus = canwired("--journal", "day.journal", stderr=writer)
    os.close(writer)
    os.close(reader)
    for _ in range(2):  # each client is a message, and so is each reload
        bus.canwire("reload", "./day.sock")
    assert bus.status()["bus"]["name"] == "day"
    bus.stop()
    assert '"end":' in journal_text(tmp_path / "day.journal")


def test_messages_go_nowhere_when_there_is_no_standard_error(tmp_path):
    """And not to a file or socket that has got its number."""
    (tmp_path / "bus.yaml").write_text(BUS)
    words = f"exec {CANWIRED} -c bus.yaml --journal day.journal <&- >&- 2>&-"
    with subprocess.Popen(["sh", "-c", words], cwd=tmp_path) as process:
        wait_until(lambda: subprocess.run([CANWIRE, "reload", "./day.sock"], cwd=tmp_path,
                                          capture_output=True, check=False).returncode == 0,
                   "a reload")
        folder = Path(f"/proc/{process.pid}/fd")
        assert [os.readlink(folder / name) for name in "012"] == ["/dev/null"] * 3
        process.send_signal(signal.SIGTERM)
    assert process.returncode == 0
    assert '"end":' in journal_text(tmp_path / "day.journal")


def test_a_reader_of_events_that_is_gone_ends_the_tool_quietly(canwired):
    bus = canwired()
    with subprocess.Popen([CANWIRE, "watch", "./day.sock"], cwd=bus.folder, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as watch:
        assert watch.stdout.readline()
        watch.stdout.close()
        assert watch.stderr.read() == ""
        assert watch.wait(PATIENCE_S) == -signal.SIGPIPE
    bus.stop()


# ---- A server of LCM's that does not do its part -------------------------------------------------

# The address of this process alone: no other one takes a port that is to be used again.
HOST = "127.{}.{}.{}".format(*os.getpid().to_bytes(3, "big"))
LCM = BUS.replace("5ms", "200us").replace("500000", "1000000") + (
    "lcm: { url: 'tcpq://HOST:PORT', period: 50ms, events: [rx, tx] }\n".replace("HOST", HOST))
HELLO = struct.Struct(">II")
SERVER_HELLO = HELLO.pack(0x287617FA, 0x0100)


class LcmServer:
    """Stands for lcm-tcpq-server, for one publishing client."""

    def __init__(self, port=0):
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.listener.settimeout(PATIENCE_S)
        self.listener.bind((HOST, port))
        self.listener.listen(1)
        self.port = self.listener.getsockname()[1]
        self.client = None

    def accept(self, answer=True):
        self.client, _ = self.listener.accept()
        self.client.settimeout(PATIENCE_S)
        if answer:
            self.receive(HELLO.size)
            self.client.sendall(SERVER_HELLO)

    def receive(self, size):
        received = 0
        while received < size:
            part = len(self.client.recv(size - received))
            assert part, "the connection was closed"
            received += part

    def drain(self):
        while self.client.recv(1 << 16):
            pass

    def close(self):
        if self.client:
            with contextlib.suppress(OSError):  # unread messages go with it
                self.client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self.client.close()
        self.listener.close()


@pytest.fixture(name="lcm_server")
def fixture_lcm_server():
    """lcm_server() listens at a port of its own, lcm_server(PORT) at that one."""
    started = []

    def start(*port):
        started.append(LcmServer(*port))
        return started[-1]

    yield start
    for each in started:
        each.close()


def wait_frames(bus, count):
    """Waits until so many more frames were on the bus."""
    goal = bus.status()["bus"]["frames"] + count
    wait_until(lambda: bus.status()["bus"]["frames"] >= goal, f"{count} frames")


def unsent_bytes(port):
    """Returns the kernel's count of bytes on a connection to a port here that the other side has
    not taken."""
    lines = [line.split() for line in open("/proc/net/tcp", encoding="ascii")]
    server = f"{socket.inet_aton(HOST)[::-1].hex().upper()}:{port:04X}"
    return sum(int(words[4].split(":")[0], 16) for words in lines if words[2] == server)


def wait_stuck(bus, port):
    """Waits until all buffers are full: nothing is added to them any more, whatever happens."""
    samples = []
    while len(samples) < 5 or len(set(samples[-5:])) > 1 or samples[-1] == 0:
        wait_frames(bus, 2000)
        samples.append(unsent_bytes(port))
        assert len(samples) < 1000, samples


@pytest.mark.parametrize("answer", [False, True])
def test_a_server_that_stalls_does_not_keep_canwired_from_ending(canwired, lcm_server, answer):
    server = lcm_server()
    bus = canwired(text=LCM.replace("PORT", str(server.port)))
    server.accept(answer)
    if answer:
        server.receive(1000)
    if answer:
        wait_stuck(bus, server.port)
    assert "does not answer: the last" in bus.stop()


def test_a_server_that_is_gone_is_tried_again_now_and_then(canwired, lcm_server):
    server = lcm_server()
    bus = canwired(text=LCM.replace("PORT", str(server.port)))
    server.accept()
    server.receive(1000)
    server.close()
    wait_until(lambda: "messages cannot be sent and are lost" in bus.read_log(), "the warning")
    wait_frames(bus, 10000)
    assert len(bus.read_log().splitlines()) < 100
    server = lcm_server(server.port)
    server.accept()
    server.receive(1000)
    wait_until(lambda: "works again" in bus.read_log(), "the news")
    lost = int(re.search(r"works again, (\d+) messages were lost", bus.read_log()).group(1))
    assert lost > 10000
    drain = threading.Thread(target=server.drain)
    drain.start()
    assert "does not answer" not in bus.stop()
    drain.join()


# ---- More traffic than any machine can do --------------------------------------------------------

FRAME = "(0.000000) can0 123#DEADBEEF\n"
OTHERS = "(0.000000) can0 7FF#\n" * 2000
REPLAY = BUS.replace("send: 123#DEADBEEF, every: 5ms", "replay: day.log, MORE")
TOO_MUCH = {
    "send": (BUS.replace("5ms", "1ns"), ""),
    "replay": (REPLAY.replace("MORE", "loop: yes, gap: 1ns"), FRAME),
    "search": (REPLAY.replace("MORE", "loop: yes, gap: 1ns, only: '123:7FF'"), OTHERS + FRAME),
    "tick": (REPLAY.replace("MORE", "loop: yes, gap: 1ns"), FRAME * 20000),
}


@pytest.mark.parametrize("text, trace", TOO_MUCH.values(), ids=TOO_MUCH)
def test_too_much_traffic_leaves_time_for_all_else(canwired, tmp_path, text, trace):
    (tmp_path / "day.log").write_text(trace)
    bus = canwired(text=text)
    if trace:  # frames of a replay wait for room
        wait_until(lambda: bus.status()["nodes"][0]["tx_frames"] > 10, "frames")
    else:
        wait_until(lambda: bus.status()["nodes"][0]["dropped"]["queue-full"] > 0, "a full queue")
    bus.canwire("reload", "./day.sock")
    wait_until(lambda: "configuration reloaded" in bus.read_log(), "the reload")
    before = bus.status()["nodes"][0]["handed_in"]
    wait_until(lambda: bus.status()["nodes"][0]["handed_in"] > before, "more of it")
    engine = bus.status()["nodes"][0]
    assert engine["handed_in"] == (engine["tx_frames"] + engine["queue"]
                                   + sum(engine["dropped"].values()))
    bus.stop()


# ---- Settings ------------------------------------------------------------------------------------

FULL = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - name: engine
    queue: 2
    traffic: [ { send: 123#DEADBEEF, every: 100us } ]
  - { name: dash, queue: 1, traffic: [ { send: 124#DEADBEEF, every: 110us } ] }
"""
LONGER = "{ name: longer, do: { set: dash, queue: 3000 } }"


def test_a_queue_is_made_longer_while_the_bus_runs_and_the_journal_has_it(canwired):
    """From the 2 and 1 of the file to thousands, by `set` and by a rule."""
    bus = canwired("--journal", "day.journal", text=FULL)

    def queue_of(node):
        return next(n["queue"] for n in bus.status()["nodes"] if n["name"] == node)

    wait_until(lambda: queue_of("engine") == 2, "a full queue")
    bus.canwire("set", "./day.sock", "engine", "queue=4096")
    bus.canwire("inject", "./day.sock", LONGER)
    wait_until(lambda: queue_of("engine") > 20 and queue_of("dash") > 20, "longer queues")
    bus.canwire("set", "./day.sock", "dash", "queue=1")
    bus.stop()
    bus.canwire("sim", "--journal", "day.journal")  # at its end it compares what is pending


# ---- Warnings ------------------------------------------------------------------------------------

ODD = BUS + "faults: [ { name: odd, do: { no-ack: dash, for: 3us } } ]\n"


def test_what_is_rounded_is_told_at_the_start_at_a_reload_and_by_inject(canwired):
    told = "bus.yaml:6:49: warning: for: no whole number of bits of 2us"
    bus = canwired(text=ODD)
    assert bus.read_log().count(told) == 1
    bus.canwire("reload", "./day.sock")
    wait_until(lambda: bus.read_log().count(told) == 2, "a second warning")
    injected = subprocess.run(
        [CANWIRE, "inject", "./day.sock", "{ name: x, do: { no-ack: dash, for: 1ns } }"],
        cwd=bus.folder, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert injected.stdout == "x\n"
    assert injected.stderr.startswith("inject:1:37: warning: for: ")
    for command in ("check", "sim"):
        words = [CANWIRE, command, "bus.yaml"] + (["--until", "1ms"] if command == "sim" else [])
        result = subprocess.run(words, cwd=bus.folder, capture_output=True, text=True,
                                timeout=PATIENCE_S, check=True)
        assert result.stderr.startswith(told) and result.stderr.count("\n") == 1
    bus.stop()


def test_messages_of_the_tool_have_no_control_characters(canwired):
    daemon = canwired()
    daemon.wait_ready()
    for request in ["fire", "restart"]:
        result = subprocess.run([CANWIRE, request, "./day.sock", "a\x1b[31m\x9b1m\nb\x85"],
                                cwd=daemon.folder, capture_output=True, timeout=PATIENCE_S,
                                check=False)
        assert result.returncode == 1 and result.stderr.endswith(b"'a?[31m??1m?b??'\n")
    daemon.stop()


def test_the_messages_of_a_refused_reload_come_before_its_end_is_told(canwired, tmp_path,
                                                                      monkeypatch):
    """A program that waits for READY=1 finds the messages: it is not sent while they cannot be
    written."""
    out, into = os.pipe()
    with (socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
          os.fdopen(out, "rb") as errors):
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        daemon = canwired(stderr=into)
        while b"READY=1" not in manager.recv(4096):
            pass
        os.set_blocking(into, False)
        with contextlib.suppress(BlockingIOError):
            while os.write(into, b"."):
                pass
        os.set_blocking(into, True)
        os.close(into)
        (tmp_path / "bus.yaml").write_text("bus: {}\n")
        daemon.process.send_signal(signal.SIGHUP)
        syscall = Path(f"/proc/{daemon.process.pid}/syscall")
        wait_until(lambda: syscall.read_text().split()[1:2] == ["0x2"], "a message that waits")
        manager.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while told := manager.recv(4096):
                assert b"READY=1" not in told
        manager.settimeout(PATIENCE_S)
        text = b""
        while b"nothing was changed\n" not in text:
            text += errors.read1()
        while b"READY=1" not in manager.recv(4096):
            pass
        daemon.process.terminate()
        assert daemon.process.wait(PATIENCE_S) == 0


# ---- Bit timing ----------------------------------------------------------------------------------

CLOCKS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine, clock: 16MHz, ppm: -120, sample-point: 75%, sjw: 1, controller: sja1000 }
  - { name: dash, clock: 20MHz, brp: 2, prop-seg: 7, phase-seg1: 8, phase-seg2: 4,
      triple-sampling: on }
faults:
  - { name: warm, when: { manual: yes }, do: { set: dash, ramp: { ppm: 0..-3000, over: 1us } } }
"""


def test_the_status_shows_the_bit_timing_that_a_node_has_now(canwired):
    bus = canwired(text=CLOCKS)
    engine, dash = (node["timing"] for node in bus.status()["nodes"])
    assert engine == {"bitrate": 500000, "sample-point": "0.750", "tq_ps": 125000, "prop-seg": 5,
                      "phase-seg1": 6, "phase-seg2": 4, "sjw": 1, "brp": 2, "clock": 16000000,
                      "ppm": -120, "triple-sampling": False}
    assert (dash["brp"], dash["tq_ps"], dash["ppm"]) == (2, 100000, 0)
    bus.canwire("fire", "./day.sock", "warm")
    wait_until(lambda: bus.status()["nodes"][1]["timing"]["ppm"] == -3000, "a cold clock")
    text = bus.canwire("status", "./day.sock")
    assert "\n\t  clock 16000000 ppm -120\n" in text
    assert ("\t  bitrate 500000 sample-point 0.800 warning-limit 96\n"
            "\t  tq 100 prop-seg 7 phase-seg1 8 phase-seg2 4 sjw 2 brp 2\n"
            "\t  clock 20000000 ppm -3000 triple-sampling on\n") in text


DRIFTING = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes:
  - { name: engine, clock: 16MHz, traffic: [ { send: 123#00FF00FF00, every: 2ms } ] }
  - { name: dash, clock: 16MHz, ppm: -1000 }
"""


def test_the_status_tells_how_clocks_keep_up_with_the_bus(canwired):
    bus = canwired(text=DRIFTING)
    wait_frames(bus, 5)
    engine, dash = (node["synchronisation"] for node in bus.status()["nodes"])
    assert dash["hard"] >= 5 and dash["resync"] > 0 and dash["phase_error_tq"] < 0
    quantum_ps = bus.status()["nodes"][1]["timing"]["tq_ps"]
    assert abs(dash["phase_error_ps"] - dash["phase_error_tq"] * quantum_ps) <= 100
    assert 0 < dash["margin_ps"] < 2000000 > engine["margin_ps"] > 0
    assert "\n\t  hard-syncs " in bus.canwire("status", "./day.sock")


def test_the_status_of_equal_clocks_tells_no_synchronisations(canwired):
    bus = canwired(text=DRIFTING.replace("clock: 16MHz, ", "").replace(", ppm: -1000", "").replace(
        "dash, clock: 16MHz", "dash"))
    assert [node["synchronisation"] for node in bus.status()["nodes"]] == [None, None]
    assert "hard-syncs" not in bus.canwire("status", "./day.sock")
    bus.canwire("set", "./day.sock", "dash", "ppm=-1000")
    wait_frames(bus, 5)
    assert bus.status()["nodes"][1]["synchronisation"]["hard"] >= 2


def test_how_clocks_keep_up_is_told_over_lcm(canwired, lcm_server):
    server = lcm_server()
    bus = canwired(text=DRIFTING + f"lcm: {{ url: 'tcpq://{HOST}:{server.port}', period: 50ms }}\n")
    server.accept()
    received = b""
    while received.count(b"CANWIRE.day.TIMING") < 4 or b"CANWIRE.day.NODE" not in received:
        received += server.client.recv(1 << 16)
    server.close()
    bus.stop()
